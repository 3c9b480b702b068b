"""The subcommand `rerun`."""

from __future__ import annotations

import sys
from pathlib import Path

from simmer_tui import __version__
from simmer_tui.config.options import OneLineParser
from simmer_tui.errors import ConfigurationError, SimmerError
from simmer_tui.runlog.progress import run_through
from simmer_tui.runlog.rerun import Rerun
from simmer_tui.sim.command import escape

EXIT_DIFFERENT = 1
EXIT_PROBLEMS = 2


def run_rerun(argv: list[str]) -> int:
    """`simmer-tui rerun FILE`: run a logged run again and compare. Returns the exit code."""
    parser = OneLineParser(
        prog="simmer-tui rerun",
        description="Run the commands of a log again, from its configuration and seed, and compare every "
        "reply bit for bit. Exits with 0 if all are the same, 1 at the first difference, 2 for a broken log.",
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="a log written with --log")
    path: Path = parser.parse_args(argv).file
    try:
        with Rerun(path) as rerun:
            run_through(rerun.steps(), rerun.size, "rerun")
            return _report(rerun, path)
    except ConfigurationError as error:
        sys.stderr.write(f"simmer-tui rerun: the configuration in {escape(str(path), 200)} is refused:\n")
        sys.stderr.write("".join(f"{problem}\n" for problem in error.problems))
    except SimmerError as error:
        sys.stderr.write(f"simmer-tui rerun: {error}\n")
    return EXIT_PROBLEMS


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
        return EXIT_DIFFERENT
    done = f"{_count(rerun.commands, 'command')} and {_count(rerun.actions, 'action')}"
    sys.stdout.write(
        f"{shown}: {done} again, every reply the same "
        f"(seed {header.seed}, configuration {escape(header.configuration, 80)})\n"
    )
    return 0


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
