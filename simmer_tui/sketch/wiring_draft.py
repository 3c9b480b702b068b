"""A draft of a wiring.toml from the text of sketches, for `init --sketch`.

Pins are read off constants, constructors, attachInterrupt and the order of writes: a team sets the direction
of a motor right before, or after, its duty. A value that no sketch can tell is marked `# ?`: which wheel is
left, speeds, the sensor's place, the wire between boards.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import count
from pathlib import Path

from msgspec import Struct

from simmer_tui.config.set_sketches import library_paths
from simmer_tui.errors import ConfigurationError, Problem, printable
from simmer_tui.sim.rules import MAX_TEXT, TextRule
from simmer_tui.sketch.boards import BOARDS, ESP32, UNO, BoardKind
from simmer_tui.sketch.bus_draft import draft_gyros, draft_rangers
from simmer_tui.sketch.gripper_draft import drafted_angles, gripper_of
from simmer_tui.sketch.known_headers import is_provided
from simmer_tui.sketch.motion_check import forward_levels
from simmer_tui.sketch.motor_draft import END, draft_motors, oriented
from simmer_tui.sketch.servo_draft import attached_servos, draft_servo_wheels
from simmer_tui.sketch.side_draft import WHEELS, side_of_pins, sides_by_turns
from simmer_tui.sketch.sketch_scan import SketchFacts, SketchPort
from simmer_tui.sketch.sketch_source import SketchCall
from simmer_tui.sketch.sketch_steps import PULSES, WRITES, SketchStep, pulses, steps
from simmer_tui.sketch.sketch_values import Pins
from simmer_tui.sketch.stepper_draft import draft_steppers
from simmer_tui.sketch.wiring import GYRO_ADDRESSES

_TRIGGER, _ECHO = (re.compile(word, re.IGNORECASE) for word in ("trig", "echo"))
_ESP32_HEADERS = frozenset(
    ("bluetoothserial.h", "esp32servo.h", "wifi.h", "esp_now.h", "freertos/freertos.h")
)
_ESP32_CALL = re.compile(
    r"ledc[A-Z]\w+|xTaskCreatePinnedToCore|xPortGetCoreID|esp_\w+|portENTER_CRITICAL_ISR"
)
"""Headers and calls of an ESP32 alone."""
_MARK = "  # ?"
_BY_NAME = "  # by the names in the sketch"
_HEAD = """\
# A draft, read off the sketch. A line with "# ?" is a guess: look at it, then take the mark away.
# simmer-tui check tells what does not fit. docs/sketch.md explains every part.
"""
_BEAM_ROW, _GYRO_ROW = "tof{0},t{0},1,3,0,4,0,0.03,25,", "gyro{0},g{0},1,0,0,4,0,0.01,,"
_RANGE_ROW, _LINE_ROW = "ultra{0},u{0},1,3,0,6,0,0.02,5,", "ir{0},i{0},1,2,0,1,0,0.05,40,0.8"
"""Rows of sensors.csv, in front of the robot and beneath it."""
_STEPS = "steps_per_inch = 100  # ? steps of a turn (with microsteps) / (3.14 x diameter of the wheel)"
_SPEED = "top_speed = 12  # ? in/s at full duty: time it over a measured distance"


class DraftSonar(Struct, frozen=True):
    """A sonar that was read off a sketch."""

    trig: int
    echo: int


class DraftEncoder(Struct, frozen=True):
    """An encoder that was read off a sketch; `b` is None without a second channel."""

    a: int
    b: int | None
    side: str
    """The wheel, `left` or `right`, as its names tell it; empty if they do not."""


class BoardDraft:
    """The parts of one board that its sketch shows."""

    def __init__(self, name: str, sketch: str, facts: SketchFacts) -> None:
        self.name, self.sketch, self.facts = name, sketch, facts
        written_steps = [END if step is None else step for step in steps(facts)]
        self.sonars = list(_sonars(facts, written_steps))
        echoes = {each.echo for each in self.sonars}
        pulsed = [facts.pins(call) for call in facts.named(*PULSES)]
        self.has_lost_pulses = any(not self.sonars if pins is None else pins - echoes for pins in pulsed)
        """True if it waits for pulses at pins that are no sonar's as far as was found."""
        self.servos = sorted({pin for call in attached_servos(facts) for pin in facts.pins(call) or ()})
        self.ports = facts.ports()
        taken = {pin for each in self.sonars for pin in (each.trig, each.echo)} | {*self.servos}
        taken |= {pin for port in self.ports for pins in (port.rx, port.tx) for pin in pins or ()}
        taken |= {pin for call in facts.objects("LiquidCrystal") for pin in _all_pins(facts, call)}
        self.steppers = draft_steppers(facts, taken)
        taken |= {pin for stepper in self.steppers for pin in stepper.pins.values()}
        self.gyros, self.rangers = draft_gyros(facts), draft_rangers(facts)
        taken |= {each.interrupt for each in self.gyros if each.interrupt is not None}
        taken |= {each.xshut for each in self.rangers if each.xshut is not None}
        ahead = forward_levels(facts)
        found = draft_motors([each for each in written_steps if each.pin not in taken])
        if self.steppers:
            # The enables of their coils have a duty, and no direction.
            found = [each for each in found if each.driver == "hbridge"]
        self.motors = [oriented(each, ahead) for each in found]
        if not self.motors and not self.steppers:
            self.motors = draft_servo_wheels(facts)
            self.servos = [pin for pin in self.servos if all(pin != each.pins["pin"] for each in self.motors)]
        every = [each.pins for each in self.steppers] + [each.pins for each in self.motors]
        self.sides = [side_of_pins(facts, pins.values()) for pins in every]
        """The wheels of its steppers and motors by names in the sketch; empty if these do not tell them."""
        self.turns = ["" for _ in self.steppers] + sides_by_turns(facts, self.motors)
        """The same by the functions that turn the robot."""
        self.encoders = list(_encoders(facts, taken))
        taken |= {pin for motor in self.motors for pin in motor.pins.values()}
        taken |= {pin for each in self.encoders for pin in (each.a, each.b) if pin is not None}
        self.analog = sorted(_read(facts, "analogRead") - taken - _seeds(facts))
        self.analog = [pin for pin in self.analog if facts.kind.is_analog(pin)]
        written = _read(facts, "digitalWrite")
        self.digital = sorted(_read(facts, "digitalRead") - taken - {*self.analog} - written)
        grouped = {pin for motor in self.motors for pin in motor.pins.values()}
        self.loose = sorted(
            {each.pin for each in written_steps if each.call == "analogWrite"} - grouped - taken
        )
        """Pins with a PWM whose motor was not found."""


