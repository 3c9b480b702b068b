"""Runs of workers, in this process: a cluster that is a list of futures, and workers that are threads."""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import os
import shlex
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from simmer_tui import platform_has
from simmer_tui.cli.main import main
from simmer_tui.config.loader import find_set, load
from simmer_tui.errors import ClusterError, InterruptedTrialError, RunLogError, TrialsError
from simmer_tui.trials import cluster, local
from simmer_tui.trials.cluster import (
    PackedFile,
    ProgramBundle,
    check_workers,
    connect,
    pack,
    results_of,
    run_on_cluster,
    run_there,
    unpack,
)
from simmer_tui.trials.local import run_locally, work
from simmer_tui.trials.run import TrialRun, fault_result
from simmer_tui.trials.trial import Trial, TrialResult

posix = pytest.mark.skipif(sys.platform == "win32", reason="files have no modes there")


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    configuration = load(find_set("default"))
    return [
        Trial(
            number=number, seed=number, configuration=configuration, maze="", command="x", fixed_ports=False,
            time_limit=7.0,
        )
        for number in range(1, 10)
    ]  # fmt: skip


def result_of(trial: Trial) -> TrialResult:
    return fault_result(trial, f"result of {trial.number}")


# -- a program's files -------------------------------------------------------------------------------


@posix
def test_all_that_fits_goes_to_a_cluster(tmp_path: Path) -> None:
    """8 MB and 2000 files at most."""
    (tmp_path / "a.py").write_bytes(bytes(3_000_000))
    (tmp_path / "z").write_bytes(bytes(5_000_000))
    assert sum(len(each.data) for each in pack("python a.py", tmp_path).files.values()) == 8_000_000
    (tmp_path / "z").write_bytes(bytes(5_000_001))
    said = f"--run: {tmp_path / 'z'} is one file too many: at most 2000 files, together 8 MB go to"
    with pytest.raises(TrialsError) as caught:
        pack("python a.py", tmp_path)
    assert str(caught.value).startswith(said)


@posix
def test_at_most_so_many_files_go_to_a_cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "MOST_PROGRAM_FILES", 20)
    for number in range(20):
        (tmp_path / f"f{number:04}").touch()
    assert len(pack("python f0000", tmp_path).files) == 20
    (tmp_path / "g").touch()
    with pytest.raises(TrialsError, match="g is one file too many"):
        pack("python f0000", tmp_path)


@posix
def test_a_bundle_has_modes_folders_and_the_python_of_its_place(tmp_path: Path) -> None:
    (tmp_path / "in" / "node_modules").mkdir(parents=True)
    (tmp_path / "in" / "node_modules" / "x").touch()
    for place, folders in (("in", ("__pycache__", "site-packages", ".git", "env", "done")),):
        for folder in folders:
            (tmp_path / place / folder).mkdir()
            (tmp_path / place / folder / "x").touch()
    (tmp_path / "in" / "env" / "pyvenv.cfg").touch()
    (tmp_path / "in" / "done" / "trials.json").touch()
    (tmp_path / "in" / ".hidden").touch()
    (tmp_path / "in" / "broken").symlink_to("nowhere")
    (tmp_path / "in" / "tool").write_text("#!")
    (tmp_path / "in" / "tool").chmod(0o755)
    bundle = pack("in/tool --map=in/tool -m tool", tmp_path)
    assert bundle == ProgramBundle(
        ("in/tool", "--map=in/tool", "-m", "tool"), {"in/tool": PackedFile(b"#!", True)}
    )
    there = tmp_path / "there"
    assert shlex.split(unpack(bundle, there)) == [str(there / "in" / "tool"), *bundle.words[1:]]
    assert (there / "in" / "tool").stat().st_mode & 0o777 == 0o755
    assert shlex.split(unpack(ProgramBundle(("python", "x"), {}), there)) == [sys.executable, "x"]
    assert unpack(ProgramBundle(("a b",), {"c": PackedFile(b"", False)}), there) == "'a b'"
    assert (there / "c").stat().st_mode & 0o777 == 0o644
    assert unpack(ProgramBundle((), {}), there) == ""


