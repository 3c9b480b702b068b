"""The timeline of a replay: a clock, a bar, and marks of contacts, goals and pauses to jump to."""

from __future__ import annotations

from collections.abc import Sequence

from textual.events import Click
from textual.message import Message

from simmer_tui.tui.event_text import clock
from simmer_tui.tui.line_panel import Line, LinePanel
from simmer_tui.tui.recorded import MarkKind, RecordedRun, TimeMark

_SIGNS = {MarkKind.CONTACT: ("X", "X"), MarkKind.GOAL: ("◆", "*"), MarkKind.PAUSE: ("‖", "|")}
"""The sign of a kind of mark, and that in ASCII."""
_ROLES = {MarkKind.CONTACT: "contact", MarkKind.GOAL: "good", MarkKind.PAUSE: "value"}
_LEAST_BAR = 5


def bar_of(run: RecordedRun, width: int, *, plain: bool) -> tuple[str, int, str]:
    """What stands before the bar, how many columns the bar has, and what stands after it."""
    going, standing = (">", "=") if plain else ("▶", "‖")
    lead = f" {going if run.playing else standing} {run.speed:g}x"
    head = f"{lead:<8} {clock(run.elapsed)} / {clock(run.duration)} "
    tail = f" {max(run.entry, -1) + 1}/{run.index.count} "
    return head, width - len(head) - len(tail), tail


def bar_line(run: RecordedRun, width: int, *, plain: bool) -> Line:
    """Where in the run we are: speed, time, a bar, and the number of the entry."""
    head, room, tail = bar_of(run, width, plain=plain)
    if room < _LEAST_BAR:
        return (head.rstrip(), "value"), (tail, "label")
    done, left, knob = ("=", "-", "O") if plain else ("━", "─", "●")
    fraction = run.elapsed / run.duration if run.duration else max(run.entry, 0) / max(run.index.count - 1, 1)
    place = _column(fraction, room)
    return (
        (head, "value"),
        (done * place, "mark"),
        (knob, "newest"),
        (left * (room - place - 1), "rule"),
        (tail, "label"),
    )


def marks_line(run: RecordedRun, note: str, width: int, *, plain: bool) -> Line:
    """The marks above the bar; where they are many in one place, the first by kind. `note` says what
    is wrong, or where we are."""
    head, room, _ = bar_of(run, width, plain=plain)
    if room < _LEAST_BAR:
        return ((f" {note}", "warning"),)
    columns: dict[int, TimeMark] = {}
    for mark in reversed(run.marks):
        fraction = mark.elapsed / run.duration if run.duration else 0.0
        column = _column(fraction, room)
        before = columns.get(column)
        if before is None or list(MarkKind).index(mark.kind) <= list(MarkKind).index(before.kind):
            columns[column] = mark
    pieces: list[tuple[str, str]] = [(f" {note}"[: len(head) - 1].ljust(len(head)), "warning")]
    at = 0
    for column in sorted(columns):
        kind = columns[column].kind
        pieces += [(" " * (column - at), "plain"), (_SIGNS[kind][plain], _ROLES[kind])]
        at = column + 1
    return (*pieces, (" " * (room - at), "plain"))


def _column(fraction: float, room: int) -> int:
    return min(max(round(fraction * (room - 1)), 0), room - 1)


class Timeline(LinePanel):
    """Shows where in a log we are; a click goes there."""

    class Sought(Message):
        """A place of the bar was clicked on: a fraction of the run."""

        def __init__(self, fraction: float) -> None:
            super().__init__()
            self.fraction = fraction

    def __init__(self, run: RecordedRun, *, plain: bool) -> None:
        super().__init__(id="console")
        self._run = run
        self._plain = plain

    def bring_up_to_date(self, note: str) -> None:
        """Show the moment the run is at."""
        width = self.size.width
        lines: Sequence[Line] = (
            marks_line(self._run, note, width, plain=self._plain),
            bar_line(self._run, width, plain=self._plain),
        )
        if width:
            self.show(lines)

    def on_click(self, event: Click) -> None:
        head, room, _ = bar_of(self._run, self.size.width, plain=self._plain)
        column = event.x - len(head)
        if room >= _LEAST_BAR and 0 <= column < room:
            self.post_message(self.Sought(column / (room - 1)))
