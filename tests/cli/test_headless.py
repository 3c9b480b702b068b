"""Runs without a screen, as whole processes: what is printed, how they end, with which exit code."""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from simmer_tui.cli.headless import READY, EventLines, LinePrinter
from simmer_tui.cli.log_reports import build_report
from simmer_tui.cli.main import main
from simmer_tui.config.sets import bundled_sets, init_set
from simmer_tui.report.verdict import Outcome
from simmer_tui.run.events import MovementEnded, Notice, NoticeKind, VelocityEnd, VelocityEnded
from simmer_tui.sim import SimulationSpec, Simulator
from tests.in_process import simmer

SECONDS = 120.0
posix = pytest.mark.skipif(sys.platform == "win32", reason="signals and quoting are those of POSIX")


class Run:
    """A `simmer-tui --no-ui` process."""

    def __init__(self, *options: str) -> None:
        arguments = ["--no-ui", *options]
        if not any(option.startswith("--port") for option in options):
            arguments += ["--port", "0"]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "simmer_tui", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            stdin=subprocess.DEVNULL,
            text=True,
            # Without buffers nothing would be left to write at exit.
            env={name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"},
        )
        self.ports: dict[str, int] = {}
        self.head = ""

    def until_ready(self) -> Run:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.head += line
            if line.strip() == READY:
                break
        self.ports = {name: int(number) for name, number in re.findall(r"(\w+) on port (\d+)", self.head)}
        return self

    def client(self) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.ports["commands"]), SECONDS)

    def ask(self, client: socket.socket, text: str) -> float:
        client.sendall(text.encode() + b"\n")
        return float(struct.unpack(">d", client.recv(8))[0])

    def error_line(self) -> str:
        assert self.process.stderr is not None
        return self.process.stderr.readline().rstrip("\n")

    def end(self, number: int | None = None) -> tuple[int, str, str]:
        """Exit code and the rest of both outputs, after a signal if one is given."""
        if number is not None:
            self.process.send_signal(number)
        out, err = self.process.communicate(timeout=SECONDS)
        return self.process.returncode, self.head + out, err


def ended(*options: str) -> tuple[int, str, str]:
    """Exit code and outputs of a run that ends by itself, in this process."""
    ports = () if "--port" in options else ("--port", "0")
    done = simmer("--no-ui", *ports, *options)
    return done.returncode, done.stdout, done.stderr


@pytest.fixture
def run() -> Iterator[Callable[..., Run]]:
    with contextlib.ExitStack() as stack:

        def start(*options: str) -> Run:
            started = Run(*options)
            stack.callback(started.process.wait)
            stack.callback(started.process.kill)
            return stack.enter_context(_closing_pipes(started))

        yield start


@contextlib.contextmanager
def _closing_pipes(started: Run) -> Iterator[Run]:
    yield started
    for stream in (started.process.stdout, started.process.stderr):
        if stream is not None:
            stream.close()


def code_of(*argv: str) -> object:
    """The exit code of a start that fails, in this process."""
    try:
        return main([*argv])
    except SystemExit as end:  # argparse ends a program itself
        return end.code


def python(code: str) -> str:
    return (
        shlex.join([sys.executable, "-c", code])
        if sys.platform != "win32"
        else f'"{sys.executable}" -c "{code}"'
    )


# -- what is printed -------------------------------------------------------------------------


@pytest.mark.slow
def test_the_seed_then_ready_and_both_ports_are_open(run: Callable[..., Run]) -> None:
    started = run("--seed", "7").until_ready()
    lines = started.head.splitlines()
    assert lines[0].startswith("seed 7, configuration default, commands on port ")
    assert lines[1:] == [READY]
    for purpose in ("commands", "replies"):
        socket.create_connection(("127.0.0.1", started.ports[purpose]), SECONDS).close()


@pytest.mark.slow
@posix
def test_a_sets_name_and_a_logs_steer_no_terminal(tmp_path: Path) -> None:
    folder = tmp_path / "set\x1b[2J\x9b31m"
    init_set(folder, bundled_sets()["default"])
    run = Run("--config", str(folder), "--log", str(folder / "run.jsonl")).until_ready()
    _, out, err = run.end(signal.SIGTERM)
    assert "set\\x1b[2J\\x9b31m" in out
    assert not {"\x1b", "\x9b"} & set(out + err)


