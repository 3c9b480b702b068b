"""Bars and panels of a run: snapshots turned into lines of text."""

from collections.abc import Mapping, Sequence

from msgspec import Struct, field

from simmer_tui import client
from simmer_tui.config.dialects import COMMANDS, PACKET_REPLIES, PACKETS, REPLIES
from simmer_tui.config.settings import ServerSettings
from simmer_tui.events import Result
from simmer_tui.mission import MissionState
from simmer_tui.phrases import counted
from simmer_tui.report.verdict import Outcome
from simmer_tui.run.state import TimeSpent
from simmer_tui.sim.command import escape, printable
from simmer_tui.snapshot import LogEntry, Snapshot
from simmer_tui.tui.event_text import belief_texts, clock, last_event_line, pose_text, reply_text
from simmer_tui.tui.line_panel import StyledLine, between, heading, length, shortened, wrapped
from simmer_tui.tui.maze.glyphs import ARROWS
from simmer_tui.tui.sensor_readouts import gauge

# The longest, "contacts" and "commands", have eight letters.
_LABEL = 9
_OUTCOMES = {Outcome.SUCCEEDED: "good", Outcome.FAILED: "danger", Outcome.CRASHED: "danger"}
"""Columns of a label."""
# Fewer letters of a name say nothing; a longer one is a path, whose end is cut.
_LEAST_NAME, _LONGEST_NAME = 12, 60
# Between the usual 80 columns and the 110 at which panels stand in full.
_ROOMY = 100
"""Columns from which a bar has room for what is not needed at every glance."""
_EAST_ON_PLAIN = ("E", "NE", "N", "NW", "W", "SW", "S", "SE")
# The widest panel beside a maze has 60: see sizes.py.
_WIDE_PANEL = 60
"""Columns from which a panel has room for a second place in one line."""
_GAP: StyledLine = (("  ", "plain"),)


class Room(Struct, frozen=True):
    """Room for lines, and all that they say beside a snapshot.

    Attributes:
        plain: true for ASCII.
        name: what is simulated.
        pace: speed of simulated time, in a word or two.
        ports: ports that a program may connect to, by purpose; none for a run from a log.
        pointer: orders that give the reasons of a failure.
    """

    width: int
    rows: int = 6
    plain: bool = False
    name: str = ""
    pace: str = ""
    ports: Mapping[str, int] = field(default_factory=dict)
    pointer: str = ""


def header_line(snapshot: Snapshot, room: Room) -> StyledLine:
    """The bar on top: simulated set, who drives it and how busily, its pace, seed and clock."""
    state = snapshot.state
    roomy = room.width >= _ROOMY
    right: StyledLine = ((f"{'o' if room.plain else '○'} no client", "dim"),)
    if state.client:
        who = state.client if roomy else state.client.rpartition(":")[0] or state.client
        rate = f"{snapshot.rate:.0f}{' commands' if roomy else ''}/s"
        right = ((f"{'*' if room.plain else '●'} ", "robot"), (f"client {who}  {rate}", "plain"))
    paused = "PAUSED, a command waits" if snapshot.waiting and roomy else "PAUSED"
    for text, role, shown in (
        (room.pace, "plain", bool(room.pace)),
        (paused, "title", state.paused),
        (f"seed {state.seed}", "plain", roomy),
        (clock(state.time), "plain", True),
    ):
        right = (*right, ("   ", "plain"), (text, role)) if shown else right
    left: StyledLine = ((" SimMeR", "title"),)
    free = room.width - length(left) - length(right) - 4
    if free >= min(len(room.name), _LEAST_NAME):
        left = (*left, (f"  {escape(room.name, min(free, _LONGEST_NAME))}", "dim"))
    return between(left, (*right, (" ", "plain")), room.width)


def pose_line(snapshot: Snapshot, room: Room) -> StyledLine:
    """Pose, error of the belief, totals and mission in one line: as much of each as there is room for."""
    state = snapshot.state
    pose: StyledLine = ((" pose ", "label"), (_place(snapshot, room), "bold"))
    doing, role = _state(snapshot)
    lefts: tuple[StyledLine, ...] = ((*pose, (f"  {doing}", role)), pose)
    if state.belief is not None:
        off = belief_texts(state.belief)[1].partition(",")[0], "belief"
        lefts = (*pose, ("  belief off ", "label"), off), (*pose, ("  off ", "label"), off)
    driven = f"{state.distance:.1f} in  ", "label"
    contacts: StyledLine = ((counted(state.contacts, "contact"), "danger" if state.contacts else "label"),)
    rights: list[StyledLine] = [(("driven ", "label"), driven, *contacts), (driven, *contacts), contacts]
    least = contacts
    if snapshot.mission is not None:
        full, least = _goal_pieces(snapshot.mission, room.pointer)
        rights = [(*each, *_GAP, *full) for each in rights] + [(*contacts, *_GAP, *least)]
    # The pose is worth more than the totals, and those more than the words for them.
    pairs = [(left, right) for left in lefts for right in rights] + [(left, least) for left in lefts]
    for left, right in pairs:
        if length(left) + length(right) + 2 <= room.width:
            right = (*right, (" ", "plain"))
            return between(_with_time(left, state.spent, room.width - length(right) - 1), right, room.width)
    return shortened(lefts[0], room.width)


