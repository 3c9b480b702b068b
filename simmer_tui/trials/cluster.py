"""Runs on a Dask cluster, whose workers share no folder with this machine.

The program's files and its command are sent there, results and logs come back. Needs the extra
`simmer-tui[dask]`, here and on the workers.
"""

from __future__ import annotations

import importlib
import os
import shlex
import sys
import tempfile
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import CancelledError
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, TypeVar

from simmer_tui import platform_has
from simmer_tui.config.leftovers import is_environment, is_leftover, is_leftover_folder
from simmer_tui.errors import ClusterError, SimmerError, TrialsError, reason_of
from simmer_tui.program.program_command import is_python
from simmer_tui.program.shell_syntax import shell_problem
from simmer_tui.trials.run import TrialRun, fault_result
from simmer_tui.trials.trial import Trial, TrialResult
from simmer_tui.version import requirement
from simmer_tui.whole_file import write_whole

if TYPE_CHECKING:
    from distributed import Client, Future

# Each worker receives all files before its first run: programs have kilobytes, an environment hundreds of
# megabytes.
MOST_PROGRAM_BYTES, MOST_PROGRAM_FILES = 8_000_000, 2000
_ELSEWHERE = "elsewhere"
"""Folder of files from outside the working directory."""
_PYTHON = "python"
"""Python in a packed command: each machine uses its own."""
_OWN_RESULTS = "trials.json"


@dataclass(frozen=True, slots=True)
class PackedFile:
    """Content of a file, and True if it can be started."""

    data: bytes
    executable: bool


@dataclass(frozen=True, slots=True)
class ProgramBundle:
    """The words of a command, and the files that they name, by relative path with slashes."""

    words: tuple[str, ...]
    files: dict[str, PackedFile]


def pack(command: str, folder: Path) -> ProgramBundle:
    """A command as it would be started in `folder`, with the files that it needs.

    The program is the first word that names a file, or a module after `-m`. Its whole folder (of a module,
    `folder`) is packed, without hidden files, leftovers, environments and results of trials. Of other words
    that name a file, only the file is packed. An absolute first word is an installed program, which other
    machines have themselves. Raises TrialsError if a file cannot be read or there is too much.
    """
    words = _split(command)
    if words and is_python(words[0]):
        words[0] = _PYTHON
    files: dict[str, PackedFile] = {}
    packed = 0
    for index, word in enumerate(words):
        option, equals, value = word.partition("=") if word.startswith("-") else ("", "", word)
        if index > 0 and words[index - 1] == "-m" and not packed and _module(folder, value).is_file():
            _add_below(files, folder, "")
            packed += 1
        elif value and (folder / value).is_file() and not (index == 0 and PurePath(value).is_absolute()):
            path = folder / value
            home, goal = _places(path, folder, packed)
            name = f"{goal}{path.relative_to(home).as_posix()}"
            if packed:
                _add(files, name, path)
            else:
                _add_below(files, home, goal)
            words[index] = f"{option}{equals}{name}"
            packed += 1
    return ProgramBundle(tuple(words), files)


def unpack(bundle: ProgramBundle, folder: Path) -> str:
    """Write the files to `folder`; returns the command to start there."""
    unpack_files(bundle.files, folder)
    words = list(bundle.words)
    if words and words[0] == _PYTHON:
        words[0] = sys.executable  # the Python that has this package
    elif words and words[0] in bundle.files:
        words[0] = str(folder / words[0])
    return platform_has.shell_line(words)


def unpack_files(files: Mapping[str, PackedFile], folder: Path) -> None:
    """Write packed files into a folder."""
    for name, file in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(file.data)
        path.chmod(0o755 if file.executable else 0o644)


def _split(command: str) -> list[str]:
    """Raises TrialsError."""
    try:
        words = shlex.split(command, posix=platform_has.POSIX)
    except ValueError as error:
        raise TrialsError(f"--run {command!r}: {error}") from None
    if problem := shell_problem(command):
        raise TrialsError(f"--run {command!r}: {problem}")
    return words if platform_has.POSIX else [word.strip('"') for word in words]


def _module(folder: Path, name: str) -> Path:
    """The file that `python -m name` starts in a folder."""
    path = folder.joinpath(*name.split("."))
    return path / "__main__.py" if path.is_dir() else path.with_suffix(".py")


def _places(path: Path, folder: Path, number: int) -> tuple[Path, str]:
    """The folder that is packed with a file, and the prefix of its files' names on the other machine."""
    home, root = path.resolve().parent, folder.resolve()
    if not home.is_relative_to(root):
        return path.parent, f"{_ELSEWHERE}/{number}/"
    inside = home.relative_to(root).as_posix()
    return path.parent, "" if inside == "." else f"{inside}/"


def _below(folder: Path) -> Iterator[Path]:
    for place, folders, names in os.walk(folder):
        folders[:] = [
            name
            for name in sorted(folders)
            if not name.startswith(".")
            and not is_leftover_folder(name)
            and not is_environment(Path(place, name))
            and not Path(place, name, _OWN_RESULTS).exists()
        ]
        kept = (name for name in sorted(names) if not (name.startswith(".") or is_leftover(name)))
        yield from (Path(place, name) for name in kept)


def _add_below(files: dict[str, PackedFile], home: Path, goal: str) -> None:
    """Add all files of a folder that are packed. Raises TrialsError."""
    for path in _below(home):
        _add(files, f"{goal}{path.relative_to(home).as_posix()}", path)


