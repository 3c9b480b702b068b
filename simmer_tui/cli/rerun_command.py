"""The subcommand `rerun`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from simmer_tui.cli.exit_codes import ExitCode, command, configuration_of
from simmer_tui.cli.json_output import add_json_option, print_json
from simmer_tui.cli.log_argument import add_log_argument, log_of
from simmer_tui.cli.options import OneLineParser
from simmer_tui.cli.progress import run_through
from simmer_tui.document.model import Bullets, DataColumn, DataTable, Document
from simmer_tui.phrases import counted
from simmer_tui.runlog.rerun import Rerun
from simmer_tui.sim.command import escape
from simmer_tui.version import __version__

RERUN = DataTable(
    "rerun",
    "Rerun",
    tuple(map(DataColumn, ("log", "same", "commands", "actions", "seed", "configuration", "program"))),
    record=True,
)


def _parser() -> OneLineParser:
    parser = OneLineParser(
        prog="simmer-tui rerun",
        description="Run the commands of a log again, from its configuration and seed, and compare every "
        "reply bit for bit. Exits with 0 if all are the same, 1 at the first difference, 2 for a broken log.",
    )
    add_log_argument(parser)
    add_json_option(parser)
    return parser


@command(_parser)
def run_rerun(options: argparse.Namespace) -> int:
    """`simmer-tui rerun [FILE]`: run a logged run again and compare. Returns the exit code."""
    path = log_of(options)
    with configuration_of(path):
        rerun = Rerun(path)
    with rerun:
        run_through(rerun.steps(), rerun.size, "rerun")
        return _report(rerun, path, as_json=options.json)


def _report(rerun: Rerun, path: Path, *, as_json: bool) -> int:
    for note in rerun.notes:
        sys.stderr.write(f"note: {note}\n")
    header, same = rerun.header, rerun.difference is None
    shown = escape(str(path), 200)
    lines = [f"{shown}: {rerun.difference}"]
    if same:
        done = f"{counted(rerun.commands, 'command')} and {counted(rerun.actions, 'action')}"
        made = f"(seed {header.seed}, configuration {escape(header.configuration, 80)})"
        lines = [f"{shown}: {done} again, every reply the same {made}"]
    elif header.program != __version__:
        lines.append(f"the log is from simmer-tui {escape(header.program, 20)}, this is {__version__}")
    if as_json:
        row = (path, same, rerun.commands, rerun.actions, header.seed, header.configuration, header.program)
        record = RERUN.filled([row])
        print_json(Document("Rerun", [record, Bullets("", lines, "answer")]))
    else:
        sys.stdout.write("".join(f"{line}\n" for line in lines))
    return ExitCode.DONE if same else ExitCode.NO
