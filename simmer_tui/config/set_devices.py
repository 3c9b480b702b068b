"""A set's own kinds of sensor, from its device files, run or parsed; and their sensors.

Modules that read and run device files are imported on demand, since few sets have devices.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct

from simmer_tui.config.device_trust import DeviceUse, is_trusted, untrusted
from simmer_tui.config.sensors_csv import load_sensors
from simmer_tui.config.settings_file import LoadedSettings
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.rules import listed
from simmer_tui.sim.sensors import SensorKinds, sensor_of
from simmer_tui.sim.specs import SensorKind, SensorSpec

if TYPE_CHECKING:
    from simmer_tui.config.device_file import DeviceFile
    from simmer_tui.config.device_outline import DeviceOutline

SETTING = "sensors.devices"
"""The setting that names the files."""


class DeviceStatus(Struct, frozen=True):
    """The state of a set's device file: `ran` is True if it was run and so checked. With it are the names of
    its kinds, and its unfinished methods, each with its place."""

    path: str
    sha256: str
    trusted: bool
    ran: bool
    kinds: tuple[str, ...]
    unfinished: tuple[str, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """The skipped checks, and the unfinished methods, a line each."""
        left_out = "not trusted, so only parsed: its columns, cells and readings are not checked"
        unfinished = [f"unfinished: {each} raises NotImplementedError" for each in self.unfinished]
        return (*(() if self.ran else (left_out,)), *unfinished)


class SetDevices(Struct, frozen=True):
    """The device files of a set, with all kinds that its sensors.csv may name."""

    kinds: SensorKinds
    files: tuple[DeviceFile, ...] = ()
    statuses: tuple[DeviceStatus, ...] = ()

    @property
    def run_files(self) -> tuple[DeviceFile, ...]:
        """The files if they ran, else none: files that were only parsed must not run in other processes
        either."""
        return self.files if all(each.ran for each in self.statuses) else ()

    def load_sensors(
        self, directory: Path, codes: dict[str, str], problems: list[Problem], longest: float
    ) -> tuple[SensorSpec, ...]:
        """Read sensors.csv. Faults of device files, constructors included, are problems too. `longest` is the
        longest distance in the maze, inches."""
        if not self.files:
            return load_sensors(directory, codes, problems, self.kinds, longest)
        from simmer_tui.config.device_code import device_faults

        with device_faults(self.files, problems):
            sensors = load_sensors(directory, codes, problems, self.kinds, longest)
            for row in sensors:
                if row.kind.is_opaque:
                    sensor = sensor_of(row)
                    if type(sensor) is not row.kind or vars(sensor).get("spec") is not row:
                        path = next(each.path for each in self.statuses if row.kind.name in each.kinds)
                        what = (
                            f"{row.kind.__name__} has no row: its __init__ must call super().__init__(spec)"
                        )
                        problems.append(Problem(path, what))
            return sensors
        return ()


def set_devices(directory: Path, loaded: LoadedSettings, kinds: SensorKinds, use: DeviceUse) -> SetDevices:
    """The devices of a set.

    Args:
        directory: The folder of the set.
        loaded: Its settings, which name them.
        kinds: The kinds that exist without them.
        use: The command's use of the files.

    Raises:
        ConfigurationError: with every mistake in them.
    """
    names, place = loaded.settings.sensors.devices, loaded.places[SETTING]
    if not names or use is DeviceUse.GIVEN:
        return SetDevices(kinds)
    from simmer_tui.config.device_file import read_devices
    from simmer_tui.config.device_outline import outline_of

    problems: list[Problem] = []
    files = read_devices(directory, names, place, problems)
    known = dict(kinds)
    owners: dict[str, str] = {}
    statuses = []
    for file in files:
        outline = outline_of(file, problems)
        if problems:
            continue
        trusted = use is not DeviceUse.PARSE and is_trusted(file, directory, asks=use is DeviceUse.RUN)
        if use is DeviceUse.RUN and not trusted:
            problems.append(untrusted(file, place))
            continue
        found = _found(file, outline, problems) if trusted else outline.kinds
        for kind in found:
            if kind.name in known:
                taken = owners.get(kind.name, "a built-in kind")
                what = f"{kind.__name__} has the name {kind.name!r} of {taken}; built in are {listed(kinds)}"
                problems.append(Problem(file.path, what))
            known[kind.name] = kind
            owners[kind.name] = f"{kind.__name__} in {file.path}"
        names_found = tuple(kind.name for kind in found)
        statuses.append(
            DeviceStatus(file.path, file.sha256, trusted, trusted, names_found, outline.unfinished)
        )
    if problems:
        raise ConfigurationError(problems)
    return SetDevices(known, files, tuple(statuses))


def _found(file: DeviceFile, outline: DeviceOutline, problems: list[Problem]) -> tuple[type[SensorKind], ...]:
    """The kinds of a file, which is run. If it cannot be run, the kinds of its outline; its problems are
    added."""
    from simmer_tui.config.device_code import kinds_of

    try:
        return kinds_of(file)
    except ConfigurationError as error:
        problems += error.problems
        return outline.kinds
