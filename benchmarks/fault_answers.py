"""Accepted answers of a report on a run with a fault, and the fault itself.

`fault_kinds.py` has the kinds of faults, in these terms.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

SOLVE, STEP7, STEP6, PLAIN = "solve", "step7", "step6", "plain"
PROGRAMS = (SOLVE, STEP7, STEP6, PLAIN)
DELIVERING = (SOLVE, STEP7, PLAIN)
"""Programs that set the block down: step 6 of the course only takes it."""
LOCALIZING = (SOLVE, STEP7, STEP6)
"""Programs without a known start, which read the compass."""

RANGES = ("u1", "u2", "u3", "u4", "u5", "t1")
DRIVE_NAMES = {"d1": "right", "r1": "rot", "w1": "up", "p1": "grip"}
"""The IDs in drive.csv by code: a drive may be named either way."""

CRASHED, ENDED, NOTHING = "program crashed", "program ended", "nothing sent"
LOST, UNSURE, MISREAD, UNREAD = "lost", "unsure", "sensor misread", "sensor unread"
CLEARANCE, DRIVE_ERROR, HELD_BLOCK = "clearance", "drive error", "held block"
MISSED, OUTSIDE, STUCK, SLOW = "missed grip", "dropped outside", "stuck", "too slow"
NOWHERE, SENSOR, DRIVE = "got nowhere", "sensor wrong", "drive wrong"
NOT_DONE, APART = "command not carried out", "program or link"

SUCCESSORS = {
    NOTHING: ("silence", "fault on the wire"),
    UNSURE: (LOST,),
    MISREAD: (SENSOR,),
    DRIVE_ERROR: (DRIVE,),
    CLEARANCE: ("too close",),
    HELD_BLOCK: ("too close",),
    STUCK: ("no progress",),
    NOWHERE: ("no progress",),
    NOT_DONE: ("commands refused", MISSED),
    APART: ("drove at a known wall", "unknown"),
}
"""Causes in place of those that the answers were written for, by the old name; the others kept their names.
The answers themselves are as they were."""
EXPLAINED = frozenset(
    (
        SENSOR,
        DRIVE,
        MISREAD,
        LOST,
        UNSURE,
        CLEARANCE,
        DRIVE_ERROR,
        HELD_BLOCK,
        MISSED,
        OUTSIDE,
        NOWHERE,
        STUCK,
    )
)
"""Causes for which a sensor or drive can be the reason; they are right if they name it as culprit."""


@dataclass(frozen=True)
class Answer:
    """Requirements on a cause that counts as an answer.

    `kinds` are values of its `kind`, none for any. With `culprits` it must name one of them, and nobody
    else unless `others`; None lets it name anybody. With `findings` a finding must be about one of these
    codes. One of `words` must be in its text or evidence, and `printed` in the program's last lines.
    """

    kinds: frozenset[str]
    culprits: frozenset[str] | None = None
    others: bool = False
    findings: frozenset[str] | None = None
    words: tuple[str, ...] = ()
    printed: str = ""

    def matches(self, cause: Mapping[str, Any], report: Mapping[str, Any]) -> bool:
        """True if a cause of a report matches this answer."""
        if self.kinds and not self._is_kind(cause):
            return False
        named = set(cause["culprits"])
        if self.culprits is not None and not _names(named, self.culprits, others=self.others):
            return False
        if self.findings is not None and not self.findings & {each["of"] for each in report["findings"]}:
            return False
        moments = (each["text"] for each in report.get("moments", ()))
        said = "\n".join((cause["text"], *report["verdict"]["evidence"], *moments)).lower()
        if self.words and not any(word.lower() in said for word in self.words):
            return False
        printed = (line["output"] for line in report["output"] if line["stream"] == "stderr")
        return not self.printed or any(self.printed in line for line in printed)

    def _is_kind(self, cause: Mapping[str, Any]) -> bool:
        kind = cause["kind"]
        if any(kind in SUCCESSORS.get(each, (each,)) for each in self.kinds):
            return True
        # A fault of the wire is right wherever the table of beliefs names its device.
        if APART in self.kinds and self.culprits:
            return True
        return NOT_DONE in self.kinds and "no movement came" in cause["text"]


def says(
    *kinds: str,
    culprits: frozenset[str] | None = None,
    others: bool = False,
    findings: frozenset[str] | None = None,
    words: tuple[str, ...] = (),
    printed: str = "",
) -> Answer:
    """An `Answer` with these fields."""
    return Answer(frozenset(kinds), culprits, others, findings, words, printed)


def _names(named: set[str], allowed: frozenset[str], *, others: bool) -> bool:
    return not named if not allowed else bool(named & allowed) and (others or named <= allowed)


@dataclass(frozen=True)
class Hand:
    """Action of a person in a run, at a simulated time (s) or distance to the block (in)."""

    action: str
    at: float = math.inf
    near: float = 0.0
    turn: float = 0.0  # deg, with the actions "turn" and "keys"
    shift: float = 0.0  # in, with the actions "teleport" and "block"; 0: to another cell
    holding: bool = False
    """True if the moment is the one at which the gripper holds the block."""


@dataclass(frozen=True)
class Expected:
    """Right answers, and answers that are right in part.

    `admitted` are right, too, but were added after a table had been seen: the tables count them separately.
    """

    right: tuple[Answer, ...] = ()
    partly: tuple[Answer, ...] = ()
    admitted: tuple[Answer, ...] = ()


@dataclass(frozen=True)
class Case:
    """A fault in one run, and the expected answers."""

    expected: Expected
    rules: tuple[dict[str, Any], ...] = ()
    """Rules of the proxy, see `fault_proxy.py`."""
    cells: tuple[tuple[str, str, str, str], ...] = ()
    """Cells of the set that differ from the bundled one: file, code, column and value."""
    known: tuple[tuple[str, str, str, str], ...] = ()
    """Cells that differ in the program's own copy of the set."""
    mirrored: bool = False
    """True if the program's map has left and right exchanged."""
    opened: tuple[int, int] | None = None
    """Row and column in maze.csv of a wall that the program's map lacks."""
    edits: tuple[tuple[str, str, str], ...] = ()
    """Changed text of the programs: file, old text, which it has once, and new text."""
    settings: Mapping[str, object] = field(default_factory=dict)
    hand: Hand | None = None
    program: Mapping[str, Any] = field(default_factory=dict)
    """See `fault_program.py`."""
    script: str = ""
    """Arguments of Python that are run instead of the program."""
    environment: Mapping[str, str] = field(default_factory=dict)
    outcomes: frozenset[str] = frozenset(("failed", "crashed"))

    @property
    def as_first_written(self) -> Case:
        """Without the answers that were admitted later."""
        return replace(self, expected=replace(self.expected, admitted=()))


Kind = Callable[[random.Random], Case]


@dataclass(frozen=True)
class Fault:
    """A kind of fault: its programs, and True if `tests/report/faulty.py` has it too."""

    draw: Kind
    programs: tuple[str, ...] = PROGRAMS
    known: bool = False


def devices(*codes: str) -> frozenset[str]:
    """Codes of sensors and drives, and the names that drives also go by."""
    return frozenset(codes) | {DRIVE_NAMES[code] for code in codes if code in DRIVE_NAMES}
