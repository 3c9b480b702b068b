"""What bars and panels say of a run: snapshots turned into lines of text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from simmer_tui.client import (
    DEFAULT_PACKET_PORT,
    DEFAULT_PACKET_REPLY_PORT,
    DEFAULT_PORT,
    DEFAULT_REPLY_PORT,
)
from simmer_tui.config.dialects import COMMANDS, PACKET_REPLIES, PACKETS, REPLIES
from simmer_tui.config.settings import ServerSettings
from simmer_tui.events import Result
from simmer_tui.mission import MissionState
from simmer_tui.run.state import TimeSpent
from simmer_tui.sim.command import escape
from simmer_tui.snapshot import LogEntry, Snapshot
from simmer_tui.tui.event_text import belief_texts, clock, last_event_line, pose_text, reply_text
from simmer_tui.tui.line_panel import StyledLine, between, heading, length, shortened, wrapped
from simmer_tui.tui.sensor_readouts import gauge

_LABEL = 9
_LEAST_NAME, _LONGEST_NAME = 12, 60
_ROOMY = 100
"""Columns from which a bar has room for what is not needed at every glance."""
_EAST_ON = ("→", "↗", "↑", "↖", "←", "↙", "↓", "↘")
_EAST_ON_PLAIN = ("E", "NE", "N", "NW", "W", "SW", "S", "SE")


def header_line(snapshot: Snapshot, name: str, pace: str, width: int, *, plain: bool) -> StyledLine:
    """The bar on top: what is simulated, who drives it and how busily, its pace, seed and clock."""
    state = snapshot.state
    roomy = width >= _ROOMY
    who = state.client if roomy else state.client.rpartition(":")[0] or state.client
    rate = f"{snapshot.rate:.0f}{' commands' if roomy else ''}/s"
    dot = "*" if plain else "●"
    client: StyledLine = ((f"{dot} ", "robot"), (f"client {who}  {rate}", "plain"))
    if not state.client:
        client = ((f"{'o' if plain else '○'} no client", "dim"),)
    extra = [(pace, "plain")] if pace else []
    if state.paused:
        extra.append(("PAUSED, a command waits" if snapshot.waiting and roomy else "PAUSED", "title"))
    if roomy:
        extra.append((f"seed {state.seed}", "plain"))
    extra.append((clock(state.time), "plain"))
    right = client
    for text, role in extra:
        right = (*right, ("   ", "plain"), (text, role))
    left: StyledLine = ((" SimMeR", "title"),)
    room = width - length(left) - length(right) - 4
    if room >= min(len(name), _LEAST_NAME):
        left = (*left, (f"  {escape(name, min(room, _LONGEST_NAME))}", "dim"))
    return between(left, (*right, (" ", "plain")), width)


def arrow_of(degrees: float, *, plain: bool) -> str:
    """A heading as an arrow, or a point of the compass with north up."""
    return (_EAST_ON_PLAIN if plain else _EAST_ON)[round(degrees / 45) % 8]


def pose_line(snapshot: Snapshot, width: int, *, plain: bool, pointer: str = "") -> StyledLine:
    """Where the robot is, how far off it is believed to be, the totals and the mission, in one line;
    `pointer` says where the reasons of a failure are."""
    state = snapshot.state
    doing, role = _state(snapshot)
    line: StyledLine = (
        (" pose ", "label"),
        (f"{pose_text(state.pose)} {arrow_of(state.pose.heading, plain=plain)}", "bold"),
    )
    brief = line
    if state.belief is not None:
        off = belief_texts(state.belief)[1].partition(",")[0]
        brief = (*line, ("  off ", "label"), (off, "belief"))
        line = (*line, ("  belief off ", "label"), (off, "belief"))
    else:
        line = (*line, (f"  {doing}", role))
    driven: StyledLine = ((f"{state.distance:.1f} in  ", "label"),)
    contacts: StyledLine = (
        (f"{state.contacts} contact{_s(state.contacts)}", "danger" if state.contacts else "label"),
    )
    totals: list[StyledLine] = [(("driven ", "label"), *driven, *contacts), (*driven, *contacts), contacts]
    least = contacts
    if snapshot.mission is not None:
        full, least = _goal_pieces(snapshot.mission, pointer)
        gap = ("  ", "plain")
        totals = [(*each, gap, *full) for each in totals] + [(*contacts, gap, *least)]
    pairs = [(left, right) for left in (line, brief) for right in totals] + [(line, least), (brief, least)]
    for left, right in pairs:
        if length(left) + length(right) + 2 <= width:
            right = (*right, (" ", "plain"))
            return between(_with_time(left, state.spent, width - length(right) - 1), right, width)
    return shortened(line, width)


def _goal_pieces(mission: MissionState, pointer: str) -> tuple[StyledLine, StyledLine]:
    """How a mission stands, in full and in a word."""
    if not mission.over:
        left: StyledLine = ((f"{mission.time_left:.0f} s left", "value"),)
        return left, left
    if mission.result is Result.SUCCESS:
        return ((mission.result.value, "good"),), ((mission.result.value.upper(), "good"),)
    why: StyledLine = tuple((f" {order}", "mark") for order in pointer.split())
    short: StyledLine = ((mission.result.value.upper(), "danger"), *why[:1])
    return (*mission_lines(mission)[0][1:], *why), short


def _with_time(line: StyledLine, spent: TimeSpent, width: int) -> StyledLine:
    """A line with where the time went behind it, if there is room."""
    told = time_lines(spent, width - length(line) - 2)
    longer = (*line, ("  ", "plain"), *told[0]) if told else line
    return longer if length(longer) <= width else line


def robot_lines(snapshot: Snapshot, width: int, *, plain: bool) -> list[StyledLine]:
    """Pose, belief, what it does, and the totals, below a heading."""
    state = snapshot.state
    doing, role = _state(snapshot)
    where = f"{pose_text(state.pose)} {arrow_of(state.pose.heading, plain=plain)}"
    believed = _fact("belief", "none told", "dim")
    if state.belief is not None:
        place, off = belief_texts(state.belief)
        text = f"off {off}" if width < 60 else f"off {off}, at {place}"
        believed = _fact("belief", text, "belief")
    last = state.contact
    contacts = f"{state.contacts}" + (f", last {clock(last.time)}" if last is not None else "")
    block = state.block
    if not block.size:
        holds = _fact("block", "there is none", "dim")
    elif state.holding:
        holds = _fact("block", "held by the robot")
    else:
        holds = _fact("block", f"lies at {block.x:.1f}, {block.y:.1f} in")
    return [
        heading("robot", "", width, plain=plain),
        _fact("pose", where),
        believed,
        (*_fact("state", doing, role), ("   driven ", "label"), (f"{state.distance:.1f} in", "value")),
        _fact("contacts", contacts, "danger" if state.contacts else "value"),
        holds,
    ]


def run_lines(
    snapshot: Snapshot,
    ports: Mapping[str, int],
    width: int,
    *,
    plain: bool,
    rows: int = 6,
    pointer: str = "",
) -> list[StyledLine]:
    """How the run stands: mission, commands, noise, and the ports a program may come by. `pointer`
    says where the reasons of a failure are."""
    state = snapshot.state
    lines = [heading("run" if snapshot.mission is None else "mission", "", width, plain=plain)]
    if snapshot.mission is not None:
        for line in mission_lines(snapshot.mission, plain=plain):
            lines += wrapped(line, width, _LABEL)
        if pointer and snapshot.mission.result is Result.FAILED:
            lines.append(_fact("reasons", pointer, "mark"))
    link = link_lines(snapshot, ports)
    noise = "" if state.noise else ", noise off"
    lines.append(_fact("commands", f"{state.commands}, {snapshot.rate:.0f}/s"))
    lines.append(_fact("seed", f"{state.seed}{noise}"))
    lines[1:1] = [*link[:1], *time_lines(state.spent, width)]
    lines += link[1:]
    for spare in ("seed", "commands", "client"):  # the header tells of the client too
        if len(lines) > rows:
            lines = [line for line in lines if not line[0][0].startswith(spare)]
    return lines


def time_lines(spent: TimeSpent, width: int) -> list[StyledLine]:
    """Where simulated time went, once reading or the link has taken any, and the sensor that took most."""
    if not (spent.reading or spent.link):
        return []
    most = max(spent.by_sensor, key=lambda code: spent.by_sensor[code], default="")
    dearest = f" ({most} {spent.by_sensor[most]:.1f})" if most else ""
    line = _fact(
        "time", f"drive {spent.driving:.1f} s, read {spent.reading:.1f}{dearest}, link {spent.link:.1f}"
    )
    if length(line) > width:
        brief = f" {most}" if most else ""
        line = _fact(
            "time", f"drive {spent.driving:.0f} read {spent.reading:.0f}{brief} link {spent.link:.0f} s"
        )
    return [line]


def mission_lines(mission: MissionState, *, plain: bool = False) -> list[StyledLine]:
    """How the mission stands, and what comes next."""
    met = sum(when is not None for when in mission.goals.values())
    if mission.over:
        role = "good" if mission.result is Result.SUCCESS else "danger"
        reason = f": {escape(mission.reason)}" if mission.reason else ""
        return [_fact("mission", f"{mission.result.value}{reason}", role)]
    following = next((goal.value for goal, when in mission.goals.items() if when is None), "")
    holding = ", holding the block" if mission.holding else ""
    limit = mission.plan.time_limit
    bar = gauge(mission.time, limit, 6, plain=plain)
    return [
        (*_fact("mission", f"{mission.time_left:.0f} s left{holding} "), *bar),
        _fact("goals", f"{met} of {len(mission.goals)} met, next: {following}"),
    ]


def link_lines(snapshot: Snapshot, ports: Mapping[str, int]) -> list[StyledLine]:
    """Who is connected, and on which ports one may be."""
    who, role = (snapshot.state.client, "good") if snapshot.state.client else ("waiting", "dim")
    lines: list[StyledLine] = [_fact("client", who, role)] if ports else []
    numbered = [f"{port} {purpose}" for purpose, port in ports.items()]
    for place in range(0, len(numbered), 2):
        label = "ports " if place == 0 else "      "  # narrow, for two numbers and their purpose
        lines.append(((label, "label"), (", ".join(numbered[place : place + 2]), "value")))
    return lines


def status_line(snapshot: Snapshot, entries: Sequence[LogEntry], *, brief: bool) -> StyledLine:
    """Above the console while nothing is typed: on small screens the last event, else the last reply."""
    if brief and entries:
        return last_event_line(entries)
    last = snapshot.state.last
    if last is None:
        return (("Tab completes, Up brings back the last, Esc drives by keys", "dim"),)
    role = "danger" if last.reason else "value"
    line: StyledLine = (("last reply  ", "label"), (f"{last.command.shown} -> {reply_text(last)}", role))
    return (*line, (f"  {last.reason}", "warning")) if last.reason else line


@dataclass(frozen=True, slots=True)
class FirstSteps:
    """What to do as long as nothing has happened: the program to run, the keys that drive, what to
    type, and where help is. `narrow` says keys and help in lines of a few words."""

    run: StyledLine
    keys: StyledLine
    typed: StyledLine
    help: StyledLine
    narrow: tuple[StyledLine, ...]

    @property
    def lines(self) -> tuple[StyledLine, ...]:
        return self.run, self.keys, self.typed, self.help


def first_steps(
    ports: Mapping[str, int], settings: ServerSettings, command: str, drive_keys: str
) -> FirstSteps:
    """How to begin. What to run needs nothing but this package; it gives the robot `command`."""
    return FirstSteps(
        (("run ", "label"), (_one_liner(ports, settings, command), "mark")),
        (("drive here: ", "label"), (f"Esc, then {drive_keys}", "mark"), ("; ", "label"), ("p", "mark"),
         (" reads all sensors", "label")),
        (("type a command below: ", "label"), ("u1", "mark"), (" reads, ", "label"), ("d1-3", "mark"),
         (" drives 3 in", "label")),
        (("help: ", "label"), (":help", "mark"), ("  all there is to do: ", "label"), ("Ctrl+P", "mark")),
        ((("drive here:", "label"),), (("Esc, then", "mark"),), ((drive_keys, "mark"),),
         (("p", "mark"), (" reads all", "label")), (), (("help:", "label"),), ((":help", "mark"),),
         (("Ctrl+P", "mark"), (" all", "label"))),
    )  # fmt: skip


def _one_liner(ports: Mapping[str, int], settings: ServerSettings, command: str) -> str:
    """A program of one line for the client library, with those arguments that are not as usual."""
    arguments = []
    if COMMANDS.purpose in ports:
        if ports[COMMANDS.purpose] != DEFAULT_PORT:
            arguments.append(f"port={ports[COMMANDS.purpose]}")
        elif ports.get(REPLIES.purpose, DEFAULT_REPLY_PORT) != DEFAULT_REPLY_PORT:
            arguments.append(f"reply_port={ports[REPLIES.purpose]}")
        usual = ServerSettings()
        if settings.reply_format != usual.reply_format:
            arguments.append(f"reply_format='{settings.reply_format}'")
        if settings.byte_order != usual.byte_order:
            arguments.append(f"byte_order='{settings.byte_order}'")
    elif PACKETS.purpose in ports:
        arguments.append("protocol='packets'")
        if ports[PACKETS.purpose] != DEFAULT_PACKET_PORT:
            arguments.append(f"port={ports[PACKETS.purpose]}")
        if ports[PACKET_REPLIES.purpose] != DEFAULT_PACKET_REPLY_PORT:
            arguments.append(f"reply_port={ports[PACKET_REPLIES.purpose]}")
    robot = f"Robot({', '.join(arguments)})"
    return f"python -c \"from simmer_tui import Robot; {robot}.send('{command}')\""


def _state(snapshot: Snapshot) -> tuple[str, str]:
    if snapshot.state.paused:
        return ("paused, a command waits" if snapshot.waiting else "paused"), "warning"
    if snapshot.state.touching:
        return "held by a wall" if snapshot.state.moving else "at a wall", "danger"
    return ("moving", "good") if snapshot.state.moving else ("standing", "value")


def _fact(label: str, value: str, role: str = "value") -> StyledLine:
    return (label.ljust(_LABEL), "label"), (value, role)


def _s(count: int) -> str:
    return "" if count == 1 else "s"
