"""A fifth table of faults: runs that fail in known ways, with the answers written before the first run.

    python benchmarks/fault_fifth.py --seeds 1 --first-seed 3301 --out FOLDER [--only KIND]

The programs are those of a team that fetches the block by a plan. They speak to the robot by a socket of
their own. A kind changes the program's text, the robot's set, or the link, which is a TCP proxy. Each run's
log is FOLDER/KIND-SEED.jsonl, and FOLDER/answers.json has the answers of the runs that failed.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import json
import os
import shlex
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
REAL_LIMIT = 60.0  # s, of a run; a quick one takes 3 s, and a busy machine is five times slower
JOBS = 2  # runs at a time: more would disturb others on a shared machine

# The team's program. At heading 180, d1 leads to -X, a1 to +X, w1 to -Y and s1 to +Y.
TEAM = """
import json, math, os, socket, struct, sys, time

MAZE = ["33110202", "33011111", "10200101", "11111102"]  # top row first
STARTS = [(5, 3), (7, 3), (2, 1), (7, 0)]  # column, row from the bottom
KNOWN = True
TOLERANCE = 2.5
LEADS = {"d1": (-1, 0), "a1": (1, 0), "w1": (0, -1), "s1": (0, 1)}

class Link:
    def __init__(self):
        port = int(os.environ["SIMMER_PORT"])
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=6)
        self.belief = None
        try:
            self.belief = socket.create_connection(("127.0.0.1", int(os.environ["SIMMER_BELIEF_PORT"])))
        except (OSError, KeyError):
            pass

    def ask(self, *commands):
        self.socket.sendall("".join(c + "\\n" for c in commands).encode())
        want, data = 8 * len(commands), b""
        while len(data) < want:
            more = self.socket.recv(want - len(data))
            if not more:
                raise ConnectionError("robot is gone")
            data += more
        return struct.unpack(">%dd" % len(commands), data)

    def believe(self, x, y, heading):
        if self.belief is not None:
            self.belief.sendall(json.dumps({"x": x, "y": y, "heading": heading}).encode() + b"\\n")

def say(*words):
    print("team:", *words, flush=True)

def is_open(column, row):
    return 0 <= column < 8 and 0 <= row < 4 and MAZE[3 - row][column] != "0"

def room(cell, dx, dy):
    count = 0
    column, row = cell
    while is_open(column + dx * (count + 1), row + dy * (count + 1)):
        count += 1
    return 12.0 * count + 3.0  # from a sensor on the rim of a robot in the middle

def route(start, goal):
    ways, waiting = {start: [start]}, [start]
    while waiting:
        cell = waiting.pop(0)
        if cell == goal:
            return ways[cell]
        for dx, dy in LEADS.values():
            near = (cell[0] + dx, cell[1] + dy)
            if is_open(*near) and near not in ways:
                ways[near] = ways[cell] + [near]
                waiting.append(near)
    return []

class Team:
    def __init__(self, link):
        self.link = link
        self.x, self.y = 66.0, 42.0
        self.zero = self.read("g1")

    def read(self, code):
        return self.link.ask(code)[0]

    def move(self, code, amount):
        if abs(amount) < 0.05:
            return
        reply = self.link.ask("%s-%.2f" % (code, amount))[0]
        dx, dy = LEADS[code]
        self.x += dx * amount
        self.y += dy * amount
        self.link.believe(self.x, self.y, 180.0)
        self.square()

    def turn(self, angle):
        if angle:
            self.link.ask("r1-%.3f" % angle)
            self.zero += angle

    def square(self):
        for _ in range(3):
            off = self.read("g1") - self.zero
            if abs(off) < 1.0:
                return
            self.link.ask("r1-%.2f" % -off)

    def ahead(self, sensor, wanted, x):
        for _ in range(9):
            off = self.read(sensor) - wanted
            if abs(off) < 0.4:
                return
            self.move("d1", max(-12.0, min(12.0, off)))

    def back(self, wanted, x):
        for _ in range(9):
            off = self.read("u3") - wanted
            if abs(off) < 0.4:
                return
            self.move("a1", max(-12.0, min(12.0, off)))

    def localize(self):
        seen = sum(self.read("c1") for _ in range(9)) / 9
        heading = 90 * round(seen / 90) % 360
        say("compass", round(seen), "so heading", heading)
        self.turn(math.remainder(180 - heading, 360))
        cells = list(STARTS)
        for _ in range(3):
            west, east = self.link.ask("u1", "u3")
            self.turn(90)
            south, north = self.link.ask("u1", "u3")
            self.turn(-90)
            found = {"d1": west, "a1": east, "w1": south, "s1": north}
            say("ranges", found)
            cells = [c for c in cells if all(
                abs(room(c, *LEADS[k]) - r) < TOLERANCE + 0.05 * r for k, r in found.items())]
            say("possible", cells)
            if len(cells) == 1:
                self.x, self.y = 12.0 * cells[0][0] + 6, 12.0 * cells[0][1] + 6
                self.link.believe(self.x, self.y, 180.0)
                return cells[0]
            if not cells:
                break
            code = max(found, key=found.get)
            self.move(code, 12.0)
            cells = [(c + LEADS[code][0], r + LEADS[code][1]) for c, r in cells]
        say("cannot localize")
        sys.exit(3)

    def travel(self, start, goal):
        way = route(start, goal)
        say("route", way)
        for here, there in zip(way, way[1:]):
            step = (there[0] - here[0], there[1] - here[1])
            code = [k for k in LEADS if LEADS[k] == step][0]
            self.move(code, 12.0)

    def loaded(self):
        return sum(self.read("l1") for _ in range(5)) >= 3

    def run(self):
        if KNOWN:
            self.move("w1", 12.0)
        else:
            self.travel(self.localize(), (5, 2))
        say("in the corridor")
        self.ahead("u1", 3.0, 42.0)
        self.move("s1", 12.0)
        say("at the loading zone")
        self.ahead("u5", 0.6, 17.1)
        self.link.ask("p1-1")
        if not self.loaded():
            say("no block")
            sys.exit(4)
        say("have the block")
        self.back(1.3, 43.7)
        self.move("w1", 12.0)
        self.back(1.4, 91.6)
        self.move("s1", 12.0)
        self.link.ask("p1-0")
        say("delivered")

