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
    inputs: frozenset[int] = frozenset()
    """Pins that can be read alone."""
    flash: frozenset[int] = frozenset()
    """Pins of its flash memory: no sketch can use them."""
    absent: frozenset[int] = frozenset()
    """Numbers that no pin has."""
    analog_names: Mapping[str, int] = {}
    """Analog pins by name, where they are in no row."""
    int_bits: int = 16
    """Width of an `int`; with 16, a `double` has 4 bytes."""
    most_counts: int = 1023
    """The greatest number that analogRead gives."""
    led: int = 13
    """The pin of its LED."""
    bluetooth: tuple[int, int] | None = None
    """Numbers that stand for the two directions of its Bluetooth line."""
    lacks: frozenset[str] = frozenset(
        (
            *("BluetoothSerial.h", "ESP32Servo.h", "FunctionalInterrupt.h", "esp_log.h"),
            *("soc/soc.h", "soc/rtc_cntl_reg.h"),
        )
    )
    """Libraries of the simulator that are for other boards."""
    tick: int = 16
    """Milliseconds of a tick of FreeRTOS. On an AVR the watchdog makes it."""

    def pin(self, given: int | str) -> int | None:
        """The number of a pin by number or analog name; None if the board has none such."""
        if isinstance(given, int):
            number = given
        elif self.analog_names:
            number = self.analog_names.get(given, self.pins)
        else:
            number = self.first_analog + int(given[1:])
        return number if number < self.pins and number not in self.absent else None

    def pin_name(self, pin: int) -> str:
        """The name of a pin for people: `9`, `A0`."""
        if self.bluetooth is not None and pin in self.bluetooth:
            return "Bluetooth"
        if self.analog_names:
            return str(pin)
        return f"A{pin - self.first_analog}" if pin >= self.first_analog else str(pin)

    @property
    def pin_names(self) -> str:
        """Its pins, for people."""
        if self.absent:
            return f"0 to {self.pins - 1} without {', '.join(map(str, sorted(self.absent)))}"
        return f"0 to {self.first_analog - 1} and A0 to {self.pin_name(self.pins - 1)}"

    @property
    def analog_text(self) -> str:
        """Its analog pins, for people."""
        if self.analog_names:
            return ", ".join(map(str, sorted(self.analog_names.values())))
        return f"A0 to {self.pin_name(self.pins - 1)}"

    @property
    def usb(self) -> tuple[int, int]:
        """Pins (rx, tx) of its USB port."""
        return self.serial["Serial"]

    def analog_pin(self, given: int) -> int:
        """The pin that `analogRead(given)` reads: 0 is A0 on an AVR."""
        is_channel = not self.analog_names and given < self.pins - self.first_analog
        return given + self.first_analog if is_channel else given

    def is_analog(self, pin: int) -> bool:
        """True if analogRead can read the pin."""
        if self.analog_names:
            return pin in self.analog_names.values()
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
_ESP32_INPUTS = frozenset((*range(34, 40),))
# Beside those of the flash memory, numbers that are on no pin of the chip's case.
_ESP32_FLASH = frozenset(range(6, 12))
_ESP32_ABSENT = frozenset((*_ESP32_FLASH, 20, 24, *range(28, 32)))
_ESP32_PINS = frozenset(range(40)) - _ESP32_ABSENT
ESP32 = BoardKind(
    name="esp32",
    title="ESP32",
    macro="ARDUINO_ESP32_DEV",
    pins=40,
    first_analog=0,
    analog_names={
        **dict(zip(("A0", "A3", "A4", "A5", "A6", "A7"), (36, 39, 32, 33, 34, 35), strict=True)),
        **dict(zip((f"A{n}" for n in range(10, 20)), (4, 0, 2, 15, 13, 12, 14, 27, 25, 26), strict=True)),
    },
    inputs=_ESP32_INPUTS,
    flash=_ESP32_FLASH,
    absent=_ESP32_ABSENT,
    pwm=_ESP32_PINS - _ESP32_INPUTS,
    interrupts={pin: pin for pin in sorted(_ESP32_PINS)},
    serial={"Serial": (3, 1), "Serial1": (9, 10), "Serial2": (16, 17)},
    software_rx=_ESP32_PINS,
    i2c=(21, 22),
    servo_takes=frozenset(),
    int_bits=32,
    most_counts=4095,
    led=2,
    bluetooth=(40, 41),
    lacks=frozenset(("Arduino_FreeRTOS.h", "EEPROM.h", "Servo.h", "SoftwareSerial.h")),
    tick=1,
)
BOARDS = {board.name: board for board in (UNO, NANO, MEGA, ESP32)}
"""The kinds of boards by their names in wiring.toml."""
