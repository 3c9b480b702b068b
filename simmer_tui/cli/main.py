"""`simmer-tui`: its options, the table of its commands, and which part runs."""

from __future__ import annotations

import argparse
import gc
import os
import pkgutil
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from simmer_tui.cli.command_line import (
    CliCommand,
    ExitCode,
    OneLineParser,
    add_setting_options,
    command,
    overrides_from,
)
from simmer_tui.config.dialects import all_ports
from simmer_tui.config.loader import load
from simmer_tui.config.sets import MISSION_SET, bundled_sets, find_set
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.version import __version__

if TYPE_CHECKING:
    from simmer_tui.cli.run_life import FrontEnd
    from simmer_tui.server import Server

# Names, not functions: importing all commands would make every start as slow as the slowest.
COMMANDS = {
    "init": ("config_commands:run_init", "copy a configuration set into a folder, to be edited there"),
    "check": ("config_commands:run_check", "check a configuration set and show what it describes"),
    "import": ("config_commands:run_import", "make a configuration set of a team's own config.py or Main.m"),
    "replay": ("replay_command:run_replay", "play a logged run on the screen"),
    "report": ("log_commands:run_report", "sum a logged run up: tables, pictures, a page"),
    "export": ("log_commands:run_export", "make pictures of a logged run: a GIF that moves, an SVG"),
    "trials": ("trials_command:run_trials", "run a program many times: how often does it succeed"),
    "compare": ("compare_command:run_compare", "compare two sets of trials on the same seeds"),
    "grade": ("grade_command:run_grade", "grade a course's programs, each in a sandbox, with few runs"),
    "calibrate": (
        "calibrate_command:run_calibrate",
        "learn a real robot from run logs of it: a set that behaves so",
    ),
    "rerun": ("log_commands:run_rerun", "run a logged run again and compare every reply"),
    "doctor": ("machine_commands:run_doctor", "what this terminal and machine can do, in ten lines"),
    "completion": ("machine_commands:run_completion", "print completion for a shell"),
    "ports": ("machine_commands:run_ports", "list the serial ports a robot may be on"),
}
"""By name the function in this room, imported only when it is called for, and what it does."""


def build_parser() -> OneLineParser:
    """The options of a run."""
    variables = ", ".join(port.variable for port in all_ports())
    commands = "\n".join(f"  simmer-tui {name:10} {text}" for name, (_, text) in COMMANDS.items())
    parser = OneLineParser(
        prog="simmer-tui",
        usage="simmer-tui [options]\n       simmer-tui COMMAND ...",
        words=COMMANDS,
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
    run.add_argument(
        "--mission",
        action="store_true",
        help="do the mission of the set's mission.toml (default set: mission); without the screen it ends "
        "with the mission, with exit code 0 for success and 1 otherwise",
    )
    run.add_argument("--no-ui", action="store_true", help="run without the screen")
    run.add_argument("--quiet", action="store_true", help="without the screen: no lines about what happens")
    run.add_argument("--once", action="store_true", help="end when the client has left (see also --idle)")
    run.add_argument(
        "--run",
        metavar='"CMD ..."',
        help=f"run a program with SIMMER_HOST and the ports ({variables}) set; exit with its exit code",
    )
    run.add_argument(
        "--log", metavar="FILE", help="log the run: a file, or auto for one named by date in your data folder"
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
    if arguments and arguments[0] in COMMANDS:
        # Switched off in `__main__` while modules are imported.
        gc.enable()
        return command_named(arguments[0])(arguments[1:])
    return _run(arguments)


def command_named(name: str) -> CliCommand:
    """The function of a command in the table."""
    chosen: CliCommand = pkgutil.resolve_name(f"simmer_tui.cli.{COMMANDS[name][0]}")
    return chosen


@command(build_parser)
def _run(options: argparse.Namespace) -> int:
    """A run, with the screen or without."""
    from simmer_tui.cli.run_life import RunLife, say

    if not options.no_ui and not (sys.stdin.isatty() and sys.stdout.isatty() and sys.stderr.isatty()):
        say("simmer-tui: there is no terminal to draw on; add --no-ui to run without the screen")
        return ExitCode.PROBLEM
    server = _server(options)
    gc.freeze()  # what start-up has made stays; collections need not go through it again
    gc.enable()
    front = front_end(server, options, quiet=options.quiet, once=options.once)
    return RunLife(server, front, command=options.run, once=options.once, log=options.log).run()


def front_end(
    server: Server, options: argparse.Namespace, *, quiet: bool = False, once: bool = False
) -> FrontEnd:
    """The front end for a live run: lines with `--no-ui`, else the screen."""
    if options.no_ui:
        from simmer_tui.cli.headless import Headless

        return Headless(server, quiet=quiet, has_program=options.run is not None)
    from simmer_tui.cli.app_start import Screen

    return Screen(server, once=once, has_program=options.run is not None)


def _server(options: argparse.Namespace) -> Server:
    """The server of a run. Raises ConfigurationError, PortError."""
    from simmer_tui.server import Server

    overrides = overrides_from(options)
    if not options.mission:
        return Server(load(find_set(options.config), overrides))
    from simmer_tui.mission import plan_run

    directory = bundled_sets()[MISSION_SET] if options.config is None else find_set(options.config)
    given = [
        overrides[name].option for name in ("bot_center", "bot_rot", "block_center") if name in overrides
    ]
    # Two places that say where the robot starts: one would be ignored without a word.
    if given:
        what = "has no effect in a mission: mission.toml says where robot and block start"
        raise ConfigurationError([Problem(option, what) for option in given])
    configuration, plan = plan_run(load(directory, overrides))
    return Server(configuration, plan=plan)


def run() -> None:
    """`main` as the whole program. A closed pipe at the other end of standard output is no fault."""
    try:
        code = main()
        sys.stdout.flush()
    # `simmer-tui report | head` ends like this.
    except BrokenPipeError:
        # Python flushes standard output once more at exit, which must not fail.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = ExitCode.NO
    sys.exit(code)
