"""The one reducer from a run's events to its state.

    reducer = Reducer(checkpoint_of(simulator))
    for event in events:
        reducer.apply(event)
    reducer.at(12.5).pose

The same reducer serves a run that is going on and one that is read from a log, so both show the same.
It needs nothing but the events: the simulator is never asked.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import asdict, replace

from simmer_tui.events import (
    ActionDone,
    ActionName,
    Belief,
    CommandResult,
    Event,
    Goal,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
    ProgramEnded,
    TwinReading,
)
from simmer_tui.run.facts import WEDGED, is_same_place, is_wedged
from simmer_tui.run.state import Checkpoint, MissionProgress, SensorRow, State, TimeSpent, start_block
from simmer_tui.sim import noise
from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.gripper import in_global_frame, in_robot_frame
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import Reading
from simmer_tui.sim.trajectory import Trajectory

if TYPE_CHECKING:  # most runs have no history, and starting is to be quick
    from simmer_tui.run.run_history import RunHistory

HISTORY = 60
"""Readings kept of each sensor: the screen's curves have at most so many columns."""
LEGS = 30
"""Movements whose trail is kept."""
LEG_POINTS = 40
"""About the most points of one movement's trail."""
CONTACT_POINTS = 1000
"""Most places of contacts kept."""

# The newest reading of a sensor: its result, the values before it, its running number, and the block then,
# as it lay and as it was held.
_LastReading = tuple[CommandResult, Reading, deque[float], int, Block, Block | None]


