"""The filter that follows a robot while its readings are predicted."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.emulated_robots import set_with
from simmer_tui.calibrate.find_path import world_of
from simmer_tui.calibrate.fit import Fit, fit
from simmer_tui.calibrate.measured_run import Chain, MeasuredMovement, MeasuredRun, Readings
from simmer_tui.calibrate.pose_filter import PoseFilter
from simmer_tui.calibrate.prediction import HeldBack, PredictionAccuracy, held_back
from simmer_tui.calibrate.result_page import held_back_picture
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.sensors import RangeSensor, Ultrasonic, sensor_of
from simmer_tui.sim.specs import SimulationSpec

START = Pose(9.5, 42.0, 10.0)


def run_stopped_after(spec: SimulationSpec, asked: float, done: float) -> tuple[MeasuredRun, FloatArray]:
    """A movement ahead that a hidden obstacle cut short, the ranges read before and after it, and where
    the robot stands then."""
    ahead = next(i for i, each in enumerate(spec.drives) if each.code == "d1")
    angle = math.radians(START.heading)
    poses = np.array([(START.x, START.y, START.heading)] * 2)
    poses[1, :2] += done * np.array((math.cos(angle), math.sin(angle)))
    chain = Chain(START, 1, [MeasuredMovement(ahead, asked, True, 2, 1.0)])
    run = MeasuredRun(set_with(spec), ("made up",), (chain,), {}, None, False)
    stops, times = np.arange(2), np.array((0.0, 1.0))
    readings = {}
    for sensor in map(sensor_of, spec.sensors):
        if isinstance(sensor, RangeSensor):
            seen = sensor.true_values(world_of(run), poses)
        elif sensor.spec.kind.name in ("gyro", "comp"):
            seen = poses[:, 2]
        else:
            continue
        readings[sensor.spec.code] = Readings(stops, seen, times, np.full(2, np.nan))
    return replace(run, readings=readings), poses[1]


@pytest.mark.parametrize("done", [0.5, 4.0, 6.0])
def test_a_robot_that_stopped_sooner_than_thought_is_found_again(done: float) -> None:
    spec = load(bundled_folder()).simulation
    run, stands = run_stopped_after(spec, 12.0, done)
    pose_filter = PoseFilter(run, spec, np.array((START.x, START.y, START.heading)), 0.01 * np.eye(3), 0)
    pose_filter.advance(1)
    off = pose_filter.pose - stands
    assert np.hypot(off[0], off[1]) < 0.3
    assert abs(off[2]) < 1.0


def test_readings_have_scores_and_counters_where_no_wall_was_met() -> None:
    spec = load(bundled_folder()).simulation
    run, _ = run_stopped_after(spec, 3.0, 3.0)
    seen = {"ultra", "tof", "comp"}
    for free, kinds in ((frozenset({1}), seen | {"gyro"}), (frozenset(), seen)):
        start = np.array((START.x, START.y, START.heading))
        pose_filter = PoseFilter(run, spec, start, 0.01 * np.eye(3), 0, free=free)
        pose_filter.advance(1)
        assert {kind.name for kind in pose_filter.scores} == kinds
        # All readings are those of a perfect robot.
        assert max(max(each) for each in pose_filter.scores.values()) < 0.5


@pytest.mark.slow
def test_a_log_that_ends_with_a_new_start_has_readings_held_back_before_it(found: Fit) -> None:
    run = found.run
    again = Chain(run.chains[0].start, 9999)
    held = held_back(fit(replace(run, chains=(*run.chains, again))))
    assert held is not None
    assert held.movements == len(run.movements) // 4
    assert (
        next(each.count for each in held.errors if each.kind.name == "ultra" and not each.ahead)
        > held.movements
    )


def test_the_block_lies_where_the_set_has_it_and_is_not_turned(found: Fit) -> None:
    spec = found.run.spec
    assert world_of(found.run).block == Block(*spec.block_center, spec.block_size, 0.0)


def test_errors_of_predictions_are_bars_beside_their_words(found: Fit) -> None:
    errors = (PredictionAccuracy(Ultrasonic, 1, 2.0, 0.5, 9), PredictionAccuracy(Ultrasonic, 0, 0.0, 0.5, 9))
    figure = held_back_picture(HeldBack(9, found, errors))
    places = [tuple(map(float, at)) for at in re.findall(r"x='([\d.]+)' y='([\d.]+)'", figure.content)]
    rows = [[(230.0, y + 12), (240.0, y), (240.0, y + 3), (figure.width - 82.0, y + 12)] for y in (8.0, 30.0)]
    assert places == [*rows[0], *rows[1]]
    room = figure.width - 330.0
    widths = re.findall(r"width='([\d.]+)'", figure.content)
    assert [float(each) for each in widths] == pytest.approx([room, room / 4, room, room])
    heights = [float(each) for each in re.findall(r"height='([\d.]+)'", figure.content)]
    assert heights == [16.0, 10.0] * 2, "a bar has the same space above and below it, 3 points"
    assert figure.height == 52.0
