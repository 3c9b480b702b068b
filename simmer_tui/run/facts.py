"""Measures of a mistake: the sensor that looked there, a belief held against the truth."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from msgspec import Struct

from simmer_tui.belief_grid import SURELY_ELSEWHERE, GridBelief
from simmer_tui.events import Belief
from simmer_tui.sim.angles import cos_sin
from simmer_tui.sim.path import Contact
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import CELL_SIZE, SensorSpec

if TYPE_CHECKING:  # most runs have no mission
    from simmer_tui.config.mission_plan import Cell

# Judged: at more than this the wall's edge, not the place touched, is what a sensor sees.
BESIDE = 60.0
"""A sensor that looks further than this from a place, degrees, does not look there."""
# Judged: within it two sensors see the same wall a foot away.
ALIKE = 15.0
"""Sensors within this many degrees of each other look the same way."""
# Of a normal distribution 99.7 % lie within three standard deviations.
COVERED = 3.0
"""A belief is right while it is off by no more than this many told spreads,"""
# Judged: below this an error has no consequence in cells of 12 in.
SLIGHT, SLIGHT_TURN = 1.0, 10.0
"""or by no more than this anyway, inches and degrees."""
# Judged: twice as much, since nothing says how sure the program was.
UNTOLD, UNTOLD_TURN = 2.0, 20.0
"""The same where a program tells no spread."""
# Judged: a quarter of a cell.
UNSURE = 3.0
"""A spread beyond this, inches: the program knows that it does not know where it is."""

# Judged: who tries a fifth time does not look at what came of the four before.
WEDGED = 5
"""Contacts in a row after which a robot is wedged,"""
# Judged: less than any program backs off to get away from a wall.
WEDGED_WITHIN, WEDGED_TURN = 0.5, 5.0
"""if none moved it by more than this, inches and degrees."""


# A third of a right angle: more than this, and a corridor may be its neighbour.
UNSURE_TURN = 30.0
"""A spread of the heading beyond this, degrees: the program knows that it does not know its heading."""

NO_HEADING = COVERED * UNSURE_TURN
"""Error of the heading, degrees, that a grid without headings allows for: what is sure allows for no more."""


class Stuck(Struct, frozen=True):
    """A stretch at the end in which a wall held the robot, `since` when (elapsed seconds): so many
    `movements` in a row, or, of a robot that drove until told otherwise, so many seconds `pressed`."""

    since: float
    movements: int
    pressed: float = 0.0

    @property
    def text(self) -> str:
        """Words for it, after "from 12.3 s on"."""
        if self.movements:
            return f"a wall stopped {self.movements} movements in a row"
        return f"it pressed against a wall for {self.pressed:.0f} s and did not go 1 in"


class LastReading(Struct, frozen=True):
    """The last reading of a sensor before something: `value` and `true` in its unit, when (seconds), and how
    far the robot had gone (inches) and turned (degrees, either way) by then, in all."""

    code: str
    value: float
    true: float
    time: float
    gone: float = 0.0
    turned: float = 0.0


class FacingSensor(Struct, frozen=True):
    """The sensors that look most nearly at a place touched: their codes, how far beside it the nearest
    looks (degrees), and the last word of any of them, None if none was read."""

    codes: tuple[str, ...]
    beside: float
    last: LastReading | None


class Deviation(Struct, frozen=True):
    """Error of a belief, inches and degrees (-180 to 180, believed less true), and the error that the
    program allowed for. Of a grid, `above` is the probability of all states that it holds for likelier than
    the truth and its neighbours, which judges the heading too; NaN without one."""

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
        """True if nearly all of a grid's probability lies in states likelier than the true one."""
        return self.above > SURELY_ELSEWHERE


def is_wedged(touched: Sequence[Pose]) -> bool:
    """True if the last contacts of a robot, by its poses after them, were all in one place."""
    return len(touched) >= WEDGED and all(
        is_same_place(pose, touched[-1]) for pose in list(touched)[-WEDGED:]
    )


def is_same_place(pose: Pose, other: Pose) -> bool:
    """True if a robot that went from one pose to the other did not get away from what it touched."""
    near = math.hypot(pose.x - other.x, pose.y - other.y) <= WEDGED_WITHIN
    return near and abs(wrapped(pose.heading - other.heading)) <= WEDGED_TURN


