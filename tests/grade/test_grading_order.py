"""The order of the runs of a grading and their places, and the reader of submissions, in this process."""

from __future__ import annotations

import contextlib
import dataclasses
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from msgspec import structs

from simmer_tui import platform_has
from simmer_tui.errors import GradeError, RunLogError, SimmerError, TrialsError
from simmer_tui.grade import bubblewrap, container, grading
from simmer_tui.grade.course import read_course
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.grade_run import GradeRun, GradeTrial
from simmer_tui.grade.grading import (
    Grading,
    check_isolation,
    grade,
    grade_there,
    missing_there,
    on_cluster,
    what_is_missing,
)
from simmer_tui.grade.sandbox import Isolation
from simmer_tui.grade.submission_reader import SubmissionReader, serve
from simmer_tui.trials.cluster import PackedFile
from simmer_tui.trials.run import fault_result
from simmer_tui.trials.trial import Ending, TrialResult

DECIDE = "[decide]\nrequire = 0.9\nmargin = 0.5\nrisk = 0.05\n"
"""Four successes pass, two failures fail."""


@pytest.fixture
def folder(make_course: Callable[..., Path], tmp_path: Path) -> GradeFolder:
    course = read_course(make_course({"a": "", "b": "", "c": ""}, DECIDE))
    return GradeFolder.create(tmp_path / "out", course, 3, Isolation.NONE)


def ended(trial: GradeTrial, *, success: bool) -> TrialResult:
    ending = Ending.SUCCESS if success else Ending.CONTACTS
    return structs.replace(fault_result(trial, ""), success=success, ending=ending)


def test_teams_take_turns_and_those_that_wait_least_come_first(folder: GradeFolder) -> None:
    course = Grading(folder)
    trials = course.trials()
    names: list[str] = []

    def following() -> GradeTrial:
        trial = next(trials)
        names.append(trial.name)
        return trial

    begun = [following() for _ in range(5)]
    assert names == ["a/0001", "b/0001", "c/0001", "a/0002", "b/0002"]
    course.take(ended(begun[0], success=False))
    course.take(ended(begun[3], success=False))  # a has failed
    course.take(ended(begun[2], success=True))
    assert [following().name for _ in range(3)] == ["c/0002", "c/0003", "b/0003"]
    course.take(ended(begun[1], success=True))
    assert following().name == "b/0004"  # b has one run and two under way, c has one and two: b comes first


def test_runs_are_done_until_every_team_is_decided(folder: GradeFolder) -> None:
    """A source may end early, as one does whose workers are lost; it is closed each time."""
    closed: list[int] = []
    told: list[str] = []

    def source(trials: Any) -> Iterator[TrialResult]:
        try:
            for number, trial in enumerate(trials):
                yield ended(trial, success=trial.slug != "b")
                if number == 2:
                    return
        finally:
            closed.append(1)

    grade(folder, source, lambda result: told.append(str(result.number)))  # type: ignore[arg-type]
    assert [len(entry.results) for entry in folder.entries] == [4, 2, 4]
    assert len(told) == 10
    assert len(closed) == 4


def test_a_fault_counts_three_times_for_each_run(folder: GradeFolder) -> None:
    course = Grading(folder)
    trials = course.trials()
    one, other = next(trials), next(trials)
    for trial in (one, other, one, other):
        course.take(fault_result(trial, "it broke"))
    assert not any(entry.results for entry in folder.entries)
    course.take(fault_result(one, "it broke"))
    assert [len(entry.results) for entry in folder.entries] == [1, 0, 0]


