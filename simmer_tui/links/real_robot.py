"""A real robot as a backend, in any language."""

from __future__ import annotations

import asyncio
from abc import abstractmethod
from dataclasses import dataclass

from simmer_tui.config.settings import AUTO_BOOT, BOOT_TIME, SerialSettings
from simmer_tui.links.backend import Backend
from simmer_tui.links.serial_link import RobotLink
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.timers import LoopTimer
from simmer_tui.run.events import ActionDone, ActionName, EventHandler, Notice, NoticeKind
from simmer_tui.sim.command import cut
from simmer_tui.sim.records import CommandResult, LidarScan, Reading, Status

# Judged: the pieces of a greeting come closer together. After its messages the boot loader of an ESP32 takes
# less to begin the sketch.
_GREETED = 0.25
"""Seconds of silence after its first words until a board that starts is taken to be ready."""
# Noise on a line that is being opened is a byte or two, and seldom printable.
_LEAST_WORDS = 2
"""Printable characters that are words of a board."""
# Several lines of a greeting: more is cut when it is shown.
MOST_SAID = 1024
"""Most bytes kept of a board that starts."""


# Field by field: what only the simulator knows, such as a field that is added later, is not the robot's.
def as_real(
    twin: CommandResult,
    *,
    reply: float,
    status: Status | None = None,
    reason: str | None = None,
    reading: Reading | None = None,
) -> CommandResult:
    """The real robot's result for a command that its twin did too.

    Args:
        twin: The twin's result; its number, times, poses and motion are the best that is known.
        reply: The robot's reply, NaN for none.
        status: The robot's, None for the twin's.
        reason: The robot's, None for the twin's.
        reading: The robot's reading: see `real_reading`.
    """
    return CommandResult(
        number=twin.number,
        time=twin.time,
        command=twin.command,
        status=twin.status if status is None else status,
        reply=reply,
        before=twin.before,
        pose=twin.pose,
        reason=twin.reason if reason is None else reason,
        reading=reading,
        trajectory=twin.trajectory,
        grip=twin.grip,
        taken=twin.taken,
        link=twin.link,
        velocity=twin.velocity,
        waits=twin.waits,
    )


def real_reading(twin: Reading, value: float, scan: LidarScan | None = None) -> Reading:
    """The real robot's reading beside its twin's: the robot's value, or scan, and the twin's true value."""
    return Reading(sensor=twin.sensor, value=value, true=twin.true, view=twin.view, took=twin.took, scan=scan)


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
        """True if the port is open, and the board has had its time to start."""
        self._starting = False
        """True if the port is open and the board may still be starting."""
        self._said = bytearray()
        """Bytes that the board has sent since it starts."""
        self._started = LoopTimer(self._board_started, self._loop)
        self._greeted = LoopTimer(self._board_started, self._loop)

    def _begin_listening(self) -> None:
        """Open the port, and watch the twin."""
        self.engine.watch(self.handle)
        self.link.start(self)

    def _end_listening(self) -> None:
        """Release the port."""
        self.engine.unwatch(self.handle)
        self._open = False
        self._end_start()
        self.link.close()

    @property
    def port(self) -> str:
        """The robot's port, as the user calls it."""
        return self.link.name

    @property
    def connected(self) -> bool:
        """True if the port is open, and the board is not starting."""
        return self._open

    @property
    def hindrance(self) -> str:
        """Reason why nothing can be sent to the robot now."""
        return f"the board on {self.port} is starting" if self._starting else f"{self.port} is closed"

    @property
    def no_answer(self) -> str:
        """Reason for a command that got no answer in time."""
        return f"the robot did not answer within {self.settings.timeout:g} s"

    @property
    def unsent_stop(self) -> str:
        """Fault of a stop while the port is closed, or the board is starting."""
        return f"the stop cannot be sent: {self.hindrance}"

    @abstractmethod
    def stop(self) -> None:
        """The emergency stop of a person."""

    @abstractmethod
    def replied(self, data: bytes) -> None:
        """Bytes have come from the robot, which is not starting."""

    @abstractmethod
    def ready(self) -> None:
        """The port is open, and the board has had its time to start."""

    def greeted(self, data: bytes) -> None:
        """Bytes have come from a board that is starting: they are told, and are no reply."""

    def received(self, data: bytes) -> None:
        """Bytes have come from the robot."""
        if not self._starting:
            self.replied(data)
            return
        self.greeted(data)
        self._said += data[: MOST_SAID - len(self._said)]
        if sum(chr(each).isprintable() and each < 127 for each in self._said) >= _LEAST_WORDS:
            self._greeted.set_in(_GREETED)

    def opened(self) -> None:
        """The port is open."""
        boot = self.settings.boot
        seconds = float(boot) if boot != AUTO_BOOT else BOOT_TIME * self.link.restarts_board
        if not seconds:
            self._tell(NoticeKind.ROBOT, f"robot: {self.port} is open")
            self._set_open()
            return
        self._starting = True
        text = f"robot: {self.port} is open; waiting {seconds:g} s for the board to start"
        self._tell(NoticeKind.ROBOT, text)
        self._started.set_in(seconds)

    def _board_started(self) -> None:
        self._end_start()
        self._set_open()

    def _end_start(self) -> None:
        """End the wait for a board that starts; its words are told."""
        self._starting = False
        self._started.cancel()
        self._greeted.cancel()
        said, self._said = bytes(self._said), bytearray()
        if said.strip():
            shown = cut(said.strip().decode("latin-1"))
            self._tell(NoticeKind.ROBOT, f"robot: the board said '{shown}' when it started")

    def _set_open(self) -> None:
        self._open = True
        self.ready()

    def lost(self, reason: str) -> None:
        """The port has closed, or cannot be opened."""
        self._open = False
        self._end_start()
        self._tell(NoticeKind.FAULT, f"robot: {reason}; trying again")

    def on_action(self, event: ActionDone) -> None:
        """Pass a person's stop on to the real robot."""
        if event.action.name is ActionName.STOP:
            self.stop()

    def _tell(self, kind: NoticeKind, text: str) -> None:
        self.engine.tell(Notice(kind, text))
