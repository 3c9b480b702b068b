"""The subcommand `rerun`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from simmer_tui.cli.exit_codes import ExitCode, command, configuration_of
from simmer_tui.cli.log_argument import add_log_argument, log_of
from simmer_tui.cli.options import OneLineParser
from simmer_tui.cli.progress import run_through
from simmer_tui.phrases import counted
from simmer_tui.runlog.rerun import Rerun
from simmer_tui.sim.command import escape
from simmer_tui.version import __version__


def _parser() -> OneLineParser:
    parser = OneLineParser(
        prog="simmer-tui rerun",
        description="Run the commands of a log again, from its configuration and seed, and compare every "
        "reply bit for bit. Exits with 0 if all are the same, 1 at the first difference, 2 for a broken log.",
    )
    add_log_argument(parser)
    return parser


@command(_parser)
def run_rerun(options: argparse.Namespace) -> int:
    """`simmer-tui rerun [FILE]`: run a logged run again and compare. Returns the exit code."""
    path = log_of(options)
    with configuration_of(path):
        rerun = Rerun(path)
    with rerun:
        run_through(rerun.steps(), rerun.size, "rerun")
        return _report(rerun, path)


def _report(rerun: Rerun, path: Path) -> int:
    for note in rerun.notes:
        sys.stderr.write(f"note: {note}\n")
    header = rerun.header
    shown = escape(str(path), 200)
    if rerun.difference is not None:
        sys.stdout.write(f"{shown}: {rerun.difference}\n")
        if header.program != __version__:
            sys.stdout.write(
                f"the log is from simmer-tui {escape(header.program, 20)}, this is {__version__}\n"
            )
        return ExitCode.NO
    done = f"{counted(rerun.commands, 'command')} and {counted(rerun.actions, 'action')}"
    sys.stdout.write(
        f"{shown}: {done} again, every reply the same "
        f"(seed {header.seed}, configuration {escape(header.configuration, 80)})\n"
    )
    return 0
