"""A table of failed runs with known causes, to measure how well a report explains them.

    python benchmarks/fault_fourth.py --seeds 2 --first-seed 2101 --out FOLDER
    python benchmarks/fault_fourth.py --seeds 1 --first-seed 7 --out FOLDER --only never-opens

Each kind of failure is a mistake of a program, a fault of a robot or of a link, or a person who interferes.
Its answer was written before its first run. FOLDER gets a log of each failed run, KIND-SEED.jsonl, and
answers.json. A run that succeeds, or fails in another way than its kind, is left out and counted.

Programs are changed copies of the samples, or small ones of their own. A link is a TCP proxy between program
and simulator, so the log has what arrived at the robot, and the program has something else.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

AT_ONCE = 2  # runs; the machines that this is for have two cores
LONGEST = 90.0  # s of real time; far above any run that works as meant
MAZE = [
    [3, 3, 1, 1, 0, 2, 0, 2],
    [3, 3, 0, 1, 1, 1, 1, 1],
    [1, 0, 2, 0, 0, 1, 0, 1],
    [1, 1, 1, 1, 1, 1, 0, 2],
]  # of the set mission, the top row first
PACE = ("--step-time", "0.01")  # so that a person has the time to interfere


@dataclass(frozen=True)
class Kind:
    """A kind of failure, its runs and its answer.

    Attributes:
        name: of the logs' files.
        group: program, robot, link or people.
        answer: the sentences of a teacher who has seen the run, the program, the robot and the wire.
        right, partly, wrong: facts or causes that count so when a report names them first.
        device: code of the sensor or drive to blame, empty if none is.
        shows: pattern that the output has only if the run failed as meant.
        command: the program and its arguments; {seed} is the seed.
        changes: file, old text and new text in copies of the samples.
        files: further files, by name.
        cells: file, ID, column and value in the set.
        lines: file, old text and new text in the set.
        options: further options of the simulator.
        link: mode of the proxy, empty for none.
        person: the person's action, empty for none.
        patience: real time after which a person presses Ctrl-C, seconds.
    """

    name: str
    group: str
    answer: str
    right: tuple[str, ...]
    partly: tuple[str, ...]
    wrong: tuple[str, ...]
    shows: str
    command: tuple[str, ...] = ("solve.py",)
    changes: tuple[tuple[str, str, str], ...] = ()
    files: tuple[tuple[str, str], ...] = ()
    cells: tuple[tuple[str, str, str, str], ...] = ()
    lines: tuple[tuple[str, str, str], ...] = ()
    options: tuple[str, ...] = ()
    device: str = ""
    link: str = ""
    person: str = ""
    patience: float = LONGEST


# -- programs of teams ---------------------------------------------------------------------------------------

# A fixed list of moves for one start, block and drop zone; right if every move is exact.
PLAN = '''"""Fetch and deliver by a list of moves."""
import os
import socket
import struct

MOVES = """d1-12 r1--90 d1-24 r1--90 d1-12 r1-90 d1-20 p1-1
d1--20 r1-90 d1-12 r1-90 d1-48 r1-90 d1-8 p1-0"""

link = socket.create_connection(("127.0.0.1", int(os.environ["SIMMER_PORT"])), timeout=5)


def ask(command):
    link.sendall(command.encode() + b"\\n")
    reply = b""
    while len(reply) < 8:
        reply += link.recv(8 - len(reply))
    return struct.unpack(">d", reply)[0]


for move in MOVES.split():
    print(move, ask(move), flush=True)
print("all moves done")
'''
RETRY = PLAN.replace(
    '    link.sendall(command.encode() + b"\\n")\n    reply = b""\n    while len(reply) < 8:\n'
    '        reply += link.recv(8 - len(reply))\n    return struct.unpack(">d", reply)[0]\n',
    "    for attempt in range(4):\n"
    '        link.sendall(command.encode() + b"\\n")\n'
    "        try:\n"
    '            return struct.unpack(">d", link.recv(8))[0]\n'
    "        except TimeoutError:\n"
    '            print("no reply, again", command, flush=True)\n'
    '    raise SystemExit("the robot does not answer")\n',
).replace("timeout=5", "timeout=0.3")

# Drives along corridors to the middle before a wall, turns there; touches nothing if u1 is right.
HALL = '''"""Explore the corridors."""
import random

from simmer_tui.client import Robot

choice = random.Random(4)
with Robot() as robot:
    for step in range(150):
        ahead = robot.read("u1")
        if ahead > 3.6:
            robot.drive("d1", round(min(4.0, ahead - 3.0), 2))
        else:
            robot.drive("r1", TURN)
print("explored")
'''

RAW = """import os
import socket
import struct
import sys

link = socket.create_connection(("127.0.0.1", int(os.environ["SIMMER_PORT"])), timeout=3)
link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


def take(count):
    data = b""
    while len(data) < count:
        data += link.recv(count - len(data))
    return data


"""

# A packet program: a connection for each message.
PACKETS = """import os
import socket
import sys
import time


def send(text):
    with socket.create_connection(("127.0.0.1", int(os.environ["SIMMER_PACKET_PORT"]))) as out:
        out.sendall(text.encode())


def receive():
    with socket.create_connection(("127.0.0.1", int(os.environ["SIMMER_PACKET_REPLY_PORT"]))) as back:
        return back.recv(1024).decode()


"""

WALL_AS_STOP = """from simmer_tui.client import Robot

with Robot() as robot:
    heading = robot.read('c1')
    print('heading', heading, flush=True)
    robot.drive('d1', 60)  # until the wall
    robot.drive('r1', 90)
    robot.drive('d1', 60)
    print('in the corner')
"""

LOOKS_BEHIND = """from simmer_tui.client import Robot

with Robot() as robot:
    for step in range(100):
        free = robot.read('u3')
        print('free', free, flush=True)
        if free > 2.5:
            robot.drive('d1', 2)
        else:
            robot.drive('r1', 90)
"""

EXACT_COMPARISON = """from simmer_tui.client import Robot

with Robot() as robot:
    while robot.read('u1') != 4.0:
        robot.drive('d1', 0.5)
    robot.drive('r1', 90)
    print('at the wall')
"""

NO_LINE_ENDS = """while True:
    for code in ('u1', 'u2', 'u4'):
        link.sendall(code.encode())
    ahead, left, right = struct.unpack('>3d', take(24))
    print(ahead, left, right, flush=True)
    link.sendall(b'd1-2' if ahead > 6 else b'r1-90')
    take(8)
"""

LITTLE_ENDIAN = """def ask(command):
    link.sendall(command.encode() + b'\\n')
    return struct.unpack('<d', take(8))[0]


turns = 0
while turns < 30:
    ahead = ask('u1')
    if 6 < ahead < 200:
        ask('d1-2')
    else:
        ask('r1-15')
        turns += 1
print('no way out')
sys.exit(1)
"""

REPLY_NOT_READ = """for step in range(300):
    link.sendall(b'u1\\n')
    ahead = struct.unpack('>d', take(8))[0]
    print('ahead', ahead, flush=True)
    if ahead > 5:
        link.sendall(b'd1-2\\n')
    else:
        link.sendall(b'r1-90\\n')
"""

PAUSES_BY_OWN_CLOCK = """import time

from simmer_tui.client import Robot

with Robot() as robot:
    for turn in (-90, -90, 90, 0):
        robot.send('vv-8;0;0')
        time.sleep(1.4)  # a cell and a half
        robot.send('vv-0;0;0')
        robot.drive('r1', turn)
    robot.drive('p1', 1)
    print('done', robot.read('l1'))
"""

WRONG_PORT = """link.sendall(b'u1\\n')
print(take(8))
"""

BUSY_IGNORED = """MOVES = '''d1:12 r1:-90 d1:24 r1:-90 d1:12 r1:90 d1:20 p1:1
d1:-20 r1:90 d1:12 r1:90 d1:48 r1:90 d1:8 p1:0'''
for move in MOVES.split():
    send(f'[{move}]')
    time.sleep(0.3)
    print(move, receive(), flush=True)
print('all moves done')
"""

BRACKET_OPEN = """for attempt in range(10):
    send('[u1')
    time.sleep(0.2)
    if 'Not Found' not in (reply := receive()) and reply:
        print(reply)
        break
else:
    print('no data')
    sys.exit(1)
"""

SERIAL_LINE_END = """import sys

import serial

robot = serial.Serial('COM6', 9600, timeout=1)
for attempt in range(8):
    robot.write(b'get\\r')
    line = robot.readline()
    if line:
        print(line)
        break
else:
    print('no answer')
    sys.exit(1)
"""

BOARD_RESTARTS = """import serial

robot = serial.Serial('COM6', 9600, timeout=1)
while True:
    robot.write(b'get\\n')
    ahead = float(robot.readline().split(b',')[0])
    robot.write(b'f 8\\n' if ahead > 20 else b't 90\\n')
    robot.readline()
"""

NO_ECHO_AS_DISTANCE = """import serial

robot = serial.Serial('COM6', 9600, timeout=9)
for step in range(100):
    robot.write(b'get\\n')
    ahead = float(robot.readline().split(b',')[0])
    print('ahead', ahead, flush=True)
    if 0 <= ahead < 11:
        robot.write(b't 90\\n')
    else:
        robot.write(b'f %.1f\\n' % min(ahead - 8, 10))
    robot.readline()
