"""Columns of sensors.csv and drive.csv as data. Readers, new sets and a course's rules go by them.

The course's sensors.csv has ten columns; the last seven of them, `BASE`, stand here with the optional ones. A
kind of sensor lists those that it uses; it may narrow one with `msgspec.structs.replace`, or define its own.
"""

import re
from functools import partial
from typing import Any

from msgspec.structs import replace

from simmer_tui.sim.rules import IntegerRule, NumberRule, Rule, WordRule
from simmer_tui.sim.values import CourseRule, Value


class CsvColumn(Value, frozen=True, kw_only=True):
    """A column of a CSV file; `name` is its header.

    Its help becomes a comment in new sets and a row of the reference. A `default` of None means the field's
    default.
    """

    label: str = ""
    """The name in the summary of a set, if it is not the noun."""
    needed: bool = False
    """True if a blank cell is a mistake; otherwise it means the default."""
    is_error: bool = False
    """True if it is an error of a sensor's readings, which an exact sensor has not: 0 means none."""
    per_time: str = ""
    """`s` or `s2` if values are in the unit of the reading, or of the drive, by seconds or their square."""
    has_mean: bool = False
    """True if it makes readings wrong on average: reports name a large mean error of a sensor that has it."""


# Other brackets of a header, as in `Percent Error (0-1)` and `Drift (per s)`, hold no unit of the value.
_UNIT = re.compile(r"\((in|deg|s|Hz|deg/sqrt s)\)$")
# Headers have their unit in brackets, which no option is typed with.
_BRACKETS = re.compile(r"\(.*?\)")
_BETWEEN = re.compile(r"[^a-z0-9]+")


def column_name(header: str) -> str:
    """A header as it is written in dotted names, profiles and keys: `Percent Error (0-1)` is
    `percent_error`."""
    return _BETWEEN.sub("_", _BRACKETS.sub("", header).strip().lower())


def _column(header: str, rule: Rule[Any], course: CourseRule, help_text: str, **others: Any) -> CsvColumn:
    """A column whose unit is in its header, and so is the field unless it is given."""
    found = _UNIT.search(header)
    usual: dict[str, Any] = {"name": header, "field": column_name(header), "course": course}
    if found:
        usual["unit"] = found[1]
    return CsvColumn(rule, help_text, **(usual | others))


_base = partial(_column, needed=True)
_error = partial(_column, is_error=True)
_FREE, _SAME, _SHIFT = CourseRule.FREE, CourseRule.SAME, CourseRule.SHIFT
_AT_LEAST, _AT_MOST = CourseRule.AT_LEAST, CourseRule.AT_MOST
_ANY, _NOT_NEGATIVE, _POSITIVE = NumberRule(), NumberRule(0), NumberRule(0, low_open=True)
_SHARE = NumberRule(0, 1)
_COLOUR = WordRule(("black", "white"), (False, True))
_ANSWER = WordRule(("digital", "analog"), (False, True))
# Half a circle would reach infinitely far up and down: its tangent is infinite.
_UPRIGHT = NumberRule(0, 180, high_open=True)

X = _base(
    *("X Position (in)", _ANY, _FREE),
    "distance ahead of the robot's centre (negative: behind)",
    field="x",
)
Y = _base(
    *("Y Position (in)", _ANY, _FREE),
    "distance to the left of the robot's centre (negative: to the right)",
    field="y",
)
Z = _base("Z Position (in)", _NOT_NEGATIVE, _FREE, "height above the floor", field="z")
ROTATION = _base(
    *("Rotation (deg)", _ANY, _FREE),
    "direction in which it looks, or rolls: 0 to the front, 90 to the left, counter-clockwise",
)
ERROR = _base(
    *("Percent Error (0-1)", _SHARE, _AT_LEAST),
    "standard deviation of the random error, as a share of the reading: 0.02 is 2 %",
    field="error",
    is_error=True,
)
FIELD_OF_VIEW = _base(
    "Field of View (deg)", NumberRule(0, 360), _SAME, "angle of its view, from edge to edge"
)
THRESHOLD = _base("Threshold", _SHARE, _FREE, "share of the seen floor that must have the colour for a 1")

