"""Profiles: the errors of common drives, sensors and links, which override the values of a set.

Each is a bundled TOML file, in `profiles/drive`, `profiles/sensors` or `profiles/link` beside the default
set. A drive profile has a table for each ID of drive.csv and the `strength` of the random bias; a sensor
profile has its `kind` and values named as the fields of `SensorSpec`; a link profile has those of the table
[link] of settings.toml.
"""

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.config.sets import bundled_folder
from simmer_tui.config.settings import USUAL_DRIVE, USUAL_LINK, USUAL_SENSORS, Settings, all_settings
from simmer_tui.config.settings_file import LoadedSettings
from simmer_tui.config.toml_file import TomlFile
from simmer_tui.errors import Problem
from simmer_tui.sim.columns import DRIVE_GAIN, LESS_USUAL, MOUNTING, MOVEMENT, column_name
from simmer_tui.sim.rules import ChoiceRule, FlagRule, TextRule, did_you_mean, listed
from simmer_tui.sim.sensors import KINDS, SensorKinds
from simmer_tui.sim.specs import DriveKind, DriveSpec, SensorKind, SensorSpec
from simmer_tui.sim.values import Value, with_values

DRIVE, SENSOR, LINK = "drive", "sensor", "link"
_FOLDERS = {DRIVE: "drive", SENSOR: "sensors", LINK: "link"}
_TITLE = Value(TextRule(), name="title")
_ENABLED = Value(FlagRule(), name="enabled", field="enabled")
_STRENGTH = Value(next(item.rule for item in all_settings() if item.name == "strength"), name="strength")
_SETTINGS_TABLE = "link."
# The IDs for which every drive profile must have a table; others are optional.
_COURSE = (DriveKind.UP, DriveKind.DOWN, DriveKind.LEFT, DriveKind.RIGHT, DriveKind.ROT)


_MOVEMENT = tuple(
    replace(column, name=column_name(column.name)) for column in MOVEMENT if column is not DRIVE_GAIN
)
# If a movement leaves one of these out, the row's own value stays.
_LESS_USUAL = [column.field for column in LESS_USUAL]


class DriveProfile(Struct, frozen=True):
    """A drive: `strength` as in settings.toml, and its values for each movement, by field of `DriveSpec`. A
    disabled movement has no other values."""

    name: str
    title: str
    strength: tuple[float, float]
    movements: Mapping[DriveKind, Mapping[str, Any]]

    def over(self, drives: Iterable[DriveSpec]) -> tuple[DriveSpec, ...]:
        """The drives with this profile's values. Codes and gains stay; a disabled row stays so."""
        return tuple(
            with_values(drive, values | {"enabled": drive.enabled and values["enabled"]})
            if (values := dict(self.movements.get(drive.kind, {})))
            else drive
            for drive in drives
        )


class SensorProfile(Struct, frozen=True):
    """A sensor: `values` by field of `SensorSpec`, for all sensors of a kind."""

    name: str
    title: str
    kind: type[SensorKind]
    values: Mapping[str, Any]

    def over(self, sensors: Iterable[SensorSpec]) -> tuple[SensorSpec, ...]:
        """The sensors; those of this profile's kind with its values."""
        return tuple(with_values(s, self.values) if s.kind is self.kind else s for s in sensors)


def with_profiles(
    loaded: LoadedSettings,
    given: Collection[str],
    sensors: tuple[SensorSpec, ...],
    drives: tuple[DriveSpec, ...],
    problems: list[Problem],
    kinds: SensorKinds,
) -> tuple[Settings, tuple[SensorSpec, ...], tuple[DriveSpec, ...]]:
    """A set with the profiles that its settings name. Values `given` by options have priority."""
    settings, places = loaded.settings, loaded.places
    chosen = sensor_profiles(settings.sensor_profile, places["sensor_profile"], sensors, problems, kinds)
    if settings.realistic:
        usual = usual_sensors(sensors, chosen)
        chosen += sensor_profiles(usual, places["realistic"], sensors, problems, kinds)
        settings = replace(
            settings,
            sensor_profile=(*settings.sensor_profile, *usual),
            drive_profile=settings.drive_profile or USUAL_DRIVE,
            link_profile=settings.link_profile or USUAL_LINK,
        )
    for each in chosen:
        sensors = each.over(sensors)
    if settings.drive_profile:
        profile = drive_profile(settings.drive_profile, places["drive_profile"], problems)
        if profile is not None:
            drives = profile.over(drives)
            kept = settings.strength if "strength" in given else profile.strength
            settings = replace(settings, strength=kept)
    if settings.link_profile:
        delays = link_profile(settings.link_profile, places["link_profile"], problems) or {}
        left = {key: value for key, value in delays.items() if _SETTINGS_TABLE + key not in given}
        settings = replace(settings, link=replace(settings.link, **left))
    return settings, sensors, drives


