"""The log of a subcommand: the one named, or else the last saved run."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from simmer_tui.runlog.saved_runs import last_run
from simmer_tui.sim.command import escape


def add_log_argument(parser: argparse.ArgumentParser) -> None:
    """The argument `file`, which may be left out."""
    parser.add_argument(
        "file",
        metavar="FILE",
        type=Path,
        nargs="?",
        help="a log written with --log; without it the app's last run, which is always saved",
    )


def log_of(options: argparse.Namespace) -> Path:
    """The file named, or the last run, which is then said on standard error. Raises RunLogError if
    there is none."""
    if options.file is not None:
        named: Path = options.file
        return named
    path = last_run()
    sys.stderr.write(f"the last run: {escape(str(path), 200)}\n")
    sys.stderr.flush()
    return path
