"""Skeletons that an import writes of a team's own device classes, to be finished."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from simmer_tui.cli.import_command import run_import
from simmer_tui.cli.main import main
from simmer_tui.config.importer.files import read_path
from simmer_tui.config.importer.set_writer import write_set
from simmer_tui.config.loader import load
from simmer_tui.notebook import load as load_trusted
from simmer_tui.sim import Simulator
from simmer_tui.sim.records import Status

CONFIG = """
walls = [[1, 1, 1], [1, 1, 1]]
robot_start_position = [6, 6]
sensors = {
    'c0': ColorSensor({'position': [-1, 2], 'rotation': 90, 'error': 0.01, 'gain': 3}),
    'c1': ColorSensor({'position': [1, 2]}),
    'u0': Ultrasonic({'position': [0, 3]}),
    'x0': Elsewhere({}),
    'l0': Lidar({'position': [0, 0]}),
}
drives = {}
"""
CLASS = """
import nosuch
raise SystemExit('it ran')


class ColorSensor(Device):
    def __init__(self, info):
        self.threshold = 0.25
        self.height = 1e999
        self.num_rays = info.get('num_rays', 9)

    def simulate(self, value, environment):
        return 1 / 0


class Lidar(Device):
    max_range = 300
"""


@pytest.fixture
def team(tmp_path: Path) -> Path:
    folder = tmp_path / "team"
    (folder / "devices").mkdir(parents=True)
    (folder / "config.py").write_text(CONFIG)
    (folder / "devices" / "color.py").write_text(CLASS)
    return folder


def test_a_skeleton_has_the_numbers_and_says_what_is_left(
    team: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    made = tmp_path / "set"
    assert run_import([str(team), str(made)]) == 0
    out = capsys.readouterr().out
    note = "ColorSensor of the team's own: devices/colorsensor.py has its numbers; write observe in it"
    assert f"c0: {note} (row colorsensor0)" in out
    assert "x0: Elsewhere is a device of the team's own or belongs elsewhere; left out" in out
    assert "To finish: devices/colorsensor.py, devices/lidar.py" in out
    text = (made / "devices" / "colorsensor.py").read_text()
    assert "    THRESHOLD = 0.25  # devices/color.py:" in text
    assert "    NUM_RAYS = 9  # devices/color.py:" in text
    assert "HEIGHT" not in text, "infinity is no literal"
    assert "rotation 90, error 0.01, gain 3" in text
    rows = (made / "sensors.csv").read_text().splitlines()
    assert any(row.startswith("colorsensor0,c0,1,2,-1,0,-90,0.01,") for row in rows)
    assert any(row.startswith("ownlidar0,l0,1,") for row in rows), "lidar is a built-in kind"

    assert main(["check", str(made), "--json"]) == 0
    devices = {each["path"]: each for each in json.loads(capsys.readouterr().out)["devices"]}
    line = text[: text.index("def observe")].count("\n") + 1
    unfinished = f"devices/colorsensor.py:{line}: ColorSensor.observe"
    assert devices["devices/colorsensor.py"]["unfinished"] == [unfinished]
    assert main(["check", str(made)]) == 0
    assert f"unfinished: {unfinished} raises NotImplementedError" in capsys.readouterr().out

    result = Simulator(load_trusted(made, trust_devices=True).simulation, 7).execute("c0")
    assert result.status is Status.UNANSWERED
    assert result.reason == (
        f"devices/colorsensor.py:{line + 2}: ColorSensor.observe is not written yet: write what ColorSensor "
        "reads, in devices/colorsensor.py"
    )


def test_without_the_command_they_stay_left_out(team: Path, tmp_path: Path) -> None:
    made = tmp_path / "set"
    made.mkdir()
    imported = read_path(team)
    assert [each.title for each in imported.devices] == ["ColorSensor", "ColorSensor", "Lidar"]
    write_set(imported, made)
    assert [each.code for each in load(made).simulation.sensors] == ["u0"]


def test_a_class_under_a_code_that_is_taken_stays_left_out(
    team: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = team / "config.py"
    config.write_text(CONFIG.replace("drives = {}", "motors = {'c0': Ultrasonic({}), 'c1': Ultrasonic({})}"))
    assert run_import([str(team), str(tmp_path / "set")]) in (0, 1)
    out = capsys.readouterr().out
    assert "To finish: devices/lidar.py " in out
    assert "c0: ColorSensor is a device of the team's own" in out
