"""drive.csv: a header row, then at most one row for each way to move, for the gripper, and for each command
of continuous motion."""

from pathlib import Path

from msgspec import Struct

from simmer_tui.config.csv_table import (
    CODE,
    ENABLED,
    ID,
    TableRow,
    claim_id,
    read_csv,
    read_flags,
    read_table,
)
from simmer_tui.errors import Problem
from simmer_tui.sim import columns
from simmer_tui.sim.columns import CsvColumn
from simmer_tui.sim.rules import ChoiceRule
from simmer_tui.sim.specs import DriveKind, DriveSpec, GripperSpec, VelocityKind, VelocitySpec
from simmer_tui.sim.values import with_values

FILE = "drive.csv"
GRIPPER_ID = "grip"
"""The ID of the gripper's row."""
COLUMNS: tuple[CsvColumn, ...] = (
    CsvColumn(
        ChoiceRule((*(kind.value for kind in DriveKind), GRIPPER_ID, *(kind.value for kind in VelocityKind))),
        "the movement: " + "; ".join(f"{kind.value} {kind.meaning}" for kind in DriveKind) + "; "
        "grip opens and closes the gripper; velocity and velocity-x, -y, -r set a velocity that lasts; "
        "wheels sets rim speeds",
        *("", ID, "id"),
        needed=True,
    ),
    *(CODE, ENABLED, *columns.MOVEMENT, columns.REACH, columns.WIDTH),
)
"""All columns, in the order in which files have them."""
REQUIRED = tuple(column.name for column in COLUMNS if column.needed)
OPTIONAL = tuple(column.name for column in COLUMNS if not column.needed)
_ONLY_MOVEMENTS = [
    column.name for column in columns.MOVEMENT if not column.needed and column is not columns.SPEED
]
VELOCITY_CODES = ("vv", "vx", "vy", "vr", "ww")
"""Codes of the commands of continuous motion in bundled and imported sets, in the order of `VelocityKind`."""
_VELOCITIES = frozenset(kind.value for kind in VelocityKind)
_ONLY_GRIPPER = (columns.REACH.name, columns.WIDTH.name)
_ONLY_OTHERS = (*_ONLY_MOVEMENTS, columns.SPEED.name, *_ONLY_GRIPPER)


class DriveRows(Struct, frozen=True):
    """The rows of drive.csv by their purpose."""

    drives: tuple[DriveSpec, ...] = ()
    gripper: GripperSpec | None = None
    velocities: tuple[VelocitySpec, ...] = ()


def load_drives(directory: Path, codes: dict[str, str], problems: list[Problem]) -> DriveRows:
    """Read drive.csv. Rows with mistakes are left out, with a problem each.

    `codes` maps codes in use to their places, and is added to.
    """
    table = read_csv(directory / FILE, problems)
    if table is None:
        return DriveRows()
    seen: dict[str, int] = {}
    specs = [_read_row(row, seen, codes) for row in read_table(table, REQUIRED, OPTIONAL)]
    return DriveRows(
        tuple(spec for spec in specs if isinstance(spec, DriveSpec)),
        next((spec for spec in specs if isinstance(spec, GripperSpec)), None),
        tuple(spec for spec in specs if isinstance(spec, VelocitySpec)),
    )


def _read_row(
    row: TableRow, seen: dict[str, int], codes: dict[str, str]
) -> DriveSpec | GripperSpec | VelocitySpec | None:
    before = len(row.problems)
    name: str | None = row.cells(COLUMNS[:1]).get("id")
    if name is not None:
        claim_id(name, row, seen)
    values = read_flags(row, codes)
    if name in _VELOCITIES:
        row.refuse(_ONLY_OTHERS, f"has no effect for {name}: leave it blank")
    elif name == GRIPPER_ID:
        row.refuse(_ONLY_MOVEMENTS, f"is for movements only; leave it blank for {GRIPPER_ID}")
        values |= row.cells(columns.GRIPPER)
    else:
        values |= row.cells(columns.MOVEMENT)
        if name is not None:
            row.refuse(_ONLY_GRIPPER, f"is for {GRIPPER_ID} only; leave it blank for {name}")
    if name is None or len(row.problems) > before or not row.has(COLUMNS):
        return None
    if name in _VELOCITIES:
        return with_values(VelocitySpec(kind=VelocityKind(name), code=""), values)
    if name == GRIPPER_ID:
        return with_values(GripperSpec(code=""), values)
    kind = DriveKind(name)
    speed = columns.ROTATION_SPEED if kind.turns else columns.TRANSLATION_SPEED
    return with_values(DriveSpec(kind=kind, code="", speed=speed), values)
