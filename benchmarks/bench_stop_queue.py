"""Time of a stop behind 10,000 drives: until the simulated robot stands, or its bytes go to a real one.

    python benchmarks/bench_stop_queue.py [--quick] [--json FILE]

The drives have all been received, a thousand of them wait, the others were answered busy. The goal is a 99th
percentile of 50 ms.
"""

from __future__ import annotations

import argparse
import json
import socket
import sys
import threading
import time
from pathlib import Path

from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.config.settings_file import Override
from simmer_tui.links.serial_link import LinkListener
from simmer_tui.live.server import Server
from simmer_tui.run.events import Event
from simmer_tui.sim import CommandResult, Status

GOAL = 0.05
DRIVES, WAITING = 10_000, 1000
PLACES = {
    "simulated, timed": {"motion.motion": "timed", "motion.reply": "done"},
    "simulated, a pause after each command": {"step_time": 1.0},
    "on a mute serial port": {"serial.port": "mute", "sim": False, "serial.timeout": 60.0},
}


class Watch:
    """A link to a robot that answers nothing, with the measured times."""

    name = "mute"
    restarts_board = False

    def __init__(self) -> None:
        self.refused = 0
        self.stopped_at = 0.0
        """Time of the stop, noted by the thread that stops: the waiting one wakes up later."""
        self.stopped = threading.Event()
        self.taken_in = threading.Event()

    def told(self, event: Event) -> None:
        if isinstance(event, CommandResult):
            self.refused += event.status is Status.BUSY
            if self.refused >= DRIVES - WAITING - 50:
                self.taken_in.set()
            if event.status is Status.STOPPED:
                self._stop()

    def _stop(self) -> None:
        if not self.stopped.is_set():
            self.stopped_at = time.perf_counter()
            self.stopped.set()

    def start(self, listener: LinkListener) -> None:
        listener.opened()

    def write(self, data: bytes) -> None:
        if b"xx" in data:
            self._stop()

    def write_instead(self, data: bytes) -> list[bytes]:
        self.write(data)
        return []

    def close(self) -> None:
        """Nothing is open."""


def seconds_to_stop(settings: dict[str, object]) -> float:
    """Seconds from sending the stop until the robot stands or the bytes are sent."""
    given = {"server.port": 0, "server.listeners": "binary,packets", **settings}
    watch = Watch()
    configuration = load(bundled_folder(), {name: Override("--it", value) for name, value in given.items()})
    server = Server(configuration, robot_link=lambda serial: watch)
    server.start(watch.told)
    address = ("127.0.0.1", server.ports["packets"])
    try:
        with socket.create_connection(address) as program:
            program.sendall(b"[d1:1]" * DRIVES)
            assert watch.taken_in.wait(60), "the drives were not taken in"
            begun = time.perf_counter()
            program.sendall(b"[xx]")
            assert watch.stopped.wait(60), "the stop did not arrive"
            return watch.stopped_at - begun
    finally:
        server.stop()


def main() -> int:
    """Returns 1 if it took longer than the goal."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="three times each")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    options = parser.parse_args()
    figures = {}
    for name, settings in PLACES.items():
        times = sorted(seconds_to_stop(settings) for _ in range(3 if options.quick else 100))
        figures[name] = times[min(len(times) - 1, round(0.99 * len(times)))]
        print(f"{name}: 99th percentile {1000 * figures[name]:.1f} ms (goal {1000 * GOAL:.0f})", flush=True)
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")
    return 0 if max(figures.values()) <= GOAL else 1


if __name__ == "__main__":
    sys.exit(main())
