"""Causes of failed runs: their kinds, and a cause as reports show it. `cause_order.py` decides on one."""

from __future__ import annotations

from enum import StrEnum
from typing import Self

from msgspec import Struct

from simmer_tui.report.counterfactuals import Counterfactual


class Kind(StrEnum):
    """Kinds of causes, in the order in which they are looked for."""

    color: str
    """Its colour on the map of failed runs."""

    def __new__(cls, value: str, color: str = "") -> Self:
        """A member with its row of the table below."""
        kind = str.__new__(cls, value)
        kind._value_, kind.color = value, color
        return kind

    WIRE = "fault on the wire", "#ffffff"
    REFUSED = "commands refused", "#12507f"
    CRASHED = "program crashed", "#17becf"
    MOVED = "moved by a person", "#5a3e1b"
    SENSOR_WRONG = "sensor wrong", "#c2187a"
    DRIVE_WRONG = "drive wrong", "#b36b00"
    LOST = "lost", "#8a2be2"
    SILENCE = "silence", "#e377c2"
    KNOWN_WALL = "drove at a known wall", "#8b4513"
    UNREAD = "sensor unread", "#ff6f61"
    MISSED_GRIP = "missed grip", "#1f69c8"
    DROPPED_OUTSIDE = "dropped outside", "#0a968c"
    TOO_CLOSE = "too close", "#d00000"
    GOT_NOWHERE = "no progress", "#a8a800"
    TOO_SLOW = "too slow", "#2f4f4f"
    ENDED = "program ended", "#aec7e8"
    UNKNOWN = "unknown", "#7f7f7f"


class MomentKind(StrEnum):
    """Kinds of moments of a run."""

    BEGAN = "began"
    LOCALIZED = "localized"
    FAULT = "fault"
    PERSON = "person"
    DEVICE = "device"
    BOARD = "board"
    LOST = "lost"
    SIGHT = "last sight"
    COMMAND = "deciding command"
    GOAL = "goal"
    END = "end"
    PROGRAM = "program's end"


class Sureness(StrEnum):
    """Sureness of a cause: one that depends on the program's decisions is likely at most, as nobody sees
    them."""

    CERTAIN = "certain"
    LIKELY = "likely"


class Cause(Struct, frozen=True):
    """Cause of a failed run: `text` is a fact in one or two sentences, `evidence` has the sentences that
    support it. `elapsed` (seconds) and `line` (of the log; 0 if there is none) are its moment, of the kind
    `moment`, `place` its place (inches). `culprits` are the codes of the sensors and drives to blame,
    `advice` is one line to follow, empty for none."""

    kind: Kind
    text: str
    evidence: tuple[str, ...]
    elapsed: float
    line: int
    place: tuple[float, float]
    moment: MomentKind
    tried: tuple[Counterfactual, ...] = ()
    sure: Sureness = Sureness.CERTAIN
    culprits: tuple[str, ...] = ()
    advice: str = ""
