"""The ways by which a program opens the robot's serial port, and what they ask of the robot."""

from __future__ import annotations

from typing import Protocol

from simmer_tui.engine import Engine
from simmer_tui.links.peer import ReadBudget


class SerialDoor(Protocol):
    """A program with an open serial port, by the hook in its pyserial or by a pseudo-terminal."""

    peer: str
    port: str
    """The name of the port that it has opened."""
    by_clock: bool
    """True if the program lives by the program's clock."""

    def answer(self, refused: str) -> None:
        """The port is open; or it is not, for this reason."""

    def deliver(self, begin: float, byte: float, data: bytes) -> None:
        """Pass on bytes of the robot: they begin to arrive at `begin`, by the loop's clock, and each takes
        `byte` seconds."""


class SerialRobot(Protocol):
    """The robot's side of the port. One program at a time has it open."""

    engine: Engine
    budget: ReadBudget

    def reached(self) -> None:
        """A program has begun that will find the port."""

    def opened(self, door: SerialDoor, name: str, baud: float | None) -> None:
        """A program opens a port, at a baud rate if that is known; it gets its `answer`."""

    def written(self, door: SerialDoor, data: bytes) -> None:
        """The program has written bytes."""

    def set_baud(self, door: SerialDoor, baud: float) -> None:
        """The program has set another baud rate."""

    def waits(self, door: SerialDoor, place: str) -> None:
        """A read of the program has waited for long, at this place."""

    def closed(self, door: SerialDoor, unread: int) -> None:
        """The program has closed the port, or has gone, and has left so many bytes unread."""
