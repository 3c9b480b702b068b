"""The subcommand `compare`."""

from __future__ import annotations

import argparse
from pathlib import Path

from simmer_tui.cli.command_line import ExitCode, OneLineParser, add_json_option, command, print_answer
from simmer_tui.config.device_trust import DeviceUse
from simmer_tui.trials.compare import comparison, paired
from simmer_tui.trials.folder import TrialFolder


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
    # Results are compared, and no sensor is read.
    first, second = (TrialFolder.read(each, DeviceUse.PARSE) for each in (options.first, options.second))
    pairs = paired(first, second, other_robot=options.other_robot)
    print_answer(comparison(first, second, pairs), as_json=options.json)
    return ExitCode.DONE
