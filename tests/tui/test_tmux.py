"""The app as people run it: in tmux and on real ptys, in every environment, and how it ends."""

from __future__ import annotations

import contextlib
import json
import os
import re
import select
import shlex
import shutil
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pyte
import pytest
from msgspec.structs import replace

from simmer_tui.cli.log_reports import build_report
from simmer_tui.config import load_default
from simmer_tui.robot.engine import Engine
from simmer_tui.runlog.rerun import Rerun
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Simulator, parse_command

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="ptys and tmux are those of POSIX")

SECONDS = 120.0
UNKNOWN_TO_PYTE = re.compile(rb"\x1b\[[<>=?][0-9;]*[a-zA-Z]|\x1b\[[0-9;?]*\$p|\x1bP.*?\x1b\\", re.DOTALL)
MAIN = [sys.executable, "-m", "simmer_tui", "--port", "0", "--seed", "5"]


def until(condition: Callable[[], object], seen: Callable[[], str] = str) -> None:
    """Ask again and again until a condition holds."""
    end = time.monotonic() + SECONDS
    while not condition():
        assert time.monotonic() < end, f"it never came; there was {seen()}"
        threading.Event().wait(0.02)


def environment(tmp_path: Path, **changes: str | None) -> dict[str, str]:
    """An environment without what the tests were started with; None takes a variable out."""
    kept = {key: os.environ[key] for key in ("PATH", "HOME", "PYTHONPATH") if key in os.environ}
    base: dict[str, str | None] = {
        **kept,
        "TERM": "xterm-256color",
        "COLORTERM": "truecolor",
        "LC_ALL": "C.UTF-8",
        "XDG_DATA_HOME": str(tmp_path / "data"),
    }
    return {key: value for key, value in (base | changes).items() if value is not None}


