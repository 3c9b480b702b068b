"""The team's own language: one program at a time drives the robot over its serial port."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping, Sequence

from msgspec.structs import replace

from simmer_tui.config.settings import USUAL_BAUD
from simmer_tui.dialect.device import DialectDevice, MoveEnd
from simmer_tui.dialect.dialect_rules import DialectRules
from simmer_tui.dialect.expressions import FieldValue
from simmer_tui.dialect.timer import Timer
from simmer_tui.links.course_device import FRAMINGS, CourseDevice
from simmer_tui.links.link import LinkContext
from simmer_tui.links.port_link import PortLink
from simmer_tui.links.protocol.packets import STOP
from simmer_tui.links.serial_wire import SerialEndpoint, Wire
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.sessions import Session
from simmer_tui.run.events import (
    ActionDone,
    Event,
    LegEnded,
    Notice,
    NoticeKind,
    VelocityEnd,
    VelocityEnded,
    WireMessage,
)
from simmer_tui.sim.command import PEOPLE, Command, parse_command
from simmer_tui.sim.records import REFUSALS, CommandResult, Status

# A stream at 240 Hz would be most of a log, and its messages are all alike.
LOGGED_OF_STREAM = 1000
"""Messages of streams that are logged; later ones are only counted."""
_ENDED_BY_OTHERS = frozenset((VelocityEnd.STOP, VelocityEnd.PLACED, VelocityEnd.MOVEMENT))
"""Ends of a velocity that are not its own, while its sender is there."""
_STOP = Command(STOP, STOP, stops=True)
"""The stop sent by a rule of the dialect, or at the end of a run."""


def move_end(result: CommandResult) -> MoveEnd:
    """The end of a movement, by its result."""
    cut = result.trajectory is not None and result.trajectory.cut is not None
    velocity = result.velocity
    return MoveEnd(
        refused=(result.reason or result.status.value) if result.status in REFUSALS else "",
        touched=result.contact is not None,
        stopped=result.status is Status.STOPPED or cut,
        lasts=None
        if velocity is None
        else velocity.twist.moves and (velocity.times_out or velocity.expires == math.inf),
    )


def note_motion(event: Event, device: DialectDevice) -> None:
    """Tell a device of contacts of its runs, and of the ends of velocities."""
    # Who is pressed against a wall again within 0.1 s has no new contact.
    if isinstance(event, LegEnded) and (event.contact is not None or event.leg.pressed):
        device.run_touched()
    elif isinstance(event, VelocityEnded):
        device.velocity_ended(by_others=event.reason in _ENDED_BY_OTHERS)
    elif isinstance(event, CommandResult) and event.velocity is not None and event.command.source in PEOPLE:
        device.velocity_ended(by_others=True)


class SimulatedHost:
    """The simulated robot as the dialect's device sees it."""

    def __init__(self, engine: Engine, rules: DialectRules, write: Callable[[bytes, bool], None]) -> None:
        """`write` sends bytes; its second argument is true for droppable ones."""
        self._engine = engine
        self._rules = rules
        self._write = write
        self.source = "client"
        """Source of the commands of the movements."""
        self._moves = self._new_session()
        self._readers: dict[str, Session] = {}

    def _new_session(self) -> Session:
        return self._engine.session(answer_at_end=True, lane="dialect")

    def close(self, *, runs_on: bool) -> None:
        """End the velocity of a program that has left, unless the robot `runs_on`."""
        if not runs_on:
            self._moves.close()
            self._moves = self._new_session()

    @property
    def now(self) -> float:
        """Simulated time."""
        return self._engine.now()

    def call_later(self, seconds: float, call: Callable[[], None]) -> Timer:
        """Call a function after this much simulated time."""
        timer = Timer(call)
        self._engine.call_at(self._engine.now() + seconds, timer)
        return timer

    def read(self, codes: Sequence[str], done: Callable[[Mapping[str, FieldValue]], None]) -> None:
        """Read sensors now; the reading takes the sum of their Read Times."""
        begun = self._engine.now()
        results: dict[str, CommandResult] = {}

        def answered(result: CommandResult) -> None:
            results[result.command.code] = result
            if len(results) < len(codes):
                return
            took = sum(each.duration for each in results.values())
            values = {code: reply_value(results[code]) for code in codes}
            left = begun + took - self._engine.now()
            if left > 0:
                self.call_later(left, lambda: done(values))
            else:
                done(values)

        for code in codes:
            session = self._readers.get(code)
            if session is None:
                session = self._readers[code] = self._new_session()
            session.submit(parse_command(code), answered)

    def move(self, command: str, done: Callable[[MoveEnd], None]) -> None:
        """Do a movement of known length."""
        self._moves.submit(parse_command(command, self.source), lambda result: done(move_end(result)))

    def drive(self, velocity: tuple[float, float, float] | None, seconds: float | None) -> str:
        """Drive at a velocity, for a time or until another command."""
        values = [*(velocity or (0.0, 0.0, 0.0)), *([] if seconds is None else [seconds])]
        text = f"{self._rules.parts.velocity}-{';'.join(f'{each:.12g}' for each in values)}"
        ends: list[MoveEnd] = []
        self._moves.submit(parse_command(text, self.source), lambda result: ends.append(move_end(result)))
        return ends[0].refused if ends else ""

    def halt(self, by: str = "") -> None:
        """End all motion. `by` names the cause if there is no message."""
        simulator = self._engine.simulator
        if simulator.moving or simulator.velocity.moves:
            self._engine.halt(replace(_STOP, source=by or self.source))

    def send(self, data: bytes, *, droppable: bool = False) -> None:
        """Send bytes to the program."""
        self._write(data, droppable)

    def done(self, message: bytes, meaning: str) -> None:
        """Report a message that has come, and its meaning."""
        self._engine.tell(WireMessage(self._engine.now(), message.decode("latin-1"), meaning=meaning))

    def tell(self, text: str) -> None:
        """Report a fault."""
        self._engine.tell_fault(f"dialect: {text}")

    def inform(self, text: str) -> None:
        """Report something that is no fault."""
        self._engine.tell(Notice(NoticeKind.ROBOT, f"dialect: {text}"))


