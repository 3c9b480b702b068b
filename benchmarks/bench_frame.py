"""Cost of a frame of the maze view: CPU time, and bytes on a real pseudo-terminal.

    python benchmarks/bench_frame.py [--quick] [--json FILE]

Times are medians, also as a ratio to making the lines of the same picture from finished cells, so
that machines can be compared. Bytes are counted on
the far side of a pty while the robot drives and its rays turn, in truecolor. Needs Unix for the pty.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import pty
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from rich.style import Style

from simmer_tui.sim.records import FloorPatch, Pose, RangeScan
from simmer_tui.sim.specs import CELL_SIZE, WALL, MazeSpec, RobotSpec
from simmer_tui.tui.maze.glyphs import blank_cells
from simmer_tui.tui.maze.painter import Painter
from simmer_tui.tui.maze.scene import Scene, SensorView
from simmer_tui.tui.maze.viewport import Viewport, arrange
from simmer_tui.tui.strips import changed_spans, make_strips
from simmer_tui.tui.terminal import ColorDepth, GlyphMode

MAZE = MazeSpec(
    (
        (3, 3, 1, 1, 0, 2, 0, 2),
        (3, 3, 0, 1, 1, 1, 1, 1),
        (1, 0, 2, 0, 0, 1, 0, 1),
        (1, 1, 1, 1, 1, 1, 0, 2),
    )
)
FLOOR = np.floor(2 * np.random.RandomState(5489).random_sample(512)).astype(np.uint8).reshape(32, 16).T.copy()
SENSORS = ((3.0, 0.0, 0.0), (2.12, 2.12, 45.0), (-3.0, 0.0, 180.0), (2.12, -2.12, 315.0))
ROUTE = ((9.5, 42.0), (30.0, 42.0), (42.0, 40.0), (42.0, 30.0), (66.0, 30.0), (90.0, 30.0))
BYTE_FRAMES = 60


def distance_to_wall(x: float, y: float, bearing: float) -> float:
    """Length of a ray in the sample maze, to within a hundredth of an inch."""
    steps = np.arange(0.0, 110.0, 0.01)
    columns = np.floor((x + steps * math.cos(math.radians(bearing))) / CELL_SIZE).astype(int)
    rows = MAZE.rows - 1 - np.floor((y + steps * math.sin(math.radians(bearing))) / CELL_SIZE).astype(int)
    inside = (columns >= 0) & (columns < MAZE.columns) & (rows >= 0) & (rows < MAZE.rows)
    cells = np.array(MAZE.cells)[rows.clip(0, MAZE.rows - 1), columns.clip(0, MAZE.columns - 1)]
    return float(steps[np.argmax(~inside | (cells == WALL))])


def fan(pose: Pose, x: float, y: float, rotation: float) -> RangeScan:
    """The five rays of an ultrasonic sensor with a 5 degree field of view."""
    cosine, sine = math.cos(math.radians(pose.heading)), math.sin(math.radians(pose.heading))
    origin = (pose.x + cosine * x - sine * y, pose.y + sine * x + cosine * y)
    bearings = tuple(pose.heading + rotation + offset for offset in (-2.5, -1.25, 0.0, 1.25, 2.5))
    return RangeScan(origin, bearings, tuple(distance_to_wall(*origin, bearing) for bearing in bearings))


def spot(pose: Pose, x: float, y: float, radius: float) -> FloorPatch:
    """Patch of floor that an infrared sensor at (x, y) in the robot's frame sees, inches."""
    cosine, sine = math.cos(math.radians(pose.heading)), math.sin(math.radians(pose.heading))
    centre = (pose.x + cosine * x - sine * y, pose.y + sine * x + cosine * y)
    grid = [(i, j) for i in range(-6, 7) for j in range(-6, 7) if i * i + j * j <= 36]
    points = np.array(centre) + radius / 6 * np.array(grid, dtype=float)
    tiles = np.floor(points / 3).astype(int)
    black = FLOOR[(15 - tiles[:, 1]).clip(0, 15), tiles[:, 0].clip(0, 31)] == 0
    return FloorPatch(centre, radius, points, black)


def sample_scene(pose: Pose, trail: np.ndarray, radius: float = 0.36) -> Scene:
    """The course's maze, its robot at a pose, four ultrasonic and four infrared readings."""
    views = [SensorView(fan(pose, *sensor)) for sensor in SENSORS]
    places = ((2.0, 0.0), (0.0, 2.0), (-2.0, 0.0), (0.0, -2.0))
    views.extend(SensorView(spot(pose, *place, radius)) for place in places)
    return Scene(
        maze=MAZE,
        floor=FLOOR,
        robot=RobotSpec.circle(6),
        pose=pose,
        block_centre=(25.0, 41.0),
        trail=(trail,),
        views=tuple(views),
    )


def drive(frames: int) -> list[Scene]:
    """Scenes of a drive along the route, 0.6 in and 6 degrees a frame, back and forth."""
    corners = np.array(ROUTE)
    lengths = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))))
    scenes: list[Scene] = []
    trail: list[tuple[float, float]] = []
    for frame in range(frames):
        along = abs((0.6 * frame + lengths[-1]) % (2 * lengths[-1]) - lengths[-1])
        x, y = (float(np.interp(along, lengths, corners[:, axis])) for axis in (0, 1))
        trail.append((x, y))
        scenes.append(sample_scene(Pose(x, y, 6.0 * frame), np.array(trail[-100:])))
    return scenes


