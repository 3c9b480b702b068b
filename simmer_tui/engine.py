"""One robot behind one queue: every command passes here, in order, and is told to every watcher.

All methods but the constructor run in the robot's event loop. The engine knows neither how
commands arrive (a `Session` each) nor who watches. What it tells is in `events.py`.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

from simmer_tui import actions
from simmer_tui.errors import SimmerError
from simmer_tui.events import (
    Action,
    ActionDone,
    ActionName,
    Event,
    MovementEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
    Watcher,
    Watchers,
)
from simmer_tui.pace import Pacer
from simmer_tui.sim.command import Command
from simmer_tui.sim.records import Outcome, Status
from simmer_tui.sim.simulator import Simulator
from simmer_tui.sim.trajectory import Trajectory

SLICE = 16
"""Commands done in one turn of the event loop, so that a flood delays nobody else for long."""
Answer = Callable[[Outcome], None]


class Session:
    """Someone who sends commands. Their commands are answered in order, one at a time."""

    def __init__(self, engine: Engine, *, answer_at_end: bool = True) -> None:
        self._engine = engine
        self.answer_at_end = answer_at_end
        """Whether a timed movement is answered when it ends, or at once as accepted."""
        self.queue: deque[_Queued] = deque()
        self.waiting = False
        """An answer is still to come; the next command must wait for it."""
        self.open = True
        self.late = 0
        """Answers that wait until a movement has been shown, the last of them until `late_until`, by
        the loop's clock."""
        self.late_until = 0.0

    def submit(self, command: Command, answer: Answer) -> None:
        """Queue a command. `answer` is called with its outcome, perhaps before this returns."""
        if self.open:
            done = self._engine.halt(command) if command.stops else None
            self.queue.append(_Queued(command, answer, self._engine.halts, done))
            self._engine.wake(self)

    def close(self) -> None:
        """Forget what is queued; an answer still to come is dropped."""
        self.queue.clear()
        self.open = False


@dataclass(frozen=True, slots=True)
class _Queued:
    """A command that waits for its turn, and how many stops had been given when it came.

    A command that stops is done before its turn: only its answer, `done`, waits.
    """

    command: Command
    answer: Answer
    halts: int
    done: Outcome | None = None


@dataclass(frozen=True, slots=True)
class _Movement:
    """A timed movement under way as planned, and who is answered when it ends."""

    outcome: Outcome
    trajectory: Trajectory
    session: Session | None = None
    answer: Answer | None = None


