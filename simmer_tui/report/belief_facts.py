"""Beliefs beside the truth: the share of sure ones, constant offsets, and what explains them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection
from functools import cached_property

import numpy as np
from msgspec import Struct
from msgspec.structs import astuple

from simmer_tui.report.belief_audit import SURE, BeliefMotion
from simmer_tui.report.finding import FEWEST, Disagreement, kept_disagreements
from simmer_tui.report.robust_fit import median_of
from simmer_tui.report.run_readings import by_sensor, poses_of, world_without_block
from simmer_tui.report.why import shown_range
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.belief_grid import SURELY_ELSEWHERE
from simmer_tui.run.facts import COVERED, SLIGHT, SLIGHT_TURN, UNSURE, UNSURE_TURN, carried_over, displacement
from simmer_tui.run.history_rows import BeliefRow
from simmer_tui.run.phrases import times_text
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.table import Columns
from simmer_tui.sim.angles import cos_sin_array, half_turn
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.command import counted
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.sensors import ObservingSensor, modelled_sensor
from simmer_tui.sim.specs import CELL_SIZE

_NEAR = 1.5
"""Inches around a constant offset within which a belief has it: half of a robot's width; judged."""
_CONSTANT = 0.75
"""Least share of sure beliefs with one error that make it constant. Judged."""
_MOST_NAMED = 4
_STOOD = 0.05
"""Inches below which a displacement is shown as 0."""
_MOSTLY = 0.5
"""Share of the error of the first wrong belief that movements before it explain. Judged."""
_MOSTLY_RIGHT = 0.9
"""Share of right ranges from which the ranges were right: one in a hundred is off by chance. Judged."""
_RANGES = 200
"""Most ranges that are compared with a believed place; each costs a ray."""
_LEAST = 2.0
"""Least constant offset, inches, that matters: a sixth of a cell."""
_ON_GRID = 1.0
"""Inches to a whole number of cells within which an offset is that of a map. Judged."""


class ConstantOffset(Struct, frozen=True):
    """One error that most sure beliefs have: `text` says it, `share` is their share; `of` are the codes of
    the sensors that it may be from."""

    text: str
    share: float
    of: tuple[str, ...] = ()


