"""Mazes made at random, and mazes from a folder."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simmer_tui.errors import ConfigurationError
from simmer_tui.sim.specs import BLOCK, WALL, MazeSpec
from simmer_tui.trials.mazes import maze_text, random_maze, read_mazes

Cells = set[tuple[int, int]]


def rectangles(rows: int, columns: int) -> st.SearchStrategy[MazeSpec]:
    row = st.tuples(*[st.integers(0, 3)] * columns)
    return st.tuples(*[row] * rows).map(MazeSpec)


mazes = st.tuples(st.integers(1, 9), st.integers(1, 9)).flatmap(lambda size: rectangles(*size))
seeds = st.integers(0, 2**32 - 1)


def cells(maze: MazeSpec, *values: int) -> Cells:
    return {(r, c) for r, row in enumerate(maze.cells) for c, cell in enumerate(row) if cell in values}


def is_connected(area: Cells) -> bool:
    seen: Cells = set()
    edge = list(area)[:1]
    while edge:
        row, column = edge.pop()
        seen.add((row, column))
        beside = {(row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)}
        edge += (beside & area) - seen
    return seen == area


def counts(maze: MazeSpec) -> Counter[int]:
    return Counter(cell for row in maze.cells for cell in row)


@settings(max_examples=15)
@given(mazes, seeds)
def test_random_maze_keeps_size_and_number_of_every_kind_of_cell(like: MazeSpec, seed: int) -> None:
    made = random_maze(like, np.random.default_rng(seed))
    assert (made.rows, made.columns) == (like.rows, like.columns)
    assert counts(made) == counts(like)


@settings(max_examples=15)
@given(mazes, seeds)
def test_every_free_cell_of_a_random_maze_can_be_reached(like: MazeSpec, seed: int) -> None:
    made = random_maze(like, np.random.default_rng(seed))
    assert is_connected(cells(made, 1, 2, 3)) or counts(like)[WALL] == like.rows * like.columns


@settings(max_examples=15)
@given(mazes, seeds)
def test_block_cells_of_a_random_maze_are_one_area(like: MazeSpec, seed: int) -> None:
    assert is_connected(cells(random_maze(like, np.random.default_rng(seed)), BLOCK))


@settings(max_examples=15)
@given(mazes, seeds)
def test_the_same_seed_gives_the_same_maze(like: MazeSpec, seed: int) -> None:
    assert random_maze(like, np.random.default_rng(seed)) == random_maze(like, np.random.default_rng(seed))


def test_other_seeds_give_other_mazes_of_the_course_size(course_spec: object) -> None:
    like = course_spec.maze  # type: ignore[attr-defined]
    made = {random_maze(like, np.random.default_rng(seed)).cells for seed in range(50)}
    assert len(made) == 50


def test_large_maze_with_as_many_walls_as_it_can_hold_is_made() -> None:
    like = MazeSpec(tuple(tuple((r + c) % 2 for c in range(40)) for r in range(40)))
    made = random_maze(like, np.random.default_rng(0))
    assert counts(made) == counts(like)
    assert is_connected(cells(made, 1))


def test_mazes_of_a_folder_come_in_the_order_of_their_names(tmp_path: Path) -> None:
    second, first = MazeSpec(((1, 2), (3, 0))), MazeSpec(((2, 3, 1),))
    (tmp_path / "b.csv").write_text(maze_text(second))
    (tmp_path / "a.csv").write_text(maze_text(first))
    (tmp_path / "notes.txt").write_text("not a maze")
    assert list(read_mazes(tmp_path).items()) == [("a.csv", first), ("b.csv", second)]


def test_all_mistakes_of_a_folder_of_mazes_are_reported_by_file_and_line(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("1,2\n1,7\n")
    (tmp_path / "b.csv").write_text("1,x\n")
    with pytest.raises(ConfigurationError) as caught:
        read_mazes(tmp_path)
    assert [problem.where for problem in caught.value.problems] == ["a.csv:2:B", "b.csv:1:B"]


@pytest.mark.parametrize("name", ["nowhere", "."])
def test_folder_without_mazes_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigurationError, match=r"--mazes: .*(is not a folder|holds no \.csv files)"):
        read_mazes(tmp_path / name)