def draft(
    sketches: Sequence[Path],
    directory: Path,
    ranges: Sequence[str],
    lines: Sequence[str],
    beams: Sequence[str] = (),
    gyros: Sequence[str] = (),
) -> str:
    """The text of a wiring.toml for sketches, a board each.

    Args:
        sketches: The .ino files, or their folders.
        directory: The folder of the set, from which the paths of sketches begin.
        ranges: The codes of the set's range sensors, in order.
        lines: The codes of its other sensors that a pin can read.
        beams: The codes of its time-of-flight sensors.
        gyros: The codes of its gyros.

    Raises OSError or ValueError for a sketch that cannot be read, and ConfigurationError for one whose path
    wiring.toml does not take.
    """
    boards: list[BoardDraft] = []
    for sketch in sketches:
        name = _board_name(sketch, [board.name for board in boards])
        facts = SketchFacts.read(sketch, UNO)
        kind = _kind(facts)
        if kind is not UNO:
            facts = SketchFacts.read(sketch, kind)
        boards.append(BoardDraft(name, _path_from(directory, sketch), facts))
    text = [_HEAD]
    for board in boards:
        sure = "" if board.facts.kind.name != "uno" else "  # ? or nano"
        # Strings of JSON are strings of TOML.
        path = json.dumps(board.sketch, ensure_ascii=False)
        text.append(f'[boards.{board.name}]\nsketch = {path}\nboard = "{board.facts.kind.name}"{sure}\n')
    for board, sketch in zip(boards, sketches, strict=True):
        folder = sketch if sketch.is_dir() else sketch.parent
        own = {*board.facts.files, *(path.rpartition("/")[2] for _, path in library_paths(folder))}
        for header, spot in board.facts.includes:
            if not is_provided(header, own):
                # A comment of TOML has no control characters.
                shown = printable(header)
                text.append(f"# {spot} has {shown}, which is not there yet: see the end of docs/sketch.md\n")
    text += _line_tables(boards)
    wheels = _Wheels(side for board in boards for side in board.sides)
    for board in boards:
        turning = [wheels.line(*each) for each in zip(board.sides, board.turns, strict=True)]
        text += _stepper_tables(board, turning)
        text += _motor_tables(board, turning[len(board.steppers) :])
    codes, others = _Codes(ranges, "u", _RANGE_ROW), _Codes(lines, "i", _LINE_ROW)
    on_bus = _Codes(beams, "t", _BEAM_ROW), _Codes(gyros, "g", _GYRO_ROW)
    for board in boards:
        text += _sensor_tables(board, codes, others)
        text += _bus_tables(board, *on_bus)
        text += _servo_tables(board)
    return "\n".join(text)


