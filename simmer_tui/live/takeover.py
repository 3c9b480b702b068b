"""A run that continues from a moment of a logged one.

The log's commands are done again, each reply compared, on the robot of a new server. All events of the prefix
go to the new server's referee, screen and log. So the state is the logged one, random streams included, and
everything after it is new. A log with different replies is not taken over.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from msgspec.structs import replace

from simmer_tui.config.loader import Configuration
from simmer_tui.config.settings import ServerSettings, with_any_ports
from simmer_tui.errors import PortError, RunLogError
from simmer_tui.live.server import Server, link_delay
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import (
    Action,
    ActionDone,
    ActionName,
    CommandResult,
    Event,
    EventHandler,
    LegBegun,
    LegEnded,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
)
from simmer_tui.run.mission import plan_run
from simmer_tui.run.reducer import Reducer
from simmer_tui.runlog.header import TakenOver
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.runlog.log_records import ActionRecord
from simmer_tui.runlog.reader import Logged, LogReader
from simmer_tui.runlog.rerun import SAME_TIME, Rerun
from simmer_tui.runlog.writer import ReplayedPrefix
from simmer_tui.sim.command import PEOPLE
from simmer_tui.sim.simulator import Simulator

BY = "the take-over"
"""Source of the stop that ends a movement under way at the moment, and of the resume that ends a pause."""
# Verdicts, and the commands that pages give, have tenths of a second.
_ROUNDED = 0.05
"""A time that is later than the end of a log by this means the end, seconds."""


@dataclass(frozen=True, slots=True)
class LogPoint:
    """A moment of a log: its last line (1: only the header), and its time.

    The time is simulated time as that line counts it, and seconds from the log's beginning.
    """

    line: int
    time: float
    elapsed: float


def moment_of(index: RunLogIndex, entry: int, elapsed: float) -> LogPoint:
    """The moment that a replay shows: its entry (-1: before the first), and its elapsed time."""
    return LogPoint(entry + 2, elapsed - index.zero_of(max(entry, 0)), elapsed)


def moment_at(index: RunLogIndex, elapsed: float) -> LogPoint:
    """A moment by its elapsed time. Raises RunLogError for one that the log has not."""
    if not 0.0 <= elapsed <= index.duration + _ROUNDED:
        raise RunLogError(f"{index.shown} has the times from 0 to {index.duration:.2f} s, not {elapsed:g}")
    elapsed = min(elapsed, index.duration)
    return moment_of(index, index.find_time(elapsed), elapsed)


class _UnansweredError(Exception):
    """The lines up to the moment have a change of the velocity by a command without its answer."""


class TakeOver:
    """A take-over from a moment of a log."""

    def __init__(self, path: Path, moment: LogPoint, folder: Path | None = None) -> None:
        """`folder` is where the run's device files are, by default the folder of its set."""
        self.path = path
        self.moment = moment
        self._folder = folder

    def check(self) -> None:
        """Do the commands of the prefix once without a server. A command that has changed the velocity, but
        is not answered yet, is left out: then the moment has an earlier line.

        Raises RunLogError, with the reason, if the log cannot be taken over there.
        """
        while True:
            try:
                return self._repeat()
            except _UnansweredError:
                moment = self.moment
                self.moment = LogPoint(moment.line - 1, moment.time, moment.elapsed)

    def _repeat(self) -> None:
        with Rerun(self.path, self._folder) as rerun:
            settings = rerun.configuration.settings
            engine = Engine(rerun.simulator, link=link_delay(settings.link, rerun.header.seed))
            for _ in self._relived(rerun, engine, settings.motion.motion == "timed"):
                pass

    def serve(self) -> tuple[Server, Rerun]:
        """A server whose robot is at the log's beginning, and the rerun that `advance` brings forward.

        The ports are the log's, or any others if those are taken. Raises RunLogError, PortError.
        """
        rerun = Rerun(self.path, self._folder)
        try:
            return self._served(rerun), rerun
        # An interrupt, too, must not leave the log open.
        except BaseException:
            rerun.close()
            raise

    def _served(self, rerun: Rerun) -> Server:
        header, configuration = rerun.header, rerun.configuration
        prefix = ReplayedPrefix(
            TakenOver(self.path.name, self.moment.line, self.moment.elapsed), header.real_time
        )
        settings = replace(
            configuration.settings, seed=header.seed, randerror=False, server=_closed(configuration)
        )
        configuration = replace(configuration, settings=settings)
        plan = None
        if header.mission and configuration.mission is not None:
            plan = plan_run(configuration, header.seed)[1]
        try:
            return Server(configuration, plan=plan, simulator=rerun.simulator, prefix=prefix)
        except PortError as error:
            configuration = replace(configuration, settings=with_any_ports(settings))
            server = Server(configuration, plan=plan, simulator=rerun.simulator, prefix=prefix)
            server.warnings.append(f"other ports are used: {error}")
            return server

    def advance(self, server: Server, rerun: Rerun) -> None:
        """Advance a server that has not been started to the moment. Its watchers get all events of the
        prefix."""
        prefix, engine = server.prefix, server.engine
        assert prefix is not None, "the server was made with a prefix"
        reducer = server.new_reducer()
        if server.referee is not None:
            server.referee.begin()
        with rerun:
            teller = _Teller(server, reducer)
            for event in self._relived(rerun, engine, engine.timed, prefix):
                teller.handle(event)
        prefix.end()
        self._settle(server, reducer)
        engine.tell(Notice(NoticeKind.TAKEN_OVER, str(prefix), prefix.origin.log))

    def _settle(self, server: Server, reducer: Reducer) -> None:
        """Take over the time scale, and end a pause."""
        state, engine = reducer.at(), server.engine
        engine.time_scale = state.time_scale
        if state.paused:
            engine.perform(Action(ActionName.RESUME, (), BY))

    # -- the replayed prefix -------------------------------------------------------------------------

    def _relived(
        self, rerun: Rerun, engine: Engine, timed: bool, prefix: ReplayedPrefix | None = None
    ) -> Iterator[Event]:
        """Advance the robot and the link's random stream to the moment, line by line. Yields the events of
        each line.

        Raises RunLogError, and _UnansweredError if the last lines are those of a command without its answer.
        """
        moment = self.moment
        # The log has the events of continuous motion: the engine's own would be told a second time.
        rerun.simulator.listener = rerun
        with LogReader(self.path, rerun.configuration) as log:
            events = (each for each in log if isinstance(each, Logged))
            logged = next(events, None)
            link = _LinkFollower(engine, self.path, timed)
            for line, said in rerun.until(moment.line, moment.time):
                if prefix is not None:
                    prefix.time = said.t
                    prefix.real_time = max(prefix.real_time, said.real_time)
                    prefix.commands = said.n if isinstance(said, ActionRecord) else prefix.commands
                while logged is not None and logged.line <= line:
                    event = logged.event
                    logged = next(events, None)
                    link.line = line
                    link.handle(event)
                    yield event
            if link.under_way is not None:
                stopped = self._stopped(rerun, link.under_way)
                link.handle(stopped)
                yield stopped
            link.lose_answer()
            if link.is_ahead_of(rerun.simulator):
                raise _UnansweredError
            engine.driving.take_over(link.leg)

    def _stopped(self, rerun: Rerun, planned: MovementPlanned) -> MovementEnded:
        """End the movement under way at the moment."""
        simulator = rerun.simulator
        simulator.stop()
        trajectory = simulator.last_trajectory
        assert trajectory is not None, "a movement was under way"
        end = min(trajectory.end_time, simulator.time)
        pose = trajectory.pose_at(end)
        return MovementEnded(planned.number, end, planned.command, trajectory, pose, BY, grip=planned.grip)


