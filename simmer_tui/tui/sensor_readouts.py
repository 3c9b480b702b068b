"""The sensors as lines of text: which way each looks, what it reads, and how that went lately."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby

from simmer_tui.events import TwinReading
from simmer_tui.run.reducer import HISTORY
from simmer_tui.run.state import SensorRow
from simmer_tui.sim.specs import SensorKind, SensorSpec
from simmer_tui.snapshot import Snapshot
from simmer_tui.tui.line_panel import StyledLine, heading, length
from simmer_tui.tui.terminal import GlyphMode

SHORT, NEAR = 3.0, 6.0
"""Ranges below these, inches, are shown as danger and as warning."""
FULL_COLUMNS = 32
"""From this width on a row has unit, gauge, sparkline and its range."""
_BARS = " ▁▂▃▄▅▆▇"  # a full block would run into the row above
_PLAIN_BARS = " .:-=+*#"
_ARROWS = ("↑", "↖", "←", "↙", "↓", "↘", "→", "↗")
_WAYS = ("F", "FL", "L", "BL", "B", "BR", "R", "FR")
_SCALE = 24.0
"""Least end of the gauges of ranges, inches."""


@dataclass(frozen=True, slots=True)
class SensorLine:
    """A line of the panel, and the code of the sensor it is about, if it is about one. A line that
    `heads` a kind only says what the lines below it are."""

    line: StyledLine
    code: str = ""
    heads: bool = False


@dataclass(frozen=True, slots=True)
class SensorsView:
    """How the panel shows sensors: `plain` is for terminals and fonts without fine bars, `chosen` the
    code of the one that a person has picked."""

    glyphs: GlyphMode = GlyphMode.QUADRANT
    truth: bool = False
    chosen: str = ""

    @property
    def plain(self) -> bool:
        return self.glyphs in (GlyphMode.ASCII, GlyphMode.HALF)


def number_text(value: float) -> str:
    """A number for a table: two decimals, infinities by name."""
    if not math.isfinite(value):
        return f"{value:g}"
    return f"{value:.2f}"


def with_unit(value: float, sensor: SensorSpec) -> str:
    """A reading with its unit; a yes or no as a bare 1 or 0."""
    if not sensor.unit and value in (0.0, 1.0):
        return f"{value:.0f}"
    return f"{number_text(value)} {sensor.unit}".rstrip()


def range_role(sensor: SensorSpec, value: float) -> str:
    """How a reading is shown: short ranges stand out."""
    if not sensor.kind.is_range or value >= NEAR:
        return "value"
    return "danger" if value < SHORT else "warning"


def way(sensor: SensorSpec, *, plain: bool) -> str:
    """Which way a sensor looks, the robot's front being up: an arrow, or letters such as `FL`."""
    if not sensor.kind.has("rotation"):
        return ""
    return (_WAYS if plain else _ARROWS)[round(sensor.rotation / 45) % 8]


