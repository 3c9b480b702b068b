"""Device files of a run, found again for a rerun, or not; and kinds of sensor as a log describes them."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from simmer_tui.config.device_file import DeviceFile
from simmer_tui.config.loader import load
from simmer_tui.errors import RunLogError
from simmer_tui.runlog.header import Header, header_of, rebuild, rebuild_to_run
from simmer_tui.runlog.logged_devices import LoggedDevice, recorded_kinds, runnable_kinds, same_files
from simmer_tui.sim import Simulator
from simmer_tui.sim.sensors import KINDS
from simmer_tui.sim.sensors.recorded_kinds import recorded_kind
from tests.devices.conftest import DEVICE, THERMAL, MakeSet, trust


@pytest.fixture
def file(make_set: MakeSet, tmp_path: Path) -> DeviceFile:
    """A device file that is in the set and not trusted."""
    make_set(trusted=False)
    return DeviceFile(DEVICE, THERMAL.encode())


def raised(call: Any, *arguments: Any) -> str:
    with pytest.raises(RunLogError) as error:
        call(*arguments)
    return str(error.value)


def test_a_file_of_a_run_is_found_by_its_hash(file: DeviceFile, tmp_path: Path) -> None:
    folder = tmp_path / "set"
    logged = LoggedDevice(DEVICE, file.sha256)
    assert [each.sha256 for each in same_files([logged], folder)] == [file.sha256]
    needed = f"this needs {DEVICE} of the run, SHA-256 "
    other = LoggedDevice(DEVICE, "0123456789abcdef")
    shown = str(folder)
    remedy = "name the folder of its set with --config DIR"
    said = raised(same_files, [logged, other], folder)
    assert said == f"{needed}0123456789ab; in {shown} it is another, {file.sha256[:12]}; {remedy}"
    said = raised(same_files, [LoggedDevice("devices/none.py", "\x1b" * 20)], folder, "look elsewhere")
    assert said.startswith("this needs devices/none.py of the run, SHA-256 \\x1b")
    assert "none.py" in said.split("; ")[1]
    assert said.endswith("; look elsewhere")
    said = raised(same_files, [LoggedDevice("x" * 140, "")], folder)
    assert said == f"the header names '{'x' * 117}...', which is no device file"


def test_only_trusted_files_are_run(file: DeviceFile, tmp_path: Path) -> None:
    folder = tmp_path / "set"
    said = raised(runnable_kinds, [file], folder)
    assert said.startswith(f"{DEVICE} in ")
    assert (
        f" is code that you have not trusted yet (SHA-256 {file.sha256[:12]}): read it, then add --" in said
    )
    trust(folder)
    kinds = runnable_kinds([file], folder)
    assert set(kinds) == {*KINDS, "temp"}
    assert {**runnable_kinds([], folder)} == {**KINDS}


def test_kinds_are_described_and_read_back(file: DeviceFile, tmp_path: Path) -> None:
    trust(tmp_path / "set")
    kind = runnable_kinds([file], tmp_path / "set")["temp"]
    read = recorded_kinds([recorded_kind(kind)])
    assert (read["temp"].meaning, read["temp"].unit) == ("temperature", "C")
    assert set(read) == {*KINDS, "temp"}
    said = raised(recorded_kinds, [replace(recorded_kind(kind), name="ultra")])
    assert said == "the header describes 'ultra', which is a built-in kind"
    said = raised(recorded_kinds, [replace(recorded_kind(kind), name="a b" * 99)])
    assert said.startswith("the header describes no kind of sensor: ")
    assert len(said) <= len("the header describes no kind of sensor: ") + 120


def test_a_run_is_rebuilt_with_its_files_and_no_other(make_set: MakeSet) -> None:
    folder = make_set()
    configuration = load(folder)
    header: Header = header_of(configuration, Simulator(configuration.simulation, 1), datetime.now())
    assert [kind.name for kind in header.kinds] == ["temp"]
    assert [device.path for device in header.devices] == [DEVICE]
    (status,) = rebuild(header).device_statuses
    assert (status.path, status.trusted, status.ran, status.kinds) == (DEVICE, False, False, ("temp",))
    found = rebuild_to_run(header, folder)
    assert [each.path for each in found.devices] == [DEVICE]
    assert found.simulation == configuration.simulation
    said = raised(rebuild_to_run, replace(header, devices=()), folder)
    assert said == (
        "the run had sensors of the kind 'temp', which is in none of its device files: they were given in "
        "Python, and can be run again from there only"
    )
    (kind,) = header.kinds
    for length, shown in ((40, "x" * 40), (41, "x" * 37 + "...")):
        odd = replace(header, kinds=(replace(kind, name="x" * length),))
        assert f"sensors of the kind '{shown}', which" in raised(rebuild_to_run, odd, folder)
    other = replace(header, devices=(LoggedDevice(DEVICE, "0"),))
    assert "another" in raised(rebuild_to_run, other, folder)
