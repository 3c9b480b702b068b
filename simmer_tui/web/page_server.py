"""The page's own thread: it receives the run's events, encodes the news once, and sends it to all viewers.

The robot's thread never waits for it: events come over a queue, and commands take the path of the console's.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import sys
import threading
from collections import deque
from functools import partial
from http import HTTPStatus
from typing import Any, NamedTuple

import msgspec
from msgspec import Struct
from websockets.datastructures import MultipleValuesError
from websockets.http11 import Request, Response

from simmer_tui.config.settings import WEB_PORT
from simmer_tui.errors import PortError, printable
from simmer_tui.links.access import AccessCheck
from simmer_tui.links.owners import OwnerLookup
from simmer_tui.links.peer import MOST_CONNECTIONS, MOST_WAITING, PIECE, ReadBudget
from simmer_tui.links.ports import Acceptor, Listener, PortRequest, take_port
from simmer_tui.live.server import Server
from simmer_tui.report.verdict import Verdict
from simmer_tui.web.live_page import PageResponses, live_html
from simmer_tui.web.page_access import PageAccess, PageLink, PageRole, shown_host
from simmer_tui.web.page_control import BUTTONS, PageControl, page_keys
from simmer_tui.web.run_frames import RunFrames
from simmer_tui.web.viewer import Viewer, framed

_LOCAL = "127.0.0.1"
# In timed motion the picture should be at most 0.2 s old; 50 ms of it are between two frames.
_TIMED, _INSTANT = 0.05, 0.1
"""Seconds between two frames, in timed motion and in instant motion."""
# The picture is older by their distance: with 4 it was 0.2 s old, and 0.3 on a busy machine.
_STILL = 2
"""In timed motion one of so many frames is sent while the robot stands and there is no event."""
_HEARTBEAT = 2.0
"""Seconds after which viewers get a sign of life without news."""
# Judged: browsers send the word as soon as they are connected.
_TO_JOIN = 5.0
"""Seconds within which a connection must have requested the page, or sent its word."""
_WRONG_WORD = 1.0
"""Seconds of delay for a wrong word, which limits guessing."""
# A browser's request comes with its connection, or some milliseconds later. Waiting sockets cost nothing, and
# the more there are the longer each may stay silent while others come in a loop.
_MOST_SILENT = MOST_CONNECTIONS
"""Connections kept that have said nothing; the oldest goes first."""
# A page is one request and one viewer. Requests that come faster wait.
_MOST_AT_ONCE, _BREATHER = 20, 0.1
"""Connections whose request is read in so many seconds."""
_ENDING = 1.0
"""Seconds within which the thread must end."""
# At each system call the robot's thread gives the interpreter's lock away, and waits for it so long if the
# page's thread is busy. With Python's 5 ms a page that floods made a round trip of `u1` 5 ms or longer; with
# this it is 0.04 ms.
_SWITCH = 0.0005
"""Seconds after which a thread gives the lock to one that waits, while there is a page."""
LIVE = "/live"
"""The path that viewers' connections request."""
_WRONG, _MALFORMED, _GOING_AWAY = 4401, 4400, 1001
"""Codes with which a connection is closed: wrong word, unknown message, the run is over."""


class ViewerMessage(Struct):
    """A message from a browser: first the word, then lines and keys."""

    word: str | None = None
    line: str = ""
    key: str = ""
    fine: bool = False


class _Silent(NamedTuple):
    name: str
    came: float
    """Time of its beginning, by the loop's clock."""


