"""Judge of a team's run by its log, the program's notes, its language and the maze."""

from __future__ import annotations

import ast
import csv
import json
import math
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

Entry = dict[str, Any]
Pose = tuple[float, float, float]
CONTROL_PERIOD = 0.02
"""Seconds between two looks of the robot at what it has been sent."""
Drive = tuple[float, ...]
CM, MM, CELL = 2.54, 25.4, 12.0
SPREADS = 6.0
"""Standard deviations that a reading may be off: six have a probability of 2e-9."""


@dataclass
class Judgement:
    """Counts of what was compared, and each thing that was wrong."""

    counts: dict[str, int] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)

    def expect(self, what: str, right: bool, *details: object) -> None:
        self.counts[what] = self.counts.get(what, 0) + 1
        if not right:
            self.wrong.append(f"{what}: {' | '.join(map(str, details))}")


class Maze:
    """Walls and block, and rays among them."""

    def __init__(self, rows: list[str], block: Pose | None) -> None:
        self.rows = rows
        self.block = block

    def ray(self, x: float, y: float, degrees: float, low: bool = False) -> float:
        """Distance to the nearest wall, or block if low, from cell border to cell border."""
        dx, dy = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        crossings = [0.0]
        for start, step, count in ((x, dx, len(self.rows[0])), (y, dy, len(self.rows))):
            if abs(step) > 1e-12:
                crossings += [(CELL * line - start) / step for line in range(count + 1)]
        crossings = sorted(t for t in crossings if t >= 0)
        distance = crossings[-1]
        for near, far in pairwise(crossings):
            middle = (near + far) / 2
            row = len(self.rows) - 1 - math.floor((y + dy * middle) / CELL)
            column = math.floor((x + dx * middle) / CELL)
            inside = 0 <= row < len(self.rows) and 0 <= column < len(self.rows[0])
            if far > near and (not inside or self.rows[row][column] == "0"):
                distance = near
                break
        if low and self.block:
            near, far = 0.0, distance
            for start, step, centre in ((x, dx, self.block[0]), (y, dy, self.block[1])):
                if abs(step) > 1e-12:
                    ends = sorted((centre + side - start) / step for side in (-1.5, 1.5))
                    near, far = max(near, ends[0]), min(far, ends[1])
                elif abs(start - centre) > 1.5:
                    far = -1.0
            if near < far:  # from inside of a block that is not solid, its far side
                distance = near or far
        return distance


@dataclass
class Run:
    """A team's run: its log, what its program noted (sent, got), its sensors and its maze."""

    entries: list[Entry]
    notes: list[tuple[bytes, bytes]]
    sensors: dict[str, dict[str, str]]
    maze: Maze
    places: list[tuple[float, Pose, tuple[float, float, float, float] | None]] = field(default_factory=list)

    def wires(self, reply: bool) -> list[bytes]:
        return [
            e["data"].encode("latin-1")
            for e in self.entries
            if e["kind"] == "wire" and ("reply" in e) is reply
        ]

    def pose(self, t: float) -> Pose | None:
        """The robot's pose at a time; None while it is in a movement of known length."""
        first, last = 0, len(self.places)
        while last - first > 1:
            middle = (first + last) // 2
            first, last = (middle, last) if self.places[middle][0] <= t else (first, middle)
        began, pose, motion = self.places[first]
        if motion is None:
            return pose if not math.isnan(pose[0]) else None
        return along(pose, motion, t - began)

    def range(self, t: float, bearing: int) -> float | None:
        """Range of a lidar with 360 rays a turn and 5.5 turns a second, in the last whole turn before a
        time: counter-clockwise from the front, each ray at its own moment. None as `pose`."""
        turn = math.floor(t * 5.5) - 1
        pose = self.pose((turn + bearing % 360 / 360) / 5.5)
        return None if pose is None else self.maze.ray(pose[0], pose[1], pose[2] + bearing)


def along(pose: Pose, motion: tuple[float, float, float, float], seconds: float) -> Pose:
    """Pose after so long on an arc: velocity, its turn rate and the additional spin."""
    vx, vy, rate, spin = motion
    w = math.radians(rate)
    half = w * seconds / 2
    chord = seconds * (math.sin(half) / half if abs(half) > 1e-12 else 1.0)
    x = pose[0] + chord * (vx * math.cos(half) - vy * math.sin(half))
    y = pose[1] + chord * (vx * math.sin(half) + vy * math.cos(half))
    return x, y, pose[2] + (rate + spin) * seconds


