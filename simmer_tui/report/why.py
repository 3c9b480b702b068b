"""Why the last movement of a run ended as it did, in a sentence or two."""

from __future__ import annotations

import math

from simmer_tui.events import MovementEnded
from simmer_tui.report.facts import LastWord, lookout
from simmer_tui.report.wording import shown_body, shown_drift, shown_lookout, shown_miss, shown_obstacle
from simmer_tui.sim.command import escape
from simmer_tui.sim.path import Contact
from simmer_tui.sim.specs import SimulationSpec
from simmer_tui.state import State

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
        touched = (
            f" It had touched {shown_obstacle(contact, spec)} on its way." if contact is not None else ""
        )
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
            f"{shown_body(contact)} against {shown_obstacle(contact, spec)}."
        )
    return (
        f"{_begins(ended)} was stopped at {contact.time:.2f} s, after {_went(ended)}: "
        f"{shown_body(contact)} met {shown_obstacle(contact, spec)}, {shown_drift(contact)}. "
        f"{_seen(state, contact, spec)}"
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


def _seen(state: State, contact: Contact, spec: SimulationSpec) -> str:
    """What the sensor that looks most nearly at the place touched has read last."""
    words = {
        code: LastWord(code, row.reading.value, row.reading.true, row.time)
        for code, row in state.sensors.items()
    }
    return shown_lookout(lookout(contact, spec.sensors, words), contact.time)


def _grip(ended: MovementEnded) -> str:
    grip = ended.grip
    assert grip is not None, "only the gripper's movements are asked about here"
    stopped = f", and was stopped by {escape(ended.stopped_by, 80)}" if ended.stopped_by else ""
    if not grip.closed:
        return f"{_begins(ended)} opened the gripper{stopped}."
    missed = "the block was not between its jaws" if grip.missed is None else shown_miss(grip.missed)
    held = "holds the block" if grip.holding else f"holds nothing: {missed}"
    return f"{_begins(ended)} closed the gripper, which {held}{stopped}."
