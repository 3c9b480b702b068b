"""A program beside the simulator: its output line by line, its exit code, its end."""

from __future__ import annotations

import contextlib
import io
import os
import queue
import select
import shlex
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import pytest

from simmer_tui.cli.command_line import say
from simmer_tui.errors import ProgramError
from simmer_tui.links.processes import StatField, stat_of
from simmer_tui.program import Keeper, Program, ProgramOutput, keeper
from simmer_tui.program.program_command import console_variables, is_python, words_of
from simmer_tui.program.program_output import OutputRoute, OutputTail, _Stream
from tests import in_process

SECONDS = 120.0
posix = pytest.mark.skipif(sys.platform == "win32", reason="signals and quoting are those of POSIX")


class Heard:
    """Events of a program."""

    def __init__(self) -> None:
        self.lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.codes: queue.SimpleQueue[int] = queue.SimpleQueue()

    def run(self, code: str, **environment: str) -> Program:
        arguments = [sys.executable, "-u", "-c", code]
        command = shlex.join(arguments) if sys.platform != "win32" else f'"{sys.executable}" -u -c "{code}"'
        return Program(command, environment, self.codes.put, self.lines.put)

    def code(self) -> int:
        return self.codes.get(timeout=SECONDS)

    def line(self) -> str:
        return self.lines.get(timeout=SECONDS)


def test_lines_of_both_outputs_come_before_the_exit_code() -> None:
    heard = Heard()
    program = heard.run("import sys; print('one'); print('two', file=sys.stderr); sys.exit(3)")
    assert heard.code() == 3
    assert [heard.line(), heard.line()] == ["one", "two"]
    program.end()


def test_the_environment_is_added_and_there_is_no_input() -> None:
    heard = Heard()
    code = "import os, sys; print(os.environ['SIMMER_PORT'], repr(sys.stdin.read()))"
    program = heard.run(code, SIMMER_PORT="7")
    assert heard.line() == "7 ''"
    assert heard.code() == 0
    program.end()


def test_bytes_that_are_no_text_and_lines_without_an_end_are_taken() -> None:
    heard = Heard()
    program = heard.run("import sys; sys.stdout.buffer.write(bytes([255, 10]) + b'x' * 200000)")
    assert heard.line() == "\ufffd"
    pieces = ""
    while len(pieces) < 200_000:
        pieces += heard.line()
    assert set(pieces) == {"x"}
    assert heard.code() == 0
    program.end()


@posix
def test_a_child_that_keeps_the_output_open_does_not_hold_the_exit_code_back() -> None:
    heard = Heard()
    code = "import subprocess, sys; subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(5)'], "
    code += "start_new_session=True); sys.exit(4)"
    program = heard.run(code)
    assert heard.code() == 4
    program.end()


@posix
def test_a_program_that_is_still_running_is_ended() -> None:
    heard = Heard()
    program = heard.run("print('up', flush=True); import time; time.sleep(600)")
    assert heard.line() == "up"
    program.end()
    assert heard.code() == 128 + 15
    program.end()


@pytest.mark.parametrize(
    ("command", "mistake"),
    [
        ("/no/such/program", "--run '/no/such/program': there is no file /no/such/program"),
        ("python nosuch.py", "--run 'python nosuch.py': there is no file nosuch.py in "),
        pytest.param("python tests\\conftest.py", "did you mean tests/conftest.py?", marks=posix),
        pytest.param("pyhton my.py", "there is no program pyhton; did you mean", marks=posix),
        pytest.param("'unbalanced", "No closing quotation", marks=posix),
        pytest.param("  ", "--run needs a program", marks=posix),
    ],
)
def test_a_program_that_cannot_start_says_why(command: str, mistake: str) -> None:
    heard = Heard()
    with pytest.raises(ProgramError) as caught:
        Program(command, {}, heard.codes.put)
    assert mistake in str(caught.value)


# -- the end of all it started ---------------------------------------------------------------------

