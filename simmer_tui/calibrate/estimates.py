"""The figures of a robot as people are told them: each with its interval, or why it is not told."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from scipy.special import betaincinv

from simmer_tui.calibrate.fit import Fit
from simmer_tui.calibrate.measured_run import MeasuredRun
from simmer_tui.calibrate.row_stack import RANGE
from simmer_tui.calibrate.unknowns import Unknown, interval
from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.motion import profile_of

_ENOUGH = 8
"""Durations from which a latency is told."""
_SEEN = 30
"""Readings from which it is told how often one is missed."""
_FROM_ZERO = 0.4
"""Spread of an error size's logarithm from which its interval reaches down to 0: then the variance is
within two standard errors of it."""
_NO_LINE = "how long movements took does not tell it; drive short and long ones"


class Timing(StrEnum):
    """Figures about time and about faults, which are read off the log without the path."""

    LINK = "link latency"
    READ = "read time"
    SPEED = "speed"
    DROPOUT = "dropouts"
    OUTLIER = "outliers"


@dataclass(frozen=True, slots=True)
class Estimate:
    """One figure: whose (ID of a drive or sensor, `link` for the link), of which field of its row, as
    the set has it, as the data have it with the 95 % interval, or why they do not tell it. `unknown` is
    the parameter or error size it is, if it is one."""

    owner: str
    field: str
    label: str
    unit: str
    present: float
    value: float
    low: float
    high: float
    why_not: str = ""
    unknown: Unknown | None = None

    @property
    def told(self) -> bool:
        return not self.why_not

    @property
    def changed(self) -> bool:
        """Whether what the set has is outside the interval."""
        return self.told and not self.low <= self.present <= self.high

    @property
    def shown(self) -> tuple[str, str, str]:
        """Value and interval, as `shown`."""
        return shown(self.value, self.low, self.high)


def shown(value: float, low: float, high: float) -> tuple[str, str, str]:
    """A figure and its interval with as many decimals as show half the interval's width to two figures."""
    half = (high - low) / 2
    places = min(max(1 - math.floor(math.log10(half)), 0), 6) if half > 0 else 4
    return f"{value:.{places}f}", f"{low:.{places}f}", f"{high:.{places}f}"


def estimates_of(fit: Fit) -> tuple[Estimate, ...]:
    """All figures, in the order of the set's rows: drives, sensors, the link."""
    silence = _silences(fit.run)
    found: list[Estimate] = []
    state = fit.state
    for unknowns, values, spreads, told in (
        (fit.unknowns.places, state.places, fit.place_spreads, fit.places_told),
        (fit.unknowns.sizes, state.sizes, fit.size_spreads, fit.sizes_told),
    ):
        for unknown, value, spread, is_told in zip(unknowns, values, spreads, told, strict=True):
            found.append(_estimate(unknown, float(value), float(spread), bool(is_told), silence))
    found += _faults(fit)
    found += timings(fit.run)
    order = {each.kind.value: i for i, each in enumerate(fit.run.spec.drives)}
    order |= {each.id: 100 + i for i, each in enumerate(fit.run.spec.sensors)}
    return tuple(sorted(found, key=lambda each: order.get(each.owner, 10**6)))


def _estimate(unknown: Unknown, value: float, spread: float, told: bool, silence: dict[str, str]) -> Estimate:
    low, high = interval(unknown, value, spread)
    why = silence.get(unknown.owner, "")
    if not told and not why:
        why = "the log leaves it open"
    if not why and unknown.sort.is_size and spread > _FROM_ZERO and not unknown.present:
        why = f"too small to be told from 0: at most {high:.2g}{' ' * bool(unknown.unit)}{unknown.unit}"
    if why:
        value = low = high = unknown.present
    elif unknown.sort.is_size and spread > _FROM_ZERO:
        low = 0.0
    return Estimate(
        unknown.owner,
        unknown.field,
        unknown.label,
        unknown.unit,
        unknown.present,
        value,
        low,
        high,
        why,
        unknown,
    )