@pytest.mark.slow
def test_what_happens_is_told_in_short_lines_on_stderr(run: Callable[..., Run]) -> None:
    started = run("--seed", "7", "--no-randbias").until_ready()
    with started.client() as client:
        assert re.fullmatch(r"client 127\.0\.0\.1:\d+ connected", started.error_line())
        started.ask(client, "u1")
        started.ask(client, "w1-100")
        line = started.error_line()
        assert line.startswith("contact: w1-100 was stopped at (")
        started.ask(client, "\x1b[2J[/b]-1")
        assert started.error_line() == (
            r"client: refused '\x1b[2J[/b]-1': no sensor or drive has the code \x1b["
        )
    assert re.fullmatch(r"client 127\.0\.0\.1:\d+ disconnected after 3 commands", started.error_line())


@pytest.mark.slow
def test_quiet_tells_nothing(run: Callable[..., Run]) -> None:
    started = run("--quiet", "--once").until_ready()
    with started.client() as client:
        started.ask(client, "w1-100")
        started.ask(client, "zz")
    code, out, err = started.end()
    assert (code, err) == (0, "")
    assert out.endswith(f"{READY}\n")


@pytest.mark.slow
def test_the_same_seed_gives_the_same_replies_and_without_one_seeds_differ(run: Callable[..., Run]) -> None:
    replies = []
    for _ in range(2):
        started = run("--seed", "12", "--once").until_ready()
        with started.client() as client:
            replies.append([started.ask(client, text) for text in ("u1", "d1-3", "o1", "c1", "g1")])
        assert started.end()[0] == 0
    assert replies[0] == replies[1]
    seeds = {run().until_ready().head.split(",")[0] for _ in range(2)}
    assert len(seeds) == 2


@pytest.mark.slow
def test_only_other_addresses_are_warned_of(run: Callable[..., Run]) -> None:
    started = run("--host", "0.0.0.0").until_ready()
    assert started.error_line().startswith("warning: anyone who reaches 0.0.0.0 can drive the robot")
    alone = run("--once").until_ready()
    with alone.client() as client:
        alone.ask(client, "u1")
    assert "warning" not in alone.end()[2]


