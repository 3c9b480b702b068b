"""A team's boards: the wiring.toml that counts, and the sketches that it names in the team's files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from simmer_tui.config.loader import Configuration
from simmer_tui.config.set_sketches import WIRING_FILE
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.grade.board_build import BoardSketch
from simmer_tui.grade.course import Rules
from simmer_tui.grade.wiring_rules import parts_of, wiring_problems
from simmer_tui.sim.command import cut
from simmer_tui.sketch.build import fastest_baud
from simmer_tui.sketch.sketch_check import facts_of
from simmer_tui.sketch.sketch_robot import SketchSet
from simmer_tui.sketch.wiring import Wiring, missing_sketches, read_wiring

_LARGEST_WIRING = 65536
"""Largest wiring.toml, bytes; a robot of four boards has 4 kB."""


@dataclass(frozen=True, slots=True)
class WiringSource:
    """The text of a wiring, and the folder from which it names its sketches."""

    text: str
    folder: Path


def takes_boards(rules: Rules, course: Configuration) -> bool:
    """True if teams may hand in boards: by default if the course's robot has them."""
    return WIRING_FILE in course.files if rules.boards is None else rules.boards


def wiring_source(own: Path | None, files: Path, course: Configuration) -> WiringSource | None:
    """The wiring of a team whose robot is the set `own`: that of its set, or of its folder, or the course's
    if the sketches which that names are there. None without boards. Raises ConfigurationError."""
    places = [each for each in dict.fromkeys((own, files)) if each is not None]
    for folder in places:
        path = folder / WIRING_FILE
        if path.is_file():
            if path.stat().st_size > _LARGEST_WIRING:
                raise ConfigurationError([Problem(WIRING_FILE, f"is larger than {_LARGEST_WIRING} bytes")])
            try:
                return WiringSource(path.read_text("utf-8-sig"), folder)
            except ValueError:
                raise ConfigurationError([Problem(WIRING_FILE, "is no text in UTF-8")]) from None
    text = course.files.get(WIRING_FILE)
    if text is None:
        return None
    wiring = read_wiring(text, parts_of(course), [])
    for folder in places:
        named = [] if wiring is None else [folder / each.sketch for each in wiring.boards.values()]
        if named and all(_is_inside(each, files) and each.exists() for each in named):
            return WiringSource(text, folder)
    return None


def unwired_text(course: Configuration) -> str:
    """The sentence for a team with sketches that no wiring names, and no program."""
    wiring = read_wiring(course.files.get(WIRING_FILE, ""), parts_of(course), [])
    if wiring is None or not wiring.boards:
        return "is missing: it says what is wired to the pins of your board, see simmer-tui init --sketch"
    named = " and ".join(cut(each.sketch) for each in wiring.boards.values())
    return f"the course's names {named}, which is not there: rename your sketch, or hand in a wiring.toml"


def submitted_boards(
    source: WiringSource, files: Path, team: Configuration, course: Configuration
) -> SketchSet:
    """The boards of a team, whose sketches are not compiled yet. Raises ConfigurationError."""
    problems: list[Problem] = []
    wiring = read_wiring(source.text, parts_of(team), problems)
    if wiring is None:
        raise ConfigurationError(problems)
    outside = [
        Problem(each.place_of("sketch"), f'"{cut(each.sketch)}" must lie in the team\'s folder')
        for each in wiring.boards.values()
        if not _is_inside(source.folder / each.sketch, files)
    ]
    problems += outside or missing_sketches(wiring, source.folder)
    problems += wiring_problems(wiring, team, course)
    if problems:
        raise ConfigurationError(problems)
    facts = facts_of(wiring, source.folder, problems)
    bauds = {name: fastest_baud(source.folder / each.sketch) for name, each in wiring.boards.items()}
    if problems:
        raise ConfigurationError(problems)
    return SketchSet(wiring, {}, bauds, facts)


def sketches_to_compile(wiring: Wiring, folder: Path, files: Path) -> dict[str, BoardSketch]:
    """The sketches of a wiring in `folder`, by board."""
    home = files.resolve()
    return {
        name: BoardSketch(
            (folder / board.sketch).resolve().relative_to(home).as_posix(),
            board.kind,
            board.place_of("sketch"),
        )
        for name, board in wiring.boards.items()
    }


def _is_inside(path: Path, files: Path) -> bool:
    try:
        return path.resolve().is_relative_to(files.resolve())
    except (OSError, ValueError, RuntimeError):
        return False  # no path at all
