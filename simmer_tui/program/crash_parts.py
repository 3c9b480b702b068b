"""Parts of errors as programs print them: the crash itself, frames and places, and text without colours."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import PurePosixPath, PureWindowsPath

from msgspec import Struct

# Libraries and our own client: code that the user cannot correct.
_FOREIGN = re.compile(
    r"site-packages|dist-packages|<frozen |[/\\]lib[/\\]python3|\\Lib\\|[/\\]simmer_tui[/\\]|node_modules"
    r"|^node:|[/\\]rustc[/\\]"
)
# `simmer-tui examples` writes our client library beside a program, as client.py. A team may have a file of
# that name too; errors of ours are in the name of the exception.
_COPY = re.compile(r"(?:^|[/\\])client\.py$")
_COPY_RAISED = "client."
# Colours and cursor (CSI), titles and links (OSC), character sets; a cut one at the end of a line too.
_ESCAPE = re.compile(r"\x1b(?:\[[0-?]*[ -/]*(?:[@-~]|$)|\][^\x07\x1b]*(?:\x07|\x1b\\|$)|[ -/]*[0-~]|$)")

PrintedFrame = tuple[str, str]
"""File and line of a call, as they are printed."""


class Crash(Struct, frozen=True):
    """An error, and the last line of the program's own code before it (`robot.py:12`, or empty)."""

    error: str
    place: str = ""


def without_escapes(text: str) -> str:
    """A line as a terminal shows it, without the sequences that colour it."""
    return _ESCAPE.sub("", text) if "\x1b" in text else text


def is_foreign(file: str) -> bool:
    """True for a file of a library, or of our client."""
    return _FOREIGN.search(file) is not None


def file_name(path: str) -> str:
    return (PureWindowsPath if "\\" in path else PurePosixPath)(path).name or path


def frames_of(pattern: re.Pattern[str], lines: Iterable[str]) -> list[PrintedFrame]:
    """The frames, file and line, in the lines that a pattern of these two groups matches."""
    return [(found[1], found[2]) for found in map(pattern.match, lines) if found]


def places_of(pattern: re.Pattern[str], lines: Sequence[str]) -> list[int]:
    """The places of the lines that a pattern matches."""
    return [place for place, line in enumerate(lines) if pattern.match(line)]


def from_the_end(lines: Sequence[str]) -> Iterable[tuple[int, str]]:
    """The lines with their places, the last one first."""
    return reversed(list(enumerate(lines)))


def first_said(lines: Iterable[str]) -> str:
    """The first line that is not blank; empty if there is none."""
    return next((line.strip() for line in lines if line.strip()), "")


def is_own(file: str, error: str) -> bool:
    """True if a file in the traceback of an error is the program's own."""
    return not (is_foreign(file) or (error.startswith(_COPY_RAISED) and _COPY.search(file)))


def last_own(frames: Sequence[PrintedFrame], error: str = "") -> str:
    """The last of the frames, file and line, in the program's own code."""
    own = [each for each in frames if is_own(each[0], error)] or frames
    return f"{file_name(own[-1][0])}:{own[-1][1]}" if own else ""
