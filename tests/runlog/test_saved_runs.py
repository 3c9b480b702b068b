"""The runs that are saved without being asked for: which, how much of them, and never in the way."""

from __future__ import annotations

import errno
import os
import stat
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.cli.report_command import run_report
from simmer_tui.cli.rerun_command import run_rerun
from simmer_tui.config import load_default
from simmer_tui.config.loader import Override, load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.errors import RunLogError
from simmer_tui.live.server import Server
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Action, ActionName, Notice, NoticeKind
from simmer_tui.runlog import saved_runs
from simmer_tui.runlog.reader import LogReader
from simmer_tui.runlog.saved_runs import BEFORE, SavedRun, last_run, make_room, saved_runs_folder
from simmer_tui.sim import Simulator, parse_command
from tests.runlog.conftest import log_of


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's data folder."""
    monkeypatch.setattr("platformdirs.user_data_path", lambda *_, **__: tmp_path / "data")
    return tmp_path / "data" / "runs"


class Saved:
    def __init__(self) -> None:
        configuration = load_default()
        self.simulator = Simulator(configuration.simulation, 3)
        self.engine = Engine(self.simulator)
        self.stopped: list[str] = []
        self.run = SavedRun(log_of(configuration, self.simulator, self.stopped.append))
        self.engine.watch(self.run.apply)
        self._session = self.engine.session()

    def give(self, *commands: str) -> None:
        for command in commands:
            self._session.submit(parse_command(command), lambda outcome: None)


def test_a_run_is_kept_and_can_be_read_at_any_time(data: Path) -> None:
    saved = Saved()
    saved.give("d1-3", "u1")
    saved.run.flush()
    with LogReader(saved.run.path) as log:
        assert len(list(log)) == 4
    saved.give("u1")
    saved.run.close()
    saved.run.close()
    with LogReader(last_run()) as log:
        assert len(list(log)) == 5
    assert saved.run.path.parent == saved_runs_folder() == data
    assert saved.stopped == []


@pytest.mark.skipif(sys.platform == "win32", reason="permissions are those of POSIX")
def test_nobody_else_may_read_it(data: Path) -> None:
    saved = Saved()
    saved.give("u1")
    saved.run.close()
    assert stat.S_IMODE(saved.run.path.stat().st_mode) == 0o600
    assert stat.S_IMODE(data.stat().st_mode) == 0o700


