"""The facts about a contact: its readings, its belief, and its movement planned again with one change."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np
from msgspec import Struct

from simmer_tui.report.counterfactuals import Change, Counterfactual, CounterfactualWorld
from simmer_tui.report.why import looks_there
from simmer_tui.run.attempt import Attempt, Collision
from simmer_tui.run.facts import (
    ALIKE,
    BESIDE,
    COVERED,
    SLIGHT,
    LastReading,
    carried_over,
    degrees_beside,
    facing_sensor,
)
from simmer_tui.run.history_rows import BeliefRow
from simmer_tui.run.phrases import contact_text, is_of_boards, side_text
from simmer_tui.run.table import Columns
from simmer_tui.sim.angles import half_turn
from simmer_tui.sim.arrays import BoolArray
from simmer_tui.sim.command import parse_value
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.obstacles import Obstacles
from simmer_tui.sim.specs import CELL_SIZE, WALL, SensorSpec
from simmer_tui.sim.velocity_commands import WAIT

# Judged: after a third of a cell, or half a quarter turn, a sensor sees other obstacles.
BLIND, BLIND_TURN = 4.0, 45.0
"""Inches or degrees of path after which the last reading of a sensor counts as unread."""
# Judged: an inch alone is a usual error of a long range; four standard deviations happen once in 16,000.
MISREAD, SIGMAS = 1.0, 4.0
"""A reading with an error above both, inches and standard deviations, is a misreading."""
# Judged: errors of a drive and of a range are a few percent of a cell.
_INTO = 1.0
"""Inches asked for beyond a contact, from which the command led into the wall, not past it."""
_ASTRAY = 0.1
"""Share of a command from which an error of its drive is large: an inch in a cell. Judged."""
_STOOD = 0.01
"""Inches and degrees below which the robot has not moved: corrections are larger."""
_ALONG, _ACROSS = CELL_SIZE / 2, 1.0
"""Distances between the end of a ray and a place touched, inches along a wall and across it, within which it
showed that place. Beside it the wall of the next cell begins, and errors of short ranges are smaller.
Judged."""
# Judged: a third of a right angle; a sensor that looks further aside may see something else.
_ASIDE = 30.0
"""Degrees beside a contact from which a sensor is only the nearest one."""
_STEP = 0.05
"""Inches between places of a path at which its distance from the walls is measured: half a last digit."""
_OF_DRIVES = (Change.EXACT, Change.UNSEEN, Change.LAST)
"""Changes of drive errors."""
# A block's gripper or a bumper that was forgotten is larger; a course's robots have 6 in.
_LARGER = 0.25
"""Inches by which a robot reaches further than that of another set, from which that is told. Judged."""
_SHOWN = {
    Change.EXACT: "without errors of its drive",
    Change.BELIEVED: "from the pose that the program believed",
}


class ShownPlace(Struct, frozen=True):
    """A reading that was right and showed the place of a contact before it. It is by the sensor `code`, with
    `value` in inches, at `elapsed` seconds, `ago` inches of path before the movement that touched."""

    code: str
    value: float
    elapsed: float
    ago: float
    is_last: bool
    """True if that sensor was not read again."""


class DriveErrors(Struct, frozen=True):
    """Errors of drives without which nothing would have been touched: those of the last `count` movements by
    the drives with these codes. They are `certain` where nothing was read in between, and `large` where they
    are more than a program can be asked to allow for."""

    codes: tuple[str, ...]
    count: int
    certain: bool
    large: bool


class ContactEvidence:
    """The facts about one contact. A belief that is older than a cell of path does not count."""

    def __init__(self, seen: Attempt, met: Collision) -> None:
        self._seen = seen
        self.met = met
        self.belief = met.belief
        if met.belief is not None and met.row.gone_before - met.belief.gone > CELL_SIZE:
            self.belief = None
        self.lost = None if self.belief is None else met.lost
        self.looks = facing_sensor(met.contact, seen.spec.sensors, met.readings)
        moved = seen.history.movements.before(met.row.order + 1)
        self._begun = self.sent = met.row.elapsed if moved is None else moved.begin
        """Elapsed seconds at which its movement began, or at which its velocity was sent the last time."""
        commands, names = seen.within(seen.history.commands), np.array(seen.history.code_names)
        self._commands = commands[commands["elapsed"] <= met.row.elapsed]
        sent = self._commands["elapsed"][names[self._commands["code"]] == met.ended.command.code]
        if met.legs and len(sent):
            self.sent = float(sent[-1])

    @property
    def went(self) -> float:
        """Inches driven from its command to the contact: a velocity has many legs."""
        return self._went_since(self.sent) if self.met.legs else self.met.row.went

    def _went_since(self, time: float) -> float:
        row, moves = self.met.row, self._seen.within(self._seen.history.movements)
        moves = moves[moves["order"] < row.order]
        there = row.gone_before + row.went
        # No movement has ended since the velocity began that goes on.
        times = [0.0, *moves["elapsed"], max([self._begun, *moves["elapsed"][-1:]]), row.elapsed]
        gone = np.interp(time, times, [0.0, *moves["gone"], row.gone_before, there])
        return there - float(gone)

    @cached_property
    def quiet_since(self) -> float | None:
        """The last command before the contact, elapsed seconds, if a velocity drove the robot on for more
        than `BLIND` inches after it; None otherwise, or if the program asked for a wait."""
        if not self.met.legs or not len(self._commands) or WAIT in self._seen.history.code_names:
            return None
        last = float(self._commands["elapsed"][-1])
        return last if self._went_since(last) > BLIND else None

    @cached_property
    def tried(self) -> tuple[Counterfactual, ...]:
        """Its movement planned again, each time with one change."""
        met, belief, believed = self.met, self.belief, None
        if belief is not None:
            # Of a velocity the last inches are repeated, of a movement the whole of it.
            start = met.legs[0].before if met.legs else met.ended.before
            believed = carried_over(belief.true, belief.believed, start)
        return tuple(CounterfactualWorld(self._seen.spec).tried(met, believed))

    def saved_by(self, change: Change) -> bool | None:
        """True if a change would have avoided the contact; None if that is not known."""
        return next((each.saved for each in self.tried if each.change is change), None)

    @property
    def is_saved_by_drives(self) -> bool:
        """True if nothing would have been touched without drive errors, whichever movements are repeated
        without them: where one of these repetitions touches all the same, they do not decide."""
        found = [self.saved_by(change) for change in _OF_DRIVES]
        return True in found and False not in found

    @property
    def knew(self) -> bool:
        """True if the belief was right and sure."""
        return self.belief is not None and self.lost is None and not self.belief.unsure

    @property
    def beyond(self) -> float:
        """Distance that the movement was to go into the wall, inches."""
        totals = self.met.ended.trajectory.totals
        return math.hypot(totals.x, totals.y) - self.met.row.went

    @property
    def goes_on(self) -> bool:
        """True if a velocity went on for more than `BLIND` inches after it was sent, until the contact."""
        return bool(self.met.legs) and self.went > BLIND and self.quiet_since is None

    @property
    def is_outer_wall(self) -> bool:
        """True if the maze's outer wall was touched."""
        maze, cell = self._seen.spec.maze, self.met.contact.cell
        return cell is not None and not (1 <= cell[0] <= maze.rows and 1 <= cell[1] <= maze.columns)

    @property
    def leads_into(self) -> bool:
        """True if the place touched was ahead of a straight movement: its command led there, not past it."""
        trajectory, contact = self.met.ended.trajectory, self.met.contact
        if trajectory.turning or contact.held_block or self.bearing is None:
            return False
        return abs(half_turn(contact.bearing - self.bearing)) <= BESIDE

    @property
    def bearing(self) -> float | None:
        """Direction of a straight movement in the robot's frame, degrees; None for a turn."""
        totals = self.met.ended.trajectory.totals
        far = math.hypot(totals.x, totals.y)
        return math.degrees(math.atan2(totals.y, totals.x)) if math.isfinite(far) and far > _STOOD else None

    @property
    def facing(self) -> LastReading | None:
        """The last reading of a sensor that looks at the place touched."""
        return None if self.looks is None or not looks_there(self.looks) else self.looks.last

    def looks_at(self, code: str) -> bool:
        """True if a sensor looks at the contact, or along the movement at the wall that this leads to,
        whatever corner touched."""
        ahead = self.bearing if self.leads_into else None
        along = ahead is not None and abs(half_turn(self._sensor(code).rotation - ahead)) <= ALIKE
        return along or degrees_beside(self.met.contact, self._sensor(code)) <= _ASIDE

    @property
    def unread_text(self) -> str:
        """The ranges that were not read before the contact, in words without a full stop."""
        if self.quiet_since is not None:
            return f"No command came after {self.quiet_since:.1f} s, and the velocity went on"
        ranges = [each.code for each in self._seen.spec.sensors if each.kind.is_range]
        if not any(code in self.met.readings for code in ranges):
            return "; ".join(filter(None, ("No range sensor had been read", self.not_read)))
        if self.belief is not None or self.looks is None:
            none = f"No range sensor had been read for more than {BLIND:g} in or {BLIND_TURN:g} deg of path"
            return "; ".join(filter(None, (none, self.not_read)))
        last = self.never_read if self.looks.last is None else f"not read since {self.looks.last.time:.1f} s"
        nearest = f"No sensor looks straight there; {self.looks.codes[0]}, the nearest, was {last}"
        return self.not_read or nearest

    @property
    def never_read(self) -> str:
        """A sensor without a reading in words. Those before a person moved the robot do not count."""
        if self._seen.was_moved:
            return "not read since a person moved the robot"
        if is_of_boards(self.met.ended.command.source):
            return "never read: no part of wiring.toml has it, or the sketch does not ask for it"
        return "never read"

    @cached_property
    def not_read(self) -> str:
        """The sensor that looks at the contact, if it was not read shortly before; else empty."""
        looks = self.looks
        if looks is None or self.met.contact.held_block or not self.looks_at(looks.codes[0]):
            return ""
        if looks.last is None:
            return f"{looks.codes[0]} looks there and was {self.never_read}"
        since = f"not read since {looks.last.time:.1f} s"
        return f"{looks.last.code} looks there and was {since}" if self._since([looks.last]) > 1.0 else ""

    @cached_property
    def outline_text(self) -> str:
        """A sentence, with a space before it, on a robot that reaches further than the nominal one."""
        nominal = self._seen.history.nominal
        if nominal is None:
            return ""
        own, usual = (Footprint.of(each.robot).reach for each in (self._seen.spec, nominal.spec))
        if own - usual < _LARGER:
            return ""
        return f" The robot reaches {own:.3g} in from its centre, in the set {nominal.name} {usual:.3g} in."

    @property
    def new_wall_text(self) -> str:
        """A sentence, with a space before it, on a wall that the nominal set's maze does not have."""
        nominal, cell = self._seen.history.nominal, self.met.contact.cell
        if nominal is None or cell is None or self.is_outer_wall:
            return ""
        row, column = cell
        cells = nominal.spec.maze.cells
        is_same = len(cells) == self._seen.spec.maze.rows and len(cells[0]) == self._seen.spec.maze.columns
        if not is_same or cells[row - 1][column - 1] == WALL:
            return ""
        return f" In the set {nominal.name} there is no wall."

    @cached_property
    def narrow_text(self) -> str:
        """A sentence, with a space before it, on a straight path that passes a wall too closely; empty for
        turns, and for one that leads into the wall."""
        met, body = self.met, Footprint.of(self._seen.spec.robot)
        is_straight = self.bearing is not None and not (met.legs or met.ended.trajectory.turning)
        if self.bearing is None or not is_straight or met.contact.held_block or met.contact.cell is None:
            return ""
        start, way = met.ended.before, math.radians(self.bearing + met.ended.before.heading)
        totals = met.ended.trajectory.totals
        # Behind the place touched another wall may be ahead.
        far = min(math.hypot(totals.x, totals.y), met.row.went + 2.0 * body.reach)
        walls = Obstacles.of_maze(Maze(self._seen.spec.maze).walls)
        # A path that would reach the wall just behind its end does not pass it: it leads there.
        steps = np.arange(0.0, far + body.reach + _STEP, _STEP).tolist()
        gaps = [walls.clearance(start.x + d * math.cos(way), start.y + d * math.sin(way)) for d in steps]
        if min(gaps) <= _STEP:
            return ""
        near = min(gap for step, gap in zip(steps, gaps, strict=True) if step <= far)
        if near >= body.reach - _STEP:
            return ""
        half = f"radius is {body.radius:g} in" if body.radius else f"corners reach {body.reach:.1f} in"
        return f" Its straight path comes within {near:.1f} in of the wall; the robot's {half}."

    @property
    def asked(self) -> float | None:
        """Value of a straight movement's command, inches; None for turns and for velocities."""
        if self.met.legs:
            return None
        kind, value = self.met.ended.trajectory.kind, parse_value(self.met.ended.command.argument)
        return None if kind is None or kind.turns or isinstance(value, str) else value

    # -- did it look? --------------------------------------------------------------------------------------

    @cached_property
    def is_blind(self) -> bool:
        """True if no range sensor had been read shortly before. A program that sends beliefs may have used
        any of them; for one that does not, only the sensor that looks at the wall counts."""
        met, looks = self.met, self.looks
        shown = self.shown
        if self.quiet_since is not None:
            return True
        if met.contact.drift or (shown is not None and shown.ago <= BLIND):
            return False
        if self.is_saved_by_drives and self.saved_by(Change.EXACT):
            return False
        # No sensor looks at the room that a held block needs in a turn.
        turned = met.contact.held_block and met.ended.trajectory.turning
        if turned and (self.belief is None or self.knew):
            return False
        if self.belief is None:
            words = [] if looks is None or looks.last is None else [looks.last]
            return looks_there(looks) and self._since(words) > 1.0
        ranges = [each.code for each in self._seen.spec.sensors if each.kind.is_range]
        words = [met.readings[code] for code in ranges if code in met.readings]
        return bool(ranges) and self._since(words) > 1.0

    def _since(self, words: Sequence[LastReading]) -> float:
        """Path between the latest of some readings and a movement, as a share of the largest path that is not
        blind."""
        gone, turned = self.met.row.gone_before, self.met.row.turned_before
        shares = (max((gone - each.gone) / BLIND, (turned - each.turned) / BLIND_TURN) for each in words)
        return min(shares, default=math.inf)

    # -- did it know the wall? -----------------------------------------------------------------------------

    @cached_property
    def shown(self) -> ShownPlace | None:
        """The last right reading that showed the place of the contact, within a cell's length of path."""
        met, history = self.met, self._seen.history
        rows = self._seen.within(history.readings, self._seen.placed)
        rows = rows[(rows["order"] < met.row.order) & (rows["gone"] >= met.row.gone_before - CELL_SIZE)]
        found: list[ShownPlace] = []
        for sensor, mine in self._by_range(rows):
            newest = mine["order"].max(initial=0)
            mine = mine[_right(mine, sensor) & np.isfinite(mine["value"])]
            heading, ray = np.radians(mine["heading"].astype(np.float64)), np.radians(sensor.rotation)
            cos, sin = np.cos(heading), np.sin(heading)
            ahead = sensor.x + mine["value"] * np.cos(ray)
            aside = sensor.y + mine["value"] * np.sin(ray)
            x = np.abs(mine["x"] + cos * ahead - sin * aside - met.contact.point[0])
            y = np.abs(mine["y"] + sin * ahead + cos * aside - met.contact.point[1])
            # Walls run along the axes.
            places = np.flatnonzero((np.maximum(x, y) <= _ALONG) & (np.minimum(x, y) <= _ACROSS))
            if len(places):
                last = mine[int(places[-1])]
                ago = met.row.gone_before - float(last["gone"])
                is_last = bool(last["order"] == newest)
                found.append(
                    ShownPlace(sensor.code, float(last["value"]), float(last["elapsed"]), ago, is_last)
                )
        # One that looks at the place says more than one that looks aside, if the robot has stood since.
        return max(
            found,
            key=lambda each: (each.ago <= _STOOD and self.looks_at(each.code), each.elapsed),
            default=None,
        )

    @cached_property
    def ignored(self) -> ShownPlace | None:
        """The right reading of the wall that its command led into; None if there is none, or if a later one
        of that sensor, a wrong belief or errors of the drives explain the movement."""
        shown, far = self._exceeded or self.shown, self.beyond > _INTO
        if shown is None or not shown.is_last:
            return None
        # With a right belief a program needs no readings to keep off a wall; only a wall straight ahead
        # counts.
        more = self._exceeded is not None
        against = (far and more) if self.knew else (far or more)
        misled = self.lost is not None and self.saved_by(Change.BELIEVED) is not False
        by_drives = self.is_saved_by_drives and not self.saved_by(Change.LAST)
        if misled or not against or by_drives:
            return None
        return shown

    @property
    def is_into_known(self) -> bool:
        """True if a right belief knew the wall, and the command led into it all the same."""
        is_straight = not self.met.ended.trajectory.turning and not self.met.contact.held_block
        by_drives = self.is_saved_by_drives and self.saved_by(Change.EXACT)
        saved = by_drives or self.saved_by(Change.BELIEVED)
        return self.knew and is_straight and self.beyond > _INTO and not saved

    @cached_property
    def _exceeded(self) -> ShownPlace | None:
        """The right reading straight ahead of the movement, from where it began, that its command was to go
        beyond; None without one."""
        met, kind, asked = self.met, self.met.ended.trajectory.kind, self.asked
        if kind is None or asked is None or met.contact.held_block:
            return None
        towards = kind.bearing if asked > 0 else kind.bearing + 180.0
        for sensor, rows in self._by_range(self._seen.within(self._seen.history.readings, self._seen.placed)):
            row = rows[rows["order"] < met.row.order][-1:]
            # Readings keep their sums in single precision.
            stood = (met.row.gone_before - row["gone"] <= _STOOD) & (
                met.row.turned_before - row["turned"] <= _STOOD
            )
            # Where a wall aside was touched, only a clear excess counts.
            least = 0.0 if self.looks_at(sensor.code) else _INTO
            row = row[stood & _right(row, sensor) & (row["value"] < abs(asked) - least)]
            if len(row) and abs(half_turn(sensor.rotation - towards)) <= ALIKE:
                return ShownPlace(
                    sensor.code, float(row["value"][0]), float(row["elapsed"][0]), 0.0, is_last=True
                )
        return None

    # -- was it misled? ------------------------------------------------------------------------------------

    @property
    def misread(self) -> LastReading | None:
        """The last reading of the wall, if it showed it much further away than it was."""
        last = self.facing
        if last is None:
            return None
        sensor = self._sensor(last.code)
        usual = sensor.error * last.true + sensor.absolute_error
        return last if last.value - last.true > max(MISREAD, SIGMAS * usual) else None

    @property
    def is_elsewhere(self) -> bool:
        """True if the belief was wrong or unsure, and no right reading showed the wall; or its movement would
        have touched nothing from there."""
        believed, unsure = self.saved_by(Change.BELIEVED), self.belief is not None and self.belief.unsure
        if self.lost is not None:
            return unsure or believed is not False or self.ignored is None
        return (unsure and believed is not False) or (bool(believed) and not self.is_blind)

    @cached_property
    def drive_errors(self) -> DriveErrors | None:
        """Errors of drives without which nothing would have been touched."""
        met = self.met
        if not self.is_saved_by_drives:
            return None
        if self.saved_by(Change.EXACT) and self.lost is None:
            return DriveErrors((met.ended.command.code,), 1, certain=True, large=self._goes_astray)
        # A program that sends beliefs has taken earlier errors into account, rightly or wrongly.
        if self.belief is not None and not self.belief.unsure:
            return None
        # A program that reads after each movement sees the effect of its errors, and uses that.
        last = () if self._looked_at_each_movement else ((Change.LAST, len(met.before)),)
        for change, count in ((Change.UNSEEN, met.unseen), *last):
            if self.saved_by(change):
                moved = [*met.before[len(met.before) - count :], met.ended]
                codes = tuple(dict.fromkeys(each.command.code for each in moved))
                unseen = change is Change.UNSEEN
                large = unseen and (bool(met.legs) or self._goes_astray)
                return DriveErrors(codes, len(moved), certain=unseen, large=large)
        return None

    @property
    def _goes_astray(self) -> bool:
        """True if the movement differs from its command by a tenth or more, whatever its set declares."""
        asked = CounterfactualWorld(self._seen.spec).asked(self.met.ended)
        if asked is None:
            return False
        totals, far = self.met.ended.trajectory.totals, math.hypot(asked.x, asked.y)
        off = math.hypot(totals.x - asked.x, totals.y - asked.y)
        return off >= _ASTRAY * far if far else abs(totals.r - asked.r) >= _ASTRAY * abs(asked.r)

    @property
    def _looked_at_each_movement(self) -> bool:
        met, movements = self.met, self._seen.history.movements
        count = max(len(met.before), len(met.legs) - 1)
        first = max(movements.place_of(met.row.order) - count, 0)
        rows = self._seen.within(self._seen.history.readings, self._seen.placed)
        rows = rows[(rows["order"] > movements[first].order) & (rows["order"] < met.row.order)]
        return sum(len(mine) for _, mine in self._by_range(rows)) >= max(count, 1)

    def _sensor(self, code: str) -> SensorSpec:
        return next(each for each in self._seen.spec.sensors if each.code == code)

    def _by_range(self, rows: Columns) -> Iterator[tuple[SensorSpec, Columns]]:
        """The range sensors that were read, each with its rows."""
        codes = self._seen.history.sensor_codes
        for each in self._seen.spec.sensors:
            if each.kind.is_range and each.code in codes:
                yield each, rows[rows["sensor"] == codes.index(each.code)]

    # -- text ----------------------------------------------------------------------------------------------

    @property
    def text(self) -> str:
        """The contact, its time and its place in the movement."""
        row, went = self.met.row, self.went
        turned = f" and {abs(row.turned):.0f} deg" if abs(row.turned) >= 2 else ""
        place = contact_text(self.met.contact, self._seen.spec)
        return f"{place}, {side_text(self.met.contact)}, after {went:.1f} in{turned} of {row.shown}"


