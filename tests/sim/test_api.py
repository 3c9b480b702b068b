"""`simmer_tui.sim` as someone in a notebook uses it."""

from __future__ import annotations

import contextlib
import copy
import inspect
import math
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

import simmer_tui.sim as api
from simmer_tui.config import load_default
from simmer_tui.errors import PlacementError, SimmerError, UnknownSensorError, printable
from simmer_tui.sim import (
    Axes,
    DriveKind,
    DriveSpec,
    MazeSpec,
    Pose,
    RangeScan,
    RobotSpec,
    SimulationSpec,
    Simulator,
    Status,
    parse_command,
)
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.sensors import Ultrasonic, UltrasonicSpec


def test_the_example_in_the_documentation_runs() -> None:
    assert api.__doc__ is not None
    code = [line[4:] for line in api.__doc__.splitlines() if line.startswith("    ")]
    assert len(code) >= 5
    names: dict[str, object] = {}
    exec("\n".join(code), names)
    simulator = names["simulator"]
    assert isinstance(simulator, Simulator)
    assert simulator.pose.x > 11.0


def test_every_public_name_exists_and_is_described() -> None:
    names = [name for name in vars(api) if not name.startswith("_")]
    assert {"Simulator", "parse_command", "sensor_kinds"} <= set(names)
    for name in names:
        assert inspect.getdoc(getattr(api, name)), name


def test_a_world_is_made_without_any_file() -> None:
    spec = SimulationSpec(
        maze=MazeSpec(((1, 1, 1),)),
        robot=RobotSpec.circle(6),
        sensors=(UltrasonicSpec(kind=Ultrasonic, number=1, code="u1", x=3.0),),
        drives=(DriveSpec(kind=DriveKind.RIGHT, code="d1"),),
        bot_center=(6.0, 6.0),
        block_center=(18.0, 6.0),
        randbias=False,
    )
    simulator = Simulator(spec)
    assert simulator.execute("d1-6").status is Status.DONE
    assert simulator.pose == Pose(12.0, 6.0, 0.0)
    assert simulator.execute(parse_command("u1")).reply == pytest.approx(1.5), "low enough to see the block"


def test_all_the_data_of_an_outcome_is_readable(course_spec: SimulationSpec) -> None:
    simulator = Simulator(course_spec)
    moved = simulator.execute("w1-6")
    assert (moved.number, moved.before, moved.pose) == (1, Pose(9.5, 42.0, 0.0), simulator.pose)
    assert moved.time == simulator.time == pytest.approx(1.0)
    assert moved.trajectory is not None
    assert moved.trajectory.trail(moved.time)[-1] == pytest.approx((9.5, 45.0))
    assert moved.contact is not None
    assert moved.contact.point == pytest.approx((9.5, 48.0), abs=1e-6)
    read = simulator.execute("u3")
    assert read.reading is not None
    assert read.reply == read.reading.value == read.reading.true == pytest.approx(6.5)
    assert isinstance(read.reading.view, RangeScan)
    assert read.reading.view.origin == pytest.approx((6.5, 45.0))
    assert len(read.reading.view.distances) == 5
    assert (simulator.commands, simulator.contacts, simulator.moving) == (2, 1, False)
    assert simulator.distance == pytest.approx(3.0)
    with pytest.raises(AttributeError):
        moved.pose = Pose(0, 0, 0)  # type: ignore[misc]


