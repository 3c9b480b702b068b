"""Sweeps: which values stand over the set, that they share their seeds, and what is said of them."""

from __future__ import annotations

import csv
import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path

import pytest
from msgspec.structs import replace

from simmer_tui.cli.trials_command import run_trials
from simmer_tui.config.loader import find_set, load
from simmer_tui.document import svg
from simmer_tui.errors import ConfigurationError
from simmer_tui.sim.columns import column_name
from simmer_tui.trials.curves import Curve, SweepValue, curves
from simmer_tui.trials.folder import TrialFolder, TrialPlan
from simmer_tui.trials.sweep import files_at, points_of, settings_at
from simmer_tui.trials.sweep_summary import answer, curve_figure
from simmer_tui.trials.trial import TrialResult, prepare

Make = Callable[..., TrialFolder]


@pytest.fixture
def sweep(tmp_path: Path) -> Make:
    """Makes a sweep of some `NAME=VALUES`, two runs a value."""

    def make(*varied: str, name: str = "mission", **changes: object) -> TrialFolder:
        plan = TrialPlan(
            command="python a.py",
            runs=2,
            seed=9,
            configuration=name,
            settings={},
            mazes=(),
            random_mazes=False,
            fixed_ports=False,
            time_limit=60.0,
            points=points_of(varied),
        )
        plan = replace(plan, **changes)
        return TrialFolder.create(tmp_path / "sweep", plan, load(find_set(name)).files, {})

    return make


def test_points_are_values_by_name_each_varied_alone() -> None:
    assert points_of(["a=1, 2", "b.c=x"]) == ({"a": "1"}, {"a": "2"}, {"b.c": "x"})
    assert points_of(["strength=0.1,1;0.2,2"]) == ({"strength": "0.1,1"}, {"strength": "0.2,2"})
    assert points_of([]) == ()


@pytest.mark.parametrize("text", ["strength", "=1", "strength=", "strength=1,,2", "strength=1,1"])
def test_values_that_cannot_be_read_are_refused(text: str) -> None:
    with pytest.raises(ConfigurationError, match="--vary"):
        points_of([text])


def test_a_value_given_twice_is_named_as_it_was_typed() -> None:
    """Perhaps 0,02 was meant: a decimal comma."""
    with pytest.raises(ConfigurationError, match=r"^--vary: strength = 0 is given twice$"):
        points_of(["strength=0,02,0,05"])


def test_runs_of_all_values_have_the_same_seeds_and_take_turns(sweep: Make) -> None:
    folder = sweep("num_segments=5,20", "strength=0.3")
    trials = [folder.trial(number) for number in folder.to_do]
    assert [trial.number for trial in trials] == [1, 2, 3, 4, 5, 6]
    assert [trial.repetition for trial in trials] == [1, 1, 1, 2, 2, 2]
    assert len({trial.seed for trial in trials}) == 2
    assert [trial.configuration.simulation.num_segments for trial in trials] == [5, 20, 10] * 2
    assert [trial.configuration.simulation.strength for trial in trials][:3] == [
        (0.05, 1.0),
        (0.05, 1.0),
        (0.3, 1.0),
    ]
    places = {prepare(trial)[0].settings.bot_center for trial in trials[:3]}
    assert len(places) == 1
    again = TrialFolder.read(folder.path)
    assert again.plan == folder.plan
    assert again.trial(5).configuration.simulation.num_segments == 20


def test_columns_of_one_sensor_or_drive_are_varied_in_their_files(sweep: Make) -> None:
    folder = sweep("u1.percent_error=0.5", "ultra1.bias=2", "right.x_axis_error=0.25", "d1.gain=0.9")
    error, bias, drive, gain = (folder.trial(number).configuration.simulation for number in (1, 2, 3, 4))
    plain = folder.configuration.simulation

    def first(spec: object) -> object:
        return next(each for each in spec.sensors if each.code == "u1")  # type: ignore[attr-defined]

    assert first(error) == replace(first(plain), error=0.5)  # type: ignore[type-var]
    assert first(bias) == replace(first(plain), bias=2.0)  # type: ignore[type-var]
    assert error.sensors[1:] == plain.sensors[1:]
    assert error.drives == plain.drives
    (changed,) = [new for old, new in zip(plain.drives, drive.drives, strict=True) if old != new]
    assert (changed.code, changed.error.x) == ("d1", 0.25)
    (changed,) = [new for old, new in zip(plain.drives, gain.drives, strict=True) if old != new]
    assert (changed.code, changed.gain) == ("d1", 0.9)
    log_files = folder.trial(1).configuration.files
    assert "0.5" in log_files["sensors.csv"].splitlines()[1]  # so that a log of the run can be run again


def test_columns_are_found_as_the_loader_finds_them(tmp_path: Path) -> None:
    """Below blank lines, and by headers in any letters with any spaces."""
    files = dict(load(find_set("mission")).files)
    files["sensors.csv"] = "\n" + files["sensors.csv"].replace("Percent Error", "PERCENT  error", 1)
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    for name, text in files_at({"u1.percent_error": "0.5"}, tmp_path).items():
        (tmp_path / name).write_text(text)
    before, after = load(find_set("mission")).simulation.sensors, load(tmp_path).simulation.sensors
    assert [replace(each, error=0.5) if each.code == "u1" else each for each in before] == list(after)


