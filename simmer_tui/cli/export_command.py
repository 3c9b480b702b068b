"""The subcommand `export`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from simmer_tui.cli.exit_codes import command
from simmer_tui.cli.log_argument import add_log_argument, log_of
from simmer_tui.cli.options import OneLineParser
from simmer_tui.cli.outputs import check_outputs, unwritable, write_text, wrote
from simmer_tui.cli.progress import run_through
from simmer_tui.cli.report_command import build_report
from simmer_tui.errors import ExportError
from simmer_tui.report.animation import shots, write_gif
from simmer_tui.report.content import maze_picture
from simmer_tui.sim.command import escape


def _parser() -> OneLineParser:
    parser = OneLineParser(
        prog="simmer-tui export",
        description="Make pictures of a logged run for slides: a GIF that moves, or the whole way as a still "
        "picture that can be enlarged.",
    )
    add_log_argument(parser)
    parser.add_argument("--gif", metavar="OUT", type=Path, help="write the run as a GIF (needs Pillow)")
    parser.add_argument("--svg", metavar="OUT", type=Path, help="write the whole way as a picture")
    parser.add_argument(
        "--width", metavar="PIXELS", type=_width, default=720, help="of the pictures (default 720)"
    )
    parser.add_argument(
        "--speed", metavar="X", type=_speed,
        help="simulated seconds a second of the GIF (default: 1, or as many as make it 20 s long)",
    )  # fmt: skip
    parser.add_argument(
        "--from", metavar="S", type=_seconds, dest="begin", help="where the GIF begins, seconds"
    )
    parser.add_argument("--until", metavar="S", type=_seconds, help="where it ends")
    return parser


@command(_parser)
def run_export(options: argparse.Namespace) -> int:
    """`simmer-tui export [FILE] --gif OUT --svg OUT`: a run for slides. Returns the exit code."""
    if options.gif is None and options.svg is None:
        raise ExportError("say what to write: --gif OUT, --svg OUT, or both")
    path = log_of(options)
    check_outputs(path, (options.gif, options.svg))
    run = build_report(path)
    if options.svg is not None:
        write_text(options.svg, maze_picture(run, escape(path.name, 200), options.width))
        sys.stdout.write(wrote(options.svg))
    if options.gif is not None:
        taken = shots(run, options.begin, options.until, options.speed)
        try:
            run_through(write_gif(run, options.gif, taken, options.width), len(taken.times), "pictures")
        except OSError as error:
            raise unwritable(options.gif, error) from None
        sys.stdout.write(wrote(options.gif))
    return 0


def _number(text: str, low: float, high: float, what: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = float("nan")
    if not low <= number <= high:
        raise argparse.ArgumentTypeError(f"{escape(text, 40)!r} is not {what}")
    return number


def _width(text: str) -> int:
    return round(_number(text, 160, 3840, "a width from 160 to 3840 pixels"))


def _speed(text: str) -> float:
    return _number(text, 0.01, 1000, "a speed from 0.01 to 1000")


def _seconds(text: str) -> float:
    return _number(text, 0, 1e12, "a time in seconds, 0 or more")
