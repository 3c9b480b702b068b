"""The facts about a contact: its readings, its belief, and its movement planned again with one change."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np
from msgspec import Struct

from simmer_tui.report.counterfactuals import Change, Counterfactual, CounterfactualWorld
from simmer_tui.report.why import looks_there, shown_range
from simmer_tui.run.attempt import Attempt, Collision
from simmer_tui.run.events import MovementEnded
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
from simmer_tui.run.phrases import contact_text, side_text
from simmer_tui.sim.angles import half_turn
from simmer_tui.sim.command import parse_value
from simmer_tui.sim.specs import CELL_SIZE, SensorSpec

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
# Judged: two thirds of a robot's half width; a wall further aside is not the corner that it meets.
_CLOSE = 2.0
"""Inches that a sensor aside of a movement reads at most if it shows what was touched."""
_STOOD = 0.01
"""Inches and degrees below which the robot has not moved: corrections are larger."""
# Judged: a third of a right angle; a sensor that looks further aside may see something else.
_ASIDE = 30.0
"""Degrees beside a contact from which a sensor is only the nearest one."""


class DriveErrors(Struct, frozen=True):
    """Errors of drives without which nothing would have been touched: those of the last `count` movements by
    the drives with these codes. They are `large` if the movement differs from its command by a tenth."""

    codes: tuple[str, ...]
    count: int
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
        self.sent = met.row.elapsed if moved is None else moved.begin
        """Elapsed seconds at which its movement began, or at which its velocity was sent the last time."""
        if met.by_velocity:
            commands, names = seen.within(seen.history.commands), np.array(seen.history.code_names)
            mine = commands[names[commands["code"]] == met.ended.command.code]
            self.sent = float(max(mine["elapsed"][mine["elapsed"] <= met.row.elapsed], default=self.sent))

    @cached_property
    def went(self) -> float:
        """Inches driven from its command to the contact: a velocity has many legs."""
        row = self.met.row
        if not self.met.by_velocity:
            return row.went
        moves = self._seen.within(self._seen.history.movements)
        gone = moves["gone"][(moves["order"] < row.order) & (moves["elapsed"] <= self.sent)]
        return row.gone_before + row.went - float(max(gone, default=0.0))

    # -- its movement planned again ------------------------------------------------------------------------

    @cached_property
    def tried(self) -> tuple[Counterfactual, ...]:
        """Its movement planned again, each time with one change."""
        if self.met.contact.cell is None:
            return ()
        world, belief = CounterfactualWorld(self._seen.spec, self.met), self.belief
        made = [world.exact(self._unseen)]
        if belief is not None:
            made.append(world.believed(carried_over(belief.true, belief.believed, self.met.ended.before)))
        return tuple(each for each in made if each is not None)

    @property
    def _unseen(self) -> Sequence[MovementEnded]:
        """The movements since the last reading; none with a sure belief, which has their errors in it."""
        return () if self.belief is not None and not self.belief.unsure else self.met.unseen

    def saved_by(self, change: Change) -> bool | None:
        """True if a change would have avoided the contact; None if that is not known."""
        return next((each.saved for each in self.tried if each.change is change), None)

    @cached_property
    def drive_errors(self) -> DriveErrors | None:
        """Errors of drives without which nothing would have been touched."""
        if not self.saved_by(Change.EXACT) or self.lost is not None:
            return None
        ended, moved = self.met.ended, [*self._unseen, self.met.ended]
        codes = tuple(dict.fromkeys(each.command.code for each in moved))
        asked = CounterfactualWorld(self._seen.spec, self.met).asked(ended)
        large = False
        if asked is not None:
            totals, far = ended.trajectory.totals, math.hypot(asked.x, asked.y)
            off = math.hypot(totals.x - asked.x, totals.y - asked.y)
            large = off >= _ASTRAY * far if far else abs(totals.r - asked.r) >= _ASTRAY * abs(asked.r)
        return DriveErrors(codes, len(moved), large)

    # -- its command ---------------------------------------------------------------------------------------

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
        return self.met.by_velocity and self.went > BLIND

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
    def asked(self) -> float | None:
        """Value of a straight movement's command, inches; None for turns and for velocities."""
        kind, value = self.met.ended.trajectory.kind, parse_value(self.met.ended.command.argument)
        is_known = not self.met.by_velocity and kind is not None and not kind.turns
        return value if is_known and not isinstance(value, str) else None

    # -- its readings --------------------------------------------------------------------------------------

    @property
    def facing(self) -> LastReading | None:
        """The last reading of a sensor that looks at the place touched."""
        return None if self.looks is None or not looks_there(self.looks) else self.looks.last

    def looks_at(self, code: str) -> bool:
        """True if a sensor looks at the contact, or along the movement at the wall that this leads to,
        whatever corner touched."""
        sensor = self._sensor(code)
        ahead = self.bearing if self.leads_into else None
        along = ahead is not None and abs(half_turn(sensor.rotation - ahead)) <= ALIKE
        return along or degrees_beside(self.met.contact, sensor) <= _ASIDE

    @property
    def looking(self) -> str:
        """Code of the sensor that looks at the contact, or nearly so; empty if none does."""
        if self.looks is None or not looks_there(self.looks):
            return ""
        return self.looks.codes[0] if self.looks.last is None else self.looks.last.code

    @property
    def _who_looks(self) -> str:
        """That sensor in words."""
        words = "which looks there" if self.looks_at(self.looking) else "the nearest sensor"
        return f"{self.looking}, {words},"

    @property
    def _never_read(self) -> str:
        # Readings before a person moved the robot do not count.
        return "not read since a person moved the robot" if self._seen.was_moved else "never read"

    @property
    def sight_text(self) -> str:
        """The last reading of the sensor that looks at the contact, in words."""
        last = self.facing
        if not self.looking:
            return "no sensor looks at the place that was touched"
        if last is None:
            return f"{self._who_looks} was {self._never_read}"
        off = abs(last.value - last.true) > SLIGHT
        true = f"; the true distance was {shown_range(last.true)}" if off else ""
        # It looked elsewhere when it was read.
        then = "; then the robot turned" if self.met.row.turned_before - last.turned > ALIKE else ""
        return f"{self._who_looks} read {shown_range(last.value)}{true}{then}"

    @property
    def unread_text(self) -> str:
        """A sentence with a space before it: no range was read shortly before, or none by the sensor that
        looks at the contact. Else empty."""
        held = self.met.contact.held_block
        # No sensor looks at the room that a held block needs, and only a blind program is told so.
        is_all = self.is_blind or (self.looks is not None and not held)
        if is_all and self._is_old(self._ranges) and not self._seen.was_moved:
            latest = max((each.time for each in self._ranges), default=None)
            return f" No range sensor had been read{'' if latest is None else f' since {latest:.1f} s'}."
        if not self.is_unread:
            ahead = self.unread_ahead
            return f" {ahead}, which looks that way, was {self._never_read}." if ahead else ""
        since = self._never_read if self.facing is None else f"not read since {self.facing.time:.1f} s"
        return f" {self._who_looks} was {since}."

    @property
    def is_unread(self) -> bool:
        """True if the sensor that looks at the contact was not read shortly before."""
        is_told = self.looking and (self.is_blind or self.looks_at(self.looking))
        return bool(is_told) and not self.met.contact.held_block and self._is_old([self.facing])

    @cached_property
    def unread_ahead(self) -> str:
        """Code of the range sensor that looks along a straight movement at what it touched, and was never
        read; empty without one, or if another that looks that way was."""
        if self.bearing is None or self.met.contact.held_block or self.looks is None:
            return ""
        if abs(half_turn(self.met.contact.bearing - self.bearing)) > BESIDE:
            return ""
        sensors = [each for each in self._seen.spec.sensors if each.kind.is_range and each.enabled]
        along = [each.code for each in sensors if abs(half_turn(each.rotation - self.bearing)) <= ALIKE]
        return "" if any(code in self.met.readings for code in along) else next(iter(along), "")

    @cached_property
    def is_blind(self) -> bool:
        """True if no range sensor had been read shortly before. A program that sends beliefs may have used
        any of them; for one that does not, only the sensor that looks at the wall counts."""
        # No sensor looks at the room that a held block needs in a turn; a lost program should have looked.
        held = self.met.contact.held_block and self.met.ended.trajectory.turning
        turned = held and (self.belief is None or self.knew)
        by_drive = self.met.contact.drift or (self.saved_by(Change.EXACT) and not self._unseen)
        if by_drive or turned:
            return False
        if self.belief is None:
            return looks_there(self.looks) and self._is_old([self.facing])
        return self.looks is not None and self._is_old(self._ranges)

    @property
    def _ranges(self) -> list[LastReading]:
        """The last readings of the range sensors that were read."""
        codes = [each.code for each in self._seen.spec.sensors if each.kind.is_range]
        return [self.met.readings[code] for code in codes if code in self.met.readings]

    def _is_old(self, readings: Iterable[LastReading | None]) -> bool:
        """True if there is no reading, or the robot moved on for more than `BLIND` after the latest one."""
        gone, turned = self.met.row.gone_before, self.met.row.turned_before
        return not any(
            gone - each.gone <= BLIND and turned - each.turned <= BLIND_TURN
            for each in readings
            if each is not None
        )

    @cached_property
    def ignored(self) -> LastReading | None:
        """The right reading from its beginning that its command was to go beyond, or that of the wall it led
        into. None without one, or if errors of the drives explain the contact."""
        asked, kind, row = self.asked, self.met.ended.trajectory.kind, self.met.row
        if asked is None or kind is None or self.met.contact.held_block or self.saved_by(Change.EXACT):
            return None
        towards = kind.bearing if asked > 0.0 else kind.bearing + 180.0
        for sensor in (each for each in self._seen.spec.sensors if each.kind.is_range):
            last = self.met.readings.get(sensor.code)
            along = abs(half_turn(sensor.rotation - towards)) <= ALIKE
            # Where a wall aside was touched, only a clear excess counts.
            least = 0.0 if self.looks_at(sensor.code) else _INTO
            if last is None or not along or last.value >= abs(asked) - least:
                continue
            # Readings keep their sums in single precision.
            gone, turned = row.gone_before - last.gone, row.turned_before - last.turned
            if max(gone, turned) <= _STOOD and self._is_right(last):
                return last
        last = self.facing
        # With a right belief a program needs no readings to keep off a wall.
        if last is None or self.knew or self._is_old([last]) or self.beyond <= _INTO:
            return None
        return last if self.shows(last) and self._is_right(last) else None

    def shows(self, last: LastReading) -> bool:
        """True if a reading may show what was touched: along the movement, or close beside it."""
        bearing, rotation = self.bearing, self._sensor(last.code).rotation
        along = bearing is not None and abs(half_turn(rotation - bearing)) <= ALIKE
        return last.value <= (self.went + BLIND if along else _CLOSE)

    def _is_right(self, last: LastReading) -> bool:
        return abs(last.value - last.true) <= max(SLIGHT, COVERED * self._usual_error(last))

    @property
    def is_into_known(self) -> bool:
        """True if a right belief knew the wall, and the command led into it all the same."""
        is_straight = not self.met.ended.trajectory.turning and not self.met.contact.held_block
        return self.knew and is_straight and self.beyond > _INTO and not any(map(self.saved_by, Change))

    @property
    def misread(self) -> LastReading | None:
        """The last reading of the wall, if it showed it much further away than it was."""
        last = self.facing
        if last is None:
            return None
        return last if last.value - last.true > max(MISREAD, SIGMAS * self._usual_error(last)) else None

    def _usual_error(self, last: LastReading) -> float:
        """The standard deviation of a reading by its sensor's row; none of a reading without an echo."""
        sensor = self._sensor(last.code)
        true = abs(last.true) if math.isfinite(last.true) else 0.0
        return sensor.error * true + sensor.absolute_error

    def _sensor(self, code: str) -> SensorSpec:
        return next(each for each in self._seen.spec.sensors if each.code == code)

    # -- text ----------------------------------------------------------------------------------------------

    @property
    def text(self) -> str:
        """The contact, its time and its place in the movement."""
        contact, row = self.met.contact, self.met.row
        turned = f" and {abs(row.turned):.0f} deg" if abs(row.turned) >= 2 else ""
        where = f"{contact_text(contact, self._seen.spec)}, {side_text(contact)}"
        return f"{where}, after {self.went:.1f} in{turned} of {row.shown}"


def belief_text(seen: Attempt, belief: BeliefRow | None) -> str:
    """Error of a belief, and its spread as the program sent it."""
    if belief is None:
        return f"The program sent no belief{' since a person moved the robot' if seen.was_moved else ''}."
    spread = belief.spread
    said = "no spread was sent" if math.isnan(spread) else f"its spread was {spread:.1f} in"
    return f"The belief sent at {belief.elapsed:.1f} s was off by {belief.error_text}; {said}."


def shown_tried(tried: Iterable[Counterfactual]) -> str:
    """Changes that would have avoided a contact, and those that would not, in sentences."""
    saved = {True: "nothing", False: "something even"}
    known = [each for each in tried if each.saved is not None]
    return " ".join(f"It would have touched {saved[bool(each.saved)]} {each.change.value}." for each in known)
