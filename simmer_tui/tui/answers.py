"""Answers to what a person wants to know now, for the screen's one place for them.

They are first steps before anything has happened, the movement under way, the end of a run, and requested
answers.
"""

from collections.abc import Mapping, Sequence
from textwrap import shorten

from msgspec import Struct

from simmer_tui.live.snapshot import Snapshot
from simmer_tui.program.crash import own_frames
from simmer_tui.report.verdict import Outcome, Verdict
from simmer_tui.report.why import NOTHING_MOVED, WhyFact
from simmer_tui.run.events import MovementEnded, ProgramEnded, Result
from simmer_tui.run.facts import displacement
from simmer_tui.run.mission import MissionState
from simmer_tui.run.phrases import (
    capitalized,
    contact_line,
    contacts_text,
    exit_text,
    grip_text,
    movement_text,
    stopped_by_text,
    velocity_text,
)
from simmer_tui.sim.command import counted, parse_value, plural
from simmer_tui.sim.scan_rays import extremes
from simmer_tui.sim.specs import Axes, DriveKind
from simmer_tui.sketch.board_view import BoardView
from simmer_tui.tui.event_text import clock_text, grid_lines, off_piece
from simmer_tui.tui.gauges import bearing_words
from simmer_tui.tui.key_table import AGAIN_KEY, TRY_KEY
from simmer_tui.tui.line_panel import StyledLine, heading, length, shortened, wrapped_lines
from simmer_tui.tui.readouts import Room, goals_line, movement_line, spent_words, standing_scan
from simmer_tui.tui.sizes import BRIEF_ANSWER

# Two frames show the place and its caller; each has a line of code below it.
_FRAMES = 2
_OUTPUT = 4
"""Last lines shown of an error output without frames."""
# Three lines of 36 columns, with their indent, are enough for the cause itself. `:why` shows all of it.
_CAUSE = 98
"""Characters of a cause at the end of a run, unless its first sentence is longer."""
_LONG_SENTENCE = 140
"""Characters of a sentence that are shown."""


class AnswerCard(Struct, frozen=True):
    """An answer: `title` and `note` are its heading, `lines` all of it, `brief` the same in three lines.

    `role` is that of the title. An answer that `covers` takes the place of other lines on small screens.
    """

    title: str
    note: str
    lines: tuple[StyledLine, ...]
    brief: tuple[StyledLine, ...] = ()
    role: str = "title"
    covers: bool = True

    def shown(self, room: Room) -> list[StyledLine]:
        """Lines for a room: all, with a heading, or in brief if there are few rows."""
        if room.rows <= BRIEF_ANSWER:
            given = self.brief or self.lines
            lines: list[StyledLine] = [((" ", "plain"), *line) for line in given]
            wide = [part for line in lines for part in wrapped_lines(line, room.width - 1, 2)]
            # The last line itself, not the tail of it.
            return _fitted(wide, room, last=shortened(lines[-1], room.width - 1))
        head = heading(self.title, self.note, room.width, plain=room.plain)
        rest = [part for line in self.lines for part in wrapped_lines(line, room.width, 2)]
        return [((self.title, self.role), *head[1:]), *_fitted(rest, room, 1)]

    def rows(self, width: int) -> int:
        """Rows that all of it takes, with its heading."""
        return 1 + sum(len(wrapped_lines(line, width, 2)) for line in self.lines)


# The narrowest screen has 80, and a margin at both sides.
_BRIEF_COLUMNS = 78
"""Columns of a row of an answer in brief."""


def _fitted(
    lines: Sequence[StyledLine], room: Room, taken: int = 0, last: StyledLine | None = None
) -> list[StyledLine]:
    """As many lines as there is room for. If some are left out, `last` or the last of them stays, with the
    possible actions."""
    rows = max(room.rows - taken, 1)
    if len(lines) <= rows:
        return list(lines)
    kept = list(lines[: rows - 1])
    if kept:
        kept[-1] = shortened((*kept[-1], (" " * room.width, "plain"), ("…", "mark")), room.width)
    return [*kept, lines[-1] if last is None else last]


# -- before anything has happened ------------------------------------------------------------------


