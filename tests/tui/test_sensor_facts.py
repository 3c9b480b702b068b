"""One sensor looked at closely."""

from __future__ import annotations

from msgspec.structs import replace

from simmer_tui.sim import SimulationSpec
from simmer_tui.tui.line_panel import text_of
from simmer_tui.tui.sensor_facts import sensor_facts
from tests.tui.test_readouts import Run

WIDTH = 54
"""Columns of the panel on a screen of 200."""


def facts(run: Run, spec: SimulationSpec, chosen: str = "") -> list[str]:
    lines = sensor_facts(run.snapshot(), WIDTH, chosen, {}, spec.sensors, plain=False)
    return [text_of(line).rstrip() for line in lines]


def test_the_sensor_read_last_says_where_it_sits_and_looks(course_spec: SimulationSpec) -> None:
    run = Run(course_spec)
    assert facts(run, course_spec)[1] == "none read yet"
    run.give("u4")
    head, looks, sits, read, last = facts(run, course_spec)
    assert head.startswith("sensor u4 ")
    assert looks == "looks    45 deg to the right of the front, 5 deg wide"
    assert sits == "sits     2.1 in ahead, 2.1 in right, 6 in up"
    assert read.startswith("read     ")
    assert last.startswith("last 1   ")


def test_every_fact_of_every_sensor_fits(course_spec: SimulationSpec) -> None:
    run = Run(course_spec)
    for sensor in course_spec.sensors:
        lines = facts(run, course_spec, sensor.code)
        assert max(map(len, lines)) <= WIDTH, lines
        assert lines[-1] == "read     not yet"


def test_a_sensor_at_the_centre_or_behind_it_says_so(course_spec: SimulationSpec) -> None:
    first, *rest = course_spec.sensors
    at_centre = replace(course_spec, sensors=(replace(first, x=0.0, y=0.0, rotation=180.0), *rest))
    run = Run(at_centre)
    assert facts(run, at_centre, first.code)[1:3] == [
        "looks    to the rear, 5 deg wide",
        "sits     at the centre, 6 in up",
    ]
