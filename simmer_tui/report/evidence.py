"""What a run leaves behind that can say why it failed, gathered event by event in bounded memory."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from simmer_tui.config.loader import Configuration
from simmer_tui.config.mission_plan import Cell, MissionPlan, draw_mission
from simmer_tui.events import (
    ActionDone,
    ActionName,
    Belief,
    CommandResult,
    Event,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Result,
)
from simmer_tui.run.facts import Deviation, LastWord, deviation, is_unsure
from simmer_tui.run.state import Checkpoint
from simmer_tui.sim import noise
from simmer_tui.sim.block import Block
from simmer_tui.sim.gripper import in_robot_frame
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import Grip
from simmer_tui.sim.specs import CELL_SIZE, Axes, DriveKind

ROOM = CELL_SIZE / 2
"""A robot that keeps within this of a place, inches, stays there."""


@dataclass(frozen=True, slots=True)
class Task:
    """What a mission allows, and the cell the block is to go to, None if that is not known."""

    contacts: int | None
    time_limit: float
    zone: Cell | None


def task_of(configuration: Configuration, seed: int, plan: MissionPlan | None = None) -> Task | None:
    """The task of a run with a mission under way; None if the configuration has no mission. Without a
    `plan`, as in a log, it is drawn again from the run's seed."""
    if plan is not None:
        return Task(plan.contacts, plan.time_limit, plan.drop_zone)
    mission, settings = configuration.mission, configuration.settings
    if mission is None:
        return None
    drawn = draw_mission(mission, configuration.simulation, seed)
    same = (drawn.start.x, drawn.start.y) == settings.bot_center and drawn.block == settings.block_center
    return Task(mission.contacts, mission.time_limit, drawn.drop_zone if same else None)


@dataclass(frozen=True, slots=True)
class Told:
    """A belief: when it was told (seconds; in which line of the log, 0 if there is none), how far it was
    off, and how far the robot had gone by then, in all."""

    elapsed: float
    line: int
    belief: Belief
    deviation: Deviation
    gone: float

    @property
    def unsure(self) -> bool:
        return is_unsure(self.belief)


@dataclass(frozen=True, slots=True)
class Collision:
    """A movement that met something, and all that was known when it began: the belief then, since when
    (`lost`) beliefs had been wrong, the sensors' last words, the block that was held (in the robot's
    frame) and the one that lay about, the bias and whether there was noise."""

    elapsed: float
    line: int
    ended: MovementEnded
    told: Told | None
    lost: Told | None
    words: Mapping[str, LastWord]
    held: Block | None
    lying: Block
    bias: Mapping[DriveKind, Axes]
    gone: float
    turned: float


@dataclass(frozen=True, slots=True)
class Gripped:
    """What the gripper did, when, and whether it held the block before."""

    elapsed: float
    line: int
    grip: Grip
    had: bool


@dataclass(slots=True)
class Stay:
    """The latest stretch in which the robot kept around one place: since when, with how many movements,
    inches and seconds of driving."""

    place: Pose
    since: float
    line: int
    movements: int = 0
    driven: float = 0.0
    driving: float = 0.0


@dataclass(slots=True)
class Spent:
    """Where the time went, simulated seconds; `between` is the real time from an answer to the next
    command: the program's thinking, and the link."""

    driving: float = 0.0
    reading: float = 0.0
    link: float = 0.0
    between: float = 0.0
    readings: Counter[str] = field(default_factory=Counter)


