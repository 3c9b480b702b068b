"""Requests through a connection per message, as a ratio to a bare asyncio server.

    python benchmarks/bench_packets.py [--quick] [--json FILE]

Both servers run in processes of their own and get the same: connect, send `[u0]`, close, connect to the
second port, read, close. They are measured in turn, and the median of the ratios of neighbouring runs is
printed. Goal: 0.6. A third server accepts all users of the machine, as with `--any-user`. The look-up of the
connecting user may cost programs 5 %. Students' programs wait at least 40 ms between request and reply; the
cost for a client that never waits is printed too.

Then a program opens 500 silent connections at once, of which 128 are kept, and sends requests right after.
The mean of 20 trips may be 3 times that of 20 before. The median of several repeats is printed.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import socket
import statistics
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path

REQUEST = b"[u0]"
GOAL = 0.6
OWNER_GOAL = 1.05
CROWD, TRIPS, CROWD_GOAL = 500, 20, 3.0
WAIT = 0.04
"""Seconds that the fastest of students' programs waits between request and reply."""


class Kept:
    """The simplest matching of requests and reads, in any order."""

    def __init__(self) -> None:
        self._requests: deque[bytes] = deque()
        self._reads: deque[asyncio.Transport] = deque()

    def request(self, data: bytes) -> None:
        self._requests.append(data)
        self._match()

    def read(self, transport: asyncio.Transport) -> None:
        self._reads.append(transport)
        self._match()

    def _match(self) -> None:
        while self._requests and self._reads:
            transport = self._reads.popleft()
            transport.write(self._requests.popleft())
            transport.close()


class Requests(asyncio.Protocol):
    """Protocol that stores requests."""

    def __init__(self, kept: Kept) -> None:
        self._kept = kept

    def data_received(self, data: bytes) -> None:
        self._kept.request(data)


class Replies(asyncio.Protocol):
    """Protocol that sends the oldest stored request back, and closes."""

    def __init__(self, kept: Kept) -> None:
        self._kept = kept

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._kept.read(transport)


async def serve_bare() -> None:
    kept = Kept()
    loop = asyncio.get_running_loop()
    servers = [
        await loop.create_server(lambda: Requests(kept), "127.0.0.1", 0),
        await loop.create_server(lambda: Replies(kept), "127.0.0.1", 0),
    ]
    print(*(server.sockets[0].getsockname()[1] for server in servers), flush=True)
    await asyncio.gather(*(server.serve_forever() for server in servers))


def serve_simulator(any_user: bool) -> None:
    """Run a server as `simmer-tui --config simmer-python --no-ui` does, without the lines it would print."""
    from simmer_tui.cli.headless import LinePrinter
    from simmer_tui.config.dialects import PACKET_REPLIES, PACKETS
    from simmer_tui.config.loader import load
    from simmer_tui.config.sets import bundled_sets
    from simmer_tui.config.settings_file import Override
    from simmer_tui.live.server import Server

    given = {
        "server.packet_port": Override("--packet-port", 0),
        "server.any_user": Override("--any-user", any_user),
    }
    server = Server(load(bundled_sets()["simmer-python"], given))
    console = LinePrinter(quiet=False)
    server.start(console.watch)
    print(server.ports[PACKETS.purpose], server.ports[PACKET_REPLIES.purpose], flush=True)
    console.show()


