"""The rules of a dialect.toml: messages, their steps and their replies, and the parts of the set they use."""

import re
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from enum import StrEnum
from functools import cached_property

from msgspec import Struct, field
from msgspec.structs import replace

from simmer_tui.dialect.expressions import Expression, FieldValue, FieldValues, Scope
from simmer_tui.dialect.frames import TYPE, Frame, Framing
from simmer_tui.dialect.patterns import Pattern
from simmer_tui.dialect.templates import BinaryReply, TextReply, pack_codes, packable
from simmer_tui.errors import ExpressionError
from simmer_tui.sim.sensors import LidarSpec
from simmer_tui.sim.specs import DriveSpec, GripperSpec, SensorSpec, VelocityKind, VelocitySpec
from simmer_tui.sim.velocity_commands import WAIT

AnyReply = TextReply | BinaryReply


class Busy(StrEnum):
    """Treatment of a message while another one's steps are under way."""

    NOW = "now"
    """It is carried out at once, beside them."""
    WAIT = "wait"
    """It waits for their end, as with a sketch that uses delay()."""
    REPLACE = "replace"
    """It ends them, and drops waiting messages."""
    DROP = "drop"
    """It is dropped."""


class CourseProtocol(StrEnum):
    """A protocol of the course, spoken over a serial port: its messages need no rules."""

    PACKETS = "packets"
    """`[u0,u1]`, answered `[u0:12.3,u1:inf]`."""
    BINARY9000 = "binary9000"
    """`u0` and a newline, answered by a floating-point number."""


class MoveStep(Struct, frozen=True):
    """A command of the simulated robot, `w0-{n}`; it ends when the movement has ended."""

    command: TextReply


class RunStep(Struct, frozen=True):
    """A drive at its Speed, in the opposite direction with `-`: for `seconds`, or until it is stopped."""

    drive: TextReply
    seconds: Expression | None = None


class PauseStep(Struct, frozen=True):
    """A pause."""

    seconds: Expression


class StopStep(Struct, frozen=True):
    """The end of all motion."""


class AssignStep(Struct, frozen=True):
    """`name = expression`: a new value of the state."""

    name: str
    expression: Expression


Step = MoveStep | RunStep | PauseStep | StopStep | AssignStep


def expressions_of(step: Step) -> Sequence[Expression]:
    """The expressions of a step."""
    if isinstance(step, MoveStep):
        return step.command.expressions
    if isinstance(step, RunStep):
        return step.drive.expressions + ((step.seconds,) if step.seconds is not None else ())
    if isinstance(step, PauseStep):
        return (step.seconds,)
    return (step.expression,) if isinstance(step, AssignStep) else ()


class MessageRule(Struct, frozen=True, kw_only=True):
    """A [[command]]: the messages that it matches, and their steps.

    `place` is `FILE:LINE`. A binary rule has the `type` of its frames, and unpacks the content with the
    struct format `unpack` into `names`.
    """

    number: int
    place: str = ""
    patterns: tuple[Pattern, ...] = ()
    type: int | None = None
    unpack: str = ""
    names: tuple[str, ...] = ()
    condition: Expression | None = None
    steps: tuple[Step, ...] = ()
    takes: Expression | None = None
    reply: tuple[AnyReply, ...] = ()
    done: tuple[AnyReply, ...] = ()
    stopped: tuple[AnyReply, ...] = ()
    busy: Busy | None = None

    @property
    def moves(self) -> bool:
        """True if it has steps that take time or move the robot."""
        return any(not isinstance(step, AssignStep) for step in self.steps)

    @property
    def stops(self) -> bool:
        """True if it only stops the robot."""
        return any(isinstance(step, StopStep) for step in self.steps) and all(
            isinstance(step, StopStep | AssignStep) for step in self.steps
        )

    @property
    def expressions(self) -> Iterator[Expression]:
        """All expressions in it."""
        yield from (each for each in (self.condition, self.takes) if each is not None)
        for step in self.steps:
            yield from expressions_of(step)
        for reply in (*self.reply, *self.done, *self.stopped):
            yield from reply.expressions

    @property
    def shown(self) -> str:
        """Its messages, as they are written in the file."""
        patterns = ", ".join(each.source for each in self.patterns)
        kind = f"type {self.type}" if self.type is not None else ""
        content = f"{self.unpack}: {' '.join(self.names)}" if self.unpack else patterns
        return f"{kind}: {content}" if kind and content else kind or content

    def values(self, frame: Frame) -> dict[str, FieldValue] | None:
        """The values in a message, or None if the rule does not match it."""
        if self.type is not None and frame.head.get(TYPE) != self.type:
            return None
        if self.unpack:
            return _unpacked(self.unpack, self.names, frame.content)
        if not self.patterns:
            return {} if self.type is not None else None
        text = frame.text
        found = (pattern.match(text) for pattern in self.patterns)
        return next((values for values in found if values is not None), None)

    def example(self, number: int) -> dict[str, FieldValue]:
        """The values of a message that it matches, with this number for each packed value."""
        values: dict[str, FieldValue] = {}
        if self.unpack:
            codes = pack_codes(self.unpack)
            packed = (packable(str(number) if code in "spc" else number, code) for code in codes)
            values |= _unpacked(self.unpack, self.names, struct.pack(self.unpack, *packed)) or {}
        if self.patterns:
            values |= self.patterns[0].match(self.patterns[0].example) or {}
        return values


