"""The Arduino's histogram filter, compiled for this machine, finds a simulated robot."""

from __future__ import annotations

import math
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui import load
from simmer_tui.cli.main import main
from simmer_tui.sim import Simulator

ROOT = Path(__file__).parents[2]
SKETCH = ROOT / "scripts" / "arduino" / "histogram_filter"
RANGES = ("u1", "u2", "u3", "u4")
COUNTERS = ("o3", "o4", "g1")
STRICT = ("-Wall", "-Wextra", "-Werror", "-std=c++11")
PROGRAM = """
#include <math.h>
#include <stdio.h>
#include "histogram.h"
int main() {
  char what;
  float a, b;
  while (scanf(" %c %f %f", &what, &a, &b) == 3) {
    if (what == 's') scatter();
    if (what == 'u') update((uint8_t)a, b);
    if (what == 'p') predict(a, b);
    uint16_t row, column, heading;
    float probability = best(row, column, heading);
    printf("%d %d %d %g\\n", row, column, heading, (double)probability);
    fflush(stdout);
  }
}
"""


class Filter:
    """The filter of the sketch as a process: a line to it, the best pose from it."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def tell(self, what: str, a: float = 0.0, b: float = 0.0) -> tuple[float, float, float, float]:
        """The best pose, x and y in inches and heading in degrees, and its probability."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{what} {a:.9g} {b:.9g}\n")
        self._process.stdin.flush()
        row, column, heading, probability = map(float, self._process.stdout.readline().split())
        return (column + 0.5) * 6.0, (7.5 - row) * 6.0, heading * 45.0, probability


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if shutil.which("c++") is None:
        pytest.skip("c++ is not installed")
    made = tmp_path_factory.mktemp("sketch")
    assert main(["atlas", str(made / "atlas.h"), "--step", "6", "--sensors", ",".join(RANGES)]) == 0
    return made


@pytest.fixture
def histogram(folder: Path) -> Iterator[Filter]:
    (folder / "program.cpp").write_text(PROGRAM)
    command = ["c++", "-O1", *STRICT, f"-I{folder}", f"-I{SKETCH}", "-o", "program", "program.cpp"]
    subprocess.run(command, cwd=folder, check=True)
    pipe = subprocess.PIPE
    with subprocess.Popen([str(folder / "program")], stdin=pipe, stdout=pipe, text=True) as process:
        yield Filter(process)
        process.stdin.close()  # type: ignore[union-attr]


def finds(histogram: Filter, seed: int, pose: tuple[float, float, float]) -> bool:
    """True if its first sure answer is right, for a robot that drives as the sketch does."""
    simulator = Simulator(replace(load().simulation, bot_center=pose[:2], bot_rot=pose[2]), seed)
    histogram.tell("s")
    turned = 0.0
    for step in range(24):
        readings = [simulator.execute(code).reply for code in RANGES]
        x, y, heading, probability = [histogram.tell("u", *each) for each in enumerate(readings)][-1]
        if probability > 0.7:
            true = simulator.pose
            aside = abs(math.remainder(heading - true.heading, 360.0))
            return math.dist((x, y), (true.x, true.y)) < 7.0 and aside < 30.0
        before = [simulator.execute(code).reply for code in COUNTERS]
        ahead = readings[0] > 9.0 and step % 3 < 2
        turn = 90.0 * (round(turned / 90.0) + 1) - turned
        simulator.execute("d1-6" if ahead else f"r1-{turn:.2f}")
        left, right, turn = (
            simulator.execute(code).reply - old for code, old in zip(COUNTERS, before, strict=True)
        )
        turned += turn
        histogram.tell("p", (left + right) / 2, turn)
    return False


def test_the_sketch_compiles(folder: Path) -> None:
    """As the Arduino IDE does it: its header before all else."""
    header = ROOT / "tests" / "arduino" / "Arduino.h"
    command = ["c++", *STRICT, f"-I{folder}", "-include", str(header), "-x", "c++", "-c", "-o", "sketch.o"]
    subprocess.run([*command, str(SKETCH / "histogram_filter.ino")], cwd=folder, check=True)


def test_it_finds_the_robot_at_the_default_start(histogram: Filter) -> None:
    assert finds(histogram, 1, (9.5, 42.0, 0.0))


def test_a_movement_shifts_each_heading_its_own_way(histogram: Filter) -> None:
    histogram.tell("s")
    for _ in range(12):
        for each in enumerate((84.0, 2.0, 0.0, 2.0)):  # an open way ahead, walls close by
            start = histogram.tell("u", *each)
    _, _, heading, before = start
    assert before > 0.1
    assert histogram.tell("p", 0.0, 90.0)[2] == (heading + 90.0) % 360.0
    assert histogram.tell("p", 0.0, -450.0)[2] == (heading) % 360.0


@pytest.mark.slow
def test_it_finds_the_robot_at_most_starts_square_to_the_walls(histogram: Filter) -> None:
    random = np.random.default_rng(5)
    rows = load().simulation.maze.cells[::-1]
    free = [(x, y) for y, row in enumerate(rows) for x, value in enumerate(row) if value]
    found = 0
    for seed in range(40):
        x, y = (12.0 * (cell + 0.5) + random.uniform(-1.5, 1.5) for cell in free[random.integers(len(free))])
        heading = 90.0 * int(random.integers(4)) + random.uniform(-4.0, 4.0)
        found += finds(histogram, seed, (x, y, heading))
    assert found >= 34, found
