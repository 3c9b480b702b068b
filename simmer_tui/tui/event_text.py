"""Events in words, one line each: for the list of events and for the line of the last one."""

import math
from collections.abc import Callable, Sequence

from msgspec import Struct

from simmer_tui.live.snapshot import LogEntry
from simmer_tui.run import events
from simmer_tui.run.belief_grid import GridBelief
from simmer_tui.run.events import Belief, EventHandler, MovementEnded, NoticeKind
from simmer_tui.run.facts import deviation, displacement
from simmer_tui.run.phrases import (
    WEDGED_TEXT,
    contact_line,
    grip_text,
    movement_text,
    scan_text,
    stopped_by_text,
    velocity_text,
    went_text,
)
from simmer_tui.sim.angles import half_turn
from simmer_tui.sim.command import PEOPLE, counted, utf8_text
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import CommandResult, Reading, Status
from simmer_tui.tui.gauges import reading_text, with_unit
from simmer_tui.tui.line_panel import StyledLine

REASONS = (":why", ":report")
"""Orders that explain what went wrong."""
_NOTICE_ROLES = {
    NoticeKind.FAULT: "danger",
    NoticeKind.TURNED_AWAY: "warning",
    NoticeKind.HINT: "warning",
    NoticeKind.PROGRAM: "plain",
    NoticeKind.VERDICT: "bold",
}
_NOTICE_SOURCES = {NoticeKind.PROGRAM: "program", NoticeKind.VERDICT: "verdict"}
_AFTER_THE_END = (NoticeKind.LEFT, NoticeKind.PROGRAM)
"""Notices of a program that are not news once its mission is over."""
# The longest usual command, `r1--180`, and a space.
_COMMAND = 8
"""Columns of a command."""


def clock_text(seconds: float) -> str:
    """Simulated time as minutes and seconds, `02:03.5`."""
    sign = "-" if seconds < 0 else ""
    tenths = round(abs(seconds) * 10)
    return f"{sign}{tenths // 600:02d}:{tenths % 600 / 10:04.1f}"


def reply_text(result: CommandResult, ended: MovementEnded | None = None) -> str:
    """A reply as people read it; `ended` is the movement that ended last, possibly this command's."""
    # A velocity goes on at a wall, pressed against it.
    is_movement = result.velocity is None
    if is_movement and ended is not None and ended.number == result.number and ended.grip is None:
        contact = ended.contact
        if contact is not None and contact.ended and not ended.stopped_by:
            return f"stopped after {went_text(ended)} by a contact"
    if result.status is Status.READING and result.reading is not None:
        if result.reading.scan is not None:
            return scan_text(result.reading.scan)
        return with_unit(result.reply, result.reading.sensor)
    if result.velocity is not None:
        cut = result.velocity.limited
        return velocity_text(result.velocity.twist) + (f", limited to {cut:.0%}" if cut < 1.0 else "")
    words = {Status.DONE: "done", Status.ACCEPTED: "under way", Status.STOPPED: "stopped"}
    return words.get(result.status, "NaN")


def off_text(belief: Belief) -> str:
    """Error of a belief at its time: `3.4 in 12 deg`."""
    distance, turn = displacement(belief.true, belief.pose)
    if belief.grid is not None and not belief.grid.has_headings:
        return f"{distance:.1f} in"
    return f"{distance:.1f} in {abs(turn):.0f} deg"


def off_piece(belief: Belief, more: str = "") -> tuple[str, str]:
    """Error of a belief with its role, and `more` behind it; of one that is off by more than it allows for,
    that it is lost."""
    found = deviation(belief)
    is_lost = math.isfinite(found.distance) and found.wrong
    return (f"{off_text(belief)}, lost", "danger") if is_lost else (f"{off_text(belief)}{more}", "belief")


def spread_text(belief: Belief) -> str:
    """Spread of a belief as the end of a sentence; empty if the program sent none."""
    return "" if belief.spread is None else f", spread {belief.spread:.0f}"


def truth_text(grid: GridBelief) -> str:
    """Probability that a grid gives the true cell: `41 % true`."""
    return f"{_percent(grid.true_probability)} true"


def grid_lines(grid: GridBelief) -> tuple[str, str]:
    """A grid in two lines: its best cell, and its entropy beside that of a uniform grid."""
    (x, y, share), most = grid.best_place, math.log2(grid.states)
    return (
        f"best {x:.1f}, {y:.1f} in {_percent(share)}, {truth_text(grid)}",
        f"entropy {grid.entropy:.1f} of {most:.1f} bit, spread {grid.spread:.0f}",
    )


