"""The console: a line to type in, and above it what a line may become or what was wrong."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.events import Key
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
        Binding("enter", "submit", "Give", key_display="enter"),
        Binding("tab", "complete", "Complete"),
        Binding("escape", "app.focus_pane", "Drive by keys"),
        Binding("up", "older", "Older", show=False),
        Binding("down", "newer", "Newer", show=False),
    ]
    DEFAULT_CSS = """
    _ConsoleInput:ansi > .input--cursor, _ConsoleInput:ansi > .input--selection { text-style: reverse; }
    """

    def __init__(self, spec: SimulationSpec, history: History, owner: Console) -> None:
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
        self._owner = owner

    async def take_key(self, event: Key) -> bool:
        """Do what a key says, wholly, before this returns; False if it means nothing here."""
        if event.is_printable and event.character is not None:
            self.replace(event.character, *self.selection)
            return True
        action = _ACTIONS.get(event.key)
        return action is not None and await self.app.run_action(action, self)

    def take_paste(self, text: str) -> None:
        """Give each whole line of a pasted text; what comes after the last stays in the line."""
        *lines, rest = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
        complaints = []
        for line in lines:
            self.replace(line, *self.selection)
            complaints.append(self._submit())
        if rest:
            self.replace(rest, *self.selection)
        refused = [each for each in complaints if each]
        if len(refused) > 1 or (refused and not complaints[-1]):
            self._owner.show_error(f"{len(refused)} of {len(lines)} lines refused; first {refused[0]}")

    def on_mouse_up(self) -> None:
        """Marked text is copied, as everywhere."""
        if self.selected_text:
            self.app.copy_to_clipboard(self.selected_text)

    async def action_submit(self) -> None:
        """Give the line and empty it at once: a letter typed meanwhile belongs to the next one."""
        self._submit()

    def _submit(self) -> str:
        """Give the line. Returns what is wrong with it, if anything is; it then stays, marked."""
        if not self.value.strip():
            self.value = ""
            return ""
        self.history.add(self.value)
        complaint = self._owner.give(self.value)
        if complaint:
            self.select_all()
        else:
            self.value = ""
        return complaint

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


def _actions() -> dict[str, str]:
    bindings = [*Input.BINDINGS, *_ConsoleInput.BINDINGS]
    named = [each for each in bindings if isinstance(each, Binding)]
    return {key.strip(): binding.action for binding in named for key in binding.key.split(",")}


_ACTIONS = _actions()
"""What each key does to the line, the editing keys among them."""


class Console(Vertical):
    """Takes typed lines and has done what they ask for."""

    class Refused(Message):
        """The robot would not do what was asked for in a line."""

        def __init__(self, number: int, text: str, reason: str) -> None:
            super().__init__()
            self.number = number
            self.text = text
            self.reason = reason

    def __init__(
        self, spec: SimulationSpec, history: History, follow: Callable[[ConsoleCommand], object]
    ) -> None:
        """`follow` does what a line asks for. It is called, not told by a message, which keys typed
        after the line might overtake."""
        super().__init__(id="console")
        self._spec = spec
        self._follow = follow
        self._input = _ConsoleInput(spec, history, self)
        self._hint = LinePanel(id="hint")
        self._status: Line = ()
        self._error = ""
        self._complaint = ""
        self._mistaken = ""
        """What stood in the line when the error was shown; with something else in it the error goes."""
        self._note = ""
        self.given = 0
        """Lines given so far."""

    @property
    def line(self) -> _ConsoleInput:
        """The line that is typed into."""
        return self._input

    def compose(self) -> ComposeResult:
        yield self._hint
        yield self._input

    def focus_line(self, text: str | None = None) -> None:
        """Give the line the focus, perhaps with text to go on from."""
        if text is not None:
            self._input.value = text
            self._input.cursor_position = len(text)
        self.screen.set_focus(self._input)  # at once; the widget's own `focus` comes after more keys

    def show_status(self, status: Line) -> None:
        """What to show above the line while nothing is being typed."""
        self._status = status
        self._show_hint()

    def show_error(self, text: str) -> None:
        """Say what is wrong, until something else is typed."""
        self._error = text
        self._mistaken = self._input.value
        self._show_hint()

    def show_complaint(self, text: str) -> None:
        """Say what was wrong with what a person did last, on whatever way; an empty text for nothing."""
        self._complaint = text
        self._mistaken = self._input.value
        self._show_hint()

    def show_note(self, text: str) -> None:
        """Say something in passing, until something is typed or wrong."""
        self._note = text
        self._show_hint()

    def forget_errors(self) -> None:
        """What was wrong is over: a person has done something else."""
        if self._error or self._complaint or self._note:
            self._error = self._complaint = self._note = ""
            self._show_hint()

    def note_event(self) -> None:
        """Something newer has happened. What is wrong with a line stays as long as one may mend it."""
        if not self.has_focus_within:
            self.forget_errors()

    def give(self, line: str) -> str:
        """Have a line carried out. Returns, and shows, what is wrong if it is no order or command."""
        self.given += 1
        self._note = ""
        try:
            order = read_console_command(line, self._spec)
        except ConsoleCommandError as error:
            self.show_error(str(error))
            return str(error)
        self._error = self._complaint = ""
        self._follow(order)
        return ""

    def refuse(self, number: int, text: str, reason: str) -> None:
        """The robot has refused the command of the line with that number. Any thread may say so."""
        self.post_message(self.Refused(number, text, reason))

    def on_console_refused(self, message: Refused) -> None:
        """Say so, and put the line back to be mended, unless others were given or begun since."""
        message.stop()
        if message.number == self.given and not self._input.value:
            self._input.value = message.text
            self._input.select_all()
        self.show_error(message.reason)

    def on_input_changed(self, event: Input.Changed) -> None:
        event.stop()
        value = self._input.value
        if value and value != self._mistaken:
            self._error = self._complaint = self._note = ""
        self._show_hint()

    def _show_hint(self) -> None:
        self._hint.show([self._hint_line()])

    def _hint_line(self) -> Line:
        if self._error or self._complaint:
            return ((self._error or self._complaint, "danger"),)
        if self._note:
            return ((self._note, "value"),)
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