# -- reading ---------------------------------------------------------------------------------------


def _sonars(facts: SketchFacts, steps: Sequence[SketchStep]) -> Iterator[DraftSonar]:
    found: dict[int, DraftSonar] = {}
    for call in facts.objects("NewPing"):
        trig, echo = facts.pins(call, 0), facts.pins(call, 1)
        if trig and echo and len(trig) == len(echo) == 1:
            each = DraftSonar(next(iter(trig)), next(iter(echo)))
            found.setdefault(each.echo, each)
    written = -1
    for step in steps:
        if step.call == "digitalWrite":
            written = step.pin
        elif step.call in PULSES and written >= 0 and written != step.pin:
            found.setdefault(step.pin, DraftSonar(written, step.pin))
    for written, pulsed in pulses(facts):
        found.setdefault(pulsed, DraftSonar(written, pulsed))
    yield from found.values()
    # An echo by interrupt or by digitalRead has no call that tells its trigger: the names do.
    trigs = [step.pin for step in steps if step.call == "digitalWrite" and _TRIGGER.search(step.name)]
    names = {
        pin: facts.spelled(call) for call in facts.named("digitalRead") for pin in facts.pins(call) or ()
    }
    for interrupt in facts.interrupts():
        for pin in interrupt.pins or ():
            names[pin] = f"{names.get(pin, '')} {interrupt.function}"
    echoes = [pin for pin, name in names.items() if _ECHO.search(name) and pin not in found]
    known = {sonar.trig for sonar in found.values()}
    trigs = [pin for pin in dict.fromkeys(trigs) if pin not in known]
    if trigs:
        for at, pin in enumerate(echoes):
            yield DraftSonar(trigs[min(at, len(trigs) - 1)], pin)


def _encoders(facts: SketchFacts, taken: set[int]) -> Iterator[DraftEncoder]:
    seen: set[int] = set()
    for each in facts.interrupts():
        pins = each.pins or Pins()
        if len(pins) != 1 or pins & (taken | seen) or _ECHO.search(each.function):
            continue
        (a,) = pins
        read = {
            pin
            for call in facts.named("digitalRead")
            if call.function == each.function
            for pin in facts.pins(call) or ()
        }
        others = sorted(read - {a} - taken)
        b = others[0] if len(others) == 1 else None
        seen |= {a} | ({b} if b is not None else set())
        yield DraftEncoder(a, b, side_of_pins(facts, {a} if b is None else {a, b}))


def _all_pins(facts: SketchFacts, call: SketchCall) -> set[int]:
    return {pin for at in range(len(call.arguments)) for pin in facts.pins(call, at) or ()}


def _read(facts: SketchFacts, name: str) -> set[int]:
    return {pin for call in facts.named(name) for pin in facts.pins(call) or ()}


