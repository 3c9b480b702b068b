"""Probes of the port, as `nc -z` and health checks make them: who sends nothing is no client."""

from __future__ import annotations

import math
import socket
from typing import Any

from simmer_tui.config.dialects import COMMANDS


def probe(served: Any) -> None:
    """Connect and close, without a byte."""
    address = ("127.0.0.1", served.server.ports[COMMANDS.purpose])
    with socket.create_connection(address, 60) as sock:
        sock.shutdown(socket.SHUT_WR)
        assert sock.recv(1) == b""  # it has been noticed


def test_a_probe_is_not_told_and_one_beside_a_client_neither(serve: Any) -> None:
    served = serve()
    probe(served)
    program = serve.program(served).open_commands()
    assert program.ask("d1-0.01") == math.inf
    probe(served)
    assert program.ask("d1-0.01") == math.inf
    program.close()
    served.wait_notice("disconnected after 2 commands")
    told = [text for text in served.notices if text.startswith("client ")]
    assert [text.split()[2] for text in told] == ["connected", "disconnected"]


def test_a_client_that_stays_is_told_before_it_sends(serve: Any) -> None:
    served = serve()
    program = serve.program(served).open_commands()
    served.wait_notice(" connected")
    program.close()
    served.wait_notice("disconnected after 0 commands")