def profile_names(sort: str) -> tuple[str, ...]:
    """The names of the profiles of a sort, `DRIVE`, `SENSOR` or `LINK`."""
    return tuple(sorted(path.stem for path in _folder(sort).glob("*.toml")))


def drive_profile(name: str, place: str, problems: list[Problem]) -> DriveProfile | None:
    """Read a drive profile; None, and problems, if there is none of that name. `place` is the setting or
    option with the name, for messages."""
    before = len(problems)
    file = _file(DRIVE, name, place, problems)
    if file is None:
        return None
    top = file.values((_TITLE, _STRENGTH), others=tuple(DriveKind), needed=True)
    movements = {}
    for kind in DriveKind:
        table = file.tree.get(kind.value)
        if isinstance(table, dict):
            movements[kind] = _movement(file, table, f"{kind.value}.")
        elif kind in _COURSE:
            file.add_problem(kind.value, "this table is missing")
    return None if len(problems) > before else DriveProfile(name, top["title"], top["strength"], movements)


def _movement(file: TomlFile, table: Mapping[str, Any], prefix: str) -> Mapping[str, Any]:
    """The values of one movement, by field."""
    known = [_ENABLED]
    if table.get("enabled") is not False:
        known += [each for each in _MOVEMENT if each.field not in _LESS_USUAL or each.name in table]
    values = file.values(known, table, prefix, needed=True)
    return {each.field: values[each.name] for each in known if each.name in values}


def link_profile(name: str, place: str, problems: list[Problem]) -> Mapping[str, float] | None:
    """Read a link profile: values of the settings in [link] by name; None, and problems, if there is none
    of that name."""
    known = [
        replace(item, name=item.name.removeprefix(_SETTINGS_TABLE))
        for item in all_settings()
        if item.name.startswith(_SETTINGS_TABLE)
    ]
    before = len(problems)
    file = _file(LINK, name, place, problems)
    values = file.values((_TITLE, *known), needed=True) if file is not None else {}
    return {item.name: values[item.name] for item in known} if len(problems) == before else None


def sensor_profiles(
    names: Iterable[str],
    place: str,
    sensors: Iterable[SensorSpec],
    problems: list[Problem],
    kinds: SensorKinds = KINDS,
) -> tuple[SensorProfile, ...]:
    """Read sensor profiles. A profile for a kind without sensors, and a second one for the same kind, are
    problems too."""
    # Otherwise a row may be missing because of its mistakes.
    is_whole = not problems
    profiles: dict[type[SensorKind], SensorProfile] = {}
    present = {sensor.kind for sensor in sensors}
    for name in names:
        profile = _sensor_profile(name, place, problems, kinds)
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


def _sensor_profile(
    name: str, place: str, problems: list[Problem], kinds: SensorKinds
) -> SensorProfile | None:
    """Read one sensor profile. It may have a value of any column except the sensor's place. Its height is
    allowed, because a line sensor's view depends on it."""
    before = len(problems)
    file = _file(SENSOR, name, place, problems)
    if file is None:
        return None
    kind = kinds.get(str(file.tree.get("kind")))
    columns = [replace(c, name=c.field) for c in kind.columns if c not in MOUNTING] if kind else []
    given = [column for column in columns if column.name in file.tree]
    values = file.values((_TITLE, Value(ChoiceRule(tuple(kinds)), name="kind"), *given), needed=True)
    if kind is None or len(problems) > before:
        return None
    return SensorProfile(
        name, values["title"], kind, {column.field: values[column.field] for column in given}
    )


def usual_sensors(sensors: Iterable[SensorSpec], chosen: Iterable[SensorProfile]) -> tuple[str, ...]:
    """The names of the profiles that `realistic` adds to those `chosen`: one for each kind with sensors and
    without a profile."""
    left = {sensor.kind.name for sensor in sensors} - {profile.kind.name for profile in chosen}
    return tuple(name for kind, name in USUAL_SENSORS.items() if kind in left)


def _folder(sort: str) -> Path:
    return bundled_folder() / "profiles" / _FOLDERS[sort]


def _file(sort: str, name: str, place: str, problems: list[Problem]) -> TomlFile | None:
    names = profile_names(sort)
    if name in names:
        return TomlFile.read(_folder(sort) / f"{name}.toml", problems)
    hint = did_you_mean(name, names)
    problems.append(Problem(place, f"there is no such {sort} profile; there are {listed(names)}{hint}"))
    return None
