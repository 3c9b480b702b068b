"""Random streams: one seed, and an independent stream for each sensor, drive or other user of random
numbers."""

from __future__ import annotations

import operator
from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import SupportsIndex

import numpy as np

from simmer_tui.sim.rules import IntegerRule
from simmer_tui.sim.specs import Axes, DriveKind, SimulationSpec

SEED_BITS = 128
"""Bits of the longest seed: a program that reads a sensor twice could find a shorter one by trying all."""
SEEDS = IntegerRule(0, 2**SEED_BITS - 1, f"a whole number from 0 to 2^{SEED_BITS} - 1")
"""The seeds that an option, an order, a file or a log may have."""
BIAS_STREAM = "bias"
DRIVE_STREAM = "drive"


def checked_seed(seed: object) -> int:
    """A seed as an int, of numpy's whole numbers too. Raises ValueError if it is none."""
    try:
        return SEEDS.check(operator.index(seed) if isinstance(seed, SupportsIndex) else seed)
    except ValueError as error:
        raise ValueError(f"the seed {error}") from None


def fault_stream(sensor: str) -> str:
    """The name of the stream from which a sensor's faults are drawn, by its ID."""
    return f"{sensor} faults"


def distance_stream(consumer: str, kind: DriveKind) -> str:
    """The name of the stream of a consumer's errors by distance driven: `drive right`, `odom1 rot`."""
    return f"{consumer} {kind.value}"


def stream(seed: int, name: str) -> np.random.Generator:
    """The generator of one name (a sensor's ID, `drive`, `bias`), derived from the seed.

    Keyed by name, not by order, so that adding or polling one sensor never changes another.
    """
    # Seeds derived by a spawn key give streams that are independent however close seeds or names are (NumPy,
    # parallel random number generation).
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=tuple(name.encode())))


class Streams(dict[str, "np.random.Generator"]):
    """The generators of one seed by name. Each is made at its first draw, since start-up needs none."""

    def __init__(self, seed: int) -> None:
        super().__init__()
        self.seed = seed

    def __missing__(self, name: str) -> np.random.Generator:
        made = self[name] = stream(self.seed, name)
        return made


def random_bias(seed: int, strength: tuple[float, float]) -> dict[DriveKind, Axes]:
    """A drive bias for every kind of movement, from three independent normal draws each.

    `strength` is the manual's pair: for translations and for rotations.
    """
    draws = stream(seed, BIAS_STREAM).standard_normal((len(DriveKind), 3)).tolist()
    return {
        kind: Axes(*map(operator.mul, bias_spread(kind, strength), each))
        for kind, each in zip(DriveKind, draws, strict=True)
    }


def bias_spread(kind: DriveKind, strength: tuple[float, float]) -> tuple[float, float, float]:
    """Standard deviations of a random bias on the three axes: x, y and turning."""
    # The factors are explained in docs/how-it-works.md.
    straight, turning = strength[0], strength[1] / 360.0
    return (turning, turning, turning) if kind.turns else (straight, straight, 10.0 * straight)


def drive_bias(spec: SimulationSpec, seed: int, *, random: bool) -> Mapping[DriveKind, Axes]:
    """The drive bias of a run, by kind of movement: drawn at `random`, or as in drive.csv."""
    return RandomBias(seed, spec.strength) if random else {drive.kind: drive.bias for drive in spec.drives}


class RandomBias(Mapping[DriveKind, Axes]):
    """The same, drawn when it is first read. A run that never drives needs no draws, and the import of the
    generator would delay the start."""

    def __init__(self, seed: int, strength: tuple[float, float]) -> None:
        self._seed = seed
        self._strength = strength

    @cached_property
    def _drawn(self) -> dict[DriveKind, Axes]:
        return random_bias(self._seed, self._strength)

    def __getitem__(self, kind: DriveKind) -> Axes:
        return self._drawn[kind]

    def __iter__(self) -> Iterator[DriveKind]:
        return iter(self._drawn)

    def __len__(self) -> int:
        return len(self._drawn)

    def __repr__(self) -> str:
        return repr(self._drawn)
