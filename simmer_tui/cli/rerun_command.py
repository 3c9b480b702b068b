"""`simmer-tui rerun`: a logged run again, with every reply compared."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from simmer_tui.cli.command_line import (
    ExitCode,
    OneLineParser,
    add_json_option,
    print_json,
    print_lines,
    say,
    subcommand,
)
from simmer_tui.cli.log_options import add_device_options, add_log_argument, configuration_of, log_of
from simmer_tui.cli.log_reports import run_through
from simmer_tui.document.model import Bullets, DataColumn, Document, data_table
from simmer_tui.sim.command import WORD, counted, cut, typed_path
from simmer_tui.version import __version__

if TYPE_CHECKING:
    from simmer_tui.runlog.rerun import Rerun

RERUN = data_table(
    "rerun",
    "Rerun",
    *map(DataColumn, ("log", "same", "commands", "actions", "seed", "configuration", "version")),
    record=True,
)


def _rerun_options(parser: OneLineParser) -> None:
    add_log_argument(parser)
    parser.add_argument(
        "--sketch",
        metavar="DIR",
        type=Path,
        help="run the boards too, by the sketches of this set: they get the laptop's bytes from the log",
    )
    add_device_options(parser)
    add_json_option(parser)


@subcommand("rerun", _rerun_options)
def run_rerun(options: argparse.Namespace) -> int:
    """Run the commands of a log again, from its configuration and seed, and compare every reply bit for bit.
    If a machine with other mathematics wrote the log, differences by rounding are allowed. Exits with 0 if
    all are the same, 1 at the first difference, 2 for a broken log."""
    # Imported here because a report runs nothing.
    from simmer_tui.runlog.rerun import Rerun

    path = log_of(options)
    with configuration_of(path):
        rerun = Rerun(path, options.config)
    with rerun:
        run_through(rerun.steps(), rerun.size, "rerun")
        if options.sketch is None and rerun.header.sketches:
            rerun.notes.append(
                f"boards drove this robot: simmer-tui rerun {typed_path(path)} --sketch DIR runs them too"
            )
        code = _report_rerun(rerun, path, as_json=options.json)
    if options.sketch is None or code:
        return code
    return _rerun_boards(path, options.sketch)


def _rerun_boards(path: Path, folder: Path) -> int:
    """Run the boards of a log again. Returns the exit code."""
    # Few logs have boards, and a compiler takes its time.
    from simmer_tui.cli.sketch_option import tell_long_build
    from simmer_tui.runlog.board_rerun import BoardRerun

    tell_long_build()
    with BoardRerun(path, folder) as rerun:
        difference = rerun.difference()
        say(difference or f"{path}: {counted(rerun.count, 'fact')} of the boards repeated, all the same")
    return ExitCode.NO if difference else ExitCode.DONE


def _report_rerun(rerun: Rerun, path: Path, *, as_json: bool) -> int:
    for note in rerun.notes:
        say(f"note: {note}")
    header, same = rerun.header, rerun.difference is None
    shown = str(path)
    lines = [f"{shown}: {rerun.difference}"]
    if same:
        done = f"{counted(rerun.commands, 'command')} and {counted(rerun.actions, 'action')}"
        made = f"(seed {header.seed}, configuration {header.configuration})"
        how = "" if rerun.same_machine else " but for rounding"
        lines = [f"{shown}: {done} repeated, every reply the same{how} {made}"]
    elif not rerun.same_machine:
        lines.append("from there on the runs differ: the other machine's sines differ in their last bits")
    # The most likely reason for a difference.
    elif header.program != __version__:
        lines.append(f"the log is from simmer-tui {cut(header.program, WORD)}, this is {__version__}")
    if as_json:
        row = (path, same, rerun.commands, rerun.actions, header.seed, header.configuration, header.program)
        record = RERUN.filled([row])
        print_json(Document("Rerun", [record, Bullets("", lines, "answer")]))
    else:
        print_lines(*lines)
    return ExitCode.DONE if same else ExitCode.NO
