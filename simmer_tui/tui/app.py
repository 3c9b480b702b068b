"""The terminal app: maze, panels, log and console around a station that runs in its own thread."""

from __future__ import annotations

import contextlib
import signal
import sys
from pathlib import Path
from typing import ClassVar

from rich.markup import escape as escape_markup
from textual.app import App, ComposeResult, SystemCommand
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.events import Resize
from textual.screen import Screen
from textual.widgets import Footer

from simmer_tui.actions import Action, ActionName
from simmer_tui.sim.command import Command, parse_command
from simmer_tui.sim.records import Outcome
from simmer_tui.sim.specs import Axes, DriveKind
from simmer_tui.snapshot import Snapshot
from simmer_tui.station import Station
from simmer_tui.tui.console import Console
from simmer_tui.tui.help import HelpScreen, help_text
from simmer_tui.tui.history import History
from simmer_tui.tui.lines import LinePanel
from simmer_tui.tui.log_panel import LogPanel
from simmer_tui.tui.maze_pane import DRIVES, MazePane, keymap
from simmer_tui.tui.orders import Local, Order, OrderError, read_order
from simmer_tui.tui.palette_orders import OrderProvider
from simmer_tui.tui.readouts import link_lines, robot_lines, sensor_lines, status_line
from simmer_tui.tui.scenes import scene_of
from simmer_tui.tui.sizes import PAGES, SMALLEST_COLUMNS, SMALLEST_ROWS, arrangement
from simmer_tui.tui.terminal import ColorDepth, GlyphMode, TerminalChoice

_BACKED_UP = 2
"""Writes the terminal has not taken yet at which a frame is skipped."""


