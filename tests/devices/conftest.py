"""A set with a device of its own, and a user who has trusted nothing yet."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from simmer_tui.config.device_file import DeviceFile
from simmer_tui.config.device_trust import VARIABLE, remember
from simmer_tui.config.sets import bundled_folder, init_set

THERMAL = '''"""A thermometer: warmer by a degree for each 10 in to the right."""

from simmer_tui.sim import ObservingSensor, SensorSpec
from simmer_tui.sim import columns
from simmer_tui.sim.columns import CsvColumn
from simmer_tui.sim.rules import NumberRule


class ThermalSpec(SensorSpec, frozen=True, kw_only=True):
    ambient: float = 20.0


class Thermal(ObservingSensor):
    name = "temp"
    meaning = "temperature"
    unit = "C"
    spec_type = ThermalSpec
    columns = (columns.ERROR, CsvColumn(NumberRule(), name="Ambient (C)", field="ambient"))

    def observe(self, world, pose):
        return self.spec.ambient + pose.x / 10, None
'''
"""The text of a device file that works."""
DEVICE = "devices/thermal.py"


@pytest.fixture(autouse=True)
def data_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The data folder of a user who has trusted nothing, here and in processes that tests start."""
    home = tmp_path / "data"
    monkeypatch.setenv("XDG_DATA_HOME", str(home))
    monkeypatch.delenv(VARIABLE, raising=False)
    return home


MakeSet = Callable[..., Path]


@pytest.fixture
def make_set(tmp_path: Path) -> MakeSet:
    """Makes a copy of the default set with a device of a text, and a row of it; `trusted` unless told."""

    def make(text: str = THERMAL, *, trusted: bool = True, row: str = "temp1,h1,1,,,,,0,,,17") -> Path:
        """A row with 11 cells has the device's own column."""
        folder = tmp_path / "set"
        init_set(folder, bundled_folder())
        rows = folder / "sensors.csv"
        head, *lines = rows.read_text().splitlines()
        has_own = row.count(",") > head.count(",")
        made = [f"{head},Ambient (C)" if has_own else head, *(f"{line}," for line in lines), row]
        rows.write_text("\n".join(made) + "\n")
        settings = folder / "settings.toml"
        settings.write_text(f'{settings.read_text()}\n[sensors]\ndevices = ["{DEVICE}"]\n')
        (folder / DEVICE).parent.mkdir()
        (folder / DEVICE).write_text(text)
        if trusted:
            trust(folder)
        return folder

    return make


def trust(folder: Path, name: str = DEVICE) -> None:
    """Say yes to the present content of a device file."""
    remember(DeviceFile(name, (folder / name).read_bytes()), folder)