class Pane:
    """A tmux server of its own with the app in it."""

    def __init__(self, folder: Path) -> None:
        self._socket = str(folder / "tmux")
        self._folder = folder

    def tmux(self, *arguments: str) -> str:
        command = ["tmux", "-S", self._socket, "-f", os.devnull, *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout

    def start(
        self, *options: str, size: tuple[int, int] = (120, 36), before: str = "", main: Sequence[str] = MAIN
    ) -> None:
        words = ["env", "-i"]
        words += [
            f"{key}={value}" for key, value in environment(self._folder, TERM="screen-256color").items()
        ]
        words += [f"TMUX={self._socket},0,0"]
        command = (
            f"{before}{shlex.join([*words, *main, *options])}; echo EXIT $?; stty -a | grep -o '.icanon'; cat"
        )
        width, height = map(str, size)
        self.tmux("new-session", "-d", "-x", width, "-y", height, command)

    def type(self, *keys: str) -> None:
        self.tmux("send-keys", *keys)

    @property
    def screen(self) -> str:
        return self.tmux("capture-pane", "-p")

    def until(self, *texts: str) -> str:
        until(lambda: all(text in self.screen for text in texts), lambda: f"no {texts} in\n{self.screen}")
        return self.screen

    def client(self) -> socket.socket:
        found = re.search(r"(\d+) commands, \d+ replies", self.until(" commands, "))
        assert found is not None
        return socket.create_connection(("127.0.0.1", int(found[1])), SECONDS)

    def close(self) -> None:
        self.tmux("kill-server")


@pytest.fixture
def pane(tmp_path: Path) -> Iterator[Pane]:
    if shutil.which("tmux") is None:
        pytest.skip("tmux is not installed")
    made = Pane(tmp_path)
    yield made
    made.close()


def ask(client: socket.socket, text: str) -> float:
    client.sendall(text.encode() + b"\n")
    return float(struct.unpack(">d", client.recv(8))[0])


def test_a_whole_session_in_tmux(pane: Pane, tmp_path: Path) -> None:
    pane.start("--no-randbias")
    pane.until("a command such as u1 or d1-3, or :help", "standing", "WAITING for a program")
    pane.type("d1-3", "Enter")
    pane.until("d1-3    forward", "by console", "d1-3 -> done")
    with pane.client() as client:
        assert ask(client, "u1") > 0
        ask(client, "[red]x")
        pane.until("1 reading", "[red]x", "127.0.0.1:")
        pane.type(":telepot", "Enter")
        pane.until('did you mean "teleport"?')
        pane.type("C-u", "Escape")
        pane.until("space stop")
        pane.type("W", "S-Up")
        until(lambda: len(re.findall(r"d1-0\.5 .*by keys", pane.screen)) == 2)
        pane.type("p")
        pane.until("16 readings")
        pane.tmux("resize-window", "-x", "80", "-y", "24")
        pane.until("F2 sensors", "pose ")
        pane.tmux("resize-window", "-x", "30", "-y", "8")
        pane.until("The terminal is too small:")
        pane.tmux("resize-window", "-x", "120", "-y", "36")
        pane.until("range 0–48  ", "16 readings")
    pane.until("disconnected after 2 commands")
    pane.type("C-q")
    ended = pane.until("EXIT 0", " icanon")
    assert "Traceback" not in ended
    assert (tmp_path / "data" / "simmer-tui" / "console-history.txt").read_text() == "d1-3\n:telepot\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("option", "taken"), [pytest.param("--mouse", "1", marks=pytest.mark.slow), ("--no-mouse", "0")]
)
def test_the_mouse_is_left_to_the_terminal_when_asked(pane: Pane, option: str, taken: str) -> None:
    pane.start(option)
    pane.until("standing")
    assert pane.tmux("display", "-p", "#{mouse_any_flag}").strip() == taken


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--num-segments", "0"), "--num-segments: must be a whole number from 1 to 10000"),
        pytest.param(("--port", "TAKEN"), "in use on 127.0.0.1", marks=pytest.mark.slow),
        pytest.param(("--key-poll", "w"), '--key-poll: needs the key "w"', marks=pytest.mark.slow),
        (("--run", "/no/such/program"), "--run '/no/such/program': there is no file /no/such/program"),
    ],
)
def test_a_failed_start_is_one_line_on_a_terminal_as_it_was(
    pane: Pane, options: tuple[str, ...], line: str
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        number = str(taken.getsockname()[1])
        pane.start(*(number if option == "TAKEN" else option for option in options))
        ended = pane.until("EXIT ", "icanon")
    code = 127 if "--run" in options else 2
    shown = ended.split("EXIT")[0].replace("\n", "")
    assert line in shown
    assert f"EXIT {code}\n" in ended
    assert " icanon" not in ended.split("EXIT")[0]
    assert "-icanon" not in ended
    assert "Traceback" not in ended


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["TERM", *(pytest.param(each, marks=pytest.mark.slow) for each in ("HUP", "INT"))]
)
def test_a_signal_ends_it_on_a_restored_terminal_with_a_complete_log(
    pane: Pane, tmp_path: Path, name: str
) -> None:
    pid = tmp_path / "pid"
    pane.start("--log", str(tmp_path / "run.jsonl"), before=f"echo $$ > {pid}; ")
    with pane.client() as client:
        ask(client, "d1-1")
        pane.until("d1-1    forward")
        shell = pid.read_text().strip()
        children = Path(f"/proc/{shell}/task/{shell}/children")
        if not children.exists():
            pytest.skip("this system does not list a process's children")
        os.kill(int(children.read_text().split()[0]), getattr(signal, f"SIG{name}"))
        ended = pane.until("EXIT 0", " icanon")
    assert "Traceback" not in ended
    lines = (tmp_path / "run.jsonl").read_text().splitlines()
    assert any('"d1-1"' in line for line in lines)
    assert lines[-1].endswith("}")


