"""Estimates of times, shares and faults, and their intervals: by hand, and as they were kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs
from scipy import stats

from simmer_tui.calibrate.estimates import (
    ParameterEstimate,
    estimates_of,
    line_through,
    share_interval,
    shown,
    timings,
)
from simmer_tui.calibrate.fit import Fit
from simmer_tui.calibrate.measured_run import Chain, MeasuredMovement, MeasuredRun, Readings
from simmer_tui.calibrate.model_check import mounting_spread, with_mounting
from simmer_tui.calibrate.parameters import parameters_of
from simmer_tui.calibrate.posterior import RANGE
from simmer_tui.calibrate.rows import Model
from simmer_tui.calibrate.stretches import (
    LEAST_DISTANCE,
    LEAST_TURN,
    VelocityStretch,
    prediction,
    share_of_variance,
)
from simmer_tui.sim.arcs import Twist
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.sensors import ParameterKind
from tests.calibrate.synthetic import START, Synthetic, make
from tests.kept_numbers import assert_kept

KEPT = Path(__file__).with_name("kept_estimates.json")
LINK = 0.08
"""Seconds there and back."""
RIGHT, ROT = 3, 4


@pytest.fixture(scope="module")
def known() -> Synthetic:
    return make(20)


def fields(estimates: Sequence[ParameterEstimate]) -> list[tuple[object, ...]]:
    return [
        (e.owner, e.field, e.label, e.unit, e.present, e.value, e.low, e.high, e.why_not, e.changed)
        for e in estimates
    ]


def driven(
    known: Synthetic, values: Sequence[float], took: Sequence[float], drive: int = RIGHT, **fields: float
) -> MeasuredRun:
    """A run of movements of one drive with these values and durations; `fields` of its row are changed."""
    spec = known.run.spec
    drives = tuple(
        structs.replace(each, **fields) if number == drive else each
        for number, each in enumerate(spec.drives)
    )
    configuration = structs.replace(known.run.configuration, simulation=structs.replace(spec, drives=drives))
    movements = [
        MeasuredMovement(drive, value, True, 2 + k, each)
        for k, (value, each) in enumerate(zip(values, took, strict=True))
    ]
    return replace(known.run, configuration=configuration, chains=(Chain(START, 1, movements),))


def by_name(run: MeasuredRun) -> dict[tuple[str, str], ParameterEstimate]:
    return {(each.owner, each.field): each for each in timings(run)}


# -- time ----------------------------------------------------------------------------------------------


def test_timings_of_a_noisy_link_are_those_that_were_kept(known: Synthetic) -> None:
    """Durations and gaps of all sensors, with some that are far too long, or not known."""
    random = np.random.default_rng(8)
    (chain,) = known.run.chains
    movements = [
        replace(
            each,
            took=float("nan") if k == 17 else each.took + abs(random.normal(0, 0.01)) + 0.5 * (k == 4),
            certain=k != 11,
        )
        for k, each in enumerate(make(60).run.chains[0].movements)
    ]
    readings = {
        code: replace(each, gaps=each.gaps + 0.01 * n + np.abs(random.normal(0, 0.02, len(each.gaps))))
        for n, (code, each) in enumerate(known.run.readings.items())
    }
    readings["u2"] = replace(readings["u2"], gaps=np.where(np.arange(21) < 14, np.nan, 0.1))
    readings["g1"] = replace(readings["g1"], gaps=np.full(21, 0.05))  # less than the link alone takes
    run = replace(known.run, chains=(replace(chain, movements=movements),), readings=readings)
    assert_kept(fields(timings(run)), KEPT, "timings")
    drives = tuple(
        structs.replace(each, start_lag=0.1) if k % 2 else structs.replace(each, acceleration=20.0)
        for k, each in enumerate(run.spec.drives)
    )
    sensors = tuple(
        structs.replace(each, read_time=0.01 * k, enabled=k != 2) for k, each in enumerate(run.spec.sensors)
    )
    drives = (drives[0], structs.replace(drives[1], enabled=False), *drives[2:])
    spec = structs.replace(run.spec, drives=drives, sensors=sensors)
    slow = replace(run, configuration=structs.replace(run.configuration, simulation=spec))
    assert_kept(fields(timings(slow)), KEPT, "timings_with_lags")
    assert_kept(fields(timings(driven(known, [2.0] * 7, [0.3] * 7))), KEPT, "timings_of_one_drive")


def test_a_speed_is_the_inverse_of_the_slope_of_durations(known: Synthetic) -> None:
    """Without errors of the clock, its interval is from half a millisecond over the values' spread."""
    values = np.linspace(1.0, 8.0, 8)
    found = by_name(driven(known, values.tolist(), (LINK + values / 7.0).tolist()))
    error = 5e-4 / (7.0 / np.sqrt(12.0) * np.sqrt(8.0))
    speed = found["right", "speed"]
    assert speed.unit == "in/s"
    assert (speed.value, speed.low, speed.high) == pytest.approx(
        (7.0, 7.0 - 98.0 * error, 7.0 + 98.0 * error), rel=1e-6
    )
    constant_error = max(np.hypot(error * 4.5, 3e-4), 5e-4)
    latency = found["link", "latency"]
    assert (latency.value, latency.low, latency.high) == pytest.approx(
        (LINK / 2, LINK / 2 - constant_error, LINK / 2 + constant_error), rel=1e-6
    )


