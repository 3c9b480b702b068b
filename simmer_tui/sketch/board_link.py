"""The serial line between the laptop's program and a board, byte by byte at the line's baud.

A program opens it by the hook in its pyserial, or by a pseudo-terminal. One at a time has it open.
"""

from __future__ import annotations

import asyncio
import socket

from simmer_tui.config.dialects import SERIAL
from simmer_tui.config.settings import BITS_OF_A_BYTE, USUAL_BAUD
from simmer_tui.links.driver_lock import NOT_SERVED, DriverLock
from simmer_tui.links.hook_port import HookedProgram
from simmer_tui.links.link import LinkContext
from simmer_tui.links.peer import MOST_WAITING, PIECE, ReadBudget
from simmer_tui.links.pty_port import PtyPort
from simmer_tui.links.serial_wire import MOST_IN_TRANSIT, SerialEndpoint
from simmer_tui.run.events import ActionDone, Event, Notice, NoticeKind
from simmer_tui.sim.command import WORD, counted, cut
from simmer_tui.sketch.sketch_robot import SketchRobot

_SECOND = 1_000_000_000


def sampled(value: int, sent_at: int, read_at: int) -> int:
    """The byte that a receiver at one baud rate reads of one sent at another: it samples the middle of each
    of its own bits."""
    if sent_at == read_at:
        return value
    made = 0
    for bit in range(8):
        place = (2 * bit + 3) * sent_at // (2 * read_at)
        # Before the first data bit is the start bit, low; after the last one the line is high.
        made |= (1 if place > 8 else (value << 1 >> place) & 1) << bit
    return made


