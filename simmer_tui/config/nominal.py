"""The nominal set of a run: its own set is a variant of it.

A set names it in settings.toml (`nominal`); `init` writes that. A set without the name counts as a variant of
the bundled set with the same sensors and drives, if most rows are the same. One with boards describes the
robot of a team, whose sketch knows it: it is its own nominal set.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from msgspec import Struct

from simmer_tui.config.device_trust import DeviceUse
from simmer_tui.config.loader import Configuration, Override, load
from simmer_tui.config.set_sketches import WIRING_FILE
from simmer_tui.config.sets import bundled_sets, find_set, set_name
from simmer_tui.errors import ConfigurationError
from simmer_tui.sim.specs import SimulationSpec

# With these settings, profiles replace values of rows; both sets get the same.
_PROFILES = ("realistic", "sensor_profile", "drive_profile", "link_profile")
# Judged: a set with more than half of its rows different describes another robot.
_SAME = 0.5


class Nominal(Struct, frozen=True):
    """A nominal set: its name, its specification, and its mission's time limit, seconds; None without one."""

    name: str
    spec: SimulationSpec
    time_limit: float | None = None


def nominal_of(configuration: Configuration, chosen: str | None = None) -> Nominal | None:
    """The nominal set of a run with this configuration, None if there is none that can be read. By default it
    is the one that the run's set names, else itself with a wiring.toml, else the bundled set that it is a
    variant of.

    Raises ConfigurationError if a `chosen` one cannot be read.
    """
    if chosen is not None:
        return _read(chosen, configuration)
    named = configuration.settings.nominal
    if named:
        try:
            return _read(named, configuration)
        except ConfigurationError:
            # A folder that no longer exists, or is on another machine.
            return None
    if WIRING_FILE in configuration.files:
        limit = None if configuration.mission is None else configuration.mission.time_limit
        return Nominal(configuration.name, configuration.simulation, limit)
    bundled = bundled_sets()
    # Nearly every run has a bundled set: comparing with that one is then enough.
    names = [configuration.name] if configuration.name in bundled else list(bundled)
    candidates = [_read(name, configuration) for name in names]
    shares = [_alike(configuration.simulation, each.spec) for each in candidates]
    best = max(shares)
    return candidates[shares.index(best)] if best > _SAME else None


def nominal_note(named: str) -> str:
    """A line for a set with boards that names a bundled set as its nominal one; empty if it names none."""
    if named not in bundled_sets():
        return ""
    what = f'nominal = "{named}" in settings.toml: reports compare this robot with that set'
    return f'{what}; if it is your own robot, write nominal = ""'


def _read(name: str, configuration: Configuration) -> Nominal:
    folder = find_set(name)
    chosen = tuple(getattr(configuration.settings, name) for name in _PROFILES)
    # Bundled sets do not change, and trials need one after each run.
    return (_loaded_once if folder in bundled_sets().values() else _loaded)(folder, chosen)


def _loaded(folder: Path, chosen: tuple[Any, ...]) -> Nominal:
    """A set with some values of the `_PROFILES`."""
    given = zip(_PROFILES, chosen, strict=True)
    overrides = {name: Override(f"{name} of the run", value) for name, value in given if value}
    found = load(folder, overrides, devices=DeviceUse.PARSE)
    limit = None if found.mission is None else found.mission.time_limit
    return Nominal(set_name(folder), found.simulation, limit)


_loaded_once = cache(_loaded)


def _alike(spec: SimulationSpec, other: SimulationSpec) -> float:
    """The share of rows that two sets have in common; 0 if they are not about the same parts."""
    rows, others = [*spec.sensors, *spec.drives], [*other.sensors, *other.drives]
    if _parts(spec) != _parts(other):
        return 0.0
    return sum(each in others for each in rows) / len(rows)


def _parts(spec: SimulationSpec) -> set[str]:
    return {*(each.id for each in spec.sensors), *(each.kind for each in spec.drives)}
