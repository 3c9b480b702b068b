"""The folder of a set of trials: made once, gone on with, never mixed up."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from simmer_tui.cli.trials_command import run_trials
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_sets
from simmer_tui.errors import TrialsError
from simmer_tui.trials.folder import TrialFolder, TrialPlan
from simmer_tui.trials.trial import TrialResult, run_seed


@pytest.fixture
def plan() -> TrialPlan:
    return TrialPlan(
        command="python a.py",
        runs=4,
        seed=9,
        configuration="mission",
        settings={"num_segments": "20", "motion.block_solid": True},
        mazes=(),
        random_mazes=False,
        fixed_ports=False,
        time_limit=60.0,
    )


@pytest.fixture
def folder(tmp_path: Path, plan: TrialPlan) -> TrialFolder:
    files = load(bundled_sets()["mission"]).files
    return TrialFolder.create(tmp_path / "trials", plan, files, {})


def test_folder_gives_back_plan_set_options_and_results(
    folder: TrialFolder, plan: TrialPlan, made_result: Callable[..., TrialResult]
) -> None:
    results = [made_result(number, run_seed(9, number), success=number != 3) for number in (3, 1)]
    for result in results:
        folder.append(result)
    again = TrialFolder.read(folder.path)
    assert again.plan == plan
    assert again.configuration.name == "mission"
    assert again.configuration.simulation.num_segments == 20
    assert again.configuration.simulation.block_solid
    assert again.done == results[::-1]
    assert again.to_do == [2, 4]


@pytest.mark.skipif(sys.platform == "win32", reason="there is no lock on Windows")
def test_plan_stays_while_its_runs_are_done(folder: TrialFolder, plan: TrialPlan) -> None:
    other = TrialFolder.read(folder.path)
    with folder.store.locked(), pytest.raises(TrialsError, match="another simmer-tui is adding results"):
        other.write_plan(msgspec.structs.replace(plan, command="python b.py"))
    assert TrialFolder.read(folder.path).plan == other.plan == plan


def test_line_that_was_cut_off_is_a_run_not_done(
    folder: TrialFolder, made_result: Callable[..., TrialResult]
) -> None:
    folder.append(made_result(1, run_seed(9, 1)))
    path = folder.path / "results.jsonl"
    whole = path.read_bytes()
    path.write_bytes(whole + msgspec.json.encode(made_result(2, run_seed(9, 2))))
    again = TrialFolder.read(folder.path)
    assert again.to_do == [2, 3, 4]
    with again.store.locked():
        pass
    assert path.read_bytes() == whole


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("nonsense\n", r"results\.jsonl:1: JSON is malformed.*; delete the line to run it again"),
        ("[]\n", r"results\.jsonl:1: Expected `object`, got `array`"),
    ],
)
def test_broken_line_is_named(folder: TrialFolder, line: str, why: str) -> None:
    (folder.path / "results.jsonl").write_text(line)
    with pytest.raises(TrialsError, match=why):
        TrialFolder.read(folder.path)


def test_result_of_other_trials_is_refused(
    folder: TrialFolder, made_result: Callable[..., TrialResult]
) -> None:
    folder.append(made_result(1, run_seed(8, 1)))
    with pytest.raises(TrialsError, match="is of a run with another seed"):
        TrialFolder.read(folder.path)


def test_trials_are_not_begun_in_a_folder_that_holds_anything(folder: TrialFolder, plan: TrialPlan) -> None:
    with pytest.raises(TrialsError, match="holds trials already: add --resume"):
        TrialFolder.create(folder.path, plan, {}, {})
    with pytest.raises(TrialsError, match="is not empty"):
        TrialFolder.create(folder.path.parent, plan, {}, {})


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("{", "Input data was truncated"),
        ('{"format": 99}', "the format is not 1"),
        ('{"format": 1}', "missing required field `command`"),
        ('{"format": 1, "command": 5}', r"Expected `str`, got `int` - at `\$\.command`"),
    ],
)
def test_plan_that_cannot_be_read_is_named(folder: TrialFolder, text: str, why: str) -> None:
    (folder.path / "trials.json").write_text(text)
    with pytest.raises(TrialsError, match=rf"trials\.json: .*{why}"):
        TrialFolder.read(folder.path)


@pytest.mark.parametrize(
    ("options", "error"),
    [
        (["--run", "python b.py"], "--run differs from that of these trials (python a.py)"),
        (["--seed", "10"], "--seed differs from that of these trials (9)"),
        (["--config", "default"], "--config differs from that of these trials (mission)"),
        (["--random-mazes"], "--random-mazes differs from that of these trials"),
        (["--num-segments", "10"], "an option of the settings differs from that of these trials"),
        (["--runs", "3"], "--runs 3 is less than the 4"),
    ],
)
def test_trials_are_not_gone_on_with_as_others(
    folder: TrialFolder,
    made_result: Callable[..., TrialResult],
    options: list[str],
    error: str,
    capfd: pytest.CaptureFixture[str],
) -> None:
    folder.append(made_result(1, run_seed(9, 1)))
    assert run_trials(["--resume", "--out", str(folder.path), *options]) == 2
    assert error in capfd.readouterr().err


@pytest.mark.slow
def test_a_mistyped_program_is_corrected_while_no_run_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    options = ["--runs", "1", "--jobs", "1", "--out", "out"]
    Path("notes.txt").touch()
    assert run_trials(["--run", "./notes.txt", *options]) == 2
    right = ["--run", f"{sys.executable} -c pass", *options]
    assert run_trials(right) == 2
    assert "add --resume" in capfd.readouterr().err
    assert run_trials([*right, "--resume"]) == 0
    folder = TrialFolder.read(tmp_path / "out")
    assert (folder.plan.command, len(folder.done)) == (right[1], 1)
    assert run_trials([*options, "--run", "python -c other", "--resume"]) == 2


def test_finished_trials_gone_on_with_only_show_their_table(
    folder: TrialFolder, made_result: Callable[..., TrialResult], capfd: pytest.CaptureFixture[str]
) -> None:
    for number in range(1, 5):
        folder.append(made_result(number, run_seed(9, number)))
    same = ["--run", "python a.py", "--config", "mission", "--seed", "9", "--num-segments", "20"]
    assert run_trials(["--resume", "--out", str(folder.path), *same, "--block-solid"]) == 0
    assert "1.000 (0.510 to 1.000)" in capfd.readouterr().out
