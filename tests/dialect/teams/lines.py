"""Lines: localizes by the walls around each cell, then goes on from cell to cell.

python lines.py [SECONDS [FILE]]     FILE: every exchange, one a line
"""

import re
import sys
import time

import serial

SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 300.0
NOTES = open(sys.argv[2], "w") if len(sys.argv) > 2 else None
MAZE = ["33110202", "33011111", "10200101", "11111102"]  # the top row first
CM_CELL = 30.48
LINE = re.compile(
    r"u1: (-?\d+\.\d\d)u2: (-?\d+\.\d\d)u3: (-?\d+\.\d\d)u4: (-?\d+\.\d\d)u0: (-?\d+\.\d\d)i0: ([01])\r\n"
)
STEPS = {0: (0, 1), 1: (-1, 0), 2: (0, -1), 3: (1, 0)}  # heading: row, column; counter-clockwise

ser = serial.Serial("COM6", 9600, timeout=0.1)
time.sleep(2)
start = time.time()
exchanges = wrong = 0


def note(sent, got):
    if NOTES:
        print(f"{time.time() - start:.4f}\t{sent!r}\t{got!r}", file=NOTES)


def send(text):
    ser.write((text + "\n").encode())
    note(text, b"")


def get_data():
    """The six readings, cm: ahead, left, behind, right, ahead near the floor, and the line."""
    global exchanges, wrong
    while True:
        ser.write(b"getData\n")
        line = b""
        while not line:
            line = ser.readline()
        note("getData", line)
        exchanges += 1
        found = LINE.fullmatch(line.decode("ascii", "replace"))
        if found:
            return [float(value) for value in found.groups()]
        wrong += 1
        print("not a line of readings:", line)


def free(row, column):
    return 0 <= row < 4 and 0 <= column < 8 and MAZE[row][column] != "0"


def cells_free(row, column, heading):
    """Free cells ahead of this one, up to two."""
    down, right = STEPS[heading]
    return 0 if not free(row + down, column + right) else 1 + free(row + 2 * down, column + 2 * right)


belief = {(r, c, h): 1.0 for r in range(4) for c in range(8) for h in range(4) if free(r, c)}


def look(data):
    """Weigh each place by the walls that the four sensors see."""
    for place in belief:
        for side in range(4):
            distance = data[side]
            if distance < 0:
                continue
            expected = min(cells_free(place[0], place[1], (place[2] + side) % 4), 2)
            seen = min(max(round((distance - 8.0) / CM_CELL), 0), 2)
            belief[place] *= 0.8 if seen == expected else 0.1
    total = sum(belief.values())
    for place in belief:
        belief[place] /= total


def moved(turn, ahead):
    global belief
    after = dict.fromkeys(belief, 1e-4)
    for (row, column, heading), share in belief.items():
        heading = (heading + turn) % 4
        down, right = STEPS[heading]
        new = (row + down, column + right, heading) if ahead else (row, column, heading)
        after[new if new in after else (row, column, heading)] += share
    belief = after


def turn_to(quarter):
    send("l 90" if quarter > 0 else "r 90")
    time.sleep(1)
    moved(quarter, False)


lit = stuck = False
cells = 0
send("hello robot")  # the sketch ignores it
send("s 90")
time.sleep(0.5)
while time.time() - start < SECONDS:
    data = get_data()
    ahead, left, behind, right, low, _ = data
    look(data)
    best = max(belief, key=belief.get)
    if belief[best] > 0.7 and not lit:
        send("light")
        lit = True
        print(f"at {best} after {time.time() - start:.1f} s")
    if 0 <= left < 6:
        send("e")
        time.sleep(3)
    elif 0 <= right < 6:
        send("q")
        time.sleep(3)
    elif stuck:
        send("b 4")
        time.sleep(2)
        turn_to(1 if cells % 2 else -1)
        stuck = False
    elif ahead > 25 or (ahead < 0 and low > 25):
        send("w 13")
        time.sleep(5)
        moved(0, True)
        cells += 1
        before, ahead = ahead, get_data()[0]
        stuck = before > 0 and ahead > before - 15
    elif 0 <= ahead < 5:
        send("b 3")
        time.sleep(2)
    elif left > 25 and (right <= left or right < 0):
        turn_to(1)
    elif right > 25:
        turn_to(-1)
    else:
        turn_to(1)
        send("x")
send("x")
send("s 0")
print(f"{exchanges} exchanges, {wrong} wrong, {cells} cells, {time.time() - start:.1f} s")
sys.exit(1 if wrong else 0)
