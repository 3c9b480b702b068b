"""Motion at a constant twist, wheels, and the velocity that commands make of them."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simmer_tui.sim.arcs import STILL, Arc, Twist, poses_along
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import WheelLayout, WheelsSpec
from simmer_tui.sim.velocity_plan import VelocityPlan, VelocityTarget
from simmer_tui.sim.wheels import WheelKinematics

SPEEDS = st.floats(-14.0, 14.0)
RATES = st.one_of(st.sampled_from([0.0, 1e-14, -1e-9, 1e-3]), st.floats(-150.0, 150.0))


@given(SPEEDS, SPEEDS, RATES, st.floats(-720.0, 720.0), st.floats(0.01, 0.6))
def test_an_arc_is_the_integral_of_its_twist(x: float, y: float, r: float, heading: float, t: float) -> None:
    end = Arc.of(Pose(20.0, 30.0, heading), Twist(x, y, r), t).end
    # The integral by Gauss and Legendre's three points on each of 40 parts: good to 1e-12.
    nodes = ((-math.sqrt(0.6), 5 / 9), (0.0, 8 / 9), (math.sqrt(0.6), 5 / 9))
    far_x = far_y = 0.0
    for part in range(40):
        for node, weight in nodes:
            angle = math.radians(heading + r * t * (part + 0.5 + node / 2) / 40)
            far_x += (x * math.cos(angle) - y * math.sin(angle)) * weight * t / 80
            far_y += (x * math.sin(angle) + y * math.cos(angle)) * weight * t / 80
    assert end.x == pytest.approx(20.0 + far_x, abs=1e-11)
    assert end.y == pytest.approx(30.0 + far_y, abs=1e-11)
    assert end.heading == pytest.approx(heading + r * t, abs=1e-11)


@settings(max_examples=20)
@given(SPEEDS, RATES, st.floats(0.0, 0.6))
def test_times_and_their_numbers_h_belong_together(x: float, r: float, t: float) -> None:
    arc = Arc.of(Pose(0.0, 0.0, 0.0), Twist(x, 0.0, r), 0.6)
    assert arc.seconds_at(arc.half_tangent(t)) == pytest.approx(t, abs=1e-14)


def test_a_spin_turns_the_robot_and_leaves_its_way_straight() -> None:
    end = Arc(Pose(5.0, 5.0, 10.0), (2.0, 0.0), 0.0, 3.0, spin=20.0).end
    assert end == Pose(11.0, 5.0, 70.0)


@pytest.mark.parametrize("layout", list(WheelLayout))
@given(x=SPEEDS, y=SPEEDS, r=RATES)
@settings(max_examples=15)
def test_rim_speeds_lead_back_to_the_twist(layout: WheelLayout, x: float, y: float, r: float) -> None:
    wheels = WheelKinematics.of(WheelsSpec(layout=layout, track=7.1, wheelbase=5.3, radius=3.2))
    twist = Twist(x, y if wheels.sideways else 0.0, r)
    speeds = wheels.speeds(twist)
    again = wheels.twist(speeds)
    assert (again.x, again.y, again.r) == pytest.approx((twist.x, twist.y, twist.r), abs=1e-11)
    assert wheels.slip(speeds) == pytest.approx((0.0,) * len(speeds), abs=1e-11)


def test_wheels_that_contradict_each_other_slip() -> None:
    wheels = WheelKinematics.of(WheelsSpec(layout=WheelLayout.MECANUM))
    against = (1.0, 1.0, -1.0, -1.0)
    assert wheels.slip(against) == pytest.approx(against)
    assert wheels.twist(against).speed == pytest.approx(0.0, abs=1e-12)


def test_two_wheels_turn_by_their_difference() -> None:
    wheels = WheelKinematics.of(WheelsSpec(layout=WheelLayout.DIFF, track=6.0))
    twist = wheels.twist((1.0, 3.0))
    assert (twist.x, twist.y) == (2.0, 0.0)
    assert twist.r == pytest.approx(math.degrees(2.0 / 6.0))


def test_a_body_velocity_keeps_its_curve_at_the_top_speed_and_rims_are_cut_one_by_one() -> None:
    wheels = WheelKinematics.of(WheelsSpec(layout=WheelLayout.DIFF, track=6.0, top_speed=8.0))
    asked = Twist(8.0, 0.0, math.degrees(8.0 / 3.0))
    limited = asked.scaled(wheels.share(asked))
    assert wheels.speeds(limited) == pytest.approx((0.0, 8.0))
    assert wheels.clamped((9.0, -20.0)) == (8.0, -8.0)


def changes(plan: VelocityPlan, until: float) -> list[tuple[float, Twist]]:
    """Times and velocities of a plan's changes."""
    seen = []
    while plan.due <= until:
        time = plan.due
        plan.change(time)
        seen.append((time, plan.twist))
    return seen


def test_a_velocity_takes_effect_after_its_lag() -> None:
    plan = VelocityPlan(0.02)
    assert plan.command(7.0, VelocityTarget(Twist(3.0), lag=0.1))
    assert changes(plan, 8.0) == [(7.1, Twist(3.0))]


def test_velocities_that_come_faster_than_the_lag_take_effect_one_after_the_other() -> None:
    plan = VelocityPlan(0.02)
    plan.command(7.0, VelocityTarget(Twist(3.0), lag=0.1))
    plan.command(7.05, VelocityTarget(Twist(4.0), lag=0.1))
    assert [twist.x for _, twist in changes(plan, 8.0)] == [3.0, 4.0]


