"""`simmer-tui import FILE DIR`, and the set it writes."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from simmer_tui.cli.import_command import run_import
from simmer_tui.config.importer.imported import COURSE_MAZE, Imported, SettingValue
from simmer_tui.config.importer.set_writer import settings_text, write_set
from simmer_tui.config.loader import load
from simmer_tui.config.settings import all_settings
from simmer_tui.sim.sensors import (
    Gyro,
    GyroSpec,
    LineSensor,
    LineSpec,
    RangeSpec,
    TimeOfFlight,
    Ultrasonic,
    UltrasonicSpec,
)
from simmer_tui.sim.specs import Axes, DriveKind, DriveSpec, RobotSpec

SENSORS = (
    UltrasonicSpec(kind=Ultrasonic, number=3, code="u3", x=1 / 3, y=-2.0, z=2.0, field_of_view=5.0),
    RangeSpec(kind=TimeOfFlight, number=1, code="t1", field_of_view=25.0, max_range=47.0, resolution=0.1),
    RangeSpec(kind=TimeOfFlight, number=2, code="t2", field_of_view=25.0, max_range=20.0, min_range=1.0),
    LineSpec(kind=LineSensor, number=1, code="i1", enabled=False, z=1.0, threshold=0.5),
    GyroSpec(kind=Gyro, number=0, code="g0", gain=-1.0, drift=1e-7, wrap=360.0, error=0.5),
)


@pytest.mark.parametrize(
    "robot",
    [
        RobotSpec.circle(5.5),
        RobotSpec.rectangle(5.0, 3.0),
        RobotSpec.polygon(((4.0, 0.0), (-2.0, 2.5), (-2.0, -1.25))),
    ],
    ids=["circle", "rectangle", "polygon"],
)
def test_what_is_written_is_what_is_loaded(robot: RobotSpec, tmp_path: Path) -> None:
    drives = (
        DriveSpec(
            kind=DriveKind.UP, code="w1", error=Axes(0.1, 0.2, 0.3), bias=Axes(-0.1, 1e-5, 0.0), speed=5.5
        ),
        DriveSpec(kind=DriveKind.ROT, code="r1", enabled=False, gain=-1.0, speed=90.0),
    )
    settings: dict[str, SettingValue] = {
        "bot_center": (10.0, 41.5),
        "randbias": False,
        "seed": 7,
        "server.reply_format": "float32",
    }
    write_set(Imported(COURSE_MAZE, robot, SENSORS, drives, settings, ()), tmp_path)
    loaded = load(tmp_path)
    assert loaded.simulation.maze == COURSE_MAZE
    assert loaded.simulation.robot == robot
    assert loaded.simulation.sensors == SENSORS
    assert loaded.simulation.drives == drives
    assert loaded.settings.bot_center == (10.0, 41.5)
    assert (loaded.settings.randbias, loaded.settings.seed) == (False, 7)
    assert loaded.settings.server.reply_format == "float32"


def test_settings_hold_every_setting_with_its_meaning() -> None:
    text = settings_text({})
    tree = tomllib.loads(text)
    for item in all_settings():
        table, _, key = item.name.rpartition(".")
        value = (tree[table] if table else tree)[key]
        assert item.rule.check(value) == item.default
    assert text.count("\n# ") == len(all_settings())


def test_a_setting_that_does_not_exist_is_not_written() -> None:
    with pytest.raises(KeyError):
        settings_text({"server.prot": 1})


def test_a_team_s_config_py_becomes_a_set_that_loads(
    stock: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "config.py"
    source.write_bytes(b"\xef\xbb\xbf" + stock.replace("\n", "\r\n").encode())
    assert run_import([str(source), str(tmp_path / "set")]) == 0
    out = capsys.readouterr().out
    assert "settings.toml" in out
    assert "Not imported" not in out
    assert load(tmp_path / "set").settings.bot_rot == 90.0


def test_what_is_left_out_is_printed_with_its_line(
    stock: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "team.py"
    line = stock.count("\n") + 1
    source.write_text(stock + "sensors['l0'] = Lidar({})\n", encoding="utf-8")
    assert run_import([str(source), str(tmp_path / "set")]) == 0
    assert f"  team.py:{line}:l0: Lidar is a device of the team's own" in capsys.readouterr().out


@pytest.mark.parametrize("named", ["Main.m", ""])
def test_a_script_or_its_folder_becomes_a_set(matlab_folder: Path, tmp_path: Path, named: str) -> None:
    assert run_import([str(matlab_folder / named), str(tmp_path / "set")]) == 0
    assert load(tmp_path / "set").settings.num_segments == 20


def test_the_folder_of_a_config_py_becomes_a_set(stock: str, tmp_path: Path) -> None:
    (tmp_path / "config.py").write_text(stock, encoding="utf-8")
    (tmp_path / "main.py").write_text("print('the simulator')\n", encoding="utf-8")
    assert run_import([str(tmp_path), str(tmp_path / "set")]) == 0
    assert load(tmp_path / "set").settings.bot_rot == 90.0


def test_csv_files_beside_main_m_are_found(matlab_folder: Path, tmp_path: Path) -> None:
    for path in (matlab_folder / "config").iterdir():
        path.rename(matlab_folder / path.name)
    (matlab_folder / "config").rmdir()
    assert run_import([str(matlab_folder), str(tmp_path / "set")]) == 0
    assert load(tmp_path / "set").simulation.sensors[0].id == "ultra1"


def test_a_folder_with_both_or_neither_says_what_to_name(
    stock: str, matlab_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (matlab_folder / "config.py").write_text(stock, encoding="utf-8")
    assert run_import([str(matlab_folder), str(tmp_path / "set")]) == 2
    assert "has a Main.m and a config.py: name the one" in capsys.readouterr().err
    assert run_import([str(tmp_path), str(tmp_path / "set")]) == 2
    assert "has no Main.m and no config.py" in capsys.readouterr().err
    assert not (tmp_path / "set").exists()


CONTROL_PROGRAM = """
import socket, time
host = '127.0.0.1'
port_tx = 61200
timeout = 1
frame_start, frame_end = '[', ']'
sensors = ['u0', 'u1']
drives = {'forward': 'w0', 'turn': 'r0'}
def transmit(data):
    with socket.socket() as s:
        s.connect((host, port_tx))
        s.send(data.encode())