class BeliefFacts:
    """The beliefs of an attempt. A real robot has no truth: then only the share of sure ones is known."""

    def __init__(self, seen: Attempt, known: Collection[str] = ()) -> None:
        """`known` are codes of sensors and drives that are not as their set says: the stronger
        explanation."""
        self._seen = seen
        self._known = known
        rows = seen.within(seen.history.beliefs, max(seen.placed, seen.history.began))
        self.rows: Columns = rows[np.isfinite(rows["distance"]) & np.isfinite(rows["turn"])]
        unsure = (self.rows["spread"] > UNSURE) | (self.rows["allowed_turn"] > 3.0 * UNSURE_TURN)
        self.sure: Columns = self.rows[~unsure]
        self.has_truth = not seen.history.is_twin

    @cached_property
    def was_right(self) -> bool:
        """True if a sure belief was right."""
        rows, is_grid = self.sure, np.isfinite(self.sure["above"])
        heading = is_grid | (np.abs(rows["turn"]) <= rows["allowed_turn"])
        return bool(
            ((rows["distance"] <= rows["allowed"]) & heading & ~(rows["above"] > SURELY_ELSEWHERE)).any()
        )

    @cached_property
    def constant(self) -> ConstantOffset | None:
        """The one error that most sure beliefs have; None where they are right, differ, or are few."""
        rows = self.sure
        if not self.has_truth or len(rows) < FEWEST["set"] or 2 * len(rows) < len(self.rows):
            return None
        x, y = rows["x"] - rows["true_x"], rows["y"] - rows["true_y"]
        cos, sin = cos_sin_array(-rows["true_heading"])
        ahead, left = cos * x - sin * y, sin * x + cos * y
        # Of equal shares the first is kept: a shape explains place and heading.
        found = [
            *self._of_maze(),
            self._offset(x, y, "beside the truth"),
            self._offset(ahead, left, "(ahead, left) beside the truth in the robot's frame"),
            self._turned(),
        ]
        kept = [each for each in found if each is not None and each.share >= _CONSTANT]
        return max(kept, key=lambda each: each.share, default=None)

    def _offset(self, x: FloatArray, y: FloatArray, where: str) -> ConstantOffset | None:
        across, up = median_of(x), median_of(y)
        if np.hypot(across, up) < _LEAST:
            return None
        share = float((np.hypot(x - across, y - up) <= _NEAR).mean())
        text = f"({across:+z.1f}, {up:+z.1f}) in {where} in {100 * share:.0f} % of the sure beliefs"
        cells = np.array((across, up)) / CELL_SIZE
        is_map = bool((np.abs(cells - np.round(cells)) * CELL_SIZE <= _ON_GRID).all())
        if is_map and "frame" not in where:
            text += ", as with a map or a start that is whole cells off, or a place that looks alike"
        return ConstantOffset(text, share)

    def _turned(self) -> ConstantOffset | None:
        turns = self.sure["turn"].astype(np.float64)
        # Half a turn to either side is one: the mean direction first.
        value = float(np.degrees(np.angle(np.exp(1j * np.radians(turns)).mean())))
        if abs(value) < SLIGHT_TURN:
            return None
        share = float((np.abs(half_turn(turns - value)) <= SLIGHT_TURN).mean())
        text = f"turned by {value:+.0f} deg in {100 * share:.0f} % of the sure beliefs"
        return ConstantOffset(text, share, self._compasses(read=True))

    def _of_maze(self) -> list[ConstantOffset]:
        """Beliefs in a maze that is mirrored, or turned as a whole."""
        rows, maze = self.sure, self._seen.spec.maze
        wide, high = maze.columns * CELL_SIZE, maze.rows * CELL_SIZE
        x, y, heading = (rows[name].astype(np.float64) for name in ("true_x", "true_y", "true_heading"))
        shapes = {
            "mirrored left to right": (wide - x, y, 180.0 - heading),
            "mirrored top to bottom": (x, high - y, -heading),
            "in a maze turned by half a turn": (wide - x, high - y, heading + 180.0),
            "with x and y exchanged": (y, x, 90.0 - heading),
        }
        found = []
        for name, (there_x, there_y, there) in shapes.items():
            near = np.hypot(rows["x"] - there_x, rows["y"] - there_y) <= _NEAR
            # In the middle of a symmetric maze the place alone tells nothing.
            fits = near & (np.abs(half_turn(rows["heading"] - there)) <= SLIGHT_TURN)
            text = f"{name} in {100 * fits.mean():.0f} % of the sure beliefs"
            found.append(ConstantOffset(text, float(fits.mean())))
        return found

    def _compasses(self, *, read: bool) -> tuple[str, ...]:
        """Codes of the compasses of the set that were read, or that were not."""
        codes = [each.code for each in self._seen.spec.sensors if each.enabled and each.kind.is_heading]
        return tuple(code for code in codes if (code in self._seen.history.sensor_codes) is read)

    @property
    def unread_compass(self) -> str:
        """Code of a compass of the set that was never read; empty without one, or if another was read."""
        return "" if self._compasses(read=True) else next(iter(self._compasses(read=False)), "")

    @cached_property
    def steps(self) -> list[Disagreement]:
        """The devices that explain believed steps best; none where these are right."""
        if not self.has_truth:
            return []
        kept = kept_disagreements(BeliefMotion(self._seen, self._seen.placed).explanations())
        free = [each for each in kept if not any(code in self._known for one in each for code in one.of)]
        # More explanations than can be named name none.
        return free[0] if free and len(free[0]) <= _MOST_NAMED else []

    @cached_property
    def parted(self) -> str:
        """The movements that arrived between the last right belief and the first lost one, and beside them
        how far robot and belief moved: a sentence with a space before it. Empty where nothing stands out."""
        lost, history = self._seen.beliefs[1], self._seen.history
        if lost is None or not self.has_truth:
            return ""
        row = history.beliefs.before(lost.order)
        # A belief that was not sure jumps where its readings lead it.
        if row is None or row.order < self.rows["order"][0] or row.spread > SURE:
            return ""
        moves = self._seen.within(history.movements)
        moves = moves[(moves["order"] > row.order) & (moves["order"] < lost.order) & ~moves["grips"]]
        grew = math.hypot(
            lost.x - row.x - lost.true_x + row.true_x, lost.y - row.y - lost.true_y + row.true_y
        )
        # Of a belief that has jumped, or grown wrong in many steps, no movement tells.
        arrived = listed_movements(history, moves) if len(moves) else "no movement"
        robot, own = displacement_text(row.true, lost.true), displacement_text(row.believed, lost.believed)
        if not arrived or robot == own or grew < max(SLIGHT, _MOSTLY * lost.distance):
            return ""
        when = f"{row.elapsed:.1f} s and {lost.elapsed:.1f} s"
        return f" Between {when} it was sent {arrived}; the robot moved {robot}, the belief {own}."

    @property
    def text(self) -> str:
        """Sentences about what stands behind a wrong belief; empty if nothing is known."""
        constant = "" if self.constant is None else f"Its belief was {self.constant.text}."
        steps = "; or ".join(each.text for each in self.steps)
        return f"{constant} {f'Its steps fit {steps}.' if steps else ''}".strip()

    @property
    def culprits(self) -> tuple[str, ...]:
        """Codes of the devices behind it."""
        codes = [code for each in self.steps for code in each.of]
        if not codes and self.constant is not None:
            codes = list(self.constant.of)
        return tuple(dict.fromkeys(codes))


