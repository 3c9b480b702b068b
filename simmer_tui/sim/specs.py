"""Frozen descriptions of everything that is simulated: maze, robot, sensors, drives.

Units are inches, degrees and seconds. Lengths given as (x, y) are in the robot's frame (+X front, +Y left)
unless a docstring says otherwise. These values have no behaviour. Their maker (the configuration loader, a
notebook) ensures that they are in range. `Simulator` refuses a start that overlaps a wall.
"""

import math
from enum import StrEnum
from typing import ClassVar, Self

from msgspec import Struct

from simmer_tui.sim.block import Block
from simmer_tui.sim.columns import TRANSLATION_SPEED, CsvColumn
from simmer_tui.sim.pose import Pose

# The course's maze is made of one-foot cells.
CELL_SIZE = 12.0
"""Side of a maze cell, inches."""
TILE_SIZE = 3.0
"""Side of a floor tile, inches; four by four tiles make a cell."""
TILES_PER_CELL = 4
WALL, EMPTY, START, BLOCK = range(4)
"""The values a maze cell may have."""


class MazeSpec(Struct, frozen=True):
    """The maze: one integer a cell (`WALL`, `EMPTY`, `START`, `BLOCK`), the first row on top.

    `floor` has the tiles, the first row on top, 0 black and 1 white; None means the course's generated
    pattern.
    """

    cells: tuple[tuple[int, ...], ...]
    floor: tuple[tuple[int, ...], ...] | None = None

    @property
    def rows(self) -> int:
        """Number of rows of cells."""
        return len(self.cells)

    @property
    def columns(self) -> int:
        """Number of columns of cells."""
        return len(self.cells[0])

    @property
    def width(self) -> float:
        """Extent along X, inches."""
        return self.columns * CELL_SIZE

    @property
    def height(self) -> float:
        """Extent along Y, inches."""
        return self.rows * CELL_SIZE


class RobotSpec(Struct, frozen=True):
    """The robot's footprint: a disc of `radius` around the origin, or a polygon of `vertices`.

    Exactly one of the two is given. Vertices are not repeated at the end.
    """

    radius: float | None = None
    vertices: tuple[tuple[float, float], ...] = ()

    @classmethod
    def circle(cls, diameter: float) -> "RobotSpec":
        """A disc; `diameter` is in inches."""
        return cls(radius=diameter / 2)

    @classmethod
    def rectangle(cls, x_size: float, y_size: float) -> "RobotSpec":
        """A rectangle about the origin; sizes are in inches."""
        x, y = x_size / 2, y_size / 2
        return cls(vertices=((x, y), (-x, y), (-x, -y), (x, -y)))

    @classmethod
    def polygon(cls, vertices: tuple[tuple[float, float], ...]) -> "RobotSpec":
        """A polygon; `vertices` are (x, y) in inches, in either orientation."""
        return cls(vertices=vertices)

    @property
    def reach(self) -> float:
        """Greatest distance from the origin to the outline, inches."""
        return self.radius if self.radius is not None else max(math.hypot(x, y) for x, y in self.vertices)


class SensorKind:
    """Description of a kind of sensor. Kinds are subclasses, never objects of this class; their behaviour is
    in `simmer_tui.sim.sensors`."""

    name: ClassVar[str]
    """The start of an ID in sensors.csv: `ultra` of `ultra1`."""
    meaning: ClassVar[str]
    """The quantity that it measures, in a few words."""
    unit: ClassVar[str] = ""
    """Unit of a reading, such as `in` or `deg`; empty for a yes or no."""
    columns: ClassVar[tuple[CsvColumn, ...]]
    """The columns of sensors.csv that it uses."""
    short_name: ClassVar[str] = ""
    """The name on narrow panels, such as `line sensor`; empty for the start of its IDs."""
    spec_type: "ClassVar[type[SensorSpec]]"
    """The class of its rows: `SensorSpec`, or one derived from it with the fields of its own columns."""
    is_range: ClassVar[bool] = False
    """True if it measures the distance to the nearest thing ahead of it."""
    is_yes_or_no: ClassVar[bool] = False
    """True if its reply is 1 for yes and 0 for no."""
    is_scan: ClassVar[bool] = False
    """True if a reading is many numbers: the ranges of a whole revolution."""
    errs_by_opposite: ClassVar[bool] = False
    """True if its Percent Error is the probability of the opposite answer, not the error of a measurement."""
    counts: ClassVar[bool] = False
    """True if it counts: movements add to its value."""
    is_heading: ClassVar[bool] = False
    """True if it gives the robot's heading, degrees, with errors."""
    detects_block: ClassVar[bool] = False
    """True if it says that the gripper holds something."""
    detects_floor: ClassVar[bool] = False
    """True if its reading depends on the colour of the floor."""
    dialect_functions: ClassVar[tuple[str, ...]] = ()
    """The functions of a dialect's expressions that need such a sensor: ray, scan, contact."""
    devices: ClassVar[tuple[str, ...]] = ()
    """The classes of a simmer-python `config.py` that are this kind there."""
    is_opaque: ClassVar[bool] = False
    """True for a team's own device: only the simulation runs its code. Reports and calibration use its logged
    readings, so that they give the same results without the device file."""
    any_columns: ClassVar[bool] = False
    """True if its columns are not known: sensors.csv may have any, and their cells are not read."""

    @classmethod
    def has(cls, field: str) -> bool:
        """True if one of its columns fills a field of its rows."""
        return any(column.field == field for column in cls.columns)

    @staticmethod
    def contradiction(spec: "SensorSpec") -> tuple[tuple[CsvColumn, ...], str] | None:
        """Columns of a row that contradict each other, and the reason; None if there are none."""
        return None


