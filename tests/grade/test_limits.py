"""Limits of a team: they bound all that runs in its sandbox together."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from simmer_tui.config.loader import load
from simmer_tui.grade.cgroup import ControlGroup, made_group
from simmer_tui.grade.course import Rules, read_course
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.grade_run import GradeRun
from simmer_tui.grade.robot_rules import rule_problems
from simmer_tui.grade.sandbox import Isolation
from simmer_tui.grade.usage import SandboxUsage, Supervisor, descendants, tells_descendants

LIMITS = "[limits]\ntime = 30.0\ncpu = {}\nmemory = 300.0\ndisk = 8.0\nprocesses = 20\n"
STAY = "import sys, os\nos.write(1, b'ready\\n')\nsys.stdin.read()\n"
linux = pytest.mark.skipif(not tells_descendants(), reason="processes tell their children on Linux alone")

EXCEED = {
    "memory of many processes": """
import os, time
for _ in range(8):
    if os.fork() == 0:
        held = bytearray(os.urandom(1 << 20)) * 100
        time.sleep(60)
time.sleep(60)
""",
    "memory that processes share": """
import mmap, os, time
for _ in range(4):
    if os.fork() == 0:
        held = mmap.mmap(-1, 200_000_000)
        for at in range(0, len(held), 4096): held[at] = 1
        time.sleep(60)
time.sleep(60)
""",
    "buffers of sockets": """
import os, socket, time
for _ in range(12):
    if os.fork() == 0:
        pairs = []
        while True:
            try: pairs.append(socket.socketpair())
            except OSError: break
            pairs[-1][0].setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 30)
            pairs[-1][0].setblocking(False)
            try:
                while True: pairs[-1][0].send(bytes(60_000))
            except OSError: pass
        time.sleep(60)
time.sleep(60)
""",
    "names of files": """
import itertools, os
try:
    for number in itertools.count(): os.mkdir(f"/tmp/{number}")
except OSError as error: print(error, flush=True)
import time; time.sleep(60)
""",
    "processor time of many processes": """
import os
for _ in range(8):
    if os.fork() == 0: break
while True: pass
""",
}


@pytest.mark.slow
@linux
@pytest.mark.parametrize("what", EXCEED)
def test_all_processes_of_a_run_have_one_limit(
    isolation: str, make_course: Callable[..., Path], tmp_path: Path, what: str
) -> None:
    file = make_course({"cheat": EXCEED[what]}, LIMITS.format(60.0 if "names" in what else 2.0))
    folder = GradeFolder.create(tmp_path / "out", read_course(file), 5, Isolation(isolation))
    result = GradeRun(folder.trial(folder.entries[0], 1), folder.runs).run()
    assert not result.success
    assert result.real_seconds < 25
    output = (folder.runs / "cheat" / "0001.txt").read_text()
    limit = "2 s of processor time" if "time" in what else "300 MB"
    assert f"ended: its processes took more than {limit} together" in output


@linux
def test_usage_is_that_of_all_below() -> None:
    """A page that two processes share counts once, those that one has alone count all."""
    fork = f"import os\nheld = bytearray(b'x') * 50_000_000\nos.fork()\n{STAY}"
    with subprocess.Popen([sys.executable, "-S", "-c", fork], stdin=-1, stdout=-1) as process:
        assert process.stdout is not None
        assert [process.stdout.readline() for _ in range(2)] == [b"ready\n"] * 2
        usage = SandboxUsage(process.pid)
        assert len(descendants(process.pid)) == 2
        assert 50_000_000 < usage.memory() < 95_000_000
        assert 0 < usage.processor_time() < 5
        process.communicate(b"")
    assert usage.memory() == 0


@linux
def test_supervisor_tells_the_limit_that_was_passed() -> None:
    told: list[str] = []
    was_told = threading.Event()

    def end(reason: str) -> None:
        told.append(reason)
        was_told.set()

    supervisor = Supervisor(SandboxUsage(os.getpid()), None, 1_000_000, 1e6, end)
    assert was_told.wait(20)
    supervisor.close()
    assert told == ["ended: its processes took more than 1 MB together"]


def test_control_group_has_the_limits_of_a_run(tmp_path: Path) -> None:
    """Files as the kernel makes them in a new group."""
    for name in ("memory.max", "memory.swap.max", "pids.max", "cpu.max", "cgroup.procs"):
        (tmp_path / name).touch()
    (tmp_path / "cpu.stat").write_text("usage_usec 2500000\nuser_usec 1\n")
    group = ControlGroup(tmp_path)
    group.limit(300_000_000, 22)
    said = {path.name: path.read_text() for path in tmp_path.glob("*.max")}
    assert said == {
        "memory.max": "300000000",
        "memory.swap.max": "0",
        "pids.max": "22",
        "cpu.max": "100000 100000",
    }
    assert group.processor_time() == 2.5
    done = subprocess.run(
        [*group.entry, sys.executable, "-c", "print('in it')"], capture_output=True, text=True, check=True
    )
    assert (done.stdout, (tmp_path / "cgroup.procs").read_text()) == ("in it\n", "0\n")


def test_group_without_controllers_is_none(tmp_path: Path) -> None:
    assert made_group([tmp_path, tmp_path / "missing"]) is None
    assert not [path for path in tmp_path.iterdir() if path.is_dir()]


@pytest.mark.skipif(sys.platform != "linux", reason="control groups are Linux's")
def test_group_of_this_system_bounds_a_process() -> None:
    group = made_group()
    if group is None:
        pytest.skip("no control group with memory, pids and cpu can be had here")
    group.limit(100_000_000, 5)
    words = [*group.entry, sys.executable, "-S", "-c", "bytearray(b'x') * 300_000_000"]
    assert subprocess.run(words, check=False).returncode != 0
    group.remove()
    assert not group.path.exists()


@pytest.mark.parametrize(
    ("file", "old", "new", "what"),
    [
        ("robot.csv", "(in),6", "(in),2.9", "robot.csv: the robot is 2.90 in across; at least 3 are needed"),
        ("robot.csv", "(in),6", "(in),3", ""),
    ],
)
def test_robot_has_a_least_size(exact_mission: Path, file: str, old: str, new: str, what: str) -> None:
    course = load(exact_mission)
    text = (exact_mission / file).read_text()
    assert old in text
    (exact_mission / file).write_text(text.replace(old, new))
    assert "\n".join(map(str, rule_problems(Rules(), course, load(exact_mission)))) == what


def test_robot_is_measured_at_its_narrowest(exact_mission: Path) -> None:
    course = load(exact_mission)
    (exact_mission / "robot.csv").write_text("Shape,1\nx-size (in),8\ny-size (in),2\n")
    problems = rule_problems(Rules(), course, load(exact_mission))
    assert [*map(str, problems)] == ["robot.csv: the robot is 2.00 in across; at least 3 are needed"]


def test_sensors_are_at_most_64(exact_mission: Path) -> None:
    course = load(exact_mission)
    lines = (exact_mission / "sensors.csv").read_text().splitlines()
    row = next(line for line in lines if line.startswith("ultra1,u1,"))
    codes = [f"{first}{second}" for first in "BCDEFG" for second in "0123456789"]
    more = [row.replace("ultra1,u1,1", f"ultra{20 + number},{code},0") for number, code in enumerate(codes)]
    (exact_mission / "sensors.csv").write_text("\n".join([*lines, *more]) + "\n")
    (problem,) = rule_problems(Rules(), course, load(exact_mission))
    assert (
        str(problem)
        == f"sensors.csv: has {len(course.simulation.sensors) + 60} sensors; at most 64 are allowed"
    )
