"""Sensors as lines of text: direction, reading, and how that went lately."""

import math
import re
from collections.abc import Iterable, Sequence

from msgspec import Struct

from simmer_tui.events import TwinReading
from simmer_tui.run.reducer import HISTORY
from simmer_tui.run.state import SensorRow
from simmer_tui.sim.specs import SensorKind, SensorSpec
from simmer_tui.snapshot import Snapshot
from simmer_tui.tui.line_panel import StyledLine, heading, length
from simmer_tui.tui.maze.glyphs import ARROWS
from simmer_tui.tui.terminal import GlyphMode

# A quarter and half of a maze cell, which is 12 in.
SHORT, NEAR = 3.0, 6.0
"""Ranges below these, inches, are shown as danger and as warning."""
# Code, direction, value and unit take 13; the rest is gauge, sparkline and span.
FULL_COLUMNS = 32
"""Width from which a row has unit, gauge, sparkline and its range."""
# ` sim 35.8` and ` -10.0` beside each other.
_TWIN_ROOM = 14
# A gauge of 8, a sparkline of 5, a span of 5, and the gaps between them.
_SPARK_ROOM = 20
# Without the full block, which would run into the row above.
_BARS = " ▁▂▃▄▅▆▇"
_PLAIN_BARS = " .:-=+*#"
_WAYS = ("F", "FL", "L", "BL", "B", "BR", "R", "FR")
# Two maze cells: most readings in a maze are shorter.
_SCALE = 24.0
"""Least end of the gauges of ranges, inches."""


class SensorLine(Struct, frozen=True):
    """A line of the panel, and the code of its sensor, if it has one. A line that `heads` a kind names
    the sensors below it."""

    line: StyledLine
    code: str = ""
    heads: bool = False


class SensorsView(Struct, frozen=True):
    """Options of the panel: `truth` adds true values, `chosen` is the code of the sensor that a person has
    picked."""

    glyphs: GlyphMode = GlyphMode.QUADRANT
    truth: bool = False
    chosen: str = ""

    @property
    def plain(self) -> bool:
        """True for terminals and fonts without fine bars."""
        return self.glyphs in (GlyphMode.ASCII, GlyphMode.HALF)


def number_text(value: float) -> str:
    """Number for a table: two decimals, infinities by name."""
    if not math.isfinite(value):
        return f"{value:g}"
    return f"{value:.2f}"


def with_unit(value: float, sensor: SensorSpec) -> str:
    """A reading with its unit; a yes or no as a bare 1 or 0."""
    if not sensor.unit and value in (0.0, 1.0):
        return f"{value:.0f}"
    return f"{number_text(value)} {sensor.unit}".rstrip()


def range_role(sensor: SensorSpec, value: float) -> str:
    """Role of a reading: short ranges stand out."""
    if not sensor.kind.is_range or value >= NEAR:
        return "value"
    return "danger" if value < SHORT else "warning"


def way(sensor: SensorSpec, *, plain: bool) -> str:
    """Direction in which a sensor looks, the robot's front being up: an arrow, or letters such as `FL`."""
    if not sensor.kind.has("rotation"):
        return ""
    eighths = round(sensor.rotation / 45)
    # Two eighths on: the robot's front is up here, and to the right in the table.
    return _WAYS[eighths % 8] if plain else ARROWS[(eighths + 2) % 8]


def kind_name(kind: type[SensorKind]) -> str:
    """Name of a kind for people: that of its class, in words."""
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
    """Least and greatest value, `30-35`."""
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
    """End of the gauges of a kind: the least round number that none of its values exceeds."""
    most = max((abs(value) for value in values if math.isfinite(value)), default=0.0)
    # Doubled, so that not every longer reading changes the scale of all gauges.
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
    """Sensors in use in at most `rows` lines: those read by kind, those never read in a line."""
    table = _SensorTable(snapshot, width, view)
    groups = _groups(sensors)
    lines = [line for group in groups for line in table.lines_of(group)]
    never = [sensor.code for sensor in sensors if sensor.enabled and not table.is_shown(sensor)]
    unread = _unread(never, width)
    if len(lines) + len(unread) > rows:  # headings of kinds can be done without
        lines = [line for line in lines if not line.heads]
    lines += [SensorLine(line) for line in unread]
    if len(lines) > rows:
        hidden = len(lines) - rows + 1
        lines = [*lines[: rows - 1], SensorLine(((f"{hidden} more: F2", "dim"),))]
    return lines


