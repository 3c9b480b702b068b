"""Brackets: wanders with the clearest side as its front, and answers are read byte by byte.

python brackets.py [SECONDS [FILE]]     FILE: every exchange, one a line
"""

import re
import sys
import time

import serial

SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 300.0
NOTES = open(sys.argv[2], "w") if len(sys.argv) > 2 else None
MM_IN = 25.4
ANSWERS = {  # what follows each verb
    "p": re.compile(r"\[(\d+),(\d+),(\d+),(\d+),([0-3])\]"),
    "v": re.compile(r"\[(\d+),(\d+)\]"),
    "n": re.compile(r"\[([01])\]"),
    "c": re.compile(r"\[(\d+\.\d\d),(\d+\.\d\d),(\d+\.\d\d),(\d+\.\d\d)\]"),
}
DONE = re.compile(r"\[(\+)\]")

ser = serial.Serial("COM8", 115200, timeout=3)
start = time.time()
exchanges = wrong = again = 0


def note(sent, got):
    if NOTES:
        print(f"{time.time() - start:.4f}\t{sent!r}\t{got!r}", file=NOTES)


def read_answer():
    """Byte by byte up to ], for 3 s at most."""
    ser.timeout = 0.1
    answer = b""
    began = time.time()
    while time.time() - began < 3:
        byte = ser.read(1)
        answer += byte
        if byte == b"]":
            break
    ser.timeout = 3
    return answer


def ask(text):
    """Send [text] until it is answered; numbers of the answer."""
    global exchanges, wrong, again
    while True:
        if ser.in_waiting:
            note("", ser.read(ser.in_waiting))
        ser.write(f"[{text}]\n".encode())
        sent = time.time()
        answer = read_answer()  # perhaps after the end of the last answer's line
        exchanges += 1
        note(text, answer)
        found = ANSWERS.get(text[0], DONE).fullmatch(answer.decode("ascii", "replace").strip())
        if found:
            return found.groups()
        wrong += 1
        print("wrong answer to", text, ":", answer)
        if not answer:
            again += 1
            time.sleep(max(0, 6 - (time.time() - sent)))


def readings(count=5):
    return [int(value) for value in ask(f"p{count}" if count != 5 else "p")]


ask("c")
ask("r0")
front = 0
turns = 0
ask("l090")
while time.time() - start < SECONDS:
    *around, said = readings()
    if said != front:
        wrong += 1
        print("front is", said, "not", front)
    ahead, right, behind, left = (around[(front + side) % 4] for side in range(4))
    if ahead > 200:
        ask(f"f{min(900, int((ahead - 120) / MM_IN / 6 * 1000))}")
        time.sleep(0.4)
        # a look on the way; the rest of the movement is cut where it gets close
        nearer = readings(2)[front]
        if nearer < 90:
            ask("h")
        time.sleep(0.5)
    elif max(right, left) > 200:
        front = (front + (1 if right >= left else 3)) % 4
        ask(f"r{front}")
        turns += 1
    elif behind > 150:
        front = (front + 2) % 4
        ask(f"r{front}")
    else:
        ask("q200" if turns % 2 else "e200")
        time.sleep(0.3)
    if right < 50 < left:
        ask("a150")
        time.sleep(0.2)
    elif left < 50 < right:
        ask("d150")
        time.sleep(0.2)
    if turns % 7 == 3:
        top, low = ask("v")
        ask("l190" if int(low) < int(top) - 60 else "l110")
        ask("n")
        ask("k")
        time.sleep(0.35)
        ask("i300")
        time.sleep(0.35)
        ask("m0120")
        turns += 1
ask("h")
print(f"{exchanges} exchanges, {wrong} wrong, {again} again, {time.time() - start:.1f} s")
sys.exit(1 if wrong else 0)
