"""A real robot that speaks the team's own language: its program's bytes, its twin, and who else drives it."""

from __future__ import annotations

import asyncio
import math
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import serial

from simmer_tui.calibrate.measured_run import read_runs
from simmer_tui.cli.main import main
from simmer_tui.config.dialects import COMMANDS, SERIAL
from simmer_tui.config.loader import find_set, init_set, load
from simmer_tui.config.settings_file import Override
from simmer_tui.links import dialect_robot
from simmer_tui.links.serial_link import LinkListener, RobotLink, SerialLink
from simmer_tui.live.operating.robot_operator import Operator
from simmer_tui.live.server import Server
from simmer_tui.program.hook.simmer_serial import make_class
from simmer_tui.run.events import (
    Action,
    ActionName,
    CommandResult,
    Event,
    MovementEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
    TwinReading,
    VelocityEnded,
    WireMessage,
)
from simmer_tui.sim.command import parse_command
from simmer_tui.sim.records import Status
from tests.links.sketch_robot import DIALECT, SketchRobot

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no ptys")


class Scene:
    """A server, the robot that it drives, and what has happened."""

    def __init__(self, server: Server, robot: SketchRobot, events: list[Event], changed: Any) -> None:
        self.server, self.robot, self.events, self._changed = server, robot, events, changed
        self.operator = Operator(server)

    def wait_until(self, condition: Callable[[], bool]) -> None:
        """Wait for something that an event brings."""
        with self._changed:
            assert self._changed.wait_for(condition, 20), self.events

    def of(self, kind: type[Any]) -> list[Any]:
        """The events of a kind."""
        return [event for event in self.events if isinstance(event, kind)]

    @property
    def wire(self) -> list[tuple[str, bool]]:
        return [(each.data, each.reply) for each in self.of(WireMessage)]

    @property
    def told(self) -> list[str]:
        return [each.text for each in self.of(Notice)]

    def type(self, text: str) -> None:
        """Type a command in the console."""
        self.operator.send(parse_command(text, "console"))


class ThreadNotingLink(SerialLink):
    """A serial port that notes in which thread it is written."""

    threads: list[str]

    def write_instead(self, data: bytes) -> list[bytes]:
        self.threads.append(threading.current_thread().name)
        return super().write_instead(data)


class LostLink(SerialLink):
    """A serial port whose listener the test may tell of a loss."""

    listener: LinkListener

    def start(self, listener: LinkListener) -> None:
        self.listener = listener
        super().start(listener)


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Callable[..., Scene]]:
    """Start servers in front of robots."""
    running: list[tuple[Server, SketchRobot]] = []

    def begin(
        dialect: str = DIALECT,
        silent: frozenset[str] = frozenset(),
        link: Callable[[str], RobotLink] = SerialLink,
        log: str = "",
        **settings: object,
    ) -> Scene:
        if not (tmp_path / "set").exists():
            init_set(tmp_path / "set", find_set("default"))
        (tmp_path / "set/dialect.toml").write_text(dialect, "utf-8")
        robot = SketchRobot(silent)
        overrides = {
            "serial.port": Override("--serial", robot.name),
            "server.listeners": Override("--listeners", ("dialect", "binary")),
            "motion.time_scale": Override("--time-scale", 50.0),
            "randerror": Override("--no-randerror", False),
            "randbias": Override("--no-randbias", False),
        }
        overrides |= {f"server.{each}": Override("", 0) for each in ("port", "reply_port", "belief_port")}
        overrides |= {name.replace("__", "."): Override("", value) for name, value in settings.items()}
        server = Server(load(tmp_path / "set", overrides), robot_link=lambda serial: link(serial.port))
        events: list[Event] = []
        changed = threading.Condition()

        def note(event: Event) -> None:
            with changed:
                events.append(event)
                changed.notify_all()

        if log:
            server.start_log(log)
        running.append((server, robot))
        server.start(note)
        scene = Scene(server, robot, events, changed)
        scene.wait_until(lambda: any("is open" in text for text in scene.told))
        return scene

    yield begin
    for server, robot in running:
        server.stop()
        robot.close()


@pytest.fixture
def program(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Scene], Any]]:
    """Open the serial port as a program does that the simulator runs."""
    opened: list[Any] = []

    def open_port(scene: Scene) -> Any:
        port = scene.server.ports[SERIAL.purpose]
        monkeypatch.setenv(SERIAL.variable, str(port))
        monkeypatch.setenv("SIMMER_HOST", "127.0.0.1")
        made = make_class(serial.serialutil)("COM6", 9600, timeout=20)
        opened.append(made)
        return made

    yield open_port
    for each in opened:
        each.close()