def first_steps(example: str, command: str, drive_keys: str, variable: str = "") -> AnswerCard:
    """Advice for a beginning.

    Args:
        example: Key that runs the sample program; empty if it cannot be run from here.
        command: A command that drives the robot.
        drive_keys: The keys that drive it.
        variable: The variable with which a program finds the robot, with its value; empty if it needs none.
    """
    typed: StyledLine = (("u1", "mark"), (" reads, ", "value"), (command, "mark"), (" drives", "value"))
    keys: StyledLine = (("Esc", "mark"), (", then ", "value"), (drive_keys, "mark"), (" drives", "value"))
    more: StyledLine = ((":help", "mark"), (" shows all there is to do", "value"))
    # In the folder that the documents name.
    copy, python = ("simmer-tui examples samples", "mark"), ("python samples/wander.py", "mark")
    runs: list[StyledLine] = [(("run a program in another terminal:", "value"),)]
    given: StyledLine = (("with ", "value"), (variable, "mark")) if variable else ()
    brief: StyledLine = (("run in another terminal: ", "value"), python)
    if variable:
        brief = (*brief, (" ", "value"), *given)
    if example:
        run: StyledLine = ((example, "mark"), (" runs the example, wander.py", "value"))
        runs = [run, (("or a program in another terminal:", "value"),)]
        brief = (
            (*run, (";  elsewhere ", "value"), *given)
            if given
            else (*run, (";  elsewhere: ", "value"), python)
        )
    press: StyledLine = (("or press ", "value"), *keys)
    steps = _numbered(*runs, (("or type: ", "value"), *typed), press)
    steps[len(runs) : len(runs)] = [(("  ", "plain"), *each) for each in ((copy,), (python,), given) if each]
    inches = " 3 in" if command.endswith("3") else ""
    below: StyledLine = (("or type below: ", "value"), *typed, (inches, "value"))
    in_brief = _numbered(brief, below, (*press, (";  ", "value"), *more))
    return AnswerCard("start", "", (*steps, (("  ", "plain"), *more)), tuple(in_brief))


def board_steps(*, has_line: bool) -> AnswerCard:
    """Advice for a beginning with boards, which alone drive the robot.

    Args:
        has_line: True if a board has a line to the laptop's program.
    """
    pins: StyledLine = ((":pins", "mark"), (" shows the pins of a board", "value"))
    more: StyledLine = ((":help", "mark"), (" shows all there is to do", "value"))
    runs = ('--run "python laptop.py"', "mark")
    if not has_line:
        lines: list[StyledLine] = _numbered((("the boards run by themselves", "value"),), pins)
        return AnswerCard("start", "", (*lines, (("  ", "plain"), *more)), (*lines, (("  ", "plain"), *more)))
    send: StyledLine = ((r":send F\n", "mark"), (" sends a board the line F", "value"))
    program: StyledLine = (("or with the laptop's program:", "value"),)
    steps = _numbered(send, program, pins)
    # Of 36 columns.
    steps[2:2] = [(("  simmer-tui --sketch DIR", "mark"),), (("    ", "plain"), runs)]
    brief: StyledLine = (*program, (" --sketch DIR ", "mark"), runs)
    in_brief = _numbered(send, brief, (*pins, (";  ", "value"), *more))
    return AnswerCard("start", "", (*steps, (("  ", "plain"), *more)), tuple(in_brief))


def _numbered(*lines: StyledLine) -> list[StyledLine]:
    return [((f"{number} ", "bold"), *line) for number, line in enumerate(lines, 1)]


# -- while the run continues -------------------------------------------------------------------------


def scan_answer(snapshot: Snapshot, *, plain: bool) -> AnswerCard | None:
    """The scan that was read last, if the robot has not moved since."""
    standing = standing_scan(snapshot.state)
    if standing is None:
        return None
    sensor, scan = standing
    found = extremes(scan)
    lines: list[StyledLine] = [
        ((counted(len(scan.ranges), "point"), "bold"), (f", {360.0 / len(scan.ranges):.3g} deg apart", "dim"))
    ]
    for word, echo in (("nearest ", found.nearest), ("farthest ", found.farthest)):
        if echo is not None:
            far, where = f"{echo[0]:.1f} {sensor.unit}", bearing_words(echo[1], plain=plain)
            lines.append(((word, "value"), (far, "bold"), (f" {where}", "value")))
    error: StyledLine = ((f"   error {100 * sensor.error:g} %", "value"),) if sensor.error else ()
    missed = counted(found.missed, "point")
    lines.append((("no echo ", "value"), (missed, "value"), *error))
    lines.append((("dots: where the beams ended", "dim"),))
    return AnswerCard(sensor.code, "read last", tuple(lines), covers=False)


