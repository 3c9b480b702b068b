"""The folder of a set of trials: the plan and the results.

trials.json     the plan, so that the trials can be continued
set/, mazes/    the configuration set and the mazes as they were at the beginning
points/         of a sweep, the sets whose files a value changes
results.jsonl   a line a run, appended when it is over
why/            of failed runs that ran again with one change, a line each
runs/           a log a run, and what its program printed; of failed runs a page
trials.csv      a row a run, by number
report.html     the report
"""

from __future__ import annotations

import contextlib
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from msgspec import Meta, Struct, structs

from simmer_tui.config.device_trust import DeviceUse
from simmer_tui.config.loader import Configuration, Override, load
from simmer_tui.config.settings import all_settings
from simmer_tui.errors import ConfigurationError, Problem, TrialsError
from simmer_tui.runlog.writer import LOG
from simmer_tui.sim.specs import MazeSpec
from simmer_tui.trials.mazes import maze_text, read_mazes
from simmer_tui.trials.store import RunStore, StoreKind, unbroken
from simmer_tui.trials.sweep import SweepPoint, check_effects, files_at, settings_at, shown_point
from simmer_tui.trials.trial import (
    RANDOM,
    Trial,
    TrialResult,
    driven_by_boards,
    maze_faults,
    maze_of,
    run_seed,
    with_maze,
)

if TYPE_CHECKING:
    from simmer_tui.sketch.sketch_robot import SketchSet

PLAN, _SET, MAZES, RUNS, POINTS, WHY = "trials.json", "set", "mazes", "runs", "points", "why"
TABLE, REPORT_PAGE = "trials.csv", "report.html"


class TrialPlan(Struct, frozen=True, kw_only=True):
    """The runs to do. `settings` holds the options over the set's settings.toml by dotted name,
    each with its value; `mazes` the names of the mazes, empty for the set's own. In a sweep `points`
    holds the values that stand over all that, and `runs` is for each of them. If boards drive the robot,
    `sketches` has their files and hashes, by board, and `sketch_set` the folder from which wiring.toml names
    them; `command` may then be empty."""

    command: str
    runs: Annotated[int, Meta(ge=0)]
    seed: Annotated[int, Meta(ge=0)]
    configuration: str
    settings: Mapping[str, Any]
    mazes: tuple[str, ...]
    random_mazes: bool
    fixed_ports: bool
    time_limit: Annotated[float, Meta(ge=0)]
    points: tuple[SweepPoint, ...] = ()
    sketch_set: str = ""
    sketches: Mapping[str, str] = {}

    @property
    def program(self) -> str:
        """The programs that are tried, for people: that of the laptop, and the sketches of boards."""
        files = sorted({each.rpartition(" ")[0] for each in self.sketches.values()})
        return ", ".join(each for each in (self.command, *files) if each)

    @property
    def total(self) -> int:
        """All runs, of all points."""
        return self.runs * max(len(self.points), 1)

    def repetition(self, number: int) -> int:
        """Number of a run among those of its point, from 1; its draws follow from it. The points take turns,
        so that more runs of each can follow."""
        return (number - 1) // max(len(self.points), 1) + 1

    def point(self, number: int) -> int:
        """The index of a run's point."""
        return (number - 1) % max(len(self.points), 1)


KIND = StoreKind(
    noun="trials",
    plan_file=PLAN,
    folders=(_SET, MAZES, RUNS, POINTS),
    format=1,
    plan=TrialPlan,
    line=TrialResult,
    error=TrialsError,
)


