"""The order of causes: the first rule that holds names the cause of a failed run.

`ORDER` is the one place of their precedence. docs/causes.md is made from it (scripts/make_reference.py).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from msgspec import Struct

from simmer_tui.report.causes import Cause, Fact, Kind
from simmer_tui.report.command_causes import moved_fact, refused_fact, wire_fact
from simmer_tui.report.contact_causes import (
    NAMED,
    drive_wrong_fact,
    findings_text,
    known_wall_fact,
    sensor_wrong_fact,
    too_close_fact,
    unread_fact,
)
from simmer_tui.report.contact_evidence import belief_text
from simmer_tui.report.ending_causes import (
    crashed_fact,
    dropped_fact,
    ended_fact,
    lost_fact,
    missed_grip_fact,
    nowhere_fact,
    silence_fact,
    slow_fact,
)
from simmer_tui.report.moments import Moment, MomentKind, declared_moment, end_moment
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.report.set_differences import set_differences, world_differences
from simmer_tui.report.typical_runs import most_different
from simmer_tui.run.phrases import capitalized


class CauseRule(Struct, frozen=True):
    """A rule: it holds where `find` gives a fact. `when` is its condition for the page, `excludes` what it
    rules out, `advice` one line to follow (empty for none)."""

    kind: Kind
    find: Callable[[RunEvidence], Fact | None]
    when: str
    excludes: str
    advice: str = ""


def cause_of(run: RunEvidence) -> Cause:
    """The cause of a failed run: the first rule of `ORDER` that holds, else the unknown one."""
    return next(_causes(run, (*ORDER, NO_RULE)))


def cause_so_far(run: RunEvidence) -> Cause | None:
    """The cause that a run which was stopped has shown so far; None without one. What it had not done yet it
    might have done."""
    return next(_causes(run, (rule for rule in ORDER if rule.kind not in _AT_THE_END)), None)


def _causes(run: RunEvidence, rules: Iterable[CauseRule]) -> Iterator[Cause]:
    for rule in rules:
        fact = rule.find(run)
        if fact is not None:
            yield _made(run, rule, fact)


def advice_on(kind: Kind) -> str:
    """One line to follow for a kind of cause; empty for none."""
    return next((rule.advice for rule in ORDER if rule.kind is kind), "")


def _made(run: RunEvidence, rule: CauseRule, fact: Fact) -> Cause:
    parts, culprits = [fact.text], fact.culprits
    advice = rule.advice if fact.advice is None else fact.advice
    world = world_differences(run.seen)
    if fact.has_behind:
        declared = list(run.declared)[:NAMED] if run.seen.task is not None else []
        if declared and rule.kind is not Kind.TOO_SLOW:
            named = " and ".join(declared)
            advice = f"Give your program the numbers of this set for {named}, or correct for them."
        behind, codes = _behind(run, fact.text)
        parts += [world, *(f"{declared_moment(run, code).text}." for code in declared), behind]
        culprits = tuple(dict.fromkeys((*culprits, *declared, *codes)))
    parts.append(fact.then)
    if not run.has_contact and rule.kind in _ABOUT_GOALS:
        # A search fails where the block is not; a lost or silent program fails before that.
        is_first = rule.kind in _OF_A_SEARCH and bool(run.strayed_text)
        parts.insert(0 if is_first else len(parts), run.goals_text)
        advice = _SEARCH if is_first else advice
    text = " ".join(filter(None, parts))
    evidence = _evidence(run, rule.kind)
    return Cause(
        kind=rule.kind,
        text=text,
        evidence=tuple(each for each in (*evidence, world) if each and each not in text),
        moment=fact.marked,
        tried=run.contact.tried if run.has_contact and run.contact is not None else (),
        culprits=culprits,
        advice=advice,
    )


def _behind(run: RunEvidence, fact: str) -> tuple[str, list[str]]:
    """Sentences of the tables that stand behind a fact: wrong devices, else beliefs or corrections that it
    does not tell itself. And the codes of the devices."""
    if run.findings and run.seen.task is not None:
        return findings_text(run.findings), [each.of for each in run.findings]
    codes = [*run.belief.culprits] or [code for each in run.corrections for code in each.of]
    corrections = [each.text for each in run.corrections if each.text not in fact]
    told = f"{', and '.join(corrections)}." if corrections and not run.belief.culprits else ""
    return f"{run.belief.text} {told}".strip(), codes


def _evidence(run: RunEvidence, kind: Kind) -> list[str]:
    """Sentences that support a cause."""
    seen = run.seen
    found = [f"Last output: {run.last_words}." if run.last_words else ""]
    if not seen.is_silent:
        found = [run.arrived_text, belief_text(seen, run.last_belief), run.goals_text]
    if run.has_contact and run.contact is not None:
        # What a wrong drive does is no error of the movements that are repeated: of it they say nothing.
        tried = "" if run.findings_about(drives=True) else run.contact.tried_text
        unused = f"{capitalized(run.unused_grip[1])}." if run.unused_grip is not None else ""
        found = [run.arrived_text, belief_text(seen, run.last_belief), tried, unused]
    there = f"When it was ended, the program was at {run.ended_at}." if run.ended_at else ""
    return [*found, there, set_differences(seen, with_limit=kind is not Kind.TOO_SLOW)]


def _unknown(run: RunEvidence) -> Fact:
    at = end_moment(run) or Moment(MomentKind.END, run.seen.elapsed, "the run ended", run.seen.line)
    return Fact(at, f"Unknown. {most_different(run.seen)}", has_behind=True)


ORDER: tuple[CauseRule, ...] = (
    CauseRule(
        Kind.WIRE,
        wire_fact,
        "a mistake of a line was reported, or a program turned away, and no goal was met after it",
        "all others",
    ),
    CauseRule(
        Kind.REFUSED,
        refused_fact,
        "most commands to drive were refused, a twentieth of all, or one that was never carried out",
        "what followed",
        "Check the reply to each command in your program: a refused one does nothing.",
    ),
    CauseRule(
        Kind.CRASHED,
        crashed_fact,
        "an exception or a signal ended the program",
        "what led there",
    ),
    CauseRule(
        Kind.MOVED,
        moved_fact,
        "a person moved the robot or the block; or a second client came",
        "what followed",
        "Compare each reading with the belief, and search again when they no longer fit.",
    ),
    CauseRule(
        Kind.SENSOR_WRONG,
        sensor_wrong_fact,
        "a sensor differs from the nominal set; or its last reading of the wall was too long",
        "what followed",
        "Calibrate the sensor, or give the program the numbers of this set.",
    ),
    CauseRule(
        Kind.DRIVE_WRONG,
        drive_wrong_fact,
        "a drive differs from the nominal set; or without its large errors nothing would have been touched",
        "what followed",
        "Measure after each movement, and correct for the drive's error.",
    ),
    CauseRule(
        Kind.LOST,
        lost_fact,
        "the belief was wrong or unsure at the contact, grip or end",
        "the path",
        "Turn on the spot and read all sensors until the belief is sure, before you drive on.",
    ),
    CauseRule(
        Kind.SILENCE,
        silence_fact,
        "no command came in the last quarter of the time, or none at all",
        "a program that is slow",
        "Print a line before each command, lock and wait: the last line shows where the program waits.",
    ),
    CauseRule(
        Kind.KNOWN_WALL,
        known_wall_fact,
        "a right reading or belief showed the wall, and the command led an inch or more into it",
        "wrong readings, drive errors",
        "Compare each movement with the distance to the wall before you send it.",
    ),
    CauseRule(
        Kind.UNREAD,
        unread_fact,
        "no range was read on the last 4 in or 45 deg; or the one that sees the block was not",
        "wrong readings",
    ),
    CauseRule(
        Kind.MISSED_GRIP,
        missed_grip_fact,
        "the gripper closed on nothing, or was not used where the block was right for it",
        "a wrong belief",
        "Measure the distance to the block once more before you close the gripper.",
    ),
    CauseRule(
        Kind.DROPPED_OUTSIDE,
        dropped_fact,
        "the block was set down outside the drop zone",
        "a wrong belief",
        "Check the block's place, not the robot's, before you open the gripper.",
    ),
    CauseRule(
        Kind.TOO_CLOSE,
        too_close_fact,
        "the robot or its block touched a wall",
        "wrong beliefs",
        "Plan with an inch more on each side.",
    ),
    CauseRule(
        Kind.GOT_NOWHERE,
        nowhere_fact,
        "100 movements or a quarter of the time led to no goal or new place; or corrections do not shrink",
        "lack of time",
        "Count movements without a new place, and try another way after ten.",
    ),
    CauseRule(
        Kind.TOO_SLOW,
        slow_fact,
        "the time limit was reached",
        "a program that ended by itself",
        "Save time where most of it goes.",
    ),
    CauseRule(
        Kind.ENDED,
        ended_fact,
        "the program ended by itself",
        "",
    ),
)
"""The rules, the first first."""
_SEARCH = "Put the block into the loading zone, or search the whole maze for it."
"""Advice where the block lay elsewhere."""
_OF_A_SEARCH = (Kind.GOT_NOWHERE, Kind.TOO_SLOW, Kind.ENDED)
"""Causes that a block elsewhere explains: without it there is nothing to find."""
_ABOUT_GOALS = (Kind.LOST, Kind.SILENCE, Kind.GOT_NOWHERE, Kind.TOO_SLOW, Kind.ENDED)
"""Causes beside which it matters how far the mission came."""
_AT_THE_END = (Kind.CRASHED, Kind.UNREAD, Kind.TOO_SLOW, Kind.ENDED)
"""Causes of which only the end of a run tells."""
NO_RULE = CauseRule(
    Kind.UNKNOWN,
    _unknown,
    "none holds: the three figures that differ most from runs that succeed are named",
    "",
)