# -- starts that fail ------------------------------------------------------------------------


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("option", ["--port", "--reply-port"])
def test_a_port_in_use_is_one_line_and_exit_code_2(option: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        number = taken.getsockname()[1]
        code, out, err = ended(option, str(number))
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    for part in (f"port {number}", "in use on 127.0.0.1", f"{option} N", "0 takes any free one"):
        assert part in err


@pytest.mark.parametrize(
    ("options", "part"),
    [
        (("--host", "no such host"), "no such host"),
        (("--host", "203.0.113.1"), "not an address of this machine"),
        (("--port", "70000"), "65535"),
        (("--port", "x"), "--port"),
        (("--bot-center", "54,42"), "overlaps a wall"),
        (("--config", "nowhere"), "nowhere"),
        (("--prot", "9000"), "--port"),
    ],
)
def test_a_failed_start_is_exactly_one_line(
    capsys: pytest.CaptureFixture[str], options: tuple[str, ...], part: str
) -> None:
    code = code_of("--no-ui", "--port", "0", *options)
    out, err = capsys.readouterr()
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert part in err


def test_every_mistake_of_a_configuration_is_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    code = code_of("--no-ui", "--port", "0", "--num-segments", "0", "--step-time", "-1")
    out, err = capsys.readouterr()
    assert (code, out) == (2, "")
    assert [line.split(":")[0] for line in err.splitlines()] == ["--num-segments", "--step-time"]


# -- ends ------------------------------------------------------------------------------------


def test_once_ends_when_the_client_has_left(run: Callable[..., Run]) -> None:
    started = run("--once").until_ready()
    with started.client() as client:
        started.ask(client, "u1")
    assert started.end()[0] == 0


@pytest.mark.quick_cases(1)
@posix
@pytest.mark.parametrize(
    ("name", "with_client"),
    [
        ("SIGINT", True),
        ("SIGTERM", False),
        *(
            pytest.param(name, with_client, marks=pytest.mark.slow)
            for name, with_client in (
                ("SIGTERM", True),
                ("SIGHUP", True),
                ("SIGINT", False),
                ("SIGHUP", False),
            )
        ),
    ],
)
def test_a_signal_ends_it_cleanly(run: Callable[..., Run], name: str, with_client: bool) -> None:
    started = run().until_ready()
    client = started.client() if with_client else None
    if client is not None:
        started.ask(client, "u1")
    code, _, err = started.end(getattr(signal, name))
    assert code == 0
    assert "Traceback" not in err
    if client is not None:
        assert client.recv(8) == b"", "the client gets an end, not a reset"
        client.close()


@pytest.mark.slow
@posix
def test_a_signal_ends_it_though_peers_flood_and_the_terminal_takes_nothing(run: Callable[..., Run]) -> None:
    started = run().until_ready()
    stuck = started.client()
    stuck.sendall(b"zz\n" * 2000)  # a line each on standard error, which nobody reads
    flooding = threading.Event()

    def flood() -> None:
        address = ("127.0.0.1", started.ports["beliefs"])
        with contextlib.suppress(OSError), socket.create_connection(address, SECONDS) as sock:
            while True:
                sock.sendall(b'{"x":1,"y":2,"heading":3}\n' * 1000)
                flooding.set()

    thread = threading.Thread(target=flood)
    thread.start()
    assert flooding.wait(SECONDS)
    started.process.send_signal(signal.SIGTERM)
    assert started.process.wait(timeout=SECONDS) == 0
    thread.join()
    stuck.close()


@pytest.mark.slow
@posix
def test_after_an_end_by_signal_the_ports_are_free_at_once(run: Callable[..., Run]) -> None:
    started = run().until_ready()
    with started.client() as client:
        started.ask(client, "u1")
        started.end(signal.SIGTERM)
        again = run(f"--port={started.ports['commands']}", f"--reply-port={started.ports['replies']}")
        assert again.until_ready().ports["commands"] == started.ports["commands"]


@pytest.mark.slow
@posix
def test_outputs_that_are_closed_do_not_end_it(run: Callable[..., Run]) -> None:
    started = run().until_ready()
    assert started.process.stdout is not None
    assert started.process.stderr is not None
    started.process.stdout.close()
    started.process.stderr.close()
    for _ in range(3):
        with started.client() as client:
            assert started.ask(client, "zz") != 0.0
            assert started.ask(client, "c1") == 0.0
    started.process.send_signal(signal.SIGTERM)
    assert started.process.wait(SECONDS) == 0


@pytest.mark.slow
@posix
@pytest.mark.parametrize("closed", ["0<&-", "1>&-", "2>&-", "0<&- 1>&- 2>&-"])
def test_standard_streams_closed_at_the_start_are_no_fault(tmp_path: Path, closed: str) -> None:
    """As in a service: neither the simulator nor its program writes into what gets their numbers."""
    asks = (
        "import os, socket; "
        "there, back = (socket.create_connection((os.environ['SIMMER_HOST'], int(os.environ[port]))) "
        "for port in ('SIMMER_PORT', 'SIMMER_REPLY_PORT')); there.sendall(b'u1'); back.recv(64); "
        "[os.fstat(each) for each in range(3)]; os.write(1, b'x'); os.write(2, b'x')"
    )
    log = tmp_path / "run.jsonl"
    command = [sys.executable, "-m", "simmer_tui", "--no-ui", "--port", "0", "--log", str(log)]
    command += ["--run", python(asks)]
    done = subprocess.run(
        ["/bin/sh", "-c", f"{shlex.join(command)} {closed}"],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=SECONDS,
    )
    assert (done.returncode, "Traceback" in done.stderr) == (0, False), done.stderr
    if "1>&-" not in closed:
        assert "verdict" not in done.stdout
    report = subprocess.run(
        ["/bin/sh", "-c", f"{shlex.join([sys.executable, '-m', 'simmer_tui', 'report', str(log)])} {closed}"],
        capture_output=True,
        text=True,
        timeout=SECONDS,
    )
    assert (report.returncode, report.stderr) == (0, "")


# -- a program beside it ---------------------------------------------------------------------


def test_run_passes_the_exit_code_on() -> None:
    asks = (
        "import os, socket, sys; "
        "there, back = (socket.create_connection((os.environ['SIMMER_HOST'], int(os.environ[port]))) "
        "for port in ('SIMMER_PORT', 'SIMMER_REPLY_PORT')); there.sendall(b'u1'); back.recv(64); "
    )
    for wanted in (0, 3):
        assert ended("--run", python(f"{asks}sys.exit({wanted})"))[0] == wanted
    assert ended("--run", python("raise SystemExit(3)"))[0] == 3


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="a child has its parent's connections")
def test_what_happens_after_the_program_has_ended_is_told_too() -> None:
    """Its child keeps the connection open until it is ended as well."""
    code = (
        "import os, socket, time; "
        "c = socket.create_connection((os.environ['SIMMER_HOST'], int(os.environ['SIMMER_PORT']))); "
        "c.sendall(b'u1'); c.recv(8); "
        "os.fork() or time.sleep(1e9)"
    )
    result, _, err = ended("--run", python(code))
    assert (result, "disconnected after 1 command\n" in err) == (0, True), err


