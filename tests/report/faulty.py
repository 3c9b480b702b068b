"""Missions done in this process by the sample that does them all, with a fault put into it.

A fault is laid upon what the sample's parts have in common whatever their insides: the robot it
drives, the configuration it is given, where it takes itself to be. So a better sample stays testable.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from msgspec.structs import replace

from simmer_tui.config.loader import Configuration, find_set, load
from simmer_tui.report.cause_order import cause_of
from simmer_tui.report.causes import Cause, Kind
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.robot.engine import Engine
from simmer_tui.run.attempt import Attempt, task_of
from simmer_tui.run.events import Belief, OutputLine, ProgramEnded
from simmer_tui.run.mission import MissionPlan, Referee, plan_run
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.state import checkpoint_of
from simmer_tui.sim import Pose, RobotSpec, Simulator, parse_command

SCRIPTS = Path(__file__).parents[2] / "scripts"
PARTS = ("solve_ground", "solve_beliefs", "solve_pilot", "solve")
MOST_DRIVES = 600
"""A program that has driven so often gets nowhere; its time would be over some day."""


@contextlib.contextmanager
def sample() -> Iterator[dict[str, ModuleType]]:
    """The sample's modules, fresh, and gone again afterwards."""
    path = list(sys.path)
    sys.path.insert(0, str(SCRIPTS))
    try:
        yield {name: importlib.import_module(name) for name in PARTS}
    finally:
        sys.path[:] = path
        for name in PARTS:
            sys.modules.pop(name, None)


class OverError(Exception):
    """The referee has ended the mission."""


class FaultyRobot:
    """A robot in this process, with a referee and someone who takes note."""

    def __init__(self, configuration: Configuration, plan: MissionPlan, seed: int) -> None:
        self.simulator = Simulator(configuration.simulation, seed)
        self.engine = Engine(self.simulator)
        self.history = RunHistory(checkpoint_of(self.simulator, mission=True))
        self.task = task_of(configuration, seed, plan)
        reducer = Reducer(checkpoint_of(self.simulator, mission=True), history=self.history)
        self.engine.watch(reducer.apply)
        self.referee = Referee(plan, reducer, self.engine.tell)
        self.engine.watch(self.referee.watch)
        self._session = self.engine.session()
        self.drives = 0
        self.repeats = 1
        self.ignored: Callable[[str], bool] = lambda code: False
        self._cached: dict[str, float] = {}

    def read(self, code: str) -> float:
        if not (self.ignored(code) and code in self._cached):
            for _ in range(self.repeats):
                before = self.simulator.time
                self._cached[code] = self._ask(code)
                if self.simulator.time == before:
                    self.simulator.advance(before + self.simulator.sensor(code).read_time)
        return self._cached[code]

    def _ask(self, text: str) -> float:
        replies: list[float] = []
        self._session.submit(parse_command(text), lambda outcome: replies.append(outcome.reply))
        if self.referee.state().over:
            raise OverError
        return replies[0]

    def drive(self, code: str, value: float) -> None:
        self.drives += 1
        if self.drives > MOST_DRIVES:
            raise OverError
        self._ask(f"{code}-{value!r}")

    def believe(
        self, x: float, y: float, heading: float, spread: Any = None, particles: Any = None, *rest: object
    ) -> None:
        told = tuple(tuple(float(each) for each in particle) for particle in particles)
        belief = Belief(self.simulator.time, Pose(x, y, heading), self.simulator.pose, spread, told)
        self.engine.tell(belief)


@dataclass
class Setting:
    """The parts of a run that a fault may change before the mission begins."""

    parts: dict[str, ModuleType]
    robot: FaultyRobot
    mission: Any
    drop_zone: Any

    @property
    def carrying(self) -> bool:
        return self.robot.simulator.holding


def nothing(setting: Setting) -> None:
    """The sample as it is."""


def turned_heading(setting: Setting) -> None:
    """After some turning it takes itself to head 25 degrees further to the left."""
    kind = type(setting.mission.localizer)
    pose, robot = kind.pose, setting.robot
    setting.mission.localizer.__class__ = type(
        "Turned",
        (kind,),
        {"pose": property(lambda self: pose.fget(self) + np.array((0.0, 0.0, 25.0 * (robot.drives > 40))))},
    )


def closed_early(setting: Setting) -> None:
    """It closes the gripper too early: its window is 3 in long."""
    setting.mission.grip += 2.2


def closed_late(setting: Setting) -> None:
    """It does not slow down for the block, and runs over it."""
    setting.mission.grip -= 2.8


def small_robot(setting: Setting) -> None:
    """It takes the robot for half as wide as it is, and cuts the corners."""
    ground = setting.mission.ground
    kind = type(ground)
    route = kind.route

    def cut(self: Any, *arguments: Any) -> Any:
        way = route(self, *arguments)
        return [cell for at, cell in enumerate(way) if at == len(way) - 1 or at % 3 == 2] if way else way

    ground.__class__ = type("Cutting", (kind,), {"route": cut})


