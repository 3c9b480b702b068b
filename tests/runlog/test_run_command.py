"""The command of a run's program in its log: sealed by its user, and without secrets."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from msgspec.structs import replace

from simmer_tui.config import load_default
from simmer_tui.config.settings import with_any_ports
from simmer_tui.live.server import Server
from simmer_tui.runlog.header import parse_header
from simmer_tui.runlog.run_command import RunCommand, run_command


@pytest.fixture(autouse=True)
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "data"
    monkeypatch.setattr("platformdirs.user_data_path", lambda *_, **__: folder)
    return folder


def test_a_user_knows_the_own_commands_and_no_others(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = run_command("python robot.py")
    assert own.is_sealed_here
    assert (own.line, own.folder) == ("python robot.py", str(Path.cwd()))
    assert run_command("python robot.py") == own, "a user has one key"
    assert not replace(own, line="python other.py").is_sealed_here
    assert not replace(own, folder=str(tmp_path)).is_sealed_here
    assert not replace(own, seal="").is_sealed_here
    assert not replace(own, seal="ü").is_sealed_here
    assert not RunCommand(own.folder, seal=own.seal).is_sealed_here
    [key] = data.iterdir()
    assert key.read_bytes().hex() not in str(own)
    monkeypatch.setattr("platformdirs.user_data_path", lambda *_, **__: tmp_path / "other")
    assert not own.is_sealed_here, "another user has another key"
    assert not (tmp_path / "other").exists(), "who only looks at a log makes none"


def test_a_key_that_others_can_read_seals_nothing(data: Path) -> None:
    own = run_command("python robot.py")
    [key] = data.iterdir()
    os.chmod(key, 0o644)  # noqa: PTH101 - a call of POSIX, for the systems that have it
    assert not own.is_sealed_here
    assert run_command("python robot.py").is_sealed_here, "a new one replaces it"


def test_without_a_data_folder_a_command_has_no_seal(data: Path) -> None:
    data.write_text("a file in its place")
    command = run_command("python robot.py")
    assert (command.line, command.seal) == ("python robot.py", "")


@pytest.mark.parametrize(
    "line",
    [
        "python robot.py --token abc",
        "python robot.py --Access_Token=abc",
        "robot -password abc",
        "env API_KEY=abc python robot.py",
        'robot "--secret=abc"',
        "robot http://me:abc@host/",
        "robot swordfish",
    ],
)
def test_a_command_with_a_secret_is_not_kept(line: str) -> None:
    command = run_command(line, token="swordfish")
    assert command == RunCommand(str(Path.cwd()))


@pytest.mark.parametrize(
    "line", ["python token_test.py", "python -m tokenize", "robot --speed=3 http://host:80/"]
)
def test_other_commands_are_kept(line: str) -> None:
    assert run_command(line, token="swordfish").line == line


@pytest.mark.parametrize("command", ["", "python robot.py --simulator swordfish", "python robot.py"])
def test_a_log_keeps_the_command_of_its_run_and_no_token(tmp_path: Path, command: str) -> None:
    configuration = load_default().with_settings({"server.token": "swordfish"})
    server = Server(replace(configuration, settings=with_any_ports(configuration.settings)))
    server.program_command = command
    server.start_log(str(tmp_path / "run.jsonl"))
    server.start()
    server.stop()
    text = (tmp_path / "run.jsonl").read_text()
    assert "swordfish" not in text
    header = parse_header(text.splitlines()[0].encode(), "the log")
    assert (header.run is not None) == bool(command)
    assert header.can_run_again == (command == "python robot.py")