def test_delays_and_profiles_are_varied_like_anything_else(sweep: Make) -> None:
    folder = sweep("d1.start_lag=0.1", "u1.read_time=0.2", "link.latency=0.05", "link_profile=hc-05")
    lag, reading, latency, link = (folder.trial(number).configuration for number in (1, 2, 3, 4))
    assert [drive.start_lag for drive in lag.simulation.drives if drive.code == "d1"] == [0.1]
    assert [sensor.read_time for sensor in reading.simulation.sensors if sensor.code == "u1"] == [0.2]
    assert latency.settings.link.latency == 0.05
    assert link.settings.link.jitter == 0.0125


def test_a_realistic_robot_is_kept_with_its_trials(sweep: Make) -> None:
    folder = sweep("strength=0.02,0.05", settings={"realistic": True})
    first, second = (folder.trial(number).configuration for number in (1, 2))
    assert first.settings.drive_profile == second.settings.drive_profile == "omni-4"
    assert (first.simulation.strength, second.simulation.strength) == ((0.02, 0.5), (0.05, 0.5))
    assert TrialFolder.read(folder.path).trial(1).configuration.settings == first.settings


def test_headers_have_names_that_can_be_typed() -> None:
    assert column_name("Percent Error (0-1)") == "percent_error"
    assert column_name("X-Axis Error") == "x_axis_error"
    assert column_name("Drift (per s)") == "drift"


@pytest.mark.parametrize(
    ("varied", "error"),
    [
        ("strenght=1,2", r'--vary strenght: is neither a setting nor a column .*did you mean "strength"'),
        ("u1.percent_eror=1", r'--vary u1.percent_eror: sensors.csv has no column .*"percent_error"'),
        ("u9.percent_error=1", r"--vary u9.percent_error: is neither a setting nor a column"),
        ("u1.percent_error=2", r"--vary u1.percent_error = 2: sensors.csv:2:Percent Error"),
        ("num_segments=0", r"--vary num_segments = 0: --num-segments"),
        ("seed=1,2", r"--vary seed: cannot be varied"),
        ("strength=0.1;0.10,1", r"--vary strength = 0.10,1: makes no difference to strength = 0.1"),
    ],
)
def test_what_cannot_be_varied_is_said_and_leaves_nothing_behind(
    sweep: Make, varied: str, error: str
) -> None:
    for _ in range(2):
        with pytest.raises(ConfigurationError, match=error):
            sweep(varied)


def test_strength_without_random_bias_makes_no_difference(sweep: Make) -> None:
    with pytest.raises(ConfigurationError, match=r"strength = 0.1: makes no difference to strength = 0.05"):
        sweep("strength=0.05,0.1", settings={"randbias": False})


def test_profile_that_decides_over_a_column_is_noticed(sweep: Make) -> None:
    with pytest.raises(ConfigurationError, match=r"makes no difference to u1\.percent_error = 0\.1"):
        sweep("u1.percent_error=0.1,0.2", settings={"sensor_profile": "hc-sr04"})


def test_settings_of_a_point_are_found_among_columns_of_sensors() -> None:
    """A single number stands for the first of two; what is no setting is left to others."""
    configuration = load(find_set("default"))
    second = configuration.settings.strength[1]
    point = {"u1.bias": "1", "strength": "0.3", "d1.error": "0", "link.latency": "0.5"}
    assert settings_at(point, configuration) == {"strength": f"0.3,{second:g}", "link.latency": "0.5"}
    assert settings_at({"strength": "0.3,2"}, configuration) == {"strength": "0.3,2"}


def place(made_result: Callable[..., TrialResult], value: str, successes: int, runs: int) -> SweepValue:
    return SweepValue(value, tuple(made_result(k, k, success=k < successes) for k in range(runs)))


@pytest.mark.parametrize(
    ("successes", "said"),
    [
        (
            (100, 96, 40),
            "keeps a success rate of 0.9 with x up to 1, where it is 0.960 (0.902 to 0.984); at 2 it is "
            "0.400 (0.309 to 0.498).",
        ),
        (
            (92, 40, 95),
            "up to 0.5, where it is 0.920 (0.850 to 0.959); at 1 it is 0.400 (0.309 to 0.498). 100 runs of "
            "0.5 do not rule out less than 0.9.",
        ),
        ((100, 99, 98), "up to 2, where it is 0.980 (0.930 to 0.994), and no greater value was tried."),
        ((50, 99, 98), "does not keep a success rate of 0.9 even with x at 0.5, where it is 0.500 ("),
    ],
)
def test_sentence_says_up_to_which_value_the_rate_is_kept(
    made_result: Callable[..., TrialResult], successes: tuple[int, ...], said: str
) -> None:
    places = [
        place(made_result, value, count, 100)
        for value, count in zip(("0.5", "1", "2"), successes, strict=True)
    ]
    assert said in answer(Curve("x", tuple(places)), 0.9)


