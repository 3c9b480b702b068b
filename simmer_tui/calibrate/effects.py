"""Effects that a robot may have and no set describes: the alternatives against which a fit is tested.

Each is a parameter that depends on a condition: on time, length, direction, place or distance. An effect
changes the residuals in proportion to its size. An effect of several devices, or of an unknown direction, has
a column for each. Its size is the root mean square over them.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from simmer_tui.calibrate.geometry import on_axes
from simmer_tui.calibrate.posterior import COUNTER, OBSERVATION, PROCESS, RANGE, Iterate, Rows
from simmer_tui.calibrate.rows import Model
from simmer_tui.sim.arrays import BoolArray, FloatArray, IntArray
from simmer_tui.sim.sensors import CountingSensor
from simmer_tui.sim.specs import CELL_SIZE

FEWEST_MOVEMENTS = 8
"""Least number of a drive's movements, on either side of a condition, for a test of its effects."""
_FEWEST_READINGS = 16
"""Least number of a sensor's readings for a test of its effects: eight on either side of a mean."""
_FEWEST_NEAR = 8
"""Least number of readings in a blind spot, so that an outlier alone is none."""
_IN_A_CELL = 4
"""Least number of movements from a cell with a surface of its own: their mean has half the error of one."""
BLIND_SPOTS = (1.5, 2.0, 3.0, 4.0, 6.0)
"""Blind spots that are tested, inches: those of data sheets are 1 to 6 in."""
_LONG, _FAR, _QUARTER = 10.0, 20.0, 90.0
"""Inches of a long movement and range, degrees of a quarter turn: sizes are counted at these."""
_INCHES_A_DEGREE = math.radians(3.0)
"""Inches that wheels 3 in from the centre roll in a turn of a degree."""
EVERY_DRIVE = "all drives"


@dataclass(frozen=True)
class EffectKind:
    """One kind of effect."""

    name: str
    phrase: str
    """A noun with `{size}` in it, as in "a blind spot of {size}"."""
    unit: str
    """Empty for a share."""
    least: float
    """Least size that is reported: the resolution of a ruler and a protractor."""


# Shares: 2 % is 0.08 in of a movement of 4 in.
DRIVE_DRIFT = EffectKind("drift", "a loss of strength of {size} over the log", "", 0.02)
SHORTFALL = EffectKind("shortfall", "movements that end {size} short, whatever their length", "in", 0.05)
BACKLASH = EffectKind("backlash", "movements that end {size} short after a reversal", "in", 0.05)
UNEVEN_LENGTH = EffectKind(
    "length", "a strength that grows by {size} with each 10 in or 90 degrees of a movement", "", 0.02
)
TURNING = EffectKind(
    "turning", "a turn by {size} in 10 in that grows with the square of the length", "deg", 0.5
)
DIRECTION = EffectKind("direction", "a difference of {size} between both directions", "", 0.01)
SLOPE = EffectKind("slope", "a strength that differs by {size} with the direction in the maze", "", 0.02)
SURFACE = EffectKind("surface", "a strength that differs by {size} from cell to cell", "", 0.02)
WARMING = EffectKind("warming", "readings that grow by {size} over the log", "", 0.02)
CURVE = EffectKind("curve", "ranges that are off a straight line by {size} within 20 in", "in", 0.1)
BLIND_SPOT = EffectKind("blind spot", "a blind spot of {size}", "in", 0.1)
COUNTED_TURNS = EffectKind("counted turns", "a count of {size} more in a quarter turn", "in", 0.05)
IRON = EffectKind("iron", "a deviation of {size} that depends on the heading", "deg", 0.5)
EFFECT_KINDS = (
    *(DRIVE_DRIFT, SHORTFALL, BACKLASH, UNEVEN_LENGTH, TURNING, DIRECTION, SLOPE, SURFACE),
    *(WARMING, CURVE, BLIND_SPOT, COUNTED_TURNS, IRON),
)
"""All kinds, those of drives first."""


