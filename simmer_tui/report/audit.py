"""Sensors and drives of a run against the truth: all findings of a run, from its history alone."""

from __future__ import annotations

from simmer_tui.report.finding import Basis, Finding, Tested, kept
from simmer_tui.report.sensor_audit import sensor_tests
from simmer_tui.run.run_history import RunHistory


def audit(history: RunHistory, until: int | None = None) -> tuple[Finding, ...]:
    """The findings about sensors and drives, the surest first.

    Args:
        history: A run with a simulated robot.
        until: Last event that counts, by its running number; by default the newest.
    """
    end = history.readings.place_of((history.order if until is None else until) + 1)
    readings = history.readings.columns(0, end)
    tests: list[Tested] = []
    for number, code in enumerate(history.sensor_codes):
        spec = next((each for each in history.spec.sensors if each.code == code), None)
        if spec is not None:
            tests += sensor_tests(history, readings[readings["sensor"] == number], spec, Basis.SET)
    return kept(tests)
