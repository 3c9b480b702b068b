"""Trust in device files: which content runs, who is asked, and which files are refused by their looks."""

from __future__ import annotations

import os
import pickle
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from simmer_tui.cli.main import main
from simmer_tui.config.device_file import LARGEST_DEVICE_FILE, DeviceFile
from simmer_tui.config.device_trust import (
    TRUST,
    VARIABLE,
    DeviceTrust,
    DeviceUse,
    trust_file,
    trusted_hashes,
)
from simmer_tui.config.loader import load
from simmer_tui.errors import ConfigurationError
from simmer_tui.notebook import load as load_in_notebook
from simmer_tui.sim import Simulator
from tests.devices.conftest import DEVICE, THERMAL, MakeSet, trust


def problems(folder: Path, use: DeviceUse = DeviceUse.RUN) -> list[str]:
    """The mistakes of a set that is refused."""
    with pytest.raises(ConfigurationError) as raised:
        load(folder, devices=use)
    return [str(each) for each in raised.value.problems]


@pytest.fixture
def asked() -> Iterator[list[str]]:
    """The paths that a user was asked about, who says yes to all."""
    names: list[str] = []

    def ask(file: DeviceFile, directory: Path) -> bool:
        names.append(file.path)
        return True

    token = TRUST.set(DeviceTrust(ask=ask))
    yield names
    TRUST.reset(token)


def test_a_trusted_device_reads_and_repeats(make_set: MakeSet) -> None:
    configuration = load(make_set())
    assert Simulator(configuration.simulation, 7).execute("h1").reply == 17 + 0.95
    assert [each.path for each in configuration.devices] == [DEVICE]
    assert configuration.simulation.sensors[-1].id == "temp1"


def test_without_trust_nothing_of_it_runs(make_set: MakeSet, tmp_path: Path) -> None:
    ran = tmp_path / "ran"
    folder = make_set(f"open({str(ran)!r}, 'w').close()\n{THERMAL}", trusted=False)
    (problem,) = problems(folder)
    line = len((folder / "settings.toml").read_text().splitlines())
    assert problem.startswith(f"settings.toml:{line}:sensors.devices: {DEVICE} (SHA-256 ")
    assert "--trust-devices" in problem
    for use in (DeviceUse.CHECK, DeviceUse.PARSE):
        (status,) = load(folder, devices=use).device_statuses
        assert (status.kinds, status.trusted, status.ran) == (("temp",), False, False)
    assert not ran.exists()
    trust(folder)
    load(folder)
    assert ran.exists()


def test_a_yes_is_kept_for_this_content_only(make_set: MakeSet, asked: list[str]) -> None:
    folder = make_set(trusted=False)
    load(folder)
    load(folder)
    assert asked == [DEVICE]
    (folder / DEVICE).write_text(THERMAL.replace("20.0", "30.0"))
    load(folder)
    assert asked == [DEVICE, DEVICE]
    assert len(trusted_hashes()) == 2
    if sys.platform != "win32":
        assert trust_file().stat().st_mode & 0o077 == 0


def test_a_file_that_is_swapped_after_trust_does_not_run(make_set: MakeSet) -> None:
    folder = make_set()
    load(folder)
    (folder / DEVICE).write_text(THERMAL + "\nraise SystemExit('swapped')\n")
    assert "not trusted" in problems(folder)[0]
    assert not load(folder, devices=DeviceUse.CHECK).device_statuses[0].ran


def test_the_bytes_that_were_hashed_are_those_that_run(make_set: MakeSet) -> None:
    folder = make_set(trusted=False)

    def swap(file: DeviceFile, directory: Path) -> bool:
        # The file changes while its user reads the question.
        (directory / file.path).write_text("raise SystemExit('swapped')\n")
        return True

    token = TRUST.set(DeviceTrust(ask=swap))
    try:
        configuration = load(folder)
    finally:
        TRUST.reset(token)
    assert configuration.devices[0].text == THERMAL
    assert Simulator(configuration.simulation, 7).execute("h1").reply == 17.95


