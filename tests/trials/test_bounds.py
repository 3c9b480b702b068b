"""Limits of trials on both sides: pages, mazes that are tried, tests that can be, changes that are sure."""

from __future__ import annotations

import math
import os
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from simmer_tui.config.loader import find_set, load
from simmer_tui.errors import ConfigurationError, TrialsError
from simmer_tui.sim.specs import MazeSpec
from simmer_tui.trials import figures
from simmer_tui.trials import trial as trial_module
from simmer_tui.trials.chance_control import ChanceControl, control_of
from simmer_tui.trials.cluster import pack
from simmer_tui.trials.explanations import EXPLAINED
from simmer_tui.trials.figures import write_run_pages
from simmer_tui.trials.folder import KIND, TrialFolder, TrialPlan
from simmer_tui.trials.intervals import PairCounts, student_quantile
from simmer_tui.trials.mazes import maze_text, random_maze
from simmer_tui.trials.sequential import REQUIRED_RATE, sequential_test, shown_test
from simmer_tui.trials.store import RunStore
from simmer_tui.trials.trial import RANDOM, Trial, TrialResult, maze_of, run_clock, run_seed, with_clock
from tests.kept_numbers import assert_kept

posix = pytest.mark.skipif(sys.platform == "win32", reason="errors and paths are told in another way there")
KEPT = Path(__file__).with_name("kept_bounds.json")


@pytest.fixture
def folder(tmp_path: Path) -> TrialFolder:
    plan = TrialPlan(
        command="python a.py", runs=70, seed=5, configuration="mission", settings={}, mazes=(),
        random_mazes=False, fixed_ports=False, time_limit=60.0,
    )  # fmt: skip
    return TrialFolder.create(tmp_path / "a" / "b" / "out", plan, load(find_set("mission")).files, {})


