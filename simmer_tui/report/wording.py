"""Facts about a run in words: the same in the report, on the screen and in trials."""

from __future__ import annotations

import math

from simmer_tui.run.facts import BESIDE, FacingSensor


def shown_lookout(looks: FacingSensor | None, time: float) -> str:
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
