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
from simmer_tui.report.why import looks_there, shown_range
from simmer_tui.run.events import ActionName, NoticeKind, Result
from simmer_tui.run.facts import ALIKE
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
    firsts = [
        each for place, each in enumerate(ranked) if each.kind not in {one.kind for one in ranked[:place]}
    ]
    others = [each for each in ranked if each not in firsts]
    kept = ([] if marked is None else [marked]) + firsts + others
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
            text = f"a person used {name.value}: {row.done.text}"
            if name is ActionName.TELEPORT:
                text = f"a person moved the robot to {place_text(row.done.pose.x, row.done.pose.y)}"
            elif name is ActionName.BLOCK:
                text = f"a person moved the block to {place_text(*row.done.action.arguments[:2])}"
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
    seen, met = run.seen, run.contact
    if met is not None and (run.has_contact or seen.task is None):
        row, last = met.met.row, met.facing
        code = row.ended.command.code
        sent = sent_by_text(row.ended.command.source, row.shown)
        yield Moment(MomentKind.COMMAND, met.sent, sent, row.line, code)
        text, sight, at = "no sensor looks at the place that was touched", "", met.sent
        if met.looks is not None and looks_there(met.looks):
            sight = met.looks.codes[0] if last is None else last.code
            who = f"{sight}, which looks there," if met.looks_at(sight) else f"{sight}, the nearest sensor,"
            text = f"{who} was {met.never_read}"
            if last is not None:
                at, off = last.time, abs(last.value - last.true) > 1.0
                true = f"; the true distance was {shown_range(last.true)}" if off else ""
                # It looked elsewhere when it was read.
                then = "; then the robot turned" if row.turned_before - last.turned > ALIKE else ""
                text = f"{who} read {shown_range(last.value)}{true}{then}"
        yield Moment(MomentKind.SIGHT, at, text, code=sight)
    grip = run.last_grip
    if grip is not None:
        block = (grip.grip.block.x, grip.grip.block.y)
        let_go = f"it set the block down at {place_text(*block)}"
        text = let_go if grip.had and not grip.grip.closed else f"it {grip_ending(grip.grip)}"
        closed = run.closed_before(grip)
        if closed is not None and grip.grip.closed:
            text = f"it closed the gripper, which had been closed since {closed.elapsed:.1f} s"
        gripper = seen.spec.gripper
        kind = MomentKind.GOAL if run.has_contact else MomentKind.COMMAND
        code = gripper.code if gripper else ""
        yield Moment(kind, grip.elapsed, text, grip.line, code, block)


def _end(run: RunEvidence) -> Iterator[Moment]:
    seen, over = run.seen, run.seen.over
    pose = (seen.pose.x, seen.pose.y)
    if run.has_contact and run.contact is not None:
        met = run.contact
        yield Moment(
            MomentKind.END, met.met.row.elapsed, met.text, met.met.row.line, place=met.met.contact.point
        )
    elif run.silence is not None and not seen.is_silent:
        limit = "real time limit" if run.cut_off else "time limit"
        end = "" if run.stopped else f"; the run was ended at the {limit}"
        yield Moment(MomentKind.END, run.silence.since, f"no command came any more{end}", place=pose)
    elif over is not None and over.event.subject is Result.SUCCESS:
        yield Moment(MomentKind.END, over.elapsed, "the mission succeeded", over.line, place=pose)
    elif over is not None and (seen.out_of_time or run.program is None):
        yield Moment(
            MomentKind.END,
            over.elapsed,
            f"the mission ended: {over.event.reason}",
            over.line,
            place=pose,
        )
    elif seen.task is None and run.contact is not None:
        met = run.contact
        text = f"the last of {counted(seen.contacts, 'contact')}: {met.text}"
        yield Moment(MomentKind.END, met.met.row.elapsed, text, met.met.row.line, place=met.met.contact.point)
    elif run.program is None:
        text = "the program sent no command" if seen.is_silent else "the last command was answered"
        yield Moment(MomentKind.END, seen.elapsed, text, seen.line, place=pose)
    program = run.program
    if program is not None and not (over is not None and over.event.subject is Result.SUCCESS):
        said = shorten(run.last_words, _WORDS, placeholder=" ...")
        words = f"; its last output: {said}" if said and not program.crashed else ""
        text = program_end_text(program).replace("ended with", "ended by itself, with") + words
        yield Moment(MomentKind.PROGRAM, seen.elapsed, text, seen.line, place=pose)


def _first_sentence(text: str) -> str:
    """The first sentence of a text, without its full stop."""
    return text.partition(". ")[0].rstrip(".")


def _uncapitalized(text: str) -> str:
    first, _, _ = text.partition(" ")
    # The name of a sensor or drive is written as it is.
    return text if not first.isalpha() else f"{text[0].lower()}{text[1:]}"
