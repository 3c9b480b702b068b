"""The serial port of a dialect at the path of a pseudo-terminal, and the variables that `env` prints."""

from __future__ import annotations

import json
import os
import queue
import socket
import subprocess
import sys
import tty
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from msgspec.structs import replace

from simmer_tui.cli.main import main
from simmer_tui.config.loader import Configuration, find_set, init_set, load
from simmer_tui.config.settings import with_any_ports
from simmer_tui.config.settings_file import Override
from simmer_tui.errors import ConfigurationError, PortError
from simmer_tui.links.pty_port import PtyDevice
from simmer_tui.live.server import Server
from simmer_tui.program.program_command import HOOK_FOLDER, out_of_reach
from simmer_tui.run.events import Action, ActionName, Event, Notice, ProgramEnded, WireMessage
from tests.in_process import simmer

serial = pytest.importorskip("serial")
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals")

DIALECT = """
[reply]
end = "\\r\\n"
[[command]]
match = "get"
reply = "u1: {u1*cm:.2f}"
[[command]]
match = "w {n}"
do = "d1-{n}"
done = "ok {contact}"
"""
TIMEOUT = 120.0


def configuration(tmp_path: Path, dialect: str = DIALECT, **server: object) -> Configuration:
    """The default set with a dialect."""
    if not (tmp_path / "set").exists():
        init_set(tmp_path / "set", find_set("default"))
    (tmp_path / "set/dialect.toml").write_text(dialect, "utf-8")
    made = load(tmp_path / "set")
    settings = replace(with_any_ports(made.settings).server, **server)
    return replace(made, settings=replace(made.settings, seed=3, randerror=False, server=settings))


class Watched:
    """A running simulator, and what it has told."""

    def __init__(self, server: Server, events: queue.SimpleQueue[Event]) -> None:
        self.server = server
        self._events = events
        self.seen: list[Event] = []

    def until(self, text: str) -> str:
        """Wait for a notice that has a text; returns it."""
        while True:
            event = self._events.get(timeout=TIMEOUT)
            self.seen.append(event)
            if isinstance(event, Notice) and text in event.text:
                return event.text

    @property
    def wire(self) -> list[tuple[str, bool]]:
        """Texts that went over the wire, and whether they are replies."""
        return [(each.data, each.reply) for each in self.seen if isinstance(each, WireMessage)]


@contextmanager
def running(made: Configuration) -> Iterator[Watched]:
    events: queue.SimpleQueue[Event] = queue.SimpleQueue()
    server = Server(made)
    server.start(events.put)
    try:
        yield Watched(server, events)
    finally:
        server.stop()


def each_way(wire: Iterable[tuple[str, bool]]) -> dict[bool, list[str]]:
    """The messages to and from the robot. Whether a reply is logged before the next message depends on the
    machine's load."""
    return {back: [text for text, is_back in wire if is_back == back] for back in (False, True)}


def test_a_program_reaches_the_robot_at_the_path_with_the_bytes_of_the_hook(tmp_path: Path) -> None:
    path = tmp_path / "für COM6"
    with running(configuration(tmp_path, pty=str(path))) as run:
        assert str(path) in run.until("the robot's serial port is at")
        with serial.Serial(str(path), 115200, timeout=TIMEOUT) as robot:
            robot.write(b"get\nw 2\n")
            first, second = robot.readline(), robot.readline()
        run.until("the program closed")
        by_pty = each_way(run.wire)
    assert first.startswith(b"u1: ")
    assert second == b"ok 0\r\n"
    assert not path.is_symlink()
    program = "import serial\nr = serial.Serial('COM6', 115200, timeout=60)\n"
    program += "r.write(b'get\\nw 2\\n')\nprint(r.readline() + r.readline())\nr.close()\n"
    with running(configuration(tmp_path)) as run:
        variables = run.server.environment | {"PYTHONPATH": str(HOOK_FOLDER)}
        words = [sys.executable, "-c", program]
        ended = subprocess.run(
            words, env={**os.environ, **variables}, capture_output=True, text=True, timeout=300, check=True
        )
        run.until("the program closed")
        assert each_way(run.wire) == by_pty
    assert ended.stdout.strip() == repr(first + second)


