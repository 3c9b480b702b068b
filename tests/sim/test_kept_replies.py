"""Replies of random programs, kept: whoever changes a number of the simulation changes it on purpose.

python -m tests.sim.test_kept_replies     # keeps the replies of today, after such a change
"""

from __future__ import annotations

import contextlib
import json
import math
import random
from collections.abc import Callable
from pathlib import Path

import pytest
from msgspec.structs import replace

from simmer_tui.config import load_default
from simmer_tui.errors import PlacementError
from simmer_tui.sim import Axes, ContactRule, RobotSpec, SimulationSpec, Simulator
from simmer_tui.sim.sensors import Lidar, LidarSpec
from simmer_tui.sim.specs import VelocityKind, VelocitySpec, WheelLayout, WheelsSpec

KEPT = Path(__file__).with_name("kept_replies.json")
START_TIME = 500.7
L_SHAPE = RobotSpec.polygon(((3, 3), (-3, 3), (-3, -3), (3, -3), (3, 0), (0.5, 0.5)))


def erring(changes: dict[str, object]) -> SimulationSpec:
    """The default set with errors of every kind in sensors and drives."""
    base = load_default().simulation
    sensors = []
    for number, sensor in enumerate(base.sensors):
        sensor = replace(
            sensor,
            error=0.02 + 0.01 * (number % 3),
            absolute_error=0.05 * (number % 4),
            bias=0.1 * (number % 5),
            gain=1.0 + 0.02 * (number % 3),
            drift=0.001 * (number % 2),
            resolution=0.01 if number % 3 else 0.0,
        )
        sensors.append(sensor)
    drives = tuple(replace(drive, error=Axes(0.03, 0.02, 0.04)) for drive in base.drives)
    spec = replace(base, sensors=tuple(sensors), drives=drives)
    return replace(spec, **changes)  # type: ignore[arg-type]  # any field


def velocities(changes: dict[str, object]) -> SimulationSpec:
    """The same with continuous motion on four omnidirectional wheels."""
    codes = zip(VelocityKind, ("vv", "vx", "vy", "vr", "ww"), strict=True)
    return replace(
        erring(changes),
        velocities=tuple(VelocitySpec(kind=kind, code=code) for kind, code in codes),
        wheels=WheelsSpec(layout=WheelLayout.OMNI_4, top_speed=40.0),
    )


def scanning(changes: dict[str, object]) -> SimulationSpec:
    """The same with a lidar."""
    spec = velocities(changes)
    lidar = LidarSpec(kind=Lidar, number=1, code="l9", z=2.0, rays=12, min_range=1.0, absolute_error=0.05)
    return replace(spec, sensors=(*spec.sensors, lidar))


SETS: dict[str, SimulationSpec] = {
    "disc": erring({}),
    "disc that stops": erring({"contact": ContactRule.STOP, "num_segments": 7}),
    "rectangle": erring({"robot": RobotSpec.rectangle(6, 4), "block_solid": True}),
    "L": erring({"robot": L_SHAPE, "randbias": True}),
    "velocities of a disc": velocities({}),
    "velocities of a rectangle": velocities({"robot": RobotSpec.rectangle(6, 4), "block_solid": True}),
    "velocities of an L that stops": velocities({"robot": L_SHAPE, "contact": ContactRule.STOP}),
    "velocities at walls with friction": velocities({"wall_friction": 0.4, "control_period": 0.05}),
    "lidar": scanning({"robot": RobotSpec.rectangle(5, 5)}),
}


def command(draw: random.Random, spec: SimulationSpec) -> str:
    """A random command: half of them read a sensor."""
    drives = [drive for drive in spec.drives if drive.enabled]
    if draw.random() < 0.5:
        return draw.choice([sensor.code for sensor in spec.sensors if sensor.enabled])
    if spec.velocities and draw.random() < 0.7:
        x, y, turn, seconds = (
            draw.uniform(-9, 9),
            draw.uniform(-6, 6),
            draw.uniform(-90, 90),
            draw.uniform(0, 2),
        )
        return draw.choice(
            (f"vv-{x:.2f};{y:.2f};{turn:.1f}", f"vx-{x:.2f}", f"vr-{turn:.1f}", f"wt-{seconds:.2f}", "wt-0.3")
        )
    drive = draw.choice(drives)
    return f"{drive.code}-{draw.uniform(-120, 120) if drive.kind.turns else draw.uniform(-14, 14):.2f}"


def replies(name: str) -> list[float | str | list[float]]:
    """Replies of 90 commands from a seed of its own, and at the end the pose, all readings and the bias."""
    spec, draw = SETS[name], random.Random(name)
    simulator = Simulator(spec, seed=len(name))
    simulator.advance(START_TIME)
    found: list[float | str | list[float]] = []
    for number in range(90):
        if number == 30:
            with contextlib.suppress(PlacementError):  # in a wall: it stays where it was
                simulator.move_block(draw.uniform(10, 80), draw.uniform(8, 40))
        result = simulator.execute(command(draw, spec))
        found += [_written(result.reply), result.reason]
        if result.ranges is not None:
            found += map(_written, result.ranges)
        if result.reading is not None and isinstance(result.reading.true, float):
            found.append(_written(result.reading.true))
    pose = simulator.pose
    ends = [pose.x, pose.y, pose.heading, simulator.time, simulator.distance]
    return [*found, [float(_written(each)) for each in ends]]


def _written(value: float) -> float | str:
    """A number as JSON holds it, to a billionth: processors differ in the last bit of a sine."""
    return round(float(value), 9) + 0.0 if math.isfinite(value) else str(value)


@pytest.fixture(scope="module")
def kept() -> Callable[[str], list[float | str | list[float]]]:
    everything = json.loads(KEPT.read_text("utf-8"))
    return lambda name: list(everything[name])


@pytest.mark.quick_cases(6)
@pytest.mark.parametrize(
    "name", sorted(SETS, key=lambda name: name in ("disc", "rectangle", "velocities of a disc"))
)
def test_replies_are_those_that_were_kept(
    name: str, kept: Callable[[str], list[float | str | list[float]]]
) -> None:
    found, before = replies(name), kept(name)
    assert len(found) == len(before)
    for number, (now, then) in enumerate(zip(found, before, strict=True)):
        assert now == (then if isinstance(then, str) else pytest.approx(then, abs=2e-9, rel=1e-9)), number


if __name__ == "__main__":
    KEPT.write_text(json.dumps({name: replies(name) for name in SETS}, indent=0) + "\n", "utf-8")
