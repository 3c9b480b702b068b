"""wiring.toml read into the boards of a set and what is wired to their pins, with every mistake and its line.

Pins are Arduino's numbers here: A0 of an Uno is 14. No compiler is needed, and no sketch is opened.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import Struct

from simmer_tui.config import wiring_toml
from simmer_tui.config.set_sketches import SKETCH_ENDINGS, WIRING_FILE
from simmer_tui.config.toml_file import TomlFile
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.command import cut
from simmer_tui.sim.rules import did_you_mean
from simmer_tui.sim.specs import SensorSpec, WheelLayout, WheelsSpec
from simmer_tui.sim.values import Value
from simmer_tui.sketch.boards import BOARDS, BoardKind

if TYPE_CHECKING:
    from simmer_tui.config.loader import Configuration

# Judged: the largest robot known has a Mega and an Uno, three wheels and eight ranges.
_MOST_ROWS = {"boards": 4, "wires": 16, "motors": 8, "sensors": 32, "servos": 8}
WHEEL_NAMES: Mapping[WheelLayout, tuple[str, ...]] = {
    WheelLayout.DIFF: ("left", "right"),
    WheelLayout.OMNI_3: ("0", "120", "240"),
    WheelLayout.OMNI_4: ("front", "rear", "left", "right"),
    WheelLayout.MECANUM: ("front_left", "front_right", "rear_left", "rear_right"),
}
"""Names of a layout's wheels, in the order of `ww`'s values; those of omni-3 are their angles."""


class WiringRow(Struct, frozen=True, kw_only=True):
    """A table or row of wiring.toml. `places` has the place of each of its keys, the row's own as ""."""

    label: str
    """Its name in messages, `motors[1]`."""
    places: Mapping[str, str]

    @property
    def place(self) -> str:
        """Its place, `wiring.toml:21:motors.1`."""
        return self.places[""]

    def place_of(self, key: str) -> str:
        """The place of one of its keys, given or not."""
        return self.places.get(key) or f"{self.place}.{key}"


class SketchBoard(WiringRow, frozen=True, kw_only=True):
    """A board and the sketch that it runs; `sketch` is a path from the set's folder."""

    name: str
    sketch: str
    kind: BoardKind


class LaptopLine(WiringRow, frozen=True, kw_only=True):
    """The serial line to the laptop's program, from the board's side. `baud` is None if not given."""

    board: str
    rx: int
    tx: int
    baud: int | None


class BoardWire(WiringRow, frozen=True, kw_only=True):
    """A wire from a pin that sends, `tx`, to a pin of another board that receives, `rx`."""

    from_board: str
    tx: int
    to_board: str
    rx: int


class MotorDriver(StrEnum):
    """Kinds of motor drivers: the meaning of their pins."""

    HBRIDGE = "hbridge"
    """in1 and in2 give the direction (equal: a stop), en the duty; without en it is on."""
    SHIELD = "shield"
    """dir gives the direction, pwm the duty, brake a stop."""
    PWM2 = "pwm2"
    """The duty is the PWM of in1 less that of in2."""
    SERVO360 = "servo360"
    """The speed is the length of the pulse at pin beside 1,500 us; without pulses it stands."""


class WiredMotor(WiringRow, frozen=True, kw_only=True):
    """A motor with its driver. `pins` has the pin of each input by name; one that is not wired is missing.

    `wheel_index` is the wheel's place among `ww`'s values. `top_speed` is the rim speed at full duty, in/s,
    `dead_band` the share of full duty that does not turn it. `full_pulse` is full duty of a servo, as the
    length of its pulse beside 1,500 us. `reversed` motors turn the other way.
    """

    board: str
    driver: MotorDriver
    pins: Mapping[str, int]
    wheel: str
    wheel_index: int
    top_speed: float
    dead_band: float
    full_pulse: float
    reversed: bool


class StepperDriver(StrEnum):
    """Kinds of stepper drivers: the meaning of their pins."""

    STEP_DIR = "step_dir"
    """Each rise of step is a step, dir gives the direction, enable its power."""
    STEPPER4 = "stepper4"
    """Two coils on H-bridges: in1 and in2 are the ends of one, in3 and in4 those of the other."""
    ULN2003 = "uln2003"
    """Four half coils in the order in which they turn it: in1 and in3, in2 and in4 face each other."""


