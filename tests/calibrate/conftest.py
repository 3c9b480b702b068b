"""A robot whose parameters are hidden, driven through the real bridge, and logged."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from benchmarks.emulated_robots import draw_robot, placed, record, set_with, wandering
from simmer_tui.calibrate.fit import Fit, fit
from simmer_tui.calibrate.measured_run import read_runs
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.sim.specs import SimulationSpec

CODES = ("u1", "u2", "u3", "u4", "c1", "o1", "o2", "o3", "o4", "g1")


@dataclass(frozen=True)
class Logged:
    """A log, and what nobody who reads it knows."""

    path: Path
    configured: SimulationSpec
    hidden: SimulationSpec


def drive(folder: Path, seed: int, movements: int, name: str = "robot.jsonl") -> Logged:
    """Log a drawn robot."""
    random = np.random.default_rng(seed)
    configured, hidden = placed(load(bundled_folder()).simulation, random)
    hidden = draw_robot(random, hidden)
    path = folder / name
    record(path, set_with(configured), hidden, seed, wandering(movements, seed, CODES), latency=0.02)
    return Logged(path, configured, hidden)


@pytest.fixture(scope="session")
def logged(tmp_path_factory: pytest.TempPathFactory) -> Logged:
    """A robot's log of 50 movements."""
    return drive(tmp_path_factory.mktemp("logs"), 3, 50)


@pytest.fixture(scope="session")
def found(logged: Logged) -> Fit:
    """Its reading."""
    return fit(read_runs([logged.path]))
