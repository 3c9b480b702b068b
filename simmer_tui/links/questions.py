"""Questions of a program on the belief port: why a command was refused, and what its code stands for."""

from __future__ import annotations

import json

from simmer_tui.engine import Engine
from simmer_tui.errors import UnknownSensorError
from simmer_tui.events import EventHandler
from simmer_tui.sim.command import parse_command
from simmer_tui.sim.records import REFUSALS, CommandResult

# A program asks at once after a refusal; others may be refused in between.
MOST_KEPT = 64
"""Refused commands whose reasons are kept, the newest."""


class RefusalReasons(EventHandler[None]):
    """Answers `{"why": "d1-1e9"}` with the ports of this simulator, the kind of the code, and the reason of
    the newest refusal of that command; of a lidar's code also that its reply is a scan.

    Numbers on the wire have no room for it: NaN is all that says a command was refused.
    """

    def __init__(self, engine: Engine, ports: list[int]) -> None:
        """`ports` are this simulator's: a program that asks another one by mistake knows it by them."""
        self._engine = engine
        self._ports = ports
        self._reasons: dict[str, str] = {}
        engine.watch(self.handle)

    def close(self) -> None:
        """Remember no more."""
        self._engine.unwatch(self.handle)

    def on_result(self, event: CommandResult) -> None:
        if event.status not in REFUSALS:
            return
        text = event.command.text.strip()
        self._reasons.pop(text, None)  # the newest stands last
        self._reasons[text] = event.reason
        if len(self._reasons) > MOST_KEPT:
            del self._reasons[next(iter(self._reasons))]

    def answer(self, line: bytes) -> bytes | None:
        """The answer to a line, with its end; None if the line asks nothing."""
        # Nearly every line is a belief, and may be long: it is not taken apart twice.
        if len(line) > 1024 or b'"why"' not in line:
            return None
        try:
            question = json.loads(line)
        except (ValueError, RecursionError):
            return None
        if not isinstance(question, dict) or set(question) != {"why"} or not isinstance(question["why"], str):
            return None
        text = question["why"].strip()
        answer: dict[str, object] = {"why": self._reasons.get(text, ""), "kind": self._kind(text)}
        answer["ports"] = self._ports
        if self._engine.simulator.asks_for_scan(parse_command(text)):
            answer["scan"] = True
        return json.dumps(answer).encode() + b"\n"

    def _kind(self, text: str) -> str:
        """The kind of a command's code: "sensor", "drive" (the gripper too) or "unknown"."""
        command = parse_command(text)
        if self._engine.simulator.is_drive(command):
            return "drive"
        try:
            self._engine.simulator.sensor(command.code)
        except UnknownSensorError:
            return "unknown"
        return "sensor"
