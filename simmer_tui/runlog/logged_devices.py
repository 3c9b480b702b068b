"""Kinds of sensor that are not built in, in the header of a log: described for readers, hashed for reruns.

A log holds no code. A replay or report uses the description. A rerun or take-over needs the same device files
as the run, found in its set by their hashes, and trusted.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from msgspec import Struct

from simmer_tui.config.device_file import DeviceFile, is_device_name, read_devices
from simmer_tui.config.device_trust import OPTION, is_trusted
from simmer_tui.config.set_devices import DeviceStatus
from simmer_tui.errors import ConfigurationError, Problem, RunLogError
from simmer_tui.sim.command import cut
from simmer_tui.sim.sensors import KINDS, SensorKinds, sensor_kinds
from simmer_tui.sim.sensors.recorded_kinds import RecordedKind, recorded_class, recorded_kind
from simmer_tui.sim.specs import SensorKind, SensorSpec

_SHORT = 12
"""Digits of a hash that a message shows: enough to distinguish files."""


class LoggedDevice(Struct, frozen=True):
    """A device file of the run: its path in the set and the hash of its content."""

    path: str
    sha256: str


def logged_devices(files: Iterable[DeviceFile]) -> tuple[LoggedDevice, ...]:
    """The files of a set, for a header."""
    return tuple(LoggedDevice(file.path, file.sha256) for file in files)


def logged_kinds(sensors: Iterable[SensorSpec]) -> tuple[RecordedKind, ...]:
    """The kinds of sensors that are not built in, described."""
    kinds = dict.fromkeys(sensor.kind for sensor in sensors)
    return tuple(recorded_kind(kind) for kind in kinds if KINDS.get(kind.name) is not kind)


def recorded_kinds(kinds: Iterable[RecordedKind]) -> SensorKinds:
    """The kinds of a log by name, the built-in ones too. Raises RunLogError for an invalid description."""
    found: list[type[SensorKind]] = []
    for kind in kinds:
        if kind.name in KINDS:
            raise RunLogError(f"the header describes {kind.name!r}, which is a built-in kind")
        try:
            found.append(recorded_class(kind))
        except (ValueError, TypeError) as error:
            raise RunLogError(f"the header describes no kind of sensor: {error}") from None
    return sensor_kinds(*found)


REMEDY = "name the folder of its set with --config DIR"


def same_files(
    logged: Iterable[LoggedDevice | DeviceStatus], folder: Path, remedy: str = REMEDY
) -> tuple[DeviceFile, ...]:
    """The files of a run, read from the folder of its set. Raises RunLogError, which ends with a remedy, if
    one is missing or changed."""
    found: list[DeviceFile] = []
    for each in logged:
        if not is_device_name(each.path):
            raise RunLogError(f"the header names {cut(each.path)!r}, which is no device file")
        problems: list[Problem] = []
        files = read_devices(folder, [each.path], "the set of the log", problems)
        needed = f"this needs {each.path} of the run, SHA-256 {cut(each.sha256[:_SHORT])}"
        if not files:
            raise RunLogError(f"{needed}; {problems[0].what}; {remedy}")
        if files[0].sha256 != each.sha256:
            shown = str(folder)
            raise RunLogError(f"{needed}; in {shown} it is another, {files[0].sha256[:_SHORT]}; {remedy}")
        found += files
    return tuple(found)


def runnable_kinds(files: Iterable[DeviceFile], folder: Path) -> SensorKinds:
    """The kinds of trusted files, which are run, and the built-in ones. Raises RunLogError for one that is
    not trusted."""
    from simmer_tui.config.device_code import kinds_of

    found: list[type[SensorKind]] = []
    for file in files:
        if not is_trusted(file, folder):
            raise RunLogError(
                f"{file.path} in {folder} is code that you have not trusted yet "
                f"(SHA-256 {file.sha256[:_SHORT]}): read it, then add {OPTION}"
            )
        try:
            found += kinds_of(file)
        except ConfigurationError as error:
            raise RunLogError(str(error)) from None
    return sensor_kinds(*found)
