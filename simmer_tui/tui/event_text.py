"""Events in words, one line each: what the list of events and the line of the last one say."""

from __future__ import annotations

import math
from collections.abc import Sequence

from simmer_tui.events import (
    ActionDone,
    Belief,
    Event,
    EventHandler,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
    Result,
    TwinReading,
)
from simmer_tui.phrases import contact_line, counted, grip_text, movement_text
from simmer_tui.sim.angles import half_turn
from simmer_tui.sim.command import escape
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import CommandResult, Reading, Status
from simmer_tui.snapshot import LogEntry
from simmer_tui.tui.line_panel import StyledLine
from simmer_tui.tui.sensor_readouts import number_text, with_unit

REASONS = (":why", ":report")
"""Orders that explain what went wrong."""
POINTER = ":why says why the last movement ended as it did, :report what happened"
PEOPLE = ("console", "keys")
"""Sources of commands and actions that are somebody at the screen."""
_NOTICE_ROLES = {NoticeKind.FAULT: "danger", NoticeKind.TURNED_AWAY: "warning", NoticeKind.PROGRAM: "plain"}
_AFTER_THE_END = (NoticeKind.LEFT, NoticeKind.PROGRAM)
"""What a program does once its mission is over is no news."""
_COMMAND = 8
"""Columns of a command."""


def clock(seconds: float) -> str:
    """Simulated time as minutes and seconds, `02:03.5`."""
    sign = "-" if seconds < 0 else ""
    tenths = round(abs(seconds) * 10)
    return f"{sign}{tenths // 600:02d}:{tenths % 600 / 10:04.1f}"


def reply_text(outcome: CommandResult) -> str:
    """A reply as people read it."""
    if outcome.status is Status.READING and outcome.reading is not None:
        return with_unit(outcome.reply, outcome.reading.sensor)
    words = {Status.DONE: "done", Status.ACCEPTED: "under way", Status.STOPPED: "stopped"}
    return words.get(outcome.status, "NaN")


def belief_texts(belief: Belief) -> tuple[str, str]:
    """A belief, and how wrong it was when it was told."""
    pose, true = belief.pose, belief.true
    apart = math.hypot(pose.x - true.x, pose.y - true.y)
    turned = abs(half_turn(pose.heading - true.heading))
    spread = "" if belief.spread is None else f", spread {belief.spread:.0f}"
    return pose_text(pose), f"{apart:.1f} in {turned:.0f} deg{spread}"


def pose_text(pose: Pose) -> str:
    """Where something is, its heading from -180 to 180 degrees."""
    return f"{pose.x:.1f}, {pose.y:.1f} in  {half_turn(pose.heading):.1f} deg"


def entry_source(entry: LogEntry) -> str:
    """Whose entry it is: `client`, `console`, `keys`, `belief`, `program` for what it prints, or `robot`."""
    return _SOURCES.handle(entry.event)


class _Source(EventHandler[str]):
    def other(self, event: Event) -> str:
        return "robot"

    def on_result(self, event: CommandResult) -> str:
        return event.command.source

    def on_planned(self, event: MovementPlanned) -> str:
        return event.command.source

    def on_ended(self, event: MovementEnded) -> str:
        return event.command.source

    def on_twin(self, event: TwinReading) -> str:
        return event.command.source

    def on_action(self, event: ActionDone) -> str:
        return event.action.source

    def on_belief(self, event: Belief) -> str:
        return "belief"

    def on_notice(self, event: Notice) -> str:
        return "program" if event.kind is NoticeKind.PROGRAM else "robot"


_SOURCES = _Source()


def entry_line(entry: LogEntry) -> StyledLine:
    """An entry: simulated time, the command, what came of it, and who gave it if it was a person."""
    if entry.folds:
        return (*_head(entry, ""), (folded_text(entry), "dim"))
    subject, pieces = _Words(entry).handle(entry.event)
    return (*_head(entry, subject), *pieces)


class _Words(EventHandler[tuple[str, StyledLine]]):
    """What an entry is about, and what happened."""

    def __init__(self, entry: LogEntry) -> None:
        self._entry = entry
        source = entry_source(entry)
        self._by: StyledLine = ((f"  by {source}", "dim"),) if source in PEOPLE else ()

    def other(self, event: Event) -> tuple[str, StyledLine]:
        return "", ()

    def on_ended(self, event: MovementEnded) -> tuple[str, StyledLine]:
        return event.command.shown, (*_end_pieces(event, self._entry.nearest), *self._by)

    def on_result(self, event: CommandResult) -> tuple[str, StyledLine]:
        role = "danger" if event.reason else "value"
        reason = ((f"  {event.reason}", "warning"),) if event.reason else ()
        return event.command.shown, ((reply_text(event), role), *reason, *self._by)

    def on_action(self, event: ActionDone) -> tuple[str, StyledLine]:
        arguments = " ".join(f"{number:g}" for number in event.action.arguments)
        name = f"{event.action.name.value} {arguments}".rstrip()
        return name, ((event.text, "danger" if event.refused else "good"), *self._by)

    def on_belief(self, event: Belief) -> tuple[str, StyledLine]:
        believed, off = belief_texts(event)
        note = f"  {escape(event.note, 200)}" if event.note else ""
        return "belief", ((f"{believed}, off {off}", "belief"), (note, "plain"))

    def on_twin(self, event: TwinReading) -> tuple[str, StyledLine]:
        text = f"robot {number_text(event.robot)}, simulated {number_text(event.simulated)}"
        return event.code, ((text, "belief"),)

    def on_mission(self, event: MissionEvent) -> tuple[str, StyledLine]:
        return "mission", _mission_pieces(event)

    def on_notice(self, event: Notice) -> tuple[str, StyledLine]:
        return entry_source(self._entry), ((event.text, _NOTICE_ROLES.get(event.kind, "good")),)


