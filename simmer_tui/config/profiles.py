"""Profiles: the errors of common drives, sensors and links, which override the values of a set.

Each is a TOML file that comes along, in `profiles/drive`, `profiles/sensors` or `profiles/link` beside
the default set. A drive profile has a table for each ID of drive.csv and the `strength` of the random
bias; a sensor profile says which `kind` it is for and has values named as the fields of `SensorSpec`; a
link profile has those of the table [link] of settings.toml.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from simmer_tui.config.csv_table import read_text
from simmer_tui.config.sensors_csv import profile_rules
from simmer_tui.config.sets import bundled_folder
from simmer_tui.config.settings import all_settings
from simmer_tui.config.toml_text import key_lines, parse_toml, place_of
from simmer_tui.errors import Problem
from simmer_tui.sim.rules import (
    ChoiceRule,
    FlagRule,
    NumberRule,
    PairRule,
    Rule,
    TextRule,
    did_you_mean,
    listed,
)
from simmer_tui.sim.sensors import KINDS, SensorKinds
from simmer_tui.sim.specs import Axes, DriveKind, DriveSpec, SensorKind, SensorSpec

DRIVE, SENSOR, LINK = "drive", "sensor", "link"
_FOLDERS = {DRIVE: "drive", SENSOR: "sensors", LINK: "link"}
USUAL_DRIVE, USUAL_LINK = "omni-4", "usb"
"""The drive and the link of `realistic`."""
_USUAL_SENSORS = {
    "ultra": "hc-sr04",
    "tof": "vl53l0x",
    "ir": "qtr",
    "gyro": "mpu-6050",
    "comp": "qmc5883l",
    "odom": "encoder",
}
"""The sensors of `realistic`, by the name of the kind."""
_TITLE, _STRENGTH, _KIND, _ENABLED, _SPEED = "title", "strength", "kind", "enabled", "speed"
_LINK_TABLE = "link."
_PACE = ("start_lag", "acceleration")
_ERRORS = ("x_error", "y_error", "rotation_error")
_BIASES = ("x_bias", "y_bias", "rotation_bias")
_COURSE = (DriveKind.UP, DriveKind.DOWN, DriveKind.LEFT, DriveKind.RIGHT, DriveKind.ROT)
"""The IDs every drive profile must have a table for; of others it may say nothing."""
_MOVEMENT: dict[str, Rule[Any]] = {
    _ENABLED: FlagRule(),
    _SPEED: NumberRule(0, low_open=True),
    **dict.fromkeys(_ERRORS, NumberRule(0)),
    **dict.fromkeys(_BIASES, NumberRule()),
}


@dataclass(frozen=True, slots=True)
class Movement:
    """What a drive profile says of one ID; an ID it disables has no other values."""

    enabled: bool
    error: Axes
    bias: Axes
    speed: float
    start_lag: float | None = None
    acceleration: float | None = None
    """Of what it leaves out, the row's own value stays."""


@dataclass(frozen=True, slots=True)
class DriveProfile:
    """A drive: `strength` as in settings.toml, and its movements."""

    name: str
    title: str
    strength: tuple[float, float]
    movements: Mapping[DriveKind, Movement]

    def over(self, drives: Iterable[DriveSpec]) -> tuple[DriveSpec, ...]:
        """The drives with this profile's values. Codes and gains stay; a disabled row stays so."""
        return tuple(self._over(drive) for drive in drives)

    def _over(self, drive: DriveSpec) -> DriveSpec:
        movement = self.movements.get(drive.kind)
        if movement is None:
            return drive
        if not movement.enabled:
            return replace(drive, enabled=False)
        lag, acceleration = movement.start_lag, movement.acceleration
        return replace(
            drive,
            error=movement.error,
            bias=movement.bias,
            speed=movement.speed,
            start_lag=drive.start_lag if lag is None else lag,
            acceleration=drive.acceleration if acceleration is None else acceleration,
        )


@dataclass(frozen=True, slots=True)
class SensorProfile:
    """A sensor: `values` by field of `SensorSpec`, for all sensors of a kind."""

    name: str
    title: str
    kind: type[SensorKind]
    values: Mapping[str, Any]

    def over(self, sensors: Iterable[SensorSpec]) -> tuple[SensorSpec, ...]:
        """The sensors with this profile's values where they are of its kind."""
        return tuple(replace(s, **self.values) if s.kind is self.kind else s for s in sensors)


def profile_names(sort: str) -> tuple[str, ...]:
    """The names of the profiles of a sort, `DRIVE`, `SENSOR` or `LINK`."""
    return tuple(sorted(path.stem for path in _folder(sort).glob("*.toml")))


def drive_profile(name: str, place: str, problems: list[Problem]) -> DriveProfile | None:
    """Read a drive profile; None, and problems, if there is none of that name. `place` is where the
    name was given."""
    read = _read(DRIVE, name, place, problems)
    return read.drive() if read is not None else None


def link_profile(name: str, place: str, problems: list[Problem]) -> Mapping[str, float] | None:
    """Read a link profile: values of the settings in [link] by name; None, and problems, if there is none
    of that name."""
    read = _read(LINK, name, place, problems)
    return read.link() if read is not None else None


