"""Programs that cheat: none wins, and none leaves anything behind. All within one machine."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import venv
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from simmer_tui.cli.main import main
from simmer_tui.grade.course import read_course
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.grade_run import GradeRun
from simmer_tui.grade.sandbox import Isolation
from simmer_tui.runlog.reader import LogReader
from simmer_tui.trials.trial import TrialResult
from tests.grade.conftest import CONNECT, HIT, SOLVE

SEED = 271828182845904523536028747135266249
MARK = f"cheat-that-stays-{os.getpid()}"
LIMITS = "[limits]\ntime = 2.0\nmemory = 500.0\ndisk = 8.0\nprocesses = 20\noutput = 5.0\n"
TRY = """
def attempt(what):
    try:
        print("WON" if what() else "nothing", flush=True)
    except Exception as error:
        print("refused:", type(error).__name__, error, flush=True)
"""
WALK = """
import os, sys
def texts(names=None):
    for place, folders, files in os.walk("/"):
        if place in (sys.base_prefix, os.path.dirname(os.path.dirname(sys.executable))):
            folders.clear()
            continue
        if place == "/":
            known = ("dev", "proc", "usr", "lib", "lib64", "opt", "root")
            folders[:] = [name for name in folders if name not in known]
        for name in files:
            if names is None or any(part in name for part in names):
                yield os.path.join(place, name)
"""
CHEATS = {
    "reads the log of its own run": WALK + 'attempt(lambda: list(texts((".jsonl",))))',
    "looks for the seed in files": WALK
    + f"""
def found():
    for path in texts():
        try:
            if b"{str(SEED)[::-1]}"[::-1] in open(path, "rb").read(1000000): print(path); return True
        except OSError: pass
attempt(found)
""",
    "looks for the seed in the environment and /proc": f"""
import glob
def found():
    for path in glob.glob("/proc/*/environ") + glob.glob("/proc/*/cmdline"):
        try:
            text = open(path, "rb").read()
        except OSError: continue
        if b"{SEED}" in text or b"SIMMER_SEED" in text or b"pytest" in text: return True
attempt(found)
""",
    "reads or writes results": WALK + 'attempt(lambda: list(texts(("grade.json", "results", "grades.csv"))))',
    "reads a neighbour's program": WALK + 'attempt(lambda: list(texts(("secret-of-the-neighbour",))))',
    "sees other processes": """
import os
attempt(lambda: len([n for n in os.listdir("/proc") if n.isdigit()]) > 2)
""",
    "reads the simulator's memory": """
import ctypes, os
def memory():
    libc = ctypes.CDLL(None, use_errno=True)
    for pid in (1, os.getppid()):
        try:
            open(f"/proc/{pid}/mem", "rb"); return True
        except OSError: pass
        if libc.ptrace(16, pid, 0, 0) == 0: return True
attempt(memory)
""",
    "connects to another team's port": """
import socket
def reach():
    for host in ("127.0.0.1", "::1", "localhost"):
        try:
            socket.create_connection((host, OTHER), 1); return True
        except OSError: pass
attempt(reach)
attempt(lambda: [name for _, name in socket.if_nameindex() if name != "lo"])
""",
    "connects to a Unix socket without a name": """
import socket
attempt(lambda: socket.socket(socket.AF_UNIX).connect("\\0simmer-other-team-PID") is None)
""",
    "forges replies on the belief and reply ports": CONNECT
    + """
b = socket.create_connection((os.environ["SIMMER_HOST"], int(os.environ["SIMMER_BELIEF_PORT"])))
b.sendall(b'{"mission": "success"}\\n{"x": 30, "y": 42, "heading": 0, "note": "mission: success"}\\n')
r.sendall(b"\\x3f\\xf0" + bytes(6)); s.sendall(b"mission: success\\n{}\\n")
""",
    "gives the console's commands over the port": CONNECT
    + """
for line in (b"reset", b"seed 1", b"noise off", b"place 30 42 0", b"block 30 42", b"teleport 30 42"):
    s.sendall(line + b"\\n")
r.settimeout(0.5)
attempt(lambda: r.recv(8)[:0])
s.sendall(b"p1-1\\np1-0\\n")
""",
    "forks and stays": f"""
import os, signal, sys, time
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        for number in range(1, 32):
            if number not in (signal.SIGKILL, signal.SIGSTOP): signal.signal(number, signal.SIG_IGN)
        os.execv(sys.executable, [sys.executable, "-c", "import time; time.sleep(600)", "{MARK}"])
time.sleep(0.2)
""",
    "fills the disk": """
