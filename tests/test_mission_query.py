"""The facts of a mission, asked for over the program's own connection: `?m`."""

from __future__ import annotations

import asyncio
import json
import math
import queue
import shutil
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from simmer_tui.cli.main import main
from simmer_tui.client import InvalidInputError, Mission, NoMissionError, Robot
from simmer_tui.config.dialects import BELIEFS, COMMANDS, PACKET_REPLIES, PACKETS
from simmer_tui.config.loader import load
from simmer_tui.config.reply_formats import ReplyForm, ReplyFormat
from simmer_tui.config.sets import bundled_folder, find_set
from simmer_tui.config.settings_file import Override
from simmer_tui.links.backend import Backend, BackendSwitch, Message
from simmer_tui.links.protocol.mission_query import MissionQuery
from simmer_tui.live.operating.robot_operator import Operator
from simmer_tui.live.server import Server
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.sessions import Answered, Session
from simmer_tui.run.events import Action, ActionName, Notice
from simmer_tui.run.mission import MissionPlan, environment, facts, plan_run
from simmer_tui.sim import Simulator
from simmer_tui.sim.command import MISSION_QUERY, parse_command
from tests.listening import HOST

SCRIPTS = Path(__file__).parents[1] / "scripts"
DOUBLE = ReplyForm(ReplyFormat.FLOAT64, "big")
FACTS = ("drop_zone", "loading_zone", "time_limit", "gripper", "start")


