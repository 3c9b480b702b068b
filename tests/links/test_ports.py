"""Taking ports, and what a student reads when one cannot be had."""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from simmer_tui.errors import PortError
from simmer_tui.links import ports
from simmer_tui.links.ports import Listener, PortRequest, end_with_machine, take_port

ANY = PortRequest(0, "commands", "--port")


def has_ipv6() -> bool:
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        return False
    return True


@pytest.fixture
def taken() -> Iterator[Listener]:
    listener = take_port("127.0.0.1", ANY)
    yield listener
    listener.close()


def addresses(listener: Listener) -> list[str]:
    return [sock.getsockname()[0] for sock in listener.sockets]


def test_any_free_port_is_the_same_on_every_address(taken: Listener) -> None:
    assert taken.port > 0
    assert {sock.getsockname()[1] for sock in taken.sockets} == {taken.port}
    assert addresses(taken)[0] == "127.0.0.1"


@pytest.mark.skipif(not has_ipv6(), reason="no ::1 on this machine")
@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_where_there_is_ipv6_localhost_means_both(host: str) -> None:
    listener = take_port(host, ANY)
    assert addresses(listener) == ["127.0.0.1", "::1"]
    for address in ("127.0.0.1", "::1", "localhost"):
        socket.create_connection((address, listener.port), 10).close()
    listener.close()


def test_without_ipv6_localhost_means_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "has_ipv6", False)
    listener = take_port("127.0.0.1", ANY)
    assert addresses(listener) == ["127.0.0.1"]
    listener.close()


def test_all_addresses_of_the_machine() -> None:
    listener = take_port("0.0.0.0", ANY)
    assert addresses(listener) == ["0.0.0.0"]
    socket.create_connection(("127.0.0.1", listener.port), 10).close()
    listener.close()


def test_a_port_in_use_names_it_and_what_to_do(taken: Listener) -> None:
    with pytest.raises(PortError) as caught:
        take_port("127.0.0.1", PortRequest(taken.port, "replies", "--reply-port"))
    text = str(caught.value)
    for part in (f"port {taken.port} (replies) is in use", "--reply-port N", "0 takes any free one"):
        assert part in text
    assert "\n" not in text


@pytest.mark.skipif(not has_ipv6(), reason="no ::1 on this machine")
def test_a_port_in_use_on_one_address_is_left_on_the_other() -> None:
    with socket.create_server(("::1", 0), family=socket.AF_INET6) as other:
        number = other.getsockname()[1]
        with pytest.raises(PortError, match="in use"):
            take_port("127.0.0.1", PortRequest(number, "commands", "--port"))
        socket.create_server(("127.0.0.1", number)).close()


def test_a_port_given_back_is_free_at_once(taken: Listener) -> None:
    client = socket.create_connection(("127.0.0.1", taken.port), 10)
    accepted = taken.sockets[0]
    accepted.setblocking(True)
    connection, _ = accepted.accept()
    connection.close()  # our side closes first and lingers in TIME_WAIT
    assert client.recv(1) == b""
    client.close()
    taken.close()
    take_port("127.0.0.1", PortRequest(taken.port, "commands", "--port")).close()


@pytest.mark.parametrize(
    ("host", "part"),
    [("no.such.host.invalid", "no such host"), ("203.0.113.1", "not an address of this machine")],
)
def test_a_host_that_is_not_ours_is_named(host: str, part: str) -> None:
    with pytest.raises(PortError, match=part) as caught:
        take_port(host, ANY)
    assert f"--host {host}" in str(caught.value)


@pytest.mark.parametrize(
    ("number", "part"),
    [(errno.EACCES, "above 1023 with --port N"), (errno.ENOBUFS, os.strerror(errno.ENOBUFS))],
)
def test_other_reasons_are_passed_on(monkeypatch: pytest.MonkeyPatch, number: int, part: str) -> None:
    def refuse(*_: object) -> socket.socket:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(ports, "listen_on", refuse)
    with pytest.raises(PortError, match="port 80 \\(commands\\)") as caught:
        take_port("127.0.0.1", PortRequest(80, "commands", "--port"))
    assert part in str(caught.value)


def test_a_free_port_that_is_taken_on_the_second_address_is_tried_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    real, calls = ports.listen_on, []

    def unlucky(family: socket.AddressFamily, address: str, port: int, backlog: int) -> socket.socket:
        calls.append(address)
        if len(calls) in (1, 2):
            raise OSError(errno.EADDRINUSE, os.strerror(errno.EADDRINUSE))
        return real(family, address, port, backlog)

    monkeypatch.setattr(ports, "listen_on", unlucky)
    take_port("127.0.0.1", ANY).close()
    assert len(calls) >= 3


def test_no_free_port_at_all_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> socket.socket:
        raise OSError(errno.EADDRINUSE, os.strerror(errno.EADDRINUSE))

    monkeypatch.setattr(ports, "listen_on", refuse)
    with pytest.raises(PortError, match="no free port was found for commands"):
        take_port("127.0.0.1", ANY)


def test_hundreds_of_programs_may_connect_before_one_is_accepted(taken: Listener) -> None:
    """A busy machine comes to accept them late: the system keeps them till then."""
    somaxconn = Path("/proc/sys/net/core/somaxconn")
    if not somaxconn.exists() or int(somaxconn.read_text()) < 400:
        pytest.skip("the system's own limit is lower")
    opened: list[socket.socket] = []
    try:
        opened.extend(socket.create_connection(("127.0.0.1", taken.port), 5) for _ in range(300))
    finally:
        for each in opened:
            each.close()
    assert len(opened) == 300


@pytest.mark.skipif(not hasattr(socket, "TCP_USER_TIMEOUT"), reason="this system has no such option")
def test_a_connection_whose_machine_is_gone_ends_in_a_minute_while_a_reply_is_under_way() -> None:
    with socket.socket() as sock:
        end_with_machine(sock)
        assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 60_000
        assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE) == 30
