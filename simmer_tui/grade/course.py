"""A course to be graded: a teams.toml, or a folder with one folder a team."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from simmer_tui.config.csv_table import read_text
from simmer_tui.config.sets import MISSION_SET, find_set
from simmer_tui.config.toml_text import key_lines, parse_toml, place_of
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.grade.limits import Limits
from simmer_tui.sim.command import escape, printable
from simmer_tui.sim.rules import IntegerRule, NumberRule, Rule, TextRule, did_you_mean
from simmer_tui.trials.sequential import LARGEST_CAP, MARGIN, RISK

COURSE_FILE, TEAM_FILE = "course.toml", "team.toml"
PLAN_FILE, TEAMS_FOLDER = "grade.json", "teams"
"""What a folder with a grading has in it."""
DEFAULT_COMMAND = "python main.py"
_LARGEST_TEAM_FILE = 65536
_WORD = re.compile(r"[^a-z0-9]+")


@dataclass(frozen=True, slots=True)
class Rules:
    """What a team's robot may be. Whatever it has, its errors are at least those of the course's set.

    `sensors` is how many may be enabled, `size` the diameter, inches, of a circle around the robot's
    centre that it must fit in, `cells` the columns of a file that may differ from the course's (of
    robot.csv, the rows); all of a file that is not named may. None stands for no rule.
    """

    sensors: int | None = None
    size: float | None = None
    cells: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Team:
    """A team as it has handed in: `config` is its robot set, config.py or Main.m, by path in its folder,
    empty for none. `given` is what the course itself says of both, `problems` is what is wrong with the
    team's own file."""

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
    """All that is asked of the teams, and the teams."""

    name: str
    directory: Path
    """The configuration set: maze, mission, settings, and the robot of teams that have none."""
    command: str = DEFAULT_COMMAND
    """Of teams of which nothing else is said."""
    require: float = 0.9
    margin: float = MARGIN
    risk: float = RISK
    cap: int | None = None
    limits: Limits = field(default_factory=Limits)
    rules: Rules = field(default_factory=Rules)
    read_only: tuple[str, ...] = ()
    """More folders of this machine that programs may read."""
    image: str = ""
    """The container's, for docker and podman."""
    teams: tuple[Team, ...] = ()
    team_folders: tuple[Path, ...] = ()
    """In these, each folder is a team's."""


_TOP: dict[str, Rule[Any]] = {
    "name": TextRule(),
    "set": TextRule(),
    "command": TextRule(),
    "teams": TextRule(),
    "image": TextRule(),
}
_DECIDE: dict[str, Rule[Any]] = {
    "require": NumberRule(0, 1, low_open=True),
    "margin": NumberRule(0, 1, low_open=True),
    "risk": NumberRule(0, 0.5, low_open=True, high_open=True),
    "cap": IntegerRule(1, LARGEST_CAP),
}
_RULES: dict[str, Rule[Any]] = {"sensors": IntegerRule(0, 1000), "size": NumberRule(0, low_open=True)}
_OF_A_TEAM: dict[str, Rule[Any]] = {"command": TextRule(), "config": TextRule()}
_LISTED: dict[str, Rule[Any]] = {"name": TextRule(), "folder": TextRule(), **_OF_A_TEAM}
_LIMITS: dict[str, Rule[Any]] = {
    each.name: IntegerRule(1, 10_000) if each.name == "processes" else NumberRule(0, 1e6, low_open=True)
    for each in fields(Limits)
}


def read_course(target: Path, course_file: Path | None = None, *, alone: bool = False) -> Course:
    """The course in a TOML file, or of the folders in a folder, which may hold a course.toml; an own
    `course_file` says what is asked of them. With `alone` the folder is one team's.

    Raises ConfigurationError with every mistake.
    """
    problems: list[Problem] = []
    shown = escape(str(target), 200)
    if target.is_file():
        course_file = course_file or target
    elif not target.is_dir():
        raise ConfigurationError([Problem(shown, "there is no such file or folder")])
    elif course_file is None and (target / COURSE_FILE).is_file():
        course_file = target / COURSE_FILE
    reader = _Reader(course_file, problems)
    home = Path() if course_file is None else course_file.parent
    top = reader.values("", _TOP, ("decide", "limits", "rules", "team", "read_only"))
    command = top.get("command", DEFAULT_COMMAND)
    directory = home / top["set"] if "set" in top and (home / top["set"]).is_dir() else None
    directory = directory or find_set(top.get("set", MISSION_SET))
    team_folders = () if alone else (target,) if target.is_dir() else _named(home, top)
    teams = [submitted_team(target.resolve().name, target, command)] if alone else []
    if target.is_file():
        teams += _listed(reader, home, command)
    for folder in team_folders:
        teams += _below(folder, directory, command, problems)
    limits, decide = reader.values("limits", _LIMITS), reader.values("decide", _DECIDE)
    rules = reader.values("rules", _RULES, ("cells",))
    course = Course(
        name=top.get("name", target.resolve().stem),
        directory=directory,
        command=command,
        limits=Limits(**limits),
        rules=Rules(**rules, cells=reader.lists("rules.cells")),
        read_only=reader.words("read_only"),
        image=top.get("image", ""),
        teams=tuple(teams),
        team_folders=team_folders,
        **decide,
    )
    where = reader.file or shown
    if not teams and not problems:
        problems.append(Problem(where, "names no team: a folder for each, or [[team]] with name and folder"))
    names = [team.name for team in teams]
    twice = sorted({name for name in names if names.count(name) > 1})
    problems += [Problem(where, f'two teams have the name "{shown_name(name)}"') for name in twice]
    if problems:
        raise ConfigurationError(problems)
    return course


