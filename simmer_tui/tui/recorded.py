"""A logged run as a source of snapshots: what a live run is to the app, a log is to the replay."""

from __future__ import annotations

from simmer_tui.mission import MissionPlan, mission_state, plan_run
from simmer_tui.runlog.entries import BrokenLine
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.runlog.playback import Playback
from simmer_tui.runlog.reader import Logged
from simmer_tui.snapshot import Snapshot
from simmer_tui.tui.readouts import is_told


class RecordedRun:
    """Moves about in a log and gives a snapshot of each moment."""

    def __init__(self, index: RunLogIndex) -> None:
        """Raises ConfigurationError for mistakes in the log's configuration."""
        self.index = index
        self.playback = Playback(index)
        self.configuration = self.playback.configuration
        header = index.header
        self._plan: MissionPlan | None = None
        if header.mission and self.configuration.mission is not None:
            self._plan = plan_run(self.configuration, header.seed)[1]

    def snapshot(self, entry: int, elapsed: float) -> Snapshot:
        """How the run stood at an elapsed time, `entry` being the latest till then (-1: none). What is
        true of a sensor is what was when it was read."""
        state = self.playback.state_at(entry, elapsed)
        mission = None if self._plan is None else mission_state(self._plan, state)
        true_values = {code: row.reading.true for code, row in state.sensors.items()}
        return Snapshot(state=state, true_values=true_values, mission=mission)

    def around(self, entry: int, rows: int) -> list[Logged | BrokenLine]:
        """What was told around an entry, so that `rows` are filled."""
        count = self.index.count
        first = max(0, min(entry - rows + 3, count - rows))
        told = self.playback.events(first, min(first + rows, count))
        return [each for each in told if isinstance(each, BrokenLine) or is_told(each.event)]