def _unpacked(shape: str, names: tuple[str, ...], content: bytes) -> dict[str, FieldValue] | None:
    if struct.calcsize(shape) != len(content):
        return None
    values = struct.unpack(shape, content)
    plain = (
        each.decode("latin-1") if isinstance(each, bytes) else int(each) if isinstance(each, bool) else each
        for each in values
    )
    return dict(zip(names, plain, strict=True))


class StreamRule(Struct, frozen=True):
    """A [[stream]]: messages that the robot sends by itself, every `seconds`."""

    every: float
    send: tuple[AnyReply, ...]
    condition: Expression | None = None
    place: str = ""


class RobotRules(Struct, frozen=True):
    """[robot]: properties of the robot's own program. Times are in seconds.

    `buffer` is in bytes. `halts_after` is the silence that ends an untimed run, or velocity; 0 is never. With
    `runs_on` both continue after the program has disconnected.
    """

    busy: Busy = Busy.WAIT
    reads: Busy = Busy.NOW
    buffer: int = 64
    boot: float = 0.0
    greeting: str = ""
    halts_after: float = 0.0
    runs_on: bool = False


Velocity = tuple[float, float, float]
"""x and y in in/s, rotation in deg/s, in the robot's frame."""


def scaled(velocity: Velocity, factor: float) -> Velocity:
    """A velocity times a number."""
    x, y, rotation = velocity
    return (factor * x, factor * y, factor * rotation)


class Parts(Struct, frozen=True, dict=True):
    """The parts of a set that a dialect may use. What follows from them is computed once."""

    sensors: Sequence[SensorSpec] = ()
    drives: Sequence[DriveSpec] = ()
    gripper: GripperSpec | None = None
    velocities: Sequence[VelocitySpec] = ()

    @cached_property
    def readable(self) -> frozenset[str]:
        """Codes of the sensors."""
        return frozenset(each.code for each in self.sensors if each.enabled)

    @cached_property
    def yes_or_no(self) -> frozenset[str]:
        """Codes of the sensors that read 1 or 0."""
        return frozenset(each.code for each in self.sensors if each.enabled and each.is_yes_or_no)

    @cached_property
    def lidars(self) -> dict[str, LidarSpec]:
        """The sensors whose reading is a list of numbers, by code."""
        return {each.code: each for each in self.sensors if each.enabled and isinstance(each, LidarSpec)}

    @cached_property
    def behind(self) -> dict[str, tuple[str, ...]]:
        """The codes of the sensors that ray, scan and contact read, as far as there are any."""
        found: dict[str, tuple[str, ...]] = {}
        for sensor in self.sensors:
            for function in sensor.kind.dialect_functions if sensor.enabled else ():
                found[function] = (*found.get(function, ()), sensor.code)
        return found

    @cached_property
    def speeds(self) -> dict[str, Velocity]:
        """The velocity of each drive at its Speed, by code: x and y in in/s, rotation in deg/s."""
        driven = ((each.code, each.kind.direction, each.speed) for each in self.drives if each.enabled)
        return {code: scaled((to.x, to.y, to.r), speed) for code, to, speed in driven}

    @cached_property
    def velocity(self) -> str:
        """Code of the command that sets the whole velocity; empty if the set has none."""
        rows = (each.code for each in self.velocities if each.enabled and each.kind is VelocityKind.ALL)
        return next(rows, "")

    @cached_property
    def commands(self) -> frozenset[str]:
        """Codes of all commands that a step may have."""
        codes = {WAIT, *self.speeds, *(each.code for each in self.velocities if each.enabled)}
        return frozenset(codes | ({self.gripper.code} if self.gripper and self.gripper.enabled else set()))