BASE = (X, Y, Z, ROTATION, ERROR, FIELD_OF_VIEW, THRESHOLD)
"""The columns that every file has after ID, Poll Character and Enabled. A kind that does not use one of these
accepts any number there, or a blank."""

GAIN = _column("Gain", _ANY, _SAME, "factor of the value (1)")
ABSOLUTE_ERROR = _error(
    *("Absolute Error", _NOT_NEGATIVE, _AT_LEAST),
    "standard deviation of a random error of its own, in the unit of the reading",
)
BIAS = _error("Bias", _ANY, _SHIFT, "constant that is added, in the unit of the reading", has_mean=True)
DRIFT = _error(
    *("Drift (per s)", _ANY, _SHIFT),
    "addition for each second of simulated time",
    label="drift/s",
    per_time="s",
    has_mean=True,
)
MIN_RANGE = _column("Min Range (in)", _NOT_NEGATIVE, _AT_LEAST, "its reading of anything nearer", label="min")
MAX_RANGE = _column(
    *("Max Range (in)", _NOT_NEGATIVE, _AT_MOST),
    "beyond it the reading is Infinity",
    label="max",
)
RESOLUTION = _column("Resolution", _NOT_NEGATIVE, _SHIFT, "readings are rounded to multiples of it (0: not)")
RAYS = _column("Rays", IntegerRule(1, 1000), _SAME, "rays spread over the field of view (5)")
VERTICAL_FOV = _column(
    *("Vertical FOV (deg)", _UPRIGHT, _SAME),
    "its view up and down, by which a low block is seen from above; blank: by height alone",
    label="vertical fov",
    field="vertical_field_of_view",
)
WRAP = _column("Wrap", _NOT_NEGATIVE, _SAME, "readings start again at 0 here, such as 360 (0: never)")
DETECTS = _column(
    *("Detects", _COLOUR, _FREE),
    "the colour of floor for which it reads 1 (black)",
    label="detects",
    field="detects_white",
)
READ_TIME = _column("Read Time (s)", _NOT_NEGATIVE, _AT_LEAST, "simulated time that a reading takes (0)")
DROPOUT = _error("Dropout", _SHARE, _AT_LEAST, "probability that a reading is missed (0)")
OUTLIER = _error("Outlier", _SHARE, _AT_LEAST, "probability that a reading is any value of its range (0)")
INCIDENCE_LIMIT = _column(
    *("Incidence Limit (deg)", NumberRule(0, 90), _AT_MOST),
    "angle to a wall's normal beyond which there is no echo (0: always one)",
    has_mean=True,
)
CROSS_TALK = _error(
    *("Cross-Talk", _SHARE, _AT_LEAST),
    "probability that it takes another sensor's sound for its own (0)",
    label="cross-talk",
    has_mean=True,
)
TICKS = _column(
    *("Ticks per Inch", _NOT_NEGATIVE, _AT_MOST),
    "ticks of the wheel in an inch, to which readings are rounded (0: not)",
    label="ticks/in",
)
RANDOM_WALK = _error(
    *("Random Walk (deg/sqrt s)", _NOT_NEGATIVE, _AT_LEAST),
    "standard deviation of the angle's random walk after one second (0)",
    has_mean=True,
)
HARD_IRON = _error(
    *("Hard Iron (deg)", _ANY, _SAME),
    "largest deviation by magnets on the robot, one period a turn (0)",
    has_mean=True,
)
SOFT_IRON = _error(
    *("Soft Iron (deg)", _ANY, _SAME),
    "largest deviation by iron nearby, two periods a turn (0)",
    has_mean=True,
)
ANSWER = _column(
    *("Answer", _ANSWER, _SAME),
    "digital: 1 or 0 by the threshold; analog: the share itself, 0 to 1 (digital)",
    noun="answer",
    field="analog",
)

