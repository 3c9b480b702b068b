"""Beliefs beside the truth: the share of sure ones, constant offsets, and what explains them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterator
from functools import cached_property
from operator import itemgetter

import numpy as np
from msgspec.structs import astuple

from simmer_tui.report.belief_audit import SURE, ErrorPattern, step_patterns
from simmer_tui.report.finding import FEWEST
from simmer_tui.report.robust_statistics import median_of
from simmer_tui.report.run_readings import by_sensor, poses_of, world_without_block
from simmer_tui.report.why import shown_range
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.facts import COVERED, SLIGHT, SLIGHT_TURN, UNSURE, UNSURE_TURN, carried_over, displacement
from simmer_tui.run.history_rows import BeliefRow
from simmer_tui.run.phrases import times_text
from simmer_tui.run.table import Columns
from simmer_tui.sim.angles import cos_sin_array, half_turn
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.command import counted
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.sensors import ObservingSensor, modelled_sensor
from simmer_tui.sim.specs import CELL_SIZE

_Poses = tuple[FloatArray, FloatArray, FloatArray]
_NEAR = 1.5
"""Inches around a place within which a belief is there: half of a robot's width; judged."""
_CONSTANT = 0.75
"""Least share of sure beliefs with one error that make it constant. Judged."""
_MOST_NAMED = 4
_MOSTLY_RIGHT = 0.9
"""Share of right ranges from which the ranges were right: one in a hundred is off by chance. Judged."""
_RANGES = 200
"""Most ranges that are compared with a believed place; each costs a ray."""
_WHOLE_CELLS = ", as with a map or a start that is whole cells off, or a place that looks alike"


