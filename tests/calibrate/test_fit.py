"""Estimates from a made-up run, and the tests that are made of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import chdtrc

from simmer_tui.calibrate.change_detection import judged
from simmer_tui.calibrate.estimates import estimates_of
from simmer_tui.calibrate.fit import Fit, fit, lost_stretch, misplaced, slips_in, with_contacts
from simmer_tui.calibrate.geometry import moved
from simmer_tui.calibrate.pose_filter import PoseFilter
from simmer_tui.calibrate.posterior import RANGE
from simmer_tui.calibrate.prediction import HeldBack, held_back
from simmer_tui.calibrate.written_set import Knowledge, knowledge_of, learned_spec
from simmer_tui.sim.sensors import Compass, ParameterKind
from tests.calibrate.synthetic import START, Synthetic, make


@pytest.fixture(scope="module")
def known() -> Synthetic:
    return make()


@pytest.fixture(scope="module")
def fitted(known: Synthetic) -> Fit:
    told: list[tuple[str, float]] = []
    found = fit(known.run, progress=lambda what, share: told.append((what, share)))
    # First along the stops, then by twelve rounds at most; the bar never goes back within a part.
    finding = [share for what, share in told if what == "finding the path"]
    assert finding == pytest.approx(np.arange(41) / 41)
    rounds = [share for what, share in told[41:] if what == "estimating"]
    assert rounds[:3] == pytest.approx([1 / 12, 2 / 12, 3 / 12])
    assert len(rounds) == len(told) - 41
    return found


def test_estimates_are_the_truth_within_their_errors(known: Synthetic, fitted: Fit) -> None:
    off = (fitted.state.parameters - known.truth.parameters) / fitted.standard_errors
    # In so plain a room not every offset shows.
    places = [each.kind is not ParameterKind.OFFSET for each in fitted.space.parameters]
    assert fitted.identified[places].all()
    assert np.abs(off).max() < 3.5
    assert 0.6 < np.sqrt(np.mean(off**2)) < 1.3
    assert not fitted.state.contacts.any()
    poses = fitted.poses - known.truth.chain[:, :3]
    assert np.sqrt(np.mean((poses / fitted.pose_spread) ** 2)) < 1.5


def test_standard_errors_of_normal_residuals_are_those_of_the_posterior(fitted: Fit) -> None:
    told = fitted.identified
    # In so plain a room not every offset of a sensor shows.
    assert [
        each.kind for each, is_told in zip(fitted.space.parameters, told, strict=True) if not is_told
    ] == [ParameterKind.OFFSET] * 2
    assert fitted.standard_errors[told] == pytest.approx(np.sqrt(np.diag(fitted.covariance))[told], rel=1e-12)
    assert fitted.pose_spread.shape == (fitted.run.stops, 3)


def test_noise_scales_of_drives_are_the_truth_within_their_errors(known: Synthetic, fitted: Fit) -> None:
    scales = [i for i, each in enumerate(fitted.space.noise_scales) if each.drive]
    off = np.log(fitted.state.noise_scales / known.truth.noise_scales)[scales]
    told = fitted.noise_scales_identified[scales]
    assert told.sum() >= 8
    assert np.abs(off[told] / fitted.noise_scale_errors[scales][told]).max() < 3.0
    # Eight movements of a drive tell a standard deviation to 1 / sqrt(2 * 8) at best.
    main = fitted.noise_scale_errors[fitted.space.column(True, 4, "error.r")]
    assert 0.25 < main < 0.45


@pytest.fixture(scope="module")
def held(fitted: Fit) -> HeldBack:
    found = held_back(fitted)
    assert found is not None
    return found


@pytest.mark.slow
def test_a_part_of_the_run_tells_less(fitted: Fit, held: HeldBack) -> None:
    part = held.learned
    assert part.run.stops == 31
    assert np.median(part.standard_errors / fitted.standard_errors) > 1.1


def test_the_learned_set_has_what_was_identified(fitted: Fit) -> None:
    estimates = estimates_of(fitted)
    made = learned_spec(fitted.run.spec, estimates)
    by_name = {(each.owner, each.field): each for each in estimates}
    assert made.drives[0].bias.x == float(f"{by_name[made.drives[0].kind.value, 'bias.x'].value:.5g}")
    assert made.sensors[0].gain == float(f"{by_name['ultra1', 'gain'].value:.5g}")
    assert not made.randbias
    assert by_name["ir1", ""].why_not.startswith("the kind ir")
    assert [each.owner for each in estimates][-1] == "link"


# -- is the path the right one? -----------------------------------------------------------------------


def test_ranges_that_fit_no_place_are_told_with_their_line(fitted: Fit) -> None:
    rows = fitted.rows
    assert lost_stretch(fitted.model, rows) is None
    weights = rows.weights.copy()
    weights[(rows.family == RANGE) & (rows.stop >= 15) & (rows.stop <= 20)] = 0.0
    said = lost_stretch(fitted.model, replace(rows, weights=weights))
    assert said is not None
    assert said.startswith("near line")
    weights[rows.family == RANGE] = 0.75
    said = lost_stretch(fitted.model, replace(rows, weights=weights))
    assert said is not None
    assert said.startswith("25% of all ranges")
    weights[rows.family == RANGE] = 0.85
    assert lost_stretch(fitted.model, replace(rows, weights=weights)) is None


@pytest.mark.parametrize(("off", "is_right"), [(3.9, True), (4.1, False)])
def test_a_path_begins_within_four_standard_deviations(fitted: Fit, off: float, is_right: bool) -> None:
    chain = fitted.state.chain.copy()
    chain[0, :3] = (START.x + off, START.y, START.heading)
    said = misplaced(fitted.run, replace(fitted.state, chain=chain))
    assert (said is None) == is_right
    if said is not None:
        assert "4.1 in and 0 degrees from where line 1 has the robot" in said


def test_a_path_into_a_wall_is_a_contact(known: Synthetic) -> None:
    chain = known.truth.chain.copy()
    radius = known.run.spec.robot.radius or 0.0
    # A movement of 3.3 in ahead, from where it ends inside the right wall, or clear of it.
    for gap, met in ((3.3 + 0.2, False), (3.3 - 0.5, True)):
        second = next(i for i, each in enumerate(known.run.movements) if each.drive == 3 and each.value > 0)
        pose = np.array([96.0 - radius - gap, 20.0, 0.0])
        chain[second, :3], chain[second, 3:] = pose, (3.3, 0.0, 0.0)
        state = with_contacts(known.model, replace(known.truth, chain=chain))
        assert bool(state.contacts[second]) is met


def test_movements_that_do_not_go_together_slipped(known: Synthetic) -> None:
    rows = known.model.rows(known.truth)
    assert not slips_in(known.model, known.truth, rows).any()
    odd = rows.residuals.copy()
    mine = np.flatnonzero((rows.family == 0) & (rows.stop == 7))
    odd[mine[0]] = 5.9 * math.sqrt(rows.variances[mine[0]])
    assert not slips_in(known.model, known.truth, replace(rows, residuals=odd)).any()
    odd[mine[0]] = 6.1 * math.sqrt(rows.variances[mine[0]])
    assert np.flatnonzero(slips_in(known.model, known.truth, replace(rows, residuals=odd))).tolist() == [7]


# -- change detection ----------------------------------------------------------------------------------


def test_a_change_has_the_probability_of_a_chi_square(fitted: Fit) -> None:
    """One parameter of one sensor differs; information and covariance are diagonal."""
    names = [each.name for each in fitted.space.parameters]
    count = len(names)
    information, covariance = np.diag(np.full(count, 400.0)), np.diag(np.full(count, 0.01))
    knowledge = Knowledge(
        parameters=tuple(names),
        values=tuple(fitted.state.parameters.tolist()),
        covariance=tuple(map(tuple, covariance.tolist())),
    )
    column = names.index("comp1 bias")
    off = fitted.state.parameters.copy()
    off[column] += 0.3
    made = replace(fitted, information=information, state=replace(fitted.state, parameters=off))
    parts = {each.owner: each for each in judged(made, knowledge)}
    # Both standard errors are widened by 1.1: their variances add up to 1.21 (1 / 400 + 0.01).
    total = 1.21 * (1 / 400 + 0.01)
    part = parts["comp1"]
    assert part.probability == pytest.approx(chdtrc(1, 0.3**2 / total), rel=1e-6)
    ((label, prior, now, error),) = part.figures
    assert label == "bias"
    assert now - prior == pytest.approx(0.3)
    assert error == pytest.approx(math.sqrt(total))
    assert parts["ultra1"].probability == pytest.approx(1.0)
    # Holm: the least of n probabilities must be below rate / n.
    edge = part.probability * len(parts)
    assert {each.owner for each in judged(made, knowledge, 1.01 * edge) if each.changed} == {"comp1"}
    assert not any(each.changed for each in judged(made, knowledge, 0.99 * edge))


def test_knowledge_holds_what_the_data_say(fitted: Fit) -> None:
    knowledge = knowledge_of(fitted, estimates_of(fitted))
    told = fitted.identified
    offsets = np.array([each.kind is ParameterKind.OFFSET for each in fitted.space.parameters])
    # The set has the sensors where they were found, so that offsets from there are 0.
    expected = np.where(offsets, 0.0, fitted.state.parameters)
    assert knowledge.values == pytest.approx(expected[told])
    assert np.diag(knowledge.covariance) == pytest.approx(np.diag(fitted.covariance)[told], rel=1e-5)
    assert not any(each.changed for each in judged(fitted, knowledge))


# -- prediction ----------------------------------------------------------------------------------------


def filtered(made: Synthetic) -> PoseFilter:
    start = made.truth.chain[0, :3]
    pose_filter = PoseFilter(made.run, made.run.spec, start, 1e-6 * np.eye(3), 0)
    for stop in range(1, made.run.stops):
        pose_filter.advance(stop)
    return pose_filter


def test_without_errors_the_filter_predicts_every_reading() -> None:
    exact = filtered(make(12, scale=0.0))
    assert exact.pose == pytest.approx(make(12, scale=0.0).truth.chain[-1, :3], abs=1e-6)
    assert {ahead for _, ahead in exact.errors} == {0, 1, 5}
    assert {kind.name for kind, _ in exact.errors} == {"ultra", "tof", "comp", "odom", "gyro"}
    assert all(np.median(errors) < 1e-6 for errors in exact.errors.values())
    assert len(exact.errors[next(kind for kind, _ in exact.errors if kind.name == "comp"), 5]) == 8


@pytest.fixture
def blind(known: Synthetic) -> PoseFilter:
    """A filter at the start, which has made one movement without any reading: back by 3 in."""
    run = replace(known.run, readings={})
    start = known.truth.chain[0, :3]
    pose_filter = PoseFilter(run, run.spec, start, np.diag((0.04, 0.09, 4.0)), 0)
    pose_filter.advance(1)
    return pose_filter


def test_a_movement_adds_its_errors_to_those_of_the_pose(known: Synthetic, blind: PoseFilter) -> None:
    totals = known.truth.chain[0, 3:] - known.totals_off[0]
    start = known.truth.chain[0, :3]
    assert blind.pose == pytest.approx(moved(start[None], totals[None], 4)[0])
    drive = known.run.spec.drives[known.run.movements[0].drive]
    d = known.run.movements[0].value
    spreads = [d * (1 + getattr(drive.bias, a)) * getattr(drive.error, a) for a in "xyr"]
    middle = math.radians((start[2] + blind.pose[2]) / 2)
    frame = np.eye(3)
    frame[:2, :2] = [[math.cos(middle), -math.sin(middle)], [math.sin(middle), math.cos(middle)]]
    across = np.eye(3)
    across[0, 2] = -math.radians(blind.pose[1] - start[1])
    across[1, 2] = math.radians(blind.pose[0] - start[0])
    made = across @ np.diag((0.04, 0.09, 4.0)) @ across.T
    made += frame @ np.diag(np.square(spreads) + 1e-8) @ frame.T
    assert blind.covariance == pytest.approx(made, abs=1e-9)


def test_an_observation_is_a_kalman_update(known: Synthetic, blind: PoseFilter) -> None:
    compass = next(each for each in known.run.spec.sensors if each.kind.name == "comp")
    before, heading = blind.covariance.copy(), blind.pose[2]
    world = blind.world
    at_work = Compass(compass)
    expected = float(at_work.expected(world, blind.pose[None], 2.0)[0])
    blind.values_at_stops["c1"] = {1: (expected + 1.5, 2.0)}
    blind.look(1)
    sides = np.array([[0.0, 0.0, heading + 0.5], [0.0, 0.0, heading - 0.5]])
    above, below = at_work.expected(world, sides, 2.0)
    slope = above - below
    bend = 0.5 * abs(above + below - 2 * expected)
    variance = (compass.error * (expected - compass.bias)) ** 2 + compass.absolute_error**2
    variance += bend**2 + 0.02**2
    gain = before[2, 2] * slope / (before[2, 2] * slope**2 + variance)
    assert blind.pose[2] - heading == pytest.approx(1.5 * gain, rel=1e-6)
    assert blind.covariance[2, 2] == pytest.approx(before[2, 2] * (1 - gain * slope), rel=1e-6)
    (off,) = blind.errors[type(at_work), 0]
    assert off == pytest.approx(1.5)
    blind.values_at_stops["c1"] = {1: (expected + 30.0, 2.0)}
    pose = blind.pose.copy()
    blind.look(1)
    assert blind.pose == pytest.approx(pose), "beyond the gate of four standard deviations"
    again = float(at_work.expected(world, blind.pose[None], 2.0)[0])
    assert blind.errors[type(at_work), 0][1] == pytest.approx(expected + 30.0 - again), "and yet an error"


@pytest.mark.slow  # test_learning.py keeps the predictions of a run
def test_predictions_are_better_with_what_was_learned(held: HeldBack) -> None:
    assert held.movements == 10
    assert held.learned.run.stops == 31
    errors = {(each.kind.name, each.ahead): each for each in held.errors}
    assert list(errors) == sorted(errors)
    assert errors["comp", 0].count == 10
    assert errors["comp", 5].count == 6
    assert errors["ultra", 0].after < 0.5
