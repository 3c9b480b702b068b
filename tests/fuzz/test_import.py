"""A thousand broken files of teams: each becomes a set, or is refused with the reason."""

from __future__ import annotations

import random
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.config.importer.files import read_path
from simmer_tui.config.importer.set_writer import write_set
from simmer_tui.config.loader import load
from simmer_tui.errors import ConfigurationError, Problem

CORPUS = Path(__file__).parent / "corpus" / "import"
WORDS = (
    *(b"walls", b"sensors", b"drives", b"motors", b"robot_outline", b"block_position", b"position", b"error"),
    *(
        b"rotation",
        b"velocity",
        b"Ultrasonic(",
        b"Drive({",
        b"pm.Vector2(",
        b"for i in range(9):\n    ",
        b"lambda",
    ),
    *(
        b" if 1 else ",
        b"import os\n",
        b".append(",
        b".extend(",
        b".rotate(",
        b" ** ",
        b" * ",
        b" // 0",
        b"[0]",
    ),
    *(b"np.linspace(0, 1, 9)", b"*", b"**", b"@", b":=", b"f'{", b"...", b"None", b"1j", b"True", b"-", b"~"),
    *(b"sensors = {}\n", b"while True:\n    ", b"def f():\n    ", b"class A:\n    ", b"del walls\n", b"\\\n"),
    *(
        b"bot_center",
        b"blocksize",
        b"[9.5 42]",
        b"%{\n",
        b"%}\n",
        b"...\n",
        b"'single'",
        b"tcpclient(",
        b"1:3",
    ),
)


def problems_of(error: ConfigurationError) -> Sequence[Problem]:
    return error.problems or [Problem("", "no problem is told")]


def check(source: Path, target: Path) -> bool:
    """True if a set is made; a refusal, and what is left out, must be of use to people. The set has no
    mistakes but the places of robot and block, in a maze without room."""
    imported = None
    problems: Sequence[Problem] = ()
    try:
        imported = read_path(source)
        problems = imported.left_out
    except ConfigurationError as error:
        problems = problems_of(error)
    for problem in problems:
        assert problem.where, problem
        assert len(problem.what) > 5, problem
        assert str(problem).isprintable(), problem
        assert len(str(problem)) < 1000, problem
    if imported is None:
        return False
    write_set(imported, target)
    mistakes: Sequence[Problem] = ()
    try:
        load(target)
    except ConfigurationError as error:
        mistakes = problems_of(error)
    assert all("_center" in problem.where for problem in mistakes), mistakes
    return True


@pytest.mark.parametrize("cases", [30, pytest.param(1000, marks=pytest.mark.slow)])
def test_broken_files(cases: int, tmp_path: Path, mutate: Any) -> None:
    sources = []
    for good in sorted((CORPUS / "good").iterdir()):
        sources.append(tmp_path / good.name)
        (shutil.copytree if good.is_dir() else shutil.copy)(good, sources[-1])
        assert check(sources[-1], tmp_path / f"set of {good.name}")
    made = 0
    for seed in range(cases):
        chance = random.Random(seed)
        source = chance.choice(sources)
        files = [path for path in sorted(source.rglob("*")) if path.is_file()] or [source]
        broken = chance.choice(files)
        whole = broken.read_bytes()
        broken.write_bytes(mutate(whole, chance, WORDS))
        target = tmp_path / "set"
        try:
            made += check(source, target)
        except Exception as error:
            error.add_note(f"seed {seed}, {broken.relative_to(tmp_path)}")
            raise
        broken.write_bytes(whole)
        for path in target.glob("*"):
            path.unlink()
    assert cases * 0.05 < made < cases * 0.95, "the mutations break too little or too much"


@pytest.mark.parametrize("case", sorted(path.name for path in (CORPUS / "trouble").iterdir()))
def test_files_that_once_were_trouble(case: str, tmp_path: Path) -> None:
    check(CORPUS / "trouble" / case, tmp_path / "set")
