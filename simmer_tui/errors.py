"""The error tree. Every message says what is wrong, where, and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


class SimmerError(Exception):
    """Base of all errors this package raises on purpose."""


class PlacementError(SimmerError):
    """A robot or block was put where it cannot stand (inside a wall, outside the maze)."""


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
