"""Usage of a sandbox as the kernel tells it: files of /proc and messages of sock_diag, byte by byte.

Layouts: proc(5), sock_diag(7), linux/inet_diag.h, linux/unix_diag.h, linux/netlink_diag.h, linux/netlink.h.
"""

from __future__ import annotations

import builtins
import os
import socket
import struct
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from simmer_tui.grade import usage as module
from simmer_tui.grade.cgroup import ControlGroup
from simmer_tui.grade.usage import SandboxUsage, Supervisor, descendants, tells_descendants

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="there are sandboxes on Linux alone")

Proc = Callable[[dict[str, str]], Path]


@pytest.fixture
def proc(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Proc:
    """Writes files that stand for those of /proc."""
    place = tmp_path / "proc"

    def there(path: str) -> str:
        return str(path).replace("/proc/", f"{place}/", 1) if str(path).startswith("/proc/") else path

    opened = builtins.open
    monkeypatch.setattr(module, "Path", lambda path: Path(there(path)))
    listed = os.listdir
    monkeypatch.setattr(os, "listdir", lambda path=".": listed(there(path)))
    monkeypatch.setattr(builtins, "open", lambda path, *given: opened(there(path), *given))

    def write(files: dict[str, str]) -> Path:
        for name, text in files.items():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            (place / name).write_text(text)
        return place

    return write


def family(children: dict[int, Sequence[str]]) -> dict[str, str]:
    """Files with the children of processes; those of each thread are a text."""
    return {
        f"{pid}/task/{pid + thread}/children": text
        for pid, texts in children.items()
        for thread, text in enumerate(texts)
    }


def test_descendants_are_those_of_all_threads(proc: Proc) -> None:
    proc(family({10: ["20 30 ", "40 "], 20: ["50 "], 30: [""], 50: [""]}))
    (proc({}) / "30" / "task" / "31").mkdir()  # a thread that is ending
    assert sorted(descendants(10)) == [10, 20, 30, 40, 50]
    assert descendants(99) == [99]


def test_memory_is_the_proportional_set_or_else_the_resident_one(proc: Proc) -> None:
    proc(
        family({10: ["20 30 40 "]})
        | {
            "10/smaps_rollup": "a [rollup]\nRss: 900 kB\nPss: 100 kB\nPss_Dirty: 7 kB\n",
            "10/statm": "9 9 9\n",
            "20/smaps_rollup": "a [rollup]\nPss: odd kB\n",
            "20/statm": "90 5 3\n",
            "30/statm": "4\n",
        }
    )
    assert SandboxUsage(10).memory() == 100 * 1024 + 5 * os.sysconf("SC_PAGE_SIZE")


def stat(own: tuple[int, int], waited: tuple[int, int], started: int = 5) -> str:
    """A /proc/PID/stat with times in clock ticks, proc(5): fields 14 to 17 and 22."""
    fields = (
        ["S"] + ["0"] * 10 + [*map(str, own), *map(str, waited)] + ["0"] * 4 + [str(started)] + ["0"] * 30
    )
    return f"1 (a (name) b) {' '.join(fields)}\n"


def test_processor_time_counts_what_has_ended(proc: Proc) -> None:
    ticks = os.sysconf("SC_CLK_TCK")
    usage = SandboxUsage(10)
    proc(
        family({10: ["20 30 "]})
        | {"10/stat": stat((1, 20), (300, 4000)), "20/stat": stat((50000, 0), (0, 0))}
    )
    assert usage.processor_time() * ticks == pytest.approx(54321)
    # 20 has ended and nobody waited for it; another process has its number
    proc({"20/stat": stat((7, 0), (0, 0), started=6)})
    assert usage.processor_time() * ticks == pytest.approx(21 + 50000 + 7)
    # 10 has waited for it: its time counts once
    proc({"10/stat": stat((1, 20), (300, 54000))})
    assert usage.processor_time() * ticks == pytest.approx(54321 + 7)


def test_files_in_memory_cost_the_kernel_a_kibibyte_each(proc: Proc, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first process is outside of the sandbox, the second has ended."""
    proc(family({10: ["20 "], 20: ["30 "]}))
    used = {"/proc/30/root/tmp": (900, 880), "/proc/30/root/dev/shm": (50, 49)}

    def statvfs(path: str) -> SimpleNamespace:
        if path not in used:
            raise FileNotFoundError
        files, free = used[path]
        return SimpleNamespace(f_files=files, f_ffree=free)

    monkeypatch.setattr(os, "statvfs", statvfs)
    assert SandboxUsage(10, folders=("/tmp", "/dev/shm")).memory() == 21 * 1024
    used |= {"/proc/10/root/tmp": (9, 0), "/proc/10/root/dev/shm": (9, 0)}
    assert SandboxUsage(10, folders=("/tmp", "/dev/shm")).memory() == 21 * 1024
    used |= {"/proc/20/root/tmp": (9, 2), "/proc/20/root/dev/shm": (9, 4)}
    assert SandboxUsage(10, folders=("/tmp", "/dev/shm")).memory() == 12 * 1024
    assert SandboxUsage(99, folders=("/tmp",)).memory() == 0


# -- buffers of sockets ----------------------------------------------------------------------------

ALL = 0xFFFFFFFF
DONE, ERROR, BY_FAMILY = 3, 2, 20
IN_OF = {"inet": 72, "unix": 16, "netlink": 28}
"""Lengths of inet_diag_msg, unix_diag_msg and netlink_diag_msg."""


def inet_request(family: int, protocol: int) -> bytes:
    """inet_diag_req_v2: all states, INET_DIAG_SKMEMINFO (7) wanted, no address."""
    return struct.pack("=BBBBI", family, protocol, 1 << (7 - 1), 0, ALL) + bytes(48)


REQUESTS = [
    (inet_request(socket.AF_INET, socket.IPPROTO_TCP), "inet", 7),
    (inet_request(socket.AF_INET, socket.IPPROTO_UDP), "inet", 7),
    (inet_request(socket.AF_INET6, socket.IPPROTO_TCP), "inet", 7),
    (inet_request(socket.AF_INET6, socket.IPPROTO_UDP), "inet", 7),
    # unix_diag_req: all states, UDIAG_SHOW_MEMINFO, no cookie; UNIX_DIAG_MEMINFO is 5
    (struct.pack("=BBHIIIII", socket.AF_UNIX, 0, 0, ALL, 0, 0x20, ALL, ALL), "unix", 5),
    # netlink_diag_req: all protocols (255), NDIAG_SHOW_MEMINFO, no cookie; NETLINK_DIAG_MEMINFO is 0
    (struct.pack("=BBHIIII", socket.AF_NETLINK, 255, 0, 0, 1, ALL, ALL), "netlink", 0),
]


def attribute(kind: int, data: bytes) -> bytes:
    """An nlattr: its length, its kind, its data, up to a multiple of four bytes."""
    return struct.pack("=HH", 4 + len(data), kind) + data + bytes(-len(data) % 4)


def message(kind: int, body: bytes = b"") -> bytes:
    """An nlmsghdr with a body, up to a multiple of four bytes."""
    return struct.pack("=IHHII", 16 + len(body), kind, 2, 0, 0) + body + bytes(-len(body) % 4)


def figures(received: int = 0, sent: int = 0, queued: int = 0, options: int = 0, backlog: int = 0) -> bytes:
    """SK_MEMINFO of linux/sock_diag.h, with figures in the places that do not count."""
    return struct.pack("=9I", received, 10**8, sent, 10**8, 10**8, queued, options, backlog, 10**8)


class Kernel:
    """A socket of sock_diag: its answers to the requests, each a list of what it receives."""

    def __init__(self, answers: Sequence[Sequence[bytes] | OSError]) -> None:
        self.asked: list[bytes] = []
        self.limits: list[float] = []
        self.closed = 0
        self._answers = iter(answers)
        self._now: Any = iter(())

    def settimeout(self, seconds: float) -> None:
        self.limits.append(seconds)

    def send(self, data: bytes) -> None:
        self.asked.append(data)
        answer = next(self._answers)
        if isinstance(answer, OSError):
            raise answer
        self._now = iter(answer)

    def recv(self, size: int) -> bytes:
        return bytes(next(self._now))[:size]

    def close(self) -> None:
        self.closed += 1


def buffers(kernel: Kernel) -> int:
    """The memory of sockets alone."""
    usage = SandboxUsage(-1, kernel)  # type: ignore[arg-type] - it has all that is used
    memory = usage.memory()
    usage.close()
    assert kernel.closed == 1
    return memory


def test_every_kind_of_socket_is_asked_for() -> None:
    kernel = Kernel([[message(DONE)]] * len(REQUESTS))
    assert buffers(kernel) == 0
    head = struct.pack("=HHII", BY_FAMILY, 0x301, 0, 0)  # NLM_F_REQUEST, NLM_F_ROOT and NLM_F_MATCH
    assert kernel.asked == [
        struct.pack("=I", 16 + len(request)) + head + request for request, _, _ in REQUESTS
    ]
    assert kernel.limits == [1.0] * len(REQUESTS)


def test_buffers_of_all_sockets_are_added_up() -> None:
    """Bytes allocated to receive, to send (or queued, the same ones), for options and in the backlog."""
    answers = []
    for place, (_, kind, wanted) in enumerate(REQUESTS):
        body = bytes(IN_OF[kind])
        more = attribute(wanted + 1, b"abc") + attribute(wanted, figures(received=10**place))
        answers.append([message(BY_FAMILY, body + more), message(DONE)])
    assert buffers(Kernel(answers)) == 111_111
    one = [attribute(7, figures(1, 20, 30, 400, 5000)), attribute(7, figures(sent=70_000, queued=9))]
    answers[0] = [b"".join(message(BY_FAMILY, bytes(72) + each) for each in one), message(DONE)]
    assert buffers(Kernel(answers)) == 111_110 + 5431 + 70_000


def test_an_answer_ends_with_done_or_an_error() -> None:
    more = message(BY_FAMILY, bytes(72) + attribute(7, figures(5)))
    rest: list[list[bytes]] = [[message(DONE)]] * 5
    for end in (message(DONE), message(ERROR), struct.pack("=IHHII", 15, BY_FAMILY, 0, 0, 0)):
        assert buffers(Kernel([[more + end + more], *rest])) == 5
        assert buffers(Kernel([[more, more, end, more], *rest])) == 10


def test_what_a_kernel_does_not_report_is_left_out() -> None:
    more = [message(BY_FAMILY, bytes(28) + attribute(0, figures(5))), message(DONE)]
    assert buffers(Kernel([OSError(2, "no such kind")] * 5 + [more])) == 5


@pytest.mark.parametrize(
    ("attributes", "found"),
    [
        (attribute(7, figures(3)[:32]), 3),  # of older kernels, without dropped packets
        (attribute(7, figures(3)[:31]), 0),
        (attribute(7, figures(3)[:28]), 0),
        (attribute(7, figures(3)[:28]) + attribute(7, figures(3)), 3),
        (attribute(3, figures(3)), 0),
        (struct.pack("=HH", 0, 3) + attribute(7, figures(3)), 3),  # as short as none can be
        (attribute(3, b"12345") + attribute(7, figures(3)), 3),
        (attribute(3, b"") + attribute(7, figures(3)), 3),
        (b"", 0),
        (b"abc", 0),
    ],
)
def test_figures_are_looked_for_among_the_attributes(attributes: bytes, found: int) -> None:
    rest = [[message(DONE)]] * 5
    assert buffers(Kernel([[message(BY_FAMILY, bytes(72) + attributes), message(DONE)], *rest])) == found


def test_long_answers_are_received_in_one_piece() -> None:
    body = message(BY_FAMILY, bytes(72) + attribute(7, figures(1)))
    whole = (1 << 16) // len(body)
    rest = [[message(DONE)]] * 5
    assert buffers(Kernel([[body * whole, message(DONE)], *rest])) == whole


# -- supervisor ------------------------------------------------------------------------------------


class Meter:
    """A usage that is told beforehand, check by check; the last one stays."""

    def __init__(self, memory: Sequence[int], time: Sequence[float]) -> None:
        self.memories, self.times, self.closed = list(memory), list(time), 0

    def memory(self) -> int:
        return self.memories.pop(0) if len(self.memories) > 1 else self.memories[0]

    def processor_time(self) -> float:
        return self.times.pop(0) if len(self.times) > 1 else self.times[0]

    def close(self) -> None:
        self.closed += 1


def test_the_first_limit_that_is_passed_ends_a_sandbox() -> None:
    """At the limit it may go on."""
    by_memory = "ended: its processes took more than 2000000 MB together"
    by_time = "ended: its processes took more than 1.5 s of processor time together"
    grouped: Any = SimpleNamespace(processor_time=iter([1.5, 1.6]).__next__)
    cases: list[tuple[Meter, ControlGroup | None, str]] = [
        (Meter([2 * 10**12, 2 * 10**12 + 1], [0.0]), None, by_memory),
        (Meter([0], [1.5, 1.500001]), None, by_time),
        (Meter([9 * 10**12], [9.0]), grouped, by_time),
    ]
    told: dict[int, str] = {}
    ends = [threading.Event() for _ in cases]

    def ended(case: int) -> Callable[[str], None]:
        def end(reason: str) -> None:
            told[case] = reason
            ends[case].set()

        return end

    watching = [
        Supervisor(usage, group, 2 * 10**12, 1.5, ended(case))  # type: ignore[arg-type]
        for case, (usage, group, _) in enumerate(cases)
    ]
    for end, each in zip(ends, watching, strict=True):
        assert end.wait(20)
        each.close()
    assert [told[case] for case in range(len(cases))] == [reason for _, _, reason in cases]
    assert [usage.closed for usage, _, _ in cases] == [1, 1, 1]
    assert [len(usage.memories) + len(usage.times) for usage, _, _ in cases] == [2, 2, 2]


def test_a_system_that_lists_children_has_the_file(proc: Proc) -> None:
    assert not tells_descendants()
    proc(family({os.getpid(): [""]}))
    assert tells_descendants()
