"""Before a calibrated set is written: swapped, turned and stuck parts are suspected, and others are not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from benchmarks.emulated_robots import draw_robot, placed, record, set_with, wandering
from simmer_tui.calibrate.fit import Fit, fit
from simmer_tui.calibrate.measured_run import read_runs
from simmer_tui.calibrate.suspicions import suspicions, suspicions_without_path
from simmer_tui.cli.log_reports import build_report
from simmer_tui.cli.main import main
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.sim.specs import DriveSpec, SensorSpec, SimulationSpec

CODES = ("u1", "u2", "u3", "u4", "c1", "o1", "o2", "o3", "o4", "g1")
Wrong = Callable[[SimulationSpec], SimulationSpec]


def swapped(first: str, second: str) -> Wrong:
    names = {first: second, second: first}

    def change(spec: SimulationSpec) -> SimulationSpec:
        sensors = [replace(each, code=names.get(each.code, each.code)) for each in spec.sensors]
        drives = [replace(each, code=names.get(each.code, each.code)) for each in spec.drives]
        return replace(spec, sensors=tuple(sensors), drives=tuple(drives))

    return change


def turned(code: str) -> Wrong:
    def one(each: SensorSpec | DriveSpec) -> SensorSpec | DriveSpec:
        return replace(each, gain=-1.0) if each.code == code else each

    def change(spec: SimulationSpec) -> SimulationSpec:
        return replace(spec, sensors=tuple(map(one, spec.sensors)), drives=tuple(map(one, spec.drives)))

    return change


def logged_with(folder: Path, wrong: Wrong) -> Path:
    """The log of a robot that is not wired as its set says."""
    random = np.random.default_rng(3)
    configured, hidden = placed(load(bundled_folder()).simulation, random)
    hidden = wrong(draw_robot(random, hidden))
    path = folder / "robot.jsonl"
    record(path, set_with(configured), hidden, 3, wandering(50, 3, CODES), latency=0.02)
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wrong", "expected"),
    [
        (swapped("u2", "u4"), {("u2", "swapped", "u4"), ("u4", "swapped", "u2")}),
        (swapped("d1", "w1"), {("d1", "swapped", "w1"), ("w1", "swapped", "d1")}),
        (turned("r1"), {("r1", "sign", None)}),
        (turned("c1"), {("c1", "sign", None)}),
    ],
)
def test_a_part_that_is_wired_wrongly_is_suspected(
    wrong: Wrong, expected: set[tuple[str, str, str | None]], tmp_path: Path
) -> None:
    found = suspicions(fit(read_runs([logged_with(tmp_path, wrong)])))
    assert {(each.of, each.kind.value, each.other) for each in found} == expected


def test_a_robot_of_the_model_is_not_suspected(found: Fit) -> None:
    assert suspicions(found) == ()


def test_a_turned_gyro_is_suspected_where_it_leads_to_no_path(tmp_path: Path) -> None:
    log = logged_with(tmp_path, turned("g1"))
    assert [each.text[:28] for each in suspicions_without_path(read_runs([log]))] == [
        "g1 reads with the wrong sign"
    ]


def test_a_report_holds_no_real_robot_against_its_twin(tmp_path: Path) -> None:
    run = build_report(logged_with(tmp_path, turned("r1")), recorded=False)
    assert run.history.readings
    assert run.findings == ()


@pytest.mark.slow
def test_a_set_that_hides_a_fault_is_written_only_if_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = logged_with(tmp_path, turned("r1")), tmp_path / "set"
    assert main(["calibrate", str(log), "--out", str(out)]) == 2
    assert "r1 turns the wrong way (10 movements)" in capsys.readouterr().err
    assert not out.exists()
    assert main(["calibrate", str(log), "--out", str(out), "--anyway"]) == 0
    assert "because of --anyway" in capsys.readouterr().err
    assert load(out).settings.nominal == ""
