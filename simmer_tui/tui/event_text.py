"""Events in words, one line each: what the list of events and the line of the last one say."""

from __future__ import annotations

import math
from collections.abc import Sequence

from simmer_tui.events import (
    ActionDone,
    Belief,
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
    match entry.event:
        case CommandResult(command=command) | TwinReading(command=command):
            return command.source
        case MovementPlanned(command=command) | MovementEnded(command=command):
            return command.source
        case ActionDone(action=action):
            return action.source
        case Belief():
            return "belief"
        case Notice(kind=NoticeKind.PROGRAM):
            return "program"
    return "robot"


def entry_line(entry: LogEntry) -> StyledLine:
    """An entry: simulated time, the command, what came of it, and who gave it if it was a person."""
    if entry.folds:
        return (*_head(entry, ""), (folded_text(entry), "dim"))
    event = entry.event
    source = entry_source(entry)
    by = ((f"  by {source}", "dim"),) if source in PEOPLE else ()
    match event:
        case MovementEnded():
            return (*_head(entry, event.command.shown), *_end_pieces(event, entry.nearest), *by)
        case CommandResult():
            role = "danger" if event.reason else "value"
            reason = ((f"  {event.reason}", "warning"),) if event.reason else ()
            return (*_head(entry, event.command.shown), (reply_text(event), role), *reason, *by)
        case ActionDone():
            arguments = " ".join(f"{number:g}" for number in event.action.arguments)
            name = f"{event.action.name.value} {arguments}".rstrip()
            return (*_head(entry, name), (event.text, "danger" if event.refused else "good"), *by)
        case Belief():
            believed, off = belief_texts(event)
            note = f"  {escape(event.note, 200)}" if event.note else ""
            return (*_head(entry, "belief"), (f"{believed}, off {off}", "belief"), (note, "plain"))
        case TwinReading():
            text = f"robot {number_text(event.robot)}, simulated {number_text(event.simulated)}"
            return (*_head(entry, event.code), (text, "belief"))
        case MissionEvent():
            return (*_head(entry, "mission"), *_mission_pieces(event))
        case Notice():
            return (*_head(entry, source), (event.text, _NOTICE_ROLES.get(event.kind, "good")))
    return _head(entry, "")


def kept_lines(entry: LogEntry) -> list[StyledLine]:
    """What is folded into an entry, as far as it has been kept."""
    lines = [entry_line(each) for each in entry.kept]
    missing = entry.readings + entry.beliefs - sum(not _is_twin(each) for each in entry.kept)
    if missing > 0:
        lines.insert(0, (*_head(entry, ""), (f"  {missing} before these are counted only", "dim")))
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
        event = entry.event
        if isinstance(event, MissionEvent) and event.over:
            return entry
        if not isinstance(event, Notice) or event.kind not in _AFTER_THE_END:
            break
    return told[-1] if told else None


def has_failed(entries: Sequence[LogEntry]) -> bool:
    """True if one of these entries is the end of a mission that failed."""
    events = [entry.event for entry in entries]
    return any(isinstance(event, MissionEvent) and event.subject is Result.FAILED for event in events)


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
        match entry.event:
            case CommandResult(command=command, reason=reason) if command.source in PEOPLE:
                return f"{command.shown}: {reason}" if reason else ""
            case MovementEnded(command=command) if command.source in PEOPLE:
                return ""
            case ActionDone(action=action, refused=refused, text=text) if action.source in PEOPLE:
                return f"{action.name.value}: {text}" if refused else ""
    return None


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


def _is_twin(entry: LogEntry) -> bool:
    return isinstance(entry.event, TwinReading)
