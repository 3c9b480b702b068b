"""A logged run as a report sees it: queries on its state and its history."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

from simmer_tui.config.loader import Configuration
from simmer_tui.report.causes import Cause, cause_of
from simmer_tui.report.recording import Recording
from simmer_tui.run.attempt import Attempt, task_of
from simmer_tui.run.bounded import First
from simmer_tui.run.paths import PathRecord
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.run_history import RunHistory, Totals
from simmer_tui.run.state import MissionProgress
from simmer_tui.runlog.header import Header
from simmer_tui.runlog.log_records import BrokenLine
from simmer_tui.runlog.reader import Logged, LogReader
from simmer_tui.sim.pose import Pose


class RunStatistics:
    """Feed it what a log tells, in order, call `finish`, and read the figures."""

    def __init__(self, header: Header, configuration: Configuration, *, recorded: bool = True) -> None:
        """With `recorded` it keeps what a player shows, too."""
        self.header = header
        self.configuration = configuration
        beginning = header.beginning(configuration)
        # Not every log says in its header that a mission is under way; its configuration says what one is.
        if configuration.mission is not None:
            beginning = replace(beginning, mission=beginning.mission or MissionProgress())
        self.paths = PathRecord(configuration.simulation.maze, header.pose, recorded=recorded)
        self.history = RunHistory(
            beginning, log_begins=header.t, counters_known=header.number == 0, paths=self.paths
        )
        self.reducer = Reducer(beginning, history=self.history)
        self.broken: First[BrokenLine] = First(20)
        self.notes: list[str] = []
        self.cause: Cause | None = None
        """Why the run failed, if it did; after `finish`."""
        self.real_seconds = 0.0
        self._recorded = recorded

    def add(self, logged: Logged | BrokenLine) -> None:
        """Take in what is told next."""
        if isinstance(logged, BrokenLine):
            self.broken.add(logged)
            return
        self.real_seconds = max(self.real_seconds, logged.real_time - self.header.real_time)
        self.reducer.apply(logged.event, logged.line, logged.real_time)

    def finish(self, note: str = "") -> None:
        """No more comes; `note` is what the reader has to say."""
        self.paths.stand(self.history.elapsed)
        # Only of a mission is it known what was to be done.
        if self.configuration.mission is not None:
            self.cause = cause_of(Attempt(self.history, task_of(self.configuration, self.header.seed)))
        if note:
            self.notes.append(note)
        if not self.reducer.still:
            self.notes.append("the log ends while a movement is under way; how it ended is not known")
        for broken in self.broken.items:
            self.notes.append(f"{broken}, and was skipped")
        if self.broken.more:
            self.notes.append(f"{self.broken.more} more broken lines were skipped")

    @cached_property
    def recording(self) -> Recording:
        """Contents of the player; after `finish`."""
        assert self._recorded, "nothing was recorded"
        return Recording(self.history, self.paths)

    @property
    def pose(self) -> Pose:
        """Pose of the robot."""
        return self.reducer.pose_at(self.reducer.time)

    @property
    def totals(self) -> Totals:
        """Sums over the whole run."""
        return self.history.totals


def report_of(log: LogReader) -> RunStatistics:
    """The figures of a log that is read to its end."""
    run = RunStatistics(log.header, log.configuration)
    for logged in log:
        run.add(logged)
    run.finish(log.note)
    return run
