"""Interventions on a failed run: the same program, seed and mission, and one change of the simulator.

The effect of true readings on a program is in no log, because the program decides by them. So it runs again,
in a simulator that differs in one thing. True readings are those of an ideal sensor: no random error, no
bias. Gain, sign, wrap and mounting are those of the nominal set, for which the program was written. A run
without any change shows whether the program repeats its run at all.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from enum import StrEnum

from msgspec.structs import replace

from simmer_tui.config.loader import Configuration
from simmer_tui.config.mission_toml import Heading, MissionSpec
from simmer_tui.config.nominal import Nominal
from simmer_tui.config.settings import LinkSettings
from simmer_tui.sim.columns import BASE
from simmer_tui.sim.specs import Axes, DriveSpec, SensorSpec, SimulationSpec
from simmer_tui.sim.values import with_values

UNCHANGED = "nothing changed"
"""The intervention that changes nothing."""


class ChangedPart(StrEnum):
    """The part of a run that an intervention changes."""

    NOTHING = "nothing"
    SENSOR = "sensor"
    SENSORS = "sensors"
    """Several sensors, or all."""
    SENSOR_ERRORS = "sensor errors"
    """Noise and bias of one sensor; gain and mounting stay."""
    NOISE = "noise"
    BIAS = "bias"
    DRIVES = "drives"
    """Noise and bias of all drives."""
    ROBOT = "robot"
    """All sensors and drives."""
    LINK = "link"
    """The delay of the link."""
    TIME = "time"
    """The time of readings and of the link."""
    BELIEF = "belief"
    """The start pose, which the program then knows."""
    TIME_LIMIT = "time limit"


@dataclass(frozen=True, slots=True)
class Intervention:
    """One change. `change` names it (`true readings of u1`), `codes` are the sensors that it makes true. With
    `tells_start` the program is given its start pose, as where mission.toml has it."""

    change: str
    part: ChangedPart
    configuration: Configuration
    codes: tuple[str, ...] = ()
    tells_start: bool = False


def interventions(
    configuration: Configuration,
    nominal: Nominal | None = None,
    *,
    read: Collection[str] | None = None,
    suspects: Sequence[str] = (),
    time_was_up: bool = False,
) -> list[Intervention]:
    """All interventions that make a difference, the run without a change first.

    Args:
        configuration: The run as it was.
        nominal: The set that its own is a variant of.
        read: IDs of the sensors that the program read; None if they are not known.
        suspects: Codes of sensors and drives that a verdict names; several sensors are changed together.
        time_was_up: True if the run ended at the time limit of its mission.
    """
    spec = configuration.simulation
    true = {
        each.code: _true_sensor(each, nominal)
        for each in spec.sensors
        if each.enabled and (read is None or each.id in read)
    }

    def made(change: str, part: ChangedPart, simulation: SimulationSpec, *codes: str) -> Intervention:
        return Intervention(change, part, replace(configuration, simulation=simulation), codes)

    def with_true(*codes: str) -> SimulationSpec:
        sensors = [true[each.code] if each.code in codes else each for each in spec.sensors]
        return replace(spec, sensors=tuple(sensors))

    found = [Intervention(UNCHANGED, ChangedPart.NOTHING, configuration)]
    found += [made(f"true readings of {code}", ChangedPart.SENSOR, with_true(code), code) for code in true]
    for each in spec.sensors:
        if each.code in true:
            exact = _without_errors(each)
            sensors = tuple(exact if other is each else other for other in spec.sensors)
            change = f"no noise and bias of {each.code}"
            found.append(made(change, ChangedPart.SENSOR_ERRORS, replace(spec, sensors=sensors), each.code))
    together = tuple(code for code in suspects if code in true)
    if len(together) > 1:
        change = f"true readings of {' and '.join(together)}"
        found.append(made(change, ChangedPart.SENSORS, with_true(*together), *together))
    found += [
        made("true readings of all sensors", ChangedPart.SENSORS, with_true(*true), *true),
        made("no noise of the drives", ChangedPart.NOISE, _without_noise(spec)),
        made("no bias of the drives", ChangedPart.BIAS, _without_bias(spec, nominal)),
        made("exact drives", ChangedPart.DRIVES, _without_noise(_without_bias(spec, nominal))),
        made(
            "exact sensors and drives",
            ChangedPart.ROBOT,
            _without_noise(_without_bias(with_true(*true), nominal)),
        ),
        _without_link_delay(configuration),
        _without_delays(configuration),
    ]
    if configuration.mission is not None:
        # A given start is known already.
        if configuration.mission.start is None or isinstance(configuration.mission.heading, Heading):
            found.append(
                Intervention("the start pose known", ChangedPart.BELIEF, configuration, tells_start=True)
            )
        if time_was_up:
            longer = replace(configuration.mission, time_limit=2 * configuration.mission.time_limit)
            changed = replace(configuration, mission=longer)
            found.append(Intervention("twice the time", ChangedPart.TIME_LIMIT, changed))
    return _different(found)


def _different(found: Sequence[Intervention]) -> list[Intervention]:
    """Those with another effect than all before them."""
    kept: list[Intervention] = []
    for each in found:
        if all(_effective(each) != _effective(other) for other in kept):
            kept.append(each)
    return kept


def _effective(each: Intervention) -> tuple[SimulationSpec, LinkSettings, MissionSpec | None, bool]:
    configuration = each.configuration
    return configuration.simulation, configuration.settings.link, configuration.mission, each.tells_start


def _true_sensor(spec: SensorSpec, nominal: Nominal | None) -> SensorSpec:
    """The sensor as the program assumes it, without errors. A gain of 0, or another than the nominal one, is
    an error; its sign is its wiring."""
    rows = () if nominal is None else nominal.spec.sensors
    known = next((row for row in rows if row.code == spec.code and row.kind is spec.kind), None)
    if known is None:
        base = replace(spec, gain=math.copysign(1.0, spec.gain))
    else:
        # Its number names its random stream and its time is no error of its readings.
        base = replace(known, number=spec.number, enabled=spec.enabled, read_time=spec.read_time)
    return _without_errors(base)


def _without_errors(spec: SensorSpec) -> SensorSpec:
    """The sensor without noise, bias and other errors of its kind; gain and mounting stay."""
    # Rows of every kind may fill the base columns.
    columns = (*BASE, *spec.kind.columns)
    return with_values(spec, {column.field: 0.0 for column in columns if column.is_error})


def _without_noise(spec: SimulationSpec) -> SimulationSpec:
    return replace(spec, drives=tuple(replace(each, error=Axes()) for each in spec.drives))


def _without_bias(spec: SimulationSpec, nominal: Nominal | None) -> SimulationSpec:
    """The specification in which every drive moves as the nominal one of its code."""
    rows = {} if nominal is None else {each.code: each for each in nominal.spec.drives}
    drives = tuple(_true_drive(each, rows.get(each.code)) for each in spec.drives)
    return replace(spec, drives=drives, randbias=False)


def _true_drive(spec: DriveSpec, known: DriveSpec | None) -> DriveSpec:
    if known is None:
        return replace(spec, gain=math.copysign(1.0, spec.gain), bias=Axes())
    return replace(spec, kind=known.kind, gain=known.gain, bias=Axes())


def _without_link_delay(configuration: Configuration) -> Intervention:
    """Messages take no simulated time."""
    changed = configuration.with_settings({"link.latency": 0.0, "link.jitter": 0.0})
    return Intervention("no link delay", ChangedPart.LINK, changed)


def _without_delays(configuration: Configuration) -> Intervention:
    """Readings and messages take no simulated time."""
    spec = configuration.simulation
    sensors = tuple(replace(each, read_time=0.0) for each in spec.sensors)
    linked = _without_link_delay(configuration).configuration
    changed = replace(linked, simulation=replace(spec, sensors=sensors))
    return Intervention("no time for readings and link", ChangedPart.TIME, changed)
