"""A link to a robot that keeps what goes over it, in a file with one JSON line for each piece."""

from __future__ import annotations

import contextlib
import json
import time
from pathlib import Path

from simmer_tui.links.serial_link import LinkListener, RobotLink


class RecordedLink:
    """A link whose bytes are kept: `{"t": SECONDS, "to": TEXT}` for those to the robot, `from` for those from
    it, one character a byte. `unsent` is what a stop overtook. The first line has the rate, `{"baud": N}`. A
    write that fails ends the record, and nothing else.

    Raises:
        OSError: The file cannot be written.
    """

    def __init__(self, link: RobotLink, path: str, baud: int) -> None:
        self._link = link
        self.name = link.name
        self._begun = time.monotonic()
        # Line by line: what was exchanged is there though the run ends badly.
        self._file = Path(path).expanduser().open("w", encoding="utf-8", buffering=1)
        self._file.write(json.dumps({"baud": baud}) + "\n")
        self._listener: LinkListener | None = None

    def start(self, listener: LinkListener) -> None:
        self._listener = listener
        self._link.start(self)

    def write(self, data: bytes) -> None:
        self._keep("to", data)
        self._link.write(data)

    def write_instead(self, data: bytes) -> list[bytes]:
        dropped = self._link.write_instead(data)
        for each in dropped:
            self._keep("unsent", each)
        self._keep("to", data)
        return dropped

    def close(self) -> None:
        self._link.close()
        with contextlib.suppress(OSError):
            self._file.close()

    def opened(self) -> None:
        """The link is open."""
        if self._listener is not None:
            self._listener.opened()

    def received(self, data: bytes) -> None:
        """Bytes have come from the robot."""
        self._keep("from", data)
        if self._listener is not None:
            self._listener.received(data)

    def lost(self, reason: str) -> None:
        """The link is lost."""
        if self._listener is not None:
            self._listener.lost(reason)

    def _keep(self, side: str, data: bytes) -> None:
        if self._file.closed:
            return
        line = {"t": round(time.monotonic() - self._begun, 4), side: data.decode("latin-1")}
        try:
            self._file.write(json.dumps(line) + "\n")
        except OSError:  # the disk is full; the robot goes on
            with contextlib.suppress(OSError):
                self._file.close()
