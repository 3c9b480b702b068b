"""Cost of the terminal app, to the robot and in itself.

    python benchmarks/bench_screen.py [--quick] [--json FILE]

The app runs on a pty of 120 x 36, read by a thread as a terminal would. Printed are round trips a second of
`u1` with the app open as a ratio to headless (goal 0.7; in turn, in one run), the longest stall of a client
while the terminal reads nothing for 5 s (goal below 50 ms), and the app's fraction of a processor when
nothing happens (goal 1 %) and at 10 frames a second with the robot turning and its rays drawn (goal 10 %),
with its memory. Finally a client drives and reads as fast as it can: bytes a second (goal 25 KB), pictures of
the maze a second (8 are shown; goal 7) and the fraction of a processor that the screen's own thread takes
(goal 12 %); the same for a robot that follows a wall, steered 50 times a second (goals 24 KB, 10 %). Then
with each scan of a lidar as well, 5.5 a second, alternately with and without (goals the same). Needs Linux
for /proc.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import json
import math
import os
import re
import select
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import termios
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from simmer_tui.config.sets import bundled_folder, init_set

MAIN = [sys.executable, "-m", "simmer_tui", "--seed", "5", "--reply-port", "0", "--belief-port", "0"]
COLUMNS, ROWS = 120, 36
STARTS_WITHIN = 60.0
"""Seconds; a busy machine needs some."""
SHOWN_WITHIN = 2.0
"""Seconds to wait for a key's effect."""
SCANS_A_SECOND = 5.5
"""Turns of a lidar's head."""
LIDAR = "lidar1,sc,1,0,0,4,0,0.01,,\n"
"""Its row in the default set's sensors.csv."""
PORT = re.compile(rb"commands on port (\d+)")
PLACES = re.compile(rb"\x1b\[(\d+);(\d+)H")
"""Sequences that place the cursor: at this size the maze has rows 2 to 23 and columns 1 to 82."""


