"""Mistakes of a new program with its connections: each is recognised and reported once a run.

A program whose first attempt fails waits without a message, or reads nonsense. Nothing on its own side shows
the reason. `BinaryLink` and `PacketLink` report what they see here; a recognised mistake becomes a notice.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from simmer_tui.config.dialects import BELIEFS, COMMANDS, PACKETS, REPLIES
from simmer_tui.config.reply_formats import ReplyForm, ReplyFormat
from simmer_tui.links.peer import Peer
from simmer_tui.links.ports import Listener
from simmer_tui.links.processes import ProcessLookup
from simmer_tui.links.protocol import diagnosis
from simmer_tui.links.protocol.diagnosis import Diagnosis
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.timers import LoopTimer
from simmer_tui.run.events import Notice, NoticeKind
from simmer_tui.sim.command import Command, counted
from simmer_tui.sim.records import CommandResult, Status

# Judged: longer than a program runs that gives up on replies it cannot read, shorter than a useful run.
EARLY = 10.0
"""Seconds after its first reply within which a program that leaves has probably not understood it."""
# Judged: programs open their two connections within milliseconds, and read a reply as soon as it comes.
LONE_LIMIT = 3.0
"""Seconds for which a lone connection to the reply port, or an unread reply, may wait."""
CHECK_TIMES = (0.5, 1.0, 2.0, LONE_LIMIT)
"""Seconds after a first reply at which its unread bytes are checked."""
# A program that has read its first replies correctly does not begin to misread later ones.
CHECKED_COMMANDS = 5
"""Commands of a client whose values are checked."""


class ConnectionDoctor:
    """Reports each mistake once. All methods are called in the robot's event loop."""

    def __init__(
        self, engine: Engine, listeners: Mapping[str, Listener], processes: ProcessLookup | None = None
    ) -> None:
        """Without `processes` the unread bytes of a program are not known."""
        self._engine = engine
        self.processes = processes
        self._told: set[str] = set()
        self._ports = {purpose: listener.port for purpose, listener in listeners.items()}
        others = {"packets": PACKETS.purpose, "beliefs": BELIEFS.purpose}
        self._others = {name: self._ports[each] for name, each in others.items() if each in self._ports}

    def tell(self, finding: Diagnosis | None) -> None:
        """Report a mistake, unless it has been reported before."""
        if finding is not None and finding.name not in self._told:
            self._told.add(finding.name)
            self._engine.tell(Notice(NoticeKind.FAULT, finding.text, advice=True))

    def has_reported(self, name: str) -> bool:
        """True if a mistake of this name has been reported."""
        return name in self._told

    @property
    def ports_of_lines(self) -> tuple[int, int]:
        """The numbers of the command port and the reply port."""
        return self._ports[COMMANDS.purpose], self._ports[REPLIES.purpose]

    def _codes(self, *, enabled: bool = True) -> frozenset[str]:
        """Codes of the set's rows that are enabled, or of those that are not."""
        spec = self._engine.simulator.spec
        rows = (*spec.sensors, *spec.drive_rows, *spec.velocities)
        return frozenset(row.code for row in rows if row.enabled is enabled)

    # -- the reply port ------------------------------------------------------------------------------

    def alone(self, peer: str) -> None:
        """Check a connection to the reply port that has waited without one to the command port."""
        commands, replies = self.ports_of_lines
        text = f"{peer} is connected only to the reply port {replies}"
        self.tell(Diagnosis("reply port alone", f"{text}: connect to the command port {commands} too"))

    def sent_to_reply_port(self, peer: str) -> None:
        """Report that a program that has sent nothing to the command port has sent something to the reply
        port."""
        commands, replies = self.ports_of_lines
        text = f"{peer} sends to the reply port {replies}: send commands to port {commands}"
        self.tell(Diagnosis("commands on the reply port", text))

    def too_late(self, peer: str) -> None:
        """Report a connection to the reply port that came after the client's first reply."""
        commands, replies = self.ports_of_lines
        text = (
            f"{peer} connected to port {replies} after its first command. That reply went back on port "
            f"{commands}: connect to both before the first command"
        )
        self.tell(Diagnosis("reply port too late", text))

    # -- what a program sends ----------------------------------------------------------------------

    def refused(self, result: CommandResult, port: int | None = None) -> None:
        """Look for a mistake in the text of a refused command. `port` is the line port's number if the
        command came as a line."""
        if port is not None:
            self.tell(diagnosis.wrong_protocol(result.command.text, port, self._others))
        if result.status is Status.UNKNOWN and result.command.code.endswith("0"):
            self.tell(
                diagnosis.code_from_zero(result.command.code, self._codes(), self._codes(enabled=False))
            )

    def packet_came(self, data: bytes) -> None:
        """Check the first bytes of a connection on the packet port."""
        port = self._ports[PACKETS.purpose]
        self.tell(diagnosis.wrong_packet(data, port, self._ports.get(COMMANDS.purpose)))

    def bare(self, command: Command) -> None:
        """Report a command without a line end."""
        self.tell(diagnosis.joined(command.text, self._codes()))