def _seeds(facts: SketchFacts) -> set[int]:
    """The open pins whose noise is a seed: `randomSeed(analogRead(A3))`."""
    after = {call.order + 1 for call in facts.named("randomSeed")}
    return {
        pin for call in facts.named("analogRead") if call.order in after for pin in facts.pins(call) or ()
    }


def _kind(facts: SketchFacts) -> BoardKind:
    """The board that a sketch needs: an ESP32 for its libraries and calls; a Mega for its further ports or
    a pin that an Uno lacks, or for two pins that have a PWM on a Mega alone."""
    of_esp32 = any(name.lower() in _ESP32_HEADERS for name, _ in facts.includes)
    if of_esp32 or any(_ESP32_CALL.fullmatch(call.name) for call in facts.calls):
        return ESP32
    is_mega = any(call.object in ("Serial1", "Serial2", "Serial3") for call in facts.calls)
    for call in facts.named(*WRITES, *PULSES, "digitalRead", "pinMode"):
        is_mega |= any(UNO.pins <= pin < BOARDS["mega"].pins for pin in facts.pins(call) or ())
    for kind in ("AccelStepper", "Stepper", "LiquidCrystal"):
        for call in facts.objects(kind):
            # The first argument of a stepper is its kind, or its steps a turn.
            first = 0 if kind == "LiquidCrystal" else 1
            pins = (facts.pins(call, at) or () for at in range(first, len(call.arguments)))
            is_mega |= any(UNO.pins <= pin < BOARDS["mega"].pins for each in pins for pin in each)
    duties = {pin for call in facts.named("analogWrite") for pin in facts.pins(call) or ()}
    return BOARDS["mega"] if is_mega or len(duties & (BOARDS["mega"].pwm - UNO.pwm)) > 1 else UNO


# -- writing ---------------------------------------------------------------------------------------


def _board_name(sketch: Path, taken: Sequence[str]) -> str:
    name = re.sub(r"\W+", "_", sketch.stem, flags=re.ASCII).strip("_").lower() or "board"
    name = f"board_{name}" if name[0].isdigit() else name
    return name if name not in taken else f"{name}_{len(taken) + 1}"


def _path_from(directory: Path, sketch: Path) -> str:
    """The path of a sketch from the set's folder, as wiring.toml takes it. Raises ConfigurationError."""
    # Without links: the system follows a link before it goes up from it.
    target = os.path.join(os.path.realpath(sketch.parent), sketch.name)  # noqa: PTH118 - "." has no name
    try:
        path = Path(os.path.relpath(target, os.path.realpath(directory))).as_posix()
    except ValueError:  # another drive of Windows
        path = Path(target).as_posix()
    # A reader drops the spaces around a text.
    path = f"./{path}" if path.startswith(" ") else path
    path = f"{path}/" if path.endswith(" ") else path
    try:
        return TextRule().check(path)
    except ValueError:
        what = (
            f"wiring.toml takes a path of at most {MAX_TEXT} printable characters: rename or move the sketch"
        )
        raise ConfigurationError([Problem(str(sketch), what)]) from None


def _pin(board: BoardDraft, pin: int) -> str:
    name = board.facts.kind.pin_name(pin)
    return name if name.isdecimal() else f'"{name}"'


def _single(pins: Pins | None) -> int | None:
    return next(iter(pins)) if pins is not None and len(pins) == 1 else None