def facing_sensor(
    contact: Contact, sensors: Iterable[SensorSpec], words: Mapping[str, LastReading]
) -> FacingSensor | None:
    """Which range sensors looked at the place touched, or nearest to it, and the newest that was heard of
    them; None if the robot has none. `words` holds by code what sensors said before."""
    looking = [each for each in sensors if each.enabled and each.kind.is_range]
    if not looking:
        return None
    beside = {each.code: degrees_beside(contact, each) for each in looking}
    nearest = min(beside, key=lambda code: beside[code])
    codes = [code for code, off in beside.items() if off <= beside[nearest] + ALIKE]
    codes.sort(key=lambda code: beside[code])
    said = [words[code] for code in codes if code in words]
    return FacingSensor(tuple(codes), beside[nearest], max(said, key=lambda each: each.time, default=None))


def degrees_beside(contact: Contact, sensor: SensorSpec) -> float:
    """Angle between a sensor and a contact, seen from the robot's middle, 0 to 180 degrees."""
    pose, (x, y) = contact.pose, contact.point
    towards = math.degrees(math.atan2(y - pose.y, x - pose.x)) - pose.heading
    return abs(wrapped(sensor.rotation - towards))


def deviation(belief: Belief) -> Deviation:
    """Error of a belief, and the error allowed for: a program that tells its spread, or its particles'
    headings, is held to them."""
    believed, true = belief.pose, belief.true
    distance = math.hypot(believed.x - true.x, believed.y - true.y)
    turn = wrapped(believed.heading - true.heading)
    if belief.grid is not None:
        return _of_grid(belief, belief.grid, distance, turn)
    headings = [particle[2] for particle in belief.particles if len(particle) > 2]
    allowed_turn = UNTOLD_TURN
    if len(headings) > 1:
        allowed_turn = max(COVERED * _spread_of(headings), SLIGHT_TURN)
    spread = belief.spread
    allowed = UNTOLD if spread is None else max(COVERED * spread, SLIGHT)
    return Deviation(distance, turn, allowed, allowed_turn)


def _of_grid(belief: Belief, grid: GridBelief, distance: float, turn: float) -> Deviation:
    spread = grid.spread if belief.spread is None else belief.spread
    allowed = max(COVERED * spread, SLIGHT, math.hypot(*grid.cell_size) / 2)
    if not grid.has_headings:
        # It says nothing of the heading, so that this is neither right nor wrong.
        return Deviation(distance, 0.0, allowed, NO_HEADING, grid.above)
    allowed_turn = max(COVERED * grid.turn_spread, SLIGHT_TURN)
    return Deviation(distance, turn, allowed, allowed_turn, grid.above)


def is_unsure(spread: float) -> bool:
    """True if a spread, inches, says that the program did not know where it was; NaN says nothing."""
    # A comparison with NaN is False.
    return spread > UNSURE


def _spread_of(headings: list[float]) -> float:
    """The standard deviation of headings, degrees, from their mean direction."""
    # Angles wrap: the mean of 359 and 1 deg is 0, so directions are averaged, not numbers.
    cos = sum(math.cos(math.radians(each)) for each in headings) / len(headings)
    sin = sum(math.sin(math.radians(each)) for each in headings) / len(headings)
    mean = math.degrees(math.atan2(sin, cos))
    return math.sqrt(sum(wrapped(each - mean) ** 2 for each in headings) / len(headings))


def missed_zone(zone: Cell, x: float, y: float) -> tuple[float, float]:
    """Distance of a place from the drop zone, inches: to the right (negative: to the left) and up
    (negative: down); 0 within it."""
    return _outside(x - zone.x), _outside(y - zone.y)


def _outside(off: float) -> float:
    return math.copysign(max(abs(off) - CELL_SIZE / 2, 0.0), off) if off else 0.0


def carried_over(old: Pose, new: Pose, pose: Pose) -> Pose:
    """`pose`, as it stands to the pose `old`, laid to `new` instead: what a program that takes `old` for
    `new` takes `pose` for."""
    cos, sin = cos_sin(-old.heading)
    x, y = pose.x - old.x, pose.y - old.y
    ahead, aside = cos * x - sin * y, sin * x + cos * y
    return Pose(*new.place(ahead, aside), new.heading + pose.heading - old.heading)


def wrapped(angle: float) -> float:
    """An angle from -180 to below 180 degrees."""
    return (angle + 180.0) % 360.0 - 180.0
