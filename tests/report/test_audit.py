"""Sensors and drives against the truth: a fault in a run is named with its figures, and nothing else is."""

from __future__ import annotations

import json
import sys
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.cli.main import main
from simmer_tui.config.loader import find_set, load
from simmer_tui.config.nominal import Nominal, nominal_of
from simmer_tui.report.audit import audit
from simmer_tui.report.finding import Basis, Claim, DeviceUnderTest, Finding, FindingKind, kept
from simmer_tui.report.sensor_audit import sensor_tests
from simmer_tui.report.sensor_sample import SensorSample, inverted_compass
from simmer_tui.sim import SimulationSpec
from simmer_tui.sim.records import Reading
from simmer_tui.sim.sensors import modelled_sensor
from simmer_tui.sim.specs import Axes
from tests.report.wandering import Change, wandered


@pytest.fixture(scope="module")
def mission() -> SimulationSpec:
    return load(find_set("mission")).simulation


def of(code: str, change: Callable[[float], float]) -> Change:
    return lambda each: change(each.value) if each.sensor.code == code else each.value


def late(code: str, readings: int) -> Change:
    waiting: deque[float] = deque(maxlen=readings + 1)

    def change(each: Reading) -> float:
        if each.sensor.code != code:
            return each.value
        waiting.append(each.value)
        return waiting[0]

    return change


def brief(found: tuple[Finding, ...]) -> set[tuple[str, str]]:
    return {(each.of, each.kind.value) for each in found}


def test_an_offset_beyond_the_set_is_found_with_its_interval(mission: SimulationSpec) -> None:
    (found,) = audit(wandered(mission, 1, of("u1", lambda value: value + 3.0)))
    assert (found.of, found.kind, found.basis) == ("u1", FindingKind.OFFSET, Basis.SET)
    assert found.low < 3.0 < found.high
    interval = f"{found.low:.2f} to {found.high:.2f}, {found.count} readings"
    assert found.text == f"u1 reads {found.value:.1f} in too long ({interval})"


@pytest.mark.quick_cases(5)
@pytest.mark.parametrize(
    ("change", "code", "kind", "value"),
    [
        (of("u3", lambda value: value * 0.8), "u3", FindingKind.GAIN, 0.8),
        (of("c1", lambda value: value + 20.0), "c1", FindingKind.OFFSET, 20.0),
        (of("u2", lambda value: 7.5), "u2", FindingKind.STUCK, 7.5),
        (of("c1", lambda value: -value), "c1", FindingKind.SIGN, -1.0),
        (late("u1", 1), "u1", FindingKind.LATE, 1.0),
        (of("g1", lambda value: value * 0.8), "g1", FindingKind.GAIN, 0.8),
        (of("o1", lambda value: value * 1.3), "o1", FindingKind.GAIN, 1.3),
        (of("g1", lambda value: 5.0), "g1", FindingKind.STUCK, 0.0),
        (of("g1", lambda value: -value), "g1", FindingKind.SIGN, -1.0),
        (of("i2", lambda value: 1.0), "i2", FindingKind.STUCK, 1.0),
        (late("g1", 2), "g1", FindingKind.LATE, 2.0),
    ],
)
def test_a_fault_beyond_the_set_is_named(
    mission: SimulationSpec, change: Change, code: str, kind: FindingKind, value: float
) -> None:
    (found,) = audit(wandered(mission, 2, change))
    assert (found.of, found.kind, found.basis) == (code, kind, Basis.SET)
    assert found.value == pytest.approx(value, rel=0.03)
    assert found.text.startswith(code)


@pytest.mark.parametrize(("headings", "found"), [((90.0,), 0), ((88.0, 92.0), 0), ((0.0, 90.0, 200.0), 1)])
def test_at_one_heading_no_sign_can_be_told_from_an_offset(
    mission: SimulationSpec, headings: tuple[float, ...], found: int
) -> None:
    compass = modelled_sensor(next(each for each in mission.sensors if each.code == "c1"))
    base = np.array(headings * 12)
    sample = SensorSample(compass, 300.0 - base, base, np.full(len(base), 5.0))
    assert len(list(inverted_compass(sample, base))) == found


