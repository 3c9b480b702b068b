"""robot.csv: labels in column A, values in column B (and C for the vertices of a polygon)."""

from pathlib import Path

from simmer_tui.config.csv_table import CsvRow, CsvTable, T, read_csv
from simmer_tui.errors import Problem
from simmer_tui.sim.rules import IntegerRule, NumberRule, Rule
from simmer_tui.sim.specs import CELL_SIZE, RobotSpec

FILE = "robot.csv"
_B, _C = 1, 2
_CIRCLE, _RECTANGLE, _POLYGON = range(3)

_SHAPE = IntegerRule(0, 2, "0 (circle), 1 (rectangle) or 2 (polygon)")
_SIZES = {_CIRCLE: ("diameter (in)",), _RECTANGLE: ("x-size (in)", "y-size (in)")}
# A robot larger than a cell could not drive through a corridor of the maze.
_SIZE = NumberRule(0, CELL_SIZE, low_open=True)
# An outline around the origin that fits into the square has no points beyond.
_COORDINATE = NumberRule(-CELL_SIZE, CELL_SIZE)

ROWS = {
    "Shape": "0 a circle; 1 a rectangle; 2 a polygon",
    "Diameter or x-size (in)": "of a circle the diameter; of a rectangle its length from rear to front",
    "y-size (in)": "of a rectangle its width from side to side; a circle does without",
    "vertices": "of a polygon, in place of the sizes: a row a corner, x (ahead) and y (left) in B and C",
}
"""The meaning of each row, whose values are in column B. Lengths are inches."""

Vertex = tuple[float, float]


def load_robot(directory: Path, problems: list[Problem]) -> RobotSpec | None:
    """Read robot.csv; None, and problems, if it has mistakes."""
    table = read_csv(directory / FILE, problems)
    if table is None:
        return None
    shape = _read_cell(table, 0, _B, "shape", _SHAPE)
    if shape in _SIZES:
        sizes = [_read_cell(table, row, _B, name, _SIZE) for row, name in enumerate(_SIZES[shape], 1)]
        is_complete = _refuse_further_rows(table)
        given = [size for size in sizes if size is not None]
        if not is_complete or len(given) < len(sizes):
            return None
        return RobotSpec.circle(*given) if shape == _CIRCLE else RobotSpec.rectangle(*given)
    return _read_polygon(table) if shape == _POLYGON else None


def _read_cell(table: CsvTable, index: int, column: int, name: str, rule: Rule[T]) -> T | None:
    """The value in row `index`; None, and a problem, if it is missing or wrong."""
    row = table.rows[index] if index < len(table.rows) else CsvRow(table.rows[-1].line + 1, ())
    return table.value(row, column, rule, name)


def _refuse_further_rows(table: CsvTable) -> bool:
    """Report values below row 3: they are probably the vertices of a polygon whose shape is not set to 2."""
    further = [row for row in table.rows[3:] if row.cell(_B) or row.cell(_C)]
    if further:
        what = "a circle or rectangle ends with row 3; only shape 2, a polygon, has more rows"
        table.add_problem(further[0], _B, what)
    return not further


def _read_polygon(table: CsvTable) -> RobotSpec | None:
    vertices: list[Vertex] = []
    before = len(table.problems)
    for index in range(1, len(table.rows)):
        x = _read_cell(table, index, _B, "vertex's x (in)", _COORDINATE)
        y = _read_cell(table, index, _C, "vertex's y (in)", _COORDINATE)
        if x is not None and y is not None and (x, y) not in vertices[-1:]:
            vertices.append((x, y))
    if len(table.problems) > before:
        return None
    if len(vertices) > 1 and vertices[0] == vertices[-1]:
        vertices.pop()
    what = outline_fault(vertices)
    if what:
        table.add_problem(table.rows[min(1, len(table.rows) - 1)], _B, what)
        return None
    return RobotSpec.polygon(tuple(vertices))


def outline_fault(vertices: list[Vertex]) -> str:
    """The reason why a polygon (inches, robot's frame) cannot be a robot's outline; empty if it can."""
    import shapely

    if len(vertices) < 3:
        return f"the outline has {len(vertices)} different vertices; a polygon needs at least 3"
    outline = shapely.Polygon(vertices)
    if not outline.is_valid or outline.area == 0:
        return "the outline crosses or touches itself; it must be simple, its vertices in order around it"
    if not outline.covers(shapely.Point(0, 0)):
        return "the outline must contain the origin (0, 0), the robot's centre"
    left, bottom, right, top = outline.bounds
    if right - left > CELL_SIZE or top - bottom > CELL_SIZE:
        return (
            f"the outline is {right - left:g} x {top - bottom:g} in; "
            f"it must fit a square of {CELL_SIZE:g} x {CELL_SIZE:g} in"
        )
    return ""
