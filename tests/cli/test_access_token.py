"""The token of a run is not read off anybody's command line."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from simmer_tui.cli.main import main

WORD = "sesame-street-42"
PROGRAM = """
import os
from pathlib import Path
from simmer_tui.client import Robot
with Robot() as robot:
    print("reads", robot.read("u1") > 0, os.environ["SIMMER_TOKEN"])
for path in Path("/proc").glob("[0-9]*/cmdline"):
    try:
        if os.environ["SIMMER_TOKEN"].encode() in path.read_bytes(): print("seen", path)
    except OSError: pass
"""
linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux lets a process change what ps shows")


@pytest.mark.slow
@linux
@pytest.mark.parametrize("how", ["--token {}", "--token={}", "--token-file {}"])
def test_no_command_line_shows_the_token(how: str, tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(PROGRAM)
    (tmp_path / "word").write_text(f"{WORD}\n")
    given = how.format(tmp_path / "word" if "file" in how else WORD).split()
    ports = ("--port", "0", "--reply-port", "0", "--belief-port", "0")
    run = ("--run", shlex.join([sys.executable, str(tmp_path / "program.py")]))
    done = subprocess.run(
        [sys.executable, "-m", "simmer_tui", "--no-ui", "--quiet", *ports, *given, *run],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.returncode) == (f"reads True {WORD}\n", 0), done.stderr


@pytest.mark.parametrize(
    ("content", "mistake"),
    [
        (None, "cannot be read"),
        (b"", "is no token"),
        (b"\n", "is no token"),
        (b"x" * 300, "is no token"),
        (b"\xff\xfe", "is no text in UTF-8"),
    ],
)
def test_a_file_without_a_word_says_so(
    content: bytes | None, mistake: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "word"
    if content is not None:
        file.write_bytes(content)
    assert main(["--no-ui", "--port", "0", "--token-file", str(file)]) == 2
    assert mistake in capsys.readouterr().err


def test_a_word_given_twice_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "word").write_text(WORD)
    assert main(["--no-ui", "--token", "a", "--token-file", str(tmp_path / "word")]) == 2
    assert "leave one of them out" in capsys.readouterr().err
