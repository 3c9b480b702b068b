"""Effects of the world on readings that depend on time or motion, for lidars as for all other sensors.

The true value of a reading follows from the world and the robot's pose. An effect here changes it, by the
moment and the robot's speed, before the sensor's own errors. The reading keeps its true value. An effect that
depends on neither changes the sensors' rows instead (`simulation_of` of `config/loader.py`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.recent_motion import Now, RecentMotion
from simmer_tui.sim.specs import SensorSpec, SimulationSpec

# Short beside the time constant of any drive, and long beside the rounding of simulated time.
_STEP = 0.001
"""Seconds over which a speed is taken."""


class Moments(Struct, frozen=True):
    """The moments of n values: simulated `times`, (n,), seconds; the robot's `poses`, (n, 3), x, y and
    heading; the `speeds` of its centre, (n,), inches a second."""

    times: FloatArray
    poses: FloatArray
    speeds: FloatArray


ReadingEffect = Callable[[SensorSpec, FloatArray, Moments], FloatArray]
"""Values that a sensor senses for true ones, (n,), at n moments: the same array if it is not concerned."""
EFFECTS: tuple[Callable[[SimulationSpec], ReadingEffect | None], ...] = ()
"""Effects in their order: each is made for a run, or is None where the set does not have it."""


class ReadingEffects:
    """The effects on the readings of one run."""

    def __init__(self, effects: tuple[ReadingEffect, ...], recent: RecentMotion) -> None:
        self._effects = effects
        self._recent = recent

    def changed(self, sensor: SensorSpec, true: FloatArray, times: FloatArray, now: Now) -> FloatArray:
        """Values that a sensor senses for true ones, (n,), at n ascending simulated times up to `now`."""
        poses = self._recent.poses(times, now.pose, now.under_way)
        before = self._recent.poses(times - _STEP, now.pose, now.under_way)
        moments = Moments(times, poses, np.hypot(*(poses - before)[:, :2].T) / _STEP)
        for effect in self._effects:
            true = effect(sensor, true, moments)
        return true


def effects_of(spec: SimulationSpec, recent: RecentMotion) -> ReadingEffects | None:
    """The effects of a run; None without any, so that they cost nothing."""
    effects = tuple(effect for make in EFFECTS if (effect := make(spec)) is not None)
    return ReadingEffects(effects, recent) if effects else None
