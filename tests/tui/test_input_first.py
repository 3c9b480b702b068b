"""Pictures left out while much input waits."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from simmer_tui.tui import frame_pace
from tests.tui.conftest import Cockpit

Fly = Callable[..., int | None]


@pytest.mark.parametrize(("waiting", "shown"), [(0, 150), (2, 150), (100, 20)])
def test_two_pictures_a_second_are_shown_while_much_input_waits(
    waiting: int, shown: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    queue: asyncio.Queue[int] = asyncio.Queue()
    for number in range(waiting):
        queue.put_nowait(number)
    app: Any = SimpleNamespace(_message_queue=queue)
    input_first = frame_pace.InputFirst(app)
    moments = iter([number / 16 for number in range(160)])
    monkeypatch.setattr(frame_pace, "time", SimpleNamespace(monotonic=lambda: next(moments)))
    pictures = [not input_first.passes_over() for _ in range(160)]
    assert pictures[0]
    assert sum(pictures[:150]) == pytest.approx(shown, abs=1)


@pytest.mark.slow
def test_typed_text_is_taken_before_the_next_picture_which_follows(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        app = cockpit.app
        app.refresh_frame()
        frames = app.frames
        cockpit.burst("u" * 50)
        await app._sample()
        assert app.frames == frames
        await cockpit.until(lambda: cockpit.line == "u" * 50)
        app.refresh_frame()
        await cockpit.until(lambda: app.frames > frames)

    fly(scenario)
