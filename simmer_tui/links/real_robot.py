"""A real robot as a backend, in any language."""

from __future__ import annotations

import asyncio
from abc import abstractmethod
from dataclasses import dataclass

from simmer_tui.config.settings import SerialSettings
from simmer_tui.links.backend import Backend
from simmer_tui.links.serial_link import RobotLink
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import ActionDone, ActionName, EventHandler, Notice, NoticeKind
from simmer_tui.sim.command import Command
from simmer_tui.sim.records import CommandResult


@dataclass(eq=False)
class RealRobot(EventHandler[None], Backend):
    """A real robot as a backend: its port, and the parts common to all languages.

    Args:
        engine: The twin.
        link: The connection to the robot.
        settings: Those of its port; they may be replaced at any time.
    """

    engine: Engine
    link: RobotLink
    settings: SerialSettings

    def __post_init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._open = False

    def _begin_listening(self) -> None:
        """Open the port, and watch the twin."""
        self.engine.watch(self.handle)
        self.link.start(self)

    def _end_listening(self) -> None:
        """Release the port."""
        self.engine.unwatch(self.handle)
        self._open = False
        self.link.close()

    @property
    def port(self) -> str:
        """The robot's port, as the user calls it."""
        return self.link.name

    @property
    def connected(self) -> bool:
        """True if the port is open."""
        return self._open

    @property
    def no_answer(self) -> str:
        """Reason for a command that got no answer in time."""
        return f"the robot did not answer within {self.settings.timeout:g} s"

    @property
    def unsent_stop(self) -> str:
        """Fault of a stop while the port is closed."""
        return f"the stop cannot be sent: {self.port} is closed"

    @abstractmethod
    def stop(self) -> None:
        """The emergency stop of a person."""

    @abstractmethod
    def received(self, data: bytes) -> None:
        """Bytes have come from the robot."""

    def opened(self) -> None:
        """The port is open."""
        self._open = True
        self._tell(NoticeKind.ROBOT, f"robot: {self.port} is open")

    def lost(self, reason: str) -> None:
        """The port has closed, or cannot be opened."""
        self._open = False
        self._tell(NoticeKind.FAULT, f"robot: {reason}; trying again")

    def refuse(self, command: Command) -> CommandResult:
        return self.engine.refuse(command)

    def on_action(self, event: ActionDone) -> None:
        """Pass a person's stop on to the real robot."""
        if event.action.name is ActionName.STOP:
            self.stop()

    def _tell(self, kind: NoticeKind, text: str) -> None:
        self.engine.tell(Notice(kind, text))
