"""`simmer-tui help`: help on a command, or on all settings."""

from __future__ import annotations

import argparse
import sys

from simmer_tui.cli import main
from simmer_tui.cli.command_line import ExitCode, OneLineParser, subcommand
from simmer_tui.cli.mistyped import robot_command
from simmer_tui.sim.command import cut
from simmer_tui.sim.rules import did_you_mean

SETTINGS = "settings"
"""The topic that is no command."""


def _help_options(parser: OneLineParser) -> None:
    parser.add_argument("topic", metavar="COMMAND", nargs="?", help=f"the command, or: {SETTINGS}")


def topics() -> tuple[str, ...]:
    """All topics of the help."""
    return (*main.SUBCOMMANDS, SETTINGS)


@subcommand("help", _help_options)
def run_help(options: argparse.Namespace) -> int:
    """Help on a command, as with its --help, or on the options of all settings."""
    topic = options.topic
    if topic is None:
        text = main.build_parser().format_help()
    elif topic == SETTINGS:
        text = main.build_parser().format_settings()
    elif topic in main.SUBCOMMANDS:
        text = main.command_named(topic).parser().format_help()
    elif text := robot_command([topic]):
        main.build_parser().error(f'"{text}" is a command for the robot: type :help {text} in simmer-tui')
    else:
        main.build_parser().error(f'unknown command "{cut(topic)}"{did_you_mean(topic, topics())}')
    sys.stdout.write(text)
    return ExitCode.DONE
