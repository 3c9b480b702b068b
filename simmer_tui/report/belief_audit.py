"""Motion and heading that a program believed, against the log: which device explains the difference.

A program knows its motion from the replies of counters, or from its own commands. Where its believed pose
moves otherwise than the robot, a factor on a counter's replies or a drive's commands may explain it. Those
with the smallest residuals are named. A heading that is wrong from the first belief on is that of the
compass, if it was read there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from simmer_tui.report.finding import FEWEST, LEAST_DEGREES, Disagreement, moment
from simmer_tui.report.robust_fit import binomial_tail, mad_scale, robust_fit, two_sided
from simmer_tui.report.sensor_sample import by_sensor, poses_of, world_without_block
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.episodes import SAME_POSE
from simmer_tui.run.facts import COVERED, DEFAULT_ALLOWED_TURN, UNSURE
from simmer_tui.run.table import Columns
from simmer_tui.sim.angles import cos_sin_array, half_turn
from simmer_tui.sim.arrays import BoolArray, FloatArray, IntArray
from simmer_tui.sim.command import counted
from simmer_tui.sim.sensors import CountingSensor, ObservingSensor, modelled_sensor
from simmer_tui.sim.specs import CELL_SIZE

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
_MOVED_BY_NOTHING = 0.1
"""Share of beliefs that may move with nothing between: resampled particles, or a second filter. Judged."""
_LONGEST_TURN = 150.0
"""Turns above this, degrees, may have been believed to go in the other direction."""
_ASSUMED = 1.0
"""Spread, inches, of a first belief that no reading can have led to. Judged."""
_JUMP = 45.0
"""Least degrees of a jump: readings alone do not turn a sure heading by half of a right angle. Judged."""


@dataclass(frozen=True, slots=True)
class _Axis:
    """One kind of motion: how far the robot went between beliefs and how far the program believed, (n,).
    `least` is the shortest motion that counts, `correction` the usual size of corrections of a belief."""

    believed: FloatArray
    true: FloatArray
    usable: BoolArray
    least: float
    correction: float


@dataclass(frozen=True, slots=True)
class _Source:
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
            self._explained(turns, [*self._turn_counters(), *self._drives(turning=True)]),
            self._explained(distances, [*self._distance_counters(), *self._drives(turning=False)]),
        )
        return [each for each in made if each]

    def unlogged(self) -> list[Disagreement]:
        """The explanation of beliefs that move though the log has neither a movement nor a reading between
        them. Only a command that never reached the robot can have moved them. None where there are hardly
        any."""
        if len(self._beliefs) <= _FEWEST:
            return []
        read = np.diff(np.searchsorted(self._readings["order"], self._beliefs["order"])) > 0
        stood = np.diff(self._at) == 0
        gone, turned = self._believed_distance >= _DISTANCE, np.abs(self._turn) >= _TURN
        # A program that sends its next pose before the command is there one belief later.
        early = np.append(stood[1:], True) | np.append(gone[1:] | turned[1:], True)
        moved = stood & ~read & early & (gone | turned) & np.isfinite(self._believed_distance)
        if moved.sum() < _FEWEST:
            return []
        first = int(np.flatnonzero(moved)[0])
        # Counted from then on; the share before it is that of a program that agrees with its log.
        later = stood[first:] & ~read[first:]
        count, hits = int(later.sum()), int(moved[first:].sum())
        row = self._beliefs[first + 1]
        drives = [each.code for each in self._attempt.spec.drives if each.kind.turns and each.enabled]
        is_turn = bool((turned & ~gone)[moved].all())
        of = tuple(drives) if is_turn and len(drives) == 1 else ()
        text = (
            f"{hits} times the program believed that the robot had {'turned' if is_turn else 'moved'}, "
            f"with nothing read, but the log has no {of[0] if of else 'movement'}"
        )
        probability = binomial_tail(hits, count, _MOVED_BY_NOTHING)
        return [Disagreement(of, text, hits, probability, 1.0, *moment(row), command_lost=True)]

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
            text = f"the program used {value:.2f} times {source.code}'s {used} in the log ({figures})"
            # Smaller differences cannot be distinguished: poses are sent in hundredths.
            scatter, of = max(scatter, axis.correction / 20), (source.code,)
            found.append(Disagreement(of, text, fit.count, probability, scatter, *moment(begun)))
        return found

    # -- sources of known motion -----------------------------------------------------------------------

    def _turn_counters(self) -> list[_Source]:
        return [
            _Source(sensor.spec.code, counts / lever[2], False)
            for sensor, counts in self._counters()
            if (lever := sensor.lever)[2] and not lever[:2].any()
        ]

    def _distance_counters(self) -> list[_Source]:
        found = []
        for sensor, counts in self._counters():
            lever = sensor.lever
            with np.errstate(invalid="ignore", divide="ignore"):
                share = (lever[:2, None] * self._moved).sum(axis=0) / self._gone
                values = (counts - lever[2] * self._true_turn) / share
            # A wheel that hardly rolls does not measure the path.
            found.append(_Source(sensor.spec.code, np.where(np.abs(share) > 0.5, values, np.nan), False))
        return found

    def _counters(self) -> Iterator[tuple[CountingSensor, FloatArray]]:
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


def wrong_heading(attempt: Attempt) -> list[Disagreement]:
    """The explanation of a heading that was wrong from the first belief on, by a compass that was read there;
    none where it agrees."""
    history = attempt.history
    beliefs, moves = attempt.within(history.beliefs), attempt.within(history.movements)
    readings = attempt.within(history.readings)
    # Sure of a far place from the first belief on: the program assumed a start, without using readings.
    if len(beliefs) and beliefs["distance"][0] > CELL_SIZE and beliefs["spread"][0] < _ASSUMED:
        return []
    beliefs = beliefs[beliefs["allowed_turn"] <= _LONGEST_TURN / 2]
    found = []
    for spec, rows in by_sensor(history, readings):
        sensor, code = modelled_sensor(spec), spec.code
        if not isinstance(sensor, ObservingSensor) or not sensor.period or spec.kind.is_range:
            continue
        places = following_beliefs(rows, beliefs, moves["order"])
        rows, believed = rows[places >= 0], beliefs[places[places >= 0]]
        if len(rows) < _FEWEST:
            continue
        expected = sensor.expected(world_without_block(history.spec), poses_of(believed), 0.0)
        off = np.asarray(expected - rows["value"]) * 360.0 / sensor.period
        # The mean direction: half a turn to either side is one.
        value = float(np.degrees(np.angle(np.exp(1j * np.radians(off)).mean())))
        noise = np.hypot(spec.error * np.abs(rows["true"]), spec.absolute_error) + sensor.least_error
        allowed = float(np.median(believed["allowed_turn"]))
        # Beyond the error that the program allowed for, by the noise of a mean.
        beyond = (abs(value) - allowed) * len(rows) ** 0.5 / float(np.median(noise))
        turns = beliefs["turn"][beliefs["order"] >= believed["order"][0]]
        stays = np.abs(half_turn(turns - value)) <= np.maximum(DEFAULT_ALLOWED_TURN, allowed)
        if beyond <= 0.0 or stays.mean() < 0.5:
            continue
        more = f"{abs(value):.0f} {spec.unit} {'more' if value > 0 else 'less'}"
        text = f"the program used {more} than {code}'s replies in the log ({counted(len(rows), 'reading')})"
        found.append(Disagreement((code,), text, len(rows), two_sided(beyond), 1.0, *moment(believed[0])))
    return found


def heading_jump(attempt: Attempt) -> list[Disagreement]:
    """The explanations of a heading that was right and sure, and wrong and sure one movement later: what
    turned the robot then, and what was read of that. None without such a jump, or where it was soon right
    again.

    Counters that begin again at some angle do that, and signs that are wrong in one quadrant.
    """
    history = attempt.history
    beliefs, moves = attempt.within(history.beliefs, attempt.placed), attempt.within(history.movements)
    sure = (beliefs["allowed_turn"] <= DEFAULT_ALLOWED_TURN) & ~(beliefs["spread"] > UNSURE)
    off = np.abs(beliefs["turn"])
    jumps = np.flatnonzero((sure & (off <= beliefs["allowed_turn"]))[:-1] & (sure & (off >= _JUMP))[1:])
    if not len(jumps):
        return []
    before, after = beliefs[jumps[-1]], beliefs[jumps[-1] + 1]
    if np.mean(off[jumps[-1] + 1 :] >= _JUMP / 2) < 0.5:
        return []
    moves = moves[(moves["order"] > before["order"]) & (moves["order"] < after["order"])]
    names, turning = history.code_names, {each.code for each in attempt.spec.drives if each.kind.turns}
    turns = np.isin(moves["code"], [place for place, name in enumerate(names) if name in turning])
    moves = moves[turns | history.are_legs(moves)]
    # A turn by a person, one that a wall ended and one that was stopped (nothing is asked then) explain it.
    program = ~np.isin(moves["number"], attempt.typed) & ~moves["held"] & np.isfinite(moves["asked"])
    if len(moves) != 1 or not program[0]:
        return []
    drive, asked = names[int(moves["code"][0])], float(moves["asked"][0])
    turned = float(after["true_heading"] - before["true_heading"])
    believed = half_turn(float(after["heading"] - before["heading"]))
    differ = f"the robot turned by {turned:.0f} deg, and its belief by {believed:.0f} deg"
    texts = {drive: f"in {drive}-{asked:g} {differ}"}
    readings = attempt.within(history.readings, attempt.placed)
    for spec, mine in by_sensor(history, readings):
        last = np.searchsorted(mine["order"], (before["order"], after["order"])) - 1
        if spec.kind.unit == "deg" and not spec.kind.is_opaque and 0 <= last[0] < last[1]:
            first, second = (float(mine["value"][place]) for place in last)
            texts[spec.code] = f"{spec.code} went from {first:.0f} to {second:.0f} deg then"
    # A belief allows for so many spreads of its heading.
    probability = two_sided(COVERED * float(off[jumps[-1] + 1] / after["allowed_turn"]))
    return [Disagreement((code,), text, 1, probability, 1.0, *moment(after)) for code, text in texts.items()]


def following_beliefs(rows: Columns, beliefs: Columns, moves: IntArray) -> IntArray:
    """The place of the belief that followed each reading before any movement; -1 where there is none.

    Args:
        rows: Readings, (n,).
        beliefs: The beliefs.
        moves: Running numbers of the ends of movements.
    """
    places = np.searchsorted(beliefs["order"], rows["order"])
    # Readings after the last belief get a number beyond all of theirs.
    orders = np.append(beliefs["order"], np.iinfo(np.int32).max)
    here = np.searchsorted(moves, rows["order"]) == np.searchsorted(moves, orders[places])
    return np.where(here & (places < len(beliefs)), places, -1)


def _in_frame(beliefs: Columns, names: tuple[str, str, str], turns: FloatArray) -> FloatArray:
    """Displacements from pose to pose in the robot's frame halfway, (2, n): inches ahead and to the left."""
    x, y, heading = (beliefs[name] for name in names)
    cos, sin = cos_sin_array(heading[:-1] + turns / 2)
    ahead, aside = np.diff(x), np.diff(y)
    return np.array((cos * ahead + sin * aside, cos * aside - sin * ahead))
