"""Letters: follows the wall on its right, by single letters and fixed times.

python letters.py [SECONDS [FILE]]     FILE: every exchange, one a line
"""

import re
import sys
import time

import serial

SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 300.0
NOTES = open(sys.argv[2], "w") if len(sys.argv) > 2 else None
RANGES = re.compile(r"(\d+\.?\d*),(\d+\.?\d*),(\d+\.?\d*),(\d+\.?\d*),(\d+\.?\d*),\.\r\n")
ANGLE = re.compile(r"(\d+\.\d\d),\.\r\n")

ser = serial.Serial("COM3", 9600, timeout=1)
start = time.time()
exchanges = wrong = again = 0


def note(letter, got=b""):
    if NOTES:
        print(f"{time.time() - start:.4f}\t{letter!r}\t{got!r}", file=NOTES)


def ask(letter, form):
    """Numbers of the sensor board's line; asks again after a second of silence."""
    global exchanges, wrong, again
    while True:
        ser.write(letter.encode())
        time.sleep(0.001)
        line = ser.readline()
        note(letter, line)
        exchanges += 1
        found = form.fullmatch(line.decode("ascii", "replace"))
        if found:
            return [float(value) for value in found.groups()]
        wrong += 1
        print("wrong answer to", letter, ":", line)
        again += not line


def look():
    back, left, front, right, block = (value or 300.0 for value in ask("u", RANGES))
    return back, left, front, right, block


def drive(letters, seconds):
    """All letters at once; the drive board takes them one after the other, without a word."""
    ser.write(letters.encode())
    note(letters)
    time.sleep(seconds)


def turn(angle):
    """By the gyro, clockwise, to 4 degrees."""
    goal = (ask("g", ANGLE)[0] + angle) % 360
    for _ in range(20):
        rest = (goal - ask("g", ANGLE)[0] + 180) % 360 - 180
        if abs(rest) < 8:
            return
        if abs(rest) > 70:
            drive("R" if rest > 0 else "L", 1.2)
        else:
            drive("r" if rest > 0 else "l", 0.2)


drive("iid", 0.2)  # the left motor is slower
drive("P", 1.2)
while time.time() - start < SECONDS:
    back, left, front, right, block = look()
    if front < 12:
        drive("B", 0.4)
        turn(-90 if left > right else 90)
    elif right > 35:
        drive("FF", 0.3)  # two at once: a look on the way, the second waits
        look()
        drive("", 0.9)
        turn(90)
        drive("FFFF", 2.5)
    elif right < 6:
        drive("l", 0.2)
        drive("F", 0.7)
        drive("r", 0.2)
    elif front > 40:
        drive("FFFS", 1.8)
    else:
        drive("ff", 0.4)
drive("D", 1.2)
drive("S", 0.1)
print(f"{exchanges} exchanges, {wrong} wrong, {again} again, {time.time() - start:.1f} s")
sys.exit(1 if wrong else 0)
