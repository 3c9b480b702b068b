"""Continuous motion of one robot for many senders: the velocity in force, and the sessions that wait.

All methods run in the robot's event loop.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass

from simmer_tui.robot.sessions import SLICE_SECONDS, Session
from simmer_tui.robot.timers import LoopTimer
from simmer_tui.run.events import (
    Event,
    LegBegun,
    LegEnded,
    Notice,
    NoticeKind,
    VelocityEnd,
    VelocityEnded,
)
from simmer_tui.sim.command import Command
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.records import CommandResult
from simmer_tui.sim.simulator import Simulator

# People notice within about a second that a robot does not move as its program says.
_SILENT = 1.0
"""Real seconds of silence with a moving robot after which a program gets advice about simulated time."""


@dataclass(slots=True, eq=False)
class _Wait:
    """A session that waits until a simulated time, and the function to call then."""

    until: float
    session: Session
    over: Callable[[], None]


class Driving:
    """Tells the events of continuous motion, and advances simulated time for sessions that wait."""

    def __init__(self, simulator: Simulator, tell: Callable[[Event], None]) -> None:
        self._simulator = simulator
        self._tell = tell
        self._loop: asyncio.AbstractEventLoop | None = None
        self._latest: tuple[int, Command] = (0, Command(""))
        """Number and text of the velocity commanded last."""
        self._moved_by = self._latest
        """The same of the leg under way."""
        self.driver: Hashable | None = None
        """Owner of the velocity in force; None while there is none."""
        self._end = VelocityEnd.TIME
        self.limit_after: Callable[[float], float] = lambda now: math.inf
        """Next simulated time, from one on, at which a mission may run out: no wait goes beyond it in one
        step."""
        self.limit_reached: Callable[[float], None] = lambda now: None
        """Called with simulated time when a wait has come to the limit."""
        self.paused = False
        """True while simulated time stands still for waits."""
        self._waits: list[_Wait] = []
        self._slicing = False
        self._warned: set[Hashable] = set()
        self._silence = LoopTimer(self._is_silent)
        simulator.listener = self

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Set the event loop: from now on waits share it with everything else."""
        self._loop = self._silence.loop = loop

    # -- what the simulator says -------------------------------------------------------------------

    def leg_begun(self, leg: Leg) -> None:
        """Tell watchers that a leg begins."""
        self._moved_by = self._latest
        self._tell(LegBegun(*self._moved_by, leg))

    def leg_ended(self, leg: Leg) -> None:
        """Tell watchers that a leg is over."""
        self._tell(LegEnded(*self._moved_by, leg))

    def velocity_expired(self, time: float) -> None:
        """Tell watchers that the time of a velocity is over."""
        self._tell(VelocityEnded(time, self._end))

    # -- commands ------------------------------------------------------------------------------------

    @property
    def drives(self) -> bool:
        """True while a velocity is in force."""
        return self._simulator.leg is not None

    def begin(self, command: Command, session: Session | None) -> CommandResult:
        """Begin a command. A velocity that it sets belongs to the session's driver."""
        simulator, before = self._simulator, self._latest
        drove = simulator.velocity.moves
        self._latest = (simulator.commands + 1, command)
        result = simulator.begin(command)
        change = result.velocity
        if change is None or not change.changed:
            self._latest = before
        if change is not None:
            self.driver = session.owner if session is not None and change.twist.moves else None
            self._end = VelocityEnd.TIMEOUT if change.times_out else VelocityEnd.TIME
        elif drove and not simulator.velocity.moves:
            self._tell(VelocityEnded(simulator.time, VelocityEnd.MOVEMENT, command.source))
        return result

    def ended(self, reason: VelocityEnd, source: str, drove: bool) -> None:
        """Tell that a velocity was ended by a stop, a person or a movement, if the robot `drove` before
        it."""
        if drove and not self._simulator.velocity.moves:
            self.driver = None
            self._tell(VelocityEnded(self._simulator.time, reason, source))

    def forget(self, session: Session) -> None:
        """End the waits of a session that has left."""
        self._end_waits(lambda wait: wait.session is session)

    def left(self, driver: Hashable) -> None:
        """End the velocity of a driver that has left."""
        self._warned.discard(driver)
        if self.driver != driver:
            return
        self.driver = None
        if self._simulator.velocity.moves:
            self._tell(VelocityEnded(self._simulator.time, VelocityEnd.LEFT))
            self._simulator.release()

    def take_over(self, begun: LegBegun | None) -> None:
        """Tell the simulator's events from here on, after a prefix that was replayed by others. The velocity
        of the leg that `begun` there ends: its program has left."""
        self._simulator.listener = self
        if begun is not None:
            self._latest = self._moved_by = begun.number, begun.command
            self.left(self.driver)

    # -- waits -----------------------------------------------------------------------------------------

    @property
    def waits(self) -> bool:
        """True if any session waits."""
        return bool(self._waits)

    @property
    def first_over(self) -> float:
        """Simulated time at which the first wait is over; infinite if no session waits."""
        return min((wait.until for wait in self._waits), default=math.inf)

    def wait(self, session: Session, until: float, over: Callable[[], None]) -> None:
        """Call `over` when simulated time is `until`, or the wait is cut."""
        self._waits.append(_Wait(until, session, over))

    def settle(self) -> None:
        """End the waits whose time has come."""
        now = self._simulator.time
        self._end_waits(lambda wait: wait.until <= now)

    def cut(self) -> None:
        """End all waits at the time reached so far."""
        self._end_waits(lambda wait: True)

    def _end_waits(self, is_over: Callable[[_Wait], bool]) -> None:
        ended = [wait for wait in self._waits if is_over(wait)]
        # Before the first call: it may begin the next wait at once.
        self._waits = [wait for wait in self._waits if not is_over(wait)]
        for wait in ended:
            wait.over()

    def pass_time(self) -> None:
        """Advance simulated time for the waits, in slices of processor time."""
        if self._slicing:
            return
        self._slicing = True
        try:
            self._pass_slice()
        finally:  # a sender's answer may fail; others wait on
            self._slicing = False
        if self._waits and self._loop is not None and not self.paused:
            self._loop.call_soon(self.pass_time)

    def _pass_slice(self) -> None:
        begun = time.perf_counter()
        while self._waits and not self.paused:
            until = self.first_over
            # The next float after the limit: what happens at the limit itself still counts.
            beyond = math.nextafter(self.limit_after(self._simulator.time), math.inf)
            passes = self._simulator.time < beyond <= until
            until = beyond if passes else until
            self._simulator.advance(min(until, self._simulator.next_event))
            if passes and self._simulator.time >= beyond:
                self.limit_reached(self._simulator.time)
            self.settle()
            if self._loop is not None and time.perf_counter() - begun > SLICE_SECONDS:
                return

    def pause(self, paused: bool) -> None:
        """Stop simulated time for waits in instant motion, or continue."""
        self.paused = paused
        if self._waits and not paused:
            self.pass_time()

    def catch_up(self, target: float) -> bool:
        """Advance simulated time to `target`. False if that takes more than a slice: time has not reached it
        then."""
        begun = time.perf_counter()
        while self._simulator.next_event <= target:
            self._simulator.advance(self._simulator.next_event)
            if time.perf_counter() - begun > SLICE_SECONDS:
                return False
        self._simulator.advance(target)
        return True

    # -- silence ---------------------------------------------------------------------------------------

    def answered(self, session: Session, *, by_hand: bool = False) -> None:
        """Start the silence timer after an answer to the owner of a velocity, a program or a person: in
        instant motion only it can continue."""
        driver = self.driver
        if driver is None:
            return
        self._silence.cancel()
        if session.owner == driver and self._loop is not None and driver not in self._warned:
            notice = Notice(NoticeKind.HINT, PAUSED_BY_HAND if by_hand else PAUSED, advice=not by_hand)
            self._silence.set_in(_SILENT, driver, notice)

    def _is_silent(self, driver: Hashable, notice: Notice) -> None:
        if driver == self.driver and self._simulator.velocity.moves and not self._waits:
            self._warned.add(driver)
            self._tell(notice)


PAUSED = (
    f"the program paused for over {_SILENT:g} s while its robot drives. In instant motion simulated time "
    "passes only by commands: send wt-2 (robot.sleep(2) in Python), or run with --clock program or --motion "
    "timed"
)
"""Advice to a program that waits by its own clock in instant motion."""
PAUSED_BY_HAND = (
    "to drive on, type wt-2: in instant motion simulated time passes only by commands. "
    ":vv VX VY OMEGA drives for a second"
)
"""Advice to a person who has typed a velocity in instant motion."""
