"""The simulation, without files, clocks or sockets: a public API for notebooks and programs.

    from simmer_tui.config import load_default
    from simmer_tui.sim import Simulator

    simulator = Simulator(load_default().simulation, seed=7)
    simulator.execute("d1-3")
    simulator.execute("u1").reply

See `Simulator` for stepping, reading the truth, and casting many rays at once.
"""

from simmer_tui.sim.block import Block
from simmer_tui.sim.command import Command, parse_command
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.path import Contact
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import CommandResult, FloorPatch, Grip, RangeScan, Reading, Status
from simmer_tui.sim.sensors import (
    Compass,
    CountingSensor,
    Gyro,
    LineSensor,
    LoadSensor,
    ObservingSensor,
    Odometer,
    RangeSensor,
    Sensor,
    TimeOfFlight,
    Ultrasonic,
    World,
    sensor_kinds,
)
from simmer_tui.sim.simulator import Simulator
from simmer_tui.sim.specs import (
    Axes,
    ContactRule,
    DriveKind,
    DriveSpec,
    GripperSpec,
    MazeSpec,
    RobotSpec,
    SensorKind,
    SensorSpec,
    SimulationSpec,
)
from simmer_tui.sim.trajectory import Trajectory

__all__ = [
    "Axes",
    "Block",
    "Command",
    "CommandResult",
    "Compass",
    "Contact",
    "ContactRule",
    "CountingSensor",
    "DriveKind",
    "DriveSpec",
    "FloorPatch",
    "Grip",
    "GripperSpec",
    "Gyro",
    "LineSensor",
    "LoadSensor",
    "Maze",
    "MazeSpec",
    "ObservingSensor",
    "Odometer",
    "Pose",
    "RangeScan",
    "RangeSensor",
    "Reading",
    "RobotSpec",
    "Sensor",
    "SensorKind",
    "SensorSpec",
    "SimulationSpec",
    "Simulator",
    "Status",
    "TimeOfFlight",
    "Trajectory",
    "Ultrasonic",
    "World",
    "parse_command",
    "sensor_kinds",
]
