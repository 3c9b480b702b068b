"""Drives that start late and pick up speed."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui.sim import DriveKind, SimulationSpec, Simulator
from simmer_tui.sim.trajectory import VelocityProfile

paces = st.builds(
    VelocityProfile,
    distance=st.floats(1e-3, 1e4),
    speed=st.floats(0.1, 200.0),
    lag=st.sampled_from([0.0, 0.3]),
    acceleration=st.sampled_from([0.0, 0.5, 12.0, 1e4]),
)


def simulator(spec: SimulationSpec, **columns: float) -> Simulator:
    drives = tuple(replace(drive, **columns) for drive in spec.drives)
    return Simulator(replace(spec, drives=drives, bot_center=(6.0, 6.0)))


@pytest.mark.parametrize(
    ("way", "lag", "acceleration", "duration"),
    [
        (12.0, 0.0, 0.0, 2.0),
        (12.0, 0.25, 0.0, 2.25),
        (12.0, 0.0, 6.0, 3.0),  # 1 s up, 1 s at 6 in/s, 1 s down
        (6.0, 0.0, 6.0, 2.0),  # up for 1 s to 6 in/s, and down again
        (1.5, 0.1, 6.0, 1.1),  # up to 3 in/s only
        (0.0, 5.0, 6.0, 0.0),
    ],
)
def test_how_long_a_movement_takes(
    course_spec: SimulationSpec, way: float, lag: float, acceleration: float, duration: float
) -> None:
    driven = simulator(course_spec, speed=6.0, start_lag=lag, acceleration=acceleration)
    driven.advance(1000.3)
    outcome = driven.execute(f"d1-{way}")
    assert outcome.time == pytest.approx(1000.3 + duration, abs=1e-9)
    assert driven.pose.x == pytest.approx(6.0 + way)


def test_where_the_robot_is_meanwhile(course_spec: SimulationSpec) -> None:
    driven = simulator(course_spec, speed=6.0, start_lag=0.5, acceleration=6.0)
    driven.advance(100.0)
    driven.begin("d1-12")
    places = {0.25: 0.0, 0.5: 0.0, 1.0: 0.75, 1.5: 3.0, 2.0: 6.0, 2.5: 9.0, 3.0: 11.25, 3.5: 12.0, 9.0: 12.0}
    for elapsed, gone in places.items():
        driven.advance(100.0 + elapsed)
        assert driven.pose.x == pytest.approx(6.0 + gone)
        assert driven.execute("o3").reply == pytest.approx(gone)


def test_a_turn_accelerates_too(course_spec: SimulationSpec) -> None:
    driven = simulator(course_spec, speed=120.0, acceleration=240.0)
    driven.begin("r1-90")
    driven.advance(0.5)
    assert driven.pose.heading == pytest.approx(30.0)
    driven.advance(1.25)
    assert driven.pose.heading == pytest.approx(90.0)
    assert not driven.moving


def test_a_contact_is_where_it_was_but_later(course_spec: SimulationSpec) -> None:
    plain, late = (
        simulator(course_spec, speed=6.0),
        simulator(course_spec, speed=6.0, start_lag=0.5, acceleration=6.0),
    )
    before, after = plain.execute("d1-90"), late.execute("d1-90")
    assert before.contact is not None
    assert after.contact is not None
    assert after.contact.pose == before.contact.pose
    assert before.contact.time == pytest.approx(63.0 / 6.0)
    assert after.contact.time == pytest.approx(0.5 + 0.5 + 63.0 / 6.0)


def test_a_stop_on_the_way_leaves_it_there(course_spec: SimulationSpec) -> None:
    driven = simulator(course_spec, speed=6.0, start_lag=0.5, acceleration=6.0)
    driven.begin("d1-12")
    driven.advance(1.5)
    driven.stop()
    assert driven.pose.x == pytest.approx(9.0)


@settings(max_examples=20)
@given(paces, st.floats(0.0, 1.0))
def test_time_and_fraction_are_each_others_inverse(profile: VelocityProfile, fraction: float) -> None:
    assert profile.fraction_at(profile.time_at(fraction)) == pytest.approx(fraction, abs=1e-6)
    assert profile.lag <= profile.time_at(fraction) <= profile.duration * (1 + 1e-9)


@settings(max_examples=20)
@given(paces, st.lists(st.floats(0.0, 1.2), min_size=2))
def test_it_never_goes_back(profile: VelocityProfile, moments: list[float]) -> None:
    fractions = [profile.fraction_at(moment * profile.duration) for moment in sorted(moments)]
    assert all(b >= a - 1e-12 for a, b in pairwise(fractions))
    assert 0.0 <= fractions[0] <= fractions[-1] <= 1.0
    assert profile.duration >= profile.distance / profile.speed + profile.lag - 1e-12
    assert math.isfinite(profile.duration)


def test_kinds_say_their_direction_and_unit() -> None:
    told = {"up": (0, 1, 0), "down": (0, -1, 0), "left": (-1, 0, 0), "right": (1, 0, 0), "rot": (0, 0, 1)}
    for name, direction in told.items():
        kind = DriveKind(name)
        assert (kind.direction.x, kind.direction.y, kind.direction.r) == direction
        assert kind.unit == ("deg" if name == "rot" else "in")
