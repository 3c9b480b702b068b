"""The error tree. Every message says what is wrong, where, and what to do.

    SimmerError                 what this package raises on purpose
    ├── ConfigurationError      a set, or options over it, with mistakes: all of them in `problems`
    ├── PlacementError          a robot or block where it cannot stand
    ├── PortError               a port that is taken or may not be used
    ├── ProgramError            the program of `--run` cannot be started
    ├── DeviceError             a team's own device failed: in which line of its file, and how
    ├── BoardError              a board that runs a sketch has died or hangs, with the line
    ├── UnknownSensorError      a code that no sensor has (a KeyError too)
    ├── RunLogError             a log that cannot be written, read or understood
    ├── ExportError             a picture of a run that cannot be made
    ├── TrialsError             trials that cannot be run, continued or read
    │   └── ClusterError        the Dask cluster for the runs cannot be reached, or was lost
    ├── CalibrationError        logs that a robot cannot be learned from
    ├── AtlasError              expected readings that cannot be computed or written as asked
    ├── GradeError              a course that cannot be graded, or not sandboxed as asked
    ├── InterruptedTrialError   a run that was interrupted, without a result
    ├── ConsoleCommandError     a line typed in the console that is no command (a ValueError too)
    ├── ExpressionError         a value in a dialect's expression does not fit it (a ValueError too)
    └── NotUnderstoodError      an expression of a foreign file is beyond its reader
        └── RaisedError         Python itself would raise an exception there

Three of them never leave their package (the last two, and the interrupted trial). The client library stands
alone and has a tree of its own.
"""

from __future__ import annotations

import errno
from collections.abc import Iterable, Sequence

from msgspec import Struct


def reason_of(error: BaseException) -> str:
    """The reason of an error, for a message that names the file itself: the system's words for it alone.

    They are without error number and path: "Permission denied".
    """
    if lacks_temporary_folder(error):
        return "there is no folder for temporary files: set TMPDIR to one that can be written"
    return str(getattr(error, "strerror", None) or error)


def lacks_temporary_folder(error: BaseException) -> bool:
    """True if `tempfile` found no folder that can be written, as in a container with read-only files."""
    # It has no error of its own, only this text.
    return isinstance(error, FileNotFoundError) and "usable temporary directory" in str(error.strerror)


def is_disk_full(error: OSError) -> bool:
    """True if a disk or a quota is full, or a file has the largest size that is allowed."""
    return error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def _escaped(character: str) -> str:
    """A character as its escape sequence. A byte that was no UTF-8, a surrogate in Python's texts, is shown
    as that byte."""
    if "\udc80" <= character <= "\udcff":
        return f"\\x{ord(character) - 0xDC00:02x}"
    return character.encode("unicode_escape").decode()


def printable(text: str) -> str:
    """The whole text with control characters and direction marks escaped, which could control a terminal or
    break a page. Other scripts stay. Only what writes to a terminal, a page or a picture calls it."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else _escaped(c) for c in text)


class SimmerError(Exception):
    """Base of all errors that this package raises on purpose. Its text is safe on a terminal."""

    def __str__(self) -> str:
        return printable(super().__str__())


class PlacementError(SimmerError):
    """A robot or block was put where it cannot stand (inside a wall, outside the maze)."""


class DeviceError(SimmerError):
    """A team's own device raised an error, or returned no valid reading; the message has file and line."""


class BoardError(SimmerError):
    """A board that runs a sketch has died or hangs; the text has the line of the sketch."""


class UnknownSensorError(SimmerError, KeyError):
    """A program asked for a sensor by a code that none has; the message lists the codes there are."""

    def __init__(self, code: str, known: Iterable[str], what: str = "sensor") -> None:
        codes = ", ".join(known)
        there = f"there are {codes}" if codes else f"this robot has no {what}"
        super().__init__(f"no {what} has the code {code!r}; {there}")

    def __str__(self) -> str:
        return printable(self.args[0])  # KeyError would show it in quotes


class ExpressionError(SimmerError, ValueError):
    """An expression of a dialect that cannot be evaluated: a text for a number, a list too short."""


class Problem(Struct, frozen=True):
    """One mistake in a configuration set.

    `where` names the place (`sensors.csv:3:Poll Character`, `--bot-center`), `what` says what is
    wrong and what is allowed.
    """

    where: str
    what: str

    def __str__(self) -> str:
        return printable(f"{self.where}: {self.what}")


# Judged: a screenful. A file of another kind by mistake has a problem in each of its lines.
MOST_SHOWN = 20
"""Problems of a set that a message lists."""


class ConfigurationError(SimmerError):
    """A configuration set with mistakes; `problems` holds all of them."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__(self.problems)

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def lines(self) -> list[str]:
        """A line a problem: the first ones, and how many more there are."""
        shown = [str(problem) for problem in self.problems[:MOST_SHOWN]]
        more = len(self.problems) - len(shown)
        return [*shown, f"and {more} more"] if more > 0 else shown


class PortError(SimmerError):
    """A port the simulator needs is taken or may not be used."""


class RunLogError(SimmerError):
    """A file that cannot be written or read as a run log: no log, another version, or damaged."""


class ExportError(SimmerError):
    """A picture of a run cannot be made as asked for, or not without Pillow."""


class ProgramError(SimmerError):
    """The program given to `--run` could not be started."""


class TrialsError(SimmerError):
    """Trials that cannot be run, continued or read."""


class ClusterError(TrialsError):
    """The cluster for the runs cannot be reached, or was lost; finished runs are kept."""


class CalibrationError(SimmerError):
    """Logs that a robot's parameters cannot be learned from; the message says why."""


class AtlasError(SimmerError):
    """Expected readings cannot be computed or written as asked: a grid that does not fit, a wrong sensor."""


class GradeError(SimmerError):
    """A course that cannot be graded, or whose programs cannot be sandboxed as asked."""


class InterruptedTrialError(SimmerError):
    """A run was interrupted and has no result."""


class ConsoleCommandError(SimmerError, ValueError):
    """A line typed in the console that is no command."""


class NotUnderstoodError(SimmerError):
    """An expression of a foreign file is beyond its reader; the message says why."""


class RaisedError(NotUnderstoodError):
    """Python itself would raise an exception here."""
