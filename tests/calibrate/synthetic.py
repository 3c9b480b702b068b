"""A made-up run in which every error is known: what the model's rows must say of it follows on paper."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from msgspec.structs import replace

from simmer_tui.calibrate.find_path import world_of
from simmer_tui.calibrate.geometry import moved
from simmer_tui.calibrate.measured_run import Chain, MeasuredMovement, MeasuredRun, Readings
from simmer_tui.calibrate.parameters import parameters_of
from simmer_tui.calibrate.posterior import Iterate
from simmer_tui.calibrate.rows import PER_STOP, Model
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.sensors import CountingSensor, ObservingSensor, sensor_of
from simmer_tui.sim.specs import Axes, MazeSpec, SimulationSpec

START = Pose(40.0, 30.0, 20.0)
STEP_TIME = 2.0
"""Seconds from stop to stop."""
_ROOM = MazeSpec(((1,) * 8, (1,) * 8, (1, 1, 1, 1, 1, 0, 1, 1), (1,) * 8, (1,) * 8))
"""A room of 96 by 60 inches with one pillar."""
_DRIVES = {"right": 3.0, "rot": 35.0, "up": 2.0, "left": 2.5, "down": 1.5}


@dataclass(frozen=True)
class Synthetic:
    """A run, the point at which all its rows are about the truth, and the errors that were drawn: of the
    totals, (movements, 3), and of the readings by code."""

    run: MeasuredRun
    model: Model
    truth: Iterate
    totals_off: FloatArray
    readings_off: dict[str, FloatArray]


def spec_of_robot() -> SimulationSpec:
    """The default robot with parameters all of which differ from 0 and from each other."""
    base = load(bundled_folder()).simulation
    drives = []
    for number, drive in enumerate(base.drives):
        small = 0.1 if drive.kind.turns else 1.0
        bias = Axes(small * (0.03 + 0.01 * number), -0.02 * small, 0.2 * small)
        error = Axes(0.04 * small, 0.02 * small, 0.03 * small)
        drives.append(replace(drive, bias=bias, error=error))
    sensors = []
    for number, each in enumerate(base.sensors):
        changed = replace(each, gain=1.02 + 0.01 * number, absolute_error=0.05 + 0.01 * number, drift=0.002)
        if each.kind.is_range:
            changed = replace(changed, bias=0.1 * number, max_range=70.0, resolution=0.1)
        if each.kind.name == "comp":
            changed = replace(changed, gain=1.0, bias=4.0, error=0.004, hard_iron=5.0, soft_iron=2.0)
        if each.kind.name == "gyro":
            changed = replace(changed, random_walk=0.02, resolution=0.05)
        if each.kind.name == "odom":
            changed = replace(changed, ticks_per_inch=50.0)
        sensors.append(changed)
    return replace(
        base, maze=_ROOM, drives=tuple(drives), sensors=tuple(sensors), randbias=False,
        bot_center=(START.x, START.y), bot_rot=START.heading, num_segments=4,
    )  # fmt: skip


@cache
def make(movements: int = 40, seed: int = 1, scale: float = 1.0) -> Synthetic:
    """A run of some movements, all sensors read at each stop. `scale` multiplies all random errors.

    Many tests share one run, whose arrays are therefore read-only."""
    random = np.random.default_rng(seed)
    spec = spec_of_robot()
    kinds = [each.kind.value for each in spec.drives]
    made, off, totals, poses = [], [], [], [np.array([START.x, START.y, START.heading])]
    for number in range(movements):
        name = list(_DRIVES)[number % len(_DRIVES)]
        drive = spec.drives[kinds.index(name)]
        value = _DRIVES[name] * (1.0 if number % 2 else -1.0) * (1.0 + 0.1 * (number % 7))
        asked = value * np.array([drive.kind.direction.x, drive.kind.direction.y, drive.kind.direction.r])
        bias = np.array([drive.bias.x, drive.bias.y, drive.bias.r])
        error = np.array([drive.error.x, drive.error.y, drive.error.r])
        d = asked.sum()
        off.append(scale * d * (1.0 + bias) * error * random.standard_normal(3))
        totals.append(asked + d * bias + off[-1])
        poses.append(moved(poses[-1][None], totals[-1][None], spec.num_segments)[0])
        took = 0.08 + abs(value) / drive.speed
        made.append(MeasuredMovement(kinds.index(name), value, True, 2 + number, took))
    chain = np.zeros((movements + 1, PER_STOP))
    chain[:, :3], chain[:-1, 3:] = np.array(poses), np.array(totals)
    configuration = replace(load(bundled_folder()), simulation=spec)
    run = MeasuredRun(configuration, ("made up",), (Chain(START, 1, made),), {}, None, False)
    readings, readings_off = _readings(run, chain, random, scale)
    run = MeasuredRun(run.configuration, run.names, run.chains, readings, None, False)
    model = Model(run, parameters_of(run))
    parameters, scales = model.space.of(spec)
    contacts = np.zeros(movements, bool)
    outliers = np.full(len(spec.sensors), 0.02)
    truth = Iterate(chain, parameters, scales, contacts, contacts.copy(), outliers)
    found = Synthetic(run, model, truth, np.array(off), readings_off)
    shared = [chain, parameters, scales, contacts, truth.slipped, outliers, found.totals_off]
    shared += readings_off.values()
    shared += [
        array for each in readings.values() for array in (each.stops, each.values, each.times, each.gaps)
    ]
    for array in shared:
        array.flags.writeable = False
    return found


def _readings(
    run: MeasuredRun, chain: FloatArray, random: np.random.Generator, scale: float
) -> tuple[dict[str, Readings], dict[str, FloatArray]]:
    stops = np.arange(len(chain))
    times = STEP_TIME * stops
    readings, off = {}, {}
    for sensor in map(sensor_of, run.spec.sensors):
        spec = sensor.spec
        if isinstance(sensor, CountingSensor):
            rolled = chain[:-1, 3:] @ sensor.lever if sensor.slips else np.diff(chain[:, 2])
            true = np.concatenate(([0.0], np.cumsum(rolled)))
            values = spec.gain * true + spec.drift * times
        elif isinstance(sensor, ObservingSensor) and sensor.parameters:
            values = np.array([
                sensor.expected(world_of(run), pose[None], time)[0]
                for pose, time in zip(chain[:, :3], times, strict=True)
            ])  # fmt: skip
        else:
            continue
        drawn = scale * max(spec.absolute_error, 0.02) * random.standard_normal(len(stops))
        off[spec.code] = drawn
        readings[spec.code] = Readings(stops, values + drawn, times, np.full(len(stops), 0.08 + 0.03))
    return readings, off
