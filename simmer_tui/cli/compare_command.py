"""The subcommand `compare`."""

from __future__ import annotations

import argparse
from pathlib import Path

from simmer_tui.cli.command_line import (
    ExitCode,
    OneLineParser,
    add_flag,
    add_json_option,
    print_answer,
    subcommand,
)
from simmer_tui.config.device_trust import DeviceUse
from simmer_tui.trials.compare import comparison, paired
from simmer_tui.trials.folder import TrialFolder


def _options(parser: OneLineParser) -> None:
    parser.add_argument("first", metavar="A", type=Path, help="a folder of trials")
    parser.add_argument("second", metavar="B", type=Path, help="another folder of trials")
    text = "compare them although robot, sensors, drives or settings differ, not only the program"
    add_flag(parser, "--other-robot", text)
    add_json_option(parser)


@subcommand(
    "compare", _options, epilog="Run both with simmer-tui trials, the same --seed and an --out folder each."
)
def run_compare(options: argparse.Namespace) -> int:
    """Compare two programs, or two robots, by their trials on the same seeds: B against A."""
    # Results are compared; no sensor is read.
    first, second = (TrialFolder.read(each, DeviceUse.PARSE) for each in (options.first, options.second))
    pairs = paired(first, second, other_robot=options.other_robot)
    print_answer(comparison(first, second, pairs), as_json=options.json)
    return ExitCode.DONE
