"""A maze file of another course, with 1 for a wall."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from simmer_tui.config.loader import load
from simmer_tui.config.set_warnings import set_warnings
from simmer_tui.config.sets import bundled_sets
from simmer_tui.sim.maze import looks_inverted
from simmer_tui.sim.specs import MazeSpec
from simmer_tui.trials.mazes import random_maze

Problems = Callable[..., list[str]]

CORRIDORS = "1111111\n1000001\n1011101\n1010001\n1011101\n1000001\n1111111\n"
WITH_ENTRANCE = "1111111\n0000001\n1011101\n1010001\n1011101\n1000000\n1111111\n"
WITH_CODES = "1111111\n1200001\n1011101\n1010001\n1011101\n1000031\n1111111\n"


def spec(text: str) -> MazeSpec:
    return MazeSpec(tuple(tuple(map(int, line)) for line in text.split()))


def write(folder: Path, text: str) -> None:
    (folder / "maze.csv").write_text("".join(f"{','.join(line)}\n" for line in text.split()), "utf-8")


@pytest.mark.parametrize("text", [CORRIDORS, WITH_ENTRANCE, WITH_CODES])
def test_the_advice_for_a_start_never_lies_in_a_wall(folder: Path, problems: Problems, text: str) -> None:
    write(folder, text)
    settings = (folder / "settings.toml").read_text("utf-8")
    start = "bot_center = [18, 18]\nblock_center = [6, 6]\n"
    (folder / "settings.toml").write_text(start + settings_without(settings), "utf-8")
    [problem] = problems()
    assert "(18, 18)" in problem
    assert "(6, 6)" not in problem
    assert problem.endswith("here 0 is a wall and 1 is free: exchange them")


def settings_without(text: str) -> str:
    return "".join(
        line for line in text.splitlines(True) if not line.startswith(("bot_center", "block_center"))
    )


@pytest.mark.parametrize("text", [CORRIDORS, WITH_ENTRANCE, WITH_CODES])
def test_a_set_that_loads_all_the_same_has_a_warning(folder: Path, text: str) -> None:
    write(folder, text)
    settings = (folder / "settings.toml").read_text("utf-8")
    start = "bot_center = [6, 6]\nblock_center = [78, 78]\n"
    (folder / "settings.toml").write_text(start + settings_without(settings), "utf-8")
    [warning] = set_warnings(load(folder))
    assert "maze.csv seems to have 1 for a wall" in warning


def test_mazes_of_our_own_are_not_taken_for_others() -> None:
    mazes = [load(path).simulation.maze for path in bundled_sets().values()]
    random = np.random.default_rng(1)
    mazes += [random_maze(mazes[0], random) for _ in range(50)]
    mazes += [spec("11111\n11111\n11111\n11111"), spec("111111\n111111\n110011\n111111\n111111")]
    mazes += [spec(CORRIDORS.translate(str.maketrans("01", "10")))]
    assert not any(map(looks_inverted, mazes))
