"""Quick connections of another user, and of our own: 10,000 of each kind.

    python benchmarks/bench_strangers.py [--quick] [--json FILE]

A stranger's program connects, sends a drive and closes at once, plainly or by a reset. It does so before
anybody else has connected, and while the owner sends packets, binary commands or beliefs. Goal: no drive is
done, and no connection of the owner is refused. The owner's connections are of four kinds. They are counted
again with a look-up as in kernels before 6.17, which has no answer for a socket that its program has closed.
Connections that are reset at once cannot be distinguished from a stranger's; with the token they are
accepted. The last figure is the cost of the look-up to the server's processor. Only root can be two users;
others get the owner's figures.
"""

from __future__ import annotations

import argparse
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.config.settings_file import Override
from simmer_tui.links.owners import OwnerLookup, RemoteSocket
from simmer_tui.live.server import Server
from simmer_tui.run.events import Belief, Event, Notice, NoticeKind
from simmer_tui.sim import CommandResult

NOBODY = 65534
TOKEN = "word"
COUNT, QUICK = 10_000, 300
CLIENT = """
import os, socket, struct, sys
kind, user, port, reply_port, count, data = sys.argv[1:]
data = data.encode().decode("unicode_escape").encode()
if int(user) != os.geteuid():
    os.setuid(int(user))
for _ in range(int(count)):
    with socket.socket() as sock:
        if kind == "reset":
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        try:
            sock.connect(("127.0.0.1", int(port)))
            sock.sendall(data)
            if kind == "answered":
                sock.recv(64)
        except OSError:  # turned away meanwhile
            pass
    if kind == "fetched":
        while True:
            with socket.create_connection(("127.0.0.1", int(reply_port))) as sock:
                if sock.recv(1024):
                    break
"""
OWNERS = {
    "binary, with its reply": ("answered", "commands", r"u1\n"),
    "packets, closed at once": ("plain", "packets", "[u1]"),
    "packets, with their replies": ("fetched", "packets", "[u1]"),
    "beliefs, closed at once": ("plain", "beliefs", r'{"x": 1, "y": 2, "heading": 3}\n'),
}
"""Connections of the owner: the kind, its port and what it sends."""
STRANGERS = {
    "packets, plainly": ("plain", "packets", "[d1:1]"),
    "packets, by reset": ("reset", "packets", "[d1:1]"),
    "binary, plainly": ("plain", "commands", r"d1-1\n"),
    "binary, by reset": ("reset", "commands", r"d1-1\n"),
}


class Counted:
    """A server, with the numbers of drives, of readings and beliefs, and of connections refused."""

    def __init__(self, any_user: bool = False, token: str = "") -> None:
        given: dict[str, object] = {
            "server.port": 0,
            "server.listeners": "binary,packets",
            "server.any_user": any_user,
            "server.token": token,
        }
        self.drives = self.others = self.refused = 0
        self.server = Server(
            load(bundled_folder(), {name: Override("--it", each) for name, each in given.items()})
        )
        self.server.start(self._told)

    def _told(self, event: Event) -> None:
        if isinstance(event, CommandResult):
            is_drive = event.command.code == "d1"
            self.drives += is_drive
            self.others += not is_drive
        elif isinstance(event, Notice):
            self.refused += event.kind is NoticeKind.TURNED_AWAY
        else:
            self.others += isinstance(event, Belief)

    def client(
        self, way: tuple[str, str, str], count: int, user: int | None = None
    ) -> subprocess.Popen[bytes]:
        """Start a program of a user, by default our own."""
        kind, purpose, data = way
        ports, owner = self.server.ports, os.geteuid() if hasattr(os, "geteuid") else 0
        told = [kind, owner if user is None else user, ports[purpose], ports["packet replies"], count, data]
        return subprocess.Popen([sys.executable, "-c", CLIENT, *map(str, told)])

    def settle(self) -> None:
        """Wait until all that was sent has been processed: a busy machine may need several drains."""
        before = -1
        while (count := self.drives + self.others + self.refused) != before:
            before = count
            self.server.drain()


