"""A MATLAB `Main.m` with its `config` folder becomes a set."""

from __future__ import annotations

from pathlib import Path

import pytest

from simmer_tui.config.importer.imported import Imported
from simmer_tui.config.importer.matlab import read_matlab
from simmer_tui.config.importer.set_writer import write_set
from simmer_tui.config.loader import load
from simmer_tui.errors import ConfigurationError
from simmer_tui.sim.sensors import LineSensor
from simmer_tui.sim.specs import DriveKind, RobotSpec


def listed(imported: Imported, place: str) -> str:
    (found,) = [problem.what for problem in imported.left_out if problem.where == place]
    return found


def rewrite(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")


def test_pose_block_flags_and_ports_come_from_the_script(matlab_folder: Path) -> None:
    assert read_matlab(matlab_folder).settings == {
        "bot_center": (9.5, 42.0),
        "bot_rot": -90.0,
        "block_center": (25.0, 41.0),
        "blocksize": 3.0,
        "num_segments": 20,
        "strength": (0.1, 2.0),
        "step_time": 0.0,
        "randerror": False,
        "randbias": True,
        "plot_robot": True,
        "plot_sense": False,
        "server.port": 9100,
        "server.reply_port": 9101,
        "server.reply_format": "float32",
    }


def test_the_csv_files_are_taken_as_they_are_and_bad_rows_listed(matlab_folder: Path) -> None:
    imported = read_matlab(matlab_folder)
    assert imported.robot == RobotSpec.rectangle(5.0, 4.0)
    assert [(s.id, s.enabled) for s in imported.sensors] == [("ultra1", True), ("ir1", False)]
    assert imported.sensors[1].kind is LineSensor
    assert [drive.kind for drive in imported.drives] == [DriveKind.RIGHT, DriveKind.ROT]
    assert "radar1" in listed(imported, "sensors.csv:3:ID")


def test_the_set_loads_as_it_was_read(matlab_folder: Path, tmp_path: Path) -> None:
    imported = read_matlab(matlab_folder)
    write_set(imported, tmp_path / "set")
    loaded = load(tmp_path / "set")
    assert loaded.simulation.maze == imported.maze
    assert loaded.simulation.sensors == imported.sensors
    assert loaded.simulation.drives == imported.drives
    assert loaded.settings.bot_rot == -90.0
    assert loaded.settings.server.reply_format == "float32"


@pytest.mark.parametrize(
    ("precision", "expected"), [("'double'", "float64"), ('"single"', "float32"), ("'float32'", "float32")]
)
def test_replies_are_as_wide_as_the_folder_s_own_reads(
    matlab_folder: Path, precision: str, expected: str
) -> None:
    rewrite(matlab_folder / "tcpclient_write.m", "'single'", precision)
    rewrite(matlab_folder / "Main.m", "'single'", precision)
    imported = read_matlab(matlab_folder)
    assert imported.settings["server.reply_format"] == expected
    assert not [problem for problem in imported.left_out if "fread" in problem.where]


def test_reads_that_disagree_with_the_writes_win_and_are_listed(matlab_folder: Path) -> None:
    rewrite(matlab_folder / "tcpclient_write.m", "'single'", "'double'")
    imported = read_matlab(matlab_folder)
    assert imported.settings["server.reply_format"] == "float64"
    assert "disagree" in listed(imported, "Main.m:fread")


def test_a_read_that_is_commented_out_does_not_count(matlab_folder: Path) -> None:
    rewrite(matlab_folder / "tcpclient_write.m", "reply =", "% reply =")
    assert read_matlab(matlab_folder).settings["server.reply_format"] == "float32"
    rewrite(matlab_folder / "Main.m", "    fwrite", "    %fwrite")
    imported = read_matlab(matlab_folder)
    assert "server.reply_format" not in imported.settings
    assert "doubles" in listed(imported, "Main.m:fread")


def test_a_tcpclient_object_reads_little_endian_and_a_tcpip_object_big(matlab_folder: Path) -> None:
    setup = matlab_folder / "tcp_setup.m"
    setup.write_text("s = tcpclient('localhost', 9000);\n", encoding="utf-8")
    assert read_matlab(matlab_folder).settings["server.byte_order"] == "little"
    setup.write_text("s = tcpip('localhost', 9000);\n", encoding="utf-8")
    assert "server.byte_order" not in read_matlab(matlab_folder).settings


@pytest.mark.parametrize(
    ("old", "new", "place", "word"),
    [
        ("bot_rot = -90", "bot_rot = start_angle", "Main.m:3:bot_rot", "not a plain number"),
        ("num_segments = 20", "num_segments = 0", "Main.m:6:num_segments", "10000"),
        ("bot_rot = -90;", "", "Main.m:bot_rot", "keeps its default"),
        ("9100, 9101", "9100, 9100", "Main.m:18:tcp_setup", "port 9100 twice"),
        ("sim = 1", "sim = 0", "Main.m:14:sim", "serial port"),
        ("bot_perim = import_bot", "bot_perim = my_shape", "Main.m:17:bot_perim", "robot.csv"),
    ],
)
def test_what_cannot_be_taken_over_is_listed(
    matlab_folder: Path, old: str, new: str, place: str, word: str
) -> None:
    rewrite(matlab_folder / "Main.m", old, new)
    assert word in listed(read_matlab(matlab_folder), place)


def test_missing_or_bad_files_are_stood_in_for_and_listed(matlab_folder: Path) -> None:
    (matlab_folder / "config" / "maze.csv").unlink()
    rewrite(matlab_folder / "config" / "robot.csv", ",1", ",9")
    imported = read_matlab(matlab_folder)
    assert (imported.maze.rows, imported.maze.columns) == (4, 8)
    assert imported.robot == RobotSpec.circle(6.0)
    assert any("circle of 6 in" in problem.what for problem in imported.left_out)


@pytest.mark.parametrize(("file", "parts"), [("sensors.csv", "sensors"), ("drive.csv", "drives")])
def test_a_missing_table_of_parts_says_that_the_set_has_none(
    file: str, parts: str, matlab_folder: Path
) -> None:
    (matlab_folder / "config" / file).unlink()
    said = [problem.what for problem in read_matlab(matlab_folder).left_out if problem.where == file]
    assert said[-1] == f"the set has no {parts}: add them to the new {file}"


def test_no_block_at_all_is_a_side_of_0(matlab_folder: Path) -> None:
    rewrite(matlab_folder / "Main.m", "blocksize = 6/2", "blocksize = 0")
    imported = read_matlab(matlab_folder)
    assert imported.settings["blocksize"] == 0.0
    assert not [problem for problem in imported.left_out if "block" in problem.where]


def test_a_start_in_a_wall_is_moved_and_listed(matlab_folder: Path) -> None:
    rewrite(matlab_folder / "Main.m", "[9.5,42]", "[18 30]")
    imported = read_matlab(matlab_folder)
    assert imported.settings["bot_center"] == (6.0, 42.0)
    assert "overlaps a wall" in listed(imported, "Main.m:2:bot_center")


def test_a_percent_sign_in_a_text_starts_no_comment(matlab_folder: Path) -> None:
    rewrite(matlab_folder / "tcpclient_write.m", "reply =", "disp('100%'); a = b'; reply =")
    assert read_matlab(matlab_folder).settings["server.reply_format"] == "float32"


def test_a_script_in_an_old_encoding_is_read(matlab_folder: Path) -> None:
    path = matlab_folder / "Main.m"
    path.write_bytes(b"% r\xe9glages\n" + path.read_bytes())
    assert read_matlab(matlab_folder).settings["bot_rot"] == -90.0


def test_a_folder_without_script_or_config_is_refused(matlab_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="cannot be read"):
        read_matlab(tmp_path)
    (tmp_path / "Main.m").write_text("sim = 1;\n", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"maze\.csv"):
        read_matlab(tmp_path)
