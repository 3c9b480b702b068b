"""The start of the screen."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from simmer_tui.cli import app_start
from simmer_tui.cli.app_start import Screen, program_name
from simmer_tui.tui import textual_internals


@pytest.mark.parametrize(
    ("command", "name"),
    [
        ("python scripts/wander.py --steps 200", "wander.py"),
        ("python3.11 team/solve.py", "solve.py"),
        ("python -u solve.py", "solve.py"),
        ("python 'my robot.py'", "my robot.py"),
        ("octave-cli solve.m", "solve.m"),
        ("./solve --gain 0.5 table.csv", "solve"),
        ("python -m team.solve", "python"),
        ("it's", "it's"),
        ("", ""),
    ],
)
def test_a_program_is_named_by_its_file_not_by_its_interpreter(command: str, name: str) -> None:
    assert program_name(command) == name


def test_the_garbage_of_the_start_is_collected_at_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """A collection in the middle of a run kept a client waiting for 50 ms."""
    done: list[str] = []
    calls = SimpleNamespace(collect=lambda: done.append("collect"), freeze=lambda: done.append("freeze"))
    monkeypatch.setattr(app_start, "gc", calls)
    monkeypatch.setattr(textual_internals, "run_app", lambda app, mouse: app.after_start())
    screen: Any = Screen.__new__(Screen)
    screen._server, screen._settings = None, SimpleNamespace(mouse=True)
    screen._app = SimpleNamespace(fault="")
    assert screen.show() == 0
    assert done == ["collect", "freeze"]
