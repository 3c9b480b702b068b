"""The state of a simulator after each step of long programs, kept: whoever changes a number changes it on
purpose."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.config import load_default
from simmer_tui.errors import SimmerError, printable
from simmer_tui.sim import (
    Axes,
    ContactRule,
    DriveKind,
    Pose,
    RobotSpec,
    SimulationSpec,
    Simulator,
    parse_command,
)
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.command import Command
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.records import CommandResult
from simmer_tui.sim.sensors import Lidar, LidarSpec, LoadSensor
from simmer_tui.sim.specs import GripperSpec, SensorSpec, VelocityKind, VelocitySpec, WheelLayout, WheelsSpec
from tests.kept_numbers import assert_kept

KEPT = Path(__file__).with_name("kept_state.json")
VELOCITIES = tuple(
    VelocitySpec(kind=kind, code=code, enabled=kind is not VelocityKind.Y)
    for kind, code in zip(VelocityKind, ("vv", "vx", "vy", "vr", "ww"), strict=True)
)
BODIES = {
    "disc": RobotSpec.circle(6),
    "rectangle": RobotSpec.rectangle(6, 4),
    "L": RobotSpec.polygon(((3, 3), (-3, 3), (-3, -3), (3, -3), (3, 0), (0.5, 0.5))),
}


class Listener:
    """A listener that writes down the legs that it gets."""

    def __init__(self) -> None:
        self.planned: list[float] = []
        self.legs: list[list[float]] = []
        self.contacts: list[Any] = []
        self.expired: list[float] = []

    def leg_begun(self, leg: Leg) -> None:
        self.planned += [leg.start_time, min(leg.end_time, 1e4)]

    def leg_ended(self, leg: Leg) -> None:
        self.legs.append(numbers_of(leg))
        contact = leg.contact
        if contact is not None:
            said = (contact.ended, contact.drift, contact.held_block)
            self.contacts.append(
                [contact.point, contact.cell, contact.place, contact.time, contact.pose, *said]
            )

    def velocity_expired(self, time: float) -> None:
        self.expired.append(time)

    def found(self) -> list[Any]:
        """Numbers of the legs, added up with weights no two of which are alike."""
        legs = np.array(self.legs).reshape(-1, 9)
        sums = [weights(len(rows)) @ rows for rows in (legs, np.array(self.planned))]
        return [len(legs), legs[:, 4].sum(), *sums, self.contacts, self.expired]


def weights(count: int) -> FloatArray:
    found: FloatArray = 1.0 + np.cos(0.7 * np.arange(count))
    return found


def numbers_of(leg: Leg) -> list[float]:
    pose, counts = leg.last_pose, [leg.counts[sensor] for sensor in ("odom1", "odom3", "gyro1")]
    return [leg.start_time, leg.end_time, pose.x, pose.y, leg.pressed, pose.heading, *counts]


def equipped(**changes: Any) -> SimulationSpec:
    """The default set with a gripper, a lidar, continuous motion, lags and ramps; some rows are disabled."""
    base = load_default().simulation
    sensors = []
    for number, sensor in enumerate(base.sensors):
        more: dict[str, Any] = {"bias": 0.1 * (number % 3), "drift": 0.001 * (number % 2)}
        if sensor.code in ("u1", "u5"):
            more |= {"read_time": 0.03, "cross_talk": 0.5, "dropout": 0.1, "outlier": 0.1, "max_range": 60.0}
        if sensor.code == "u4":
            more |= {"enabled": False}
        if sensor.code == "g1":
            more |= {"random_walk": 0.2}
        sensors.append(replace(sensor, **more))
    lidar = LidarSpec(kind=Lidar, number=1, code="sc", x=1.0, z=2.0, rays=8, scan_rate=4.0)
    load = SensorSpec(kind=LoadSensor, number=1, code="l1", error=0.2)
    drives = [
        replace(drive, error=Axes(0.03, 0.02, 0.4), start_lag=0.05 * number, acceleration=20.0 * (number % 3))
        for number, drive in enumerate(base.drives)
    ]
    drives[0] = replace(drives[0], enabled=False)
    spec = replace(
        base,
        sensors=(*sensors, lidar, load),
        drives=tuple(drives),
        gripper=GripperSpec(code="p1", speed=4.0),
        velocities=VELOCITIES,
        block_center=(18.5, 42.5),
        velocity_timeout=0.8,
    )
    return replace(spec, **changes)


def state(simulator: Simulator) -> list[Any]:
    leg, last = simulator.leg, simulator.last_trajectory
    times = (simulator.time - 0.05, simulator.time, simulator.time + 0.1)
    block = simulator.block
    return [
        [simulator.time, simulator.pose, simulator.distance, simulator.commands, simulator.contacts],
        [
            int(each)
            for each in (simulator.moving, simulator.holding, simulator.noise, simulator.body.holding)
        ],
        [simulator.velocity, simulator.next_event, [simulator.distance_at(time) for time in times]],
        [block.x, block.y, block.size, block.heading, simulator.world.block.x, simulator.world.held],
        None if leg is None else numbers_of(leg),
        None if last is None else [last.start_time, last.end_time, last.kind],
        [simulator.true_value(code) for code in ("u5", "o1", "o3", "g1")],
    ]


def said(result: CommandResult) -> list[Any]:
    reading, grip, velocity, trajectory = result.reading, result.grip, result.velocity, result.trajectory
    found: list[Any] = [result.number, result.time, result.status, result.reply, result.reason, result.taken]
    found += [result.before, result.pose, result.waits, result.duration, result.ranges]
    found.append(None if reading is None else [reading.value, reading.true, reading.took])
    found.append(None if velocity is None else velocity)
    found.append(None if grip is None else [grip.time, grip.closed, grip.holding, grip.block, grip.missed])
    found.append(None if trajectory is None else [trajectory.totals, trajectory.duration, trajectory.held_at])
    return found


def later(simulator: Simulator, seconds: float) -> None:
    simulator.advance(simulator.time + seconds)


Step = str | Callable[[Simulator], object]
STOP = replace(parse_command("xx"), stops=True)
PROGRAMS: dict[str, list[Step]] = {
    "movements": [
        *("u1", "u1", "u5", "i1", "c1", "o1", "g1", "t1", "l1", "sc", "sc-90", "sc-x", "u4", "w1-3", "z1"),
        *("d", ""),
        *("d1-2", "r1-30", "a1-1.5", "o1", "g1", "wt-0.5", "wt--1", "wt-3601", "d1-1e7", "r1"),
        *("sc", "sc", "sc-90"),
        lambda simulator: simulator.begin("s1-4"),
        lambda simulator: later(simulator, 0.3),
        lambda simulator: [simulator.begin(text).reason for text in ("d1-3", "vv-1;0;0", "p1-1", "vy-1")],
        lambda simulator: [simulator.begin(text).reply for text in ("u2", "o1", "g1", "c1", "sc-10", "sc")],
        lambda simulator: simulator.move_block(30.0, 42.0),
        lambda simulator: simulator.set_bias({DriveKind.LEFT: Axes(0.3, 0.2, 0.1)}),
        lambda simulator: simulator.begin(STOP),
        *("a1-3", "g1", "o3"),
        lambda simulator: simulator.begin(STOP),
        lambda simulator: simulator.stop(),
        lambda simulator: simulator.teleport(Pose(42.0, 30.0, 45.0)),
        *("sc", "d1-50", "o1", "g1", "a1-100", "r1-400", "u1"),
        lambda simulator: simulator.refuse(Command("u1", "u1")),
        lambda simulator: simulator.teleport(Pose(54.0, 42.0, 0.0)),
        lambda simulator: simulator.reset(),
        *("u1", "d1-2"),
        lambda simulator: simulator.reset(11),
        *("u1", "d1-2"),
    ],
    "gripping": [
        *("p1-2", "p1-0", "p1-1", "l1", "l1"),
        lambda simulator: simulator.teleport(Pose(13.5, 42.0, 0.0)),
        *("p1-1", "p1-0", "p1-1", "l1", "u5", "u1", "sc", "r1-40", "sc", "d1-40", "u5", "a1-4"),
        lambda simulator: simulator.move_block(30.0, 42.0),
        lambda simulator: simulator.begin("p1-0"),
        lambda simulator: later(simulator, 0.1),
        lambda simulator: simulator.begin("p1-1").reason,
        lambda simulator: later(simulator, 0.2),
        *("d1-3", "u5", "a1-2", "p1-1", "sc"),
        lambda simulator: simulator.move_block(54.0, 42.0),
        lambda simulator: simulator.move_block(math.nan, 42.0),
        lambda simulator: simulator.move_block(simulator.pose.x, simulator.pose.y),
        lambda simulator: simulator.move_block(40.0, 30.0),
        lambda simulator: simulator.teleport(Pose(33.0, 30.0, 1.0)),
        *("d1-9", "u5", "p1-1", "l1", "a1-9"),
    ],
    "velocities": [
        *("vv-6;0;20", "u1", "u1", "g1", "o1", "vx-3", "u2", "vr--30;0.1", "wt-0.3", "vy-2", "vv-1;2"),
        "ww-1;2;3",
        lambda simulator: later(simulator, 0.4),
        *("vv-5;0;0", "vv-5;0;0"),
        lambda simulator: later(simulator, 1.5),
        *("vv-5;0;0;0.5", "wt-1", "vv-1e7;0;0", "vv-9;0;90", "wt-0.2"),
        lambda simulator: [simulator.begin(text).velocity for text in ("vx-3", "vr-9;0.25", "vx-2")],
        lambda simulator: later(simulator, 0.2),
        lambda simulator: setattr(simulator, "noise", False),
        *("u1", "wt-0.2"),
        lambda simulator: setattr(simulator, "noise", True),
        lambda simulator: simulator.set_bias({DriveKind.RIGHT: Axes(0.2, 0.1, 1.0)}),
        lambda simulator: later(simulator, 0.3),
        lambda simulator: simulator.release(),
        lambda simulator: later(simulator, 0.3),
        *("sc", "vx-20", "wt-0.7", "sc", "vx-20", "wt-0.7", "o1", "g1", "vx-20", "sc", "vr-100"),
        *("wt-0.7", "d1-1"),
        lambda simulator: simulator.begin("vx--4"),
        lambda simulator: later(simulator, 0.1),
        lambda simulator: simulator.begin(STOP),
        *("vx--20", "wt-0.5"),
        lambda simulator: simulator.move_block(20.0, 30.0),
        lambda simulator: later(simulator, 3.0),
        lambda simulator: simulator.begin_pass([parse_command("u1"), parse_command("u2")]),
        lambda simulator: simulator.begin_pass([parse_command("u2")]),
        "vx-3",
        lambda simulator: simulator.teleport(Pose(42.0, 30.0, 45.0)),
        lambda simulator: simulator.reset(),
    ],
}  # fmt: skip
SETS: dict[str, dict[str, Any]] = {
    "disc": {},
    "rectangle, solid block, kept clear": {
        "robot": BODIES["rectangle"], "block_solid": True, "clearance": 0.1, "velocity_timeout": 0.0,
    },
    "L, no lags": {
        "robot": BODIES["L"], "drives": load_default().simulation.drives, "control_period": 0.07,
    },
    "wheels, stops": {
        "contact": ContactRule.STOP, "wheels": WheelsSpec(layout=WheelLayout.OMNI_3), "randbias": False,
    },
}  # fmt: skip


IN_DIFFERENT_WAYS = [
    ("disc", "movements"),
    ("disc", "velocities"),
    ("rectangle, solid block, kept clear", "gripping"),
    ("rectangle, solid block, kept clear", "velocities"),
    ("L, no lags", "movements"),
    ("wheels, stops", "velocities"),
    ("wheels, stops", "gripping"),
]
"""Sets and programs that reach most of the simulator; the other pairs are slow tests."""
PAIRS = sorted(product(SETS, PROGRAMS), key=lambda pair: pair not in IN_DIFFERENT_WAYS)


@pytest.mark.quick_cases(len(IN_DIFFERENT_WAYS))
@pytest.mark.parametrize(("name", "program"), PAIRS)
def test_the_state_after_each_step_is_that_which_was_kept(name: str, program: str) -> None:
    simulator = Simulator(equipped(**SETS[name]), seed=3)
    simulator.listener = listener = Listener()
    found: list[Any] = []
    for step in PROGRAMS[program]:
        try:
            done = simulator.execute(step) if isinstance(step, str) else step(simulator)
        except SimmerError as error:
            done = str(error)
        found.append(said(done) if isinstance(done, CommandResult) else done)
        found.append(state(simulator))
    assert_kept([*found, *listener.found(), simulator.true_values()], KEPT, f"{program}: {name}")


def test_commands_are_what_their_rows_say() -> None:
    simulator = Simulator(equipped())
    texts = ("sc", "sc-1", "u1", "u4", "w1-1", "d1", "p1-1", "vv-1;1;1", "vy-1", "wt-1", "zz", "")
    commands = [parse_command(text) for text in texts]
    drives = [text for text, each in zip(texts, commands, strict=True) if simulator.is_drive(each)]
    scans = [text for text, each in zip(texts, commands, strict=True) if simulator.asks_for_scan(each)]
    velocities = [text for text, each in zip(texts, commands, strict=True) if simulator.is_velocity(each)]
    assert (drives, scans, velocities) == (["d1", "p1-1"], ["sc"], ["vv-1;1;1", "vy-1"])
    off = equipped(sensors=(LidarSpec(kind=Lidar, number=1, code="sc", enabled=False),))
    assert not Simulator(off).asks_for_scan(parse_command("sc"))
    same = equipped(velocities=(VelocitySpec(kind=VelocityKind.X, code="d1"),))
    assert not Simulator(same).is_velocity(parse_command("d1"))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("d1-1e6", ""),
        ("d1--1e6", ""),
        ("d1-1000000.1", "a movement of 1e+06 is beyond the limit of 1e+06"),
        ("d1-2e6", "a movement of 2e+06 is beyond the limit of 1e+06"),
        ("d1", "the value is missing, as in d1-3"),
        ("p1-0.5", "p1-1 closes the gripper and p1-0 opens it, not 0.5"),
        ("p1", "the value is missing, as in p1-1"),
        ("u4", "the code u4 is disabled"),
        ("w1-1", "the code w1 is disabled"),
        ("vy-1", "the code vy is disabled"),
        ("1u", "no sensor or drive has the code 1u; did you mean u1?"),
        ("D1", "no sensor or drive has the code D1; did you mean d1?"),
        ("i9", "no sensor or drive has the code i9; did you mean i1 or i2 or i3 or i4?"),
        ("w9", "no sensor or drive has the code w9; did you mean ww?"),
        ("zz", "no sensor or drive has the code zz"),
        ("\x1bz", "no sensor or drive has the code \\x1bz"),
        ("z", "a code has two characters"),
        ("", "an empty command"),
        ("wt-3600", ""),
        ("wt-3600.1", "wt-3600.1: a wait has 0 to 3600 seconds"),
        ("wt-0", ""),
        ("wt--0.1", "wt--0.1: a wait has 0 to 3600 seconds"),
        ("sc-1e999", "a bearing of inf is no direction"),
        ("sc-x", "'x' is not a finite decimal number, such as 3, -2.5 or 1e-3"),
    ],
)  # fmt: skip
def test_a_refusal_has_its_reason(text: str, reason: str) -> None:
    assert printable(Simulator(equipped()).begin(text).reason) == reason


def test_problems_of_a_block_and_of_poses_are_told() -> None:
    simulator = Simulator(equipped(block_size=0.0))
    with pytest.raises(SimmerError, match=r"^there is no block \(blocksize = 0\)$"):
        simulator.move_block(30.0, 30.0)
    simulator = Simulator(equipped(block_solid=True))
    with pytest.raises(SimmerError, match=r"^the block at \(9, 42.5\) would overlap the robot$"):
        simulator.move_block(9.0, 42.5)
    for shape in ((3,), (2, 2), (1, 1, 3)):
        with pytest.raises(ValueError, match=r"^true_ranges needs finite \(n, 3\) poses, not"):
            simulator.true_ranges(np.zeros(shape))
    with pytest.raises(ValueError, match=r"not \(2, 3\) and \(2,\)$"):
        simulator.cast_rays(np.zeros((2, 3)), np.zeros(2))
    with pytest.raises(ValueError, match=r"^cast_rays needs finite origins and bearings$"):
        simulator.cast_rays(np.full((1, 2), 6.0), np.array([math.inf]))
    assert simulator.true_ranges(np.full((3, 3), 6.0), []).shape == (3, 0)
    origin, bearing = np.array([(15.0, 42.5)]), np.zeros(1)
    low, high = (simulator.cast_rays(origin, bearing, z)[0] for z in (3.0, 3.001))
    assert (low, high) == (pytest.approx(2.0), pytest.approx(33.0))
    assert simulator.cast_rays(origin, bearing)[0] == high
    assert Simulator(equipped(block_size=0.0)).cast_rays(origin, bearing, 0.0)[0] == high


# -- continuous motion at walls ------------------------------------------------------------------------

WALLS: dict[str, dict[str, Any]] = {
    "disc, friction 0.8": {"wall_friction": 0.8, "control_period": 0.06},
    "disc, no friction": {"wall_friction": 0.0, "block_solid": True},
    "rectangle": {"robot": BODIES["rectangle"], "block_solid": True},
    "L, stops": {"robot": BODIES["L"], "contact": ContactRule.STOP},
    "L": {"robot": BODIES["L"]},
    "disc": {},
    "disc, stops": {"contact": ContactRule.STOP},
}


@pytest.mark.quick_cases(4)
@pytest.mark.parametrize("name", WALLS)
def test_legs_at_walls_are_those_that_were_kept(name: str) -> None:
    draw = random.Random(name)
    base = load_default().simulation
    drives = tuple(
        replace(drive, error=Axes(0.1, 0.1, 1.0), bias=Axes(0.02, 0.03, 0.5)) for drive in base.drives
    )
    spec = replace(
        base, drives=drives, velocities=VELOCITIES, randbias=False, **({"control_period": 0.05} | WALLS[name])
    )
    simulator = Simulator(spec, seed=5)
    simulator.listener = listener = Listener()
    ends = []
    for number in range(5):
        simulator.noise = number not in (1, 2)
        x, y, turn = (
            draw.uniform(4, 6),
            draw.choice((0.0, draw.uniform(-4, 4))),
            draw.choice((0.0, 50.0, -20.0)),
        )
        simulator.begin(f"vv-{draw.choice((1, -1)) * x};{y};{turn}")
        for _ in range(3):
            later(simulator, draw.uniform(0.3, 1.2))
            ends.append([simulator.time, simulator.pose, simulator.distance, simulator.contacts])
            ends.append([simulator.true_value(code) for code in ("o1", "o3", "g1")])
    assert_kept([ends, *listener.found()], KEPT, f"walls: {name}")
