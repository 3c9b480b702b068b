"""drive.csv: a header row, then at most one row for each way to move, and one for the gripper."""

from __future__ import annotations

from pathlib import Path

from simmer_tui.config.codes import (
    CODE_MEANING,
    ENABLED,
    ENABLED_MEANING,
    ENABLED_RULE,
    ID,
    POLL_CHARACTER,
    claim_id,
    read_code,
)
from simmer_tui.config.csv_table import TableRow, read_csv, read_table
from simmer_tui.errors import Problem
from simmer_tui.sim.rules import ChoiceRule, NumberRule
from simmer_tui.sim.specs import Axes, DriveKind, DriveSpec, GripperSpec

FILE = "drive.csv"
TRANSLATION_SPEED = 6.0
"""Speed of a translation unless its row says otherwise, in/s."""
ROTATION_SPEED = 120.0
"""Speed of a rotation unless its row says otherwise, deg/s."""
GRIPPER = "grip"
"""The ID of the gripper's row."""

# The file has Y before X; the fields of Axes are x, y, r.
_ERRORS = ("X-Axis Error", "Y-Axis Error", "Rotation Error")
_BIASES = ("X-Axis Bias", "Y-Axis Bias", "Rotation Bias")
_GAIN, _SPEED, _REACH, _WIDTH = "Gain", "Speed", "Reach", "Width"
_START_LAG, _ACCELERATION = "Start Lag (s)", "Acceleration"

HEADERS = (
    ID,
    POLL_CHARACTER,
    ENABLED,
    "Y-Axis Error",
    "X-Axis Error",
    "Rotation Error",
    "Y-Axis Bias",
    "X-Axis Bias",
    "Rotation Bias",
)
OPTIONAL_HEADERS = (_GAIN, _SPEED)
PACE_HEADERS = (_START_LAG, _ACCELERATION)
GRIPPER_HEADERS = (_REACH, _WIDTH)

_OF_EACH = "for each inch (degree, for rot) commanded, in inches (degrees, for rotation)"
MEANINGS = {
    ID: "which movement: " + "; ".join(f"{kind.value} {kind.meaning}" for kind in DriveKind) + "; "
    "grip opens and closes the gripper",
    POLL_CHARACTER: CODE_MEANING,
    ENABLED: ENABLED_MEANING,
    "Y-Axis Error": f"standard deviation of the random error to the left, {_OF_EACH}",
    "X-Axis Error": "the same to the front",
    "Rotation Error": "the same of the heading",
    "Y-Axis Bias": "error to the left that is always there, likewise; only with randbias = false",
    "X-Axis Bias": "the same to the front",
    "Rotation Bias": "the same of the heading",
    _GAIN: "what the commanded value is multiplied by (1)",
    _SPEED: f"inches, degrees or (grip) closings a second ({TRANSLATION_SPEED:g}, {ROTATION_SPEED:g}, 2)",
    _START_LAG: "simulated time from a command to the first motion (0)",
    _ACCELERATION: "inches or degrees per second squared (0: full speed at once)",
    _REACH: "grip only: how far ahead of the robot it takes a block by its centre, inches (3)",
    _WIDTH: "grip only: how wide that window is, inches (4)",
}
"""What each column says; in brackets what a blank cell means."""

_KIND = ChoiceRule((*(kind.value for kind in DriveKind), GRIPPER))
_SIZE = NumberRule(0, low_open=True)


def load_drives(
    directory: Path, codes: dict[str, str], problems: list[Problem]
) -> tuple[tuple[DriveSpec, ...], GripperSpec | None]:
    """Read drive.csv: the ways to move, and the gripper if there is one. Rows with mistakes are
    left out, with a problem each.

    `codes` maps codes in use to their places, and is added to.
    """
    table = read_csv(directory / FILE, problems)
    if table is None:
        return (), None
    seen: dict[str, int] = {}
    rows = read_table(table, HEADERS, (*OPTIONAL_HEADERS, *PACE_HEADERS, *GRIPPER_HEADERS), problems)
    specs = [_read_row(row, seen, codes, problems) for row in rows]
    grippers = [spec for spec in specs if isinstance(spec, GripperSpec)]
    return tuple(spec for spec in specs if isinstance(spec, DriveSpec)), grippers[0] if grippers else None


def _read_row(
    row: TableRow, seen: dict[str, int], codes: dict[str, str], problems: list[Problem]
) -> DriveSpec | GripperSpec | None:
    text = row.values.get(ID, "").lower()
    if text == GRIPPER:
        return _read_gripper(row, seen, codes, problems)
    name = row.read(ID, _KIND, problems)
    is_new = name is not None and claim_id(name, row, seen, problems)
    code = read_code(row, codes, problems)
    enabled = row.read(ENABLED, ENABLED_RULE, problems)
    error = _read_axes(row, _ERRORS, NumberRule(0), problems)
    bias = _read_axes(row, _BIASES, NumberRule(), problems)
    gain = row.read(_GAIN, NumberRule(), problems) if row.values.get(_GAIN) else 1.0
    turns = name is not None and DriveKind(name).turns
    default_speed = ROTATION_SPEED if turns else TRANSLATION_SPEED
    speed = row.read(_SPEED, _SIZE, problems) if row.values.get(_SPEED) else default_speed
    lag, acceleration = (
        row.read(column, NumberRule(0), problems) if row.values.get(column) else 0.0
        for column in PACE_HEADERS
    )
    for column in GRIPPER_HEADERS:
        if name is not None and row.values.get(column):
            what = f"is for {GRIPPER} only; leave it blank for {name}"
            problems.append(Problem(row.where(column), what))
    if name is None or not is_new or code is None or enabled is None:
        return None
    if error is None or bias is None or gain is None or speed is None or lag is None or acceleration is None:
        return None
    return DriveSpec(
        kind=DriveKind(name),
        code=code,
        enabled=enabled == 1,
        error=error,
        bias=bias,
        gain=gain,
        speed=speed,
        start_lag=lag,
        acceleration=acceleration,
    )


def _read_gripper(
    row: TableRow, seen: dict[str, int], codes: dict[str, str], problems: list[Problem]
) -> GripperSpec | None:
    """The row `grip`. What its cells for errors and biases hold changes nothing."""
    before = len(problems)
    for column in (_GAIN, *PACE_HEADERS):
        if row.values.get(column):
            what = f"is for movements only; leave it blank for {GRIPPER}"
            problems.append(Problem(row.where(column), what))
    claim_id(GRIPPER, row, seen, problems)
    code = read_code(row, codes, problems)
    enabled = row.read(ENABLED, ENABLED_RULE, problems)
    columns = {_REACH: "reach", _WIDTH: "width", _SPEED: "speed"}
    values = {
        field: row.read(column, _SIZE, problems)
        for column, field in columns.items()
        if row.values.get(column)
    }
    if len(problems) > before or code is None or enabled is None:
        return None
    given = {field: value for field, value in values.items() if value is not None}
    return GripperSpec(code=code, enabled=enabled == 1, **given)


def _read_axes(
    row: TableRow, columns: tuple[str, str, str], rule: NumberRule, problems: list[Problem]
) -> Axes | None:
    """Three cells, given in the order x, y, rotation."""
    x, y, r = (row.read(column, rule, problems) for column in columns)
    return None if x is None or y is None or r is None else Axes(x, y, r)
