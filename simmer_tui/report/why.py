"""The facts about the end of a run's last movement, with the reading of the sensor that looks there."""

from __future__ import annotations

import math

from msgspec import Struct

from simmer_tui.run.events import MovementEnded
from simmer_tui.run.facts import BESIDE, FacingSensor, LastReading, facing_sensor
from simmer_tui.run.phrases import (
    asked_text,
    body_text,
    grip_ending,
    movement_text,
    obstacle_place,
    stopped_text,
    went_text,
)
from simmer_tui.run.state import State
from simmer_tui.sim.command import cut, parse_value
from simmer_tui.sim.path import Contact
from simmer_tui.sim.specs import Axes, DriveKind, SimulationSpec
from simmer_tui.sim.trajectory import Trajectory

# Judged: a third of a right angle; a sensor that looks further aside may see something else.
_ASIDE = 30.0
"""Degrees beside a contact from which the text names a sensor's direction."""
# Half of the last digit shown, a tenth.
_SHOWN_ERROR = 0.05
NOTHING_MOVED = "No movement has ended yet, and nothing was touched."


class WhyFact(Struct, frozen=True):
    """One fact about a movement: `label` is a word such as `asked`, `is_bad` is true for what stopped it."""

    label: str
    text: str
    is_bad: bool = False


def why(state: State, spec: SimulationSpec) -> tuple[WhyFact, ...]:
    """Facts about the end of the last movement, or about a later contact at a velocity: its command, its
    distance, its errors, and who or what stopped it. A contact has the reading of the sensor that looks
    there. Empty before the first."""
    ended = state.ended
    if ended is None:
        return ()
    if ended.grip is not None:
        grip = WhyFact("gripper", grip_ending(ended.grip))
        return (grip, WhyFact("ended", _stop_text(ended), is_bad=True)) if ended.stopped_by else (grip,)
    kind, value = ended.trajectory.kind, parse_value(ended.command.argument)
    facts, errors = [], ""
    if kind is not None and isinstance(value, float):
        facts = [WhyFact("asked", asked_text(kind, value))]
        errors = _errors(state, ended.trajectory, kind, value)
    contact = ended.contact
    if contact is not None and contact.ended and not ended.stopped_by:
        return (*facts, *_contact_facts(state, ended, contact, spec))
    facts.append(WhyFact("went", movement_text(ended)))
    if errors and not ended.stopped_by:
        facts.append(WhyFact("errors", errors))
    if contact is not None:
        facts.append(
            WhyFact("touched", f"{obstacle_place(contact, spec)}, by {body_text(contact)}", is_bad=True)
        )
    if ended.stopped_by:
        return (*facts, WhyFact("ended", _stop_text(ended), is_bad=True))
    touched = "nothing in its way" if contact is None else "the contact came of drive errors alone"
    return (*facts, WhyFact("ended", f"as asked; {touched}"))


def _contact_facts(
    state: State, ended: MovementEnded, contact: Contact, spec: SimulationSpec
) -> tuple[WhyFact, ...]:
    """Facts about a movement that a contact stopped."""
    return (
        WhyFact("went", f"{went_text(ended)}, {stopped_text(contact)} (X)", is_bad=True),
        WhyFact("hit", obstacle_place(contact, spec)),
        WhyFact("sensor", _seen(state, contact, spec)),
        WhyFact("errors", f"exact drives would have hit {'nothing' if contact.drift else 'it too'}"),
    )


def _stop_text(ended: MovementEnded) -> str:
    return f"stopped by {cut(ended.stopped_by)} at {ended.time:.2f} s"


def _errors(state: State, trajectory: Trajectory, kind: DriveKind, value: float) -> str:
    """Parts of the error along the movement: by the drive's bias, and by chance. Empty if there is none.

    total = asked + value * bias + chance, on the axis of the movement (sim/motion.py).
    """
    # The gain scales the command; it is not an error.
    value *= next((drive.gain for drive in state.spec.drives if drive.kind is kind), 1.0)
    bias, totals, direction = state.bias.get(kind, Axes()), trajectory.totals, kind.direction
    share = bias.r if kind.turns else bias.x if direction.x else bias.y
    along = totals.x * direction.x + totals.y * direction.y + totals.r * direction.r
    # A value such as -3 moves backwards; a turn to the right has negative degrees.
    sign = -1.0 if value < 0 and not kind.turns else 1.0
    by_bias, total, unit = sign * value * share, sign * (along - value), "deg" if kind.turns else "in"
    if abs(total) < _SHOWN_ERROR and abs(by_bias) < _SHOWN_ERROR:
        return ""
    return f"bias {by_bias:+z.1f} {unit}, noise {total - by_bias:+z.1f} {unit}"


def _seen(state: State, contact: Contact, spec: SimulationSpec) -> str:
    """The last reading of the sensor that looks most nearly at the place touched."""
    words = {
        code: LastReading(code, row.reading.value, row.reading.true, row.time)
        for code, row in state.sensors.items()
    }
    looks = facing_sensor(contact, spec.sensors, words)
    if looks is None:
        return "no sensor looks ahead"
    code = looks.codes[0] if looks.last is None else looks.last.code
    beside = f"{code}, {looks.beside:.0f} deg beside it," if looks.beside > _ASIDE else code
    if looks.last is None:
        return f"{beside} was not read"
    ago = contact.time - looks.last.time
    when = f"{ago:.1f} s before" if ago >= 0.0 else "after it"
    return f"{beside} read {shown_range(looks.last.value)}, {when}"


def looks_there(looks: FacingSensor | None) -> bool:
    """True if a sensor looked at the place at all."""
    return looks is not None and looks.beside <= BESIDE


def shown_range(value: float) -> str:
    """A distance that was read."""
    return f"{value:.1f} in" if math.isfinite(value) else "nothing in range"
