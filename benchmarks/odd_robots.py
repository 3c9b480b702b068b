"""Emulated robots with one effect each that no set describes: robots beside the model of calibration.

The other parameters are drawn as those of all emulated robots. A person who measures with a ruler and a
protractor would find each effect.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from msgspec.structs import replace

sys.path.append(str(Path(__file__).resolve().parent.parent / "scripts"))
from robot_emulator import WHEEL_RADIUS, Robot

from simmer_tui.sim import CommandResult, Status, parse_command
from simmer_tui.sim.command import Command, parse_value
from simmer_tui.sim.specs import CELL_SIZE, DriveSpec, SensorSpec

_INCHES_PER_DEGREE = math.radians(WHEEL_RADIUS)


class OddRobot(Robot):
    """A robot that moves and reads as in the model. Effects override `moved`, `turn_after` or `read`."""

    expected_movements = 200
    """Movements of the log, for effects that grow over it."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.odd_random = np.random.default_rng(arguments[2])
        self.made = 0
        self.turned = 0.0
        """Degrees that all turns were asked for."""

    @property
    def progress(self) -> float:
        """From 0 to 1, over the log."""
        return min(self.made / self.expected_movements, 1.0)

    def moved(self, drive: DriveSpec, asked: float) -> float:
        """The distance that the robot drives instead of the commanded one."""
        return asked

    def turn_after(self, drive: DriveSpec, asked: float) -> float:
        """Degrees by which the robot turns on top at the end of a movement."""
        return 0.0

    def read(self, sensor: SensorSpec, value: float) -> float:
        """The reading that the robot sends instead."""
        return value

    def _weakened(self, command: Command, drive: DriveSpec) -> Command:
        asked = parse_value(command.argument)
        if not isinstance(asked, float):
            return command
        value = self.moved(drive, asked)
        self.made += 1
        if drive.kind.turns:
            self.turned += asked
        return replace(command, argument=repr(value))

    def _slipping(self, text: str) -> CommandResult:
        command = parse_command(text)
        result = super()._slipping(text)
        drive = self._drives.get(command.code)
        asked = parse_value(command.argument)
        if drive is not None and isinstance(asked, float):
            more = self.turn_after(drive, asked)
            if more:
                self.simulator.execute(parse_command(f"r1-{more!r}"))
        return result

    def _do(self, command: bytes) -> CommandResult:
        result = super()._do(command)
        if result.status is not Status.READING or result.reading is None or not math.isfinite(result.reply):
            return result
        return replace(result, reply=self.read(result.reading.sensor, float(result.reply)))


class BlindSpot(OddRobot):
    """Range sensors read 3 in of everything that is closer."""

    def read(self, sensor: SensorSpec, value: float) -> float:
        return max(value, 3.0) if sensor.kind.is_range else value


class CountedTurns(OddRobot):
    """Odometers count a tenth of the inches that the rim of the robot turns."""

    def read(self, sensor: SensorSpec, value: float) -> float:
        return value + 0.1 * _INCHES_PER_DEGREE * self.turned if sensor.kind.name == "odom" else value


class CurvedRange(OddRobot):
    """Ranges grow faster than the distance: by 2 % at 10 in, 6 % at 30 in."""

    def read(self, sensor: SensorSpec, value: float) -> float:
        return value * (1.0 + 0.002 * value) if sensor.kind.is_range else value


class HeadingDrift(OddRobot):
    """Translations turn the robot by 0.05 degrees times the square of their inches."""

    def turn_after(self, drive: DriveSpec, asked: float) -> float:
        return 0.0 if drive.kind.turns else 0.05 * asked**2


class UnevenTurns(OddRobot):
    """Turns to the left are 2 % too large, turns to the right 2 % too small."""

    def moved(self, drive: DriveSpec, asked: float) -> float:
        return asked * (1.0 + math.copysign(0.02, asked)) if drive.kind.turns else asked


