"""Replies of range sensors against the readings that beliefs imply, and the change of replies that explains
them.

A filter moves to where its readings fit. Where a sure belief does not fit the readings in the log, readings
with one change may fit. A change is an offset, a gain, a delay, a stuck value, or the readings of another
sensor. A change explains a belief better or worse than the log does. Of all changes tried, the best one is
reported if far more beliefs are better than worse. It must also explain most readings, and the log less than
half as many.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from simmer_tui.report.belief_audit import SURE, following_beliefs
from simmer_tui.report.finding import FEWEST, Disagreement, FindingKind, moment
from simmer_tui.report.robust_fit import Z_95, binomial_tail, mad_scale
from simmer_tui.report.sensor_sample import LAGS, by_sensor, delayed, poses_of, world_without_block
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.table import Columns
from simmer_tui.sim.arrays import FloatArray, IntArray
from simmer_tui.sim.sensors import ObservingSensor, modelled_sensor

# Judged: up to half a cell; a larger offset would be a range to another wall.
_OFFSETS = tuple(sign * inches for inches in range(1, 7) for sign in (1.0, -1.0))
# Gains that are tried.
_GAINS = (0.5, 0.6, 0.7, 0.8, 0.9, 1.1, 1.2, 1.35, 1.5, 2.0)
_TOLERANCE, _SIGMAS = 0.75, 2.0
"""Tolerance of an explained reading: inches, and standard deviations of sensor and belief. Offsets are tried
in steps of an inch: half a step, and a quarter inch for the blur of a filter. Judged."""
_EXPLAINED, _LESS = 0.5, 0.5
"""Least share of readings that a change explains, and the most of it that the log may explain. Judged."""
_AS_GOOD = 0.9
"""Share of the readings explained by the best change, from which another change is as good. Judged."""
_BELIEFS = 1000
"""Most beliefs that are compared, the newest: a thousand are enough to show any change."""


@dataclass(frozen=True, slots=True)
class _Seen:
    """Readings of one sensor: the belief that followed each before any movement (-1: none that is sure), its
    value, and that belief's spread."""

    sensor: ObservingSensor
    belief: IntArray
    values: FloatArray
    spread: FloatArray

    def explained(self, used: FloatArray, implied: FloatArray) -> FloatArray:
        """1 where replies that were `used` fit those that a belief implies, 0 where not, NaN where it is not
        known."""
        there = np.isfinite(implied)
        noise = self.sensor.spec.error * np.where(there, implied, 0.0)
        tolerance = _TOLERANCE + _SIGMAS * np.hypot(noise, self.spread)
        with np.errstate(invalid="ignore"):
            fits = (np.abs(used - implied) <= tolerance) | (used == implied)
        unknown = (self.belief < 0) | np.isnan(implied) | np.isnan(used)
        return np.where(unknown, np.nan, fits)


@dataclass(frozen=True, slots=True)
class _Change:
    """A change of replies that was tried: its sensors, kind and value, and by sensor the readings that it
    explains, as `_Seen.explained` has it."""

    of: tuple[str, ...]
    kind: FindingKind
    value: float
    hits: dict[str, FloatArray]