def kept_lines(entry: LogEntry) -> list[StyledLine]:
    """What is folded into an entry, as far as it has been kept."""
    lines = [entry_line(each) for each in entry.kept]
    if entry.missing > 0:
        lines.insert(0, (*_head(entry, ""), (f"  {entry.missing} before these are counted only", "dim")))
    return lines


def folded_text(entry: LogEntry) -> str:
    """How much is folded into an entry."""
    parts = ((entry.readings, "reading"), (entry.beliefs, "belief"))
    return ", ".join(counted(count, noun) for count, noun in parts if count)


def last_event_line(entries: Sequence[LogEntry]) -> StyledLine:
    """The last event in one line, and how many readings have come since; empty without any."""
    if not entries:
        return ()
    last, newest = _last_told(entries), entries[-1]
    if last is None:
        return entry_line(newest)
    since = f"   then {folded_text(newest)}" if newest.folds else ""
    return (*entry_line(last), (since, "dim"))


def _last_told(entries: Sequence[LogEntry]) -> LogEntry | None:
    """The last entry with a line of its own. A mission's end outweighs that its program left then."""
    told = [entry for entry in entries if not entry.folds]
    for entry in reversed(told):
        weight = _END_WEIGHT.handle(entry.event)
        if weight == 1:
            return entry
        if weight == 0:
            break
    return told[-1] if told else None


def has_failed(entries: Sequence[LogEntry]) -> bool:
    """True if one of these entries is the end of a mission that failed."""
    return any(map(_Failure().handle, [entry.event for entry in entries]))


class _Failure(EventHandler[bool]):
    def on_mission(self, event: MissionEvent) -> bool:
        return event.subject is Result.FAILED


class _EndWeight(EventHandler[int]):
    """1 for the end of a mission, -1 for what is no news after it, 0 for all else."""

    def other(self, event: Event) -> int:
        return 0

    def on_mission(self, event: MissionEvent) -> int:
        return int(event.over)

    def on_notice(self, event: Notice) -> int:
        return -1 if event.kind in _AFTER_THE_END else 0


_END_WEIGHT = _EndWeight()


def complaint_of(entries: Sequence[LogEntry], since: int = 0) -> str | None:
    """What was wrong with what a person asked for last, after the event `since`; empty if nothing,
    None without such."""
    for entry in reversed(entries):
        if entry.number <= since:
            break
        if entry.folds:
            found = complaint_of(entry.kept, since)
            if found is not None:
                return found
            continue
        if entry_source(entry) in PEOPLE and (found := _COMPLAINTS.handle(entry.event)) is not None:
            return found
    return None


class _Complaint(EventHandler["str | None"]):
    def on_result(self, event: CommandResult) -> str:
        return f"{event.command.shown}: {event.reason}" if event.reason else ""

    def on_ended(self, event: MovementEnded) -> str:
        return ""

    def on_action(self, event: ActionDone) -> str:
        return f"{event.action.name.value}: {event.text}" if event.refused else ""


_COMPLAINTS = _Complaint()


def _end_pieces(ended: MovementEnded, nearest: Reading | None) -> StyledLine:
    """How a movement ended."""
    if ended.grip is not None:
        return ((grip_text(ended.grip), "value"),)
    contact = ended.contact
    by = f", stopped by {ended.stopped_by}" if ended.stopped_by else ""
    if contact is None:
        return ((f"{movement_text(ended)}{by}", "value"),)
    pieces: StyledLine = (("X", "contact"), (f" {contact_line(ended, contact)}{by}", "danger"))
    if nearest is None:
        return (*pieces, ("  no sensor looked there since the last movement", "dim"))
    return (*pieces, (f"  nearest {nearest.sensor.code} said {_said(nearest)}", "dim"))


def _said(reading: Reading) -> str:
    unit = f" {reading.sensor.unit}" if math.isfinite(reading.value) else ""
    return f"{reading.value:.1f}{unit}"


def _mission_pieces(event: MissionEvent) -> StyledLine:
    """What a mission's event says; of a failure the reason first, then the totals."""
    text = event.text.removeprefix("mission: ")
    if not event.reason:
        return ((text, "good"),)
    totals = text.removeprefix(event.subject.value).removesuffix(f": {event.reason}").strip()
    failed: StyledLine = ((f"{event.subject.value}: {event.reason}", "danger"),)
    return (*failed, (f"  {totals}", "dim")) if totals else failed


def _head(entry: LogEntry, command: str) -> StyledLine:
    return (f"{clock(entry.time)}  ", "dim"), (f"{command:<{_COMMAND - 1}} ", "mark")
