"""Why a run failed: one sentence that a person would say, what speaks for it, and the moment.

What is asked first is how the run ended: by a contact, by its time, or with its program. A contact then
is laid to the first of these that holds:

    unread        the program had not looked for a good part of its way
    lost          it was wrong about where it was, by more than it allowed for
    unsure        it said itself that it did not know where it was
    held block    it was what touched
    misread       it never said where it was, and the sensor that looked there was far off
    drive error   the movement would have met nothing, by a fair margin, without noise and bias
    clearance     it would have been too close all the same
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from simmer_tui.phrases import (
    body_text,
    contact_text,
    drift_text,
    miss_text,
    obstacle_place,
    outside_text,
    place_text,
    times_text,
)
from simmer_tui.report.counterfactuals import Change, Counterfactual, Ground
from simmer_tui.report.why import looks_there, shown_lookout, shown_range
from simmer_tui.run.attempt import Attempt, Collision
from simmer_tui.run.facts import FacingSensor, LastReading, carried_over, facing_sensor, missed_zone
from simmer_tui.run.history_rows import BeliefRow
from simmer_tui.run.run_history import STUCK
from simmer_tui.sim.command import escape

NO_BELIEFS = "No beliefs were told, so nobody can say whether the program knew where the robot was."
# Judged: a third of a cell, or half a quarter turn, changes what stands before a sensor.
BLIND, BLIND_TURN = 4.0, 45.0
"""A sensor that was last read more than this ago, inches or degrees of way, was not looked at."""
# One cell of the maze.
STALE = 12.0
"""A belief told more than this many inches ago says nothing of now."""
# Judged: an inch alone is a usual error of a long range; four standard deviations happen once in 16,000.
MISREAD, SIGMAS = 1.0, 4.0
"""A reading off by more than so many inches and standard deviations was wrong."""
# Judged: a good program crosses the maze with fewer movements.
STAYED, MOVES = 0.25, 20
"""So large a share of the time limit, with so many movements around one place, gains nothing."""
_EXIT_CODE = re.compile(r"exit code (-?\d+)")
# Python's and the shell's words for an uncaught error; exit code 1 alone may be the program's own.
_CRASH = re.compile(
    r"^(?:[\w.]+\.)?\w*(?:Error|Exception|Interrupt|Exit)\b|Traceback|Segmentation fault|^error:"
)


class Kind(StrEnum):
    """Kinds of causes."""

    LOST = "lost"
    UNSURE = "unsure"
    CLEARANCE = "clearance"
    DRIVE_ERROR = "drive error"
    HELD_BLOCK = "held block"
    MISSED_GRIP = "missed grip"
    DROPPED_OUTSIDE = "dropped outside"
    MISREAD = "sensor misread"
    UNREAD = "sensor unread"
    STUCK = "stuck"
    TOO_SLOW = "too slow"
    CRASHED = "program crashed"
    ENDED = "program ended"
    NOTHING_SENT = "nothing sent"

    @property
    def advice(self) -> str:
        """Thing to look at first."""
        return _ADVICE[self]


_ADVICE = {
    Kind.LOST: "how it keeps track of where it is",
    Kind.UNSURE: "that it finds out where it is before it drives on",
    Kind.CLEARANCE: "how much room its way leaves to the walls",
    Kind.DRIVE_ERROR: "shorter movements with a look between them, and what it knows of its drives' bias",
    Kind.HELD_BLOCK: "the room that the held block needs, above all in turns",
    Kind.MISSED_GRIP: "where it stands when it closes the gripper",
    Kind.DROPPED_OUTSIDE: "where it opens the gripper",
    Kind.MISREAD: "that it takes no single reading for the truth",
    Kind.UNREAD: "that it looks before it drives",
    Kind.STUCK: "what it does when a movement gains nothing",
    Kind.TOO_SLOW: "what takes its time",
    Kind.CRASHED: "the error that ends the program",
    Kind.ENDED: "when the program gives up",
    Kind.NOTHING_SENT: "how the program finds its simulator",
}


class Sureness(StrEnum):
    """Sureness of a cause: what needs the program's own decisions cannot be known from a log."""

    CERTAIN = "certain"
    LIKELY = "likely"


@dataclass(frozen=True, slots=True)
class Cause:
    """Why a run failed: `text` is one sentence, `evidence` what speaks for it. `elapsed` (seconds) and
    `line` (of the log; 0 if there is none) say when, `place` where (inches). `culprits` are the codes of the
    sensors and drives to blame."""

    kind: Kind
    text: str
    evidence: tuple[str, ...]
    elapsed: float
    line: int
    place: tuple[float, float]
    tried: tuple[Counterfactual, ...] = ()
    sure: Sureness = Sureness.CERTAIN
    culprits: tuple[str, ...] = ()


