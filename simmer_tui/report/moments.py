"""Moments: the facts of a run, each with its time. The one that is the cause is marked.

Causes are told in the sentences of moments, so each fact has one sentence everywhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.document.formats import COUNT, PASSAGE, Format, number
from simmer_tui.document.model import DataColumn, DataTable, data_table
from simmer_tui.report.finding import Finding
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.run.events import ActionName, NoticeKind, Result
from simmer_tui.run.facts import displacement, missed_zone
from simmer_tui.run.history_rows import ActionRow, NoticeRow
from simmer_tui.run.phrases import (
    grip_ending,
    outside_text,
    place_text,
    pose_text,
    program_end_text,
    sent_by_text,
    times_text,
)
from simmer_tui.sim.command import WORD, cut

MOST_MOMENTS = 7
"""Moments of a run: they fit on a screen, and a reader keeps as many in mind."""


class MomentKind(StrEnum):
    """Kinds of moments of a run, in the order of those of one time: the program's start is before what it
    saw, that before its command, and the end last."""

    BEGAN = "began"
    LOCALIZED = "localized"
    FAULT = "fault"
    PERSON = "person"
    DEVICE = "device"
    BOARD = "board"
    LOST = "lost"
    SIGHT = "last sight"
    COMMAND = "deciding command"
    GOAL = "goal"
    END = "end"
    PROGRAM = "program's end"


_ORDER = list(MomentKind)
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
        """The fact with its time, in a list: `0.6 s: the robot touched the wall`."""
        return f"{self.elapsed:.1f} s: {self.text}"


def told(*moments: Moment | None) -> str:
    """Moments as sentences, in the order of their times: `At 0.6 s, the robot touched the wall.`"""
    known = sorted((each for each in moments if each is not None), key=lambda each: each.elapsed)
    return " ".join(f"At {each.elapsed:.1f} s, {ended(each.text)}" for each in known)


def ended(text: str) -> str:
    """A text as a sentence: one that ends with a question mark gets no full stop."""
    return text if text.endswith("?") else f"{text}."


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


def moments_of(run: RunEvidence, cause: Moment | None = None) -> tuple[Moment, ...]:
    """The moments of an attempt, in order, at most `MOST_MOMENTS`, with that of its cause marked."""
    found = [each for each in _all_moments(run) if each != cause]
    if cause is not None:
        # The set's own errors explain a failure; a success needs no explanation.
        found += [declared_moment(run, code) for code in run.declared]
    # Newer ones of a kind come first: the last goal counts more than the one before.
    ranked = sorted(found, key=lambda each: (_KEPT.index(each.kind), -each.elapsed))
    kinds = [each.kind for each in ranked]
    places = sorted(range(len(ranked)), key=lambda place: (kinds[place] in kinds[:place], place))
    kept = [ranked[place] for place in places]
    if cause is not None:
        kept.insert(0, replace(cause, is_cause=True))
    return tuple(
        sorted(kept[:MOST_MOMENTS], key=lambda each: (each.elapsed, _ORDER.index(each.kind))),
    )


def _all_moments(run: RunEvidence) -> Iterator[Moment]:
    yield _began(run)
    if run.localized is not None and not run.seen.history.is_twin:
        at = run.localized
        yield Moment(
            MomentKind.LOCALIZED, at.elapsed, f"it knew its place, off by {at.distance:.1f} in", at.line
        )
    for goal in run.goals:
        yield Moment(MomentKind.GOAL, goal.elapsed, goal.event.subject.value, goal.line)
    for found in run.findings:
        yield device_moment(run, found)
    yield from _boards(run)
    yield from _people(run)
    one_of_each = (
        *(fault_moment(run), refusal_moment(run), lost_moment(run), sight_moment(run)),
        *(command_moment(run), grip_moment(run), end_moment(run), program_moment(run)),
    )
    yield from (each for each in one_of_each if each is not None)


def device_moment(run: RunEvidence, found: Finding) -> Moment:
    """A sensor or drive that differs from the nominal set, from the beginning on."""
    return Moment(MomentKind.DEVICE, run.seen.begun, found.text, code=found.of)


def declared_moment(run: RunEvidence, code: str) -> Moment:
    """A sensor or drive that differs as its set says, and is no finding."""
    return Moment(
        MomentKind.DEVICE, run.seen.begun, f"{code} {run.declared[code]}, by this robot's set", code=code
    )


def _began(run: RunEvidence) -> Moment:
    seen, history = run.seen, run.seen.history
    if history.is_twin:
        text = "the run began on a real robot, whose true place is not known"
        return Moment(MomentKind.BEGAN, seen.begun, text)
    start = history.start if not seen.placed or seen.placed != history.began else None
    text = "the run began" if start is None else f"the robot began at {pose_text(start)}"
    if len(run.belief.rows):
        first = run.belief.rows[0]
        text += f"; the program first believed it was at {place_text(float(first['x']), float(first['y']))}"
    return Moment(MomentKind.BEGAN, seen.begun, text, place=None if start is None else (start.x, start.y))


def fault_moment(run: RunEvidence) -> Moment | None:
    """The fault that decided, a program that was turned away, or the first fault that was reported."""
    row = run.turned_away
    if row is not None:
        reason = row.text.partition(": ")[2].rstrip(".")
        return Moment(MomentKind.FAULT, row.elapsed, f"a program was turned away: {reason}", row.line)
    row = run.deciding_fault or next(iter(run.faults), None)
    if row is None:
        return None
    refused, of = run.all_refused
    share = f". In all, {run.all_refused_text}" if 2 * refused > of else ""
    return Moment(MomentKind.FAULT, row.elapsed, f"{run.fault_text(row)}{share}", row.line)


def refusal_moment(run: RunEvidence) -> Moment | None:
    """The refused command that decided, or the first one."""
    found = run.refusal
    if found is None:
        return None
    command, reason = found.row.result.command, found.row.result.reason.rstrip(".")
    text = f"{ended(f'{cut(command.shown, WORD)} was refused: {reason}')} In all, {found.text}"
    return Moment(MomentKind.FAULT, found.row.elapsed, text, found.row.line, command.code)


def _boards(run: RunEvidence) -> Iterator[Moment]:
    """The facts of boards: the newest of each place in a sketch."""
    newest: dict[str, NoticeRow] = {}
    for row in run.seen.history.notices.items:
        if row.notice.kind is NoticeKind.BOARD and run.seen.covers(row.order):
            newest[row.notice.subject] = row
    for row in newest.values():
        yield Moment(MomentKind.BOARD, row.elapsed, row.text, row.line)


def _people(run: RunEvidence) -> Iterator[Moment]:
    began = run.seen.history.began
    for row in run.seen.history.actions.items:
        name = row.done.action.name
        has_acted = run.seen.covers(row.order) and name.helps
        if not row.done.refused and (has_acted or (row.order == began and name.restarts)):
            yield person_moment(run, row)


def person_moment(run: RunEvidence, row: ActionRow) -> Moment:
    """An action of a person."""
    deed = f"used {row.done.action.name.value}: {row.done.text}"
    match row.done.action.name:
        case ActionName.TELEPORT:
            way, turn = displacement(row.before, row.done.pose)
            to = place_text(row.done.pose.x, row.done.pose.y)
            deed = f"moved the robot by {way:.0f} in and {abs(turn):.0f} deg, to {to}"
        case ActionName.BLOCK:
            deed = f"moved the block to {place_text(*row.done.action.arguments[:2])}"
        case ActionName.RESET if row is run.seen.reset:
            taken = ", without the block that it had held" if run.seen.emptied else ""
            deed = f"reset the run: the robot was at its start again{taken}, and the program went on"
    at = (row.before.x, row.before.y)
    return Moment(MomentKind.PERSON, row.elapsed, f"a person {deed}", row.line, place=at)


def lost_moment(run: RunEvidence) -> Moment | None:
    """The first wrong belief of those that led to the contact, the grip or the end."""
    lost = run.lost_belief
    if lost is None or run.seen.history.is_twin:
        return None
    off = lost.deviation
    if off.rejects_truth:
        said = f"its belief gave the true cell {100 * lost.true_probability:.0f} %"
    elif off.off_place:
        believed, true = place_text(lost.x, lost.y), place_text(lost.true_x, lost.true_y)
        said = f"it believed it was at {believed} and was at {true}, {lost.error_text} off"
    else:
        said = f"its believed heading was off by {abs(off.turn):.0f} deg"
    since = (
        "it was lost from then on"
        if run.belief.was_right_before(lost.order) or run.seen.was_moved
        else "it never found its place"
    )
    return Moment(
        MomentKind.LOST, lost.elapsed, f"{said}: {since}", lost.line, place=(lost.true_x, lost.true_y)
    )


def sight_moment(run: RunEvidence) -> Moment | None:
    """The last reading of the sensor that looks at the place that was touched."""
    met = run.touched
    if met is None:
        return None
    return Moment(MomentKind.SIGHT, met.seen_at, met.sight_text, code=met.watch)


def command_moment(run: RunEvidence) -> Moment | None:
    """The command whose movement touched something."""
    met = run.touched
    if met is None:
        return None
    row = met.met.row
    often = f" {times_text(run.repeated)} in a row" if run.repeated > 1 else ""
    often = ", and nothing ended it" if met.goes_on else often
    text = f"{sent_by_text(row.ended.command.source, row.shown)}{often}"
    return Moment(MomentKind.COMMAND, met.sent, text, row.line, row.ended.command.code, met.met.contact.point)


def grip_moment(run: RunEvidence) -> Moment | None:
    """The grip that decided: the block was let go and not taken again, or never taken."""
    row, seen = run.last_grip, run.seen
    if row is None:
        return None
    place = row.grip.block.x, row.grip.block.y
    text = f"it {grip_ending(row.grip)}"
    if row.had and not row.grip.closed:
        text = f"it set the block down at {place_text(*place)}"
        zone = None if seen.task is None else seen.task.zone
        off = (0.0, 0.0) if zone is None else missed_zone(zone, *place)
        if zone is not None and any(off):
            text += f", {outside_text(off)} the drop zone's cell around {place_text(zone.x, zone.y)}"
        text += ", where it had lain" if run.left_at_place else ""
        text += f"; it had taken it {times_text(seen.takes)}" if seen.takes > 1 else ""
    elif len(seen.misses) > 1:
        text += f"; it closed on nothing {times_text(len(seen.misses))} in all"
    code = "" if seen.spec.gripper is None else seen.spec.gripper.code
    # Beside a contact it is no decision.
    kind = MomentKind.GOAL if run.has_contact else MomentKind.COMMAND
    return Moment(kind, row.elapsed, text, row.line, code, place)


def end_moment(run: RunEvidence) -> Moment | None:
    """The contact, the silence or the reason that ended the run; None if its program ended by itself."""
    seen, over, met = run.seen, run.seen.over, run.touched
    at, line, place = seen.elapsed, seen.line, (seen.pose.x, seen.pose.y)
    if met is not None and (run.has_contact or run.silence is None):
        at, line, place = met.met.row.elapsed, met.met.row.line, met.met.contact.point
        is_last = not run.has_contact and seen.contacts > 1
        text = f"{met.text}, the last of {seen.contacts} contacts" if is_last else met.text
    elif run.silence is not None and not seen.is_silent:
        at, line, text = run.silence.since, 0, run.silence_text
    elif over is not None and over.event.subject is Result.SUCCESS:
        text = "the mission succeeded"
    elif over is not None and (seen.out_of_time or run.program is None):
        text = f"the mission ended {'at' if seen.out_of_time else 'because'} {over.event.reason}"
    elif run.program is None:
        text = "the program sent no command" if run.last_command is None else "the last command was answered"
        at = at if run.last_command is None else run.last_command[1]
    else:
        return None
    return Moment(MomentKind.END, at, text, line, place=place)


def program_moment(run: RunEvidence) -> Moment | None:
    """The end of the program, with its last output; None after a success."""
    seen, program = run.seen, run.program
    if program is None or (seen.over is not None and seen.over.event.subject is Result.SUCCESS):
        return None
    text = program_end_text(program)
    if not program.crashed:
        text = text.replace("ended with", "ended by itself, with")
    has_time = not (program.crashed or seen.out_of_time or run.has_contact)
    if run.exit_code is not None and seen.task is not None and has_time:
        text += f", before its time limit of {seen.task.time_limit:g} s"
    if run.last_words and not program.crashed:
        text += f"; its last output: {run.last_words.rstrip('.')}"
    return Moment(MomentKind.PROGRAM, seen.elapsed, text, seen.line, place=(seen.pose.x, seen.pose.y))
