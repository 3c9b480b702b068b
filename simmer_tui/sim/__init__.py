"""The world as functions of time: maze, robot, sensors, motion, contact and noise.

In: a `SimulationSpec`, a seed, and commands with their simulated times.
Out: a `CommandResult` for each command: reply, true value, path, contact and rays.

A public API for notebooks and programs, without files, clocks or sockets:

    from simmer_tui.config import load_default
    from simmer_tui.sim import Simulator

    simulator = Simulator(load_default().simulation, seed=7)
    simulator.execute("d1-3")
    simulator.execute("u1").reply

See `Simulator` for stepping, reading the truth, and casting many rays at once.
"""

from simmer_tui.sim.arcs import Arc as Arc
from simmer_tui.sim.arcs import Twist as Twist
from simmer_tui.sim.block import Block as Block
from simmer_tui.sim.command import Command as Command
from simmer_tui.sim.command import parse_command as parse_command
from simmer_tui.sim.legs import Leg as Leg
from simmer_tui.sim.maze import Maze as Maze
from simmer_tui.sim.path import Contact as Contact
from simmer_tui.sim.pose import Pose as Pose
from simmer_tui.sim.records import CommandResult as CommandResult
from simmer_tui.sim.records import FloorPatch as FloorPatch
from simmer_tui.sim.records import Grip as Grip
from simmer_tui.sim.records import RangeScan as RangeScan
from simmer_tui.sim.records import Reading as Reading
from simmer_tui.sim.records import Status as Status
from simmer_tui.sim.records import VelocityChange as VelocityChange
from simmer_tui.sim.sensors import Compass as Compass
from simmer_tui.sim.sensors import CountingSensor as CountingSensor
from simmer_tui.sim.sensors import Gyro as Gyro
from simmer_tui.sim.sensors import LineSensor as LineSensor
from simmer_tui.sim.sensors import LoadSensor as LoadSensor
from simmer_tui.sim.sensors import ObservingSensor as ObservingSensor
from simmer_tui.sim.sensors import Odometer as Odometer
from simmer_tui.sim.sensors import RangeSensor as RangeSensor
from simmer_tui.sim.sensors import RangeSpec as RangeSpec
from simmer_tui.sim.sensors import Sensor as Sensor
from simmer_tui.sim.sensors import TimeOfFlight as TimeOfFlight
from simmer_tui.sim.sensors import Ultrasonic as Ultrasonic
from simmer_tui.sim.sensors import World as World
from simmer_tui.sim.sensors import sensor_kinds as sensor_kinds
from simmer_tui.sim.simulator import Simulator as Simulator
from simmer_tui.sim.specs import Axes as Axes
from simmer_tui.sim.specs import ContactRule as ContactRule
from simmer_tui.sim.specs import DriveKind as DriveKind
from simmer_tui.sim.specs import DriveSpec as DriveSpec
from simmer_tui.sim.specs import GripperSpec as GripperSpec
from simmer_tui.sim.specs import MazeSpec as MazeSpec
from simmer_tui.sim.specs import RobotSpec as RobotSpec
from simmer_tui.sim.specs import SensorKind as SensorKind
from simmer_tui.sim.specs import SensorSpec as SensorSpec
from simmer_tui.sim.specs import SimulationSpec as SimulationSpec
from simmer_tui.sim.specs import VelocityKind as VelocityKind
from simmer_tui.sim.specs import VelocitySpec as VelocitySpec
from simmer_tui.sim.specs import WheelLayout as WheelLayout
from simmer_tui.sim.specs import WheelsSpec as WheelsSpec
from simmer_tui.sim.trajectory import Trajectory as Trajectory
