"""The end of a run: by the signals that ask for it, in good order, and in time whatever sticks."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from types import FrameType

from simmer_tui.program import Program
from simmer_tui.server import Server

_PROGRAM, _SERVER, _EXIT = 0.4, 1.4, 1.8
"""When the program, the server and the process are ended after a signal, in seconds, if the main thread
has not come to it. It cannot while it writes to a terminal, or a pipe, that takes nothing."""


class Shutdown:
    """Ends the program beside a run, and then its server with a complete log: once, by whichever
    thread comes first."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._lock = threading.Lock()
        self._done = False
        self.program: Program | None = None
        """The program of the run, once it has been started."""

    def on_signals(self, interrupted: Callable[[int], int]) -> None:
        """From here on, the signals that ask a run to end do so. `interrupted` is called in the main
        thread with the signal's number, sees to it that the main thread ends the run, and gives the
        exit code. If the main thread is stuck, the run ends all the same, within 2 s."""

        def handle(number: int, frame: FrameType | None) -> None:
            code = interrupted(number)
            threading.Thread(target=self._insist, args=(code,), name="insist", daemon=True).start()

        for number in _end_signals():
            signal.signal(number, handle)

    def finish(self, grace: float = 0.0) -> None:
        """End everything, or wait until it has ended. The program may go on for `grace` seconds."""
        with self._lock:
            if self._done:
                return
            self._done = True
            if self.program is not None:
                self.program.end(grace)
            self._server.stop()

    def _insist(self, code: int) -> None:
        begun = time.monotonic()
        for when, end in ((_PROGRAM, self.end_program), (_SERVER, self.finish), (_EXIT, None)):
            threading.Event().wait(max(begun + when - time.monotonic(), 0.0))
            if end is not None:
                threading.Thread(target=end, name="end", daemon=True).start()
        os._exit(code)  # whatever a program had left running its keeper ends

    def end_program(self) -> None:
        """End the program, with all that it has started."""
        if self.program is not None:
            self.program.end()


def _end_signals() -> list[int]:
    """The signals that ask a run to end, without those that are ignored (by nohup, say)."""
    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
    known = [int(getattr(signal, name)) for name in names if hasattr(signal, name)]
    return [number for number in known if signal.getsignal(number) is not signal.SIG_IGN]
