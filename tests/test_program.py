"""A program beside the simulator: its output line by line, its exit code, its end."""

from __future__ import annotations

import queue
import shlex
import sys

import pytest

from simmer_tui.errors import ProgramError
from simmer_tui.program import Program

SECONDS = 30.0
posix = pytest.mark.skipif(sys.platform == "win32", reason="signals and quoting are those of POSIX")


class Heard:
    """What a program told."""

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
    heard.run("import sys; print('one'); print('two', file=sys.stderr); sys.exit(3)")
    assert heard.code() == 3
    assert [heard.line(), heard.line()] == ["one", "two"]


def test_the_environment_is_added_and_there_is_no_input() -> None:
    heard = Heard()
    heard.run("import os, sys; print(os.environ['SIMMER_PORT'], repr(sys.stdin.read()))", SIMMER_PORT="7")
    assert heard.line() == "7 ''"
    assert heard.code() == 0


def test_bytes_that_are_no_text_and_lines_without_an_end_are_taken() -> None:
    heard = Heard()
    heard.run("import sys; sys.stdout.buffer.write(bytes([255, 10]) + b'x' * 200000)")
    assert heard.line() == "\ufffd"
    pieces = ""
    while len(pieces) < 200_000:
        pieces += heard.line()
    assert set(pieces) == {"x"}
    assert heard.code() == 0


@posix
def test_a_child_that_keeps_the_output_open_does_not_hold_the_exit_code_back() -> None:
    heard = Heard()
    heard.run("import subprocess, sys; subprocess.Popen(['sleep', '5'], start_new_session=True); sys.exit(4)")
    assert heard.code() == 4


@posix
def test_a_program_that_is_still_running_is_ended() -> None:
    heard = Heard()
    program = heard.run("print('up', flush=True); import time; time.sleep(600)")
    assert heard.line() == "up"
    program.end()
    assert heard.code() == 128 + 15
    program.end()


@pytest.mark.parametrize(
    ("command", "complaint"),
    [
        ("/no/such/program", "--run '/no/such/program': No such file or directory"),
        pytest.param("'unbalanced", "No closing quotation", marks=posix),
        pytest.param("  ", "--run needs a program", marks=posix),
    ],
)
def test_a_program_that_cannot_start_says_why(command: str, complaint: str) -> None:
    heard = Heard()
    with pytest.raises(ProgramError) as caught:
        Program(command, {}, heard.codes.put)
    assert complaint in str(caught.value)