@posix
def test_quotes_within_a_word_are_the_programs(tmp_path: Path) -> None:
    assert pack("""python '"a b"' c""", tmp_path).words[1:] == ('"a b"', "c")


@posix
def test_modules_are_found_as_python_finds_them(tmp_path: Path) -> None:
    (tmp_path / "pack" / "sub").mkdir(parents=True)
    for name in ("pack/__main__.py", "pack/sub/one.py"):
        (tmp_path / name).touch()
    both = ["pack/__main__.py", "pack/sub/one.py"]
    for command, found in (
        ("python -m pack", both),
        ("python -m pack.sub.one", both),
        ("python -m pack.sub", []),
        ("python -m nothing -m pack", both),
        ("python pack/sub/one.py -m pack", ["pack/sub/one.py"]),
        (f"{tmp_path}/pack/sub/one.py", []),  # installed, as an absolute path says
        ("-m pack", both),
    ):
        assert sorted(pack(command, tmp_path).files) == found, command


# -- a cluster ---------------------------------------------------------------------------------------


def test_a_scheduler_is_connected_to_in_ten_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []
    fails: list[Exception] = []

    def client(address: str, **options: object) -> str:
        asked.append((address, options))
        if fails:
            raise fails.pop()
        return "a client"

    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace(Client=client))
    assert connect("tcp://a:1") == "a client"  # type: ignore[comparison-overlap]
    assert asked == [("tcp://a:1", {"timeout": "10s", "set_as_default": False})]
    fails.append(ValueError("odd"))
    with pytest.raises(TrialsError, match=r"^--dask x{500}: odd$"):
        connect("x" * 500)
    fails.append(OSError("late"))
    with pytest.raises(ClusterError, match=r"^--dask x{500}: no Dask scheduler answers there: late$"):
        connect("x" * 500)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(TrialsError, match=r"--dask needs the package distributed: pip install '.*dask.*'"):
        connect("x")


def test_without_the_package_no_folder_is_made(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A second try, after it was installed, would find a folder with trials already."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    out, course = tmp_path / "out", tmp_path / "course"
    (course / "red").mkdir(parents=True)
    for arguments in (["trials", "--run", "python x.py"], ["grade", str(course)]):
        assert main([*arguments, "--out", str(out), "--dask", "tcp://127.0.0.1:1"]) == 2
        assert not out.exists()


def test_a_program_that_cannot_be_sent_makes_no_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace())
    monkeypatch.setattr("simmer_tui.trials.cluster.MOST_PROGRAM_BYTES", 10)
    program, out = tmp_path / "x.py", tmp_path / "out"
    program.write_text("print('hello')")
    arguments = ["trials", "--run", f"python {program}", "--out", str(out), "--dask", "tcp://127.0.0.1:1"]
    assert main(arguments) == 2
    assert "is one file too many" in capsys.readouterr().err
    assert not out.exists()


class Future:
    """A run on the cluster, and what came of it."""

    def __init__(self, made: object) -> None:
        self.made = made
        self.released = 0

    def cancelled(self) -> bool:
        return self.made == "cancelled"

    def exception(self) -> Exception | None:
        is_error = isinstance(self.made, Exception) and not isinstance(self.made, OSError | CancelledError)
        return self.made if is_error else None  # type: ignore[return-value]

    def result(self) -> object:
        if isinstance(self.made, BaseException):
            raise self.made
        return self.made

    def release(self) -> None:
        self.released += 1


class Client:
    """A cluster with workers of so many threads."""

    loop = "a loop"

    def __init__(self, threads: Sequence[int] = (1, 1)) -> None:
        self.status = "running"
        self.cancelled: list[object] = []
        self.sent: list[tuple[object, ...]] = []
        self._threads = threads

    def nthreads(self) -> dict[str, int]:
        return {str(place): number for place, number in enumerate(self._threads)}

    def cancel(self, futures: list[object]) -> None:
        self.cancelled += futures

    def submit(self, *given: object, **options: object) -> object:
        self.sent.append((*given, options))
        trial = given[1]
        return Future((result_of(trial), {})) if isinstance(trial, Trial) else "a bundle"