def load_run(log: Path, notes: Path, folder: Path) -> Run:
    entries = [json.loads(line) for line in log.read_text().splitlines()]
    noted = []
    for line in notes.read_text().splitlines():
        _, sent, got = (ast.literal_eval(word) for word in line.split("\t"))
        noted.append((sent.encode() if isinstance(sent, str) else sent, got))
    rows = [line for line in (folder / "sensors.csv").read_text().splitlines() if not line.startswith("#")]
    sensors = {row["Poll Character"]: row for row in csv.DictReader(rows)}
    maze = [
        line.replace(",", "") for line in (folder / "maze.csv").read_text().splitlines() if line[:1].isdigit()
    ]
    run = Run(entries, noted, sensors, Maze(maze, entries[0]["block"]))
    run.places = places(entries)
    return run


def places(entries: list[Entry]) -> list[tuple[float, Pose, tuple[float, float, float, float] | None]]:
    """Places of the robot with the time from which it was there, by the legs and movements of the log."""
    unknown: Pose = (math.nan, math.nan, math.nan)
    found: list[tuple[float, Pose, tuple[float, float, float, float] | None]] = []
    pose: Pose = tuple(entries[0]["pose"])
    leg: Entry | None = None
    found.append((-1.0, pose, None))

    def stop(t: float) -> None:
        nonlocal pose, leg
        if leg is not None:
            began, start, motion = found[-1]
            assert motion is not None
            over = abs(t - leg.get("end", math.inf)) < 1e-9
            pose = tuple(leg["to"]) if over else along(start, motion, t - began)
            leg = None

    motions = ("leg", "leg_end", "plan", "end", "velocity")
    for entry in sorted((each for each in entries if each["kind"] in motions), key=lambda each: each["t"]):
        t = entry["t"]
        if leg is not None and "end" in leg and t > leg["end"] + 1e-9:
            ended = leg["end"]
            stop(ended)
            found.append((ended, pose, None))
        if entry["kind"] in ("leg_end", "velocity"):
            stop(t)
            found.append((t, pose, None))
        elif entry["kind"] == "leg":
            stop(t)
            leg = entry
            found.append((t, pose, (*entry["velocity"], entry["rate"], entry.get("spin", 0.0))))
        elif entry["kind"] == "plan":
            stop(t)
            found.append((t, unknown, None))
        else:
            pose = tuple(entry["pose"])
            found.append((t, pose, None))
    return found


def judge(name: str, log: Path, notes: Path, folder: Path) -> Judgement:
    """Everything that can be compared in the run of a team."""
    run, judgement = load_run(log, notes, folder), Judgement()
    team = TEAMS[name]()
    sent = [message for note, _ in run.notes for message in team.messages(note)]
    seen = [team.seen(data) for data in run.wires(False)]
    judgement.expect(
        "messages arrived as sent", sent == seen, len(sent), len(seen), first_difference(sent, seen)
    )
    got, gave = b"".join(g for _, g in run.notes), b"".join(run.wires(True))
    unread = len(gave) - len(got)  # an end of line at most
    right = got.startswith(gave) if team.cut else gave.startswith(got) and unread <= 2
    judgement.expect("replies arrived as given", right, len(gave), len(got))
    judge_readings(run, judgement)
    reads: dict[str, float] = {}
    drives: list[Drive] = []
    last_asked = -math.inf
    for entry in run.entries:
        if entry["kind"] == "read" and entry["cmd"] != "sc":
            reads[entry["cmd"]] = float(entry["reply"])
        elif entry["kind"] == "wire" and "reply" in entry:
            team.check(entry["data"].encode("latin-1"), entry["t"], reads, run, judgement)
            reads = {}
        elif entry["kind"] == "wire":
            asked = team.drives(team.seen(entry["data"].encode("latin-1")))
            last_asked = entry["t"] if asked else last_asked
            drives += asked
    done = [
        drive(e["cmd"])
        for e in run.entries
        if e["kind"] == "plan" or ("velocity" in e and e["kind"] == "answer")
    ]
    left = [e["t"] for e in run.entries if e["kind"] == "notice" and e.get("about") == "left"]
    # A velocity begins with the robot's next control period, and ends when its program leaves.
    if left and last_asked > left[-1] - CONTROL_PERIOD and len(drives) == len(done) + 1:
        drives.pop()
    same = len(done) == len(drives) and all(near(a, b) for a, b in zip(done, drives, strict=True))
    judgement.expect("drives as asked", same, len(done), len(drives), first_difference(done, drives))
    judgement.counts["drives"] = len(done)
    team.finish(run, judgement)
    return judgement


