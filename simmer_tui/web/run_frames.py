"""The frames that viewers get of a run: events come in the robot's thread, all other work is in the page's.

The robot's thread only puts frozen events into a queue, and never waits. Events are recorded, and each frame
is encoded once for all.
"""

from __future__ import annotations

import contextlib
import secrets
import time
from collections import deque
from typing import Any

import msgspec

from simmer_tui.config.settings import ScreenSettings
from simmer_tui.live.server import Server
from simmer_tui.report.page import verdict_box
from simmer_tui.report.player import RecordingEncoder, recorded_robot
from simmer_tui.report.recording import READINGS, Recording
from simmer_tui.report.verdict import Verdict
from simmer_tui.run.attempt import Task
from simmer_tui.run.events import ActionDone, Event, Notice, NoticeKind
from simmer_tui.run.paths import PathRecord
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.state import Checkpoint, checkpoint_of
from simmer_tui.sim.simulator import Simulator
from simmer_tui.web.viewer import framed

# Some seconds of the fastest program. The page's thread reads them 20 times a second.
MOST_WAITING_EVENTS = 20_000
"""Events that may wait for the page's thread. With one more the queue restarts with the robot's present
state."""


class EventQueue:
    """Events on their way from the robot's thread to the page's.

    A page that is too slow loses the run so far, but its memory stays bounded: the queue restarts with a
    checkpoint.
    """

    def __init__(self, simulator: Simulator, *, mission: bool) -> None:
        self._simulator = simulator
        self._mission = mission
        self._items: deque[Event | Checkpoint | float] = deque()
        self._lost = False

    def put(self, event: Event) -> None:
        """Add an event, in the robot's thread."""
        if self._lost:
            # A reducer can begin only where the robot stands still.
            if self._simulator.moving:
                return
            self._lost = False
            self._items.append(checkpoint_of(self._simulator, mission=self._mission))
        self._items.append(event)
        if len(self._items) > MOST_WAITING_EVENTS:
            self._items.clear()
            self._lost = True

    def mark(self, time: float) -> None:
        """Add the present simulated time, in the robot's thread. All earlier events are in the queue."""
        if not self._lost:
            self._items.append(time)

    def take(self, most: int) -> list[Event | Checkpoint | float]:
        """Remove at most `most` events and times, in order, in the page's thread."""
        taken: list[Event | Checkpoint | float] = []
        with contextlib.suppress(IndexError):  # empty, perhaps cleared meanwhile
            while len(taken) < most:
                taken.append(self._items.popleft())
        return taken


class LiveRecording:
    """The recording of a run up to now, for players. Only for the page's thread."""

    def __init__(self, checkpoint: Checkpoint) -> None:
        paths = PathRecord(checkpoint.spec.maze, checkpoint.pose, recorded=True)
        # Rows that no player shows are not kept.
        self._history = RunHistory(checkpoint, log_begins=checkpoint.time, paths=paths, kept=READINGS)
        self.reducer = Reducer(checkpoint, history=self._history)
        """Applies each event."""
        self._recording = Recording(self._history, paths)
        self._encoder = RecordingEncoder(self._recording)
        self._passed = 0.0

    def pass_time(self, time: float) -> None:
        """Let simulated time pass to `time`, without further events."""
        self._passed = self._history.clock.before + time

    def update(self) -> float:
        """Update the recording to the newest event or time. Returns elapsed time."""
        self._recording.update(self._passed)
        return self._recording.end

    def news(self) -> dict[str, Any]:
        """The news for a player that has received everything before."""
        return self._encoder.news()

    def whole(self) -> dict[str, Any]:
        """The whole recording, for a player that has received nothing; later events are in `news`."""
        self._encoder = RecordingEncoder(self._recording)
        return self._encoder.news()


# Simulated seconds a second, and the most seconds that the page may be behind. Timed motion has its own pace.
# In instant motion a drive takes no time: the page shows it at the screen's usual pace.
PAGE_PACE, _LAG, _TIMED_LAG = ScreenSettings().pace, 1.5, 0.08
# A slice takes less than a millisecond, so that the robot's thread can run between two of them.
_SLICE, _PAUSE = 50, 0.0002
"""Events processed before other threads can run, and seconds of that pause."""
# A new viewer gets them after the kept recording; more are encoded again, as one.
_TAIL = 256 * 1024
"""Bytes of frames kept for later viewers."""
# At most so many slices, some 20 ms: a flood must not keep viewers waiting.
_MOST_SLICES = 50


