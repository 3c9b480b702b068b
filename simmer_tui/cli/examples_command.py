"""`simmer-tui examples`: the sample programs in a folder."""

from __future__ import annotations

import argparse
from pathlib import Path

from simmer_tui.cli.command_line import ExitCode, OneLineParser, print_lines, subcommand
from simmer_tui.config.examples import EXAMPLE, copy_examples
from simmer_tui.sim.command import counted


def _examples_options(parser: OneLineParser) -> None:
    parser.add_argument(
        "directory", metavar="DIR", type=Path, help="the folder to write; made if it does not exist"
    )


@subcommand("examples", _examples_options)
def run_examples(options: argparse.Namespace) -> int:
    """Copy the sample programs into a folder, to be changed there: wander.py to begin with, the programs of
    the course, a whole mission, the client libraries for Python, C and MATLAB, and sketches for an Arduino.
    Files that are there already stay as they are."""
    written = copy_examples(options.directory)
    where = options.directory
    result = f"{counted(len(written), 'file')} written to {where}" if written else f"{where} has all of them"
    print_lines(
        result,
        "Start simmer-tui in one terminal and a program in another:",
        f"  python {options.directory / EXAMPLE}",
    )
    return ExitCode.DONE
