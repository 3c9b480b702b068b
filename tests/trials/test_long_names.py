"""Texts from outside are cut in messages and answers: each place has its length."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from simmer_tui.config.loader import find_set, load
from simmer_tui.document.as_data import document_value, plain
from simmer_tui.document.model import Document
from simmer_tui.errors import SimmerError, TrialsError
from simmer_tui.sim.specs import MazeSpec
from simmer_tui.trials.cluster import pack
from simmer_tui.trials.compare import comparison, paired
from simmer_tui.trials.folder import KIND, TrialFolder, TrialPlan
from simmer_tui.trials.mazes import read_mazes
from simmer_tui.trials.store import RunStore
from simmer_tui.trials.sweep import files_at, points_of
from simmer_tui.trials.sweep_summary import Curve, SweepValue, answer, curve_figure, sweep_page, sweep_tables
from simmer_tui.trials.trial import TrialResult
from simmer_tui.trials.trials_page import trials_page
from simmer_tui.trials.trials_summary import tables

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="paths are shorter there")

X = "x" * 900


def lengths(text: object) -> list[int]:
    """Lengths of all texts in which x stands for what is long, with the dots of what is cut off."""
    return [len(each) for each in re.findall(r"x{8,}(?:\.\.\.)?", str(text))]


def message(function: Callable[..., object], *given: object) -> str:
    with pytest.raises(SimmerError) as caught:
        function(*given)
    return str(caught.value)


@pytest.fixture
def deep(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A relative folder whose path has far more than 200 characters."""
    monkeypatch.chdir(tmp_path)
    path = Path("x" * 250)
    path.mkdir()
    return path


