"""A course to be graded: a teams.toml, or a folder with one folder a team."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from simmer_tui.config import drive_csv, robot_csv, sensors_csv
from simmer_tui.config.given_path import given_path
from simmer_tui.config.leftovers import has_environment_name, is_leftover, is_leftover_folder
from simmer_tui.config.set_sketches import WIRING_FILE
from simmer_tui.config.sets import MISSION_SET, find_set
from simmer_tui.config.toml_file import TomlFile
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.grade.archives import is_archive
from simmer_tui.grade.limits import LIMITS, Limits
from simmer_tui.grade.submission_folder import has_program, has_sketches
from simmer_tui.program.shell_syntax import shell_command, shell_syntax
from simmer_tui.sim.rules import FlagRule, IntegerRule, NamesRule, NumberRule, Rule, TextRule
from simmer_tui.sim.values import Value
from simmer_tui.trials.sequential import CAP_RULE, MARGIN, RATE_RULE, REQUIRED_RATE, RISK

COURSE_FILE, TEAM_FILE = "course.toml", "team.toml"
PLAN_FILE, TEAMS_FOLDER = "grade.json", "teams"
"""The file and the folder by which a grading is recognized."""
ROBOT_FILES = (robot_csv.FILE, sensors_csv.FILE, drive_csv.FILE)
"""The files of a set that are the team's; the rest is the course's."""
USUAL_CONFIGS = ("config", "config.py", "Main.m")
"""Names of a team's robot, one of which is taken if the team names none."""
_LARGEST_TEAM_FILE = 65536
"""Largest team.toml, bytes: it is an untrusted file of two lines."""
# Judged: a name is a cell of a table; a path and a mistake with its advice need more room to be understood.
_SHORT, LONG = 60, 300
"""Characters shown of the name of a team, and of a path or a mistake."""
_UNPACK = "unpack each into a folder with its name, such as: unzip ada.zip -d ada"
_WORD = re.compile(r"[^a-z0-9]+")


@dataclass(frozen=True, slots=True)
class Rules:
    """The rules for a team's robot. Its errors are always at least those of the course's set.

    `sensors` is the most sensors enabled, `size` the diameter, inches, of a circle around the robot's centre
    in which it must fit. `cells` are the columns of a file that may differ from the course's (of robot.csv,
    the rows); in other files all may. None means no rule.
    """

    sensors: int | None = None
    size: float | None = None
    cells: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    dialects: bool = False
    """True if a team's dialect.toml is accepted."""
    wheels: bool = False
    """True if a team's [wheels] are accepted, which must be no faster than the course's."""
    boards: bool | None = None
    """True if a team's wiring.toml and sketches are accepted; None: if the course's set has a wiring.toml."""


@dataclass(frozen=True, slots=True)
class Team:
    """A team's submission: `config` is its robot set, config.py or Main.m, by path in its folder, empty for
    none. `given` has the course's own values for command and config, `problems` are the mistakes in the
    team's own file. Before its files are copied, it has only the course's values."""

    name: str
    folder: Path
    command: str
    config: str = ""
    given: Mapping[str, str] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()

    @property
    def slug(self) -> str:
        """The name for files: no two teams have the same."""
        word = _WORD.sub("-", self.name.lower()).strip("-")[:40]
        digest = hashlib.sha256(self.name.encode(errors="surrogatepass")).hexdigest()[:6]
        return word if word and word == self.name else f"{word or 'team'}-{digest}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """The requirements of a course, and its teams. `KEYS` has the defaults of what its file may say."""

    name: str
    directory: Path
    """The configuration set: maze, mission, settings, and the robot of teams that have none."""
    command: str
    """Default command of the teams."""
    require: float
    margin: float
    risk: float
    cap: int | None
    limits: Limits = field(default_factory=Limits)
    rules: Rules = field(default_factory=Rules)
    read_only: tuple[str, ...] = ()
    """More folders of this machine that programs may read."""
    image: str = ""
    """Image of the container, for docker and podman."""
    clock: str = ""
    """Clock of the runs in place of the set's."""
    teams: tuple[Team, ...] = ()
    team_folders: tuple[Path, ...] = ()
    """In these, each folder is a team's."""