class Reducer:
    """Takes events in order; `at` gives the state at a moment from the last one on."""

    def __init__(self, beginning: Checkpoint, *, history: RunHistory | None = None) -> None:
        """`history` is told all that happens, if there is one."""
        self.history = history
        self._now = beginning
        """The run as it stands, but for what changes with every command: that is kept beside it."""
        self.number = 0
        """The running number of the newest event. Any thread may read it."""
        self.seen: Mapping[str, CommandResult] = {}
        """By code, each sensor's newest reading between the ends of the two latest movements."""
        self.wedged = False
        """True if the newest movement was one more of those that keep meeting something in one place."""
        self._touched: deque[Pose] = deque(maxlen=WEDGED)
        self.let_go = False
        """True if the newest grip let the block go."""
        self._time, self._commands = beginning.time, beginning.commands
        self._held = in_robot_frame(beginning.block, beginning.pose) if beginning.holding else None
        self._driving, self._link = beginning.spent.driving, beginning.spent.link
        self._reading = dict(beginning.spent.by_sensor)
        self._movement: MovementPlanned | None = None
        self._legs: deque[Trajectory] = deque(maxlen=LEGS)
        self._sensors: dict[str, _LastReading] = {}
        self._read: dict[str, CommandResult] = {}
        self._twins: dict[str, TwinReading] = {}
        self._moved = 0
        self._last: CommandResult | None = None
        self._ended: MovementEnded | None = None
        self._belief: Belief | None = None

    # -- events --------------------------------------------------------------------------------

    def apply(self, event: Event, line: int = 0, real_time: float = math.nan) -> None:
        """Take note of an event, perhaps from a line of a log, told at a moment of real time, seconds."""
        self.number += 1
        if self.history is not None:
            self.history.begin(line, real_time)
        match event:
            case CommandResult():
                self._take_result(event)
            case MovementPlanned():
                self._take_plan(event)
            case MovementEnded():
                self._take_end(event)
            case ActionDone():
                self._take_action(event)
            case Belief():
                self._belief = event
                self._time = max(self._time, event.time)
                if self.history is not None:
                    self.history.add_belief(event)
            case TwinReading():
                self._twins[event.code] = event
                if self.history is not None:
                    self.history.is_twin = True
            case Notice():
                self._take_notice(event)
            case MissionEvent():
                self._take_mission(event)
            case ProgramEnded():
                if self.history is not None:
                    self.history.add_program_end(event)

    def _take_result(self, result: CommandResult) -> None:
        self._last = result
        # Comparisons in place of max(): this runs once for each command, which are most events.
        if result.number > self._commands:
            self._commands = result.number
        if result.time > self._time:
            self._time = result.time
        self._link += result.link
        reading = result.reading
        if reading is not None:
            code = reading.sensor.code
            if reading.took:
                self._reading[code] = self._reading.get(code, 0.0) + reading.took
            known = self._sensors.get(code)
            values = deque[float](maxlen=HISTORY) if known is None else known[2]
            values.append(reading.value)
            self._sensors[code] = (result, reading, values, self.number, self._now.block, self._held)
            self._read[code] = result
        if self.history is not None:
            movement = self._movement
            self.history.add_result(result, None if movement is None else movement.trajectory)

    def _take_plan(self, planned: MovementPlanned) -> None:
        # A second plan of the same movement follows when the block is moved under way; it is one leg.
        begins = self._movement is None
        self._movement = planned
        self._time = max(self._time, planned.time)
        self._commands = max(self._commands, planned.number)
        if begins:
            self._moved = self.number
            self._legs.append(planned.trajectory)
        elif self._legs:
            self._legs[-1] = planned.trajectory
        if self.history is not None:
            self.history.add_plan(planned)
        grip = planned.grip
        if grip is not None:
            lying = Block(grip.block.x, grip.block.y, self._now.block.size, grip.block.heading)
            self.let_go = self._now.holding and not grip.holding
            # The jaws act at once, so the block changes hands when the grip is planned, not when it ends.
            self._put_block(lying, in_robot_frame(lying, self._now.pose) if grip.holding else None)

    def _take_end(self, ended: MovementEnded) -> None:
        trajectory = ended.trajectory
        self._ended = ended
        self._driving += ended.time - trajectory.start_time
        # A log that begins in the middle of a movement has its end without its plan.
        if self._movement is None:
            self._legs.append(trajectory)
        elif self._legs:
            self._legs[-1] = trajectory
        self._movement = None
        self._moved = self.number
        self._time = max(self._time, ended.time)
        pose, went = trajectory.arrival(ended.time)
        now = self._now
        contacts, points = now.contacts, now.contact_points
        self.wedged = False
        if ended.contact is not None:
            contacts += 1
            self._touched.append(pose)
            self.wedged = is_wedged(self._touched)
            # A program may push against a wall for hours; the screen and the record need no more than these.
            if len(points) < CONTACT_POINTS:
                points = (*points, ended.contact.point)
        elif self._touched and not is_same_place(pose, self._touched[-1]):
            self._touched.clear()
        self._now = replace(
            now, pose=pose, distance=now.distance + went, contacts=contacts, contact_points=points
        )
        self.seen = self._read
        # A grip does not move the robot, so readings before it still hold.
        if ended.grip is None:
            self._read = {}
        if self.history is not None:
            self.history.add_movement(ended, pose, went, self.seen)
            if self.wedged:
                self.history.wedged.add(self.history.contacts.items[-1])

    def _take_action(self, done: ActionDone) -> None:
        # The pose has to be asked for before the action changes it.
        before = self.pose_at(self._time)
        if self.history is not None:
            self.history.add_action(done, before)
        if not done.refused:
            self._do(done)
        # After `_do`: a restart sets the time to 0 first.
        self._time = max(self._time, done.time)

    def _do(self, done: ActionDone) -> None:
        name, arguments = done.action.name, done.action.arguments
        mission, block = self._now.mission, self._now.block
        if mission is not None and name.helps:
            self._now = replace(self._now, mission=dataclasses.replace(mission, helped=True))
        match name:
            case ActionName.BLOCK:
                self._put_block(dataclasses.replace(block, x=arguments[0], y=arguments[1], heading=0.0))
            case ActionName.NOISE:
                self._now = replace(self._now, noise=bool(arguments[0]))
            case ActionName.BIAS:
                self._set_bias(random=bool(arguments[0]))
            case ActionName.PAUSE | ActionName.RESUME:
                self._now = replace(self._now, paused=name is ActionName.PAUSE)
            case ActionName.SPEED:
                self._now = replace(self._now, time_scale=arguments[0])
            case ActionName.TELEPORT:
                self._place(done.pose)
            # The bias comes after the seed that it is drawn from.
            case ActionName.RESET | ActionName.SEED:
                self._restart(int(arguments[0]) if arguments else self._now.seed)
                self._place(done.pose)
                self._put_block(start_block(self._now.spec))
                self._set_bias(random=self._now.spec.randbias)

    def _put_block(self, block: Block, held: Block | None = None) -> None:
        """The block is there now; `held` is the same in the robot's frame, if the robot holds it."""
        self._now, self._held = replace(self._now, block=block, holding=held is not None), held
        if self.history is not None:
            self.history.add_block(block if held is None else held, held is not None)

    def _set_bias(self, *, random: bool) -> None:
        spec = self._now.spec
        fixed = {drive.kind: drive.bias for drive in spec.drives}
        bias = noise.random_bias(self._now.seed, spec.strength) if random else fixed
        self._now = replace(self._now, bias=bias)
        if self.history is not None:
            self.history.add_bias(bias)

    def _place(self, pose: Pose) -> None:
        """The robot stands somewhere else; what was seen from where it was says nothing any more."""
        self._now = replace(self._now, pose=pose)
        self._legs.clear()
        self._touched.clear()
        self._sensors.clear()
        self._read = {}
        self._belief = None
        self._moved = self.number

    def _restart(self, seed: int) -> None:
        mission = None if self._now.mission is None else MissionProgress()
        self._now = replace(
            self._now, seed=seed, contacts=0, contact_points=(), distance=0.0, mission=mission
        )
        self._time = 0.0
        self._commands = 0
        self._ended = None
        self._driving = self._link = 0.0
        self._reading = {}

    def _take_notice(self, notice: Notice) -> None:
        if notice.kind is NoticeKind.CONNECTED:
            self._now = replace(self._now, client=notice.subject)
        # Others may come and be turned away meanwhile; only the program that drives counts.
        elif notice.kind is NoticeKind.LEFT and notice.subject == self._now.client:
            self._now = replace(self._now, client="")
        if self.history is not None:
            self.history.add_notice(notice)

    def _take_mission(self, event: MissionEvent) -> None:
        # Some logs do not say in their header that a mission is under way.
        mission = self.mission
        if isinstance(event.subject, Goal):
            mission = dataclasses.replace(mission, goals={**mission.goals, event.subject: event.time})
        else:
            mission = dataclasses.replace(mission, result=event.subject, reason=event.reason)
        self._now = replace(self._now, mission=mission)
        if self.history is not None:
            self.history.add_mission(event)

    # -- the state -----------------------------------------------------------------------------

    def pose_at(self, time: float) -> Pose:
        """The robot's pose at a simulated time from the last event on."""
        return self._now.pose if self._movement is None else self._movement.trajectory.pose_at(time)

    @property
    def time(self) -> float:
        """Simulated time of the last event, seconds."""
        return self._time

    @property
    def contacts(self) -> int:
        """Contacts of the movements that are over."""
        return self._now.contacts

    @property
    def mission(self) -> MissionProgress:
        """Progress of the mission; without one nothing has been met."""
        return self._now.mission or MissionProgress()

    @property
    def still(self) -> bool:
        """True if no movement is under way."""
        return self._movement is None

    def beginning(self) -> Checkpoint:
        """All that a reducer must know to go on from here. Only while no movement is under way."""
        assert self._movement is None, "a movement is under way"
        return self._checkpoint(self._time, self._now.pose)

    def at(self, time: float | None = None) -> State:
        """The state at a simulated time, by default that of the last event."""
        now = self._time if time is None else max(time, self._time)
        pose, movement = self.pose_at(now), self._movement
        # A plan knows its contact beforehand; it is shown only once it has come.
        contact = self._legs[-1].contact if self._legs else None
        if contact is not None and contact.time > now:
            contact = None
        return State(
            **asdict(self._checkpoint(now, pose)),
            number=self.number,
            moving=movement is not None and now < movement.trajectory.end_time,
            touching=contact is not None and contact.pose == pose,
            contact=contact,
            legs=tuple(_leg(each, now) for each in self._legs),
            moved=self._moved,
            sensors={
                code: SensorRow(
                    reading,
                    tuple(values),
                    number,
                    result.time,
                    result.before,
                    block if held is None else in_global_frame(held, result.before),
                )
                for code, (result, reading, values, number, block, held) in self._sensors.items()
            },
            twins=dict(self._twins),
            last=self._last,
            ended=self._ended,
            belief=self._belief,
        )

    def _checkpoint(self, time: float, pose: Pose) -> Checkpoint:
        """The run at a simulated time, with its sums and with what is under way so far."""
        travelled = driving = 0.0
        if self._movement is not None:
            trajectory = self._movement.trajectory
            travelled, driving = trajectory.travelled(time), time - trajectory.start_time
        return replace(
            self._now,
            time=time,
            pose=pose,
            block=self._now.block if self._held is None else in_global_frame(self._held, pose),
            commands=self._commands,
            distance=self._now.distance + travelled,
            spent=TimeSpent(self._driving + driving, self._link, dict(self._reading)),
        )


def _leg(trajectory: Trajectory, time: float) -> FloatArray:
    """A movement's way till now, thinned."""
    points = trajectory.trail(time)
    stride = max(1, len(points) // LEG_POINTS)
    return np.concatenate((points[:-1:stride], points[-1:]))
