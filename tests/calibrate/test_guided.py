"""A guided session with an emulated robot, on a link that is lost now and then."""

from __future__ import annotations

import asyncio
import contextlib
import io
import os
import signal
import threading
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from rich.console import Console

from benchmarks.emulated_robots import FunctionLink, Session, draw_robot, record, set_with
from scripts.robot_emulator import Robot
from simmer_tui.calibrate.fit import Fit, fit
from simmer_tui.calibrate.guided import WANTED, SessionPlanner, drive_guided, guided_run
from simmer_tui.calibrate.measured_run import read_runs
from simmer_tui.cli.guided_session import progress_picture
from simmer_tui.cli.main import main
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.errors import CalibrationError
from simmer_tui.sim.specs import SimulationSpec


class BadLink(FunctionLink):
    """Is lost with every 97th reading and every 5th movement: of these every other one is still made, but
    no answer comes."""

    readings = movements = 0

    def write(self, data: bytes) -> None:
        moves = data[:1] in b"wsadr"
        self.readings += not moves
        self.movements += moves
        if self.movements % 5 if moves else self.readings % 97:
            super().write(data)
            return
        assert self._listener is not None
        if moves and self.movements % 10:
            self.robot.receive(data)
        loop = asyncio.get_running_loop()
        loop.call_soon(self._listener.lost, "unplugged")
        loop.call_soon(self._listener.opened)


def session_with(
    folder: Path, seed: int, most: int, wire: type[FunctionLink], *, learns: bool
) -> tuple[SessionPlanner, Robot, SimulationSpec]:
    """SessionPlanner a drawn robot; with `learns` estimates are made, as in a real session."""
    random = np.random.default_rng(seed)
    base = load(bundled_folder()).simulation
    hidden = draw_robot(random, replace(base, bot_center=(9.7, 41.9), bot_rot=1.0))
    configuration = set_with(base)
    guide = SessionPlanner(configuration, random, most)
    log = folder / "guided.jsonl"

    async def learn() -> Fit | None:
        try:
            return fit(guided_run(read_runs([log]))) if learns else None
        except CalibrationError:
            return None

    async def program(session: Session) -> None:
        await drive_guided(session.ask, guide, learn, session.robot.clock)

    robot = record(log, configuration, hidden, seed, program, wire_of=wire)
    return guide, robot, hidden


def test_it_begins_with_a_spin_survives_a_lost_link_and_touches_no_wall(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("simmer_tui.calibrate.guided._WAIT", 0.0)
    guide, robot, _ = session_with(tmp_path, 2, 20, BadLink, learns=False)
    assert guide.count == 20
    assert robot.simulator.contacts == 0
    movements = read_runs([tmp_path / "guided.jsonl"]).movements
    assert [movement.certain for movement in movements].count(False) == 4
    codes = [robot.simulator.spec.drives[movement.drive].code for movement in movements]
    assert codes[:7] == ["r1"] * 7
    assert set(codes) == {"w1", "s1", "a1", "d1", "r1"}
    pose = robot.simulator.pose
    assert np.hypot(guide.pose.x - pose.x, guide.pose.y - pose.y) < 1.0


@pytest.mark.slow
def test_it_ends_when_enough_is_known(tmp_path: Path) -> None:
    guide, robot, hidden = session_with(tmp_path, 4, 150, FunctionLink, learns=True)
    assert robot.simulator.contacts == 0
    assert guide.fit is not None
    assert guide.fit.identified.all()
    assert all(guide.reached[name] <= most for name, most in WANTED.items())
    places, _ = guide.fit.space.of(hidden)
    assert np.mean(np.abs(guide.fit.state.parameters - places) < 2 * guide.fit.standard_errors) > 0.8


DIALECT = """
[[command]]
match = "get"
reply = "{u1*cm:.1f},{u2*cm:.1f},{i1}"
[[command]]
match = "f {n}"
do = "d1-{n}"
done = "ok"
[[command]]
match = "t {n:int}"
do = "r1-{n}"
done = "ok"
[[command]]
match = "led {n:digit}"
"""


def test_it_asks_a_robot_with_a_dialect_only_what_that_has_a_message_for(folder: Path, found: Fit) -> None:
    (folder / "dialect.toml").write_text(DIALECT, "utf-8")
    guide = SessionPlanner(load(folder), np.random.default_rng(1))
    assert set(guide.looks()) == {"u1", "u2"}
    # The sketch goes back by a negative number.
    assert [each.code for each in guide.drives] == ["a1", "d1", "r1"]
    # What cannot be read is never known: the session does not wait for it.
    everything = SessionPlanner(found.run.configuration, np.random.default_rng(1))
    guide.fit = everything.fit = found
    assert guide.reached["range"] < everything.reached["range"]


@pytest.mark.parametrize(
    ("without", "what"), [('match = "get"', "reads a sensor"), ("do = ", "drives by a length")]
)
def test_a_dialect_that_cannot_be_driven_or_read_is_refused_before_somebody_places_the_robot(
    folder: Path, without: str, what: str, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = [each for each in DIALECT.split("[[command]]") if without not in each]
    (folder / "dialect.toml").write_text("[[command]]".join(kept), "utf-8")
    command = ["calibrate", "--guided", "--serial", "p", "--config", str(folder), "--out"]
    assert main([*command, str(folder / "learned")]) == 2
    told = capsys.readouterr()
    assert f"no message of the dialect {what}" in told.err
    assert told.out == ""


@pytest.mark.parametrize(
    "options",
    [["--guided", "--out", "x"], ["a.jsonl", "--guided", "--serial", "p", "--out", "x"], ["--out", "x"]],
)
def test_options_that_do_not_go_together_are_refused(
    options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["calibrate", *options]) == 2
    assert "--guided" in capsys.readouterr().err


def test_the_picture_fits_the_terminal_and_begins_with_what_is_known_least(found: Fit) -> None:
    guide = SessionPlanner(found.run.configuration, np.random.default_rng(1))
    guide.fit = found
    console = Console(file=io.StringIO(), width=80, height=24)
    console.print(progress_picture(guide, "d1-5", "/dev/ttyACM0", console.height))
    assert isinstance(console.file, io.StringIO)
    lines = [line.rstrip() for line in console.file.getvalue().splitlines()]
    assert len(lines) <= console.height - 1
    assert lines[0] == "movement 0 of at most 150, now: d1-5   [/dev/ttyACM0]"
    figures = [line for line in lines if line.endswith("#")]
    assert len(figures) > 10
    lengths = [line.count("#") for line in figures]
    assert lengths == sorted(lengths, reverse=True)
    assert figures[0].split()[0] in {"ultra5", "tof1"}  # which were never read
    assert lines[-1].endswith("parameters known better")


def test_ctrl_c_stops_a_robot_that_has_not_answered_yet(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import tty  # not on Windows

    robot, port = os.openpty()
    tty.setraw(port)
    sent = b""

    def interrupt() -> None:
        nonlocal sent
        while not sent.endswith(b"\n"):
            sent += os.read(robot, 100)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr("sys.stdin", io.StringIO("\n"))
    interrupting = threading.Thread(target=interrupt)
    interrupting.start()
    command = ["calibrate", "--guided", "--serial", os.ttyname(port), "--out", str(tmp_path / "set")]
    assert main(command) == 2
    interrupting.join()
    said = capsys.readouterr().err
    os.close(port)
    with contextlib.suppress(OSError):  # EIO: all has been read
        while more := os.read(robot, 100):
            sent += more
    os.close(robot)
    assert "the session ended before there was enough to estimate anything" in said
    assert sent.endswith(b"xx\n")
