"""The bridge to a real robot: bytes of clients go to it unchanged, and its replies come back unchanged.

One command is under way at a time, so that a robot with a small buffer loses none and each reply
finds its command. The simulated robot, the twin, does the same commands as the real one.
"""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from simmer_tui.config.reply_formats import ReplyEnd, ReplyForm, ReplyFormat
from simmer_tui.config.settings import BITS_OF_A_BYTE
from simmer_tui.links.backend import Message
from simmer_tui.links.protocol.packets import STOP
from simmer_tui.links.protocol.replies import GAP, ReplyFramer, RobotAnswer, read_numbers
from simmer_tui.links.real_robot import RealRobot, as_real, real_reading
from simmer_tui.robot.sessions import Answered, Session
from simmer_tui.robot.timers import LoopTimer
from simmer_tui.run.events import NoticeKind, TwinReading
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.command import Command, counted, cut
from simmer_tui.sim.records import CommandResult, LidarScan, Reading, Status, ray_bearings
from simmer_tui.sim.simulator import Simulator
from simmer_tui.sim.velocity_commands import WAIT, parse_wait

# Robots usually do not answer a stop from a key. Judged: many times as long as a reply at 9600 baud.
STOP_TIMEOUT = 0.25
"""Seconds within which a robot may reply to a stop that no program asked for."""
# Judged: greetings come in pieces, and are reported as one line.
_REPORT_DELAY = 1.0
"""Seconds for which discarded bytes are counted before they are reported."""
# Real robots start and stop slowly, and need longer than the planned time.
ANSWER_MARGIN = 1.0
"""Seconds after its planned end until a movement without an answer no longer delays others."""
_NO_VELOCITY = "velocities are not sent to this robot: if it knows them, set velocity = true in [serial]"
_VELOCITY_IN_VAIN = (
    "if it does not move, it knows no velocities: drive by lengths, as d1-3, or set velocity = false in "
    "[serial]"
)
# A double, the longest format.
_LONGEST_NUMBER = 8
"""Bytes of a number in a scan."""
_SUFFIXES = {"none": b"", "lf": b"\n", "crlf": b"\r\n"}


class _Exchange(Struct, eq=False):
    """A message for the robot, its sender, and the callback for the reply (None if nobody waits for it)."""

    data: bytes
    commands: tuple[Command, ...]
    form: ReplyForm
    session: Session | None = None
    answered: Answered | None = None
    is_stop: bool = False
    moves: bool = False
    """True if a movement is among its commands."""
    sets_velocity: bool = False
    """True if a velocity is among the commands that the robot is sent."""
    written: bytes = b""
    due: float = math.inf
    """Time limit of its reply by the event loop's clock; set when it is sent."""
    scans: list[bool] = field(default_factory=list)
    """True for each command that asks for a whole scan."""
    simulated: list[CommandResult] = field(default_factory=list)
    pause: float = 0.0
    """Seconds until its answer, for a message that only waits."""


