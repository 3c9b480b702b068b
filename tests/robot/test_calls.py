"""Calls of one command, from the bytes to the reply: later work must not spend again what was saved."""

from __future__ import annotations

import signal

import pytest

from benchmarks.bench_calls import REACHED, reached

SPARE = 1.05


@pytest.mark.parametrize(("command", "variant"), REACHED)
def test_a_command_takes_no_more_calls_than_were_reached(
    command: str, variant: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(signal, "signal", lambda number, handler: None)  # those of the tests stay
    calls = reached(command, variant)
    assert 0 < calls <= SPARE * REACHED[command, variant]