def test_run_tells_the_program_where_to_connect() -> None:
    code = (
        "import os, socket, struct; "
        "c = socket.create_connection((os.environ['SIMMER_HOST'], int(os.environ['SIMMER_PORT']))); "
        "r = socket.create_connection((os.environ['SIMMER_HOST'], int(os.environ['SIMMER_REPLY_PORT']))); "
        "c.sendall(b'd1-1'); print(struct.unpack('>d', r.recv(8))[0])"
    )
    result, out, err = ended("--run", python(code))
    assert (result, out) == (0, "inf\n"), err
    assert READY in err, "the program alone has standard output"


@pytest.mark.slow
def test_run_with_once_ends_with_the_program_not_with_its_first_connection() -> None:
    code = (
        "import os, socket, sys; "
        "socket.create_connection((os.environ['SIMMER_HOST'], int(os.environ['SIMMER_PORT']))).close(); "
        "c = socket.create_connection((os.environ['SIMMER_HOST'], int(os.environ['SIMMER_PORT']))); "
        "c.sendall(b'u1'); print(len(c.recv(8))); sys.exit(4)"
    )
    result, out, err = ended("--once", "--run", python(code))
    assert (result, out) == (4, "8\n"), err


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("command", ["no-such-program-anywhere", "''", ""])
@posix
def test_a_program_that_cannot_be_started_has_a_verdict_and_127(tmp_path: Path, command: str) -> None:
    log = tmp_path / "run.jsonl"
    code, out, err = ended("--run", command, "--log", str(log))
    assert (code, out) == (127, "")
    *_, advice, last = err.splitlines()
    assert advice == "  Try: Run the command after --run alone in a terminal."
    assert last.startswith("verdict: The program could not start: --run")
    found = build_report(log).verdict
    assert (found.outcome, last) == (Outcome.CRASHED, f"verdict: {found.text}")


@posix
def test_a_program_that_cannot_be_started_is_one_line_where_no_verdict_is_told() -> None:
    code, out, err = ended("--quiet", "--run", "no-such-program-anywhere")
    assert (code, out) == (127, "")
    name = "no-such-program-anywhere"
    assert err == f"simmer-tui: --run '{name}': there is no program {name}\n"


@pytest.mark.slow
@posix
def test_a_program_ended_by_a_signal_gives_128_and_its_number() -> None:
    code = "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"
    assert ended("--run", python(code))[0] == 128 + signal.SIGKILL


@pytest.mark.slow
@posix
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_signal_ends_the_program_too(run: Callable[..., Run], name: str) -> None:
    started = run("--run", python("import signal; print('up', flush=True); signal.pause()"))
    assert started.process.stdout is not None
    assert started.process.stdout.readline() == "up\n"
    number = getattr(signal, name)
    code, out, err = started.end(number)  # waits for the end of all who have its output
    assert code == 128 + number
    assert out == ""
    assert err.count("Traceback") == 0


@pytest.mark.slow
@posix
def test_a_program_that_does_not_want_to_end_is_ended_by_a_signal_to_the_simulator(
    run: Callable[..., Run],
) -> None:
    code = "import signal; signal.signal(15, signal.SIG_IGN); print('up', flush=True); signal.pause()"
    started = run("--run", python(code))
    assert started.process.stdout is not None
    assert started.process.stdout.readline() == "up\n"
    code, out, _ = started.end(signal.SIGTERM)  # waits for the end of all who have its output
    assert (code, out) == (128 + signal.SIGTERM, "")