def rows_wanted(sensors: Sequence[SensorSpec]) -> int:
    """Number of lines of the sensors once all are read."""
    return max(
        1, sum(1 if _is_one_line(group) else len(group) + _has_heading(group) for group in _groups(sensors))
    )


def _groups(sensors: Sequence[SensorSpec]) -> list[list[SensorSpec]]:
    """Sensors in use by kind: ranges first, then yes or no, then other kinds of many sensors, at last single
    ones; each kind where it first stands in the file."""
    kinds: dict[type[SensorKind], list[SensorSpec]] = {}
    for sensor in sensors:
        if sensor.enabled:
            kinds.setdefault(sensor.kind, []).append(sensor)

    def rank(group: list[SensorSpec]) -> int:
        kind = group[0].kind
        if kind.is_range:
            return 0
        return 3 if len(group) == 1 else 1 if kind.is_yes_or_no else 2

    return sorted(kinds.values(), key=rank)


def _is_one_line(group: Sequence[SensorSpec]) -> bool:
    """True for sensors that are shown side by side."""
    return len(group) > 1 and all(sensor.is_yes_or_no for sensor in group)


def _has_heading(group: Sequence[SensorSpec]) -> bool:
    """True if a line above the sensors of a kind names it."""
    return len(group) > 1 or group[0].kind.is_range