def test_a_refusal_says_why_and_does_nothing(course_spec: SimulationSpec) -> None:
    simulator = Simulator(course_spec)
    for text, part in (
        ("", "empty"),
        ("u", "two characters"),
        ("z9", "no sensor or drive"),
        ("u9", "did you mean u1 or u2 or u3 or u4 or u5?"),
        ("U1", "did you mean u1?"),
        ("1d", "did you mean d1?"),
        ("forward 3", "the code fo; did you mean d1-3?"),
        ("turn 45", "the code tu; did you mean r1-45?"),
        ("right", "did you mean r1--90?"),
        (f"forward {'9' * 400}", "did you mean d1-3?"),
        ("d1", "missing"),
        ("d1-", "missing"),
        ("d1-abc", "'abc' is not"),
        ("d1-2,5", "'2,5' is not"),
        ("d1-nan", "'nan' is not"),
        ("d1-inf", "'inf' is not"),
        ("d1-1_0", "'1_0' is not"),
        ("d1-1e400", "beyond the limit"),
        ("d1-1000001", "beyond the limit"),
    ):
        outcome = simulator.execute(text)
        assert math.isnan(outcome.reply), text
        assert part in outcome.reason, text
        assert outcome.pose == Pose(9.5, 42.0, 0.0)
    assert simulator.time == 0.0


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("d1-0.52", 0.52),
        ("d1--3.3826", -3.3826),
        ("d1-1e-05", 1e-5),
        ("d1-+2", 2.0),
        ("d1-.5", 0.5),
        ("d1-2.", 2),
    ],
)
def test_values_as_matlab_writes_them(course_spec: SimulationSpec, text: str, value: float) -> None:
    simulator = Simulator(course_spec)
    assert simulator.execute(text).reply == math.inf
    assert simulator.pose.x == pytest.approx(9.5 + value)


def test_gain_counts_for_the_limit_and_the_way(course_spec: SimulationSpec) -> None:
    drives = tuple(replace(drive, gain=-2.0) for drive in course_spec.drives)
    simulator = Simulator(replace(course_spec, drives=drives))
    assert "beyond the limit" in simulator.execute("d1-500001").reason
    simulator.execute("d1--2")
    assert simulator.pose.x == pytest.approx(13.5)
    assert simulator.time == pytest.approx(4.0 / 6.0)


def test_what_follows_a_sensors_code_is_ignored(course_spec: SimulationSpec) -> None:
    simulator = Simulator(course_spec)
    assert {simulator.execute(text).reply for text in ("u1", "u1-3", "u1garbage", "u1-nan", " u1 ")} == {
        simulator.true_value("u1")
    }


# -- motion in pieces ------------------------------------------------------------------------


def test_a_movement_goes_on_as_time_advances(course_spec: SimulationSpec) -> None:
    simulator = Simulator(course_spec)
    begun = simulator.begin("d1-6")
    assert begun.status is Status.ACCEPTED
    assert simulator.moving
    assert begun.pose == begun.before, "what is merely planned is not told as done"
    assert simulator.trajectory is not None
    simulator.advance(0.5)
    assert simulator.pose.x == pytest.approx(12.5)
    assert simulator.begin("d1-1").status is Status.BUSY
    assert simulator.execute("o3").reply == pytest.approx(3.0)
    assert simulator.distance_at(0.5) == pytest.approx(3.0)
    assert simulator.stop()
    assert not simulator.stop()
    assert simulator.finish(begun).pose.x == pytest.approx(12.5)
    simulator.advance(0.1)
    assert simulator.time == pytest.approx(0.5), "time never goes back"


# -- the truth -------------------------------------------------------------------------------


def test_a_turn_of_nothing_has_a_pose_before_it_began(course_spec: SimulationSpec) -> None:
    """A mission may end between the time limit and the command under way."""
    simulator = Simulator(course_spec, seed=3)
    simulator.advance(1000.3)
    before = simulator.pose
    simulator.begin(parse_command("r1-0"))
    planned = simulator.trajectory or simulator.last_trajectory
    assert planned is not None
    assert planned.duration == 0.0
    assert [planned.pose_at(time) for time in (1000.0, 1000.3, 1001.0)] == [before] * 3


def test_truth_is_free_of_noise_and_draws_nothing(noisy_spec: SimulationSpec) -> None:
    simulator, other = Simulator(noisy_spec, 3), Simulator(noisy_spec, 3)
    for code in ("u1", "i1", "c1", "o1", "g1", "t1"):
        assert simulator.true_value(code) == simulator.look(code).true
    assert simulator.execute("u1").reply == other.execute("u1").reply
    with pytest.raises(KeyError):
        simulator.true_value("d1")


