"""A log read once: the figures of a report, and the commands as a table for spreadsheets."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import TextIO

from msgspec.structs import replace

from simmer_tui.config.loader import Configuration
from simmer_tui.config.nominal import nominal_of
from simmer_tui.document.as_data import CsvWriter
from simmer_tui.document.formats import POSE, Format
from simmer_tui.document.model import DataColumn
from simmer_tui.report.bent_scans import BentScans
from simmer_tui.report.causes import Cause
from simmer_tui.report.finding import Finding
from simmer_tui.report.mission_gate import Analysis
from simmer_tui.report.recording import Recording
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.report.verdict import Verdict, findings_of, verdict_of
from simmer_tui.run.attempt import Attempt, Task, task_of
from simmer_tui.run.events import ActionName, CommandResult, EventHandler, MovementEnded
from simmer_tui.run.paths import PathRecord
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.run_history import RunHistory, Totals
from simmer_tui.run.state import MissionProgress
from simmer_tui.run.table import First
from simmer_tui.runlog.header import Header
from simmer_tui.runlog.log_records import BrokenLine
from simmer_tui.runlog.reader import Logged, LoggedReadings, LogReader
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import Status


@dataclass(eq=False)
class RunStatistics:
    """The figures of a run: `add` the events of a log in order, call `finish`, then read them.

    `recorded` is true to keep the data of a player, too. `nominal` is the set that the run's own is compared
    with; by default the one that it was made from.
    """

    header: Header
    configuration: Configuration
    _: KW_ONLY
    recorded: bool = True
    nominal: str | None = None

    def __post_init__(self) -> None:
        header, configuration = self.header, self.configuration
        checkpoint = header.checkpoint(configuration)
        # Not every header says that a mission is under way; the configuration always has the mission.
        if configuration.mission is not None:
            checkpoint = replace(checkpoint, mission=checkpoint.mission or MissionProgress())
        self.paths = PathRecord(configuration.simulation.maze, header.pose, recorded=self.recorded)
        # A missing set is reported at once, before the log is read.
        found = nominal_of(configuration, self.nominal)
        self.history = RunHistory(
            checkpoint,
            log_begins=header.t,
            counters_known=header.number == 0,
            paths=self.paths,
            nominal=lambda: found,
        )
        self.history.is_twin = not header.simulated
        self.reducer = Reducer(checkpoint)
        self._analysis = Analysis(self.reducer, self.history)
        self.bent = BentScans(Maze(configuration.simulation.maze))
        """The scans of lidars that were taken while the robot moved."""
        self.broken: First[BrokenLine] = First(20)
        self.notes: list[str] = []
        self.findings: tuple[Finding, ...] = ()
        """Sensors and drives that are not as they should be; after `finish`."""
        self.real_seconds = 0.0

    def add(self, block: Iterable[Logged | LoggedReadings | BrokenLine]) -> None:
        """Add the next events and broken lines."""
        apply, apply_readings = self._analysis.apply, self._analysis.apply_readings
        latest = self.header.real_time + self.real_seconds
        for logged in block:
            # Types are compared: a log has millions of events.
            if type(logged) is LoggedReadings:
                latest = max(latest, *logged.real_times)
                apply_readings(logged.results, logged.lines, logged.real_times)
                continue
            if type(logged) is BrokenLine:
                self.broken.add(logged)
                continue
            event, real_time = logged.event, logged.real_time
            latest = max(latest, real_time)
            apply(event, logged.line, real_time)
            reading = event.reading if type(event) is CommandResult else None
            if reading is not None and reading.scan is not None:
                self.bent.add(reading.sensor, reading.scan, self.reducer.block_place)
        self.real_seconds = latest - self.header.real_time

    @property
    def elapsed(self) -> float:
        """Simulated seconds since the log began, those after the mission's end included."""
        return self._analysis.elapsed

    def finish(self, note: str = "") -> None:
        """End of the log; `note` is the reader's message about it."""
        self.paths.stand(self.history.elapsed)
        self.findings = findings_of(self.history, self.task)
        self.notes += filter(None, (note, self._analysis.gate.note, *self._origin()))
        if not self.reducer.still:
            self.notes.append("the log ends while a movement is under way; how it ended is not known")
        self.notes += [f"{broken}, and was skipped" for broken in self.broken.items]
        if self.broken.more:
            self.notes.append(f"{self.broken.more} more broken lines were skipped")

    def _origin(self) -> Iterator[str]:
        """Notes on another run that this one was taken over from, and on a seed that a person chose."""
        if self.header.taken_over is not None:
            yield f"taken over {self.header.taken_over}: until then the two runs are the same"
        done = (row for row in self.history.actions.items if row.done.action.name is ActionName.SEED)
        changed = [row for row in done if not row.done.refused]
        if changed and changed[-1].done.action.arguments[0] != self.header.seed:
            seed = int(changed[-1].done.action.arguments[0])
            yield f"from {changed[-1].elapsed:.1f} s on the seed was {seed}"

    @cached_property
    def task(self) -> Task | None:
        """Mission of the run; None without one that has begun; after the last event."""
        return self.attempt.task

    @cached_property
    def attempt(self) -> Attempt:
        """The run since its last restart, after the last event."""
        return Attempt(self.history, task_of(self.configuration, self.header.seed))

    @cached_property
    def evidence(self) -> RunEvidence:
        """Facts about the run, for its tables; after `finish`."""
        return RunEvidence(self.attempt, self.verdict.program, findings=self.findings)

    @cached_property
    def verdict(self) -> Verdict:
        """Outcome of the run, and its cause; after `finish`."""
        return verdict_of(self.history, self.task, findings=self.findings)

    @property
    def failed(self) -> bool:
        """True for a failed run, as in trials; after `finish`."""
        return self.verdict.has_failed

    @property
    def cause(self) -> Cause | None:
        """Cause of the run's failure, None if it did not fail; after `finish`."""
        return self.verdict.cause

    @cached_property
    def recording(self) -> Recording:
        """Contents of the player; after `finish`."""
        assert self.recorded, "nothing was recorded"
        return Recording(self.history, self.paths)

    @property
    def pose(self) -> Pose:
        """Pose of the robot."""
        return self.reducer.pose_at(self.reducer.time)

    @property
    def totals(self) -> Totals:
        """Sums over the whole run."""
        return self.history.totals


