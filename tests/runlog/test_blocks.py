"""Lines that are decoded together: the events of a log in blocks are those that come line by line."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import pytest

from simmer_tui.runlog.log_records import BrokenLine
from simmer_tui.runlog.reader import MAX_LINE, Logged, LoggedReadings, LogReader

Change = Callable[[list[bytes]], list[bytes]]

CHANGES: dict[str, Change] = {
    "none": lambda lines: lines,
    "a broken line": lambda lines: [*lines[:3], lines[3][:40] + b"\n", *lines[4:]],
    "a blank line": lambda lines: [*lines[:3], b"\n", *lines[3:]],
    "line ends of Windows": lambda lines: [line.replace(b"\n", b"\r\n") for line in lines],
    "a last line without its end": lambda lines: [*lines[:-1], lines[-1][:-1]],
    "a last line cut off": lambda lines: [*lines[:-1], lines[-1][:30]],
    # As many records as lines.
    "a record on two lines, two on one": lambda lines: [
        *(lines[2].replace(b",", b",\n", 1), lines[3][:-1] + lines[4]),
        *lines[5:],
    ],
    "a reading of no sensor": lambda lines: [
        *(line.replace(b'"cmd":"u1"', b'"cmd":"d1"') if b'"kind":"read"' in line else line for line in lines)
    ],
    "a line that is too long": lambda lines: [*lines[:3], b"x" * (MAX_LINE + 1) + b"\n", *lines[3:]],
    "a long line that is not": lambda lines: [
        *lines[:3],
        b'{"kind":"cut",' + b" " * (MAX_LINE - 100) + b'"t":0}\n',
        *lines[3:],
    ],
}


@pytest.mark.quick_cases(8)
@pytest.mark.parametrize("change", CHANGES)
def test_blocks_have_the_events_that_come_line_by_line(varied_log: Path, change: str) -> None:
    header, *lines = varied_log.read_bytes().splitlines(keepends=True)
    varied_log.write_bytes(header + b"".join(CHANGES[change](lines)))
    with LogReader(varied_log) as one, LogReader(varied_log) as other:
        expected = [_text(each) for each in one]
        assert [_text(each) for block in other.blocks() for each in _each(block)] == expected
        assert (other.position, other.note) == (one.position, one.note)


def _text(logged: Logged | BrokenLine) -> str:
    # Some parts of a trajectory are shown by their addresses only.
    return re.sub("0x[0-9a-f]+", "", repr(logged))


def _each(block: Iterable[Logged | LoggedReadings | BrokenLine]) -> Iterator[Logged | BrokenLine]:
    for item in block:
        if isinstance(item, LoggedReadings):
            yield from map(Logged, item.lines, item.real_times, item.results)
        else:
            yield item