class PageServer:
    """Shows a run in browsers."""

    def __init__(self, server: Server) -> None:
        """Take the page's port, before `server` starts. Raises PortError."""
        settings = server.configuration.settings
        self._settings = settings.web
        self._server = server
        self._listener = self._take_port()
        self._owners = None if self._settings.host else OwnerLookup()
        for sock in self._listener.sockets if self._owners is not None else ():
            self._owners.hold_ends(sock)  # type: ignore[union-attr]
        # If the system does not report owners, other users of this machine need a word as well.
        names = self._settings.names
        words = self._owners is None or not self._owners.is_possible or bool(names)
        host = self._settings.host
        self._access = PageAccess(words=words, control=self._settings.control, host=host, names=names)
        self.links: tuple[PageLink, ...] = self._access.links(
            shown_host(host) if host else _LOCAL, self._listener.port
        )
        """The links to the page. Whoever has one may come in, so that no log has them."""
        self._task = server.task
        self._responses = PageResponses(live_html(server.configuration, self._task, server.seed))
        self._loop = asyncio.SelectorEventLoop()
        self._thread = threading.Thread(target=self._run, name="page", daemon=True)
        self._period = _TIMED if server.engine.timed else _INSTANT
        self._viewers: set[Viewer] = set()
        self._controls: dict[Viewer, PageControl] = {}
        """Those viewers that drive."""
        self._strangers: dict[Viewer, None] = {}
        """Connections that have not said a word, the oldest first."""
        self._silent: dict[socket.socket, _Silent] = {}
        """Connections that have said nothing at all, the oldest first."""
        self._spoken: deque[tuple[socket.socket, str]] = deque()
        """Connections whose request waits to be read."""
        self._sent = 0.0
        self._ticks = self._let_in = 0
        self._is_asking = False
        """True while the robot's thread has not said how far simulated time has come."""
        self._is_ending = False

    def _take_port(self) -> Listener:
        host = self._settings.host or _LOCAL
        request = PortRequest(int(self._settings.port), "page", "--web")
        try:
            return take_port(host, request)
        except PortError as error:
            if self._settings.port != WEB_PORT:
                raise PortError(str(error).replace("--host", "--web-host")) from None
        # Several people on one machine may each have a page.
        listener = take_port(host, PortRequest(0, "page", "--web"))
        self._server.warnings.append(
            f"port {WEB_PORT} (page) is in use, perhaps by another simmer-tui: it is {listener.port} here"
        )
        return listener

    @property
    def shown_links(self) -> tuple[str, ...]:
        """The links, as lines for people."""
        return tuple(f"page to {link.role.value}: {link.address}" for link in self.links)

    def prepare(self) -> None:
        """Watch the run from now on; before it starts."""
        self._frames = RunFrames(self._server, self._task)

    def start(self) -> None:
        """Begin to serve."""
        self._switch = sys.getswitchinterval()
        sys.setswitchinterval(min(self._switch, _SWITCH))
        self._thread.start()

    def judged(self, verdict: Verdict) -> None:
        """Show the verdict on a run that is over. Any thread may call it."""
        self._call(self._frames.judge, verdict)

    def stop(self) -> None:
        """Report the end of the run to viewers, and end. May be called more than once."""
        if self._thread.is_alive():
            self._call(self._begin_end)
            self._thread.join(_ENDING)  # a daemon: it delays nobody
            sys.setswitchinterval(self._switch)
        elif not self._loop.is_closed():
            self._listener.close()
            self._loop.close()

    def _call(self, function: Any, *arguments: Any) -> None:
        with contextlib.suppress(RuntimeError):  # the thread has ended
            self._loop.call_soon_threadsafe(function, *arguments)

    # -- the thread ------------------------------------------------------------------------------

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.call_soon(self._open)
        try:
            self._loop.run_forever()
        finally:
            self._acceptor.close()
            self._drop_waiting()
            for viewer in (*self._viewers, *self._strangers):
                viewer.abort()
            if self._owners is not None:
                self._owners.close()
            self._loop.run_until_complete(asyncio.sleep(0))
            self._loop.close()

    def _open(self) -> None:
        self._budget = ReadBudget(4 * PIECE, counted=False)
        # `Server.tell` passes notices to the robot's thread.
        check = AccessCheck(
            self._server.tell, self._owners, way_in="--web-host ADDRESS lets others look, by a link"
        )
        self._acceptor = Acceptor(self._listener, self._welcome, check)
        self._tick()

    def _begin_end(self) -> None:
        if self._is_ending:
            return
        self._is_ending = True
        self._acceptor.pause()
        self._drop_waiting()
        for viewer in tuple(self._strangers):
            viewer.abort()
        self._frames.poll()
        self._publish({"over": True})
        for viewer in tuple(self._viewers):
            viewer.end(_GOING_AWAY, "the run is over")
        self._end_when_alone(self._loop.time() + Viewer.closing)

    def _end_when_alone(self, until: float) -> None:
        if self._viewers and self._loop.time() < until:
            self._loop.call_later(0.01, self._end_when_alone, until)
        else:
            self._loop.stop()

    # -- frames ----------------------------------------------------------------------------------

    def _tick(self) -> None:
        self._loop.call_later(self._period, self._tick)
        self._ticks += 1
        for sock, silent in tuple(self._silent.items()):
            if silent.came + _TO_JOIN > self._loop.time():
                break
            self._drop_silent(sock)
        for viewer in tuple(self._viewers):
            if viewer.has_stalled():
                viewer.abort()
            else:
                viewer.hold(False)
        # By the program's clock time passes with events only, and the robot's thread must not be woken.
        if not self._is_asking and self._server.clock is None:
            with contextlib.suppress(RuntimeError):  # the robot's thread has ended: no time passes
                self._server.call(self._note_time)
                self._is_asking = True
                return
        # The robot's thread may be delayed, but viewers need a sign of life.
        self._show_news()

    def _note_time(self) -> None:
        """Store simulated time, in the robot's thread."""
        self._frames.note_time()
        self._call(self._time_noted)

    def _time_noted(self) -> None:
        self._is_asking = False
        self._show_news()

    def _show_news(self) -> None:
        """Send the news, if there is any."""
        frames = self._frames
        has_news = frames.poll()
        if not self._viewers:
            frames.forget()
            return
        # A standing robot and a running clock need fewer frames.
        has_passed = has_news or frames.has_passed(is_due=self._ticks % _STILL == 0)
        if has_passed or self._loop.time() - self._sent >= _HEARTBEAT:
            self._publish({})

    def _publish(self, fields: dict[str, Any]) -> None:
        """Send the news to all viewers: encoded once."""
        self._sent = self._loop.time()
        frame = self._frames.next(fields)
        for viewer in self._viewers:
            viewer.send(frame)

    # -- viewers ---------------------------------------------------------------------------------

    def _welcome(self, sock: socket.socket, name: str) -> None:
        # The oldest silent one goes first: otherwise they would fill the port for others.
        if len(self._silent) >= _MOST_SILENT:
            self._drop_silent(next(iter(self._silent)))
        self._silent[sock] = _Silent(name, self._loop.time())
        self._loop.add_reader(sock, self._speaks, sock)

    def _drop_waiting(self) -> None:
        for sock in tuple(self._silent):
            self._drop_silent(sock)
        for sock, _ in self._spoken:
            sock.close()
        self._spoken.clear()

    def _drop_silent(self, sock: socket.socket) -> None:
        self._loop.remove_reader(sock)
        del self._silent[sock]
        sock.close()

    def _speaks(self, sock: socket.socket) -> None:
        """A connection says something, or ends without a word."""
        with contextlib.suppress(OSError):
            if sock.recv(1, socket.MSG_PEEK):
                self._loop.remove_reader(sock)
                self._spoken.append((sock, self._silent.pop(sock).name))
        if sock in self._silent:
            self._drop_silent(sock)
            return
        if len(self._spoken) >= MOST_WAITING:
            self._acceptor.pause()
        self._let_in_spoken()

    def _let_in_spoken(self) -> None:
        while self._spoken and self._let_in < _MOST_AT_ONCE:
            self._let_in += 1
            if self._let_in == 1:
                self._loop.call_later(_BREATHER, self._breathe)
            self._serve(*self._spoken.popleft())

    def _breathe(self) -> None:
        self._let_in = 0
        self._let_in_spoken()
        if len(self._spoken) < MOST_WAITING and not self._is_ending:
            self._acceptor.resume()

    def _serve(self, sock: socket.socket, name: str) -> None:
        if len(self._viewers) + len(self._strangers) >= MOST_CONNECTIONS:
            self._acceptor.refuse(sock, name)
            return
        # Those without a word must not fill the port for others.
        waiting = [each for each in self._strangers if not each.is_guessing]
        if len(waiting) >= MOST_WAITING:
            waiting[0].abort()
        viewer = Viewer(sock, name, self._budget, self)
        self._strangers[viewer] = None
        self._loop.call_later(_TO_JOIN, self._give_up, viewer)

    def _give_up(self, viewer: Viewer) -> None:
        if viewer in self._strangers:
            viewer.abort()

    def response(self, request: Request) -> Response | None:
        """The page, or a refusal; None for a viewer's connection from our page."""
        refused = self._responses.refused
        path = request.path.partition("?")[0]
        try:
            host, origin = request.headers.get("Host", ""), request.headers.get("Origin")
            upgrade = request.headers.get("Upgrade", "")
        except MultipleValuesError:
            return refused(HTTPStatus.BAD_REQUEST, "a header stands there twice")
        if not self._access.is_host(host):
            return refused(
                HTTPStatus.FORBIDDEN,
                "this is no name of the simulator's machine: use its address, or start it with --web-names "
                "and the name of your port forwarder",
            )
        if getattr(request, "method", "GET") != "GET":  # older versions allow no other request to reach this
            return refused(HTTPStatus.METHOD_NOT_ALLOWED, "nothing but GET is answered here")
        if upgrade.lower() == "websocket":
            # No other site's page may watch through a browser of ours, or drive.
            if origin is None or not self._access.is_origin(origin, host):
                return refused(HTTPStatus.FORBIDDEN, "another page may not look in here")
            if path != LIVE:
                return refused(HTTPStatus.NOT_FOUND, f"the run is looked at from {LIVE} alone")
            return None
        if path == "/":
            return self._responses.page(host)
        return refused(HTTPStatus.NOT_FOUND, "there is one page here: /")

    def message_received(self, viewer: Viewer, data: bytes) -> None:
        """Take a word, a line or a key."""
        try:
            message = msgspec.json.decode(data, type=ViewerMessage)
        except msgspec.MsgspecError:
            viewer.end(_MALFORMED, "no such message")
            return
        if viewer.role is None:
            if not viewer.is_guessing:
                self._take_word(viewer, message.word or "")
        elif (control := self._controls.get(viewer)) is not None:
            tell = partial(self._call, self._tell, viewer)
            if message.line:
                control.give(message.line, tell)
            elif message.key:
                control.press(message.key, tell, fine=message.fine)

    def _tell(self, viewer: Viewer, text: str) -> None:
        if viewer in self._viewers:
            viewer.send(framed(msgspec.json.encode({"told": printable(text)})))

    def _take_word(self, viewer: Viewer, word: str) -> None:
        role = self._access.role_of(word)
        if role is None:
            viewer.is_guessing = True
            viewer.hold(True)
            self._loop.call_later(_WRONG_WORD, viewer.end, _WRONG, "wrong word")
            return
        del self._strangers[viewer]
        viewer.role = role
        self._join(viewer)

    def _join(self, viewer: Viewer) -> None:
        """Send a viewer the run so far; from now on it gets the news."""
        if not self._frames.has_whole:
            self._publish({})  # so that the others have received the same as the newcomer
        greeting: dict[str, object] = {"role": viewer.role}
        if viewer.role is PageRole.DRIVE:
            keys = page_keys(self._server.configuration.settings.keys)
            greeting |= {"keys": keys, "buttons": BUTTONS}
        viewer.send(framed(msgspec.json.encode(greeting)))
        for frame in self._frames.whole():
            viewer.send(frame)
        viewer.reset_backlog()
        self._viewers.add(viewer)
        if viewer.role is PageRole.DRIVE:
            self._controls[viewer] = PageControl(self._server)

    def viewer_gone(self, viewer: Viewer) -> None:
        """Remove a connection that has ended."""
        if (control := self._controls.pop(viewer, None)) is not None:
            with contextlib.suppress(RuntimeError):  # the robot's thread has ended
                control.close()
        self._viewers.discard(viewer)
        self._strangers.pop(viewer, None)