def report_of(log: LogReader, *, recorded: bool = True) -> RunStatistics:
    """The figures of a log that is read to its end, with the data of a player if they are `recorded`."""
    run = RunStatistics(log.header, log.configuration, recorded=recorded)
    for block in log.blocks():
        run.add(block)
    run.finish(log.note)
    return run


_PLACE = Format(str, ("_x_in", "_y_in"), tuple)
COMMAND_COLUMNS = (
    *map(DataColumn, ("line", "time_s", "elapsed_s", "real_time_s", "number", "source", "command", "status")),
    *map(DataColumn, ("reply", "sensor", "true")),
    *(DataColumn("before", POSE), DataColumn("after", POSE), DataColumn("contact", _PLACE)),
    DataColumn("text", heading="why"),
)


class CommandTable(EventHandler[None]):
    """A row a command. Infinities and NaN are inf, -inf and nan; values that do not apply are blank."""

    def __init__(self, file: TextIO) -> None:
        self._writer = CsvWriter(file, COMMAND_COLUMNS)
        self._ended: MovementEnded | None = None
        self._accepted: set[int] = set()
        self._unanswered: dict[int, tuple[Logged, float, MovementEnded]] = {}

    def add(self, logged: Logged, elapsed: float) -> None:
        """Add an event; movements that were answered at once get their row when they end.

        With a delay of the link the answer is later than the end. These have their row at the answer.
        """
        self._logged, self._elapsed = logged, elapsed
        self.handle(logged.event)

    def finish(self) -> None:
        """Write the rows of movements that ended and were never answered."""
        for logged, elapsed, event in self._unanswered.values():
            self._logged, self._elapsed = logged, elapsed
            self._write_ended(event)
        self._unanswered.clear()

    def on_ended(self, event: MovementEnded) -> None:
        self._ended = event
        if event.number in self._accepted:
            self._accepted.remove(event.number)
            self._write_ended(event)
        elif not event.answers:
            self._unanswered[event.number] = (self._logged, self._elapsed, event)

    def on_result(self, event: CommandResult) -> None:
        ended = self._unanswered.pop(event.number, None)
        if ended is not None:
            self._ended = ended[-1]
        if event.status is not Status.ACCEPTED:
            self._write(event)
        elif ended is not None:
            self._write_ended(ended[-1])
        else:
            self._accepted.add(event.number)

    def _write_ended(self, event: MovementEnded) -> None:
        self._ended = event
        done = CommandResult(
            event.number, event.time, event.command, Status.DONE, math.inf, event.before, event.pose
        )
        self._write(done)

    def _write(self, result: CommandResult) -> None:
        logged, elapsed = self._logged, self._elapsed
        reading, command = result.reading, result.command
        ended, self._ended = self._ended, None
        contact = ended.contact if ended is not None and ended.number == result.number else None
        self._writer.write(
            (
                *(logged.line, result.time, elapsed, logged.real_time, result.number),
                *(command.source, command.text, result.status.value, result.reply),
                *((None, None) if reading is None else (reading.sensor.id, reading.true)),
                *(result.before, result.pose, None if contact is None else contact.point, result.reason),
            )
        )
