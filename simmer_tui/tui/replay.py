"""The replay: the screen of a live run for a log, with a timeline in place of the console.

The timeline has a clock, a bar, and marks of contacts, goals and pauses to jump to.
"""

import asyncio
import contextlib
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import ClassVar

from textual.binding import BindingType
from textual.events import Click
from textual.widget import Widget
from textual.widgets import Input

from simmer_tui.errors import RunLogError, SimmerError
from simmer_tui.live.snapshot import Snapshot
from simmer_tui.live.takeover import TakeOver, moment_of
from simmer_tui.runlog.index import EntryFlag
from simmer_tui.runlog.log_records import ProgramRecord
from simmer_tui.tui.answers import note
from simmer_tui.tui.event_text import clock_text
from simmer_tui.tui.help import HelpScreen, replay_help
from simmer_tui.tui.key_table import IN_REPLAY, Hint, bindings_of, hints_of
from simmer_tui.tui.line_panel import LinePanel, StyledLine, shortened, text_of
from simmer_tui.tui.maze.view import MazeView
from simmer_tui.tui.recorded import RecordedRun, TimelineMarkKind
from simmer_tui.tui.shell import Shell, put
from simmer_tui.tui.terminal import TerminalChoice

# Often enough to follow a run, rarely enough that an idle log costs nothing.
_REFRESH = 0.5
"""Seconds between two reads of a log that is still being written."""
_SIGNS = {
    TimelineMarkKind.CONTACT: ("X", "X", "contact"),
    TimelineMarkKind.GOAL: ("◆", "*", "good"),
    TimelineMarkKind.PAUSE: ("‖", "|", "value"),
}
"""Sign of a kind of mark, that in ASCII, and its role."""
# With fewer a column represents too much of a run to be useful.
_LEAST_BAR = 5


def bar_of(run: RecordedRun, width: int, *, plain: bool) -> tuple[str, int, str]:
    """Text before the bar, columns of the bar, and text after it."""
    going, standing = (">", "=") if plain else ("▶", "‖")
    lead = f" {going if run.playing else standing} {run.playback_rate:g}x"
    head = f"{lead:<8} {clock_text(run.elapsed)} / {clock_text(run.duration)} "
    tail = f" {max(run.entry, -1) + 1}/{run.index.count} "
    return head, width - len(head) - len(tail), tail


def bar_line(run: RecordedRun, width: int, *, plain: bool) -> StyledLine:
    """Speed, time, a bar, and the number of the entry."""
    head, room, tail = bar_of(run, width, plain=plain)
    if room < _LEAST_BAR:
        return (head.rstrip(), "value"), (tail, "label")
    done, left, knob = ("=", "-", "O") if plain else ("━", "─", "●")
    fraction = run.elapsed / run.duration if run.duration else max(run.entry, 0) / max(run.index.count - 1, 1)
    place = _column(fraction, room)
    return (
        (head, "value"),
        (done * place, "mark"),
        (knob, "newest"),
        (left * (room - place - 1), "rule"),
        (tail, "label"),
    )


def marks_line(run: RecordedRun, note: str, width: int, *, plain: bool) -> StyledLine:
    """Marks above the bar; of several in one place the first by kind. `note` is an error, or the present
    place."""
    head, room, _ = bar_of(run, width, plain=plain)
    if room < _LEAST_BAR:
        return ((f" {note}", "warning"),)
    kinds = list(TimelineMarkKind)
    columns: dict[int, TimelineMarkKind] = {}
    # The first by kind is written last, and so stays.
    for mark in sorted(run.marks, key=lambda mark: kinds.index(mark.kind), reverse=True):
        fraction = mark.elapsed / run.duration if run.duration else 0.0
        columns[_column(fraction, room)] = mark.kind
    noted = text_of(shortened(((f" {note}", "warning"),), len(head) - 1))
    pieces: list[tuple[str, str]] = [(noted.ljust(len(head)), "warning")]
    at = 0
    for column in sorted(columns):
        kind = columns[column]
        pieces += [(" " * (column - at), "plain"), (_SIGNS[kind][plain], _SIGNS[kind][2])]
        at = column + 1
    return (*pieces, (" " * (room - at), "plain"))


