"""The estimates of a robot's parameters, as shown to people: with their intervals, or the reason why there is
none."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import betaincinv

from simmer_tui.calibrate.fit import Fit
from simmer_tui.calibrate.measured_run import MeasuredRun
from simmer_tui.calibrate.parameters import Parameter, observed_sensors
from simmer_tui.calibrate.posterior import RANGE
from simmer_tui.report.robust_statistics import mad_scale
from simmer_tui.run.phrases import times_text
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.motion import profile_of
from simmer_tui.sim.sensors import ParameterKind
from simmer_tui.sim.specs import DriveSpec

_ENOUGH = 8
"""Least number of durations for an estimate of a speed or a latency. With fewer, the median absolute
deviation, which determines the interval, is itself wrong by half."""
_SEEN = 30
"""Least number of readings for an estimate of the shares of dropouts and outliers: with no hit in 30 the 95 %
interval ends at 8 %."""
_NEAR_LIMIT = 0.9
"""Share of Max Range within which a missed wall is a dropout: nearer to the limit an error may hide it."""
_FROM_ZERO = 0.4
"""Spread of a noise scale's logarithm from which its interval begins at 0: the variance is then within two
standard errors of 0."""
_NO_LINE = "the durations of movements do not show it; drive short and long ones"
_CLOCK = 5e-4
"""Least standard error of a duration, seconds: a scheduler delays a line of the log by as much."""


@dataclass(frozen=True, slots=True)
class ParameterEstimate:
    """The estimate of one parameter, or the reason why there is none."""

    owner: str
    """ID of a drive or sensor; `link` for the link."""
    field: str
    """Field of its row; empty if the estimate is for a whole sensor without an observation model."""
    label: str
    unit: str
    present: float
    """Value in the set."""
    value: float
    low: float
    high: float
    """Ends of the 95 % interval."""
    why_not: str = ""
    """Reason why the data do not identify it; empty if they do."""
    parameter: Parameter | None = None
    """The parameter or noise scale of the fit, if it is one."""

    @property
    def identified(self) -> bool:
        """True if the log identifies it; else `why_not` has the reason."""
        return not self.why_not

    @property
    def changed(self) -> bool:
        """True if the set's value is outside the interval."""
        return self.identified and not self.low <= self.present <= self.high

    @property
    def shown(self) -> tuple[str, str, str]:
        """Value and interval, as `shown`."""
        return shown(self.value, self.low, self.high)

    def unidentified(self, why: str) -> ParameterEstimate:
        """The same with the set's value, and the reason."""
        present = self.present
        return replace(self, value=present, low=present, high=present, why_not=why)

    def about(self, value: float, half: float) -> ParameterEstimate:
        """The same with a value that cannot be negative, and half the width of its interval."""
        return replace(self, value=value, low=max(value - half, 0.0), high=value + half)


def shown(value: float, low: float, high: float) -> tuple[str, str, str]:
    """A value and its interval, with enough decimals for two figures of half the interval's width."""
    half = (high - low) / 2
    places = min(max(1 - math.floor(math.log10(half)), 0), 6) if half > 0 else 4
    return f"{value:.{places}f}", f"{low:.{places}f}", f"{high:.{places}f}"


def estimates_of(fit: Fit) -> tuple[ParameterEstimate, ...]:
    """All estimates, in the order of the set's rows: drives, sensors, the link."""
    silence, space, state = _silences(fit.run), fit.space, fit.state
    columns = (
        (*space.parameters, *space.noise_scales),
        np.concatenate((state.parameters, state.noise_scales)).tolist(),
        np.concatenate((fit.standard_errors, fit.noise_scale_errors)).tolist(),
        (*fit.identified, *fit.noise_scales_identified),
    )
    found = []
    for parameter, value, spread, is_identified in zip(*columns, strict=True):
        why = silence.get(parameter.owner, "" if is_identified else "the log does not determine it")
        found.append(_estimate(parameter, value, spread, why))
    found += [*_faults(fit), *timings(fit.run), *_without_model(fit.run)]
    order = {each.kind.value: i for i, each in enumerate(fit.run.spec.drives)}
    order |= {each.id: len(order) + i for i, each in enumerate(fit.run.spec.sensors)}
    return tuple(sorted(found, key=lambda each: order.get(each.owner, len(order))))


def _estimate(parameter: Parameter, value: float, spread: float, why: str) -> ParameterEstimate:
    low, high = parameter.interval(value, spread)
    reaches_zero = parameter.kind is ParameterKind.NOISE and spread > _FROM_ZERO
    if not why and reaches_zero and not parameter.present:
        why = f"too small to distinguish from 0: at most {high:.2g} {parameter.unit}".rstrip()
    estimate = ParameterEstimate(
        *(parameter.owner, parameter.field, parameter.label, parameter.unit, parameter.present),
        *(value, 0.0 if reaches_zero else low, high),
        parameter=parameter,
    )
    return estimate.unidentified(why) if why else estimate


