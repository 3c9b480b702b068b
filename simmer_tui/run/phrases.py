"""Phrases for contacts, grips and the ends of programs: screens, pages and reports all take them from here.

Places, lengths and headings are given to a tenth everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from simmer_tui.run.events import MovementEnded, ProgramEnded
from simmer_tui.sim.angles import half_turn, side_name
from simmer_tui.sim.arcs import Twist
from simmer_tui.sim.command import BOARD_SOURCE, counted, cut
from simmer_tui.sim.path import Contact
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import Grip, LidarScan
from simmer_tui.sim.scan_rays import extremes
from simmer_tui.sim.specs import CELL_SIZE, DriveKind, SimulationSpec
from simmer_tui.sim.trajectory import Trajectory

_LONGEST = 200
"""Characters of text from a program that are shown."""
# Inches; two decimals show less as 0.
_SHOWN_MISS = 0.005


def is_of_boards(source: str) -> bool:
    """True for the source of a command that a board has made."""
    return source.partition(",")[0] == BOARD_SOURCE


def board_place(source: str) -> str:
    """The board and line that made a command: `board main at a.ino:4`; empty if they are not known."""
    _, _, place = source.partition(", ")
    return f"board {place}" if place and is_of_boards(source) else ""


def sent_by_text(source: str, shown: str) -> str:
    """The sender's action, for a command as it is shown: a program sends it, a board sets its speeds."""
    if is_of_boards(source):
        return f"{board_place(source) or 'a board'} set {shown}"
    return f"{shown} was sent"


# -- numbers and places ----------------------------------------------------------------------------


SHOWN_OUTPUT = 5
"""Last lines of a program's output that a page shows: an error and where it is. The log has more."""
NOTHING_SENT = "nothing was sent"
"""Reason for the failure of a run in which no command came from a program that ended with exit code 0."""
REAL_TIME_LIMIT = "the real time limit"
"""Beginning of the reason for the failure of a run that was ended because real time was up."""
WEDGED_TEXT = "wedged: back off before turning"
"""Advice to a robot that touches something in one place again and again."""


def computing_text(timing: str) -> str:
    """Simulated time that a program's computing costs, by `MotionSettings.timing`."""
    if timing == "program":
        return "Time is the program's clock: while a program computes, simulated time stands still."
    if timing == "timed":
        return "Motion is timed: while a program computes, simulated time continues."
    return "Motion is instant: while a program computes, simulated time stands still."


def capitalized(text: str) -> str:
    """A phrase as the beginning of a sentence; names within keep their letters."""
    return f"{text[0].upper()}{text[1:]}"


def contacts_text(number: int) -> str:
    """`no contact`, `1 contact`, `3 contacts`."""
    return counted(number, "contact") if number else "no contact"


def times_text(number: int) -> str:
    """`once`, `twice`, `3 times`."""
    return {1: "once", 2: "twice"}.get(number, f"{number} times")


def place_text(x: float, y: float) -> str:
    """`(12.3, 4.5)`, inches."""
    return f"({x:.1f}, {y:.1f})"


def pose_text(pose: Pose) -> str:
    """`(12.3, 4.5) heading 90.0 deg`."""
    return f"{place_text(pose.x, pose.y)} heading {pose.heading:.1f} deg"


def scan_text(scan: LidarScan) -> str:
    """`360 ranges, nearest 5.9 in at -90 deg`: the direction in the robot's frame, to the left positive."""
    seen, found = counted(len(scan.ranges), "range"), extremes(scan)
    if found.nearest is None:
        return f"{seen}, nothing in reach"
    distance, bearing = found.nearest
    return f"{seen}, nearest {distance:.1f} in at {round(half_turn(bearing)) or 0} deg"


# -- contacts --------------------------------------------------------------------------------------


def body_text(contact: Contact) -> str:
    """The body that touched: `the robot` or `the block it holds`."""
    return "the block it holds" if contact.held_block else "the robot"


def obstacle_text(contact: Contact) -> str:
    """The obstacle that was touched: `the wall` or `the block`."""
    return "the wall" if contact.cell is not None else "the block"


def obstacles_text(contacts: Iterable[Contact]) -> str:
    """The obstacles of some contacts: `a wall` (of none too), `the block`, or `a wall or the block`."""
    found = {"the block" if each.cell is None else "a wall" for each in contacts}
    return " or ".join(sorted(found)) or "a wall"


