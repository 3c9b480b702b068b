"""Threads and processes of a program by its clock: they take turns, and a run repeats itself."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from tests.robot.test_program_clock import log_of, run

THREADS = """
import concurrent.futures, queue, threading, time
from simmer_tui.client import Robot
robot, ranges, over, lock = Robot(), queue.Queue(), threading.Event(), threading.Lock()
def sense():
    while not over.is_set():
        with lock:
            ranges.put(robot.read("u1"))
        time.sleep(0.05)
    ranges.put(None)
def drive():
    while (ahead := ranges.get()) is not None:
        with lock:
            robot.send("vv-%g;0;%g" % ((4, 0) if ahead > 6 else (0, 60)))
threads = [threading.Thread(target=sense), threading.Thread(target=drive)]
for each in threads:
    each.start()
print(over.wait(1.02))
over.set()
for each in threads:
    each.join()
full = threading.Condition()
def fill():
    time.sleep(0.2)
    with full:
        full.notify_all()
threading.Timer(0.1, fill).start()
with full:
    print(full.wait(0.05), full.wait(5))
with concurrent.futures.ThreadPoolExecutor(2) as pool:
    print(list(pool.map(lambda number: time.sleep(0.1) or number, range(5))))
print(threading.active_count(), round(time.monotonic(), 2))
"""
PROCESSES = """
import multiprocessing, sys, time
from simmer_tui.client import Robot
def sense(ranges, over):
    with Robot() as robot:
        while not over.is_set():
            ranges.put(robot.read("u1"))
            robot.send("vv-3;0;10")
            time.sleep(0.05)
    ranges.put(None)
def square(number):
    time.sleep(0.1 * number)
    return number * number
def talk(end):
    for _ in range(3):
        end.send(b"x" * 200_000)
        time.sleep(0.1)
if __name__ == "__main__":
    multiprocessing.set_start_method("{method}")
    ranges, over = multiprocessing.Queue(), multiprocessing.Event()
    process = multiprocessing.Process(target=sense, args=(ranges, over))
    process.start()
    for count in range(20):
        ranges.get()
    over.set()
    while ranges.get() is not None:
        count += 1
    process.join()
    print(count, process.exitcode, round(time.monotonic(), 1))
    with multiprocessing.Pool(2) as pool:
        print(pool.map(square, range(5)), round(time.monotonic(), 1))
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.Process(target=talk, args=(theirs,))
    process.start()
    print(sum(len(ours.recv()) for _ in range(3)))
    process.join()
    print(round(time.monotonic(), 1))
"""
CHILDREN = """
import os, subprocess, sys, time
echo = "import sys, time\\nfor line in sys.stdin:\\n    time.sleep(0.3)\\n    print(line.strip(), flush=True)"
pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
child = subprocess.Popen([sys.executable, "-c", echo], **pipes)
for number in range(3):
    child.stdin.write(f"{number}\\n")
    child.stdin.flush()
    print(child.stdout.readline().strip(), round(time.monotonic(), 1))
print(child.communicate(), child.returncode)
long = "import time; time.sleep(2); print('x' * 200_000)"
ended = subprocess.run([sys.executable, "-c", long], capture_output=True)
print(len(ended.stdout), round(time.monotonic(), 1))
print(os.system(f'{sys.executable} -c "import time; time.sleep(2)"'), round(time.monotonic(), 1))
print(subprocess.check_output(["sleep", "0.01"]), round(time.monotonic(), 1))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="os.fork is of Unix")
def test_threads_and_a_process_take_turns(tmp_path: Path) -> None:
    """A process by fork, a thread, a pipe and a lock between them, in one short program."""
    program = """
        import os, threading, time
        def note(text): print(text, round(time.monotonic(), 2), flush=True)
        reader, writer = os.pipe()
        if os.fork() == 0:
            time.sleep(1)
            os.write(writer, b"one")
            time.sleep(1)
            os._exit(3)
        lock, ready = threading.Lock(), threading.Event()
        def work():
            with lock:
                time.sleep(0.25)
                ready.set()
                note("work")
                time.sleep(0.25)
        thread = threading.Thread(target=work)
        thread.start()
        ready.wait()
        note("ready")
        with lock:
            note("lock")
        thread.join()
        note(os.read(reader, 9))
        note(os.waitstatus_to_exitcode(os.wait()[1]))
        lock.acquire()
        lock.acquire()
    """
    ended = run(tmp_path, program)
    assert ended.stdout.splitlines() == [
        *("work 0.25", "ready 0.25", "lock 0.5", "b'one' 1.0", "3 2.0"),
    ], ended.stderr
    told = "the program waits for a thread or process of its own, and all of them wait."
    said = [line for line in ended.stderr.splitlines() if line.startswith("program.py:27: ")]
    assert (ended.returncode, len(said)) == (2, 1)
    assert told in said[0]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="the rule is that of Unix")
