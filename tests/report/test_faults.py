"""Faults put into the sample that does the whole mission: each is laid to what was put in."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType

import pytest

from tests.report.faulty import FAULTS, fly, sample

QUICK = {"heading offset": 2, "clearance": 1, "reading too often": 2}
"""Those whose runs end soon, with a seed by which they do."""
RUNS = 5


@pytest.fixture(scope="module")
def parts() -> Iterator[dict[str, ModuleType]]:
    with sample() as modules:
        yield modules


def right(parts: dict[str, ModuleType], name: str, seed: int) -> bool:
    """Whether a run is laid to its fault; one that succeeds all the same is laid to nothing."""
    fault = FAULTS[name]
    success, cause = fly(parts, fault, seed)
    return cause is None if success else cause is not None and cause.kind in fault.kinds


@pytest.mark.parametrize("name", QUICK)
def test_a_run_is_laid_to_its_fault(parts: dict[str, ModuleType], name: str) -> None:
    assert right(parts, name, QUICK[name])


@pytest.mark.parametrize("name", ["clearance", pytest.param("heading offset", marks=pytest.mark.slow)])
def test_the_same_run_fails_for_the_same_reason(parts: dict[str, ModuleType], name: str) -> None:
    fault, seed = FAULTS[name], QUICK[name]
    assert fly(parts, fault, seed) == fly(parts, fault, seed)


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
def test_runs_are_laid_to_their_faults(parts: dict[str, ModuleType], name: str) -> None:
    told = [right(parts, name, seed) for seed in range(1, RUNS + 1)]
    assert told.count(False) <= (0 if name == "clean" else 1), told
