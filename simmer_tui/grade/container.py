"""Programs sandboxed by docker or podman, in an image that has Python, `timeout` and what programs need.

The simulator stays outside. The launcher in the container connects to a Unix socket in a mounted folder, and
passes its listening sockets through it. The container has no network. This needs the engine on the same
machine, not on another or in a virtual one.
"""

from __future__ import annotations

import contextlib
import math
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from simmer_tui import platform_has
from simmer_tui.errors import GradeError
from simmer_tui.grade.limits import Limits
from simmer_tui.grade.sandbox import (
    ANSWER_TIMEOUT,
    HOME,
    LAUNCHER,
    SANDBOXED_FILES,
    SCRATCH,
    LaunchedSandbox,
    package_folders,
)
from simmer_tui.sketch.board_process import BoardProcess

DEFAULT_IMAGE = "python:3.12-slim"
_DOOR, _KNOCKER = "/door", "launcher"
# The user `nobody` of all distributions.
_USER = 65534
# An engine that is starting takes seconds.
_ASKED = 30.0
"""Time limit for an answer of an engine itself, seconds."""
# An engine that copies the image for every container took 12 s on a busy machine.
_START_TIMEOUT = 60.0
"""Time limit for a container to begin, seconds."""
_POLL_INTERVAL = 0.2
"""Time between two checks of an engine's process, seconds."""
# The reason is at the end, below a history of what the engine tried.
_END = 200
"""Characters of an engine's output that are shown."""


class Container(LaunchedSandbox):
    """A container for one run."""

    _python = "/usr/local/bin/python3"

    def __init__(
        self, engine: str, image: str, files: Path, limits: Limits, extra: Sequence[str] = ()
    ) -> None:
        """`engine` is docker or podman, `extra` are more folders that are visible, read-only."""
        super().__init__(files, limits, extra)
        self._engine = engine
        self._image = image or DEFAULT_IMAGE
        self._door = Path(tempfile.mkdtemp(prefix="simmer-door-"))
        self._name = self._door.name

    @property
    def _resources(self) -> dict[str, int]:
        """The limits without NPROC, which counts a user's processes in all containers: --pids-limit counts in
        one."""
        return {name: value for name, value in super()._resources.items() if name != "NPROC"}

    def _launch(self) -> tuple[subprocess.Popen[bytes], socket.socket]:
        if sys.platform == "win32":
            raise NotImplementedError  # there are no Unix sockets
        self._door.chmod(0o755)
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listening:
            _bind(listening, self._door)
            (self._door / _KNOCKER).chmod(0o666)
            listening.listen(1)
            listening.settimeout(_POLL_INTERVAL)
            process = subprocess.Popen(
                self.words(),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                start_new_session=True,
            )
            link = _knock(listening, process)
            if link is None:
                self._kill()
                process.kill()
                said = _shown_end(b"".join(process.communicate()).decode(errors="replace"))
                raise GradeError(f"the container did not begin: {said or 'its engine says nothing'}")
        (self._door / _KNOCKER).unlink()  # only one launcher may connect, and it has
        return process, link

    def words(self) -> list[str]:
        """The command that makes the container."""
        seen = package_folders() | {self._files: SANDBOXED_FILES, self._door: _DOOR}
        seen |= {Path(each): each for each in self._extra}
        words = [self._engine, "run", "--rm", "--name", self._name, "--network", "none", "--read-only"]
        words += ["--cap-drop", "ALL", "--security-opt", "no-new-privileges", "--user", f"{_USER}:{_USER}"]
        words += ["--ipc", "private", "--hostname", "robot", "--log-driver", "none"]
        words += ["--pids-limit", str(self._limits.processes), "--shm-size", str(SCRATCH)]
        words += ["--memory", str(self._limits.memory_bytes), "--memory-swap", str(self._limits.memory_bytes)]
        for place, size in (("/tmp", SCRATCH), (str(Path(HOME).parent), self._limits.disk_bytes)):
            words += ["--tmpfs", f"{place}:rw,exec,mode=1777,size={size}"]
        for path, place in seen.items():
            words += ["--volume", f"{path}:{place}:ro"]
        # A container is not a child of this process, and would outlive it if it is killed. `timeout`, its
        # first process, which the program cannot kill, ends it.
        longest = str(math.ceil(self._limits.time + ANSWER_TIMEOUT))
        words += ["--entrypoint", "timeout", self._image, "-s", "KILL", longest]
        return [*words, "python3", "-I", "-S", LAUNCHER, f"{_DOOR}/{_KNOCKER}"]

    def board(self, name: str, program: Path, options: Sequence[str]) -> BoardProcess:
        raise NotImplementedError  # teams with boards are refused before they are run

    def _kill(self) -> None:
        with contextlib.suppress(OSError, subprocess.TimeoutExpired):
            subprocess.run(
                [self._engine, "kill", self._name], capture_output=True, timeout=ANSWER_TIMEOUT, check=False
            )
        super()._kill()

    def close(self) -> None:
        try:
            super().close()
        finally:
            shutil.rmtree(self._door, ignore_errors=True)


def _bind(listening: socket.socket, door: Path) -> None:
    """Bind a Unix socket in a folder with a path of any length. Raises OSError."""
    # The path of a socket has at most 107 bytes (unix(7)), and TMPDIR may be longer, as in jobs of a cluster.
    descriptor = os.open(door, os.O_RDONLY)
    try:
        listening.bind(f"/proc/self/fd/{descriptor}/{_KNOCKER}")
    finally:
        os.close(descriptor)


def _knock(listening: socket.socket, process: subprocess.Popen[bytes]) -> socket.socket | None:
    """The launcher's connection; None if the engine's process has ended, or it does not come in time."""
    deadline = time.monotonic() + _START_TIMEOUT
    while True:
        is_last = process.poll() is not None or time.monotonic() >= deadline
        try:
            return listening.accept()[0]
        except TimeoutError:
            if is_last:
                return None


def what_is_missing(engine: str, image: str) -> str:
    """Reason why an engine cannot sandbox programs in an image here, or an empty string."""
    if shutil.which(engine) is None:
        return f"{engine} is not installed"
    if not platform_has.POSIX:
        return f"{engine} needs to be on the same Linux machine"
    image = image or DEFAULT_IMAGE
    # An image that the engine has to fetch first comes too late for a run.
    for words, refused in (
        (("info",), f"{engine} does not answer"),
        (("image", "inspect", image), f"{engine} has no image {image} ({engine} pull {image} fetches it)"),
    ):
        try:
            asked = subprocess.run(
                [engine, *words], capture_output=True, text=True, timeout=_ASKED, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            return f"{engine} does not answer: {error}"
        if asked.returncode:
            return f"{refused}: {_shown_end(asked.stderr)}"
    return ""


def _shown_end(output: str) -> str:
    return output.strip()[-_END:]
