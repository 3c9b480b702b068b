"""One run of a set of trials: its plan, its clock and its result."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from msgspec import Meta, Struct
from msgspec.structs import replace

from simmer_tui.config import maze_csv
from simmer_tui.config.dialects import TEAM
from simmer_tui.config.loader import Configuration
from simmer_tui.config.mission_plan import MissionPlan, mission_problems
from simmer_tui.config.settings import AUTO_CLOCK, ELSE_REAL, with_any_ports
from simmer_tui.document.model import Tone
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.run.mission import MissionRule, plan_run, planned
from simmer_tui.run.phrases import NOTHING_SENT, computing_text
from simmer_tui.sim.command import counted
from simmer_tui.sim.obstacles import placement_problems
from simmer_tui.sim.specs import MazeSpec
from simmer_tui.trials.mazes import maze_text, random_maze

if TYPE_CHECKING:
    from simmer_tui.sketch.sketch_robot import SketchSet

RANDOM = "random"
"""The name of a maze made for a run."""
REAL = "real"
"""The real clock, and `timed` motion by it."""
# Judged: many times what a program needs for a mission in simulated time.
TIME_LIMIT = 120.0
"""Default limit of the real time of a run, seconds, without that of a mission in timed motion."""
# A stream apart from those of drives and sensors, so that a maze changes none of their errors.
_MAZE_STREAM = tuple(b"maze")
# Mazes tried: a mission that fits into hardly any maze is refused rather than searched for without end.
_TRIES = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One run. `configuration` has the maze already, unless one is to be made at random. In a sweep
    `repetition` is its number among the runs of its value; 0 represents the run's number. With `drawn_for`
    the mission is drawn as for that configuration, so that different robots have the same one. With
    `errors_seed` sensors and drives draw their errors by it; mission and maze stay those of `seed`. With
    `tells_start` the program is given its start pose. With `sketches` boards drive the robot, and `command`
    may be empty; the configuration is that of `driven_by_boards`."""

    number: int
    repetition: int = 0
    seed: int
    configuration: Configuration
    maze: str
    command: str
    fixed_ports: bool
    time_limit: float
    drawn_for: Configuration | None = None
    errors_seed: int | None = None
    tells_start: bool = False
    sketches: SketchSet | None = None

    @property
    def name(self) -> str:
        """Name of its files, without an ending."""
        return f"{self.number:04}"

    @property
    def label(self) -> str:
        """Name of the run for people."""
        return f"run {self.number}"

    @property
    def longest(self) -> float:
        """Largest real time that it may take, seconds: twice its limit if it may be repeated."""
        may_repeat = self.configuration.settings.motion.clock == ELSE_REAL
        return self.time_limit * (2 if may_repeat else 1)


def run_seed(seed: int, number: int) -> int:
    """The seed of a run, derived from that of all of them: 32 bits of a child of its `SeedSequence`."""
    return int(np.random.SeedSequence(seed, spawn_key=(number,)).generate_state(1)[0])


def with_maze(configuration: Configuration, maze: MazeSpec) -> Configuration:
    """The configuration with another maze; a floor of its own is kept if it has the right size."""
    old = configuration.simulation.maze
    files = dict(configuration.files) | {maze_csv.FILE: maze_text(maze)}
    if (old.rows, old.columns) == (maze.rows, maze.columns):
        maze = replace(maze, floor=old.floor)
    else:
        maze = replace(maze, floor=None)
        files.pop(maze_csv.FLOOR_FILE, None)
    return replace(configuration, simulation=replace(configuration.simulation, maze=maze), files=files)


def maze_faults(configuration: Configuration) -> list[str]:
    """Reasons why robot, block or mission do not fit into a configuration's maze."""
    simulation, mission = configuration.simulation, configuration.mission
    if mission is not None:
        return [what for _, what in mission_problems(mission, simulation)]
    return [f"{name}: {what}" for name, what in placement_problems(simulation)]


def maze_of(trial: Trial) -> Configuration:
    """The configuration with the run's maze. Raises ConfigurationError."""
    if trial.maze != RANDOM:
        return trial.configuration
    random = np.random.default_rng(np.random.SeedSequence(trial.seed, spawn_key=_MAZE_STREAM))
    like = trial.configuration.simulation.maze
    for _ in range(_TRIES):
        made = with_maze(trial.configuration, random_maze(like, random))
        if not maze_faults(made):
            return made
    faults = "; ".join(maze_faults(made))
    raise ConfigurationError([Problem("--random-mazes", f"no maze was found that fits: {faults}")])


def prepare(trial: Trial) -> tuple[Configuration, MissionPlan | None]:
    """The configuration of a run, with its maze, seed and ports, and its mission plan: None without a
    mission.toml. Raises ConfigurationError."""
    configuration = maze_of(trial)
    plan = None
    if trial.drawn_for is not None:
        _, plan = plan_run(trial.drawn_for, trial.seed)
        configuration = planned(configuration, plan, trial.seed)
    elif configuration.mission is not None:
        configuration, plan = plan_run(configuration, trial.seed)
    if plan is not None and trial.tells_start:
        plan = replace(plan, start_known=True)
    errors = trial.seed if trial.errors_seed is None else trial.errors_seed
    settings = replace(configuration.settings, randerror=False, seed=errors)
    if not trial.fixed_ports:
        settings = with_any_ports(settings)
    return replace(configuration, settings=settings), plan


