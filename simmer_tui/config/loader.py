"""Loads a configuration set with overriding options, or refuses it with every mistake listed."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from msgspec import Struct, field

from simmer_tui.config.drive_csv import load_drives
from simmer_tui.config.maze_csv import FLOOR_FILE, load_maze
from simmer_tui.config.mission_toml import FILE as MISSION_FILE
from simmer_tui.config.mission_toml import MissionSpec, load_mission
from simmer_tui.config.robot_csv import load_robot
from simmer_tui.config.sensors_csv import load_sensors
from simmer_tui.config.sets import FILES, find_set, init_set, set_name
from simmer_tui.config.settings import Settings
from simmer_tui.config.settings_file import Override, load_settings
from simmer_tui.config.toml_file import TomlFile
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.command import escape
from simmer_tui.sim.obstacles import placement_problems
from simmer_tui.sim.sensors import KINDS, SensorKinds
from simmer_tui.sim.specs import (
    ContactRule,
    DriveSpec,
    GripperSpec,
    MazeSpec,
    RobotSpec,
    SensorSpec,
    SimulationSpec,
)

__all__ = ["Configuration", "Override", "find_set", "init_set", "load"]


class Configuration(Struct, frozen=True):
    """A valid configuration set: its folder, its display name and its contents."""

    directory: Path
    name: str
    simulation: SimulationSpec
    settings: Settings
    files: Mapping[str, str] = field(default_factory=dict)
    """The text of the set's files by name, as they were when it was read; a run log keeps them."""
    mission: MissionSpec | None = None
    """The contents of mission.toml, if the set has one."""


def load(
    directory: Path, overrides: Mapping[str, Override] | None = None, kinds: SensorKinds = KINDS
) -> Configuration:
    """Read the set in `directory`, `overrides` (by dotted name of the setting) over settings.toml.
    `kinds` are the sensors that sensors.csv may name.

    Raises ConfigurationError with every mistake in all the files and overrides.
    """
    if not directory.is_dir():
        where = escape(str(directory), 200)
        what = "is not a folder; simmer-tui init DIR writes a complete set to start from"
        raise ConfigurationError([Problem(where, what)])
    # All files are read whatever is wrong with one, so that a person sees every mistake at once.
    problems: list[Problem] = []
    # Shared by sensors and drives: a code means one thing to a program.
    codes: dict[str, str] = {}
    maze = load_maze(directory, problems)
    robot = load_robot(directory, problems)
    sensors = load_sensors(directory, codes, problems, kinds)
    drives, gripper = load_drives(directory, codes, problems)
    loaded = load_settings(directory, overrides or {}, problems)
    mission, mission_file = load_mission(directory, problems)
    settings = loaded.settings
    if settings.realistic or settings.sensor_profile or settings.drive_profile or settings.link_profile:
        # Few sets need it, and it takes time.
        from simmer_tui.config.profiles import with_profiles

        given = frozenset(overrides or ())
        settings, sensors, drives = with_profiles(loaded, given, sensors, drives, problems, kinds)
    if problems or maze is None or robot is None:
        raise ConfigurationError(problems)
    simulation = _simulation(settings, maze, robot, sensors, drives, gripper)
    # Places are looked at only in a set that is right otherwise: a wrong maze would make them all wrong.
    misplaced = [Problem(loaded.places[name], what) for name, what in placement_problems(simulation)]
    if mission is not None:
        misplaced += _undoable(mission, mission_file, simulation)
    if misplaced:
        raise ConfigurationError(misplaced)
    return Configuration(directory, set_name(directory), simulation, settings, _texts(directory), mission)


def _undoable(mission: MissionSpec, file: TomlFile, simulation: SimulationSpec) -> Iterator[Problem]:
    """The reasons why a mission cannot be drawn or done."""
    # It imports shapely's geometry, and few sets need it.
    from simmer_tui.config.mission_plan import mission_problems

    for key, what in mission_problems(mission, simulation):
        yield Problem(file.place(key) if key else MISSION_FILE, what)


def _simulation(
    settings: Settings,
    maze: MazeSpec,
    robot: RobotSpec,
    sensors: tuple[SensorSpec, ...],
    drives: tuple[DriveSpec, ...],
    gripper: GripperSpec | None,
) -> SimulationSpec:
    return SimulationSpec(
        maze=maze,
        robot=robot,
        sensors=sensors,
        drives=drives,
        bot_center=settings.bot_center,
        bot_rot=settings.bot_rot,
        block_center=settings.block_center,
        block_size=settings.blocksize,
        block_solid=settings.motion.block_solid,
        num_segments=settings.num_segments,
        strength=settings.strength,
        randbias=settings.randbias,
        gripper=gripper,
        contact=ContactRule(settings.motion.contact),
        clearance=settings.motion.clearance,
    )


def _texts(directory: Path) -> dict[str, str]:
    """The files of a set that has been read, to the letter: line ends and byte-order marks stay."""
    paths = [directory / name for name in (*FILES, FLOOR_FILE, MISSION_FILE)]
    return {path.name: path.read_bytes().decode() for path in paths if path.is_file()}