def frozen(setting: Setting) -> None:
    """From some moment on it takes itself to stay where it is."""
    localizer, robot = setting.mission.localizer, setting.robot
    kind = type(localizer)

    def unless_frozen(name: str) -> Callable[..., None]:
        def do(self: Any, *arguments: Any) -> None:
            if robot.drives < 60:
                getattr(kind, name)(self, *arguments)

        return do

    names = ("predict", "update")
    localizer.__class__ = type("Frozen", (kind,), {name: unless_frozen(name) for name in names})


def ignoring(setting: Setting) -> None:
    """From some moment on it looks no more: what its range sensors said last must do."""
    robot = setting.robot
    codes = {each.code for each in robot.simulator.spec.sensors if each.kind.is_range}
    robot.ignored = lambda code: code in codes and robot.drives > 60


def other_zone(setting: Setting) -> None:
    """It carries the block to another free cell."""
    plan = setting.robot.referee.plan
    cells = [
        centre for centre in _cells(setting) if math.dist(centre, (plan.drop_zone.x, plan.drop_zone.y)) > 13
    ]
    setting.drop_zone = np.array(
        min(cells, key=lambda each: math.dist(each, (plan.drop_zone.x, plan.drop_zone.y)))
    )


def _cells(setting: Setting) -> list[tuple[float, float]]:
    centre = setting.parts["solve_ground"].centre
    return [tuple(centre(cell).tolist()) for cell in setting.mission.ground.cells()]


def reading_on(setting: Setting) -> None:
    """It reads ten times too often."""
    setting.robot.repeats = 10


@dataclass(frozen=True)
class Fault:
    """A fault, what it may rightly be laid to (who is lost may have driven unseeing, too), words that its
    text has in any case, and how long a reading takes (seconds)."""

    put: Callable[[Setting], None]
    kinds: frozenset[Kind]
    read_time: float = 0.0
    small: bool = False
    says: str = ""


FAULTS = {
    "clean": Fault(nothing, frozenset()),
    "heading offset": Fault(turned_heading, frozenset({Kind.LOST})),
    "closed early": Fault(closed_early, frozenset({Kind.MISSED_GRIP})),
    "no slowing": Fault(closed_late, frozenset({Kind.MISSED_GRIP})),
    "clearance": Fault(small_robot, frozenset({Kind.TOO_CLOSE, Kind.KNOWN_WALL}), small=True),
    "frozen belief": Fault(frozen, frozenset({Kind.LOST})),
    "ignored sensors": Fault(
        ignoring, frozenset({Kind.UNREAD, Kind.LOST}), says="no range sensor was read after that"
    ),
    "other drop zone": Fault(other_zone, frozenset({Kind.DROPPED_OUTSIDE})),
    "reading too often": Fault(reading_on, frozenset({Kind.TOO_SLOW}), read_time=0.1),
}


def fly(parts: dict[str, ModuleType], fault: Fault, seed: int) -> tuple[bool, Cause | None]:
    """One run with a fault: whether it succeeded all the same, and why it failed."""
    configuration = load(find_set("mission"))
    if fault.read_time:
        simulation = configuration.simulation
        slow = tuple(replace(each, read_time=fault.read_time) for each in simulation.sensors)
        configuration = replace(configuration, simulation=replace(simulation, sensors=slow))
    planned, plan = plan_run(configuration, seed)
    robot = FaultyRobot(planned, plan, seed)
    known = configuration.simulation
    mission = parts["solve"].Mission(robot, known, np.random.default_rng(seed))
    if fault.small:
        grip = mission.grip
        half = replace(known, robot=_halved(known.robot))
        mission = parts["solve"].Mission(robot, half, np.random.default_rng(seed))
        mission.grip = grip
    setting = Setting(parts, robot, mission, np.array((plan.drop_zone.x, plan.drop_zone.y)))
    fault.put(setting)
    code, words = None, ""
    with contextlib.redirect_stdout(io.StringIO()) as said:
        with contextlib.suppress(OverError):
            code = 0 if mission.run(setting.drop_zone) else 1
        words = next((line for line in reversed(said.getvalue().splitlines()) if line.strip()), "")
    if not robot.referee.state().over:
        reason = f"the program ended with exit code {code}" if code is not None else "the wall limit"
        robot.referee.end(reason)
    program = None if code is None else ProgramEnded(0.0, code, stdout=(OutputLine(0.0, words),))
    if robot.referee.state().result.value == "success":
        return True, None
    cut_off = code is None and robot.drives > MOST_DRIVES
    return False, cause_of(RunEvidence(Attempt(robot.history, robot.task), program, cut_off=cut_off))


def _halved(robot: RobotSpec) -> RobotSpec:
    if robot.radius is not None:
        return replace(robot, radius=robot.radius / 2)
    return replace(robot, vertices=tuple((x / 2, y / 2) for x, y in robot.vertices))
