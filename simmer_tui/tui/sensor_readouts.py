"""The panel of all sensors, a line each: direction, reading, and recent readings.

Readings of the past come from `SensorRow` (`run/state.py`). One sensor in detail is in `sensor_facts.py`.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import chain

from msgspec import Struct, field

from simmer_tui.live.snapshot import Snapshot
from simmer_tui.run.events import TwinReading
from simmer_tui.run.reducer import HISTORY
from simmer_tui.run.state import SensorRow
from simmer_tui.sim.command import counted
from simmer_tui.sim.records import LidarScan
from simmer_tui.sim.scan_rays import extremes
from simmer_tui.sim.specs import CELL_SIZE, SensorKind, SensorSpec
from simmer_tui.tui.gauges import bearing_sign, gauge, heading_sign, scale_end, span_text, sparkline
from simmer_tui.tui.line_panel import StyledLine, between, heading, length
from simmer_tui.tui.maze.scene import has_left
from simmer_tui.tui.terminal import GlyphMode

SHORT, NEAR = CELL_SIZE / 4, CELL_SIZE / 2
"""Ranges below these, inches, are shown as danger and as warning."""
# Code, direction, value and unit take 13 columns; the rest is gauge, sparkline and span.
FULL_COLUMNS = 32
"""Columns from which a row has unit, gauge, sparkline and span."""
# Code, direction, value and unit, and a gap.
_BEFORE_BAR = 14
"""Columns before the gauge of a row with all its parts."""
# ` sim 35.8` and ` -10.0` beside each other.
_TWIN_ROOM = 14
# Ranges in the bundled mazes are seldom longer, and a scale that never changes is easy to read.
RANGE_SCALE = 4 * CELL_SIZE
"""Least end of the gauges of ranges, inches."""


_OLD = 2.0
"""Simulated seconds after which a reading is old if the robot has moved since."""
_LEAST_AGE = 1.0
"""Seconds from which an age is shown beside its reading."""


def age_of_reading(row: SensorRow, snapshot: Snapshot) -> float | None:
    """Age of a reading that is old, simulated seconds; None while it still holds.

    A reading is old once the robot has left the reading's pose, or 2 s later if anything has moved meanwhile.
    Time after the end of the run does not count.
    """
    state = snapshot.state
    age = seconds_since(row.time, snapshot)
    moved = state.moving or row.number < state.moved
    is_old = moved and (has_left(row.pose, state.pose) or age > _OLD)
    return age if is_old else None


def seconds_since(time: float, snapshot: Snapshot) -> float:
    """Simulated seconds since a moment of the run; those after its end do not count."""
    mission, verdict, now = snapshot.mission, snapshot.verdict, snapshot.state.time
    if mission is not None and mission.over:
        now = mission.time
    elif verdict is not None and verdict.program is not None:
        now = min(now, verdict.program.time)
    return max(now - time, 0.0)


def age_text(age: float | None, room: int) -> str:
    """Age of a reading in a few columns: `12s ago`, or `12s`; empty if it still holds or has no room."""
    if age is None or age < _LEAST_AGE:
        return ""
    short = f"{age:.0f}s" if age < 99.5 else f"{min(age / 60, 99):.0f}m"
    return next((text for text in (f"{short} ago", short) if len(text) <= room), "")


class SensorLine(Struct, frozen=True):
    """A line of the panel, and the code of its sensor, if it has one. A line that `heads` a kind is the
    heading of the sensors below it."""

    line: StyledLine
    code: str = ""
    heads: bool = False


class SensorsView(Struct, frozen=True):
    """Options of the panel: `truth` adds true values, `chosen` is the code of the sensor that a person has
    chosen. `past` has the earlier values by code, if they lag behind the readings."""

    glyphs: GlyphMode = GlyphMode.QUADRANT
    truth: bool = False
    chosen: str = ""
    past: Mapping[str, Sequence[float]] = field(default_factory=dict)

    @property
    def plain(self) -> bool:
        """True for terminals and fonts without fine bars."""
        return self.glyphs in (GlyphMode.ASCII, GlyphMode.HALF)

    @property
    def dash(self) -> str:
        """Sign of a span, and of a value that was never read."""
        return "-" if self.plain else "–"


def range_role(sensor: SensorSpec, value: float) -> str:
    """Role of a reading: short ranges stand out."""
    if not sensor.kind.is_range or value >= NEAR:
        return "value"
    return "danger" if value < SHORT else "warning"


def direction_sign(sensor: SensorSpec, *, plain: bool) -> str:
    """Direction of a sensor, with the robot's front up: an arrow, or letters such as `FL`."""
    if sensor.kind.is_scan:
        return "" if plain else "○"
    return bearing_sign(sensor.rotation, plain=plain) if sensor.kind.has("rotation") else ""


