"""Causes of a contact that ended a run, by counterfactuals: its movement repeated, each with one change.

Those that hold come in this order:

    unread        the program had read no sensor for a good part of its path
    undecided     a reading in the log had shown the wall, and no belief explains the movement
    lost          its belief was wrong, and from its believed pose it would have passed
    unsure        it allowed for an error that was enough to touch, and drove on
    drive error   without noise and bias it would have passed with a margin
    held block    the block touched, and the robot alone would have passed
    misread       the sensor that looked there was far off
    clearance     with more room at the side, or from further off, it would have passed
    undecided     none of these changes would have saved it
"""

import math
from collections.abc import Iterator, Sequence

from simmer_tui.report.causes import Cause, Kind, LogMoment, Sureness, cause_of, contradicted, undecided_text
from simmer_tui.report.counterfactuals import Change, Counterfactual, CounterfactualWorld
from simmer_tui.report.right_readings import looked_at_each_movement, looks_alike, shown_place
from simmer_tui.report.why import facing_sensor_text, looks_there, shown_range
from simmer_tui.run.attempt import Attempt, Collision
from simmer_tui.run.facts import ALIKE, LastReading, carried_over, facing_sensor
from simmer_tui.run.history_rows import BeliefRow
from simmer_tui.run.phrases import (
    body_text,
    capitalized,
    contact_text,
    drift_text,
    obstacle_place,
    obstacle_text,
)
from simmer_tui.sim.angles import half_turn
from simmer_tui.sim.command import counted, parse_value
from simmer_tui.sim.specs import CELL_SIZE

NO_BELIEFS = "No beliefs were sent: the log cannot show where the program thought the robot was."
# Judged: after a third of a cell, or half a quarter turn, a sensor sees other obstacles.
BLIND, BLIND_TURN = 4.0, 45.0
"""Inches or degrees of path after which the last reading of a sensor counts as unread."""
STALE = CELL_SIZE
"""Inches of path after which a belief is too old."""
# Judged: an inch alone is a usual error of a long range; four standard deviations happen once in 16,000.
MISREAD, SIGMAS = 1.0, 4.0
"""A reading with an error above both, inches and standard deviations, is a misreading."""

# Judged: two thirds of the room that a robot 6 in wide has on either side in a cell of 12 in.
_INTO = 2.0
"""Inches asked for beyond a contact, from which the program must have believed the wall elsewhere."""
# Judged: errors of a drive and of a range are a few percent of a cell.
_INTO_SHOWN = 1.0
"""The same where a reading had shown the wall."""
_STOOD = 0.01
"""Inches and degrees below which the robot has not moved: corrections are larger."""


_DRIVE_ERRORS = frozenset((Change.NO_NOISE, Change.NO_BIAS, Change.EXACT))
# The values are names in files and stay as they are.
_SHOWN = {
    Change.BELIEVED: "from the pose that the program believed",
}


def contact_causes(seen: Attempt, met: Collision) -> list[Cause]:
    """The causes of a contact that hold, in the order above. No counterfactual that was tried contradicts
    them."""
    return [each for each in _ContactCauses(seen, met).all() if not contradicted(each.kind, each.tried)]