@contextlib.contextmanager
def served(name: str) -> Iterator[tuple[int, int]]:
    """A server process; its request and reply port."""
    process = subprocess.Popen([sys.executable, __file__, "--serve", name], stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None
        requests, replies = process.stdout.readline().split()
        yield int(requests), int(replies)
    finally:
        process.kill()
        process.communicate()


def exchange(ports: tuple[int, int], wait: float = 0.0) -> int:
    """One request and its reply; returns the number of reads."""
    with socket.create_connection(("127.0.0.1", ports[0])) as sender:
        sender.sendall(REQUEST)
    if wait:
        time.sleep(wait)
    for read in range(1, 100):
        with socket.create_connection(("127.0.0.1", ports[1])) as receiver:
            if receiver.recv(1024):
                return read
    raise RuntimeError("no reply came")


def rate(ports: tuple[int, int], count: int, wait: float = 0.0) -> tuple[float, float]:
    """Requests a second, and reads a request."""
    started = time.perf_counter()
    reads = sum(exchange(ports, wait) for _ in range(count))
    return count / (time.perf_counter() - started), reads / count


def measure(repeats: int, count: int) -> dict[str, float]:
    """Medians over the repeats: the servers' requests a second, their ratios, reads a request."""
    names = ["simulator", "bare", "any user"]
    rates: dict[str, list[float]] = {name: [] for name in names}
    waiting: list[float] = []
    reads: dict[str, list[float]] = {name: [] for name in names}
    with contextlib.ExitStack() as stack:
        ports = {name: stack.enter_context(served(name)) for name in names}
        for ports_of_one in ports.values():  # warm-up
            rate(ports_of_one, count)
        for repeat in range(repeats):
            turn = repeat % len(names)  # the order makes a difference
            for name in names[turn:] + names[:turn]:
                per_second, per_request = rate(ports[name], count)
                rates[name].append(per_second)
                reads[name].append(per_request)
        for repeat in range(repeats):
            pair = ("simulator", "any user")
            found = {name: rate(ports[name], 20, WAIT)[0] for name in (pair, pair[::-1])[repeat % 2]}
            waiting.append(found["any user"] / found["simulator"])

    def ratio(name: str, to: str) -> float:
        return statistics.median(one / other for one, other in zip(rates[name], rates[to], strict=True))

    return {
        **{name: statistics.median(rates[name]) for name in names},
        "ratio": ratio("simulator", "bare"),
        "owner check": statistics.median(waiting),
        "owner check without a wait": ratio("any user", "simulator"),
        "owner check, us a connection": statistics.median(
            1e6 * (1 / one - 1 / other) / 2
            for one, other in zip(rates["simulator"], rates["any user"], strict=True)
        ),
        **{f"{name} reads a request": statistics.median(reads[name]) for name in names[:2]},
    }


def trips(ports: tuple[int, int]) -> list[float]:
    """Milliseconds of `TRIPS` requests with their replies."""
    times = []
    for _ in range(TRIPS):
        begun = time.perf_counter()
        exchange(ports)
        times.append(1000 * (time.perf_counter() - begun))
    return times


def beside_crowd(repeats: int) -> dict[str, float]:
    """Medians over the repeats: means of `TRIPS` before `CROWD` connections at once and right after, their
    ratio, and the first trip after."""
    found: dict[str, list[float]] = {"idle ms": [], "crowd ms": [], "crowd first ms": [], "crowd ratio": []}
    for _ in range(repeats):
        with served("simulator") as ports, contextlib.ExitStack() as stack:
            rate(ports, 100)
            idle = statistics.mean(trips(ports))
            for _ in range(CROWD):
                sock = stack.enter_context(socket.socket())
                sock.setblocking(False)
                sock.connect_ex(("127.0.0.1", ports[0]))
            after = trips(ports)
        mean = statistics.mean(after)
        for name, figure in zip(found, (idle, mean, after[0], mean / idle), strict=True):
            found[name].append(figure)
    return {name: statistics.median(each) for name, each in found.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="fewer repeats")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    parser.add_argument("--serve", choices=("bare", "simulator", "any user"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve == "bare":
        asyncio.run(serve_bare())
    elif options.serve is not None:
        serve_simulator(any_user=options.serve == "any user")
    else:
        figures = measure(*((5, 500) if options.quick else (45, 600)))
        figures |= beside_crowd(3 if options.quick else 15)
        print(
            f"requests through a connection per message: {figures['simulator']:,.0f}/s, bare server "
            f"{figures['bare']:,.0f}/s, ratio {figures['ratio']:.2f} (goal {GOAL}); reads a request "
            f"{figures['simulator reads a request']:.2f} and {figures['bare reads a request']:.2f}"
        )
        print(
            f"without asking who connects: {figures['owner check']:.3f} times as many by programs that wait "
            f"{1000 * WAIT:.0f} ms (goal {OWNER_GOAL}), {figures['owner check without a wait']:.3f} times by "
            f"one that never does ({figures['owner check, us a connection']:.1f} us a connection)"
        )
        print(
            f"a trip after {CROWD} connections at once: {figures['crowd ms']:.2f} ms, idle "
            f"{figures['idle ms']:.2f} ms (means of {TRIPS}), ratio {figures['crowd ratio']:.1f} (goal "
            f"{CROWD_GOAL:g}); the first one {figures['crowd first ms']:.1f} ms"
        )
        if options.json is not None:
            options.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
