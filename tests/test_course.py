"""The course's suggestions work: every command with the rate it names, and every "Try" without a crash.

A "Try" is a change of a program, or options of the simulator. Each is made here as a student would make
it, and the program runs to its end: it may fail, but it ends by itself and says so.
"""

from __future__ import annotations

import math
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from simmer_tui.cli.log_commands import build_report

ROOT = Path(__file__).parents[1]
COURSE = ROOT / "scripts" / "course"
TEXT = (ROOT / "docs" / "course.md").read_text("utf-8")
RATED = re.findall(r"^simmer-tui trials (.*--require .*)$", TEXT, re.M)
ANY_PORTS = ("--port", "0", "--reply-port", "0", "--belief-port", "0")
MISSION = ("--mission",)
MOST_RUNS = 20
STEPS = {path.name.partition("_")[0].removeprefix("step"): path.name for path in COURSE.glob("step*.py")}


@dataclass(frozen=True)
class Try:
    """A suggestion: of which step, what is changed in its program, and with which options it runs. `error` is
    how it ends where that is what there is to see."""

    step: str
    name: str
    changes: Mapping[str, str] = field(default_factory=dict)
    options: Sequence[str] = ()
    error: str = ""


RIGHT_WALL = {
    '"u1", "u2", "u4"': '"u1", "u4", "u2"',
    'LEFT, RIGHT, ON = ("r1", 90.0), ("r1", -90.0)': 'LEFT, RIGHT, ON = ("r1", -90.0), ("r1", 90.0)',
    "round(turn, 1)": "round(-turn, 1)",
}
COMMANDS_BELIEVED = {
    "pose.add(odometry.motion())": "pose.add(Motion(value, 0, 0) if code == 'd1' else Motion(0, 0, value))"
}
TRIES = (
    Try("1", "the whole way at once", {"(ahead - GOAL) / 2": "ahead - GOAL"}),
    Try("1", "a near goal", {"GOAL = 24.0": "GOAL = 4.0"}),
    Try("2", "u2 as if it looked straight left", {"seen * math.cos(math.radians(45))": "seen"}),
    Try("2", "the right wall", RIGHT_WALL),
    Try("3", "ten rounds", {"rounds=2": "rounds=10"}),
    Try("3", "the commands, not the counters", COMMANDS_BELIEVED),
    Try("3b", "four times as fast", {"SPEED, SLOW = 4.0": "SPEED, SLOW = 16.0"}),
    Try("3b", "four times as much steering", {"STEER, SHARPEST = 13.0": "STEER, SHARPEST = 52.0"}),
    Try("3b", "no way back after a turn", {" or self.left > OPEN": ""}),
    Try("4", "another start", {}, ("--bot-center", "66,42")),
    Try("4", "a third start", {}, ("--bot-center", "90,6")),
    Try("4", "fewer particles", {"MANY, FEW = 8000, 800": "MANY, FEW = 500, 100"}),
    Try("4", "little blur", {"BLUR = 0.4": "BLUR = 0.05"}),
    Try("4b", "a coarse grid", {"STEP, HEADINGS = 2.0, 36": "STEP, HEADINGS = 6.0, 8"}),
    Try("4b", "little blur", {"BLUR = 1.0": "BLUR = 0.2"}),
    Try("4b", "no outliers", {"OUTLIER = 0.02": "OUTLIER = 1e-6"}),
    Try("5", "long strides", {"STRIDE = 4.0": "STRIDE = 12.0"}),
    Try("5", "no way sideways", {}, ("--drive-profile", "diff-dc"), "the code w1 is disabled"),
    Try("6", "a coarse search", {"[7.5] * 48": "[15.0] * 24"}, ("--config", "mission")),
    Try("6", "one look", {"range(2 if": "range(1 if"}, ("--config", "mission")),
    Try("7", "realistic", {}, (*MISSION, "--realistic")),
    Try("7", "strong bias", {}, (*MISSION, "--strength", "0.1,1")),
)