class CommandRule(TextRule, frozen=True):
    """A program's command, which no shell reads."""

    def check(self, value: object) -> str:
        """The command. Raises ValueError if it is not allowed."""
        command = super().check(value)
        if found := shell_syntax(command):
            typed = json.dumps(shell_command(command), ensure_ascii=False)
            raise ValueError(f"has {found}, but no shell is used: write command = {typed}")
        return command


def _key(name: str, rule: Rule[Any], meaning: str, default: object = None) -> Value:
    return Value(rule, meaning, name=name, default=default)


_RISK = NumberRule(0, 0.5, low_open=True, high_open=True)
_NAME = _key("name", TextRule(), "name; by default that of the folder")
_COMMAND = _key("command", CommandRule(), "its command, in place of the course's")
_CONFIG = _key("config", TextRule(), "the team's robot: a set, a config.py or a Main.m, by path")
KEYS: dict[str, tuple[Value, ...]] = {
    "": (
        _NAME,
        _key("set", TextRule(), "the configuration set: a path, or the name of a bundled one", MISSION_SET),
        _key("command", CommandRule(), "command of teams that name no other", "python main.py"),
        _key("teams", TextRule(), "a folder with one folder a team"),
        _key("image", TextRule(), "the container's image, for docker and podman"),
        _key("read_only", NamesRule(), "more folders that programs may read"),
        _key("dialects", FlagRule(), "a team may have a dialect.toml", False),
        _key("wheels", FlagRule(), "a team may have [wheels] in its settings.toml", False),
        _key("boards", FlagRule(), "a team may have a wiring.toml and sketches; by default if the set has"),
    ),
    "decide": (
        _key("require", RATE_RULE, "the success rate that passes", REQUIRED_RATE),
        _key("margin", RATE_RULE, "a success rate this much lower fails", MARGIN),
        _key("risk", _RISK, "error rate of the decision", RISK),
        _key("cap", CAP_RULE, "most runs of a team"),
    ),
    "limits": LIMITS,
    "rules": (
        _key("sensors", IntegerRule(0, 1000), "sensors enabled at most"),
        _key("size", NumberRule(0, low_open=True), "diameter of a circle around the robot, inches"),
    ),
    "rules.cells": tuple(
        _key(file, NamesRule(), "columns that may differ from the course's; of robot.csv, rows")
        for file in ROBOT_FILES
    ),
    "team": (_NAME, _key("folder", TextRule(), "its folder, by path"), _COMMAND, _CONFIG),
}
"""The keys of course.toml by their tables; those outside of tables first."""


