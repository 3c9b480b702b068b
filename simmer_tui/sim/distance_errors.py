"""Errors of continuous motion, which depend on the distance driven, not on commands.

Repeating a velocity fifty times a second must not make driving more exact. So each kind of movement (forward,
back, left, right, turning) has a distance of its own, cut into stretches. Stretch j has error rates that
follow a first-order autoregressive process (Box and Jenkins, Time Series Analysis):

    r_0 = e_0,   r_j = phi r_(j-1) + sqrt(1 - phi^2) e_j,   phi = exp(-1 / n)

with n stretches a `CELL_SIZE` (or a quarter turn) and e_j normal draws for x, y and turning. Scaled by

    c = n / sqrt(n + 2 sum over m from 1 to n - 1 of (n - m) phi^m)

the spread over a cell is that of one movement of a cell. The process is stationary, so that the place in a
stretch where a program begins does not matter.
"""

import math
from collections.abc import Iterable, Mapping

import numpy as np
from msgspec import Struct
from msgspec.structs import astuple

from simmer_tui.sim.arcs import Twist
from simmer_tui.sim.device_faults import faults_of
from simmer_tui.sim.noise import distance_stream
from simmer_tui.sim.sensors import CountingSensor
from simmer_tui.sim.specs import CELL_SIZE, Axes, DriveKind, DriveSpec

REFERENCE_TURN = 90.0
"""Degrees of turning over which errors have the spread of one movement by this angle: a corner of the
maze."""
_NO_DRAWS = (0.0, 0.0, 0.0)


AXIS_KINDS = (
    (DriveKind.RIGHT, DriveKind.LEFT),
    (DriveKind.UP, DriveKind.DOWN),
    (DriveKind.ROT, DriveKind.ROT),
)
"""For x, y and turning: the kinds of movement of a positive value and of a negative one."""


class Component(Struct, frozen=True):
    """One kind of movement within a twist: its row, and its signed speed with Gain, in/s or deg/s. Its
    distance grows by `commanded_speed`, which has no sign."""

    drive: DriveSpec
    speed: float
    commanded_speed: float


def components(twist: Twist, drives: Mapping[DriveKind, DriveSpec]) -> tuple[Component, ...]:
    """The kinds of movement in a twist. A direction without a row uses the negative of the opposite row. With
    neither row it is driven without error and left out."""
    parts = []
    for value, (ahead, back) in zip(astuple(twist), AXIS_KINDS, strict=True):
        if value:
            drive = drives.get(ahead if value > 0.0 else back) or drives.get(back if value > 0.0 else ahead)
            if drive is not None:
                parts.append(Component(drive, value * drive.gain, abs(value)))
    return tuple(parts)


class _Stretch(Struct):
    """The present stretch of one kind of movement."""

    driven: float = 0.0
    """Inches or degrees of the stretch driven so far."""
    rates: tuple[float, float, float] = _NO_DRAWS
    """Error rates r_j of x, y and turning."""
    first: bool = True
    """True until the first stretch has been drawn."""
    drawn: bool = False
    """True if its draws have been made."""
    counting: dict[str, tuple[float, float]] = {}
    """Draws of odometers (turning, rolling) and gyros (twice the same), by sensor ID."""


def stretches_per_second(drives: Iterable[DriveSpec], segments: int) -> float:
    """The most stretches of errors that a robot begins in a second: all its drives are at their speed."""
    speeds = {each.kind: each.speed for each in drives if each.enabled}
    lengths = (CELL_SIZE, CELL_SIZE, REFERENCE_TURN)
    pairs = zip(AXIS_KINDS, lengths, strict=True)
    return segments * sum(max(speeds.get(kind, 0.0) for kind in kinds) / length for kinds, length in pairs)


class DistanceErrors:
    """The errors of a robot's velocity, drawn stretch by stretch from streams of their own."""

    def __init__(
        self, segments: int, streams: "Mapping[str, np.random.Generator]", sensors: Iterable[CountingSensor]
    ) -> None:
        """`segments` stretches make a cell or a quarter turn."""
        self._streams = streams
        self.sensors = tuple(sensors)
        """The odometers and gyros that count the motion."""
        self._stretches: dict[DriveKind, _Stretch] = {}
        self._lengths = {True: REFERENCE_TURN / segments, False: CELL_SIZE / segments}
        self._phi = math.exp(-1.0 / segments)
        together = sum((segments - m) * self._phi**m for m in range(1, segments))
        self._scale = segments / math.sqrt(segments + 2.0 * together)

    def length(self, kind: DriveKind) -> float:
        """Length of a stretch, inches or degrees."""
        return self._lengths[kind.turns]

    def begin(self, part: Component) -> None:
        """Draw the errors of a movement kind's stretch that have not been drawn yet, before it continues."""
        stretch = self._stretches.setdefault(part.drive.kind, _Stretch())
        if stretch.drawn:
            return
        kind = part.drive.kind
        drawn = self._streams[distance_stream("drive", kind)].standard_normal(3).tolist()
        if stretch.first:
            rates = drawn
        else:
            fresh = math.sqrt(1.0 - self._phi * self._phi)
            rates = [self._phi * old + fresh * new for old, new in zip(stretch.rates, drawn, strict=True)]
        stretch.rates = (rates[0], rates[1], rates[2])
        for sensor in self.sensors:
            stream = self._streams[distance_stream(sensor.id, kind)]
            draws = stream.standard_normal(2 if sensor.slips else 1).tolist()
            stretch.counting[sensor.id] = (draws[0], draws[-1])
        stretch.first, stretch.drawn = False, True

    def left(self, part: Component) -> float:
        """Seconds until the present stretch of a kind of movement ends."""
        stretch = self._stretches[part.drive.kind]
        return (self.length(part.drive.kind) - stretch.driven) / part.commanded_speed

    def advance(self, parts: Iterable[Component], seconds: float, ended: Iterable[DriveKind]) -> None:
        """Count some seconds of driving, exactly to the end of the stretches of the kinds `ended`."""
        # Not added up: a sum would miss the end by rounding, and leave a stretch of almost 0.
        over = frozenset(ended)
        for part in parts:
            stretch = self._stretches[part.drive.kind]
            if part.drive.kind in over:
                stretch.driven, stretch.drawn = 0.0, False
            else:
                stretch.driven += part.commanded_speed * seconds

    def rates(self, kind: DriveKind) -> tuple[float, float, float]:
        """The error rates c r of the present stretch of a kind of movement: x, y and turning."""
        x, y, r = self._stretches[kind].rates
        return self._scale * x, self._scale * y, self._scale * r

    def draws(self, kind: DriveKind, sensor: CountingSensor) -> tuple[float, float]:
        """The draws of a sensor for the turning and the rolling of the present stretch."""
        return self._stretches[kind].counting[sensor.id]