class Evidence:
    """Feed it all events in order. It takes no more after the end of a mission, and begins anew when the
    run does."""

    def __init__(
        self,
        configuration: Configuration,
        beginning: Checkpoint,
        bias: Mapping[DriveKind, Axes],
        plan: MissionPlan | None = None,
    ) -> None:
        """`beginning` is how the run stands, `bias` the drives' bias in force."""
        self.spec = configuration.simulation
        self.task = (
            task_of(configuration, beginning.seed, plan)
            if beginning.mission is not None or plan is not None
            else None
        )
        self._seed = beginning.seed
        self._start, self._start_block = beginning.start, beginning.start_block
        self._bias = dict(bias)
        self._begin(beginning.pose, beginning.block, beginning.holding, beginning.time)

    def _begin(self, pose: Pose, block: Block, holding: bool, elapsed: float) -> None:
        self.over: MissionEvent | None = None
        self.commands = 0
        self.contacts = 0
        self.collision: Collision | None = None
        """The last one."""
        self.blocked = 0
        """How many of the last movements, in a row, ended at a wall."""
        self.blocked_since = elapsed
        self.told: Told | None = None
        self.lost: Told | None = None
        """The first of the wrong beliefs that lead without a gap to the last one."""
        self.missed: Gripped | None = None
        """The last grip that took nothing, and how many there were."""
        self.misses = 0
        self.taken = False
        self.put_down: Gripped | None = None
        self.holding = holding
        self.spent = Spent()
        self.elapsed = self.begun = elapsed
        self.line = 0
        self.stay = Stay(pose, elapsed, 0)
        self._pose = pose
        self._block = block
        self._held = in_robot_frame(block, pose) if holding else None
        self._words: dict[str, LastWord] = {}
        self._gone = self._turned = 0.0
        self._answered: float | None = None

    def add(
        self, event: Event, elapsed: float | None = None, line: int = 0, wall: float | None = None
    ) -> None:
        """Take note of an event at a time (by default its own; seconds that go on through resets, if there
        are any), from a line of a log, told at a moment of real time (seconds)."""
        if elapsed is None:
            elapsed = getattr(event, "time", self.elapsed)
        if isinstance(event, ActionDone) and not event.refused:
            self._take_action(event, elapsed)
        if self.over is not None:
            return
        self.elapsed, self.line = elapsed, line or self.line
        match event:
            case CommandResult():
                self._take_outcome(event, elapsed)
                self._take_wall(wall)
            case MovementPlanned():
                if event.grip is not None:
                    self._take_grip(event.grip, elapsed, line)
            case MovementEnded():
                self._take_end(event, elapsed, line)
                if not event.answers:
                    self._take_wall(wall)
            case Belief():
                self._take_belief(event, elapsed, line)
            case MissionEvent():
                if event.over:
                    self.over = event

    @property
    def blind_for(self) -> tuple[float, float]:
        """How far the robot has gone (inches) and turned (degrees) since a range sensor was read."""
        ranges = {each.code for each in self.spec.sensors if each.kind.is_range}
        last = [word for code, word in self._words.items() if code in ranges]
        gone, turned = (
            (max(each.gone for each in last), max(each.turned for each in last)) if last else (0.0, 0.0)
        )
        return self._gone - gone, self._turned - turned

    @property
    def failed(self) -> bool:
        return self.over is not None and self.over.subject is Result.FAILED

    @property
    def too_many_contacts(self) -> bool:
        """Whether a mission ended by contacts."""
        return self.task is not None and self.task.contacts is not None and self.contacts > self.task.contacts

    @property
    def out_of_time(self) -> bool:
        """Whether a mission ended by its time limit."""
        return self.task is not None and self.over is not None and self.over.time >= self.task.time_limit

    # -- within --------------------------------------------------------------------------------

    def _take_wall(self, wall: float | None) -> None:
        if wall is None:
            return
        if self._answered is not None:
            self.spent.between += max(wall - self._answered, 0.0)
        self._answered = wall

    def _take_outcome(self, outcome: CommandResult, elapsed: float) -> None:
        self.commands += 1
        self.spent.link += outcome.link
        reading = outcome.reading
        if reading is None:
            return
        sensor = reading.sensor
        self.spent.reading += reading.took or sensor.read_time
        self.spent.readings[sensor.code] += 1
        self._words[sensor.code] = LastWord(
            sensor.code, reading.value, reading.true, elapsed, self._gone, self._turned
        )

    def _take_end(self, ended: MovementEnded, elapsed: float, line: int) -> None:
        trajectory, contact, before = ended.trajectory, ended.contact, ended.before
        took = max(ended.time - trajectory.start_time, 0.0)
        self.spent.driving += took
        if contact is not None:
            at = elapsed - max(ended.time - contact.time, 0.0)
            self.contacts += 1
            self.collision = Collision(
                at, line, ended, self.told, self.lost, dict(self._words), self._held, self._block,
                dict(self._bias), self._gone, self._turned,
            )  # fmt: skip
        if contact is not None and contact.ended:
            self.blocked += 1
            self.blocked_since = elapsed if self.blocked == 1 else self.blocked_since
        elif ended.grip is None:
            self.blocked = 0
        pose, went = trajectory.arrival(ended.time)
        self._pose = pose
        self._gone += went
        self._turned += abs(pose.heading - before.heading)
        stay = self.stay
        if math.hypot(pose.x - stay.place.x, pose.y - stay.place.y) > ROOM:
            self.stay = Stay(pose, elapsed, line)
        else:
            stay.movements += 1
            stay.driven += went
            stay.driving += took

    def _take_grip(self, grip: Grip, elapsed: float, line: int) -> None:
        had, self.holding = self.holding, grip.holding
        self._block = Block(grip.block.x, grip.block.y, self._block.size, grip.block.heading)
        self._held = in_robot_frame(self._block, self._pose) if grip.holding else None
        done = Gripped(elapsed, line, grip, had)
        if grip.holding:
            self.taken = True
            self.put_down = None
        elif grip.closed and not had:
            self.missed, self.misses = done, self.misses + 1
        elif had:
            self.put_down = done

    def _take_belief(self, belief: Belief, elapsed: float, line: int) -> None:
        off = deviation(belief)
        if not (math.isfinite(off.distance) and math.isfinite(off.turn)):
            return
        self.told = Told(elapsed, line, belief, off, self._gone)
        if not off.wrong:
            self.lost = None
        elif self.lost is None:
            self.lost = self.told

    def _take_action(self, done: ActionDone, elapsed: float) -> None:
        action = done.action
        match action.name:
            case ActionName.RESET | ActionName.SEED:
                self._seed = int(action.arguments[0]) if action.arguments else self._seed
                spec = self.spec
                if spec.randbias:
                    self._bias = noise.random_bias(self._seed, spec.strength)
                else:
                    self._bias = {drive.kind: drive.bias for drive in spec.drives}
                self._begin(done.pose, self._start_block, False, elapsed)
            case ActionName.TELEPORT:
                self._pose = done.pose
                self._words.clear()
                self.told = self.lost = None
                self.stay = Stay(done.pose, elapsed, self.line)
                self.blocked = 0
            case ActionName.BLOCK:
                self._block, self._held, self.holding = (
                    Block(action.arguments[0], action.arguments[1], self._block.size), None, False,
                )  # fmt: skip
            case ActionName.BIAS:
                random = bool(action.arguments[0])
                spec = self.spec
                self._bias = (
                    noise.random_bias(self._seed, spec.strength)
                    if random
                    else {drive.kind: drive.bias for drive in spec.drives}
                )