"""

SONAR_STUCK = """from simmer_tui.client import Robot

with Robot() as robot:
    for step in range(120):
        ahead, left = robot.read('u1', 'u2')
        print('ahead', ahead, 'left', left, flush=True)
        if ahead < 4:
            robot.drive('r1', -90)
            continue
        robot.drive('d1', 2)
        robot.drive('r1', round(max(-15, min(15, 6 * (left - 5.5))), 1))
"""

DIALECT = """[frame]
end = "\\n"

[reply]
end = "\\r\\n"
missing = "-1"

[robot]
boot = BOOT

[[command]]
match = "get"
reply = "{u1*cm:.1f},{u2*cm:.1f},{u4*cm:.1f}"

[[command]]
match = "f {n}"
do = "d1-{n/cm}"
done = "ok"

[[command]]
match = "t {n}"
do = "r1-{n}"
done = "ok"

[[command]]
match = "g {n:int}"
do = "p1-{n}"
done = "ok"

[[command]]
match = "x"
do = "stop"
"""

# Between program and simulator: MODE SEED FILE PROGRAM ...
PROXY = '''"""A bridge between program and robot."""
import os
import queue
import random
import socket
import struct
import subprocess
import sys
import threading
import time

mode, seed, counts, *program = sys.argv[1:]
chance = random.Random(int(seed))
first = 150 + chance.randrange(60)
INF = struct.pack(">d", float("inf"))
done = []


def note(text):
    done.append(text)
    with open(counts, "w") as file:
        file.write(f"{len(done)} {mode}\\n" + "\\n".join(done) + "\\n")


def upward(client, robot, waiting):
    number = moves = 0
    before = b""
    while data := client.recv(4096):
        before += data
        *lines, before = before.split(b"\\n")
        out = b""
        for line in lines:
            number += 1
            is_move = line[:3] in (b"d1-", b"r1-")
            moves += is_move
            if mode == "echo":
                client.sendall(line + b"\\r\\n")
                note(line.decode())
            if mode == "swallow" and is_move and moves % 5 == 3:
                note(line.decode())
                client.sendall(INF)
                continue
            if mode == "dot" and line[:2] == b"d1" and b"." in line and number > first // 2 and not done:
                line = line.replace(b".", b"")
                note(line.decode())
            waiting.put(line)
            if mode == "merge" and number % 41 == 0 and line is not lines[-1]:
                note(line.decode())
                out += line
                continue
            out += line + b"\\n"
            if mode == "double" and is_move and moves % 9 == 8:
                note(line.decode())
                waiting.put(line)
                out += line + b"\\n"
        if mode == "cut" and number > first:
            note("closed")
            client.shutdown(socket.SHUT_RDWR)
            robot.shutdown(socket.SHUT_RDWR)
            return
        robot.sendall(out)
    robot.shutdown(socket.SHUT_WR)


def downward(client, robot, waiting):
    number = moves = 0
    held = None
    data = b""
    while more := robot.recv(4096):
        data += more
        while len(data) >= 8:
            reply, data = data[:8], data[8:]
            command = waiting.get()
            number += 1
            moves += command[:3] in (b"d1-", b"r1-")
            if mode == "lose" and number == first:
                note(command.decode())
                continue
            if mode == "byte" and number == first // 3:
                note(command.decode())
                reply = reply[1:]
            if mode == "late" and command[:3] == b"d1-" and moves % 4 == 3:
                note(command.decode())
                time.sleep(0.45)
            if mode == "swap" and command == b"u2":
                held = reply
                continue
            if mode == "swap" and command == b"u3" and held:
                note("u2 u3")
                reply, held = reply + held, None
            client.sendall(reply)


listener = socket.create_server(("127.0.0.1", 0))


def serve():
    client, _ = listener.accept()
    robot = socket.create_connection(("127.0.0.1", int(os.environ["SIMMER_PORT"])))
    for end in (client, robot):
        end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    waiting = queue.Queue()
    threading.Thread(target=quietly, args=(downward, client, robot, waiting), daemon=True).start()
    quietly(upward, client, robot, waiting)


def quietly(direction, *ends):
    try:
        direction(*ends)
    except OSError:
        pass


threading.Thread(target=serve, daemon=True).start()
port = str(listener.getsockname()[1])
environment = {**os.environ, "SIMMER_PORT": port, "SIMMER_REPLY_PORT": "0"}
sys.exit(subprocess.run([sys.executable, *program], env=environment).returncode)
'''


def csv_text(cells: Sequence[Sequence[int]]) -> str:
    """The text of a maze.csv."""
    return "".join(",".join(map(str, row)) + "\n" for row in cells)


MAP_WITHOUT_WALL = [list(row) for row in MAZE]
MAP_WITHOUT_WALL[1][2] = 1

# Changes of a set: exact drives, and one fixed mission that PLAN does.
EXACT = tuple(
    ("drive.csv", row, f"{axis} Error", "0.0002")
    for row in ("right", "rot", "up", "down", "left")
    for axis in ("X-Axis", "Y-Axis", "Rotation")
)
UNBIASED = (("settings.toml", "\nrandbias = true", "\nrandbias = false"),)
FIXED = (
    ("mission.toml", '\nstart = "any"', "\nstart = [66.0, 42.0]"),
    ("mission.toml", '\nheading = "quarter"', "\nheading = 270.0"),
    ("mission.toml", '\nblock = "any"', "\nblock = [18.0, 42.0]"),
    ("mission.toml", '\ndrop_zone = "any"', "\ndrop_zone = [90.0, 42.0]"),
)

LOOK = "np.array([self.robot.read(code) for code in codes])"
GRIP = (
    "            self.pilot.drive(float(np.hypot(*(block - self.pilot.place))) - self.grip)\n"
    "            self.pilot.look()\n"
    "            self.robot.drive(GRIPPER, 1)\n"
    "            if self.loaded():\n"
)
RUN = ".run(drop_zone)"
SHORT_SEARCH = (("solve.py", "LOOKS = 60", "LOOKS = 15"), ("solve.py", "ROUNDS = 4", "ROUNDS = 2"))
IMPATIENT = ("solve.py", "with Robot() as robot:", "with Robot(timeout=3.0) as robot:")
IMPATIENT_COURSE = ("course/step7_mission.py", "with Robot() as robot:", "with Robot(timeout=3.0) as robot:")
COURSE = ("course/step7_mission.py",)
CONTACT = "contact"
NOMINAL = (
    "course/step7_mission.py",
    "import sys\n",
    'import os\nimport sys\n\nos.environ["SIMMER_CONFIG"] = "mission"\n',
)

KINDS: list[Kind] = []


def kind(name: str, group: str, answer: str, **rest: object) -> None:
    """Add a kind to the table."""
    KINDS.append(Kind(name, group, answer, **rest))  # type: ignore[arg-type]


# -- mistakes of programs: map, frame, units -----------------------------------------------------------------

kind(
    "map-flipped",
    "program",
    (
        "The program's map is upside down: it takes the first row of its maze file for the bottom one. "
        "So readings never fit its map, or fit at a wrong place."
    ),
    right=(
        "the program's map of the maze differs from the maze, or is flipped",
        "it localized at a place where it was not, by a map that does not fit",
    ),
    partly=("it never knew where it was; it gave up", "it was lost when it touched the wall"),
    wrong=("a sensor or drive is faulty", "the block or gripper is to blame"),
    shows="lost|failed|contact",
    command=("solve.py", "--maze", "our_maze.csv"),
    files=(("our_maze.csv", csv_text(MAZE[::-1])),),
)
kind(
    "map-without-wall",
    "program",
    (
        "The program's map has free floor where the maze has a wall (second row, third cell). It plans "
        "its path to the loading zone through that wall."
    ),
    right=(
        "it drove at or planned through a wall that its map does not have",
        "its map differs from the maze at that cell",
    ),
    partly=("it was lost, or its readings did not fit, in front of that wall", "it touched that wall"),
    wrong=("a sensor or drive is faulty", "it never localized"),
    shows="lost|failed|contact",
    command=("solve.py", "--maze", "our_maze.csv"),
    files=(("our_maze.csv", csv_text(MAP_WITHOUT_WALL)),),
)
kind(
    "turn-sign",
    "program",
    (
        "The program turns the wrong way: it sends a right turn where it means a left one. Each "
        "correction of the heading makes the error larger."
    ),
    right=("the sign of its turns is wrong", "its turns lead away from the heading that it needs"),
    partly=(
        "it turns again and again and gets nowhere",
        "it drove in a direction that it did not intend, into a wall",
    ),
    wrong=("the drive r1 is faulty", "it never localized"),
    shows="lost|failed|contact",
    changes=(
        (
            "solve_pilot.py",
            "self._do(TURN, self._model.command(TURN, angle))",
            "self._do(TURN, -self._model.command(TURN, angle))",
        ),
    ),
)
kind(
    "radians",
    "program",
    (
        "The motion model takes the heading in degrees for radians. While the robot only turns nothing "
        "is wrong; from the first drive on the believed place is wrong."
    ),
    right=(
        "its belief goes in another direction than the robot drives, from the first drive on",
        "its motion model has a wrong direction",
    ),
    partly=("it was lost after it had localized", "it never localized and gave up"),
    wrong=("a drive or odometer is faulty", "the start was ambiguous"),
    shows="lost|failed|contact",
    changes=(
        (
            "solve_beliefs.py",
            "middle = np.radians(self.particles[:, 2] + turned / 2)",
            "middle = self.particles[:, 2] + turned / 2",
        ),
    ),
)
kind(
    "centimetres-driven",
    "program",
    (
        "The program commands its drives in centimetres, but the robot takes inches. So every drive is "
        "2.54 times too long, and one of them ends at a wall."
    ),
    right=(
        "its drives are 2.5 times as long as it means: a wrong unit",
        "it commanded a drive longer than the free space that it had or had measured",
    ),
    partly=("it drove into a wall",),
    wrong=("drive d1 is faulty", "it was lost before the contact by bad sensors"),
    shows=CONTACT,
    changes=(
        (
            "solve_pilot.py",
            "self._model.command(FORWARD, distance)",
            "self._model.command(FORWARD, distance * 2.54)",
        ),
    ),
)
kind(
    "centimetres-read",
    "program",
    (
        "The program takes ranges for centimetres and divides them by 2.54. No place of its map fits "
        "such short ranges, so it never localizes, or wrongly."
    ),
    right=(
        "it uses right readings with a wrong scale or unit",
        "its readings were right, but it localized at a place where they do not fit",
    ),
    partly=("it never localized", "it localized at a wrong place", "it gave up"),
    wrong=("range sensors are faulty", "drives are faulty"),
    shows="lost|failed|contact",
    changes=(("solve_pilot.py", LOOK, LOOK + " / 2.54"),),
)
kind(
    "sides-swapped",
    "program",
    (
        "The program has u2 and u4 the wrong way round: it takes the left sensor for the right one. So "
        "its view of the maze is mirrored, and it localizes at a wrong place or never."
    ),
    right=(
        "it confuses left and right sensors (u2, u4)",
        "the sensors were right, but what it concluded from u2 and u4 was wrong",
    ),
    partly=("it localized wrongly or never", "it was lost when it touched the wall", "it gave up"),
    wrong=("sensor u2 or u4 is faulty on the robot", "drives are faulty"),
    shows="lost|failed|contact",
    changes=(
        (
            "solve_pilot.py",
            LOOK,
            'np.array([self.robot.read({"u2": "u4", "u4": "u2"}.get(code, code)) for code in codes])',
        ),
    ),
)
kind(
    "odometer-sign",
    "program",
    (
        "The program adds sideways motion with the wrong sign: when the robot goes left its belief goes "
        "right. The belief is wrong after each sideways drive."
    ),
    right=(
        "its belief moves against the robot's sideways motion (w1)",
        "it is lost by its own sideways drives",
    ),
    partly=("it was lost after it had localized", "it touched a wall while it was lost"),
    wrong=("odometer o1 or o2 is faulty", "drive w1 is faulty", "it never localized"),
    shows="lost|failed|contact",
    command=COURSE,
    changes=(
        (
            "course/step4_particle_filter.py",
            "np.array((motion.forward, motion.left, motion.turn))",
            "np.array((motion.forward, -motion.left, motion.turn))",
        ),
    ),
)
kind(
    "drive-code",
    "program",
    (
        "The program sends s1 (right) where it means w1 (left). Each sideways correction brings the "
        "robot further from its path, up to a wall."
    ),
    right=(
        "it drives to the wrong side: s1 in place of w1, or a wrong sign",
        "its sideways commands lead away from its target, to the wall",
    ),
    partly=("it drove sideways into a wall", "it does not get where it wants to"),
    wrong=("drive s1 is faulty", "it never localized"),
    shows="lost|failed|contact",
    command=COURSE,
    changes=(("course/step5_planning.py", 'zip(("d1", "w1"), stride)', 'zip(("d1", "s1"), stride)'),),
)
kind(
    "minus-hyphen",
    "program",
    (
        "The program writes r1-45 for a turn by -45. The hyphen is the separator, so the robot turns "
        "left by 45: no turn to the right and no drive back ever happens."
    ),
    right=(
        "all its turns go left (its drives ahead): the minus sign is missing, r1--45 is right",
        "no command of the run has a negative value",
    ),
    partly=(
        "its turns lead away from the heading that it needs",
        "it turns and gets nowhere",
        "it drove ahead where it meant back",
    ),
    wrong=("drive r1 is faulty", "commands were refused"),
    shows="lost|failed|contact",
    changes=(
        (
            "solve_pilot.py",
            "self.robot.drive(drive, round(value, 3))",
            'self.robot.send(f"{drive}{value:+.3f}")',
        ),
    ),
)

# -- mistakes of programs: start, block, drop zone -----------------------------------------------------------

kind(
    "start-assumed",
    "program",
    (
        "The program assumes the start (9.5, 42) of its practice runs and does not localize. The robot "
        "starts elsewhere, so the program believes in a wrong place from the first moment."
    ),
    right=(
        "it believed in a wrong start from the beginning",
        "it never localized: its belief was wrong from the first one on",
    ),
    partly=("it was lost", "its readings did not fit, and it gave up"),
    wrong=("it lost its place on the way", "sensors are faulty"),
    shows="lost|failed|contact",
    changes=(
        *SHORT_SEARCH,
        (
            "solve.py",
            '        self.say(f"somewhere, heading about {heading:.0f} degrees")\n',
            "        start = np.random.default_rng(1).normal((9.5, 42.0, 0.0), (0.3, 0.3, 2.0), (500, 3))\n"
            "        self.localizer.particles, self.localizer._weights = start, np.full(500, 1 / 500)\n"
            "        self.localizer.fit = 1.0\n"
            "        return True\n",
        ),
    ),
)
kind(
    "settles-too-soon",
    "program",
    (
        "The program starts to drive after its first look, while many places still fit. The mean of "
        "those places is a place where the robot is not."
    ),
    right=(
        "it acted on an ambiguous or uncertain belief (large spread)",
        "it took a wrong place for its own, before the readings decided between places",
    ),
    partly=("it was lost when it drove", "it localized at a wrong place"),
    wrong=("sensors or drives are faulty", "it lost its place later by drift"),
    shows="lost|failed|contact",
    changes=(
        (
            "solve_beliefs.py",
            "return self.spread < 0.7 and float(self._weights @ off**2) < 4.0**2 and self.fit > DOUBTFUL",
            "return self.fit > 0.1",
        ),
    ),
)
kind(
    "block-not-checked",
    "program",
    (
        "The program closes the gripper before it is at the block, so it takes nothing. It never reads "
        "the load sensor, and carries nothing to the drop zone."
    ),
    right=(
        "the gripper closed too far from the block and took nothing",
        "it closed the gripper with no block in it and went on without a check",
    ),
    partly=("the block was never taken", "it ended and believed that it had delivered"),
    wrong=("the gripper is faulty", "it set the block down at a wrong place"),
    shows="delivered",
    changes=(
        (
            "solve.py",
            GRIP,
            "            self.robot.drive(GRIPPER, 1)\n"
            "            self.pilot.drive(float(np.hypot(*(block - self.pilot.place))) - self.grip)\n"
            "            self.pilot.look()\n"
            "            if True:\n",
        ),
        ("solve.py", "return not self.loaded()", "return True"),
    ),
)
kind(
    "overshoots-block",
    "program",
    (
        "The program stops too close to the block: its grip distance is 2.3 in too short. The block's "
        "centre is beside or under the robot, behind the gripper's window."
    ),
    right=(
        "it was too close: the block was nearer than the gripper's window, behind the robot's front",
        "it drove too far before it closed the gripper",
    ),
    partly=("the gripper closed and took nothing", "it gave up after several misses"),
    wrong=("the gripper is faulty", "it did not find the block", "it was lost"),
    shows="missed it",
    changes=(("solve.py", "GAP = 0.3  #", "GAP = -2.0  #"),),
)
kind(
    "servo-angle",
    "program",
    (
        "The program sends p1-90, a servo's angle. The gripper takes only 0 or 1, so the command was "
        "refused each time and the program ignored that."
    ),
    right=("p1-90 was refused: the gripper takes 1 or 0",),
    partly=("the gripper never closed", "the block was never taken"),
    wrong=("the robot missed the block by its position", "the gripper is faulty"),
    shows="missed it",
    changes=(("solve.py", "self.robot.drive(GRIPPER, 1)", 'self.robot.send("p1-90")'),),
)
kind(
    "load-inverted-logic",
    "program",
    (
        "The program reads the load sensor the wrong way round. It has the block, takes the grip for a "
        "miss, and opens the gripper again."
    ),
    right=(
        "it had the block and opened the gripper again at once",
        "it misread the load sensor: l1 was 1 and it acted as with 0",
    ),
    partly=(
        "it released the block in the loading zone, outside of the drop zone",
        "it gave up after it had taken the block",
    ),
    wrong=("the load sensor is faulty", "the gripper missed the block"),
    shows="missed it",
    changes=(("solve.py", "return self.pilot.mean(LOAD, 9) > 0.5", "return self.pilot.mean(LOAD, 9) < 0.5"),),
)
kind(
    "wrong-height",
    "program",
    (
        "The program looks for the block with u1, which is above the block and sees only walls. u5, the "
        "low sensor, would see it."
    ),
    right=(
        "it looked for the block with a sensor that cannot see it (u1 is too high)",
        "it did not use u5 for the block",
    ),
    partly=("it never found the block", "it never took the block and gave up", "the time limit passed"),
    wrong=("sensor u5 or u1 is faulty", "it was lost"),
    shows="failed",
    changes=(*SHORT_SEARCH, ("solve.py", 'HIGH, LOW = "u1", "u5"', 'HIGH, LOW = "u5", "u1"')),
)
kind(
    "gives-up-search",
    "program",
    (
        "The program looks once for the block and then gives up, although it knows where it is and has "
        "most of its time left."
    ),
    right=(
        (
            "it ended by itself, localized, long before the time limit, without having seen or "
            "approached the block"
        ),
        "it gave up the search too early",
    ),
    partly=("the block was never taken",),
    wrong=("it was lost", "sensors are faulty", "it crashed"),
    shows="failed",
    changes=(("solve.py", "LOOKS = 60", "LOOKS = 1"), ("solve.py", "ROUNDS = 4", "ROUNDS = 1")),
)
kind(
    "stops-after-fetch",
    "program",
    "The program ends with exit code 0 as soon as it holds the block. It never drives to the drop zone.",
    right=("it ended by itself while it held the block", "the part that delivers is missing"),
    partly=("the block was not delivered",),
    wrong=("it crashed", "it was lost", "it dropped the block at a wrong place"),
    shows="delivered",
    changes=(
        (
            "solve.py",
            '                    self.say(f"carrying the block to ({drop_zone[0]:g}, {drop_zone[1]:g})")\n',
            "                    return True\n",
        ),
    ),
)
kind(
    "never-opens",
    "program",
    (
        "The program brings the block to the drop zone and ends there without opening the gripper. A "
        "block that is held is not delivered."
    ),
    right=(
        "it never opened the gripper in the drop zone",
        "it ended in the drop zone with the block still held",
    ),
    partly=("the block was not delivered", "it ended while it held the block"),
    wrong=("it did not reach the drop zone", "the gripper is faulty"),
    shows="delivered",
    changes=(
        (
            "solve.py",
            "self.robot.drive(GRIPPER, 0)\n                    return not self.loaded()",
            "return self.loaded()",
        ),
    ),
)
kind(
    "drop-zone-swapped",
    "program",
    (
        "The program swaps x and y of the drop zone. So it carries the block to a wrong cell, or finds "
        "no path to a place outside of the maze, takes itself for lost, and turns with the block."
    ),
    right=(
        "its goal is not the drop zone: x and y are swapped",
        "it set the block down in another cell than the drop zone, and believed that it was right",
    ),
    partly=(
        "it held the block and gave up",
        "it released the block outside of the drop zone",
        "the held block touched a wall",
    ),
    wrong=("it was lost by sensors or drives", "the gripper is faulty"),
    shows="carrying",
    changes=(("solve.py", RUN, ".run(drop_zone[::-1])"),),
)
kind(
    "drop-zone-from-top",
    "program",
    (
        "The program counts the drop zone's y from the top. It sets the block down in the cell mirrored "
        "at the maze's middle, or finds a wall there and gives up."
    ),
    right=(
        "its goal is another cell than the drop zone, mirrored from top to bottom",
        "it knew its place and set the block down in a wrong cell",
    ),
    partly=("it released the block outside of the drop zone", "it held the block and gave up"),
    wrong=("it was lost", "sensors or drives are faulty"),
    shows="carrying",
    changes=(("solve.py", RUN, ".run(np.array((drop_zone[0], 48.0 - drop_zone[1])))"),),
)
kind(
    "drop-zone-assumed",
    "program",
    (
        "The program always delivers to the practice drop zone (30, 18). In this run the drop zone is "
        "another cell."
    ),
    right=(
        "it knew its place and set the block down in a wrong cell, (30, 18)",
        "it did not ask for, or ignored, this run's drop zone",
    ),
    partly=("it released the block outside of the drop zone",),
    wrong=("it was lost", "sensors or drives are faulty"),
    shows="carrying",
    command=("solve.py", "--drop-zone", "30,18"),
)
kind(
    "forgets-held-block",
    "program",
    (
        "The program plans as if the robot had no block. It turns where robot and block are too long "
        "together, and the held block touches a wall."
    ),
    right=(
        "the held block, not the robot, touched the wall",
        "it turned or drove with the block where there was room for the robot alone",
    ),
    partly=("it touched a wall while it carried the block", "it released the block outside of the drop zone"),
    wrong=("it was lost", "sensors or drives are faulty"),
    shows=CONTACT,
    changes=(
        (
            "solve.py",
            "                self.body.take(self.localizer.pose, block, self.block_size + 2 * BLUR)\n",
            "                self.holding = True\n",
        ),
        (
            "solve.py",
            "if self.body.loaded or self.fetch():",
            'if getattr(self, "holding", False) or self.fetch():',
        ),
    ),
)

# -- mistakes of programs: control ---------------------------------------------------------------------------

kind(
    "reads-too-often",
    "program",
    (
        "The program takes the mean of 80 readings at every look. Almost all of its time goes into "
        "readings, and the time limit passes."
    ),
    right=(
        "most of the time went into reading range sensors",
        "it reads the same sensors again and again where the robot does not move",
    ),
    partly=("the time limit passed", "it was too slow"),
    wrong=("it was lost", "the link is slow", "a sensor is faulty"),
    shows="time",
    changes=(("solve_pilot.py", LOOK, "np.array([self.mean(code, 80) for code in codes])"),),
)
kind(
    "tight-heading",
    "program",
    (
        "The program corrects its heading until the error is exactly 0, which the turns cannot reach. It "
        "turns to and fro on one spot until the time limit."
    ),
    right=(
        "it makes endless small turns on one spot",
        "its tolerance for the heading is finer than its turns and readings",
    ),
    partly=("the time limit passed", "it did not move on"),
    wrong=("drive r1 is faulty", "it was lost", "it waited in silence"),
    shows="time",
    lines=(
        ("mission.toml", "\ntime_limit = 300.0", "\ntime_limit = 90.0"),
    ),  # so that it takes less real time
    changes=(
        (
            "solve_pilot.py",
            "        for _ in range(5):\n            turn = math.remainder",
            "        while True:\n            turn = math.remainder",
        ),
        ("solve_pilot.py", "if abs(turn) < STRAIGHT:\n", "if turn == 0.0:\n"),
    ),
)
kind(
    "waits-for-old-reading",
    "program",
    (
        "The program reads u5 once and then waits for that number to become smaller, without reading "
        "again. It sends nothing more, and a person ends the run."
    ),
    right=(
        "the program went silent before the grip: it ran on but sent no command",
        "it waits for ever, after its last reading of u5",
    ),
    partly=("the run was ended by a person (Ctrl-C) with nothing done for a long time",),
    wrong=("it crashed", "the link or the simulator lost a reply", "it gave up by itself"),
    shows="waiting",
    changes=(
        (
            "solve.py",
            "            self.pilot.look()\n            self.robot.drive(GRIPPER, 1)\n",
            "            self.pilot.look()\n"
            "            near = self.robot.read(LOW)\n"
            '            print("waiting", near, flush=True)\n'
            "            while near > -1.0:\n"
            "                time.sleep(0.05)\n"
            "            self.robot.drive(GRIPPER, 1)\n",
        ),
        ("solve.py", "import sys\n", "import sys\nimport time\n"),
    ),
    patience=9.0,
)
kind(
    "crash-results-file",
    "program",
    (
        "The program crashed right after it took the block: it opens results/run1.txt, and the folder is "
        "not there."
    ),
    right=("it crashed with FileNotFoundError: results/run1.txt",),
    partly=("it crashed while it held the block", "the program ended with exit code 1"),
    wrong=("it gave up by itself", "it was lost", "a device is faulty"),
    shows="FileNotFoundError",
    changes=(
        (
            "solve.py",
            "                self.body.take(self.localizer.pose, block, self.block_size + 2 * BLUR)\n",
            "                self.body.take(self.localizer.pose, block, self.block_size + 2 * BLUR)\n"
            '                open("results/run1.txt", "w").write("taken")\n',
        ),
    ),
)
kind(
    "module-missing",
    "program",
    (
        "The program did not start: it imports a module (kalman) that is not installed here. No command "
        "was sent."
    ),
    right=("ModuleNotFoundError: no module named kalman",),
    partly=("the program crashed before its first command", "no command came"),
    wrong=("it did not find the port", "it gave up"),
    shows="ModuleNotFoundError",
    changes=(("solve.py", "import argparse\n", "import argparse\nfrom kalman import KalmanFilter\n"),),
)
kind(
    "asks-for-enter",
    "program",
    (
        "The program waits for a person to press Enter with input(). Here nobody is at its keyboard, so "
        "it crashed with EOFError before it moved."
    ),
    right=("EOFError: it calls input() and there is no keyboard",),
    partly=("the program crashed before its first command", "no command moved the robot"),
    wrong=("it did not find the port", "it gave up", "a device is faulty"),
    shows="EOFError",
    changes=(
        (
            "solve.py",
            "            drop_zone = options.drop_zone\n",
            '            input("Put the robot down and press Enter")\n'
            "            drop_zone = options.drop_zone\n",
        ),
    ),
)
kind(
    "wall-as-stop",
    "program",
    (
        "The program drives 60 in ahead and relies on a wall to stop the robot, to know where it is. A "
        "contact with a wall ends the mission."
    ),
    right=(
        "it commanded a drive (60 in) far longer than the free distance",
        "it drove into a wall on purpose or without a look",
    ),
    partly=("it touched a wall at its first drive",),
    wrong=("drive d1 is faulty", "it was lost", "a sensor is faulty"),
    shows=CONTACT,
    command=("main.py",),
    files=(
        (
            "main.py",
            WALL_AS_STOP,
        ),
    ),
)
kind(
    "moves-without-looking",
    "program",
    (
        "The program does a fixed list of moves and never reads a sensor. The drives' usual errors add "
        "up until the robot touches a wall."
    ),
    right=("it never read a sensor: it drove by dead reckoning, and errors added up",),
    partly=("it touched a wall off its path", "the drives' errors brought it to the wall"),
    wrong=("a drive is broken", "the list of moves is wrong", "it localized wrongly"),
    shows=CONTACT,
    command=("main.py",),
    files=(("main.py", PLAN),),
    lines=FIXED,
)
kind(
    "looks-behind",
    "program",
    (
        "The program checks u3 before it drives ahead, but u3 looks to the rear. The wall ahead was "
        "never looked at."
    ),
    right=("it drove ahead without reading a sensor that looks ahead; it read u3, which looks back",),
    partly=("it drove into a wall that it had never seen",),
    wrong=("sensor u3 is faulty", "drive d1 is faulty"),
    shows=CONTACT,
    command=("main.py",),
    files=(
        (
            "main.py",
            LOOKS_BEHIND,
        ),
    ),
)
kind(
    "exact-comparison",
    "program",
    (
        "The program drives half an inch at a time until u1 is exactly 4.0. A noisy reading never is, so "
        "it drove on to the wall although u1 showed it."
    ),
    right=(
        "it saw the wall come nearer (u1) and drove on all the same",
        "it waits for u1 to be exactly 4: its condition for a stop is wrong",
    ),
    partly=("it drove ahead into a wall",),
    wrong=("sensor u1 is faulty", "it did not read a sensor", "drive d1 is faulty"),
    shows=CONTACT,
    command=("main.py",),
    files=(
        (
            "main.py",
            EXACT_COMPARISON,
        ),
    ),
)
kind(
    "wanders-only",
    "program",
    (
        "The program wanders through the maze without a goal: it neither localizes nor looks for the "
        "block. The time limit passed."
    ),
    right=(
        "it wandered for the whole time and never closed the gripper or went for the block",
        "it has no part that localizes, searches or takes",
    ),
    partly=("the time limit passed", "the block was never taken"),
    wrong=("it was too slow at a good plan", "it was lost after it had localized", "a device is faulty"),
    shows="time",
    command=("wander.py", "--steps", "100000"),
)
kind(
    "pauses-by-own-clock",
    "program",
    (
        "The program sets a velocity and pauses with time.sleep. The robot's time does not pass "
        "meanwhile, so the robot hardly moved when the velocity ended."
    ),
    right=("time.sleep passes no simulated time: the velocity had almost no time to act",),
    partly=("the robot hardly moved", "it ended by itself far from its goal"),
    wrong=("the drive is faulty", "commands were refused", "it crashed"),
    shows="done",
    command=("main.py",),
    files=(
        (
            "main.py",
            PAUSES_BY_OWN_CLOCK,
        ),
    ),
)

# -- mistakes of programs: protocol --------------------------------------------------------------------------

kind(
    "no-line-ends",
    "program",
    (
        "The program sends u1, u2 and u4 one after the other without line ends. They arrived as one "
        "command, got one reply, and the program waited for three."
    ),
    right=("commands without line ends ran together into one (u1u2u4)",),
    partly=("the program waited for replies that never came, and timed out", "it crashed with a timeout"),
    wrong=("the link lost replies", "a sensor is faulty"),
    shows="[Tt]imed? ?out",
    command=("main.py",),
    files=(
        (
            "main.py",
            RAW + NO_LINE_ENDS,
        ),
    ),
)
kind(
    "little-endian",
    "program",
    (
        "The program reads the replies' bytes in the wrong order. All its readings are nonsense near 0, "
        "so it saw a wall everywhere, only turned, and gave up."
    ),
    right=(
        "it read replies with the wrong byte order",
        "the readings were right and the program understood something else",
    ),
    partly=("it only turned on the spot, although the way was free", "it gave up without a drive"),
    wrong=("sensor u1 is faulty", "the link corrupted replies"),
    shows="no way out",
    command=("main.py",),
    files=(
        (
            "main.py",
            RAW + LITTLE_ENDIAN,
        ),
    ),
)
kind(
    "reply-not-read",
    "program",
    (
        "The program never reads the replies of its drives. So each later reading is an old reply: it "
        "gets Infinity or an old range for u1, and drove into a wall."
    ),
    right=(
        "it did not read the replies of its drives, so its readings were late by several replies",
        "the reply to u1 was right and near, and the program drove all the same, with older replies unread",
    ),
    partly=("it drove into a wall that the last replies showed",),
    wrong=("sensor u1 is faulty", "the link delayed replies", "it did not look"),
    shows=CONTACT,
    command=("main.py",),
    files=(
        (
            "main.py",
            RAW + REPLY_NOT_READ,
        ),
    ),
)
kind(
    "wrong-port",
    "program",
    (
        "The program connects to a port that is written in it, 9009, where no simulator listens. The "
        "connection was refused and no command was sent."
    ),
    right=("ConnectionRefusedError: the program did not find the simulator's port",),
    partly=("no command came", "the program crashed at its start"),
    wrong=("it gave up", "the link was cut during the run"),
    shows="ConnectionRefusedError",
    command=("main.py",),
    files=(
        (
            "main.py",
            RAW.replace('int(os.environ["SIMMER_PORT"])', "9009") + WRONG_PORT,
        ),
    ),
)
kind(
    "busy-ignored",
    "program",
    (
        "The program pauses for a fixed time after each move, which is too short. Moves that came while "
        "the robot still moved were refused, and it ignored the reply False."
    ),
    right=(
        "moves were refused because the robot was still moving",
        "it did not wait for the end of a movement",
    ),
    partly=("some of its moves never happened, so its path was wrong", "it touched a wall off its path"),
    wrong=("a drive is faulty", "the link lost commands", "the list of moves is wrong"),
    shows="False",
    command=("main.py",),
    files=(
        (
            "main.py",
            PACKETS + BUSY_IGNORED,
        ),
    ),
    cells=EXACT,
    lines=(*FIXED, *UNBIASED),
    options=(
        "--listeners",
        "packets",
        "--packet-port",
        "0",
        "--packet-reply-port",
        "0",
        "--motion",
        "timed",
        "--time-scale",
        "10",
    ),
)
kind(
    "bracket-open",
    "program",
    (
        "The program forgets the closing bracket: it sends [u1 in place of [u1]. No packet was complete, "
        "so each was refused, and it gave up."
    ),
    right=("its packets have no closing bracket", "no message of the program was complete or understood"),
    partly=("its commands were refused", "it gave up without a reading"),
    wrong=("the link lost replies", "it did not find the port", "it crashed"),
    shows="no data",
    command=("main.py",),
    files=(
        (
            "main.py",
            PACKETS + BRACKET_OPEN,
        ),
    ),
    options=("--listeners", "packets", "--packet-port", "0", "--packet-reply-port", "0", "--motion", "timed"),
)
kind(
    "serial-line-end",
    "program",
    (
        "The program ends its lines with a carriage return, but the robot waits for a newline. No "
        "message ever ended, so no reply came, and the program gave up."
    ),
    right=(
        "its messages end with the wrong line end: \\r in place of \\n",
        "no message was complete: its end is missing",
    ),
    partly=("no reply came", "no command came", "it gave up"),
    wrong=("the robot was booting", "the link lost bytes", "it did not find the port"),
    shows="no answer",
    command=("main.py",),
    files=(
        (
            "main.py",
            SERIAL_LINE_END,
        ),
        ("set/dialect.toml", DIALECT.replace("BOOT", "0")),
    ),
    options=("--clock", "program", "--dialect-port", "0"),
)
kind(
    "board-restarts",
    "program",
    (
        "Opening the port restarts the board for 2 s, and the program's first message was lost "
        "meanwhile. The program took the missing reply for a number and crashed."
    ),
    right=("the first message was lost because the robot was booting",),
    partly=("it crashed: could not convert an empty reply to a number", "no reply came to its first message"),
    wrong=("a sensor is faulty", "wrong line end or language", "it gave up"),
    shows="ValueError",
    command=("main.py",),
    files=(
        (
            "main.py",
            BOARD_RESTARTS,
        ),
        ("set/dialect.toml", DIALECT.replace("BOOT", "2.0")),
    ),
    options=("--clock", "program", "--dialect-port", "0"),
)
kind(
    "no-echo-as-distance",
    "program",
    (
        "The sensor answers -1 if there is no echo, and the program takes -1 for a distance. It drove "
        "back by that number, without a look, into the wall behind."
    ),
    right=(
        "it took the -1 of no echo for a distance, and drove back",
        "it drove back after a reading without echo",
    ),
    partly=("it drove back without a look behind, into a wall",),
    wrong=("sensor u1 is faulty", "drive d1 is faulty", "it was lost"),
    shows=CONTACT,
    command=("main.py",),
    files=(
        (
            "main.py",
            NO_ECHO_AS_DISTANCE,
        ),
        ("set/dialect.toml", DIALECT.replace("BOOT", "0")),
    ),
    cells=(*EXACT, ("sensors.csv", "ultra1", "Max Range (in)", "20")),
    lines=UNBIASED,
    options=("--clock", "program", "--dialect-port", "0"),
)

# -- faults of robots ----------------------------------------------------------------------------------------

kind(
    "compass-mounted-turned",
    "robot",
    (
        "The compass is mounted 90 degrees off, so c1 is wrong by a quarter turn. The program searches "
        "only headings near it, and localizes wrongly or never."
    ),
    right=("compass c1 is off by 90 degrees",),
    partly=(
        "it localized at a wrong place or heading, or never",
        "it believed in a wrong heading from the beginning",
    ),
    wrong=("range sensors or drives are faulty", "the program is too slow"),
    device="c1",
    shows="lost|failed|contact",
    changes=SHORT_SEARCH,
    cells=(("sensors.csv", "comp1", "Rotation (deg)", "90"),),
)
kind(
    "low-sonar-too-high",
    "robot",
    (
        "The low sonar u5 is mounted 6 in high, above the block. It sees only walls, so the program "
        "never found the block."
    ),
    right=("u5 is too high to see the block, or never saw it",),
    partly=(
        "it never found the block",
        "it searched and gave up with its place known",
        "the time limit passed",
    ),
    wrong=("it was lost", "the gripper is faulty", "the program does not search"),
    device="u5",
    shows="failed",
    changes=SHORT_SEARCH,
    cells=(("sensors.csv", "ultra5", "Z Position (in)", "6"),),
)
kind(
    "low-sonar-blind-spot",
    "robot",
    (
        "Sonar u5 cannot measure below 4.5 in and reads 4.5 there. The program takes that for the gap, "
        "drives too far, and the gripper misses the block."
    ),
    right=("u5 reads 4.5 at any shorter distance: its blind spot",),
    partly=(
        "it drove too far before it closed the gripper",
        "the block was not in the gripper's window",
        "it touched a wall while it approached the block",
    ),
    wrong=("the gripper is faulty", "it did not find the block", "it was lost"),
    device="u5",
    shows="missed it|contact",
    command=COURSE,
    changes=(NOMINAL,),
    cells=(("sensors.csv", "ultra5", "Min Range (in)", "4.5"),),
)
kind(
    "gyro-drifts",
    "robot",
    (
        "The gyro drifts by 3 degrees a second. The program takes the drift for turns, so its believed "
        "heading is wrong."
    ),
    right=("gyro g1 drifts",),
    partly=("its heading was wrong: it was lost", "it never localized or lost its place"),
    wrong=("compass or range sensors are faulty", "drive r1 is faulty", "the program is wrong"),
    device="g1",
    shows="lost|failed|contact",
    changes=SHORT_SEARCH,
    cells=(("sensors.csv", "gyro1", "Drift (per s)", "3"),),
)
kind(
    "encoder-dead",
    "robot",
    (
        "Encoder o3 always reads 0. The program counts half of each drive ahead, so its belief stays "
        "behind the robot."
    ),
    right=("encoder o3 counts nothing",),
    partly=("it was lost: its belief stayed behind the robot", "it underestimates its drives"),
    wrong=("drive d1 is faulty", "encoder o4 is faulty", "range sensors are faulty"),
    device="o3",
    shows="lost|failed|contact",
    changes=SHORT_SEARCH,
    cells=(("sensors.csv", "odom3", "Gain", "0"),),
)
kind(
    "sonar-offset",
    "robot",
    (
        "Sonars are fine but u1 reads 9 in too much. The program trusts it in the corridor and drives on "
        "although the wall is near."
    ),
    right=("u1 reads 9 in too much",),
    partly=("it drove into a wall that u1 showed too far away",),
    wrong=("drive d1 is faulty", "the program did not look", "it was lost"),
    device="u1",
    shows=CONTACT,
    command=("main.py",),
    files=(("main.py", HALL.replace("TURN", "choice.choice((90, -90))")),),
    cells=(*EXACT, ("sensors.csv", "ultra1", "Bias", "9")),
    lines=UNBIASED,
)
kind(
    "sonar-outliers",
    "robot",
    "A third of the readings of u1 are random. One that was far too long let the program drive into a wall.",
    right=("u1 has outliers: the last reading before the contact was far too long",),
    partly=("it drove into a wall", "it trusts a single reading"),
    wrong=("drive d1 is faulty", "u1 is off by a constant", "the program did not look"),
    device="u1",
    shows=CONTACT,
    command=("main.py",),
    files=(("main.py", HALL.replace("TURN", "choice.choice((90, -90))")),),
    cells=(*EXACT, ("sensors.csv", "ultra1", "Outlier", "0.33")),
    lines=UNBIASED,
)
kind(
    "sonar-oblique",
    "robot",
    (
        "Sonar u1 has no echo from walls that it meets at more than 20 degrees. It read Infinity close "
        "to such a wall, and the program drove on."
    ),
    right=("u1 had no echo from an oblique wall (Infinity) although the wall was near",),
    partly=("u1 missed the wall", "it drove into a wall at an angle"),
    wrong=("drive d1 is faulty", "the program did not look"),
    device="u1",
    shows=CONTACT,
    command=("main.py",),
    files=(("main.py", HALL.replace("TURN", "45")),),
    cells=(*EXACT, ("sensors.csv", "ultra1", "Incidence Limit (deg)", "20")),
    lines=UNBIASED,
)
kind(
    "sonar-stuck",
    "robot",
    (
        "Sonar u2 is stuck at 14 in. The program follows the left wall with it, took the wall for far, "
        "and steered into it."
    ),
    right=("u2 always reads 14: it is stuck",),
    partly=("it steered to the left into the wall that it follows", "u2 was wrong before the contact"),
    wrong=("drive d1 or r1 is faulty", "u1 is faulty", "the program did not look"),
    device="u2",
    shows=CONTACT,
    command=("main.py",),
    files=(
        (
            "main.py",
            SONAR_STUCK,
        ),
    ),
    cells=(*EXACT, ("sensors.csv", "ultra2", "Gain", "0"), ("sensors.csv", "ultra2", "Bias", "14")),
    lines=UNBIASED,
)
kind(
    "drive-too-far",
    "robot",
    (
        "Drive d1 goes a quarter further than commanded. The program's list of moves would be right, but "
        "the robot touched a wall."
    ),
    right=("d1 goes 25 % too far",),
    partly=("it touched a wall beyond its target", "it never reads a sensor"),
    wrong=("the list of moves is wrong", "d1 goes too short", "drive r1 is faulty"),
    device="d1",
    shows=CONTACT,
    command=("main.py",),
    files=(("main.py", PLAN),),
    cells=(*EXACT, ("drive.csv", "right", "Gain", "1.25")),
    lines=(*FIXED, *UNBIASED),
)
kind(
    "drive-veers",
    "robot",
    (
        "Drive d1 turns the robot by half a degree to the left with each inch. The list of moves is "
        "right, but the robot leaves its straight line and touched a wall."
    ),
    right=("d1 veers: it turns the robot while it drives",),
    partly=("it touched a wall at the side, off its line", "it never reads a sensor"),
    wrong=("drive r1 is faulty", "the list of moves is wrong"),
    device="d1",
    shows=CONTACT,
    command=("main.py",),
    files=(("main.py", PLAN),),
    cells=(*EXACT, ("drive.csv", "right", "Rotation Bias", "0.5")),
    lines=(*FIXED, *UNBIASED),
)
kind(
    "turn-too-little",
    "robot",
    (
        "Drive r1 turns by only 85 % of the angle. After the first turns the robot drives at an angle to "
        "its corridor, and touched a wall."
    ),
    right=("r1 turns too little (85 %)",),
    partly=("its heading was wrong when it touched the wall", "it never reads a sensor"),
    wrong=("drive d1 is faulty", "the list of moves is wrong"),
    device="r1",
    shows=CONTACT,
    command=("main.py",),
    files=(("main.py", PLAN),),
    cells=(*EXACT, ("drive.csv", "rot", "Gain", "0.85")),
    lines=(*FIXED, *UNBIASED),
)
kind(
    "turns-hardly",
    "robot",
    (
        "Drive r1 hardly turns: 1 % of the angle. The program cannot get to any heading that it needs, "
        "and gets nowhere."
    ),
    right=("r1 turns only 1 % of what is commanded",),
    partly=(
        "it turns again and again and gets nowhere",
        "it never got a good look or heading and gave up",
        "the time limit passed",
        "it drove with a wrong heading, into a wall",
    ),
    wrong=("the gyro or compass is faulty", "the program turns the wrong way"),
    device="r1",
    shows="lost|failed|contact|time",
    cells=(("drive.csv", "rot", "Gain", "0.01"),),
)
kind(
    "gripper-short",
    "robot",
    (
        "The gripper reaches only 0.5 in beyond the robot's front. The program stops at the distance of "
        "a usual gripper, so it closed without the block."
    ),
    right=("the gripper p1 has too short a reach: the block was beyond its window",),
    partly=(
        "the gripper closed and took nothing, with the block in front",
        "it gave up after several misses",
    ),
    wrong=("it did not find the block", "it was lost", "the load sensor is faulty"),
    device="p1",
    shows="missed it",
    cells=(("drive.csv", "grip", "Reach", "0.5"),),
)
kind(
    "load-sensor-inverted",
    "robot",
    (
        "The load sensor is wired the wrong way round: l1 reads 0 with the block and 1 without. The "
        "program had the block, believed in a miss and let it go."
    ),
    right=("load sensor l1 is inverted",),
    partly=("it had the block and opened the gripper again at once", "l1 read 0 while the block was held"),
    wrong=("the gripper missed", "the program's logic is wrong and the sensor is right", "it was lost"),
    device="l1",
    shows="missed it",
    cells=(("sensors.csv", "load1", "Percent Error (0-1)", "1"),),
)

# -- faults of links -----------------------------------------------------------------------------------------

kind(
    "reply-lost",
    "link",
    (
        "One reply was lost between robot and program. The program waited 3 s for it and gave up; the "
        "robot had answered everything."
    ),
    right=("a reply did not reach the program: it waited and ended after a command that was answered",),
    partly=(
        "the program ended by a timeout in the middle of its work",
        "it ended by itself: no reply in time",
    ),
    wrong=("the program was lost", "a device is faulty", "the robot did not answer"),
    shows="1 lose",
    changes=(IMPATIENT,),
    link="lose",
)
kind(
    "late-reply-retry",
    "link",
    (
        "Some replies came late. The program took the command for lost and sent it again, so the robot "
        "did the same drive twice and touched a wall."
    ),
    right=("the same drive was sent and done twice: a retry after a late reply",),
    partly=("it drove twice as far as its path needs", "it touched a wall beyond its target"),
    wrong=("drive d1 is faulty", "the list of moves is wrong"),
    shows="no reply, again",
    command=("main.py",),
    files=(("main.py", RETRY),),
    cells=EXACT,
    lines=(*FIXED, *UNBIASED),
    link="late",
)
kind(
    "commands-doubled",
    "link",
    (
        "The link delivered some moves twice. The robot did them twice, and the program got a reply too "
        "many, which ended it or shifted all later replies."
    ),
    right=(
        "moves arrived twice in a row",
        "there were more replies than the program had asked for",
    ),
    partly=("it moved twice as far as it meant", "it was lost after a doubled move", "it touched a wall"),
    wrong=("a drive is faulty", "a sensor is faulty", "the program's plan is wrong"),
    shows="double",
    changes=(IMPATIENT,),
    link="double",
)
kind(
    "commands-merged",
    "link",
    (
        "The link lost a line end, so two commands arrived as one. It got one reply, and the program "
        "waited for two."
    ),
    right=("two commands arrived merged into one",),
    partly=("the program waited for a reply that never came and ended by a timeout",),
    wrong=("the program has no line ends at all", "a device is faulty", "it was lost"),
    shows="merge",
    command=COURSE,
    changes=(IMPATIENT_COURSE,),
    link="merge",
)
kind(
    "replies-swapped",
    "link",
    (
        "The link swapped the replies to u2 and u3. The program took one range for the other, and so "
        "localized wrongly or never."
    ),
    right=(
        "the program got the ranges of u2 and u3 in the wrong order",
        "the sensors were right, but the program concluded from other numbers",
    ),
    partly=("it localized wrongly or never", "it was lost", "it gave up"),
    wrong=("sensor u2 or u3 is faulty", "drives are faulty"),
    shows="swap",
    command=COURSE,
    link="swap",
)
kind(
    "decimal-point-lost",
    "link",
    (
        "The link lost a decimal point: a drive of a few inches arrived as one of thousands. The robot "
        "drove on until it touched a wall."
    ),
    right=("a drive of thousands of inches arrived, unlike all others: a corrupted command",),
    partly=("it commanded a drive far longer than the free distance",),
    wrong=("drive d1 is faulty", "it was lost", "a sensor is faulty"),
    shows="1 dot",
    link="dot",
)
kind(
    "connection-cut",
    "link",
    "The link closed the connection in the middle of the run. Robot and program were fine until then.",
    right=("the connection ended in the middle of the run, and the program ended because of that",),
    partly=(
        "the program ended in the middle of its work",
        "the program crashed or gave up with a closed connection",
    ),
    wrong=("the program was lost", "a device is faulty", "it gave up by its own decision"),
    shows="1 cut",
    link="cut",
)
kind(
    "moves-swallowed",
    "link",
    (
        "The link swallowed every fifth move and answered for the robot. The program's list was right, "
        "but the robot never got those moves."
    ),
    right=("moves are missing between those that arrived", "the robot did not get all moves of the program"),
    partly=(
        "it touched a wall off its path",
        "it drove ahead where a turn is missing",
        "it never reads a sensor",
    ),
    wrong=("a drive is faulty", "moves were refused"),
    shows="swallow",
    command=("main.py",),
    files=(("main.py", PLAN),),
    cells=EXACT,
    lines=(*FIXED, *UNBIASED),
    link="swallow",
)
kind(
    "byte-lost",
    "link",
    (
        "The link lost one byte of a reply. The program waited 3 s for the eighth byte and ended; the robot "
        "had answered everything."
    ),
    right=(
        "a part of a reply did not reach the program: it waited and ended after a command that was answered",
        "the program ended with 7 of 8 bytes of a reply",
    ),
    partly=(
        "the program ended by a timeout in the middle of its work",
        "it ended by itself: no reply in time",
    ),
    wrong=("a sensor is faulty", "the program's byte order is wrong from the beginning"),
    shows="1 byte",
    changes=(IMPATIENT,),
    link="byte",
)
kind(
    "slow-link",
    "link",
    (
        "Each message takes 0.4 s each way. The program makes several hundred commands, so the link "
        "alone used up the time limit."
    ),
    right=("most of the time went into the link: 0.8 s for each command",),
    partly=("the time limit passed", "it was too slow"),
    wrong=("the program reads too often for a usual link", "a sensor is slow", "it was lost"),
    shows="time",
    options=("--link-latency", "0.4"),
)
kind(
    "local-echo",
    "link",
    (
        "The bridge echoes every command to the program. The program found more bytes than the reply that it "
        "had asked for, and ended after its first commands."
    ),
    right=(
        "the program got other bytes than the replies that were sent: an echo of its commands",
        "more bytes came back to the program than it had asked for, from the first command on",
    ),
    partly=(
        "the program ended at its beginning",
        "it gave up because of a reply that it did not understand",
    ),
    wrong=("a sensor is faulty", "it gave up for lack of a search"),
    shows="echo",
    changes=(IMPATIENT,),
    link="echo",
)

# -- people --------------------------------------------------------------------------------------------------

kind(
    "port-taken",
    "people",
    (
        "Another program, left running by a neighbour, had the port first and uses the robot. The "
        "team's program was turned away."
    ),
    right=("the program was turned away: another one was connected already",),
    partly=("the program could not connect or got no reply", "the mission's program sent no command"),
    wrong=("the program crashed by its own mistake", "the link was cut", "it did not find the port"),
    shows="neighbour connected",
    person="neighbour",
)
kind(
    "classmate-drives",
    "people",
    (
        "A classmate's program sends moves to the same robot over the packet port. The robot turned "
        "without a command of the team's program, which was lost by that."
    ),
    right=("another client moved the robot: some moves are not the program's",),
    partly=("the robot was not where the program believed", "it was lost in the middle of the run"),
    wrong=("a drive is faulty", "a sensor is faulty", "the program's plan is wrong"),
    shows="classmate sent",
    options=("--listeners", "binary,packets", "--packet-reply-port", "0", *PACE),
    person="classmate",
)
kind(
    "ctrl-c",
    "people",
    (
        "A person ended the run with Ctrl-C while the program was still at work. Nothing had gone wrong "
        "until then."
    ),
    right=("a person ended the run (Ctrl-C) while everything went well",),
    partly=("the run ended early, before the mission was over",),
    wrong=("the program crashed", "it gave up", "it was lost", "a device is faulty"),
    shows="pressed Ctrl-C",
    options=PACE,
    person="stopper",
)
kind(
    "program-killed",
    "people",
    "Somebody killed the program with a signal in the middle of its work. Nothing had gone wrong until then.",
    right=("the program was ended by a signal from outside (SIGKILL)",),
    partly=("the program ended in the middle of its work",),
    wrong=("it crashed by its own mistake", "it gave up", "it was lost"),
    shows="killed",
    options=PACE,
    person="killer",
)
kind(
    "wall-added",
    "people",
    (
        "Somebody put a wall into the maze (second row, fifth cell), which the team's map does not have. "
        "The program's way leads through it."
    ),
    right=("the maze has a wall (second row, fifth cell) that the program's map does not have",),
    partly=(
        "it drove at a wall that it did not expect",
        "its readings did not fit the map, and it was lost",
        "it gave up or never localized",
    ),
    wrong=("a sensor is faulty", "a drive is faulty"),
    shows="lost|failed|contact",
    lines=(("maze.csv", "3,3,0,1,1,1,1,1", "3,3,0,1,0,1,1,1"),),
)
kind(
    "block-misplaced",
    "people",
    (
        "Somebody put the block into the corridor at (54, 30), outside of the loading zone. The program "
        "searches the loading zone only, where no block is."
    ),
    right=("the block was not in the loading zone",),
    partly=(
        "it searched the loading zone and never found the block",
        "it gave up without the block",
        "the time limit passed",
    ),
    wrong=("u5 is faulty", "it was lost", "the program does not search"),
    shows="failed",
    changes=SHORT_SEARCH,
    lines=(("mission.toml", '\nblock = "any"', "\nblock = [54.0, 30.0]"),),
)


# -- the runs ------------------------------------------------------------------------------------------------


class StaleTableError(Exception):
    """A sample or set no longer has the text that a kind changes."""


def changed(text: str, old: str, new: str, where: str) -> str:
    """The text with its only `old` replaced.

    Raises StaleTableError.
    """
    if text.count(old) != 1:
        raise StaleTableError(f"{where} has {old!r} {text.count(old)} times, not once: change its kind")
    return text.replace(old, new)


def with_cell(text: str, row: str, column: str, value: str) -> str:
    """The text of a CSV file with one value, in a new column if it has none of that name."""
    lines = [line.split(",") for line in text.splitlines() if not line.startswith("#")]
    if column not in lines[0]:
        lines = [[*line, column if number == 0 else ""] for number, line in enumerate(lines)]
    at = lines[0].index(column)
    for line in lines:
        if line[0] == row:
            line[at] = value
    return "".join(",".join(line) + "\n" for line in lines)


def prepare(each: Kind, samples: Path, usual_set: Path, folder: Path) -> None:
    """Write the programs and, if it differs, the set of a kind."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(samples, folder)
    has_set = each.cells or each.lines or any(name.startswith("set/") for name, _ in each.files)
    if has_set:
        shutil.copytree(usual_set, folder / "set")
    for name, text in (*each.files, ("bridge.py", PROXY)):
        (folder / name).write_text(text)
    for name, old, new in each.changes:
        path = folder / name
        path.write_text(changed(path.read_text(), old, new, name))
    for name, row, column, value in each.cells:
        path = folder / "set" / name
        path.write_text(with_cell(path.read_text(), row, column, value))
    for name, old, new in each.lines:
        path = folder / "set" / name
        path.write_text(changed(path.read_text(), old, new, name))


