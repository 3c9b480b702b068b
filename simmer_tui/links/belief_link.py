"""The port where programs report the pose they believe in: newline-delimited JSON, one belief a line.

A line may also ask why a command was refused, and what its code represents, or for the variables of a program
that somebody else starts. The answer goes back on the same connection.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Mapping

from simmer_tui.config.dialects import BELIEFS
from simmer_tui.errors import UnknownSensorError
from simmer_tui.links.link import LinkContext
from simmer_tui.links.peer import MOST_WAITING, Peer, ReadBudget
from simmer_tui.links.protocol.line_marks import without_marks
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import EventHandler
from simmer_tui.sim.command import parse_command
from simmer_tui.sim.records import REFUSALS, CommandResult

VARIABLES_QUESTION = {"variables": True}
"""The question for the variables of a program."""

# A program asks right after a refusal; few other commands are refused in between.
MOST_KEPT = 64
"""Refused commands whose reasons are kept, the newest."""


class Questions(EventHandler[None]):
    """Answers `{"why": "d1-1e9"}` with this simulator's ports, the kind of the code, and the reason of the
    refusal, and `{"variables": true}` with the variables of a program, by name.

    The reason is that of the newest refusal of the command; `early` is true if the command may be accepted
    later. `scan` is true for a lidar's code, `gripper` for the gripper's. In the protocols NaN is the only
    sign of a refusal.
    """

    def __init__(
        self, engine: Engine, ports: list[int], variables: Callable[[], Mapping[str, str]] = dict
    ) -> None:
        """`ports` are this simulator's: a program that asks the wrong simulator notices it by them."""
        self._engine = engine
        self._ports = ports
        self._variables = variables
        self._refused: dict[str, CommandResult] = {}
        engine.watch(self.handle)

    def close(self) -> None:
        """Stop keeping refusals."""
        self._engine.unwatch(self.handle)

    def on_result(self, event: CommandResult) -> None:
        if event.status not in REFUSALS:
            return
        text = event.command.text.strip()
        self._refused.pop(text, None)  # the newest one is last
        self._refused[text] = event
        if len(self._refused) > MOST_KEPT:
            del self._refused[next(iter(self._refused))]

    def answer(self, line: bytes) -> bytes | None:
        """The answer to a line, with its end; None if the line asks nothing."""
        # Nearly every line is a belief, and may be long: it is parsed only once.
        if len(line) > 1024 or not (b'"why"' in line or b'"variables"' in line):
            return None
        import json  # few programs ask, and it takes time to load

        try:
            question = json.loads(line)
        except (ValueError, RecursionError):
            return None
        if question == VARIABLES_QUESTION:
            return json.dumps({"variables": dict(self._variables())}).encode() + b"\n"
        if not isinstance(question, dict) or set(question) != {"why"} or not isinstance(question["why"], str):
            return None
        text = question["why"].strip()
        refused, kind = self._refused.get(text), self._kind(text)
        reason = "" if refused is None else refused.reason
        answer: dict[str, object] = {"why": reason, "kind": kind, "ports": self._ports}
        if refused is not None and refused.is_early:
            answer["early"] = True
        if self._engine.simulator.asks_for_scan(parse_command(text)):
            answer["scan"] = True
        gripper = self._engine.simulator.spec.gripper
        if gripper is not None and parse_command(text).code == gripper.code:
            answer["gripper"] = True
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


# A grid of 65,536 states takes 341 kB packed and, as a list, at most some 15 bytes a state.
LONGEST_LINE = 1024 * 1024
"""Longest line, bytes."""
_TOO_LONG = f"a line has at most {LONGEST_LINE >> 20} MB; send a grid as f32, as believe() does"
# Reading bytes costs little, parsing a line much, even a short one.
_TURN, LINE = 128 * 1024, 4 * 1024
"""Limits of one turn of the event loop: bytes read, including a surcharge for each parsed line, bytes.

They allow 32 lines, or one line with some 5,000 particles, which takes 3 to 8 ms.
"""


