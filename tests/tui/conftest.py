"""A sample scene for everything that draws."""

from __future__ import annotations

import numpy as np
import pytest

from simmer_tui.sim.records import FloorPatch, Pose, RayFan
from simmer_tui.sim.specs import MazeSpec, RobotSpec, SensorKind
from simmer_tui.tui.scene import Belief, Scene, SensorView


@pytest.fixture(scope="session")
def plain_scene() -> Scene:
    """Two by three cells with one wall on a floor of alternating tiles, and a round robot."""
    maze = MazeSpec(((1, 1, 0), (1, 1, 1)))
    floor = (np.indices((8, 12)).sum(axis=0) % 2).astype(np.uint8)
    return Scene(maze=maze, floor=floor, robot=RobotSpec.circle(6), pose=Pose(9.0, 9.0, 0.0))


@pytest.fixture(scope="session")
def full_scene(plain_scene: Scene) -> Scene:
    """The same with everything a scene can hold."""
    grid = np.array([(i, j) for i in range(-6, 7) for j in range(-6, 7) if i * i + j * j <= 36])
    points = np.array((20.0, 6.0)) + grid / 6 * 2.0
    return Scene(
        maze=plain_scene.maze,
        floor=plain_scene.floor,
        robot=plain_scene.robot,
        pose=plain_scene.pose,
        block_centre=(30.0, 6.0),
        block_heading=20.0,
        trail=np.array([(4.0, 4.0), (6.0, 6.0), (9.0, 9.0)]),
        views=(
            SensorView(SensorKind.ULTRA, RayFan((12.0, 9.0), (-5.0, 0.0, 5.0), (24.0, 23.0, float("inf")))),
            SensorView(SensorKind.IR, FloorPatch((20.0, 6.0), 2.0, points, points[:, 0] > 20)),
        ),
        contact=(9.0, 12.0),
        in_contact=True,
        belief=Belief(Pose(16.0, 16.0, 90.0), 4.0, np.array([(15.0, 15.0), (17.0, 18.0)])),
    )