class Engine:
    """Runs the commands of all sessions on one simulator.

    With `timed` motion simulated time follows the loop's clock times `time_scale`; otherwise each
    movement is over at once. `step_time` is a pause, seconds, before every answer.
    """

    def __init__(
        self,
        simulator: Simulator,
        *,
        timed: bool = False,
        time_scale: float = 1.0,
        step_time: float = 0.0,
    ) -> None:
        self.simulator = simulator
        self.timed = timed
        self.time_scale = time_scale
        self.step_time = step_time
        self.before_drive: Callable[[], None] | None = None
        """Called before each movement: what was said before it on other connections comes first."""
        self.halts = 0
        """How often all motion was stopped by a command. Drives that came before such a stop and
        wait for their turn do not begin: counting makes a stop cost the same however many wait."""
        self._pacer: Pacer | None = None
        self._watchers = Watchers(self._tell_fault)
        self._ready: deque[Session] = deque()
        self._running = False
        self._slice = SLICE
        self._paused = False
        self._steps = 0
        self._loop: asyncio.AbstractEventLoop | None = None
        self._origin = 0.0
        self._movement: _Movement | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._held: list[Session] = []

    def session(self, *, answer_at_end: bool = True) -> Session:
        """A new sender of commands."""
        return Session(self, answer_at_end=answer_at_end)

    # -- watchers ----------------------------------------------------------------------------

    def watch(self, watcher: Watcher) -> None:
        """Have every event passed to `watcher`, in order."""
        self._watchers.add(watcher)

    def unwatch(self, watcher: Watcher) -> None:
        """Pass no more events to `watcher`."""
        self._watchers.remove(watcher)

    def tell(self, event: Event) -> None:
        """Pass an event to all watchers (see `Watchers.tell`)."""
        self._watchers.tell(event)

    def _tell_fault(self, text: str) -> None:
        self.tell(Notice(NoticeKind.FAULT, text))

    # -- pace --------------------------------------------------------------------------------

    def paced(self, loop: asyncio.AbstractEventLoop, pace: float) -> Pacer:
        """Have movements that are over at once shown, and answered, at a pace (simulated seconds a
        second, 0 as fast as possible), with `loop` to be started in. Those who are to see it so
        become watchers of what is returned. Timed motion takes its time by itself."""
        self._pacer = Pacer(loop, 0.0 if self.timed else pace, self._tell_fault)
        self.watch(self._pacer.watch)
        return self._pacer

    @property
    def pacer(self) -> Pacer | None:
        """What shows movements at a pace; None where nobody looks on."""
        return self._pacer

    def shown_time(self) -> float:
        """The simulated time of what those see who watch at the pace: the present, or a moment of the
        movement they are being shown."""
        shown = self._pacer.time() if self._pacer is not None else None
        return self.now() if shown is None else shown

    # -- time --------------------------------------------------------------------------------

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Begin: simulated time runs from here."""
        self._loop = loop
        self._slice = SLICE
        self._set_clock()

    def now(self) -> float:
        """Bring the simulator to the present and return simulated time."""
        if self.timed and not self._paused and self._loop is not None:
            self.simulator.advance((self._loop.time() - self._origin) * self.time_scale)
        return self.simulator.time

    def _set_clock(self) -> None:
        if self._loop is not None:
            self._origin = self._loop.time() - self.simulator.time / self.time_scale
            self._set_timer()

    # -- people --------------------------------------------------------------------------------

    @property
    def paused(self) -> bool:
        """Whether commands wait and simulated time stands still."""
        return self._paused

    @property
    def has_waiting(self) -> bool:
        """Whether a command waits for the pause to end."""
        return self._paused and any(session.queue for session in self._ready)

    def perform(self, action: Action) -> ActionDone:
        """Do what a person asks for, between two commands. Watchers hear of it, refused or not."""
        self.now()
        self._catch_up()
        running, self._running = self._running, True  # no command comes before watchers have heard
        try:
            try:
                text, refused = actions.apply(self.simulator, action), False
            except SimmerError as error:
                text, refused = str(error), True
            else:
                self._follow(action)
            done = ActionDone(self.simulator.time, action, text, self.simulator.pose, refused)
            self.tell(done)
        finally:
            self._running = running
        self._pump()
        return done

    def _follow(self, action: Action) -> None:
        """The engine's own part of an action."""
        if action.name is ActionName.SPEED:
            self.time_scale = action.arguments[0]
        elif action.name in (ActionName.PAUSE, ActionName.RESUME):
            self._paused = action.name is ActionName.PAUSE
            self._steps = 0
        if self._movement is not None and not self.simulator.moving:
            self._movement_over(stopped_by=f"{action.name} from {action.source}")
        elif self._movement is not None and self.simulator.trajectory is not self._movement.trajectory:
            self._replan(self._movement)  # the block is in its way now, or no more
        self._set_clock()

    def _replan(self, movement: _Movement) -> None:
        trajectory = self.simulator.trajectory
        assert trajectory is not None, "a movement that is not over has a trajectory"
        self._movement = replace(movement, trajectory=trajectory)
        outcome = movement.outcome
        self.tell(MovementPlanned(outcome.number, self.simulator.time, outcome.command, trajectory))

    def step(self) -> None:
        """While paused, finish the movement under way or let the next command through, whole."""
        if not self._paused:
            return
        if self._movement is not None:
            self._movement_over()
        else:
            self._steps += 1
            self._pump()

    # -- commands ----------------------------------------------------------------------------

    def wake(self, session: Session) -> None:
        """A session has a command. Does it now if nothing is in the way."""
        if not session.waiting and session not in self._ready:
            self._ready.append(session)
        self._pump()

    def _pump(self) -> None:
        """Do commands, one of each session in turn, until none is left or the slice is used up."""
        if self._running:
            return
        self._running = True
        try:
            while self._ready:
                if self._paused and not self._steps:
                    return
                if self._slice == 0 and self._loop is not None:
                    return
                session = self._ready.popleft()
                if not session.queue:
                    continue
                if self._paused:
                    self._steps -= 1
                self._count_down()
                self._do(session, session.queue.popleft())
                if session.queue and not session.waiting and session not in self._ready:
                    self._ready.append(session)
        finally:
            self._running = False

    def _count_down(self) -> None:
        """Count a command; after a slice of them the loop has its turn, whoever sent them."""
        self._slice -= 1
        if self._slice == 0 and self._loop is not None:
            self._loop.call_soon(self._next_slice)

    def _next_slice(self) -> None:
        self._slice = SLICE
        self._pump()

    def _do(self, session: Session, queued: _Queued) -> None:
        simulator, command, answer = self.simulator, queued.command, queued.answer
        if queued.done is not None:
            self._reply(session, answer, queued.done)
            return
        is_drive = simulator.is_drive(command)
        if is_drive and queued.halts != self.halts:  # it was meant for before the stop
            command = replace(command, stops=True)
        elif is_drive and self.before_drive is not None:
            self.before_drive()
        if not self.timed or self._paused:
            self._answer(session, answer, self._execute(command))
            return
        self.now()
        if self._movement is not None and not simulator.moving:
            self._movement_over()  # it is due, the timer only has not been called yet
        if self._movement is not None and session.answer_at_end and is_drive and not command.stops:
            session.queue.appendleft(queued)  # another's movement: wait for its end
            self._hold(session)
            return
        outcome = self._begin(command)
        if outcome.status is not Status.ACCEPTED:
            self._answer(session, answer, outcome)
        elif session.answer_at_end:
            self._movement = replace(self._under_way, session=session, answer=answer)
            self._hold(session)
        else:
            self._answer(session, answer, outcome)

    def _execute(self, command: Command, answers: bool = True) -> Outcome:
        """Do a whole command at once; `answers` tells that its outcome is told next."""
        outcome = self.simulator.begin(command)
        if outcome.status is not Status.ACCEPTED:
            return outcome
        planned = self.simulator.trajectory
        assert planned is not None, "what was accepted moves"
        self.tell(MovementPlanned(outcome.number, outcome.time, command, planned, outcome.grip))
        done = self.simulator.finish(outcome)
        trajectory = self.simulator.last_trajectory
        assert trajectory is not None, "what was finished has moved"
        self.tell(MovementEnded(done.number, done.time, command, trajectory, "", answers, done.grip))
        return done

    def _begin(self, command: Command) -> Outcome:
        """Begin a command in real time; a movement then goes on by itself."""
        outcome = self.simulator.begin(command)
        if outcome.status is Status.ACCEPTED:
            planned = self.simulator.trajectory
            assert planned is not None, "what was accepted moves"
            self._movement = _Movement(outcome, planned)
            self.tell(MovementPlanned(outcome.number, outcome.time, command, planned, outcome.grip))
            self._set_timer()
        return outcome

    @property
    def _under_way(self) -> _Movement:
        assert self._movement is not None, "no movement is under way"
        return self._movement

    def halt(self, command: Command) -> Outcome:
        """End all motion now, whatever is queued; drives that wait for their turn do not begin."""
        self.now()
        self._catch_up()
        running, self._running = self._running, True  # nothing begins before watchers have heard
        try:
            self.halts += 1
            self.stop_motion(f"{command.shown} from {command.source}")
            outcome = self.simulator.begin(command)
            self.tell(outcome)
        finally:
            self._running = running
        self._pump()
        return outcome

    def stop_motion(self, by: str) -> None:
        """End the movement under way now, if there is one; `by` says who wants it."""
        self.simulator.stop()
        if self._movement is not None:
            self._movement_over(stopped_by=by)

    def _hold(self, session: Session) -> None:
        session.waiting = True
        self._held.append(session)

    def _answer(self, session: Session, answer: Answer, outcome: Outcome) -> None:
        self.tell(outcome)
        self._reply(session, answer, outcome)

    def _reply(self, session: Session, answer: Answer, outcome: Outcome) -> None:
        if self.step_time and self._loop is not None:
            session.waiting = True
            self._loop.call_later(self.step_time, self._answer_late, session, answer, outcome)
        else:
            self._hand_over(session, answer, outcome)

    def _answer_late(self, session: Session, answer: Answer, outcome: Outcome) -> None:
        session.waiting = False
        self._hand_over(session, answer, outcome)
        self.wake(session)

    def _hand_over(self, session: Session, answer: Answer, outcome: Outcome) -> None:
        """Give an answer: that of a movement when it has been shown, and what follows after it."""
        pacer = self._pacer
        if pacer is None or not pacer.busy or not (session.late or outcome.trajectory is not None):
            _give(session, answer, outcome)
            return
        if outcome.trajectory is not None:
            session.late_until = pacer.until
        session.late += 1
        pacer.later(session.late_until, lambda: _give_late(session, answer, outcome))

    def _catch_up(self) -> None:
        """Someone intervenes: what is shown is the present again, so that it is seen at once."""
        if self._pacer is not None:
            self._pacer.catch_up()

    def mirror(self, command: Command) -> Outcome:
        """Do at once what a real robot has been told to do. Watchers hear of the movement, but not of
        the answer: the asker knows more.

        A movement that is still under way here is over for the real robot: it is finished first.
        """
        self.now()
        if self._movement is not None:
            self._movement_over()
        if self.timed and not self._paused:
            return self._begin(command)
        return self._execute(command, answers=False)

    # -- timed movements ---------------------------------------------------------------------

    def _set_timer(self) -> None:
        """Have the movement under way end on time; while paused it does not end."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        trajectory = self.simulator.trajectory
        if self._movement is not None and trajectory is not None and not self._paused:
            assert self._loop is not None, "timed motion needs a started engine"
            due = self._origin + trajectory.end_time / self.time_scale
            self._timer = self._loop.call_at(due, self._movement_over)

    def _movement_over(self, stopped_by: str = "") -> None:
        movement = self._under_way
        self._movement = None
        self._set_timer()
        outcome = self.simulator.finish(movement.outcome)
        trajectory = self.simulator.last_trajectory
        assert trajectory is not None, "what was finished has moved"
        session, answer = movement.session, movement.answer
        answers = session is not None and answer is not None
        self.tell(
            MovementEnded(
                outcome.number,
                outcome.time,
                outcome.command,
                trajectory,
                stopped_by if trajectory.cut is not None else "",
                answers,
                outcome.grip,
            )
        )
        held, self._held = self._held, []
        for each in held:
            each.waiting = False
        if session is not None and answer is not None:
            self._answer(session, answer, outcome)
        for each in held:
            self.wake(each)


def _give(session: Session, answer: Answer, outcome: Outcome) -> None:
    if session.open:
        answer(outcome)


def _give_late(session: Session, answer: Answer, outcome: Outcome) -> None:
    session.late -= 1
    _give(session, answer, outcome)
