"""A real robot behind a pty, with a sketch of its own language, in a thread of its own."""

from __future__ import annotations

import contextlib
import os
import select
import threading
import time
import tty

DIALECT = """
[frame]
end = "\\n"
[reply]
end = "\\r\\n"
missing = "-1"
[state]
led = 0
[[command]]
match = "get"
reply = "{u1*cm:.1f},{u2*cm+1.5:.1f} led {led}"
[[command]]
match = "f {n}"
do = "d1-{n}"
done = "ok"
[[command]]
match = "b {n}"
do = "d1-{-n}"
done = "ok"
[[command]]
match = "t {n:int}"
do = "r1-{-n}"
done = "ok"
[[command]]
match = "go {way:left=0|right=1} {ms:int=500}"
do = "run {pick(way, 'w1', '-w1')} for {ms/1000} s"
[[command]]
match = "w"
do = "run d1"
[[command]]
match = "light"
do = "led = 1 - led"
[[command]]
match = "x"
do = "stop"
"""
"""Its language. What it answers is below; it says `hm` to what it does not know."""


class SketchRobot:
    """The robot. Its movements take no time; it has sensors that always read the same.

    Args:
        silent: the messages it does not answer.
    """

    def __init__(self, silent: frozenset[str] = frozenset()) -> None:
        self._silent = silent
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.name = os.ttyname(self._slave)
        self.bytes = bytearray()
        """All that it was sent."""
        self.times: list[tuple[float, str]] = []
        """When each message came."""
        self.changed = threading.Condition()
        self._ending, self._wake = os.pipe()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def lines(self) -> list[str]:
        """The messages that it was sent."""
        return self.bytes.decode("latin-1").splitlines()

    def close(self) -> None:
        """End it."""
        os.close(self._wake)
        self._thread.join(60)
        for each in (self._master, self._slave, self._ending):
            os.close(each)

    def wait_for(self, *lines: str) -> None:
        """Wait until these are the messages that it was sent."""
        with self.changed:
            assert self.changed.wait_for(lambda: self.lines == [*lines], 20), self.lines

    def say(self, data: bytes) -> None:
        """Send bytes unasked."""
        os.write(self._master, data)

    def _run(self) -> None:
        rest = b""
        while True:
            ready, _, _ = select.select([self._master, self._ending], [], [])
            if self._ending in ready:
                return
            with contextlib.suppress(OSError):
                data = os.read(self._master, 4096)
                *whole, rest = (rest + data).split(b"\n")
                with self.changed:
                    self.bytes += data
                    self.times += [(time.monotonic(), line.decode("latin-1")) for line in whole]
                    self.changed.notify_all()
                for line in whole:
                    self._answer(line.decode("latin-1"))

    def _answer(self, line: str) -> None:
        word = line.split(" ")[0]
        if word in self._silent:
            return
        answers = {"get": "25.4,14.2 led 0", "f": "ok", "b": "ok", "t": "ok"}
        quiet = ("go", "w", "light", "x")
        if word not in quiet:
            self.say(answers.get(word, "hm").encode() + b"\r\n")
