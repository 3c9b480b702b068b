"""Every sort of crash of graded programs, with its error and its line, on the pages of their teams."""

from __future__ import annotations

import html
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from simmer_tui.cli.grade_command import run_grade
from tests.grade.conftest import read_grades
from tests.program.crash_kinds import KINDS

LIMITS = "[decide]\nrequire = 0.9\nmargin = 0.5\n[limits]\ntime = 10.0\n"
NAMES = (*(name for name, kind in KINDS.items() if kind.file.endswith(".py")), "C", "C++")
"""Programs of other languages need more memory than a sandbox gives, or other folders."""


@pytest.mark.slow
def test_grades_and_pages_of_teams_have_their_crashes(
    isolation: str, make_course: Callable[..., Path], tmp_path: Path
) -> None:
    kinds = {name.lower().replace(" ", "-").replace("+", "p"): KINDS[name] for name in NAMES}
    file = make_course({name: kind.lines for name, kind in kinds.items()}, LIMITS)
    for name, kind in kinds.items():
        folder = tmp_path / "teams" / name
        kind.made(folder)
        # Our package lies elsewhere in a sandbox, and finds itself.
        command = kind.command.replace("python", "python -S")
        (folder / "team.toml").write_text(f'command = "{command}"\n')
    assert run_grade([str(file), "--out", str(tmp_path / "out"), "--isolation", isolation]) == 1
    grades = read_grades(tmp_path / "out")
    for name, kind in kinds.items():
        page = (tmp_path / "out" / "site" / f"{name}.html").read_text("utf-8")
        text = " ".join(html.unescape(re.sub(r"<wbr>", "", page)).split())
        assert all(part in text for part in kind.said), (name, text[:500])
        assert grades[name]["status"] == "failed"
