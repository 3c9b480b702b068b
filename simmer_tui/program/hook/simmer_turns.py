"""Threads of a program that take turns by the program's clock: one runs at a time, until it waits.

The turn passes only at waits: to the thread whose time came first, and of those to the one that waits
longest. Simulated time moves when all of them wait. So a run is the same every time.

It is imported into other people's programs, by whatever Python they use: standard library alone, Python 3.8
on, and nothing of the package.
"""

from __future__ import annotations

import _thread
import math
import sys
import threading
import time

TYPE_CHECKING = False  # the module typing would cost every start some milliseconds
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

_NEVER = math.inf
_REAL_LOCK, _REAL_PAUSE, _REAL_TIME = _thread.allocate_lock, time.sleep, time.monotonic
"""The system's functions, before they are replaced."""
# The look of a person who wonders; a look costs 10 us.
_WATCH = 0.25
"""Real seconds between two looks at the thread whose turn it is."""


class Turn:
    """A thread: what it waits for, or that it runs."""

    def __init__(self, since: int) -> None:
        self.ident = 0
        self.gate = _REAL_LOCK()
        """Locked while it waits."""
        self.gate.acquire()
        self.since = since
        """The number of its wait."""
        self.until = _NEVER
        """End of its wait, nanoseconds."""
        self.listens = False
        """True if it waits for what comes from the robot or from another process."""
        self.looks = False
        """True if something has happened since it last looked whether that has come."""
        self.outside = False
        """True if something outside of the simulation may end its wait."""
        self.ready = False
        """True if another thread has ended its wait."""
        self.stuck = False
        """True if nothing will ever end its wait."""
        self.ended = False
        self.joiners: list[Turn] = []


class Turns:
    """The threads of this process, and whose turn it is."""

    def __init__(self, clock: Any) -> None:
        self._clock = clock
        self._waits = 0
        self.threads: list[Turn] = []
        self.running: Turn
        self._watched = False
        self.reset()

    def reset(self) -> None:
        """Begin with the calling thread alone."""
        self.running = Turn(0)
        self.running.ident = _thread.get_ident()
        self.threads = [self.running]
        self._watched = False

    # -- waits ---------------------------------------------------------------------------------------

    def wait(self, until: float, *, listens: bool, again: bool = False, outside: bool = False) -> bool:
        """Wait until a time, nanoseconds, or until something happens if it `listens`, or another thread ends
        the wait. False if none of that will ever happen.

        It waits `again` if it has only looked, and done nothing that another thread may wait for.
        """
        me, clock = self.running, self._clock
        me.until, me.listens, me.outside, me.looks, me.ready, me.stuck = (
            until, listens, outside, False, False, False,
        )  # fmt: skip
        if not again:
            clock.acted = True
            self._waits += 1
            me.since = self._waits
            for each in self.threads:
                each.looks = each is not me
        following = self._next()
        if following is not me:
            self._pass_to(following)
            me.gate.acquire()
        return not me.stuck

    def _next(self) -> Turn:
        """The thread whose turn it is next. Simulated time moves until there is one."""
        clock = self._clock
        while True:
            now = clock.here
            ready = [
                (min(each.until, now), each.since, each)
                for each in self.threads
                if each.ready or (each.listens and each.looks) or each.until <= now
            ]
            if ready:
                return min(ready, key=_first)[2]
            until = min((each.until for each in self.threads), default=_NEVER)
            listening = [each for each in self.threads if each.listens]
            outside = any(each.outside for each in listening)
            if not clock.move(until, listens=bool(listening), outside=outside):
                following = max(self.threads, key=_hope)
                following.stuck = following.ready = True
            for each in listening:
                each.looks = True

    def _pass_to(self, following: Turn) -> None:
        self.running = following
        following.gate.release()

    def wake(self, thread: Turn) -> None:
        """End the wait of another thread: its turn comes."""
        thread.ready = True
        thread.until = min(thread.until, self._clock.here)

    # -- threads -------------------------------------------------------------------------------------

    def start(self, real: Callable[..., Any], function: Any, arguments: Any, *rest: Any, **named: Any) -> Any:
        """Start a thread by the system's function. Its turn comes when we wait."""
        self._waits += 1
        turn = Turn(self._waits)
        turn.ready, turn.until = True, self._clock.here

        def run(*given: Any, **others: Any) -> None:
            turn.ident = _thread.get_ident()
            turn.gate.acquire()
            try:
                function(*given, **others)
            finally:
                self._end(turn)

        thread = getattr(function, "__self__", None)
        if isinstance(thread, threading.Thread):
            thread._simmer_turn = turn  # type: ignore[attr-defined]
        self.threads.append(turn)
        self.watch()
        try:
            return real(run, *arguments, *rest, **named)
        except BaseException:
            self.threads.remove(turn)
            raise

    def _end(self, turn: Turn) -> None:
        turn.ended = self._clock.acted = True
        self.threads.remove(turn)
        for each in self.threads:
            each.looks = True
        for each in turn.joiners:
            self.wake(each)
        self._pass_to(self._next())

    def join(self, turn: Turn, timeout: float | None) -> None:
        """Wait for the end of a thread."""
        until = self._clock.end_of(timeout)
        while not turn.ended and not self._clock.is_over(until):
            turn.joiners.append(self.running)
            if not self.wait(until, listens=False):
                self._clock.refuse_lock()
            if self.running in turn.joiners:
                turn.joiners.remove(self.running)

    def has_only_this(self) -> bool:
        """True if there is one thread."""
        return len(self.threads) == 1

    # -- what never waits ----------------------------------------------------------------------------

    def watch(self) -> None:
        """Tell the person if a thread does not give up its turn, from now on."""
        if not self._watched:
            self._watched = True
            _START(self._watch, ())

    def _watch(self) -> None:
        told, turn, count, since = False, None, -1, _REAL_TIME()
        while not told:
            _REAL_PAUSE(_WATCH)
            clock = self._clock
            if clock.turns is not self or not clock.is_shared:
                continue
            if clock.is_moving or clock.is_away or (self.running, clock.count) != (turn, count):
                turn, count, since = self.running, clock.count, _REAL_TIME()
                if clock.is_away and since - clock.away_since >= clock.named_after:
                    clock.name_away(sys._current_frames().get(turn.ident))
            elif _REAL_TIME() - since >= clock.named_after:
                told = True
                clock.name_computing(sys._current_frames().get(self.running.ident))


