"""`simmer-tui import`: a set made of a foreign configuration."""

from __future__ import annotations

import argparse
from pathlib import Path

from simmer_tui.cli.command_line import ExitCode, OneLineParser, print_lines, report, subcommand
from simmer_tui.cli.set_output import add_mission_option, write_set_files
from simmer_tui.config.device_trust import DeviceUse
from simmer_tui.config.importer.device_skeletons import with_skeletons
from simmer_tui.config.importer.files import read_path
from simmer_tui.config.importer.imported import check_mission
from simmer_tui.config.importer.set_writer import set_files
from simmer_tui.config.loader import load
from simmer_tui.config.new_set import with_comments, with_mission
from simmer_tui.errors import ConfigurationError
from simmer_tui.sim.command import typed_path


def _import_options(parser: OneLineParser) -> None:
    parser.add_argument("file", metavar="FILE", type=Path, help="config.py, Main.m, or the folder of either")
    parser.add_argument(
        "directory", metavar="DIR", type=Path, help="the folder to write; made if it does not exist"
    )
    add_mission_option(parser)


@subcommand("import", _import_options)
def run_import(options: argparse.Namespace) -> int:
    """Make a configuration set from a simmer-python config.py or a MATLAB Main.m. The file is read, never
    executed."""
    # Exit code 0: the set can be used. 1: it was written, but must be edited first.
    imported, skeletons = with_skeletons(read_path(options.file))
    if options.mission:
        check_mission(imported)
    files = {**set_files(imported), **skeletons}
    files = with_comments(with_mission(files) if options.mission else files)
    print_lines(write_set_files(options.directory, files))
    if imported.left_out:
        print_lines("Not imported, or changed:", *(f"  {problem}" for problem in imported.left_out))
    try:
        # Read back as a run will read it: the team sees now what must be edited.
        load(options.directory, devices=DeviceUse.PARSE)
    except ConfigurationError as error:
        print_lines("The set needs editing before it can be used:")
        report(error)
        return ExitCode.NO
    if skeletons:
        print_lines(f"To finish: {', '.join(skeletons)} (docs/devices.md says how)")
    print_lines(f"Try it: simmer-tui --config {typed_path(options.directory)}")
    return ExitCode.DONE
