"""The model's rows, their derivatives and variances, against what follows on paper from a made-up run."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs
from scipy import stats

from simmer_tui.calibrate.change_detection import spread_between_robots
from simmer_tui.calibrate.estimates import line_through, share_interval, timings
from simmer_tui.calibrate.find_path import PathFinder
from simmer_tui.calibrate.guided import learned_worst_case, worst_case
from simmer_tui.calibrate.posterior import (
    COUNTER,
    KINEMATIC,
    OBSERVATION,
    PRIOR,
    PROCESS,
    RANGE,
    START_POSE,
    Iterate,
    Posterior,
    Rows,
    noise_scale_score,
    outliers_in,
)
from simmer_tui.calibrate.rows import LONGEST_COUNT, PER_STOP, Model, huber_weights, inlier_probability
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.sensors import ObservingSensor, sensor_of
from tests.calibrate.synthetic import STEP_TIME, Synthetic, make


@pytest.fixture(scope="module")
def known() -> Synthetic:
    return make()


def of(rows: Rows, family: int, source: int | None = None) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    chosen = rows.family == family
    return np.flatnonzero(chosen if source is None else chosen & (rows.source == source))


def index_of(known: Synthetic, name: str) -> int:
    return next(i for i, each in enumerate(known.run.spec.sensors) if each.id == name)


# -- residuals and variances -------------------------------------------------------------------------


def test_process_rows_are_the_errors_that_were_drawn(known: Synthetic) -> None:
    rows = known.model.rows(known.truth)
    drives = known.run.spec.drives
    mine = of(rows, PROCESS).reshape(3, -1)  # an axis each, by drive
    order = np.argsort([each.drive for each in known.run.movements], kind="stable")
    assert rows.residuals[mine] == pytest.approx(known.totals_off[order].T, abs=1e-12)
    for axis, name in enumerate("xyr"):
        for row, number in zip(mine[axis], order, strict=True):
            movement = known.run.movements[number]
            drive = drives[movement.drive]
            d = movement.value * (-1 if drive.kind.value in ("left", "down") else 1)
            spread = d * (1 + getattr(drive.bias, name)) * getattr(drive.error, name)
            assert rows.variances[row] == pytest.approx(spread**2 + 1e-6)
            assert rows.stop[row] == number
            assert rows.source[row] == movement.drive


def test_a_movement_without_an_answer_may_be_off_by_all_of_it(known: Synthetic) -> None:
    chain = known.run.chains[0]
    unsure = [replace(chain.movements[0], certain=False), *chain.movements[1:]]
    model = Model(replace(known.run, chains=(replace(chain, movements=unsure),)), known.model.space)
    more = model.rows(known.truth).variances - known.model.rows(known.truth).variances
    first = np.flatnonzero(more)
    assert more[first] == pytest.approx([chain.movements[0].value ** 2] * 3)
    assert set(model.rows(known.truth).family[first]) == {PROCESS}


def test_kinematic_constraints_hold_at_the_truth(known: Synthetic) -> None:
    rows = known.model.rows(known.truth)
    mine = of(rows, KINEMATIC).reshape(3, -1)
    assert np.abs(rows.residuals[mine]).max() < 1e-12
    assert np.sqrt(rows.variances[mine][:, 0]) == pytest.approx([0.002, 0.002, 0.003])


def test_after_a_contact_only_the_distance_is_open(known: Synthetic) -> None:
    met = known.truth.contacts.copy()
    met[:] = True
    chain = known.truth.chain.copy()
    # The first movement (back by 3 in) ends after half of its path.
    chain[1, :3] = (chain[0, :3] + chain[1, :3]) / 2
    rows = known.model.rows(replace(known.truth, chain=chain, contacts=met))
    mine = of(rows, KINEMATIC).reshape(3, -1)
    assert np.abs(rows.residuals[mine][:2, 0]).max() < 1e-3
    length = math.hypot(*(known.truth.chain[1, :2] - known.truth.chain[0, :2]))
    turn = abs(chain[0, 5])
    expected = [0.4 * length + 0.5, 0.1 * length + 0.4, 0.4 * turn + 0.3]
    assert np.sqrt(rows.variances[mine][:, 0]) == pytest.approx(expected)
    # A disc completes its turn on the spot, wherever it is pushed.
    assert np.sqrt(rows.variances[mine][:, 1]) == pytest.approx([1.0, 1.0, 0.3])


def test_encoders_count_what_the_wheels_do(known: Synthetic) -> None:
    rows = known.model.rows(known.truth)
    for name in ("odom1", "odom2", "odom3", "odom4"):
        index = index_of(known, name)
        sensor = known.run.spec.sensors[index]
        mine = of(rows, COUNTER, index)
        off = np.diff(known.readings_off[sensor.code])
        assert rows.residuals[mine] == pytest.approx(off, abs=1e-9)
        angle, chain = math.radians(sensor.rotation), known.truth.chain[:-1]
        straight = math.cos(angle) * chain[:, 3] + math.sin(angle) * chain[:, 4]
        lever = math.pi / 180 * (sensor.x * math.sin(angle) - sensor.y * math.cos(angle))
        squares = straight**2 + (lever * chain[:, 5]) ** 2
        variance = (sensor.gain * sensor.error) ** 2 * squares / 4 + 0.002**2
        variance += 2 * sensor.absolute_error**2 + (sensor.gain / 50) ** 2 / 6
        assert rows.variances[mine] == pytest.approx(variance)


def test_a_gyro_counts_the_turn_that_was_made(known: Synthetic) -> None:
    index = index_of(known, "gyro1")
    sensor = known.run.spec.sensors[index]
    rows = known.model.rows(known.truth)
    mine = of(rows, COUNTER, index)
    assert rows.residuals[mine] == pytest.approx(np.diff(known.readings_off["g1"]), abs=1e-9)
    variance = (sensor.gain * sensor.error * known.truth.chain[:-1, 5]) ** 2 / 4
    variance += 0.02**2 * STEP_TIME + 0.003**2 + 2 * sensor.absolute_error**2 + 0.05**2 / 6
    assert rows.variances[mine] == pytest.approx(variance)


@pytest.mark.parametrize(("apart", "rows_more"), [(LONGEST_COUNT, 1), (LONGEST_COUNT + 1, 0)])
def test_counters_are_compared_over_six_movements_at_most(
    known: Synthetic, apart: int, rows_more: int
) -> None:
    index = index_of(known, "odom1")
    readings = known.run.readings["o1"]
    kept = np.isin(readings.stops, (3, 3 + apart))
    sparse = replace(
        readings, stops=readings.stops[kept], values=readings.values[kept], times=readings.times[kept]
    )
    run = replace(known.run, readings={**known.run.readings, "o1": sparse})
    rows = Model(run, known.model.space).rows(known.truth)
    mine = of(rows, COUNTER, index)
    assert len(mine) == rows_more
    off = known.readings_off["o1"]
    assert rows.residuals[mine] == pytest.approx([off[3 + apart] - off[3]] * rows_more, abs=1e-9)


def test_ranges_have_the_errors_that_were_drawn(known: Synthetic) -> None:
    rows = known.model.rows(known.truth)
    seen = 0
    for index, sensor in enumerate(known.run.spec.sensors):
        if not sensor.kind.is_range:
            continue
        mine = of(rows, RANGE, index)
        stops = rows.stop[mine]
        assert rows.residuals[mine] == pytest.approx(known.readings_off[sensor.code][stops], abs=1e-9)
        true = known.model.expected(known.truth, index, stops)
        expected = (sensor.error * (true - sensor.bias)) ** 2 + sensor.absolute_error**2
        expected += 0.02**2 + 0.1**2 / 12
        # A bend of the range comes on top: nowhere less, and nothing where a wall is met squarely.
        more = rows.variances[mine] - expected
        assert more.min() > -1e-12
        assert np.median(more / expected) < 0.5
        margin = 2.5 * np.sqrt(rows.variances[mine])
        assert (true + margin < 70.0).all()
        seen += len(mine)
    assert seen > 200


def test_ranges_near_a_limit_are_left_out(known: Synthetic) -> None:
    index = index_of(known, "ultra1")
    true = known.model.expected(known.truth, index, np.arange(41))
    limit = float(np.median(true))
    sensors = list(known.run.spec.sensors)
    sensors[index] = structs.replace(sensors[index], max_range=limit)
    configuration = structs.replace(
        known.run.configuration, simulation=structs.replace(known.run.spec, sensors=tuple(sensors))
    )
    model = Model(replace(known.run, configuration=configuration), known.model.space)
    rows = model.rows(known.truth)
    mine = of(rows, RANGE, index)
    kept = true[rows.stop[mine]]
    assert 0 < len(mine) < 25
    assert (kept + 2.5 * np.sqrt(rows.variances[mine]) < limit).all()


def test_low_sensors_say_nothing_once_the_block_was_moved(known: Synthetic) -> None:
    moved = Model(replace(known.run, block_moved_at=4), known.model.space).rows(known.truth)
    low = index_of(known, "ultra5")
    assert known.run.spec.sensors[low].z < known.run.spec.block_size
    assert moved.stop[of(moved, RANGE, low)].max() <= 4
    high = index_of(known, "ultra1")
    assert moved.stop[of(moved, RANGE, high)].max() > 4


def test_a_compass_has_the_errors_that_were_drawn(known: Synthetic) -> None:
    index = index_of(known, "comp1")
    sensor = known.run.spec.sensors[index]
    rows = known.model.rows(known.truth)
    mine = of(rows, OBSERVATION, index)
    assert rows.residuals[mine] == pytest.approx(known.readings_off["c1"], abs=1e-9)
    heading = known.truth.chain[:, 2]
    variance = (0.004 * heading) ** 2 + sensor.absolute_error**2 + 0.05**2
    assert rows.variances[mine] == pytest.approx(variance)
    # By hand: 5 sin h + 2 sin 2h at the start, 20 degrees, and the bias of 4.
    expected = 20 + 5 * math.sin(math.radians(20)) + 2 * math.sin(math.radians(40)) + 4
    assert known.model.expected(known.truth, index, np.array([0]))[0] == pytest.approx(expected)
    # Whole turns between what the robot counts and what it says are of no account.
    readings = known.run.readings["c1"]
    turned = replace(known.run, readings={"c1": replace(readings, values=readings.values - 720.0)})
    again = Model(turned, known.model.space).rows(known.truth)
    assert again.residuals[of(again, OBSERVATION)] == pytest.approx(known.readings_off["c1"], abs=1e-9)


def test_annealing_widens_what_observes(known: Synthetic) -> None:
    more = known.model.rows(known.truth, annealed=0.7).variances - known.model.rows(known.truth).variances
    rows = known.model.rows(known.truth)
    assert len(of(rows, COUNTER)) == 5 * 40
    assert more[of(rows, OBSERVATION)] == pytest.approx((5.0 * 0.7) ** 2)
    assert np.abs(more[of(rows, COUNTER)]).max() == 0.0


def test_starts_and_priors_are_what_the_set_says(known: Synthetic) -> None:
    chain = known.truth.chain.copy()
    chain[0, :3] += (0.3, -0.2, 1.5)
    chain[-1, 3:] = (0.1, 0.2, 0.3)
    parameters = known.truth.parameters + 0.01
    state = replace(known.truth, chain=chain, parameters=parameters)
    rows = known.model.rows(state)
    starts, priors = of(rows, START_POSE, -1), of(rows, PRIOR, -1)
    assert rows.residuals[starts] == pytest.approx([0.3, -0.2, 1.5, 0.1, 0.2, 0.3])
    assert rows.variances[starts] == pytest.approx([1.0, 1.0, 25.0, 1.0, 1.0, 1.0])
    assert rows.residuals[priors] == pytest.approx(0.01)
    spreads = {each.name: each.spread for each in known.model.space.parameters}
    assert rows.variances[priors] == pytest.approx(np.square(list(spreads.values())))
    assert spreads["right x-axis bias"] == 0.15
    assert spreads["right rotation bias"] == 0.8
    assert spreads["rot rotation bias"] == 0.1
    assert spreads["ultra2 gain"] == pytest.approx(0.1 * known.run.spec.sensors[1].gain)
    assert (spreads["ultra1 bias"], spreads["ultra1 mounting angle"]) == (1.5, 8.0)
    assert (spreads["comp1 bias"], spreads["gyro1 drift"]) == (30.0, 0.5)
    tight = np.zeros(len(parameters))
    held = known.model.rows(state, 0.0, tight)
    assert np.abs(held.residuals[of(held, PRIOR)]).max() == 0.0
    assert held.variances[of(held, PRIOR)] == pytest.approx(1e-14)


# -- derivatives -------------------------------------------------------------------------------------


def perturbed(known: Synthetic) -> Iterate:
    """A point where nothing is at its true value, with a few contacts."""
    random = np.random.default_rng(5)
    chain = known.truth.chain + 0.05 * random.standard_normal(known.truth.chain.shape)
    contacts = np.zeros(len(known.truth.contacts), bool)
    contacts[[2, 6, 11]] = True
    return replace(known.truth, chain=chain, contacts=contacts)


def moved_by(state: Iterate, step: FloatArray) -> Iterate:
    width = state.chain.size
    chain = state.chain + step[:width].reshape(state.chain.shape)
    return replace(state, chain=chain, parameters=state.parameters + step[width:])


@pytest.mark.parametrize("directions", [6, pytest.param(None, marks=pytest.mark.slow)])
def test_jacobians_are_those_of_finite_differences(directions: int | None) -> None:
    """Along some random directions, in which any wrong element shows, or one column after the other."""
    known = make(14)
    state = perturbed(known)
    rows = known.model.rows(state)
    jacobian = rows.jacobian.toarray()
    at_contact = np.isin(rows.stop, np.flatnonzero(state.contacts)) & (rows.family == KINEMATIC)
    # Range sensors have central differences of their own; at contacts the frame turns along, unseen.
    exact = ~at_contact & (rows.family != RANGE)
    step = 1e-5
    columns = jacobian.shape[1]
    random = np.random.default_rng(6)
    for direction in np.eye(columns) if directions is None else random.standard_normal((directions, columns)):
        sides = [known.model.rows(moved_by(state, sign * step * direction)).residuals for sign in (1, -1)]
        slope = (sides[0] - sides[1]) / (2 * step)
        assert jacobian[exact] @ direction == pytest.approx(slope[exact], abs=2e-6), direction


def test_derivatives_of_ranges_are_differences_over_what_poses_are_known_to(known: Synthetic) -> None:
    rows = known.model.rows(known.truth)
    index = index_of(known, "ultra2")
    sensor = sensor_of(known.run.spec.sensors[index])
    assert isinstance(sensor, ObservingSensor)
    mine = of(rows, RANGE, index)
    jacobian = rows.jacobian.toarray()[mine]
    world = known.model.world
    columns = known.model.space.of_sensor(index)
    width = known.truth.chain.size
    for row, stop in zip(jacobian, rows.stop[mine], strict=True):
        pose = known.truth.chain[stop, :3]
        for axis, step in enumerate((0.12, 0.12, 0.6)):
            shift = np.zeros(3)
            shift[axis] = step
            above, below = sensor.expected(world, np.array([pose + shift, pose - shift]), 0.0)
            assert row[PER_STOP * stop + axis] == pytest.approx(-(above - below) / (2 * step), abs=1e-9)
        true = sensor.true_values(world, pose[None])[0]
        assert row[width + columns["gain"]] == pytest.approx(-true)
        assert row[width + columns["bias"]] == -1.0
        turned = [
            sensor_of(structs.replace(sensor.spec, rotation=sensor.spec.rotation + sign * 0.6))
            for sign in (1, -1)
        ]
        above, below = (
            each.expected(world, pose[None], 0.0)[0] for each in turned if isinstance(each, ObservingSensor)
        )
        assert row[width + columns["rotation"]] == pytest.approx(-(above - below) / 1.2, abs=1e-9)


def test_shares_are_the_derivatives_of_variances_by_noise_scales(known: Synthetic) -> None:
    rows = known.model.rows(known.truth)
    shares = rows.shares.toarray()
    step = 1e-4
    # Along random directions, in which any wrong element shows.
    for direction in np.random.default_rng(6).standard_normal((6, shares.shape[1])):
        scales = known.truth.noise_scales * np.exp(step * direction)
        more = known.model.rows(replace(known.truth, noise_scales=scales)).variances
        slope = (more - rows.variances) / step / rows.variances
        assert 2 * shares @ direction == pytest.approx(slope, abs=2e-3)
    assert shares.max() <= 1.0


def test_weights_of_far_residuals() -> None:
    assert huber_weights(np.array([0.0, 4.0, 15.9, 64.0])) == pytest.approx([1.0, 1.0, 1.0, 0.5])
    squares, variances = np.array([0.0, 9.0, 4000.0]), np.array([0.04, 0.04, 0.04])
    normal = stats.norm.pdf([0.0, 0.6], scale=0.2)
    expected = 0.9 * normal / (0.9 * normal + 0.1 / 150.0)
    assert inlier_probability(squares, variances, 0.1, 150.0) == pytest.approx([*expected, 1e-6])


# -- least squares -----------------------------------------------------------------------------------


def test_the_posterior_is_that_of_dense_linear_algebra() -> None:
    known = make(6)
    rows = known.model.rows(perturbed_ends(known))
    posterior = Posterior(rows, known.model.width)
    scale = np.sqrt(rows.weights / rows.variances)
    whitened = scale[:, None] * rows.jacobian.toarray()
    normal = whitened.T @ whitened
    inverse = np.linalg.inv(normal)
    residuals = scale * rows.residuals
    step = -inverse @ (whitened.T @ residuals)
    assert posterior.step() == pytest.approx(step, rel=1e-5, abs=1e-7)
    width = known.model.width
    assert posterior.covariance() == pytest.approx(inverse[width:, width:], rel=1e-4, abs=1e-9)
    assert posterior.information == pytest.approx(np.linalg.inv(inverse[width:, width:]), rel=1e-3, abs=1e-2)
    vectors = np.random.default_rng(1).standard_normal((len(residuals), 3))
    projected = whitened @ inverse @ whitened.T @ vectors
    assert posterior.projected(vectors) == pytest.approx(projected, rel=1e-4, abs=1e-6)
    chosen = np.eye(len(normal))[:, -4:]
    assert posterior.sensitivities(chosen) == pytest.approx(whitened @ inverse @ chosen, rel=1e-4, abs=1e-6)
    spread = posterior.pose_spread(np.random.default_rng(2), draws=20_000)
    assert spread == pytest.approx(np.sqrt(np.diag(inverse))[:width], rel=0.05)
    damped = Posterior(rows, width, damping=0.5)
    normal[range(width), range(width)] *= 1.5
    assert damped.step() == pytest.approx(
        -np.linalg.solve(normal, whitened.T @ residuals), rel=1e-4, abs=1e-7
    )


def perturbed_ends(known: Synthetic) -> Iterate:
    random = np.random.default_rng(6)
    return replace(
        known.truth, chain=known.truth.chain + 0.02 * random.standard_normal(known.truth.chain.shape)
    )


def test_the_score_of_noise_scales_is_that_of_the_restricted_likelihood() -> None:
    known = make(8)
    state = replace(known.truth, noise_scales=1.3 * known.truth.noise_scales)
    rows = known.model.rows(state)
    posterior = Posterior(rows, known.model.width)
    scale = np.sqrt(rows.weights / rows.variances)
    whitened = scale[:, None] * rows.jacobian.toarray()
    hat = whitened @ np.linalg.inv(whitened.T @ whitened) @ whitened.T
    shares = rows.shares.toarray()
    excess = rows.weights * rows.residuals**2 / rows.variances - (rows.weights - np.diag(hat))
    space = known.model.space.noise_scales
    spreads, centres = (np.array([getattr(each, name) for each in space]) for name in ("spread", "prior"))
    prior = (np.log(state.noise_scales) - np.log(centres)) / spreads**2
    gradient = shares.T @ excess - prior
    left = np.diag(rows.weights) - hat
    information = 2 * shares.T @ (left**2) @ shares + np.diag(1 / spreads**2)
    random = np.random.default_rng(3)
    made = [noise_scale_score(known.model.space, state, rows, posterior, random) for _ in range(60)]
    scales = np.sqrt(np.diag(information))
    assert np.mean([each[0] for each in made], axis=0) / scales == pytest.approx(gradient / scales, abs=0.06)
    mean = np.mean([each[1] for each in made], axis=0)
    assert np.diag(mean) == pytest.approx(np.diag(information), rel=0.12)
    assert mean / np.outer(scales, scales) == pytest.approx(information / np.outer(scales, scales), abs=0.1)
    assert all((each[1] == each[1].T).all() for each in made)


def test_outliers_are_counted_with_half_a_reading_of_doubt(known: Synthetic) -> None:
    rows = known.model.rows(known.truth)
    index = index_of(known, "ultra1")
    mine = of(rows, RANGE, index)
    weights = rows.weights.copy()
    weights[of(rows, RANGE)] = 1.0
    weights[mine[:3]] = 0.0
    found = outliers_in(replace(rows, weights=weights), known.truth)
    assert found[index] == pytest.approx(3.5 / (len(mine) + 1))
    other = of(rows, RANGE, index_of(known, "ultra2"))
    assert found[index_of(known, "ultra2")] == pytest.approx(0.5 / (len(other) + 1))
    assert found[index_of(known, "comp1")] == 0.02, "only ranges are a mixture"


# -- the rough path ----------------------------------------------------------------------------------


def test_the_particle_filter_finds_the_path(known: Synthetic) -> None:
    finder = PathFinder(known.run)
    path = finder.find(known.run.chains[0], 0, 200, np.random.default_rng(4), wide=1.0)
    off = path.poses - known.truth.chain[:, :3]
    assert np.median(np.hypot(off[:, 0], off[:, 1])) < 0.5
    assert np.median(np.abs(off[:, 2])) < 2.0
    assert -2.2 < path.fit < -1.0
    assert path.contacts.sum() <= 4


def test_counters_that_were_not_read_at_both_stops_say_nothing(known: Synthetic) -> None:
    readings = dict(known.run.readings)
    for code in ("o1", "g1"):
        each = readings[code]
        odd = each.stops % 2 == 1
        readings[code] = replace(
            each, stops=each.stops[odd], values=each.values[odd], times=each.times[odd], gaps=each.gaps[odd]
        )
    finder = PathFinder(replace(known.run, readings=readings))
    path = finder.find(known.run.chains[0], 0, 100, np.random.default_rng(4), wide=1.0)
    off = path.poses - known.truth.chain[:, :3]
    assert np.median(np.hypot(off[:, 0], off[:, 1])) < 1.0


def test_a_guided_session_begins_with_errors_that_allow_for_any_robot(known: Synthetic) -> None:
    spec = known.run.spec
    wide = worst_case(spec)
    for drive, before in zip(wide.drives, spec.drives, strict=True):
        more = (0.006, 0.006, 0.04) if drive.kind.turns else (0.08, 0.08, 0.6)
        for axis, extra in zip("xyr", more, strict=True):
            expected = math.hypot(getattr(before.error, axis), extra)
            assert getattr(drive.error, axis) == pytest.approx(expected)
    sensors = {each.id: each for each in wide.sensors}
    assert (sensors["ultra1"].error, sensors["ultra1"].absolute_error) == (math.hypot(0.02, 0.05), 0.6)
    assert (sensors["comp1"].error, sensors["comp1"].absolute_error) == (0.0, 15.0)
    assert sensors["odom1"].error == 0.1
    learned = learned_worst_case(spec).drives[0]
    assert learned.error.x == pytest.approx(1.3 * spec.drives[0].error.x)
    assert learned.error.r == pytest.approx(1.3 * spec.drives[0].error.r + 0.01)


# -- intervals, lines, times --------------------------------------------------------------------------


def test_intervals_are_95_percent_ones(known: Synthetic) -> None:
    bias, error = known.model.space.parameters[0], known.model.space.noise_scales[0]
    z = stats.norm.ppf(0.975)
    assert bias.interval(1.0, 0.1) == pytest.approx((1.0 - 0.1 * z, 1.0 + 0.1 * z), abs=1e-7)
    assert error.interval(2.0, 0.1) == pytest.approx((2.0 * math.exp(-0.1 * z), 2.0 * math.exp(0.1 * z)))


@pytest.mark.parametrize(("hits", "count"), [(3, 50), (20, 60), (0.5, 40), (50, 50)])
def test_shares_have_jeffreys_intervals(hits: float, count: int) -> None:
    ends = stats.beta.ppf((0.025, 0.975), hits + 0.5, count - hits + 0.5)
    assert share_interval(hits, count) == pytest.approx(tuple(ends))
    assert share_interval(0, 50) == pytest.approx((0.0, stats.beta.ppf(0.975, 0.5, 50.5)))
    assert share_interval(0, 0) == (0.0, 1.0)


def test_a_line_goes_through_most_points() -> None:
    x = np.arange(24.0)
    noise = np.tile((0.01, -0.01, -0.01, 0.01), 6)
    y = 0.3 + 0.25 * x + noise
    constant, slope, error = line_through(x, y)
    assert (constant, slope) == pytest.approx((0.3, 0.25), abs=2e-3)
    assert error == pytest.approx(1.4826 * 0.01 / (23 / math.sqrt(12) * math.sqrt(24)), rel=0.1)
    y[5] += 4.0
    assert line_through(x, y)[:2] == pytest.approx((0.3, 0.25), abs=6e-3)


def test_times_are_those_of_the_made_up_robot(known: Synthetic) -> None:
    found = {(each.owner, each.field): each for each in timings(known.run)}
    for drive in known.run.spec.drives:
        speed = found[drive.kind.value, "speed"]
        assert speed.value == pytest.approx(drive.speed, rel=1e-3), "the clock's half a millisecond apart"
        assert speed.low <= drive.speed <= speed.high
    latency = found["link", "latency"]
    assert latency.value == pytest.approx(0.04, abs=1e-5), "half of the way there and back"
    errors = []
    for index in range(len(known.run.spec.drives)):
        values = np.array([abs(each.value) for each in known.run.movements if each.drive == index])
        slope_error = 5e-4 / (np.ptp(values) / math.sqrt(12) * math.sqrt(len(values)))
        errors.append(math.hypot(slope_error * values.mean(), 3e-4))
    both = 1 / math.sqrt(np.sum(1 / np.square(errors)))
    assert latency.high - latency.value == pytest.approx(both, rel=1e-3)
    read = found["ultra1", "read_time"]
    assert read.value == pytest.approx(0.03, abs=1e-5)
    assert read.high - read.value == pytest.approx(2 * both + 5e-4, rel=1e-3)


def test_strength_has_the_intervals_of_a_variance() -> None:
    values: FloatArray = np.array([[0.1, 0.0], [-0.1, 0.2], [0.05, -0.2], [0.02, 0.1], [-0.07, 0.05]])
    errors: FloatArray = np.full((5, 2), 0.03)
    scatter = values.var(axis=0, ddof=1).mean()
    low, high = 8 / stats.chi2.ppf((0.975, 0.025), 8)
    expected = [math.sqrt(each * scatter - 0.03**2) for each in (1.0, low, high)]
    assert spread_between_robots(values, errors) == pytest.approx(expected)