def _line_tables(boards: Sequence[BoardDraft]) -> Iterator[str]:
    """The line to the laptop, and the wires between two boards."""
    ports = [
        (board, port)
        for board in boards
        for port in board.ports
        if _single(port.rx) is not None and _single(port.tx) is not None
    ]
    links = _links(boards, ports)
    linked = {(board.name, port.name) for pair in links for board, port in pair}
    free = [(board, port) for board, port in ports if (board.name, port.name) not in linked]
    # A Bluetooth module on SoftwareSerial is the laptop's line before the USB port, which prints notes.
    # One that is not begun sends nothing.
    free = [each for each in free if each[1].begin_spot] or free
    free.sort(key=lambda each: each[1].name in each[0].facts.kind.serial)
    if free:
        board, port = free[0]
        sure = "" if len(free) == 1 else _MARK
        lines = [f'[laptop]\nboard = "{board.name}"{sure}']
        lines += [f"{each}{sure}" for each in _port_keys(board, port)]
        for at, other in free[1:]:
            lines.append(f"# or {other.name} of {at.name}: {', '.join(_port_keys(at, other))}")
        yield "\n".join(lines) + "\n"
    for (one, first), (two, second) in links:
        there, back = (one, first.tx, two, second.rx), (two, second.tx, one, first.rx)
        for sender, sends, receiver, receives in (there, back):
            start = f"{sender.name}.{sender.facts.kind.pin_name(min(sends or (0,)))}"
            end = f"{receiver.name}.{receiver.facts.kind.pin_name(min(receives or (0,)))}"
            yield f'[[wires]]{_MARK}\nfrom = "{start}"\nto = "{end}"\n'


def _port_keys(board: BoardDraft, port: SketchPort) -> list[str]:
    rx, tx = min(port.rx or (0,)), min(port.tx or (0,))
    if (rx, tx) == board.facts.kind.bluetooth:
        return ["bluetooth = true"]
    return [f"rx = {_pin(board, rx)}", f"tx = {_pin(board, tx)}"]


_Port = tuple[BoardDraft, SketchPort]


def _links(boards: Sequence[BoardDraft], ports: Sequence[_Port]) -> list[tuple[_Port, _Port]]:
    """The likely line between two boards: the last port of each with the same rate, one of them left for the
    laptop."""
    if len(boards) != 2:
        return []
    sides = [[each for each in ports if each[0] is board] for board in boards]
    for one in reversed(sides[0]):
        for two in reversed(sides[1]):
            if set(one[1].bauds) & set(two[1].bauds) and len(ports) > 2:
                return [(one, two)]
    return []


class _Wheels:
    """The wheels of motors or encoders: those that names tell, and of the others those that are left."""

    def __init__(self, sides: Iterable[str], what: str = "which wheel of [wheels] in settings.toml") -> None:
        taken = {*sides}
        self._left, self._what = [each for each in WHEELS if each not in taken], what

    def line(self, side: str, turn: str = "") -> str:
        """The line of the next one: its side by its names, or that by a function that turns the robot."""
        if side:
            return f'wheel = "{side}"{_BY_NAME}'
        if turn not in self._left:
            turn = self._left[0] if self._left else WHEELS[0]
        self._left = [each for each in self._left if each != turn]
        return f'wheel = "{turn}"{_MARK} {self._what}'


def _stepper_tables(board: BoardDraft, wheels: Sequence[str]) -> Iterator[str]:
    for stepper, wheel in zip(board.steppers, wheels, strict=False):
        pins = "\n".join(f"{name} = {_pin(board, pin)}" for name, pin in stepper.pins.items())
        turned = f"reversed = true{_MARK}\n" if stepper.reversed else ""
        level = 'enable_on = "high"  # ? most drivers are on at LOW\n' if stepper.enable_high else ""
        yield (
            f'[[motors]]\nboard = "{board.name}"\ndriver = "{stepper.driver}"\n{pins}\n{level}'
            f"{wheel}\n{_STEPS}\n{turned}"
        )


def _motor_tables(board: BoardDraft, wheels: Sequence[str]) -> Iterator[str]:
    for motor, wheel in zip(board.motors, wheels, strict=True):
        turned = f"reversed = true{_MARK}\n" if motor.reversed else ""
        sure = "" if motor.sure else f"{_MARK} which of the duties"
        alone = "" if motor.sure or "en" in motor.pins else f"{_MARK} a motor without a PWM"
        marks = {"en": sure, "in1": alone}
        lines = (f"{name} = {_pin(board, pin)}{marks.get(name, '')}" for name, pin in motor.pins.items())
        pins = "\n".join(lines)
        yield (
            f'[[motors]]\nboard = "{board.name}"\ndriver = "{motor.driver}"\n{pins}\n'
            f"{wheel}\n{_SPEED}\n{turned}"
        )
    if board.loose:
        pins = ", ".join(_pin(board, pin) for pin in board.loose)
        enable = "a stepper's enable (then no row), " if board.steppers else ""
        what = f"{enable}a motor, or a lamp"
        yield f"# ? {board.name} has analogWrite on {pins} as well: {what}\n"
    elif not board.motors and any(board.facts.named("analogWrite")):
        yield f"# ? {board.name} has analogWrite on pins that were not found: add [[motors]] by hand\n"