def _add(files: dict[str, PackedFile], name: str, path: Path) -> None:
    """Raises TrialsError."""
    shown = str(path)
    try:
        if not path.is_file():  # a socket, a pipe, a broken link
            return
        left = MOST_PROGRAM_BYTES - sum(len(file.data) for file in files.values())
        if path.stat().st_size > left or len(files) >= MOST_PROGRAM_FILES:
            raise TrialsError(
                f"--run: {shown} is one file too many: at most {MOST_PROGRAM_FILES} files, together "
                f"{MOST_PROGRAM_BYTES / 1e6:g} MB go to the cluster's workers; "
                "put the program in a folder of its own"
            )
        files[name] = PackedFile(path.read_bytes(), os.access(path, os.X_OK))
    except OSError as error:
        raise TrialsError(f"--run: {shown} cannot be read: {reason_of(error)}") from None


# A scheduler on the same network answers within milliseconds; Dask's own 30 s look like a hang.
CONNECT_TIMEOUT = "10s"
_LOST = "the connection to the Dask scheduler was lost"
Files = dict[str, bytes]
"""The contents of files, by path."""
AnyTrial = TypeVar("AnyTrial", bound=Trial)
AnyFiles = TypeVar("AnyFiles")


def check_package() -> None:
    """Raises TrialsError if the package of Dask is not installed."""
    try:
        importlib.import_module("distributed")
    except ImportError:
        needed = f"--dask needs the package distributed: pip install '{requirement('dask')}'"
        raise TrialsError(needed) from None


def connect(address: str) -> Client:
    """A client of the cluster's scheduler, such as `tcp://10.0.0.7:8786`. Raises ClusterError,
    TrialsError."""
    check_package()
    from distributed import Client

    try:
        return Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except ValueError as error:
        raise TrialsError(f"--dask {address}: {error}") from None
    except OSError as error:
        raise ClusterError(f"--dask {address}: no Dask scheduler answers there: {error}") from None


def run_on_cluster(
    trials: Iterable[Trial], program: ProgramBundle, folder: Path, client: Client
) -> Generator[TrialResult, None, None]:
    """The results of all trials, each as soon as it is there. Logs come back and are written to `folder`.

    The program's files are sent to each worker once. Raises what `results_of` does.
    """
    # Not pure: results of other trials with the same inputs must not be reused.
    # The program is a task's result rather than scattered: it is made again when its worker is lost.
    packed = client.submit(itself, program, pure=False)

    def submit(trial: Trial) -> Future:
        return client.submit(run_there, trial, packed, pure=False, priority=-trial.number)

    yield from results_of(trials, submit, folder, client)


def results_of(
    trials: Iterable[AnyTrial], submit: Callable[[AnyTrial], Future], folder: Path, client: Client
) -> Generator[TrialResult, None, None]:
    """The results of runs that `submit` sends to the cluster, each as soon as it is there; the files that it
    leaves are written to `folder`. Twice as many are sent at a time as the workers have threads. A trial is
    taken from the iterator when it is sent, so the next ones may depend on the results.

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
            if future.cancelled():  # only a lost scheduler does it
                raise ClusterError(_LOST)
            error = future.exception()
            if isinstance(error, SimmerError):
                raise TrialsError(str(error))
            if error is not None:  # a fault, or a worker that was lost several times
                yield fault_result(trial, f"{type(error).__name__}: {error}")
            else:
                result, files = _fetched(future)
                for name, data in files.items():
                    write_whole(folder / name, data)
                future.release()
                yield result
            for following in islice(waiting, 1):
                future = submit(following)
                futures[future] = following
                completed.add(future)
    finally:
        if client.status == "running":
            client.cancel(list(futures))


def _fetched(future: Future) -> tuple[TrialResult, Files]:
    """Result and files of a run, from the worker that did it. Raises ClusterError."""
    try:
        made: tuple[TrialResult, Files] = future.result()
    except (OSError, TimeoutError, CancelledError) as error:
        raise ClusterError(f"{_LOST}: {error}") from None
    return made


def itself(files: AnyFiles) -> AnyFiles:
    """The task whose result is sent to a worker."""
    return files


def run_there(trial: Trial, program: ProgramBundle) -> tuple[TrialResult, Files]:
    """A run, and the files it leaves; on the cluster. Raises TrialsError if it cannot be done."""
    return run_in_folders(
        lambda runs, files: TrialRun(replace(trial, command=unpack(program, files)), runs, files)
    )


def run_in_folders(make: Callable[[Path, Path], TrialRun]) -> tuple[TrialResult, Files]:
    """A run in folders of its own, for its logs and for a program's files, and the files it leaves.

    Raises TrialsError for any error of ours: some others cannot be sent back.
    """
    with tempfile.TemporaryDirectory(prefix="simmer-tui-", ignore_cleanup_errors=True) as name:
        runs, files = Path(name, "runs"), Path(name, "program")
        runs.mkdir(mode=0o700)
        files.mkdir()
        try:
            result = make(runs, files).run()
        except SimmerError as error:
            raise TrialsError(str(error)) from None
        left = (path for path in runs.rglob("*") if path.is_file())
        return result, {path.relative_to(runs).as_posix(): path.read_bytes() for path in left}


def check_workers(client: Client) -> None:
    """Raises ClusterError if there is no worker for a run."""
    information: dict[str, Any] = client.scheduler_info(n_workers=-1)
    if not information["workers"]:
        raise ClusterError("--dask: the cluster has no workers")