@contextmanager
def served(any_user: bool = False, token: str = "") -> Iterator[Counted]:
    counted = Counted(any_user, token)
    try:
        yield counted
    finally:
        counted.server.stop()


@contextmanager
def older_kernel() -> Iterator[None]:
    """Context with look-ups that answer like kernels before 6.17."""
    ask = OwnerLookup.ask

    def asked(self: OwnerLookup, sock: socket.socket, there: tuple[str, int]) -> RemoteSocket | None:
        told = ask(self, sock, there)
        return told and (told if told.inode else told._replace(uid=0))

    OwnerLookup.ask = asked  # type: ignore[method-assign]
    try:
        yield
    finally:
        OwnerLookup.ask = ask  # type: ignore[method-assign]


def lost_by_owner(way: tuple[str, str, str], count: int, token: str = "") -> int:
    """Number of the owner's connections that were refused."""
    with served(token=token) as counted:
        if token:
            way = (way[0], way[1], rf"{token}\n{way[2]}")
        counted.client(way, count).wait()
        counted.settle()
        return count - counted.others


def attack(way: tuple[str, str, str], count: int, owner: tuple[str, str, str] | None) -> tuple[int, int]:
    """Number of a stranger's drives that were done, and of connections that the owner lost meanwhile."""
    with served() as counted:
        stop = threading.Event()
        sent = 0

        def own() -> None:
            nonlocal sent
            while owner is not None and not stop.is_set():
                counted.client(owner, 20).wait()
                sent += 20

        thread = threading.Thread(target=own)
        thread.start()
        counted.client(way, count, NOBODY).wait()
        stop.set()
        thread.join()
        counted.settle()
        return counted.drives, sent - counted.others


def price(count: int, repeats: int) -> float:
    """Microseconds of the server's processor for the look-up of a connection's user."""
    spent: dict[bool, list[float]] = {False: [], True: []}
    way = OWNERS["packets, closed at once"]
    with served(any_user=True) as open_to_all, served() as checked:
        for repeat in range(2 * repeats + 2):
            counted = (open_to_all, checked)[repeat % 2]
            begun = time.process_time()
            counted.client(way, count).wait()
            counted.settle()
            if repeat > 1:  # the first two warm up
                spent[counted is checked].append((time.process_time() - begun) / count)
    return 1e6 * (min(spent[True]) - min(spent[False]))


def main() -> int:
    """Returns 1 if a stranger drove or an honest connection was refused."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} of each kind")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    options = parser.parse_args()
    count = QUICK if options.quick else COUNT
    figures: dict[str, float] = {}

    def note(name: str, figure: float) -> None:
        figures[name] = figure
        print(f"{name}: {figure:g}", flush=True)

    for name, way in OWNERS.items():
        note(f"owner refused, {name}", lost_by_owner(way, count))
        with older_kernel():
            note(f"owner refused, older kernel, {name}", lost_by_owner(way, count))
    by_reset = ("reset", *OWNERS["packets, closed at once"][1:])
    note("owner refused, packets by reset, with the token", lost_by_owner(by_reset, count, TOKEN))
    alone = lost_by_owner(by_reset, count)
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        for name, way in STRANGERS.items():
            for beside, owner in {"alone": None, **OWNERS}.items():
                drives, lost = attack(way, count, owner)
                note(f"stranger's drives, {name}; owner: {beside}", drives)
                if owner is not None:
                    note(f"owner refused beside a stranger, {name}; {beside}", lost)
    else:
        print("a stranger is another user, and only root can be two: not measured")
    missed = [name for name, figure in figures.items() if figure]
    note("owner refused, packets by reset, without a token (owner unknown)", alone)
    note("microseconds a connection to ask whose it is", price(count, 3))
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")
    for name in missed:
        print(f"MISSED: {name}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