def _goal_pieces(mission: MissionState, pointer: str) -> tuple[StyledLine, StyledLine]:
    """State of a mission, in full and in a word."""
    if not mission.over:
        left: StyledLine = ((f"{mission.time_left:.0f} s left", "value"),)
        return left, left
    result = mission.result.value
    if mission.result is Result.SUCCESS:
        return ((result, "good"),), ((result.upper(), "good"),)
    orders: StyledLine = tuple((f" {order}", "mark") for order in pointer.split())
    return (*mission_lines(mission)[0][1:], *orders), ((result.upper(), "danger"), *orders[:1])


def _with_time(line: StyledLine, spent: TimeSpent, width: int) -> StyledLine:
    """A line with the time spent behind it, if there is room."""
    told = time_lines(spent, width - length(line) - 2)
    longer = (*line, *_GAP, *told[0]) if told else line
    return longer if length(longer) <= width else line


def robot_lines(snapshot: Snapshot, room: Room) -> list[StyledLine]:
    """Pose, belief, state, and the totals, below a heading."""
    state, block = snapshot.state, snapshot.state.block
    believed = _fact("belief", "none told", "dim")
    if state.belief is not None:
        place, off = belief_texts(state.belief)
        at = f", at {place}" if room.width >= _WIDE_PANEL else ""
        believed = _fact("belief", f"off {off}{at}", "belief")
    if not block.size:
        lies = _fact("block", "there is none", "dim")
    elif state.holding:
        lies = _fact("block", "held by the robot")
    else:
        lies = _fact("block", f"lies at {block.x:.1f}, {block.y:.1f} in")
    last = f", last {clock(state.contact.time)}" if state.contact is not None else ""
    return [
        heading("robot", "", room.width, plain=room.plain),
        _fact("pose", _place(snapshot, room)),
        believed,
        (*_fact("state", *_state(snapshot)), ("   driven ", "label"), (f"{state.distance:.1f} in", "value")),
        _fact("contacts", f"{state.contacts}{last}", "danger" if state.contacts else "value"),
        lies,
    ]


def run_lines(snapshot: Snapshot, room: Room) -> list[StyledLine]:
    """State of the run: mission, commands, noise, and the ports that a program may connect to."""
    state, mission = snapshot.state, snapshot.mission
    link = link_lines(snapshot, room.ports)
    title = heading("run" if mission is None else "mission", "", room.width, plain=room.plain)
    lines = [title, *link[:1], *time_lines(state.spent, room.width)]
    if snapshot.verdict is not None:
        role = _OUTCOMES.get(snapshot.verdict.outcome, "value")
        lines += wrapped(_fact("verdict", printable(snapshot.verdict.text), role), room.width, _LABEL)
    elif mission is not None:
        for line in mission_lines(mission, plain=room.plain):
            lines += wrapped(line, room.width, _LABEL)
    if mission is not None and room.pointer and mission.result is Result.FAILED:
        lines.append(_fact("reasons", room.pointer, "mark"))
    lines.append(_fact("commands", f"{state.commands}, {snapshot.rate:.0f}/s"))
    lines.append(_fact("seed", f"{state.seed}{'' if state.noise else ', noise off'}"))
    lines += link[1:]
    # The least needed first.
    for spare in ("seed", "commands", "client"):  # the header shows the client too
        if len(lines) > room.rows:
            lines = [line for line in lines if not line[0][0].startswith(spare)]
    return lines


def time_lines(spent: TimeSpent, width: int) -> list[StyledLine]:
    """Simulated time by purpose, once reading or the link has taken any, and the sensor that took most."""
    if not (spent.reading or spent.link):
        return []
    most = max(spent.by_sensor, key=lambda code: spent.by_sensor[code], default="")
    dearest = f" ({most} {spent.by_sensor[most]:.1f})" if most else ""
    text = f"drive {spent.driving:.1f} s, read {spent.reading:.1f}{dearest}, link {spent.link:.1f}"
    if _LABEL + len(text) > width:
        brief = f" {most}" if most else ""
        text = f"drive {spent.driving:.0f} read {spent.reading:.0f}{brief} link {spent.link:.0f} s"
    return [_fact("time", text)]


