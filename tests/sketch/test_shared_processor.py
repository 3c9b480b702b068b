"""One processor for a thread and processes that take turns."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator

import pytest

from simmer_tui.sketch.shared_processor import SharedProcessor

if sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2:
    pytest.skip("needs Linux and two processors", allow_module_level=True)


@pytest.fixture
def child() -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        yield process


def test_they_share_one_processor_while_they_take_turns(child: subprocess.Popen[bytes]) -> None:
    before = os.sched_getaffinity(0)
    processor = SharedProcessor()
    with processor.turns((child.pid,)):
        shared = os.sched_getaffinity(0)
        assert len(shared) == 1
        assert os.sched_getaffinity(child.pid) == shared
    assert os.sched_getaffinity(0) == before


def test_another_process_in_the_place_of_one_comes_to_the_same_processor(
    child: subprocess.Popen[bytes],
) -> None:
    processor = SharedProcessor()
    with processor.turns(()):
        pass
    with processor.turns((child.pid,)):
        assert os.sched_getaffinity(child.pid) == os.sched_getaffinity(0)


def test_a_process_that_has_ended_changes_nothing() -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    before = os.sched_getaffinity(0)
    with SharedProcessor().turns((ended.pid,)):
        assert len(os.sched_getaffinity(0)) == 1
    assert os.sched_getaffinity(0) == before


def test_an_error_gives_the_processors_back() -> None:
    before = os.sched_getaffinity(0)
    with pytest.raises(ValueError, match="a board died"), SharedProcessor().turns(()):
        raise ValueError("a board died")
    assert os.sched_getaffinity(0) == before
