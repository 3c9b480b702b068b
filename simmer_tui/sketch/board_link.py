"""The serial line between the laptop's program and a board, byte by byte at the line's baud.

A program opens it by the hook in its pyserial, or by a pseudo-terminal. One at a time has it open.
"""

from __future__ import annotations

from collections.abc import Sequence

from simmer_tui.config.settings import BITS_OF_A_BYTE, USUAL_BAUD
from simmer_tui.links.link import LinkContext
from simmer_tui.links.port_link import PortLink
from simmer_tui.links.serial_wire import MOST_IN_TRANSIT, LostBytes, SerialEndpoint
from simmer_tui.run.events import ActionDone, Event
from simmer_tui.sim.command import WORD, cut
from simmer_tui.sketch.parts import SECOND
from simmer_tui.sketch.sketch_robot import SketchRobot


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


class UnwiredLink(PortLink):
    """The port of a program where no board has a line to it: it cannot be opened, and the reason is told."""

    device = "board"

    def __init__(self, context: LinkContext, boards: Sequence[str]) -> None:
        super().__init__(context)
        self._boards = boards

    def _watch(self, event: Event) -> None:
        """A program may do without the port."""

    def opened(self, endpoint: SerialEndpoint, name: str, baud: float | None) -> None:
        """Refuse the port."""
        boards = " or ".join(f'board = "{each}"' for each in self._boards)
        why = f"wiring.toml has no [laptop], the line of a board to the program. Add it, with {boards}"
        self.engine.tell_fault(f"a program opened {cut(name, WORD)}, but {why}")
        endpoint.answer(f"could not open port '{name}': {why}")

    def send(self, data: bytes) -> None:
        """No board has the line."""

    def _joined(self, baud: float | None) -> None: ...

    def _set_rate(self, baud: float) -> None: ...

    def _flush(self) -> None: ...

    def _left(self, endpoint: SerialEndpoint) -> None: ...


class BoardLink(PortLink):
    """The laptop's end of the line."""

    device = "board"

    def __init__(self, context: LinkContext, robot: SketchRobot) -> None:
        super().__init__(context)
        self._robot = robot
        self._baud = USUAL_BAUD
        self._free = 0
        """Time until which the line to the board carries earlier bytes, nanoseconds."""
        self._lost = LostBytes(self.engine)
        self._has_told_baud = False
        robot.on_sent = self._deliver
        robot.lockstep.laptop_listens = context.clock is not None

    def _watch(self, event: Event) -> None:
        super()._watch(event)
        if isinstance(event, ActionDone) and event.restarts:
            self._free = 0
            self._robot.lockstep.laptop_listens = self._context.clock is not None

    # -- the program's side ----------------------------------------------------------------------------

    def _joined(self, baud: float | None) -> None:
        self._has_told_baud = False
        self._lost = LostBytes(self.engine)  # what a person sent before is not this program's
        self._robot.reset_by_usb()

    def _set_rate(self, baud: float) -> None:
        if baud >= 1:
            self._baud = round(baud)

    def _flush(self) -> None:
        self._lost.report()

    def _left(self, endpoint: SerialEndpoint) -> None:
        """The board runs on."""

    def send(self, data: bytes) -> None:
        """Send bytes to the board, of a program or of a person. What the line cannot keep is lost."""
        now = round(self.engine.now() * SECOND)
        board_baud = self._robot.laptop_baud
        # A port that the sketch has not opened yet has no rate, and takes no byte.
        has_own_rate = bool(board_baud) and self._driver is not None and not self._instant
        baud = self._baud if has_own_rate else board_baud or USUAL_BAUD
        byte = 0 if self._instant else BITS_OF_A_BYTE * SECOND // baud
        at = max(self._free, now)
        if byte:
            room = max(MOST_IN_TRANSIT - (at - now) // byte, 0)
            if self._driver is not None:
                self._lost.add(len(data) - room)
            data = data[:room]
        if not data:
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
        byte = 0 if self._instant else BITS_OF_A_BYTE * SECOND // board_baud
        start = 0
        if driver is not None:
            self._compare_baud(board_baud)
            self._has_exchanged = True
            for place in range(1, len(sent) + 1):
                # A gap on the line ends a piece: later bytes have times of their own.
                if place < len(sent) and sent[place][0] - sent[place - 1][0] <= byte:
                    continue
                piece = sent[start:place]
                data = bytes([value for _, value in piece])
                if not self._instant and board_baud != self._baud:
                    data = bytes([sampled(value, board_baud, self._baud) for value in data])
                begin = engine.clock_time((piece[0][0] - byte) / SECOND)
                driver.deliver(begin, byte / SECOND / scale, data)
                start = place
        sent.clear()
        clock = self._context.clock
        if clock is not None:
            clock.note()
