"""The verdict on a live run: found as soon as the run ends, outside the robot's thread."""

import math
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from simmer_tui.report.mission_gate import Analysis
from simmer_tui.report.verdict import Verdict, verdict_of
from simmer_tui.run.attempt import Task
from simmer_tui.run.events import (
    ActionDone,
    CommandResult,
    Event,
    EventHandler,
    MissionEvent,
    Notice,
    NoticeKind,
    ProgramEnded,
)
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.run_history import RunHistory


@dataclass(eq=False)
class LiveVerdict(EventHandler[None]):
    """The run's history, and the verdict, found when mission, program or connection end.

    The history does not change while a thread reads it: events of that time wait. `call` runs a function in
    the robot's thread, where all methods run; `tell` tells an event.
    """

    reducer: Reducer
    history: RunHistory
    task: Task | None
    call: Callable[..., object]
    tell: Callable[[Event], None]

    def __post_init__(self) -> None:
        self._analysis = Analysis(self.reducer, self.history)
        self._waiting: deque[tuple[Event, float]] = deque()
        """Events that have come during a search, each with its real time."""
        self._busy = self._wanted = False
        self._has_program = False
        self._search: threading.Thread | None = None
        self._last_text = ""
        """Text of the last verdict that was published as a notice; empty without one on this run."""
        self.verdict: Verdict | None = None
        """The verdict, once the run has ended."""

    def expect_program(self) -> None:
        """The simulator runs the program itself: its end counts, not that of its connections."""
        self._has_program = True

    def apply(self, event: Event, line: int = 0, real_time: float = math.nan) -> None:
        """Note an event, as a reducer does."""
        if self._busy:
            self._waiting.append((event, real_time))
            return
        self._analysis.apply(event, line, real_time)
        self.handle(event)
        if self._wanted:
            self._wanted = False
            self._busy = True
            self._search = threading.Thread(target=self._find, name="verdict", daemon=True)
            self._search.start()

    def apply_readings(
        self, results: Sequence[CommandResult], lines: Sequence[int], real_times: Sequence[float]
    ) -> None:
        """Note readings that follow each other, as a reducer does."""
        if self._busy:
            self._waiting.extend(zip(results, real_times, strict=True))
        else:
            self._analysis.apply_readings(results, lines, real_times)

    def close(self, within: float) -> None:
        """Wait up to `within` seconds for a search under way, once the robot's thread has ended.

        A search is mostly in GEOS, without the interpreter's lock. A process that ends meanwhile unloads GEOS
        during the search, and ends with a segmentation fault in place of its exit code.
        """
        if self._search is not None:
            self._search.join(within)

    def on_mission(self, event: MissionEvent) -> None:
        self._wanted = event.over

    def on_program_ended(self, event: ProgramEnded) -> None:
        self._wanted = True

    def on_action(self, event: ActionDone) -> None:
        if event.restarts:
            self._forget()

    def on_notice(self, event: Notice) -> None:
        goes_on = event.kind is NoticeKind.TAKEN_OVER and not self.reducer.mission.over
        if goes_on or event.kind is NoticeKind.CONNECTED:
            self._forget()
        self._wanted = event.kind is NoticeKind.LEFT and not self._has_program

    def _forget(self) -> None:
        self.verdict, self._last_text = None, ""

    def _find(self) -> None:
        verdict, fault = None, ""
        try:
            verdict = verdict_of(self.history, self.task)
        except Exception as error:  # noqa: BLE001 - the run must go on without a verdict
            fault = f"no verdict was found: {type(error).__name__}: {error}"
        try:
            self.call(self._found, verdict, fault)
        except RuntimeError:  # the robot's thread has ended meanwhile
            return

    def _found(self, verdict: Verdict | None, fault: str) -> None:
        self._busy = False
        self.verdict = verdict
        waiting, self._waiting = self._waiting, deque()
        for event, real_time in waiting:
            self.apply(event, 0, real_time)
        if fault:
            self.tell(Notice(NoticeKind.FAULT, fault))
        # Where mission and program end together, the second search has both.
        elif self.verdict is not None and not self._busy and self.verdict.text != self._last_text:
            self._last_text = self.verdict.text
            self.tell(Notice(NoticeKind.VERDICT, self._last_text))