def _silences(run: MeasuredRun) -> dict[str, str]:
    """Drives and sensors of which the logs say nothing, by ID, and why."""
    used = Counter(movement.drive for movement in run.movements if movement.value)
    why = {}
    for index, drive in enumerate(run.spec.drives):
        if not used[index]:
            why[drive.kind.value] = f"the robot was never told to {drive.kind.meaning} ({drive.code})"
    for sensor in run.spec.sensors:
        readings = run.readings.get(sensor.code)
        if readings is None:
            why[sensor.id] = f"{sensor.code} was never read"
        elif sensor.kind.is_range and not np.isfinite(readings.values).any():
            why[sensor.id] = f"{sensor.code} never saw a wall within range"
    return why


def _faults(fit: Fit) -> list[Estimate]:
    """How often range sensors miss a reading, and say anything. Intervals are Jeffreys' for shares."""
    found = []
    silence = _silences(fit.run)
    for index, sensor in enumerate(fit.run.spec.sensors):
        if not (sensor.enabled and sensor.kind.is_range):
            continue
        count, missed = _missed(fit, index)
        mine = (fit.rows.family == RANGE) & (fit.rows.source == index)
        odd = float((1.0 - fit.rows.weights[mine]).sum())
        for field, label, present, hits, seen in (
            ("dropout", Timing.DROPOUT, sensor.dropout, missed, count),
            ("outlier", Timing.OUTLIER, sensor.outlier, odd, int(mine.sum())),
        ):
            why = "" if seen >= _SEEN else f"{sensor.code} faced a wall within range only {seen} times"
            why = silence.get(sensor.id, why)
            low, high = share_interval(hits, seen)
            value = hits / seen if seen else present
            if why:
                value = low = high = present
            found.append(Estimate(sensor.id, field, label.value, "", present, value, low, high, why))
    return found


def _missed(fit: Fit, index: int) -> tuple[int, int]:
    """Readings of a wall that is well within a sensor's range, and how many of them missed it."""
    sensor = fit.run.spec.sensors[index]
    readings = fit.run.readings.get(sensor.code)
    if readings is None:
        return 0, 0
    near = fit.model.expected(fit.state, index, readings.stops) < 0.9 * sensor.max_range
    return int(near.sum()), int(np.isinf(readings.values[near]).sum())


def share_interval(hits: float, count: int) -> tuple[float, float]:
    """The 95 % interval of a share by Jeffreys (Brown, Cai and DasGupta 2001)."""
    if not count:
        return 0.0, 1.0
    low = float(betaincinv(hits + 0.5, count - hits + 0.5, 0.025)) if hits >= 0.5 else 0.0
    return low, float(betaincinv(hits + 0.5, count - hits + 0.5, 0.975))


# -- time --------------------------------------------------------------------------------------------