def near(one: Drive, other: Drive) -> bool:
    return len(one) == len(other) and all(abs(a - b) < 1e-6 for a, b in zip(one, other, strict=True))


def first_difference(one: list[Any], other: list[Any]) -> object:
    for place, (a, b) in enumerate(zip(one, other, strict=False)):
        if a != b and not (isinstance(a, tuple) and near(a, b)):
            return f"at {place}: {a!r}, {b!r}"
    return f"then {one[len(other) :][:3]}, {other[len(one) :][:3]}"


CODES = {"d1": 0.0, "w1": 90.0, "a1": 180.0, "s1": 270.0, "r1": 1000.0}
"""Numbers for the drives: bearings, and one that is none."""


def drive(command: str) -> Drive:
    code, value = command[:2], command[3:]
    return tuple(map(float, value.split(";"))) if code == "vv" else (CODES[code], float(value))


def judge_readings(run: Run, judgement: Judgement) -> None:
    """Each reading against its true value, and that against rays from the pose of the log."""
    turned = sum(abs(m[2]) * (n[0] - t) for (t, _, m), n in pairwise(run.places) if m)
    for entry in run.entries:
        if entry["kind"] != "read" or entry["cmd"] == "sc":
            continue
        code, reply = entry["cmd"], float(entry["reply"])
        true = float(entry.get("true", reply))
        row = run.sensors[code]
        if row["ID"].startswith(("ultra", "tof")):
            spread = SPREADS * float(row["Percent Error (0-1)"]) * true
            judgement.expect(
                "readings near the truth", math.isinf(reply) or abs(reply - true) <= spread, entry
            )
            pose = run.pose(entry.get("taken", entry["t"]))
            if pose and not math.isinf(true):
                least, most = fan(run.maze, row, pose)
                judgement.expect(
                    "truth by rays", least - 0.05 <= true <= most + 0.05, entry, pose, least, most
                )
        elif row["ID"].startswith("gyro"):
            judgement.expect("readings near the truth", abs(reply - true) <= 0.06 * max(turned, 1), entry)


def fan(maze: Maze, row: dict[str, str], pose: Pose) -> tuple[float, float]:
    """Shortest and longest ray of a range sensor's field of view."""
    heading = math.radians(pose[2])
    x, y = float(row["X Position (in)"]), float(row["Y Position (in)"])
    at = (
        pose[0] + x * math.cos(heading) - y * math.sin(heading),
        pose[1] + x * math.sin(heading) + y * math.cos(heading),
    )
    half = float(row["Field of View (deg)"]) / 2
    centre = pose[2] + float(row["Rotation (deg)"])
    low = float(row["Z Position (in)"]) <= 3
    rays = [maze.ray(*at, centre + half * k / 12, low) for k in range(-12, 13)]
    return min(rays), max(rays)


class Team:
    """A language as the team's table says it, apart from its dialect.toml."""

    cut = False
    """True if the log has only the first replies."""

    def messages(self, sent: bytes) -> list[bytes]:
        return [sent] if sent else []

    def seen(self, data: bytes) -> bytes:
        return data.strip()

    def drives(self, message: bytes) -> list[Drive]:
        return []

    def check(
        self, reply: bytes, t: float, reads: dict[str, float], run: Run, judgement: Judgement
    ) -> None: ...

    def finish(self, run: Run, judgement: Judgement) -> None: ...


