"""The terminal app: the screen around a run that a server is at, with a console to take part in it."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import ClassVar

from textual.app import SystemCommand
from textual.binding import Binding, BindingType
from textual.screen import Screen
from textual.widget import Widget

from simmer_tui.config.settings import ScreenSettings
from simmer_tui.errors import RunLogError
from simmer_tui.events import Action
from simmer_tui.playback_throttle import checked_pace
from simmer_tui.report.why import why
from simmer_tui.server import Server
from simmer_tui.sim.command import Command, escape, printable
from simmer_tui.sim.specs import DriveKind
from simmer_tui.snapshot import Snapshot
from simmer_tui.tui.console import ConsolePane, History
from simmer_tui.tui.event_text import POINTER, REASONS, complaint_of, has_failed
from simmer_tui.tui.help import CommandProvider, HelpScreen, help_screen
from simmer_tui.tui.key_table import IN_CONSOLE, Hint, MazePane, drive_keys, hints_of, keymap, maze_hints
from simmer_tui.tui.line_panel import LinePanel, heading, length
from simmer_tui.tui.live import LiveSource, Operator, report_of
from simmer_tui.tui.orders import ConsoleCommand, Local
from simmer_tui.tui.picture import picture
from simmer_tui.tui.readouts import FirstSteps, first_steps, link_lines, status_line
from simmer_tui.tui.shell import Shell, put
from simmer_tui.tui.sizes import Box
from simmer_tui.tui.terminal import TerminalChoice
from simmer_tui.tui.textual_internals import rows_of

# They have an order or a key of their own here.
_REPLACED = ("Screenshot", "Keys", "Maximize", "Minimize", "Quit")


class SimmerApp(Shell):
    """The screen of a live run: keys that drive, and a console."""

    TITLE = "SimMeR"
    COMMANDS = {CommandProvider}  # noqa: RUF012
    ENABLE_COMMAND_PALETTE = True
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("colon", "colon", priority=True),
        Binding("enter", "focus_console"),
    ]

    def __init__(self, server: Server, choice: TerminalChoice, history_file: Path | None = None) -> None:
        super().__init__(LiveSource(server), choice, MazePane(choice.glyphs, choice.color, id="maze"))
        self.server = server
        self._console = ConsolePane(self._spec, History(history_file), self.follow)
        self._console_head = LinePanel(id="console-head")
        self._prompt = LinePanel(id="prompt")
        self._operator = Operator(server)
        self._panes.pointer = " ".join(REASONS)
        self._panes.first_steps = self._first_steps

    # -- putting together ------------------------------------------------------------------------

    def controls(self) -> Iterable[Widget]:
        return self._console_head, self._console, self._prompt

    def on_mount(self) -> None:
        self.set_keymap(keymap(self._settings.keys))
        self._console.focus_line()
        self.paste_target = self._console.line
        for warning in self.server.warnings:
            self.notify(warning, severity="warning", timeout=10, markup=False)

    def shown(self, snapshot: Snapshot, since: int) -> None:
        complaint = complaint_of(snapshot.entries, since)
        new = [entry for entry in snapshot.entries if entry.number > since]
        if has_failed(new):
            self.notify(POINTER, timeout=15, markup=False)
        if complaint is not None:
            self._console.show_complaint(complaint)
        elif any(not entry.folds for entry in new):
            self._console.note_event()

    def numbers_shown(self, snapshot: Snapshot) -> None:
        brief = "events" not in self._plan.boxes
        entries = self._panes.log.entries if brief else ()
        status = status_line(snapshot, entries, brief=brief)
        if brief and not entries:
            run = self._first_steps().lines[0]
            # Half a program is none.
            status = run if length(run) <= self.size.width - 2 else link_lines(snapshot, self.server.ports)[1]
        self._console.show_status(status)

    def _arrange(self, width: int, height: int) -> None:
        super()._arrange(width, height)
        box = self._plan.boxes.get("console-head")
        if box is not None:
            note = "Tab goes to the maze" if self._console.has_focus_within else ": or Enter comes here"
            self._console_head.show(
                [((" ", "plain"), *heading("console", note, box.width - 1, plain=self._plain))]
            )
        console = self._plan.boxes.get("console")
        self._prompt.display = console is not None
        if console is not None:
            put(self._prompt, Box(console.x + 1, console.y + 1, 1, 1))
            self._prompt.show([((">", "title"),)])

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Leave the colon a letter where text is typed."""
        if action == "colon":
            return len(self.screen_stack) == 1 and not self._console.has_focus_within
        return super().check_action(action, parameters)

    def _first_steps(self) -> FirstSteps:
        drives = [drive for drive in self._spec.drives if drive.enabled]
        drives.sort(key=lambda drive: drive.kind is not DriveKind.RIGHT)  # forward, if it can
        command = f"{drives[0].code}-3" if drives else "u1"
        return first_steps(self.server.ports, self._settings.server, command, drive_keys(self._settings.keys))

    def page_turned(self) -> None:
        if not self._console.has_focus_within:
            self.action_focus_pane()

    def hints(self) -> Sequence[Hint]:
        if self._console.has_focus_within:
            return hints_of(IN_CONSOLE)
        return maze_hints(self._settings.keys) if self._maze.has_focus else super().hints()

    # -- what people do --------------------------------------------------------------------------

    def action_order(self, line: str) -> None:
        """Give an order as if it were typed in the console."""
        self._console.give(line)

    def action_colon(self) -> None:
        """Begin an order; what is typed next belongs to it already."""
        self._console.focus_line(":")

    def action_begin_order(self, line: str) -> None:
        """Put the beginning of an order into the console."""
        self._console.focus_line(line)

    def follow(self, order: ConsoleCommand) -> None:
        """Carry an order or a command out."""
        if isinstance(order, Command):
            self._operator.send(order, partial(self._console.refuse, self._console.given, order.text))
        elif isinstance(order, Action):
            self._warn(self._operator.perform(order))
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
            "report": lambda _: self.run_worker(self._show_report(), group="report", exclusive=True),
            "bias": lambda _: self._show_bias(),
            "log": lambda file: self.run_worker(self._start_log(file), group="log"),
            "robot": self.server.use_robot,
            "simulator": lambda _: self.server.use_simulator(),
            "copy": lambda _: self.action_copy_log(),
            "shot": self._write_picture,
            "save": lambda file: self._write(file, self._panes.whole_log, "log"),
        }
        orders[order.name](order.argument)

    def _show_why(self, about: str) -> None:
        """Show the verdict, or while the run goes on, and about a `move`, why the last movement ended."""
        snapshot = self._snapshot
        if snapshot is None:
            return
        text = why(snapshot.state, self._spec)
        if snapshot.verdict is not None and not about:
            text = "\n".join(snapshot.verdict.lines)
        self.notify(text, title="Why", timeout=20, markup=False)

    async def _show_report(self) -> None:
        """Show the report of this run, made from its saved log."""
        saved = self.server.saved_run
        if saved is None:
            self._console.show_error(
                "report: this run is not saved; :log FILE logs it, simmer-tui report reads it"
            )
            return
        self.notify("reading the run", timeout=2)
        try:
            text = await report_of(saved, self.size.width - 6, self._plain)
        except OSError as error:
            self._console.show_error(f"report: {error.strerror or error}")
        else:
            note = f"escape closes; saved in {printable(saved.path.name)}"
            self.push_screen(ReportScreen(text, "Report of this run", note))

    def _complain(self, text: str) -> None:
        if text:
            self._console.show_error(text)

    def _warn(self, text: str) -> None:
        if text:
            self.notify(text, severity="warning", markup=False)

    def _write_picture(self, name: str) -> None:
        dark = self._settings.screen.theme != "light"
        self._write(name, picture(rows_of(self.screen), dark=dark), "picture")

    def _write(self, name: str, text: str, what: str) -> None:
        file = Path(name).expanduser()
        try:
            file.write_text(text, encoding="utf-8")
        except (OSError, ValueError) as error:  # ValueError: a name with a zero byte
            reason = getattr(error, "strerror", None) or str(error)
            self._console.show_error(f"{escape(name)}: {escape(reason)}")
        else:
            self.notify(f"{what} written to {file}", markup=False)

    async def _start_log(self, name: str) -> None:
        """Log the run from here on, or show why that fails."""
        try:
            file = await self.server.begin_log(name)
        except RunLogError as error:
            self._console.show_error(str(error))
        else:
            self.notify(f"logging to {file}", markup=False)

    def _show_bias(self) -> None:
        text = "       x        y        r"
        for kind, bias in self.server.simulator.bias.items():
            text += f"\n{kind.value:6}{bias.x:+9.4f}{bias.y:+9.4f}{bias.r:+9.4f}"
        self.notify(text, title="Drive bias", timeout=15, markup=False)

    def action_drive(self, name: str, fine: bool) -> None:
        """Drive or turn by a key's step."""
        self._console.forget_errors()
        self._complain(self._operator.drive(name, fine))
        self.refresh_frame()

    def action_press(self, name: str) -> None:
        """Do what the key of that name says: `stop`, `poll`, `reset`, `pause`, `step`."""
        self._console.forget_errors()
        paused = self._snapshot is not None and self._snapshot.state.paused
        self._complain(self._operator.press(name, paused))
        self.refresh_frame()

    def action_pace(self, factor: float) -> None:
        """Show movements faster or slower by a factor, from as fast as possible at the usual pace
        again; the factor 0 is as fast as possible."""
        pace, usual = self.server.pace, self._settings.screen.pace or ScreenSettings().pace
        self._set_pace(pace * factor if pace or not factor else usual)

    def _set_pace(self, pace: float) -> None:
        if self.server.engine.timed:
            self._warn("no effect: timed motion takes its time; :speed changes it")
            return
        pace = checked_pace(pace)
        self.server.set_pace(pace)
        how = f"{pace:g} times real speed" if pace else "as fast as possible"
        self.notify(f"movements are shown {how}", timeout=2)

    def action_help(self, code: str = "") -> None:
        """Show all of the help, or the description of one code."""
        self.push_screen(help_screen(self._settings.keys, self._spec, code))

    def tell(self, text: str) -> None:
        """Show a note above the console's line."""
        self._console.show_note(text)

    def action_focus_console(self) -> None:
        self._console.focus_line()

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        """Textual's own commands, without those that have an order here."""
        theirs = super().get_system_commands(screen)
        return [each for each in theirs if each.title not in _REPLACED]


class ReportScreen(HelpScreen):
    """Shows the report of this run."""

    FRAME = "report"
