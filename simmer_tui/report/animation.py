"""A run as an animated GIF, for slides: the same picture as the player's, drawn by Pillow.

Pillow is the extra `export`; it is imported only here, and only when something is drawn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct

from simmer_tui.config.mission_plan import Cell, cells_of
from simmer_tui.document import svg
from simmer_tui.document.svg import PICTURE_WIDTH
from simmer_tui.errors import ExportError
from simmer_tui.report import figure
from simmer_tui.report.keyframes import Keyframe
from simmer_tui.report.recording import Mark, MarkKind, PlayerReading, latest
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.run.scan_traces import range_step, ray_ends, ray_times
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import BLOCK, CELL_SIZE, TILE_SIZE, WALL
from simmer_tui.version import requirement
from simmer_tui.whole_file import whole_file

if TYPE_CHECKING:
    from PIL import Image, ImageDraw, ImageFont

# GIF times are in hundredths of a second, and ten pictures a second divide them evenly.
RATE = 10
"""Pictures a second."""
# All pictures are in memory until the file is written: two minutes at this rate.
_MOST_FRAMES = 1200
USUAL_SECONDS = 20.0
"""Longest GIF, seconds, unless a playback rate is asked for: a slide that loops for longer is not watched."""
# Seconds for which the last picture stays.
_HOLD = 2.0
# Pictures are drawn larger by this factor and then scaled down, so that lines are smooth.
_FINER = 2
# Colours of the palette; a GIF may have 256.
_COLORS = 96
# Height of the line of text, as a fraction of the width.
_BAR = 0.055
# Seconds for which a reading or an event is shown at a playback rate of 1.
_FRESH = 1.2
_RAY, _CONE, _CLOUD = "#554100", "#fbe3bd", "#e79be7"


class Shots(Struct, frozen=True):
    """The moments that are drawn: from `begin` until `end` (elapsed seconds), at `playback_rate` simulated
    seconds a second."""

    begin: float
    end: float
    playback_rate: float

    @property
    def times(self) -> list[float]:
        count = math.ceil((self.end - self.begin) * RATE / self.playback_rate - 1e-9)
        return [min(self.begin + each * self.playback_rate / RATE, self.end) for each in range(count + 1)]


def shots(run: RunStatistics, begin: float | None, end: float | None, playback_rate: float | None) -> Shots:
    """The moments of a run that are drawn. Raises ExportError for a stretch that the run has not, or one that
    takes too many pictures."""
    recording = run.recording
    first = recording.begin if begin is None else begin
    last = recording.end if end is None else min(end, recording.end)
    if not recording.begin <= first <= recording.end:
        raise ExportError(
            f"--from {first:g} is not in the run; it can be shown from {recording.begin:.1f} to "
            f"{recording.end:.1f} s"
        )
    if last < first:
        raise ExportError(f"--until {last:g} is before --from {first:g}")
    usual = max(1.0, math.ceil((last - first) / (USUAL_SECONDS - _HOLD)))
    made = Shots(first, last, usual if playback_rate is None else playback_rate)
    if (last - first) * RATE / made.playback_rate > _MOST_FRAMES:
        least = math.ceil((last - first) * RATE / _MOST_FRAMES)
        raise ExportError(
            f"{last - first:.0f} s at speed {made.playback_rate:g} are more than {_MOST_FRAMES} pictures; "
            f"take --speed {least} or more, or a part with --from and --until"
        )
    return made


def write_gif(run: RunStatistics, path: Path, taken: Shots, width: int) -> Iterator[int]:
    """Draw it, `width` pixels wide, pausing after each picture with how many there are; the file is
    written at the end. Raises ExportError without Pillow, OSError where nothing can be written."""
    try:
        from PIL import Image
    except ImportError:
        raise ExportError(f"a GIF needs Pillow: pip install '{requirement('export')}'") from None
    # Opened first: a path that cannot be written to is reported before minutes of drawing.
    with whole_file(path) as file:
        canvas = _Canvas(run, width, taken.playback_rate)
        times = taken.times
        palette = canvas.palette(times)
        frames: list[Image.Image] = []
        for time in times:
            frames.append(canvas.frame(time).quantize(palette=palette, dither=Image.Dither.NONE))
            yield len(frames)
        durations = [1000 // RATE] * (len(frames) - 1) + [int(1000 * _HOLD)]
        frames[0].save(file, "GIF", save_all=True, append_images=frames[1:], duration=durations, loop=0)


class _Canvas:
    """Pictures of one run; ask for them in order of time."""

    def __init__(self, run: RunStatistics, width: int, playback_rate: float) -> None:
        self.run = run
        self.recording = run.recording
        self.spec = run.configuration.simulation
        maze = self.spec.maze
        self.width = width
        self.bar = max(round(width * _BAR), 20)
        margin = max(round(width * 0.012), 4)
        self.scale = (width - 2 * margin) * _FINER / maze.width
        self.margin = margin * _FINER
        self.height = math.ceil(maze.height * self.scale / _FINER) + 2 * margin + self.bar
        self.fresh = _FRESH * max(playback_rate, 1.0)
        self._footprint = Footprint.of(self.spec.robot)
        self._sensors = {sensor.code: sensor for sensor in self.spec.sensors}
        self._ground = self._drawn_ground()
        self._trail_until = -1
        self._end = max(run.history.elapsed, 1e-9)

    # -- the ground ------------------------------------------------------------------------------

    def _new(self) -> Image.Image:
        from PIL import Image

        return Image.new("RGB", (self.width * _FINER, self.height * _FINER), figure.PAPER)

    def _drawn_ground(self) -> Image.Image:
        from PIL import ImageDraw

        image = self._new()
        draw = ImageDraw.Draw(image)
        maze = self.spec.maze
        for row, tiles in enumerate(reversed((Maze(maze).tiles == 0).tolist())):
            for column, black in enumerate(tiles):
                if black:
                    self._square(draw, column * TILE_SIZE, row * TILE_SIZE, TILE_SIZE, figure.TILES)
        task = self.run.task
        if task is not None and task.zone is not None:
            self._zone(draw, cells_of(maze, BLOCK), "LOADING", figure.LOADING, figure.LOADING_LINE)
            self._zone(draw, [task.zone], "DROP", figure.DROP, figure.DROP_LINE)
        for cell in cells_of(maze, WALL):
            x, y = cell.x - CELL_SIZE / 2, cell.y - CELL_SIZE / 2
            self._square(draw, x, y, CELL_SIZE, figure.WALLS)
        corners = (*self._at(0.0, maze.height), *self._at(maze.width, 0.0))
        draw.rectangle(corners, outline=figure.WALLS, width=self._line(2))
        return image

    def _zone(
        self, draw: ImageDraw.ImageDraw, cells: Sequence[Cell], name: str, fill: str, line: str
    ) -> None:
        for cell in cells:
            self._square(draw, cell.x - CELL_SIZE / 2, cell.y - CELL_SIZE / 2, CELL_SIZE, fill)
        if cells:
            x, y = self._at(cells[0].x - CELL_SIZE / 2 + 0.4, cells[0].y + CELL_SIZE / 2 - 0.4)
            draw.text((x, y), name, fill=line, font=_font(1.8 * self.scale))

    def _square(self, draw: ImageDraw.ImageDraw, x: float, y: float, side: float, fill: str) -> None:
        draw.rectangle((*self._at(x, y + side), *self._at(x + side, y)), fill=fill)

    def _at(self, x: float, y: float) -> tuple[float, float]:
        return self.margin + x * self.scale, self.margin + (self.spec.maze.height - y) * self.scale

    def _all_at(self, corners: FloatArray) -> list[tuple[float, float]]:
        """The corners of a polygon, (n, 2)."""
        return [self._at(x, y) for x, y in corners.tolist()]

    def _line(self, points: float) -> int:
        """A width that looks the same in pictures of any size; points are those of the report."""
        return max(round(points * _FINER * self.width / PICTURE_WIDTH), 1)

    # -- a moment --------------------------------------------------------------------------------

    def palette(self, times: list[float]) -> Image.Image:
        """The colours of all frames, from a few of them."""
        from PIL import Image

        # One palette for all pictures: GIF players flicker if it changes.
        chosen = [times[len(times) * each // 6] for each in range(6)] + times[-1:]
        strip = Image.new("RGB", (self.width, self.height * len(chosen)))
        for order, time in enumerate(chosen):
            strip.paste(self.frame(time), (0, order * self.height))
        self._ground, self._trail_until = self._drawn_ground(), -1  # its trail is drawn again
        return strip.quantize(_COLORS)

    def frame(self, now: float) -> Image.Image:
        from PIL import Image, ImageDraw

        self._go_on(now)
        image = self._ground.copy()
        draw = ImageDraw.Draw(image)
        trail = self.recording.trail(now)
        self._trail(draw, trail[-2:])
        pose = trail[-1].pose
        self._scans(draw, now)
        self._rays(draw, now)
        self._belief(draw, now)
        self._block(draw, now)
        self._body(draw, pose, svg.ROBOT_LINE, svg.BODY)
        for mark in self.recording.marks.items:
            if mark.kind is MarkKind.CONTACT and mark.point is not None and mark.elapsed <= now:
                self._cross(draw, mark, fresh=now - mark.elapsed < self.fresh)
        small = image.resize((self.width, self.height), Image.Resampling.BOX)
        self._words(ImageDraw.Draw(small), now)
        return small

    def _go_on(self, now: float) -> None:
        """Draw the trail that is new on the ground: it stays there."""
        from PIL import ImageDraw

        frames = self.recording.trail(now)[:-1]
        if len(frames) - 1 > self._trail_until:
            self._trail(ImageDraw.Draw(self._ground), frames[max(self._trail_until, 0) :])
            self._trail_until = len(frames) - 1

    def _trail(self, draw: ImageDraw.ImageDraw, frames: list[Keyframe]) -> None:
        for begin, end in pairwise(frames):
            if math.dist((begin.pose.x, begin.pose.y), (end.pose.x, end.pose.y)) > 1e-6:
                points = (self._at(begin.pose.x, begin.pose.y), self._at(end.pose.x, end.pose.y))
                draw.line(points, fill=svg.shade(begin.elapsed / self._end), width=self._line(3.5))

    def _body(self, draw: ImageDraw.ImageDraw, pose: Pose, line: str, fill: str | None) -> None:
        middle, width = self._at(pose.x, pose.y), self._line(2.2)
        if self._footprint.radius:
            around = _around(middle, self._footprint.radius * self.scale)
            draw.ellipse(around, fill=fill, outline=line, width=width)
        for corners in self._footprint.placed(pose):
            draw.polygon(self._all_at(corners), fill=fill, outline=line, width=width)
        nose = self._at(*pose.place(self._footprint.front, 0.0))
        draw.line((middle, nose), fill=line, width=self._line(3))

    def _block(self, draw: ImageDraw.ImageDraw, now: float) -> None:
        if self.spec.block_size:
            corners = self._all_at(self.recording.block_at(now).corners())
            draw.polygon(corners, fill=svg.BLOCK_FILL, outline=svg.BLOCK_LINE, width=self._line(1.5))

    def _belief(self, draw: ImageDraw.ImageDraw, now: float) -> None:
        cloud = latest(self.recording.beliefs, now)
        if cloud is None:
            return
        half = self._line(2.4) / 2
        for particle in cloud.particles:
            draw.ellipse(_around(self._at(*particle[:2]), half), fill=_CLOUD)
        self._body(draw, cloud.belief.pose, svg.BELIEF, None)

    def _rays(self, draw: ImageDraw.ImageDraw, now: float) -> None:
        newest: dict[str, PlayerReading] = {}
        for reading in reversed(self.recording.readings.items):
            if reading.elapsed <= now:
                if now - reading.elapsed > self.fresh:
                    break
                newest.setdefault(reading.code, reading)
        kinds = {code: self._sensors[code].kind for code in newest}
        seen = [
            each for each in newest.values() if kinds[each.code].is_range and not kinds[each.code].is_scan
        ]
        for reading in seen:
            sensor = self._sensors[reading.code]
            if math.isfinite(reading.true) and sensor.beam:
                half = min(sensor.beam, 180.0) / 2
                ends = [self._end_of(reading, reading.true, turn * half) for turn in (-1, -0.5, 0, 0.5, 1)]
                draw.polygon([self._end_of(reading, 0.0), *ends], fill=_CONE)
        for reading in seen:
            if math.isfinite(reading.value):
                end = self._end_of(reading, reading.value)
                draw.line((self._end_of(reading, 0.0), end), fill=_RAY, width=self._line(2))
                draw.ellipse(_around(end, self._line(8) / 2), fill=_RAY)

    def _scans(self, draw: ImageDraw.ImageDraw, now: float) -> None:
        """Dots where the beams of the newest scans ended."""
        step, half = range_step(self.spec.maze), self._line(2.4) / 2
        for code, scan in self.recording.scan_at(now).items():
            poses = [self.recording.pose_at(time) for time in ray_times(scan)]
            for place in ray_ends(scan, self._sensors[code], step, poses):
                draw.ellipse(_around(self._at(*place), half), fill=_RAY)

    def _end_of(self, reading: PlayerReading, length: float, turn: float = 0.0) -> tuple[float, float]:
        """A place that far along where a sensor looked."""
        sensor, pose = self._sensors[reading.code], self.recording.pose_at(reading.taken)
        beam = Pose(*pose.place(sensor.x, sensor.y), pose.heading + sensor.rotation + turn)
        return self._at(*beam.place(length, 0.0))

    def _cross(self, draw: ImageDraw.ImageDraw, mark: Mark, *, fresh: bool) -> None:
        assert mark.point is not None, "only contacts with a place are drawn"
        (x, y), half = self._at(*mark.point), self._line(7)
        width = self._line(5 if fresh else 3)
        draw.line((x - half, y - half, x + half, y + half), fill=svg.CONTACT, width=width)
        draw.line((x - half, y + half, x + half, y - half), fill=svg.CONTACT, width=width)
        if fresh:
            draw.ellipse(_around((x, y), 2 * half), outline=svg.CONTACT, width=width)

    def _words(self, draw: ImageDraw.ImageDraw, now: float) -> None:
        """The time, and the latest event or the present command."""
        font = _font(self.bar * 0.5)
        y = self.height - self.bar * 0.55
        left = self.margin / _FINER
        draw.text((left, y), f"{now:6.1f} s", fill=svg.INK, font=font, anchor="lm")
        mark, sent = latest(self.recording.marks, now), self.recording.command_at(now)
        text, fill = "" if sent is None else sent.text, svg.FAINT
        if mark is not None and (now - mark.elapsed < 2 * self.fresh or mark.elapsed == self.recording.end):
            bad = mark.kind in (MarkKind.CONTACT, MarkKind.FAILED, MarkKind.FAULT)
            text, fill = mark.text, svg.CONTACT if bad else svg.ROBOT_LINE
        begin = left + self.width * 0.13
        while text and begin + draw.textlength(text, font=font) > self.width - left:
            text = text[:-4].rstrip(".") + "..." if len(text) > 4 else ""
        draw.text((begin, y), text, fill=fill, font=font, anchor="lm")


def _around(middle: tuple[float, float], half: float) -> tuple[float, float, float, float]:
    """The square around a place of the picture."""
    x, y = middle
    return x - half, y - half, x + half, y + half


def _font(size: float) -> ImageFont.ImageFont | ImageFont.FreeTypeFont:
    from PIL import ImageFont

    return ImageFont.load_default(size)
