"""The replay: the screen of a live run on a log, with a timeline in place of the console."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Sequence
from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.widget import Widget
from textual.widgets import Input

from simmer_tui.errors import RunLogError, SimmerError
from simmer_tui.snapshot import Snapshot
from simmer_tui.takeover import TakeOver, moment_of
from simmer_tui.tui.help import HelpScreen
from simmer_tui.tui.keys_bar import Hint
from simmer_tui.tui.line_panel import LinePanel, heading
from simmer_tui.tui.maze_pane import MouseMaze
from simmer_tui.tui.recorded import MarkKind, RecordedRun
from simmer_tui.tui.shell import Shell, put
from simmer_tui.tui.terminal import TerminalChoice
from simmer_tui.tui.timeline import Timeline

_REFRESH = 0.5
"""How often a log that is still being written is looked at, seconds."""
_HELP = (
    ("space", "play, pause"),
    ("[ and ]", "slower, faster (0.25x to 16x)"),
    ("left, right", "a second back, on; ten with Shift"),
    ("n and N", "next command, the one before"),
    ("c and C", "next contact, the one before"),
    ("o and O", "next goal of a mission, the one before"),
    ("p and P", "next pause, the one before"),
    ("x and X", "next bad command, the one before"),
    ("g", "go to a time: 95, or 1:35; a click on the bar goes there too"),
    ("home, end", "the beginning, the end"),
    ("t", "take over: a live run from here on, for you or a program"),
    ("r, y, v", "show the trail, what the sensors saw, true values"),
    ("plus, minus, f", "zoom, show the whole maze; with the mouse: wheel, drag, click"),
    ("k", "keep the robot in sight"),
    ("tab, /, enter", "to the events, filter them, unfold readings"),
    ("f2, or 1 to 4", "on small screens: the next page, or a page"),
    ("q", "end"),
)
_HINTS: Sequence[Hint] = (
    ("space", "play"),
    ("[ ]", "speed"),
    ("n", "command"),
    ("c", "contact"),
    ("o", "goal"),
    ("p", "pause"),
    ("x", "bad"),
    ("g", "time"),
    ("t", "take over"),
    ("Left Right", "1 s"),
    ("y", "rays"),
    ("v", "truth"),
    ("?", "help"),
    ("q", "quit"),
)


class ReplayApp(Shell):
    """Plays a run log. With `follow` it stays at the end of one that is still being written."""

    TITLE = "SimMeR replay"
    ENABLE_COMMAND_PALETTE = False
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("space", "play", "Play"),
        Binding("left_square_bracket", "speed(-1)", "Slower", key_display="["),
        Binding("right_square_bracket", "speed(1)", "Faster", key_display="]"),
        Binding("n", "go('next_command')", "Command"),
        Binding("N", "go('previous_command')", show=False),
        Binding("x", "go('next_refused')", "Bad"),
        Binding("X", "go('previous_refused')", show=False),
        *(
            Binding(key.upper() if step < 0 else key, f"mark('{kind}', {step})", kind.capitalize())
            for key, kind in (("c", "contact"), ("o", "goal"), ("p", "pause"))
            for step in (1, -1)
        ),
        Binding("left", "seek(-1)", show=False),
        Binding("right", "seek(1)", show=False),
        Binding("shift+left", "seek(-10)", show=False),
        Binding("shift+right", "seek(10)", show=False),
        Binding("home", "begin", show=False),
        Binding("end", "end", show=False),
        Binding("g", "ask_time", "Go to"),
        Binding("t", "take_over", "Take over", show=False),
        Binding("r", "switch('trail')", show=False),
        Binding("y", "switch('plot_sense')", show=False),
        Binding("v", "switch('truth')", show=False),
        Binding("plus,equals_sign", "zoom(1)", show=False),
        Binding("minus", "zoom(-1)", show=False),
        Binding("f", "fit", show=False),
        Binding("k", "follow", show=False),
        Binding("question_mark", "help", "Help", key_display="?"),
        Binding("q", "quit", "Quit"),
    ]

    def __init__(self, run: RecordedRun, choice: TerminalChoice, *, follow: bool = False) -> None:
        super().__init__(run, choice, MouseMaze(choice.glyphs, choice.color, id="maze"))
        self.run_shown = run
        self._head = LinePanel(id="console-head")
        self._timeline = Timeline(run, plain=self._plain)
        self._following = follow
        self._note = ""
        self.taken_over: TakeOver | None = None
        """The moment to go on from, once one has been chosen: the app ends for it."""

    @property
    def entry(self) -> int:
        """The latest entry of the moment shown; -1 before the first."""
        return self.run_shown.entry

    @property
    def elapsed(self) -> float:
        """The moment shown, simulated seconds from the log's beginning."""
        return self.run_shown.elapsed

    # -- putting together ------------------------------------------------------------------------

    def controls(self) -> Iterable[Widget]:
        return self._head, self._timeline, Input(placeholder="a time: 95, or 1:35", compact=True, id="time")

    def on_mount(self) -> None:
        self._maze.focus()
        self._panes.switch("truth", "on")
        self.set_interval(1 / self._settings.screen.fps, self._tick)
        if self._following:
            self.set_interval(_REFRESH, self._take_in)
            self.run_shown.stand_at_end()

    def hints(self) -> Sequence[Hint]:
        return super().hints() if self._panes.log.has_focus else _HINTS

    def shown(self, snapshot: Snapshot, since: int) -> None:
        self.numbers_shown(snapshot)

    def numbers_shown(self, snapshot: Snapshot) -> None:
        self._timeline.bring_up_to_date(self._note or self.run_shown.index.note)

    def _arrange(self, width: int, height: int) -> None:
        super()._arrange(width, height)
        box = self._plan.boxes.get("console-head")
        if box is not None:
            note = "X contact   o goal   p pause"
            head = heading("timeline", note, box.width - 1, plain=self._plain)
            self._head.show([((" ", "plain"), *head)])
        self._put_time(self.query_one("#time").display)

    def _put_time(self, shown: bool) -> None:
        """The line for a time stands in place of the keys."""
        line, box = self.query_one("#time"), self._plan.boxes.get("keys")
        line.display = shown and box is not None
        self._keys.display = not line.display
        if box is not None:
            put(line, box)

    # -- the clock -------------------------------------------------------------------------------

    def _tick(self) -> None:
        """A frame's time has passed."""
        at_end = self.run_shown.tick(1 / self._settings.screen.fps)
        if at_end and not self._following:
            self.run_shown.play(False)
            self.refresh_frame()

    def _take_in(self) -> None:
        """Take in what has been written since."""
        try:
            self.run_shown.take_in()
        except RunLogError as error:
            self._note = str(error)
            self._following = False
            self.refresh_frame()

    # -- keys ------------------------------------------------------------------------------------

    def action_play(self) -> None:
        """Play, from the beginning if we are at the end; or pause."""
        self.run_shown.play(not self.run_shown.playing)
        self.refresh_frame()

    def action_speed(self, step: int) -> None:
        self.run_shown.faster(step)
        self.refresh_frame()

    def action_go(self, what: str) -> None:
        """To the next or previous entry of a kind, by the name of the index's method."""
        found: int | None = getattr(self.run_shown.index, what)(self.entry)
        kind = what.partition("_")[2].replace("refused", "bad command")
        self._stand_at(found, kind, on=what.startswith("next"))

    def action_mark(self, kind: str, step: int) -> None:
        """To the next or previous mark of a kind."""
        mark = self.run_shown.mark_from(MarkKind(kind), step)
        self._stand_at(mark.entry if mark is not None else None, kind, on=step > 0)

    def _stand_at(self, entry: int | None, kind: str, *, on: bool) -> None:
        self.run_shown.play(False)
        if entry is None:
            self.tell(f"no {kind} further {'on' if on else 'back'}")
        else:
            self.run_shown.stand_at(entry)
        self.refresh_frame()

    def action_seek(self, seconds: float) -> None:
        self.run_shown.move_to(self.elapsed + seconds)
        self.refresh_frame()

    def action_begin(self) -> None:
        self.run_shown.begin()
        self.refresh_frame()

    def action_end(self) -> None:
        self.run_shown.stand_at_end()
        self.refresh_frame()

    def on_timeline_sought(self, message: Timeline.Sought) -> None:
        self.run_shown.move_to(message.fraction * self.run_shown.duration)
        self.refresh_frame()

    def action_take_over(self) -> None:
        """Go on from the moment shown, if the log comes out the same up to there."""
        self.run_shown.play(False)
        index = self.run_shown.index
        chosen = TakeOver(index.path, moment_of(index, self.entry, self.elapsed))
        self.notify(f"running it again up to {self.elapsed:.2f} s", timeout=2, markup=False)
        self.run_worker(self._try_to_take_over(chosen), group="take over", exclusive=True)

    async def _try_to_take_over(self, chosen: TakeOver) -> None:
        try:
            await asyncio.to_thread(chosen.check)
        except SimmerError as error:
            self.notify(str(error), title="Not taken over", severity="error", timeout=20, markup=False)
        else:
            self.taken_over = chosen
            self.exit(0)

    def action_ask_time(self) -> None:
        """Ask for a time to go to."""
        line = self.query_one("#time", Input)
        line.value = ""
        self._put_time(True)
        line.focus()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Go to the time typed."""
        try:
            seconds = seconds_of(event.value)
        except ValueError as error:
            self.notify(str(error), severity="error", markup=False)
        else:
            self.run_shown.play(False)
            self.run_shown.move_to(seconds)
            self.refresh_frame()
        self._put_time(False)
        self._maze.focus()

    def action_help(self) -> None:
        text = "\n".join(f"  {key:<18}{what}" for key, what in _HELP)
        self.push_screen(HelpScreen(f"REPLAY of {self.run_shown.index.shown}\n{text}"))


def seconds_of(text: str) -> float:
    """A time as people type it: seconds, or minutes and seconds with a colon. Raises ValueError."""
    parts = text.strip().split(":")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if not 1 <= len(numbers) <= 2 or not all(0 <= number < 1e9 for number in numbers):
        raise ValueError(f"{text.strip()[:20]!r} is not a time; give seconds, such as 95 or 1:35")
    return numbers[-1] + (60 * numbers[0] if len(numbers) == 2 else 0)