TREE = """
import os, signal, subprocess, sys, time
hold = open({fifo!r}, "w")
def start(code, **how):
    subprocess.Popen([sys.executable, "-c", f"hold = open({fifo!r}, 'w'); " + code], **how)
stubborn = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); "
wait = "print('up', file=hold, flush=True); time.sleep(600)"
start("import time; " + wait)
start(stubborn + wait, start_new_session=True)
start("import os, sys, time; os.fork() and sys.exit(); " + wait, start_new_session=True)
print("up", file=hold, flush=True)
"""
"""Starts a child, one in a session of its own that ignores SIGTERM, and one whose parent has gone;
each holds a named pipe open as long as it lives."""


class Lifeline:
    """A named pipe: its end shows that the last process that holds it has gone."""

    def __init__(self, path: Path) -> None:
        os.mkfifo(path)
        self.path = str(path)
        self._reading = os.open(path, os.O_RDONLY | os.O_NONBLOCK)

    def wait_for(self, lines: int) -> None:
        data = b""
        while data.count(b"\n") < lines:
            assert select.select([self._reading], [], [], SECONDS)[0], f"not all have come: {data!r}"
            with contextlib.suppress(BlockingIOError):
                data += os.read(self._reading, 100)

    def wait_for_the_end(self) -> None:
        ended = select.poll()
        ended.register(self._reading, 0)  # its end is always told
        assert ended.poll(SECONDS * 1000), "something lives on"

    def close(self) -> None:
        os.close(self._reading)


@pytest.fixture
def lifeline(tmp_path: Path) -> Iterator[Lifeline]:
    with contextlib.closing(Lifeline(tmp_path / "alive")) as line:
        yield line


def tree(lifeline: Lifeline, last: str) -> str:
    return TREE.format(fifo=lifeline.path) + last


linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux gives orphans to a keeper")


def start_simulator(program: Path) -> subprocess.Popen[bytes]:
    """A simulator that runs a program of Python."""
    command = shlex.join([sys.executable, str(program)])
    return subprocess.Popen(
        [sys.executable, "-m", "simmer_tui", "--no-ui", "--port", "0", "--quiet", "--run", command],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def pid_of_keeper() -> int:
    """The keeper that this process has."""
    children = Path(f"/proc/self/task/{threading.main_thread().native_id}/children").read_text().split()
    script = Path(keeper.__file__).name.encode()
    (pid,) = [int(pid) for pid in children if script in Path("/proc", pid, "cmdline").read_bytes()]
    return pid


@linux
def test_all_that_a_program_started_ends_with_it(lifeline: Lifeline) -> None:
    heard = Heard()
    program = heard.run(tree(lifeline, "time.sleep(600)"))
    lifeline.wait_for(4)
    program.end()
    lifeline.wait_for_the_end()
    assert heard.code() == 128 + signal.SIGTERM
    program.end()


@pytest.mark.slow
@linux
def test_what_a_program_left_running_ends_when_the_run_does(lifeline: Lifeline) -> None:
    heard = Heard()
    program = heard.run(tree(lifeline, "hold.close(); sys.exit(3)"))
    lifeline.wait_for(4)
    assert heard.code() == 3
    program.end()
    lifeline.wait_for_the_end()


@pytest.mark.slow
@linux
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP, signal.SIGTERM])
def test_all_ends_without_its_keeper_too(lifeline: Lifeline, number: int) -> None:
    heard = Heard()
    program = heard.run(tree(lifeline, "print(os.getppid()); time.sleep(600)"))
    lifeline.wait_for(4)
    assert int(heard.line()) == os.getpid(), "the simulator is the program's parent, as it always was"
    os.kill(pid_of_keeper(), number)
    program.end()
    lifeline.wait_for_the_end()
    assert heard.code() == 128 + signal.SIGTERM


