"""Causes of failed runs: their kinds, the fact that decided, and a cause as reports show it."""

from __future__ import annotations

from enum import StrEnum
from typing import Self

from msgspec import Struct

from simmer_tui.report.counterfactuals import Counterfactual
from simmer_tui.report.moments import Moment


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


LIKELY, CERTAIN = "likely", "certain"
"""Sureness of a cause. One that names a device is likely at most: the program may know the device's
numbers."""


class Fact(Struct, frozen=True):
    """The fact that decided a run: the moment that is marked, `text` in sentences, and `then`, the sentences
    on what came of it, or on the end if that decided. Wrong devices and beliefs are told between them if
    `has_behind`. `culprits` are the codes of the devices that it is about. `advice` replaces that of its
    rule."""

    marked: Moment
    text: str = ""
    then: str = ""
    has_behind: bool = False
    culprits: tuple[str, ...] = ()
    advice: str | None = None


class Cause(Struct, frozen=True):
    """Cause of a failed run: `text` is a fact in a few sentences, `evidence` has the sentences that support
    it. `moment` is the one that is marked. `culprits` are the codes of the sensors and drives to blame,
    `advice` is one line to follow, empty for none. `tried` are the changes with which a contact was planned
    again."""

    kind: Kind
    text: str
    evidence: tuple[str, ...]
    moment: Moment
    tried: tuple[Counterfactual, ...] = ()
    culprits: tuple[str, ...] = ()
    advice: str = ""

    @property
    def sure(self) -> str:
        """Its sureness: `certain` or `likely`."""
        is_likely = self.kind in (Kind.SENSOR_WRONG, Kind.DRIVE_WRONG, Kind.UNKNOWN)
        return LIKELY if is_likely else CERTAIN

    @property
    def elapsed(self) -> float:
        """Time of its moment, elapsed seconds."""
        return self.moment.elapsed

    @property
    def line(self) -> int:
        """Line of its moment in the log; 0 without one."""
        return self.moment.line
