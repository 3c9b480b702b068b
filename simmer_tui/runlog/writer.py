"""Writes a run log while the run goes on."""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import IO

import platformdirs

from simmer_tui.config.loader import Configuration
from simmer_tui.engine import ActionDone, Belief, Event, Notice, TwinReading
from simmer_tui.errors import RunLogError
from simmer_tui.runlog.header import header_line
from simmer_tui.runlog.lines import action_line, belief_line, command_line, notice_line, twin_line
from simmer_tui.sim.command import escape
from simmer_tui.sim.records import Outcome
from simmer_tui.sim.simulator import Simulator

AUTO = "auto"
"""In place of a file: one named by date in the user's data folder."""


def auto_path(now: datetime | None = None) -> Path:
    """A file that does not exist yet, named by date, in the user's data folder, which is made.

    Raises RunLogError if the folder cannot be made.
    """
    folder = platformdirs.user_data_path("simmer-tui", appauthor=False) / "logs"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunLogError(f"{escape(str(folder), 200)} cannot be made: {error.strerror or error}") from None
    name = f"{now or datetime.now():%Y-%m-%d_%H-%M-%S}"
    path, copy = folder / f"{name}.jsonl", 1
    while path.exists():
        copy += 1
        path = folder / f"{name}_{copy}.jsonl"
    return path


class RunLog:
    """A watcher that appends each event to a file, with one write a line and nothing held back.

    Make it and let it be called in the robot's thread, since it asks the simulator for the time.
    When a write fails the run goes on: `stopped` says why, `on_stop` is told once, and what comes
    after is not logged.
    """

    def __init__(
        self,
        path: Path,
        configuration: Configuration,
        simulator: Simulator,
        *,
        on_stop: Callable[[str], None] = lambda why: None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        """Write the header. An existing file is never overwritten. Raises RunLogError."""
        self.path = path
        self.stopped = ""
        """Why nothing is written any more, or empty."""
        self.lines = 0
        """Lines written, the header included."""
        self._simulator = simulator
        self._on_stop: Callable[[str], None] = lambda why: None
        self._clock = clock
        shown = escape(str(path), 200)
        try:
            self._file = _opened(path)
        except OSError as error:
            raise RunLogError(f"cannot log to {shown}: {error.strerror or error}") from None
        except ValueError as error:  # a NUL in the name
            raise RunLogError(f"cannot log to {shown}: {error}") from None
        now = datetime.fromtimestamp(clock()).astimezone()
        self._write(header_line(configuration, simulator, now))
        if self.stopped:
            raise RunLogError(self.stopped)
        self._on_stop = on_stop

    def __call__(self, event: Event) -> None:
        """Append one event."""
        if self.stopped:
            return
        wall = self._clock()
        match event:
            case Outcome():
                self._write(command_line(event, wall))
            case Belief():
                self._write(belief_line(event, wall))
            case ActionDone():
                self._write(action_line(event, self._simulator.commands, wall))
            case TwinReading():
                self._write(twin_line(event, wall))
            case Notice():
                self._write(notice_line(event, self._simulator.time, wall))

    def close(self) -> None:
        """Write no more. May be called more than once."""
        self.stopped = self.stopped or "the log is closed"
        self._file.close()

    def __enter__(self) -> RunLog:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _write(self, text: str) -> None:
        data = f"{text}\n".encode()
        try:
            written = self._file.write(data)
            if written != len(data):  # the disk took a part: the next write says why it took no more
                self._file.write(data[written:])
                raise OSError("only a part of the last line could be written")
        except OSError as error:
            self._file.close()
            reason = error.strerror or str(error)
            self.stopped = f"logging to {escape(str(self.path), 200)} has stopped: {reason}"
            self._on_stop(self.stopped)
            return
        self.lines += 1


def _opened(path: Path) -> IO[bytes]:
    """The file, new or empty, or something that is no plain file (a pipe), without a buffer."""
    try:
        return path.open("xb", buffering=0)
    except FileExistsError:
        if path.is_file() and path.stat().st_size > 0:
            raise FileExistsError(
                0, "it exists already and is not overwritten; name another file, or auto"
            ) from None
        return path.open("ab", buffering=0)