def cause_of(
    attempt: Attempt, exit_code: int | None = None, last_words: str = "", *, cut_off: bool = False
) -> Cause | None:
    """Why a run failed; None if it did not, as far as can be seen. `exit_code` and `last_words` are its
    program's, where they are known; `cut_off` tells that it was ended because real time was up."""
    over = attempt.over
    if over is not None and exit_code is None and (found := _EXIT_CODE.search(over.event.reason)):
        exit_code = int(found[1])
    if over is None and attempt.task is not None and exit_code is None and not cut_off:
        return None  # a mission under way
    if over is not None and not attempt.failed:
        return None
    return _Causes(attempt, exit_code, escape(last_words, 200), cut_off).find()


class _Causes:
    """The search for the one cause."""

    def __init__(self, attempt: Attempt, exit_code: int | None, last_words: str, cut_off: bool) -> None:
        self._seen = attempt
        self._exit_code = exit_code
        self._last_words = last_words
        self._cut_off = cut_off

    def find(self) -> Cause | None:
        seen = self._seen
        # A contact that ended the mission is the cause even if the program crashed over it afterwards.
        if seen.collision is not None and seen.too_many_contacts:
            return self._contact(seen.collision)
        return (
            self._crash()
            or self._silence()
            or self._put_down()
            or self._missed()
            or self._blocked()
            or self._stayed()
            or self._slow()
            or self._astray()
            or self._ended()
        )

    def _made(self, kind: Kind, text: str, *evidence: str, elapsed: float | None = None) -> Cause:
        """A cause at the run's end, or at a moment before."""
        seen = self._seen
        where = (seen.dwell.place.x, seen.dwell.place.y)
        shown = tuple(each for each in evidence if each)
        when = seen.elapsed if elapsed is None else elapsed
        return Cause(kind, text, shown, when, seen.line, where)

    # -- ends without a contact ------------------------------------------------------------------

    def _crash(self) -> Cause | None:
        code = self._exit_code
        # Shells report a signal as 128 and its number, Python as a negative number.
        died = code is not None and (code < 0 or code > 128)
        if not died and not (code and _CRASH.search(self._last_words)):
            return None
        words = f": {self._last_words}" if self._last_words else ""
        return self._made(Kind.CRASHED, f"The program crashed with exit code {code}{words}.", self._goals())

    def _silence(self) -> Cause | None:
        if self._seen.commands:
            return None
        if self._seen.task is None and self._exit_code is None and not self._cut_off:
            return None
        said = f"Its last words: {self._last_words}." if self._last_words else ""
        return self._made(Kind.NOTHING_SENT, "The program sent no command at all.", said)

    def _put_down(self) -> Cause | None:
        seen, done = self._seen, self._seen.put_down
        if seen.task is None or done is None:
            return None
        block, zone = done.grip.block, seen.task.zone
        where = place_text(block.x, block.y)
        if zone is None:
            text = f"It set the block down at {where}, which is not in the drop zone."
        else:
            off = outside_text(missed_zone(zone, block.x, block.y))
            text = (
                f"It set the block down outside the drop zone: at {where}, {off} the cell around "
                f"{place_text(zone.x, zone.y)}."
            )
        made = self._made(Kind.DROPPED_OUTSIDE, text, self._belief(seen.beliefs[0]), elapsed=done.elapsed)
        return Cause(made.kind, made.text, made.evidence, made.elapsed, done.line, (block.x, block.y))

    def _missed(self) -> Cause | None:
        seen, misses = self._seen, self._seen.misses
        if seen.task is None or not misses or seen.taken:
            return None
        done = misses[-1]
        missed = done.grip.missed
        how = f": {miss_text(missed)}" if missed is not None else ""
        text = f"The gripper closed on nothing {times_text(len(misses))}; the last time{how}."
        if len(misses) == 1:
            text = f"The gripper closed on nothing{how}."
        made = self._made(Kind.MISSED_GRIP, text, self._belief(seen.beliefs[0]), elapsed=done.elapsed)
        block = done.grip.block
        return Cause(made.kind, made.text, made.evidence, made.elapsed, done.line, (block.x, block.y))

    def _blocked(self) -> Cause | None:
        seen = self._seen
        count, since = seen.blocked
        if count < STUCK or seen.collision is None:
            return None
        pose = seen.collision.row.pose
        return self._made(
            Kind.STUCK,
            f"It was stuck: from {since:.1f} s on {count} movements in a row were "
            f"stopped by a wall at {place_text(pose.x, pose.y)}.",
            elapsed=since,
        )

    def _stayed(self) -> Cause | None:
        seen, stay, task = self._seen, self._seen.dwell, self._seen.task
        if task is None or not seen.out_of_time or stay.movements < MOVES:
            return None
        # One that stands and reads is slow, not stuck: half of the time must have been driving.
        lasted = seen.elapsed - stay.since
        if lasted < STAYED * task.time_limit or stay.driving < lasted / 2:
            return None
        return self._made(
            Kind.STUCK,
            f"It got nowhere: from {stay.since:.1f} s on it made {stay.movements} movements, "
            f"{stay.driven:.0f} in in all, around {place_text(stay.place.x, stay.place.y)}.",
            self._goals(),
            elapsed=stay.since,
        )

    def _slow(self) -> Cause | None:
        seen, spent = self._seen, self._seen.spent
        if not (seen.out_of_time or self._cut_off):
            return None
        rest = max(seen.elapsed - seen.begun - spent.driving - spent.reading - spent.link, 0.0)
        parts = {"driving": spent.driving, "reading": spent.reading, "the link": spent.link, "waiting": rest}
        most = max(parts, key=lambda name: parts[name])
        count = spent.readings.total()
        code, often = next(iter(spent.readings.most_common(1)), ("", 0))
        readings = f"It read {count} times, {code} alone {often} times." if count else "It read no sensor."
        if self._cut_off and not seen.out_of_time:
            return self._made(
                Kind.TOO_SLOW,
                "It was too slow: real time was up, and the program was still at it.",
                f"Most of the {seen.elapsed:.1f} simulated seconds went to {most}.",
                readings,
                self._goals(),
            )
        listed = ", ".join(f"{name} {time:.1f} s" for name, time in parts.items() if time >= 0.05)
        return self._made(
            Kind.TOO_SLOW,
            f"It was too slow: most of its time went to {most} ({listed}).",
            readings,
            f"Besides, {spent.between:.1f} s of real time passed between its commands."
            if spent.between
            else "",
            self._goals(),
        )

    def _astray(self) -> Cause | None:
        """A program that gave up because it no longer knew where it was."""
        seen = self._seen
        belief, lost = seen.beliefs
        if seen.task is None or belief is None:
            return None
        gone, turned = seen.blind_for
        words = f" (its last words: {self._last_words})" if self._last_words else ""
        if gone > BLIND or turned > BLIND_TURN:
            text = (
                f"It looked no more: no range sensor was read on the last {gone:.0f} in and {turned:.0f} deg "
                f"of its way, and then the program gave up{words}."
            )
            return self._made(Kind.UNREAD, text, self._belief(belief), self._goals())
        if lost is not None:
            text = f"It was lost: {_lost(lost)}, and then the program gave up{words}."
            return self._made(Kind.LOST, text, self._goals(), elapsed=lost.elapsed)
        return None

    def _ended(self) -> Cause | None:
        if self._seen.task is None and not self._exit_code:
            return None
        code = f" with exit code {self._exit_code}" if self._exit_code is not None else ""
        words = f"; its last words: {self._last_words}" if self._last_words else ""
        return self._made(Kind.ENDED, f"The program ended{code} before it was done{words}.", self._goals())

    def _goals(self) -> str:
        seen = self._seen
        if seen.task is None:
            return ""
        return "It held the block." if seen.holding else "" if seen.taken else "It had not taken the block."

    # -- contacts --------------------------------------------------------------------------------

    def _contact(self, met: Collision) -> Cause:
        seen = self._seen
        contact = met.contact
        belief = (
            met.belief if met.belief is not None and met.row.gone_before - met.belief.gone <= STALE else None
        )
        believed = None
        if belief is not None:
            believed = carried_over(belief.true, belief.believed, met.ended.before)
        ground = Ground(seen.spec)
        tried = ground.tried(met.ended, met.bias, met.held, met.lying, believed)
        looks = facing_sensor(contact, seen.spec.sensors, met.readings)
        exact = [each for each in tried if each.change is Change.EXACT]
        holds = bool(exact and exact[0].saved) and not ground.is_narrow(
            met.ended, met.bias, met.held, met.lying
        )
        kind = self._kind_of(met, belief, looks, holds)
        obstacle, shown = obstacle_place(contact, seen.spec), met.ended.command.shown
        into = f"{shown} led {body_text(contact)} into {obstacle}"
        text = _sentence(kind, into, f"hit {obstacle}, in {shown}", belief is not None, met.lost, looks)
        touched = contact_text(contact, seen.spec)
        evidence = (
            f"{touched[0].upper()}{touched[1:]} at {met.row.elapsed:.2f} s, {drift_text(contact)}.",
            self._belief(met.belief),
            shown_lookout(looks, met.row.elapsed),
            shown_tried(tried),
        )
        return Cause(
            kind,
            text,
            tuple(each for each in evidence if each),
            met.lost.elapsed if kind is Kind.LOST and met.lost is not None else met.row.elapsed,
            met.lost.line if kind is Kind.LOST and met.lost is not None else met.row.line,
            contact.point,
            tuple(tried),
        )

    def _kind_of(
        self, met: Collision, belief: BeliefRow | None, looks: FacingSensor | None, holds: bool
    ) -> Kind:
        contact = met.contact
        if not contact.drift and self._is_blind(met, belief, looks):
            return Kind.UNREAD
        wrong = belief is not None and belief.lost
        if wrong:
            return Kind.LOST
        if belief is not None and belief.unsure:
            return Kind.UNSURE
        if contact.held_block:
            return Kind.HELD_BLOCK
        last = looks.last if belief is None and looks is not None and looks_there(looks) else None
        if last is not None and self._is_off(last):
            return Kind.MISREAD
        return Kind.DRIVE_ERROR if holds else Kind.CLEARANCE

    def _is_blind(self, met: Collision, belief: BeliefRow | None, looks: FacingSensor | None) -> bool:
        """True if nobody had looked. One that says where it is may have had it from any range sensor; of
        one that does not, the sensor that looks at the wall is asked for."""
        if belief is None:
            words = [] if looks is None or looks.last is None else [looks.last]
            return looks_there(looks) and _since(met, words) > 1.0
        ranges = [each.code for each in self._seen.spec.sensors if each.kind.is_range]
        return (
            bool(ranges)
            and _since(met, [met.readings[code] for code in ranges if code in met.readings]) > 1.0
        )

    def _is_off(self, word: LastReading) -> bool:
        """True if a reading showed a wall much further away than it was."""
        sensor = next(each for each in self._seen.spec.sensors if each.code == word.code)
        usual = sensor.error * word.true + sensor.absolute_error
        return word.value - word.true > max(MISREAD, SIGMAS * usual)

    def _belief(self, belief: BeliefRow | None) -> str:
        if belief is None:
            return NO_BELIEFS
        off, spread = belief.deviation, belief.spread
        said = "without a spread" if math.isnan(spread) else f"with a spread of {spread:.1f} in"
        return (
            f"The belief told at {belief.elapsed:.1f} s was off by {off.distance:.1f} in and "
            f"{abs(off.turn):.0f} deg, {said}."
        )