def unidentified_labels(estimates: Iterable[ParameterEstimate]) -> dict[tuple[str, str], list[str]]:
    """Labels of the parameters that the data do not identify, by part and reason."""
    reasons: dict[tuple[str, str], list[str]] = {}
    for each in estimates:
        if not each.identified:
            reasons.setdefault((each.owner, each.why_not), []).append(each.label)
    return reasons


def _silences(run: MeasuredRun) -> dict[str, str]:
    """Drives and sensors without data in the logs: the reason by ID."""
    drives = run.spec.drives
    used = {index for each in run.movements for index, d in each.distances(drives) if d}
    why = {
        drive.kind.value: f"no command was sent to {drive.kind.meaning} ({drive.code})"
        for index, drive in enumerate(drives)
        if index not in used
    }
    for sensor in run.spec.sensors:
        readings = run.readings.get(sensor.code)
        if readings is None:
            why[sensor.id] = f"{sensor.code} was never read"
        elif sensor.kind.is_range and not np.isfinite(readings.values).any():
            why[sensor.id] = f"{sensor.code} never saw a wall within range"
    return why


def _without_model(run: MeasuredRun) -> list[ParameterEstimate]:
    """Sensors whose kind has no observation model, so that no log identifies them."""
    observed = observed_sensors(run.spec)
    return [
        _as_it_was(sensor.id, "", "all but time", "", 0.0).unidentified(
            f"the kind {sensor.kind.name} ({sensor.kind.meaning}) has no observation model"
        )
        for index, sensor in enumerate(run.spec.sensors)
        if sensor.enabled and index not in observed
    ]


def _faults(fit: Fit) -> list[ParameterEstimate]:
    """Shares of dropouts and outliers of range sensors. Intervals are Jeffreys' for shares."""
    found = []
    silence = _silences(fit.run)
    ranging = {i: each.spec for i, each in observed_sensors(fit.run.spec).items() if each.spec.kind.is_range}
    for index, sensor in ranging.items():
        dropout, outlier = (
            _as_it_was(sensor.id, field, f"{field}s", "", getattr(sensor, field))
            for field in ("dropout", "outlier")
        )
        if sensor.id in silence:
            found += [each.unidentified(silence[sensor.id]) for each in (dropout, outlier)]
            continue
        count, missed = _missed(fit, index)
        mine = (fit.rows.family == RANGE) & (fit.rows.source == index)
        odd = float((1.0 - fit.rows.weights[mine]).sum())
        for estimate, hits, seen in ((dropout, missed, count), (outlier, odd, int(mine.sum()))):
            if seen >= _SEEN:
                low, high = share_interval(hits, seen)
                found.append(replace(estimate, value=hits / seen, low=low, high=high))
            else:
                why = f"{sensor.code} faced a wall within range only {times_text(seen)}"
                found.append(estimate.unidentified(why))
    return found


def _missed(fit: Fit, index: int) -> tuple[int, int]:
    """Readings of a wall that is well within a sensor's range, and how many of them missed it."""
    sensor = fit.run.spec.sensors[index]
    readings = fit.run.readings[sensor.code]
    near = fit.model.expected(fit.state, index, readings.stops) < _NEAR_LIMIT * sensor.max_range
    return int(near.sum()), int(np.isinf(readings.values[near]).sum())


def share_interval(hits: float, count: int) -> tuple[float, float]:
    """The 95 % interval of a share by Jeffreys (Brown, Cai and DasGupta 2001)."""
    if not count:
        return 0.0, 1.0
    # By the same source, the interval begins at 0 if there is no hit.
    low = float(betaincinv(hits + 0.5, count - hits + 0.5, 0.025)) if hits >= 0.5 else 0.0
    return low, float(betaincinv(hits + 0.5, count - hits + 0.5, 0.975))


# -- time --------------------------------------------------------------------------------------------


def timings(run: MeasuredRun) -> list[ParameterEstimate]:
    """Latency of the link, speeds of the drives and read times of the sensors.

    A movement takes |value| / speed plus the latency of the link, there and back. So the latency is the
    constant of a line through durations. Read times are the gaps between consecutive readings. The shortest
    quarter counts, because a program that computes between readings makes them longer.
    """
    silence = _silences(run)
    speeds, constants = [], []
    for index, drive in enumerate(run.spec.drives):
        if drive.enabled:
            estimate, constant = _speed(run, index, drive)
            speeds.append(_silenced(estimate, silence))
            constants += [constant] if constant is not None else []
    latency = _as_it_was("link", "latency", "link latency", "s", run.configuration.settings.link.latency)
    read_times = {
        sensor.code: _as_it_was(sensor.id, "read_time", "read time", "s", sensor.read_time)
        for sensor in run.spec.sensors
        if sensor.enabled and sensor.kind.has("read_time")
    }
    if constants:
        weights = np.array([1.0 / error**2 for _, error in constants])
        both = float(np.average([constant for constant, _ in constants], weights=weights))
        error = max(1.0 / math.sqrt(weights.sum()), _CLOCK)
        # Two standard errors to either side; the constant is the latency there and back.
        latency = latency.about(max(both, 0.0) / 2, 2 * error / 2)
        times = [_read_time(run, time, code, both, error) for code, time in read_times.items()]
    else:
        no_line = any(each.why_not == _NO_LINE for each in speeds)
        latency = latency.unidentified(_NO_LINE if no_line else "no drive was answered often enough")
        why = "the link's latency, which is part of it, is not known"
        times = [time.unidentified(why) for time in read_times.values()]
    return [*speeds, latency, *(_silenced(time, silence) for time in times)]


