"""Measures of a mistake: the sensor that looks at a contact, the error of a belief."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from msgspec import Struct

from simmer_tui.run.belief_grid import SURELY_ELSEWHERE, GridBelief
from simmer_tui.run.events import Belief
from simmer_tui.sim.angles import cos_sin, half_turn
from simmer_tui.sim.path import Contact
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import CELL_SIZE, SensorSpec

if TYPE_CHECKING:  # most runs have no mission
    from simmer_tui.config.mission_plan import Cell

# Judged: at more than this a sensor sees the wall's edge, not the place touched.
BESIDE = 60.0
"""A sensor that looks further than this from a place, degrees, does not look there."""
# Judged: within it two sensors see the same wall a foot away.
ALIKE = 15.0
"""Sensors within this many degrees of each other look the same way."""
# Of a normal distribution 99.7 % lie within three standard deviations.
COVERED = 3.0
"""A belief is right while it is off by no more than this many of its spreads,"""
# Judged: below this an error has no consequence in cells of 12 in.
SLIGHT, SLIGHT_TURN = 1.0, 10.0
"""or by no more than this anyway, inches and degrees."""
# Judged: twice as much, since nothing says how sure the program was.
DEFAULT_ALLOWED, DEFAULT_ALLOWED_TURN = 2.0, 20.0
"""The same where a program gives no spread."""
# Judged.
UNSURE = CELL_SIZE / 4
"""A spread beyond this, inches, means that the program knows it is not localized."""

# Judged: a program that tries a fifth time does not look at the result of the four before.
WEDGED = 5
"""Contacts in a row after which a robot is wedged,"""
# Judged: less than any program backs off to get away from a wall.
SAME_PLACE, SAME_PLACE_TURN = 0.5, 5.0
"""if none moved it by more than this, inches and degrees. Contacts within it are listed as one."""


# A third of a right angle: more than this, and a corridor may be its neighbour.
UNSURE_TURN = 30.0
"""A spread of the heading beyond this, degrees, means that the program does not know its heading."""

NO_HEADING = COVERED * UNSURE_TURN
"""Error of the heading, degrees, that a grid without headings allows for: the most that a sure belief may."""

PRESSED, PRESSED_DISTANCE = 0.25, 1.0
"""Share of the time limit, and inches within which it stays: a program that presses so long does not notice
the wall."""


class Stuck(Struct, frozen=True):
    """A stretch at the end in which a wall or the block held the robot, from `since` on (elapsed seconds).
    `movements` is the number of movements in a row; under a velocity, `pressed` is the time in seconds.
    `obstacle` is the wall or the block, in words."""

    since: float
    movements: int
    obstacle: str
    pressed: float = 0.0

    @property
    def text(self) -> str:
        """Clause that describes it, without its time: `a wall stopped 4 movements in a row`."""
        if self.movements:
            return f"{self.obstacle} stopped {self.movements} movements in a row"
        held = f"it pressed against {self.obstacle} for {self.pressed:.0f} s"
        return f"{held} and did not go {PRESSED_DISTANCE:g} in"


class LastReading(Struct, frozen=True):
    """The last reading of a sensor before an event: `value` and `true` in its unit, its `time` in seconds.
    `gone` (inches) and `turned` (degrees in either direction) are the robot's totals by then."""

    code: str
    value: float
    true: float
    time: float
    gone: float = 0.0
    turned: float = 0.0


class FacingSensor(Struct, frozen=True):
    """The sensors whose direction is nearest to a place touched: their codes, the angle between the nearest
    and the place (degrees), and their last reading, None if none was read."""

    codes: tuple[str, ...]
    beside: float
    last: LastReading | None


class Deviation(Struct, frozen=True):
    """Error of a belief, inches and degrees (-180 to 180, believed less true), and the error that the
    program allowed for. Of a grid, `above` is the probability of all states that are likelier than the true
    one and its neighbours; NaN without a grid. It judges the heading too."""

    distance: float
    turn: float
    allowed: float
    allowed_turn: float
    above: float = math.nan

    @property
    def wrong(self) -> bool:
        """True if it is off by more than the program allowed for."""
        return self.off_place or self.off_heading or self.rejects_truth

    @property
    def off_place(self) -> bool:
        """True if the place is off by more than the belief allows for."""
        return not self.distance <= self.allowed

    @property
    def off_heading(self) -> bool:
        """True if the heading is off by more than the belief allows for."""
        return math.isnan(self.above) and not abs(self.turn) <= self.allowed_turn

    @property
    def rejects_truth(self) -> bool:
        """True if nearly all of a grid's probability is in states likelier than the true one."""
        return self.above > SURELY_ELSEWHERE


