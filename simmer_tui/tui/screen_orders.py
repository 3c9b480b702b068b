"""The orders that the screen itself carries out: the method `order_NAME` for the order `:NAME`.

Each gets the words behind the name. Switches have no method: `Panes.switch` does them all.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from textwrap import fill

from textual.worker import get_current_worker

from simmer_tui import platform_has
from simmer_tui.config.settings import ScreenSettings
from simmer_tui.errors import RunLogError, reason_of
from simmer_tui.live.operating.orders import ConsoleCommand
from simmer_tui.live.operating.robot_operator import Operator
from simmer_tui.live.server import Server
from simmer_tui.report.why import why
from simmer_tui.robot.playback_throttle import checked_pace
from simmer_tui.run.events import Action
from simmer_tui.runlog.saved_runs import SavedRun
from simmer_tui.sim.command import WORD, Command, cut, typed_path
from simmer_tui.tui import answers
from simmer_tui.tui.console import ConsolePane, History
from simmer_tui.tui.help import PAGE_FRAME, ReportScreen, help_screen
from simmer_tui.tui.live import LiveSource, report_text, why_text
from simmer_tui.tui.maze.view import MazeView
from simmer_tui.tui.picture import screen_picture
from simmer_tui.tui.shell import Shell
from simmer_tui.tui.terminal import TerminalChoice
from simmer_tui.tui.textual_internals import rows_of
from simmer_tui.whole_file import NOT_OVERWRITTEN, write_whole


class OrderingShell(Shell):
    """The screen of a live run, as far as orders need it."""

    def __init__(
        self, server: Server, choice: TerminalChoice, maze: MazeView, history_file: Path | None
    ) -> None:
        super().__init__(LiveSource(server), choice, maze)
        self.server = server
        self._operator = Operator(server)
        self._console = ConsolePane(self._spec, History(history_file), self.follow)
        self.page_links: tuple[str, ...] = ()
        """Lines with the links to the page that shows the run in browsers."""
        self._written: set[Path] = set()
        """The files that orders have written: only those may be written again."""

    def follow(self, order: ConsoleCommand) -> None:
        """Carry out an order or a command."""
        if isinstance(order, Command):
            self._operator.send(order, partial(self._console.refuse, self._console.given, order.text))
        elif isinstance(order, Action):
            self._console.show_error(self._operator.perform(order))
        elif order.name in self._panes.shown:
            self.action_switch(order.name, order.argument)
        else:
            method: Callable[[str], None] = getattr(self, f"order_{order.name}")
            method(order.argument)
        self.refresh_frame()

    def tell(self, text: str) -> None:
        """Show a note above the console's line."""
        self._console.show_note(text)

    # -- help, answers and pages -------------------------------------------------------------------

    def order_help(self, code: str) -> None:
        """Show all of the help, or the description of one code."""
        self.action_help(code)

    def action_help(self, code: str = "") -> None:
        """Show all of the help, or the description of one code."""
        self.push_screen(help_screen(self._settings.keys, self._spec, self._maze.painter, code))

    def order_why(self, about: str) -> None:
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

    def order_report(self, _: str) -> None:
        """Show the report of this run, in place of one that is being made."""
        self.begin(self._show_report, "report", once=True)

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
            await self.server.flush_saved_run()
            text = await report_text(saved, self.size.width - PAGE_FRAME, self._plain)
        except OSError as error:
            text = f"The report cannot be made: {reason_of(error)}"
        screen.replace(text)

    def order_try(self, _: str) -> None:
        """Run a failed program again."""
        self.action_try_changes()

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
            await self.server.flush_saved_run()
            text = await why_text(saved, room, self._plain, screen.replace)
        except OSError as error:
            text = f"The runs cannot be started: {reason_of(error)}"
        screen.replace(text)

    def order_program(self, _: str) -> None:
        """Show the last lines that the program has printed."""
        snapshot = self._snapshot
        verdict = None if snapshot is None else snapshot.verdict
        if verdict is None or verdict.program is None:
            self._console.show_error("program: none has ended yet; the events have its output (/ program)")
            return
        text = answers.program_output(verdict.program)
        self.push_screen(ReportScreen(text, "Program", f"Esc closes; exit code {verdict.program.exit_code}"))

    def order_pins(self, name: str) -> None:
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

    def order_web(self, _: str) -> None:
        """Show the links to the page, until the answer is closed."""
        if not self.page_links:
            self._console.show_error("web: no page is served; start with --web")
            return
        text = "\n\n".join(self.page_links)
        self.push_screen(ReportScreen(text, "Page", "Esc closes; anyone who has a link may use it"))

    def order_bias(self, _: str) -> None:
        """Show the drives' bias."""
        self.ask(answers.bias_answer(self.server.simulator.bias), stays=True)

    # -- the robot ---------------------------------------------------------------------------------

    def order_step(self, _: str) -> None:
        """While paused, let one command through."""
        self.action_press("step")

    def action_press(self, name: str) -> None:
        """Do the action of a key: `stop`, `poll`, `reset`, `pause`, `step`."""
        self._console.forget_errors()
        paused = self._snapshot is not None and self._snapshot.state.paused
        self._console.show_error(self._operator.press(name, paused))
        self.refresh_frame()

    def order_vv(self, values: str) -> None:
        """Set a velocity with a time limit."""
        refused = partial(self._console.refuse, self._console.given, f":vv {values.replace(';', ' ')}")
        self._console.show_error(self._operator.drive_for(values, refused))

    def order_send(self, text: str) -> None:
        """Send text to the board."""
        self._console.show_error(self._operator.send_text(text))

    def order_robot(self, port: str) -> None:
        """Drive a real robot."""
        self.server.use_robot(port)

    def order_simulator(self, _: str) -> None:
        """Drive the simulated robot again."""
        self.server.use_simulator()

    def order_pace(self, factor: str) -> None:
        """Set the pace of movements on the screen."""
        self._set_pace(float(factor))

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

    # -- files, and the end ------------------------------------------------------------------------

    def order_shot(self, name: str) -> None:
        """Write a picture of the screen."""
        dark = self._settings.screen.theme != "light"
        self._write(name, screen_picture(rows_of(self.screen), dark=dark), "picture")

    def order_save(self, name: str) -> None:
        """Write the log panel to a file."""
        self._write(name, self._panes.whole_log, "log")

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

    def order_copy(self, _: str) -> None:
        """Copy the log panel to the clipboard."""
        self.action_copy_log()

    def order_log(self, name: str) -> None:
        """Log the run from here on."""
        self.begin(partial(self._start_log, name), "log")

    async def _start_log(self, name: str) -> None:
        """Log the run from now on, or show why that fails."""
        try:
            file = await self.server.begin_log(name)
        except RunLogError as error:
            self._console.show_error(str(error))
        else:
            self._operator.hint(f"logging to {file}")

    def order_quit(self, _: str) -> None:
        """End."""
        self.exit(0)
