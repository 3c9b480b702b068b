"""The end of the analysis with the mission: what came after is counted apart.

How much a program still does after its mission depends on how fast the machine ends it, so that two
runs of one seed would differ.
"""

from simmer_tui.events import (
    ActionDone,
    Belief,
    CommandResult,
    Event,
    EventHandler,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    TwinReading,
)
from simmer_tui.phrases import contacts_text, counted


class MissionGate(EventHandler[bool]):
    """Gives True for each event that belongs to the analysis, and counts the others."""

    def __init__(self) -> None:
        self.over = False
        """True while the mission has ended and the run has not begun anew."""
        self._last = 0
        """Number of the last command that had begun when the mission ended: its answer comes later."""
        self.commands = self.contacts = 0
        """Commands and contacts after the end."""

    @property
    def note(self) -> str:
        """Sentence about what came after the end; empty if nothing did."""
        if not self.commands:
            return ""
        done = f"{counted(self.commands, 'command')} and {contacts_text(self.contacts)}"
        return f"after the mission's end came {done}, which do not count here"

    def other(self, event: Event) -> bool:
        return True

    def on_result(self, event: CommandResult) -> bool:
        return self._command(event.number, answered=True)

    def on_planned(self, event: MovementPlanned) -> bool:
        return self._command(event.number)

    def on_ended(self, event: MovementEnded) -> bool:
        belongs = self._command(event.number)
        self.contacts += not belongs and event.contact is not None
        return belongs

    def on_belief(self, event: Belief) -> bool:
        return not self.over

    def on_twin(self, event: TwinReading) -> bool:
        return not self.over

    def on_action(self, event: ActionDone) -> bool:
        if event.restarts:
            self.over, self._last = False, 0
        return not self.over

    def on_mission(self, event: MissionEvent) -> bool:
        self.over = self.over or event.over
        return True

    def _command(self, number: int, *, answered: bool = False) -> bool:
        if not self.over:
            self._last = max(self._last, number)
            return True
        belongs = number <= self._last
        self.commands += answered and not belongs
        return belongs
