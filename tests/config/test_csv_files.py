"""Changes that spreadsheets make to files, and the limits of maze, floor and robot."""

from __future__ import annotations

import csv
import io
import re
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simmer_tui.config.csv_table import column_letters, read_csv
from simmer_tui.config.loader import load
from simmer_tui.config.maze_csv import load_maze
from simmer_tui.config.new_set import with_comments, with_mission
from simmer_tui.config.sets import bundled_folder, read_files
from simmer_tui.errors import ConfigurationError, Problem

Edit = Callable[[str, str, str], None]
Problems = Callable[..., list[str]]

NAMES = ("maze.csv", "robot.csv", "sensors.csv", "drive.csv")


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda data: b"\xef\xbb\xbf" + data, id="byte-order mark"),
        pytest.param(lambda data: data.replace(b"\n", b"\r\n"), id="CRLF"),
        pytest.param(lambda data: data.replace(b"\n", b"\r"), id="CR alone"),
        pytest.param(lambda data: data.replace(b"\n", b"\r\r\n"), id="CRLF in a text file of Windows"),
        pytest.param(lambda data: data.replace(b"\n", b"\r\n\r\n"), id="doubled CRLF"),
        pytest.param(lambda data: data.replace(b"\n", b"\n\n"), id="doubled LF"),
        pytest.param(lambda data: data + b"\x1a", id="the end of a DOS file"),
        pytest.param(
            lambda data: b"\xef\xbb\xbfsep=;\r\n" + data.replace(b",", b";").replace(b".", b","), id="sep=;"
        ),
        pytest.param(lambda data: b'"sep=,",,,\n' + data, id="sep=, saved again"),
        pytest.param(lambda data: b"sep=\t\r\r\n" + data.replace(b",", b"\t"), id="sep= with a tab"),
        pytest.param(lambda data: b"sep=|\n" + data.replace(b",", b"|"), id="sep=|"),
        pytest.param(lambda data: re.sub(rb"\b([a-z]\d)\b", rb'="\1"', data), id="codes kept as text"),
        pytest.param(lambda data: re.sub(rb",-(\d)", ",\u2212\\1".encode(), data), id="minus signs"),
        pytest.param(lambda data: b"\xef\xbb\xbf\xef\xbb\xbf" + data, id="two byte-order marks"),
        pytest.param(lambda data: data.replace(b",", "\u200b,\u3000\xa0".encode()), id="invisible spaces"),
        pytest.param(lambda data: re.sub(rb",-(\d)", ",-\ufeff\\1".encode(), data), id="mark in a number"),
        pytest.param(lambda data: data.replace(b"\n", b",,,\n"), id="blank trailing columns"),
        pytest.param(lambda data: data + b"\n,,,\n \t\n\n", id="blank trailing rows"),
        pytest.param(lambda data: data.replace(b",", b" ,  "), id="spaces around values"),
        pytest.param(
            lambda data: b'"' + data.replace(b",", b'" , "').replace(b"\n", b'"\n"')[:-1], id="quotes"
        ),
        pytest.param(lambda data: data.rstrip(), id="no newline at the end"),
        pytest.param(lambda data: data.replace(b",", b";"), id="semicolons"),
        pytest.param(
            lambda data: data.replace(b",", b";").replace(b".", b","), id="semicolons and decimal commas"
        ),
        pytest.param(lambda data: data.replace(b",", b"\t"), id="tabs"),
        pytest.param(
            lambda data: data.replace(b",", b"\t").replace(b".", b","), id="tabs and decimal commas"
        ),
    ],
)
def test_files_as_spreadsheets_write_them_mean_the_same(
    folder: Path, change: Callable[[bytes], bytes]
) -> None:
    expected = load(folder).simulation
    for name in NAMES:
        (folder / name).write_bytes(change((folder / name).read_bytes()))
    assert load(folder).simulation == expected


@pytest.mark.parametrize("end", ["\r\r\n", "\r\n", "\r", "\n"])
def test_a_mistake_is_named_at_its_line_under_any_line_ends(
    folder: Path, problems: Problems, end: str
) -> None:
    data = (folder / "maze.csv").read_text("utf-8").splitlines()
    data[2] = data[2].replace("1", "x", 1)
    (folder / "maze.csv").write_bytes(end.join(["sep=,", *data, ""]).encode())
    [problem] = problems()
    assert problem.startswith("maze.csv:4:")


def test_the_tables_of_a_set_are_added_to_under_any_line_ends(folder: Path) -> None:
    files = read_files(folder)
    marked = {
        name: b"sep=;\r\r\n" + data.replace(b",", b";").replace(b"\n", b"\r\r\n") if name in NAMES else data
        for name, data in files.items()
    }
    goal = folder.parent / "more"
    goal.mkdir()
    for name, data in with_comments(with_mission(marked)).items():
        if "/" not in name:
            (goal / name).write_bytes(data)
    assert load(goal).simulation.maze == load(folder).simulation.maze


