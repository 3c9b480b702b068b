"""A proxy between a program and the simulator that puts faults on the wire, and starts the program.

    simmer-tui --no-ui --mission --run "python -S fault_proxy.py '{\"rules\": [...]}' python solve.py"

Started by the simulator as if it were the program: it listens on ports of its own, names them to the real
program in the environment, passes output through, and ends as the program ends, exit code and signal
alike. Both protocols and the belief port go through it. Standard library only, so that it starts in 30 ms.

A rule is a JSON object: `on` is "command", "reply" or "belief"; `do` is one of the functions below; `codes`
are those it applies to (none: all), `from` is the number of the first command, or belief, that it applies to
(0: from the beginning), `value` is the function's argument. With `every` it applies to one command in so
many.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Any

Rule = dict[str, Any]

_NUMBER = struct.Struct(">d")  # the simulator's default: big-endian doubles
_ENDED = math.inf  # the answer to a movement that has ended
_REAL_LIMIT = 240.0
"""Seconds after which a program that hangs is killed. The slowest run took 10 s on a quiet machine."""
_ANSWER_LIMIT = 30.0  # s, for a reply of the simulator: as long as the programs wait themselves

REPLIES: dict[str, Callable[[Any, float, list[float]], float]] = {
    "add": lambda value, reply, before: reply + value,
    "scale": lambda value, reply, before: reply * value,
    "constant": lambda value, reply, before: value,
    "drift": lambda value, reply, before: reply + value * len(before),
    "round": lambda value, reply, before: value * round(reply / value) if math.isfinite(reply) else reply,
    "late": lambda value, reply, before: before[-1 - value] if len(before) > value else before[0],
}
"""Changes of a reply; `before` are the true replies of this code so far, this one the last."""

COMMANDS: dict[str, Callable[[Any, str, int], str]] = {
    "scale": lambda value, text, count: repr(float(text) * value),
    "whole": lambda value, text, count: str(int(float(text))),
    "fade": lambda value, text, count: repr(float(text) * max(1.0 - value * count, 0.05)),
}
"""Changes of the value of a command; `count` is the number of this rule's commands before."""


class Cut(Exception):  # noqa: N818 - no error of the proxy's: what it is to do
    """A rule ends the connection here."""


class Faults:
    """The rules, and their state."""

    def __init__(self, rules: Sequence[Rule]) -> None:
        self._rules = rules
        self._commands = self._beliefs = 0
        self._replies: dict[str, list[float]] = {}
        self._changed = [0] * len(rules)
        self._frozen: bytes | None = None

    def command(self, text: str) -> str | None:
        """The command that is passed on for one of the program's, None if it is dropped.

        Raises Cut.
        """
        self._commands += 1
        for rule in self._applying("command", text[:2], self._commands):
            if rule["do"] == "cut":
                raise Cut
            if rule["do"] == "swap":
                one, other = rule["codes"]
                text = (other if text[:2] == one else one) + text[2:]
            elif len(text) > 3 and rule["do"] in COMMANDS:
                number = self._rules.index(rule)
                changed = COMMANDS[rule["do"]](rule.get("value"), text[3:], self._changed[number])
                self._changed[number] += 1
                text = f"{text[:3]}{changed}"
            elif len(text) > 3 and rule["do"] == "swallow" and rule.get("value") in (None, float(text[3:])):
                return None
        return text

    def reply(self, code: str, reply: float) -> float:
        """The number that the program gets for one of the simulator's."""
        before = self._replies.setdefault(code, [])
        before.append(reply)
        for rule in self._applying("reply", code, self._commands):
            reply = REPLIES[rule["do"]](rule.get("value"), reply, before)
        return reply

    def belief(self, line: bytes) -> bytes:
        """The line that the simulator gets for one of the program's."""
        self._beliefs += 1
        for rule in self._applying("belief", "", self._beliefs):
            if rule["do"] == "freeze":
                self._frozen = self._frozen or line
                line = self._frozen
            # Some lines have a path, or a word, and no pose.
            elif rule["do"] == "turn" and "heading" in (said := json.loads(line)):
                said["heading"] += rule["value"]
                said["particles"] = [
                    [*row[:2], *(each + rule["value"] for each in row[2:])]
                    for row in said.get("particles", ())
                ]
                line = json.dumps(said).encode("ascii")
        return line

    def _applying(self, on: str, code: str, number: int) -> list[Rule]:
        return [
            rule
            for rule in self._rules
            if rule["on"] == on
            and number > rule.get("from", 0)
            and number % rule.get("every", 1) == 0
            and code in rule.get("codes", (code,))
        ]