def simmer_tui(arguments: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """A run of the command line to its end."""
    return subprocess.run(
        [sys.executable, "-m", "simmer_tui", *arguments],
        cwd=folder, capture_output=True, text=True, check=False, timeout=1100,
    )  # fmt: skip


def test_each_step_has_something_to_try() -> None:
    sections = re.split(r"^## (?=\d)", TEXT, flags=re.M)[1:]
    assert [section.count("**Try:**") for section in sections] == [1] * len(STEPS)
    assert {each.step for each in TRIES} == set(STEPS)


def tried(each: Try, folder: Path) -> subprocess.CompletedProcess[str]:
    """A changed step of the course, run to its end."""
    shutil.copytree(COURSE, folder / "course")
    program = folder / "course" / STEPS[each.step]
    text = program.read_text("utf-8")
    for before, after in each.changes.items():
        assert before in text
        text = text.replace(before, after)
    program.write_text(text, "utf-8")
    run = ["--run", f'"{sys.executable}" "{program}"']
    return simmer_tui(["--no-ui", *ANY_PORTS, "--seed", "1", *each.options, *run], folder)


@pytest.mark.slow
def test_a_robot_that_refuses_velocities_does_not_keep_going_for_ever(tmp_path: Path) -> None:
    ended = tried(Try("3b", "", {'f"vv-{speed': 'f"vq-{speed'}), tmp_path)
    assert "the robot refuses velocities" in ended.stderr
    assert ended.returncode == 1


@pytest.mark.slow
@pytest.mark.parametrize("each", TRIES, ids=lambda each: f"{each.step} {each.name}")
def test_what_is_to_be_tried_runs(each: Try, tmp_path: Path) -> None:
    ended = tried(each, tmp_path)
    assert ended.returncode in (0, 1), ended.stderr[-2000:]
    crashed = "Traceback" in ended.stderr
    assert crashed == bool(each.error), ended.stderr[-2000:]
    assert each.error in ended.stderr


@pytest.mark.slow
@pytest.mark.parametrize("arguments", RATED, ids=lambda text: re.findall(r"step\d+\w?(?=_)", text)[0])
def test_a_step_has_the_success_rate_that_it_is_asked_for(arguments: str, tmp_path: Path) -> None:
    """The literal command with one seed, and with no more runs than take a minute."""
    assert simmer_tui(["examples", "samples"], tmp_path).returncode == 0
    if "--config fetch" in arguments:
        assert simmer_tui(["init", "fetch", "--mission"], tmp_path).returncode == 0
        (tmp_path / "fetch" / "mission.toml").unlink()
    given = [each.replace("python ", f"{sys.executable} ") for each in shlex.split(arguments)]
    at = given.index("--runs") + 1
    given[at] = str(min(int(given[at]), MOST_RUNS))
    ended = simmer_tui(["trials", "--seed", "1", *given], tmp_path)
    assert ended.returncode == 0, ended.stdout[:3000] + ended.stderr[-1000:]


@pytest.mark.slow
def test_the_robot_that_keeps_going_touches_nothing_and_is_back_at_its_start(tmp_path: Path) -> None:
    program = COURSE / STEPS["3b"]
    options = ["--no-ui", *ANY_PORTS, "--seed", "1", "--log", "run.jsonl"]
    ended = simmer_tui([*options, "--run", f'"{sys.executable}" "{program}"'], tmp_path)
    assert ended.returncode == 0, ended.stdout[-2000:]
    assert "contact:" not in ended.stdout + ended.stderr
    history = build_report(tmp_path / "run.jsonl").history
    poses = [(row.x, row.y) for row in history.readings]
    assert math.dist(poses[0], poses[-1]) <= 6.0
    assert max(x for x, _ in poses) > 84.0, "it has been at the far end of the maze"


@pytest.mark.slow
def test_the_histogram_filter_is_right_about_where_the_robot_is(tmp_path: Path) -> None:
    """Its exit code says that it is sure; the log says whether it is right."""
    right = 0
    for seed in range(20):
        log = tmp_path / f"{seed}.jsonl"
        options = ["--no-ui", *ANY_PORTS, "--seed", str(seed), "--log", str(log)]
        ended = simmer_tui([*options, "--run", f'"{sys.executable}" "{COURSE / STEPS["4b"]}"'], tmp_path)
        belief = build_report(log).history.beliefs[-1]
        aside = abs(math.remainder(belief.heading - belief.true_heading, 360.0))
        near = math.hypot(belief.x - belief.true_x, belief.y - belief.true_y) < 3.0
        right += ended.returncode == 0 and near and aside < 15.0
    assert right >= 18, right
