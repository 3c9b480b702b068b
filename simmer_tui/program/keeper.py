"""Ends all that a program started, and watches so that this happens if the simulator is killed.

    python -I -S keeper.py      (orders on standard input)

An order is a line: `MARK PID` says that a program runs, `MARK PID STARTED` that it has left a process behind,
with its start time in clock ticks, and `MARK` that it and all it started has ended.
When standard input ends, because the simulator closed it or was killed, the keeper ends whatever is still
running, and goes. One keeper serves all programs of a simulator, one after the other: an interpreter
takes longer to start than a small program takes to run.

On Linux everything that a program starts is known by a variable in its environment. Children that clear
theirs are known by their parent or by the program's session. Orphans of another session are adopted by the
simulator, which looks for them four times a second (`kept_process.py`). Elsewhere it is the program's process
group, and children.

A script that imports little and nothing of this package, so that it watches within milliseconds.
"""

from __future__ import annotations

# `signal` makes enums of all this, which takes half as long as Python's own start.
import _signal as signal  # type: ignore[import-not-found]
import os
import sys
import time

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable

MARK = "SIMMER_KEPT"
"""The variable that marks everything that a program started."""
KEEPER = "keeper"
"""Its value in a keeper."""
# Enough for a program that catches SIGTERM to close its files.
TERMINATE_TIMEOUT = 1.0
"""Seconds between SIGTERM and SIGKILL."""
# Together with `TERMINATE_TIMEOUT` below the 2 s that a run may take to end after a signal (cli/run_life.py).
_KILL_TIMEOUT = 0.5
"""Seconds that killed processes may take to end: some wait for a disk."""
_SOON, _LATER = 0.002, 0.02
"""Least and greatest time between two searches for processes, seconds. The first comes soon because most
programs end at once. Later ones are rarer because each reads all of /proc."""
_AT_ONCE = 1 << 16
"""Bytes read at once: more than most environments have."""
_KERNEL_THREAD = 0x200000
"""The flag of kernel threads (PF_KTHREAD, proc(5)), half of the entries in an idle machine's /proc."""
_STARTED = 19
"""Position of the start time in /proc/PID/stat, counted after the name."""
_LINUX = sys.platform == "linux"


def main() -> None:
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        # a signal for the simulator's processes may be sent to this one too
        signal.signal(number, signal.SIG_IGN)
    running: dict[str, int] = {}
    adopted: dict[str, dict[int, bytes]] = {}
    for line in sys.stdin:
        mark, *numbers = line.split()
        if len(numbers) > 1:
            adopted.setdefault(mark, {})[int(numbers[0])] = numbers[1].encode()
        elif numbers:
            running[mark] = int(numbers[0])
        else:
            running.pop(mark, None)
            adopted.pop(mark, None)
    for mark, program in running.items():
        left = adopted.get(mark, {})
        end_all(mark, program, lambda left=left: {pid for pid in left if _is_same(pid, left[pid])})  # type: ignore[misc]


def end_all(mark: str, program: int, adopted: Callable[[], set[int]] = set) -> None:
    """End everything started by the program with this mark, first by SIGTERM.

    More may start meanwhile. `adopted` returns processes that are known to be the program's in other ways.
    """
    for number, timeout in ((signal.SIGTERM, TERMINATE_TIMEOUT), (signal.SIGKILL, _KILL_TIMEOUT)):
        until = time.monotonic() + timeout
        asked: set[int] = set()
        pause = _SOON
        while found := _started_by(mark, program, adopted()):
            for pid in found - asked if number == signal.SIGTERM else found:
                _send(pid, number)
            asked |= found
            # After a signal, since on a busy machine one search may take longer than the wait.
            if time.monotonic() >= until:
                break
            time.sleep(pause)
            pause = min(2 * pause, _LATER)


def _is_same(pid: int, started: bytes) -> bool:
    """True if a process lives and began at this time: its number may be another one's by now."""
    try:
        fields = _read(f"/proc/{pid}/stat").rpartition(b") ")[2].split()
    except OSError:
        return False
    return fields[0] not in (b"Z", b"X") and fields[_STARTED] == started


def _send(pid: int, number: int) -> None:
    try:
        os.kill(pid, number)
    except OSError:
        return  # it has ended by itself, or is another user's


def _started_by(mark: str, program: int, adopted: set[int]) -> set[int]:
    """The processes with a mark, those adopted, and their descendants; without this one and ended ones that
    are not reaped."""
    children: dict[int, list[int]] = {}
    found = set(adopted)
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
    """Every living process, its parent, and True if it has the mark or is in the program's session.

    On other systems than Linux it is True if the process is in the program's group.
    """
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
            fields = _read(f"/proc/{name}/stat").rpartition(b") ")[2].split(None, 7)
            state, parent, _, session = fields[:4]
            if int(fields[6]) & _KERNEL_THREAD:
                continue
        except (OSError, ValueError):
            continue  # ended meanwhile
        # known also as the parent of a child that has neither mark nor parent
        is_marked = int(session) == program
        try:
            is_marked = is_marked or mark in _read(f"/proc/{name}/environ").split(b"\0")
        except PermissionError:
            pass  # another user's
        except OSError:
            continue
        if state not in (b"Z", b"X"):
            processes.append((int(name), int(parent), is_marked))
    return processes


def _read(path: str) -> bytes:
    """All of a file of /proc. By bare system calls: every run reads two such files for each process, and
    `open` takes three times as long."""
    file = os.open(path, os.O_RDONLY)
    try:
        data = os.read(file, _AT_ONCE)
        while len(data) % _AT_ONCE == 0 and (more := os.read(file, _AT_ONCE)):
            data += more
        return data
    finally:
        os.close(file)


if __name__ == "__main__":
    main()
