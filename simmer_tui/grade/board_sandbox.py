"""Boards of a grading: each sketch runs in a sandbox of its own, with the limits of a program.

The board's channel are the pipes of its sandbox. It sees its compiled sketch alone of the team's files. Lines
are looked up in another sandbox: a compiled sketch is read there that a team may have made for this purpose.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from simmer_tui import platform_has
from simmer_tui.errors import GradeError, SimmerError
from simmer_tui.grade.sandbox import SANDBOXED_FILES, LaunchedSandbox
from simmer_tui.links.processes import children
from simmer_tui.sketch.board_host import last_words
from simmer_tui.sketch.board_process import BoardProcess
from simmer_tui.sketch.checked_board import CheckedBoard
from simmer_tui.sketch.sketch_lines import ADDRESS_TOOL, SketchLines

NewSandbox = Callable[[Path], LaunchedSandbox]
"""A function that makes a sandbox in which a folder is visible at `SANDBOXED_FILES`."""
_LONGEST_LOOK = 5.0
"""Real seconds for the answer about a line; it takes milliseconds."""
_LONGEST_ANSWER = 65536
"""Bytes of an answer about a line."""
# addr2line -a writes the address before its lines. Nothing lies at address 0, so its answer ends another one.
_END = b"0x0000000000000000\n"
_SIGNALS = 128
"""Exit codes above are signals, as in shells."""
_LIMITS = {9: "it was killed", 24: "it took more processor time than it may", 25: "it wrote more than it may"}
"""Words for the signals of limits: SIGKILL, SIGXCPU, SIGXFSZ of Linux."""


class BoardSandboxes:
    """The sandboxes of the boards of one run."""

    def __init__(self, make: NewSandbox) -> None:
        self._make = make
        self._hosts: list[SandboxedBoard] = []
        self._lines: dict[Path, SandboxedLines] = {}
        self.fault = ""
        """The reason why this machine could make no sandbox for a board; empty if it could."""

    def board(self, name: str, program: Path, options: Sequence[str]) -> BoardProcess:
        """Start a board in a sandbox. A failure is told when it is received from."""
        lines = self._lines.get(program)
        if lines is None:
            lines = self._lines[program] = SandboxedLines(program, self._make)
        return CheckedBoard(name, program, options, self._start, lines)

    def _start(self, program: Path, options: Sequence[str]) -> SandboxedBoard:
        words = [f"{SANDBOXED_FILES}/{program.name}", *options]
        try:
            host = SandboxedBoard(self._make(program.parent), words)
        except GradeError as error:
            self.fault = f"a board has no sandbox: {error}"
            raise
        self._hosts.append(host)
        return host

    def close(self) -> None:
        """End all of them."""
        for host in self._hosts:
            host.close()
        for lines in self._lines.values():
            lines.close()


class SandboxedBoard:
    """A board's process in a sandbox (`BoardHost`)."""

    def __init__(self, sandbox: LaunchedSandbox, words: Sequence[str]) -> None:
        """Start it. Raises GradeError, ProgramError."""
        self._sandbox = sandbox
        self._limit = ""
        self._pids: tuple[int, ...] = ()
        try:
            self._process = sandbox.start_piped(words, self._note_limit)
        except SimmerError:
            sandbox.close()
            raise
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self.input, self.output = self._process.stdin.fileno(), self._process.stdout.fileno()

    def _note_limit(self, reason: str) -> None:
        self._limit = reason

    @property
    def pids(self) -> tuple[int, ...]:
        self._pids = self._pids or self._boards()
        return self._pids

    def _boards(self) -> tuple[int, ...]:
        # The launcher is the first process of the sandbox, and the board its child.
        launchers = children(self._process.pid)
        return tuple(board for launcher in launchers for board in children(launcher))

    def interrupt(self) -> None:
        for board in self._boards():
            with contextlib.suppress(OSError):
                os.kill(board, signal.SIGABRT)

    def kill(self) -> None:
        self._process.kill()

    def end(self) -> tuple[str, str]:
        words, code = last_words(self._process), self._process.wait()
        number = code - _SIGNALS
        ended = _LIMITS.get(number, f"signal {number}") if number > 0 else f"exit code {code}"
        return words, self._limit or ended

    def close(self) -> None:
        self._sandbox.close()


class SandboxedLines(SketchLines):
    """The lines of a compiled sketch, looked up in a sandbox that begins with the first look."""

    def __init__(self, program: Path, make: NewSandbox) -> None:
        super().__init__(program)
        self._make = make
        self._sandbox: LaunchedSandbox | None = None
        self._process: subprocess.Popen[bytes] | None = None

    def _told(self, address: int) -> str:
        try:
            if self._sandbox is None:
                self._begin()
            process = self._process
            if process is None or process.stdin is None or process.stdout is None:
                return ""
            os.write(process.stdin.fileno(), f"{hex(address)}\n0x0\n".encode())
            answer = _read_answer(process.stdout.fileno())
        except (OSError, SimmerError):
            answer = b""
        if not answer:
            self._process = None  # it is not asked again
        # The first line is the address; that of address 0 ends the answer.
        return answer.partition(_END)[0].partition(b"\n")[2].decode("utf-8", "replace")

    def _begin(self) -> None:
        self._sandbox = self._make(self._program.parent)
        words = [ADDRESS_TOOL, "-i", "-a", "-e", f"{SANDBOXED_FILES}/{self._program.name}"]
        self._process = self._sandbox.start_piped(words, lambda reason: None)

    def close(self) -> None:
        """End the sandbox."""
        if self._sandbox is not None:
            self._sandbox.close()


def _read_answer(output: int) -> bytes:
    """The answer up to that about address 0, with it; empty if it does not come. Raises OSError."""
    if not platform_has.POSIX:
        raise NotImplementedError  # there are no sandboxes here
    answer = b""
    until = time.monotonic() + _LONGEST_LOOK
    while not (_END in answer and answer.partition(_END)[2].endswith(b"\n")):
        if not select.select([output], [], [], max(until - time.monotonic(), 0.0))[0]:
            return b""
        more = os.read(output, _LONGEST_ANSWER)
        answer += more
        if not more or len(answer) > _LONGEST_ANSWER:
            return b""
    return answer