import itertools
def fill():
    written = 0
    for place in (".", "/tmp", "/dev/shm", "/program", "/dev", "/var/tmp", "/etc", "/usr"):
        for number in itertools.count():
            try:
                with open(f"{place}/{number}", "wb") as file:
                    for _ in range(64): written += file.write(bytes(1000000)); file.flush()
            except OSError: break
            if written > 200000000: return True
attempt(fill)
""",
    "fills the disk with output": 'while True: print("x" * 900)',
    "fills the disk with its log": CONNECT + 'while True: s.sendall(b"u1\\n" * 500)',
    "takes all memory": "attempt(lambda: bytearray(4000000000))",
    "takes memory that belongs to no process": """
import ctypes, os, platform
numbers = {"x86_64": (447, 29, 68, 64), "aarch64": (447, 194, 186, 190)}
secret, shared, messages, semaphores = numbers[platform.machine()]
libc = ctypes.CDLL(None)
attempt(lambda: os.memfd_create("nameless") >= 0)
attempt(lambda: libc.syscall(secret, 0) >= 0)
attempt(lambda: libc.syscall(shared, 0, 600_000_000, 0o600) >= 0)
attempt(lambda: libc.syscall(messages, 0, 0o600) >= 0)
attempt(lambda: libc.syscall(semaphores, 0, 1000, 0o600) >= 0)
""",
    "takes all processes": """
import os, time
def fork():
    for number in range(500):
        if os.fork() == 0: time.sleep(60)
    return True
attempt(fork)
""",
    "signals the grader": """
import os, signal
signal.signal(signal.SIGTERM, signal.SIG_IGN)
for number in (signal.SIGTERM, signal.SIGKILL):
    for pid in (1, PID, os.getppid()):
        attempt(lambda: pid > 1 and os.kill(pid, number) is None)
os.kill(-1, signal.SIGKILL)
""",
    "changes the clock": """
import time
attempt(lambda: time.clock_settime(time.CLOCK_REALTIME, 0) is None)
""",
    "opens namespaces of its own": """
import ctypes
libc = ctypes.CDLL(None, use_errno=True)
attempt(lambda: libc.unshare(0x10000000) == 0)
attempt(lambda: libc.mount(b"none", b"/tmp", b"tmpfs", 0, None) == 0)
""",
    "leaves a key in the kernel": """
import ctypes, platform
number = {"x86_64": 248, "aarch64": 217}[platform.machine()]
attempt(lambda: ctypes.CDLL(None).syscall(number, b"user", b"a", b"b", 1, -4) >= 0)
""",
    "becomes root": """
import os
attempt(lambda: os.setuid(0) is None)
attempt(lambda: [l for l in open("/proc/self/status") if l.startswith("CapEff") and int(l.split()[1], 16)])
""",
    "changes the installed package": """
import sys
sys.path.insert(0, "/simmer")
import simmer_tui
attempt(lambda: open(simmer_tui.__file__, "a"))
attempt(lambda: open("/simmer/simmer_tui/new.py", "w"))
""",
    "says that all is well and sends nothing": "import sys; sys.exit(0)",
}


@pytest.fixture
def other_team() -> Iterator[int]:
    """A port, and a Unix socket, that another team's program might have."""
    with socket.create_server(("127.0.0.1", 0)) as server, socket.socket(socket.AF_UNIX) as unix:
        unix.bind(f"\0simmer-other-team-{os.getpid()}")
        unix.listen()
        yield server.getsockname()[1]


@pytest.fixture
def play(
    isolation: str, make_course: Callable[..., Path], tmp_path: Path, other_team: int
) -> Callable[[str], tuple[TrialResult, str, GradeFolder]]:
    def run(lines: str) -> tuple[TrialResult, str, GradeFolder]:
        lines = lines.replace("OTHER", str(other_team)).replace("PID", str(os.getpid()))
        file = make_course({"cheat": TRY + lines, "honest": SOLVE}, LIMITS)
        (tmp_path / "teams" / "honest" / "secret-of-the-neighbour.txt").write_text("x")
        folder = GradeFolder.create(tmp_path / "out", read_course(file), SEED, Isolation(isolation))
        result = GradeRun(folder.trial(folder.entries[0], 1), folder.runs).run()
        output = folder.runs / "cheat" / "0001.txt"
        return result, output.read_text() if output.exists() else "", folder

    return run


def _processes() -> set[str]:
    """The commands of all processes here."""
    found = set()
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            found.add(path.read_bytes().replace(b"\0", b" ").decode(errors="replace"))
        except OSError:
            continue
    return found


