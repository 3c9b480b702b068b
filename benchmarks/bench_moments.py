"""Frames that disagree with themselves, with the bytes and frames a second of the screen.

    python benchmarks/bench_moments.py [--frames N] [--size 120x36] [--case wander-full ...] [--json FILE]

The app runs a sample program on a pty, as fast as possible and at the usual pace. Every frame is read off the
terminal (its updates are synchronized, so each ends with a mark) and put into an emulated screen. In each
frame the current values are compared: the last reply with its sensor's row, the pose with the picture, one
belief with the other, the time with the newest event, contacts with contacts. Printed for each case: frames,
frames that disagree (goal 0) by kind, KB a second (goal 24 at 120x36, 45 at 200x60), frames a second while
the robot moves (goal 15), and the 90th percentile of the time from one such frame to the next (goal 90 ms).
Needs Unix for the pty, and pyte.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import itertools
import json
import math
import os
import re
import select
import signal
import statistics
import struct
import subprocess
import sys
import tempfile
import termios
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyte

ROOT = Path(__file__).resolve().parent.parent
PROGRAMS = {"wander": ("wander.py", ()), "solve": ("solve.py", ("--mission",))}
"""Sample programs, and the options of the run for each."""
PACES = {"full": ("--pace", "off"), "pace": ()}
UPDATE_ENDS = b"\x1b[?2026l"
"""Mark at the end of a synchronized update."""
UNKNOWN_TO_PYTE = re.compile(rb"\x1b\[[<>=?][0-9;]*[a-zA-Z]|\x1b\[[0-9;?]*\$p|\x1bP.*?\x1b\\", re.DOTALL)
STARTS_WITHIN = 120.0
"""Seconds; a busy machine needs some."""
ENDED_AFTER = 10.0
"""Seconds without a byte after which the program has ended."""
SETTLING = 3.0
"""Seconds after the program's first command that are left out of rates."""
ROBOT = "afffd7"
"""Colour of the robot in the dark look."""
PIXELS = " ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"
"""Quadrants by the pixels that they show: bit 0 top left, 1 top right, 2 and 3 below."""
APART = 1.3
"""Inches from the pose to the middle of the drawn robot: half a pixel, and half a digit."""
GAP_ENDS = 1.0
"""Seconds without a frame after which the robot did not move: it waits for its program."""


class Update(NamedTuple):
    """Bytes of the app up to the end of one frame, and the time at which they had come, seconds."""

    at: float
    data: bytes


def capture(size: tuple[int, int], command: Sequence[str], frames: int, seconds: float) -> list[Update]:
    """Updates of a run on a terminal of columns and rows, until there are `frames` of them after the first
    reply, or for some seconds. The terminal says that it takes synchronized updates."""
    columns, rows = size
    master, slave = os.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
    with tempfile.TemporaryDirectory() as folder:
        kept = {key: os.environ[key] for key in ("PATH", "HOME", "PYTHONPATH") if key in os.environ}
        variables = {"TERM": "xterm-256color", "COLORTERM": "truecolor", "LC_ALL": "C.UTF-8"}
        process = subprocess.Popen(
            command, stdin=slave, stdout=slave, stderr=slave, start_new_session=True, cwd=folder,
            env=kept | variables | {"XDG_DATA_HOME": folder},
        )  # fmt: skip
        os.close(slave)
        try:
            return list(_updates(master, process, frames, seconds))
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            os.close(master)


def _updates(master: int, process: subprocess.Popen[bytes], frames: int, seconds: float) -> Iterator[Update]:
    held, driven, end = b"", 0, time.monotonic() + STARTS_WITHIN
    last = time.monotonic()
    while driven < frames and time.monotonic() < end and process.poll() is None:
        if not select.select([master], [], [], 0.05)[0]:
            if driven and time.monotonic() - last > ENDED_AFTER:
                return
            continue
        last = time.monotonic()
        try:
            data = os.read(master, 65536)
        except OSError:
            return
        if b"\x1b[?2026$p" in data:
            os.write(master, b"\x1b[?2026;2$y")
        held += data
        *whole, held = held.split(UPDATE_ENDS)
        for each in whole:
            if driven:
                driven += 1
            elif b" -> " in each:
                driven, end = 1, time.monotonic() + seconds
            yield Update(time.monotonic(), each)


