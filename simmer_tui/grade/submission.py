"""Submission of a team: its files, its robot, and the check against the rules."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath

from msgspec.structs import replace

from simmer_tui.config import settings_file
from simmer_tui.config.dialects import DIALECT_FILE, TEAM
from simmer_tui.config.given_path import given_path
from simmer_tui.config.importer.files import read_path
from simmer_tui.config.importer.set_writer import write_set
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.set_devices import SETTING
from simmer_tui.config.set_sketches import WIRING_FILE
from simmer_tui.config.settings import ServerSettings, all_settings, settings_from, value_of
from simmer_tui.config.settings_file import Override, load_settings
from simmer_tui.config.toml_file import TomlFile
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.grade.board_submission import (
    submitted_boards,
    takes_boards,
    unwired_text,
    wiring_source,
)
from simmer_tui.grade.course import ROBOT_FILES, Rules, Team
from simmer_tui.grade.robot_rules import rule_problems
from simmer_tui.grade.submission_folder import has_sketches
from simmer_tui.sim.command import cut
from simmer_tui.sim.specs import RobotSpec
from simmer_tui.sim.values import CourseRule
from simmer_tui.sketch.sketch_robot import SketchSet
from simmer_tui.trials.trial import driven_by_boards

PROGRAM, OWN_SET, _SET = "program", "own-set", "set"
"""In a team's folder: its files, the robot imported from them, and the set it is graded with."""
_NAME = "the course's"
_NO_BOARDS = (
    "the course takes no boards: leave it out, and let the program drive the set's robot (boards = true in "
    "course.toml would allow it)"
)


@dataclass(frozen=True, slots=True)
class SubmissionCheck:
    """A team's configuration, or the reasons why it has none. Boards have their `sketches`, which are not
    compiled yet, and the `folder` from which their wiring names them."""

    configuration: Configuration | None
    problems: tuple[Problem, ...] = ()
    sketches: SketchSet | None = None
    folder: Path = Path()


def check_submission(team: Team, home: Path, course: Configuration, rules: Rules) -> SubmissionCheck:
    """The configuration of a team whose files are kept in `home`: the course's, with its robot."""
    files = home / PROGRAM
    try:
        own = _own_set(team, home)
        source = wiring_source(own, files, course)
        if source is not None and not takes_boards(rules, course):
            return SubmissionCheck(None, (Problem(WIRING_FILE, _NO_BOARDS),))
        if own is None:
            configuration = course
        else:
            configuration = _checked(own, _composed(home, own, course.directory, rules), course, rules)
        configuration = _without_a_name(configuration)
        if source is None:
            if not team.command and takes_boards(rules, course) and has_sketches(files):
                return SubmissionCheck(None, (Problem(WIRING_FILE, unwired_text(course)),))
            return SubmissionCheck(configuration)
        sketches = submitted_boards(source, files, configuration, course)
        configuration = replace(configuration, files={**configuration.files, WIRING_FILE: source.text})
        return SubmissionCheck(driven_by_boards(configuration), (), sketches, source.folder)
    except ConfigurationError as error:
        return SubmissionCheck(None, error.problems)


def _checked(own: Path, composed: Path, course: Configuration, rules: Rules) -> Configuration:
    """The course's configuration with a team's robot. Raises ConfigurationError if that breaks a rule."""
    problems: list[Problem] = []
    has_settings = (own / settings_file.FILE).is_file()
    mine = load_settings(own, {}, problems).settings if has_settings else course.settings
    if mine.sensors.devices:
        names = ", ".join(mine.sensors.devices)
        what = f"{names}: a grading runs no devices of a team's own; take them and their rows out"
        raise ConfigurationError([Problem(f"{settings_file.FILE}:{SETTING}", what)])
    found = load(composed, _wheels(own) if rules.wheels and has_settings and not problems else {})
    problems = [*rule_problems(rules, course, found), *problems]
    if problems:
        raise ConfigurationError(problems)
    own_names = [item.name for item in all_settings() if item.course is CourseRule.FREE]
    if found.dialect is not None and TEAM not in mine.server.listeners:
        own_names.remove("server.listeners")  # as of any set with a dialect
    settings = settings_from({name: value_of(mine, name) for name in own_names}, found.settings)
    return replace(found, settings=settings)


def _wheels(own: Path) -> dict[str, Override]:
    """The settings of a team's own [wheels], as far as its file has them."""
    given = TomlFile.read(own / settings_file.FILE, []).table("wheels")
    return {f"wheels.{key}": Override(settings_file.FILE, value) for key, value in given.items()}


def _without_a_name(configuration: Configuration) -> Configuration:
    """The configuration without names of a team or a folder for logs and pages; its ports are for the program
    alone."""
    server = replace(configuration.settings.server, host=ServerSettings().host, any_user=True, token="")
    settings = replace(configuration.settings, server=server)
    return replace(configuration, name=_NAME, settings=settings)


def _own_set(team: Team, home: Path) -> Path | None:
    """A folder with the team's robot, or None. Raises ConfigurationError."""
    if not team.config:
        return None
    given = given_path(team.config, home / PROGRAM)
    if ".." in PureWindowsPath(team.config).parts or not given.resolve().is_relative_to(
        (home / PROGRAM).resolve()
    ):
        raise ConfigurationError([Problem("config", "must lie in the team's folder")])
    if not given.exists():
        raise ConfigurationError([Problem("config", f'there is no "{cut(team.config)}"')])
    if given.is_dir() and any((given / name).is_file() for name in (*ROBOT_FILES, DIALECT_FILE, WIRING_FILE)):
        return given
    goal = home / OWN_SET
    if goal.exists():
        shutil.rmtree(goal)
    write_set(read_path(given), goal)
    return goal


def _composed(home: Path, own: Path, course: Path, rules: Rules) -> Path:
    """The course's set with the team's robot and, if the course accepts it, its dialect. Raises
    ConfigurationError."""
    has_dialect = (own / DIALECT_FILE).is_file()
    if has_dialect and not rules.dialects:
        what = (
            "the course takes no team's own language: let the program speak one of the course's protocols "
            "(dialects = true in course.toml would allow it)"
        )
        raise ConfigurationError([Problem(DIALECT_FILE, what)])
    goal = home / _SET
    if goal.exists():
        shutil.rmtree(goal)
    goal.mkdir(parents=True)
    for path in course.iterdir():
        if path.is_file() and path.suffix in (".csv", ".toml"):
            shutil.copyfile(path, goal / path.name)
    for name in (*ROBOT_FILES, *([DIALECT_FILE] if has_dialect else [])):
        if (own / name).is_file():
            shutil.copyfile(own / name, goal / name)
    return goal


def reference(course: Configuration, rules: Rules) -> Configuration:
    """The configuration that missions are drawn for: with the largest robot allowed, so that wherever it
    fits, all robots do."""
    if rules.size is None:
        return course
    robot = RobotSpec.circle(rules.size)
    return replace(course, simulation=replace(course.simulation, robot=robot))