class Completed:
    """Futures in the order in which they were added."""

    def __init__(self, futures: list[Future], loop: str) -> None:
        assert loop == "a loop"
        self._left = futures
        self.most = len(futures)

    def __iter__(self) -> Iterator[Future]:
        while self._left:
            yield self._left.pop(0)

    def add(self, future: Future) -> None:
        self._left.append(future)


@pytest.fixture
def distributed(monkeypatch: pytest.MonkeyPatch) -> list[Completed]:
    """The package with what is used of it; the futures that were waited for."""
    waited: list[Completed] = []

    def as_completed(futures: list[Future], loop: str) -> Completed:
        waited.append(Completed(futures, loop))
        return waited[-1]

    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace(as_completed=as_completed))
    return waited


@pytest.mark.parametrize(("threads", "at_once"), [((1, 2), 6), ((), 2)])
def test_twice_as_many_runs_are_sent_as_there_are_threads(
    distributed: list[Completed], trials: list[Trial], tmp_path: Path, threads: tuple[int, ...], at_once: int
) -> None:
    client = Client(threads)
    made: dict[int, Future] = {}
    taken: list[int] = []

    def waiting() -> Iterator[Trial]:
        for trial in trials:
            taken.append(trial.number)
            yield trial

    def submit(trial: Trial) -> Future:
        made[trial.number] = Future((result_of(trial), {f"{trial.number}.txt": b"left"}))
        return made[trial.number]

    results = results_of(waiting(), submit, tmp_path, client)  # type: ignore[arg-type]
    assert next(results) == result_of(trials[0])
    assert taken == list(range(1, at_once + 1))
    assert distributed[0].most == at_once
    assert [*results] == [result_of(trial) for trial in trials[1:]]
    assert taken == list(range(1, 10))
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"{number}.txt" for number in range(1, 10)]
    assert [each.released for each in made.values()] == [1] * 9
    assert client.cancelled == []


@pytest.mark.parametrize(
    ("made", "error", "said"),
    [
        ("cancelled", ClusterError, "the connection to the Dask scheduler was lost"),
        (OSError("gone"), ClusterError, "the connection to the Dask scheduler was lost: gone"),
        (TimeoutError("late"), ClusterError, "the connection to the Dask scheduler was lost: late"),
        (CancelledError("it"), ClusterError, "the connection to the Dask scheduler was lost: it"),
        (RunLogError("full"), TrialsError, "full"),
    ],
)
def test_what_ends_all_runs_cancels_those_that_were_sent(
    distributed: list[Completed],
    trials: list[Trial],
    tmp_path: Path,
    made: object,
    error: type[Exception],
    said: str,
) -> None:
    for status, left in (("running", 3), ("closed", 0)):
        client = Client()
        client.status = status
        results = results_of(trials, lambda trial: Future(made), tmp_path, client)  # type: ignore
        with pytest.raises(error, match=f"^{said}$"):
            next(results)
        assert len(client.cancelled) == left


def test_a_fault_on_a_worker_is_the_result_of_its_run(
    distributed: list[Completed], trials: list[Trial], tmp_path: Path
) -> None:
    def submit(trial: Trial) -> Future:
        return Future(KeyError("u1") if trial.number == 1 else (result_of(trial), {}))

    first, second = results_of(trials[:2], submit, tmp_path, Client())  # type: ignore[arg-type]
    assert (first.reason, second.reason) == ("KeyError: 'u1'", "result of 2")


def test_a_program_is_sent_once_and_runs_in_their_order(
    distributed: list[Completed], trials: list[Trial], tmp_path: Path
) -> None:
    bundle = ProgramBundle(("x",), {})
    client: Any = Client()
    assert len([*run_on_cluster(trials[:3], bundle, tmp_path, client)]) == 3
    assert client.sent == [
        (cluster.itself, bundle, {"pure": False}),
        *((run_there, each, "a bundle", {"pure": False, "priority": -each.number}) for each in trials[:3]),
    ]
    assert cluster.itself(bundle) is bundle


