"""A real robot that speaks the team's own language, monitored beside its simulated twin.

The bytes of the program that has the serial port open pass unchanged in both directions. The dialect only
monitors them: the twin does what each message says, and readings come from replies.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from simmer_tui.dialect.device import DialectDevice, MoveEnd
from simmer_tui.dialect.dialect_rules import DialectRules, MessageRule
from simmer_tui.dialect.expressions import FieldValue
from simmer_tui.dialect.reply_reader import SILENCE, ReplyReader, RobotReply
from simmer_tui.links.backend import BackendSwitch
from simmer_tui.links.dialect_link import (
    LOGGED_OF_STREAM,
    SimulatedHost,
    move_end,
    note_motion,
    reply_value,
)
from simmer_tui.links.real_robot import RealRobot, as_real, real_reading
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.timers import LoopTimer
from simmer_tui.run.events import (
    LegBegun,
    LegEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
    TwinReading,
    VelocityEnded,
    WireMessage,
)
from simmer_tui.sim.command import PEOPLE, parse_command
from simmer_tui.sim.records import REFUSALS, CommandResult

# A stream at 240 Hz would fill the log and the screen.
STREAM_READINGS = 0.1
"""Seconds between two readings of a stream that become events."""
# A minute of a program that sends at 9600 baud.
_MOST_EARLY = 64 * 1024
"""Most bytes of a program that wait until the board has started."""


class Twin(SimulatedHost):
    """The simulated robot, which does the same. Its readings are kept until the real ones come."""

    def __init__(self, engine: Engine, rules: DialectRules, moved: Callable[[CommandResult], None]) -> None:
        super().__init__(engine, rules, lambda data, droppable: None)
        self._moved = moved
        self.read_last: dict[str, CommandResult] = {}
        self.refused = False
        """True if the movement begun last was refused."""

    def read(self, codes: Sequence[str], done: Callable[[Mapping[str, FieldValue]], None]) -> None:
        results = {code: self._engine.peek(parse_command(code, self.source)) for code in codes}
        self.read_last |= results
        done({code: reply_value(result) for code, result in results.items()})

    def move(self, command: str, done: Callable[[MoveEnd], None]) -> None:
        def moved(result: CommandResult) -> None:
            self.refused = result.status in REFUSALS
            done(move_end(result))
            self._moved(result)

        self._moves.submit(parse_command(command, self.source), moved)

    def tell(self, text: str) -> None:
        self._engine.tell(Notice(NoticeKind.ROBOT, f"dialect: {text}"))


@dataclass(eq=False)
class MonitoredRobot(RealRobot):
    """A real robot whose exchange with its program is monitored.

    Args:
        engine: The twin.
        link: The connection to the robot.
        settings: Those of its port; they may be replaced at any time.
        rules: Its language.
        switch: Knows the program that has the serial port open.
    """

    rules: DialectRules
    switch: BackendSwitch

    def __post_init__(self) -> None:
        super().__post_init__()
        rules = self.rules
        # Messages that the robot sends by itself come from the real one only.
        reactive = rules.reactive
        self._twin = Twin(self.engine, reactive, self._twin_moved)
        self._device = DialectDevice(
            reactive, self._twin, self._note_message, lambda values: self._reader.cut_short(values)
        )
        self._reader = ReplyReader(rules, self._device.state)
        self._silence = LoopTimer(self._fell_silent, self._loop)
        self._lost_reported = False
        self._early = bytearray()
        """Bytes that the program has written while the board starts."""
        self._streamed = 0
        self._stream_reported = -math.inf

    def _end_listening(self) -> None:
        super()._end_listening()
        self._silence.cancel()

    # -- what others wait for ---------------------------------------------------------------------------

    def _twin_moved(self, result: CommandResult) -> None:
        """A movement of the twin has ended, or was refused."""

    def _note_reply(self, reply: RobotReply) -> None:
        """Called after a reply of the robot whose readings have been passed to the watchers."""

    def _advance(self) -> None:
        """Continue: the robot may be ready for a waiting command."""

    def _drop(self, reason: str) -> None:
        """Drop all waiting commands."""

    # -- the program that has the port open -----------------------------------------------------------

    def joined(self, baud: float | None) -> None:
        """A program has opened the port, at its own rate, which is not the robot's."""
        self._lost_reported = False
        if baud is not None and baud != self.settings.baud:
            text = (
                f"the program opened the port at {baud:g} baud; the robot's is at {self.settings.baud}, "
                f"whatever the program says: --baud {baud:g} sets it"
            )
            self._tell(NoticeKind.ROBOT, text)

    def wrote(self, data: bytes) -> None:
        """A program has written bytes: they go to the robot unchanged, once its board has started."""
        if self._starting and len(self._early) + len(data) <= _MOST_EARLY:
            self._early += data
            return
        if not self._open:
            if not self._lost_reported:
                self._lost_reported = True
                text = f"what the program writes is lost: {self.hindrance}"
                self._tell(NoticeKind.FAULT, text)
            return
        self._pass_on(data)

    def _pass_on(self, data: bytes) -> None:
        """Send the program's bytes to the robot; the twin does the same."""
        self._twin.source = "client"
        self.link.write(data)
        self._note_sent(data)

    def _note_sent(self, data: bytes) -> None:
        """Pass the twin the bytes that the robot is sent."""
        with self.engine.moment():
            self._device.received(data)

    def left(self) -> None:
        """The program has closed the port. The robot is not stopped: what it does then is up to it."""
        self._device.closed()
        self._twin.close(runs_on=self.rules.robot.runs_on)
        self._advance()

    # -- what the robot says --------------------------------------------------------------------------

    def greeted(self, data: bytes) -> None:
        """Pass a board's first words to the program, as its own port would."""
        if self.switch.program is not None:
            self.switch.program(data)

    def replied(self, data: bytes) -> None:
        self.greeted(data)
        for reply in self._reader.receive(data):
            self._note_received(reply)
        self._silence.set_in(SILENCE if self._reader.waits else None)

    def _fell_silent(self) -> None:
        for reply in self._reader.silence():
            self._note_received(reply)

    def ready(self) -> None:
        self._lost_reported = False
        early, self._early = bytes(self._early), bytearray()
        if early:
            self._pass_on(early)
        self._advance()

    def lost(self, reason: str) -> None:
        super().lost(reason)
        self._early.clear()
        self._drop(reason)

    def _note_message(self, rule: MessageRule, values: Mapping[str, FieldValue]) -> None:
        """Begin a message's command on the twin; its replies are expected from now on."""
        self._drop_readings()
        if not rule.stops:
            self._reader.asked(rule, values)

    def _drop_readings(self) -> None:
        """Drop readings of the twin for which no reply is pending: the robot was faster than `takes`, and its
        reply was compared without them."""
        said = [each for pending in self._reader.pending for each in pending.expressions]
        awaited = self.rules.sensors_in(said) if self._twin.read_last else ()
        for code in self._twin.read_last.keys() - awaited:
            del self._twin.read_last[code]

    def _note_received(self, reply: RobotReply) -> None:
        """Take a reply of the robot."""
        self._streamed += reply.part == "stream"
        if reply.part != "stream" or self._streamed <= LOGGED_OF_STREAM:
            self.engine.tell(WireMessage(self.engine.now(), reply.data.decode("latin-1"), reply=True))
        # The twin may be slower than the robot; it must not stop the robot's next movement.
        if reply.ends and self._device.doing is reply.values:
            self.engine.finish_movement()
        self._tell_readings(reply)
        self._note_reply(reply)

    def _tell_readings(self, reply: RobotReply) -> None:
        """Tell the real readings in a reply beside the twin's."""
        now = self._loop.time()
        if reply.part == "stream":
            if now < self._stream_reported + STREAM_READINGS:
                return
            self._stream_reported = now
        for code, value in reply.readings.items():
            read = self._twin.read_last.pop(code, None)
            result = read or self.engine.peek(parse_command(code, self._twin.source))
            if result.reading is None:
                continue
            real = as_real(result, reply=value, reading=real_reading(result.reading, value))
            # The pose of a reading during a movement is not known: calibration uses those at stops.
            if not (self._device.moves or self.engine.simulator.moving):
                self.engine.tell(real)
            self.engine.tell(TwinReading(result.time, result.command, code, value, result.reply))

    # -- what the twin foresees --------------------------------------------------------------------------

    def on_planned(self, event: MovementPlanned) -> None:
        """Warn of a contact that the twin foresees for a person's command."""
        if event.command.source in PEOPLE and event.trajectory.contact is not None:
            self._foresee(event.trajectory.travelled(event.trajectory.contact.time))

    def on_leg_begun(self, event: LegBegun) -> None:
        if event.command.source in PEOPLE and event.leg.contact is not None:
            self._foresee(event.leg.travelled(event.leg.end_time))

    def on_leg_ended(self, event: LegEnded) -> None:
        note_motion(event, self._device)

    def on_velocity_ended(self, event: VelocityEnded) -> None:
        note_motion(event, self._device)

    def _foresee(self, distance: float) -> None:
        text = f"this will touch in {distance:.1f} in, if the robot is where the simulated one is"
        self._tell(NoticeKind.HINT, text)
