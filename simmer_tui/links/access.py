"""Access control: the same rule on every port admits our own user's programs, and connections that send the
token.

Only Linux reports the user of a local connection. On other systems only the token counts.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from dataclasses import dataclass
from ipaddress import ip_address

from simmer_tui import platform_has
from simmer_tui.links.owners import OwnerLookup, is_reset
from simmer_tui.links.peer import CLOSING, host_of
from simmer_tui.links.protocol.line_marks import without_marks
from simmer_tui.robot.program_clock import clock_of
from simmer_tui.run.events import Event, Notice, NoticeKind
from simmer_tui.sim.command import WORD, cut

# The length of the longest command: a program without a token sends a command first.
LONGEST_TOKEN = 256
"""Bytes of a first line in which a token is looked for."""
# Judged: a program that retries in a loop must not fill log and screen.
_AGAIN = 1.0
"""Seconds before the same notice is repeated."""


class RefusalNotices:
    """Notices of refused connections: at most one a second for each reason."""

    def __init__(self, publish: Callable[[Event], None]) -> None:
        """`publish` passes events to the watchers. Needs a running event loop; its clock is used."""
        self._publish = publish
        self._loop = asyncio.get_running_loop()
        self._reported: dict[str, float] = {}

    def tell(self, text: str, reason: str = "") -> None:
        """Report a refused connection, unless the same `reason` (by default the text) was reported within
        the last second."""
        # Texts contain the client's port, which changes; the reason does not.
        reason = reason or text
        now = self._loop.time()
        if now >= self._reported.get(reason, now):
            self._reported = {each: until for each, until in self._reported.items() if until > now}
            self._reported[reason] = now + _AGAIN
            self._publish(Notice(NoticeKind.TURNED_AWAY, text))


class AccessCheck:
    """The rule that admits or refuses connections."""

    def __init__(
        self,
        publish: Callable[[Event], None],
        owners: OwnerLookup | None = None,
        *,
        token: str = "",
        way_in: str = "--any-user lets all users of this machine in",
    ) -> None:
        """Without `owners` programs of other users of this machine may connect.

        `publish` passes events to the watchers. With a `token`, each connection has to send it as its first
        line. `way_in` is advice for other users in the notice. Needs a running event loop.
        """
        self.tell = RefusalNotices(publish).tell
        self._way_in = way_in
        self._owners = owners
        self._token = token.encode()
        self._stranger_seen = False
        """True once a connection of another user has been seen on any port of this run."""

    def admits(self, sock: socket.socket, there: tuple[str, int]) -> bool:
        """True if the program at the other end, `there`, may connect. If not, a notice names its owner."""
        if self._owners is None:
            return True
        uid = self._owners.owner(sock, there)
        if uid is None:
            return self._admits_unknown(self._owners, sock, there)
        # The administrator can do everything anyway; services and containers often run as this user.
        if uid in (0, platform_has.user_id()):
            return True
        self._stranger_seen = True
        user = cut(platform_has.user_name(uid), WORD)
        self.tell(
            f"a program of user {user} turned away from port {sock.getsockname()[1]}: this robot is "
            f"somebody else's; {self._way_in}"
        )
        return False

    def _admits_unknown(self, owners: OwnerLookup, sock: socket.socket, there: tuple[str, int]) -> bool:
        """True if a connection of an unknown owner may stay."""
        # it is on another machine, or will be asked for the token
        if self._token or not ip_address(there[0]).is_loopback:
            return True
        if is_reset(sock):
            what = "it broke off"
        elif owners.is_complete:  # its user would be known if it had connected as usual programs do
            what = "it was closed"
        # Older kernels do not report a connection that its program has closed already, as programs with
        # simmer-python do.
        elif self._stranger_seen:
            what = "it was closed, and other users connect as well"
        else:
            return True
        self.tell(
            f"a connection turned away from port {sock.getsockname()[1]}: its user is unknown, "
            f"{what}. Set a --token",
            "its user is unknown",
        )
        return False

    def check_token(
        self, sock: socket.socket, peer: str, decided: Callable[[TokenCheck, bool], None]
    ) -> TokenCheck | None:
        """Wait for the token on a connection, then call `decided`. None if no token is asked for."""
        return TokenCheck(self, sock, peer, decided) if self._token else None

    def is_token(self, line: bytes) -> bool:
        """True if a first line is the token."""
        # Some milliseconds with what it imports, which a start without a token saves.
        import hmac

        # Compared in constant time: the time of == shows how many characters are right.
        return hmac.compare_digest(line.removesuffix(b"\r"), self._token)


@dataclass(eq=False)
class TokenCheck:
    """A connection whose first line has not arrived yet. No byte after that line is consumed."""

    access: AccessCheck
    sock: socket.socket
    peer: str
    decided: Callable[[TokenCheck, bool], None]

    def __post_init__(self) -> None:
        self._line = b""
        self._loop = asyncio.get_running_loop()
        self._timeout = self._loop.call_later(CLOSING, self._decide, False)
        self._loop.add_reader(self.sock, self.look)

    def look(self) -> None:
        """Check whether the line has arrived."""
        try:
            # Peeked at first: the bytes after the line are commands, and must stay in the socket.
            seen = self.sock.recv(LONGEST_TOKEN, socket.MSG_PEEK)
            line, end, _ = seen.partition(b"\n")
            self._line += self.sock.recv(len(line + end)) if seen else b""
            clock = clock_of(self._loop)
            if clock is not None:
                clock.received += len(line + end)
        except BlockingIOError:
            return
        except OSError:
            self._decide(False)
            return
        if end:
            self._decide(self.access.is_token(without_marks(self._line.removesuffix(b"\n"))))
        # The other end has closed, or has sent as many bytes as a line may have, without a line end.
        elif not seen or len(self._line) > LONGEST_TOKEN:
            self._decide(False)

    def cancel(self) -> None:
        """Stop waiting for the token, without calling `decided`."""
        self._timeout.cancel()
        self._loop.remove_reader(self.sock)

    def _decide(self, good: bool) -> None:
        self.cancel()
        if not good:
            self.access.tell(
                f"a connection from {host_of(self.peer)} turned away: its first line is not the --token"
            )
        self.decided(self, good)
