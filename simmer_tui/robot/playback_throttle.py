"""Movements shown at a pace that people can watch, while the simulation is always done at once.

With instant motion the simulator and the engine's watchers have processed all commands that have come, with a
screen and without. A screen's watchers are behind. The end of a movement, and all events after it, wait until
the movement has been shown at the pace. So does its answer, and later answers of the same sender. Nothing
else waits, and the order stays: the pace changes when an event is shown, never its content.
"""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Callable

from msgspec import Struct

from simmer_tui.config.settings import PACES
from simmer_tui.robot.timers import LoopTimer, TimerQueue
from simmer_tui.run.events import Event, EventHandler, LegEnded, MovementEnded, Watchers
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.trajectory import Trajectory

# Clients wait for their answers meanwhile: longer would reach their time limits.
LONGEST_SHOWN = 2.0
"""Seconds a movement is shown at most; movements that were sent ahead share them."""
# Judged: more than anybody can follow, and little memory.
MOST_LATE = 2000
"""Events and answers kept for later. With more, all are shown at once."""


def checked_pace(pace: float) -> float:
    """The pace within its bounds; 0 stays 0, as fast as possible."""
    return min(max(pace, PACES.low), PACES.high) if pace else 0.0


class _ShownMovement(Struct, frozen=True):
    """A movement as it is shown: its begin and end by the loop's clock."""

    trajectory: Trajectory | Leg
    begin: float
    until: float

    def time(self, now: float) -> float:
        """The simulated time shown."""
        start, end = self.trajectory.start_time, self.trajectory.end_time
        done = (now - self.begin) / (self.until - self.begin)
        return min(max(start + done * (end - start), start), end)


class PlaybackThrottle(EventHandler[None]):
    """Delays events for those who watch at a pace, and answers for those who wait for a movement.

    All methods run in the robot's event loop; `busy` may be read by any thread.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        pace: float = 0.0,
        fault: Callable[[str], None] = lambda text: None,
    ) -> None:
        """`pace` is simulated seconds a second, 0 as fast as possible. `fault` is called with a text for each
        watcher that failed."""
        self.pace = checked_pace(pace)
        """Simulated seconds a second, from the next movement on; any thread may change it."""
        self.watchers = Watchers(fault)
        """Watchers that see movements at the pace."""
        self._loop = loop
        self._late = TimerQueue()
        self._movements: deque[_ShownMovement] = deque()
        self.until = -math.inf
        """Time by the loop's clock at which everything so far will have been shown."""
        self._timer = LoopTimer(self._go_on, loop)

    @property
    def busy(self) -> bool:
        """True while a movement is being shown."""
        return len(self._late) > 0

    def time(self) -> float | None:
        """The simulated time of the movement shown now; None if the present is shown."""
        self._go_on()
        return self._movements[0].time(self._loop.time()) if self._movements else None

    def watch(self, event: Event) -> None:
        """Pass an event to the watchers that see movements at the pace, now or later."""
        if self.pace:
            self.handle(event)
        if self._late:
            self.later(self.until, lambda: self.watchers.tell(event))
        else:
            self.watchers.tell(event)

    def later(self, moment: float, call: Callable[[], object]) -> None:
        """Call a function at a moment of the loop's clock, after earlier calls."""
        self._late.add(moment, call)
        if len(self._late) > MOST_LATE:
            self.catch_up()
        else:
            self._set_timer()

    def catch_up(self) -> None:
        """Show the present now, and give every answer that waits."""
        self._go_on(math.inf)
        self.until = -math.inf

    def on_ended(self, event: MovementEnded) -> None:
        self._begin_movement(event.trajectory)

    def on_leg_ended(self, event: LegEnded) -> None:
        self._begin_movement(event.leg)

    # -- within --------------------------------------------------------------------------------

    def _begin_movement(self, trajectory: Trajectory | Leg) -> None:
        """Delay later events until this movement has been shown."""
        length = trajectory.end_time - trajectory.start_time
        seconds = min(length / self.pace, LONGEST_SHOWN / (1 + len(self._movements)))
        if seconds <= 0.0:
            return
        begin = max(self._loop.time(), self.until)
        self.until = begin + seconds
        self._movements.append(_ShownMovement(trajectory, begin, self.until))
        self.later(self.until, self._movements.popleft)

    def _go_on(self, now: float | None = None) -> None:
        """Make the calls that are due."""
        self._late.run(self._loop.time() if now is None else now)
        self._set_timer()

    def _set_timer(self) -> None:
        due = self._late.due
        if due == math.inf:
            self._timer.cancel()
        elif due != self._timer.due:
            self._timer.set_at(due)