class _SensorTable:
    """Lines of the panel for one snapshot."""

    def __init__(self, snapshot: Snapshot, width: int, view: SensorsView) -> None:
        self.rows, self.twins, self.true_values = (
            snapshot.state.sensors,
            snapshot.state.twins,
            snapshot.true_values,
        )
        self.newest = max((row.number for row in self.rows.values()), default=0)
        self.width, self.view = width, view
        self.full = width >= FULL_COLUMNS

    def is_shown(self, sensor: SensorSpec) -> bool:
        """True for a sensor with a line of its own."""
        return self.view.truth or sensor.code in self.rows

    def lines_of(self, group: Sequence[SensorSpec]) -> list[SensorLine]:
        """Lines of a kind's sensors, as far as they were read."""
        shown = [sensor for sensor in group if self.is_shown(sensor)]
        if not shown:
            return []
        if _is_one_line(group):
            return [SensorLine(self._digits(group))]
        if not _has_heading(group):
            return [SensorLine(self._line(sensor, 0.0), sensor.code) for sensor in shown]
        read = [self.rows[sensor.code] for sensor in shown if sensor.code in self.rows]
        end = scale_end((value for row in read for value in row.history), group[0].unit)
        lines = [SensorLine(self._line(sensor, end), sensor.code) for sensor in shown]
        return [SensorLine(self._heading(group[0], end), heads=True), *lines]

    def _heading(self, sensor: SensorSpec, end: float) -> StyledLine:
        """Name of a kind, and what its gauges end at."""
        if not self.full:
            scale = f"{sensor.unit} 0-{end:g}".strip()
            room = max(self.width - len(scale) - 1, 1)
            return (sensor.kind.name[:room].ljust(room), "title"), (f" {scale}", "dim")
        note = "reading, true value" if self.view.truth else f"gauge 0-{end:g} {sensor.unit}".rstrip()
        return heading(kind_name(sensor.kind), note, self.width, plain=self.view.plain)

    def _line(self, sensor: SensorSpec, end: float) -> StyledLine:
        """One sensor: its reading, and what there is to say of it. Without an `end` it has no gauge."""
        row, plain = self.rows.get(sensor.code), self.view.plain
        fresh = row is not None and row.number == self.newest
        role = "newest" if fresh else "label"
        if row is None:
            value: tuple[str, str] = "-" if plain else "–", "dim"
        else:
            stands_out = range_role(sensor, row.reading.value)
            value = (
                _value_text(row.reading.value, sensor),
                "newest" if fresh and stands_out == "value" else stands_out,
            )
        look = way(sensor, plain=plain)
        line: StyledLine = (
            (sensor.code, "chosen" if sensor.code == self.view.chosen else role),
            (look.ljust(2) if plain else f" {look}".ljust(2), role),
            (value[0].rjust(6 if self.full else 5), value[1]),
        )
        if self.full or not end:
            line = (*line, (f" {'' if sensor.is_yes_or_no else sensor.unit}".ljust(3), "dim"))
        return (*line, *self._rest(sensor, row, self.width - length(line), end, fresh))

    def _rest(
        self, sensor: SensorSpec, row: SensorRow | None, room: int, end: float, fresh: bool
    ) -> StyledLine:
        """Pieces behind a reading: the true value or the twin's, else gauge and sparkline."""
        twin, true = self.twins.get(sensor.code), self.true_values.get(sensor.code)
        if twin is not None:
            apart = "warning" if _apart(twin) else "dim"
            simulated = (f" sim {twin.simulated:.1f}", "belief")
            return (
                (simulated, (f" {twin.robot - twin.simulated:+.1f}", apart))
                if room >= _TWIN_ROOM
                else (simulated,)
            )
        if self.view.truth and true is not None:
            return ((f" {_value_text(true, sensor)}".rjust(min(room, 8)), "good"),)
        if row is None:
            return ()
        if not end:
            name = kind_name(sensor.kind)
            return ((name.rjust(room), "dim"),) if room > len(name) else ()
        value, role, plain = row.reading.value, "newest" if fresh else "mark", self.view.plain
        if room < _SPARK_ROOM:
            return (" ", "plain"), *gauge(value, end, max(room - 1, 0), plain=plain, role=role)
        span = span_text(row.history)
        # Spans such as `9-35` leave the sparklines of all rows below one another.
        tail = max(len(span) + 1, 5)
        bars = 8 + max(0, (room - 23) // 4)
        spark = min(room - bars - 2 - tail, HISTORY)
        bars = room - spark - 2 - tail
        history = sparkline(row.history, spark, plain=plain).rjust(spark)
        line = gauge(value, end, bars, plain=plain, role=role)
        return (" ", "plain"), *line, (f" {history}", "dim"), (span.rjust(tail), "dim")

    def _digits(self, group: Sequence[SensorSpec]) -> StyledLine:
        """Sensors that say yes or no, side by side."""
        name = group[0].kind.__name__.removesuffix("Sensor").lower()
        pieces: list[tuple[str, str]] = [(name[:4].ljust(5), "title")]
        for sensor in group:
            row, true = self.rows.get(sensor.code), self.true_values.get(sensor.code)
            text = ("." if self.view.plain else "·") if row is None else f"{row.reading.value:.0f}"
            role = "dim" if row is None else "newest" if row.number == self.newest else "value"
            pieces.append((f" {text}", role))
            if self.view.truth and true is not None and self.full:
                pieces.append((f"/{true:.0f}", "good"))
        white = {sensor.detects_white for sensor in group}
        note = f"   1 over {'white' if white.pop() else 'black'}" if len(white) == 1 else ""
        line = tuple(pieces)
        codes = "  " + "".join(_ranges([sensor.code for sensor in group]))
        if self.width < length(line) + len(note) + len(codes):
            return line
        return (*line, (note, "dim"), (codes.rjust(self.width - length(line) - len(note)), "dim"))


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
    """True if robot and simulator read so differently that someone should look: by more than a
    tenth and more than one inch or degree."""
    apart = abs(twin.robot - twin.simulated)
    # So written that a NaN on one side counts as apart.
    return not apart <= max(1.0, 0.1 * abs(twin.simulated))