def test_rays_are_cast_for_many_places_at_once(course_spec: SimulationSpec) -> None:
    simulator = Simulator(course_spec)
    origins = np.array([(9.5, 42.0), (9.5, 42.0), (54.0, 42.0), (-1.0, 3.0)])
    distances = simulator.cast_rays(origins, np.array([0.0, 90.0, 0.0, 0.0]))
    assert distances.shape == (4,)
    assert distances == pytest.approx([38.5, 6.0, 0.0, 0.0])
    low = simulator.cast_rays(origins, np.array([0.0, 90.0, 0.0, 0.0]), z=1.0)
    assert low == pytest.approx([14.0, 6.0, 0.0, 0.0]), "the block at 25, 41"
    assert simulator.cast_rays(np.empty((0, 2)), np.empty(0)).shape == (0,)
    assert simulator.cast_rays([(9.5, 42.0)], [0.0]).tolist() == [38.5]  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("origins", "bearings"),
    [
        (np.zeros((3, 2)), np.zeros(2)),
        (np.zeros((3, 3)), np.zeros(3)),
        (np.zeros(2), np.zeros(1)),
        (np.zeros((2, 2)), np.zeros((2, 1))),
        (np.zeros((2, 2)), np.array(0.0)),
        (np.array([(math.nan, 0.0)]), np.zeros(1)),
        (np.zeros((1, 2)), np.array([math.inf])),
    ],
)
def test_rays_that_make_no_sense_are_refused(
    course_spec: SimulationSpec, origins: FloatArray, bearings: FloatArray
) -> None:
    with pytest.raises(ValueError, match="cast_rays needs"):
        Simulator(course_spec).cast_rays(origins, bearings)


def test_true_ranges_are_those_single_readings_rest_on(course_spec: SimulationSpec) -> None:
    simulator = Simulator(course_spec)
    rows = np.random.default_rng(2).uniform((3, 3, -720), (93, 45, 720), (300, 3))
    free = []
    for row in rows:
        with contextlib.suppress(PlacementError):
            simulator.teleport(Pose(*row))
            free.append([*row, *(simulator.true_value(code) for code in simulator.ranging_codes())])
    table = np.array(free)
    assert len(table) > 50
    ranges = simulator.true_ranges(table[:, :3])
    assert ranges.shape == (len(table), 6)
    np.testing.assert_allclose(ranges, table[:, 3:], rtol=0, atol=1e-9)
    two = simulator.true_ranges(table[:, :3], ["t1", "u2"])
    np.testing.assert_array_equal(two, ranges[:, [5, 1]])
    assert simulator.true_ranges(np.empty((0, 3))).shape == (0, 6)
    assert simulator.true_ranges(table[:, :3], []).shape == (len(table), 0)


@pytest.mark.parametrize(
    "poses", [np.zeros(3), np.zeros((2, 2)), np.zeros((1, 3, 1)), np.full((1, 3), math.nan)]
)
def test_poses_that_make_no_sense_are_refused(course_spec: SimulationSpec, poses: FloatArray) -> None:
    with pytest.raises(ValueError, match="true_ranges needs"):
        Simulator(course_spec).true_ranges(poses)


def test_ranges_of_what_is_no_range_sensor_are_refused(course_spec: SimulationSpec) -> None:
    for code in ("i1", "d1", "zz"):
        with pytest.raises(KeyError, match=code):
            Simulator(course_spec).true_ranges(np.zeros((1, 3)), [code])


# -- changing things -------------------------------------------------------------------------


def test_a_robot_is_put_only_where_it_can_stand(course_spec: SimulationSpec) -> None:
    simulator = Simulator(course_spec)
    simulator.teleport(Pose(54.0, 30.0, 1000.0))
    assert simulator.execute("c1").reply == 1000.0
    for pose in (Pose(54.0, 42.0, 0.0), Pose(-1.0, 30.0, 0.0), Pose(1.0, 30.0, 0.0), Pose(math.inf, 0, 0)):
        with pytest.raises(SimmerError):
            simulator.teleport(pose)
        assert simulator.pose == Pose(54.0, 30.0, 1000.0)


def test_a_start_in_a_wall_is_refused_with_the_place(course_spec: SimulationSpec) -> None:
    with pytest.raises(PlacementError, match=r"\(54, 42\) heading 0 overlaps .* middle of a free cell"):
        Simulator(replace(course_spec, bot_center=(54.0, 42.0)))
    with pytest.raises(PlacementError, match="the block of 3 in"):
        Simulator(replace(course_spec, block_center=(54.0, 42.0)))


