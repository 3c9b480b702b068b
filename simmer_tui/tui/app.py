"""The terminal app: maze, panels, log and console around a server that runs in its own thread."""

from __future__ import annotations

import time
import traceback
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import ClassVar

from textual.app import App, ComposeResult, SystemCommand
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.events import Resize
from textual.filter import ANSIToTruecolor, LineFilter
from textual.screen import Screen
from textual.widgets import Footer

from simmer_tui.config.settings import ScreenSettings
from simmer_tui.errors import RunLogError
from simmer_tui.events import Action
from simmer_tui.pace import checked_pace
from simmer_tui.server import Server
from simmer_tui.sim.command import Command, escape
from simmer_tui.sim.specs import Axes
from simmer_tui.snapshot import Snapshot
from simmer_tui.tui.ascii_filter import AsciiFilter
from simmer_tui.tui.backpressure import Backpressure
from simmer_tui.tui.console import Console
from simmer_tui.tui.console_commands import ConsoleCommand, Local
from simmer_tui.tui.help import help_screen
from simmer_tui.tui.history import History
from simmer_tui.tui.line_panel import LinePanel
from simmer_tui.tui.maze_pane import keymap
from simmer_tui.tui.operator import Operator
from simmer_tui.tui.palette_commands import CommandProvider
from simmer_tui.tui.panes import Panes
from simmer_tui.tui.picture import picture
from simmer_tui.tui.readouts import (
    BESIDE_PANELS,
    complaint_of,
    status_line,
)
from simmer_tui.tui.sizes import PAGES, SMALLEST_COLUMNS, SMALLEST_ROWS, arrangement
from simmer_tui.tui.terminal import ColorDepth, GlyphMode, TerminalChoice
from simmer_tui.tui.terminal_app import TerminalApp

_REPLACED = ("Screenshot", "Keys", "Maximize", "Minimize", "Quit")
_CLOCK_TICK = 1.0
"""How often the clock of timed motion is shown while nothing else is new, seconds."""


