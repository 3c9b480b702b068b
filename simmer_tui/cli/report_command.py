"""`simmer-tui report`: what happened in a logged run."""

from __future__ import annotations

import argparse
from pathlib import Path

from simmer_tui.cli.command_line import OneLineParser, add_json_option, print_answer, print_lines, subcommand
from simmer_tui.cli.log_options import add_log_argument, log_of
from simmer_tui.cli.log_reports import build_report, check_outputs, write_text, wrote
from simmer_tui.report.content import report_document, svg_picture


def _report_options(parser: OneLineParser) -> None:
    add_log_argument(parser)
    parser.add_argument("--svg", metavar="OUT", type=Path, help="write maze, path and sensors as a picture")
    parser.add_argument("--csv", metavar="OUT", type=Path, help="write a table with a row for each command")
    parser.add_argument("--html", metavar="OUT", type=Path, help="write all of it as one page")
    parser.add_argument(
        "--nominal",
        metavar="SET",
        help="compare sensors and drives with this set, too (default: the one the run's set was made from)",
    )
    add_json_option(parser)


@subcommand("report", _report_options)
def run_report(options: argparse.Namespace) -> int:
    """Summarize a logged run: what went wrong, where, and the errors of the sensors and of the program's
    belief."""
    path = log_of(options)
    check_outputs(path, (options.svg, options.csv, options.html))
    run = build_report(path, options.csv, recorded=options.html is not None, nominal=options.nominal)
    # Before the answer, which a pipe such as `| head` may cut off.
    if options.svg is not None:
        write_text(options.svg, svg_picture(run, path.name))
    if options.html is not None:
        # Imported here because most reports have no page.
        from simmer_tui.report.page import report_page

        write_text(options.html, report_page(run, path.name))
    print_answer(
        report_document(run, path.name, "" if options.file is None else str(path)),
        as_json=options.json,
    )
    for output in (options.svg, options.csv, options.html):
        if output is not None and not options.json:
            print_lines(wrote(output))
    return 0