class TrueVelocity:
    """The true velocity of a robot with a commanded twist. Each kind of movement in it adds its speed d on
    its own axis and errors d (B + (1 + B) P c r) on every axis."""

    def __init__(
        self,
        twist: Twist,
        parts: Iterable[Component],
        errors: DistanceErrors,
        bias: Mapping[DriveKind, Axes],
        *,
        noise: bool,
    ) -> None:
        self._errors = errors
        self._noise = noise
        self._exact = twist
        """The components without a row of drive.csv: they have no errors."""
        for part in parts:
            self._exact = _without(self._exact, part.drive.kind)
        self._true = [(part.drive.kind, self._of(part, bias.get(part.drive.kind, Axes()))) for part in parts]
        self.whole = _sum([self._exact, *(true for _, true in self._true)])
        """The velocity with all errors."""
        self.own = _sum([self._exact, *(own_axis(true, kind) for kind, true in self._true)])
        """The velocity with only those errors of each kind of movement that are on its own axis."""

    def _of(self, part: Component, bias: Axes) -> Twist:
        drive, speed = part.drive, part.speed
        rates = self._errors.rates(drive.kind) if self._noise else _NO_DRAWS
        x, y, r = (
            speed * (b + (1.0 + b) * error * rate)
            for b, error, rate in zip(astuple(bias), astuple(drive.error), rates, strict=True)
        )
        own = drive.kind.direction
        return Twist(x + speed * abs(own.x), y + speed * abs(own.y), r + speed * abs(own.r))

    def counts(self, pressed_turn: float | None = None) -> dict[str, float]:
        """Rates of odometers (in/s) and gyros (deg/s), by sensor ID. Wheels turn even if the robot does not
        move. Gyros of a pressed robot count its real turning rate, `own`'s or 0."""
        rates = {sensor.id: 0.0 for sensor in self._errors.sensors}
        for sensor in self._errors.sensors:
            with faults_of(sensor, kept=True):
                rates[sensor.id] = float(
                    self._rolled(sensor) if sensor.slips else self._turned(sensor, pressed_turn)
                )
        return rates

    def _rolled(self, sensor: CountingSensor) -> float:
        exact, error = self._exact, sensor.spec.error
        counted = sensor.counted_on(exact.r, exact.x, exact.y)
        for kind, true in self._true:
            turning, rolling = self._errors.draws(kind, sensor) if self._noise else (0.0, 0.0)
            counted += sensor.counted_on(true.r, 0.0, 0.0) * (1.0 + error * turning)
            counted += sensor.counted_on(0.0, true.x, true.y) * (1.0 + error * rolling)
        return counted

    def _turned(self, sensor: CountingSensor, pressed_turn: float | None) -> float:
        if pressed_turn == 0.0:
            return 0.0
        counted, error = self._exact.r, sensor.spec.error
        for kind, true in self._true:
            if pressed_turn is None or kind.turns:
                turning = self._errors.draws(kind, sensor)[0] if self._noise else 0.0
                counted += true.r * (1.0 + error * turning)
        return counted


def own_axis(twist: Twist, kind: DriveKind) -> Twist:
    """The component of a twist along the axis that a kind of movement is for."""
    if kind.turns:
        return Twist(r=twist.r)
    return Twist(y=twist.y) if kind.direction.y else Twist(x=twist.x)


def _without(twist: Twist, kind: DriveKind) -> Twist:
    """A twist without the component along the axis of a kind of movement."""
    own = own_axis(twist, kind)
    return Twist(twist.x - own.x, twist.y - own.y, twist.r - own.r)


def _sum(twists: Iterable[Twist]) -> Twist:
    """Twists added up, from the first to the last."""
    x = y = r = 0.0
    for twist in twists:
        x, y, r = x + twist.x, y + twist.y, r + twist.r
    return Twist(x, y, r)