def test_trust_may_be_given_for_one_command_and_by_the_run_to_its_program(
    make_set: MakeSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = make_set(trusted=False)
    devices = load_in_notebook(folder, trust_devices=True).devices
    assert not trusted_hashes()
    with pytest.raises(ConfigurationError):
        load_in_notebook(folder)
    monkeypatch.setenv(VARIABLE, devices[0].sha256)
    assert load_in_notebook(folder).devices == devices


def test_a_damaged_file_of_hashes_trusts_nothing(make_set: MakeSet, data_home: Path) -> None:
    folder = make_set()
    trust_file().write_bytes(b"\xff\0" + trust_file().read_bytes())
    assert "not trusted" in problems(folder)[0]
    trust_file().unlink()
    trust_file().mkdir()
    assert "not trusted" in problems(folder)[0]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("/etc/thermal.py", "is an absolute path"),
        ("C:/thermal.py", "is an absolute path"),
        ("devices/../../thermal.py", "leads out of the set"),
        ("devices\\\\..\\\\thermal.py", "leads out of the set"),
        ("devices/thermal.txt", "is no .py file"),
        ("thermal.py", "is not devices/NAME.py"),
        ("devices/a/b.py", "is not devices/NAME.py"),
        ("devices/a b.py", "is not devices/NAME.py"),
        ("devices/none.py", "is not in the set"),
    ],
)
def test_paths_that_are_refused(make_set: MakeSet, name: str, said: str) -> None:
    folder = make_set()
    settings = folder / "settings.toml"
    settings.write_text(settings.read_text().replace(DEVICE, name))
    line = len(settings.read_text().splitlines())
    for use in (DeviceUse.RUN, DeviceUse.CHECK):
        (problem,) = problems(folder, use)
        assert problem.startswith(f"settings.toml:{line}:sensors.devices: ")
        assert said in problem


def test_links_may_stay_in_the_set_and_not_lead_out(make_set: MakeSet, tmp_path: Path) -> None:
    folder = make_set()
    inside = folder / "devices" / "other.py"
    (folder / DEVICE).rename(inside)
    (folder / DEVICE).symlink_to("other.py")
    assert load(folder).devices[0].path == DEVICE
    (tmp_path / "outside.py").write_text(THERMAL)
    (folder / DEVICE).unlink()
    (folder / DEVICE).symlink_to(tmp_path / "outside.py")
    assert "is a link that leads out of the set" in problems(folder)[0]
    (folder / DEVICE).unlink()
    (folder / DEVICE).symlink_to("thermal.py")
    assert DEVICE in problems(folder)[0]


def test_folders_and_pipes_are_no_files(make_set: MakeSet) -> None:
    folder = make_set()
    (folder / DEVICE).unlink()
    (folder / DEVICE).mkdir()
    assert DEVICE in problems(folder)[0]
    (folder / DEVICE).rmdir()
    if hasattr(os, "mkfifo"):
        os.mkfifo(folder / DEVICE)
        assert "is no file" in problems(folder)[0]


def test_contents_that_are_refused(make_set: MakeSet) -> None:
    folder = make_set()
    file = folder / DEVICE
    file.write_bytes(b"#" * (LARGEST_DEVICE_FILE + 1))
    assert problems(folder) == [f'{_place(folder)}: "{DEVICE}" has more than {LARGEST_DEVICE_FILE:,} bytes']
    file.write_bytes(THERMAL.encode() + b"# \xe9\n")
    line = THERMAL.count("\n") + 1
    what = f"holds in line {line} the byte 0xe9, which is not UTF-8"
    assert problems(folder) == [f'{_place(folder)}: "{DEVICE}" {what}']
    # A cookie does not make another encoding of the bytes that were read as UTF-8.
    file.write_text("# -*- coding: latin-1 -*-\nGRAD = 'é'\n" + THERMAL)
    trust(folder)
    load(folder)