@pytest.mark.parametrize(("count", "is_enough"), [(7, False), (8, True)])
def test_a_speed_takes_eight_durations(known: Synthetic, count: int, is_enough: bool) -> None:
    values = np.linspace(1.0, 8.0, count)
    found = by_name(driven(known, values.tolist(), (LINK + values / 7.0).tolist()))
    assert found["right", "speed"].identified is is_enough
    if not is_enough:
        assert found["right", "speed"].why_not == "d1 was answered only 7 times"
        assert found["link", "latency"].why_not == "no drive was answered often enough"
        assert found["ultra1", "read_time"].why_not == "the link's latency, which is part of it, is not known"
    assert found["up", "speed"].why_not == "no command was sent to drive left (+Y) (w1)"


@pytest.mark.parametrize(("slope", "is_line"), [(3.9, False), (4.1, True)])
def test_durations_show_a_speed_from_four_standard_errors_on(
    known: Synthetic, slope: float, is_line: bool
) -> None:
    values = np.linspace(1.0, 8.0, 8)
    error = 5e-4 / (7.0 / np.sqrt(12.0) * np.sqrt(8.0))
    found = by_name(driven(known, values.tolist(), (LINK + values * slope * error).tolist()))
    assert found["right", "speed"].identified is is_line
    if not is_line:
        why = "the durations of movements do not show it; drive short and long ones"
        assert found["right", "speed"].why_not == found["link", "latency"].why_not == why


def test_with_a_lag_only_the_latency_is_estimated(known: Synthetic) -> None:
    """It is the median beyond the planned durations, its interval by 1.85 median deviations."""
    values = np.full(8, 6.0)
    off = 0.001 * np.array([-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0])
    lagged = driven(known, values.tolist(), (LINK + off + 0.25 + 6.0 / 5.0).tolist(), start_lag=0.25, speed=5)
    found = by_name(lagged)
    assert found["right", "speed"].why_not == "the set has a start lag or an acceleration for it"
    latency = found["link", "latency"]
    error = 1.85 * 0.0025 / np.sqrt(8.0) + 3e-4
    assert (latency.value, latency.high - latency.value) == pytest.approx((LINK / 2, error))


def test_latencies_of_drives_count_by_their_precision(known: Synthetic) -> None:
    values = np.linspace(1.0, 8.0, 8)
    one = driven(known, values.tolist(), (LINK + values / 7.0).tolist())
    other = driven(known, (10 * values).tolist(), (LINK + 0.02 + values).tolist(), ROT)
    run = replace(one, chains=(*one.chains, *other.chains))
    errors = [
        np.hypot(5e-4 / (7.0 * factor / np.sqrt(12.0) * np.sqrt(8.0)) * 4.5 * factor, 3e-4)
        for factor in (1, 10)
    ]
    weights = np.square(errors) ** -1.0
    latency = by_name(run)["link", "latency"]
    assert latency.value == pytest.approx((LINK + 0.02 * weights[1] / weights.sum()) / 2)
    assert latency.high - latency.value == pytest.approx(max(weights.sum() ** -0.5, 5e-4), rel=1e-6)