Team(Link()).run()
"""

# The proxy between a program and the simulator: wire.py FAULT N PROGRAM. Its Nth exchange meets the fault.
WIRE = """
import os, socket, subprocess, sys, threading, time

fault, nth, program = sys.argv[1], int(sys.argv[2]), sys.argv[3]
server = socket.create_server(("127.0.0.1", 0))
there = ("127.0.0.1", int(os.environ["SIMMER_PORT"]))
counts = {"commands": 0, "faults": 0}

def serve():
    near, _ = server.accept()
    far = socket.create_connection(there)
    pending = b""

    def fetch(count):
        data = b""
        while len(data) < 8 * count:
            more = far.recv(8 * count - len(data))
            if not more:
                raise ConnectionError
            data += more
        return data

    try:
        while True:
            more = near.recv(4096)
            if not more:
                break
            lines = more.split(b"\\n")[:-1]
            counts["commands"] += len(lines)
            is_drive = lines[0][:2] in (b"d1", b"a1", b"w1", b"s1")
            if is_drive:
                counts["drives"] = counts.get("drives", 0) + 1
            of_drives = fault in ("lost-reply", "doubled", "garbled", "lost-command", "echo")
            due = counts.get("drives", 0) == nth and is_drive if of_drives else counts["commands"] >= nth
            once = due and not counts["faults"]
            if fault == "lost-reply" and once:
                counts["faults"] += 1
                far.sendall(more)
                fetch(len(lines))
            elif fault == "lost-command" and once:
                counts["faults"] += 1
                near.sendall(b"\\x7f\\xf0" + bytes(6))  # the radio acknowledges what the robot never got
            elif fault == "doubled" and once:
                counts["faults"] += 1
                far.sendall(more + more)
                near.sendall(fetch(2 * len(lines))[:8 * len(lines)])
            elif fault == "echo" and once:
                counts["faults"] += 1
                far.sendall(more)
                data = fetch(len(lines))
                near.sendall(data + data)  # one reply more than there were commands
            elif fault == "garbled" and once:
                counts["faults"] += 1
                far.sendall(more.replace(b"-12", b"-32").replace(b"-9", b"-29"))
                near.sendall(fetch(len(lines)))
            elif fault == "swapped" and len(lines) == 2 and due:
                counts["faults"] += 1
                far.sendall(more)
                data = fetch(2)
                near.sendall(data[8:] + data[:8])
            elif fault == "merged" and len(lines) == 2:
                counts["faults"] += 1
                far.sendall(b"".join(lines) + b"\\n")
                near.sendall(fetch(1))
            elif fault == "cut" and once:
                counts["faults"] += 1
                break
            elif fault == "cut-reply" and once:
                counts["faults"] += 1
                far.sendall(more)
                near.sendall(fetch(len(lines))[:-1])  # a byte is lost, so all later ones are shifted
            else:
                far.sendall(more)
                near.sendall(fetch(len(lines)))
    except OSError:
        pass
    near.close()
    far.close()

threading.Thread(target=serve, daemon=True).start()
extra = {"SIMMER_PORT": str(server.getsockname()[1])}
child = subprocess.Popen([sys.executable, program], env={**os.environ, **extra})
code = child.wait()
print("team: proxy", counts, flush=True)
sys.exit(code)
"""

# A person beside the program: person.py DEED SECONDS PROGRAM.
PERSON = """
import os, signal, socket, subprocess, sys, time

deed, program = sys.argv[1], sys.argv[2]
if deed == "occupy":
    old = socket.create_connection(("127.0.0.1", int(os.environ["SIMMER_PORT"])))
    old.sendall(b"u1\\n")
    old.recv(8)
child = subprocess.Popen([sys.executable, "-u", program], stdout=subprocess.PIPE, text=True)
for line in child.stdout:
    print(line, end="", flush=True)
    if "at the loading zone" in line:
        if deed == "kill":
            child.send_signal(signal.SIGTERM)
            print("team: killed by a person", flush=True)
