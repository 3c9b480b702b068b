"""Sensors and drives of a run against the truth: all findings of a run, from its history alone.

Each is compared with two sets. An error beyond the run's own set is a fault of the device. Where the run's
set differs from its nominal one, which it was made from, the device does as its set says. A program that
knows the nominal set expects something else. Against the nominal set only rows that differ are tested.

Sensors are compared with an ideal sensor at the place where the run's set has them, with the electronics of
the nominal one. A sign or a wrap that the nominal set declares is convention.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from msgspec import structs
from msgspec.structs import replace

from simmer_tui.config.nominal import Nominal
from simmer_tui.report.drive_audit import DriveRule, drive_tests, set_rule
from simmer_tui.report.finding import (
    LEAST_DEGREES,
    LEAST_INCHES,
    LEAST_SHARE,
    Basis,
    Claim,
    DeviceUnderTest,
    Finding,
    FindingKind,
    kept,
)
from simmer_tui.report.sensor_audit import change_text, sensor_tests
from simmer_tui.report.sensor_sample import by_sensor, sample_of
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.table import Columns
from simmer_tui.sim.angles import half_turn
from simmer_tui.sim.noise import bias_spread
from simmer_tui.sim.specs import DriveSpec, SensorSpec, SimulationSpec

_MOUNTING = ("x", "y", "z", "rotation", "field_of_view", "rays", "vertical_field_of_view")
"""Fields of a sensor's row for its place and direction."""
# Effects on a range that are told apart, or are in the truth of the log, as that of the mounting is.
_IN_TRUTH = ("incidence_limit", "min_range")
# Share of sensors that are elsewhere above which it is another robot: each is then meant to be where it is.
_ELSEWHERE = 0.5


def audit(history: RunHistory, until: int | None = None) -> tuple[Finding, ...]:
    """The findings about sensors and drives, the surest first; none of a real robot, whose truth no log has.

    Args:
        history: All that happened; it knows the run's nominal set.
        until: Last event that counts, by its running number; by default the newest.
    """
    if history.is_twin:
        return ()
    nominal = history.nominal
    last = history.order if until is None else until
    readings = history.readings.columns(0, history.readings.place_of(last + 1))
    moves = history.movements.columns(0, history.movements.place_of(last + 1))
    tests: list[Claim] = []
    for spec, rows in by_sensor(history, readings):
        sample = sample_of(history, rows, spec, history.spec.sensors)
        tests += [] if sample is None else sensor_tests(DeviceUnderTest(spec.code, "reading"), sample)
        if nominal is not None:
            tests += _nominal_sensor_tests(history, rows, spec, nominal)
    for number, code in enumerate(history.code_names):
        row = next((each for each in history.spec.drives if each.code == code), None)
        if row is None:
            continue
        mine = moves[moves["code"] == number]
        device, rule = DeviceUnderTest(code, "movement"), set_rule(history, mine, row)
        tests += drive_tests(device, mine, rule, history.spec.drives)
        if nominal is not None:
            tests += _nominal_drive_tests(history, mine, row, nominal)
    return kept(tests)


# -- against the nominal set ---------------------------------------------------------------------------


def _nominal_sensor_tests(
    history: RunHistory, rows: Columns, own: SensorSpec, nominal: Nominal
) -> list[Claim]:
    """Tests of a sensor by its readings, where the nominal set has another row for its code."""
    row = next((each for each in nominal.spec.sensors if each.code == own.code), None)
    if row is None or not len(rows) or structs.replace(row, number=own.number) == own:
        return []
    device = _device(own.code, "reading", nominal)
    if (other := _swapped_with(own, row, history.spec, nominal.spec)) is not None:
        what = change_text(own, FindingKind.SWAPPED, 1.0, other)
        return [device.claim(0.0, FindingKind.SWAPPED, 1.0, what, len(rows), other=other)]
    if (turned := _turned(own, row)) is not None:
        value, unit = (own.bias, own.unit) if turned is FindingKind.STUCK else (-1.0, "")
        what = change_text(own, turned, value)
        return [device.claim(0.0, turned, value, what, len(rows), unit=unit)]
    tests = [*_mounted(history, rows, own, row, nominal), *_blind(own, row, rows, nominal)]
    taken = (*_MOUNTING, *_IN_TRUTH)
    placed = {name: getattr(own, name) for name in own.__struct_fields__ if name in taken}
    # Another kind of sensor under this code measures something else altogether.
    if row.kind is own.kind and structs.replace(row, **placed, number=own.number) != own:
        sample = sample_of(history, rows, structs.replace(row, **placed))
        if sample is not None:
            tests += sensor_tests(device, sample)
    return tests


def _nominal_drive_tests(
    history: RunHistory, moves: Columns, own: DriveSpec, nominal: Nominal
) -> list[Claim]:
    """Tests of a drive by its movements, where the nominal set has another row for its code, or draws biases
    of another strength."""
    row = next((each for each in nominal.spec.drives if each.code == own.code), None)
    if row is None or not len(moves) or _moves_alike(own, row, history.spec, nominal.spec):
        return []
    device = _device(own.code, "movement", nominal)
    count = len(moves)
    if own.kind is not row.kind:
        other = next((each.code for each in nominal.spec.drives if each.kind is own.kind), None)
        what = "moves like no drive of that set" if other is None else f"does what {other} should do"
        return [device.claim(0.0, FindingKind.SWAPPED, 1.0, what, count, other=other)]
    if own.gain * row.gain < 0.0:
        return [device.claim(0.0, FindingKind.SIGN, -1.0, f"{row.kind.verb} the wrong way", count)]
    rule = _nominal_rule(history, moves, own, row, nominal.spec)
    tests = drive_tests(device, moves, rule, nominal.spec.drives)
    # A gain that is in the rows needs no test.
    if not row.gain or abs(own.gain / row.gain - 1.0) < LEAST_SHARE:
        return tests
    return [
        replace(each, probability=0.0) if each.finding and each.finding.kind is FindingKind.GAIN else each
        for each in tests
    ]


