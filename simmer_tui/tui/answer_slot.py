"""The choice of the one answer that the screen shows."""

from collections.abc import Callable, Iterable

from simmer_tui.snapshot import LogEntry, Snapshot
from simmer_tui.tui.answers import AnswerCard, end_answer, now_answer, scan_answer
from simmer_tui.tui.headline import RunPhase


class AnswerSlot:
    """The one place for answers: a requested one, the end of the run, first steps, or the present
    movement."""

    def __init__(self) -> None:
        self.first_steps: Callable[[], AnswerCard | None] = lambda: None
        """Advice for a beginning, if there is any."""
        self.has_orders = False
        """True if orders can be typed, which an answer may name."""
        self._asked: AnswerCard | None = None
        self._moved = 0
        self._closed = False
        self._commands = -1
        self._has_end = False

    def ask(self, answer: AnswerCard, snapshot: Snapshot) -> None:
        """Show an answer until it is closed, or until the robot moves again."""
        self._asked, self._moved = answer, snapshot.state.moved

    def close(self) -> bool:
        """Close the answer, if it can be closed. Returns True if it could."""
        had = self._asked is not None or (self._has_end and not self._closed)
        self._closed = self._closed or (self._asked is None and self._has_end)
        self._asked = None
        return had

    def answer(
        self, snapshot: Snapshot, newest: Iterable[LogEntry], phase: RunPhase, *, plain: bool
    ) -> AnswerCard:
        """The answer to show now; `newest` are the events, the newest first."""
        state = snapshot.state
        if self._asked is not None and state.moved != self._moved:
            self._asked = None
        end = end_answer(snapshot, orders=self.has_orders)
        if end is None:
            self._closed, self._commands = False, -1
        elif phase is RunPhase.ENDED:
            # A person who drives on has seen it.
            self._commands = state.commands if self._commands < 0 else self._commands
            self._closed = self._closed or state.commands != self._commands
        self._has_end = end is not None
        if self._asked is not None:
            return self._asked
        if end is not None and not self._closed:
            return end
        steps = self.first_steps() if phase is RunPhase.WAITING else None
        if steps is not None:
            return steps
        return scan_answer(snapshot, plain=plain) or now_answer(snapshot, newest, plain=plain)
