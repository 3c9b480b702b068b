"""Bars and panels of a run: lines of text made from snapshots."""

from collections.abc import Mapping, Sequence

from msgspec import Struct, field

from simmer_tui.live.snapshot import LogEntry, Snapshot
from simmer_tui.run.events import EventHandler, Notice, NoticeKind, Result
from simmer_tui.run.mission import MissionState
from simmer_tui.run.phrases import obstacles_text, progress_text, side_text, velocity_text
from simmer_tui.run.state import State, TimeSpent
from simmer_tui.sim.angles import half_turn
from simmer_tui.sim.command import counted, cut, parse_value
from simmer_tui.sim.records import LidarScan
from simmer_tui.sim.scan_rays import extremes
from simmer_tui.sim.specs import SensorSpec
from simmer_tui.sim.wheels import WheelKinematics
from simmer_tui.tui.event_text import (
    clock_text,
    last_event_line,
    off_piece,
    reply_text,
    screen_pose_text,
    spread_text,
    truth_text,
)
from simmer_tui.tui.gauges import bearing_words, gauge, heading_sign
from simmer_tui.tui.line_panel import StyledLine, between, heading, length, shortened
from simmer_tui.tui.sensor_readouts import seconds_since

# The longest labels, "contacts" and "commands", have eight letters.
LABEL = 9
"""Columns of a label."""
# Between the usual 80 columns and the 110 from which panels have all their lines.
ROOMY = 100
"""Columns from which a bar has room for less important items."""
# The widest panel beside a maze has 60: see sizes.py.
_WIDE_PANEL = 60
"""Columns from which a panel has room for a second place in one line."""
_GAP: StyledLine = (("  ", "plain"),)
# A heading, pose, belief and state; and a line each for contacts and block.
_WITH_BELIEF, _WITH_BLOCK = 4, 6
"""Rows of the robot's panel from which it shows more."""


class Room(Struct, frozen=True):
    """Room for lines, and all that they say beside a snapshot.

    Attributes:
        plain: true for ASCII.
        name: what is simulated.
        ports: ports that a program may connect to, by purpose; none for a run from a log.
        pointer: orders that give the reasons of a failure.
        program: name of the program that runs beside, if there is one.
        wheels: the robot's, if the set describes them.
    """

    width: int
    rows: int = 6
    plain: bool = False
    name: str = ""
    ports: Mapping[str, int] = field(default_factory=dict)
    pointer: str = ""
    program: str = ""
    wheels: WheelKinematics | None = None


def pose_line(snapshot: Snapshot, room: Room) -> StyledLine:
    """Pose, error of the belief, totals and mission in one line, as far as there is room."""
    state = snapshot.state
    pose: StyledLine = ((" pose ", "label"), *_place_pieces(snapshot, room))
    doing, role = _state(snapshot)
    lefts: tuple[StyledLine, ...] = ((*pose, (f"  {doing}", role)), pose)
    if state.belief is not None:
        off = off_piece(state.belief)
        lefts = (*pose, ("  belief off ", "label"), off), (*pose, ("  off ", "label"), off)
    driven = f"{state.distance:.1f} in  ", "label"
    count, later = _contacts(snapshot)
    contacts: StyledLine = ((f"{counted(count, 'contact')}{later}", "danger" if state.contacts else "label"),)
    rights: list[StyledLine] = [(("driven ", "label"), driven, *contacts), (driven, *contacts), contacts]
    least = contacts
    if snapshot.mission is not None:
        full, least = _goal_pieces(snapshot.mission, room.pointer)
        rights = [(*each, *_GAP, *full) for each in rights] + [(*contacts, *_GAP, *least)]
    # The pose is more important than the totals, and those more than their words.
    pairs = [(left, right) for left in lefts for right in rights] + [(left, least) for left in lefts]
    for left, right in pairs:
        if length(left) + length(right) + 2 <= room.width:
            return between(left, (*right, (" ", "plain")), room.width)
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
    full: StyledLine = ((f"{result}: {cut(mission.reason)}", "danger"), *orders)
    return full, ((result.upper(), "danger"), *orders[:1])