def test_the_time_of_bytes_follows_the_rate_that_the_program_sets(tmp_path: Path) -> None:
    path = tmp_path / "robot"
    with running(configuration(tmp_path, pty=str(path))) as run:
        with serial.Serial(str(path), 1200, timeout=TIMEOUT) as robot:
            for _ in range(2):
                robot.write(b"get\n")
                assert robot.readline()
        run.until("the program closed")
        sent, _, again, _ = [each.time for each in run.seen if isinstance(each, WireMessage)]
    # The 11 bytes of the reply, and the 4 that ask, at 10 bits each.
    assert again - sent >= 15 * 10 / 1200 - 1e-3


def test_until_a_program_sets_a_rate_it_is_9600_baud(tmp_path: Path) -> None:
    """That of serial ports; a pseudo-terminal begins at 38400."""
    import termios

    path = tmp_path / "robot"
    with running(configuration(tmp_path, pty=str(path))), path.open("r+b", buffering=0) as robot:
        assert termios.tcgetattr(robot.fileno())[4:6] == [termios.B9600] * 2


def test_after_a_restart_the_line_is_free(tmp_path: Path) -> None:
    """Simulated time begins again at 0: what the line carried before is over."""
    path = tmp_path / "robot"
    with (
        running(configuration(tmp_path, pty=str(path))) as run,
        serial.Serial(str(path), 115200, timeout=TIMEOUT) as robot,
    ):
        act = run.server.engine.perform
        run.server.call(act, Action(ActionName.TIME_SCALE, (1000.0,)))
        robot.write(b"w 2000\n")  # takes 333 s
        assert robot.readline() == b"ok 1\r\n"
        run.server.call(act, Action(ActionName.TIME_SCALE, (1.0,)))
        run.server.call(act, Action(ActionName.RESET))
        robot.timeout = 60.0
        robot.write(b"get\n")
        assert robot.readline()


def test_a_stream_begins_again_at_a_restart(tmp_path: Path) -> None:
    path = tmp_path / "robot"
    stream = f'{DIALECT}[[stream]]\nevery = 0.05\nsend = "s {{tick}}"\n'
    with (
        running(configuration(tmp_path, stream, pty=str(path))) as run,
        serial.Serial(str(path), 115200, timeout=60.0) as robot,
    ):
        assert [robot.readline() for _ in range(2)] == [b"s 0\r\n", b"s 1\r\n"]
        run.server.call(run.server.engine.perform, Action(ActionName.RESET))
        while (line := robot.readline()) != b"s 0\r\n":
            assert line
        assert robot.readline() == b"s 1\r\n"


def test_a_program_that_opens_writes_and_leaves_at_once_has_driven(tmp_path: Path) -> None:
    path = tmp_path / "robot"
    with running(configuration(tmp_path, pty=str(path))) as run:
        with path.open("wb", buffering=0) as robot:
            robot.write(b"w 1\n")
        run.until("the program closed")
        assert ("w 1\n", False) in run.wire
        with serial.Serial(str(path), timeout=TIMEOUT) as second:  # nothing is left of the first one
            second.write(b"get\n")
            assert second.readline().startswith(b"u1: ")


@pytest.mark.parametrize("action", [Action(ActionName.STOP), Action(ActionName.TELEPORT, (30.0, 42.0, 0.0))])
def test_a_run_that_a_person_ends_was_stopped(tmp_path: Path, action: Action) -> None:
    path = tmp_path / "robot"
    rules = (
        '[[command]]\nmatch = "t"\ndo = "run d1 for 600 s"\nreply = "+\\n"\ndone = "ok"\nstopped = "cut\\n"'
    )
    with (
        running(configuration(tmp_path, rules, pty=str(path))) as run,
        serial.Serial(str(path), 115200, timeout=TIMEOUT) as robot,
    ):
        robot.write(b"t\n")
        assert robot.readline() == b"+\n"
        run.server.call(run.server.engine.perform, action)
        assert robot.readline() == b"cut\n"