class SimmerApp(TerminalApp):
    """Samples the newest snapshot some times a second and draws what has changed."""

    TITLE = "SimMeR"
    CSS_PATH = "app.tcss"
    COMMANDS = App.COMMANDS | {CommandProvider}
    ENABLE_COMMAND_PALETTE = True
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("colon", "colon", "Console", key_display=":", priority=True),
        Binding("enter", "focus_console", "Console", show=False),
        Binding("f2", "next_page", "Page", key_display="f2"),
        *(Binding(str(n), f"page({n})", f"Page {name}", show=False) for n, name in enumerate(PAGES, 1)),
        Binding("ctrl+q", "quit", "Quit", priority=True),
    ]

    def __init__(self, server: Server, choice: TerminalChoice, history_file: Path | None = None) -> None:
        super().__init__(ansi_color=choice.ansi_color)
        settings = server.configuration.settings
        self.server = server
        self._spec = server.configuration.simulation
        self._settings = settings
        self._choice = choice
        self._plain = choice.glyphs is GlyphMode.ASCII
        self._panes = Panes(server.configuration, choice, server.ports)
        self._maze = self._panes.maze
        self._small = LinePanel(id="small")
        self._console = Console(self._spec, History(history_file), self.follow)
        self._operator = Operator(server)
        self._gate = Backpressure(self)
        self._known = 0
        self._sampling = False
        self._sampled = 0.0
        self._idle = False
        self._snapshot: Snapshot | None = None
        self._page = 0
        self._side_by_side = True
        self._ending: int | None = None
        self.frames = 0
        """Pictures drawn so far."""
        self.skipped = 0
        """Pictures skipped because the terminal had not taken the last ones."""
        self.fault = ""
        """What ended the app, if it was a fault of its own."""

    def end(self, code: int) -> None:
        """End soon, with an exit code. Any thread may ask; nobody waits."""
        self._ending = code

    # -- putting together ------------------------------------------------------------------------

    def compose(self) -> ComposeResult:
        with Horizontal(id="main"):
            with Vertical(id="left"):
                yield self._maze
                yield self._panes.log
            with self._panes.side:
                yield from self._panes.panels.values()
        yield self._small
        yield self._console
        yield Footer(compact=True, show_command_palette=False)

    def on_mount(self) -> None:
        light = self._settings.screen.theme == "light"
        self.theme = "textual-light" if light else "textual-dark"
        if self._choice.color is ColorDepth.NONE:
            self.theme = "ansi-light" if light else "ansi-dark"
        self.set_class(self._plain, "plain")
        self.set_keymap(keymap(self._settings.keys))
        self._console.focus_line()
        self.paste_target = self._console.line
        for warning in self.server.warnings:
            self.notify(warning, severity="warning", timeout=10, markup=False)
        self.set_interval(1 / self._settings.screen.fps, self._sample)
        self.call_after_refresh(self._sample)

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Textual's filters but one, which would look through all rows of every picture for the 16
        colours by name that nothing here uses, and one for terminals that show nothing but ASCII."""
        filters = [each for each in super().get_line_filters() if not isinstance(each, ANSIToTruecolor)]
        return [*filters, AsciiFilter()] if self._plain else filters

    # -- frames ----------------------------------------------------------------------------------

    async def _sample(self) -> None:
        """Take the newest snapshot and show it, unless nothing is new or the terminal is behind."""
        if self._ending is not None:
            self.exit(self._ending)
            return
        if not self._gate.keep_up():
            self.skipped += 1
            return
        if self._sampling or self._nothing_new():
            return
        self._sampling = True
        self._sampled = time.monotonic()
        try:
            snapshot = await self.server.snapshot(self._known, self._panes.shown["truth"])
            if self.is_running:
                self._show(snapshot)
        finally:
            self._sampling = False

    def _nothing_new(self) -> bool:
        if self.server.engine.timed and time.monotonic() - self._sampled >= _CLOCK_TICK:
            return False  # simulated time goes on
        same = self.server.recorder.number == self._known and not self.server.moving
        return same and self._idle and not self._panes.has_unlogged

    def post_display_hook(self) -> None:
        self._gate.note_display()

    def _show(self, snapshot: Snapshot) -> None:
        before, self._snapshot = self._snapshot, snapshot
        if snapshot.entries:
            self._known = snapshot.entries[-1].number
        # A command that comes in during a pause is no event, nor is the end of a calm second.
        self._idle = (
            before is not None
            and snapshot.rate == 0
            and before.state.pose == snapshot.state.pose
            and not snapshot.state.paused
        )
        self.frames += 1
        self._panes.show(snapshot)
        complaint = complaint_of(snapshot.entries)
        if complaint is not None:
            self._console.show_complaint(complaint)
        self._console.show_status(
            BESIDE_PANELS if self._side_by_side else status_line(snapshot, self.size.width)
        )

    def _handle_exception(self, error: Exception) -> None:
        """An exception that Textual cannot go on from. What serves the robot outlives the app: it is
        told in a line, without Textual's traceback."""
        super()._handle_exception(error)
        self._exit_renderables.clear()
        where = traceback.extract_tb(error.__traceback__)[-1:]
        place = "".join(f" ({Path(frame.filename).name}:{frame.lineno})" for frame in where)
        self.fault = f"{type(error).__name__}: {escape(str(error), 200)}{place}"

    def refresh_frame(self) -> None:
        """Draw again soon, whether or not anything happened."""
        self._idle = False
        self.call_later(self._sample)

    # -- sizes -----------------------------------------------------------------------------------

    def on_resize(self, event: Resize) -> None:
        self._arrange(event.size.width, event.size.height)

    def _arrange(self, width: int, height: int) -> None:
        plan = arrangement(self._spec.maze, width, height)
        self._side_by_side = plan.side_by_side
        self.set_class(not plan.side_by_side, "narrow")
        self.set_class(plan.too_small, "too-small")
        least = f"at least {SMALLEST_COLUMNS} x {SMALLEST_ROWS} please"
        self._small.show([(("The terminal is too small:", "warning"),), ((least, "plain"),)])
        for number, page in enumerate(PAGES):
            self.set_class(number == self._page, f"page-{page}")
        self._maze.styles.height = plan.maze_rows if plan.side_by_side else "1fr"
        self.refresh_bindings()
        self.refresh_frame()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Pages are for small screens, the colon is a letter where text is typed."""
        if action == "colon":
            return len(self.screen_stack) == 1 and not self._console.has_focus_within
        return not (self._side_by_side and action in ("page", "next_page"))

    def action_page(self, number: int) -> None:
        """On small screens: show one of maze, sensors, robot and log."""
        self._page = (number - 1) % len(PAGES)
        self._arrange(self.size.width, self.size.height)
        if not self._console.has_focus_within:
            self.call_after_refresh(self.action_focus_pane)

    def action_next_page(self) -> None:
        self.action_page(self._page + 2)

    def action_focus_pane(self) -> None:
        """From the console to the maze, or to the page shown on a small screen."""
        page = "maze" if self._side_by_side else PAGES[self._page]
        pane = {"maze": self._maze, "log": self._panes.log}.get(page, self._panes.side)
        self.screen.set_focus(pane)

    # -- what people do --------------------------------------------------------------------------

    def action_order(self, line: str) -> None:
        """An order as typed in the console."""
        self._console.give(line)

    def action_colon(self) -> None:
        """Begin an order; what is typed next belongs to it already."""
        self._console.focus_line(":")

    def action_begin_order(self, line: str) -> None:
        """Put the beginning of an order into the console."""
        self._console.focus_line(line)

    def follow(self, order: ConsoleCommand) -> None:
        """Do what was asked for."""
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
        elif order.name == "quit":
            self.exit(0)
        elif order.name == "help":
            self.action_help(order.argument)
        elif order.name == "step":
            self.action_press("step")
        elif order.name == "pace":
            self._set_pace(float(order.argument))
        elif order.name == "bias":
            self._show_bias()
        elif order.name == "log":
            self.run_worker(self._start_log(order.argument), group="log")
        elif order.name == "robot":
            self.server.use_robot(order.argument)
        elif order.name == "simulator":
            self.server.use_simulator()
        elif order.name == "copy":
            self.action_copy_log()
        elif order.name == "shot":
            strips = self.screen._compositor.render_strips()
            dark = self._settings.screen.theme == "dark"
            self._write(order.argument, picture(strips, dark=dark), "picture")
        elif order.name == "save":
            self._write(order.argument, self._panes.whole_log, "log")

    def action_switch(self, name: str, word: str = "") -> None:
        """Show something or not; without a word, change over."""
        self._panes.switch(name, word)
        self.refresh_frame()

    def _complain(self, text: str) -> None:
        if text:
            self._console.show_error(text)

    def _warn(self, text: str) -> None:
        if text:
            self.notify(text, severity="warning", markup=False)

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
        """Log the run from here on, or say why not."""
        try:
            file = await self.server.begin_log(name)
        except RunLogError as error:
            self._console.show_error(str(error))
        else:
            self.notify(f"logging to {file}", markup=False)

    def _show_bias(self) -> None:
        rows = self.server.simulator.bias
        text = "\n".join(f"{kind.value:6}{_axes(bias)}" for kind, bias in rows.items())
        self.notify(f"       x        y        r\n{text}", title="Drive bias", timeout=15, markup=False)

    def action_drive(self, name: str, fine: bool) -> None:
        """Drive or turn by a key's step."""
        self._complain(self._operator.drive(name, fine))
        self.refresh_frame()

    def action_press(self, name: str) -> None:
        """What the key of that name does to the robot: `stop`, `poll`, `reset`, `pause`, `step`."""
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

    def action_zoom(self, step: int) -> None:
        if step > 0:
            self._maze.zoom_in()
        else:
            self._maze.zoom_out()

    def action_follow(self) -> None:
        self._maze.toggle_follow()
        self.notify(f"follow the robot: {'on' if self._maze.follow else 'off'}", timeout=2)

    def action_help(self, code: str = "") -> None:
        """All of the help, or what there is to say of one code."""
        self.push_screen(help_screen(self._settings.keys, self._spec, code))

    def action_copy_log(self) -> None:
        """Copy what the log panel shows, by OSC 52: it works over SSH."""
        self.copy_to_clipboard(self._panes.whole_log)

    def tell(self, text: str) -> None:
        """Say something in passing, above the console's line."""
        self._console.show_note(text)

    def action_focus_console(self) -> None:
        self._console.focus_line()

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        """Textual's own commands, without those that have an order here."""
        theirs = super().get_system_commands(screen)
        return [each for each in theirs if each.title not in _REPLACED]


def _axes(bias: Axes) -> str:
    return "".join(f"{number:+9.4f}" for number in (bias.x, bias.y, bias.r))
