"""The folder that a grading lives in; for the instructor's eyes only, but for site/.

grade.json      what is asked, the secret seed, the teams
course/         the course's configuration set as it was at the beginning
teams/          of each team, its files as handed in and the set it is graded with
results.jsonl   a line a run, appended when it is over
runs/           logs and output of failed runs
grades.csv, junit.xml, gradescope/, site/      the answer
"""

from __future__ import annotations

import dataclasses
import hmac
import json
import os
import shutil
from dataclasses import dataclass, replace
from itertools import count, takewhile
from pathlib import Path
from typing import Any

from simmer_tui.config import mission_toml
from simmer_tui.config.loader import Configuration, load
from simmer_tui.errors import ConfigurationError, GradeError, Problem
from simmer_tui.grade.course import PLAN_FILE, TEAMS_FOLDER, Course, Rules, Team, shown_name, submitted_team
from simmer_tui.grade.grade_run import GradeTrial
from simmer_tui.grade.limits import Isolation, Limits
from simmer_tui.grade.submission import PROGRAM, SubmissionCheck, check_submission, keep_files, reference
from simmer_tui.sim.command import escape
from simmer_tui.trials.record import TrialResult, parse_result
from simmer_tui.trials.run import OUTPUT, PACKED_LOG
from simmer_tui.trials.sequential import SequentialTest, Verdict, sequential_test
from simmer_tui.trials.trial import maze_faults, timed_seconds
from simmer_tui.version import __version__

FORMAT = 2
PLAN, TEAMS = PLAN_FILE, TEAMS_FOLDER
COURSE, RESULTS, RUNS = "course", "results.jsonl", "runs"
_PART = ".part"
_HAND_IN = 64_000_000
"""Bytes that a team may hand in; more would not fit into its sandbox either."""
_NUMBERS = 100_000
"""Numbers of runs set aside for each team."""


