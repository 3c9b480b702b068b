"""The order of causes: the first rule that holds names the cause of a failed run.

`ORDER` is the one place of their precedence. docs/causes.md is made from it (scripts/make_reference.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from msgspec import Struct

from simmer_tui.report.cause_text import NAMED, Fact, findings_text, goals_text, strayed_text
from simmer_tui.report.causes import Cause, Kind, MomentKind
from simmer_tui.report.command_causes import moved_fact, refused_fact, wire_fact
from simmer_tui.report.contact_causes import (
    AGAINST_WALLS,
    CORRECT,
    drive_wrong_fact,
    known_wall_fact,
    sensor_wrong_fact,
    too_close_fact,
    unread_fact,
)
from simmer_tui.report.contact_evidence import belief_text, shown_tried
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
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.report.set_differences import set_differences, world_differences
from simmer_tui.report.typical_runs import most_different


class CauseRule(Struct, frozen=True):
    """A rule: it holds where `find` gives a fact. `when` is its condition for the page, `excludes` what it
    rules out, `advice` one line to follow (empty for none), `moment` the kind of moment that is marked."""

    kind: Kind
    find: Callable[[RunEvidence], Fact | None]
    moment: MomentKind
    when: str
    excludes: str
    advice: str = ""


def cause_of(run: RunEvidence) -> Cause:
    """The cause of a failed run: the first rule of `ORDER` that holds, else the unknown one."""
    cause = _first(run, ORDER)
    return cause or _made(run, NO_RULE, Fact(f"Unknown. {most_different(run.seen)}"))


def cause_so_far(run: RunEvidence) -> Cause | None:
    """The cause that a run which was stopped has shown so far; None without one. What it had not done yet it
    might have done."""
    return _first(run, [rule for rule in ORDER if rule.kind not in _AT_THE_END])


def _first(run: RunEvidence, rules: Sequence[CauseRule]) -> Cause | None:
    for rule in rules:
        fact = rule.find(run)
        if fact is not None:
            return _made(run, rule, fact)
    return None


def advice_on(kind: Kind) -> str:
    """One line to follow for a kind of cause; empty for none."""
    return next((rule.advice for rule in ORDER if rule.kind is kind), "")


def _made(run: RunEvidence, rule: CauseRule, fact: Fact) -> Cause:
    seen, parts, culprits = run.seen, [fact.text], fact.culprits
    world = world_differences(seen)
    advice = rule.advice if fact.advice is None else fact.advice
    if fact.has_behind or rule is NO_RULE:
        declared, marked = _declared(run)
        behind, codes = _behind(run)
        if marked and rule.kind is not Kind.TOO_SLOW:
            named = " and ".join(marked)
            advice = f"Give your program the numbers of this set for {named}, or correct for them."
        parts += [world, declared, behind]
        culprits = tuple(dict.fromkeys((*culprits, *marked, *codes)))
    met = run.contact if run.has_contact else None
    parts.append(fact.then)
    goals = goals_text(run)
    if met is None and rule.kind in _ABOUT_GOALS:
        # A search fails where the block is not; a lost or silent program fails before that.
        is_first = rule.kind in _OF_A_SEARCH and bool(strayed_text(run))
        parts.insert(0 if is_first else len(parts), goals)
        advice = _SEARCH if is_first else advice
    text = " ".join(filter(None, parts))
    evidence: tuple[str, ...] = (run.arrived_text, belief_text(seen, seen.beliefs[0]), goals)
    if met is not None:
        # What a wrong drive does is no error of the movements that are repeated: of it they say nothing.
        tried = "" if run.findings_about(drives=True) else shown_tried(met.tried)
        unused = f"The gripper was never {run.unused_grip[1]}." if run.unused_grip is not None else ""
        evidence = (run.arrived_text, belief_text(seen, met.met.belief), tried, unused)
    elif seen.is_silent:
        evidence = (f"Last output: {run.last_words}." if run.last_words else "",)
    there = f"When it was ended, the program was at {run.ended_at}." if run.ended_at else ""
    evidence = (
        *evidence,
        there if run.ended_at not in text else "",
        world,
        set_differences(seen, with_limit=rule.kind is not Kind.TOO_SLOW),
    )
    # A reason may end with a question; a sentence ends with one mark.
    text = text.replace("?.", "?")
    at = fact.at
    elapsed = fact.since if fact.since is not None else seen.elapsed if at is None else at.elapsed
    return Cause(
        kind=rule.kind,
        text=text,
        evidence=tuple(each for each in evidence if each and each not in text),
        elapsed=elapsed,
        line=getattr(at, "line", seen.line),
        place=fact.place or (seen.pose.x, seen.pose.y),
        moment=fact.moment or rule.moment,
        tried=met.tried if met is not None else (),
        sure=fact.sure,
        culprits=culprits,
        advice=advice,
    )


def _behind(run: RunEvidence) -> tuple[str, tuple[str, ...]]:
    """Sentences of the tables that stand behind a fact: wrong devices, else beliefs or corrections. And the
    codes of the devices."""
    if run.findings and run.seen.task is not None:
        told, codes = findings_text(run.findings)
        return told, codes
    text, codes = run.belief.text, run.belief.culprits
    if codes or not run.corrections:
        return text, codes
    told = ", and ".join(each.text for each in run.corrections)
    of = tuple(dict.fromkeys(code for each in run.corrections for code in each.of))
    return f"{text} {told}.".strip(), of


def _declared(run: RunEvidence) -> tuple[str, tuple[str, ...]]:
    """Sentences on devices with a large error that their set declares, and their codes."""
    if run.seen.task is None:
        return "", ()
    codes = tuple(run.declared)[:NAMED]
    return " ".join(f"By this robot's set, {code} {run.declared[code]}." for code in codes), codes


ORDER: tuple[CauseRule, ...] = (
    CauseRule(
        Kind.WIRE,
        wire_fact,
        MomentKind.FAULT,
        "a mistake of a line was reported, or a program turned away, and no goal was met after it",
        "all others",
    ),
    CauseRule(
        Kind.REFUSED,
        refused_fact,
        MomentKind.FAULT,
        "most commands to drive were refused, a twentieth of all, or one that was never carried out",
        "what followed",
        "Check the reply to each command in your program: a refused one does nothing.",
    ),
    CauseRule(
        Kind.CRASHED,
        crashed_fact,
        MomentKind.PROGRAM,
        "an exception or a signal ended the program",
        "what led there",
    ),
    CauseRule(
        Kind.MOVED,
        moved_fact,
        MomentKind.PERSON,
        "a person moved the robot or the block; or a second client came",
        "what followed",
        "Compare each reading with the belief, and search again when they no longer fit.",
    ),
    CauseRule(
        Kind.SENSOR_WRONG,
        sensor_wrong_fact,
        MomentKind.DEVICE,
        "a sensor differs from the nominal set; or its last reading of the wall was too long",
        "what followed",
        "Calibrate the sensor, or give the program the numbers of this set.",
    ),
    CauseRule(
        Kind.DRIVE_WRONG,
        drive_wrong_fact,
        MomentKind.DEVICE,
        "a drive differs from the nominal set; or without its large errors nothing would have been touched",
        "what followed",
        CORRECT,
    ),
    CauseRule(
        Kind.LOST,
        lost_fact,
        MomentKind.LOST,
        "the belief was wrong or unsure at the contact, grip or end",
        "the path",
        "Turn on the spot and read all sensors until the belief is sure, before you drive on.",
    ),
    CauseRule(
        Kind.SILENCE,
        silence_fact,
        MomentKind.END,
        "no command came in the last quarter of the time, or none at all",
        "a program that is slow",
        "Print a line before each command, lock and wait: the last line shows where the program waits.",
    ),
    CauseRule(
        Kind.KNOWN_WALL,
        known_wall_fact,
        MomentKind.COMMAND,
        "a right reading or belief showed the wall, and the command led an inch or more into it",
        "wrong readings, drive errors",
        AGAINST_WALLS,
    ),
    CauseRule(
        Kind.UNREAD,
        unread_fact,
        MomentKind.COMMAND,
        "no range was read on the last 4 in or 45 deg; or the one that sees the block was not",
        "wrong readings",
    ),
    CauseRule(
        Kind.MISSED_GRIP,
        missed_grip_fact,
        MomentKind.COMMAND,
        "the gripper closed on nothing, or was not used where the block was right for it",
        "a wrong belief",
        "Measure the distance to the block once more before you close the gripper.",
    ),
    CauseRule(
        Kind.DROPPED_OUTSIDE,
        dropped_fact,
        MomentKind.COMMAND,
        "the block was set down outside the drop zone",
        "a wrong belief",
        "Check the block's place, not the robot's, before you open the gripper.",
    ),
    CauseRule(
        Kind.TOO_CLOSE,
        too_close_fact,
        MomentKind.COMMAND,
        "the robot or its block touched a wall",
        "wrong beliefs",
        "Plan with an inch more on each side.",
    ),
    CauseRule(
        Kind.GOT_NOWHERE,
        nowhere_fact,
        MomentKind.COMMAND,
        "100 movements or a quarter of the time led to no goal or new place; or corrections do not shrink",
        "lack of time",
        "Count movements without a new place, and try another way after ten.",
    ),
    CauseRule(
        Kind.TOO_SLOW,
        slow_fact,
        MomentKind.END,
        "the time limit was reached",
        "a program that ended by itself",
        "Save time where most of it goes.",
    ),
    CauseRule(
        Kind.ENDED,
        ended_fact,
        MomentKind.PROGRAM,
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
    lambda run: None,
    MomentKind.END,
    "none holds: the three figures that differ most from runs that succeed are named",
    "",
)
