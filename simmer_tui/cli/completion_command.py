"""`simmer-tui completion`: a shell's completion of commands, options and values."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

from simmer_tui.cli import main
from simmer_tui.cli.command_line import ExitCode, OneLineParser, subcommand
from simmer_tui.cli.help_command import topics
from simmer_tui.config.profiles import DRIVE, LINK, SENSOR, profile_names
from simmer_tui.config.sets import bundled_sets

SHELLS = {
    "bash": "simmer-tui completion bash > ~/.local/share/bash-completion/completions/simmer-tui",
    "zsh": "simmer-tui completion zsh > ~/.zfunc/_simmer-tui  (a folder in fpath, before compinit)",
    "fish": "simmer-tui completion fish > ~/.config/fish/completions/simmer-tui.fish",
}
"""The shells, and the command that installs the script in each."""


_FOLDERS = {"directory", "mazes", "config", "target", "source", "first", "second"}
"""Arguments that are folders, by their name in the parsers."""


def _completion_options(parser: OneLineParser) -> None:
    parser.add_argument("shell", choices=tuple(SHELLS), help="the shell")


@subcommand(
    "completion",
    _completion_options,
    epilog="\n".join(("for good:", *(f"  {how}" for how in SHELLS.values()))),
    formatter_class=argparse.RawDescriptionHelpFormatter,
)
def run_completion(options: argparse.Namespace) -> int:
    """Print a script that makes a shell complete commands, options and values."""
    # Imported here because only this command needs it.
    import shtab

    sys.stdout.write(shtab.complete(whole_parser(), shell=options.shell) + "\n")
    return ExitCode.DONE


def whole_parser() -> argparse.ArgumentParser:
    """All options and all commands in one parser. It parses nothing: completion and the reference pages are
    made from it."""
    parser = main.build_parser()
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", prog="simmer-tui")
    for name, (_, text) in main.SUBCOMMANDS.items():
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
    """Name the kinds of arguments for the shell: names of sets and profiles, folders, files."""
    import shtab

    # Found by the names of parsers' attributes, since a parser does not keep the kind of a value.
    choices: dict[str, Iterable[str]] = {"topic": topics()}
    choices |= dict.fromkeys(("config", "source"), sorted(bundled_sets()))
    choices |= {f"setting.{sort}_profile": profile_names(sort) for sort in (DRIVE, SENSOR, LINK)}
    for action in parser._actions:
        if action.choices is not None or action.nargs == 0:
            continue
        if action.dest in choices:
            action.choices = choices[action.dest]
        elif action.dest in _FOLDERS:
            action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
        elif action.type is Path or action.dest in ("run", "log"):
            action.complete = shtab.FILE  # type: ignore[attr-defined]