_STEPPERS = frozenset(map(str, StepperDriver))


class WiredStepper(WiringRow, frozen=True, kw_only=True):
    """A stepper with its driver. `pins` has the pin of each input by name; an enable that is not wired is
    missing.

    `wheel_index` is the wheel's place among `ww`'s values. The rim goes an inch in `steps_per_inch` steps,
    with four wires full ones, and at most `top_speed`, in/s, that of the wheels. `enable_high` is True if
    the driver is enabled by HIGH. `reversed` steppers turn the other way.
    """

    board: str
    driver: StepperDriver
    pins: Mapping[str, int]
    wheel: str
    wheel_index: int
    steps_per_inch: float
    top_speed: float
    enable_high: bool
    reversed: bool


class WiredSonar(WiringRow, frozen=True, kw_only=True):
    """An HC-SR04 at two pins, or at one for both."""

    code: str
    board: str
    trig: int
    echo: int


class WiredEncoder(WiringRow, frozen=True, kw_only=True):
    """A wheel's encoder with one channel or two (`b` is None without). `edges_per_inch` counts the edges of
    all its channels; edges of A and B alternate."""

    board: str
    wheel: str
    wheel_index: int
    a: int
    b: int | None
    edges_per_inch: float


class WiredLineSensor(WiringRow, frozen=True, kw_only=True):
    """A sensor of yes or no at a digital pin, which is HIGH while it reads 1, or LOW if not `active_high`."""

    code: str
    board: str
    pin: int
    active_high: bool


class WiredAnalog(WiringRow, frozen=True, kw_only=True):
    """A sensor at an analog pin. `points` are (reading, analogRead's count): straight lines between them, and
    beyond them the count of the last."""

    code: str
    board: str
    pin: int
    points: tuple[tuple[float, float], ...]


class WiredI2c(WiringRow, frozen=True, kw_only=True):
    """A part at a board's I2C bus. `interrupt` is the pin of its output for interrupts; None if it is not
    wired."""

    code: str
    board: str
    address: int
    interrupt: int | None


class WiredGyro(WiredI2c, frozen=True, kw_only=True):
    """An MPU6050 at its address."""


class WiredRanger(WiredI2c, frozen=True, kw_only=True):
    """A VL53L0X. It begins at address 0x29, and again whenever its pin `xshut` was low; `address` is the one
    that the sketch gives it."""

    xshut: int | None


WiredSensor = WiredSonar | WiredEncoder | WiredLineSensor | WiredAnalog | WiredGyro | WiredRanger
RANGER_ADDRESS = 0x29
"""The address at which a VL53L0X begins."""
GYRO_ADDRESSES = (0x68, 0x69)
"""The addresses of an MPU6050: with its pin AD0 low, the usual one, and high."""
_PIN_KEYS = {"interrupt": "int"}
"""Keys of pins in the file whose names here are others."""


class WiredServo(WiringRow, frozen=True, kw_only=True):
    """A servo. As the gripper it has two angles, degrees; None for one that moves nothing."""

    board: str
    pin: int
    open: float | None
    closed: float | None


class PinUse(Struct, frozen=True):
    """The use of a board's pin by a part: `name` is its key, `writes` is True if the sketch writes it."""

    board: str
    pin: int
    label: str
    name: str
    writes: bool
    place: str