def _sensor_tables(board: BoardDraft, ranges: _Codes, others: _Codes) -> Iterator[str]:
    def row(part: str, *keys: str) -> str:
        return "\n".join(
            ("[[sensors]]", *keys[:1], f'board = "{board.name}"', f'part = "{part}"', *keys[1:], "")
        )

    for sonar in board.sonars:
        trig, echo = _pin(board, sonar.trig), _pin(board, sonar.echo)
        yield row("hc-sr04", ranges.line(), f"trig = {trig}", f"echo = {echo}")
    if board.has_lost_pulses:
        what = "has pulseIn on pins that were not found: add the sonar's [[sensors]] by hand"
        yield f"# ? {board.name} {what}\n"
    wheels = _Wheels((each.side for each in board.encoders), "which")
    for encoder in board.encoders:
        keys = [f"a = {_pin(board, encoder.a)}"]
        keys += [] if encoder.b is None else [f"b = {_pin(board, encoder.b)}"]
        yield row("encoder", wheels.line(encoder.side), *keys, "edges_per_inch = 20  # ? of all its pins")
    for pin in board.digital:
        yield row("line", others.line(), f"pin = {_pin(board, pin)}{_MARK} or a button: then no row")
    for pin in board.analog:
        most = board.facts.kind.most_counts
        curve = f"points = [[0, {most}], [1, 0]]  # ? [reading, count of analogRead]"
        yield row("analog", others.line(), f"pin = {_pin(board, pin)}", curve)


def _bus_tables(board: BoardDraft, beams: _Codes, gyros: _Codes) -> Iterator[str]:
    """The parts on the board's I2C bus."""

    def row(part: str, code: str, keys: Sequence[str]) -> str:
        return "\n".join(("[[sensors]]", code, f'board = "{board.name}"', f'part = "{part}"', *keys, ""))

    for gyro in board.gyros:
        keys = [] if gyro.address == GYRO_ADDRESSES[0] else [f"address = {gyro.address:#x}"]
        keys += [] if gyro.interrupt is None else [f"int = {_pin(board, gyro.interrupt)}"]
        yield row("mpu6050", gyros.line(), keys)
    for ranger in board.rangers:
        keys = [] if ranger.xshut is None else [f"xshut = {_pin(board, ranger.xshut)}"]
        if ranger.xshut is None and len(board.rangers) > 1:
            keys = ["# ? xshut: the pin that turns it off, as several begin at one address"]
        keys += [] if ranger.address is None else [f"address = {ranger.address:#x}"]
        yield row("vl53l0x", beams.line(), keys)


class _Codes:
    """The codes of a set's sensors of one sort, and further ones whose rows are not there yet."""

    def __init__(self, codes: Sequence[str], letter: str, row: str) -> None:
        self._left, self._known, self._letter, self._row = list(codes), set(codes), letter, row

    def line(self) -> str:
        """The line of the next sensor's code."""
        if self._left:
            return f'code = "{self._left.pop(0)}"  # ? which row of sensors.csv'
        number = next(each for each in count(1) if f"{self._letter}{each}" not in self._known)
        self._known.add(f"{self._letter}{number}")
        row = self._row.format(number)
        return f'code = "{self._letter}{number}"  # ? add its row to sensors.csv, such as {row}'


def _servo_tables(board: BoardDraft) -> Iterator[str]:
    gripper = gripper_of(board.facts, board.servos)
    for pin in board.servos:
        angles = drafted_angles(board.facts, pin) if pin == gripper else ""
        yield f'[[servos]]\nboard = "{board.name}"\npin = {_pin(board, pin)}\n{angles}'
