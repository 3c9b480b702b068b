"""Large errors that a run's own set declares, and its differences from the nominal set: a device, a maze or a
block is as its set says, and misleads a program all the same."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np

from simmer_tui.config import load_default
from simmer_tui.report.audit import is_another_robot
from simmer_tui.report.finding import LEAST_DEGREES
from simmer_tui.report.sensor_sample import by_sensor
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.table import Columns
from simmer_tui.sim.angles import half_turn
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.specs import CELL_SIZE, WALL, GripperSpec, SensorSpec, SimulationSpec

# Judged: an inch is a third of the way beside a robot in a corridor; 5 degrees lead an inch aside in a cell.
_LARGE = {"in": 1.0, "deg": 5.0}
"""Mean errors of readings from which a declared error is named, by unit."""
_GAIN = 0.1
"""Share by which a drive moves more or less than another set says, from which that is named. Judged."""
_SLOW = 1.0
"""Seconds by which a reading takes longer than in another set, from which that is named. Judged."""
_REACH = 0.25
"""Inches by which a gripper, or the robot, reaches otherwise than in another set, from which that is named.
Judged."""
_SPEED = 2.0
"""Factor by which a drive is faster or slower than in the nominal set, from which that is told. Judged."""
_CELLS = 2
"""Cells with another wall that are named."""
_SYSTEMATIC = ("bias", "drift", "hard_iron", "soft_iron", "random_walk", "cross_talk", "incidence_limit")
"""Fields of a sensor's row that declare an error of one sign."""


def reference_set(history: RunHistory) -> tuple[str, SimulationSpec]:
    """The set that a row is compared with, and its name: the nominal one, else the bundled one."""
    nominal = history.nominal
    return ("the bundled set", _bundled()) if nominal is None else (f"the set {nominal.name}", nominal.spec)


@cache
def _bundled() -> SimulationSpec:
    # It does not change, and takes a moment to read.
    return load_default().simulation


def set_errors(seen: Attempt) -> dict[str, str]:
    """Large errors of the devices that an attempt used, by code: `reads 60.0 deg too high on average`. None
    of a real robot, whose truth no log has."""
    if seen.history.is_twin:
        return {}
    found: dict[str, str] = {}
    for code, text in (*_of_sensors(seen), *_of_drives(seen)):
        found[code] = f"{found[code]}, and {text}" if code in found else text
    return found


def _of_sensors(seen: Attempt) -> Iterator[tuple[str, str]]:
    name, reference = reference_set(seen.history)
    usual = {each.code: each for each in reference.sensors}
    elsewhere = is_another_robot(seen.spec, reference)
    for own, rows in by_sensor(seen.history, seen.within(seen.history.readings)):
        if not len(rows):
            continue
        text = _misleads(own, rows)
        if text:
            yield own.code, text
        row = usual.get(own.code)
        if row is None or row.kind is not own.kind:
            continue
        turned = half_turn(own.rotation - row.rotation)
        if own.kind.has("rotation") and not elsewhere and abs(turned) >= LEAST_DEGREES:
            side = "left" if turned > 0 else "right"
            yield own.code, f"looks {abs(turned):.0f} deg further to the {side} than in {name}"
        if own.read_time - row.read_time >= _SLOW:
            yield own.code, f"takes {own.read_time:g} s for a reading, in {name} {row.read_time:g} s"


def _misleads(own: SensorSpec, rows: Columns) -> str:
    """The mean error of a sensor whose row declares one, in words; empty where it is small."""
    errors = rows["error"][np.isfinite(rows["error"])]
    if own.is_yes_or_no:
        wrong = int((np.abs(errors) > 0.5).sum())
        return f"was wrong in {wrong} of {len(errors)} readings" if 2 * wrong > len(errors) else ""
    if own.kind.is_range and own.resolution >= _LARGE["in"]:
        return f"reads in steps of {own.resolution:g} {own.unit}"
    if own.gain == 1.0 and not any(getattr(own, field) for field in _SYSTEMATIC if own.kind.has(field)):
        return ""
    mean = float(errors.mean()) if len(errors) else 0.0
    if abs(mean) < _LARGE.get(own.unit, np.inf):
        return ""
    words = ("too long", "too short") if own.kind.is_range else ("too high", "too low")
    drifts = f"drifts by {own.drift:g} {own.unit}/s and " if own.drift else ""
    return f"{drifts}reads {abs(mean):.1f} {own.unit} {words[mean < 0.0]} on average"


