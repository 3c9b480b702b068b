"""Places that a program's sensors cannot tell apart."""

import numpy as np

from simmer_tui.run.attempt import Attempt
from simmer_tui.run.facts import wrapped
from simmer_tui.run.history_rows import BeliefRow
from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.sensors import ObservingSensor, modelled_sensor
from simmer_tui.sim.sensors.base import World
from simmer_tui.sim.specs import CELL_SIZE

# Of a normal distribution 99.7 % lie within three standard deviations.
_SIGMAS = 3.0
_SLIGHT = 1.0
"""Difference of two readings, inches, that tells no cell from another. Judged: a twelfth of a cell."""
_FEWEST = 2
"""Sensors that must agree: one alone sees the same in most corridors."""
_STEP = 1.0
"""Inches between the places tried in the believed cell."""


def looks_alike(seen: Attempt, belief: BeliefRow) -> bool:
    """True if every range sensor that was read would read the same, within its noise, at one place of the
    cell that a grid held for the likeliest as it does where the robot was."""
    read = set(seen.history.sensor_codes)
    sensors = [
        modelled_sensor(each) for each in seen.spec.sensors if each.code in read and each.kind.is_range
    ]
    if len(sensors) < _FEWEST:
        return False
    world = World(Maze(seen.spec.maze), Block(0.0, 0.0, 0.0), False)
    true = np.array([[belief.true_x, belief.true_y, belief.true_heading]])
    poses = _around(belief)
    alike = np.ones(len(poses), dtype=np.bool_)
    for sensor in sensors:
        if not isinstance(sensor, ObservingSensor):
            continue
        here, there = sensor.true_values(world, true)[0], sensor.true_values(world, poses)
        noise = _SIGMAS * (sensor.spec.error * here + sensor.spec.absolute_error)
        # Nothing in range on both sides is alike too; infinity less infinity is no number.
        with np.errstate(invalid="ignore"):
            alike &= (here == there) | (np.abs(here - there) <= max(_SLIGHT, noise))
    return bool(alike.any())


def _around(belief: BeliefRow) -> FloatArray:
    """Poses in the believed cell, (n, 3). The heading is as far from one of the maze's directions as the true
    one; a grid without headings allows for all four."""
    reach = min(belief.allowed, CELL_SIZE / 2)
    steps = np.arange(-reach, reach + _STEP / 2, _STEP)
    beside = wrapped((belief.true_heading - belief.heading) * 4.0) / 4.0
    turns = [0.0] if belief.tells_heading else [0.0, 90.0, 180.0, 270.0]
    x, y, turn = np.meshgrid(belief.x + steps, belief.y + steps, belief.heading + beside + np.array(turns))
    return np.column_stack((x.ravel(), y.ravel(), turn.ravel()))
