"""Whole documents about trials that never were, kept: every table, sentence and picture of them."""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from rich.console import Console

from simmer_tui.config.loader import find_set, load
from simmer_tui.document.as_data import document_value, plain, table_csv
from simmer_tui.document.as_html import html_page
from simmer_tui.document.as_terminal import print_document
from simmer_tui.document.model import Document, Figure
from simmer_tui.report.causes import Kind
from simmer_tui.report.finding import Basis, Finding, FindingKind, plain_findings
from simmer_tui.sim.command import cut
from simmer_tui.sim.specs import MazeSpec
from simmer_tui.trials.compare import comparison, paired
from simmer_tui.trials.curves import curves
from simmer_tui.trials.figures import map_figure
from simmer_tui.trials.folder import TrialFolder, TrialPlan
from simmer_tui.trials.requirement import Requirement
from simmer_tui.trials.sweep import points_of
from simmer_tui.trials.sweep_summary import curve_figure, curves_csv, sweep_document, sweep_page
from simmer_tui.trials.trial import Ending, TrialResult
from simmer_tui.trials.trials_page import trials_page
from simmer_tui.trials.trials_summary import runs_table, trials_document
from tests.kept_numbers import assert_kept

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="paths are written in another way there")

KEPT = Path(__file__).with_name("kept_documents.json")
Make = Callable[..., TrialFolder]
Result = Callable[..., TrialResult]