SCAN_RATE = _column(
    *("Scan Rate (Hz)", NumberRule(1, 20), _AT_MOST), "revolutions of the lidar's head a second (5.5)"
)
TURN_RAYS = replace(
    RAYS, rule=IntegerRule(1, 2000), course=_AT_MOST, help=f"{RAYS.help}; lidar: rays a revolution"
)
CLOCKWISE = _column(
    *("Clockwise", WordRule(("0", "1"), (False, True)), _FREE),
    "1: the lidar's head turns clockwise, seen from above; 0: the other way (1)",
)
MISSED = _column(
    *("Missed", WordRule(("infinity", "0"), (False, True)), _FREE),
    "the reading of a ray of a lidar that meets nothing: Infinity or 0 (Infinity)",
    field="missed_as_zero",
    label="missed",
)

ELECTRONICS = (GAIN, ABSOLUTE_ERROR, BIAS, DRIFT, RESOLUTION, WRAP)
"""The columns of the electronics of any sensor that measures."""
COMMON = (ERROR, *ELECTRONICS, READ_TIME)
"""The columns whose cells are checked even in a row of an unknown kind."""
MOUNTING = (X, Y, ROTATION, DETECTS, ANSWER)
"""The columns that say how a sensor is mounted or wired, not what it is. Profiles do not have such values."""

TRANSLATION_SPEED = 6.0
"""Speed of a translation unless its row says otherwise, in/s: that of the course's robot."""
ROTATION_SPEED = 120.0
"""Speed of a rotation unless its row says otherwise, deg/s."""

_OF_EACH = "for each inch (degree, for rot) commanded, in inches (degrees, for rotation)"


def _axes(
    title: str, table: str, rule: NumberRule, course: CourseRule, help_text: str
) -> tuple[CsvColumn, ...]:
    """The columns of an error's three axes, in the order of the course's file."""
    helps = (help_text, "the same to the front", "the same of the heading")
    return tuple(
        _base(
            *(f"{axis} {title}", rule, course, text),
            field=f"{table}.{field}",
            noun=f"{axis.replace('A', 'a')} {table}",
        )
        for axis, field, text in zip(("Y-Axis", "X-Axis", "Rotation"), "yxr", helps, strict=True)
    )


_ERROR_HELP = f"standard deviation of the random error to the left, {_OF_EACH}"
_BIAS_HELP = "error to the left that is always there, likewise; only with randbias = false"
DRIVE_AXES = (
    *_axes("Error", "error", _NOT_NEGATIVE, _AT_LEAST, _ERROR_HELP),
    # The course's only: an error grows with 1 + bias, and a bias of -1 takes it away.
    *_axes("Bias", "bias", _ANY, _SAME, _BIAS_HELP),
)
"""The columns of drive.csv that every file has after ID, Poll Character and Enabled, in their order."""
DRIVE_GAIN = _column("Gain", _ANY, _FREE, "factor of the commanded value (1)")
SPEED = _column(
    *("Speed", _POSITIVE, _AT_MOST),
    f"inches, degrees or (grip) closings a second ({TRANSLATION_SPEED:g}, {ROTATION_SPEED:g}, 2)",
    per_time="s",
)
START_LAG = _column(
    "Start Lag (s)", _NOT_NEGATIVE, _AT_LEAST, "simulated time from a command to the first motion (0)"
)
ACCELERATION = _column(
    *("Acceleration", _NOT_NEGATIVE, _AT_MOST),
    "inches or degrees per second squared (0: full speed at once)",
    per_time="s2",
)
REACH = _column(
    *("Reach", _POSITIVE, _AT_MOST),
    "grip only: length of the window ahead of the robot for the centre of a block, inches (3)",
    unit="in",
)
WIDTH = _column("Width", _POSITIVE, _AT_MOST, "grip only: width of that window, inches (4)", unit="in")
LESS_USUAL = (START_LAG, ACCELERATION)
"""The columns of drive.csv that profiles and imported sets may lack: 0 is usual."""
MOVEMENT = (*DRIVE_AXES, DRIVE_GAIN, SPEED, *LESS_USUAL)
"""The columns of drive.csv for a movement, by field of `DriveSpec`."""
GRIPPER = (SPEED, REACH, WIDTH)
"""The columns of drive.csv for the gripper, by field of `GripperSpec`."""