class _ContactCauses:
    """The candidates for the cause of one contact."""

    def __init__(self, seen: Attempt, met: Collision) -> None:
        self._seen = seen
        self._spec = seen.spec
        self._met = met
        belief = met.belief
        stale = belief is not None and met.row.gone_before - belief.gone > STALE
        self._belief = None if stale else belief
        self._wrong = self._belief is not None and self._belief.lost
        believed = None
        if self._belief is not None:
            # Of a velocity the last inches are repeated, of a movement the whole of it.
            start = met.legs[0].before if met.legs else met.ended.before
            believed = carried_over(self._belief.true, self._belief.believed, start)
        self._tried = tuple(CounterfactualWorld(seen.spec).tried(met, believed))
        self._saved = {each.change: each.saved for each in self._tried}
        self._shown = shown_place(seen, met)
        self._looked = looked_at_each_movement(seen, met)
        self._looks = facing_sensor(met.contact, seen.spec.sensors, met.readings)
        obstacle = obstacle_place(met.contact, seen.spec)
        self._into = f"{met.row.shown} led {body_text(met.contact)} into {obstacle}"
        self._hit = f"hit {obstacle} during {met.row.shown}"

    def all(self) -> Iterator[Cause]:
        """The candidates in order, whether contradicted or not."""
        believed = self._saved.get(Change.BELIEVED)
        is_exact_free = bool(self._saved.get(Change.EXACT))
        # After a turn another sensor may have looked where this one does now.
        seen = self._shown is not None and self._shown.ago <= BLIND
        blind = not self._met.contact.drift and not seen and self._is_blind()
        # No sensor looks at the room that a held block needs in a turn: without a wrong belief no reading is
        # missing.
        turned = self._met.contact.held_block and self._met.ended.trajectory.turning
        blind = blind and not (turned and (self._belief is None or self._knew))
        # Where the errors of this one movement were enough, a reading before it would not have helped.
        if is_exact_free and not (self._wrong and believed):
            yield self._drive_error()
        if blind:
            yield self._made(Kind.UNREAD, f"It drove without looking: {self._into}.", sure=Sureness.LIKELY)
        yield from self._against_readings()
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
        """Causes by a wrong or unsure belief."""
        belief, lost = self._belief, self._met.lost
        if belief is None:
            return
        # Where the believed pose is in a wall, the movement cannot be repeated from there.
        sure = Sureness.CERTAIN if believed else Sureness.LIKELY
        if self._wrong and lost is not None:
            text = f"It was lost. {wrong_text(self._seen, lost)}. Then {self._into}."
            yield self._made(Kind.LOST, text, at=lost, sure=sure)
        elif belief.unsure:
            text = f"It drove on without knowing where it was: {self._into}."
            yield self._made(Kind.UNSURE, text, sure=sure)
        elif believed:
            off = belief.deviation
            text = (
                f"Its belief was not exact enough for its path: off by {off.distance:.1f} in and "
                f"{abs(off.turn):.0f} deg, as its spread allowed. Then {self._into}."
            )
            yield self._made(Kind.UNSURE, text)

    def _seen_there(self) -> Iterator[Cause]:
        """Causes by the block that touched, and by the readings of the sensor that looks there."""
        if self._met.contact.held_block:
            knew = ", though its belief was right" if self._knew else ""
            yield self._made(Kind.HELD_BLOCK, f"The block it held {self._hit}{knew}.")
        last = self._facing
        if last is not None and self._is_off(last):
            read = f"{last.code} read {shown_range(last.value)} instead of {shown_range(last.true)}"
            text = f"A sensor misled it: {read}. Then {self._into}."
            yield self._made(Kind.MISREAD, text, sure=Sureness.LIKELY, culprits=(last.code,))

    def _against_readings(self) -> Iterator[Cause]:
        """A movement into a wall that its readings in the log had shown."""
        shown, far = self._shown, self._beyond > _INTO_SHOWN
        # With a right belief a program needs no readings to keep off a wall; only a wall straight ahead
        # counts.
        against = (far and self._asked_for_more) if self._knew else (far or self._asked_for_more)
        if shown is None or not against:
            return
        # A lost program drove by its belief, unless that would have led it into a wall as well.
        misled = self._wrong and self._saved.get(Change.BELIEVED) is not False
        if misled or self._saved.get(Change.UNSEEN) or self._saved.get(Change.NO_BIAS):
            return
        read = f"{shown.code} had read {shown_range(shown.value)} there at {shown.elapsed:.1f} s"
        yield self._apart(f"{read}, which was right")

    def _left_over(self) -> Iterator[Cause]:
        """Causes for a contact that nothing else explains."""
        # A program without beliefs that asks for far more than the room ahead did not just come too close.
        if self._belief is None and self._beyond > _INTO:
            yield self._undecided(self._facing)
        if self._saved.get(Change.ASIDE) or self._saved.get(Change.FURTHER_OFF):
            knew = "It knew where it was, and came" if self._knew else "It came"
            yield self._made(Kind.CLEARANCE, f"{knew} too close: {self._into}.")
        yield self._undecided(self._facing)

    @property
    def _beyond(self) -> float:
        """Distance that the movement was to go into the wall, inches."""
        totals = self._met.ended.trajectory.totals
        return math.hypot(totals.x, totals.y) - self._met.row.went

    @property
    def _asked_for_more(self) -> bool:
        """True if the command was to go further than a sensor had just read straight ahead of it."""
        met, last = self._met, self._facing
        kind, value = met.ended.trajectory.kind, parse_value(met.ended.command.argument)
        if last is None or kind is None or kind.turns or isinstance(value, str):
            return False
        # Readings keep their sums in single precision.
        gone, turned = met.row.gone_before - last.gone, met.row.turned_before - last.turned
        if max(gone, turned) > _STOOD:
            return False
        sensor = next(each for each in self._spec.sensors if each.code == last.code)
        towards = kind.bearing if value > 0 else kind.bearing + 180.0
        return abs(half_turn(sensor.rotation - towards)) <= ALIKE and abs(value) > last.value

    @property
    def _facing(self) -> LastReading | None:
        """The last reading of a sensor that looks at the place touched."""
        return None if self._looks is None or not looks_there(self._looks) else self._looks.last

    def _drive_error(self) -> Cause:
        text = (
            f"Drive errors caused the contact: {self._into}. Without noise and bias it would have touched "
            "nothing."
        )
        return self._made(Kind.DRIVE_ERROR, text, culprits=(self._met.ended.command.code,))

    def _accumulated(self) -> Iterator[Cause]:
        """Drive errors of the movements before. They are certain while nothing was read, since the program
        could not have seen them. A program that sends beliefs has taken them into account, rightly or
        wrongly."""
        met = self._met
        if self._belief is not None and not self._belief.unsure:
            return
        for change, count, sure in (
            (Change.UNSEEN, met.unseen, Sureness.CERTAIN),
            # A program that reads after each movement sees the effect of its errors, and uses that.
            *(() if self._looked else ((Change.LAST, len(met.before), Sureness.LIKELY),)),
        ):
            if self._saved.get(change):
                moved = [*met.before[len(met.before) - count :], met.ended]
                over = counted(len(moved), "movement")
                if met.legs:
                    begun = met.legs[-met.unseen_legs if change is Change.UNSEEN else 0].start_time
                    over = f"the last {met.contact.time - begun:.1f} s"
                text = (
                    f"Drive errors added up over {over}: {self._into}. Without them it would have touched "
                    "nothing."
                )
                codes = dict.fromkeys(each.command.code for each in moved)
                yield self._made(Kind.DRIVE_ERROR, text, sure=sure, culprits=tuple(codes))
                return

    def _undecided(self, last: LastReading | None) -> Cause:
        """A movement that no change would have saved: the program is the cause, or the link between it and
        the log."""
        if self._knew:
            known = "Its belief was right"
        elif last is not None:
            known = f"{last.code} had read {shown_range(last.value)}, which was right"
        else:
            known = "No reading and no belief explains it"
        return self._apart(known)

    def _apart(self, known: str) -> Cause:
        either = undecided_text("a command or reading was changed")
        obstacle = obstacle_text(self._met.contact)
        text = f"It drove straight at {obstacle}: {self._into}. {known}. {either}"
        return self._made(Kind.UNDECIDED, text, sure=Sureness.LIKELY)

    def _made(
        self,
        kind: Kind,
        text: str,
        *,
        at: LogMoment | None = None,
        sure: Sureness = Sureness.CERTAIN,
        culprits: tuple[str, ...] = (),
    ) -> Cause:
        row, contact = self._met.row, self._met.contact
        touched = capitalized(contact_text(contact, self._spec))
        evidence = (
            f"{touched} at {row.elapsed:.2f} s, {drift_text(contact)}.",
            belief_text(self._met.belief),
            self._again,
            facing_sensor_text(self._looks, row.elapsed),
            shown_tried(self._tried),
        )
        return cause_of(
            self._seen,
            kind,
            text,
            *evidence,
            at=at or row,
            place=contact.point,
            tried=self._tried,
            sure=sure,
            culprits=culprits,
        )

    @property
    def _again(self) -> str:
        """A sentence if the command was that before again, as after a retry."""
        met = self._met
        if not met.unseen or met.before[-1].command.text != met.ended.command.text:
            return ""
        return f"The same command came twice in a row, with nothing between: {met.row.shown}."

    def _is_blind(self) -> bool:
        """True if no range sensor had been read. A program that sends beliefs may have used any of them; for
        one that does not, only the sensor that looks at the wall counts."""
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
    """Error of a belief, and its spread as the program sent it."""
    if belief is None:
        return NO_BELIEFS
    spread = belief.spread
    said = "no spread was sent" if math.isnan(spread) else f"its spread was {spread:.1f} in"
    truth = f", and it gave the true cell {_share(belief.true_probability)}" if belief.is_grid else ""
    return f"The belief sent at {belief.elapsed:.1f} s was off by {belief.error_text}; {said}{truth}."


