"""Sensors and drives beside their nominal rows: what differs and has an effect is named, and nothing else."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.cli.main import main
from simmer_tui.config.loader import find_set, load
from simmer_tui.config.nominal import Nominal, nominal_of
from simmer_tui.report.device_differences import declared_errors, device_findings
from simmer_tui.report.finding import Basis, Finding
from simmer_tui.report.robust_statistics import median_interval
from simmer_tui.robot.engine import Engine
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.state import checkpoint_of
from simmer_tui.sim import ObservingSensor, Pose, SensorSpec, SimulationSpec, Simulator, World, parse_command
from simmer_tui.sim.columns import CsvColumn
from simmer_tui.sim.rules import NumberRule, WordRule
from simmer_tui.sim.sensors import KINDS
from simmer_tui.sim.specs import Axes
from tests.report.wandering import wandered

Variant = Callable[[SimulationSpec], SimulationSpec]


@pytest.fixture(scope="module")
def mission() -> SimulationSpec:
    return load(find_set("mission")).simulation


def sensor(code: str, **fields: Any) -> Variant:
    def changed(spec: SimulationSpec) -> SimulationSpec:
        rows = (replace(each, **fields) if each.code == code else each for each in spec.sensors)
        return replace(spec, sensors=tuple(rows))

    return changed


def drive(code: str, *, drawn: bool = False, **fields: Any) -> Variant:
    def changed(spec: SimulationSpec) -> SimulationSpec:
        rows = (replace(each, **fields) if each.code == code else each for each in spec.drives)
        return replace(spec, drives=tuple(rows), randbias=drawn)

    return changed


def renamed(**codes: str) -> Variant:
    def rows(rows: Any) -> Any:
        return tuple(replace(each, code=codes.get(each.code, each.code)) for each in rows)

    return lambda spec: replace(spec, sensors=rows(spec.sensors), drives=rows(spec.drives))


def found_in(history: RunHistory) -> tuple[Finding, ...]:
    return device_findings(Attempt(history, None))


def found(spec: SimulationSpec, variant: Variant, seed: int = 4) -> tuple[Finding, ...]:
    return found_in(wandered(variant(spec), seed, nominal=Nominal("mission", spec)))


@pytest.mark.parametrize(
    ("variant", "expected", "said"),
    [
        (
            sensor("u1", bias=3.0),
            {("u1", "offset")},
            r"u1 reads \d\.\d in too long \([23]\.\d+ to \d\.\d+, 36 r",
        ),
        (sensor("u1", bias=3.0), {("u1", "offset")}, r"u1 .*: its Bias is 3, in the nominal set mission 0$"),
        (sensor("u1", gain=0.8), {("u1", "gain")}, r"u1 reads 0\.8\d times what it should \(0\.\d+ to"),
        (sensor("u1", gain=0.0, bias=9.0), {("u1", "stuck")}, r"u1 always reads 9 in \(36 readings\)"),
        (sensor("u1", error=0.4), {("u1", "noise")}, r"u1 scatters by \d\.\d in \(.*\d\d of 36.*Perc"),
        (
            sensor("u1", outlier=0.4),
            {("u1", "noise")},
            r"u1 scatters by \d+\.\d in \(.*: its Outlier is 0\.4, ",
        ),
        (
            sensor("u1", dropout=0.6),
            {("u1", "noise")},
            r"u1 misses what it should see \(\d\d of 36 readings\): its Dropout is 0\.6",
        ),
        (
            sensor("u1", max_range=7.0),
            {("u1", "other")},
            r"u1 misses what it should see \(\d+ of 36 .* its Max Range \(in\) is 7, in .* inf",
        ),
        (
            sensor("u1", min_range=9.0),
            {("u1", "other")},
            r"u1 reads \d\.\d in too long \(.* of 36 readings\): its Min Range \(in\) is 9",
        ),
        (
            sensor("u1", resolution=7.0),
            {("u1", "noise")},
            r"u1 is off by \d\.\d in .* its Resolution is 7, in",
        ),
        (
            sensor("u1", field_of_view=150.0),
            {("u1", "other")},
            r"u1 reads \d+\.\d in too short .*: its Field of View \(deg\) is 150, in",
        ),
        (sensor("c1", hard_iron=40.0), {("c1", "other")}, r"c1 is off by [123]\d\.\d deg .* its Hard Iron"),
        (sensor("u1", rotation=15.0), {("u1", "mounting")}, r"u1 .* in .*: its Rotation \(deg\) is 15, in"),
        (sensor("u1", z=1.0), {("u1", "mounting")}, r"u1 reads \d+\.\d in too short .*: its Z Position"),
        (
            sensor("u5", x=-2.0),
            {("u5", "mounting")},
            r"u5 is off by \d\.\d in .*: its X Position \(in\) is -2",
        ),
        (
            sensor("u1", drift=0.2),
            {("u1", "drift")},
            r"u1 reads \d\.\d in too long .* Drift \(per s\) is 0\.2",
        ),
        (sensor("g1", drift=0.5), {("g1", "drift")}, r"g1 reads \d+\.\d deg too high .* Drift"),
        (sensor("g1", gain=0.8), {("g1", "gain")}, r"g1 reads 0\.80 times what it should"),
        (sensor("g1", gain=0.0), {("g1", "stuck")}, r"g1 counts nothing"),
        (sensor("g1", gain=-1.0), {("g1", "sign")}, r"g1 reads with the wrong sign"),
        (sensor("c1", bias=170.0), {("c1", "offset")}, r"c1 reads 1[67]\d\.\d deg too high"),
        (
            sensor("i1", detects_white=True),
            {("i1", "sign")},
            r"i1 answers the opposite \(.*36 readings\): its Detects is white, in .* black",
        ),
        (
            sensor("i1", error=0.6),
            {("i1", "noise")},
            r"i1 is wrong \(\d+ of 36 readings\): its Percent Error",
        ),
        (renamed(u2="u4", u4="u2"), {("u2", "swapped"), ("u4", "swapped")}, r"u. reads what u. should read"),
        (renamed(d1="w1", w1="d1"), {("d1", "swapped"), ("w1", "swapped")}, r".1 does what .1 should do"),
        (
            drive("d1", bias=Axes(r=1.0)),
            {("d1", "bias")},
            r"d1 turns [01]\.\d+ deg to the left for each inch",
        ),
        (drive("d1", bias=Axes(y=-0.2)), {("d1", "bias")}, r"d1 drifts 0\.[12]\d+ in to the right for each"),
        (drive("d1", bias=Axes(x=0.2)), {("d1", "gain")}, r"d1 drives 1\.[12]\d times what is asked"),
        (drive("d1", gain=0.8), {("d1", "gain")}, r"d1 drives 0\.8\d times what is asked \(0\.\d+ to"),
        (drive("r1", gain=0.0), {("r1", "stuck")}, r"r1 does not move the robot"),
        (drive("r1", gain=-1.0), {("r1", "sign")}, r"r1 turns the wrong way"),
        (
            drive("r1", error=Axes(x=0.06)),
            {("r1", "noise")},
            r"r1 is off by 0\.0\d+ in \w+ for each degree \(.*: its error is 0\.06, in .* 0\.003$",
        ),
    ],
)
def test_what_differs_from_the_nominal_set_is_named(
    mission: SimulationSpec, variant: Variant, expected: set[tuple[str, str]], said: str
) -> None:
    told = found(mission, variant)
    assert {(each.of, each.kind.value) for each in told} == expected
    assert {each.basis for each in told} == {Basis.NOMINAL}
    assert all(re.match(said, each.text) and "the nominal set mission" in each.text for each in told)
    assert all(each.low <= each.value <= each.high for each in told)


@pytest.mark.parametrize("seed", range(4))
def test_a_run_without_a_difference_has_no_findings(mission: SimulationSpec, seed: int) -> None:
    assert found(mission, lambda spec: spec, seed) == ()


# -- every field of every kind -------------------------------------------------------------------------


def asked(
    own: SimulationSpec, nominal: SimulationSpec, *commands: str, seed: int = 1
) -> tuple[RunHistory, Attempt]:
    simulator = Simulator(own, seed)
    engine = Engine(simulator)
    history = RunHistory(checkpoint_of(simulator), nominal=lambda: Nominal("mission", nominal))
    engine.watch(Reducer(checkpoint_of(simulator), history=history).apply)
    session = engine.session()
    for command in commands:
        session.submit(parse_command(command, "client"), lambda outcome: None)
    return history, Attempt(history, None)


CHANGED: dict[str, Any] = {
    "x": 2.0,
    "y": 2.5,
    "z": 2.0,
    "rotation": 40.0,
    "error": 0.6,
    "gain": 1.5,
    "absolute_error": 6.0,
    "bias": 4.0,
    "drift": 1.0,
    "min_range": 40.0,
    "max_range": 5.0,
    "resolution": 7.0,
    "wrap": 9.0,
    "dropout": 0.6,
    "outlier": 0.6,
    "field_of_view": 130.0,
    "rays": 1,
    "vertical_field_of_view": 100.0,
    "incidence_limit": 5.0,
    "cross_talk": 1.0,
    "ticks_per_inch": 0.2,
    "random_walk": 30.0,
    "hard_iron": 30.0,
    "soft_iron": 30.0,
    "threshold": 0.95,
    "detects_white": True,
    "analog": True,
    "scan_rate": 10.0,
    "clockwise": False,
    "missed_as_zero": True,
}
"""A value of each field with an effect on the readings of each kind, unless `FIELDS` has another."""
FIELDS: dict[tuple[str, str], Any] = {
    ("ultra", "wrap"): 5.0,
    ("odom", "wrap"): 3.0,
    ("load", "error"): 0.9,
    ("ir", "resolution"): None,
    ("ir", "wrap"): None,
    ("ir", "absolute_error"): 0.9,
    ("ir", "gain"): 3.0,
    ("ir", "x"): -2.0,
    ("ir", "threshold"): 0.1,
    ("comp", "absolute_error"): 90.0,
    ("odom", "bias"): None,
    ("gyro", "bias"): None,
    ("odom", "x"): -3.0,
    ("odom", "y"): None,
    ("odom", "error"): 0.9,
    ("ultra", "cross_talk"): None,
    ("lidar", "rays"): None,
    ("lidar", "scan_rate"): None,
    ("lidar", "clockwise"): None,
    ("lidar", "missed_as_zero"): None,
}
"""Values for one kind. None: a field without an effect; a program uses differences of counts, a wheel that
rolls aside turns no more if it is mounted further aside, sensors that are read one after another hear no
sound of each other, and a reading of a lidar is the ray ahead."""
CASES = [
    (kind, column.field)
    for kind in KINDS.values()
    if not kind.is_opaque
    for column in kind.columns
    if column.field != "read_time"
]


@pytest.mark.parametrize(("kind", "field"), CASES, ids=lambda value: getattr(value, "name", value))
def test_every_field_with_an_effect_names_the_device(
    mission: SimulationSpec, kind: type[Any], field: str
) -> None:
    rows = (*mission.sensors, *load(find_set("lidar")).simulation.sensors)
    made = kind.spec_type(kind=kind, number=1, code="m1")
    usual: SensorSpec = next((each for each in rows if each.kind is kind), made)
    value = FIELDS.get((kind.name, field), CHANGED[field])
    row = replace(usual, rays=5) if field == "vertical_field_of_view" else usual
    # Another sensor before it sends the sound that it may hear.
    sender = next(each for each in mission.sensors if each.code == "u3")
    sender = replace(sender, read_time=0.01)
    if kind.name == "ultra":
        row = replace(row, read_time=0.01)
    nominal = replace(
        mission,
        sensors=(row, sender),
        bot_center=(28.0, 42.0),
        bot_rot=180.0,
        block_center=(20.0, 42.0),
    )
    own = nominal
    if value is not None:
        own = replace(nominal, sensors=(replace(row, **{field: value}), sender))
    grip = ("d1-4", "p1-1", row.code, "p1-0", "d1--4") if kind.detects_block else ()
    around = ("u3", row.code, "d1-0.7", row.code, "r1-37", row.code, "w1-0.4", "s1-0.9", row.code, "d1--0.7")
    told = device_findings(asked(own, nominal, *(*grip, *around) * 10)[1])
    assert [each.of for each in told if each.of != row.code] == []
    assert bool(told) is (value is not None), (field, value)
    assert device_findings(asked(nominal, nominal, *around * 10)[1]) == ()


class ScaleSpec(SensorSpec, frozen=True, kw_only=True):
    model: str = "long"
    jitter: float = 0.0


class Scale(ObservingSensor):
    """A kind of its own, with a column of words and one of random errors."""

    name = "scale"
    meaning = "distance from the left wall"
    unit = "m"
    spec_type = ScaleSpec
    spec: ScaleSpec
    columns = (
        CsvColumn(WordRule(("long", "short"), ("long", "short")), name="Model", field="model"),
        CsvColumn(NumberRule(0), name="Jitter (m)", field="jitter", is_error=True),
    )

    def observe(self, world: World, pose: Pose) -> tuple[float, None]:
        return pose.x / (100.0 if self.spec.model == "long" else 4.0), None

    def reading(self, true: float, random: np.random.Generator | None, time: float) -> float:
        jitter = 0.0 if random is None else self.spec.jitter * random.standard_normal()
        return super().reading(true + jitter, random, time)


def test_columns_of_a_kind_of_its_own_are_told(mission: SimulationSpec) -> None:
    row = ScaleSpec(kind=Scale, number=1, code="b1")
    own, nominal = (replace(mission, sensors=(replace(row, model=word),)) for word in ("short", "long"))
    (one,) = device_findings(asked(own, nominal, *["b1"] * 5)[1])
    said = "b1 reads 2.3 m too high (5 readings): its Model is short, in the nominal set mission long"
    assert one.text == said
    own = replace(mission, sensors=(replace(row, jitter=9.0),))
    (one,) = device_findings(asked(own, nominal, *["b1"] * 9)[1])
    assert one.kind.value == "noise"
    assert one.text.endswith("its Jitter (m) is 9, in the nominal set mission 0")
    assert device_findings(asked(nominal, nominal, *["b1"] * 5)[1]) == ()


@pytest.mark.parametrize("count", [6, 10, 36, 200])
def test_the_interval_of_a_median_has_it_in_95_percent(count: int) -> None:
    random, hits = np.random.default_rng(count), 0
    for _ in range(2000):
        _, interval = median_interval(random.exponential(size=count), 1.0)
        assert interval is not None
        hits += interval[0] <= np.log(2.0) <= interval[1]
    assert hits / 2000 >= 0.94


# -- what is no difference ------------------------------------------------------------------------------


def test_a_sign_that_the_nominal_set_declares_is_convention() -> None:
    spec = load(find_set("simmer-python")).simulation
    assert found_in(wandered(spec, 1, nominal=Nominal("simmer-python", spec))) == ()


def test_a_drawn_bias_is_expected(mission: SimulationSpec) -> None:
    assert found(mission, lambda spec: replace(spec, strength=(0.04, 0.9)), 1) == ()


def test_a_strong_drawn_bias_is_named_by_what_it_did(mission: SimulationSpec) -> None:
    told = found(mission, lambda spec: replace(spec, strength=(0.6, 12.0)), 1)
    assert told
    assert {each.kind.value for each in told} <= {"bias", "gain"}


def test_a_gain_does_not_make_a_bias_of_the_drawn_one(mission: SimulationSpec) -> None:
    (one,) = found(mission, drive("d1", gain=0.7, drawn=True), 5)
    assert (one.of, one.kind.value) == ("d1", "gain")
    assert one.low < 0.7 < one.high


def test_another_robot_has_no_wrong_mountings(mission: SimulationSpec) -> None:
    other = replace(mission, sensors=tuple(replace(each, x=each.x + 3.0) for each in mission.sensors))
    assert found(mission, lambda spec: other) == ()


@pytest.mark.parametrize("count", [2, 3])
def test_few_readings_are_no_finding_but_are_declared(mission: SimulationSpec, count: int) -> None:
    own = sensor("u1", bias=3.0)(mission)
    _, attempt = asked(own, mission, *["u1"] * count)
    assert len(device_findings(attempt)) == (count == 3)
    said = f"reads 3.0 in too long ({count} readings): its Bias is 3, in the set mission 0"
    assert declared_errors(attempt)["u1"] == said


def test_a_real_robot_is_compared_with_no_set(mission: SimulationSpec) -> None:
    history, attempt = asked(sensor("u1", bias=3.0, read_time=5.0)(mission), mission, *["u1"] * 9)
    assert device_findings(attempt)
    history.is_twin = True
    assert device_findings(attempt) == ()
    assert declared_errors(attempt) == {}


def test_without_a_nominal_set_only_large_errors_are_declared(mission: SimulationSpec) -> None:
    for bias, told in ((0.5, False), (3.0, True)):
        simulator = Simulator(sensor("u1", bias=bias)(mission), 1)
        engine = Engine(simulator)
        history = RunHistory(checkpoint_of(simulator))
        engine.watch(Reducer(checkpoint_of(simulator), history=history).apply)
        session = engine.session()
        for _ in range(9):
            session.submit(parse_command("u1", "client"), lambda outcome: None)
        attempt = Attempt(history, None)
        assert device_findings(attempt) == ()
        assert ("u1" in declared_errors(attempt)) is told


# -- the nominal set, and the report ---------------------------------------------------------------------
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