def sensor_profiles(
    names: Iterable[str],
    place: str,
    sensors: Iterable[SensorSpec],
    problems: list[Problem],
    kinds: SensorKinds = KINDS,
) -> tuple[SensorProfile, ...]:
    """Read sensor profiles. One for a kind that none of the sensors is of, and a second for a kind,
    are problems too."""
    is_whole = not problems  # else a row may be missing for its mistakes
    profiles: dict[type[SensorKind], SensorProfile] = {}
    present = {sensor.kind for sensor in sensors}
    for name in names:
        read = _read(SENSOR, name, place, problems)
        profile = read.sensor(kinds) if read is not None else None
        if profile is None:
            continue
        kind = profile.kind
        if kind not in present and is_whole:
            what = f'"{name}" is for sensors of the type {kind.name}, and sensors.csv has none'
            problems.append(Problem(place, what))
        elif kind in profiles:
            what = f'"{name}" and "{profiles[kind].name}" are both for the type {kind.name}; give one of them'
            problems.append(Problem(place, what))
        else:
            profiles[kind] = profile
    return tuple(profiles.values())


def usual_sensors(sensors: Iterable[SensorSpec], chosen: Iterable[SensorProfile]) -> tuple[str, ...]:
    """The names of the profiles that `realistic` adds to those `chosen`: one for each kind that some
    sensor is of and that has none yet."""
    left = {sensor.kind.name for sensor in sensors} - {profile.kind.name for profile in chosen}
    return tuple(name for kind, name in _USUAL_SENSORS.items() if kind in left)


def _folder(sort: str) -> Path:
    return bundled_folder() / "profiles" / _FOLDERS[sort]


def _read(sort: str, name: str, place: str, problems: list[Problem]) -> _Reader | None:
    names = profile_names(sort)
    if name not in names:
        hint = did_you_mean(name, names)
        problems.append(Problem(place, f"there is no such {sort} profile; there are {listed(names)}{hint}"))
        return None
    path = _folder(sort) / f"{name}.toml"
    text = read_text(path, problems)
    return None if text is None else _Reader(path.name, text, problems)


class _Reader:
    """One profile's text taken apart."""

    def __init__(self, file: str, text: str, problems: list[Problem]) -> None:
        self._file = file
        self._problems = problems
        self._before = len(problems)
        self._lines = key_lines(text)
        self._tree = parse_toml(text, file, problems)

    def drive(self) -> DriveProfile | None:
        kinds = {kind.value: kind for kind in DriveKind}
        top = self._values(self._tree, "", {_TITLE: TextRule(), _STRENGTH: PairRule(NumberRule(0))}, kinds)
        movements = {}
        for name, kind in kinds.items():
            table = self._tree.get(name)
            if isinstance(table, dict):
                given = {key: NumberRule(0) for key in _PACE if key in table}
                rules = {_ENABLED: FlagRule()} if table.get(_ENABLED) is False else {**_MOVEMENT, **given}
                values = self._values(table, f"{name}.", rules)
                movements[kind] = Movement(
                    values.get(_ENABLED, False),
                    Axes(*(values.get(key, 0.0) for key in _ERRORS)),
                    Axes(*(values.get(key, 0.0) for key in _BIASES)),
                    values.get(_SPEED, 1.0),
                    *(values.get(key) for key in _PACE),
                )
            elif kind in _COURSE:
                self._complain(name, "this table is missing")
        if len(self._problems) > self._before:
            return None
        return DriveProfile(Path(self._file).stem, top[_TITLE], top[_STRENGTH], movements)

    def link(self) -> Mapping[str, float] | None:
        rules: dict[str, Rule[Any]] = {
            item.name.removeprefix(_LINK_TABLE): item.rule
            for item in all_settings()
            if item.name.startswith(_LINK_TABLE)
        }
        values = self._values(self._tree, "", {_TITLE: TextRule(), **rules})
        if len(self._problems) > self._before:
            return None
        return {name: values[name] for name in rules}

    def sensor(self, known: SensorKinds) -> SensorProfile | None:
        kinds = tuple(known)
        kind = self._tree.get(_KIND)
        rules = profile_rules(known[kind]) if kind in kinds else {}
        given = {name: rule for name, rule in rules.items() if name in self._tree}
        values = self._values(self._tree, "", {_TITLE: TextRule(), _KIND: ChoiceRule(kinds), **given}, rules)
        if len(self._problems) > self._before:
            return None
        own = {name: value for name, value in values.items() if name in rules}
        return SensorProfile(Path(self._file).stem, values[_TITLE], known[values[_KIND]], own)

    def _values(
        self,
        tree: Mapping[str, Any],
        prefix: str,
        rules: Mapping[str, Rule[Any]],
        others: Iterable[str] = (),
    ) -> dict[str, Any]:
        """The values of all `rules`, each of which must be given; `others` may be there as well."""
        values = {}
        for name, rule in rules.items():
            if name not in tree:
                self._complain(prefix + name, f"is missing; must be {rule.allowed}")
                continue
            try:
                values[name] = rule.check(tree[name])
            except ValueError as error:
                self._complain(prefix + name, str(error))
        for name in tree:
            if name not in rules and name not in others:
                self._complain(prefix + name, f"is not known here{did_you_mean(name, rules)}")
        return values

    def _complain(self, name: str, what: str) -> None:
        self._problems.append(Problem(place_of(name, self._file, self._lines), what))