class SensorSpec(Struct, frozen=True, kw_only=True):
    """One row of sensors.csv: the fields that every kind may use. Those of one kind are in its `spec_type`.

    `x`, `y`, `z` (inches, z up from the floor) and `rotation` (degrees) place the sensor in the
    robot's frame. `error` is the Percent Error as a fraction. `drift` is per second of simulated
    time. `wrap` and `resolution` of 0 mean none.
    """

    kind: type[SensorKind]
    number: int
    code: str
    enabled: bool = True
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    rotation: float = 0.0
    error: float = 0.0
    gain: float = 1.0
    absolute_error: float = 0.0
    bias: float = 0.0
    drift: float = 0.0
    min_range: float = 0.0
    max_range: float = math.inf
    resolution: float = 0.0
    wrap: float = 0.0
    # The following fields are explained, with their sources, in docs/sensors.md. 0 means none.
    read_time: float = 0.0
    """Seconds of simulated time that a reading takes."""
    dropout: float = 0.0
    """Probability that a reading is missed."""
    outlier: float = 0.0
    """Probability that a reading is any value of its range."""

    @property
    def id(self) -> str:
        """The name in the file, `ultra1`."""
        return f"{self.kind.name}{self.number}"

    @property
    def unit(self) -> str:
        """Unit of a reading."""
        return self.kind.unit

    @property
    def is_yes_or_no(self) -> bool:
        """True if a reading is 1 for yes and 0 for no."""
        return self.kind.is_yes_or_no

    @property
    def is_inverted(self) -> bool:
        """True if it is set to answer no where sensors of its kind usually answer yes."""
        return False

    @property
    def beam(self) -> float | None:
        """Angle of its view, degrees from edge to edge; None if it does not look anywhere, or all around."""
        return None

    @property
    def view_words(self) -> tuple[str, ...]:
        """Its view in a few words each, such as `30 deg wide` and `5 rays`."""
        return ()

    @property
    def yes_words(self) -> tuple[str, str] | None:
        """The colour for which it answers yes, and the condition in words; None if it sees no colours."""
        return None


class Axes(Struct, frozen=True, gc=False):
    """One number for each axis of motion: x and y (translation) and r (rotation). A struct, for speed:
    reading a log makes one for each movement."""

    x: float = 0.0
    y: float = 0.0
    r: float = 0.0

    def share(self, segments: int) -> tuple[float, float, float]:
        """Each segment's share: x, y and r."""
        return self.x / segments, self.y / segments, self.r / segments


_NO_AXES = Axes()


class DriveKind(StrEnum):
    """The movements a robot can make; the value is the ID in drive.csv."""

    direction: Axes
    """Direction of a positive value, along one axis of the robot's frame: 1 or -1 there."""
    meaning: str
    """Motion of a positive value, in words."""
    turns: bool
    """True if it turns the robot, in degrees, and does not move it, in inches."""

    def __new__(cls, value: str, direction: Axes = _NO_AXES, meaning: str = "") -> Self:
        """A member with its row of the table below."""
        # Formulas of errors, reports and calibration have one axis along the motion, and two across.
        parts = sorted(map(abs, (direction.x, direction.y, direction.r)))
        assert parts == [0.0, 0.0, 1.0], f"{value} is not along one axis"
        kind = str.__new__(cls, value)
        kind._value_, kind.direction, kind.meaning = value, direction, meaning
        kind.turns = direction.r != 0.0
        return kind

    UP = "up", Axes(y=1.0), "drive left (+Y)"
    DOWN = "down", Axes(y=-1.0), "drive right (-Y)"
    LEFT = "left", Axes(x=-1.0), "drive back (-X)"
    RIGHT = "right", Axes(x=1.0), "drive forward (+X)"
    ROT = "rot", Axes(r=1.0), "turn counter-clockwise"

    @property
    def bearing(self) -> float:
        """Direction of a positive value of a drive that does not turn, degrees from the robot's front."""
        return math.degrees(math.atan2(self.direction.y, self.direction.x))

    @property
    def unit(self) -> str:
        """Unit of its values."""
        return "deg" if self.turns else "in"

    @property
    def verb(self) -> str:
        """Verb for its motion, as in `d1 drives the wrong way`."""
        return "turns" if self.turns else "drives"


class ContactRule(StrEnum):
    """The effect of a contact on a movement."""

    DRIVE = "drive"
    """The contact ends the movement only if the commanded motion itself is blocked. Errors on other axes,
    which only press the robot against a wall, are dropped for the rest of the command."""
    STOP = "stop"
    """The contact ends the movement."""


