"""Moments: at most seven facts of a run in order, each with its time. The one that is the cause is marked."""

from __future__ import annotations

from collections.abc import Iterator
from textwrap import shorten

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.document.formats import COUNT, PASSAGE, Format, number
from simmer_tui.document.model import DataColumn, DataTable, data_table
from simmer_tui.report.cause_text import lost_text
from simmer_tui.report.causes import Cause, MomentKind
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.run.events import ActionName, NoticeKind, Result
from simmer_tui.run.history_rows import NoticeRow
from simmer_tui.run.phrases import grip_ending, place_text, pose_text, program_end_text, sent_by_text
from simmer_tui.sim.command import WORD, counted, cut

MOST_MOMENTS = 7
"""Moments of a run: they fit on a screen, and a reader keeps as many in mind."""
_WORDS = 80
"""Characters of a program's last output in a moment: a line of a terminal."""
_KEPT = (
    MomentKind.END,
    MomentKind.COMMAND,
    MomentKind.SIGHT,
    MomentKind.FAULT,
    MomentKind.BOARD,
    MomentKind.LOST,
    MomentKind.DEVICE,
    MomentKind.PERSON,
    MomentKind.GOAL,
    MomentKind.BEGAN,
    MomentKind.PROGRAM,
    MomentKind.LOCALIZED,
)
"""Kinds of moments, those that are kept longest first."""


_DEEDS = {ActionName.TELEPORT: "moved the robot", ActionName.BLOCK: "moved the block"}
"""Actions of people whose names are not those of what they do."""


class Moment(Struct, frozen=True):
    """One fact of a run: `text` says it, without its time. `elapsed` is in seconds, `line` that of the log (0
    without one), `code` the sensor's, drive's or command's, `place` in inches. `is_cause` marks the cause."""

    kind: MomentKind
    elapsed: float
    text: str
    line: int = 0
    code: str = ""
    place: tuple[float, float] | None = None
    is_cause: bool = False

    @property
    def sentence(self) -> str:
        """The fact with its time: `0.6 s: the robot touched the wall`."""
        return f"{self.elapsed:.1f} s: {self.text}"


_PLACE = Format(str, ("x_in", "y_in"), tuple)
MOMENTS = data_table(
    "moments",
    "What happened",
    DataColumn("time_s", number(".2f")),
    DataColumn("is_cause", Format(lambda is_cause: ">" if is_cause else ""), ""),
    DataColumn("kind", hidden=True),
    DataColumn("text", PASSAGE, "what", wraps=True),
    DataColumn("code", hidden=True),
    DataColumn("", _PLACE, hidden=True),
    DataColumn("line", COUNT),
)


def moments_table(moments: tuple[Moment, ...]) -> DataTable:
    """The moments, a row each."""
    rows = [
        (
            each.elapsed,
            each.is_cause,
            each.kind.value,
            each.text,
            each.code or None,
            each.place,
            each.line or None,
        )
        for each in moments
    ]
    note = "The line with > is the cause." if any(each.is_cause for each in moments) else ""
    return MOMENTS.filled(rows, note)


def moments_of(run: RunEvidence, cause: Cause | None = None) -> tuple[Moment, ...]:
    """The moments of an attempt, in order, at most `MOST_MOMENTS`."""
    found = list(_all_moments(run))
    marked: Moment | None = None
    if cause is not None:
        # The same fact is marked where the moments have it; another of its kind stays.
        same = [each for each in found if each.kind is cause.moment and each.elapsed == cause.elapsed]
        if same:
            found.remove(same[-1])
            marked = replace(same[-1], is_cause=True)
        else:
            code = cause.culprits[0] if cause.culprits else ""
            text = _uncapitalized(_first_sentence(cause.text))
            marked = Moment(cause.moment, cause.elapsed, text, cause.line, code, cause.place, is_cause=True)
    # Newer ones of a kind come first: the last goal counts more than the one before.
    ranked = sorted(found, key=lambda each: (_KEPT.index(each.kind), -each.elapsed))
    kinds = [each.kind for each in ranked]
    places = sorted(range(len(ranked)), key=lambda place: (kinds[place] in kinds[:place], place))
    kept = ([] if marked is None else [marked]) + [ranked[place] for place in places]
    return tuple(sorted(kept[:MOST_MOMENTS], key=lambda each: (each.elapsed, _ORDER[each.kind])))


# Of one time: the program's start before what it saw, that before its command, and the end last.
_ORDER = {kind: place for place, kind in enumerate(MomentKind)}


def _all_moments(run: RunEvidence) -> Iterator[Moment]:
    seen, history = run.seen, run.seen.history
    start = history.start if not seen.placed or seen.placed != history.began else None
    first = next(iter(run.belief.rows), None) if len(run.belief.rows) else None
    began = "the run began" if start is None else f"the robot began at {pose_text(start)}"
    if history.is_twin:
        began = "the run began on a real robot, whose true place is not known"
    elif first is not None:
        began += f"; the program first believed to be at {place_text(float(first['x']), float(first['y']))}"
    place = None if start is None or history.is_twin else (start.x, start.y)
    yield Moment(MomentKind.BEGAN, seen.begun, began, place=place)
    if run.localized is not None and not seen.history.is_twin:
        each = run.localized
        yield Moment(
            MomentKind.LOCALIZED, each.elapsed, f"it knew its place, off by {each.distance:.1f} in", each.line
        )
    for goal in run.goals:
        yield Moment(MomentKind.GOAL, goal.elapsed, goal.event.subject.value, goal.line)
    yield from _fault(run)
    yield from _boards(run)
    yield from _person(run)
    yield from _lost(run)
    yield from _deciding(run)
    yield from _end(run)