def _of_drives(seen: Attempt) -> Iterator[tuple[str, str]]:
    name, reference = reference_set(seen.history)
    usual = {each.code: each for each in reference.drives}
    names = seen.history.code_names
    used = {names[number] for number in set(seen.within(seen.history.movements)["code"].tolist())}
    for own in seen.spec.drives:
        row = usual.get(own.code)
        if own.code not in used or row is None or row.kind is not own.kind or not row.gain:
            continue
        if abs(own.gain / row.gain - 1.0) >= _GAIN:
            yield own.code, f"{own.kind.verb} {own.gain / row.gain:.2f} times as far as in {name}"
        veers = 0.0 if own.kind.turns or seen.spec.randbias else own.bias.r - row.bias.r
        if abs(veers) >= LEAST_DEGREES / CELL_SIZE:
            side = "left" if veers > 0.0 else "right"
            yield own.code, f"turns {abs(veers):.2f} deg further to the {side} for each inch than in {name}"
    gripper = seen.spec.gripper
    if gripper is None or not seen.misses:
        return
    other, where = reference.gripper, f"in {name}"
    if other is None:
        # A set without a gripper: that of a row that gives no reach.
        other, where = GripperSpec(code=gripper.code), "by default"
    if other.reach - gripper.reach >= _REACH:
        yield gripper.code, f"reaches {gripper.reach:g} in ahead of the robot, {where} {other.reach:g} in"


def set_differences(seen: Attempt, *, with_limit: bool = True) -> str:
    """A sentence on what the run's set has otherwise than the nominal one, its sensors apart; empty without a
    nominal set, or a difference. The time limit may be told elsewhere."""
    nominal = seen.history.nominal
    if nominal is None:
        return ""
    own, usual = seen.spec, nominal.spec
    parts = [*_of_maze(own, usual)]
    if own.block_size != usual.block_size:
        size = f"the block is {own.block_size:g} in wide, not {usual.block_size:g} in"
        parts.append(size if own.block_size else "there is no block")
    reach, usual_reach = (Footprint.of(each.robot).reach for each in (own, usual))
    if abs(reach - usual_reach) >= _REACH:
        parts.append(f"the robot reaches {reach:.3g} in from its centre, not {usual_reach:.3g} in")
    grip, other = own.gripper, usual.gripper
    if grip is not None and other is not None:
        if grip.reach != other.reach:
            parts.append(f"the gripper reaches {grip.reach:g} in, not {other.reach:g} in")
        if grip.width != other.width:
            parts.append(f"the gripper is {grip.width:g} in wide, not {other.width:g} in")
        if not 1 / _SPEED < grip.speed / other.speed < _SPEED:
            parts.append(f"the gripper takes {1 / grip.speed:g} s to close, not {1 / other.speed:g} s")
    drives = {each.code: each for each in usual.drives}
    for each in own.drives:
        row = drives.get(each.code)
        if row is not None and row.kind is each.kind and not 1 / _SPEED < each.speed / row.speed < _SPEED:
            unit = "deg/s" if each.kind.turns else "in/s"
            parts.append(f"{each.code} moves at {each.speed:g} {unit}, not {row.speed:g} {unit}")
    if with_limit and seen.task is not None and nominal.time_limit not in (None, seen.task.time_limit):
        parts.append(f"the time limit is {seen.task.time_limit:g} s, not {nominal.time_limit:g} s")
    return f"Unlike in the set {nominal.name}, {'; '.join(parts)}." if parts else ""


def _of_maze(own: SimulationSpec, usual: SimulationSpec) -> list[str]:
    """Differences between the walls of two mazes, in words."""
    mine, other = (np.array(each.maze.cells) == WALL for each in (own, usual))
    if mine.shape != other.shape:
        return [f"the maze has {own.maze.rows} by {own.maze.columns} cells"]
    places = np.argwhere(mine != other).tolist()
    if len(places) > _CELLS:
        return [f"{len(places)} cells of the maze differ"]
    has = {True: "is a wall", False: "is no wall"}
    # Rows count from the top, as in maze.csv.
    return [
        f"there {has[bool(mine[row, column])]} in row {row + 1}, column {column + 1}"
        for row, column in places
    ]
