"""A full disk, as `/dev/full`: one line with the reason, never a traceback or another error."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests import in_process

FULL = Path("/dev/full")
pytestmark = pytest.mark.skipif(not FULL.exists(), reason="no /dev/full")
NO_SPACE = "No space left on device"
CLIENT = """
from simmer_tui.client import Robot
with Robot() as robot:
    for number in range(3):
        print(number, robot.read("u1"), flush=True)
"""


def simmer(*arguments: str, unbuffered: bool = False) -> subprocess.CompletedProcess[str]:
    """`simmer-tui` with a standard output that is always full."""
    environment = {**os.environ, "PYTHONUNBUFFERED": "1" if unbuffered else ""}
    with FULL.open("w") as full:
        return subprocess.run(
            [sys.executable, "-m", "simmer_tui", *arguments],
            stdout=full, stderr=subprocess.PIPE, env=environment, text=True, check=False,
        )  # fmt: skip


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ("arguments", "unbuffered"),
    [
        (["check", "default"], False),
        (["--version"], False),
        (["check", "default"], True),
        (["check", "default", "--json"], False),
        (["--help"], False),
    ],
)
def test_an_answer_that_cannot_be_written_is_one_line(arguments: list[str], unbuffered: bool) -> None:
    done = simmer(*arguments, unbuffered=unbuffered)
    assert done.stderr == f"simmer-tui: the answer cannot be written: {NO_SPACE}\n"
    assert done.returncode == 2


def test_a_program_runs_on_without_its_output_and_the_reason_is_told(tmp_path: Path) -> None:
    (tmp_path / "client.py").write_text(CLIENT)
    with FULL.open("w") as full:
        program = f"{sys.executable} {tmp_path / 'client.py'}"
        done = in_process.simmer("--no-ui", "--port", "0", "--run", program, stdout=full.fileno())
    # As it happens, and among the moments of the run.
    assert done.stderr.count(f"the program's output cannot be passed on: {NO_SPACE}") == 2
    assert "disconnected after 3 commands" in done.stderr
    assert "Broken" not in done.stderr
    assert done.returncode == 0


LIMITED = """
import resource, sys
from simmer_tui.cli.main import main
resource.setrlimit(resource.RLIMIT_FSIZE, (600, 600))
sys.exit(main(["init", sys.argv[1]]))
"""


@pytest.mark.slow
def test_no_half_of_a_set_stays_behind(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, folder], capture_output=True, text=True, check=False
    )
    assert done.stderr == f"{folder}: cannot be written: File too large\n"
    assert [*folder.iterdir()] == []