def kind_name(kind: type[SensorKind]) -> str:
    """What people call a kind: the name of its class, in words."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", kind.__name__).lower()


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


def span_text(values: Sequence[float]) -> str:
    """From where to where values go, `30-35`."""
    finite = [round(value) for value in values if math.isfinite(value)]
    if not finite:
        return ""
    low, high = min(finite), max(finite)
    if low == high:
        return f"{low}"
    return f"{low}-{high}" if low >= 0 else f"{low}..{high}"


def gauge(value: float, end: float, width: int, *, plain: bool, role: str = "mark") -> StyledLine:
    """A value as a line on a track from 0 to `end`."""
    full, half, track = ("=", "-", ".") if plain else ("━", "╸", "─")
    halves = 0 if math.isnan(value) else round(min(abs(value) / end, 1.0) * 2 * width)
    line = full * (halves // 2) + half * (halves % 2)
    return (line, role), (track * (width - len(line)), "rule")


def scale_end(values: Iterable[float], unit: str) -> float:
    """Where the gauges of a kind end: the least round number that none of its values exceeds."""
    most = max((abs(value) for value in values if math.isfinite(value)), default=0.0)
    if unit == "in":
        end = _SCALE
        while end < most:
            end *= 2
        return end
    power = 10.0 ** math.floor(math.log10(most)) if most > 0 else 1.0
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= most)


def sensor_lines(
    sensors: Sequence[SensorSpec], snapshot: Snapshot, width: int, rows: int, view: SensorsView
) -> list[SensorLine]:
    """The sensors in use in at most `rows` lines: those read by kind, those never read in a line."""
    known = snapshot.state.sensors
    used = [sensor for sensor in sensors if sensor.enabled]
    newest = max((row.number for row in known.values()), default=0)
    kinds = [list(group) for _, group in groupby(sorted(used, key=_Order(used)), key=lambda s: s.kind)]
    lines: list[SensorLine] = []
    for group in kinds:
        read = [sensor for sensor in group if view.truth or sensor.code in known]
        if not read:
            continue
        if all(sensor.is_yes_or_no for sensor in group) and len(group) > 1:
            lines.append(SensorLine(_digits(group, snapshot, width, newest, view)))
            continue
        end = scale_end((v for s in read if s.code in known for v in known[s.code].history), group[0].unit)
        if len(group) > 1 or group[0].kind.is_range:
            lines.append(SensorLine(_kind_line(group[0], end, width, view), heads=True))
        else:
            end = 0.0
        lines += [
            SensorLine(_row(sensor, snapshot, width, end, newest, view), sensor.code) for sensor in read
        ]
    never = [sensor.code for sensor in used if sensor.code not in known and not view.truth]
    unread = _unread(never, width)
    if len(lines) + len(unread) > rows:  # what a kind is called can be done without
        lines = [line for line in lines if not line.heads]
    lines += [SensorLine(line) for line in unread]
    if len(lines) > rows:
        hidden = len(lines) - rows + 1
        lines = [*lines[: rows - 1], SensorLine(((f"{hidden} more: F2", "dim"),))]
    return lines


def rows_wanted(sensors: Sequence[SensorSpec]) -> int:
    """How many lines the sensors take once all are read."""
    used = [sensor for sensor in sensors if sensor.enabled]
    rows = 0
    for _, members in groupby(sorted(used, key=_Order(used)), key=lambda s: s.kind):
        group = list(members)
        if all(sensor.is_yes_or_no for sensor in group) and len(group) > 1:
            rows += 1
        else:
            rows += len(group) + (1 if len(group) > 1 or group[0].kind.is_range else 0)
    return max(rows, 1)


class _Order:
    """Ranges first, then yes or no, then other kinds of many sensors, at last single ones; each kind
    where it first stands in the file."""

    def __init__(self, sensors: Sequence[SensorSpec]) -> None:
        kinds = [sensor.kind for sensor in sensors]
        self._places = {kind: (self._class(kind, kinds.count(kind)), kinds.index(kind)) for kind in kinds}

    @staticmethod
    def _class(kind: type[SensorKind], count: int) -> int:
        if kind.is_range:
            return 0
        if count > 1:
            return 1 if kind.is_yes_or_no else 2
        return 3

    def __call__(self, sensor: SensorSpec) -> tuple[int, int]:
        return self._places[sensor.kind]


def _kind_line(sensor: SensorSpec, end: float, width: int, view: SensorsView) -> StyledLine:
    scale = f"{sensor.unit} 0-{end:g}".strip()
    if width < FULL_COLUMNS:
        room = max(width - len(scale) - 1, 1)
        return (sensor.kind.name[:room].ljust(room), "title"), (f" {scale}", "dim")
    note = "reading, true value" if view.truth else f"gauge 0-{end:g} {sensor.unit}".rstrip()
    return heading(kind_name(sensor.kind), note, width, plain=view.plain)


def _row(
    sensor: SensorSpec, snapshot: Snapshot, width: int, end: float, newest: int, view: SensorsView
) -> StyledLine:
    """One sensor: its reading, and what there is to say of it."""
    row = snapshot.state.sensors.get(sensor.code)
    value = row.reading.value if row is not None else None
    fresh = row is not None and row.number == newest
    role = "newest" if fresh else "label"
    code_role = "chosen" if sensor.code == view.chosen else role
    value_role = "dim" if value is None else range_role(sensor, value)
    value_role = "newest" if fresh and value_role == "value" else value_role
    full = width >= FULL_COLUMNS
    text = ("-" if view.plain else "–") if value is None else _value_text(value, sensor)
    look = way(sensor, plain=view.plain)
    look = look.ljust(2) if view.plain else f" {look}".ljust(2)
    line: StyledLine = (sensor.code, code_role), (look, role)
    line = (*line, (text.rjust(6 if full else 5), value_role))
    unit = sensor.unit if not sensor.is_yes_or_no else ""
    if full or not end:
        line = (*line, (f" {unit}".ljust(3), "dim"))
    return (*line, *_rest(sensor, row, snapshot, width - length(line), end, fresh, view))


def _rest(
    sensor: SensorSpec,
    row: SensorRow | None,
    snapshot: Snapshot,
    room: int,
    end: float,
    fresh: bool,
    view: SensorsView,
) -> StyledLine:
    """What stands behind a reading: what is true or what the twin says, else gauge and sparkline."""
    twin, true = snapshot.state.twins.get(sensor.code), snapshot.true_values.get(sensor.code)
    if twin is not None:
        apart = "warning" if _apart(twin) else "dim"
        pieces = (
            (f" sim {twin.simulated:.1f}", "belief"),
            (f" {twin.robot - twin.simulated:+.1f}", apart),
        )
        return pieces if room >= 14 else pieces[:1]
    if view.truth and true is not None:
        return ((f" {_value_text(true, sensor)}".rjust(min(room, 8)), "good"),)
    if row is None:
        return ()
    if not end:
        name = kind_name(sensor.kind)
        return ((name.rjust(room), "dim"),) if room > len(name) else ()
    role = "newest" if fresh else "mark"
    if room < 20:
        return (" ", "plain"), *gauge(row.reading.value, end, max(room - 1, 0), plain=view.plain, role=role)
    span = span_text(row.history)
    bars = 8 + max(0, (room - 23) // 4)
    tail = max(len(span) + 1, 5)
    spark = min(room - bars - 2 - tail, HISTORY)
    bars = room - spark - 2 - tail
    history = sparkline(row.history, spark, plain=view.plain).rjust(spark)
    line = gauge(row.reading.value, end, bars, plain=view.plain, role=role)
    return (" ", "plain"), *line, (f" {history}", "dim"), (span.rjust(tail), "dim")


def _digits(
    group: Sequence[SensorSpec], snapshot: Snapshot, width: int, newest: int, view: SensorsView
) -> StyledLine:
    """Sensors that say yes or no, side by side."""
    known = snapshot.state.sensors
    name = group[0].kind.__name__.removesuffix("Sensor").lower()
    pieces: list[tuple[str, str]] = [(name[:4].ljust(5), "title")]
    for sensor in group:
        row = known.get(sensor.code)
        text = ("." if view.plain else "·") if row is None else f"{row.reading.value:.0f}"
        role = "dim" if row is None else "newest" if row.number == newest else "value"
        pieces.append((f" {text}", role))
        true = snapshot.true_values.get(sensor.code)
        if view.truth and true is not None and width >= FULL_COLUMNS:
            pieces.append((f"/{true:.0f}", "good"))
    white = {sensor.detects_white for sensor in group}
    note = f"   1 over {'white' if white.pop() else 'black'}" if len(white) == 1 else ""
    line = tuple(pieces)
    codes = "  " + "".join(_ranges([sensor.code for sensor in group]))
    if width >= length(line) + len(note) + len(codes):
        line = (*line, (note, "dim"), (codes.rjust(width - length(line) - len(note)), "dim"))
    return line


def _value_text(value: float, sensor: SensorSpec) -> str:
    if sensor.is_yes_or_no:
        return "yes" if value else "no"
    if not math.isfinite(value):
        return f"{value:g}"
    text = f"{value:.1f}"
    return text if len(text) <= 5 else f"{value:.0f}"


def _unread(codes: Sequence[str], width: int) -> list[StyledLine]:
    """Those never read in as few lines as there is room for."""
    if not codes:
        return []
    words = ["never read", *_ranges(codes)] if width >= FULL_COLUMNS else ["unread", *_ranges(codes)]
    lines: list[str] = []
    for word in words:
        if lines and len(lines[-1]) + 1 + len(word) <= width:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return [((line, "dim"),) for line in lines]


def _ranges(codes: Sequence[str]) -> list[str]:
    """Codes with those in a row as `u1-5`."""
    runs: list[list[str]] = []
    for code in codes:
        last = runs[-1][-1] if runs else ""
        follows = last[:1] == code[:1] and last[1:].isdigit() and code[1:].isdigit()
        if follows and int(code[1:]) == int(last[1:]) + 1:
            runs[-1].append(code)
        else:
            runs.append([code])
    return [run[0] if len(run) == 1 else f"{run[0]}-{run[-1][1:]}" for run in runs]


def _apart(twin: TwinReading) -> bool:
    """Whether robot and simulator read so differently that someone should look: by more than a
    tenth and more than one inch or degree."""
    apart = abs(twin.robot - twin.simulated)
    return not apart <= max(1.0, 0.1 * abs(twin.simulated))
