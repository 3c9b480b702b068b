"""Events in words, one line each: for the list of events and the line of the last one."""

import math
from collections.abc import Callable, Sequence

from msgspec import Struct

from simmer_tui import events
from simmer_tui.events import Belief, EventHandler, MovementEnded, NoticeKind, Result
from simmer_tui.phrases import WEDGED_TEXT, contact_line, counted, grip_text, movement_text
from simmer_tui.sim.angles import half_turn
from simmer_tui.sim.command import escape
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import CommandResult, Reading, Status
from simmer_tui.snapshot import LogEntry
from simmer_tui.tui.line_panel import StyledLine
from simmer_tui.tui.sensor_readouts import number_text, with_unit

REASONS = (":why", ":report")
"""Orders that explain what went wrong."""
POINTER = ":why says why it ended as it did, :report what happened"
PEOPLE = ("console", "keys")
"""Sources of commands and actions that are somebody at the screen."""
_NOTICE_ROLES = {
    NoticeKind.FAULT: "danger",
    NoticeKind.TURNED_AWAY: "warning",
    NoticeKind.PROGRAM: "plain",
    NoticeKind.VERDICT: "bold",
}
_NOTICE_SOURCES = {NoticeKind.PROGRAM: "program", NoticeKind.VERDICT: "verdict"}
_AFTER_THE_END = (NoticeKind.LEFT, NoticeKind.PROGRAM)
"""Notices of a program that are no news once its mission is over."""
# The longest usual command, `r1--180`, and a space.
_COMMAND = 8
"""Columns of a command."""
# A program's note may be a page; the list has a line for it.
_LONGEST_NOTE = 200


def clock(seconds: float) -> str:
    """Simulated time as minutes and seconds, `02:03.5`."""
    sign = "-" if seconds < 0 else ""
    tenths = round(abs(seconds) * 10)
    return f"{sign}{tenths // 600:02d}:{tenths % 600 / 10:04.1f}"


def reply_text(result: CommandResult) -> str:
    """A reply as people read it."""
    if result.status is Status.READING and result.reading is not None:
        return with_unit(result.reply, result.reading.sensor)
    words = {Status.DONE: "done", Status.ACCEPTED: "under way", Status.STOPPED: "stopped"}
    return words.get(result.status, "NaN")


def belief_texts(belief: Belief) -> tuple[str, str]:
    """A belief, and its error when it was told."""
    pose, true = belief.pose, belief.true
    apart = math.hypot(pose.x - true.x, pose.y - true.y)
    turned = abs(half_turn(pose.heading - true.heading))
    spread = "" if belief.spread is None else f", spread {belief.spread:.0f}"
    return pose_text(pose), f"{apart:.1f} in {turned:.0f} deg{spread}"


def pose_text(pose: Pose) -> str:
    """A pose, its heading from -180 to 180 degrees."""
    return f"{pose.x:.1f}, {pose.y:.1f} in  {half_turn(pose.heading):.1f} deg"


# -- one entry -------------------------------------------------------------------------------------


class EventWords(Struct, frozen=True):
    """Words for one event.

    Attributes:
        source: giver of the event: `client`, `console`, `keys`, `belief`, `robot`, or `program` for its
            output.
        subject: command, or kind of event.
        told: makes the pieces that tell what happened.
        complaint: reason why a command or action was refused; empty if it was not, None for other events.
        result: a mission's, with the event of its end.
        is_departure: true for what a program does after its end.
    """

    source: str = "robot"
    subject: str = ""
    told: Callable[[], StyledLine] = tuple
    complaint: str | None = None
    result: Result | None = None
    is_departure: bool = False


