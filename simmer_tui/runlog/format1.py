"""Logs of format 1, the format of version 0.1, turned into format 2.

A log of format 1 held one line a command. A movement that was answered when it ended had its line
at its end; one that was answered at once had one at its beginning, as it was planned, and its end was
told nowhere. Both are worked out here, once, so that nothing else need know of it. What it did not
hold cannot be had: a way is the points it lists, and when a command was taken up stays unknown.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections import deque
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import IO, Any, cast

from simmer_tui.errors import RunLogError
from simmer_tui.runlog.encode import header_text
from simmer_tui.sim.command import escape

_WINDOW = 4096
"""Lines within which a movement's line stands after those of commands that came while it lasted."""
_ENDING = ("stop", "teleport", "reset", "seed")
_RESTARTS = ("reset", "seed")


def is_format_1(line: bytes) -> bool:
    """Whether a log's first line says that it is of format 1."""
    if b'"format":1,' not in line and b'"format": 1,' not in line:
        return False
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError):
        return False
    return isinstance(fields, dict) and fields.get("kind") == "header" and fields.get("format") == 1


def upgraded(file: IO[bytes], shown: str) -> IO[bytes]:
    """A temporary file that holds a log of format 1 as one of format 2. Lines that cannot be read stay
    as they are, and are told as broken when they are read."""
    first = file.readline()
    has_mission = any(b'"about":"mission"' in line for line in file)
    file.seek(0)
    file.readline()
    header = json.loads(first)
    try:
        line = _header(header, has_mission)
    except (ValueError, OverflowError, RecursionError) as error:  # an endless number
        raise RunLogError(f"{shown}: the header is broken: {escape(str(error), 120)}") from None
    new = tempfile.TemporaryFile()  # noqa: SIM115 - it is what is returned
    new.write(line)
    begun = header.get("wall")
    for line in _Upgrade(begun if isinstance(begun, float) else 0.0).lines(file):
        new.write(line)
    new.seek(0)
    return cast("IO[bytes]", new)


def _header(fields: dict[str, Any], has_mission: bool) -> bytes:
    settings = fields.get("settings")
    if isinstance(settings, dict):  # every contact ended a movement then
        motion = settings.get("motion")
        settings["motion"] = (motion if isinstance(motion, dict) else {}) | {"contact": "stop"}
    fields |= {"format": 2, "written": 1, "holding": False, "mission": has_mission}
    return f"{header_text(fields)}\n".encode()


