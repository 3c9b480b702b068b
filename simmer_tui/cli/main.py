"""`simmer-tui`: its options, the table of its commands, and which part runs."""

from __future__ import annotations

import argparse
import gc
import io
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from simmer_tui import platform_has
from simmer_tui.cli.command_line import (
    CliCommand,
    ExitCode,
    OneLineParser,
    add_config_option,
    add_flag,
    add_run_option,
    add_setting_options,
    add_sketch_option,
    add_trust_option,
    drop_output,
    has_terminal,
    overrides_from,
    say,
    without_effect,
)
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.sets import find_mission_set, find_set
from simmer_tui.config.settings import OFF
from simmer_tui.errors import ConfigurationError, Problem, is_disk_full, lacks_temporary_folder, reason_of
from simmer_tui.version import __version__, requirement

if TYPE_CHECKING:
    from simmer_tui.cli.run_life import FrontEnd
    from simmer_tui.live.server import Server
    from simmer_tui.web.page_server import PageServer

# Names, not functions: importing all commands would make every start as slow as the slowest.
SUBCOMMANDS = {
    "init": ("init_command:run_init", "copy a configuration set into a folder, to be edited there"),
    "examples": ("examples_command:run_examples", "copy the sample programs into a folder"),
    "check": ("check_command:run_check", "check a configuration set and show what it describes"),
    "import": ("import_command:run_import", "make a configuration set from a team's config.py or Main.m"),
    "replay": ("replay_command:run_replay", "play a logged run on the screen"),
    "report": ("report_command:run_report", "summarize a logged run: verdict, tables, pictures, a page"),
    "why": ("why_command:run_why", "run a failed run again with one change at a time"),
    "export": ("export_command:run_export", "make pictures of a logged run: an animated GIF, an SVG"),
    "trials": ("trials_command:run_trials", "run a program many times and measure its success rate"),
    "compare": ("compare_command:run_compare", "compare two sets of trials on the same seeds"),
    "grade": ("grade_command:run_grade", "grade a course's programs, each in a sandbox, with few runs"),
    "calibrate": (
        "calibrate_command:run_calibrate",
        "estimate a real robot's parameters from run logs, as a set",
    ),
    "atlas": ("atlas_command:run_atlas", "compute expected readings at every pose of a grid, as a file"),
    "rerun": ("rerun_command:run_rerun", "run a logged run again and compare every reply"),
    "doctor": ("doctor_command:run_doctor", "check this terminal and machine, in eleven lines"),
    "env": ("env_command:run_env", "print the variables for programs that an IDE starts"),
    "completion": ("completion_command:run_completion", "print completion for a shell"),
    "ports": ("ports_command:run_ports", "list the serial ports a robot may be on"),
    "help": ("help_command:run_help", "help on a command, or on all settings: help settings"),
}
"""By name the function in this package, imported only when it is used, and its description."""


_COMMON_SETTINGS = ("seed", "realistic", "server.port", "serial.port", "screen.pace")
"""Settings that a run is given most often."""


def build_parser() -> OneLineParser:
    """The options of a run."""
    commands = "\n".join(f"  {name:11} {text}" for name, (_, text) in SUBCOMMANDS.items())
    parser = OneLineParser(
        prog="simmer-tui",
        usage="simmer-tui [options]\n       simmer-tui COMMAND ...",
        words=SUBCOMMANDS,
        formatter_class=_Help,
        description="A simulator for mechatronics robots in a maze, driven over TCP or from the terminal.\n\n"
        f"commands (simmer-tui help COMMAND says more):\n{commands}",
        epilog="Lengths are inches, angles degrees, times seconds. Options win over settings.toml.",
    )
    parser.add_argument("--version", action="version", version=f"simmer-tui {__version__}")
    run = parser.add_argument_group("run")
    add_config_option(run)
    add_sketch_option(run)
    text = "do the set's mission (default set: ./config or mission); with --no-ui exit code 1: it failed"
    add_flag(run, "--mission", text)
    add_flag(run, "--no-ui", "run without the screen")
    add_flag(run, "--quiet", "without the screen: no lines about what happens")
    add_flag(run, "--once", "end when the client has left (see also --idle)")
    add_run_option(
        run, "run a program with SIMMER_PORT and others set (docs/trials.md); exit with its exit code"
    )
    run.add_argument("--log", metavar="FILE", help="log the run; auto: a file in your data folder")
    run.add_argument(
        "--token-file",
        metavar="FILE",
        type=Path,
        help="first line: the --token, unseen by other users",
    )
    add_trust_option(run)
    add_setting_options(parser, has_screen=True)
    parser.common_settings = _COMMON_SETTINGS
    return parser


class _Help(argparse.RawDescriptionHelpFormatter):
    """Help with room for long options."""

    def __init__(self, prog: str, width: int | None = None) -> None:
        super().__init__(prog, max_help_position=32, width=width)


