"""Values as lines: gauges on a scale, and sparklines of earlier values."""

import math
from collections.abc import Iterable, Sequence

from simmer_tui.tui.line_panel import StyledLine

# Without the full block, which would run into the row above.
_BARS = " ▁▂▃▄▅▆▇"
_PLAIN_BARS = " .:-=+*#"
# Two maze cells: most distances in a maze are shorter.
_SCALE = 24.0
"""Least end of the gauges of lengths, inches."""


def sparkline(values: Sequence[float], width: int, *, plain: bool) -> str:
    """The last `width` values as bars between the least and the greatest; infinite ones full."""
    bars = _PLAIN_BARS if plain else _BARS
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
    # Computed for every picture; hardly any value is not finite.
    given = list(map(abs, values))
    most = max(given, default=0.0)
    if not math.isfinite(sum(given)):
        most = max(filter(math.isfinite, given), default=0.0)
    # Doubled, so that few longer readings change the scale of all gauges.
    if unit == "in":
        end = _SCALE
        while end < most:
            end *= 2
        return end
    power = 10.0 ** math.floor(math.log10(most)) if most > 0 else 1.0
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= most)
