"""Base of the apps: features of a terminal that Textual lacks.

These are keys in order, its clipboard, and plain ASCII if it has no more.
"""

import os
import select
import signal
import sys
import threading
from base64 import b64encode
from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from rich.cells import cell_len
from rich.segment import Segment
from textual import events
from textual.app import App
from textual.color import Color
from textual.driver import Driver
from textual.filter import LineFilter

from simmer_tui.sim.command import counted
from simmer_tui.tui.textual_internals import steady_driver, write_sequence

# The bytes of base64 that xterm accepts, and many other terminals after it.
_COMMON_LIMIT = 74_994
ALLOWING = (
    ("tmux", "set -g set-clipboard on, or set -g allow-passthrough on"),
    ("terminal", "allow OSC 52 (access to the clipboard) in its settings"),
)
"""Settings that allow the copying of text."""
_RESEMBLING = {
    "-": "─━▁▂▔–—",
    "|": "│┃▌▐▎▊▏",
    "+": "┌┐└┘├┤┬┴┼╭╮╰╯✓",
    "#": "█▃▄▅▆▇▀",
    "*": "•",
    ".": "·",
    "~": "…",
    "^": "↑",
    "v": "↓",
    "<": "←",
    ">": "→",
}
_REPLACED = {character: sign for sign, characters in _RESEMBLING.items() for character in characters}


@runtime_checkable
class KeyTaker(Protocol):
    """Widget or screen that does its keys in the app's own queue."""

    async def take_key(self, event: events.Key) -> bool:
        """Do a key's action completely before this returns; False if it has none here."""
        ...


@runtime_checkable
class LineEditor(KeyTaker, Protocol):
    """Widget that people type lines into."""

    def take_paste(self, text: str) -> None:
        """Take pasted text completely before this returns."""
        ...


class TerminalApp(App[int]):
    """Does a key's action before it reads the next key.

    Textual passes a key to the queue of the widget with the focus. If the widget does not take it, it passes
    on to the app, which looks for a binding. Keys may come at once (typed ahead, sent by tmux, by a slow
    link). Letters then overtake an Enter or an Escape before them: lines are joined, and letters of a command
    drive the robot. A second key of those that close a page would close the screen below it.
    """

    paste_target: LineEditor | None = None
    """Receiver of pasted text, wherever the focus is."""

    def get_driver_class(self) -> type[Driver]:
        """The driver that no input of the terminal ends."""
        return steady_driver(super().get_driver_class())

    async def on_event(self, event: events.Event) -> None:
        """Take keys and pastes for a line editor, and keys for a page, here, in the app's own queue."""
        if isinstance(event, events.Key | events.Paste) and not event.is_forwarded:
            # Textual would give the focus back only with this key, which then reaches no widget: in a browser
            # the app begins without the focus.
            self.app_focus = True
            if isinstance(event, events.Key):
                for taker in (self.focused, self.screen):
                    if isinstance(taker, KeyTaker) and await taker.take_key(event):
                        return
            elif len(self.screen_stack) == 1:
                target = self.focused if isinstance(self.focused, LineEditor) else self.paste_target
                if target is not None:
                    target.take_paste(event.text)
                    return
        await super().on_event(event)

    def on_mount(self) -> None:
        """End the app if its terminal is closed, even without a signal: one that is not the session's own, or
        under nohup. Textual would read its end over and over."""
        if self.is_headless or not hasattr(select, "poll"):
            return
        threading.Thread(target=_end_when_hung_up, name="terminal", daemon=True).start()

    def copy_to_clipboard(self, text: str) -> None:
        """Send text to the terminal's clipboard by OSC 52, through tmux too, and report it. It works over
        SSH. A terminal cannot be asked whether it accepts the text."""
        # Textual keeps it for pasting here, and sends the plain sequence.
        super().copy_to_clipboard(text)
        for sequence in clipboard_sequences(text, os.environ):
            write_sequence(self, sequence)
        self.tell(sent_note(text, os.environ))

    def tell(self, text: str) -> None:
        """Show a short message."""
        raise NotImplementedError

    def on_text_selected(self) -> None:
        """Copy marked text of a widget with Textual's own selection, such as the help."""
        text = self.screen.get_selected_text()
        if text:
            self.copy_to_clipboard(text)


def _end_when_hung_up() -> None:
    """Wait until the terminal is closed, and end this process as by a signal."""
    if sys.platform == "win32":
        raise NotImplementedError  # there is no poll
    terminal = select.poll()
    terminal.register(sys.__stdin__.fileno() if sys.__stdin__ is not None else 0, 0)
    for _, events_seen in terminal.poll():
        if events_seen & (select.POLLHUP | select.POLLERR):
            os.kill(os.getpid(), signal.SIGTERM)


# -- the clipboard ---------------------------------------------------------------------------------


def osc52(text: str) -> str:
    """Sequence that puts text into the terminal's clipboard."""
    return f"\x1b]52;c;{b64encode(text.encode('utf-8', 'replace')).decode()}\a"


def clipboard_sequences(text: str, environment: Mapping[str, str]) -> list[str]:
    """Sequences to send beside the plain one.

    With `set-clipboard on` tmux takes the plain one itself, otherwise it drops it. With `allow-passthrough`
    on it passes wrapped sequences on to the terminal (DCS tmux; ... ST, each ESC in it doubled).
    """
    if not environment.get("TMUX"):
        return []
    doubled = osc52(text).replace("\x1b", "\x1b\x1b")
    return [f"\x1bPtmux;{doubled}\x1b\\"]


def sent_note(text: str, environment: Mapping[str, str]) -> str:
    """Note that text was sent, and the setting that may be needed, in one short line; `ALLOWING` has all of
    them."""
    said = f"{counted(len(text), 'character')} sent to the terminal's clipboard"
    # Base64 makes four bytes of three.
    if len(text.encode("utf-8", "replace")) * 4 / 3 > _COMMON_LIMIT:
        return f"{said}; many take only {_COMMON_LIMIT * 3 // 4}"
    return f"{said}; {'tmux: set-clipboard on' if environment.get('TMUX') else 'it must allow OSC 52'}"


# -- what a terminal shows -------------------------------------------------------------------------


class AsciiFilter(LineFilter):
    """Replaces characters that a terminal without UTF-8 cannot show, whatever drew them."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """Segments in ASCII, every character as wide as before."""
        return [Segment(plain_text(text), style, control) for text, style, control in segments]


def plain_text(text: str) -> str:
    """Text in ASCII: lines and blocks as similar signs, any other character as `?`."""
    if text.isascii():
        return text
    return "".join(c if c.isascii() else _REPLACED.get(c, "?" * cell_len(c)) for c in text)
