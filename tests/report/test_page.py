"""The page of a run: what its first screenful has, and that a phone shows it whole."""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from simmer_tui.cli.log_commands import build_report
from simmer_tui.cli.main import main
from simmer_tui.report.page import report_page
from tests.report.browser import SIZES, measured
from tests.web.browser_tab import tab

PORTS = ("--port", "0", "--reply-port", "0", "--belief-port", "0")
CRASHING = """
from simmer_tui.client import Robot
with Robot() as robot:
    robot.drive("d1", 3)
    readings = robot.read("u1", "u2")
    robot.drive("d1", readings[5])
"""
LOST = """
from simmer_tui.client import Robot
with Robot() as robot:
    robot.believe(60, 30, 0)
    while True:
        robot.drive("d1", 9)
"""


def run_of(program: str, folder: Path, *options: str) -> Path:
    """The log of a run of a program."""
    (folder / "robot.py").write_text(program)
    log = folder / "run.jsonl"
    command = ["--no-ui", "--quiet", *PORTS, "--seed", "3", *options]
    command += ["--log", str(log), "--run", f'"{sys.executable}" robot.py']
    with contextlib.chdir(folder):
        main(command)
    return log


def test_the_page_of_a_crash_begins_with_it_and_the_last_lines(tmp_path: Path) -> None:
    text = report_page(build_report(run_of(CRASHING, tmp_path)), "run.jsonl")
    order = ("Run of 20", "Program crashed", "IndexError", "<pre>", "simulated", "class='maze bad'")
    places = [text.index(word, text.index("<body>")) for word in (*order, "<h2>Next</h2>", "<details>")]
    assert places == sorted(places)
    assert text.count("readings[5]") == 2  # once more in the whole output, folded
    assert "simmer-tui replay run.jsonl --take-over" in text


@pytest.mark.slow
def test_the_page_of_a_mission_has_its_goals_and_begins_at_the_cause(tmp_path: Path) -> None:
    run = build_report(run_of(LOST, tmp_path, "--mission"))
    text = report_page(run, "run.jsonl")
    assert ">Mission failed</h1>" in text
    assert "0 of 3</strong>" in text
    assert "✗ block taken" in text
    assert f'"moment":{round(1000 * run.verdict.elapsed)}' in text
    for each in run.verdict.moments:
        assert f"href='#t={each.elapsed:.2f}'" in text or f'href="#t={each.elapsed:.2f}"' in text
    assert "simmer-tui replay" not in report_page(run, "a team, run 3", commands=False)


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(
    ("program", "options"), [(CRASHING, ()), (LOST, ("--mission",))], ids=["crash", "lost"]
)
def test_the_first_screenful_has_the_verdict_and_the_moment(
    program: str, options: tuple[str, ...], size: str, tmp_path: Path
) -> None:
    page = tmp_path / "page.html"
    page.write_text(report_page(build_report(run_of(program, tmp_path, *options)), "run.jsonl"), "utf-8")
    found = measured(page, size)
    width, height = SIZES[size]
    for part in (".verdict", ".figures", ".maze svg", ".timeline"):
        assert found["edges"][part] <= height, part
    assert found["width"] <= width
    assert found["broken"] == []


SPOKEN = """
from simmer_tui.client import Robot
with Robot() as robot:
    robot.drive("r1", -120)  # a heading of three digits
    for _ in range(4):
        robot.read("u1", "c1", "o3")
        robot.drive("d1", 2)
"""
# Of each text in a picture, its height in CSS pixels; of each box that cuts what is too wide, its class.
SMALLEST = """Math.min(...[...document.querySelectorAll("NAME text")].map((each) =>
  parseFloat(getComputedStyle(each).fontSize) * each.getScreenCTM().a))"""
CUT = """[...document.querySelectorAll("section, .chip, .columns > div")]
  .filter((each) => each.scrollWidth > each.clientWidth + 1).map((each) => each.textContent)"""


