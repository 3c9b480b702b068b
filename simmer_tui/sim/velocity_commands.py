"""Commands of continuous motion: their values, and the velocity that they request.

    vv-VX;VY;OMEGA[;T]     the whole velocity         ww-W1;...;Wn[;T]     rim speeds, one a wheel
    vx-V[;T] vy-V[;T] vr-V[;T]     one component, the others as they are     wt-S     wait

Speeds are in/s and deg/s in the robot's frame. Commas are allowed as well, except in packets, where they
separate commands.
"""

import math
import re
from collections.abc import Mapping, Sequence

from msgspec import Struct
from msgspec.structs import astuple, replace

from simmer_tui.sim.arcs import Twist
from simmer_tui.sim.command import LARGEST_VALUE, parse_value
from simmer_tui.sim.distance_errors import AXIS_KINDS, components
from simmer_tui.sim.specs import DriveKind, DriveSpec, VelocityKind, VelocitySpec, WheelsSpec
from simmer_tui.sim.velocity_plan import VelocityTarget, velocity_target
from simmer_tui.sim.wheels import WheelKinematics

WAIT = "wt"
"""Code of the command that waits, in every set."""
_BETWEEN = re.compile("[;,]")
# Enough for all duties that a sketch changes between; others are parsed again.
_MOST_PARSED = 256
"""Requests that are known at a time."""
# An hour: longer than any mission. A longer wait was most likely meant in milliseconds.
MOST_WAITED = 3600.0
"""Longest wait of one command, seconds."""


class VelocityRequest(Struct, frozen=True):
    """A requested velocity, and the velocity that the robot can do. `seconds` are the time until it ends,
    infinite without a T; `slip` is each wheel's, in/s. `limited` is the share of the request that the robot
    can do; for rim speeds, the share of the wheel that is cut most."""

    target: VelocityTarget
    seconds: float = math.inf
    slip: tuple[float, ...] = ()
    limited: float = 1.0


def parse_wait(argument: str | None) -> float | str:
    """The seconds of `wt-S`, or the reason there are none."""
    value = parse_value(argument, f"{WAIT}-1")
    if isinstance(value, str):
        return value
    if 0.0 <= value <= MOST_WAITED:
        return value
    return f"{WAIT}-{value:g}: a wait has 0 to {MOST_WAITED:g} seconds"


