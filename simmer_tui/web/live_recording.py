"""The recording of a run that goes on: events come in the robot's thread, all else is done in the page's.

The robot's thread only puts frozen events into a queue, which never makes it wait.
"""

from __future__ import annotations

from collections import deque
from typing import Any

from simmer_tui.events import Event
from simmer_tui.report.player import RecordingEncoder
from simmer_tui.report.recording import READINGS, Recording
from simmer_tui.run.paths import PathRecord
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.state import Checkpoint, checkpoint_of
from simmer_tui.sim.simulator import Simulator

# Some seconds of the fastest program. The page's thread takes them in 20 times a second.
MOST_WAITING_EVENTS = 20_000
"""Events that may wait for the page's thread; with one more it begins anew from the robot as it stands."""


class EventQueue:
    """Events on their way from the robot's thread to the page's.

    A page that cannot keep up loses the run so far, not its memory: the queue then begins with a checkpoint.
    """

    def __init__(self, simulator: Simulator, *, mission: bool) -> None:
        self._simulator = simulator
        self._mission = mission
        self._items: deque[Event | Checkpoint | float] = deque()
        self._lost = False

    def put(self, event: Event) -> None:
        """Take an event, in the robot's thread."""
        if self._lost:
            # A reducer begins where the robot stands still.
            if self._simulator.moving:
                return
            self._lost = False
            self._items.append(checkpoint_of(self._simulator, mission=self._mission))
        self._items.append(event)
        if len(self._items) > MOST_WAITING_EVENTS:
            self._items.clear()
            self._lost = True

    def mark(self, time: float) -> None:
        """Simulated time now, in the robot's thread: everything before it has been put here."""
        if not self._lost:
            self._items.append(time)

    def take(self, most: int) -> list[Event | Checkpoint | float]:
        """Up to so many events and times, in order, in the page's thread."""
        items = self._items
        taken: list[Event | Checkpoint | float] = []
        while items and len(taken) < most:
            try:
                taken.append(items.popleft())
            except IndexError:  # cleared meanwhile
                break
        return taken


class LiveRecording:
    """The recording of a run up to now, for players. Lives in the page's thread."""

    def __init__(self, beginning: Checkpoint) -> None:
        self.begin_anew(beginning)

    def begin_anew(self, beginning: Checkpoint) -> None:
        """Forget the run so far: it goes on from here."""
        paths = PathRecord(beginning.spec.maze, beginning.pose, recorded=True)
        # Rows that no player shows are not kept.
        self._history = RunHistory(beginning, log_begins=beginning.time, paths=paths, kept=READINGS)
        self._reducer = Reducer(beginning, history=self._history)
        self._recording = Recording(self._history, paths)
        self._encoder = RecordingEncoder(self._recording)
        self._passed = 0.0

    def apply(self, event: Event) -> None:
        """Take in an event."""
        self._reducer.apply(event)

    @property
    def is_still(self) -> bool:
        """True if no movement is under way."""
        return self._reducer.still

    def pass_time(self, time: float) -> None:
        """Simulated time has passed up to `time`, with no other events than those before."""
        self._passed = self._history.clock.before + time

    def update(self) -> float:
        """Bring the recording up to the newest event or time. Returns elapsed time."""
        self._recording.update(self._passed)
        return self._recording.end

    def news(self) -> dict[str, Any]:
        """The news for a player that has had all before."""
        return self._encoder.news()

    def whole(self) -> dict[str, Any]:
        """All of it, for a player that has had nothing; what comes next is in the `news`."""
        self._encoder = RecordingEncoder(self._recording)
        return self._encoder.news()