@pytest.mark.parametrize(("shift", "kind"), [(0.0, FindingKind.OFFSET), (30.0, FindingKind.GAIN)])
def test_at_one_distance_no_gain_can_be_told_from_an_offset(
    mission: SimulationSpec, shift: float, kind: FindingKind
) -> None:
    sensor = modelled_sensor(next(each for each in mission.sensors if each.code == "u1"))
    random = np.random.default_rng(1)
    expected = 20.0 + random.normal(0.0, 0.3, 40) + shift * (np.arange(40) % 2)
    sample = SensorSample(sensor, 1.3 * expected, expected, np.full(40, 0.4))
    assert [each.kind for each in kept(sensor_tests(DeviceUnderTest("u1", "reading"), sample))] == [kind]


def test_values_cut_off_at_zero_do_not_hide_an_offset(mission: SimulationSpec) -> None:
    (found,) = audit(wandered(mission, 1, of("u1", lambda value: max(value - 3.0, 0.0))))
    assert (found.kind, round(found.value)) == (FindingKind.OFFSET, -3)
    assert "too short" in found.text


def test_swapped_readings_are_named_with_each_other(mission: SimulationSpec) -> None:
    swapped = {"u2": "u4", "u4": "u2"}
    simulated = replace(
        mission,
        sensors=tuple(replace(each, code=swapped.get(each.code, each.code)) for each in mission.sensors),
    )
    # What a run tells that has the sensors' codes swapped, held against the set as it should be.
    found = audit(wandered(simulated, 3, told=mission))
    assert {(each.of, each.kind, each.other) for each in found} == {
        ("u2", FindingKind.SWAPPED, "u4"),
        ("u4", FindingKind.SWAPPED, "u2"),
    }


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize("seed", range(4))
def test_a_run_without_a_fault_has_no_findings(mission: SimulationSpec, seed: int) -> None:
    assert audit(wandered(mission, seed, nominal=Nominal("mission", mission))) == ()


def test_few_readings_claim_nothing(mission: SimulationSpec) -> None:
    assert audit(wandered(mission, 1, of("u1", lambda value: value + 3.0), steps=5)) == ()


def test_an_offset_beside_a_small_drift_stays_an_offset(mission: SimulationSpec) -> None:
    (found,) = audit(wandered(mission, 1, of("u1", lambda value: value + 3.0), steps=60))
    assert found.kind is FindingKind.OFFSET


# -- against the nominal set -------------------------------------------------------------------------


def sensor(spec: SimulationSpec, code: str, **fields: Any) -> SimulationSpec:
    return replace(
        spec,
        sensors=tuple(replace(each, **fields) if each.code == code else each for each in spec.sensors),
    )


def drive(spec: SimulationSpec, code: str, **fields: Any) -> SimulationSpec:
    drives = tuple(replace(each, **fields) if each.code == code else each for each in spec.drives)
    return replace(spec, drives=drives, randbias=False)


def renamed(spec: SimulationSpec, codes: dict[str, str]) -> SimulationSpec:
    def change(rows: Any) -> Any:
        return tuple(replace(each, code=codes.get(each.code, each.code)) for each in rows)

    return replace(spec, sensors=change(spec.sensors), drives=change(spec.drives))


@pytest.mark.quick_cases(12)
@pytest.mark.parametrize(
    ("variant", "expected"),
    [
        (lambda spec: sensor(spec, "u1", bias=3.0), {("u1", "offset")}),
        (lambda spec: sensor(spec, "u1", gain=0.0, bias=9.0), {("u1", "stuck")}),
        (lambda spec: sensor(spec, "u1", error=0.4), {("u1", "noise")}),
        (lambda spec: sensor(spec, "u1", dropout=0.4), {("u1", "missed")}),
        (lambda spec: sensor(spec, "u1", rotation=15.0), {("u1", "mounting")}),
        (lambda spec: sensor(spec, "u5", z=4.0), {("u5", "mounting")}),
        (lambda spec: sensor(spec, "g1", drift=0.5), {("g1", "drift")}),
        (lambda spec: renamed(spec, {"u2": "u4", "u4": "u2"}), {("u2", "swapped"), ("u4", "swapped")}),
        (lambda spec: drive(spec, "d1", bias=Axes(r=1.0)), {("d1", "bias")}),
        (lambda spec: drive(spec, "d1", gain=0.8), {("d1", "gain")}),
        (lambda spec: drive(spec, "r1", gain=-1.0), {("r1", "sign")}),
        (lambda spec: renamed(spec, {"d1": "w1", "w1": "d1"}), {("d1", "swapped"), ("w1", "swapped")}),
        (lambda spec: drive(spec, "d1", bias=Axes(y=0.2)), {("d1", "bias")}),
        (lambda spec: sensor(spec, "g1", gain=0.8), {("g1", "gain")}),
        (lambda spec: sensor(spec, "g1", gain=-1.0), {("g1", "sign")}),
    ],
)
def test_what_differs_from_the_nominal_set_is_named(
    mission: SimulationSpec,
    variant: Callable[[SimulationSpec], SimulationSpec],
    expected: set[tuple[str, str]],
) -> None:
    found = audit(wandered(variant(mission), 4, nominal=Nominal("mission", mission)))
    assert brief(found) == expected
    assert {each.basis for each in found} == {Basis.NOMINAL}
    assert all("the nominal set mission" in each.text for each in found)


