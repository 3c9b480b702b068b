"""Columns of sensors.csv and drive.csv as data. Readers, new sets and a course's rules go by them.

The course's sensors.csv has ten columns; the last seven of them, `BASE`, stand here with the optional
ones. A kind of sensor lists those that mean something to it; it may narrow one with
`msgspec.structs.replace`, or bring one of its own.
"""

from __future__ import annotations

from simmer_tui.sim.rules import IntegerRule, NumberRule, WordRule
from simmer_tui.sim.values import CourseRule, Value


class CsvColumn(Value, frozen=True, kw_only=True):
    """A column of a CSV file; `name` is its header.

    Its help becomes a comment in new sets and a row of the reference. A `default` of None stands for that of
    the field.
    """

    label: str = ""
    """The name in the summary of a set, if it is not the noun."""
    needed: bool = False
    """True if a blank cell is a mistake; else it stands for the default."""
    common: bool = False
    """True if a cell is checked even in a row whose kind cannot be read."""
    mounting: bool = False
    """True if it says how a sensor is mounted, not what it is. Profiles do not have such values."""


X = CsvColumn(
    NumberRule(),
    "how far ahead of the robot's centre it sits (negative: behind)",
    name="X Position (in)",
    field="x",
    unit="in",
    needed=True,
    mounting=True,
    course=CourseRule.FREE,
)
Y = CsvColumn(
    NumberRule(),
    "how far to the left of the robot's centre it sits (negative: to the right)",
    name="Y Position (in)",
    field="y",
    unit="in",
    needed=True,
    mounting=True,
    course=CourseRule.FREE,
)
Z = CsvColumn(
    NumberRule(0),
    "its height above the floor",
    name="Z Position (in)",
    field="z",
    unit="in",
    needed=True,
    course=CourseRule.FREE,
)
ROTATION = CsvColumn(
    NumberRule(),
    "which way it looks, or rolls: 0 to the front, 90 to the left, counter-clockwise",
    name="Rotation (deg)",
    field="rotation",
    unit="deg",
    needed=True,
    mounting=True,
    course=CourseRule.FREE,
)
ERROR = CsvColumn(
    NumberRule(0, 1),
    "standard deviation of the random error, as a share of the reading: 0.02 is 2 %",
    name="Percent Error (0-1)",
    field="error",
    needed=True,
    common=True,
    course=CourseRule.AT_LEAST,
)
FIELD_OF_VIEW = CsvColumn(
    NumberRule(0, 360),
    "angle from edge to edge of what it sees",
    name="Field of View (deg)",
    field="field_of_view",
    unit="deg",
    needed=True,
)
THRESHOLD = CsvColumn(
    NumberRule(0, 1),
    "share of the seen floor that must have the colour for a 1",
    name="Threshold",
    field="threshold",
    needed=True,
    course=CourseRule.FREE,
)

BASE = (X, Y, Z, ROTATION, ERROR, FIELD_OF_VIEW, THRESHOLD)
"""The columns that every file has after ID, Poll Character and Enabled. A kind without use for one of
these takes any number there, or a blank."""

GAIN = CsvColumn(NumberRule(), "what the value is multiplied by (1)", name="Gain", field="gain", common=True)
ABSOLUTE_ERROR = CsvColumn(
    NumberRule(0),
    "standard deviation of a random error of its own, in the unit of the reading",
    name="Absolute Error",
    field="absolute_error",
    common=True,
    course=CourseRule.AT_LEAST,
)
BIAS = CsvColumn(
    NumberRule(),
    "what is always added, in the unit of the reading",
    name="Bias",
    field="bias",
    common=True,
    course=CourseRule.SHIFT,
)
DRIFT = CsvColumn(
    NumberRule(),
    "what is added for each second of simulated time",
    name="Drift (per s)",
    field="drift",
    label="drift/s",
    common=True,
    course=CourseRule.SHIFT,
)
MIN_RANGE = CsvColumn(
    NumberRule(0),
    "what it says of anything nearer",
    name="Min Range (in)",
    field="min_range",
    unit="in",
    label="min",
    course=CourseRule.AT_LEAST,
)
MAX_RANGE = CsvColumn(
    NumberRule(0),
    "beyond it the reading is Infinity (tof: 47 if blank)",
    name="Max Range (in)",
    field="max_range",
    unit="in",
    label="max",
    course=CourseRule.AT_MOST,
)
RESOLUTION = CsvColumn(
    NumberRule(0),
    "readings are rounded to multiples of it (0: not)",
    name="Resolution",
    field="resolution",
    common=True,
    course=CourseRule.SHIFT,
)
RAYS = CsvColumn(IntegerRule(1, 1000), "rays spread over the field of view (5)", name="Rays", field="rays")
VERTICAL_FOV = CsvColumn(
    NumberRule(0, 180, high_open=True),
    "its view up and down, by which a low block is seen from above; blank: by height alone",
    name="Vertical FOV (deg)",
    field="vertical_field_of_view",
    unit="deg",
    label="vertical fov",
)
WRAP = CsvColumn(
    NumberRule(0),
    "readings start again at 0 here, such as 360 (0: never)",
    name="Wrap",
    field="wrap",
    common=True,
)
DETECTS = CsvColumn(
    WordRule((("black", False), ("white", True))),
    "the colour of floor for which it says 1 (black)",
    name="Detects",
    field="detects_white",
    label="detects",
    mounting=True,
    course=CourseRule.FREE,
)
READ_TIME = CsvColumn(
    NumberRule(0),
    "simulated time that a reading takes (0)",
    name="Read Time (s)",
    field="read_time",
    unit="s",
    common=True,
    course=CourseRule.AT_LEAST,
)
DROPOUT = CsvColumn(
    NumberRule(0, 1),
    "probability that a reading is missed (0)",
    name="Dropout",
    field="dropout",
    course=CourseRule.AT_LEAST,
)
OUTLIER = CsvColumn(
    NumberRule(0, 1),
    "probability that a reading is any value of its range (0)",
    name="Outlier",
    field="outlier",
    course=CourseRule.AT_LEAST,
)
INCIDENCE_LIMIT = CsvColumn(
    NumberRule(0, 90),
    "angle to a wall's normal beyond which there is no echo (0: always one)",
    name="Incidence Limit (deg)",
    field="incidence_limit",
    unit="deg",
    course=CourseRule.AT_MOST,
)
CROSS_TALK = CsvColumn(
    NumberRule(0, 1),
    "probability that it takes another sensor's sound for its own (0)",
    name="Cross-Talk",
    field="cross_talk",
    label="cross-talk",
    course=CourseRule.AT_LEAST,
)
TICKS = CsvColumn(
    NumberRule(0),
    "counts of the wheel an inch, to which readings are rounded (0: not)",
    name="Ticks per Inch",
    field="ticks_per_inch",
    label="ticks/in",
    course=CourseRule.AT_MOST,
)
RANDOM_WALK = CsvColumn(
    NumberRule(0),
    "error of the angle that walks at random, deviation after one second (0)",
    name="Random Walk (deg/sqrt s)",
    field="random_walk",
    unit="deg/sqrt s",
    course=CourseRule.AT_LEAST,
)
HARD_IRON = CsvColumn(
    NumberRule(),
    "greatest deviation once a turn, by magnets on the robot (0)",
    name="Hard Iron (deg)",
    field="hard_iron",
    unit="deg",
)
SOFT_IRON = CsvColumn(
    NumberRule(),
    "greatest deviation twice a turn, by iron nearby (0)",
    name="Soft Iron (deg)",
    field="soft_iron",
    unit="deg",
)
ANSWER = CsvColumn(
    WordRule((("digital", False), ("analog", True))),
    "digital: 1 or 0 by the threshold; analog: the share itself, 0 to 1 (digital)",
    name="Answer",
    field="analog",
    noun="answer",
    mounting=True,
)

