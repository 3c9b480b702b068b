"""Sets with a lidar: what `check` says of them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from simmer_tui.cli.main import main
from simmer_tui.config.describe_code import describe_code
from simmer_tui.config.loader import Override, load
from simmer_tui.config.set_warnings import set_warnings
from simmer_tui.config.sets import find_set, init_set
from simmer_tui.sim.sensors import LidarSpec


@pytest.fixture
def lidar_set(tmp_path: Path) -> Path:
    init_set(tmp_path / "set", find_set("lidar"))
    return tmp_path / "set"


def row(folder: Path, text: str) -> None:
    path = folder / "sensors.csv"
    lines = path.read_text("utf-8").splitlines()
    path.write_text("\n".join(text if line.startswith("lidar1") else line for line in lines), "utf-8")


def test_the_bundled_set_has_the_defaults_of_a_rplidar() -> None:
    configuration = load(find_set("lidar"))
    lidar = configuration.simulation.sensors[0]
    assert lidar == LidarSpec(kind=lidar.kind, number=1, code="sc", z=5.0)
    assert set_warnings(configuration) == ()


def test_blank_cells_are_a_rplidar_too(lidar_set: Path) -> None:
    row(lidar_set, "lidar1,sc,1,0,0,5,0,,,,,,")
    assert load(lidar_set).simulation.sensors[0] == load(find_set("lidar")).simulation.sensors[0]


@pytest.mark.parametrize(
    ("cells", "problem"),
    [
        ("0.01,,,25,360,1", 'Scan Rate (Hz): must be a number from 1 to 20, not "25"'),
        ("0.01,,,5.5,2001,1", 'Rays: must be a whole number from 1 to 2000, not "2001"'),
        ("0.01,,,5.5,360,2", 'Clockwise: must be "0" or "1", not "2"'),
    ],
)
def test_mistakes_are_told(
    lidar_set: Path, capsys: pytest.CaptureFixture[str], cells: str, problem: str
) -> None:
    row(lidar_set, f"lidar1,sc,1,0,0,5,0,{cells}")
    assert main(["check", str(lidar_set)]) != 0
    assert problem in capsys.readouterr().err


def test_what_may_not_be_as_expected_is_warned_of(
    lidar_set: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    row(lidar_set, "lidar1,sc,1,0,0,5,0,0.01,,,6,1450,1")
    assert main(["check", str(lidar_set), "--listeners", "binary,packets", "--link-profile", "hc-05"]) == 0
    out = capsys.readouterr().out
    assert "Warning: lidar1 takes 8700 ranges a second" in out
    assert "a packet of more than 150 is not read by one recv(1024)" in out
    assert "a scan of lidar1 takes 12.1 s at the hc-05's 9600 baud" in out
    assert main(["check", str(lidar_set), "--serial", "/dev/robot", "--robot-reply", "float32"]) == 0
    assert "a scan of lidar1 takes 6.0 s from /dev/robot at 9600 baud" in capsys.readouterr().out
    assert main(["check", str(lidar_set), "--serial", "/dev/robot", "--baud", "1000000"]) == 0
    assert "a scan of lidar1 takes" not in capsys.readouterr().out
    assert main(["check", str(lidar_set), "--json"]) == 0
    (warning,) = json.loads(capsys.readouterr().out)["warnings"]
    assert warning["text"].startswith("lidar1 takes 8700")


def test_a_float32_scan_over_the_slow_link() -> None:
    options = {"link_profile": "hc-05", "server.reply_format": "float32"}
    changed = {name: Override(name, value) for name, value in options.items()}
    (warning,) = set_warnings(load(find_set("lidar"), changed))
    assert "a scan of lidar1 takes 1.5 s" in warning


def test_the_summary_says_a_missed_ray_as_the_file_does(
    lidar_set: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = lidar_set / "sensors.csv"
    lines = path.read_text("utf-8").splitlines()
    lines[:2] = [f"{lines[0]},Missed", "lidar1,sc,1,0,0,5,0,0.01,,,5.5,360,1,0"]
    path.write_text("\n".join(lines), "utf-8")
    assert main(["check", str(lidar_set)]) == 0
    assert "  missed 0\n" in capsys.readouterr().out


def test_its_code_is_explained() -> None:
    lines = describe_code(load(find_set("lidar")).simulation, "sc")
    assert "Give   sc for all its ranges, sc-90 for that at 90 deg from the robot's front" in lines


def test_an_atlas_has_its_first_ray(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["atlas", str(tmp_path / "a.npz"), "--step", "12", "--config", "lidar"]) == 0
    assert "sc: the first ray of a revolution, along its Rotation" in capsys.readouterr().out