def test_bytes_pass_unchanged_both_ways_and_the_twin_moves(
    stage: Callable[..., Scene], program: Callable[[Scene], Any]
) -> None:
    scene = stage()
    port = program(scene)
    port.write(b"f 3\n")
    assert port.readline() == b"ok\r\n"
    port.write(b"\x00\xff what?\nge")
    assert port.readline() == b"hm\r\n"
    port.write(b"t\n")
    assert port.readline() == b"25.4,14.2 led 0\r\n"
    scene.robot.say(b"\x01\x02")
    assert port.read(2) == b"\x01\x02"
    assert bytes(scene.robot.bytes) == b"f 3\n\x00\xff what?\nget\n"
    (moved,) = scene.of(MovementEnded)
    assert moved.command.text == "d1-3"
    # The robot's answer ends the twin's movement: the reading after it is one at a stop.
    scene.wait_until(lambda: ("25.4,14.2 led 0\r\n", True) in scene.wire)
    assert [pair for pair in scene.wire if pair[1]][:2] == [("ok\r\n", True), ("hm\r\n", True)]
    assert ("f 3\n", False) in scene.wire
    # A contact of the movement names the message, by its time.
    (planned,) = scene.of(MovementPlanned)
    assert planned.time == next(each.time for each in scene.of(WireMessage) if each.data == "f 3\n")
    assert any("is no message of the dialect" in text for text in scene.told)
    readings = [each for each in scene.of(CommandResult) if each.status is Status.READING]
    assert [each.command.text for each in readings] == ["u1", "u2"]
    assert [each.reply for each in readings] == pytest.approx([10.0, 5.0])
    assert [each.robot for each in scene.of(TwinReading)] == pytest.approx([10.0, 5.0])
    assert all(math.isfinite(each.simulated) for each in scene.of(TwinReading))


def test_a_robot_faster_than_takes_is_compared_with_the_twin_of_now(
    stage: Callable[..., Scene], program: Callable[[Scene], Any]
) -> None:
    slow = DIALECT.replace('match = "get"', 'match = "get"\ntakes = 0.4')
    scene = stage(slow, silent=frozenset(("f 12",)))
    port = program(scene)
    port.write(b"get\n")
    port.readline()
    port.write(b"f 12\n")
    scene.wait_until(lambda: bool(scene.of(MovementEnded)))
    port.write(b"get\n")
    port.readline()
    scene.wait_until(lambda: len(scene.of(TwinReading)) == 4)
    first, second = (each for each in scene.of(TwinReading) if each.code == "u1")
    (moved,) = scene.of(MovementEnded)
    assert first.time <= moved.time <= second.time
    assert first.simulated - second.simulated == pytest.approx(12.0, abs=4.0)


def test_a_message_behind_a_question_leaves_the_twins_reading_of_it(
    stage: Callable[..., Scene], program: Callable[[Scene], Any]
) -> None:
    scene = stage(silent=frozenset(("get", "f")), motion__time_scale=1.0)
    port = program(scene)
    port.write(b"get\n")
    scene.robot.wait_for("get")
    scene.robot.say(b"25.4,14.2 led 0\r\n")
    scene.wait_until(lambda: len(scene.of(TwinReading)) == 2)
    port.write(b"get\nf 20\n")
    scene.wait_until(lambda: bool(scene.of(MovementPlanned)))
    scene.robot.wait_for("get", "get", "f 20")
    scene.robot.say(b"25.4,14.2 led 0\r\n")
    scene.wait_until(lambda: len(scene.of(TwinReading)) == 4)
    (moved,) = scene.of(MovementPlanned)
    assert all(each.time <= moved.time for each in scene.of(TwinReading))


def test_programs_over_tcp_are_answered_by_rules_turned_round(stage: Callable[..., Scene]) -> None:
    scene = stage()

    async def ask(*commands: str) -> list[float]:
        reader, writer = await asyncio.open_connection("127.0.0.1", scene.server.ports[COMMANDS.purpose])
        replies = []
        for command in commands:
            writer.write(f"{command}\n".encode())
            async with asyncio.timeout(20):
                replies.append(struct.unpack(">d", await reader.readexactly(8))[0])
        writer.close()
        return replies

    replies = asyncio.run(ask("d1-3", "d1--2.5", "r1-30", "w1-1", "u1", "u2", "wt-0.1", "u5", "d1-zz", "xx"))
    assert replies == pytest.approx(
        [math.inf, math.inf, math.inf, math.inf, 10.0, 5.0, math.inf, math.nan, math.nan, math.inf],
        nan_ok=True,
    )
    # 1 in at 6 in/s; to the left is the rule's own word, not a negative time.
    speed = next(each.speed for each in scene.server.configuration.simulation.drives if each.code == "w1")
    sideways = f"go left {round(1000 / speed)}"
    scene.robot.wait_for("f 3", "b 2.5", "t -30", sideways, "get", "get", "x")
    reasons = [each.reason for each in scene.of(CommandResult) if math.isnan(each.reply)]
    assert reasons[0] == "no message of the dialect without a movement is answered with u5 alone in a field"


