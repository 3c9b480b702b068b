"""Sends the line follower 20 inches along its line, and prints what it answers."""

import serial

with serial.Serial("COM6", 9600, timeout=20) as robot:
    robot.write(b"g 20\n")
    while line := robot.readline().decode().strip():
        print(line)
        if line.startswith("done"):
            break
