"""Parts that are wired to a board's pins: motor drivers, encoders, and what a sketch reads of sensors.

Times are nanoseconds, speeds in/s.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

from simmer_tui.sketch.board_process import EDGE, BoardEvent
from simmer_tui.sketch.wiring import MotorDriver, WiredAnalog, WiredEncoder, WiredI2c, WiredMotor, WiredRanger

SOUND_SPEED = 13504.0
"""Speed of sound at 20 degrees C, in/s (343 m/s)."""
ECHO_DELAY = 450_000
"""Time from the end of the trigger to the echo's rise: eight periods of 40 kHz, and the part's own delay."""
NO_ECHO = 38_000_000
"""Length of the echo's pulse where nothing is heard (data sheet of the HC-SR04)."""
LONGEST_RANGE = 157.5
"""Inches beyond which an HC-SR04 hears nothing: 4 m in its data sheet."""
LARGEST_DUTY, FINEST_DUTY = 255, 65_535
"""Duties of a pin that is always high: on an AVR, and on an ESP32."""
PULSE_PERIOD, SERVO_STOP = 20_000, 1500
"""Microseconds from one pulse of a servo to the next, and of the pulse at which one that turns all round
stands."""

SECOND = 1_000_000_000
"""Nanoseconds of a second."""


def rim_speed(motor: WiredMotor, level_of: Callable[[int], float]) -> float:
    """The rim speed that a motor's driver asks for; `level_of` is the share of time that a pin is high."""

    def level(name: str, unwired: float = 0.0) -> float:
        pin = motor.pins.get(name)
        return unwired if pin is None else level_of(pin)

    if motor.driver is MotorDriver.HBRIDGE:
        share = level("en", 1.0) * (level("in1") - level("in2"))
    elif motor.driver is MotorDriver.SHIELD:
        direction = 1.0 if level("dir") > 0.5 else -1.0
        share = 0.0 if level("brake") > 0.5 else direction * level("pwm")
    elif motor.driver is MotorDriver.SERVO360:
        width = round(level("pin") * PULSE_PERIOD)
        share = (width - SERVO_STOP) / motor.full_pulse if width else 0.0
        share = min(max(share, -1.0), 1.0)
    else:
        share = level("in1") - level("in2")
    if abs(share) <= motor.dead_band:
        return 0.0
    moved = (abs(share) - motor.dead_band) / (1.0 - motor.dead_band)
    speed = math.copysign(moved * motor.top_speed, share)
    return -speed if motor.reversed else speed


def echo_length(inches: float) -> int:
    """The length of an echo's pulse for a reading."""
    if not 0.0 <= inches <= LONGEST_RANGE:
        return NO_ECHO
    return round(2.0 * inches / SOUND_SPEED * SECOND)


def analog_counts(sensor: WiredAnalog, reading: float, most: int) -> int:
    """The number that analogRead gives for a reading, `most` at most: straight lines between the points."""
    points: Sequence[tuple[float, float]] = sensor.points
    if math.isnan(reading):
        return 0
    counts = points[0][1] if reading <= points[0][0] else points[-1][1]
    for (left, low), (right, high) in pairwise(points):
        if left <= reading <= right:
            counts = low + (reading - left) / (right - left) * (high - low)
            break
    return min(max(round(counts), 0), most)


MILLIMETRES = 25.4
"""Millimetres of an inch."""
NOTHING_IN_RANGE = 8190
"""Millimetres that a VL53L0X gives where nothing is in range."""


def range_millimetres(inches: float) -> int:
    """The distance that a VL53L0X gives for a reading."""
    if not math.isfinite(inches):
        return NOTHING_IN_RANGE
    return min(round(inches * MILLIMETRES), NOTHING_IN_RANGE)


def bus_option(number: int, part: WiredI2c) -> list[str]:
    """The option by which a board gets a part on its bus; `number` is that of its row, from 0."""
    interrupt = -1 if part.interrupt is None else part.interrupt
    if isinstance(part, WiredRanger):
        xshut = -1 if part.xshut is None else part.xshut
        return ["--vl53l0x", f"{number},{xshut},{interrupt}"]
    return ["--mpu6050", f"{number},{part.address},{interrupt}"]


class EncoderState:
    """An encoder's edges, in closed form from the last change of its wheel's speed: not from one look to the
    next, so that the times of looks change nothing."""

    def __init__(self, wired: WiredEncoder) -> None:
        self.wired = wired
        # Half an edge from the first one, so that a robot at rest stands on none.
        self._counted = 0.5
        self._since = 0
        self._rate = 0.0

    def restart(self) -> None:
        """At rest, at time 0."""
        self._counted, self._since, self._rate = 0.5, 0, 0.0

    def set_speed(self, time: int, speed: float) -> None:
        """The wheel turns at another rim speed from a time on."""
        if speed == self._rate / self.wired.edges_per_inch:
            return
        self._counted += self._rate * ((time - self._since) / SECOND)
        self._since, self._rate = time, speed * self.wired.edges_per_inch

    def edges(self, begin: int, end: int) -> Iterator[BoardEvent]:
        """The edges from `begin` on and before `end`."""
        rate = self._rate
        if not rate:
            return
        count = self._counted
        if rate > 0.0:
            # The first that may be due, less one for rounding.
            k = max(math.floor(count + rate * ((begin - self._since) / SECOND)) - 1, math.floor(count)) + 1
            step, after = 1, 0
        else:
            k = min(math.floor(count + rate * ((begin - self._since) / SECOND)) + 1, math.floor(count))
            step, after = -1, -1
        while True:
            time = self._since + math.ceil((k - count) / rate * SECOND)
            if time >= end:
                return
            if time >= begin:
                yield from self._levels(time, k + after)
            k += step

    def levels_at(self, time: int) -> Iterator[BoardEvent]:
        """The levels at a time."""
        state = math.floor(self._counted + self._rate * ((time - self._since) / SECOND))
        yield from self._levels(time, state)

    def _levels(self, time: int, state: int) -> Iterator[BoardEvent]:
        """Both channels in a state: A leads where the wheel rolls forward."""
        wired = self.wired
        if wired.b is None:
            yield BoardEvent(time, EDGE, wired.a, state & 1)
            return
        phase = state & 3
        yield BoardEvent(time, EDGE, wired.a, int(phase in (1, 2)))
        yield BoardEvent(time, EDGE, wired.b, int(phase in (2, 3)))
