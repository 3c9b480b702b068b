"""Wheels of a robot: rim speeds from its velocity and back.

Wheel i at (x_i, y_i) rolls along its direction rotation_i; rollers at the angle gamma_i (0 for plain and omni
wheels) transmit force along g_i = direction(rotation_i + gamma_i) only. With the body's velocity u = (vx, vy,
omega) the wheel's place moves by v_i = (vx - omega y_i, vy + omega x_i), and its rim by w_i = (v_i . g_i) /
cos(gamma_i): w = J u. If no motion of the body fits the speeds, u is their least-squares solution, u =
(J'J)^-1 J'w: the least slip.
"""

import math
from collections.abc import Sequence
from functools import cached_property

from msgspec import Struct

from simmer_tui.sim.angles import cos_sin
from simmer_tui.sim.arcs import Twist
from simmer_tui.sim.specs import WheelLayout, WheelsSpec

_DEGREE = math.pi / 180.0


class Wheel(Struct, frozen=True):
    """A wheel in the robot's frame: place (inches), rolling direction and roller angle (degrees)."""

    x: float
    y: float
    rotation: float
    rollers: float = 0.0


def wheels_of(spec: WheelsSpec) -> tuple[Wheel, ...]:
    """The wheels of a layout, in the order of `ww`'s values."""
    ahead, aside, radius = spec.wheelbase / 2.0, spec.track / 2.0, spec.radius
    if spec.layout is WheelLayout.DIFF:
        return Wheel(0.0, aside, 0.0), Wheel(0.0, -aside, 0.0)
    if spec.layout is WheelLayout.OMNI_3:
        places = [(angle, cos_sin(angle)) for angle in (0.0, 120.0, 240.0)]
        return tuple(Wheel(radius * cos, radius * sin, angle + 90.0) for angle, (cos, sin) in places)
    if spec.layout is WheelLayout.OMNI_4:
        sides = (radius, 0.0, 90.0), (-radius, 0.0, 90.0), (0.0, radius, 0.0), (0.0, -radius, 0.0)
        return tuple(Wheel(*side) for side in sides)
    corners = (ahead, aside, -45.0), (ahead, -aside, 45.0), (-ahead, aside, 45.0), (-ahead, -aside, -45.0)
    return tuple(Wheel(x, y, 0.0, rollers) for x, y, rollers in corners)


class WheelKinematics(Struct, frozen=True, dict=True):
    """Rim speeds, in/s, of a robot's wheels from its twist, and its twist from them."""

    wheels: tuple[Wheel, ...]
    sideways: bool
    """True if the layout can move the robot along its Y axis."""
    top_speed: float
    """Greatest rim speed, in/s."""

    @classmethod
    def of(cls, spec: WheelsSpec) -> "WheelKinematics":
        """The kinematics of a layout."""
        return cls(wheels_of(spec), spec.layout is not WheelLayout.DIFF, spec.top_speed)

    @cached_property
    def _rows(self) -> tuple[tuple[float, float, float], ...]:
        """J, one row a wheel: its rim speed per unit of vx, vy (in/s) and omega (rad/s)."""
        rows = []
        for wheel in self.wheels:
            cos, sin = cos_sin(wheel.rotation + wheel.rollers)
            hold = cos_sin(wheel.rollers)[0]
            rows.append((cos / hold, sin / hold, (wheel.x * sin - wheel.y * cos) / hold))
        return tuple(rows)

    @cached_property
    def _normal(self) -> tuple[tuple[float, ...], ...]:
        """(J'J)^-1 of the components that the layout has, by cofactors: a library's matrix inverse
        differs between processors."""
        columns = (0, 1, 2) if self.sideways else (0, 2)
        product = [[sum(row[i] * row[j] for row in self._rows) for j in columns] for i in columns]
        return _inverse(product)

    def speeds(self, twist: Twist) -> tuple[float, ...]:
        """Rim speeds of a robot that moves by a twist without slip."""
        turn = twist.r * _DEGREE
        return tuple(x * twist.x + y * twist.y + r * turn for x, y, r in self._rows)

    def twist(self, speeds: Sequence[float]) -> Twist:
        """The twist that fits rim speeds best; `speeds` has one number a wheel."""
        columns = (0, 1, 2) if self.sideways else (0, 2)
        pushed = [
            sum(row[column] * speed for row, speed in zip(self._rows, speeds, strict=True))
            for column in columns
        ]
        solved = [sum(a * b for a, b in zip(row, pushed, strict=True)) for row in self._normal]
        if self.sideways:
            return Twist(solved[0], solved[1], solved[2] / _DEGREE)
        return Twist(solved[0], 0.0, solved[1] / _DEGREE)

    def slip(self, speeds: Sequence[float]) -> tuple[float, ...]:
        """Slip of each wheel, in/s: the rim speed that remains after the twist that fits best."""
        fitted = self.speeds(self.twist(speeds))
        return tuple(asked - rolls for asked, rolls in zip(speeds, fitted, strict=True))

    def share(self, twist: Twist) -> float:
        """The share of a twist at which no rim is faster than the top speed, at most 1."""
        fastest = max(abs(speed) for speed in self.speeds(twist))
        return self.top_speed / fastest if fastest > self.top_speed else 1.0

    def clamped(self, speeds: Sequence[float]) -> tuple[float, ...]:
        """Rim speeds, each cut to the top speed, as a program's own `constrain` does it."""
        return tuple(max(-self.top_speed, min(self.top_speed, speed)) for speed in speeds)


def _inverse(matrix: Sequence[Sequence[float]]) -> tuple[tuple[float, ...], ...]:
    """The inverse of a 2 x 2 or 3 x 3 matrix by its cofactors."""
    if len(matrix) == 2:
        (a, b), (c, d) = matrix
        whole = a * d - b * c
        return (d / whole, -b / whole), (-c / whole, a / whole)
    (a, b, c), (d, e, f), (g, h, i) = matrix
    first = e * i - f * h, f * g - d * i, d * h - e * g
    whole = a * first[0] + b * first[1] + c * first[2]
    return (
        (first[0] / whole, (c * h - b * i) / whole, (b * f - c * e) / whole),
        (first[1] / whole, (a * i - c * g) / whole, (c * d - a * f) / whole),
        (first[2] / whole, (b * g - a * h) / whole, (a * e - b * d) / whole),
    )
