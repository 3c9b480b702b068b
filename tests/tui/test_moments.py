"""One frame shows one moment: the current values of a frame agree, whatever a program does meanwhile."""

from __future__ import annotations

import sys
from collections.abc import Callable

import pytest

from benchmarks.bench_moments import CLAIMS, PACES, PROGRAMS, Seen, capture, command_of, wrong_frames
from simmer_tui.tui.textual_internals import rows_of
from tests.tui.conftest import Cockpit


def test_frames_of_a_robot_that_moves_and_reads_agree(fly: Callable[..., int | None]) -> None:
    """The events lag behind, since they are history; the last reply is a current value."""

    async def scenario(cockpit: Cockpit) -> None:
        robot = cockpit.client()
        for _ in range(6):
            frames = cockpit.app.frames
            robot.read("c1")
            robot.send("r1-37")
            robot.believe(20.0, 40.0, 0.0)
            robot.read("u1", "c1")
            await cockpit.until(lambda frames=frames: cockpit.app.frames > frames)
            seen = Seen([strip.text for strip in rows_of(cockpit.app.screen_stack[0])])
            assert "-> " in seen.text
            assert {name: claim(seen) for name, claim in CLAIMS.items()} == dict.fromkeys(CLAIMS, "")

    fly(scenario, screen__pace=0)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="ptys are those of POSIX")
@pytest.mark.parametrize("pace", PACES)
@pytest.mark.parametrize("program", PROGRAMS)
def test_frames_on_a_terminal_agree(program: str, pace: str) -> None:
    """Two hundred frames as a terminal gets them, of two sample programs, as fast as they can and at the
    usual pace. A program may end before: as fast as it can, `solve` takes a second or two."""
    size = (120, 36)
    updates = capture(size, command_of(program, pace), frames=260, seconds=120.0)
    frames, wrong, _, examples = wrong_frames(size, updates)
    assert frames >= (5 if program == "solve" else 200)
    assert not wrong, examples[:3]
