"""Exit codes, all of them, and the one place where an error becomes a message and a code."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING

from simmer_tui.errors import ClusterError, ConfigurationError, ProgramError, RunLogError, SimmerError
from simmer_tui.sim.command import escape

if TYPE_CHECKING:
    from simmer_tui.cli.options import OneLineParser


class ExitCode(IntEnum):
    """Exit codes of `simmer-tui`. With `--run` the program's own exit code comes first, and 128 with a
    signal's number stands for an end by that signal, as in a shell."""

    DONE = 0
    NO = 1
    """Done, but the answer is no: a mission failed, a reply differs, too few trials succeeded, an
    imported set needs editing, there is no serial port."""
    PROBLEM = 2
    """Nothing was done: a mistake in an option, a set or a log, a port that is taken."""
    LOST = 3
    """The Dask cluster that trials were to run on is not there, or was lost: they can be gone on with."""
    NOT_STARTED = 127
    """The program of `--run` cannot be started."""
    INTERRUPTED = 130
    """Ctrl-C."""


_CODES: dict[type[SimmerError], ExitCode] = {
    ProgramError: ExitCode.NOT_STARTED,
    ClusterError: ExitCode.LOST,
}
"""Errors with an exit code of their own; all others are problems."""


def report(error: SimmerError, program: str = "simmer-tui") -> int:
    """Write an error on standard error, each problem of a configuration on a line of its own.
    Returns the exit code for it. A closed stream is no fault."""
    if isinstance(error, ConfigurationError):
        lines = [str(problem) for problem in error.problems]
    else:
        lines = [f"{program}: {error}"]
    try:
        sys.stderr.writelines(f"{line}\n" for line in lines)
        sys.stderr.flush()
    except (OSError, ValueError):
        pass  # nobody reads it any more; the exit code still tells
    return _CODES.get(type(error), ExitCode.PROBLEM)


class CliCommand:
    """A command of `simmer-tui`: called with the arguments after its name, it returns the exit code.

    Errors that its function raises become messages and exit codes.
    """

    def __init__(
        self, parser: Callable[[], OneLineParser], function: Callable[[argparse.Namespace], int]
    ) -> None:
        self.parser = parser
        """Makes its parser, for itself, completion and the reference pages."""
        self._function = function

    def __call__(self, argv: list[str]) -> int:
        parser = self.parser()
        try:
            return int(self._function(parser.parse_args(argv)))
        except SimmerError as error:
            return report(error, parser.prog)
        except KeyboardInterrupt:
            return ExitCode.INTERRUPTED


def command(
    parser: Callable[[], OneLineParser],
) -> Callable[[Callable[[argparse.Namespace], int]], CliCommand]:
    """Make a command of a function of the options that `parser` reads."""
    return lambda function: CliCommand(parser, function)


@contextmanager
def configuration_of(log: Path) -> Generator[None, None, None]:
    """A configuration that is refused in here came out of a log: raises RunLogError, which says so."""
    try:
        yield
    except ConfigurationError as error:
        refused = f"the configuration in {escape(str(log), 200)} is refused:"
        raise RunLogError("\n".join((refused, *map(str, error.problems)))) from None
