"""The device files of a set, once they were read: their states, their kinds, and the sensors of these."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct

from simmer_tui.config.sensors_csv import load_sensors
from simmer_tui.errors import Problem
from simmer_tui.sim.sensors import SensorKinds, sensor_of
from simmer_tui.sim.specs import SensorSpec

if TYPE_CHECKING:  # few sets have devices
    from simmer_tui.config.device_file import DeviceFile


class DeviceStatus(Struct, frozen=True):
    """The state of a set's device file: True in `ran` if it was run and so checked, the names of its kinds,
    and its unfinished methods, each with its place."""

    path: str
    sha256: str
    trusted: bool
    ran: bool
    kinds: tuple[str, ...]
    unfinished: tuple[str, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """The checks that were left out, and the methods that are unfinished, a line each."""
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
        """The files if they ran; those that were only parsed must not run elsewhere either."""
        return self.files if all(each.ran for each in self.statuses) else ()

    def load_sensors(
        self, directory: Path, codes: dict[str, str], problems: list[Problem]
    ) -> tuple[SensorSpec, ...]:
        """Read sensors.csv. Faults of device files, constructors included, are problems too."""
        if not self.files:
            return load_sensors(directory, codes, problems, self.kinds)
        from simmer_tui.config.device_code import device_faults

        with device_faults(self.files, problems):
            sensors = load_sensors(directory, codes, problems, self.kinds)
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