def _silenced(estimate: ParameterEstimate, silence: dict[str, str]) -> ParameterEstimate:
    """An estimate that failed; if its drive or sensor was never used, with this as the reason."""
    if estimate.identified or estimate.owner not in silence:
        return estimate
    return estimate.unidentified(silence[estimate.owner])


def _speed(
    run: MeasuredRun, index: int, drive: DriveSpec
) -> tuple[ParameterEstimate, tuple[float, float] | None]:
    """Speed of a drive, and the constant part of its durations with its standard error, if there is an
    estimate."""
    made = [each for each in run.movements if each.drive == index and each.certain]
    rows = [(abs(each.value), each.took) for each in made if math.isfinite(each.took)]
    speed = _as_it_was(drive.kind.value, "speed", "speed", f"{drive.kind.unit}/s", drive.speed)
    if len(rows) < _ENOUGH:
        return speed.unidentified(f"{drive.code} was answered only {times_text(len(rows))}"), None
    values, took = np.array(rows).T
    if drive.acceleration or drive.start_lag:
        profiles = [profile_of(drive, float(each)) for each in values]
        planned = np.array([each.duration for each in profiles if each is not None])
        unknown = speed.unidentified("the set has a start lag or an acceleration for it")
        return unknown, _median(took - planned)
    constant, slope, error = line_through(values, took)
    # With a slope within four standard errors of 0 the speed's interval would have no upper end.
    if slope <= 0 or 4 * error > slope:
        return speed.unidentified(_NO_LINE), None
    value = 1.0 / slope
    residual_error = _median(took - constant - slope * values)[1]
    constant_error = math.hypot(error * float(np.mean(values)), residual_error)
    return speed.about(value, 2 * error * value**2), (constant, constant_error)


def _read_time(
    run: MeasuredRun, estimate: ParameterEstimate, code: str, link: float, error: float
) -> ParameterEstimate:
    """Read time of a sensor. `link` is the latency there and back, `error` its standard error (seconds)."""
    readings = run.readings.get(code)
    gaps = readings.gaps[np.isfinite(readings.gaps)] if readings is not None else np.zeros(0)
    if len(gaps) < _ENOUGH:
        return estimate.unidentified(f"{code} was seldom read right after another answer")
    quick = np.sort(gaps)[: max(len(gaps) // 4, 4)]
    spread = 2 * float(quick.std()) / math.sqrt(len(quick))
    return estimate.about(max(float(quick.mean()) - link, 0.0), spread + 2 * error + _CLOCK)


def _median(values: FloatArray) -> tuple[float, float]:
    """The median, and its standard error."""
    median = float(np.median(values))
    # For a normal distribution, 1.4826 times the median absolute deviation is the standard deviation, and
    # sqrt(pi / 2) = 1.2533 times that the median's standard error: together 1.858. 3e-4 s are for the clock.
    return median, 1.85 * float(np.median(np.abs(values - median))) / math.sqrt(len(values)) + 3e-4


def line_through(x: FloatArray, y: FloatArray) -> tuple[float, float, float]:
    """Constant, slope and its standard error of a line through most of (n,) points.

    Least squares, reweighted by Huber's function at two standard deviations (Huber 1964), whose scale is the
    median absolute deviation.
    """
    weights = np.ones(len(x))
    design = np.column_stack((np.ones(len(x)), x))
    for _ in range(8):  # converges to a hundredth of the standard error in five
        scaled = design * weights[:, None]
        solution = np.linalg.lstsq(scaled, y * weights, rcond=None)[0]
        off = np.abs(y - design @ solution)
        scale = max(mad_scale(off), _CLOCK)
        weights = np.sqrt(np.minimum(1.0, 2.0 * scale / np.maximum(off, 1e-9)))
    # As for a uniform distribution, whose standard deviation is 1 / sqrt(12) of its range.
    spread = np.ptp(x) / math.sqrt(12) * math.sqrt(len(x))
    return float(solution[0]), float(solution[1]), scale / max(float(spread), 1e-9)


def _as_it_was(owner: str, field: str, label: str, unit: str, present: float) -> ParameterEstimate:
    return ParameterEstimate(owner, field, label, unit, present, present, present, present)