def _column(fraction: float, room: int) -> int:
    return min(max(round(fraction * (room - 1)), 0), room - 1)


class Timeline(LinePanel):
    """Shows the place in a log; a click moves to another."""

    def __init__(self, run: RecordedRun, moved: Callable[[], None], *, plain: bool) -> None:
        """`moved` is called when a click has moved the run."""
        super().__init__(id="console")
        self._run, self._moved = run, moved
        self._plain = plain

    def update_content(self, note: str) -> None:
        """Show the run's moment."""
        width = self.size.width
        if width:
            marks = marks_line(self._run, note, width, plain=self._plain)
            self.show([marks, bar_line(self._run, width, plain=self._plain)])

    def on_click(self, event: Click) -> None:
        head, room, _ = bar_of(self._run, self.size.width, plain=self._plain)
        column = event.x - len(head)
        if room >= _LEAST_BAR and 0 <= column < room:
            self._run.move_to(column / (room - 1) * self._run.index.duration)
            self._moved()


class ReplayApp(Shell):
    """Plays a run log. With `follow` it stays at the end of one that is still being written."""

    TITLE = "SimMeR replay"
    ENABLE_COMMAND_PALETTE = False
    BINDINGS: ClassVar[list[BindingType]] = bindings_of(IN_REPLAY)

    def __init__(
        self, run: RecordedRun, choice: TerminalChoice, *, follow: bool = False, devices: Path | None = None
    ) -> None:
        """The device files of the run, needed for a take-over, are in the folder `devices`."""
        maze = MazeView(choice.glyphs, choice.color)
        super().__init__(run, choice, maze)
        # The maze's own actions, wherever the focus is.
        self.action_zoom, self.action_fit = maze.action_zoom, maze.action_fit
        self.action_follow = maze.action_follow
        self.run_shown = run
        self._devices = devices
        self._timeline = Timeline(run, self.refresh_frame, plain=self._plain)
        self._following = follow
        self._note = ""
        self.taken_over: TakeOver | None = None
        """Moment to continue from, once one has been chosen: the app ends for it."""

    # -- putting together ------------------------------------------------------------------------

    def controls(self) -> Iterable[Widget]:
        return self._head, self._timeline, Input(placeholder="a time: 95, or 1:35", compact=True, id="time")

    def on_mount(self) -> None:
        self._maze.focus()
        # People replay a run to find what went wrong, and true values help.
        self._panes.switch("truth", "on")
        self.set_interval(1 / self._settings.screen.fps, self._tick)
        self.begin(self._find_verdict, "verdict")
        if self._following:
            self.set_interval(_REFRESH, self._take_in)
            self.run_shown.stand_at_end()

    def hints(self) -> Sequence[Hint]:
        return super().hints() if self._panes.log.has_focus else hints_of(IN_REPLAY)

    def show_status(self, snapshot: Snapshot) -> None:
        self._timeline.update_content(self._note or self.run_shown.index.note)

    def _arrange(self, width: int, height: int) -> None:
        super()._arrange(width, height)
        legend = (f"{signs[self._plain]} {kind.value}" for kind, signs in _SIGNS.items())
        self._show_head("timeline", "   ".join(legend))
        self._put_time(self.query_one("#time").display)

    def _put_time(self, shown: bool) -> None:
        """Show the line for a time in place of the keys, or hide it."""
        line, box = self.query_one("#time"), self._plan.boxes.get("keys")
        line.display = shown and box is not None
        self._keys.display = not line.display
        if box is not None:
            put(line, box)

    # -- the clock -------------------------------------------------------------------------------

    def _tick(self) -> None:
        """Advance the clock by a frame's time."""
        at_end = self.run_shown.tick(1 / self._settings.screen.fps)
        if at_end and not self._following:
            self.run_shown.play(False)
            self.refresh_frame()

    async def _find_verdict(self) -> None:
        """Find the verdict, so that the run's end shows its cause, as in a live run."""
        with contextlib.suppress(RunLogError):  # with `follow`, `_take_in` reports it
            await self.run_shown.find_verdict()
            self.refresh_frame()

    def _take_in(self) -> None:
        """Read new entries of the log. After one that may end a run, find the verdict again."""
        index = self.run_shown.index
        known = index.count
        try:
            fresh = self.run_shown.poll()
            has_program_ended = fresh and isinstance(index.record(index.count - 1), ProgramRecord)
            if has_program_ended or index.find_next(known - 1, EntryFlag.MISSION) is not None:
                self.begin(self._find_verdict, "verdict", once=True)
        except RunLogError as error:
            self._note = str(error)
            self._following = False
            self.refresh_frame()

    # -- keys ------------------------------------------------------------------------------------

    def action_play(self) -> None:
        """Play, from the beginning if the run is at its end; or pause."""
        self.run_shown.play(not self.run_shown.playing)
        self.refresh_frame()

    def action_playback_rate(self, step: int) -> None:
        self.run_shown.faster(step)
        self.refresh_frame()

    def action_jump(self, kind: str, step: int) -> None:
        """Go to the next (1) or previous (-1) entry of a kind: one of the index's, or a mark's."""
        run = self.run_shown
        flags = {"command": EntryFlag.COMMAND, "refused command": EntryFlag.FAULTY}.get(kind)
        run.play(False)
        if flags is None:
            entry = run.mark_from(TimelineMarkKind(kind), step)
        else:
            find = run.index.find_next if step > 0 else run.index.find_previous
            entry = find(run.entry, flags)
        if entry is None:
            self.tell(f"no {kind} further {'on' if step > 0 else 'back'}")
        else:
            run.stand_at(entry)
        self.refresh_frame()

    def action_seek(self, seconds: float) -> None:
        self.run_shown.move_to(self.run_shown.elapsed + seconds)
        self.refresh_frame()

    def action_begin(self) -> None:
        self.run_shown.begin()
        self.refresh_frame()

    def action_end(self) -> None:
        self.run_shown.stand_at_end()
        self.refresh_frame()

    def action_take_over(self) -> None:
        """Continue live from the moment shown, if the log can be repeated up to there."""
        self.run_shown.play(False)
        index, elapsed = self.run_shown.index, self.run_shown.elapsed
        chosen = TakeOver(index.path, moment_of(index, self.run_shown.entry, elapsed), self._devices)
        self.tell(f"running it again up to {elapsed:.2f} s")
        self.begin(partial(self._try_to_take_over, chosen), "take over", once=True)

    async def _try_to_take_over(self, chosen: TakeOver) -> None:
        try:
            await asyncio.to_thread(chosen.check)
        except SimmerError as error:
            self.ask(note("not taken over", str(error), "danger"))
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
            self.ask(note("no such time", str(error), "danger"))
        else:
            self.run_shown.play(False)
            self.run_shown.move_to(seconds)
            self.refresh_frame()
        self._put_time(False)
        self._maze.focus()

    def tell(self, text: str) -> None:
        """Show a note in the place for answers."""
        self.ask(note("replay", text))

    def action_help(self) -> None:
        self.push_screen(HelpScreen(replay_help(self.run_shown.index.shown)))


def seconds_of(text: str) -> float:
    """Seconds of a time as people type it: seconds, or minutes and seconds with a colon.

    Raises:
        ValueError: if it is neither.
    """
    parts = text.strip().split(":")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if not 1 <= len(numbers) <= 2 or not all(0 <= number < 1e9 for number in numbers):
        raise ValueError(f"{text.strip()[:20]!r} is not a time; give seconds, such as 95 or 1:35")
    return numbers[-1] + (60 * numbers[0] if len(numbers) == 2 else 0)