@pytest.fixture
def make(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Begins trials without results, in a folder whose name has the same length everywhere."""
    monkeypatch.chdir(tmp_path)

    def made(name: str, configuration: str = "mission", **fields: object) -> TrialFolder:
        usual: dict[str, object] = {
            "command": "python a.py", "runs": 4, "seed": 5, "configuration": configuration, "settings": {},
            "mazes": (), "random_mazes": False, "fixed_ports": False, "time_limit": 60.0, "points": (),
        }  # fmt: skip
        mazes = fields.pop("specs", {})
        plan = TrialPlan(**(usual | fields))  # type: ignore[arg-type]
        files = load(find_set(configuration)).files
        return TrialFolder.create(Path(name), plan, files, mazes)  # type: ignore[arg-type]

    return made


def lines(document: Document) -> list[str]:
    """A document on a wide terminal."""
    console = Console(file=io.StringIO(), width=240)
    print_document(document, console)
    assert isinstance(console.file, io.StringIO)
    return [line.rstrip() for line in console.file.getvalue().splitlines()]


def tables(document: Document) -> dict[str, object]:
    """The tables of a document as programs have them."""
    return {name: value for name, value in plain(document_value(document)).items() if isinstance(value, list)}


def figures(parts: object) -> Iterator[Figure]:
    """All pictures among the parts of a document."""
    if isinstance(parts, Figure):
        yield parts
    elif isinstance(parts, list | tuple):
        for each in parts:
            yield from figures(each)
    elif hasattr(parts, "parts"):
        yield from figures(parts.parts)
        yield from figures(getattr(parts, "beside", ()))


def words(page: str) -> list[str]:
    """Texts and links of a page, without its style, its scripts and pictures."""
    bare = re.sub(r"(?s)<(style|script|head|svg)\b.*?</\1>", "", page)
    links = re.findall(r"href='([^']*)'", bare)
    return [*links, *(text for text in map(str.strip, re.split(r"<[^>]*>", bare)) if text)]


def failing(number: int) -> dict[str, object]:
    """Fields of a failed run: causes, endings and outputs of all kinds, more of some than of others."""
    kinds = [Kind.LOST, Kind.TOO_CLOSE, Kind.LOST, Kind.SENSOR_WRONG, Kind.CRASHED, None]
    kind = kinds[number % 6]
    # These trials have no boards.
    endings = [each for each in Ending if each not in (Ending.SUCCESS, Ending.BOARDS)]
    fields: dict[str, object] = {
        "ending": endings[number % len(endings)],
        "exit_code": None if number % 3 else number % 4,
        "last_output": f"error {number}" if number % 2 else "",
        "reason": "" if number % 5 == 0 else f"reason {number}",
        "cause": "" if kind is None else kind.value,
        "why": "" if kind is None else f"why {number}",
        "contacts": number % 3,
        "contact_points": ((12.0 + number, 20.0), (40.5, 8.25)) if number % 3 else (),
    }
    if number % 4 == 0:
        fields["verdict"] = {"text": f"text {number}", "cause": {"kind": "lost"}}
    return fields


def fill(folder: TrialFolder, result: Result, outcomes: str, **fields: object) -> TrialFolder:
    """Give trials results: s succeeds, anything else fails."""
    for number, outcome in enumerate(outcomes, 1):
        trial = folder.trial(number)
        more: dict[str, object] = {
            "maze": trial.maze, "time": 300.0 - 7.25 * number, "distance": 150.5 + 11.0 * number,
            "commands": 20 + number, "clock": ("program", "real", "program")[number % 3],
            "start": (6.0 + 12.0 * (number % 4), 42.0 - 24.0 * (number % 2), 10.0),
            "end": (30.0 + number, 20.0 + number / 2, 45.0),
            "reached": 40.0 + number if number % 5 else None,
            "taken": 50.5 * number if number % 2 else None,
        }  # fmt: skip
        more |= {} if outcome == "s" else failing(number)
        folder.append(result(number, trial.seed, success=outcome == "s", **(more | fields)))
        if number % 4:
            folder.log(number).touch()
    return folder


OUTCOMES = "sffsfffsfffffsffffffsfffffffsffsf"
"""Eight successes, 25 failures."""


def test_trials_of_a_mission(make: Make, made_result: Result) -> None:
    folder = make(
        "mission",
        command="python " + "x" * 250,
        runs=40,
        settings={"motion.time_scale": 2.0, "server.host": "127.0.0.1"},
    )
    fill(folder, made_result, OUTCOMES)
    document = trials_document(folder)
    assert_kept({"lines": lines(document), "tables": tables(document)}, KEPT, "mission")
    page = trials_page(folder, {2: "runs/2.html", 3: "runs/3.html", 9: "runs/9.html"}, Requirement(8 / 33))
    assert_kept(words(html_page(page)), KEPT, "page of a mission")
    assert_kept([(each.title, each.width, each.height, each.content) for each in figures(page.parts)], KEPT,
                "pictures of a mission")  # fmt: skip
    assert_kept(table_csv(runs_table(folder)).splitlines()[:3], KEPT, "csv of a mission")


def test_trials_in_mazes_of_a_folder(make: Make, made_result: Result) -> None:
    cells = load(find_set("mission")).simulation.maze.cells
    specs = {"b.csv": MazeSpec(cells), "a.csv": MazeSpec(cells[::-1]), "c" * 90 + ".csv": MazeSpec(cells)}
    folder = make("mazes", mazes=tuple(specs), specs=specs, runs=11)
    fill(folder, made_result, "sffsssffsfs")
    assert_kept(lines(trials_document(folder)), KEPT, "mazes")
    page = trials_page(folder, {}, Requirement(0.6))
    assert_kept(words(html_page(page)), KEPT, "page of mazes")
    assert [each.title for each in figures(page.parts)][-2:] == ["Histogram", "Histogram"]


@pytest.mark.parametrize("failed", [12, 14])
def test_trials_in_random_mazes(make: Make, made_result: Result, failed: int) -> None:
    """A map for each maze in which a run failed or touched a wall, up to twelve."""
    folder = make("random", random_mazes=True, runs=20)
    fill(folder, made_result, "s" * 2 + "f" * (failed - 1), contacts=0, contact_points=())
    number = failed + 2
    trial = folder.trial(number)
    folder.append(made_result(number, trial.seed, maze=trial.maze, contacts=1, cause="", clock="instant"))
    page = trials_page(folder, {})
    said = words(html_page(page))
    assert len([each for each in figures(page.parts) if each.title.startswith("Map run")]) == 12
    assert [each for each in said if "more mazes" in each] == (["and 2 more mazes"] if failed == 14 else [])
    if failed == 12:
        assert_kept(said, KEPT, "page of random mazes")
        assert_kept(lines(trials_document(folder)), KEPT, "random mazes")


def test_trials_without_a_mission(make: Make, made_result: Result) -> None:
    folder = make("none", "default", runs=3)
    none = {"drop_zone": None, "reached": None, "taken": None, "delivered": None}
    fill(folder, made_result, "ff", **none, commands=0, exit_code=None, clock="", cause="", why="")
    assert_kept(lines(trials_document(folder)), KEPT, "no mission")
    assert_kept(words(html_page(trials_page(folder, {}))), KEPT, "page without a mission")


def test_trials_whose_devices_are_wrong(make: Make, made_result: Result) -> None:
    def found(of: str, value: float, kind: FindingKind = FindingKind.OFFSET) -> Finding:
        return Finding(of, kind, value, value - 0.1, value + 0.1, "in", 9, Basis.SET, f"{of} {value}")

    kept = [
        [found("u2", 2.0)], [found("u1", 3.0), found("u2", 4.5)], [found("u1", 5.0), found("u1", 6.0)], [],
        [found("u1", 1.0, FindingKind.GAIN)],
    ]  # fmt: skip
    folder = make("devices", runs=5)
    for number, each in enumerate(kept, 1):
        result = made_result(number, folder.trial(number).seed, findings=plain_findings(each))
        folder.append(result)
    document = trials_document(folder)
    assert_kept({"lines": lines(document), "tables": tables(document)}, KEPT, "devices")


def test_the_map_links_to_pages_and_says_why(make: Make, made_result: Result) -> None:
    """In a maze of other cells, with ends of several causes and runs without a sentence."""
    folder = fill(make("map", runs=12), made_result, "fsffssfffssf", cause=Kind.TOO_CLOSE.value)
    more = [made_result(20, 1, success=False, why="", cause="odd", reason="a <b>"), *folder.done]
    figure = map_figure(folder.maze(1), more, {20: "a.html", 3: "b.html"}, "A title")
    assert_kept((figure.title, figure.width, figure.height, figure.content), KEPT, "map")


@pytest.mark.parametrize(
    "varied", ["strength=0.1,0.3,0.2,0.4", "motion.motion=instant,timed", "num_segments=5,5000"]
)
def test_a_sweep_is_told_and_drawn(make: Make, made_result: Result, varied: str) -> None:
    folder = make("sweep", points=points_of([varied]), runs=5)
    outcomes = "ssssssssfsffsssf"[: 5 * len(folder.plan.points)]
    fill(folder, made_result, outcomes)
    document = sweep_document(folder, 0.8)
    assert_kept(lines(document), KEPT, f"sweep of {varied}")
    assert_kept(curves_csv(folder), KEPT, f"csv of {varied}")
    drawn = [curve_figure(curve, 0.8, "A title") for curve in curves(folder)]
    assert_kept([(each.title, each.width, each.height, each.content) for each in drawn], KEPT,
                f"curve of {varied}")  # fmt: skip


def test_the_page_of_a_sweep_names_its_program(make: Make, made_result: Result) -> None:
    folder = make("sweep", points=points_of(["strength=0.1,0.3"]), runs=2)
    fill(folder, made_result, "ssss")
    first = sweep_page(folder, 0.8).parts[0]
    command = cut(folder.plan.command)
    assert first.text.startswith(f"4 runs · set {folder.plan.configuration} · seed {folder.plan.seed} · ")
    assert first.text.endswith(f" · {command}")


def test_a_comparison_of_other_robots_and_more_runs(make: Make, made_result: Result) -> None:
    one = fill(make("one", command="python " + "y" * 140, runs=20), made_result, "sfsfsfsfsssssssfffff")
    settings = {"motion.time_scale": 2.0, "strength": "0.3,0.1"}
    other = make("other", settings=settings, runs=18)
    fill(other, made_result, "ssssssssssssssssff", contacts=2, distance=99.0)
    pairs = paired(one, other, other_robot=True)
    document = comparison(one, other, pairs)
    assert_kept({"lines": lines(document), "tables": tables(document)}, KEPT, "comparison")
    alike = fill(make("alike", runs=2), made_result, "fs")
    assert_kept(lines(comparison(alike, alike, paired(alike, alike))), KEPT, "comparison of the same")