class Proxy:
    """Listens for the program and speaks to the simulator, one exchange at a time."""

    def __init__(self, faults: Faults) -> None:
        self._faults = faults
        self._host = os.environ["SIMMER_HOST"]
        self._links: dict[socket.socket, Callable[[socket.socket], None]] = {}
        """Handlers of sockets that have something to read."""
        self._first: list[socket.socket] = []
        """The connections with beliefs, which are served first: a belief sent before a command is passed on
        before it."""
        self._partners: dict[socket.socket, socket.socket] = {}
        self._unread: dict[socket.socket, bytes] = {}
        self._answers = b""
        self.environment = dict(os.environ)
        # Replies come back on the command connection then.
        self.environment.pop("SIMMER_REPLY_PORT", None)
        self._listen("SIMMER_PORT", self._accept_binary)
        self._listen("SIMMER_PACKET_PORT", self._take_packet)
        self._listen("SIMMER_PACKET_REPLY_PORT", self._give_answers)
        self._listen("SIMMER_BELIEF_PORT", self._accept_beliefs)

    def serve(self, ended: socket.socket) -> None:
        """Pass messages on, until `ended` can be read and nothing else is left."""
        over = False
        while True:
            sockets = [*self._first, *(each for each in self._links if each not in self._first)]
            ready = select.select([*sockets, ended], [], [], 0.0 if over else None)[0]
            waiting = [each for each in ready if each is not ended]
            if over and not waiting:
                return
            over = over or ended in ready
            if waiting:
                # One at a time: beliefs may have come while the last was handled.
                with contextlib.suppress(OSError):
                    self._links[waiting[0]](waiting[0])

    def _listen(self, variable: str, accepted: Callable[[socket.socket], None]) -> None:
        if variable not in os.environ:
            return
        listener = socket.create_server((self._host, 0), backlog=16)
        self.environment[variable] = str(listener.getsockname()[1])
        self._links[listener] = accepted

    def _connect(self, variable: str) -> socket.socket:
        connection = socket.create_connection((self._host, int(os.environ[variable])), _ANSWER_LIMIT)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return connection

    # -- binary -------------------------------------------------------------------------------

    def _accept_binary(self, listener: socket.socket) -> None:
        self._pair(listener, "SIMMER_PORT", self._take_lines)

    def _accept_beliefs(self, listener: socket.socket) -> None:
        self._first.append(self._pair(listener, "SIMMER_BELIEF_PORT", self._take_beliefs))

    def _pair(
        self, listener: socket.socket, variable: str, take: Callable[[socket.socket], None]
    ) -> socket.socket:
        program = listener.accept()[0]
        program.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._partners[program], self._unread[program] = self._connect(variable), b""
        self._links[program] = take
        return program

    def _lines(self, program: socket.socket) -> list[bytes]:
        """The whole lines that a connection has sent; it is closed if it has ended."""
        piece = program.recv(65536)
        if not piece:
            self._close(program)
            return []
        *lines, self._unread[program] = (self._unread[program] + piece).split(b"\n")
        return lines

    def _close(self, program: socket.socket) -> None:
        del self._links[program]
        if program in self._first:
            self._first.remove(program)
        self._partners.pop(program).close()
        program.close()

    def _take_lines(self, program: socket.socket) -> None:
        try:
            for line in self._lines(program):
                program.sendall(_NUMBER.pack(self._exchange(self._partners[program], line.decode("ascii"))))
        except (Cut, OSError):
            self._close(program)

    def _exchange(self, simulator: socket.socket, command: str) -> float:
        """The number that the program gets for a command."""
        sent = self._faults.command(command)
        if sent is None:
            return _ENDED
        simulator.sendall(sent.encode("ascii") + b"\n")
        reply = b""
        while len(reply) < _NUMBER.size:
            piece = simulator.recv(_NUMBER.size - len(reply))
            if not piece:
                raise ConnectionResetError("the simulator has ended")
            reply += piece
        return self._faults.reply(command[:2], _NUMBER.unpack(reply)[0])

    def _take_beliefs(self, program: socket.socket) -> None:
        for line in self._lines(program):
            self._partners[program].sendall(self._faults.belief(line) + b"\n")

    # -- packets ------------------------------------------------------------------------------

    def _take_packet(self, listener: socket.socket) -> None:
        """A packet of commands: done at once, its answers kept until they are asked for."""
        with listener.accept()[0] as program:
            message = b""
            while not message.endswith(b"]") and (piece := program.recv(4096)):
                message += piece
        commands = message.decode("ascii").strip("[]").split(",")
        answers = []
        with contextlib.suppress(Cut):
            for command in commands:
                sent = self._faults.command(command)
                answers.append("True" if sent is None else self._ask(sent, command[:2]))
            items = [f"{command[:2]}:{answer}" for command, answer in zip(commands, answers, strict=True)]
            self._answers = f"[{','.join(items)}]".encode("ascii")

    def _ask(self, command: str, code: str) -> str:
        """The answer of the simulator to one command, as the program gets it."""
        with self._connect("SIMMER_PACKET_PORT") as sender:
            sender.sendall(f"[{command}]".encode("ascii"))
        message = b""
        while not message.endswith(b"]"):
            with self._connect("SIMMER_PACKET_REPLY_PORT") as receiver:
                while piece := receiver.recv(4096):
                    message += piece
        answer = message.decode("ascii").strip("[]")[3:]
        try:
            number = float(answer)
        except ValueError:  # True, False, Not Found
            return answer
        # Programs match digits with a point between.
        return f"{self._faults.reply(code, number):.3f}"

    def _give_answers(self, listener: socket.socket) -> None:
        with listener.accept()[0] as program:
            program.sendall(self._answers)
            self._answers = b""


def main(arguments: Sequence[str]) -> int:
    """Start the program behind the proxy; returns its exit code."""
    fault = json.loads(arguments[0])
    proxy = Proxy(Faults(fault.get("rules", ())))
    program = subprocess.Popen(arguments[1:], env={**proxy.environment, **fault.get("environment", {})})
    ended, tell = socket.socketpair()

    def wait() -> None:
        try:
            program.wait(_REAL_LIMIT)
        except subprocess.TimeoutExpired:
            program.kill()
        program.wait()
        tell.sendall(b"x")

    threading.Thread(target=wait, daemon=True).start()
    proxy.serve(ended)
    code = program.wait()
    if code < 0:
        signal.signal(-code, signal.SIG_DFL) if -code not in (signal.SIGKILL, signal.SIGSTOP) else None
        os.kill(os.getpid(), -code)
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