def now_answer(snapshot: Snapshot, *, plain: bool) -> AnswerCard:
    """The movement under way, the last two ended ones, and the belief's error."""
    lines: list[StyledLine] = []
    going = movement_line(snapshot, plain=plain)
    velocity = snapshot.state.velocity
    if going:
        lines.append(going)
    elif velocity is not None:
        lines.append(((velocity_text(velocity), "good"), (" until the next command", "value")))
    lines += map(ended_line, snapshot.ends)
    belief = snapshot.state.belief
    if belief is not None:
        lines.append((("belief is off ", "value"), off_piece(belief)))
        lines += [((line, "belief"),) for line in (() if belief.grid is None else grid_lines(belief.grid))]
    if snapshot.state.ended is not None:
        lines.append(((":why", "mark"), (" explains the last movement", "value")))
    elif not lines:
        lines.append((("nothing has moved yet", "dim"),))
    return AnswerCard("now", "", tuple(lines), covers=False)


def ended_line(ended: MovementEnded) -> StyledLine:
    """A movement that is over: `r1--30 turned -29.6 deg, asked -30`."""
    command: StyledLine = ((ended.command.shown, "mark"), (" ", "plain"))
    if ended.contact is not None:
        return (*command, (contact_line(ended, ended.contact), "danger"))
    if ended.grip is not None:
        done = f"gripper {'closed' if ended.grip.closed else 'opened'}"
        return (*command, (grip_text(ended.grip) if ended.grip.holding else done, "value"))
    value = parse_value(ended.command.argument)
    asked = f", asked {value:g}" if isinstance(value, float) else ""
    return (*command, (f"{movement_text(ended)}{stopped_by_text(ended) or asked}", "value"))


# -- what was asked for ----------------------------------------------------------------------------


def why_answer(facts: Sequence[WhyFact], snapshot: Snapshot) -> AnswerCard:
    """The reasons for the end of the last movement."""
    ended = snapshot.state.ended
    if ended is None or not facts:
        return AnswerCard("why", "Esc closes", (((NOTHING_MOVED, "value"),),))
    lines: tuple[StyledLine, ...] = tuple(
        ((f"{fact.label:<8}", "label"), (fact.text, "danger" if fact.is_bad else "value")) for fact in facts
    )
    text = ", ".join(fact.text if fact.label == "errors" else f"{fact.label} {fact.text}" for fact in facts)
    brief: StyledLine = ((f"why {ended.command.shown}  ", "title"), (text, "value"), ("   Esc closes", "dim"))
    return AnswerCard(f"why {ended.command.shown}", "Esc closes", lines, (brief,))


def program_output(program: ProgramEnded) -> str:
    """The last lines of both outputs of a program that has ended, for a page."""
    lines: list[str] = []
    for name, printed in (("standard error", program.stderr), ("standard output", program.stdout)):
        if printed:
            lines += [f"Last lines of {name}", *(f"  {each.text}" for each in printed), ""]
    return "\n".join(lines) or "The program printed nothing."


def verdict_answer(verdict: Verdict) -> AnswerCard:
    """The whole verdict."""
    first, *rest = verdict.lines
    role = "danger" if verdict.has_failed else "bold"
    lines: list[StyledLine] = [((first, role),)]
    lines += [((line, "value"),) for line in rest]
    return AnswerCard("why", "Esc closes", tuple(lines))


def verdict_so_far(snapshot: Snapshot) -> Sequence[str]:
    """The verdict, or the state of the run while there is none."""
    if snapshot.verdict is not None:
        return snapshot.verdict.lines
    state = snapshot.state
    contacts, commands = contacts_text(state.contacts), counted(state.commands, "command")
    return (f"Still going after {state.time:.1f} s: {commands}, {state.distance:.1f} in driven, {contacts}.",)


def pins_answer(board: BoardView) -> AnswerCard:
    """The pins of a board that its sketch has used, the last line on its other ports, and the text on its
    displays."""
    lines: list[StyledLine] = [((f"{pin.name:>4}  ", "dim"), (pin.text, "value")) for pin in board.pins]
    lines += [((f"{port.name:>4}  ", "dim"), (port.line, "value")) for port in board.ports]
    lines += [(("     |", "dim"), (row, "value"), ("|", "dim")) for each in board.displays for row in each]
    shown = lines or [(("the sketch has used no pin yet", "dim"),)]
    return AnswerCard(f"pins of {board.name}", f"at {board.time:.3f} s; Esc closes", tuple(shown))


def bias_answer(bias: Mapping[DriveKind, Axes]) -> AnswerCard:
    """The drives' bias, by kind of movement: x, y and rotation."""
    lines: list[StyledLine] = [(("             x        y        r", "label"),)]
    for kind, axes in bias.items():
        numbers = f"{axes.x:+9.4f}{axes.y:+9.4f}{axes.r:+9.4f}"
        lines.append(((f"{kind.value:<6}", "label"), (numbers, "value")))
    brief = tuple(_bias_in_brief(axis, bias) for axis in Axes.__struct_fields__)
    return AnswerCard("drive bias", "Esc closes", tuple(lines), brief)


