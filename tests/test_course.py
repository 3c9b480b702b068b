"""The course's suggestions work: every command with the rate it names, every "Try" with the result it names.

A "Try" is a change of a program, or options of the simulator. Each is taken from the page, made as a student
would make it, and run as often and with the seeds that the page names.
"""

from __future__ import annotations

import ast
import itertools
import json
import math
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.cli.log_reports import build_report

ROOT = Path(__file__).parents[1]
COURSE = ROOT / "scripts" / "course"
TEXT = "\n".join((ROOT / "docs" / name).read_text("utf-8") for name in ("course.md", "course-extras.md"))
RATED = re.findall(r"^simmer-tui trials (.*--require .*)$", TEXT, re.M)
ANY_PORTS = ("--port", "0", "--reply-port", "0", "--belief-port", "0")
MOST_RUNS = 20
FILES = sorted(path.name for path in COURSE.glob("step*.py"))
STEPS = {name.partition("_")[0].removeprefix("step"): name for name in FILES}
INTRODUCTION, *PARTS = re.split(r"^## (?=\d)", TEXT, flags=re.M)
SECTIONS = {part.partition(".")[0]: part.partition("**Try:**")[2] for part in PARTS}
RATE = re.compile(r"(\d+) of (\d+) runs succeed")
PLACE = re.compile(r"at \(([-.\d]+), ([-.\d]+)\) heading ([-.\d]+)")


@dataclass(frozen=True)
class Try:
    """A suggestion of the page: new lines, (before, after) of parts of lines, options, and what it claims."""

    lines: Sequence[str]
    parts: Sequence[tuple[str, str]]
    options: Sequence[str]
    runs: Sequence[str]
    claim: str

    def change(self, text: str) -> str:
        """A program as a student changes it: a line in place of the one that begins with the same name."""
        for line in self.lines:
            name = line.partition(" = ")[0]
            text, count = re.subn(rf"^{name} = .*$", line.replace("\\", r"\\"), text, flags=re.M)
            assert count == 1, line
        for before, after in self.parts:
            assert before in text, before
            text = text.replace(before, after)
        return text


def suggestions(step: str) -> list[Try]:
    """All suggestions of a step, in the order of the page."""
    section = SECTIONS[step].replace("\n  ", " ")
    introduction, _, bullets = section.partition("\n- ")
    named = [
        re.findall(r"`(?:simmer-tui trials )?(--runs [^`]*)`", text) for text in (introduction, INTRODUCTION)
    ]
    default = next(text for texts in named for text in texts)
    found = []
    for bullet in re.findall(r"^- (.*)$", "- " + bullets, re.M):
        cut = re.match(r"(.*?[`)]): (.*)", bullet)
        assert cut is not None, bullet
        head, claim = cut.groups()
        runs = re.search(r" \(`(--runs [^`]*)`\)$", head)
        head = head[: runs.start()] if runs else head
        parts = re.findall(r"`([^`]*)` in place of `([^`]*)`", head)
        rest = re.findall(r"`([^`]*)`", re.sub(r"`[^`]*` in place of `[^`]*`", "", head))
        found.append(
            Try(
                lines=[text for text in rest if not text.startswith("--")],
                parts=[(before, after) for after, before in parts],
                options=[word for text in rest if text.startswith("--") for word in shlex.split(text)],
                runs=shlex.split(runs[1] if runs else default),
                claim=claim,
            )
        )
    return found