class VelocityControl:
    """Parser of velocity commands, by a robot's rows of drive.csv and its wheels."""

    def __init__(self, drives: Sequence[DriveSpec], wheels: WheelsSpec | None) -> None:
        self._drives: Mapping[DriveKind, DriveSpec] = {each.kind: each for each in drives if each.enabled}
        self._wheels = WheelKinematics.of(wheels) if wheels is not None else None
        self._parsed: dict[tuple[object, ...], VelocityRequest | str] = {}
        """Requests of the last commands, by all that they depend on."""

    def parse(self, spec: VelocitySpec, argument: str | None, commanded: Twist) -> VelocityRequest | str:
        """The request of a command for a robot whose velocity was `commanded` before, or the reason it is
        refused."""
        # A sketch that follows a line changes between a few velocities, thousands of times a second.
        before = astuple(commanded)
        # A 0 with another sign is another velocity: runs are the same bit for bit.
        key = (
            spec.kind,
            spec.code,
            argument,
            before,
            *(math.copysign(1.0, each) for each in before if not each),
        )
        known = self._parsed.get(key)
        if known is None:
            if len(self._parsed) >= _MOST_PARSED:
                self._parsed.clear()
            known = self._parsed[key] = self._parse(spec, argument, commanded)
        return known

    def _parse(self, spec: VelocitySpec, argument: str | None, commanded: Twist) -> VelocityRequest | str:
        if spec.kind is VelocityKind.WHEELS and self._wheels is None:
            return f"{spec.code} needs the robot's wheels: [wheels] in settings.toml"
        names = _names(spec.kind, self._wheels)
        shape = _shape(spec, names)
        numbers = _numbers(argument, shape)
        if isinstance(numbers, str):
            return numbers
        if not len(names) <= len(numbers) <= len(names) + 1:
            return f"{spec.code} has {len(names)} or {len(names) + 1} values, {shape}, not {len(numbers)}"
        values, seconds = numbers[: len(names)], (*numbers[len(names) :], math.inf)[0]
        if seconds <= 0.0:
            return f"T, the seconds after which the velocity ends, must be more than 0 in {shape}"
        if spec.kind is VelocityKind.WHEELS:
            return self._of_wheels(values, seconds, commanded)
        return self._of_body(_changed(commanded, spec.kind, values), seconds, commanded)

    def _of_wheels(self, speeds: Sequence[float], seconds: float, before: Twist) -> VelocityRequest:
        assert self._wheels is not None, "rim speeds need wheels"
        asked, speeds = speeds, self._wheels.clamped(speeds)
        target = velocity_target(self._wheels.twist(speeds), before, self._drives)
        least = min((abs(made / each) for made, each in zip(speeds, asked, strict=True) if each), default=1.0)
        return VelocityRequest(target, seconds, self._wheels.slip(speeds), least)

    def _of_body(self, twist: Twist, seconds: float, before: Twist) -> VelocityRequest | str:
        problem = self._impossible(twist)
        if problem:
            return problem
        share = self._share(twist) if self._wheels is None else self._wheels.share(twist)
        # As a whole, so that its curve stays.
        made = twist.scaled(share) if share < 1.0 else twist
        return VelocityRequest(velocity_target(made, before, self._drives), seconds, limited=share)

    def _impossible(self, twist: Twist) -> str:
        """The component that the robot has no drive for, as text."""
        if twist.y and self._wheels is not None and not self._wheels.sideways:
            return "its two wheels cannot drive it sideways: VY must be 0"
        found = {part.drive.kind for part in components(twist, self._drives)}
        for value, kinds, name in zip(astuple(twist), AXIS_KINDS, VelocityKind.ALL.values, strict=True):
            if value and self._wheels is None and not found.intersection(kinds):
                rows = " or ".join(dict.fromkeys(kinds))
                return f"{name} must be 0: drive.csv has no enabled row {rows}"
        return ""

    def _share(self, twist: Twist) -> float:
        """The share of a twist at which no component is faster than its row's Speed, at most 1."""
        over = [part.commanded_speed / part.drive.speed for part in components(twist, self._drives)]
        most = max(over, default=0.0)
        return 1.0 / most if most > 1.0 else 1.0


def velocity_shape(spec: VelocitySpec, wheels: WheelsSpec | None) -> str:
    """A command of continuous motion with the names of its values, empty if the robot cannot do it."""
    if spec.kind is VelocityKind.WHEELS and wheels is None:
        return ""
    return _shape(spec, _names(spec.kind, WheelKinematics.of(wheels) if wheels is not None else None))


def _shape(spec: VelocitySpec, names: Sequence[str]) -> str:
    return f"{spec.code}-{';'.join(names)}[;T]"


def _names(kind: VelocityKind, wheels: WheelKinematics | None) -> tuple[str, ...]:
    """Names of a command's values; rim speeds are one for each wheel."""
    if kind is not VelocityKind.WHEELS or wheels is None:
        return kind.values
    return tuple(f"W{number}" for number in range(1, len(wheels.wheels) + 1))


def _numbers(argument: str | None, shape: str) -> list[float] | str:
    """The values between semicolons, or commas, or the reason there are none."""
    values = []
    for text in _BETWEEN.split(argument or ""):
        value = parse_value(text or None, shape)
        if isinstance(value, str):
            return value
        if abs(value) > LARGEST_VALUE:
            return f"{value:g} is beyond the limit of {LARGEST_VALUE:g}"
        values.append(value)
    return values


def _changed(commanded: Twist, kind: VelocityKind, values: Sequence[float]) -> Twist:
    names = {VelocityKind.X: "x", VelocityKind.Y: "y", VelocityKind.R: "r"}
    return replace(commanded, **dict(zip(names.get(kind, "xyr"), values, strict=True)))
