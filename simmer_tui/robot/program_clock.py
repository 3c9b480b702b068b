"""The program's clock: an event loop whose time moves only while the program waits.

Computing costs no simulated time, and a run is the same every time, however busy the machine is.
`ProgramClock` knows what the program does; `ProgramClockLoop` is the event loop that follows it.
"""

from __future__ import annotations

import asyncio
import math
import selectors
import time
from collections.abc import Callable

from msgspec import Struct, field

# Times closer than this are equal: the loop's own clock has this resolution, and sums of times have rounding
# errors.
_HAIR = 1e-9
# Judged: loopback takes microseconds, and some milliseconds on a machine with ten times the load it can take.
IN_FLIGHT = 0.2
"""Longest real time for bytes to arrive, seconds."""


# Long enough to cost nothing; a program that waits without an end leaves the loop its turns.
_BOARDS_AHEAD = 1.0
"""Simulated seconds that boards run at most in one turn of the loop."""

_Ready = list[tuple[selectors.SelectorKey, int]]
"""Descriptors that are ready, as selectors give them."""


class ProgramWait(Struct, eq=False):
    """A process of the program. `wake` lets it continue, and is given the time.

    It waits until the time `until`, or computes (None). With `listens` it waits for a reply too, or for what
    another process does, and `looks` once something has happened. Its wait for a reply may begin later, at
    `begin`: what happens before ends it only if bytes were sent to it, and at that time. `outside` is true
    if something outside of the simulation may end its wait. With `away` it waits for a process, `parent` of
    which it is, that may have no clock: no time passes but that of its own descendants.
    `written` are counts of the bytes that were sent to the program since then, by the program's ports.
    """

    wake: Callable[[float], None]
    stuck: Callable[[], None]
    until: float | None = None
    begin: float | None = None
    listens: bool = False
    looks: bool = False
    outside: bool = False
    away: bool = False
    sent: int = 0
    since: int = 0
    parent: ProgramWait | None = None
    written: dict[int, int] = field(default_factory=dict)


