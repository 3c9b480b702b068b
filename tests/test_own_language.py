"""The page "Your robot's own language": its program drives the simulator with its dialect, and its sketch."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tty
from pathlib import Path

import pytest

from simmer_tui.cli.main import main
from simmer_tui.config.examples import copy_examples
from simmer_tui.config.loader import find_set, init_set

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "scripts" / "arduino" / "own_language"
PROGRAM = FOLDER / "own_language.py"
STEPS = 6


@pytest.fixture
def own_set(tmp_path: Path) -> Path:
    init_set(tmp_path / "set", find_set("default"))
    shutil.copy(FOLDER / "dialect.toml", tmp_path / "set")
    return tmp_path / "set"


def test_its_dialect_has_no_mistake_and_people_may_drive(
    own_set: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(own_set)]) == 0
    told = capsys.readouterr().out
    assert "31.2,31.2" in told
    assert "d1-N" in told.partition("for a real robot (--serial)")[2]


def test_examples_have_its_files(tmp_path: Path) -> None:
    written = {path.relative_to(tmp_path).as_posix() for path in copy_examples(tmp_path)}
    names = ("own_language.ino", "dialect.toml", "own_language.py")
    assert {f"arduino/own_language/{name}" for name in names} <= written


@pytest.mark.slow
def test_the_program_drives_the_simulator(own_set: Path, tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    words = [
        sys.executable,
        "-m",
        "simmer_tui",
        "--no-ui",
        "--belief-port",
        "0",
        "--config",
        str(own_set),
        "--seed",
        "1",
    ]
    words += ["--clock", "program", "--log", str(log), "--run", f"{sys.executable} {PROGRAM}"]
    ended = subprocess.run(words, capture_output=True, text=True, timeout=600, check=False)
    assert ended.returncode == 0, ended.stderr
    lines = ended.stdout.splitlines()
    assert len(lines) == STEPS
    assert all(line.endswith(": ok") for line in lines)
    assert "no message of the dialect" not in ended.stderr
    wire = [line for line in log.read_text("utf-8").splitlines() if '"kind":"wire"' in line.replace(" ", "")]
    assert len(wire) == 4 * STEPS


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no ptys")
def test_the_same_program_drives_the_sketch(tmp_path: Path) -> None:
    compiler = shutil.which("c++") or shutil.which("g++")
    if compiler is None:
        pytest.skip("no C++ compiler here")
    source, sketch = tmp_path / "sketch.cpp", tmp_path / "sketch"
    text = (FOLDER / "own_language.ino").read_text()
    source.write_text(f'#include "Arduino.h"\n{text}\nint main() {{ setup(); for (;;) loop(); }}\n')
    include = f"-I{ROOT / 'tests' / 'arduino'}"
    subprocess.run([compiler, "-Wall", "-Werror", include, str(source), "-o", str(sketch)], check=True)
    master, slave = os.openpty()
    tty.setraw(slave)
    with subprocess.Popen([sketch], stdin=master, stdout=master) as board:
        words = [sys.executable, str(PROGRAM), os.ttyname(slave)]
        ended = subprocess.run(words, capture_output=True, text=True, timeout=600, check=False)
        board.kill()
    os.close(master)
    os.close(slave)
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.splitlines() == [
        f"{step}: 50.0 cm ahead, 50.0 to the left; f 10: ok" for step in range(1, STEPS + 1)
    ]
