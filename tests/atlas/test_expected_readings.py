"""The atlas is what the simulator says, and every mistake in asking for one is told."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui import load
from simmer_tui.atlas.expected_readings import Atlas, PoseGrid, atlas_codes, compute_atlas
from simmer_tui.config.loader import load as load_set
from simmer_tui.config.sets import find_set
from simmer_tui.config.settings_file import Override
from simmer_tui.errors import AtlasError, PlacementError, UnknownSensorError
from simmer_tui.sim import Pose, Simulator
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.specs import MazeSpec

SETS = ("default", "mission", "simmer-python")


@cache
def robot_of(name: str) -> Simulator:
    """Simulators without noise: a disc, one with a solid block and the errors of real sensors, a polygon."""
    overrides = {"sensor_profile": Override("--sensor-profile", "hc-sr04,vl53l0x")}
    configuration = load_set(find_set(name), overrides if name == "mission" else {})
    simulator = Simulator(configuration.simulation)
    simulator.noise = False
    return simulator


@cache
def atlas_of(name: str, step: float, headings: int) -> Atlas:
    simulator = robot_of(name)
    codes = ("u1", "c1", "i2", "t1") if name == "default" else atlas_codes(simulator)
    simulator.reset()
    return compute_atlas(simulator, PoseGrid.over(simulator.maze, step, headings), codes)


@given(st.sampled_from(SETS), st.sampled_from(((6.0, 12), (4.0, 3), (12.0, 4), (2.4, 1))), st.data())
@settings(max_examples=40, deadline=None)
def test_every_reading_is_the_simulators_without_noise(
    name: str, size: tuple[float, int], data: st.DataObject
) -> None:
    atlas, simulator = atlas_of(name, *size), robot_of(name)
    grid = atlas.grid
    row, column, heading = (
        data.draw(st.integers(0, count - 1)) for count in (grid.rows, grid.columns, grid.headings)
    )
    pose = Pose(float(grid.x[column]), float(grid.y[row]), float(grid.heading[heading]))
    simulator.reset()
    try:
        simulator.teleport(pose)
    except PlacementError:
        assert not atlas.free[row, column, heading]
        if simulator.maze.is_wall(pose.x, pose.y):
            assert not atlas.ranges[row, column, heading].any()
        return
    assert atlas.free[row, column, heading]
    for code, found in zip(atlas.codes, atlas.ranges[row, column, heading], strict=True):
        simulator.reset()  # a reading takes its time, in which others drift
        simulator.teleport(pose)
        assert found == np.float32(simulator.execute(code).reply)


def test_row_1_is_on_top_and_headings_go_counter_clockwise() -> None:
    grid = PoseGrid.over(Maze(MazeSpec(((1, 1), (1, 1), (1, 1)))), 6.0, 4)
    assert (grid.rows, grid.columns, grid.headings, grid.poses) == (6, 4, 4, 96)
    assert grid.x.tolist() == [3.0, 9.0, 15.0, 21.0]
    assert grid.y.tolist() == [33.0, 27.0, 21.0, 15.0, 9.0, 3.0]
    assert grid.heading.tolist() == [0.0, 90.0, 180.0, 270.0]
    assert grid.row(0)[:5].tolist() == [[3, 33, 0], [3, 33, 90], [3, 33, 180], [3, 33, 270], [9, 33, 0]]


def test_the_block_counts_where_it_is() -> None:
    spec = replace(load().simulation, block_center=(40.0, 42.0), block_size=3.0)
    grid = PoseGrid.over(Maze(spec.maze), 12.0, 1)
    with_block = compute_atlas(Simulator(spec), grid, ("u5",))
    without = compute_atlas(Simulator(replace(spec, block_size=0.0)), grid, ("u5",))
    assert with_block.ranges[0, 2, 0, 0] == 5.5
    assert without.ranges[0, 2, 0, 0] == 15.0
    assert with_block.free.all(where=without.free), "a block that is not solid is not in the way"
    solid = compute_atlas(Simulator(replace(spec, block_solid=True)), grid, ("u5",))
    assert np.argwhere(solid.free != without.free).tolist() == [[0, 3, 0]]


def test_progress_is_told_row_by_row() -> None:
    simulator, told = robot_of("default"), list[int]()
    compute_atlas(simulator, PoseGrid.over(simulator.maze, 12.0, 1), ["u1"], told.append)
    assert told == [1, 2, 3, 4]


@pytest.mark.parametrize(
    ("step", "said"),
    [
        (5.0, "cells of 5 in do not fill a cell of the maze, 12 in: --step 4 or 6 does"),
        (7.5, "--step 6 or 12 does"),
    ],
)
def test_a_grid_that_does_not_fit_is_refused(step: float, said: str) -> None:
    with pytest.raises(AtlasError, match=said):
        PoseGrid.over(robot_of("default").maze, step, 8)


def test_a_tenth_of_an_inch_fits_although_it_is_rounded() -> None:
    grid = PoseGrid.over(robot_of("default").maze, 0.1, 1)
    assert (grid.rows, grid.columns) == (480, 960)


def test_sensors_that_have_no_place_in_an_atlas_are_refused() -> None:
    simulator = robot_of("default")
    assert atlas_codes(simulator) == ("u1", "u2", "u3", "u4", "u5", "t1")
    assert atlas_codes(simulator, ["c1", "u1"]) == ("c1", "u1")
    with pytest.raises(UnknownSensorError, match="no sensor has the code 'zz'; there are u1, "):
        atlas_codes(simulator, ["u1", "zz"])
    with pytest.raises(AtlasError, match=r"o1 \(wheel encoder\) counts motion: no reading of it belongs"):
        atlas_codes(simulator, ["o1"])
    with pytest.raises(AtlasError, match="u1 is named twice"):
        atlas_codes(simulator, ["u1", "u2", "u1"])
    spec = simulator.spec
    off = replace(spec, sensors=tuple(replace(sensor, enabled=False) for sensor in spec.sensors))
    with pytest.raises(AtlasError, match=r"u1 is disabled in sensors\.csv"):
        atlas_codes(Simulator(off), ["u1"])
    with pytest.raises(AtlasError, match="no enabled range sensor: name others with --sensors"):
        atlas_codes(Simulator(off))
