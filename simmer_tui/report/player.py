"""The player of a run within its page: the recording as JSON, and the script that plays it.

A log is text from outside: nothing in the recording can end the element that holds it, and the script shows
it as text only.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from importlib.resources import files
from itertools import pairwise
from typing import Any

from msgspec.structs import asdict

from simmer_tui.document import svg
from simmer_tui.errors import printable
from simmer_tui.report.figure import path_end
from simmer_tui.report.recording import Recording
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.report.traces import page_clock
from simmer_tui.run.belief_grid import GridBelief, SmallMap
from simmer_tui.run.facts import deviation
from simmer_tui.run.history_rows import DisplayRow
from simmer_tui.run.paths import BeliefCloud
from simmer_tui.run.scan_traces import ScanTrace, range_step
from simmer_tui.run.table import Newest, TimedItem
from simmer_tui.sim.block import Block
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import CELL_SIZE, WALL, SensorSpec, SimulationSpec
from simmer_tui.sketch.board_view import logged_view

PlainNumber = float | str | None
"""A number in the recording: finite, an infinity as text, or null."""
# Times are whole milliseconds, places hundredths of an inch, headings tenths of a degree.
# Whole numbers are shorter in JSON than decimals, and finer ones would not show.
_MILLI = 1000
_PLACE, _HEADING, _CLOUD = 100, 10, 10
# Two characters each: six minutes of a lidar of 360 rays and 5.5 turns a second are 1.5 MB.
SCAN_RAYS = 720_000
"""Most rays of all scans of a page."""


def player_style() -> str:
    """The rules of the player's looks."""
    return _asset("player.css")


def player_script(run: RunStatistics) -> str:
    """The recording and the script that plays it, for a page with the pictures of a run."""
    data = json.dumps(_recording(run), separators=(",", ":"), allow_nan=False)
    # A log may hold </script>; escaped like this JSON still means the same.
    for mark in "<>&":  # nothing in it may be taken for markup
        data = data.replace(mark, f"\\u{ord(mark):04x}")
    recording = f"<script type='application/json' id='recording'>{data}</script>"
    return f"{recording}<script>{player_code()}</script>"


def player_code() -> str:
    """The script that plays a recording, the page's own or one that grows."""
    return _asset("player.js")


def left_out_text(recording: Recording) -> str:
    """A note on parts of the run that the player leaves out, or empty."""
    notes = []
    if recording.begin > 0.0:
        notes.append(
            f"The player has the last {recording.end - recording.begin:.0f} of {recording.end:.0f} s; "
            "simmer-tui replay has all of it."
        )
    if recording.one_particle_in > 1:
        notes.append(f"Of a belief's particles it shows one in {recording.one_particle_in}.")
    one_scan_in = _one_in(each for each in recording.scans.items if each.elapsed >= recording.begin)
    if one_scan_in > 1:
        notes.append(f"Of the scans of lidars it shows one in {one_scan_in}.")
    if recording.earlier_marks:
        notes.append(f"{recording.earlier_marks} earlier marks are left out on its clock.")
    return " ".join(notes)


def _recording(run: RunStatistics) -> dict[str, Any]:
    """All that the player needs."""
    recording = run.recording
    task, strips = run.task, page_clock(run)
    return {
        "moment": _ms(min(max(run.verdict.elapsed, recording.begin), recording.end)),
        "limit": task.time_limit if task is not None else None,
        **recorded_robot(recording.spec),
        **RecordingEncoder(recording).news(),
        "clock": None if strips is None else asdict(strips),
        "shades": [svg.shade(step / svg.SHADES) for step in range(svg.SHADES + 1)],
        "path_end": path_end(run),
        "moments": [[_ms(each.elapsed), each.text, int(each.is_cause)] for each in run.verdict.moments],
    }


def recorded_robot(spec: SimulationSpec) -> dict[str, Any]:
    """Maze, robot, block and sensors for the player: all that does not change."""
    return {
        "maze": [spec.maze.width, spec.maze.height],
        "cell": CELL_SIZE,
        "open": [
            [column * CELL_SIZE, (spec.maze.rows - 1 - row) * CELL_SIZE]
            for row, cells in enumerate(spec.maze.cells)
            for column, cell in enumerate(cells)
            if cell != WALL
        ],
        "radius": spec.robot.radius,
        "vertices": spec.robot.vertices,
        "front": Footprint.of(spec.robot).front,
        "block": spec.block_size,
        "step": range_step(spec.maze),
        "sensors": [
            {
                "code": sensor.code,
                "name": sensor.id,
                "unit": sensor.unit,
                "at": [sensor.x, sensor.y, sensor.rotation],
                "view": sensor.beam or 0.0,
                "kind": _kind(sensor),
                "counts": sensor.kind.counts,
            }
            for sensor in spec.sensors
        ],
    }


def _kind(sensor: SensorSpec) -> str:
    if sensor.kind.is_scan:
        return "scan"
    return "range" if sensor.kind.is_range else "yes" if sensor.is_yes_or_no else ""


