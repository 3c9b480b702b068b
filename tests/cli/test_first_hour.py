"""Help for the first hour: sets that explain themselves, schemas, completion, doctor, JSON."""

from __future__ import annotations

import json
import os
import re
import shutil
import socket
import subprocess
import tomllib
from pathlib import Path
from typing import Any, NoReturn

import jsonschema
import pytest
import shtab
from msgspec.structs import replace

from simmer_tui import platform_has
from simmer_tui.cli.check_command import run_check
from simmer_tui.cli.completion_command import SHELLS, run_completion, whole_parser
from simmer_tui.cli.doctor_command import run_doctor
from simmer_tui.cli.init_command import run_init
from simmer_tui.cli.main import SUBCOMMANDS, main
from simmer_tui.cli.ports_command import run_ports
from simmer_tui.cli.report_command import run_report
from simmer_tui.config import drive_csv, maze_csv, mission_toml, sensors_csv, settings_file
from simmer_tui.config.loader import load
from simmer_tui.config.new_set import mission_schema, schemas, settings_schema
from simmer_tui.config.sets import bundled_sets, find_set
from simmer_tui.config.settings import all_settings
from simmer_tui.config.settings_file import Override
from simmer_tui.live.server import Server
from simmer_tui.notebook import configuration_from_environment
from simmer_tui.runlog.saved_runs import BEFORE, make_room, saved_runs_folder
from simmer_tui.runlog.writer import auto_path
from simmer_tui.sim import Simulator
from simmer_tui.sim.command import counted
from simmer_tui.sim.sensors import KINDS

Capture = pytest.CaptureFixture[str]


# -- sets ------------------------------------------------------------------------------------------


@pytest.mark.quick_cases(3)
@pytest.mark.parametrize("mission", [False, True])
@pytest.mark.parametrize("name", list(bundled_sets()))
def test_every_bundled_set_can_be_copied_with_and_without_a_mission(
    name: str, mission: bool, tmp_path: Path
) -> None:
    made = tmp_path / "robot"
    assert run_init([str(made), "--from", name, *(["--mission"] if mission else [])]) == 0
    copy, source = load(made), load(find_set(name))
    if not mission:
        assert copy.simulation == source.simulation
        assert copy.settings == replace(source.settings, nominal=name)
        return
    assert copy.mission == load(find_set("mission")).mission
    gripper = copy.simulation.gripper
    assert gripper is not None
    codes = [each.code for each in (*copy.simulation.sensors, *copy.simulation.drives)] + [gripper.code]
    assert len(set(codes)) == len(codes)
    simulator = Simulator(copy.simulation)
    load_sensor = next(each for each in copy.simulation.sensors if each.kind.name == "load")
    assert simulator.execute(load_sensor.code).reply in (0.0, 1.0)
    assert copy.simulation.maze == source.simulation.maze
    assert set(source.simulation.drives) <= set(copy.simulation.drives)


def test_a_new_set_says_what_its_values_mean(tmp_path: Path) -> None:
    made = tmp_path / "robot"
    run_init([str(made), "--mission"])
    maze = (made / "maze.csv").read_text()
    assert maze.startswith("3,3,1,1")
    for value, kind in maze_csv.CELLS.items():
        assert f"# {value} {kind.name}: " in maze
    for name in ("sensors.csv", "drive.csv"):
        header, *lines = (made / name).read_text().splitlines()
        comments = [line for line in lines if line.startswith("#")]
        for column in header.split(","):
            assert any(line.startswith(f"# {column}: ") for line in comments), column
        assert not any(line.startswith("#") for line in lines[: -len(comments)])


def test_every_column_has_a_meaning() -> None:
    wanted = {*sensors_csv.HEADERS, *sensors_csv.optional_headers()}
    assert {name for name, meaning in sensors_csv.meanings().items() if meaning} == wanted
    assert all(column.help for column in drive_csv.COLUMNS)
    assert all(column.help for kind in KINDS.values() for column in kind.columns)


