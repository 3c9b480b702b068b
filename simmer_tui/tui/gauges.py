"""Values in few columns: numbers with units, signs of directions, gauges on a scale, and sparklines."""

import math
from collections.abc import Iterable, Sequence

from simmer_tui.document.formats import BLOCKS, PLAIN_BLOCKS
from simmer_tui.sim.angles import ARROWS, eighth_of_turn, side_name
from simmer_tui.sim.specs import CELL_SIZE, SensorSpec
from simmer_tui.tui.line_panel import StyledLine

# Most distances in a maze are shorter.
_SCALE = 2 * CELL_SIZE
"""Least end of the gauges of lengths, inches."""
_POINTS = ("E", "NE", "N", "NW", "W", "SW", "S", "SE")


# -- words and signs -------------------------------------------------------------------------------


def reading_text(value: float) -> str:
    """Number for a table: two decimals, infinities by name."""
    if not math.isfinite(value):
        return f"{value:g}"
    return f"{value:.2f}"


def with_unit(value: float, sensor: SensorSpec) -> str:
    """A reading with its unit; a yes or no as a bare 1 or 0."""
    if not sensor.unit and value in (0.0, 1.0):
        return f"{value:.0f}"
    return f"{reading_text(value)} {sensor.unit}".rstrip()


def bearing_sign(bearing: float, *, plain: bool) -> str:
    """Direction from the robot's front, degrees, with the front up: an arrow, or letters such as `FL`."""
    if plain:
        return "".join(word[0].upper() for word in side_name(bearing, "front", "back").split())
    # A quarter on: the robot's front is up here, and to the right in the table.
    return ARROWS[eighth_of_turn(bearing + 90.0)]


def bearing_words(bearing: float, *, plain: bool) -> str:
    """The same in words, with the arrow if there is one: `behind left ↙`."""
    side = side_name(bearing)
    words = f"to the {side}" if side in ("left", "right") else side
    return words if plain else f"{words} {bearing_sign(bearing, plain=False)}"


def heading_sign(value: float, *, plain: bool) -> str:
    """Arrow, or point of the compass, for a heading in degrees counter-clockwise; empty for NaN."""
    if not math.isfinite(value):
        return ""
    return (_POINTS if plain else ARROWS)[eighth_of_turn(value)]


# -- lines -----------------------------------------------------------------------------------------


def sparkline(values: Sequence[float], width: int, *, plain: bool) -> str:
    """The last `width` values as bars between the least and the greatest; infinite ones full."""
    # Without the full block, which would run into the row above.
    bars = (PLAIN_BLOCKS if plain else BLOCKS)[:-1]
    shown = values[-width:] if width > 0 else ()
    finite = [value for value in shown if math.isfinite(value)]
    low, high = (min(finite), max(finite)) if finite else (0.0, 0.0)
    text = ""
    for value in shown:
        if not math.isfinite(value):
            text += "?" if math.isnan(value) else bars[-1]
        elif high == low:
            text += bars[len(bars) // 2]
        else:
            text += bars[1 + round((value - low) / (high - low) * (len(bars) - 2))]
    return text


def span_text(values: Sequence[float], *, plain: bool) -> str:
    """Least and greatest value, `30–35`."""
    finite = [round(value) for value in values if math.isfinite(value)]
    if not finite:
        return ""
    low, high = min(finite), max(finite)
    if low == high:
        return f"{low}"
    return f"{low}{'-' if plain else '–'}{high}" if low >= 0 else f"{low}..{high}"


def gauge(value: float, end: float, width: int, *, plain: bool, role: str = "mark") -> StyledLine:
    """A value as a line on a track from 0 to `end`."""
    full, half, track = ("=", "-", ".") if plain else ("━", "╸", "─")
    halves = 0 if math.isnan(value) else round(min(abs(value) / end, 1.0) * 2 * width)
    line = full * (halves // 2) + half * (halves % 2)
    return (line, role), (track * (width - len(line)), "rule")


def scale_end(values: Iterable[float], unit: str) -> float:
    """End of the gauges of a kind: the least round number that none of its values exceeds."""
    most = max(filter(math.isfinite, map(abs, values)), default=0.0)
    # Doubled, so that few longer readings change the scale of all gauges.
    if unit == "in":
        end = _SCALE
        while end < most:
            end *= 2
        return end
    power = 10.0 ** math.floor(math.log10(most)) if most > 0 else 1.0
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= most)
