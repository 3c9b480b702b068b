"""Facts of the boards: pins, PWM, interrupts, serial ports, by the makers' pin maps."""

from collections.abc import Mapping

from msgspec import Struct
from msgspec.structs import replace


class BoardKind(Struct, frozen=True, kw_only=True):
    """A kind of board. Pins are Arduino's numbers; A0 follows the last digital pin: 14 on an Uno."""

    name: str
    """Its name in wiring.toml."""
    title: str
    macro: str
    """The symbol that Arduino's build defines for it."""
    pins: int
    """Number of pins, analog ones included."""
    first_analog: int
    """The number of A0."""
    analog_only: frozenset[int] = frozenset()
    """Pins that can neither be written nor read as digital ones."""
    pwm: frozenset[int]
    """Pins on which analogWrite makes a PWM."""
    interrupts: Mapping[int, int]
    """Number of the external interrupt by pin."""
    serial: Mapping[str, tuple[int, int]]
    """Pins (rx, tx) of each serial port in hardware."""
    software_rx: frozenset[int]
    """Pins at which SoftwareSerial can receive: those with a pin-change interrupt."""
    i2c: tuple[int, int]
    """Pins (SDA, SCL) of Wire."""
    servo_takes: frozenset[int]
    """PWM pins whose timer the Servo library uses: with a servo attached they have no PWM."""
    tick: int = 16
    """Milliseconds of a tick of FreeRTOS. On an AVR the watchdog makes it."""

    def pin(self, given: int | str) -> int | None:
        """The number of a pin by number or analog name; None if the board has none such."""
        number = given if isinstance(given, int) else self.first_analog + int(given[1:])
        return number if number < self.pins else None

    def pin_name(self, pin: int) -> str:
        """The name of a pin for people: `9`, `A0`."""
        return f"A{pin - self.first_analog}" if pin >= self.first_analog else str(pin)

    def is_analog(self, pin: int) -> bool:
        """True if analogRead can read the pin."""
        return self.first_analog <= pin < self.pins


_AVR_PWM = frozenset((3, 5, 6, 9, 10, 11))
_AVR_INTERRUPTS = {2: 0, 3: 1}
# Servo uses timer 1, which makes the PWM of 9 and 10.
_AVR_SERVO = frozenset((9, 10))
UNO = BoardKind(
    name="uno",
    title="Uno",
    macro="ARDUINO_AVR_UNO",
    pins=20,
    first_analog=14,
    pwm=_AVR_PWM,
    interrupts=_AVR_INTERRUPTS,
    serial={"Serial": (0, 1)},
    software_rx=frozenset(range(20)),
    i2c=(18, 19),
    servo_takes=_AVR_SERVO,
)
# The same processor in a case with two more analog inputs.
NANO = replace(
    UNO, name="nano", title="Nano", macro="ARDUINO_AVR_NANO", pins=22, analog_only=frozenset((20, 21))
)
MEGA = BoardKind(
    name="mega",
    title="Mega",
    macro="ARDUINO_AVR_MEGA2560",
    pins=70,
    first_analog=54,
    pwm=frozenset((*range(2, 14), 44, 45, 46)),
    interrupts={2: 0, 3: 1, 21: 2, 20: 3, 19: 4, 18: 5},
    serial={"Serial": (0, 1), "Serial1": (19, 18), "Serial2": (17, 16), "Serial3": (15, 14)},
    software_rx=frozenset((*range(10, 16), *range(50, 54), *range(62, 70))),
    i2c=(20, 21),
    # The first twelve servos use timer 5.
    servo_takes=frozenset((44, 45, 46)),
)
BOARDS = {board.name: board for board in (UNO, NANO, MEGA)}
"""The kinds of boards by their names in wiring.toml."""
