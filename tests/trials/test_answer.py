"""Tables, page and trials.csv of results that are known."""

from __future__ import annotations

import csv
import io
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.console import Console

from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_sets
from simmer_tui.document import svg
from simmer_tui.document.as_data import table_csv
from simmer_tui.document.as_html import html_page
from simmer_tui.document.as_terminal import print_table
from simmer_tui.document.model import DataTable
from simmer_tui.run.events import Goal
from simmer_tui.trials.figures import histogram_figure, map_figure
from simmer_tui.trials.folder import TrialFolder, TrialPlan
from simmer_tui.trials.requirement import Requirement
from simmer_tui.trials.sequential import sequential_test
from simmer_tui.trials.trial import Ending, TrialResult, run_seed
from simmer_tui.trials.trials_page import trials_page
from simmer_tui.trials.trials_summary import ports_advice, runs_table, trials_tables
from tests.report.browser import SIZES, measured


@pytest.fixture
def folder(tmp_path: Path, made_result: Callable[..., TrialResult]) -> TrialFolder:
    """Ten runs: four fail, three of them from the cell at (30, 18)."""
    plan = TrialPlan(
        command="python <b>algo</b>.py",
        runs=10,
        seed=1,
        configuration="mission",
        settings={},
        mazes=(),
        random_mazes=False,
        fixed_ports=False,
        time_limit=60.0,
    )
    folder = TrialFolder.create(tmp_path / "trials", plan, load(bundled_sets()["mission"]).files, {})
    for number in range(1, 11):
        start = (30.0, 18.0, 90.0) if number <= 4 else (90.0, 42.0, 0.0)
        result = made_result(number, run_seed(1, number), success=number not in (1, 2, 3, 10), start=start)
        folder.append(result)
        folder.log(number).write_text("a log")
    return folder


def named(folder: TrialFolder) -> dict[str, DataTable]:
    return {table.title: table for table in trials_tables(folder)}


def test_summary_has_the_rate_and_its_interval(folder: TrialFolder) -> None:
    rows = dict(named(folder)["Trials"].texts())
    assert rows["success rate"] == "0.600 (0.313 to 0.832)"
    assert rows["contacts"] == "4 in 4 runs"
    assert rows["runs"] == "10"


def test_start_cells_are_told_apart(folder: TrialFolder) -> None:
    rows = named(folder)["By start cell"].texts()
    assert [row[:3] for row in rows] == [["(90, 42)", "6", "5"], ["(30, 18)", "4", "1"]]


def test_goals_and_endings_are_counted(folder: TrialFolder) -> None:
    made = named(folder)
    assert list(made["How runs ended"].texts()) == [["success", "6", "60%"], ["contacts", "4", "40%"]]
    assert [row[:3] for row in made["Goals reached"].texts()] == [
        ["loading zone reached", "10", "100%"],
        ["block taken", "6", "60%"],
        ["block delivered", "6", "60%"],
    ]


def test_a_goal_that_the_mission_does_not_ask_for_is_not_counted(
    folder: TrialFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Goal.TAKEN, "asked_by", "contacts")
    assert folder.configuration.mission is not None
    assert folder.configuration.mission.contacts == 0
    goals = [row[0] for row in named(folder)["Goals reached"].texts()]
    assert goals == ["loading zone reached", "block delivered"]


def test_failed_and_slowest_runs_come_with_the_command_that_replays_them(folder: TrialFolder) -> None:
    made = named(folder)
    failed, slowest = (list(made[name].objects()) for name in ("Failed runs", "Slowest successful runs"))
    assert [row["run"] for row in failed] == [1, 2, 3, 10]
    assert [row["run"] for row in slowest] == [9, 8, 7, 6, 5]
    assert "text" not in slowest[0], "numbers for programs"
    (shown, *_) = made["Slowest successful runs"].texts()
    assert shown[2] == f"{slowest[0]['distance_in']:.1f} in, {slowest[0]['commands']} commands"
    assert failed[0]["replay"] == f"simmer-tui replay {folder.path}/runs/0001.jsonl"
    console = Console(file=io.StringIO(), width=200)
    print_table(made["Failed runs"], console)
    assert isinstance(console.file, io.StringIO)
    lines = [line.strip() for line in console.file.getvalue().splitlines()]
    assert failed[0]["replay"] in lines, "on a line of its own, to be copied"