code = child.wait()
sys.exit(code if code >= 0 else 128 - code)
"""

SENSORS = {  # type and number, x, y, z, rotation, percent error, field of view, threshold, read time
    "u1": ("ultra1", 3, 0, 6, 0, 0.01, 5, "", 0.06),
    "u2": ("ultra2", 2.12, 2.12, 6, 45, 0.01, 5, "", 0.06),
    "u3": ("ultra3", -3, 0, 6, 180, 0.01, 5, "", 0.06),
    "u4": ("ultra4", 2.12, -2.12, 6, 315, 0.01, 5, "", 0.06),
    "u5": ("ultra5", 3, 0, 2, 0, 0.01, 5, "", 0.06),
    "c1": ("comp1", 0, 0, 6, 0, 0.01, "", "", 0.002),
    "g1": ("gyro1", 0, 0, 4, 0, 0.001, "", "", 0.002),
    "l1": ("load1", "", "", "", "", 0.01, "", "", 0.002),
}
SENSOR_COLUMNS = (
    "ID", "Poll Character", "Enabled", "X Position (in)", "Y Position (in)", "Z Position (in)",
    "Rotation (deg)", "Percent Error (0-1)", "Field of View (deg)", "Threshold", "Read Time (s)",
)  # fmt: skip
SENSOR_EXTRAS = (
    "Gain", "Bias", "Drift (per s)", "Min Range (in)", "Max Range (in)", "Dropout", "Outlier",
    "Hard Iron (deg)",
)  # fmt: skip
DRIVES = {"w1": "up", "s1": "down", "a1": "left", "d1": "right", "r1": "rot", "p1": "grip"}
DRIVE_COLUMNS = (
    "ID", "Poll Character", "Enabled", "Y-Axis Error", "X-Axis Error", "Rotation Error", "Y-Axis Bias",
    "X-Axis Bias", "Rotation Bias", "Gain", "Speed", "Reach", "Width",
)  # fmt: skip


@dataclass(frozen=True)
class Kind:
    """A kind of failure, with its answer.

    `edits` are replacements in the program's text, each of which must occur. `sensors` and `drives` are
    columns to change, by code. `mission` replaces values of mission.toml.
    """

    answer: str
    right: tuple[str, ...]
    partly: tuple[str, ...]
    device: str | None = None
    edits: tuple[tuple[str, str], ...] = ()
    sensors: dict[str, dict[str, float]] = field(default_factory=dict)
    drives: dict[str, dict[str, float]] = field(default_factory=dict)
    mission: dict[str, str] = field(default_factory=dict)
    options: tuple[str, ...] = ()
    wire: tuple[str, int] | None = None
    person: str = ""
    program: str = TEAM
    wrong: tuple[str, ...] = ()


UNKNOWN = (("KNOWN = True", "KNOWN = False"),)
AHEAD = "off = self.read(sensor) - wanted"
BACK = 'off = self.read("u3") - wanted'
RECKONED = ((AHEAD, "off = self.x - x"), (BACK, "off = x - self.x"))  # by belief alone
UNSQUARED = (("        self.square()\n\n    def turn", "\n    def turn"),)
PAIR = (  # reads both sensors in one exchange
    (AHEAD, 'off = self.link.ask(sensor, "u3")[0] - wanted'),
    (BACK, 'off = self.link.ask("u3", "u1")[0] - wanted'),
)
BLIND = "the drive into the wall is named, without its reason"
WRONG = (
    "a cause in another part: the robot for a program's mistake, the program for a link's fault",
    "a sensor, drive or wall that played no part",
    "a moment at which all was still well, given as the deciding one",
)
SOLVE = (ROOT / "scripts" / "solve.py").read_text(encoding="utf-8")
PACKETS = '''
import os, socket, sys, time

def say(*words):
    print("team:", *words, flush=True)

def tell(message):
    with socket.create_connection(("127.0.0.1", int(os.environ["SIMMER_PACKET_PORT"])), timeout=3) as line:
        line.sendall(message.encode())
    time.sleep(0.1)
    port = int(os.environ["SIMMER_PACKET_REPLY_PORT"])
    with socket.create_connection(("127.0.0.1", port), timeout=3) as line:
        line.settimeout(0.5)
        try:
            return line.recv(4096).decode()
        except OSError:
            return ""

for message in ("[u1", "[w1-12", "[u1", "[d1-12", "[u1"):
    say(message, "->", repr(tell(message)))
say("the robot does not answer")
sys.exit(5)
'''  # fmt: skip
LOAD_CHECK = '        if not self.loaded():\n            say("no block")\n            sys.exit(4)\n'
CORNER = {"start": "[90.0, 6.0]", "heading": "90.0"}

KINDS: dict[str, Kind] = {
    # -- programs ----------------------------------------------------------------------------------
    "centimetres": Kind(
        "The program sends distances in centimetres to a robot that takes inches: its first move was to be"
        " 12 in and was 30.48. So it left the corridor that it believed to be in, and hit a wall.",
        (
            "distances of commands are 2.54 times too long, or a unit of cm is named",
            "the first move of 30.48 in took it a cell and a half beyond the place that it believed",
        ),
        (BLIND, "belief and truth differ after the first move"),
        edits=(('"%s-%.2f" % (code, amount)', '"%s-%.2f" % (code, 2.54 * amount)'),),
    ),
    "sides-swapped": Kind(
        "The program mixes up left and right. Its first command was s1-12, to the robot's right, where a"
        " wall is 3 in away. It believed to go to its left, where the way is free.",
        (
            "the first move went to the wrong side: s1 in place of w1",
            "it drove 12 in toward a wall 3 in away; its belief went the opposite way",
        ),
        (BLIND,),
        edits=(
            (
                'LEADS = {"d1": (-1, 0), "a1": (1, 0), "w1": (0, -1), "s1": (0, 1)}',
                'LEADS = {"d1": (-1, 0), "a1": (1, 0), "s1": (0, -1), "w1": (0, 1)}',
            ),
            ('self.move("w1", 12.0)', 'self.move("X", 12.0)'),
            ('self.move("s1", 12.0)', 'self.move("w1", 12.0)'),
            ('self.move("X", 12.0)', 'self.move("s1", 12.0)'),
        ),
    ),
    "correction-sign": Kind(
        "The correction of the heading has the wrong sign. Each r1 after a move turns the robot further off,"
        " doubling the error, until it drives askew into a wall.",
        (
            "the turns r1 after moves enlarge the error of the heading; the sign is wrong",
            "the program believes 180 degrees while its own turns took the robot away from that",
        ),
        (BLIND, "the heading was wrong when it hit the wall", "the drives turn the robot a little"),
        edits=(("% -off)", "% off)"),),
        drives={code: {"Rotation Bias": 0.12} for code in ("d1", "a1", "w1", "s1")},
    ),
    "radians": Kind(
        "The program sends angles in radians: it asked for 1.571 degrees where it meant a turn by 90. So its"
        " readings fit no start, and it gave up without localizing.",
        (
            "turns are in radians, or far too small: 1.571 in place of 90",
            "it never localized, since it had hardly turned when it read",
        ),
        ("it never localized", "it gave up by itself, with exit code 3"),
        edits=(*UNKNOWN, ('"r1-%.3f" % angle', '"r1-%.3f" % math.radians(angle)')),
        mission={"start": "[30.0, 18.0]", "heading": "90.0"},
    ),
    "map-upside-down": Kind(
        "The program reads its map upside down: its rows count from the wrong side. Its start (90, 6) fitted"
        " the readings, but its route leads through a wall here, near (78, 18), and it drove into that.",
        (
            "it knew where it was, and its route led straight into a wall: its map is not this maze",
            "belief right until the contact, the command leads 12 in into the wall cell around (78, 18)",
        ),
        (BLIND, "it did not read a sensor before that drive"),
        edits=(*UNKNOWN, ("MAZE[3 - row]", "MAZE[row]")),
        mission=CORNER,
    ),
    "old-map": Kind(
        "The program's map has an opening that this maze has not: the cell in column 5, second row from the"
        " bottom. It had localized well. Its route led through that wall, and it drove into it without"
        " a look.",
        (
            "it knew where it was, and drove 12 in into a wall cell that its map has as free",
            "belief right until the contact, the command leads straight into the wall cell around (54, 18)",
        ),
        (BLIND, "it did not read a sensor before that drive"),
        edits=(*UNKNOWN, ('"10200101"', '"10201101"'), ("(5, 2))", "(4, 2))")),
        mission={"start": "[30.0, 18.0]", "heading": "90.0"},
    ),
    "first-of-two": Kind(
        "Two starts look the same, (66, 42) and (90, 42). The program took the first although it was at the"
        " other. It then drove by its belief alone, 24 in off, into a wall.",
        (
            "it localized wrongly: it believed to be 24 in from where it was, in a place that looks the same",
            "the start is ambiguous, and it chose without another look",
        ),
        (BLIND, "belief and truth were 24 in apart"),
        edits=(*UNKNOWN, *RECKONED, ("if len(cells) == 1:", "if cells:")),
        mission={"start": "[90.0, 42.0]", "heading": "270.0"},
    ),
    "high-sensor": Kind(
        "The program approaches the block by u1, which looks over it, in place of u5. It drove over the block"
        " up to the wall and closed the gripper where no block was.",
        (
            "it used u1, which sees over the block, for the approach",
            "it drove past the block; when the jaws closed the block was behind the window",
        ),
        ("the gripper closed on nothing", "it gave up by itself without a block"),
        edits=(('self.ahead("u5", 0.6, 17.1)', 'self.ahead("u1", 0.6, 17.1)'),),
    ),
    "hard-coded-start": Kind(
        "The program never localizes: its plan is for the start (66, 42), and this run began at (30, 18). All"
        " its beliefs were wrong from the first. It closed the gripper far from the block.",
        (
            "it assumed a start, (66, 42), that was not the run's: belief wrong from the first",
            "it never localized, and drove a fixed plan",
        ),
        ("the gripper closed far from the block", "it gave up by itself without a block"),
        mission={"start": "[30.0, 18.0]"},
    ),
    "never-opens": Kind(
        "The robot carried the block into the drop zone, and the program ended without opening the gripper.",
        ("the block was in the drop zone, still held: p1-0 was never sent",),
        ("the program ended before the block was delivered",),
        edits=(('        self.link.ask("p1-0")\n', ""),),
    ),
    "jaws-closed-before": Kind(
        "The program closed the gripper at the beginning and never opened it. So when it closed it again at"
        " the block, within the window, nothing happened: closed jaws take nothing.",
        ("the jaws were closed already when it reached the block; they were never opened",),
        ("it did not get the block although that lay in the window", "it gave up without a block"),
        edits=(('say("in the corridor")', 'self.link.ask("p1-1")'),),
    ),
    "zone-upside-down": Kind(
        "The program counts the drop zone's y from the top: it set the block down in the cell of (90, 6)."
        " The drop zone was that of (90, 42).",
        (
            "the block was released in a wrong cell, (90, 6) in place of (90, 42)",
            "the drop zone's y is mirrored",
        ),
        ("the block was released outside the drop zone",),
        edits=(
            (
                'self.move("s1", 12.0)\n        self.link.ask("p1-0")',
                'self.move("w1", 24.0)\n        self.link.ask("p1-0")',
            ),
        ),
    ),
    "turns-for-ever": Kind(
        "The heading's correction is twice the error: the robot turns to and fro, as far to the other side"
        " each time, until the time limit. It never got beyond its first move.",
        (
            "it turned to and fro by r1 for ever: each turn overshoots, twice what is needed",
            "the time limit passed in a loop of g1 and r1 after the first move",
        ),
        ("the time limit passed", "it was in a loop"),
        edits=(
            (
                'for _ in range(3):\n            off = self.read("g1")',
                'while True:\n            off = self.read("g1")',
            ),
            ("if abs(off) < 1.0:", "if abs(off) < 0.01:"),
            ("% -off)", "% (-2 * off))"),
        ),
        drives={"w1": {"Rotation Bias": 0.2}},
        mission={"time_limit": "30.0"},
    ),
    "means-of-sixty": Kind(
        "The program takes the mean of sixty readings each time, so that a range costs 4.4 s. It did all"
        " things right, but the time limit passed with readings.",
        ("most of the time went into readings: sixty of each", "too slow: it read far more than it drove"),
        ("the time limit passed before the delivery",),
        edits=(
            ("return self.link.ask(code)[0]", "return sum(self.link.ask(code)[0] for _ in range(60)) / 60"),
        ),
        mission={"time_limit": "80.0"},
    ),
    "empty-mean": Kind(
        "The program crashed with the block in its gripper: it drops ranges over 35 in as outliers. On the"
        " way to the drop zone u3 rightly read 49 in, none was left, and it divided by zero.",
        ("the program crashed: ZeroDivisionError, after u3 read about 49 in, with the block held",),
        ("the program crashed", "the program ended with exit code 1 before the delivery"),
        edits=(
            (
                "return self.link.ask(code)[0]",
                "near = [r for r in self.link.ask(code, code) if r < 35]\n"
                "        return sum(near) / len(near)",
            ),
        ),
    ),
    "waits-for-load": Kind(
        "At the block, which lay in the window, the program waits until the load sensor says 1 before it"
        " closes the gripper. But only closed jaws hold something, so it read l1 until the time limit.",
        (
            "it read l1 for ever and never closed the gripper, with the block in the window",
            "it waited for l1 to be 1, which it cannot be before p1-1",
        ),
        ("the time limit passed in a loop of readings", "it never closed the gripper"),
        edits=(
            (
                '        self.link.ask("p1-1")\n',
                '        while not self.loaded():\n            pass\n        self.link.ask("p1-1")\n',
            ),
        ),
        sensors={"l1": {"Percent Error (0-1)": 0}},
        mission={"time_limit": "40.0"},
    ),
    "narrow-tolerance": Kind(
        "The program wants ranges to be right to 0.01 in, which no sonar is. No start was close enough to"
        " readings that were good, so it gave up without localizing.",
        ("it never localized and gave up, although its readings were as good as these sensors are",),
        ("it never localized", "it gave up by itself, with exit code 3"),
        edits=(*UNKNOWN, ("TOLERANCE + 0.05 * r", "0.01")),
        mission=CORNER,
    ),
    "ends-after-fetch": Kind(
        "The program ended by itself, with exit code 0, right after it took the block. It never drove to the"
        " drop zone: the last part is missing.",
        ("it took the block and then ended, without an attempt to deliver it",),
        ("the program ended before the delivery",),
        edits=(('say("have the block")', "return"),),
    ),
    "decimal-comma": Kind(
        "The program writes numbers with a decimal comma: w1-12,00 was refused, and so was every other move."
        " The program took no notice of that, stood at its start and closed the gripper there.",
        (
            "every drive was refused for its form, w1-12,00: a comma in place of a point",
            "the first command was refused, the program ignored it; the robot never moved",
        ),
        ("the robot never moved", "the gripper closed far from the block"),
        edits=(('"%s-%.2f" % (code, amount)', '("%s-%.2f" % (code, amount)).replace(".", ",")'),),
    ),
    "no-wait": Kind(
        "The robot accepts a drive at once and is busy until its end. The program does not wait: it reads and"
        " drives meanwhile. Its next drives were refused, and it counted them as done.",
        (
            "drives were refused since the robot still moved, and the program did not notice",
            "it did not wait for the end of a movement",
        ),
        (BLIND, "belief and truth are apart", "readings were made during a movement"),
        options=("--motion", "timed", "--reply", "accepted", "--clock", "program"),
    ),
    "codes-from-zero": Kind(
        "The program asks for u0, which this robot does not have: its codes begin at 1. The answer is NaN,"
        " and with that it drove on and on, 12 in at a time, into the wall.",
        ("u0 does not exist: the reading was refused, NaN, and the program drove on it",),
        (BLIND, "a command was refused", "it did not see the wall ahead"),
        edits=(('self.ahead("u1", 3.0, 42.0)', 'self.ahead("u0", 3.0, 42.0)'),),
    ),
    "little-endian": Kind(
        "The program reads the replies' bytes in the wrong order, little-endian. All its readings were"
        " nonsense, and its drives came from them.",
        (
            "replies are read with the wrong byte order",
            "what it did has nothing to do with the readings sent",
        ),
        (BLIND, "the program gave up without a block", "drives that no reading explains"),
        edits=(('">%dd"', '"<%dd"'),),
    ),
    "no-line-ends": Kind(
        "The program sends no line ends. Two commands at once, u1 and u3, came as one unknown command, u1u3,"
        " with one answer. The program waited for a second one and crashed by its timeout.",
        (
            "u1u3 came as one command: no line end between the two",
            "it waited for two replies and there was one",
        ),
        ("the program crashed with TimeoutError", "an unknown command was refused"),
        edits=(*PAIR, ('c + "\\n" for c', "c for c")),
    ),
    "block-length": Kind(
        "The program forgot the length of the block in its gripper. It went sideways too early, so that the"
        " held block, not the robot, hit the wall.",
        ("the held block hit the wall: it was not far enough back before it went sideways",),
        ("a wall was hit while it carried the block", BLIND),
        edits=(("self.back(1.3, 43.7)", "self.back(6.0, 39.0)"),),
    ),
    "settles-too-early": Kind(
        "The program takes its particles for settled while they are spread over much of the maze. Their mean,"
        " between several possible places, is where the robot is not, and all that followed went wrong.",
        (
            "it localized wrongly: it took its belief for sure with a spread of many inches",
            "the mean of particles in several places was taken for the pose",
        ),
        (BLIND, "belief and truth were far apart", "it never localized"),
        edits=(
            (
                "return self.spread < 0.7 and float(self._weights @ off**2) < 4.0**2 and self.fit > DOUBTFUL",
                "return self.spread < 25.0 and len(off) > 0",
            ),
        ),
        program=SOLVE,
    ),
    # -- robots ------------------------------------------------------------------------------------
    "back-reads-long": Kind(
        "The sonar at the back, u3, reads 2.5 in too long. The program backs until it reads 1.3 in, so it"
        " backed into the wall.",
        ("u3 reads about 2.5 in more than the true range, and the program backed by it into the wall",),
        (BLIND,),
        "u3",
        sensors={"u3": {"Bias": 2.5}},
    ),
    "low-reads-short": Kind(
        "The low sonar, u5, reads 2.5 in too short. The program believed the block to be close enough, and"
        " the jaws closed 1.6 in before it.",
        ("u5 reads about 2.5 in too short, so the robot stopped too far from the block",),
        ("the jaws closed short of the block", "it gave up without a block"),
        "u5",
        sensors={"u5": {"Bias": -2.5}},
    ),
    "front-dead": Kind(
        "The front sonar, u1, is dead: it never has an echo, and reads Infinity. The program took that for"
        " free way, and drove into the wall.",
        ("u1 always read Infinity with a wall ahead: dead", "it drove on readings of Infinity"),
        (BLIND,),
        "u1",
        sensors={"u1": {"Dropout": 1}},
    ),
    "back-outliers": Kind(
        "The sonar at the back, u3, often reads anything at all. The program trusts single readings, and one"
        " of them was far too long, so it backed into the wall.",
        ("a reading of u3 was an outlier, far too long, and the program backed on it",),
        (BLIND, "u3 is very noisy"),
        "u3",
        sensors={"u3": {"Outlier": 0.7}},
    ),
    "compass-iron": Kind(
        "The compass is off by 60 degrees, by iron on the robot. The program took 150 for 180 degrees,"
        " so that its readings belonged to other directions.",
        ("c1 read 60 degrees too much", "it began with a heading wrong by 90 degrees, from c1"),
        ("it never localized", "it localized wrongly", BLIND),
        "c1",
        edits=UNKNOWN,
        sensors={"c1": {"Hard Iron (deg)": 60}},
        mission=CORNER,
    ),
    "front-knocked": Kind(
        "The front sonar, u1, does not look ahead: it is turned by 70 degrees. It measured the corridor's"
        " side and never saw the wall that the robot drove into.",
        (
            "u1 does not fit its mounting: turned by about 70 degrees",
            "u1 did not see the wall ahead while the robot drove into it",
        ),
        (BLIND,),
        "u1",
        sensors={"u1": {"Rotation (deg)": 70}},
    ),
    "left-too-short": Kind(
        "The drive to the left, w1, goes 60 % of what it is asked: 7.2 in for 12. The robot did not reach"
        " the corridor, and hit its corner on the way ahead.",
        ("w1 went 7.2 in where 12 were asked", "w1 drives too little"),
        (BLIND, "belief and truth differ after the first move"),
        "w1",
        drives={"w1": {"Gain": 0.6}},
    ),
    "gyro-drift": Kind(
        "The gyro, g1, drifts by 3 degrees a second. The program corrects turns that never were, so it turned"
        " the robot away from its heading until that hit a wall.",
        ("g1 drifts, and the program turned the robot by it", "its corrections r1 follow a wrong gyro"),
        (BLIND, "the heading was wrong when it hit the wall"),
        "g1",
        sensors={"g1": {"Drift (per s)": 3}},
    ),
    "short-jaws": Kind(
        "The gripper reaches only half an inch beyond the robot. The program stopped 5.1 in from the block's"
        " centre, as planned; the jaws closed on nothing.",
        ("the block's centre was beyond the gripper's reach of 0.5 in when it closed",),
        ("the gripper closed on nothing", "it gave up without a block"),
        "p1",
        drives={"p1": {"Reach": 0.5}},
    ),
    "load-inverted": Kind(
        "The gripper had the block. The load sensor, l1, said 0 all the time, so the program believed to have"
        " missed it, and gave up.",
        ("l1 read 0 while the block was held, and the program gave up on that",),
        ("the program gave up with the block in its gripper",),
        "l1",
        sensors={"l1": {"Percent Error (0-1)": 1}},
    ),
    "slow-sensor": Kind(
        "The low sonar, u5, takes 25 s for a reading. The time limit passed while it read; all moves had"
        " been right.",
        ("each reading of u5 takes 25 s, and this used up the time",),
        ("the time limit passed", "most time went into readings"),
        "u5",
        sensors={"u5": {"Read Time (s)": 25}},
        mission={"time_limit": "80.0"},
    ),
    "forward-veers": Kind(
        "The drive d1 turns the robot by half a degree an inch. The program never reads the gyro and believes"
        " to keep its heading, so it went askew into a wall.",
        (
            "d1 turns the robot while it drives, and the program never corrected the heading",
            "the heading drifted by d1 since the first drive ahead, with no look at it",
        ),
        (BLIND, "the heading was wrong when it hit the wall"),
        "d1",
        edits=UNSQUARED,
        drives={"d1": {"Rotation Bias": 0.5}},
    ),
    # -- links -------------------------------------------------------------------------------------
    "retry-moves-twice": Kind(
        "The reply to the first drive was lost on the link. After 1.5 s the program sent w1-12 again, and the"
        " robot, which had moved, moved twice: 12 in too far.",
        (
            "w1-12 came twice, about 1.5 s apart, and was done twice; the program meant it once",
            "after a lost reply it repeated a drive that had been done",
        ),
        ("belief and truth are 12 in apart since the second w1", "the gripper closed far from the block"),
        edits=(
            ("timeout=6", "timeout=1.5"),
            (
                'reply = self.link.ask("%s-%.2f" % (code, amount))[0]',
                "for _ in range(3):\n            try:\n"
                '                self.link.ask("%s-%.2f" % (code, amount))\n'
                "                break\n            except TimeoutError:\n"
                '                say("again", code)',
            ),
        ),
        wire=("lost-reply", 1),
    ),
    "lost-but-confirmed": Kind(
        "The first drive, w1-12, was lost on the link, which confirmed it all the same. The program believed"
        " to be 12 in further, read a wall, and went the other way into one.",
        (
            "the move by 12 in to (66, 30) never reached the robot, though the program counted it",
            "belief 12 in from the truth at once, with no command to the robot for that",
        ),
        (BLIND, "belief and truth are 12 in apart from the start"),
        wire=("lost-command", 1),
    ),
    "sent-twice": Kind(
        "The link delivered the first drive, w1-12, twice. The robot moved 24 in in place of 12, and all"
        " later places were 12 in off.",
        ("w1-12 came twice at once, and was done twice", "a drive was doubled on the link"),
        ("belief and truth are 12 in apart since the second w1", "the gripper closed far from the block"),
        wire=("doubled", 1),
    ),
    "digit-garbled": Kind(
        "The link garbled a digit of the first drive: w1-12.00 arrived as w1-32.00. The robot went 20 in too"
        " far, and hit a wall on the way ahead.",
        (
            "the robot got w1-32 while the program's belief moved by 12: command and belief do not agree",
            "a garbled command on the link",
        ),
        (BLIND, "the first move took it 20 in beyond the place that it believed"),
        wire=("garbled", 1),
    ),
    "replies-swapped": Kind(
        "The link swaps the replies of two commands that are sent together. The program took u3's range for"
        " u1's: with the wall 3 in ahead it believed to have free way.",
        (
            "it acted on the range of u3 in place of that of u1: replies swapped",
            "u1 truly read 3 in, and the program drove 12 in ahead after that",
        ),
        (BLIND, "it drove ahead although the reply had shown the wall"),
        edits=PAIR,
        wire=("swapped", 1),
    ),
    "link-cut": Kind(
        "The connection was cut on the way, in the middle of the run: the radio link broke. The program could"
        " only end.",
        ("the connection ended in the middle of the run, and the program crashed by that",),
        ("the program crashed with a ConnectionError", "the program ended before it had the block"),
        wire=("cut", 12),
    ),
    "byte-lost": Kind(
        "A byte of a reply was lost on the link. The program waited 6 s for the eighth byte of a reading, and"
        " crashed by its timeout.",
        ("a reply was sent, but the program waited for it until its timeout: lost bytes",),
        ("the program crashed with TimeoutError", "silence after a reading, then the end"),
        wire=("cut-reply", 9),
    ),
    "reply-twice": Kind(
        "The link delivered the reply to the first drive twice. From there on every reply was taken for the"
        " answer to the command after it: the gyro's reading was Infinity.",
        (
            "replies are off by one since the first drive",
            "it asked for a turn by infinity after a gyro reading near 0: it had another reply",
        ),
        (BLIND, "a turn r1--inf was refused", "drives that no reading explains"),
        wire=("echo", 1),
    ),
    "slow-link": Kind(
        "Each message takes 3 s each way on this link. The program asks for one thing at a time, and the time"
        " limit passed in waiting. All moves had been right.",
        ("the link's delay of 3 s each way used up the time",),
        ("the time limit passed",),
        options=("--link-latency", "3"),
    ),
    "four-byte-replies": Kind(
        "The robot sends numbers of four bytes, and the program waits for eight. It crashed by its timeout at"
        " the first reading, before any move.",
        ("replies are 4 bytes, float32, and the program expects 8", "reply formats do not agree"),
        ("the program crashed with TimeoutError", "one command, and then silence"),
        options=("--reply-format", "float32"),
    ),
    "bracket-missing": Kind(
        "The program's packets have no closing bracket: [u1 was taken for a command with the code [u, which"
        " no device has. Each was answered Not Found. The robot did nothing, and the program gave up.",
        ("packets without their ], so none was a command", "all commands were unknown: [u1, [w1-12"),
        ("the robot did nothing", "the program gave up, with exit code 5"),
        options=("--listeners", "packets", "--idle", "2"),
        program=PACKETS,
    ),
    # -- people ------------------------------------------------------------------------------------
    "killed": Kind(
        "Somebody ended the program by a signal, SIGTERM, while it did its work well, before the block.",
        ("the program was ended from outside, by a signal", "exit code 143, with no error of its own"),
        ("the program ended before it had the block",),
        person="kill",
    ),
    "old-program-connected": Kind(
        "An old program of a teammate was still connected when this one began, and one program at a time"
        " drives. The new one could not drive the robot, and ended by a lost connection.",
        ("two programs were connected: the connection of one was closed by that of the other",),
        ("the program crashed with a connection error", "the program ended at once, with nothing done"),
        person="occupy",
    ),
}


def table(columns: tuple[str, ...], rows: list[dict[str, object]]) -> str:
    """Rows as CSV."""
    lines = [",".join(columns)]
    lines += [",".join(str(row.get(column, "")) for column in columns) for row in rows]
    return "\n".join(lines) + "\n"


def write_set(folder: Path, kind: Kind) -> None:
    """The configuration set of a kind: the bundled mission's maze and settings, and the team's robot."""
    shutil.copytree(ROOT / "config" / "mission", folder)
    sensors: list[dict[str, object]] = []
    for code, (name, *rest) in SENSORS.items():
        row = dict(zip(SENSOR_COLUMNS, (name, code, 1, *rest), strict=True))
        sensors.append({**row, **kind.sensors.get(code, {})})
    (folder / "sensors.csv").write_text(table(SENSOR_COLUMNS + SENSOR_EXTRAS, sensors), encoding="utf-8")
    drives: list[dict[str, object]] = []
    for code, name in DRIVES.items():
        row = {"ID": name, "Poll Character": code, "Enabled": 1}
        if name == "grip":
            row |= {"Reach": 3, "Width": 4}
        else:  # a stepper's small errors, so that the program's plan works
            row |= {column: 0.002 for column in DRIVE_COLUMNS if column.endswith("Error")}
            row |= {column: 0 for column in DRIVE_COLUMNS if column.endswith("Bias")}
        drives.append({**row, **kind.drives.get(code, {})})
    (folder / "drive.csv").write_text(table(DRIVE_COLUMNS, drives), encoding="utf-8")
    mission = {
        "start": "[66.0, 42.0]",
        "heading": "180.0",
        "block": "[12.0, 42.0]",
        "clearance": "1.0",
        "drop_zone": "[90.0, 42.0]",
        "time_limit": "200.0",
        "contacts": "0",
        **kind.mission,
    }
    lines = "".join(f"{key} = {value}\n" for key, value in mission.items())
    (folder / "mission.toml").write_text(lines, encoding="utf-8")


def edited(files: dict[str, str], edits: tuple[tuple[str, str], ...]) -> dict[str, str]:
    """The program's files with all replacements. Raises ValueError if one does not occur."""
    for old, new in edits:
        if not any(old in text for text in files.values()):
            raise ValueError(f"the program has no {old!r}")
        files = {name: text.replace(old, new) for name, text in files.items()}
    return files