while True:
    for code in sensors:
        transmit(code)
"""


@pytest.mark.parametrize(
    "text", [CONTROL_PROGRAM, "", "print('hello')\n", "sensors = read()\n", "walls = 3\n"]
)
def test_a_program_that_is_no_configuration_is_refused(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "main.py"
    source.write_text(text, encoding="utf-8")
    assert run_import([str(source), str(tmp_path / "set")]) == 2
    said = capsys.readouterr().err
    assert "main.py: is no configuration" in said
    assert "config.py of simmer-python" in said
    assert not (tmp_path / "set").exists()


def test_a_script_that_is_no_main_m_is_refused(
    matlab_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    script = matlab_folder / "control.m"
    script.write_text("s = tcpclient('localhost', 9000);\nu1 = take_reading('u1', s);\n", encoding="utf-8")
    assert run_import([str(script), str(tmp_path / "set")]) == 2
    assert "control.m: is no configuration" in capsys.readouterr().err
    assert not (tmp_path / "set").exists()


def test_a_set_that_still_needs_editing_is_written_and_says_why(
    stock: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "config.py"
    source.write_text(stock + "walls = [[0, 0], [0, 0], [0, 0], [0, 0]]\n", encoding="utf-8")
    assert run_import([str(source), str(tmp_path / "set")]) == 1
    captured = capsys.readouterr()
    assert "bot_center" in captured.err
    assert (tmp_path / "set" / "settings.toml").exists()


def test_nothing_is_overwritten(stock: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "config.py"
    source.write_text(stock, encoding="utf-8")
    (tmp_path / "drive.csv").write_text("mine", encoding="utf-8")
    assert run_import([str(source), str(tmp_path)]) == 2
    assert "drive.csv already" in capsys.readouterr().err
    assert (tmp_path / "drive.csv").read_text(encoding="utf-8") == "mine"
    assert not (tmp_path / "maze.csv").exists()


@pytest.mark.parametrize("name", ["missing.py", "missing.m", "notes.txt"])
def test_a_file_that_cannot_be_imported_is_refused(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_import([str(tmp_path / name), str(tmp_path / "set")]) == 2
    assert name.split(".")[0] in capsys.readouterr().err or name.endswith(".m")
    assert not (tmp_path / "set").exists()


@pytest.mark.parametrize("name", ["nowhere", "nowhere.py"])
def test_a_path_that_does_not_exist_is_said_to_be_missing(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_import([str(tmp_path / name), str(tmp_path / "set")]) == 2
    assert "o such file or" in capsys.readouterr().err


def test_a_target_that_is_a_file_is_refused(
    stock: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "config.py"
    source.write_text(stock, encoding="utf-8")
    assert run_import([str(source), str(source)]) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_an_import_gets_a_mission_with_codes_that_are_free(tmp_path: Path, stock: str) -> None:
    config = tmp_path / "config.py"
    config.write_text(stock.replace("'u1': Ultra", "'p1': Ultra"), encoding="utf-8")
    assert run_import([str(config), str(tmp_path / "set"), "--mission"]) == 0
    made = load(tmp_path / "set")
    assert made.mission is not None
    assert made.simulation.gripper is not None
    assert made.simulation.gripper.code == "p2"
    assert [sensor.code for sensor in made.simulation.sensors][-1] == "l1"