def _named(home: Path, top: Mapping[str, Any]) -> tuple[Path, ...]:
    return (home / top["teams"],) if "teams" in top else ()


def _below(folder: Path, directory: Path, command: str, problems: list[Problem]) -> list[Team]:
    """The teams with a folder each in a folder: all that is not the course's own set, nor a grading."""
    if not folder.is_dir():
        problems.append(Problem(shown_name(str(folder), 200), "is not a folder"))
        return []
    paths = sorted(path for path in folder.iterdir() if path.is_dir() and not path.is_symlink())
    others = (directory.resolve(), *(path for path in paths if _is_grading(path)))
    return [
        submitted_team(path.name, path, command)
        for path in paths
        if not path.name.startswith(".") and path.resolve() not in others and path not in others
    ]


def _is_grading(path: Path) -> bool:
    return (path / PLAN_FILE).is_file() and (path / TEAMS_FOLDER).is_dir()


def submitted_team(name: str, folder: Path, command: str, given: Mapping[str, str] | None = None) -> Team:
    """A team by its folder as it is now. What the course says (`given`) goes first, then the folder's
    team.toml, then the course's `command`. Mistakes in team.toml are the team's own."""
    given, own, problems = given or {}, {}, list[Problem]()
    path = folder / TEAM_FILE
    if path.is_file() and not path.is_symlink():
        if path.stat().st_size > _LARGEST_TEAM_FILE:
            problems.append(Problem(TEAM_FILE, f"is larger than {_LARGEST_TEAM_FILE} bytes"))
        else:
            own = _Reader(path, problems).values("", _OF_A_TEAM)
    said = {"command": command, "config": _usual_config(folder), **own, **given}
    return Team(name, folder, said["command"], said["config"], given, tuple(problems))


def _usual_config(folder: Path) -> str:
    """Where a team's robot set usually is; empty if it has none."""
    return next((name for name in ("config", "config.py", "Main.m") if (folder / name).exists()), "")


def _listed(reader: _Reader, home: Path, command: str) -> list[Team]:
    teams = []
    for index, table in enumerate(reader.tables("team"), 1):
        said = reader.checked(table, f"team {index}.", _LISTED)
        if "folder" not in said:
            reader.complain("team", f"team {index} has no folder")
            continue
        folder = home / said["folder"]
        if not folder.is_dir():
            reader.complain("team", f'"{shown_name(said["folder"], 100)}" is not a folder')
        given = {name: said[name] for name in _OF_A_TEAM if name in said}
        teams.append(submitted_team(said.get("name", folder.name), folder, command, given))
    return teams


def shown_name(name: str, limit: int = 60) -> str:
    """A name as people read it, in whatever script; nothing in it steers a terminal."""
    shown = printable(name)
    return shown if len(shown) <= limit else f"{shown[: limit - 3]}..."


class _Reader:
    """A TOML file taken apart, every mistake told with its line."""

    def __init__(self, path: Path | None, problems: list[Problem]) -> None:
        self.file = "" if path is None else escape(path.name, 60)
        self._problems = problems
        text = "" if path is None else read_text(path, problems) or ""
        self._lines = key_lines(text)
        self._tree = parse_toml(text, self.file, problems)

    def complain(self, name: str, what: str) -> None:
        self._problems.append(Problem(place_of(name, self.file, self._lines), what))

    def values(
        self, table: str, rules: Mapping[str, Rule[Any]], others: tuple[str, ...] = ()
    ) -> dict[str, Any]:
        """The values of a table (empty: the top); `others` may be there as well."""
        tree = self._tree.get(table, {}) if table else self._tree
        if not isinstance(tree, dict):
            self.complain(table, f"must be a table: [{table}]")
            return {}
        return self.checked(tree, f"{table}." if table else "", rules, others)

    def checked(
        self,
        tree: Mapping[str, Any],
        prefix: str,
        rules: Mapping[str, Rule[Any]],
        others: tuple[str, ...] = (),
    ) -> dict[str, Any]:
        values, known = {}, (*rules, *others)
        for name, value in tree.items():
            if name in others:
                continue
            if name not in rules:
                self.complain(
                    prefix + name, f"is not known here{did_you_mean(name, known)} (known: {', '.join(known)})"
                )
                continue
            try:
                values[name] = rules[name].check(value)
            except ValueError as error:
                self.complain(prefix + name, str(error))
        return values

    def tables(self, name: str) -> list[dict[str, Any]]:
        found = self._tree.get(name, [])
        if isinstance(found, list) and all(isinstance(each, dict) for each in found):
            return found
        self.complain(name, f"must be tables: [[{name}]]")
        return []

    def words(self, name: str) -> tuple[str, ...]:
        return self._words(name, self._tree.get(name, []))

    def lists(self, name: str) -> dict[str, tuple[str, ...]]:
        """Lists of words by name, in a table of a table."""
        table, _, last = name.partition(".")
        tree = self._tree.get(table, {})
        found = tree.get(last, {}) if isinstance(tree, dict) else {}
        if not isinstance(found, dict):
            self.complain(name, f"must be a table: [{name}]")
            return {}
        return {each: self._words(f"{name}.{each}", value) for each, value in found.items()}

    def _words(self, name: str, found: Any) -> tuple[str, ...]:
        if isinstance(found, list) and all(isinstance(each, str) for each in found):
            return tuple(found)
        self.complain(name, 'must be a list of words, such as ["one", "two"]')
        return ()