def test_a_run_on_a_worker_has_its_own_folders(trials: list[Trial], monkeypatch: pytest.MonkeyPatch) -> None:
    bundle = ProgramBundle(("python", "a.py"), {"a.py": PackedFile(b"x", False)})
    started: list[tuple[str, str]] = []

    def init(self: TrialRun, trial: Trial, folder: Path, start: Path) -> None:
        (folder / "in").mkdir()
        (folder / "in" / "log").write_text("left")
        started.append((trial.command, (start / "a.py").read_text()))

    monkeypatch.setattr(TrialRun, "__init__", init)
    monkeypatch.setattr(TrialRun, "run", lambda self: result_of(trials[0]))
    assert run_there(trials[0], bundle) == (result_of(trials[0]), {"in/log": b"left"})
    assert [text for _, text in started] == ["x"]
    assert "a.py" in started[0][0]

    def fail(self: TrialRun) -> TrialResult:
        raise RunLogError("full")

    monkeypatch.setattr(TrialRun, "run", fail)
    with pytest.raises(TrialsError, match=r"^full$"):
        run_there(trials[0], bundle)


def test_a_cluster_needs_workers() -> None:
    asked: list[int] = []

    def information(workers: dict[str, int]) -> Any:
        return SimpleNamespace(
            scheduler_info=lambda n_workers: asked.append(n_workers) or {"workers": workers}
        )

    check_workers(information({"a": 1}))
    with pytest.raises(ClusterError, match=r"^--dask: the cluster has no workers$"):
        check_workers(information({}))
    assert asked == [-1, -1]  # all of them


# -- workers of this machine -------------------------------------------------------------------------


class Run:
    """A run of a trial: what it does is told by the trial's command."""

    def __init__(self, trial: Trial, folder: Path, keeper: object) -> None:
        self._trial = trial
        self._interrupted = threading.Event()
        if trial.command == "cannot be made":
            raise OSError(28, "No space left on device", "a file")

    def interrupt(self) -> None:
        self._interrupted.set()

    def run(self) -> TrialResult:
        match self._trial.command:
            case "refused":
                raise RunLogError("full")
            case "cannot be written":
                raise OSError(28, "No space left on device")
            case "odd":
                raise KeyError("u1")
            case "dies":
                raise SystemExit(3)
            case "stays":
                self._interrupted.wait(20)
                raise InterruptedTrialError
        return result_of(self._trial)


class End(Connection):
    """A worker's end of its connection, which is closed only when nobody receives any more."""

    def __init__(self, descriptor: int) -> None:
        super().__init__(descriptor)
        self._unused = threading.Event()

    def recv(self) -> Any:
        try:
            return super().recv()
        except (EOFError, OSError):
            self._unused.set()
            raise

    def close(self) -> None:
        with socket.socket(fileno=os.dup(self.fileno())) as same, contextlib.suppress(OSError):
            same.shutdown(socket.SHUT_RDWR)
        self._unused.wait()
        super().close()


class Keeper:
    def close(self) -> None:
        pass