@pytest.mark.skipif(sys.platform == "win32", reason="links are those of POSIX")
def test_a_link_put_in_place_of_its_file_is_not_followed(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = tmp_path / "notes.txt"
    other.write_text("mine")
    make = saved_runs.new_file

    def replaced(folder: Path, mode: int) -> Path:
        path = make(folder, mode=mode)
        path.unlink()
        path.symlink_to(other)
        return path

    monkeypatch.setattr(saved_runs, "new_file", replaced)
    with pytest.raises(RunLogError, match="cannot log to"):
        Saved()
    assert other.read_text() == "mine"


def test_a_run_in_which_nothing_was_done_is_not_kept(data: Path) -> None:
    saved = Saved()
    saved.engine.tell(Notice(NoticeKind.CONNECTED, "client a connected", "a"))
    saved.run.close()
    assert list(data.iterdir()) == []
    saved = Saved()
    saved.engine.perform(Action(ActionName.RESET))
    saved.run.close()
    assert len(list(data.iterdir())) == 1


def old_runs(folder: Path, count: int, size: int = 10) -> list[Path]:
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for number in range(count):
        path = folder / f"old{count - number:03}.jsonl"
        with path.open("wb") as file:
            file.truncate(size)
        os.utime(path, (1000 + number, 1000 + number))
        paths.append(path)
    return paths


def test_the_last_ten_are_kept_beside_the_present_one(data: Path) -> None:
    paths = old_runs(data, BEFORE + 5)
    (data / "notes.txt").write_text("mine")
    saved = Saved()
    saved.give("u1")
    saved.run.close()
    assert sorted(data.glob("*.jsonl")) == sorted([*paths[5:], saved.run.path])
    assert (data / "notes.txt").exists()
    assert last_run() == saved.run.path


def test_all_runs_together_are_bounded(data: Path) -> None:
    paths = old_runs(data, 8, size=saved_runs.ALL_TOGETHER // 6)
    make_room(data)
    left = sorted(data.iterdir())
    assert left == sorted(paths[-4:]), "with room for one more of the largest"


def test_a_run_is_bounded_and_says_so(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(saved_runs, "LARGEST_RUN", 30_000)
    saved = Saved()
    saved.give(*["u1"] * 1000)
    saved.run.close()
    assert saved.run.path.stat().st_size <= 30_000
    assert len(saved.stopped) == 1
    assert "the most that is saved of a run" in saved.stopped[0]


@pytest.mark.parametrize("written", [0, 7])
def test_a_full_disk_gives_a_notice_and_no_more(
    data: Path, monkeypatch: pytest.MonkeyPatch, written: int
) -> None:
    saved = Saved()
    saved.give("u1")
    saved.run.flush()
    size = saved.run.path.stat().st_size

    def full(descriptor: int, data: Any) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(saved_runs.os, "write", full)
    saved.give(*["u1"] * (written + 1))
    saved.run.flush()
    saved.give("u1", "u1")
    assert len(saved.stopped) == 1
    assert "No space left" in saved.stopped[0]
    assert saved.simulator.commands == written + 4
    saved.run.close()
    assert saved.run.path.stat().st_size == size


def test_a_disk_that_is_too_slow_holds_up_nobody(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(saved_runs, "UNWRITTEN", 20_000)
    monkeypatch.setattr(saved_runs, "GATHER", 60.0)
    saved = Saved()
    saved.give(*["u1"] * 1000)
    assert len(saved.stopped) == 1
    assert "too slow" in saved.stopped[0]
    saved.run.close()
    with LogReader(saved.run.path) as log:
        assert len(list(log)) > 50, "what was given before is there"


def test_where_nothing_can_be_kept_the_run_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "data").write_text("a file where a folder should be")
    monkeypatch.setattr("platformdirs.user_data_path", lambda *_, **__: tmp_path / "data")
    server = Server(load(bundled_folder(), {"server.port": Override("--port", 0)}))
    server.save_run()
    server.start()
    server.stop()
    assert server.saved_run is None
    assert any("is not saved" in warning for warning in server.warnings)


def test_without_a_file_report_and_rerun_take_the_last_run(data: Path, capsys: Any) -> None:
    saved = Saved()
    saved.give("d1-3", "u1", "w1-40")
    saved.run.close()
    for run in (run_report, run_rerun):
        assert run([]) == 0
        out, err = capsys.readouterr()
        assert err.startswith(f"the last run: {saved.run.path}")
        assert out


def test_without_any_run_they_say_where_runs_are_saved(data: Path, capsys: Any) -> None:
    with pytest.raises(RunLogError, match="only with --log"):
        last_run()
    assert run_report([]) == 2
    assert str(data) in capsys.readouterr().err


def test_a_server_keeps_its_run(data: Path, free_run: Callable[[Server], None]) -> None:
    server = Server(load(bundled_folder(), {"server.port": Override("--port", 0)}))
    server.save_run()
    server.start()
    free_run(server)
    server.stop()
    assert server.saved_run is not None
    with LogReader(server.saved_run.path) as log:
        assert log.header.number == 0
        assert len(list(log)) >= 2


@pytest.fixture
def free_run() -> Callable[[Server], None]:
    """A program that sends one command."""
    import socket

    def run(server: Server) -> None:
        with socket.create_connection(("127.0.0.1", server.ports["commands"])) as client:
            client.sendall(b"u1\n")
            assert len(client.recv(8)) == 8

    return run