@pytest.mark.slow
@linux
@pytest.mark.parametrize(
    ("first", "starter"),
    [
        ("os.setsid()", "Popen"),
        ("os.fork() and sys.exit()", "run"),
        ("os.setsid(); os.fork() and sys.exit()", "run"),
        ("os.fork() and sys.exit(); os.setsid(); os.fork() and sys.exit()", "run"),
    ],
    ids=["child", "orphan", "orphan in a session of its own", "daemon"],
)
def test_processes_without_its_environment_end_too(
    lifeline: Lifeline, tmp_path: Path, first: str, starter: str
) -> None:
    code = (
        f"import os, sys, time; {first}; hold = open({lifeline.path!r}, 'w'); "
        "print('up', file=hold, flush=True); time.sleep(600)"
    )
    bare = [sys.executable, "-c", code]
    program = tmp_path / "program.py"
    program.write_text(f"import subprocess, time; subprocess.{starter}({bare!r}, env={{}}); time.sleep(600)")
    # A simulator of its own: only a process that runs one program and nothing else adopts what it leaves.
    simulator = start_simulator(program)
    lifeline.wait_for(1)
    simulator.terminate()
    assert simulator.wait(SECONDS) == 128 + signal.SIGTERM
    lifeline.wait_for_the_end()


@linux
@pytest.mark.slow
def test_processes_that_a_program_leaves_behind_are_reaped_while_it_runs(tmp_path: Path) -> None:
    """Each was a zombie until the program's end, so that a long run filled the table of processes."""
    program = tmp_path / "program.py"
    program.write_text(
        "import os, subprocess, time\n"
        "number = subprocess.check_output(['sh', '-c', 'sh -c \"exit 0\" >&2 & echo $!'])\n"
        f"end = time.monotonic() + {SECONDS}\n"
        "while os.path.exists(f'/proc/{int(number)}') and time.monotonic() < end: time.sleep(0.05)\n"
        "print('gone' if time.monotonic() < end else 'a zombie')\n"
    )
    done = in_process.simmer("--no-ui", "--port", "0", "--run", f"{sys.executable} -S {program}")
    assert "gone" in done.stdout.splitlines()


