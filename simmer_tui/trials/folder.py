"""The folder that a set of trials lives in: what is to be done, and what has been done.

trials.json     what is to be done, so that it can be gone on with
set/, mazes/    the configuration set and the mazes as they were at the beginning
points/         of a sweep, the sets whose files a value changes
results.jsonl   a line a run, appended when it is over
runs/           a log a run, and what its program printed; of failed runs a page
trials.csv      a row a run, by number
report.html     the report
"""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from itertools import count, takewhile
from pathlib import Path
from typing import Any

from msgspec import structs

from simmer_tui.config.loader import Configuration, Override, load
from simmer_tui.config.settings import all_settings
from simmer_tui.errors import ConfigurationError, Problem, TrialsError
from simmer_tui.sim.command import escape
from simmer_tui.sim.specs import MazeSpec
from simmer_tui.trials.mazes import maze_text, read_mazes
from simmer_tui.trials.record import TrialResult, parse_result
from simmer_tui.trials.run import LOG
from simmer_tui.trials.sweep import SweepPoint, check_effects, files_at, settings_at, shown_point
from simmer_tui.trials.trial import RANDOM, Trial, maze_faults, maze_of, run_seed, with_maze
from simmer_tui.version import __version__

FORMAT = 1
PLAN, SET, MAZES, RESULTS, RUNS = "trials.json", "set", "mazes", "results.jsonl", "runs"
POINTS, TABLE, PAGE = "points", "trials.csv", "report.html"


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialPlan:
    """What is to be done. `settings` holds the options over the set's settings.toml by dotted name,
    each with its value; `mazes` the names of the mazes, empty for the set's own. In a sweep `points`
    holds the values that stand over all that, and `runs` is for each of them."""

    command: str
    runs: int
    seed: int
    configuration: str
    settings: Mapping[str, Any]
    mazes: tuple[str, ...]
    random_mazes: bool
    fixed_ports: bool
    time_limit: float
    points: tuple[SweepPoint, ...] = ()

    @property
    def total(self) -> int:
        """All runs, of all points."""
        return self.runs * max(len(self.points), 1)

    def repetition(self, number: int) -> int:
        """Which of the runs of its point a run is, from 1; it says what is drawn for it. The points
        take turns, so that more runs of each can follow."""
        return (number - 1) // max(len(self.points), 1) + 1

    def point(self, number: int) -> int:
        """The index of a run's point."""
        return (number - 1) % max(len(self.points), 1)