def run_clock(configuration: Configuration) -> str:
    """The clock for the runs of a set: a choice of the setting `clock`, but not `auto`."""
    clock = configuration.settings.motion.clock
    if clock != AUTO_CLOCK:
        return clock
    return "program" if TEAM in configuration.settings.server.listeners else REAL


def driven_by_boards(configuration: Configuration) -> Configuration:
    """The same set for runs in which boards drive the robot. Clock `auto` is the program's, by which runs
    repeat exactly."""
    from simmer_tui.sketch.sketch_robot import with_boards

    made = with_boards(configuration)
    return with_clock(made, "program") if made.settings.motion.clock == AUTO_CLOCK else made


def with_clock(configuration: Configuration, clock: str) -> Configuration:
    """The same set, with a clock."""
    return configuration.with_settings({"motion.clock": clock})


def timing_of(configuration: Configuration) -> str:
    """The clock of the runs of a set, as `MotionSettings.timing` has it."""
    return with_clock(configuration, run_clock(configuration)).settings.motion.timing


def timed_seconds(configuration: Configuration) -> float:
    """Real time of a mission by its time limit, seconds: 0 unless its runs may use the real clock."""
    motion, mission = configuration.settings.motion, configuration.mission
    by_real_clock = timing_of(configuration) == "timed" or run_clock(configuration) == ELSE_REAL
    if not by_real_clock or mission is None:
        return 0.0
    return mission.time_limit / motion.time_scale


class Ending(StrEnum):
    """Ending of a run."""

    words: str
    """Words for it after the number of runs."""
    tone: Tone

    def __new__(cls, value: str, words: str = "", tone: Tone = Tone.PLAIN) -> Self:
        """A member with its row of the table below."""
        ending = str.__new__(cls, value)
        ending._value_, ending.words, ending.tone = value, words, tone
        return ending

    SUCCESS = "success", "succeeded", Tone.GOOD
    CONTACTS = MissionRule.CONTACTS.value, "touched a wall", Tone.BAD
    TIME_LIMIT = MissionRule.TIME_LIMIT.value, "ran out of time", Tone.MIXED
    EXIT = "program ended", "ended before the goal"
    BOARDS = "board ended", "lost a board"
    """A board died or hung."""
    SILENCE = NOTHING_SENT, "sent no command"
    """The program ended with exit code 0 without sending a command."""
    REAL_TIME_LIMIT = "real time limit", "ran out of real time", Tone.MIXED
    FAULT = "fault", "had a fault of the simulator"
    """The simulator itself, or its process, failed."""


class TrialResult(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Result of one run: its start, end, time and distance. Also a line of results.jsonl.

    `time` is simulated seconds, `distance` inches, `start` and `end` are the robot's x, y and
    heading, `block` and `drop_zone` are x, y. `reached`, `taken` and `delivered` are when the
    mission's goals were met. `exit_code` is None if the program did not end by itself. `verdict` is that of
    `report --json`, without the program's output, and `last_moments`; `findings` are the sensors and drives
    that were not as they should be, as it has them too, also for a success. `clock` is the
    source of simulated time: `program`, `real`, or `instant` for commands alone. `clock_note` is the reason
    why the program's clock was not used. `real_seconds` and `simulator_seconds` (CPU) depend on the machine,
    all else on the seed.
    """

    number: Annotated[int, Meta(ge=1)]
    seed: int
    maze: str
    success: bool = False
    ending: Ending = Ending.FAULT
    reason: str
    exit_code: int | None = None
    time: float = 0.0
    distance: float = 0.0
    commands: int = 0
    contacts: int = 0
    contact_points: tuple[tuple[float, float], ...] = ()
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    block: tuple[float, float]
    drop_zone: tuple[float, float] | None = None
    reached: float | None = None
    taken: float | None = None
    delivered: float | None = None
    last_output: str = ""
    verdict: dict[str, Any] = {}
    findings: tuple[dict[str, Any], ...] = ()
    clock: str = ""
    clock_note: str = ""
    real_seconds: float = 0.0
    simulator_seconds: float = 0.0

    @property
    def cause(self) -> str:
        """Cause of a failure (`report.causes.Kind`); empty for a success."""
        return str((self.verdict.get("cause") or {}).get("kind", ""))

    @property
    def why(self) -> str:
        """The last two moments of a failure, in a line; empty for a success."""
        return str(self.verdict.get("last_moments") or "") if self.cause else ""

    @property
    def sent_nothing(self) -> bool:
        """True if no command came; such a run is no success."""
        return not self.commands


def clocks_text(results: Sequence[TrialResult]) -> str | None:
    """The clocks of some runs, with their counts if there are several; None if no run has one."""
    counts = Counter(result.clock for result in results if result.clock)
    if len(counts) < 2:
        return next(iter(counts), None)
    return ", ".join(f"{clock} ({count})" for clock, count in sorted(counts.items()))


def clock_sentences(configuration: Configuration, results: Sequence[TrialResult]) -> list[str]:
    """Sentences about the clocks of the runs, and why some had another than planned."""
    timings = {REAL: "timed"}
    clocks = sorted({timings.get(each.clock, each.clock) for each in results if each.clock})
    said = [computing_text(each) for each in clocks or [timing_of(configuration)]]
    notes = Counter((each.clock, each.clock_note) for each in results if each.clock_note)
    for (clock, note), count in notes.items():
        runs = counted(count, "run")
        if clock == REAL:
            said.append(f"{runs} went by the real clock: {note}.")
        else:
            said.append(
                f"{runs} ended where the program's clock cannot follow: {note}. Use --clock real, or "
                f'clock = "{ELSE_REAL}", which repeats such runs.'
            )
    return said
