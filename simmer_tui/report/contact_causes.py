"""Causes of a contact: what was read, what a right belief knew, and wrong sensors and drives."""

from __future__ import annotations

import math
from collections.abc import Sequence

from msgspec.structs import replace

from simmer_tui.report.cause_text import (
    Fact,
    contact_sentence,
    findings_text,
    sent_text,
    silent_ranges,
)
from simmer_tui.report.causes import MomentKind, Sureness
from simmer_tui.report.contact_evidence import ContactEvidence, DriveErrors
from simmer_tui.report.ending_causes import lacked_time, stalled_fact
from simmer_tui.report.finding import Finding, FindingKind
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.report.why import looks_there, shown_range
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.facts import ALIKE, SLIGHT
from simmer_tui.run.phrases import (
    obstacle_place,
)
from simmer_tui.sim.command import counted

AGAINST_WALLS = "Compare each movement with the distance to the wall before you send it."
"""Advice where a command led into a wall that the program knew."""
_MAP_ADVICE = "Look whether your program's map has {wall}, and compare each movement with the distance to it."
"""Advice where a right belief led into a wall."""
_GOES_ON = "End the velocity in time: send {code} with zeros. It goes on until another one comes."
_NO_SENSOR_THERE = "No sensor looks to that side: turn until one does, or check the way in your map."
_OUTLIER_ADVICE = "Read {code} three times and take the middle value, before each movement."
_NO_ECHO_ADVICE = "Take a reading of {code} with nothing in range for no proof of a free way."
_BY_FAULT = {
    FindingKind.STUCK: "Check the cable, the pin and the power of {code}.",
    FindingKind.SIGN: "Exchange the wires of {code}, or take the opposite in your program.",
    FindingKind.MOUNTING: "Give your program the place at which {code} is mounted.",
}
"""Advice by the fault of a sensor or drive, where it is not to calibrate."""
CORRECT = "Measure after each movement, and correct for the drive's error."


def sensor_wrong_fact(run: RunEvidence) -> Fact | None:
    """A sensor that differs from its set, or whose last reading of the wall was too long."""
    found = run.findings_about(drives=False)
    if found and run.seen.task is not None:
        return _devices(run, found)
    met = run.contact if run.has_contact else None
    if met is None:
        return None
    last = None if met.is_blind else met.misread
    if last is None:
        return None
    advice = _NO_ECHO_ADVICE if math.isinf(last.value) else _OUTLIER_ADVICE
    true = f", the true distance was {shown_range(last.true)}" if math.isfinite(last.true) else ""
    read = f"{last.code} read {shown_range(last.value)} at {last.time:.1f} s{true}"
    at_sight = met.facing is last
    return Fact(
        f"{read}; then {sent_text(run)}.",
        None if at_sight else met.met.row,
        since=last.time,
        place=met.met.contact.point,
        culprits=(last.code,),
        advice=advice.format(code=last.code),
        moment=MomentKind.SIGHT if at_sight else None,
        has_behind=True,
        then=contact_sentence(run),
    )


def drive_wrong_fact(run: RunEvidence) -> Fact | None:
    """A drive that differs from its set, or whose errors led to the contact."""
    found = run.findings_about(drives=True)
    if found and run.seen.task is not None:
        return _devices(run, found)
    met = run.contact if run.has_contact else None
    errors = None if met is None or met.is_blind else met.drive_errors
    if met is None or errors is None or not errors.large:
        return None
    sure = Sureness.CERTAIN if errors.certain else Sureness.LIKELY
    text = f"{sent_text(run)}. {contact_sentence(run)} {_without(errors)}"
    place = met.met.contact.point
    return Fact(text, met.met.row, met.sent, place, errors.codes, moment=MomentKind.COMMAND, sure=sure)


def _without(errors: DriveErrors) -> str:
    moves = "the movement" if errors.count == 1 else f"the last {counted(errors.count, 'movement')}"
    return f"Without the errors of {' and '.join(errors.codes)} in {moves}, nothing would have been touched."


def _devices(run: RunEvidence, found: Sequence[Finding]) -> Fact:
    told, codes = findings_text(found)
    others = [each for each in run.findings if each not in found]
    besides = f" Also {others[0].text}." if others else ""
    first = found[0]
    advice = _BY_FAULT[first.kind].format(code=first.of) if first.kind in _BY_FAULT else None
    if first.other is not None:
        advice = f"Exchange the cables of {first.of} and {first.other}, or their codes in your program."
    since = _first_use(run.seen, codes[0])
    return Fact(f"{told}{besides}", since=since, culprits=codes, advice=advice, sure=Sureness.LIKELY)


def _first_use(seen: Attempt, code: str) -> float:
    """The time of the first reading of a sensor, or of the first movement of a drive."""
    history = seen.history
    readings, moves = seen.within(history.readings), seen.within(history.movements)
    times = readings["elapsed"][[history.sensor_codes[number] == code for number in readings["sensor"]]]
    used = moves["elapsed"][[history.code_names[number] == code for number in moves["code"]]]
    return float(min((*times[:1], *used[:1]), default=seen.begun))


