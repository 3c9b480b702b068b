"""Causes of a contact that ended a run, by intervention: its movement is laid again, with one change a time.

Those that hold come in this order:

    unread        the program had not looked for a good part of its path
    lost          it was wrong about where it was, and from where it believed to be it would have passed
    unsure        it allowed for being wrong, and drove on though that was enough to touch
    drive error   the movement would have met nothing, by a fair margin, without noise and bias
    held block    it was what touched, and the robot alone would have passed
    misread       the sensor that looked there was far off
    clearance     with more room at the side, or from further off, it would have passed
    undecided     nothing of all this would have saved it
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from simmer_tui.phrases import body_text, capitalized, contact_text, drift_text, obstacle_place
from simmer_tui.report.causes import Cause, Kind, Sureness, without_blanks
from simmer_tui.report.counterfactuals import Change, Counterfactual, CounterfactualWorld, Deciding
from simmer_tui.report.why import facing_sensor_text, looks_there, shown_range
from simmer_tui.run.attempt import Attempt, Collision
from simmer_tui.run.facts import LastReading, carried_over, facing_sensor
from simmer_tui.run.history_rows import BeliefRow

NO_BELIEFS = "No beliefs were told, so nobody can say whether the program knew where the robot was."
# Judged: a third of a cell, or half a quarter turn, changes what stands before a sensor.
BLIND, BLIND_TURN = 4.0, 45.0
"""A sensor that was last read more than this ago, inches or degrees of path, was not looked at."""
# One cell of the maze.
STALE = 12.0
"""A belief told more than this many inches ago says nothing of now."""
# Judged: an inch alone is a usual error of a long range; four standard deviations happen once in 16,000.
MISREAD, SIGMAS = 1.0, 4.0
"""A reading off by more than so many inches and standard deviations was wrong."""


def contact_causes(seen: Attempt, met: Collision) -> list[Cause]:
    """The causes of a contact that hold, the most telling first. None of them is contradicted by what was
    tried."""
    return [each for each in _ContactCauses(seen, met).all() if not each.is_contradicted]


class _ContactCauses:
    """The candidates for the cause of one contact."""

    def __init__(self, seen: Attempt, met: Collision) -> None:
        self._spec = seen.spec
        self._met = met
        belief = met.belief
        stale = belief is not None and met.row.gone_before - belief.gone > STALE
        self._belief = None if stale else belief
        self._wrong = self._belief is not None and self._belief.lost
        believed = None
        if self._belief is not None:
            believed = carried_over(self._belief.true, self._belief.believed, met.ended.before)
        self._tried = tuple(
            CounterfactualWorld(seen.spec).tried(
                Deciding(
                    ended=met.ended,
                    before=met.before,
                    unseen=met.unseen,
                    bias=met.bias,
                    held=met.held,
                    lying=met.lying,
                    believed=believed,
                )
            )
        )
        self._saved = {each.change: each.saved for each in self._tried}
        self._looks = facing_sensor(met.contact, seen.spec.sensors, met.readings)
        obstacle = obstacle_place(met.contact, seen.spec)
        self._into = f"{met.row.shown} led {body_text(met.contact)} into {obstacle}"
        self._hit = f"hit {obstacle}, in {met.row.shown}"

    def all(self) -> Iterator[Cause]:
        """The candidates in order, whether contradicted or not."""
        believed = self._saved.get(Change.BELIEVED)
        is_exact_free = bool(self._saved.get(Change.EXACT))
        blind = not self._met.contact.drift and self._is_blind()
        # Where the errors of this one movement sufficed, looking before it would not have helped.
        if is_exact_free and not (self._wrong and believed):
            yield self._drive_error()
        if blind:
            yield self._made(Kind.UNREAD, f"It drove without looking: {self._into}.", sure=Sureness.LIKELY)
        yield from self._beliefs(believed)
        if is_exact_free and self._wrong and believed:
            yield self._drive_error()
        yield from self._seen_there()
        yield from self._accumulated()
        yield from self._left_over()

    @property
    def _knew(self) -> bool:
        return self._belief is not None and not self._wrong and not self._belief.unsure

    def _beliefs(self, believed: bool | None) -> Iterator[Cause]:
        """Being wrong about where it was, with or without knowing so."""
        belief, lost = self._belief, self._met.lost
        if belief is None:
            return
        # Where the believed place is in a wall, nothing can be laid from there.
        sure = Sureness.CERTAIN if believed else Sureness.LIKELY
        if self._wrong and lost is not None:
            made = self._made(Kind.LOST, f"It was lost: {wrong_text(lost)}, and {self._into}.", sure=sure)
            yield replace(made, elapsed=lost.elapsed, line=lost.line)
        elif belief.unsure:
            yield self._made(
                Kind.UNSURE, f"It drove on though it did not know where it was: {self._into}.", sure=sure
            )
        elif believed:
            off = belief.deviation
            text = (
                f"Its belief was too inexact for its path: off by {off.distance:.1f} in and "
                f"{abs(off.turn):.0f} deg, within what it allowed for, and {self._into}."
            )
            yield self._made(Kind.UNSURE, text)

    def _seen_there(self) -> Iterator[Cause]:
        """Causes by the block that touched, and by the readings of the sensor that looks there."""
        if self._met.contact.held_block:
            knew = ", though it knew where it was" if self._knew else ""
            yield self._made(Kind.HELD_BLOCK, f"The block it held {self._hit}{knew}.")
        last = self._facing
        if last is not None and self._is_off(last):
            text = f"A sensor misled it: {_misled(last)}, and {self._into}."
            yield self._made(Kind.MISREAD, text, sure=Sureness.LIKELY, culprits=(last.code,))

    def _left_over(self) -> Iterator[Cause]:
        """Causes for a contact that nothing else explains."""
        if self._saved.get(Change.ASIDE) or self._saved.get(Change.FURTHER_OFF):
            knew = "It knew where it was, and came" if self._knew else "It came"
            yield self._made(Kind.CLEARANCE, f"{knew} too close: {self._into}.")
        yield self._undecided(self._facing)

    @property
    def _facing(self) -> LastReading | None:
        """The last reading of a sensor that looks at the place touched."""
        return None if self._looks is None or not looks_there(self._looks) else self._looks.last

    def _drive_error(self) -> Cause:
        text = (
            f"Errors of its drive decided it: {self._into}, which it would have missed without noise and "
            "bias."
        )
        return self._made(Kind.DRIVE_ERROR, text, culprits=(self._met.ended.command.code,))

    def _accumulated(self) -> Iterator[Cause]:
        """Drive errors of the movements before: certain while nothing was read, since then the program could
        not have seen them. Whoever tells where it is has taken them into account, rightly or wrongly."""
        met = self._met
        if self._belief is not None and not self._belief.unsure:
            return
        for change, count, sure in (
            (Change.UNSEEN, met.unseen, Sureness.CERTAIN),
            (Change.LAST, len(met.before), Sureness.LIKELY),
        ):
            if self._saved.get(change):
                moved = [*met.before[len(met.before) - count :], met.ended]
                text = (
                    f"Errors of its drives added up over {len(moved)} movements: {self._into}, which it "
                    "would have missed without them."
                )
                codes = dict.fromkeys(each.command.code for each in moved)
                yield self._made(Kind.DRIVE_ERROR, text, sure=sure, culprits=tuple(codes))
                return

    def _undecided(self, last: LastReading | None) -> Cause:
        """A movement that nothing would have saved: the program, or what lies between it and the log."""
        code = self._met.ended.command.code
        if self._knew:
            known = "its belief was right"
        elif last is not None:
            known = f"{last.code} had read {shown_range(last.value)}, rightly"
        else:
            known = "nothing that it read or believed explains it"
        text = (
            f"It drove straight at the wall: {self._into}, and {known}. A mistake of the program and a "
            "command or reading changed on its way cannot be told apart."
        )
        return self._made(Kind.UNDECIDED, text, sure=Sureness.LIKELY, culprits=(code,))

    def _made(
        self, kind: Kind, text: str, *, sure: Sureness = Sureness.CERTAIN, culprits: tuple[str, ...] = ()
    ) -> Cause:
        met, contact = self._met, self._met.contact
        touched = contact_text(contact, self._spec)
        evidence = without_blanks(
            f"{capitalized(touched)} at {met.row.elapsed:.2f} s, {drift_text(contact)}.",
            belief_text(met.belief),
            facing_sensor_text(self._looks, met.row.elapsed),
            shown_tried(self._tried),
        )
        return Cause(
            kind, text, evidence, met.row.elapsed, met.row.line, contact.point, self._tried, sure, culprits
        )

    def _is_blind(self) -> bool:
        """True if nobody had looked. One that says where it is may have had it from any range sensor; of
        one that does not, the sensor that looks at the wall is asked for."""
        met, looks = self._met, self._looks
        if self._belief is None:
            words = [] if looks is None or looks.last is None else [looks.last]
            return looks_there(looks) and _since(met, words) > 1.0
        ranges = [each.code for each in self._spec.sensors if each.kind.is_range]
        words = [met.readings[code] for code in ranges if code in met.readings]
        return bool(ranges) and _since(met, words) > 1.0

    def _is_off(self, word: LastReading) -> bool:
        """True if a reading showed a wall much further away than it was."""
        sensor = next(each for each in self._spec.sensors if each.code == word.code)
        usual = sensor.error * word.true + sensor.absolute_error
        return word.value - word.true > max(MISREAD, SIGMAS * usual)


def belief_text(belief: BeliefRow | None) -> str:
    """Error of a belief, and what the program told of it."""
    if belief is None:
        return NO_BELIEFS
    off, spread = belief.deviation, belief.spread
    said = "without a spread" if math.isnan(spread) else f"with a spread of {spread:.1f} in"
    return (
        f"The belief told at {belief.elapsed:.1f} s was off by {off.distance:.1f} in and "
        f"{abs(off.turn):.0f} deg, {said}."
    )


def wrong_text(belief: BeliefRow) -> str:
    """Since when it was wrong, by how much, and how sure it was."""
    off, spread = belief.deviation, belief.spread
    parts = [
        f"{off.distance:.1f} in" if off.off_place else "",
        f"{abs(off.turn):.0f} deg" if off.off_heading else "",
    ]
    said = "" if math.isnan(spread) else f" and held itself sure to {spread:.1f} in"
    return f"from {belief.elapsed:.1f} s on it was wrong by {' and '.join(filter(None, parts))}{said}"


def shown_tried(tried: Sequence[Counterfactual]) -> str:
    """Changes that would have saved a movement, and those that would not."""
    saved = [each.change.value for each in tried if each.saved]
    not_saved = [each.change.value for each in tried if each.saved is False]
    parts = []
    if saved:
        parts.append(f"It would have met nothing {_listed(saved)}.")
    if not_saved:
        parts.append(f"It would have touched something even {_listed(not_saved)}.")
    return " ".join(parts)


def _since(met: Collision, words: Sequence[LastReading]) -> float:
    """Path between the latest of some readings and a movement, as a share of the most that may be."""
    return min(
        (
            max((met.row.gone_before - each.gone) / BLIND, (met.row.turned_before - each.turned) / BLIND_TURN)
            for each in words
        ),
        default=math.inf,
    )


def _misled(last: LastReading) -> str:
    return f"{last.code} said {shown_range(last.value)} where it was {shown_range(last.true)}"


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"
