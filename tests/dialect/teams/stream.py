"""A stream: drives by a range finder that sends all the time, in a loop at 240 Hz.

python stream.py [SECONDS [FILE]]     FILE: every line and letter
"""

import re
import sys
import time

import serial

SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 300.0
NOTES = open(sys.argv[2], "w") if len(sys.argv) > 2 else None
LINE = re.compile(r"(\d+),(\d+\.\d)\r\n")
RADIUS_CM = 7.6

ser = serial.Serial("COM10", 115200, timeout=0.05)
ser.reset_input_buffer()
start = time.time()
lines = wrong = skipped = letters = 0
scan = {}
last = None
state = "x"
sent_at = 0.0


def note(sent, got):
    if NOTES:
        print(f"{time.time() - start:.4f}\t{sent!r}\t{got!r}", file=NOTES)


def put(letter):
    """The letter, if it is another one or half a second old."""
    global state, sent_at, letters
    if letter != state or time.time() - sent_at > 0.5:
        ser.write(letter.encode())
        note(letter, b"")
        state = letter
        sent_at = time.time()
        letters += 1


def take(line):
    """One line of the stream into the scan."""
    global last, wrong, skipped
    note("", line)
    found = LINE.fullmatch(line.decode("ascii", "replace"))
    if not found or not 0 <= int(found[1]) < 360 or int(found[1]) % 6:
        wrong += 1
        print("not a line of the stream:", line)
        return
    angle = int(found[1])
    if last is not None:
        skipped += ((angle - last) // 6 - 1) % 60
    last = angle
    scan[angle] = float(found[2]) or 400.0


def nearest(first, last_angle):
    return min(scan.get(angle % 360, 400.0) for angle in range(first, last_angle + 1, 6))


turning = "q"
while time.time() - start < SECONDS:
    while ser.in_waiting:
        take(ser.readline())
        lines += 1
    if len(scan) == 60:
        ahead = nearest(-18, 18)
        if state in "qe" and ahead < RADIUS_CM + 22:
            put(state)
        elif ahead < RADIUS_CM + 8:
            turning = "q" if scan[90] > scan[270] else "e"
            put(turning)
        elif nearest(60, 120) < RADIUS_CM + 3:
            put("d")
        elif nearest(240, 300) < RADIUS_CM + 3:
            put("a")
        else:
            put("w")
    time.sleep(1 / 240)
ser.write(b"x")
note("x", b"")
print(f"{lines} lines, {wrong} wrong, {skipped} skipped, {letters} letters, {time.time() - start:.1f} s")
sys.exit(1 if wrong else 0)
