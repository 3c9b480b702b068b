"""wiring.toml, the optional file of a set that says which sketches run on which boards, and what is wired to
their pins: its tables and their keys.

Lengths are inches. A pin is a number, or an analog name such as "A0".
"""

import re
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, ClassVar

from simmer_tui.sim.rules import (
    ChoiceRule,
    FlagRule,
    IntegerRule,
    NumberRule,
    Rule,
    TextRule,
    describe,
    is_whole,
)
from simmer_tui.sim.values import Value

# The largest number of a pin: D69, which is A15, of a Mega.
_LARGEST_PIN = 69
_ANALOG = re.compile(r"A(?:[0-9]|1[0-5])")


class PinRule(Rule[int | str], frozen=True):
    """A pin: its number, or its analog name. A pin that the board does not have is found by its board."""

    allowed: ClassVar[str] = 'a pin such as 9 or "A0"'
    metavar: ClassVar[str] = "PIN"
    schema: ClassVar[dict[str, Any]] = {
        "anyOf": [
            {"type": "integer", "minimum": 0, "maximum": _LARGEST_PIN},
            {"type": "string", "pattern": "^([Aa]([0-9]|1[0-5])|[Dd]?[0-9]{1,2})$"},
        ]
    }

    def check(self, value: object) -> int | str:
        if is_whole(value) and 0 <= value <= _LARGEST_PIN:
            return value
        text = value.strip().upper() if isinstance(value, str) else ""
        if _ANALOG.fullmatch(text):
            return text
        # Boards have it printed as D9 as often as 9.
        digits = text.removeprefix("D")
        if re.fullmatch("[0-9]{1,2}", digits) and int(digits) <= _LARGEST_PIN:
            return int(digits)
        raise ValueError(self.refusal(value))


class KindRule(ChoiceRule, frozen=True):
    """One of a few words. Known words that cannot be used are refused by name.

    `refused` has, by such a word, what to use instead.
    """

    refused: Mapping[str, str] = {}

    def refusal(self, value: object) -> str:
        word = value.strip().lower() if isinstance(value, str) else ""
        if word in self.refused:
            return f"{describe(word)} cannot be simulated; {self.refused[word]}"
        return super().refusal(value)


class PointsRule(Rule[tuple[tuple[float, float], ...]], frozen=True):
    """A curve through at least two points, each two numbers, the first of which rises from point to point."""

    most: int
    high: float
    """The largest second number."""

    @property
    def allowed(self) -> str:
        return (
            f"2 to {self.most} points [reading, count], with readings that rise and counts from 0 to "
            f"{self.high:g}, such as [[0, 1023], [12, 100]]"
        )

    metavar: ClassVar[str] = "POINTS"

    @property
    def schema(self) -> dict[str, Any]:
        point = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
        return {"type": "array", "items": point, "minItems": 2, "maxItems": self.most}

    def check(self, value: object) -> tuple[tuple[float, float], ...]:
        number, count = NumberRule(), NumberRule(0, self.high)
        if not isinstance(value, list | tuple) or not 2 <= len(value) <= self.most:
            raise ValueError(self.refusal(value))
        points = []
        for each in value:
            if not isinstance(each, list | tuple) or len(each) != 2:
                raise ValueError(self.refusal(each))
            points.append((number.check(each[0]), count.check(each[1])))
        if any(later[0] <= point[0] for point, later in pairwise(points)):
            raise ValueError(self.refusal(value))
        return tuple(points)


def _key(name: str, rule: Rule[Any], meaning: str, unit: str = "", default: object = None) -> Value:
    return Value(rule, meaning, unit, name, default=default)


def _pin(name: str, meaning: str) -> Value:
    return _key(name, PinRule(), meaning)