def belief_text(seen: Attempt, belief: BeliefRow | None) -> str:
    """Error of a belief, and its spread as the program sent it."""
    if belief is None:
        return f"The program sent no belief{' since a person moved the robot' if seen.was_moved else ''}."
    spread = belief.spread
    said = "no spread was sent" if math.isnan(spread) else f"its spread was {spread:.1f} in"
    return f"The belief sent at {belief.elapsed:.1f} s was off by {belief.error_text}; {said}."


def shown_tried(tried: Sequence[Counterfactual], *, wrong_drive: bool = False) -> str:
    """Changes that would have avoided a contact, and those that would not. What a wrong drive does is no
    error of the movements that are repeated: of it they say nothing. Nor do repetitions that differ."""
    found = {each.saved for each in tried if each.change in _OF_DRIVES}
    tells_nothing = wrong_drive or found >= {True, False}
    tried = [each for each in tried if not (tells_nothing and each.change in _OF_DRIVES)]
    parts = []
    for saved, touched in ((True, "nothing"), (False, "something even")):
        changes = [_SHOWN.get(each.change, each.change.value) for each in tried if each.saved is saved]
        if changes:
            listed = " or ".join(filter(None, (", ".join(changes[:-1]), changes[-1])))
            parts.append(f"It would have touched {touched} {listed}.")
    return " ".join(parts)


def _right(rows: Columns, sensor: SensorSpec) -> BoolArray:
    # No echo has the noise of distance 0: a share of infinity would allow any reading, or be NaN.
    true = np.where(np.isfinite(rows["true"]), np.abs(rows["true"]), 0.0)
    usual = sensor.error * true + sensor.absolute_error
    return np.asarray(np.abs(rows["error"]) <= np.maximum(SLIGHT, COVERED * usual))
