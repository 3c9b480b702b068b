"""The screen around a run, live or from a log: one set of panes on one source of snapshots.

`SimmerApp` adds a console to it, `ReplayApp` a timeline.
"""

import math
import time
import traceback
from collections.abc import Callable, Coroutine, Iterable, Sequence
from pathlib import Path
from typing import Any, ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.events import DescendantBlur, DescendantFocus, Resize
from textual.filter import ANSIToTruecolor, LineFilter
from textual.geometry import Size
from textual.screen import Screen
from textual.widget import Widget
from textual.worker import Worker

from simmer_tui.errors import printable
from simmer_tui.live.snapshot import Snapshot
from simmer_tui.tui.answers import AnswerCard
from simmer_tui.tui.frame_pace import QUIET, Backpressure, ByteBudget, InputFirst
from simmer_tui.tui.key_table import ANYWHERE, IN_LOG, Hint, hints_of, keys_line
from simmer_tui.tui.line_panel import LinePanel, heading
from simmer_tui.tui.maze.palette import Look
from simmer_tui.tui.maze.view import MazeView
from simmer_tui.tui.panes import Panes, SnapshotSource
from simmer_tui.tui.sizes import (
    ANSWER_ROWS,
    PAGES,
    SMALLEST_COLUMNS,
    SMALLEST_ROWS,
    Arrangement,
    Box,
    arrangement,
)
from simmer_tui.tui.terminal import ColorDepth, GlyphMode, TerminalChoice
from simmer_tui.tui.terminal_app import AsciiFilter, TerminalApp
from simmer_tui.tui.textual_internals import FaultReporting, bytes_written, draw_at_once
from simmer_tui.tui.themes import THEMES, theme_name, themes, variables

# Textual styles all widgets once more when the first picture is there: within 0.1 s of it (measured).
_STARTED = 1.0
"""Seconds from the mounting of the app to the end of its start."""