@pytest.mark.parametrize(("count", "taken"), [(7, 0), (8, 4), (19, 4), (20, 5), (40, 10)])
def test_a_read_time_is_the_mean_of_the_shortest_quarter_of_gaps(
    known: Synthetic, count: int, taken: int
) -> None:
    """Of four at the least; its interval has their error, twice the latency's and half a millisecond."""
    values = np.linspace(1.0, 8.0, 8)
    run = driven(known, values.tolist(), (LINK + values / 7.0).tolist())
    gaps = LINK + 0.1 + 0.02 * np.arange(count)
    mixed = np.concatenate((np.random.default_rng(2).permutation(gaps), [np.nan] * 3))
    stops = np.arange(count + 3)
    run = replace(run, readings={"u1": Readings(stops, 1.0 * stops, 2.0 * stops, mixed)})
    found = by_name(run)
    read = found["ultra1", "read_time"]
    if not taken:
        assert read.why_not == "u1 was seldom read right after another answer"
        return
    quick = 0.1 + 0.02 * np.arange(taken)
    link_error = found["link", "latency"].high - found["link", "latency"].value
    half = 2 * quick.std() / np.sqrt(taken) + 2 * max(link_error, 5e-4) + 5e-4
    assert (read.value, read.high) == pytest.approx((quick.mean(), quick.mean() + half), rel=1e-6)
    assert read.low == pytest.approx(max(quick.mean() - half, 0.0))


def test_a_line_follows_most_points() -> None:
    random = np.random.default_rng(4)
    x = np.linspace(0.0, 10.0, 15)
    y = 0.3 + 0.2 * x + 0.05 * random.standard_normal(15)
    y[[3, 8]] += (2.0, -1.0)
    found = {"noisy": line_through(x, y), "exact": line_through(x, 1.0 + 2.0 * x)}
    found["one"] = line_through(np.full(9, 3.0), y[:9])
    assert_kept(found, KEPT, "lines")


# -- shares, faults, numbers ---------------------------------------------------------------------------


@pytest.mark.parametrize(("hits", "begins_at_zero"), [(0.0, True), (0.49, True), (0.5, False), (1.0, False)])
def test_a_share_without_half_a_hit_may_be_zero(hits: float, begins_at_zero: bool) -> None:
    low, high = share_interval(hits, 30)
    ends = stats.beta.ppf((0.025, 0.975), hits + 0.5, 30.5 - hits)
    assert (low, high) == pytest.approx((0.0 if begins_at_zero else ends[0], ends[1]))


@pytest.mark.parametrize(
    ("value", "low", "high", "text"),
    [
        (1.23456, 1.0, 1.5, ("1.23", "1.00", "1.50")), (12.3456, 5.0, 20.0, ("12.3", "5.0", "20.0")),
        (123.4, 100.0, 150.0, ("123", "100", "150")), (0.5, 0.5, 0.5, ("0.5000", "0.5000", "0.5000")),
        (1e-9, 0.0, 2e-9, ("0.000000", "0.000000", "0.000000")), (1.5, -18.5, 21.5, ("2", "-18", "22")),
        (0.5, 0.4, 0.6, ("0.50", "0.40", "0.60")), (0.5, 0.0, 2.0, ("0.5", "0.0", "2.0")),
    ],
)  # fmt: skip
def test_a_number_is_shown_to_two_digits_of_its_error(
    value: float, low: float, high: float, text: tuple[str, str, str]
) -> None:
    assert shown(value, low, high) == text


def test_an_estimate_has_changed_if_the_set_is_outside_its_interval() -> None:
    one = ParameterEstimate("up", "speed", "speed", "in/s", 5.0, 6.0, 5.0, 7.0)
    assert not one.changed
    assert not replace(one, present=7.0).changed
    assert replace(one, present=4.99).changed
    assert replace(one, present=7.01).changed
    unknown = replace(one, present=9.0).unidentified("no data")
    assert (unknown.value, unknown.low, unknown.high, unknown.identified) == (9.0, 9.0, 9.0, False)
    assert not unknown.changed
    about = one.about(0.25, 0.5)
    assert (about.value, about.low, about.high) == (0.25, 0.0, 0.75)
    assert one.shown == ("6.0", "5.0", "7.0")