def test_sensors_see_the_block_where_it_was_moved_to(course_spec: SimulationSpec) -> None:
    simulator = Simulator(course_spec)
    before = simulator.execute("u5").reply
    simulator.move_block(20.0, 42.0)
    assert simulator.execute("u5").reply == pytest.approx(18.5 - 12.5)
    simulator.move_block(25.0, 41.0)
    assert simulator.execute("u5").reply == before
    assert simulator.true_ranges(np.array([(9.5, 42.0, 0.0)]), ["u5"])[0, 0] == pytest.approx(before)


@pytest.mark.parametrize("seed", [-1, 1.5, "7", None, 2**128, [7]])
def test_a_seed_that_is_none_is_refused_at_once(course_spec: SimulationSpec, seed: Any) -> None:
    with pytest.raises(ValueError, match="the seed must be a whole number from 0 to"):
        Simulator(course_spec, seed)
    simulator = Simulator(course_spec, np.int64(7))  # type: ignore[arg-type]
    simulator.execute("d1-3")
    pose = simulator.pose
    if seed is not None:  # the same seed
        with pytest.raises(ValueError, match="the seed must be a whole number from 0 to"):
            simulator.reset(seed)
    assert simulator.pose == pose, "nothing was reset"
    assert type(simulator.seed) is int, "logs have it as a number"


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda simulator: pickle.loads(pickle.dumps(simulator))])
def test_a_copy_goes_on_by_itself(copied: Callable[[Any], Any]) -> None:
    """A program that plans tries commands on a copy."""
    spec = load_default().simulation
    commands = ["d1-2", "u1", "vv-4;0;20", "wt-0.5", "o1", "vv-0;0;0", "g1"]
    simulator, untouched = Simulator(spec, 7), Simulator(spec, 7)
    for each in (simulator, untouched):
        each.execute("d1-1")
    twin = copied(simulator)
    twin.set_bias({DriveKind.RIGHT: Axes(0.5, 0.0, 0.0)})
    untouched.set_bias({DriveKind.RIGHT: Axes(0.5, 0.0, 0.0)})
    expected = [untouched.execute(each).reply for each in commands]
    assert [twin.execute(each).reply for each in commands] == expected
    assert twin.pose == untouched.pose
    assert simulator.pose != twin.pose


def test_bias_may_be_set_for_some_movements(course_spec: SimulationSpec) -> None:
    simulator = Simulator(course_spec)
    simulator.set_bias({DriveKind.RIGHT: Axes(x=1.0)})
    simulator.execute("d1-3")
    assert simulator.pose.x == pytest.approx(15.5)
    simulator.execute("a1-3")
    assert simulator.pose.x == pytest.approx(12.5)


def test_the_default_set_is_the_course_and_its_time_of_flight_sensor_sees_47_inches() -> None:
    spec = load_default().simulation
    limits = {sensor.code: sensor.max_range for sensor in spec.sensors}
    assert limits["t1"] == 47.0
    assert limits["u1"] == math.inf
    simulator = Simulator(spec)
    assert simulator.pose == Pose(9.5, 42.0, 0.0)
    assert simulator.ranging_codes() == ["u1", "u2", "u3", "u4", "u5", "t1"]


@pytest.mark.parametrize("name", ["sensor", "true_value", "look"])
def test_an_unknown_sensor_code_lists_those_there_are(course_spec: SimulationSpec, name: str) -> None:
    simulator = Simulator(course_spec)
    with pytest.raises(UnknownSensorError) as raised:
        getattr(simulator, name)("zz")
    codes = ", ".join(sensor.code for sensor in course_spec.sensors)
    assert str(raised.value) == f"no sensor has the code 'zz'; there are {codes}"
    assert isinstance(raised.value, KeyError)


def test_true_ranges_of_another_sensor_lists_the_range_sensors(course_spec: SimulationSpec) -> None:
    with pytest.raises(UnknownSensorError, match="no range sensor has the code 'c1'; there are u1, u2,"):
        Simulator(course_spec).true_ranges(np.zeros((1, 3)), ["u1", "c1"])


@pytest.mark.parametrize("command", ["u1", "i1", "d1-3", "d1-x", "r1-90", "\x1b[2J" * 99])
def test_an_outcome_shows_itself_on_a_line(course_spec: SimulationSpec, command: str) -> None:
    shown = repr(Simulator(course_spec).execute(command))
    assert len(shown) <= 110
    assert shown.isprintable()
    assert printable(parse_command(command).shown)[:20] in shown
