"""Why the last movement of a run ended as it did, in a sentence or two."""

from __future__ import annotations

import math

from simmer_tui.events import MovementEnded
from simmer_tui.sim.command import escape
from simmer_tui.sim.path import Contact
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import SimulationSpec
from simmer_tui.state import SensorRow, State

NOTHING_MOVED = "No movement has ended yet."


def why(state: State, spec: SimulationSpec) -> str:
    """Why the movement that ended last did so: who stopped it, or what it met, and what the sensor that
    looks that way had read."""
    ended = state.ended
    if ended is None:
        return NOTHING_MOVED
    if ended.grip is not None:
        return _grip(ended)
    contact = ended.contact
    if ended.stopped_by:
        touched = f" It had touched {_what(contact, spec)} on its way." if contact is not None else ""
        by = escape(ended.stopped_by, 80)
        return f"{_begins(ended)} was stopped by {by} at {ended.time:.2f} s, after {_went(ended)}.{touched}"
    if contact is None:
        return (
            f"{_begins(ended)} ended as it was to, at {ended.time:.2f} s: nothing was in its way. With its "
            f"errors it went {_went(ended)}."
        )
    if not contact.ended:
        return (
            f"{_begins(ended)} went on to its end, {_went(ended)}: an error only, not the command, pressed "
            f"{_body(contact)} against {_what(contact, spec)}."
        )
    return (
        f"{_begins(ended)} was stopped at {contact.time:.2f} s, after {_went(ended)}: {_body(contact)} met "
        f"{_what(contact, spec)}{_cause(contact)}. {_seen(state, contact, spec)}"
    )


def _begins(ended: MovementEnded) -> str:
    begun = ended.trajectory.start_time
    return f"{ended.command.shown} ({ended.command.source}, begun at {begun:.2f} s)"


def _went(ended: MovementEnded) -> str:
    """How far it came, of how far it was to, errors included."""
    trajectory = ended.trajectory
    if trajectory.turning:
        turned = ended.pose.heading - trajectory.pose_at(trajectory.start_time).heading
        return f"{turned:.1f} of {trajectory.totals.r:.1f} deg"
    whole = math.hypot(trajectory.totals.x, trajectory.totals.y)
    return f"{trajectory.travelled(ended.time):.1f} of {whole:.1f} in"


def _body(contact: Contact) -> str:
    return "the block it holds" if contact.held_block else "the robot"


def _what(contact: Contact, spec: SimulationSpec) -> str:
    """What was touched, and where."""
    point = f"({contact.point[0]:.1f}, {contact.point[1]:.1f})"
    if contact.cell is None:
        return f"the block at {point}"
    row, column = contact.cell
    if 1 <= row <= spec.maze.rows and 1 <= column <= spec.maze.columns:
        return f"the wall in row {row}, column {column} at {point}"
    return f"the maze's outer wall at {point}"


def _cause(contact: Contact) -> str:
    if contact.drift:
        return " by drift: the command alone would not have led there"
    return ", where the command led it"


def _seen(state: State, contact: Contact, spec: SimulationSpec) -> str:
    """What the sensor that looks most nearly at the place touched has read last."""
    looking = [each for each in spec.sensors if each.enabled and each.kind.is_range]
    if not looking:
        return "The robot has no sensor that looks ahead."
    towards = math.degrees(math.atan2(*reversed(_offset(contact)))) - contact.pose.heading
    sensor = min(looking, key=lambda each: abs((each.rotation - towards + 180.0) % 360.0 - 180.0))
    off = abs((sensor.rotation - towards + 180.0) % 360.0 - 180.0)
    side = "which looks that way" if off <= 30.0 else f"the nearest, which looks {off:.0f} deg beside it"
    row = state.sensors.get(sensor.code)
    if row is None:
        return f"{sensor.code}, {side}, was not read."
    return f"{sensor.code}, {side}, last read {_value(row)} at {row.time:.2f} s{_before(row, contact)}."


def _offset(contact: Contact) -> tuple[float, float]:
    pose: Pose = contact.pose
    return contact.point[0] - pose.x, contact.point[1] - pose.y


def _value(row: SensorRow) -> str:
    value, unit = row.reading.value, row.reading.sensor.unit
    return f"{value:.1f} {unit}".rstrip() if math.isfinite(value) else "nothing in range"


def _before(row: SensorRow, contact: Contact) -> str:
    ago = contact.time - row.time
    return f", {ago:.2f} s before the contact" if ago >= 0.0 else ", after it"


def _grip(ended: MovementEnded) -> str:
    grip = ended.grip
    assert grip is not None, "only the gripper's movements are asked about here"
    stopped = f", and was stopped by {escape(ended.stopped_by, 80)}" if ended.stopped_by else ""
    if not grip.closed:
        return f"{_begins(ended)} opened the gripper{stopped}."
    held = "holds the block" if grip.holding else "holds nothing: the block was not between its jaws"
    return f"{_begins(ended)} closed the gripper, which {held}{stopped}."