def fit_at(made: Synthetic, **changed: object) -> Fit:
    """A fit that has found the truth, with all parameters but those of up and ultra2 identified."""
    space, state = made.model.space, made.truth
    rows = made.model.rows(state)
    told = np.array([each.owner not in ("up", "ultra2") for each in space.parameters])
    scales_told = np.array([each.owner != "up" for each in space.noise_scales])
    errors = 0.1 * np.array([each.spread for each in space.parameters])
    scale_errors = np.linspace(0.2, 0.6, len(space.noise_scales))
    none: FloatArray = np.zeros(0)
    fit = Fit(
        made.run, space, state, none, errors, scale_errors, told, scales_told, rows, none, none, made.model
    )
    return replace(fit, **changed)  # type: ignore[arg-type]


def test_estimates_of_a_fit_are_those_that_were_kept() -> None:
    """Of a run whose sensors miss a wall now and then; one saw none at all, and two were not read."""
    made = make(36)
    readings = {code: each for code, each in made.run.readings.items() if code not in ("t1", "o4")}
    readings["u1"] = replace(readings["u1"], values=np.where(np.arange(37) % 9 == 4, np.inf, 12.0))
    readings["u2"] = replace(readings["u2"], values=np.where(np.arange(37) % 2 == 1, np.inf, 12.0))
    readings["u5"] = replace(readings["u5"], values=np.full(37, np.inf))
    scales = made.truth.noise_scales.copy()
    scales[:4] *= (0.5, 2.0, 0.9, 1.3)
    run = replace(made.run, readings=readings)
    model = Model(run, parameters_of(run))
    rows = model.rows(made.truth)
    rows = replace(rows, weights=np.where(np.arange(len(rows.weights)) % 11 == 5, 0.25, rows.weights))
    truth = replace(made.truth, noise_scales=scales)
    fit = replace(fit_at(made), run=run, model=model, state=truth, rows=rows)
    assert_kept(fields(estimates_of(fit)), KEPT, "estimates")


@pytest.mark.parametrize(("facing", "is_enough"), [(29, False), (30, True)])
def test_dropouts_take_thirty_walls_within_nine_tenths_of_the_range(facing: int, is_enough: bool) -> None:
    made = make(36)
    fit = fit_at(made)
    index = next(i for i, each in enumerate(made.run.spec.sensors) if each.code == "u1")
    near = fit.model.expected(fit.state, index, made.run.readings["u1"].stops)
    order = np.sort(near)
    middle = 0.5 * (order[facing - 1] + order[facing])
    sensors = tuple(
        structs.replace(each, max_range=float(middle) / 0.9) if number == index else each
        for number, each in enumerate(made.run.spec.sensors)
    )
    spec = structs.replace(made.run.spec, sensors=sensors)
    configuration = structs.replace(made.run.configuration, simulation=spec)
    values = np.where(near > middle, np.inf, made.run.readings["u1"].values)
    values[int(near.argmin())] = np.inf
    read = {**made.run.readings, "u1": replace(made.run.readings["u1"], values=values)}
    run = replace(made.run, configuration=configuration, readings=read)
    model = Model(run, made.model.space)
    found = {(each.owner, each.field): each for each in estimates_of(replace(fit, run=run, model=model))}
    dropout = found["ultra1", "dropout"]
    assert dropout.identified is is_enough
    if is_enough:
        assert (dropout.value, dropout.low, dropout.high) == pytest.approx((1 / 30, *share_interval(1, 30)))
    else:
        assert dropout.why_not == "u1 faced a wall within range only 29 times"
    seen = int(((fit.rows.family == RANGE) & (fit.rows.source == index)).sum())
    assert found["ultra1", "outlier"].identified is (seen >= 30)