def test_programs_must_not_see_the_grading(folder: GradeFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    def check(isolation: Isolation) -> None:
        check_isolation(isolation, folder.path, folder.course)

    check(Isolation.NONE)
    monkeypatch.setattr(bubblewrap, "seen_folders", lambda extra: [folder.path.parent])
    check(Isolation.NONE)  # without a sandbox they see it anyway
    monkeypatch.setattr(bubblewrap, "what_is_missing", lambda: "")
    with pytest.raises(GradeError, match=r"the grading would lie in .* name another --out"):
        check(Isolation.BWRAP)
    monkeypatch.setattr(bubblewrap, "seen_folders", lambda extra: [folder.path / "teams"])
    check(Isolation.BWRAP)
    monkeypatch.setattr(bubblewrap, "what_is_missing", lambda: "a reason")
    with pytest.raises(GradeError, match=r"programs cannot be sandboxed: a reason. Without it, a program"):
        check(Isolation.BWRAP)
    monkeypatch.setattr(container, "what_is_missing", lambda engine, image: f"no {image} of {engine}")
    missing = [what_is_missing(each, "ours") for each in Isolation]
    assert missing == ["a reason", "no ours of docker", "no ours of podman", ""]


class Cluster:
    """A client of a cluster: what was sent, with its options."""

    def __init__(self, missing: dict[str, str]) -> None:
        self.missing = missing
        self.sent: list[tuple[object, ...]] = []

    def run(self, function: object, *given: object) -> dict[str, str]:
        assert (function, given) == (missing_there, (Isolation.NONE, "", ()))
        return self.missing

    def submit(self, function: object, *given: object, pure: bool) -> str:
        assert not pure
        self.sent.append((function, *given))
        return f"future {len(self.sent)}"


def test_files_of_a_team_go_to_a_cluster_once(folder: GradeFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    cluster: Any = Cluster({"one": "", "two": ""})
    program = folder.home(folder.entries[0].team) / "program"
    (program / "in").mkdir()
    (program / "in" / "tool").write_text("x")
    (program / "in" / "tool").chmod(0o744)

    def results_of(trials: Any, submit: Any, runs: Path, client: object) -> Iterator[TrialResult]:
        assert (runs, client) == (folder.runs, cluster)
        for trial in trials[:3]:
            submit(trial)
        yield from ()

    monkeypatch.setattr(grading, "results_of", results_of)
    trials = [folder.trial(folder.entries[team], number) for team, number in ((0, 1), (1, 1), (0, 2))]
    assert list(on_cluster(folder, cluster)(trials)) == []
    files = {"in/tool": PackedFile(b"x", True), "main.py": PackedFile(b"", False)}
    assert cluster.sent == [
        (grading.itself, files),
        (grade_there, trials[0], "future 1"),
        (grading.itself, {"main.py": PackedFile(b"", False)}),
        (grade_there, trials[1], "future 3"),
        (grade_there, trials[2], "future 1"),
    ]
    assert sorted(path.name for path in folder.runs.iterdir()) == ["a", "b"]
    bad: Any = Cluster({"one": "", "two": "no bwrap"})
    with pytest.raises(GradeError, match=r"^programs cannot be sandboxed on the worker two: no bwrap$"):
        on_cluster(folder, bad)


@pytest.mark.skipif(sys.platform == "win32", reason="folders have no modes there")
@pytest.mark.parametrize(
    ("isolation", "mode"), [(Isolation.NONE, 0o700), (Isolation.BWRAP, 0o755), (Isolation.PODMAN, 0o755)]
)
def test_a_run_on_a_worker_leaves_its_files(
    folder: GradeFolder, monkeypatch: pytest.MonkeyPatch, isolation: Isolation, mode: int
) -> None:
    trial = dataclasses.replace(folder.trial(folder.entries[0], 2), isolation=isolation)
    seen: dict[str, object] = {}

    def run(self: GradeRun) -> TrialResult:
        seen["files"] = sorted(path.name for path in self._trial.files.iterdir())
        runs = self._log.parents[1]
        seen["modes"] = [each.stat().st_mode & 0o777 for each in (runs.parent, runs)]
        (runs / "a" / "0002.txt").write_text("out")
        return ended(trial, success=False)

    monkeypatch.setattr(GradeRun, "run", run)
    result, left = grade_there(trial, {"main.py": PackedFile(b"x", False)})
    assert (result, left) == (ended(trial, success=False), {"a/0002.txt": b"out"})
    assert seen == {"files": ["main.py"], "modes": [mode, 0o700]}

    def fail(self: GradeRun) -> TrialResult:
        raise RunLogError("full")

    monkeypatch.setattr(GradeRun, "run", fail)
    with pytest.raises(TrialsError, match=r"^full$"):
        grade_there(trial, {})


def test_a_grading_that_is_read_is_not_written(folder: GradeFolder) -> None:
    """Another process, which grades there, may be writing a line."""
    folder.store.results.write_bytes(b'{"team":"a","attem')
    assert not GradeFolder.read(folder.path).entries[0].results
    assert folder.store.results.read_bytes() == b'{"team":"a","attem'


# -- the reader of submissions -----------------------------------------------------------------------


def plus(one: int, other: int = 1) -> int:
    return one + other


def fail(kind: type[Exception]) -> None:
    raise kind("why")


@pytest.fixture
def limits(monkeypatch: pytest.MonkeyPatch) -> list[tuple[object, ...]]:
    """Limits that the reader would set, and signals that it would ignore, in order."""
    resource = pytest.importorskip("resource", reason="Windows has no limits of processes")
    noted: list[tuple[object, ...]] = []
    monkeypatch.setattr(resource, "setrlimit", lambda *given: noted.append(given))
    monkeypatch.setattr(signal, "signal", lambda *given: noted.append(given))
    return noted


@pytest.fixture
def children(monkeypatch: pytest.MonkeyPatch, limits: list[tuple[object, ...]]) -> list[str]:
    """The reader's processes, which are threads here: what happens to them."""
    noted: list[str] = []

    class Child:
        def __init__(self, target: Callable[..., None], args: tuple[Any], name: str, daemon: bool) -> None:
            assert (target, daemon) == (serve, True)
            self._end = args[0]
            self._other = Connection(os.dup(args[0].fileno()))
            self._thread = threading.Thread(target=self._serve, name=name)

        def _serve(self) -> None:
            with self._other, contextlib.suppress(OSError, SystemExit):
                serve(self._other)

        def start(self) -> None:
            noted.append("start")
            self._thread.start()

        def kill(self) -> None:
            noted.append("kill")

        def join(self) -> None:
            noted.append("join")
            self._thread.join()

    def context(kind: str) -> SimpleNamespace:
        assert kind == "spawn"
        return SimpleNamespace(Pipe=multiprocessing.Pipe, Process=Child)

    monkeypatch.setattr(multiprocessing, "get_context", context)
    return noted


def test_a_reader_answers_calls_in_one_child(children: list[str]) -> None:
    reader = SubmissionReader()
    reader.close()
    assert children == []
    assert reader.call(plus, 2) == 3
    assert reader.call(plus, 2, other=5) == 7
    for kind, text in (
        (SimmerError, "why"),
        (ValueError, "cannot be read: ValueError"),
        (MemoryError, "cannot be read: MemoryError"),
        (RecursionError, "cannot be read: RecursionError"),
        (OSError, "cannot be read: OSError"),
    ):
        with pytest.raises(GradeError, match=rf"^{text}$"):
            reader.call(fail, kind)
    assert children == ["start"]
    reader.close()
    assert children == ["start", "kill", "join"]
    reader.close()
    assert children == ["start", "kill", "join"]


def test_a_child_that_is_too_slow_or_dead_is_replaced(
    children: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    reader = SubmissionReader()
    said = r"^take more than 5 s of processor time or 500 MB to read: make them smaller$"
    waited: list[float] = []
    with monkeypatch.context() as patch:
        patch.setattr(Connection, "poll", lambda self, seconds: waited.append(seconds))
        with pytest.raises(GradeError, match=said):
            reader.call(plus, 1)
    assert waited == [60.0]
    assert children == ["start", "kill", "join"]
    assert reader.call(plus, 1) == 2
    with pytest.raises(GradeError, match=said):
        reader.call(sys.exit)  # as a child that was killed
    assert reader.call(plus, 1) == 2
    reader.close()
    assert children == ["start", "kill", "join"] * 3


@pytest.mark.skipif(sys.platform != "linux", reason="the size of a process is not known elsewhere")
def test_the_child_is_limited_before_its_calls(
    limits: list[tuple[object, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """5 s from now on for each call; once, 500 MB more than it has, and no file of more than 64 MB."""
    resource = pytest.importorskip("resource")
    times = iter([3.9, 7.0])
    monkeypatch.setattr(time, "process_time", lambda: next(times))
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (1, 77))
    read = Path.read_bytes
    monkeypatch.setattr(
        Path, "read_bytes", lambda self: b"1000 9 9" if str(self) == "/proc/self/statm" else read(self)
    )
    ours, theirs = multiprocessing.Pipe()
    with ours, theirs:
        for number in (1, 2):
            ours.send((plus, (number,), {}))
        sending = threading.Thread(target=lambda: [ours.recv(), ours.recv(), ours.close()])
        sending.start()
        serve(theirs)
        sending.join()
    most = 1000 * os.sysconf("SC_PAGE_SIZE") + 500_000_000
    assert limits == [
        (signal.SIGINT, signal.SIG_IGN),
        (resource.RLIMIT_CORE, (0, 0)),
        (resource.RLIMIT_FSIZE, (64_000_000, 64_000_000)),
        (resource.RLIMIT_AS, (most, most)),
        (resource.RLIMIT_CPU, (3 + 1 + 5, 77)),
        (resource.RLIMIT_CPU, (7 + 1 + 5, 77)),
    ]


def test_a_system_without_limits_has_none(
    limits: list[tuple[object, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(platform_has, "POSIX", False)
    monkeypatch.setattr(platform_has, "LINUX", False)
    ours, theirs = multiprocessing.Pipe()
    with ours, theirs:
        ours.send((plus, (1,), {}))
        sending = threading.Thread(target=lambda: [ours.recv(), ours.close()])
        sending.start()
        serve(theirs)
        sending.join()
    assert limits == [(signal.SIGINT, signal.SIG_IGN)]