def timings(run: MeasuredRun) -> list[Estimate]:
    """The link's latency and the speeds of drives from how long movements took, and the read times of
    sensors from how fast readings followed each other.

    A movement takes |value| / speed and the way there and back; what a line through durations has at
    0 is the link. Readings that follow each other leave the link out; a program that thinks between
    them makes read times seem longer, so that the shortest quarter counts.
    """
    found: list[Estimate] = []
    constants: list[tuple[float, float]] = []
    present = run.configuration.settings.link.latency
    silence = _silences(run)
    for index, drive in enumerate(run.spec.drives):
        rows = [
            (abs(m.value), m.took)
            for m in run.movements
            if m.drive == index and m.certain and math.isfinite(m.took)
        ]
        if not drive.enabled:
            continue
        speed = _as_it_was(drive.kind.value, "speed", Timing.SPEED, f"{drive.kind.unit}/s", drive.speed)
        if len(rows) < _ENOUGH:
            why = f"{drive.code} was answered only {len(rows)} times"
            found.append(_untold(speed, silence.get(drive.kind.value, why)))
            continue
        values, took = np.array(rows).T
        if drive.acceleration or drive.start_lag:
            profiles = [profile_of(drive, float(each)) for each in values]
            planned = np.array([each.duration for each in profiles if each is not None])
            constants.append(_middle(took - planned))
            found.append(_untold(speed, "the set says how it gathers speed"))
            continue
        constant, slope, error = _line(values, took)
        if slope <= 0 or 4 * error > slope:
            found.append(_untold(speed, _NO_LINE))
            continue
        value = 1.0 / slope
        found.append(_about(speed, value, 2 * error * value**2))
        constants.append((constant, _line_error(values, took)))
    latency = _as_it_was("link", "latency", Timing.LINK, "s", present)
    if not constants:
        why = next((each.why_not for each in found if each.why_not == _NO_LINE), "")
        found.append(_untold(latency, why or "no drive was answered often enough"))
        why = "the link's latency, which is part of it, is not told"
        return [*found, *(_untold(time, silence.get(time.owner, why)) for time in _read_times(run))]
    weights = np.array([1.0 / max(each[1], 1e-4) ** 2 for each in constants])
    both = float(np.average([each[0] for each in constants], weights=weights))
    error = max(1.0 / math.sqrt(weights.sum()), 5e-4)
    found.append(_about(latency, max(both, 0.0) / 2, 2 * error / 2))
    codes = {sensor.id: sensor.code for sensor in run.spec.sensors}
    for time in _read_times(run):
        code = codes[time.owner]
        readings = run.readings.get(code)
        gaps = readings.gaps[np.isfinite(readings.gaps)] if readings is not None else np.zeros(0)
        if len(gaps) < _ENOUGH:
            why = f"{code} was seldom read right after another answer"
            found.append(_untold(time, silence.get(time.owner, why)))
            continue
        quick = np.sort(gaps)[: max(len(gaps) // 4, 4)]
        spread = 2 * float(quick.std()) / math.sqrt(len(quick))
        found.append(_about(time, max(float(quick.mean()) - both, 0.0), spread + 2 * error + 5e-4))
    return found


def _read_times(run: MeasuredRun) -> list[Estimate]:
    """The read time of each sensor, as it was."""
    return [
        _as_it_was(sensor.id, "read_time", Timing.READ, "s", sensor.read_time)
        for sensor in run.spec.sensors
        if sensor.enabled and sensor.kind.has("read_time")
    ]


def _middle(values: FloatArray) -> tuple[float, float]:
    """The median, and its standard error."""
    middle = float(np.median(values))
    return middle, 1.85 * float(np.median(np.abs(values - middle))) / math.sqrt(len(values)) + 3e-4


def _line(x: FloatArray, y: FloatArray) -> tuple[float, float, float]:
    """Constant, slope and its standard error of a line through most of the points."""
    weights = np.ones(len(x))
    design = np.column_stack((np.ones(len(x)), x))
    for _ in range(8):
        scaled = design * weights[:, None]
        solution = np.linalg.lstsq(scaled, y * weights, rcond=None)[0]
        off = np.abs(y - design @ solution)
        scale = max(1.4826 * float(np.median(off)), 5e-4)
        weights = np.sqrt(np.minimum(1.0, 2.0 * scale / np.maximum(off, 1e-9)))
    spread = np.ptp(x) / math.sqrt(12) * math.sqrt(len(x))
    return float(solution[0]), float(solution[1]), scale / max(float(spread), 1e-9)


def _line_error(x: FloatArray, y: FloatArray) -> float:
    """Standard error of the line's constant."""
    constant, slope, error = _line(x, y)
    return math.hypot(error * float(np.mean(x)), _middle(y - constant - slope * x)[1])


def _as_it_was(owner: str, field: str, label: str, unit: str, present: float) -> Estimate:
    return Estimate(owner, field, str(label), unit, present, present, present, present)


def _untold(estimate: Estimate, why: str) -> Estimate:
    return replace(estimate, why_not=why)


def _about(estimate: Estimate, value: float, half: float) -> Estimate:
    return replace(estimate, value=value, low=max(value - half, 0.0), high=value + half)