class BoardLink:
    """The laptop's end of the line."""

    def __init__(self, context: LinkContext, robot: SketchRobot) -> None:
        self.budget = ReadBudget(PIECE)
        self.engine = context.engine
        self._context = context
        self._robot = robot
        self._loop = asyncio.get_running_loop()
        self._lock = context.driver_lock or DriverLock()
        self._programs: set[HookedProgram] = set()
        self._driver: SerialEndpoint | None = None
        self._instant = context.settings.line == "instant"
        self._baud = USUAL_BAUD
        self._free = 0
        """Time until which the line to the board carries earlier bytes, nanoseconds."""
        self._has_exchanged = False
        self._has_lost = self._has_told_baud = False
        self._acceptor = context.accept(SERIAL, self._welcome)
        self._terminal: PtyPort | None = None
        robot.on_sent = self._deliver
        robot.lockstep.laptop_listens = context.clock is not None
        self.engine.watch(self._watch)
        if context.terminal is not None:
            self._terminal = PtyPort(context.terminal, self)
            where = str(context.terminal.path)
            self.engine.tell(Notice(NoticeKind.HINT, f"the board's serial port is at {where}"))

    @property
    def has_clients(self) -> bool:
        """True if a program is connected."""
        return bool(self._programs) or self._driver is not None

    def close(self) -> None:
        """End all connections."""
        self._acceptor.close()
        if self._terminal is not None:
            self._terminal.close()
        for program in tuple(self._programs):
            program.close()

    def _welcome(self, sock: socket.socket, peer: str) -> None:
        if len(self._programs) >= MOST_WAITING:
            self._acceptor.refuse(sock, peer)
            return
        self._programs.add(HookedProgram(sock, peer, self))

    def _watch(self, event: Event) -> None:
        if isinstance(event, ActionDone) and event.restarts:
            self._free = 0
            self._robot.lockstep.laptop_listens = self._context.clock is not None

    # -- the program's side ----------------------------------------------------------------------------

    def reached(self) -> None:
        """A program with the hook has begun: it will find the port."""
        self._lock.used = True

    def opened(self, endpoint: SerialEndpoint, name: str, baud: float | None) -> None:
        """Answer a program that opens a port."""
        names = self._context.settings.serial_names
        if isinstance(endpoint, HookedProgram) and names and name not in names:
            endpoint.answer(f"could not open port '{name}': there is only {', '.join(names)}")
            return
        refused = self._refused(endpoint, name)
        if refused:
            self.engine.tell_fault(f"a program opened {cut(name, WORD)}{refused}: it was refused")
            endpoint.answer(f"could not open port '{name}': Access is denied.")
            return
        self._driver = endpoint
        self._has_exchanged = self._has_told_baud = False
        rate = ""
        if baud is not None:
            self.set_baud(endpoint, baud)
            rate = f" at {baud:g} baud"
        self.engine.now()
        self._robot.reset_by_usb()
        text = f"a program opened {cut(name, WORD)}{rate}"
        self.engine.tell(Notice(NoticeKind.CONNECTED, text, endpoint.peer))
        endpoint.answer("")

    def _refused(self, endpoint: SerialEndpoint, name: str) -> str:
        if self._context.clock is not None and not endpoint.by_clock:
            return f", but {NOT_SERVED}"
        if self._driver is not None:
            return f" while another one has {cut(self._driver.port, WORD)} open"
        refused = self._lock.acquire(self, f"a program by {name}")
        return f", but {refused}" if refused else ""

    def set_baud(self, endpoint: SerialEndpoint, baud: float) -> None:
        """The program has set another baud rate."""
        if endpoint is self._driver and baud >= 1:
            self._baud = round(baud)

    def written(self, endpoint: SerialEndpoint, data: bytes) -> None:
        """The program has written bytes: they arrive at the board one after the other."""
        if endpoint is self._driver and data:
            self._has_exchanged = True
            self.send(data)

    def send(self, data: bytes) -> None:
        """Send bytes to the board, of a program or of a person."""
        now = round(self.engine.now() * _SECOND)
        board_baud = self._robot.laptop_baud
        baud = board_baud if self._instant or not board_baud or self._driver is None else self._baud
        byte = 0 if self._instant else BITS_OF_A_BYTE * _SECOND // baud
        at = max(self._free, now)
        if byte and (at - now) // byte + len(data) > MOST_IN_TRANSIT:
            if not self._has_lost:
                self._has_lost = True
                self.engine.tell_fault(
                    f"the program writes faster than the line carries: {MOST_IN_TRANSIT} bytes wait, more "
                    "are lost. A write to a real port would wait"
                )
            return
        self._compare_baud(board_baud)
        self._robot.tell_line(data.decode("latin-1"), reply=False)
        for value in data:
            at += byte
            self._robot.receive(at, value, baud)
        self._free = at

    def _compare_baud(self, board_baud: int) -> None:
        """Tell once that both ends have different rates."""
        is_other = bool(board_baud) and self._driver is not None and board_baud != self._baud
        if is_other and not self._instant and not self._has_told_baud:
            self._has_told_baud = True
            self.engine.tell_fault(
                f"the program opened the port at {self._baud} baud, the board at {board_baud}: bytes arrive "
                "wrong. Give both the same"
            )

    def waits(self, endpoint: SerialEndpoint, place: str) -> None:
        """A read of the program has waited for long."""
        if endpoint is self._driver:
            self.engine.tell_fault(f"the program waits at {cut(place)} for bytes that have not come for 10 s")

    def closed(self, endpoint: SerialEndpoint, unread: int) -> None:
        """The program has closed the port, or has ended."""
        if isinstance(endpoint, HookedProgram):
            self._programs.discard(endpoint)
        if endpoint is not self._driver:
            return
        self._driver = None
        self._lock.release(self)
        if unread:
            text = f"the program left {counted(unread, 'byte')} of the board unread"
            self.engine.tell(Notice(NoticeKind.ROBOT, text))
        text = f"the program closed {cut(endpoint.port, WORD)}"
        self.engine.tell(Notice(NoticeKind.LEFT, text, endpoint.peer))
        if self._has_exchanged:
            self._context.client_left()

    # -- the board's side ------------------------------------------------------------------------------

    def _deliver(self) -> None:
        """Pass on the bytes that the board has sent; they arrive at their times."""
        sent = self._robot.lockstep.sent
        if not sent:
            return
        # By the program's clock all that is known is passed on when the first byte arrives.
        listens = self._robot.lockstep.laptop_listens
        if listens and sent[0][0] > self._robot.lockstep.reached:
            return
        driver = self._driver
        engine, scale = self.engine, self.engine.time_scale
        board_baud = self._robot.laptop_baud or USUAL_BAUD
        byte = 0 if self._instant else BITS_OF_A_BYTE * _SECOND // board_baud
        start = 0
        if driver is not None:
            self._compare_baud(board_baud)
            self._has_exchanged = True
            for place in range(1, len(sent) + 1):
                # A gap on the line ends a piece: later bytes have times of their own.
                if place < len(sent) and sent[place][0] - sent[place - 1][0] <= byte:
                    continue
                piece = sent[start:place]
                values = (each for _, each in piece)
                data = bytes(
                    each if self._instant else sampled(each, board_baud, self._baud) for each in values
                )
                begin = engine.clock_time((piece[0][0] - byte) / _SECOND)
                driver.deliver(begin, byte / _SECOND / scale, data)
                start = place
        sent.clear()
        clock = self._context.clock
        if clock is not None:
            clock.note()
