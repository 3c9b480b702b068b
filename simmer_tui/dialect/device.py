"""The robot's own program, played by the rules of a dialect.toml: bytes in, commands and bytes out."""

import math
import struct
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from msgspec import Struct, field

from simmer_tui.dialect.dialect_rules import (
    AnyReply,
    AssignStep,
    Busy,
    DialectRules,
    MessageRule,
    PauseStep,
    RunStep,
    Step,
    StopStep,
    StreamRule,
    Velocity,
    expressions_of,
    scaled,
)
from simmer_tui.dialect.expressions import (
    Expression,
    FieldValue,
    FieldValues,
    bounded_text,
    finite,
    listed_codes,
    scan_bearings,
)
from simmer_tui.dialect.fault_notices import UNKNOWN_MESSAGE, FaultNotices
from simmer_tui.dialect.frames import Deframer, Frame, Noise
from simmer_tui.dialect.messages import nearest
from simmer_tui.dialect.templates import LONGEST_REPLY, BinaryReply
from simmer_tui.dialect.timer import Timer
from simmer_tui.errors import ExpressionError
from simmer_tui.sim.command import counted, cut
from simmer_tui.sim.sensors import Lidar, sensor_of

# Bytes of noise that a notice shows, so that it fits in a line of the event list.
_SHOWN = 60
# A busy machine delays a process by some tenths of a second. After a machine has slept, the messages of that
# time are useless.
LATEST = 1.0
"""Seconds by which a message of a stream may be late; later ones are not sent."""
WATCHDOG = "watchdog"
"""Source of the end of a run, or velocity, that `halts_after` ends."""


class MoveEnd(Struct, frozen=True):
    """End of a movement of known length."""

    refused: str = ""
    """The reason why it did not begin; empty if it did."""
    touched: bool = False
    """True if it met an obstacle."""
    stopped: bool = False
    """True if it ended neither by itself nor by an obstacle, but was stopped."""
    lasts: bool | None = None
    """True if it set a velocity that lasts until something ends it, False if another one; None if it set
    none."""


class DeviceHost(Protocol):
    """The robot and the wire of a device. Times are simulated seconds."""

    @property
    def now(self) -> float: ...

    def call_later(self, seconds: float, call: Callable[[], None]) -> Timer: ...

    def read(self, codes: Sequence[str], done: Callable[[FieldValues], None]) -> None:
        """Read sensors now; `done` is called when their Read Times are over."""

    def move(self, command: str, done: Callable[[MoveEnd], None]) -> None:
        """Do a movement of known length."""

    def drive(self, velocity: Velocity | None, seconds: float | None) -> str:
        """Drive at a velocity (in/s, in/s, deg/s) for a time, or until the next command. Returns the reason
        it is refused, or an empty text."""

    def halt(self, by: str = "") -> None:
        """End all motion; `by` is the source, if it is not a message."""

    def send(self, data: bytes, *, droppable: bool = False) -> None:
        """Send bytes to the program. `droppable` ones are left out if too many bytes wait."""

    def done(self, message: bytes, meaning: str) -> None:
        """Tell that a message was received, with its meaning."""

    def tell(self, text: str) -> None:
        """Tell a fault of the program, or of the rules."""

    def inform(self, text: str) -> None:
        """Tell a fact that is a fault of neither."""


class _Task(Struct, eq=False):
    """A message of `size` bytes that is being carried out: its values, and its remaining steps."""

    rule: MessageRule
    values: FieldValues
    size: int
    steps: Iterator[Step]
    touched: bool = False
    over: bool = False
    timer: Timer = field(default_factory=Timer)
    velocity: Velocity | None = None
    """Velocity of the run under way: in/s, in/s, deg/s."""


class _TaskScope(Struct):
    """The names of an expression."""

    device: "DialectDevice"
    values: FieldValues
    touched: bool = False

    def value(self, name: str) -> FieldValue:
        if name in self.values:
            return self.values[name]
        if name == "contact":
            return int(self.touched)
        if name == "time":
            return self.device.host.now
        return self.device.state[name]

    def call(self, function: str, arguments: Sequence[FieldValue]) -> FieldValue:
        if function == "named":
            return self.device.named(listed_codes(arguments[0]), self.values)
        return self.device.sense(function, arguments, self.values)


