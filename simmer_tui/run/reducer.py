"""The one reducer from a run's events to its state.

    reducer = Reducer(checkpoint_of(simulator))
    for event in events:
        reducer.apply(event)
    reducer.at(12.5).pose

The same reducer serves a live run and one that is read from a log, so both show the same. It needs nothing
but the events: it never asks the simulator.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from msgspec.structs import asdict, replace

from simmer_tui.run.events import (
    ActionDone,
    ActionName,
    Belief,
    CommandResult,
    DisplayChanged,
    Event,
    Goal,
    LegBegun,
    LegEnded,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
    PortLine,
    ProgramEnded,
    Result,
    TwinReading,
    VelocityEnded,
    WireMessage,
)
from simmer_tui.run.facts import WEDGED, is_same_place, is_wedged
from simmer_tui.run.state import (
    NO_PATH,
    Checkpoint,
    MissionProgress,
    MissionSums,
    SensorRow,
    State,
    TimeSpent,
    timed_line,
)
from simmer_tui.sim import noise
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.gripper import in_global_frame, in_robot_frame
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.path import Contact
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.recent_motion import BlockPlace
from simmer_tui.sim.records import Reading, VelocityChange
from simmer_tui.sim.trajectory import Trajectory

if TYPE_CHECKING:  # most runs have no history, and starting is to be quick
    from simmer_tui.run.run_history import RunHistory

HISTORY = 60
"""Readings kept of each sensor: the screen's curves have at most this many columns."""
SEEN_LATELY = 0.5
"""Simulated seconds before the end of a leg within which a reading still shows what was ahead: some inches at
usual speeds. Judged."""
CONTACT_POINTS = 1000
"""Most places of contacts kept, the latest."""

# The newest reading of a sensor: its result, the values before it, its running number, and the block then, in
# the maze and in the robot's frame.
_LastReading = tuple[CommandResult, Reading, deque[float], int, Block, Block | None]


