"""The subcommand `compare`."""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console
from rich.text import Text

from simmer_tui.cli.exit_codes import ExitCode, command
from simmer_tui.cli.json_output import add_json_option, plain, print_json
from simmer_tui.cli.options import OneLineParser
from simmer_tui.report.terminal_report import print_table
from simmer_tui.trials.compare import count_pairs, paired, tables, verdict
from simmer_tui.trials.estimate_text import rate
from simmer_tui.trials.folder import TrialFolder
from simmer_tui.trials.intervals import mcnemar, paired_difference


def _parser() -> OneLineParser:
    parser = OneLineParser(
        prog="simmer-tui compare",
        description="Compare two programs, or two robots, by their trials on the same seeds: B against A.",
        epilog="Run both with simmer-tui trials, the same --seed and an --out folder each.",
    )
    parser.add_argument("first", metavar="A", type=Path, help="a folder of trials")
    parser.add_argument("second", metavar="B", type=Path, help="another one")
    parser.add_argument(
        "--other-robot",
        action="store_true",
        help="compare them although robot, sensors, drives or settings differ, not only the program",
    )
    add_json_option(parser)
    return parser


@command(_parser)
def run_compare(options: argparse.Namespace) -> int:
    """`simmer-tui compare A B`: print how two sets of trials differ. Returns the exit code."""
    first, second = TrialFolder.read(options.first), TrialFolder.read(options.second)
    pairs = paired(first, second, other_robot=options.other_robot)
    if options.json:
        counts = count_pairs(pairs)
        print_json(
            {
                "runs": len(pairs),
                **plain(counts),
                "difference": paired_difference(counts),
                "p": mcnemar(counts),
                "verdict": verdict(pairs),
                **{
                    name: {
                        "folder": folder.path,
                        "program": folder.plan.command,
                        "success_rate": rate([pair[index] for pair in pairs]),
                    }
                    for index, (name, folder) in enumerate((("a", first), ("b", second)))
                },
            }
        )
        return ExitCode.DONE
    console = Console()
    for table in tables(first, second, pairs):
        print_table(table, console)
    console.print(Text(verdict(pairs), style="bold"))
    return ExitCode.DONE
