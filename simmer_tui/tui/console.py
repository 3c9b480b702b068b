"""The console: a line to type in, with its history. Completions or errors are shown above it."""

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.events import Key
from textual.suggester import Suggester
from textual.widgets import Input

from simmer_tui import platform_has
from simmer_tui.errors import ConsoleCommandError
from simmer_tui.live.operating.orders import ConsoleCommand, completed, completions, read_console_command
from simmer_tui.sim.command import WORD, cut
from simmer_tui.sim.specs import SimulationSpec
from simmer_tui.tui.key_table import IN_CONSOLE, bindings_of
from simmer_tui.tui.line_panel import LinePanel, StyledLine, between, length, shortened
from simmer_tui.whole_file import write_whole

# A file of a few KB, which is written again with every line.
KEPT = 500
"""Lines kept in the history."""
_GAP = 3
"""Columns between what is typed and the last reply."""
# As long as the longest path of a file on Linux. Each key draws the whole line again.
_LONGEST_LINE = 4096
"""Characters that the line holds."""


def default_history_file() -> Path:
    """File of the history in the user's data folder."""
    return platform_has.data_folder() / "console-history.txt"


class History:
    """Typed lines, oldest first. Without a readable or writable file it works without one."""

    def __init__(self, file: Path | None) -> None:
        self._file = file
        self._lines: list[str] = []
        if file is not None:
            with contextlib.suppress(OSError):  # there may be none yet
                text = file.read_text(encoding="utf-8", errors="replace")
                self._lines = [line for line in text.splitlines() if line.strip()][-KEPT:]
        self._place = len(self._lines)
        self._draft = ""

    def add(self, line: str) -> None:
        """Keep a line, unless it repeats the last."""
        if line.strip() and self._lines[-1:] != [line]:
            self._lines = [*self._lines, line][-KEPT:]
            self._write()
        self._place = len(self._lines)

    def back(self, draft: str) -> str:
        """Line before the present one; `draft` is the text in the console now."""
        if self._place == len(self._lines):
            self._draft = draft
        self._place = max(self._place - 1, 0)
        return self._lines[self._place] if self._lines else draft

    def forward(self) -> str:
        """Line after the present one; after the last one the draft again."""
        self._place = min(self._place + 1, len(self._lines))
        return self._lines[self._place] if self._place < len(self._lines) else self._draft

    def _write(self) -> None:
        if self._file is None:
            return
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            write_whole(self._file, "".join(f"{line}\n" for line in self._lines))
        except OSError:
            self._file = None


class _Completer(Suggester):
    """Suggests the first completion."""

    def __init__(self, spec: SimulationSpec) -> None:
        super().__init__(use_cache=False, case_sensitive=True)
        self._spec = spec

    async def get_suggestion(self, value: str) -> str | None:
        return completed(value, self._spec)


class _ConsoleInput(Input):
    """The line itself, with history on the arrow keys."""

    BINDINGS: ClassVar[list[BindingType]] = bindings_of(IN_CONSOLE)
    DEFAULT_CSS = """
    _ConsoleInput:ansi > .input--cursor, _ConsoleInput:ansi > .input--selection { text-style: reverse; }
    """

    def __init__(self, spec: SimulationSpec, history: History, owner: "ConsolePane") -> None:
        super().__init__(
            placeholder="a command such as u1 or d1-3, or :help",
            suggester=_Completer(spec),
            select_on_focus=False,
            compact=True,
            id="line",
        )
        # An idle screen sends nothing.
        self.cursor_blink = False
        self.history = history
        self._spec = spec
        self._owner = owner

    async def take_key(self, event: Key) -> bool:
        """Do a key's action completely before this returns; False if it has none here."""
        key = event.character or ""
        free = self._owner.free_keys.get(key)
        if free is not None and not self.value and not completions(key, self._spec) and free():
            return True
        if event.is_printable and event.character is not None:
            self._type(event.character)
            return True
        action = _ACTIONS.get(event.key)
        return action is not None and await self.app.run_action(action, self)

    def take_paste(self, text: str) -> None:
        """Submit each whole line of a pasted text; the rest after the last line end stays in the line."""
        *lines, rest = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
        refusals = []
        for line in lines:
            self._type(line)
            refusals.append(self._submit())
        if rest:
            self._type(rest)
        refused = [each for each in refusals if each]
        if len(refused) > 1 or (refused and not refusals[-1]):
            self._owner.show_error(f"{len(refused)} of {len(lines)} lines refused; first {refused[0]}")

    def _type(self, text: str) -> None:
        """Put text in place of the marked one, as far as there is room."""
        begin, end = sorted(self.selection)
        self.replace(text[: max(_LONGEST_LINE - len(self.value) + end - begin, 0)], begin, end)

    def on_mouse_up(self) -> None:
        """Copy marked text, as everywhere."""
        if self.selected_text:
            self.app.copy_to_clipboard(self.selected_text)

    async def action_submit(self) -> None:
        """Submit the line and empty it at once: a letter typed meanwhile belongs to the next one."""
        self._submit()

    def _submit(self) -> str:
        """Submit the line. Returns an error text, or an empty one. After an error the line stays, marked."""
        if not self.value.strip():
            self.value = ""
            return ""
        self.history.add(self.value)
        refusal = self._owner.give(self.value)
        if refusal:
            self.select_all()
        else:
            self.value = ""
        return refusal

    def action_complete(self) -> None:
        """Use the first completion; without one, move to the next pane."""
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


