"""A logged run as a report sees it: queries on its state and its history."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cached_property

from simmer_tui.config.loader import Configuration
from simmer_tui.report.causes import Cause, cause_of
from simmer_tui.report.recording import Recording
from simmer_tui.run.attempt import Attempt, task_of
from simmer_tui.run.bounded import Errors, First, Thinned
from simmer_tui.run.history_rows import (
    BeliefRow,
    ContactRow,
    MissionRow,
    NoticeRow,
    RefusalRow,
    RepeatedContact,
)
from simmer_tui.run.paths import Jump, PathRecord, PathSegment
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.run_history import CodeTotals, RunHistory, SensorTotals, Totals
from simmer_tui.run.state import MissionProgress
from simmer_tui.runlog.header import Header
from simmer_tui.runlog.log_records import BrokenLine
from simmer_tui.runlog.reader import Logged
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
        self.wall_seconds = 0.0
        self._recorded = recorded

    def add(self, logged: Logged | BrokenLine) -> None:
        """Take in what is told next."""
        if isinstance(logged, BrokenLine):
            self.broken.add(logged)
            return
        self.wall_seconds = max(self.wall_seconds, logged.real_time - self.header.real_time)
        self.reducer.apply(logged.event, logged.line, logged.real_time)

    def finish(self, note: str = "") -> None:
        """No more comes; `note` is what the reader has to say."""
        self.paths.stand(self.duration)
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
    def duration(self) -> float:
        """Simulated seconds from the beginning to the end."""
        return self.history.elapsed

    @property
    def pose(self) -> Pose:
        """Pose of the robot."""
        return self.reducer.pose_at(self.reducer.time)

    @property
    def totals(self) -> Totals:
        """Sums over the whole run."""
        return self.history.totals

    # -- commands, contacts, beliefs and people ----------------------------------------------------

    @property
    def commands(self) -> int:
        return self.totals.commands

    @property
    def codes(self) -> dict[str, CodeTotals]:
        return self.totals.codes

    @property
    def sources(self) -> Counter[str]:
        return self.totals.sources

    @property
    def refusals(self) -> First[RefusalRow]:
        return self.history.refusals.first

    @property
    def sensors(self) -> dict[str, SensorTotals]:
        return self.totals.sensors

    @property
    def movements(self) -> int:
        return self.totals.movements

    @property
    def distance(self) -> float:
        """Inches driven."""
        return self.totals.distance

    @property
    def turned(self) -> float:
        """Degrees turned, either way."""
        return self.totals.turned

    @property
    def contacts(self) -> int:
        return self.totals.contacts

    @property
    def bumps(self) -> First[RepeatedContact]:
        return self.history.repeated.first

    @property
    def last_contact(self) -> ContactRow | None:
        return self.history.contacts.items[-1] if self.history.contacts.items else None

    @property
    def blocked(self) -> tuple[int, float]:
        """Movements in a row at the end that a contact ended, and since when, elapsed seconds."""
        return self.history.blocked(self.history.placed, self.history.order)

    @property
    def beliefs(self) -> Errors:
        return self.totals.beliefs

    @property
    def belief_turns(self) -> Errors:
        return self.totals.belief_turns

    @property
    def belief_trace(self) -> Thinned[BeliefRow]:
        return self.totals.belief_trace

    @property
    def last_belief(self) -> BeliefRow | None:
        return self.history.beliefs[-1] if self.history.beliefs else None

    @property
    def lost(self) -> BeliefRow | None:
        """The first belief that was off by more than its program allowed for."""
        return self.totals.first_lost

    @property
    def faults(self) -> First[NoticeRow]:
        return self.history.faults.first

    @property
    def mission(self) -> First[MissionRow]:
        """Lines of the referee."""
        return self.history.missions.first

    @property
    def actions(self) -> Counter[str]:
        return self.totals.actions

    # -- places and times --------------------------------------------------------------------------

    @property
    def cells(self) -> Counter[tuple[int, int]]:
        """Simulated seconds by cell: row from the top and column from the left, from 1."""
        return self.paths.cells

    @property
    def pieces(self) -> Thinned[PathSegment]:
        return self.paths.segments

    @property
    def jumps(self) -> First[Jump]:
        return self.paths.jumps

    @property
    def driving(self) -> float:
        """Simulated seconds of movements."""
        return self.totals.driving_seconds

    @property
    def on_link(self) -> float:
        """Simulated seconds on the link."""
        return self.totals.link_seconds

    @property
    def reading(self) -> dict[str, float]:
        """Simulated seconds of reading, by sensor ID; those that take none are left out."""
        return {name: each.seconds for name, each in self.sensors.items() if each.seconds}