class ProgramClock:
    """The time of a program, in seconds from 0, and the wait of each of its processes.

    Only for the loop's thread.
    """

    def __init__(self) -> None:
        self.now = 0.0
        """The time; of the real clock, once the program has turned out to be out of reach."""
        self.reached = False
        """True once a process of the program has connected to this clock."""
        self.quiet: set[int] = set()
        """The descriptors of sockets that bring no replies: those by which processes say what they do."""
        self.frozen = False
        """True once time must not move: the mission has failed, and the program is about to be ended."""
        # On several processors bytes of one connection may arrive after later bytes of another.
        self.received = 0
        """The count of bytes that came from the program."""
        self._written: dict[int, int] = {}
        self.unconfirmed: set[int] = set()
        """Processes that have left the clock, until another has seen their end: only then can all the others
        see it too."""
        self.unfit = ""
        """Calls of the program that this clock cannot follow; empty if there are none."""
        self.settle_output: Callable[[], bool] | None = None
        """Waits until all output of the program has its time; False if that takes too long."""
        self.boards: Callable[[float], float] | None = None
        """Lets the team's boards run to a time of this clock. Returns the time that they have reached, which
        is earlier if they have sent something to the program."""
        self.when_real: Callable[[], None] = lambda: None
        """Called when the real clock comes into force."""
        self._sent = 0
        self._waits = 0
        self._processes: dict[ProgramWait, None] = {}
        self._real_since: float | None = None

    # -- what the program says ---------------------------------------------------------------------

    def join(self, process: ProgramWait) -> None:
        """Add a process. It computes at first."""
        self.reached = True
        self._processes[process] = None

    def pass_freely(self) -> Callable[[], None]:
        """Let time pass without a program, as fast as boards run. Returns the function that ends it."""
        process = ProgramWait(lambda time: None, lambda: None, until=math.inf)
        self.join(process)
        return lambda: self.leave(process)

    def leave(self, process: ProgramWait) -> None:
        """Remove a process that has ended."""
        self._processes.pop(process, None)

    def wait(
        self,
        process: ProgramWait,
        until: float,
        *,
        listens: bool,
        sent: int,
        again: bool = False,
        outside: bool = False,
        begin: float | None = None,
    ) -> None:
        """Note that a process waits until a time, or for a reply, and how many bytes it has sent.

        It waits `again` if it has only looked, and done nothing that another process may wait for. `begin` is
        the time at which it begins to wait, if that is not now.
        """
        process.until, process.listens, process.outside = max(until, self.now), listens, outside
        process.begin = begin
        if not again:
            self._waits += 1
            process.since = self._waits
            for each in self._processes:
                each.looks = each.looks or each is not process
        self._sent += sent - process.sent
        process.sent = sent

    def step_aside(self, process: ProgramWait) -> None:
        """Note that a process waits for another one that may have no clock: what it has done until now
        may end other waits."""
        process.away = True
        self.note()

    # -- what the loop asks ------------------------------------------------------------------------

    @property
    def is_real(self) -> bool:
        """True if the real clock is in force: no process of the program uses this one."""
        return self._real_since is not None

    def use_real_clock(self) -> None:
        """Use the real clock from now on."""
        if self._real_since is None:
            self._real_since = time.monotonic() - self.now
            self.when_real()

    def time(self) -> float:
        """The time now."""
        if self._real_since is not None:
            self.now = max(self.now, time.monotonic() - self._real_since)
        return self.now

    @property
    def is_behind(self) -> bool:
        """True if bytes that the program has sent have not arrived yet."""
        return self._sent > self.received

    def give_up_missing(self) -> None:
        """Stop waiting for bytes that have not arrived by now: they were sent to a connection that is
        closed."""
        self._sent = self.received

    def note(self) -> None:
        """Note an event that may have brought a reply."""
        for each in self._processes:
            each.looks = True

    def count_written(self, port: int, count: int) -> None:
        """Count bytes that were sent to a port of the program."""
        self._written[port] = self._written.get(port, 0) + count
        for each in self._processes:
            each.written[port] = self._written[port]

    def advance(self, timer: float) -> bool:
        """Move time to `timer`, the loop's next timer, or let the program continue. False if only the program
        can continue.

        Called when the loop has nothing else to do.
        """
        waiting = self._waiting()
        if self.frozen or not waiting:
            return False
        self._settle_output()
        self._begin_waits()
        until = min(self._end_of(each) for each in waiting)
        # Only the processes know whose reply it is.
        if not any(_may_have_reply(each) for each in waiting):
            if min(until, timer) == math.inf and self.boards is None:
                if any(each.away for each in self._processes):
                    return False  # it will come back, and may end their waits
                max(waiting, key=lambda each: each.outside).stuck()
                return False
            if self.boards is not None and not self._run_boards(self.boards, min(timer, until)):
                return True
            self.now = max(self.now, min(timer, until))
            self._begin_waits()
            if timer <= until:
                self.note()
                return True
        return not self._wake_one(waiting)

    def _run_boards(self, run: Callable[[float], float], until: float) -> bool:
        """Let the boards run, and the time with them. False if they have not reached `until` yet."""
        target = min(until, self.now + _BOARDS_AHEAD)
        reached = run(target)
        if reached >= until:
            return True
        self.now = max(self.now, reached)
        return False

    def _begin_waits(self) -> None:
        """Begin the waits whose time has come. One whose reply is there is over at once."""
        for each in self._processes:
            if each.begin is not None and each.begin <= self.now + _HAIR:
                each.begin, each.looks = None, bool(each.written)

    def _end_of(self, process: ProgramWait) -> float:
        """The time at which a wait ends, if nothing happens."""
        assert process.until is not None, "it waits"
        # Boards run on beyond the beginning of a wait, until they send something.
        if process.begin is not None and (process.written or self.boards is None):
            return process.begin
        return process.until

    def _waiting(self) -> list[ProgramWait]:
        """The processes that wait, but not for the end of another one; none while one computes or ends."""
        parents = [each.parent for each in self._processes]
        # What it waits for has no clock, or none yet: as if it computed.
        present = [each for each in self._processes if not (each.away and each in parents)]
        if self.unconfirmed or any(each.until is None for each in present):
            return []
        return present

    def _settle_output(self) -> None:
        """Give everything printed so far this time. An attempt that takes too long is the last."""
        if self.settle_output is not None and not self.settle_output():
            self.settle_output = None

    def _wake_one(self, waiting: list[ProgramWait]) -> bool:
        """Let the process continue whose time came first, and of those the one that waits longest. False if
        the wait of none is over: one has begun."""
        ready = [
            (min(self._end_of(each), self.now), each.since, each)
            for each in waiting
            if _may_have_reply(each) or self._end_of(each) <= self.now + _HAIR
        ]
        if not ready:
            return False
        process = min(ready, key=lambda each: each[:2])[2]
        process.until, process.listens, process.looks = None, False, False
        process.wake(self.now)
        return True