class Seen:
    """One frame as it stands on the terminal: its rows, and its cells if the picture is to be read too."""

    def __init__(self, rows: Sequence[str], screen: pyte.Screen | None = None) -> None:
        self._screen = screen
        self.rows = rows
        self.text = "\n".join(rows)

    def number(self, pattern: str) -> float | None:
        """The first group of the first match as a number."""
        found = re.search(pattern, self.text)
        return None if found is None else float(found[1])

    def robot(self) -> tuple[float, float] | None:
        """Middle of the robot's body in the maze, inches; None without one, or if something lies over it."""
        frame = re.search(r"▗▄+▖", self.rows[1])
        if frame is None or self._screen is None:
            return None
        left, wide = frame.start() + 1, len(frame[0]) - 2
        zoom = wide / 8
        high = round(4 * zoom / 2)
        points = []
        for row in range(high):
            line = self._screen.buffer[2 + row]
            for column in range(wide):
                cell = line[left + column]
                if ROBOT not in (cell.bg, cell.fg) or cell.data not in PIXELS:
                    continue
                pattern = PIXELS.index(cell.data)
                pattern = 15 - pattern if cell.bg == ROBOT else pattern
                bits = [bit for bit in range(4) if pattern >> bit & 1]
                points += [(column + bit % 2 / 2 + 0.25, row + bit // 2 / 2 + 0.25) for bit in bits]
        if not points:
            return None
        x, y = np.array(points).T
        # A contact's mark covers a part of the rim.
        if abs((np.ptp(x) + 0.5) - 2 * (np.ptp(y) + 0.5)) > 1.5:
            return None
        scale = zoom / 12
        return float(x.min() + x.max()) / 2 / scale, 48 - float(y.min() + y.max()) / scale


def last_reply(seen: Seen) -> str:
    """The last reply against its sensor's row."""
    reply = re.search(r"(?:last reply +|[ >])([a-z]\d) -> (-?[\d.]+|Inf|inf|no echo)(?: |$)", seen.text, re.M)
    if reply is None or reply[2].lower() == "inf":
        return ""
    code = reply[1]
    row = re.search(rf"\b{code} [^\d\n-]{{0,4}} *(-?\d+(?:\.\d+)?)(?: |$)", seen.text)
    if row is None:
        return ""
    # A row has one digit behind the point, or none where there is no room for it.
    rounding = 0.051 if "." in row[1] else 0.51
    return "" if abs(float(row[1]) - float(reply[2])) <= rounding else f"{code}: {reply[2]}, row {row[1]}"


def pose(seen: Seen) -> str:
    """The pose against the picture."""
    told = re.search(r"pose +(-?\d+\.\d), (-?\d+\.\d) in", seen.text)
    drawn = seen.robot()
    if told is None or drawn is None:
        return ""
    off = math.dist(drawn, (float(told[1]), float(told[2])))
    return "" if off <= APART else f"pose {told[1]}, {told[2]}, drawn {drawn[0]:.1f}, {drawn[1]:.1f}"


def belief(seen: Seen) -> str:
    """All errors of a belief against each other."""
    offs = set(re.findall(r"(?:belief +off|belief is off|belief off) (\d+\.\d)", seen.text))
    return "" if len(offs) <= 1 else f"belief off {sorted(offs)}"


def moment(seen: Seen) -> str:
    """The clock of row 0 against the newest event, the mission's time, and the state beside the pose."""
    clock = re.findall(r"(\d\d):(\d\d\.\d)", seen.rows[0])
    if not clock:
        return ""
    now = 60 * int(clock[0][0]) + float(clock[0][1])
    # Once a mission has ended its time stands still, and its program may go on.
    events = [] if " of " in seen.rows[0] else re.findall(r"^ *(\d\d):(\d\d\.\d)  ", seen.text, re.M)
    if events and 60 * int(events[-1][0]) + float(events[-1][1]) > now + 0.051:
        return f"clock {now}, event {events[-1]}"
    mission = seen.number(r"time +[━╸─]+ (\d+) of \d+ s")
    if mission is not None and abs(mission - now) > 0.56:
        return f"clock {now}, mission {mission}"
    state = re.search(r"state +(standing|moving)", seen.text)
    going = re.search(r" (driving|standing) ", seen.rows[0])
    if state is not None and going is not None and (state[1] == "moving") != (going[1] == "driving"):
        return f"{state[0]} beside {going[1]}"
    return ""


def contacts(seen: Seen) -> str:
    """All counts of contacts against each other."""
    panel, words = r"state.* contacts +(\d+)\b(?!\.)", r" (\d+) contacts?\b(?!:)"
    counts = {*re.findall(panel, seen.text), *re.findall(words, seen.text)}
    return "" if len(counts) <= 1 else f"contacts {sorted(counts)}"


CLAIMS: Mapping[str, Callable[[Seen], str]] = {
    "reply": last_reply, "pose": pose, "belief": belief, "time": moment, "contacts": contacts,
}  # fmt: skip


def wrong_frames(
    size: tuple[int, int], updates: Sequence[Update]
) -> tuple[int, int, Counter[str], list[str]]:
    """Frames, those of them that disagree, how often each kind does, and the first examples."""
    screen = pyte.Screen(*size)
    stream = pyte.ByteStream(screen)
    kinds: Counter[str] = Counter()
    frames, wrong, examples = 0, 0, []
    for update in updates:
        stream.feed(UNKNOWN_TO_PYTE.sub(b"", update.data))
        seen = Seen(screen.display, screen)
        if "pose " not in seen.text or "WAITING" in seen.rows[0]:
            continue
        frames += 1
        texts = {name: text for name, claim in CLAIMS.items() if (text := claim(seen))}
        kinds.update(texts.keys())
        wrong += bool(texts)
        examples += [f"{name}: {text}" for name, text in texts.items()]
    return frames, wrong, kinds, examples


def rates(updates: Sequence[Update]) -> dict[str, float]:
    """KB a second, frames a second, and the 90th percentile of the time between two, milliseconds."""
    begin = next((each.at for each in updates if b" -> " in each.data), math.inf) + SETTLING
    later = [each for each in updates if each.at >= begin]
    if len(later) < 10:
        return {}
    passed = later[-1].at - later[0].at
    drawn = [each.at for each in later if len(each.data) > 200]
    gaps = [b - a for a, b in itertools.pairwise(drawn) if b - a < GAP_ENDS]
    return {
        "kilobytes": sum(len(each.data) for each in later[1:]) / passed / 1000,
        "frames a second": 1.0 / statistics.mean(gaps),
        "p90 ms": 1000 * statistics.quantiles(gaps, n=10)[-1],
    }


def command_of(program: str, pace: str) -> list[str]:
    """Command line of one case."""
    name, options = PROGRAMS[program]
    ports = ("--port", "0", "--reply-port", "0", "--belief-port", "0", "--seed", "5")
    line = f'"{sys.executable}" "{ROOT / "scripts" / name}"'
    return [sys.executable, "-m", "simmer_tui", *ports, *PACES[pace], *options, "--run", line]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="20 frames a case")
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=40.0, help="longest time of a case")
    parser.add_argument("--size", default="120x36")
    cases = [f"{program}-{pace}" for program in PROGRAMS for pace in PACES]
    parser.add_argument("--case", action="append", choices=cases, help="only these")
    parser.add_argument("--examples", type=int, default=3, help="disagreements to print for each case")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    options = parser.parse_args()
    wanted = 20 if options.quick else options.frames
    columns, rows = (int(part) for part in options.size.split("x"))
    figures = {}
    for case in options.case or cases:
        updates = capture((columns, rows), command_of(*case.split("-")), wanted, options.seconds)
        frames, wrong, kinds, examples = wrong_frames((columns, rows), updates)
        figures[case] = {"frames": frames, "wrong": wrong, **rates(updates)}
        shown = ", ".join(f"{kind} {count}" for kind, count in kinds.items()) or "none"
        speed = ", ".join(f"{value:.1f} {name}" for name, value in rates(updates).items())
        print(f"{case} at {options.size}: {wrong} of {frames} frames disagree ({shown}); {speed}", flush=True)
        for example in examples[: options.examples]:
            print(f"    {example}")
    print(f"load average {os.getloadavg()[0]:.1f}")
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