def test_a_decimal_comma_among_commas_is_named(edit: Edit, problems: Problems) -> None:
    edit("drive.csv", "up,w1,1,0.05,0.02,0.02,0,0,0", "up,w1,1,0,05,0,02,0,02,0,0,0")
    edit("sensors.csv", "ultra2,u2,1,2.12,2.12,", 'ultra2,u2,1,"2,12","-2,12",')
    edit("sensors.csv", "ultra1,u1,1,3,", 'ultra1,u1,1,"3,x",')
    assert sorted(problems()) == [
        "drive.csv:2: the row has 12 cells and the header 9: a number with a decimal comma (0,05) is two "
        "cells; write 0.05 (a column of notes has a blank header)",
        'sensors.csv:2:X Position (in): must be a number, not "3,x"',
        'sensors.csv:3:X Position (in): must be a number, not "2,12"; write 2.12',
        'sensors.csv:3:Y Position (in): must be a number, not "-2,12"; write -2.12',
    ]


@pytest.mark.parametrize("separator", [",", ";"])
def test_a_column_of_notes_may_hold_numbers(folder: Path, edit: Edit, separator: str) -> None:
    expected = load(folder).simulation
    # Spreadsheets write as many cells in the header row as in the others; semicolons leave no doubt.
    edit("drive.csv", "Rotation Bias\n", "Rotation Bias,\n" if separator == "," else "Rotation Bias\n")
    edit("drive.csv", "up,w1,1,0.05,0.02,0.02,0,0,0", "up,w1,1,0.05,0.02,0.02,0,0,0,2026")
    path = folder / "drive.csv"
    path.write_text(path.read_text().replace(",", separator))
    assert load(folder).simulation == expected


@pytest.mark.parametrize("name", [*NAMES, "settings.toml"])
@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le"])
def test_utf16_is_one_clear_problem(folder: Path, problems: Problems, name: str, encoding: str) -> None:
    (folder / name).write_text((folder / name).read_text(), encoding=encoding)
    (line,) = problems()
    assert line.startswith(f"{name}: is not UTF-8 text but UTF-16")


@pytest.mark.parametrize("name", [*NAMES, "settings.toml"])
def test_byte_that_is_not_utf8_is_one_problem_with_its_line(
    folder: Path, problems: Problems, name: str
) -> None:
    first, rest = (folder / name).read_bytes().split(b"\n", 1)
    (folder / name).write_bytes(first + b"\n# \xe9" + rest)
    (line,) = problems()
    assert line.startswith(f"{name}:2: holds the byte 0xe9, which is not UTF-8; save it as")


@pytest.mark.parametrize("name", [*NAMES, "settings.toml"])
def test_missing_file_is_a_problem_that_names_init(folder: Path, problems: Problems, name: str) -> None:
    (folder / name).unlink()
    (line,) = problems()
    assert line.startswith(f"{name}: is missing from ")
    assert "simmer-tui init DIR" in line


@pytest.mark.parametrize("name", [*NAMES, "settings.toml"])
def test_folder_in_place_of_a_file_is_a_problem(folder: Path, problems: Problems, name: str) -> None:
    (folder / name).unlink()
    (folder / name).mkdir()
    (line,) = problems()
    assert line.startswith(f"{name}: cannot be read: ")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("text", ["", "\n\n", ",,\n,,\n"])
def test_empty_file_is_a_problem(folder: Path, problems: Problems, name: str, text: str) -> None:
    (folder / name).write_text(text)
    assert problems() == [f"{name}:1: the file is empty"]


def test_quote_never_closed_loses_no_rows_silently(edit: Edit, problems: Problems) -> None:
    edit("sensors.csv", "ultra3,u3,1,-3,0,6,180,0.02,5,", 'ultra3,u3,1,-3,0,6,180,0.02,5,,"my note')
    assert problems() == ['sensors.csv:4: a quote (") is opened and never closed']


def test_line_numbers_count_lines_inside_quoted_cells(edit: Edit, problems: Problems) -> None:
    edit("sensors.csv", "ultra1,u1,1,3,0,6,0,0.02,5,", 'ultra1,u1,1,3,0,6,0,0.02,5,,"two\nlines"')
    edit("sensors.csv", "ultra3,u3,1", "ultra3,u3,7")
    assert problems() == ['sensors.csv:5:Enabled: must be 0 (off) or 1 (on), not "7"']


def test_column_letters_are_those_of_spreadsheets() -> None:
    assert [column_letters(index) for index in (0, 25, 26, 51, 52, 99, 701, 702)] == [
        "A", "Z", "AA", "AZ", "BA", "CV", "ZZ", "AAA",
    ]  # fmt: skip


