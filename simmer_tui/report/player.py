"""The player of a run within its page: the recording as JSON, and the script that plays it.

A log is text from outside: of the recording nothing can end the element it stands in, and the script
shows it as text only.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import asdict
from importlib.resources import files
from typing import Any

from simmer_tui.report.recording import Recording
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.report.traces import clock
from simmer_tui.run.attempt import task_of
from simmer_tui.run.facts import deviation
from simmer_tui.run.paths import BeliefCloud
from simmer_tui.sim.command import printable
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import SimulationSpec

PlainNumber = float | str | None
"""A number in the recording: finite, beyond all numbers, or none at all."""
# Times are whole milliseconds, places hundredths of an inch, headings tenths of a degree.
# Whole numbers are shorter in JSON than decimals, and finer ones would not show.
_MILLI = 1000
_PLACE, _HEADING, _CLOUD = 100, 10, 10


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
    return f"{recording}<script>{_asset('player.js')}</script>"


def shortened(recording: Recording) -> str:
    """A note on parts of the run that the player leaves out, or empty."""
    notes = []
    if recording.begin > 0.0:
        notes.append(
            f"The player has the last {recording.end - recording.begin:.0f} of {recording.end:.0f} s; "
            "simmer-tui replay has all of it."
        )
    if recording.one_particle_in > 1:
        notes.append(f"Of a belief's particles it shows one in {recording.one_particle_in}.")
    if recording.earlier_marks:
        notes.append(f"{recording.earlier_marks} earlier marks are left out on its clock.")
    return " ".join(notes)


def _recording(run: RunStatistics) -> dict[str, Any]:
    """All that the player needs."""
    recording = run.recording
    task, strips = task_of(run.configuration, run.header.seed), clock(run)
    return {
        "begin": _ms(recording.begin),
        "end": _ms(recording.end),
        "limit": task.time_limit if task is not None else None,
        **_robot(recording.spec),
        **_columns(recording),
        **_rows(recording),
        "clock": None if strips is None else asdict(strips),
    }


def _robot(spec: SimulationSpec) -> dict[str, Any]:
    """Maze, robot, block and sensors."""
    return {
        "maze": [spec.maze.width, spec.maze.height],
        "radius": spec.robot.radius,
        "vertices": spec.robot.vertices,
        "front": Footprint.of(spec.robot).front,
        "block": spec.block_size,
        "sensors": [
            {
                "code": sensor.code,
                "name": sensor.id,
                "unit": sensor.unit,
                "at": [sensor.x, sensor.y, sensor.rotation],
                "view": sensor.field_of_view,
                "kind": "range" if sensor.kind.is_range else "yes" if sensor.is_yes_or_no else "",
                "counts": sensor.kind.counts,
            }
            for sensor in spec.sensors
        ],
    }


def _columns(recording: Recording) -> dict[str, Any]:
    """Tables by column, of which there are thousands of rows. Those that grow, such as times, hold
    differences, which are short numbers."""
    frames = recording.keyframes
    places = {sensor.code: place for place, sensor in enumerate(recording.spec.sensors)}
    read = [
        each for each in recording.readings.items if each.code in places and each.elapsed >= recording.begin
    ]
    return {
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


def _rows(recording: Recording) -> dict[str, Any]:
    """Tables by row: beliefs, places of the block, marks and commands."""
    begin = recording.begin
    return {
        "beliefs": [_belief(each) for each in recording.beliefs.items if each.elapsed >= begin],
        "blocks": [
            [_ms(each.elapsed), int(each.held), *_place(Pose(each.block.x, each.block.y, each.block.heading))]
            for each in recording.blocks.items
        ],
        "marks": [
            (_ms(each.elapsed), each.kind.value, each.text, *_rounded(each.point or ()))
            for each in recording.marks.items
            if each.elapsed >= begin
        ],
        "commands": [[_ms(each.elapsed), each.text] for each in recording.commands.items],
    }


def _belief(cloud: BeliefCloud) -> list[Any]:
    """Time, pose, error (inches, degrees), spread, note and particles."""
    pose, spread, off = cloud.belief.pose, cloud.belief.spread, deviation(cloud.belief)
    particles = [round(number * _CLOUD) for each in cloud.particles for number in each[:2]]
    return [
        _ms(cloud.elapsed),
        *_place(pose),
        *_rounded((off.distance, off.turn)),
        _shown(math.nan if spread is None else spread),
        printable(cloud.belief.note[:200]),
        particles,
    ]


def _place(pose: Pose) -> list[int]:
    return [round(pose.x * _PLACE), round(pose.y * _PLACE), round(pose.heading * _HEADING)]


def _rounded(numbers: Iterable[float]) -> list[PlainNumber]:
    return [_shown(each) for each in numbers]


def _shown(value: float) -> PlainNumber:
    """A number as it is shown; one beyond all numbers as a text, none at all as null."""
    if math.isnan(value):
        return None
    return float(f"{value:.5g}") if math.isfinite(value) else str(value)


def _ms(elapsed: float) -> int:
    return round(elapsed * _MILLI)


def _differences(numbers: Iterable[int]) -> list[int]:
    before, made = 0, []
    for each in numbers:
        made.append(each - before)
        before = each
    return made


def _asset(name: str) -> str:
    return files("simmer_tui.report").joinpath(name).read_text(encoding="utf-8")