class BeliefFacts:
    """The beliefs of an attempt. A real robot has no truth: then only the share of sure ones is known."""

    def __init__(self, seen: Attempt, known: Collection[str] = ()) -> None:
        """`known` are codes of sensors and drives that are not as their set says: the stronger
        explanation."""
        self._seen = seen
        self._known = frozenset(known)
        rows = seen.within(seen.history.beliefs, max(seen.placed, seen.history.began))
        self.rows: Columns = rows[np.isfinite(rows["distance"]) & np.isfinite(rows["turn"])]
        unsure = (self.rows["spread"] > UNSURE) | (self.rows["allowed_turn"] > COVERED * UNSURE_TURN)
        self.sure: Columns = self.rows[~unsure]
        self.has_truth = not seen.history.is_twin

    def was_right_before(self, order: int) -> bool:
        """True if a sure belief was right before an event."""
        rows = self.sure[self.sure["order"] < order]
        return any(BeliefRow(*row).is_right for row in rows.tolist())

    @cached_property
    def constant(self) -> ErrorPattern | None:
        """The one error that most sure beliefs have; None where they are right, differ, or are few."""
        rows = self.sure
        if not self.has_truth or len(rows) < FEWEST["set"] or 2 * len(rows) < len(self.rows):
            return None
        found = []
        for where, (x, y, heading), hint, of in self._transforms():
            is_there = np.hypot(rows["x"] - x, rows["y"] - y) <= _NEAR
            is_turned = np.abs(half_turn(rows["heading"] - heading)) <= SLIGHT_TURN
            share = float((is_there & is_turned).mean())
            text = f"{where} in {100 * share:.0f} % of the sure beliefs{hint}"
            found.append((share, ErrorPattern(text, of)))
        # Of equal shares the first is told: a shape explains place and heading.
        most, offset = max(found, key=itemgetter(0))
        return offset if most >= _CONSTANT else None

    def _transforms(self) -> Iterator[tuple[str, _Poses, str, tuple[str, ...]]]:
        """The errors that are tried: a maze that is mirrored or turned, an offset of the place in the maze's
        or the robot's frame, whatever the heading, and a turn, whatever the place. Each in words, with the
        poses that would be believed, a hint, and the codes of the sensors that it may be from."""
        rows, maze = self.sure, self._seen.spec.maze
        wide, high = maze.columns * CELL_SIZE, maze.rows * CELL_SIZE
        x, y, heading = rows["true_x"], rows["true_y"], rows["true_heading"]
        yield "mirrored left to right", (wide - x, y, 180.0 - heading), "", ()
        yield "mirrored top to bottom", (x, high - y, -heading), "", ()
        yield "in a maze turned by half a turn", (wide - x, high - y, heading + 180.0), "", ()
        yield "with x and y exchanged", (y, x, 90.0 - heading), "", ()
        east, north = rows["x"] - x, rows["y"] - y
        for frame, name, hint in (
            (np.zeros(len(rows)), "beside the truth", _WHOLE_CELLS),
            (heading, "(ahead, left) beside the truth in the robot's frame", ""),
        ):
            cos, sin = cos_sin_array(frame)
            off = median_of(cos * east + sin * north), median_of(cos * north - sin * east)
            if math.hypot(*off) >= _NEAR:
                where = f"({off[0]:+z.1f}, {off[1]:+z.1f}) in {name}"
                there = x + cos * off[0] - sin * off[1], y + sin * off[0] + cos * off[1]
                on_grid = math.hypot(*off) > CELL_SIZE / 2 and all(
                    abs(math.remainder(each, CELL_SIZE)) <= _NEAR for each in off
                )
                yield where, (*there, rows["heading"]), hint if on_grid else "", ()
        # Half a turn to either side is one: the mean direction.
        turn = math.degrees(np.angle(np.exp(1j * np.radians(rows["turn"])).mean()))
        if abs(turn) >= SLIGHT_TURN:
            poses = rows["x"], rows["y"], heading + turn
            yield f"turned by {turn:+.0f} deg", poses, "", self._compasses(read=True)

    def _compasses(self, *, read: bool) -> tuple[str, ...]:
        """Codes of the compasses of the set that were read, or that were not."""
        codes = [each.code for each in self._seen.spec.sensors if each.enabled and each.kind.is_heading]
        return tuple(code for code in codes if (code in self._seen.history.sensor_codes) is read)

    @property
    def unread_compass(self) -> str:
        """Code of a compass of the set that was never read; empty without one, or if another was read."""
        return "" if self._compasses(read=True) else next(iter(self._compasses(read=False)), "")

    @cached_property
    def steps(self) -> list[ErrorPattern]:
        """The devices that explain believed steps best; none where these are right. Steps with one constant
        error are right ones, seen from elsewhere."""
        if self.constant is not None or not self.has_truth:
            return []
        for found in step_patterns(self._seen):
            # A device that is wrong is the stronger explanation. Of many none is named.
            if 0 < len(found) <= _MOST_NAMED and not any(self._known.intersection(each.of) for each in found):
                return found
        return []

    @cached_property
    def parted(self) -> str:
        """The movements that arrived between the last right belief and the first lost one, and beside them
        how far robot and belief moved: a sentence with a space before it. Empty where nothing stands out."""
        lost, history = self._seen.beliefs[1], self._seen.history
        row = history.beliefs.before(lost.order) if lost is not None and self.has_truth else None
        if lost is None or row is None or not row.finite or row.elapsed == lost.elapsed:
            return ""
        # A belief that was not sure jumps where its readings lead it.
        if row.order < self.rows["order"][0] or row.spread > SURE:
            return ""
        moves = self._seen.within(history.movements)
        moves = moves[(moves["order"] > row.order) & (moves["order"] < lost.order) & ~moves["grips"]]
        came = Counter(
            history.code_names[code] + (f"-{asked:.6g}" if np.isfinite(asked) else "")
            for code, asked in zip(moves["code"].tolist(), moves["asked"].tolist(), strict=True)
        )
        robot, own = _displacement_text(row.true, lost.true), _displacement_text(row.believed, lost.believed)
        grew = math.hypot(
            lost.x - row.x - lost.true_x + row.true_x, lost.y - row.y - lost.true_y + row.true_y
        )
        # Of a belief that has jumped, or grown wrong in many steps, no movement tells. Judged: half of it.
        if grew < max(SLIGHT, lost.distance / 2) or len(came) > _MOST_NAMED or robot == own:
            return ""
        told = [name if count == 1 else f"{name} {times_text(count)}" for name, count in came.items()]
        sent, when = " and ".join(told) or "no movement", f"{row.elapsed:.1f} s and {lost.elapsed:.1f} s"
        return f" Between {when} it was sent {sent}; the robot moved {robot}, the belief {own}."

    @property
    def text(self) -> str:
        """A sentence about what stands behind a wrong belief; empty if nothing is known."""
        if self.constant is not None:
            return f"Its belief was {self.constant.text}."
        return f"Its steps fit {'; or '.join(each.text for each in self.steps)}." if self.steps else ""

    @property
    def culprits(self) -> tuple[str, ...]:
        """Codes of the devices behind it."""
        found = self.steps if self.constant is None else [self.constant]
        return tuple(code for each in found for code in each.of)


