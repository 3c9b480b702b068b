"""The package without what Windows does not have: real processes in which an import guard takes it away.

tests/posixless/sitecustomize.py is the guard. What it cannot take is the platform itself: `os.name` and
`sys.platform` stay, since asyncio and pyserial need them.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.windows_stubs import taken_away

if sys.platform == "win32":
    pytest.skip("Windows has no need of it", allow_module_level=True)
from tests.in_process import simmer
from tests.tui.test_seen import Terminal

TESTS = Path(__file__).parent
WANDER = TESTS.parent / "scripts" / "wander.py"
SECONDS = 120.0
Call = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="module")
def surroundings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of a process that has the guard, and a console of code page 1252."""
    folder = tmp_path_factory.mktemp("guard")
    (folder / "taken.json").write_text(json.dumps(taken_away()), "utf-8")
    return {
        "PATH": os.environ["PATH"],
        "HOME": str(folder),
        "TERM": "xterm-256color",
        "PYTHONPATH": os.pathsep.join(map(str, (TESTS / "posixless", TESTS, TESTS.parent))),
        "PYTHONIOENCODING": "cp1252",
        "SIMMER_TEST_TAKEN": str(folder / "taken.json"),
        "XDG_DATA_HOME": str(folder / "data"),
    }


@pytest.fixture(scope="module")
def call(surroundings: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Call:
    """Calls simmer-tui in a folder of its own."""
    home = tmp_path_factory.mktemp("work")

    def called(*words: str, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "simmer_tui", *words],
            cwd=folder or home,
            env=surroundings,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            encoding="cp1252",
            timeout=SECONDS,
            check=False,
        )

    return called


