"""The search for the causes of a failed run: those that hold, ranked by the changes that would have saved it.

The end of the run decides first: a contact, its program, or its time. A sensor or drive that is not as its
set says comes before its consequences. So does a run that had made no progress for hundreds of movements
before its end.
"""

import itertools
from collections.abc import Collection, Iterator, Sequence

from simmer_tui.report.belief_audit import BeliefMotion, heading_jump, wrong_heading
from simmer_tui.report.causes import Cause, Kind, Sureness, cause_of, undecided_text
from simmer_tui.report.command_audit import (
    multiplied_corrections,
    repeated_movements,
    vanished_movements,
)
from simmer_tui.report.contact_causes import belief_text, contact_causes
from simmer_tui.report.ending_causes import EndingCauses
from simmer_tui.report.finding import FEWEST, Disagreement, Finding, kept_disagreements
from simmer_tui.report.reply_audit import ReplyAudit
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.events import ProgramEnded
from simmer_tui.sim.command import counted

# More devices than that are a whole robot that differs: the table of findings has them all.
_NAMED = 4
# These remain when nothing else holds: they are never a second cause.
_LAST_RESORTS = frozenset((Kind.CLEARANCE, Kind.UNDECIDED, Kind.ENDED, Kind.TOO_SLOW))
# These are actions that a program left out, for whatever reason.
_NOT_DONE = frozenset((Kind.NOT_CARRIED_OUT, Kind.UNREAD))
# These explain an end by themselves: earlier mistakes did not end the run.
_DECISIVE = frozenset((Kind.CRASHED, Kind.NOTHING_SENT))
# These follow from a wrong belief, which the readings in the log would have corrected.
_BY_BELIEF = frozenset((Kind.LOST, Kind.UNSURE))
# Known without the program; it may have crashed because of them.
_FROM_OUTSIDE = frozenset((Kind.SENSOR_WRONG, Kind.DRIVE_WRONG, Kind.MOVED))


def causes_of(
    attempt: Attempt,
    program: ProgramEnded | None = None,
    *,
    cut_off: bool = False,
    findings: Sequence[Finding] = (),
) -> list[Cause]:
    """Causes of a failed run: the first, and a second where another holds as well. Empty if no failure is
    known.

    Args:
        attempt: The run.
        program: End of its program, where it is known and came before the end of the mission.
        cut_off: True if it was ended because real time was up.
        findings: Sensors and drives that are not as they should be.
    """
    over = attempt.over
    has_ended = cut_off or (program is not None and not program.stopped)
    if over is None and attempt.task is not None and not has_ended:
        return []  # a mission under way
    if over is not None and not attempt.failed:
        return []
    endings = EndingCauses(attempt, program, cut_off)
    device, explained = _device_cause(attempt, findings), _explained(attempt, findings)
    standing = list(_ranked(attempt, endings, device, explained))
    return _first_two(standing, endings, [each for each in (device, explained) if each is not None])


def _first_two(standing: list[Cause], endings: EndingCauses, devices: Sequence[Cause]) -> list[Cause]:
    """The first cause, and the next that says something else; `devices` are those that name one."""
    if not standing:
        return []
    first = standing[0]
    known = _LAST_RESORTS | {first.kind, Kind.GOT_NOWHERE}
    other = [each for each in standing if each.kind not in known]
    misled = first.kind in _BY_BELIEF or (first.kind is Kind.CLEARANCE and endings.is_lost)
    # A program that cannot localize itself may crash because of that.
    found = endings.disagreeing() if misled or first.kind in _DECISIVE else None
    disagreeing = [] if found is None else [found]
    if first.kind in _DECISIVE:
        other = [each for each in standing if each.kind in _FROM_OUTSIDE or each in devices]
        other += endings.without_effect() or disagreeing
    elif first.kind is Kind.MOVED:
        # A person who moved the robot explains the rest: only a device that was wrong before adds to it.
        other = [each for each in standing if each in devices]
    elif first in devices:
        # A program that a wrong device misled never came to the actions that it left out.
        other = [each for each in other if each.kind not in _NOT_DONE]
    elif disagreeing:
        return [*disagreeing, first]
    return [first, *(each for each in other if each is not first)][:2]


def _ranked(
    attempt: Attempt, endings: EndingCauses, device: Cause | None, explained: Cause | None
) -> Iterator[Cause]:
    met = attempt.collision
    # A contact that ended the mission decided it, even if the program crashed over it afterwards.
    contacts = contact_causes(attempt, met) if met is not None and attempt.too_many_contacts else []
    if contacts:
        found = _of_contact(contacts, device, explained, endings)
    else:
        made = (endings.crash, endings.silence, endings.moved, endings.block_moved)
        others = (
            *(endings.put_down, endings.asked_after_grip, endings.missed_grip, endings.wrong_when_gripping),
            *(endings.mostly_refused, endings.blocked, endings.nowhere, endings.unread, endings.astray),
            *(endings.never_gripped, endings.refused, endings.slow, endings.ended),
        )
        found = itertools.chain((make() for make in made), (device, explained), (make() for make in others))
    yield from (each for each in found if each is not None)


