"""The subcommands that work on configuration sets: `init` and `check`."""

from __future__ import annotations

import sys
from pathlib import Path

from simmer_tui.cli.exit_codes import command
from simmer_tui.cli.options import OneLineParser, add_setting_options, overrides_from
from simmer_tui.config.loader import load
from simmer_tui.config.set_summary import summarize
from simmer_tui.config.sets import bundled_folder, bundled_sets, find_set, init_set
from simmer_tui.sim.command import escape


@command("init")
def run_init(argv: list[str]) -> int:
    """`simmer-tui init DIR [--from SET]`: copy a set out for editing. Returns the exit code."""
    parser = OneLineParser(
        prog="simmer-tui init", description="Copy a configuration set into a folder, to be edited there."
    )
    parser.add_argument("directory", metavar="DIR", type=Path, help="where to; made if it does not exist")
    sets = ", ".join(bundled_sets())
    parser.add_argument("--from", dest="source", metavar="SET", help=f"another set: {sets}, or a folder")
    options = parser.parse_args(argv)
    source = bundled_folder() if options.source is None else find_set(options.source)
    written = init_set(options.directory, source)
    shown = escape(str(options.directory), 200)
    sys.stdout.write(f"Wrote {', '.join(path.name for path in written)} to {shown}\n")
    sys.stdout.write(f"Edit them, then: simmer-tui check {shown}\n")
    return 0


@command("check")
def run_check(argv: list[str]) -> int:
    """`simmer-tui check [DIR]`: every mistake of a set, or its summary. Returns the exit code."""
    parser = OneLineParser(
        prog="simmer-tui check",
        usage="simmer-tui check [DIR] [options]",
        description="Check a configuration set and show what it describes.",
    )
    parser.add_argument(
        "directory",
        metavar="DIR",
        nargs="?",
        help="a folder, or the name of a set (default: config, else the set that comes along)",
    )
    add_setting_options(parser)
    options = parser.parse_args(argv)
    configuration = load(find_set(options.directory), overrides_from(options))
    text = summarize(configuration)
    try:
        text.encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        text = summarize(configuration, ascii_only=True)
    sys.stdout.write(text)
    return 0
