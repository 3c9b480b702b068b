"""Events as short JSON: every field by name, but of a path only its numbers and of a sensor only its code."""

from __future__ import annotations

import math
from enum import Enum
from typing import Any

import numpy as np
from msgspec import Struct, structs

from simmer_tui.sim import Command, CommandResult, Pose
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.records import LidarScan, Reading
from simmer_tui.sim.specs import SensorSpec
from simmer_tui.sim.trajectory import Trajectory
from tests.kept_numbers import Fields, usual_of


def brief(value: Any) -> Any:
    """An event, or a field of one, without fields that are empty, false or zero by default."""
    match value:
        case Command():
            marks = f" {value.problem}" if value.problem else ""
            marks += f" as {value.code}" if value.stops else ""
            return f"{value.text} from {value.source}{' stops' if value.stops else ''}{marks}"
        case Pose():
            return [brief(each) for each in (value.x, value.y, value.heading)]
        case SensorSpec():
            return value.code
        case Trajectory():
            return _trajectory(value)
        case Leg():
            fields = (value.end_time, value.last_pose, value.pressed, value.contact, value.arc.rate)
            return [brief(each) for each in fields]
        case LidarScan():
            arrays = (value.ranges, value.bearings, value.poses)
            return [value.revolution, *map(sums, arrays), list(value.poses.shape)]
        case Reading():
            return [brief(each) for each in (value.sensor, value.value, value.true, value.took, value.scan)]
        case CommandResult():
            # The event of the movement's end has its path.
            same = ("before",) if value.before == value.pose else ()
            return _fields(value, "trajectory", *same)
        case Struct():
            return _fields(value)
        case Enum():
            return value.value
        case float():
            return _number(value)
        case tuple() | list():
            return [brief(each) for each in value]
    return value


def _fields(value: Struct, *without: str) -> Fields:
    """The fields that are not empty, false or zero, or whose default is not, beside the name of the class."""
    return Fields({"is": type(value).__name__, **(named := fields(value, *without))}, named.usual)


def fields(value: Struct, *without: str) -> Fields:
    """The same without the name of the class."""
    usual = {name: brief(each) for name, each in usual_of(value).items() if name not in without}
    found = {name: brief(getattr(value, name)) for name in value.__struct_fields__ if name not in without}
    shown = {
        name: each for name, each in found.items() if not _is_empty(each) or not _is_empty(usual.get(name))
    }
    return Fields(shown, usual)


def _is_empty(value: Any) -> bool:
    return value in (None, "", [], {}, 0.0)


def _number(value: float) -> float | str:
    return round(value, 6) + 0.0 if math.isfinite(value) else str(value)


def _trajectory(path: Trajectory) -> list[Any]:
    half = (path.start_time + path.end_time) / 2
    stop = None if path.rest_stop is None else structs.astuple(path.rest_stop)
    numbers = (path.end_time, path.cut, path.travelled(path.end_time), path.pose_at(half))
    return [*map(brief, (*numbers, path.contact, stop))]


def sums(numbers: Any) -> list[Any]:
    """The length of an array, the sum of its finite numbers, and the sum by place."""
    flat = np.asarray(numbers, float).ravel()
    flat = np.where(np.isfinite(flat), flat, 999.0)
    return [len(flat), _number(float(flat.sum())), _number(float((flat * np.arange(len(flat))).sum()))]
