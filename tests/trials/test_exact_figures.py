"""Pictures of trials and sweeps, point for point: where each mark stands follows on paper."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterable

import pytest
from msgspec.structs import replace

from simmer_tui.document.model import Figure
from simmer_tui.document.svg import coordinate, whole_figure
from simmer_tui.report.causes import Kind
from simmer_tui.sim.specs import MazeSpec
from simmer_tui.trials.curves import Curve, SweepValue
from simmer_tui.trials.figures import histogram_figure, map_figure, start_cell
from simmer_tui.trials.intervals import wilson
from simmer_tui.trials.sweep_summary import curve_figure
from simmer_tui.trials.trial import TrialResult

Make = Callable[..., TrialResult]
SUCCESS, FAILURE = "#0a968c", "#f5a500"


def drawn(figure: Figure) -> ElementTree.Element:
    return ElementTree.fromstring(f"<svg>{figure.content}</svg>")


def of(root: ElementTree.Element, tag: str, *attributes: str) -> list[tuple[str, ...]]:
    """These attributes of all elements with a tag that have them all."""
    found = root.iter(tag)
    return [
        tuple(each.attrib[a] for a in attributes) for each in found if {*attributes} <= each.attrib.keys()
    ]


def numbers(rows: Iterable[tuple[str, ...]]) -> list[tuple[float, ...]]:
    return [tuple(map(float, row)) for row in rows]


def texts(root: ElementTree.Element) -> list[tuple[str, float, float]]:
    return [(each.text or "", float(each.attrib["x"]), float(each.attrib["y"])) for each in root.iter("text")]


# -- histogram ---------------------------------------------------------------------------------------


def test_bars_of_a_histogram() -> None:
    """1.0, 1.5 and 9.0 make 17 bins of a half from 1.0 to 9.5; 912 points of room, 130 high, on 150."""
    figure = histogram_figure([1.0, 1.5, 9.0], [1.0], "s")
    root, wide = drawn(figure), 912 / 17
    bars = numbers(of(root, "rect", "x", "y", "width", "height"))
    expected = [
        (34 + 1, 150 - 65, wide - 2, 65),  # a success among two runs in the tallest bin
        (34 + 1, 150 - 130, wide - 2, 65),  # a failure on top of it
        (34 + wide + 1, 150 - 65, wide - 2, 65),
        (34 + 16 * wide + 1, 150 - 65, wide - 2, 65),
    ]
    assert bars == [pytest.approx(each, abs=0.006) for each in expected]
    fills = [fill for (fill,) in of(root, "rect", "fill")]
    assert fills == [SUCCESS, FAILURE, SUCCESS, SUCCESS]
    assert [mark.words for mark in figure.legend] == ["successful runs", "failed runs"]
    assert [of(ElementTree.fromstring(mark.drawing), "rect", "fill") for mark in figure.legend] == [
        [(SUCCESS,)], [(FAILURE,)],
    ]  # fmt: skip
    counts, edges = texts(root)[:3], texts(root)[3:12]
    assert counts == [
        ("2", pytest.approx(34 + wide / 2, abs=0.006), 17.0),
        ("1", pytest.approx(34 + 1.5 * wide, abs=0.006), 82.0),
        ("1", pytest.approx(34 + 16.5 * wide, abs=0.006), 82.0),
    ]
    # 18 edges are too many for 16 labels: every second one has its own.
    assert edges == [
        (f"{1 + k / 2:.1f}", pytest.approx(34 + k * wide, abs=0.006), 164.0) for k in range(0, 18, 2)
    ]
    assert texts(root)[12:] == [("s", 20.0, 164.0)]
    assert (figure.title, figure.width, figure.height) == ("Histogram", 960.0, 170.0)


def test_all_edges_of_a_few_bins_are_labelled() -> None:
    """0 to 15 in steps of one: 16 edges."""
    root = drawn(histogram_figure([], [0.0, 14.5], "in"))
    assert [words for words, _, _ in texts(root)] == [
        "1", "1", *(str(k) for k in range(16)), "in",
    ]  # fmt: skip


# -- map ---------------------------------------------------------------------------------------------

MAZE = MazeSpec(((1, 1, 0, 2), (3, 1, 1, 1)))
"""48 by 24 inches: at 10 points an inch 480 by 240, in the middle of 912 points from 34 on."""
ORIGIN_X, ORIGIN_Y = 34 + 216, 8 + 240


@pytest.fixture
def results(made_result: Make) -> list[TrialResult]:
    cause = Kind.LOST.value
    return [
        made_result(1, 1, start=(5.0, 6.0, 0.0)),
        made_result(2, 2, start=(11.9, 0.1, 0.0)),
        made_result(
            3, 3, success=False, start=(6.0, 6.0, 9.0), end=(20.0, 10.0, 0.0), contact_points=((24.0, 12.0),)
        ),
        made_result(
            4, 4, success=False, start=(40.0, 20.0, 0.0), end=(30.0, 5.0, 0.0), cause=cause, why="too near",
            contact_points=(),
        ),
    ]  # fmt: skip


def test_a_run_belongs_to_the_cell_that_it_starts_in(made_result: Make) -> None:
    starts = [((0.0, 0.0), (6.0, 6.0)), ((11.9, 12.0), (6.0, 18.0)), ((12.0, 35.9), (18.0, 30.0))]
    for (x, y), cell in starts:
        assert start_cell(made_result(1, 1, start=(x, y, 0.0))) == cell


def test_rings_on_the_map_are_closed_by_the_share_of_successes(results: list[TrialResult]) -> None:
    root = drawn(map_figure(MAZE, results))
    radius = 40.0  # 0.42 of a cell of 120 points is more than the largest
    places = [(ORIGIN_X + 60, ORIGIN_Y - 60), (ORIGIN_X + 420, ORIGIN_Y - 180)]
    rings = [row for row in of(root, "circle", "cx", "cy", "r", "stroke", "stroke-width") if row[4] == "4"]
    grey, green = (
        [tuple(map(float, row[:3])) for row in rings if row[3] == colour] for colour in ("#c8c8c8", SUCCESS)
    )
    assert grey == [(x, y, radius) for x, y in places]
    assert green == [(*places[0], radius)]
    length = 2 * math.pi * radius
    ((dashes, turned),) = of(root, "circle", "stroke-dasharray", "transform")
    assert dashes == f"{length * 2 / 3:.2f} {length / 3 + 0.01:.2f}"
    assert turned == f"rotate(-90 {coordinate(places[0][0])} {coordinate(places[0][1])})"
    labels = {words: (x, y) for words, x, y in texts(root)}
    assert labels["2/3"] == pytest.approx((places[0][0], places[0][1] + 28.8))
    assert labels["0/1"] == pytest.approx((places[1][0], places[1][1] + 28.8))


def test_rings_shrink_with_a_large_maze(made_result: Make) -> None:
    """Of 20 rows a cell has 35 points: its ring has a radius of 0.42 of them."""
    maze = MazeSpec(((1, 1),) * 20)
    root = drawn(map_figure(maze, [made_result(1, 1, start=(1.0, 1.0, 0.0))]))
    assert (round(0.42 * 35, 2),) in numbers(of(root, "circle", "r"))


def test_ends_and_contacts_stand_where_they_were(results: list[TrialResult]) -> None:
    figure = map_figure(MAZE, results, {4: "runs/4.html"})
    root = drawn(figure)
    groups = [each for each in root.iter("g") if "fill-opacity" in each.attrib]
    assert [(each.get("fill"), each.get("stroke")) for each in groups] == [
        ("#8a2be2", "#222222"), ("#999999", "#222222"),
    ]  # fmt: skip
    assert 0 < min(float(each.get("stroke-width", "")) for each in groups) <= 1
    ends = [numbers(of(each, "circle", "cx", "cy", "r")) for each in groups]
    assert ends == [[(ORIGIN_X + 300, ORIGIN_Y - 50, 5)], [(ORIGIN_X + 200, ORIGIN_Y - 100, 5)]]
    assert [each.text for each in root.iter("title")] == [
        "run 4: too near", "run 3: 1 contact with a wall, 0 allowed",
    ]  # fmt: skip
    assert of(root, "a", "href") == [("runs/4.html",)]
    x, y = ORIGIN_X + 240, ORIGIN_Y - 120
    assert (f"M{x - 4:.1f} {y - 4:.1f}l8 8m0 -8l-8 8",) in of(root, "path", "d")
    assert figure.height == ORIGIN_Y + 24
    # In a file the legend stands below the axis, in rows 26 points apart, and nothing is left out.
    whole = whole_figure(figure)
    marks = {words: (x, y) for words, x, y in texts(drawn(whole)) if y > ORIGIN_Y + 24}
    assert list(marks) == [mark.words for mark in figure.legend]
    assert marks["contact"] == (34 + 26, ORIGIN_Y + 24 + 13 + 4)
    assert whole.height == ORIGIN_Y + 24 + 26
    assert f"{Kind.LOST.value} 1" in marks
    many = whole_figure(replace(figure, legend=figure.legend * 4))
    rows = {y for _, _, y in texts(drawn(many)) if y > ORIGIN_Y + 24}
    assert sorted(rows) == [ORIGIN_Y + 24 + 17 + 26 * row for row in range(len(rows))]
    assert many.height == ORIGIN_Y + 24 + 26 * len(rows)


# -- curve of a sweep --------------------------------------------------------------------------------


def value(made_result: Make, name: str, successes: int) -> SweepValue:
    return SweepValue(name, tuple(made_result(k, k, success=k < successes) for k in range(10)))


def test_a_curve_has_its_points_bars_and_scale_in_place(made_result: Make) -> None:
    successes = {"-1": 10, "0": 8, "3": 0}
    curve = Curve("x", tuple(value(made_result, name, count) for name, count in successes.items()))
    figure = curve_figure(curve, 0.9, "title")
    root = drawn(figure)
    # 820 points of room from 80 on stand for -1 to 3; 240 points up from 256 for 0 to 1.
    across = [80.0, 285.0, 900.0]
    estimates = [wilson(count, 10) for count in successes.values()]
    circles = [(x, 256 - 240 * each.value, 4.0) for x, each in zip(across, estimates, strict=True)]
    assert numbers(of(root, "circle", "cx", "cy", "r")) == [pytest.approx(each) for each in circles]
    bars = [
        f"M{x - 5:.1f} {256 - 240 * each.low:.1f}h10m-5 0V{256 - 240 * each.high:.1f}m-5 0h10"
        for x, each in zip(across, estimates, strict=True)
    ]
    assert [d for (d,) in of(root, "path", "d")] == bars
    lines = numbers(of(root, "line", "x1", "y1", "x2", "y2"))
    scale = [(60, 256 - 48 * k, 920, 256 - 48 * k) for k in range(6)]
    assert lines == [*scale, (60, 256 - 216, 920, 256 - 216)]
    assert [points for (points,) in of(root, "polyline", "points")] == [
        " ".join(f"{coordinate(x)},{coordinate(y)}" for x, y, _ in circles)
    ]
    assert texts(root) == [
        *((f"{k / 5:.1f}", 52.0, 256 - 48 * k + 4) for k in range(6)), ("0.9", 924.0, 44.0),
        *((name, x, 272.0) for name, x in zip(successes, across, strict=True)), ("x", 490.0, 292.0),
    ]  # fmt: skip
    assert (figure.title, figure.width, figure.height) == ("title", 960.0, 300.0)


def test_values_that_are_no_numbers_stand_side_by_side(made_result: Make) -> None:
    curve = Curve("kind", tuple(value(made_result, name, 5) for name in ("a", "b", "c")))
    root = drawn(curve_figure(curve, 0.9, ""))
    assert numbers(of(root, "circle", "cx", "cy")) == [(80, 136), (490, 136), (900, 136)]
    assert not list(root.iter("polyline"))
    alone = drawn(curve_figure(Curve("x", (value(made_result, "7", 5),)), 0.9, ""))
    assert numbers(of(alone, "circle", "cx", "cy")) == [(490, 136)]


def test_labels_that_find_no_room_are_left_out(made_result: Make) -> None:
    """Of values 29 and 31 points apart, with 30 points a label."""
    names = ("0", "29", "31", "820")
    curve = Curve("x", tuple(value(made_result, name, 5) for name in names))
    labels = {words for words, _, y in texts(drawn(curve_figure(curve, 0.9, ""))) if y == 272.0}
    assert labels == {"0", "31", "820"}
