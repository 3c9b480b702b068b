"""Sandboxes: their kinds and limits, and the launcher inside that all have, reached through a Unix socket."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from pathlib import Path, PurePosixPath
from typing import ClassVar

from simmer_tui.config.sets import bundled_folder
from simmer_tui.errors import GradeError, PortError, ProgramError, reason_of
from simmer_tui.grade.cgroup import ControlGroup
from simmer_tui.grade.limits import Limits
from simmer_tui.grade.usage import SandboxUsage, Supervisor
from simmer_tui.links.ports import Listener, PortRequest
from simmer_tui.program.control_program import RunningProgram
from simmer_tui.program.program_command import with_hook, words_of
from simmer_tui.program.program_output import ProgramOutput, reading
from simmer_tui.sketch.board_host import close_process

HOME, SANDBOXED_FILES, SANDBOXED_PACKAGE = "/robot/home", "/program", "/simmer"
"""In a sandbox: the program's own copy of its files, the original files, and our package."""
ROOM = str(PurePosixPath(HOME).parent)
"""In a sandbox: the folder that is as large as the limit of the disk."""
HOOK = f"{SANDBOXED_PACKAGE}/simmer_tui/program/hook"
"""In a sandbox: the folder that is first on the path of a Python program with a clock of its own."""
LAUNCHER = f"{SANDBOXED_PACKAGE}/simmer_tui/grade/launcher.py"
"""In a sandbox: the launcher."""
# Both are in memory, and count towards the limits of memory and disk.
SCRATCH = 16_000_000
"""Bytes of /tmp and of /dev/shm."""
WRITABLE = ("/dev/shm", "/tmp", ROOM)
"""In a sandbox of bubblewrap: the folders that are in memory."""
# Bubblewrap takes milliseconds, a container a second; many at once take longer.
ANSWER_TIMEOUT = 20.0
"""Time limit for an answer of a sandbox, seconds."""
_LAST = 2.0
"""Time limit for the processes of a sandbox to end, seconds."""
_LONGEST_ANSWER = 65536  # bytes of an answer, one message in JSON
# A port has at most two: one for IPv4, one for IPv6.
_MOST_SOCKETS = 4