def obstacle_place(contact: Contact, spec: SimulationSpec) -> str:
    """The obstacle that was touched, its cell and the place: `the wall in row 1, column 2 at (1.0, 2.0)`."""
    obstacle = obstacle_text(contact)
    if contact.cell is not None:
        row, column = contact.cell
        inside = 1 <= row <= spec.maze.rows and 1 <= column <= spec.maze.columns
        obstacle = f"the wall in row {row}, column {column}" if inside else "the maze's outer wall"
    return f"{obstacle} at {place_text(*contact.point)}"


def contact_text(contact: Contact, spec: SimulationSpec) -> str:
    """`the robot touched the wall in row 1, column 2 at (1.0, 2.0)`."""
    return f"{body_text(contact)} touched {obstacle_place(contact, spec)}"


def contact_ending(contact: Contact, pose: Pose, after: str = "") -> str:
    """Effect of a contact on its movement: `was stopped at ... by the wall at ...`.

    Args:
        contact: The movement's first contact.
        pose: Pose at the end of the movement.
        after: Distance travelled, put before the pose: `after 3.0 in `.
    """
    there = f"{after}at {pose_text(pose)}"
    obstacle = f"{obstacle_text(contact)} at {place_text(*contact.point)}"
    if not contact.ended:
        return f"touched {obstacle} and went on; it ended {there}"
    # Something else ended it: a later stop, of a command or of a person.
    if pose != contact.pose:
        return f"touched {obstacle} and was stopped later, {there}"
    return f"was stopped {there} by {obstacle}"


def side_text(contact: Contact) -> str:
    """Side of the robot that a contact is on: `ahead left`."""
    return side_name(contact.bearing)


# -- movements and their ends ----------------------------------------------------------------------


def _direction_name(kind: DriveKind, value: float) -> str:
    """Direction in which a drive moves the robot with a value of this sign: `forward`."""
    return side_name(kind.bearing + 180.0 if value < 0 else kind.bearing, "forward", "back")


def movement_text(ended: MovementEnded) -> str:
    """A movement as it really was: `forward 12.0 in`, `turned -90.6 deg`."""
    trajectory = ended.trajectory
    begin = trajectory.pose_at(trajectory.start_time)
    # Along the path, as all totals are: in a curve that is longer than the displacement ahead.
    end, went = ended.pose, trajectory.travelled(ended.time)
    kind = trajectory.kind
    if kind is None:
        return "stood still"
    if kind.turns:
        return f"turned {end.heading - begin.heading:.1f} deg"
    heading = math.radians(begin.heading)
    x, y = end.x - begin.x, end.y - begin.y
    ahead, left = x * math.cos(heading) + y * math.sin(heading), y * math.cos(heading) - x * math.sin(heading)
    along = ahead * kind.direction.x + left * kind.direction.y
    return f"{_direction_name(kind, along)} {went:.1f} in"


def went_text(ended: MovementEnded) -> str:
    """Distance or angle of a movement as it really was: `35.6 in`."""
    *_, distance, unit = movement_text(ended).split()
    return f"{distance} {unit}"


def asked_text(kind: DriveKind, value: float) -> str:
    """Movement that a command asks for: `20.0 in forward`, `turn by -30.0 deg`."""
    if kind.turns:
        return f"turn by {value:.1f} deg"
    return f"{abs(value):.1f} in {_direction_name(kind, value)}"


def progress_text(trajectory: Trajectory, value: float | str, time: float) -> str:
    """A movement under way at a simulated time: `forward, 4.1 of 12 in`. `value` is what was asked for, or
    no number."""
    kind = trajectory.kind
    if kind is None:
        return "moving the gripper"
    asked = f" of {abs(value):g}" if isinstance(value, float) else ""
    if kind.turns:
        begin = trajectory.pose_at(trajectory.start_time).heading
        return f"turning, {abs(trajectory.pose_at(time).heading - begin):.1f}{asked} deg"
    direction = _direction_name(kind, value if isinstance(value, float) else 1.0)
    return f"{direction}, {trajectory.travelled(time):.1f}{asked} in"


def stopped_text(contact: Contact) -> str:
    """Obstacle that stopped a movement, its side, and the block if that hit: `stopped by a wall ahead`."""
    obstacle = obstacles_text((contact,))
    held = ", with the held block" if contact.held_block else ""
    return f"stopped by {obstacle} {side_text(contact)}{held}"


def stopped_by_text(ended: MovementEnded) -> str:
    """Sender that stopped a movement early: `, stopped by reset from console`; empty if nobody did."""
    return f", stopped by {ended.stopped_by}" if ended.stopped_by else ""


