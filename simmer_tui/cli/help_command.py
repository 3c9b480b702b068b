"""The command `help`: help on one command, or on the options of settings."""

from __future__ import annotations

import argparse
import sys

from simmer_tui.cli import main
from simmer_tui.cli.command_line import ExitCode, OneLineParser, subcommand
from simmer_tui.sim.command import escape
from simmer_tui.sim.rules import did_you_mean

SETTINGS = "settings"
"""The topic that is no command."""


def _options(parser: OneLineParser) -> None:
    parser.add_argument("topic", metavar="COMMAND", nargs="?", help=f"which command, or: {SETTINGS}")


def topics() -> tuple[str, ...]:
    """All topics of the help."""
    return (*main.COMMANDS, SETTINGS)


@subcommand("help", _options)
def run_help(options: argparse.Namespace) -> int:
    """Help on a command, as with its --help, or on the options of all settings."""
    topic = options.topic
    if topic is None:
        text = main.build_parser().format_help()
    elif topic == SETTINGS:
        text = main.build_parser().format_settings()
    elif topic in main.COMMANDS:
        text = main.command_named(topic).parser().format_help()
    else:
        run_help.parser().error(f'unknown command "{escape(topic)}"{did_you_mean(topic, topics())}')
    sys.stdout.write(text)
    return ExitCode.DONE