def read_course(
    target: Path, course_file: Path | None = None, *, alone: bool = False, is_here: bool = True
) -> Course:
    """The course in a TOML file, or of the folders in a folder, which may contain a course.toml;
    `course_file` replaces it. With `alone` the folder is one team's. `is_here` is False if the programs run
    on other machines.

    Raises ConfigurationError with every mistake.
    """
    problems: list[Problem] = []
    shown = str(target)
    for each in (target, *((course_file,) if course_file else ())):
        if not each.exists():
            raise ConfigurationError([Problem(str(each), "there is no such file or folder")])
        if is_archive(each.name) and each.is_file():
            raise ConfigurationError([Problem(str(each), f"is an archive; {_UNPACK}")])
    if target.is_file() and target.suffix.lower() != ".toml":
        line = 'simmer-tui trials --run "CMD ..." runs one program many times'
        raise ConfigurationError([Problem(shown, f"is no TOML file of a course; {line}")])
    course_file = course_file or _usual_file(target)
    file = TomlFile.read(course_file, problems) if course_file else TomlFile("", "", problems)
    home = Path() if course_file is None else course_file.parent
    top = _defaults("") | file.values(KEYS[""], others=("decide", "limits", "rules", "team"))
    command, directory = top["command"], _set_of(home, top["set"])
    team_folders = () if alone else (target,) if target.is_dir() else _folders_named(home, top)
    teams = [Team(target.resolve().name, target, command)] if alone else []
    teams += _listed(file, home, command) if target.is_file() else []
    for folder in team_folders:
        teams += _below(folder, directory, command, problems)
    course = Course(
        name=top["name"] or target.resolve().stem,
        directory=directory,
        command=command,
        limits=Limits(**file.values(LIMITS, file.table("limits"), "limits.")),
        rules=_rules(file, top),
        # A team that tries its program need not have the course's tools.
        read_only=_read_only(file, home, top, must_exist=is_here and not alone),
        image=top["image"] or "",
        teams=tuple(teams),
        team_folders=team_folders,
        **_defaults("decide") | file.values(KEYS["decide"], file.table("decide"), "decide."),
    )
    where = file.file or shown
    if not teams and not problems:
        has_archives = any(is_archive(path.name) for folder in team_folders for path in folder.iterdir())
        what = "names no team: a folder for each, or [[team]] with name and folder"
        if has_archives:
            what = f"the teams are in archives; {_UNPACK}"
        elif (name := _windows_path(team_folders)) is not None:
            what = f"the name {shown_name(name)} is a path of Windows; unpack the archive again, with unzip"
        problems.append(Problem(where, what))
    problems += _doubled(teams, where)
    if problems:
        raise ConfigurationError(problems)
    return course


def _windows_path(folders: Iterable[Path]) -> str | None:
    """The first name with a backslash: a file of an archive of Windows, unpacked by a program that takes it
    for a name."""
    if os.sep == "\\":
        return None
    return min((path.name for each in folders for path in each.iterdir() if "\\" in path.name), default=None)


def _defaults(table: str) -> dict[str, Any]:
    """The default of each key of a table."""
    return {key.name: key.default for key in KEYS[table]}


def _doubled(teams: Iterable[Team], where: str) -> Iterator[Problem]:
    """The problems with names that two teams have."""
    for name, count in sorted(Counter(team.name for team in teams).items()):
        if count > 1:
            yield Problem(where, f'two teams have the name "{shown_name(name)}"')


def _usual_file(target: Path) -> Path | None:
    """The file itself, or the course.toml of a folder if it has one."""
    usual = target if target.is_file() else target / COURSE_FILE
    return usual if usual.is_file() else None


def _set_of(home: Path, name: str) -> Path:
    """The course's set: a folder beside course.toml, or as everywhere else."""
    folder = given_path(name, home)
    return folder if folder.is_dir() else find_set(name)


def _folders_named(home: Path, top: Mapping[str, Any]) -> tuple[Path, ...]:
    return (given_path(top["teams"], home),) if top["teams"] else ()


def _read_only(file: TomlFile, home: Path, top: Mapping[str, Any], *, must_exist: bool) -> tuple[str, ...]:
    """More folders that programs may read, by absolute path: a sandbox shows them at the same place."""
    paths = [str(given_path(each, home).absolute()) for each in top["read_only"] or ()]
    for each in absent(paths) if must_exist else ():
        file.add_problem("read_only", f'"{shown_name(each, LONG)}" does not exist')
    return tuple(paths)


def absent(paths: Iterable[str]) -> list[str]:
    """Those of some paths that do not exist on this machine."""
    return [each for each in paths if not Path(each).exists()]


def _rules(file: TomlFile, top: Mapping[str, Any]) -> Rules:
    rules = file.values(KEYS["rules"], file.table("rules"), "rules.", others=("cells",))
    return Rules(
        **rules,
        cells=file.values(KEYS["rules.cells"], file.table("rules.cells"), "rules.cells."),
        dialects=top["dialects"],
        wheels=top["wheels"],
        boards=top["boards"],
    )