def test_pages_are_written_of_sixty_failed_runs(
    folder: TrialFolder, made_result: Callable[..., TrialResult], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of those whose logs are there, whole, not too large, and newer than their pages."""
    for number in range(1, 67):
        folder.append(made_result(number, folder.trial(number).seed, success=number == 1, cause="lost"))
        folder.log(number).write_text("a log")
    with folder.log(2).open("wb") as log:
        log.truncate(20_000_000)
    with folder.log(3).open("wb") as log:
        log.truncate(20_000_001)
    folder.log(4).unlink()
    made: list[str] = []

    def log_page(log: Path, name: str) -> str | None:
        made.append(name)
        return None if name == "0005.jsonl" else f"page of {name}"

    monkeypatch.setattr(figures, "log_page", log_page)
    pages = write_run_pages(folder)
    assert sorted(pages) == [2, *range(6, 65)]
    assert made == [f"{number:04}.jsonl" for number in (2, *range(5, 65))]
    assert pages[2] == "runs/0002.html"
    assert (folder.path / pages[9]).read_text() == "page of 0009.jsonl"
    made.clear()
    time = folder.log(7).stat().st_mtime_ns
    os.utime(folder.path / pages[7], ns=(time, time))
    os.utime(folder.path / pages[8], ns=(time, folder.log(8).stat().st_mtime_ns - 1))
    assert write_run_pages(folder) == pages
    assert made == ["0005.jsonl", "0008.jsonl"]


@pytest.mark.parametrize("refused", [0, 199, 200])
def test_two_hundred_mazes_are_tried(monkeypatch: pytest.MonkeyPatch, refused: int) -> None:
    tried: list[int] = []

    def faults(configuration: object) -> list[str]:
        return ["too narrow", "too low"] if len(tried) <= refused else []

    def made(like: MazeSpec, random: np.random.Generator) -> MazeSpec:
        tried.append(1)
        return like

    monkeypatch.setattr(trial_module, "random_maze", made)
    monkeypatch.setattr(trial_module, "maze_faults", faults)
    trial = Trial(
        number=1, seed=5, configuration=load(find_set("mission")), maze=RANDOM, command="x",
        fixed_ports=False, time_limit=1.0,
    )  # fmt: skip
    if refused < 200:
        maze_of(trial)
        assert len(tried) == refused + 1
    else:
        with pytest.raises(ConfigurationError, match=r"no maze was found that fits: too narrow; too low"):
            maze_of(trial)
        assert len(tried) == 200
    assert maze_of(replace(trial, maze="")) is trial.configuration


def test_mazes_and_seeds_of_runs_are_those_that_were_kept() -> None:
    """A changed one would change every set of trials that is gone on with."""
    configuration = load(find_set("mission"))
    trial = Trial(
        number=1,
        seed=5,
        configuration=configuration,
        maze=RANDOM,
        command="x",
        fixed_ports=False,
        time_limit=1.0,
    )
    drawn = [maze_of(replace(trial, seed=seed)).simulation.maze for seed in (1, 2, 2**128 - 1)]
    like = [MazeSpec(((0, 0, 1, 2), (0, 3, 1, 1), (0, 0, 0, 1))), MazeSpec(((0,),)), MazeSpec(((1, 2, 3),))]
    random = [random_maze(each, np.random.default_rng(seed)) for each in like for seed in range(3)]
    found = {
        "mazes": [maze_text(each) for each in (*drawn, *random)],
        "seeds": [run_seed(seed, number) for seed in (0, 1, 2**70) for number in (1, 2, 1000)],
    }
    assert_kept(found, KEPT, "mazes")


@pytest.mark.parametrize(
    ("rate", "margin", "risk", "cap", "is_one"),
    [
        (0.9, 0.5, 0.05, None, True),
        (0.9, 0.5, 0.05, 1, True),
        (0.9, 0.5, 0.05, 0, False),
        (0.9, 0.5, 0.05, 5001, False),
        (1.0, 0.5, 0.05, None, True),
        (1.0 + 1e-12, 0.5, 0.05, None, False),
        (0.5, 0.5, 0.05, None, False),
        (0.5 + 1e-9, 0.5, 0.05, 3, True),
        (0.9, 0.5, 0.5, None, False),
        (0.9, 0.5, 0.49999, None, True),
        (0.9, 0.5, 1e-9, 9, True),
        (0.9, 0.5, 0.9e-9, 9, False),
        (0.9, 1e-9, 0.05, 9, True),
        (0.9, 0.9e-9, 0.05, 9, False),
    ],
)
def test_tests_that_can_be(rate: float, margin: float, risk: float, cap: int | None, is_one: bool) -> None:
    if is_one:
        test = sequential_test(rate, margin, risk, cap)
        assert cap in (None, test.cap)
        assert 0.0 <= min(test.false_pass, test.false_fail) <= max(test.false_pass, test.false_fail) <= 1.0
    else:
        with pytest.raises(
            TrialsError, match=r"^no test tells a success rate of .* a cap of runs at most 5000$"
        ):
            sequential_test(rate, margin, risk, cap)


def test_tests_are_those_that_were_kept() -> None:
    found = []
    for given in (
        (0.9,),
        (0.8, 0.3, 0.1),
        (1.0, 0.2, 0.01),
        (0.6, 0.5, 0.2, 4),
        (0.95, 0.4, 0.02),
        (0.99, 0.98),
    ):
        test = sequential_test(*given)  # type: ignore[arg-type]
        rates = [0.0, 0.3, test.rate - test.margin, test.rate, 1.0]
        walks = ([True] * test.cap, [False] * test.cap, [number % 3 > 0 for number in range(test.cap)])
        decisions = [decision for walk in walks if (decision := test.decision(walk))]
        intervals = [test.interval(decision.runs, decision.successes) for decision in decisions]
        found.append(
            {
                "text": shown_test(test),
                "bounds": (test.fail_at[1:], test.pass_at[1:]),
                "errors": (test.false_pass, test.false_fail),
                "passes": [test.passes(rate) for rate in rates],
                "runs": [test.expected_runs(rate) for rate in rates],
                "intervals": [(each.value, each.low, each.high) for each in intervals],
            }
        )
    assert_kept(found, KEPT, "tests")


@pytest.mark.parametrize(
    ("pairs", "tested", "p", "is_sure"),
    [
        (PairCounts(0, 0, 6, 4), 1, 0.03125, True),
        (PairCounts(2, 0, 6, 2), 2, 0.0625, False),
        (PairCounts(0, 6, 0, 4), 1, 0.03125, False),
        (PairCounts(1, 0, 5, 4), 1, 0.0625, False),
        (PairCounts(1, 1, 8, 0), 1, 20 / 512, True),
        (PairCounts(3, 3, 3, 1), 4, 1.0, False),
    ],
)
def test_a_change_is_sure_below_one_in_twenty(
    pairs: PairCounts, tested: int, p: float, is_sure: bool
) -> None:
    """McNemar's exact test, times the number of changes."""
    control = ChanceControl("a", pairs, tested)
    assert (control.p, control.is_sure) == (pytest.approx(p), is_sure)
    assert (control.successes, control.unchanged) == (
        pairs.both + pairs.second_only,
        pairs.both + pairs.first_only,
    )
    assert control.text == (
        f"with other random errors {control.successes} of {pairs.count} runs succeed, unchanged "
        f"{control.unchanged} of {pairs.count} (p = {p:.2g})"
    )


def test_a_control_compares_the_same_errors() -> None:
    control = control_of(
        "a", {1: True, 2: True, 3: False, 5: True}, {1: False, 2: True, 3: False, 4: True}, 3
    )
    assert control == ChanceControl("a", PairCounts(1, 0, 1, 1), 3)
    assert control_of("a", {1: True}, {2: True}, 3) is None


def test_usual_numbers_are_those_of_the_documents() -> None:
    assert (EXPLAINED, REQUIRED_RATE) == (3, 0.9)  # docs/trials.md


@posix
def test_a_file_after_a_module_goes_alone(tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    for path in (here, there):
        path.mkdir()
        for name in ("a.py", "b.txt"):
            (path / name).touch()
    found = pack(f"python -m a {there}/b.txt b.txt --x={there}/a.py", here)
    assert sorted(found.files) == ["a.py", "b.txt", "elsewhere/1/b.txt", "elsewhere/3/a.py"]
    assert found.words == ("python", "-m", "a", "elsewhere/1/b.txt", "b.txt", "--x=elsewhere/3/a.py")


def test_a_folder_of_runs_may_exist_and_its_lock_ends(tmp_path: Path) -> None:
    store = RunStore(tmp_path, KIND)
    with store.made():
        pass
    for _ in range(2):
        with store.locked():
            assert math.isfinite(store.results.stat().st_size)


@posix
def test_a_file_that_cannot_be_read_or_written_says_why(tmp_path: Path) -> None:
    store = RunStore(tmp_path, KIND)
    (tmp_path / KIND.plan_file).mkdir()
    (tmp_path / "results.jsonl").mkdir()
    (tmp_path / "main.py").touch()

    def refused(self: Path, *given: object) -> bytes:
        raise PermissionError(13, "Permission denied", "a file")

    found = []
    for call in (
        store.read_plan,
        lambda: [*store.lines()],
        store.recover,
        lambda: store.locked().__enter__(),
        lambda: store.write("results.jsonl", ""),
    ):
        with pytest.raises(TrialsError) as caught:
            call()
        found.append(str(caught.value).replace(str(tmp_path), "HERE"))
    assert found == [
        "HERE cannot be read: Is a directory",
        "HERE/results.jsonl cannot be read: Is a directory",
        "HERE/results.jsonl cannot be written: Is a directory",
        "HERE/results.jsonl cannot be written: Is a directory",
        "HERE/results.jsonl cannot be written: Is a directory",
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, "read_bytes", refused)
        with pytest.raises(TrialsError, match=r"^--run: .*main\.py cannot be read: Permission denied$"):
            pack("python main.py", tmp_path)
    with pytest.raises(TrialsError, match=r"^.* cannot be read: odd$"), store.reported("read"):
        raise OSError("odd")


def test_a_plan_is_a_file_that_people_can_read(folder: TrialFolder) -> None:
    lines = (folder.path / "trials.json").read_text().split("\n")
    assert lines[:2] == ["{", ' "format": 1,']
    assert re.fullmatch(r' "written": "\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d[+-]\d\d:\d\d",', lines[3])
    assert lines[-2:] == ["}", ""]
    assert ' "command": "python a.py",' in lines


def test_the_clock_of_a_set_is_never_left_open() -> None:
    """However the word came into its settings."""
    configuration = load(find_set("mission"))
    for clock, found in (("auto", "real"), ("program", "program"), ("real", "real")):
        given = with_clock(configuration, "".join([*clock]))
        assert run_clock(given) == found


@pytest.mark.parametrize(
    ("degrees", "quantile"), [(11, 2.200980255324827), (13, 2.1603665523392532), (40, 2.0210753829953374)]
)
def test_the_expansion_of_students_quantile_is_exact(degrees: int, quantile: float) -> None:
    """All terms of Abramowitz and Stegun, 26.7.5, added up in rational numbers."""
    assert student_quantile(degrees) == pytest.approx(quantile, rel=1e-14)
