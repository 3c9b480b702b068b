"""What the apps here ask of a terminal beyond Textual: keys done in order, and its clipboard."""

from __future__ import annotations

import os
import select
import signal
import sys
import threading
from typing import Protocol, runtime_checkable

from textual import events
from textual.app import App

from simmer_tui.tui.clipboard import clipboard_sequences, sent_note
from simmer_tui.tui.textual_internals import write_sequence


@runtime_checkable
class LineEditor(Protocol):
    """A widget that people type lines into."""

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
    """Who takes pasted text, wherever the focus is."""

    async def on_event(self, event: events.Event) -> None:
        """Take keys and pastes for a line editor here, in the app's own queue."""
        if isinstance(event, events.Key) and not event.is_forwarded:
            focused = self.focused
            if isinstance(focused, LineEditor) and await focused.take_key(event):
                return
        elif isinstance(event, events.Paste) and not event.is_forwarded:
            focused = self.focused
            target = focused if isinstance(focused, LineEditor) else self.paste_target
            if target is not None and len(self.screen_stack) == 1:
                target.take_paste(event.text)
                return
        await super().on_event(event)

    # -- the terminal gone ------------------------------------------------------------------------

    def on_mount(self) -> None:
        """A terminal that goes away is to end the app, even if nobody sends a signal: one that is not the
        session's own, or under nohup. Textual would read its end over and over."""
        if self.is_headless or not hasattr(select, "poll"):
            return
        threading.Thread(target=_end_when_hung_up, name="terminal", daemon=True).start()

    # -- the clipboard ---------------------------------------------------------------------------

    def copy_to_clipboard(self, text: str) -> None:
        """Send text to the terminal's clipboard by OSC 52, through tmux too, and say so. It works over
        SSH; whether the terminal takes it, none can ask."""
        super().copy_to_clipboard(text)  # for pasting here; and the plain sequence
        for sequence in clipboard_sequences(text, os.environ):
            write_sequence(self, sequence)
        self.tell(sent_note(text, os.environ))

    def tell(self, text: str) -> None:
        """Say something in passing."""
        self.notify(text, markup=False)

    def on_text_selected(self) -> None:
        """Text of a widget that has Textual's own selection, such as the help, has been marked."""
        text = self.screen.get_selected_text()
        if text:
            self.copy_to_clipboard(text)


def _end_when_hung_up() -> None:
    """Wait until the terminal has gone, and have this process end as by a signal."""
    terminal = select.poll()
    terminal.register(sys.__stdin__.fileno() if sys.__stdin__ is not None else 0, 0)
    for _, events_seen in terminal.poll():
        if events_seen & (select.POLLHUP | select.POLLERR):
            os.kill(os.getpid(), signal.SIGTERM)