@pytest.mark.slow
@pytest.mark.parametrize("width", [320, 360, 768, 1280])
def test_nothing_is_cut_and_curves_can_be_read_at_any_width(width: int, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    run = build_report(run_of(SPOKEN, tmp_path, "--seed", str(2**127)))
    page.write_text(report_page(run, "a team, run 3", commands=False), "utf-8")
    with tab() as browser:
        browser.open(page.as_uri(), size=(width, 800))
        browser.wait("document.readyState === 'complete'")
        browser.run("document.querySelectorAll('details').forEach((each) => (each.open = true))")
        assert browser.run("document.documentElement.scrollWidth") <= width
        assert width < 360 or browser.run(CUT) == []
        assert browser.run("document.querySelector('.chip').title") == "ultra1, in"
        assert browser.run(SMALLEST.replace("NAME", ".strips")) >= 6.0
        assert browser.run("document.querySelector('.maze svg').clientWidth") >= 0.6 * min(width, 1120)
        assert browser.told == []
        assert browser.requests == [page.as_uri()]


@pytest.mark.slow
def test_space_opens_a_fold_and_presses_the_button_that_has_the_focus(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text(report_page(build_report(run_of(SPOKEN, tmp_path)), "run.jsonl"), "utf-8")
    playing = "document.querySelector('.play').textContent.includes('Pause')"
    with tab() as browser:
        browser.open(page.as_uri())
        browser.wait("Boolean(document.querySelector('.keys summary'))")
        browser.run("document.querySelector('.keys summary').focus()")
        browser.key(" ", " ")
        browser.wait("document.querySelector('.keys').open")
        assert not browser.run(playing)
        browser.run("document.querySelector('.play').focus()")
        browser.key(" ", " ")
        browser.wait(playing)
        browser.run("document.activeElement.blur()")
        browser.key(" ", " ")
        browser.wait(f"!{playing}")
        all_controls = "[...document.querySelectorAll('.buttons button, .buttons select')]"
        names = browser.run(f"{all_controls}.map((each) => each.ariaLabel || each.textContent)")
        assert "playback rate" in names
        assert all(any(map(str.isalpha, name)) for name in names)


@pytest.mark.slow
def test_paper_has_a_large_picture_and_nothing_about_the_player(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text(report_page(build_report(run_of(LOST, tmp_path, "--mission")), "run.jsonl"), "utf-8")
    size = "parseFloat(getComputedStyle(document.querySelector('NAME')).fontSize)"
    with tab() as browser:
        browser.open(page.as_uri(), size=(718, 1000))  # A4 without its margins
        browser.call("Emulation.setEmulatedMedia", media="print")
        browser.wait("document.readyState === 'complete'")
        assert not browser.run("document.querySelector('.begins').checkVisibility()")
        assert browser.run("document.querySelector('.maze svg').clientWidth") > 600
        assert browser.run(size.replace("NAME", "details li")) == browser.run(size.replace("NAME", "td"))


def test_a_run_without_a_mission_has_no_time_left_though_its_set_has_one(tmp_path: Path) -> None:
    run = build_report(run_of(SPOKEN, tmp_path, "--config", "mission"))
    assert run.task is None
    assert '"limit":null' in (text := report_page(run, "run.jsonl"))
    assert text.count(">Sensors over time<") == 1, "the page names each part once"


@pytest.mark.slow
def test_a_tall_maze_leaves_room_for_the_clock(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-m", "simmer_tui", "init", "tall"], cwd=tmp_path, check=True)
    (tmp_path / "tall" / "maze.csv").write_text("2,1\n" + "1,1\n" * 8 + "3,1\n")
    settings = tmp_path / "tall" / "settings.toml"
    places = {"bot_center": "[6, 114]", "block_center": "[6, 6]"}
    for key, place in places.items():
        settings.write_text(re.sub(rf"(?m)^{key} = .*", f"{key} = {place}", settings.read_text()))
    page = tmp_path / "page.html"
    page.write_text(
        report_page(build_report(run_of(SPOKEN, tmp_path, "--config", "tall")), "run.jsonl"), "utf-8"
    )
    for size, (_, height) in SIZES.items():
        assert measured(page, size)["edges"][".timeline"] <= height


@pytest.mark.slow
def test_the_page_is_written_although_nobody_reads_the_answer_to_its_end(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "simmer_tui",
        "report",
        str(run_of(SPOKEN, tmp_path)),
        "--html",
        "run.html",
    ]
    read, write = os.pipe()
    os.close(read)
    subprocess.run(command, cwd=tmp_path, stdout=write, check=False)
    os.close(write)
    assert (tmp_path / "run.html").exists()