@given(st.binary(max_size=300))
def test_any_bytes_read_as_csv_give_rows_or_problems(data: bytes) -> None:
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "maze.csv"
        path.write_bytes(data)
        found: list[Problem] = []
        assert (read_csv(path, found) is None) == bool(found)


@st.composite
def grids(draw: st.DrawFn, highest: int) -> list[list[int]]:
    rows, columns = draw(st.integers(1, 8)), draw(st.integers(1, 8))
    return [[draw(st.integers(0, highest)) for _ in range(columns)] for _ in range(rows)]


@given(
    grid=grids(3),
    mark=st.booleans(),
    end=st.sampled_from(["\n", "\r\n"]),
    quoting=st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL]),
    blank_columns=st.integers(0, 3),
    blank_rows=st.integers(0, 3),
    padding=st.sampled_from(["", " ", "  "]),
)
def test_any_maze_survives_being_written_by_a_spreadsheet(
    grid: list[list[int]],
    mark: bool,
    end: str,
    quoting: int,
    blank_columns: int,
    blank_rows: int,
    padding: str,
) -> None:
    out = io.StringIO(newline="")
    writer = csv.writer(out, lineterminator=end, quoting=quoting)  # type: ignore[arg-type]  # an int constant
    for row in grid:
        writer.writerow([f"{padding}{value}{padding}" for value in row] + [""] * blank_columns)
    for _ in range(blank_rows):
        writer.writerow([""] * (len(grid[0]) + blank_columns))
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "maze.csv"
        path.write_bytes((b"\xef\xbb\xbf" if mark else b"") + out.getvalue().encode())
        found: list[Problem] = []
        spec = load_maze(Path(name), found)
    assert not found
    assert spec is not None
    assert spec.cells == tuple(tuple(row) for row in grid)


def test_maze_values_other_than_0_to_3_are_named_cell_by_cell(folder: Path, problems: Problems) -> None:
    (folder / "maze.csv").write_text("1,4,1\n1,1,x\n1.5,,-1\n")
    allowed = "must be 0 (wall), 1 (empty), 2 (robot start) or 3 (block)"
    assert problems() == [
        f'maze.csv:1:B: {allowed}, not "4"',
        f'maze.csv:2:C: {allowed}, not "x"',
        f'maze.csv:3:A: {allowed}, not "1.5"',
        f"maze.csv:3:B: is blank; {allowed}",
        f'maze.csv:3:C: {allowed}, not "-1"',
    ]


def test_maze_that_is_no_rectangle_names_the_odd_row(folder: Path, problems: Problems) -> None:
    (folder / "maze.csv").write_text("1,1\n1,1,1\n1,1,1\n\n1,1,1\n")
    assert problems() == [
        "maze.csv:1:C: the row has 2 cells, others have 3; all rows must be equally long",
        "maze.csv:4:A: the row has 0 cells, others have 3; all rows must be equally long",
    ]


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 100), (100, 1), (100, 100)])
def test_mazes_from_one_cell_to_a_hundred_square_are_accepted(
    folder: Path, edit: Edit, problems: Problems, rows: int, columns: int
) -> None:
    (folder / "maze.csv").write_text("\n".join([",".join("1" * columns)] * rows))
    edit("settings.toml", "[9.5, 42.0]", "[6, 6]")
    edit("settings.toml", "[25.0, 41.0]", "[6, 6]")
    assert problems() == []


@pytest.mark.parametrize(("rows", "columns"), [(101, 1), (1, 101)])
def test_maze_beyond_a_hundred_cells_a_side_is_refused(
    folder: Path, problems: Problems, rows: int, columns: int
) -> None:
    (folder / "maze.csv").write_text("\n".join([",".join("1" * columns)] * rows))
    assert problems() == [f"maze.csv: has {rows} x {columns} cells; a maze has at most 100 a side"]


def test_floor_file_replaces_the_generated_floor(folder: Path) -> None:
    tiles = [[(row + column) % 2 for column in range(32)] for row in range(16)]
    (folder / "floor.csv").write_text("\n".join(",".join(map(str, row)) for row in tiles))
    assert load(folder).simulation.maze.floor == tuple(tuple(row) for row in tiles)


def test_floor_of_the_wrong_size_or_with_wrong_tiles_is_refused(folder: Path, problems: Problems) -> None:
    (folder / "floor.csv").write_text("0,1\n1,0\n")
    assert problems() == ["floor.csv: has 2 x 2 tiles; the maze needs 16 x 32, 4 by 4 to a cell"]
    (folder / "floor.csv").write_text("0,2\n")
    assert problems() == ['floor.csv:1:B: must be 0 (black) or 1 (white), not "2"']


