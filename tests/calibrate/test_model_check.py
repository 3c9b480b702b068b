"""The tests of the model against what they are on paper, and what a robot that fails them is told."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats

from simmer_tui.calibrate.effects import (
    BLIND_SPOT,
    DRIVE_DRIFT,
    EVERY_DRIVE,
    IRON,
    SHORTFALL,
    WARMING,
    EffectKind,
    effects,
)
from simmer_tui.calibrate.estimates import estimates_of
from simmer_tui.calibrate.fit import Fit, fit, refit
from simmer_tui.calibrate.model_check import (
    FALSE_MISFIT_RATE,
    PREDICTION,
    Misfit,
    accepted,
    check_model,
    conformal_factor,
    held_back_misfits,
    mounting_spread,
    with_mounting,
)
from simmer_tui.calibrate.posterior import PROCESS, Posterior
from simmer_tui.calibrate.prediction import HeldBack, widened
from simmer_tui.calibrate.result_page import result_document
from simmer_tui.calibrate.rows import Model
from simmer_tui.document.as_data import document_value, plain
from simmer_tui.sim.sensors import ParameterKind, Ultrasonic, UltrasonicSpec, parameter_value, with_parameters
from tests.calibrate.synthetic import Synthetic, make
from tests.calibrate.test_kept_fit import known_fit

FAR = 1.25 * stats.norm.ppf(0.95)
ALONE = [np.array([number]) for number in range(3)]
"""Effects with a column each."""


@cache
def known() -> Synthetic:
    return make()


@pytest.fixture(scope="module")
def weakening() -> Fit:
    """A fit of a robot that was asked for what it did, but for a fifth that it lost from first to last."""
    run = known().run
    (chain,) = run.chains
    places = np.linspace(-0.5, 0.5, len(chain.movements))
    asked = [
        replace(each, value=each.value / (1.0 - 0.2 * place))
        for each, place in zip(chain.movements, places.tolist(), strict=True)
    ]
    made = known_fit(known())
    # From the true path: what finds one is tested elsewhere.
    return refit(made, replace(run, chains=(replace(chain, movements=asked),)))


# -- score tests ---------------------------------------------------------------------------------------


def test_terms_are_accepted_by_holm() -> None:
    information = np.diag([4.0, 9.0, 1.0])
    score = np.array([2.0, 15.0, 3.5])
    # Chi-squares of 1, 25 and 12.25.
    (first, p_first), (second, p_second) = accepted(score, information, ALONE, 0.01)
    assert (first, second) == (1, 2)
    assert p_first == pytest.approx(stats.chi2.sf(25.0, 1))
    assert p_second == pytest.approx(stats.chi2.sf(12.25, 1))
    assert accepted(score, information, ALONE, 2.01 * p_second)[1:] == [(2, p_second)]
    assert [number for number, _ in accepted(score, information, ALONE, 1.99 * p_second)] == [1]
    assert accepted(score, information, ALONE, 2.9 * p_first) == []


def test_an_effect_of_several_devices_is_accepted_by_all_its_columns() -> None:
    """Each has a chi-square of 9, too little for one of four tests. Together they have 27 in three."""
    score, information = np.full(3, 6.0), np.diag(np.full(3, 4.0))
    groups = [*ALONE, np.arange(3)]
    ((number, probability),) = accepted(score, information, groups, 1e-3)
    assert number == 3
    assert probability == pytest.approx(stats.chi2.sf(27.0, 3))


def test_a_term_that_another_explains_is_not_accepted() -> None:
    information = np.array([[4.0, 3.6], [3.6, 4.0]])
    # All of the second's score is that of the first, whose size is 5.
    assert [number for number, _ in accepted(np.array([20.0, 18.0]), information, ALONE[:2], 0.01)] == [0]
    # A second one of 30 explains 27 of the first: of 20 -7 is left, of an information of 4 - 3.6^2 / 4.
    first, (second, probability) = accepted(np.array([20.0, 30.0]), information, ALONE[:2], 0.01)
    assert (first[0], second) == (1, 0)
    assert probability == pytest.approx(stats.chi2.sf((20.0 - 0.9 * 30.0) ** 2 / 0.76, 1))


def test_a_term_is_that_of_dense_least_squares(weakening: Fit) -> None:
    model, state, rows = weakening.model, weakening.state, weakening.rows
    check = check_model(model, state, rows)
    (misfit,) = check.misfits
    assert (misfit.kind, misfit.owner) == (DRIVE_DRIFT.name, EVERY_DRIVE)
    column = np.zeros(len(rows.residuals))
    place = np.linspace(-0.5, 0.5, len(model.before))
    process = np.flatnonzero(rows.family == PROCESS)
    axes = np.repeat(np.arange(3), len(model.before))
    for row, axis in zip(process.tolist(), axes.tolist(), strict=True):
        movement = int(model.movement_at[rows.stop[row]])
        drive = model.run.spec.drives[model.run.movements[movement].drive]
        name = "xyr"[axis]
        along = abs(getattr(drive.kind.direction, name))
        owner = drive.kind.value
        bias = next(
            value
            for each, value in zip(weakening.space.parameters, state.parameters, strict=True)
            if (each.owner, each.field) == (owner, f"bias.{name}")
        )
        column[row] = place[movement] * model.amount[movement] * (along + bias)
    scale = np.sqrt(rows.weights / rows.variances)
    design = scale[:, None] * np.column_stack((rows.jacobian.toarray(), column))
    normal = design.T @ design
    step = -np.linalg.solve(normal, design.T @ (scale * rows.residuals))
    error = math.sqrt(np.linalg.inv(normal)[-1, -1])
    assert misfit.value == pytest.approx(step[-1], rel=1e-3)
    half = stats.norm.ppf(0.975) * error
    assert (misfit.low, misfit.high) == pytest.approx((step[-1] - half, step[-1] + half), rel=1e-3)


def test_a_robot_that_weakens_is_told_by_how_much(weakening: Fit) -> None:
    (misfit,) = weakening.misfits
    assert misfit.low < 0.2 < misfit.high
    assert misfit.probability < 0.01 / 11
    assert misfit.text.startswith("All drives: a loss of strength of ")
    # Its biases were a tenth more at the beginning, and a tenth less at the end.
    column = weakening.space.column(True, 3, "bias.x")
    assert 1.96 * weakening.standard_errors[column] > misfit.value / 2


@pytest.mark.slow
def test_a_robot_of_the_model_is_not_accused() -> None:
    assert fit(known().run).misfits == ()


@pytest.mark.parametrize(
    ("code", "kind", "owner", "size"),
    [("g", WARMING, "gyro", 0.3), ("c", IRON, "comp", 5.0)],
)
def test_an_effect_on_readings_is_told_with_its_size(
    code: str, kind: EffectKind, owner: str, size: float
) -> None:
    made = known()
    poses, turned = made.truth.chain, np.concatenate(([0.0], np.cumsum(made.truth.chain[:-1, 5])))
    readings = dict(made.run.readings)
    for name in (each for each in readings if each.startswith(code)):
        each = readings[name]
        values = {
            WARMING.name: np.cumsum(np.diff(turned, prepend=0.0) * (each.stops / 40.0 - 0.5)),
            IRON.name: np.sin(np.radians(poses[each.stops, 2])),
        }[kind.name]
        readings[name] = replace(each, values=each.values + size * values)
    model = Model(replace(made.run, readings=readings), made.model.space)
    misfit = check_model(model, made.truth, model.rows(made.truth)).misfits[0]
    assert (misfit.kind, misfit.owner.startswith(owner)) == (kind.name, True)
    assert misfit.low < 1.2 * size
    assert misfit.high > 0.8 * size


def test_an_effect_of_the_stated_size_would_have_been_found() -> None:
    """By the normal distribution of its score, at the level of one of all tests."""
    found = known_fit(known())
    check = check_model(found.model, found.state, found.rows)
    # No wall was near enough for one.
    assert BLIND_SPOT.name not in {each.kind for each in check.tests}
    (drift,) = [each for each in check.tests if each.kind == DRIVE_DRIFT.name]
    assert set(drift.devices) == {"up", "down", "left", "right", "rot"}
    tested = effects(found.model, found.state, found.rows)
    scale = np.sqrt(found.rows.weights / found.rows.variances)
    posterior = Posterior(found.rows, found.model.width)
    shares = []
    for each in (each for each in tested if each.kind is DRIVE_DRIFT and each.owner != EVERY_DRIVE):
        column = (scale * each.columns.T).T
        information = float((column.T @ (column - posterior.projected(column))).item())
        far = stats.norm.isf(FALSE_MISFIT_RATE / len(tested) / 2)
        shares.append(stats.norm.sf(far - drift.size * math.sqrt(information)))
    # The drive that shows it worst: none of the others needs a larger one.
    assert min(shares) == pytest.approx(0.9, abs=0.01)


# -- held-back readings --------------------------------------------------------------------------------


def test_predictions_hold_with_the_conformal_factor() -> None:
    random = np.random.default_rng(1)
    scores = random.permutation(np.arange(1.0, 50.0))
    # Of 49 the 45th is the one of which nine in ten are below, that to come included.
    value, low, high = conformal_factor(scores)
    assert value == pytest.approx(45.0 / stats.norm.ppf(0.95))
    assert low < value < high


def test_readings_are_surely_off_if_more_than_one_in_ten_is() -> None:
    def scores(far: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.array([FAR - 0.01] * (50 - far) + [FAR + 0.01] * far)

    # Of two kinds each has half of 1 %: 12 of 50 have a probability of 0.32 %, 11 of 0.94 %.
    (found,) = held_back_misfits({"ultra": scores(12), "comp": scores(11)})
    assert (found.owner, found.kind) == ("ultra", PREDICTION)
    assert found.probability == pytest.approx(stats.binom.sf(11, 50, 0.1))
    assert found.value == pytest.approx((FAR + 0.01) / stats.norm.ppf(0.95))
    assert held_back_misfits({"ultra": np.full(29, 9.0)}) == ()


def test_intervals_are_widened_by_the_factor(weakening: Fit) -> None:
    scores = np.full(40, 2.0 * stats.norm.ppf(0.95))
    wide = widened(weakening, HeldBack(10, weakening, (), {Ultrasonic: scores}))
    told = weakening.identified
    assert wide.standard_errors[told] == pytest.approx(2.0 * weakening.standard_errors[told])
    assert wide.standard_errors[~told] == pytest.approx(weakening.standard_errors[~told])
    assert wide.noise_scale_errors == pytest.approx(2.0 * weakening.noise_scale_errors)
    assert [each.kind for each in wide.misfits] == [DRIVE_DRIFT.name, PREDICTION]
    # Without a misfit they are widened as well, but never narrowed.
    for factor in (1.2, 0.8):
        better = widened(weakening, HeldBack(10, weakening, (), {Ultrasonic: 0.5 * factor * scores}))
        widths = better.standard_errors[told] / weakening.standard_errors[told]
        assert widths == pytest.approx(max(factor, 1.0))
        assert better.misfits == weakening.misfits


# -- how sensors are mounted ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rotation", "x", "y"), [(0.0, 3.0, 2.5), (90.0, 2.5, 2.0), (180.0, 3.0, 1.5), (-90.0, 3.5, 2.0)]
)
def test_an_offset_is_to_the_left_of_where_a_sensor_looks(rotation: float, x: float, y: float) -> None:
    spec = UltrasonicSpec(kind=Ultrasonic, number=1, code="u1", x=3.0, y=2.0)
    moved = with_parameters(spec, {"offset": 0.5, "rotation": rotation})
    assert (moved.x, moved.y, moved.rotation) == pytest.approx((x, y, rotation))
    assert parameter_value(moved, "offset", (3.0, 2.0)) == pytest.approx(0.5)
    assert parameter_value(moved, "rotation", (3.0, 2.0)) == rotation


@pytest.mark.parametrize("rotation", [0.0, 90.0, 180.0, 270.0])
def test_no_offset_is_shown_without_a_sign(rotation: float) -> None:
    spec = UltrasonicSpec(kind=Ultrasonic, number=1, code="u1", x=3.0, y=2.0, rotation=rotation)
    assert f"{parameter_value(spec, 'offset', (3.0, 2.0)):g}" == "0"


def test_biases_have_the_offset_along_from_those_across() -> None:
    space = known().model.space
    values, errors = np.ones(len(space.parameters)), np.full(len(space.parameters), 0.1)
    told = np.ones(len(values), bool)
    offsets = [n for n, each in enumerate(space.parameters) if each.kind is ParameterKind.OFFSET]
    values[offsets] = (0.3, -0.4, 0.5, 0.1, 0.2, 0.6)
    # The mean of the squares is 0.91 / 6, of which 0.01 is their error.
    spread, freedom = mounting_spread(space, values, errors, told)
    assert (spread, freedom) == (pytest.approx(math.sqrt(0.91 / 6 - 0.01)), 6)
    gain = space.column(False, 0, "gain")
    values[gain] = 2.0
    made = with_mounting(space, values, errors, told)
    half = stats.t.ppf(0.975, 6) / stats.norm.ppf(0.975) * spread
    bias = space.column(False, 0, "bias")
    assert made[bias] == pytest.approx(math.hypot(0.1, 2.0 * half))
    compass = next(n for n, each in enumerate(space.parameters) if each.name == "comp1 bias")
    assert made[compass] == 0.1
    values[offsets] = 0.1
    assert mounting_spread(space, values, errors, told) == (0.0, 0.0)
    assert with_mounting(space, values, errors, told) is errors


# -- the page ------------------------------------------------------------------------------------------


def test_the_answer_says_first_that_the_model_does_not_fit(weakening: Fit) -> None:
    made = plain(document_value(result_document(weakening, estimates_of(weakening), None)))
    assert list(made)[:2] == ["text", "misfits"]
    assert next(iter(made["text"])) == "fit"
    assert made["text"]["fit"].startswith("The model does not fit this robot")
    (row,) = made["misfits"]
    assert (row["part"], row["kind"]) == (EVERY_DRIVE, "drift")
    assert row["value_low"] < row["value"] < row["value_high"]
    good = plain(
        document_value(result_document(replace(weakening, misfits=()), estimates_of(weakening), None))
    )
    assert next(iter(good["text"])) == "fit"
    assert "misfits" not in good
    assert good["text"]["fit"].startswith("The model fits this robot")


@pytest.mark.parametrize(
    ("kind", "owner", "value", "text"),
    [
        (
            DRIVE_DRIFT,
            EVERY_DRIVE,
            0.2,
            "All drives: a loss of strength of 20.0% (15.0% to 25.0%) over the log.",
        ),
        (
            SHORTFALL,
            "up",
            -0.1,
            "Up: movements that end -0.10 in (-0.15 to -0.05) short, whatever their length.",
        ),
    ],
)
def test_what_does_not_fit_is_a_sentence(kind: EffectKind, owner: str, value: float, text: str) -> None:
    ends = (value - 0.05, value + 0.05)
    assert Misfit(kind.name, owner, value, *ends, kind.unit, 1e-5, kind.phrase).text == text


def test_the_derivative_by_an_offset_is_that_of_moving_the_sensor() -> None:
    synthetic = known()
    poses = synthetic.truth.chain[:, :3]
    for index in (0, 1):
        sensor = synthetic.model.sensor_at(synthetic.truth, index)
        assert isinstance(sensor, Ultrasonic)
        seen = sensor.linearised(synthetic.model.world, poses)
        aside = [
            Ultrasonic(with_parameters(sensor.spec, {"offset": sign * 0.01})).true_values(
                synthetic.model.world, poses
            )
            for sign in (1, -1)
        ]
        slope = (aside[0] - aside[1]) / 0.02
        smooth = seen.curvature < 1e-3
        assert smooth.sum() > 10
        assert seen.by_parameter["offset"][smooth] == pytest.approx(slope[smooth], abs=1e-6)
