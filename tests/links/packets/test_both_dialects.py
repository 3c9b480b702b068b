"""MATLAB's programs and those that send packets, at one robot whose movements take their time."""

from __future__ import annotations

import math
import socket
import struct
from collections.abc import Callable
from typing import Any

import pytest

from simmer_tui.run.events import Action, ActionName
from simmer_tui.sim import CommandResult, Status

Serve = Callable[..., Any]
BOTH = {"server__listeners": "binary,packets", "server__port": 0, "motion__reply": "auto"}


def number(connection: socket.socket) -> float:
    return float(struct.unpack(">d", connection.recv(8))[0])


DRIVES = ("w0", "d0", "r0")


def movements(running: Any) -> list[CommandResult]:
    return [
        event for event in running.events if isinstance(event, CommandResult) and event.command.code in DRIVES
    ]


def test_binary_and_packets_are_served_together_and_drive_one_robot(served: Serve) -> None:
    running = served(**BOTH, motion__motion="instant")
    assert set(running.server.ports) == {"commands", "replies", "packets", "packet replies", "beliefs"}
    with running.connect("commands") as binary:
        binary.sendall(b"w0-3\n")
        assert number(binary) == math.inf
        assert running.ask(b"[m0]") == b"[m0:3.0]"
        binary.sendall(b"xx\n")
        assert struct.pack(">d", float("nan")) == binary.recv(8)  # a word of packets only


def test_a_timed_drive_is_answered_at_its_end_in_binary_and_at_once_in_packets(served: Serve) -> None:
    running = served(**BOTH, motion__time_scale=100.0)
    with running.connect("commands") as binary:
        binary.sendall(b"w0-36\n")
        assert number(binary) == math.inf
        (movement,) = movements(running)
        assert movement.status is Status.DONE
        assert movement.trajectory is not None
        assert movement.time == movement.trajectory.start_time + 6.0
    assert running.ask(b"[r0:90]") == b"[r0:True]"
    assert movements(running)[-1].status is Status.ACCEPTED


@pytest.mark.parametrize("stopped_by", ["console", "packet"])
def test_a_stop_ends_a_timed_drive_early_and_answers_it(served: Serve, stopped_by: str) -> None:
    running = served(**BOTH, motion__time_scale=0.1)
    with running.connect("commands") as binary:
        binary.sendall(b"w0-36\n")
        while running.ask(b"[w0:0]") != b"[w0:False]":
            pass
        if stopped_by == "console":
            running.server.call(running.server.engine.perform, Action(ActionName.STOP))
        else:
            assert running.ask(b"[xx]") == b"[xx:DRIVE STOP]"
        assert number(binary) == math.inf
        (movement,) = [event for event in movements(running) if event.command.text == "w0-36"]
        assert movement.status is Status.DONE
        assert movement.pose.y < 42.0
        binary.sendall(b"m0\n")
        assert number(binary) == pytest.approx(movement.pose.y - 6.0)