class Lines(Team):
    def drives(self, message: bytes) -> list[Drive]:
        verb, _, number = message.decode().partition(" ")
        if verb in "qe" and not number:
            return [(180.0, 2.0), (1000.0, 5.0 if verb == "q" else -5.0), (0.0, 1.9)]
        n = float(number) if verb in ("w", "b", "l", "r") else 0.0
        moves = {"w": (0.0, n * 12 / 13), "b": (180.0, n * 12 / 13), "l": (1000.0, n), "r": (1000.0, -n)}
        return [moves[verb]] if verb in moves else []

    def check(self, reply: bytes, t: float, reads: dict[str, float], run: Run, judgement: Judgement) -> None:
        cm = {code: "-1.00" if math.isinf(value) else f"{value * CM:.2f}" for code, value in reads.items()}
        line = "".join(f"{code}: {cm.get(code)}" for code in ("u1", "u2", "u3", "u4", "u0"))
        right = f"{line}i0: {reads.get('i0', -1):.0f}\r\n".encode()
        judgement.expect("replies by readings", reply == right, reply, right)


class Brackets(Team):
    def __init__(self) -> None:
        self.front = self.held = 0
        self.asked = b""

    def messages(self, sent: bytes) -> list[bytes]:
        return [b"[" + sent + b"]"] if sent else []

    def drives(self, message: bytes) -> list[Drive]:
        verb, rest = chr(message[1]), message[2:-1].decode()
        self.asked = message
        if verb == "r":
            self.front = int(rest)
        elif message.startswith(b"[l1"):
            self.held = int(int(message[3:-1]) > 60)
        seconds = int(rest or 300) / 1000 if verb in "fdsaqeik" else 0.0
        if verb in "fdsa":
            vx, vy = ((6, 0), (0, -6), (-6, 0), (0, 6))[(self.front + "fdsa".index(verb)) % 4]
            return [(vx, vy, 0.0, seconds)]
        others = {
            "q": (0.0, 0.0, 120.0),
            "e": (0.0, 0.0, -120.0),
            "i": (6.0, 0.0, 0.0),
            "k": (-6.0, 0.0, 0.0),
        }
        return [(*others[verb], seconds)] if verb in others else []

    def check(self, reply: bytes, t: float, reads: dict[str, float], run: Run, judgement: Judgement) -> None:
        mm = {code: "8190" if math.isinf(value) else f"{round(value * MM)}" for code, value in reads.items()}
        verb = chr(self.asked[1])
        codes = {"p": ("t0", "t1", "t2", "t3"), "v": ("v0", "v1")}.get(verb, ())
        words = [mm.get(code, "?") for code in codes] + {"p": [str(self.front)], "n": [str(self.held)]}.get(
            verb, []
        )
        right = ",".join(words) if words else "85.00,60.00,75.00,75.00" if verb == "c" else "+"
        judgement.expect("replies by readings", reply == f"[{right}]\r\n".encode(), reply, right)


class Letters(Team):
    TIMES: ClassVar[dict[str, Drive]] = {
        "F": (6, 0, 0, 0.5),
        "f": (6, 0, 0, 0.1),
        "B": (-6, 0, 0, 0.25),
        "b": (-6, 0, 0, 0.1),
    }
    TURNS: ClassVar[dict[str, Drive]] = {
        "R": (0, 0, -120, 0.855),
        "r": (0, 0, -120, 0.1),
        "L": (0, 0, 120, 0.725),
        "l": (0, 0, 120, 0.1),
    }

    def messages(self, sent: bytes) -> list[bytes]:
        return [bytes([letter]) for letter in sent]

    def drives(self, message: bytes) -> list[Drive]:
        both = self.TIMES | self.TURNS
        return [both[message.decode()]] if message.decode() in both else []

    def check(self, reply: bytes, t: float, reads: dict[str, float], run: Run, judgement: Judgement) -> None:
        if "g1" in reads:
            right = f"{-reads['g1'] % 360:.2f},.\r\n"
        else:
            values = [reads.get(code, math.nan) for code in ("u1", "u2", "u3", "u4", "u5")]
            right = "".join("0," if math.isinf(v) else f"{v * CM:.1f}," for v in values) + ".\r\n"
        judgement.expect("replies by readings", reply == right.encode(), reply, right)

    def finish(self, run: Run, judgement: Judgement) -> None:
        """Each drive lasts its fixed time, and the next one waits for it."""
        ends = {
            round(e["t"], 6)
            for e in run.entries
            if e["kind"] == "velocity" and e["reason"] == "its time was over"
        }
        free = 0.0
        for entry in run.entries:
            if entry["kind"] == "answer" and "velocity" in entry:
                over = entry["t"] + drive(entry["cmd"])[3]
                judgement.expect(
                    "drives of fixed time", round(over, 6) in ends and entry["t"] >= free - 1e-9, entry
                )
                free = over


