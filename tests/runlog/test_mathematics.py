"""Logs of machines whose sines differ in their last bits."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from simmer_tui.cli.rerun_command import run_rerun
from simmer_tui.sim.fingerprint import math_fingerprint

# Takes from glibc what its sines are made with on most machines.
_WITHOUT = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F"}
_FINGERPRINT = "from simmer_tui.sim.fingerprint import math_fingerprint as f; print(f())"
# Headings, in steps of a hundredth of a degree, and the cosines and sines that the machine has of them.
_SINES = """
import json, math
angles = [math.radians(step * 0.01) for step in range(1, 9000)]
print(json.dumps([(math.cos(angle), math.sin(angle)) for angle in angles]))
"""
_RUN = """
import sys
from pathlib import Path
from simmer_tui.config.loader import Override, load
from simmer_tui.config.sets import find_set
from simmer_tui.robot.engine import Engine
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Simulator, parse_command

overrides = {"bot_rot": Override("--bot-rot", sys.argv[2]), "randbias": Override("--no-randbias", "false")}
configuration = load(find_set(None), overrides)
simulator = Simulator(configuration.simulation, 5)
simulator.noise = False
simulator.advance(1000.3)
with RunLog(Path(sys.argv[1]), configuration, simulator) as log:
    engine = Engine(simulator)
    engine.watch(log)
    session = engine.session()
    for step in range(40):
        for text in ("u1", "u2", "u3", "u4", "d1-0.013"):
            session.submit(parse_command(text), lambda outcome: None)
"""


def other_machine(*arguments: str) -> str:
    """Output of Python on a machine without these instructions."""
    done = subprocess.run(
        [sys.executable, "-c", *arguments],
        env={**os.environ, **_WITHOUT},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


def edit(path: Path, line: int, **changes: object) -> None:
    lines = path.read_text().splitlines()
    lines[line - 1] = json.dumps({**json.loads(lines[line - 1]), **changes})
    path.write_text("\n".join(lines) + "\n")


def test_the_fingerprint_is_that_of_the_machine(varied_log: Path) -> None:
    found = math_fingerprint()
    assert len(found) == 16
    assert int(found, 16) >= 0
    assert json.loads(varied_log.read_text().splitlines()[0])["mathematics"] == found


@pytest.mark.slow
@pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() != "x86_64" or platform.libc_ver()[0] != "glibc",
    reason="what is taken away is named for glibc on x86-64",
)
def test_a_log_of_another_machine_is_compared_but_for_rounding(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    there = other_machine(_FINGERPRINT)
    if there == math_fingerprint():
        pytest.skip("this processor has neither FMA nor AVX2")
    path = tmp_path / "run.jsonl"
    # The robot faces where the two machines' cosines differ; ranges to walls go with their inverse.
    here = json.loads(
        subprocess.run([sys.executable, "-c", _SINES], capture_output=True, text=True, check=True).stdout
    )
    pairs = zip(here, json.loads(other_machine(_SINES)), strict=True)
    step = next(step for step, (ours, theirs) in enumerate(pairs, 1) if ours != theirs)
    other_machine(_RUN, str(path), repr(step * 0.01))
    assert run_rerun([str(path)]) == 0
    said = capsys.readouterr()
    assert "every reply the same but for rounding" in said.out
    assert f"({there}, here {math_fingerprint()})" in said.err
    # The same log taken for one of this machine differs: the sines really do.
    edit(path, 1, mathematics=math_fingerprint())
    assert run_rerun([str(path)]) == 1


@pytest.mark.parametrize(("off", "code"), [(1e-12, 0), (-1e-12, 0), (1e-6, 1)])
def test_only_what_is_off_by_more_than_rounding_differs(
    varied_log: Path, capsys: pytest.CaptureFixture[str], off: float, code: int
) -> None:
    pose = json.loads(varied_log.read_text().splitlines()[10])["pose"]
    edit(varied_log, 11, pose=[pose[0] + off, *pose[1:]])
    assert run_rerun([str(varied_log)]) == 1
    edit(varied_log, 1, mathematics="0123456789abcdef")
    capsys.readouterr()
    assert run_rerun([str(varied_log)]) == code
    out = capsys.readouterr().out
    assert ("line 11, command 'd1-3': pose is" in out) == bool(code)
    assert ("from there on the runs differ" in out) == bool(code)


def test_what_is_no_number_must_be_the_same(varied_log: Path) -> None:
    edit(varied_log, 1, mathematics="0123456789abcdef")
    assert run_rerun([str(varied_log)]) == 0
    edit(varied_log, 12, status="busy")
    assert run_rerun([str(varied_log)]) == 1


def test_a_log_that_does_not_say_is_compared_to_the_last_bit(varied_log: Path) -> None:
    edit(varied_log, 1, mathematics="")
    assert run_rerun([str(varied_log)]) == 0
