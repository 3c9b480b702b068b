"""The order of commands: senders take turns, in slices, so that a flood from one delays the others little.

All methods but the constructors run in the robot's event loop, once that has started. The engine decides what
a command does and when it is answered.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field

from msgspec import Struct

from simmer_tui.sim.command import Command
from simmer_tui.sim.records import CommandResult

# Judged: far less than the 100 ms between two frames of the screen, and than the latency a stop may have.
SLICE, SLICE_SECONDS = 16, 0.002
"""Commands of a lane done in one turn of the event loop, and its limit of time, seconds, for lanes of many
connections and for waits. A flood of commands delays the others by no more."""
# About a millisecond of processor time.
FOREIGN_SLICE = 100
"""Busy answers given to a sender in one turn of the event loop."""
Answer = Callable[[CommandResult], None]
Answered = Callable[[Sequence[CommandResult], bytes | None], None]
"""Takes the results, one a command, and the bytes to pass on unchanged as the reply. Without bytes (None) a
link writes the results in its own dialect. A query is no command: it has bytes and no results."""


# A dataclass with slots: its fields change with every command, which costs more with a msgspec struct.
@dataclass(slots=True, eq=False)
class Lane:
    """Sessions that share a turn, such as all connections of a port. Many of them get no more turns than
    one."""

    seconds: float | None
    """Seconds after which its slice is used up; None without such a limit."""
    ready: deque[Session] = field(default_factory=deque)
    """Sessions with a command to be done now."""
    left: int = SLICE
    spent: float = 0.0


class Stop(Struct):
    """The result of a command that stops, once it has arrived over the link. `reply_delay` is that of its
    answer, simulated seconds. `awaited` is true if its turn came before it: its session waits for it.

    A stop is done before its turn; only its answer waits.
    """

    result: CommandResult | None = None
    reply_delay: float = 0.0
    awaited: bool = False


class Queued(Struct, eq=False):
    """A command of a session that waits for its turn or its answer.

    `halts` is the count of stops when it came. `moment` has all commands of its message in the first of them;
    it is empty in the others. `request_delay` is its delay on the link, simulated seconds; None before it has
    arrived. `given` is true once it has its answer.
    """

    session: Session
    command: Command
    answered: Answered
    halts: int
    moment: Sequence[Command] = ()
    stop: Stop | None = None
    request_delay: float | None = None
    given: bool = False


class Foreign(Struct, eq=False):
    """A message that others answer: a real robot, or the part that refuses it. It keeps its place in the
    queue until its answer is `given`, and its turn has come. `slices` is true for those that come by the
    thousand."""

    session: Session
    answered: Answered
    slices: bool = False
    given: bool = False
    results: Sequence[CommandResult] = ()
    data: bytes | None = None


@dataclass(slots=True, eq=False)
class Session:
    """One sender of commands to the robot, simulated or real. Answers are given in the order of the commands.

    The simulated robot does one command of a session at a time. A real one gets all of them at once.
    """

    lane: Lane
    on_submit: Callable[[Session, Sequence[Command], Answered], Queued]
    on_close: Callable[[Session], None]
    answer_at_end: bool = True
    """True if a timed movement is answered when it ends; False if it is answered at once as accepted."""
    driver: Hashable | None = None
    """Owner of the velocities that it sets; None for its own."""
    ready: bool = False
    """True if the session is in its lane's queue `ready`, or a later turn of the loop continues its
    answers."""
    queue: deque[Queued | Foreign] = field(default_factory=deque)
    waiting: bool = False
    """True while an answer is pending; the next command must wait for it."""
    open: bool = True
    late: int = 0
    """Answers that wait until a movement has been shown, the last of them until `late_until`, by the loop's
    clock."""
    late_until: float = 0.0
    asks: bool = False
    """True if its newest message was a query, which no robot gets."""
    has_gone: bool = False
    """True if nobody will read its answers. Its earlier commands are still done, but without waits."""
    unsettled: dict[Queued | Foreign, Callable[[], None]] = field(default_factory=dict)
    """Calls to be made once a message has its answer, or is dropped."""
    others: dict[object, Callable[[Session], None]] = field(default_factory=dict)
    """Real robots that may have messages of it, and the call that drops these."""

    @property
    def owner(self) -> Hashable:
        """Owner of the velocities that it sets."""
        return self if self.driver is None else self.driver

    def submit(self, command: Command, answer: Answer) -> None:
        """Queue a command that came alone, for the simulated robot. `answer` is called with its result,
        perhaps before this returns."""
        if self.open:
            self.on_submit(self, (command,), lambda results, data: answer(results[0]))

    def give(
        self,
        queued: Queued | Foreign,
        results: Sequence[CommandResult],
        data: bytes | None = None,
        *,
        was_late: bool = False,
    ) -> None:
        """Give an answer, unless the session is closed. `was_late` is true if it waited for a movement to be
        shown."""
        self.late -= was_late
        queued.given = True
        if self.unsettled:
            self.settle(queued)
        if self.open:
            queued.answered(results, data)

    def settle(self, queued: Queued | Foreign) -> None:
        """Make the call for a message that has its answer."""
        call = self.unsettled.pop(queued, None)
        if call is not None:
            call()

    def close(self) -> None:
        """Drop all queued commands and pending answers."""
        # A movement that has begun continues without its program; a velocity would never end, so it is ended.
        self.queue.clear()
        for queued in tuple(self.unsettled):
            self.settle(queued)
        for forget in self.others.values():
            forget(self)
        self.others.clear()
        if self.open:
            self.open = False
            self.on_close(self)


class Scheduler:
    """Does the sessions' commands, one of each lane in turn. While `paused`, only `steps` of them."""

    def __init__(self, do: Callable[[Queued | Foreign], None]) -> None:
        """`do` does a command whose turn has come, or gives an answer of others."""
        self.paused = False
        self.steps = 0
        self._do = do
        self._loop: asyncio.AbstractEventLoop | None = None
        self._lanes: dict[str, Lane] = {}
        self._turns: deque[Lane] = deque()
        """The lanes with something to do and some of their slice left, the next one first."""
        self._used_up: set[Lane] = set()
        """The lanes without any of their slice left until the next turn of the event loop."""
        self._running = False

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Use an event loop from now on: slices count. Before, commands are done at once."""
        self._loop = loop

    def lane(self, name: str) -> Lane:
        """The lane with a name; its slice is limited in time as well. Without a name, a new one of a single
        sender, without that limit. Any thread may ask for a new one."""
        # Only lanes of many connections need the limit: a single client cannot send its next command before
        # its turn is over.
        if not name:
            return Lane(None)
        if name not in self._lanes:
            self._lanes[name] = Lane(SLICE_SECONDS)
        return self._lanes[name]

    @property
    def has_waiting(self) -> bool:
        """True if a command waits for the pause to end."""
        busy = (*self._turns, *self._used_up)
        return self.paused and any(session.queue for lane in busy for session in lane.ready)

    def submit(self, queued: Queued) -> None:
        """Do a command now, or in its turn."""
        session = queued.session
        has_turn = session.lane.left and not (session.queue or session.waiting or session.ready)
        if has_turn and not (self._turns or self._running or self.paused):
            # The usual case needs no queue: nothing else is to be done before it.
            self._running = True
            try:
                self._do_next(queued)
            finally:
                self._running = False
        else:
            session.queue.append(queued)
        if session.queue or self._turns:
            self.wake(session)

    def wake(self, session: Session) -> None:
        """Do a session's next command now, unless something prevents it."""
        self._line_up(session)
        self.run()

    @contextlib.contextmanager
    def holding(self) -> Iterator[None]:
        """Do no command inside the `with` block, only after it."""
        running, self._running = self._running, True
        try:
            yield
        finally:
            self._running = running
        self.run()

    def run(self) -> None:
        """Do commands, one of each lane in turn, until none is left or all slices are used up."""
        # Answers may submit the next command at once: it is done in the loop below, without recursion.
        if self._running:
            return
        self._running = True
        try:
            # One of each lane in turn: a lane with a thousand commands delays another lane by one command.
            while self._turns:
                # The lane stays in the queue, so that a pause does not change the order.
                if self.paused and not self.steps:
                    return
                lane = self._turns.popleft()
                if not lane.left:
                    continue
                session = lane.ready.popleft()
                # The session goes behind the others of its lane, after its command.
                session.ready = False
                if session.queue:
                    self.steps -= self.paused
                    self._do_next(session.queue.popleft())
                if session.queue:
                    self._line_up(session)
                if lane.ready:
                    self._take_turn(lane)
        finally:
            self._running = False

    def _line_up(self, session: Session) -> None:
        if not session.queue:
            return
        if isinstance(session.queue[0], Foreign):
            self._hand_out(session)
        if not (session.waiting or session.ready) and session.queue and isinstance(session.queue[0], Queued):
            session.ready = True
            session.lane.ready.append(session)
            self._take_turn(session.lane)

    def _hand_out(self, session: Session) -> None:
        """Give the answers of others whose turn has come. After a slice of them the event loop has a turn; a
        pause does not hold them up."""
        left = FOREIGN_SLICE
        while not (session.waiting or session.ready) and session.queue:
            first = session.queue[0]
            if isinstance(first, Queued) or not first.given:
                return
            # After the end of the run there is no loop to share.
            if first.slices and not left and self._loop is not None and self._loop.is_running():
                session.ready = True
                self._loop.call_soon(self._go_on, session)
                return
            left -= first.slices
            session.queue.popleft()
            self._do(first)

    def _go_on(self, session: Session) -> None:
        session.ready = False
        self.wake(session)

    def _take_turn(self, lane: Lane) -> None:
        if lane.ready and lane.left and lane not in self._turns:
            self._turns.append(lane)

    def _do_next(self, queued: Queued | Foreign) -> None:
        """Do a command. After a slice of commands the event loop has a turn, whoever sent them."""
        # Before the loop runs there is nobody else to delay, and no clock.
        loop, lane = self._loop, queued.session.lane
        if loop is None:
            self._do(queued)
            return
        if lane.seconds is None:
            self._do(queued)
        else:
            begun = loop.time()
            self._do(queued)
            lane.spent += loop.time() - begun
        lane.left -= 1
        if lane.left == 0 or (lane.seconds is not None and lane.spent > lane.seconds):
            lane.left = 0
            self._used_up.add(lane)
            # Sockets and timers come before the next slice: this keeps the server responsive.
            loop.call_soon(self._next_slice, lane)

    def _next_slice(self, lane: Lane) -> None:
        lane.left, lane.spent = SLICE, 0.0
        self._used_up.discard(lane)
        self._take_turn(lane)
        self.run()
