"""The robot's own thread: one event loop with the engine and everything that carries bytes to it."""

from __future__ import annotations

import asyncio
import secrets
import threading
from collections.abc import Callable
from typing import Any, Protocol

from simmer_tui.config.loader import Configuration
from simmer_tui.config.settings import ServerSettings
from simmer_tui.engine import Engine, Event, Notice, NoticeKind
from simmer_tui.errors import PortError
from simmer_tui.links.belief import BeliefLink
from simmer_tui.links.ports import Listener, PortRequest, take_port
from simmer_tui.links.tcp import BinaryLink
from simmer_tui.protocol.binary import NumberEncoder
from simmer_tui.sim.simulator import Simulator
from simmer_tui.snapshot import Recorder, Snapshot

COMMANDS, REPLIES, BELIEFS = "commands", "replies", "beliefs"
_VARIABLES = {
    COMMANDS: "SIMMER_PORT",
    REPLIES: "SIMMER_REPLY_PORT",
    BELIEFS: "SIMMER_BELIEF_PORT",
}


class Link(Protocol):
    """A door that bytes come through, open until closed."""

    def close(self) -> None: ...


class Station:
    """A simulator that serves its ports from a daemon thread of its own.

    The same for the screen and for headless runs. Watchers are called in the robot's thread; from
    other threads reach the engine through `call`.
    """

    def __init__(self, configuration: Configuration) -> None:
        """Take the ports and set the robot on its start. Raises PortError."""
        settings = configuration.settings
        self.configuration = configuration
        self.seed = secrets.randbits(32) if settings.randerror else settings.seed
        self.simulator = Simulator(configuration.simulation, self.seed)
        motion = settings.motion
        self.engine = Engine(
            self.simulator,
            timed=motion.motion == "timed",
            time_scale=motion.time_scale,
            step_time=settings.step_time,
        )
        self.recorder = Recorder(self.engine)
        self.warnings: list[str] = []
        """What is wrong but does not keep the robot from being driven."""
        self.host = settings.server.host
        self._listeners = self._take_ports(settings.server)
        self._loop = asyncio.SelectorEventLoop()
        self._links: list[Link] = []
        self._thread = threading.Thread(target=self._run, name="robot", daemon=True)
        self._client_left: Callable[[], None] = lambda: None

    def _take_ports(self, server: ServerSettings) -> dict[str, Listener]:
        taken: dict[str, Listener] = {}
        try:
            for request in _requests(server):
                taken[request.purpose] = take_port(server.host, request)
        except PortError:
            for listener in taken.values():
                listener.close()
            raise
        number = _or_any(server.belief_port, server)
        try:
            taken[BELIEFS] = take_port(server.host, PortRequest(number, BELIEFS, "--belief-port"))
        except PortError as error:
            self.warnings.append(f"no beliefs will be shown: {error}")
        return taken

    def port(self, purpose: str) -> int | None:
        """The port taken for a purpose (`COMMANDS`, `REPLIES`, `BELIEFS`), or None."""
        listener = self._listeners.get(purpose)
        return listener.port if listener is not None else None

    @property
    def ports(self) -> dict[str, int]:
        """All ports taken, by purpose."""
        return {purpose: listener.port for purpose, listener in self._listeners.items()}

    @property
    def environment(self) -> dict[str, str]:
        """The variables that tell a program on this machine where to connect."""
        anywhere = ("localhost", "0.0.0.0", "::")
        host = "127.0.0.1" if self.host in anywhere else self.host
        return {"SIMMER_HOST": host} | {
            _VARIABLES[purpose]: str(number) for purpose, number in self.ports.items()
        }

    @property
    def open_to_others(self) -> bool:
        """Whether other machines can reach the ports."""
        return any(
            not _is_loopback(sock.getsockname()[0])
            for listener in self._listeners.values()
            for sock in listener.sockets
        )

    def start(
        self,
        watcher: Callable[[Event], None] | None = None,
        client_left: Callable[[], None] = lambda: None,
    ) -> None:
        """Begin to serve. `client_left` is called in the robot's thread after each client."""
        if watcher is not None:
            self.engine.watch(watcher)
        self._client_left = client_left
        self._thread.start()

    def call(self, function: Callable[..., object], *arguments: Any) -> None:
        """Have something done in the robot's thread."""
        self._loop.call_soon_threadsafe(function, *arguments)

    def tell(self, event: Event) -> None:
        """Have an event passed to all watchers."""
        self.call(self.engine.tell, event)

    def record(self) -> None:
        """Keep what snapshots show; before `start`."""
        self.engine.watch(self.recorder.watch)

    async def snapshot(self, since: int = 0, true_values: bool = False) -> Snapshot:
        """The state now (see `Recorder.snapshot`), asked for from another event loop."""

        async def take() -> Snapshot:
            return self.recorder.snapshot(since, true_values)

        return await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(take(), self._loop))

    def stop(self) -> None:
        """Give the ports back and end the thread. May be called more than once."""
        if self._thread.is_alive():
            self.call(self._loop.stop)
            self._thread.join()
        else:
            self._close_listeners()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.set_exception_handler(self._report)
        self._loop.call_soon(self._open)
        try:
            self._loop.run_forever()
        finally:
            for link in self._links:
                link.close()
            self._loop.run_until_complete(_settle())
            self._loop.close()

    def _open(self) -> None:
        settings = self.configuration.settings
        server, answers = settings.server, settings.motion.reply
        self.engine.start(self._loop)
        if COMMANDS in self._listeners:
            self._links.append(
                BinaryLink(
                    self.engine,
                    self._listeners[COMMANDS],
                    self._listeners[REPLIES],
                    NumberEncoder(server.reply_format, server.byte_order),
                    grace=server.grace,
                    answer_at_end=answers != "accepted",
                    on_client_left=self._client_left,
                )
            )
        if BELIEFS in self._listeners:
            self._links.append(BeliefLink(self.engine, self._listeners[BELIEFS]))

    def _report(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        text = f"{context.get('message', 'internal fault')}: {type(error).__name__}: {error}"
        self.engine.tell(Notice(NoticeKind.FAULT, text))

    def _close_listeners(self) -> None:
        for listener in self._listeners.values():
            listener.close()


def _requests(server: ServerSettings) -> list[PortRequest]:
    """The ports the listeners need."""
    return [
        PortRequest(server.port, COMMANDS, "--port"),
        PortRequest(_or_any(server.reply_port, server), REPLIES, "--reply-port"),
    ]


def _or_any(number: int, server: ServerSettings) -> int:
    """A port beside one that may be any: any as well, unless it was set to something else."""
    usual = ServerSettings()
    return 0 if server.port == 0 and number in (usual.reply_port, usual.belief_port) else number


def _is_loopback(address: str) -> bool:
    return address.startswith("127.") or address == "::1"


async def _settle() -> None:
    """Let connections that are closing send what they still hold."""
    for _ in range(3):
        await asyncio.sleep(0)
    remaining = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
    for task in remaining:
        task.cancel()
    await asyncio.gather(*remaining, return_exceptions=True)
