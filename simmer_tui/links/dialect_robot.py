"""A real robot that speaks the team's own language, driven by the console, keys and programs over TCP.

The bytes of the program that has its port open pass unchanged (`monitored_robot.py`). Commands of other
senders are translated by inverse rules; none is passed on unchanged.
"""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.dialect.dialect_rules import Busy
from simmer_tui.dialect.inverse import DialectMessage, InverseRules
from simmer_tui.dialect.reply_reader import RobotReply
from simmer_tui.links.backend import Message
from simmer_tui.links.monitored_robot import MonitoredRobot
from simmer_tui.links.protocol.packets import STOP
from simmer_tui.links.real_robot import as_real
from simmer_tui.robot.sessions import Answered, Session
from simmer_tui.robot.timers import LoopTimer
from simmer_tui.run.events import NoticeKind
from simmer_tui.sim.command import PEOPLE, WORD, Command, cut, parse_value
from simmer_tui.sim.records import CommandResult, Status
from simmer_tui.sim.velocity_commands import WAIT, parse_wait

# A person who releases a key expects the robot to stop. It is half a step of a robot at 6 in/s.
KEY_SILENCE = 0.25
"""Seconds after the last key until the robot is sent its stop."""
# Less than a person notices.
_LOOK_AGAIN = 0.02
"""Seconds until a command checks again whether the robot stands still."""
_KEYS = "keys"
"""Source of the commands that keys make."""
NO_STOP = 'no rule of the dialect is a plain stop (do = "stop"): keys and console do not drive this robot'
_TAKEN = "a program has the robot's port open; it is stopped, and not driven, from here"


class _Request(Struct, eq=False):
    """A command of a sender that speaks another language, and the callback for its result."""

    command: Command
    answer: Callable[[CommandResult], None]
    session: Session
    message: DialectMessage | None = None
    result: CommandResult | None = None
    """Result of the twin's movement, when it is over."""
    timer: asyncio.TimerHandle | None = None


