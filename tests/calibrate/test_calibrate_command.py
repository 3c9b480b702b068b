"""Messages of `simmer-tui calibrate` for logs and folders that it cannot work with."""

from __future__ import annotations

import gzip
import io
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs
from rich.console import Console

from benchmarks.emulated_robots import Session, draw_robot, record, set_with, wandering
from simmer_tui.calibrate.estimates import ParameterEstimate, estimates_of
from simmer_tui.calibrate.fit import Fit, fit, refit
from simmer_tui.calibrate.measured_run import read_runs
from simmer_tui.calibrate.prediction import held_back
from simmer_tui.calibrate.result_page import figures_table, held_back_table, result_document
from simmer_tui.calibrate.written_set import set_texts
from simmer_tui.cli.main import main
from simmer_tui.document.as_data import json_text
from simmer_tui.document.as_terminal import print_table
from simmer_tui.errors import CalibrationError
from tests.calibrate.conftest import CODES, Logged
from tests.calibrate.test_kept_reports import KNOWN

Capture = pytest.CaptureFixture[str]


def refused(argv: list[str], capsys: Capture) -> str:
    """The message of a command that ends with exit code 2, on one line."""
    assert main(["calibrate", *argv]) == 2
    return " ".join(capsys.readouterr().err.split())


def test_a_log_that_is_named_twice_would_count_twice(logged: Logged, tmp_path: Path, capsys: Capture) -> None:
    copy = tmp_path / "copy.jsonl.gz"
    copy.write_bytes(gzip.compress(logged.path.read_bytes()))
    said = refused([str(logged.path), str(copy), "--out", str(tmp_path / "x")], capsys)
    assert f"{copy} is the same run as {logged.path}; name each log once" in said


def test_a_real_robot_and_a_simulated_one_are_not_one(
    logged: Logged, tmp_path: Path, capsys: Capture
) -> None:
    simulated = tmp_path / "simulated.jsonl"
    text = logged.path.read_text()
    assert text.count('"sim":false') == 1
    simulated.write_text(text.replace('"sim":false', '"sim":true'))
    said = refused([str(logged.path), str(simulated), "--out", str(tmp_path / "x")], capsys)
    assert f"{simulated} is of a simulated robot, {logged.path} of a real one" in said


@pytest.mark.slow
def test_logs_of_robots_that_behave_differently_are_refused(
    logged: Logged, tmp_path: Path, capsys: Capture
) -> None:
    other = draw_robot(np.random.default_rng(77), logged.hidden)
    path = tmp_path / "other.jsonl"
    record(path, set_with(logged.configured), other, 7, wandering(30, 7, CODES), latency=0.02)
    said = refused([str(logged.path), str(path), "--out", str(tmp_path / "x")], capsys)
    assert f"{path} is of another robot than {logged.path}, or the robot has changed in between:" in said
    assert not (tmp_path / "x").exists()


def test_what_is_left_out_of_a_damaged_log_is_said(logged: Logged, tmp_path: Path) -> None:
    lines = logged.path.read_text().splitlines(keepends=True)
    path = tmp_path / "damaged.jsonl"
    path.write_text("".join([*lines[:200], "garbage\n", *lines[200:300]]) + lines[300][:20])
    broken, torn = read_runs([path]).notes
    assert broken.startswith(f"{path}: line 201 is left out: ")
    assert torn.startswith(f"{path}: ")
    assert "300" in torn or "302" in torn