def test_values_that_are_no_numbers_are_listed(made_result: Callable[..., TrialResult]) -> None:
    curve = Curve(
        "drive_profile", (place(made_result, "mecanum", 2, 20), place(made_result, "omni-4", 20, 20))
    )
    assert answer(curve, 0.9) == "The program keeps a success rate of 0.9 with omni-4 of drive_profile."


def test_places_and_lists_of_numbers_have_no_order(made_result: Callable[..., TrialResult]) -> None:
    places = [place(made_result, value, successes, 20) for value, successes in (("25,41", 2), ("6,30", 20))]
    curve = Curve("block_center", tuple(places))
    assert not curve.is_of_numbers
    assert answer(curve, 0.9) == "The program keeps a success rate of 0.9 with 6,30 of block_center."


def test_curve_stands_where_its_rates_are(made_result: Callable[..., TrialResult]) -> None:
    curve = Curve("x", tuple(place(made_result, value, 10, 20) for value in ("0", "1", "4")))
    root = ElementTree.fromstring(svg.figure_svg(curve_figure(curve, 0.9, "curve")))
    name = "{http://www.w3.org/2000/svg}"
    places = [float(circle.get("cx", "")) for circle in root.iter(f"{name}circle")]
    assert (places[2] - places[0]) == pytest.approx(4 * (places[1] - places[0]))
    assert len({circle.get("cy") for circle in root.iter(f"{name}circle")}) == 1
    assert len(list(root.iter(f"{name}polyline"))) == 1


@pytest.mark.slow
def test_sweep_from_the_command_line_is_gone_on_with_and_answers(
    tmp_path: Path, program: Callable[[str], str], capfd: pytest.CaptureFixture[str]
) -> None:
    lines = """
far = robot.read("u1")
sys.exit(far > 50 and number > 1)
"""
    out = tmp_path / "out"
    options = ["--run", program(lines), "--config", "default", "--seed", "1", "--vary", "u1.bias=0,1000"]
    options += ["--no-randbias", "--out", str(out)]
    assert run_trials([*options, "--runs", "1", "--jobs", "2"]) == 0
    assert run_trials([*options, "--runs", "3", "--resume", "--require", "0.8"]) == 0
    shown = " ".join(capfd.readouterr().out.split())
    assert "keeps a success rate of 0.8 with u1.bias up to 0, where it is 1.000" in shown
    assert "at 1000 it is 0.333" in shown
    with (out / "sweep.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["setting"], row["value"], row["runs"], row["successes"]) for row in rows] == [
        ("u1.bias", "0", "3", "3"),
        ("u1.bias", "1000", "3", "1"),
    ]
    with (out / "trials.csv").open() as file:
        runs = list(csv.DictReader(file))
    assert [row["u1.bias"] for row in runs] == ["0", "1000"] * 3
    assert [row["success"] for row in runs] == ["1", "1", "1", "0", "1", "0"]
    assert len({row["seed"] for row in runs}) == 3
    page = (out / "report.html").read_text()
    assert page.count("<svg") == 1
    assert "u1.bias" in page
    assert run_trials(["--resume", "--out", str(out), "--json"]) == 0
    answer = json.loads(capfd.readouterr().out)
    assert [each["value"] for each in answer["sweep"]] == [0, 1000], "numbers, not texts"
    assert [each["u1.bias"] for each in answer["runs"]] == [0, 1000] * 3
    (curve,) = curves(TrialFolder.read(out))
    assert [len(each.results) for each in curve.values] == [3, 3]
    assert run_trials(["--resume", "--out", str(out), "--vary", "u1.bias=0"]) == 2
    assert "--vary differs from that of these trials" in capfd.readouterr().err


def test_what_the_mission_decides_is_not_varied(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run_trials(["--run", "x", "--vary", "bot_rot=0,90", "--out", str(tmp_path / "out")]) == 2
    assert "--vary bot_rot: has no effect in a mission" in capfd.readouterr().err


@pytest.mark.slow
def test_sweep_passes_through_what_is_measured_singly(tmp_path: Path, program: Callable[[str], str]) -> None:
    command = program('robot.drive("d1", 20)\nrobot.drive("r1", 90)\nsys.exit(robot.read("u1") < 20)')
    options = ["--run", command, "--config", "default", "--seed", "3", "--runs", "2", "--jobs", "2"]
    swept = tmp_path / "swept"
    assert run_trials([*options, "--out", str(swept), "--vary", "strength=0.05,0.5"]) == 0
    (curve,) = curves(TrialFolder.read(swept))
    for each, strength in zip(curve.values, ("0.05,1", "0.5,1"), strict=True):
        single = tmp_path / strength
        assert run_trials([*options, "--out", str(single), "--strength", strength]) == 0
        alone = TrialFolder.read(single).done
        assert [(one.seed, one.end, one.success) for one in each.results] == [
            (one.seed, one.end, one.success) for one in alone
        ]
    ends = [one.end for place in curve.values for one in place.results]
    assert len(set(ends)) == 4