def test_comments_are_kept_by_spreadsheets_and_mean_nothing(folder: Path) -> None:
    before = load(folder).simulation
    for name in ("maze.csv", "robot.csv", "sensors.csv", "drive.csv"):
        text = (folder / name).read_text()
        (folder / name).write_text(f'"# a note, with a comma",,\n{text}# and another;\n')
    assert load(folder).simulation == before
    text = "\n".join(line.replace(",", ";") for line in (folder / "maze.csv").read_text().splitlines()[1:])
    (folder / "maze.csv").write_text("# one without that sign\n" + text)
    assert load(folder).simulation == before


def test_a_team_set_keeps_its_own_words(folder: Path, tmp_path: Path) -> None:
    (folder / "maze.csv").write_text((folder / "maze.csv").read_text() + "# ours\n")
    run_init([str(tmp_path / "copy"), "--from", str(folder)])
    assert (tmp_path / "copy" / "maze.csv").read_bytes() == (folder / "maze.csv").read_bytes()
    (folder / "maze.csv").write_bytes(b"1,1\xff")
    assert run_init([str(tmp_path / "other"), "--from", str(folder)]) == 2
    assert not (tmp_path / "other").exists()


# -- schemas ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(bundled_sets()))
def test_the_bundled_files_are_as_their_schemas_have_it(name: str) -> None:
    for file, schema in schemas().items():
        path = bundled_sets()[name] / file
        if path.exists():
            jsonschema.Draft7Validator(schema).validate(tomllib.loads(path.read_text("utf-8")))


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("bot_rott = 1", "bot_rott"),
        ('bot_rot = "north"', "north"),
        ("bot_center = [1]", "[1]"),
        ("[server]\nport = 70000", "70000"),
        ('[server]\nlisteners = ["binray"]', "binray"),
        ("num_segments = 1.5", "1.5"),
        ("[screen]\npace = 5000", "5000"),
    ],
)
def test_the_schema_refuses_what_the_loader_refuses(text: str, fault: str) -> None:
    errors = list(jsonschema.Draft7Validator(settings_schema()).iter_errors(tomllib.loads(text)))
    assert errors
    assert fault in errors[0].message


def test_schemas_know_every_setting_and_key() -> None:
    properties = settings_schema()["properties"]
    for item in all_settings():
        table, _, key = item.name.rpartition(".")
        known = properties[table]["properties"] if table else properties
        assert known[key]["description"], item.name
    mission = mission_schema()["properties"]
    assert [*mission] == [key.name for key in mission_toml.KEYS]
    check = jsonschema.Draft7Validator(mission_schema())
    assert check.is_valid({"start": "any", "block": [30, 40], "contacts": 3, "heading": 12.5})
    assert not check.is_valid({"start": "here"})
    assert not check.is_valid({"time_limit": 0})


def test_new_files_name_a_schema_that_is_there(tmp_path: Path) -> None:
    run_init([str(tmp_path / "robot"), "--mission"])
    for file in (settings_file.FILE, mission_toml.FILE):
        first = (tmp_path / "robot" / file).read_text().splitlines()[0]
        schema = tmp_path / "robot" / first.removeprefix("#:schema ")
        jsonschema.Draft7Validator.check_schema(json.loads(schema.read_text()))
    run_init([str(tmp_path / "again"), "--from", str(tmp_path / "robot")])
    assert (tmp_path / "again" / "settings.toml").read_text() == (
        tmp_path / "robot" / "settings.toml"
    ).read_text()


# -- completion ------------------------------------------------------------------------------------


def completion(shell: str, tmp_path: Path, capsys: Capture) -> Path:
    assert run_completion([shell]) == 0
    script = tmp_path / f"simmer-tui.{shell}"
    script.write_text(capsys.readouterr().out)
    return script


def test_every_command_and_option_is_in_every_script(tmp_path: Path, capsys: Capture) -> None:
    commands = next(
        each.choices for each in whole_parser()._actions if isinstance(each.choices, dict) and each.nargs
    )
    assert commands.keys() == SUBCOMMANDS.keys()
    for shell in SHELLS:
        text = completion(shell, tmp_path, capsys).read_text()
        for name in SUBCOMMANDS:
            assert name in text
        for option in ("no-ui", "random-mazes", "isolation", "drive-profile"):
            assert option in text