@pytest.mark.slow
def test_a_program_beside_it_prints_into_the_log_and_its_code_is_passed_on(pane: Pane) -> None:
    code = "import time; print('hello [b]there[/b]'); raise SystemExit(5)"
    pane.start("--run", shlex.join([sys.executable, "-c", code]))
    pane.until("hello [b]there[/b]", "the program ended with exit code 5")
    pane.type(":quit", "Enter")
    pane.until("EXIT 5")


@pytest.mark.slow
def test_r_restarts_the_run_with_its_program(pane: Pane, tmp_path: Path) -> None:
    code = (
        "import pathlib; from simmer_tui.client import Robot\n"
        "with Robot() as robot: x = robot.drive('d1', 2)\n"
        f"with pathlib.Path({str(tmp_path / 'runs')!r}).open('a') as file: file.write('run\\n')"
    )
    pane.start("--reply-port", "0", "--run", shlex.join([sys.executable, "-c", code]))
    for number in (1, 2, 3):
        pane.until("R again", "ended with exit code 0")
        assert (tmp_path / "runs").read_text().count("run") == number
        if number < 3:
            pane.type("Escape", "R")
            until(lambda number=number: (tmp_path / "runs").read_text().count("run") == number + 1)
    pane.type("Escape", "C-q")
    pane.until("EXIT 0")


@pytest.mark.slow
def test_a_crash_has_its_verdict_in_panel_and_list_and_asked_for(pane: Pane) -> None:
    code = "from simmer_tui.client import Robot\nrobot = Robot()\nrobot.drive('d1', 1)\n{}['u9']"
    pane.start("--mission", "--run", shlex.join([sys.executable, "-c", code]))
    pane.until("verdict Crashed after", "KeyError: 'u9' in <string>:4.")
    pane.type(":why", "Enter")
    pane.until("Try: Look at <string>:4")
    pane.type(":why move", "Enter")
    pane.until("nothing in its way")