class TrialFolder:
    """An open folder. Make it with `create` or `resume`, or `read` for one that is only looked at."""

    def __init__(self, path: Path, plan: TrialPlan, configuration: Configuration) -> None:
        self.path = path
        self.plan = plan
        self.configuration = configuration
        self._configurations = [_load_point(path, plan, index) for index in range(len(plan.points))]
        self.mazes: dict[str, MazeSpec] = read_mazes(path / MAZES) if plan.mazes else {}
        """The mazes that the runs take in turn, by name; empty for the set's own."""
        self.results: dict[int, TrialResult] = {}
        """What has been done, by number."""

    @classmethod
    def create(
        cls, path: Path, plan: TrialPlan, files: Mapping[str, str], mazes: Mapping[str, MazeSpec]
    ) -> TrialFolder:
        """Begin a set of trials in a new or empty folder. Raises TrialsError, ConfigurationError."""
        shown = escape(str(path), 200)
        try:
            path.mkdir(parents=True, exist_ok=True)
            if (path / PLAN).exists():
                raise TrialsError(f"{shown} holds trials already: add --resume to go on with them")
            if any(path.iterdir()):
                raise TrialsError(f"{shown} is not empty: name a new folder with --out")
            for name in (SET, RUNS, *([MAZES] if mazes else ())):
                (path / name).mkdir()
            for name, text in files.items():
                (path / SET / name).write_bytes(text.encode())
            for name, maze in mazes.items():
                (path / MAZES / name).write_text(maze_text(maze), "utf-8", newline="\n")
            for index, point in enumerate(plan.points):
                _write_point(path, index, files, files_at(point, path / SET))
            folder = cls(path, plan, _load(path / SET, plan, {}))
            folder._check_mazes()
            check_effects(plan.points, folder._configurations)
            folder.write_plan(plan)
        except ConfigurationError:
            for name in (SET, RUNS, MAZES, POINTS):  # so that the next try finds it empty again
                shutil.rmtree(path / name, ignore_errors=True)
            raise
        except OSError as error:
            raise TrialsError(f"{shown} cannot be written: {error.strerror or error}") from None
        return folder

    @classmethod
    def read(cls, path: Path) -> TrialFolder:
        """What there is of a set of trials. Raises TrialsError, ConfigurationError."""
        shown = escape(str(path), 200)
        try:
            plan = _parse_plan((path / PLAN).read_text("utf-8"))
        except (FileNotFoundError, NotADirectoryError):
            raise TrialsError(f"{shown} holds no trials: there is no {PLAN}") from None
        except OSError as error:
            raise TrialsError(f"{shown} cannot be read: {error.strerror or error}") from None
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise TrialsError(
                f"{escape(str(path / PLAN), 200)}: {escape(str(error), 200)}; it is not what a set of "
                f"trials of simmer-tui {__version__} begins with"
            ) from None
        folder = cls(path, plan, _load(path / SET, plan, {}))
        folder._read_results(plan)
        return folder

    @classmethod
    def resume(cls, path: Path) -> TrialFolder:
        """Go on where a set of trials was left. Raises TrialsError, ConfigurationError."""
        folder = cls.read(path)
        results = path / RESULTS
        try:
            if results.exists():  # a line that was cut off is not to begin the next
                data = results.read_bytes()
                whole = data[: data.rfind(b"\n") + 1]
                if len(whole) < len(data):
                    os.truncate(results, len(whole))
        except OSError as error:
            raise TrialsError(
                f"{escape(str(results), 200)} cannot be written: {error.strerror or error}"
            ) from None
        return folder

    @property
    def runs(self) -> Path:
        """Where the logs are."""
        return self.path / RUNS

    def log(self, number: int) -> Path:
        """The log of a run."""
        return self.runs / f"{self.trial(number).name}{LOG}"

    def trial(self, number: int) -> Trial:
        """A run as it is to be done; numbers begin with 1."""
        plan, names = self.plan, list(self.mazes)
        repetition = plan.repetition(number)
        name = ""
        configuration = self._configurations[plan.point(number)] if plan.points else self.configuration
        if plan.random_mazes:
            name = RANDOM
        elif names:
            name = names[(repetition - 1) % len(names)]
            configuration = with_maze(configuration, self.mazes[name])
        return Trial(
            number=number,
            repetition=repetition,
            seed=run_seed(plan.seed, repetition),
            configuration=configuration,
            maze=name,
            command=plan.command,
            fixed_ports=plan.fixed_ports,
            time_limit=plan.time_limit,
        )

    def maze(self, number: int) -> MazeSpec:
        """The maze of a run."""
        return maze_of(self.trial(number)).simulation.maze

    @property
    def to_do(self) -> list[int]:
        """The numbers of the runs without a result."""
        return [number for number in range(1, self.plan.total + 1) if number not in self.results]

    @property
    def done(self) -> list[TrialResult]:
        """The results by number."""
        return [self.results[number] for number in sorted(self.results)]

    @property
    def successes_in_order(self) -> list[bool]:
        """Whether runs succeeded, from the first up to one that is not done yet."""
        numbers = takewhile(self.results.__contains__, count(1))
        return [self.results[number].success for number in numbers]

    def append(self, result: TrialResult) -> None:
        """Keep the result of a run: on the disk when this returns. Raises TrialsError."""
        data = f"{result.line()}\n".encode()
        path = self.path / RESULTS
        try:
            with path.open("ab", buffering=0) as file:
                file.write(data)
                os.fsync(file.fileno())
        except OSError as error:
            raise TrialsError(
                f"{escape(str(path), 200)} cannot be written: {error.strerror or error}"
            ) from None
        self.results[result.number] = result

    def write_plan(self, plan: TrialPlan) -> None:
        """Write what is to be done. Raises TrialsError."""
        fields = {
            "format": FORMAT,
            "program": __version__,
            "written": datetime.now().astimezone().isoformat(timespec="seconds"),
            **dataclasses.asdict(plan),
        }
        self.write(PLAN, json.dumps(fields, indent=1) + "\n")
        self.plan = plan

    def write(self, name: str, text: str) -> Path:
        """Write a file of the folder, whole or not at all; returns its path. Raises TrialsError."""
        path = self.path / name
        partial = path.with_name(f"{path.name}.part")
        try:
            partial.write_text(text, "utf-8", newline="\n")
            partial.replace(path)
        except OSError as error:
            raise TrialsError(
                f"{escape(str(path), 200)} cannot be written: {error.strerror or error}"
            ) from None
        return path

    def _check_mazes(self) -> None:
        """Every maze must have room for robot, block and mission."""
        problems = [
            Problem(name, what)
            for name, maze in self.mazes.items()
            for what in maze_faults(with_maze(self.configuration, maze))
        ]
        if problems:
            raise ConfigurationError(problems)

    def _read_results(self, plan: TrialPlan) -> None:
        path = self.path / RESULTS
        try:
            lines = path.read_bytes().decode("utf-8", "replace").splitlines(keepends=True)
        except FileNotFoundError:
            return
        except OSError as error:
            raise TrialsError(f"{escape(str(path), 200)} cannot be read: {error.strerror or error}") from None
        for number, line in enumerate(lines, 1):
            if not line.endswith("\n"):
                break  # cut off: that run is not done
            try:
                result = parse_result(line)
            except (ValueError, RecursionError) as error:
                where = f"{escape(str(path), 200)}:{number}"
                raise TrialsError(
                    f"{where}: {escape(str(error), 200)}; delete the line to run it again"
                ) from None
            if result.seed != run_seed(plan.seed, plan.repetition(result.number)):
                raise TrialsError(f"{escape(str(path), 200)}:{number}: is of a run with another seed")
            self.results.setdefault(result.number, result)