def main(argv: Sequence[str] | None = None) -> int:
    """Run `simmer-tui` with these arguments; returns the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments and arguments[0] in SUBCOMMANDS:
        command = command_named(arguments[0])
        # Switched off in `__main__` while modules are imported. Collections need not visit the modules again.
        gc.freeze()
        gc.enable()
        return command(arguments[1:])
    return CliCommand(build_parser, _run)(arguments)


def command_named(name: str) -> CliCommand:
    """The function of a command in the table."""
    module, function = SUBCOMMANDS[name][0].split(":")
    chosen: CliCommand = getattr(import_module(f"simmer_tui.cli.{module}"), function)
    return chosen


def _run(options: argparse.Namespace) -> int:
    """A run, with or without the screen. Returns the exit code."""
    from simmer_tui.cli.run_life import RunLife

    if not options.no_ui and not has_terminal():
        say("simmer-tui: there is no terminal to draw on; add --no-ui to run without the screen")
        return ExitCode.PROBLEM
    server = _server(options)
    gc.freeze()  # the objects of the start stay; garbage collections need not visit them again
    gc.enable()
    page = _page(server)
    front = front_end(server, options, quiet=options.quiet, once=options.once)
    return RunLife(server, front, command=options.run, once=options.once, log=options.log, page=page).run()


def _page(server: Server) -> PageServer | None:
    """The page that shows the run in browsers, if one is wanted. Raises ConfigurationError, PortError."""
    if server.configuration.settings.web.port == OFF:
        return None
    try:
        from simmer_tui.web.page_server import PageServer
    except ModuleNotFoundError as error:
        if error.name != "websockets":
            raise
        what = f"needs the package websockets: pip install '{requirement('web')}'"
        raise ConfigurationError([Problem("--web", what)]) from None
    return PageServer(server)


def front_end(
    server: Server, options: argparse.Namespace, *, quiet: bool = False, once: bool = False
) -> FrontEnd:
    """The front end for a live run: lines with `--no-ui`, otherwise the screen."""
    if options.no_ui:
        from simmer_tui.cli.headless import Headless

        return Headless(server, quiet=quiet, has_program=options.run is not None)
    from simmer_tui.cli.app_start import Screen

    return Screen(server, once=once, program=options.run)


def _server(options: argparse.Namespace) -> Server:
    """The server of a run. Raises ConfigurationError, PortError."""
    from simmer_tui.links.pty_port import NOT_ON_WINDOWS
    from simmer_tui.live.server import Server

    overrides = overrides_from(options)
    if "server.pty" in overrides and not platform_has.POSIX:
        place, _, what = NOT_ON_WINDOWS.partition(": ")
        raise ConfigurationError([Problem(place, what)])
    if options.token_file is not None:
        from simmer_tui.cli.access_token import add_token_of

        add_token_of(options.token_file, overrides)
    if options.sketch is not None:
        from simmer_tui.cli.sketch_option import compiled, sketch_set

        options.config = sketch_set(options, overrides)
    find = find_mission_set if options.mission else find_set
    directory = find(options.config)
    if options.mission and (problems := without_effect(overrides)):
        raise ConfigurationError(problems)
    configuration, sketches = load(directory, overrides), None
    if options.sketch is not None:
        configuration, sketches = compiled(configuration)
    configuration, plan = with_possible_clock(configuration, options), None
    if options.mission:
        from simmer_tui.run.mission import plan_run

        configuration, plan = plan_run(configuration)
    return Server(configuration, plan=plan, sketches=sketches)


def with_possible_clock(configuration: Configuration, options: argparse.Namespace) -> Configuration:
    """The same configuration, with the real clock if there is no program to follow and that is allowed.
    Raises ConfigurationError."""
    motion = configuration.settings.motion
    if not motion.is_by_program or (options.run is not None and options.no_ui):
        return configuration
    if motion.clock == "program":
        what = "follows the clock of a Python program that is run: it needs --run and --no-ui"
        raise ConfigurationError([Problem("--clock program", what)])
    return configuration.with_settings({"motion.clock": "real"})


def _open_closed_streams() -> None:
    """Open the null device for each standard stream that is closed, as by `>&-` or in a service.

    Otherwise the next socket or file gets its descriptor, and a program that is run writes into that.
    """
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is not None:
            continue
        opened = os.open(os.devnull, os.O_RDWR)
        if opened != descriptor:
            os.dup2(opened, descriptor)
            os.close(opened)
        os.set_inheritable(descriptor, True)
        mode = "r" if name == "stdin" else "w"
        stream = os.fdopen(descriptor, mode, encoding="utf-8", closefd=False)
        setattr(sys, name, stream)


def run() -> None:
    """Run `main` as the whole program.

    A closed pipe at the other end of standard output is no fault. A full disk is told in one line. A console
    without all characters, such as one of Windows with code page 1252, is no fault either.
    """
    _open_closed_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a test may have another kind of stream
            stream.reconfigure(errors="backslashreplace")
    code: int | str | None
    try:
        try:
            code = main()
        except SystemExit as ended:  # argparse ends help, version and wrong options so
            code = ended.code
        sys.stdout.flush()
    # `simmer-tui report | head` ends like this.
    except BrokenPipeError:
        drop_output(sys.stdout)
        code = ExitCode.NO
    except OSError as error:
        if lacks_temporary_folder(error):
            say(f"simmer-tui: {reason_of(error)}")
            sys.exit(ExitCode.PROBLEM)
        # Errors with a file's name are not from standard output.
        if error.filename is not None or not is_disk_full(error):
            raise
        drop_output(sys.stdout)
        say(f"simmer-tui: the answer cannot be written: {reason_of(error)}")
        code = ExitCode.PROBLEM
    sys.exit(code)
