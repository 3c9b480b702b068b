"""Base of the apps: what Textual does not do with a terminal. Keys in order, its clipboard, plain ASCII
where it has no more, and no frames while it does not read."""

import os
import select
import signal
import sys
import threading
from base64 import b64encode
from collections.abc import Mapping
from contextlib import ExitStack
from typing import Protocol, runtime_checkable

from rich.cells import cell_len
from rich.segment import Segment
from textual import events
from textual.app import App
from textual.color import Color
from textual.filter import LineFilter

from simmer_tui.tui.textual_internals import write_sequence, writes_waiting

# As many bytes of base64 as xterm takes, and many others after it.
_COMMON_LIMIT = 74_994
ALLOWING = (
    ("tmux", "set -g set-clipboard on, or set -g allow-passthrough on"),
    ("terminal", "allow OSC 52 (access to the clipboard) in its settings"),
)
"""Settings with which copied text arrives."""
# One is on its way whenever something has just been drawn.
_WAITING = 2
"""Writes not yet taken by the terminal at which it counts as behind."""
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
class LineEditor(Protocol):
    """Widget that people type lines into."""

    async def take_key(self, event: events.Key) -> bool:
        """Do what a key says, wholly, before this returns; False if it means nothing here."""
        ...

    def take_paste(self, text: str) -> None:
        """Take pasted text, wholly, before this returns."""
        ...


class TerminalApp(App[int]):
    """Does what a key says before it looks at the next one.

    Textual passes a key to the queue of the widget with the focus, and one that the widget's own code
    does not take from there on and on to the app, which looks for a binding. Of keys that come at once
    (typed ahead, sent by tmux, by a slow link) letters then overtake an Enter or an Escape in front of
    them: lines run together, and letters of a command drive the robot.
    """

    paste_target: LineEditor | None = None
    """Receiver of pasted text, wherever the focus is."""

    async def on_event(self, event: events.Event) -> None:
        """Take keys and pastes for a line editor here, in the app's own queue."""
        if isinstance(event, events.Key | events.Paste) and not event.is_forwarded:
            # Textual would give the focus back only with this key, which then reaches nobody: in a browser
            # the app begins without it.
            self.app_focus = True
            editor = self.focused if isinstance(self.focused, LineEditor) else None
            if isinstance(event, events.Key):
                if editor is not None and await editor.take_key(event):
                    return
            elif (target := editor or self.paste_target) is not None and len(self.screen_stack) == 1:
                target.take_paste(event.text)
                return
        await super().on_event(event)

    def on_mount(self) -> None:
        """A terminal that goes away is to end the app, even if nobody sends a signal: one that is not the
        session's own, or under nohup. Textual would read its end over and over."""
        if self.is_headless or not hasattr(select, "poll"):
            return
        threading.Thread(target=_end_when_hung_up, name="terminal", daemon=True).start()

    def copy_to_clipboard(self, text: str) -> None:
        """Send text to the terminal's clipboard by OSC 52, through tmux too, and say so. It works over
        SSH; whether the terminal takes it, none can ask."""
        # Textual keeps it for pasting here, and sends the plain sequence.
        super().copy_to_clipboard(text)
        for sequence in clipboard_sequences(text, os.environ):
            write_sequence(self, sequence)
        self.tell(sent_note(text, os.environ))

    def tell(self, text: str) -> None:
        """Say something in passing."""
        raise NotImplementedError

    def on_text_selected(self) -> None:
        """Text of a widget that has Textual's own selection, such as the help, has been marked."""
        text = self.screen.get_selected_text()
        if text:
            self.copy_to_clipboard(text)


def _end_when_hung_up() -> None:
    """Wait until the terminal has gone, and have this process end as by a signal."""
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

    tmux takes the plain one itself with `set-clipboard on`. Else it drops it, but passes on to the
    terminal what is wrapped so (DCS tmux; ... ST, each ESC in it doubled), if `allow-passthrough` is on.
    """
    if not environment.get("TMUX"):
        return []
    doubled = osc52(text).replace("\x1b", "\x1b\x1b")
    return [f"\x1bPtmux;{doubled}\x1b\\"]


def sent_note(text: str, environment: Mapping[str, str]) -> str:
    """Note that text was sent, and what has to be allowed where it may be refused, in one short line;
    `ALLOWING` says how."""
    count = len(text)
    said = f"{count} character{'s' * (count != 1)} sent to the terminal's clipboard"
    # Base64 makes four bytes of three.
    if len(text.encode("utf-8", "replace")) * 4 / 3 > _COMMON_LIMIT:
        return f"{said}; many take only {_COMMON_LIMIT * 3 // 4}"
    return f"{said}; {'tmux: set-clipboard on' if environment.get('TMUX') else 'it must allow OSC 52'}"


# -- what a terminal shows -------------------------------------------------------------------------


class AsciiFilter(LineFilter):
    """Replaces what a terminal without UTF-8 cannot show, whoever drew it."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """Segments in ASCII, every character as wide as before."""
        return [Segment(plain_text(text), style, control) for text, style, control in segments]


def plain_text(text: str) -> str:
    """Text in ASCII: lines and blocks as signs that resemble them, anything else as `?`."""
    if text.isascii():
        return text
    return "".join(c if c.isascii() else _REPLACED.get(c, "?" * cell_len(c)) for c in text)


class Backpressure:
    """Open while the terminal keeps up; closed, nothing is drawn, whatever asks for it.

    A terminal may not read for a while (ctrl+S, a dead connection). Textual writes from a thread with a
    queue of 30 writes; a 31st blocks the whole app until the terminal reads again. So nothing is sent while
    writes wait; Textual keeps what is to be drawn, but for changes of the layout, after which the whole
    screen is sent.
    """

    def __init__(self, app: App[int]) -> None:
        self._app = app
        self._batch = ExitStack()
        self._lost = False
        self.closed = False

    def keep_up(self) -> bool:
        """Open or close it by how far the terminal is behind. Returns true if it is open."""
        behind = writes_waiting(self._app) >= (1 if self.closed else _WAITING)
        if behind and not self.closed:
            self._batch.enter_context(self._app.batch_update())
        elif self.closed and not behind:
            self._batch.close()
            if self._lost:
                self._app.screen.refresh(layout=True)
            self._app.screen.check_idle()
            self._lost = False
        self.closed = behind
        return not behind

    def note_display(self) -> None:
        """Take note that something was displayed, or would have been."""
        self._lost |= self.closed
