"""The one reducer from a run's events to its state.

    reducer = Reducer(checkpoint_of(simulator))
    for event in events:
        reducer.apply(event)
    reducer.at(12.5).pose

The same reducer serves a run that is going on and one that is read from a log, so both show the same.
It needs nothing but the events: the simulator is never asked.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

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
        self._spec, self._bias = beginning.spec, beginning.bias
        self.number = 0
        """The running number of the newest event. Any thread may read it."""
        self._time = beginning.time
        self._pose = beginning.pose
        self._block = beginning.block
        self._held = in_robot_frame(beginning.block, beginning.pose) if beginning.holding else None
        self._seed = beginning.seed
        self._noise = beginning.noise
        self._paused = beginning.paused
        self._time_scale = beginning.time_scale
        self._commands = beginning.commands
        self._contacts = beginning.contacts
        self._distance = beginning.distance
        self._client = beginning.client
        self._mission = beginning.mission
        self._driving, self._link = beginning.spent.driving, beginning.spent.link
        self._reading = dict(beginning.spent.by_sensor)
        self._movement: MovementPlanned | None = None
        self._legs: deque[Trajectory] = deque(maxlen=LEGS)
        self._contact_points = list(beginning.contact_points)
        self._sensors: dict[str, _LastReading] = {}
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
            self._sensors[code] = (result, reading, values, self.number, self._block, self._held)
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
            lying = Block(grip.block.x, grip.block.y, self._block.size, grip.block.heading)
            # The jaws act at once, so the block changes hands when the grip is planned, not when it ends.
            self._put_block(lying, in_robot_frame(lying, self._pose) if grip.holding else None)

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
        self._pose, went = trajectory.arrival(ended.time)
        self._distance += went
        if ended.contact is not None:
            self._contacts += 1
            # A program may push against a wall for hours; the screen and the record need no more than these.
            if len(self._contact_points) < CONTACT_POINTS:
                self._contact_points.append(ended.contact.point)
        if self.history is not None:
            self.history.add_movement(ended, self._pose, went)

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
        if self._mission is not None and name.helps:
            self._mission = replace(self._mission, helped=True)
        match name:
            case ActionName.BLOCK:
                self._put_block(replace(self._block, x=arguments[0], y=arguments[1], heading=0.0))
            case ActionName.NOISE:
                self._noise = bool(arguments[0])
            case ActionName.BIAS:
                self._set_bias(random=bool(arguments[0]))
            case ActionName.PAUSE | ActionName.RESUME:
                self._paused = name is ActionName.PAUSE
            case ActionName.SPEED:
                self._time_scale = arguments[0]
            case ActionName.TELEPORT:
                self._place(done.pose)
            # The bias comes after the seed that it is drawn from.
            case ActionName.RESET | ActionName.SEED:
                self._restart(int(arguments[0]) if arguments else self._seed)
                self._place(done.pose)
                self._put_block(start_block(self._spec))
                self._set_bias(random=self._spec.randbias)

    def _put_block(self, block: Block, held: Block | None = None) -> None:
        """The block is there now; `held` is the same in the robot's frame, if the robot holds it."""
        self._block, self._held = block, held
        if self.history is not None:
            self.history.add_block(block if held is None else held, held is not None)

    def _set_bias(self, *, random: bool) -> None:
        spec = self._spec
        fixed = {drive.kind: drive.bias for drive in spec.drives}
        self._bias = noise.random_bias(self._seed, spec.strength) if random else fixed
        if self.history is not None:
            self.history.add_bias(self._bias)

    def _place(self, pose: Pose) -> None:
        """The robot stands somewhere else; what was seen from where it was says nothing any more."""
        self._pose = pose
        self._legs.clear()
        self._sensors.clear()
        self._belief = None
        self._moved = self.number

    def _restart(self, seed: int) -> None:
        self._seed = seed
        self._time = 0.0
        self._commands = self._contacts = 0
        self._distance = 0.0
        self._contact_points = []
        self._ended = None
        self._driving = self._link = 0.0
        self._reading = {}
        if self._mission is not None:
            self._mission = MissionProgress()

    def _take_notice(self, notice: Notice) -> None:
        if notice.kind is NoticeKind.CONNECTED:
            self._client = notice.subject
        # Others may come and be turned away meanwhile; only the program that drives counts.
        elif notice.kind is NoticeKind.LEFT and notice.subject == self._client:
            self._client = ""
        if self.history is not None:
            self.history.add_notice(notice)

    def _take_mission(self, event: MissionEvent) -> None:
        # Some logs do not say in their header that a mission is under way.
        mission = self._mission or MissionProgress()
        if isinstance(event.subject, Goal):
            mission = replace(mission, goals={**mission.goals, event.subject: event.time})
        else:
            mission = replace(mission, result=event.subject, reason=event.reason)
        self._mission = mission
        if self.history is not None:
            self.history.add_mission(event)

    # -- the state -----------------------------------------------------------------------------

    def pose_at(self, time: float) -> Pose:
        """The robot's pose at a simulated time from the last event on."""
        return self._pose if self._movement is None else self._movement.trajectory.pose_at(time)

    @property
    def time(self) -> float:
        """Simulated time of the last event, seconds."""
        return self._time

    @property
    def contacts(self) -> int:
        """Contacts of the movements that are over."""
        return self._contacts

    @property
    def distance(self) -> float:
        """Inches driven in the movements that are over."""
        return self._distance

    @property
    def still(self) -> bool:
        """True if no movement is under way."""
        return self._movement is None

    def beginning(self) -> Checkpoint:
        """All that a reducer must know to go on from here. Only while no movement is under way."""
        assert self._movement is None, "a movement is under way"
        return Checkpoint(
            spec=self._spec,
            time=self._time,
            pose=self._pose,
            block=self._block_at(self._pose),
            seed=self._seed,
            holding=self._held is not None,
            noise=self._noise,
            paused=self._paused,
            time_scale=self._time_scale,
            commands=self._commands,
            contacts=self._contacts,
            contact_points=tuple(self._contact_points),
            distance=self._distance,
            client=self._client,
            mission=self._mission,
            spent=self._spent(0.0),
            bias=self._bias,
        )

    def at(self, time: float | None = None) -> State:
        """The state at a simulated time, by default that of the last event."""
        now = self._time if time is None else max(time, self._time)
        pose, movement = self.pose_at(now), self._movement
        # A plan knows its contact beforehand; it is shown only once it has come.
        contact = self._legs[-1].contact if self._legs else None
        if contact is not None and contact.time > now:
            contact = None
        travelled = 0.0 if movement is None else movement.trajectory.travelled(now)
        return State(
            number=self.number,
            time=now,
            pose=pose,
            moving=movement is not None and now < movement.trajectory.end_time,
            touching=contact is not None and contact.pose == pose,
            contact=contact,
            block=self._block_at(pose),
            holding=self._held is not None,
            seed=self._seed,
            noise=self._noise,
            paused=self._paused,
            time_scale=self._time_scale,
            commands=self._commands,
            contacts=self._contacts,
            contact_points=tuple(self._contact_points),
            distance=self._distance + travelled,
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
            client=self._client,
            mission=self._mission,
            spent=self._spent(0.0 if movement is None else now - movement.trajectory.start_time),
        )

    def _spent(self, driving: float) -> TimeSpent:
        """The sums, with the seconds of a drive under way."""
        return TimeSpent(self._driving + driving, self._link, dict(self._reading))

    def _block_at(self, pose: Pose) -> Block:
        return self._block if self._held is None else in_global_frame(self._held, pose)


def _leg(trajectory: Trajectory, time: float) -> FloatArray:
    """A movement's way till now, thinned."""
    points = trajectory.trail(time)
    stride = max(1, len(points) // LEG_POINTS)
    return np.concatenate((points[:-1:stride], points[-1:]))
