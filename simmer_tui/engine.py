"""One robot behind one queue: every command passes here, in order, and every watcher gets its events.

All methods but the constructor run in the robot's event loop. The engine knows neither how
commands arrive (a `Session` each) nor who watches. What it tells is in `events.py`.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Hashable, Sequence

from msgspec import Struct, structs
from msgspec.structs import replace

from simmer_tui import actions
from simmer_tui.driving import Driving
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
    VelocityEnd,
    Watcher,
    Watchers,
    WireMessage,
)
from simmer_tui.playback_throttle import PlaybackThrottle
from simmer_tui.sessions import Answer, LinkDelay, LoopTimer, Queued, Scheduler, Session, Stop, TimerQueue
from simmer_tui.sim.command import Command
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import CommandResult, Status
from simmer_tui.sim.simulator import Simulator
from simmer_tui.sim.trajectory import Trajectory

# Keys and console sit at the screen: only what programs send travels to the robot over a link.
PEOPLE = frozenset(("console", "keys"))
"""Command sources that bypass the simulated link."""


class _Movement(Struct, frozen=True):
    """A timed movement under way as planned, and the command that is answered when it ends."""

    outcome: CommandResult
    trajectory: Trajectory
    queued: Queued | None = None


class Engine:
    """Runs the commands of all sessions on one simulator.

    With `timed` motion simulated time follows the loop's clock times `time_scale`; otherwise each
    movement is over at once. `step_time` is a pause, seconds, before every answer. `link` is what
    lies between programs and the robot. What reading a sensor and the link take, simulated time moves
    on by, or in timed motion it passes before the answer.
    """

    def __init__(
        self,
        simulator: Simulator,
        *,
        timed: bool = False,
        time_scale: float = 1.0,
        step_time: float = 0.0,
        link: LinkDelay | None = None,
    ) -> None:
        self.simulator = simulator
        self.timed = timed
        self.time_scale = time_scale
        self.step_time = step_time
        self._link = link
        # One queue for all that is due later: events at the same simulated time keep their order.
        self._timers = TimerQueue()
        self._alarm = LoopTimer(self._settle)
        self.before_drive: Callable[[], None] | None = None
        """Called before each movement, so that beliefs already received on other connections are processed
        first."""
        self.halts = 0
        """Count of stops of all motion by commands. Drives that came before such a stop and
        wait for their turn do not begin: counting makes a stop cost the same however many wait."""
        self.exchanges = False
        """True once something has gone over a dialect's line."""
        self.halted = False
        """True if no drive command has arrived since the last stop."""
        self.throttle: PlaybackThrottle | None = None
        """The throttle that shows movements at a pace; None without watchers."""
        self._watchers = Watchers(self.tell_fault)
        self.driving = Driving(simulator, self.tell)
        """Continuous motion, and those who wait."""
        self._scheduler = Scheduler(self._do)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._origin = 0.0
        self._movement: _Movement | None = None
        self._end = LoopTimer(self._movement_over)
        self._held: list[Session] = []

    def session(
        self, *, answer_at_end: bool = True, lane: str = "", driver: Hashable | None = None
    ) -> Session:
        """A new sender of commands. Lanes take turns, and within a lane its sessions do. One with a name
        is for any number of sessions, and bounded by time as well. `driver` is whose velocities it sets,
        by default its own."""
        its_lane = self._scheduler.lane(lane)
        return Session(its_lane, self._submitted, self._session_closed, answer_at_end, driver)

    def _session_closed(self, session: Session) -> None:
        """A sender has left."""
        self.cut_waits(session)
        if session.driver is session:
            self.driver_left(session)

    def cut_waits(self, session: Session) -> None:
        """A sender has gone: it waits no longer for time to pass."""
        session.has_gone = True
        if self.driving.waits:
            self.now()
            self.driving.forget(session)

    def driver_left(self, driver: Hashable) -> None:
        """Whoever drives has left: its velocity ends."""
        if self.simulator.velocity.moves:
            self.now()
        self.driving.left(driver)
        self._set_alarm()

    # -- watchers ----------------------------------------------------------------------------

    def watch(self, watcher: Watcher) -> None:
        """Have every event passed to `watcher`, in order."""
        self._watchers.add(watcher)

    def unwatch(self, watcher: Watcher) -> None:
        """Pass no more events to `watcher`."""
        self._watchers.remove(watcher)

    def tell(self, event: Event) -> None:
        """Pass an event to all watchers (see `Watchers.tell`)."""
        self.exchanges = self.exchanges or isinstance(event, WireMessage)
        self._watchers.tell(event)

    def tell_fault(self, text: str) -> None:
        """Tell what has gone wrong."""
        self.tell(Notice(NoticeKind.FAULT, text))

    # -- pace --------------------------------------------------------------------------------

    def paced(self, loop: asyncio.AbstractEventLoop, pace: float) -> PlaybackThrottle:
        """Have movements that are over at once shown, and answered, at a pace (simulated seconds a
        second, 0 as fast as possible), with `loop` to be started in. Those who are to see it so
        become watchers of what is returned. Timed motion takes its time by itself."""
        self.throttle = PlaybackThrottle(loop, 0.0 if self.timed else pace, self.tell_fault)
        self.watch(self.throttle.watch)
        return self.throttle

    def shown_time(self) -> float:
        """The simulated time of what those see who watch at the pace: the present, or a moment of the
        movement they are being shown."""
        shown = self.throttle.time() if self.throttle is not None else None
        return self.now() if shown is None else shown

    # -- time --------------------------------------------------------------------------------

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Begin: simulated time runs from here."""
        self._loop = self._alarm.loop = self._end.loop = loop
        self.driving.start(loop)
        self._scheduler.start(loop)
        self._set_clock()

    def now(self) -> float:
        """Bring the simulator to the present and return simulated time."""
        # While paused, or with instant motion, simulated time moves only by what commands take.
        if self._passes and self._loop is not None:
            present = (self._loop.time() - self._origin) * self.time_scale
            if not self.driving.catch_up(present):
                # Computing takes longer than it lasts: simulated time falls behind rather than all else.
                self._origin = self._loop.time() - self.simulator.time / self.time_scale
        return self.simulator.time

    @property
    def present(self) -> float:
        """Simulated time now, without bringing the simulator there. Any thread may ask."""
        if self._passes and self._loop is not None:
            return max((self._loop.time() - self._origin) * self.time_scale, self.simulator.time)
        return self.simulator.time

    def _set_clock(self) -> None:
        if self._loop is not None:
            # The clock is set anew after each pause and change of speed, so that simulated time never jumps.
            self._origin = self._loop.time() - self.simulator.time / self.time_scale
            self._set_timer()
            self._set_alarm()

    def call_at(self, time: float, call: Callable[[], None]) -> None:
        """Have something done at a simulated time; a pause holds it up as well."""
        self._timers.add(time, call)
        self._set_alarm()

    def _set_alarm(self) -> None:
        """Wake up when something is due next."""
        self._alarm.cancel()
        due = self._timers.due
        # In instant motion time waits for commands.
        due = min(due, self.simulator.next_event) if self.timed else due
        if due < math.inf and not self.paused:
            self._alarm.set_at(self._origin + due / self.time_scale, due)

    def _settle(self, until: float) -> None:
        """Do what is due by a simulated time."""
        self.now()
        # The loop's clock may round to just before the event that the timer was set for.
        if until < math.inf and (self.driving.waits or self.simulator.next_event <= until):
            self.driving.catch_up(until)
        while self._timers.due <= until and self._timers.due < math.inf:
            self._timers.pop()()
        self.driving.settle()
        self._set_alarm()

    # -- a replayed prefix ----------------------------------------------------------------------

    def draw_link(self, ways: int) -> float:
        """Draw the delay of messages of the replayed prefix; gives their sum, simulated seconds."""
        return sum(self._link.way() for _ in range(ways)) if self._link is not None else 0.0

    def restart_link(self) -> None:
        """Draw delays as after a reset in the replayed prefix."""
        if self._link is not None:
            self._link.restart(self.simulator.seed)

    # -- people --------------------------------------------------------------------------------

    @property
    def paused(self) -> bool:
        """True if commands wait and simulated time stands still."""
        return self._scheduler.paused

    @property
    def has_waiting(self) -> bool:
        """True if a command waits for the pause to end."""
        return self._scheduler.has_waiting

    def perform(self, action: Action) -> ActionDone:
        """Perform a person's action between two commands. Watchers get the event, even if it is refused."""
        # The present comes first: an action happens after all that was due before it.
        self.now()
        self._catch_up()
        if self._timers.due < math.inf:  # a run that restarts has nothing left to come
            self._settle(math.inf if action.name.restarts else self.simulator.time)
        with self._scheduler.holding():  # no command comes before watchers have the event
            drove = self.simulator.velocity.moves
            try:
                text, refused = actions.apply(self.simulator, action), False
            except SimmerError as error:
                text, refused = str(error), True
            else:
                self._follow(action)
                stops = action.name is ActionName.STOP
                self.driving.ended(VelocityEnd.STOP if stops else VelocityEnd.PLACED, action.source, drove)
                if stops or action.name.places:
                    self.driving.cut()
            done = ActionDone(self.simulator.time, action, text, self.simulator.pose, refused)
            self.tell(done)
        return done

    def drop(self, client: str) -> None:
        """Tell that a client has been dropped that does not read its replies, and stop the robot: there may
        be a stop among what it sent and nobody will read."""
        self.tell_fault(f"client {client} dropped: it does not read its replies")
        self.perform(Action(ActionName.STOP, source=f"client {client}"))

    def _follow(self, action: Action) -> None:
        """The engine's own part of an action."""
        if action.name is ActionName.SPEED:
            self.time_scale = action.arguments[0]
        elif action.name.restarts:
            self.restart_link()
        elif action.name in (ActionName.PAUSE, ActionName.RESUME):
            self._scheduler.paused = action.name is ActionName.PAUSE
            self._scheduler.steps = 0
            if not self.timed:
                self.driving.pause(self.paused)
        # An action may have ended the movement (reset, teleport): its sender still waits for the answer.
        if self._movement is not None and not self.simulator.moving:
            self._movement_over(stopped_by=f"{action.name} from {action.source}")
        elif self._movement is not None and self.simulator.trajectory is not self._movement.trajectory:
            self._replan(self._movement)  # the block is in its way now, or no more
        # The action may have changed the speed, the time or the pause, and with each of them the timers.
        self._set_clock()
        if action.name.restarts:  # answers of the run before come before the new run
            self._settle(math.inf)

    def _replan(self, movement: _Movement) -> None:
        trajectory = self.simulator.trajectory
        assert trajectory is not None, "a movement that is not over has a trajectory"
        self._movement = replace(movement, trajectory=trajectory)
        outcome = movement.outcome
        self.tell(MovementPlanned(outcome.number, self.simulator.time, outcome.command, trajectory))

    def step(self) -> None:
        """While paused, finish the movement under way or let the next command through, whole."""
        if not self.paused:
            return
        if self._movement is not None:
            self._settle(self._movement.trajectory.end_time)
            self._movement_over()
        elif self.driving.waits and not self.timed:
            self.simulator.advance(self.driving.first_over)
            self.driving.settle()
        elif self._timers.due < math.inf:
            self.simulator.advance(self._timers.due)
            self._settle(self._timers.due)
        else:
            self._scheduler.steps += 1
            self._scheduler.go_on()

    # -- commands ----------------------------------------------------------------------------

    def _submitted(
        self, session: Session, command: Command, answer: Answer, moment: Sequence[Command]
    ) -> None:
        """A session has been given a command: it waits for its turn, unless it stops."""
        stop = None
        # A stop is done before its turn: behind a queue of drives it would come too late.
        if not command.stops:
            self.halted = self.halted and not self._sets_going(command)
        elif not self.halted:
            stop = self._take_stop(session, command)
        # Else there is nothing to stop, and it may wait for its turn: they come by the thousand.
        session.queue.append(Queued(session, command, answer, self.halts, stop, moment=moment))
        self._scheduler.wake(session)

    def _do(self, queued: Queued) -> None:
        """Do a command whose turn has come."""
        if queued.command.stops:
            stop = queued.stop or self._take_stop(queued.session, queued.command)
            self._answer_stop(replace(queued, stop=stop), stop)
        elif not self._passes:
            command = self._meant_now(queued)
            # People look on: a program's loop is what takes time.
            if queued.moment and command.source not in PEOPLE:
                self.simulator.begin_pass(queued.moment)
            outcome = self._execute(command, queued.there, session=queued.session)
            if outcome.waits:
                self._answer(queued, outcome)
            else:  # nearly every command: a call less than by way of `_answer`
                self._complete(queued, outcome)
        else:
            self._settle_due()
            there = self._way(queued.command) if queued.there is None else 0.0
            if there:
                session, arrived = queued.session, replace(queued, there=there)
                self._go_on_at(self.simulator.time + there, session, session.queue_first, arrived)
            else:
                self._do_timed(queued)

    def _do_timed(self, queued: Queued) -> None:
        """Do a command that has come over the link, in real time."""
        session, command = queued.session, self._meant_now(queued)
        waits = session.answer_at_end and self.simulator.is_drive(command)
        if waits and self._movement is not None and queued.halts == self.halts:
            # In front again: the order of a sender's commands never changes.
            session.queue.appendleft(queued)  # another's movement: wait for its end
            self._hold(session)
            return
        outcome = self._begin(command, session)
        if outcome.status is Status.ACCEPTED and session.answer_at_end:
            self._movement = replace(self._under_way, queued=queued)
            self._hold(session)
        else:
            self._answer_in_time(queued, outcome, self._way(command))

    def _meant_now(self, queued: Queued) -> Command:
        """A command as it is to be done now: a drive that was meant for before a stop stops itself, unless
        it finds the robot busy with what was begun since."""
        command = queued.command
        # A drive from before a stop was meant for a robot that still moved. It is answered as a stop,
        # so that its sender gets a reply and the robot stays where it is.
        if queued.halts == self.halts:
            if self.before_drive is not None and self.simulator.is_drive(command):
                self.before_drive()
        elif self._sets_going(command) and not self.simulator.moving:
            return replace(command, stops=True)
        return command

    def _sets_going(self, command: Command) -> bool:
        """True if a command has the robot move: a drive, or a velocity."""
        return self.simulator.is_drive(command) or self.simulator.is_velocity(command)

    @property
    def _passes(self) -> bool:
        """True while time passes by the clock."""
        return self.timed and not self.paused

    def _go_on_at(self, time: float, session: Session, step: Callable[..., None], *arguments: object) -> None:
        """Have a session wait until a simulated time, and take its next step then."""
        session.waiting = True
        self.call_at(time, lambda: self._resume(session, step, *arguments))

    def _resume(self, session: Session, step: Callable[..., None], *arguments: object) -> None:
        """A session's wait is over: take the next step, and let it go on."""
        session.waiting = False
        step(*arguments)
        self._scheduler.wake(session)

    def _settle_due(self) -> None:
        """Time has come to the present: what is due by now, and a movement that is over, come first."""
        self.now()
        if self._timers.due <= self.simulator.time:
            self._settle(self.simulator.time)
        if self._movement is not None and not self.simulator.moving:
            self._movement_over()  # the timer only has not been called yet

    def _way(self, command: Command) -> float:
        """Time of a command, or of its answer, on the link, simulated seconds."""
        # Delays are drawn for programs alone, so that keys pressed meanwhile change no run of the same seed.
        return self._link.way() if self._link is not None and command.source not in PEOPLE else 0.0

    def _execute(
        self,
        command: Command,
        there: float | None = None,
        *,
        answers: bool = True,
        session: Session | None = None,
    ) -> CommandResult:
        """Do a whole command at once. `there` is what it has taken on the link already; else simulated
        time moves on by that. What nobody `answers` comes over no link."""
        simulator = self.simulator
        # The delay there is drawn before that back: logs are rerun with the same draws in the same order.
        if there is None:
            there = self._way(command) if answers else 0.0
            if there:
                simulator.advance(simulator.time + there)
        # In timed motion a turn takes its time by itself.
        if not self.timed:
            simulator.wait_for_scan(command)
        outcome = self.driving.begin(command, session)
        taken = outcome.time
        # Drawn even where nothing moves, so that the number of draws does not depend on the result.
        back = self._way(command) if answers else 0.0
        if outcome.status is Status.ACCEPTED:
            self._tell_planned(outcome)
            outcome = simulator.finish(outcome)
            self._tell_ended(outcome, answers=answers and not (there or back))
        elif outcome.reading is not None and outcome.reading.took:
            outcome = simulator.finish(outcome)
        if there or back:
            simulator.advance(simulator.time + back)
            outcome = structs.replace(outcome, time=simulator.time, taken=taken, link=there + back)
        return outcome

    def _begin(self, command: Command, session: Session | None = None) -> CommandResult:
        """Begin a command in real time; a movement or a velocity then goes on by itself."""
        outcome = self.driving.begin(command, session)
        if outcome.velocity is not None:
            self._set_alarm()
        if outcome.status is Status.ACCEPTED:
            self._movement = _Movement(outcome, self._tell_planned(outcome))
            self._set_timer()
        return outcome

    def _tell_planned(self, outcome: CommandResult) -> Trajectory:
        planned = self.simulator.trajectory
        assert planned is not None, "what was accepted moves"
        self.tell(MovementPlanned(outcome.number, outcome.time, outcome.command, planned, outcome.grip))
        return planned

    def _tell_ended(self, outcome: CommandResult, stopped_by: str = "", *, answers: bool) -> None:
        """Tell that a movement has ended; with `answers` it is the answer as well."""
        went = self.simulator.last_trajectory
        assert went is not None, "what was finished has moved"
        by = stopped_by if went.cut is not None else ""
        number, time, command, pose = outcome.number, outcome.time, outcome.command, outcome.pose
        self.tell(MovementEnded(number, time, command, went, pose, by, answers, outcome.grip))

    @property
    def _under_way(self) -> _Movement:
        assert self._movement is not None, "no movement is under way"
        return self._movement

    def _take_stop(self, session: Session, command: Command) -> Stop:
        """A command that stops has been given: it is done when it has come over the link."""
        stop, there = Stop(), self._way(command)
        if there and self._passes:
            self.call_at(self.now() + there, lambda: self._stop_arrives(session, command, stop, there))
            return stop
        if there:
            self.simulator.advance(self.simulator.time + there)
        self._do_stop(command, stop, there)
        return stop

    def _stop_arrives(self, session: Session, command: Command, stop: Stop, there: float) -> None:
        if not session.open:
            return
        # Its turn may have come while it was on its way; only then does the session wait for it.
        waits = session.waiting and bool(session.queue) and session.queue[0].stop is stop
        self._do_stop(command, stop, there)
        if waits:
            session.waiting = False
        self._scheduler.wake(session)

    def _do_stop(self, command: Command, stop: Stop, there: float) -> None:
        back = self._way(command)
        stop.outcome = self.halt(command, there + back, 0.0 if self._passes else back)
        stop.back = back if self._passes else 0.0

    def _answer_stop(self, queued: Queued, stop: Stop) -> None:
        """The turn of a command that stops has come: its answer goes back over the link."""
        session, outcome = queued.session, stop.outcome
        if outcome is None:
            session.waiting = True
            session.queue.appendleft(queued)
        elif stop.back and self._passes:
            self._go_on_at(self.now() + stop.back, session, self._hand_over, queued, outcome)
        else:
            self._reply(queued, outcome)

    def halt(self, command: Command, link: float = 0.0, back: float = 0.0) -> CommandResult:
        """End all motion now, whatever is queued; drives that wait for their turn do not begin. `link`
        is what command and answer take on the link; simulated time moves on by `back` of it."""
        self.now()
        self._catch_up()
        with self._scheduler.holding():  # nothing begins before watchers have the event
            self.forget_drives()
            self.stop_motion(f"{command.shown} from {command.source}")
            outcome = self.simulator.begin(command)
            if link:
                taken = outcome.time
                self.simulator.advance(taken + back)
                outcome = structs.replace(outcome, time=self.simulator.time, taken=taken, link=link)
            self.tell(outcome)
            self.halted = True
        return outcome

    def refuse(self, command: Command) -> CommandResult:
        """Answer a command of a sender with too many waiting: busy, at once."""
        self.now()
        # A refused stop stopped nothing: a rerun of the log must not take it for one that did.
        outcome = self.simulator.refuse(replace(command, stops=False))
        self.tell(outcome)
        return outcome

    def forget_drives(self) -> None:
        """Drives that have come and wait for their turn do not begin."""
        # Counted, not removed from their queues: a stop costs the same with a thousand waiting drives.
        self.halts += 1

    def stop_motion(self, by: str) -> None:
        """End the movement under way now, if there is one; `by` says who wants it."""
        drove = self.simulator.velocity.moves
        self.simulator.stop()
        self.driving.ended(VelocityEnd.STOP, by, drove)
        self.driving.cut()
        if self._movement is not None:
            self._movement_over(stopped_by=by)

    def _hold(self, session: Session) -> None:
        session.waiting = True
        self._held.append(session)

    def _answer_in_time(self, queued: Queued, outcome: CommandResult, back: float) -> None:
        """Answer in real time: when a reading has been made, and the answer has come back over the link."""
        took = outcome.reading.took if outcome.reading is not None else 0.0
        self._answer(queued, outcome, (queued.there or 0.0) + back, back, took)

    def _answer(
        self,
        queued: Queued,
        outcome: CommandResult,
        link: float = 0.0,
        back: float = 0.0,
        took: float = 0.0,
    ) -> None:
        """Answer a command when its wait is over, or cut short, or else after a reading that `took` time. The
        `link` takes so much there and `back`. What simulated time has passed by already is 0."""
        session = queued.session
        if not (outcome.waits or link or took):
            self._complete(queued, outcome)
            return
        taken = outcome.time if outcome.taken is None else outcome.taken
        if not outcome.waits:
            due = outcome.time + took + back
            told = structs.replace(outcome, time=due, taken=taken, link=link)
            self._go_on_at(due, session, self._complete_late, queued, told)
            return
        session.waiting = True

        def over() -> None:
            time, pose, on_link = self.simulator.time, self.simulator.pose, link + outcome.link
            told = structs.replace(outcome, time=time, pose=pose, taken=taken, link=on_link)
            self._resume(session, self._complete, queued, told)

        until = outcome.time + (0.0 if session.has_gone else outcome.waits + back)
        self.driving.wait(session, until, over)
        if self._passes:
            self.call_at(until, self.driving.settle)
        else:
            self.driving.pass_time()

    def _complete_late(self, queued: Queued, outcome: CommandResult) -> None:
        """Tell a result whose time has come, with the pose of that time; a movement's has its own."""
        # A reading arrives later than it was taken: the pose beside it is that of its own time.
        if outcome.status not in (Status.DONE, Status.ACCEPTED):
            outcome = structs.replace(outcome, pose=self._pose_when(outcome.time))
        self._complete(queued, outcome)

    def _pose_when(self, time: float) -> Pose:
        """The pose at a simulated time a moment ago."""
        leg = self.simulator.leg
        if leg is not None and leg.start_time <= time:
            return leg.pose_at(time)
        trajectory = self.simulator.last_trajectory
        if trajectory is not None and trajectory.start_time <= time < trajectory.end_time:
            return trajectory.pose_at(time)
        return self.simulator.pose

    def _complete(self, queued: Queued, outcome: CommandResult) -> None:
        """Tell watchers of a result, then answer its sender."""
        self.tell(outcome)
        self._reply(queued, outcome)
        if not self.timed:
            self.driving.answered(queued.session)

    def _reply(self, queued: Queued, outcome: CommandResult) -> None:
        """Answer a sender, after the pause that settings ask for."""
        # `step_time` is real time: it is there for people who watch, and changes no simulated time.
        if self.step_time and self._loop is not None:
            session = queued.session
            session.waiting = True
            self._loop.call_later(self.step_time, self._resume, session, self._hand_over, queued, outcome)
        else:
            self._hand_over(queued, outcome)

    def _hand_over(self, queued: Queued, outcome: CommandResult) -> None:
        """Give an answer: that of a movement when it has been shown, and what follows after it."""
        throttle = self.throttle
        if throttle is None or not throttle.busy:
            queued.session.give(queued.answer, outcome)
            return
        session, answer = queued.session, queued.answer
        shown = outcome.trajectory is not None or outcome.waits or self.driving.drives
        # A later answer of the same sender waits too, or its replies would change their order.
        if not (session.late or shown):
            session.give(answer, outcome)
            return
        if shown:
            session.late_until = throttle.until
        session.late += 1
        throttle.later(session.late_until, lambda: session.give(answer, outcome, was_late=True))

    def _catch_up(self) -> None:
        """Someone intervenes: what is shown is the present again, so that it is seen at once."""
        if self.throttle is not None:
            self.throttle.catch_up()

    def mirror(self, command: Command) -> CommandResult:
        """Do at once the command that a real robot was sent. Watchers get the movement, but not
        the answer: the asker knows more.

        A movement that is still under way here is over for the real robot: it is finished first.
        """
        self.now()
        # The real robot takes one command at a time: it has ended the movement before.
        if self._movement is not None:
            self._movement_over()
        if self._passes:
            return self._begin(command)
        outcome = self._execute(command, answers=False)
        return self.simulator.finish(outcome) if outcome.waits else outcome

    def peek(self, command: Command) -> CommandResult:
        """Have a sensor read, or a command refused, without an answer: the asker tells it. Unlike `mirror`
        it leaves a movement alone."""
        self.now()
        return self.driving.begin(command, None)

    def finish_movement(self) -> None:
        """The real robot has ended the movement that is still under way here: go on from its end."""
        self.now()
        if self._movement is not None:
            self._movement_over()
            self._set_clock()

    # -- timed movements ---------------------------------------------------------------------

    def _set_timer(self) -> None:
        """Have the movement under way end on time; while paused it does not end."""
        self._end.cancel()
        trajectory = self.simulator.trajectory
        if self._movement is not None and trajectory is not None and not self.paused:
            self._end.set_at(self._origin + trajectory.end_time / self.time_scale)

    def _movement_over(self, stopped_by: str = "") -> None:
        movement = self._under_way
        self._movement = None
        self._set_timer()
        outcome, queued = self.simulator.finish(movement.outcome), movement.queued
        back = self._way(outcome.command) if queued is not None else 0.0
        answers = queued is not None and not (queued.there or back)
        self._tell_ended(outcome, stopped_by, answers=answers)
        # All held sessions are freed before the first is woken: it may begin the next movement at once.
        held, self._held = self._held, []
        for each in held:
            each.waiting = False
        if queued is not None:
            self._answer_in_time(queued, outcome, back)
        for each in held:
            self._scheduler.wake(each)