class RunFrames:
    """Encodes a run for viewers. Only for the page's thread, except for the queue of events."""

    def __init__(self, server: Server, task: Task | None) -> None:
        """Watch the run from now on; before it starts."""
        self._server = server
        self._task = task
        self._events = EventQueue(server.simulator, mission=server.referee is not None)
        self._recording = LiveRecording(server.new_reducer().checkpoint())
        self._id = secrets.token_hex(4)
        self._base = b""
        self._tail: list[bytes] = []
        self._is_restarted = False
        self._verdict: dict[str, Any] | None = None
        self._moment: float | None = None
        self._has_judged = False
        self._elapsed = 0.0
        server.engine.watch(self._events.put)

    # -- what happens ----------------------------------------------------------------------------

    def note_time(self) -> None:
        """Pass the present simulated time to the page's thread, from the robot's thread.

        Read in another thread, it might be later than the beginning of a movement whose event is not yet in
        the queue.
        """
        self._events.mark(self._server.engine.present)

    def poll(self) -> bool:
        """Process the events that have come. Returns True if there is news for viewers."""
        has_news = self._has_judged
        for _ in range(_MOST_SLICES):
            events = self._events.take(_SLICE)
            for event in events:
                if isinstance(event, float):
                    self._recording.pass_time(event)
                    continue
                has_news = True
                if isinstance(event, Checkpoint):
                    self._recording = LiveRecording(event)
                    self._is_restarted = True
                    self.forget()
                else:
                    self._recording.reducer.apply(event)
                    self._note_verdict(event)
            if len(events) < _SLICE:
                break
            time.sleep(_PAUSE)
        return has_news

    def has_passed(self, *, is_due: bool) -> bool:
        """True if time has passed since the last frame, and the robot moves or a frame `is_due`."""
        return (is_due or not self._recording.reducer.still) and self._recording.update() > self._elapsed

    def judge(self, verdict: Verdict) -> None:
        """Show the verdict on the run."""
        box = verdict_box(verdict, is_mission=self._task is not None)
        self._verdict = {
            "tone": box.tone.value,
            "sign": box.sign or box.tone.sign,
            "headline": box.headline,
            "lines": verdict.lines,
        }
        self._moment = verdict.elapsed
        self._has_judged = True

    def _note_verdict(self, event: Event) -> None:
        """Show the verdict that the screen shows, until the run continues."""
        if isinstance(event, Notice) and event.kind is NoticeKind.VERDICT:
            verdict = self._server.verdict
            if verdict is not None:
                self.judge(verdict)
        elif (isinstance(event, ActionDone) and event.restarts) or (
            isinstance(event, Notice) and event.kind is NoticeKind.CONNECTED
        ):
            self._has_judged |= self._verdict is not None
            self._verdict = self._moment = None

    # -- frames ----------------------------------------------------------------------------------

    def next(self, fields: dict[str, Any]) -> bytes:
        """The news, with further `fields`, for viewers that have received everything before."""
        self._elapsed = self._recording.update()
        if self._is_restarted:  # the run so far was lost: they get the new one whole
            return self._encoded_whole(fields)
        if self._has_judged:
            fields |= self._judgement()
            self._has_judged = False
        frame = framed(msgspec.json.encode(fields | {"news": self._recording.news()}))
        self._keep(frame)
        return frame

    @property
    def has_whole(self) -> bool:
        """True if `whole` needs no encoding."""
        return bool(self._base)

    def whole(self) -> tuple[bytes, ...]:
        """The whole run up to the newest frame, for a newcomer. All others must have received that frame."""
        if not self._base:
            self._encoded_whole({})
        return (self._base, *self._tail)

    def forget(self) -> None:
        """Drop the frames: there is no viewer, or they are out of date."""
        self._base, self._tail = b"", []

    def _keep(self, frame: bytes) -> None:
        """Keep a frame for later viewers, while that is shorter than the whole run encoded again."""
        if self._base:
            self._tail.append(frame)
            if sum(map(len, self._tail)) > max(_TAIL, len(self._base) // 2):
                self.forget()

    def _encoded_whole(self, fields: dict[str, Any]) -> bytes:
        engine, spec = self._server.engine, self._server.configuration.simulation
        if engine.timed:
            pace, lag = engine.time_scale, _TIMED_LAG
        else:
            pace, lag = PAGE_PACE, _LAG
        run = {
            "id": self._id,
            "limit": None if self._task is None else self._task.time_limit,
            "clock": None,
            "live": {"pace": pace, "lag": lag},
            **recorded_robot(spec),
        }
        made = {"run": run, "news": self._recording.whole(), **self._judgement(), **fields}
        self._base, self._tail = framed(msgspec.json.encode(made)), []
        self._is_restarted = self._has_judged = False
        return self._base

    def _judgement(self) -> dict[str, Any]:
        moment = None if self._moment is None else round(1000 * self._moment)
        return {"verdict": self._verdict, "moment": moment}
