"""Parts of the screen that may lag: whose turn it is, and when all have had theirs."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from msgspec.structs import replace as changed

from simmer_tui.live.snapshot import Recorder, Snapshot
from simmer_tui.robot.engine import Engine
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import checkpoint_of
from simmer_tui.sim import Pose, SimulationSpec, Simulator
from simmer_tui.tui import shell
from simmer_tui.tui.frame_pace import QUIET, Lags

PARTS = {"events", "values", "radar"}


@pytest.fixture
def snapshot(course_spec: SimulationSpec) -> Snapshot:
    engine = Engine(Simulator(course_spec, 5))
    return Recorder(engine, Reducer(checkpoint_of(engine.simulator))).snapshot(0, False)


def all_shown(lags: Lags) -> bool:
    """True if each part has its turn now."""
    return {part for part in PARTS if lags.is_due(part)} == PARTS


def test_nothing_waits_while_nothing_happens(snapshot: Snapshot) -> None:
    """Parts have turns of different lengths: if each turn made all of them wait again, the screen of a robot
    at rest would be drawn over and over until all turns happen to come together."""
    lags = Lags()
    lags.take(snapshot, None)
    assert lags.waiting == PARTS
    assert all_shown(lags)
    lags.take(replace(snapshot, rate=1.0), snapshot)
    assert not lags.waiting


def test_what_happens_makes_all_parts_wait(snapshot: Snapshot) -> None:
    aside = changed(snapshot.state, pose=Pose(9.0, 42.0, 1.0))
    for news in (
        replace(snapshot, number=snapshot.number + 1),
        replace(snapshot, is_full=True),
        replace(snapshot, state=aside),
    ):
        lags = Lags()
        lags.take(snapshot, None)
        assert all_shown(lags)
        lags.take(news, snapshot)
        assert lags.waiting == PARTS
        assert not all_shown(lags)


@pytest.mark.parametrize(
    ("has_news", "idle", "waits", "passed", "due"),
    [
        (True, True, False, 0.0, True),
        (False, True, False, 9.0, False),
        (False, True, True, QUIET, True),
        (False, False, False, QUIET, True),
        (False, False, True, 0.9 * QUIET, False),
    ],
)
def test_without_an_event_the_screen_is_drawn_less_often(
    has_news: bool, idle: bool, waits: bool, passed: float, due: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between two commands of a program, each tick drew the whole screen once more."""
    monkeypatch.setattr(shell, "time", SimpleNamespace(monotonic=lambda: 5.0 + passed))
    app: Any = SimpleNamespace(
        source=SimpleNamespace(has_news=lambda known: has_news),
        _known=7,
        _idle=idle,
        _shown_at=5.0,
        _panes=SimpleNamespace(has_unshown=waits),
    )
    assert shell.Shell._is_due(app) is due


def test_between_two_commands_of_a_program_the_robot_does_not_come_to_stand(snapshot: Snapshot) -> None:
    """All parts were due in every picture that came between a movement and the reading after it."""
    lags = Lags()
    lags.take(snapshot, None)
    assert all_shown(lags)
    turned = replace(
        snapshot, number=snapshot.number + 2, state=changed(snapshot.state, pose=Pose(9.0, 42.0, 7.0))
    )
    lags.take(turned, snapshot)
    has_read = replace(turned, number=turned.number + 1)
    lags.take(has_read, turned)
    assert not all_shown(lags)
    lags.take(has_read, has_read)
    assert all_shown(lags)
