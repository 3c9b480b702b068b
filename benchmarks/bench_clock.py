"""One clock: pictures that contradict themselves, and the cost of a picture.

    python benchmarks/bench_clock.py [--quick] [--json FILE]

The app runs on a pty that answers like a terminal with synchronized updates, so that a picture is the screen
at the end of one. 200 pictures for each of three programs are checked for contradictions (goal 0). One is a
robot in the maze with another pose than the pose line. The other is a bright ray whose code is not that of
the sensor shown as read last. Then `wander.py` drives as fast as it can: bytes a second and the fraction of a
processor that the screen's thread takes at 120 x 36 (goals 24 KB, 10 %) and 200 x 60 (50 KB, 13 %), and at
the default pace pictures a second (goal 15), the median and the 90th percentile of the gaps between them (67
and 90 ms) and bytes (32 KB). Needs Linux for /proc, and the packages of the tests.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import json
import math
import os
import re
import select
import statistics
import struct
import subprocess
import sys
import tempfile
import termios
import threading
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import pyte

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))  # the reader of a picture's cells is one of the tests'

from simmer_tui.client import Robot  # noqa: E402
from simmer_tui.sim.specs import CELL_SIZE  # noqa: E402
from simmer_tui.tui.maze.painter import Painter  # noqa: E402
from simmer_tui.tui.maze.palette import Role  # noqa: E402
from simmer_tui.tui.terminal import ColorDepth, GlyphMode  # noqa: E402
from tests.tui.maze.decoding import hand_heading, robot_middle, turned  # noqa: E402
from tests.tui.maze.test_headings import VIEWS  # noqa: E402
from tests.tui.test_seen import cells_of, maze_within, shown_color  # noqa: E402
from tests.tui.test_tmux import UNKNOWN_TO_PYTE  # noqa: E402

PORTS = ("--port", "0", "--reply-port", "0", "--belief-port", "0")
MAIN = [sys.executable, "-m", "simmer_tui", "--seed", "7", *PORTS]
WANDER = f'"{sys.executable}" "{ROOT / "scripts" / "wander.py"}" --seed 7'
SPIN = f'"{sys.executable}" "{Path(__file__)}" --spin'
"""A program that turns and reads as fast as it can."""
UPDATE_ENDS = b"\x1b[?2026l"
STARTS_WITHIN = 60.0
"""Seconds until the app must have started, on a busy machine."""
# A pixel of the picture at 10 columns a cell is 0.6 in wide and the pose has one decimal.
_AWAY, _ASIDE = 1.5, 15.0
"""Inches and degrees by which robot and pose line may differ: the resolution of a picture."""


class Terminal:
    """The app on a pty with synchronized updates, and a program that drives."""

    def __init__(
        self,
        size: tuple[int, int],
        pace: str,
        program: str,
        each: Callable[[bytes], None] = lambda update: None,
    ) -> None:
        """`each` is called with the bytes written up to the end of each update."""
        self.master, slave = os.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", size[1], size[0], 0, 0))
        self._folder = tempfile.TemporaryDirectory()
        environment = {"TERM": "xterm-256color", "COLORTERM": "truecolor", "LC_ALL": "C.UTF-8"}
        environment |= {"COLUMNS": str(size[0]), "LINES": str(size[1]), "XDG_DATA_HOME": self._folder.name}
        self.process = subprocess.Popen(
            [*MAIN, "--pace", pace, "--run", program],
            stdin=slave,
            stdout=slave,
            stderr=slave,
            start_new_session=True,
            env=os.environ | environment,
        )
        os.close(slave)
        self.bytes = 0
        self.drawn: list[float] = []
        """Time at which each picture was complete."""
        self._each = each
        self._held = b""
        self._over = False
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()
        end = time.monotonic() + STARTS_WITHIN
        while len(self.drawn) < 2:
            if self.process.poll() is not None or time.monotonic() > end:
                raise SystemExit("the app did not draw anything")
            time.sleep(0.05)

    def _read(self) -> None:
        while not self._over:
            if not select.select([self.master], [], [], 0.05)[0]:
                continue
            data = os.read(self.master, 65536)
            self.bytes += len(data)
            if b"\x1b[?2026$p" in data:
                os.write(self.master, b"\x1b[?2026;2$y")
            *updates, self._held = (self._held + data).split(UPDATE_ENDS)
            for update in updates:
                self.drawn.append(time.perf_counter())
                self._each(update)

    def screen_seconds(self) -> float:
        """Processor time of the thread that draws: the process's first."""
        pid = self.process.pid
        fields = Path(f"/proc/{pid}/task/{pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def close(self) -> None:
        self._over = True
        self._thread.join()
        self.process.kill()
        self.process.wait()
        os.close(self.master)
        self._folder.cleanup()


@contextlib.contextmanager
def terminal(
    size: tuple[int, int], pace: str, program: str, each: Callable[[bytes], None] = lambda update: None
) -> Iterator[Terminal]:
    made = Terminal(size, pace, program, each)
    try:
        yield made
    finally:
        made.close()


def spin() -> None:
    """Turn and read until the app ends."""
    with Robot() as robot:
        while True:
            robot.send("r1-37")
            robot.read("u1", "u3")


# -- pictures that contradict themselves -----------------------------------------------------------


class Judge:
    """Feeds updates to a terminal's screen, and counts pictures and those that contradict themselves."""

    def __init__(self) -> None:
        self.screen = pyte.Screen(120, 36)
        self._stream = pyte.ByteStream(self.screen)
        self._painter = Painter(GlyphMode.QUADRANT, ColorDepth.TRUECOLOR)
        self.judged = 0
        self.wrong: list[str] = []
        self.counts = False
        """True while pictures are counted."""

    def take(self, update: bytes) -> None:
        """Process a complete update."""
        before = [*self.screen.display]
        self._stream.feed(UNKNOWN_TO_PYTE.sub(b"", update))
        if self.counts and self.screen.display != before:
            fault = self._fault()
            if fault:
                self.wrong.append(fault)

    def _fault(self) -> str:
        """First contradiction within the picture; empty without one."""
        rows = self.screen.display
        found = re.search(r"(-?\d+\.\d), (-?\d+\.\d) in +(-?\d+(?:\.\d)?) deg", "\n".join(rows))
        cells = cells_of(self.screen, VIEWS["120x36"], self._painter)
        heading, middle = hand_heading(cells, self._painter), robot_middle(cells, self._painter)
        if found is None or heading is None or middle is None:
            return ""  # a contact or a notification may lie over one of them
        self.judged += 1
        x, y = middle[0] * CELL_SIZE / 10, 48 - middle[1] * CELL_SIZE / 10
        told = [float(number) for number in found.groups()]
        away, aside = math.hypot(x - told[0], y - told[1]), turned(heading, told[2])
        if away > _AWAY or aside > _ASIDE:
            return f"robot at {x:.1f}, {y:.1f} heading {heading:.0f}, the pose line says {found[0]}"
        strong = shown_color(self._painter.palette[Role.RAY_STRONG], ColorDepth.TRUECOLOR)
        _, across = maze_within(VIEWS["120x36"])
        in_maze = self._words(strong, across.start, across.stop, VIEWS["120x36"][1])
        beside = self._words(strong, across.stop + 1, 120, 36)
        codes = re.findall(r"\b[a-z]\d\b", in_maze)
        if codes and codes[0] not in beside:
            return f"the bright ray is that of {codes[0]}, read last is {beside.strip()}"
        return ""

    def _words(self, color: str, first: int, last: int, rows: int) -> str:
        """Text written in a colour in some columns."""
        lines = (
            "".join(
                cell.data if (cell := self.screen.buffer[row][column]).fg == color else " "
                for column in range(first, last)
            )
            for row in range(1, rows)
        )
        return "\n".join(lines)


def measure_agreement(pictures: int) -> dict[str, float]:
    """Shares of the pictures that contradict themselves, for three programs."""
    figures: dict[str, float] = {}
    cases = (("wander", "off", WANDER), ("wander at pace", "4", WANDER), ("spin", "off", SPIN))
    for name, pace, program in cases:
        judge = Judge()
        with terminal((120, 36), pace, program, judge.take):
            time.sleep(1.0)
            judge.counts = True
            end = time.monotonic() + STARTS_WITHIN
            while judge.judged < pictures and time.monotonic() < end:
                time.sleep(0.05)
            judge.counts = False
        for fault in judge.wrong[:3]:
            print(f"  {name}: {fault}")
        figures[f"{name} pictures"] = judge.judged
        figures[f"{name} wrong"] = len(judge.wrong) / max(judge.judged, 1)
    return figures


# -- the cost of pictures --------------------------------------------------------------------------


def measure_cost(size: tuple[int, int], pace: str, seconds: float) -> dict[str, float]:
    """Kilobytes and pictures a second, gaps between pictures, and the screen's thread, with `wander.py`."""
    with terminal(size, pace, WANDER) as app:
        time.sleep(3.0)
        sent, used, first, started = app.bytes, app.screen_seconds(), len(app.drawn), time.perf_counter()
        time.sleep(seconds)
        passed = time.perf_counter() - started
        drawn = app.drawn[first:]
        gaps = [1000 * (after - before) for before, after in pairwise(drawn)]
        return {
            "kilobytes": (app.bytes - sent) / passed / 1000,
            "share": (app.screen_seconds() - used) / passed,
            "pictures": len(drawn) / passed,
            "median gap": statistics.median(gaps),
            "p90 gap": statistics.quantiles(gaps, n=10)[-1],
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="shorter runs")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    parser.add_argument("--spin", action="store_true", help="be the program of one of the cases")
    options = parser.parse_args()
    if options.spin:
        spin()
    figures: dict[str, float] = {}
    seconds = 4.0 if options.quick else 15.0
    for size, pace, goal in (
        ((120, 36), "off", "goals 24 KB, 10 %"),
        ((200, 60), "off", "goals 50 KB, 13 %"),
        ((120, 36), "4", "goals 15 pictures, gaps 67 and 90 ms, 32 KB"),
    ):
        cost = measure_cost(size, pace, seconds)
        name = f"{size[0]}x{size[1]} pace {pace}"
        print(
            f"{name}: {cost['kilobytes']:.1f} KB/s, {cost['share']:.1%} of a processor, "
            f"{cost['pictures']:.1f} pictures a second, gaps {cost['median gap']:.0f} and "
            f"{cost['p90 gap']:.0f} ms ({goal})",
            flush=True,
        )
        figures |= {f"{name} {key}": value for key, value in cost.items()}
    agreement = measure_agreement(40 if options.quick else 200)
    for key in agreement:
        if key.endswith("wrong"):
            name = key.removesuffix(" wrong")
            print(
                f"{name}: {agreement[key]:.1%} of {agreement[f'{name} pictures']:.0f} pictures contradict "
                f"themselves (goal 0)"
            )
    if options.json is not None:
        options.json.write_text(json.dumps(figures | agreement, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