def _nominal_rule(
    history: RunHistory, moves: Columns, own: DriveSpec, row: DriveSpec, nominal: SimulationSpec
) -> DriveRule:
    """Expected motion of a drive by its nominal row, with the bias that the run's set declares or draws."""
    spec = history.spec
    if not spec.randbias:
        # A bias that a set declares is fixed, not drawn.
        return DriveRule(row, np.tile(structs.astuple(row.bias), (len(moves), 1)), np.zeros(3))
    if spec.strength == nominal.strength:
        # A bias is a share of the command after the drive's own Gain.
        drawn = set_rule(history, moves, own).biases * (own.gain / row.gain if row.gain else 1.0)
        return DriveRule(row, drawn, np.zeros(3))
    return DriveRule(row, np.zeros((len(moves), 3)), np.array(bias_spread(row.kind, nominal.strength)))


def _moves_alike(own: DriveSpec, row: DriveSpec, spec: SimulationSpec, nominal: SimulationSpec) -> bool:
    same = (own.kind, own.gain, own.error) == (row.kind, row.gain, row.error)
    if spec.randbias:
        return same and (not nominal.randbias or spec.strength == nominal.strength)
    return same and own.bias == row.bias


# -- by the rows alone -------------------------------------------------------------------------------


def _swapped_with(
    own: SensorSpec, row: SensorSpec, spec: SimulationSpec, nominal: SimulationSpec
) -> str | None:
    """The code of the nominal sensor with which this one is swapped; None if it is the right one."""
    if _mounting(own) == _mounting(row) and own.kind is row.kind:
        return None
    now = {each.code: _mounting(each) for each in spec.sensors}
    for each in nominal.sensors:
        # A sensor that is where another still is has moved; it was not swapped.
        if each.code == own.code or each.kind is not own.kind or now.get(each.code) == _mounting(each):
            continue
        if _mounting(each) == _mounting(own):
            return each.code
    return None


def _turned(own: SensorSpec, row: SensorSpec) -> FindingKind | None:
    """Stuck or turned, where one row says so and the other does not."""
    if own.kind is not row.kind:
        return None
    if own.gain == 0.0 != row.gain:
        return FindingKind.STUCK
    if own.gain * row.gain < 0.0 or own.is_inverted != row.is_inverted:
        return FindingKind.SIGN
    return None


def _mounting(row: SensorSpec) -> tuple[object, ...]:
    return tuple(getattr(row, name) for name in _MOUNTING if row.kind.has(name))


def _mounted(
    history: RunHistory, rows: Columns, own: SensorSpec, row: SensorSpec, nominal: Nominal
) -> Iterator[Claim]:
    """A sensor that is elsewhere, or looks elsewhere."""
    if row.kind is not own.kind or is_another_robot(history.spec, nominal.spec):
        return
    device, count = DeviceUnderTest(own.code, "reading", Basis.NOMINAL), len(rows)
    turned = half_turn(own.rotation - row.rotation)
    if own.kind.has("rotation") and abs(turned) >= LEAST_DEGREES:
        side = "left" if turned > 0 else "right"
        what = f"looks {abs(turned):.1f} deg further to the {side} than in {_by(nominal)}"
        yield device.claim(0.0, FindingKind.MOUNTING, turned, what, count, unit="deg")
    moved = math.hypot(own.x - row.x, own.y - row.y)
    if own.kind.has("x") and moved >= LEAST_INCHES:
        what = f"is mounted {moved:.1f} in from where {_by(nominal)} has it"
        yield device.claim(0.0, FindingKind.MOUNTING, moved, what, count, unit="in")
    higher = own.z - row.z
    if own.kind.has("z") and abs(higher) >= LEAST_INCHES:
        what = f"is mounted at Z {own.z:g} in, in {_by(nominal)} at {row.z:g} in"
        yield device.claim(0.0, FindingKind.MOUNTING, higher, what, count, unit="in")


def _blind(own: SensorSpec, row: SensorSpec, rows: Columns, nominal: Nominal) -> Iterator[Claim]:
    """A range sensor that reads nothing as near as in the nominal set, and met something nearer."""
    met = int((rows["true"] < own.min_range).sum())
    if row.kind is own.kind and own.min_range - row.min_range >= LEAST_INCHES and met:
        device = DeviceUnderTest(own.code, "reading", Basis.NOMINAL)
        what = f"reads nothing nearer than {own.min_range:g} in, unlike in {_by(nominal)}"
        yield device.claim(0.0, FindingKind.MISSED, own.min_range, what, met, unit="in")


def is_another_robot(spec: SimulationSpec, nominal: SimulationSpec) -> bool:
    """True if most sensors of a set are mounted elsewhere than in the nominal one."""
    places = {each.code: _mounting(each) for each in nominal.sensors}
    elsewhere = [places.get(each.code) != _mounting(each) for each in spec.sensors]
    return sum(elsewhere) > _ELSEWHERE * len(elsewhere)


def _device(code: str, rows: str, nominal: Nominal) -> DeviceUnderTest:
    """A device whose findings name the set that it was compared with."""
    return DeviceUnderTest(code, rows, Basis.NOMINAL, f", against {_by(nominal)}")


def _by(nominal: Nominal) -> str:
    return f"the nominal set {nominal.name}"