@linux
def test_a_busy_machine_is_no_reason_to_end_nothing_kindly(
    lifeline: Lifeline, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(keeper, "TERMINATE_TIMEOUT", 0.0)
    sent: dict[int, list[int]] = {}
    kill = os.kill

    def recorded(pid: int, number: int) -> None:
        sent.setdefault(pid, []).append(number)
        kill(pid, number)

    monkeypatch.setattr(os, "kill", recorded)
    heard = Heard()
    program = heard.run(tree(lifeline, "time.sleep(600)"))
    lifeline.wait_for(4)
    program.end()
    lifeline.wait_for_the_end()
    # The machine decides if that was enough to end it before it was killed.
    assert heard.code() in (128 + signal.SIGTERM, 128 + signal.SIGKILL)
    assert sum(numbers[0] == signal.SIGTERM for numbers in sent.values()) >= 4


@linux
def test_a_program_that_never_begins_to_end_is_killed(lifeline: Lifeline) -> None:
    heard = Heard()
    code = "signal.signal(signal.SIGTERM, signal.SIG_IGN); os.kill(os.getpid(), signal.SIGSTOP)"
    program = heard.run(tree(lifeline, code))
    lifeline.wait_for(4)
    program.end()
    assert heard.code() == 128 + signal.SIGKILL
    lifeline.wait_for_the_end()


@pytest.mark.quick_cases(1)
@linux
@pytest.mark.parametrize("killed", ["by somebody", "by its own program"])
def test_all_ends_when_the_simulator_is_killed(lifeline: Lifeline, tmp_path: Path, killed: str) -> None:
    last = "os.kill(os.getppid(), signal.SIGKILL); " if "own" in killed else ""
    code = tmp_path / "program.py"
    code.write_text(tree(lifeline, last + "time.sleep(600)"))
    simulator = start_simulator(code)
    if "own" not in killed:
        lifeline.wait_for(4)
        simulator.kill()
    assert simulator.wait(SECONDS) == -signal.SIGKILL
    lifeline.wait_for_the_end()


@pytest.mark.slow
@linux
def test_what_was_adopted_ends_when_the_simulator_is_killed() -> None:
    """The keeper knows neither its environment nor its session nor its parent."""
    code = "import sys; print(flush=True); sys.stdin.read()"
    words = [sys.executable, "-S", "-c", code]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with contextlib.ExitStack() as stack:
        daemon, other = (
            stack.enter_context(subprocess.Popen(words, env={}, start_new_session=True, **pipes))
            for _ in range(2)
        )
        started = int(stat_of(daemon.pid)[StatField.STARTED])
        simulator = (
            "import os; from simmer_tui.program.kept_process import Keeper\n"
            "kept = Keeper(); kept.watch('a')\n"
            f"kept.adopt('a', {daemon.pid}, {started}); kept.adopt('a', {other.pid}, 1); os._exit(0)"
        )
        subprocess.run([sys.executable, "-c", simulator], check=True, timeout=SECONDS)
        assert daemon.wait(SECONDS) == -signal.SIGTERM
        assert other.poll() is None, "its number is another process's by now"
        other.communicate(timeout=SECONDS)


@pytest.mark.slow
@linux
def test_all_ends_when_trials_are_killed(lifeline: Lifeline, tmp_path: Path) -> None:
    code = tmp_path / "program.py"
    code.write_text(tree(lifeline, "time.sleep(600)"))
    trials = subprocess.Popen(
        [
            *(sys.executable, "-m", "simmer_tui", "trials", "--runs", "1", "--out", str(tmp_path / "out")),
            *("--run", shlex.join([sys.executable, str(code)])),
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    lifeline.wait_for(4)
    trials.kill()
    trials.wait(SECONDS)
    lifeline.wait_for_the_end()


@posix
def test_signals_are_to_a_program_what_they_are_to_others() -> None:
    """Python ignores SIGPIPE; a program that did too would write on into a closed pipe for ever."""
    heard = Heard()
    code = "import signal; print(signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM))"
    first = heard.run(code)
    assert heard.line().startswith("<built-in function default_int_handler> ")
    first.end()
    heard = Heard()
    command = shlex.join(["/bin/sh", "-c", "kill -PIPE $$; read nothing"])
    program = Program(command, {}, heard.codes.put, heard.lines.put)
    assert heard.code() == 128 + signal.SIGPIPE
    program.end()


@linux
def test_programs_share_a_keeper_and_one_that_was_killed_is_replaced() -> None:
    shared = Keeper()
    command = shlex.join([sys.executable, "-c", "import os; print(os.getpid())"])
    with contextlib.closing(shared):
        keepers = []
        for _ in range(3):
            heard = Heard()
            program = Program(command, {}, heard.codes.put, heard.lines.put, keeper=shared)
            assert heard.code() == 0
            keepers.append(pid_of_keeper())
            program.end()
        assert len(set(keepers)) == 1
        os.kill(keepers[0], signal.SIGKILL)
        os.waitid(os.P_PID, keepers[0], os.WEXITED | os.WNOWAIT)
        heard = Heard()
        Program(command, {}, heard.codes.put, heard.lines.put, keeper=shared).end()
        assert pid_of_keeper() != keepers[0]


def test_the_limits_of_a_job_have_the_size_that_windows_has() -> None:
    import ctypes

    from simmer_tui.program.job_process import BasicLimits, ExtendedLimits

    if ctypes.sizeof(ctypes.c_void_p) == 8:
        assert (ctypes.sizeof(BasicLimits), ctypes.sizeof(ExtendedLimits)) == (64, 144)


# -- Windows, as far as it can be told from here ---------------------------------------------------


@contextlib.contextmanager
def console() -> Iterator[int]:
    """A terminal in place of our output, by its other end."""
    ours, theirs = os.openpty()
    saved = [os.dup(each) for each in (1, 2)]
    try:
        for each in (1, 2):
            os.dup2(theirs, each)
        yield ours
    finally:
        for each, before in zip((1, 2), saved, strict=True):
            os.dup2(before, each)
        for each in (*saved, ours, theirs):
            os.close(each)


@posix
def test_a_line_and_its_end_are_passed_on_in_one_write() -> None:
    """Python without buffering writes them apart, and our own lines come between."""
    ours, theirs = socket.socketpair(type=socket.SOCK_DGRAM)  # one message a write
    source, program = os.pipe()

    class Ending(OutputTail):
        def add(self, data: bytes) -> None:
            super().add(data)
            if data == b"one":
                os.write(program, b"\n")
            elif data == b"a prompt: ":
                os.write(program, b"")

    stream = _Stream(source, Ending(lambda: 0.0), theirs.fileno(), None)
    with ours, theirs:
        for written, read in ((b"one", b"one\n"), (b"a prompt: ", b"a prompt: "), (b"x\ny\n", b"x\ny\n")):
            os.write(program, written)
            assert stream.pump()
            assert ours.recv(100) == read
        os.write(program, b"last")
        os.close(program)
        assert not stream.pump()
        assert ours.recv(100) == b"last"
    stream.close()


def test_our_own_line_and_its_end_are_one_write() -> None:
    class Written(io.StringIO):
        writes: ClassVar[list[str]] = []

        def write(self, text: str) -> int:
            self.writes.append(text)
            return len(text)

    say("a line", Written())
    assert Written.writes == ["a line\n"]


@posix
@pytest.mark.parametrize("at_once", [True, False])
def test_last_lines_are_kept_though_output_goes_to_a_console_of_windows(at_once: bool) -> None:
    output = ProgramOutput(lambda: 2.0)
    code = "import sys; print('one', flush=True); print('two', file=sys.stderr); sys.exit(3)"
    shown = b""
    with console() as screen:
        route = OutputRoute(output, None, windows=True, at_once=at_once)
        process = subprocess.Popen([sys.executable, "-c", code], stdout=route.stdout, stderr=route.stderr)
        reader = route.start()
        code_of_it = process.wait(SECONDS)
        reader.join(SECONDS)
        while (b"one" not in shown or b"two" not in shown) and select.select([screen], [], [], SECONDS)[0]:
            shown += os.read(screen, 1000)
    assert code_of_it == 3
    assert b"one" in shown
    assert b"two" in shown
    ended = output.end(3)
    assert [line.text for line in ended.stderr] == ["two"]
    # What would be held back in a pipe goes to the console itself.
    assert [line.text for line in ended.stdout] == (["one"] if at_once else [])


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("python robot.py", True),
        ('"C:\\Program Files\\Python\\Python.exe" robot.py', True),
        ("py -3 robot.py", True),
        ("python3.12 robot.py", True),
        ("C:\\Tools\\python3.12.exe robot.py", True),
        ("octave robot.m", False),
        ("C:\\pythonista.exe", False),
        ("", False),
    ],
)
def test_python_is_told_not_to_hold_lines_back_in_a_console_of_windows(command: str, expected: bool) -> None:
    found = console_variables(command, 850)
    assert found == (
        {"PYTHONUNBUFFERED": "1", "PYTHONIOENCODING": "cp850:backslashreplace"} if expected else {}
    )


@pytest.mark.parametrize(
    ("word", "expected"),
    [
        ("python", True),
        ("python3", True),
        ("/opt/env/bin/python3.12", True),
        ("C:/Python/PYTHON.EXE", True),
        ("py", True),
        ("pypy", False),
        ("python-config", False),
        ("./robot", False),
    ],
)
def test_a_command_of_python_is_known_by_its_name(word: str, expected: bool) -> None:
    assert is_python(word) is expected


def test_only_a_python_of_any_version_and_place_falls_back_to_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    assert words_of("python3 robot.py") == [sys.executable, "robot.py"]
    for command in ("python3.99 robot.py", "/nowhere/python robot.py", "octave robot.m"):
        assert words_of(command) == command.split()


@posix
def test_output_that_comes_before_the_start_has_returned_has_the_time_of_the_clock() -> None:
    output, lines, settled = ProgramOutput(lambda: 7.0), queue.Queue[str](), queue.Queue[bool]()
    route = OutputRoute(output, lines.put)
    assert route.stdout is not None
    os.write(route.stdout, b"early\n")
    thread = threading.Thread(target=lambda: settled.put(output.settle()))
    thread.start()
    reader = route.start()
    assert settled.get(timeout=60)
    assert [(each.time, each.text) for each in output.end(0).stdout] == [(7.0, "early")]
    thread.join()
    reader.join(60)
