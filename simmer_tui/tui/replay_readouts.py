"""What only the replay screen shows, as lines of text: the list of what happened, and the clock."""

from __future__ import annotations

from simmer_tui.runlog.entries import BrokenLine
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.runlog.reader import Logged
from simmer_tui.snapshot import LogEntry
from simmer_tui.tui.line_panel import Line
from simmer_tui.tui.readouts import entry_line


def clock(seconds: float) -> str:
    """Minutes and seconds, `2:03.50`."""
    sign = "-" if seconds < 0 else ""
    minutes, rest = divmod(abs(seconds), 60)
    return f"{sign}{int(minutes)}:{rest:05.2f}"


def replay_line(logged: Logged | BrokenLine, current: bool = False) -> Line:
    """One thing that a log tells, in the words of the app's log; the present one is marked."""
    mark = ("> " if current else "  ", "newest")
    if isinstance(logged, BrokenLine):
        return mark, (str(logged), "danger")
    return mark, *(entry_line(LogEntry(0, logged.wall, logged.event)) or ())


def scrubber(
    log: RunLogIndex, i: int, elapsed: float, *, speed: float, playing: bool, width: int, plain: bool
) -> Line:
    """Where in the run we are: speed, time, a bar, and the number of the entry."""
    going, standing, done, left, knob = (">", "=", "=", "-", "O") if plain else ("▶", "‖", "━", "─", "●")
    lead = f"{going if playing else standing} {speed:g}x"
    head = f"{lead:<7} {clock(elapsed)} / {clock(log.duration)} "
    tail = f" {max(i, -1) + 1}/{log.count}"
    room = width - len(head) - len(tail)
    if room < 5:
        return (head.rstrip(), "value"), (tail, "label")
    fraction = min(max(elapsed / log.duration, 0.0), 1.0) if log.duration else i / max(log.count - 1, 1)
    place = min(max(round(fraction * (room - 1)), 0), room - 1)
    return (
        (head, "value"),
        (done * place, "good"),
        (knob, "newest"),
        (left * (room - place - 1), "dim"),
        (tail, "label"),
    )