@dataclass(eq=False)
class SerialBridge(RealRobot):
    """A real robot as a backend. Only for the event loop it is made in.

    A message without a reply within `settings.timeout` seconds is answered in the robot's place, with NaN or
    `Not Found`. So is one under way when the port is lost. A message that comes while the port is closed
    waits for the same time for it to open.
    """

    gap: float = GAP
    """Seconds of silence that end a reply without another end."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._framer = ReplyFramer(self.gap)
        self._waiting: deque[_Exchange] = deque()
        self._under_way: deque[_Exchange] = deque()
        """Sent; more than one only when a stop overtook the others."""
        self._due = math.inf
        """End of the wait for a reply, or for the port to open, by the event loop's clock."""
        self._moving_until = -math.inf
        """Until when the robot may be in a movement that it has not answered, by the event loop's clock."""
        self._velocity_told = False
        """True once the answer to the first velocity has been reported."""
        self._gate = LoopTimer(self._advance, self._loop)
        self._deadline = LoopTimer(self._ring, self._loop)
        """A timer for `_due` or earlier. It stays from one reply to the next: a new timer for each would
        cost a tenth of a round trip."""
        self._silence = LoopTimer(lambda: self._take(self._framer.silence()), self._loop)
        self._report = LoopTimer(self._report_discarded, self._loop)
        self._last = Message(b"", (), ReplyForm(ReplyFormat.TEXT))
        """The message that a person's stop is written like."""
        self._paused: dict[_Exchange, asyncio.TimerHandle] = {}
        """Messages that wait a time of their own, and who wakes them."""
        self._begin_listening()

    def close(self) -> None:
        """Release the port; pending messages are answered in the robot's place."""
        self._end_listening()
        self._due = math.inf
        for timer in (self._deadline, self._silence, self._report, self._gate):
            timer.cancel()
        for alarm in self._paused.values():
            alarm.cancel()
        left = [*self._paused, *self._under_way, *self._waiting]
        self._paused.clear()
        self._under_way.clear()
        self._waiting.clear()
        for exchange in left:
            self._answer_in_its_place(exchange, f"{self.port} was closed")

    # -- messages -------------------------------------------------------------------------------

    def submit(self, message: Message, session: Session, answered: Answered) -> None:
        """Queue a message. One without bytes is not sent to the robot."""
        exchange = _Exchange(message.data, message.commands, message.form, session, answered)
        if _is_stop(message):
            # The robot may have another command for a stop than the dialect, such as a single character.
            exchange.is_stop = True
            if self.settings.stop != STOP:
                exchange.data = self._stop_text(message)
            self._send_stop(exchange)
            return
        self._last = message
        self._keep_from_robot(exchange)
        self._waiting.append(exchange)
        self._advance()

    def _keep_from_robot(self, exchange: _Exchange) -> None:
        """Answer commands here that a robot may not know: a sketch that reads only the first letter drives at
        wt-2."""
        commands, simulator = exchange.commands, self.engine.simulator
        # One loop for all three: this runs before each message is sent.
        waits = sets_velocity = False
        for command in commands:
            if simulator.is_drive(command):
                exchange.moves = True
            else:
                waits = waits or command.code == WAIT
                sets_velocity = sets_velocity or simulator.is_velocity(command)
        if waits:
            exchange.data = b""
            values = [parse_wait(command.argument) for command in commands if command.code == WAIT]
            exchange.pause = sum(value for value in values if isinstance(value, float))
            if len(values) < len(commands):
                reason = f"{WAIT} is answered here, not by the robot: send it in a message of its own"
                exchange.commands = tuple(replace(command, problem=reason) for command in commands)
        elif sets_velocity and not self.settings.velocity:
            exchange.data = b""
            exchange.commands = tuple(replace(command, problem=_NO_VELOCITY) for command in commands)
        else:
            exchange.sets_velocity = sets_velocity

    def urgent_part(self, message: Message) -> Message | None:
        """All of a message with a stop. None if a stop was the last message sent and is not answered yet."""
        stopping = bool(self._under_way) and self._under_way[-1].is_stop
        return message if _is_stop(message) and (self._waiting or not stopping) else None

    def append_late(self, data: bytes, session: Session) -> None:
        """Pass on a line end that came late: it ends the client's last message."""
        waiting = self._waiting[-1] if self._waiting else None
        if waiting is not None and waiting.session is session:
            waiting.data += data
        elif self._open and self.settings.suffix == "none":
            self.link.write(data)

    def forget(self, session: Session) -> None:
        """Drop the unsent messages of a client that has left, except a stop."""
        self._waiting = deque(each for each in self._waiting if each.is_stop or each.session is not session)
        for exchange in (*self._under_way, *self._waiting, *self._paused):
            if exchange.session is session:
                exchange.session = exchange.answered = None

    def stop(self) -> None:
        """Send a person's emergency stop at once, or as soon as the port opens."""
        if not self._open:
            then = "has started" if self._starting else "opens"
            self._tell(NoticeKind.FAULT, f"{self.unsent_stop}; it goes out as soon as that {then}")
        self._send_stop(_Exchange(self._stop_text(self._last), (), self._last.form, is_stop=True))

    def _send_stop(self, stop: _Exchange) -> None:
        """Send a stop ahead of waiting messages, which are dropped."""
        # The messages were meant for before the stop. Each is answered below, so that every command has a
        # reply.
        dropped, self._waiting = self._waiting, deque()
        for paused in tuple(self._paused):
            self._resume(paused)
        if self._open:
            stop.written = self._with_suffix(stop.data)
            stop.due = self._due_of(stop)
            overtaken: deque[_Exchange] = deque()
            for data in reversed(self.link.write_instead(stop.written)):
                if self._under_way and self._under_way[-1].written is data:
                    overtaken.appendleft(self._under_way.pop())
            dropped = deque(each for each in overtaken if not each.is_stop) + dropped
            stops = [*(each for each in overtaken if each.is_stop), stop]
            written = [stop.written, *(each.written for each in stops[:-1])]
            for exchange, data in zip(stops, written, strict=True):  # all stops are alike
                exchange.written = data
                self._under_way.append(exchange)
            for data in written[1:]:
                self.link.write(data)
            # Their replies come one after the other: the framer must not take the last one for the first.
            self._framer.following = len(self._under_way) - 1
        else:
            self._waiting.append(stop)
        self._moving_until = -math.inf  # a robot that was stopped moves no more
        self._simulate(stop)
        for exchange in dropped:
            self._answer_in_its_place(exchange, "not sent any more: the robot was stopped")
        if len(self._under_way) == 1 and self._under_way[0] is stop:
            self._expect(stop)
            self._set_deadline()
        self._advance()

    def _advance(self) -> None:
        """Send the next message, unless a reply is still pending."""
        # One at a time: an Arduino's serial buffer has 64 bytes, and replies name no command.
        while not self._under_way and (exchange := self._next()) is not None:
            if not exchange.data:
                self._waiting.remove(exchange)
                self._pause(exchange)
            elif not self._open:
                if self._due == math.inf:
                    self._set_deadline()
                return
            else:
                self._waiting.remove(exchange)
                self._under_way.append(exchange)
                exchange.written = self._with_suffix(exchange.data)
                # First of all: the rest is done while the robot works. Its reply comes in a later turn of the
                # event loop.
                self.link.write(exchange.written)
                self._expect(exchange)
                exchange.due = self._due_of(exchange)
                self._set_deadline()
                if not exchange.is_stop:  # the twin did a stop when it was asked for
                    self._simulate(exchange)
                    self._note_movement(exchange)
                    self._allow_for_scans(exchange)

    def _pause(self, exchange: _Exchange) -> None:
        """Answer a message that is not sent to the robot, after its wait."""
        if exchange.pause:
            self._paused[exchange] = self._loop.call_later(exchange.pause, self._resume, exchange)
            return
        self._answer_here(exchange)

    def _resume(self, exchange: _Exchange) -> None:
        """End a wait that is over, or cut."""
        alarm = self._paused.pop(exchange, None)
        if alarm is None:  # another sender, answered before this one, has sent a stop
            return
        alarm.cancel()
        self._answer_here(exchange)
        self._advance()

    def _answer_here(self, exchange: _Exchange) -> None:
        """Answer a message that the robot never gets, as its twin does."""
        self._simulate(exchange)
        results = [as_real(each, reply=each.reply) for each in exchange.simulated]
        self._finish(exchange, results, None)

    def _next(self) -> _Exchange | None:
        """The next message to send.

        At most one movement is unanswered. While it may be under way, other movements wait, with all later
        messages of their senders. Other messages are sent.
        """
        if not self._waiting:
            return None
        left = self._moving_until - self._loop.time()
        # A sender's messages after a wait are sent after it.
        kept_back: set[Session | None] = {exchange.session for exchange in self._paused}
        if left <= 0 or not self._open:
            return next((each for each in self._waiting if each.session not in kept_back), None)
        for exchange in self._waiting:
            if exchange.moves:
                kept_back.add(exchange.session)
            elif exchange.session not in kept_back:
                return exchange
        if self._gate.due == math.inf:
            self._gate.set_in(left)
        return None

    def _note_movement(self, exchange: _Exchange) -> None:
        """Compute until when a movement that has been sent may be under way: its planned time and a
        margin."""
        if exchange.moves:
            planned = sum(self._planned_time(each) for each in exchange.simulated)
            self._moving_until = self._loop.time() + planned + ANSWER_MARGIN

    def _allow_for_scans(self, exchange: _Exchange) -> None:
        """Extend the time limit of a message that has been sent: the many numbers of a scan take time on the
        line."""
        count = sum(1 + len(each.ranges) for each in exchange.simulated if each.ranges is not None)
        if count:
            exchange.due += count * _LONGEST_NUMBER * BITS_OF_A_BYTE / self.settings.baud
            self._set_deadline()

    def _planned_time(self, result: CommandResult) -> float:
        """Seconds that the robot takes for a command, as far as known; otherwise 0."""
        # In timed motion the twin has only just begun, and its clock may run at another speed.
        begun = result.status is Status.ACCEPTED
        trajectory = self.engine.simulator.trajectory if begun else result.trajectory
        return trajectory.duration if trajectory is not None else 0.0

    def _simulate(self, exchange: _Exchange) -> None:
        """Do the same commands on the twin."""
        if exchange.is_stop:
            self.engine.stop_motion("a stop for the robot")
        exchange.simulated = [self.engine.mirror(command) for command in exchange.commands]

    def _expect(self, exchange: _Exchange, *, keep: bool = False) -> None:
        form, end = self._robot_form(exchange), self.settings.reply_end
        exchange.scans = list(map(self.engine.simulator.asks_for_scan, exchange.commands))
        self._framer.following = len(self._under_way) - 1
        self._framer.expect(
            form.end if end == "auto" else ReplyEnd(end),
            max(1, len(exchange.commands)),
            keep=keep,
            scans=exchange.scans,
            byte_order=form.byte_order,
        )

    def _robot_form(self, exchange: _Exchange) -> ReplyForm:
        """Form of the robot's reply."""
        if self.settings.robot_reply == "same":
            return exchange.form
        return ReplyForm(ReplyFormat(self.settings.robot_reply), self.settings.robot_byte_order)

    def _with_suffix(self, data: bytes) -> bytes:
        suffix = _SUFFIXES[self.settings.suffix]
        return data if data.endswith(suffix) else data + suffix

    def _stop_text(self, like: Message) -> bytes:
        """The stop, written as the client writes its messages."""
        text = self.settings.stop.encode()
        if like.form.format is ReplyFormat.FRAMED and not text.startswith(b"["):
            return b"[" + text + b"]"
        return text + b"\n" if like.data.endswith(b"\n") else text

    # -- what the robot says ----------------------------------------------------------------------

    def replied(self, data: bytes) -> None:
        self._take(self._framer.receive(data))

    def _take(self, reply: bytes | None) -> None:
        while reply is not None:
            exchange = self._under_way.popleft()
            if exchange.moves:
                self._moving_until = -math.inf
            self._due = math.inf
            more = bool(self._under_way)  # else what is under way after the answer was sent just now
            self._complete(exchange, reply)
            reply = self._await_next() if more else None
        self._advance()
        self._listen_on()

    def _await_next(self) -> bytes | None:
        """Expect the reply to a message that has been sent. Returns it if it has already arrived."""
        if not self._under_way:
            return None
        self._expect(self._under_way[0], keep=True)
        self._set_deadline()
        return self._framer.receive(b"")

    def _complete(self, exchange: _Exchange, reply: bytes) -> None:
        simulator = self.engine.simulator
        reads = [
            not (simulator.is_drive(command) or simulator.is_velocity(command))
            for command in exchange.commands
        ]
        answers = read_numbers(reply, self._robot_form(exchange), reads, exchange.scans)
        results = [
            _real(simulated, answer, reads_sensor, exchange.is_stop)
            for simulated, answer, reads_sensor in zip(exchange.simulated, answers, reads, strict=True)
        ]
        if exchange.sets_velocity:
            self._tell_velocity(exchange, results)
        self._finish(exchange, results, reply if self.settings.robot_reply == "same" else None)

    def _tell_velocity(self, exchange: _Exchange, results: Sequence[CommandResult]) -> None:
        """Tell the answer to the first velocity, once. Robots that know none answer as well, often with
        success: their program drives, and nothing moves."""
        if self._velocity_told:
            return
        for result, simulated in zip(results, exchange.simulated, strict=True):
            # One that the twin refuses as well is wrong in itself.
            if not self.engine.simulator.is_velocity(result.command) or simulated.status is Status.REFUSED:
                continue
            self._velocity_told = True
            text = result.command.text
            how = f"the robot answered {result.reply:g} to {text}"
            if result.status is Status.UNANSWERED:
                how = f"{self.no_answer}: {text}"
            kind = NoticeKind.ROBOT if result.status is Status.DONE else NoticeKind.FAULT
            self._tell(kind, f"{how}; {_VELOCITY_IN_VAIN}")
            return

    def _finish(self, exchange: _Exchange, results: list[CommandResult], unchanged: bytes | None) -> None:
        """Tell all watchers, and then the client, the results of a message."""
        # A line is in a plain log when `tell` returns: a program has no reply that the log lacks.
        tell = self.engine.tell
        for result, simulated in zip(results, exchange.simulated, strict=True):
            tell(result)
            reading = result.reading
            if reading is not None:
                code = reading.sensor.code
                tell(TwinReading(result.time, result.command, code, result.reply, simulated.reply))
        if exchange.answered is not None:
            exchange.answered(results, unchanged)

    def _listen_on(self) -> None:
        self._silence.set_in(self._framer.idle_timeout)
        if self._framer.discarded and self._report.due == math.inf:
            self._report.set_in(_REPORT_DELAY)

    def _report_discarded(self) -> None:
        count, sample = self._framer.take_discarded()
        shown = cut(sample.decode("latin-1"))
        text = f"{counted(count, 'byte')} from the robot discarded, no answer to anything: '{shown}'"
        self._tell(NoticeKind.ROBOT, text)

    # -- faults -----------------------------------------------------------------------------------

    def ready(self) -> None:
        self._moving_until = -math.inf  # the robot's earlier commands are not known
        self._framer.doubt()
        self._due = math.inf
        self._advance()

    def lost(self, reason: str) -> None:
        """The port has closed, or cannot be opened. The robot's state is not known."""
        super().lost(reason)
        if self._under_way:
            self._due = math.inf
        sent, self._under_way = self._under_way, deque()
        self._mistrust()
        for exchange in sent:
            self._answer_in_its_place(exchange, reason)
        self._advance()

    def _ring(self) -> None:
        if self._loop.time() < self._due:
            self._set_timer()
            return
        self._due = math.inf
        self._mistrust()
        if self._under_way:
            late = self._under_way.popleft()
            reason = self.no_answer
            if any(each.ranges is not None for each in late.simulated):
                reason += "; a lidar's reply is its count and so many numbers"
            self._answer_in_its_place(late, reason)
            if late.sets_velocity:
                unanswered = [replace(each, status=Status.UNANSWERED) for each in late.simulated]
                self._tell_velocity(late, unanswered)
            self._take(self._await_next())
            return
        if self._starting:  # it is not closed, and its board has a time limit of its own
            self._set_deadline()
            return
        # The port has been closed for a whole time limit.
        given_up, self._waiting = self._waiting, deque()
        self._waiting.extend(each for each in given_up if each.is_stop)  # a stop is never dropped
        for exchange in given_up:
            self._answer_in_its_place(exchange, f"{self.port} is closed")

    def _mistrust(self) -> None:
        """Discard replies that are still to come, late or in halves."""
        # A late reply must never be taken for the answer to the next command.
        self._framer.abandon()
        self._framer.doubt()

    def _answer_in_its_place(self, exchange: _Exchange, reason: str) -> None:
        simulator = self.engine.simulator
        known = exchange.simulated or [_unsent(simulator, command) for command in exchange.commands]
        results = [as_real(each, status=Status.UNANSWERED, reply=math.nan, reason=reason) for each in known]
        # Removed first, so that a reply that still comes does not answer it twice.
        answered, exchange.answered = exchange.answered, None
        for result in results:
            self.engine.tell(result)
        if answered is not None:
            answered(results, None)

    def _due_of(self, exchange: _Exchange) -> float:
        """The time limit of a message that is sent now, by the event loop's clock."""
        nobody_asks = exchange.is_stop and exchange.answered is None
        return self._loop.time() + (STOP_TIMEOUT if nobody_asks else self.settings.timeout)

    def _set_deadline(self) -> None:
        """Set the time limit: that of the message under way, or, without one, for the port to open. It counts
        from when the message was sent, even if a stop has overtaken it."""
        head = self._under_way[0] if self._under_way else None
        self._due = self._loop.time() + self.settings.timeout if head is None else head.due
        self._set_timer()

    def _set_timer(self) -> None:
        # A timer that is due earlier sets itself again (see `_deadline`).
        if self._due < self._deadline.due:
            self._deadline.set_at(self._due)


