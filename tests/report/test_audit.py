"""Sensors and drives against the truth: a fault in a run is named with its figures, and nothing else is."""

from __future__ import annotations

import pytest

from simmer_tui.config.loader import find_set, load
from simmer_tui.report.audit import audit
from simmer_tui.report.finding import Basis, FindingKind
from simmer_tui.sim import SimulationSpec
from tests.report.wandering import wandered


@pytest.fixture(scope="module")
def mission() -> SimulationSpec:
    return load(find_set("mission")).simulation


def test_an_offset_beyond_the_set_is_found_with_its_interval(mission: SimulationSpec) -> None:
    history = wandered(mission, 1, lambda each: each.value + 3.0 * (each.sensor.code == "u1"))
    (found,) = audit(history)
    assert (found.of, found.kind, found.basis) == ("u1", FindingKind.OFFSET, Basis.SET)
    assert found.low < 3.0 < found.high
    interval = f"{found.low:.1f} to {found.high:.1f}, {found.count} readings"
    assert found.text == f"u1 reads {found.value:.1f} in too long ({interval})"


def test_a_gain_beyond_the_set_is_found(mission: SimulationSpec) -> None:
    history = wandered(mission, 2, lambda each: each.value * (0.8 if each.sensor.code == "u3" else 1.0))
    (found,) = audit(history)
    assert (found.of, found.kind) == ("u3", FindingKind.GAIN)
    assert found.low < 0.8 < found.high


@pytest.mark.parametrize("seed", range(5))
def test_a_run_without_a_fault_has_no_findings(mission: SimulationSpec, seed: int) -> None:
    assert audit(wandered(mission, seed)) == ()