@pytest.fixture(scope="module")
def log(call: Call, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a run with a program."""
    path = tmp_path_factory.mktemp("logs") / "a.jsonl"
    done = call(
        "--no-ui", "--port", "0", "--seed", "7", "--log", str(path), "--run", line(WANDER, "--steps", "2")
    )
    assert done.returncode == 0, done.stderr
    assert "verdict: Ended" in done.stderr
    return path


def line(*words: object) -> str:
    """A command line, as it is written on Windows."""
    return subprocess.list2cmdline([sys.executable, *map(str, words)])


# -- the guard -------------------------------------------------------------------------------------


def test_the_package_alone_is_without_what_windows_does_not_have(surroundings: dict[str, str]) -> None:
    code = """if True:
        import asyncio, fcntl, os, socket, signal, sys, termios, types
        assert hasattr(os, "fork") and hasattr(socket, "AF_UNIX") and sys.platform != "win32"
        ours = types.ModuleType("simmer_tui.made_up")
        lines = ["import fcntl", "import termios, tty", "import pty", "import pwd, grp", "import resource"]
        lines += [f"from os import {name}" for name in "fork geteuid getuid getpgid killpg openpty".split()]
        lines += [f"from signal import {name}" for name in "SIGHUP SIGKILL SIGTSTP pthread_kill".split()]
        lines += ["from socket import AF_UNIX", "from select import poll"]
        for line in lines:
            try:
                exec(line, ours.__dict__)
            except ImportError:
                continue
            raise AssertionError(line)
        for line in ("open('/proc/self/stat')", "os.listdir('/proc')", "pathlib.Path('/proc').stat()"):
            try:
                exec("import os, pathlib; " + line, ours.__dict__)
            except FileNotFoundError:
                continue
            raise AssertionError(line)
        open("/proc/self/stat").close()
        from simmer_tui import platform_has
        assert (platform_has.POSIX, platform_has.LINUX, platform_has.user_id()) == (False, False, None)
    """
    done = subprocess.run([sys.executable, "-c", code], env=surroundings, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


# -- what is to work -------------------------------------------------------------------------------


def test_a_run_with_a_program_is_the_same_as_elsewhere(log: Path) -> None:
    done = simmer("rerun", log)
    assert done.returncode == 0, done.stderr
    assert "every reply the same" in done.stdout


@pytest.mark.slow
def test_a_run_is_made_again(call: Call, log: Path) -> None:
    done = call("rerun", str(log))
    assert done.returncode == 0, done.stderr
    assert "every reply the same" in done.stdout


@pytest.mark.slow
def test_a_client_drives_a_headless_run(surroundings: dict[str, str]) -> None:
    code = """if True:
        import re, subprocess, sys
        from simmer_tui import client
        words = [sys.executable, "-m", "simmer_tui", "--no-ui", "--port", "0", "--seed", "7", "--once"]
        run = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        for line in run.stdout:
            found = found if "Simulator initialized" in line else re.search(r"commands on port (\\d+)", line)
            if "Simulator initialized" in line:
                break
        with client.Robot(port=int(found[1])) as robot:
            robot.send("d1-1")
            print(robot.send("u1"))
        run.stdout.read()
        sys.exit(run.wait())
    """
    done = subprocess.run(
        [sys.executable, "-c", code], env=surroundings, capture_output=True, text=True, timeout=SECONDS
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert 0 < float(done.stdout) < 100


@pytest.mark.slow
def test_a_program_that_is_not_there_is_told_of_in_one_line(call: Call) -> None:
    done = call("--no-ui", "--port", "0", "--run", "no-such-program robot.py")
    assert done.returncode == 127, "as a shell has it, and as elsewhere"
    assert "no-such-program" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_a_program_that_hangs_ends_with_its_trial(call: Call, tmp_path: Path) -> None:
    hangs = tmp_path / "hangs.py"
    hangs.write_text("import time\nwhile True: time.sleep(1)\n", "utf-8")
    done = call(
        *("trials", "--run", line(hangs), "--runs", "2", "--jobs", "2", "--time-limit", "1"),
        *("--out", str(tmp_path / "t")),
    )
    assert "Traceback" not in done.stderr
    rows = [json.loads(each) for each in (tmp_path / "t" / "results.jsonl").read_text("utf-8").splitlines()]
    assert len(rows) == 2


@pytest.mark.slow
def test_trials_run_and_go_on(call: Call, tmp_path: Path) -> None:
    words = ["trials", "--run", line(WANDER, "--steps", "3"), "--out", str(tmp_path / "t"), "--jobs", "2"]
    done = call(*words, "--runs", "2")
    assert "trials.csv" in done.stdout, done.stderr
    assert call(*words, "--runs", "3", "--resume").returncode == done.returncode
    assert len((tmp_path / "t" / "results.jsonl").read_bytes().splitlines()) == 3


@pytest.mark.slow
@pytest.mark.parametrize(
    "words", [(), ("--json",), ("--html", "a.html"), ("--csv", "a.csv"), ("--svg", "a.svg")]
)
def test_a_report_is_made(call: Call, log: Path, words: tuple[str, ...]) -> None:
    done = call("report", *words, str(log))
    assert done.returncode == 0, done.stderr
    assert done.stdout


@pytest.mark.slow
def test_a_log_is_taken_over(call: Call, log: Path) -> None:
    done = call("replay", str(log), "--no-ui", "--take-over", "0.5", "--run", line(WANDER, "--steps", "2"))
    assert done.returncode == 0, done.stderr
    assert "verdict: " in done.stderr


@pytest.mark.slow
def test_sets_are_made_and_checked(call: Call, tmp_path: Path) -> None:
    assert call("init", str(tmp_path / "set")).returncode == 0
    done = call("check", str(tmp_path / "set"))
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("Configuration: ")
    assert call("check", "mission").returncode == 0


@pytest.mark.slow
def test_a_grading_without_a_sandbox_runs(call: Call, tmp_path: Path) -> None:
    (tmp_path / "teams" / "red").mkdir(parents=True)
    (tmp_path / "teams" / "red" / "robot.py").write_bytes(WANDER.read_bytes())
    done = call(
        *("grade", str(tmp_path / "teams"), "--isolation", "none", "--cap", "2", "--jobs", "2"),
        *("--out", str(tmp_path / "g")),
    )
    assert done.returncode == 1, done.stderr
    assert "red" in (tmp_path / "g" / "grades.csv").read_text("utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("command", ["doctor", "ports"])
def test_a_machine_is_looked_at(call: Call, command: str) -> None:
    done = call(command)
    assert "Traceback" not in done.stderr
    assert done.stdout


@contextlib.contextmanager
def screen(options: list[str], surroundings: dict[str, str]) -> Iterator[Terminal]:
    with contextlib.closing(
        Terminal((100, 30), options, {**surroundings, "PYTHONIOENCODING": "utf-8"})
    ) as shown:
        yield shown


@pytest.mark.slow
def test_the_screen_comes_and_obeys(surroundings: dict[str, str]) -> None:
    """Textual has its own driver of this system; the package has nothing of it."""
    with screen(["--port", "0", "--seed", "7"], surroundings) as terminal:
        terminal.until(lambda: terminal.shows("waiting") or terminal.shows("u1"))
        terminal.type("u1")
        terminal.until(lambda: any(re.search(r"u1\D+\d+\.\d", row) for row in terminal.screen.display))


@pytest.mark.slow
def test_a_log_is_replayed_on_the_screen(surroundings: dict[str, str], log: Path) -> None:
    with screen(["replay", str(log)], surroundings) as terminal:
        terminal.until(lambda: terminal.shows("space play"))


# -- what cannot be there --------------------------------------------------------------------------


@pytest.mark.slow
def test_a_sandbox_is_refused_in_one_line_with_the_way_out(call: Call, tmp_path: Path) -> None:
    (tmp_path / "red").mkdir()
    (tmp_path / "red" / "robot.py").write_bytes(b"")
    done = call("grade", str(tmp_path))
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "bubblewrap is for Linux only" in done.stderr
    assert "--isolation none" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["docker", "podman"])
def test_a_container_is_refused_in_one_line(call: Call, tmp_path: Path, engine: str) -> None:
    (tmp_path / "red").mkdir()
    (tmp_path / "red" / "robot.py").write_bytes(b"")
    done = call("grade", str(tmp_path), "--isolation", engine)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)


@pytest.mark.slow
def test_a_pseudo_terminal_is_refused_in_one_line_with_the_way_out(call: Call, tmp_path: Path) -> None:
    assert call("init", str(tmp_path / "set"), "--dialect", "line").returncode == 0
    done = call("--config", str(tmp_path / "set"), "--no-ui", "--port", "0", "--pty", str(tmp_path / "pty"))
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "--run" in done.stderr


# -- a console that has not all characters ----------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["cp1252", "ascii"])
def test_no_character_is_too_much_for_a_console(
    surroundings: dict[str, str], tmp_path: Path, encoding: str
) -> None:
    odd = tmp_path / "räum→"
    log = tmp_path / "l→.jsonl"
    surroundings = {**surroundings, "PYTHONIOENCODING": encoding}

    def called(*words: str) -> str:
        done = subprocess.run(
            [sys.executable, "-m", "simmer_tui", *words],
            env=surroundings,
            cwd=tmp_path,
            capture_output=True,
            timeout=SECONDS,
            check=False,
        )
        assert b"Traceback" not in done.stderr, done.stderr.decode(encoding)
        return (done.stdout + done.stderr).decode(encoding)

    called("init", str(odd))
    assert r"\u2192" in called("check", odd.name)
    assert r"\u2192" in called("check", "no→where")
    run = called(
        "--no-ui",
        "--port",
        "0",
        "--config",
        odd.name,
        "--log",
        log.name,
        "--run",
        line(WANDER, "--steps", "1"),
    )
    assert "Simulator initialized" in run
    assert run.count(r"\u2192") >= 2, run
    assert r"\u2192" in called("report", log.name)
    assert json.loads(called("check", "--json", odd.name))["check"]["name"] == odd.name
    for words in (["--help"], ["trials", "--help"], ["report", "--help"]):
        assert "simmer-tui" in called(*words)
