"""The connections that are admitted, by the same rule on every port: those of our own user, and those with
the token."""

from __future__ import annotations

import asyncio
import hmac
import socket
from collections.abc import Callable
from ipaddress import ip_address

from simmer_tui.engine import Engine
from simmer_tui.events import Notice, NoticeKind
from simmer_tui.links.owner import OwnerLookup, ourselves, user_name
from simmer_tui.links.peer import CLOSING
from simmer_tui.sim.command import escape

LONGEST_TOKEN = 256
"""Bytes of a first line in which a token is looked for."""
_AGAIN = 1.0
"""Seconds before the same complaint is told again."""


class TurnedAwayNotices:
    """The notices that say who was turned away: of many, one line a second."""

    def __init__(self, engine: Engine) -> None:
        """Needs a running event loop, whose clock it goes by."""
        self._engine = engine
        self._loop = asyncio.get_running_loop()
        self._told: dict[str, float] = {}

    def tell(self, text: str, complaint: str = "") -> None:
        """Say why somebody was turned away, unless the same `complaint` (by default the text) was
        told within the last second."""
        complaint = complaint or text
        now = self._loop.time()
        if now >= self._told.get(complaint, now):
            self._told = {each: until for each, until in self._told.items() if until > now}
            self._told[complaint] = now + _AGAIN
            self._engine.tell(Notice(NoticeKind.TURNED_AWAY, text))


class AccessCheck:
    """The rule for admission of connections."""

    def __init__(self, engine: Engine, *, any_user: bool = True, token: str = "") -> None:
        """`any_user` lets programs of other users of this machine in. With a `token`, each
        connection has to send it as its first line."""
        self.tell = TurnedAwayNotices(engine).tell
        self._lookup = None if any_user else OwnerLookup()
        self._token = token.encode()
        self._ours = ourselves()
        self._stranger: int | None = None
        """The user seen last, if it was another one."""

    def close(self) -> None:
        """Stop looking up the owners of connections."""
        if self._lookup is not None:
            self._lookup.close()

    def admits(self, sock: socket.socket, there: tuple[str, int]) -> bool:
        """True if the program at the other end, `there`, may connect. If not, a notice names its owner."""
        if self._lookup is None:
            return True
        uid = self._lookup.owner(sock, there)
        if uid in self._ours:
            self._stranger = None
            return True
        if uid is None:
            # On another machine; or its program has closed it already, as those of simmer-python do, and
            # the system does not tell any more. It will be that of whoever was seen last.
            if self._stranger is None or not ip_address(there[0]).is_loopback:
                return True
            uid = self._stranger
        self._stranger = uid
        user = escape(user_name(uid), 40)
        self.tell(
            f"a program of user {user} turned away from port {sock.getsockname()[1]}: this robot is "
            "somebody else's; --any-user lets all users of this machine in"
        )
        return False

    def check_token(
        self, sock: socket.socket, peer: str, decided: Callable[[TokenCheck, bool], None]
    ) -> TokenCheck | None:
        """Wait for the token on a connection, then call `decided`. None if no token is asked for."""
        return TokenCheck(self, sock, peer, decided) if self._token else None

    def is_token(self, line: bytes) -> bool:
        """True if a first line is the token."""
        return hmac.compare_digest(line.removesuffix(b"\r"), self._token)


class TokenCheck:
    """A connection whose first line has not arrived yet. No byte after that line is consumed."""

    def __init__(
        self,
        access: AccessCheck,
        sock: socket.socket,
        peer: str,
        decided: Callable[[TokenCheck, bool], None],
    ) -> None:
        self.sock = sock
        self.peer = peer
        self._access = access
        self._decided = decided
        self._line = b""
        self._open = True
        self._loop = asyncio.get_running_loop()
        self._patience = self._loop.call_later(CLOSING, self._decide, False)
        self._loop.add_reader(sock, self.look)

    def look(self) -> None:
        """Check whether the line has arrived."""
        if not self._open:
            return
        try:
            seen = self.sock.recv(LONGEST_TOKEN, socket.MSG_PEEK)
            line, end, _ = seen.partition(b"\n")
            self._line += self.sock.recv(len(line + end)) if seen else b""
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            self._decide(False)
            return
        if end:
            self._decide(self._access.is_token(self._line.removesuffix(b"\n")))
        elif not seen or len(self._line) > LONGEST_TOKEN:
            self._decide(False)

    def cancel(self) -> None:
        """Stop waiting for the token, without calling `decided`."""
        if self._open:
            self._open = False
            self._patience.cancel()
            self._loop.remove_reader(self.sock)

    def _decide(self, good: bool) -> None:
        self.cancel()
        if not good:
            host = self.peer.rpartition(":")[0]
            self._access.tell(f"a connection from {host} turned away: its first line is not the --token")
        self._decided(self, good)
