"""The subcommand `completion`: a script by which a shell completes commands, options and values."""

from __future__ import annotations

import argparse
import sys

from simmer_tui.cli import main
from simmer_tui.cli.exit_codes import ExitCode, command
from simmer_tui.cli.options import OneLineParser
from simmer_tui.config.profiles import DRIVE, LINK, SENSOR, profile_names
from simmer_tui.config.sets import bundled_sets

SHELLS = {
    "bash": "simmer-tui completion bash > ~/.local/share/bash-completion/completions/simmer-tui",
    "zsh": "simmer-tui completion zsh > ~/.zfunc/_simmer-tui  (a folder in fpath, before compinit)",
    "fish": "simmer-tui completion fish > ~/.config/fish/completions/simmer-tui.fish",
}
"""The shells, and how each takes the script for good."""
_FOLDERS = {"directory", "mazes", "config", "target", "source", "first", "second"}
"""Arguments that are folders, by their name in the parsers."""


def _parser() -> OneLineParser:
    parser = OneLineParser(
        prog="simmer-tui completion",
        description="Print a script that makes a shell complete commands, options and values.",
        epilog="\n".join(("for good:", *(f"  {how}" for how in SHELLS.values()))),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("shell", choices=tuple(SHELLS), help="which shell")
    return parser


@command(_parser)
def run_completion(options: argparse.Namespace) -> int:
    """`simmer-tui completion SHELL`: print the script. Returns the exit code."""
    import shtab

    sys.stdout.write(shtab.complete(whole_parser(), shell=options.shell) + "\n")
    return ExitCode.DONE


def whole_parser() -> argparse.ArgumentParser:
    """All options and all commands in one parser. It parses nothing: what completion and the reference
    pages are made of."""
    parser = main.build_parser()
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", prog="simmer-tui")
    for name, (_, text) in main.COMMANDS.items():
        made = main.command_named(name).parser()
        commands.add_parser(
            name,
            help=text,
            description=made.description,
            parents=[made],
            add_help=False,
            conflict_handler="resolve",
        )
    for each in (parser, *commands.choices.values()):
        _name_values(each)
    return parser


def _name_values(parser: argparse.ArgumentParser) -> None:
    """Tell the shell what arguments may be: names of sets and profiles, folders, files."""
    import shtab

    profiles = {f"setting.{sort}_profile": profile_names(sort) for sort in (DRIVE, SENSOR, LINK)}
    for action in parser._actions:
        if action.choices is not None or action.nargs == 0:
            continue
        if action.dest in ("config", "source"):
            action.choices = sorted(bundled_sets())
        elif action.dest in profiles:
            action.choices = profiles[action.dest]
        elif action.dest in _FOLDERS:
            action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
        elif action.type is not None or action.dest in ("run", "log"):
            action.complete = shtab.FILE  # type: ignore[attr-defined]