ELECTRONICS = (GAIN, ABSOLUTE_ERROR, BIAS, DRIFT, RESOLUTION, WRAP)
"""The columns of what is done to the value of any sensor that measures."""

TRANSLATION_SPEED = 6.0
"""Speed of a translation unless its row says otherwise, in/s: what the course's robot does."""
ROTATION_SPEED = 120.0
"""Speed of a rotation unless its row says otherwise, deg/s."""

_OF_EACH = "for each inch (degree, for rot) commanded, in inches (degrees, for rotation)"


def _drive_error(header: str, axis: str, help_text: str) -> CsvColumn:
    return CsvColumn(
        NumberRule(0),
        help_text,
        name=f"{header} Error",
        field=f"error.{axis}",
        noun=f"{header.replace('A', 'a')} error",
        needed=True,
        course=CourseRule.AT_LEAST,
    )


def _drive_bias(header: str, axis: str, help_text: str) -> CsvColumn:
    """A column that a course's robot has the same: an error grows with 1 + bias, and a bias of -1 takes
    it away."""
    return CsvColumn(
        NumberRule(),
        help_text,
        name=f"{header} Bias",
        field=f"bias.{axis}",
        noun=f"{header.replace('A', 'a')} bias",
        needed=True,
    )


DRIVE_AXES = (
    _drive_error("Y-Axis", "y", f"standard deviation of the random error to the left, {_OF_EACH}"),
    _drive_error("X-Axis", "x", "the same to the front"),
    _drive_error("Rotation", "r", "the same of the heading"),
    _drive_bias(
        "Y-Axis", "y", "error to the left that is always there, likewise; only with randbias = false"
    ),
    _drive_bias("X-Axis", "x", "the same to the front"),
    _drive_bias("Rotation", "r", "the same of the heading"),
)
"""The columns of drive.csv that every file has after ID, Poll Character and Enabled, in their order."""
DRIVE_GAIN = CsvColumn(
    NumberRule(),
    "what the commanded value is multiplied by (1)",
    name="Gain",
    field="gain",
    course=CourseRule.FREE,
)
SPEED = CsvColumn(
    NumberRule(0, low_open=True),
    f"inches, degrees or (grip) closings a second ({TRANSLATION_SPEED:g}, {ROTATION_SPEED:g}, 2)",
    name="Speed",
    field="speed",
    course=CourseRule.AT_MOST,
)
START_LAG = CsvColumn(
    NumberRule(0),
    "simulated time from a command to the first motion (0)",
    name="Start Lag (s)",
    field="start_lag",
    unit="s",
    course=CourseRule.AT_LEAST,
)
ACCELERATION = CsvColumn(
    NumberRule(0),
    "inches or degrees per second squared (0: full speed at once)",
    name="Acceleration",
    field="acceleration",
    course=CourseRule.AT_MOST,
)
REACH = CsvColumn(
    NumberRule(0, low_open=True),
    "grip only: how far ahead of the robot it takes a block by its centre, inches (3)",
    name="Reach",
    field="reach",
    unit="in",
    course=CourseRule.AT_MOST,
)
WIDTH = CsvColumn(
    NumberRule(0, low_open=True),
    "grip only: how wide that window is, inches (4)",
    name="Width",
    field="width",
    unit="in",
    course=CourseRule.AT_MOST,
)
MOVEMENT = (*DRIVE_AXES, DRIVE_GAIN, SPEED, START_LAG, ACCELERATION)
"""The columns of drive.csv for a movement, by field of `DriveSpec`."""
GRIPPER = (SPEED, REACH, WIDTH)
"""The columns of drive.csv for the gripper, by field of `GripperSpec`."""
