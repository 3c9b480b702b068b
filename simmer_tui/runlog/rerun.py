"""Runs a logged run again and compares every reply: the proof that a run can be repeated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType

from simmer_tui import actions
from simmer_tui.actions import Action
from simmer_tui.errors import RunLogError, SimmerError
from simmer_tui.runlog.entries import ActionEntry, BrokenEntry, CommandEntry, Entry
from simmer_tui.runlog.header import Header, rebuild
from simmer_tui.runlog.reader import LogReader
from simmer_tui.sim.command import parse_command
from simmer_tui.sim.records import Outcome, Pose, Status
from simmer_tui.sim.simulator import Simulator


@dataclass(frozen=True, slots=True)
class Difference:
    """The first place where a run comes out differently now."""

    line: int
    what: str
    name: str
    logged: str
    now: str

    def __str__(self) -> str:
        return f"line {self.line}, {self.what}: {self.name} is {self.logged} in the log and {self.now} now"


class _DifferenceError(Exception):
    """Ends a rerun at its first difference."""

    def __init__(self, difference: Difference) -> None:
        self.difference = difference


class _CutError(Exception):
    """The log ends while a movement is under way whose command it therefore does not hold."""


class Rerun:
    """One run done again, entry by entry, on a simulator of its own.

    Commands are begun in the order of their numbers. A movement in real time is logged when it
    ends, so what was begun before a line may stand further down: `ahead` is a second reader that
    goes and finds it.
    """

    def __init__(self, path: Path) -> None:
        """Open a log and build its robot anew. Raises RunLogError, ConfigurationError."""
        self._log = LogReader(path)
        self._ahead: LogReader | None = None
        self.commands = 0
        self.actions = 0
        self.difference: Difference | None = None
        """The first, once it has been found."""
        self.notes: list[str] = []
        """What to know besides."""
        header = self.header = self._log.header
        try:
            self._simulator = self._robot(header)
        except SimmerError:
            self.close()
            raise
        self._movement: tuple[CommandEntry, Outcome] | None = None
        """The movement begun last, as logged and as begun here, until its end is compared."""
        self._comparing = header.number == 0

    @property
    def size(self) -> int:
        """Bytes of the log."""
        return self._log.size

    def _robot(self, header: Header) -> Simulator:
        if not header.simulated:
            raise RunLogError(f"{self._log.shown} is the log of a real robot, which cannot be run again")
        simulator = Simulator(rebuild(header).simulation, header.seed)
        simulator.noise = header.noise
        if header.number == 0:
            _set_up(simulator, header)
        return simulator

    def steps(self) -> Iterator[int]:
        """Do it, pausing after each line with the number of bytes read so far.

        Ends at the first difference. Raises RunLogError for a broken line, or if the log gives
        nothing to compare.
        """
        try:
            for entry in self._log:
                if isinstance(entry, BrokenEntry):
                    raise RunLogError(f"{self._log.shown}: {entry}")
                if not self._comparing:
                    self._wait_for_restart(entry)
                if self._comparing:
                    self._take(entry)
                yield self._log.position
        except _DifferenceError as differs:
            self.difference = differs.difference
            return
        except _CutError as cut:
            self.notes.append(str(cut))
        if not self._comparing:
            raise RunLogError(
                f"{self._log.shown} begins after {self.header.number} commands and holds no reset, so its "
                "beginning is not known; log from the start, with --log"
            )
        if self._log.note:
            self.notes.append(self._log.note)

    def _wait_for_restart(self, entry: Entry) -> None:
        """A log that began in the middle of a run: all is known again from a reset on."""
        if isinstance(entry, ActionEntry) and entry.restarts:
            self._comparing = True
            before = self.header.number
            self.notes.append(
                f"the log begins after {before} commands; compared from the {entry.action} in line "
                f"{entry.line} on"
            )

    def _take(self, entry: Entry) -> None:
        if isinstance(entry, ActionEntry):
            if not entry.restarts:
                self._begin_up_to(entry.number, entry)
            self._act(entry)
        elif isinstance(entry, CommandEntry):
            self._command(entry)

    # -- actions ---------------------------------------------------------------------------------

    def _act(self, entry: ActionEntry) -> None:
        simulator = self._simulator
        if not entry.restarts:
            simulator.advance(entry.t)
        refused = False
        try:
            actions.apply(simulator, Action(entry.action, entry.arguments))
        except SimmerError:
            refused = True
        what = f"action {entry.action}"
        _compare(entry.line, what, "refused", entry.refused, refused)
        _compare(entry.line, what, "pose", entry.pose, simulator.pose)
        self.actions += 1

    # -- commands --------------------------------------------------------------------------------

    def _command(self, entry: CommandEntry) -> None:
        simulator = self._simulator
        if entry.status is Status.STOPPED:
            self._begin_up_to(entry.number - 1, entry)
            simulator.advance(entry.t)
            simulator.stop()
            simulator.commands = entry.number
            _compare(entry.line, f"command {entry.shown!r}", "pose", entry.pose, simulator.pose)
            self.commands += 1
            return
        if entry.number > simulator.commands:
            self._begin_up_to(entry.number - 1, entry)
            self._begin(entry)
        if entry.status is Status.DONE:
            self._end(entry)

    def _begin_up_to(self, number: int, entry: Entry) -> None:
        """Begin what was begun before `entry` but is logged after it."""
        while self._simulator.commands < number:
            self._begin(self._find(self._simulator.commands + 1, entry.line))

    def _begin(self, entry: CommandEntry) -> None:
        """Begin a command at its time, and compare what is known of it at once."""
        simulator = self._simulator
        simulator.advance(entry.started)
        command = parse_command(entry.command, entry.source)
        if entry.status in (Status.REFUSED, Status.UNKNOWN):  # by rules of a dialect the log does not name
            command = replace(command, problem=entry.reason)
        outcome = simulator.begin(command)
        what = f"command {entry.shown!r}"
        now = Status.DONE if entry.status is Status.DONE and outcome.trajectory else outcome.status
        now = entry.status if command.problem and now is Status.REFUSED else now
        _compare(entry.line, what, "verdict", entry.status.value, now.value)
        _compare(entry.line, what, "number", entry.number, outcome.number)
        _compare(entry.line, what, "before", entry.before, outcome.before)
        _compare(entry.line, what, "reply", entry.reply, outcome.reply)
        if outcome.reading is not None:
            _compare(entry.line, what, "true", entry.true, outcome.reading.true)
        if outcome.grip is not None and entry.grip is not None:
            _compare(entry.line, what, "holding", entry.grip.holding, outcome.grip.holding)
            _compare(entry.line, what, "block", entry.grip.block, outcome.grip.block)
        if entry.status is Status.DONE:
            self._movement = entry, outcome
        else:
            _compare(entry.line, what, "pose", entry.pose, outcome.pose)
        self.commands += 1

    def _end(self, entry: CommandEntry) -> None:
        """Bring the movement to the end it had, and compare where it ended."""
        simulator = self._simulator
        what = f"command {entry.shown!r}"
        if self._movement is None or self._movement[0].number != entry.number:
            raise RunLogError(
                f"{self._log.shown}: line {entry.line} is out of order: command number {entry.number}"
            )
        begun = self._movement[1]
        self._movement = None
        if entry.cut:
            simulator.advance(entry.end)
            simulator.stop()
        outcome = simulator.finish(begun)
        contact = outcome.contact.point if outcome.contact is not None else None
        _compare(entry.line, what, "t", entry.t, outcome.time)
        _compare(entry.line, what, "contact", entry.contact, contact)
        _compare(entry.line, what, "pose", entry.pose, outcome.pose)

    def _find(self, number: int, line: int) -> CommandEntry:
        """The command of a number that is logged after a line. Raises _CutError if the log ends before
        it, RunLogError if it should be there."""
        if self._ahead is None:
            self._ahead = LogReader(self._log.path)
        for entry in self._ahead:
            if isinstance(entry, BrokenEntry):
                raise RunLogError(f"{self._log.shown}: {entry}")
            if entry.line <= line or not isinstance(entry, CommandEntry):
                continue
            if entry.number == number:
                return entry
            if entry.moved:
                break
        else:
            raise _CutError(
                f"the log ends before command number {number} does; compared up to line {line - 1}"
            )
        raise RunLogError(
            f"{self._log.shown}: command number {number} is missing between lines {line} and {entry.line}"
        )

    def __enter__(self) -> Rerun:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._log.close()
        if self._ahead is not None:
            self._ahead.close()


def _set_up(simulator: Simulator, header: Header) -> None:
    """What a person changed before the log began, but after the start."""
    simulator.advance(header.t)
    simulator.set_bias(dict(header.bias))
    if (simulator.block.x, simulator.block.y) != (header.block.x, header.block.y):
        simulator.move_block(header.block.x, header.block.y)
    if simulator.pose != header.pose:
        simulator.teleport(header.pose)


def _compare(line: int, what: str, name: str, logged: object, now: object) -> None:
    """Raises _DifferenceError unless two values are the same to the last bit."""
    before, after = _text(logged), _text(now)
    if before != after:
        raise _DifferenceError(Difference(line, what, name, before, after))


def _text(value: object) -> str:
    """A value as text that differs whenever the value does; -0.0 and 0.0 too, NaN not from itself."""
    match value:
        case Pose():
            return _text((value.x, value.y, value.heading))
        case tuple():
            return f"({', '.join(_text(item) for item in value)})"
        case bool():
            return str(value).lower()
        case float():
            return repr(float(value))
    return str(value)