def kind_name(kind: type[SensorKind]) -> str:
    """Name of a kind for people: its own, or else the start of its IDs."""
    return kind.short_name or kind.name


def sensor_lines(
    sensors: Sequence[SensorSpec], snapshot: Snapshot, width: int, rows: int, view: SensorsView
) -> list[SensorLine]:
    """All sensors in use in at most `rows` lines, also those never read."""
    table = _SensorTable(snapshot, width, view)
    groups = _groups(sensors)
    lines = [line for group in groups for line in table.lines_of(group)]
    if table.full:
        lines = [SensorLine(table.heading(groups), heads=True), *lines]
    elif len(lines) > rows:  # headings of kinds may be left out
        lines = [line for line in lines if not line.heads]
    if len(lines) > rows:
        hidden = len(lines) - rows + 1
        lines = [*lines[: rows - 1], SensorLine(((f"{hidden} more{'' if table.full else ': F2'}", "dim"),))]
    return lines


def rows_wanted(sensors: Sequence[SensorSpec]) -> int:
    """Number of lines of all sensors beside a maze, with the heading."""
    return 1 + sum(1 if _is_one_line(group) else len(group) for group in _groups(sensors))


def _groups(sensors: Sequence[SensorSpec]) -> list[list[SensorSpec]]:
    """Sensors in use, grouped under one heading each.

    Ranges come first, then yes-or-no sensors, then other kinds with several sensors, then single ones. Each
    kind is at its first place in the file.
    """
    kinds: dict[object, list[SensorSpec]] = {}
    for sensor in sensors:
        if sensor.enabled:
            kinds.setdefault((sensor.kind, sensor.is_yes_or_no), []).append(sensor)

    def rank(group: list[SensorSpec]) -> int:
        kind = group[0].kind
        if kind.is_range:
            # Sensors that look all around come first.
            return -1 if kind.is_scan else 0
        return 3 if len(group) == 1 else 1 if group[0].is_yes_or_no else 2

    return sorted(kinds.values(), key=rank)


def _is_one_line(group: Sequence[SensorSpec]) -> bool:
    """True for sensors that are shown side by side."""
    return len(group) > 1 and group[0].is_yes_or_no


