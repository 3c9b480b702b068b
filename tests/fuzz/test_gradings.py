"""A broken grade.json: the grading opens, or is refused with a message."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.errors import SimmerError
from simmer_tui.grade.course import read_course
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.sandbox import Isolation

WORDS = (b"null", b"[]", b"{}", b"1e999", b'"inf"', rb"\ud800", b"Infinity", b"true", b"-1")


# As written the file is accepted. Of few changed ones all may be refused, since paths and times in it differ.
@pytest.mark.parametrize(("cases", "most"), [(5, 5), pytest.param(1000, 999, marks=pytest.mark.slow)])
def test_broken_plans(cases: int, most: int, tmp_path: Path, mutate: Any) -> None:
    team = tmp_path / "teams" / "alpha"
    team.mkdir(parents=True)
    (team / "robot.py").write_text("pass\n")
    (team / "team.toml").write_text('run = "python robot.py"\n')
    out = tmp_path / "out"
    GradeFolder.create(out, read_course(tmp_path / "teams"), 5, Isolation.NONE)
    good = (out / "grade.json").read_bytes()
    GradeFolder.read(out)
    refused = 0
    for seed in range(cases):
        (out / "grade.json").write_bytes(mutate(good, random.Random(seed), WORDS))
        try:
            GradeFolder.read(out)
        except SimmerError:
            refused += 1
        except Exception as error:
            error.add_note(f"seed {seed}")
            raise
    assert 0 < refused <= most
