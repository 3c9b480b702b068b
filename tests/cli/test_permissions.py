"""Files and folders that the user may not read or write: one line names them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from simmer_tui.cli.main import main


def simmer(*arguments: object) -> tuple[int, str]:
    """Exit code and standard error of `simmer-tui` for a user whom permissions bind: root, too, without the
    capabilities that override them."""
    rights = "-dac_override,-dac_read_search"
    before: list[str] = []
    if os.geteuid() == 0:
        if shutil.which("setpriv") is None:
            pytest.skip("root reads everything, and there is no setpriv to take that away")
        before = ["setpriv", "--bounding-set", rights, "--inh-caps", rights]
    command = [*before, sys.executable, "-m", "simmer_tui", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode, done.stderr


@pytest.mark.slow
def test_a_set_in_a_closed_folder_is_named(tmp_path: Path) -> None:
    closed = tmp_path / "closed"
    assert main(["init", str(closed)]) == 0
    closed.chmod(0)
    assert simmer("check", closed) == (2, f"{closed}: cannot be read: Permission denied\n")


@pytest.mark.slow
def test_a_course_with_a_closed_folder_is_not_graded(tmp_path: Path) -> None:
    team = tmp_path / "course" / "team"
    team.mkdir(parents=True)
    team.chmod(0)
    code, said = simmer("grade", tmp_path / "course", "--out", tmp_path / "out", "--isolation", "none")
    assert said.count("\n") == 1
    assert said.startswith(f"simmer-tui grade: {team}")
    assert said.endswith("cannot be opened: Permission denied\n")
    assert code == 2
