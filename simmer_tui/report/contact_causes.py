"""Causes of a contact: wrong sensors and drives, what was read or not, and what a right belief knew."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import replace

from simmer_tui.report.causes import Fact
from simmer_tui.report.contact_evidence import belief_text
from simmer_tui.report.ending_causes import lacked_time, stalled_fact
from simmer_tui.report.finding import Finding, FindingKind
from simmer_tui.report.moments import (
    Moment,
    MomentKind,
    command_moment,
    device_moment,
    end_moment,
    sight_moment,
    told,
)
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.run.phrases import obstacle_place
from simmer_tui.sim.command import counted

NAMED = 4
"""Findings named in a sentence; the table of devices has all."""
_AGAINST_WALLS = "Compare each movement with the distance to the wall before you send it."
_MAP_ADVICE = "Look whether your program's map has {wall}, and compare each movement with the distance to it."
"""Advice where a right belief led into a wall."""
_GOES_ON = "End the velocity in time: send {code} with zeros. It goes on until another one comes."
_READ_THREE_TIMES = "Read {code} three times and take the middle value, before each movement."
_COMPARE = "Compare each movement with {code} before you send it, and print what your program has for it."
_BY_FAULT = {
    FindingKind.STUCK: "Check the cable, the pin and the power of {code}.",
    FindingKind.SIGN: "Exchange the wires of {code}, or take the opposite in your program.",
    FindingKind.NOISE: "Read {code} several times, and take the middle value.",
    FindingKind.MOUNTING: "Give your program the place at which {code} is mounted.",
}
"""Advice by the fault of a sensor or drive, where it is not to calibrate."""


def findings_text(found: Sequence[Finding]) -> str:
    """Findings as sentences; empty for none."""
    more = f" Besides: {counted(len(found) - NAMED, 'other finding')}." if len(found) > NAMED else ""
    return " ".join(f"{each.text}." for each in found[:NAMED]) + more


def _devices(run: RunEvidence, found: Sequence[Finding]) -> Fact:
    """A fact about sensors or drives that differ from the nominal set."""
    first, culprits = found[0], tuple(dict.fromkeys(each.of for each in found))
    is_drive = any(each.code == first.of for each in run.seen.spec.drives)
    advice = _BY_FAULT.get(first.kind, "").format(code=first.of) or None
    if is_drive and first.kind is FindingKind.NOISE:
        advice = None
    if first.other is not None:
        advice = f"Exchange the cables of {first.of} and {first.other}, or their codes in your program."
    return Fact(device_moment(run, first), findings_text(found), culprits=culprits, advice=advice)


def sensor_wrong_fact(run: RunEvidence) -> Fact | None:
    """A sensor that differs from its set, or whose last reading of the wall was too long."""
    found = run.findings_about(drives=False)
    if found and run.seen.task is not None:
        return _devices(run, found)
    met, sight = run.contact if run.has_contact else None, sight_moment(run)
    if met is None or sight is None or met.is_unread or not met.is_misread:
        return None
    return _at_contact(run, sight, _READ_THREE_TIMES.format(code=met.watch), (met.watch,))


def drive_wrong_fact(run: RunEvidence) -> Fact | None:
    """A drive that differs from its set, or whose large errors led to the contact."""
    found = run.findings_about(drives=True)
    if found and run.seen.task is not None:
        return _devices(run, found)
    met = run.contact if run.has_contact else None
    if met is None or met.is_unread or not met.astray:
        return None
    fact = _at_contact(run, None, None, met.astray)
    return replace(fact, has_behind=False, then=f"{fact.then} {met.tried_text}")


def known_wall_fact(run: RunEvidence) -> Fact | None:
    """A right reading or belief that showed the wall into which the command led."""
    met = run.contact if run.has_contact else None
    if met is None or not (met.showed_wall or met.knew_wall):
        return None
    return _at_contact(run, None, _COMPARE.format(code=met.watch) if met.showed_wall else _wall_advice(run))


def unread_fact(run: RunEvidence) -> Fact | None:
    """No range on the last inches before a contact; or of the block by the sensors that see it."""
    met, seen, codes = run.contact, run.seen, run.unseen_block
    if run.has_contact:
        if met is None or not met.is_unread:
            return None
        advice = f"Read {met.watch} before you send {met.met.ended.command.code}."
        return _at_contact(run, None, advice, (met.watch,))
    if not codes or seen.closed or seen.stuck is not None or seen.beliefs[1] is not None or lacked_time(run):
        return None
    was = "was" if len(codes) == 1 else "were"
    text = f"{' and '.join(codes)} alone can see the block, and {was} never read"
    marked = Moment(MomentKind.SIGHT, run.goals[-1].elapsed, text, code=codes[0])
    return Fact(marked, f"{text}.", culprits=codes, advice=f"Read {codes[0]} before you drive to the block.")


def too_close_fact(run: RunEvidence) -> Fact | None:
    """A robot or block that touched a wall, with nothing else to say."""
    met = run.contact if run.has_contact else None
    if met is None or stalled_fact(run) is not None:
        return None
    advice = _wall_advice(run) if met.leads_into else None
    if met.met.contact.held_block:
        advice = "Plan with the held block, and an inch more on each side."
    return _at_contact(run, None, advice)


def _wall_advice(run: RunEvidence) -> str:
    """Advice where a command led into a wall: a right belief leaves the map, which has the outer wall."""
    met = run.contact
    if met is None or not met.knew or met.is_outer_wall:
        return _AGAINST_WALLS
    return _MAP_ADVICE.format(wall=obstacle_place(met.met.contact, run.seen.spec))


def _at_contact(
    run: RunEvidence, marked: Moment | None, advice: str | None, culprits: tuple[str, ...] = ()
) -> Fact:
    """The facts of a contact: the belief, what was read, what was sent, and what came of it. The command is
    marked, unless another moment is."""
    met, sent = run.contact, command_moment(run)
    assert met is not None
    assert sent is not None
    if met.goes_on:
        advice = _GOES_ON.format(code=sent.code)
    belief = "" if met.belief is None else belief_text(run.seen, met.belief)
    text = f"{told(sight_moment(run), sent)} {belief}".strip()
    return Fact(
        marked=marked or sent,
        text=text,
        then=told(end_moment(run)),
        has_behind=True,
        culprits=culprits,
        advice=advice,
    )
