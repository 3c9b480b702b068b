"""Calibration of a robot whose parameters are hidden."""

from __future__ import annotations

import contextlib
import io
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs
from msgspec.structs import replace

from benchmarks.emulated_robots import Oddities, draw_robot, placed, record, set_with, wandering
from simmer_tui.calibrate.change_detection import judged, spread_between_robots
from simmer_tui.calibrate.estimates import estimates_of, share_interval
from simmer_tui.calibrate.fit import Fit, Progress, fit
from simmer_tui.calibrate.measured_run import MeasuredRun, read_runs
from simmer_tui.calibrate.written_set import knowledge_of
from simmer_tui.cli.main import main
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.errors import CalibrationError
from simmer_tui.sim.noise import random_bias
from simmer_tui.sim.specs import DriveKind
from tests.calibrate.conftest import CODES, Logged, drive
from tests.calibrate.test_kept_reports import words
from tests.kept_numbers import assert_kept

KEPT = Path(__file__).with_name("kept_answer.json")


@pytest.fixture(scope="module")
def written(logged: Logged, found: Fit, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files that the command writes, with the estimates of `found`, which take a second."""

    def known(run: MeasuredRun, *, seed: int, progress: Progress) -> Fit:
        assert (run.names, run.stops, seed) == (found.run.names, found.run.stops, 0)
        progress("estimating", 1.0)
        return found

    out = tmp_path_factory.mktemp("calibrated") / "my-robot"
    answer = io.StringIO()
    with contextlib.redirect_stdout(answer), pytest.MonkeyPatch.context() as patch:
        patch.setattr("simmer_tui.calibrate.fit.fit", known)
        assert main(["calibrate", str(logged.path), "--out", str(out), "--json"]) == 0
    (out.parent / "answer.json").write_text(answer.getvalue(), "utf-8")
    return out


def test_estimates_are_those_that_were_kept(written: Path) -> None:
    assert_kept(json.loads((written.parent / "answer.json").read_text("utf-8")), KEPT, "answer")


def test_files_and_page_are_those_that_were_kept(written: Path, logged: Logged) -> None:
    def text(name: str) -> str:
        whole = (written / name).read_text("utf-8").replace("<wbr>", "")  # where a name may be broken
        return whole.replace(str(logged.path), logged.path.name)

    knowledge = json.loads(text("calibration.json"))
    variances = np.diag(knowledge.pop("covariance"))
    files = {name: text(name).splitlines() for name in ("drive.csv", "sensors.csv")}
    found = {"files": files, "knowledge": knowledge, "variances": variances}
    assert_kept({**found, "page": words(text("calibration.html"))}, KEPT, "report")


def test_a_log_gives_the_commands_and_the_real_answers(logged: Logged) -> None:
    run = read_runs([logged.path])
    lines = [json.loads(line) for line in logged.path.read_text().splitlines()]
    moves = [line["cmd"] for line in lines if line["kind"] == "plan"]
    assert [f"{run.spec.drives[m.drive].code}-{m.value:g}" for m in run.movements] == moves
    assert all(movement.certain and movement.took > 0 for movement in run.movements)
    said = [line["reply"] for line in lines if line["kind"] == "read" and line["cmd"] == "u2"]
    assert run.readings["u2"].values.tolist() == [float(value) for value in said]
    assert run.readings["u2"].stops.tolist() == list(range(len(moves) + 1))


def test_intervals_hold_the_truth(logged: Logged, found: Fit) -> None:
    places, sizes = found.space.of(logged.hidden)
    off = (found.state.parameters - places)[found.identified] / found.standard_errors[found.identified]
    assert np.mean(np.abs(off) < 2) > 0.8
    assert np.abs(off).max() < 5
    factors = (
        np.log(found.state.noise_scales / sizes)[found.noise_scales_identified]
        / found.noise_scale_errors[found.noise_scales_identified]
    )
    assert np.mean(np.abs(factors) < 2) > 0.8
    # And they say something: a bias is known far better than before.
    narrow = found.standard_errors / [each.spread for each in found.space.parameters]
    assert np.median(narrow) < 0.1


def test_what_the_log_does_not_tell_is_left_as_it_was(found: Fit) -> None:
    estimates = {(each.owner, each.field): each for each in estimates_of(found)}
    time_of_flight = estimates["tof1", "gain"]
    assert (time_of_flight.why_not, time_of_flight.value) == ("t1 was never read", 1.0)
    assert estimates["ultra1", "gain"].identified
    assert estimates["link", "latency"].low <= 0.02 <= estimates["link", "latency"].high


@pytest.mark.slow
def test_an_error_that_is_surely_smaller_than_the_sets_is_told(tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    configured, hidden = placed(load(bundled_folder()).simulation, random)
    hidden = draw_robot(random, hidden)
    sensors = tuple(
        replace(each, error=0.0, absolute_error=12.0) if each.id == "comp1" else each
        for each in hidden.sensors
    )
    path = tmp_path / "compass.jsonl"
    record(
        path, set_with(configured), replace(hidden, sensors=sensors), 5, wandering(40, 5, CODES), latency=0.02
    )
    estimates = {(each.owner, each.field): each for each in estimates_of(fit(read_runs([path])))}
    percent = estimates["comp1", "error"]
    assert percent.present == 0.1  # of the heading: as much as all the rest, at half a turn
    assert percent.identified
    assert percent.low == 0.0
    assert percent.high < percent.present


@pytest.mark.slow
def test_a_robot_that_was_put_elsewhere_is_refused(tmp_path: Path, logged: Logged) -> None:
    elsewhere = replace(logged.hidden, bot_center=(90.0, 6.0), bot_rot=200.0)
    path = tmp_path / "elsewhere.jsonl"
    record(path, set_with(logged.configured), elsewhere, 5, wandering(12, 5, CODES))
    with pytest.raises(CalibrationError, match=r"path was not found .* Check its start"):
        fit(read_runs([path]))


def test_commands_without_an_answer_may_have_been_done_or_not(tmp_path: Path, logged: Logged) -> None:
    lines = logged.path.read_text().splitlines()
    number = next(i for i, line in enumerate(lines) if '"status":"done"' in line)
    broken = lines[number].replace('"status":"done"', '"status":"unanswered"')
    broken = broken.replace('"reply":"inf"', '"reply":"nan"')
    path = tmp_path / "lost.jsonl"
    path.write_text("\n".join([*lines[:number], broken, *lines[number + 1 :]]) + "\n")
    movements = read_runs([path]).movements
    assert [movement.certain for movement in movements[:2]] == [False, True]


@pytest.mark.slow
def test_two_logs_of_one_robot_tell_more_than_one(tmp_path: Path, logged: Logged, found: Fit) -> None:
    _, again = placed(logged.hidden, np.random.default_rng(8))
    again = replace(again, bot_center=logged.hidden.bot_center, bot_rot=logged.hidden.bot_rot)
    path = tmp_path / "again.jsonl"
    record(path, set_with(logged.configured), again, 8, wandering(40, 8, CODES), latency=0.02)
    both = fit(read_runs([logged.path, path]))
    told = found.identified & both.identified
    assert np.median(both.standard_errors[told] / found.standard_errors[told]) < 0.95


def test_logs_of_different_robots_are_refused(tmp_path: Path, logged: Logged) -> None:
    other = set_with(logged.configured)
    sensors = tuple(replace(each, x=each.x + 1) for each in other.simulation.sensors)
    path = tmp_path / "other.jsonl"
    text = other.files["sensors.csv"].replace("ultra1,u1,1,3,", "ultra1,u1,1,2,")
    assert text != other.files["sensors.csv"]
    files = {**other.files, "sensors.csv": text}
    other = replace(other, simulation=replace(other.simulation, sensors=sensors), files=files)
    record(path, other, logged.hidden, 5, wandering(5, 5, CODES))
    with pytest.raises(CalibrationError, match="made with another set"):
        read_runs([logged.path, path])


def test_a_changed_part_is_named_and_an_unchanged_robot_is_not_accused(found: Fit) -> None:
    knowledge = knowledge_of(found, estimates_of(found))
    assert not any(part.changed for part in judged(found, knowledge, 0.05))
    place = knowledge.parameters.index("ultra2 mounting angle")
    values = tuple(v + 5.0 * (i == place) for i, v in enumerate(knowledge.values))
    knocked = structs.replace(knowledge, values=values)
    changed = [part.owner for part in judged(found, knocked, 0.05) if part.changed]
    assert changed == ["ultra2"]


@pytest.mark.parametrize(("hits", "count"), [(0, 50), (3, 50), (50, 50)])
def test_shares_have_intervals_around_them(hits: int, count: int) -> None:
    low, high = share_interval(hits, count)
    assert 0 <= low <= hits / count + 1e-3
    assert hits / count - 1e-3 <= high <= 1


def test_the_strength_is_the_spread_beyond_the_standard_errors() -> None:
    random = np.random.default_rng(1)
    errors = np.full((30, 4), 0.02)
    noise = random.normal(0, 0.02, (30, 4))
    value, low, high = spread_between_robots(noise + random.normal(0, 0.05, (30, 4)), errors)
    assert low < 0.05 < high
    assert value == pytest.approx(0.05, rel=0.15)
    assert spread_between_robots(noise, errors)[0] < 0.015


@pytest.mark.slow
def test_strength_takes_five_calibrated_robots(
    written: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["calibrate", "--strength", str(written)]) == 2
    assert "from 5 calibrated sets on; these are 1" in capsys.readouterr().err
    assert main(["calibrate", "--strength", *[str(written)] * 5]) == 2
    assert "is the same calibration as" in capsys.readouterr().err
    random = np.random.default_rng(2)
    folders = []
    for number in range(6):
        bias = random_bias(number, (0.05, 1.0))
        known = json.loads((written / "calibration.json").read_text())
        for index, name in enumerate(known["parameters"]):
            owner, _, figure = name.partition(" ")
            if figure.endswith("bias") and owner in set(DriveKind):
                error = math.sqrt(known["covariance"][index][index])
                true = getattr(bias[DriveKind(owner)], figure[0])
                known["values"][index] = true + error * random.standard_normal()
        folders.append(tmp_path / str(number))
        folders[-1].mkdir()
        (folders[-1] / "calibration.json").write_text(json.dumps(known))
    assert main(["calibrate", "--strength", *map(str, folders), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["strengths"]
    for row, true in zip(found, (0.05, 1.0), strict=True):
        assert row["strength_low"] <= true <= row["strength_high"]


# -- the command ---------------------------------------------------------------------------------------


def test_the_written_set_is_a_set(written: Path, logged: Logged) -> None:
    made = load(written)
    assert not made.simulation.randbias
    before = load(bundled_folder()).simulation
    for drive_now, hidden, was in zip(
        made.simulation.drives, logged.hidden.drives, before.drives, strict=True
    ):
        assert drive_now.gain == was.gain
        assert abs(drive_now.bias.r - hidden.bias.r) < 0.05
    assert made.settings.link.latency == pytest.approx(0.02, abs=0.002)
    assert f"calibrated from {logged.path}" in (written / "sensors.csv").read_text()
    assert f"# calibrated from {logged.path}" in (written / "settings.toml").read_text()


def test_the_page_shows_the_path_and_what_changed(written: Path) -> None:
    text = (written / "calibration.html").read_text()
    for heading in (
        "The estimated path",
        "Estimated parameters",
        "Residuals",
        "Predictions of held-back readings",
    ):
        assert heading in text
    assert text.count("<line") >= 50


@pytest.mark.slow
def test_the_set_holds_for_the_log_it_came_from(
    written: Path, logged: Logged, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["calibrate", str(logged.path), "--check", str(written)]) == 0
    assert "The robot behaves as the set says." in capsys.readouterr().out


def test_nothing_is_overwritten(written: Path, logged: Logged, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", str(logged.path), "--out", str(written)]) == 2
    assert "nothing is overwritten" in capsys.readouterr().err


def test_without_scipy_it_says_what_to_install(
    logged: Logged, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert main(["calibrate", str(logged.path), "--out", str(tmp_path / "x")]) == 2
    assert "pip install 'simmer-tui[calibrate] @ git+" in capsys.readouterr().err


def test_check_wants_a_calibrated_set(logged: Logged, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", str(logged.path), "--check", "default"]) == 2
    assert re.search(r"--check takes a set that\s+simmer-tui calibrate\s+wrote", capsys.readouterr().err)


# -- at size -------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_intervals_hold_over_robots(tmp_path: Path) -> None:
    held: list[bool] = []
    for seed in range(4):
        logged = drive(tmp_path, 20 + seed, 300, f"{seed}.jsonl")
        found = fit(read_runs([logged.path]))
        places, sizes = found.space.of(logged.hidden)
        off = np.abs(found.state.parameters - places) / found.standard_errors
        held += (off[found.identified] < 1.96).tolist()
        factors = np.abs(np.log(found.state.noise_scales / sizes)) / found.noise_scale_errors
        held += (factors[found.noise_scales_identified] < 1.96).tolist()
    assert np.mean(held) > 0.85


@pytest.mark.slow
def test_faults_that_no_set_says_do_not_lose_the_path(tmp_path: Path, logged: Logged) -> None:
    path = tmp_path / "odd.jsonl"
    oddities = Oddities(slip=0.05, stale=0.02)
    robot = record(
        path, set_with(logged.configured), logged.hidden, 9, wandering(200, 9, CODES), oddities=oddities
    )
    found = fit(read_runs([path]))
    pose = robot.simulator.pose
    assert np.hypot(*(found.poses[-1, :2] - (pose.x, pose.y))) < 0.5