class Wiring(Struct, frozen=True, kw_only=True):
    """The boards of a set and what is wired to their pins."""

    boards: Mapping[str, SketchBoard]
    laptop: LaptopLine | None
    wires: tuple[BoardWire, ...]
    motors: tuple[WiredMotor, ...]
    steppers: tuple[WiredStepper, ...]
    sensors: tuple[WiredSensor, ...]
    servos: tuple[WiredServo, ...]

    def pin_uses(self) -> Iterator[PinUse]:
        """Every pin that something is wired to, with its use, in the order of the file's tables."""
        if self.laptop is not None:
            yield _use(self.laptop, self.laptop.board, self.laptop.rx, "rx")
            yield _use(self.laptop, self.laptop.board, self.laptop.tx, "tx", writes=True)
        for wire in self.wires:
            yield _use(wire, wire.from_board, wire.tx, "from", writes=True)
            yield _use(wire, wire.to_board, wire.rx, "to")
        motors: tuple[WiredMotor | WiredStepper, ...] = (*self.motors, *self.steppers)
        for motor in motors:
            for name, pin in motor.pins.items():
                yield _use(motor, motor.board, pin, name, writes=True)
        for each in self.sensors:
            # Those of an ESP32 can be any two.
            if isinstance(each, WiredI2c) and self.boards[each.board].kind.int_bits == 16:
                for name, pin in zip(("sda", "scl"), self.boards[each.board].kind.i2c, strict=True):
                    yield _use(each, each.board, pin, name)
            for name in ("trig", "echo", "a", "b", "pin", "xshut", "interrupt"):
                number: int | None = getattr(each, name, None)
                if number is not None:
                    key = _PIN_KEYS.get(name, name)
                    yield _use(each, each.board, number, key, writes=name in ("trig", "xshut"))
        for servo in self.servos:
            yield _use(servo, servo.board, servo.pin, "pin", writes=True)


def wiring_lines(wiring: Wiring) -> Iterator[str]:
    """A wiring in words, a line a board and a line a part, for `check`."""
    yield "Boards: " + ", ".join(
        f"{board.name} ({board.kind.title}, {cut(board.sketch)})" for board in wiring.boards.values()
    )
    uses: dict[str, list[PinUse]] = {}
    for use in wiring.pin_uses():
        uses.setdefault(use.label, []).append(use)
    parts = {row.label: row for row in (*wiring.motors, *wiring.steppers, *wiring.sensors, *wiring.servos)}
    for label, found in uses.items():
        pins = ", ".join(
            f"{use.name} {use.board}.{wiring.boards[use.board].kind.pin_name(use.pin)}" for use in found
        )
        part = parts.get(label)
        what = getattr(part, "wheel", "") or getattr(part, "code", "")
        yield f"  {label} {what}: {pins}" if what else f"  {label}: {pins}"


def _use(row: WiringRow, board: str, pin: int, name: str, *, writes: bool = False) -> PinUse:
    return PinUse(board, pin, row.label, name, writes, row.place_of(name))


class WiringParts(Struct, frozen=True):
    """The parts of a set that a wiring may name: its sensors and wheels."""

    sensors: Sequence[SensorSpec] = ()
    wheels: WheelsSpec | None = None


def wiring_of(configuration: Configuration) -> Wiring | None:
    """The wiring of a set; None if it has no wiring.toml. Raises ConfigurationError with every mistake."""
    text = configuration.files.get(WIRING_FILE)
    if text is None:
        return None
    spec = configuration.simulation
    problems: list[Problem] = []
    wiring = read_wiring(text, WiringParts(spec.sensors, spec.wheels), problems)
    if wiring is not None:
        problems += missing_sketches(wiring, configuration.directory)
    if problems or wiring is None:
        raise ConfigurationError(problems)
    return wiring


def read_wiring(text: str, parts: WiringParts, problems: list[Problem]) -> Wiring | None:
    """The wiring in the text of a wiring.toml; mistakes go to `problems`. None if the text is no TOML."""
    before = len(problems)
    file = TomlFile(WIRING_FILE, text.removeprefix("\ufeff"), problems)
    if len(problems) > before:
        return None
    wiring = _WiringReader(file, parts, problems).wiring()
    # The pins of rows with mistakes are missing, so two uses of a pin are only found among the others.
    problems += pins_used_twice(wiring)
    problems += _inputs_written(wiring)
    problems += _addresses_used_twice(wiring)
    return wiring


def missing_sketches(wiring: Wiring, directory: Path) -> Iterator[Problem]:
    """Problems with sketches that are not where the wiring says."""
    for board in wiring.boards.values():
        path = directory / board.sketch
        place = board.place_of("sketch")
        try:
            if path.is_dir():
                if not any(path.glob("*.ino")):
                    yield Problem(place, f'"{cut(board.sketch)}" has no .ino file')
            elif not path.exists():
                there = [
                    each.relative_to(directory).as_posix() for each in sorted(directory.glob("**/*.ino"))
                ]
                hint = did_you_mean(board.sketch, there) or "; its path begins at the set's folder"
                yield Problem(place, f'there is no sketch "{cut(board.sketch)}"{hint}')
            elif path.suffix.lower() not in SKETCH_ENDINGS:
                yield Problem(place, f'must be an .ino file or its folder, not "{cut(board.sketch)}"')
        except (OSError, ValueError):
            yield Problem(place, f'"{cut(board.sketch)}" cannot be a path')


