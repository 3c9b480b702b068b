"""The terminal app: the screen of a live run, with a console to take part in it."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import ClassVar

from textual.app import SystemCommand
from textual.binding import Binding, BindingType
from textual.events import Event, Key
from textual.screen import Screen
from textual.widget import Widget
from textual.worker import get_current_worker

from simmer_tui import platform_has
from simmer_tui.config.dialects import COMMANDS
from simmer_tui.config.examples import EXAMPLE, example_command
from simmer_tui.config.settings import ScreenSettings
from simmer_tui.errors import ProgramError, RunLogError, reason_of
from simmer_tui.live.operating.orders import ConsoleCommand, Local
from simmer_tui.live.operating.robot_operator import Operator
from simmer_tui.live.server import Server
from simmer_tui.live.snapshot import Snapshot
from simmer_tui.report.why import why
from simmer_tui.robot.playback_throttle import checked_pace
from simmer_tui.run.events import Action
from simmer_tui.runlog.saved_runs import SavedRun
from simmer_tui.sim.command import WORD, Command, cut, typed_path
from simmer_tui.sim.specs import DriveKind
from simmer_tui.tui import answers
from simmer_tui.tui.console import ConsolePane, History
from simmer_tui.tui.event_text import REASONS, ends_with_answer, refusal_of
from simmer_tui.tui.headline import RunPhase
from simmer_tui.tui.help import PAGE_FRAME, CommandProvider, ReportScreen, help_screen
from simmer_tui.tui.key_table import (
    AGAIN_KEY,
    EXAMPLE_KEY,
    IN_CONSOLE,
    TRY_KEY,
    Hint,
    MazePane,
    drive_keys,
    hints_of,
    keymap,
    maze_hints,
)
from simmer_tui.tui.key_velocity import PERIOD, KeyVelocity
from simmer_tui.tui.line_panel import LinePanel, between, shortened
from simmer_tui.tui.live import LiveSource, report_text, why_text
from simmer_tui.tui.picture import screen_picture
from simmer_tui.tui.readouts import Room, last_reply, status_line
from simmer_tui.tui.shell import Shell, put
from simmer_tui.tui.sizes import BRIEF_ANSWER, Box
from simmer_tui.tui.terminal import TerminalChoice
from simmer_tui.tui.textual_internals import age_of, rows_of
from simmer_tui.whole_file import NOT_OVERWRITTEN, write_whole

_PROMPT = 5
"""Columns by which typed text is longer than the reply beside it, on a small screen."""
# These have an order or a key of their own here.
_REPLACED = ("Screenshot", "Keys", "Maximize", "Minimize", "Quit")


class SimmerApp(Shell):
    """The screen of a live run: keys that drive, and a console."""

    TITLE = "SimMeR"
    COMMANDS = {CommandProvider}  # noqa: RUF012
    ENABLE_COMMAND_PALETTE = True
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("colon", "colon", priority=True),
        Binding("enter", "focus_console", priority=True),
        Binding(EXAMPLE_KEY.lower(), "example"),
        Binding(AGAIN_KEY, "again", priority=True),
        Binding(TRY_KEY, "try_changes", priority=True),
    ]

    def __init__(
        self, server: Server, choice: TerminalChoice, history_file: Path | None = None, *, program: str = ""
    ) -> None:
        """`program` is the name of the run's own program, or empty."""
        super().__init__(LiveSource(server), choice, MazePane(choice.glyphs, choice.color))
        self.server = server
        self._console = ConsolePane(self._spec, History(history_file), self.follow)
        self._console.free_keys = {
            AGAIN_KEY: partial(self._over, self.action_again),
            TRY_KEY: partial(self._over, self.action_try_changes),
        }
        self._prompt = LinePanel(id="prompt")
        self._reply = LinePanel(id="reply")
        self._operator = Operator(server)
        self._held_key = KeyVelocity(self._operator, server)
        self.run_program: Callable[[str], None] | None = None
        """Starts a program beside the run; None where there may be none, as beside another."""
        self.page_links: tuple[str, ...] = ()
        """Lines with the links to the page that shows the run in browsers."""
        self._written: set[Path] = set()
        """The files that orders have written: only those may be written again."""
        self.run_again: Callable[[], None] = partial(self.action_press, "reset")
        """Restarts the run."""
        self._panes.pointer = " ".join(REASONS)
        self._panes.slot.first_steps = self._first_steps
        self._panes.slot.has_orders = True
        self._panes.slot.tries = bool(program)
        self._panes.program_name = program

    # -- putting together ------------------------------------------------------------------------

    def controls(self) -> Iterable[Widget]:
        return self._head, self._console, self._prompt, self._reply

    def on_mount(self) -> None:
        self.set_keymap(keymap(self._settings.keys))
        self._console.focus_line()
        self.paste_target = self._console.line
        for warning in self.server.warnings:
            self._operator.hint(warning)
        if self._settings.screen.keys_velocity:
            self.set_interval(PERIOD, self._held_key.pass_time)

    def shown(self, snapshot: Snapshot, since: int) -> None:
        self._operator.note_block(snapshot.state)
        refusal = refusal_of(snapshot.entries, since)
        new = [entry for entry in snapshot.entries if entry.number > since]
        if refusal is not None:
            self._console.show_refusal(refusal)
        elif any(not entry.folds for entry in new):
            self._console.note_event()

    def show_status(self, snapshot: Snapshot) -> None:
        brief = "events" not in self._plan.boxes
        entries = self._panes.log.entries if brief else ()
        status = status_line(snapshot, entries, brief=brief, plain=self._plain)
        answer = self._panes.answer
        is_free = not ends_with_answer(entries, self._panes.slot.asked_at)
        if brief and is_free and "answer" in self._plan.boxes and answer is not None and answer.covers:
            # The third of its lines: the other two take the rows of legend and pose.
            lines = answer.shown(Room(self.size.width, BRIEF_ANSWER, self._plain))
            status = lines[2][1:] if len(lines) > 2 else ()
        self._console.show_status(status, () if brief else last_reply(snapshot))
        room = self._reply.size.width
        self._reply.show([between((), shortened(last_reply(snapshot), room - 1), room)])

    def _arrange(self, width: int, height: int) -> None:
        super()._arrange(width, height)
        typed = self._console.has_focus_within
        self._show_head("console", "" if typed else ": or Enter comes here")
        console = self._plan.boxes.get("console")
        # Without events the line above shows the present movement, and the last reply is beside the typed
        # text.
        room = console.width // 2 - _PROMPT if console is not None and "events" not in self._plan.boxes else 0
        self._prompt.display, self._reply.display = console is not None, room > 0
        if console is not None:
            put(self._prompt, Box(console.x + 1, console.y + 1, 1, 1))
            self._prompt.show([((">", "title"),)])
            self._console.line.styles.width = console.width - room if room > 0 else "1fr"
            put(self._reply, Box(console.x + console.width - room, console.y + 1, max(room - 1, 1), 1))

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Leave keys to pages and text fields that have a use of their own for them."""
        if action in ("colon", "again", "try_changes", "focus_console"):
            is_elsewhere = len(self.screen_stack) == 1 and not self._console.has_focus_within
            after_end = action in ("again", "try_changes")
            return is_elsewhere and (not after_end or self._panes.phase.is_over)
        return super().check_action(action, parameters)

    def _first_steps(self) -> answers.AnswerCard:
        drives = [drive for drive in self._spec.drives if drive.enabled]
        drives.sort(key=lambda drive: drive.kind is not DriveKind.RIGHT)  # forward, if it can
        command = f"{drives[0].code}-3" if drives else "u1"
        key = EXAMPLE_KEY if self._can_run_example else ""
        port = self.server.ports.get(COMMANDS.purpose)
        variable = "" if port in (None, COMMANDS.default) else f"{COMMANDS.variable}={port}"
        return answers.first_steps(key, command, drive_keys(self._settings.keys), variable)

    @property
    def _can_run_example(self) -> bool:
        """True while a simulated robot, on the ports that the sample program knows, waits for a program."""
        server = self.server
        is_simulated = server.robot is None and self._settings.sim
        is_waiting = self._panes.phase is RunPhase.WAITING
        return (
            self.run_program is not None and is_simulated and is_waiting and COMMANDS.purpose in server.ports
        )

    def action_example(self) -> None:
        """Run the sample program, if a robot waits for one."""
        if not self._can_run_example or self.run_program is None:
            return
        try:
            self.run_program(example_command())
        except ProgramError as error:
            self._console.show_error(str(error))
        else:
            self.run_program = None
            self._panes.program_name = EXAMPLE

    def action_again(self) -> None:
        """Restart the run after its end, and its program with it."""
        self._panes.slot.close()
        self._console.forget_errors()
        self.run_again()
        self.refresh_frame()

    def _over(self, act: Callable[[], object]) -> bool:
        """Do an action for a run that is over, by the key for it in an empty console."""
        if self._panes.phase.is_over:
            act()
            return True
        return False

    def action_try_changes(self) -> None:
        """Run the program of a failed run again, with one change at a time, and show what saves it."""
        saved = self.server.saved_run
        if not self._panes.phase.is_over:
            self._console.show_error("try: the run has not ended yet")
        elif saved is None:
            self._console.show_error("try: this run is not saved; start with --log FILE for simmer-tui why")
        elif not self.server.program_command:
            line = f'simmer-tui why {typed_path(saved.path)} --run "CMD"'
            self._console.show_error(f"try: no program was started with --run; type {line}")
        else:
            self.begin(partial(self._try_changes, saved), "try", once=True)

    async def _try_changes(self, saved: SavedRun) -> None:
        """Show the progress of the runs on a page, and then their answer. Closing the page ends them."""
        worker = get_current_worker()
        room, title = self.size.width - PAGE_FRAME, "Try again with one change"
        screen = ReportScreen("Starting ...", title, "Esc closes, and ends the runs")
        await self.push_screen(screen, lambda _: worker.cancel())
        try:
            text = await why_text(saved, room, self._plain, screen.replace)
        except OSError as error:
            text = f"The runs cannot be started: {reason_of(error)}"
        screen.replace(text)

    def page_turned(self) -> None:
        if not self._console.has_focus_within:
            self.action_focus_pane()

    def hints(self) -> Sequence[Hint]:
        if self._console.has_focus_within:
            return hints_of(IN_CONSOLE)
        return maze_hints(self._settings.keys) if self._maze.has_focus else super().hints()

    # -- what people do --------------------------------------------------------------------------

    def action_order(self, line: str) -> None:
        """Do an order as if it were typed in the console."""
        self._console.give(line)

    def action_colon(self) -> None:
        """Begin an order; the next typed text belongs to it."""
        self._console.focus_line(":")

    def action_begin_order(self, line: str) -> None:
        """Put the beginning of an order into the console."""
        self._console.focus_line(line)

    def follow(self, order: ConsoleCommand) -> None:
        """Carry out an order or a command."""
        if isinstance(order, Command):
            self._operator.send(order, partial(self._console.refuse, self._console.given, order.text))
        elif isinstance(order, Action):
            self._console.show_error(self._operator.perform(order))
        else:
            self._follow_local(order)
        self.refresh_frame()

    def _follow_local(self, order: Local) -> None:
        if order.name in self._panes.shown:
            self.action_switch(order.name, order.argument)
            return
        orders: dict[str, Callable[[str], object]] = {
            "quit": lambda _: self.exit(0),
            "help": self.action_help,
            "step": lambda _: self.action_press("step"),
            "pace": lambda factor: self._set_pace(float(factor)),
            "why": self._show_why,
            "report": lambda _: self.begin(self._show_report, "report", once=True),
            "try": lambda _: self.action_try_changes(),
            "program": lambda _: self._show_program(),
            "bias": lambda _: self.ask(answers.bias_answer(self.server.simulator.bias), stays=True),
            "vv": self._drive_for,
            "send": lambda text: self._console.show_error(self._operator.send_text(text)),
            "pins": self._show_pins,
            "log": lambda file: self.begin(partial(self._start_log, file), "log"),
            "robot": self.server.use_robot,
            "simulator": lambda _: self.server.use_simulator(),
            "web": lambda _: self._show_links(),
            "copy": lambda _: self.action_copy_log(),
            "shot": self._write_picture,
            "save": lambda file: self._write(file, self._panes.whole_log, "log"),
        }
        orders[order.name](order.argument)

    def _show_why(self, about: str) -> None:
        """Show the verdict. While the run continues, and about a `move`, show the reasons for the end of the
        last movement."""
        snapshot = self._snapshot
        if snapshot is None:
            return
        if snapshot.verdict is None or about:
            self.ask(answers.why_answer(why(snapshot.state, self._spec), snapshot), stays=True)
        elif self._plan.has_pages:  # three rows would cut it
            # As wide as the page's text, which is not wrapped.
            room = self.size.width - PAGE_FRAME
            text = "\n\n".join(fill(line, room) for line in snapshot.verdict.lines)
            self.push_screen(ReportScreen(text, "Why", "Esc closes"))
        else:
            self.ask(answers.verdict_answer(snapshot.verdict))

    async def _show_report(self) -> None:
        """Show the report of this run: first the verdict, and the rest once it is made from the log."""
        saved, snapshot = self.server.saved_run, self._snapshot
        if saved is None:
            self._console.show_error(
                "report: this run is not saved; :log FILE logs it, simmer-tui report reads it"
            )
            return
        begun = answers.verdict_so_far(snapshot) if snapshot is not None else ()
        note = f"Esc closes; saved in {saved.path.name}"
        text = "\n".join([*(each for each in begun), "", "Reading the run ..."])
        screen = ReportScreen(text, "Report of this run", note)
        # Shown before the machine is busy with making it.
        await self.push_screen(screen)
        try:
            text = await report_text(saved, self.size.width - PAGE_FRAME, self._plain)
        except OSError as error:
            text = f"The report cannot be made: {reason_of(error)}"
        screen.replace(text)

    def _show_program(self) -> None:
        """Show the last lines that the program has printed."""
        snapshot = self._snapshot
        verdict = None if snapshot is None else snapshot.verdict
        if verdict is None or verdict.program is None:
            self._console.show_error("program: none has ended yet; the events have its output (/ program)")
            return
        text = answers.program_output(verdict.program)
        self.push_screen(ReportScreen(text, "Program", f"Esc closes; exit code {verdict.program.exit_code}"))

    def _show_pins(self, name: str) -> None:
        """Show the pins of a board, by default the first."""
        boards = self._snapshot.boards if self._snapshot is not None else ()
        board = next((each for each in boards if name in ("", each.name)), None)
        if board is None:
            what = "no boards run; simmer-tui --sketch DIR runs them"
            if boards:
                known = " or ".join(f":pins {each.name}" for each in boards)
                what = f"there is no board {cut(name, WORD)}; type {known}"
            self._console.show_error(f"pins: {what}")
        else:
            self.ask(answers.pins_answer(board), stays=True)

    def _write_picture(self, name: str) -> None:
        dark = self._settings.screen.theme != "light"
        self._write(name, screen_picture(rows_of(self.screen), dark=dark), "picture")

    def _write(self, name: str, text: str, what: str) -> None:
        file = platform_has.expanded(name)
        try:
            if file.is_file() and file.stat().st_size and file.resolve() not in self._written:
                raise FileExistsError(0, f"{NOT_OVERWRITTEN}; name another file")
            write_whole(file, text)
            self._written.add(file.resolve())
        except (OSError, ValueError) as error:  # ValueError: a name with a zero byte
            self._console.show_error(f"{name}: {reason_of(error)}")
        else:
            self._operator.hint(f"{what} written to {file}")

    def _show_links(self) -> None:
        """Show the links to the page, until the answer is closed."""
        if not self.page_links:
            self._console.show_error("web: no page is served; start with --web")
            return
        text = "\n\n".join(self.page_links)
        self.push_screen(ReportScreen(text, "Page", "Esc closes; anyone who has a link may use it"))

    async def _start_log(self, name: str) -> None:
        """Log the run from now on, or show why that fails."""
        try:
            file = await self.server.begin_log(name)
        except RunLogError as error:
            self._console.show_error(str(error))
        else:
            self._operator.hint(f"logging to {file}")

    def _drive_for(self, values: str) -> None:
        refused = partial(self._console.refuse, self._console.given, f":vv {values.replace(';', ' ')}")
        self._console.show_error(self._operator.drive_for(values, refused))

    async def on_event(self, event: Event) -> None:
        """End the velocity of a held key at any other key, before the action of that key."""
        if isinstance(event, Key) and not event.is_forwarded:
            self._held_key.note_key(event.key if self._maze.has_focus else "", age_of(event))
        await super().on_event(event)

    def action_drive(self, name: str, fine: bool) -> None:
        """Drive or turn by a key's step."""
        self._console.forget_errors()
        by_velocity = self._settings.screen.keys_velocity
        self._console.show_error((self._held_key if by_velocity else self._operator).drive(name, fine))
        self.refresh_frame()

    def action_press(self, name: str) -> None:
        """Do the action of a key: `stop`, `poll`, `reset`, `pause`, `step`."""
        self._console.forget_errors()
        paused = self._snapshot is not None and self._snapshot.state.paused
        self._console.show_error(self._operator.press(name, paused))
        self.refresh_frame()

    def action_pace(self, factor: float) -> None:
        """Show movements faster or slower by a factor. From as fast as possible it returns to the usual pace;
        the factor 0 is as fast as possible."""
        pace, usual = self.server.pace, self._settings.screen.pace or ScreenSettings().pace
        self._set_pace(pace * factor if pace or not factor else usual)

    def _set_pace(self, pace: float) -> None:
        if self.server.engine.timed:
            self._console.show_error("no effect: timed motion takes its time; :speed changes it")
            return
        pace = checked_pace(pace)
        self.server.set_pace(pace)
        how = f"{pace:g} times real speed" if pace else "as fast as possible"
        self.tell(f"movements are shown {how}")

    def action_help(self, code: str = "") -> None:
        """Show all of the help, or the description of one code."""
        self.push_screen(help_screen(self._settings.keys, self._spec, self._maze.painter, code))

    def tell(self, text: str) -> None:
        """Show a note above the console's line."""
        self._console.show_note(text)

    def action_focus_console(self) -> None:
        self._console.focus_line()

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        """Textual's own commands, without those that have an order here."""
        theirs = super().get_system_commands(screen)
        return [each for each in theirs if each.title not in _REPLACED]
