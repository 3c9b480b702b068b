"""What the panels say about robot, sensors and link: snapshots turned into lines of text."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence

from simmer_tui.engine import ActionDone, Belief, Notice, NoticeKind, TwinReading
from simmer_tui.mission import MissionState, Result
from simmer_tui.sim.command import escape
from simmer_tui.sim.records import Grip, Outcome, Status
from simmer_tui.sim.specs import SensorSpec
from simmer_tui.snapshot import LogEntry, SensorRow, Snapshot
from simmer_tui.tui.line_panel import Line

SHORT, NEAR = 3.0, 6.0
"""Ranges below these, inches, are shown as danger and as warning."""
_BARS = " ▁▂▃▄▅▆▇"  # a full block would run into the row above
_PLAIN_BARS = " .:-=+*#"
BESIDE_PANELS: Line = (("tab completes a line, up brings back the last, escape drives by keys", "dim"),)
"""What stands in place of the status line where the panels tell it all."""
_LABEL = 9
_PEOPLE = ("console", "keys")
"""Sources of commands and actions that are somebody at the screen."""
_NOTICE_ROLES = {NoticeKind.FAULT: "danger", NoticeKind.TURNED_AWAY: "warning", NoticeKind.PROGRAM: "plain"}


def reply_text(outcome: Outcome) -> str:
    """A reply as people read it."""
    if outcome.status is Status.READING and outcome.reading is not None:
        return with_unit(outcome.reply, outcome.reading.sensor)
    words = {Status.DONE: "done", Status.ACCEPTED: "under way", Status.STOPPED: "stopped"}
    return words.get(outcome.status, "NaN")


def number_text(value: float) -> str:
    """A number for a table: two decimals, infinities by name."""
    if not math.isfinite(value):
        return f"{value:g}"
    return f"{value:.2f}"


def with_unit(value: float, sensor: SensorSpec) -> str:
    """A reading with its unit; a yes or no as a bare 1 or 0."""
    if not sensor.unit and value in (0.0, 1.0):
        return f"{value:.0f}"
    return f"{number_text(value)} {sensor.unit}".rstrip()


def sparkline(values: Sequence[float], width: int, *, plain: bool) -> str:
    """The last `width` values as bars between the least and the greatest; infinite ones full."""
    bars = _PLAIN_BARS if plain else _BARS
    shown = values[-width:] if width > 0 else ()
    finite = [value for value in shown if math.isfinite(value)]
    low, high = (min(finite), max(finite)) if finite else (0.0, 0.0)
    text = ""
    for value in shown:
        if not math.isfinite(value):
            text += "?" if math.isnan(value) else bars[-1]
        elif high == low:
            text += bars[len(bars) // 2]
        else:
            text += bars[1 + round((value - low) / (high - low) * (len(bars) - 2))]
    return text


def sensor_lines(
    sensors: Sequence[SensorSpec], snapshot: Snapshot, width: int, *, truth: bool, plain: bool
) -> list[Line]:
    """One line a sensor: code, ID, reading, with `truth` what is true now, and its history."""
    newest = max((row.number for row in snapshot.sensors.values()), default=0)
    lines = []
    for sensor in sensors:
        if not sensor.enabled:
            continue
        row = snapshot.sensors.get(sensor.code)
        true = snapshot.true_values.get(sensor.code) if truth else None
        twin = snapshot.twins.get(sensor.code)
        lines.append(_sensor_line(sensor, row, width, newest, true=true, twin=twin, plain=plain))
    return lines


def _sensor_line(
    sensor: SensorSpec,
    row: SensorRow | None,
    width: int,
    newest: int,
    *,
    true: float | None,
    twin: TwinReading | None,
    plain: bool,
) -> Line:
    is_newest = row is not None and row.number == newest
    head = (f"{'>' if is_newest else ' '}{sensor.code} {sensor.id:<7}", "newest" if is_newest else "label")
    reading = with_unit(row.reading.value, sensor) if row is not None else ("-" if plain else "–")
    role = "dim" if row is None else range_role(sensor, row.reading.value)
    if is_newest and role == "value":
        role = "newest"
    pieces = [head, (f"{reading:>11}", role)]
    if twin is not None:
        pieces.append((f"  sim {number_text(twin.simulated):>7}", "belief"))
        pieces.append((f" {twin.robot - twin.simulated:+8.2f}", "warning" if _apart(twin) else "dim"))
    if true is not None:
        pieces.append((f" {number_text(true):>8}", "good"))
    if row is not None:
        room = width - sum(len(text) for text, _ in pieces) - 2
        pieces.append(("  " + sparkline(row.history, room, plain=plain), "dim"))
    return tuple(pieces)


def _apart(twin: TwinReading) -> bool:
    """Whether robot and simulator read so differently that someone should look: by more than a
    tenth and more than one inch or degree."""
    apart = abs(twin.robot - twin.simulated)
    return not apart <= max(1.0, 0.1 * abs(twin.simulated))


def range_role(sensor: SensorSpec, value: float) -> str:
    """How a reading is shown: short ranges stand out."""
    if not sensor.kind.is_range or value >= NEAR:
        return "value"
    return "danger" if value < SHORT else "warning"


def robot_lines(snapshot: Snapshot) -> list[Line]:
    """Pose, belief, last command and reply, and the totals."""
    pose = snapshot.pose
    state, role = _state(snapshot)
    lines: list[Line] = [
        _fact("pose", f"({pose.x:.2f}, {pose.y:.2f}) in, {pose.heading:.1f} deg"),
        (("state".ljust(_LABEL), "label"), (state, role)),
    ]
    if snapshot.belief is not None:
        believed, off = belief_texts(snapshot.belief)
        lines += [_fact("believed", believed, "belief"), _fact("off by", off, "belief")]
    if snapshot.mission is not None:
        lines += mission_lines(snapshot.mission)
    last = snapshot.last
    if last is not None:
        reply_role = "danger" if last.reason else "value"
        text = f"{last.command.shown} -> {reply_text(last)}"
        lines.append((("last".ljust(_LABEL), "label"), (text, reply_role)))
    hits = f"{snapshot.contacts} contact{_s(snapshot.contacts)}"
    lines += [
        (
            ("driven".ljust(_LABEL), "label"),
            (f"{snapshot.distance:.1f} in, ", "value"),
            (hits, "warning" if snapshot.contacts else "value"),
        ),
        _fact("time", f"{snapshot.time:.2f} s, {snapshot.commands} command{_s(snapshot.commands)}"),
        _fact("seed", f"{snapshot.seed}{'' if snapshot.noise else ', noise off'}"),
    ]
    return lines


def belief_texts(belief: Belief) -> tuple[str, str]:
    """A belief, and how wrong it was when it was told."""
    pose, true = belief.pose, belief.true
    apart = math.hypot(pose.x - true.x, pose.y - true.y)
    turned = math.remainder(pose.heading - true.heading, 360.0)
    spread = "" if belief.spread is None else f", spread {belief.spread:.1f} in"
    believed = f"({pose.x:.2f}, {pose.y:.2f}) in, {pose.heading:.1f} deg"
    return believed, f"{apart:.2f} in, {abs(turned):.1f} deg{spread}"


def mission_lines(mission: MissionState) -> list[Line]:
    """How the mission stands, and what comes next."""
    met = sum(when is not None for when in mission.goals.values())
    if mission.over:
        role = "good" if mission.result is Result.SUCCESS else "danger"
        reason = f": {escape(mission.reason)}" if mission.reason else ""
        return [_fact("mission", f"{mission.result.value}{reason}", role)]
    following = next((goal.value for goal, when in mission.goals.items() if when is None), "")
    holding = ", holding the block" if mission.holding else ""
    return [
        _fact("mission", f"{mission.time_left:.0f} s left{holding}"),
        _fact("goals", f"{met} of {len(mission.goals)} met, next: {following}"),
    ]


def _s(count: int) -> str:
    return "" if count == 1 else "s"


def _state(snapshot: Snapshot) -> tuple[str, str]:
    if snapshot.paused:
        return ("paused, a command waits" if snapshot.waiting else "paused"), "warning"
    if snapshot.touching:
        return "held by a wall" if snapshot.moving else "at a wall", "danger"
    return ("moving", "good") if snapshot.moving else ("standing", "value")


def _fact(label: str, value: str, role: str = "value") -> Line:
    return (label.ljust(_LABEL), "label"), (value, role)


def link_lines(snapshot: Snapshot, ports: Mapping[str, int]) -> list[Line]:
    """Who is connected, how busy, and on which ports."""
    who, role = (snapshot.client, "good") if snapshot.client else ("waiting", "dim")
    lines: list[Line] = [
        (("client".ljust(_LABEL), "label"), (who, role), (f", {snapshot.rate:.0f} commands/s", "value"))
    ]
    numbered = [f"{port} {purpose}" for purpose, port in ports.items()]
    for place in range(0, len(numbered), 2):
        label = "ports" if place == 0 else ""
        lines.append(_fact(label, ", ".join(numbered[place : place + 2])))
    return lines


def status_line(snapshot: Snapshot, width: int) -> Line:
    """One line for small screens: the last command and reply, and where the robot is."""
    pose = snapshot.pose
    state, role = _state(snapshot)
    place = f"({pose.x:.1f}, {pose.y:.1f}) {pose.heading:.0f} deg "
    pieces = [(place, "label"), (f"{state} ", role)]
    last = snapshot.last
    if last is not None:
        text = f"{last.command.shown} -> {reply_text(last)}"
        if last.reason:
            text += f": {last.reason}"
        room = max(width - sum(len(piece) for piece, _ in pieces), 0)
        pieces.append((text[:room], "danger" if last.reason else "value"))
    return tuple(pieces)


def complaint_of(entries: Sequence[LogEntry]) -> str | None:
    """What was wrong with what a person asked for last, empty if nothing; None without such."""
    for entry in reversed(entries):
        event = entry.event
        if isinstance(event, Outcome) and event.command.source in _PEOPLE:
            return f"{event.command.shown}: {event.reason}" if event.reason else ""
        if isinstance(event, ActionDone) and event.action.source in _PEOPLE:
            return f"{event.action.name.value}: {event.text}" if event.refused else ""
    return None


def entry_source(entry: LogEntry) -> str:
    """Whose entry it is: `client`, `console`, `keys`, `belief`, `program` for what it prints, or `robot`."""
    event = entry.event
    if isinstance(event, Outcome | TwinReading):
        return event.command.source
    if isinstance(event, ActionDone):
        return event.action.source
    if isinstance(event, Belief):
        return "belief"
    return "program" if event.kind is NoticeKind.PROGRAM else "robot"


def entry_line(entry: LogEntry) -> Line:
    """A log entry: simulated time (of notices the time of day), source, command, reply, and the
    reason of a refusal."""
    event = entry.event
    source = f"{entry_source(entry):<8}"
    if isinstance(event, Notice):
        role = _NOTICE_ROLES.get(event.kind, "good")
        clock = time.strftime("%H:%M:%S ", time.localtime(entry.wall))
        return ((clock, "dim"), (source, "label"), (event.text, role))
    head = ((f"{event.time:8.2f} ", "dim"), (source, "label"))
    if isinstance(event, ActionDone):
        arguments = " ".join(f"{number:g}" for number in event.action.arguments)
        text = f"{event.action.name.value} {arguments}".rstrip()
        return (*head, (f"{text:<12} ", "value"), (event.text, "danger" if event.refused else "good"))
    if isinstance(event, Belief):
        believed, off = belief_texts(event)
        note = f"  {escape(event.note, 200)}" if event.note else ""
        return (*head, (f"{believed}, off {off}", "belief"), (note, "plain"))
    if isinstance(event, TwinReading):
        text = f"robot {number_text(event.robot)}, simulated {number_text(event.simulated)}"
        return (*head, (f"{event.code:<12} ", "value"), (text, "belief"))
    reply = (
        (f"{event.command.shown:<12} ", "value"),
        (reply_text(event), "danger" if event.reason else "plain"),
    )
    if event.reason:
        return (*head, *reply, (f"  {event.reason}", "warning"))
    if event.grip is not None:
        return (*head, *reply, (f"  {_grip_text(event.grip)}", "plain"))
    if entry.contact is not None:
        x, y = entry.contact.point
        how = "touched" if not entry.contact.ended or entry.contact.pose != event.pose else "stopped by"
        return (*head, *reply, (f"  {how} the wall at ({x:.1f}, {y:.1f})", "danger"))
    return (*head, *reply)


def _grip_text(grip: Grip) -> str:
    if grip.holding:
        return "holding the block"
    return "closed on nothing" if grip.closed else "open"
