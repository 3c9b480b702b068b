"""The replay screen: a logged run in the same maze and panels, with a clock to move about in."""

from __future__ import annotations

from pathlib import PurePath
from typing import ClassVar

from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.events import Resize
from textual.widgets import Footer, Input

from simmer_tui.errors import RunLogError
from simmer_tui.tui.help import HelpScreen
from simmer_tui.tui.line_panel import LinePanel
from simmer_tui.tui.panes import Panes
from simmer_tui.tui.recorded import RecordedRun
from simmer_tui.tui.replay_readouts import clock, replay_line, scrubber
from simmer_tui.tui.sizes import arrangement
from simmer_tui.tui.terminal import ColorDepth, GlyphMode, TerminalChoice

SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Simulated seconds a second."""
_REFRESH = 0.5
_HELP = (
    ("space", "play, pause"),
    ("[ and ]", "slower, faster (0.25x to 16x)"),
    ("left, right", "a second back, on; ten with Shift"),
    ("n and N", "next command, the one before"),
    ("c and C", "next contact, the one before"),
    ("x and X", "next bad command, the one before"),
    ("g", "go to a time: 95, or 1:35"),
    ("home, end", "the beginning, the end"),
    ("t, y", "show the trail, what the sensors saw"),
    ("plus, minus, f", "zoom, follow the robot"),
    ("q", "end"),
)


class ReplayApp(App[int]):
    """Plays a run log. With `follow` it stays at the end of one that is still being written."""

    TITLE = "SimMeR replay"
    CSS_PATH: ClassVar[list[str | PurePath]] = ["app.tcss", "replay.tcss"]
    ENABLE_COMMAND_PALETTE = False
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("space", "play", "Play"),
        Binding("left_square_bracket", "speed(-1)", "Slower", key_display="["),
        Binding("right_square_bracket", "speed(1)", "Faster", key_display="]"),
        Binding("n", "go('next_command')", "Command"),
        Binding("N", "go('previous_command')", show=False),
        Binding("c", "go('next_contact')", "Contact"),
        Binding("C", "go('previous_contact')", show=False),
        Binding("x", "go('next_refused')", "Bad"),
        Binding("X", "go('previous_refused')", show=False),
        Binding("left", "seek(-1)", show=False),
        Binding("right", "seek(1)", show=False),
        Binding("shift+left", "seek(-10)", show=False),
        Binding("shift+right", "seek(10)", show=False),
        Binding("home", "begin", show=False),
        Binding("end", "end", show=False),
        Binding("g", "ask_time", "Go to"),
        Binding("t", "switch('trail')", show=False),
        Binding("y", "switch('plot_sense')", show=False),
        Binding("plus,equals_sign", "zoom(1)", show=False),
        Binding("minus", "zoom(-1)", show=False),
        Binding("f", "follow", show=False),
        Binding("question_mark", "help", "Help", key_display="?"),
        Binding("q,ctrl+q", "quit", "Quit"),
    ]

    def __init__(self, run: RecordedRun, choice: TerminalChoice, *, follow: bool = False) -> None:
        super().__init__(ansi_color=choice.ansi_color)
        configuration = run.configuration
        self._recorded = run
        self.log_index = run.index
        self._panes = Panes(configuration, choice, {})
        self._panes.switch("truth", "on")
        self._spec = configuration.simulation
        self._settings = configuration.settings
        self._choice = choice
        self._plain = choice.glyphs is GlyphMode.ASCII
        self._following = follow
        self._speed = SPEEDS.index(1.0)
        self._playing = False
        self._fault = ""
        self.entry = -1
        """The latest entry of the moment shown; -1 before the first."""
        self.elapsed = 0.0
        """The moment shown, simulated seconds from the log's beginning."""

    def compose(self) -> ComposeResult:
        with Horizontal(id="main"):
            with Vertical(id="left"):
                yield self._panes.maze
                yield LinePanel(id="entries")
            with self._panes.side:
                yield self._panes.panels["robot"]
                yield self._panes.panels["sensors"]
        yield LinePanel(id="scrubber")
        yield Input(placeholder="a time: 95, or 1:35", compact=True, id="time")
        yield Footer(compact=True, show_command_palette=False)

    def on_mount(self) -> None:
        light = self._settings.screen.theme == "light"
        self.theme = "textual-light" if light else "textual-dark"
        if self._choice.color is ColorDepth.NONE:
            self.theme = "ansi-light" if light else "ansi-dark"
        self.set_class(self._plain, "plain")
        self.query_one("#entries").border_title = "Log"
        self.query_one("#time", Input).display = False
        self._panes.maze.focus()
        self.set_interval(1 / self._settings.screen.fps, self._tick)
        if self._following:
            self.set_interval(_REFRESH, self._take_in)
            self._stand_at_end()
        self.call_after_refresh(self._draw)

    # -- the clock -------------------------------------------------------------------------------

    def _tick(self) -> None:
        """A frame's time has passed."""
        if not self._playing:
            return
        self._move_to(self.elapsed + SPEEDS[self._speed] / self._settings.screen.fps)
        if self.elapsed >= self.log_index.duration and not self._following:
            self._playing = False
            self._draw()

    def _take_in(self) -> None:
        """Take in what has been written since, and stay at the end if we were there."""
        at_end = self.entry >= self.log_index.count - 1
        try:
            fresh = self.log_index.refresh()
        except RunLogError as error:
            self._fault = str(error)
            self._following = False
            self._draw()
            return
        if fresh and at_end and not self._playing:
            self._stand_at_end()
        elif fresh:
            self._draw()

    def _move_to(self, elapsed: float) -> None:
        """Show a moment."""
        log = self.log_index
        self.elapsed = min(max(elapsed, 0.0), log.duration)
        is_any = log.count and self.elapsed >= log.time_of(0)
        self.entry = log.find_time(self.elapsed) if is_any else -1
        self._draw()

    def _stand_at(self, entry: int) -> None:
        """Show the moment at which all that an entry tells has happened."""
        self.entry = entry
        self.elapsed = self.log_index.over_of(entry)
        self._draw()

    def _stand_at_end(self) -> None:
        if self.log_index.count:
            self._stand_at(self.log_index.count - 1)

    # -- drawing ---------------------------------------------------------------------------------

    def on_resize(self, event: Resize) -> None:
        plan = arrangement(self._spec.maze, event.size.width, event.size.height)
        self.set_class(not plan.side_by_side, "narrow")
        self._panes.maze.styles.height = plan.maze_rows if plan.side_by_side else "1fr"
        self.call_after_refresh(self._draw)

    def _draw(self) -> None:
        if not self.is_running or len(self.screen_stack) > 1:
            return
        log = self.log_index
        self._panes.show(self._recorded.snapshot(self.entry, self.elapsed))
        entries = self._panel("entries")
        around = self._recorded.around(max(self.entry, 0), entries.content_size.height)
        entries.show([replay_line(logged, logged.line == self.entry + 2) for logged in around])
        bar = self._panel("scrubber")
        line = scrubber(
            log,
            self.entry,
            self.elapsed,
            speed=SPEEDS[self._speed],
            playing=self._playing,
            width=bar.content_size.width,
            plain=self._plain,
        )
        note = self._fault or log.note
        bar.show([line, ((note, "warning"),)] if note else [line])

    def _panel(self, name: str) -> LinePanel:
        return self.query_one(f"#{name}", LinePanel)

    # -- keys ------------------------------------------------------------------------------------

    def action_play(self) -> None:
        """Play, from the beginning if we are at the end; or pause."""
        self._playing = not self._playing
        if self._playing and self.elapsed >= self.log_index.duration and not self._following:
            self._move_to(0.0)
        self._draw()

    def action_speed(self, step: int) -> None:
        self._speed = min(max(self._speed + step, 0), len(SPEEDS) - 1)
        self._draw()

    def action_go(self, what: str) -> None:
        """To the next or previous entry of a kind, by the name of the index's method."""
        found: int | None = getattr(self.log_index, what)(self.entry)
        self._playing = False
        if found is None:
            kind = what.partition("_")[2].replace("refused", "bad command")
            self.notify(f"no {kind} further {'on' if what.startswith('next') else 'back'}", timeout=2)
            self._draw()
        else:
            self._stand_at(found)

    def action_seek(self, seconds: float) -> None:
        self._move_to(self.elapsed + seconds)

    def action_begin(self) -> None:
        self._playing = False
        self.entry, self.elapsed = -1, 0.0
        self._draw()

    def action_end(self) -> None:
        self._playing = False
        self._stand_at_end()

    def action_ask_time(self) -> None:
        """Ask for a time to go to."""
        line = self.query_one("#time", Input)
        line.display = True
        line.value = ""
        line.focus()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Go to the time typed."""
        try:
            seconds = seconds_of(event.value)
        except ValueError as error:
            self.notify(str(error), severity="error", markup=False)
        else:
            self._playing = False
            self._move_to(seconds)
        event.input.display = False
        self._panes.maze.focus()

    def action_switch(self, name: str) -> None:
        """Show something or not."""
        self._panes.switch(name)
        self._draw()

    def action_zoom(self, step: int) -> None:
        view = self._panes.maze
        if step > 0:
            view.zoom_in()
        else:
            view.zoom_out()

    def action_follow(self) -> None:
        self._panes.maze.toggle_follow()

    def action_help(self) -> None:
        text = "\n".join(f"  {key:<18}{what}" for key, what in _HELP)
        self.push_screen(HelpScreen(f"REPLAY of {self.log_index.shown}\n{text}"), self._back)

    def _back(self, _: None) -> None:
        self._draw()


def seconds_of(text: str) -> float:
    """A time as people type it: seconds, or minutes and seconds with a colon. Raises ValueError."""
    parts = text.strip().split(":")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if not 1 <= len(numbers) <= 2 or not all(0 <= number < 1e9 for number in numbers):
        raise ValueError(f"{text.strip()[:20]!r} is not a time; give seconds, such as 95 or {clock(95)}")
    return numbers[-1] + (60 * numbers[0] if len(numbers) == 2 else 0)
