"""The options of the commands that read a log, and the log that they name."""

from __future__ import annotations

import argparse
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from simmer_tui import platform_has
from simmer_tui.cli.command_line import OptionGroup, add_flag, add_trust_option, say
from simmer_tui.errors import ConfigurationError, RunLogError
from simmer_tui.runlog.reader import MOST_PACKED, MOST_UNPACKED, READS_LARGE
from simmer_tui.runlog.saved_runs import last_run


def add_log_argument(parser: argparse.ArgumentParser) -> None:
    """The argument `file`, which may be left out."""
    parser.add_argument(
        "file",
        metavar="FILE",
        type=Path,
        nargs="?",
        help="a log written with --log; without it the app's last run, which is always saved",
    )
    add_large_option(parser)


def add_large_option(parser: argparse.ArgumentParser) -> None:
    """The option `--large`."""
    most = f"{MOST_PACKED} times its size and {MOST_UNPACKED / 1e9:g} GB"
    add_flag(parser, "--large", f"read a compressed log although it unpacks to more than {most}")


def allow_large(options: argparse.Namespace) -> None:
    """Allow compressed logs of any size to be read, if `--large` is given."""
    if options.large:
        READS_LARGE.set(True)


def log_of(options: argparse.Namespace) -> Path:
    """The named file, or the last run, whose name is then printed on standard error. Raises RunLogError if
    there is none."""
    allow_large(options)
    if options.file is not None:
        named: Path = options.file
        return named
    if notice := platform_has.home_notice():
        say(notice)
    path = last_run()
    # On standard error: scripts read the answer on standard output.
    say(f"the last run: {path}")
    return path


def add_device_options(parser: OptionGroup) -> None:
    """The options of commands that rerun a log, for sets with devices of their own."""
    parser.add_argument(
        "--config",
        metavar="DIR",
        type=Path,
        help="the folder with the devices/*.py of the log's set (default: where the run had it)",
    )
    add_trust_option(parser)


@contextmanager
def configuration_of(log: Path) -> Generator[None, None, None]:
    """Inside the `with` block a refused configuration is one from a log: raises RunLogError, which says
    so."""
    try:
        yield
    except ConfigurationError as error:
        mistakes = "; ".join(error.lines())
        raise RunLogError(f"the configuration in {log} is refused: {mistakes}") from None
