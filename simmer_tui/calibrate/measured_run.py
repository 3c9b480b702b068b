"""Measurements from run logs of a real robot: its commanded movements, and its readings.

A log of a real robot has its answers beside the path of the simulated twin. The twin's path is not used,
since the real robot's path is unknown.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from simmer_tui.calibrate.geometry import on_axes
from simmer_tui.calibrate.stretches import ARC_SEGMENTS, VelocityStretch, share_of_variance
from simmer_tui.config.loader import Configuration
from simmer_tui.errors import CalibrationError
from simmer_tui.run.events import (
    ActionDone,
    ActionName,
    CommandResult,
    EventHandler,
    LegBegun,
    LegEnded,
    MovementPlanned,
)
from simmer_tui.runlog.reader import Logged, LogReader
from simmer_tui.sim.arrays import FloatArray, IntArray
from simmer_tui.sim.command import parse_value
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import Status
from simmer_tui.sim.specs import DriveSpec, SensorSpec, SimulationSpec

START_SPREAD = (1.0, 1.0, 5.0)
"""Standard deviations in x, y (inches) and heading (degrees) of the pose in which people place a robot."""
# docs/calibrate.md asks for within an inch and 5 degrees.


@dataclass(frozen=True, slots=True)
class MeasuredMovement:
    """One command to a drive: `drive` is its index in the set, `value` the distance (times Gain). `certain`
    is True if the robot confirmed it. `took` is in seconds from sending it to its answer; NaN if not known.

    Or a stretch of continuous motion: `drive` and `value` are those of the drive that moved most, `parts`
    those of all. `commanded` are the totals of x, y (inches) and turning (degrees). `bend` is the distance of
    its end from that of one arc, inches in the frame of its start.
    """

    drive: int
    value: float
    certain: bool
    line: int
    took: float
    parts: tuple[tuple[int, float], ...] = ()
    commanded: tuple[float, float, float] | None = None
    bend: complex = 0.0

    @property
    def is_continuous(self) -> bool:
        """True for a stretch of continuous motion."""
        return self.commanded is not None

    def asked(self, drives: Sequence[DriveSpec]) -> FloatArray:
        """Commanded totals, (3,)."""
        if self.commanded is not None:
            return np.array(self.commanded)
        return self.value * on_axes(drives[self.drive].kind.direction)

    def distances(self, drives: Sequence[DriveSpec]) -> list[tuple[int, float]]:
        """Drives, with the signed distance of each, inches or degrees, on which its errors depend."""
        if self.is_continuous:
            return list(self.parts)
        return [(self.drive, self.value * float(on_axes(drives[self.drive].kind.direction).sum()))]

    def spread(self, drives: Sequence[DriveSpec], index: int, distance: float) -> FloatArray:
        """Standard deviations of the totals, (3,), by the random errors of one drive."""
        row = drives[index]
        size = distance * (1.0 + on_axes(row.bias)) * on_axes(row.error)
        if not self.is_continuous:
            return size
        return size * np.sqrt(share_of_variance(np.array([distance]), turns=row.kind.turns))

    def law(self, segments: int) -> tuple[int, complex]:
        """The number of segments of its path in the drive law (`segments` for a command), and the path's
        bend."""
        return (ARC_SEGMENTS if self.is_continuous else segments), self.bend


@dataclass(slots=True)
class Chain:
    """Movements without a break: movement k leads from stop k to stop k + 1. `start` is the pose in which
    people placed the robot, `spread` its standard deviations."""

    start: Pose
    line: int
    movements: list[MeasuredMovement] = field(default_factory=list)
    spread: tuple[float, float, float] = START_SPREAD


@dataclass(frozen=True, slots=True)
class Readings:
    """All readings of one sensor: their stops (counted through all chains), values and times (seconds since
    the log's beginning)."""

    stops: IntArray
    values: FloatArray
    times: FloatArray
    gaps: FloatArray
    """Seconds since the previous answer; NaN if anything else was logged in between."""


@dataclass(frozen=True)
class MeasuredRun:
    """The measurements of all logs, with the stops of all chains numbered consecutively."""

    configuration: Configuration
    names: tuple[str, ...]
    chains: tuple[Chain, ...]
    readings: dict[str, Readings]
    """By the sensor's code."""
    block_moved_at: int | None
    """The stop from which the block's place is unknown; None if it is always known."""
    simulated: bool
    """True if the robot was a simulated one, as the logs say."""
    notes: tuple[str, ...] = ()
    """Notes on lines of the logs that were left out."""

    @property
    def spec(self) -> SimulationSpec:
        """Specification of the set with which the robot was driven."""
        return self.configuration.simulation

    @property
    def stops(self) -> int:
        """Number of stops: places where the robot stood, of all chains."""
        return sum(len(chain.movements) + 1 for chain in self.chains)

    @property
    def movements(self) -> list[MeasuredMovement]:
        """Movements of all chains, in order."""
        return [movement for chain in self.chains for movement in chain.movements]

    @cached_property
    def values_at_stops(self) -> dict[str, dict[int, tuple[float, float]]]:
        """Readings by code and stop: the last one's value and time."""
        said = {}
        for code, each in self.readings.items():
            pairs = zip(each.values.tolist(), each.times.tolist(), strict=True)
            said[code] = dict(zip(each.stops.tolist(), pairs, strict=True))
        return said

    def first_stops(self) -> list[int]:
        """The number of each chain's first stop."""
        sizes = [len(chain.movements) + 1 for chain in self.chains]
        return [0, *np.cumsum(sizes)[:-1].tolist()]

    def stops_before_movements(self) -> IntArray:
        """The stop that each movement leads away from."""
        chains = zip(self.first_stops(), self.chains, strict=True)
        return np.array([first + k for first, chain in chains for k in range(len(chain.movements))])

    def chains_of(self, stops: IntArray) -> IntArray:
        """The number of each stop's chain, from 1 on."""
        return np.searchsorted(self.first_stops(), stops, side="right")

    def before_stop(self, last: int) -> MeasuredRun:
        """The part up to a stop, inclusive."""
        chains = [
            replace(chain, movements=chain.movements[: last - first])
            for first, chain in zip(self.first_stops(), self.chains, strict=True)
            if first <= last
        ]
        kept = {}
        for code, each in self.readings.items():
            early = each.stops <= last
            kept[code] = Readings(each.stops[early], each.values[early], each.times[early], each.gaps[early])
        return replace(self, chains=tuple(chains), readings=kept)


class _Collector(EventHandler[None]):
    """Collects measurements from logs, one after the other."""

    def __init__(self) -> None:
        self.chains: list[Chain] = []
        self.found: dict[str, list[tuple[int, float, float, float]]] = {}
        self.stop = -1
        self.block_moved_at: int | None = None
        self._stretch, self._stretch_line = VelocityStretch(()), 0
        self._leg: tuple[Leg, float, int] | None = None
        """Leg under way, the simulated time to which its motion has been added, and its line in the log."""
        self._pending: tuple[int, MeasuredMovement, float] | None = None
        self._last_answer = math.nan

    def begin(self, start: Pose, line: int) -> None:
        """Begin a chain."""
        self.settle(certain=False)
        self._leg = None
        self.chains.append(Chain(start, line))
        self.stop += 1
        self._last_answer = math.nan

    def describe(self, spec: SimulationSpec) -> None:
        """Set the robot of the next log."""
        self._spec, self._stretch = spec, VelocityStretch(spec.drives)

    def take(self, logged: Logged, real_time: float) -> None:
        """Add a record of a log; `real_time` is in seconds since the log's beginning."""
        self._line, self._real_time = logged.line, real_time
        self.handle(logged.event)

    def on_action(self, event: ActionDone) -> None:
        if event.places:
            self.begin(event.pose, self._line)
        elif event.action.name is ActionName.BLOCK:
            self.move_block()

    def move_block(self) -> None:
        """Mark the block's place as unknown from here on."""
        if self.block_moved_at is None:
            self.block_moved_at = self.stop

    def on_leg_begun(self, event: LegBegun) -> None:
        self.settle(certain=False, keeps_stretch=True)
        self._leg = event.leg, event.leg.start_time, self._line

    def on_leg_ended(self, event: LegEnded) -> None:
        self._drive_until(event.leg.end_time)
        self._leg = None

    def _drive_until(self, time: float) -> None:
        """Add the commanded motion up to a simulated time."""
        if self._leg is not None:
            leg, since, line = self._leg
            self._stretch.drive(leg.commanded, time - since)
            self._leg = leg, max(time, since), line
            self._stretch_line = line

    def _end_stretch(self) -> None:
        """Make a stop at the present point of a continuous motion, if there is one."""
        stretch = self._stretch
        if stretch.has_moved:
            (drive, value), *_ = parts = stretch.distances
            origin = (True, self._stretch_line, math.nan)
            self._add(MeasuredMovement(drive, value, *origin, parts, stretch.asked, stretch.bend))
        stretch.clear()

    def on_planned(self, event: MovementPlanned) -> None:
        if event.grip is not None:
            self.move_block()
            return
        if self._pending is not None and self._pending[0] == event.number:
            return  # the twin's path was planned again, which does not concern the real robot
        self.settle(certain=False)
        drive = next(i for i, each in enumerate(self._spec.drives) if each.code == event.command.code)
        value = parse_value(event.command.argument)
        assert isinstance(value, float), "what moves has a number"
        value *= self._spec.drives[drive].gain
        movement = MeasuredMovement(drive, value, True, self._line, math.nan)
        self._pending = (event.number, movement, self._real_time)

    def on_result(self, event: CommandResult) -> None:
        if self._pending is not None and event.number == self._pending[0]:
            done = event.status in (Status.DONE, Status.ACCEPTED)
            self.settle(certain=done, took=self._real_time - self._pending[2] if done else math.nan)
            self._last_answer = self._real_time if done else math.nan
            return
        moves = self._leg is not None
        self.settle(certain=event.status is not Status.STOPPED, keeps_stretch=moves)
        if event.reading is not None and event.status is Status.READING:
            # Only range sensors read infinity: they met nothing.
            sensor, said = event.reading.sensor, float(event.reply)
            if math.isfinite(said) or said == getattr(sensor.kind, "missed", None):
                gap = self._real_time - self._last_answer
                value = self._at_stop(sensor, event) if moves else said
                if value is not None:
                    self.found.setdefault(sensor.code, []).append((self.stop, value, self._real_time, gap))
            self._last_answer = self._real_time
        else:
            self._last_answer = math.nan

    def _at_stop(self, sensor: SensorSpec, read: CommandResult) -> float | None:
        """A reading within a continuous motion, moved back to the last stop; None if that is too far away.
        After enough motion there is a new stop here."""
        self._drive_until(read.time if read.taken is None else read.taken)
        if self._stretch.is_long:
            self._end_stretch()
        return self._stretch.at_stop(sensor, float(read.reply))

    def settle(self, *, certain: bool, took: float = math.nan, keeps_stretch: bool = False) -> None:
        """End the movement under way, and the continuous motion unless `keeps_stretch`."""
        if not keeps_stretch:
            self._end_stretch()
        if self._pending is not None:
            self._add(replace(self._pending[1], certain=certain, took=took))
            self._pending = None

    def _add(self, movement: MeasuredMovement) -> None:
        self.chains[-1].movements.append(movement)
        self.stop += 1


def read_runs(paths: Iterable[Path]) -> MeasuredRun:
    """Read logs of one robot.

    Raises:
        CalibrationError: for logs with different sets, of a real robot and a simulated one, of the same run,
            or with no movement in them.
        RunLogError, ConfigurationError: for a file that is not a log, or whose set cannot be read.
    """
    collector = _Collector()
    logs: list[LogReader] = []
    notes: list[str] = []
    for path in paths:
        with LogReader(path) as log:
            _check_same_robot(log, logs)
            logs.append(log)
            collector.begin(log.header.pose, 1)
            collector.describe(log.configuration.simulation)
            if log.header.holding:
                collector.move_block()
            for logged in log:
                if isinstance(logged, Logged):
                    collector.take(logged, logged.real_time - log.header.real_time)
                else:
                    notes.append(f"{log.shown}: line {logged.line} is left out: {logged.reason}")
            if log.note:
                notes.append(f"{log.shown}: {log.note}")
    collector.settle(certain=False)
    names = tuple(log.shown for log in logs)
    run = MeasuredRun(
        logs[0].configuration,
        names,
        tuple(collector.chains),
        {code: Readings(*map(np.array, zip(*rows, strict=True))) for code, rows in collector.found.items()},
        collector.block_moved_at,
        logs[0].header.simulated,
        tuple(notes),
    )
    if not run.movements:
        raise CalibrationError(f"{', '.join(names)}: the robot never moved, so nothing can be estimated")
    return run


def _check_same_robot(log: LogReader, before: Sequence[LogReader]) -> None:
    """Raises CalibrationError if a log is not another run of the same robot as those before it."""
    for each in before:
        if _differ(each.configuration.simulation, log.configuration.simulation):
            raise CalibrationError(
                f"{log.shown} was made with another set than {each.shown}: robot, sensors, drives or maze "
                "differ; calibrate from logs of one robot described by one set"
            )
        if log.header == each.header:
            raise CalibrationError(f"{log.shown} is the same run as {each.shown}; name each log once")
        if log.header.simulated != each.header.simulated:
            kinds = {True: "simulated", False: "real"}
            raise CalibrationError(
                f"{log.shown} is of a {kinds[log.header.simulated]} robot, {each.shown} of a "
                f"{kinds[each.header.simulated]} one; calibrate from logs of one robot"
            )


def _differ(one: SimulationSpec, other: SimulationSpec) -> bool:
    """True if two logs have robots with different descriptions; starts may differ."""
    return any(
        getattr(one, name) != getattr(other, name)
        for name in ("maze", "robot", "sensors", "drives", "num_segments", "block_size")
    )
