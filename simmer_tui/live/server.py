"""The robot's own thread: one event loop with the engine and all links, built from a configuration."""

from __future__ import annotations

import asyncio
import contextlib
import os
import selectors
import socket
import threading
import time
from collections.abc import Callable
from functools import cached_property, partial
from ipaddress import ip_address
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from msgspec.structs import replace

from simmer_tui import platform_has
from simmer_tui.config import variables
from simmer_tui.config.device_trust import VARIABLE as TRUSTED
from simmer_tui.config.dialects import SERIAL, all_ports
from simmer_tui.config.loader import Configuration
from simmer_tui.config.set_warnings import set_warnings
from simmer_tui.config.settings import LinkSettings, SerialSettings, ServerSettings
from simmer_tui.errors import PortError, RunLogError
from simmer_tui.links.access import AccessCheck
from simmer_tui.links.backend import BackendSwitch, CommandBudget, Message
from simmer_tui.links.clock_link import CLOCK
from simmer_tui.links.driver_lock import NOT_SERVED, DriverLock
from simmer_tui.links.link import Link, LinkContext, open_links, port_request, port_requests, typed_message
from simmer_tui.links.owners import OwnerLookup
from simmer_tui.links.ports import Listener, PortRequest, take_port
from simmer_tui.links.processes import ProcessLookup
from simmer_tui.links.protocol.mission_query import MissionQuery
from simmer_tui.links.pty_port import NOT_ON_WINDOWS, PtyDevice
from simmer_tui.live.late_events import TOGETHER, LateEvents
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.link_delay import LinkDelay
from simmer_tui.robot.playback_throttle import checked_pace
from simmer_tui.robot.program_clock import ProgramClock, ProgramClockLoop
from simmer_tui.robot.sessions import Answered, Session
from simmer_tui.run.events import Event, MissionEnd, Notice, NoticeKind
from simmer_tui.sim.command import MISSION_QUERY, Command, cut
from simmer_tui.sim.simulator import Simulator

if TYPE_CHECKING:  # Modules that only some runs need are imported in those.
    from simmer_tui.links.real_robot import RealRobot
    from simmer_tui.links.serial_link import RobotLink
    from simmer_tui.live.late_events import EventReader
    from simmer_tui.live.snapshot import Recorder, Snapshot
    from simmer_tui.report.live_verdict import LiveVerdict
    from simmer_tui.report.verdict import Verdict
    from simmer_tui.run.attempt import Task
    from simmer_tui.run.mission import MissionPlan, Referee
    from simmer_tui.run.reducer import Reducer
    from simmer_tui.run.run_history import RunHistory
    from simmer_tui.runlog.saved_runs import SavedRun
    from simmer_tui.runlog.writer import LineFile, ReplayedPrefix, RunLog
    from simmer_tui.sketch.board_link import BoardLink
    from simmer_tui.sketch.sketch_robot import SketchRobot, SketchSet, StartBoard

_T = TypeVar("_T")
# An environment variable, since other users can read the arguments of a process.
TOKEN = "SIMMER_TOKEN"
"""The environment variable with the token that programs must send first."""
# Judged: long enough for the last replies, short enough for Ctrl-C to feel immediate.
_ENDING = 0.7
"""Seconds that the robot's thread may take to end; nobody waits longer for it."""
# Together with `_ENDING` below 2 s, the most that the end of a run may take. Most searches take less than 0.1
# s.
_SEARCHING = 1.0
"""Seconds that the verdict's search may continue after the robot's thread has ended."""
# Judged: when a program has ended, its last bytes are in the system already. The limit is for a program whose
# child keeps the connection.
_DRAINING, _DRAIN_IDLE, _LOOK_AGAIN = 5.0, 1.5, 0.002
"""Seconds: the most that draining takes, the most without a command meanwhile, and between two looks."""
LAST_OUTPUT = 1.0
"""Seconds that a program may run after the end of its mission: enough to print its last output."""
# At most 50 checks a second, however near the limit, and at least one a second, because the speed may change
# meanwhile.
_SOON, _LATER = 0.02, 1.0
"""Least and greatest time between two checks of a mission's time limit, seconds."""


