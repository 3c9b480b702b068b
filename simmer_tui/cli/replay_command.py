"""`simmer-tui replay`: a log opened, the terminal looked at, the replay screen run."""

from __future__ import annotations

import os
import sys

from simmer_tui.cli.exit_codes import ExitCode, command, configuration_of
from simmer_tui.cli.kept_run import add_log_argument, log_of
from simmer_tui.cli.options import OneLineParser
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.tui.recorded import RecordedRun
from simmer_tui.tui.terminal import COLOR_OPTIONS, GLYPH_OPTIONS, choose


@command("replay")
def run_replay(argv: list[str]) -> int:
    """`simmer-tui replay [FILE] [--follow]`. Returns the exit code."""
    parser = OneLineParser(
        prog="simmer-tui replay",
        description="Play a logged run: the maze, the sensors and a clock to move about in.",
    )
    add_log_argument(parser)
    parser.add_argument(
        "--follow", action="store_true", help="stay at the end of a log that is still being written"
    )
    parser.add_argument("--color", choices=COLOR_OPTIONS, default="auto", help="colours of the terminal")
    parser.add_argument(
        "--glyphs", choices=GLYPH_OPTIONS, default="auto", help="characters the maze is drawn with"
    )
    options = parser.parse_args(argv)
    if not (sys.stdin.isatty() and sys.stdout.isatty() and sys.stderr.isatty()):
        sys.stderr.write("simmer-tui replay: there is no terminal to draw on; simmer-tui report needs none\n")
        return ExitCode.PROBLEM
    path = log_of(options)
    log = RunLogIndex(path)
    with configuration_of(path):
        run = RecordedRun(log)
    windows = sys.platform == "win32"
    choice = choose(
        os.environ, sys.stdout.encoding, color=options.color, glyphs=options.glyphs, windows=windows
    )
    choice.apply(os.environ)
    from simmer_tui.tui.replay import ReplayApp
    from simmer_tui.tui.textual_internals import cropped_dirty_spans

    with log, cropped_dirty_spans():
        app = ReplayApp(run, choice, follow=options.follow)
        app.run(mouse=run.configuration.settings.screen.mouse)
    return app.return_code or 0
