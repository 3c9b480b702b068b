"""A connection on the reply port that is another process's never counts as the client's."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from simmer_tui.config.dialects import REPLIES
from simmer_tui.run.events import Notice, NoticeKind

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells whose a connection is")
SILENT = """
import socket, sys
sock = socket.create_connection(("127.0.0.1", int(sys.argv[1])))
print("there", flush=True)
sys.stdin.read()
"""


@contextmanager
def forgotten_program(served: Any) -> Iterator[None]:
    """A program that holds a connection on the reply port and does nothing."""
    command = [sys.executable, "-c", SILENT, str(served.server.ports[REPLIES.purpose])]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"there\n"
        yield


def test_a_program_that_uses_the_command_port_alone_gets_its_replies_there(serve: Any) -> None:
    served = serve()
    with forgotten_program(served):
        for _ in range(2):
            program = serve.program(served).open_commands()
            assert program.ask("u1") > 0
            program.close()
        served.wait_notice("on the reply port is another program's")


def test_another_programs_connection_is_no_mistake_of_the_one_that_drives(serve: Any) -> None:
    served = serve()
    program = serve.program(served).open_commands()
    assert program.ask("u1") > 0
    with forgotten_program(served):
        served.wait_notice("it belongs to no client")
        assert program.ask("u1") > 0
    assert not [
        event for event in served.events if isinstance(event, Notice) and event.kind is NoticeKind.FAULT
    ]


@pytest.mark.parametrize("first", [True, False])
def test_a_program_with_both_gets_them_on_its_own(serve: Any, first: bool) -> None:
    served = serve()
    program = serve.program(served)
    if first:
        program.open_replies()
    with forgotten_program(served):
        if not first:
            program.open_replies()
        program.open_commands()
        assert program.ask("u1") > 0
        assert program.ask("d1-1") > 0


def test_a_program_that_has_forked_since_gets_them_on_its_own(serve: Any) -> None:
    """Its child has the command connection too, and not that for the replies."""
    served = serve()
    program = serve.program(served).open_commands()
    assert program.commands is not None
    child = subprocess.Popen(
        [sys.executable, "-c", "input()"], stdin=subprocess.PIPE, pass_fds=[program.commands.fileno()]
    )
    with child:
        program.open_replies()
        assert program.ask("u1") > 0
        child.communicate(b"\n")
