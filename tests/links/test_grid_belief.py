"""Grids on the belief port: what is understood, each limit with its message, and what follows from a grid."""

from __future__ import annotations

import base64
import json
import math
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simmer_tui.client import Robot
from simmer_tui.links.belief_link import LONGEST_LINE
from simmer_tui.links.belief_parser import parse_belief
from simmer_tui.run.belief_grid import MOST_STATES, RULED_OUT, grid_belief
from simmer_tui.run.events import Belief, Notice, NoticeKind
from simmer_tui.sim import Pose
from tests.links.test_belief import GOOD, Served, served

__all__ = ["served"]

TRUE = Pose(9.5, 42.0, 0.0)
MAZE = (0.0, 0.0, 96.0, 48.0)


def parse(value: Any, true: Pose = TRUE) -> Belief:
    return parse_belief(json.dumps(value).encode(), 4.0, true, MAZE)


def packed(numbers: Any, kind: str = "<f4") -> str:
    return base64.b64encode(np.asarray(numbers, dtype=kind).tobytes()).decode()


def of_grid(true: Pose = TRUE, **fields: Any) -> Belief:
    belief = parse({"grid": fields}, true)
    assert belief.grid is not None
    return belief


# -- the three ways to write it ----------------------------------------------------------------------


def test_lists_floats_and_bytes_are_the_same_grid() -> None:
    table = [[0, 1, 2, 0], [4, 0, 1, 0]]
    listed = of_grid(p=table)
    assert (
        listed
        == of_grid(rows=2, cols=4, f32=packed(table))
        == of_grid(rows=2, cols=4, u8=packed(table, "u1"))
    )
    assert listed.pose == Pose(12.0, 12.0, 0.0)
    assert listed.grid is not None
    assert (listed.grid.shape, listed.grid.bounds) == ((2, 4, 1), MAZE)


def test_the_heading_is_fastest_and_row_1_on_top() -> None:
    table = np.zeros((4, 8, 4))
    table[0, 0, 1] = 1.0
    for belief in (of_grid(p=table.tolist()), of_grid(rows=4, cols=8, headings=4, f32=packed(table))):
        assert belief.pose == Pose(6.0, 42.0, 90.0)
    assert of_grid(p=table.tolist(), first=45).pose == Pose(6.0, 42.0, 135.0)
    assert of_grid(p=table.tolist(), bounds=[0, 0, 8, 4]).pose == Pose(0.5, 3.5, 90.0)


def test_what_a_program_tells_itself_stays() -> None:
    belief = parse({"x": 1, "y": 2, "heading": 3, "spread": 4, "grid": {"p": [[1, 0]]}})
    assert (belief.pose, belief.spread) == (Pose(1.0, 2.0, 3.0), 4.0)
    assert parse({"heading": 90, "grid": {"p": [[1, 0]]}}).pose == Pose(24.0, 24.0, 90.0)


def test_a_grid_of_the_largest_size_fits_into_a_line_also_as_a_list_of_three_digits() -> None:
    table = np.full((128, 128, 4), 0.125)
    assert table.size == MOST_STATES
    line = json.dumps({"grid": {"p": table.tolist()}}).encode()
    assert len(line) < LONGEST_LINE
    assert parse_belief(line, 0.0, TRUE, MAZE).grid is not None


