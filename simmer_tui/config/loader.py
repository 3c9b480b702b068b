"""Loads a configuration set with overriding options, or refuses it with every mistake listed."""

from __future__ import annotations

import math
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import Struct, field
from msgspec.structs import asdict, astuple, replace

from simmer_tui.config.device_trust import DeviceUse
from simmer_tui.config.dialects import DIALECT_FILE, TEAM
from simmer_tui.config.drive_csv import DriveRows, load_drives
from simmer_tui.config.maze_csv import FLOOR_FILE, load_maze
from simmer_tui.config.mission_toml import FILE as MISSION_FILE
from simmer_tui.config.mission_toml import MissionSpec, load_mission
from simmer_tui.config.robot_csv import load_robot
from simmer_tui.config.set_devices import DeviceStatus, set_devices
from simmer_tui.config.set_sketches import WIRING_FILE
from simmer_tui.config.sets import FILES, decoded, find_set, init_set, set_name
from simmer_tui.config.settings import NO_WHEELS, Settings, settings_from
from simmer_tui.config.settings_file import LoadedSettings, Override, load_settings
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.obstacles import placement_problems
from simmer_tui.sim.sensors import KINDS, SensorKinds
from simmer_tui.sim.specs import (
    ContactRule,
    MazeSpec,
    RobotSpec,
    SensorSpec,
    SimulationSpec,
    WheelLayout,
    WheelsSpec,
)

if TYPE_CHECKING:  # few sets have devices, or a dialect
    from simmer_tui.config.device_file import DeviceFile
    from simmer_tui.dialect.dialect_rules import DialectRules

__all__ = ["Configuration", "Override", "find_set", "init_set", "load"]

_WRITES_ONE = "simmer-tui init --dialect line DIR writes one"


class Configuration(Struct, frozen=True):
    """A valid configuration set: its folder, its display name and its contents."""

    directory: Path
    name: str
    simulation: SimulationSpec
    settings: Settings
    files: Mapping[str, str] = field(default_factory=dict)
    """The text of the set's files by name, at the time of reading; a run log contains them."""
    mission: MissionSpec | None = None
    """The contents of mission.toml, if the set has one."""
    dialect: DialectRules | None = None
    """The contents of dialect.toml, if the set has one."""
    devices: tuple[DeviceFile, ...] = ()
    """The device files of the set, at the time of reading."""
    device_statuses: tuple[DeviceStatus, ...] = ()
    """The state of each device file."""

    @property
    def texts(self) -> dict[str, str]:
        """All files of the set by their paths in it, with those of devices: enough to write the set again."""
        return {**self.files, **{device.path: device.text for device in self.devices}}

    def with_settings(self, values: Mapping[str, Any]) -> Configuration:
        """The same with other values of some settings, by dotted name."""
        return replace(self, settings=settings_from(values, self.settings))

    def __reduce__(self) -> tuple[Any, ...]:
        """The parts to pickle. Device files come first, since the rest needs their classes."""
        if not self.devices:
            return type(self), astuple(self)
        return _unpickled, (self.devices, pickle.dumps(astuple(self)))


def _unpickled(devices: tuple[DeviceFile, ...], fields: bytes) -> Configuration:
    """A configuration in another process, which runs the files that the first one trusted."""
    from simmer_tui.config.device_code import run_devices

    run_devices(devices)
    return Configuration(*pickle.loads(fields))