def reply_value(result: CommandResult) -> FieldValue:
    """The number of a reading, or the list of numbers of a whole scan."""
    ranges = result.ranges
    return result.reply if ranges is None else tuple(ranges.tolist())


class DialectLink(PortLink):
    """The team's own language: one program at a time drives the robot."""

    def __init__(self, context: LinkContext) -> None:
        rules = context.dialect
        assert rules is not None, "the loader serves a dialect only where there is one"
        super().__init__(context)
        self._loop = asyncio.get_running_loop()
        self._sent_by_itself = 0
        """Count of messages of streams that were sent."""
        self._since_reply = 0
        """Bytes of streams that were sent since the last reply."""
        framing = rules.framing if rules.protocol is None else FRAMINGS[rules.protocol]
        self._wire = Wire(self.engine, framing, 0 if self._instant else USUAL_BAUD)
        self._host = SimulatedHost(self.engine, rules, self._reply)
        self._device: DialectDevice | CourseDevice = DialectDevice(rules, self._host)
        if rules.protocol is not None:
            self._device = CourseDevice(rules.protocol, context, lambda data: self._reply(data, False))
        self._runs_on = rules.robot.runs_on

    def _watch(self, event: Event) -> None:
        """Tell the device of contacts and other ends of its runs, too."""
        super()._watch(event)
        if isinstance(self._device, DialectDevice):
            note_motion(event, self._device)
        if isinstance(event, ActionDone) and event.restarts:
            self._wire.flush()  # its times are those of the run before
            has_program = self._driver is not None and self._context.backend.byte_robot is None
            if has_program and isinstance(self._device, DialectDevice):
                self._device.begin_streams()

    def _joined(self, baud: float | None) -> None:
        backend = self._context.backend
        backend.program = self._pass_on
        if backend.byte_robot is None:
            self._device.opened()
        else:
            backend.byte_robot.joined(baud)

    def _set_rate(self, baud: float) -> None:
        if not self._instant:
            self._wire.set_baud(baud)

    def send(self, data: bytes) -> None:
        """Send bytes of the program to the robot."""
        robot = self._context.backend.byte_robot
        if robot is not None:
            robot.wrote(data)
        else:
            self._wire.transmit(data, self._device.received)

    def _flush(self) -> None:
        self._wire.flush()

    def _left(self, endpoint: SerialEndpoint) -> None:
        if self._sent_by_itself > LOGGED_OF_STREAM:
            more = self._sent_by_itself - LOGGED_OF_STREAM
            text = f"{more} further messages of streams were sent, and not logged one by one"
            self.engine.tell(Notice(NoticeKind.ROBOT, text, endpoint.peer))
        self._sent_by_itself = 0
        backend = self._context.backend
        backend.program = None
        if backend.byte_robot is not None:
            backend.byte_robot.left()
        self._device.closed()
        self._host.close(runs_on=self._runs_on)

    def _kind_of_unread(self, unread: int) -> NoticeKind:
        # Nobody reads the last messages of a stream.
        return NoticeKind.FAULT if unread > self._since_reply else NoticeKind.ROBOT

    def _reply(self, data: bytes, droppable: bool) -> None:
        """Send bytes of the robot to the program; without a program they are dropped."""
        program = self._driver
        if program is None or not data:
            return
        delay = self._wire.delay(len(data), droppable=droppable)
        if delay is None:
            if self._wire.left_out == 1:
                self.engine.tell_fault("dialect: the line is slower than the stream: messages are left out")
            return
        self._has_exchanged = True
        self._sent_by_itself += droppable
        self._since_reply = self._since_reply + len(data) if droppable else 0
        if not droppable or self._sent_by_itself <= LOGGED_OF_STREAM:
            self.engine.tell(WireMessage(self.engine.now(), data.decode("latin-1"), reply=True))
        scale = self.engine.time_scale
        program.deliver(self._loop.time() + delay / scale, self._wire.byte / scale, data)

    def _pass_on(self, data: bytes) -> None:
        """Send bytes of a real robot to the program, as they come."""
        if self._driver is not None:
            self._has_exchanged = True
            self._driver.deliver(self._loop.time(), 0.0, data)