class Screen:
    """The app on a pty; what it writes is thrown away."""

    def __init__(self, *options: str) -> None:
        self.port = free_port()
        self.master, slave = os.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
        with tempfile.TemporaryDirectory() as folder:
            environment = {
                "TERM": "xterm-256color",
                "COLORTERM": "truecolor",
                "LC_ALL": "C.UTF-8",
                # If these are set, as by readline below pytest, they have priority over the pty's own size.
                "COLUMNS": str(COLUMNS),
                "LINES": str(ROWS),
            }
            self.process = subprocess.Popen(
                [*MAIN, "--port", str(self.port), "--pace", "off", *options],
                stdin=slave,
                stdout=slave,
                stderr=slave,
                start_new_session=True,
                env=os.environ | environment | {"XDG_DATA_HOME": folder},
            )
            os.close(slave)
            self.bytes = 0
            self.pictures = 0
            self.reading = threading.Event()
            self.reading.set()
            self._over = False
            self._watched: Callable[[bytes], bool] | None = None
            self._shown = threading.Event()
            self._seen_at = 0.0
            self._thread = threading.Thread(target=self._read, daemon=True)
            self._thread.start()
            self._wait_until_it_runs()

    def _wait_until_it_runs(self) -> None:
        """Wait for the first picture: the app listens before it draws, and reads keys only after."""
        end = time.perf_counter() + STARTS_WITHIN
        while self.process.poll() is None and time.perf_counter() < end:
            if self.pictures:
                with contextlib.suppress(ConnectionRefusedError), connected(self.port):
                    return
            time.sleep(0.05)
        self.close()
        raise SystemExit(f"the app did not run on port {self.port} within {STARTS_WITHIN:g} s")

    def _read(self) -> None:
        while not self._over:
            self.reading.wait(0.05)
            if self.reading.is_set() and select.select([self.master], [], [], 0.05)[0]:
                data = os.read(self.master, 65536)
                self.bytes += len(data)
                if self._watched is not None and self._watched(data):
                    self._seen_at, self._watched = time.perf_counter(), None
                    self._shown.set()
                self.pictures += any(
                    1 < int(row) <= 22 and int(column) <= 82 for row, column in PLACES.findall(data)
                )

    def watch(self, shown: Callable[[bytes], bool]) -> None:
        """Begin to look for written bytes."""
        self._shown.clear()
        self._watched = shown

    def seen_at(self) -> float:
        """Time at which they were written; waits for them. NaN if they were not."""
        return self._seen_at if self._shown.wait(SHOWN_WITHIN) else math.nan

    def processor_seconds(self) -> float:
        """Processor time used so far."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def screen_seconds(self) -> float:
        """Processor time of the thread that draws: the process's first."""
        pid = self.process.pid
        fields = Path(f"/proc/{pid}/task/{pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def megabytes(self) -> float:
        """Present memory, MB."""
        pages = int(Path(f"/proc/{self.process.pid}/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / 1e6

    def fraction(self, seconds: float) -> float:
        """The fraction of a processor used for some time."""
        before, started = self.processor_seconds(), time.perf_counter()
        time.sleep(seconds)
        return (self.processor_seconds() - before) / (time.perf_counter() - started)

    def close(self) -> None:
        self._over = True
        self._thread.join()
        self.process.kill()
        self.process.wait()
        os.close(self.master)


@contextlib.contextmanager
def screen(*options: str) -> Iterator[Screen]:
    made = Screen(*options)
    try:
        yield made
    finally:
        made.close()


@contextlib.contextmanager
def headless() -> Iterator[int]:
    """A run without a screen; its command port."""
    process = subprocess.Popen(
        [*MAIN, "--port", "0", "--no-ui"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    try:
        assert process.stdout is not None
        found = PORT.search(process.stdout.readline())
        assert found is not None
        yield int(found[1])
    finally:
        process.kill()
        process.communicate()


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return int(taken.getsockname()[1])


def connected(port: int) -> socket.socket:
    client = socket.create_connection(("127.0.0.1", port))
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return client


def ask(client: socket.socket, command: bytes) -> float:
    client.sendall(command)
    reply = client.recv(8)
    while len(reply) < 8:
        reply += client.recv(8 - len(reply))
    (value,) = struct.unpack(">d", reply)
    return float(value)


def rate(client: socket.socket, seconds: float) -> float:
    """Round trips a second."""
    started, count = time.perf_counter(), 0
    while time.perf_counter() - started < seconds:
        ask(client, b"u1\n")
        count += 1
    return count / (time.perf_counter() - started)


def measure_rates(seconds: float, repeats: int) -> tuple[float, float, float]:
    """Rates headless and with the app open, and the median of the ratios of neighbours."""
    pairs = []
    with headless() as port, screen() as app, connected(port) as plain, connected(app.port) as watched:
        for repeat in range(repeats + 1):
            pair = rate(plain, seconds), rate(watched, seconds)
            if repeat:  # the first warms up
                pairs.append(pair)
    ratio = statistics.median(ours / theirs for theirs, ours in pairs)
    return statistics.median(a for a, _ in pairs), statistics.median(b for _, b in pairs), ratio


def measure_stall(seconds: float) -> float:
    """The longest wait of a client, seconds, while the terminal read nothing."""
    longest = 0.0
    with screen("--fps", "20") as app, connected(app.port) as client:
        rate(client, 1.0)
        app.reading.clear()
        end = time.perf_counter() + seconds
        while time.perf_counter() < end:
            started = time.perf_counter()
            ask(client, b"r1-11\n")
            longest = max(longest, time.perf_counter() - started)
        app.reading.set()
    return longest


def measure_load(seconds: float) -> dict[str, float]:
    """Shares of a processor, memory, and bytes a frame."""
    figures = {}
    with screen() as app, connected(app.port) as client:
        time.sleep(3.0)
        figures["idle share"] = app.fraction(seconds)
        over = threading.Event()

        def drive() -> None:
            while not over.wait(0.1):
                for command in (b"r1-7\n", b"u1\n", b"u2\n", b"i1\n"):
                    ask(client, command)

        program = threading.Thread(target=drive)
        program.start()
        time.sleep(1.0)
        before = app.bytes
        figures["10 fps share"] = app.fraction(seconds)
        figures["bytes a frame"] = (app.bytes - before) / seconds / 10
        over.set()
        program.join()
        figures["megabytes"] = app.megabytes()
        rate(client, seconds)
        figures["megabytes after a flood"] = app.megabytes()
    return figures


class Follower:
    """A program that follows a wall in timed motion, steered fifty times a second."""

    def __init__(self, app: Screen, client: socket.socket) -> None:
        self._app, self._client = app, client
        self._tick = time.perf_counter()
        self._scanned = -math.inf

    def drive(self, seconds: float, *, scans: bool = False) -> dict[str, float]:
        """Drive for some time, with `scans` of a lidar at each of its turns. Kilobytes a second and the share
        of the screen's thread meanwhile."""
        app, client = self._app, self._client
        sent, drawn = app.bytes, app.pictures
        used, begun = app.screen_seconds(), time.perf_counter()
        while (now := time.perf_counter()) < begun + seconds:
            ahead, left = ask(client, b"u1\n"), ask(client, b"u2\n")
            speed, steer = (4.0, max(-60.0, min(60.0, 8.0 * (left - 4.0)))) if ahead > 6.0 else (0.0, -60.0)
            ask(client, f"vv-{speed:g};0;{steer:.1f}\n".encode())
            if scans and now - self._scanned >= 1.0 / SCANS_A_SECOND:
                self._scanned = max(self._scanned + 1.0 / SCANS_A_SECOND, now - 0.02)
                skip_scan(client)
            self._tick += 0.02
            time.sleep(max(self._tick - time.perf_counter(), 0.0))
        passed = time.perf_counter() - begun
        return {
            "follower kilobytes": (app.bytes - sent) / passed / 1000,
            "follower screen share": (app.screen_seconds() - used) / passed,
            "follower pictures": (app.pictures - drawn) / passed,
        }


def skip_scan(client: socket.socket) -> None:
    """Request a scan: the reply is the count of numbers, and the numbers."""
    left = 8 * int(ask(client, b"sc\n"))
    while left:
        left -= len(client.recv(left))


def measure_follower(seconds: float) -> dict[str, float]:
    """Kilobytes a second and the screen's share while a program follows a wall."""
    with screen("--motion", "timed") as app, connected(app.port) as client:
        follower = Follower(app, client)
        follower.drive(2.0)
        return follower.drive(seconds)


def measure_scans(seconds: float, repeats: int) -> dict[str, float]:
    """The same with and without the scans of a lidar, alternately: the medians."""
    found: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "set"
        init_set(path, bundled_folder())
        with (path / "sensors.csv").open("a", encoding="utf-8") as file:
            file.write(LIDAR)
        for turn in range(2 * repeats):
            # A new app each time: a robot that follows a wall for long drives over its own trail, where less
            # changes.
            scans = turn % 2 > 0
            with screen("--motion", "timed", "--config", str(path)) as app, connected(app.port) as client:
                follower = Follower(app, client)
                follower.drive(2.0, scans=scans)
                for name, figure in follower.drive(seconds, scans=scans).items():
                    found.setdefault(f"{name} with{'' if scans else 'out'} scans", []).append(figure)
    return {name: statistics.median(figures) for name, figures in found.items()}


def measure_full_speed(seconds: float) -> dict[str, float]:
    """Kilobytes, pictures and commands a second while a client drives and reads as fast as it can."""
    commands = (
        b"r1-7\n",
        b"u1\n",
        b"u2\n",
        b"u3\n",
        b"u4\n",
        b"d1-1\n",
        b"u1\n",
        b"u5\n",
        b"a1-1\n",
        b"o3\n",
    )
    with screen() as app, connected(app.port) as client:
        over = time.perf_counter() + 2.0
        while time.perf_counter() < over:
            for command in commands:
                ask(client, command)
        sent, drawn, used = app.bytes, app.pictures, app.screen_seconds()
        started, asked = time.perf_counter(), 0
        while time.perf_counter() - started < seconds:
            for command in commands:
                ask(client, command)
            asked += len(commands)
        passed = time.perf_counter() - started
        return {
            "full speed kilobytes": (app.bytes - sent) / passed / 1000,
            "full speed pictures": (app.pictures - drawn) / passed,
            "full speed screen share": (app.screen_seconds() - used) / passed,
            "full speed commands": asked / passed,
        }


def take_keys(app: Screen, focus: bytes, stroke: bytes, shown: Callable[[bytes], bool]) -> None:
    """Bring the keys to one part of the screen; returns when a stroke there is shown.

    An app distinguishes the escape key from the start of a sequence by the time after it. An app that is
    delayed for as long reads it and the next key as one sequence, so the keys must be sent again.
    """
    end = time.perf_counter() + STARTS_WITHIN
    while time.perf_counter() < end:
        os.write(app.master, focus)
        time.sleep(1.0)
        app.watch(shown)
        os.write(app.master, stroke)
        if not math.isnan(app.seen_at()):
            return
    raise SystemExit(f"the key {stroke!r} after {focus!r} was not shown within {STARTS_WITHIN:g} s")


def measure_keys(keys: int, busy: bool) -> dict[str, float]:
    """From a key to the first bytes that show it, seconds at the 95th percentile: a letter typed into the
    console, and a key that turns the robot; with a client at full speed if `busy`. If more than one key in
    ten is never shown, these count with their whole waiting time."""
    figures = {}
    with screen() as app, connected(app.port) as client:
        over = threading.Event()

        def drive() -> None:
            while not over.is_set():
                ask(client, b"u1\n")

        program = threading.Thread(target=drive)
        if busy:
            program.start()
        try:
            for name, focus, strokes, shown in (
                ("robot", b"\x1b", (b"d", b"a"), in_maze),
                ("letter", b":", (b"\x7f", b"u"), in_console),
            ):
                time.sleep(1.0)
                take_keys(app, focus, strokes[1], shown)
                waits = []
                for number in range(keys):
                    time.sleep(0.09 + 0.003 * (number % 17))  # at every phase of the frames
                    app.watch(shown)
                    started = time.perf_counter()
                    os.write(app.master, strokes[number % 2])
                    wait = app.seen_at() - started
                    # On a busy machine the rest of one picture may count as the next one. Then two strokes,
                    # there and back, are one picture in which nothing changes.
                    if not math.isnan(wait):
                        waits.append(wait)
                if len(waits) < 0.9 * keys:
                    waits += [SHOWN_WITHIN] * (keys - len(waits))
                figures[f"key to {name}"] = statistics.quantiles(waits, n=20)[-1]
        finally:
            over.set()
            if busy:
                program.join()
    return figures


def in_maze(data: bytes) -> bool:
    return any(1 < int(row) <= 22 for row, _ in PLACES.findall(data))


def in_console(data: bytes) -> bool:
    return any(int(row) >= ROWS - 2 for row, _ in PLACES.findall(data))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="shorter runs")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    options = parser.parse_args()
    seconds = 2.0 if options.quick else 5.0
    plain, watched, ratio = measure_rates(seconds / 2, 2 if options.quick else 5)
    print(f"round trips a second: headless {plain:.0f}, app open {watched:.0f}, ratio {ratio:.2f} (goal 0.7)")
    stall = measure_stall(5.0)
    print(f"longest stall while the terminal is stopped: {1000 * stall:.1f} ms (goal 50)")
    load = measure_load(2 * seconds)
    print(
        f"processor: idle {load['idle share']:.1%} (goal 1 %), 10 fps {load['10 fps share']:.1%} (goal 10 %)"
    )
    print(f"bytes a frame: {load['bytes a frame']:.0f}")
    print(f"memory: {load['megabytes']:.0f} MB, after a flood {load['megabytes after a flood']:.0f} MB")
    full = measure_full_speed(2 * seconds)
    print(
        f"at full speed ({full['full speed commands']:.0f} commands a second): "
        f"{full['full speed kilobytes']:.1f} KB/s (goal 25), maze {full['full speed pictures']:.1f} a second "
        f"(goal 7), the screen's thread {full['full speed screen share']:.1%} (goal 12 %)"
    )
    follower = measure_follower(2 * seconds)
    print(
        f"with a wall follower at 50 Hz, timed: {follower['follower kilobytes']:.1f} KB/s (goal 24), the "
        f"screen's thread {follower['follower screen share']:.1%} (goal 10 %)"
    )
    scans = measure_scans(2 * seconds, 2 if options.quick else 3)
    for name in ("without", "with"):
        print(
            f"the same {name} {SCANS_A_SECOND} scans a second: "
            f"{scans[f'follower kilobytes {name} scans']:.1f} KB/s (goal 24), maze "
            f"{scans[f'follower pictures {name} scans']:.1f} a second, the screen's thread "
            f"{scans[f'follower screen share {name} scans']:.1%} (goal 10 %)"
        )
    keys: dict[str, float] = {}
    for busy in (False, True):
        found = measure_keys(40 if options.quick else 200, busy)
        when = "with a client at full speed" if busy else "idle"
        print(
            f"key to screen, p95, {when}: "
            + ", ".join(
                f"{name.removeprefix('key to ')} {1000 * value:.1f} ms" for name, value in found.items()
            )
            + " (goal 25)"
        )
        keys |= {f"{name} {when}": value for name, value in found.items()}
    figures = (
        keys
        | {"headless": plain, "app": watched, "ratio": ratio, "stall": stall}
        | load
        | full
        | follower
        | scans
    )
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
