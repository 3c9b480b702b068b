"""Faults of a team's own devices: a message with file and line in place of an exception.

The simulator then leaves the command unanswered, and the run continues. A movement must not fail: the fault
of a counter is kept, and told by its readings.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from types import FrameType, TracebackType
from typing import Any

import numpy as np

from simmer_tui.errors import DeviceError
from simmer_tui.sim.command import cut
from simmer_tui.sim.records import FloorPatch, RangeScan

# An exception may quote a whole array.
_LONGEST = 200
"""Characters of an error that are shown."""
_NONE: AbstractContextManager[None] = nullcontext()


def located(path: str, what: str, error: BaseException, kind: str = "") -> DeviceError:
    """The message about an exception of a device file, with the line: `what` raised it; if that is empty, the
    method of the file. The result of a `kind` is wrong if no line of the file raised it."""
    trace = _frames(error.__traceback__)
    frames = [(frame, line) for frame, line in trace if frame.f_code.co_filename == path]
    try:
        told = cut(" ".join(str(error).split()), _LONGEST)
    except Exception:  # noqa: BLE001 - an exception of the team's own, whose text fails too
        told = "(its text cannot be shown)"
    if kind and not frames:
        form = "must be a number, and observe() must return it as in (21.5, None)"
        return DeviceError(f"{path}: a reading of {kind} {form}: {told}")
    where = f"{path}:{frames[-1][1]}" if frames else path
    what = what or (frames[0][0].f_code.co_qualname if frames else "a part of it")
    if isinstance(error, NotImplementedError):
        return DeviceError(f"{where}: {what} is not written yet{f': {told}' if told else ''}")
    return DeviceError(f"{where}: {what} raised {cut(type(error).__name__)}{f': {told}' if told else ''}")


def _frames(trace: TracebackType | None) -> Iterator[tuple[FrameType, int]]:
    while trace is not None:
        yield trace.tb_frame, trace.tb_lineno
        trace = trace.tb_next


def faults_of(sensor: Any, *, kept: bool = False) -> AbstractContextManager[None]:
    """Context in which an exception of a team's own sensor is a DeviceError; with `kept` its readings raise
    that later."""
    return _faults(sensor, kept) if sensor.is_opaque else _NONE


@contextmanager
def _faults(sensor: Any, kept: bool) -> Iterator[None]:
    try:
        if not kept and sensor.fault:
            raise DeviceError(sensor.fault)
        yield
    except (DeviceError, KeyboardInterrupt):
        raise
    # All exceptions: neither sys.exit() nor an unexpected exception may end the simulator.
    except BaseException as error:  # noqa: BLE001
        kind = type(sensor)
        fault = located(str(sys.modules[kind.__module__].__file__), "", error, cut(kind.__name__))
        if not kept:
            raise fault from None
        sensor.fault = sensor.fault or str(fault)


def plain_number(value: Any) -> float:
    """A number, infinite perhaps, as a float. Raises TypeError, ValueError, OverflowError."""
    number = float(value)
    if math.isnan(number):
        raise ValueError("NaN is none; for no reading return math.inf")
    return number


def plain_view(view: object) -> RangeScan | FloorPatch | None:
    """The geometry beside a reading, in plain numbers; anything else is not drawn. Raises TypeError,
    ValueError."""
    if isinstance(view, RangeScan):
        x, y = map(plain_number, view.origin)
        bearings, distances = (tuple(map(plain_number, each)) for each in (view.bearings, view.distances))
        if len(bearings) != len(distances):
            raise ValueError("a RangeScan has a distance for each bearing")
        return RangeScan((x, y), bearings, distances)
    if isinstance(view, FloorPatch):
        x, y = map(plain_number, view.centre)
        points, black = np.asarray(view.points, np.float64), np.asarray(view.black, np.bool_)
        return FloorPatch((x, y), plain_number(view.radius), points.reshape(len(black), 2), black)
    return None