class TrialFolder:
    """An open folder. Make it with `create` or `resume`, or `read` if it is only read."""

    def __init__(self, path: Path, plan: TrialPlan, devices: DeviceUse = DeviceUse.RUN) -> None:
        """With `devices` parsed it can be read, but no run can be done. Raises ConfigurationError."""
        self.path = path
        self.plan = plan
        self.store = RunStore(path, KIND)
        self.configuration = _load(path / _SET, plan, {}, devices)
        self._configurations = [
            _load_point(path, plan, index, self.configuration, devices) for index in range(len(plan.points))
        ]
        self.mazes: dict[str, MazeSpec] = read_mazes(path / MAZES) if plan.mazes else {}
        """The mazes that the runs take in turn, by name; empty for the set's own."""
        self.results: dict[int, TrialResult] = {}
        """All results, by number."""
        self._sketches: list[SketchSet] = []
        """The compiled sketches, with the wiring of each point, or of the set; empty until they are used."""

    @classmethod
    def create(
        cls,
        path: Path,
        plan: TrialPlan,
        files: Mapping[str, str],
        mazes: Mapping[str, MazeSpec],
        sketches: SketchSet | None = None,
    ) -> TrialFolder:
        """Begin a set of trials in a new or empty folder. Raises TrialsError, ConfigurationError."""
        store = RunStore(path, KIND)
        with store.made():
            (path / RUNS).mkdir()
            store.write_files(_SET, files)
            if mazes:
                store.write_files(MAZES, {name: maze_text(maze) for name, maze in mazes.items()})
            for index, point in enumerate(plan.points):
                if changed := files_at(point, path / _SET):
                    store.write_files(_point_folder(index), {**files, **changed})
            folder = cls(path, plan)
            folder._check_mazes()
            if sketches is not None:
                folder.use_sketches(sketches, Path(plan.sketch_set))
            check_effects(plan.points, folder._configurations)
            store.write_plan(plan)
        return folder

    @classmethod
    def read(cls, path: Path, devices: DeviceUse = DeviceUse.RUN) -> TrialFolder:
        """A set of trials with the results so far. Raises TrialsError, ConfigurationError."""
        store = RunStore(path, KIND)
        folder = cls(path, store.read_plan(), devices)
        for where, result in store.lines():
            if result.seed != run_seed(folder.plan.seed, folder.plan.repetition(result.number)):
                raise TrialsError(f"{where}: is of a run with another seed")
            folder.results.setdefault(result.number, result)
        return folder

    def use_sketches(self, sketches: SketchSet, directory: Path) -> None:
        """Let boards drive the robot in all runs from now on; `directory` is that of their set. Raises
        ConfigurationError if the values of a point do not go with wiring.toml."""
        from simmer_tui.sketch.wiring import wiring_of

        self._sketches = []
        for index, each in enumerate(self._configurations):
            with _named_point(self.plan.points[index]):
                wiring = wiring_of(structs.replace(each, directory=directory))
            assert wiring is not None, "a set with sketches has a wiring"
            self._sketches.append(structs.replace(sketches, wiring=wiring))
        self._sketches = self._sketches or [sketches]

    @property
    def runs(self) -> Path:
        """Folder of the logs."""
        return self.path / RUNS

    def log(self, number: int) -> Path:
        """The log of a run."""
        return self.runs / f"{self.trial(number).name}{LOG}"

    def trial(self, number: int) -> Trial:
        """The plan of one run; numbers begin with 1."""
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
            sketches=self._sketches[plan.point(number)] if self._sketches else None,
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
        """The success of each run, from the first up to one that is not done yet."""
        return [result.success for result in unbroken(self.results)]

    def append(self, result: TrialResult) -> None:
        """Write the result of a run, which is on the disk when this returns. Raises TrialsError."""
        self.store.append(result)
        self.results[result.number] = result

    def write_plan(self, plan: TrialPlan) -> None:
        """Replace the plan, if no run is being done. Raises TrialsError."""
        with self.store.locked():
            self.store.write_plan(plan)
        self.plan = plan

    def _check_mazes(self) -> None:
        """Every maze must have room for robot, block and mission."""
        problems = [
            Problem(name, what)
            for name, maze in self.mazes.items()
            for what in maze_faults(with_maze(self.configuration, maze))
        ]
        if problems:
            raise ConfigurationError(problems)


def _load(directory: Path, plan: TrialPlan, values: Mapping[str, Any], devices: DeviceUse) -> Configuration:
    options = {item.name: item.option for item in all_settings()}
    given = {**plan.settings, **values}
    overrides = {name: Override(options.get(name, name), value) for name, value in given.items()}
    loaded = load(directory, overrides, devices=devices)
    if plan.sketches:
        loaded = driven_by_boards(loaded)
    return structs.replace(loaded, name=plan.configuration)


def _point_folder(index: int) -> str:
    return f"{POINTS}/{index + 1}"


def _load_point(
    path: Path, plan: TrialPlan, index: int, base: Configuration, devices: DeviceUse
) -> Configuration:
    """The configuration of a point. Raises ConfigurationError."""
    point, own = plan.points[index], path / _point_folder(index)
    values = settings_at(point, base)
    with _named_point(point):
        return _load(own if own.is_dir() else path / _SET, plan, values, devices)


@contextlib.contextmanager
def _named_point(point: SweepPoint) -> Generator[None, None, None]:
    """Inside the `with` block mistakes in a configuration are named by the point that makes them."""
    try:
        yield
    except ConfigurationError as error:
        where = f"--vary {shown_point(point)}"
        raise ConfigurationError([Problem(where, str(each)) for each in error.problems]) from None