@dataclass(slots=True)
class Entry:
    """A team in the grading. `attempt` counts how often it was graded, `refused` says why its files
    could not be taken."""

    team: Team
    attempt: int
    refused: str
    check: SubmissionCheck
    results: dict[int, TrialResult]

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Why it is not graded, or empty."""
        refused = (Problem("files", self.refused),) if self.refused else ()
        return (*self.team.problems, *refused) or self.check.problems

    @property
    def in_order(self) -> list[TrialResult]:
        """Results from the first run up to one that is not done yet."""
        return [self.results[number] for number in takewhile(self.results.__contains__, count(1))]


class GradeFolder:
    """An open grading. Make it with `create` or `read`."""

    def __init__(
        self,
        path: Path,
        course: Course,
        seed: int,
        isolation: Isolation,
        entries: list[Entry],
        *,
        hides_names: bool,
    ) -> None:
        self.path = path
        self.course = course
        self.seed = seed
        self.isolation = isolation
        self.hides_names = hides_names
        self.entries = entries
        self.test: SequentialTest = sequential_test(course.require, course.margin, course.risk, course.cap)
        self._base = _base(path)
        self._drawn_for = reference(self._base, course.rules)
        for entry in entries:
            self._check_submission(entry)

    @classmethod
    def create(
        cls, path: Path, course: Course, seed: int, isolation: Isolation, *, hides_names: bool = False
    ) -> GradeFolder:
        """Begin a grading in a new or empty folder; with `hides_names` pages have codes.
        Raises GradeError, ConfigurationError, TrialsError."""
        shown = escape(str(path), 200)
        sequential_test(course.require, course.margin, course.risk, course.cap)
        base = load(course.directory)
        _check(base, reference(base, course.rules))
        part = path.with_name(f"{path.name}{_PART}")  # what is there is whole
        try:
            if path.exists() and any(path.iterdir()):
                what = (
                    "holds a grading already: add --resume to go on"
                    if (path / PLAN).exists()
                    else "is not empty"
                )
                raise GradeError(f"{shown} {what}, or name another folder with --out")
            if part.exists():
                shutil.rmtree(part)
            part.mkdir(parents=True, mode=0o700)
            for name in (COURSE, TEAMS, RUNS):
                (part / name).mkdir()
            for name, text in base.files.items():
                (part / COURSE / name).write_bytes(text.encode())
            entries = [_entry(team) for team in course.teams]
            for entry in entries:
                _keep(entry, part)
            _write_plan(part, course, seed, isolation, entries, hides_names=hides_names)
            part.replace(path)
        except OSError as error:
            raise GradeError(f"{shown} cannot be written: {error.strerror or error}") from None
        return cls(path, course, seed, isolation, entries, hides_names=hides_names)

    @classmethod
    def read(cls, path: Path) -> GradeFolder:
        """A grading as it was left. Raises GradeError, ConfigurationError."""
        shown = escape(str(path), 200)
        try:
            fields = json.loads((path / PLAN).read_text("utf-8"))
            if fields.get("format") != FORMAT:
                raise ValueError(f"the format is not {FORMAT}")
            course, entries = _parsed(fields, path)
            folder = cls(
                path,
                course,
                int(fields["seed"]),
                Isolation(fields["isolation"]),
                entries,
                hides_names=fields["hides_names"] is True,
            )
        except (FileNotFoundError, NotADirectoryError):
            raise GradeError(f"{shown} holds no grading: there is no {PLAN}") from None
        except OSError as error:
            raise GradeError(f"{shown} cannot be read: {error.strerror or error}") from None
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            what = (
                f"{escape(str(error), 200)}; it is not what a grading of simmer-tui {__version__} begins with"
            )
            raise GradeError(f"{escape(str(path / PLAN), 200)}: {what}") from None
        folder._read_results()
        return folder

    # -- what is to be done --------------------------------------------------------------------

    @property
    def runs(self) -> Path:
        """Where logs go."""
        return self.path / RUNS

    def verdict(self, entry: Entry) -> Verdict | None:
        """The decision about a team; None while there is none."""
        return self.test.verdict(result.success for result in entry.in_order)

    def counted(self, entry: Entry) -> list[TrialResult]:
        """The results that a team's score is made of: those up to the decision."""
        verdict = self.verdict(entry)
        return entry.in_order[: None if verdict is None else verdict.runs]

    def is_open(self, entry: Entry) -> bool:
        """Whether there is more to be done about a team."""
        return not entry.problems and self.verdict(entry) is None

    def trial(self, entry: Entry, number: int) -> GradeTrial:
        """A run of a team, from 1; it has the same seed and mission for all teams."""
        configuration = entry.check.configuration
        assert configuration is not None, "only teams that are accepted are run"
        course, isolation = self.course, self.isolation
        return GradeTrial(
            number=self.entries.index(entry) * _NUMBERS + number,
            repetition=number,
            seed=_run_seed(self.seed, number),
            configuration=configuration,
            maze="",
            command=entry.team.command,
            fixed_ports=isolation is not Isolation.NONE,
            time_limit=course.limits.time + timed_seconds(configuration),
            drawn_for=self._drawn_for,
            slug=entry.team.slug,
            files=(self.home(entry.team) / PROGRAM).resolve(),
            isolation=isolation,
            limits=course.limits,
            read_only=course.read_only,
            image=course.image,
        )

    def home(self, team: Team) -> Path:
        """A team's folder in the grading."""
        return self.path / TEAMS / team.slug

    def log(self, entry: Entry, number: int) -> Path:
        """The log of a run, if it is kept."""
        return self.runs / entry.team.slug / f"{number:04}{PACKED_LOG}"

    # -- what has been done --------------------------------------------------------------------

    def append(self, result: TrialResult) -> None:
        """Keep the result of a run: on the disk when this returns. Raises GradeError."""
        entry, number = self.entries[result.number // _NUMBERS], result.number % _NUMBERS
        line = {"team": entry.team.name, "attempt": entry.attempt, "result": json.loads(result.line())}
        try:
            with (self.path / RESULTS).open("ab", buffering=0) as file:
                file.write(json.dumps(line, separators=(",", ":")).encode() + b"\n")
                os.fsync(file.fileno())
            self._keep_within_bounds(entry, number)
        except OSError as error:
            where = escape(str(error.filename or self.path), 200)
            raise GradeError(f"{where} cannot be written: {error.strerror or error}") from None
        entry.results[number] = result

    def _keep_within_bounds(self, entry: Entry, number: int) -> None:
        """Logs of a team's failures are kept until its share of the room for them is used up."""
        share = self.course.limits.logs * 1e6 / max(len(self.entries), 1)
        place = self.runs / entry.team.slug
        if place.is_dir() and sum(path.stat().st_size for path in place.iterdir()) > share:
            self.log(entry, number).unlink(missing_ok=True)
            (place / f"{number:04}{OUTPUT}").unlink(missing_ok=True)

    def regrade(self, name: str) -> None:
        """Have a team graded anew, with what it has handed in now. Raises GradeError, ConfigurationError."""
        for entry in self.entries:
            if entry.team.name == name:
                break
        else:
            names = ", ".join(shown_name(entry.team.name, 40) for entry in self.entries)
            raise GradeError(f'there is no team "{shown_name(name)}" in this grading; there are {names}')
        if not entry.team.folder.is_dir():
            raise GradeError(f"{shown_name(str(entry.team.folder), 200)} is not a folder any more")
        team = submitted_team(name, entry.team.folder, self.course.command, entry.team.given)
        entry.team, entry.attempt, entry.refused, entry.results = team, entry.attempt + 1, "", {}
        try:
            for place in (self.home(team), self.runs / team.slug):
                if place.exists():
                    shutil.rmtree(place)
            _keep(entry, self.path)
            self._write_plan()
        except OSError as error:
            raise GradeError(f"{error.filename}: {error.strerror or error}") from None
        self._check_submission(entry)

    def hide_names(self, *, hidden: bool) -> None:
        """Change whether pages have codes in place of names. Raises GradeError."""
        self.hides_names = hidden
        try:
            self._write_plan()
        except OSError as error:
            raise GradeError(f"{error.filename}: {error.strerror or error}") from None

    def _write_plan(self) -> None:
        _write_plan(
            self.path, self.course, self.seed, self.isolation, self.entries, hides_names=self.hides_names
        )

    def _check_submission(self, entry: Entry) -> None:
        if not (entry.refused or entry.team.problems):
            entry.check = check_submission(entry.team, self.home(entry.team), self._base, self.course.rules)

    def _read_results(self) -> None:
        path = self.path / RESULTS
        data = path.read_bytes() if path.exists() else b""
        whole = data[: data.rfind(b"\n") + 1]
        if len(whole) < len(data):  # a line that was cut off is not to begin the next: that run is not done
            os.truncate(path, len(whole))
        entries = {(entry.team.name, entry.attempt): entry for entry in self.entries}
        for number, line in enumerate(whole.decode("utf-8", "replace").splitlines(), 1):
            try:
                fields = json.loads(line)
                result = parse_result(json.dumps(fields["result"]))
                entry = entries.get((fields["team"], fields["attempt"]))
            except (ValueError, KeyError, TypeError, RecursionError) as error:
                where = f"{escape(str(path), 200)}:{number}"
                raise GradeError(
                    f"{where}: {escape(str(error), 200)}; delete the line to run it again"
                ) from None
            if entry is not None:  # else of an earlier attempt
                entry.results.setdefault(result.number % _NUMBERS, result)


def _run_seed(seed: int, number: int) -> int:
    """The seed of a run: 128 bits, since a program that reads a sensor twice could try all of fewer, and
    by HMAC, so that those of runs that were shown tell nothing of the others."""
    return int.from_bytes(hmac.digest(str(seed).encode(), f"seed of run {number}".encode(), "sha256")[16:])


def _base(path: Path) -> Configuration:
    return load(path / COURSE)


def _check(base: Configuration, largest: Configuration) -> None:
    """Raises ConfigurationError if the course's set is none to grade with."""
    problems = []
    if base.mission is None:  # else success would be exit code 0, which doing nothing has too
        problems.append(Problem(mission_toml.FILE, "is missing: success in a grading is to do its mission"))
    if not base.settings.sim:
        problems.append(Problem("sim", "grading is for the simulated robot"))
    problems += [
        Problem("rules.size", f"with a robot as large as allowed: {what}") for what in maze_faults(largest)
    ]
    if problems:
        raise ConfigurationError(problems)


def _entry(team: Team, attempt: int = 1, refused: str = "") -> Entry:
    return Entry(team, attempt, refused, SubmissionCheck(None), {})


def _keep(entry: Entry, path: Path) -> None:
    """Copy what a team has handed in; what cannot be taken is its own problem. Raises OSError."""
    home = path / TEAMS / entry.team.slug
    home.mkdir()
    try:
        keep_files(entry.team, home, _HAND_IN)
    except GradeError as error:
        entry.refused = str(error)


def _write_plan(
    path: Path, course: Course, seed: int, isolation: Isolation, entries: list[Entry], *, hides_names: bool
) -> None:
    """Raises OSError."""
    asked = dataclasses.asdict(replace(course, teams=(), team_folders=()))
    fields = {
        "format": FORMAT,
        "program": __version__,
        "seed": seed,
        "isolation": isolation.value,
        "hides_names": hides_names,
        "course": asked | {"directory": str(course.directory)},
        "teams": [
            dataclasses.asdict(entry.team)
            | {"folder": str(entry.team.folder.resolve()), "attempt": entry.attempt, "refused": entry.refused}
            for entry in entries
        ],
    }
    part = path / f"{PLAN}{_PART}"
    part.write_text(json.dumps(fields, indent=1) + "\n", "utf-8")
    part.chmod(0o600)
    part.replace(path / PLAN)


def _parsed(fields: dict[str, Any], path: Path) -> tuple[Course, list[Entry]]:
    """Raises ValueError, KeyError, TypeError, AttributeError."""
    asked = dict(fields["course"])
    rules = asked["rules"]
    cells = {name: tuple(columns) for name, columns in rules["cells"].items()}
    entries = [
        _entry(
            Team(
                each["name"],
                Path(each["folder"]),
                each["command"],
                each["config"],
                each["given"],
                tuple(Problem(**problem) for problem in each["problems"]),
            ),
            each["attempt"],
            each["refused"],
        )
        for each in fields["teams"]
    ]
    changed = {
        "directory": path / COURSE,
        "limits": Limits(**asked["limits"]),
        "rules": Rules(rules["sensors"], rules["size"], cells),
        "read_only": tuple(asked["read_only"]),
        "teams": tuple(entry.team for entry in entries),
        "team_folders": (),
    }
    return Course(**asked | changed), entries