@pytest.fixture
def workers(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Workers are threads, which do not change this process; what happens to them."""
    if sys.platform == "win32":
        pytest.skip("connections are pipes there")
    noted: list[str] = []

    class Process:
        exitcode: int | None = None

        def __init__(self, target: Callable[..., None], args: Any, name: str, daemon: bool) -> None:
            assert (target, daemon) == (work, True)
            end, folder, make = args
            self._end = End(os.dup(end.fileno()))
            self._thread = threading.Thread(target=self._work, args=(folder, make), name=name)

        def _work(self, folder: Path, make: Any) -> None:
            with self._end:
                try:
                    work(self._end, folder, make)
                except SystemExit as error:
                    self.exitcode = error.code  # type: ignore[assignment]
                else:
                    self.exitcode = 0

        def start(self) -> None:
            noted.append("start")
            self._thread.start()

        def kill(self) -> None:
            noted.append("kill")

        def join(self, seconds: float | None = None) -> None:
            noted.append(f"join {seconds}")
            self._thread.join()

    monkeypatch.setattr(
        multiprocessing,
        "get_context",
        lambda kind: SimpleNamespace(Pipe=multiprocessing.Pipe, Process=Process),
    )
    monkeypatch.setattr(signal, "signal", lambda *given: None)
    monkeypatch.setattr(gc, "freeze", lambda: None)
    monkeypatch.setattr(platform_has, "leave_process_group", lambda: None)
    monkeypatch.setattr(local, "Keeper", Keeper)
    return noted


def commanded(trials: list[Trial], *commands: str) -> list[Trial]:
    from dataclasses import replace

    return [replace(trial, command=each) for trial, each in zip(trials, commands, strict=False)]


@pytest.mark.parametrize(("jobs", "started"), [(1, 1), (3, 3), (9, 5)])
def test_workers_do_one_run_after_the_other(
    workers: list[str], trials: list[Trial], tmp_path: Path, jobs: int, started: int
) -> None:
    results = list(run_locally(trials[:5], tmp_path, jobs, Run))  # type: ignore[arg-type]
    assert sorted(each.number for each in results) == [1, 2, 3, 4, 5]
    assert workers.count("start") == started
    assert "kill" not in workers
    assert list(run_locally([], tmp_path, jobs, Run)) == []  # type: ignore[arg-type]


def test_a_fault_of_one_run_leaves_the_others(
    workers: list[str], trials: list[Trial], tmp_path: Path
) -> None:
    runs = commanded(trials, "x", "odd", "dies", "x")
    results = list(run_locally(runs, tmp_path, 1, Run))  # type: ignore[arg-type]
    assert [(each.number, each.reason) for each in results] == [
        (1, "result of 1"),
        (2, "KeyError: 'u1'"),
        (3, "the simulator's process died with exit code 3"),
        (4, "result of 4"),
    ]
    assert workers == ["start", "kill", "join None", "start"]


@pytest.mark.parametrize(
    ("command", "said"),
    [("refused", "full"), ("cannot be made", "run 2: a file: No space left on device")],
)
def test_a_run_that_cannot_be_done_ends_all(
    workers: list[str], trials: list[Trial], tmp_path: Path, command: str, said: str
) -> None:
    results = run_locally(commanded(trials, "x", command, "x"), tmp_path, 1, Run)  # type: ignore[arg-type]
    assert next(results).number == 1
    with pytest.raises(TrialsError, match=f"^{said}$"):
        next(results)
    assert workers == ["start", "join 10.0"]


@pytest.mark.usefixtures("workers")
def test_a_run_that_cannot_be_written_names_its_folder(trials: list[Trial], tmp_path: Path) -> None:
    results = run_locally(commanded(trials, "cannot be written"), tmp_path, 1, Run)  # type: ignore[arg-type]
    with pytest.raises(TrialsError, match=rf"^run 1: {tmp_path}: No space left on device$"):
        next(results)


def test_runs_under_way_are_interrupted_when_nobody_wants_them(
    workers: list[str], trials: list[Trial], tmp_path: Path
) -> None:
    results = run_locally(commanded(trials, "x", "stays", "stays"), tmp_path, 2, Run)  # type: ignore[arg-type]
    assert next(results).number == 1
    results.close()
    assert workers == ["start", "start", "join 10.0", "join 10.0"]


def test_a_run_that_is_overdue_is_a_fault(
    workers: list[str], trials: list[Trial], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """30 s after its time limit of 7 s; at that moment it may still end."""
    now = iter([100.0, 100.5, 137.0, 137.25, 137.25, 138.0, 138.0, 138.0])
    waited: list[float] = []
    wait = local.wait

    def waiting(ends: list[Connection], seconds: float) -> list[Any]:
        waited.append(seconds)
        return wait(ends, 0.0 if len(waited) < 3 else 20.0)

    monkeypatch.setattr(local, "time", SimpleNamespace(monotonic=lambda: next(now)))
    monkeypatch.setattr(local, "wait", waiting)
    results = run_locally(commanded(trials, "stays", "x"), tmp_path, 1, Run)  # type: ignore[arg-type]
    first = next(results)
    assert (first.number, first.reason) == (1, "the simulator did not end, and was killed")
    assert waited == [36.5, 0.0]
    assert [each.number for each in results] == [2]
    assert workers[:3] == ["start", "kill", "join None"]
