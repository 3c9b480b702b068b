"""The simulated robot: commands in, outcomes out. No clock, no sockets, no files."""

import math
from collections.abc import Iterable

import numpy as np
from msgspec.structs import replace

from simmer_tui.errors import PlacementError, UnknownSensorError
from simmer_tui.sim import noise
from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.command import Command, parse_command, parse_value
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.gripper import Gripper
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.motion import CollisionChecker, Planner
from simmer_tui.sim.obstacles import Obstacles, block_problem, robot_problem
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import TOO_MANY_WAIT, CommandResult, Grip, Reading, Status
from simmer_tui.sim.sensors import (
    CountingSensor,
    Faults,
    ObservingSensor,
    Pings,
    RangeSensor,
    Sensor,
    View,
    World,
    has_faults,
    sensor_of,
)
from simmer_tui.sim.specs import Axes, DriveKind, DriveSpec, GripperSpec, SensorSpec, SimulationSpec
from simmer_tui.sim.trajectory import Trajectory

# 16 miles, beyond any maze by far; at 1e6 in a coordinate still has nine decimals.
LARGEST_VALUE = 1e6
"""Greatest movement one command may ask for, inches or degrees (times Gain)."""


class Simulator:
    """One robot in one maze.

        simulator = Simulator(spec, seed=7)
        outcome = simulator.execute("u1")
        outcome.reply, outcome.reading.true

    `execute` does a whole command and moves simulated time on by what it takes. For motion in
    real time there are the pieces: `advance` sets the time, `begin` starts a command (a movement
    then goes on by itself as time advances), `stop` ends a movement.
    """

    def __init__(self, spec: SimulationSpec, seed: int = 0) -> None:
        """`seed` rules all randomness. Raises PlacementError if robot or block stand in a wall."""
        self.spec = spec
        self.maze = Maze(spec.maze)
        self.footprint = Footprint.of(spec.robot)
        self.walls = Obstacles.of_maze(self.maze.walls)
        self._sensors = {sensor.code: sensor_of(sensor) for sensor in spec.sensors}
        self._drives: dict[str, DriveSpec | GripperSpec] = {drive.code: drive for drive in spec.drives}
        if spec.gripper is not None:
            self._drives[spec.gripper.code] = spec.gripper
        working = self._sensors.values()
        self._ranging = {each.spec.code: each for each in working if isinstance(each, RangeSensor)}
        self._counting = [each for each in working if isinstance(each, CountingSensor)]
        self._seen: dict[str, tuple[Pose, tuple[float, View | None]]] = {}
        """The last view of each observing sensor, with the pose it was seen from."""
        self.noise = True
        """True if sensors and drives have random errors. Biases stay."""
        self._trajectory: Trajectory | None = None
        self._last: Trajectory | None = None
        self.seed = seed
        self.reset()

    # -- the state, all of it readable -------------------------------------------------------

    def reset(self, seed: int | None = None) -> None:
        """Everything as at the start, with the same seed or a new one."""
        if self._trajectory is not None:
            self.stop()
        if seed is not None:
            self.seed = seed
        spec = self.spec
        self.time = 0.0
        """Simulated time, seconds."""
        self.commands = 0
        """Number of commands so far."""
        self.contacts = 0
        """Number of finished movements that met an obstacle, whether that ended them or not."""
        self.distance = 0.0
        """Inches driven in finished movements."""
        self._streams = noise.Streams(self.seed)
        pings = Pings()
        self._faults = {
            code: Faults(sensor, self._streams[noise.fault_stream(sensor.spec.id)], pings)
            for code, sensor in self._sensors.items()
            if has_faults(sensor)
        }
        self._planner = Planner(spec.num_segments, spec.contact, self._streams, spec.clearance)
        # Drawn when first asked for: a run that never drives needs no draws.
        self._bias: dict[DriveKind, Axes] | None = None
        self._counted = {sensor.spec.id: 0.0 for sensor in self._counting}
        self._gripper = Gripper(self.footprint, self.walls)
        self._pose = Pose(float(spec.bot_center[0]), float(spec.bot_center[1]), float(spec.bot_rot))
        self._set_block(self._checked_block(spec.block_center))
        self._check_pose(self._pose)

    @property
    def pose(self) -> Pose:
        """The robot's present pose."""
        return self._pose if self._trajectory is None else self._trajectory.pose_at(self.time)

    @property
    def trajectory(self) -> Trajectory | None:
        """The movement under way, if there is one."""
        return self._trajectory

    @property
    def last_trajectory(self) -> Trajectory | None:
        """The movement under way, or else the last one that ended."""
        return self._trajectory or self._last

    def distance_at(self, time: float) -> float:
        """Inches driven so far, the movement under way included."""
        under_way = self._trajectory.travelled(time) if self._trajectory is not None else 0.0
        return self.distance + under_way

    @property
    def moving(self) -> bool:
        """True if a drive command is under way (also while a wall holds the robot)."""
        return self._trajectory is not None

    @property
    def world(self) -> World:
        """Maze and block as they are now, for ray casts of your own."""
        return self._world_at(self.pose) if self.holding else self._world

    @property
    def block(self) -> Block:
        """The block's present pose; while it is held it goes with the robot."""
        return self._gripper.block(self._world.block, self.pose)

    @property
    def holding(self) -> bool:
        """True if the gripper holds the block."""
        return self._gripper.held is not None

    @property
    def body(self) -> Footprint:
        """The body that can run into a wall: the robot's footprint, and the block while it is held."""
        return self._gripper.body

    @property
    def bias(self) -> dict[DriveKind, Axes]:
        """The drive bias in force, by kind of movement."""
        if self._bias is None:
            spec = self.spec
            self._bias = (
                noise.random_bias(self.seed, spec.strength)
                if spec.randbias
                else {drive.kind: drive.bias for drive in spec.drives}
            )
        return self._bias

    def is_drive(self, command: Command) -> bool:
        """True if a command's code is that of an enabled drive, or of the gripper."""
        drive = self._drives.get(command.code)
        return drive is not None and drive.enabled

    def sensor(self, code: str) -> SensorSpec:
        """The sensor with a command code. Raises UnknownSensorError."""
        return self._working(code).spec

    # -- commands ----------------------------------------------------------------------------

    def execute(self, command: Command | str) -> CommandResult:
        """Do one command from beginning to end. Simulated time jumps to the end of a movement, and on
        by a sensor's Read Time."""
        outcome = self.begin(command)
        reading = outcome.reading
        takes = outcome.status is Status.ACCEPTED if reading is None else reading.took > 0.0
        return self.finish(outcome) if takes else outcome

    def begin(self, command: Command | str) -> CommandResult:
        """Read a sensor, or plan a movement and set it going at the present simulated time.

        A movement gives `ACCEPTED`, and `trajectory` is its plan; while one is under way another is
        refused as `BUSY`. Malformed and unknown commands give NaN, change nothing and draw no
        random number. A command that stops ends the movement and gives `STOPPED`.
        """
        if isinstance(command, str):
            command = parse_command(command)
        self.commands += 1
        before = self.pose
        # Stopping comes before all checks: it must work whatever the robot is doing.
        if command.stops:
            self.stop()
            return CommandResult(
                self.commands, self.time, command, Status.STOPPED, math.inf, before, self.pose
            )
        if command.problem:
            return self._refused(command, before, Status.REFUSED, command.problem)
        sensor = self._sensors.get(command.code)
        if sensor is not None and sensor.spec.enabled:
            reading = self._read(sensor, before)
            return CommandResult(
                self.commands, self.time, command, Status.READING, reading.value, before, before, "", reading
            )
        drive = self._drives.get(command.code)
        if drive is None or not drive.enabled:
            return self._refused(command, before, Status.UNKNOWN, self._unknown(command.code))
        value = _amount(drive, command.argument)
        if isinstance(value, str):
            return self._refused(command, before, Status.REFUSED, value)
        if self._trajectory is not None:
            return self._refused(command, before, Status.BUSY, "the robot is still moving")
        grip = None
        if isinstance(drive, GripperSpec):
            grip = self._grip(drive, value == 1.0, before)
        else:
            self._plan(drive, value, before)
        return CommandResult(
            self.commands, self.time, command, Status.ACCEPTED, math.inf, before, before, grip=grip
        )

    def refuse(self, command: Command) -> CommandResult:
        """The outcome of a command that is not looked at, since too many wait: `BUSY`."""
        self.commands += 1
        return self._refused(command, self.pose, Status.BUSY, TOO_MANY_WAIT)

    def finish(self, outcome: CommandResult) -> CommandResult:
        """The outcome of a whole command from the one that began it. Simulated time goes on to the
        end of the movement, unless it is over already, or by what the reading takes."""
        if outcome.reading is not None:
            self.advance(outcome.time + outcome.reading.took)
            return replace(outcome, time=self.time, pose=self.pose, taken=outcome.time)
        trajectory = self._trajectory or self._last
        assert trajectory is not None, "no movement has begun"
        if self._trajectory is not None:
            self.advance(trajectory.end_time)
        end = trajectory.end_time
        return replace(
            outcome,
            time=end,
            status=Status.DONE,
            pose=trajectory.pose_at(end),
            trajectory=trajectory,
            taken=trajectory.start_time,
        )

    def advance(self, time: float) -> None:
        """Set simulated time, which never goes back. A movement that ends by then is over."""
        # Clocks of callers may be behind by a little; simulated time never is.
        self.time = max(time, self.time)
        trajectory = self._trajectory
        if trajectory is None or self.time < trajectory.end_time:
            return
        end = trajectory.end_time
        self._pose = trajectory.pose_at(end)
        self.distance += trajectory.travelled(end)
        self.contacts += trajectory.contact is not None
        for sensor in self._counting:
            self._counted[sensor.spec.id] = self._count(sensor, end)
        self._trajectory, self._last = None, trajectory

    def stop(self) -> bool:
        """End the movement under way now. Returns whether there was one."""
        if self._trajectory is None:
            return False
        self._trajectory = self._trajectory.stopped(self.time)
        self.advance(self.time)
        return True

    # -- what people may change ---------------------------------------------------------------

    def teleport(self, pose: Pose) -> None:
        """Put the robot, and the block if it holds it, somewhere, ending its movement. Raises
        PlacementError inside a wall."""
        self._check_pose(pose)
        self.stop()
        self._pose = pose

    def move_block(self, x: float, y: float) -> None:
        """Put the block somewhere. A movement under way is checked anew against it, without new
        random draws. Raises PlacementError inside a wall, if it is solid inside the robot, while
        it is held, and if there is none."""
        if not self.spec.block_size:
            raise PlacementError("there is no block (blocksize = 0)")
        if self.holding:
            raise PlacementError("the gripper holds the block; open it before the block is put elsewhere")
        block = self._checked_block((x, y))
        if self.spec.block_solid:
            # The footprint, not the body: nothing is held here.
            blocked = self.walls.with_block(block).overlap(self.footprint, self.pose)
            if blocked:
                raise PlacementError(f"the block at ({x:g}, {y:g}) would overlap the robot")
        self._set_block(block)
        # What was drawn stays: moving the block must not change the errors of a run.
        if self._trajectory is not None and self.spec.block_solid:
            checker = CollisionChecker(self.footprint, self._obstacles, self.maze)
            self._trajectory = self._planner.checked_again(self._trajectory, self.time, checker)

    def set_bias(self, bias: dict[DriveKind, Axes]) -> None:
        """Replace the drive bias, for some or all kinds of movement."""
        self._bias = {**self.bias, **bias}

    # -- truth, for programs that learn or localize --------------------------------------------

    def true_value(self, code: str) -> float:
        """The reading of a sensor now, without random error. Raises UnknownSensorError."""
        return self._observe(self._working(code), self.pose)[0]

    def true_values(self) -> dict[str, float]:
        """Readings of all enabled sensors now, without random error, by code."""
        return {code: self.true_value(code) for code, sensor in self._sensors.items() if sensor.spec.enabled}

    def look(self, code: str) -> Reading:
        """The true value as a reading with its geometry, drawing nothing. Raises
        UnknownSensorError."""
        sensor = self._working(code)
        true, view = self._observe(sensor, self.pose)
        return Reading(sensor.spec, true, true, view)

    def cast_rays(self, origins: FloatArray, bearings: FloatArray, z: float = math.inf) -> FloatArray:
        """Distances, inches, from (n, 2) origins along (n,) bearings in degrees to the first wall,
        or to the block for rays at a height `z` no greater than it. From inside a wall 0.

        Raises ValueError for shapes that do not fit or numbers that are not finite.
        """
        origins = np.asarray(origins, dtype=np.float64)
        bearings = np.asarray(bearings, dtype=np.float64)
        if bearings.ndim != 1 or origins.shape != (len(bearings), 2):
            raise ValueError(
                f"cast_rays needs (n, 2) origins and (n,) bearings, not {origins.shape} and {bearings.shape}"
            )
        if not (np.isfinite(origins).all() and np.isfinite(bearings).all()):
            raise ValueError("cast_rays needs finite origins and bearings")
        size = self.block.size
        return self.world.rays(origins, bearings, 0.0 if size and z <= size else math.inf)

    def true_ranges(self, poses: FloatArray, codes: Iterable[str] | None = None) -> FloatArray:
        """The true ranges of range sensors at many poses: (n, k) inches for (n, 3) poses of x, y
        and heading, and k codes (by default all enabled range sensors, in file order). The block
        stays where it is, held or not.

        Raises ValueError for poses of another shape or not finite, UnknownSensorError for other
        codes.
        """
        poses = np.asarray(poses, dtype=np.float64)
        if poses.ndim != 2 or poses.shape[1] != 3 or not np.isfinite(poses).all():
            raise ValueError(f"true_ranges needs finite (n, 3) poses, not {poses.shape}")
        chosen = self.ranging_codes() if codes is None else list(codes)
        world = self.world
        columns = [self._ranger(code).ranges(world, poses) for code in chosen]
        return np.column_stack(columns) if columns else np.empty((len(poses), 0))

    def ranging_codes(self) -> list[str]:
        """Codes of the enabled range sensors, in file order."""
        return [code for code, sensor in self._ranging.items() if sensor.spec.enabled]

    # -- within --------------------------------------------------------------------------------

    def _working(self, code: str) -> Sensor:
        try:
            return self._sensors[code]
        except KeyError:
            raise UnknownSensorError(code, self._sensors) from None

    def _ranger(self, code: str) -> RangeSensor:
        try:
            return self._ranging[code]
        except KeyError:
            raise UnknownSensorError(code, self._ranging, "range sensor") from None

    def _read(self, sensor: Sensor, pose: Pose) -> Reading:
        true, view = self._observe(sensor, pose)
        spec = sensor.spec
        if not self.noise:
            value = sensor.reading(true, None, self.time)
        elif (faults := self._faults.get(spec.code)) is not None:
            value = faults.reading(true, self._streams[spec.id], self.time)
        else:
            value = sensor.reading(true, self._streams[spec.id], self.time)
        return Reading(spec, value, true, view, spec.read_time)

    def _observe(self, sensor: Sensor, pose: Pose) -> tuple[float, View | None]:
        code = sensor.spec.code
        seen = self._seen.get(code)
        if seen is not None and seen[0] is pose:
            # A robot at rest keeps its pose, and its view.
            return seen[1]
        if isinstance(sensor, ObservingSensor):
            observed = sensor.observe(self._world_at(pose), pose)
            self._seen[code] = (pose, observed)
            return observed
        assert isinstance(sensor, CountingSensor), "a sensor observes or counts"
        return self._count(sensor, self.time), None

    def _count(self, sensor: CountingSensor, time: float) -> float:
        counted = self._counted[sensor.spec.id]
        return counted if self._trajectory is None else counted + sensor.counted(self._trajectory, time)

    def _plan(self, drive: DriveSpec, value: float, pose: Pose) -> None:
        bias = self.bias.get(drive.kind, Axes())
        trajectory = self._planner.plan(drive, bias, value, pose, self.time, self.noise)
        trajectory = self._planner.counted(trajectory, self._counting, self.noise)
        checker = CollisionChecker(self.body, self._obstacles_at(pose), self.maze)
        self._trajectory = self._planner.checked(trajectory, checker)

    def _grip(self, spec: GripperSpec, close: bool, pose: Pose) -> Grip:
        """The jaws act at once; the robot then stands still for as long as they take."""
        grip = self._gripper.move(spec, close, self._world.block, pose, self.time)
        block = grip.block
        self._set_block(Block(block.x, block.y, self.spec.block_size, block.heading))
        self._trajectory = self._planner.standing(pose, self.time, 1.0 / spec.speed, self._counting)
        return grip

    def _world_at(self, pose: Pose) -> World:
        if not self.holding:
            return self._world
        return World(self.maze, self._gripper.block(self._world.block, pose), held=True)

    def _obstacles_at(self, pose: Pose) -> Obstacles:
        """Obstacles for a robot that sets off at a pose. A block just let go may overlap the robot,
        if only by rounding; it is no obstacle until the robot has left it."""
        solid = self.spec.gripper is not None and self._obstacles is not self.walls
        return self.walls if solid and self._obstacles.overlap(self.body, pose) else self._obstacles

    def _refused(self, command: Command, pose: Pose, status: Status, reason: str) -> CommandResult:
        return CommandResult(self.commands, self.time, command, status, math.nan, pose, pose, reason)

    def _unknown(self, code: str) -> str:
        if code in self._sensors or code in self._drives:
            return f"the code {code} is disabled"
        known = [sensor.code for sensor in self.spec.sensors if sensor.enabled]
        known += [drive.code for drive in self._drives.values() if drive.enabled]
        near = [other for other in known if other.lower() == code.lower() or other == code[::-1]]
        near = near or [other for other in known if other[0] == code[0]]
        hint = f"; did you mean {' or '.join(near)}?" if near else ""
        return f"no sensor or drive has the code {Command(code).shown}{hint}"

    def _check_pose(self, pose: Pose) -> None:
        problem = robot_problem(self.maze, self._obstacles, self.body, pose)
        if problem:
            raise PlacementError(problem)

    def _checked_block(self, centre: tuple[float, float]) -> Block:
        block = Block(*centre, self.spec.block_size)
        problem = block_problem(self.maze, self.walls, block)
        if problem:
            raise PlacementError(problem)
        return block

    def _set_block(self, block: Block) -> None:
        # The block where it lies.
        self._world = World(self.maze, block)
        self._seen.clear()
        solid = self.spec.block_solid and block.size > 0.0 and not self.holding
        self._obstacles = self.walls.with_block(block) if solid else self.walls


def _amount(drive: DriveSpec | GripperSpec, argument: str | None) -> float | str:
    """The value that a command asks of a drive (times Gain) or the gripper, or why it is refused, as text."""
    value = parse_value(argument)
    if isinstance(value, str):
        return value
    if isinstance(drive, GripperSpec):
        if value in (0.0, 1.0):
            return value
        return f"{drive.code}-1 closes the gripper and {drive.code}-0 opens it, not {value:g}"
    value *= drive.gain
    if abs(value) <= LARGEST_VALUE:
        return value
    return f"a movement of {value:g} is beyond the limit of {LARGEST_VALUE:g}"
