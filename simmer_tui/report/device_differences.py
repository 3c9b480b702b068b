"""Devices of a run that differ from those of the set that a program knows, and the effect of it.

In a simulator the set is the truth: a device does what its row says. So nothing is tested or guessed. The row
of each sensor and drive that was used is compared with its row of the nominal set, field by field. The fields
say what differs, and the history how large the effect was. What has no effect that matters is not told.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from msgspec.structs import replace

from simmer_tui.report.drive_differences import drive_differences
from simmer_tui.report.finding import FEWEST, Basis, Device, Finding, FindingKind
from simmer_tui.report.run_readings import by_sensor
from simmer_tui.report.sensor_differences import is_another_robot, sensor_differences
from simmer_tui.report.set_differences import reference_set
from simmer_tui.run.attempt import Attempt
from simmer_tui.sim.specs import GripperSpec, SimulationSpec

# Judged: an inch is a third of the way beside a robot in a corridor; 5 degrees lead an inch aside in a cell.
_LARGE = {"in": 1.0, "deg": 5.0}
"""Least errors that are told of another robot than the one that a program knows, by unit."""
_GAIN = 0.1
"""Share by which such a robot moves or reads more or less, from which that is told. Judged."""
_SLOW = 1.0
"""Seconds by which a reading takes longer than in another set, from which that is told. Judged."""
_REACH = 0.25
"""Inches by which a gripper reaches less far than in another set, from which that is told. Judged."""
_DECLARED = (
    *(FindingKind.OFFSET, FindingKind.DRIFT, FindingKind.GAIN, FindingKind.BIAS),
    *(FindingKind.NOISE, FindingKind.STUCK, FindingKind.MOUNTING),
)
"""Kinds that are told with few readings, or of another robot: not what needs many, nor another convention."""
_BY_ROW = (FindingKind.SWAPPED, FindingKind.SIGN, FindingKind.STUCK, FindingKind.MOUNTING)
"""Kinds that one reading shows as well as many."""


def device_findings(seen: Attempt) -> tuple[Finding, ...]:
    """Devices that differ from the nominal set by enough readings or movements, or by their kind, sign or
    mounting. None without a nominal set: another robot has no fault."""
    nominal = seen.history.nominal
    if nominal is None:
        return ()
    found = _differences(seen, f"the nominal set {nominal.name}", nominal.spec, Basis.NOMINAL)
    return tuple(each for each in found if each.count >= FEWEST["nominal"] or each.kind in _BY_ROW)


def declared_errors(seen: Attempt) -> dict[str, str]:
    """Other large errors of the devices that an attempt used, by code: `takes 3 s for a reading`."""
    told: dict[str, str] = {}
    if not seen.history.is_twin:
        for code, text in (*_of_few(seen), *_slow(seen), *_of_gripper(seen)):
            told[code] = f"{told[code]}, and {text}" if code in told else text
    return told


def _differences(seen: Attempt, name: str, reference: SimulationSpec, basis: Basis) -> list[Finding]:
    """Differences of the devices that an attempt used from those of a set, those of the most used first. None
    of a real robot: no log has its truth."""
    history, found = seen.history, list[tuple[int, list[Finding]]]()
    if history.is_twin:
        return []
    sensors = {each.code: each for each in reference.sensors}
    drives = {each.code: each for each in reference.drives}
    for own, readings in by_sensor(history, seen.within(history.readings)):
        row = sensors.get(own.code)
        if row is None or own.kind.is_opaque or replace(row, number=own.number) == own:
            continue
        device = Device(own.code, "reading", name, basis)
        told = list(sensor_differences(history, own, row, readings, reference, device))
        if is_another_robot(seen.spec, reference):
            told = [each for each in told if each.kind is not FindingKind.MOUNTING]
        found.append((len(readings), told))
    moves, names = seen.within(history.movements), history.code_names
    for drive in seen.spec.drives:
        usual = drives.get(drive.code)
        mine = moves[np.isin(moves["code"], [names.index(drive.code)] if drive.code in names else [])]
        if usual is not None and len(mine):
            device = Device(drive.code, "movement", name, basis)
            found.append((len(mine), list(drive_differences(history, drive, usual, mine, reference, device))))
    return [each for _, told in sorted(found, key=lambda one: -one[0]) for each in told]


def _of_few(seen: Attempt) -> Iterator[tuple[str, str]]:
    """Differences with few readings or movements; without a nominal set all large ones."""
    name, reference = reference_set(seen.history)
    for each in _differences(seen, name, reference, Basis.SET):
        size, least = abs(each.value), _LARGE.get(each.unit, 0.0)
        if each.kind is FindingKind.GAIN:
            size, least = abs(each.value - 1.0), _GAIN
        if each.kind in _DECLARED and (size >= least or seen.history.nominal is not None):
            yield each.of, each.what


def _slow(seen: Attempt) -> Iterator[tuple[str, str]]:
    """Sensors that take much longer for a reading than in the reference set."""
    name, reference = reference_set(seen.history)
    usual = {each.code: each.read_time for each in reference.sensors}
    for own, _ in by_sensor(seen.history, seen.within(seen.history.readings)):
        if own.read_time - usual.get(own.code, own.read_time) >= _SLOW:
            yield own.code, f"takes {own.read_time:g} s for a reading, in {name} {usual[own.code]:g} s"


def _of_gripper(seen: Attempt) -> Iterator[tuple[str, str]]:
    """A gripper that reaches less far than in the reference set, and closed on nothing."""
    gripper, (name, reference) = seen.spec.gripper, reference_set(seen.history)
    if gripper is None or not seen.misses:
        return
    # A set without a gripper: that of a row that gives no reach.
    other = reference.gripper or GripperSpec(code=gripper.code)
    if other.reach - gripper.reach >= _REACH:
        where = "by default" if reference.gripper is None else f"in {name}"
        yield gripper.code, f"reaches {gripper.reach:g} in ahead of the robot, {where} {other.reach:g} in"
