"""Range readings that were right in the log, and places that they cannot distinguish.

A program that received these readings could have corrected its belief, unless two places look alike.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from simmer_tui.report.sensor_sample import world_without_block
from simmer_tui.run.attempt import Attempt, Collision
from simmer_tui.run.facts import COVERED, SLIGHT
from simmer_tui.run.history_rows import BeliefRow, GripRow
from simmer_tui.run.table import Columns
from simmer_tui.sim.angles import half_turn
from simmer_tui.sim.arrays import BoolArray, FloatArray
from simmer_tui.sim.sensors import ObservingSensor, modelled_sensor
from simmer_tui.sim.specs import CELL_SIZE, SensorSpec

# Judged: two readings by each of four sensors. A program with fewer may not have converged yet.
_OFTEN = 8
"""Range readings since a belief became wrong, from which they contradict it."""
# Twice the most of 36 clean runs of solve.py and the course's programs: 8 to 40 readings until localized.
_LONG = 80
"""Range readings after which a program that can localize itself would have done so, had it received them."""
_ALONG, _ACROSS = CELL_SIZE / 2, 1.0
"""Distances between the end of a ray and a place touched, inches along a wall and across it, within which it
showed that place. Beside it the wall of the next cell begins, and errors of short ranges are smaller.
Judged."""
_TELLING = 1.0
"""Difference of two readings, inches, that does not distinguish cells. Judged: a twelfth of a cell."""
_AGREEING = 2
"""Sensors that must agree: one alone reads the same in most corridors."""
_STEP = 1.0
"""Inches between the places tried in the believed cell."""


@dataclass(frozen=True, slots=True)
class ShownPlace:
    """A reading that was right and showed the place of a contact before it. It is by the sensor `code`, with
    `value` in inches, at `elapsed` seconds, `ago` inches of path before the movement that touched."""

    code: str
    value: float
    elapsed: float
    ago: float


def looked_while_lost(attempt: Attempt) -> bool:
    """True if range sensors were read often since its belief became wrong, and were mostly right."""
    lost = attempt.beliefs[1]
    return lost is not None and _mostly_right(attempt, lost.order - 1, _OFTEN)


def looked_in_vain(attempt: Attempt) -> bool:
    """True if range sensors were read so often, and so rightly, that a program could have localized
    itself."""
    return _mostly_right(attempt, attempt.placed, _LONG)


def shown_place(attempt: Attempt, met: Collision) -> ShownPlace | None:
    """The last right reading that showed the place of a contact, read within a cell's length of path."""
    rows = _shortly_before(attempt, met.row.order, met.row.gone_before)
    found: list[ShownPlace] = []
    for sensor, mine in _by_range(attempt, rows):
        mine = mine[_right(mine, sensor) & np.isfinite(mine["value"])]
        if not len(mine):
            continue
        heading = np.radians(mine["heading"].astype(np.float64))
        cos, sin = np.cos(heading), np.sin(heading)
        ray = np.radians(sensor.rotation)
        ahead = sensor.x + mine["value"] * np.cos(ray)
        aside = sensor.y + mine["value"] * np.sin(ray)
        x = np.abs(mine["x"] + cos * ahead - sin * aside - met.contact.point[0])
        y = np.abs(mine["y"] + sin * ahead + cos * aside - met.contact.point[1])
        # Walls run along the axes.
        places = np.flatnonzero((np.maximum(x, y) <= _ALONG) & (np.minimum(x, y) <= _ACROSS))
        if len(places):
            last = mine[int(places[-1])]
            ago = met.row.gone_before - float(last["gone"])
            found.append(ShownPlace(sensor.code, float(last["value"]), float(last["elapsed"]), ago))
    return max(found, key=lambda each: each.elapsed, default=None)


def looked_at_each_movement(attempt: Attempt, met: Collision) -> bool:
    """True if ranges were read as often as the robot moved, since the first of the movements that led to a
    contact."""
    movements = attempt.history.movements
    count = max(len(met.before), len(met.legs) - 1)
    first = max(movements.place_of(met.row.order) - count, 0)
    rows = attempt.within(attempt.history.readings, attempt.placed)
    rows = rows[(rows["order"] > movements[first].order) & (rows["order"] < met.row.order)]
    return sum(len(mine) for _, mine in _by_range(attempt, rows)) >= max(count, 1)


def looked_for_block(attempt: Attempt, done: GripRow) -> bool:
    """True if sensors that see the block were read within a cell's length of path before a grip, and were all
    right."""
    size = attempt.spec.block_size
    last = attempt.history.movements.before(done.order)
    gone = 0.0 if last is None else last.gone
    rows = _shortly_before(attempt, done.order, gone)
    right = [
        _right(mine, sensor)
        for sensor, mine in _by_range(attempt, rows)
        if isinstance(made := modelled_sensor(sensor), ObservingSensor) and made.sees_block(size)
    ]
    return sum(map(len, right)) > 0 and all(each.all() for each in right)