# -- limits ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("grid", "mistake"),
    [
        (5, 'grid must be an object, such as {"p": [[0.1, 0.9], [0, 0]]}'),
        ({"q\x1b": 1}, "'q\x1b' is no field of a grid; there are p, f32, u8, rows"),
        ({}, "a grid needs exactly one of p, f32 and u8"),
        ({"p": [[1]], "u8": "AA=="}, "a grid needs exactly one of p, f32 and u8"),
        ({"p": []}, "p must be a list of rows, each a list of numbers"),
        ({"p": [1, 2]}, "p must be a list of rows, each a list of numbers"),
        ({"p": [[]]}, "cols must be from 1 to 1,000, not 0"),
        ({"p": [[[]]]}, "headings must be from 1 to 360, not 0"),
        ({"p": [[0] * 8, [0] * 8, [0] * 7]}, "row 3 has 7 numbers, not 8"),
        ({"p": [[[1, 2], [1]]]}, "cell 2 (counted from the top left) has 1 headings, not 2"),
        ({"p": [[[1, 2], 1]]}, "p must be a list of rows, each a list of numbers"),
        ({"p": [[1, None]]}, "p must hold numbers alone"),
        ({"p": [[1, True]]}, "p must hold numbers alone"),
        ({"p": [[1, "1"]]}, "p must hold numbers alone"),
        ({"p": [[1, [2]]]}, "p must hold numbers alone"),
        ({"p": [[1, float("nan")]]}, "probabilities must be finite"),
        ({"p": [[float("nan"), 1]]}, "probabilities must be finite"),
        ({"p": [[1, float("inf")]]}, "probabilities must be finite"),
        ({"p": [[1, 10**400]]}, "probabilities must be finite"),
        ({"p": [[1, -1e-9]]}, "probabilities must be 0 or more"),
        ({"p": [[0, 0]]}, "one probability must be more than 0"),
        ({"p": [[1]] * 1001}, "rows must be from 1 to 1,000, not 1,001"),
        ({"p": [[0] * 500] * 200}, "a grid has at most 65,536 states, not 200 x 500 x 1 = 100,000"),
        ({"p": [[1, 2]], "cols": 3}, "cols says another number than p has, which is 2"),
        ({"f32": "AAAA", "cols": 1}, "rows must be a whole number from 1 to 1,000"),
        ({"f32": "AAAA", "rows": 1.5, "cols": 1}, "rows must be a whole number from 1 to 1,000"),
        ({"f32": "AAAA", "rows": True, "cols": 1}, "rows must be a whole number from 1 to 1,000"),
        ({"f32": "AAAA", "rows": 1, "cols": 1, "headings": 361}, "headings must be a whole number"),
        ({"f32": "AAAA", "rows": 300, "cols": 300}, "at most 65,536 states, not 300 x 300 x 1 = 90,000"),
        ({"f32": "AAAA", "rows": 2, "cols": 2}, "f32 has 3 bytes, not 16 for 2 x 2 x 1 states"),
        ({"u8": "AAA*", "rows": 1, "cols": 3}, "u8 must be bytes in base64"),
        ({"u8": 5, "rows": 1, "cols": 3}, "u8 must be bytes in base64"),
        ({"f32": packed([math.nan]), "rows": 1, "cols": 1}, "probabilities must be finite"),
        ({"p": [[1]], "first": "0"}, "first must be a number"),
        ({"p": [[1]], "bounds": [0, 0, 1]}, "bounds must be [x0, y0, x1, y1], inches"),
        ({"p": [[1]], "bounds": [0, 0, 0, 1]}, "bounds must be [x0, y0, x1, y1] with x0 < x1 and y0 < y1"),
        ({"p": [[1]], "bounds": [0, 0, None, 1]}, "each of bounds must be a number"),
    ],
)  # fmt: skip
def test_each_limit_has_its_message(grid: Any, mistake: str) -> None:
    with pytest.raises(ValueError, match=re.escape(mistake)):
        parse({"grid": grid})


_JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4),
    max_leaves=12,
)


@settings(max_examples=20)
@given(
    st.dictionaries(st.sampled_from(["p", "f32", "u8", "rows", "cols", "headings", "first", "bounds"]), _JSON)
)
def test_any_fields_are_a_grid_or_a_mistake(fields: dict[str, Any]) -> None:
    try:
        belief = parse({"grid": fields})
    except ValueError as error:
        assert str(error).isprintable()  # noqa: PT017 - either is right
        return
    assert belief.grid is not None
    assert len(belief.grid.cells) == belief.grid.states


_TABLES = st.tuples(st.integers(1, 6), st.integers(1, 6), st.integers(1, 5)).flatmap(
    lambda shape: st.lists(
        st.floats(0.0, 1e308, allow_subnormal=True),
        min_size=math.prod(shape),
        max_size=math.prod(shape),
    ).map(lambda numbers: np.array(numbers).reshape(shape))
)


@settings(max_examples=20)
@given(_TABLES, st.floats(-10, 110), st.floats(-10, 60), st.floats(-1000, 1000))
def test_of_any_table_the_numbers_are_within_their_limits(
    table: np.ndarray[Any, np.dtype[np.float64]], x: float, y: float, heading: float
) -> None:
    if not table.any():
        table[0, 0, 0] = 1.0
    grid = of_grid(Pose(x, y, heading), p=table.tolist()).grid
    assert grid is not None
    assert 0.0 <= grid.entropy <= math.log2(table.size) + 1e-5
    assert 0.0 <= grid.true_probability <= 1.0
    assert 0.0 <= grid.above <= 1.0
    assert 0.0 <= grid.turn_spread <= 180.0
    row, column, each = grid.best
    assert table[row, column, each] == table.max()
    assert grid.cells[int(table.argmax())] == 0
    assert abs(grid.places().sum() - 1.0) < 1e-9


