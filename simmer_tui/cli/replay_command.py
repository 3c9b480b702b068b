"""`simmer-tui replay`: a log on the screen, or a live run from a moment of the log on."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from simmer_tui.cli.app_start import apply_choice
from simmer_tui.cli.command_line import (
    ExitCode,
    OneLineParser,
    add_flag,
    add_run_option,
    add_value,
    asking_nobody,
    has_terminal,
    say,
    subcommand,
)
from simmer_tui.cli.log_options import add_device_options, add_log_argument, configuration_of, log_of
from simmer_tui.cli.main import front_end
from simmer_tui.cli.run_life import RunLife
from simmer_tui.config.settings import all_settings
from simmer_tui.live.takeover import TakeOver, moment_at
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.sim.rules import NumberRule
from simmer_tui.tui.recorded import RecordedRun


def _options(parser: OneLineParser) -> None:
    add_log_argument(parser)
    add_flag(parser, "--follow", "stay at the end of a log that is still being written")
    for item in all_settings():
        if item.name in ("screen.color", "screen.glyphs"):
            choices = tuple(item.rule.schema["enum"])
            parser.add_argument(item.option, choices=choices, default=item.default, help=item.help)
    take_over = parser.add_argument_group(
        "take over", "a live run that continues from a moment of the log (in the replay: t)"
    )
    add_value(take_over, "--take-over", NumberRule(), "take over at once, at S seconds", metavar="S")
    add_flag(take_over, "--no-ui", "without the screen")
    add_run_option(take_over, "run a program, which continues from there")
    take_over.add_argument("--log", metavar="FILE", help="log the run, all that was before included")
    add_device_options(take_over)


@subcommand("replay", _options)
def run_replay(options: argparse.Namespace) -> int:
    """Play a logged run: the maze, the sensors and a clock to move about in."""
    if options.take_over is not None:
        return _take_over_at(log_of(options), options)
    if options.no_ui or options.run or options.log:
        run_replay.parser().error("--no-ui, --run and --log need --take-over")
    if not has_terminal():
        say("simmer-tui replay: there is no terminal to draw on; simmer-tui report needs none")
        return ExitCode.PROBLEM
    path = log_of(options)
    log = RunLogIndex(path)
    with configuration_of(path):
        run = RecordedRun(log)
    choice = apply_choice(options.color, options.glyphs)
    # Imported here: Textual reads the environment variables that the choice has set.
    from simmer_tui.tui.replay import ReplayApp
    from simmer_tui.tui.textual_internals import delta_updates, run_app

    with log, delta_updates(), asking_nobody():
        app = ReplayApp(run, choice, follow=options.follow, devices=options.config)
        run_app(app, mouse=run.configuration.settings.screen.mouse)
    if app.fault:
        say(f"simmer-tui replay: the screen has failed: {app.fault}")
    if app.taken_over is not None:
        return _go_on(app.taken_over, options)
    return ExitCode.PROBLEM if app.fault else app.return_code or 0


def _take_over_at(path: Path, options: argparse.Namespace) -> int:
    with RunLogIndex(path) as log:
        moment = moment_at(log, options.take_over)
    with configuration_of(path):
        chosen = TakeOver(path, moment, options.config)
        chosen.check()
    return _go_on(chosen, options)


def _go_on(chosen: TakeOver, options: argparse.Namespace) -> int:
    """Run the live run. Returns the exit code."""
    server, rerun = chosen.serve()
    front = front_end(server, options)
    advance = partial(chosen.advance, server, rerun)
    return RunLife(server, front, command=options.run, log=options.log, prefix=advance).run()