def has_read_range(seen: Attempt, order: int) -> bool:
    """True if a range was read before an event."""
    readings, codes = seen.within(seen.history.readings), seen.history.sensor_codes
    before = readings["sensor"][readings["order"] < order]
    ranges = {each.code for each in seen.spec.sensors if each.kind.is_range}
    return any(codes[number] in ranges for number in set(before.tolist()))


def listed_movements(history: RunHistory, moves: Columns) -> str:
    """Movements in their order, with their values, in words; empty for none, or for too many to name."""
    came = Counter(
        history.code_names[code] + (f"-{asked:.6g}" if np.isfinite(asked) else "")
        for code, asked in zip(moves["code"].tolist(), moves["asked"].tolist(), strict=True)
    )
    if len(came) > _MOST_NAMED:
        return ""
    return " and ".join(name if count == 1 else f"{name} {times_text(count)}" for name, count in came.items())


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
    off: list[tuple[float, str, float, float]] = []
    for sensor, mine in by_sensor(history, rows):
        made = modelled_sensor(sensor)
        if not sensor.kind.is_range or not isinstance(made, ObservingSensor) or not len(mine):
            continue
        poses = [Pose(*each) for each in poses_of(mine).tolist()]
        there = np.array([astuple(carried_over(lost.true, lost.believed, each)) for each in poses])
        expected, values = made.expected(world, there, 0.0), mine["value"].astype(np.float64)
        allowed = np.maximum(SLIGHT, COVERED * sensor.error * np.abs(mine["true"]))
        right = np.abs(mine["error"]) <= allowed
        with np.errstate(invalid="ignore"):
            fits = (np.abs(values - expected) <= 2.0 * allowed) | (values == expected)
        count += len(mine)
        rights += int(right.sum())
        for place in np.flatnonzero(right & ~fits):
            at = float(mine["elapsed"][place])
            off.append((at, sensor.code, float(values[place]), float(expected[place])))
    if count < FEWEST["nominal"] or rights < _MOSTLY_RIGHT * count:
        return "", False
    share = "Its" if rights == count else f"{rights} of its"
    told = f" {share} last {counted(count, 'range')} before that were right"
    # A small error hardly shows in ranges.
    if is_small(lost):
        return f"{told}.", False
    if not off:
        return f"{told}, and fit that place as well.", False
    at, code, value, other = max(off)
    read = f"{code} read {shown_range(value)} at {at:.1f} s, and from there it would have read"
    misfits = f"{len(off)} of them {'does' if len(off) == 1 else 'do'} not fit"
    none = "none of them fits" if len(off) == rights else misfits
    return f"{told}, and {none} there: {read} {shown_range(other)}.", True


def displacement_text(first: Pose, second: Pose) -> str:
    """A displacement in the robot's frame at its beginning: `12.0 in to the left`."""
    far, turn = displacement(first, second)
    bearing = half_turn(math.degrees(math.atan2(second.y - first.y, second.x - first.x)) - first.heading)
    side = ("ahead", "to the left", "back", "to the right")[round(bearing / 90.0) % 4]
    moved = "0 in" if far < _STOOD else f"{far:.1f} in {side}"
    if abs(turn) < 1.0:
        return moved
    return f"{moved} and {abs(turn):.0f} deg to the {'left' if turn > 0.0 else 'right'}"
