"""A soak: commands by the million while a program on each other port misbehaves at once.

    python benchmarks/bench_soak.py [--commands N | --quick] [--json FILE]

The simulator runs headless in a process of its own. One client asks `u1` on the command port, N times: a
tenth of them alone, then with the others: endless beliefs, `xx` and garbage, half requests, connections that
close one side and read nothing, and many connections that are opened and reset. Printed are the time of a
round trip alone and in the soak (median, p99, longest), the simulator's memory at a tenth and at the end, and
the time to end after SIGTERM. Goals: p99 below 20 ms, memory flat within a tenth, the end within 2 s. POSIX
only.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import multiprocessing
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

GOAL_P99, GOAL_GROWTH, GOAL_END = 0.020, 1.10, 2.0
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


def memory(pid: int) -> float:
    """Resident megabytes of a process; NaN if the system does not report it."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except OSError:
        return float("nan")
    return pages * 4096 / 1e6


def ask(client: socket.socket, count: int) -> list[float]:
    """Seconds of so many round trips."""
    times = []
    for _ in range(count):
        begin = time.perf_counter()
        client.sendall(b"u1\n")
        if len(client.recv(8)) != 8:
            raise ConnectionError("the simulator has closed the connection")
        times.append(time.perf_counter() - begin)
    return times


def summary(times: list[float]) -> dict[str, float]:
    """Median, p99 and longest, in milliseconds."""
    ordered = sorted(times)
    p99 = ordered[int(0.99 * (len(ordered) - 1))]
    return {"median": 1e3 * statistics.median(ordered), "p99": 1e3 * p99, "longest": 1e3 * ordered[-1]}


def soak(commands: int) -> dict[str, float]:
    """All the figures."""
    options = ["--no-ui", "--port", "0", "--listeners", "binary,packets", "--quiet"]
    process = subprocess.Popen(
        [sys.executable, "-m", "simmer_tui", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdout is not None
    ports = dict(
        re.findall(
            r"(?:, )?(\w[\w ]*?) on port (\d+)", process.stdout.readline().partition("configuration")[2]
        )
    )
    rude = multiprocessing.get_context("spawn")
    others: list[Any] = []
    try:
        client = socket.create_connection(("127.0.0.1", int(_port(ports, "commands"))), 30)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        quiet = summary(ask(client, max(100, commands // 10)))
        begun = rude.Barrier(1 + sum(1 + len(floods) for floods in FLOODS.values()))
        for purpose, floods in FLOODS.items():
            number = int(_port(ports, purpose))
            ways: list[Any] = [(misbehave, (number, data, begun)) for data in floods]
            ways.append((come_and_go, (number, begun)))
            others += [rude.Process(target=way, args=given, daemon=True) for way, given in ways]
        for each in others:
            each.start()
        begun.wait()  # their start takes more of the processor than their work
        times = ask(client, max(100, commands // 10))
        early = memory(process.pid)
        times += ask(client, max(100, commands - 2 * (commands // 10)))
        late = memory(process.pid)
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
    return figures | {"MB at a tenth": early, "MB at the end": late, "end s": end}


def _port(ports: dict[str, str], purpose: str) -> str:
    return next(number for name, number in ports.items() if name.endswith(purpose))


def main() -> int:
    """Print the figures; returns 1 if a goal is missed."""
    parser = argparse.ArgumentParser(description="Soak the simulator while others misbehave.")
    parser.add_argument("--commands", type=int, default=1_000_000, help="round trips (default: 1000000)")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    parser.add_argument("--quick", action="store_true", help="2000 round trips")
    options = parser.parse_args()
    figures = soak(2000 if options.quick else options.commands)
    for name, value in figures.items():
        print(f"{name:20} {value:10.2f}")
    missed = [
        name
        for name, good in {
            "p99": figures["soak p99 ms"] < 1e3 * GOAL_P99,
            "memory": not figures["MB at the end"] > GOAL_GROWTH * figures["MB at a tenth"],
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
