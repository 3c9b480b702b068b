"""Guards around the methods of a team's own device: a fault in one becomes a message with file and line.

A method that raises, and one whose result is not a reading, raise `DeviceError` here. The simulator then
leaves the command unanswered, and the run continues. Counting sensors are called while movements are planned,
which must not fail. So their fault is kept, and raised by their readings.
"""

from __future__ import annotations

import functools
import math
import numbers
from collections.abc import Callable, Iterable, Mapping, Sequence
from threading import current_thread, main_thread
from types import FunctionType, TracebackType
from typing import Any

import numpy as np

from simmer_tui.errors import DeviceError
from simmer_tui.sim.command import cut
from simmer_tui.sim.records import FloorPatch, RangeScan
from simmer_tui.sim.sensors import CountingSensor, Sensor

# A lidar of the course has 360 rays, and a line sensor 113 test points.
_MOST_RAYS, _MOST_POINTS = 2000, 10_000
"""Most rays, and most points of floor, of a reading."""
# An exception may quote a whole array.
_LONGEST = 200
"""Characters of an error that are shown."""
_MARK = "_simmer_guard"
"""Attribute of functions that are already guarded."""
_FAULT = "_simmer_fault"
"""Attribute of a counting sensor with the fault that its readings raise."""


class _RubbishError(Exception):
    """A method returned a wrong result; the message says what it must return."""


def located(path: str, what: str, error: BaseException) -> DeviceError:
    """The message about an exception that code of a device file raised in `what`, with the line."""
    lines = [line for file, line in _frames(error.__traceback__) if file == path]
    where = f"{path}:{lines[-1]}" if lines else path
    try:
        told = cut(" ".join(str(error).split()), _LONGEST)
    except Exception:  # noqa: BLE001 - an exception of the team's own, whose text fails too
        told = "(its text cannot be shown)"
    if isinstance(error, NotImplementedError):
        return DeviceError(f"{where}: {what} is not written yet{f': {told}' if told else ''}")
    name = cut(type(error).__name__)
    return DeviceError(f"{where}: {what} raised {name}{f': {told}' if told else ''}")


def _frames(trace: TracebackType | None) -> Iterable[tuple[str, int]]:
    while trace is not None:
        yield trace.tb_frame.f_code.co_filename, trace.tb_lineno
        trace = trace.tb_next


def guard(path: str, module: str, kinds: Iterable[type[Sensor]]) -> None:
    """Guard all methods of kinds that a device file at a path in the set defines, in its module."""
    for kind in kinds:
        for base in kind.__mro__:
            if base.__module__ == module:
                _guard_class(path, base, soft=issubclass(kind, CountingSensor))
        if issubclass(kind, CountingSensor):
            _tell_faults(kind)


def _guard_class(path: str, owner: type, *, soft: bool) -> None:
    for name, member in list(vars(owner).items()):
        is_static = isinstance(member, staticmethod | classmethod)
        function = member.__func__ if is_static else member
        if not isinstance(function, FunctionType) or (name.startswith("__") and name != "__init__"):
            continue
        if hasattr(function, _MARK):
            continue
        check = _CHECKS.get(name)
        made: Any = _guarded(path, f"{owner.__name__}.{name}", function, check)
        if soft and name in _SOFT:
            made = _softened(made, _SOFT[name])
        setattr(made, _MARK, True)
        setattr(owner, name, type(member)(made) if is_static else made)


def _guarded(
    path: str, what: str, function: Callable[..., Any], check: Callable[..., Any] | None
) -> Callable[..., Any]:
    """A method that raises DeviceError instead of any other exception, and checks its result."""

    @functools.wraps(function)
    def guarded(*given: Any, **named: Any) -> Any:
        try:
            if check is None:
                return function(*given, **named)
            row = given[0].spec
            result = function(*given, **named)
            if given[0].spec is not row:
                given[0].spec = row
                raise _RubbishError("without changing self.spec, which is the row of sensors.csv")
            return check(result, given[1:])
        except DeviceError:
            raise
        except _RubbishError as rubbish:
            line = function.__code__.co_firstlineno
            raise DeviceError(f"{path}:{line}: {what} must return {rubbish}") from None
        # All exceptions: neither sys.exit() nor an unexpected exception may end the simulator.
        except BaseException as error:
            # Ctrl-C is raised in the main thread only; in other threads the device raised it.
            if isinstance(error, KeyboardInterrupt) and current_thread() is main_thread():
                raise
            raise located(path, what, error) from None

    return guarded


# -- counting sensors --------------------------------------------------------------------------------


def _softened(function: Callable[..., Any], instead: Callable[..., Any]) -> Callable[..., Any]:
    """A method that keeps its first fault and continues with zeros."""

    @functools.wraps(function)
    def softened(self: Any, *given: Any, **named: Any) -> Any:
        try:
            return function(self, *given, **named)
        except DeviceError as error:
            if not hasattr(self, _FAULT):
                setattr(self, _FAULT, str(error))
            return instead(given)

    return softened


