"""The error tree. Every message says what is wrong, where, and what to do."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass


class SimmerError(Exception):
    """Base of all errors this package raises on purpose."""


class PlacementError(SimmerError):
    """A robot or block was put where it cannot stand (inside a wall, outside the maze)."""


class UnknownSensorError(SimmerError, KeyError):
    """A program asked for a sensor by a code that none has; the message lists the codes there are."""

    def __init__(self, code: str, known: Iterable[str], what: str = "sensor") -> None:
        codes = ", ".join(known)
        there = f"there are {codes}" if codes else f"this robot has no {what}"
        super().__init__(f"no {what} has the code {code!r}; {there}")

    def __str__(self) -> str:
        return str(self.args[0])  # KeyError would show it in quotes


@dataclass(frozen=True, slots=True)
class Problem:
    """One mistake in a configuration set.

    `where` names the place (`sensors.csv:3:Poll Character`, `--bot-center`), `what` says what is
    wrong and what is allowed.
    """

    where: str
    what: str

    def __str__(self) -> str:
        return f"{self.where}: {self.what}"


class ConfigurationError(SimmerError):
    """A configuration set with mistakes; `problems` holds all of them."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        super().__init__("\n".join(str(problem) for problem in problems))
        self.problems = tuple(problems)


class PortError(SimmerError):
    """A port the simulator needs is taken or may not be used."""


class RunLogError(SimmerError):
    """A run log that cannot be written, is none, or is of another version; or nothing can be made of it."""