def _load(directory: Path, plan: TrialPlan, values: Mapping[str, Any]) -> Configuration:
    options = {item.name: item.option for item in all_settings()}
    given = {**plan.settings, **values}
    overrides = {name: Override(options.get(name, name), value) for name, value in given.items()}
    loaded = load(directory, overrides)
    return structs.replace(loaded, name=plan.configuration)


def _load_point(path: Path, plan: TrialPlan, index: int) -> Configuration:
    """The configuration of a point. Raises ConfigurationError."""
    point, own = plan.points[index], path / POINTS / str(index + 1)
    values = settings_at(point, _load(path / SET, plan, {}))
    try:
        return _load(own if own.is_dir() else path / SET, plan, values)
    except ConfigurationError as error:
        where = f"--vary {shown_point(point)}"
        raise ConfigurationError([Problem(where, str(each)) for each in error.problems]) from None


def _write_point(path: Path, index: int, files: Mapping[str, str], changed: Mapping[str, str]) -> None:
    """The set of a point, where its values change files. Raises OSError."""
    if not changed:
        return
    folder = path / POINTS / str(index + 1)
    folder.mkdir(parents=True)
    for name, text in {**files, **changed}.items():
        (folder / name).write_bytes(text.encode())


def _parse_plan(text: str) -> TrialPlan:
    """Raises ValueError, KeyError, TypeError."""
    fields = json.loads(text)
    if not isinstance(fields, dict) or fields.get("format") != FORMAT:
        raise ValueError(f"the format is not {FORMAT}")
    points = tuple(fields.setdefault("points", []))  # there were none at first
    given = {field.name: fields[field.name] for field in dataclasses.fields(TrialPlan)}
    plan = TrialPlan(**given | {"mazes": tuple(fields["mazes"]), "points": points})
    for point in points:
        if not isinstance(point, dict) or not all(isinstance(value, str) for value in point.values()):
            raise ValueError("points must be values by name")
    numbers = (plan.runs, plan.seed, plan.time_limit)
    if not all(isinstance(number, int | float) and number >= 0 for number in numbers):
        raise ValueError("runs, seed and time_limit must be numbers")
    if not isinstance(plan.command, str) or not isinstance(plan.settings, dict):
        raise ValueError("command must be text and settings values by name")
    return plan
