"""Grading in containers of a real engine, where there is one.

The image is the default one, or that of SIMMER_TEST_IMAGE; it has to be there already. Without engine or
image these tests are skipped: CI has neither. What is asked of an engine is in test_sandboxes.py.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pytest

from simmer_tui.cli.grade_command import run_grade
from simmer_tui.errors import ProgramError
from simmer_tui.grade.container import Container, what_is_missing
from simmer_tui.grade.limits import Limits
from simmer_tui.program.program_output import ProgramOutput
from tests.grade.conftest import HIT, SOLVE, read_grades

IMAGE = os.environ.get("SIMMER_TEST_IMAGE", "")
CONFINED = """
import os, pathlib, socket, sys
def refused(attempt):
    try:
        attempt()
    except OSError:
        return
    sys.exit("not confined")
assert os.getuid() == 65534
refused(lambda: socket.create_connection(("1.1.1.1", 80), 1))
refused(lambda: pathlib.Path("/usr/here").write_text(""))
refused(lambda: pathlib.Path("/program/main.py").write_text(""))
pathlib.Path("mine").write_text("a copy of its own")
pathlib.Path("/tmp/scratch").write_text("")
"""
HUNGRY = "kept = []\nwhile True:\n    kept.append(bytearray(10_000_000))\n"


class OrderedContainer(Container):
    """A container that is not begun: its order ends it."""

    def _open(self) -> subprocess.Popen[bytes]:
        ended = subprocess.Popen([sys.executable, "-c", ""])
        ended.wait()
        return ended

    def _begin(
        self, name: str, words: Sequence[str], environment: Mapping[str, str], files: str, home: str
    ) -> list[socket.socket]:
        raise ProgramError(" ".join(words))


def test_a_container_runs_its_own_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """That of this machine has another path, which would be no program there."""
    monkeypatch.setenv("PATH", "")
    container = OrderedContainer("docker", "", tmp_path, Limits())
    with pytest.raises(ProgramError, match=r"^/usr/local/bin/python3 -u main\.py$"):
        container.start("python3 -u main.py", {}, lambda code: None, lambda line: None, ProgramOutput())


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["docker", "podman"])
def test_programs_are_graded_in_containers(
    engine: str, make_course: Callable[..., Path], tmp_path: Path
) -> None:
    if missing := what_is_missing(engine, IMAGE):
        pytest.skip(missing)
    limits = "[limits]\ntime = 10.0\nmemory = 200.0\n"
    image = f'image = "{IMAGE}"\n' if IMAGE else ""
    file = make_course(
        {"confined": CONFINED + SOLVE, "hungry": HUNGRY, "wall": HIT},
        f"{image}[decide]\nrequire = 0.9\nmargin = 0.5\n{limits}",
    )
    out = tmp_path / "out"
    assert run_grade([str(file), "--isolation", engine, "--seed", "3", "--out", str(out)]) == 1
    rows = read_grades(out)
    assert {team: row["status"] for team, row in rows.items()} == {
        "confined": "passed", "hungry": "failed", "wall": "failed",
    }  # fmt: skip
    assert "MemoryError" in rows["hungry"]["main_cause"]
    assert rows["wall"]["main_cause"] == "1 contact with a wall, 0 allowed"
