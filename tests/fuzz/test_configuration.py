"""A thousand broken sets: each loads, or is refused with the place and what is allowed there."""

from __future__ import annotations

import random
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.config.loader import load
from simmer_tui.config.set_summary import summarize
from simmer_tui.config.sets import bundled_sets
from simmer_tui.config.settings import all_settings
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim import Simulator

CORPUS = Path(__file__).parent / "corpus" / "configuration"
FLOOR = b"\n".join([b",".join([b"0", b"1"] * 16)] * 16)
WORDS = (
    *(item.name.rpartition(".")[2].encode() for item in all_settings()),
    *(b"ultra1", b"tof1", b"ir1", b"comp1", b"odom1", b"gyro1", b"load1", b"up", b"down", b"left", b"right"),
    *(b"rot", b"grip", b"u1", b"d1", b"xx", b"Rays", b"Wrap", b"Detects", b"white", b"Gain", b"Speed"),
    *(b"Max Range (in)", b"Min Range (in)", b"Resolution", b"hc-sr04", b"omni-4", b"binary", b"packets"),
)


def check(folder: Path) -> bool:
    """True if the set loads, and then makes a robot; a refusal must be of use to people."""
    problems: Sequence[Problem] = ()
    try:
        configuration = load(folder)
    except ConfigurationError as error:
        problems = error.problems or [Problem("", "no problem is told")]
    for problem in problems:
        assert problem.where, problem
        assert len(problem.what) > 10, problem
        assert str(problem).isprintable(), problem
        assert len(str(problem)) < 1000, problem
    if problems:
        return False
    Simulator(configuration.simulation, seed=1)
    summarize(configuration)
    return True


@pytest.mark.parametrize("cases", [30, pytest.param(1000, marks=pytest.mark.slow)])
def test_broken_sets(cases: int, tmp_path: Path, mutate: Any) -> None:
    sets = {
        name: {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
        for name, folder in bundled_sets().items()
    }
    loaded = 0
    folder = tmp_path / "set"
    folder.mkdir()
    there: dict[str, bytes] = {}
    for seed in range(cases):
        chance = random.Random(seed)
        name = chance.choice(sorted(sets))
        files = dict(sets[name])
        if chance.random() < 0.1:
            files["floor.csv"] = FLOOR
        for broken in chance.sample(sorted(files), chance.choice((1, 1, 1, 2, 3))):
            files[broken] = mutate(files[broken], chance, WORDS)
        if chance.random() < 0.02:
            del files[chance.choice(sorted(files))]
        for file in there.keys() - files.keys():
            (folder / file).unlink()
        for file, data in files.items():
            if there.get(file) != data:
                (folder / file).write_bytes(data)
        there = files
        try:
            loaded += check(folder)
        except Exception as error:
            error.add_note(f"seed {seed}, of set {name}")
            raise
    assert cases * 0.05 < loaded < cases * 0.95, "the mutations break too little or too much"


@pytest.mark.parametrize("case", sorted(path.name for path in CORPUS.iterdir()))
def test_sets_that_once_were_trouble(case: str, tmp_path: Path) -> None:
    """Each folder holds the files that differ from the default set's."""
    shutil.copytree(bundled_sets()["default"], tmp_path / "set", ignore=shutil.ignore_patterns("*/"))
    shutil.copytree(CORPUS / case, tmp_path / "set", dirs_exist_ok=True)
    check(tmp_path / "set")