class Stream(Team):
    cut = True
    EVERY = 0.004166666
    WAYS: ClassVar[dict[bytes, Drive]] = {
        b"w": (6, 0, 0),
        b"s": (-6, 0, 0),
        b"a": (0, 6, 0),
        b"d": (0, -6, 0),
        b"q": (0, 0, 120),
        b"e": (0, 0, -120),
    }

    def drives(self, message: bytes) -> list[Drive]:
        return [self.WAYS[message]] if message in self.WAYS else []

    def finish(self, run: Run, judgement: Judgement) -> None:
        """The angles are in order; by the program's clock every line has its time, logged or not.

        On a busy machine the real clock leaves lines out, and the run says so.
        """
        exact = run.entries[0]["settings"]["motion"]["clock"] == "program"
        gaps = not exact and any("are left out" in entry.get("text", "") for entry in run.entries)
        tick = -1
        for line in (got for _, got in run.notes if got):
            tick += 1
            angle, distance = line.strip().split(b",")
            if gaps and int(angle) % 6 == 0:
                tick += (int(angle) // 6 - tick) % 60
            judgement.expect("angles in order", int(angle) == tick * 6 % 360, tick, line)
            if exact and tick % 7 == 0:
                ray = run.range((tick + 1) * self.EVERY, int(angle))
                if ray is not None:
                    right = abs(ray * CM - float(distance)) < 0.08
                    judgement.expect("truth by rays", right, tick, line, ray)


class Frames(Team):
    def __init__(self) -> None:
        self.frames: list[bytes] = []
        self.kind = 0

    def seen(self, data: bytes) -> bytes:
        return data[:1] + data[2:-1]

    def drives(self, message: bytes) -> list[Drive]:
        kind, content = message[0], message[1:]
        self.kind = kind or self.kind
        if kind == 2 and struct.unpack("<hh", content)[1] == 0:
            return [(0.0, struct.unpack("<hh", content)[0] / MM)]
        if kind == 3:
            return [(1000.0, struct.unpack("<h", content)[0] / 10)]
        return [(struct.unpack("<b", content)[0] * 6.0, 0.0, 0.0)] if kind == 4 and content != b"\0" else []

    def check(self, reply: bytes, t: float, reads: dict[str, float], run: Run, judgement: Judgement) -> None:
        content = reply[2:-1]
        if self.kind == 1:
            right = struct.pack("<fff", *(reads.get(code, math.nan) for code in ("u1", "u2", "u4")))
            judgement.expect("replies by readings", content == right, reply, reads)
        elif self.kind == 5:
            bearing, distance = struct.unpack("<hf", content)
            # By the real clock a reply goes out after its reading: the turn before may be the one it is of.
            rays = [run.range(each, bearing) for each in (t, t - 1 / 5.5)]
            if None not in rays:
                right = any(abs(ray - distance) < 0.02 for ray in rays if ray is not None)
                judgement.expect("truth by rays", right, t, bearing, distance, rays)
        elif self.kind == 6:
            judgement.expect(
                "replies by readings", content == f"u3: {reads.get('u3', -1):.2f} in".encode(), reply, reads
            )


TEAMS: dict[str, Callable[[], Team]] = {
    "lines": Lines,
    "brackets": Brackets,
    "letters": Letters,
    "stream": Stream,
    "frames": Frames,
}


def same_but_for_real_time(one: Path, other: Path) -> Iterator[tuple[int, Entry, Entry]]:
    """Lines of two logs that differ, but for the real time, the computer's ports and the command line."""
    lines, others = one.read_text().splitlines(), other.read_text().splitlines()
    for number, (a, b) in enumerate(zip(lines, others, strict=True), 1):
        if (first := without_real_time(a)) != (second := without_real_time(b)):
            yield number, first, second


def without_real_time(line: str) -> Entry:
    entry: Entry = json.loads(line)
    for key in ("real", "start", "subject", "client", "run"):
        entry.pop(key, None)
    return entry
