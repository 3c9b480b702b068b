"""The folder of a grading; only for the instructor, except site/.

grade.json      what is asked, the secret seed, the teams
course/         the course's configuration set as it was at the beginning
teams/          of each team, its submission and the set it is graded with
results.jsonl   a line a run, appended when it is over
runs/           logs and output of failed runs
grades.csv, junit.xml, gradescope/, site/      the answer
"""

from __future__ import annotations

import hmac
import shutil
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import Annotated

from msgspec import Meta, Struct, structs

from simmer_tui.config import mission_toml
from simmer_tui.config.device_trust import DeviceUse
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.set_sketches import WIRING_FILE
from simmer_tui.errors import ConfigurationError, GradeError, Problem, ProgramError
from simmer_tui.grade.board_build import NEEDS_COMPILER, BoardBuild, BoardCompiler, kept_build
from simmer_tui.grade.board_submission import sketches_to_compile
from simmer_tui.grade.course import (
    LONG,
    PLAN_FILE,
    TEAM_FILE,
    TEAMS_FOLDER,
    USUAL_CONFIGS,
    Course,
    Rules,
    Team,
    shown_name,
    submitted_team,
)
from simmer_tui.grade.grade_run import GradeTrial
from simmer_tui.grade.sandbox import Isolation
from simmer_tui.grade.submission import PROGRAM, SubmissionCheck, check_submission, reference
from simmer_tui.grade.submission_copy import LARGEST_SUBMISSION, copy_submission
from simmer_tui.grade.submission_folder import folder_of_program, take_folder, unpacking_advice
from simmer_tui.grade.submission_reader import SubmissionReader
from simmer_tui.grade.wiring_rules import missing_for_boards
from simmer_tui.program.program_command import words_of
from simmer_tui.sim.noise import SEED_BITS
from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.sketch.sketch_robot import compile_set
from simmer_tui.trials.run import OUTPUT, PACKED_LOG
from simmer_tui.trials.sequential import Decision, SequentialTest, sequential_test
from simmer_tui.trials.store import RunStore, StoreKind, unbroken
from simmer_tui.trials.trial import TrialResult, maze_faults, timed_seconds, with_clock

COURSE, _RUNS = "course", "runs"
_BOARDS = "boards"
"""In a team's folder: its compiled sketches."""
_MOST_NAMED = 5
"""Files of a team that are named as not copied; judged: a linked environment has thousands."""
_CUT_OFF = "were not copied to the end: grade this team again with --regrade"
"""The reason to refuse a team while its files are copied again."""
_NUMBERS = 100_000
"""Numbers of runs reserved for each team: more than the largest cap of a test."""


def number_in_team(result: TrialResult) -> int:
    """The number of a run among those of its team."""
    return result.number % _NUMBERS


class PlannedTeam(Struct, frozen=True):
    """A team as the plan has it. `attempt` counts its gradings, `refused` is the reason why its files were
    not accepted, or empty. `not_copied` says what was left out of its copy, and why."""

    team: Team
    attempt: int = 1
    refused: str = ""
    not_copied: tuple[str, ...] = ()


class GradePlan(Struct, frozen=True, kw_only=True):
    """The teams and the requirements, with the secret seed."""

    seed: Annotated[int, Meta(ge=0)]
    isolation: Isolation
    hides_names: bool
    course: Course
    teams: tuple[PlannedTeam, ...]


class TeamRun(Struct, frozen=True):
    """A line of results.jsonl: the result of a run of a team, and the number of its grading."""

    team: str
    attempt: int
    result: TrialResult


_KIND = StoreKind(
    noun="a grading",
    plan_file=PLAN_FILE,
    folders=(COURSE, TEAMS_FOLDER, _RUNS),
    format=3,
    plan=GradePlan,
    line=TeamRun,
    error=GradeError,
    private=True,
)


