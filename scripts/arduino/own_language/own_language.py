"""Wanders by a robot's own language. The same program drives the robot and the simulated one.

python own_language.py /dev/ttyACM0                                  the robot with own_language.ino
simmer-tui --config our-robot --run "python own_language.py"         the simulator with dialect.toml
"""

import sys
import time

import serial

STEPS = 6
NEAR = 30.0  # cm


class Robot:
    """The robot on a serial port."""

    def __init__(self, port):
        self.port = serial.Serial(port, 9600, timeout=20)
        time.sleep(2)  # most boards restart when their port is opened

    def ask(self, message):
        """Send a message; returns the line that answers it."""
        self.port.reset_input_buffer()
        self.port.write(message.encode() + b"\n")
        return self.port.readline().decode().strip()

    def look(self):
        """Distances ahead and ahead to the left, cm; a missing echo is far away."""
        numbers = [float(part) for part in self.ask("get").split(",")]
        return [1000.0 if number < 0 else number for number in numbers]


def main():
    robot = Robot(sys.argv[1] if len(sys.argv) > 1 else "COM6")
    for step in range(STEPS):
        ahead, left = robot.look()
        message = "f 10" if min(ahead, left) > NEAR else "t 90" if left > ahead else "t -90"
        answer = robot.ask(message)
        print(f"{step + 1}: {ahead:.1f} cm ahead, {left:.1f} to the left; {message}: {answer}")
        if answer != "ok":
            sys.exit("the robot did not do it")


if __name__ == "__main__":
    main()