def _below(folder: Path, directory: Path, command: str, problems: list[Problem]) -> list[Team]:
    """The teams with a folder each in a folder: all folders but leftovers, the course's
    own set and gradings."""
    if not folder.is_dir():
        problems.append(Problem(shown_name(str(folder), LONG), "is not a folder"))
        return []
    paths = sorted(path for path in folder.iterdir() if path.is_dir() and not path.is_symlink())
    paths = [path for path in paths if not _is_no_team(path.name)]
    others = (directory.resolve(), *(path for path in paths if _is_grading(path)))
    return [
        Team(path.name, path, command)
        for path in paths
        if not path.name.startswith(".") and path.resolve() not in others and path not in others
    ]


def _is_no_team(name: str) -> bool:
    """True for the name of a folder beside those of teams, left by a system, a packer or a tool. A team's own
    folder may be an environment as well, if it was made there."""
    return is_leftover_folder(name) or has_environment_name(name)


def not_teams(course: Course) -> list[str]:
    """Names of links to folders and of archives among the folders of teams: each may be a submission."""
    return [
        path.name
        for folder in course.team_folders
        for path in sorted(folder.iterdir())
        if not is_leftover(path.name) and (path.is_symlink() if path.is_dir() else is_archive(path.name))
    ]


def _is_grading(path: Path) -> bool:
    return (path / PLAN_FILE).is_file() and (path / TEAMS_FOLDER).is_dir()


def submitted_team(team: Team, files: Path, command: str) -> Team:
    """A team by the copy of its `files`. The course's values for it (`given`) take precedence over its
    team.toml, and that over the course's `command`. Mistakes in team.toml are the team's own.

    The command is empty for a team with sketches and no program: no command of its own, and nothing that the
    course's command names.
    """
    own, problems = dict[str, str](), list[Problem]()
    path = files / TEAM_FILE
    if path.is_file():
        if path.stat().st_size > _LARGEST_TEAM_FILE:
            problems.append(Problem(TEAM_FILE, f"is larger than {_LARGEST_TEAM_FILE} bytes"))
        else:
            own = TomlFile.read(path, problems).values((_COMMAND, _CONFIG))
    said = {"command": command, "config": _usual_config(files), **own, **team.given}
    if has_sketches(files) and _COMMAND.name not in {**own, **team.given} and not has_program(files, command):
        said["command"] = ""
    return replace(team, command=said["command"], config=said["config"], problems=tuple(problems))


def _usual_config(folder: Path) -> str:
    """The usual place of a team's robot set; empty if it has none. Without one the folder is the set if it
    has a wiring.toml, as for --sketch."""
    usual = "." if (folder / WIRING_FILE).is_file() else ""
    return next((name for name in USUAL_CONFIGS if (folder / name).exists()), usual)


def _listed(file: TomlFile, home: Path, command: str) -> list[Team]:
    """The teams that the course names one by one."""
    teams = []
    for index, table in enumerate(file.tables("team"), 1):
        said = file.values(KEYS["team"], table, f"team {index}.")
        if "folder" not in said:
            file.add_problem("team", f"team {index} has no folder")
            continue
        folder = given_path(said["folder"], home)
        if not folder.is_dir():
            file.add_problem("team", f'"{shown_name(said["folder"], LONG)}" is not a folder')
        given = {each.name: said[each.name] for each in (_COMMAND, _CONFIG) if each.name in said}
        name, config = said.get("name", folder.name), said.get("config", "")
        teams.append(Team(name, folder, said.get("command", command), config, given))
    return teams


def shown_name(name: str, limit: int = _SHORT) -> str:
    """A name as people read it, in any script; nothing in it controls a terminal. Of a path or a mistake
    more is shown: `LONG`."""
    shown = name
    return shown if len(shown) <= limit else f"{shown[: limit - 3]}..."