def test_files_are_offered_where_a_file_is_named() -> None:
    """For a number, the files of the folder would only be in the way."""
    commands = next(
        each.choices for each in whole_parser()._actions if isinstance(each.choices, dict) and each.nargs
    )
    offered = {
        name: {each.dest for each in commands[name]._actions if getattr(each, "complete", None) is shtab.FILE}
        for name in ("trials", "grade", "report")
    }
    assert offered == {
        "trials": {"run", "out"},
        "grade": {"course", "out"},
        "report": {"file", "svg", "csv", "html"},
    }


@pytest.mark.quick_cases(4)
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("tri", {"trials"}),
        ("--miss", {"--mission"}),
        ("--config ", {"default", "mission", "simmer-python"}),
        ("trials --drive-profile diff-", {"diff-dc", "diff-stepper"}),
    ],
)
@pytest.mark.parametrize("shell", ["bash", "fish"])
def test_the_shell_completes(
    shell: str, words: str, expected: set[str], tmp_path: Path, capsys: Capture
) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} here")
    script = completion(shell, tmp_path, capsys)
    line = f"simmer-tui {words}"
    if shell == "fish":
        command = ["fish", "--no-config", "-c", f"source {script}; complete -C '{line}'"]
    else:
        typed = " ".join(f"'{word}'" for word in line.split(" "))
        program = (
            f"source {script}; COMP_WORDS=({typed}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); "
            "_shtab_simmer_tui; printf '%s\\n' \"${COMPREPLY[@]}\""
        )
        command = ["bash", "--norc", "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=True)
    found = {each.split("\t")[0].strip() for each in done.stdout.splitlines()}
    assert expected <= found, done.stdout + done.stderr
    assert "grade" not in found


def test_zsh_reads_its_script(tmp_path: Path, capsys: Capture) -> None:
    if shutil.which("zsh") is None:
        pytest.skip("no zsh here")
    script = completion("zsh", tmp_path, capsys)
    subprocess.run(["zsh", "-f", "-n", str(script)], check=True)
    assert script.read_text().startswith("#compdef simmer-tui\n")


# -- doctor ----------------------------------------------------------------------------------------


def test_doctor_says_it_in_eleven_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("simmer_tui.grade.bubblewrap.what_is_missing", lambda: "no bubblewrap")
    ports = {}
    with socket.create_server(("127.0.0.1", 0)) as free, socket.create_server(("127.0.0.1", 0)) as other:
        ports = {"port": free.getsockname()[1], "reply_port": other.getsockname()[1]}
    run_init(["config"])
    settings = tmp_path / "config" / "settings.toml"
    text = settings.read_text()
    for name, number in ports.items():
        default = {"port": 9000, "reply_port": 9001}[name]
        text = text.replace(f"\n{name} = {default}\n", f"\n{name} = {number}\n")
    settings.write_text(text.replace("belief_port = 9002", "belief_port = 0"))
    capsys.readouterr()
    assert run_doctor([]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 11
    assert [line[:2] for line in lines] == ["ok"] * 8 + ["!!", "ok", "ok"]
    with socket.create_server(("127.0.0.1", ports["port"])):
        assert run_doctor([]) == 1
        assert f"!!  ports     {ports['port']} of" in capsys.readouterr().out
    settings.write_text("bot_rott = 1")
    assert run_doctor([]) == 1
    assert "!!  set       1 mistake in ./config: simmer-tui check lists them" in capsys.readouterr().out


def test_doctor_says_whether_a_taken_port_keeps_the_simulator_from_starting(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    run_init(["config"])
    settings = tmp_path / "config" / "settings.toml"
    text = settings.read_text().replace('listeners = ["binary"]', 'listeners = ["packets"]')
    with socket.create_server(("127.0.0.1", 0)) as other:
        number = other.getsockname()[1]
        for name, code in (("belief_port", 0), ("packet_reply_port", 1)):
            free = text.replace("packet_port = 61200", "packet_port = 0")
            settings.write_text(re.sub(rf"^{name} = \d+$", f"{name} = {number}", free, flags=re.M))
            capsys.readouterr()
            assert run_doctor([]) == code, name
            (line,) = [line for line in capsys.readouterr().out.splitlines() if " ports " in line]
            assert line.startswith(f"!!  ports     {number} of"), "a feature is missing in any case"
            assert line.endswith(f"or --{name.replace('_', '-')} 0 with --run"), "the option of that port"


def test_doctor_names_as_many_saved_runs_as_there_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert saved_runs_folder().is_relative_to(tmp_path)
    for number in range(BEFORE + 5):
        make_room(saved_runs_folder())
        (saved_runs_folder() / f"{number}.jsonl").write_text("a run")
        if number in (0, 2, BEFORE + 4):
            run_doctor([])
            count = counted(len(list(saved_runs_folder().glob("*"))), "run")
            assert (
                f"{count} saved in {saved_runs_folder()}, of at most {BEFORE + 1}" in capsys.readouterr().out
            )


@pytest.mark.parametrize(("columns", "told"), [("300", "!!"), ("90", "ok"), ("", "ok")])
def test_doctor_says_that_the_size_in_the_environment_is_wrong(
    columns: str, told: str, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    for stream in ("stdin", "stdout", "stderr"):
        monkeypatch.setattr(f"sys.{stream}.isatty", lambda: True)
    monkeypatch.setattr("simmer_tui.cli.doctor_command.window_of", lambda _: (90, 30))
    monkeypatch.setenv("COLUMNS", columns)
    monkeypatch.delenv("LINES", raising=False)
    run_doctor([])
    (line,) = [line for line in capsys.readouterr().out.splitlines() if " terminal " in line]
    assert line.startswith(f"{told}  terminal  90 x 30, TERM=")
    assert ("COLUMNS=300 in the environment is wrong, and not used here: unset" in line) == (told == "!!")


@pytest.mark.parametrize("home", [None, "", "relative"])
def test_a_user_without_a_home_directory_has_a_place_for_runs(
    home: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    def unknown(_: int) -> NoReturn:
        raise KeyError("no entry")

    for name in ("HOME", "XDG_DATA_HOME", "USERPROFILE", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    if home is not None:
        monkeypatch.setenv("HOME", home)
    monkeypatch.setattr("pwd.getpwuid", unknown)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    place = tmp_path / f"simmer-tui-{os.geteuid()}"
    # Anyone may make that name a link to a folder of somebody else.
    place.symlink_to(tmp_path)
    place = place.with_name(f"{place.name}-2")
    assert auto_path().parent == place / "logs"
    run_doctor([])
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line[4:].startswith("runs ")]
    assert line.startswith("!!  runs      user ")
    assert f"has no home directory: runs are saved in {place}; HOME=FOLDER sets another" in line
    if home is None:
        assert platform_has.expanded("~/run.jsonl") == Path("~/run.jsonl")
    assert platform_has.expanded("~nobody-at-all/x") == Path("~nobody-at-all/x")


def test_doctor_says_which_extras_of_the_package_are_missing(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text("utf-8"))["project"]
    extras = set(project["optional-dependencies"]) - {"dev", "docs", "release", "test"}
    extras -= {"sketch"}  # a compiler of the system does as well: the line before says which
    for there in (True, False):
        monkeypatch.setattr(
            "simmer_tui.cli.doctor_command.find_spec", lambda name, there=there: there or None
        )
        run_doctor([])
        (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("ok  extras")]
        names = re.search(r"simmer-tui\[(.*?)\] @ git" if not there else r"extras  +(.*?); ", line)
        assert names is not None, line
        assert set(names[1].replace(" ", "").split(",")) == extras


def test_a_program_is_told_the_set(folder: Path) -> None:
    ports = {f"server.{name}": Override(name, 0) for name in ("port", "reply_port", "belief_port")}
    server = Server(load(folder, ports))
    try:
        told_set = server.environment["SIMMER_CONFIG"]
    finally:
        server.stop()
    assert Path(told_set) == folder.resolve()
    assert configuration_from_environment({"SIMMER_CONFIG": told_set}).simulation == load(folder).simulation


# -- JSON ------------------------------------------------------------------------------------------


def printed(capsys: Capture) -> Any:
    return json.loads(capsys.readouterr().out)


def test_check_as_json_is_the_set_or_its_mistakes(folder: Path, tmp_path: Path, capsys: Capture) -> None:
    assert run_check(["mission", "--json"]) == 0
    found = printed(capsys)
    assert found["check"]["ok"] is True
    assert found["maze"]["cells"][0] == [3, 3, 1, 1, 0, 2, 0, 2]
    assert {each["code"]: each["rotation_deg"] for each in found["sensors"] if each["kind"] == "ultra"}[
        "u2"
    ] == 45
    assert found["sensors"][0]["max_range_in"] is None
    assert (found["robot"]["radius_in"], found["gripper"]["code"]) == (3, "p1")
    assert found["drives"][0]["speed_per_s"] == 6
    # As in drive.csv, in profiles and in `trials --vary`.
    assert {"x_axis_error", "y_axis_error", "rotation_error", "rotation_bias"} <= found["drives"][0].keys()
    assert found["drives"][0]["unit"] == "in"
    assert found["settings"]["server_port"] == 9000
    assert found["settings"]["bot_center_x_in"] == found["robot"]["start_x_in"] == 9.5
    assert found["mission"]["time_limit_s"] == 300
    assert found["mission"]["heading_drawn"] == "quarter"
    (folder / "maze.csv").write_text("7")
    assert run_check([str(folder), "--json"]) == 2
    found = printed(capsys)
    assert found["check"]["ok"] is False
    assert found["problems"][0]["where"] == "maze.csv:1:A"


def test_ports_as_json_is_a_table(capsys: Capture) -> None:
    code = run_ports(["--json"])
    assert (code == 0) == bool(printed(capsys)["ports"])


def test_report_as_json_has_the_figures(tmp_path: Path, capsys: Capture) -> None:
    from simmer_tui.runlog.writer import RunLog

    simulator = Simulator(load(find_set(None)).simulation, 7)
    with RunLog(tmp_path / "run.jsonl", load(find_set(None)), simulator) as log:
        log(simulator.execute("u1"))
    assert run_report([str(tmp_path / "run.jsonl"), "--json"]) == 0
    found = printed(capsys)
    run = found["run"]
    assert (run["commands"], run["contacts"], run["seed"], run["distance_in"]) == (1, 0, 7, 0.0)
    assert run["end_x_in"] == simulator.pose.x
    assert [each["kind"] for each in found["moments"]] == ["began", "end"]
    [row] = found["commands"]
    assert row == {"code": "u1", "meaning": "ultra1", "sent": 1, "contacts": 0, "refused": 0}


def test_a_misspelt_command_is_told_of_with_the_one_that_was_meant(capsys: Capture) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["chekc", "config"])
    assert 'unknown command "chekc"; did you mean "check"?' in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        main(["good.py"])
    assert "there is no file good.py" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        main(["help", "nosuch"])
    assert capsys.readouterr().err.endswith("(see simmer-tui --help)\n")


@pytest.mark.parametrize("command", [[], ["trials"]])
@pytest.mark.parametrize("program", ["python my_robot.py", "python -u my_robot.py --fast"])
def test_a_program_without_quotes_is_told_of_with_them(
    capsys: Capture, command: list[str], program: str
) -> None:
    with pytest.raises(SystemExit, match="2"):
        main([*command, "--run", *program.split(), "--seed", "3"])
    assert f"""the command after --run needs quotes: --run "{program}" (see""" in capsys.readouterr().err


@pytest.mark.posix
def test_the_quotes_of_a_program_keep_its_words_and_letters(capsys: Capture) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["--run", "python", "my robot.py", "Übung.py"])
    assert """--run "python 'my robot.py' 'Übung.py'" (see""" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words", [["check", "config", "--run"], ["--", "--run"], ["check", "config", "--run", "x"]]
)
def test_a_run_option_where_there_is_none_is_unknown(capsys: Capture, words: list[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(words)
    assert "unknown" in capsys.readouterr().err