def _bias_in_brief(axis: str, bias: Mapping[DriveKind, Axes]) -> StyledLine:
    """The bias of all drives along one axis: `x  up +0.0413  down ...`."""
    parts: list[tuple[str, str]] = [(axis, "label")]
    for kind, axes in bias.items():
        parts += [(f"  {kind.value} ", "label"), (f"{getattr(axes, axis):+.4f}", "value")]
    return tuple(parts)


def note(title: str, text: str, role: str = "value") -> AnswerCard:
    """A sentence for a person about their last action."""
    return AnswerCard(title, "Esc closes", (((text, role),),))


# -- the end of a run ------------------------------------------------------------------------------


def end_answer(snapshot: Snapshot, *, orders: bool, tries: bool = False) -> AnswerCard | None:
    """The end of a run: outcome, cause, the program's last lines, numbers, and the possible actions. None
    while it continues. Without `orders`, as in a replay, no action is offered. With `tries` a failed run can
    be tried again with one change at a time."""
    mission, verdict = snapshot.mission, snapshot.verdict
    over = mission if mission is not None and mission.over else None
    if over is not None and over.result is Result.SUCCESS:
        return _success(snapshot, over, orders=orders)
    if verdict is not None and verdict.outcome is Outcome.CRASHED:
        program = verdict.program
        if program is not None and program.crashed:
            return _crash(snapshot, program, orders=orders, tries=tries)
    if over is not None:
        return _failure(snapshot, over.reason, orders=orders, tries=tries)
    if verdict is None or verdict.outcome is Outcome.STILL_GOING:
        return None
    if verdict.outcome.is_failure:
        return _failure(snapshot, _silent_text(verdict) or verdict.text, orders=orders, tries=tries)
    failed = verdict.has_failed
    text: StyledLine = ((verdict.text, "danger" if failed else "value"),)
    offered = _offered(_AFTERWARDS, orders=orders)
    tried = _tried(tries=tries and failed, orders=orders)
    return AnswerCard("result", "", (text, _numbers(snapshot), *tried, *offered))


_REPORT = (":report", "page")
_AFTERWARDS = ((":why", "more"), _REPORT, (AGAIN_KEY, "again"))
"""Orders and keys offered after the end of a run, each with its effect."""


def _tried(*, tries: bool, orders: bool) -> tuple[StyledLine, ...]:
    """The line about the key that tries a failed run again; none without `tries`."""
    return _offered(((TRY_KEY, "try again with one change"),), orders=orders and tries)


def _success(snapshot: Snapshot, mission: MissionState, *, orders: bool) -> AnswerCard:
    belief = snapshot.state.belief
    off: StyledLine = ()
    if belief is not None:
        distance, _ = displacement(belief.true, belief.pose)
        off = (*_GAP, ("belief ", "label"), (f"{distance:.1f}", "bold"), (" in off", "label"))
    contacts, commands = _amount(mission.contacts, "contact"), _amount(mission.commands, "command")
    driven: StyledLine = (*contacts, *_GAP, (f"{mission.distance:.1f}", "bold"), (" in driven", "label"))
    went: StyledLine = (
        ("Succeeded", "good"),
        (f" in {mission.time:.1f} s of {mission.plan.time_limit:g} s", "value"),
    )
    offered = _offered(_AFTERWARDS[1:], orders=orders)
    notes = _notes(snapshot.verdict)
    # Row 0 has the outcome and its time.
    numbers: StyledLine = (*driven, *_GAP, *commands)
    times: StyledLine = (*_GAP, *spent_words(mission.spent))
    if length(numbers) + length(times) <= _BRIEF_COLUMNS:
        numbers = (*numbers, *times)
    brief = (numbers, *(notes[:1] or [goals_line(mission)]), *offered)
    return AnswerCard("result", "", (went, driven, (*commands, *off), *notes, *offered), brief, role="good")


_GAP: StyledLine = (("   ", "plain"),)


def _notes(verdict: Verdict | None) -> list[StyledLine]:
    """Notes on events after the end of a mission, such as a crash."""
    return [] if verdict is None else [((each, "value"),) for each in verdict.notes]