def _percent(share: float) -> str:
    return "<1 %" if 0.0 < share < 0.01 else f"{100 * share:.0f} %"


def screen_pose_text(pose: Pose) -> str:
    """A pose, its heading from -180 to 180 degrees."""
    return f"{pose.x:.1f}, {pose.y:.1f} in  {half_turn(pose.heading):.1f} deg"


# -- one entry -------------------------------------------------------------------------------------


class EventWords(Struct, frozen=True):
    """Words for one event.

    Attributes:
        source: giver of the event: `client`, `console`, `keys`, `belief`, `robot`, or `program` for its
            output.
        subject: command, or kind of event.
        pieces: makes the styled text of what happened.
        refusal: reason why a command or action was refused; empty if it was not, None for other events.
        ends_mission: true for the event that ends a mission.
        is_departure: true for what a program does after its end.
        is_answer: true for a hint, and for what an action of a person did.
    """

    source: str = "robot"
    subject: str = ""
    pieces: Callable[[], StyledLine] = tuple
    refusal: str | None = None
    ends_mission: bool = False
    is_departure: bool = False
    is_answer: bool = False


class _Wording(EventHandler[EventWords]):
    """Words for each kind of event.

    `nearest` is the reading of the sensor that points at a contact. `wedged` is true if the contact was one
    of many in one place.
    """

    def __init__(self, nearest: Reading | None = None, *, wedged: bool = False) -> None:
        self._nearest, self._wedged = nearest, wedged

    def other(self, event: events.Event) -> EventWords:
        return EventWords()

    def on_ended(self, event: MovementEnded) -> EventWords:
        command = event.command
        return EventWords(command.source, command.shown, lambda: self._end_pieces(event), "")

    def on_result(self, event: CommandResult) -> EventWords:
        command, reason = event.command, event.reason

        def pieces() -> StyledLine:
            reply = reply_text(event)
            return ((reply, "danger"), (f"  {reason}", "warning")) if reason else ((reply, "value"),)

        refusal = f"{command.shown}: {reason}" if reason else ""
        return EventWords(command.source, command.shown, pieces, refusal)

    def on_velocity_ended(self, event: events.VelocityEnded) -> EventWords:
        # The sender itself asked for an end at that time.
        style = "plain" if event.reason is events.VelocityEnd.TIME else "warning"
        text: StyledLine = ((f"ended: {event.reason.value}", style),)
        return EventWords(event.source or "robot", "velocity", lambda: text)

    def on_action(self, event: events.ActionDone) -> EventWords:
        name, numbers = event.action.name, event.action.arguments
        if name.switches and numbers:
            arguments = f" {'on' if numbers[0] else 'off'}"
        else:  # seeds are whole numbers with all their digits; places have at most 13
            arguments = "".join(f" {each}" if isinstance(each, int) else f" {each:.13g}" for each in numbers)
        done: StyledLine = ((event.text, "danger" if event.refused else "good"),)
        refusal = f"{name.value}: {event.text}" if event.refused else ""
        source = event.action.source
        subject = f"{name.value}{arguments}"
        return EventWords(source, subject, lambda: done, refusal, is_answer=source in PEOPLE)

    def on_belief(self, event: Belief) -> EventWords:
        def pieces() -> StyledLine:
            believed, off = screen_pose_text(event.pose), f"{off_text(event)}{spread_text(event)}"
            off += "" if event.grid is None else f", {truth_text(event.grid)}"
            note = f"  {event.note}" if event.note else ""
            return (f"{believed}, off {off}", "belief"), (note, "plain")

        return EventWords("belief", "belief", pieces)

    def on_twin(self, event: events.TwinReading) -> EventWords:
        text = f"robot {reading_text(event.robot)}, simulated {reading_text(event.simulated)}"
        return EventWords(event.command.source, event.code, lambda: ((text, "belief"),))

    def on_mission(self, event: events.MissionEvent) -> EventWords:
        return EventWords(subject="mission", pieces=lambda: _mission_pieces(event), ends_mission=event.over)

    def on_notice(self, event: events.Notice) -> EventWords:
        source = _NOTICE_SOURCES.get(event.kind, "robot")
        # The column before it names the source.
        told = event.text.removeprefix(f"{source}: ")
        text: StyledLine = ((told, _NOTICE_ROLES.get(event.kind, "good")),)
        return EventWords(
            source,
            source,
            lambda: text,
            is_departure=event.kind in _AFTER_THE_END,
            is_answer=event.kind is NoticeKind.HINT,
        )

    def on_wire(self, event: events.WireMessage) -> EventWords:
        shown = utf8_text(event.data)
        if event.port:
            by = f"{event.board} {event.port}: "
            return EventWords("robot", "<", lambda: ((by, "dim"), (shown, "value")))
        if event.reply:
            return EventWords("robot", "<", lambda: ((shown, "value"),))
        return EventWords("client", ">", lambda: ((f"{shown}  ", "plain"), (event.meaning, "dim")))

    def _end_pieces(self, ended: MovementEnded) -> StyledLine:
        """End of a movement."""
        if ended.grip is not None:
            return ((grip_text(ended.grip), "value"),)
        contact = ended.contact
        by = stopped_by_text(ended)
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