def test_a_program_that_does_not_read_holds_nobody_up(tmp_path: Path) -> None:
    path = tmp_path / "robot"
    dialect = DIALECT + '[[stream]]\nevery = 0.001\nsend = "{tick:099d}{tick:099d}"\n'
    with running(configuration(tmp_path, dialect, pty=str(path), line="instant")) as run:
        with path.open("r+b", buffering=0) as robot:
            tty.setraw(robot.fileno())
            robot.write(b"get\n")
            assert "does not read" in run.until("replies are lost")
        assert "of replies unread" in run.until("unread")
        run.until("the program closed")


def test_a_second_program_is_hung_up_on_and_the_path_leads_on(tmp_path: Path) -> None:
    path = tmp_path / "robot"
    with running(configuration(tmp_path, pty=str(path))) as run:
        port = run.server.ports["serial"]
        with socket.create_connection(("127.0.0.1", port)) as first:
            opened = json.dumps({"name": "COM6", "baud": 9600}).encode()
            first.sendall(b"O" + len(opened).to_bytes(4, "big") + opened)
            run.until("a program opened COM6")
            with path.open("r+b", buffering=0) as robot:
                assert "it was refused" in run.until("while another one has")
                with suppress(OSError):  # Linux: an end; elsewhere an error
                    assert robot.read(1) == b""
        run.until("the program closed COM6")
        with serial.Serial(str(path), timeout=TIMEOUT) as robot:
            robot.write(b"get\n")
            assert robot.readline().startswith(b"u1: ")


def test_the_path_of_a_killed_run_is_taken_again_and_nothing_else_is_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "robot"
    path.symlink_to("/dev/pts/999999")
    made = configuration(tmp_path, pty=str(path))
    first = Server(made)
    with pytest.raises(PortError, match="it leads to"):
        Server(made)
    first.stop()
    assert not path.is_symlink()
    path.write_text("mine")
    with pytest.raises(PortError, match="File exists"):
        Server(made)
    assert path.read_text() == "mine"


def test_a_set_without_a_dialect_has_no_serial_port(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"--pty.*init --dialect"):
        load(find_set("default"), {"server.pty": Override("--pty", str(tmp_path / "robot"))})


@pytest.mark.parametrize(
    ("command", "why"),
    [
        ("python -I program.py", "Python was started with -I"),
        ("python3.11 -uE program.py", "Python was started with -E"),
        ("/usr/bin/python3 -X dev -S program.py", "Python was started with -S"),
        ("python program.py -I", ""),
        ("python -W Ignore program.py", ""),
        ("./program", ""),
    ],
)
def test_options_that_keep_the_hook_out_are_seen(command: str, why: str) -> None:
    assert out_of_reach(command, windows=False) == why


def test_matlab_on_windows_is_out_of_reach() -> None:
    assert out_of_reach(r"C:\MATLAB\bin\matlab.exe -r robot", windows=True)
    assert not out_of_reach("matlab -r robot", windows=False)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("options", [["-I"], []])
def test_a_program_out_of_reach_is_told_with_what_to_do(tmp_path: Path, options: list[str]) -> None:
    configuration(tmp_path)
    command = f"{sys.executable} {options[0]} -c pass" if options else "/bin/true"
    ports = ("--dialect-port", "0", "--belief-port", "0")
    ended = simmer("--no-ui", "--config", "set", "--run", command, *ports, cwd=tmp_path)
    told = [line for line in ended.stderr.splitlines() if "not connected to the robot's serial port" in line]
    assert not told[0].startswith("verdict: ")
    assert "--pty PATH" in told[0]
    assert sum(line.startswith("verdict: ") for line in told) == 1


def test_a_program_that_does_not_open_the_pseudo_terminal_is_told_its_path(tmp_path: Path) -> None:
    path = tmp_path / "robot"
    with running(configuration(tmp_path, pty=str(path))) as run:
        run.server.call(run.server.engine.tell, ProgramEnded(1.0, 0))
        assert run.until("not connected").endswith(f"Run it as plain Python, or let it open {path}")