def _failure(snapshot: Snapshot, reason: str, *, orders: bool, tries: bool) -> AnswerCard:
    verdict, mission = snapshot.verdict, snapshot.mission
    cause = None if verdict is None else verdict.cause
    lines: list[StyledLine] = [((reason, "danger"),)]
    if verdict is not None and cause is not None:
        lines.append(((_first_sentences(cause.text), "value"),))
    offered = _offered(_AFTERWARDS, orders=orders)
    notes = _notes(verdict)
    short: StyledLine = ((TRY_KEY, "mark"), (" try", "label")) if tries and orders else ()
    brief = (lines[-1], *notes, (*_numbers(snapshot), *_GAP, *(offered[0] if offered else ()), *short))
    lines += [*notes, *_went_on(snapshot), _numbers(snapshot), *_tried(tries=tries, orders=orders)]
    at = f"at {clock_text(mission.time)}" if mission is not None else ""
    return AnswerCard("why it failed", at, (*lines, *offered), brief, role="danger")


def _went_on(snapshot: Snapshot) -> tuple[StyledLine, ...]:
    """The line about commands after the mission's end: sensors, pose and events are of a later moment."""
    mission, state = snapshot.mission, snapshot.state
    if mission is None or not mission.over or state.commands <= mission.commands:
        return ()
    return ((("then it drove on, until ", "label"), (clock_text(state.time), "value")),)


def _first_sentences(text: str) -> str:
    """As many whole sentences of a cause as there is room for. A first sentence that is too long is cut."""
    first, *more = text.replace(". ", ".\n").split("\n")
    shown = shorten(first, _LONG_SENTENCE, placeholder=" …")
    for sentence in more:
        if len(shown) + 1 + len(sentence) > _CAUSE:
            break
        shown += f" {sentence}"
    return shown


def _crash(snapshot: Snapshot, program: ProgramEnded, *, orders: bool, tries: bool) -> AnswerCard:
    """The error of a program, and the calls before it, the innermost first."""
    lines: list[StyledLine] = [((program.error, "danger"),)]
    if program.signal:
        lines = [((f"The program was ended by signal {program.exit_code - 128}.", "danger"),), *lines]
    calls = _calls(program)
    numbers = _numbers(snapshot)
    offered = _offered(((":program", "whole error"), _REPORT), orders=orders)
    tried = _tried(tries=tries, orders=orders)
    note = f"exit code {program.exit_code}"
    second = (*calls[0], *_GAP, *calls[1]) if len(calls) > 1 else calls[0] if calls else numbers
    brief = ((*lines[0], (f"   {note}", "dim")), second, (*numbers, *_GAP, *(offered[0] if offered else ())))
    return AnswerCard("why it ended", note, (*lines, *calls, numbers, *tried, *offered), brief, role="danger")


def _calls(program: ProgramEnded) -> list[StyledLine]:
    """Calls before a program's error, otherwise its place, otherwise its last printed lines."""
    calls: list[StyledLine] = []
    for frame in own_frames([line.text for line in program.stderr])[:_FRAMES]:
        calls.append(((frame.place, "mark"), (f" in {frame.function}", "label")))
        if frame.code:
            calls.append(((f"    {frame.code}", "value"),))
    if calls or program.place:
        return calls or [((program.place, "mark"),)]
    said = [line.text.rstrip() for line in program.stderr if line.text.strip()]
    return [((line, "value"),) for line in said[-_OUTPUT:]]


def _silent_text(verdict: Verdict) -> str:
    """End of a program that printed no error; empty if there is more to report."""
    program = verdict.program
    if program is None or program.crashed:
        return ""
    code = program.exit_code
    if not code:
        return "The program ended and never connected."
    return "" if program.stderr else f"{capitalized(exit_text(code))} and printed no error."


def _numbers(snapshot: Snapshot) -> StyledLine:
    """Three numbers of a run, until its mission ended: simulated time, commands, contacts."""
    mission = snapshot.mission
    run = mission if mission is not None and mission.over else snapshot.state
    contacts = _amount(run.contacts, "contact", "danger" if run.contacts else "bold")
    time: StyledLine = ((f"{run.time:.1f}", "bold"), (" s", "label"))
    return (*time, *_GAP, *_amount(run.commands, "command"), *_GAP, *contacts)


def _amount(number: int, noun: str, role: str = "bold") -> StyledLine:
    """`1 contact`, `1,200 commands`: the number stands out."""
    return (f"{number:,}", role), (f" {plural(number, noun)}", "label")


def _offered(orders_and_words: Sequence[tuple[str, str]], *, orders: bool) -> tuple[StyledLine, ...]:
    """The possible orders, in one line; none without `orders`."""
    if not orders:
        return ()
    pieces: list[tuple[str, str]] = []
    for order, word in orders_and_words:
        pieces += [(order, "mark"), (f" {word}  ", "label")]
    return (tuple(pieces),)