@settings(max_examples=20)
@given(_TABLES, st.floats(1e-3, 1e3))
def test_the_scale_of_a_table_does_not_matter(
    table: np.ndarray[Any, np.dtype[np.float64]], scale: float
) -> None:
    table = np.round(table / 1e308, 6)
    table[0, 0, 0] += 1e-3
    one, other = of_grid(p=table.tolist()).grid, of_grid(p=(table * scale).tolist()).grid
    assert one is not None
    assert other is not None
    assert abs(one.entropy - other.entropy) < 1e-5
    assert abs(one.true_probability - other.true_probability) < 1e-5


# -- what follows ------------------------------------------------------------------------------------


def test_entropy_spread_and_the_probability_at_the_truth() -> None:
    grid = of_grid(p=[[0.5, 0.25, 0.25, 0], [0, 0, 0, 0]], true=Pose(30.0, 40.0, 77.0)).grid
    assert grid is not None
    assert grid.entropy == 1.5
    # 24 in and 48 in beside the best cell, a quarter each.
    assert grid.spread == pytest.approx(math.sqrt(0.25 * 24**2 + 0.25 * 48**2), abs=1e-6)
    assert (grid.true_probability, grid.best) == (0.25, (0, 0, 0))
    # The neighbour of the truth is the best cell.
    assert grid.above == 0.0


def test_above_counts_what_is_likelier_than_the_truth_and_all_its_neighbours() -> None:
    table = np.full((4, 8, 4), 0.001)
    table[3, 7, 2] = 0.6
    table[0, 0, 3] = 0.2  # beside heading 0, around the corner
    table[1, 1, 0] = 0.1
    grid = of_grid(p=table.tolist(), true=Pose(6.0, 42.0, 5.0)).grid
    assert grid is not None
    assert grid.above == pytest.approx(0.6 / table.sum(), abs=1e-6)
    facing = of_grid(p=table.tolist(), true=Pose(6.0, 42.0, 85.0)).grid
    assert facing is not None
    assert facing.above == pytest.approx(0.8 / table.sum(), abs=1e-6)


def test_a_truth_outside_the_grid_has_no_probability() -> None:
    grid = of_grid(p=[[1, 1]], bounds=[40, 40, 48, 48], true=Pose(6.0, 6.0, 0.0)).grid
    assert grid is not None
    assert (grid.true_probability, grid.above) == (0.0, 1.0)


def test_a_logged_byte_is_an_eighth_of_a_halving() -> None:
    grid = grid_belief(np.array([[[1.0], [0.5], [2.0**-31], [2.0**-33], [0.0]]]), MAZE, 0.0, TRUE)
    assert list(grid.cells) == [0, 8, 248, RULED_OUT, RULED_OUT]


def test_entropy_of_the_logged_bytes_is_that_of_the_grid_to_2_hundredths_of_a_bit() -> None:
    random = np.random.default_rng(3)
    rows, columns = np.mgrid[0:24, 0:48]
    for _ in range(50):
        x, y, spread = random.uniform(0, 48), random.uniform(0, 24), random.uniform(0.5, 8)
        hump = np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / 2 / spread**2)
        for table in (hump, random.dirichlet(np.full(hump.size, 0.3)).reshape(hump.shape)):
            grid = grid_belief(table[..., None], MAZE, 0.0, TRUE)
            logged = grid.places()
            entropy = -float((logged[logged > 0] * np.log2(logged[logged > 0])).sum())
            assert abs(entropy - grid.entropy) < 0.02


def test_a_line_that_is_too_long_is_told_of_and_the_next_one_counts(served: Served) -> None:
    with served.connect() as sock:
        sock.sendall(b'{"grid": {"p": [[' + b"0.1, " * (LONGEST_LINE // 5) + b"0.1]]}}\n" + GOOD)
        first = served.next()
        while not isinstance(event := served.next(), Belief):
            assert isinstance(event, Notice)
    assert first == Notice(
        NoticeKind.FAULT,
        "belief not understood: a line has at most 1 MB; send a grid as f32, as believe() does",
    )
    assert event.pose.x == 6.0


def test_a_grid_of_the_largest_size_reaches_the_simulator(served: Served) -> None:
    ports = served.server.ports
    table = np.zeros((256, 256))
    table[0, 255] = 1.0
    with Robot("127.0.0.1", ports["commands"], ports["replies"], belief_port=ports["beliefs"]) as robot:
        robot.believe(grid=table)
        robot.close()
    while not isinstance(event := served.next(), Belief):
        assert isinstance(event, Notice)
    assert event.grid is not None
    assert (event.grid.shape, event.grid.best) == ((256, 256, 1), (0, 255, 0))