@pytest.fixture(autouse=True)
def _no_variables(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in FACTS:
        monkeypatch.delenv(f"SIMMER_{name.upper()}", raising=False)


@contextmanager
def serving(name: str = "mission", **settings: object) -> Iterator[tuple[Server, MissionPlan | None]]:
    given = {"server.port": 0, "server.packet_port": 0, "seed": 5}
    given |= {each.replace("__", "."): value for each, value in settings.items()}
    configuration = load(find_set(name), {each: Override("--it", value) for each, value in given.items()})
    plan = None
    if configuration.mission is not None:
        configuration, plan = plan_run(configuration, 5)
    server = Server(configuration, plan=plan)
    server.start()
    try:
        yield server, plan
    finally:
        server.stop()


def robot_of(server: Server) -> Robot:
    ports = server.ports
    if PACKETS.purpose not in ports:
        return Robot(HOST, ports[COMMANDS.purpose], 0, belief_port=ports[BELIEFS.purpose], timeout=60)
    both = ports[PACKETS.purpose], ports[PACKET_REPLIES.purpose]
    return Robot(HOST, *both, protocol="packets", belief_port=ports[BELIEFS.purpose], timeout=60)


@pytest.mark.parametrize("listener", ["binary", "packets"])
def test_a_program_in_a_second_terminal_knows_its_mission(listener: str) -> None:
    with serving(server__listeners=(listener,)) as (server, plan), robot_of(server) as robot:
        assert plan is not None
        known = robot.mission()
        assert known == Mission(
            (plan.drop_zone.x, plan.drop_zone.y),
            tuple((cell.x, cell.y) for cell in plan.loading_zone),
            plan.time_limit,
            "p1",
        )
        assert (robot.send("?m-3"), robot.send("?m-2")) == (plan.time_limit, plan.drop_zone.y)
        assert all(math.isnan(robot.send(f"?m-{place}")) for place in (5, 0, 1.5, 99))
        assert plan.block[0] not in facts(plan, "p1")
        assert plan.start.x not in facts(plan, "p1")[4:7]


def test_a_query_leaves_no_trace_and_is_answered_in_its_turn(tmp_path: Path) -> None:
    def exchange(lines: str, count: int, log: Path) -> tuple[list[float], list[str]]:
        # Delays of the link are drawn for each command, in both directions.
        with serving(link__jitter=0.01) as (server, _):
            server.call(server.start_log, str(log))
            with socket.create_connection((HOST, server.ports[COMMANDS.purpose]), 60) as connection:
                connection.sendall(lines.encode())
                with connection.makefile("rb") as replies:
                    numbers = struct.unpack(f">{count}d", replies.read(8 * count))
        records = [json.loads(line) for line in log.read_text().splitlines()[1:]]
        for record in records:
            record.pop("real", None)
        told = [json.dumps(each) for each in records if each["kind"] != "notice"]
        return list(numbers), told

    plain, first = exchange("u1\nd1-3\nu1\nc1\n", 4, tmp_path / "plain.jsonl")
    mixed, second = exchange("?m-3\nu1\nd1-3\n?m-3\r\nu1\nc1\n?m-3\n", 7, tmp_path / "mixed.jsonl")
    assert mixed == [300.0, *plain[:2], 300.0, *plain[2:], 300.0]
    assert len(first) > 4
    assert first == second


def test_a_start_that_the_set_gives_is_told() -> None:
    configuration = load(find_set("mission"))
    _, plan = plan_run(configuration, 5)
    known = replace(plan, start_known=True)
    told = facts(known, "p1")
    assert told[4:7] == (plan.start.x, plan.start.y, plan.start.heading)
    assert all(map(math.isnan, facts(plan, "p1")[4:7]))
    # The variables of a program of --run say the same.
    variables = environment(known, "p1")
    assert variables["SIMMER_START"].split(",") == [repr(number) for number in told[4:7]]
    assert variables["SIMMER_GRIPPER"].encode() == bytes(divmod(int(told[3]), 256))
    cells = variables["SIMMER_LOADING_ZONE"].replace(";", ",").split(",")
    assert tuple(map(float, cells)) == told[7:]


class SilentRobot(Backend):
    """A real robot that never answers."""

    def __init__(self) -> None:
        self.messages: list[Message] = []

    def submit(self, message: Message, session: Session, answered: Answered) -> None:
        self.messages.append(message)


def asked(text: str, query: MissionQuery | None, form: ReplyForm = DOUBLE) -> tuple[bytes | None, int]:
    """The reply to a command, and the number of messages that the robot was sent."""
    robot, replies = SilentRobot(), []

    async def ask() -> None:
        engine = Engine(Simulator(load(bundled_folder()).simulation))
        switch, session = BackendSwitch(engine, robot), engine.session()
        switch.query = query
        message = Message(text.encode(), (parse_command(text),), form)
        switch.submit(message, session, lambda _, data: replies.append(data))
        if replies:
            switch.append_late(b"\n", session)

    asyncio.run(ask())
    return (replies or [None])[0], len(robot.messages)


def test_a_real_robot_is_never_sent_a_query() -> None:
    for text in ("?m", "?m-1", "?m:1"):
        assert asked(text, MissionQuery()) == (struct.pack(">d", math.nan), 0)
    framed = ReplyForm(ReplyFormat.FRAMED)
    assert asked("?m", MissionQuery(), framed)[0] == b"[?m:Not Found]"
    assert asked("?m-2", MissionQuery((1.0, 2.5)), framed)[0] == b"[?m:2.5]"
    assert asked("?m", MissionQuery((1.0, math.nan)), framed)[0] == b"[?m:1.000;nan]"
    assert asked("?m", MissionQuery((1.0,)), ReplyForm(ReplyFormat.FLOAT32))[0] == struct.pack("<2f", 1, 1)
    # Another text, or a robot with a code of this name: as before there were queries.
    assert asked("?mode", MissionQuery((1.0,))) == (None, 1)
    assert asked("?m-1", None) == (None, 1)


def test_a_query_is_answered_in_its_turn_also_while_the_robot_is_paused() -> None:
    engine = Engine(Simulator(load(bundled_folder()).simulation))
    switch, session, answered = BackendSwitch(engine), engine.session(), list[str]()
    switch.query = MissionQuery((1.0,))

    def send(text: str) -> None:
        message = Message(text.encode(), (parse_command(text),), DOUBLE)
        switch.submit(message, session, lambda results, data: answered.append(text))

    engine.perform(Action(ActionName.PAUSE, source="keys"))
    send("?m-1")
    assert answered == ["?m-1"]
    for text in ("u1", "?m-2", "u2", "?m-3"):
        send(text)
    assert answered == ["?m-1"], "a command waits before them"
    engine.step()
    assert answered == ["?m-1", "u1", "?m-2"]
    engine.perform(Action(ActionName.RESUME, source="keys"))
    assert answered == ["?m-1", "u1", "?m-2", "u2", "?m-3"]


def test_without_a_mission_a_program_is_told_what_to_start() -> None:
    with serving("default") as (server, _), robot_of(server) as robot:
        with pytest.raises(NoMissionError, match=r"has no mission: end it, and start 'simmer-tui --mission'"):
            robot.mission()
        assert math.isnan(robot.send("?m-1"))
        assert robot.read("u1") > 0
        assert server.simulator.commands == 1


def test_the_variables_of_run_count_first(monkeypatch: pytest.MonkeyPatch) -> None:
    given = {"DROP_ZONE": "30,6", "LOADING_ZONE": "6,42;18,42", "TIME_LIMIT": "90", "GRIPPER": "g7"}
    with serving() as (server, plan), robot_of(server) as robot:
        assert plan is not None
        monkeypatch.setenv("SIMMER_DROP_ZONE", "30,6")
        assert robot.mission()[:3:2] == ((30.0, 6.0), plan.time_limit)
        for name, text in given.items():
            monkeypatch.setenv(f"SIMMER_{name}", text)
        assert robot.mission() == Mission((30.0, 6.0), ((6.0, 42.0), (18.0, 42.0)), 90.0, "g7")
        monkeypatch.setenv("SIMMER_DROP_ZONE", "30;6")
        with pytest.raises(
            InvalidInputError, match=r"SIMMER_DROP_ZONE is '30': it must be x,y, such as 30,18"
        ):
            robot.mission()


def test_env_prints_the_variables_of_the_live_run(capsys: pytest.CaptureFixture[str]) -> None:
    with serving(server__token="secret") as (server, plan):
        assert plan is not None
        words = ["env", "--form", "json", "--belief-port", str(server.ports[BELIEFS.purpose])]
        assert main(words) == 2  # it has no token
        assert "start simmer-tui --mission" in capsys.readouterr().err
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("SIMMER_TOKEN", "secret")
            assert main(words) == 0
        printed: Mapping[str, Any] = json.loads(capsys.readouterr().out)
    expected = server.environment
    assert printed == expected
    assert printed["SIMMER_DROP_ZONE"] == f"{plan.drop_zone.x:g},{plan.drop_zone.y:g}"
    assert "SIMMER_START" not in printed


def ended(script: str, port: int) -> tuple[int, Sequence[str]]:
    """Exit code and error lines of a sample, run as in a second terminal."""
    program = [sys.executable, str(SCRIPTS / script)]
    variables = {"SIMMER_PORT": str(port), "SIMMER_BELIEF_PORT": "1"}
    with pytest.MonkeyPatch.context() as patch:
        for name, value in variables.items():
            patch.setenv(name, value)
        done = subprocess.run(program, capture_output=True, text=True, check=False, timeout=120)
    return done.returncode, done.stderr.splitlines()


@pytest.mark.slow
@pytest.mark.parametrize("script", ["course/step7_mission.py", "solve.py"])
def test_a_sample_says_in_one_line_what_to_start(script: str) -> None:
    with serving("default") as (server, _):
        code, lines = ended(script, server.ports[COMMANDS.purpose])
    assert (code, len(lines)) == (1, 1)
    assert lines[0].endswith("end it, and start 'simmer-tui --mission'")


@pytest.mark.parametrize(
    ("file", "phrase"),
    [
        ("c/simmer.h", f'"{MISSION_QUERY}"'),
        ("matlab/simmer_mission.m", f"'{MISSION_QUERY}'"),
        ("../simmer_tui/client.py", f'"{MISSION_QUERY}"'),
    ],
)
def test_all_clients_have_the_code_of_the_query(file: str, phrase: str) -> None:
    assert phrase in (SCRIPTS / file).read_text("utf-8")


def test_a_query_in_the_console_is_answered_in_words() -> None:
    with serving() as (server, plan):
        assert plan is not None
        told: queue.Queue[str] = queue.Queue()
        server.engine.watch(lambda event: told.put(event.text) if isinstance(event, Notice) else None)
        server.call(lambda: Operator(server).send(parse_command("?m", "console")))
        assert f"SIMMER_DROP_ZONE {plan.drop_zone.x:g},{plan.drop_zone.y:g}, " in told.get(timeout=60)
        assert server.simulator.commands == 0


C_PROGRAM = r"""
#include "simmer.h"
int main(void) {
    simmer_robot robot;
    simmer_mission known;
    int i;
    if (simmer_open(&robot, NULL, 0, -1) != SIMMER_OK) { puts(robot.error); return 1; }
    if (simmer_get_mission(&robot, &known) != SIMMER_OK) { puts(robot.error); return 1; }
    printf("%g,%g,%g,%s,", known.drop_x, known.drop_y, known.time_limit, known.gripper);
    printf("%d", isnan(known.start_x) != 0);
    for (i = 0; i < known.cells; i++) printf(",%g,%g", known.loading_x[i], known.loading_y[i]);
    return 0;
}
"""
OCTAVE_PROGRAM = (
    "m = simmer_mission(simmer_open()); cells = m.loading_zone.';"
    "printf('%g,%g,%g,%s,%d', m.drop_zone, m.time_limit, m.gripper, isempty(m.start)); printf(',%g', cells)"
)


def program_of(language: str, folder: Path) -> list[str]:
    """The command of a program that prints the facts."""
    needed = "cc" if language == "c" else "octave-cli"
    if shutil.which(needed) is None:
        pytest.skip(f"{needed} is not installed")
    if language == "octave":
        return [needed, "--norc", "--path", str(SCRIPTS / "matlab"), "--eval", OCTAVE_PROGRAM]
    source, target = folder / "facts.c", folder / "facts"
    source.write_text(C_PROGRAM)
    subprocess.run(["cc", "-I", str(SCRIPTS / "c"), "-o", target, source, "-lm"], check=True, timeout=120)
    return [str(target)]


@pytest.mark.slow
@pytest.mark.parametrize("language", ["c", "octave"])
def test_programs_in_other_languages_know_their_mission(
    language: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = program_of(language, tmp_path)
    said = []
    for name in ("mission", "default"):
        with serving(name) as (server, plan):
            monkeypatch.setenv("SIMMER_PORT", str(server.ports[COMMANDS.purpose]))
            done = subprocess.run(program, capture_output=True, text=True, check=False, timeout=120)
            said.append((done.returncode, done.stdout + done.stderr))
            if plan is not None:
                zone = "".join(f",{cell.x:g},{cell.y:g}" for cell in plan.loading_zone)
                expected = f"{plan.drop_zone.x:g},{plan.drop_zone.y:g},{plan.time_limit:g},p1,1{zone}"
    assert said[0] == (0, expected)
    assert said[1][0] == 1
    assert "the simulator has no mission: end it, and start" in said[1][1]