class TwoSurfaces(OddRobot):
    """Translations go 4 % further on every other cell of the maze, 4 % less far on the rest."""

    def moved(self, drive: DriveSpec, asked: float) -> float:
        pose = self.simulator.pose
        odd = (int(pose.x // CELL_SIZE) + int(pose.y // CELL_SIZE)) % 2
        return asked if drive.kind.turns else asked * (1.04 if odd else 0.96)


class WarmingSensors(OddRobot):
    """Ranges grow by 6 % over the log, as with the temperature of the air."""

    def read(self, sensor: SensorSpec, value: float) -> float:
        return value * (1.0 + 0.06 * (self.progress - 0.5)) if sensor.kind.is_range else value


class Backlash(OddRobot):
    """A movement against the previous one on its axis loses 0.3 in at the wheels."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._side = dict[str, float]()

    def moved(self, drive: DriveSpec, asked: float) -> float:
        direction = drive.kind.direction
        axis = "r" if drive.kind.turns else "x" if direction.x else "y"
        side = math.copysign(1.0, asked * (direction.x + direction.y + direction.r))
        reverses = self._side.get(axis, side) != side
        self._side[axis] = side
        lost = 0.3 / _INCHES_PER_DEGREE if drive.kind.turns else 0.3
        return math.copysign(max(abs(asked) - lost, 0.0), asked) if reverses else asked


class CoarseReadings(OddRobot):
    """Ranges come in whole inches."""

    def read(self, sensor: SensorSpec, value: float) -> float:
        return float(round(value)) if sensor.kind.is_range else value


class CounterJumps(OddRobot):
    """One in 30 readings of odometers and gyro is off by up to 3 in or degrees."""

    def read(self, sensor: SensorSpec, value: float) -> float:
        counts = sensor.kind.name in ("odom", "gyro")
        return value + self.odd_random.uniform(-3.0, 3.0) * (self.odd_random.random() < 1 / 30) * counts


class DeadBand(OddRobot):
    """Movements of less than 2 in, or 38 degrees, go half as far."""

    def moved(self, drive: DriveSpec, asked: float) -> float:
        least = 2.0 / _INCHES_PER_DEGREE if drive.kind.turns else 2.0
        return asked / 2 if abs(asked) < least else asked


class SlipAtSpeed(OddRobot):
    """Beyond 4 in a translation is fast, and loses 10 % of the rest; odometers count it."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._lost = dict.fromkeys(self._wheels, 0.0)

    def moved(self, drive: DriveSpec, asked: float) -> float:
        if drive.kind.turns or asked <= 4.0:
            return asked
        lost = 0.1 * (asked - 4.0)
        for code, wheel in self._wheels.items():
            if wheel.slips:
                more = lost * drive.kind.direction.x, lost * drive.kind.direction.y
                self._lost[code] += wheel.spec.gain * wheel.counted_on(0.0, *more)
        return asked - lost

    def read(self, sensor: SensorSpec, value: float) -> float:
        return value + self._lost.get(sensor.code, 0.0)


class TiltedFloor(OddRobot):
    """Translations towards +x of the maze are 5 % too short, those towards -x 5 % too long."""

    def moved(self, drive: DriveSpec, asked: float) -> float:
        if drive.kind.turns:
            return asked
        angle = math.radians(self.simulator.pose.heading)
        direction = drive.kind.direction
        towards = direction.x * math.cos(angle) - direction.y * math.sin(angle)
        return asked * (1.0 - 0.05 * towards)


class BentCompass(OddRobot):
    """The compass deviates by up to 6 degrees with the heading, by iron on the robot."""

    def read(self, sensor: SensorSpec, value: float) -> float:
        if sensor.kind.name == "comp":
            return value + 6.0 * math.sin(math.radians(value))
        return value


TUNED: Mapping[str, type[OddRobot]] = MappingProxyType({
    "blind spot": BlindSpot,
    "odometers count turning": CountedTurns,
    "ranges not linear": CurvedRange,
    "heading drift with length": HeadingDrift,
    "left and right turns differ": UnevenTurns,
    "two surfaces": TwoSurfaces,
    "sensors drift with temperature": WarmingSensors,
})  # fmt: skip
"""Kinds that the tests of the model were made with."""
UNSEEN: Mapping[str, type[OddRobot]] = MappingProxyType({
    "backlash": Backlash,
    "coarse ranges": CoarseReadings,
    "counters jump": CounterJumps,
    "dead band": DeadBand,
    "slip at speed": SlipAtSpeed,
    "tilted floor": TiltedFloor,
    "compass bent by iron": BentCompass,
})  # fmt: skip
"""Kinds whose results were first looked at when the tests were done."""
