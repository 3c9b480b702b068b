"""Agreement with numbers of the course's original simulator (see golden/README.md)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.sim import (
    Axes,
    Block,
    ContactRule,
    DriveKind,
    Maze,
    Pose,
    RobotSpec,
    SimulationSpec,
    Simulator,
)
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.obstacles import Obstacles
from simmer_tui.sim.sensors import LineSensor, LineSpec, Ultrasonic, UltrasonicSpec, World

Golden = Callable[[str], dict[str, Any]]
CODES = {"up": "w1", "down": "s1", "left": "a1", "right": "d1", "rot": "r1"}
KINDS = {name: DriveKind(name) for name in CODES}


def test_floor_equals_the_original_in_every_tile(course_spec: SimulationSpec, golden: Golden) -> None:
    assert Maze(course_spec.maze).tiles.tolist() == golden("floor")["matrix"]


every = pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.slow)])
"""So many cases are one of those that are compared."""


@every
def test_ultrasonic_ranges_agree(course_spec: SimulationSpec, golden: Golden, every: int) -> None:
    data = golden("ultrasonic")
    maze = Maze(course_spec.maze)
    sensors = [
        Ultrasonic(
            UltrasonicSpec(
                kind=Ultrasonic,
                number=number,
                code=f"u{number}",
                x=row["x"],
                y=row["y"],
                z=row["z"],
                rotation=row["rot"],
                field_of_view=row["fov"],
            )
        )
        for number, row in enumerate(data["sensors"], 1)
    ]
    compared = 0
    for case in data["cases"][::every]:
        world = World(maze, Block(*data["blocks"][case["block"]], data["block_size"]))
        pose = Pose(*case["center"], case["rot"])
        for index, sensor in enumerate(sensors):
            if index in case["unstable"]:
                continue
            true, view = sensor.observe(world, pose)
            if world.maze.is_wall(*view.origin):
                assert true == 0.0  # the original looks through a wall it sits on
                continue
            assert true == pytest.approx(case["range"][index], abs=1e-9), (case, index)
            poses = np.array([(pose.x, pose.y, pose.heading)])
            assert sensor.true_values(world, poses)[0] == pytest.approx(true, abs=1e-9)
            compared += 1
    assert compared > 3000 / every


def test_line_sensors_see_the_same_points_black(course_spec: SimulationSpec, golden: Golden) -> None:
    data = golden("ir")
    world = World(Maze(course_spec.maze), Block(25, 41, 3))

    def black(row: dict[str, Any], pose: Pose) -> int:
        spec = LineSpec(
            kind=LineSensor,
            number=1,
            code="i1",
            x=row["x"],
            y=row["y"],
            z=row["z"],
            field_of_view=row["fov"],
        )
        return int(LineSensor(spec).observe(world, pose)[1].black.sum())

    for case in data["cases"]:
        pose = Pose(*case["center"], case["rot"])
        for index, row in enumerate(data["sensors"]):
            allowed = {case["black"][index], case["tol_black"][index]}
            assert black(row, pose) in allowed, (case, index)
    for case in data["custom"]:
        pose = Pose(*case["center"], case["rot"])
        assert black({"x": 0, "y": 0, **case}, pose) == case["black"], case


def test_overlap_agrees_in_every_shape(course_spec: SimulationSpec, golden: Golden) -> None:
    obstacles = Obstacles.of_maze(Maze(course_spec.maze).walls)
    robots = {
        "circle_d6": RobotSpec.circle(6),
        "circle_d8": RobotSpec.circle(8),
        "rect_6x6": RobotSpec.rectangle(6, 6),
        "rect_8x4": RobotSpec.rectangle(8, 4),
    }
    for name, shape in golden("collision")["shapes"].items():
        footprint = Footprint.of(robots[name])
        differing = [
            case for case in shape["cases"] if obstacles.overlap(footprint, Pose(*case[:3])) != bool(case[3])
        ]
        assert len(differing) <= (1 if "circle" in name else 0), (name, differing)


def prepared(spec: SimulationSpec, bias: Any, segments: int, start: Any, begin: float) -> Simulator:
    simulator = Simulator(
        replace(spec, num_segments=segments, bot_center=(start[0], start[1]), bot_rot=start[2])
    )
    simulator.set_bias({kind: Axes(*row) for kind, row in zip(KINDS.values(), bias, strict=True)})
    simulator.advance(begin)
    return simulator


at_any_time = pytest.mark.parametrize(
    "begin",
    [0.0, 1e6 / 3, *(pytest.param(begin, marks=pytest.mark.slow) for begin in (0.1, 1000.3, 86399.7))],
)


@at_any_time
@every
def test_free_motion_agrees_segment_by_segment(
    course_spec: SimulationSpec, golden: Golden, begin: float, every: int
) -> None:
    data = golden("motion")
    for case in data["cases"][::every]:
        simulator = prepared(course_spec, data["biases"][case["bias"]], case["n"], case["start"], begin)
        outcome = simulator.execute(f"{CODES[case['cmd']]}-{case['value']!r}")
        trajectory = outcome.trajectory
        assert trajectory is not None
        assert trajectory.contact is None
        path = trajectory.path
        np.testing.assert_allclose(path.points[1:, 0], case["x"], rtol=0, atol=1e-9)
        np.testing.assert_allclose(path.points[1:, 1], case["y"], rtol=0, atol=1e-9)
        np.testing.assert_allclose(
            path.headings_after(np.arange(1, case["n"] + 1)), case["rot"], rtol=0, atol=1e-9
        )
        final = (outcome.pose.x, outcome.pose.y, outcome.pose.heading)
        np.testing.assert_allclose(final, case["final"], rtol=0, atol=1e-9)
        assert simulator.pose == outcome.pose
        counted = [simulator.execute(code).reply for code in ("o1", "o2", "o3", "o4", "g1", "c1")]
        np.testing.assert_allclose(
            counted, [*case["odom"], case["gyro"], case["final"][2]], rtol=0, atol=1e-9
        )


@at_any_time
def test_odometers_and_gyro_keep_counting_over_commands(
    course_spec: SimulationSpec, golden: Golden, begin: float
) -> None:
    data = golden("motion")
    for sequence in data["sequences"]:
        simulator = prepared(
            course_spec,
            data["biases"][sequence["bias"]],
            sequence.get("n", 10),
            sequence["start"],
            begin,
        )
        for step in sequence["steps"]:
            if step["hits"]:
                break
            simulator.execute(f"{CODES[step['cmd']]}-{step['value']!r}")
            pose = simulator.pose
            np.testing.assert_allclose((pose.x, pose.y, pose.heading), step["pose"], rtol=0, atol=1e-9)
            counted = [simulator.execute(code).reply for code in ("o1", "o2", "o3", "o4", "g1")]
            np.testing.assert_allclose(counted, [*step["odom"], step["gyro"]], rtol=0, atol=1e-9)


@every
def test_contacts_are_where_the_original_finds_them_with_fine_segments(
    course_spec: SimulationSpec, golden: Golden, every: int
) -> None:
    data = golden("stop")
    robots = {"c6": RobotSpec.circle(6), "r66": RobotSpec.rectangle(6, 6), "r84": RobotSpec.rectangle(8, 4)}
    for case in data["cases"][::every]:
        spec = replace(
            course_spec,
            robot=robots[case["shape"]],
            num_segments=10000,
            bot_center=tuple(case["start"][:2]),
            bot_rot=case["start"][2],
            contact=ContactRule.STOP,
        )
        simulator = Simulator(spec)
        simulator.set_bias({KINDS[case["cmd"]]: Axes(*case["bias"])})
        outcome = simulator.execute(f"{CODES[case['cmd']]}-{case['value']!r}")
        fine = case["n10000"]
        assert (outcome.contact is not None) == (fine["first_hit"] > 0), case["k"]
        tolerance = 1e-4 * abs(case["value"]) + 0.02
        x, y, heading = fine["pose"]
        assert math.hypot(outcome.pose.x - x, outcome.pose.y - y) <= tolerance, case["k"]
        assert outcome.pose.heading == pytest.approx(heading, abs=0.05), case["k"]
        counted = [simulator.execute(code).reply for code in ("o1", "o2", "o3", "o4")]
        np.testing.assert_allclose(counted, fine["odom"], rtol=0, atol=1e-9)
        assert simulator.execute("g1").reply == pytest.approx(fine["gyro"], abs=0.05)
        if case["coarse_skips_contact"]:
            coarse = Simulator(replace(spec, num_segments=10))
            coarse.set_bias({KINDS[case["cmd"]]: Axes(*case["bias"])})
            assert coarse.execute(f"{CODES[case['cmd']]}-{case['value']!r}").contact is not None, case["k"]
