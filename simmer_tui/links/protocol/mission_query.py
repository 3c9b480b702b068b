"""The query for the facts of a mission, `?m`: answered over a program's own connection, in its own form.

`?m` alone is answered like a lidar's code, with a count and so many numbers; `?m-3` with the third of them.
A query is no command: the robot is not asked, no time passes, and nothing of it is in the log. A run without
it is the same, so a rerun does not need it.
"""

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from simmer_tui.config.reply_formats import NUMBER_STRUCTS, ReplyForm, ReplyFormat
from simmer_tui.links.protocol.packets import number_text, ranges_text
from simmer_tui.links.protocol.replies import pack_reply
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.command import MISSION_QUERY, Command, parse_value


class MissionQuery(Struct, frozen=True):
    """The answers to queries. Without a mission there are no `facts`, and each answer is a refusal."""

    facts: tuple[float, ...] = ()

    def answer(self, commands: Sequence[Command], form: ReplyForm) -> bytes | None:
        """The reply to a message, in its form; None if the message is not one query and nothing else."""
        if len(commands) != 1 or commands[0].code != MISSION_QUERY:
            return None
        argument = commands[0].argument
        if argument is None:
            return _packed(form, np.array(self.facts)) if self.facts else _refusal(form)
        place = parse_value(argument)
        # Any other text, such as "?mode", is a command like those before there was a query.
        if isinstance(place, str):
            return None
        is_known = place.is_integer() and 1 <= place <= len(self.facts)
        return _packed(form, self.facts[int(place) - 1]) if is_known else _refusal(form)


def _packed(form: ReplyForm, fact: float | FloatArray) -> bytes:
    """One number, or a count and so many numbers."""
    number, ranges = (fact, None) if isinstance(fact, float) else (math.nan, fact)
    if form.format is ReplyFormat.FRAMED or form.format is ReplyFormat.TEXT:
        return _text(form, number_text(number) if ranges is None else ranges_text(ranges))
    return pack_reply(NUMBER_STRUCTS[form.format.value, form.byte_order], number, ranges)


def _refusal(form: ReplyForm) -> bytes:
    """The reply to an unknown code."""
    return _text(form, "Not Found") if form.format is ReplyFormat.FRAMED else _packed(form, math.nan)


def _text(form: ReplyForm, text: str) -> bytes:
    return (f"[{MISSION_QUERY}:{text}]" if form.format is ReplyFormat.FRAMED else text).encode()