def _may_have_reply(process: ProgramWait) -> bool:
    """True if something has happened since the process began to wait for a reply."""
    return process.looks and process.listens and process.begin is None


class ProgramClockLoop(asyncio.SelectorEventLoop):
    """An event loop whose time is that of a `ProgramClock`."""

    def __init__(self, clock: ProgramClock) -> None:
        self.clock = clock
        self._scheduled: list[asyncio.TimerHandle]
        self._waits = _ProgramSelector(clock, self._next_timer)
        super().__init__(self._waits)

    def _next_timer(self) -> float:
        """The exact time of the next timer."""
        # A private part of asyncio. `select` gets the difference to now: its rounding depends on the moment
        # of the call, and so would the run.
        return self._scheduled[0].when()

    def time(self) -> float:
        """The program's time."""
        return self.clock.time()

    async def real_pause(self, seconds: float) -> None:
        """Wait by the real clock, for work of other processes."""
        over = self.create_future()
        self._waits.real_timers.append((time.monotonic() + seconds, over))
        await over


def clock_of(loop: asyncio.AbstractEventLoop) -> ProgramClock | None:
    """The program's clock, if the loop has one."""
    return loop.clock if isinstance(loop, ProgramClockLoop) else None


class _ProgramSelector(selectors.DefaultSelector):
    """Waits for sockets as the system's selector does. It moves the program's time instead of waiting for the
    loop's timers."""

    def __init__(self, clock: ProgramClock, next_timer: Callable[[], float]) -> None:
        super().__init__()
        self._clock = clock
        self._next_timer = next_timer
        self.real_timers: list[tuple[float, asyncio.Future[None]]] = []
        """Waits by the real clock, each with its end."""

    def select(self, timeout: float | None = None) -> _Ready:
        """Descriptors that are ready. `timeout` is in seconds of the program's clock."""
        clock = self._clock
        if clock.is_real:
            return self._wait(timeout)
        # Everything that the program sent before it began to wait has arrived already, and is read first.
        ready = super().select(0)
        if ready or (timeout is not None and timeout <= 0):
            return self._noted(ready)
        if clock.is_behind:
            ready = self._wait(IN_FLIGHT)
            if not ready:
                clock.give_up_missing()
            return ready
        timer = math.inf if timeout is None else self._next_timer()
        return [] if clock.advance(timer) else self._wait(None)

    def _noted(self, ready: _Ready) -> _Ready:
        """The same descriptors, after the clock has noted whether they may bring a reply."""
        if any(key.fd not in self._clock.quiet for key, _ in ready):
            self._clock.note()
        return ready

    def _wait(self, timeout: float | None) -> _Ready:
        """Descriptors that are ready, waited for by the real clock."""
        now = time.monotonic()
        due = min((each for each, _ in self.real_timers), default=math.inf)
        if due < math.inf:
            timeout = max(0.0, min(due - now, math.inf if timeout is None else timeout))
        ready = self._noted(super().select(timeout))
        if due < math.inf and time.monotonic() >= due:
            over = [future for at, future in self.real_timers if at <= due]
            self.real_timers[:] = [each for each in self.real_timers if each[0] > due]
            for future in over:
                if not future.done():
                    future.set_result(None)
        return ready
