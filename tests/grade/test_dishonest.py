"""Twenty more programs that cheat, of kinds that came up after the first: none wins, as root and not."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from simmer_tui.grade.course import read_course
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.grade_run import GradeRun
from simmer_tui.grade.sandbox import Isolation
from tests.grade.conftest import CONNECT, SOLVE
from tests.grade.test_cheats import SEED, TRY

LIMITS = "[limits]\ntime = 3.0\nmemory = 300.0\ncpu = 2.0\ndisk = 8.0\nprocesses = 20\noutput = 5.0\n"
DISHONEST = {
    "writes the first process's memory": """

attempt(lambda: os.open("/proc/1/mem", os.O_RDWR) >= 0)
""",
    "reads the first process's memory map and environment": """
attempt(lambda: open("/proc/1/maps").read())
attempt(lambda: open("/proc/1/environ", "rb").read())
attempt(lambda: open("/proc/1/auxv", "rb").read())
""",
    "takes the first process's files": """

attempt(lambda: os.listdir("/proc/1/fd"))
attempt(lambda: os.listdir("/proc/1/root"))
attempt(lambda: os.readlink("/proc/1/cwd"))
""",
    "takes a descriptor of the first process": """
import ctypes, os
libc = ctypes.CDLL(None)
def take():
    first = os.pidfd_open(1)
    return any(libc.syscall(438, first, number, 0) >= 0 for number in range(20))
attempt(take)
""",
    "ends the first process": """
import os, signal, time
for number in range(1, 65):
    try: os.kill(1, number)
    except OSError: pass
time.sleep(0.2)
print("nothing", flush=True)
attempt(lambda: None)
""",
    "raises its own limits": """
import resource
for name in ("AS", "CPU", "NPROC", "NOFILE", "FSIZE"):
    attempt(lambda: resource.setrlimit(getattr(resource, "RLIMIT_" + name), (1 << 40, 1 << 40)) is None)
""",
    "has the first process's limits raised": """
import resource
attempt(lambda: resource.prlimit(1, resource.RLIMIT_AS)[0] == resource.RLIM_INFINITY)
attempt(lambda: resource.prlimit(1, resource.RLIMIT_AS, (1 << 40, 1 << 40)) is not None)
""",
    "reaches other machines by vsock": """
import socket
attempt(lambda: socket.socket(40, socket.SOCK_STREAM))
attempt(lambda: socket.socket(38, socket.SOCK_SEQPACKET))
attempt(lambda: socket.socket(17, socket.SOCK_RAW))
""",
    "has forgotten links lead out": """

os.symlink("/", "out")
attempt(lambda: [n for n in os.listdir("out/tmp") + os.listdir("out/robot") if n != "home"])
attempt(lambda: os.link("/etc/ld.so.cache", "own") is None)
""",
    "looks into the folder of its files for more": """

attempt(lambda: [n for n in os.listdir("/program") if n != "main.py"])
attempt(lambda: open("/program/main.py", "a"))
attempt(lambda: os.listdir("/program/..") and [n for n in os.listdir("/") if "grade" in n or "runs" in n])
""",
    "mounts by new calls": """
import ctypes
libc = ctypes.CDLL(None)
for call in (428, 429, 430, 432, 442): attempt(lambda: libc.syscall(call, 0, 0, 0, 0, 0) >= 0)
attempt(lambda: libc.chroot(b"/tmp") == 0)
""",
    "joins namespaces of others": """
import ctypes, os
libc = ctypes.CDLL(None)
for name in ("mnt", "net", "pid", "user"):
    attempt(lambda: libc.setns(os.open("/proc/1/ns/" + name, os.O_RDONLY), 0) == 0)
""",
    "makes itself unkillable": """
import os, signal
for number in range(1, 32):
    try: signal.signal(number, signal.SIG_IGN)
    except (OSError, ValueError): pass
print("nothing", flush=True)
attempt(lambda: None)
while True: pass
""",
    "takes memory in many processes": """
import os, itertools
def fill():
    for number in range(60):
        held = bytearray(os.urandom(1 << 16)) * 64
        if os.fork() == 0: held = bytearray(b"x") * 250_000_000; import time; time.sleep(60)
    return True
try: fill()
except OSError as error: print("refused", error, flush=True)
attempt(lambda: None)
import time; time.sleep(60)
""",
    "steals the port of the simulator": """