class Shell(FaultReporting, TerminalApp):
    """Samples the newest snapshot some times a second and draws the changes."""

    CSS_PATH = "app.tcss"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f2", "next_page"),
        *(Binding(str(number), f"page({number})") for number in range(1, len(PAGES) + 1)),
        Binding("ctrl+q", "quit", priority=True),
    ]

    def __init__(self, source: SnapshotSource, choice: TerminalChoice, maze: MazeView) -> None:
        self._choice = choice
        super().__init__(ansi_color=choice.ansi_color)
        self.source = source
        self._spec = source.configuration.simulation
        self._settings = source.configuration.settings
        self._plain = choice.glyphs is GlyphMode.ASCII
        self._panes = Panes(source, choice, maze)
        self._panes.sensors.picked = self.pick_sensor
        self._maze = maze
        self._head = LinePanel(id="console-head")
        self._keys = LinePanel(id="keys")
        self._small = LinePanel(id="small")
        self._gate = Backpressure(self)
        self._input_first = InputFirst(self)
        self._plan = Arrangement({}, False)
        self._known = 0
        self._sampling = False
        self._idle = False
        self._shown_at = -math.inf
        self._budget = ByteBudget()
        self._is_wanted = False
        """True if somebody waits for the next picture."""
        self._is_delayed = False
        """True while a picture waits for its bytes."""
        self._snapshot: Snapshot | None = None
        self._page = 0
        self._answer_rows = 0
        self._had_panels = (0, 0)
        self._last_focused: Widget | None = None
        self._is_arranged = False
        """True while widgets have boxes, but not their sizes."""
        self._sizes: list[Size] = []
        """Sizes of the widgets when all was drawn into them."""
        self._ending: int | None = None
        self.after_start: Callable[[], None] = lambda: None
        """Called once, after the start of the app."""
        self.frames = 0
        """Pictures drawn so far."""
        self.skipped = 0
        """Pictures skipped because the terminal had not taken the last ones."""
        self.fault = ""
        """Fault of its own that ended the app; empty if none did."""

    def begin(self, work: Callable[[], Coroutine[Any, Any, None]], group: str, *, once: bool = False) -> None:
        """Begin work beside the drawing; `once` ends what the group did before. `work` is a function: a
        coroutine that is cancelled before its start is never awaited, and Python warns."""
        _: Worker[None] = self.run_worker(work, group=group, exclusive=once)

    def end(self, code: int) -> None:
        """End soon, with an exit code. Any thread may call it; it does not wait."""
        self._ending = code

    # -- putting together ------------------------------------------------------------------------

    def controls(self) -> Iterable[Widget]:
        """Widgets below the panes; the one with the ID `console` takes the box for them."""
        return ()

    def compose(self) -> ComposeResult:
        yield from self._panes.widgets
        yield from self.controls()
        yield self._keys
        yield self._small

    def on_mount(self) -> None:
        look = THEMES[self._settings.screen.theme]
        for theme in themes(self._choice.color):
            self.register_theme(theme)
        self.theme = theme_name(look)
        if self._choice.color is ColorDepth.NONE:
            self.theme = "ansi-light" if look is Look.LIGHT else "ansi-dark"
        self.set_class(self._plain, "plain")
        self.set_class(self._choice.color is ColorDepth.NONE, "mono")
        self.set_interval(1 / self._settings.screen.fps, self._sample)
        self.set_timer(_STARTED, lambda: self.after_start())
        # The first picture does not wait for the first tick.
        self.call_after_refresh(self._sample)
        self.screen.screen_layout_refresh_signal.subscribe(self, self._laid_out)

    def get_theme_variable_defaults(self) -> dict[str, str]:
        """Colours that other themes than the app's own do not define."""
        return variables(self._choice.color)

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Textual's filters except one, and another for terminals that show only ASCII."""
        # Nothing here uses the 16 colours by name; the filter would search all rows of every picture.
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
        if self._input_first.passes_over():
            return
        # A snapshot comes from the robot's thread; slow ones must not form a queue.
        if self._sampling or not (self._is_wanted or self._is_due()):
            return
        size = self.size
        delay = self._budget.delay(bytes_written(self), size.width * size.height, time.monotonic())
        if delay > 0.0 and not self._is_wanted:
            # A picture comes once there are bytes for it, not at the tick after that.
            if not self._is_delayed and delay < 1 / self._settings.screen.fps:
                self._is_delayed = True
                self.set_timer(delay, self._sample_delayed)
            return
        self._is_wanted = False
        self._sampling = True
        try:
            snapshot = await self.source.snapshot(self._known, self._panes.shown["truth"])
            # The app may have ended during the call in the robot's thread.
            if self.is_running:
                self._show(snapshot)
        finally:
            self._sampling = False

    def _is_due(self) -> bool:
        """True if the screen may differ from the run. Without an event only rates, ages and parts that lag
        do."""
        if self.source.has_news(self._known):
            return True
        is_old = time.monotonic() - self._shown_at >= QUIET
        return is_old and not (self._idle and not self._panes.has_unshown)

    async def _sample_delayed(self) -> None:
        self._is_delayed = False
        await self._sample()

    def post_display_hook(self) -> None:
        self._gate.note_display()

    def _show(self, snapshot: Snapshot) -> None:
        before, self._snapshot = self._snapshot, snapshot
        since, self._known = self._known, snapshot.number
        # A command during a pause is no event, and neither is the end of a quiet second.
        self._idle = False
        if before is not None:
            stays = before.state.pose == snapshot.state.pose
            self._idle = stays and snapshot.rate == 0 and not snapshot.state.paused
        self.frames += 1
        self._shown_at = time.monotonic()
        self._panes.show(snapshot)
        self.shown(snapshot, since)
        self.show_status(snapshot)
        self._make_room_for_answers()
        draw_at_once(self.screen_stack[0])

    def _make_room_for_answers(self) -> None:
        """Arrange the panes again if an answer, or a mission's panel, needs other rows than before."""
        rows = self._panes.answer_rows
        # On a small screen the answer is shown or not; beside the maze only one longer than usual takes more
        # rows.
        rows = min(rows, 1) if self._plan.has_pages else rows * (rows > ANSWER_ROWS)
        panels = self._panes.goals, self._panes.board_rows
        if (rows, panels) != (self._answer_rows, self._had_panels):
            self._answer_rows, self._had_panels = rows, panels
            self._arrange(self.size.width, self.size.height)

    def _show_again(self) -> None:
        """Update everything after a change of sizes."""
        self._panes.show_again()
        if self._snapshot is not None:
            self.show_status(self._snapshot)

    def show_status(self, snapshot: Snapshot) -> None:
        """Show a snapshot in the controls below the panes: called with each frame."""

    def shown(self, snapshot: Snapshot, since: int) -> None:
        """Called when a snapshot is on the screen; its entries are those after the event `since`."""

    def fault_met(self, error: Exception) -> None:
        """Keep the first fault as one line: the server continues after the app's end."""
        if self.fault:
            return
        where = traceback.extract_tb(error.__traceback__)[-1:]
        place = "".join(f" ({Path(frame.filename).name}:{frame.lineno})" for frame in where)
        self.fault = printable(f"{type(error).__name__}: {error}{place}")

    def refresh_frame(self) -> None:
        """Draw again soon, even without an event."""
        self._idle, self._is_wanted = False, True
        self.call_later(self._sample)

    # -- sizes -----------------------------------------------------------------------------------

    def on_resize(self, event: Resize) -> None:
        self._arrange(event.size.width, event.size.height)

    def _arrange(self, width: int, height: int) -> None:
        """Put every widget into its box, and hide those without one."""
        if not width or not height:
            return
        self._plan = arrangement(
            self._spec.maze,
            width,
            height,
            sensors=self._panes.sensor_rows,
            panels=self._panes.panel_rows(height, page=PAGES[self._page] == "robot"),
            page=PAGES[self._page],
            answer=self._answer_rows,
        )
        least = f"at least {SMALLEST_COLUMNS} x {SMALLEST_ROWS} please"
        self._small.show([(("The terminal is too small:", "warning"),), ((least, "plain"),)])
        # Textual takes the focus from a widget that is hidden, as all are while the terminal is too small.
        self._last_focused = self.screen_stack[0].focused or self._last_focused
        # One layout for all boxes, otherwise the screen would be laid out once a widget.
        with self.batch_update():
            for widget in self.screen_stack[0].children:
                box = self._plan.boxes.get(widget.id or "")
                if widget.id is not None and not widget.has_class("-textual-system"):
                    widget.display = box is not None
                    if box is not None:
                        put(widget, box)
        self._show_keys()
        self.refresh_bindings()
        self._is_arranged = True
        self.refresh_frame()

    def _show_head(self, title: str, note: str) -> None:
        """Show the heading of console or timeline, if it has one."""
        box = self._plan.boxes.get("console-head")
        if box is not None:
            line = heading(title, note, box.width - 1, plain=self._plain)
            self._head.show([((" ", "plain"), *line)])

    def _laid_out(self, screen: Screen[object]) -> None:
        """Draw into boxes that have just got their sizes."""
        if not self.screen_stack:
            return  # Textual may report a layout after the app has ended
        # A layout before new boxes may be told after them: theirs is known by the sizes.
        sizes = [widget.size for widget in self.screen_stack[0].children]
        if self._is_arranged or sizes != self._sizes:
            self._is_arranged, self._sizes = False, sizes
            self._restore_focus()
            self._show_again()
            self.refresh_frame()

    def _restore_focus(self) -> None:
        """Give the focus back to the widget that had it, if none has it and that one is shown again."""
        below, last = self.screen_stack[0], self._last_focused
        # Not `display`, which the line keeps while the prompt around it is hidden.
        if below.focused is None and last is not None and last.is_on_screen:
            below.set_focus(last)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Allow pages on small screens only."""
        return self._plan.has_pages or action not in ("page", "next_page")

    def action_page(self, number: int) -> None:
        """On small screens: show everything in brief, or one of sensors, robot and events."""
        self._page = (number - 1) % len(PAGES)
        self._arrange(self.size.width, self.size.height)
        self.call_after_refresh(self.page_turned)

    def page_turned(self) -> None:
        """Called when another page is shown."""
        self.action_focus_pane()

    def action_next_page(self) -> None:
        self.action_page(self._page + 2)

    def action_focus_pane(self) -> None:
        """Focus the maze, or the page shown on a small screen."""
        page = PAGES[self._page] if self._plan.has_pages else "maze"
        self.screen.set_focus({"maze": self._maze, "events": self._panes.log}.get(page))

    # -- keys at the bottom ----------------------------------------------------------------------

    def on_descendant_focus(self, _event: DescendantFocus) -> None:
        self._show_keys()

    def on_descendant_blur(self, _event: DescendantBlur) -> None:
        self._show_keys()

    def hints(self) -> Sequence[Hint]:
        """Keys of the widget that has the focus."""
        return hints_of(IN_LOG if self._panes.log.has_focus else ANYWHERE)

    def _show_keys(self) -> None:
        always = [("F2", PAGES[(self._page + 1) % len(PAGES)])] if self._plan.has_pages else []
        box = self._plan.boxes.get("keys")
        if box is not None:
            self._keys.show([keys_line(self.hints(), box.width, always)])

    # -- answers ---------------------------------------------------------------------------------

    def ask(self, answer: AnswerCard, *, stays: bool = False) -> None:
        """Show an answer in its place, until it is closed or the robot moves again; one that `stays`, until a
        person moves the robot."""
        if self._snapshot is not None:
            self._panes.slot.ask(answer, self._snapshot, stays=stays)
            self._show_again()
            self._make_room_for_answers()

    def action_close_answer(self) -> None:
        """Close the answer, or go to the maze if there is none to close."""
        if self._panes.slot.close():
            self._show_again()
            self._make_room_for_answers()
        else:
            self.action_focus_pane()

    # -- what people do --------------------------------------------------------------------------

    def pick_sensor(self, code: str) -> None:
        """Highlight the rays of a sensor that was clicked on."""
        self._panes.choose(code)
        self.refresh_frame()

    def action_switch(self, name: str, word: str = "") -> None:
        """Show something or not; without a word, switch over."""
        self._panes.switch(name, word)
        self.refresh_frame()

    def action_copy_log(self) -> None:
        """Copy the events, by OSC 52: it works over SSH."""
        self.copy_to_clipboard(self._panes.whole_log)


def put(widget: Widget, box: Box) -> None:
    """Put a widget into a box of the screen."""
    styles = widget.styles
    styles.position = "absolute"
    styles.offset = (box.x, box.y)
    styles.width, styles.height = box.width, box.height