@pytest.mark.slow
def test_a_person_who_quits_is_no_failure_of_the_program(pane: Pane, tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    code = "from simmer_tui.client import Robot\nrobot = Robot()\nwhile True: robot.read('u1')"
    pane.start("--mission", "--log", str(log), "--run", shlex.join([sys.executable, "-c", code]))
    pane.until("u1 -> ")
    pane.type("C-q")
    assert "went wrong" not in pane.until("EXIT ")
    run = build_report(log)
    # A busy machine plays more of the run before the key, and the verdict tells what it shows by then.
    verdict = run.verdict.text
    assert re.match(r"Ended after [0-9.]+ s(:|, when) the program was stopped", verdict)


@pytest.mark.slow
def test_with_once_it_ends_with_the_program_or_the_client(pane: Pane, tmp_path: Path) -> None:
    pane.start("--once", "--run", shlex.join([sys.executable, "-c", "raise SystemExit(3)"]))
    assert "show what went wrong" in pane.until("EXIT 3")
    pane.close()
    other = Pane(tmp_path / "other")
    (tmp_path / "other").mkdir()
    try:
        other.start("--once")
        with other.client() as client:
            assert ask(client, "c1") is not None
        other.until("EXIT 0")
    finally:
        other.close()


@pytest.mark.slow
def test_a_fault_of_the_screen_leaves_the_robot_served(pane: Pane, tmp_path: Path) -> None:
    breaking = tmp_path / "breaking.py"
    breaking.write_text(
        "import sys\n"
        "from simmer_tui.cli.main import main\n"
        "from simmer_tui.tui.log_panel import LogPanel\n"
        "def fail(self, y):\n    raise RuntimeError('cannot render')\n"
        "LogPanel.on_resize = lambda self: None\n"
        "add = LogPanel.add\n"
        "def break_later(self, entries, **given):\n"
        "    add(self, entries, **given)\n"
        "    if entries: LogPanel.render_line = fail; self.refresh()\n"
        "LogPanel.add = break_later\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    words = [f"{key}={value}" for key, value in environment(tmp_path, TERM="screen-256color").items()]
    command = shlex.join(["env", "-i", *words, sys.executable, str(breaking), "--port", "0", "--seed", "5"])
    pane.tmux("new-session", "-d", "-x", "120", "-y", "36", f"{command}; echo EXIT $?; cat")
    with pane.client() as client:
        assert ask(client, "c1") is not None
        failed = pane.until("the screen has failed: RuntimeError: cannot render (breaking.py:5)")
        assert "Traceback" not in failed
        ask(client, "zz")
        pane.until("client: refused 'zz'")
        pane.type("C-c")
        pane.until("EXIT 0")


# -- lines typed ahead ---------------------------------------------------------------------

BURST = ("o1", "o2", "o3", "zz", "d1-1", "u2")


class Typed:
    """The commands of the console in a run log that is being written, in order."""

    def __init__(self, log: Path) -> None:
        self._log = log
        self._place = 0
        self._numbered: dict[str, str] = {}  # a movement has two lines of one number

    @property
    def commands(self) -> list[str]:
        with self._log.open(encoding="utf-8") as file:
            file.seek(self._place)
            text = file.read()
        whole = text[: text.rfind("\n") + 1]
        self._place += len(whole)
        for number, command in re.findall(r'"n":(\d+),"cmd":"([^"]*)","source":"console"', whole):
            self._numbered[number] = command
        return [*self._numbered.values()]

    def until(self, *commands: str) -> None:
        """Wait until these have been given, and no others."""
        until(lambda: len(self.commands) >= len(commands), lambda: str(self.commands[-20:]))
        assert self.commands == [*commands]


def ended_movements(log: Path, command: str) -> int:
    """The number of movements of a command that have a line of their end in a run log."""
    records = (json.loads(line) for line in log.read_text("utf-8").splitlines())
    return sum(each["kind"] == "end" and each["cmd"] == command for each in records)


@contextlib.contextmanager
def at_full_speed(port: int) -> Iterator[Callable[[], int]]:
    """A program that asks as fast as it is answered; gives how many answers it has had."""
    done = threading.Event()
    answers = [0]

    def ask_on() -> None:
        with socket.create_connection(("127.0.0.1", port), SECONDS) as client:
            while not done.is_set():
                ask(client, "i1")
                answers[0] += 1

    program = threading.Thread(target=ask_on)
    program.start()
    try:
        yield lambda: answers[0]
    finally:
        done.set()
        program.join()


@pytest.mark.parametrize("times", [5, pytest.param(50, marks=pytest.mark.slow)])
@pytest.mark.parametrize("busy", [pytest.param(False, marks=pytest.mark.slow), True])
def test_lines_sent_at_once_are_all_carried_out_whole_and_in_order(
    pane: Pane, tmp_path: Path, times: int, busy: bool
) -> None:
    log = tmp_path / "run.jsonl"
    pane.start("--log", str(log))
    found = re.search(r"(\d+) commands, \d+ replies", pane.until(" commands, "))
    assert found is not None
    keys = [word for line in BURST for word in (line, "Enter")]
    with at_full_speed(int(found[1])) if busy else contextlib.nullcontext(lambda: 0) as answers:
        until(lambda: answers() > 100 or not busy)
        typed = Typed(log)
        for burst in range(1, times + 1):
            pane.type(*keys)
            typed.until(*(BURST * burst))
        pane.type("u1", "Enter")
        typed.until(*(BURST * times), "u1")


@pytest.mark.slow
def test_several_lines_pasted_at_once_are_all_carried_out(pane: Pane, tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    pane.start("--log", str(log))
    pane.until("standing", "a command such as")
    pane.tmux("set-buffer", "".join(f"{line}\n" for line in BURST) + "d1-")
    for _ in range(3):
        pane.tmux("paste-buffer", "-p")  # -p: bracketed, as a terminal's own paste is
        pane.type("2", "Enter")
    Typed(log).until(*[*BURST, "d1-2"] * 3)


@pytest.mark.slow
def test_from_the_maze_a_colon_and_an_order_at_once_drive_nothing(pane: Pane, tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    pane.start("--log", str(log))
    pane.until("standing", "a command such as")
    pane.type("Escape")
    pane.until("read all")
    pane.type(":teleport 9 9 90", "Enter", "u1", "Enter")
    Typed(log).until("u1")
    assert "teleport" in log.read_text()
    assert '"source":"keys"' not in log.read_text()


@pytest.mark.slow
def test_without_colour_the_cursor_is_to_be_seen(pane: Pane) -> None:
    pane.start("--color", "none")
    pane.until("standing", "a command such as")
    pane.type("u1")
    until(lambda: re.search(r"u1\x1b\[7m ", pane.tmux("capture-pane", "-p", "-e")))


@pytest.mark.slow
def test_text_copied_arrives_in_tmux_where_it_is_allowed(pane: Pane) -> None:
    pane.start()
    pane.until("standing", "a command such as")
    pane.tmux("set", "-s", "set-clipboard", "on")
    pane.type("u1", "Enter")
    pane.until("by console")
    pane.type(":copy", "Enter")
    pane.until("sent to the terminal's clipboard; tmux: set-clipboard on")
    until(lambda: "by console" in pane.tmux("show-buffer"))


# -- real ptys -----------------------------------------------------------------------------


class Terminal:
    """The app on a pty, read by a thread until that is stopped."""

    def __init__(
        self, tmp_path: Path, *options: str, rows: int = 36, columns: int = 120, **changes: str | None
    ):
        import fcntl
        import termios

        self.master, slave = os.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        self.process = subprocess.Popen(
            [*(MAIN[:3] if "replay" in options else MAIN), *options],
            stdin=slave,
            stdout=slave,
            stderr=slave,
            start_new_session=True,
            env=environment(tmp_path, **changes),
        )
        os.close(slave)
        self.seen = bytearray()
        self.screen = pyte.Screen(columns, rows)
        self._stream = pyte.ByteStream(self.screen)
        self._shown = 0
        self._reading = threading.Event()
        self._reading.set()
        self._closing = False
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        while not self._closing:
            self._reading.wait(0.05)
            if self._reading.is_set() and select.select([self.master], [], [], 0.05)[0]:
                try:
                    data = os.read(self.master, 65536)
                except OSError:
                    return
                if not data:
                    return
                self.seen += data

    def stop_reading(self) -> None:
        self._reading.clear()

    def read_on(self) -> None:
        self._reading.set()

    def hang_up(self) -> None:
        """Take the terminal away."""
        self._closing = True
        self._thread.join()
        os.close(self.master)

    @property
    def text(self) -> str:
        """Text that was written, without the control sequences."""
        return re.sub(r"\x1b\[[0-9;?<>=$]*[ -/]*[@-~]", "", self.seen.decode("utf-8", "replace"))

    def until(self, text: str) -> None:
        """Wait until a text is written, or stands on the screen: what stood there is not sent again."""
        until(
            lambda: text in self.text or any(text in row for row in self.rows()),
            lambda: f"no {text} in {self.text[-2000:]!r}",
        )

    def rows(self) -> list[str]:
        """Rows that the terminal shows."""
        fresh = bytes(self.seen[self._shown :])
        # A sequence may have come in part only.
        begun = fresh.rfind(b"\x1b")
        fresh = fresh[: begun if begun >= 0 and len(fresh) - begun < 32 else len(fresh)]
        self._shown += len(fresh)
        self._stream.feed(UNKNOWN_TO_PYTE.sub(b"", fresh))
        return self.screen.display

    def port(self) -> int:
        self.until(" commands, ")
        found = re.search(r"(\d+) commands, \d+ repl", self.text)
        assert found is not None
        return int(found[1])

    def close(self) -> None:
        self._closing = True
        self._thread.join()
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        with contextlib.suppress(OSError):
            os.close(self.master)


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Callable[..., Terminal]]:
    with contextlib.ExitStack() as stack:

        def start(*options: str, **changes: str | None) -> Terminal:
            made = Terminal(tmp_path, *options, **changes)  # type: ignore[arg-type]  # rows, columns
            stack.callback(made.close)
            return made

        yield start


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "has", "has_not"),
    [
        ({}, ("48;2;25;30;37", "48;5;158", "▐"), ()),
        pytest.param({"COLORTERM": None}, ("48;5;", "▐"), ("48;2;",), marks=pytest.mark.slow),
        pytest.param(
            {"TERM": "linux", "COLORTERM": None}, ("\x1b[",), ("48;2;", "48;5;", "▐"), marks=pytest.mark.slow
        ),
        ({"NO_COLOR": "1"}, ("####",), ("48;2;", "48;5;", "▐", ";41m")),
        pytest.param({"TERM": "dumb"}, ("####",), ("48;2;", "48;5;", "▐"), marks=pytest.mark.slow),
        pytest.param({"LC_ALL": None, "LANG": "C"}, ("####",), ("▐", "╭"), marks=pytest.mark.slow),
        ({"LC_ALL": "C"}, ("####",), ("▐", "╭")),
        pytest.param(
            {"PYTHONUTF8": "0", "LC_ALL": "POSIX", "PYTHONCOERCECLOCALE": "0"},
            ("####",),
            ("▐", "╭"),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_every_environment_starts_draws_and_ends(
    terminal: Callable[..., Terminal],
    changes: dict[str, str | None],
    has: tuple[str, ...],
    has_not: tuple[str, ...],
) -> None:
    app = terminal(**changes)
    app.until("standing")
    app.until(":help")
    os.write(app.master, b"\x1b")
    app.until("space")
    os.write(app.master, b"\x11")
    until(lambda: app.process.poll() is not None)
    assert app.process.returncode == 0
    written = app.seen.decode("utf-8", "replace")
    assert "Traceback" not in written
    for text in has:
        assert text in written
    for text in has_not:
        assert text not in written


@pytest.mark.slow
@pytest.mark.parametrize(
    "missing",
    [pytest.param("stdin", marks=pytest.mark.slow), "stdout", pytest.param("stderr", marks=pytest.mark.slow)],
)
def test_without_a_terminal_it_says_so_in_one_line(missing: str, tmp_path: Path) -> None:
    master, slave = os.openpty()
    try:
        streams: dict[str, int] = dict.fromkeys(("stdin", "stdout", "stderr"), slave)
        streams[missing] = subprocess.DEVNULL if missing == "stdin" else subprocess.PIPE
        with subprocess.Popen(MAIN, env=environment(tmp_path), **streams) as process:  # type: ignore[call-overload]
            written = process.communicate(timeout=SECONDS)[1]
        if missing != "stderr":
            written = os.read(master, 4096)
        assert process.returncode == 2
        expected = "simmer-tui: there is no terminal to draw on; add --no-ui to run without the screen"
        assert " ".join(written.decode().split()) == expected
    finally:
        os.close(master)
        os.close(slave)


@pytest.mark.slow
def test_a_lost_connection_ends_it_and_the_log_is_complete(
    terminal: Callable[..., Terminal], tmp_path: Path
) -> None:
    log = tmp_path / "run.jsonl"
    app = terminal("--log", str(log))
    with socket.create_connection(("127.0.0.1", app.port()), SECONDS) as client:
        for _ in range(20):
            ask(client, "d1-0.1")
        app.stop_reading()
        os.kill(app.process.pid, signal.SIGHUP)
        os.close(app.master)
        until(lambda: app.process.poll() is not None)
    assert app.process.returncode == 0
    assert ended_movements(log, "d1-0.1") == 20


@pytest.mark.slow
def test_a_terminal_that_stops_reading_holds_nothing_up_and_then_shows_all(
    terminal: Callable[..., Terminal],
) -> None:
    app = terminal("--fps", "20", "--pace", "off")
    with socket.create_connection(("127.0.0.1", app.port()), SECONDS) as client:
        app.stop_reading()
        for _ in range(400):
            for angle in (30, -30):
                ask(client, f"r1-{angle}")
            ask(client, "u1")
        before = len(app.seen)
        app.read_on()
        app.until("commands 1,200 ")
        assert len(app.seen) - before < 2_000_000
        ask(client, "d1-1")
        app.until("commands 1,201 ")
        os.write(app.master, b"\x11")
        until(lambda: app.process.poll() is not None)
    assert app.process.returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize("replayed", [False, True])
def test_a_terminal_that_goes_away_without_a_signal_ends_it(
    terminal: Callable[..., Terminal], tmp_path: Path, replayed: bool
) -> None:
    """Nobody is sent SIGHUP where the terminal is not the session's own."""
    if replayed:
        log = tmp_path / "run.jsonl"
        subprocess.run(
            [*MAIN, "--no-ui", "--log", str(log), "--run", "true"], check=False, capture_output=True
        )
        app = terminal("replay", str(log))
        app.until("odometer")
    else:
        app = terminal()
        app.port()
    app.hang_up()
    assert app.process.wait(SECONDS) in (0, -signal.SIGTERM)


@pytest.mark.slow
def test_a_signal_ends_it_even_if_the_terminal_never_reads_again(
    terminal: Callable[..., Terminal], tmp_path: Path
) -> None:
    log = tmp_path / "run.jsonl"
    app = terminal("--fps", "20", "--pace", "off", "--log", str(log))
    with socket.create_connection(("127.0.0.1", app.port()), SECONDS) as client:
        app.stop_reading()
        for _ in range(1000):
            ask(client, "u1")
            ask(client, "r1-7")
        os.kill(app.process.pid, signal.SIGTERM)
        until(lambda: app.process.poll() is not None)
    assert app.process.returncode == 0
    assert ended_movements(log, "r1-7") == 1000


@pytest.mark.slow
def test_a_replay_is_taken_over_and_driven_on(pane: Pane, tmp_path: Path) -> None:
    log = tmp_path / "first.jsonl"
    configuration = load_default()
    server = replace(configuration.settings.server, port=0)
    configuration = replace(configuration, settings=replace(configuration.settings, server=server))
    simulator = Simulator(configuration.simulation, 5)
    engine = Engine(simulator)
    with RunLog(log, configuration, simulator) as written:
        engine.watch(written)
        session = engine.session()
        for text in ("u1", "d1-6", "r1-90", "u1"):
            session.submit(parse_command(text), lambda outcome: None)
    pane.start(str(log), main=[sys.executable, "-m", "simmer_tui", "replay"])
    pane.until("take over")
    pane.type("g")
    pane.until("a time: 95")
    pane.type("0.5", "Enter")
    pane.until("00:00.5 /")
    pane.type("t")
    pane.until("from first.jsonl at 0.50 s", "no program", "d1-6", "stopped by the take-over")
    with pane.client() as client:
        assert ask(client, "u1") > 0
        pane.until("1 reading")
    pane.type("d1-1", "Enter")
    pane.until("d1-1 -> done")
    pane.type("C-q")
    pane.until("EXIT 0")
    [kept] = (tmp_path / "data" / "simmer-tui" / "runs").glob("*.jsonl")
    with Rerun(kept) as rerun:
        assert rerun.header.taken_over is not None
        for _ in rerun.steps():
            pass
        assert (rerun.difference, rerun.commands) == (None, 4)