def load(
    directory: Path,
    overrides: Mapping[str, Override] | None = None,
    kinds: SensorKinds = KINDS,
    *,
    devices: DeviceUse = DeviceUse.RUN,
) -> Configuration:
    """Read the set in `directory`; `overrides` (by dotted name of the setting) replace values of
    settings.toml. `kinds` are the kinds that sensors.csv may name, in addition to those of the set's own
    `devices`.

    Raises ConfigurationError with every mistake in all the files and overrides.
    """
    if not directory.is_dir():
        where = str(directory)
        what = "is not a folder; simmer-tui init DIR writes a complete set to start from"
        raise ConfigurationError([Problem(where, what)])
    # All files are read even if one is wrong, so that a person sees every mistake at once.
    problems: list[Problem] = []
    # Shared by sensors and drives: a code means one thing to a program.
    codes: dict[str, str] = {}
    maze = load_maze(directory, problems)
    robot = load_robot(directory, problems)
    later: list[Problem] = []
    # Read before the sensors, whose kinds they name; their mistakes are listed after those of the CSV files.
    loaded = load_settings(directory, overrides or {}, later)
    try:
        own = set_devices(directory, loaded, kinds, devices)
    except ConfigurationError as error:
        # Without their kinds every row of theirs would seem wrong, so the sensors are not read.
        raise ConfigurationError([*problems, *later, *error.problems]) from None
    kinds = own.kinds
    longest = math.inf if maze is None else math.hypot(maze.width, maze.height)
    sensors = own.load_sensors(directory, codes, problems, longest)
    rows = load_drives(directory, codes, problems)
    problems += later
    mission, mission_file = load_mission(directory, problems)
    settings = loaded.settings
    if settings.uses_profiles:
        # Few sets need it, and it takes time.
        from simmer_tui.config.profiles import with_profiles

        given = frozenset(overrides or ())
        settings, sensors, drives = with_profiles(loaded, given, sensors, rows.drives, problems, kinds)
        rows = replace(rows, drives=drives)
    dialect, settings = _dialect(directory, loaded, settings, sensors, rows, overrides or {}, problems)
    if problems or maze is None or robot is None:
        raise ConfigurationError(problems)
    simulation = simulation_of(settings, maze, robot, sensors, rows)
    # Places are checked only in a set without other mistakes: with a wrong maze they would all be wrong.
    misplaced = [Problem(loaded.places[name], what) for name, what in placement_problems(simulation)]
    if mission is not None:
        # It imports shapely's geometry, and few sets need it.
        from simmer_tui.config.mission_plan import mission_problems

        undoable = mission_problems(mission, simulation)
        misplaced += [Problem(mission_file.place(key), what) for key, what in undoable]
    if misplaced:
        raise ConfigurationError(misplaced)
    return Configuration(
        directory,
        set_name(directory),
        simulation,
        settings,
        _texts(directory),
        mission,
        dialect,
        own.run_files,
        own.statuses,
    )


def _dialect(
    directory: Path,
    loaded: LoadedSettings,
    settings: Settings,
    sensors: tuple[SensorSpec, ...],
    rows: DriveRows,
    overrides: Mapping[str, Override],
    problems: list[Problem],
) -> tuple[DialectRules | None, Settings]:
    """The dialect of a set, if it has one, and the settings with it: programs use only this dialect, and
    motion is timed."""
    listeners = settings.server.listeners
    dialect = None
    if (directory / DIALECT_FILE).exists():
        # Few sets have one, and its reader takes time to import.
        from simmer_tui.config.dialect_reader import load_dialect
        from simmer_tui.dialect.dialect_rules import Parts

        parts = Parts(sensors, rows.drives, rows.gripper, rows.velocities)
        dialect = load_dialect(directory, parts, problems)
        if "server.listeners" not in overrides and TEAM not in listeners:
            listeners = (TEAM,)
        if TEAM in listeners:
            settings = settings_from({"server.listeners": listeners, "motion.motion": "timed"}, settings)
    elif TEAM in listeners:
        what = f"names {TEAM}, but the set has no {DIALECT_FILE}; {_WRITES_ONE}"
        problems.append(Problem(loaded.places["server.listeners"], what))
    has_line = TEAM in listeners or (directory / WIRING_FILE).exists()
    if settings.server.pty and not has_line:
        what = f"is the serial port of a set with a {DIALECT_FILE}; {_WRITES_ONE}"
        problems.append(Problem(loaded.places["server.pty"], what))
    return dialect, settings


def simulation_of(
    settings: Settings,
    maze: MazeSpec,
    robot: RobotSpec,
    sensors: tuple[SensorSpec, ...],
    rows: DriveRows,
) -> SimulationSpec:
    """The simulation that the parts of a set describe. An effect of the world on all sensors or drives is a
    change of their rows here: reports, calibration and interventions go by the rows."""
    wheels = None
    if settings.wheels.layout != NO_WHEELS:
        layout = WheelLayout(settings.wheels.layout)
        wheels = WheelsSpec(**asdict(settings.wheels) | {"layout": layout})
    # A setting of the world has the name of the field that it fills.
    values = {
        name: getattr(table, name)
        for table in (settings, settings.motion)
        for name in table.__struct_fields__
        if name in SimulationSpec.__struct_fields__
    }
    values |= {"maze": maze, "robot": robot, "sensors": sensors, "wheels": wheels}
    values |= {"drives": rows.drives, "gripper": rows.gripper, "velocities": rows.velocities}
    values |= {"block_size": settings.blocksize, "contact": ContactRule(settings.motion.contact)}
    return SimulationSpec(**values)


def _texts(directory: Path) -> dict[str, str]:
    """The files of a set, unchanged: line ends and byte-order marks stay."""
    paths = [directory / name for name in (*FILES, FLOOR_FILE, MISSION_FILE, DIALECT_FILE, WIRING_FILE)]
    return {path.name: decoded(path.name, path.read_bytes(), "utf-8") for path in paths if path.is_file()}
