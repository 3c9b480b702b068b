"""Messages of a dialect beside the commands that they led to."""

from __future__ import annotations

import math

from simmer_tui.dialect.fault_notices import UNKNOWN_MESSAGE
from simmer_tui.run.events import WireMessage
from simmer_tui.sim.command import WORD, Command, cut, utf8_text

# Seconds, for rounding of sums; a command begins at the moment at which its message has come.
_SAME_MOMENT = 1e-6
# Commands kept: a movement under way, and some that wait for their end.
_KEPT = 50


class MessageTrail:
    """Pairs messages with the commands that they led to; both are given in order. A person who looks for the
    message `[a900]` in a program does not find the command `vv-0;6;0;0.9` there."""

    def __init__(self) -> None:
        self.text, self._time = "", -math.inf
        """The newest message that is no reply; empty before the first and after an unknown one."""
        self._by_number: dict[int, str] = {}

    def add_message(self, message: WireMessage) -> None:
        """Add a message, or a reply, at the moment it has come."""
        if not message.reply:
            is_known = not message.meaning.startswith(UNKNOWN_MESSAGE)
            self.text, self._time = message.data.strip() if is_known else "", message.time

    def begun(self, number: int, time: float) -> None:
        """Note that the command with this number begins. If it begins later than its message came, as the
        second step of several, it has no message."""
        if self.text and abs(time - self._time) < _SAME_MOMENT:
            self._by_number[number] = cut(utf8_text(self.text), WORD)
            if len(self._by_number) > _KEPT:
                del self._by_number[next(iter(self._by_number))]

    def shown(self, number: int, command: Command) -> str:
        """Text of a command for people, after its message if that is known."""
        text = self._by_number.get(number, "")
        return f"{text} ({command.shown})" if text else command.shown