@pytest.mark.slow
@posix
@pytest.mark.parametrize(
    "is_interrupted",
    [True, pytest.param(False, marks=pytest.mark.skipif(sys.platform != "linux", reason="no /proc"))],
)
def test_a_signal_ends_it_though_its_first_line_is_never_read(tmp_path: Path, is_interrupted: bool) -> None:
    """Also if the signal does not interrupt the main thread, which it may miss just before it blocks."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with contextlib.suppress(BlockingIOError):
        while os.write(writing, b"x" * 4096):
            pass
    os.set_blocking(writing, True)
    log = tmp_path / "run.jsonl"
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "simmer_tui", "--no-ui", "--port", "0", "--log", str(log), "--quiet"),
            *("--run", python("print('up', flush=True); import time; time.sleep(600)")),
        ],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=writing,
    )
    os.close(writing)
    assert process.stdout is not None
    with process.stdout:
        assert process.stdout.readline() == b"up\n"
        if is_interrupted:
            process.send_signal(signal.SIGTERM)
        else:  # the thread of that number gets it
            os.kill(max(map(int, os.listdir(f"/proc/{process.pid}/task"))), signal.SIGTERM)  # noqa: PTH208
        assert process.wait(SECONDS) == 128 + signal.SIGTERM
        assert process.stdout.read() == b"", "the program has gone too"
    os.close(reading)
    assert log.read_bytes().endswith(b"\n"), "the log is whole"


@pytest.mark.slow
@posix
def test_a_mission_that_a_signal_ends_is_no_success(run: Callable[..., Run]) -> None:
    started = run("--mission").until_ready()
    with started.client() as client:
        started.ask(client, "c1")
        assert started.end(signal.SIGTERM)[0] == 1


@pytest.mark.slow
@posix
def test_a_signal_ends_it_when_standard_error_has_filled_up(run: Callable[..., Run]) -> None:
    started = run().until_ready()
    with started.client() as client:
        client.sendall(b"[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[\n" * 2000)
        left = 2000 * 8
        while left:
            left -= len(client.recv(left))
        assert started.ask(client, "c1") == 0.0, "the robot goes on"
        started.process.send_signal(signal.SIGTERM)
        assert started.process.wait(SECONDS) == 0


@pytest.mark.slow
def test_a_mission_in_which_nothing_was_sent_says_so() -> None:
    code, _, err = ended("--mission", "--run", python("pass"))
    assert code == 1
    assert re.search(r"^mission: failed after 0.0 s, .*: nothing was sent$", err, re.MULTILINE), err
    code, _, err = ended("--mission", "--run", python("raise SystemExit(3)"))
    assert code == 1
    assert "exit code 3" in err, "which says more"


LEAVES_A_CHILD = """
import os, socket
client = socket.create_connection((os.environ["SIMMER_HOST"], int(os.environ["SIMMER_PORT"])))
answers = client.makefile("rb")
def ask(command, times):
    client.sendall(command * times)
    return answers.read(8 * times)
ask(b"[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[\\n", 900)
parent = os.getpid()
if not os.fork():
    try:
        while True:
            os.kill(parent, 0)
    except ProcessLookupError:
        ask(b"c1\\n", 1000)
        ask(b"w1-200\\n", 1)
        answers.read()
"""
"""Standard error has filled up by the time its program ends; only then the robot hits a wall."""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="a child that goes on for its parent")
@pytest.mark.parametrize("end", [None, signal.SIGINT], ids=["by itself", "by a signal"])
def test_a_mission_that_ends_after_its_program_while_nobody_reads_is_told(
    run: Callable[..., Run], tmp_path: Path, end: int | None
) -> None:
    (tmp_path / "program.py").write_text(LEAVES_A_CHILD)
    log = tmp_path / "run.jsonl"
    program = f"{sys.executable} {tmp_path / 'program.py'}"
    started = run("--mission", "--seed", "5", "--log", str(log), "--run", program)
    latest = time.monotonic() + SECONDS
    while not (log.exists() and b'"failed"' in log.read_bytes()):
        assert started.process.poll() is None
        assert time.monotonic() < latest, "the robot never met the wall"
    code, _, err = started.end(end)
    if end is None:
        assert (code, len(re.findall("^mission: failed", err, re.MULTILINE))) == (1, 1), err[-2000:]
    else:
        assert code == 128 + end


def test_a_mission_that_failed_says_why_and_its_log_says_the_same(tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    driver = python("from simmer_tui.client import Robot; robot = Robot(); robot.drive('w1', 200)")
    code, _, err = ended("--mission", "--seed", "5", "--log", str(log), "--run", driver)
    assert code == 1
    told = err.splitlines()[-1]
    read = r"At 0\.0 s, no range sensor had been read yet\."
    sent = rf"{read} At 0\.0 s, w1-200 was sent\. At \d+\.\d s, the robot touched the wall"
    assert re.match(rf"verdict: Failed after .*: {sent}", told), err
    assert "The program sent no belief." in err
    assert "1 command arrived, 0 refused." in err
    assert re.search(r"^  \d+\.\d s: the robot began at", err, re.MULTILINE)
    assert err.count("the robot touched the wall") == 1, "the verdict tells it"
    assert f"verdict: {build_report(log).verdict.text}" == told


# -- parts -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_start_imports_nothing_of_the_screen_and_nothing_that_waits_for_commands() -> None:
    code = """