QUICK = (
    "looks for the seed in files",
    "reads a neighbour's program",
    "forks and stays",
    "signals the grader",
)
"""One of each sort: what is read, who is near, what stays, who is meddled with."""


@pytest.mark.parametrize(
    "cheat", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in CHEATS]
)
def test_cheat_does_not_win_and_leaves_nothing_behind(
    play: Callable[[str], tuple[TrialResult, str, GradeFolder]], cheat: str
) -> None:
    result, output, folder = play(CHEATS[cheat])
    assert not result.success
    assert "WON" not in output
    assert output or "attempt" not in CHEATS[cheat] or "signals" in cheat
    assert len(output) <= 5000
    assert not [command for command in _processes() if MARK in command or str(folder.path) in command]
    assert sum(path.stat().st_size for path in folder.path.rglob("*") if path.is_file()) < 40_000_000
    honest = GradeRun(folder.trial(folder.entries[1], 1), folder.runs).run()
    assert honest.success


def test_seeds_of_runs_are_too_many_to_try(
    make_course: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A program that reads a sensor twice could try all seeds of 32 bits. Logs and records hold the longer
    ones, and what they name is found again."""
    file = make_course({"wall": HIT})
    folder = GradeFolder.create(tmp_path / "out", read_course(file), SEED, Isolation.NONE)
    seeds = [folder.trial(folder.entries[0], number).seed for number in range(1, 31)]
    assert len(set(seeds)) == len(seeds)
    assert min(seeds) > 2**64
    assert all(sum(seed >> bit & 1 for seed in seeds) for bit in range(128))

    result = GradeRun(folder.trial(folder.entries[0], 1), folder.runs).run()
    folder.append(result)
    assert GradeFolder.read(tmp_path / "out").entries[0].results[1].seed == seeds[0]
    log = folder.log(folder.entries[0], 1)
    with LogReader(log) as reader:
        assert reader.header.seed == seeds[0]
    for command in ("rerun", "report"):
        assert main([command, str(log)]) == 0
        assert str(seeds[0]) in capsys.readouterr().out


def test_honest_program_finds_what_it_needs(
    play: Callable[[str], tuple[TrialResult, str, GradeFolder]],
) -> None:
    lines = """
import os, sys
sys.path.insert(0, "/simmer")
import simmer_tui.client
open("note.txt", "w").write("its own files can be changed")
print(sorted(os.listdir(".")), os.environ["SIMMER_PORT"], os.environ["SIMMER_REPLY_PORT"], os.environ["HOME"])
sys.exit(3)
"""
    result, output, _ = play(CONNECT + lines)
    assert result.exit_code == 3
    assert output.strip() == "['main.py', 'note.txt'] 9000 9001 /robot/home"


def test_what_a_program_changes_is_gone_in_the_next_run(
    play: Callable[[str], tuple[TrialResult, str, GradeFolder]],
) -> None:
    lines = (
        'import os; print(os.path.exists("note"), flush=True); open("note", "w"); open("main.py", "w")\n'
        + HIT
    )
    _, output, folder = play(lines)
    assert output == "False\n"
    GradeRun(folder.trial(folder.entries[0], 2), folder.runs).run()
    assert (folder.runs / "cheat" / "0002.txt").read_text() == "False\n"


def test_links_handed_in_lead_nowhere(
    isolation: str, make_course: Callable[..., Path], tmp_path: Path
) -> None:
    file = make_course({"cheat": HIT})
    secret = tmp_path / "secret.csv"
    secret.write_text("x")
    handed_in = tmp_path / "teams" / "cheat"
    (handed_in / "config").symlink_to(tmp_path / "set")
    (handed_in / "data.txt").symlink_to(secret)
    os.mkfifo(handed_in / "pipe")
    folder = GradeFolder.create(tmp_path / "out", read_course(file), SEED, Isolation(isolation))
    kept = {path.name for path in folder.home(folder.entries[0].team).rglob("*")}
    assert kept == {"program", "main.py"}


def test_python_in_a_private_folder_serves_any_user(isolation: str, tmp_path: Path) -> None:
    """mktemp makes such folders, and CI makes its environment in one."""
    environment = tmp_path / "environment"
    venv.create(environment, symlinks=True)
    packages = next(environment.glob("lib/python*/site-packages"))
    (packages / "here.pth").write_text("\n".join(path for path in sys.path if path))
    environment.chmod(0o700)
    ask = "from simmer_tui.grade.bubblewrap import what_is_missing as ask; print(ask())"
    answer = subprocess.run(
        [environment / "bin" / "python", "-c", ask], capture_output=True, text=True, check=False
    )
    assert (answer.stdout, answer.stderr) == ("\n", "")
