"""The rows of a run's history: each event with its time, its line in the log and the pose.

`order` is the running number of the event in the run, `line` that of its line in the log (0 without one).
`elapsed` are simulated seconds since the history's beginning, which continue through resets. Annotations are
evaluated here: they say how a row is packed.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

from msgspec import Struct

from simmer_tui.run.events import (
    ActionDone,
    CommandResult,
    DisplayChanged,
    MissionEvent,
    MovementEnded,
    Notice,
    ProgramEnded,
)
from simmer_tui.run.facts import NO_HEADING, UNSURE, Deviation, degrees_beside
from simmer_tui.run.table import Index, Single
from simmer_tui.sim.block import Block
from simmer_tui.sim.path import Contact
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import Grip, Reading
from simmer_tui.sim.specs import Axes, DriveKind

# -- packed: numbers only, since a long run has very many --------------------------------------------


class CommandRow(NamedTuple):
    """The result of a command. `code` and `source` are indices into the history's `code_names` and
    `source_names`; `real_time` is in seconds since the first event, NaN where it is not known. `early` is
    true of the refused ones that came while the robot still moved. The pose is in the row of its reading,
    movement or refusal."""

    order: int
    line: int
    elapsed: float
    real_time: Single
    number: int
    code: Index
    source: Index
    refused: bool
    early: bool
    link: float


class ReadingRow(NamedTuple):
    """A reading: `elapsed` when it was answered, `taken` when it was taken, on the same clock. `sensor` is
    an index into `sensor_codes`. `error` is NaN where the truth is not known, infinite for a value where
    nothing was in range, or the reverse. `gone` (inches) and `turned` (degrees in either direction) are the
    robot's totals by then."""

    order: int
    line: int
    elapsed: float
    taken: float
    sensor: Index
    value: float
    true: float
    error: float
    took: Single
    gone: Single
    turned: Single
    x: Single
    y: Single
    heading: Single


class MovementRow(NamedTuple):
    """A movement that has ended: `elapsed` is its end, `begin` and `arrival` (the last moment it moved) are
    on the same clock. `gone` and `turned` are sums with this movement, `went` is its own distance, inches.
    `held` is true if a contact ended it, `contact` if there was one. `pressed` is true for a leg in which an
    obstacle kept the robot from moving as its wheels turned. `asked` is the value of its command (inches or
    degrees), and `total_x`, `total_y`, `total_r` are its whole displacement in the robot's frame, errors
    included. All are NaN where nothing was asked, or where it was cut short."""

    order: int
    line: int
    begin: float
    arrival: float
    elapsed: float
    real_time: Single
    number: int
    code: Index
    grips: bool
    answers: bool
    contact: bool
    held: bool
    pressed: bool
    went: float
    gone: float
    turned: Single
    asked: float
    total_x: Single
    total_y: Single
    total_r: Single
    x: Single
    y: Single
    heading: Single

    @property
    def pose(self) -> Pose:
        """Pose at its end."""
        return Pose(self.x, self.y, self.heading)


class BeliefRow(NamedTuple):
    """A belief, the true pose then, and the error that the program allowed for. `spread` is NaN where it gave
    none; `gone` is the total distance driven by then, inches. Of a grid, `entropy` is in bits,
    `true_probability` is that of the true state, `above` that of all states likelier than it and its
    neighbours; NaN without a grid. Particles and cells stay in the log."""

    order: int
    line: int
    elapsed: float
    x: float
    y: float
    heading: float
    true_x: float
    true_y: float
    true_heading: float
    spread: float
    distance: float
    turn: float
    allowed: float
    allowed_turn: float
    gone: float
    entropy: Single
    true_probability: float
    above: float

    @property
    def believed(self) -> Pose:
        """Pose that the program believed."""
        return Pose(self.x, self.y, self.heading)

    @property
    def true(self) -> Pose:
        """Pose at that moment."""
        return Pose(self.true_x, self.true_y, self.true_heading)

    @property
    def deviation(self) -> Deviation:
        """Difference of the believed pose from the true one."""
        return Deviation(self.distance, self.turn, self.allowed, self.allowed_turn, self.above)

    @property
    def is_grid(self) -> bool:
        """True if the belief has a probability for each cell."""
        return not math.isnan(self.above)

    @property
    def tells_heading(self) -> bool:
        """True unless it is a grid without headings."""
        return not (self.is_grid and self.allowed_turn == NO_HEADING)

    @property
    def error_text(self) -> str:
        """Its error in words: `3.4 in and 12 deg`, or `3.4 in` if it tells no heading."""
        turn = f" and {abs(self.turn):.0f} deg" if self.tells_heading else ""
        return f"{self.distance:.1f} in{turn}"

    @property
    def finite(self) -> bool:
        """True if the pose and its distance from the truth are finite."""
        return math.isfinite(self.distance) and math.isfinite(self.turn)

    @property
    def lost(self) -> bool:
        """True if it was off by more than the program allowed for: the one definition of being lost."""
        return self.finite and self.deviation.wrong

    @property
    def unsure(self) -> bool:
        """True if the spread is too large for a decision."""
        # A comparison with NaN, where there is none, is False.
        return self.spread > UNSURE

    @property
    def is_right(self) -> bool:
        """True if it was right and sure."""
        return self.finite and not self.lost and not self.unsure


