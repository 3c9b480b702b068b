"""A team's own device on the screen: its readings, its rays, and its faults."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.config.device_trust import VARIABLE
from simmer_tui.config.sets import bundled_folder
from tests.devices.conftest import DEVICE, THERMAL
from tests.tui.conftest import KEYS

Fly = Callable[..., int | None]
Cockpit = Any


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """The files of a set whose thermometer, which also draws a ray, fails beyond x = 12, and is trusted."""
    text = THERMAL.replace(
        "        return self.spec.ambient + pose.x / 10, None",
        "        ray = RangeScan((pose.x, pose.y), (pose.heading,), (6.0,))\n"
        "        return 20 + [0.5][int(pose.x > 12)], ray",
    ).replace("import ObservingSensor", "import ObservingSensor, RangeScan")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setenv(VARIABLE, hashlib.sha256(text.encode()).hexdigest())
    folder = bundled_folder()
    return {
        "sensors.csv": (folder / "sensors.csv").read_text() + "temp1,h1,1,,,,,0,,\n",
        "settings.toml": f'{(folder / "settings.toml").read_text()}\n[sensors]\ndevices = ["{DEVICE}"]\n',
        DEVICE: text,
    }


@pytest.mark.slow
def test_it_is_read_and_drawn_and_its_fault_is_told(fly: Fly, files: dict[str, str]) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.press(KEYS.truth)
        await cockpit.type("h1")
        await cockpit.until(lambda: "20.5" in cockpit["sensors"])
        (view,) = [each.view for each in cockpit.maze.scene.views]
        assert view.distances == (6.0,)
        await cockpit.type("d1-5")
        await cockpit.type("h1")
        await cockpit.until(lambda: "IndexError" in cockpit["log"])
        await cockpit.type("u1")
        await cockpit.until(lambda: cockpit.commands("console")[-1] == "u1")
        assert not cockpit.app.fault

    fly(scenario, files=files, screen__pace=0)