class DialectRules(Struct, frozen=True, kw_only=True):
    """A dialect.toml that has been checked."""

    framing: Framing = Framing()
    protocol: CourseProtocol | None = None
    """The course's protocol, if the dialect is one; then there are no rules."""
    reply_end: str = ""
    missing: str = "inf"
    robot: RobotRules = RobotRules()
    state: FieldValues = field(default_factory=dict)
    rules: tuple[MessageRule, ...] = ()
    streams: tuple[StreamRule, ...] = ()
    unknown: tuple[AnyReply, ...] = ()
    unknown_place: str = ""
    """Place of `unknown` in the file."""
    parts: Parts = Parts()
    """The sensors and commands of the set; none for the course's protocol."""

    @property
    def placed_expressions(self) -> Iterator[tuple[str, Expression]]:
        """All expressions of messages, streams and replies to unknown ones, each with its place."""
        for rule in self.rules:
            yield from ((rule.place, each) for each in rule.expressions)
        for stream in self.streams:
            if stream.condition is not None:
                yield stream.place, stream.condition
            yield from ((stream.place, each) for reply in stream.send for each in reply.expressions)
        yield from ((self.unknown_place, each) for reply in self.unknown for each in reply.expressions)

    def without_sensor(self, names: Iterable[str]) -> Iterator[tuple[str, str]]:
        """Those of some names that expressions use although no sensor provides them, with their place."""
        wanted = frozenset(names) - self.parts.behind.keys()
        for place, expression in dict.fromkeys(self.placed_expressions):
            for name in sorted(wanted & (expression.sensing | expression.names)):
                yield place, name

    def found(
        self,
        frame: Frame,
        scope: Callable[[FieldValues], Scope],
        failed: Callable[[MessageRule, ExpressionError], None] = lambda rule, error: None,
    ) -> tuple[MessageRule, dict[str, FieldValue]] | None:
        """The first rule for a message, with its values.

        Args:
            frame: The message.
            scope: Makes the names that a condition may use from the values.
            failed: Called for a rule whose condition cannot be evaluated; the rule is skipped.
        """
        for rule in self.rules:
            values = rule.values(frame)
            try:
                if values is not None and (rule.condition is None or rule.condition.value(scope(values))):
                    return rule, values
            except ExpressionError as error:
                failed(rule, error)
        return None

    @property
    def reactive(self) -> "DialectRules":
        """The rules for known messages alone, without boot, greeting, streams and replies to unknown ones."""
        return replace(self, streams=(), robot=replace(self.robot, boot=0.0, greeting=""), unknown=())

    @property
    def single(self) -> frozenset[str]:
        """The codes of the sensors whose reading is one number."""
        return self.parts.readable - self.parts.lidars.keys()

    def sensors_in(self, expressions: Sequence[Expression]) -> tuple[str, ...]:
        """The sensors that expressions read, in the order in which they are written, each once."""
        found: dict[str, None] = {}
        for each in expressions:
            words = re.findall(r"[A-Za-z_]\w*", each.source)
            found |= dict.fromkeys(
                word for word in words if word in each.names and word in self.parts.readable
            )
        for each in expressions:
            for function in (*sorted(each.sensing), *each.names):
                found |= dict.fromkeys(self.parts.behind.get(function, ()))
        return tuple(found)

    @property
    def types(self) -> frozenset[int]:
        """The types of binary frames that rules match; empty if a rule matches any type."""
        kinds = [rule.type for rule in self.rules]
        return frozenset() if None in kinds else frozenset(kind for kind in kinds if kind is not None)