class DialectRobot(MonitoredRobot):
    """A real robot with a dialect as a backend. Only for the event loop it is made in."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._inverse = InverseRules(self.rules, self._device.state)
        self._queue: deque[_Request] = deque()
        self._moving: _Request | None = None
        """The request whose movement is under way."""
        self._asking: _Request | None = None
        """The request whose reading is awaited."""
        self._key: DialectMessage | None = None
        """The message of the key that drives."""
        self._key_timer = LoopTimer(self._keys_silent, self._loop)
        self._again = LoopTimer(self._advance, self._loop)
        self._begin_listening()

    def close(self) -> None:
        """Release the port; pending commands are answered in the robot's place."""
        if self._key is not None:
            self._keys_silent()
        self._end_listening()
        self._key_timer.cancel()
        self._again.cancel()
        self._drop(f"{self.port} was closed")

    def _note_reply(self, reply: RobotReply) -> None:
        asking = self._asking
        if asking is not None and asking.message is not None and reply.rule is asking.message.rule:
            self._answer_readings(asking.message, reply.readings)
        moving = self._moving
        if reply.ends and moving is not None and moving.result is not None:
            self._over(moving, moving.result)

    def _answer_readings(self, asked: DialectMessage, readings: Mapping[str, float]) -> None:
        """Answer all requests that waited for this message's readings."""
        waiting = [each for each in (self._asking, *self._queue) if each is not None]
        for request in waiting:
            code = request.command.code
            if code not in readings or (
                request is not self._asking and request.session is not waiting[0].session
            ):
                continue
            if request in self._queue:
                self._queue.remove(request)
            result = self._result(request.command, Status.READING, readings[code])
            self._over(request, result)

    # -- commands of others ----------------------------------------------------------------------------

    def submit(self, message: Message, session: Session, answered: Answered) -> None:
        """Do commands by inverse rules."""
        results: dict[int, CommandResult] = {}
        count = len(message.commands)

        def answer(place: int, result: CommandResult) -> None:
            results[place] = result
            if len(results) == count:
                answered([results[each] for each in range(count)], None)

        for place, command in enumerate(message.commands):
            request = _Request(command, partial(answer, place), session)
            if command.stops or command.code == STOP:
                self._stop_for(request)
            elif command.source == _KEYS and self._drives(command):
                self._press(request)
            else:
                self._queue.append(request)
        self._advance()

    def urgent_part(self, message: Message) -> Message | None:
        """The commands that stop."""
        stops = tuple(each for each in message.commands if each.stops or each.code == STOP)
        return Message(message.data, stops, message.form) if stops else None

    def forget(self, session: Session) -> None:
        """Remove a client that has left: its waiting commands do not begin."""
        self._queue = deque(each for each in self._queue if each.session is not session)

    def _drives(self, command: Command) -> bool:
        simulator = self.engine.simulator
        return simulator.is_drive(command) or simulator.is_velocity(command)

    def _advance(self) -> None:
        """Begin the next command, unless one is under way."""
        if self._starting:
            return
        while self._queue and self._asking is None:
            request = self._queue[0]
            problem = self._prepare(request)
            message = request.message
            is_free = self._moving is None and not self._device.moves
            may_begin = is_free or (
                message is not None and not message.rule.steps and message.rule.busy is Busy.NOW
            )
            if not problem and not may_begin:
                # No event reports the end of a run or a pause of the twin, so it is checked again later.
                if self._moving is None and self._again.due == math.inf:
                    self._again.set_in(_LOOK_AGAIN)
                return
            self._queue.popleft()
            if problem:
                self._refuse(request, problem)
            elif message is None:
                self._begin_wait(request)
            else:
                self._begin(request, message)

    def _prepare(self, request: _Request) -> str:
        """Find the message for a command. Returns the reason if there is none."""
        command, simulator = request.command, self.engine.simulator
        if command.problem:
            return command.problem
        if command.code == WAIT and not simulator.is_drive(command):
            wait = parse_wait(command.argument)
            return wait if isinstance(wait, str) else ""
        if hindrance := self._hindrance(command):
            return hindrance
        if not simulator.is_drive(command):
            made = self._inverse.read(command.code)
        else:
            value = parse_value(command.argument)
            made = value if isinstance(value, str) else self._inverse.drive(command.code, value)
        if isinstance(made, str):
            return made
        request.message = made
        return ""

    def _hindrance(self, command: Command) -> str:
        """The reason why no message can be sent for a command now; empty if one can."""
        if not self._open:
            return self.hindrance
        if self.switch.program is not None:
            return _TAKEN
        is_unsafe = command.source in PEOPLE and self._drives(command)
        return NO_STOP if is_unsafe and self._inverse.stop() is None else ""

    def _refuse(self, request: _Request, reason: str) -> None:
        result = self.engine.peek(replace(request.command, problem=reason))
        self.engine.tell(result)
        request.answer(result)

    def _begin_wait(self, request: _Request) -> None:
        seconds = parse_wait(request.command.argument)
        assert isinstance(seconds, float), "looked at before"
        self._moving = request
        result = self._result(request.command, Status.DONE, math.inf)
        request.timer = self._loop.call_later(
            seconds / self.engine.time_scale, self._over, request, replace(result, waits=seconds)
        )

    def _begin(self, request: _Request, message: DialectMessage) -> None:
        """Send a message, and have the twin do the same."""
        timeout = self.settings.timeout
        if message.rule.steps:
            self._moving = request
            if message.seconds:
                done = self._result(request.command, Status.DONE, math.inf)
                after = message.seconds / self.engine.time_scale
                request.timer = self._loop.call_later(after, self._over, request, done)
        else:
            self._asking = request
            request.timer = self._loop.call_later(timeout, self._unanswered, request)
        self._send(message, request.command.source)

    def _send(self, message: DialectMessage, source: str) -> None:
        """Send a message of ours to the robot; the twin does the same."""
        self._twin.source, self._twin.refused = source, False
        self._note_sent(message.data)
        # A command that the twin refuses, such as a million inches, is not sent to the robot.
        if not self._twin.refused:
            self.link.write(message.data)

    def _twin_moved(self, result: CommandResult) -> None:
        """A movement of the twin has ended, or was refused."""
        request = self._moving
        if request is None or request.message is None or request.message.seconds:
            self._loop.call_soon(self._advance)
            return
        is_over = not request.message.rule.done or result.status is not Status.DONE
        if is_over:
            self._over(request, result)
            return
        request.result = result
        rule = request.message.rule
        waits = any(due.rule is rule and due.part == "done" for due in self._reader.pending)
        if waits:
            request.timer = self._loop.call_later(self.settings.timeout, self._unanswered, request)
        else:
            self._over(request, result)

    def _unanswered(self, request: _Request) -> None:
        """The robot has not answered in time."""
        if request.message is not None:
            self._reader.forget(request.message.rule)
        self._give_up(request, self.no_answer)

    def _give_up(self, request: _Request, reason: str) -> None:
        known = request.result or self._result(request.command, Status.UNANSWERED, math.nan)
        result = as_real(known, status=Status.UNANSWERED, reply=math.nan, reason=reason)
        self.engine.tell(result)
        self._over(request, result)

    def _over(self, request: _Request, result: CommandResult) -> None:
        """Answer a command that is done."""
        if request.timer is not None:
            request.timer.cancel()
            request.timer = None
        if self._moving is request:
            self._moving = None
        if self._asking is request:
            self._asking = None
        request.answer(replace(result, command=request.command))
        self._loop.call_soon(self._advance)

    def _drop(self, reason: str) -> None:
        """Answer all waiting commands in the robot's place."""
        left = [each for each in (self._moving, self._asking, *self._queue) if each is not None]
        self._moving = self._asking = None
        self._queue.clear()
        for request in left:
            self._give_up(request, reason)

    def _result(self, command: Command, status: Status, reply: float) -> CommandResult:
        """A result without a part of the twin."""
        time, simulator = self.engine.now(), self.engine.simulator
        pose = simulator.pose
        return CommandResult(simulator.commands, time, command, status, reply, pose, pose)

    # -- stops and keys --------------------------------------------------------------------------------

    def stop(self) -> None:
        """Send a person's or a command's stop at once, ahead of waiting commands."""
        self._end_key()
        message = self._inverse.stop()
        if message is None:
            text = 'the robot cannot be stopped: no rule of the dialect is a plain stop (do = "stop")'
            self._tell(NoticeKind.FAULT, text)
        elif self._starting:  # it goes instead of what the program has written, as in an open port
            self._early[:] = message.data
        elif not self._open:
            self._tell(NoticeKind.FAULT, self.unsent_stop)
        else:
            # Otherwise the stop would complete half a line of the program.
            data = message.data
            if self._device.unfinished and self.switch.program is not None:
                data = self.rules.framing.end + data
            self.link.write_instead(data)
            self._note_sent(data)
        self._drop("not done any more: the robot was stopped")

    def _stop_for(self, request: _Request) -> None:
        self.stop()
        self.engine.stop_motion("a stop for the robot")
        twin = self.engine.peek(request.command)
        result = as_real(twin, status=Status.STOPPED, reply=math.inf, reason="")
        self.engine.tell(result)
        request.answer(result)

    def _press(self, request: _Request) -> None:
        """Drive by a key; the robot is stopped when no more keys come."""
        command = request.command
        driven = self._meant(command)
        if driven is None:  # a velocity of 0: the key was released
            self._keys_silent()
            request.answer(self._result(command, Status.DONE, math.inf))
            return
        hindrance = self._hindrance(command)
        made = driven if isinstance(driven, str) else self._inverse.held(*driven)
        if hindrance or isinstance(made, str):
            self._refuse(request, hindrance or str(made))
            return
        if self._key is not None and (self._key.data != made.data or not self._device.moves):
            same = self._key.data == made.data
            self._end_key()
            if not same:
                self.stop()
        if self._key is None:
            self._key = made
            self._send(made, _KEYS)
        # In the robot's own thread: the stop comes even if the screen hangs.
        self._key_timer.set_in(KEY_SILENCE)
        request.answer(self._result(command, Status.ACCEPTED, math.inf))

    def _meant(self, command: Command) -> tuple[str, float] | str | None:
        """The drive that a key represents and its distance; None for a velocity of 0."""
        if not self.engine.simulator.is_velocity(command):
            value = parse_value(command.argument)
            return value if isinstance(value, str) else (command.code, value)
        try:
            x, y, turn = (float(each) for each in (command.argument or "").split(";")[:3])
        except ValueError:
            return f"'{cut(command.text, WORD)}' is no velocity of a key"
        if not (x or y or turn):
            return None
        found = self._inverse.code_of((x, y, turn))
        return found or "no drive of the robot goes that way"

    def _end_key(self) -> None:
        self._key = None
        self._key_timer.cancel()

    def _keys_silent(self) -> None:
        """Stop the robot: no key has come for a while, or it was released."""
        if self._key is not None:
            self.stop()