def robot_lines(snapshot: Snapshot, room: Room) -> list[StyledLine]:
    """Pose, belief, state, and the totals, below a heading, in the available lines."""
    state = snapshot.state
    head = heading("robot", "", room.width, plain=room.plain)
    pose = (("pose".ljust(LABEL), "label"), *_place_pieces(snapshot, room))
    doing = fact_line("state", *_state(snapshot))
    driven: StyledLine = (("   driven ", "label"), (f"{state.distance:.1f} in", "value"))
    role = "danger" if state.contacts else "bold"
    count, later = _contacts(snapshot)
    contacts: StyledLine = (("   contacts ", "label"), (f"{count}{later}", role))
    if room.rows < _WITH_BELIEF:
        return [head, pose, (*doing, *(contacts if state.contacts else driven))]
    believed = fact_line("belief", "none sent", "dim")
    if state.belief is not None:
        grid = state.belief.grid
        # The answer card shows the spread of a grid, beside its entropy.
        more = spread_text(state.belief) if grid is None else f", {truth_text(grid)}"
        off, believes = off_piece(state.belief, more)
        at = f", at {screen_pose_text(state.belief.pose)}" if room.width >= _WIDE_PANEL else ""
        believed = fact_line("belief", f"off {off}{at}", believes)
    if room.rows < _WITH_BLOCK:
        return [head, pose, believed, (*doing, *driven, *contacts)]
    last: StyledLine = ()
    if state.contact is not None:
        last = ((f", last {clock_text(state.contact.time)} {side_text(state.contact)}", "label"),)
    touched = (*fact_line("contacts", f"{count}{later}", role), *last)
    lines = [head, pose, believed, (*doing, *driven)]
    return [*lines, _wheels(snapshot, room) or touched, _block_line(snapshot)]


def _contacts(snapshot: Snapshot) -> tuple[int, str]:
    """Contacts of the run, or of its mission once that has ended; and those after it as `, later 1`."""
    mission, count = snapshot.mission, snapshot.state.contacts
    if mission is None or not mission.over or mission.contacts == count:
        return count, ""
    return mission.contacts, f", later {count - mission.contacts}"


def _wheels(snapshot: Snapshot, room: Room) -> StyledLine:
    """Rim speeds of a robot that drives at a velocity, with its contacts if there were any."""
    velocity = snapshot.state.velocity
    if room.wheels is None or velocity is None:
        return ()
    speeds = " ".join(f"{speed:.1f}" for speed in room.wheels.speeds(velocity))
    count = snapshot.state.contacts
    touched: StyledLine = ((f"   {counted(count, 'contact')}", "danger"),) if count else ()
    return (*fact_line("wheels", f"{speeds} in/s", "good"), *touched)


def _block_line(snapshot: Snapshot) -> StyledLine:
    block = snapshot.state.block
    if not block.size:
        return fact_line("block", "there is none", "dim")
    if snapshot.state.holding:
        return fact_line("block", "held by the robot")
    return fact_line("block", f"lies at {block.x:.1f}, {block.y:.1f} in")


def run_lines(snapshot: Snapshot, room: Room) -> list[StyledLine]:
    """The mission with its goals and the time spent; without one the time spent and the totals."""
    state, mission = snapshot.state, snapshot.mission
    # Once a mission has ended, its time stands still.
    spent = spent_lines(state.spent if mission is None else mission.spent, room)
    if mission is None:
        totals = fact_line("commands", f"{state.commands:,}", "bold")
        return [
            *spent,
            (*totals, ("   seed ", "label"), (f"{state.seed}", "value")),
            fact_line("set", room.name),
        ]
    note = "with help" if mission.helped else ""
    return [heading("mission", note, room.width, plain=room.plain), *mission_lines(mission, room), *spent]


