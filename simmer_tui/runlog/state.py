"""How things stood at a moment of a logged run, found by looking back from there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from simmer_tui.actions import ActionName
from simmer_tui.runlog.entries import (
    ActionEntry,
    BeliefEntry,
    BrokenEntry,
    CommandEntry,
    Entry,
    NoticeEntry,
    TwinEntry,
)
from simmer_tui.runlog.header import Header
from simmer_tui.runlog.scan import Mark
from simmer_tui.sim.angles import cos_sin
from simmer_tui.sim.records import Pose, Status

LOOK_BACK = 400
"""Lines looked back for readings and for the trail."""
LOOK_AHEAD = 64
"""Lines looked ahead for the movement under way: it is logged when it ends."""
CONTACTS = 50
"""Most contacts shown."""
ACTIONS = 200
"""Actions looked back for the place of the block."""
_ENDING = (ActionName.STOP, ActionName.TELEPORT, ActionName.RESET, ActionName.SEED)

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class RunState:
    """How things stood: what a screen shows of a moment.

    `entry` is the latest one (None before the first), `elapsed` the simulated time since the log's
    beginning, `pose` the robot's and `moving` whether a movement was under way. `block` is where the
    block was, `holding` whether the gripper held it. `readings` holds the latest of each sensor, by
    ID, `trail` the centres lately gone through, `contacts` the latest movements that met a wall.
    What was before the run last began anew is left out.
    """

    entry: Entry | None
    elapsed: float
    pose: Pose
    moving: bool
    block: Pose
    holding: bool
    readings: Mapping[str, CommandEntry]
    belief: BeliefEntry | None
    trail: tuple[Point, ...]
    contacts: tuple[CommandEntry, ...]


class Log(Protocol):
    """What is needed of an index."""

    @property
    def header(self) -> Header: ...
    @property
    def count(self) -> int: ...
    def entry(self, i: int) -> Entry: ...
    def zero_of(self, i: int) -> float: ...
    def find_previous(self, i: int, marks: Mark) -> int | None: ...


def ends_movement(entry: Entry, movement: CommandEntry) -> bool:
    """Whether a movement that was merely accepted is over when `entry` happens."""
    match entry:
        case BrokenEntry():
            return False
        case ActionEntry() if entry.action in _ENDING and not entry.refused:
            return True
        case CommandEntry() if entry.status is Status.STOPPED or entry.number == movement.number:
            return True
    return entry.t >= movement.end


def state_at(log: Log, i: int, elapsed: float) -> RunState:
    """How things stood `elapsed` seconds into a log, entry i being the latest till then."""
    restart = log.find_previous(i + 1, Mark.RESTART)
    first = restart or 0
    time = elapsed - log.zero_of(i)
    walk = _Walk(_pose_before(log, max(first, i + 1 - LOOK_BACK), first))
    for k in range(max(first, i + 1 - LOOK_BACK), i + 1):
        walk.take(log.entry(k))
    moving = walk.under_way is not None and time < walk.under_way.end
    if walk.under_way is not None:
        walk.follow(walk.under_way, time)
    else:
        movement = _under_way(log, i, time)
        if movement is not None:
            moving = True
            walk.follow(movement, time)
    block, holding = _block(log, i, restart, walk.pose)
    return RunState(
        entry=log.entry(i) if i >= 0 else None,
        elapsed=elapsed,
        pose=walk.pose,
        moving=moving,
        block=block,
        holding=holding,
        readings=walk.readings,
        belief=_belief(log, i, first),
        trail=tuple(walk.trail),
        contacts=_contacts(log, i, first, time),
    )


class _Walk:
    """Goes through entries in order and keeps what they say."""

    def __init__(self, pose: Pose) -> None:
        self.pose = pose
        self.under_way: CommandEntry | None = None
        self.readings: dict[str, CommandEntry] = {}
        self.trail: list[Point] = []

    def take(self, entry: Entry) -> None:
        if isinstance(entry, BrokenEntry | NoticeEntry | TwinEntry):
            return
        if self.under_way is not None and ends_movement(entry, self.under_way):
            if not (isinstance(entry, CommandEntry) and entry.number == self.under_way.number):
                self.follow(self.under_way, entry.t)
            self.under_way = None
        if isinstance(entry, CommandEntry):
            if entry.sensor:
                self.readings[entry.sensor] = entry
            if entry.status is Status.DONE:
                self.trail += entry.path
            elif entry.status is Status.ACCEPTED:
                self.under_way = entry
        elif isinstance(entry, ActionEntry) and not entry.refused:
            if entry.restarts:
                self.readings.clear()
            if entry.restarts or entry.action is ActionName.TELEPORT:
                self.trail.clear()
        self.pose = entry.pose

    def follow(self, movement: CommandEntry, time: float) -> None:
        """Go along with a movement up to a simulated time."""
        self.pose = movement.pose_at(time)
        self.trail += movement.trail(time)


def _pose_before(log: Log, begin: int, first: int) -> Pose:
    """The robot's pose before entry `begin`, in the stretch that starts with entry `first`."""
    k = log.find_previous(begin, Mark.COMMAND | Mark.ACTION | Mark.BELIEF)
    entry = log.entry(k) if k is not None and k >= first else None
    if entry is None or isinstance(entry, BrokenEntry | NoticeEntry | TwinEntry):
        return log.header.pose
    return entry.pose