def test_noise_too_small_to_see_is_told_with_its_limit() -> None:
    """From a spread of 0.4 of its logarithm its interval begins at 0."""
    made = make(12)
    space = made.model.space
    chosen = [n for n, each in enumerate(space.noise_scales) if each.owner == "comp1"]
    zero = tuple(
        structs.replace(each, error=0.0, absolute_error=0.0) if each.id == "comp1" else each
        for each in made.run.spec.sensors
    )
    for spread, low in ((0.399, 0.5), (0.401, 0.0)):
        errors = np.full(len(space.noise_scales), spread)
        scales = made.truth.noise_scales.copy()
        scales[chosen] = 0.5
        fit = fit_at(made, noise_scale_errors=errors, state=replace(made.truth, noise_scales=scales))
        found = {(each.owner, each.field): each for each in estimates_of(fit)}
        each = found["comp1", "absolute_error"]
        assert each.low == pytest.approx(low * np.exp(-1.959964 * spread))
        assert each.high == pytest.approx(0.5 * np.exp(1.959964 * spread))
        spec = structs.replace(made.run.spec, sensors=zero)
        configuration = structs.replace(made.run.configuration, simulation=spec)
        run = replace(made.run, configuration=configuration)
        fit = replace(fit, run=run, space=parameters_of(run))
        found = {(each.owner, each.field): each for each in estimates_of(fit)}
        why = found["comp1", "absolute_error"].why_not
        limit = 0.5 * np.exp(1.959964 * spread)
        expected = "" if low else f"too small to distinguish from 0: at most {limit:.2g} deg"
        assert why == expected


# -- mounting ------------------------------------------------------------------------------------------


def test_offsets_are_of_the_mounting_if_chance_has_less_than_one_in_twenty() -> None:
    """The limit is the 95 % quantile of chi-square with six degrees of freedom, 12.5916."""
    space = make(2).model.space
    offsets = [n for n, each in enumerate(space.parameters) if each.kind is ParameterKind.OFFSET]
    values, errors = np.zeros(len(space.parameters)), np.full(len(space.parameters), 0.5)
    told = np.ones(len(values), bool)
    for size, spread in ((12.58, 0.0), (12.60, np.sqrt(0.25 * (12.60 / 6 - 1.0)))):
        values[offsets] = 0.5 * np.sqrt(size / 6)
        assert mounting_spread(space, values, errors, told)[0] == pytest.approx(spread)
        assert (with_mounting(space, values, errors, told) is errors) is (not spread)
    told[offsets] = False
    assert mounting_spread(space, values, errors, told) == (0.0, 0.0)


# -- stretches -----------------------------------------------------------------------------------------


def test_variances_and_predictions_of_stretches_are_those_that_were_kept() -> None:
    lengths = np.array([0.0, 1e-6, 0.005, 0.0119, 0.0121, 0.1, 0.5, 3.0, -6.0, 12.0, 24.0, 90.0, 400.0])
    found = {
        f"turns {turns}": (share_of_variance(lengths, turns=turns), *prediction(lengths, turns=turns))
        for turns in (False, True)
    }
    mixed = share_of_variance(lengths, turns=np.arange(13) % 2 == 0)
    assert_kept({**found, "mixed": mixed}, KEPT, "stretches")


def test_stops_of_continuous_motion_are_apart_by_varied_distances() -> None:
    """The k-th is later by 0.4 times the fraction of k times the golden ratio."""
    drives = make(2).run.spec.drives
    for twist, least in ((Twist(1.0, 0.0, 0.0), LEAST_DISTANCE), (Twist(0.0, 0.0, -10.0), LEAST_TURN)):
        stretch = VelocityStretch(drives)
        speed = abs(twist.x or twist.r)
        for number in range(1, 9):
            limit = least * (1.0 + 0.4 * (number * 0.618034 % 1.0))
            assert not stretch.has_moved
            stretch.drive(twist, (limit - 1e-6) / speed)
            assert stretch.has_moved
            assert not stretch.is_long
            stretch.drive(twist, 2e-6 / speed)
            assert stretch.is_long
            stretch.clear()
    stretch.drive(twist, 0.0)
    stretch.drive(twist, -1.0)
    assert not stretch.has_moved
    assert stretch.asked == (0.0, 0.0, 0.0)