def test_paths_have_200_characters(deep: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = RunStore(deep, KIND)
    found = [message(store.read_plan), message(read_mazes, deep), message(read_mazes, deep / "none")]
    (deep / KIND.plan_file).write_text("{}")
    found += [message(store.read_plan), message(lambda: store.made().__enter__())]
    (deep / KIND.plan_file).rename(deep / "other")
    found.append(message(lambda: store.made().__enter__()))
    (deep / "results.jsonl").write_text(f'{{"number":"{X}"}}\n')
    found.append(message(lambda: list(store.lines())))
    (deep / "results.jsonl").unlink()
    (deep / "results.jsonl").mkdir()
    found.append(message(lambda: list(store.lines())))
    (deep / "main.py").write_bytes(bytes(8_000_001))
    found.append(message(pack, f"python {deep}/main.py", Path()))
    assert [lengths(each)[0] for each in found] == [200] * len(found), found
    assert all(len(each) < 450 for each in found)


def test_another_process_is_told_by_its_folder(deep: Path) -> None:
    store = RunStore(deep, KIND)
    with store.locked():
        said = message(lambda: RunStore(deep, KIND).locked().__enter__())
    assert lengths(said) == [200]
    assert said.endswith(": another simmer-tui is adding results: wait until it has ended")


def test_a_wrong_value_has_200_characters(deep: Path, tmp_path: Path) -> None:
    store = RunStore(tmp_path, KIND)
    (tmp_path / KIND.plan_file).write_text(f'{{"format": 1, "{X}": 1}}')
    assert "; simmer-tui" in message(store.read_plan)
    (tmp_path / "results.jsonl").write_text(f'{{"{X}": 1}}\n')
    said = message(lambda: list(store.lines()))
    what = said.partition("results.jsonl:1: ")[2].partition("; delete the line to run it again")[0]
    assert len(what) == 200


def test_values_to_vary_are_cut() -> None:
    folder = find_set("mission")
    assert lengths(message(points_of, [X])) == [80]
    twice = message(points_of, [f"{X}=1,1"])
    assert len(twice.partition("--vary: ")[2].partition(" is given twice")[0]) == 80
    assert lengths(message(files_at, {X: "1"}, folder)) == [60]
    long = message(files_at, {f"u1.{X}": "1"}, folder)
    assert lengths(long) == [60 - len("u1."), 60]


@pytest.fixture
def result(made_result: Callable[..., TrialResult]) -> Callable[..., TrialResult]:
    return made_result


def curve(values: Sequence[tuple[str, str]], result: Callable[..., TrialResult]) -> Curve:
    """Values with the outcomes of their runs."""
    places = (
        SweepValue(
            value, tuple(result(number, 1, success=each == "s") for number, each in enumerate(runs, 1))
        )
        for value, runs in values
    )
    return Curve(X, tuple(places))


def test_names_and_values_of_a_sweep_are_cut(result: Callable[..., TrialResult]) -> None:
    words = curve([(X, "ss"), ("y" * 90, "sf")], result)
    assert lengths(answer(words, 0.9)) == [60, 60]
    assert answer(words, 0.4).count("y" * 57 + "...") == 1
    number = f"1,{X}"
    numbers = curve([(number, "ss"), (f"2,{X}", "ff")], result)
    assert lengths(answer(numbers, 0.9)) == [60, 58, 58, 58]
    assert lengths(answer(curve([(number, "f")], result), 0.9)) == [60, 58]
    drawn = curve_figure(numbers, 0.9, "A title").content
    assert lengths(drawn) == [18, 18, 60]


def folder(path: Path, configuration: str = X, **fields: object) -> TrialFolder:
    """Trials of long names, without results."""
    mazes = fields.pop("specs", {})
    usual: dict[str, object] = {
        "command": X, "runs": 4, "seed": 5, "configuration": configuration, "settings": {}, "mazes": (),
        "random_mazes": False, "fixed_ports": False, "time_limit": 60.0, "points": (),
    }  # fmt: skip
    plan = TrialPlan(**(usual | fields))  # type: ignore[arg-type]
    return TrialFolder.create(path, plan, load(find_set("mission")).files, mazes)  # type: ignore[arg-type]


def fill(trials: TrialFolder, result: Callable[..., TrialResult]) -> TrialFolder:
    for number in range(1, trials.plan.total + 1):
        trial = trials.trial(number)
        trials.append(result(number, trial.seed, maze=trial.maze, success=number % 2 == 0))
    return trials


def text(document: Document) -> str:
    return str([document.title, *document.parts])


def test_names_of_trials_are_cut(tmp_path: Path, result: Callable[..., TrialResult]) -> None:
    cells = load(find_set("mission")).simulation.maze.cells
    specs = {"x" * 200 + ".csv": MazeSpec(cells), "b.csv": MazeSpec(cells)}
    trials = folder(tmp_path / "out", specs=specs, mazes=tuple(specs), settings={"server.token": X[:90]})
    fill(trials, result)
    made = {table.key: dict(zip("abc", table.texts(), strict=False)) for table in tables(trials)}
    summary = next(table for table in tables(trials) if table.key == "trials")
    rows = dict(summary.texts())
    assert [lengths(rows[name]) for name in ("program", "configuration", "options")] == [[200], [120], [60]]
    assert lengths(made["mazes"]) == [60]
    page = trials_page(trials, {})
    assert lengths(page.title) == [120]
    assert lengths(page.parts[0]) == [120, 120]
    headings = [part.text for part in parts_of(page) if type(part).__name__ == "SectionHeading"]
    assert [lengths(each) for each in headings if "x" in each] == [[80]]


def parts_of(document: Document) -> list[object]:
    """The parts of a document and those folded in it."""
    found: list[object] = []
    for part in document.parts:
        found += [part, *getattr(part, "parts", ())]
    return found


def test_names_of_a_sweep_are_cut_on_its_page(tmp_path: Path, result: Callable[..., TrialResult]) -> None:
    points = points_of(["num_segments=5,6"])
    trials = fill(folder(tmp_path / "out", points=points, runs=2), result)
    page = sweep_page(trials, 0.9)
    assert lengths(page.title) == [120]
    about = page.parts[0]
    assert len(str(about.text)) == 400  # type: ignore[union-attr]
    assert [table.title for table in sweep_tables(trials, 0.9)] == ["Success against num_segments"]


def test_names_of_compared_trials_are_cut(tmp_path: Path, result: Callable[..., TrialResult]) -> None:
    one = fill(folder(tmp_path / "a"), result)
    other = fill(folder(tmp_path / "b", settings={"server.token": "y"}), result)
    sets = plain(document_value(comparison(one, other, paired(one, other))))["sets"]
    assert [lengths([row["program"], row["configuration"]]) for row in sets] == [[900, 900]] * 2
    shown = [list(table.texts()) for table in comparison(one, other, paired(one, other)).parts[:1]]  # type: ignore[union-attr]
    assert lengths(shown) == [120, 80, 120, 80]
    mazes = {"x" * 200 + ".csv": MazeSpec(load(find_set("mission")).simulation.maze.cells)}
    walls = {"x" * 200 + ".csv": MazeSpec(((1, 1, 2), (3, 3, 2)))}
    third = fill(folder(tmp_path / "c", specs=mazes, mazes=tuple(mazes)), result)
    fourth = folder(tmp_path / "d", specs=mazes, mazes=tuple(mazes))
    fill(fourth, result)
    fourth.mazes |= walls
    with pytest.raises(TrialsError) as caught:
        paired(third, fourth)
    assert lengths(caught.value) == [60]
