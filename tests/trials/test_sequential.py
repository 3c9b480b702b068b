"""The sequential test: decides with few runs, is as sure as it says, and its intervals hold the truth."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from itertools import accumulate, product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simmer_tui.cli.trials_command import run_trials
from simmer_tui.errors import TrialsError
from simmer_tui.trials import sequential
from simmer_tui.trials.sequential import SequentialTest, sequential_test, shown_test

RATES = (0.3, 0.5, 0.75, 0.9, 0.95, 1.0)


@pytest.mark.parametrize("rate", RATES)
def test_errors_are_as_small_as_promised_and_runs_few(rate: float) -> None:
    test = sequential_test(rate)
    assert max(test.false_pass, test.false_fail) <= 0.05
    assert test.passes(rate - 0.15) == pytest.approx(test.false_pass)
    assert 1 - test.passes(rate) == pytest.approx(test.false_fail)
    for true in (0.0, 0.5, 1.0, rate):
        assert test.expected_runs(true) <= test.cap


def test_default_takes_about_the_runs_that_wald_says() -> None:
    test = sequential_test(0.9)
    assert test.cap == 90
    assert [round(test.expected_runs(true)) for true in (0.0, 0.5, 0.75, 0.9, 1.0)] == [4, 9, 32, 38, 17]


def test_decision_over_a_thousand_drawn_courses() -> None:
    """Sixty teams each, half of them exactly at the rate and half at the margin below it."""
    test = sequential_test(0.9)
    random = np.random.default_rng(16)
    wrong = {0.9: 0, 0.75: 0}
    for true in wrong:
        runs = random.random((30_000, test.cap)) < true
        counts = np.cumsum(runs, axis=1)
        ended = (counts <= np.array(test.fail_at[1:])) | (counts >= np.array(test.pass_at[1:]))
        when = ended.argmax(axis=1)
        passed = counts[np.arange(len(runs)), when] >= np.array(test.pass_at[1:])[when]
        wrong[true] = int((passed if true < 0.9 else ~passed).sum())
        first = test.decision(map(bool, runs[0]))
        assert first is not None
        assert (first.passed, first.runs) == (bool(passed[0]), int(when[0]) + 1)
    assert wrong[0.75] / 30_000 <= 0.05
    assert wrong[0.9] / 30_000 <= 0.05


@pytest.mark.parametrize("cap", [1, 5, 12])
def test_computed_errors_are_those_of_all_walks(cap: int) -> None:
    test = sequential_test(0.8, cap=cap)
    chances = {0.65: 0.0, 0.8: 0.0}
    for walk in product((False, True), repeat=cap):
        decision = test.decision(walk)
        assert decision is not None
        for true in chances:
            if decision.passed:
                chances[true] += math.prod(true if success else 1 - true for success in walk)
    assert test.false_pass == pytest.approx(chances[0.65])
    assert test.false_fail == pytest.approx(1 - chances[0.8])


@pytest.mark.slow
@given(st.sampled_from(RATES), st.floats(0.001, 0.999))
def test_intervals_hold_the_truth_in_19_of_20_cases(rate: float, true: float) -> None:
    test = sequential_test(rate, cap=25)
    held = 0.0
    for runs, successes, chance in _ends(test, true):
        interval = test.interval(runs, successes)
        assert 0 <= interval.low <= interval.value <= interval.high <= 1
        held += chance if interval.low <= true <= interval.high else 0.0
    assert held >= 0.95 - 1e-9


def _ends(test: SequentialTest, true: float) -> list[tuple[int, int, float]]:
    """All ends, with their chances, followed run by run."""
    ends, walks = [], {0: 1.0}
    for runs in range(1, test.cap + 1):
        after: dict[int, float] = {}
        for count, chance in walks.items():
            after[count] = after.get(count, 0.0) + chance * (1 - true)
            after[count + 1] = after.get(count + 1, 0.0) + chance * true
        over = {c: p for c, p in after.items() if c <= test.fail_at[runs] or c >= test.pass_at[runs]}
        ends += [(runs, count, chance) for count, chance in over.items()]
        walks = {count: chance for count, chance in after.items() if count not in over}
    assert not walks
    return ends


@pytest.fixture(scope="module")
def nine_in_ten() -> SequentialTest:
    return sequential_test(0.9)


@settings(max_examples=15)
@given(walk=st.lists(st.booleans(), max_size=200))
def test_decision_stands_whatever_comes_after(nine_in_ten: SequentialTest, walk: list[bool]) -> None:
    test = nine_in_ten
    decision = test.decision(walk)
    if decision is not None:
        assert list(accumulate(walk))[decision.runs - 1] == decision.successes
        assert test.decision(walk[: decision.runs]) == decision
        assert test.decision(walk[: decision.runs - 1]) is None


def test_cap_says_what_it_costs() -> None:
    test = sequential_test(0.9, cap=30)
    assert "at most 30 runs; computed errors: false pass 10.0%, false fail 17.4%" in shown_test(test)


@pytest.mark.parametrize(("rate", "margin"), [(0.1, 0.15), (1.1, 0.15), (0.9, 0.001), (0.9, 0.0)])
def test_test_that_cannot_be_is_refused(monkeypatch: pytest.MonkeyPatch, rate: float, margin: float) -> None:
    assert sequential.LARGEST_CAP == 5000
    monkeypatch.setattr(sequential, "LARGEST_CAP", 500)  # it is looked for up to there
    with pytest.raises(TrialsError, match="success rate"):
        sequential_test(rate, margin)


# -- trials --require --sure -----------------------------------------------------------------------

DRIVES = 'robot.drive("d1", 0.5)\n'


@pytest.mark.parametrize(
    ("lines", "code", "runs"), [("sys.exit(1)", 1, 4), pytest.param("", 0, 17, marks=pytest.mark.slow)]
)
def test_trials_stop_when_it_is_sure(
    program: Callable[[str], str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    lines: str,
    code: int,
    runs: int,
) -> None:
    out = tmp_path / "out"
    options = ["--config", "default", "--seed", "3", "--jobs", "1", "--out", str(out)]
    sure = ["--require", "0.9", "--sure", "0.95"]
    assert run_trials(["--run", program(DRIVES + lines), *options, *sure]) == code
    said = capsys.readouterr().err
    assert f"after {runs} runs" in said
    assert "false pass 4.9%, false fail 4.8%" in said
    done = len((out / "results.jsonl").read_text().splitlines())
    assert done == runs
    capsys.readouterr()
    assert run_trials(["--resume", "--out", str(out), *sure, "--json"]) == code
    assert len((out / "results.jsonl").read_text().splitlines()) == done
    decision = json.loads(capsys.readouterr().out)["decision"]
    assert (decision["passed"], decision["runs"]) == (not code, runs)
    interval = f"{decision['success_rate_low']:.3f} to {decision['success_rate_high']:.3f}"
    assert f"({interval}), 95 % interval after a sequential test" in said


def test_margin_of_trials_can_be_given(
    program: Callable[[str], str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--config", "default", "--seed", "3", "--jobs", "1", "--out", str(tmp_path / "out")]
    sure = ["--require", "0.1", "--sure", "0.95", "--margin", "0.09", "--runs", "1"]
    assert run_trials(["--run", program(DRIVES + "sys.exit(1)"), *options, *sure]) == 1
    assert "success rate 0.1 passes and 0.01 fails" in capsys.readouterr().err


@pytest.mark.parametrize(
    "options",
    [["--sure", "0.95"], ["--sure", "0.9", "--require", "0.1"], ["--margin", "0.1", "--require", "0.9"]],
)
def test_options_that_cannot_be_sure_are_refused(
    options: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_trials(["--run", "x", "--out", str(tmp_path / "out"), *options]) == 2
    assert not (tmp_path / "out").exists()
    assert "rate" in capsys.readouterr().err.lower()