_NAMES = "uno, nano, mega and esp32 can"
_BOARDS = dict.fromkeys(
    (
        "esp8266",
        "leonardo",
        "micro",
        "due",
        "teensy",
        "pico",
        "uno r4",
        "uno_r4",
        "zero",
        "nano every",
    ),
    f"{_NAMES}: most sketches run on one of them as they are",
)
_DRIVERS = dict.fromkeys(("esc", "servo"), "servo360 can: 1,500 us is its stop")
_LATER_PARTS = {
    "gyro": "mpu6050 can",
    **dict.fromkeys(("compass", "lcd"), "of the parts on Wire (I2C), mpu6050 and vl53l0x can"),
}
_BOARD_KEY = _key("board", TextRule(), "name of a board of [boards]")

BOARD_KINDS = ("uno", "nano", "mega", "esp32")
"""The kinds of boards."""
BOARD_TABLE = (
    _key("sketch", TextRule(), "the sketch: an .ino file or its folder, by path from the set"),
    _key("board", KindRule(BOARD_KINDS, refused=_BOARDS), "kind of the board"),
)
"""The keys of [boards.NAME]: a board and its sketch."""
LAPTOP = (
    _BOARD_KEY,
    _pin("rx", "pin at which the board receives; without it, that of its USB port"),
    _pin("tx", "pin at which the board sends; without it, that of its USB port"),
    _key("bluetooth", FlagRule(), "true if the line is BluetoothSerial of an esp32"),
    _key(
        "baud", IntegerRule(50, 4_000_000), "bits a second of the laptop's program; else those of the sketch"
    ),
)
"""The keys of [laptop]: the serial line to the laptop's program."""
ENDPOINT = TextRule()
WIRE = (
    _key("from", ENDPOINT, 'pin that sends, with its board: "sensor.1"'),
    _key("to", ENDPOINT, 'pin that receives, with its board: "rover.0"'),
)
"""The keys of [[wires]]: a wire from a pin that sends to one that receives, of another board."""
_DUTY = (
    _key("top_speed", NumberRule(0.1, 1000), "rim speed at full duty", "in/s"),
    _key("dead_band", NumberRule(0, 0.95), "share of full duty that does not turn it", "", 0.1),
)
# Microsteps of a small wheel, 400 x 32 a turn of 2 in around, are 6,400.
_STEPS = _key(
    *("steps_per_inch", NumberRule(0.01, 100_000)),
    "steppers: steps in an inch of the rim; with four wires full steps, of which a half step is half",
    "1/in",
)
_COILS = tuple(
    _pin(name, meaning)
    for name, meaning in (
        (
            "in1",
            "hbridge: HIGH forward; pwm2: PWM forward; stepper4: first end of coil A; uln2003",
        ),
        ("in2", "hbridge: HIGH backward; pwm2: PWM backward; stepper4: its other end; uln2003"),
        ("in3", "stepper4: first end of coil B; uln2003"),
        ("in4", "stepper4: its other end; uln2003"),
    )
)
DRIVER_KEYS: Mapping[str, tuple[Value, ...]] = {
    "hbridge": (
        *_COILS[:2],
        _pin("en", "hbridge: enable input with the PWM; without it the jumper is on"),
        *_DUTY,
    ),
    "shield": (
        _pin("dir", "shield, step_dir: direction, HIGH forward"),
        _pin("pwm", "shield: PWM"),
        _pin("brake", "shield: brake, HIGH stops"),
        *_DUTY,
    ),
    "pwm2": (*_COILS[:2], *_DUTY),
    "servo360": (
        _pin("pin", "servo360: signal of a servo that turns all round, or of an ESC; 1,500 us is its stop"),
        _key(
            *("full_pulse", NumberRule(50, 1000)),
            "servo360: length beside 1,500 us of the pulse at which it has top_speed",
            "us",
            500,
        ),
        *_DUTY,
    ),
    "step_dir": (
        _pin("step", "step_dir: each rise is a step"),
        _pin("dir", "shield, step_dir: direction, HIGH forward"),
        _pin("enable", "step_dir: enable input; without it the driver is on"),
        _key("enable_on", ChoiceRule(("low", "high")), "step_dir: level at which it is enabled", "", "low"),
        _STEPS,
    ),
    "stepper4": (*_COILS, _STEPS),
    "uln2003": (*_COILS, _STEPS),
}
"""The keys of a motor's driver, by its kind."""
OPTIONAL_PINS = ("en", "brake", "enable", "b")
"""Pins that a driver or part may do without."""
MOTOR = (
    _BOARD_KEY,
    _key("driver", KindRule(tuple(DRIVER_KEYS), refused=_DRIVERS), "kind of the motor's driver"),
    _key("wheel", TextRule(), "wheel of [wheels] in settings.toml that it turns, such as left"),
    _key("reversed", FlagRule(), "true if it turns the other way: two of its wires are swapped", "", False),
)
"""The keys of [[motors]], without those of their drivers."""
MOTOR_OPTIONAL = ("dead_band", "reversed", "enable_on", "full_pulse")
_ADDRESS = _key(
    # Chips answer at reserved addresses too, and sketches number their rangers from 1.
    *("address", IntegerRule(0x01, 0x7F, "an address from 0x01 to 0x7f")),
    "mpu6050: 0x68, or 0x69 with AD0 high; vl53l0x: the address that the sketch gives it",
)
_INTERRUPT = _pin("int", "mpu6050, vl53l0x: pin at its interrupt output (INT, GPIO1), if it is wired")
PART_KEYS: Mapping[str, tuple[Value, ...]] = {
    "hc-sr04": (
        _pin("trig", "hc-sr04: trigger pin"),
        _pin("echo", "hc-sr04: echo pin"),
    ),
    "encoder": (
        _key("wheel", TextRule(), "encoder: wheel of [wheels] in settings.toml, such as left"),
        _pin("a", "encoder: pin of channel A"),
        _pin("b", "encoder: pin of channel B, if it has one; forward, A leads"),
        _key(
            *("edges_per_inch", NumberRule(0.01, 10_000)),
            "encoder: edges on all its pins, rising and falling, in an inch of the rim",
            "1/in",
        ),
    ),
    "line": (
        _pin("pin", "line, analog: the pin"),
        _key("active", ChoiceRule(("high", "low")), "line: level while the sensor reads 1", "", "high"),
    ),
    "analog": (
        _pin("pin", "line, analog: the pin"),
        # 16 points describe the curve of an infrared distance sensor by its data sheet.
        _key("points", PointsRule(16, 4095), "analog: curve from the reading to analogRead's count"),
    ),
    "mpu6050": (
        _ADDRESS,
        _INTERRUPT,
    ),
    "vl53l0x": (
        _ADDRESS,
        _pin("xshut", "vl53l0x: pin at its XSHUT; while it is LOW the part is off"),
        _INTERRUPT,
    ),
}
"""The keys of [[sensors]] of each part, without `code`, `board` and `part`."""
PART_OPTIONAL = ("b", "active", "address", "xshut", "int")
PART = (
    _key("code", TextRule(), "code of the row of sensors.csv; an encoder has none"),
    _BOARD_KEY,
    _key("part", KindRule(tuple(PART_KEYS), refused=_LATER_PARTS), "kind of the part"),
)
"""The keys of [[sensors]] that every part has."""
GRIPPER_ANGLES = (
    _key("open", NumberRule(0, 180), "angle at which the gripper is open", "deg"),
    _key("closed", NumberRule(0, 180), "angle at which it is closed", "deg"),
)
"""The keys of a servo's `gripper`."""
SERVO = (_BOARD_KEY, _pin("pin", "pin of the servo's signal"))
"""The keys of [[servos]], without `gripper`."""
TABLES = ("boards", "laptop", "wires", "motors", "sensors", "servos")
"""The tables of the file."""


def all_keys(table: str) -> tuple[Value, ...]:
    """The keys of a table of motors or sensors, with those of every driver or part, each once."""
    base, kinds = (MOTOR, DRIVER_KEYS) if table == "motors" else (PART, PART_KEYS)
    found = {value.name: value for value in base}
    for values in kinds.values():
        found |= {value.name: value for value in values if value.name not in found}
    return tuple(found.values())
