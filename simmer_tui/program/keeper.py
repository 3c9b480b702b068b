"""Starts a program, and keeps watch so that all it started ends, whoever else dies.

    python -I -S keeper.py CONTROL STATUS FAILURE PROGRAM ARGUMENT ...

This process becomes the program: a child of the simulator, with its input, output and environment.
Before that it leaves a keeper behind, a process of its own that neither program nor simulator know as
a child. Nobody writes to the pipe CONTROL; when its other side is closed, by the simulator or because
that was killed, the keeper ends all that the program started, writes `done` to STATUS and goes. To
FAILURE goes the errno of a program that cannot be started.

On Linux everything that a program starts is known by a variable in its environment (and by its parent,
for those that clear theirs), whatever sessions and orphans it makes; and the program itself dies with
the simulator by a parent-death signal. Elsewhere it is the program's process group, and children.

A script that imports little and nothing of this package: every run of a program waits for it.
"""

from __future__ import annotations

# `signal` makes enums of all this, which takes half as long as Python's own start.
import _signal as signal  # type: ignore[import-not-found]
import errno
import os
import select
import sys
import time

MARK = "SIMMER_KEPT"
"""The variable by which all that a program started is known."""
PATIENCE = 1.0
"""How long what is asked to end may take before it is killed, seconds."""
_LAST = 0.5
"""How long the killed may take to be gone, seconds: some wait for a disk."""
_SOON, _LATER = 0.002, 0.02
"""Least and greatest time between two looks whether all are gone, seconds."""
_SET_DEATH_SIGNAL = 1  # <sys/prctl.h>
_LINUX = sys.platform == "linux"


def main(arguments: list[str]) -> None:
    control, status, failure = map(int, arguments[:3])
    for pipe in (control, status, failure):
        os.set_inheritable(pipe, False)
    program, simulator = os.getpid(), os.getppid()
    between = os.fork()
    if between == 0:  # it ends at once, so that the keeper is nobody's child
        try:
            if os.fork() == 0:
                os.close(failure)
                _keep(control, status, program)
        finally:
            os._exit(0)
    os.waitpid(between, 0)
    _become(arguments[3:], simulator, failure)


def _become(words: list[str], simulator: int, failure: int) -> None:
    """Run the program in this process."""
    try:
        if _LINUX:
            import ctypes

            ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
            if os.getppid() != simulator:  # it had gone before that
                return
        for name in ("SIGPIPE", "SIGXFSZ"):  # Python ignores them; programs should not
            if hasattr(signal, name):
                signal.signal(getattr(signal, name), signal.SIG_DFL)
        os.execvp(words[0], words)
    except OSError as error:
        os.write(failure, str(error.errno).encode())
    except ValueError:  # an empty name
        os.write(failure, str(errno.ENOENT).encode())


def _keep(control: int, status: int, program: int) -> None:
    """Be the keeper."""
    os.setsid()
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # `pkill -f my_robot.py` finds this process too
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):  # else whoever reads the program's output would wait for the keeper too
        os.dup2(nothing, stream)
    select.select([control], [], [])
    end_all(os.environ[MARK], program)
    os.write(status, b"done")


def end_all(mark: str, program: int) -> None:
    """End everything started by the program with this mark, by SIGTERM first. More may start meanwhile."""
    for number, patience in ((signal.SIGTERM, PATIENCE), (signal.SIGKILL, _LAST)):
        until = time.monotonic() + patience
        asked: set[int] = set()
        pause = _SOON
        while (found := _started_by(mark, program)) and time.monotonic() < until:
            for pid in found - asked if number == signal.SIGTERM else found:
                _send(pid, number)
            asked |= found
            time.sleep(pause)
            pause = min(2 * pause, _LATER)


def _send(pid: int, number: int) -> None:
    try:
        os.kill(pid, number)
    except OSError:
        return  # it has gone by itself, or is another user's


def _started_by(mark: str, program: int) -> set[int]:
    """The processes with a mark, and those below them; not this one, nor those that have ended and
    wait to be noticed."""
    children: dict[int, list[int]] = {}
    found = set()
    for pid, parent, is_marked in _processes(f"{MARK}={mark}".encode(), program):
        children.setdefault(parent, []).append(pid)
        if is_marked:
            found.add(pid)
    waiting = list(found)
    while waiting:
        new = set(children.get(waiting.pop(), ())) - found
        found |= new
        waiting += new
    return found - {os.getpid()}


def _processes(mark: bytes, program: int) -> list[tuple[int, int, bool]]:
    """Every process that lives, its parent, and whether it has the mark (elsewhere than on Linux:
    is in the program's group)."""
    if not _LINUX:
        with os.popen("ps -A -o pid=,ppid=,pgid=,stat=") as listing:
            rows = [line.split() for line in listing]
        return [
            (int(pid), int(parent), int(group) == program)
            for pid, parent, group, state in (row for row in rows if len(row) == 4)
            if not state.startswith("Z")
        ]
    processes = []
    for name in os.listdir("/proc"):  # noqa: PTH208 - pathlib takes longer to import than the rest
        if not name.isdigit():
            continue
        try:
            with open(f"/proc/{name}/stat", "rb") as file:  # noqa: PTH123
                state, parent = file.read().rpartition(b") ")[2].split()[:2]
            with open(f"/proc/{name}/environ", "rb") as file:  # noqa: PTH123
                is_marked = mark in file.read().split(b"\0")
        except PermissionError:
            is_marked = False  # another user's
        except (OSError, ValueError):
            continue  # gone while we looked
        if state not in (b"Z", b"X"):
            processes.append((int(name), int(parent), is_marked))
    return processes


if __name__ == "__main__":
    main(sys.argv[1:])
    os._exit(127)
