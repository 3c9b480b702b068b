"""What the replay screen says of a moment of a logged run, as lines of text."""

from __future__ import annotations

import math
from collections.abc import Sequence

from simmer_tui.runlog.entries import (
    ActionEntry,
    BeliefEntry,
    BrokenEntry,
    CommandEntry,
    Entry,
    NoticeEntry,
    TwinEntry,
)
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.runlog.state import RunState
from simmer_tui.sim.records import Pose
from simmer_tui.sim.specs import SensorSpec
from simmer_tui.tui.line_panel import Line
from simmer_tui.tui.readouts import number_text, range_role, with_unit

_LABEL = 9


def clock(seconds: float) -> str:
    """Minutes and seconds, `2:03.50`."""
    sign = "-" if seconds < 0 else ""
    minutes, rest = divmod(abs(seconds), 60)
    return f"{sign}{int(minutes)}:{rest:05.2f}"


def run_lines(log: RunLogIndex, state: RunState) -> list[Line]:
    """True and believed pose, the latest command, and which run this is."""
    pose = state.pose
    moving = ("moving", "good") if state.moving else ("standing", "value")
    lines: list[Line] = [
        _fact("pose", f"({pose.x:.2f}, {pose.y:.2f}) in, {pose.heading:.1f} deg"),
        (("state".ljust(_LABEL), "label"), moving),
    ]
    if state.belief is not None:
        lines.append((("believed".ljust(_LABEL), "label"), (_belief_text(state.belief), "belief")))
    if isinstance(state.entry, CommandEntry):
        role = "danger" if state.entry.refused else "value"
        lines.append((("last".ljust(_LABEL), "label"), (_command_text(state.entry), role)))
    held = ", block held" if state.holding else ""
    lines += [
        _fact("contacts", f"{len(state.contacts)} so far{held}"),
        _fact("run", f"{log.header.start[:19].replace('T', ' ')}, seed {log.header.seed}"),
        _fact("set", log.header.configuration),
    ]
    return lines


def reading_lines(sensors: Sequence[SensorSpec], state: RunState, plain: bool) -> list[Line]:
    """One line a sensor: its latest reading, the true value then, and the difference."""
    lines: list[Line] = []
    for sensor in sensors:
        entry = state.readings.get(sensor.id)
        newest = entry is not None and entry is state.entry
        head = f"{'>' if newest else ' '}{sensor.code} {sensor.id:<7}"
        if entry is None:
            lines.append(((head, "label"), (f"{'-' if plain else '–':>11}", "dim")))
            continue
        role = "newest" if newest else range_role(sensor, entry.reply)
        pieces = [(head, "newest" if newest else "label"), (f"{with_unit(entry.reply, sensor):>11}", role)]
        if math.isfinite(entry.true):
            pieces.append((f"  true {number_text(entry.true):>8}", "good"))
            if math.isfinite(entry.reply):
                pieces.append((f" {entry.reply - entry.true:+8.2f}", "dim"))
        lines.append(tuple(pieces))
    return lines


def entry_lines(log: RunLogIndex, i: int, rows: int) -> list[Line]:
    """The entries around the present one, which is marked, so that `rows` are filled."""
    first = max(0, min(i - rows + 3, log.count - rows))
    return [entry_line(log.entry(k), k == i) for k in range(first, min(first + rows, log.count))]


def entry_line(entry: Entry, current: bool = False) -> Line:
    """One entry of the log: time, source, what was asked, what came of it."""
    mark = ("> " if current else "  ", "newest")
    if isinstance(entry, BrokenEntry):
        return mark, (str(entry), "danger")
    head = (mark, (f"{entry.t:8.2f} ", "dim"))
    if isinstance(entry, CommandEntry):
        role = "danger" if entry.refused else "newest" if current else "plain"
        pieces = (*head, (f"{entry.source:<8}", "label"), (_command_text(entry), role))
        if entry.contact is not None:
            x, y = entry.contact
            how = "touched" if entry.held is None else "stopped at"
            return (*pieces, (f"  {how} ({x:.1f}, {y:.1f})", "danger"))
        return pieces
    if isinstance(entry, ActionEntry):
        return (*head, (f"{entry.source:<8}", "label"), (entry.text, "danger" if entry.refused else "good"))
    if isinstance(entry, BeliefEntry):
        return (*head, ("belief  ", "label"), (_belief_text(entry), "belief"))
    if isinstance(entry, TwinEntry):
        text = f"{entry.code} robot {number_text(entry.robot)}, simulated {number_text(entry.simulated)}"
        return (*head, (f"{entry.source:<8}", "label"), (text, "belief"))
    assert isinstance(entry, NoticeEntry)
    return (*head, ("robot   ", "dim"), (entry.text, "dim"))


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


def _command_text(entry: CommandEntry) -> str:
    text = f"{entry.shown:<12} {number_text(entry.reply)}"
    return f"{text}  {entry.reason}" if entry.reason else text


def _belief_text(entry: BeliefEntry) -> str:
    apart, turned = _error(entry.believed, entry.pose)
    where = f"({entry.believed.x:.1f}, {entry.believed.y:.1f}) {entry.believed.heading:.0f} deg"
    note = f" {entry.note}" if entry.note.isprintable() else ""
    return f"{where}, off {apart:.1f} in {turned:.0f} deg{note}"


def _error(believed: Pose, true: Pose) -> tuple[float, float]:
    turned = abs(math.remainder(believed.heading - true.heading, 360.0))
    return math.hypot(believed.x - true.x, believed.y - true.y), turned


def _fact(label: str, value: str) -> Line:
    return (label.ljust(_LABEL), "label"), (value, "value")
