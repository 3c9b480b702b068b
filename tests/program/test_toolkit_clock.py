"""Waits of matplotlib, pygame, asyncio, select and sched by the program's clock."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.robot.test_program_clock import log_of, run

FAKES = {
    "matplotlib/__init__.py": "",
    "matplotlib/pyplot.py": """
from types import SimpleNamespace as Thing
drawn = []
class Canvas:
    required_interactive_framework = "tk"
    figure = Thing(stale=True)
    def draw_idle(self): drawn.append("drawn")
    def flush_events(self): drawn.append("flushed")
manager = Thing(canvas=Canvas())
_pylab_helpers = Thing(Gcf=Thing(get_active=lambda: manager, get_all_fig_managers=lambda: [manager]))
def show(block=None):
    assert block is False
    drawn.append("shown")
def pause(interval): raise AssertionError
def ginput(): raise AssertionError
def waitforbuttonpress(): raise AssertionError
""",
    "pygame/__init__.py": "import pygame.time\n",
    "pygame/time.py": "class Clock: pass\ndef wait(ms): raise AssertionError\ndelay = set_timer = wait\n",
}
"""Modules with the names of toolkits, for machines that have not installed them."""
WAITS = """
import asyncio, sched, select, selectors, socket, time
import matplotlib.pyplot as plt
import pygame

def now(): print(round(time.monotonic(), 2))
plt.pause(0.5); now()
plt.show(); now()
print(plt.drawn)
frames = pygame.time.Clock()
print([frames.tick(50) for _ in range(12)][1:3], frames.get_fps(), pygame.time.wait(100)); now()
events = sched.scheduler()
events.enter(2, 1, print, ("second",))
events.enter(1, 1, print, ("first",))
events.run(); now()
select.select([], [], [], 1.5); now()
one, other = socket.socketpair()
selector = selectors.DefaultSelector()
selector.register(one, selectors.EVENT_READ)
print(selector.select(0.5)); now()
other.send(b"x")
print(len(selector.select(5))); now()

async def main():
    asyncio.get_running_loop().call_later(3, print, "later")
    await asyncio.gather(asyncio.sleep(2), asyncio.sleep(4))
    try:
        await asyncio.wait_for(asyncio.sleep(100), 1)
    except asyncio.TimeoutError:
        print("timeout")
asyncio.run(main()); now()
"""


def test_every_usual_wait_passes_simulated_time_alone(tmp_path: Path) -> None:
    for name, text in FAKES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, "utf-8")
    ended = run(tmp_path, WAITS)
    assert ended.stdout.splitlines() == [
        *("0.5", "0.5", "['drawn', 'shown', 'flushed', 'shown', 'drawn', 'flushed']"),
        *("[20, 20] 50.0 100", "0.84", "first", "second", "2.84", "4.34", "[]", "4.84", "1", "4.84"),
        *("later", "timeout", "9.84"),
    ], ended.stderr
    assert "by the program's clock show() shows the figures and does not wait" in ended.stderr


PLOTS = """
import matplotlib.pyplot as plt, time
from simmer_tui.client import Robot
plt.ion()
ranges = []
with Robot() as robot:
    robot.send("vv-3;0;20")
    for _ in range(10):
        ranges.append(robot.read("u1"))
        plt.clf()
        plt.plot(ranges)
        plt.pause(0.1)
    robot.send("vv-0;0;0")
    print(len(plt.gca().lines[0].get_xdata()), round(time.monotonic(), 2))
plt.show()
plt.savefig("plot.png")
"""
DRAWS = """
import time
import matplotlib
matplotlib.use("Agg")
from matplotlib import pyplot as plt
from simmer_tui.client import Robot
figure, axes = plt.subplots()
line, = axes.plot([], [])
plt.show(block=False)
with Robot() as robot:
    for number in range(10):
        ahead = robot.read("u1")
        robot.send("vv-%g;0;%g" % ((4, 0) if ahead > 6 else (0, 60)))
        line.set_data([0, number], [0, ahead])
        axes.relim()
        axes.autoscale_view()
        figure.canvas.draw()
        figure.canvas.flush_events()
        time.sleep(0.05)
    print(round(time.monotonic(), 2))