def test_a_folder_that_cannot_be_made_is_told_of_before_the_work(
    logged: Logged, tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def worked(*_: object, **__: object) -> None:
        raise AssertionError("it was to be refused before")

    monkeypatch.setattr("simmer_tui.calibrate.fit.fit", worked)
    (tmp_path / "file").write_text("")
    said = refused([str(logged.path), "--out", str(tmp_path / "file" / "x")], capsys)
    assert said == f"{tmp_path / 'file' / 'x'}: cannot be written: {tmp_path / 'file'} is not a folder"


def test_a_log_without_ranges_is_refused_for_that(logged: Logged, tmp_path: Path) -> None:
    path = tmp_path / "blind.jsonl"
    record(path, set_with(logged.configured), logged.hidden, 5, wandering(10, 5, ("o1", "g1")))
    with pytest.raises(CalibrationError) as refusal:
        fit(read_runs([path]))
    assert str(refusal.value).startswith(f"{path}: no range sensor was read often enough")
    assert "put where the set says" not in str(refusal.value)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads are counted in /proc")
@pytest.mark.parametrize("command", ["calibrate", "report"])
def test_its_small_matrices_are_left_to_one_thread(command: str) -> None:
    program = (
        "import os, sys; from simmer_tui.__main__ import entry\n"
        f"sys.argv = ['simmer-tui', '{command}', '--help']\n"
        "try: entry()\n"
        "except SystemExit: import scipy.linalg\n"
        "print(len(os.listdir('/proc/self/task')))"
    )
    environment = {name: value for name, value in os.environ.items() if not name.startswith("OPENBLAS")}
    ended = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert ended.stdout.splitlines()[-1] == "1"


def test_a_guided_session_without_a_person_is_refused(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    options = ["--guided", "--serial", str(tmp_path / "none"), "--config", "default"]
    assert "puts the robot" in refused([*options, "--out", str(tmp_path / "x")], capsys)


def test_why_a_figure_is_not_told_is_said_once_and_is_true(found: Fit) -> None:
    whys = {(each.owner, each.label): each.why_not for each in estimates_of(found)}
    assert whys["tof1", "dropouts"] == whys["tof1", "gain"] == "t1 was never read"
    instant = replace(
        found,
        run=replace(
            found.run,
            chains=tuple(
                replace(chain, movements=[replace(each, took=0.05) for each in chain.movements])
                for chain in found.run.chains
            ),
        ),
    )
    whys = {(each.owner, each.label): each.why_not for each in estimates_of(instant)}
    assert whys["link", "link latency"].startswith("the durations of movements do not show it")
    assert whys["ultra1", "read time"] == "the link's latency, which is part of it, is not known"
    assert whys["tof1", "read time"] == "t1 was never read"


@pytest.mark.slow
def test_the_tables_fit_a_terminal_of_80_columns(found: Fit) -> None:
    held = held_back(found)
    assert held is not None
    for table in (figures_table(estimates_of(found)), held_back_table(held)):
        console = Console(file=io.StringIO(), width=80)
        print_table(structs.replace(table, note=""), console)
        assert isinstance(console.file, io.StringIO)
        lines = console.file.getvalue().splitlines()
        shown = [" ".join(line.split()) for line in lines]
        for row in table.texts():
            assert " ".join(" ".join(row).split()) in shown


@pytest.mark.parametrize(
    ("low", "high", "shown"),
    [(0.03775, 0.05983, "0.038"), (44.28, 46.03, "44.28"), (0.0, 0.0, "0.0000"), (300.0, 420.0, "300")],
)
def test_figures_have_as_many_decimals_as_are_known(low: float, high: float, shown: str) -> None:
    estimate = ParameterEstimate("up", "gain", "gain", "", 0.0, (low + high) / 2, low, high)
    assert estimate.shown[1] == shown


def test_a_row_of_the_set_says_once_why_it_is_as_before(found: Fit) -> None:
    rows = set_texts(found, estimates_of(found))["sensors.csv"].splitlines()
    (row,) = [row for row in rows if row.startswith("tof1,")]
    assert row.count("t1 was never read") == 1
    assert "intervals" not in row


@pytest.fixture(scope="module")
def short(logged: Logged, tmp_path_factory: pytest.TempPathFactory) -> Fit:
    """A fit of a log of six movements of one drive."""
    path = tmp_path_factory.mktemp("logs") / "short.jsonl"

    async def program(session: Session) -> None:
        for amount in (3, -3) * 3:
            for code in ("u1", "u2", "u3", "g1"):
                await session.ask(code)
            await session.ask(f"d1-{amount}")
        await session.ask("u1")

    record(path, set_with(logged.configured), logged.hidden, 5, program)
    return fit(read_runs([path]))


def test_a_drive_that_was_never_used_is_named(short: Fit) -> None:
    estimates = {(each.owner, each.field): each for each in estimates_of(short)}
    assert estimates["rot", "bias.r"].why_not == "no command was sent to turn counter-clockwise (r1)"
    assert estimates["right", "bias.x"].identified


def test_a_log_that_is_too_short_for_any_test_is_not_said_to_fit(short: Fit) -> None:
    answer = json_text(result_document(short, estimates_of(short), held_back(short)))
    verdict = "The log is too short to test the model: a test needs 8 movements of one drive."
    assert json.loads(answer)["text"]["fit"] == verdict


def test_what_was_answered_once_is_said_in_words(short: Fit) -> None:
    once = refit(short, short.run.before_stop(1))
    whys = {each.why_not for each in estimates_of(once)}
    assert "d1 was answered only once" in whys
    assert "u1 faced a wall within range only twice" in whys


def test_sets_for_strength_are_by_name_and_each_is_one_robot(tmp_path: Path, capsys: Capture) -> None:
    one = tmp_path / "robot-1"
    assert main(["init", str(one)]) == 0
    assert (
        refused(["--strength"], capsys)
        == "simmer-tui calibrate: --strength takes calibrated sets: name five or more"
    )
    assert "; --strength takes a set that simmer-tui calibrate wrote" in refused(
        ["--strength", str(one)], capsys
    )
    (one / "calibration.json").write_text(json.dumps(KNOWN))
    copy = shutil.copytree(one, tmp_path / "copy")
    said = refused(["--strength", str(one), str(copy), *[str(one)] * 3], capsys)
    assert said == f"simmer-tui calibrate: {copy} is the same calibration as {one}; name each robot once"


def test_a_guided_session_says_before_it_begins_that_its_log_is_there(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    options = ["--guided", "--serial", str(tmp_path / "none"), "--config", "default"]
    (tmp_path / "x.jsonl").touch()
    said = refused([*options, "--out", str(tmp_path / "x")], capsys)
    advice = "is there already: name another --out, or give it as LOG"
    assert said == f"simmer-tui calibrate: {tmp_path / 'x.jsonl'} {advice}"
    assert "puts the robot" in refused([*options, "--out", str(tmp_path / "new" / "y")], capsys)
    assert (tmp_path / "new").is_dir()