import sys
from simmer_tui.cli import headless, main
from simmer_tui.config.loader import load
from simmer_tui.config.settings import with_any_ports
from simmer_tui.config.sets import bundled_folder
from simmer_tui.live.server import Server
from msgspec.structs import replace

found = load(bundled_folder())
settings = with_any_ports(found.settings)
server = Server(replace(found, settings=settings))
server.keep_history()
server.stop()
later = {"textual", "rich", "serial", "numpy.random", "hashlib", "secrets", "json"}
parts = ("atlas", "dialect.dialect_rules", "document", "links.belief_parser", "program")
later |= {f"simmer_tui.{name}" for name in parts}
print(sorted(later & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=SECONDS)
    assert (done.stdout, done.stderr) == ("[]\n", "")


def test_only_what_needs_telling_has_a_line(course_spec: SimulationSpec) -> None:
    simulator = Simulator(course_spec)
    assert EventLines().handle(simulator.execute("u1")) == ""
    assert EventLines().handle(simulator.execute("d1-1")) == ""
    assert EventLines().handle(simulator.execute("d1-")) == (
        "client: refused 'd1-': the value is missing, as in d1-3"
    )
    bumped = simulator.execute("d1-100")
    assert bumped.trajectory is not None
    assert EventLines().handle(bumped) == ""
    ended = MovementEnded(4, bumped.time, bumped.command, bumped.trajectory, bumped.pose)
    assert EventLines().handle(ended) == (
        "contact: d1-100 was stopped at (45.0, 42.0) heading 0.0 deg by the wall at (48.0, 42.0)"
    )
    assert EventLines().handle(Notice(NoticeKind.FAULT, "out of paper")) == "out of paper"
    assert EventLines().handle(VelocityEnded(2.0, VelocityEnd.STOP)) == ""
    assert EventLines().handle(VelocityEnded(2.0, VelocityEnd.TIMEOUT)) == (
        "velocity ended: it was not sent again"
    )


def test_a_stopped_terminal_loses_lines_but_says_how_many(capsys: pytest.CaptureFixture[str]) -> None:
    console = LinePrinter(quiet=False)
    for count in range(1500):
        console.watch(Notice(NoticeKind.FAULT, f"line {count}"))
    console.finish(5)
    assert console.show() == 5
    console.watch(Notice(NoticeKind.FAULT, "later"))
    console.finish(6)
    assert console.show() == 6
    lines = capsys.readouterr().err.splitlines()
    assert lines[:1000] == [f"line {count}" for count in range(1000)]
    assert lines[1000:] == ["... 500 lines not shown", "later"]


def test_the_rest_is_what_had_been_told_though_more_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    console = LinePrinter(quiet=False)
    printed = []

    def say(line: str) -> None:
        printed.append(line)
        console.watch(Notice(NoticeKind.FAULT, "more"))

    monkeypatch.setattr("simmer_tui.cli.headless.say", say)
    console.watch(Notice(NoticeKind.FAULT, "first"))
    console.finish(3)
    console.watch(Notice(NoticeKind.FAULT, "second"))
    console.show_rest()
    assert printed == ["first", "second"]


@pytest.mark.slow
def test_a_log_deleted_in_a_short_run_is_told_at_the_end(tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    lines = (
        "import os, socket\n"
        "ports = os.environ['SIMMER_PORT'], os.environ['SIMMER_REPLY_PORT']\n"
        "there, back = (socket.create_connection((os.environ['SIMMER_HOST'], int(port))) for port in ports)\n"
        f"there.sendall(b'u1\\n'); back.recv(64); os.unlink({str(log)!r})\n"
    )
    (tmp_path / "program.py").write_text(lines)
    program = f"{sys.executable} {tmp_path / 'program.py'}"
    code, _, err = ended("--log", str(log), "--run", program)
    assert code == 0, err
    assert "has stopped: the file has been deleted\n" in err


def test_a_program_that_sends_nothing_has_not_succeeded() -> None:
    code, _, err = ended("--run", shlex.join([sys.executable, "-c", ""]))
    assert (code, "simmer-tui: nothing was sent" in err.splitlines()) == (1, True)
    assert err.splitlines()[-1].endswith("The program sent no command at all.")