_START = _thread.start_new_thread


def _first(entry: Any) -> Any:
    return entry[:2]


def _hope(thread: Turn) -> tuple[bool, bool, int]:
    """Rank of a thread that waits for ever: the one that may know why comes first."""
    return thread.outside, thread.listens, -thread.since


class Lock:
    """`threading.Lock` of threads that take turns."""

    __slots__ = ("__weakref__", "_locked", "_waiting")
    turns: Turns

    def __init__(self) -> None:
        self._locked = False
        self._waiting: list[Turn] = []

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        """Lock it. Waits until it is unlocked, at most `timeout` seconds. True if it has locked it."""
        if not self._locked:
            self._locked = True
            return True
        if not blocking and timeout != -1:
            raise ValueError("can't specify a timeout for a non-blocking call")
        if timeout < 0 and timeout != -1:
            raise ValueError("timeout value must be a non-negative number")
        if not blocking:
            return False
        return self._await(None if timeout == -1 else timeout)

    def _await(self, timeout: float | None) -> bool:
        turns = self.turns
        me, clock = turns.running, turns._clock
        if _thread.get_ident() != me.ident:  # a thread of a library that this clock does not follow
            while self._locked:
                _REAL_PAUSE(0.001)
            self._locked = True
            return True
        self._waiting.append(me)
        if not turns.wait(clock.end_of(timeout), listens=False):
            clock.refuse_lock()
        if me in self._waiting:
            self._waiting.remove(me)
            return False
        return True

    def release(self) -> None:
        """Unlock it, or hand it over to the thread that has waited longest."""
        if not self._locked:
            raise RuntimeError("release unlocked lock")
        if self._waiting:
            self.turns.wake(self._waiting.pop(0))
        else:
            self._locked = False

    def locked(self) -> bool:
        """True if it is locked."""
        return self._locked

    def _at_fork_reinit(self) -> None:
        self._locked = False
        self._waiting = []

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(self, *error: object) -> None:
        self.release()

    def __repr__(self) -> str:
        return "<{} lock at {:#x}>".format("locked" if self._locked else "unlocked", id(self))


def install(turns: Turns) -> None:
    """Let the threads and locks of this process take turns."""
    Lock.turns = turns
    module: Any = threading
    module.Lock = module._allocate_lock = Lock
    module._CRLock = None  # RLock is then the one in Python, of our locks
    module._time = time.monotonic
    for owner, name in ((_thread, "start_new_thread"), (_thread, "start_new"), (module, "_start_new_thread")):
        if hasattr(owner, name):
            setattr(owner, name, _starting(turns))
    if hasattr(module, "_start_joinable_thread"):  # Python 3.13
        real = module._start_joinable_thread

        def start(function: Any, handle: Any = None, daemon: bool = True) -> Any:
            return turns.start(real, function, (), handle=handle, daemon=daemon)

        module._start_joinable_thread = _thread.start_joinable_thread = start  # type: ignore[attr-defined]
    _replace_ends(turns, module)


def _starting(turns: Turns) -> Callable[..., Any]:
    def start(function: Any, arguments: Any, *named: Any) -> Any:
        return turns.start(_START, function, (arguments, *named))

    return start


def _replace_ends(turns: Turns, module: Any) -> None:
    """Waits for the end of a thread."""
    real_join, real_alive, real_shutdown = (
        module.Thread.join,
        module.Thread.is_alive,
        module._shutdown,
    )

    def join(thread: Any, timeout: float | None = None) -> None:
        turn = getattr(thread, "_simmer_turn", None)
        if turn is None or turn is turns.running or not thread._started.is_set():
            real_join(thread, timeout)  # it has the right error messages
            return
        turns.join(turn, timeout)
        if turn.ended:
            real_join(thread)  # of microseconds

    def is_alive(thread: Any) -> bool:
        turn = getattr(thread, "_simmer_turn", None)
        if turn is not None and turn.ended:
            real_join(thread)
        return bool(real_alive(thread))

    def shutdown() -> None:
        if not turns.has_only_this():
            # Those of concurrent.futures, which the system's function would call without giving up its turn.
            calls = getattr(module, "_threading_atexits", [])
            while calls:
                calls.pop()()
            me = threading.current_thread()
            while others := [each for each in threading.enumerate() if each is not me and not each.daemon]:
                others[0].join()
        real_shutdown()

    module.Thread.join, module.Thread.is_alive, module._shutdown = join, is_alive, shutdown
