"""Snapshots turned into the scenes the maze view draws."""

from __future__ import annotations

import numpy as np

from simmer_tui.sim.maze import Maze
from simmer_tui.sim.specs import SimulationSpec
from simmer_tui.snapshot import Snapshot
from simmer_tui.tui.maze.scene import Belief, Scene, SensorView


def scene_of(
    spec: SimulationSpec,
    maze: Maze,
    snapshot: Snapshot,
    *,
    show_robot: bool = True,
    show_rays: bool = True,
    show_trail: bool = True,
) -> Scene:
    """What the maze view shows of a snapshot. Sensor views are those read since the robot moved."""
    views = tuple(
        SensorView(row.reading.view, row.reading.sensor.code)
        for row in sorted(snapshot.sensors.values(), key=lambda row: row.number)
        if row.reading.view is not None and row.number > snapshot.moved
    )
    believed = snapshot.belief
    belief = None
    if believed is not None:
        particles = (
            np.array([particle[:2] for particle in believed.particles]) if believed.particles else None
        )
        belief = Belief(believed.pose, believed.spread, particles)
    block = snapshot.block
    plan = snapshot.mission.plan if snapshot.mission is not None else None
    return Scene(
        maze=spec.maze,
        floor=maze.tiles,
        robot=spec.robot,
        pose=snapshot.pose,
        block_centre=(block.x, block.y),
        block_size=block.size,
        block_heading=block.heading,
        block_held=snapshot.holding,
        trail=snapshot.trail,
        leg_starts=snapshot.leg_starts,
        views=views,
        contact=snapshot.contact.point if snapshot.contact is not None else None,
        in_contact=snapshot.touching,
        belief=belief,
        line_age=snapshot.line_age,
        loading_zone=tuple((cell.x, cell.y) for cell in plan.loading_zone) if plan is not None else None,
        drop_zone=(plan.drop_zone.x, plan.drop_zone.y) if plan is not None else None,
        show_trail=show_trail,
        show_rays=show_rays,
        show_robot=show_robot,
    )
