"""`simmer-tui export`: pictures of a logged run."""

from __future__ import annotations

import argparse
from pathlib import Path

from simmer_tui.cli.command_line import OneLineParser, add_value, print_lines, subcommand, writing
from simmer_tui.cli.log_options import add_log_argument, log_of
from simmer_tui.cli.log_reports import build_report, check_outputs, run_through, write_text, wrote
from simmer_tui.errors import ExportError, RunLogError
from simmer_tui.report.content import maze_picture
from simmer_tui.sim.rules import IntegerRule, NumberRule


def _export_options(parser: OneLineParser) -> None:
    # Imported here because a report has no GIF.
    from simmer_tui.report.animation import USUAL_SECONDS

    add_log_argument(parser)
    parser.add_argument("--gif", metavar="OUT", type=Path, help="write the run as a GIF (needs Pillow)")
    parser.add_argument("--svg", metavar="OUT", type=Path, help="write the whole path as a picture")
    text = "width of the pictures (default %(default)s)"
    add_value(parser, "--width", IntegerRule(160, 3840), text, metavar="PIXELS", default=720)
    usual = f"1, or as many as make it {USUAL_SECONDS:g} s long"
    text = f"simulated seconds a second of the GIF (default: {usual})"
    add_value(parser, "--speed", NumberRule(0.01, 1000), text, metavar="X", dest="playback_rate")
    seconds = NumberRule(0)
    add_value(parser, "--from", seconds, "beginning of the GIF, seconds", metavar="S", dest="begin")
    add_value(parser, "--until", seconds, "end of the GIF, seconds", metavar="S")


@subcommand("export", _export_options)
def run_export(options: argparse.Namespace) -> int:
    """Make pictures of a logged run for slides: an animated GIF, or the whole path as an SVG that can be
    enlarged."""
    from simmer_tui.report.animation import shots, write_gif

    if options.gif is None and options.svg is None:
        raise ExportError("name what to write: --gif OUT, --svg OUT, or both")
    path = log_of(options)
    check_outputs(path, (options.gif, options.svg))
    for output, kind in ((options.gif, "a GIF"), (options.svg, "an SVG")):
        ending = f".{kind[-3:].lower()}"
        if output is not None and output.suffix.lower() not in ("", ending):
            named = f"name it {output.with_suffix(ending)}, not {output}"
            raise ExportError(f"--{ending[1:]} writes {kind}: {named}")
    run = build_report(path)
    if options.svg is not None:
        write_text(options.svg, maze_picture(run, path.name, options.width))
        print_lines(wrote(options.svg))
    if options.gif is not None:
        taken = shots(run, options.begin, options.until, options.playback_rate)
        with writing(RunLogError, options.gif):
            run_through(write_gif(run, options.gif, taken, options.width), len(taken.times), "pictures")
        print_lines(wrote(options.gif))
    return 0
