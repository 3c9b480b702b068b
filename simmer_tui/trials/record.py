"""The record kept of each run."""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any


class Ending(StrEnum):
    """What ended a run."""

    SUCCESS = "success"
    CONTACTS = "contacts"
    TIME_LIMIT = "time limit"
    EXIT = "program ended"
    SILENCE = "nothing was sent"
    """The program ended well without one command: it has shown nothing."""
    REAL_TIME_LIMIT = "real time limit"
    FAULT = "fault"
    """The simulator itself, or the process that it ran in, failed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialResult:
    """One run: from where, with what end, how long and how far.

    `time` is simulated seconds, `distance` inches, `start` and `end` are the robot's x, y and
    heading, `block` and `drop_zone` are x, y. `reached`, `taken` and `delivered` say when the
    mission's goals were met. `exit_code` is None if the program did not end by itself. `cause` is what a
    failure is laid to (`report.causes.Kind`), `why` that in a sentence; both are empty for a success.
    `real_seconds` and `simulator_seconds` (CPU) depend on the machine, all else on the seed.
    """

    number: int
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
        """Whether no command came; such a run is no success."""
        return not self.commands

    def line(self) -> str:
        """The result as a line of JSON."""
        return json.dumps(dataclasses.asdict(self), separators=(",", ":"), allow_nan=False)


def parse_result(line: str) -> TrialResult:
    """The result in a line. Raises ValueError that says what is wrong with it."""
    fields = json.loads(line)
    if not isinstance(fields, dict):
        raise ValueError("is not the record of a run")
    names = {field.name for field in dataclasses.fields(TrialResult)}
    for name in ("cause", "why"):  # of a version that did not ask why
        fields.setdefault(name, "")
    if fields.keys() != names:
        different = ", ".join(sorted(fields.keys() ^ names))
        raise ValueError(f"is not the record of a run of this version: {different}")
    for name in ("number", "seed", "commands", "contacts"):
        if not isinstance(fields[name], int):
            raise ValueError(f"{name} must be a whole number")
    for name in ("maze", "reason", "last_output", "cause", "why"):
        if not isinstance(fields[name], str):
            raise ValueError(f"{name} must be text")
    for name in ("time", "distance", "real_seconds", "simulator_seconds"):
        fields[name] = _number(fields[name], name)
    for name in ("reached", "taken", "delivered"):
        fields[name] = None if fields[name] is None else _number(fields[name], name)
    for name, count in (("start", 3), ("end", 3), ("block", 2)):
        fields[name] = _numbers(fields[name], name, count)
    if fields["drop_zone"] is not None:
        fields["drop_zone"] = _numbers(fields["drop_zone"], "drop_zone", 2)
    if not isinstance(fields["contact_points"], list):
        raise ValueError("contact_points must be places")
    points = tuple(_numbers(point, "contact_points", 2) for point in fields["contact_points"])
    return TrialResult(
        **fields
        | {
            "contact_points": points,
            "ending": Ending(fields["ending"]),
            "success": fields["success"] is True,
        }
    )


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{name} must be a number")
    return float(value)


def _numbers(value: Any, name: str, count: int) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) != count:
        raise ValueError(f"{name} must be {count} numbers")
    return tuple(_number(each, name) for each in value)