def _of_contact(
    contacts: Sequence[Cause], device: Cause | None, explained: Cause | None, endings: EndingCauses
) -> Iterator[Cause | None]:
    """The causes of a run that a contact ended."""
    # A person who moved the robot comes before all that follows from it.
    yield endings.moved()
    yield endings.searched()
    yield endings.mostly_refused()
    # Drive errors that led one movement astray need no wrong sensor.
    alone = contacts[0].kind is Kind.DRIVE_ERROR and contacts[0].sure is Sureness.CERTAIN
    nowhere = endings.nowhere()
    yield from (nowhere, contacts[0], device) if alone else (device, explained, nowhere, contacts[0])
    yield from contacts[1:]
    yield endings.block_moved()
    yield endings.asked_after_grip()


def _device_cause(attempt: Attempt, findings: Sequence[Finding]) -> Cause | None:
    """The cause by sensors or drives that are not as their set, or its nominal one, says. No log shows the
    program's use of them, so the cause is likely at most."""
    if not findings or attempt.task is None:
        return None
    drives = {each.code for each in attempt.spec.drives}
    is_drive = findings[0].of in drives
    mine = [each for each in findings if (each.of in drives) is is_drive]
    told = ". ".join(each.text for each in mine[:_NAMED])
    more = f". Besides: {counted(len(mine) - _NAMED, 'other finding')}" if len(mine) > _NAMED else ""
    culprits = tuple(dict.fromkeys(each.of for each in mine))
    device = "drive" if is_drive else "sensor"
    begin = f"A {device} was wrong: " if len(culprits) == 1 else f"{len(culprits)} {device}s were wrong. "
    rest = [each.text for each in findings if each not in mine]
    kind, text = Kind.DRIVE_WRONG if is_drive else Kind.SENSOR_WRONG, f"{begin}{told}{more}."
    evidence = *(f"{each}." for each in rest[:_NAMED]), belief_text(attempt.beliefs[0])
    return cause_of(attempt, kind, text, *evidence, sure=Sureness.LIKELY, culprits=culprits)


def _explained(attempt: Attempt, findings: Sequence[Finding]) -> Cause | None:
    """The cause by a sensor or drive by which program and log differ; None where nothing explains a
    difference."""
    if attempt.task is None:
        return None
    found = disagreements(attempt, {each.of for each in findings})
    if not found:
        return None
    surest = found[0]
    if surest[0].command_lost:
        return _made_of(attempt, surest, Kind.NOT_CARRIED_OUT, surest[0].text)
    # With more explanations than can be named, none is named.
    if len(surest) > _NAMED:
        return None
    names = " or ".join(", ".join(each.of) for each in surest)
    explain = "explain" if len(surest[0].of) > 1 else "explains"
    told = "; or ".join(each.text for each in surest)
    return _made_of(attempt, surest, Kind.UNDECIDED, f"{names} {explain} it: {told}")


def _made_of(attempt: Attempt, found: Sequence[Disagreement], kind: Kind, text: str) -> Cause:
    since = min(found, key=lambda each: each.elapsed)
    begin = f"Program and log disagree from {since.elapsed:.1f} s on"
    text = f"{begin}: {text}." if kind is Kind.NOT_CARRIED_OUT else f"{begin}. {text}."
    evidence = undecided_text("a message was changed or lost"), belief_text(attempt.beliefs[0])
    culprits = tuple(dict.fromkeys(code for each in found for code in each.of))
    return cause_of(attempt, kind, text, *evidence, at=since, sure=Sureness.LIKELY, culprits=culprits)


# -- the program's side ---------------------------------------------------------------------------------


def disagreements(attempt: Attempt, known: Collection[str] = ()) -> list[list[Disagreement]]:
    """The disagreements of program and log, at a familywise error of 1 % a run, the surest first. Each has
    all sensors and drives that explain it equally well.

    Args:
        attempt: The run. A real robot has none: its log does not know its true pose.
        known: Codes of sensors and drives that are not as their set says: that is the stronger explanation.
    """
    if attempt.history.is_twin:
        return []
    tests = [each for row in attempt.spec.drives for each in multiplied_corrections(attempt, row)]
    tests += [vanished_movements(attempt), repeated_movements(attempt)]
    tests += [wrong_heading(attempt), heading_jump(attempt)]
    for since in _stretches(attempt):
        motion = BeliefMotion(attempt, since)
        tests += [*motion.explanations(), motion.unlogged(), ReplyAudit(attempt, since).explanations()]
    kept = kept_disagreements(each for each in tests if each)
    return [each for each in kept if not any(code in known for one in each for code in one.of)]


def _stretches(attempt: Attempt) -> list[int]:
    """The events after which beliefs are audited. One is the robot's last placement, the other the moment
    when the belief became wrong for good, if earlier beliefs agreed with the log."""
    lost = attempt.beliefs[1]
    if lost is None:
        return [attempt.placed]
    before = attempt.history.beliefs.place_of(lost.order) - attempt.history.beliefs.place_of(attempt.placed)
    return [attempt.placed, lost.order - 1] if before >= FEWEST["set"] else [attempt.placed]
