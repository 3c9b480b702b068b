"""Snapshots turned into the scenes the maze view draws."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from simmer_tui.run.state import SensorRow, State
from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.sensors import LineSensor, ObservingSensor, View, World, sensor_of
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
    chosen: str = "",
) -> Scene:
    """What the maze view shows of a snapshot. Sensor views are those read since the robot moved,
    while it moves those read before; what the
    `chosen` sensor read stands out."""
    rows = sorted(snapshot.state.sensors.values(), key=lambda row: row.number)
    seen = [(_view(row, maze), row.reading.sensor.code) for row in rows if _is_fresh(row, snapshot.state)]
    views = tuple(SensorView(view, code) for view, code in seen if view is not None)
    believed = snapshot.state.belief
    belief = None
    if believed is not None:
        particles = (
            np.array([particle[:2] for particle in believed.particles]) if believed.particles else None
        )
        belief = Belief(believed.pose, believed.spread, particles)
    block = snapshot.state.block
    plan = snapshot.mission.plan if snapshot.mission is not None else None
    return Scene(
        maze=spec.maze,
        floor=maze.tiles,
        robot=spec.robot,
        pose=snapshot.state.pose,
        block_centre=(block.x, block.y) if block.size else None,
        block_size=block.size,
        block_heading=block.heading,
        block_held=snapshot.state.holding,
        trail=snapshot.state.trail,
        leg_starts=leg_starts(snapshot.state.legs),
        views=views,
        contact=snapshot.state.contact.point if snapshot.state.contact is not None else None,
        in_contact=snapshot.state.touching,
        belief=belief,
        line_age=line_age(snapshot.state),
        loading_zone=tuple((cell.x, cell.y) for cell in plan.loading_zone) if plan is not None else None,
        drop_zone=(plan.drop_zone.x, plan.drop_zone.y) if plan is not None else None,
        show_trail=show_trail,
        show_rays=show_rays,
        show_robot=show_robot,
        chosen=chosen,
    )


def _is_fresh(row: SensorRow, state: State) -> bool:
    """Whether a reading says what the robot sees where it is or, while it moves, where it came from."""
    if row.number > state.moved:
        return True
    if not state.moving or not state.legs:
        return False
    x, y = state.legs[-1][0].tolist()
    return (row.pose.x, row.pose.y) == (x, y)


def _view(row: SensorRow, maze: Maze) -> View | None:
    """What a sensor looked at; a log does not hold it, since it follows from where the robot was."""
    reading = row.reading
    if reading.view is not None:
        return reading.view
    sensor = sensor_of(reading.sensor)
    return (
        sensor.observe(World(maze, row.block), row.pose)[1] if isinstance(sensor, ObservingSensor) else None
    )


def leg_starts(legs: Sequence[FloatArray]) -> tuple[int, ...]:
    """Where in a trail each movement begins."""
    return tuple(accumulate((len(leg) for leg in legs[:-1]), initial=0))


def line_age(state: State) -> float | None:
    """How many simulated seconds ago a line sensor was read; None for not at all."""
    read = [row.time for row in state.sensors.values() if issubclass(row.reading.sensor.kind, LineSensor)]
    return state.time - max(read) if read else None
