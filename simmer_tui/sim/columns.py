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
    meaning: str = ""
    """What it says, in a sentence without its full stop; people read it in new files and the reference."""
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


X = Column(
    header="X Position (in)",
    field="x",
    meaning="how far ahead of the robot's centre it sits (negative: behind)",
    needed=True,
    mounting=True,
)
Y = Column(
    header="Y Position (in)",
    field="y",
    meaning="how far to the left of the robot's centre it sits (negative: to the right)",
    needed=True,
    mounting=True,
)
Z = Column(header="Z Position (in)", field="z", meaning="its height above the floor", low=0, needed=True)
ROTATION = Column(
    header="Rotation (deg)",
    field="rotation",
    meaning="which way it looks, or rolls: 0 to the front, 90 to the left, counter-clockwise",
    needed=True,
    mounting=True,
)
ERROR = Column(
    header="Percent Error (0-1)",
    field="error",
    meaning="standard deviation of the random error, as a share of the reading: 0.02 is 2 %",
    low=0,
    high=1,
    needed=True,
    common=True,
)
FIELD_OF_VIEW = Column(
    header="Field of View (deg)",
    field="field_of_view",
    meaning="angle from edge to edge of what it sees",
    low=0,
    high=360,
    needed=True,
)
THRESHOLD = Column(
    header="Threshold",
    field="threshold",
    meaning="share of the seen floor that must have the colour for a 1",
    label="threshold",
    low=0,
    high=1,
    needed=True,
)

BASE = (X, Y, Z, ROTATION, ERROR, FIELD_OF_VIEW, THRESHOLD)
"""What every file has after ID, Poll Character and Enabled. A kind that makes nothing of one of
these takes any number there, or a blank."""

GAIN = Column(
    header="Gain", field="gain", meaning="what the value is multiplied by (1)", label="gain", common=True
)
ABSOLUTE_ERROR = Column(
    header="Absolute Error",
    field="absolute_error",
    meaning="standard deviation of a random error of its own, in the unit of the reading",
    label="absolute error",
    low=0,
    common=True,
)
BIAS = Column(
    header="Bias",
    field="bias",
    meaning="what is always added, in the unit of the reading",
    label="bias",
    common=True,
)
DRIFT = Column(
    header="Drift (per s)",
    field="drift",
    meaning="what is added for each second of simulated time",
    label="drift/s",
    common=True,
)
MIN_RANGE = Column(
    header="Min Range (in)", field="min_range", meaning="what it says of anything nearer", label="min", low=0
)
MAX_RANGE = Column(
    header="Max Range (in)",
    field="max_range",
    meaning="beyond it the reading is Infinity (tof: 47 if blank)",
    label="max",
    low=0,
)
RESOLUTION = Column(
    header="Resolution",
    field="resolution",
    meaning="readings are rounded to multiples of it (0: not)",
    label="resolution",
    low=0,
    common=True,
)
RAYS = Column(
    header="Rays",
    field="rays",
    meaning="rays spread over the field of view (5)",
    label="rays",
    low=1,
    high=1000,
    whole=True,
)
VERTICAL_FOV = Column(
    header="Vertical FOV (deg)",
    field="vertical_field_of_view",
    meaning="its view up and down, by which a low block is seen from above; blank: by height alone",
    label="vertical fov",
    low=0,
    high=180,
    high_open=True,
)
WRAP = Column(
    header="Wrap",
    field="wrap",
    meaning="readings start again at 0 here, such as 360 (0: never)",
    label="wrap",
    low=0,
    common=True,
)
DETECTS = Column(
    header="Detects",
    field="detects_white",
    meaning="the colour of floor for which it says 1 (black)",
    label="detects",
    words=(("black", False), ("white", True)),
    mounting=True,
)

READ_TIME = Column(
    header="Read Time (s)",
    field="read_time",
    meaning="simulated time that a reading takes (0)",
    label="read time",
    low=0,
    common=True,
)
DROPOUT = Column(
    header="Dropout",
    field="dropout",
    meaning="probability that a reading is missed (0)",
    label="dropout",
    low=0,
    high=1,
)
OUTLIER = Column(
    header="Outlier",
    field="outlier",
    meaning="probability that a reading is any value of its range (0)",
    label="outlier",
    low=0,
    high=1,
)
INCIDENCE_LIMIT = Column(
    header="Incidence Limit (deg)",
    field="incidence_limit",
    meaning="angle to a wall's normal beyond which there is no echo (0: always one)",
    label="incidence limit",
    low=0,
    high=90,
)
CROSS_TALK = Column(
    header="Cross-Talk",
    field="cross_talk",
    meaning="probability that it takes another sensor's sound for its own (0)",
    label="cross-talk",
    low=0,
    high=1,
)
TICKS = Column(
    header="Ticks per Inch",
    field="ticks_per_inch",
    meaning="counts of the wheel an inch, to which readings are rounded (0: not)",
    label="ticks/in",
    low=0,
)
RANDOM_WALK = Column(
    header="Random Walk (deg/sqrt s)",
    field="random_walk",
    meaning="error of the angle that walks at random, deviation after one second (0)",
    label="random walk",
    low=0,
)
HARD_IRON = Column(
    header="Hard Iron (deg)",
    field="hard_iron",
    meaning="greatest deviation once a turn, by magnets on the robot (0)",
    label="hard iron",
)
SOFT_IRON = Column(
    header="Soft Iron (deg)",
    field="soft_iron",
    meaning="greatest deviation twice a turn, by iron nearby (0)",
    label="soft iron",
)
ANSWER = Column(
    header="Answer",
    field="analog",
    meaning="digital: 1 or 0 by the threshold; analog: the share itself, 0 to 1 (digital)",
    label="answer",
    words=(("digital", False), ("analog", True)),
    mounting=True,
)

ELECTRONICS = (GAIN, ABSOLUTE_ERROR, BIAS, DRIFT, RESOLUTION, WRAP)
"""What is done to the value of any sensor that measures."""


def word_of(column: Column, value: object) -> str:
    """The word that stands for a value in a column's cells; empty where cells are numbers."""
    return next((word for word, meant in column.words if meant == value), "")