"""
TICKS = """
import pygame
from simmer_tui.client import Robot
pygame.init()
screen = pygame.display.set_mode((100, 100))
frames = pygame.time.Clock()
with Robot() as robot:
    for _ in range(40):
        pygame.event.get()
        ahead = robot.read("u1")
        robot.send("vv-%g;0;%g" % ((4, 0) if ahead > 6 else (0, 60)))
        pygame.draw.circle(screen, (0, 255, 0), (50, 50), 20)
        pygame.display.flip()
        frames.tick(40)
    print(pygame.time.get_ticks() // 10, frames.get_fps(), screen.get_at((50, 50))[:3])
"""
DELAYS = """
import pygame
from pygame.time import delay, wait
from simmer_tui.client import Robot
pygame.init()
frames = pygame.time.Clock()
with Robot() as robot:
    for _ in range(10):
        robot.read("u1")
        robot.send("vv-3;0;5")
        print(wait(50), delay(20), frames.tick_busy_loop(10))
"""
TASKS = """
import asyncio, time
from simmer_tui.client import Robot
robot = Robot()
async def drive():
    for _ in range(20):
        ahead = robot.read("u1")
        robot.send("vv-%g;0;%g" % ((4, 0) if ahead > 6 else (0, 60)))
        await asyncio.sleep(0.05)
async def look():
    for _ in range(10):
        robot.read("u2")
        await asyncio.sleep(0.12)
async def main():
    await asyncio.gather(drive(), look())
asyncio.run(main())
print(round(time.monotonic(), 2))
"""
STREAMS = """
import asyncio, os, time
async def main():
    reader, writer = await asyncio.open_connection("127.0.0.1", int(os.environ["SIMMER_PORT"]))
    over = []
    async def ticks():
        while not over:
            await asyncio.sleep(0.03)
    ticker = asyncio.ensure_future(ticks())
    for _ in range(20):
        writer.write(b"u1\\n")
        await writer.drain()
        await reader.readexactly(8)
        await asyncio.sleep(0.02)
    try:
        await asyncio.wait_for(reader.readexactly(1), 0.5)
    except asyncio.TimeoutError:
        over.append(True)
    await ticker
    print(round(time.monotonic(), 2))
asyncio.run(main())
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("needs", "program", "printed"),
    [
        ("matplotlib", PLOTS, "10 1.0"),
        ("matplotlib", DRAWS, "0.5"),
        ("pygame", TICKS, "100 40.0 (0, 255, 0)"),
        ("pygame", DELAYS, "50 20 100"),
        ("", TASKS, "1.2"),
        ("", STREAMS, "0.93"),
    ],
    ids=["pause", "draw", "tick", "wait", "tasks", "streams"],
)
def test_real_toolkits_have_the_same_run_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, needs: str, program: str, printed: str
) -> None:
    if needs:
        pytest.importorskip(needs)
    if needs == "matplotlib":
        # Its very first run lists the fonts of the machine, in another thread too, which takes a look at the
        # clock. That run alone differs, by 10 us.
        pytest.importorskip("matplotlib.font_manager")
    # As on a machine without a screen; MPLBACKEND stays as it is.
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setenv("SDL_AUDIODRIVER", "dummy")
    first = run(tmp_path, program, "--reply-port", "0")
    log = log_of(tmp_path)
    assert first.returncode == 0, first.stderr
    assert first.stdout.splitlines()[-1] == printed
    again = run(tmp_path, program, "--reply-port", "0")
    assert again.stdout == first.stdout
    assert log_of(tmp_path) == log
    assert len(log) > 10


@pytest.mark.slow
@pytest.mark.parametrize(
    ("program", "told"),
    [
        (
            "import tkinter\ntkinter.mainloop()",
            "program.py:2: mainloop of tkinter waits by a clock of its own, which the program's "
            "clock cannot follow. Call update() of the window in a loop with time.sleep, which are followed. "
            "Or use --clock real",
        ),
        (
            "import select\nselect.poll()",
            "program.py:2: select.poll waits by a clock of its own, which the program's clock cannot follow. "
            "select.select and selectors are followed. Or use --clock real",
        ),
    ],
)
def test_what_is_refused_is_said_once_with_what_to_do(tmp_path: Path, program: str, told: str) -> None:
    if "tkinter" in program:
        pytest.importorskip("tkinter")
    ended = run(tmp_path, program, "--quiet")
    assert ended.returncode == 2
    assert [line for line in ended.stderr.splitlines() if "program.py" in line] == [told]
