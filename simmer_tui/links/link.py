"""Links: the context they are made of, the ports they need, and the interface that the server sees."""

from __future__ import annotations

import pkgutil
import socket
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Protocol

from msgspec import Struct, field

from simmer_tui.config import dialects
from simmer_tui.config.dialects import Dialect, DialectPort
from simmer_tui.config.settings import ServerSettings, value_of
from simmer_tui.links.access import AccessCheck
from simmer_tui.links.backend import BackendSwitch, Message
from simmer_tui.links.driver_lock import DriverLock
from simmer_tui.links.ports import Acceptor, Crowd, Listener, PortRequest
from simmer_tui.links.processes import ProcessLookup
from simmer_tui.links.pty_port import PtyDevice
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.program_clock import ProgramClock
from simmer_tui.sim.command import Command

if TYPE_CHECKING:  # few sets have a dialect
    from simmer_tui.dialect.dialect_rules import DialectRules


class Link(Protocol):
    """An object that holds ports and connections, open until closed."""

    @property
    def has_clients(self) -> bool: ...

    def close(self) -> None: ...


class LinkContext(Struct, frozen=True):
    """Everything a link needs.

    `listeners` are the taken ports of all dialects, by purpose. `backend` is the robot that clients drive.
    `reply` is the setting for when a timed drive is answered. Without `access` everybody may connect. Without
    `processes` the programs behind connections are not known. `client_left` is called after each client
    that has sent something, and `probe_left` in its place after a request of HTTP, as health checks send.
    `clock` is the program's, if that is in force. `dialect` is the team's own, and `terminal` a
    pseudo-terminal for its programs. With a `driver_lock` one program at a time drives, over all links.
    `variables` returns those of a program, for a program that somebody else starts.
    """

    engine: Engine
    backend: BackendSwitch
    listeners: Mapping[str, Listener]
    settings: ServerSettings = field(default_factory=ServerSettings)
    reply: str = "auto"
    access: AccessCheck | None = None
    processes: ProcessLookup | None = None
    client_left: Callable[[], None] = lambda: None
    clock: ProgramClock | None = None
    dialect: DialectRules | None = None
    terminal: PtyDevice | None = None
    driver_lock: DriverLock | None = None
    probe_left: Callable[[], None] | None = None
    variables: Callable[[], Mapping[str, str]] = dict

    def answers_at_end(self, *, in_packets: bool) -> bool:
        """True if a drive is answered when it has ended, not at once."""
        # simmer-python answers drives at once: "auto" means accepted in packets, done in the binary dialects.
        return self.reply == "done" if in_packets else self.reply != "accepted"

    def accept(
        self,
        port: DialectPort,
        welcome: Callable[[socket.socket, str], None],
        crowd: Crowd | None = None,
    ) -> Acceptor:
        """Accept connections on a port from now on: admitted ones go to `welcome(socket, peer)`. With a
        `crowd` many may come at once."""
        return Acceptor(self.listeners[port.purpose], welcome, self.access, crowd)


def open_links(context: LinkContext) -> Iterator[Link]:
    """Serve the dialects of a server whose ports are taken. Needs a running event loop."""
    for dialect in dialects.served(context.settings.listeners):
        # A dialect whose port was in use is left out; the server has warned about it.
        if all(port.purpose in context.listeners for port in dialect.ports):
            # Imported by name: dialects that are not served cost no start-up time.
            yield pkgutil.resolve_name(dialect.link)(context)


def port_requests(server: ServerSettings) -> list[tuple[Dialect, list[PortRequest]]]:
    """The ports to take for each dialect served.

    If the first port of a dialect with typed commands is set to 0, all ports at their defaults are any too.
    """
    served = dialects.served(server.listeners)
    return [(each, [port_request(server, port) for port in each.ports]) for each in served]


def port_request(server: ServerSettings, port: DialectPort) -> PortRequest:
    """The port to take for one port of the table."""
    # Tests and CI use --port 0: the other ports, at their defaults, would still collide.
    served = dialects.served(server.listeners)
    any_free = 0 in (port_number(server, each.ports[0]) for each in served if each.typed)
    defaults = {each.default for each in dialects.all_ports()}
    number = port_number(server, port)
    taken = 0 if any_free and number in defaults else number
    falls_back = port is dialects.SERIAL and number == port.default
    return PortRequest(taken, port.purpose, port.option, port.backlog, falls_back)


def port_number(server: ServerSettings, port: DialectPort) -> int:
    """The number that a port is set to, 0 for any."""
    return int(value_of(server, port.setting))


def typed_message(server: ServerSettings, command: Command) -> Message:
    """The message for a command of a person, as a program of this server would send it."""
    first = next(each for each in dialects.served(server.listeners) if each.typed)
    typed: Any = pkgutil.resolve_name(first.typed)
    data, form = typed(command.text.strip().encode("utf-8", "replace"), server)
    return Message(data, (command,), form)