@dataclass(slots=True)
class Entry:
    """A team in the grading, with its results by number."""

    planned: PlannedTeam
    check: SubmissionCheck = field(default_factory=lambda: SubmissionCheck(None))
    results: dict[int, TrialResult] = field(default_factory=dict)

    @property
    def team(self) -> Team:
        return self.planned.team

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Reasons why it is not graded, or empty."""
        refused = (Problem("files", self.planned.refused),) if self.planned.refused else ()
        return (*self.team.problems, *refused) or self.check.problems

    @property
    def in_order(self) -> list[TrialResult]:
        """Results from the first run up to one that is not done yet."""
        return unbroken(self.results)


class GradeFolder:
    """An open grading. Make it with `create` or `read`."""

    def __init__(self, path: Path, plan: GradePlan) -> None:
        """Raises ConfigurationError, TrialsError."""
        self.path = path
        self.store = RunStore(path, _KIND)
        self.course = course = replace(plan.course, directory=path / COURSE)
        self.plan = structs.replace(plan, course=course)
        self.entries = [Entry(planned) for planned in plan.teams]
        self.test: SequentialTest = sequential_test(course.require, course.margin, course.risk, course.cap)
        self._base = load(path / COURSE)
        self._drawn_for = reference(self._base, course.rules)
        self._check_submissions(self.entries)

    @classmethod
    def create(
        cls, path: Path, course: Course, seed: int, isolation: Isolation, *, hides_names: bool = False
    ) -> GradeFolder:
        """Begin a grading in a new or empty folder; with `hides_names` pages have codes.
        Raises GradeError, ConfigurationError, TrialsError."""
        sequential_test(course.require, course.margin, course.risk, course.cap)
        base = load(course.directory, devices=DeviceUse.PARSE)
        if base.settings.sensors.devices:
            names = ", ".join(base.settings.sensors.devices)
            raise GradeError(f"a grading runs no devices of a set's own: take {names} out of sensors.devices")
        _check(base, reference(base, course.rules), course.rules)
        store = RunStore(path, _KIND)
        with store.made(), closing(SubmissionReader()) as reader:
            for name in (TEAMS_FOLDER, _RUNS):
                (path / name).mkdir()
            store.write_files(COURSE, base.files)
            plan = GradePlan(
                seed=seed,
                isolation=isolation,
                hides_names=hides_names,
                course=replace(course, teams=(), team_folders=()),
                teams=tuple(_kept(PlannedTeam(team), path, course.command, reader) for team in course.teams),
            )
            folder = cls(path, plan)
            store.write_plan(plan)
        return folder

    @classmethod
    def read(cls, path: Path) -> GradeFolder:
        """An existing grading. Raises GradeError, ConfigurationError, TrialsError."""
        store = RunStore(path, _KIND)
        folder = cls(path, store.read_plan())
        attempts = {(entry.team.name, entry.planned.attempt): entry for entry in folder.entries}
        for _, line in store.lines():
            entry = attempts.get((line.team, line.attempt))
            if entry is not None:  # else of an earlier attempt
                entry.results.setdefault(number_in_team(line.result), line.result)
        return folder

    # -- plan ----------------------------------------------------------------------------------

    @property
    def runs(self) -> Path:
        """Folder of the logs."""
        return self.path / _RUNS

    def decision(self, entry: Entry) -> Decision | None:
        """The decision about a team; None while there is none."""
        return self.test.decision(result.success for result in entry.in_order)

    def counted(self, entry: Entry) -> list[TrialResult]:
        """The results for a team's score: those up to the decision."""
        decision = self.decision(entry)
        return entry.in_order[: None if decision is None else decision.runs]

    def is_open(self, entry: Entry) -> bool:
        """True if a team needs more runs."""
        return not entry.problems and self.decision(entry) is None

    def trial(self, entry: Entry, number: int) -> GradeTrial:
        """A run of a team, from 1; it has the same seed and mission for all teams."""
        configuration = entry.check.configuration
        assert configuration is not None, "only teams that are accepted are run"
        course, isolation = self.course, self.plan.isolation
        return GradeTrial(
            number=self.entries.index(entry) * _NUMBERS + number,
            repetition=number,
            seed=_run_seed(self.plan.seed, number),
            configuration=configuration,
            maze="",
            # Sketches that no board of the course runs are no reason to run nothing.
            command=entry.team.command or ("" if entry.check.sketches is not None else course.command),
            fixed_ports=isolation is not Isolation.NONE,
            time_limit=course.limits.time + timed_seconds(configuration),
            drawn_for=self._drawn_for,
            slug=entry.team.slug,
            files=(self.home(entry.team) / PROGRAM).resolve(),
            isolation=isolation,
            limits=course.limits,
            read_only=course.read_only,
            image=course.image,
            sketches=entry.check.sketches,
        )

    def home(self, team: Team) -> Path:
        """A team's folder in the grading."""
        return self.path / TEAMS_FOLDER / team.slug

    def log(self, entry: Entry, number: int) -> Path:
        """The log of a run, if it is kept."""
        return self.runs / entry.team.slug / f"{number:04}{PACKED_LOG}"

    def output(self, entry: Entry, number: int) -> Path:
        """The output of the program of a run, if it is kept."""
        return self.runs / entry.team.slug / f"{number:04}{OUTPUT}"

    # -- results -------------------------------------------------------------------------------

    def append(self, result: TrialResult) -> None:
        """Write the result of a run, which is on the disk when this returns. Raises GradeError."""
        entry, number = self.entries[result.number // _NUMBERS], number_in_team(result)
        self.store.append(TeamRun(entry.team.name, entry.planned.attempt, result))
        with self.store.reported("written"):
            self._keep_within_bounds(entry, number)
        entry.results[number] = result

    def _keep_within_bounds(self, entry: Entry, number: int) -> None:
        """Keep logs of a team's failures until its share of the space for them is used up."""
        share = self.course.limits.logs * 1e6 / max(len(self.entries), 1)
        place = self.runs / entry.team.slug
        if place.is_dir() and sum(path.stat().st_size for path in place.iterdir()) > share:
            self.log(entry, number).unlink(missing_ok=True)
            self.output(entry, number).unlink(missing_ok=True)

    def regrade(self, name: str) -> None:
        """Grade a team again, with its files as they are now. Raises GradeError, ConfigurationError."""
        entry = next((each for each in self.entries if each.team.name == name), None)
        if entry is None:
            names = ", ".join(shown_name(each.team.name) for each in self.entries)
            raise GradeError(f'there is no team "{shown_name(name)}" in this grading; there are {names}')
        if not entry.team.folder.is_dir():
            raise GradeError(f"{shown_name(str(entry.team.folder), LONG)} is not a folder any more")
        team, attempt = entry.team, entry.planned.attempt + 1
        with self._changing_plan(), self.store.reported("written"), closing(SubmissionReader()) as reader:
            # If the copy is cut off, the earlier results must not count for a part of the new files.
            self._plan_team(entry, PlannedTeam(team, attempt, refused=_CUT_OFF))
            for place in (self.home(team), self.runs / team.slug):
                if place.exists():
                    shutil.rmtree(place)
            kept = _kept(PlannedTeam(team, attempt), self.path, self.course.command, reader)
            self._plan_team(entry, kept)
        self._check_submissions([entry])

    def hide_names(self, *, hidden: bool) -> None:
        """Change whether pages have codes in place of names. Raises GradeError."""
        with self._changing_plan():
            self._write_plan(structs.replace(self.plan, hides_names=hidden))

    @contextmanager
    def _changing_plan(self) -> Generator[None, None, None]:
        """The lock for a change of the plan. Raises GradeError if the plan is not as it was read: the change
        would undo that of another process."""
        with self.store.locked():
            if _changes_of(self.store.read_plan()) != _changes_of(self.plan):
                what = "another simmer-tui has changed this grading meanwhile; try again"
                raise GradeError(f"{self.path}: {what}")
            yield

    def _plan_team(self, entry: Entry, planned: PlannedTeam) -> None:
        """Write the plan with a team's next grading, which has no results yet."""
        entry.planned, entry.results = planned, {}
        self._write_plan(structs.replace(self.plan, teams=tuple(each.planned for each in self.entries)))

    def _write_plan(self, plan: GradePlan) -> None:
        self.store.write_plan(plan)
        self.plan = plan

    def _check_submissions(self, entries: Iterable[Entry]) -> None:
        with closing(SubmissionReader()) as reader:
            for entry in entries:
                if entry.planned.refused or entry.team.problems:
                    continue
                home = self.home(entry.team)
                asked = (entry.team, home, self._base, self.course.rules)
                # A sketch alone is read too, where the course has boards.
                needs_reader = bool(entry.team.config) or WIRING_FILE in self._base.files
                try:
                    check = (
                        reader.call(check_submission, *asked) if needs_reader else check_submission(*asked)
                    )
                except GradeError as error:
                    check = SubmissionCheck(None, (Problem("files", str(error)),))
                if check.configuration is not None and self.course.clock:
                    configuration = with_clock(check.configuration, self.course.clock)
                    check = replace(check, configuration=configuration)
                entry.check = check
        self._compile(entries)

    def _compile(self, entries: Iterable[Entry]) -> None:
        """Compile the sketches of teams with boards, in sandboxes. Raises GradeError if this machine or the
        isolation has none for them, or without a compiler."""
        asked = []
        for entry in entries:
            check, files = entry.check, self.home(entry.team) / PROGRAM
            if check.sketches is None:
                continue
            if self.plan.isolation in (Isolation.DOCKER, Isolation.PODMAN):
                engine = self.plan.isolation.value
                raise GradeError(
                    f"team {entry.team.name} has boards, for which {engine} is no sandbox: "
                    f"grade with --isolation {Isolation.BWRAP}"
                )
            if self.plan.isolation is Isolation.NONE:
                entry.check = _compiled_here(check)
            else:
                goal = self.home(entry.team) / _BOARDS
                sketches = sketches_to_compile(check.sketches.wiring, check.folder, files)
                asked.append((entry, (files.resolve(), goal, sketches)))
        # A grading that is resumed has them, and needs no compiler.
        builds = [kept_build(goal) for _, (_, goal, _) in asked]
        if None in builds:
            builds = [*BoardCompiler(self.course.read_only).build_all([each for _, each in asked])]
        for (entry, _), build in zip(asked, builds, strict=True):
            assert build is not None, "all are compiled"
            entry.check = _with_build(entry.check, build)


def _compiled_here(check: SubmissionCheck) -> SubmissionCheck:
    """A team's boards compiled with the access of this process, for `--isolation none`."""
    assert check.sketches is not None, "it has boards"
    if find_compiler() is None:
        raise GradeError(NEEDS_COMPILER)
    try:
        made = compile_set(check.sketches.wiring, check.folder)
    except ConfigurationError as error:
        return SubmissionCheck(None, error.problems)
    return replace(check, sketches=made)


def _with_build(check: SubmissionCheck, build: BoardBuild) -> SubmissionCheck:
    """A team's boards with their compiled sketches."""
    assert check.sketches is not None, "it has boards"
    if build.problems:
        return SubmissionCheck(None, build.problems)
    return replace(check, sketches=structs.replace(check.sketches, built=build.built))


def _changes_of(plan: GradePlan) -> tuple[bool, list[int]]:
    """The parts of a plan that are changed later."""
    return plan.hides_names, [each.attempt for each in plan.teams]


def _run_seed(seed: int, number: int) -> int:
    """The seed of a run, as long as a seed can be. It is an HMAC: seeds of published runs do not reveal
    others."""
    drawn = hmac.digest(str(seed).encode(), f"seed of run {number}".encode(), "sha256")
    return int.from_bytes(drawn[-(SEED_BITS // 8) :])


def _check(base: Configuration, largest: Configuration, rules: Rules) -> None:
    """Raises ConfigurationError if the course's set cannot be used for grading."""
    problems = []
    if base.mission is None:  # without a mission, success would be exit code 0, which needs no action
        problems.append(Problem(mission_toml.FILE, "is missing: success in a grading is to do its mission"))
    if not base.settings.sim:
        problems.append(Problem("sim", "grading is for the simulated robot"))
    if rules.boards:
        problems += [Problem("boards", what) for what in missing_for_boards(base, rules)]
    problems += [
        Problem("rules.size", f"with a robot as large as allowed: {what}") for what in maze_faults(largest)
    ]
    if problems:
        raise ConfigurationError(problems)


def _kept(planned: PlannedTeam, path: Path, command: str, reader: SubmissionReader) -> PlannedTeam:
    """Copy the files of a team into the grading, and read its team.toml there. Files that cannot be accepted
    are the team's problem. Raises OSError."""
    team = replace(planned.team, folder=planned.team.folder.resolve())
    home = path / TEAMS_FOLDER / team.slug
    home.mkdir()
    refused, left_out = "", dict[str, str]()
    try:
        files = home / PROGRAM
        left_out = copy_submission(team.folder, files, LARGEST_SUBMISSION)
        others = (TEAM_FILE, *([team.config] if team.config else []))
        taken = folder_of_program(files, team.given.get("command", command), others, left_out)
        take_folder(files, taken)
        left_out = {_below(path, taken): reason for path, reason in left_out.items()}
        if (files / TEAM_FILE).exists():
            team = reader.call(submitted_team, team, files, command)
        else:
            team = submitted_team(team, files, command)
        refused = _refusal(team, left_out)
        if not refused and team.command:
            refused = unpacking_advice(files, team.command)
    except GradeError as error:
        refused = str(error)
    not_copied = [f"{path} {reason}" for path, reason in islice(left_out.items(), _MOST_NAMED)]
    if more := len(left_out) - len(not_copied):
        not_copied.append(f"and {more} more")
    return PlannedTeam(team, planned.attempt, refused, tuple(not_copied))


def _below(path: str, folder: PurePosixPath) -> str:
    """A path relative to the folder, if it lies there."""
    whole = PurePosixPath(path)
    return str(whole.relative_to(folder)) if whole.is_relative_to(folder) else path


def _refusal(team: Team, left_out: Mapping[str, str]) -> str:
    """The reason why a file that a team's grading needs, or a folder of it, was not copied; else empty: its
    program, its team.toml and its robot."""
    words: Sequence[str] = ()
    with suppress(ProgramError):  # its runs say so
        words = words_of(team.command)
    robots = (team.config,) if team.config else USUAL_CONFIGS
    wirings = [str(PurePosixPath(each, WIRING_FILE)) for each in (".", *robots)]
    for name in map(PurePosixPath, (*words, TEAM_FILE, *robots, *wirings)):
        for path in map(str, (name, *name.parents)):
            if path in left_out:
                what = "which is not copied: submit a plain file or folder"
                return f"{path} {left_out[path]}, {what}"
    return ""