def test_page_is_whole_escaped_and_needs_nothing_else(folder: TrialFolder) -> None:
    page = html_page(trials_page(folder, {}))
    assert "Motion is instant: while a program computes, simulated time stands still." in page
    assert ">6 of 10 runs succeeded</h1>" in page
    assert "Success rate 0.600 (0.313 to 0.832). Most frequent cause: " in page
    assert "python &lt;b&gt;algo&lt;/b&gt;.py" in page
    assert "<b>" not in page
    assert page.count("<div class='picture ") == 3
    assert page.endswith("</html>\n")
    assert not any(each in page for each in ("<script", "<link", "src=", "url("))


def test_the_page_says_first_if_the_required_rate_is_reached(folder: TrialFolder) -> None:
    for required, headline, tone in ((0.5, "enough", "good"), (0.9, "too few", "bad")):
        page = html_page(trials_page(folder, {1: "runs/0001.html"}, Requirement(required)))
        assert f"6 of 10 runs succeeded: {headline}</h1>" in page
        assert f"class='verdict {tone}'" in page
        assert f", {required:g} is required." in page
    words = ("class='verdict", "class='bar'", "class='figures'", "Why runs failed", "<details>")
    places = [page.index(word, page.index("<body>")) for word in words]
    assert places == sorted(places)
    assert page.index("href='runs/0001.html'") < page.index("<details>")


def test_the_page_has_the_decision_of_the_test_that_ended_the_runs(folder: TrialFolder) -> None:
    """Six of ten runs succeed: less than 0.65, and enough for a test whose margin is large."""
    for rate, cap, headline, tone in ((0.65, 10, "enough", "good"), (0.9, 40, "not decided yet", "mixed")):
        requirement = Requirement(rate, sequential_test(rate, 0.4, 0.001, cap))
        page = html_page(trials_page(folder, {}, requirement))
        assert f"6 of 10 runs succeeded: {headline}</h1>" in page
        assert f"class='verdict {tone}'" in page
        assert f"{rate:g} is required, by a sequential test." in page


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
def test_the_first_screenful_has_the_answer(folder: TrialFolder, size: str, tmp_path: Path) -> None:
    page = tmp_path / "trials.html"
    page.write_text(html_page(trials_page(folder, {}, Requirement(0.9))), "utf-8")
    found = measured(page, size)
    width, height = SIZES[size]
    for part in (".verdict", ".bar", ".figures", "table"):
        assert found["edges"][part] <= height, part
    assert found["width"] <= width
    assert found["broken"] == []


def test_map_marks_contacts_failed_ends_and_shares_of_start_cells(folder: TrialFolder) -> None:
    root = ElementTree.fromstring(svg.figure_svg(map_figure(folder.maze(1), folder.done)))
    name = "{http://www.w3.org/2000/svg}"
    groups = list(root.iter(f"{name}g"))
    ends = [group for group in groups if group.get("fill-opacity")]
    crosses = [group for group in groups if group.get("stroke-opacity")]
    circles = [circle for end in ends for circle in end.iter(f"{name}circle")]
    assert (len(circles), [len(group) for group in crosses]) == (4, [4])
    texts = [each.text for each in root.iter(f"{name}text")]
    assert "1/4" in texts
    assert "5/6" in texts


def test_histogram_stacks_successful_and_failed_runs() -> None:
    content = histogram_figure([1.0, 1.5, 9.0], [1.0], "s").content
    labels = [each.text for each in ElementTree.fromstring(f"<svg>{content}</svg>").iter("text")]
    assert labels[:3] == ["2", "1", "1"]


def test_csv_has_a_row_a_run_and_no_formulas(
    folder: TrialFolder, made_result: Callable[..., TrialResult]
) -> None:
    folder.append(made_result(11, run_seed(1, 11), ending=Ending.EXIT, success=False, last_output="=1+1"))
    rows = list(csv.DictReader(table_csv(runs_table(folder)).splitlines()))
    assert {"time_s", "distance_in", "start_x_in", "end_heading_deg", "text", "output"} <= rows[0].keys()
    assert [row["run"] for row in rows] == [str(number) for number in range(1, 12)]
    assert [row["success"] for row in rows] == list("00011111100")
    assert rows[0]["delivered_s"] == ""
    assert (rows[3]["delivered_s"], rows[3]["log"]) == ("104.0", "runs/0004.jsonl")
    assert rows[10]["output"] == "'=1+1"


def test_runs_without_any_command_come_with_advice_unless_all_programs_failed(
    made_result: Callable[..., TrialResult],
) -> None:
    silent = made_result(1, 1, success=False, commands=0, ending=Ending.REAL_TIME_LIMIT)
    broken = made_result(2, 2, success=False, commands=0, ending=Ending.EXIT, exit_code=1)
    assert "--fixed-ports" in ports_advice([silent, broken])
    assert ports_advice([broken]) == ""
    assert ports_advice([silent, made_result(3, 3)]) == ""