def wrong_text(seen: Attempt, belief: BeliefRow) -> str:
    """Time since which a belief was wrong, its error and its spread: a sentence without its full stop. Of a
    grid that gave the true cell hardly any probability, it says so, and if two cells look alike."""
    off, spread = belief.deviation, belief.spread
    if off.rejects_truth:
        alike = "; two cells look alike there" if looks_alike(seen, belief) else ""
        return (
            f"From {belief.elapsed:.1f} s on, it gave the true cell {_share(belief.true_probability)} and "
            f"another one, {off.distance:.1f} in off, the most{alike}"
        )
    parts = [
        f"{off.distance:.1f} in" if off.off_place else "",
        f"{abs(off.turn):.0f} deg" if off.off_heading else "",
    ]
    said = "" if math.isnan(spread) else f"; its spread was {spread:.1f} in"
    return f"From {belief.elapsed:.1f} s on, its belief was off by {' and '.join(filter(None, parts))}{said}"


def _share(probability: float) -> str:
    return "less than 1 %" if probability < 0.01 else f"{100 * probability:.0f} %"


def shown_tried(tried: Sequence[Counterfactual]) -> str:
    """Changes that would have saved a movement, and those that would not."""
    parts = []
    for saved, touched in ((True, "nothing"), (False, "something even")):
        changes = _changes_text([each.change for each in tried if each.saved is saved])
        if changes:
            parts.append(f"It would have touched {touched} {changes}.")
    return " ".join(parts)


def _changes_text(changes: Sequence[Change]) -> str:
    """Changes as one phrase, empty for none; noise, bias and both together are the errors of the drive."""
    words: list[str] = []
    if set(changes) >= _DRIVE_ERRORS:
        words = ["without errors of its drive"]
        changes = [each for each in changes if each not in _DRIVE_ERRORS]
    words += [_SHOWN.get(each, each.value) for each in changes]
    return "".join(words) if len(words) < 2 else f"{', '.join(words[:-1])} or {words[-1]}"


def _since(met: Collision, words: Sequence[LastReading]) -> float:
    """Path between the latest of some readings and a movement, as a share of the largest path that is not
    blind."""
    return min(
        (
            max((met.row.gone_before - each.gone) / BLIND, (met.row.turned_before - each.turned) / BLIND_TURN)
            for each in words
        ),
        default=math.inf,
    )
