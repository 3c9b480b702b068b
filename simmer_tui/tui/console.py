"""The console: a line to type in, and above it what a line may become or what was wrong."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.message import Message
from textual.suggester import Suggester
from textual.widgets import Input

from simmer_tui.errors import ConsoleCommandError
from simmer_tui.sim.specs import SimulationSpec
from simmer_tui.tui.console_commands import (
    ConsoleCommand,
    completed,
    completions,
    read_console_command,
)
from simmer_tui.tui.history import History
from simmer_tui.tui.line_panel import Line, LinePanel


class _Completer(Suggester):
    """Suggests the first completion."""

    def __init__(self, spec: SimulationSpec) -> None:
        super().__init__(use_cache=False, case_sensitive=True)
        self._spec = spec

    async def get_suggestion(self, value: str) -> str | None:
        return completed(value, self._spec)


class _ConsoleInput(Input):
    """The line itself, with history on the arrow keys."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "older", "Older", show=False),
        Binding("down", "newer", "Newer", show=False),
        Binding("tab", "complete", "Complete", show=False),
        Binding("escape", "app.focus_pane", "Drive by keys"),
    ]

    def __init__(self, spec: SimulationSpec, history: History) -> None:
        super().__init__(
            placeholder="a command such as u1 or d1-3, or :help",
            suggester=_Completer(spec),
            select_on_focus=False,
            compact=True,
            id="line",
        )
        self.cursor_blink = False  # an idle screen sends nothing
        self.history = history
        self._spec = spec

    def action_complete(self) -> None:
        """Take the first completion; where there is none, go on to the next pane."""
        line = completed(self.value, self._spec)
        if line is None:
            self.screen.focus_next()
        else:
            self._replace(line)

    def action_older(self) -> None:
        self._replace(self.history.back(self.value))

    def action_newer(self) -> None:
        self._replace(self.history.forward())

    def _replace(self, line: str) -> None:
        self.value = line
        self.cursor_position = len(line)


class Console(Vertical):
    """Takes typed lines and posts what they ask for."""

    class Ordered(Message):
        """A line was given."""

        def __init__(self, order: ConsoleCommand) -> None:
            super().__init__()
            self.order = order

    def __init__(self, spec: SimulationSpec, history: History) -> None:
        super().__init__(id="console")
        self._spec = spec
        self._input = _ConsoleInput(spec, history)
        self._hint = LinePanel(id="hint")
        self._status: Line = ()
        self._error = ""

    def compose(self) -> ComposeResult:
        yield self._hint
        yield self._input

    def focus_line(self, text: str | None = None) -> None:
        """Give the line the focus, perhaps with text to go on from."""
        if text is not None:
            self._input.value = text
            self._input.cursor_position = len(text)
        self._input.focus()

    def show_status(self, status: Line) -> None:
        """What to show above the line while nothing is being typed."""
        self._status = status
        self._show_hint()

    def show_error(self, text: str) -> None:
        """Say what is wrong, until something else is typed."""
        self._error = text
        self._show_hint()

    def on_input_changed(self, event: Input.Changed) -> None:
        event.stop()
        if event.value:
            self._error = ""
        self._show_hint()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        event.stop()
        line = event.value
        if not line.strip():
            return
        self._input.history.add(line)
        try:
            order = read_console_command(line)
        except ConsoleCommandError as error:
            self.show_error(str(error))
            return
        self._input.value = ""
        self._error = ""
        self._show_hint()
        self.post_message(self.Ordered(order))

    def _show_hint(self) -> None:
        self._hint.show([self._hint_line()])

    def _hint_line(self) -> Line:
        if self._error:
            return ((self._error, "danger"),)
        value = self._input.value
        if not value.strip():
            return self._status
        found = completions(value, self._spec)
        if not found:
            return (("no such order" if value.startswith(":") else "no such code", "warning"),)
        if len(found) == 1:
            return (f"{found[0][0]} ", "value"), (found[0][1], "label")
        pieces: list[tuple[str, str]] = []
        for completion, meaning in found:
            pieces += [(f"{completion} ", "value"), (f"{meaning}   ", "label")]
        return tuple(pieces)
