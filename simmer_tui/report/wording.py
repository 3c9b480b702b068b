"""Facts about a run in words: the same in the report, on the screen and in trials."""

from __future__ import annotations

import math

from simmer_tui.report.facts import BESIDE, Lookout
from simmer_tui.sim.path import Contact
from simmer_tui.sim.specs import SensorSpec, SimulationSpec

_SLIGHT = 0.005
"""What two decimals show as 0."""


def shown_place(x: float, y: float) -> str:
    """(12.3, 4.5)."""
    return f"({x:.1f}, {y:.1f})"


def shown_body(contact: Contact) -> str:
    """Who touched."""
    return "the block it holds" if contact.held_block else "the robot"


def shown_obstacle(contact: Contact, spec: SimulationSpec) -> str:
    """What was touched, and where."""
    point = shown_place(*contact.point)
    if contact.cell is None:
        return f"the block at {point}"
    row, column = contact.cell
    if 1 <= row <= spec.maze.rows and 1 <= column <= spec.maze.columns:
        return f"the wall in row {row}, column {column} at {point}"
    return f"the maze's outer wall at {point}"


def shown_drift(contact: Contact) -> str:
    """Whether a command or an error led there."""
    if contact.drift:
        return "by drift: the command alone would not have led there"
    return "where the command led it"


def shown_lookout(looks: Lookout | None, time: float) -> str:
    """What the sensor that looked at a place touched at a time, or nearest to it, said last."""
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


def looks_there(looks: Lookout | None) -> bool:
    """Whether a sensor looked at the place at all."""
    return looks is not None and looks.beside <= BESIDE


def shown_range(value: float) -> str:
    """A distance that was read."""
    return f"{value:.1f} in" if math.isfinite(value) else "nothing in range"


def shown_value(value: float, sensor: SensorSpec) -> str:
    """Any reading, with its unit."""
    return f"{value:.1f} {sensor.unit}".rstrip() if math.isfinite(value) else str(value)


def shown_miss(missed: tuple[float, float]) -> str:
    """By how much the gripper missed the block, and on which side."""
    beyond, left = missed
    parts = []
    if abs(beyond) > _SLIGHT:
        parts.append(f"{abs(beyond):.2f} in too {'far ahead' if beyond > 0 else 'near'}")
    if abs(left) > _SLIGHT:
        parts.append(f"{abs(left):.2f} in too far to the {'left' if left > 0 else 'right'}")
    if parts:
        return f"the block's middle was {' and '.join(parts)}"
    return (
        "its jaws were closed already, or the block just at the edge"
        if beyond == left == 0.0
        else ("the block's middle was just outside its window")
    )


def shown_outside(off: tuple[float, float]) -> str:
    """How far outside a zone something lies, and on which side in the maze's frame."""
    x, y = off
    parts = []
    if x:
        parts.append(f"{abs(x):.1f} in to the {'right' if x > 0 else 'left'} of")
    if y:
        parts.append(f"{abs(y):.1f} in {'above' if y > 0 else 'below'}")
    return " and ".join(parts)


def times(count: int) -> str:
    """once, twice, 3 times."""
    return {1: "once", 2: "twice"}.get(count, f"{count} times")
