"""One run: a simulator with ports of its own in this process, and the program in another."""

from __future__ import annotations

import math
import os
import queue
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from msgspec import structs

from simmer_tui.config import maze_csv, variables
from simmer_tui.config.loader import Configuration
from simmer_tui.config.mission_plan import MissionPlan
from simmer_tui.config.settings import ELSE_REAL
from simmer_tui.errors import InterruptedTrialError, ProgramError
from simmer_tui.links.ports import Listener, PortRequest, take_port
from simmer_tui.live.server import LAST_OUTPUT, Server
from simmer_tui.program import Keeper, Program, ProgramOutput, RunningProgram
from simmer_tui.report.finding import plain_findings
from simmer_tui.report.verdict import findings_of, verdict_of
from simmer_tui.run.events import Event, MissionEnd, Result
from simmer_tui.run.mission import MissionState
from simmer_tui.run.phrases import REAL_TIME_LIMIT, exit_text, last_output
from simmer_tui.run.run_history import RunHistory
from simmer_tui.runlog.writer import LOG, PACKED
from simmer_tui.sim.command import cut
from simmer_tui.sim.simulator import Simulator
from simmer_tui.trials.trial import REAL, Ending, Trial, TrialResult, prepare, run_clock, with_clock
from simmer_tui.whole_file import write_whole

if TYPE_CHECKING:
    from simmer_tui.sketch.board_process import BoardProcess

PACKED_LOG, OUTPUT, _MAZE = f"{LOG}{PACKED}", ".txt", ".maze.csv"
"""Name endings of a run's compressed log, of its program's output and of a maze of its own."""
# 2 MB of output at most in memory and on the disk: a program in a loop prints gigabytes.
_LINES, _LINE_LENGTH = 2000, 1000
# A check of the file costs a system call; 1000 events are at most some hundred kilobytes of log.
_LOOK_EVERY = 1000
"""Events after which the size of a log is checked."""
_SETTLE = 1.0
"""Longest wait for the end of a mission that was asked to end, seconds. It takes milliseconds."""


class Sandbox(Protocol):
    """Surroundings of a program: the ports that its simulator listens on, and its start."""

    def take(self, host: str, request: PortRequest) -> Listener:
        """Listen on a port that the program can reach. Raises PortError."""

    def start(
        self,
        command: str,
        variables: Mapping[str, str],
        on_end: Callable[[int], None],
        on_line: Callable[[str], None],
        *,
        output: ProgramOutput,
    ) -> RunningProgram:
        """Start the program, as `Program` does. Raises ProgramError."""

    def board(self, name: str, program: Path, options: Sequence[str]) -> BoardProcess:
        """Start a board. A failure is told when it is received from."""

    def close(self) -> None:
        """Remove all of it."""


class Unconfined:
    """No sandbox: the program has the same access as this process."""

    take = staticmethod(take_port)

    def __init__(self, folder: Path | None, keeper: Keeper | None) -> None:
        # A worker with a keeper does one run after the other; on a cluster the process also does other work.
        self.start = partial(Program, folder=folder, keeper=keeper, adopts=keeper is not None)

    def board(self, name: str, program: Path, options: Sequence[str]) -> BoardProcess:
        from simmer_tui.sketch.board_process import BoardProcess

        return BoardProcess(name, program, options)

    def close(self) -> None:
        pass


