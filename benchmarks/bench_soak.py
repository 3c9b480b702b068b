"""A soak: commands by the million while a program on each other port misbehaves at once.

    python benchmarks/bench_soak.py [--six] [--commands N | --quick] [--json FILE]

The simulator runs headless in a process of its own. One client asks `u1` on the command port, N times: a
tenth of them alone, then with the others: endless beliefs, `xx` and garbage, half requests, connections that
close one side and read nothing, and many connections that are opened and reset. Printed are the time of a
round trip alone and in the soak (median, p99, longest), the simulator's memory at a tenth and at the end, and
the time to end after SIGTERM. Goals: p99 below 20 ms, memory flat within a tenth, the end within 2 s. POSIX
only.

With `--six` the others are one of each of these: it opens silent connections in a loop, sends blank lines,
sends half packets, never reads its replies, connects and leaves, or drives from the page. Then the client
asks different sensors, and each reply must be nearest to the usual one of its sensor. Descriptors must be
flat too. A hundred stops are sent at the end: each is to be answered within 100 ms.
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import itertools
import json
import math
import multiprocessing
import os
import re
import signal
import socket
import statistics
import struct
import subprocess
import sys
import time
from multiprocessing.synchronize import Barrier
from pathlib import Path
from typing import Any

GOAL_P99, GOAL_GROWTH, GOAL_END, GOAL_STOP = 0.020, 1.10, 2.0, 0.1
SENSORS = (b"u1\n", b"u2\n", b"u3\n", b"u4\n", b"u5\n")
STOPS = 100
BELIEF = b'{"x":1,"y":2,"heading":3}\n'
CLOUD = b'{"x":1,"y":2,"heading":3,"particles":[' + b"[1,2]," * 20_000 + b"[1,2]]}\n"
FLOODS = {
    "beliefs": [BELIEF * 1000, b"\n" * 30_000, CLOUD, b"{" * 30_000],
    "replies": [b"x" * 30_000],
    "packets": [
        b"[u0]" * 1000,
        b"[xx]" * 1000,
        b"[]" * 2000,
        b"\xff[[,]" * 1000,
        b"[" + b"u0," * 900 + b"u0]",
    ],
    "packet replies": [b"x" * 30_000],
}


def misbehave(port: int, data: bytes, begun: Barrier) -> None:
    """Send without end and read nothing; reconnect whenever the connection is closed."""
    begun.wait()
    while True:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port)) as sock:
            while True:
                sock.sendall(data)


def come_and_go(port: int, begun: Barrier) -> None:
    """Half requests, half-open replies and resets."""
    begun.wait()
    while True:
        with contextlib.suppress(OSError), socket.socket() as sock:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
            sock.connect(("127.0.0.1", port))
            sock.sendall(b"[u0,u1" * (int(time.time() * 1000) % 3))
            if int(time.time() * 1000) % 2:
                sock.shutdown(socket.SHUT_WR)
                time.sleep(0.01)
            else:
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        time.sleep(0.005)


def keep_silent(port: int, begun: Barrier) -> None:
    """Open connections in a loop and send nothing; 300 are open at once."""
    begun.wait()
    kept: list[socket.socket] = []
    while True:
        with contextlib.suppress(OSError):
            kept.append(socket.create_connection(("127.0.0.1", port)))
        if len(kept) > 300:
            kept.pop(0).close()


def send_blank_lines(port: int, begun: Barrier) -> None:
    misbehave(port, b"\n" * 30_000, begun)


def send_halves(port: int, begun: Barrier) -> None:
    """Send half a packet and leave a moment later."""
    begun.wait()
    while True:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port)) as sock:
            sock.sendall(b"[u1,u")
            time.sleep(0.01)


def never_read(port: int, begun: Barrier) -> None:
    misbehave(port, b"[u1]" * 1000, begun)


def reconnect(port: int, begun: Barrier) -> None:
    """Connect and leave at once."""
    begun.wait()
    while True:
        with contextlib.suppress(OSError):
            socket.create_connection(("127.0.0.1", port)).close()


def drive_page(port: int, begun: Barrier) -> None:
    """Send lines of the console from a page that drives, and read what the page shows."""
    key = base64.b64encode(os.urandom(16)).decode()
    data = b'{"line":"d1-0"}'
    frame = bytes((0x81, 0x80 | len(data), 0, 0, 0, 0)) + data
    begun.wait()
    while True:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port)) as sock:
            sock.sendall(
                f"GET /live HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nOrigin: http://127.0.0.1:{port}\r\n"
                f"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: {key}\r\n"
                "Sec-WebSocket-Version: 13\r\n\r\n".encode()
            )
            sock.sendall(b"\x81\x82\0\0\0\0{}")
            while sock.recv(1 << 18):
                sock.sendall(frame * 100)


SIX = {
    "packets": [keep_silent, send_halves, never_read],
    "beliefs": [send_blank_lines],
    "commands": [reconnect],
    "page": [drive_page],
}


def descriptors(pid: int) -> float:
    """Count of open descriptors of a process; NaN if the system does not report it."""
    try:
        return len(os.listdir(f"/proc/{pid}/fd"))  # noqa: PTH208 - names will do
    except OSError:
        return float("nan")


def memory(pid: int) -> float:
    """Resident megabytes of a process; NaN if the system does not report it."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except OSError:
        return float("nan")
    return pages * 4096 / 1e6


