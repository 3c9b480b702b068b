"""Checks whether robot and block may be placed somewhere."""

from __future__ import annotations

import math

from simmer_tui.sim.block import Block
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.obstacles import Obstacles
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import CELL_SIZE, SimulationSpec


def robot_problem(maze: Maze, obstacles: Obstacles, footprint: Footprint, pose: Pose) -> str:
    """Why the robot cannot stand at a pose, or an empty string."""
    if not all(math.isfinite(value) for value in (pose.x, pose.y, pose.heading)):
        return "x, y and heading must be finite numbers"
    if not (0 <= pose.x <= maze.width and 0 <= pose.y <= maze.height):
        return f"({pose.x:g}, {pose.y:g}) lies outside the maze, {_extent(maze)}"
    if not obstacles.overlap(footprint, pose):
        return ""
    x, y = obstacles.nearest_point(footprint, pose)
    return (
        f"the robot at ({pose.x:g}, {pose.y:g}) heading {pose.heading:g} overlaps a wall or solid block near "
        f"({x:g}, {y:g}); {_free_places(maze, footprint)}"
    )


def block_problem(maze: Maze, obstacles: Obstacles, block: Block) -> str:
    """Why the block cannot stand where it is, or an empty string. `obstacles` are the walls.
    Where there is none, it is nowhere in the way."""
    if not block.size:
        return ""
    if not (math.isfinite(block.x) and math.isfinite(block.y)):
        return "x and y must be finite numbers"
    if not (0 <= block.x <= maze.width and 0 <= block.y <= maze.height):
        return f"({block.x:g}, {block.y:g}) lies outside the maze, {_extent(maze)}"
    if not obstacles.overlap(Footprint(polygons=(block.corners(),)), Pose(0.0, 0.0, 0.0)):
        return ""
    return f"the block of {block.size:g} in at ({block.x:g}, {block.y:g}) overlaps a wall"


def placement_problems(spec: SimulationSpec) -> list[tuple[str, str]]:
    """Problems of the start pose and the block of a configuration: pairs of the setting's
    name and the reason. Empty when all is well."""
    maze = Maze(spec.maze)
    walls = Obstacles.of_maze(maze.walls)
    block = Block(*spec.block_center, spec.block_size)
    problems = []
    wrong_block = block_problem(maze, walls, block)
    if wrong_block:
        problems.append(("block_center", wrong_block))
    obstacles = walls.with_block(block) if spec.block_solid and block.size and not wrong_block else walls
    pose = Pose(*spec.bot_center, spec.bot_rot)
    wrong_pose = robot_problem(maze, obstacles, Footprint.of(spec.robot), pose)
    if wrong_pose:
        problems.append(("bot_center", wrong_pose))
    return problems


def _extent(maze: Maze) -> str:
    return f"which reaches from (0, 0) to ({maze.width:g}, {maze.height:g})"


def _free_places(maze: Maze, footprint: Footprint) -> str:
    """The middle of a free cell, as advice."""
    free = [
        ((column - 0.5) * CELL_SIZE, (row - 0.5) * CELL_SIZE)
        for row, column in zip(*(~maze.walls).nonzero(), strict=True)
    ]
    if not free or footprint.reach > CELL_SIZE / 2:
        return "it must stand clear of walls"
    x, y = free[0]
    return f"it must stand clear of walls, as in the middle of a free cell, ({x:g}, {y:g})"
