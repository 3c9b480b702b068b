"""The subcommand `report`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

from simmer_tui.cli.exit_codes import command, configuration_of
from simmer_tui.cli.json_output import add_json_option, print_answer
from simmer_tui.cli.log_argument import add_log_argument, log_of
from simmer_tui.cli.options import OneLineParser
from simmer_tui.cli.outputs import check_outputs, unwritable, write_text, wrote
from simmer_tui.cli.progress import run_through
from simmer_tui.report.command_table import CommandTable
from simmer_tui.report.content import report_document, report_page, svg_picture
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.runlog.log_records import BrokenLine
from simmer_tui.runlog.reader import Logged, LogReader
from simmer_tui.sim.command import escape

_BLOCK, _BLOCK_BYTES = 64, 1 << 18
"""Events, and bytes of a log, that are read before any event is taken in. One at a time takes a tenth
longer: reading and taking in push each other's code out of the processor's cache."""


def _parser() -> OneLineParser:
    parser = OneLineParser(
        prog="simmer-tui report",
        description="Show what a logged run amounts to: what went wrong, where, and how good the sensors "
        "and the program's belief were.",
    )
    add_log_argument(parser)
    parser.add_argument("--svg", metavar="OUT", type=Path, help="write maze, path and sensors as a picture")
    parser.add_argument("--csv", metavar="OUT", type=Path, help="write a table with a row a command")
    parser.add_argument("--html", metavar="OUT", type=Path, help="write all of it as one page")
    add_json_option(parser)
    return parser


@command(_parser)
def run_report(options: argparse.Namespace) -> int:
    """`simmer-tui report [FILE]`: what a logged run amounts to. Returns the exit code."""
    path = log_of(options)
    check_outputs(path, (options.svg, options.csv, options.html))
    run = build_report(path, options.csv, recorded=options.html is not None)
    print_answer(report_document(run, path.name), as_json=options.json)
    for output, make in ((options.svg, svg_picture), (options.html, report_page)):
        if output is not None:
            write_text(output, make(run, escape(path.name, 200)))
    for output in (options.svg, options.csv, options.html):
        if output is not None and not options.json:
            sys.stdout.write(wrote(output))
    return 0


def build_report(path: Path, csv_path: Path | None = None, *, recorded: bool = True) -> RunStatistics:
    """Read a log to its end; with `csv_path` also write its commands there, with `recorded` keep what a
    player shows.

    Raises RunLogError. Broken lines are skipped and noted.
    """
    with ExitStack() as stack:
        with configuration_of(path):
            log = stack.enter_context(LogReader(path))
        run = RunStatistics(log.header, log.configuration, recorded=recorded)
        table = None
        if csv_path is not None:
            try:
                file = stack.enter_context(csv_path.open("w", encoding="utf-8", newline=""))
            except OSError as error:
                raise unwritable(csv_path, error) from None
            table = CommandTable(file)
        try:
            run_through(_steps(log, run, table), log.size, "report")
        except OSError as error:
            raise unwritable(csv_path or path, error) from None
    run.finish(log.note)
    return run


def _steps(log: LogReader, run: RunStatistics, table: CommandTable | None) -> Iterator[int]:
    """Take in the log, and tell now and then how far it has been read."""
    for block in _blocks(log):
        for logged in block:
            run.add(logged)
            if table is not None and isinstance(logged, Logged):
                table.add(logged, run.history.elapsed)
        yield log.position


def _blocks(log: LogReader) -> Iterator[list[Logged | BrokenLine]]:
    """Events of the log, a block at a time."""
    block: list[Logged | BrokenLine] = []
    begin = log.position
    for logged in log:
        block.append(logged)
        if len(block) == _BLOCK or log.position - begin > _BLOCK_BYTES:
            yield block
            block, begin = [], log.position
    yield block
