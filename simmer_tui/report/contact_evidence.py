"""The facts about a contact: its readings, its belief, and its movement planned again with one change."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np

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
    facing_sensor,
)
from simmer_tui.run.history_rows import BeliefRow
from simmer_tui.run.phrases import contact_text, side_text
from simmer_tui.sim.angles import half_turn, side_name
from simmer_tui.sim.sensors import ObservingSensor, modelled_sensor
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
"""Inches below which a movement is a turn: corrections are larger."""


class ContactEvidence:
    """The facts about one contact. A belief that is older than a cell of path does not count."""

    def __init__(self, seen: Attempt, met: Collision) -> None:
        self._seen = seen
        self.met = met
        self.belief = met.belief
        if met.belief is not None and met.row.gone_before - met.belief.gone > CELL_SIZE:
            self.belief = None
        self.lost = None if self.belief is None else met.lost
        moved = seen.history.movements.before(met.row.order + 1)
        self._began = self.sent = met.row.elapsed if moved is None else moved.begin
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
        if self.sent > self._began:
            # It was sent again in the leg that touched something.
            return row.went * (row.elapsed - self.sent) / (row.elapsed - self._began)
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

    @property
    def tried_text(self) -> str:
        """Changes that would have avoided the contact, and those that would not, in sentences."""
        words = {True: "nothing", False: "something even"}
        known = [each for each in self.tried if each.saved is not None]
        told = (f"It would have touched {words[bool(each.saved)]} {each.change.value}." for each in known)
        return " ".join(told)

    @property
    def astray(self) -> tuple[str, ...]:
        """Codes of the drives without whose errors nothing would have been touched, if its movement differs
        from its command by a tenth. Else empty."""
        ended = self.met.ended
        asked = CounterfactualWorld(self._seen.spec, self.met).asked(ended)
        if asked is None or self.lost is not None or not self.saved_by(Change.EXACT):
            return ()
        totals, far = ended.trajectory.totals, math.hypot(asked.x, asked.y)
        off = math.hypot(totals.x - asked.x, totals.y - asked.y)
        # A usual turn aside is no error that a teacher would blame.
        is_large = off >= _ASTRAY * far if far else abs(totals.r - asked.r) >= _ASTRAY * abs(asked.r)
        moved = (*self._unseen, ended)
        return tuple(dict.fromkeys(each.command.code for each in moved)) if is_large else ()

    # -- its command ---------------------------------------------------------------------------------------

    @property
    def knew(self) -> bool:
        """True if the belief was right and sure."""
        return self.belief is not None and self.lost is None and not self.belief.unsure

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
    def is_straight(self) -> bool:
        """True if the robot itself touched something in a straight movement."""
        return not self.met.ended.trajectory.turning and not self.met.contact.held_block

    @property
    def _bearing(self) -> float | None:
        """Commanded direction of a movement in the robot's frame, degrees; None for a turn."""
        totals, kind = self.met.ended.trajectory.totals, self.met.ended.trajectory.kind
        far = math.hypot(totals.x, totals.y)
        if not math.isfinite(far) or far <= _STOOD:
            return None
        went = math.degrees(math.atan2(totals.y, totals.x))
        if kind is None or kind.turns or self.met.by_velocity:
            return went
        return kind.bearing if abs(half_turn(kind.bearing - went)) <= 90.0 else kind.bearing + 180.0

    @property
    def leads_into(self) -> bool:
        """True if the place touched was ahead of a straight movement: its command led there, not past it."""
        if self._bearing is None or not self.is_straight:
            return False
        return abs(half_turn(self.met.contact.bearing - self._bearing)) <= BESIDE

    @property
    def _commanded(self) -> float:
        """Length of its movement if nothing had been there, inches."""
        totals = self.met.ended.trajectory.totals
        return math.hypot(totals.x, totals.y)

    @property
    def _leads_beyond(self) -> bool:
        """True if the command led further into the wall than errors lead."""
        return self.is_straight and self._commanded - self.met.row.went > _INTO

    # -- its readings --------------------------------------------------------------------------------------

    @cached_property
    def _looking(self) -> tuple[str, ...]:
        """Codes of the range sensors that look along the movement at what it touched, else of those that look
        most nearly at the place touched."""
        held = self._seen.spec.block_size if self.met.contact.held_block else 0.0
        # A sensor that sees the held block sees nothing behind it.
        sensors = [
            each
            for each in self._seen.spec.sensors
            if each.kind.is_range and each.enabled and not (held and _sees_block(each, held))
        ]
        along = [each.code for each in sensors if self._is_along(each.rotation)]
        if not any(map(self._is_exceeded, along)) and (
            not self.leads_into or any(map(self._looks_past, along))
        ):
            along = []
        looks = facing_sensor(self.met.contact, sensors, self.met.readings)
        nearest = looks.codes if looks is not None and looks_there(looks) else ()
        return tuple(along) or nearest

    def _is_along(self, rotation: float) -> bool:
        return self._bearing is not None and abs(half_turn(rotation - self._bearing)) <= ALIKE

    def _looks_past(self, code: str) -> bool:
        """True if a sensor's fresh and right reading went past what was touched."""
        last = self.met.readings.get(code)
        return last is not None and self._is_fresh(last) and last.value > self.went + BLIND

    def _is_exceeded(self, code: str) -> bool:
        """True if a sensor's fresh and right reading is shorter than the movement that was commanded."""
        last = self.met.readings.get(code)
        return last is not None and self._is_fresh(last) and last.value < self._commanded

    def _is_fresh(self, last: LastReading) -> bool:
        """True if a reading was right, and the robot moved and turned little since then."""
        is_right = abs(last.value - last.true) <= max(SLIGHT, COVERED * self._usual_error(last))
        return is_right and not self._is_old([last]) and self._turned_since(last) <= ALIKE

    def _turned_since(self, last: LastReading) -> float:
        return self.met.row.turned_before - last.turned

    @property
    def last(self) -> LastReading | None:
        """The newest reading of a sensor that looks at what was touched."""
        read = [self.met.readings[code] for code in self._looking if code in self.met.readings]
        return max(read, key=lambda each: each.time, default=None)

    @property
    def watch(self) -> str:
        """Code of that sensor, read or not; empty if none looks there."""
        return next(iter(self._looking), "") if self.last is None else self.last.code

    @property
    def _latest(self) -> LastReading | None:
        """The newest reading of a range sensor."""
        return max(self._ranges, key=lambda each: each.time, default=None)

    @property
    def seen_at(self) -> float:
        """Elapsed seconds of what `sight_text` tells."""
        last = self._latest if self.is_blind else self.last
        return self.sent if last is None else last.time

    @property
    def sight_text(self) -> str:
        """The last reading of that sensor, in words; where no range sensor was read shortly before, the last
        one of all."""
        last, latest = self.last, self._latest
        # Readings before a person moved the robot do not count.
        yet = "since a person moved the robot" if self._seen.was_moved else "yet"
        if latest is None:
            return f"no range sensor had been read {yet}"
        if self.is_blind:
            read = f"{self._named(latest.code)} read {shown_range(latest.value)}"
            return f"{read}, and no range sensor was read after that"
        if not self.watch:
            return "no sensor looks at the place that was touched"
        if last is None:
            return f"{self._named(self.watch)} had not been read {yet}"
        off = abs(last.value - last.true) > SLIGHT
        true = f"; the true distance was {shown_range(last.true)}" if off else ""
        # It looked elsewhere when it was read.
        turned = "; then the robot turned" if self._turned_since(last) > ALIKE else ""
        again = f"; {last.code} was not read again" if self._is_old([last]) else ""
        return f"{self._named(last.code)} read {shown_range(last.value)}{true}{turned}{again}"

    def _named(self, code: str) -> str:
        """A sensor by its code and the side to which it looks: `u1 (ahead)`."""
        return f"{code} ({side_name(self._row_of(code).rotation)})"

    @property
    def is_unread(self) -> bool:
        """True if that sensor was not read shortly before. A program that sends beliefs may have used any of
        them; errors of the drives alone, or a held block that turns, need no reading."""
        turns_block = self.met.contact.held_block and self.met.ended.trajectory.turning
        by_drive = self.met.contact.drift or (self.saved_by(Change.EXACT) and not self._unseen)
        if turns_block or by_drive or not self.watch:
            return False
        return self._is_old([self.last]) if self.belief is None else self.is_blind

    @property
    def is_blind(self) -> bool:
        """True if no range sensor was read shortly before."""
        return self._is_old(self._ranges)

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

    @property
    def showed_wall(self) -> bool:
        """True if a fresh and right reading showed what was touched, and the command led into it."""
        last = self.last
        if last is None or not self.is_straight or self.saved_by(Change.EXACT) or not self._is_fresh(last):
            return False
        if self._is_along(self._row_of(last.code).rotation):
            return self._is_exceeded(last.code)
        return last.value <= _CLOSE and self._leads_beyond

    @property
    def knew_wall(self) -> bool:
        """True if a right belief knew the wall, and the command led well into it."""
        return self.knew and self._leads_beyond and not any(map(self.saved_by, Change))

    @property
    def is_misread(self) -> bool:
        """True if the last reading showed the wall much further away than it was."""
        last = self.last
        return last is not None and last.value - last.true > max(MISREAD, SIGMAS * self._usual_error(last))

    def _usual_error(self, last: LastReading) -> float:
        """The standard deviation of a reading by its sensor's row; none of a reading without an echo."""
        sensor = self._row_of(last.code)
        true = abs(last.true) if math.isfinite(last.true) else 0.0
        return sensor.error * true + sensor.absolute_error

    def _row_of(self, code: str) -> SensorSpec:
        return next(each for each in self._seen.spec.sensors if each.code == code)

    @property
    def text(self) -> str:
        """The contact, and its place in the movement."""
        contact, row = self.met.contact, self.met.row
        turned = f" and {abs(row.turned):.0f} deg" if abs(row.turned) >= 2 else ""
        side = side_text(contact)
        where = f"on its {side}" if side in ("left", "right") else side
        touched = contact_text(contact, self._seen.spec)
        return f"{touched}, {where}, after {self.went:.1f} in{turned} of {row.shown}"


def _sees_block(sensor: SensorSpec, size: float) -> bool:
    made = modelled_sensor(sensor)
    return isinstance(made, ObservingSensor) and made.sees_block(size)


def belief_text(seen: Attempt, belief: BeliefRow | None) -> str:
    """Error of a belief, and its spread as the program sent it; empty for a real robot, without a truth."""
    if seen.history.is_twin:
        return ""
    if belief is None:
        return f"The program sent no belief{' since a person moved the robot' if seen.was_moved else ''}."
    spread, right = belief.spread, "right, " if belief.is_right and belief.distance <= SLIGHT else ""
    said = "no spread was sent" if math.isnan(spread) else f"its spread was {spread:.1f} in"
    return f"The belief sent at {belief.elapsed:.1f} s was {right}off by {belief.error_text}; {said}."