@dataclass(frozen=True)
class Effect:
    """An effect of one device, or of several, with the derivatives of the residuals by it."""

    kind: EffectKind
    owner: str
    """ID of a drive or sensor, `EVERY_DRIVE`, or the name of a kind of sensor."""
    group: str
    """The drives, or the kind of sensor, whose tests are shown together."""
    columns: FloatArray
    """(rows, k)."""
    drives: tuple[int, ...] = ()
    """Drives whose biases change over the log."""
    limit: float = 0.0
    """Inches of a blind spot. A size of 1 is then a sensor that reads the limit of all that is closer."""


def effects(model: Model, state: Iterate, rows: Rows) -> list[Effect]:
    """Effects that a log can show: of each device, and of all devices of a kind."""
    single = [*_of_drives(model, state, rows), *_of_sensors(model, state, rows)]
    alike: defaultdict[tuple[str, str, float], list[Effect]] = defaultdict(list)
    for each in single:
        alike[each.kind.name, each.group, each.limit].append(each)
    joint = []
    for (_, group, limit), several in alike.items():
        if len(several) > 1:
            columns = np.column_stack([each.columns for each in several])
            drives = tuple(index for each in several for index in each.drives)
            joint.append(Effect(several[0].kind, group, group, columns, drives, limit))
            if drives:
                # A battery is one for all: a single column has more power than one for each.
                columns = columns.sum(axis=1, keepdims=True)
                joint.append(Effect(several[0].kind, group, group, columns, drives, limit))
    return [*single, *joint]


def _of_drives(model: Model, state: Iterate, rows: Rows) -> Iterator[Effect]:
    drives, distance, count = model.run.spec.drives, model.amount, len(model.drive)
    lead = np.abs([on_axes(each.kind.direction) for each in drives])[model.drive]
    turning = np.broadcast_to((0.0, 0.0, 1.0), lead.shape)
    # From -1/2 to 1/2 over the log, so that a bias is that of its middle.
    place = np.arange(count) / max(count - 1, 1) - 0.5
    sign, size = np.sign(distance), np.abs(distance)
    reference = np.where(model.turns, _QUARTER, _LONG)
    wheels = np.where(model.turns, 1.0 / _INCHES_A_DEGREE, 1.0)
    reverses = _reversals(model)
    # The length of a stretch is that of the pauses between readings, not of a movement.
    whole = ~model.continuous

    def column(amounts: FloatArray, axes: FloatArray = lead) -> FloatArray:
        return _column(model, rows, amounts[:, None] * axes)[:, None]

    for index in range(len(drives)):
        mine = model.drive == index
        if mine.sum() < FEWEST_MOVEMENTS:
            continue
        name, turns = drives[index].kind.value, drives[index].kind.turns

        def effect(kind: EffectKind, columns: FloatArray, name: str = name, index: int = index) -> Effect:
            return Effect(kind, name, EVERY_DRIVE, columns, (index,) if kind is DRIVE_DRIFT else ())

        yield effect(DRIVE_DRIFT, column(mine * -place * distance, lead + model.biases(state)))
        mine = mine & whole
        if mine.sum() >= FEWEST_MOVEMENTS:
            yield effect(SHORTFALL, column(mine * -sign * wheels))
            yield effect(UNEVEN_LENGTH, column(mine * distance * size / reference))
            if not turns:
                yield effect(TURNING, column(mine * distance * size / _LONG**2, turning))
        if _splits(mine, reverses):
            yield effect(BACKLASH, column(mine * reverses * -sign * wheels))
        if _splits(mine, distance > 0.0):
            yield effect(DIRECTION, column(mine * size / 2))
    mine = whole & ~model.turns
    if mine.sum() < FEWEST_MOVEMENTS:
        return
    heading = np.radians(state.chain[model.before, 2])
    towards = heading + np.angle(model.asked[:, 0] + 1j * model.asked[:, 1])
    waves = [column(mine * distance * wave) for wave in _waves(towards)]
    yield Effect(SLOPE, EVERY_DRIVE, EVERY_DRIVE, np.column_stack(waves))
    cells = np.floor(state.chain[model.before, :2] / CELL_SIZE)
    cell = cells[:, 0] * len(model.run.spec.maze.cells) + cells[:, 1]
    numbers, counts = np.unique(cell[mine], return_counts=True)
    there = [column(mine * distance * (cell == number)) for number in numbers[counts >= _IN_A_CELL]]
    if len(there) > 1:
        yield Effect(SURFACE, EVERY_DRIVE, EVERY_DRIVE, np.column_stack(there))


