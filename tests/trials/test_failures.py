"""Traits that failed runs have in common."""

from __future__ import annotations

from collections.abc import Callable

from simmer_tui.report.cause_order import advice_on
from simmer_tui.report.causes import Kind
from simmer_tui.trials.failures import causes_table, changed_causes, color_of, failure_summary
from simmer_tui.trials.trial import TrialResult

Make = Callable[..., TrialResult]


def failed(make: Make, number: int, kind: Kind) -> TrialResult:
    return make(number, number, success=False, cause=kind.value, why=f"It was {kind.value}.")


def test_what_to_mend_first_and_how_much_it_would_bring(made_result: Make) -> None:
    results = [made_result(1, 1), made_result(2, 2)]
    results += [failed(made_result, number, Kind.LOST) for number in (3, 4)]
    results.append(failed(made_result, 5, Kind.TOO_CLOSE))
    told = failure_summary(results)
    assert told.startswith(f"Most frequent cause: lost, 2 of 3 failed runs. Try: {advice_on(Kind.LOST)} ")
    assert "up to 4 of 5 runs could have succeeded, not 2" in told
    assert told.endswith("run 3: It was lost.")
    assert failure_summary(results[:2]) == ""
    rows = list(causes_table(results).texts())
    assert [row[:2] for row in rows] == [["lost", "2"], ["too close", "1"]]
    assert rows[0][2].startswith("0.400 (0.")
    assert rows[0][3] == "3, 4"


def test_a_change_removes_causes_and_brings_others(made_result: Make) -> None:
    lost, slow = failed(made_result, 1, Kind.LOST), failed(made_result, 1, Kind.TOO_SLOW)
    done = made_result(2, 2)
    rows = list(changed_causes([(lost, slow), (done, done)]).texts())
    assert rows == [["lost", "1", "0", "1: 1", ""], ["too slow", "0", "1", "", "1: 1"]]
    assert not changed_causes([(done, done)]).rows


def test_failure_without_a_cause_is_counted_too(made_result: Make) -> None:
    assert [row[0] for row in causes_table([made_result(1, 1, success=False)]).rows] == ["not known"]
    assert color_of("not known") != color_of("lost")


def test_each_cause_has_a_colour_of_its_own_on_the_map() -> None:
    assert len({*map(color_of, Kind), color_of("not known")}) == len(Kind) + 1