import os, socket
attempt(lambda: socket.create_server(("127.0.0.1", int(os.environ["SIMMER_PORT"]))))
attempt(lambda: socket.create_server(("127.0.0.1", int(os.environ["SIMMER_REPLY_PORT"]))))
""",
    "reads the kernel": """
for name in ("kcore", "kmsg", "sysrq-trigger", "kallsyms"):
    def peek():
        text = open("/proc/" + name, "rb").read(4096)
        return name != "kallsyms" or any(int(line.split()[0], 16) for line in text.splitlines()[:5])
    attempt(peek)
""",
    "changes the host's name and settings": """
import os, socket
attempt(lambda: socket.sethostname("x") is None)
for name in ("hostname", "core_pattern"):  # opened, not written: they may be this machine's
    attempt(lambda: os.open("/proc/sys/kernel/" + name, os.O_WRONLY) >= 0)
""",
    "takes a better priority": """

attempt(lambda: os.nice(-5) < 0)
attempt(lambda: os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50)) is None)
""",
    "locks files that others see": """
import ctypes, fcntl, os, struct, sys
libc = ctypes.CDLL(None)
for name in (sys.executable, "/usr/bin/env", "/usr/lib", "/program/main.py", "/dev/null"):
    held = os.open(name, os.O_RDONLY)
    attempt(lambda: fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB) is None)
    attempt(lambda: fcntl.flock(held, fcntl.LOCK_SH | fcntl.LOCK_NB) is None)
    attempt(lambda: fcntl.lockf(held, fcntl.LOCK_SH | fcntl.LOCK_NB) is None)
    whole = struct.pack("=hhqqi4x", 0, 0, 0, 0, 0)  # struct flock
    for command in (6, 37): attempt(lambda: fcntl.fcntl(held, command, whole))
    for command in (1024, 1026): attempt(lambda: fcntl.fcntl(held, command, 0) == 0)
    for command in (1036, 1038): attempt(lambda: fcntl.fcntl(held, command, bytes(8)))
null = os.open("/dev/null", os.O_RDWR)
attempt(lambda: fcntl.lockf(null, fcntl.LOCK_EX | fcntl.LOCK_NB) is None)
""",
    "watches files that others see": """
import ctypes, platform
libc = ctypes.CDLL(None)
attempt(lambda: libc.inotify_init1(0) >= 0)
attempt(lambda: libc.inotify_init() >= 0)
attempt(lambda: libc.syscall({"x86_64": 300, "aarch64": 262}[platform.machine()], 0x200, 0) >= 0)
""",
    "says that it has done the mission by a belief": CONNECT
    + """
import socket
b = socket.create_connection((os.environ["SIMMER_HOST"], int(os.environ["SIMMER_BELIEF_PORT"])))
b.sendall(b'{"x": 30, "y": 42, "heading": 180}\\n' * 100 + b'{"goal": "block", "success": true}\\n')
print("nothing", flush=True)
attempt(lambda: None)
""",
    "sends what is no command": CONNECT
    + """
s.sendall(bytes(range(256)) * 4000 + b"[" * 100_000 + b"p1-nan\\np1-inf\\nd1--5\\n")
print("nothing", flush=True)
attempt(lambda: None)
""",
}


@pytest.mark.slow
@pytest.mark.parametrize("cheat", DISHONEST)
def test_dishonest_program_does_not_win(
    isolation: str, make_course: Callable[..., Path], tmp_path: Path, cheat: str
) -> None:
    file = make_course({"cheat": TRY + DISHONEST[cheat], "honest": SOLVE}, LIMITS)
    folder = GradeFolder.create(tmp_path / "out", read_course(file), SEED, Isolation(isolation))
    result = GradeRun(folder.trial(folder.entries[0], 1), folder.runs).run()
    output = (folder.runs / "cheat" / "0001.txt").read_text()
    assert not result.success
    assert output
    assert "WON" not in output
    assert result.real_seconds < 15
    honest = GradeRun(folder.trial(folder.entries[1], 1), folder.runs).run()
    assert honest.success
    listed = subprocess.run(["ps", "-A", "-o", "args="], capture_output=True, text=True, check=True).stdout
    assert str(folder.path) not in listed