def _since(met: Collision, words: Sequence[LastReading]) -> float:
    """Way between the latest of some readings and a movement, as a share of the most that may be."""
    return min(
        (
            max((met.row.gone_before - each.gone) / BLIND, (met.row.turned_before - each.turned) / BLIND_TURN)
            for each in words
        ),
        default=math.inf,
    )


def _sentence(
    kind: Kind, into: str, hit: str, knew: bool, lost: BeliefRow | None, looks: FacingSensor | None
) -> str:
    """Sentence for a contact, as a person would say it."""
    match kind:
        case Kind.HELD_BLOCK:
            return f"The block it held {hit}{', though it knew where it was' if knew else ''}."
        case Kind.UNREAD:
            return f"It drove without looking: {into}."
        case Kind.LOST:
            return f"It was lost: {'' if lost is None else _lost(lost)}, and {into}."
        case Kind.UNSURE:
            return f"It drove on though it did not know where it was: {into}."
        case Kind.MISREAD:
            last = None if looks is None else looks.last
            return f"A sensor misled it: {'' if last is None else _misled(last)}, and {into}."
        case Kind.DRIVE_ERROR:
            return f"Its drives led it astray: {into}, which it would have missed without noise and bias."
        case _:
            return f"{'It knew where it was, and came' if knew else 'It came'} too close: {into}."


def _lost(belief: BeliefRow) -> str:
    off, spread = belief.deviation, belief.spread
    parts = [
        f"{off.distance:.1f} in" if off.off_place else "",
        f"{abs(off.turn):.0f} deg" if off.off_heading else "",
    ]
    said = "" if math.isnan(spread) else f" and held itself sure to {spread:.1f} in"
    return f"from {belief.elapsed:.1f} s on it was wrong by {' and '.join(filter(None, parts))}{said}"


def _misled(last: LastReading) -> str:
    return f"{last.code} said {shown_range(last.value)} where it was {shown_range(last.true)}"


def shown_tried(tried: Sequence[Counterfactual]) -> str:
    """Which changes would have saved a movement."""
    saved = [each.change.value for each in tried if each.saved]
    not_saved = [each.change.value for each in tried if each.saved is False]
    parts = []
    if saved:
        parts.append(f"It would have met nothing {_listed(saved)}.")
    if not_saved:
        parts.append(f"It would have touched something all the same {_listed(not_saved)}.")
    return " ".join(parts)


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"
