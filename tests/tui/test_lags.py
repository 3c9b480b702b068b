"""Parts of the screen that may lag: whose turn it is, and when all have had theirs."""

from __future__ import annotations

from dataclasses import replace

import pytest
from msgspec.structs import replace as changed

from simmer_tui.live.snapshot import Recorder, Snapshot
from simmer_tui.robot.engine import Engine
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import checkpoint_of
from simmer_tui.sim import Pose, SimulationSpec, Simulator
from simmer_tui.tui.frame_pace import Lags

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