class LaunchedSandbox(ABC):
    """A sandbox for one run of the program in a folder. Only one run may use it."""

    _python: ClassVar[str]
    """The Python command in the sandbox."""
    _meters: ClassVar[bool] = False
    """True if a supervisor measures the usage of its processes."""

    def __init__(self, files: Path, limits: Limits, extra: Sequence[str] = ()) -> None:
        """`extra` are more folders that are visible, read-only."""
        self._files = files
        self._limits = limits
        self._extra = extra
        self._process: subprocess.Popen[bytes] | None = None
        self._link: socket.socket | None = None
        self._program: RunningProgram | None = None
        self._supervisor: Supervisor | None = None
        self._group: ControlGroup | None = None
        self._stdin = subprocess.DEVNULL
        """Standard input of the program."""

    @abstractmethod
    def _launch(self) -> tuple[subprocess.Popen[bytes], socket.socket]:
        """Start the sandbox: its process, whose output is the program's, and the socket to the launcher in
        it. Raises GradeError, OSError."""

    @property
    def _uid(self) -> int | None:
        """The user ID for the program; None for the one it begins with."""
        return None

    @property
    def _resources(self) -> dict[str, int]:
        """The limits that the launcher sets, by the end of their RLIMIT_ names."""
        return self._limits.resources()

    def _kill(self) -> None:
        """End everything in it."""
        if self._process is not None:
            self._process.kill()

    def _end(self) -> None:
        """End everything in it, unless it has ended with its first process."""
        if self._process is not None and self._process.returncode is None:
            self._kill()

    def take(self, host: str, request: PortRequest) -> Listener:
        """Listen in the sandbox on 127.0.0.1, whatever the host is. Raises PortError, GradeError."""
        self._open()
        answer, sockets = self._ask({"listen": request.number})
        if "error" in answer:
            raise PortError(f"port {request.number} ({request.purpose}): {answer['error']}")
        for each in sockets:
            each.listen(request.backlog)  # the launcher knows no dialect
            each.setblocking(False)
        return Listener(int(answer["port"]), sockets, request.backlog)

    def start(
        self,
        command: str,
        variables: Mapping[str, str],
        on_end: Callable[[int], None],
        on_line: Callable[[str], None],
        output: ProgramOutput,
    ) -> RunningProgram:
        """Start the program. Raises ProgramError."""
        process = self._open()
        environment = with_hook(sandbox_environment(self._python) | dict(variables), HOOK)
        meter = self._begin(command, words_of(command, self._python), environment, SANDBOXED_FILES, HOME)
        assert process.stdout is not None, "its output is taken"
        assert process.stderr is not None, "its output is taken"
        with process.stdout as stdout, process.stderr as stderr:
            reader = reading(output, os.dup(stdout.fileno()), os.dup(stderr.fileno()), on_line)
        self._program = RunningProgram(process.wait, self._end, reader, on_end, _LAST)

        def end(reason: str) -> None:
            output.stderr.add(f"{reason}\n".encode())
            on_line(reason)
            self._kill()

        self._supervise(process, meter, end)
        return self._program

    def start_piped(
        self, words: Sequence[str], on_limit: Callable[[str], None], python_path: Sequence[str] = ()
    ) -> subprocess.Popen[bytes]:
        """Start a program whose standard input, output and errors are the pipes of the process returned.

        It reads its files at `SANDBOXED_FILES`, and has no copy of them. `on_limit` is called with the limit
        that it has exceeded before it is ended, in a thread of its own. `python_path` are more folders of
        Python packages. Raises GradeError, ProgramError.
        """
        self._stdin = subprocess.PIPE
        process = self._open()
        environment = sandbox_environment(self._python) | {"HOME": ROOM, "TMPDIR": ROOM}
        environment["PYTHONPATH"] = ":".join((SANDBOXED_PACKAGE, *python_path))
        meter = self._begin(words[0], words, environment, "", ROOM)

        def end(reason: str) -> None:
            on_limit(reason)
            self._kill()

        self._supervise(process, meter, end)
        return process

    def _begin(
        self, name: str, words: Sequence[str], environment: Mapping[str, str], files: str, home: str
    ) -> list[socket.socket]:
        """Order the launcher to start a program; returns the meter of its sockets, if there is one. Raises
        GradeError, ProgramError."""
        order = {
            "run": [*words],
            "environment": environment,
            "uid": self._uid,
            "files": files,
            "home": home,
            "limits": self._resources,
        }
        meter = self._ask({"meter": 1})[1] if self._meters else []
        answer, _ = self._ask(order)
        if "error" in answer:
            for each in meter:
                each.close()
            raise ProgramError(f"{name}: {answer['error']}")
        return meter

    def _supervise(
        self, process: subprocess.Popen[bytes], meter: list[socket.socket], end: Callable[[str], None]
    ) -> None:
        if self._meters:
            limits, usage = self._limits, SandboxUsage(process.pid, meter[0] if meter else None, WRITABLE)
            self._supervisor = Supervisor(usage, self._group, limits.memory_bytes, limits.cpu, end)

    def close(self) -> None:
        """Kill the processes in the sandbox, and wait until they have ended."""
        if self._program is not None:
            self._program.end()
        elif self._process is not None and self._stdin == subprocess.PIPE:
            self._end()
            close_process(self._process)
        elif self._process is not None and self._process.returncode is None:
            self._kill()
            if self._link is not None:
                self._link.close()  # ends a launcher that an engine has left running, and its output
            self._process.communicate()
        if self._link is not None:
            self._link.close()
        if self._supervisor is not None:
            self._supervisor.close()
        if self._group is not None:
            self._group.remove()

    def _open(self) -> subprocess.Popen[bytes]:
        """The process of the sandbox, with the launcher in it. Raises GradeError."""
        if self._process is None:
            try:
                self._process, self._link = self._launch()
            except OSError as error:
                raise GradeError(f"{error.filename or 'the sandbox'}: {reason_of(error)}") from None
            self._link.settimeout(ANSWER_TIMEOUT)
        return self._process

    def _ask(self, order: Mapping[str, object]) -> tuple[dict[str, str], list[socket.socket]]:
        """The launcher's answer; an empty one when the program has begun. Raises GradeError."""
        if sys.platform != "linux":
            raise NotImplementedError  # there are no sandboxes here
        assert self._link is not None, "there is a launcher to ask"
        assert self._process is not None, "there is a launcher to ask"
        try:
            self._link.send(json.dumps(order).encode())
            data, numbers, _, _ = socket.recv_fds(self._link, _LONGEST_ANSWER, _MOST_SOCKETS)
        except OSError as error:
            data, numbers = b"", []
            if "run" in order or isinstance(error, TimeoutError):
                raise GradeError(f"the sandbox did not answer: {error}{self._last_output()}") from None
        sockets = [socket.socket(fileno=number) for number in numbers]
        # The first order: of a program that is piped no port was taken before.
        is_first = "listen" in order or ("meter" in order and self._stdin == subprocess.PIPE)
        if not data and is_first:
            raise GradeError(f"the sandbox could not be made{self._last_output()}")
        return (json.loads(data) if data else {}), sockets

    def _last_output(self) -> str:
        """Last output of bubblewrap before it ended."""
        assert self._process is not None, "it has been started"
        self._kill()
        said = b"".join(self._process.communicate()).decode(errors="replace").strip()
        return f": {said}" if said else ""


def package_folders() -> dict[Path, str]:
    """Folders of our package here, and their paths in a sandbox."""
    package = Path(__file__).resolve().parent.parent
    seen = {package: f"{SANDBOXED_PACKAGE}/{package.name}"}
    if not bundled_folder().is_relative_to(package):
        seen[bundled_folder()] = f"{SANDBOXED_PACKAGE}/{bundled_folder().name}"
    return seen


def sandbox_environment(python: str) -> dict[str, str]:
    """The environment of a sandboxed program, without that of this process."""
    return {
        "PATH": f"{Path(python).parent}:/usr/local/bin:/usr/bin:/bin",
        "HOME": HOME,
        "TMPDIR": "/tmp",
        "LANG": "C.UTF-8",
        "PYTHONPATH": SANDBOXED_PACKAGE,
        "PYTHONHASHSEED": "0",
        "OMP_NUM_THREADS": "1",  # one thread a processor would exceed the limits on large machines
        "OPENBLAS_NUM_THREADS": "1",
    }


class Isolation(StrEnum):
    """Kind of sandbox."""

    BWRAP = "bwrap"
    DOCKER = "docker"
    PODMAN = "podman"
    NONE = "none"
