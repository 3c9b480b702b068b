"""`simmer-tui`: options read, parts put together, and one of them run."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence

from simmer_tui import __version__
from simmer_tui.config.commands import report, run_check, run_init
from simmer_tui.config.loader import load
from simmer_tui.config.options import OneLineParser, add_setting_options, overrides_from
from simmer_tui.config.sets import find_set
from simmer_tui.errors import ConfigurationError, PortError

_COMMANDS: dict[str, tuple[Callable[[list[str]], int], str]] = {
    "init": (run_init, "copy a configuration set into a folder, to be edited there"),
    "check": (run_check, "check a configuration set and show what it describes"),
}


def build_parser() -> OneLineParser:
    """The options of a run."""
    commands = "\n".join(f"  simmer-tui {name:8} {text}" for name, (_, text) in _COMMANDS.items())
    parser = OneLineParser(
        prog="simmer-tui",
        formatter_class=_Help,
        description="A simulator for mechatronics robots in a maze, driven over TCP or from the terminal.",
        epilog=f"commands (each with its own --help):\n{commands}\n\n"
        "Lengths are inches, angles degrees, times seconds. Options win over settings.toml.",
    )
    parser.add_argument("--version", action="version", version=f"simmer-tui {__version__}")
    run = parser.add_argument_group("run")
    run.add_argument(
        "--config",
        metavar="DIR",
        help="configuration set: a folder, or the name of a bundled one (default: ./config, else default)",
    )
    run.add_argument("--no-ui", action="store_true", help="run without the screen")
    run.add_argument("--quiet", action="store_true", help="without the screen: no lines about what happens")
    run.add_argument("--once", action="store_true", help="end when the client has left")
    run.add_argument(
        "--run",
        metavar='"CMD ..."',
        help="run a program with SIMMER_HOST, SIMMER_PORT and SIMMER_REPLY_PORT set; exit with its exit code",
    )
    add_setting_options(parser)
    return parser


class _Help(argparse.RawDescriptionHelpFormatter):
    """Help with room for long options."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=32)


def main(argv: Sequence[str] | None = None) -> int:
    """Run `simmer-tui` with these arguments; returns the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments and arguments[0] in _COMMANDS:
        return _COMMANDS[arguments[0]][0](arguments[1:])
    options = build_parser().parse_args(arguments)
    from simmer_tui.headless import run_headless, say
    from simmer_tui.station import Station

    if not options.no_ui and not (sys.stdin.isatty() and sys.stdout.isatty() and sys.stderr.isatty()):
        say("simmer-tui: there is no terminal to draw on; add --no-ui to run without the screen")
        return 2

    try:
        station = Station(load(find_set(options.config), overrides_from(options)))
    except ConfigurationError as error:
        return report(error)
    except PortError as error:
        say(f"simmer-tui: {error}")
        return 2
    if options.no_ui:
        return run_headless(station, quiet=options.quiet, once=options.once, command=options.run)
    from simmer_tui.tui.start import run_app

    return run_app(station, once=options.once, command=options.run)


def entry() -> None:
    """The console script. A closed pipe at the other end of standard output is no fault."""
    try:
        code = main()
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 1
    sys.exit(code)