def event_words(entry: LogEntry) -> EventWords:
    """Words for an entry's event."""
    return _Wording(entry.nearest, wedged=entry.wedged).handle(entry.event)


def entry_line(entry: LogEntry) -> StyledLine:
    """An entry: simulated time, the command, its effect, and its sender if that was a person."""
    if entry.folds:
        return (*_head(entry, ""), (folded_text(entry), "dim"))
    words = event_words(entry)
    signed = words.refusal is not None and words.source in PEOPLE
    by = ((f"  by {words.source}", "dim"),) if signed else ()
    return (*_head(entry, words.subject), *words.pieces(), *by)


def _mission_pieces(event: events.MissionEvent) -> StyledLine:
    """Text of a mission's event; of a failure first the reason, then the totals."""
    text = event.text.removeprefix("mission: ")
    if not event.reason:
        return ((text, "good"),)
    totals = text.removeprefix(event.subject.value).removesuffix(f": {event.reason}").strip()
    failed: StyledLine = ((f"{event.subject.value}: {event.reason}", "danger"),)
    return (*failed, (f"  {totals}", "dim")) if totals else failed


def _head(entry: LogEntry, command: str) -> StyledLine:
    return (f"{clock_text(entry.time)}  ", "dim"), (f"{command:<{_COMMAND - 1}} ", "mark")


# -- several entries -------------------------------------------------------------------------------


def kept_lines(entry: LogEntry) -> list[StyledLine]:
    """Lines of the events folded into an entry, as far as they are kept."""
    lines = [entry_line(each) for each in entry.kept]
    if entry.missing > 0:
        lines.insert(0, (*_head(entry, ""), (f"  {entry.missing} before these are counted only", "dim")))
    return lines


def folded_text(entry: LogEntry) -> str:
    """Counts of readings, beliefs, velocities and prints that are folded into an entry."""
    parts = ((entry.readings, "reading"), (entry.beliefs, "belief"), (entry.prints, "print"))
    shown = [counted(count, noun) for count, noun in parts if count]
    if entry.velocities:
        shown.append("one velocity" if entry.velocities == 1 else f"{entry.velocities} velocities")
    return ", ".join(shown)


def last_event_line(entries: Sequence[LogEntry]) -> StyledLine:
    """The last event in one line, and the number of readings since; empty without any event."""
    if not entries:
        return ()
    events_alone, newest = [entry for entry in entries if not entry.folds], entries[-1]
    if not events_alone:
        return entry_line(newest)
    since = f"   then {folded_text(newest)}" if newest.folds else ""
    return (*entry_line(_outweighing(events_alone)), (since, "dim"))


def ends_with_answer(entries: Sequence[LogEntry], since: int) -> bool:
    """True if the last event is an answer to a person, and came after the event `since`."""
    if not entries or entries[-1].folds or entries[-1].number <= since:
        return False
    return event_words(entries[-1]).is_answer


def _outweighing(entries: Sequence[LogEntry]) -> LogEntry:
    """The last entry, or the end of a mission if only its program's departure came after it."""
    for entry in reversed(entries):
        words = event_words(entry)
        if words.ends_mission:
            return entry
        if not words.is_departure:
            break
    return entries[-1]


def refusal_of(entries: Sequence[LogEntry], since: int = 0) -> str | None:
    """Reason why a person's last command or action after the event `since` was refused. Empty if it was not
    refused, None if there was none."""
    for entry in reversed(entries):
        if entry.number <= since:
            break
        # A program's readings come by the thousand; wording each would cost a tenth of the screen's time.
        if entry.folds:
            found = refusal_of(entry.kept, since)
            if found is not None:
                return found
            continue
        command = getattr(entry.event, "command", None)
        if command is not None and command.source not in PEOPLE:
            continue
        words = event_words(entry)
        if words.refusal is not None and words.source in PEOPLE:
            return words.refusal
    return None