class ClientWatch:
    """One client of the binary ports: which of its replies it reads, and when it leaves."""

    def __init__(self, doctor: ConnectionDoctor, client: Peer, form: ReplyForm, size: int) -> None:
        self._doctor = doctor
        self._client = client
        self._size = size
        # Big-endian doubles are what a program expects that sets nothing.
        self._usual = form == ReplyForm(ReplyFormat.FLOAT64, "big")
        self._form = f"{size} bytes, {form.byte_order}-endian"
        self._first = self._form
        """Form of its first reply."""
        self._ports = doctor.ports_of_lines
        self._loop = asyncio.get_running_loop()
        self._first_reply: float | None = None
        self._route = client
        self.commands = 0
        """Commands that were answered."""
        self._timers: list[asyncio.TimerHandle] = []
        self._line_end = LoopTimer(doctor.tell, self._loop)

    # -- what it sends -------------------------------------------------------------------------------

    def line_began(self, rest: bytes) -> None:
        """Bytes of a line have come, or its end (no bytes). Reported if the rest of the line does not
        come."""
        self._line_end.cancel()
        if rest and not self._doctor.has_reported("line without an end"):
            self._line_end.set_in(1.0, diagnosis.without_end(rest, self._client.peer))

    # -- its replies -----------------------------------------------------------------------------------

    def answered(self, result: CommandResult, route: Peer) -> None:
        """Watch whether a command's reply is read; it was sent on the connection `route`. Called for the
        first `CHECKED_COMMANDS`, and for those that were refused."""
        status = result.status
        if status is Status.REFUSED or status is Status.UNKNOWN:
            self._doctor.refused(result, self._ports[0])
        if self.commands == 1:
            self._first_reply, self._route = self._loop.time(), route
            if result.ranges is not None:
                self._first = f"a count and {counted(len(result.ranges), 'number')} of {self._form}"
            self._timers = [self._loop.call_later(wait, self._look, wait) for wait in CHECK_TIMES]
        elif self.commands <= CHECKED_COMMANDS and _asks_nonsense(result):
            self._misread(f"'{result.command.shown}' makes no sense as a movement: ")

    def _look(self, waited: float) -> None:
        processes, route = self._doctor.processes, self._route
        # Bytes of replies that the program has received and not read, if that is known.
        unread = None if processes is None else processes.unread(route.sock, route.peer)
        if not unread or self._client.lost:
            return
        if unread % self._size:
            self._misread(f"client {self._client.peer} has read a part of its reply: ")
        elif waited == CHECK_TIMES[-1] and unread >= self.commands * self._size:
            self._left_unread(f"client {self._client.peer} waits and has not read its reply: ")

    def left(self, *, ended_with_error: bool) -> None:
        """The client has closed. A connection closed with unread bytes is reset (RFC 1122, 4.2.2.13)."""
        self._line_end.cancel()
        for timer in self._timers:
            timer.cancel()
        if self._first_reply is None or self._loop.time() - self._first_reply > EARLY or self.commands > 1:
            return
        waited = self._loop.time() - self._first_reply
        if ended_with_error:
            self._left_unread(f"client {self._client.peer} left without reading its first reply: ")
        # A program that needs one reading leaves as soon as it has it; one that expects more bytes waits.
        elif not self._usual and waited >= CHECK_TIMES[0]:
            self._misread(f"client {self._client.peer} waited after its first reply and left: ")

    def _misread(self, what: str) -> None:
        text = f"{what}replies here are {self._form}; --reply-format and --byte-order change that"
        self._doctor.tell(Diagnosis("replies misread", text))

    def _left_unread(self, what: str) -> None:
        commands, replies = self._ports
        if self._route is self._client:
            where = f"it came back on port {commands}, since nothing was connected to {replies} before"
        else:
            where = f"it came on port {replies}, where the program is connected too; read it there"
        self._doctor.tell(Diagnosis("reply unread", f"{what}{where}. It has {self._first}"))


def _asks_nonsense(result: CommandResult) -> bool:
    """True if the value of a command looks like a misread reply; a lidar takes any number as a bearing."""
    reading = result.reading
    if reading is not None and reading.sensor.kind.is_scan:
        return False
    return diagnosis.is_nonsense(result.command.argument)