def mission_lines(mission: MissionState, *, plain: bool = False) -> list[StyledLine]:
    """State of a mission, and its next goal."""
    met = sum(when is not None for when in mission.goals.values())
    if mission.over:
        role = "good" if mission.result is Result.SUCCESS else "danger"
        reason = f": {escape(mission.reason)}" if mission.reason else ""
        return [_fact("mission", f"{mission.result.value}{reason}", role)]
    following = next((goal.value for goal, when in mission.goals.items() if when is None), "")
    holding = ", holding the block" if mission.holding else ""
    bar = gauge(mission.time, mission.plan.time_limit, 6, plain=plain)
    return [
        (*_fact("mission", f"{mission.time_left:.0f} s left{holding} "), *bar),
        _fact("goals", f"{met} of {len(mission.goals)} met, next: {following}"),
    ]


def link_lines(snapshot: Snapshot, ports: Mapping[str, int]) -> list[StyledLine]:
    """The client that is connected, and the ports for one."""
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


# -- before anything has happened ------------------------------------------------------------------


class FirstSteps(Struct, frozen=True):
    """Advice as long as nothing has happened. `lines` are a program to run, keys that drive, commands to
    type, and help; `narrow` has keys and help in lines of a few words."""

    lines: tuple[StyledLine, ...]
    narrow: tuple[StyledLine, ...]


def first_steps(
    ports: Mapping[str, int], settings: ServerSettings, command: str, drive_keys: str
) -> FirstSteps:
    """Advice for a beginning. The program needs nothing but this package; it gives the robot `command`."""
    return FirstSteps(
        ((("run ", "label"), (_one_liner(ports, settings, command), "mark")),
         (("drive here: ", "label"), (f"Esc, then {drive_keys}", "mark"), ("; ", "label"), ("p", "mark"),
          (" reads all sensors", "label")),
         (("type a command below: ", "label"), ("u1", "mark"), (" reads, ", "label"), ("d1-3", "mark"),
          (" drives 3 in", "label")),
         (("help: ", "label"), (":help", "mark"), ("  all there is to do: ", "label"), ("Ctrl+P", "mark"))),
        ((("drive here:", "label"),), (("Esc, then", "mark"),), ((drive_keys, "mark"),),
         (("p", "mark"), (" reads all", "label")), (), (("help:", "label"),), ((":help", "mark"),),
         (("Ctrl+P", "mark"), (" all", "label"))),
    )  # fmt: skip


def _one_liner(ports: Mapping[str, int], settings: ServerSettings, command: str) -> str:
    """A program of one line for the client library, with those arguments that are not as usual."""
    arguments = []
    if COMMANDS.purpose in ports:
        if ports[COMMANDS.purpose] != client.DEFAULT_PORT:
            arguments.append(f"port={ports[COMMANDS.purpose]}")
        elif ports.get(REPLIES.purpose, client.DEFAULT_REPLY_PORT) != client.DEFAULT_REPLY_PORT:
            arguments.append(f"reply_port={ports[REPLIES.purpose]}")
        usual = ServerSettings()
        if settings.reply_format != usual.reply_format:
            arguments.append(f"reply_format='{settings.reply_format}'")
        if settings.byte_order != usual.byte_order:
            arguments.append(f"byte_order='{settings.byte_order}'")
    elif PACKETS.purpose in ports:
        arguments.append("protocol='packets'")
        if ports[PACKETS.purpose] != client.DEFAULT_PACKET_PORT:
            arguments.append(f"port={ports[PACKETS.purpose]}")
        if ports[PACKET_REPLIES.purpose] != client.DEFAULT_PACKET_REPLY_PORT:
            arguments.append(f"reply_port={ports[PACKET_REPLIES.purpose]}")
    robot = f"Robot({', '.join(arguments)})"
    return f"python -c \"from simmer_tui import Robot; {robot}.send('{command}')\""


def _place(snapshot: Snapshot, room: Room) -> str:
    """Pose, with its heading as an arrow too, or as a point of the compass with north up."""
    pose = snapshot.state.pose
    arrows = _EAST_ON_PLAIN if room.plain else ARROWS
    return f"{pose_text(pose)} {arrows[round(pose.heading / 45) % 8]}"


def _state(snapshot: Snapshot) -> tuple[str, str]:
    """State of the robot in a few words, and its role."""
    if snapshot.state.paused:
        return ("paused, a command waits" if snapshot.waiting else "paused"), "warning"
    if snapshot.state.touching:
        return "held by a wall" if snapshot.state.moving else "at a wall", "danger"
    return ("moving", "good") if snapshot.state.moving else ("standing", "value")


def _fact(label: str, value: str, role: str = "value") -> StyledLine:
    return (label.ljust(_LABEL), "label"), (value, role)
