"""Motion that a program believed, against the truth: which device explains the difference.

A program knows its motion from the replies of counters, or from its own commands. Where its believed pose
moves otherwise than the robot, a factor on a counter's replies or a drive's commands may explain it. Those
with the smallest residuals are named.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from msgspec import Struct

from simmer_tui.report.finding import FEWEST, LEAST_DEGREES, Disagreement, moment
from simmer_tui.report.robust_fit import binomial_tail, mad_scale, robust_fit
from simmer_tui.report.run_readings import by_sensor
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.episodes import SAME_POSE
from simmer_tui.run.facts import DEFAULT_ALLOWED_TURN
from simmer_tui.run.table import Columns
from simmer_tui.sim.angles import cos_sin_array, half_turn
from simmer_tui.sim.arrays import BoolArray, FloatArray
from simmer_tui.sim.sensors import CountingSensor, modelled_sensor

SURE = 1.5
"""Largest spread, inches, at which a mean pose still predicts single readings: half of a robot's width;
judged."""
_FEWEST = FEWEST["set"]
# Judged: a filter corrects its belief by a few percent of the path.
_LEAST_SHARE = 0.05
"""Least difference of a factor from 1 that matters."""
_EXPLAINED = 0.7
"""Least share of movements that a factor must explain; the others are corrections. Judged."""
_DISTANCE, _TURN = 1.0, 5.0
"""Shortest path and turn that count, inches and degrees: corrections are smaller."""
_LONGEST_TURN = 150.0
"""Turns above this, degrees, may have been believed to go in the other direction."""


class _Axis(Struct, frozen=True):
    """One kind of motion: how far the robot went between beliefs and how far the program believed, (n,).
    `least` is the shortest motion that counts, `correction` the usual size of corrections of a belief."""

    believed: FloatArray
    true: FloatArray
    usable: BoolArray
    least: float
    correction: float


class _Source(Struct, frozen=True):
    """A source from which a program may know the motion of an axis: (n,), NaN where it has none."""

    code: str
    values: FloatArray
    is_drive: bool


class BeliefMotion:
    """The motion from each belief to the next."""

    def __init__(self, attempt: Attempt, since: int) -> None:
        """`since` is the running number of the event after which beliefs count; the robot must not be placed
        after it."""
        self._attempt = attempt
        history = attempt.history
        self._beliefs = beliefs = attempt.within(history.beliefs, since)
        # The first belief depends on events before it.
        self._moves = attempt.within(history.movements, attempt.placed)
        self._readings = attempt.within(history.readings, attempt.placed)
        self._at = np.searchsorted(self._moves["order"], beliefs["order"])
        """Number of movements before each belief."""
        turn, true_turn = np.diff(beliefs["heading"]), np.diff(beliefs["true_heading"])
        self._turn = half_turn(turn)
        self._true_turn = true_turn
        believed = _in_frame(beliefs, ("x", "y", "heading"), self._turn)
        self._believed_distance = np.hypot(*believed)
        self._same = (np.abs(np.vstack((believed, self._turn))) < SAME_POSE).all(axis=0)
        """True where the same pose was sent again: it does not depend on readings or commands."""
        self._moved = _in_frame(beliefs, ("true_x", "true_y", "true_heading"), true_turn)
        self._gone = np.hypot(*self._moved)
        with np.errstate(invalid="ignore", divide="ignore"):
            self._along = (believed * self._moved).sum(axis=0) / self._gone

    def explanations(self) -> list[list[Disagreement]]:
        """For turns and for distances, the sensors and drives that explain a difference; none without one."""
        if len(self._beliefs) <= _FEWEST:
            return []
        sure = self._beliefs["allowed_turn"] <= DEFAULT_ALLOWED_TURN
        near = np.nan_to_num(self._beliefs["spread"]) <= SURE
        usable = sure[1:] & sure[:-1]
        in_half = np.abs(self._true_turn) <= _LONGEST_TURN
        turns = _Axis(self._turn, self._true_turn, usable & in_half, _TURN, LEAST_DEGREES)
        distances = _Axis(self._along, self._gone, usable & near[1:] & near[:-1], _DISTANCE, 0.5)
        made = (
            self._explained(turns, [*self._counters(turning=True), *self._drives(turning=True)]),
            self._explained(distances, [*self._counters(turning=False), *self._drives(turning=False)]),
        )
        return [each for each in made if each]

    def _explained(self, axis: _Axis, sources: list[_Source]) -> list[Disagreement]:
        usable = axis.usable & ~self._same & np.isfinite(axis.believed)
        places = np.flatnonzero(usable & (np.abs(axis.true) >= axis.least))
        if len(places) < _FEWEST:
            return []
        believed, true = axis.believed[places], axis.true[places]
        spread = axis.correction / 2 + 0.02 * np.abs(true)
        factor = float(robust_fit(true[:, None], believed, spread).values[0])
        apart = np.abs((factor - 1.0) * true) > axis.correction
        near = np.abs(believed - factor * true) < np.abs(believed - true)
        fits = np.abs(believed - factor * true) <= 4 * spread
        if abs(factor - 1.0) < _LEAST_SHARE or apart.sum() < _FEWEST or fits[apart].mean() < _EXPLAINED:
            return []
        probability = binomial_tail(int(near[apart].sum()), int(apart.sum()), 0.5)
        begun = self._beliefs[int(places[np.flatnonzero(apart & near)[0]])]
        found = []
        for source in sources:
            values = source.values[places]
            known = np.isfinite(values)
            if known.sum() < max(_FEWEST, len(places) / 2):
                continue
            fit = robust_fit(values[known][:, None], believed[known], spread[known])
            scatter = mad_scale(believed[known] - fit.values[0] * values[known])
            low, high = fit.interval(0)
            value = float(fit.values[0])
            figures = f"{low:.2f} to {high:.2f}, {fit.count} movements"
            used = "commands" if source.is_drive else "replies"
            text = f"{value:.2f} times {source.code}'s {used} ({figures})"
            # Smaller differences cannot be distinguished: poses are sent in hundredths.
            scatter, of = max(scatter, axis.correction / 20), (source.code,)
            found.append(Disagreement(of, text, fit.count, probability, scatter, *moment(begun)))
        return found

    # -- sources of known motion -----------------------------------------------------------------------

    def _counters(self, *, turning: bool) -> list[_Source]:
        """The counters that measure turns, or distances."""
        found = []
        for sensor, counts in self._counts():
            lever = sensor.lever
            with np.errstate(invalid="ignore", divide="ignore"):
                share = (lever[:2, None] * self._moved).sum(axis=0) / self._gone
                # A wheel that hardly rolls does not measure the path.
                along = np.where(np.abs(share) > 0.5, (counts - lever[2] * self._true_turn) / share, np.nan)
            if not turning:
                found.append(_Source(sensor.spec.code, along, False))
            elif lever[2] and not lever[:2].any():
                found.append(_Source(sensor.spec.code, counts / lever[2], False))
        return found

    def _counts(self) -> Iterator[tuple[CountingSensor, FloatArray]]:
        """The counters, each with its counts from belief to belief before its gain."""
        for spec, rows in by_sensor(self._attempt.history, self._readings):
            sensor = modelled_sensor(spec)
            if isinstance(sensor, CountingSensor) and spec.gain and not spec.wrap:
                yield sensor, self._counted(rows) / spec.gain

    def _counted(self, mine: Columns) -> FloatArray:
        """Counts of a sensor from belief to belief, in its unit, NaN where it was not read at both; (n,)."""
        beliefs = self._beliefs
        place = np.searchsorted(mine["order"], beliefs["order"]) - 1
        if not len(mine):
            return np.full(len(beliefs) - 1, np.nan)
        last = mine[np.maximum(place, 0)]
        # Read after the last movement before the belief.
        fresh = (place >= 0) & (np.searchsorted(self._moves["order"], last["order"]) == self._at)
        return np.diff(np.where(fresh, last["value"], np.nan))

    def _drives(self, *, turning: bool) -> list[_Source]:
        names, moves = self._attempt.history.code_names, self._moves
        drives = [
            each for each in self._attempt.spec.drives if each.kind.turns is turning and each.code in names
        ]
        numbers = {each.code: names.index(each.code) for each in drives}
        of_kind = np.isin(moves["code"], list(numbers.values()))
        found = []
        for row in drives:
            mine = moves["code"] == numbers[row.code]
            asked = np.where(mine, np.nan_to_num(moves["asked"], nan=np.nan) * row.gain, 0.0)
            rivals = of_kind & ~mine
            sums = np.concatenate(((0.0,), np.cumsum(asked)))
            others = np.concatenate(((0,), np.cumsum(rivals)))
            amounts = np.diff(sums[self._at])
            # The only drive on its axis; otherwise the motion cannot be assigned to one.
            alone = (np.diff(others[self._at]) == 0) & (amounts != 0.0)
            used = amounts if turning else np.abs(amounts)
            found.append(_Source(row.code, np.where(alone, used, np.nan), True))
        return found


def _in_frame(beliefs: Columns, names: tuple[str, str, str], turns: FloatArray) -> FloatArray:
    """Displacements from pose to pose in the robot's frame halfway, (2, n): inches ahead and to the left."""
    x, y, heading = (beliefs[name] for name in names)
    cos, sin = cos_sin_array(heading[:-1] + turns / 2)
    ahead, aside = np.diff(x), np.diff(y)
    return np.array((cos * ahead + sin * aside, cos * aside - sin * ahead))
