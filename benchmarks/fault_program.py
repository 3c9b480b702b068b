"""A program with a fault of its own: runs a script that drives a robot, and adds the fault.

    python benchmarks/fault_program.py '{"crash": "KeyError", "after": 120}' scripts/solve.py

`after` counts the calls of `Robot.read`, `drive` and `send` before the fault:

- `crash`: the exception of this name is raised;
- `exit`: the program ends with this code, without a word;
- `signal`: it ends itself by this signal;
- `loop`: it does nothing else any more: "turn" on the spot, "to and fro", "read" a sensor, "square",
  "refused": a drive that the robot has not;
- `skip`: this command, such as "p1-0", is never sent;
- `send`: these commands are sent once, and the script continues as if they had not been;
- `when`: the calls are counted from this command on;
- `twice`: one drive in so many is sent again, and both are done;
- `sleep`: it waits for so many simulated seconds after each drive;
- `comma`: drives have a decimal comma, and a refusal is not noticed;
- `readings`: one of READINGS below changes the readings, of `codes` or of all sensors;
- `crash_at_end`: the exception is raised when the script has done all it does.
"""

from __future__ import annotations

import builtins
import contextlib
import json
import os
import runpy
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from simmer_tui.client import CommandRefusedError, Robot


def turn(robot: Robot) -> None:
    """A turn on the spot, and a look."""
    robot.drive("r1", 15)
    robot.read("u1")


def look(robot: Robot) -> None:
    """A look, and nothing else."""
    robot.read("u1")


def square(robot: Robot) -> None:
    """One corner of a small square, without a goal."""
    robot.read("u1", "u3")
    robot.drive("d1", 0.5)
    robot.drive("r1", 90)


def ask_in_vain(robot: Robot) -> None:
    """A look, and a drive that is refused: the robot has none with this code."""
    robot.read("u1")
    with contextlib.suppress(CommandRefusedError):
        robot.send("q9-5")


STEPS = {"turn": turn, "read": look, "square": square, "refused": ask_in_vain}
"""Loops that do the same from the beginning on, by name."""


def swinging(robot: Robot) -> Callable[[Robot], None]:
    """Going to and fro, the way that has most room."""
    ways = (("u1", "d1", 2.0), ("u3", "d1", -2.0), ("u2", "w1", 2.0), ("u4", "w1", -2.0))
    code, way = max((robot.read(sensor), (code, value)) for sensor, code, value in ways)[1]

    def swing(robot: Robot) -> None:
        robot.drive(code, way)
        robot.read("u1")
        robot.drive(code, -way)
        robot.read("u1")

    return swing


class Readings:
    """Readings so far, for faults that depend on the readings or the movements before."""

    def __init__(self, name: str, codes: Sequence[str]) -> None:
        self._change, self._codes = READINGS[name], codes
        self.last: dict[str, float] = {}
        """The true reading before, by code, and that of any sensor by an empty code."""
        self.given: dict[str, float] = {}
        self.since_turn: Counter[str] = Counter()
        """Readings of each sensor since the last turn."""

    def changed(self, code: str, reading: float) -> float:
        """The reading that the program gets for a true one."""
        applies = not self._codes or code in self._codes
        given = self._change(code, reading, self) if applies else reading
        self.last[code] = self.last[""] = reading
        self.given[code] = given
        self.since_turn[code] += 1
        return given


def one_way(code: str, reading: float, so_far: Readings) -> float:
    """A counter that counts a third of what goes back."""
    step = reading - so_far.last.get(code, reading)
    return so_far.given.get(code, reading) + (step if step > 0.0 else step / 3)


READINGS: dict[str, Callable[[str, float, Readings], float]] = {
    "one behind": lambda code, reading, so_far: so_far.last.get("", 0.0),
    "byte": lambda code, reading, so_far: reading % 256.0,
    "old after turns": lambda code, reading, so_far: (
        reading if so_far.since_turn[code] else so_far.last.get(code, reading)
    ),
    "loose after turns": lambda code, reading, so_far: reading if so_far.since_turn[code] > 1 else 1.0,
    "mean": lambda code, reading, so_far: (
        (reading + so_far.last.get("u3" if code == "u1" else "u1", reading)) / 2
    ),
    "one way": one_way,
}
"""Changes of a reading, by name, from its code and the readings before."""


class Interference:
    """Fault that happens at the calls of a robot's methods."""

    def __init__(self, fault: dict[str, Any]) -> None:
        self._fault = fault
        self._left = fault.get("after", 0)
        self._counts = "when" not in fault
        self._mine = False
        """True while the fault itself drives the robot."""
        self._drives = 0
        self._readings = Readings(fault["readings"], fault.get("codes", ())) if "readings" in fault else None

    def install(self) -> None:
        """Wrap the methods of every robot of the script."""
        for name in ("read", "drive", "send"):
            setattr(Robot, name, self._around(getattr(Robot, name)))

    def _around(self, method: Callable[..., Any]) -> Callable[..., Any]:
        def call(robot: Robot, *arguments: Any) -> Any:
            if self._mine:
                return method(robot, *arguments)
            if self._counts:
                self._left -= 1
                if self._left < 0:
                    self._strike(robot)
            command = "-".join(each if isinstance(each, str) else format(each, "g") for each in arguments)
            self._counts = self._counts or command == self._fault["when"]
            if command == self._fault.get("skip"):
                return None
            if method.__name__ == "drive" and "comma" in self._fault:
                return robot.send(command.replace(".", ","))
            answer = method(robot, *arguments)
            if method.__name__ == "drive":
                self._drove(robot, *arguments)
            elif method.__name__ == "read" and self._readings is not None:
                answers = answer if len(arguments) > 1 else (answer,)
                given = tuple(map(self._readings.changed, arguments, answers))
                return given if len(arguments) > 1 else given[0]
            return answer

        return call

    def _drove(self, robot: Robot, code: str, value: float) -> None:
        self._drives += 1
        if self._readings is not None and code == "r1":
            self._readings.since_turn.clear()
        self._mine = True
        if code != "p1" and self._drives % self._fault.get("twice", self._drives + 1) == 0:
            robot.drive(code, value)
        if "sleep" in self._fault:
            robot.sleep(self._fault["sleep"])
        self._mine = False

    def _strike(self, robot: Robot) -> None:
        fault = self._fault
        if "crash" in fault:
            raise exception(fault["crash"])
        if "exit" in fault:
            os._exit(fault["exit"])
        if "signal" in fault:
            os.kill(os.getpid(), fault["signal"])
        if "loop" in fault:
            self._mine = True
            step = STEPS.get(fault["loop"]) or swinging(robot)
            while True:
                step(robot)
        self._mine = True
        for command in fault.pop("send", ()):
            robot.send(command)
        self._mine = False


def exception(name: str) -> Exception:
    """An exception as in real programs."""
    words = {"KeyError": "heading", "ZeroDivisionError": "division by zero"}
    kind: type[Exception] = getattr(builtins, name)
    return kind(words.get(name, "the block is not where it was"))


def main(arguments: list[str]) -> None:
    """Run the script with the fault."""
    fault, script = json.loads(arguments[0]), arguments[1]
    Interference(fault).install()
    sys.argv = arguments[1:]
    sys.path.insert(0, str(Path(script).resolve().parent))
    # A script ends by SystemExit; the fault follows.
    with contextlib.suppress(SystemExit) if "crash_at_end" in fault else contextlib.nullcontext():
        runpy.run_path(script, run_name="__main__")
    if "crash_at_end" in fault:
        raise exception(fault["crash_at_end"])


if __name__ == "__main__":
    main(sys.argv[1:])