# Inputs of several parts at one output: enables, brakes and steps of both motors, the trigger of several
# sonars, and a line that goes on to a second listener. All parts of a bus are at its two wires.
_SHARED = (
    *({"en"}, {"brake"}, {"enable"}, {"dir"}, {"step"}, {"trig"}),
    *({"tx", "from"}, {"sda"}, {"scl"}),
)


def pins_used_twice(wiring: Wiring) -> Iterator[Problem]:
    """Problems with pins that two parts use in ways that exclude each other."""
    first: dict[tuple[str, int], PinUse] = {}
    for use in wiring.pin_uses():
        other = first.setdefault((use.board, use.pin), use)
        names = {use.name, other.name}
        # NewPing can send and listen on one pin.
        is_one_pin_sonar = use.label == other.label and names == {"trig", "echo"}
        if other is use or is_one_pin_sonar or any(names <= allowed for allowed in _SHARED):
            continue
        kind = wiring.boards[use.board].kind
        what = f"pin {kind.pin_name(use.pin)} of {use.board} is already {other.name} of {other.label}"
        yield Problem(use.place, f"{what} ({other.place}); give each its own pin")


def _inputs_written(wiring: Wiring) -> Iterator[Problem]:
    """Problems with pins that cannot be outputs."""
    for use in wiring.pin_uses():
        kind = wiring.boards[use.board].kind
        if use.writes and use.pin in kind.inputs:
            inputs = ", ".join(map(str, sorted(kind.inputs)))
            yield Problem(use.place, f"pin {use.pin} of the {kind.title} is an input alone, as are {inputs}")


def _addresses_used_twice(wiring: Wiring) -> Iterator[Problem]:
    """Problems with parts of a bus that nothing tells apart."""
    seen: dict[tuple[str, int], WiredI2c] = {}
    without_xshut: dict[str, WiredI2c] = {}
    for each in wiring.sensors:
        if not isinstance(each, WiredI2c):
            continue
        other = None
        if isinstance(each, WiredRanger) and each.xshut is None:
            other = without_xshut.setdefault(each.board, each)
            if other is not each:
                what = f"{other.label} has no xshut either, so both begin at {RANGER_ADDRESS:#x} together"
                yield Problem(each.place, f"{what}; wire the XSHUT of one to a pin, or leave one part out")
                continue
        # Without the key, the sketch gives it an address that is not known here.
        if isinstance(each, WiredRanger) and "address" not in each.places:
            continue
        other = seen.setdefault((each.board, each.address), each)
        if other is not each:
            what = f"{each.address:#x} is the address of {other.label} already ({other.place})"
            yield Problem(each.place_of("address"), f"{what}; each part on a bus has its own")