def is_wedged(touched: Sequence[Pose]) -> bool:
    """True if the last contacts of a robot, by its poses after them, were all in one place."""
    return len(touched) >= WEDGED and all(
        is_same_place(pose, touched[-1]) for pose in list(touched)[-WEDGED:]
    )


def is_same_place(pose: Pose, other: Pose) -> bool:
    """True if a robot that went from one pose to the other did not get away from the obstacle."""
    distance, turn = displacement(pose, other)
    return distance <= SAME_PLACE and abs(turn) <= SAME_PLACE_TURN


def displacement(begin: Pose, end: Pose) -> tuple[float, float]:
    """Distance (inches) and turn (-180 to 180 degrees) from one pose to another."""
    return math.hypot(end.x - begin.x, end.y - begin.y), half_turn(end.heading - begin.heading)


def facing_sensor(
    contact: Contact, sensors: Iterable[SensorSpec], words: Mapping[str, LastReading]
) -> FacingSensor | None:
    """The range sensors that look at the place touched, or nearest to it, and their newest reading; None if
    the robot has none. `words` are the last readings by code."""
    looking = [each for each in sensors if each.enabled and each.kind.is_range]
    if not looking:
        return None
    beside = {each.code: degrees_beside(contact, each) for each in looking}
    nearest = min(beside.values())
    codes = sorted((code for code, off in beside.items() if off <= nearest + ALIKE), key=beside.__getitem__)
    said = [words[code] for code in codes if code in words]
    return FacingSensor(tuple(codes), nearest, max(said, key=lambda each: each.time, default=None))


def degrees_beside(contact: Contact, sensor: SensorSpec) -> float:
    """Angle between a sensor and a contact, seen from the robot's middle, 0 to 180 degrees."""
    return abs(half_turn(sensor.rotation - contact.bearing))


def deviation(belief: Belief) -> Deviation:
    """Error of a belief, and the error allowed for, by the program's own spread and its particles' headings
    where it gives them."""
    distance, turn = displacement(belief.true, belief.pose)
    if belief.grid is not None:
        return _of_grid(belief, belief.grid, distance, turn)
    headings = [particle[2] for particle in belief.particles if len(particle) > 2]
    allowed_turn = DEFAULT_ALLOWED_TURN
    if len(headings) > 1:
        allowed_turn = max(COVERED * _spread_of(headings), SLIGHT_TURN)
    spread = belief.spread
    allowed = DEFAULT_ALLOWED if spread is None else max(COVERED * spread, SLIGHT)
    return Deviation(distance, turn, allowed, allowed_turn)


def _of_grid(belief: Belief, grid: GridBelief, distance: float, turn: float) -> Deviation:
    spread = grid.spread if belief.spread is None else belief.spread
    allowed = max(COVERED * spread, SLIGHT, math.hypot(*grid.cell_size) / 2)
    if not grid.has_headings:
        # The grid has no headings, so the heading is neither right nor wrong.
        return Deviation(distance, 0.0, allowed, NO_HEADING, grid.above)
    allowed_turn = max(COVERED * grid.turn_spread, SLIGHT_TURN)
    return Deviation(distance, turn, allowed, allowed_turn, grid.above)


def _spread_of(headings: list[float]) -> float:
    """The standard deviation of headings, degrees, from their mean direction."""
    # Angles wrap: the mean of 359 and 1 deg is 0, so directions are averaged, not numbers.
    cos = sum(math.cos(math.radians(each)) for each in headings) / len(headings)
    sin = sum(math.sin(math.radians(each)) for each in headings) / len(headings)
    mean = math.degrees(math.atan2(sin, cos))
    return math.sqrt(sum(half_turn(each - mean) ** 2 for each in headings) / len(headings))


def missed_zone(zone: Cell, x: float, y: float) -> tuple[float, float]:
    """Distance of a place from the drop zone, inches: to the right (negative: to the left) and up
    (negative: down); 0 within it."""
    return _outside(x - zone.x), _outside(y - zone.y)


def _outside(off: float) -> float:
    return math.copysign(max(abs(off) - CELL_SIZE / 2, 0.0), off) if off else 0.0


def carried_over(old: Pose, new: Pose, pose: Pose) -> Pose:
    """Pose that a program would believe for `pose`, if it believes itself at `new` while it is at `old`."""
    cos, sin = cos_sin(-old.heading)
    x, y = pose.x - old.x, pose.y - old.y
    ahead, aside = cos * x - sin * y, sin * x + cos * y
    return Pose(*new.place(ahead, aside), new.heading + pose.heading - old.heading)
