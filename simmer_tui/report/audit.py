"""Sensors and drives of a run against the truth: all findings of a run, from its history alone.

Each is held against two sets. Beyond what the run's own set declares, something is wrong with the device.
Where that set differs from its nominal one, which it was made from, the device does as its set says, and
otherwise than a program expects that knows the nominal one.
"""

from __future__ import annotations

from simmer_tui.report.drive_audit import drive_tests, set_rule
from simmer_tui.report.finding import Basis, Claim, Finding, kept
from simmer_tui.report.nominal_audit import nominal_drive_tests, nominal_sensor_tests
from simmer_tui.report.sensor_audit import sensor_tests
from simmer_tui.report.sensor_sample import sample_of
from simmer_tui.run.run_history import RunHistory


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
    for number, code in enumerate(history.sensor_codes):
        spec = next((each for each in history.spec.sensors if each.code == code), None)
        if spec is None:
            continue
        rows = readings[readings["sensor"] == number]
        sample = sample_of(history, rows, spec, history.spec.sensors)
        tests += [] if sample is None else sensor_tests(sample, Basis.SET)
        if nominal is not None:
            tests += nominal_sensor_tests(history, rows, spec, nominal)
    for number, code in enumerate(history.code_names):
        row = next((each for each in history.spec.drives if each.code == code), None)
        if row is None:
            continue
        mine = moves[moves["code"] == number]
        tests += drive_tests(mine, set_rule(history, mine, row), history.spec.drives, Basis.SET)
        if nominal is not None:
            tests += nominal_drive_tests(history, mine, row, nominal)
    return kept(tests)
