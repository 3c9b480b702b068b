"""Causes of failed runs: their kinds, and the counterfactuals that support or refute each.

A cause that its own counterfactual contradicts is never named: `contradicted` decides, here and in tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from simmer_tui.report.counterfactuals import Change, Counterfactual
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.table import Timed


class Kind(StrEnum):
    """Kinds of causes, each with the `advice`: the thing to look at first."""

    advice: str

    def __new__(cls, name: str, advice: str) -> Kind:
        kind = str.__new__(cls, name)
        kind._value_ = name
        kind.advice = advice
        return kind

    LOST = "lost", "how the program tracks the robot's pose"
    UNSURE = "unsure", "localization: find out where the robot is before driving on"
    CLEARANCE = "clearance", "the distance that its path keeps from the walls"
    DRIVE_ERROR = (
        "drive error",
        "the length of movements without a reading, and a correction for the drives' bias",
    )
    DRIVE_WRONG = "drive wrong", "the drive that does not move as the program expects"
    HELD_BLOCK = "held block", "the room that the held block needs, above all in turns"
    MISSED_GRIP = "missed grip", "the robot's place when the gripper closes"
    DROPPED_OUTSIDE = "dropped outside", "the robot's place when the gripper opens"
    MISREAD = "sensor misread", "decisions that depend on a single reading"
    SENSOR_WRONG = "sensor wrong", "the sensor that does not read as the program expects"
    UNREAD = "sensor unread", "reading the sensors that look ahead before each movement"
    STUCK = "stuck", "what the program does after a contact"
    GOT_NOWHERE = "got nowhere", "what the program does when it makes no progress"
    TOO_SLOW = "too slow", "what takes most of its time"
    NOT_CARRIED_OUT = "command not carried out", "the command that was missing or refused"
    CRASHED = "program crashed", "the error that ends the program"
    ENDED = "program ended", "the condition on which the program gives up"
    NOTHING_SENT = "nothing sent", "the program's connection to the simulator"
    MOVED = "moved by a person", "how the program notices that something was moved"
    UNDECIDED = "program or link", "what the program sent and received: print it and compare it with the log"


@dataclass(frozen=True, slots=True)
class CounterfactualTest:
    """Changes of the deciding movement that support or refute a kind of cause. One of `supporting` must have
    saved it, if any of them could be decided; none of `refuting` may have."""

    supporting: frozenset[Change] = frozenset()
    refuting: frozenset[Change] = frozenset()


_WITHOUT_ERRORS = frozenset((Change.NO_NOISE, Change.NO_BIAS, Change.EXACT, Change.UNSEEN, Change.LAST))
_BELIEVED, _NO_BLOCK = frozenset((Change.BELIEVED,)), frozenset((Change.NO_BLOCK,))
COUNTERFACTUAL_TESTS = {
    # A lost program would have passed if its belief had been right.
    Kind.LOST: CounterfactualTest(_BELIEVED),
    Kind.UNSURE: CounterfactualTest(_BELIEVED),
    # A reading corrects the belief. A program that knew its place would have driven the same with a reading.
    Kind.UNREAD: CounterfactualTest(_BELIEVED),
    Kind.DRIVE_ERROR: CounterfactualTest(_WITHOUT_ERRORS),
    Kind.HELD_BLOCK: CounterfactualTest(_NO_BLOCK),
    # Too close means that the program knew its place and would have passed with more room.
    Kind.CLEARANCE: CounterfactualTest(frozenset((Change.ASIDE, Change.FURTHER_OFF)), _BELIEVED),
    # Any other change that would have saved it points to another cause.
    Kind.UNDECIDED: CounterfactualTest(refuting=_BELIEVED | _NO_BLOCK | {Change.EXACT}),
}
"""Counterfactuals that support or refute each kind. Kinds that are not here need the program's own decisions,
which no log has."""


def contradicted(kind: Kind, tried: Sequence[Counterfactual]) -> bool:
    """True if counterfactuals contradict a kind of cause."""
    test = COUNTERFACTUAL_TESTS.get(kind, CounterfactualTest())
    decided = [each.saved for each in tried if each.change in test.supporting and each.saved is not None]
    if decided and not any(decided):
        return True
    return any(each.saved for each in tried if each.change in test.refuting)


class Sureness(StrEnum):
    """Sureness of a cause: one that depends on the program's decisions is likely at most, as no log has
    them."""

    CERTAIN = "certain"
    LIKELY = "likely"


@dataclass(frozen=True, slots=True)
class Cause:
    """Cause of a failed run: `text` is one sentence, `evidence` has the sentences that support it. `elapsed`
    (seconds) and `line` (of the log; 0 if there is none) are its moment, `place` its place (inches).
    `culprits` are the codes of the sensors and drives to blame."""

    kind: Kind
    text: str
    evidence: tuple[str, ...]
    elapsed: float
    line: int
    place: tuple[float, float]
    tried: tuple[Counterfactual, ...] = ()
    sure: Sureness = Sureness.CERTAIN
    culprits: tuple[str, ...] = ()


class LogMoment(Timed, Protocol):
    """Something with a time, elapsed seconds, and a line of the log."""

    @property
    def line(self) -> int: ...


def cause_of(
    attempt: Attempt,
    kind: Kind,
    text: str,
    *evidence: str,
    at: LogMoment | None = None,
    since: float | None = None,
    place: tuple[float, float] | None = None,
    tried: tuple[Counterfactual, ...] = (),
    sure: Sureness = Sureness.CERTAIN,
    culprits: tuple[str, ...] = (),
) -> Cause:
    """A cause at a row of the history, or elapsed seconds; by default, and elsewhere, at the attempt's end.

    Args:
        evidence: Sentences that support it; empty ones are left out.
    """
    moment = attempt if at is None else at
    return Cause(
        kind,
        text,
        tuple(filter(None, evidence)),
        moment.elapsed if since is None else since,
        moment.line,
        place or (attempt.pose.x, attempt.pose.y),
        tried,
        sure,
        culprits,
    )


def undecided_text(changed: str) -> str:
    """The two explanations that a log cannot distinguish; `changed` is the possible change on the link."""
    return f"Either the program has an error, or {changed} on its way: the log cannot tell which."
