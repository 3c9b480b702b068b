"""A rerun of the boards of a logged run: their sketches get the laptop's bytes from the log."""

from __future__ import annotations

import re
from collections import deque
from pathlib import Path

from msgspec.structs import replace

from simmer_tui.config.settings import BITS_OF_A_BYTE
from simmer_tui.errors import RunLogError
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import ActionDone, CommandResult, Event, Notice, NoticeKind, WireMessage
from simmer_tui.run.phrases import is_of_boards
from simmer_tui.runlog.closing import Closing
from simmer_tui.runlog.header import rebuild
from simmer_tui.runlog.log_records import BrokenLine, NoticeRecord
from simmer_tui.runlog.reader import LogReader
from simmer_tui.runlog.rerun import set_up_simulator
from simmer_tui.sim.command import cut
from simmer_tui.sim.simulator import Simulator
from simmer_tui.sketch.parts import SECOND
from simmer_tui.sketch.sketch_robot import SketchRobot, compile_set, logged_sketches, with_boards
from simmer_tui.sketch.wiring import wiring_of

# What happens at the very end is there once the board has passed it: no call of a sketch that sets a pin
# takes longer.
_AFTER = 0.001
"""Simulated seconds that the boards run beyond the last event of the log."""


class BoardRerun(Closing):
    """Boards that are run again beside a log."""

    def __init__(self, path: Path, folder: Path) -> None:
        """`folder` has the sketches of the run. Raises RunLogError, ConfigurationError."""
        log = LogReader(path)
        self._log = log
        self._shown = log.shown
        try:
            header = log.header
            if not header.sketches or header.number:
                raise RunLogError(f"{self._shown}: no boards ran from its beginning on")
            configuration = replace(rebuild(header), directory=folder)
            wiring = wiring_of(configuration)
            if wiring is None:
                raise RunLogError(f"{self._shown}: its set has no wiring.toml")
            sketches = compile_set(wiring, folder)
            here = logged_sketches(sketches)
            changed = [name for name, sketch in header.sketches.items() if here.get(name) != sketch]
            if changed:
                names = cut(", ".join(changed))
                raise RunLogError(f"{self._shown}: the sketch of {names} in {folder} is not that of the run")
            simulator = Simulator(with_boards(configuration).simulation, header.seed)
            simulator.noise = header.noise
            set_up_simulator(simulator, header)
        except BaseException:
            log.close()
            raise
        self._instant = configuration.settings.server.line == "instant"
        self._engine = Engine(simulator, timed=True)
        self._made: list[tuple[float, str, str]] = []
        self._engine.watch(self._take)
        self._robot = SketchRobot(sketches, self._engine)
        self._baud = self._free = 0
        with LogReader(path) as again:
            self._connected = deque(
                record.t
                for _, record in again.lines()
                if isinstance(record, NoticeRecord) and record.about is NoticeKind.CONNECTED
            )
        """The times at which programs have opened the port: a notice itself has none."""

    def close(self) -> None:
        """End the boards, and close the log."""
        self._robot.close()
        self._log.close()

    def difference(self) -> str:
        """Run the boards. Returns the first difference from the log; empty if there is none."""
        said: list[tuple[float, str, str]] = []
        last = 0.0
        for logged in self._log:
            if isinstance(logged, BrokenLine):
                raise RunLogError(f"{self._shown}: {logged}")
            event = logged.event
            self._repeat(event)
            fact = _fact(event)
            if fact is not None:
                said.append(fact)
            last = max(last, getattr(event, "time", 0.0))
        self._run_to(last + _AFTER)
        for logged_fact, made in zip(said, self._made, strict=False):
            if logged_fact != made:
                return f"{self._shown}: the log has {_words(logged_fact)}, the boards now make {_words(made)}"
        # What comes at the very end may be later than the last line of the log.
        if len(self._made) < len(said):
            return f"{self._shown}: the log has {_words(said[len(self._made)])}, the boards now make nothing"
        return ""

    @property
    def count(self) -> int:
        """Facts of the boards so far: lines sent, duties, readings."""
        return len(self._made)

    def _take(self, event: Event) -> None:
        fact = _fact(event)
        if fact is not None:
            self._made.append(fact)

    def _run_to(self, time: float) -> None:
        while self._robot.run_to(time) < time:
            pass

    def _repeat(self, event: Event) -> None:
        """Do to the boards what others did in the run: bytes of the laptop, actions of people."""
        if isinstance(event, Notice) and event.kind is NoticeKind.CONNECTED:
            found = re.search(r" at (\d+) baud", event.text)
            self._baud = int(found[1]) if found else 0
            self._run_to(self._connected.popleft())
            self._robot.reset_by_usb()
        elif isinstance(event, ActionDone):
            self._run_to(event.time)
            self._engine.perform(event.action)
            self._free = 0
        elif isinstance(event, WireMessage) and not event.reply:
            self._run_to(event.time)
            board_baud = self._robot.laptop_baud
            baud = board_baud if self._instant or not (board_baud and self._baud) else self._baud
            byte = 0 if self._instant else BITS_OF_A_BYTE * SECOND // (baud or board_baud or 9600)
            at = max(self._free, round(event.time * SECOND))
            for value in event.data.encode("latin-1"):
                at += byte
                self._robot.receive(at, value, baud or board_baud or 9600)
            self._free = at


def _fact(event: Event) -> tuple[float, str, str] | None:
    """A fact that boards have made: its time, its text and its value. None for other events."""
    if isinstance(event, WireMessage) and event.reply and not event.port:
        return event.time, "line", event.data
    if isinstance(event, CommandResult) and is_of_boards(event.command.source):
        return event.time, event.command.text, repr(event.reply)
    return None


def _words(fact: tuple[float, str, str]) -> str:
    time, text, value = fact
    return f"{cut(text)} {cut(value)!r} at {time:.9f} s"