class _Teller(EventHandler[None]):
    """Passes the logged events to a server's watchers; the referee makes its own mission events."""

    def __init__(self, server: Server, reducer: Reducer) -> None:
        self._server, self._reducer = server, reducer

    def other(self, event: Event) -> None:
        self._reducer.apply(event)
        self._server.engine.tell(event)

    def on_mission(self, event: MissionEvent) -> None:
        if self._server.referee is None:
            self.other(event)
        else:
            self._server.referee.check(event.time)


class _LinkFollower(EventHandler[None]):
    """Draws the logged run's delays from the link's random stream. It knows which movement or leg is under
    way, and which movement is unanswered."""

    def __init__(self, engine: Engine, path: Path, timed: bool) -> None:
        self._engine, self._path, self._timed = engine, path, timed
        self.line = 0
        self.under_way: MovementPlanned | None = None
        self._unanswered: MovementEnded | None = None
        self.leg: LegBegun | None = None
        """The leg of a continuous motion under way."""
        self._velocity = 0
        """Number of the last command that was answered and changed the velocity."""

    def on_planned(self, event: MovementPlanned) -> None:
        self.under_way = event

    def on_ended(self, event: MovementEnded) -> None:
        lost = event.stopped_by == BY
        self.under_way, self._unanswered = None, None if event.answers or lost else event
        # The delay of its answer may be drawn already.
        if lost and event.command.source not in PEOPLE:
            self._engine.draw_link(1 if self._timed else 2)

    def on_notice(self, event: Notice) -> None:
        if event.kind is NoticeKind.TAKEN_OVER:
            self.lose_answer()

    def lose_answer(self) -> None:
        """Draw the delays of an answer that was on the link when another run took over."""
        if self._unanswered is not None and self._unanswered.command.source not in PEOPLE:
            self._engine.draw_link(2)
        self._unanswered = None

    def on_leg_begun(self, event: LegBegun) -> None:
        self.leg = event

    def on_leg_ended(self, event: LegEnded) -> None:
        self.leg = None

    def is_ahead_of(self, simulator: Simulator) -> bool:
        """True if the log has begun or ended a leg by a command that it has not answered, so that the
        simulator has not done it."""
        if self.leg is not None:
            return self.leg.number != self._velocity
        return simulator.leg is not None and simulator.leg.start_time < simulator.time - SAME_TIME

    def on_action(self, event: ActionDone) -> None:
        if event.restarts:
            self._velocity = 0
            self._engine.restart_link()

    def on_result(self, event: CommandResult) -> None:
        """Raises RunLogError if the link's delay was another one in the log."""
        if self._unanswered is not None and event.number >= self._unanswered.number:
            self._unanswered = None
        if event.velocity is not None and event.velocity.changed:
            self._velocity = event.number
        # People's commands do not use the link.
        if event.command.source in PEOPLE:
            return
        took = self._engine.draw_link(2)
        if took != event.link:
            raise RunLogError(
                f"{self._path}: line {self.line}: the link took {event.link!r} s in the "
                f"log and {took!r} s now; in which order its delays were drawn is not known"
            )


def _closed(configuration: Configuration) -> ServerSettings:
    """The log's server settings, for this machine and this user only: a log does not contain the access
    token."""
    return replace(configuration.settings.server, host="127.0.0.1", any_user=False, token="")
