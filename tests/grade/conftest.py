"""Small courses: a mission of four commands, and teams whose programs are a few lines."""

from __future__ import annotations

import csv
import io
import os
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from simmer_tui.errors import GradeError, SimmerError
from simmer_tui.grade.bubblewrap import what_is_missing
from simmer_tui.grade.submission_reader import SubmissionReader

CONNECT = """
import os, socket, sys
s = socket.create_connection((os.environ["SIMMER_HOST"], int(os.environ["SIMMER_PORT"])))
r = socket.create_connection((os.environ["SIMMER_HOST"], int(os.environ["SIMMER_REPLY_PORT"])))
"""
SOLVE = CONNECT + 's.sendall(b"d1-5\\np1-1\\na1-9\\np1-0\\n"); r.recv(99); s.recv(1)\n'
"""The mission done; it stays until it is ended."""
HIT = CONNECT + 's.sendall(b"d1-100\\n"); r.recv(99); s.recv(1)\n'
"""Into the wall."""


def chance(rate: float, salt: str) -> str:
    """A program that does the mission with this probability, the same in the same run."""
    draw = f'import random\nwins = random.Random("{salt}" + os.environ["SIMMER_RUN"]).random() < {rate!r}\n'
    end = 's.sendall(b"d1-5\\np1-1\\na1-9\\np1-0\\n" if wins else b"d1-100\\n"); r.recv(99); s.recv(1)\n'
    return CONNECT + draw + end


def read_grades(out: Path) -> dict[str, dict[str, str]]:
    """The rows of a grading's grades.csv by team."""
    text = (out / "grades.csv").read_text("utf-8")
    return {row["team"]: row for row in csv.DictReader(io.StringIO(text))}


@cache
def _missing() -> str:
    return what_is_missing()


@pytest.fixture
def isolation() -> str:
    """The sandbox of these tests; a machine that has no namespaces to give skips the tests that need it,
    but in CI the program itself has to be there."""
    assert "CI" not in os.environ or shutil.which("bwrap")
    if _missing():
        pytest.skip(_missing())
    return "bwrap"


@pytest.fixture
def reads_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Submissions are read in this process: starting the reader's takes longer than most tests. Its limits
    and its end have tests of their own."""

    def call(_: SubmissionReader, function: Callable[..., object], *given: object, **named: object) -> object:
        try:
            return function(*given, **named)
        except SimmerError as error:
            raise GradeError(str(error)) from error

    monkeypatch.setattr(SubmissionReader, "call", call)


@pytest.fixture
def make_course(tmp_path: Path, exact_mission: Path) -> Callable[..., Path]:
    """Makes a teams.toml with a team for each program; `more` is TOML behind it."""

    def make(programs: dict[str, str], more: str = "") -> Path:
        for name, lines in programs.items():
            folder = tmp_path / "teams" / name
            folder.mkdir(parents=True)
            (folder / "main.py").write_text(lines)
        file = tmp_path / "teams.toml"
        file.write_text(
            f'name = "A course"\nset = "{exact_mission.name}"\nteams = "teams"\n'
            f'command = "python -S main.py"\n{more}'
        )
        return file

    return make
