"""Readings over time, each sensor in a strip of its own, contacts marked across all."""

from __future__ import annotations

import math

from msgspec import Struct

from simmer_tui.document import svg
from simmer_tui.document.model import Figure, LegendMark
from simmer_tui.document.svg import PICTURE_WIDTH
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.run.run_history import TracePoint

# Points: room for names and scales to the left, for units to the right.
_LEFT, _RIGHT = 74.0, 46.0
# Points: height of a strip, gap above it, room for the time axis below.
_STRIP, _GAP, _AXIS = 58.0, 16.0, 34.0
_TRUE, _READ = "#9a9a9a", "#3066e4"
# Points above the first strip, and about the number of times on the axis.
_TOP, _TICKS = 6.0, 6
_BELIEF = "belief"
"""Name of the strip of the belief; the others are named by the codes of their sensors."""


_Points = tuple[tuple[float, float], ...]
"""Pairs of (x, value)."""


class Strip(Struct, frozen=True):
    """One line over time: the code or name it is `of`, its values, and the values they are compared with, if
    any."""

    of: str
    title: str
    unit: str
    values: _Points
    against: _Points = ()
    color: str = _READ


def traces(run: RunStatistics) -> Figure | None:
    """The sensors over time; None if nothing was read or believed."""
    timed = run.history.elapsed > 0
    strips = _strips(run, timed)
    if not strips:
        return None
    longest = max((x for strip in strips for x, _ in strip.values), default=0.0)
    end = max(run.history.elapsed if timed else longest, 1e-9)
    drawn, height = "", _TOP - _GAP
    for strip in strips:
        drawn += svg.translated(0.0, height + _GAP, _draw(strip, end))
        height += _GAP + _STRIP
    if timed:
        drawn += _contact_lines(run, end, height)
    drawn += _axis(end, height, "s" if timed else "readings")
    legend = _legend(has_contacts=bool(run.totals.contacts) and timed)
    return Figure("Sensors", PICTURE_WIDTH, height + _AXIS, drawn, "strips", legend)


class Clock(Struct, frozen=True):
    """The time axis of a picture, from 0 at `left` to `end` (seconds) at `right`. The strips have their
    codes, the upper edge of the first, and the distance from one to the next. All in points."""

    left: float
    right: float
    end: float
    top: float
    step: float
    of: tuple[str, ...]


def page_clock(run: RunStatistics) -> Clock | None:
    """The clock of the picture; None if it has none."""
    strips = _strips(run, True)
    if not strips or run.history.elapsed <= 0.0:
        return None
    names = tuple(strip.of for strip in strips)
    return Clock(_LEFT, PICTURE_WIDTH - _RIGHT, run.history.elapsed, _TOP, _STRIP + _GAP, names)


def _strips(run: RunStatistics, timed: bool) -> list[Strip]:
    strips = []
    if run.totals.belief_trace.items:
        points = tuple([(point.elapsed, point.distance) for point in run.totals.belief_trace.items])
        strips.append(Strip(_BELIEF, "belief error", "in", points, color=svg.BELIEF))
    for sensor in run.configuration.simulation.sensors:
        record = run.totals.sensors.get(sensor.id)
        if record is None:
            continue
        items = record.trace.items
        values = tuple([(_x(point, timed), point.value) for point in items])
        # Of a yes or no the truth may be a fraction of black, of a counter the count itself.
        comparable = not (sensor.is_yes_or_no or sensor.kind.counts)
        against = tuple([(_x(point, timed), point.true) for point in items]) if comparable else ()
        strips.append(Strip(sensor.code, f"{sensor.code} {sensor.id}", sensor.unit, values, against))
    return strips


def _x(point: TracePoint, timed: bool) -> float:
    """Instant readings take no time: where nothing else happens, they are counted instead."""
    return point.elapsed if timed else float(point.order)