class _SensorTable:
    """Lines of the panel for one snapshot."""

    def __init__(self, snapshot: Snapshot, width: int, view: SensorsView) -> None:
        self.rows, self.twins = snapshot.state.sensors, snapshot.state.twins
        self.ages = {code: age_of_reading(row, snapshot) for code, row in self.rows.items()}
        self.true_values = snapshot.true_values
        self.newest = max((row.number for row in self.rows.values()), default=0)
        self.width, self.view = width, view
        self.full = width >= FULL_COLUMNS
        self._ends: dict[str, float] = {}
        self._named: set[str] = set()

    def heading(self, groups: Sequence[Sequence[SensorSpec]]) -> StyledLine:
        """Name of the panel, and its columns."""
        if self.view.truth:
            note = "reading, true value"
        else:
            ranges = [sensor for group in groups for sensor in group if sensor.kind.is_range]
            scale = f"range 0{self.view.dash}{self._end(ranges[0]):g}   " if ranges else ""
            note = f"{scale}last values"
        return heading("sensors", note, self.width, plain=self.view.plain)

    def lines_of(self, group: Sequence[SensorSpec]) -> list[SensorLine]:
        """Lines of a kind's sensors."""
        if _is_one_line(group):
            return [SensorLine(self._digits(group))]
        lines = [SensorLine(self._line(sensor), sensor.code) for sensor in group]
        title = "range" if group[0].kind.is_range else group[0].kind.name
        if self.full or title in self._named or (len(group) == 1 and not group[0].kind.is_range):
            return lines
        self._named.add(title)
        scale = f"0{self.view.dash}{self._end(group[0]):g}"
        head: StyledLine = ((title[: self.width - len(scale) - 1], "title"),)
        return [SensorLine(between(head, ((scale, "dim"),), self.width), heads=True), *lines]

    def _end(self, sensor: SensorSpec) -> float:
        """End of the gauges of a sensor's kind; all kinds of ranges have the same."""
        is_range = sensor.kind.is_range
        key = "range" if is_range else sensor.kind.name
        if key not in self._ends:
            kinds = ((row.reading.sensor.kind, row.history) for row in self.rows.values())
            alike = (
                past
                for kind, past in kinds
                if not kind.is_scan and (kind.is_range if is_range else kind is sensor.kind)
            )
            end = scale_end(chain.from_iterable(alike), sensor.unit)
            self._ends[key] = max(end, RANGE_SCALE) if is_range else end
        return self._ends[key]

    def _line(self, sensor: SensorSpec) -> StyledLine:
        """One sensor: its reading, and the parts after it."""
        row = self.rows.get(sensor.code)
        role, look = self._role(row), direction_sign(sensor, plain=self.view.plain)
        # The reading ages; its sensor stays, which is fewer bytes too.
        name = "dim" if row is None else "newest" if row.number == self.newest else "value"
        begin: StyledLine = (
            (sensor.code, "chosen" if sensor.code == self.view.chosen else name),
            (look.ljust(2) if self.view.plain else f" {look}".ljust(2), name),
        )
        if row is None:
            return self._unread(sensor, begin)
        if row.reading.scan is not None:
            return self._scan(row.reading.scan, sensor, begin, role)
        value = row.reading.value
        if sensor.kind.is_range and value == math.inf:
            return self._no_echo(sensor, begin, role)
        shown = _value_text(value, sensor).rjust(6 if self.full else 5)
        line: StyledLine = (*begin, (shown, self._near(sensor, value, role)))
        if self.full or not (self._is_gauged(sensor) or self.view.truth):
            unit = "" if sensor.is_yes_or_no else sensor.unit
            line = (*line, (f" {unit}".ljust(3), "dim"))
        return (*line, *self._rest(sensor, row, self.width - length(line)))

    def _role(self, row: SensorRow | None, usual: str = "value") -> str:
        """Role of a reading: the newest stands out, an old or a missing one is dim."""
        if row is None or self.ages[row.reading.sensor.code] is not None:
            return "dim"
        return "newest" if row.number == self.newest else usual

    def _near(self, sensor: SensorSpec, value: float, usual: str) -> str:
        """Role of a range: by its length if it is short and not old, otherwise the `usual` one."""
        return usual if self.ages[sensor.code] is not None else _near_role(sensor, value, usual)

    def _age(self, sensor: SensorSpec, room: int) -> str:
        """Age of a sensor's reading, if it is old, in so many columns."""
        return age_text(self.ages.get(sensor.code), room)

    def _unread(self, sensor: SensorSpec, begin: StyledLine) -> StyledLine:
        """A sensor that was never read: its direction and its kind, and no number."""
        true = self.true_values.get(sensor.code)
        if not self.full:
            line: StyledLine = (*begin, (self.view.dash.rjust(5), "dim"))
            room = self.width - length(line)
            return line if true is None else (*line, (_true_text(true, sensor, room), "good"))
        line = (*begin, (f"   {self.view.dash}   ", "dim"))
        if self.view.truth and true is not None:
            return (*line, (f"true {_value_text(true, sensor)}", "good"))
        return between((*line, (kind_name(sensor.kind), "dim")), (("not read", "dim"),), self.width)

    def _scan(self, scan: LidarScan, sensor: SensorSpec, begin: StyledLine, role: str) -> StyledLine:
        """A scan: its number of points, and the nearest and farthest echo as far as there is room."""
        if not self.full:
            return (*begin, (f" {len(scan.ranges)} pts", role))
        found, plain = extremes(scan), self.view.plain
        line: StyledLine = (*begin, (f" {counted(len(scan.ranges), 'point')}", role))
        if found.nearest is None or found.farthest is None:
            return (*line, (", no echo", role))
        (near, at), (far, _) = found.nearest, found.farthest
        nearest: StyledLine = (
            (", nearest ", role),
            (f"{near:.1f}", self._near(sensor, near, role)),
            (f" {sensor.unit} {bearing_sign(at, plain=plain)}", role),
        )
        for more in (nearest, ((f" farthest {far:.1f} {sensor.unit}", role),)):
            if length(line) + length(more) > self.width:
                break
            line = (*line, *more)
        return between(line, ((self._age(sensor, self.width - length(line) - 1), "dim"),), self.width)

    def _no_echo(self, sensor: SensorSpec, begin: StyledLine, role: str) -> StyledLine:
        """A range without an echo: words, and no bar."""
        true = self.true_values.get(sensor.code)
        if not self.full:
            return (*begin, ("  no echo", role))
        line: StyledLine = (*begin, ("   no echo", role))
        if self.view.truth and true is not None:
            return (*line, (f"  {_value_text(true, sensor)}", "good"))
        bars = self._bar_columns(self.width - _BEFORE_BAR)[0]
        dots = (". " if self.view.plain else "· ") * (bars // 2 - 1)
        far = f"beyond {sensor.max_range:.0f}" if math.isfinite(sensor.max_range) else ""
        far = self._age(sensor, self.width) or far
        return between((*line, (f" {dots}", "rule")), ((far, "dim"),), self.width)

    def _is_gauged(self, sensor: SensorSpec) -> bool:
        """True for kinds whose values have a bar: lengths, if the robot has several such sensors."""
        if sensor.kind.is_scan:
            return False
        return sensor.kind.is_range or (sensor.kind.counts and sensor.unit == "in")

    def _bar_columns(self, room: int) -> tuple[int, int, int]:
        """Columns of the gauge, the sparkline and the span of a row with all its parts: 9, 5 and 7 of 22."""
        more = max(room - 22, 0)
        bars = 9 + more // 3
        spark = min(5 + more - more // 3, HISTORY)
        return bars, spark, room - bars - spark - 1

    def _rest(self, sensor: SensorSpec, row: SensorRow, room: int) -> StyledLine:
        """The pieces after a reading: the true value or the twin's, otherwise gauge and sparkline."""
        twin, true = self.twins.get(sensor.code), self.true_values.get(sensor.code)
        plain, value = self.view.plain, row.reading.value
        if twin is not None:
            apart = "warning" if _apart(twin) else "dim"
            simulated = (f" sim {twin.simulated:.1f}", "belief")
            difference = (f" {twin.robot - twin.simulated:+.1f}", apart)
            return (simulated, difference) if room >= _TWIN_ROOM else (simulated,)
        if self.view.truth and true is not None:
            text = _true_text(true, sensor, room)
            return ((text.rjust(min(room, 8)), "good"),)
        if not self._is_gauged(sensor):
            name = kind_name(sensor.kind)
            turned = f" {heading_sign(value, plain=plain)}" if sensor.kind.is_heading else ""
            named: StyledLine = ((f" {name}", "dim"), (turned, self._role(row)))
            named = named if room > length(named) - 1 else ()
            return between(named, ((self._age(sensor, room - length(named) - 1), "dim"),), room)
        role = self._near(sensor, value, self._role(row, "mark"))
        end = self._end(sensor)
        if not self.full:
            age = self._age(sensor, room - 1)
            if age:
                return ((age.rjust(room), "dim"),)
            return (" ", "plain"), *gauge(value, end, max(room - 1, 0), plain=plain, role=role)
        past = self.view.past.get(sensor.code, row.history)
        bars, spark, tail = self._bar_columns(room - 1)
        span = self._age(sensor, tail) or span_text(past, plain=plain)
        # The sparkline never touches a span that fills its columns, such as 364–437.
        drawn = spark - (len(span) >= tail)
        return (
            (" ", "plain"),
            *gauge(value, end, bars, plain=plain, role=role),
            (f" {sparkline(past, drawn, plain=plain).ljust(spark)}", "dim"),
            (span.rjust(tail), "dim"),
        )

    def _digits(self, group: Sequence[SensorSpec]) -> StyledLine:
        """Yes-or-no sensors side by side, each on the colour that it sees."""
        kind, plain = group[0].kind, self.view.plain
        if not self.full:
            return (kind_name(kind)[:4].ljust(5), "title"), *self._yes_or_no(group, "")
        read = any(sensor.code in self.rows for sensor in group)
        codes = "".join(_ranges([sensor.code for sensor in group], plain=plain))
        begin = (codes.ljust(6), "value" if read else "dim")
        colours = {sensor.yes_words and sensor.yes_words[0] for sensor in group}
        colour = colours.pop() if len(colours) == 1 else None
        note = f"1 is {colour}" if colour else ""
        if not read and not self.view.truth:
            said = ", ".join(filter(None, (kind_name(kind).removesuffix(" sensor"), note)))
            line: StyledLine = (begin, (f" {self.view.dash:<4}{said}", "dim"))
            return between(line, (("not read", "dim"),), self.width)
        # The oldest of them: they are read together.
        ages = [age for sensor in group if (age := self.ages.get(sensor.code)) is not None]
        # Where the colours differ there is no note; the shortest age has three columns.
        note = age_text(max(ages, default=None), max(len(note), 3)) or note
        # Digits of three columns each; the codes before them have six, and the note a gap.
        pad = " " if len(group) * 3 + len(note) + 7 <= self.width else ""
        return between((begin, *self._yes_or_no(group, pad)), ((note, "dim"),), self.width)

    def _yes_or_no(self, group: Sequence[SensorSpec], after: str) -> StyledLine:
        pieces: list[tuple[str, str]] = []
        for sensor in group:
            row, true = self.rows.get(sensor.code), self.true_values.get(sensor.code)
            text = self.view.dash if row is None else f"{row.reading.value:.0f}"
            role = self._role(row)
            if (
                row is not None
                and role != "dim"
                and after
                and not self.view.plain
                and sensor.kind.detects_floor
            ):
                is_white = bool(row.reading.value) == sensor.is_inverted
                role = "white-tile" if is_white else "black-tile"
            pieces.append((f" {text}{after}", role))
            if self.view.truth and true is not None and self.full:
                pieces.append((f"/{true:.0f}", "good"))
        return tuple(pieces)


def _near_role(sensor: SensorSpec, value: float, usual: str) -> str:
    """Role of a range: by its length if it is short, otherwise the `usual` one."""
    role = range_role(sensor, value)
    return usual if role == "value" else role


def _value_text(value: float, sensor: SensorSpec) -> str:
    if sensor.is_yes_or_no:
        return "yes" if value else "no"
    if not math.isfinite(value):
        return f"{value:g}"
    text = f"{value:.1f}"
    return text if len(text) <= 5 else f"{value:.0f}"


def _true_text(true: float, sensor: SensorSpec, room: int) -> str:
    """A true value behind a reading, without its tenths where there is no room for them."""
    text = f" {_value_text(true, sensor)}"
    if len(text) > room and math.isfinite(true):
        text = f" {true:.0f}"
    return text if len(text) <= room else ""


def _ranges(codes: Sequence[str], *, plain: bool) -> list[str]:
    """Codes with those in a row as `u1–5`."""
    dash = "-" if plain else "–"
    runs: list[list[str]] = []
    for code in codes:
        last = runs[-1][-1] if runs else ""
        follows = last[:1] == code[:1] and last[1:].isdigit() and code[1:].isdigit()
        if follows and int(code[1:]) == int(last[1:]) + 1:
            runs[-1].append(code)
        else:
            runs.append([code])
    return [run[0] if len(run) == 1 else f"{run[0]}{dash}{run[-1][1:]}" for run in runs]


def _apart(twin: TwinReading) -> bool:
    """True if the readings of robot and simulator differ by more than a tenth, and by more than one inch or
    degree."""
    apart = abs(twin.robot - twin.simulated)
    # Written so that a NaN on one side counts as a difference.
    return not apart <= max(1.0, 0.1 * abs(twin.simulated))