def run(name: str, kind: Kind, seed: int, out: Path) -> dict[str, object]:
    """Make a kind's run. The row has all of the answer, and `failed`."""
    work = out / "work" / f"{name}-{seed}"
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    log = out / f"{name}-{seed}.jsonl"
    log.unlink(missing_ok=True)
    write_set(work / "set", kind)
    program = work / "program.py"
    files = {program.name: kind.program}
    if kind.program is SOLVE:
        parts = (ROOT / "scripts").glob("solve_*.py")
        files |= {part.name: part.read_text(encoding="utf-8") for part in parts}
    for file, text in edited(files, kind.edits).items():
        (work / file).write_text(text, encoding="utf-8")
    command = [sys.executable, "-u", str(program)]
    if kind.wire is not None:
        wire = work / "wire.py"
        wire.write_text(WIRE, encoding="utf-8")
        command = [sys.executable, "-u", str(wire), kind.wire[0], str(kind.wire[1]), str(program)]
    if kind.person:
        person = work / "person.py"
        person.write_text(PERSON, encoding="utf-8")
        command = [sys.executable, "-u", str(person), kind.person, str(program)]
    ports = [
        f"--{port}=0" for port in ("port", "reply-port", "belief-port", "packet-port", "packet-reply-port")
    ]
    config = "mission" if kind.program is SOLVE else str(work / "set")
    simulator = [sys.executable, "-m", "simmer_tui", "--no-ui", "--quiet", "--mission", "--config", config]
    simulator += [*ports, "--seed", str(seed), "--log", str(log), *kind.options, "--run", shlex.join(command)]
    if kind.program is not SOLVE:
        simulator.insert(-2, "--no-randbias")
    began = time.monotonic()
    with (work / "output.txt").open("w", encoding="utf-8") as output:
        process = subprocess.Popen(
            simulator,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            cwd=work,
            preexec_fn=lambda: os.nice(5),
        )
        try:
            code = process.wait(REAL_LIMIT)
        except subprocess.TimeoutExpired:
            process.terminate()
            process.wait()
            code = -1
    return {
        "kind": name,
        "seed": seed,
        "log": log.name,
        "answer": kind.answer,
        "right": list(kind.right),
        "partly": list(kind.partly),
        "wrong": list(kind.wrong or WRONG),
        "device": kind.device,
        "failed": code == 1,
        "code": code,
        "seconds": round(time.monotonic() - began, 1),
    }