class ReplyAudit:
    """The readings at sure beliefs."""

    def __init__(self, attempt: Attempt, since: int) -> None:
        """`since` is the running number of the event after which beliefs count."""
        history = attempt.history
        beliefs = attempt.within(history.beliefs, since)
        beliefs = beliefs[~(beliefs["spread"] > SURE)][-_BELIEFS:]
        self._beliefs = beliefs
        # The first belief depends on events before it.
        self._moved = attempt.within(history.movements, attempt.placed)["order"]
        readings = attempt.within(history.readings, attempt.placed)
        size = history.spec.block_size
        self._seen: dict[str, _Seen] = {}
        for spec, rows in by_sensor(history, readings):
            sensor = modelled_sensor(spec)
            if not isinstance(sensor, ObservingSensor) or not spec.kind.is_range or not len(beliefs):
                continue
            # The program need not know the block's place.
            if not sensor.sees_block(size):
                seen = self._of(rows, sensor)
                if (seen.belief >= 0).any():
                    self._seen[spec.code] = seen
        poses, world = poses_of(beliefs), world_without_block(history.spec)
        self._implied: dict[str, FloatArray] = {}
        """Readings that each belief implies, (beliefs,); infinite beyond the sensor's range."""
        for code, each in self._seen.items():
            expected = each.sensor.expected(world, poses, 0.0)
            self._implied[code] = np.where(expected > each.sensor.spec.max_range, np.inf, expected)
        self._base = {
            code: each.explained(each.values, self._of_beliefs(code, each))
            for code, each in self._seen.items()
        }

    def explanations(self) -> list[Disagreement]:
        """The changes that explain the beliefs about equally well, best first; none where the log does."""
        found = self._that_explain() if len(self._beliefs) >= FEWEST["set"] else []
        best = max((share for share, _, _ in found), default=0.0)
        near = sorted((each for each in found if each[0] >= _AS_GOOD * best), key=lambda each: -each[0])
        made: dict[tuple[str, ...], Disagreement] = {}
        for share, probability, change in near:
            if change.of not in made:
                made[change.of] = self._disagreement(change, share, probability)
        return list(made.values())

    def _that_explain(self) -> list[tuple[float, float, _Change]]:
        """The changes that explain most readings: the share, the p-value, and the change."""
        judged = sum(int(np.isfinite(each).sum()) for each in self._base.values())
        explained = sum(float(np.nansum(each)) for each in self._base.values())
        found: list[tuple[float, float, _Change]] = []
        simple = {code: list(self._simple(code)) for code in self._seen}
        for changes in (list(self._joint(simple)), list(self._single(simple))):
            for change in changes:
                differences = self._differences(change)
                gained = sum(float(each.sum()) for each in differences.values())
                share = (explained + gained) / judged
                if share < _EXPLAINED or explained / judged > _LESS * share:
                    continue
                better, worse = self._beliefs_changed(differences)
                # Half of the error is for changes of all sensors, which are few (weighted Bonferroni).
                probability = binomial_tail(better, better + worse, 0.5) * 2 * len(changes)
                if better >= FEWEST["set"]:
                    found.append((share, min(probability, 1.0), change))
        return found

    # -- readings and beliefs ------------------------------------------------------------------------

    def _of(self, rows: Columns, sensor: ObservingSensor) -> _Seen:
        belief = following_beliefs(rows, self._beliefs, self._moved)
        spread = np.nan_to_num(self._beliefs["spread"][belief])
        return _Seen(sensor, belief, rows["value"].astype(np.float64), spread)

    def _of_beliefs(self, code: str, seen: _Seen) -> FloatArray:
        """Readings of a sensor that beliefs imply, for each reading of another."""
        return np.where(seen.belief >= 0, self._implied[code][seen.belief], np.nan)

    def _differences(self, change: _Change) -> dict[str, FloatArray]:
        """By sensor: 1 where a change explains a reading and the log does not, -1 for the reverse."""
        made = {code: hits - self._base[code] for code, hits in change.hits.items()}
        return {code: np.nan_to_num(each) for code, each in made.items()}

    def _beliefs_changed(self, differences: dict[str, FloatArray]) -> tuple[int, int]:
        """Beliefs that a change explains better than the log does, and worse."""
        sums = np.zeros(len(self._beliefs))
        for code, each in differences.items():
            known = self._seen[code].belief >= 0
            np.add.at(sums, self._seen[code].belief[known], each[known])
        return int((sums > 0).sum()), int((sums < 0).sum())

    # -- changes ---------------------------------------------------------------------------------------

    def _joint(self, simple: Mapping[str, Sequence[_Change]]) -> Iterator[_Change]:
        """One change of all sensors."""
        codes = tuple(simple)
        if len(codes) > 1:
            for changes in zip(*simple.values(), strict=True):
                hits = {code: each.hits[code] for code, each in zip(codes, changes, strict=True)}
                yield _Change(codes, changes[0].kind, changes[0].value, hits)

    def _single(self, simple: Mapping[str, Sequence[_Change]]) -> Iterator[_Change]:
        """A change of one sensor, or two of them swapped."""
        for code, seen in self._seen.items():
            yield from simple[code]
            implied = self._of_beliefs(code, seen)
            there = implied[np.isfinite(implied)]
            if len(there):
                value = float(np.median(there))
                hits = seen.explained(np.full(len(seen.values), value), implied)
                yield _Change((code,), FindingKind.STUCK, value, {code: hits})
        for one, other in combinations(self._seen, 2):
            hits_of = {}
            for code, instead in ((one, other), (other, one)):
                seen = self._seen[code]
                hits_of[code] = seen.explained(seen.values, self._of_beliefs(instead, seen))
            yield _Change((one, other), FindingKind.SWAPPED, 1.0, hits_of)

    def _simple(self, code: str) -> Iterator[_Change]:
        """The changes that any sensor may have."""
        seen = self._seen[code]
        implied = self._of_beliefs(code, seen)
        changed = [(FindingKind.OFFSET, inches, seen.values + inches) for inches in _OFFSETS]
        changed += [(FindingKind.GAIN, gain, seen.values * gain) for gain in _GAINS]
        changed += [(FindingKind.LATE, float(lag), delayed(seen.values, lag)) for lag in LAGS]
        for kind, value, used in changed:
            yield _Change((code,), kind, value, {code: seen.explained(used, implied)})

    # -- text ------------------------------------------------------------------------------------------

    def _disagreement(self, change: _Change, share: float, probability: float) -> Disagreement:
        hits = np.concatenate([change.hits[code] for code in change.of])
        beliefs = np.concatenate([self._seen[code].belief for code in change.of])
        count, of = int(np.nansum(hits)), int(np.isfinite(hits).sum())
        first = self._beliefs[int(beliefs[hits == 1].min())]
        text = f"{self._as_taken(change)} ({count} of {of} readings)"
        # The unexplained share, at least a hundredth: one reading more or less makes no difference.
        return Disagreement(change.of, text, count, probability, max(1.0 - share, 0.01), *moment(first))

    def _as_taken(self, change: _Change) -> str:
        replies = f"the replies of {', '.join(change.of)}"
        match change.kind:
            case FindingKind.OFFSET:
                value, half = self._offset(change)
                far = "more" if value > 0 else "less"
                low, high = sorted((abs(value - half), abs(value + half)))
                return f"{abs(value):.1f} in {far} ({low:.1f} to {high:.1f}) than {replies}"
            case FindingKind.GAIN:
                return f"{change.value:.2f} times {replies}"
            case FindingKind.LATE:
                old = "a reading" if change.value == 1 else f"{change.value:.0f} readings"
                return f"{replies} {old} late"
            case FindingKind.STUCK:
                return f"{change.value:.1f} in for all {replies}"
            case _:
                return f"{replies} for each other's"

    def _offset(self, change: _Change) -> tuple[float, float]:
        """Median of the implied readings less those in the log, inches, and half of its 95 % interval."""
        off = np.concatenate(
            [
                (self._of_beliefs(code, self._seen[code]) - self._seen[code].values)[change.hits[code] == 1]
                for code in change.of
            ]
        )
        value = float(np.median(off))
        # The median of normal numbers has 1.253 times the standard error of their mean.
        return value, 1.253 * Z_95 * mad_scale(off - value) / len(off) ** 0.5
