"""Small programs, and the sets that they do their runs with."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from simmer_tui.config.sets import bundled_sets, init_set
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
def mission_set(tmp_path: Path) -> Path:
    """The bundled mission without errors: the robot faces the block, 10 in away, and stands in the
    drop zone."""
    folder = tmp_path / "mission"
    init_set(folder, bundled_sets()["mission"])
    (folder / "mission.toml").write_text(
        "start = [30, 42]\nheading = 180\nblock = [20, 42]\ndrop_zone = [30, 42]\n"
        "time_limit = 60\ncontacts = 0\n"
    )
    rows = ["ID,Poll Character,Enabled,Y-Axis Error,X-Axis Error,Rotation Error,Y-Axis Bias,X-Axis Bias,"
            "Rotation Bias,Reach,Width"]  # fmt: skip
    codes = {"up": "w1", "down": "s1", "left": "a1", "right": "d1", "rot": "r1"}
    rows += [f"{name},{code},1,0,0,0,0,0,0,," for name, code in codes.items()]
    rows.append("grip,p1,1,,,,,,,3,4")
    (folder / "drive.csv").write_text("\n".join(rows) + "\n")
    settings = (folder / "settings.toml").read_text()
    (folder / "settings.toml").write_text(settings.replace("randbias = true", "randbias = false"))
    return folder


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
        return TrialResult(**(usual | fields))  # type: ignore[arg-type]

    return make
