"""Fits from a known path as they were kept, and the limits for paths, contacts, slips and misfits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from simmer_tui.calibrate.find_path import RoughPath
from simmer_tui.calibrate.fit import (
    Fit,
    fit,
    fit_path,
    fit_tail,
    lost_stretch,
    misplaced,
    refit,
    slips_in,
    start_state,
    with_contacts,
)
from simmer_tui.calibrate.measured_run import Chain, MeasuredRun, Readings
from simmer_tui.calibrate.model_check import (
    Misfit,
    check_model,
    held_back_misfits,
)
from simmer_tui.calibrate.parameters import parameters_of
from simmer_tui.calibrate.posterior import COUNTER, KINEMATIC, PROCESS, RANGE, Rows
from simmer_tui.calibrate.rows import Model
from simmer_tui.errors import CalibrationError
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.pose import Pose
from tests.calibrate.synthetic import START, Synthetic, make
from tests.kept_numbers import assert_kept

KEPT = Path(__file__).with_name("kept_fit.json")
DOWN, RIGHT, ROT = 1, 3, 4
EAST_WALL = 96.0


@cache
def known() -> Synthetic:
    return make(40)


@cache
def known_rows() -> Rows:
    return known().model.rows(known().truth)


def known_fit(made: Synthetic, run: MeasuredRun | None = None) -> Fit:
    """A fit that has the true path and nothing else."""
    run = run or made.run
    space, none = parameters_of(run), np.zeros(0)
    model, flags = Model(run, space), np.zeros(0, bool)
    return Fit(
        run, space, made.truth, none, none, none, flags, flags, model.rows(made.truth), none, none, model
    )


def difficult() -> MeasuredRun:
    """A run of a robot with outliers, missed walls, heavy tails of compass and gyro, a wheel that
    was seldom read, a sensor that was never read, a slip, two movements without an answer, and three by a
    velocity."""
    made = known()
    random = np.random.default_rng(12)
    readings = {code: each for code, each in made.run.readings.items() if code != "t1"}
    for code, each in readings.items():
        values = each.values.copy()
        if code in ("u1", "u2", "u3"):
            values[5::9] += 7.0
            values[3::11] = np.inf
        if code == "c1":
            values += 0.5 * random.standard_t(1.5, len(values)).clip(-20, 20)
        if code == "g1":
            values[[8, 23]] += (1.2, -1.2)
        kept = np.arange(len(values)) % (13 if code == "o2" else 1) == 0
        if code == "g1":
            kept[32:] = False  # 31 increments are enough for a test of their tails
        readings[code] = Readings(each.stops[kept], values[kept], each.times[kept], each.gaps[kept])
    (chain,) = made.run.chains
    movements = list(chain.movements)
    movements[13] = replace(movements[13], value=0.2 * movements[13].value)
    for number in (25, 30, 35):
        each = movements[number]
        parts = ((RIGHT, each.value),)
        movements[number] = replace(each, took=float("nan"), parts=parts, commanded=(each.value, 0.0, 0.0))
    for number in (20, 21):
        movements[number] = replace(movements[number], certain=False, took=float("nan"))
    return replace(made.run, chains=(replace(chain, movements=movements),), readings=readings)


def numbers(found: Fit) -> dict[str, object]:
    return {
        "parameters": found.state.parameters,
        "noise_scales": found.state.noise_scales,
        "chain": found.state.chain[::7],
        "contacts": np.flatnonzero(found.state.contacts),
        "slipped": np.flatnonzero(found.state.slipped),
        "outliers": found.state.outliers,
        "pose_spread": found.pose_spread[::7],
        "standard_errors": found.standard_errors,
        "noise_scale_errors": found.noise_scale_errors,
        "identified": found.identified,
        "noise_scales_identified": found.noise_scales_identified,
        "covariance": found.covariance @ (1.0 + np.cos(0.7 * np.arange(len(found.covariance)))),
        "information": found.information @ (1.0 + np.cos(0.7 * np.arange(len(found.information)))),
        "misfits": [structs_of(each) for each in found.misfits],
    }


def structs_of(misfit: Misfit) -> tuple[object, ...]:
    return (
        *(misfit.kind, misfit.owner, misfit.value, misfit.low, misfit.high),
        *(misfit.unit, misfit.probability, misfit.text),
    )


def test_a_fit_of_a_difficult_robot_is_that_which_was_kept() -> None:
    found = refit(known_fit(known()), difficult())
    assert not found.identified.all()
    assert found.state.slipped.any()
    assert_kept(numbers(found), KEPT, "difficult")


def test_a_path_and_its_end_for_fixed_parameters_are_those_that_were_kept() -> None:
    """From a path that is off by an inch and some degrees."""
    made = make(17)
    run, space = made.run, made.model.space
    chain = made.truth.chain.copy()
    chain[:, :3] += np.cos(1.7 * np.arange(54)).reshape(18, 3) * (0.6, 0.6, 2.0)
    parameters = made.truth.parameters + 0.01 * np.sin(np.arange(len(made.truth.parameters)))
    path = fit_path(run, space, parameters, 1.2 * made.truth.noise_scales, replace(made.truth, chain=chain))
    chain[9, 0] += 42.0  # a step moves a stop by 6 in at most
    far = fit_path(run, space, parameters, made.truth.noise_scales, replace(made.truth, chain=chain))
    pose, covariance = fit_tail(run, space, path)
    found = {"chain": path.chain, "contacts": path.contacts, "pose": pose, "covariance": covariance}
    found["far"] = far.chain[::3]
    assert path.parameters == pytest.approx(parameters, abs=1e-9)
    assert_kept(found, KEPT, "path")


def test_a_fit_starts_with_the_rough_paths_and_the_parameters_of_the_set() -> None:
    """Totals are those between its poses; of a movement with a contact they are the commanded ones."""
    made = make(7)
    (chain,) = made.run.chains
    chains = (Chain(START, 1, chain.movements[:4]), Chain(START, 9, chain.movements[4:]))
    sensors = tuple(
        structs.replace(each, outlier=0.015 * number) for number, each in enumerate(made.run.spec.sensors)
    )
    spec = structs.replace(made.run.spec, sensors=sensors)
    run = replace(
        made.run,
        chains=chains,
        configuration=structs.replace(made.run.configuration, simulation=spec),
        readings={},
    )
    model = Model(run, made.model.space)
    poses = made.truth.chain[:, :3]
    paths = [
        RoughPath(poses[:5], np.array([False, True, False, False]), -1.0),
        RoughPath(poses[4:], np.array([False, False, True]), -1.0),
    ]
    state = start_state(run, model, paths)
    assert state.chain[:5, :3].tolist() == poses[:5].tolist()
    assert state.chain[5:, :3].tolist() == poses[4:].tolist()
    assert np.flatnonzero(state.contacts).tolist() == [1, 6]
    assert not state.slipped.any()
    stops = [0, 2, 3, 5, 6]
    assert state.chain[stops, 3:] == pytest.approx(made.truth.chain[[0, 2, 3, 4, 5], 3:])
    for stop, movement in ((1, 1), (7, 6)):
        asked = chain.movements[movement].asked(run.spec.drives)
        assert state.chain[stop, 3:].tolist() == asked.tolist()
    assert not state.chain[[4, 8], 3:].any()
    assert state.outliers == pytest.approx(np.maximum(0.02, 0.015 * np.arange(len(sensors))))
    assert state.parameters.tolist() == [each.present for each in made.model.space.parameters]
    assert state.noise_scales.tolist() == [each.prior for each in made.model.space.noise_scales]


def test_a_contact_without_a_distance_has_the_frame_of_its_start() -> None:
    """Its totals are 0: the rows are how far it was pushed, ahead and aside, by (3, 4) in at 90 degrees."""
    made = known()
    chain, met = made.truth.chain.copy(), np.arange(40) == 7
    chain[7, 2:] = (90.0, 0.0, 0.0, 0.0)
    chain[8, :3] = chain[7, :3] + (3.0, 4.0, 1.0)
    rows = made.model.rows(replace(made.truth, chain=chain, contacts=met))
    mine = (rows.family == KINEMATIC) & (rows.stop == 7)
    assert rows.residuals[mine] == pytest.approx([4.0, -3.0, 1.0])
    slopes = rows.jacobian[np.flatnonzero(mine)][:, 48:51].toarray()
    assert slopes == pytest.approx(np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))


def test_expected_readings_have_no_drift() -> None:
    made = known()
    index = next(i for i, each in enumerate(made.run.spec.sensors) if each.code == "u3")
    drift, each = made.run.spec.sensors[index].drift, made.run.readings["u3"]
    expected = made.model.expected(made.truth, index, each.stops)
    assert expected + drift * each.times + made.readings_off["u3"] == pytest.approx(each.values, abs=1e-9)


# -- is the path the right one? ------------------------------------------------------------------------


@pytest.mark.parametrize(("count", "is_enough"), [(5, False), (6, True)])
def test_a_fit_takes_six_ranges(count: int, is_enough: bool) -> None:
    """With six it looks for a path, and finds none in a maze that has these ranges nowhere."""
    made = make(3)
    each = made.run.readings["u1"]
    values = np.concatenate((np.full(count - 2, 1.0), [np.inf] * 3))
    stops = np.minimum(np.arange(count + 1), 3)
    read = Readings(stops, values, 2.0 * stops, each.gaps[stops])
    other = Readings(np.arange(2), np.ones(2), np.arange(2.0), np.full(2, np.nan))
    run = replace(made.run, readings={"u1": read, "u2": other, "g1": made.run.readings["g1"]})
    told: list[tuple[str, float]] = []
    with pytest.raises(CalibrationError) as refusal:
        fit(run, progress=lambda what, share: told.append((what, share)))
    if not is_enough:
        assert str(refusal.value) == (
            "made up: no range sensor was read often enough to tell where the robot was; read all of them "
            "after each movement"
        )
        assert not told
        return
    assert str(refusal.value).startswith("made up: the robot's path was not found in 3 tries: ")
    assert str(refusal.value).endswith(
        "Check its start pose and its maze against the set, and that nobody moved it in between."
    )
    assert [each for each in told if each[0] == "finding the path"] == [
        ("finding the path", k / 4) for k in range(4)
    ] * 3


@pytest.mark.slow
def test_ranges_that_fit_no_path_are_a_reason() -> None:
    made = make(2)
    readings = {
        code: replace(each, values=np.array([1.0, 60.0, 2.0])) if code.startswith("u") else each
        for code, each in made.run.readings.items()
    }
    with pytest.raises(CalibrationError, match="in 3 tries: the ranges fit no path through the maze"):
        fit(replace(made.run, readings=readings))


def test_ranges_that_are_all_a_cell_too_long_fit_no_path() -> None:
    made = make(2)
    readings = {
        code: replace(each, values=each.values + 12.0) if code.startswith("u") else each
        for code, each in made.run.readings.items()
    }
    with pytest.raises(CalibrationError, match="in 3 tries: the ranges fit no path through the maze"):
        fit(replace(made.run, readings=readings))


@pytest.mark.parametrize(
    ("off", "said"),
    [
        ((0.0, 3.99, 19.9), None),
        ((0.0, -4.01, 0.4), "begins 4.0 in and 0 degrees from where line 7 has the robot"),
        ((3.0, 2.0, -20.1), "begins 3.6 in and 20 degrees from where line 7 has the robot"),
    ],
)
def test_the_second_chain_begins_where_its_line_has_the_robot(
    off: tuple[float, float, float], said: str | None
) -> None:
    """Within four standard deviations of the pose in which people place it: 1, 1 and 5."""
    made = make(6)
    (chain,) = made.run.chains
    pose = made.truth.chain[3, :3]
    chains = (
        Chain(START, 1, chain.movements[:2]),
        Chain(Pose(*pose.tolist()), 7, chain.movements[3:], (1.0, 1.0, 5.0)),
    )
    moved = made.truth.chain.copy()
    moved[3, :3] += off
    found = misplaced(replace(made.run, chains=chains), replace(made.truth, chain=moved))
    assert found == (said and f"the path that fits best {said}")


def stretch(odd: Sequence[int], share: float) -> str | None:
    """The reason for rejecting a path whose ranges at some stops have this share of outliers."""
    rows = known_rows()
    weights = np.where((rows.family == RANGE) & np.isin(rows.stop, odd), 1.0 - share, 1.0)
    return lost_stretch(known().model, replace(rows, weights=weights))


def test_a_stretch_that_fits_no_place_is_twelve_stops_long() -> None:
    """The ranges of 5 of 12 stops are less than half; those of 8 are more."""
    assert stretch(range(10, 15), 1.0) is None
    said = stretch(range(10, 18), 1.0)
    assert said is not None
    assert_kept(
        {
            f"{begin} to {end}, {share}": stretch(range(begin, end), share)
            for begin, end, share in (
                (10, 18, 1.0), (10, 17, 0.99), (0, 6, 1.0), (0, 8, 1.0), (33, 41, 1.0), (35, 41, 1.0),
                (10, 18, 0.7), (0, 41, 0.19), (0, 41, 0.21), (0, 41, 0.9), (12, 20, 0.8),
            )
        },
        KEPT,
        "stretches",
    )  # fmt: skip


def test_a_stretch_at_the_end_is_near_the_last_movement() -> None:
    said = stretch(range(35, 41), 1.0)
    assert said is not None
    assert said.startswith("near line 41, ")


@pytest.mark.parametrize(("count", "is_enough"), [(5, False), (6, True)])
def test_a_stretch_is_tested_by_six_ranges(count: int, is_enough: bool) -> None:
    made = known()
    rows = known_rows()
    chosen = np.flatnonzero((rows.family == RANGE) & (rows.stop < 6))[:count]
    few = replace(
        rows,
        family=np.full(count, RANGE),
        stop=rows.stop[chosen],
        weights=np.concatenate((np.zeros(1), np.ones(count - 1))),
    )
    said = lost_stretch(made.model, few)
    expected = None if is_enough else "no range sensor was read often enough to tell where the robot was"
    assert said == expected


# -- contacts and slips --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("clearance", "before", "met"),
    [
        (-0.07, False, False), (-0.09, False, True), (0.11, True, True), (0.13, True, False),
    ],
)  # fmt: skip
def test_a_contact_begins_below_eight_hundredths_and_ends_above_twelve(
    clearance: float, before: bool, met: bool
) -> None:
    """Of a movement of 3 in towards a wall, by its clearance at its end."""
    made = known()
    second = next(i for i, each in enumerate(made.run.movements) if each.drive == RIGHT)
    radius = made.run.spec.robot.radius or 0.0
    chain, contacts = made.truth.chain.copy(), made.truth.contacts.copy()
    chain[second] = (EAST_WALL - radius - 3.0 - clearance, 20.0, 0.0, 3.0, 0.0, 0.0)
    contacts[second] = before
    state = with_contacts(made.model, replace(made.truth, chain=chain, contacts=contacts))
    assert bool(state.contacts[second]) is met
    slipped = np.arange(40) == second
    assert with_contacts(made.model, replace(state, slipped=slipped)).contacts[second]


@pytest.mark.parametrize(("depth", "met"), [(0.0, False), (0.07, False), (0.09, True)])
def test_a_robot_in_a_wall_has_a_contact_if_it_goes_deeper(depth: float, met: bool) -> None:
    made = known()
    second = next(i for i, each in enumerate(made.run.movements) if each.drive == RIGHT)
    radius = made.run.spec.robot.radius or 0.0
    chain = made.truth.chain.copy()
    angle = np.degrees(np.arcsin(depth / 4.0))
    chain[second] = (EAST_WALL - radius + 0.3, 20.0, 90.0 - angle, 4.0, 0.0, 0.0)
    state = with_contacts(made.model, replace(made.truth, chain=chain))
    assert bool(state.contacts[second]) is met


@pytest.mark.parametrize(("gap", "limit"), [(0.59, 4.0), (0.61, 6.0)])
@pytest.mark.parametrize("family", [PROCESS, KINEMATIC, COUNTER])
def test_a_movement_near_a_wall_slipped_from_four_standard_deviations(
    gap: float, limit: float, family: int
) -> None:
    """From six elsewhere. The row of a counter is at the stop after the movement."""
    made = known()
    number = next(i for i, each in enumerate(made.run.movements) if each.drive == RIGHT)
    radius = made.run.spec.robot.radius or 0.0
    chain = made.truth.chain.copy()
    chain[number] = (EAST_WALL - radius - 3.0 - gap, 20.0, 0.0, 3.0, 0.0, 0.0)
    state = replace(made.truth, chain=chain)
    rows = known_rows()
    row = np.flatnonzero((rows.family == family) & (rows.stop == number + (family == COUNTER)))[0]
    for factor, slipped in ((-0.99, False), (1.01, True), (-1.01, True)):
        residuals = np.zeros(len(rows.residuals))
        residuals[row] = factor * limit * np.sqrt(rows.variances[row])
        found = slips_in(made.model, state, replace(rows, residuals=residuals))
        assert found.tolist() == [slipped and k == number for k in range(40)]
    known_slip = np.arange(40) == 5
    found = slips_in(made.model, replace(state, slipped=known_slip), replace(rows, residuals=0 * residuals))
    assert found.tolist() == known_slip.tolist()


# -- tests of the model --------------------------------------------------------------------------------


def exact(drift: float = 0.0, short: float = 0.0, drives: Sequence[int] = (ROT,), count: int = 60) -> Fit:
    """The truth about a robot with hardly any random error, of which some drives lose a share of their
    strength over the log, or end short by a constant."""
    made = make(count, scale=1e-3)
    (chain,) = made.run.chains
    places = np.linspace(-0.5, 0.5, count).tolist()
    asked = [
        replace(each, value=each.value / (1.0 - drift * place) + short * float(np.sign(each.value)))
        if each.drive in drives
        else each
        for each, place in zip(chain.movements, places, strict=True)
    ]
    run = replace(made.run, chains=(replace(chain, movements=asked),))
    truth = replace(made.truth, noise_scales=1e-2 * made.truth.noise_scales)
    return known_fit(replace(made, truth=truth), run)


def misfits(found: Fit) -> list[tuple[str, str, str]]:
    check = check_model(found.model, found.state, found.rows)
    return [(each.kind, each.owner, each.unit) for each in check.misfits]


@pytest.mark.quick_cases(4)
@pytest.mark.parametrize(
    ("drift", "short", "drive", "told"),
    [
        (0.022, 0.0, ROT, [("drift", "rot", "")]), (0.0, 0.9, ROT, []),
        (0.0, -1.0, ROT, [("shortfall", "rot", "in")]),
        (0.0, 0.12, RIGHT, [("shortfall", "right", "in")]),
        (0.019, 0.0, ROT, []), (0.0, 1.0, ROT, [("shortfall", "rot", "in")]),
    ],
)  # fmt: skip
def test_a_misfit_is_reported_from_the_resolution_of_a_ruler_on(
    drift: float, short: float, drive: int, told: list[tuple[str, str, str]]
) -> None:
    """A fiftieth, or 0.05 in at the wheels: 0.95 degrees."""
    assert misfits(exact(drift, short, (drive,))) == told


@pytest.mark.parametrize(("count", "tested"), [(39, False), (40, True)])
def test_a_drive_is_tested_from_eight_movements_on(count: int, tested: bool) -> None:
    """The drive to the right is the last of five."""
    told = misfits(exact(0.2, drives=(DOWN,), count=count))
    assert (("drift", "down", "") in told) is tested


def test_all_drives_weaken_together() -> None:
    assert misfits(exact(0.2, drives=range(5))) == [("drift", "all drives", "")]


@pytest.mark.parametrize(("count", "tested"), [(29, False), (30, True)])
def test_predictions_of_a_kind_are_tested_from_thirty_on(count: int, tested: bool) -> None:
    assert bool(held_back_misfits({"ultra": np.full(count, 9.0)})) is tested


def test_the_worst_predictions_come_first() -> None:
    scores: dict[str, FloatArray] = {
        "comp": np.full(40, 5.0),
        "tof": np.full(40, 9.0),
        "ultra": np.full(40, 1.0),
    }
    first, second = held_back_misfits(scores)
    assert (first.owner, second.owner) == ("tof", "comp")
    assert first.value == pytest.approx(9.0 / 1.6448536)
    assert (first.low, first.high, first.unit) == (first.value, first.value, "")