def _tell_faults(kind: type[Sensor]) -> None:
    """Make readings of a counting kind raise the fault that was kept."""
    read = kind.reading
    if hasattr(read, "_simmer_tells"):
        return

    @functools.wraps(read)
    def reading(self: Any, *given: Any, **named: Any) -> float:
        if hasattr(self, _FAULT):
            raise DeviceError(getattr(self, _FAULT))
        return read(self, *given, **named)

    reading._simmer_tells = True  # type: ignore[attr-defined]
    setattr(reading, _MARK, True)
    kind.reading = reading  # type: ignore[method-assign]


_SOFT: Mapping[str, Callable[[Sequence[Any]], Any]] = {
    "increments": lambda given: np.zeros(np.shape(given[2])),
    "counted": lambda given: 0.0,
    "counted_on": lambda given: 0.0,
}

# -- results -----------------------------------------------------------------------------------------


def _number(value: object) -> float:
    """A number, infinite perhaps, as a float."""
    if isinstance(value, np.bool_):
        return float(value)
    if not isinstance(value, numbers.Real):
        raise _RubbishError(f"a number, not {_shown(value)}")
    try:
        number = float(value)
    except (OverflowError, ValueError, TypeError):
        raise _RubbishError("a number of a size that can be sent, not one beyond 1e308") from None
    if math.isnan(number):
        raise _RubbishError("a number, not NaN (for no reading return math.inf)")
    return number


def _shown(value: object) -> str:
    """A wrong result for a message: its type, and for a small plain one its text."""
    name = cut(type(value).__name__)
    if value is None:
        return "None (is a return missing?)"
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    if isinstance(value, str | complex):
        return f"the {name} {cut(repr(value[:40] if isinstance(value, str) else value))}"
    return f"a {name}"


def _scalar(value: object, _: Sequence[Any]) -> float:
    return _number(value)


def _observed(value: object, _: Sequence[Any]) -> tuple[float, RangeScan | FloorPatch | None]:
    if not isinstance(value, tuple) or len(value) != 2:
        raise _RubbishError(f"a number and what is drawn, such as (21.5, None), not {_shown(value)}")
    number, view = value
    if isinstance(view, RangeScan):
        return _number(number), _rays(view)
    if isinstance(view, FloorPatch):
        return _number(number), _patch(view)
    if view is not None:
        raise _RubbishError(f"None, a RangeScan or a FloorPatch beside its number, not {_shown(view)}")
    return _number(number), None


def _rays(view: RangeScan) -> RangeScan:
    """Rays that can be drawn and logged."""
    try:
        if not len(view.bearings) == len(view.distances) <= _MOST_RAYS:
            raise _RubbishError(f"a RangeScan with a distance for each bearing, at most {_MOST_RAYS}")
        x, y = map(_finite, view.origin)
        return RangeScan((x, y), tuple(map(_finite, view.bearings)), tuple(map(_number, view.distances)))
    except (TypeError, ValueError):
        raise _RubbishError("a RangeScan of numbers: origin (x, y), bearings, distances") from None


def _patch(view: FloorPatch) -> FloorPatch:
    """A patch of floor that can be drawn."""
    try:
        x, y = map(_finite, view.centre)
        points, black = np.asarray(view.points, np.float64), np.asarray(view.black, np.bool_)
        radius = _finite(view.radius)
    except (TypeError, ValueError):
        raise _RubbishError("a FloorPatch of numbers: centre (x, y), radius, points, black") from None
    count = len(points) if points.ndim else -1
    if points.shape != (count, 2) or black.shape != (count,) or count > _MOST_POINTS:
        raise _RubbishError(f"a FloorPatch with (n, 2) points and (n,) black, n at most {_MOST_POINTS:,}")
    if not np.isfinite(points).all():
        raise _RubbishError("a FloorPatch with finite points")
    return FloorPatch((x, y), radius, points, black)


def _finite(value: object) -> float:
    number = _number(value)
    if not math.isfinite(number):
        raise _RubbishError("finite places and bearings")
    return number


def _array(value: object, shape: tuple[int, ...]) -> Any:
    """An array of a shape, without NaN."""
    made = value if isinstance(value, np.ndarray) else None
    if made is None or made.shape != shape or made.dtype.kind not in "fiub":
        raise _RubbishError(f"an array of numbers of shape {shape}, not {_shown(value)}")
    made = made.astype(np.float64)
    if np.isnan(made).any():
        raise _RubbishError("an array without NaN")
    return made


def _one_each(value: object, given: Sequence[Any]) -> Any:
    return _array(value, (len(given[-1]),))


_CHECKS: Mapping[str, Callable[..., Any]] = {
    "observe": _observed,
    **dict.fromkeys(("reading", "proportional", "reported", "ideal", "anywhere", "error"), _scalar),
    **dict.fromkeys(("combined", "counted", "counted_on"), _scalar),
    "combined_many": lambda value, given: _array(value, (len(given[0]),)),
    "true_values": _one_each,
    "increments": lambda value, given: _array(value, np.shape(given[2])),
}
