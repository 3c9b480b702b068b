"""One robot with one queue: the engine runs all commands in order and passes all events to all watchers.

All methods but the constructor run in the robot's event loop. The engine knows neither how commands arrive (a
`Session` for each sender) nor who watches. Its events are in `events.py`.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable, Hashable, Iterator, Sequence

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.errors import SimmerError
from simmer_tui.robot import actions
from simmer_tui.robot.driving import Driving
from simmer_tui.robot.link_delay import LinkDelay
from simmer_tui.robot.playback_throttle import PlaybackThrottle
from simmer_tui.robot.sessions import Answered, Foreign, Queued, Scheduler, Session, Stop
from simmer_tui.robot.timers import LoopTimer, TimerQueue
from simmer_tui.run.events import (
    Action,
    ActionDone,
    ActionName,
    MovementEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
    VelocityEnd,
    Watcher,
    Watchers,
    WireMessage,
)
from simmer_tui.sim.command import PEOPLE, Command
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import CommandResult, Status
from simmer_tui.sim.simulator import Simulator
from simmer_tui.sim.trajectory import Trajectory


class _Movement(Struct, frozen=True):
    """A timed movement under way, with its trajectory, and the command that is answered when it ends."""

    result: CommandResult
    trajectory: Trajectory
    queued: Queued | None = None


class Engine:
    """Runs the commands of all sessions on one simulator.

    With `timed` motion simulated time follows the loop's clock times `time_scale`; otherwise each movement is
    over at once. `step_time` is a pause, seconds, before every answer. `link` is the latency between programs
    and the robot. The time of a sensor's reading and of the link is added to simulated time; in timed motion
    it passes before the answer.
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
        # One queue for all later calls: those at the same simulated time keep their order.
        self._timers = TimerQueue()
        self._alarm = LoopTimer(self._settle)
        self.before_drive: Callable[[], None] | None = None
        """Called before each movement, so that beliefs already received on other connections are processed
        first."""
        self.halts = 0
        """Count of stops of all motion by commands. Drives that came before such a stop and
        wait for their turn do not begin: counting makes a stop cost the same however many wait."""
        self.halted = False
        """True if no drive command has arrived since the last stop."""
        self.throttle: PlaybackThrottle | None = None
        """The throttle that shows movements at a pace; None without watchers."""
        self._watchers = Watchers(self.tell_fault)
        self.tell: Watcher = self._watchers.tell
        """Passes an event to all watchers (see `Watchers.tell`)."""
        self.driving = Driving(simulator, self.tell)
        """Continuous motion, and those who wait."""
        self.boards: Callable[[float], bool] | None = None
        """Brings the team's boards, and the simulator with them, to a simulated time, in timed motion. False
        if that takes more than a slice. None without boards."""
        self._scheduler = Scheduler(self._do)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._origin = 0.0
        self._stands = False
        """True inside `moment`."""
        self._time_is_over = False
        self._movement: _Movement | None = None
        self._end = LoopTimer(self._movement_over)
        self._held: list[Session] = []

    def session(self, *, answer_at_end: bool = True, lane: str = "") -> Session:
        """A new sender of commands.

        Lanes take turns, and so do the sessions of a lane. A lane with a name is for any number of sessions;
        its turn is limited in time as well. Without a name the sender has a lane of its own.
        """
        its_lane = self._scheduler.lane(lane)
        return Session(its_lane, self.submit, self._session_closed, answer_at_end)

    def _session_closed(self, session: Session) -> None:
        self.cut_waits(session)
        if session.driver is None:
            self.driver_left(session)

    def cut_waits(self, session: Session) -> None:
        """End the waits of a sender that has gone: nobody will read its answers. A real robot's time cannot
        be moved: there they stay."""
        session.has_gone = True
        if self.driving.waits:
            self.now()
            self.driving.forget(session)

    def driver_left(self, driver: Hashable) -> None:
        """End the velocity of a driver that has left."""
        if self.simulator.velocity.moves:
            self.now()
        self.driving.left(driver)
        self._set_alarm()

    # -- watchers ----------------------------------------------------------------------------

    def watch(self, watcher: Watcher) -> None:
        """Pass every event to `watcher`, in order."""
        self._watchers.add(watcher)

    def unwatch(self, watcher: Watcher) -> None:
        """Pass no more events to `watcher`."""
        self._watchers.remove(watcher)

    @property
    def exchanges(self) -> bool:
        """True once something has gone over a dialect's line."""
        return WireMessage in self._watchers.told

    def tell_fault(self, text: str) -> None:
        """Report a fault to the watchers."""
        self.tell(Notice(NoticeKind.FAULT, text))

    # -- pace --------------------------------------------------------------------------------

    def paced(self, loop: asyncio.AbstractEventLoop, pace: float) -> PlaybackThrottle:
        """Show and answer instant movements at a pace. Returns the throttle; those who watch at the pace
        become its watchers.

        `pace` is simulated seconds a second, 0 as fast as possible. `loop` is the event loop that `start` is
        called with later. Timed motion is not slowed down.
        """
        self.throttle = PlaybackThrottle(loop, 0.0 if self.timed else pace, self.tell_fault)
        self.watch(self.throttle.watch)
        return self.throttle

    def shown_time(self) -> float:
        """Simulated time that is shown at the pace: the present, or a moment of the movement shown now."""
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
        """Advance the simulator to the present. Returns simulated time."""
        # While paused, or with instant motion, only commands move simulated time.
        if self._passes and self._loop is not None and not self._stands:
            present = (self._loop.time() - self._origin) * self.time_scale
            if not self._catch_up_to(present):
                # Computing takes longer than the simulated time itself: the simulation falls behind, commands
                # are still answered.
                self._origin = self._loop.time() - self.simulator.time / self.time_scale
        return self.simulator.time

    def _catch_up_to(self, time: float) -> bool:
        """Advance the simulator to a time. False if that takes more than a slice."""
        return self.driving.catch_up(time) if self.boards is None else self.boards(time)

    @contextlib.contextmanager
    def moment(self) -> Iterator[None]:
        """The present, which lasts as long as the `with` block: a message, and the movement that it begins,
        have the same time."""
        self.now()
        stood, self._stands = self._stands, True
        try:
            yield
        finally:
            self._stands = stood

    @property
    def present(self) -> float:
        """Simulated time now; the simulator itself is not advanced. Any thread may ask."""
        if self._passes and self._loop is not None:
            return max((self._loop.time() - self._origin) * self.time_scale, self.simulator.time)
        return self.simulator.time

    def end_time(self) -> None:
        """Let simulated time stand still until the run restarts: its robot can do nothing more."""
        self._time_is_over = True

    def clock_time(self, time: float) -> float:
        """The loop's time of a simulated time, in timed motion."""
        return self._origin + time / self.time_scale

    def _set_clock(self) -> None:
        if self._loop is not None:
            # Set again after each pause and change of speed, so that simulated time never jumps.
            self._origin = self._loop.time() - self.simulator.time / self.time_scale
            self._set_timer()
            self._set_alarm()

    def call_at(self, time: float, call: Callable[[], None]) -> None:
        """Call a function at a simulated time; a pause delays it as well. Only for timed motion, after
        `start`: in instant motion the loop's clock decides, and simulated time may not have passed."""
        self._timers.add(time, call)
        self._set_alarm()

    def _set_alarm(self) -> None:
        """Set the timer to the next call that is due."""
        self._alarm.cancel()
        due = self._timers.due
        # Instant motion has no clock: time passes by commands only.
        # Boards come to each of these times by themselves.
        due = min(due, self.simulator.next_event) if self.timed and self.boards is None else due
        if due < math.inf and not self.paused:
            self._alarm.set_at(self._origin + due / self.time_scale, due)

    def _settle(self, until: float) -> None:
        """Make the calls that are due by a simulated time."""
        self.now()
        # The loop's clock may round to just before the event that the timer was set for.
        if until < math.inf and (self.driving.waits or self.simulator.next_event <= until):
            self._catch_up_to(until)
        self._timers.run(until)
        self.driving.settle()
        self._set_alarm()

    # -- a replayed prefix ----------------------------------------------------------------------

    def draw_link(self, messages: int) -> float:
        """Draw the delays of messages of the replayed prefix. Returns their sum, simulated seconds."""
        return sum(self._link.draw() for _ in range(messages)) if self._link is not None else 0.0

    def restart_link(self) -> None:
        """Restart the random stream of delays, as at a reset in the replayed prefix."""
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
        # The present first: an action happens after all that was due before it.
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
        """Report that a client that does not read its replies has been dropped, and stop the robot. Its
        unread commands may have a stop among them."""
        self.tell_dropped(client)
        self.perform(Action(ActionName.STOP, source=f"client {client}"))

    def tell_dropped(self, client: str) -> None:
        """Report that a client that does not read its replies has been dropped."""
        self.tell_fault(f"client {client} dropped: it does not read its replies")

    def _follow(self, action: Action) -> None:
        """Apply the part of an action that concerns the engine itself."""
        if action.name is ActionName.TIME_SCALE:
            self.time_scale = action.arguments[0]
        elif action.name.restarts:
            self._time_is_over = False
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
            self._replan(self._movement)  # the block has come into its path, or has left it
        # The action may have changed the speed, the time or the pause. All timers depend on these.
        self._set_clock()
        if action.name.restarts:  # answers of the run before come before the new run
            self._settle(math.inf)

    def _replan(self, movement: _Movement) -> None:
        trajectory = self.simulator.trajectory
        assert trajectory is not None, "a movement that is not over has a trajectory"
        self._movement = replace(movement, trajectory=trajectory)
        result = movement.result
        self.tell(MovementPlanned(result.number, self.simulator.time, result.command, trajectory))

    def step(self) -> None:
        """While paused, finish the movement under way, or do the whole of the next command."""
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
            self._scheduler.run()

    # -- commands ----------------------------------------------------------------------------

    def submit(self, session: Session, commands: Sequence[Command], answered: Answered) -> Queued:
        """Queue the commands of a message; `answered` may be called before this returns. Returns the last one
        of them."""
        # Nearly every message is one command: it needs neither a list nor a count.
        if len(commands) == 1:
            return self._queue(session, commands[0], answered, commands)
        results: list[CommandResult] = []

        def collect(result: Sequence[CommandResult], data: bytes | None) -> None:
            results.extend(result)
            if len(results) == len(commands):
                answered(results, None)

        queued = [
            self._queue(session, command, collect, () if place else commands)
            for place, command in enumerate(commands)
        ]
        return queued[-1]

    def _queue(
        self, session: Session, command: Command, answered: Answered, moment: Sequence[Command]
    ) -> Queued:
        """Queue a command; a stop is done before its turn."""
        stop = None
        # Done before its turn: behind a queue of drives a stop would come too late.
        if not command.stops:
            self.halted = self.halted and not self._sets_going(command)
        elif not self.halted:
            stop = self._take_stop(session, command)
        # Otherwise there is nothing to stop, and the command waits for its turn: stops come by the thousand.
        queued = Queued(session, command, answered, self.halts, moment, stop)
        self._scheduler.submit(queued)
        return queued

    def reserve(self, session: Session, answered: Answered, *, slices: bool = False) -> Foreign:
        """Keep a place in a session's queue for a message that others answer, by `answer_foreign`."""
        foreign = Foreign(session, answered, slices)
        session.queue.append(foreign)
        return foreign

    def answer_foreign(self, foreign: Foreign, results: Sequence[CommandResult], data: bytes | None) -> None:
        """Give an answer of others in its turn."""
        foreign.given, foreign.results, foreign.data = True, results, data
        if not foreign.slices:
            foreign.session.settle(foreign)
        self._scheduler.wake(foreign.session)

    def _do(self, queued: Queued | Foreign) -> None:
        """Do a command whose turn has come, or give an answer of others."""
        if isinstance(queued, Foreign):
            self._hand_over(queued, queued.results, queued.data)
            return
        command = queued.command
        if command.stops:
            queued.stop = queued.stop or self._take_stop(queued.session, command)
            self._answer_stop(queued, queued.stop)
        elif self.timed and not self.paused:
            self._settle_due()
            delay = self._link_delay(command) if queued.request_delay is None else 0.0
            if delay:
                queued.request_delay = delay
                self._go_on_at(self.simulator.time + delay, queued.session, self._arrive, queued)
            else:
                self._do_timed(queued)
        else:
            if queued.halts != self.halts or self.before_drive is not None:
                command = self._meant_now(queued)
            # Only for programs: the time that a pass of a program's loop takes is simulated, a person's is
            # not.
            if queued.moment and command.source not in PEOPLE:
                self.simulator.begin_pass(queued.moment)
            result = self._execute(command, queued.request_delay, session=queued.session)
            if result.waits:
                self._answer(queued, result)
            else:  # Nearly every command: it saves the call of `_answer`.
                self._complete(queued, result)

    def _arrive(self, queued: Queued) -> None:
        """A command has passed the link: it is the next one of its session, unless that is closed."""
        if queued.session.open:
            queued.session.queue.appendleft(queued)

    def _do_timed(self, queued: Queued) -> None:
        """Do a command that has arrived over the link, in real time."""
        session, command = queued.session, self._meant_now(queued)
        waits = session.answer_at_end and self.simulator.is_drive(command)
        if waits and self._movement is not None and queued.halts == self.halts:
            # In front again: the order of a sender's commands never changes. It waits for the end of
            # another's movement.
            session.queue.appendleft(queued)
            self._hold(session)
            return
        result = self._begin(command, session)
        if result.status is Status.ACCEPTED and session.answer_at_end:
            self._movement = replace(self._under_way, queued=queued)
            self._hold(session)
        else:
            self._answer_in_time(queued, result, self._link_delay(command))

    def _meant_now(self, queued: Queued) -> Command:
        """The command to do now. A drive from before a stop becomes a stop, unless a later movement is under
        way."""
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
        """True if a command is a drive or a velocity."""
        return self.simulator.is_drive(command) or self.simulator.is_velocity(command)

    @property
    def _passes(self) -> bool:
        """True while simulated time follows the clock."""
        return self.timed and not (self.paused or self._time_is_over)

    def _go_on_at(self, time: float, session: Session, step: Callable[..., None], *arguments: object) -> None:
        """Let a session wait until a simulated time, then call `step`."""
        session.waiting = True
        self.call_at(time, lambda: self._resume(session, step, *arguments))

    def _resume(self, session: Session, step: Callable[..., None], *arguments: object) -> None:
        """End a session's wait: call `step`, then continue with its commands."""
        session.waiting = False
        step(*arguments)
        self._scheduler.wake(session)

    def _settle_due(self) -> None:
        """Advance to the present: first the calls that are due, then the end of a movement that is over."""
        self.now()
        if self._timers.due <= self.simulator.time:
            self._settle(self.simulator.time)
        if self._movement is not None and not self.simulator.moving:
            self._movement_over()  # its timer has not been called yet

    def _link_delay(self, command: Command) -> float:
        """Delay of a command, or of its answer, on the link, simulated seconds."""
        # Drawn for programs only: a key that is pressed meanwhile changes no later delay of the same seed.
        return self._link.draw() if self._link is not None and command.source not in PEOPLE else 0.0

    def _execute(
        self,
        command: Command,
        request_delay: float | None = None,
        *,
        answers: bool = True,
        session: Session | None = None,
    ) -> CommandResult:
        """Do a whole command at once.

        `request_delay` is the delay that it had on the link already; None draws one and adds it to simulated
        time. Without `answers` there is no link and no delay.
        """
        simulator = self.simulator
        # The delay of the command is drawn before that of the answer: reruns of logs draw in the same order.
        if request_delay is None:
            request_delay = self._link_delay(command) if answers and self._link is not None else 0.0
            if request_delay:
                simulator.advance(simulator.time + request_delay)
        # In timed motion the clock brings the turn of the lidar to its end.
        if simulator.has_lidars and not self.timed:
            simulator.wait_for_scan(command)
        # Most commands have nothing to do with velocities.
        if simulator.leg is None and command.code not in simulator.velocity_codes:
            result = simulator.begin(command)
        else:
            result = self.driving.begin(command, session)
        taken = result.time
        # Drawn even where nothing moves, so that the number of draws does not depend on the result.
        reply_delay = self._link_delay(command) if answers and self._link is not None else 0.0
        if result.status is Status.ACCEPTED:
            self._tell_planned(result)
            result = simulator.finish(result)
            self._tell_ended(result, answers=answers and not (request_delay or reply_delay))
        elif result.reading is not None and result.reading.took:
            result = simulator.finish(result)
        if request_delay or reply_delay:
            simulator.advance(simulator.time + reply_delay)
            result = replace(result, time=simulator.time, taken=taken, link=request_delay + reply_delay)
        return result

    def _begin(self, command: Command, session: Session | None = None) -> CommandResult:
        """Begin a command in real time; a movement or a velocity then continues by itself."""
        result = self.driving.begin(command, session)
        if result.velocity is not None:
            self._set_alarm()
        if result.status is Status.ACCEPTED:
            self._movement = _Movement(result, self._tell_planned(result))
            self._set_timer()
        return result

    def _tell_planned(self, result: CommandResult) -> Trajectory:
        planned = self.simulator.trajectory
        assert planned is not None, "what was accepted moves"
        self.tell(MovementPlanned(result.number, result.time, result.command, planned, result.grip))
        return planned

    def _tell_ended(self, result: CommandResult, stopped_by: str = "", *, answers: bool) -> None:
        """Tell that a movement has ended; with `answers` the event is the answer as well."""
        went = self.simulator.last_trajectory
        assert went is not None, "what was finished has moved"
        by = stopped_by if went.cut is not None else ""
        number, time, command, pose = result.number, result.time, result.command, result.pose
        self.tell(MovementEnded(number, time, command, went, pose, by, answers, result.grip))

    @property
    def _under_way(self) -> _Movement:
        assert self._movement is not None, "no movement is under way"
        return self._movement

    def _take_stop(self, session: Session, command: Command) -> Stop:
        """Take a command that stops. It is done as soon as it has passed the link."""
        stop, request_delay = Stop(), self._link_delay(command)
        if request_delay and self._passes:
            self.call_at(
                self.now() + request_delay, lambda: self._stop_arrives(session, command, stop, request_delay)
            )
            return stop
        if request_delay:
            self.simulator.advance(self.simulator.time + request_delay)
        self._do_stop(command, stop, request_delay)
        return stop

    def _stop_arrives(self, session: Session, command: Command, stop: Stop, request_delay: float) -> None:
        if not session.open:
            return
        self._do_stop(command, stop, request_delay)
        # Otherwise the session may wait for the answer of an earlier command.
        if stop.awaited:
            session.waiting = False
        self._scheduler.wake(session)

    def _do_stop(self, command: Command, stop: Stop, request_delay: float) -> None:
        reply_delay = self._link_delay(command)
        stop.result = self.halt(command, request_delay + reply_delay, 0.0 if self._passes else reply_delay)
        stop.reply_delay = reply_delay if self._passes else 0.0

    def _answer_stop(self, queued: Queued, stop: Stop) -> None:
        """Send the answer of a stop whose turn has come back over the link."""
        session, result = queued.session, stop.result
        if result is None:
            session.waiting = stop.awaited = True
            session.queue.appendleft(queued)
        elif stop.reply_delay and self._passes:
            self._go_on_at(self.now() + stop.reply_delay, session, self._hand_over, queued, (result,))
        else:
            self._reply(queued, result)

    def halt(self, command: Command, link: float = 0.0, reply_delay: float = 0.0) -> CommandResult:
        """End all motion now; drives that wait for their turn do not begin.

        `link` is the delay of command and answer together, simulated seconds. `reply_delay` is the part of it
        that is added to simulated time here.
        """
        self.now()
        self._catch_up()
        with self._scheduler.holding():  # nothing begins before watchers have the event
            self.forget_drives()
            self.stop_motion(f"{command.shown} from {command.source}")
            result = self.simulator.begin(command)
            if link:
                taken = result.time
                self.simulator.advance(taken + reply_delay)
                result = replace(result, time=self.simulator.time, taken=taken, link=link)
            self.tell(result)
            self.halted = True
        return result

    def refuse(self, command: Command) -> CommandResult:
        """Answer a command of a sender with too many waiting: busy, at once."""
        self.now()
        # A refused stop stopped nothing: without this a rerun of the log would stop the robot.
        result = self.simulator.refuse(replace(command, stops=False))
        self.tell(result)
        return result

    def forget_drives(self) -> None:
        """Make drives that wait for their turn not begin."""
        # A counter, and the drives stay in their queues: a stop costs the same however many drives wait.
        self.halts += 1

    def stop_motion(self, by: str) -> None:
        """End the movement under way now, if there is one; `by` names who stopped it."""
        drove = self.simulator.velocity.moves
        self.simulator.stop()
        self.driving.ended(VelocityEnd.STOP, by, drove)
        self.driving.cut()
        if self._movement is not None:
            self._movement_over(stopped_by=by)

    def _hold(self, session: Session) -> None:
        session.waiting = True
        self._held.append(session)

    def _answer_in_time(self, queued: Queued, result: CommandResult, reply_delay: float) -> None:
        """Answer in real time: after the time of the reading and the answer's delay on the link."""
        took = result.reading.took if result.reading is not None else 0.0
        self._answer(queued, result, (queued.request_delay or 0.0) + reply_delay, reply_delay, took)

    def _answer(
        self,
        queued: Queued,
        result: CommandResult,
        link: float = 0.0,
        reply_delay: float = 0.0,
        took: float = 0.0,
    ) -> None:
        """Answer a command when its wait is over or cut, or after a reading that `took` time.

        `link` is the delay of command and answer on the link, `reply_delay` that of the answer. Both, and
        `took`, are 0 for time that has passed already. All in simulated seconds.
        """
        session = queued.session
        if not (result.waits or link or took):
            self._complete(queued, result)
            return
        taken = result.time if result.taken is None else result.taken
        if not result.waits:
            due = result.time + took + reply_delay
            late = replace(result, time=due, taken=taken, link=link)
            self._go_on_at(due, session, self._complete_late, queued, late)
            return
        session.waiting = True

        def over() -> None:
            time, pose, on_link = self.simulator.time, self.simulator.pose, link + result.link
            waited = replace(result, time=time, pose=pose, taken=taken, link=on_link)
            self._resume(session, self._complete, queued, waited)

        until = result.time + (0.0 if session.has_gone else result.waits + reply_delay)
        self.driving.wait(session, until, over)
        if self._passes:
            self.call_at(until, self.driving.settle)
        else:
            self.driving.pass_time()

    def _complete_late(self, queued: Queued, result: CommandResult) -> None:
        """Tell a result whose time has come. A reading gets the pose at that time; a movement has its own."""
        # A reading arrives later than it was taken: the pose beside it is that of the event's time.
        if result.status not in (Status.DONE, Status.ACCEPTED):
            result = replace(result, pose=self._pose_when(result.time))
        self._complete(queued, result)

    def _pose_when(self, time: float) -> Pose:
        """The pose at a simulated time shortly before now."""
        leg = self.simulator.leg
        if leg is not None and leg.start_time <= time:
            return leg.pose_at(time)
        trajectory = self.simulator.last_trajectory
        if trajectory is not None and trajectory.start_time <= time < trajectory.end_time:
            return trajectory.pose_at(time)
        return self.simulator.pose

    def _complete(self, queued: Queued, result: CommandResult) -> None:
        """Tell watchers of a result, then answer its sender."""
        self.tell(result)
        self._reply(queued, result)
        if self.driving.driver is not None and not self.timed:
            self.driving.answered(queued.session, by_hand=result.command.source in PEOPLE)

    def _reply(self, queued: Queued, result: CommandResult) -> None:
        """Answer a sender, after the pause `step_time`."""
        # `step_time` is real time: it is for people who watch, and changes no simulated time.
        if self.step_time and self._loop is not None:
            session = queued.session
            session.waiting = True
            self._loop.call_later(self.step_time, self._resume, session, self._hand_over, queued, (result,))
        else:
            self._hand_over(queued, (result,))

    def _hand_over(
        self, queued: Queued | Foreign, results: Sequence[CommandResult], data: bytes | None = None
    ) -> None:
        """Give an answer to its session. A movement's answer waits until it has been shown, and so do later
        ones."""
        throttle, session = self.throttle, queued.session
        if throttle is None or not throttle.busy:
            session.give(queued, results, data)
            return
        shown = isinstance(queued, Queued) and (
            results[0].trajectory is not None or results[0].waits or self.driving.drives
        )
        # A later answer of the same sender waits too, or its replies would change their order.
        if not (session.late or shown):
            session.give(queued, results, data)
            return
        if shown:
            session.late_until = throttle.until
        session.late += 1
        throttle.later(session.late_until, lambda: session.give(queued, results, data, was_late=True))

    def _catch_up(self) -> None:
        """Show the present at once: somebody intervenes, and must see the result."""
        if self.throttle is not None:
            self.throttle.catch_up()

    def mirror(self, command: Command) -> CommandResult:
        """Do at once the command that a real robot was sent.

        Watchers get the movement, but not the result: the caller tells it with the real robot's answer. A
        simulated movement that is still under way is finished first: the real robot has ended it.
        """
        self.now()
        # The real robot takes one command at a time: it has ended the movement before.
        if self._movement is not None:
            self._movement_over()
        if self._passes:
            return self._begin(command)
        result = self._execute(command, answers=False)
        return self.simulator.finish(result) if result.waits else result

    def peek(self, command: Command) -> CommandResult:
        """Begin a command that reads a sensor or is refused, without telling its result; the caller does.
        Unlike `mirror` it does not change a movement under way."""
        self.now()
        return self.driving.begin(command, None)

    def act(self, command: Command, session: Session) -> CommandResult:
        """Do a command of a board at the simulator's time, and tell its result. A movement that it begins is
        ended by `end_movement`."""
        result = self._begin(command, session)
        reading = result.reading
        if reading is not None and reading.took:
            # The board's own calls have taken their time.
            result = replace(result, reading=replace(reading, took=0.0))
        self.tell(result)
        return result

    def end_movement(self) -> None:
        """End the movement that a board has begun, at its end."""
        if self._movement is not None:
            self._movement_over()

    def finish_movement(self) -> None:
        """Finish the simulated movement at once: the real robot has ended its own."""
        self.now()
        if self._movement is not None:
            self._movement_over()
            self._set_clock()

    # -- timed movements ---------------------------------------------------------------------

    def _set_timer(self) -> None:
        """Set the timer for the end of the movement under way; none while paused."""
        self._end.cancel()
        trajectory = self.simulator.trajectory
        if self.boards is not None:
            return
        if self._movement is not None and trajectory is not None and not self.paused:
            self._end.set_at(self._origin + trajectory.end_time / self.time_scale)

    def _movement_over(self, stopped_by: str = "") -> None:
        movement = self._under_way
        self._movement = None
        self._set_timer()
        result, queued = self.simulator.finish(movement.result), movement.queued
        reply_delay = self._link_delay(result.command) if queued is not None else 0.0
        answers = queued is not None and not (queued.request_delay or reply_delay)
        self._tell_ended(result, stopped_by, answers=answers)
        # All held sessions are freed before the first one continues: it may begin the next movement at once.
        held, self._held = self._held, []
        for each in held:
            each.waiting = False
        if queued is not None:
            self._answer_in_time(queued, result, reply_delay)
        for each in held:
            self._scheduler.wake(each)