class TrialRun:
    """Make it, call `run` once; `interrupt` ends it from another thread."""

    def __init__(
        self,
        trial: Trial,
        folder: Path,
        start: Path | None = None,
        sandbox: Callable[[], Sandbox] | None = None,
        most_log: float = math.inf,
        keeper: Keeper | None = None,
    ) -> None:
        """`folder` gets the run's log (compressed for a sandboxed program) and its output. The program is
        started in `start`, by default the working directory, or in the sandbox that `sandbox` makes. Writing
        of a log stops beyond `most_log` bytes."""
        self._most_log = most_log
        self._trial = trial
        self._is_confined = sandbox is not None
        self._new_sandbox = sandbox or (lambda: Unconfined(start, keeper))
        self._log = folder / f"{trial.name}{LOG if sandbox is None else PACKED_LOG}"
        self._output_file = folder / f"{trial.name}{OUTPUT}"
        self._maze_file = folder / f"{trial.name}{_MAZE}"
        self._happened: queue.SimpleQueue[_What | int] = queue.SimpleQueue()

    def interrupt(self) -> None:
        """Make `run` raise InterruptedTrialError soon. Any thread may ask."""
        self._happened.put(_What.STOP)

    def run(self) -> TrialResult:
        """Do the run. Raises ConfigurationError, PortError, RunLogError, InterruptedTrialError, and
        ProgramError if the program cannot be started and is in no sandbox."""
        configuration, plan = prepare(self._trial)
        clock = run_clock(configuration)
        result = self._attempt(with_clock(configuration, clock), plan)
        if clock == ELSE_REAL and result.clock == "program" and result.clock_note:
            self._forget()
            again = self._attempt(with_clock(configuration, REAL), plan)
            return structs.replace(again, clock_note=result.clock_note)
        return result

    def _forget(self) -> None:
        """Forget the end of an attempt before another. Raises InterruptedTrialError."""
        while not self._happened.empty():
            if self._happened.get() is _What.STOP:
                raise InterruptedTrialError

    def _attempt(self, configuration: Configuration, plan: MissionPlan | None) -> TrialResult:
        """Do the run with one clock."""
        self._output: deque[str] = deque(maxlen=_LINES)
        self._events = 0
        self._mission_end = MissionEnd(lambda: self._happened.put(_What.OVER))
        started, used = time.perf_counter(), time.process_time()
        self._sandbox = self._new_sandbox()
        try:
            sketches = self._trial.sketches
            server = Server(
                configuration,
                plan=plan,
                take=self._sandbox.take,
                sketches=sketches,
                start_board=None if sketches is None else self._sandbox.board,
            )
            simulator, history = server.simulator, server.keep_history()
            try:
                end = self._drive(server, configuration)
            finally:
                server.stop()
        finally:
            self._sandbox.close()
        state = None if server.referee is None else server.referee.state()
        end = _judged(end, state)
        words = self._keep_output(end, history)
        task = server.task
        findings = findings_of(history, task)
        cut_off = end.ending is Ending.REAL_TIME_LIMIT
        verdict = verdict_of(history, task, cut_off=cut_off, findings=findings)
        return structs.replace(
            fault_result(self._trial, self._reason(end, server), configuration),
            success=end.ending is Ending.SUCCESS,
            ending=end.ending,
            exit_code=end.exit_code,
            drop_zone=None if plan is None else (plan.drop_zone.x, plan.drop_zone.y),
            last_output=words,
            verdict=verdict.plain() | {"last_moments": verdict.last_moments},
            clock=_clock(server),
            clock_note="" if server.clock is None else server.clock.unfit,
            findings=plain_findings(findings),
            real_seconds=time.perf_counter() - started,
            simulator_seconds=time.process_time() - used,
            **(_measured_figures(simulator, history) if state is None else _judged_figures(state)),
        )

    def _keep_output(self, end: _End, history: RunHistory) -> str:
        """Write the program's output to its file; returns its last lines."""
        lines = list(self._output)
        if lines:
            write_whole(self._output_file, "".join(f"{line}\n" for line in lines))
        # The output of a program that was killed depends on timing.
        if end.exit_code is None and end.ending is not Ending.REAL_TIME_LIMIT:
            return ""
        return last_output(history.programs.items[-1].event) if history.programs.items else ""

    def _drive(self, server: Server, configuration: Configuration) -> _End:
        """Let the program, or the boards alone, drive the robot until the run ends."""
        for leftover in (self._log, self._output_file):  # of a run that was cut off
            leftover.unlink(missing_ok=True)
        server.start_log(str(self._log))
        server.boards_ended = lambda: self._end_boards(server)
        if not self._trial.command:
            server.run_without_program()
            server.start(lambda event: self._watch(event, server))
            return self._wait(server)
        server.start(lambda event: self._watch(event, server))
        given = server.environment | {"SIMMER_RUN": str(self._trial.repetition or self._trial.number)}
        if self._is_confined:  # a sandbox does not see our folders
            given.pop(variables.SET, None)
        if "PYTHONHASHSEED" not in os.environ:  # else sets of text have another order in every process
            given["PYTHONHASHSEED"] = "0"
        if self._trial.maze:  # the set's own maze is one that a program may know
            write_whole(self._maze_file, configuration.files[maze_csv.FILE])
            given[variables.MAZE] = str(self._maze_file.resolve())
        output = ProgramOutput(lambda: server.engine.present)
        server.note_output(output.settle)
        try:
            program = self._sandbox.start(
                self._trial.command, given, self._happened.put, self._take_line, output=output
            )
        except ProgramError as error:
            # In a grading a program that cannot be started is a failure; in trials it is the user's mistake.
            if not self._is_confined:
                raise
            ended = output.not_started(error)
            server.tell(ended)
            return self._give_up(server, _End(Ending.EXIT, ended.exit_code))
        grace = 0.0
        try:
            end = self._wait(server, program, output)
            if server.referee is not None and server.referee.result is Result.SUCCESS:
                grace = LAST_OUTPUT
        finally:
            program.end(grace)
        if end.exit_code is None:  # it had not ended when the run did
            self._tell_end(server, program, output)
        return end

    def _end_boards(self, server: Server) -> None:
        """Note that a board has died or hangs, in the robot's thread. A program's time stands still until it
        is ended: so the log ends the same every time."""
        if server.clock is not None:
            server.clock.frozen = True
        self._happened.put(_What.BOARDS)

    def _tell_end(self, server: Server, program: RunningProgram, output: ProgramOutput) -> None:
        """Tell the end of the program, if it has ended by now."""
        code: _What | int = _What.NOTHING
        while not self._happened.empty() and not isinstance(code, int):
            code = self._happened.get()
        if isinstance(code, int):
            server.tell(output.end(code, stopped=program.stopped))

    def _watch(self, event: Event, server: Server) -> None:
        """Handle an event, in the robot's thread."""
        self._events += 1
        is_time = self._most_log < math.inf and self._events % _LOOK_EVERY == 0
        if is_time and self._log.stat().st_size > self._most_log:
            server.stop_log()
        self._mission_end.handle(event)

    def _take_line(self, line: str) -> None:
        self._output.append(cut(line, _LINE_LENGTH))

    def _wait(
        self, server: Server, program: RunningProgram | None = None, output: ProgramOutput | None = None
    ) -> _End:
        """Wait for the end of the run; a mission is over then."""
        deadline = time.monotonic() + self._trial.time_limit
        what = self._next(deadline)
        if what is _What.BOARDS or (what is _What.OVER and _boards_text(server)):
            return _End(Ending.BOARDS)
        if what is _What.OVER:
            return _End(Ending.FAULT)  # replaced by the referee's result
        end = _End(Ending.REAL_TIME_LIMIT)
        if isinstance(what, int):
            assert program is not None, "a program has ended"
            assert output is not None, "it has output"
            program.end()  # processes that it left running must not drive any more
            server.drain()
            server.tell(output.end(what))
            end = _End(Ending.SILENCE if server.sent_nothing(what) else Ending.EXIT, what)
        return self._give_up(server, end)

    def _give_up(self, server: Server, end: _End) -> _End:
        """End a mission that cannot be finished any more."""
        if server.referee is not None:
            server.call(server.referee.end, self._reason(end, server))
            if server.referee.result is Result.UNDER_WAY:
                self._until_over()
        return end

    def _until_over(self) -> None:
        deadline = time.monotonic() + _SETTLE
        while self._next(deadline) not in (_What.OVER, _What.NOTHING):
            pass

    def _reason(self, end: _End, server: Server) -> str:
        """The reason of an end that is no success; empty for a success."""
        if end.ending is Ending.SUCCESS:
            return ""
        if end.ending is Ending.REAL_TIME_LIMIT:
            return f"{REAL_TIME_LIMIT} of {self._trial.time_limit:g} s"
        if end.ending is Ending.SILENCE:
            return Ending.SILENCE.value
        if end.ending is Ending.BOARDS:
            return _boards_text(server)
        return exit_text(end.exit_code)

    def _next(self, deadline: float) -> _What | int:
        """The next event of the run, an exit code for the program's end; NOTHING when time is up."""
        try:
            what = self._happened.get(timeout=max(deadline - time.monotonic(), 0.0))
        except queue.Empty:
            return _What.NOTHING
        if what is _What.STOP:
            raise InterruptedTrialError
        return what


