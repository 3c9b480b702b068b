from __future__ import annotations

import io
import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from simmer_tui.cli.check_command import run_check
from simmer_tui.cli.init_command import run_init
from simmer_tui.cli.main import main
from simmer_tui.config.loader import load
from simmer_tui.config.set_summary import summarize
from simmer_tui.config.sets import FILES, bundled_folder, bundled_sets, find_set, init_set
from simmer_tui.config.settings_file import Override
from simmer_tui.errors import ConfigurationError, printable
from simmer_tui.sim.command import typed_path
from simmer_tui.sim.sensors import sensor_kinds
from tests.in_process import simmer

Edit = Callable[[str, str, str], None]


def test_commands_to_type_name_a_folder_as_it_is_called(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """They had `\\xdc` for the letter, and no quotes around the space."""
    monkeypatch.chdir(tmp_path)
    assert run_init(["Übung 1"]) == 0
    assert run_init(["Übung 2", "--term"]) == 0
    last = [line for line in capsys.readouterr().out.splitlines() if line.startswith("Edit ")]
    assert [line.partition(": ")[2] for line in last] == [
        "simmer-tui check 'Übung 1'",
        "simmer-tui check 'Übung 2'",
    ]
    assert (printable(typed_path("a\x1bb")), typed_path(Path("команда"))) == (r"'a\x1bb'", "'команда'")


def test_course_that_is_there_already_is_told_in_two_lines(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All of its 51 files were named."""
    for code in (0, 2):
        assert run_init([str(tmp_path), "--term"]) == code
    said = capsys.readouterr().err.removeprefix(f"{tmp_path}: ")
    assert said.startswith("has config/drive.csv, ")
    assert " more already; nothing is overwritten" in said
    assert len(said) < 240


def test_init_writes_a_set_that_check_accepts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = tmp_path / "new" / "deep"
    assert run_init([str(place)]) == 0
    assert sorted(path.name for path in place.iterdir()) == sorted([*FILES, ".schema"])
    out, err = capsys.readouterr()
    assert out.splitlines()[-1] == f"Edit them, then: simmer-tui check {place}"
    assert err == ""
    assert run_check([str(place)]) == 0
    assert capsys.readouterr().out.startswith(f"Configuration: {place}\n")


def test_init_never_overwrites_and_writes_nothing_then(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "robot.csv").write_text("mine")
    assert run_init([str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err == f"{tmp_path}: has robot.csv already; nothing is overwritten, name another folder\n"
    assert [path.name for path in tmp_path.iterdir()] == ["robot.csv"]
    assert (tmp_path / "robot.csv").read_text() == "mine"


def test_init_copies_another_set_with_its_floor(folder: Path, tmp_path: Path) -> None:
    (folder / "floor.csv").write_text("0")
    (folder / "notes").mkdir()
    assert run_init([str(tmp_path / "copy"), "--from", str(folder)]) == 0
    assert sorted(path.name for path in (tmp_path / "copy").iterdir()) == sorted(
        [*FILES, ".schema", "floor.csv"]
    )


def test_init_into_a_file_or_from_an_empty_folder_is_one_clear_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "empty").mkdir()
    assert run_init([str(tmp_path / "file")]) == 2
    assert "file: cannot be written: it is a file, not a folder\n" in capsys.readouterr().err
    assert run_init([str(tmp_path / "new"), "--from", str(tmp_path / "empty")]) == 2
    assert "holds no files of a set to copy" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_a_mission_is_not_added_to_an_empty_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    init_set(tmp_path / "set", bundled_folder())
    (tmp_path / "set" / "drive.csv").write_bytes(b"")
    assert run_init([str(tmp_path / "new"), "--from", str(tmp_path / "set"), "--mission"]) == 2
    assert capsys.readouterr().err == "drive.csv: the file is empty\n"


def test_a_dialect_of_a_set_without_drives_is_one_clear_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    init_set(tmp_path / "set", bundled_folder())
    (tmp_path / "set" / "drive.csv").unlink()
    assert run_init([str(tmp_path / "new"), "--from", str(tmp_path / "set"), "--dialect", "line"]) == 2
    assert capsys.readouterr().err == "drive.csv: is missing from the set\n"


def test_a_dialect_asks_a_sensor_that_the_robot_has(folder: Path, edit: Edit, tmp_path: Path) -> None:
    edit("sensors.csv", "ultra1,u1,1", "ultra1,u1,0")
    assert run_init([str(tmp_path / "new"), "--from", str(folder), "--dialect", "line"]) == 0
    assert "{u2*cm:.1f}" in (tmp_path / "new" / "dialect.toml").read_text()
    assert run_check([str(tmp_path / "new")]) == 0


def test_init_without_folder_is_a_usage_error_of_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        run_init([])
    assert caught.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    "argv", [["init", ""], ["examples", " "], ["import", "config.py", ""], ["grade", ""], ["atlas", ""]]
)
def test_a_blank_name_of_a_file_or_folder_is_not_the_present_folder(
    argv: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match="2"):
        main(argv)
    assert ": the name is blank (see simmer-tui " in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_check_prints_every_problem_on_a_line_of_stderr(
    folder: Path, edit: Edit, capsys: pytest.CaptureFixture[str]
) -> None:
    edit("maze.csv", "3,3,1", "3,7,1")
    assert run_check([str(folder), "--bot-rot", "x"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert [line.partition(": ")[0] for line in err.splitlines()] == ["maze.csv:1:B", "--bot-rot"]


def test_check_of_an_unknown_set_says_which_there_are(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_check(["defualt"]) == 2
    err = capsys.readouterr().err
    assert err.startswith("defualt: there is no such folder, and no set of that name; bundled sets: default")
    assert err.endswith('did you mean "default"?\n')
    assert err.count("\n") == 1


def test_check_on_a_terminal_without_unicode_prints_ascii(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    buffer = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(buffer, encoding="ascii"))
    assert run_check([str(folder), "--bot-rot", "90"]) == 0
    sys.stdout.flush()
    text = buffer.getvalue().decode("ascii")
    assert "# wall, o robot (^ heading), B block" in text


def test_set_is_the_local_folder_if_it_holds_any_of_the_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert find_set(None) == bundled_folder()
    (tmp_path / "config").mkdir()
    assert find_set(None) == bundled_folder()
    (tmp_path / "config" / "drive.csv").write_text("")
    assert find_set(None) == Path("config")


def test_set_is_found_by_path_before_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert find_set("default") == bundled_folder()
    (tmp_path / "default").mkdir()
    assert find_set("default") == Path("default")


def test_folders_inside_the_bundled_one_are_sets_by_name(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    init_set(folder / "other", bundled_folder())
    (folder / "no-set").mkdir()
    monkeypatch.setattr("simmer_tui.config.sets.bundled_folder", lambda: folder)
    assert bundled_sets() == {"default": folder, "other": folder / "other"}
    assert find_set("other") == folder / "other"
    assert load(find_set("other")).name == "other"


@pytest.mark.parametrize("name", ["a\0b", "x" * 5000, ""])
def test_names_that_cannot_be_folders_are_one_problem(name: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        find_set(name)
    assert len(caught.value.problems) == 1


def test_file_in_place_of_a_folder_is_one_problem(folder: Path) -> None:
    with pytest.raises(ConfigurationError, match="is not a folder"):
        find_set(str(folder / "maze.csv"))


def test_summary_draws_the_courses_maze_with_robot_and_block(folder: Path) -> None:
    text = summarize(load(folder, {"bot_rot": Override("--bot-rot", "-90")}))
    lines = text.splitlines()
    assert max(map(len, lines[1:])) <= 100  # the first has the folder, however long that is
    top = lines.index("+" + "-" * 64 + "+")
    drawing = lines[top + 1 : top + 17]
    assert lines[top + 17] == lines[top]
    # The upper right corner: cells 0, 2, 0, 2.
    assert drawing[0].endswith("████████s       ████████s       |")
    assert drawing[1] == "|     ooo                        ████████        ████████        |"
    assert drawing[2] == "|     o↓o        ■■              ████████        ████████        |"
    assert "8 x 4 cells, 96 x 48 in" in text
    assert "circle, diameter 6 in; centre (9.5, 42) in, heading -90 deg" in text


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize(
    ("heading", "arrow", "plain"),
    [(0, "→", ">"), (44, "↗", ">"), (90, "↑", "^"), (-179, "←", "<"), (-90, "↓", "v"), (719, "→", ">")],
)
def test_summary_marks_the_heading(folder: Path, heading: int, arrow: str, plain: str) -> None:
    configuration = load(folder, {"bot_rot": Override("--bot-rot", heading)})
    assert f"robot ({arrow} heading)" in summarize(configuration)
    assert f"robot ({plain} heading)" in summarize(configuration, ascii_only=True)


def test_summary_lists_sensors_drives_and_settings(folder: Path, edit: Edit) -> None:
    edit("sensors.csv", "Threshold", "Threshold,Gain,Detects,Max Range (in)")
    edit("sensors.csv", "ir1,i1,1,2,0,1,0,0.05,40,0.8", "ir1,i1,0,2,0,1,0,0.05,40,0.8,-1,white")
    edit("drive.csv", "up,w1,1,0.05,0.02,0.02,0,0,0", "up,w1,0,0.05,0.02,0.02,0,0,0.5")
    edit("robot.csv", ",0\n", ",1\n")
    overrides = {"seed": Override("--seed", "7"), "randbias": Override("--no-randbias", False)}
    rows = [" ".join(line.split()) for line in summarize(load(folder, overrides)).splitlines()]
    assert "u2 ultra2 2.12 2.12 6 45 0.02 5" in rows
    assert "i1 ir1 2 0 1 0 0.05 40 disabled, threshold 0.8, detects white, gain -1" in rows
    assert "t1 tof1 3 0 4 0 0.03 25 max 47" in rows
    assert "w1 up drive left (+Y) 0.02/0.05/0.02 0/0/0.5 6 in/s disabled" in rows
    assert "Random errors: repeat, seed 7. Random drive bias: not used." in rows
    assert any(row.startswith("Robot: polygon of 4 vertices, 6 x 6 in") for row in rows)


def test_summary_of_the_largest_maze_without_sensors_is_one_character_a_cell(
    folder: Path, edit: Edit
) -> None:
    (folder / "maze.csv").write_text("\n".join([",".join("1" * 100)] * 100))
    header = (folder / "sensors.csv").read_text().splitlines()[0]
    (folder / "sensors.csv").write_text(header + "\n")
    edit("settings.toml", "[9.5, 42.0]", "[1194, 6]")
    text = summarize(load(folder))
    assert f"\n|{' ' * 99}→|\n+" in text
    assert "Sensors\n  none\n" in text


@pytest.mark.parametrize("name", ["default", "mission", "lidar"])
def test_keys_of_the_json_of_a_set_are_names_and_blank_units_are_null(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_check([name, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    rows = [row for part in answer.values() for row in (part if isinstance(part, list) else [part])]
    assert [key for row in rows for key in row if not key.isidentifier()] == []
    assert answer["settings"]["wheels_top_speed_in_per_s"] == 12.0
    assert {row["unit"] for row in answer["sensors"]} <= {"in", "deg", None}
    for row in answer["sensors"]:
        kind = sensor_kinds()[row["kind"]]
        for name, key in (("scan_rate", "scan_rate_hz"), ("soft_iron", "soft_iron_deg"), ("wrap", "wrap")):
            assert (key in row) == kind.has(name), row["id"]


def test_a_folder_of_another_script_is_named_so_that_it_can_be_typed(tmp_path: Path) -> None:
    folder, log = tmp_path / "größe" / "ロボット", tmp_path / "run.jsonl"
    shutil.copytree(find_set("default"), folder)
    assert simmer("check", folder).stdout.splitlines()[0] == f"Configuration: {folder}"
    simmer(
        "--no-ui", "--port", "0", "--config", folder, "--log", log, "--run", f"{sys.executable} -S -c pass"
    )
    assert "größe/ロボット" in simmer("report", log, env={"COLUMNS": "300"}).stdout