def test_a_sign_that_the_nominal_set_declares_is_convention() -> None:
    spec = load(find_set("simmer-python")).simulation
    assert audit(wandered(spec, 1, nominal=Nominal("simmer-python", spec))) == ()


def test_a_drawn_bias_is_expected(mission: SimulationSpec) -> None:
    other = replace(mission, strength=(0.04, 0.9))
    assert audit(wandered(other, 1, nominal=Nominal("mission", mission))) == ()


def test_a_gain_does_not_make_a_bias_of_the_drawn_one(mission: SimulationSpec) -> None:
    weak = replace(drive(mission, "d1", gain=0.7), randbias=True)
    (found,) = audit(wandered(weak, 5, nominal=Nominal("mission", mission)))
    assert (found.of, found.kind) == ("d1", FindingKind.GAIN)
    assert found.low < 0.7 < found.high


def test_the_nominal_set_is_named_or_found(tmp_path: Path) -> None:
    assert main(["init", str(tmp_path / "mine"), "--from", "mission"]) == 0
    made = load(tmp_path / "mine")
    assert made.settings.nominal == "mission"
    named = nominal_of(made)
    assert named is not None
    assert named.name == "mission"
    # A set that was copied by hand, before sets had that line.
    text = (tmp_path / "mine" / "settings.toml").read_text("utf-8")
    (tmp_path / "mine" / "settings.toml").write_text(text.replace('nominal = "mission"', ""), "utf-8")
    found = nominal_of(load(tmp_path / "mine"))
    assert found is not None
    assert found.name == "mission"
    # A set that shares no parts with a bundled one is a variant of none.
    mission = load(find_set("mission"))
    other = replace(mission, name="other", simulation=replace(mission.simulation, sensors=()))
    assert nominal_of(other) is None


def test_a_report_has_the_findings_in_its_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, log = tmp_path / "mine", tmp_path / "run.jsonl"
    main(["init", str(folder)])
    rows = (folder / "sensors.csv").read_text("utf-8")
    # The gyro counts nothing, as one whose wire is off.
    header, *lines = rows.splitlines()
    lines = [f"{line},0" if line.startswith("gyro1") else line for line in lines]
    (folder / "sensors.csv").write_text("\n".join([f"{header},Gain", *lines]) + "\n", "utf-8")
    script = tmp_path / "turning.py"
    script.write_text(
        "from simmer_tui.client import Robot\n"
        "with Robot() as robot:\n"
        "    for _ in range(4):\n"
        "        robot.drive('r1', 30)\n"
        "        robot.read('g1')\n",
        "utf-8",
    )
    options = ["--config", str(folder), "--seed", "1", "--log", str(log)]
    main(["--no-ui", "--port", "0", *options, "--run", f'"{sys.executable}" "{script}"'])
    capsys.readouterr()
    assert main(["report", str(log), "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)["findings"]
    assert (found["of"], found["kind"], found["basis"], found["with"]) == ("g1", "stuck", "nominal", None)
    assert found["count"] == 4
    assert main(["report", str(log), "--nominal", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["findings"] == []
    assert main(["report", str(log), "--nominal", "nowhere"]) == 2


def test_findings_together_hold_the_error() -> None:
    def made(probability: float) -> Claim:
        found = Finding("u1", FindingKind.GAIN, 2.0, 1.9, 2.1, "", 9, Basis.SET, str(probability))
        return Claim(probability, found)

    # Holm: 0.0001 times four, 0.0003 times three, and then 0.0006 times two is more than a thousandth.
    tests = [made(0.0006), made(0.0001), made(0.0003), Claim(0.5)]
    assert [each.text for each in kept(tests)] == ["0.0001", "0.0003"]


def test_a_sensor_that_misses_everything_by_its_set_is_as_its_set_says(mission: SimulationSpec) -> None:
    silent = sensor(mission, "u1", dropout=1.0)
    assert "u1" not in {each.of for each in audit(wandered(silent, 1))}
