"""pyserial through the hook behaves as pyserial on a pseudo-terminal does, call by call."""

from __future__ import annotations

import json
import os
import socket
import struct
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from simmer_tui.config.loader import find_set, init_set, load
from simmer_tui.config.settings import with_any_ports
from simmer_tui.live.server import Server
from simmer_tui.program.hook import simmer_serial
from simmer_tui.program.program_command import HOOK_FOLDER

pytest.importorskip("serial")
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals")

DIALECT = """
[reply]
end = "\\r\\n"
[[command]]
match = "ten"
reply = "0123456789"
[[command]]
match = "three"
reply = ["one", "two", "three"]
[[command]]
match = "marked"
reply = "a;b;c"
"""
PROGRAM = r"""
import io, json, sys, threading, time
import serial

PORT = sys.argv[1]
results = {}

def note(name, call):
    try:
        value = call()
    except Exception as error:
        value = [type(error).__name__, isinstance(error, serial.SerialException), isinstance(error, OSError)]
    if isinstance(value, (bytes, bytearray, memoryview)):
        value = bytes(value).decode("latin-1")
    elif isinstance(value, (list, tuple)):
        value = [each.decode("latin-1") if isinstance(each, bytes) else each for each in value]
    plain = (str, int, float, bool, list, dict, type(None))
    results[name] = value if isinstance(value, plain) else repr(value)

def ask(text, count):
    robot.reset_input_buffer()
    robot.write(text.encode() + b"\n")
    until = time.monotonic() + 20
    while robot.in_waiting < count and time.monotonic() < until:
        time.sleep(0.001)

def change(name, value):
    setattr(robot, name, value)
    return getattr(robot, name)

robot = serial.Serial(PORT, 115200, timeout=0.05)
note("isinstance", lambda: isinstance(robot, serial.Serial) and isinstance(robot, io.RawIOBase))
note("class name", lambda: type(robot).__name__)
for name in ("is_open", "baudrate", "bytesize", "parity", "stopbits", "timeout", "write_timeout", "xonxoff",
             "rtscts", "dsrdtr", "inter_byte_timeout", "closed", "BAUDRATES", "BYTESIZES", "PARITIES",
             "STOPBITS", "rs485_mode", "break_condition"):
    note(name, lambda: getattr(robot, name))
note("name is port", lambda: robot.name == robot.port == PORT)
note("portstr", lambda: robot.portstr == PORT)
for call in ("readable", "writable", "seekable", "isOpen", "inWaiting", "isatty"):
    note(call + "()", lambda: getattr(robot, call)())
note("tell", lambda: robot.tell())
note("fileno", lambda: isinstance(robot.fileno(), int) and robot.fileno() > 2)
note("set baudrate", lambda: change("baudrate", 57600))
note("set baudrate to text", lambda: change("baudrate", "fast"))
note("set negative baudrate", lambda: change("baudrate", -1))
note("set bytesize", lambda: change("bytesize", 9))
note("set parity", lambda: change("parity", "X"))
note("set stopbits", lambda: change("stopbits", 3))
note("set timeout", lambda: change("timeout", 0.2))
note("set negative timeout", lambda: change("timeout", -1))
note("set timeout to text", lambda: change("timeout", "soon"))
note("set write_timeout", lambda: change("write_timeout", 1))
note("set inter_byte_timeout", lambda: change("inter_byte_timeout", 0.05))
note("unset inter_byte_timeout", lambda: change("inter_byte_timeout", None))
note("set xonxoff", lambda: change("xonxoff", False))
note("get_settings", lambda: robot.get_settings())
note("apply_settings", lambda: robot.apply_settings({"baudrate": 115200, "timeout": 0.05}))
note("read at timeout", lambda: robot.read(3))
note("readline at timeout", lambda: robot.readline())
note("in_waiting, empty", lambda: robot.in_waiting)
note("write", lambda: robot.write(b"nothing\n"))
note("write bytearray", lambda: robot.write(bytearray(b"nothing\n")))
note("write memoryview", lambda: robot.write(memoryview(b"nothing\n")))
note("write list", lambda: robot.write([110, 10]))
note("write text", lambda: robot.write("nothing\n"))
note("write nothing", lambda: robot.write(b""))
note("writelines", lambda: robot.writelines([b"x\n", b"y\n"]))
note("flush", lambda: robot.flush())
note("out_waiting", lambda: robot.out_waiting)
ask("ten", 12)
note("in_waiting, exact", lambda: robot.in_waiting)
note("read(0)", lambda: robot.read(0))
note("read()", lambda: robot.read())
note("read(3)", lambda: robot.read(3))
note("in_waiting after", lambda: robot.in_waiting)
note("read(in_waiting)", lambda: robot.read(robot.in_waiting))
ask("ten", 12)
note("read more than there is", lambda: robot.read(100))
ask("three", 15)
note("readline", lambda: robot.readline())
note("readline(2)", lambda: robot.readline(2))
note("readlines", lambda: robot.readlines())
ask("three", 15)
note("next", lambda: next(robot))
note("for", lambda: [line for line in robot])
ask("marked", 7)
note("read_until", lambda: robot.read_until(b";"))
note("read_until size", lambda: robot.read_until(b";", 1))
note("read_until missing", lambda: robot.read_until(b"#"))
ask("ten", 12)
note("read_all", lambda: robot.read_all())
ask("ten", 12)
note("readall", lambda: robot.readall())
ask("ten", 12)
buffer = bytearray(4)
note("readinto", lambda: [robot.readinto(buffer), bytes(buffer)])
note("reset_input_buffer", lambda: [robot.reset_input_buffer(), robot.in_waiting])
ask("ten", 12)
note("flushInput", lambda: [robot.flushInput(), robot.in_waiting])
note("flushOutput", lambda: robot.flushOutput())
note("reset_output_buffer", lambda: robot.reset_output_buffer())
robot.timeout = 0
note("read without waiting", lambda: robot.read(5))
robot.timeout = None
other = threading.Timer(0.05, robot.cancel_read)
other.start()
note("cancel_read", lambda: robot.read(5))
other.join()
note("cancel_write", lambda: robot.cancel_write())
robot.timeout = 0.05
note("wrapped", lambda: io.TextIOWrapper(io.BufferedReader(robot)).detach().detach() is robot)
note("send_break", lambda: robot.send_break(0.01))
note("open twice", lambda: robot.open())
for name in ("cts", "dsr", "ri", "cd", "dtr", "rts"):
    note("modem " + name, lambda: change(name, True) if name in ("dtr", "rts") else getattr(robot, name))
note("close", lambda: robot.close())
note("close again", lambda: robot.close())
note("is_open, closed", lambda: robot.is_open)
for name, call in (("read", lambda: robot.read()), ("write", lambda: robot.write(b"x")),
                   ("in_waiting", lambda: robot.in_waiting), ("readline", lambda: robot.readline()),
                   ("flush", lambda: robot.flush()),
                   ("reset_input_buffer", lambda: robot.reset_input_buffer()),
                   ("fileno", lambda: robot.fileno()), ("out_waiting", lambda: robot.out_waiting),
                   ("send_break", lambda: robot.send_break())):
    note(name + " when closed", call)
note("set baudrate when closed", lambda: change("baudrate", 9600))
time.sleep(0.1)  # the simulator looks for a program at a pseudo-terminal every 20 ms
note("open", lambda: [robot.open(), robot.is_open, robot.baudrate])
robot.close()
time.sleep(0.1)
def block():
    with serial.Serial(PORT, timeout=0.05) as inner:
        return [inner.is_open, inner.baudrate]
note("with", block)
time.sleep(0.1)
robot = serial.Serial()
note("without a port", lambda: robot.is_open)
note("open without a port", lambda: robot.open())
robot.port = PORT
note("open later", lambda: [robot.open(), robot.is_open])
robot.close()
time.sleep(0.1)
note("serial_for_url", lambda: isinstance(serial.serial_for_url(PORT, timeout=0), serial.Serial))
json.dump(results, sys.stdout)
"""
MODEM = "modem "
"""Beginning of what a pseudo-terminal does not have."""