def unread_fact(run: RunEvidence) -> Fact | None:
    """No range on the last inches before a contact; or of the block by the sensors that see it."""
    met = run.contact
    if run.has_contact:
        if met is None or not met.is_blind:
            return None
        codes = [] if met.looks is None or not looks_there(met.looks) else met.looks.codes
        advice = (
            f"Read {codes[0]} before you send {met.met.ended.command.code}." if codes else _NO_SENSOR_THERE
        )
        if met.goes_on and not met.belief:
            advice = _GOES_ON.format(code=met.met.ended.command.code)
        if met.quiet_since is not None:
            codes, advice = (
                [],
                "Read and send more often under a velocity, or set it to 0 while your program computes.",
            )
        silent = silent_ranges(run)
        if silent and not codes[1:]:
            advice = f"Check what your program does when {silent} reads nothing in range."
        text = f"{silent} read nothing in range; then {sent_text(run)}" if silent else sent_text(run)
        fact = _at_contact(run, met, f"{text}. {met.unread_text}", advice=advice)
        return replace(fact, culprits=tuple(codes[:1]))
    unseen = None if run.seen.closed else run.unseen_block
    if unseen is None or run.seen.stuck is not None or run.seen.beliefs[1] is not None or lacked_time(run):
        return None
    names = " and ".join(unseen.codes)
    was, it, sees = ("was", "it", "sees") if len(unseen.codes) == 1 else ("were", "they", "see")
    goal = run.goals[-1] if run.goals else None
    read = f"{was} never read"
    if goal is not None and any(code in run.seen.history.sensor_codes for code in unseen.codes):
        read = f"{was} not read after {goal.elapsed:.1f} s ({goal.event.subject.value})"
    return Fact(
        f"{names} {read}, and {it} alone {sees} the block. The block was in sight at {unseen.since:.1f} s.",
        since=unseen.since,
        culprits=unseen.codes,
        advice=f"Read {unseen.codes[0]} before you drive to the block.",
        moment=MomentKind.SIGHT,
    )


def known_wall_fact(run: RunEvidence) -> Fact | None:
    """A right reading or belief that showed the wall into which the command led."""
    met = run.contact
    if not run.has_contact or met is None:
        return None
    shown = met.ignored
    # A wrong sensor shows the program something else than its set says.
    if shown is not None and all(each.of != shown.code for each in run.findings):
        read = f"{shown.code} read {shown_range(shown.value)} at {shown.elapsed:.1f} s; then {sent_text(run)}"
        advice = (
            f"Compare each movement with {shown.code} before you send it, "
            "and print what your program has for it."
        )
        return _at_contact(run, met, _with_belief(met, read), advice=advice)
    if not met.is_into_known:
        return None
    unread = f". {met.unread_text}" if met.is_blind else ""
    return _at_contact(
        run, met, f"{_with_belief(met, sent_text(run))}{unread}", advice=_wall_advice(run, met)
    )


def _wall_advice(run: RunEvidence, met: ContactEvidence) -> str:
    """Advice where a command led into a wall: a right belief leaves the map, which has the outer wall."""
    if not met.knew or met.is_outer_wall:
        return AGAINST_WALLS
    return _MAP_ADVICE.format(wall=obstacle_place(met.met.contact, run.seen.spec))


def _with_belief(met: ContactEvidence, text: str) -> str:
    """A sentence on a contact, behind a belief that was right: that leaves the map or the plan."""
    if not met.knew or met.belief is None or met.belief.distance > SLIGHT:
        return text
    return f"Its belief was right, off by {met.belief.error_text}; {text[0].lower()}{text[1:]}"


def _at_contact(run: RunEvidence, met: ContactEvidence, text: str, *, advice: str | None = None) -> Fact:
    """A fact about the command that led to a contact."""
    place = met.met.contact.point
    unread = f" {met.not_read}." if met.not_read and met.not_read not in text else ""
    outline = met.outline_text if met.knew else ""
    if met.new_wall_text:
        advice = "Give your program the maze of this run."
    elif outline:
        advice = "Give your program the outline of this robot."
    then = f"{contact_sentence(run)}{met.new_wall_text}{outline or met.narrow_text}{unread}"
    return Fact(f"{text}.", met.met.row, met.sent, place, has_behind=True, advice=advice, then=then)


def too_close_fact(run: RunEvidence) -> Fact | None:
    """A robot or block that touched a wall, with nothing else to say."""
    met = run.contact if run.has_contact else None
    if met is None or stalled_fact(run) is not None:
        return None
    contact = met.met.contact
    text, advice = sent_text(run), None
    if contact.held_block:
        advice = "Plan with the held block, and an inch more on each side."
    elif met.leads_into or not (met.met.ended.trajectory.turning or met.narrow_text):
        silent = silent_ranges(run)
        text = f"{silent} read nothing in range; then {text}" if silent else text
        advice = _wall_advice(run, met)
    last = None if met.belief or contact.held_block else met.facing
    if last is not None and math.isfinite(last.value) and met.looks_at(last.code):
        turned = met.met.row.turned_before - last.turned > ALIKE
        when = f"at {last.time:.1f} s{', before the robot turned' if turned else ''}"
        text = f"{last.code} read {shown_range(last.value)} {when}; then {text}"
    if met.goes_on:
        advice = _GOES_ON.format(code=met.met.ended.command.code)
    fact = _at_contact(run, met, _with_belief(met, text), advice=advice)
    errors = None if met.is_blind else met.drive_errors
    if errors is None:
        return fact
    return replace(fact, then=f"{fact.then} {_without(errors)}", culprits=errors.codes, advice=CORRECT)