class Server:
    """A simulator that serves its ports from a daemon thread of its own, for the screen and for headless
    runs.

    Watchers are called in the robot's thread. Other threads reach the engine through `call`.
    """

    def __init__(
        self,
        configuration: Configuration,
        robot_link: Callable[[SerialSettings], RobotLink] | None = None,
        plan: MissionPlan | None = None,
        take: Callable[[str, PortRequest], Listener] = take_port,
        simulator: Simulator | None = None,
        prefix: ReplayedPrefix | None = None,
        sketches: SketchSet | None = None,
        start_board: StartBoard | None = None,
    ) -> None:
        """Take the ports and put the robot at its start. Raises PortError.

        `take` listens on a port of a host. A sandboxed program has another `take`, whose sockets listen in
        the sandbox's network.

        `robot_link` opens the connection to a real robot, by default its serial port. With a `plan` the run
        is a mission; configuration and plan come from `plan_run`. With a `prefix` the robot is `simulator`,
        and the events of the prefix are passed to watchers before `start`. With `sketches` the team's boards
        drive it; the configuration is that of `with_boards`. `start_board` starts them, by default with the
        access of this process.
        """
        settings = configuration.settings
        self.configuration = configuration
        self.seed = settings.run_seed()
        self.simulator = simulator or Simulator(configuration.simulation, self.seed)
        self.prefix = prefix
        motion = settings.motion
        self.engine = Engine(
            self.simulator,
            timed=motion.motion == "timed",
            time_scale=motion.time_scale,
            step_time=settings.step_time,
            link=link_delay(settings.link, self.seed),
        )
        self.referee: Referee | None = None
        self._has_mission = plan is not None
        if plan is not None:
            from simmer_tui.run.mission import Referee

            self._judged = self.new_reducer()
            self.referee = Referee(plan, self._judged, self.engine.tell)
            # The state is brought up to date before the referee reads it.
            self._follow = self._judged.apply
            self.engine.watch(lambda event: self._follow(event))
            self.engine.watch(self.referee.watch)
            # A mission that ends inside a wait also ends the wait.
            driving = self.engine.driving
            driving.limit_after, driving.limit_reached = self.referee.limit_after, self.referee.check
            self.engine.watch(MissionEnd(driving.cut).handle)
        self.warnings: list[str] = [*set_warnings(configuration)]
        """Problems that do not keep the robot from being driven."""
        self.late_faults: list[str] = []
        """Problems that came up too late for an event."""
        self.host = settings.server.host
        self._token = settings.server.token or os.environ.get(TOKEN, "").strip()
        self._take = take
        self._listeners: dict[str, Listener] = {}
        self.sketches = sketches
        """The compiled sketches of the boards, if the robot is driven by them."""
        self._start_board = start_board
        self.boards: SketchRobot | None = None
        """The boards, once they run."""
        self.boards_ended: Callable[[], None] = lambda: None
        """Called in the robot's thread when a board has died or hangs."""
        self._take_ports(settings.server)
        self.terminal = self._take_terminal(settings.server.pty)
        """The pseudo-terminal that leads to the robot, if there is one."""
        self._owners = None if settings.server.any_user else OwnerLookup()
        if self._owners is not None:
            # At once: programs may connect and leave before the robot's thread runs.
            for sock in self._listening:
                self._owners.hold_ends(sock)
        # The first of the warnings, because it is the urgent one.
        is_local = all(ip_address(sock.getsockname()[0]).is_loopback for sock in self._listening)
        if not (is_local or self._token):
            self.warnings.insert(
                0,
                f"anyone who reaches {self.host} can drive the robot: demand a token with --token, or take "
                "127.0.0.1, this machine only",
            )
        # Not the platform's default: the links use `add_reader`, which Windows' proactor loop does not have.
        self.clock = ProgramClock() if motion.is_by_program else None
        """The program's clock, if that is in force."""
        self._loop = ProgramClockLoop(self.clock) if self.clock else asyncio.SelectorEventLoop()
        self._links: list[Link] = []
        self._processes = ProcessLookup()
        self._log: RunLog | None = None
        self.program_command = ""
        """The command of `--run`, which logs keep; empty without one."""
        self.saved_run: SavedRun | None = None
        """The run in the folder of saved runs, if there is one."""
        self._backend = BackendSwitch(self.engine)
        self._backend.query = self._mission_query()
        self.board_link: BoardLink | None = None
        """The line between laptop and boards, if there is one."""
        self.robot: RealRobot | None = None
        """The connection to the real robot, if clients drive one. Other threads only read its properties."""
        self._robot_link = robot_link or _serial_link
        # A daemon: a driver that hangs must not keep the process alive.
        self._thread = threading.Thread(target=self._run, name="robot", daemon=True)
        self._client_left: Callable[[], None] = lambda: None
        self._probe_left: Callable[[], None] | None = None
        self._verdict: LiveVerdict | None = None
        self._unsaved = LateEvents(self.engine.tell_fault)
        """Events for the saved run and the verdict."""
        self._unshown = LateEvents(self.engine.tell_fault)
        """Events for snapshots."""
        # The log of a prefix asks for the time of each of its events when it comes.
        self._unsaved.together = self._unshown.together = 1

    def _take_ports(self, server: ServerSettings) -> None:
        """Take all ports. Raises PortError."""
        taken = self._listeners
        if self.sketches is not None:
            taken[SERIAL.purpose] = self._take_port(server.host, port_request(server, SERIAL))
        for dialect, requests in port_requests(server):
            try:
                for request in requests:
                    taken[request.purpose] = self._take_port(server.host, request)
            except PortError as error:
                # The server needs its command ports; without the port for beliefs it does less.
                if not dialect.warning:
                    self._close_listeners()
                    raise
                self.warnings.append(f"{dialect.warning}: {error}")
        if self.configuration.settings.motion.is_by_program:
            taken[CLOCK.purpose] = self._take(server.host, PortRequest(0, CLOCK.purpose, "--clock"))

    def _close_listeners(self) -> None:
        for listener in self._listeners.values():
            listener.close()

    def _take_port(self, host: str, request: PortRequest) -> Listener:
        """Take a port. Raises PortError."""
        try:
            return self._take(host, request)
        except PortError:
            if not request.falls_back:
                raise
        # Programs of --run get its number, whichever it is.
        listener = self._take(host, replace(request, number=0))
        self.warnings.append(
            f"port {request.number} (serial) is in use, perhaps by another simmer-tui: it is {listener.port} "
            f"here, for simmer-tui env --dialect-port {listener.port}"
        )
        return listener

    def _take_terminal(self, path: str) -> PtyDevice | None:
        """The pseudo-terminal at a path. None without a path, or where this run cannot have one. Raises
        PortError."""
        if not path:
            return None
        if not platform_has.POSIX:
            self.warnings.append(NOT_ON_WINDOWS)
        elif self.configuration.settings.motion.is_by_program:
            self.warnings.append(f"--pty: {NOT_SERVED}; use --clock real")
        elif SERIAL.purpose not in self._listeners or self._is_unwired:
            # `wiring.toml` allows the setting: whether its boards run is known here only.
            why = "no boards run; --sketch DIR runs those of wiring.toml"
            if self.sketches is not None:
                why = "wiring.toml has no [laptop], the line of a board to the program"
            self.warnings.append(f"--pty: {why}")
        else:
            try:
                return PtyDevice(path)
            except PortError:
                self._close_listeners()
                raise
        return None

    @property
    def _is_unwired(self) -> bool:
        """True if boards run, and none has a line to the program."""
        return self.sketches is not None and self.sketches.wiring.laptop is None

    @property
    def ports(self) -> dict[str, int]:
        """All ports taken, by purpose (`COMMANDS`, `REPLIES`, `PACKETS`, ...)."""
        return {purpose: listener.port for purpose, listener in self._listeners.items()}

    @property
    def environment(self) -> dict[str, str]:
        """The environment variables of a program on this machine: where to connect, the set, the robot's
        profiles and the mission."""
        taken, settings, directory = self.ports, self.configuration.settings, self.configuration.directory
        given = {variables.HOST: reachable_host(self.host)}
        for port in (*all_ports(), CLOCK):
            if port.purpose in taken:
                given[port.variable] = str(taken[port.purpose])
        optional = {
            # The program is our own child: it gets the token, or our own ports would refuse it.
            TOKEN: self._token,
            variables.SERIAL_NAMES: ",".join(settings.server.serial_names),
            # Not for a set that came from elsewhere, as in trials on other machines.
            variables.SET: str(directory.resolve()) if directory.is_dir() else "",
            variables.DRIVE_PROFILE: settings.drive_profile,
            variables.SENSOR_PROFILE: ",".join(settings.sensor_profile),
            # It may read the set, and runs with the same rights.
            TRUSTED: ",".join(device.sha256 for device in self.configuration.devices),
        }
        given |= {name: value for name, value in optional.items() if value}
        if self.referee is None:
            return given
        from simmer_tui.run.mission import environment

        return given | environment(self.referee.plan, self._gripper)

    @property
    def told_variables(self) -> dict[str, str]:
        """The variables that are told to those who ask (`simmer-tui env`): all but the token, which they have
        if there is one, and the program's clock, which is only for programs of `--run`."""
        return {name: text for name, text in self.environment.items() if name not in (TOKEN, CLOCK.variable)}

    @property
    def mission_told(self) -> str:
        """The facts of the mission that a program may know, in a line."""
        if self.referee is None:
            return "no mission: end this run, and start simmer-tui --mission"
        from simmer_tui.run.mission import environment

        known = environment(self.referee.plan, self._gripper)
        return ", ".join(f"{name} {text}" for name, text in known.items())

    @property
    def _gripper(self) -> str:
        """The code of the robot's gripper, which a mission needs."""
        gripper = self.configuration.simulation.gripper
        assert gripper is not None, "a mission without a gripper is refused"
        return gripper.code

    def _mission_query(self) -> MissionQuery | None:
        """The answers to queries for the mission's facts. None if the set's robot has their code itself."""
        spec = self.configuration.simulation
        if MISSION_QUERY in {row.code for row in (*spec.sensors, *spec.drive_rows, *spec.velocities)}:
            return None
        if self.referee is None:
            return MissionQuery()
        from simmer_tui.run.mission import facts

        return MissionQuery(facts(self.referee.plan, self._gripper))

    @property
    def _listening(self) -> list[socket.socket]:
        """The listening sockets of all ports."""
        return [sock for listener in self._listeners.values() for sock in listener.sockets]

    def start(
        self,
        watcher: Callable[[Event], None] | None = None,
        client_left: Callable[[], None] = lambda: None,
        probe_left: Callable[[], None] | None = None,
    ) -> None:
        """Begin to serve. `client_left` and `probe_left` are called in the robot's thread (`LinkContext`)."""
        if watcher is not None:
            self.engine.watch(watcher)
        self._client_left, self._probe_left = client_left, probe_left
        self._unsaved.together = self._unshown.together = TOGETHER
        self._thread.start()

    def call(self, function: Callable[..., object], *arguments: Any) -> None:
        """Call a function in the robot's thread."""
        self._loop.call_soon_threadsafe(function, *arguments)

    def drain(self) -> None:
        """Receive everything that a program sent before it ended. Returns when no connection is left.

        A connection that stays is waited for until no command has come for 1.5 seconds, and for 5 seconds at
        most. Do not call it in the robot's thread.
        """
        drained = asyncio.run_coroutine_threadsafe(self._drain(), self._loop)
        with contextlib.suppress(TimeoutError):
            drained.result(_DRAINING)
        drained.cancel()

    async def _drain(self) -> None:
        commands, until = -1, 0.0
        loop = self._loop
        pause = loop.real_pause if isinstance(loop, ProgramClockLoop) else asyncio.sleep
        while True:
            await pause(_LOOK_AGAIN)  # meanwhile waiting connections are accepted
            # A busy machine may need seconds for thousands of commands: the drain continues while they come.
            if self.simulator.commands != commands:
                commands, until = self.simulator.commands, time.monotonic() + _DRAIN_IDLE
            is_over = not self._has_waiting() and not any(link.has_clients for link in self._links)
            if is_over or time.monotonic() > until:
                return

    def _has_waiting(self) -> bool:
        """True if a connection waits to be accepted, such as one behind hundreds of refused ones."""
        with selectors.DefaultSelector() as selector:
            for sock in self._listening:
                if sock.fileno() != -1:  # closed: the server is being stopped
                    selector.register(sock, selectors.EVENT_READ)
            return bool(selector.select(0))

    def use_robot(self, port: str) -> None:
        """Let clients drive the real robot on a serial port from now on. Any thread may call it."""
        self.call(self._use_robot, port)

    def sent_nothing(self, code: int) -> bool:
        """True if a program, or its client, ended with exit code 0, but no command has come, and nothing over
        a dialect's line: most likely it has not found the port."""
        return not (code or self.simulator.commands or self.engine.exchanges)

    def note_output(self, settle: Callable[[], bool]) -> None:
        """Set the function that waits until all output of the program has been read (`ProgramClock`)."""
        if self.clock is not None:
            self.clock.settle_output = settle

    def run_without_program(self) -> None:
        """Let time pass as fast as the boards run, until the mission is over; by the real clock it passes
        anyway. Before `start`."""
        if self.clock is not None:
            self.engine.watch(MissionEnd(self.clock.pass_freely()).handle)

    def use_simulator(self) -> None:
        """Let clients drive the simulated robot from now on. Any thread may call it."""
        self.call(self._use_simulator)

    def _use_robot(self, port: str) -> None:
        if self.boards is not None:
            what = f"boards drive this robot: start without --sketch to drive the robot on {cut(port)}"
            self.engine.tell(Notice(NoticeKind.ROBOT, what))
            return
        # The old bridge answers its open commands before the new one is used.
        self._use_simulator()  # the same port cannot be open twice
        serial = replace(self.configuration.settings.serial, port=port)
        self.engine.tell(Notice(NoticeKind.ROBOT, f"programs drive the robot on {cut(port)}"))
        from simmer_tui.links.robot_bridge import bridge_to

        link = self._robot_link(serial)
        self.robot = bridge_to(self.configuration, self.engine, link, serial, self._backend)
        self._backend.use(self.robot)

    def _use_simulator(self) -> None:
        if self.robot is not None:
            self.robot = self._backend.byte_robot = None
            self._backend.use(None)
            self.engine.tell(Notice(NoticeKind.ROBOT, "programs drive the simulated robot"))

    def open_session(self, lane: str = "") -> Session:
        """A sender of commands beside the links. Movements are answered at once. Senders with the same `lane`
        share a turn. Any thread may open it; use it only in the robot's."""
        return self.engine.session(answer_at_end=False, lane=lane)

    def submit(
        self, message: Message, session: Session, answered: Answered, budget: CommandBudget | None = None
    ) -> None:
        """Send a message to whichever robot programs drive, within a `budget` if it has one. Only for the
        robot's thread."""
        self._backend.submit(message, session, answered, budget)

    def message(self, command: Command) -> Message:
        """The message for a command of a person, as a program of this configuration would send it."""
        return typed_message(self.configuration.settings.server, command)

    def tell(self, event: Event) -> None:
        """Pass an event to all watchers. Any thread may call it."""
        self.call(self.engine.tell, event)

    def tell_at_once(self, event: Event) -> None:
        """Pass an event to all watchers, and wait until they have handled it and the events that follow from
        it."""
        handled = threading.Event()
        self.call(self.engine.tell, event)
        self.call(handled.set)
        handled.wait(_ENDING)

    def start_log(self, file: str) -> Path:
        """Log the run from now on; an earlier log is closed. `auto` names the file by date. Returns the file.

        Raises RunLogError. Call it before `start`, or in the robot's thread.
        """
        from simmer_tui.runlog.writer import AUTO, auto_path

        path = auto_path() if file == AUTO else platform_has.expanded(file)
        if file == AUTO:
            self._warn_of_home()
        log = self._log_to(path)
        # The new log is open: if that had failed, the earlier one would continue.
        self.stop_log()
        self._log = log
        self.engine.watch(log)
        if self.boards is not None:
            self.boards.tell_shown()
        return path

    async def begin_log(self, file: str) -> Path:
        """Call `start_log` in the robot's thread, from another event loop."""
        return await self._in_robots_thread(self.start_log, file)

    async def _in_robots_thread(self, function: Callable[..., _T], *arguments: Any) -> _T:
        """The result of a function that is called in the robot's thread; awaited in another event loop."""

        async def call() -> _T:
            return function(*arguments)

        return await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(call(), self._loop))

    def stop_log(self) -> None:
        """Close the log, if there is one."""
        if self._log is not None:
            self.engine.unwatch(self._log)
            self._log.close()
            self._log = None

    def save_run(self) -> None:
        """Save the run in the user's data folder; before `start`. If that fails the run continues, with a
        warning."""
        from simmer_tui.runlog.saved_runs import SavedRun

        try:
            self.saved_run = SavedRun(self._log_to)
        except RunLogError as error:
            self.warnings.append(f"this run is not saved: {error}")
        else:
            self._read_late(self.saved_run)
            self._warn_of_home()

    def _read_late(self, reader: EventReader) -> None:
        """Pass all events to a reader, some together."""
        if not self._unsaved.readers:
            self.engine.watch(self._unsaved.watch)
        self._unsaved.readers.append(reader)

    async def flush_saved_run(self) -> None:
        """Wait until all events so far are in the saved run's file, for a second at most."""
        if self.saved_run is not None:
            await self._in_robots_thread(self._unsaved.pass_on)
            await asyncio.to_thread(self.saved_run.flush)

    def _warn_of_home(self) -> None:
        notice = platform_has.home_notice()
        if notice and notice not in self.warnings:
            self.warnings.append(notice)

    def _log_to(self, path: Path, file: Callable[[Path], LineFile] | None = None) -> RunLog:
        """A log of this run. Raises RunLogError."""
        from simmer_tui.runlog.run_command import run_command
        from simmer_tui.runlog.writer import RunLog

        command = self.program_command

        return RunLog(
            path,
            self.configuration,
            self.simulator,
            mission=self._has_mission,
            on_stop=self._log_stopped,
            file=file,
            prefix=self.prefix,
            run=run_command(command, self._token) if command else None,
            sketches=self._logged_sketches,
        )

    @property
    def _logged_sketches(self) -> dict[str, str] | None:
        if self.sketches is None:
            return None
        from simmer_tui.sketch.sketch_robot import logged_sketches

        return logged_sketches(self.sketches)

    def _log_stopped(self, why: str) -> None:
        if not self._thread.is_alive():
            self.late_faults.append(why)
        self.engine.tell_fault(why)

    def new_reducer(self) -> Reducer:
        """A reducer that begins with the present state of the run."""
        from simmer_tui.run.reducer import Reducer
        from simmer_tui.run.state import checkpoint_of

        scale = self.engine.time_scale
        return Reducer(checkpoint_of(self.simulator, mission=self._has_mission, time_scale=scale))

    def keep_history(self) -> RunHistory:
        """The history of the run from now on, until a mission ends. Call it before `start`."""
        from simmer_tui.report.mission_gate import Analysis

        if self.referee is None:
            self._judged = self.new_reducer()
            history = self._judged.history = self._history_of(self._judged, time.monotonic)
            self.engine.watch(self._judged.apply)
            return history
        # The referee's own reducer: a second one would do the same work again.
        history = self._history_of(self._judged, time.monotonic)
        self._follow = Analysis(self._judged, history, ends_history_only=True).apply
        return history

    @property
    def task(self) -> Task | None:
        """The mission, as an analysis of the run takes it; None without one."""
        from simmer_tui.run.attempt import task_of

        if self.referee is None:
            return None
        return task_of(self.configuration, self.seed, self.referee.plan)

    def _history_of(self, reducer: Reducer, now: Callable[[], float] | None = None) -> RunHistory:
        """A history that begins with the state of `reducer`; `now` is its clock, if events come without
        times."""
        from simmer_tui.config.nominal import nominal_of
        from simmer_tui.run.run_history import RunHistory

        read = partial(nominal_of, self.configuration)
        return RunHistory(reducer.checkpoint(), now=now, nominal=read)

    @cached_property
    def recorder(self) -> Recorder:
        """The store of the events that snapshots show."""
        from simmer_tui.live.snapshot import Recorder

        return Recorder(self.engine, self.new_reducer(), self.referee, self._verdict)

    def keep_verdict(self, *, has_program: bool) -> None:
        """Find the verdict when the run ends, and show it; before `record`. `has_program` is true if this
        process runs the program."""
        from simmer_tui.report.live_verdict import LiveVerdict

        reducer = self.new_reducer()
        history = self._history_of(reducer)
        self._verdict = LiveVerdict(reducer, history, self.task, self.call, self.engine.tell)
        if has_program:
            self._verdict.expect_program()
        self._read_late(self._verdict)

    @property
    def verdict(self) -> Verdict | None:
        """The verdict that `keep_verdict` has found; None while there is none. Any thread may ask."""
        return None if self._verdict is None else self._verdict.verdict

    def expect_program(self) -> None:
        """Note that the run has a program of its own from now on: its end counts, not that of its
        connections. Any thread may call it."""
        if self._verdict is not None:
            self.call(self._verdict.expect_program)

    def note_program(self, pid: int) -> None:
        """Note the process of the run's own program; after `start`. Any thread may call it."""
        self.call(self._processes.note_run, pid)

    def record(self, pace: float = 0.0) -> None:
        """Keep the events that snapshots show; before `start`.

        Movements are shown, and answered, at `pace`: simulated seconds a second, 0 as fast as possible.
        """
        self.engine.paced(self._loop, pace).watchers.add(self._unshown.watch)
        self._unshown.readers.append(self.recorder)

    @property
    def pace(self) -> float:
        """Pace of the movements shown, simulated seconds a second; 0 is as fast as possible. Any thread may
        ask."""
        throttle = self.engine.throttle
        return throttle.pace if throttle is not None else 0.0

    def set_pace(self, pace: float) -> None:
        """Show movements at another pace. Timed motion has none. Any thread may call it."""
        throttle = self.engine.throttle
        if throttle is not None and not self.engine.timed:
            throttle.pace = checked_pace(pace)
            if not pace:
                self.call(throttle.catch_up)

    @property
    def moving(self) -> bool:
        """True if the robot moves, or is shown moving. Any thread may ask."""
        throttle = self.engine.throttle
        return self.simulator.moving or (throttle is not None and throttle.busy)

    async def snapshot(self, since: int = 0, true_values: bool = False) -> Snapshot:
        """The present state (see `Recorder.snapshot`), asked for from another event loop."""
        return await self._in_robots_thread(self._snapshot, since, true_values)

    def _snapshot(self, since: int, true_values: bool) -> Snapshot:
        self._unshown.pass_on()
        # A crash loses what has not been saved since the last picture.
        self._unsaved.pass_on()
        return self.recorder.snapshot(since, true_values)

    @property
    def newest(self) -> int:
        """The running number of the newest event that a snapshot would show. Any thread may ask."""
        return self.recorder.number + len(self._unshown)

    @property
    def running(self) -> bool:
        """True if the robot's thread runs."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """Release the ports and end the thread. May be called more than once."""
        if self._thread.is_alive():
            self.call(self._loop.stop)
            self._thread.join(_ENDING)  # a daemon: if the system holds it up, it does not hold us up
        elif not self._loop.is_closed():
            self._close_ports()
            self._loop.close()
        self._unsaved.pass_on()
        if self._verdict is not None:
            self._verdict.close(_SEARCHING)
        self.stop_log()
        if self.saved_run is not None:
            self.engine.unwatch(self._unsaved.watch)
            self.saved_run.close()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.set_exception_handler(self._report)
        self._loop.call_soon(self._open)
        try:
            self._loop.run_forever()
        finally:
            # Connections first, then the robot: no command can come while it gives its last answers.
            self._close_ports()
            self._backend.close()
            self._loop.run_until_complete(_settle())
            # Last: whoever asks for the present time asks the boards.
            if self.boards is not None:
                self.boards.close()
            self._loop.close()

    def _open(self) -> None:
        settings = self.configuration.settings
        # Simulated time begins before the ports are served: the first command finds a running clock.
        self.engine.start(self._loop)
        access = AccessCheck(self.engine.tell, self._owners, token=self._token)
        if self.referee is not None:
            if self.prefix is None:
                self.referee.begin()
            self._check_mission(self.referee)
        if self.sketches is not None:
            self._start_boards(self.sketches)
        elif not settings.sim:
            self._use_robot(settings.serial.port)
        context = LinkContext(
            self.engine,
            self._backend,
            self._listeners,
            settings.server,
            settings.motion.reply,
            access,
            self._processes,
            self._client_left,
            self.clock,
            self.configuration.dialect,
            self.terminal,
            DriverLock(self.clock, self._processes) if SERIAL.purpose in self._listeners else None,
            probe_left=self._probe_left,
            variables=lambda: self.told_variables,
        )
        self._links += open_links(context)
        if self.boards is not None and SERIAL.purpose in self._listeners:
            from simmer_tui.sketch.board_link import BoardLink, UnwiredLink

            if self._is_unwired:
                self._links.append(UnwiredLink(context, tuple(self.boards.boards)))
            else:
                self.board_link = BoardLink(context, self.boards)
                self._links.append(self.board_link)
        if self.clock is not None:
            from simmer_tui.links.clock_link import ClockLink

            self._links.append(ClockLink(context))

    def _start_boards(self, sketches: SketchSet) -> None:
        """Start the boards: from now on simulated time passes with them."""
        from simmer_tui.sketch.sketch_robot import TICK, SketchRobot

        boards = self.boards = SketchRobot(sketches, self.engine, start_board=self._start_board)
        for name, built in sketches.built.items():
            for warning in built.warnings:
                self.engine.tell(Notice(NoticeKind.ROBOT, f"board {name}: {warning}"))
        boards.on_end = self._boards_over
        # A run without a screen has no recorder, and needs none.
        if "recorder" in self.__dict__:
            self.recorder.boards = boards.views
        self._backend.use(boards)
        if self.clock is not None:
            self.clock.boards = boards.run_clock_to
            self.clock.when_real = lambda: self._tick(TICK)
        else:
            self._tick(TICK)

    def _boards_over(self) -> None:
        """A board has died or hangs: a mission has failed, and the run is over, as after a crash."""
        assert self.boards is not None, "boards have ended"
        if self.referee is not None:
            self.referee.end(self.boards.failed, self.simulator.time)
        self.boards_ended()

    def _tick(self, period: float) -> None:
        """Bring the boards to the present regularly: by the real clock it passes without a command."""
        self.engine.now()
        self._loop.call_later(period, self._tick, period)

    def _check_mission(self, referee: Referee) -> None:
        """Check a mission's time limits regularly: in real time they pass without a command."""
        now = self.engine.now()
        referee.check(now)
        left = (referee.limit_after(now) - now) / self.engine.time_scale
        self._loop.call_later(min(max(left, _SOON), _LATER), self._check_mission, referee)

    def _report(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        text = f"{context.get('message', 'internal fault')}: {type(error).__name__}: {error}"
        self.engine.tell_fault(text)

    def _close_ports(self) -> None:
        """Close all connections, their listeners and the look-ups of processes."""
        for link in self._links:
            link.close()
        self._close_listeners()
        self._processes.close()
        if self._owners is not None:
            self._owners.close()
        if self.terminal is not None:
            self.terminal.close()


def reachable_host(host: str) -> str:
    """The address at which programs on this machine reach ports that were taken on `host`."""
    # The address that represents "all interfaces" cannot be connected to.
    here = {"localhost": "127.0.0.1", "0.0.0.0": "127.0.0.1", "::": "::1"}
    return here.get(host, host)


def link_delay(link: LinkSettings, seed: int) -> LinkDelay | None:
    """The simulated latency between programs and the robot; None if there is none."""
    return LinkDelay(link.latency, link.jitter, seed) if link.latency or link.jitter else None


def _serial_link(serial: SerialSettings) -> RobotLink:
    from simmer_tui.links.serial_link import SerialLink

    return SerialLink(serial.port, serial.baud, moves_dtr=serial.dtr)


async def _settle() -> None:
    """Let connections that are closing send their last bytes."""
    # Judged: one turn of the loop for the close, one for its callbacks, one to spare.
    for _ in range(3):
        await asyncio.sleep(0)
    remaining = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
    for task in remaining:
        task.cancel()
    await asyncio.gather(*remaining, return_exceptions=True)