def test_the_same_velocity_is_no_change() -> None:
    plan = VelocityPlan(0.02)
    assert plan.command(7.0, VelocityTarget(Twist(3.0)))
    assert not plan.command(7.5, VelocityTarget(Twist(3.0)))


@given(st.floats(0.1, 12.0), st.floats(5.0, 80.0))
def test_a_ramp_goes_as_far_as_the_straight_one(speed: float, acceleration: float) -> None:
    plan = VelocityPlan(0.02)
    plan.command(3.0, VelocityTarget(Twist(speed), acceleration=Twist(acceleration)))
    steps = [*changes(plan, 90.0), (3.0 + speed / acceleration, Twist(speed))]
    gone = sum((after - at) * twist.x for (at, twist), (after, _) in pairwise(steps))
    assert gone == pytest.approx(speed * speed / acceleration / 2.0)
    assert plan.twist == Twist(speed)


def test_the_components_of_a_ramp_arrive_together() -> None:
    plan = VelocityPlan(0.02)
    plan.command(3.0, VelocityTarget(Twist(4.0, 0.0, 30.0), acceleration=Twist(10.0, 0.0, 300.0)))
    seen = changes(plan, 9.0)
    assert seen[-1][0] == pytest.approx(3.4)
    assert all(twist.r == pytest.approx(twist.x * 7.5) for _, twist in seen)


def test_a_halt_is_at_once() -> None:
    plan = VelocityPlan(0.02)
    plan.command(3.0, VelocityTarget(Twist(4.0), lag=1.0, acceleration=Twist(1.0)))
    plan.halt()
    assert (plan.moves, plan.twist, plan.due) == (False, STILL, math.inf)


@pytest.mark.parametrize(
    ("low", "high", "seconds"),
    [
        ((-1.0, -1.0), (1.0, 1.0), 0.0),  # it begins inside
        ((0.0, 0.0), (1.0, 1.0), 0.0),  # on a corner
        ((-2.0, -1.0), (-1e-10, 1.0), 0.0),  # within rounding of an edge
        ((-2.0, -1.0), (-1e-8, 1.0), None),
        ((3.0, -1.0), (4.0, 1.0), 1.5),
        ((8.0, -1.0), (9.0, 0.0), 4.0),  # reached at its very end
        ((8.001, -1.0), (9.0, 0.0), None),
        ((3.0, 0.5), (4.0, 1.0), None),
    ],
)
def test_a_straight_arc_is_in_a_box_from_its_edge_on(
    low: tuple[float, float], high: tuple[float, float], seconds: float | None
) -> None:
    for quarter in range(4):  # the same, turned by quarter turns
        places = [(low[0], low[1]), (high[0], high[1])]
        for _ in range(quarter):
            places = [(-y, x) for x, y in places]
        corners = [(min(each), max(each)) for each in zip(*places, strict=True)]
        arc = Arc.of(Pose(0.0, 0.0, 90.0 * quarter), Twist(2.0), 4.0)
        found = arc.seconds_in_box((corners[0][0], corners[1][0]), (corners[0][1], corners[1][1]))
        assert found == (None if seconds is None else pytest.approx(seconds, abs=1e-9))


def test_a_quarter_circle_is_in_a_box_by_hand() -> None:
    """A circle of 4 in around (0, 4), by 45 degrees a second: its place is 4 sin, 4 - 4 cos."""
    arc = Arc.of(Pose(0.0, 0.0, 0.0), Twist(math.pi, 0.0, 45.0), 2.0)
    assert arc.seconds_in_box((2.0, 0.0), (3.0, 4.0)) == pytest.approx(2.0 / 3.0)
    assert arc.seconds_in_box((0.0, 2.0), (5.0, 3.0)) == pytest.approx(4.0 / 3.0)
    assert arc.seconds_in_box((4.0, 4.0), (5.0, 5.0)) == pytest.approx(2.0)
    assert arc.seconds_in_box((0.0, 2.0), (3.0, 3.0)) is None
    still = Arc.standing(Pose(1.0, 1.0, 0.0))
    assert still.seconds_in_box((0.0, 0.0), (1.0, 1.0)) == 0.0
    assert still.seconds_in_box((0.0, 0.0), (0.5, 1.0)) is None


ARCS = st.builds(
    lambda x, y, heading, vx, vy, rate, spin: Arc(Pose(x, y, heading), (vx, vy), rate, 1.0, spin),
    *(SPEEDS, SPEEDS, st.floats(-400.0, 400.0)),
    *(st.one_of(st.just(0.0), SPEEDS), st.one_of(st.just(0.0), SPEEDS)),
    *(st.sampled_from([0.0, 40.0, -80.0]), st.sampled_from([0.0, 30.0, -40.0])),
)


@settings(max_examples=15)
@given(st.lists(st.tuples(ARCS, st.integers(0, 3)), min_size=1, max_size=4))
def test_poses_along_arcs_are_those_of_each_arc(chosen: list[tuple[Arc, int]]) -> None:
    chosen = [*chosen, (chosen[0][0], 1)]
    lots = [(arc, 2.0 * number, count) for number, (arc, count) in enumerate(chosen)]
    moments = [(arc, begin, begin + 0.3 * k) for arc, begin, count in lots for k in range(count)]
    poses = poses_along(lots, np.array([time for _, _, time in moments]))
    expected = [arc.pose_after(time - begin) for arc, begin, time in moments]
    assert poses.tolist() == [[pose.x, pose.y, pose.heading] for pose in expected]