def median_milliseconds(action: Callable[[int], object], repeats: int) -> float:
    times = []
    for turn in range(repeats):
        start = time.process_time()
        action(turn)
        times.append(1000 * (time.process_time() - start))
    return statistics.median(times)


class Screen:
    """The widget's work between two frames, without an app around it."""

    def __init__(self, painter: Painter, viewport: Viewport, scenes: list[Scene]) -> None:
        self.painter = painter
        self.viewport = viewport
        self.scenes = scenes
        self.style = Style(color="white", bgcolor="black")
        self.cells = blank_cells(viewport.rows, viewport.columns)

    def show(self, turn: int) -> None:
        cells = self.painter.cells(self.scenes[turn], self.viewport)
        make_strips(cells, [span.y for span in changed_spans(self.cells, cells)], self.style)
        self.cells = cells

    def repaint(self, _turn: int) -> None:
        make_strips(self.cells, range(self.viewport.rows), self.style)


def measure_times(frames: int) -> Iterator[dict[str, float | str]]:
    scenes = drive(frames)
    for zoom in (8.0, 16.0, 24.0):
        viewport = arrange(MAZE, zoom, 1000, 1000).viewport(MAZE, 0, 0)
        for glyphs, depth in (
            (GlyphMode.QUADRANT, ColorDepth.TRUECOLOR),
            (GlyphMode.QUADRANT, ColorDepth.COLORS_256),
            (GlyphMode.ASCII, ColorDepth.NONE),
        ):
            screen = Screen(Painter(glyphs, depth), viewport, scenes)
            cost = median_milliseconds(screen.show, frames)
            baseline = median_milliseconds(screen.repaint, frames)
            yield {
                "cells": f"{viewport.columns}x{viewport.rows}",
                "glyphs": glyphs.value,
                "color": depth.value,
                "milliseconds": round(cost, 2),
                "ratio to a static repaint": round(cost / baseline, 2),
            }


def run_app(frames: int, deltas: bool) -> None:
    """In the child: show `frames` scenes in a maze view, one after each refresh, and leave."""
    from textual.app import App, ComposeResult

    from simmer_tui.tui.maze.view import MazeView
    from simmer_tui.tui.textual_internals import delta_updates

    scenes = iter(drive(frames))

    class Bench(App[None]):
        def compose(self) -> ComposeResult:
            yield MazeView()

        def on_ready(self) -> None:
            self.set_interval(1 / 20, self.step)

        def step(self) -> None:
            scene = next(scenes, None)
            if scene is None:
                self.exit()
            else:
                self.query_one(MazeView).show(scene)

    if deltas:
        with delta_updates():
            Bench().run()
    else:
        Bench().run()


def bytes_on_pty(frames: int, columns: int, rows: int, *, deltas: bool) -> int:
    """Everything the app sends in a run of `frames` frames."""
    master, slave = pty.openpty()
    environment = dict(os.environ, COLUMNS=str(columns), LINES=str(rows), TERM="xterm-256color")
    environment["TEXTUAL_COLOR_SYSTEM"] = "truecolor"
    environment.pop("NO_COLOR", None)
    command = [sys.executable, __file__, "--child", str(frames), *(["--deltas"] if deltas else [])]
    child = subprocess.Popen(command, stdin=slave, stdout=slave, stderr=slave, env=environment)
    os.close(slave)
    total = 0
    while True:
        try:
            total += len(os.read(master, 1 << 16))
        except OSError:  # how Linux reports that the other side is closed
            break
    os.close(master)
    if child.wait() != 0:
        raise SystemExit("the app in the pty failed")
    return total


def measure_bytes(frames: int) -> Iterator[dict[str, float | str]]:
    for columns, rows, shown in ((72, 20, "64x16"), (136, 36, "128x32"), (200, 52, "192x48")):
        for deltas in (False, True):
            few = bytes_on_pty(2, columns, rows, deltas=deltas)
            many = bytes_on_pty(2 + frames, columns, rows, deltas=deltas)
            yield {
                "cells": shown,
                "written as deltas": "yes" if deltas else "no",
                "kilobytes a frame": round((many - few) / frames / 1000, 1),
                "kilobytes to start": round(few / 1000, 1),
            }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer frames")
    parser.add_argument("--json", metavar="FILE", help="also write the numbers here")
    parser.add_argument("--child", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--deltas", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child is not None:
        run_app(options.child, options.deltas)
        return
    results: dict[str, list[dict[str, float | str]]] = {"time": [], "bytes": []}
    for name, measure, frames in (
        ("time", measure_times, 30 if options.quick else 200),
        ("bytes", measure_bytes, 10 if options.quick else BYTE_FRAMES),
    ):
        for row in measure(frames):
            results[name].append(row)
            print("  ".join(f"{key} {value}" for key, value in row.items()), flush=True)
    if options.json:
        Path(options.json).write_text(json.dumps(results, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
