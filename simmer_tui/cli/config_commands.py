"""The commands for configuration sets: `init`, `check` and `import`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path

from simmer_tui.cli.command_line import (
    ExitCode,
    OneLineParser,
    add_json_option,
    add_setting_options,
    command,
    overrides_from,
    print_json,
    report,
)
from simmer_tui.config.loader import load
from simmer_tui.config.new_set import explained, with_mission
from simmer_tui.config.set_document import problems_document, set_document
from simmer_tui.config.set_summary import summarize
from simmer_tui.config.sets import (
    MISSION_SET,
    bundled_folder,
    bundled_sets,
    find_set,
    read_files,
    set_name,
    write_files,
)
from simmer_tui.errors import ConfigurationError
from simmer_tui.importer.files import read_path
from simmer_tui.importer.set_writer import set_files
from simmer_tui.sim.command import escape


def _init_parser() -> OneLineParser:
    parser = OneLineParser(
        prog="simmer-tui init", description="Copy a configuration set into a folder, to be edited there."
    )
    parser.add_argument("directory", metavar="DIR", type=Path, help="where to; made if it does not exist")
    sets = ", ".join(bundled_sets())
    parser.add_argument("--from", dest="source", metavar="SET", help=f"another set: {sets}, or a folder")
    add_mission_option(parser)
    return parser


@command(_init_parser)
def run_init(options: argparse.Namespace) -> int:
    """`simmer-tui init DIR [--from SET]`: copy a set out for editing. Returns the exit code."""
    source = bundled_folder() if options.source is None else find_set(options.source)
    if options.mission and source == bundled_folder():
        source = bundled_sets()[MISSION_SET]  # the same robot, with a gripper, and honest about time
    files = read_files(source)
    name = set_name(source)
    written = write_new_set(
        options.directory, files, mission=options.mission, nominal=name if name in bundled_sets() else ""
    )
    shown = escape(str(options.directory), 200)
    sys.stdout.write(f"Wrote {', '.join(path.name for path in written)} to {shown}\n")
    sys.stdout.write(f"Edit them, then: simmer-tui check {shown}\n")
    return 0


def add_mission_option(parser: argparse.ArgumentParser) -> None:
    """The option `--mission` of the commands that write a set."""
    parser.add_argument(
        "--mission",
        action="store_true",
        help="with what the mission needs: a gripper, a load sensor and a mission.toml",
    )


def write_new_set(
    directory: Path, files: Mapping[str, bytes], *, mission: bool, nominal: str = ""
) -> list[Path]:
    """Write a set for people to edit, explained, that names its `nominal` one; returns its files without the
    schemas. Raises ConfigurationError."""
    made = explained(with_mission(files) if mission else files, nominal)
    return [path for path in write_files(directory, made) if path.parent == directory]


def _check_parser() -> OneLineParser:
    parser = OneLineParser(
        prog="simmer-tui check",
        usage="simmer-tui check [DIR] [options]",
        description="Check a configuration set and show what it describes.",
    )
    parser.add_argument(
        "directory",
        metavar="DIR",
        nargs="?",
        help="a folder, or the name of a set (default: config, else the set that comes along)",
    )
    add_json_option(parser)
    add_setting_options(parser)
    return parser


@command(_check_parser)
def run_check(options: argparse.Namespace) -> int:
    """`simmer-tui check [DIR]`: every mistake of a set, or its summary. Returns the exit code."""
    try:
        configuration = load(find_set(options.directory), overrides_from(options))
    except ConfigurationError as error:
        if not options.json:
            raise
        print_json(problems_document(error.problems))
        return ExitCode.PROBLEM
    if options.json:
        print_json(set_document(configuration))
        return ExitCode.DONE
    text = summarize(configuration)
    try:
        # A terminal in the C locale has no characters for the drawing of the maze.
        text.encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        text = summarize(configuration, ascii_only=True)
    sys.stdout.write(text)
    return 0


def _import_parser() -> OneLineParser:
    parser = OneLineParser(
        prog="simmer-tui import",
        description="Make a configuration set of a simmer-python config.py or a MATLAB Main.m. "
        "Nothing of the file is executed.",
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="config.py, Main.m, or the folder of either")
    parser.add_argument(
        "directory", metavar="DIR", type=Path, help="where the set is written; made if need be"
    )
    add_mission_option(parser)
    return parser


@command(_import_parser)
def run_import(options: argparse.Namespace) -> int:
    """`simmer-tui import FILE DIR`: make a configuration set of a team's own files.

    Returns the exit code: 0 for a set that can be used, 1 for one that is written but must be
    edited first, 2 if nothing was written.
    """
    imported = read_path(options.file)
    written = write_new_set(options.directory, set_files(imported), mission=options.mission)
    shown = escape(str(options.directory), 200)
    sys.stdout.write(f"Wrote {', '.join(path.name for path in written)} to {shown}\n")
    if imported.left_out:
        sys.stdout.write("Not taken over, or not as it was:\n")
        sys.stdout.writelines(f"  {problem}\n" for problem in imported.left_out)
    try:
        # Read back as a run will read it: the team learns now what is to be edited.
        load(options.directory)
    except ConfigurationError as error:
        sys.stdout.write("The set needs editing before it can be used:\n")
        report(error)
        return ExitCode.NO
    sys.stdout.write(f"Try it: simmer-tui --config {shown}\n")
    return 0
