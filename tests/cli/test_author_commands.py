"""The sample programs, copied out and run."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from simmer_tui.cli.main import main


def test_the_sample_programs_are_copied_and_nothing_is_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "mine"
    assert main(["examples", str(folder)]) == 0
    said = capsys.readouterr().out
    assert f"python {folder / 'wander.py'}" in said
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert {"wander.py", "course/step1_first_command.py", "c/wander.c", "matlab/wander.m"} <= names
    assert {"arduino/simmer_robot/simmer_robot.ino", "arduino/simmer_robot/README.md"} <= names
    assert {"course/step4b_histogram.py", "arduino/histogram_filter/histogram.h"} <= names
    assert {"client.py", "solve.py", "solve_way.py", "robot_emulator.py", "c/simmer.h"} <= names
    (folder / "c" / "simmer.h").unlink()
    assert main(["examples", str(folder)]) == 0
    assert "1 file written" in capsys.readouterr().out, "what is there unchanged is left alone"
    assert main(["examples", str(folder)]) == 0
    assert "has all of them" in capsys.readouterr().out
    (folder / "wander.py").write_text("mine", encoding="utf-8")
    assert main(["examples", str(folder)]) == 2
    assert "has wander.py" in capsys.readouterr().err
    assert (folder / "wander.py").read_text(encoding="utf-8") == "mine"


@pytest.mark.slow
def test_the_copied_example_drives_the_robot(tmp_path: Path) -> None:
    assert main(["examples", str(tmp_path)]) == 0
    command = f"{sys.executable} {tmp_path / 'wander.py'} --steps 3"
    run = [sys.executable, "-m", "simmer_tui", "--no-ui", "--port", "0", "--seed", "7", "--run", command]
    assert subprocess.run(run, cwd=tmp_path, timeout=300, check=False).returncode == 0