def _draw(strip: Strip, end: float) -> str:
    finite = [value for _, value in (*strip.values, *strip.against) if math.isfinite(value)]
    low, high = min(finite, default=0.0), max(finite, default=1.0)
    # Ranges and counts are drawn from 0; a heading has no zero line.
    if strip.unit != "deg":
        low = min(low, 0.0)
    # A constant line is drawn in the middle, and nothing divides by 0.
    if high - low < 1e-9:
        low, high = low - 1.0, high + 1.0
    box = {"x": _LEFT, "y": 0.0, "width": PICTURE_WIDTH - _LEFT - _RIGHT, "height": _STRIP}
    frame = svg.element("rect", **box, fill="#fafafa", stroke="#dddddd")
    scale = svg.text(_LEFT - 5, 9, _short(high), 11.0, text_anchor="end", fill=svg.FAINT)
    scale += svg.text(_LEFT - 5, _STRIP, _short(low), 11.0, text_anchor="end", fill=svg.FAINT)
    name = svg.text(4, _STRIP / 2, strip.title, 11.0, font_weight="bold")
    unit = svg.text(PICTURE_WIDTH - _RIGHT + 5, _STRIP / 2 + 4, strip.unit, 11.0, fill=svg.FAINT)
    lines = _line(strip.against, end, low, high, _TRUE, 2.4) if strip.against else ""
    lines += _line(strip.values, end, low, high, strip.color, 1.0, dots=True)
    return frame + scale + name + unit + lines


def _line(
    values: _Points, end: float, low: float, high: float, color: str, width: float, *, dots: bool = False
) -> str:
    """A line through the values, broken where one is not finite; such ones are ticks at the top."""
    stretches: list[list[tuple[float, float]]] = [[]]
    beyond = []
    for x, value in values:
        place = _across(x, end)
        if math.isfinite(value):
            stretches[-1].append((place, _STRIP - 3 - (value - low) / (high - low) * (_STRIP - 6)))
        else:
            beyond.append(f"M{svg.coordinate(place)} 0v5")
            stretches.append([])
    drawn = "".join(f"<polyline points='{svg.curve(each)}'/>" for each in stretches if len(each) > 1)
    made = svg.element("g", drawn, fill="none", stroke=color, stroke_width=width) if drawn else ""
    if beyond:
        made += svg.element("path", d="".join(beyond), stroke=color, stroke_width=1.0)
    if dots:
        # One path of lines without length, whose round ends are dots: a tenth of the size of as many circles.
        spots = "".join(f"M{x:.1f} {y:.1f}h0" for each in stretches for x, y in each)
        made += svg.element("path", d=spots, stroke=color, stroke_width=3.0, stroke_linecap="round")
    return made


def _contact_lines(run: RunStatistics, end: float, height: float) -> str:
    """A line for a contact; a band while the robot did not get away from the wall."""
    lines, bands = [], []
    for each in run.history.repeated.first.items:
        begin, until = _across(each.first.elapsed, end), _across(each.until, end)
        lines.append(f"M{svg.coordinate(begin)} {_TOP:g}V{svg.coordinate(height)}")
        if until > begin:
            bands.append(svg.element("rect", x=begin, y=_TOP, width=until - begin, height=height - _TOP))
    drawn = svg.element("g", "".join(bands), fill=svg.CONTACT, fill_opacity=0.08) if bands else ""
    look = {"stroke": svg.CONTACT, "stroke_width": 1.0, "stroke_opacity": 0.6}
    return drawn + (svg.element("path", d="".join(lines), **look) if lines else "")


def _axis(end: float, height: float, unit: str) -> str:
    rough = end / _TICKS
    power = 10.0 ** math.floor(math.log10(rough))
    # The usual steps of an axis: 1, 2, 5 and 10 times a power of ten.
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= rough)
    parts = []
    for tick in range(int(end / step + 1e-9) + 1):
        x = _across(tick * step, end)
        parts.append(svg.element("line", x1=x, y1=height, x2=x, y2=height + 4, stroke=svg.FAINT))
        parts.append(svg.text(x, height + 16, f"{tick * step:g}", 11.0, text_anchor="middle"))
    parts.append(svg.text(PICTURE_WIDTH - _RIGHT + 5, height + 16, unit, 11.0))
    return svg.element("g", "".join(parts), fill=svg.FAINT)


def _across(x: float, end: float) -> float:
    return _LEFT + x / end * (PICTURE_WIDTH - _LEFT - _RIGHT)


def _legend(*, has_contacts: bool) -> tuple[LegendMark, ...]:
    marks = [LegendMark("read", svg.dash(_READ, 1.0)), LegendMark("true", svg.dash(_TRUE, 2.4))]
    if has_contacts:
        marks.append(LegendMark("contact", svg.dash(svg.CONTACT, 1.0)))
    return tuple(marks)


def _short(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"
