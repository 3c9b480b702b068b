"""The subcommands that work on configuration sets: `init` and `check`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path

from simmer_tui.cli.exit_codes import ExitCode, command
from simmer_tui.cli.json_output import add_json_option, print_json, problems_of
from simmer_tui.cli.options import OneLineParser, add_setting_options, overrides_from
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.new_set import explained, with_mission
from simmer_tui.config.set_summary import summarize
from simmer_tui.config.sets import (
    MISSION_SET,
    bundled_folder,
    bundled_sets,
    find_set,
    read_files,
    write_files,
)
from simmer_tui.document.as_json import plain
from simmer_tui.errors import ConfigurationError
from simmer_tui.sim.command import escape
from simmer_tui.sim.specs import CELL_SIZE


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
    written = write_new_set(options.directory, files, mission=options.mission)
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


def write_new_set(directory: Path, files: Mapping[str, bytes], *, mission: bool) -> list[Path]:
    """Write a set for people to edit, explained; returns its files without the schemas. Raises
    ConfigurationError."""
    made = explained(with_mission(files) if mission else files)
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
        print_json({"ok": False, "problems": problems_of(error)})
        return ExitCode.PROBLEM
    if options.json:
        print_json({"ok": True, **_described(configuration)})
        return ExitCode.DONE
    text = summarize(configuration)
    try:
        text.encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        text = summarize(configuration, ascii_only=True)
    sys.stdout.write(text)
    return 0


def _described(configuration: Configuration) -> dict[str, object]:
    simulation = plain(configuration.simulation)
    for sensor, described in zip(configuration.simulation.sensors, simulation["sensors"], strict=True):
        described["id"] = sensor.id
    return {
        "name": configuration.name,
        "directory": configuration.directory,
        "cell_size_in": CELL_SIZE,
        **simulation,
        "settings": configuration.settings,
        "mission": configuration.mission,
    }