def simmer_tui(arguments: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """A run of the command line to its end."""
    return subprocess.run(
        [sys.executable, "-m", "simmer_tui", *arguments],
        cwd=folder, capture_output=True, text=True, check=False, timeout=1100,
    )  # fmt: skip


def test_each_suggestion_changes_a_program_and_has_a_claim() -> None:
    for step, name in STEPS.items():
        program = (COURSE / name).read_text("utf-8")
        for statement in ast.parse(program).body:  # a line of the page can then replace a line of the file
            if isinstance(statement, ast.Assign):
                assert isinstance(statement.targets[0], ast.Name), f"{name}:{statement.lineno}"
        assert suggestions(step), step
        for each in suggestions(step):
            changed = each.change(program)
            compile(changed, name, "exec")
            assert changed != program or each.options, each
            assert RATE.search(each.claim), each.claim


def changed_step(step: str, each: Try, folder: Path) -> Path:
    """A step as a student changes it, in a copy of the course."""
    shutil.copytree(COURSE, folder / "course", dirs_exist_ok=True)
    program = folder / "course" / STEPS[step]
    program.write_text(each.change((COURSE / STEPS[step]).read_text("utf-8")), "utf-8")
    return program


def set_of(step: str, folder: Path) -> list[str]:
    """Options of the trials that the page runs in this step, after making their set; without the rate."""
    if step == "6" and not (folder / "fetch").exists():
        assert simmer_tui(["init", "fetch", "--mission"], folder).returncode == 0
        (folder / "fetch" / "mission.toml").unlink()
    (arguments,) = (shlex.split(text) for text in RATED if STEPS[step] in text)
    pairs = itertools.pairwise(arguments)
    return [word for pair in pairs if pair[0] in ("--config", "--vary") for word in pair]


def tried(step: str, each: Try, folder: Path) -> list[dict[str, Any]]:
    """The runs of trials of a changed step."""
    program = changed_step(step, each, folder)
    out = f"results{len(list(folder.glob('results*')))}"
    given = [*set_of(step, folder), *each.runs, *each.options, "--json", "--time-limit", "600", "--out", out]
    ended = simmer_tui(["trials", *given, "--run", f'"{sys.executable}" "{program}"'], folder)
    assert ended.returncode == 0, ended.stderr[-2000:]
    runs: list[dict[str, Any]] = json.loads(ended.stdout)["runs"]
    return runs


def is_right(run: dict[str, Any]) -> bool:
    """True if the pose that the program printed is that of the robot."""
    found = PLACE.search(run["output"])
    assert found is not None, run["output"]
    x, y, heading = map(float, found.groups())
    aside = abs(math.remainder(heading - run["end_heading_deg"], 360.0))
    return math.hypot(x - run["end_x_in"], y - run["end_y_in"]) < 3.0 and aside < 15.0


def mean(values: Iterable[float]) -> float:
    numbers = list(values)
    return sum(numbers) / len(numbers)


def off(run: dict[str, Any]) -> float:
    """Distance by which dead reckoning is off, as step 3 prints it, inches."""
    return abs(float(run["output"].partition("is off by ")[2].split()[0]))


def nearest(run: dict[str, Any]) -> float:
    """The nearest reading, as step 3b prints it, inches."""
    return float(run["output"].partition("nearest ")[2].split()[0])


@pytest.mark.slow
@pytest.mark.parametrize("step", STEPS)
def test_what_the_page_says_about_a_change_is_so(step: str, tmp_path: Path) -> None:
    unchanged: dict[str, list[dict[str, Any]]] = {}
    for each in suggestions(step):
        claim, runs = each.claim, tried(step, each, tmp_path)
        assert not any("Traceback" in (run["output"] or "") for run in runs), claim
        succeeded = sum(run["success"] for run in runs)
        assert (succeeded, len(runs)) == tuple(map(int, RATE.findall(claim)[0])), claim
        if found := re.search(r"(\d+) touch(?:es)? a wall", claim):
            assert sum(run["contacts"] > 0 for run in runs) == int(found[1]), claim
        if found := re.search(r"right in (\d+) of (\d+)", claim):
            assert (sum(map(is_right, runs)), len(runs)) == (int(found[1]), int(found[2])), claim
        if found := re.search(r": `([^`]*)`\.", claim):
            assert all(found[1] in run["output"] for run in runs), claim
        for pattern, measure, error in COMPARED:
            if found := re.search(pattern, claim):
                key = shlex.join(each.runs)
                if key not in unchanged:
                    unchanged[key] = tried(step, Try([], [], [], each.runs, ""), tmp_path)
                new, old = (mean(map(measure, measured)) for measured in (runs, unchanged[key]))
                assert new == pytest.approx(float(found[1]), abs=error), claim
                assert old == pytest.approx(float(found[2]), abs=error), claim


COMPARED: Sequence[tuple[str, Callable[[dict[str, Any]], float], float]] = (
    (r"take (\d+) commands on average, not (\d+)", lambda run: float(run["commands"]), 0.51),
    (r"off by ([\d.]+) in on average, not by ([\d.]+) in", off, 0.051),
    (r"nearest reading is ([\d.]+) in, not ([\d.]+) in", nearest, 0.0051),
)
"""Claims about a change and the unchanged program: both numbers, the measure, the error of rounding."""


@pytest.mark.slow
def test_a_robot_that_refuses_velocities_does_not_keep_going_for_ever(tmp_path: Path) -> None:
    program = changed_step("3b", Try([], [('f"vv-{speed', 'f"vq-{speed')], [], [], ""), tmp_path)
    ended = simmer_tui(["--no-ui", *ANY_PORTS, "--run", f'"{sys.executable}" "{program}"'], tmp_path)
    assert "the robot refuses velocities" in ended.stderr
    assert ended.returncode == 1


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
