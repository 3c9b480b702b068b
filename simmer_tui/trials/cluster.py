"""Runs on a Dask cluster. Needs the extra `simmer-tui[dask]`, here and on the cluster's workers."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import CancelledError
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from simmer_tui.errors import ClusterError, SimmerError, TrialsError
from simmer_tui.sim.command import escape
from simmer_tui.trials.program_bundle import ProgramBundle, unpack
from simmer_tui.trials.record import TrialResult
from simmer_tui.trials.run import TrialRun, fault_result
from simmer_tui.trials.trial import Trial

if TYPE_CHECKING:
    from distributed import Client, Future

# A scheduler on the same network answers within milliseconds; Dask's own 30 s look like a hang.
CONNECT_TIMEOUT = "10s"
_LOST = "the connection to the Dask scheduler was lost"
_Files = dict[str, bytes]
AnyTrial = TypeVar("AnyTrial", bound=Trial)


def connect(address: str) -> Client:
    """A client of the cluster's scheduler, such as `tcp://10.0.0.7:8786`. Raises ClusterError,
    TrialsError."""
    try:
        from distributed import Client
    except ImportError:
        raise TrialsError("--dask needs the package distributed: pip install 'simmer-tui[dask]'") from None
    try:
        return Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except ValueError as error:
        raise TrialsError(f"--dask {escape(address, 200)}: {error}") from None
    except OSError as error:
        raise ClusterError(
            f"--dask {escape(address, 200)}: no Dask scheduler answers there: {error}"
        ) from None


def run_on_cluster(
    trials: Iterable[Trial], program: ProgramBundle, folder: Path, client: Client
) -> Generator[TrialResult, None, None]:
    """The results of all trials, each when it is there. Logs come back and go to `folder`.

    The program's files travel to each worker once. Raises what `results_of` does.
    """
    # Not pure: what has been computed for other trials with the same inputs is not to be reused.
    # The program is a task's result rather than scattered: it is made anew when its worker is lost.
    packed = client.submit(_itself, program, pure=False)

    def submit(trial: Trial) -> Future:
        return client.submit(run_there, trial, packed, pure=False, priority=-trial.number)

    yield from results_of(trials, submit, folder, client)


def results_of(
    trials: Iterable[AnyTrial], submit: Callable[[AnyTrial], Future], folder: Path, client: Client
) -> Generator[TrialResult, None, None]:
    """The results of runs that `submit` sends to the cluster, each when it is there, with the files it
    leaves, which go to `folder`. Twice as many are sent at a time as the workers have threads; a trial is
    asked for when it is sent, so which are to come may depend on the results.

    When the iterator is closed, runs that have not begun are cancelled. Raises ClusterError when the
    scheduler is lost, TrialsError if a run cannot be done at all.
    """
    from distributed import as_completed

    waiting = iter(trials)
    at_once = 2 * max(sum(client.nthreads().values()), 1)
    futures = {submit(trial): trial for trial in islice(waiting, at_once)}
    completed = as_completed(list(futures), loop=client.loop)
    try:
        for future in completed:
            trial = futures.pop(future)
            if future.cancelled():  # nobody but a lost scheduler does it
                raise ClusterError(_LOST)
            error = future.exception()
            if isinstance(error, SimmerError):
                raise TrialsError(str(error))
            if error is not None:  # a fault, or a worker that was lost again and again
                yield fault_result(trial, f"{type(error).__name__}: {error}")
            else:
                result, files = _fetched(future)
                for name, data in files.items():
                    (folder / name).write_bytes(data)
                future.release()
                yield result
            for following in islice(waiting, 1):
                future = submit(following)
                futures[future] = following
                completed.add(future)
    finally:
        if client.status == "running":
            client.cancel(list(futures))


def _fetched(future: Future) -> tuple[TrialResult, _Files]:
    """Result and files of a run, from the worker that did it. Raises ClusterError."""
    try:
        made: tuple[TrialResult, _Files] = future.result()
    except (OSError, TimeoutError, CancelledError) as error:
        raise ClusterError(f"{_LOST}: {error}") from None
    return made


def _itself(program: ProgramBundle) -> ProgramBundle:
    return program


def run_there(trial: Trial, program: ProgramBundle) -> tuple[TrialResult, _Files]:
    """A run, and the files it leaves; on the cluster. Raises SimmerError if it cannot be done."""
    with tempfile.TemporaryDirectory(prefix="simmer-tui-", ignore_cleanup_errors=True) as name:
        folder, start = Path(name, "run"), Path(name, "program")
        folder.mkdir()
        start.mkdir()
        try:
            moved = replace(trial, command=unpack(program, start))
            result = TrialRun(moved, folder, start).run()
        except SimmerError as error:
            raise TrialsError(str(error)) from None  # some others do not survive the way back
        return result, {path.name: path.read_bytes() for path in folder.iterdir()}


def check_workers(client: Client) -> None:
    """Raises ClusterError if there is nobody to do a run."""
    information: dict[str, Any] = client.scheduler_info(n_workers=-1)
    if not information["workers"]:
        raise ClusterError("--dask: the cluster has no workers")