def _fault(run: RunEvidence) -> Iterator[Moment]:
    fault, refused = next(iter(run.faults), None), next(iter(run.seen.refusals), None)
    refused = refused if run.mostly_refused is None else run.mostly_refused[-1]
    count, of = run.all_refused
    fault_text = next(iter(run.fault_texts), "")
    if fault is not None and (refused is None or fault.notice.advice or fault.elapsed <= refused.elapsed):
        share = f"{count} of {counted(of, 'command')} were refused: " if 2 * count > of else ""
        yield Moment(MomentKind.FAULT, fault.elapsed, f"{share}{fault_text}", fault.line)
    elif refused is not None:
        command, reason = refused.result.command, refused.result.reason
        others = f"; in all, {count} of {of} commands were refused" if count > 1 else ""
        text = f"{cut(command.shown, WORD)} was refused: {reason}{others}"
        yield Moment(MomentKind.FAULT, refused.elapsed, text, refused.line, command.code)


def _boards(run: RunEvidence) -> Iterator[Moment]:
    """The facts of boards: the newest of each place in a sketch."""
    newest: dict[str, NoticeRow] = {}
    for row in run.seen.history.notices.items:
        if row.notice.kind is NoticeKind.BOARD and row.order > run.seen.history.began:
            newest[row.notice.subject] = row
    for row in newest.values():
        yield Moment(MomentKind.BOARD, row.elapsed, row.text, row.line)


def _person(run: RunEvidence) -> Iterator[Moment]:
    began = run.seen.history.began
    for row in run.seen.history.actions.items:
        name = row.done.action.name
        has_acted = row.order > began and name.helps
        if not row.done.refused and (has_acted or (row.order == began and name.restarts)):
            text = f"a person {_DEEDS.get(name, f'used {name.value}')}: {row.done.text}"
            yield Moment(MomentKind.PERSON, row.elapsed, text, row.line)


def _lost(run: RunEvidence) -> Iterator[Moment]:
    lost = run.seen.beliefs[1]
    if lost is None or run.seen.history.is_twin:
        return
    off = f", {lost.error_text} off" if lost.deviation.off_place else ""
    text = f"{lost_text(run, lost)}{off}"
    yield Moment(MomentKind.LOST, lost.elapsed, text, lost.line, place=(lost.true_x, lost.true_y))


def _deciding(run: RunEvidence) -> Iterator[Moment]:
    """The last sight and the command of a contact, and the grip that decided."""
    seen, met, grip = run.seen, run.contact, run.last_grip
    if met is not None and (run.has_contact or seen.task is None):
        row, last = met.met.row, met.facing
        sent = sent_by_text(row.ended.command.source, row.shown)
        yield Moment(MomentKind.COMMAND, met.sent, sent, row.line, row.ended.command.code)
        at = met.sent if last is None else last.time
        yield Moment(MomentKind.SIGHT, at, met.sight_text, code=met.looking)
    if grip is not None:
        place, kind = (grip.grip.block.x, grip.grip.block.y), MomentKind.COMMAND
        is_let_go = grip.had and not grip.grip.closed
        text = (
            f"it set the block down at {place_text(*place)}" if is_let_go else f"it {grip_ending(grip.grip)}"
        )
        if run.has_contact:
            kind = MomentKind.GOAL
        code = seen.spec.gripper.code if seen.spec.gripper else ""
        yield Moment(kind, grip.elapsed, text, grip.line, code, place)


def _end(run: RunEvidence) -> Iterator[Moment]:
    seen, over, program = run.seen, run.seen.over, run.program
    at, line, place = seen.elapsed, seen.line, (seen.pose.x, seen.pose.y)
    if run.contact is not None and (run.has_contact or (seen.task is None and run.silence is None)):
        row = run.contact.met.row
        at, line, place = row.elapsed, row.line, run.contact.met.contact.point
        count = "" if run.has_contact else f"the last of {counted(seen.contacts, 'contact')}: "
        text = f"{count}{run.contact.text}"
    elif run.silence is not None and not seen.is_silent:
        limit = (
            "" if run.stopped else f"; the run was ended at the {'real ' if run.cut_off else ''}time limit"
        )
        at, line, text = run.silence.since, 0, f"no command came any more{limit}"
    elif over is not None and over.event.subject is Result.SUCCESS:
        text = "the mission succeeded"
    elif over is not None and (seen.out_of_time or program is None):
        text = f"the mission ended: {over.event.reason}"
    elif program is None:
        text = "the program sent no command" if seen.is_silent else "the last command was answered"
    else:
        # The end of a program that ended by itself is the end of its mission.
        text = ""
    if text:
        yield Moment(MomentKind.END, at, text, line, place=place)
    has_ended = over is None or over.event.subject is not Result.SUCCESS
    if program is not None and has_ended:
        said = shorten(run.last_words, _WORDS, placeholder=" ...")
        words = f"; its last output: {said}" if said and not program.crashed else ""
        text = program_end_text(program).replace("ended with", "ended by itself, with") + words
        yield Moment(MomentKind.PROGRAM, seen.elapsed, text, seen.line, place=(seen.pose.x, seen.pose.y))


def _first_sentence(text: str) -> str:
    """The first sentence of a text, without its full stop."""
    return text.partition(". ")[0].rstrip(".")


def _uncapitalized(text: str) -> str:
    first, _, _ = text.partition(" ")
    # The name of a sensor or drive is written as it is.
    return text if not first.isalpha() else f"{text[0].lower()}{text[1:]}"