def spent_lines(spent: TimeSpent, room: Room) -> list[StyledLine]:
    """Simulated time by purpose: one bar of three shares, and below it the words in the same colours."""
    width, shares = max(room.width - LABEL, 1), _shares(spent)
    whole = sum(seconds for seconds, _, _ in shares)
    bar: list[tuple[str, str]] = []
    done, at = 0.0, 0
    for seconds, role, _ in shares:
        done += seconds
        end = round(done / whole * width) if whole else 0
        bar.append((("=" if room.plain else "━") * (end - at), role))
        at = end
    if not whole:
        bar = [(("-" if room.plain else "─") * width, "rule")]
    words = [(f"{word} {seconds:.0f}", role) for seconds, role, word in shares]
    taken = sum(len(text) for text, _ in words) + 2  # with the unit
    gap = min(max((width - taken) // (len(words) - 1), 1), 2)
    pieces: list[tuple[str, str]] = [(" " * LABEL, "plain")]
    for text, role in words:
        pieces += [(text, role), (" " * gap, "plain")]
    unit: StyledLine = ((" s", "label"),) if taken + gap * (len(words) - 1) <= width else ()
    return [(("spent".ljust(LABEL), "label"), *bar), (*pieces[:-1], *unit)]


def spent_words(spent: TimeSpent) -> StyledLine:
    """The same in words only: `drive 46 s sense 7 s link 11 s`."""
    drive, *others = ((f"{word} {seconds:.0f} s", role) for seconds, role, word in _shares(spent))
    return (drive, *((f"  {text}", role) for text, role in others))


def _shares(spent: TimeSpent) -> Sequence[tuple[float, str, str]]:
    """Seconds for each purpose, its role and its word."""
    driving, sensing = (spent.driving, "driving", "drive"), (spent.reading, "sensing", "sense")
    return driving, sensing, (spent.link, "link", "link")


# Judged: a last tenth of the time is enough to stop, and too little for a detour.
_HURRY = 0.9
"""Share of the time limit from which the time stands out."""


def mission_lines(mission: MissionState, room: Room) -> list[StyledLine]:
    """Goals of a mission, each with a sign and the time when it was met, and the mission's time."""
    lines: list[StyledLine] = []
    drop, limit = mission.plan.drop_zone, mission.plan.time_limit
    missed = mission.result is Result.FAILED
    for goal, when in mission.goals.items():
        text = (goal.aim if when is None else goal.done).format(x=drop.x, y=drop.y)
        if when is not None:
            sign: StyledLine = (("+ " if room.plain else "✓ ", "good"), (text, "value"))
            lines.append(between(sign, ((clock_text(when), "label"),), room.width))
        else:
            mark = ("x " if room.plain else "✗ ") if missed else ("- " if room.plain else "○ ")
            lines.append(((mark, "danger" if missed else "dim"), (text, "value" if missed else "label")))
    said = f" {mission.time:.0f} of {limit:g} s"
    bar, number = ("danger", "danger") if mission.time >= _HURRY * limit else ("mark", "value")
    track = gauge(mission.time, limit, max(room.width - LABEL - len(said), 1), plain=room.plain, role=bar)
    return [*lines, (("time".ljust(LABEL), "label"), *track, (said, number))]


def goals_line(mission: MissionState) -> StyledLine:
    """The goals met so far in one line: `✓ loading zone 00:19 ✓ picked up 00:33`."""
    pieces: list[tuple[str, str]] = []
    for goal, when in mission.goals.items():
        if when is not None:
            time = clock_text(when).partition(".")[0]
            pieces += [("✓ ", "good"), (f"{goal.short} ", "value"), (f"{time}   ", "label")]
    return tuple(pieces)


class _Printed(EventHandler[str | None]):
    """A line that the program printed; None for any other event."""

    def on_notice(self, event: Notice) -> str | None:
        return event.text if event.kind is NoticeKind.PROGRAM else None


_PRINTED = _Printed()


def board_lines(snapshot: Snapshot, room: Room) -> list[StyledLine]:
    """Clock, busy share and LED of each board, the last line that it has sent, and its displays."""
    legend = "busy: not in delay()" if any(each.busy is not None for each in snapshot.boards) else ""
    lines = [heading("boards", legend, room.width, plain=room.plain)]
    for board in snapshot.boards:
        led = "on" if board.led else "off"
        busy = "" if board.busy is None else f"busy {board.busy:4.0%}  "
        state = f"  {board.time:.2f} s  {busy}LED {board.led_pin} {led}"
        # Where room is short, what the name loses is less than the LED's state.
        name = shortened(((board.name, "value"),), max(room.width - len(state), 1))
        lines.append((*name, (state, "plain")))
        if board.failed:
            lines.append(((f"  {board.failed}", "danger"),))
        elif board.line:
            lines.append((("  last line  ", "dim"), (board.line, "value")))
        lines += [
            (("  |", "dim"), (row, "value"), ("|", "dim")) for display in board.displays for row in display
        ]
    return [shortened(line, room.width) for line in lines]


def program_lines(snapshot: Snapshot, entries: Sequence[LogEntry], room: Room) -> list[StyledLine]:
    """The last lines that the program printed; after a failure those of its standard error."""
    verdict = snapshot.verdict
    program = None if verdict is None else verdict.program
    if program is not None and program.exit_code and program.stderr:
        head = heading("program", "last lines of its errors", room.width, plain=room.plain)
        errors = [(("  ", "plain"), (line.text, "value")) for line in program.stderr]
        return [head, *errors[-(room.rows - 1) :]]
    head = heading("program", "last lines of what it prints", room.width, plain=room.plain)
    printed: list[StyledLine] = []
    for entry in reversed(entries):
        if len(printed) >= room.rows - 1:
            break
        text = _PRINTED.handle(entry.event)
        if text is not None:
            printed.append(((f"{clock_text(entry.time)}  ", "dim"), (text, "value")))
    if not printed:
        printed = [(("shows what a program started with --run prints", "dim"),)]
    return [head, *reversed(printed)]


def status_line(
    snapshot: Snapshot, entries: Sequence[LogEntry], *, brief: bool, plain: bool = False
) -> StyledLine:
    """The line above the console while nothing is typed: the last reply. On small screens the movement under
    way, a scan or the last event."""
    if brief and snapshot.state.movement is not None:
        return movement_line(snapshot, plain=plain)
    found = standing_scan(snapshot.state) if brief else None
    if found is not None:
        return _scan_line(*found, plain=plain)
    if brief and entries:
        return last_event_line(entries)
    return (("last reply  ", "label"), *(last_reply(snapshot) or (("none yet", "value"),)))


def _scan_line(sensor: SensorSpec, scan: LidarScan, *, plain: bool) -> StyledLine:
    """A scan in one line: its points, and the nearest and farthest echo with their directions."""
    found = extremes(scan)
    pieces: list[tuple[str, str]] = [
        (sensor.code, "newest"),
        (f" {counted(len(scan.ranges), 'point')}", "value"),
    ]
    if found.nearest is None:
        pieces.append((", no echo", "value"))
    for word, echo in (("nearest", found.nearest), ("farthest", found.farthest)):
        if echo is not None:
            distance, bearing = echo
            where = f" {sensor.unit} {bearing_words(bearing, plain=plain)}"
            pieces += [(f", {word} ", "value"), (f"{distance:.1f}", "bold"), (where, "value")]
    return tuple(pieces)


def standing_scan(state: State) -> tuple[SensorSpec, LidarScan] | None:
    """A lidar and its scan, if that was the last reading and the robot has not moved since."""
    if state.moving or state.velocity is not None:
        return None
    newest = max(state.sensors.values(), key=lambda row: row.number, default=None)
    if newest is None or newest.reading.scan is None or newest.number <= state.moved:
        return None
    return newest.reading.sensor, newest.reading.scan


_NOW = 1.0
"""Seconds below which a reply's age is `now`: a number that changes with each frame cannot be read."""


def last_reply(snapshot: Snapshot) -> StyledLine:
    """The last command, its reply and the reply's age: `u1 -> 12.4 in  now`; empty before the first."""
    last = snapshot.state.last
    if last is None:
        return ()
    text = f"{last.command.shown} -> {reply_text(last, snapshot.state.ended)}"
    age = seconds_since(last.time, snapshot)
    told = "now" if age < _NOW else f"{age:.0f} s ago"
    shown: StyledLine = ((text, "danger" if last.reason else "value"), (f"  {told}", "dim"))
    return (*shown, (f"  {last.reason}", "warning")) if last.reason else shown


def movement_line(snapshot: Snapshot, *, plain: bool) -> StyledLine:
    """The movement under way: `▶ d1-12 forward, 4.1 of 12 in`; empty while the robot stands."""
    planned = snapshot.state.movement
    if planned is None:
        return ()
    text = progress_text(planned.trajectory, parse_value(planned.command.argument), snapshot.state.time)
    return (("> " if plain else "▶ ", "robot"), (planned.command.shown, "title"), (f" {text}", "bold"))


# -- within ----------------------------------------------------------------------------------------


def _place_pieces(snapshot: Snapshot, room: Room) -> StyledLine:
    """The pose, its heading also as an arrow, or as a point of the compass with north up."""
    pose = snapshot.state.pose
    heading_shown = half_turn(pose.heading)
    turned = f"{heading_shown:.0f}" if round(heading_shown) else "0"
    sign = heading_sign(pose.heading, plain=room.plain)
    return (f"{pose.x:.1f}, {pose.y:.1f} in  ", "value"), (f"{turned} deg {sign}", "bold")


def _state(snapshot: Snapshot) -> tuple[str, str]:
    """State of the robot in a few words, and its role."""
    if snapshot.state.paused:
        return ("paused, a command waits" if snapshot.waiting else "paused"), "warning"
    if snapshot.state.touching and snapshot.state.contact is not None:
        obstacle = obstacles_text((snapshot.state.contact,))
        return f"held by {obstacle}" if snapshot.state.moving else f"at {obstacle}", "danger"
    if snapshot.state.velocity is not None:
        return velocity_text(snapshot.state.velocity), "good"
    return ("moving", "good") if snapshot.state.moving else ("standing", "value")


def fact_line(label: str, value: str, role: str = "value") -> StyledLine:
    """A labelled value."""
    return (label.ljust(LABEL), "label"), (value, role)
