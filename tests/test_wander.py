"""The sample program's decisions, against a scripted robot on a real socket."""

from __future__ import annotations

import importlib.util
import json
import math
import os
import random
import shutil
import signal
import socketserver
import statistics
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import ClassVar

import pytest

from simmer_tui.config import load_default
from simmer_tui.sim import SimulationSpec, Simulator

SCRIPT = Path(__file__).parents[1] / "scripts" / "wander.py"
HOST = "127.0.0.1"
SENSORS = ["u1", "u2", "u3", "u4", "u5", "i1", "o3", "g1", "c1"]
OPEN = dict.fromkeys(SENSORS, 20.0)


@pytest.fixture(scope="module")
def wander() -> Iterator[ModuleType]:
    spec = importlib.util.spec_from_file_location("wander", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    path = list(sys.path)
    sys.modules["wander"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["wander"]
    sys.path[:] = path


class ScriptedRobot:
    """Sensors read what the script says, step by step (the last stays); drives always succeed."""

    def __init__(self, steps: list[dict[str, float]]) -> None:
        self.steps = steps
        self.moves: list[str] = []
        self.polled: list[str] = []
        self.beliefs: list[dict[str, float]] = []
        self.all_beliefs_in = threading.Event()
        self.on_command: Callable[[str], None] = lambda command: None
        self.port = self.belief_port = 0

    def answer(self, command: str) -> float:
        self.on_command(command)
        if "-" in command:
            self.moves.append(command)
            return math.inf
        if command == "u1" and self.polled and len(self.steps) > 1:
            self.steps.pop(0)
        self.polled.append(command)
        return self.steps[0].get(command, math.nan)


@contextmanager
def scripted(*steps: dict[str, float]) -> Iterator[ScriptedRobot]:
    robot = ScriptedRobot(list(steps))

    class Commands(socketserver.StreamRequestHandler):
        timeout: ClassVar[float] = 10

        def handle(self) -> None:
            for line in self.rfile:
                self.wfile.write(struct.pack(">d", robot.answer(line.decode("ascii").strip())))

    class Beliefs(socketserver.StreamRequestHandler):
        timeout: ClassVar[float] = 10

        def handle(self) -> None:
            robot.beliefs.extend(map(json.loads, self.rfile))
            robot.all_beliefs_in.set()

    with (
        socketserver.ThreadingTCPServer((HOST, 0), Commands) as commands,
        socketserver.ThreadingTCPServer((HOST, 0), Beliefs) as beliefs,
    ):
        threads = [
            threading.Thread(target=server.serve_forever, args=(0.01,)) for server in (commands, beliefs)
        ]
        for thread in threads:
            thread.start()
        robot.port, robot.belief_port = commands.server_address[1], beliefs.server_address[1]
        try:
            yield robot
        finally:
            commands.shutdown()
            beliefs.shutdown()
            for thread in threads:
                thread.join()


@pytest.fixture(autouse=True)
def _no_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("HOST", "PORT", "REPLY_PORT"):
        monkeypatch.delenv(f"SIMMER_{name}", raising=False)
    monkeypatch.setenv("SIMMER_BELIEF_PORT", "1")  # nobody listens there; the usual port may be in use


def run(wander: ModuleType, robot: ScriptedRobot, *options: str) -> int:
    address = ["--host", HOST, "--port", str(robot.port), "--reply-port", "0"]
    code = wander.main([*address, *options])
    assert isinstance(code, int)
    return code


@pytest.mark.parametrize(
    ("readings", "move"),
    [
        ({}, "d1-2"),
        ({"u1": math.inf}, "d1-2"),
        ({"u1": 6.01, "u2": 3.51, "u4": 3.51}, "d1-2"),
        ({"u1": 6, "u2": 5, "u4": 4}, "r1-30"),
        ({"u1": 6, "u2": 4, "u4": 5}, "r1--30"),
        ({"u2": 3.5}, "r1--30"),
        ({"u4": 3.5}, "r1-30"),
        ({"u1": 3, "u2": 1.4, "u4": 9}, "d1--2"),
        ({"u1": 1.4}, "d1--2"),
        ({"u2": 1.4, "u3": 4}, "r1--30"),
    ],
    ids=[
        "open",
        "nothing ahead",
        "just enough room",
        "ahead blocked, left clearer",
        "ahead blocked, right clearer",
        "left near",
        "right near",
        "too near to turn",
        "too near ahead",
        "boxed in behind too",
    ],
)
def test_one_step_reads_every_sensor_and_moves_once(
    wander: ModuleType, readings: dict[str, float], move: str
) -> None:
    with scripted(OPEN | readings) as robot:
        assert run(wander, robot, "--steps", "1") == 0
    assert robot.polled == SENSORS
    assert robot.moves == [move]


def test_it_turns_the_same_way_until_there_is_room_and_then_looks_again(wander: ModuleType) -> None:
    blocked = OPEN | {"u1": 3.0}
    steps = [blocked | {"u2": 8.0, "u4": 7.0}, blocked | {"u2": 5.0, "u4": 9.0}, OPEN, blocked | {"u2": 5.0}]
    with scripted(OPEN, *steps) as robot:
        assert run(wander, robot, "--steps", "5") == 0
    assert robot.moves == ["d1-2", "r1-30", "r1-30", "d1-2", "r1--30"]


def test_once_backed_out_it_turns_away_before_it_drives_again(wander: ModuleType) -> None:
    # A corner between two rays: ahead is clear, and clear again as soon as the robot has backed out.
    with scripted(OPEN, OPEN | {"u2": 1.0}, OPEN | {"u2": 4.0}, OPEN) as robot:
        assert run(wander, robot, "--steps", "4") == 0
    assert robot.moves == ["d1-2", "d1--2", "r1--30", "d1-2"]


@pytest.mark.slow
def test_two_sides_as_clear_are_tried_in_an_order_that_the_seed_repeats(wander: ModuleType) -> None:
    runs = []
    for _ in range(2):
        with scripted(OPEN, *[OPEN | {"u1": 3.0}, OPEN] * 10) as robot:
            assert run(wander, robot, "--steps", "21", "--seed", "3") == 0
        runs.append(robot.moves)
    assert runs[0] == runs[1]
    assert {move for move in runs[0] if move.startswith("r")} == {"r1-30", "r1--30"}
    assert [move for move in runs[0] if move.startswith("d")] == ["d1-2"] * 11


class SimulatedRobot:
    """The default set in process, as the client library sees it."""

    def __init__(self, spec: SimulationSpec, seed: int) -> None:
        self.simulator = Simulator(spec, seed)

    def read(self, *codes: str) -> list[float] | float:
        replies = [self.simulator.execute(code).reply for code in codes]
        return replies if len(codes) > 1 else replies[0]

    def drive(self, code: str, value: float) -> None:
        self.simulator.execute(f"{code}-{value}")

    def believe(self, x: float, y: float, heading: float, spread: float) -> None:
        """Nobody is shown it."""


@pytest.mark.slow
def test_it_hardly_ever_touches_a_wall_and_gets_about(wander: ModuleType) -> None:
    spec = load_default().simulation
    contacts, cells = [], []
    for seed in range(50):
        robot = SimulatedRobot(spec, seed)
        position, wanderer = wander.start_pose("9.5,42,0"), wander.Wanderer(random.Random(seed))
        seen = set()
        for _ in range(200):
            wander.step(robot, position, wanderer)
            pose = robot.simulator.pose
            seen.add((pose.x // 12, pose.y // 12))
        contacts.append(robot.simulator.contacts)
        cells.append(len(seen))
    assert statistics.median(contacts) == 0
    assert max(contacts) <= 5
    assert contacts[7] == 0, "the README's own run"
    assert statistics.median(cells) >= 8


def test_readings_and_moves_are_printed(wander: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    with scripted(OPEN | {"u1": 3.456, "u2": 1, "u3": math.inf}) as robot:
        assert run(wander, robot, "--steps", "2") == 0
    first = "1: u1=3.46 u2=1.00 u3=inf u4=20.00 u5=20.00 i1=20.00 o3=20.00 g1=20.00 c1=20.00 -> d1--2"
    second = first.replace("1:", "2:", 1).replace("d1--2", "r1--30")
    assert capsys.readouterr().out.splitlines() == [first, second]


def test_dead_reckoning_is_shown_at_every_step(wander: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    # 2 in forward; then 90 degrees left, in which o3 runs backwards, and 2 in forward.
    turn = -3 * math.pi / 2
    with scripted(
        OPEN | {"o3": 5.0, "g1": 10.0},
        OPEN | {"o3": 7.0, "g1": 10.0},
        OPEN | {"o3": 9.0 + turn, "g1": 100.0},
    ) as robot:
        monkeypatch.setenv("SIMMER_BELIEF_PORT", str(robot.belief_port))
        assert run(wander, robot, "--steps", "3", "--start", "6,42,0") == 0
        assert robot.all_beliefs_in.wait(60)
    poses = [(belief["x"], belief["y"], belief["heading"]) for belief in robot.beliefs]
    assert poses == [pytest.approx(pose) for pose in [(6, 42, 0), (8, 42, 0), (8, 44, 90)]]
    spreads = [belief["spread"] for belief in robot.beliefs]
    assert spreads == sorted(spreads)
    assert spreads[0] == 0 < spreads[2]


def test_without_a_robot_it_says_so_in_one_line(
    wander: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    with scripted(OPEN) as robot:
        pass  # its port is free again
    assert run(wander, robot, "--steps", "1") == 1
    error = capsys.readouterr().err
    assert error.startswith(f"wander: no simulator answers on {HOST} port {robot.port}")
    assert error.count("\n") == 1


def test_a_missing_sensor_ends_it_with_its_code(
    wander: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    with scripted(OPEN | {"o3": math.nan}) as robot:
        assert run(wander, robot) == 1
    assert "no sensor 'o3'" in capsys.readouterr().err


@pytest.mark.parametrize(
    "options",
    [["--steps", "0"], ["--steps", "1.5"], ["--start", "1,2"], ["--start", "1,2,nan"], ["--start", "a,b,c"]],
)
def test_a_wrong_option_is_named(
    wander: ModuleType, options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        wander.main(options)
    assert end.value.code == 2
    assert f"{options[0]}: '{options[1]}'" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="needs a signal sent to one thread")
def test_an_interrupt_ends_it_with_exit_code_0(
    wander: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    main_thread = threading.main_thread().ident
    assert main_thread is not None
    ident: int = main_thread

    def interrupt_the_third_step(command: str) -> None:
        if command == "u1" and robot.polled.count("u1") == 2:
            signal.pthread_kill(ident, signal.SIGINT)

    with scripted(OPEN) as robot:
        robot.on_command = interrupt_the_third_step
        assert run(wander, robot) == 0
    assert capsys.readouterr().out.endswith("stopped after 2 steps\n")


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("place", ["clone", "beside"])
def test_it_runs_as_a_program_where_the_package_is_not_installed(place: str, tmp_path: Path) -> None:
    script = SCRIPT
    if place == "beside":
        script = tmp_path / "programs" / "wander.py"
        script.parent.mkdir()
        shutil.copy(SCRIPT, script)
        shutil.copy(SCRIPT.parents[1] / "simmer_tui" / "client.py", script.parent)
    with scripted(OPEN) as robot:
        environment = {**os.environ, "SIMMER_PORT": str(robot.port), "SIMMER_REPLY_PORT": "0"}
        environment.pop("PYTHONPATH", None)
        command = [sys.executable, "-S", str(script), "--steps", "2"]
        ended = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
    assert (ended.returncode, ended.stderr) == (0, "")
    assert robot.moves == ["d1-2", "d1-2"]
    assert len(ended.stdout.splitlines()) == 2