def test_report_and_calibration_read_its_log(
    stage: Callable[..., Scene],
    program: Callable[[Scene], Any],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    log = tmp_path / "run.jsonl"
    scene = stage(log=str(log))
    port = program(scene)
    for line in (b"get\n", b"f 3\n", b"get\n", b"t 90\n", b"get\n"):
        port.write(line)
        port.readline()
    scene.wait_until(lambda: len(scene.of(TwinReading)) == 6)
    scene.server.stop()
    run = read_runs([log])
    assert [(each.value, each.certain) for each in run.movements] == [(3.0, True), (-90.0, True)]
    assert not run.simulated
    assert run.readings["u1"].stops.tolist() == [0, 1, 2]
    assert run.readings["u2"].values.tolist() == pytest.approx([5.0] * 3)
    assert main(["report", str(log)]) == 0
    assert "u1" in capsys.readouterr().out


def test_the_exchange_is_recorded_and_compared_with_the_dialect(
    stage: Callable[..., Scene],
    program: Callable[[Scene], Any],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    record = tmp_path / "exchange.jsonl"
    scene = stage(serial__record=str(record))
    port = program(scene)
    for line in (b"get\n", b"f 3\n"):
        port.write(line)
        port.readline()
    scene.server.stop()
    command = ["check", str(tmp_path / "set"), "--against", str(record)]
    assert main(command) == 0
    dialect = tmp_path / "set/dialect.toml"
    dialect.write_text(DIALECT.replace('done = "ok"', 'done = "fine"'), "utf-8")
    assert main(command) == 1
    assert "'f {n}': the robot says 'ok', and the dialect 'fine'" in capsys.readouterr().out


def test_an_exchange_that_cannot_be_recorded_is_told(stage: Callable[..., Scene], tmp_path: Path) -> None:
    scene = stage(serial__record=str(tmp_path / "no/such/folder"))
    assert any("what the robot says is not recorded" in text for text in scene.told)


def test_a_robot_that_is_silent_is_not_waited_for(stage: Callable[..., Scene]) -> None:
    scene = stage(silent=frozenset(("get", "f")), serial__timeout=0.05)
    for text, line in (("u1", "get"), ("d1-1", "f 1")):
        scene.type(text)
        scene.wait_until(
            lambda text=text: any(  # type: ignore[misc]
                each.status is Status.UNANSWERED and each.command.text == text
                for each in scene.of(CommandResult)
            )
        )
        assert scene.robot.lines[-1] == line


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("blocked", [False, True])
def test_the_robots_thread_stops_it_when_keys_go_silent(stage: Callable[..., Scene], blocked: bool) -> None:
    links: list[ThreadNotingLink] = []

    def link(port: str) -> RobotLink:
        links.append(ThreadNotingLink(port))
        links[-1].threads = []
        return links[-1]

    scene = stage(link=link)
    if not blocked:
        scene.operator.drive("forward", False)
        scene.robot.wait_for("w", "x")
    else:

        async def screen() -> None:
            scene.operator.drive("forward", False)
            # The screen's event loop does nothing until the robot has been stopped.
            scene.robot.wait_for("w", "x")

        asyncio.run(screen())
    assert links[-1].threads == ["robot"]
    scene.wait_until(lambda: bool(scene.of(VelocityEnded)))


def test_a_key_that_is_held_drives_on_and_another_one_stops_first(
    stage: Callable[..., Scene], monkeypatch: pytest.MonkeyPatch
) -> None:
    # A busy machine may hold up the presses of this test for longer than a quarter of a second.
    monkeypatch.setattr(dialect_robot, "KEY_SILENCE", 1.5)
    scene = stage()
    for _ in range(3):
        scene.operator.drive("forward", False)
    scene.operator.drive("turn_right", False)
    scene.robot.wait_for("w", "x", "t 15", "x")


def test_a_persons_stop_reaches_the_robot(
    stage: Callable[..., Scene], program: Callable[[Scene], Any]
) -> None:
    scene = stage()
    port = program(scene)
    port.write(b"w\nf 1")
    scene.robot.wait_for("w", "f 1")
    scene.operator.perform(Action(ActionName.STOP, source="keys"))
    # Half a line of the program is ended first: f 1x would be no stop.
    scene.robot.wait_for("w", "f 1", "x")


def test_what_a_program_writes_to_a_closed_port_is_told_once(
    stage: Callable[..., Scene], program: Callable[[Scene], Any]
) -> None:
    links: list[LostLink] = []

    def link(port: str) -> RobotLink:
        links.append(LostLink(port))
        return links[-1]

    scene = stage(link=link)
    port = program(scene)
    scene.server.call(lambda: links[-1].listener.lost("the cable was pulled"))
    port.write(b"f 1\n")
    port.write(b"f 1\n")
    port.close()
    scene.wait_until(lambda: any("closed COM6" in text for text in scene.told))
    assert sum("what the program writes is lost" in text for text in scene.told) == 1
    assert not scene.of(MovementEnded)


def test_what_a_program_writes_while_the_board_starts_is_sent_when_it_has_started(
    stage: Callable[..., Scene], program: Callable[[Scene], Any]
) -> None:
    scene = stage(serial__boot=60)  # longer than this test may take
    port = program(scene)
    assert scene.server.robot is not None
    scene.server.call(scene.server.robot.wrote, b"f 3\n")
    scene.server.tell_at_once(Notice(NoticeKind.HINT, "it has been written"))
    assert bytes(scene.robot.bytes) == b""
    scene.robot.say(b"Ready\r\n")
    assert port.readline() == b"Ready\r\n"
    assert port.readline() == b"ok\r\n"
    scene.wait_until(lambda: bool(scene.of(MovementEnded)))
    assert bytes(scene.robot.bytes).startswith(b"f 3\n")
    assert "robot: the board said 'Ready' when it started" in scene.told
    assert not any("lost" in text or "no message" in text for text in scene.told)


def test_another_rate_of_the_program_is_told(
    stage: Callable[..., Scene], program: Callable[[Scene], Any]
) -> None:
    scene = stage(serial__baud=115200)
    program(scene)
    scene.wait_until(lambda: any("--baud 9600 sets it" in text for text in scene.told))


def test_nobody_else_drives_or_reads_while_a_program_has_the_port(
    stage: Callable[..., Scene], program: Callable[[Scene], Any]
) -> None:
    scene = stage()
    port = program(scene)
    for text in ("d1-3", "u1"):
        scene.type(text)
    scene.operator.drive("forward", False)
    scene.wait_until(
        lambda: len([each for each in scene.of(CommandResult) if "port open" in each.reason]) == 3
    )
    port.close()
    scene.wait_until(lambda: any("closed COM6" in text for text in scene.told))
    scene.type("u1")
    scene.robot.wait_for("get")


def test_without_a_plain_stop_people_do_not_drive_the_robot(stage: Callable[..., Scene]) -> None:
    scene = stage(
        dialect=DIALECT.replace('match = "x"\ndo = "stop"', 'match = "x"\ndo = ["stop", "led = 0"]')
    )
    scene.type("d1-3")
    scene.operator.drive("forward", False)
    reasons = lambda: [each.reason for each in scene.of(CommandResult)]  # noqa: E731
    scene.wait_until(lambda: len(reasons()) == 2)
    assert all(each.startswith("no rule of the dialect is a plain stop") for each in reasons())
    scene.operator.perform(Action(ActionName.STOP, source="keys"))
    scene.wait_until(lambda: any("the robot cannot be stopped" in text for text in scene.told))
    assert scene.robot.lines == []


def test_sensors_are_polled_while_nothing_moves(stage: Callable[..., Scene]) -> None:
    scene = stage(silent=frozenset(("f",)), serial__timeout=0.5)
    scene.type("d1-1")
    scene.type("u1")
    scene.robot.wait_for("f 1", "get")
    readings = [each for each in scene.of(CommandResult) if each.status is Status.READING]
    assert not readings or scene.of(MovementEnded)


def test_what_the_twin_foresees_stands_beside_a_persons_command(stage: Callable[..., Scene]) -> None:
    scene = stage()
    scene.type("d1-90")
    scene.wait_until(lambda: any(text.startswith("this will touch in ") for text in scene.told))


def test_where_the_rule_says_now_sensors_are_polled_meanwhile(stage: Callable[..., Scene]) -> None:
    dialect = DIALECT.replace('match = "get"', 'match = "get"\nbusy = "now"')
    scene = stage(dialect=dialect, silent=frozenset(("f",)), serial__timeout=60.0)
    scene.type("d1-1")
    scene.type("u1")
    scene.robot.wait_for("f 1", "get")


def test_what_the_robot_sends_by_itself_is_read(
    stage: Callable[..., Scene], program: Callable[[Scene], Any]
) -> None:
    scene = stage(dialect=DIALECT + '[[stream]]\nevery = 0.1\nsend = "s{u1:.1f}"\n')
    port = program(scene)
    scene.robot.say(b"s12.5\r\n")
    assert port.readline() == b"s12.5\r\n"
    scene.wait_until(lambda: [each.robot for each in scene.of(TwinReading)] == [12.5])
