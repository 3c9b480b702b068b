"""The launcher, in this process: its answers to orders, and all that it does before and after a program."""

from __future__ import annotations

import ctypes
import errno
import json
import os
import shutil
import signal
import socket
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ClassVar

import pytest

from simmer_tui.grade import launcher

resource = pytest.importorskip("resource", reason="Windows has no limits of processes")

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="there are sandboxes on Linux alone")

Calls = list[tuple[object, ...]]
Answers = list[tuple[dict[str, Any], list[socket.socket]]]
Ask = Callable[..., Answers]
Launch = Callable[[str | socket.socket], None]


class Ended(BaseException):
    """The end of the process by `os._exit`."""


class Odd(socket.socket):
    """Sockets of the launcher. Those of IPv6 are refused `refusals` times; `waiting` has their backlogs."""

    refusals = 0
    refused = socket.AF_INET6
    why = errno.EADDRINUSE
    waiting: ClassVar[list[int]] = []
    made: ClassVar[list[socket.socket]] = []

    def __init__(self, *given: Any, **more: Any) -> None:
        super().__init__(*given, **more)
        self.made.append(self)

    def bind(self, address: Any) -> None:
        if self.family == Odd.refused and Odd.refusals:
            Odd.refusals -= 1
            raise OSError(Odd.why, os.strerror(Odd.why))
        super().bind(address)

    def listen(self, backlog: int = 1) -> None:
        self.waiting.append(backlog)
        super().listen(backlog)


@pytest.fixture
def odd(monkeypatch: pytest.MonkeyPatch) -> type[Odd]:
    usual = {"waiting": [], "made": [], "refusals": 0, "refused": socket.AF_INET6, "why": errno.EADDRINUSE}
    for name, value in usual.items():
        monkeypatch.setattr(Odd, name, value)
    return Odd


@pytest.fixture
def calls() -> Calls:
    """Calls of `launch` that would change this process, with their arguments, in order."""
    return []


@pytest.fixture
def launch(calls: Calls, odd: type[Odd], monkeypatch: pytest.MonkeyPatch) -> Launch:
    """The launcher's main function, without effect on this process."""

    class Library:
        def prctl(self, *given: int) -> None:
            calls.append(("prctl", *given))

    def end(code: int) -> None:
        calls.append(("_exit", code))
        raise Ended

    def run(where: str | socket.socket) -> None:
        with monkeypatch.context() as patch:

            def noted(module: object, name: str) -> None:
                patch.setattr(module, name, lambda *given: calls.append((name, *given)))

            patch.setattr(ctypes, "CDLL", lambda name: Library())
            noted(signal, "signal")
            noted(resource, "setrlimit")
            for name in ("setgroups", "setgid", "setuid", "chdir", "dup2"):
                noted(os, name)
            patch.setattr(os, "_exit", end)
            patch.setenv("PATH", os.environ["PATH"])
            patch.setattr(socket, "socket", odd)
            if not isinstance(where, str):
                where.set_inheritable(True)
                where = str(where.detach())
            try:
                launcher.main([where])
            finally:
                still_open = [each for each in odd.made if each.fileno() != -1]
                assert not any(each.get_inheritable() for each in still_open)
                for each in still_open:  # its process ends
                    each.close()
        assert still_open in ([], odd.made[:1])  # at most that to the simulator

    return run