class Asker:
    """The client that behaves."""

    def __init__(self, port: int, sensors: tuple[bytes, ...]) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), 30)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._sensors = sensors
        self._usual = [statistics.mean(self.ask(each)[1] for _ in range(20)) for each in sensors]
        self.wrong = 0
        """Replies that are not their sensor's."""

    def ask(self, line: bytes) -> tuple[float, float]:
        """Seconds of a round trip, and its reply."""
        begin = time.perf_counter()
        self._socket.sendall(line)
        data = self._socket.recv(8)
        if len(data) != 8:
            raise ConnectionError("the simulator has closed the connection")
        return time.perf_counter() - begin, struct.unpack(">d", data)[0]

    def times(self, count: int) -> list[float]:
        """Seconds of so many round trips."""
        found = []
        for number, line in zip(range(count), itertools.cycle(self._sensors), strict=False):
            seconds, reading = self.ask(line)
            # The readings of the bundled set differ by a fifth at least, and err by some hundredths.
            distances = [abs(math.log(reading / usual)) for usual in self._usual]
            self.wrong += distances.index(min(distances)) != number % len(self._sensors)
            found.append(seconds)
        return found


def summary(times: list[float]) -> dict[str, float]:
    """Median, p99 and longest, in milliseconds."""
    ordered = sorted(times)
    p99 = ordered[int(0.99 * (len(ordered) - 1))]
    return {"median": 1e3 * statistics.median(ordered), "p99": 1e3 * p99, "longest": 1e3 * ordered[-1]}


def soak(commands: int, *, six: bool = False) -> dict[str, float]:
    """All the figures."""
    options = ["--no-ui", "--port", "0", "--listeners", "binary,packets", "--quiet"]
    process = subprocess.Popen(
        [sys.executable, "-m", "simmer_tui", *options, *(("--web", "0", "--web-control") if six else ())],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdout is not None
    head = process.stdout.readline().partition("configuration")[2]
    ports = dict(re.findall(r"(?:, )?(\w[\w ]*?) on port (\d+)", head))
    while six and "page" not in ports:
        ports |= re.findall(r"(page) to drive: .*?:(\d+)/", process.stdout.readline())
    rude = multiprocessing.get_context("spawn")
    others: list[Any] = []
    try:
        client = Asker(int(_port(ports, "commands")), SENSORS if six else SENSORS[:1])
        quiet = summary(client.times(max(100, commands // 10)))
        begun = rude.Barrier(1 + (6 if six else sum(1 + len(floods) for floods in FLOODS.values())))
        for purpose, floods in (SIX if six else FLOODS).items():
            number = int(_port(ports, purpose))
            ways: list[Any] = [
                (each, (number, begun)) if callable(each) else (misbehave, (number, each, begun))
                for each in floods
            ]
            if not six:
                ways.append((come_and_go, (number, begun)))
            others += [rude.Process(target=way, args=given, daemon=True) for way, given in ways]
        for each in others:
            each.start()
        begun.wait()  # their start takes more of the processor than their work
        times = client.times(max(100, commands // 10))
        early, few = memory(process.pid), descriptors(process.pid)
        times += client.times(max(100, commands - 2 * (commands // 10)))
        late, many = memory(process.pid), descriptors(process.pid)
        stops = summary([client.ask(b"xx\n")[0] for _ in range(STOPS)])
        begin = time.perf_counter()
        process.send_signal(signal.SIGTERM)
        process.wait(60)
        end = time.perf_counter() - begin
    finally:
        for each in others:
            each.kill()
        process.kill()
        process.communicate()
    figures = {f"quiet {name} ms": value for name, value in quiet.items()}
    figures |= {f"soak {name} ms": value for name, value in summary(times).items()}
    figures |= {f"stop {name} ms": value for name, value in stops.items()}
    figures |= {"wrong replies": client.wrong, "descriptors at a tenth": few, "descriptors at the end": many}
    return figures | {"MB at a tenth": early, "MB at the end": late, "end s": end}


def _port(ports: dict[str, str], purpose: str) -> str:
    return next(number for name, number in ports.items() if name.endswith(purpose))


def main() -> int:
    """Print the figures; returns 1 if a goal is missed."""
    parser = argparse.ArgumentParser(description="Soak the simulator while others misbehave.")
    parser.add_argument("--commands", type=int, default=1_000_000, help="round trips (default: 1000000)")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    parser.add_argument("--quick", action="store_true", help="2000 round trips")
    parser.add_argument("--six", action="store_true", help="six others, and replies are checked")
    options = parser.parse_args()
    figures = soak(2000 if options.quick else options.commands, six=options.six)
    for name, value in figures.items():
        print(f"{name:22} {value:10.2f}")
    missed = [
        name
        for name, good in {
            "p99": figures["soak p99 ms"] < 1e3 * GOAL_P99,
            "memory": not figures["MB at the end"] > GOAL_GROWTH * figures["MB at a tenth"],
            "descriptors": not figures["descriptors at the end"] > figures["descriptors at a tenth"] + 300,
            "stop": not options.six or figures["stop longest ms"] <= 1e3 * GOAL_STOP,
            "replies": not options.six or not figures["wrong replies"],
            "end": figures["end s"] < GOAL_END,
        }.items()
        if not good
    ]
    print(f"goals: {'missed: ' + ', '.join(missed) if missed else 'reached'}")
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
