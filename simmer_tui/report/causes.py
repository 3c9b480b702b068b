"""Causes of failed runs: their kinds, and a cause as reports show it. `cause_order.py` decides on one."""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct

from simmer_tui.report.counterfactuals import Counterfactual


class Kind(StrEnum):
    """Kinds of causes, in the order in which they are looked for."""

    WIRE = "fault on the wire"
    REFUSED = "commands refused"
    CRASHED = "program crashed"
    MOVED = "moved by a person"
    SENSOR_WRONG = "sensor wrong"
    DRIVE_WRONG = "drive wrong"
    LOST = "lost"
    SILENCE = "silence"
    KNOWN_WALL = "drove at a known wall"
    UNREAD = "sensor unread"
    MISSED_GRIP = "missed grip"
    DROPPED_OUTSIDE = "dropped outside"
    TOO_CLOSE = "too close"
    GOT_NOWHERE = "no progress"
    TOO_SLOW = "too slow"
    ENDED = "program ended"
    UNKNOWN = "unknown"


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