AS_WINDOWS = ("in_waiting when closed", "out_waiting when closed")
"""Calls that raise pyserial's own error by the hook, as on Windows; elsewhere pyserial raises a TypeError."""


def results_of(tmp_path: Path, *, hook: bool) -> dict[str, Any]:
    """Results of every call: by the hook, or at a pseudo-terminal."""
    folder = tmp_path / "set"
    if not folder.exists():
        init_set(folder, find_set("default"))
        (folder / "dialect.toml").write_text(DIALECT, "utf-8")
    made = load(folder)
    path = tmp_path / "COM6"
    settings = replace(with_any_ports(made.settings).server, pty="" if hook else str(path))
    server = Server(replace(made, settings=replace(made.settings, server=settings)))
    server.start()
    try:
        variables = {**os.environ, **server.environment}
        if hook:
            variables["PYTHONPATH"] = str(HOOK_FOLDER)
        else:
            del variables["SIMMER_DIALECT_PORT"]
        ended = subprocess.run(
            [sys.executable, "-c", PROGRAM, "COM6" if hook else str(path)],
            env=variables,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
    finally:
        server.stop()
    assert ended.returncode == 0, ended.stderr
    results: dict[str, Any] = json.loads(ended.stdout)
    return results


@pytest.mark.slow
def test_every_call_gives_what_it_gives_at_a_pseudo_terminal(tmp_path: Path) -> None:
    at_pty, by_hook = results_of(tmp_path, hook=False), results_of(tmp_path, hook=True)
    assert at_pty.keys() == by_hook.keys()
    compared = [name for name in at_pty if not name.startswith(MODEM) and name not in AS_WINDOWS]
    assert len(compared) >= 34
    assert {name: by_hook[name] for name in compared} == {name: at_pty[name] for name in compared}
    assert all(by_hook[name] == ["PortNotOpenError", True, True] for name in AS_WINDOWS)
    # A pseudo-terminal refuses the modem's lines, a real port has them.
    assert all(by_hook[MODEM + name] in (True, False) for name in ("cts", "dsr", "ri", "cd", "dtr", "rts"))


def test_a_simulator_that_does_not_answer_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        monkeypatch.setenv(simmer_serial.PORT, str(silent.getsockname()[1]))
        monkeypatch.setattr(simmer_serial, "_CONNECTING", 0.05)
        with pytest.raises(OSError, match="the simulator does not answer"):
            simmer_serial.SerialLine("COM6", 9600)


@pytest.mark.parametrize("own", [("serial", "json", "select"), ("serial", "struct", "queue")])
@pytest.mark.quick_cases(1)
def test_a_program_s_own_file_of_a_library_s_name_is_its_own(tmp_path: Path, own: tuple[str, ...]) -> None:
    """The hook steps aside, as if it were not there."""
    # What is built into this Python (select, in Debian's) is never sought in a file.
    own = tuple(name for name in own if name not in sys.builtin_module_names)
    for name in own:
        (tmp_path / f"{name}.py").write_text("def mine():\n    return __name__\n", "utf-8")
    imports = "\n".join(f"import {name}\nprint({name}.mine())" for name in own)
    (tmp_path / "program.py").write_text(imports + "\n", "utf-8")
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        hook = {"PYTHONPATH": str(HOOK_FOLDER), simmer_serial.PORT: str(closed.getsockname()[1])}
        command, env = [sys.executable, "program.py"], os.environ | hook
        done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True, check=False)
    assert (done.stdout.split(), done.stderr) == ([*own], "")


def test_a_port_whose_simulator_has_ended_has_no_waiting_bytes_but_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A program that polls would poll for ever; a real port that is unplugged raises an error, too."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            connection, _ = server.accept()
            with connection:
                connection.sendall(b"A" + struct.pack(">Id", 8, 0.0))
                connection.recv(1000)

        thread = threading.Thread(target=serve)
        thread.start()
        monkeypatch.setenv(simmer_serial.PORT, str(server.getsockname()[1]))
        line = simmer_serial.SerialLine("COM6", 9600)
        thread.join(60)
        with pytest.raises(OSError, match="the simulator has ended"):
            line.wait(60.0)
        with pytest.raises(OSError, match="the simulator has ended"):
            line.waiting()
        line.close()