class Reducer:
    """Applies events in order; `at` gives the state at a moment from the last event on."""

    def __init__(self, checkpoint: Checkpoint, *, history: RunHistory | None = None) -> None:
        """`history`, if given, is filled with all events."""
        self.history = history
        self._now = checkpoint
        """The present state of the run; values that change with every command are kept in other
        attributes."""
        self.number = 0
        """The running number of the newest event. Any thread may read it."""
        self.seen: Mapping[str, CommandResult] = {}
        """By code, each sensor's newest reading between the ends of the two latest movements."""
        self.wedged = False
        """True if the newest movement was one more contact in a row in one place."""
        self._touched: deque[Pose] = deque(maxlen=WEDGED)
        self.let_go = False
        """True if the newest grip released the block."""
        self.time = checkpoint.time
        """Simulated time of the last event, seconds."""
        self._commands = checkpoint.commands
        self._held = in_robot_frame(checkpoint.block, checkpoint.pose) if checkpoint.holding else None
        self._driving, self._link = checkpoint.spent.driving, checkpoint.spent.link
        self._reading = dict(checkpoint.spent.by_sensor)
        self._movement: MovementPlanned | None = None
        self.leg: Leg | None = None
        """The leg of a continuous motion under way, if there is one."""
        self.velocity: VelocityChange | None = None
        """The velocity in force; None while there is none."""
        self._newest: Trajectory | Leg | None = None
        """The latest movement or leg since the robot was put somewhere, also while it is under way."""
        self._contact: Contact | None = None
        """Its first contact; of legs that follow each other, the latest."""
        self._sensors: dict[str, _LastReading] = {}
        self._read: dict[str, CommandResult] = {}
        self._twins: dict[str, TwinReading] = {}
        self._moved, self._moved_by = 0, ""
        self._last: CommandResult | None = None
        self._ended: MovementEnded | None = None
        self._belief: Belief | None = None

    @property
    def block_place(self) -> BlockPlace:
        """The block where it lies, or in the gripper."""
        held = self._held
        return BlockPlace(-math.inf, self._now.block if held is None else held, held=held is not None)

    # -- events --------------------------------------------------------------------------------

    def apply(self, event: Event, line: int = 0, real_time: float = math.nan) -> None:
        """Apply an event. `line` is its line in a log (0 without one), `real_time` is in seconds."""
        if type(event) is CommandResult and event.reading is not None:
            self.apply_readings((event,), (line,), (real_time,))
            return
        self.number += 1
        if self.history is not None:
            self.history.begin(line, real_time)
        self._TAKES[type(event)](self, event)

    def apply_readings(
        self, results: Sequence[CommandResult], lines: Sequence[int], real_times: Sequence[float]
    ) -> None:
        """Apply readings that follow each other: the same as `apply` for each, in less time."""
        block, held, spent = self._now.block, self._held, self._reading
        number, sensors, read = self.number, self._sensors, self._read
        for result in results:
            reading = result.reading
            assert reading is not None
            number += 1
            # Comparisons in place of max(): this runs once for each reading, which are most events.
            if result.number > self._commands:
                self._commands = result.number
            if result.time > self.time:
                self.time = result.time
            self._link += result.link
            code, took = reading.sensor.code, reading.took
            if took:
                spent[code] = spent.get(code, 0.0) + took
            known = sensors.get(code)
            values = deque[float](maxlen=HISTORY) if known is None else known[2]
            values.append(reading.value)
            sensors[code] = (result, reading, values, number, block, held)
            read[code] = result
        self.number = number
        self._last = results[-1]
        if self.history is not None:
            movement = self._movement
            under_way = self.leg if movement is None else movement.trajectory
            self.history.add_readings(results, lines, real_times, under_way)

    def _take_belief(self, belief: Belief) -> None:
        self._belief = _with_cells(belief, self._belief)
        self.time = max(self.time, belief.time)
        if self.history is not None:
            self.history.add_belief(belief)

    def _take_twin(self, reading: TwinReading) -> None:
        self._twins[reading.code] = reading
        if self.history is not None:
            self.history.is_twin = True

    def _take_program_end(self, ended: ProgramEnded) -> None:
        if self.history is not None:
            self.history.add_program_end(ended)

    def _take_result(self, result: CommandResult) -> None:
        self._last = result
        self.time = max(self.time, result.time)
        self._commands = max(self._commands, result.number)
        self._link += result.link
        if result.velocity is not None:
            self.velocity = result.velocity if result.velocity.twist.moves else None
        if self.history is not None:
            self.history.add_result(result)

    def _take_plan(self, planned: MovementPlanned) -> None:
        # A second plan of the same movement follows when the block is moved under way; it is one leg.
        if self._movement is None:
            self._moved, self._moved_by = self.number, planned.command.source
        self._movement = planned
        self._newest, self._contact = planned.trajectory, planned.trajectory.contact
        self.time = max(self.time, planned.time)
        self._commands = max(self._commands, planned.number)
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
        self._movement = None
        self._newest, self._contact = trajectory, trajectory.contact
        self._moved, self._moved_by = self.number, ended.command.source
        self.time = max(self.time, ended.time)
        went, motion = trajectory.travel(ended.time)
        self._arrive(ended.pose, went, ended.contact, held=False)
        self.seen = self._read
        # A grip does not move the robot, so readings before it still hold.
        if ended.grip is None:
            self._read = {}
        if self.history is not None:
            self.history.add_movement(ended, went, motion, self.seen)
            if self.wedged:
                self.history.wedged.add(self.history.contacts.items[-1])

    def _arrive(self, pose: Pose, went: float, contact: Contact | None, *, held: bool) -> None:
        """The robot has moved by `went` inches to a pose, perhaps to a contact, or is `held` by one."""
        now = self._now
        contacts, points = now.contacts, now.contact_points
        self.wedged = False
        if contact is not None:
            contacts += 1
            self._touched.append(pose)
            self.wedged = is_wedged(self._touched)
            # A program may push against a wall for hours; the screen and the record need no more than these.
            points = (*points[1 - CONTACT_POINTS :], contact.point)
        elif self._touched and not held and not is_same_place(pose, self._touched[-1]):
            self._touched.clear()
        self._now = replace(
            now, pose=pose, distance=now.distance + went, contacts=contacts, contact_points=points
        )

    def _take_leg(self, begun: LegBegun) -> None:
        leg = self.leg = begun.leg
        self._show_leg(leg)
        self._moved, self._moved_by = self.number, begun.command.source
        self.time = max(self.time, leg.start_time)
        self._commands = max(self._commands, begun.number)
        if self.history is not None:
            self.history.add_leg_plan(begun)

    def _take_leg_end(self, ended: LegEnded) -> None:
        leg, self.leg = ended.leg, None
        self._show_leg(leg)
        self._moved, self._moved_by = self.number, ended.command.source
        self.time = max(self.time, leg.end_time)
        self._driving += leg.duration
        self._arrive(*leg.arrival(leg.end_time), leg.contact, held=leg.pressed)
        # A velocity that meets nothing goes over into the next one: only a contact ends a movement.
        if leg.contact is not None:
            self._ended = ended.as_movement()
        # A robot that drives reads as it goes, and a leg may be shorter than the time between two readings.
        since = leg.end_time - SEEN_LATELY
        lately = {code: read for code, read in self._read.items() if read.time >= since}
        self.seen, self._read = lately, dict(lately)
        if self.history is not None:
            self.history.add_leg(ended, self.seen)
            if self.wedged:
                self.history.wedged.add(self.history.contacts.items[-1])

    def _show_leg(self, leg: Leg) -> None:
        # A robot that is pressed against a wall makes legs without a contact of their own.
        follows = isinstance(self._newest, Leg)
        self._newest, self._contact = leg, leg.contact or (self._contact if follows else None)

    def _take_velocity_end(self, ended: VelocityEnded) -> None:
        self.velocity = None
        self.time = max(self.time, ended.time)
        if self.history is not None:
            self.history.clock.advance(ended.time)

    def _take_action(self, done: ActionDone) -> None:
        # The pose has to be asked for before the action changes it.
        before = self.pose_at(self.time)
        if self.history is not None:
            self.history.add_action(done, before)
        if not done.refused:
            self._do(done)
        # After `_do`: a restart sets the time to 0 first.
        self.time = max(self.time, done.time)

    def _do(self, done: ActionDone) -> None:
        name, arguments = done.action.name, done.action.arguments
        mission, block = self._now.mission, self._now.block
        if mission is not None and name.helps:
            self._now = replace(self._now, mission=replace(mission, helped=True))
        match name:
            case ActionName.BLOCK:
                self._put_block(replace(block, x=arguments[0], y=arguments[1], heading=0.0))
            case ActionName.NOISE:
                self._now = replace(self._now, noise=bool(arguments[0]))
            case ActionName.BIAS:
                self._set_bias(random=bool(arguments[0]))
            case ActionName.PAUSE | ActionName.RESUME:
                self._now = replace(self._now, paused=name is ActionName.PAUSE)
            case ActionName.TIME_SCALE:
                self._now = replace(self._now, time_scale=arguments[0])
            case ActionName.TELEPORT:
                self._place(done.pose)
            # The bias comes after the seed that it is drawn from.
            case ActionName.RESET | ActionName.SEED:
                self._restart(int(arguments[0]) if arguments else self._now.seed)
                self._place(done.pose)
                self._put_block(self._now.spec.start_block)
                self._set_bias(random=self._now.spec.randbias)

    def _put_block(self, block: Block, held: Block | None = None) -> None:
        """Put the block there; `held` is the same in the robot's frame, if the robot holds it."""
        self._now, self._held = replace(self._now, block=block, holding=held is not None), held
        if self.history is not None:
            self.history.add_block(block if held is None else held, held is not None)

    def _set_bias(self, *, random: bool) -> None:
        bias = noise.drive_bias(self._now.spec, self._now.seed, random=random)
        self._now = replace(self._now, bias=bias)
        if self.history is not None:
            self.history.add_bias(bias)

    def _place(self, pose: Pose) -> None:
        """Put the robot elsewhere; readings from its old place no longer apply."""
        self._now = replace(self._now, pose=pose)
        self.leg = self.velocity = None
        self._newest = self._contact = None
        self._touched.clear()
        self._sensors.clear()
        self._read = {}
        self._belief = None
        self._moved, self._moved_by = self.number, ""

    def _restart(self, seed: int) -> None:
        mission = None if self._now.mission is None else MissionProgress()
        self._now = replace(
            self._now,
            seed=seed,
            contacts=0,
            contact_points=(),
            distance=0.0,
            mission=mission,
            displays=(),
            lines=(),
        )
        self.time = 0.0
        self._commands = 0
        self._ended = None
        self._driving = self._link = 0.0
        self._reading = {}

    def _take_wire(self, message: WireMessage) -> None:
        """Messages over the line change nothing: their commands do. The last line of a board is shown."""
        text = message.data.strip() if message.board and message.reply else ""
        if text:
            line = PortLine(message.board, message.port, text)
            others = [each for each in self._now.lines if (each.board, each.port) != (line.board, line.port)]
            self._now = replace(self._now, lines=(*others, line))
        if self.history is not None and not message.port:
            self.history.add_wire(message)

    def _take_display(self, change: DisplayChanged) -> None:
        others = (each for each in self._now.displays if each.board != change.board)
        displays = sorted((*others, change), key=lambda each: each.board)
        before = next((each for each in self._now.displays if each.board == change.board), None)
        is_busy_alone = before is not None and replace(change, time=before.time, busy=before.busy) == before
        self._now = replace(self._now, displays=tuple(displays))
        if self.history is not None and not is_busy_alone:
            self.history.add_display(change)

    def _take_notice(self, notice: Notice) -> None:
        if notice.kind is NoticeKind.CONNECTED:
            self._now = replace(self._now, client=notice.subject)
        # Other programs may connect and be refused meanwhile; only the program that drives counts. The
        # client of a log that was taken over is not there.
        elif notice.kind is NoticeKind.TAKEN_OVER or (
            notice.kind is NoticeKind.LEFT and notice.subject == self._now.client
        ):
            self._now = replace(self._now, client="")
        if self.history is not None:
            self.history.add_notice(notice)

    def _take_mission(self, event: MissionEvent) -> None:
        # Some logs do not say in their header that a mission is under way.
        mission = self.mission
        if isinstance(event.subject, Goal):
            mission = replace(mission, goals={**mission.goals, event.subject: event.time})
        else:
            end = None if event.subject is Result.UNDER_WAY else self._mission_end(event.time)
            mission = replace(mission, result=event.subject, reason=event.reason, end=end)
        self._now = replace(self._now, mission=mission)
        if self.history is not None:
            self.history.add_mission(event)

    def _mission_end(self, time: float) -> MissionSums:
        run = self._checkpoint(time, self.pose_at(time))
        return MissionSums(time, run.distance, run.commands, run.contacts, run.spent)

    _TAKES: ClassVar[Mapping[type, Callable[[Reducer, Any], None]]] = {
        CommandResult: _take_result,
        MovementPlanned: _take_plan,
        MovementEnded: _take_end,
        LegBegun: _take_leg,
        LegEnded: _take_leg_end,
        VelocityEnded: _take_velocity_end,
        ActionDone: _take_action,
        Belief: _take_belief,
        TwinReading: _take_twin,
        Notice: _take_notice,
        MissionEvent: _take_mission,
        ProgramEnded: _take_program_end,
        WireMessage: _take_wire,
        DisplayChanged: _take_display,
    }

    # -- the state -----------------------------------------------------------------------------

    def pose_at(self, time: float) -> Pose:
        """The robot's pose at a simulated time from the last event on."""
        if self._movement is not None:
            return self._movement.trajectory.pose_at(time)
        return self._now.pose if self.leg is None else self.leg.pose_at(time)

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
        return self._movement is None and self.leg is None

    def checkpoint(self) -> Checkpoint:
        """All that a reducer must know to continue from here. Only while no movement is under way."""
        assert self.still, "a movement is under way"
        return self._checkpoint(self.time, self._now.pose)

    def at(self, time: float | None = None) -> State:
        """The state at a simulated time, by default that of the last event."""
        now = self.time if time is None else max(time, self.time)
        pose, movement = self.pose_at(now), self._movement
        moving = movement is not None and now < movement.trajectory.end_time
        # A plan knows its contact beforehand; it is shown only once it has come.
        contact = self._contact
        if contact is not None and contact.time > now:
            contact = None
        return State(
            **asdict(self._checkpoint(now, pose)),
            number=self.number,
            moving=moving or self.leg is not None,
            touching=contact is not None and contact.pose == pose,
            contact=contact,
            velocity=None if self.velocity is None else self.velocity.twist,
            path=NO_PATH if self._newest is None else _path(self._newest, now),
            moved=self._moved,
            moved_by=self._moved_by,
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
            movement=movement if moving else None,
            belief=self._belief,
        )

    def _checkpoint(self, time: float, pose: Pose) -> Checkpoint:
        """The run at a simulated time, with its sums, the motion under way included."""
        travelled = driving = 0.0
        under_way = self.leg if self._movement is None else self._movement.trajectory
        contacts = self._now.contacts
        if under_way is not None:
            travelled, driving = under_way.travelled(time), time - under_way.start_time
            contacts += under_way.contact is not None and under_way.contact.time <= time
        return replace(
            self._now,
            time=time,
            pose=pose,
            block=self._now.block if self._held is None else in_global_frame(self._held, pose),
            commands=self._commands,
            contacts=contacts,
            distance=self._now.distance + travelled,
            spent=TimeSpent(self._driving + driving, self._link, dict(self._reading)),
        )


def _path(newest: Trajectory | Leg, now: float) -> FloatArray:
    return timed_line(np.array(newest.centres(now)), newest.start_time, min(now, newest.end_time))


def _with_cells(belief: Belief, before: Belief | None) -> Belief:
    """A belief with the cells of the one before it, where the log has left out its own. They are at most half
    a second old, so the drawn map does not flicker."""
    grid, known = belief.grid, None if before is None else before.grid
    if grid is None or grid.cells or known is None:
        return belief
    if (grid.shape, grid.bounds, grid.first) != (known.shape, known.bounds, known.first):
        return belief
    return replace(belief, grid=replace(grid, cells=known.cells))