class SimmerApp(App[int]):
    """Samples the newest snapshot some times a second and draws what has changed."""

    TITLE = "SimMeR"
    CSS_PATH = "app.tcss"
    COMMANDS = App.COMMANDS | {OrderProvider}
    ENABLE_COMMAND_PALETTE = True
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("colon,enter", "focus_console", "Console", key_display=":", show=True),
        Binding("f2", "next_page", "Page", show=False),
        *(Binding(str(n), f"page({n})", f"Page {name}", show=False) for n, name in enumerate(PAGES, 1)),
        Binding("ctrl+q", "quit", "Quit", show=False, priority=True),
    ]

    def __init__(self, station: Station, choice: TerminalChoice, history_file: Path | None = None) -> None:
        super().__init__(ansi_color=choice.ansi_color)
        settings = station.configuration.settings
        self.station = station
        self._spec = station.configuration.simulation
        self._settings = settings
        self._choice = choice
        self._plain = choice.glyphs is GlyphMode.ASCII
        self._history = History(history_file)
        self._console_session = station.engine.session(answer_at_end=False)
        self._known = 0
        self._sampling = False
        self._idle = False
        self._snapshot: Snapshot | None = None
        self._page = 0
        self._truth = False
        self._show_trail = True
        self._show_rays = settings.plot_sense
        self.frames = 0
        """Pictures drawn so far."""
        self.skipped = 0
        """Pictures skipped because the terminal had not taken the last ones."""

    # -- putting together ------------------------------------------------------------------------

    def compose(self) -> ComposeResult:
        with Horizontal(id="main"):
            with Vertical(id="left"):
                yield MazePane(self._choice.glyphs, self._choice.color, id="maze")
                yield LogPanel(id="log")
            with VerticalScroll(id="side", can_focus=False):
                yield LinePanel(id="robot")
                yield LinePanel(id="sensors")
                yield LinePanel(id="link")
        yield LinePanel(id="small")
        yield Console(self._spec, self._history)
        yield Footer(compact=True, show_command_palette=False)

    def on_mount(self) -> None:
        light = self._settings.screen.theme == "light"
        self.theme = "textual-light" if light else "textual-dark"
        if self._choice.color is ColorDepth.NONE:
            self.theme = "ansi-light" if light else "ansi-dark"
        self.set_class(self._plain, "plain")
        self.set_keymap(keymap(self._settings.keys))
        for name in ("robot", "sensors", "link", "log"):
            self.query_one(f"#{name}").border_title = name.capitalize()
        self._console.focus_line()
        self._end_on_signals()
        self.set_interval(1 / self._settings.screen.fps, self._sample)
        self.call_after_refresh(self._sample)

    def _end_on_signals(self) -> None:
        """A lost connection or a kill ends the app as ctrl+q does, on a restored terminal."""
        if sys.platform == "win32":
            return
        import asyncio

        loop = asyncio.get_running_loop()
        for number in (signal.SIGHUP, signal.SIGTERM):
            if signal.getsignal(number) is not signal.SIG_IGN:
                with contextlib.suppress(RuntimeError, ValueError):  # not in the main thread
                    loop.add_signal_handler(number, self.exit, 0)

    @property
    def _maze(self) -> MazePane:
        return self.query_one(MazePane)

    @property
    def _console(self) -> Console:
        return self.query_one(Console)

    @property
    def _log_panel(self) -> LogPanel:
        return self.query_one(LogPanel)

    def _panel(self, name: str) -> LinePanel:
        return self.query_one(f"#{name}", LinePanel)

    # -- frames ----------------------------------------------------------------------------------

    async def _sample(self) -> None:
        """Take the newest snapshot and show it, unless nothing is new or the terminal is behind."""
        if self._sampling or self._nothing_new():
            return
        if self._terminal_is_behind():
            self.skipped += 1
            return
        self._sampling = True
        try:
            snapshot = await self.station.snapshot(self._known, self._truth)
            if self.is_running:
                self._show(snapshot)
        finally:
            self._sampling = False

    def _nothing_new(self) -> bool:
        simulator = self.station.simulator
        same = self.station.recorder.number == self._known and not simulator.moving
        return same and self._idle

    def _terminal_is_behind(self) -> bool:
        """Whether the terminal has stopped reading (ctrl+S, a dead connection): a write would then
        hold up the whole app. The queue is the driver's own; a driver without one never blocks."""
        writer = getattr(self._driver, "_writer_thread", None)
        waiting = getattr(writer, "_queue", None)
        return waiting is not None and waiting.qsize() >= _BACKED_UP

    def _show(self, snapshot: Snapshot) -> None:
        before, self._snapshot = self._snapshot, snapshot
        if snapshot.entries:
            self._known = snapshot.entries[-1].number
        self._idle = before is not None and snapshot.rate == 0 and before.pose == snapshot.pose
        self.frames += 1
        if len(self.screen_stack) > 1:  # the help or the palette is in front
            self._log_panel.add(snapshot.entries)
            return
        self._maze.show(
            scene_of(
                self._spec,
                self.station.simulator.maze,
                snapshot,
                show_robot=self._settings.plot_robot,
                show_rays=self._show_rays,
                show_trail=self._show_trail,
            )
        )
        sensors = self._panel("sensors")
        self._panel("robot").show(robot_lines(snapshot))
        sensors.show(
            sensor_lines(
                self._spec.sensors, snapshot, sensors.content_size.width, truth=self._truth, plain=self._plain
            )
        )
        self._panel("link").show(link_lines(snapshot, self.station.ports))
        self._log_panel.add(snapshot.entries)
        self._console.show_status(status_line(snapshot, self.size.width))
        self._report_console(snapshot)

    def _report_console(self, snapshot: Snapshot) -> None:
        """Say in the console what was wrong with the last typed command."""
        for entry in reversed(snapshot.entries):
            event = entry.event
            if isinstance(event, Outcome) and event.command.source in ("console", "keys"):
                self._console.show_error(f"{event.command.shown}: {event.reason}" if event.reason else "")
                return

    def refresh_frame(self) -> None:
        """Draw again soon, whether or not anything happened."""
        self._idle = False
        self.call_later(self._sample)

    # -- sizes -----------------------------------------------------------------------------------

    def on_resize(self, event: Resize) -> None:
        self._arrange(event.size.width, event.size.height)

    def _arrange(self, width: int, height: int) -> None:
        plan = arrangement(self._spec.maze, width, height)
        self.set_class(not plan.side_by_side, "narrow")
        self.set_class(plan.too_small, "too-small")
        least = f"at least {SMALLEST_COLUMNS} x {SMALLEST_ROWS} please"
        self._panel("small").show([(("The terminal is too small:", "warning"),), ((least, "plain"),)])
        for number, page in enumerate(PAGES):
            self.set_class(number == self._page, f"page-{page}")
        self._maze.styles.height = plan.maze_rows if plan.side_by_side else "1fr"
        self.refresh_frame()

    def action_page(self, number: int) -> None:
        """On small screens: show one of maze, sensors and log."""
        self._page = (number - 1) % len(PAGES)
        self._arrange(self.size.width, self.size.height)
        if not self.query_one("#line").has_focus:
            page = {"maze": self._maze, "log": self._log_panel}.get(PAGES[self._page])
            self.screen.set_focus(page)

    def action_next_page(self) -> None:
        self.action_page(self._page + 2)

    # -- what people do --------------------------------------------------------------------------

    def on_console_ordered(self, message: Console.Ordered) -> None:
        self.follow(message.order)

    def action_order(self, line: str) -> None:
        """An order as typed in the console."""
        try:
            self.follow(read_order(line))
        except OrderError as error:
            self._console.show_error(str(error))

    def action_begin_order(self, line: str) -> None:
        """Put the beginning of an order into the console."""
        self._console.focus_line(line)

    def follow(self, order: Order) -> None:
        """Do what was asked for."""
        if isinstance(order, Command):
            self._send(order)
        elif isinstance(order, Action):
            self.station.call(self._perform, order)
        else:
            self._follow_local(order)
        self.refresh_frame()

    def _send(self, command: Command) -> None:
        self.station.call(self._console_session.submit, command, lambda outcome: None)

    def _perform(self, action: Action) -> None:
        """In the robot's thread."""
        done = self.station.engine.perform(action)
        if done.refused:
            self.call_from_thread(self._console.show_error, f"{action.name.value}: {done.text}")

    def _follow_local(self, order: Local) -> None:
        if order.name == "quit":
            self.exit(0)
        elif order.name == "help":
            self.action_help()
        elif order.name == "step":
            self.action_step()
        elif order.name == "bias":
            self._show_bias()
        elif order.name == "copy":
            self.action_copy_log()
        elif order.name == "shot":
            self._write(order.argument, self.export_screenshot(title="SimMeR"), "picture")
        elif order.name == "save":
            self._write(order.argument, self._log_panel.text, "log")

    def _write(self, name: str, text: str, what: str) -> None:
        file = Path(name).expanduser()
        try:
            file.write_text(text, encoding="utf-8")
        except OSError as error:
            self._console.show_error(f"{name}: {error.strerror or error}")
        else:
            self.notify(escape_markup(f"{what} written to {file}"))

    def _show_bias(self) -> None:
        rows = self.station.simulator.bias
        text = "\n".join(f"{kind.value:6}{_axes(bias)}" for kind, bias in rows.items())
        self.notify(escape_markup(f"       x        y        r\n{text}"), title="Drive bias", timeout=15)

    def action_drive(self, name: str, fine: bool) -> None:
        """Drive or turn by a key's step."""
        kind, sign = DRIVES[name]
        screen = self._settings.screen
        if kind is DriveKind.ROT:
            value = screen.fine_turn if fine else screen.turn
        else:
            value = screen.fine_step if fine else screen.step
        for drive in self._spec.drives:
            if drive.kind is kind and drive.enabled:
                self.follow(parse_command(f"{drive.code}-{sign * value:g}", "keys"))
                return
        self._console.show_error(f"this robot has no drive {kind.value}")

    def action_stop(self) -> None:
        self.follow(Action(ActionName.STOP, source="keys"))

    def action_poll(self) -> None:
        """Read every sensor once."""
        for sensor in self._spec.sensors:
            if sensor.enabled:
                self._send(parse_command(sensor.code, "keys"))
        self.refresh_frame()

    def action_reset(self) -> None:
        self.follow(Action(ActionName.RESET, source="keys"))

    def action_pause(self) -> None:
        paused = self._snapshot is not None and self._snapshot.paused
        self.follow(Action(ActionName.RESUME if paused else ActionName.PAUSE, source="keys"))

    def action_step(self) -> None:
        """While paused, let one command through."""
        self.station.call(self.station.engine.step)
        self.refresh_frame()

    def action_toggle_trail(self) -> None:
        self._show_trail = not self._show_trail
        self.refresh_frame()

    def action_toggle_rays(self) -> None:
        self._show_rays = not self._show_rays
        self.refresh_frame()

    def action_toggle_truth(self) -> None:
        self._truth = not self._truth
        self.refresh_frame()

    def action_zoom(self, step: int) -> None:
        if step > 0:
            self._maze.zoom_in()
        else:
            self._maze.zoom_out()

    def action_follow(self) -> None:
        self._maze.toggle_follow()
        self.notify(f"follow the robot: {'on' if self._maze.follow else 'off'}", timeout=2)

    def action_help(self) -> None:
        self.push_screen(
            HelpScreen(help_text(self._settings.keys, self._spec)), lambda _: self.refresh_frame()
        )

    def action_copy_log(self) -> None:
        """Copy what the log panel shows, by OSC 52: it works over SSH."""
        self.copy_to_clipboard(self._log_panel.text)
        self.notify("log copied", timeout=2)

    def action_focus_maze(self) -> None:
        self._maze.focus()

    def action_focus_console(self) -> None:
        self._console.focus_line()

    def get_system_commands(self, screen: Screen[object]) -> list[SystemCommand]:
        """Textual's own commands, without those that have an order here."""
        theirs = super().get_system_commands(screen)
        return [each for each in theirs if each.title not in ("Screenshot", "Keys", "Maximize", "Minimize")]


def _axes(bias: Axes) -> str:
    return "".join(f"{number:+9.4f}" for number in (bias.x, bias.y, bias.r))
