"""Pages and tables of trials that never were, kept; and runs that are explained without running them."""

from __future__ import annotations

import pickle
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace as changed_trial
from pathlib import Path

import pytest
from msgspec import structs

from simmer_tui.config.loader import find_set, load
from simmer_tui.config.settings import ELSE_REAL
from simmer_tui.document.as_data import document_value, plain
from simmer_tui.document.as_html import html_page
from simmer_tui.trials import explanations
from simmer_tui.trials.compare import comparison, paired
from simmer_tui.trials.explanations import Explanations, FolderRuns, explanation_tables
from simmer_tui.trials.folder import TrialFolder, TrialPlan
from simmer_tui.trials.interventions import UNCHANGED
from simmer_tui.trials.requirement import Requirement
from simmer_tui.trials.sweep import points_of
from simmer_tui.trials.sweep_summary import sweep_document, sweep_page
from simmer_tui.trials.trial import Ending, Trial, TrialResult, run_seed, with_clock
from simmer_tui.trials.trials_page import trials_page
from tests.kept_numbers import assert_kept

KEPT = Path(__file__).with_name("kept_answers.json")
Make = Callable[..., TrialFolder]


@pytest.fixture
def make(tmp_path: Path, made_result: Callable[..., TrialResult]) -> Make:
    """Makes trials with these outcomes: s succeeds, t is out of time, anything else hits a wall."""

    def made(name: str, outcomes: str, *varied: str, **fields: object) -> TrialFolder:
        points = points_of(varied)
        plan = TrialPlan(
            command="python a.py", runs=len(outcomes) // max(len(points), 1), seed=5, configuration="mission",
            settings={}, mazes=(), random_mazes=False, fixed_ports=False, time_limit=60.0, points=points,
        )  # fmt: skip
        folder = TrialFolder.create(tmp_path / name, plan, load(find_set("mission")).files, {})
        for number, outcome in enumerate(outcomes, 1):
            trial = folder.trial(number)
            cause = {"kind": "sensor wrong", "sure": "likely", "culprits": ["u1", "u2"], "text": "u1 was off"}
            given: dict[str, object] = {
                "time": 90.0 + 7.0 * number, "distance": 150.0 + 11.0 * number, "commands": 20 + number,
                "clock": "real" if number == 3 else "program", "start": (20.0 + 5.0 * number, 42.0, 10.0),
                "end": (30.0 + number, 20.0, 45.0),
            }  # fmt: skip
            if outcome == "t":
                given |= {"ending": Ending.TIME_LIMIT, "reason": "out of time", "contacts": 0}
            if outcome != "s":
                given |= {"cause": "sensor wrong", "why": "u1 was off", "verdict": {"cause": cause}}
            result = made_result(number, trial.seed, success=outcome == "s", **given)
            folder.append(structs.replace(result, **fields))
        return folder

    return made


def words(page: str) -> list[str]:
    """Texts of a page, without its style, its scripts and pictures."""
    bare = re.sub(r"(?s)<(style|script|head|svg)\b.*?</\1>", "", page)
    return [text for text in map(str.strip, re.split(r"<[^>]*>", bare)) if text]


def test_a_page_of_trials_is_that_which_was_kept(make: Make) -> None:
    found = {
        name: words(html_page(trials_page(make(name, outcomes), {2: "runs/2.html"}, Requirement(required))))
        for name, outcomes, required in (("mixed", "sxstssxt", 0.5), ("good", "sss", None))
    }
    assert_kept(found, KEPT, "pages")


def test_a_sweep_is_told_as_it_was_kept(make: Make, tmp_path: Path) -> None:
    folder = make("sweep", "ssxssssxsstx", "num_segments=5,20", "strength=0.3")
    value = plain(document_value(sweep_document(folder, 0.6)))
    found = {
        "text": value["text"],
        "tables": {name: each for name, each in value.items() if "sweep" in name or "curve" in name},
        "page": words(html_page(sweep_page(folder, 0.6))),
    }
    assert str(tmp_path) not in str(found)
    assert_kept(found, KEPT, "sweep")


def test_a_comparison_is_told_as_it_was_kept(make: Make) -> None:
    one, other = make("a", "sxstssxt"), make("b", "ssssxss", time=77.0)
    value = plain(document_value(comparison(one, other, paired(one, other))))
    for row in value["sets"]:
        row.pop("folder")
    assert_kept(value, KEPT, "comparison")


def test_failed_runs_are_explained_by_what_changed_runs_do(
    make: Make, made_result: Callable[..., TrialResult], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of two failed runs the first succeeds without bias of the drives; unchanged once in seven."""
    folder = make("why", "sxt")
    asked: list[tuple[int, int, int | None]] = []

    def run(trials: Iterable[Trial], logs: Path, jobs: int, make: object) -> Iterator[TrialResult]:
        for trial in trials:
            asked.append((trial.number, trial.repetition, trial.errors_seed))
            fair = not trial.configuration.simulation.randbias
            success = trial.repetition == 2 and (fair or trial.errors_seed == run_seed(trial.seed, 2))
            yield made_result(trial.number, trial.seed, success=success, verdict={"text": "it hit"})

    monkeypatch.setattr(explanations, "run_locally", run)
    monkeypatch.setattr(explanations, "REPEATS", 7)
    found = Explanations(FolderRuns(folder))
    done = [(each.run, each.change, each.repeat, each.succeeded, each.text) for each in found.explain(2, 4)]
    unchanged = [(run, *outcome) for run, change, *outcome, _ in done if change == UNCHANGED]
    assert unchanged == [
        (2, 0, False), (3, 0, False), (2, 1, False), (2, 2, True),
        (2, 3, False), (2, 4, False), (2, 5, False), (2, 6, False), (2, 7, False),
    ]  # fmt: skip
    tables = {table.key: table.rows for table in explanation_tables(folder)}
    why = [(row[0], row[1], row[2], row[3]) for row in tables["why"]]
    assert_kept({"asked": asked, "done": done, "why": why}, KEPT, "explanations")
    assert len(tables["interventions"]) == len(done)
    before = len(asked)
    assert list(Explanations(FolderRuns(folder)).explain(2, 4)) == []
    assert len(asked) == before


def test_a_run_that_may_be_repeated_may_take_twice_its_limit() -> None:
    configuration = load(find_set("mission"))
    trial = Trial(
        number=7, seed=1, configuration=with_clock(configuration, "program"), maze="", command="x",
        fixed_ports=False, time_limit=9.0,
    )  # fmt: skip
    assert (trial.longest, trial.name) == (9.0, "0007")
    again = changed_trial(trial, configuration=with_clock(configuration, ELSE_REAL))
    assert again.longest == 18.0
    assert pickle.loads(pickle.dumps(again)).longest == 18.0, "in a worker's process as well"
