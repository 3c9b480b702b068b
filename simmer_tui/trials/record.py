"""The record kept of each run."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from msgspec import Meta, Struct


class Ending(StrEnum):
    """Ending of a run."""

    SUCCESS = "success"
    CONTACTS = "contacts"
    TIME_LIMIT = "time limit"
    EXIT = "program ended"
    SILENCE = "nothing was sent"
    """The program ended well without one command: it has shown nothing."""
    REAL_TIME_LIMIT = "real time limit"
    FAULT = "fault"
    """The simulator itself, or the process that it ran in, failed."""


class TrialResult(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One run: from where, with what end, how long and how far. Also a line of results.jsonl.

    `time` is simulated seconds, `distance` inches, `start` and `end` are the robot's x, y and
    heading, `block` and `drop_zone` are x, y. `reached`, `taken` and `delivered` are when the
    mission's goals were met. `exit_code` is None if the program did not end by itself. `cause` is the
    cause of a failure (`report.causes.Kind`), `why` the same in a sentence; both are empty for a success.
    `real_seconds` and `simulator_seconds` (CPU) depend on the machine, all else on the seed.
    """

    number: Annotated[int, Meta(ge=1)]
    seed: int
    maze: str
    success: bool
    ending: Ending
    reason: str
    exit_code: int | None
    time: float
    distance: float
    commands: int
    contacts: int
    contact_points: tuple[tuple[float, float], ...]
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    block: tuple[float, float]
    drop_zone: tuple[float, float] | None
    reached: float | None
    taken: float | None
    delivered: float | None
    last_output: str
    cause: str = ""
    why: str = ""
    real_seconds: float
    simulator_seconds: float

    @property
    def sent_nothing(self) -> bool:
        """True if no command came; such a run is no success."""
        return not self.commands