def _is_stop(message: Message) -> bool:
    # A loop, not any(): this runs for each message, and a generator costs more than the comparison.
    for command in message.commands:  # noqa: SIM110
        if command.stops or command.code == STOP:
            return True
    return False


def _real(simulated: CommandResult, answer: RobotAnswer, reads_sensor: bool, is_stop: bool) -> CommandResult:
    """The simulated robot's result with the real robot's reply."""
    reading = simulated.reading
    scan = None if reading is None or isinstance(answer, float) else _real_scan(reading, answer)
    # A single number in place of a scan is the first ray's, as in the simulated robot.
    number = answer if isinstance(answer, float) else float(answer[0])
    if reading is not None:
        return as_real(simulated, reply=number, reading=real_reading(reading, number, scan))
    if is_stop:
        return as_real(simulated, status=Status.STOPPED, reply=number, reason="")
    # NaN is the refusal of a command in every dialect.
    if math.isnan(number):
        return as_real(simulated, status=Status.REFUSED, reply=number, reason="the robot answered NaN")
    status = Status.READING if reads_sensor else Status.DONE
    return as_real(simulated, status=status, reply=number, reason="")


def _real_scan(reading: Reading, ranges: FloatArray) -> LidarScan | None:
    """The real robot's scan in place of the twin's. The twin's true ranges are kept only if both have as many
    rays."""
    twin = reading.scan
    if twin is None or len(twin.ranges) == len(ranges):
        return None if twin is None else replace(twin, ranges=ranges)
    bearings = ray_bearings(twin.bearings, len(ranges))
    return LidarScan(twin.revolution, ranges, bearings, np.empty(0), np.empty((0, 3)))


def _unsent(simulator: Simulator, command: Command) -> CommandResult:
    """The result of a command that neither robot was given."""
    simulator.commands += 1
    pose = simulator.pose
    return CommandResult(simulator.commands, simulator.time, command, Status.UNANSWERED, math.nan, pose, pose)
