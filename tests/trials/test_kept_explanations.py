"""Explanations of a failed run by the changes that save it, and the changes of faulty robots, kept."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import pytest
from msgspec import structs
from msgspec.structs import replace

from simmer_tui.config.loader import find_set, load
from simmer_tui.config.nominal import nominal_of
from simmer_tui.report.causes import Kind
from simmer_tui.sim.specs import Axes
from simmer_tui.trials.explanations import ChangedRun, explained
from simmer_tui.trials.interventions import UNCHANGED, ChangedPart, Intervention, interventions
from simmer_tui.trials.trial import TrialResult
from tests.kept_numbers import assert_kept

KEPT = Path(__file__).with_name("kept_explanations.json")
CHANGES: dict[str, tuple[ChangedPart, tuple[str, ...]]] = {
    "u1": (ChangedPart.SENSOR, ("u1",)),
    "u1 and u2": (ChangedPart.SENSORS, ("u1", "u2")),
    "all sensors": (ChangedPart.SENSORS, ("u1", "u2", "g1")),
    "no noise": (ChangedPart.NOISE, ()),
    "no bias": (ChangedPart.BIAS, ()),
    "exact drives": (ChangedPart.DRIVES, ()),
    "no time": (ChangedPart.TIME, ()),
}


def runs(saving: tuple[str, ...], unchanged: int, changed: int, repeats: int = 10) -> list[ChangedRun]:
    """Runs with each change, then with other errors: of these so many succeed unchanged, and changed."""
    nothing = ChangedRun(
        run=7, change=UNCHANGED, part=ChangedPart.NOTHING, codes=(), succeeded=UNCHANGED in saving, text=""
    )
    own = [nothing] + [
        ChangedRun(run=7, change=name, part=part, codes=codes, succeeded=name in saving, text="")
        for name, (part, codes) in CHANGES.items()
    ]
    others = [
        structs.replace(each, repeat=repeat, succeeded=repeat <= (unchanged if each is nothing else changed))
        for each in own
        if each is nothing or each.succeeded
        for repeat in range(1, repeats + 1)
    ]
    return own + others


@pytest.fixture
def result(made_result: Callable[..., TrialResult]) -> Callable[..., TrialResult]:
    def made(kind: str, sure: str = "likely", *culprits: str) -> TrialResult:
        cause = {"kind": kind, "sure": sure, "culprits": list(culprits)}
        return made_result(7, 1, success=False, verdict={"cause": cause})

    return made


def test_explanations_by_what_saves_a_run(result: Callable[..., TrialResult]) -> None:
    sets = [each for size in range(4) for each in combinations(CHANGES, size)]
    found = {}
    for saving in sets:
        told = explained(result(Kind.SENSOR_WRONG.value, "likely", "u1"), runs(saving, 1, 9))
        changes = [each.change for each in told.controls]
        found[" + ".join(saving)] = [told.text, told.confirmed, changes]
    assert_kept(found, KEPT, "texts")


def test_causes_are_confirmed_or_contradicted(result: Callable[..., TrialResult]) -> None:
    sets = [each for size in range(1, 3) for each in combinations(CHANGES, size)]
    found = {}
    for kind in Kind:
        for culprits in ((), ("u1",), ("u1", "u2")):
            cause = result(kind.value, "likely", *culprits)
            confirmed = [explained(cause, runs(saving, 1, 9)).confirmed for saving in sets]
            found[f"{kind.value} of {culprits}"] = "".join(
                {True: "y", False: "n", None: "-"}[c] for c in confirmed
            )
    assert_kept(found, KEPT, "confirmed")


@pytest.mark.parametrize(
    ("unchanged", "changed", "repeats"),
    [(1, 9, 10), (6, 10, 10), (9, 1, 10), (0, 5, 5), (0, 6, 6), (0, 0, 0)],
)
def test_changes_are_told_from_chance(
    result: Callable[..., TrialResult], unchanged: int, changed: int, repeats: int
) -> None:
    found = []
    for saving in (("u1",), ("u1", "no noise"), ("u1", "no noise", "no time"), (UNCHANGED, "u1")):
        told = explained(result(Kind.SENSOR_WRONG.value), runs(saving, unchanged, changed, repeats))
        sure = [each.is_sure for each in told.controls]
        found.append([told.text, told.suspected, told.confirmed, sure, [each.p for each in told.controls]])
    assert_kept(found, KEPT, f"chance {unchanged} {changed} {repeats}")


def test_a_change_in_which_the_simulator_failed_was_not_tried(result: Callable[..., TrialResult]) -> None:
    tried = runs((), 0, 0)
    failed = [tried[0], *(structs.replace(each, succeeded=None) for each in tried[1:8])]
    for sure, suspected in (("likely", "sensor wrong"), ("certain", "")):
        told = explained(result("sensor wrong", sure), failed)
        assert told.text == "Run 7 has not been repeated with changes yet."
        assert (told.suspected, told.confirmed, told.controls) == (suspected, None, ())


def differences(found: list[Intervention]) -> dict[str, object]:
    """Changes of each intervention in the robot and the link."""
    first = found[0].configuration
    told: dict[str, object] = {}
    for each in found:
        new, old = each.configuration.simulation, first.simulation
        sensors = [
            (one.code, name, getattr(one, name, None))
            for one, other in zip(new.sensors, old.sensors, strict=True)
            for name in one.__struct_fields__
            if getattr(one, name) != getattr(other, name, None)
        ]
        drives = [
            (one.code, name, getattr(one, name))
            for one, other in zip(new.drives, old.drives, strict=True)
            for name in one.__struct_fields__
            if getattr(one, name) != getattr(other, name)
        ]
        link = each.configuration.settings.link
        told[each.change] = [
            each.part.value, each.codes, sensors, drives, new.randbias, link.latency, link.jitter,
        ]  # fmt: skip
    return told


def test_changes_of_a_faulty_robot() -> None:
    loaded = load(find_set("mission"))
    spec = loaded.simulation
    wrong = {
        "error": 0.1, "absolute_error": 0.5, "bias": 1.0, "drift": 0.1, "dropout": 0.1, "outlier": 0.1,
        "gain": -2.0, "read_time": 0.5, "rotation": 10.0,
    }  # fmt: skip
    sensors = tuple(
        replace(each, **wrong) if number < 2 else each for number, each in enumerate(spec.sensors)
    )
    sensors = (*sensors[:3], replace(sensors[3], enabled=False), *sensors[4:])
    drives = tuple(
        replace(each, gain=-1.5, bias=Axes(0.1, 0.2, 0.3), error=Axes(0.1)) if number < 2 else each
        for number, each in enumerate(spec.drives)
    )
    link = replace(loaded.settings.link, latency=0.1, jitter=0.05)
    faulty = replace(
        loaded,
        simulation=replace(spec, sensors=sensors, drives=drives, randbias=True),
        settings=replace(loaded.settings, link=link),
    )
    ids = {each.id for each in sensors[:4]}
    codes = [each.code for each in sensors]
    nominal = nominal_of(loaded)
    found = {
        "alone": differences(interventions(faulty, read=ids, suspects=codes[:2])),
        "with its set": differences(interventions(faulty, nominal, read=ids, suspects=(codes[0], "nothing"))),
        "not read": differences(interventions(faulty, nominal, read=set())),
        "all": [each.change for each in interventions(faulty)],
        "right": [
            each.change for each in interventions(replace(loaded, simulation=replace(spec, randbias=False)))
        ],
    }
    assert_kept(found, KEPT, "changes")
