"""The page of a run: what its first screenful has, and that a phone shows it whole."""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.cli.log_reports import build_report
from simmer_tui.cli.main import main
from simmer_tui.document.page_style import STYLE
from simmer_tui.document.svg import SHADES, shade
from simmer_tui.report.figure import TILES
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
    order = ("Run of 20", "Program crashed", "IndexError", "<pre>", "simulated", "class='picture maze bad'")
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
# The smallest text of a page in CSS pixels, and the texts of boxes that cut what is too wide.
SMALLEST = """(() => {
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), sizes = [];
  for (let node = walk.nextNode(); node; node = walk.nextNode()) {
    const of = node.parentElement;
    if (!node.data.trim() || of.closest("script, style, title") || !of.checkVisibility()) continue;
    sizes.push(parseFloat(getComputedStyle(of).fontSize) * (of.getScreenCTM?.().a ?? 1));
  }
  return Math.min(...sizes);
})()"""
CUT = """[...document.querySelectorAll("section, .chip, .columns > div")]
  .filter((each) => each.scrollWidth > each.clientWidth + 1).map((each) => each.textContent)"""


@pytest.mark.slow
@pytest.mark.parametrize("width", [320, 360, 390, 768, 1280, 1440])
def test_nothing_is_cut_and_every_text_can_be_read_at_any_width(width: int, tmp_path: Path) -> None:
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
        assert browser.run(SMALLEST) >= 11.0
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
        assert "deciding moment" in names


@pytest.mark.slow
@pytest.mark.parametrize("width", [390, 1280])
def test_the_time_line_has_the_moments_and_the_path_its_colours(width: int, tmp_path: Path) -> None:
    run = build_report(run_of(LOST, tmp_path, "--mission"))
    page = tmp_path / "page.html"
    page.write_text(report_page(run, "run.jsonl"), "utf-8")
    links, slider = (
        "[...document.querySelectorAll('.moments a')]",
        "document.querySelector('.timeline input')",
    )
    with tab() as browser:

        def of_each(what: str) -> list[Any]:
            found: list[Any] = browser.run(f"{links}.map((each) => {what})")
            return found

        browser.open(page.as_uri(), size=(width, 800))
        browser.wait(f"{links}.length > 0 && {links}.every((each) => each.style.left)")
        times = list(dict.fromkeys(f"{each.elapsed:.1f} s" for each in run.verdict.moments))
        assert of_each("each.textContent") == times
        (cause,) = (each for each in run.verdict.moments if each.is_cause)
        marked = of_each("each.classList.contains('cause') && each.title")
        assert [cause.text in each for each in marked if each] == [True]
        edges = of_each("[each.offsetLeft, each.offsetLeft + each.offsetWidth]")
        assert all(end <= begin for (_, end), (begin, _) in pairwise(edges))
        assert edges[0][0] >= 0
        assert edges[-1][1] <= browser.run("document.querySelector('.moments').clientWidth")
        for place, each in enumerate(times):
            browser.run(f"{links}[{place}].click()")
            browser.wait(f"Math.abs({slider}.value - {each.removesuffix(' s')}) <= 0.051")
            assert of_each("each.hasAttribute('aria-current')").index(True) == place
        browser.run(f"{slider}.value = {slider}.max, {slider}.dispatchEvent(new Event('input'))")
        # There is no later event.
        assert browser.run("document.querySelectorAll('.buttons button:disabled').length") == 1
        # The newest part of the path has the colour that the legend ends with.
        drawn = browser.run(
            "[...document.querySelectorAll('.live .trail')].filter((each) => each.getAttribute('d'))"
            ".map((each) => getComputedStyle(each).stroke)"
        )
        ends = browser.run(
            "[...document.querySelectorAll('.legend .ramp rect')].map((each) => getComputedStyle(each).fill)"
        )
        assert drawn[-1] == ends[-1] != drawn[0]


def test_colours_of_a_path_have_three_to_one_on_the_floor_in_both_looks() -> None:
    dark = float(re.findall(r"brightness\(([\d.]+)\)", STYLE)[0])
    floors = {1.0: ("#ffffff", TILES), dark: ("#0b0e13", "#1e232b")}
    for brightness, grounds in floors.items():
        for step in range(SHADES + 1):
            path = luminance(shade(step / SHADES), brightness)
            for ground in map(luminance, grounds):
                high, low = max(path, ground), min(path, ground)
                assert (high + 0.05) / (low + 0.05) >= 3.0, (step, brightness)


def luminance(colour: str, brightness: float = 1.0) -> float:
    """Relative luminance, as WCAG 2 has it."""
    parts = (min(int(colour[at : at + 2], 16) / 255 * brightness, 1.0) for at in (1, 3, 5))
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return sum(weight * part for weight, part in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


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