class DriveSpec(Struct, frozen=True, kw_only=True):
    """One row of drive.csv. `speed` is in/s, or deg/s for `rot`; `start_lag` seconds from a command
    to the first motion, `acceleration` in/s2 or deg/s2 (0: at full speed at once)."""

    kind: DriveKind
    code: str
    enabled: bool = True
    error: Axes = _NO_AXES
    bias: Axes = _NO_AXES
    gain: float = 1.0
    speed: float = TRANSLATION_SPEED
    start_lag: float = 0.0
    acceleration: float = 0.0


class GripperSpec(Struct, frozen=True, kw_only=True):
    """The row `grip` of drive.csv.

    `reach` and `width` are the window in front of the robot, inches: as far ahead of its footprint,
    and as wide, centred on its +X axis. `speed` is openings or closings a second.
    """

    code: str
    enabled: bool = True
    reach: float = 3.0
    width: float = 4.0
    speed: float = 2.0


class VelocityKind(StrEnum):
    """A command of continuous motion; the value is the ID in drive.csv."""

    values: tuple[str, ...]
    """Names of its values, without the time after which it ends; rim speeds are one for each wheel."""

    def __new__(cls, value: str, values: tuple[str, ...] = ()) -> Self:
        """A member with its row of the table below."""
        kind = str.__new__(cls, value)
        kind._value_, kind.values = value, values
        return kind

    ALL = "velocity", ("VX", "VY", "OMEGA")
    X = "velocity-x", ("VX",)
    Y = "velocity-y", ("VY",)
    R = "velocity-r", ("OMEGA",)
    WHEELS = "wheels"


class VelocitySpec(Struct, frozen=True, kw_only=True):
    """One row of drive.csv for a command of continuous motion."""

    kind: VelocityKind
    code: str
    enabled: bool = True


class WheelLayout(StrEnum):
    """Arrangement of a robot's wheels, as in `[wheels] layout`."""

    DIFF = "diff"
    """Two plain wheels on the Y axis."""
    OMNI_3 = "omni-3"
    """Three omni wheels at 0, 120 and 240 degrees."""
    OMNI_4 = "omni-4"
    """Four omni wheels: ahead, behind, left, right."""
    MECANUM = "mecanum"
    """Four wheels at the corners with rollers at 45 degrees."""


class WheelsSpec(Struct, frozen=True, kw_only=True):
    """A robot's wheels. `track` is the distance of left and right wheels, `wheelbase` that of front and
    rear ones, `radius` that of an omni wheel from the centre, all in inches; `top_speed` the greatest
    speed of a rim, in/s."""

    layout: WheelLayout
    track: float = 6.0
    wheelbase: float = 6.0
    radius: float = 3.0
    top_speed: float = 12.0


class SimulationSpec(Struct, frozen=True, kw_only=True):
    """Everything a `Simulator` needs but the seed.

    `bot_center` and `block_center` are in the global frame (origin at the maze's bottom-left corner);
    `bot_rot` is the start heading, degrees counter-clockwise from +X. `strength` holds the random bias of
    translations and of rotations; it is drawn only when `randbias` is set. `contact` is the rule by which
    contacts end a movement. `clearance` is the distance before a contact at which the robot stops (inches
    along its own path; in a turn, along its rim's). A `block_size` of 0 means that there is no block.
    """

    maze: MazeSpec
    robot: RobotSpec
    sensors: tuple[SensorSpec, ...]
    drives: tuple[DriveSpec, ...]
    bot_center: tuple[float, float]
    bot_rot: float = 0.0
    block_center: tuple[float, float] = (25.0, 41.0)
    block_size: float = 3.0
    block_solid: bool = False
    num_segments: int = 10
    strength: tuple[float, float] = (0.05, 1.0)
    randbias: bool = True
    gripper: GripperSpec | None = None
    contact: ContactRule = ContactRule.DRIVE
    clearance: float = 0.0
    velocities: tuple[VelocitySpec, ...] = ()
    wheels: WheelsSpec | None = None
    velocity_timeout: float = 0.0
    """Seconds after which a velocity ends unless it is sent again; 0 for never."""
    loop_time: float = 0.02
    """Seconds that a pass of a program's loop takes in instant motion while its robot drives."""
    wall_friction: float = 0.3
    """Friction of a robot that slides along a wall: speed lost, as a share of the speed into the wall."""
    control_period: float = 0.02
    """Seconds of a step of the robot's speed control."""

    @property
    def start_pose(self) -> Pose:
        """The robot's pose as a run begins."""
        x, y = self.bot_center
        return Pose(float(x), float(y), float(self.bot_rot))

    @property
    def start_block(self) -> Block:
        """The block as a run begins."""
        return Block(*self.block_center, self.block_size)

    @property
    def drive_rows(self) -> tuple[DriveSpec | GripperSpec, ...]:
        """The rows of drive.csv whose commands take their time: the movements, and the gripper if it has
        one."""
        return self.drives if self.gripper is None else (*self.drives, self.gripper)
