"""The rays of a scan in the maze's frame."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.config import load_default
from simmer_tui.sim import Pose, Simulator, parse_command
from simmer_tui.sim.records import LidarScan
from simmer_tui.sim.scan_rays import extremes, rays_of
from simmer_tui.sim.sensors import Lidar, LidarSpec

LIDAR = LidarSpec(
    kind=Lidar, number=1, code="sc", x=1.5, y=-0.7, z=4.0, rotation=20.0, resolution=0.0, dropout=0.0
)


def scan_of(*commands: str, **changes: Any) -> LidarScan:
    spec = load_default().simulation
    simulator = Simulator(replace(spec, sensors=(*spec.sensors, replace(LIDAR, **changes))), 5)
    result = None
    for command in commands:
        result = simulator.execute(parse_command(command))
    assert result is not None
    assert result.reading is not None
    assert result.reading.scan is not None
    return result.reading.scan


@pytest.mark.parametrize("commands", [("sc",), ("r1-170", "sc"), ("d1-9", "r1--40", "sc")])
def test_a_beam_of_an_exact_lidar_ends_on_a_wall(commands: tuple[str, ...]) -> None:
    """Also where the robot turned as the head did: each ray has its own pose."""
    scan = scan_of(*commands, error=0.0, min_range=0.0)
    rays = rays_of(scan, LIDAR, Pose(-1000.0, 0.0, 0.0))
    spec = load_default().simulation.maze
    assert len(rays.ends) == 360
    # Walls stand on a grid of a foot; one of the two coordinates of every end lies on it. The block is lower.
    off = np.abs(rays.ends / 12.0 - np.rint(rays.ends / 12.0)) * 12.0
    assert off.min(axis=1).max() < 1e-6
    assert (rays.ends > -1e-6).all()
    assert (rays.ends < np.array((spec.width, spec.height)) + 1e-6).all()


def test_rays_without_an_echo_end_nowhere() -> None:
    scan = scan_of("sc", max_range=20.0)
    rays = rays_of(scan, LIDAR, Pose(0.0, 0.0, 0.0))
    found = extremes(scan)
    assert 0 < len(rays.ranges) == 360 - found.missed < 360
    assert found.nearest is not None
    assert found.farthest is not None
    assert found.nearest[0] == rays.ranges.min() < rays.ranges.max() == found.farthest[0] <= 20.0
    zeros = scan_of("sc", max_range=20.0, missed_as_zero=True)
    assert extremes(zeros) == found


def test_where_no_pose_is_known_all_are_sent_from_where_it_was_read() -> None:
    scan = LidarScan(7, np.array([3.0, math.inf, 4.0, 5.0]), np.arange(0.0, -360.0, -90.0), *_NOTHING)
    sensor = replace(LIDAR, x=1.0, y=0.0)
    rays = rays_of(scan, sensor, Pose(10.0, 20.0, 90.0))
    assert rays.ends.round(6).tolist() == [[10.0, 24.0], [10.0, 17.0], [5.0, 21.0]]
    assert extremes(scan).nearest == (3.0, 0.0)


def test_nothing_all_around_has_no_nearest() -> None:
    scan = LidarScan(7, np.full(3, math.inf), np.zeros(3), *_NOTHING)
    found = extremes(scan)
    assert (found.nearest, found.farthest, found.missed) == (None, None, 3)
    assert rays_of(scan, LIDAR, Pose(0.0, 0.0, 0.0)).ends.shape == (0, 2)


_NOTHING = np.empty(0), np.empty((0, 3))
