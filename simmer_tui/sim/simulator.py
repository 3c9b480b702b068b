"""The simulated robot: commands in, results out. No clock, no sockets, no files."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace

from simmer_tui.errors import DeviceError, PlacementError, UnknownSensorError
from simmer_tui.sim import noise
from simmer_tui.sim.arcs import Twist
from simmer_tui.sim.arrays import ArrayLike, FloatArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.command import (
    LARGEST_VALUE,
    Command,
    parse_command,
    parse_value,
)
from simmer_tui.sim.continuous import ContinuousMotion, MotionListener
from simmer_tui.sim.device_faults import faults_of, plain_number, plain_view
from simmer_tui.sim.distance_errors import DistanceErrors
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.gripper import Gripper
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.motion import CollisionChecker, Planner
from simmer_tui.sim.obstacles import Obstacles, block_problem, robot_problem
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.recent_motion import BlockPlace, RecentMotion
from simmer_tui.sim.records import TOO_MANY_WAIT, CommandResult, Grip, Reading, Status, VelocityChange
from simmer_tui.sim.sensors.base import CountingSensor, ObservingSensor, Sensor, View, World, sensor_of
from simmer_tui.sim.sensors.faults import Faults, Pings, has_faults
from simmer_tui.sim.sensors.lidar import Lidar, Now, Turning
from simmer_tui.sim.sensors.range_sensors import RangeSensor
from simmer_tui.sim.specs import Axes, DriveKind, DriveSpec, GripperSpec, SensorSpec, SimulationSpec
from simmer_tui.sim.trajectory import Trajectory
from simmer_tui.sim.unknown_codes import unknown_code
from simmer_tui.sim.velocity_commands import WAIT, VelocityControl, VelocityRequest, parse_wait

_STILL_MOVING = "the robot is still moving"
"""The reason of a movement that is refused while another is under way."""


class Simulator:
    """One robot in one maze.

        simulator = Simulator(spec, seed=7)
        result = simulator.execute("u1")
        result.reply, result.reading.true

    `execute` does a whole command and advances simulated time by its duration. Motion in real time uses the
    steps: `advance` sets the time, `begin` starts a command (a movement then continues as time advances),
    `stop` ends a movement.
    """

    def __init__(self, spec: SimulationSpec, seed: int = 0) -> None:
        """`seed` determines all randomness. Raises PlacementError if robot or block overlap a wall, and
        ValueError for a seed that is no whole number from 0 to 2^128 - 1."""
        self.spec = spec
        self.maze = Maze(spec.maze)
        self.footprint = Footprint.of(spec.robot)
        self.walls = Obstacles.of_maze(self.maze.walls)
        self._sensors = {sensor.code: sensor_of(sensor) for sensor in spec.sensors}
        self._drives = {row.code: row for row in spec.drive_rows}
        self._velocities = {velocity.code: velocity for velocity in spec.velocities}
        self._control = VelocityControl(spec.drives, spec.wheels)
        working = self._sensors.values()
        self._ranging = {each.spec.code: each for each in working if isinstance(each, RangeSensor)}
        self._counting = [each for each in working if isinstance(each, CountingSensor)]
        self._lidars = [each for each in working if isinstance(each, Lidar)]
        self.has_lidars = bool(self._lidars)
        """True if a command may have to wait for a scan (`wait_for_scan`)."""
        self._looks_back = max((each.looks_back for each in working), default=0.0)
        self.velocity_codes = frozenset(self._velocities.keys() - self._drives.keys())
        """Codes of the commands that set a velocity that lasts."""
        self._seen: dict[str, tuple[Pose, tuple[float, View | None]]] = {}
        """The last view of each observing sensor, with its pose."""
        self._noise = True
        self.listener: MotionListener | None = None
        """Listener to continuous motion, called after the simulator itself."""
        self.trajectory: Trajectory | None = None
        """The movement under way, if there is one."""
        self._last: Trajectory | None = None
        self._begin_run(noise.checked_seed(seed))

    # -- the state, all of it readable -------------------------------------------------------

    def reset(self, seed: int | None = None) -> None:
        """Everything as at the start, with the same seed or a new one. Raises as the constructor does."""
        seed = self.seed if seed is None else noise.checked_seed(seed)
        self.stop()
        self._begin_run(seed)

    def _begin_run(self, seed: int) -> None:
        """The start of a run with nothing in motion."""
        spec = self.spec
        self.seed = seed
        self.time = 0.0
        """Simulated time, seconds."""
        self._asked: set[str] = set()
        """Codes received since simulated time last advanced, at `_asked_at`."""
        self._asked_at = 0.0
        self.commands = 0
        """Number of commands so far."""
        self.contacts = 0
        """Number of finished movements with a contact, even if it did not end them."""
        self.distance = 0.0
        """Inches driven in finished movements."""
        self._streams = noise.Streams(seed)
        self._recent = RecentMotion(self._looks_back)
        self._turning = {each.spec.code: Turning(each, self.maze, self._recent) for each in self._lidars}
        pings = Pings()
        self._faults = {
            code: Faults(sensor, self._streams[noise.fault_stream(sensor.id)], pings)
            for code, sensor in self._sensors.items()
            if has_faults(sensor) and code not in self._turning
        }
        self._planner = Planner(spec.num_segments, spec.contact, self._streams, spec.clearance)
        self.bias = noise.drive_bias(spec, seed, random=spec.randbias)
        """The drive bias in force, by kind of movement."""
        self._counted = {sensor.id: 0.0 for sensor in self._counting}
        errors = DistanceErrors(spec.num_segments, self._streams, self._counting)
        self._continuous = ContinuousMotion(spec, self._bias_in_force, errors, self._checker, self)
        self._gripper = Gripper(self.footprint, self.walls)
        self._pose = spec.start_pose
        self._set_block(self._checked_block(spec.block_center))
        self._check_pose(self._pose)

    @property
    def pose(self) -> Pose:
        """The robot's present pose."""
        under_way = self.trajectory or self._continuous.leg
        return self._pose if under_way is None else under_way.pose_at(self.time)

    @property
    def noise(self) -> bool:
        """True if sensors and drives have random errors. Biases stay."""
        return self._noise

    @noise.setter
    def noise(self, on: bool) -> None:
        self._noise = on
        self._drive_on()

    @property
    def leg(self) -> Leg | None:
        """The leg of a continuous motion under way, if there is one."""
        return self._continuous.leg

    @property
    def next_event(self) -> float:
        """Simulated time of the next event of a continuous motion, infinite if there is none."""
        return self._continuous.due

    @property
    def velocity(self) -> Twist:
        """The velocity commanded last, in force until the next command: in/s and deg/s."""
        return self._continuous.commanded

    @property
    def last_trajectory(self) -> Trajectory | None:
        """The movement under way, or else the last one that ended."""
        return self.trajectory or self._last

    def distance_at(self, time: float) -> float:
        """Inches driven so far, the movement under way included."""
        under_way = self.trajectory or self._continuous.leg
        return self.distance if under_way is None else self.distance + under_way.travelled(time)

    @property
    def moving(self) -> bool:
        """True if a drive command is under way (also while a wall blocks the robot)."""
        return self.trajectory is not None

    @property
    def world(self) -> World:
        """Maze and block as they are now, for ray casts of your own."""
        return self._world_at(self.pose) if self.holding else self._world

    @property
    def block(self) -> Block:
        """The block's present pose; while it is held it moves with the robot."""
        return self._gripper.block(self._world.block, self.pose)

    @property
    def holding(self) -> bool:
        """True if the gripper holds the block."""
        return self._gripper.held is not None

    @property
    def body(self) -> Footprint:
        """The body that can touch a wall: the robot's footprint, and the block while it is held."""
        return self._gripper.body

    def is_drive(self, command: Command) -> bool:
        """True if a command's code is that of an enabled drive, or of the gripper."""
        drive = self._drives.get(command.code)
        return drive is not None and drive.enabled

    def asks_for_scan(self, command: Command) -> bool:
        """True if the reply to a command is many numbers: a whole scan of a lidar, not one ray of it."""
        sensor = self._sensors.get(command.code)
        if sensor is None or command.argument is not None:
            return False
        return sensor.spec.enabled and sensor.spec.kind.is_scan

    def is_velocity(self, command: Command) -> bool:
        """True if a command sets a velocity that lasts."""
        return command.code in self.velocity_codes

    def sensor(self, code: str) -> SensorSpec:
        """The sensor with a command code. Raises UnknownSensorError."""
        return self._working(code).spec

    # -- commands ----------------------------------------------------------------------------

    def execute(self, command: Command | str) -> CommandResult:
        """Do one command from beginning to end. Simulated time jumps to the end of a movement, or advances by
        a sensor's Read Time."""
        if isinstance(command, str):
            command = parse_command(command)
        self.begin_pass((command,))
        self.wait_for_scan(command)
        result = self.begin(command)
        reading = result.reading
        takes = result.status is Status.ACCEPTED if reading is None else reading.took > 0.0
        return self.finish(result) if takes or result.waits else result

    def begin(self, command: Command | str) -> CommandResult:
        """Read a sensor, or plan a movement and start it at the present simulated time.

        A movement gives `ACCEPTED`, and `trajectory` is its plan; while one is under way another is
        refused as `BUSY`. Malformed and unknown commands give NaN, change nothing and draw no
        random number. A command that stops ends the movement and gives `STOPPED`.
        """
        if isinstance(command, str):
            command = parse_command(command)
        self.commands += 1
        before = self.pose
        # A stop comes before all checks: it must always work.
        if command.stops:
            self.stop()
            return replace(self._taken(command, before, Status.STOPPED), pose=self.pose)
        if command.problem:
            return self._refused(command, before, command.problem)
        sensor = self._sensors.get(command.code)
        if sensor is not None and sensor.spec.enabled:
            return self._begin_reading(sensor, command, before)
        drive = self._drives.get(command.code)
        if drive is None and (command.code == WAIT or command.code in self._velocities):
            return self._begin_continuous(command, before)
        if drive is None or not drive.enabled:
            return self._refused(command, before, unknown_code(command, self.spec), Status.UNKNOWN)
        value = _amount(drive, command.argument)
        if isinstance(value, str):
            return self._refused(command, before, value)
        if self.trajectory is not None:
            return self._refused(command, before, _STILL_MOVING, Status.BUSY)
        # A movement of known length ends a velocity before it begins.
        if not self._continuous.at_rest:
            self._continuous.halt(self.time)
        if isinstance(drive, GripperSpec):
            return self._taken(command, before, Status.ACCEPTED, grip=self._grip(drive, value == 1.0, before))
        self._plan(drive, value, before)
        return self._taken(command, before, Status.ACCEPTED)

    def _begin_reading(self, sensor: Sensor, command: Command, before: Pose) -> CommandResult:
        # Few robots have a lidar, and this runs for each reading.
        turning = self._turning.get(command.code) if self._turning else None
        try:
            reading = self._read(sensor, before) if turning is None else self._scanned(turning, command)
        except DeviceError as error:
            # The run continues: a program may read other sensors, or read again.
            return self._refused(command, before, str(error), Status.UNANSWERED)
        if isinstance(reading, str):
            return self._refused(command, before, reading)
        return CommandResult(
            self.commands, self.time, command, Status.READING, reading.value, before, before, "", reading
        )

    def refuse(self, command: Command) -> CommandResult:
        """The result of a command that is not examined, because too many wait: `BUSY`."""
        self.commands += 1
        return self._refused(command, self.pose, TOO_MANY_WAIT, Status.BUSY)

    def finish(self, result: CommandResult) -> CommandResult:
        """The result of a whole command, from the result of `begin`. Simulated time advances to the end of
        the movement, unless it is already over, or by the reading's duration."""
        if result.reading is not None or result.waits:
            self.advance(result.time + result.duration)
            return replace(result, time=self.time, pose=self.pose, taken=result.time)
        trajectory = self.trajectory or self._last
        assert trajectory is not None, "no movement has begun"
        if self.trajectory is not None:
            self.advance(trajectory.end_time)
        end = trajectory.end_time
        return replace(
            result,
            time=end,
            status=Status.DONE,
            pose=trajectory.pose_at(end),
            trajectory=trajectory,
            taken=trajectory.start_time,
        )

    def advance(self, time: float) -> None:
        """Set simulated time, which never goes back. A movement that ends by then is over."""
        # Clocks of callers may be slightly behind; simulated time never goes back.
        self.time = max(time, self.time)
        if self._continuous.leg is not None:
            while self._continuous.due <= self.time:
                self._continuous.step()
        trajectory = self.trajectory
        if trajectory is None or self.time < trajectory.end_time:
            return
        end = trajectory.end_time
        self._pose = trajectory.pose_at(end)
        self.distance += trajectory.travelled(end)
        self.contacts += trajectory.contact is not None
        for sensor in self._counting:
            self._counted[sensor.id] = self._count(sensor, end)
        self.trajectory, self._last = None, trajectory
        if self._looks_back:
            self._recent.add_motion(trajectory)

    def stop(self) -> bool:
        """End the motion under way now. Returns True if there was one."""
        drove = self._continuous.commanded.moves
        self._continuous.halt(self.time)
        if self.trajectory is None:
            return drove
        self.trajectory = self.trajectory.stopped(self.time)
        self.advance(self.time)
        return True

    def release(self) -> None:
        """End a velocity as a command of velocity 0 would, with its lag and its ramp."""
        self._continuous.release(self.time, self.pose)

    # -- what people may change ---------------------------------------------------------------

    def teleport(self, pose: Pose) -> None:
        """Put the robot, and the block if it holds it, somewhere, ending its movement. Raises
        PlacementError inside a wall."""
        self._check_pose(pose)
        self.stop()
        self._pose = pose
        self._recent.forget()
        for turning in self._turning.values():
            turning.forget()

    def move_block(self, x: float, y: float) -> None:
        """Put the block somewhere. A movement under way is checked again against it, without new
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
        # Drawn errors stay: moving the block must not change the errors of a run.
        if self.trajectory is not None and self.spec.block_solid:
            checker = CollisionChecker(self.footprint, self._obstacles, self.maze)
            self.trajectory = self._planner.checked_again(self.trajectory, self.time, checker)
        self._drive_on()

    def set_bias(self, bias: Mapping[DriveKind, Axes]) -> None:
        """Replace the drive bias, for some or all kinds of movement."""
        self.bias = {**self.bias, **bias}
        self._drive_on()

    # -- true values, for programs that learn or localize --------------------------------------

    def true_value(self, code: str, pose: Pose | None = None) -> float:
        """The reading of a sensor now, without random error; as if the robot were at `pose`, if that is
        given. Raises UnknownSensorError."""
        return self._observe(self._working(code), self.pose if pose is None else pose)[0]

    def plain_reading(self, code: str) -> float:
        """The reading of a sensor now without random errors, as its electronics report it. Raises
        UnknownSensorError."""
        return self._working(code).reading(self.true_value(code), None, self.time)

    def steady_seconds(self, code: str) -> float:
        """Seconds from now in which a sensor's plain reading surely stays the same, if the motion under way
        does; infinite for a robot that stands. Raises UnknownSensorError."""
        sensor, leg = self._working(code), self._continuous.leg
        if self.trajectory is not None or sensor.spec.drift:
            return 0.0
        if leg is None:
            return math.inf
        if not isinstance(sensor, ObservingSensor):
            return 0.0
        x, y = leg.arc.velocity
        away = math.sqrt(sensor.spec.x * sensor.spec.x + sensor.spec.y * sensor.spec.y)
        speed = math.sqrt(x * x + y * y) + math.radians(abs(leg.arc.rate + leg.arc.spin)) * away
        return sensor.steady_distance(self.pose) / speed if speed else math.inf

    def count_rate(self, code: str) -> float:
        """The rate at which a counting sensor counts now, in its unit a second, with its gain and drift.
        Raises UnknownSensorError."""
        sensor = self._working(code)
        leg = self._continuous.leg
        counted = 0.0 if leg is None or self.trajectory is not None else leg.counts.get(sensor.id, 0.0)
        return counted * sensor.spec.gain + sensor.spec.drift

    def rate_error(self, code: str, period: float) -> float:
        """A draw of the error of a sensor's rate that lasts for a period, seconds: that of its random walk.
        Raises UnknownSensorError."""
        sensor = self._working(code)
        if not self._noise or not sensor.random_walk:
            return 0.0
        # Over n periods the errors add up to the walk's spread, walk sqrt(n period).
        draw = self._streams[noise.fault_stream(sensor.id)].standard_normal()
        return sensor.random_walk / math.sqrt(period) * float(draw)

    def true_values(self, pose: Pose | None = None) -> dict[str, float]:
        """Readings of all enabled sensors by code, as `true_value` gives them; NaN of a device that
        failed."""
        values = {}
        for code, sensor in self._sensors.items():
            if sensor.spec.enabled:
                try:
                    values[code] = self.true_value(code, pose)
                except DeviceError:
                    values[code] = math.nan
        return values

    def look(self, code: str) -> Reading:
        """The true value as a reading with its geometry, drawing nothing. Raises
        UnknownSensorError."""
        sensor = self._working(code)
        true, view = self._observe(sensor, self.pose)
        return Reading(sensor.spec, true, true, view)

    def cast_rays(self, origins: ArrayLike, bearings: ArrayLike, z: float = math.inf) -> FloatArray:
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

    def true_ranges(self, poses: ArrayLike, codes: Iterable[str] | None = None) -> FloatArray:
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
        unknown = next((code for code in chosen if code not in self._ranging), None)
        if unknown is not None:
            raise UnknownSensorError(unknown, self._ranging, "range sensor")
        columns = [self._ranging[code].true_values(world, poses) for code in chosen]
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

    def _read(self, sensor: Sensor, pose: Pose) -> Reading:
        true, view = self._observe(sensor, pose)
        spec = sensor.spec
        if sensor.is_opaque:
            with faults_of(sensor):
                value = plain_number(self._drawn(sensor, true))
        else:
            value = self._drawn(sensor, true)
        return Reading(spec, value, true, view, spec.read_time)

    def _drawn(self, sensor: Sensor, true: float) -> float:
        """A reading of a true value, with errors drawn for it."""
        if not self._noise:
            return sensor.reading(true, None, self.time)
        faults = self._faults.get(sensor.spec.code)
        return (sensor if faults is None else faults).reading(true, self._streams[sensor.id], self.time)

    def wait_for_scan(self, command: Command) -> None:
        """Called before a command in instant motion. If it requests rays of a lidar that were already read,
        time advances until the next revolution is complete."""
        turning = self._turning.get(command.code)
        if turning is None or command.problem or not turning.lidar.spec.enabled:
            return
        ray = turning.ray(command.argument)
        if not isinstance(ray, str):
            self.advance(turning.waits_until(self.time, ray))

    def _scanned(self, turning: Turning, command: Command) -> Reading | str:
        """A reading of a lidar, or the reason why the command is refused."""
        ray = turning.ray(command.argument)
        if isinstance(ray, str):
            return ray
        now = Now(self.time, self.pose, self.trajectory or self._continuous.leg)
        return turning.reading(ray, now, self._streams[turning.lidar.id] if self._noise else None)

    def _observe(self, sensor: Sensor, pose: Pose) -> tuple[float, View | None]:
        code = sensor.spec.code
        seen = self._seen.get(code)
        if seen is not None and seen[0] is pose:
            # A robot at rest keeps its pose, and its view.
            return seen[1]
        if not isinstance(sensor, ObservingSensor):
            assert isinstance(sensor, CountingSensor), "a sensor observes or counts"
            with faults_of(sensor):
                return plain_number(self._count(sensor, self.time)), None
        if sensor.is_opaque:
            with faults_of(sensor):
                true, view = sensor.observe(self._world_at(pose), pose)
                observed = plain_number(true), plain_view(view)
        else:
            observed = sensor.observe(self._world_at(pose), pose)
        self._seen[code] = (pose, observed)
        return observed

    def _count(self, sensor: CountingSensor, time: float) -> float:
        counted = self._counted[sensor.id]
        if self.trajectory is not None:
            return counted + sensor.counted(self.trajectory, time)
        leg = self._continuous.leg
        if leg is None:
            return counted
        return counted + leg.counts[sensor.id] * (min(time, leg.end_time) - leg.start_time)

    # -- continuous motion ---------------------------------------------------------------------

    def begin_pass(self, commands: Sequence[Command]) -> None:
        """Called before commands of one moment, in instant motion. While the robot drives, a program's loop
        takes time: time advances by `loop_time` if one of the codes was already sent since it last did."""
        asked = self._asked
        if self._asked_at != self.time:
            asked.clear()
        # A program that reads a sensor twice expects that something may have changed.
        if self._continuous.leg is not None and any(command.code in asked for command in commands):
            self.advance(self.time + self.spec.loop_time)
            asked.clear()
        # A loop, not another set: nearly always it is one command, and this runs for each.
        for command in commands:
            asked.add(command.code)
        self._asked_at = self.time

    def _begin_continuous(self, command: Command, pose: Pose) -> CommandResult:
        """Begin a wait, or a velocity."""
        if command.code == WAIT:
            seconds = parse_wait(command.argument)
            if isinstance(seconds, str):
                return self._refused(command, pose, seconds)
            return self._taken(command, pose, Status.DONE, waits=seconds)
        velocity = self._velocities[command.code]
        if not velocity.enabled:
            return self._refused(command, pose, unknown_code(command, self.spec), Status.UNKNOWN)
        request = self._control.parse(velocity, command.argument, self.velocity)
        if isinstance(request, str):
            return self._refused(command, pose, request)
        if self.trajectory is not None:
            return self._refused(command, pose, _STILL_MOVING, Status.BUSY)
        return self._taken(command, pose, Status.DONE, velocity=self._take_velocity(request, pose))

    def _take_velocity(self, request: VelocityRequest, pose: Pose) -> VelocityChange:
        timeout = self.spec.velocity_timeout or math.inf
        twist = request.target.twist
        # A velocity of 0 has no end.
        expires = self.time + min(request.seconds, timeout) if twist.moves else math.inf
        changed = self._continuous.command(self.time, pose, request.target, expires, noise=self._noise)
        return VelocityChange(
            twist, expires, changed, request.slip, timeout < request.seconds, request.limited
        )

    def _drive_on(self) -> None:
        """Plan a motion under way again after a change that concerns it."""
        self._continuous.look_again(self.time, self.pose, noise=self._noise)

    # The simulator listens to its own continuous motion first.

    def leg_begun(self, leg: Leg) -> None:
        """A leg begins (see `MotionListener`)."""
        if self.listener is not None:
            self.listener.leg_begun(leg)

    def leg_ended(self, leg: Leg) -> None:
        """A leg is over."""
        self._pose = leg.last_pose
        self._recent.add_motion(leg)
        self.distance += leg.travelled(leg.end_time)
        self.contacts += leg.contact is not None
        for sensor, rate in leg.counts.items():
            self._counted[sensor] += rate * leg.duration
        if self.listener is not None:
            self.listener.leg_ended(leg)

    def velocity_expired(self, time: float) -> None:
        """A velocity has timed out."""
        if self.listener is not None:
            self.listener.velocity_expired(time)

    def _bias_in_force(self) -> Mapping[DriveKind, Axes]:
        # A method, no lambda: in a copy of the simulator it is the copy's.
        return self.bias

    def _checker(self, pose: Pose) -> CollisionChecker:
        return CollisionChecker(self.body, self._obstacles_at(pose), self.maze)

    def _plan(self, drive: DriveSpec, value: float, pose: Pose) -> None:
        bias = self.bias.get(drive.kind, Axes())
        trajectory = self._planner.plan(drive, bias, value, pose, self.time, self._noise)
        trajectory = self._planner.counted(trajectory, self._counting, self._noise)
        self.trajectory = self._planner.checked(trajectory, self._checker(pose))

    def _grip(self, spec: GripperSpec, close: bool, pose: Pose) -> Grip:
        """The jaws act at once; the robot then stands still for their duration."""
        grip = self._gripper.move(spec, close, self._world.block, pose, self.time)
        block = grip.block
        self._set_block(Block(block.x, block.y, self.spec.block_size, block.heading))
        self.trajectory = self._planner.standing(pose, self.time, 1.0 / spec.speed, self._counting)
        return grip

    def _world_at(self, pose: Pose) -> World:
        if not self.holding:
            return self._world
        return World(self.maze, self._gripper.block(self._world.block, pose), held=True)

    def _obstacles_at(self, pose: Pose) -> Obstacles:
        """Obstacles for a robot that starts at a pose. A block just released may overlap the robot, if only
        by rounding. It is no obstacle until the robot has left it."""
        solid = self.spec.gripper is not None and self._obstacles is not self.walls
        return self.walls if solid and self._obstacles.overlap(self.body, pose) else self._obstacles

    def _taken(self, command: Command, pose: Pose, status: Status, **more: Any) -> CommandResult:
        """The result of a command whose reply is infinity."""
        return CommandResult(self.commands, self.time, command, status, math.inf, pose, pose, **more)

    def _refused(
        self, command: Command, pose: Pose, reason: str, status: Status = Status.REFUSED
    ) -> CommandResult:
        return CommandResult(self.commands, self.time, command, status, math.nan, pose, pose, reason)

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
        held = self._gripper.held
        place = BlockPlace(self.time, block) if held is None else BlockPlace(self.time, held, held=True)
        self._recent.add_block_place(place)
        self._seen.clear()
        solid = self.spec.block_solid and block.size > 0.0 and not self.holding
        self._obstacles = self.walls.with_block(block) if solid else self.walls


def _amount(drive: DriveSpec | GripperSpec, argument: str | None) -> float | str:
    """The value that a command requests of a drive (times Gain) or the gripper, or as text the reason why it
    is refused."""
    value = parse_value(argument, f"{drive.code}-{1 if isinstance(drive, GripperSpec) else 3}")
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
