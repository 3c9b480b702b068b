"""The page of a run: what its first screenful has, and that a phone shows it whole."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from simmer_tui.cli.log_commands import build_report
from simmer_tui.report.page import report_page
from tests.report.browser import SIZES, measured

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
    command = [sys.executable, "-m", "simmer_tui", "--no-ui", "--quiet", *PORTS, "--seed", "3", *options]
    command += ["--log", str(log), "--run", f'"{sys.executable}" robot.py']
    subprocess.run(command, cwd=folder, check=False, capture_output=True, timeout=300)
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