def free_port() -> int:
    """A port that nobody listens on now."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port: int = server.getsockname()[1]
        return port


def run(each: Kind, seed: int, folder: Path, log: Path) -> str:
    """Make one run; returns the output of simulator, program, proxy and person, without the verdict."""
    counts = folder / f"bridge-{seed}.txt"
    program = [part.format(seed=seed) for part in each.command]
    bridge = ["bridge.py", each.link, str(seed), str(counts)] if each.link else []
    command = shlex.join([sys.executable, *bridge, *program])
    port = free_port() if each.person == "neighbour" else 0
    packets = free_port() if each.person == "classmate" else 0
    arguments = ["--no-ui", "--quiet", "--mission", "--seed", str(seed), "--log", str(log), "--run", command]
    arguments += ["--port", str(port), "--reply-port", "0", "--belief-port", "0", *each.options]
    if packets:
        arguments += ["--packet-port", str(packets)]
    if (folder / "set").exists():
        arguments += ["--config", "set"]
    log.unlink(missing_ok=True)
    output = folder / f"output-{seed}.txt"
    said: list[str] = []
    with output.open("w") as out:
        simulator = subprocess.Popen(
            ["nice", sys.executable, "-m", "simmer_tui", *arguments],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        present = (each.person, simulator, port or packets, output, said)
        person = threading.Thread(target=interfere, args=present)
        person.start()
        try:
            simulator.wait(each.patience)
        except subprocess.TimeoutExpired:
            said.append("pressed Ctrl-C")
            simulator.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                simulator.wait(20.0)
        if simulator.poll() is None:
            os.killpg(simulator.pid, signal.SIGKILL)
            said.append("hung")
            simulator.wait()
        person.join()
    lines = output.read_text().partition("\nverdict:")[0].splitlines()
    text = "\n".join([*lines, *said, counts.read_text() if counts.exists() else "", reason(log)])
    output.write_text(text)
    return text


def reason(log: Path) -> str:
    """The reason for which the mission failed: empty if it did not."""
    if not log.exists():
        return ""
    entries = [json.loads(line) for line in log.read_text().splitlines() if '"mission"' in line]
    return next((f"mission failed: {each['reason']}" for each in entries if "reason" in each), "")


def interfere(
    what: str, simulator: subprocess.Popen[bytes], port: int, output: Path, said: list[str]
) -> None:
    """Do what a person does during a run, until it ends.

    Some wait until the program has localized, which its output says.
    """
    link: socket.socket | None = None
    while what and simulator.poll() is None:
        localized = "looking for the block" in output.read_text()
        try:
            if what == "neighbour":
                if link is None:
                    link = socket.create_connection(("127.0.0.1", port), timeout=5.0)
                    said.append("neighbour connected")
                link.sendall(b"u1\n")
                link.recv(8)
            elif what == "classmate" and localized:
                with socket.create_connection(("127.0.0.1", port), timeout=5.0) as sender:
                    sender.sendall(b"[r1:35]")
                said.append("classmate sent a turn")
                time.sleep(0.4)
            elif what in ("killer", "stopper") and localized:
                time.sleep(1.0)
                if what == "stopper":
                    said.append("pressed Ctrl-C")
                    simulator.send_signal(signal.SIGINT)
                else:
                    said += [f"killed {child}" for child in programs(simulator.pid) if kill(child)]
                return
        except OSError:
            pass
        time.sleep(0.01 if link is None else 0.3)
    if link is not None:
        link.close()


def programs(simulator: int) -> list[int]:
    """The process ids of the simulator's children that run the team's program (Linux)."""
    children = Path(f"/proc/{simulator}/task/{simulator}/children").read_text().split()
    return [int(child) for child in children if b"solve.py" in Path(f"/proc/{child}/cmdline").read_bytes()]


def kill(process: int) -> bool:
    """Kill a process that this run has started."""
    os.kill(process, signal.SIGKILL)
    return True


def outcome(each: Kind, log: Path, text: str) -> str:
    """`failed`, or why the run is left out."""
    if not log.exists():
        return "no log"
    if re.search(r'"kind": ?"mission".*"result": ?"success"', log.read_text()):
        return "succeeded"
    return "failed" if re.search(each.shows, text) else "failed in another way"


def one(each: Kind, seed: int, out: Path) -> tuple[Kind, int, str, float]:
    """A run of a kind, its log kept if it failed as meant."""
    log = (out / f"{each.name}-{seed}.jsonl").resolve()
    began = time.monotonic()
    result = outcome(each, log, run(each, seed, out / "work" / each.name, log))
    if result != "failed":
        log.unlink(missing_ok=True)
    return each, seed, result, time.monotonic() - began


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the runs and write the answers; returns 0 if each kind has a failed run."""
    parser = argparse.ArgumentParser(description="Make failed runs with known causes.")
    parser.add_argument("--seeds", type=int, default=2, help="runs of each kind (default: 2)")
    parser.add_argument("--first-seed", type=int, default=2101, help="seed of the first run (default: 2101)")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FOLDER", help="folder for logs and answers"
    )
    parser.add_argument("--only", action="append", metavar="KIND", help="this kind only; may be repeated")
    options = parser.parse_args(arguments)
    kinds = [each for each in KINDS if not options.only or each.name in options.only]
    if not kinds:
        parser.error(f"no kind is named {options.only}; there are {', '.join(each.name for each in KINDS)}")
    out: Path = options.out.resolve()
    samples, usual_set = out / "work" / "samples", out / "work" / "usual-set"
    for path, order in (
        (samples, ["examples", str(samples)]),
        (usual_set, ["init", str(usual_set), "--mission"]),
    ):
        shutil.rmtree(path, ignore_errors=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        subprocess.run([sys.executable, "-m", "simmer_tui", *order], check=True, stdout=subprocess.DEVNULL)
    for each in kinds:
        prepare(each, samples, usual_set, out / "work" / each.name)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    rows, results, failed = [], Counter[str](), set()
    with ThreadPoolExecutor(AT_ONCE) as pool:
        jobs = [pool.submit(one, each, seed, out) for each in kinds for seed in seeds]
        for job in jobs:
            each, seed, result, took = job.result()
            print(f"{each.name}-{seed}: {result} ({took:.1f} s)", flush=True)
            results[result] += 1
            if result != "failed":
                continue
            failed.add(each.name)
            rows.append(
                {
                    "kind": each.name,
                    "group": each.group,
                    "seed": seed,
                    "log": f"{each.name}-{seed}.jsonl",
                    "answer": each.answer,
                    "right": each.right,
                    "partly": each.partly,
                    "wrong": each.wrong,
                    "device": each.device or None,
                    "failed": True,
                }
            )
    (out / "answers.json").write_text(json.dumps(rows, indent=1) + "\n")
    counted = ", ".join(f"{number} {what}" for what, number in results.items())
    print(f"{len(kinds)} kinds, {len(kinds) * len(seeds)} runs: {counted}")
    return 0 if len(failed) == len(kinds) else 1


if __name__ == "__main__":
    sys.exit(main())
