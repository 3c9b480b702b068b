"""Runs in parallel on this machine: each worker is a process that does one run after the other.

A simulator in the worker itself starts in milliseconds; a new process for each run would first import all its
modules. A worker that dies loses one run and is replaced.

The pool is our own. That of concurrent.futures breaks when one worker dies, and has no time limit. Pebble's
notices a worker that ends with exit code 0 only at its time limit.
"""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import queue
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterable
from functools import partial
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any, Protocol

from simmer_tui import platform_has
from simmer_tui.errors import InterruptedTrialError, SimmerError, TrialsError, reason_of
from simmer_tui.program import Keeper
from simmer_tui.trials.run import TrialRun, fault_result
from simmer_tui.trials.trial import Trial, TrialResult

# A run ends within seconds of its limit, later on an overloaded machine.
_OVERDUE = 30.0
"""Time from the real time limit until a worker that does not answer is killed, seconds. Only a simulator that
hangs needs it."""
_JOIN_TIMEOUT = 10.0
"""Time limit for workers to end their runs, seconds. Programs get 1.5 s of it before they are killed."""


class Make(Protocol):
    """Makes a run of a trial, with a folder for its log and a keeper for its program, in a worker."""

    def __call__(self, trial: Any, folder: Path, *, keeper: Keeper) -> TrialRun: ...


def run_locally(
    trials: Iterable[Trial], folder: Path, jobs: int, make: Make = TrialRun
) -> Generator[TrialResult, None, None]:
    """The results of all trials, each as soon as it is there, `jobs` at a time. Logs are written to `folder`.
    A trial is taken from the iterator when it can begin, so the next ones may depend on the results.

    When the iterator is closed, the runs under way are ended and have no result. Raises TrialsError
    if a run cannot be done at all.
    """
    waiting = iter(trials)
    workers: list[_Worker] = []
    try:
        while True:
            while len(workers) < jobs and (trial := next(waiting, None)) is not None:
                workers.append(_Worker(folder, trial, make))
            if not workers:
                return
            until = min(worker.deadline for worker in workers) - time.monotonic()
            ready = wait([worker.connection for worker in workers], max(until, 0.0))
            for worker in tuple(workers):
                result = worker.take() if worker.connection in ready else worker.overdue()
                if result is None:
                    continue
                yield result
                if worker.is_alive and (trial := next(waiting, None)) is not None:
                    worker.give(trial)
                else:  # the loop above replaces a worker that died
                    worker.dismiss()
                    workers.remove(worker)
    finally:
        for worker in workers:
            worker.dismiss()
        for worker in workers:
            worker.join()


class _Worker:
    """A process, and the run it is doing."""

    def __init__(self, folder: Path, trial: Trial, make: Make) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, other_end = context.Pipe()
        self._process: SpawnProcess = context.Process(
            target=work, args=(other_end, folder, make), name="trials", daemon=True
        )
        self._process.start()
        other_end.close()  # otherwise the end of the worker would not close the connection
        self.is_alive = True
        self.give(trial)

    def give(self, trial: Trial) -> None:
        self.trial = trial
        self.deadline = time.monotonic() + trial.longest + _OVERDUE
        with contextlib.suppress(OSError):  # it has died: `take` finds the connection closed
            self.connection.send(trial)

    def take(self) -> TrialResult:
        """The result that has come; a fault if the worker has ended. Raises TrialsError."""
        try:
            result: TrialResult | TrialsError = self.connection.recv()
        except (EOFError, OSError):
            self.kill()
            code = self._process.exitcode
            return fault_result(self.trial, f"the simulator's process died with exit code {code}")
        if isinstance(result, TrialsError):
            raise result
        return result

    def overdue(self) -> TrialResult | None:
        """Kill the worker and return a fault, if its run is overdue; else None."""
        if time.monotonic() <= self.deadline:
            return None
        self.kill()
        return fault_result(self.trial, "the simulator did not end, and was killed")

    def kill(self) -> None:
        self.is_alive = False
        self.connection.close()
        self._process.kill()
        self._process.join()

    def dismiss(self) -> None:
        """Make it end its run, if there is one, and then itself."""
        if self.is_alive:
            self.connection.close()

    def join(self) -> None:
        """Wait for its end after `dismiss`."""
        self._process.join(_JOIN_TIMEOUT)
        if self._process.exitcode is None:
            self._process.kill()
            self._process.join()


def work(connection: Connection, folder: Path, make: Make = TrialRun) -> None:
    """Main function of a worker: does the runs that come through `connection`, until it is closed at the
    other end."""
    gc.freeze()  # imported modules stay: collections need not traverse them again
    interruptions = _Interruptions()
    trials: queue.SimpleQueue[Trial | None] = queue.SimpleQueue()

    def receive() -> None:
        """Receive trials; the end of the connection, for any reason, ends the run as well."""
        with contextlib.suppress(EOFError, OSError):
            while True:
                trials.put(connection.recv())
        trials.put(None)
        interruptions.interrupt()

    threading.Thread(target=receive, name="orders", daemon=True).start()
    with contextlib.closing(Keeper()) as keeper:
        while (trial := trials.get()) is not None:
            try:
                answer = _result(trial, partial(make, keeper=keeper), folder, interruptions)
            except InterruptedTrialError:
                return
            if interruptions.any:  # its program may have been interrupted as well, and shows it
                return
            with contextlib.suppress(OSError):  # the other end is closed; `receive` handles that
                connection.send(answer)


def _result(
    trial: Trial, make: Callable[[Trial, Path], TrialRun], folder: Path, interruptions: _Interruptions
) -> TrialResult | TrialsError:
    """The result of a run, or the reason why no run can be done. Raises InterruptedTrialError."""
    try:
        run = make(trial, folder)
        interruptions.run = run
        if interruptions.any:
            raise InterruptedTrialError
        return run.run()
    except InterruptedTrialError:
        raise
    except SimmerError as error:
        return TrialsError(str(error))
    except OSError as error:
        return TrialsError(f"{trial.label}: {error.filename or folder}: {reason_of(error)}")
    except Exception as error:  # noqa: BLE001 - a fault in one run must not end the others
        return fault_result(trial, f"{type(error).__name__}: {error}")


class _Interruptions:
    """Interruption by Ctrl-C, or by the end of the parent process."""

    def __init__(self) -> None:
        self.any = False
        self.run: TrialRun | None = None
        # Ctrl-C in a terminal is for the process that started the trials, which decides about the runs. It is
        # handled, not ignored: control programs inherit an ignored signal.
        signal.signal(signal.SIGINT, lambda number, frame: self.interrupt())
        platform_has.leave_process_group()  # so that Ctrl-C reaches neither this process nor its programs

    def interrupt(self) -> None:
        self.any = True
        if self.run is not None:
            self.run.interrupt()
