"""Sends the line follower 30 inches along its line, and prints what it answers."""

import serial

with serial.Serial("COM6", 9600, timeout=20) as robot:
    robot.write(b"g 30\n")
    while line := robot.readline().decode().strip():
        print(line)
        if line.startswith("done"):
            break