def has_read_range(seen: Attempt, order: int) -> bool:
    """True if a range was read before an event."""
    readings = seen.within(seen.history.readings)
    before = readings[readings["order"] < order]
    return any(sensor.kind.is_range for sensor, _ in by_sensor(seen.history, before))


def is_small(lost: BeliefRow) -> bool:
    """True if a wrong belief was off by less than a cell, and 12 degrees."""
    return max(lost.distance, abs(lost.turn)) < CELL_SIZE


def ranges_before(seen: Attempt, lost: BeliefRow) -> tuple[str, bool]:
    """The ranges of the last cell's length of path before a wrong belief, in this maze without its block: a
    sentence with a space before it, and True if some do not fit the believed place. Empty if they were not
    right, or are few."""
    history, world = seen.history, world_without_block(seen.spec)
    rows = seen.within(history.readings, seen.placed)
    rows = rows[(rows["order"] < lost.order) & (rows["gone"] >= lost.gone - CELL_SIZE)][-_RANGES:]
    count = rights = 0
    misfits: list[tuple[float, str]] = []
    for sensor, mine in by_sensor(history, rows):
        made = modelled_sensor(sensor)
        if not (sensor.kind.is_range and isinstance(made, ObservingSensor)):
            continue
        poses = (carried_over(lost.true, lost.believed, Pose(*each)) for each in poses_of(mine).tolist())
        expected = made.expected(world, np.array([astuple(each) for each in poses]), 0.0)
        allowed = np.maximum(SLIGHT, COVERED * sensor.error * np.abs(mine["true"]))
        right = np.abs(mine["error"]) <= allowed
        count, rights = count + len(mine), rights + int(right.sum())
        # Where nothing is in range, both may be infinite.
        fits = np.isclose(mine["value"], expected, rtol=0.0, atol=2.0 * allowed)
        for place in np.flatnonzero(right & ~fits):
            at, value = float(mine["elapsed"][place]), shown_range(float(mine["value"][place]))
            there = f"from there it would have read {shown_range(float(expected[place]))}"
            misfits.append((at, f"{sensor.code} read {value} at {at:.1f} s, and {there}"))
    if count < FEWEST["nominal"] or rights < _MOSTLY_RIGHT * count:
        return "", False
    share = "Its" if rights == count else f"{rights} of its"
    told = f" {share} last {counted(count, 'range')} before that were right"
    # A small error hardly shows in ranges.
    if is_small(lost):
        return f"{told}.", False
    if not misfits:
        return f"{told}, and fit that place as well.", False
    return f"{told}, and {len(misfits)} of them did not fit there: {max(misfits)[1]}.", True


def _displacement_text(first: Pose, second: Pose) -> str:
    """A displacement in the robot's frame at its beginning: `12.0 in to the left`."""
    far, turn = displacement(first, second)
    bearing = half_turn(math.degrees(math.atan2(second.y - first.y, second.x - first.x)) - first.heading)
    side = ("ahead", "to the left", "back", "to the right")[round(bearing / 90.0) % 4]
    moved = f"{far:.1f} in {side}" if round(far, 1) else "0 in"
    turned = f" and {abs(turn):.0f} deg to the {'left' if turn > 0.0 else 'right'}"
    return moved + turned if abs(turn) >= 1.0 else moved