def _under_way(log: Log, i: int, time: float) -> CommandEntry | None:
    """The movement under way at a time after entry i that is logged later, when it ends."""
    for k in range(i + 1, min(i + 1 + LOOK_AHEAD, log.count)):
        entry = log.entry(k)
        if isinstance(entry, ActionEntry) and entry.restarts:
            return None
        if isinstance(entry, CommandEntry) and entry.status is Status.DONE:
            return entry if entry.begin < time < entry.end else None
    return None


def _block(log: Log, i: int, restart: int | None, pose: Pose) -> tuple[Pose, bool]:
    """The block's place, and whether it is held: by what was last done to it since the run began
    anew, the robot being at `pose` now."""
    k = log.find_previous(i + 1, Mark.ACTION | Mark.GRIP)
    for _ in range(ACTIONS):
        if k is None or (restart is not None and k <= restart):
            break
        entry = log.entry(k)
        if isinstance(entry, ActionEntry) and entry.action is ActionName.BLOCK and not entry.refused:
            return Pose(entry.arguments[0], entry.arguments[1], 0.0), False
        if isinstance(entry, CommandEntry) and entry.grip is not None:
            grip = entry.grip
            return carried(grip.block, entry.before, pose) if grip.holding else grip.block, grip.holding
        k = log.find_previous(k, Mark.ACTION | Mark.GRIP)
    return log.header.block if restart is None else log.header.start_block, False


def carried(block: Pose, before: Pose, after: Pose) -> Pose:
    """Where a held block is when the robot has gone from one pose to another."""
    turn = after.heading - before.heading
    cos, sin = cos_sin(turn)
    x, y = block.x - before.x, block.y - before.y
    return Pose(after.x + cos * x - sin * y, after.y + sin * x + cos * y, block.heading + turn)


def _belief(log: Log, i: int, first: int) -> BeliefEntry | None:
    k = log.find_previous(i + 1, Mark.BELIEF)
    entry = log.entry(k) if k is not None and k >= first else None
    return entry if isinstance(entry, BeliefEntry) else None


def _contacts(log: Log, i: int, first: int, time: float) -> tuple[CommandEntry, ...]:
    contacts: list[CommandEntry] = []
    k = log.find_previous(i + 1, Mark.CONTACT)
    while k is not None and k >= first and len(contacts) < CONTACTS:
        entry = log.entry(k)
        if isinstance(entry, CommandEntry) and entry.contact is not None and entry.contact_time <= time:
            contacts.append(entry)
        k = log.find_previous(k, Mark.CONTACT)
    return tuple(reversed(contacts))