# -- objects, of which the newest and the first are kept -----------------------------------------------


class LoggedRow(Struct, frozen=True):
    """A row with its event, its line and its time."""

    order: int
    line: int
    elapsed: float


class SeenReading(Struct, frozen=True):
    """A reading before a contact, without its view, and the text of its command."""

    text: str
    reading: Reading


class ContactRow(LoggedRow, frozen=True):
    """A movement that touched something: `elapsed` is when, `went` (inches) and `turned` (degrees) are its
    distance and turning at its end, `gone_before` and `turned_before` the robot's totals before it. `seen`
    has, by sensor code, the readings since the movement before."""

    ended: MovementEnded
    contact: Contact
    pose: Pose
    went: float
    turned: float
    gone_before: float
    turned_before: float
    read: Mapping[str, SeenReading]
    shown: str
    """The command, as people read it, behind the message of a dialect that led to it."""

    @property
    def point(self) -> tuple[float, float]:
        """Place that was touched, inches."""
        return self.contact.point

    @property
    def seen(self) -> tuple[SeenReading, ...]:
        """Readings before it: range sensors first, of these the one that looks there."""

        def rank(each: SeenReading) -> float:
            sensor = each.reading.sensor
            return degrees_beside(self.contact, sensor) if sensor.kind.is_range else math.inf

        return tuple(sorted(self.read.values(), key=rank))


class RepeatedContact(Struct):
    """A contact, or several in a row of the same command at the same place; `until` is when (elapsed
    seconds) the last one was."""

    first: ContactRow
    until: float
    count: int = 1

    @property
    def elapsed(self) -> float:
        """Elapsed time of the first of the contacts, seconds."""
        return self.first.elapsed


class RefusalRow(LoggedRow, frozen=True):
    """A command that did nothing, and its result."""

    result: CommandResult


class ActionRow(LoggedRow, frozen=True):
    """An action of a person, and the pose before it; `action.pose` is that after it."""

    done: ActionDone
    before: Pose


class GripRow(LoggedRow, frozen=True):
    """A grip; `had` is True if the robot held the block before."""

    grip: Grip
    had: bool


class BlockPose(Struct, frozen=True):
    """The block from here on: in the robot's frame while it is `held`, else in the maze's."""

    order: int
    elapsed: float
    held: bool
    block: Block


class BiasRow(Struct, frozen=True):
    """The drives' bias in force from here on."""

    order: int
    elapsed: float
    bias: Mapping[DriveKind, Axes]


class NoticeRow(LoggedRow, frozen=True):
    """Something beside the commands."""

    notice: Notice

    @property
    def text(self) -> str:
        """Sentence of the notice."""
        return self.notice.text


class DisplayRow(LoggedRow, frozen=True):
    """A board shows something else."""

    event: DisplayChanged


class MissionRow(LoggedRow, frozen=True):
    """A mission's beginning or end, or a goal met."""

    event: MissionEvent

    @property
    def text(self) -> str:
        """Sentence of the referee."""
        return self.event.text


class ProgramRow(LoggedRow, frozen=True):
    """End of the program that drove the robot."""

    event: ProgramEnded
