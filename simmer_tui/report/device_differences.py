"""Devices of a run that differ from those of the set that a program knows, and the effect of it.

In a simulator the set is the truth: a device does what its row says. So nothing is tested or guessed. The row
of each sensor and drive that was used is compared with its row of the nominal set, field by field. The fields
say what differs, and the history how large the effect was. What has no effect that matters is not told.
"""

from __future__ import annotations

from collections.abc import Collection

from msgspec.structs import replace

from simmer_tui.report.drive_differences import drive_differences
from simmer_tui.report.finding import FEWEST, Basis, Device, Finding, FindingKind
from simmer_tui.report.run_readings import by_sensor
from simmer_tui.report.sensor_differences import is_another_robot, sensor_differences
from simmer_tui.report.set_differences import GRIPPER_NOUN, bundled, number_differences
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.run_history import rows_by_name
from simmer_tui.sim.specs import SimulationSpec

# Kinds that one reading shows as well as many.
_BY_ROW = (FindingKind.SWAPPED, FindingKind.SIGN, FindingKind.STUCK, FindingKind.MOUNTING)
# Kinds that are no errors of another robot than the one that a program knows.
_CONVENTIONS = (FindingKind.SWAPPED, FindingKind.SIGN, FindingKind.OTHER)


def device_findings(seen: Attempt) -> tuple[Finding, ...]:
    """Devices that differ from the nominal set by enough readings or movements, or by their kind, sign or
    mounting. None without a nominal set: another robot has no fault."""
    nominal = seen.history.nominal
    if nominal is None:
        return ()
    found = _differences(seen, nominal.spec, f"the nominal set {nominal.name}")
    return tuple(each for each in found if each.count >= FEWEST["nominal"] or each.kind in _BY_ROW)


def declared_errors(seen: Attempt, known: Collection[str] = ()) -> dict[str, str]:
    """Other errors of the devices that an attempt used, by code: `takes 3 s for a reading`. Those with a
    finding, by the codes `known`, are left out. Without a nominal set they are those beyond the bundled
    one."""
    history, told = seen.history, dict[str, str]()
    if history.is_twin:
        return told
    name, usual = "the bundled set", bundled()
    if history.nominal is not None:
        name, usual = f"the set {history.nominal.name}", history.nominal.spec
    used = {own.code: own.code for own, _ in by_sensor(history, seen.within(history.readings))}
    if seen.spec.gripper is not None and seen.misses:
        used[GRIPPER_NOUN] = seen.spec.gripper.code
    found = [each for each in _differences(seen, usual, name, known) if each.kind not in _CONVENTIONS]
    numbers = number_differences(seen.spec, usual)
    pairs = [(each.of, each.text.removeprefix(f"{each.of} ")) for each in found]
    for code, text in (*pairs, *((used[of], f"{text} as in {name}") for of, text in numbers if of in used)):
        if code not in known:
            told[code] = f"{told[code]}, and {text}" if code in told else text
    return told


def _differences(
    seen: Attempt, reference: SimulationSpec, name: str, known: Collection[str] = ()
) -> list[Finding]:
    """Differences of the devices that an attempt used from those of a set, those of the most readings or
    movements first, without `known` codes. None of a real robot: no log has its truth."""
    history, found = seen.history, list[Finding]()
    if history.is_twin:
        return found
    sensors = {each.code: each for each in reference.sensors}
    for own, readings in by_sensor(history, seen.within(history.readings)):
        row = None if own.code in known else sensors.get(own.code)
        if row is not None and not own.kind.is_opaque and replace(row, number=own.number) != own:
            device = Device(own.code, "reading", name, Basis.NOMINAL)
            found += sensor_differences(history, own, row, readings, reference, device)
    if is_another_robot(seen.spec, reference):
        found = [each for each in found if each.kind is not FindingKind.MOUNTING]
    drives = {each.code: each for each in reference.drives}
    own_drives = {each.code: each for each in seen.spec.drives}
    for code, moves in rows_by_name(seen.within(history.movements), "code", history.code_names):
        if code in own_drives and code in drives and code not in known:
            device = Device(code, "movement", name, Basis.NOMINAL)
            found += drive_differences(history, own_drives[code], drives[code], moves, reference, device)
    return sorted(found, key=lambda each: -each.count)
