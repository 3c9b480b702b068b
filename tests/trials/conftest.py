"""Small programs, and the sets that they do their runs with."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.trials.trial import Ending, TrialResult

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def program(tmp_path: Path) -> Callable[[str], str]:
    """Makes a program of some lines, which find a connected `robot` and the run's `number`; returns
    the command that runs it."""

    def make(lines: str) -> str:
        path = tmp_path / "program.py"
        path.write_text(
            "import os, socket, sys, threading\n"
            f"sys.path.insert(0, {str(ROOT)!r})\n"
            "from simmer_tui.client import Robot\n"
            "number = int(os.environ['SIMMER_RUN'])\n"
            "robot = Robot()\n" + lines
        )
        words = [sys.executable, str(path)]
        return subprocess.list2cmdline(words) if sys.platform == "win32" else shlex.join(words)

    return make


@pytest.fixture
def made_result() -> Callable[..., TrialResult]:
    """Makes the result of a run that never was."""

    def make(number: int, seed: int, *, success: bool = True, **fields: object) -> TrialResult:
        usual: dict[str, object] = {
            "number": number,
            "seed": seed,
            "maze": "",
            "success": success,
            "ending": Ending.SUCCESS if success else Ending.CONTACTS,
            "reason": "" if success else "1 contact with a wall, 0 allowed",
            "exit_code": None,
            "time": 100.0 + number,
            "distance": 200.0,
            "commands": 50,
            "contacts": 0 if success else 1,
            "contact_points": () if success else ((36.0, 20.0),),
            "start": (90.0, 42.0, 0.0),
            "end": (33.0, 20.0, 45.0),
            "block": (10.0, 40.0),
            "drop_zone": (90.0, 6.0),
            "reached": 40.0,
            "taken": 50.0 if success else None,
            "delivered": 100.0 + number if success else None,
            "last_output": "",
            "real_seconds": 1.0,
            "simulator_seconds": 0.5,
        }
        cause, why = fields.pop("cause", ""), fields.pop("why", "")
        if cause:
            verdict: dict[str, Any] = {"cause": {}} | (fields.get("verdict") or {})  # type: ignore[operator]
            fields["verdict"] = verdict | {"cause": verdict["cause"] | {"kind": cause}, "last_moments": why}
        return TrialResult(**(usual | fields))  # type: ignore[arg-type]

    return make
