"""`simmer-tui check`: a set's mistakes, and what it describes."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from simmer_tui.cli.command_line import (
    ExitCode,
    OneLineParser,
    add_json_option,
    add_setting_options,
    add_trust_option,
    overrides_from,
    print_json,
    print_lines,
    subcommand,
)
from simmer_tui.config.device_trust import DeviceUse
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.set_document import CHECK, DIFFERENCES, problems_document, set_document
from simmer_tui.config.set_sketches import WIRING_FILE
from simmer_tui.config.set_summary import summarize
from simmer_tui.config.sets import find_set
from simmer_tui.document.model import Document
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.command import counted


def _check_options(parser: OneLineParser) -> None:
    parser.add_argument(
        "directory",
        metavar="DIR",
        nargs="?",
        help="a folder, also of a course, or the name of a set (default: config, else the bundled default)",
    )
    parser.add_argument(
        "--against",
        metavar="FILE",
        type=Path,
        help="an exchange with the real robot (--record FILE): where the dialect answers otherwise",
    )
    add_trust_option(parser)
    add_json_option(parser)
    add_setting_options(parser)


@subcommand("check", _check_options, usage="simmer-tui check [DIR] [options]")
def run_check(options: argparse.Namespace) -> int:
    """Check a configuration set and show what it describes."""
    try:
        directory, overrides = find_set(options.directory), overrides_from(options)
        configuration = load(directory, overrides, devices=DeviceUse.CHECK)
        course = _course_of(Path(options.directory or ""))
        # A comparison shows the tables alone.
        wiring, problems = _sketches(configuration) if options.against is None else ([], [])
    except ConfigurationError as error:
        if not options.json:
            raise
        print_json(problems_document(error.problems))
        return ExitCode.PROBLEM
    if options.against is not None:
        return _check_against(options.against, configuration, as_json=options.json)
    if options.json:
        print_json(set_document(configuration, problems))
        return ExitCode.NO if problems else ExitCode.DONE
    text = summarize(configuration)
    try:
        # A terminal in the C locale has no characters for the drawing of the maze.
        text.encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        text = summarize(configuration, ascii_only=True)
    sys.stdout.write(text)
    if course:
        print_lines("", course)
    if wiring:
        print_lines("", *wiring)
    if problems:
        print_lines("", f"The wiring and its sketches have {counted(len(problems), 'problem')}:")
        print_lines(*(f"  {problem}" for problem in problems))
    return ExitCode.NO if problems else ExitCode.DONE


def _sketches(configuration: Configuration) -> tuple[list[str], list[Problem]]:
    """The lines about a set's wiring and boards, which run for a second, and the problems with its sketches;
    none for a set without a wiring. Raises ConfigurationError if the wiring itself has mistakes."""
    if WIRING_FILE not in configuration.files:
        return [], []
    from simmer_tui.cli.sketch_option import tell_long_build
    from simmer_tui.config.nominal import nominal_note
    from simmer_tui.sketch.bench_check import bench_lines
    from simmer_tui.sketch.gripper_draft import guess_lines
    from simmer_tui.sketch.motion_check import motor_lines
    from simmer_tui.sketch.sketch_check import facts_of, sketch_problems
    from simmer_tui.sketch.wiring import wiring_lines, wiring_of

    wiring = wiring_of(configuration)
    if wiring is None:
        return [], []
    problems: list[Problem] = []
    facts, wheels = facts_of(wiring, configuration.directory, problems), configuration.simulation.wheels
    problems += sketch_problems(wiring, facts, wheels)
    guesses = guess_lines(wiring, configuration.files[WIRING_FILE])
    note = nominal_note(configuration.settings.nominal)
    lines = [*wiring_lines(wiring), *([note] if note else ()), *guesses, *motor_lines(wiring, wheels)]
    tell_long_build()
    return [*lines, *bench_lines(configuration, wiring, problems)], problems


def _course_of(folder: Path) -> str:
    """A line about the course in a folder, empty if it has none. Raises ConfigurationError."""
    from simmer_tui.grade.course import COURSE_FILE, read_course

    file = folder / COURSE_FILE
    if not file.is_file():
        return ""
    course = read_course(folder, file, alone=True)
    return f"Course: {course.name}; a success rate of {course.require:g} passes ({COURSE_FILE})"


def _check_against(path: Path, configuration: Configuration, *, as_json: bool) -> int:
    """Print the messages that a dialect answers otherwise than its robot did. Returns the exit code."""
    from simmer_tui.config.exchange_file import read_exchange
    from simmer_tui.dialect.exchange import Comparison

    rules = configuration.dialect
    if rules is None or rules.protocol is not None:
        what = "is compared with the rules of a dialect.toml, which this set does not have"
        raise ConfigurationError([Problem("--against", what)])
    baud, pieces = read_exchange(path)
    comparison = Comparison(rules, baud)
    rows = [(each.line, each.text) for each in comparison.differences(pieces)]
    if as_json:
        ok = CHECK.filled([(not rows, configuration.name, str(configuration.directory))])
        print_json(Document("Set", [ok, DIFFERENCES.filled(rows)]))
    else:
        print_lines(*(f"{path.name}:{line}: {text}" for line, text in rows))
        found = counted(len(rows), "difference") if rows else "the dialect answers as the robot did"
        print_lines(f"{counted(comparison.messages, 'message')} of the dialect; {found}")
    return ExitCode.NO if rows else ExitCode.DONE
