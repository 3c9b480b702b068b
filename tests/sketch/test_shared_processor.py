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
def processor() -> Iterator[SharedProcessor]:
    """A processor that is released in the end, and then the thread has its own again."""
    before = os.sched_getaffinity(0)
    made = SharedProcessor()
    yield made
    made.release()
    assert os.sched_getaffinity(0) == before


@pytest.fixture
def child() -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        yield process


def test_they_share_one_processor_while_they_take_turns(
    child: subprocess.Popen[bytes], processor: SharedProcessor
) -> None:
    with processor.turns((child.pid,)):
        shared = os.sched_getaffinity(0)
        assert len(shared) == 1
        assert os.sched_getaffinity(child.pid) == shared


def test_a_processor_is_kept_for_some_turns_and_then_chosen_again(
    processor: SharedProcessor, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 100.0
    monkeypatch.setattr("simmer_tui.sketch.shared_processor.time.monotonic", lambda: now)
    own, seen = os.sched_getaffinity(0), []
    for step in (0.0, 0.02, 0.02, 0.02, 0.02):
        now += step
        with processor.turns(()):
            assert len(os.sched_getaffinity(0)) == 1
        seen.append(os.sched_getaffinity(0) == own)
    assert seen == [False, False, False, True, False]


def test_another_process_in_the_place_of_one_comes_to_the_same_processor(
    child: subprocess.Popen[bytes], processor: SharedProcessor
) -> None:
    with processor.turns(()):
        pass
    with processor.turns((child.pid,)):
        assert os.sched_getaffinity(child.pid) == os.sched_getaffinity(0)


def test_a_process_that_has_ended_changes_nothing(processor: SharedProcessor) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    with processor.turns((ended.pid,)):
        assert len(os.sched_getaffinity(0)) == 1


def test_an_error_leaves_a_processor_that_can_be_released(processor: SharedProcessor) -> None:
    with pytest.raises(ValueError, match="a board died"), processor.turns(()):
        raise ValueError("a board died")
