"""Cost of the live page: round trips of `u1` and memory with 50 viewers, as ratios to none.

    python benchmarks/bench_web.py [--quick] [--json FILE]

One simulator with `--web` is used on one connection, alternately with no viewer and with 50. Viewers are
sockets of another process that read and discard. The median of the ratios of neighbouring turns is printed,
and the memory for viewers. Goals: 0.9 of the round trips, 60 MB. Both in timed motion, as in a class, and in
instant motion.
"""

from __future__ import annotations

import argparse
import base64
import json
import os
import re
import selectors
import socket
import statistics
import struct
import subprocess
import sys
import time
from pathlib import Path

VIEWERS = 50
GOAL, MEMORY_GOAL = 0.9, 60.0
SECONDS = 60.0


def view(port: int) -> None:
    """Process with the viewers: they connect or disconnect by each line of standard input."""
    selector = selectors.DefaultSelector()
    selector.register(sys.stdin, selectors.EVENT_READ)
    viewers: list[socket.socket] = []
    while True:
        for key, _ in selector.select():
            if key.fileobj is sys.stdin:
                if not (line := os.read(0, 64)):
                    return
                for each in viewers:
                    selector.unregister(each)
                    each.close()
                viewers = [joined(port) for _ in range(VIEWERS)] if line.startswith(b"join") else []
                for each in viewers:
                    selector.register(each, selectors.EVENT_READ)
                print(len(viewers), flush=True)
                break  # other selected sockets may be closed
            if isinstance(key.fileobj, socket.socket) and not key.fileobj.recv(1 << 18):
                selector.unregister(key.fileobj)


def joined(port: int) -> socket.socket:
    """A viewer that has received the run so far."""
    made = socket.create_connection(("127.0.0.1", port), SECONDS)
    key = base64.b64encode(os.urandom(16)).decode()
    made.sendall(
        f"GET /live HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nOrigin: http://127.0.0.1:{port}\r\n"
        f"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: {key}\r\n"
        "Sec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    made.sendall(b"\x81\x82\0\0\0\0{}")
    seen = b""
    while b'"news"' not in seen:
        seen += made.recv(1 << 16)
    return made


class Simulator:
    """A run with a page."""

    def __init__(self, *options: str) -> None:
        command = [sys.executable, "-m", "simmer_tui", "--no-ui", "--quiet", "--port", "0"]
        command += ["--belief-port", "0", "--web", "0", *options]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        head = ""
        while "page to" not in head:
            head += self.process.stdout.readline()
        found = re.search(r"commands on port (\d+).*?:(\d+)/", head, re.DOTALL)
        assert found is not None
        self.client = socket.create_connection(("127.0.0.1", int(found[1])), SECONDS)
        self.client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        viewers = [sys.executable, __file__, "--view", found[2]]
        self.viewers = subprocess.Popen(viewers, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def look(self, *, on: bool) -> None:
        """Let viewers connect, or disconnect."""
        assert self.viewers.stdin is not None
        assert self.viewers.stdout is not None
        self.viewers.stdin.write("join\n" if on else "leave\n")
        self.viewers.stdin.flush()
        assert int(self.viewers.stdout.readline()) == (VIEWERS if on else 0)

    def ask(self, text: bytes) -> float:
        """The number in the reply to a command."""
        self.client.sendall(text + b"\n")
        data = b""
        while len(data) < 8:
            data += self.client.recv(8 - len(data))
        return float(struct.unpack(">d", data)[0])

    def rate(self, seconds: float) -> float:
        """Round trips a second."""
        count, begun = 0, time.perf_counter()
        while (passed := time.perf_counter() - begun) < seconds:
            self.ask(b"u1")
            count += 1
        return count / passed

    @property
    def memory(self) -> float:
        """Resident memory, MB."""
        status = Path(f"/proc/{self.process.pid}/status").read_text("ascii")
        return int(status.partition("VmRSS:")[2].split()[0]) / 1024

    def close(self) -> None:
        """End the simulator."""
        self.client.close()
        for process in (self.viewers, self.process):
            process.kill()
            process.communicate()


def measure(turns: int, seconds: float, *options: str) -> dict[str, float]:
    """Medians: round trips a second without viewers and with them, the ratio, and MB that viewers cost."""
    run = Simulator(*options)
    try:
        run.rate(2 * seconds)  # warms up, and fills the kept readings
        alone, watched, ratios, before = [], [], [], run.memory
        most = before
        for _ in range(turns):
            run.look(on=False)
            alone.append(run.rate(seconds))
            run.look(on=True)
            watched.append(run.rate(seconds))
            most = max(most, run.memory)
            ratios.append(watched[-1] / alone[-1])
    finally:
        run.close()
    return {
        "alone": statistics.median(alone),
        "watched": statistics.median(watched),
        "ratio": statistics.median(ratios),
        "least_ratio": min(ratios),
        "memory": most - before,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="fewer and shorter turns")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    parser.add_argument("--view", metavar="PORT", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.view is not None:
        view(options.view)
        return 0
    turns, seconds = (3, 2.0) if options.quick else (7, 4.0)
    figures = {
        "instant motion": measure(turns, seconds),
        "timed motion": measure(turns, seconds, "--motion", "timed"),
    }
    missed = False
    for name, found in figures.items():
        print(
            f"{name}: {found['alone']:,.0f} round trips/s without viewers, {found['watched']:,.0f}/s with "
            f"{VIEWERS}; ratio {found['ratio']:.2f} (least {found['least_ratio']:.2f}, goal {GOAL}); "
            f"{found['memory']:.0f} MB more (goal {MEMORY_GOAL:.0f})"
        )
        missed |= found["ratio"] < GOAL or found["memory"] > MEMORY_GOAL
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