def own_lines(out: Path, row: dict[str, object]) -> str:
    """The last lines that the team's program printed itself, to see that it failed as meant."""
    lines = (out / "work" / f"{row['kind']}-{row['seed']}" / "output.txt").read_text(encoding="utf-8")
    own = [line for line in lines.splitlines() if line.startswith(("team:", "Traceback")) or "Error" in line]
    return "\n".join(f"    {line[:150]}" for line in own[-4:])


def main() -> int:
    """Make the runs; returns 0, or 2 if a run did not end by itself."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seeds", type=int, default=1, help="runs of each kind (default: 1)")
    parser.add_argument("--first-seed", type=int, default=3301, help="seed of the first (default: 3301)")
    parser.add_argument("--out", type=Path, required=True, help="folder of logs and answers")
    parser.add_argument("--only", action="append", default=[], metavar="KIND", help="only this kind")
    parser.add_argument("--show", action="store_true", help="print the last own lines of each program")
    options = parser.parse_args()
    unknown = set(options.only) - set(KINDS)
    if unknown:
        parser.error(f"no kind {', '.join(sorted(unknown))}; there are {', '.join(KINDS)}")
    out: Path = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    tasks = [(name, KINDS[name], seed, out) for name in options.only or KINDS for seed in seeds]
    began = time.monotonic()
    rows: list[dict[str, object]] = []
    with concurrent.futures.ThreadPoolExecutor(JOBS) as pool:
        for row in pool.map(lambda task: run(*task), tasks):
            rows.append(row)
            state = "failed" if row["failed"] else "did not fail" if row["code"] == 0 else "BROKEN"
            print(f"{row['kind']}-{row['seed']}: {state}, {row['seconds']} s", flush=True)
            if options.show:
                print(own_lines(out, row), flush=True)
    failed = [row for row in rows if row["failed"]]
    for row in rows:
        if not row["failed"]:
            (out / str(row["log"])).unlink(missing_ok=True)
    path = out / "answers.json"
    kept = []
    if options.only and path.exists():  # the answers of other kinds stay
        kept = [
            row for row in json.loads(path.read_text(encoding="utf-8")) if row["kind"] not in options.only
        ]
    path.write_text(json.dumps(kept + failed, indent=1) + "\n", encoding="utf-8")
    succeeded = sum(row["code"] == 0 for row in rows)
    taken = time.monotonic() - began
    kinds = len({row["kind"] for row in rows})
    print(f"{kinds} kinds, {len(rows)} runs, {len(failed)} failed, {succeeded} did not fail, {taken:.0f} s")
    return 0 if len(failed) + succeeded == len(rows) else 2


if __name__ == "__main__":
    sys.exit(main())
