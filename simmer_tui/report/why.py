"""Reason for the end of a run's last movement, in a sentence or two, and what a sensor saw of it."""

from __future__ import annotations

import math

from simmer_tui.events import MovementEnded
from simmer_tui.phrases import body_text, drift_text, grip_ending, obstacle_place
from simmer_tui.run.facts import BESIDE, FacingSensor, LastReading, facing_sensor
from simmer_tui.run.state import State
from simmer_tui.sim.command import escape
from simmer_tui.sim.path import Contact
from simmer_tui.sim.specs import SimulationSpec

NOTHING_MOVED = "No movement has ended yet."


def why(state: State, spec: SimulationSpec) -> str:
    """Why the movement that ended last did so: who stopped it, or what it met, and what the sensor that
    looks that way had read."""
    ended = state.ended
    if ended is None:
        return NOTHING_MOVED
    begins = f"{ended.command.shown} ({ended.command.source}, begun at {ended.trajectory.start_time:.2f} s)"
    by = f"was stopped by {escape(ended.stopped_by, 80)}" if ended.stopped_by else ""
    if ended.grip is not None:
        return f"{begins} {', and '.join(filter(None, (grip_ending(ended.grip), by)))}."
    contact, went = ended.contact, _went(ended)
    if by:
        touched = "" if contact is None else f" It had touched {obstacle_place(contact, spec)} on its way."
        return f"{begins} {by} at {ended.time:.2f} s, after {went}.{touched}"
    if contact is None:
        return f"{begins} ended at {ended.time:.2f} s, after {went}. Nothing was in the way."
    if not contact.ended:
        return (
            f"{begins} went on to its end, {went}: an error only, not the command, pressed "
            f"{body_text(contact)} against {obstacle_place(contact, spec)}."
        )
    return (
        f"{begins} was stopped at {contact.time:.2f} s, after {went}: {body_text(contact)} met "
        f"{obstacle_place(contact, spec)}, {drift_text(contact)}. {_seen(state, contact, spec)}"
    )


def _went(ended: MovementEnded) -> str:
    """Distance travelled, of the distance planned with errors."""
    trajectory = ended.trajectory
    if trajectory.turning:
        turned = ended.pose.heading - trajectory.pose_at(trajectory.start_time).heading
        return f"{turned:.1f} of {trajectory.totals.r:.1f} deg"
    whole = math.hypot(trajectory.totals.x, trajectory.totals.y)
    return f"{trajectory.travelled(ended.time):.1f} of {whole:.1f} in"


def _seen(state: State, contact: Contact, spec: SimulationSpec) -> str:
    """The last reading of the sensor that looks most nearly at the place touched."""
    words = {
        code: LastReading(code, row.reading.value, row.reading.true, row.time)
        for code, row in state.sensors.items()
    }
    return facing_sensor_text(facing_sensor(contact, spec.sensors, words), contact.time)


def facing_sensor_text(looks: FacingSensor | None, time: float) -> str:
    """The last reading of the sensor that looks at a contact, or nearest to it."""
    if looks is None:
        return "The robot has no sensor that looks ahead."
    last = looks.last
    code = looks.codes[0] if last is None else last.code
    side = "which looks that way"
    if looks.beside > 30.0:
        side = f"the nearest, which looks {looks.beside:.0f} deg beside it"
    if last is None:
        return f"{code}, {side}, was not read."
    ago = time - last.time
    when = f", {ago:.2f} s before the contact" if ago >= 0.0 else ", after it"
    return f"{code}, {side}, last read {shown_range(last.value)} at {last.time:.2f} s{when}."


def looks_there(looks: FacingSensor | None) -> bool:
    """True if a sensor looked at the place at all."""
    return looks is not None and looks.beside <= BESIDE


def shown_range(value: float) -> str:
    """A distance that was read."""
    return f"{value:.1f} in" if math.isfinite(value) else "nothing in range"
