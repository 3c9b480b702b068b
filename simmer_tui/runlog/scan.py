"""The beginnings of many lines read at once, in NumPy: where each starts, its time, what it is."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from simmer_tui.runlog.entries import (
    LARGEST,
    ActionLine,
    AnswerLine,
    BeliefLine,
    BrokenLine,
    EndLine,
    Known,
    MissionLine,
    MoveLine,
    PlanLine,
    ReadLine,
    StateLine,
    parse_line,
)
from simmer_tui.sim.records import Status

_T = b'{"t":'
_KIND = b',"kind":"'
_ANSWER = b'answer","status":"'
_NUMBER = 25
"""Longest number, characters."""
_REST = len(_KIND) + len(_ANSWER) + 3
_HEAD = len(_T) + _NUMBER + _REST
REFUSALS = (Status.REFUSED, Status.UNKNOWN, Status.BUSY, Status.UNANSWERED)
"""What becomes of commands that do nothing, or that a real robot does not answer."""
_REFUSED = [status.value[:3].encode() for status in REFUSALS]
_NUMERIC = np.zeros(256, dtype=np.bool_)
_NUMERIC[list(b"0123456789.eE+-")] = True


class Mark(IntFlag):
    """What a line is, in ten bits."""

    COMMAND = 1
    """A command taken up: a reading, a movement that begins, or an answer to another command."""
    ACTION = 2
    BELIEF = 4
    OTHER = 8
    """Something that says nothing of where the robot is."""
    BROKEN = 16
    CONTACT = 32
    REFUSED = 64
    RESTART = 128
    MISSION = 256
    STATE = 512


_MARKS = {
    b'read"': Mark.COMMAND,
    b'move"': Mark.COMMAND,
    b'plan"': Mark.COMMAND,
    b'end"': Mark.OTHER,
    b'belief"': Mark.BELIEF,
    b'notice"': Mark.OTHER,
    b'twin"': Mark.OTHER,
    b'mission"': Mark.MISSION,
    b'state"': Mark.STATE,
}
"""Lines that their kind alone tells; a line of any other kind is read whole."""
_CONTACT = re.compile(rb',"contact":\{')
_MOVED = re.compile(rb',"kind":"move",[^\n]*?,"end":([0-9.eE+-]+),"pose"')
"""Quotes within a text are escaped, so no text can pass for a field."""


@dataclass(frozen=True, slots=True)
class Scan:
    """Of n lines: where they begin in the block, their `t` (NaN for broken ones), the time by which
    what they tell is over, their marks."""

    starts: NDArray[np.int64]
    times: NDArray[np.float64]
    ends: NDArray[np.float64]
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
    for text, mark in _MARKS.items():
        marks[_is(kind, 0, text)] = mark
    answer = _is(kind, 0, _ANSWER)
    status = kind[:, len(_ANSWER) :]
    marks[answer] = Mark.COMMAND
    for begun in (b"acc", b"don"):  # its plan stands before it
        marks[answer & _is(status, 0, begun)] = Mark.OTHER
    refused = np.logical_or.reduce([_is(status, 0, name) for name in _REFUSED])
    marks[answer & refused] |= np.uint16(Mark.REFUSED)
    known &= marks != 0

    times = np.full(len(starts), math.nan)
    try:
        times[known] = texts[known].view(f"S{_NUMBER}").ravel().astype(np.float64)
    except ValueError:  # one of them is no number after all
        known[:] = False
    known &= np.abs(times) <= LARGEST  # false of NaN too
    over = times.copy()
    contacts = [found.start() for found in _CONTACT.finditer(block)]
    marks[np.searchsorted(ends, contacts)] |= np.uint16(Mark.CONTACT)
    plans = known & _is(kind, 0, b'plan"')
    marks[plans] &= np.uint16(0xFFFF ^ Mark.CONTACT)  # a contact that is only planned is none
    for found in _MOVED.finditer(block):
        over[int(np.searchsorted(ends, found.start()))] = _finite(found.group(1))
    for index in np.flatnonzero(~known):
        line = parse_line(block[starts[index] : ends[index]], 0)
        times[index], over[index], marks[index] = _time(line), _over(line), _marks(line)
    return Scan(starts, times, np.fmax(times, over), marks)


def _is(rows: NDArray[np.uint8], begin: int, text: bytes) -> NDArray[np.bool_]:
    """In which rows a text stands at a place."""
    wanted = np.frombuffer(text, dtype=np.uint8)
    same: NDArray[np.bool_] = (rows[:, begin : begin + len(text)] == wanted).all(axis=1)
    return same


def _finite(text: bytes) -> float:
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if abs(value) <= LARGEST else math.nan


def _time(line: Known | BrokenLine) -> float:
    return math.nan if isinstance(line, BrokenLine) else line.t


def _over(line: Known | BrokenLine) -> float:
    return line.end if isinstance(line, MoveLine) else _time(line)


def _marks(line: Known | BrokenLine) -> Mark:
    match line:
        case ReadLine() | PlanLine():
            return Mark.COMMAND
        case MoveLine():
            return Mark.COMMAND | (Mark(0) if line.contact is None else Mark.CONTACT)
        case EndLine():
            return Mark.OTHER | (Mark(0) if line.contact is None else Mark.CONTACT)
        case AnswerLine():
            if line.status in (Status.ACCEPTED, Status.DONE):
                return Mark.OTHER
            return Mark.COMMAND | (Mark.REFUSED if line.status in REFUSALS else Mark(0))
        case ActionLine():
            restarts = line.action.restarts and not line.refused
            return Mark.ACTION | (Mark.RESTART if restarts else Mark(0))
        case BeliefLine():
            return Mark.BELIEF
        case MissionLine():
            return Mark.MISSION
        case StateLine():
            return Mark.STATE
        case BrokenLine():
            return Mark.BROKEN
    return Mark.OTHER
