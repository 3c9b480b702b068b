"""Programs as Windows runs them, in job objects, against a recorded fake of the calls."""

from __future__ import annotations

import ctypes
import os
import queue
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simmer_tui.errors import ProgramError
from simmer_tui.program.job_process import JobProcess, console_code_page
from simmer_tui.program.program_command import command_line_of
from simmer_tui.program.program_output import OutputRoute, ProgramOutput
from tests.fake_windows import FakeKernel32, FakePopen, split_line

SECONDS = 120.0
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the fake ends processes by POSIX")


def line_of(code: str) -> str:
    return subprocess.list2cmdline([sys.executable, "-c", code])


class Starter:
    """Starts Python code in a job, with some calls failing: the process, the calls, and the lines printed."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.kernel = FakeKernel32()
        monkeypatch.setattr(ctypes, "WinDLL", lambda name, **options: self.kernel, raising=False)
        monkeypatch.setattr("simmer_tui.program.job_process.subprocess.Popen", FakePopen)

    def __call__(
        self, code: str, *failing: str, command: str = ""
    ) -> tuple[JobProcess, FakeKernel32, queue.SimpleQueue[str]]:
        self.kernel = FakeKernel32(failing)
        lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        route = OutputRoute(ProgramOutput(), lines.put, windows=True)
        try:
            process = JobProcess(command or line_of(code), os.environ, Path.cwd(), route, has_input=False)
        except BaseException:
            route.abandon()
            raise
        route.start()
        return process, self.kernel, lines


@pytest.fixture
def start(monkeypatch: pytest.MonkeyPatch) -> Starter:
    return Starter(monkeypatch)


def names(kernel: FakeKernel32) -> list[object]:
    return [call[0] for call in kernel.calls]


def test_a_program_is_put_into_a_job_that_ends_with_its_handle(start: Starter) -> None:
    process, kernel, lines = start("print('begun', flush=True)")
    (job,) = kernel.open.values()
    assert kernel.calls == [
        ("CreateJobObjectW",),
        ("SetInformationJobObject", 0x104, 9, 144),
        ("AssignProcessToJobObject", 0x104, process.pid),
    ]
    assert (job.flags, job.processes) == (0x2000, [process.pid])
    assert lines.get(timeout=SECONDS) == "begun"
    assert process.wait() == 0
    process.end()
    assert names(kernel)[3:] == ["TerminateJobObject", "CloseHandle"]
    assert kernel.open == {}


def test_the_end_is_asked_for_by_any_thread_and_closes_the_handle_once(start: Starter) -> None:
    process, kernel, lines = start("import time; print('begun', flush=True); time.sleep(600)")
    assert lines.get(timeout=SECONDS) == "begun"
    process.end()
    process.end()
    assert process.wait() == 1, "the code that the ending call names"
    assert names(kernel).count("TerminateJobObject") == 1
    assert names(kernel).count("CloseHandle") == 1


def test_what_a_program_started_ends_with_it(start: Starter) -> None:
    child = "import sys, time; print('child', flush=True); time.sleep(600)"
    process, _, lines = start(f"import subprocess, sys; subprocess.run([sys.executable, '-c', {child!r}])")
    assert lines.get(timeout=SECONDS) == "child"
    process.end()
    assert process.wait() == 1


@pytest.mark.parametrize("failing", ["CreateJobObjectW", "AssignProcessToJobObject"])
def test_without_a_job_the_program_itself_is_ended(start: Starter, failing: str) -> None:
    process, kernel, lines = start("import time; print('begun', flush=True); time.sleep(600)", failing)
    assert lines.get(timeout=SECONDS) == "begun"
    process.end()
    assert process.wait() == 1
    assert "TerminateJobObject" not in names(kernel)
    assert kernel.open == {}, "no handle is left open"


def test_a_program_that_is_not_there_leaves_no_handle_open(start: Starter) -> None:
    with pytest.raises(FileNotFoundError):
        start("", command="no-such-program robot.py")
    assert names(start.kernel) == ["CreateJobObjectW", "SetInformationJobObject", "CloseHandle"]
    assert start.kernel.open == {}


def test_a_command_without_a_program_is_told_as_elsewhere(start: Starter) -> None:
    with pytest.raises(ProgramError, match="--run needs a program"):
        start("", command="  ")


def test_the_console_says_its_code_page(monkeypatch: pytest.MonkeyPatch) -> None:
    kernel = FakeKernel32()
    monkeypatch.setattr(ctypes, "WinDLL", lambda name, **options: kernel, raising=False)
    assert console_code_page() == 1252
    assert kernel.calls == [("GetConsoleOutputCP",)]


# -- command lines ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (r"python C:\robots\my robot.py", ["python", r"C:\robots\my", "robot.py"]),
        (
            r'"C:\Program Files\Python\python.exe" "C:\a b\r.py"',
            [r"C:\Program Files\Python\python.exe", r"C:\a b\r.py"],
        ),
        (r'python "a\\" \"b', ["python", "a\\", '"b']),
    ],
)
def test_the_fake_splits_lines_as_windows_does(line: str, words: list[str]) -> None:
    assert split_line(line) == words


@settings(max_examples=20)
@given(st.lists(st.text(st.sampled_from('ab \\"\t/:')), min_size=1))
def test_a_line_made_of_words_is_split_into_them(words: list[str]) -> None:
    assert split_line(subprocess.list2cmdline(words)) == words


def test_python_falls_back_to_ours_with_the_rest_of_the_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(shutil, "which", lambda word: None)
    ours = f'"{sys.executable}"'
    assert command_line_of(r'python "C:\a b\r.py" --to C:\x') == rf'{ours} "C:\a b\r.py" --to C:\x'
    assert command_line_of('"python" r.py') == f"{ours} r.py"
    for line in (r"C:\Python\python.exe r.py", "python3.12 r.py", "octave-cli r.m"):
        assert command_line_of(line) == line
    monkeypatch.setattr(shutil, "which", lambda word: "/usr/bin/python")
    assert command_line_of(" python r.py ") == "python r.py"
