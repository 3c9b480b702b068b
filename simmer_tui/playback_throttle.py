"""Movements shown at a pace that people can watch, while the simulation is always done at once.

With instant motion the simulator and the engine's watchers have processed all commands that have come, with a
screen and without. A screen's watchers are behind. The end of a movement, and all events after it, wait until
the movement has been shown at the pace. So does its answer, and later answers of the same sender. Nothing
else waits, and the order stays: the pace changes when an event is shown, never its content.
"""

from __future__ import annotations

import asyncio
import heapq
import itertools
import math
from collections import deque
from collections.abc import Callable

from msgspec import Struct

from simmer_tui.events import Event, EventHandler, LegEnded, MovementEnded, Watchers
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.trajectory import Trajectory

# Clients wait for their answers meanwhile: longer would reach their time limits.
LONGEST = 2.0
"""Seconds a movement is shown at most; movements that were sent ahead share them."""
# Judged: more than anybody can follow, and little memory.
MOST_LATE = 2000
"""Events and answers kept for later. With more, all are shown at once."""
# Powers of two, so that doubling and halving by key meets both.
SLOWEST, FASTEST = 0.125, 1024.0
"""Least and greatest pace, simulated seconds a second. 0 is as fast as possible."""


def checked_pace(pace: float) -> float:
    """The pace within its bounds; 0 stays 0, as fast as possible."""
    return min(max(pace, SLOWEST), FASTEST) if pace else 0.0


class _Way(Struct, frozen=True):
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
        """Holds from the next movement on; any thread may change it."""
        self.watchers = Watchers(fault)
        """Those who see movements at the pace."""
        self._loop = loop
        self._late: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self._ways: deque[_Way] = deque()
        self._until = -math.inf
        self._timer: asyncio.TimerHandle | None = None
        self._due = math.inf

    @property
    def busy(self) -> bool:
        """True while a movement is being shown."""
        return bool(self._late)

    @property
    def until(self) -> float:
        """Time by the loop's clock at which everything so far will have been shown."""
        return self._until

    def time(self) -> float | None:
        """The simulated time of the movement shown now; None if the present is shown."""
        self._go_on()
        return self._ways[0].time(self._loop.time()) if self._ways else None

    def watch(self, event: Event) -> None:
        """Take an event for those who watch at the pace."""
        if self.pace:
            self.handle(event)
        if self._late:
            self.later(self._until, lambda: self.watchers.tell(event))
        else:
            self.watchers.tell(event)

    def later(self, moment: float, call: Callable[[], None]) -> None:
        """Call a function at a moment of the loop's clock, after earlier calls."""
        heapq.heappush(self._late, (moment, next(self._order), call))
        if len(self._late) > MOST_LATE:
            self.catch_up()
        else:
            self._set_timer()

    def catch_up(self) -> None:
        """Show the present now, and give every answer that waits."""
        self._go_on(math.inf)
        self._until = -math.inf

    def on_ended(self, event: MovementEnded) -> None:
        self._begin_way(event.trajectory, self.pace)

    def on_leg_ended(self, event: LegEnded) -> None:
        self._begin_way(event.leg, self.pace)

    # -- within --------------------------------------------------------------------------------

    def _begin_way(self, trajectory: Trajectory | Leg, pace: float) -> None:
        """Delay later events until this movement has been shown."""
        length = trajectory.end_time - trajectory.start_time
        seconds = min(length / pace, LONGEST / (1 + len(self._ways)))
        if seconds <= 0.0:
            return
        begin = max(self._loop.time(), self._until)
        self._until = begin + seconds
        self._ways.append(_Way(trajectory, begin, self._until))
        self.later(self._until, self._ways_end)

    def _ways_end(self) -> None:
        self._ways.popleft()

    def _go_on(self, now: float | None = None) -> None:
        """Make the calls that are due."""
        if now is None:
            now = self._loop.time()
        while self._late and self._late[0][0] <= now:
            heapq.heappop(self._late)[2]()
        self._set_timer()

    def _set_timer(self) -> None:
        due = self._late[0][0] if self._late else math.inf
        if due == self._due:
            return
        self._due = due
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._loop.call_at(due, self._ring) if self._late else None

    def _ring(self) -> None:
        self._timer, self._due = None, math.inf
        self._go_on()