class RecordingEncoder:
    """Encodes a recording for players, part by part: the first time all of it, then the new part."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._places = {sensor.code: place for place, sensor in enumerate(recording.spec.sensors)}
        self._moves = self._unsettled = 0
        self._seen: dict[str, int] = {}

    def news(self) -> dict[str, Any]:
        """The part that is new. Times are milliseconds; since `begin` none is missing.

        Of the keyframes sent before, the last `drop` are replaced, and those before `since` are no longer
        kept. `one_in` particles is shown of those sent before, too.
        """
        recording = self._recording
        return {
            "begin": _ms(recording.begin),
            "end": _ms(recording.end),
            "since": _ms(recording.moves_begin),
            "one_in": recording.one_particle_in,
            **self._columns(),
            **self._rows(),
        }

    def _columns(self) -> dict[str, Any]:
        """Tables by column, of which there are thousands of rows. Those that grow, such as times, hold
        differences, which are short numbers."""
        recording = self._recording
        unsettled = recording.unsettled_keyframes
        frames = [*recording.keyframes_after(self._moves), *unsettled]
        drop, self._unsettled, self._moves = self._unsettled, len(unsettled), recording.moves
        places = self._places
        read = [each for each in self._new("readings", recording.readings) if each.code in places]
        return {
            "drop": drop,
            "frames": {
                "t": _differences(_ms(each.elapsed) for each in frames),
                "x": _differences(round(each.pose.x * _PLACE) for each in frames),
                "y": _differences(round(each.pose.y * _PLACE) for each in frames),
                "h": _differences(round(each.pose.heading * _HEADING) for each in frames),
            },
            "readings": {
                "sensor": [places[each.code] for each in read],
                "t": _differences(_ms(each.elapsed) for each in read),
                "took": [_ms(each.elapsed) - _ms(each.taken) for each in read],
                "value": [_shown(each.value) for each in read],
                "true": [_shown(each.true) for each in read],
            },
        }

    def _rows(self) -> dict[str, Any]:
        """Tables by row: beliefs, places of the block, what boards show, marks and commands. `doing` is the
        command of the movement under way."""
        recording = self._recording
        doing = recording.under_way
        return {
            "beliefs": [_belief(each) for each in self._new("beliefs", recording.beliefs)],
            "blocks": [
                [_ms(each.elapsed), int(each.held), *_place(each.block)]
                for each in self._new("blocks", recording.blocks, since=0.0)
            ],
            "displays": [_display(each) for each in self._new("displays", recording.displays, since=0.0)],
            "scans": [
                [
                    self._places[each.code],
                    *map(_ms, (each.elapsed, each.begin, each.span)),
                    round(each.first * _HEADING),
                    _shown(each.turn),
                    each.ranges,
                ]
                for each in thinned(self._new("scans", recording.scans))
                if each.code in self._places
            ],
            "marks": [
                (_ms(each.elapsed), each.kind.value, each.text, *_rounded(each.point or ()))
                for each in self._new("marks", recording.marks)
            ],
            "commands": [
                [_ms(each.elapsed), each.text]
                for each in self._new("commands", recording.commands, since=0.0)
            ],
            "doing": None if doing is None else [_ms(doing.elapsed), doing.text],
        }

    def _new(self, name: str, kept: Newest[TimedItem], since: float | None = None) -> list[TimedItem]:
        """The items of a table that have come since the last time; the first time none from before the
        recording's beginning, or before `since`."""
        begin = self._recording.begin if since is None else since
        new = kept.after(self._seen.get(name, 0))
        self._seen[name] = kept.first.given
        return [each for each in new if each.elapsed >= begin]


def thinned(scans: Sequence[ScanTrace]) -> Sequence[ScanTrace]:
    """Scans, evenly thinned to the number of rays that a page has room for, with the newest among them."""
    return scans[::-1][:: _one_in(scans)][::-1]


def _one_in(scans: Iterable[ScanTrace]) -> int:
    return max(math.ceil(sum(each.rays for each in scans) / SCAN_RAYS), 1)


def _belief(cloud: BeliefCloud) -> list[Any]:
    """Time, pose, error (inches, degrees), spread, note and particles. A grid also has its bounds, a flag for
    headings, its numbers, and its map unless the log has left that out."""
    pose, spread, off = cloud.belief.pose, cloud.belief.spread, deviation(cloud.belief)
    particles = [round(number * _CLOUD) for each in cloud.particles for number in each[:2]]
    return [
        _ms(cloud.elapsed),
        *_place(pose),
        *_rounded((off.distance, off.turn)),
        _shown(math.nan if spread is None else spread),
        printable(cloud.belief.note[:200]),
        particles,
        *([] if cloud.belief.grid is None else [_grid(cloud.belief.grid, cloud.heat)]),
    ]


def _display(row: DisplayRow) -> list[Any]:
    """Time, board, the pin of its LED, 1 if that is on, and the rows on each of its displays."""
    view = logged_view(row.event)
    return [_ms(row.elapsed), view.name, view.led_pin, int(view.led), view.displays]


def _grid(grid: GridBelief, heat: SmallMap | None) -> list[Any]:
    numbers = (100 * grid.best_probability, 100 * grid.true_probability, grid.entropy)
    shown = [] if heat is None else [heat.rows, heat.columns, heat.runs]
    return [*_rounded(grid.bounds), int(grid.has_headings), *_rounded(numbers), *shown]


def _place(pose: Pose | Block) -> list[int]:
    return [round(pose.x * _PLACE), round(pose.y * _PLACE), round(pose.heading * _HEADING)]


def _rounded(numbers: Iterable[float]) -> list[PlainNumber]:
    return [_shown(each) for each in numbers]


def _shown(value: float) -> PlainNumber:
    """A number as it is shown: an infinity as text, NaN as null."""
    if math.isnan(value):
        return None
    return float(f"{value:.5g}") if math.isfinite(value) else str(value)


def _ms(elapsed: float) -> int:
    return round(elapsed * _MILLI)


def _differences(numbers: Iterable[int]) -> list[int]:
    return [after - before for before, after in pairwise((0, *numbers))]


def _asset(name: str) -> str:
    return files("simmer_tui.report").joinpath(name).read_text(encoding="utf-8")