class _BeliefPeer(Peer):
    """One program's connection."""

    piece = 64 * 1024

    def __init__(self, sock: socket.socket, peer: str, link: BeliefLink) -> None:
        super().__init__(sock, peer, link.budget)
        self._link = link
        self._buffer = bytearray()
        self._seen = 0
        """Bytes of the buffer known to hold no line end."""
        self._reported = False
        self.last_received = self._loop.time()
        """Time of the last received bytes, at first of the connection, by the loop's clock."""

    def data_received(self, data: bytes) -> None:
        self.last_received = self._loop.time()
        self._buffer += data
        self._take_lines()

    def connection_lost(self, error: OSError | None) -> None:
        self._link.peer_lost(self)

    def read_all(self) -> None:
        """Read what has come, within the budget of this turn of the event loop."""
        self._take_lines()
        while self._budget.left > 0 and self._reading and self.read():
            pass

    def _take_lines(self) -> None:
        while self._budget.left > 0:
            end = self._buffer.find(b"\n", self._seen)
            if end < 0:
                self._seen = len(self._buffer)
                if self._seen > LONGEST_LINE:
                    self._buffer.clear()
                    self._seen = 0
                    self._report(_TOO_LONG)
                if self._held:
                    self.hold(False)
                return
            line = bytes(self._buffer[:end])
            del self._buffer[: end + 1]
            self._seen = 0
            self._budget.spend(LINE + len(line))
            if len(line) > LONGEST_LINE:
                self._report(_TOO_LONG)
            elif (line := without_marks(line)).strip():
                self._take(line)
        if not self._held:
            self.hold(True)
        self._budget.wait(self._go_on)

    def _go_on(self) -> None:
        if not self._finished:
            self._take_lines()

    def _take(self, line: bytes) -> None:
        answer = self._link.questions.answer(line)
        if answer is not None:
            if not self.write(answer):  # it keeps asking, and never reads
                self.abort()
            return
        # Imported here, since few programs send beliefs and it takes a hundredth of the start.
        from simmer_tui.links.belief_parser import parse_belief

        engine = self._link.engine
        time, simulator = engine.now(), engine.simulator
        try:
            engine.tell(parse_belief(line, time, simulator.pose, self._link.whole))
        except ValueError as error:
            self._report(str(error))

    def _report(self, reason: str) -> None:
        if not self._reported:  # a faulty program usually repeats its fault in every line
            self._reported = True
            self._link.engine.tell_fault(f"belief not understood: {reason}")


class BeliefLink:
    """Serves the belief port; several programs may be connected.

    A belief is compared with the pose at its moment. Beliefs and commands come on different connections, so
    before each movement the engine has the arrived beliefs read. The budget of a turn of the event loop
    limits them.
    """

    def __init__(self, context: LinkContext) -> None:
        """Begin to listen. Needs a running event loop."""
        self.engine = context.engine
        maze = context.engine.simulator.spec.maze
        self.whole = (0.0, 0.0, maze.width, maze.height)
        """Bounds of the maze, inches."""
        self.budget = ReadBudget(_TURN)
        ports = [each.port for each in context.listeners.values()]
        self.questions = Questions(context.engine, ports, context.variables)
        self._peers: dict[_BeliefPeer, None] = {}
        self._acceptor = context.accept(BELIEFS, self._welcome)

    def _welcome(self, sock: socket.socket, peer: str) -> None:
        if len(self._peers) >= MOST_WAITING:
            self._make_room()
        self._peers[_BeliefPeer(sock, peer, self)] = None
        # Only while a program is connected: without beliefs a drive costs nothing more.
        self.engine.before_drive = self._read_all

    def _make_room(self) -> None:
        """Close the connection that has been silent longest, unless others have closed by now."""
        self._read_all()  # some of those accepted in this turn may have sent a belief and closed already
        present = [peer for peer in self._peers if not peer.has_left()]
        if len(present) >= MOST_WAITING:
            silent = min(present, key=lambda peer: peer.last_received)
            text = f"belief connection {silent.peer} closed: {MOST_WAITING} at once are the most"
            self.engine.tell_fault(text)
            silent.abort()
            self.peer_lost(silent)

    def _read_all(self) -> None:
        for peer in tuple(self._peers):
            peer.read_all()

    def peer_lost(self, peer: _BeliefPeer) -> None:
        """Remove a connection that has ended."""
        self._peers.pop(peer, None)
        if not self._peers:
            self.engine.before_drive = None

    @property
    def has_clients(self) -> bool:
        """True if a program is connected."""
        return bool(self._peers)

    def close(self) -> None:
        """Stop listening and end all connections."""
        self._acceptor.close()
        self.questions.close()
        for peer in tuple(self._peers):
            peer.abort()
