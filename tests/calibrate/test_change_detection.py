"""Change detection: likelihood ratios by hand, Holm's order, and the strength of random biases."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from scipy import stats

from simmer_tui.calibrate.change_detection import FALSE_ALARMS, check_robot, judged, strengths
from simmer_tui.calibrate.fit import Fit
from simmer_tui.calibrate.written_set import Knowledge
from simmer_tui.config import load_default
from simmer_tui.errors import CalibrationError

WIDER = 1.1**2
"""Factor on variances for what the model does not have."""


def known(values: dict[str, float], variance: float = 0.01) -> Knowledge:
    covariance = tuple(
        tuple(variance if i == j else 0.0 for j in range(len(values))) for i in range(len(values))
    )
    return Knowledge(parameters=tuple(values), values=tuple(values.values()), covariance=covariance)


def fitted(values: dict[str, float], variance: float = 0.04, unidentified: tuple[str, ...] = ()) -> Fit:
    """A fit of independent parameters, named by their owner and figure, all of one variance."""
    parameters = [
        SimpleNamespace(name=name, owner=name.split()[0], label=name.partition(" ")[2], unit="in")
        for name in values
    ]
    found: Any = SimpleNamespace(
        space=SimpleNamespace(parameters=parameters),
        information=np.eye(len(values)) / variance,
        state=SimpleNamespace(parameters=np.array(list(values.values()))),
        identified=np.array([name not in unidentified for name in values]),
    )
    fit: Fit = found
    return fit


def probability(*differences: float, variance: float = 0.05) -> float:
    """Of so great differences by chance, the variances of set and log added."""
    statistic = sum(each**2 for each in differences) / (WIDER * variance)
    return float(stats.chi2.sf(statistic, len(differences)))


def test_a_part_is_tested_by_the_differences_of_all_its_parameters() -> None:
    in_set = {"ultra1 bias": 1.0, "up bias": 0.1, "up gain": 1.0, "gyro1 bias": 0.0}
    in_log = {"up bias": 0.5, "up gain": 0.7, "ultra1 bias": 0.9, "other bias": 9.0}
    first, second = judged(fitted(in_log), known(in_set))
    assert (first.owner, second.owner) == ("ultra1", "up"), "in the set's order, none has changed"
    assert not first.changed
    assert first.probability == pytest.approx(probability(0.1), rel=1e-6)
    assert second.probability == pytest.approx(probability(0.4, 0.3), rel=1e-6)
    error = pytest.approx(math.sqrt(0.01 * WIDER + 0.04 * WIDER))
    assert first.figures == (("bias", 1.0, pytest.approx(0.9), error),)
    assert second.figures == (
        ("bias", 0.1, pytest.approx(0.5), error),
        ("gain", 1.0, pytest.approx(0.7), error),
    )


def test_what_the_log_does_not_identify_is_neither_judged_nor_shown() -> None:
    values = {"up bias": 0.0, "up gain": 0.0, "gyro1 bias": 0.0}
    found = fitted({**values, "up bias": 3.0, "gyro1 bias": 3.0}, unidentified=("up gain", "gyro1 bias"))
    [part] = judged(found, known(values))
    assert (part.owner, part.changed) == ("up", True)
    assert [label for label, *_ in part.figures] == ["bias"]
    assert part.units == ("in",)


def test_a_parameter_without_any_information_in_the_log_leaves_the_errors_of_the_others() -> None:
    values = {"up bias": 0.0, "ultra1 bias": 0.0}
    found = fitted({**values, "up bias": 0.3}, unidentified=("ultra1 bias",))
    found.information[1, 1] = 0.0
    [part] = judged(found, known(values))
    assert part.probability == pytest.approx(probability(0.3), rel=1e-6)
    assert part.figures == (
        ("bias", 0.0, pytest.approx(0.3), pytest.approx(math.sqrt(0.01 * WIDER + 0.04 * WIDER))),
    )


@pytest.mark.parametrize("parts", [1, 2, 4])
def test_the_smallest_probability_is_held_against_a_part_of_the_rate(parts: int) -> None:
    """Holm's procedure: the first of k parts has changed below rate / k, the next below rate / (k - 1)."""
    values = {f"ultra{i} bias": 0.0 for i in range(parts)}
    limit = math.sqrt(stats.chi2.isf(FALSE_ALARMS / parts, 1) * WIDER * 0.05)
    for factor, changed in ((0.999, False), (1.001, True)):
        verdicts = judged(fitted({**values, "ultra0 bias": factor * limit}), known(values))
        assert [part.changed for part in verdicts] == [changed] + [False] * (parts - 1)
    if parts == 2:
        alone = math.sqrt(stats.chi2.isf(FALSE_ALARMS, 1) * WIDER * 0.05)
        both = judged(fitted({"ultra0 bias": 1.001 * alone, "ultra1 bias": 1.001 * limit}), known(values))
        assert [(part.owner, part.changed) for part in both] == [("ultra1", True), ("ultra0", True)]


def test_a_rate_can_be_given() -> None:
    values = {"up bias": 0.0}
    found = fitted({"up bias": math.sqrt(stats.chi2.isf(0.01, 1) * WIDER * 0.05)})
    assert [part.changed for part in judged(found, known(values), 0.011)] == [True]
    assert [part.changed for part in judged(found, known(values), 0.009)] == [False]


def test_strength_is_the_spread_of_biases_in_units_of_the_drawn_numbers() -> None:
    """Of a translation x and y are drawn by strength[0], rotation by ten times it; of a turn all by
    strength[1] / 360."""
    drawn = np.random.default_rng(3).normal(size=(6, 4))
    names = ("up bias along x", "left rotation bias", "rot bias along y", "rot rotation bias")
    units = np.array([1.0, 10.0, 1 / 360, 1 / 360])
    robots = [known(dict(zip(names, row * units, strict=True)), 1e-6) for row in drawn]
    robots[0] = known({**dict(zip(names, drawn[0] * units, strict=True)), "ultra1 bias": 5.0}, 1e-6)
    moved, turned = strengths(robots)
    for found, kinds in ((moved, [0, 1]), (turned, [2, 3])):
        scatter = drawn[:, kinds].var(axis=0, ddof=1).mean()
        noise = np.mean(1e-6 / units[kinds] ** 2)
        freedom = 2 * 5
        ends = [freedom / stats.chi2.ppf(share, freedom) for share in (0.975, 0.025)]
        assert found.value == pytest.approx(math.sqrt(scatter - noise))
        assert (found.low, found.high) == pytest.approx([math.sqrt(scatter * end - noise) for end in ends])


def test_fewer_than_five_robots_or_none_with_a_bias_in_common_are_refused() -> None:
    robot = known({"up bias along x": 0.1, "ultra1 bias": 0.1})
    with pytest.raises(CalibrationError, match="from 5 calibrated sets on; these are 4"):
        strengths([robot] * 4)
    with pytest.raises(CalibrationError, match="no drive in common"):
        strengths([robot] * 5)


def test_a_log_of_another_robot_is_refused() -> None:
    configuration = load_default()
    run: Any = SimpleNamespace(spec=replace(configuration.simulation, sensors=()))
    with pytest.raises(CalibrationError, match=r"the log's sensors \(\) are not those of the set"):
        check_robot(run, configuration, known({"up bias": 0.0}))