def _boards_text(server: Server) -> str:
    """The sentence about a board that has died or hangs; empty if all run, or there are none."""
    return "" if server.boards is None else server.boards.failed


def _clock(server: Server) -> str:
    """The clock of a run, as its result has it."""
    if server.clock is not None and not server.clock.is_real:
        return "program"
    return REAL if server.configuration.settings.motion.motion == "timed" else "instant"


class _What(Enum):
    """Events that end the wait for a program."""

    OVER = "the mission is over"
    BOARDS = "a board has died or hangs"
    STOP = "the run must stop"
    NOTHING = "time is up"


@dataclass(frozen=True, slots=True)
class _End:
    ending: Ending
    exit_code: int | None = None


def _judged(end: _End, state: MissionState | None) -> _End:
    """The end of the run in its result: that of the mission; without a mission, exit code 0 is success if a
    command was sent."""
    if state is None:
        done = end.exit_code == 0 and end.ending is not Ending.SILENCE
        return replace(end, ending=Ending.SUCCESS) if done else end
    if state.result is Result.SUCCESS:
        return _End(Ending.SUCCESS)
    return end if state.broken is None else _End(Ending(state.broken.value))


def _measured_figures(simulator: Simulator, history: RunHistory) -> dict[str, Any]:
    """The figures of a run without a mission, by the fields of its result."""
    return {
        **{name: getattr(simulator, name) for name in ("time", "commands", "contacts")},
        "distance": simulator.distance_at(simulator.time),
        "contact_points": tuple(row.point for row in history.contacts.items),
        "end": structs.astuple(simulator.pose),
    }


def _judged_figures(state: MissionState) -> dict[str, Any]:
    """The figures of a mission as its referee counts them, by the fields of the run's result."""
    same = ("reason", "time", "distance", "commands", "contacts", "contact_points")
    figures = {name: getattr(state, name) for name in same}
    goals = {goal.key: time for goal, time in state.goals.items()}
    return figures | goals | {"end": structs.astuple(state.pose)}


def fault_result(trial: Trial, reason: str, configuration: Configuration | None = None) -> TrialResult:
    """The result of a run in which the simulator or its process failed. Its start is that of `configuration`,
    by default the trial's."""
    settings = (configuration or trial.configuration).settings
    start = (*settings.bot_center, settings.bot_rot)
    return TrialResult(
        number=trial.number,
        seed=trial.seed,
        maze=trial.maze,
        reason=reason,
        start=start,
        end=start,
        block=settings.block_center,
    )