class _Upgrade:
    """Goes through the lines after the first."""

    def __init__(self, begun: float) -> None:
        self._begun = begun
        self._ready: deque[tuple[int, bytes]] = deque()
        """Lines done, each with the number of its command (0 for others)."""
        self._accepted: Mapping[str, Any] | None = None

    def lines(self, file: IO[bytes]) -> Iterator[bytes]:
        """The lines of format 2."""
        for data in file:
            try:
                fields = json.loads(data)
                self._take(fields)
            except (
                ValueError,
                TypeError,
                KeyError,
                AttributeError,
                IndexError,
                OverflowError,
                RecursionError,
            ):
                self._ready.append((0, data))
            while len(self._ready) > _WINDOW:
                yield self._ready.popleft()[1]
        if self._accepted is not None:
            self._end(self._accepted, _number(self._accepted["end"]))
        yield from (line for _, line in self._ready)

    def _take(self, fields: dict[str, Any]) -> None:
        accepted = self._accepted
        if accepted is not None and _ends(fields, accepted):
            restarts = fields["kind"] == "action" and fields.get("action") in _RESTARTS
            end = _number(accepted["end"])
            self._end(accepted, end if restarts else min(end, _number(fields["t"])))
        match fields["kind"]:
            case "command":
                self._command(fields)
            case "action":
                refused = {"refused": True} if fields["refused"] is True else {}
                kept = _picked(fields, "action", "source", "arguments", "text", "pose")
                self._put(fields["t"], "action", {"n": fields["number"], **kept, **refused}, fields)
            case "belief":
                kept = _picked(fields, "believed", "pose", "spread", "note", "particles")
                self._put(fields["t"], "belief", kept, fields)
            case "notice" if fields["about"] == "mission":
                self._mission(fields)
            case "notice":
                self._put(fields["t"], "notice", _picked(fields, "about", "subject", "text"), fields)
            case "twin":
                kept = _picked(fields, "source", "command", "code", "robot", "simulated")
                self._put(fields["t"], "twin", kept, fields)
            case kind:
                raise ValueError(f"no kind of line: {kind}")

    def _mission(self, fields: dict[str, Any]) -> None:
        subject, text = fields["subject"], fields["text"]
        reason = text.split(": ", 2)[2:] if subject == "failed" else []
        more = {"subject": "under way" if subject == "begin" else subject, "text": text}
        self._put(fields["t"], "mission", more | ({"reason": reason[0]} if reason else {}), fields)

    def _command(self, fields: dict[str, Any]) -> None:
        number, status = fields["number"], fields["verdict"]
        common = {"n": number, "command": fields["command"], "source": fields["source"]}
        if "path" in fields:
            self._movement(fields, common, status)
        elif "sensor" in fields:
            more = common | _picked(fields, "reply", "true")
            self._put(fields["t"], "read", more, fields)
        else:
            more = {"status": status, **common, **_picked(fields, "reply", "reason")}
            if status == "stopped":
                more["stops"] = True
            self._put(fields["t"], "answer", more, fields)

    def _movement(self, fields: dict[str, Any], common: dict[str, Any], status: str) -> None:
        number, begin = fields["number"], fields["begin"]
        accepted, done = status == "accepted", status == "done"
        way = {"way": fields["path"], "arrival": _arrival(fields), "heading": fields["pose"][2]}
        grip = {"grip": fields["grip"]} if "grip" in fields else {}
        if accepted:
            self._put(begin, "plan", common | way | grip, fields)
            more = {"status": "accepted", **common, "reply": fields["reply"]}
            self._put(fields["t"], "answer", more, fields)
            self._accepted = fields
            return
        ended = {"pose": fields["pose"], **_contact(fields), **_cut(fields)}
        between = [place for place, (other, _) in enumerate(self._ready) if other > number]
        if between:  # others came while it lasted: its beginning belongs before them
            self._put(begin, "plan", common | way | grip, fields, place=between[0])
            self._put(fields["end"], "end", {"n": number, **way, **ended}, fields)
        else:
            more = common | way | grip | {"end": fields["end"], **ended}
            self._put(begin, "move", more if done else more | {"answers": False}, fields)

    def _end(self, accepted: Mapping[str, Any], end: float) -> None:
        """The end of a movement that was answered at its beginning, at a time at which it was over."""
        self._accepted = None
        planned = _number(accepted["end"])
        path, pose = accepted["path"], accepted["pose"]
        arrival = _arrival(accepted)
        contact = _contact(accepted) if arrival <= end else {}
        more: dict[str, Any] = {"n": accepted["number"], "answers": False, **contact}
        if end < arrival and arrival > accepted["begin"]:
            share = (end - accepted["begin"]) / (arrival - accepted["begin"])
            path, pose = _part(path, accepted["before"], pose, share)
        if end < planned:
            more["stopped_by"] = "a stop"
        more |= {"pose": pose, "way": path, "arrival": min(arrival, end), "heading": pose[2]}
        self._put(end, "end", more, accepted)

    def _put(
        self,
        time: object,
        kind: str,
        more: Mapping[str, Any],
        like: Mapping[str, Any],
        place: int | None = None,
    ) -> None:
        wall = round(_number(like["wall"]) - self._begun, 3)
        text = json.dumps({"t": time, "kind": kind, "wall": wall, **more}, separators=(",", ":"))
        number = more["n"] if kind in ("read", "answer", "plan") else 0
        item = (number, f"{text}\n".encode())
        if place is None:
            self._ready.append(item)
        else:
            self._ready.insert(place, item)


def _ends(fields: Mapping[str, Any], movement: Mapping[str, Any]) -> bool:
    """Whether a movement that was merely accepted is over when a line is told."""
    if fields["kind"] == "action" and fields.get("action") in _ENDING and fields.get("refused") is not True:
        return True
    if fields["kind"] == "command" and fields.get("verdict") == "stopped":
        return True
    return _number(fields["t"]) >= _number(movement["end"])


def _arrival(fields: Mapping[str, Any]) -> float:
    """When a movement brought the robot to a stand."""
    end = _number(fields["end"])
    return end if fields.get("contact") is None else min(_number(fields["contact_time"]), end)


def _contact(fields: Mapping[str, Any]) -> dict[str, Any]:
    if fields.get("contact") is None:
        return {}
    last = max(len(fields["path"]) - 2, 0)
    at = {"t": fields["contact_time"], "at": [last, 1.0, 1.0], "point": fields["contact"], "ended": True}
    return {"contact": at}


def _cut(fields: Mapping[str, Any]) -> dict[str, Any]:
    return {"stopped_by": "a stop"} if fields.get("cut") is True else {}


def _part(
    path: list[list[float]], before: list[float], pose: list[float], share: float
) -> tuple[list[list[float]], list[float]]:
    """The first share of a way by its length, and the pose there."""
    lengths = [math.dist(a, b) for a, b in pairwise(path)]
    left = share * math.fsum(lengths)
    heading = before[2] + share * (pose[2] - before[2])
    for piece, length in enumerate(lengths):
        if left < length:
            (x, y), (next_x, next_y) = path[piece], path[piece + 1]
            part = left / length
            here = [x + part * (next_x - x), y + part * (next_y - y)]
            return [*path[: piece + 1], here], [*here, heading]
        left -= length
    return path, [*path[-1], heading]


def _picked(fields: Mapping[str, Any], *names: str) -> dict[str, Any]:
    return {name: fields[name] for name in names if fields.get(name) not in (None, "", [])}


def _number(value: object) -> float:
    number = float(value) if isinstance(value, int | float) else math.nan
    if not math.isfinite(number):
        raise ValueError("a time must be finite")
    return number
