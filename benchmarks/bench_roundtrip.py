"""Round trips of `u1` on one connection, as a ratio to a bare asyncio echo.

    python benchmarks/bench_roundtrip.py [--quick] [--json FILE]

Simulator and echo run in processes of their own, on one processor; this process measures them in turn, on the
same processor. So the figures compare work, not the time until the system wakes a processor. The median of
the ratios of neighbouring runs is printed. Goal: 0.6.

A bare echo asks the system for 256 KB at every receive. With glibc that halves its speed until a block of
that size has been freed once; the second ratio is to an echo after that.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

REQUEST = b"u1\n"
REPLY_SIZE = {"simulator": 8, "echo": len(REQUEST), "warm echo": len(REQUEST)}
GOAL = 0.6


class Echo(asyncio.Protocol):
    """The simplest echo."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        self._transport.write(data)


async def serve_echo(warm: bool) -> None:
    if warm:
        bytearray(1 << 22)  # once a large block has been freed, glibc keeps pages for the next
    server = await asyncio.get_running_loop().create_server(Echo, "127.0.0.1", 0)
    print(server.sockets[0].getsockname()[1], 0, flush=True)
    await server.serve_forever()


def serve_simulator() -> None:
    """Run a server as `simmer-tui --no-ui` does, without the lines it would print."""
    from simmer_tui.cli.headless import LinePrinter
    from simmer_tui.config.dialects import COMMANDS, REPLIES
    from simmer_tui.config.loader import load
    from simmer_tui.config.sets import bundled_folder
    from simmer_tui.config.settings_file import Override
    from simmer_tui.live.server import Server

    server = Server(load(bundled_folder(), {"server.port": Override("--port", 0)}))
    console = LinePrinter(quiet=False)
    server.start(console.watch)
    print(server.ports[COMMANDS.purpose], server.ports[REPLIES.purpose], flush=True)
    console.show()


def use_one_processor() -> None:
    """Use one processor, the same for all processes (Linux only)."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


@contextlib.contextmanager
def served(name: str) -> Iterator[tuple[int, int]]:
    """A server process; its command and reply port."""
    arguments = [sys.executable, __file__, "--serve", name]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    try:
        assert process.stdout is not None
        commands, replies = process.stdout.readline().split()
        yield int(commands), int(replies)
    finally:
        process.kill()
        process.communicate()


def connected(port: int) -> socket.socket:
    client = socket.create_connection(("127.0.0.1", port))
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return client


def rate(commands: socket.socket, replies: socket.socket, size: int, count: int) -> float:
    """Round trips a second."""
    started = time.perf_counter()
    for _ in range(count):
        commands.sendall(REQUEST)
        got = len(replies.recv(64))
        while got < size:
            got += len(replies.recv(64))
    return count / (time.perf_counter() - started)


def measure(repeats: int, count: int, on_reply_port: bool) -> dict[str, float]:
    """Medians: round trips a second of each, and the simulator's ratio to each echo."""
    with contextlib.ExitStack() as stack:
        ways = {}
        for name in REPLY_SIZE:
            port, reply_port = stack.enter_context(served(name))
            commands = stack.enter_context(connected(port))
            apart = on_reply_port and reply_port
            ways[name] = (commands, stack.enter_context(connected(reply_port)) if apart else commands)
        rates: dict[str, list[float]] = {name: [] for name in ways}
        for repeat in range(repeats + 1):
            for name, way in ways.items():
                measured = rate(*way, REPLY_SIZE[name], count)
                if repeat:  # the first warms up
                    rates[name].append(measured)
    figures = {name: statistics.median(each) for name, each in rates.items()}
    for name in ("echo", "warm echo"):
        each = zip(rates["simulator"], rates[name], strict=True)
        figures[f"ratio to {name}"] = statistics.median(ours / theirs for ours, theirs in each)
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="fewer repeats")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    parser.add_argument("--serve", choices=tuple(REPLY_SIZE), help=argparse.SUPPRESS)
    options = parser.parse_args()
    use_one_processor()
    if options.serve == "simulator":
        serve_simulator()
    elif options.serve is not None:
        asyncio.run(serve_echo(options.serve == "warm echo"))
    else:
        repeats, count = (7, 1000) if options.quick else (25, 2000)
        all_figures = {}
        for title, on_reply_port in (("one connection", False), ("two connections", True)):
            figures = all_figures[title] = measure(repeats, count, on_reply_port)
            print(
                f"round trips of u1, {title}: {figures['simulator']:,.0f}/s; "
                f"bare echo {figures['echo']:,.0f}/s, ratio {figures['ratio to echo']:.2f} (goal {GOAL}); "
                f"warm {figures['warm echo']:,.0f}/s, ratio {figures['ratio to warm echo']:.2f}"
            )
        if options.json is not None:
            options.json.write_text(json.dumps(all_figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
