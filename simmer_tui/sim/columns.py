"""Columns of sensors.csv as data: name, limits, what a blank cell means. The loader reads by them.

The course's file has ten columns; the last seven of them, `BASE`, stand here with the optional
ones. A kind of sensor lists those that mean something to it; it may narrow one with
`dataclasses.replace`, or bring one of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """One column: its header, the field of `SensorSpec` it fills, and which cells are allowed.

    A number from `low` to `high` (an open end excludes the bound itself), `whole` or not; or, if
    there are `words`, one of them, each with the value it stands for.
    """

    header: str
    field: str
    label: str = ""
    """What the summary of a set calls it; empty if it has a place of its own there."""
    low: float = -math.inf
    high: float = math.inf
    low_open: bool = False
    high_open: bool = False
    whole: bool = False
    words: tuple[tuple[str, bool], ...] = ()
    needed: bool = False
    """Whether a blank cell is a mistake; else it means `blank`, or the field's own default."""
    blank: float | None = None
    common: bool = False
    """Whether a cell is checked even in a row whose kind cannot be read."""
    mounting: bool = False
    """Whether it says how a sensor is mounted, not what it is; a profile then says nothing of it."""


X = Column(header="X Position (in)", field="x", needed=True, mounting=True)
Y = Column(header="Y Position (in)", field="y", needed=True, mounting=True)
Z = Column(header="Z Position (in)", field="z", low=0, needed=True)
ROTATION = Column(header="Rotation (deg)", field="rotation", needed=True, mounting=True)
ERROR = Column(header="Percent Error (0-1)", field="error", low=0, high=1, needed=True, common=True)
FIELD_OF_VIEW = Column(header="Field of View (deg)", field="field_of_view", low=0, high=360, needed=True)
THRESHOLD = Column(header="Threshold", field="threshold", label="threshold", low=0, high=1, needed=True)

BASE = (X, Y, Z, ROTATION, ERROR, FIELD_OF_VIEW, THRESHOLD)
"""What every file has after ID, Poll Character and Enabled. A kind that makes nothing of one of
these takes any number there, or a blank."""

GAIN = Column(header="Gain", field="gain", label="gain", common=True)
ABSOLUTE_ERROR = Column(
    header="Absolute Error", field="absolute_error", label="absolute error", low=0, common=True
)
BIAS = Column(header="Bias", field="bias", label="bias", common=True)
DRIFT = Column(header="Drift (per s)", field="drift", label="drift/s", common=True)
MIN_RANGE = Column(header="Min Range (in)", field="min_range", label="min", low=0)
MAX_RANGE = Column(header="Max Range (in)", field="max_range", label="max", low=0)
RESOLUTION = Column(header="Resolution", field="resolution", label="resolution", low=0, common=True)
RAYS = Column(header="Rays", field="rays", label="rays", low=1, high=1000, whole=True)
VERTICAL_FOV = Column(
    header="Vertical FOV (deg)",
    field="vertical_field_of_view",
    label="vertical fov",
    low=0,
    high=180,
    high_open=True,
)
WRAP = Column(header="Wrap", field="wrap", label="wrap", low=0, common=True)
DETECTS = Column(
    header="Detects",
    field="detects_white",
    label="detects",
    words=(("black", False), ("white", True)),
    mounting=True,
)

READ_TIME = Column(header="Read Time (s)", field="read_time", label="read time", low=0, common=True)
DROPOUT = Column(header="Dropout", field="dropout", label="dropout", low=0, high=1)
OUTLIER = Column(header="Outlier", field="outlier", label="outlier", low=0, high=1)
INCIDENCE_LIMIT = Column(
    header="Incidence Limit (deg)", field="incidence_limit", label="incidence limit", low=0, high=90
)
CROSS_TALK = Column(header="Cross-Talk", field="cross_talk", label="cross-talk", low=0, high=1)
TICKS = Column(header="Ticks per Inch", field="ticks_per_inch", label="ticks/in", low=0)
RANDOM_WALK = Column(header="Random Walk (deg/sqrt s)", field="random_walk", label="random walk", low=0)
HARD_IRON = Column(header="Hard Iron (deg)", field="hard_iron", label="hard iron")
SOFT_IRON = Column(header="Soft Iron (deg)", field="soft_iron", label="soft iron")
ANSWER = Column(
    header="Answer",
    field="analog",
    label="answer",
    words=(("digital", False), ("analog", True)),
    mounting=True,
)

ELECTRONICS = (GAIN, ABSOLUTE_ERROR, BIAS, DRIFT, RESOLUTION, WRAP)
"""What is done to the value of any sensor that measures."""


def word_of(column: Column, value: object) -> str:
    """The word that stands for a value in a column's cells; empty where cells are numbers."""
    return next((word for word, meant in column.words if meant == value), "")