class DialectDevice:
    """Plays a robot by its rules.

    Args:
        rules: The rules.
        host: The robot and the wire.
        observer: Called with the rule and the values of each message before it is carried out.
        cut_short: Called with the values of a message that is lost, or ended by something else: some of its
            replies are not sent.
    """

    def __init__(
        self,
        rules: DialectRules,
        host: DeviceHost,
        observer: Callable[[MessageRule, FieldValues], None] = lambda rule, values: None,
        cut_short: Callable[[FieldValues], None] = lambda values: None,
    ) -> None:
        self._observer = observer
        self._cut_short = cut_short
        self.host = host
        self.state: dict[str, FieldValue] = dict(rules.state)
        self._rules = rules
        made = {code: sensor_of(spec) for code, spec in rules.parts.lidars.items()}
        self._lidars = {code: each for code, each in made.items() if isinstance(each, Lidar)}
        self._deframer = Deframer(rules.framing, rules.types)
        self._booting = Timer()
        """The end of the robot's boot; received bytes are lost until then."""
        self._silence, self._watchdog = Timer(), Timer()
        self._streams: dict[int, Timer] = {}
        """The next message of each stream, by its place in the rules."""
        self._begun = 0.0
        """The time when they began."""
        self._moving: _Task | None = None
        self._asked: _Task | None = None
        """The message without a movement that is being carried out."""
        self._waiting: deque[_Task] = deque()
        self._questions: deque[_Task] = deque()
        """Waiting messages: with a movement (`_waiting`), and without."""
        self._runs = False
        """True while an untimed run is under way."""
        self._lasts = False
        """True while the velocity of a command lasts."""
        self._faults = FaultNotices(host.tell)
        self._facts = FaultNotices(host.inform)

    @property
    def unfinished(self) -> bool:
        """True if a message has been received in part."""
        return self._deframer.unfinished

    @property
    def moves(self) -> bool:
        """True while a message with a movement is carried out, or an untimed run is under way."""
        return self._moving is not None or self._runs

    @property
    def doing(self) -> FieldValues | None:
        """The values of the message whose movement is under way, the same object that `observer` got."""
        return self._moving.values if self._moving is not None else None

    # -- the wire ----------------------------------------------------------------------------------

    def opened(self) -> None:
        """Called when a program opens the port."""
        boot = self._rules.robot.boot
        if boot:
            self._booting = self.host.call_later(boot, self._boot)
        else:
            self._boot()

    def _boot(self) -> None:
        if self._rules.robot.greeting:
            self.host.send(self._rules.robot.greeting.encode())
        self.begin_streams()

    def begin_streams(self) -> None:
        """Begin all streams, also when simulated time begins again."""
        for timer in self._streams.values():
            timer.cancel()
        self._begun = self.host.now
        for index, stream in enumerate(self._rules.streams):
            self._next_tick(index, stream, 0)

    def closed(self) -> None:
        """Called when the program closes the port."""
        for noise in self._deframer.end():
            self._tell_noise(noise)
        self._faults.end()
        self._facts.end()
        for timer in (*self._streams.values(), self._silence, self._booting):
            timer.cancel()
        if self._runs and not self._rules.robot.runs_on:
            self._halt()

    def run_touched(self) -> None:
        """Called when the robot meets something in a continuous motion."""
        if self._moving is not None and self._moving.velocity is not None:
            self._moving.touched = True

    def velocity_ended(self, *, by_others: bool = False) -> None:
        """Called when a velocity has ended, or a person has set another one. `by_others` is True unless its
        time was over or its program has left: a run under way is then broken off. The movements and stops of
        messages end velocities too, when no run is under way any more."""
        self._runs = self._lasts = False
        if by_others and self._moving is not None and self._moving.velocity is not None:
            self._drop_waiting()
            self._break_off(self._moving)
            self._go_on()

    def received(self, data: bytes) -> None:
        """Called with received bytes."""
        if self._booting.pending:
            boot = self._rules.robot.boot
            what = f"the robot boots for {boot:g} s after the port was opened"
            self._faults.note(
                f"'{cut(data.decode('utf-8', 'surrogateescape'), _SHOWN)}' is lost: {what}", alike="boot"
            )
            return
        self._rest_watchdog()
        self._take(self._deframer.receive(data))
        self._silence.cancel()
        silence = self._rules.framing.silence
        if silence and self._deframer.unfinished:
            self._silence = self.host.call_later(silence, lambda: self._take(self._deframer.silence()))

    def _take(self, parts: Sequence[Frame | Noise]) -> None:
        for part in parts:
            if isinstance(part, Noise):
                self._tell_noise(part)
            else:
                self._message(part)

    def _tell_noise(self, noise: Noise) -> None:
        shown = cut(noise.data[:_SHOWN].decode("utf-8", "surrogateescape"), 4 * _SHOWN)
        more = f" and {len(noise.data) - _SHOWN} more" if len(noise.data) > _SHOWN else ""
        dropped = f"{counted(len(noise.data), 'byte')} dropped, {noise.why}"
        self._faults.note(f"{dropped}: '{shown}'{more}", alike=noise.why)

    def _rest_watchdog(self) -> None:
        self._watchdog.cancel()
        after = self._rules.robot.halts_after
        if after:
            self._watchdog = self.host.call_later(after, self._fell_silent)

    def _fell_silent(self) -> None:
        if self._runs or self._lasts:
            silence = f"nothing has come for {self._rules.robot.halts_after:g} s"
            self._facts.note(f"{silence}: the robot stops (halts_after)")
            self._halt(source=WATCHDOG)

    # -- messages ----------------------------------------------------------------------------------

    def _message(self, frame: Frame) -> None:
        text = frame.text
        found = self._rules.found(
            frame,
            lambda values: _TaskScope(self, {"text": text, **values}),
            lambda rule, error: self._faults.note(f"{rule.place}: if: {error}"),
        )
        if found is None:
            hint = nearest(text, self._rules)
            self.host.done(frame.data, UNKNOWN_MESSAGE + hint)
            self._faults.note(f"'{cut(text)}' is no message of the dialect{hint}", alike=("?", text))
            self._send(self._rules.unknown, {"text": text}, ": reply")
            return
        rule, values = found
        values.setdefault("text", text)
        task = _Task(rule, values, len(frame.data), iter(rule.steps))
        self.host.done(frame.data, rule.shown)
        self._observer(rule, values)
        self._admit(task)

    def _admit(self, task: _Task) -> None:
        """Begin a message, queue it, drop it, or let it replace others, by its `busy`."""
        rule, robot = task.rule, self._rules.robot
        usual = robot.reads
        if rule.moves:
            usual = Busy.NOW if rule.stops else robot.busy
        policy = rule.busy or usual
        if not self._is_blocked(rule, policy):
            self._begin(task)
        elif policy is Busy.DROP:
            self._faults.note(f"'{rule.shown}' is lost: the robot is busy")
            self._cut_short(task.values)
        elif policy is Busy.REPLACE:
            self._replace(task)
        else:
            self._wait(task, self._waiting if rule.moves else self._questions)

    def _is_blocked(self, rule: MessageRule, policy: Busy) -> bool:
        """True if a message may not begin now, because of the messages under way."""
        asked, moving = self._asked is not None, self._moving is not None
        if policy is Busy.NOW:
            # If "now" is only the robot's default, questions are answered one after the other.
            return asked and not rule.moves and rule.busy is None
        return moving or (asked and (not rule.moves or self._rules.robot.reads is Busy.WAIT))

    def _wait(self, task: _Task, queue: deque[_Task]) -> None:
        held = sum(each.size for each in (*self._waiting, *self._questions))
        buffer = self._rules.robot.buffer
        if held + task.size > buffer:
            what = f"{held} bytes wait already, and the robot's buffer has {buffer}"
            self._faults.note(f"'{task.rule.shown}' is lost: {what}", alike="buffer")
            self._cut_short(task.values)
            return
        queue.append(task)

    def _replace(self, task: _Task) -> None:
        """End the movement under way, drop waiting messages, and begin another."""
        before = self._moving
        if before is not None and self._goes_on(before, task):
            self._drop_waiting()
            self._cut_short(before.values)
            self._end(before)
        else:
            self._halt()
        self._begin(task)

    def _goes_on(self, before: _Task, task: _Task) -> bool:
        """True if a message runs the drive that already runs: it then continues without a new start."""
        first = next(iter(task.rule.steps), None)
        if before.velocity is None or not isinstance(first, RunStep) or task.rule.takes is not None:
            return False
        try:
            return self._velocity(first, _TaskScope(self, task.values)) == before.velocity
        except ExpressionError:
            return False

    def _begin(self, task: _Task) -> None:
        """Begin a message."""
        if task.rule.moves:
            if not task.rule.stops:
                self._moving = task
        else:
            self._asked = task
        rule, takes = task.rule, 0.0
        try:
            if rule.takes is not None:
                takes = rule.takes.number(_TaskScope(self, task.values, task.touched))
        except ExpressionError as error:
            self._give_up(task, f"{rule.place}: takes: {error}")
            return
        if takes > 0:
            task.timer = self.host.call_later(takes, lambda: self._answer(task))
        else:
            self._answer(task)

    def _answer(self, task: _Task) -> None:
        if task.rule.moves:
            self._reply(task, task.rule.reply)
            self._next_step(task)
        else:
            self._reply(task, task.rule.reply, then=lambda: self._next_step(task))

    def _next_step(self, task: _Task) -> None:
        """Do the next step; after the last one the message is over."""
        task.velocity = None
        while not task.over:
            step = next(task.steps, None)
            if step is None:
                self._finish(task)
                return
            codes = self._sensors_in(expressions_of(step), task.values)
            if codes:
                self._read(codes, lambda values, step=step: self._with_readings(task, step, values))  # type: ignore[misc]
                return
            if not self._do(task, step, task.values):
                return

    def _with_readings(self, task: _Task, step: Step, readings: FieldValues) -> None:
        if not task.over and self._do(task, step, {**task.values, **readings}):
            self._next_step(task)

    def _do(self, task: _Task, step: Step, values: FieldValues) -> bool:
        """Do a step. True if the next one follows at once."""
        scope = _TaskScope(self, values, task.touched)
        try:
            if isinstance(step, AssignStep):
                self.state[step.name] = step.expression.value(scope)
            elif isinstance(step, StopStep):
                self._halt(task)
            elif isinstance(step, PauseStep):
                return self._pause(task, step.seconds.number(scope))
            elif isinstance(step, RunStep):
                return self._run(task, step, scope)
            else:
                command = step.command.text(scope, "inf")
                self.host.move(command, lambda movement: self._moved(task, movement))
                return False
        except ExpressionError as error:
            self._give_up(task, f"{task.rule.place}: do: {error}")
            return False
        return True

    def _pause(self, task: _Task, seconds: float) -> bool:
        """Do the next step after some seconds. True if it follows at once."""
        if not seconds > 0:
            return True
        task.timer = self.host.call_later(seconds, lambda: self._next_step(task))
        return False

    def _run(self, task: _Task, step: RunStep, scope: _TaskScope) -> bool:
        velocity = self._velocity(step, scope)
        seconds = step.seconds.number(scope) if step.seconds is not None else None
        if seconds is not None and not seconds > 0:
            return True
        task.velocity = velocity if seconds is not None else None
        refused = self.host.drive(velocity, seconds)
        if refused:
            self._give_up(task, f"'{task.rule.shown}' at {task.rule.place}: {refused}")
            return False
        self._runs, self._lasts = seconds is None, False
        if seconds is None:
            return True
        return self._pause(task, seconds)

    def _velocity(self, step: RunStep, scope: _TaskScope) -> Velocity:
        """The velocity of a run. Raises ExpressionError."""
        drive = step.drive.text(scope, "")
        speed = self._rules.parts.speeds.get(drive.removeprefix("-"))
        if speed is None:
            raise ExpressionError(
                f"'{cut(drive)}' is no drive; there are {', '.join(self._rules.parts.speeds)}"
            )
        return scaled(speed, -1.0 if drive.startswith("-") else 1.0)

    def _moved(self, task: _Task, movement: MoveEnd) -> None:
        if task.over:
            return
        task.touched = task.touched or movement.touched
        if movement.lasts is not None:
            self._runs, self._lasts = False, movement.lasts
        if movement.refused:
            self._give_up(task, f"'{task.rule.shown}' at {task.rule.place}: {movement.refused}")
        elif movement.stopped:  # by people, or the end of the run
            self._drop_waiting()
            self._break_off(task)
            self._go_on()
        else:
            self._next_step(task)

    # -- ends --------------------------------------------------------------------------------------

    def _finish(self, task: _Task) -> None:
        self._end(task)
        self._reply(task, task.rule.done)
        self._go_on()

    def _break_off(self, task: _Task) -> None:
        """End a message that a stop or another message has interrupted."""
        self._cut_short(task.values)
        self._end(task)
        self._reply(task, task.rule.stopped)

    def _give_up(self, task: _Task, fault: str) -> None:
        """End a message that cannot be carried out."""
        self._faults.note(fault)
        self._cut_short(task.values)
        self._end(task)
        self._go_on()

    def _end(self, task: _Task) -> None:
        task.over = True
        task.timer.cancel()
        if self._moving is task:
            self._moving = None
        if self._asked is task:
            self._asked = None

    def _go_on(self) -> None:
        """Begin waiting messages."""
        ready = self._rules.robot.reads is Busy.NOW or self._moving is None
        if ready and self._asked is None and self._questions:
            self._begin(self._questions.popleft())
        if self._moving is None and self._waiting:
            self._begin(self._waiting.popleft())

    def _halt(self, by: _Task | None = None, source: str = "") -> None:
        """Stop, perhaps as a step of a message: end the motion, and drop waiting messages."""
        self._drop_waiting()
        task = self._moving
        if task is not None and task is not by:
            self._break_off(task)
        self._runs = self._lasts = False
        self.host.halt(source)

    def _drop_waiting(self) -> None:
        """Drop waiting messages with a movement."""
        dropped, self._waiting = self._waiting, deque()
        for task in dropped:
            self._cut_short(task.values)

    # -- replies -----------------------------------------------------------------------------------

    def _reply(
        self, task: _Task, replies: Sequence[AnyReply], then: Callable[[], None] = lambda: None
    ) -> None:
        self._send(replies, task.values, f"{task.rule.place}: reply", touched=task.touched, then=then)

    def _send(
        self,
        replies: Sequence[AnyReply],
        values: FieldValues,
        place: str,
        *,
        touched: bool = False,
        droppable: bool = False,
        then: Callable[[], None] = lambda: None,
    ) -> None:
        """Send replies, then call `then`: at once, or when their sensors have been read. `place` is
        `FILE:LINE`."""
        codes = self._sensors_in([each for reply in replies for each in reply.expressions], values)

        def made(readings: FieldValues) -> None:
            try:
                for data in self._bounded(replies, {**values, **readings}, touched):
                    self.host.send(data, droppable=droppable)
            except ExpressionError as error:
                self._faults.note(f"{place}: {error}")
            then()

        if codes:
            self._read(codes, made)
        else:
            made({})

    def _read(self, codes: Sequence[str], done: Callable[[FieldValues], None]) -> None:
        """Read sensors. A yes or no is a whole number, as a robot's digitalRead() gives it."""
        yes_or_no = self._rules.parts.yes_or_no

        def read(values: FieldValues) -> None:
            whole = {code: round(value) for code, value in values.items()
                     if code in yes_or_no and isinstance(value, float) and math.isfinite(value)}  # fmt: skip
            done({**values, **whole})

        self.host.read(codes, read)

    def _sensors_in(self, expressions: Sequence[Expression], values: FieldValues) -> tuple[str, ...]:
        """The sensors that expressions read. Those of `named` are in the message, in the state, or in the
        expression."""
        found = dict.fromkeys(self._rules.sensors_in(expressions))
        for each in expressions:
            if "named" not in each.sensing:
                continue
            lists = [values.get(name, self.state.get(name, "")) for name in each.names]
            asked = [code for text in (*lists, *each.texts) for code in listed_codes(text)]
            found |= dict.fromkeys(code for code in asked if code in self._rules.parts.readable)
        return tuple(found)

    def sense(self, function: str, arguments: Sequence[FieldValue], readings: FieldValues) -> FieldValue:
        """The result of ray or scan, from the lidar that they use. Raises ExpressionError."""
        code = next(iter(self._rules.parts.behind.get(function, ())), "")
        lidar, ranges = self._lidars.get(code), readings.get(code)
        if lidar is None or not isinstance(ranges, tuple):
            raise ExpressionError(f"{function}() has no reading of a lidar")
        if function == "ray":
            return ranges[lidar.nearest_ray(finite(arguments, function)[0])]
        bearings = scan_bearings(arguments)
        return tuple(ranges[lidar.nearest_ray(each)] for each in bearings)

    def named(self, codes: Sequence[str], readings: FieldValues) -> str:
        """`u0:3.00,u1:12.50`: readings with the codes of their request. Raises ExpressionError."""
        items = []
        for code in codes:
            value = readings.get(code) if code in self._rules.parts.readable else None
            is_number = isinstance(value, int | float) and math.isfinite(value)
            items.append(f"{code}:{value:.2f}" if is_number else f"{code}:{self._rules.missing}")
        return bounded_text(",".join(items))

    def _bounded(self, replies: Sequence[AnyReply], values: FieldValues, touched: bool) -> Iterator[bytes]:
        """The bytes of replies, up to a limit. Raises ExpressionError."""
        size = 0
        for reply in replies:
            for data in self._encoded(reply, values, touched):
                size += len(data)
                if size > LONGEST_REPLY:
                    raise ExpressionError(f"the replies to a message go up to {LONGEST_REPLY} bytes")
                yield data

    def _encoded(self, reply: AnyReply, values: FieldValues, touched: bool) -> Iterator[bytes]:
        """The bytes of a reply. Raises ExpressionError."""
        missing = self._rules.missing
        if not isinstance(reply, BinaryReply):
            text = reply.text(_TaskScope(self, values, touched), missing) + self._rules.reply_end
            yield text.encode("utf-8", "surrogateescape")
            return
        for count in range(reply.times):
            content = reply.content(_TaskScope(self, {**values, "k": count}, touched), missing)
            try:
                yield self._rules.framing.frame(reply.type, content)
            except struct.error as error:
                raise ExpressionError(f"{len(content)} bytes do not fit the frame: {error}") from None

    # -- streams -----------------------------------------------------------------------------------

    def _next_tick(self, index: int, stream: StreamRule, tick: int) -> None:
        # Each at its own multiple of the period: messages that a busy machine has delayed are sent at once.
        left = self._begun + (tick + 1) * stream.every - self.host.now
        if left < -LATEST:
            skipped = math.floor(-left / stream.every)
            tick, left = tick + skipped, left + skipped * stream.every
            what = f"{skipped} messages of a stream that were more than {LATEST:g} s late are left out"
            self._facts.note(what, alike=("late", index))
        self._streams[index] = self.host.call_later(max(left, 0.0), lambda: self._tick(index, stream, tick))

    def _tick(self, index: int, stream: StreamRule, tick: int) -> None:
        # A restart makes all calls that are still to come at once, and a stream has no last one.
        if self._begun + (tick + 1) * stream.every - self.host.now > stream.every / 2:
            return
        self._next_tick(index, stream, tick + 1)
        values: dict[str, FieldValue] = {"tick": tick}
        try:
            if stream.condition is not None and not stream.condition.value(_TaskScope(self, values)):
                return
        except ExpressionError as error:
            self._faults.note(f"{stream.place}: if: {error}")
            return
        self._send(stream.send, values, f"{stream.place}: send", droppable=True)