@pytest.fixture
def link() -> Iterator[tuple[socket.socket, socket.socket]]:
    """The simulator's end and the launcher's, of which the launcher takes over the descriptor."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs:
        yield ours, theirs


@pytest.fixture
def ask(link: tuple[socket.socket, socket.socket], launch: Launch) -> Iterator[Ask]:
    """Gives orders to the launcher, and returns its answers once it has come to the end of the orders."""
    opened: list[socket.socket] = []

    def asked(*orders: object) -> Answers:
        ours, theirs = link
        for order in orders:
            ours.send(order if isinstance(order, bytes) else json.dumps(order).encode())
        ours.shutdown(socket.SHUT_WR)
        launch(theirs)
        answers: Answers = []
        while True:
            data, numbers, _, _ = socket.recv_fds(ours, 1 << 16, 4)
            sockets = [socket.socket(fileno=number) for number in numbers]
            opened.extend(sockets)
            if not data:
                return answers
            answers.append((json.loads(data), sockets))

    yield asked
    for each in opened:
        each.close()


def test_ports_are_taken_for_both_addresses_of_this_machine(ask: Ask, calls: Calls) -> None:
    ((answer, sockets),) = ask({"listen": 0})
    port = answer["port"]
    assert [each.getsockname()[:2] for each in sockets] in (
        [("127.0.0.1", port), ("::1", port)],
        [("127.0.0.1", port)],
    )
    for each in sockets:
        assert each.getsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR)
        assert each.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN)
        assert each.type == socket.SOCK_STREAM
        if each.family == socket.AF_INET6:
            assert each.getsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY)
    # PR_SET_DUMPABLE of linux/prctl.h, and signals that the program might send.
    assert calls == [
        ("prctl", 4, 0, 0, 0, 0),
        *(("signal", number, signal.SIG_IGN) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)),
    ]


@pytest.mark.parametrize("refusals", [1, 49, 50])
def test_any_port_is_one_that_both_addresses_have_free(ask: Ask, odd: type[Odd], refusals: int) -> None:
    odd.refusals = refusals
    ((answer, sockets),) = ask({"listen": 0})
    if refusals < 50:
        assert sockets
        assert odd.waiting == [128] * (refusals + len(sockets))
    else:
        assert (answer, sockets) == ({"error": "no port was free"}, [])


def test_machine_without_the_second_protocol_has_one_address(ask: Ask, odd: type[Odd]) -> None:
    odd.refusals, odd.why = 1, errno.EADDRNOTAVAIL
    ((answer, sockets),) = ask({"listen": 0})
    assert [each.getsockname() for each in sockets] == [("127.0.0.1", answer["port"])]


@pytest.mark.parametrize("why", [errno.EACCES, errno.EADDRNOTAVAIL])
def test_what_hinders_every_port_is_not_tried_again(ask: Ask, odd: type[Odd], why: int) -> None:
    odd.refusals, odd.refused, odd.why = 2, socket.AF_INET, why
    assert ask({"listen": 0}) == [({"error": os.strerror(why)}, [])]
    assert odd.refusals == 1


def test_a_port_that_is_taken_is_said_and_the_next_order_carried_out(ask: Ask, odd: type[Odd]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        (refused, none), (given, sockets) = ask({"listen": taken.getsockname()[1]}, {"listen": 0})
    assert (refused, none) == ({"error": os.strerror(errno.EADDRINUSE)}, [])
    assert given["port"] == sockets[0].getsockname()[1]


def test_a_port_that_was_asked_for_is_not_tried_again(ask: Ask, odd: type[Odd]) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    odd.refusals = 1
    ((answer, sockets),) = ask({"listen": port})
    assert (answer, sockets) == ({"error": os.strerror(errno.EADDRINUSE)}, [])


def test_the_meter_is_a_socket_of_sock_diag(ask: Ask) -> None:
    ((answer, (meter,)),) = ask({"meter": 1})
    assert answer == {}
    assert (meter.family, meter.type, meter.proto) == (socket.AF_NETLINK, socket.SOCK_RAW, 4)


def test_an_order_has_up_to_128_kibibytes(ask: Ask) -> None:
    order = json.dumps({"listen": 0, "more": ""}).encode()
    longest = order[:-2] + b"x" * ((1 << 17) - len(order)) + order[-2:]
    ((answer, _),) = ask(longest)
    assert "port" in answer


def test_a_longer_order_is_cut(ask: Ask) -> None:
    order = json.dumps({"listen": 0, "more": ""}).encode()
    with pytest.raises(ValueError, match="Expecting ',' delimiter"):
        ask(order[:-2] + b"x" * ((1 << 17) - len(order) + 1) + order[-2:])


def test_a_launcher_in_a_container_connects_by_a_path(tmp_path: Path, launch: Launch) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listening:
        listening.bind(str(tmp_path / "door"))
        listening.listen(1)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(socket.socket, "recv", lambda self, size: b"")  # the simulator has ended
            launch(str(tmp_path / "door"))
        ours, _ = listening.accept()
        ours.close()


def ordered(home: Path, **more: object) -> dict[str, Any]:
    """The order to run a program."""
    usual: dict[str, Any] = {
        "run": ["sh", "a word"], "environment": {"PATH": "/somewhere", "A": "b"}, "uid": None, "files": "",
        "home": str(home), "limits": {"CPU": 3, "CORE": 0},
    }  # fmt: skip
    return usual | more


LIMITS: Calls = [
    ("setrlimit", resource.RLIMIT_CPU, (3, 3)),
    ("setrlimit", resource.RLIMIT_CORE, (0, 0)),
]


@pytest.mark.parametrize("uid", [None, 0, 12345])
def test_the_child_becomes_the_program(
    link: tuple[socket.socket, socket.socket],
    launch: Launch,
    calls: Calls,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    uid: int | None,
) -> None:
    """User, files, limits, signals and surroundings, in this order; then the program."""
    files, home = tmp_path / "files", tmp_path / "home"
    files.mkdir()
    (files / "main.py").write_text("go")
    (files / "link").symlink_to("nowhere")
    monkeypatch.setattr(os, "fork", lambda: 0)

    def execute(*given: object) -> None:
        calls.append(("execvpe", *given, os.environ["PATH"]))
        raise OSError(errno.EACCES, "x" * 501)

    monkeypatch.setattr(os, "execvpe", execute)
    ours, theirs = link
    order = ordered(home, uid=uid, files=str(files))
    ours.send(json.dumps(order).encode())
    with pytest.raises(Ended):
        launch(theirs)
    user = [] if uid is None else [("setgroups", []), ("setgid", uid), ("setuid", uid)]
    usual = (signal.SIGPIPE, signal.SIGXFSZ, signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    assert calls[4:] == [
        *user,
        ("chdir", str(home)),
        *LIMITS,
        *(("signal", number, signal.SIG_DFL) for number in usual),
        ("execvpe", "sh", ["sh", "a word"], {"PATH": "/somewhere", "A": "b"}, "/somewhere"),
        ("_exit", 127),
    ]
    assert sorted(path.name for path in home.iterdir()) == ["link", "main.py"]
    assert (home / "link").readlink() == Path("nowhere")
    assert json.loads(ours.recv(1 << 16)) == {"error": "x" * 500}


@pytest.mark.parametrize("program", ["no-such-program", "./no-such-program"])
def test_a_program_that_is_not_there_is_named(
    link: tuple[socket.socket, socket.socket],
    launch: Launch,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    program: str,
) -> None:
    monkeypatch.setattr(os, "fork", lambda: 0)
    ours, theirs = link
    ours.send(json.dumps(ordered(tmp_path, run=[program])).encode())
    with pytest.raises(Ended):
        launch(theirs)
    assert json.loads(ours.recv(1 << 16)) == {"error": f"the sandbox has no {program}"}


def test_a_program_without_files_has_the_folder_as_it_is(
    link: tuple[socket.socket, socket.socket],
    launch: Launch,
    calls: Calls,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(os, "fork", lambda: 0)
    monkeypatch.setattr(shutil, "copytree", lambda *given, **more: pytest.fail("nothing is copied"))
    monkeypatch.setattr(os, "execvpe", lambda *given: None)
    ours, theirs = link
    ours.send(json.dumps(ordered(tmp_path)).encode())
    with pytest.raises(Ended):
        launch(theirs)
    assert ("chdir", str(tmp_path)) in calls


@pytest.mark.parametrize(("status", "code"), [(0, 0), (7 << 8, 7), (signal.SIGHUP, 128 + 1)])
def test_the_launcher_ends_as_the_program_and_not_as_an_orphan(
    link: tuple[socket.socket, socket.socket],
    launch: Launch,
    calls: Calls,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    status: int,
    code: int,
) -> None:
    """It has the program's limits, and none of its output."""
    ended = iter([(40, 1 << 8), (43, 0), (42, status)])
    monkeypatch.setattr(os, "fork", lambda: 42)
    monkeypatch.setattr(os, "wait", lambda: next(ended))
    monkeypatch.setattr(os, "open", lambda *given: calls.append(("open", *given)) or 77)
    ours, theirs = link
    ours.send(json.dumps(ordered(tmp_path)).encode())
    with pytest.raises(Ended):
        launch(theirs)
    assert calls[4:] == [
        ("open", os.devnull, os.O_RDWR),
        *(("dup2", 77, standard) for standard in (0, 1, 2)),
        *LIMITS,
        ("_exit", code),
    ]
    assert next(ended, None) is None
    assert ours.recv(99) == b""  # closed: the program has begun


def test_what_hinders_a_start_is_told_in_500_characters(
    ask: Ask, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused() -> int:
        raise OSError(errno.EAGAIN, "y" * 600)

    monkeypatch.setattr(os, "fork", refused)
    ((first, _), (second, _)) = ask(ordered(tmp_path), ordered(tmp_path))
    assert first == second == {"error": "y" * 500}