class _WiringReader:
    """Reads one file. A row with a mistake is a problem, and left out."""

    def __init__(self, file: TomlFile, parts: WiringParts, problems: list[Problem]) -> None:
        self._file, self._problems = file, problems
        self._sensors = {each.code: each for each in parts.sensors}
        self._wheels = WHEEL_NAMES[parts.wheels.layout] if parts.wheels is not None else ()
        self._top_speed = parts.wheels.top_speed if parts.wheels is not None else 0.0
        self._boards: dict[str, SketchBoard] = {}
        self._named: set[str] = set()

    def wiring(self) -> Wiring:
        """The wiring of the whole file."""
        file = self._file
        file.check_names(file.tree, wiring_toml.TABLES, listed_as="tables")
        self._read_boards()
        laptop = self._laptop()
        wires = tuple(self._wires())
        motors, sensors = tuple(self._motors()), tuple(self._sensor_rows())
        self._check_wheels(motors)
        steppers = tuple(each for each in motors if isinstance(each, WiredStepper))
        return Wiring(
            boards=self._boards,
            laptop=laptop,
            wires=wires,
            motors=tuple(each for each in motors if isinstance(each, WiredMotor)),
            steppers=steppers,
            sensors=sensors,
            servos=tuple(self._servos()),
        )

    # -- boards and lines --------------------------------------------------------------------------

    def _read_boards(self) -> None:
        file, tables = self._file, self._file.table("boards")
        if not tables:
            file.add_problem("boards", "is missing; add [boards.NAME] with sketch and board for each board")
        if len(tables) > _MOST_ROWS["boards"]:
            file.add_problem(
                "boards", f"has {len(tables)} boards; at most {_MOST_ROWS['boards']} are simulated"
            )
        for name, given in list(tables.items())[: _MOST_ROWS["boards"]]:
            prefix = f"boards.{name}"
            self._named.add(name)
            if not isinstance(given, dict):
                file.add_problem(prefix, f"must be a table: [{cut(prefix)}]")
                continue
            if not name.isidentifier():
                file.add_problem(prefix, "is no name for a board: letters, digits and _")
            before = file.mistakes
            values = file.values(wiring_toml.BOARD_TABLE, given, f"{prefix}.", needed=True)
            if file.mistakes == before:
                self._boards[name] = SketchBoard(
                    **self._base(prefix, given),
                    name=name,
                    sketch=values["sketch"],
                    kind=BOARDS[values["board"]],
                )

    def _laptop(self) -> LaptopLine | None:
        given = self._file.table("laptop")
        # An empty table lacks its board; without the table no laptop is wired.
        if not given and self._file.tree.get("laptop") != {}:
            return None
        values = self._row(given, "laptop", wiring_toml.LAPTOP, ("rx", "tx", "bluetooth", "baud"))
        if values is None:
            return None
        # The USB port is that of Serial.
        kind = self._boards[values["board"]].kind
        if values.get("bluetooth"):
            return self._bluetooth(kind, given, values)
        pins = {
            name: self._pin_of(kind, values.get(name, usual), f"laptop.{name}")
            for name, usual in zip(("rx", "tx"), kind.usb, strict=True)
        }
        if pins["rx"] is None or pins["tx"] is None:
            return None
        return LaptopLine(
            **self._base("laptop", given),
            board=values["board"],
            rx=pins["rx"],
            tx=pins["tx"],
            baud=values.get("baud"),
        )

    def _bluetooth(
        self, kind: BoardKind, given: Mapping[str, Any], values: Mapping[str, Any]
    ) -> LaptopLine | None:
        """The line to the laptop by the board's own Bluetooth."""
        if kind.bluetooth is None:
            what = f"the {kind.title} has no Bluetooth of its own; give the pins of its module, rx and tx"
            self._file.add_problem("laptop.bluetooth", what)
            return None
        for name in ("rx", "tx", "baud"):
            if name in values:
                self._file.add_problem(f"laptop.{name}", "goes with a serial port; bluetooth has none")
                return None
        rx, tx = kind.bluetooth
        base = self._base("laptop", given)
        return LaptopLine(**base, board=values["board"], rx=rx, tx=tx, baud=None)

    def _wires(self) -> Iterator[BoardWire]:
        file = self._file
        for prefix, given in self._rows("wires"):
            values = file.values(wiring_toml.WIRE, given, f"{prefix}.", needed=True)
            ends = [
                self._endpoint(values[name], f"{prefix}.{name}") for name in ("from", "to") if name in values
            ]
            if len(ends) < 2 or ends[0] is None or ends[1] is None:
                continue
            (sender, tx), (receiver, rx) = ends[0], ends[1]
            if sender == receiver:
                file.add_problem(f"{prefix}.to", f"must be a pin of another board than {sender}")
                continue
            base = self._base(prefix, given)
            yield BoardWire(**base, from_board=sender, tx=tx, to_board=receiver, rx=rx)

    def _endpoint(self, given: str, place: str) -> tuple[str, int] | None:
        """The board and pin of `sensor.A0`; None, and a problem, if there is none such."""
        name, dot, pin = given.partition(".")
        if not dot:
            self._file.add_problem(place, f'must be a board and a pin, such as "rover.9", not "{cut(given)}"')
            return None
        kind = self._kind_of(name, place)
        try:
            number = wiring_toml.PinRule().check(pin)
        except ValueError as error:
            self._file.add_problem(place, str(error))
            return None
        found = None if kind is None else self._pin_of(kind, number, place)
        return None if found is None else (name, found)

    # -- motors, sensors, servos -------------------------------------------------------------------

    def _motors(self) -> Iterator[WiredMotor | WiredStepper]:
        optional = (*wiring_toml.MOTOR_OPTIONAL, *wiring_toml.OPTIONAL_PINS)
        defaults = {value.name: value.default for value in wiring_toml.all_keys("motors")}
        for prefix, given in self._rows("motors"):
            keys = self._keys_of_kind(given, prefix, "driver", wiring_toml.DRIVER_KEYS)
            values = self._row(given, prefix, (*wiring_toml.MOTOR, *keys), optional)
            if values is None:
                continue
            board, driver = values["board"], values["driver"]
            pin_keys = [key for key in keys if isinstance(key.rule, wiring_toml.PinRule)]
            found = self._pins(board, pin_keys, values, prefix)
            wheel = self._wheel_index(values["wheel"], f"{prefix}.wheel")
            if found is None or wheel is None:
                continue
            common = {
                **self._base(prefix, given),
                "board": board,
                "pins": found,
                "wheel": self._wheels[wheel],
                "wheel_index": wheel,
                "reversed": values.get("reversed", defaults["reversed"]),
            }
            if driver in _STEPPERS:
                yield WiredStepper(
                    **common,
                    driver=StepperDriver(driver),
                    steps_per_inch=values["steps_per_inch"],
                    top_speed=self._top_speed,
                    enable_high=values.get("enable_on") == "high",
                )
                continue
            yield WiredMotor(
                **common,
                driver=MotorDriver(driver),
                top_speed=values["top_speed"],
                dead_band=values.get("dead_band", defaults["dead_band"]),
                full_pulse=values.get("full_pulse", defaults["full_pulse"]),
            )

    def _sensor_rows(self) -> Iterator[WiredSensor]:
        codes: dict[str, str] = {}
        for prefix, given in self._rows("sensors"):
            keys = self._keys_of_kind(given, prefix, "part", wiring_toml.PART_KEYS)
            is_encoder = str(given.get("part")).strip().lower() == "encoder"
            base = wiring_toml.PART[1:] if is_encoder else wiring_toml.PART
            values = self._row(given, prefix, (*base, *keys), wiring_toml.PART_OPTIONAL)
            if values is None:
                continue
            pin_keys = [key for key in keys if isinstance(key.rule, wiring_toml.PinRule)]
            pins = self._pins(values["board"], pin_keys, values, prefix, analog=values["part"] == "analog")
            common = {**self._base(prefix, given), "board": values["board"]}
            if is_encoder:
                wheel = self._wheel_index(values["wheel"], f"{prefix}.wheel")
                if pins is not None and wheel is not None:
                    yield WiredEncoder(
                        **common,
                        wheel=self._wheels[wheel],
                        wheel_index=wheel,
                        a=pins["a"],
                        b=pins.get("b"),
                        edges_per_inch=values["edges_per_inch"],
                    )
                continue
            code = self._code(values["code"], f"{prefix}.code", values["part"], codes)
            if not code or pins is None:
                continue
            common["code"] = code
            if values["part"] == "mpu6050":
                address = values.get("address", GYRO_ADDRESSES[0])
                if address in GYRO_ADDRESSES:
                    yield WiredGyro(**common, address=address, interrupt=pins.get("int"))
                else:
                    what = f"an MPU6050 is at 0x68, with AD0 high at 0x69, never at {address:#x}"
                    self._file.add_problem(f"{prefix}.address", what)
            elif values["part"] == "vl53l0x":
                address = values.get("address", RANGER_ADDRESS)
                xshut = pins.get("xshut")
                yield WiredRanger(**common, address=address, xshut=xshut, interrupt=pins.get("int"))
            elif values["part"] == "hc-sr04":
                yield WiredSonar(**common, trig=pins["trig"], echo=pins["echo"])
            elif values["part"] == "line":
                yield WiredLineSensor(**common, pin=pins["pin"], active_high=values.get("active") != "low")
            elif self._is_analog(values["board"], pins["pin"], values["points"], prefix):
                yield WiredAnalog(**common, pin=pins["pin"], points=values["points"])

    def _servos(self) -> Iterator[WiredServo]:
        file, gripper = self._file, ""
        for prefix, given in self._rows("servos"):
            values = self._row(given, prefix, wiring_toml.SERVO, (), others=("gripper",))
            angles: dict[str, Any] = {}
            if "gripper" in given:
                if not isinstance(given["gripper"], dict):
                    file.add_problem(f"{prefix}.gripper", "must be { open = ANGLE, closed = ANGLE }")
                    continue
                inner = f"{prefix}.gripper."
                angles = file.values(wiring_toml.GRIPPER_ANGLES, given["gripper"], inner, needed=True)
                if len(angles) == 2 and angles["open"] == angles["closed"]:
                    file.add_problem(f"{prefix}.gripper", "open and closed must be two different angles")
                if gripper:
                    file.add_problem(f"{prefix}.gripper", f"is {gripper} already; a robot has one gripper")
                gripper = gripper or label_of(prefix)
            if values is None:
                continue
            found = self._pins(values["board"], wiring_toml.SERVO[1:], values, prefix)
            if found is not None:
                yield WiredServo(
                    **self._base(prefix, given),
                    board=values["board"],
                    pin=found["pin"],
                    open=angles.get("open"),
                    closed=angles.get("closed"),
                )

    # -- rows, boards, pins, wheels ----------------------------------------------------------------

    def _base(self, prefix: str, given: Mapping[str, Any]) -> dict[str, Any]:
        """The label of a row, and the places of its keys."""
        places = {key: self._file.place(f"{prefix}.{key}") for key in given}
        return {"label": label_of(prefix), "places": {**places, "": self._file.place(prefix)}}

    def _rows(self, name: str) -> Iterator[tuple[str, dict[str, Any]]]:
        """The rows of an array of tables, each with its name in the file; too many are a problem."""
        rows, most = self._file.tables(name), _MOST_ROWS[name]
        if len(rows) > most:
            self._file.add_problem(name, f"has {len(rows)} rows; at most {most} are simulated")
        for number, row in enumerate(rows[:most], 1):
            yield f"{name}.{number}", row

    def _row(
        self,
        given: Mapping[str, Any],
        prefix: str,
        keys: Sequence[Value],
        optional: Collection[str],
        others: Collection[str] = (),
    ) -> dict[str, Any] | None:
        """The values of a row; None, and problems, if it has mistakes or a board that there is not."""
        file, before = self._file, self._file.mistakes
        for key in keys:
            if key.name not in given and key.name not in optional:
                file.add_problem(
                    f"{prefix}.{key.name}", key.with_unit(f"is missing; must be {key.rule.allowed}")
                )
        values = file.values(keys, given, f"{prefix}.", others=others)
        kind = self._kind_of(values["board"], f"{prefix}.board") if "board" in values else None
        return None if kind is None or file.mistakes > before else values

    def _keys_of_kind(
        self, given: Mapping[str, Any], prefix: str, key: str, kinds: Mapping[str, tuple[Value, ...]]
    ) -> tuple[Value, ...]:
        """The keys of a driver or part. Of an unknown one all that are given: its name is the problem."""
        kind = str(given.get(key)).strip().lower()
        if kind in kinds:
            return kinds[kind]
        found = {value.name: value for values in kinds.values() for value in values}
        return tuple(value for name, value in found.items() if name in given)

    def _kind_of(self, name: str, place: str) -> BoardKind | None:
        """The kind of a board by name; None if it has mistakes, and a problem if there is none."""
        if name in self._boards:
            return self._boards[name].kind
        if name not in self._named:
            known = ", ".join(self._named) or "none"
            hint = did_you_mean(name, self._named) or f"; there are {cut(known)}"
            self._file.add_problem(place, f'there is no board "{cut(name)}"{hint}')
        return None

    def _pin_of(self, kind: BoardKind, given: int | str, place: str) -> int | None:
        """The number of a pin; None, and a problem, if the board does not have it."""
        pin = kind.pin(given)
        if pin is None:
            self._file.add_problem(place, f"the {kind.title} has no pin {given}; it has {kind.pin_names}")
        return pin

    def _pins(
        self,
        board: str,
        keys: Sequence[Value],
        values: Mapping[str, Any],
        prefix: str,
        *,
        analog: bool = False,
    ) -> dict[str, int] | None:
        """The numbers of a row's pins by name; None, and problems, if the board lacks one."""
        kind = self._boards[board].kind
        found: dict[str, int] = {}
        wrong = False
        names = {key.name for key in keys}
        for name in (each for each in values if each in names):
            place = f"{prefix}.{name}"
            pin = self._pin_of(kind, values[name], place)
            if pin is None:
                wrong = True
                continue
            if pin in kind.analog_only and not analog:
                self._file.add_problem(
                    place, f"{kind.pin_name(pin)} of the {kind.title} is for analogRead only"
                )
                wrong = True
            found[name] = pin
        return None if wrong else found

    def _is_analog(self, board: str, pin: int, points: Sequence[tuple[float, float]], prefix: str) -> bool:
        """True if analogRead can read a pin, and gives these counts."""
        kind = self._boards[board].kind
        place = f"{prefix}.pin"
        most = max(count for _, count in points)
        if most > kind.most_counts:
            what = f"has the count {most:g}; analogRead of the {kind.title} gives {kind.most_counts} at most"
            self._file.add_problem(f"{prefix}.points", what)
            return False
        if not kind.is_analog(pin):
            what = f"must be an analog pin, {kind.analog_text}, not {kind.pin_name(pin)}"
            self._file.add_problem(place, what)
        return kind.is_analog(pin)

    def _wheel_index(self, name: str, place: str) -> int | None:
        """The index of a wheel by name; None, and a problem, if the set has none such."""
        word = name.strip().lower()
        layouts = [layout for layout, names in WHEEL_NAMES.items() if word in names]
        if not self._wheels:
            usual = next(iter(layouts), WheelLayout.DIFF)
            what = f"the set has no wheels; set [wheels] layout in settings.toml, such as {usual}"
            self._file.add_problem(place, what)
            return None
        if word not in self._wheels:
            hint = did_you_mean(name, self._wheels) or f"; there are {', '.join(self._wheels)}"
            if layouts:
                there = ", ".join(self._wheels)
                hint = f"; [wheels] layout in settings.toml has {there}, and {layouts[0]} has it"
            self._file.add_problem(place, f'there is no wheel "{cut(name)}"{hint}')
            return None
        return self._wheels.index(word)

    def _code(self, code: str, place: str, part: str, seen: dict[str, str]) -> str:
        """A sensor's code; empty, and a problem, if sensors.csv has none that the part can be."""
        sensor = self._sensors.get(code)
        what = ""
        if sensor is None:
            known = ", ".join(self._sensors) or "none"
            hint = did_you_mean(code, self._sensors) or f"; there are {cut(known)}"
            what = f'no row of sensors.csv has the code "{cut(code)}"{hint}'
        elif code in seen:
            what = f"{code} is at {seen[code]} already; a sensor has one part"
        elif part == "hc-sr04" and not sensor.kind.is_range:
            what = f"{code} is {sensor.id}, which measures no distance; an hc-sr04 does"
        elif part == "vl53l0x" and not sensor.kind.is_range:
            what = f"{code} is {sensor.id}, which measures no distance; a vl53l0x does"
        elif part == "mpu6050" and not (sensor.kind.counts and sensor.kind.unit == "deg"):
            what = f"{code} is {sensor.id}, which is no gyro; an mpu6050 is one"
        elif part == "line" and not sensor.is_yes_or_no:
            what = f'{code} is {sensor.id}, which does not read 0 or 1; use part = "analog"'
        if what:
            self._file.add_problem(place, what)
            return ""
        seen[code] = self._file.place(place.rpartition(".")[0])
        return code

    def _check_wheels(self, motors: Sequence[WiredMotor | WiredStepper]) -> None:
        """Report a wheel that has two motors."""
        seen: dict[str, str] = {}
        for motor in motors:
            if motor.wheel in seen:
                what = (
                    f'the wheel "{motor.wheel}" has {seen[motor.wheel]}; motors that run together are one row'
                )
                self._problems.append(Problem(motor.place_of("wheel"), what))
            seen.setdefault(motor.wheel, motor.label)


def label_of(name: str) -> str:
    """The name of a row in messages: `motors[1]` for `motors.1`."""
    table, _, number = name.partition(".")
    return f"{table}[{number}]" if number.isdecimal() else name