_ACTIONS = {
    key.strip(): binding.action
    for binding in (*Input.BINDINGS, *_ConsoleInput.BINDINGS)
    if isinstance(binding, Binding)
    for key in binding.key.split(",")
}
"""Action of each key on the line, the editing keys among them."""


class ConsolePane(Vertical):
    """Takes typed lines and has them carried out."""

    def __init__(
        self, spec: SimulationSpec, history: History, follow: Callable[[ConsoleCommand], object]
    ) -> None:
        """`follow` carries out a line. It is called directly: later keys might overtake a message."""
        super().__init__(id="console")
        self._spec = spec
        self._follow = follow
        self.line = _ConsoleInput(spec, history, self)
        """Line that is typed into."""
        self._hint = LinePanel(id="hint")
        self._status: StyledLine = ()
        self._reply: StyledLine = ()
        self._error = ""
        self._refusal = ""
        self._mistaken = ""
        """Text of the line when the error was shown; with something else in it the error goes."""
        self._note = ""
        self.free_keys: dict[str, Callable[[], bool]] = {}
        """Actions of keys while nothing is typed; each returns false if it is not possible now."""
        self.given = 0
        """Lines given so far."""

    def compose(self) -> ComposeResult:
        yield self._hint
        yield self.line

    def focus_line(self, text: str | None = None) -> None:
        """Give the line the focus, optionally with a text to continue."""
        if text is not None:
            self.line.value = text
            self.line.cursor_position = len(text)
        # At once: the widget's own `focus` would come after keys that are typed already.
        self.screen.set_focus(self.line)

    def show_status(self, status: StyledLine, reply: StyledLine = ()) -> None:
        """Set the text above the line while nothing is being typed, and the one at its end meanwhile."""
        self._status, self._reply = status, reply
        self._show_hint()

    def show_error(self, text: str) -> None:
        """Show an error, if there is one, until something else is typed."""
        if text:
            self._error, self._mistaken = text, self.line.value
            self._show_hint()

    def show_refusal(self, text: str) -> None:
        """Show an error of a person's last action, by key or line; an empty text for none."""
        self._refusal, self._mistaken = text, self.line.value
        self._show_hint()

    def show_note(self, text: str) -> None:
        """Show a note until something is typed, or an error comes."""
        self._note = text
        self._show_hint()

    def forget_errors(self) -> None:
        """Hide errors and notes: a person has done something else."""
        if self._error or self._refusal or self._note:
            self._error = self._refusal = self._note = ""
            self._show_hint()

    def note_event(self) -> None:
        """Note a newer event. An error stays as long as its line may be corrected."""
        if not self.has_focus_within:
            self.forget_errors()

    def give(self, line: str) -> str:
        """Carry out a line. Returns, and shows, the error if it is no order or command."""
        self.given += 1
        self._note = ""
        try:
            order = read_console_command(line, self._spec)
        except ConsoleCommandError as error:
            self.show_error(str(error))
            return str(error)
        self._error = self._refusal = ""
        self._follow(order)
        return ""

    def refuse(self, number: int, text: str, reason: str) -> None:
        """Show that the robot has refused the command of the line with that number. Any thread may call
        it."""
        self.call_later(self._show_refusal, number, text, reason)

    def _show_refusal(self, number: int, text: str, reason: str) -> None:
        """Put the line back to be corrected, unless others were submitted or begun since."""
        if number == self.given and not self.line.value:
            self.line.value = text
            self.line.select_all()
        self.show_error(reason)

    def on_input_changed(self, event: Input.Changed) -> None:
        event.stop()
        value = self.line.value
        if value and value != self._mistaken:
            self._error = self._refusal = self._note = ""
        self._show_hint()

    def _show_hint(self) -> None:
        self._hint.show([self._hint_line()])

    def _hint_line(self) -> StyledLine:
        if self._error or self._refusal:
            return ((self._error or self._refusal, "danger"),)
        if self._note:
            return ((self._note, "value"),)
        value = self.line.value
        if not value.strip():
            return self._status
        width = self._hint.size.width
        reply = shortened(self._reply, width // 2)
        room = width - length(reply) - _GAP if reply else width
        return between(shortened(self._completions(value), room), reply, width)

    def _completions(self, value: str) -> StyledLine:
        """The meaning of a text that is being typed, or how it may go on."""
        found = completions(value, self._spec)
        if not found:
            what = "order" if value.startswith(":") else "code"
            name = cut(value.split()[0] if what == "order" else value.strip()[:2], WORD)
            return ((f"no such {what} {name}; :help lists them", "warning"),)
        if len(found) == 1:
            return (f"{found[0][0]} ", "value"), (found[0][1], "label")
        pieces: list[tuple[str, str]] = []
        for completion, meaning in found:
            pieces += [(f"{completion} ", "value"), (f"{meaning}   ", "label")]
        return tuple(pieces)
