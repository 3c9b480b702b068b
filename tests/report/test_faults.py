"""Faults put into the sample that does the whole mission: each is laid to what was put in."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from types import ModuleType

import pytest

from simmer_tui.report.causes import Cause
from tests.report.faulty import FAULTS, fly, sample

QUICK = {"clearance": 1, "heading offset": 2, "reading too often": 2}
"""Those whose runs end soon, with a seed by which they do."""
RUNS = 5
Flown = Callable[[str, int], tuple[bool, Cause | None]]


@pytest.fixture(scope="module")
def parts() -> Iterator[dict[str, ModuleType]]:
    with sample() as modules:
        yield modules


@pytest.fixture(scope="module")
def flown(parts: dict[str, ModuleType]) -> Flown:
    """Gives what became of a run with a fault put into it, made once."""
    return functools.cache(lambda name, seed: fly(parts, FAULTS[name], seed))


def right(flown: Flown, name: str, seed: int) -> bool:
    """True if a run is put down to its fault; one that succeeds all the same has no cause."""
    fault = FAULTS[name]
    success, cause = flown(name, seed)
    if success or cause is None:
        return success and cause is None
    return cause.kind in fault.kinds and fault.says in cause.text


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("name", QUICK)
def test_a_run_is_laid_to_its_fault(flown: Flown, name: str) -> None:
    assert right(flown, name, QUICK[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["clearance", "heading offset"])
def test_the_same_run_fails_for_the_same_reason(
    flown: Flown, parts: dict[str, ModuleType], name: str
) -> None:
    assert fly(parts, FAULTS[name], QUICK[name]) == flown(name, QUICK[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
def test_runs_are_laid_to_their_faults(flown: Flown, name: str) -> None:
    told = [right(flown, name, seed) for seed in range(1, RUNS + 1)]
    assert told.count(False) <= (0 if name == "clean" else 1), told
