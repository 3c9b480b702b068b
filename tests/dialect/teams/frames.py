"""Frames: binary messages, type, size, content and $, with a keep-alive; wanders by scans.

python frames.py [SECONDS [FILE]]     FILE: every exchange, one a line
"""

import re
import struct
import sys
import time

import serial

SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 300.0
NOTES = open(sys.argv[2], "w") if len(sys.argv) > 2 else None
PING, RANGES, MOVE, TURN, RUN, SCAN, NAMED = range(7)
ACK, ENDED = 130, 131

ser = serial.Serial(port="COM5", baudrate=57600, timeout=0.5, write_timeout=1)
start = time.time()
exchanges = wrong = again = 0
last_sent = 0.0


def send(kind, content=b""):
    global last_sent
    ser.write(bytes([kind, len(content)]) + content + b"$")
    last_sent = time.time()
    if NOTES:
        print(f"{last_sent - start:.4f}\t{bytes([kind]) + content!r}\tb''", file=NOTES)


def receive(seconds):
    """Type and content of the next frame, or None after so long; keeps the robot alive meanwhile."""
    global wrong
    until = time.time() + seconds
    while time.time() < until:
        if time.time() - last_sent > 0.4:
            send(PING)
        kind = ser.read(1)
        if not kind:
            continue
        head = kind + ser.read(1)
        if len(head) < 2:
            wrong += 1
            print("half a header:", head)
            continue
        rest = ser.read(head[1] + 1)
        if NOTES:
            print(f"{time.time() - start:.4f}\t''\t{head + rest!r}", file=NOTES)
        if len(rest) != head[1] + 1 or rest[-1:] != b"$":
            wrong += 1
            print("not a frame:", head + rest)
            ser.reset_input_buffer()
            continue
        return head[0], rest[:-1]
    return None


def ask(kind, content, answer, size):
    """Content of the answer of that type; asks up to three times."""
    global exchanges, wrong, again
    for _ in range(3):
        ser.reset_input_buffer()
        send(kind, content)
        got = receive(1.0)
        exchanges += 1
        if got and got[0] == answer and (size is None or len(got[1]) == size):
            return got[1]
        wrong += 1
        print("wrong answer to", kind, ":", got)
        again += 1
    sys.exit("the robot does not answer")


def do(kind, content, sentence):
    """A movement: acknowledged at once, told when it has ended."""
    global wrong
    if ask(kind, content, ACK, 2) != b"ok":
        wrong += 1
        print("not taken:", kind, content)
        return ""
    got = receive(10)
    if not got or got[0] != ENDED or not re.fullmatch(sentence, got[1].decode()):
        wrong += 1
        print("no end of", kind, ":", got)
        return ""
    return got[1].decode()


def scan():
    """Distances from the centre, in, at bearings of 0, 10, .. 350 degrees."""
    global exchanges, wrong
    ser.reset_input_buffer()
    send(SCAN)
    exchanges += 1
    distances = []
    for k in range(36):
        got = receive(1.0)
        if not got or got[0] != 133 or len(got[1]) != 6 or struct.unpack("<hf", got[1])[0] != 10 * k:
            wrong += 1
            print("wrong frame", k, "of the scan:", got)
            return scan()
        distances.append(struct.unpack("<hf", got[1])[1])
    return distances


loops = 0
while time.time() - start < SECONDS:
    loops += 1
    ahead, left, right = struct.unpack("<fff", ask(RANGES, b"", 129, 12))
    around = scan()
    clear = min(around[35], around[0], around[1], around[2] + 1, around[34] + 1)
    if clear > 8:
        mm = int(min(clear - 5, 12) * 25.4)
        told = do(MOVE, struct.pack("<hh", mm, 0), rf"moved {mm} mm, contact [01]")
        if told.endswith("1"):
            do(MOVE, struct.pack("<hh", -50, 0), r"moved -50 mm, contact [01]")
    else:
        goal = max(
            range(36), key=lambda k: min(around[k], around[k - 1], around[(k + 1) % 36]) - (k in (17, 18, 19))
        )
        angle = goal * 10 if goal <= 18 else goal * 10 - 360
        do(TURN, struct.pack("<h", angle * 10), r"turned, contact [01]")
    if loops % 5 == 0:
        text = ask(NAMED, b"2", 134, None).decode()
        if not re.fullmatch(r"u3: (\d+\.\d\d|inf) in", text):
            wrong += 1
            print("wrong text:", text)
    if loops % 7 == 0:
        ask(MOVE, struct.pack("<hh", 10, 10), ACK, 2)  # it cannot drive sideways: no
        if around[18] > 8:
            ask(RUN, b"\xff", ACK, 2)
            receive(0.3)
            ask(RUN, b"\x00", ACK, 2)
ask(RUN, b"\x00", ACK, 2)
print(f"{exchanges} exchanges, {wrong} wrong, {again} again, {time.time() - start:.1f} s")
sys.exit(1 if wrong else 0)
