"""The frames that tell viewers of a run: events come in the robot's thread, all else is done in the page's.

The robot's thread only puts frozen events into a queue, which never makes it wait. What happens is recorded,
and each frame encoded once for all.
"""

from __future__ import annotations

import secrets
import time
from collections import deque
from typing import Any

import msgspec

from simmer_tui.events import ActionDone, Event, Notice, NoticeKind
from simmer_tui.report.page import verdict_box
from simmer_tui.report.player import RecordingEncoder, recorded_robot
from simmer_tui.report.recording import READINGS, Recording
from simmer_tui.report.verdict import Verdict
from simmer_tui.run.attempt import Task
from simmer_tui.run.paths import PathRecord
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.state import Checkpoint, checkpoint_of
from simmer_tui.server import Server
from simmer_tui.sim.simulator import Simulator
from simmer_tui.web.viewer import framed

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


# Simulated seconds a second, and the most seconds that the page is behind. Timed motion has its own pace.
# In instant motion a drive takes no time: the page shows it in four times real speed, as the screen does.
_PACE, _LAG, _TIMED_LAG = 4.0, 1.5, 0.08
# A slice takes below a millisecond, so that the robot's thread has its turn between two of them.
_SLICE, _PAUSE = 50, 0.0002
"""Events taken in before other threads have a turn, and seconds of that."""
# A new viewer has them after the recording as it was; more are encoded anew, as one.
_TAIL = 256 * 1024
"""Bytes of frames kept for those who come next."""
# So many slices at most, some 20 ms: a flood must not keep viewers waiting.
_MOST_SLICES = 50


class RunFrames:
    """Encodes a run for viewers. Lives in the page's thread, but for the queue that events come over."""

    def __init__(self, server: Server, task: Task | None) -> None:
        """Watch the run from here on; before it starts."""
        self._server = server
        self._task = task
        self._events = EventQueue(server.simulator, mission=server.referee is not None)
        self._recording = LiveRecording(server.new_fold().beginning())
        self._id = secrets.token_hex(4)
        self._base = b""
        self._tail: list[bytes] = []
        self._is_anew = False
        self._verdict: dict[str, Any] | None = None
        self._moment: float | None = None
        self._has_judged = False
        self._elapsed = 0.0
        server.engine.watch(self._events.put)

    # -- what happens ----------------------------------------------------------------------------

    def note_time(self) -> None:
        """Tell the page's thread how far simulated time has come, in the robot's thread.

        Read in another thread it may be later than the beginning of a movement that is just being told.
        """
        self._events.mark(self._server.engine.present)

    def take_in(self) -> bool:
        """Take in the events that have come. Returns True if viewers are to be told of anything."""
        has_news = self._has_judged
        for _ in range(_MOST_SLICES):
            events = self._events.take(_SLICE)
            for event in events:
                if isinstance(event, float):
                    self._recording.pass_time(event)
                    continue
                has_news = True
                if isinstance(event, Checkpoint):
                    self._recording.begin_anew(event)
                    self._is_anew = True
                    self.forget()
                else:
                    self._recording.apply(event)
                    self._note_verdict(event)
            if len(events) < _SLICE:
                break
            time.sleep(_PAUSE)
        return has_news

    def has_passed(self, *, is_due: bool) -> bool:
        """True if time has passed since the last frame, and the robot moves, or it `is_due` to say so."""
        return (is_due or not self._recording.is_still) and self._recording.update() > self._elapsed

    def judge(self, verdict: Verdict) -> None:
        """Show how the run ended."""
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
        """Show the verdict that the screen shows, until the run goes on."""
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

    def next(self, told: dict[str, Any]) -> bytes:
        """The news, and what else is `told`, for all who have had everything before."""
        self._elapsed = self._recording.update()
        if self._is_anew:  # the run so far was lost: they get the new one whole
            return self._encoded_whole(told)
        if self._has_judged:
            told |= self._judgement()
            self._has_judged = False
        frame = framed(msgspec.json.encode(told | {"news": self._recording.news()}))
        self._keep(frame)
        return frame

    @property
    def has_whole(self) -> bool:
        """True if `whole` needs no encoding."""
        return bool(self._base)

    def whole(self) -> tuple[bytes, ...]:
        """All of the run up to the newest frame, for a newcomer; that frame must have gone to all others."""
        if not self._base:
            self._encoded_whole({})
        return (self._base, *self._tail)

    def forget(self) -> None:
        """Keep no frames: nobody is there, or they no longer hold."""
        self._base, self._tail = b"", []

    def _keep(self, frame: bytes) -> None:
        """Keep a frame for those who come next, as long as that is less than all of it anew."""
        if self._base:
            self._tail.append(frame)
            if sum(map(len, self._tail)) > max(_TAIL, len(self._base) // 2):
                self.forget()

    def _encoded_whole(self, told: dict[str, Any]) -> bytes:
        engine, spec = self._server.engine, self._server.configuration.simulation
        if engine.timed:
            pace, lag = engine.time_scale, _TIMED_LAG
        else:
            pace, lag = _PACE, _LAG
        run = {
            "id": self._id,
            "limit": None if self._task is None else self._task.time_limit,
            "clock": None,
            "live": {"pace": pace, "lag": lag},
            **recorded_robot(spec),
        }
        made = {"run": run, "news": self._recording.whole(), **self._judgement(), **told}
        self._base, self._tail = framed(msgspec.json.encode(made)), []
        self._is_anew = self._has_judged = False
        return self._base

    def _judgement(self) -> dict[str, Any]:
        moment = None if self._moment is None else round(1000 * self._moment)
        return {"verdict": self._verdict, "moment": moment}
