"""Causes of a contact: what was read, what a right belief knew, and wrong sensors and drives."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import replace

from simmer_tui.report.cause_text import Fact, contact_sentence, findings_text, sent_text
from simmer_tui.report.causes import MomentKind, Sureness
from simmer_tui.report.contact_evidence import ContactEvidence, DriveErrors
from simmer_tui.report.ending_causes import lacked_time, stalled_fact
from simmer_tui.report.finding import Finding, FindingKind
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.report.why import shown_range
from simmer_tui.run.facts import ALIKE, SLIGHT, LastReading
from simmer_tui.run.phrases import obstacle_place
from simmer_tui.sim.command import counted

AGAINST_WALLS = "Compare each movement with the distance to the wall before you send it."
"""Advice where a command led into a wall that the program knew."""
_MAP_ADVICE = "Look whether your program's map has {wall}, and compare each movement with the distance to it."
"""Advice where a right belief led into a wall."""
_GOES_ON = "End the velocity in time: send {code} with zeros. It goes on until another one comes."
_READ_THREE_TIMES = "Read {code} three times and take the middle value, before each movement."
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
    last = None if met is None or met.is_blind else met.misread
    if met is None or last is None:
        return None
    return Fact(
        f"{_read_and_sent(run, met, last, f', the true distance was {shown_range(last.true)}')}.",
        since=last.time,
        place=met.met.contact.point,
        culprits=(last.code,),
        advice=_READ_THREE_TIMES.format(code=last.code),
        moment=MomentKind.SIGHT,
        has_behind=True,
        then=contact_sentence(run),
    )


def drive_wrong_fact(run: RunEvidence) -> Fact | None:
    """A drive that differs from its set, or whose large errors led to the contact."""
    found = run.findings_about(drives=True)
    if found and run.seen.task is not None:
        return _devices(run, found)
    met = run.contact if run.has_contact else None
    errors = None if met is None or met.is_blind else met.drive_errors
    if met is None or errors is None or not errors.large:
        return None
    text = f"{sent_text(run)}. {contact_sentence(run)} {_without(errors)}"
    place = met.met.contact.point
    return Fact(text, met.met.row, met.sent, place, errors.codes, moment=MomentKind.COMMAND)


def _without(errors: DriveErrors) -> str:
    moves = "the movement" if errors.count == 1 else f"the last {counted(errors.count, 'movement')}"
    return f"Without the errors of {' and '.join(errors.codes)} in {moves}, nothing would have been touched."


def _devices(run: RunEvidence, found: Sequence[Finding]) -> Fact:
    told, codes = findings_text(found)
    first = found[0]
    advice = _BY_FAULT[first.kind].format(code=first.of) if first.kind in _BY_FAULT else None
    if first.other is not None:
        advice = f"Exchange the cables of {first.of} and {first.other}, or their codes in your program."
    since = run.seen.begun
    return Fact(told, since=since, culprits=codes, advice=advice, sure=Sureness.LIKELY)


def unread_fact(run: RunEvidence) -> Fact | None:
    """No range on the last inches before a contact; or of the block by the sensors that see it."""
    met = run.contact
    if run.has_contact:
        if met is None or not met.is_blind or not met.looking:
            return None
        advice = f"Read {met.looking} before you send {met.met.ended.command.code}."
        return replace(_at_contact(run, met, None, advice=advice), culprits=(met.looking,))
    codes, seen = run.unseen_block, run.seen
    if not codes or seen.closed or seen.stuck is not None or seen.beliefs[1] is not None or lacked_time(run):
        return None
    was = "was" if len(codes) == 1 else "were"
    return Fact(
        f"{' and '.join(codes)} alone can see the block, and {was} never read.",
        since=run.goals[-1].elapsed,
        culprits=codes,
        advice=f"Read {codes[0]} before you drive to the block.",
        moment=MomentKind.SIGHT,
    )


def known_wall_fact(run: RunEvidence) -> Fact | None:
    """A right reading or belief that showed the wall into which the command led."""
    met = run.contact
    if not run.has_contact or met is None:
        return None
    shown = met.ignored
    if shown is not None:
        advice = (
            f"Compare each movement with {shown.code} before you send it, "
            "and print what your program has for it."
        )
        return _at_contact(run, met, _read_and_sent(run, met, shown), advice=advice)
    return _at_contact(run, met, None, advice=_wall_advice(run, met)) if met.is_into_known else None


def too_close_fact(run: RunEvidence) -> Fact | None:
    """A robot or block that touched a wall, with nothing else to say."""
    met = run.contact if run.has_contact else None
    if met is None or stalled_fact(run) is not None:
        return None
    advice = None
    if met.met.contact.held_block:
        advice = "Plan with the held block, and an inch more on each side."
    elif met.leads_into:
        advice = _wall_advice(run, met)
    if met.unread_ahead:
        advice = f"Read {met.unread_ahead} before you send {met.met.ended.command.code}."
    last = None if met.belief or met.met.contact.held_block else met.facing
    told = None
    if last is not None and not met.is_unread and met.shows(last):
        turned = met.met.row.turned_before - last.turned > ALIKE
        told = _read_and_sent(run, met, last, ", before the robot turned" if turned else "")
    fact = _at_contact(run, met, told, advice=advice)
    errors = None if met.is_blind else met.drive_errors
    if errors is None:
        return fact
    # Errors of the usual size are no fault of the drive: they take the room that was too little.
    return replace(fact, then=f"{fact.then} {_without(errors)}")


def _wall_advice(run: RunEvidence, met: ContactEvidence) -> str:
    """Advice where a command led into a wall: a right belief leaves the map, which has the outer wall."""
    if not met.knew or met.is_outer_wall:
        return AGAINST_WALLS
    return _MAP_ADVICE.format(wall=obstacle_place(met.met.contact, run.seen.spec))


def _read_and_sent(run: RunEvidence, met: ContactEvidence, last: LastReading, more: str = "") -> str:
    """A reading and the deciding command, in their order: a velocity may have been sent before."""
    read = f"{last.code} read {shown_range(last.value)} at {last.time:.1f} s{more}"
    is_before = not met.goes_on or last.time <= met.sent
    return f"{read}; then {sent_text(run)}" if is_before else f"{sent_text(run)}; {read}"


def _at_contact(run: RunEvidence, met: ContactEvidence, told: str | None, *, advice: str | None) -> Fact:
    """The facts of a contact: the belief, what was read, what was sent, and what came of it."""
    belief = ""
    if met.belief is not None:
        # A right one leaves the map or the plan.
        right = "right, " if met.knew and met.belief.distance <= SLIGHT else ""
        belief = f"Its belief was {right}off by {met.belief.error_text}; "
    if met.goes_on:
        advice = _GOES_ON.format(code=met.met.ended.command.code)
    return Fact(
        f"{belief}{sent_text(run) if told is None else told}.{met.unread_text}",
        met.met.row,
        since=met.sent,
        place=met.met.contact.point,
        advice=advice,
        has_behind=True,
        then=contact_sentence(run),
    )
