"""Programs of five teams, each with its robot's own language, unchanged beside the simulator.

README.md beside it says what goes over their wires. Programs and dialects were written from the
documentation alone, and so was what `referee.py` expects of them.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from simmer_tui.config.sets import bundled_folder, init_set
from tests.dialect.teams.referee import judge, same_but_for_real_time

HERE = Path(__file__).parent
SECONDS = {"lines": 300, "brackets": 300, "letters": 300, "stream": 30, "frames": 60}
"""Simulated time of each run, seconds; the last two have a hundred times as many messages."""
LEAST = {"lines": 100, "brackets": 500, "letters": 200, "stream": 1000, "frames": 300}
"""Least number of replies compared with readings, or of lines and frames compared with rays: where the robot
is within a movement of known length the referee cannot tell, and a scan looks a third of a second back."""


def simmer(*arguments: str | Path, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "simmer_tui", *map(str, arguments)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=900, check=False)


def run_team(name: str, folder: Path, seconds: int, clock: str, run: str = "a", seed: int = 1) -> Path:
    """The log of a team's program beside its own robot; its notes are beside it."""
    if not (folder / "robot").exists():
        init_set(folder / "robot", bundled_folder())
        shutil.copy(HERE / f"{name}.toml", folder / "robot" / "dialect.toml")
        if (HERE / f"{name}.csv").exists():
            shutil.copy(HERE / f"{name}.csv", folder / "robot" / "sensors.csv")
    log = folder / f"{run}.jsonl"
    program = f'"{sys.executable}" "{HERE / name}.py" {seconds} {run}.notes'
    options = (
        "--no-ui",
        "--belief-port",
        "0",
        "--clock",
        clock,
        "--seed",
        str(seed),
        "--log",
        log.name,
        "--run",
        program,
    )
    told = simmer("--config", "robot", *options, folder=folder)
    assert told.returncode == 0, told.stdout + told.stderr
    return log


def assert_right(name: str, log: Path, least: int) -> None:
    judgement = judge(name, log, log.with_suffix(".notes"), log.parent / "robot")
    assert not judgement.wrong, judgement.wrong[:5]
    kinds = ("replies by readings", "truth by rays", "angles in order")
    compared = sum(judgement.counts.get(kind, 0) for kind in kinds)
    assert compared >= least, judgement.counts


def test_a_team_that_sends_lines(tmp_path: Path) -> None:
    assert_right("lines", run_team("lines", tmp_path, 30, "program"), 10)


@pytest.mark.slow
@pytest.mark.parametrize("name", SECONDS)
def test_every_exchange_is_right_by_the_programs_clock(name: str, tmp_path: Path) -> None:
    log = run_team(name, tmp_path, SECONDS[name], "program")
    assert_right(name, log, LEAST[name])
    again = simmer("rerun", log, folder=tmp_path)
    assert again.returncode == 0, again.stdout


@pytest.mark.slow
@pytest.mark.parametrize("name", SECONDS)
def test_the_same_seed_gives_the_same_log(name: str, tmp_path: Path) -> None:
    one, other = (run_team(name, tmp_path, SECONDS[name], "program", run) for run in "ab")
    assert list(same_but_for_real_time(one, other)) == []
    assert one.with_suffix(".notes").read_bytes() == other.with_suffix(".notes").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("name", SECONDS)
def test_every_exchange_is_right_under_the_real_clock(name: str, tmp_path: Path) -> None:
    log = run_team(name, tmp_path, 20, "real")
    assert_right(name, log, 1)
    again = simmer("rerun", log, folder=tmp_path)
    assert again.returncode == 0, again.stdout