def _of_sensors(model: Model, state: Iterate, rows: Rows) -> Iterator[Effect]:
    slopes = rows.jacobian.tocsc()
    turned = np.concatenate(([0.0], np.cumsum(state.chain[:, 5])))
    read = np.isin(rows.family, (COUNTER, RANGE, OBSERVATION))
    for index, columns in model.columns.items():
        sensor = model.sensor_at(state, index)
        mine = np.flatnonzero(read & (rows.source == index))
        if len(mine) < _FEWEST_READINGS:
            continue
        stops = rows.stop[mine]

        def effect(
            kind: EffectKind,
            *parts: FloatArray,
            limit: float = 0.0,
            name: str = sensor.spec.id,
            group: str = sensor.spec.kind.name,
            mine: IntArray = mine,
        ) -> Effect:
            made = np.zeros((len(rows.residuals), len(parts)))
            made[mine] = -np.column_stack(parts)
            return Effect(kind, name, group, made, limit=limit)

        if "gain" in columns:
            # A row is a reading minus gain times its true value.
            true = -slopes[:, model.width + columns["gain"]].toarray()[mine, 0]
            yield effect(WARMING, (stops / max(model.stops - 1, 1) - 0.5) * true)
            if isinstance(sensor, CountingSensor):
                yield effect(DIRECTION, np.abs(true) / 2)
            elif sensor.spec.kind.is_range:
                yield effect(CURVE, (true / _FAR) ** 2)
                expected = sensor.spec.gain * true + sensor.spec.bias
                for limit in BLIND_SPOTS:
                    inside = np.maximum(limit - expected, 0.0)
                    if (inside > 0.1 * limit).sum() >= _FEWEST_NEAR:
                        yield effect(BLIND_SPOT, inside, limit=limit)
        if isinstance(sensor, CountingSensor) and sensor.slips:
            begin, end = model.counted_between(index)
            yield effect(COUNTED_TURNS, (turned[end] - turned[begin]) / _QUARTER)
        elif sensor.spec.kind.is_heading:
            yield effect(IRON, *_waves(np.radians(state.chain[stops, 2])))


def _waves(angles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A wave of unknown phase: its size is the root mean square of those of its two parts."""
    return np.cos(angles) / math.sqrt(2), np.sin(angles) / math.sqrt(2)


def _splits(mine: BoolArray, condition: BoolArray) -> bool:
    """True if enough of the movements meet a condition, and enough do not."""
    counts = (mine & condition).sum(), (mine & ~condition).sum()
    return bool(min(counts) >= FEWEST_MOVEMENTS)


def _reversals(model: Model) -> BoolArray:
    """True for movements against the direction of the last one along the same axis, (movements,)."""
    axes = np.abs(model.asked).argmax(axis=1)
    sides = np.sign(model.asked[np.arange(len(axes)), axes])
    last: dict[int, float] = {}
    found = np.zeros(len(axes), bool)
    for number, (axis, side) in enumerate(zip(axes.tolist(), sides.tolist(), strict=True)):
        found[number] = last.get(axis, side) != side
        last[axis] = side
    return found


def _column(model: Model, rows: Rows, totals: FloatArray) -> FloatArray:
    """Derivatives of all residuals by a factor on additional totals of movements, (movements, 3)."""
    made = np.zeros(len(rows.residuals))
    # The rows of the process model come axis by axis.
    process = np.flatnonzero(rows.family == PROCESS).reshape(totals.shape[1], -1)
    for axis, mine in enumerate(process):
        made[mine] = -model.innovations(totals[:, axis])[model.movement_at[rows.stop[mine]]]
    return made