def contact_line(ended: MovementEnded, contact: Contact) -> str:
    """A movement with a contact, short: `contact left after 3.0 in`."""
    body = "held block " if contact.held_block else ""
    moved = movement_text(ended)
    if not contact.ended:
        return f"{moved}, {body}touched {obstacle_text(contact)} {side_text(contact)}"
    *_, distance, unit = moved.split()
    after = "" if ended.trajectory.kind is None else f" after {distance.lstrip('-')} {unit}"
    block = ", the block" if contact.cell is None else ""
    return f"{body}contact {side_text(contact)}{after}{block}"


def velocity_text(twist: Twist) -> str:
    """A velocity in words: `forward 4.0 in/s, turning -20 deg/s`; `standing` for none."""
    parts = []
    for value, kind in ((twist.x, DriveKind.RIGHT), (twist.y, DriveKind.UP)):
        if value:
            parts.append(f"{_direction_name(kind, value)} {abs(value):.1f} in/s")
    if twist.r:
        parts.append(f"turning {twist.r:.0f} deg/s")
    return ", ".join(parts) or "standing"


# -- grips -----------------------------------------------------------------------------------------


def grip_text(grip: Grip) -> str:
    """State of the gripper, short: `holding the block`."""
    if grip.holding:
        return "holding the block"
    return "closed on nothing" if grip.closed else "open"


def grip_ending(grip: Grip) -> str:
    """Result of a grip: `closed the gripper, which holds the block`."""
    if not grip.closed:
        return "opened the gripper"
    if grip.holding:
        return "closed the gripper, which holds the block"
    missed = "the block was not between its jaws" if grip.missed is None else miss_text(grip.missed)
    return f"closed the gripper, which holds nothing: {missed}"


def miss_text(missed: tuple[float, float]) -> str:
    """Distance of the block from the gripper's window, and the side.

    Args:
        missed: As in `Grip.missed`, inches in the robot's frame: ahead, left.
    """
    beyond, left = missed
    away = math.hypot(beyond, left)
    if away > CELL_SIZE:
        return f"the block lay {away:.0f} in away"
    parts = []
    if abs(beyond) > _SHOWN_MISS:
        parts.append(f"{abs(beyond):.2f} in too {'far ahead' if beyond > 0 else 'near'}")
    if abs(left) > _SHOWN_MISS:
        parts.append(f"{abs(left):.2f} in too far to the {'left' if left > 0 else 'right'}")
    if parts:
        return f"the block's middle was {' and '.join(parts)}"
    if beyond == left == 0.0:
        return "its jaws were closed already, or the block just at the edge"
    return "the block's middle was just outside its window"


def outside_text(off: tuple[float, float]) -> str:
    """Distance of a place from a zone, and the side: `2.0 in to the left of and 1.0 in above`.

    Args:
        off: Inches in the maze's frame: right, up.
    """
    x, y = off
    parts = []
    if x:
        parts.append(f"{abs(x):.1f} in to the {'right' if x > 0 else 'left'} of")
    if y:
        parts.append(f"{abs(y):.1f} in {'above' if y > 0 else 'below'}")
    return " and ".join(parts)


# -- ends of programs ------------------------------------------------------------------------------


def crash_text(program: ProgramEnded) -> str:
    """The error that a program crashed with, and where: `KeyError: 'u9' in robot.py:12`."""
    place = f" in {cut(program.place, _LONGEST)}" if program.place else ""
    return f"{cut(program.error, _LONGEST)}{place}"


def exit_text(code: int | None) -> str:
    """End of a program by itself, with its exit code if that is known: `the program ended with exit code 3`.
    It is the reason of a mission's end, too."""
    return "the program ended" if code is None else f"the program ended with exit code {code}"


def program_end_text(program: ProgramEnded) -> str:
    """End of a program: `the program crashed: ...`, `the program ended with exit code 3`."""
    if program.stopped:
        return "the program was stopped"
    if not program.started:
        return f"the program {crash_text(program)}"
    if program.crashed:
        return f"the program crashed: {crash_text(program)}"
    return exit_text(program.exit_code)


def last_output(program: ProgramEnded) -> str:
    """The last line that a program printed, on standard error if it failed; empty without any."""
    streams = (program.stderr, program.stdout) if program.exit_code else (program.stdout, program.stderr)
    said = (line.text.strip() for lines in streams for line in reversed(lines))
    return cut(next(filter(None, said), ""), _LONGEST)
