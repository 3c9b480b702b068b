"""Holds the screen back while the terminal does not read (ctrl+S, a dead connection).

Textual writes from a thread with a queue of 30 writes; a 31st blocks the whole app until the
terminal reads again. So nothing is sent while writes wait; Textual keeps what is to be drawn, but for
changes of the layout, after which the whole screen is sent.
"""

from __future__ import annotations

from contextlib import ExitStack

from textual.app import App

from simmer_tui.tui.textual_internals import writes_waiting

_WAITING = 2
"""Writes not yet taken by the terminal at which it counts as behind."""


class Backpressure:
    """Open while the terminal keeps up; closed, nothing is drawn, whatever asks for it."""

    def __init__(self, app: App[int]) -> None:
        self._app = app
        self._batch = ExitStack()
        self._lost = False
        self.closed = False

    def keep_up(self) -> bool:
        """Open or close it by how far the terminal is behind; returns whether it is open."""
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
        """Something was displayed, or would have been."""
        self._lost |= self.closed
