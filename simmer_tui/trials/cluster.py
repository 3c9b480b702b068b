"""Runs on a Dask cluster. Needs the extra `simmer-tui[dask]`, here and on the cluster's workers."""

from __future__ import annotations

import tempfile
from collections.abc import Generator, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simmer_tui.errors import SimmerError, TrialsError
from simmer_tui.sim.command import escape
from simmer_tui.trials.record import TrialResult
from simmer_tui.trials.run import TrialRun, fault_result
from simmer_tui.trials.trial import Trial

if TYPE_CHECKING:
    from distributed import Client

_CONNECT_TIMEOUT = "10s"
_Files = dict[str, bytes]


def connect(address: str) -> Client:
    """A client of the cluster's scheduler, such as `tcp://10.0.0.7:8786`. Raises TrialsError."""
    try:
        from distributed import Client
    except ImportError:
        raise TrialsError("--dask needs the package distributed: pip install 'simmer-tui[dask]'") from None
    try:
        return Client(address, timeout=_CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise TrialsError(
            f"--dask {escape(address, 200)}: no Dask scheduler answers there: {error}"
        ) from None


def run_on_cluster(
    trials: Iterable[Trial], folder: Path, client: Client
) -> Generator[TrialResult, None, None]:
    """The results of all trials, each when it is there. Logs come back and go to `folder`.

    Programs are started in the working directory of the cluster's workers. When the iterator is
    closed, runs that have not begun are cancelled. Raises TrialsError if a run cannot be done at all.
    """
    from distributed import as_completed

    # Not pure: what has been computed for other trials with the same inputs is not to be reused.
    futures = {client.submit(run_there, trial, pure=False): trial for trial in trials}
    try:
        for future in as_completed(futures, loop=client.loop):
            trial = futures.pop(future)
            error = future.exception()
            if isinstance(error, SimmerError):
                raise TrialsError(str(error))
            if error is not None:  # a fault, or a worker that was lost again and again
                yield fault_result(trial, f"{type(error).__name__}: {error}")
                continue
            result, files = future.result()
            for name, data in files.items():
                (folder / name).write_bytes(data)
            future.release()
            yield result
    finally:
        client.cancel(list(futures))


def run_there(trial: Trial) -> tuple[TrialResult, _Files]:
    """A run, and the files it leaves; on the cluster. Raises SimmerError if it cannot be done."""
    with tempfile.TemporaryDirectory(prefix="simmer-tui-") as name:
        folder = Path(name)
        try:
            result = TrialRun(trial, folder).run()
        except SimmerError as error:
            raise TrialsError(str(error)) from None  # some others do not survive the way back
        return result, {path.name: path.read_bytes() for path in folder.iterdir()}


def check_workers(client: Client) -> None:
    """Raises TrialsError if there is nobody to do a run."""
    information: dict[str, Any] = client.scheduler_info(n_workers=-1)
    if not information["workers"]:
        raise TrialsError("--dask: the cluster has no workers")
