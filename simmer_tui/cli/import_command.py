"""The subcommand `import`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from simmer_tui.cli.config_commands import add_mission_option, write_new_set
from simmer_tui.cli.exit_codes import ExitCode, command, report
from simmer_tui.cli.options import OneLineParser
from simmer_tui.config.loader import load
from simmer_tui.errors import ConfigurationError
from simmer_tui.importer.files import read_path
from simmer_tui.importer.set_writer import set_files
from simmer_tui.sim.command import escape


def _parser() -> OneLineParser:
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


@command(_parser)
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
        load(options.directory)
    except ConfigurationError as error:
        sys.stdout.write("The set needs editing before it can be used:\n")
        report(error)
        return ExitCode.NO
    sys.stdout.write(f"Try it: simmer-tui --config {shown}\n")
    return 0