@pytest.mark.slow
def test_a_program_that_opens_no_port_though_it_could_is_not_out_of_reach(tmp_path: Path) -> None:
    configuration(tmp_path)
    words = ["--no-ui", "--config", "set", "--dialect-port", "0", "--belief-port", "0"]
    ended = simmer(*words, "--run", f'{sys.executable} -c "pass"', cwd=tmp_path)
    assert "not connected" not in ended.stderr


# -- env ----------------------------------------------------------------------------------------------


def test_the_variables_of_env_lead_a_program_to_a_running_simulator(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("SIMMER_TOKEN", raising=False)
    with running(configuration(tmp_path)) as run:
        port = str(run.server.ports["serial"])
        words = ["env", "--config", str(tmp_path / "set"), "--dialect-port", port, "--form", "json"]
        assert main(words) == 0
        answer = capsys.readouterr()
        assert not answer.err
        program = (
            "import serial\nr = serial.Serial('COM6', timeout=60)\nr.write(b'get\\n')\nprint(r.readline())"
        )
        variables = {**os.environ, **json.loads(answer.out)}
        words = [sys.executable, "-c", program]
        ended = subprocess.run(words, env=variables, capture_output=True, text=True, timeout=300, check=True)
        assert ended.stdout.startswith("b'u1: ")


def test_env_writes_for_each_shell(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    configuration(tmp_path)
    words = ["env", "--config", str(tmp_path / "set"), "--serial-names", "COM6,COM8", "--belief-port", "1"]
    assert main([*words, "--form", "sh"]) == 0
    answer = capsys.readouterr()
    shell = f"{answer.out}\necho $SIMMER_SERIAL_NAMES $SIMMER_DIALECT_PORT"
    ended = subprocess.run(["/bin/sh", "-c", shell], capture_output=True, text=True, timeout=300, check=True)
    assert ended.stdout == "COM6,COM8 9003\n"
    assert main([*words, "--form", "powershell"]) == 0
    assert "$env:SIMMER_SERIAL_NAMES = 'COM6,COM8'" in capsys.readouterr().out
    assert main([*words, "--form", "cmd"]) == 0
    assert 'set "SIMMER_SERIAL_NAMES=COM6,COM8"' in capsys.readouterr().out


def test_env_of_a_set_without_a_dialect_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["env", "--config", "default", "--belief-port", "1"]) == 2
    assert "no dialect.toml" in capsys.readouterr().err


def test_a_taken_serial_port_is_replaced_by_a_free_one(tmp_path: Path) -> None:
    made = configuration(tmp_path)
    usual = replace(made.settings.server, dialect_port=9003)
    made = replace(made, settings=replace(made.settings, server=usual))
    first, second = Server(made), Server(made)
    try:
        assert second.ports["serial"] not in (9003, first.ports["serial"])
        assert any("simmer-tui env --dialect-port" in each for each in second.warnings)
    finally:
        first.stop()
        second.stop()


def test_the_link_of_a_killed_simulator_is_replaced(tmp_path: Path) -> None:
    """The next pseudo-terminal gets the number of the dead one, so that the link seems to lead to it."""
    killed = PtyDevice(str(tmp_path / "COM6"))
    os.close(killed.descriptor)
    assert killed.path.is_symlink()
    device = PtyDevice(str(tmp_path / "COM6"))
    try:
        assert str(device.path.readlink()) == device.name
    finally:
        device.close()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the devices are there before any terminal")
def test_the_link_of_a_killed_simulator_is_replaced_while_another_terminal_has_its_number(
    tmp_path: Path,
) -> None:
    path = tmp_path / "COM6"
    robot, terminal = os.openpty()
    try:
        path.symlink_to(os.ttyname(terminal))
        os.utime(path, ns=(0, 0), follow_symlinks=False)
        device = PtyDevice(str(path))
        assert str(path.readlink()) == device.name
        with pytest.raises(PortError, match="it leads to"):
            PtyDevice(str(path))
        device.close()
    finally:
        os.close(robot)
        os.close(terminal)
