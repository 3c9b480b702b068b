"""The beginnings of many lines read at once, in NumPy: where each starts, its time, what it is."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from simmer_tui.runlog.entries import (
    REFUSALS,
    ActionEntry,
    BeliefEntry,
    BrokenEntry,
    CommandEntry,
    Entry,
    NoticeEntry,
    TwinEntry,
    parse_entry,
)
from simmer_tui.runlog.numbers import number

_T = b'{"t":'
_KIND = b',"kind":"'
_COMMAND = b'command","verdict":"'
_NUMBER = 25
"""Longest number, characters."""
_REST = len(_KIND) + len(_COMMAND) + 3
_HEAD = len(_T) + _NUMBER + _REST

_REFUSALS = [status.value[:3].encode() for status in REFUSALS]
_NUMERIC = np.zeros(256, dtype=np.bool_)
_NUMERIC[list(b"0123456789.eE+-")] = True


class Mark(IntFlag):
    """What a line is, in nine bits."""

    COMMAND = 1
    ACTION = 2
    BELIEF = 4
    NOTICE = 8
    """A notice, or anything else that says nothing of where the robot is."""
    BROKEN = 16
    CONTACT = 32
    REFUSED = 64
    RESTART = 128
    GRIP = 256


_ANYWHERE = {Mark.CONTACT: re.compile(rb',"contact":\['), Mark.GRIP: re.compile(rb',"grip":\{')}
"""Fields further on in a line. Quotes within a text are escaped, so no text can pass for one."""


@dataclass(frozen=True, slots=True)
class Scan:
    """Of n lines: where they begin in the block, their `t` (NaN for broken ones), their marks."""

    starts: NDArray[np.int64]
    times: NDArray[np.float64]
    marks: NDArray[np.uint16]


def scan_lines(block: bytes) -> Scan:
    """Look over a block of whole lines, the last ended by a newline.

    Lines as `RunLog` writes them are told by their first characters; any other (of a person's
    action, or written anew by another program) is parsed whole.
    """
    data = np.frombuffer(block, dtype=np.uint8)
    ends = np.flatnonzero(data == ord("\n"))
    starts = np.concatenate(([0], ends[:-1] + 1))
    padded = np.concatenate((data, np.zeros(_HEAD, dtype=np.uint8)))
    heads = np.lib.stride_tricks.sliding_window_view(padded, _HEAD)[starts]
    known = _is(heads, 0, _T) & (data[ends - 1] == ord("}"))

    digits = heads[:, len(_T) : len(_T) + _NUMBER]
    lengths = _NUMERIC[digits].argmin(axis=1)
    texts = np.where(np.arange(_NUMBER) < lengths[:, None], digits, 0).astype(np.uint8)
    rest = np.take_along_axis(heads, len(_T) + lengths[:, None] + np.arange(_REST), axis=1)
    known &= (lengths > 0) & _is(rest, 0, _KIND)

    marks = np.zeros(len(starts), dtype=np.uint16)
    kind = rest[:, len(_KIND) :]
    command = _is(kind, 0, _COMMAND)
    status = kind[:, len(_COMMAND) :]
    marks[command] = Mark.COMMAND
    refused = np.logical_or.reduce([_is(status, 0, name) for name in _REFUSALS])
    marks[command & refused] |= np.uint16(Mark.REFUSED)
    marks[_is(kind, 0, b"belief")] = Mark.BELIEF
    marks[_is(kind, 0, b"notice") | _is(kind, 0, b"twin")] = Mark.NOTICE
    known &= marks != 0

    times = np.full(len(starts), math.nan)
    try:
        times[known] = texts[known].view(f"S{_NUMBER}").ravel().astype(np.float64)
    except ValueError:  # one of them is no number after all
        known[:] = False
    for mark, pattern in _ANYWHERE.items():
        places = [found.start() for found in pattern.finditer(block)]
        marks[np.searchsorted(ends, places)] |= np.uint16(mark)
    for index in np.flatnonzero(~known):
        entry = parse_entry(block[starts[index] : ends[index]], 0)
        times[index], marks[index] = _time(entry), _marks(entry)
    return Scan(starts, times, marks)


def _is(rows: NDArray[np.uint8], begin: int, text: bytes) -> NDArray[np.bool_]:
    """In which rows a text stands at a place."""
    wanted = np.frombuffer(text, dtype=np.uint8)
    same: NDArray[np.bool_] = (rows[:, begin : begin + len(text)] == wanted).all(axis=1)
    return same


def _time(entry: Entry) -> float:
    return math.nan if isinstance(entry, BrokenEntry) else number(entry.t)


def _marks(entry: Entry) -> Mark:
    match entry:
        case CommandEntry():
            marks = Mark.COMMAND
            marks |= Mark.CONTACT if entry.contact is not None else Mark(0)
            marks |= Mark.GRIP if entry.grip is not None else Mark(0)
            return marks | (Mark.REFUSED if entry.refused else Mark(0))
        case ActionEntry():
            return Mark.ACTION | (Mark.RESTART if entry.restarts else Mark(0))
        case BeliefEntry():
            return Mark.BELIEF
        case NoticeEntry() | TwinEntry():
            return Mark.NOTICE
        case BrokenEntry():
            return Mark.BROKEN