@pytest.mark.parametrize(
    ("program", "last"),
    [
        (THREADS, "1 1.65"),
        (PROCESSES.replace("{method}", "fork"), "1.9"),
        (PROCESSES.replace("{method}", "spawn"), "1.9"),
        (PROCESSES.replace("{method}", "forkserver"), "1.9"),
        (CHILDREN, "b'' 4.9"),
    ],
    ids=["threads", "fork", "spawn", "forkserver", "subprocess"],
)
def test_ten_runs_of_threads_and_processes_are_the_same(tmp_path: Path, program: str, last: str) -> None:
    runs: list[tuple[str, list[dict[str, Any]]]] = []
    for _ in range(10):
        ended = run(tmp_path, program, "--reply-port", "0")
        assert "Traceback" not in ended.stderr, ended.stderr
        runs.append((ended.stdout, log_of(tmp_path)))
    assert runs[0][0].splitlines()[-1] == last
    assert all(each == runs[0] for each in runs)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="the rule is that of Unix")
def test_a_process_that_waits_for_a_foreign_one_ends_waits_before_and_after(tmp_path: Path) -> None:
    program = """
        import multiprocessing, os, time
        def wait(begun, over):
            for _ in range(2):
                begun.release()
                over.acquire()
                print("over", round(time.monotonic(), 2), flush=True)
        if __name__ == "__main__":
            multiprocessing.set_start_method("fork")
            begun, over = multiprocessing.Semaphore(0), multiprocessing.Semaphore(0)
            process = multiprocessing.Process(target=wait, args=(begun, over))
            process.start()
            begun.acquire()
            over.release()
            os.system("true")
            begun.acquire()
            os.system("sleep 2.5")
            over.release()
            process.join()
            print(process.exitcode, round(time.monotonic(), 2))
    """
    ended = run(tmp_path, program)
    assert ended.stdout.splitlines() == ["over 0.0", "over 0.0", "0 0.0"], ended.stderr
    told = [
        line for line in ended.stderr.splitlines() if line.startswith("program.py:17: by the program's clock")
    ]
    assert len(told) == 1


@pytest.mark.slow
def test_who_keeps_the_turn_is_named_within_two_seconds_and_only_once(tmp_path: Path) -> None:
    program = """
        import threading, time
        began = []
        def work():
            time.sleep(0.1)
            began.append(1)
        thread = threading.Thread(target=work)
        thread.start()
        count = 0
        while not began and count < 150_000_000:
            count += 1
        print(thread.is_alive())
        thread.join()
        print(began)
    """
    ended = run(tmp_path, program)
    assert ended.stdout.split() == ["True", "[1]"]
    assert ended.stderr.count("here the program has run for 1.5 s of real time without a wait") == 1
    assert "program.py:10: here" in ended.stderr or "program.py:11: here" in ended.stderr
    assert "call time.sleep in the loop, or use --clock real" in ended.stderr


@pytest.mark.slow
def test_managers_of_multiprocessing_are_refused_with_what_is_followed(tmp_path: Path) -> None:
    program = """
        import multiprocessing
        if __name__ == "__main__":
            multiprocessing.Manager()
    """
    ended = run(tmp_path, program, "--quiet")
    assert ended.returncode == 2
    told = (
        "program.py:4: BaseManager.start of multiprocessing waits by a clock of its own, which the program's "
    )
    assert ended.stderr.count(told) == 1
    assert "Queue, Pipe, Value and Lock of multiprocessing are followed. Or use --clock real" in ended.stderr
