"""The page of a calibration: the picture of the path and the tables, against what the fit holds."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simmer_tui.calibrate.change_detection import PartVerdict
from simmer_tui.calibrate.estimates import estimates_of
from simmer_tui.calibrate.fit import Fit, fit_path
from simmer_tui.calibrate.posterior import COUNTER, OBSERVATION, PROCESS, RANGE, START_POSE
from simmer_tui.calibrate.result_page import (
    check_document,
    figures_table,
    path_pictures,
    residual_table,
    result_document,
    result_page,
)
from simmer_tui.document import svg
from simmer_tui.document.as_data import document_value
from simmer_tui.document.as_html import html_page
from simmer_tui.document.model import DataTable, Figure, Paragraph
from tests.report.browser import SIZES, measured


@pytest.fixture
def picture(found: Fit) -> tuple[Fit, ElementTree.Element]:
    """The picture of a path of which the third and the last movement met a wall, and a fit that is a little
    sure of some poses and hardly of others."""
    contacts = np.zeros_like(found.state.contacts)
    contacts[[2, -1]] = True
    spread = found.pose_spread.copy()
    spread[:, :2] = 0.01
    spread[4, :2], spread[7, :2] = (0.3, 0.7), (0.9, 0.2)
    made = replace(found, state=replace(found.state, contacts=contacts), pose_spread=spread)
    figure, note = path_pictures(made)
    assert isinstance(figure, Figure)
    assert isinstance(note, Paragraph)
    maze = found.run.spec.maze
    assert (figure.width, figure.height) == (960.0, pytest.approx(960.0 * maze.height / maze.width))
    return made, ElementTree.fromstring(f"<svg>{figure.content}</svg>")


def numbers(element: ElementTree.Element, *names: str) -> list[float]:
    return [float(element.attrib[name]) for name in names]


def test_the_path_goes_from_stop_to_stop_and_from_dark_to_light(
    picture: tuple[Fit, ElementTree.Element],
) -> None:
    made, root = picture
    scale = 960.0 / made.run.spec.maze.width
    height = made.run.spec.maze.height * scale
    places = [(x * scale, height - y * scale) for x, y in made.poses[:, :2].tolist()]
    lines = [*root.iter("line")]
    assert len(lines) == len(places) - 1 == len(made.run.movements)
    for k, line in enumerate(lines):
        assert numbers(line, "x1", "y1", "x2", "y2") == pytest.approx([*places[k], *places[k + 1]], abs=0.006)
        assert line.get("stroke") == svg.shade(k / len(places))
        assert 1.0 <= float(line.get("stroke-width", "")) <= 2.0
    circles = [*root.iter("circle")]
    assert len(circles) == len(places)
    for k, circle in enumerate(circles):
        assert numbers(circle, "cx", "cy") == pytest.approx(places[k], abs=0.006)
    fills = [each.get("fill") for each in circles]
    met = {3, len(places) - 1}
    assert fills == [svg.CONTACT if k in met else svg.shade(k / len(places)) for k in range(len(places))]


def test_discs_are_as_wide_as_places_are_unsure(picture: tuple[Fit, ElementTree.Element]) -> None:
    """Two standard deviations, by the axis that is less sure; 2 points at the least."""
    made, root = picture
    scale = 960.0 / made.run.spec.maze.width
    radii = [numbers(each, "r")[0] for each in root.iter("circle")]
    assert radii[4] == pytest.approx(1.4 * scale, abs=0.006)
    assert radii[7] == pytest.approx(1.8 * scale, abs=0.006)
    assert {*radii[:4], *radii[8:]} == {2.0}


def test_walls_are_drawn_where_they_are(picture: tuple[Fit, ElementTree.Element]) -> None:
    made, root = picture
    cells = np.array(made.run.spec.maze.cells)
    side = 960.0 / cells.shape[1]
    walls = [(column * side, row * side) for row, column in zip(*np.nonzero(cells == 0), strict=True)]
    drawn = [numbers(each, "x", "y") for each in root.iter("rect")]
    assert np.array(drawn) == pytest.approx(np.array([*walls, (0.0, 0.0)]), abs=0.006)
    sizes = [numbers(each, "width", "height") for each in root.iter("rect")]
    assert np.array(sizes[:-1]) == pytest.approx(side, abs=0.006)
    assert sizes[-1] == pytest.approx([960.0, side * cells.shape[0]], abs=0.006)


def test_residuals_are_medians_before_and_after(found: Fit) -> None:
    table = residual_table(found)
    before = found.model.rows(fit_path(found.run, found.space, *found.space.of(found.run.spec), found.state))
    by_part: dict[Any, tuple[Any, ...]] = {(row[0], row[1]): row[2:] for row in table.rows}
    ids, readings = [s.id for s in found.run.spec.sensors], (RANGE, COUNTER, OBSERVATION)
    for part, unit in (("ultra1", "in"), ("odom2", "in"), ("comp1", "deg")):
        medians = [
            np.median(
                np.abs(rows.residuals[np.isin(rows.family, readings) & (rows.source == ids.index(part))])
            )
            for rows in (before, found.rows)
        ]
        assert by_part[part, unit] == pytest.approx(medians, rel=1e-6)
    # A drive's rows are told apart from those of a sensor of the same number by their family.
    for axes, unit in ((slice(0, 2), "in"), (slice(2, 3), "deg")):
        medians = []
        for rows in (before, found.rows):
            moved = rows.family == PROCESS
            by_axis = rows.residuals[moved].reshape(3, -1)
            of_rot = (rows.source[moved] == 4).reshape(3, -1)
            medians.append(np.median(np.abs(by_axis[axes][of_rot[axes]])))
        assert by_part["rot", unit] == pytest.approx(medians, rel=1e-6)
    assert ("tof1", "in") not in by_part, "it was never read"
    assert {unit for _, unit in by_part} == {"in", "deg"}


def test_a_sensor_whose_readings_all_drop_out_has_no_medians(found: Fit) -> None:
    index = [each.id for each in found.run.spec.sensors].index("ultra1")
    mine = (found.rows.family == RANGE) & (found.rows.source == index)
    rows = replace(found.rows, family=np.where(mine, START_POSE, found.rows.family))
    parts = {row[0] for row in residual_table(replace(found, rows=rows)).rows}
    assert "ultra1" not in parts
    assert "ultra2" in parts


def test_numbers_stand_below_each_other(found: Fit) -> None:
    table = figures_table(estimates_of(found))
    numeric = {column.key: column.format.numeric for column in table.columns}
    assert {key for key, right in numeric.items() if right} >= {"is", "interval", "was"}
    assert not numeric["part"]


def test_a_check_names_each_part_once() -> None:
    parts = [
        PartVerdict("rot", 0.00012, True, (("a", 1.0, 2.0, 0.1), ("b", 3.0, 4.0, 0.2))),
        PartVerdict("up", 0.5, False, (("c", 1.0, 1.0, 0.1),)),
    ]
    table, answer = check_document(parts).parts
    assert isinstance(table, DataTable)
    assert isinstance(answer, Paragraph)
    assert [row[3] for row in table.rows] == ["rot", None, "up"]
    assert [row[-1] for row in table.rows] == ["changed (p = 0.00012)", None, "unchanged (p = 0.5)"]
    assert table.rows[1][4:8] == ("b", 3.0, 4.0, 0.2)
    assert answer.text == "Changed: rot"
    with_unit, _ = check_document([replace(parts[0], units=("in", ""))]).parts
    assert isinstance(with_unit, DataTable)
    assert [each["unit"] for each in with_unit.objects()] == ["in", None]
    unchanged = check_document(parts[1:]).parts[1]
    assert isinstance(unchanged, Paragraph)
    assert unchanged.text == "The robot behaves as the set says."


# -- the page ------------------------------------------------------------------------------------------


def test_the_page_begins_with_the_answer_and_what_differs(found: Fit) -> None:
    page = html_page(result_page(found, estimates_of(found), None))
    words = (
        "class='verdict good'",
        "class='figures'",
        "differs from the set",
        "<svg",
        "<details>",
        "Residuals",
    )
    places = [page.index(word, page.index("<body>")) for word in words]
    assert places == sorted(places)
    # A table that is folded on the page is a table like all others to a program.
    assert {"parameters", "residuals"} <= set(
        document_value(result_document(found, estimates_of(found), None))
    )


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
def test_the_first_screenful_has_the_answer(found: Fit, size: str, tmp_path: Path) -> None:
    page = tmp_path / "calibration.html"
    page.write_text(html_page(result_page(found, estimates_of(found), None)), "utf-8")
    seen = measured(page, size)
    width, height = SIZES[size]
    assert seen["edges"][".verdict"] < seen["edges"][".figures"] <= height
    assert seen["width"] <= width
    assert seen["broken"] == []
