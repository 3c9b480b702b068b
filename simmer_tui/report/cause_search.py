"""The search for the causes of a failed run: those that hold, ranked by what would have saved the run.

How the run ended is asked first: by a contact, with its program, or by its time. A sensor or drive that is
not as its set says comes before all that follows from it. So does a run that had come nowhere for hundreds of
movements before it ended somehow.
"""

import itertools
import re
from collections.abc import Iterator, Sequence

from simmer_tui.events import ProgramEnded
from simmer_tui.phrases import counted
from simmer_tui.report.causes import Cause, Kind, Sureness, without_blanks
from simmer_tui.report.contact_causes import belief_text, contact_causes
from simmer_tui.report.ending_causes import EndingCauses
from simmer_tui.report.finding import Finding
from simmer_tui.run.attempt import Attempt

_EXIT_CODE = re.compile(r"exit code (-?\d+)")
# More devices than that are a whole robot that differs: the table of findings has them all.
_NAMED = 4
# These are left when nothing else holds: as a second cause they say nothing.
_LAST_RESORTS = frozenset((Kind.CLEARANCE, Kind.UNDECIDED, Kind.ENDED, Kind.TOO_SLOW))
# These explain an end by themselves: what else went wrong till then did not end the run.
_DECISIVE = frozenset((Kind.CRASHED, Kind.NOTHING_SENT))
# Except what is known apart from the program, and may be what it crashed of.
_FROM_OUTSIDE = frozenset((Kind.SENSOR_WRONG, Kind.DRIVE_WRONG, Kind.MOVED))


def cause_of(
    attempt: Attempt,
    program: ProgramEnded | None = None,
    *,
    cut_off: bool = False,
    findings: Sequence[Finding] = (),
) -> Cause | None:
    """Why a run failed; see `causes_of`."""
    found = causes_of(attempt, program, cut_off=cut_off, findings=findings)
    return found[0] if found else None


def causes_of(
    attempt: Attempt,
    program: ProgramEnded | None = None,
    *,
    cut_off: bool = False,
    findings: Sequence[Finding] = (),
) -> list[Cause]:
    """Why a run failed, and a second cause where another holds as well; none if it did not fail, as far as
    can be seen.

    Args:
        attempt: The run.
        program: End of its program, where it is known and came before the end of the mission.
        cut_off: True if it was ended because real time was up.
        findings: Sensors and drives that are not as they should be.
    """
    over = attempt.over
    # The exit code of a program that the simulator ended says nothing of the program.
    exit_code = None if program is None or program.stopped else program.exit_code
    if over is not None and exit_code is None and (found := _EXIT_CODE.search(over.event.reason)):
        exit_code = int(found[1])
    if over is None and attempt.task is not None and exit_code is None and not cut_off:
        return []  # a mission under way
    if over is not None and not attempt.failed:
        return []
    endings = EndingCauses(attempt, program, exit_code, cut_off)
    return _first_two(list(_ranked(attempt, endings, findings)), endings)


def _first_two(standing: list[Cause], endings: EndingCauses) -> list[Cause]:
    """The first cause, and the next that says something else."""
    if not standing:
        return []
    first = standing[0]
    known = _LAST_RESORTS | {first.kind, Kind.GOT_NOWHERE}
    other = [each for each in standing if each.kind not in known]
    if first.kind in _DECISIVE:
        other = [each for each in other if each.kind in _FROM_OUTSIDE]
    if not other and first.kind is Kind.LOST and (disagreeing := endings.disagreeing()) is not None:
        other = [disagreeing]
    return [first, *other[:1]]


def _ranked(attempt: Attempt, endings: EndingCauses, findings: Sequence[Finding]) -> Iterator[Cause]:
    met, device = attempt.collision, _device_cause(attempt, findings)
    # A contact that ended the mission decided it, even if the program crashed over it afterwards.
    contacts = contact_causes(attempt, met) if met is not None and attempt.too_many_contacts else []
    if contacts:
        found = _of_contact(contacts, device, endings)
    else:
        made = (endings.crash, endings.silence, endings.moved, endings.block_moved)
        others = (
            *(endings.put_down, endings.asked_after_grip, endings.missed_grip, endings.wrong_when_gripping),
            *(endings.blocked, endings.nowhere, endings.unread, endings.astray, endings.never_gripped),
            *(endings.refused, endings.slow, endings.ended),
        )
        found = itertools.chain((make() for make in made), (device,), (make() for make in others))
    yield from (each for each in found if each is not None)


def _of_contact(
    contacts: Sequence[Cause], device: Cause | None, endings: EndingCauses
) -> Iterator[Cause | None]:
    """The causes of a run that a contact ended."""
    # A hand that moved the robot comes before all that follows from it.
    yield endings.moved()
    # What drove one movement astray by itself needs no sensor to be wrong.
    alone = contacts[0].kind is Kind.DRIVE_ERROR and contacts[0].sure is Sureness.CERTAIN
    nowhere = endings.nowhere()
    yield from (nowhere, contacts[0], device) if alone else (device, nowhere, contacts[0])
    yield from contacts[1:]
    yield endings.asked_after_grip()


def _device_cause(attempt: Attempt, findings: Sequence[Finding]) -> Cause | None:
    """Sensors or drives that are not as their set, or its nominal one, says: what the program made of it is
    in no log, so that this is likely at most."""
    if not findings or attempt.task is None:
        return None
    drives = {each.code for each in attempt.spec.drives}
    is_drive = findings[0].of in drives
    mine = [each for each in findings if (each.of in drives) is is_drive]
    told = "; ".join(each.text for each in mine[:_NAMED])
    more = f"; and {counted(len(mine) - _NAMED, 'other finding')}" if len(mine) > _NAMED else ""
    rest = [each.text for each in findings if each not in mine]
    return Cause(
        Kind.DRIVE_WRONG if is_drive else Kind.SENSOR_WRONG,
        f"{'A drive' if is_drive else 'A sensor'} was not as it should be: {told}{more}.",
        without_blanks(*(f"{each}." for each in rest[:_NAMED]), belief_text(attempt.beliefs[0])),
        attempt.elapsed,
        attempt.line,
        (attempt.pose.x, attempt.pose.y),
        sure=Sureness.LIKELY,
        culprits=tuple(dict.fromkeys(each.of for each in mine)),
    )
