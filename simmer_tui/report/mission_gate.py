"""The end of the analysis with the mission: later events are counted separately.

Their number depends on how fast the machine ends the program, so two runs of one seed would differ.
"""

import math
from collections.abc import Sequence

from simmer_tui.run.events import (
    ActionDone,
    Belief,
    CommandResult,
    Event,
    EventHandler,
    LegBegun,
    LegEnded,
    MovementEnded,
    MovementPlanned,
    TwinReading,
    VelocityEnded,
)
from simmer_tui.run.phrases import contacts_text
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.run_history import RunHistory
from simmer_tui.sim.command import counted


class MissionGate(EventHandler[bool]):
    """Filters the events after a mission's end: gives True for each that belongs to the analysis, and counts
    the others."""

    def __init__(self, reducer: Reducer) -> None:
        self._reducer = reducer
        self._leg_belongs = True
        """False while a leg is under way that began after the end."""
        self.commands = self.contacts = 0
        """Commands and contacts after the end."""

    @property
    def note(self) -> str:
        """Sentence about the events after the end; empty without any."""
        if not self.commands:
            return ""
        done = f"{counted(self.commands, 'command')} and {contacts_text(self.contacts)}"
        return f"after the mission's end: {done}, not counted here"

    def other(self, event: Event) -> bool:
        return not isinstance(event, (VelocityEnded, Belief, TwinReading))

    def on_result(self, event: CommandResult) -> bool:
        return self._command(event.number, answered=True)

    def on_planned(self, event: MovementPlanned) -> bool:
        return self._command(event.number)

    def on_ended(self, event: MovementEnded) -> bool:
        belongs = self._command(event.number)
        self.contacts += not belongs and event.contact is not None
        return belongs

    def on_leg_begun(self, event: LegBegun) -> bool:
        # A velocity set before the end may continue after it: its number does not show that.
        self._leg_belongs = False
        return False

    def on_leg_ended(self, event: LegEnded) -> bool:
        self.contacts += not self._leg_belongs and event.contact is not None
        return self._leg_belongs

    def on_action(self, event: ActionDone) -> bool:
        self._leg_belongs |= event.restarts
        return event.restarts

    def _command(self, number: int, *, answered: bool = False) -> bool:
        end = self._reducer.mission.end
        # The answer to a command that had begun when the mission ended comes later.
        belongs = end is not None and number <= end.commands
        self.commands += answered and not belongs
        return belongs


class Analysis:
    """A reducer with a history that ends with the mission, until the run restarts."""

    def __init__(self, reducer: Reducer, history: RunHistory, *, ends_history_only: bool = False) -> None:
        """Give the reducer its history. With `ends_history_only` the reducer continues after the history, for
        others that read its state."""
        reducer.history = history
        self._reducer = reducer
        self._history = history
        self._ends_history_only = ends_history_only
        self.gate = MissionGate(reducer)
        self._uncounted_until = 0.0
        """Elapsed simulated seconds at the last event that does not count."""

    def apply(self, event: Event, line: int = 0, real_time: float = math.nan) -> None:
        """Note an event, as a reducer does."""
        is_over = self._history.is_over
        if is_over and not self.gate.handle(event):
            # Only notices have no time, and they count.
            time: float = getattr(event, "time", 0.0)
            self._uncounted_until = max(self._uncounted_until, self._history.clock.before + time)
            if self._ends_history_only:
                self._reducer.history = None
                self._reducer.apply(event, line, real_time)
                self._reducer.history = self._history
            return
        # A restart comes after all earlier events, counted or not.
        if is_over and isinstance(event, ActionDone):
            self._history.clock.skip(self.elapsed)
        self._reducer.apply(event, line, real_time)

    def apply_readings(
        self, results: Sequence[CommandResult], lines: Sequence[int], real_times: Sequence[float]
    ) -> None:
        """Note readings that follow each other, as a reducer does."""
        # A reading ends no mission.
        if not self._history.is_over:
            self._reducer.apply_readings(results, lines, real_times)
            return
        for event, line, real_time in zip(results, lines, real_times, strict=True):
            self.apply(event, line, real_time)

    @property
    def elapsed(self) -> float:
        """Simulated seconds since the history began, those after the mission's end included."""
        return max(self._history.elapsed, self._uncounted_until)