@pytest.mark.parametrize("use", [DeviceUse.RUN, DeviceUse.CHECK, DeviceUse.PARSE])
def test_text_that_is_no_python_is_said_with_its_line(make_set: MakeSet, use: DeviceUse) -> None:
    folder = make_set("import math\nclass Thermal(:\n", trusted=False)
    assert problems(folder, use) == [f"{DEVICE}:2: is not Python: invalid syntax"]
    (folder / DEVICE).write_text("a = " + "(" * 5000 + ")" * 5000)
    assert problems(folder, use)[0].startswith(DEVICE)
    (folder / DEVICE).write_text("a = 0\0")
    assert problems(folder, use)[0].startswith(DEVICE)


def test_the_files_of_a_set_are_counted(make_set: MakeSet) -> None:
    folder = make_set()
    names = ", ".join(f'"devices/d{number}.py"' for number in range(21))
    settings = folder / "settings.toml"
    settings.write_text(settings.read_text().replace(f'"{DEVICE}"', names))
    assert "names 21 files; a set may have 20" in problems(folder)[0]


def test_a_configuration_goes_to_another_process_with_its_devices(make_set: MakeSet) -> None:
    configuration = load(make_set())
    packed = pickle.dumps(configuration)
    module = sys.modules.pop(configuration.devices[0].module)
    try:
        again = pickle.loads(packed)
    finally:
        sys.modules[configuration.devices[0].module] = module
    assert again.devices == configuration.devices
    assert Simulator(again.simulation, 7).execute("h1").reply == 17.95
    parsed = load(configuration.directory, devices=DeviceUse.PARSE)
    assert parsed.devices == ()


def _place(folder: Path) -> str:
    line = len((folder / "settings.toml").read_text().splitlines())
    return f"settings.toml:{line}:sensors.devices"


@pytest.mark.skipif(os.name == "nt", reason="POSIX permissions")
@pytest.mark.parametrize("mode", [0o602, 0o620])
def test_hashes_that_others_can_write_trust_nothing(make_set: MakeSet, mode: int) -> None:
    folder = make_set()
    trust_file().chmod(mode)
    assert "not trusted" in problems(folder)[0]
    trust(folder)
    assert trust_file().stat().st_mode & 0o777 == 0o600
    assert len(trusted_hashes()) == 1
    load(folder)


@pytest.mark.skipif(os.name == "nt", reason="named pipes")
def test_a_pipe_in_place_of_the_hashes_holds_nothing_up(make_set: MakeSet) -> None:
    folder = make_set(trusted=False)
    trust_file().parent.mkdir(parents=True, exist_ok=True)
    os.mkfifo(trust_file())
    assert "not trusted" in problems(folder)[0]
    trust(folder)
    load(folder)


def test_a_yes_behind_a_line_that_was_cut_off_is_kept(make_set: MakeSet) -> None:
    folder = make_set()
    trust_file().write_bytes(trust_file().read_bytes().strip() + b"\n" + b"0" * 30)
    trust(folder)
    load(folder)


@pytest.mark.parametrize(
    "lines",
    [
        'meaning = "\\x1b[2J\\u202egnp"\n    unit = "\\n"',
        'meaning = "\\ud800"',
        f'meaning = "{"x" * 9000}"',
    ],
)
def test_what_is_only_parsed_cannot_steer_a_terminal(
    make_set: MakeSet, capsys: pytest.CaptureFixture[str], lines: str
) -> None:
    folder = make_set(f'class T(O):\n    name = "temp"\n    {lines}\n', trusted=False)
    assert main(["check", str(folder)]) == 0
    out = capsys.readouterr().out
    assert "a device of the team's own" in out
    assert all(line.isprintable() and len(line) < 400 for line in out.splitlines())
