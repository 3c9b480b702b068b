"""`client.py` copied beside a program, on every Python from 3.8 on that this machine has."""

from __future__ import annotations

import ast
import os
import re
import shutil
import socket
import struct
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from simmer_tui.config.examples import copy_examples, example_files, examples_folder
from tests.in_process import simmer
from tests.listening import listening

CLIENT = Path(__file__).parents[1] / "simmer_tui" / "client.py"
CLIENT_STEPS = ("step1_first_command", "step2_wall_follower", "step3_dead_reckoning", "step3b_keep_going")
GENERIC = {"dict", "frozenset", "list", "set", "tuple", "type"}
NAMES = (*(f"python3.{minor}" for minor in range(8, 15)), "pypy3")

PROGRAM = """
import math, sys
from decimal import Decimal
from fractions import Fraction
import client

host = "127.0.0.1"
port, reply_port, packet_port, packet_reply_port, mute_port = map(int, sys.argv[1:])
with client.Robot(host, port, reply_port) as robot:
    assert robot.read("u1") == 12.345
    for value in (3, 2.5, Decimal("1.25"), Fraction(1, 4)):
        robot.drive("d1", value)
    assert robot.send("r1--45") == math.inf
    try:
        robot.read("q9")
        sys.exit("q9 was read")
    except client.UnknownCodeError:
        pass
    try:
        robot.drive("d1", "3")
        sys.exit("a text was driven")
    except client.InvalidInputError:
        pass
    robot.believe(1, 2, 3, 0.5, [(1, 2), (3, 4, 5)], "here")
    robot.believe(grid=[[0.1, 0.2], [0.3, Fraction(4, 10)]], first=90)
assert robot.closed
with client.Robot(host, packet_port, packet_reply_port, protocol="packets") as robot:
    assert robot.read("u0") == 12.345
for protocol, replies in (("binary", 0), ("packets", mute_port)):
    with client.Robot(host, mute_port, replies, protocol=protocol, timeout=0.05) as robot:
        try:
            robot.read("u1")
            sys.exit("nobody answered")
        except client.RobotTimeoutError:
            pass
print(sys.version_info[:2])
"""


@cache
def interpreters() -> dict[str, str]:
    """Paths of the Pythons there are, by name: on PATH, in pyenv's folder, and Debian's PyPy."""
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv") / "versions"
    found: dict[str, str] = {}
    for name in NAMES:
        version = name.removeprefix("python")
        paths = [shutil.which(name), *map(str, sorted(pyenv.glob(f"{version}.*/bin/{name}")))]
        for path in paths:
            if path and _starts(path):  # pyenv's shims stand for versions that may not be chosen
                found[name] = path
                break
    return found


def _starts(path: str) -> bool:
    program = "import sys; print(sys.version_info >= (3, 8))"
    done = subprocess.run([path, "-c", program], capture_output=True, text=True, check=False)
    return done.stdout.strip() == "True"


@pytest.mark.slow
def test_there_is_more_than_one_python_to_try() -> None:
    """One older than what SimMeR-TUI itself needs: CI installs Debian's pypy3 where there is none."""
    if "CI" not in os.environ and not interpreters().keys() - {f"python3.{n}" for n in range(11, 15)}:
        pytest.skip("no Python from 3.8 to 3.10 here")
    assert interpreters().keys() - {f"python3.{minor}" for minor in range(11, 15)}


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_client_copied_alone_runs(name: str, tmp_path: Path) -> None:
    path = interpreters().get(name)
    if path is None:
        pytest.skip(f"no {name} here")
    received: list[str] = []
    replies: list[bytes] = []

    def take_commands(connection: socket.socket) -> None:
        with connection.makefile("rb") as lines:
            for line in lines:
                received.append(line.decode().strip())
                known = {"u1": 12.345, "q9": float("nan")}
                connection.sendall(struct.pack(">d", known.get(received[-1], float("inf"))))

    def take_request(connection: socket.socket) -> None:
        while connection.recv(1000):
            replies.append(b"[u0:12.345]")

    def give_reply(connection: socket.socket) -> None:
        if replies:
            connection.sendall(replies.pop())

    def say_nothing(connection: socket.socket) -> None:
        while connection.recv(1000):
            pass

    shutil.copy(CLIENT, tmp_path)
    (tmp_path / "program.py").write_text(PROGRAM, encoding="utf-8")
    with (
        listening(take_commands) as port,
        listening(take_request) as packet_port,
        listening(give_reply) as packet_reply_port,
        listening(say_nothing) as mute_port,
    ):
        ports = (port, 0, packet_port, packet_reply_port, mute_port)
        environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        done = subprocess.run(
            [path, "-W", "error", "-B", "program.py", *map(str, ports)],
            cwd=tmp_path,
            env=environment | {"SIMMER_BELIEF_PORT": str(mute_port)},
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
    assert (done.returncode, done.stderr) == (0, "")
    assert re.fullmatch(r"\(3, \d+\)\n", done.stdout)
    assert received == ["u1", "d1-3", "d1-2.5", "d1-1.25", "d1-0.25", "r1--45", "q9"]


ALONE = ("wander.py", *(f"course/{step}.py" for step in CLIENT_STEPS))
"""Samples that need nothing of SimMeR-TUI but client.py."""


@pytest.mark.parametrize("name", ALONE)
def test_a_sample_that_needs_the_client_alone_evaluates_no_type_that_python_3_8_lacks(name: str) -> None:
    """`Move = tuple[str, float]` is evaluated; in an annotation it is not. vermin does not see that."""
    tree = ast.parse((examples_folder() / name).read_text("utf-8"))
    for node in ast.walk(tree):
        for annotated in ("annotation", "returns"):
            vars(node).pop(annotated, None)
    evaluated = [
        ast.unparse(node)
        for node in ast.walk(tree)
        if (isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and node.value.id in GENERIC)
        or (isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitOr))
    ]
    assert not evaluated


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_first_steps_run_beside_the_client_alone(name: str, tmp_path: Path) -> None:
    path = interpreters().get(name)
    if path is None:
        pytest.skip(f"no {name} here")
    copy_examples(tmp_path / "samples")
    for step in CLIENT_STEPS[:2]:  # the later ones need NumPy
        words = ["--no-ui", "--seed", "7", "--port", "0", "--reply-port", "0", "--belief-port", "0"]
        ended = simmer(*words, "--run", f'"{path}" -I samples/course/{step}.py', cwd=tmp_path)
        assert ended.returncode == 0, ended.stderr


@pytest.mark.slow
def test_no_program_that_users_copy_needs_a_python_above_3_8() -> None:
    vermin = shutil.which("vermin", path=str(Path(sys.executable).parent)) or shutil.which("vermin")
    assert vermin, "vermin is not installed; pip install '.[test]' brings it"
    programs = [str(examples_folder() / name) for name in example_files() if name.endswith(".py")]
    assert len(programs) > 10
    files = sorted(path for path in programs if Path(path).exists())
    command = [vermin, "--no-tips", "--violations", "--target=3.8-", str(CLIENT), *files]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