class _Wording(EventHandler[EventWords]):
    """Words for each kind of event; `nearest` is the reading of the sensor that looks at a contact, `wedged`
    tells that it was one of many in one place."""

    def __init__(self, nearest: Reading | None = None, *, wedged: bool = False) -> None:
        self._nearest, self._wedged = nearest, wedged

    def other(self, event: events.Event) -> EventWords:
        return EventWords()

    def on_planned(self, event: events.MovementPlanned) -> EventWords:
        return EventWords(event.command.source)

    def on_ended(self, event: MovementEnded) -> EventWords:
        command = event.command
        return EventWords(command.source, command.shown, lambda: self._end_pieces(event), "")

    def on_result(self, event: CommandResult) -> EventWords:
        command, reason = event.command, event.reason

        def told() -> StyledLine:
            reply = reply_text(event)
            return ((reply, "danger"), (f"  {reason}", "warning")) if reason else ((reply, "value"),)

        return EventWords(command.source, command.shown, told, f"{command.shown}: {reason}" if reason else "")

    def on_action(self, event: events.ActionDone) -> EventWords:
        name = event.action.name.value
        arguments = "".join(f" {number:g}" for number in event.action.arguments)
        done: StyledLine = ((event.text, "danger" if event.refused else "good"),)
        complaint = f"{name}: {event.text}" if event.refused else ""
        return EventWords(event.action.source, f"{name}{arguments}", lambda: done, complaint)

    def on_belief(self, event: Belief) -> EventWords:
        def told() -> StyledLine:
            believed, off = belief_texts(event)
            note = f"  {escape(event.note, _LONGEST_NOTE)}" if event.note else ""
            return (f"{believed}, off {off}", "belief"), (note, "plain")

        return EventWords("belief", "belief", told)

    def on_twin(self, event: events.TwinReading) -> EventWords:
        text = f"robot {number_text(event.robot)}, simulated {number_text(event.simulated)}"
        return EventWords(event.command.source, event.code, lambda: ((text, "belief"),))

    def on_mission(self, event: events.MissionEvent) -> EventWords:
        result = event.subject if isinstance(event.subject, Result) and event.over else None
        return EventWords(subject="mission", told=lambda: _mission_pieces(event), result=result)

    def on_notice(self, event: events.Notice) -> EventWords:
        source = _NOTICE_SOURCES.get(event.kind, "robot")
        text: StyledLine = ((event.text, _NOTICE_ROLES.get(event.kind, "good")),)
        return EventWords(source, source, lambda: text, is_departure=event.kind in _AFTER_THE_END)

    def _end_pieces(self, ended: MovementEnded) -> StyledLine:
        """End of a movement."""
        if ended.grip is not None:
            return ((grip_text(ended.grip), "value"),)
        contact = ended.contact
        by = f", stopped by {ended.stopped_by}" if ended.stopped_by else ""
        if contact is None:
            return ((f"{movement_text(ended)}{by}", "value"),)
        pieces: StyledLine = (("X", "contact"), (f" {contact_line(ended, contact)}{by}", "danger"))
        if self._wedged:
            return (*pieces, (f"  {WEDGED_TEXT}", "warning"))
        nearest = self._nearest
        if nearest is None:
            return (*pieces, ("  no sensor looked there since the last movement", "dim"))
        unit = f" {nearest.sensor.unit}" if math.isfinite(nearest.value) else ""
        return (*pieces, (f"  nearest {nearest.sensor.code} said {nearest.value:.1f}{unit}", "dim"))


def words_of(entry: LogEntry) -> EventWords:
    """Words for an entry's event."""
    return _Wording(entry.nearest, wedged=entry.wedged).handle(entry.event)


def entry_line(entry: LogEntry) -> StyledLine:
    """An entry: simulated time, the command, its effect, and who gave it if it was a person."""
    if entry.folds:
        return (*_head(entry, ""), (folded_text(entry), "dim"))
    words = words_of(entry)
    signed = words.complaint is not None and words.source in PEOPLE
    by = ((f"  by {words.source}", "dim"),) if signed else ()
    return (*_head(entry, words.subject), *words.told(), *by)


def _mission_pieces(event: events.MissionEvent) -> StyledLine:
    """Text of a mission's event; of a failure the reason first, then the totals."""
    text = event.text.removeprefix("mission: ")
    if not event.reason:
        return ((text, "good"),)
    totals = text.removeprefix(event.subject.value).removesuffix(f": {event.reason}").strip()
    failed: StyledLine = ((f"{event.subject.value}: {event.reason}", "danger"),)
    return (*failed, (f"  {totals}", "dim")) if totals else failed


def _head(entry: LogEntry, command: str) -> StyledLine:
    return (f"{clock(entry.time)}  ", "dim"), (f"{command:<{_COMMAND - 1}} ", "mark")


# -- several entries -------------------------------------------------------------------------------


def kept_lines(entry: LogEntry) -> list[StyledLine]:
    """Lines of what is folded into an entry, as far as it has been kept."""
    lines = [entry_line(each) for each in entry.kept]
    if entry.missing > 0:
        lines.insert(0, (*_head(entry, ""), (f"  {entry.missing} before these are counted only", "dim")))
    return lines


def folded_text(entry: LogEntry) -> str:
    """Numbers of readings and beliefs that are folded into an entry."""
    parts = ((entry.readings, "reading"), (entry.beliefs, "belief"))
    return ", ".join(counted(count, noun) for count, noun in parts if count)


def last_event_line(entries: Sequence[LogEntry]) -> StyledLine:
    """The last event in one line, and the number of readings since; empty without any."""
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
        words = words_of(entry)
        if words.result is not None:
            return entry
        if not words.is_departure:
            break
    return told[-1] if told else None


def has_failed(entries: Sequence[LogEntry]) -> bool:
    """True if one of these entries is the end of a mission that failed."""
    return any(words_of(entry).result is Result.FAILED for entry in entries)


def complaint_of(entries: Sequence[LogEntry], since: int = 0) -> str | None:
    """Reason why a person's last command or action after the event `since` was refused; empty if it was
    not, None without such."""
    for entry in reversed(entries):
        if entry.number <= since:
            break
        if entry.folds:
            found = complaint_of(entry.kept, since)
        else:
            words = words_of(entry)
            found = words.complaint if words.source in PEOPLE else None
        if found is not None:
            return found
    return None