def robot_of(folder: Path, text: str) -> tuple[float | None, tuple[tuple[float, float], ...]]:
    (folder / "robot.csv").write_text(text)
    robot = load(folder).simulation.robot
    return robot.radius, robot.vertices


def test_robot_shapes_circle_rectangle_and_polygon(folder: Path) -> None:
    assert robot_of(folder, "shape,0\ndiameter,5\n") == (2.5, ())
    assert robot_of(folder, ",0\n,5\n,not used\n") == (2.5, ())
    assert robot_of(folder, "shape,1\nx,6\ny,4\n") == (None, ((3, 2), (-3, 2), (-3, -2), (3, -2)))
    triangle = ((3.0, 0.0), (-2.0, 2.0), (-2.0, -2.0))
    assert robot_of(folder, "shape,2\na,3,0\nb,-2,2\nc,-2,-2\n") == (None, triangle)


def test_robot_polygon_may_be_closed_or_not_and_wind_either_way(folder: Path) -> None:
    closed = robot_of(folder, "shape,2\na,3,0\nb,-2,2\nc,-2,-2\na,3,0\n")
    assert closed == robot_of(folder, "shape,2\na,3,0\nb,-2,2\nc,-2,-2\n")
    clockwise = robot_of(folder, "shape,2\n,3,0\n,-2,-2\n,-2,2\n")
    assert clockwise == (None, ((3, 0), (-2, -2), (-2, 2)))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("s,3\n", 'robot.csv:1:B: the shape must be 0 (circle), 1 (rectangle) or 2 (polygon), not "3"'),
        ("s\n", "robot.csv:1:B: the shape is blank; must be 0 (circle), 1 (rectangle) or 2 (polygon)"),
        (
            "s,0\nd,0\n",
            'robot.csv:2:B: the diameter (in) must be a number above 0 and at most 12, not "0"',
        ),
        ("s,0\nd,12.1\n", "robot.csv:2:B: the diameter (in) must be a number above 0 and at most 12"),
        ("s,0\n", "robot.csv:2:B: the diameter (in) is blank; must be a number above 0 and at most 12"),
        ("s,1\nx,6\n", "robot.csv:3:B: the y-size (in) is blank; must be a number above 0 and at most 12"),
        ("s,1\nx,nan\ny,6\n", "robot.csv:2:B: the x-size (in) must be a number above 0"),
        ("s,0\nd,6\n,\nv,1,2\n", "robot.csv:4:B: a circle or rectangle ends with row 3; only shape 2"),
        ("s,2\n", "robot.csv:1:B: the outline has 0 different vertices; a polygon needs at least 3"),
        ("s,2\n,1,1\n,1,1\n,-1,1\n,1,1\n", "robot.csv:2:B: the outline has 2 different vertices"),
        ("s,2\n,1,1\n,-1,-1\n,1,-1\n,-1,1\n", "robot.csv:2:B: the outline crosses or touches itself"),
        ("s,2\n,0,0\n,1,0\n,-1,0\n", "robot.csv:2:B: the outline crosses or touches itself"),
        ("s,2\n,1,1\n,3,1\n,3,3\n", "robot.csv:2:B: the outline must contain the origin"),
        ("s,2\n,7,0\n,-6,2\n,-6,-2\n", "robot.csv:2:B: the outline is 13 x 4 in; it must fit a square of 12"),
        ("s,2\n,13,0\n,-1,2\n,-1,-2\n", "robot.csv:2:B: the vertex's x (in) must be a number from -12 to 12"),
        ("s,2\n,1,0\n,-1\n,-1,-2\n", "robot.csv:3:C: the vertex's y (in) is blank"),
        ("s,2\n,1,0\n\n,-1,-2\n,2,1\n", "robot.csv:3:B: the vertex's x (in) is blank"),
    ],
)
def test_robot_mistakes_are_named(folder: Path, problems: Problems, text: str, expected: str) -> None:
    (folder / "robot.csv").write_text(text)
    assert problems()[0].startswith(expected)


@pytest.mark.slow
def test_a_file_of_thousands_of_mistakes_shows_the_first_twenty(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    shutil.copytree(bundled_folder(), folder, ignore=shutil.ignore_patterns("*/"))
    rows = "".join(f"ultra{n},u{n},x,y\n" for n in range(32_000))
    (folder / "sensors.csv").write_text((folder / "sensors.csv").read_text() + rows)
    with pytest.raises(ConfigurationError) as refused:
        load(folder)
    lines = str(refused.value).splitlines()
    assert len(refused.value.problems) > 32_000
    assert len(lines) == 21
    assert lines[-1] == f"and {len(refused.value.problems) - 20} more"
    assert len(str(refused.value)) < 6000