def reported_held(attempt: Attempt, done: GripRow) -> tuple[str, int] | None:
    """The load sensor that had read the block as held, and the number of these readings. None without any, or
    if the gripper released the block elsewhere, or the robot moved in between."""
    taken = [row.order for row in attempt.history.blocks.items if row.held and row.order < done.order]
    if not taken:
        return None
    moves = attempt.within(attempt.history.movements, taken[-1])
    if ((moves["order"] < done.order) & ~moves["grips"]).any():
        return None
    rows = attempt.within(attempt.history.readings, taken[-1])
    rows = rows[rows["order"] < done.order]
    for sensor, mine in _read(attempt, rows, attempt.load_sensors):
        values = mine["value"]
        held = int((values > 0.0).sum())
        # One answer may be wrong, but not most of them.
        if 2 * held > len(values):
            return sensor.code, held
    return None


def _mostly_right(attempt: Attempt, since: int, fewest: int) -> bool:
    rows = attempt.within(attempt.history.readings, since)
    right = total = 0
    for sensor, mine in _by_range(attempt, rows):
        total += len(mine)
        right += int(_right(mine, sensor).sum())
    return total >= fewest and 2 * right > total


def _shortly_before(attempt: Attempt, order: int, gone: float) -> Columns:
    """The readings before an event, within a cell's length of path before the path `gone`."""
    # The running number of a movement comes after those of the readings before it.
    rows = attempt.within(attempt.history.readings, attempt.placed)
    return rows[(rows["order"] < order) & (rows["gone"] >= gone - CELL_SIZE)]


def _read(attempt: Attempt, rows: Columns, sensors: Iterable[SensorSpec]) -> list[tuple[SensorSpec, Columns]]:
    """Those of some sensors that were read, each with its rows."""
    codes = attempt.history.sensor_codes
    return [(each, rows[rows["sensor"] == codes.index(each.code)]) for each in sensors if each.code in codes]


def _by_range(attempt: Attempt, rows: Columns) -> list[tuple[SensorSpec, Columns]]:
    """The range sensors that were read, each with its rows."""
    return _read(attempt, rows, (each for each in attempt.spec.sensors if each.kind.is_range))


def _right(rows: Columns, sensor: SensorSpec) -> BoolArray:
    # No echo has the noise of distance 0: a share of infinity would allow any reading, or be NaN.
    true = np.where(np.isfinite(rows["true"]), np.abs(rows["true"]), 0.0)
    usual = sensor.error * true + sensor.absolute_error
    return np.asarray(np.abs(rows["error"]) <= np.maximum(SLIGHT, COVERED * usual))


# -- places that look alike ------------------------------------------------------------------------


def looks_alike(seen: Attempt, belief: BeliefRow) -> bool:
    """True if the likeliest cell of a grid has a place that looks like the robot's own. Every range sensor
    that was read, and whose kind has a model, would then read the same at both, within its noise."""
    read = set(seen.history.sensor_codes)
    ranges = [each for each in seen.spec.sensors if each.code in read and each.kind.is_range]
    sensors = [made for made in map(modelled_sensor, ranges) if isinstance(made, ObservingSensor)]
    if len(sensors) < _AGREEING:
        return False
    world = world_without_block(seen.spec)
    true = np.array([[belief.true_x, belief.true_y, belief.true_heading]])
    poses = _around(belief)
    alike = np.ones(len(poses), dtype=np.bool_)
    for sensor in sensors:
        here, there = sensor.true_values(world, true)[0], sensor.true_values(world, poses)
        noise = COVERED * (sensor.spec.error * here + sensor.spec.absolute_error)
        # Nothing in range on both sides is alike too; infinity less infinity is no number.
        with np.errstate(invalid="ignore"):
            alike &= (here == there) | (np.abs(here - there) <= max(_TELLING, noise))
    return bool(alike.any())


def _around(belief: BeliefRow) -> FloatArray:
    """Poses in the believed cell, (n, 3). The heading is as far from one of the maze's directions as the true
    one; a grid without headings allows for all four."""
    reach = min(belief.allowed, CELL_SIZE / 2)
    steps = np.arange(-reach, reach + _STEP / 2, _STEP)
    beside = half_turn((belief.true_heading - belief.heading) * 4.0) / 4.0
    turns = [0.0] if belief.tells_heading else [0.0, 90.0, 180.0, 270.0]
    x, y, turn = np.meshgrid(belief.x + steps, belief.y + steps, belief.heading + beside + np.array(turns))
    return np.column_stack((x.ravel(), y.ravel(), turn.ravel()))
