"""The state of a run at a moment, as screens show it, and the checkpoint that a reducer continues from."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from msgspec import Struct, field

from simmer_tui.run.events import (
    Belief,
    CommandResult,
    DisplayChanged,
    Goal,
    MovementEnded,
    MovementPlanned,
    PortLine,
    Result,
    TwinReading,
)
from simmer_tui.sim.arcs import Twist
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.path import Contact
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import Reading
from simmer_tui.sim.simulator import Simulator
from simmer_tui.sim.specs import Axes, DriveKind, SimulationSpec

NO_PATH: FloatArray = np.empty((0, 3))
"""The path of a robot that has not moved."""


def timed_line(points: FloatArray, begin: float, end: float) -> FloatArray:
    """Points (n, 2) with the times at which an even motion passes them, (n, 3)."""
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
    share = along / along[-1] if along[-1] > 0.0 else np.linspace(0.0, 1.0, len(points))
    return np.column_stack((points, begin + share * (end - begin)))


class SensorRow(Struct, frozen=True):
    """The readings of one sensor: the newest one, and those before it (oldest first). Of the newest, also the
    running number of its event, its simulated time, and the poses of robot and block then."""

    reading: Reading
    history: tuple[float, ...]
    number: int
    time: float
    pose: Pose
    block: Block


class TimeSpent(Struct, frozen=True):
    """Simulated time since the last restart by use, seconds: driving, reading sensors (by code) and on the
    link. The rest is waiting. Where a sensor is read during a drive, both count."""

    driving: float = 0.0
    link: float = 0.0
    by_sensor: Mapping[str, float] = field(default_factory=dict)

    @property
    def reading(self) -> float:
        """Time spent on reading sensors, seconds."""
        return sum(self.by_sensor.values())


class MissionSums(Struct, frozen=True):
    """Sums of a run at the end of its mission: simulated seconds, inches and counts. Later events do not
    change them."""

    time: float
    distance: float
    commands: int
    contacts: int
    spent: TimeSpent


class MissionProgress(Struct, frozen=True):
    """Progress of a mission: when each goal was met (simulated time, None for those that are not),
    how it stands, and why it failed. `helped` is true if a person put robot or block elsewhere, or took
    errors away. `end` is None while the mission is under way."""

    goals: Mapping[Goal, float | None] = field(default_factory=lambda: dict.fromkeys(Goal))
    result: Result = Result.UNDER_WAY
    reason: str = ""
    helped: bool = False
    end: MissionSums | None = None

    @property
    def over(self) -> bool:
        """True if the mission has ended."""
        return self.result is not Result.UNDER_WAY


class Checkpoint(Struct, frozen=True, kw_only=True):
    """All that a reducer must know of a run to continue from a moment at which the robot stands still.

    `contact_points` are the places touched since the last restart. `bias` is the drives' bias in force; a
    checkpoint in a log has none.
    """

    spec: SimulationSpec
    time: float
    pose: Pose
    block: Block
    seed: int
    holding: bool = False
    noise: bool = True
    paused: bool = False
    time_scale: float = 1.0
    commands: int = 0
    contacts: int = 0
    contact_points: tuple[tuple[float, float], ...] = ()
    distance: float = 0.0
    client: str = ""
    mission: MissionProgress | None = None
    spent: TimeSpent = TimeSpent()
    bias: Mapping[DriveKind, Axes] = field(default_factory=dict)
    displays: tuple[DisplayChanged, ...] = ()
    """The newest change of each board that has shown something."""
    lines: tuple[PortLine, ...] = ()
    """The last line of each port of each board."""


def checkpoint_of(simulator: Simulator, *, mission: bool = False, time_scale: float = 1.0) -> Checkpoint:
    """The present checkpoint of a simulator. With `mission` a mission is under way."""
    return Checkpoint(
        spec=simulator.spec,
        time=simulator.time,
        pose=simulator.pose,
        block=simulator.block,
        seed=simulator.seed,
        holding=simulator.holding,
        noise=simulator.noise,
        time_scale=time_scale,
        commands=simulator.commands,
        contacts=simulator.contacts,
        distance=simulator.distance_at(simulator.time),
        mission=MissionProgress() if mission else None,
        bias=simulator.bias,
    )


class State(Checkpoint, frozen=True, kw_only=True, eq=False):
    """A run at one moment, also during a movement. Nothing here changes any more; any thread may read it.

    `contact` is the first contact of the latest movement, as soon as it has come; at velocities it is the
    latest since they began. `touching` is true while the robot stands there. `path` is that of the latest
    movement till now, (n, 3): x and y in inches, simulated seconds. It has no rows before the first.
    `moved` is the running number of the last event that moved the robot. `twins` holds, by sensor code, the
    last readings of the real robot and its twin. `ended` is the end of the latest movement that is over; at a
    velocity, of the latest leg with a contact. `movement` is the plan of one under way.
    """

    number: int
    moving: bool
    touching: bool
    contact: Contact | None
    velocity: Twist | None
    """The velocity in force; None while there is none."""
    path: FloatArray
    moved: int
    moved_by: str
    """Source of the command that moved it then; empty if the robot was put elsewhere."""
    sensors: Mapping[str, SensorRow]
    twins: Mapping[str, TwinReading]
    last: CommandResult | None
    ended: MovementEnded | None
    movement: MovementPlanned | None
    belief: Belief | None
