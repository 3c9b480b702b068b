"""A draft of a wiring.toml from the text of sketches, for `init --sketch`.

Pins are read off constants, constructors, attachInterrupt and the order of writes: a team sets the direction
of a motor right before, or after, its duty. A value that no sketch can tell is marked `# ?`: which wheel is
left, speeds, the sensor's place, the wire between boards.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Sequence
from itertools import count
from pathlib import Path

from simmer_tui.config.set_sketches import library_paths
from simmer_tui.errors import ConfigurationError, Problem, printable
from simmer_tui.sim.command import cut
from simmer_tui.sim.rules import MAX_TEXT, TextRule
from simmer_tui.sketch.board_draft import BoardDraft, facts_for_draft
from simmer_tui.sketch.gripper_draft import drafted_angles, gripper_of
from simmer_tui.sketch.known_headers import is_provided
from simmer_tui.sketch.motor_draft import DraftMotor
from simmer_tui.sketch.sketch_scan import SketchPort
from simmer_tui.sketch.sketch_values import Pins
from simmer_tui.sketch.stepper_draft import DraftStepper
from simmer_tui.sketch.wheel_draft import BY_NAME, DraftWheels, layout_of
from simmer_tui.sketch.wiring import GYRO_ADDRESSES

_MARK = "  # ?"
_HEAD = """\
# A draft, read off the sketch. A line with "# ?" is a guess: look at it, then take the mark away.
# simmer-tui check tells what does not fit. docs/sketch.md explains every part.
"""
_BEAM_ROW, _GYRO_ROW = "tof{0},t{0},1,3,0,4,0,0.03,25,", "gyro{0},g{0},1,0,0,4,0,0.01,,"
_RANGE_ROW, _LINE_ROW = "ultra{0},u{0},1,3,0,6,0,0.02,5,", "ir{0},i{0},1,2,0,1,0,0.05,40,0.8"
"""Rows of sensors.csv, in front of the robot and beneath it."""
_BY_HAND = "add [[motors]] by hand"
_AND_LAYOUT = f'{_BY_HAND}, and the layout of [wheels] in settings.toml, if it is "none"'
_STEPS = "steps_per_inch = 100  # ? steps of a turn (with microsteps) / (3.14 x diameter of the wheel)"
_SPEED = "top_speed = 12  # ? in/s at full duty: time it over a measured distance"


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
        boards.append(BoardDraft(name, _path_from(directory, sketch), facts_for_draft(sketch)))
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
    drives = [each for board in boards for each in board.drives]
    layout = layout_of(drives)
    wheels = DraftWheels(layout, (each.place for each in drives), "which wheel of [wheels] in settings.toml")
    has_wheels = any(board.drives or board.encoders for board in boards)
    by_hand = _BY_HAND if has_wheels else _AND_LAYOUT
    used: set[str] = set()
    for board in boards:
        text += _drive_tables(board, wheels, used, by_hand)
    codes, others = _Codes(ranges, "u", _RANGE_ROW), _Codes(lines, "i", _LINE_ROW)
    on_bus = _Codes(beams, "t", _BEAM_ROW), _Codes(gyros, "g", _GYRO_ROW)
    for board in boards:
        turned = DraftWheels(layout, (each.place for each in board.encoders), "which")
        text += _sensor_tables(board, codes, others, turned)
        text += _bus_tables(board, *on_bus)
        text += _servo_tables(board)
    return "\n".join(text)


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


def _shown(board: BoardDraft, pin: int, name: str) -> str:
    """A pin with its name in the sketch, for a comment."""
    number = board.facts.kind.pin_name(pin)
    return number if name in ("", number) else f"{number} ({printable(name)})"


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


def _drive_tables(board: BoardDraft, wheels: DraftWheels, used: set[str], by_hand: str) -> Iterator[str]:
    """The rows of a board's steppers and motors, and a line for each that has none."""
    for drive in board.drives:
        motor = drive.motor
        pins = ", ".join(f"{name} = {_pin(board, pin)}" for name, pin in motor.pins.items())
        if not drive.place.is_wheel:
            yield f"# {board.name}, {motor.driver} with {pins}: no wheel by its names, so no row\n"
            continue
        wheel = wheels.next_wheel(drive.place, drive.turn)
        if not wheel.name:
            what = "no wheel is left. Motors that run together are one row, one that is no wheel has none"
            yield f"# ? {board.name}, {motor.driver} with {pins}: {what}\n"
        elif wheel.name in used:
            mark = "? " if wheel.mark != BY_NAME else ""
            what = f'one more motor of wheel = "{wheel.name}". Motors that run together are one row'
            yield f"# {mark}{board.name}, {motor.driver} with {pins}: {what}\n"
        else:
            used.add(wheel.name)
            line = f'wheel = "{wheel.name}"  # {wheel.mark}'
            if isinstance(motor, DraftStepper):
                yield _stepper_table(board, motor, line)
            else:
                yield _motor_table(board, motor, line)
    if board.loose:
        pins = ", ".join(_shown(board, *each) for each in board.loose.items())
        what = f"a motor ({by_hand}), or an enable, a standby, a lamp (then no row)"
        yield f"# ? {board.name} writes {pins} as well, in no row: {what}\n"
    if not board.drives and not board.loose and any(board.facts.named("analogWrite")):
        yield f"# ? {board.name} has analogWrite on pins that were not found: {by_hand}\n"
    for name, objects in board.strangers.items():
        shown = ", ".join(
            f"{each.name}({', '.join(board.facts.spelled(each, at) for at in range(len(each.arguments)))})"
            for each in objects
        )
        what = f"a class that is not there. If they are motors, {by_hand}"
        yield f"# ? {objects[0].token.spot} has {cut(printable(f'{name} {shown}'))}: {what}\n"


def _stepper_table(board: BoardDraft, stepper: DraftStepper, wheel: str) -> str:
    pins = "\n".join(f"{name} = {_pin(board, pin)}" for name, pin in stepper.pins.items())
    turned = f"reversed = true{_MARK}\n" if stepper.reversed else ""
    level = 'enable_on = "high"  # ? most drivers are on at LOW\n' if stepper.enable_high else ""
    head = f'[[motors]]\nboard = "{board.name}"\ndriver = "{stepper.driver}"\n'
    return f"{head}{pins}\n{level}{wheel}\n{_STEPS}\n{turned}"


def _motor_table(board: BoardDraft, motor: DraftMotor, wheel: str) -> str:
    turned = f"reversed = true{_MARK}\n" if motor.reversed else ""
    sure = "" if motor.sure else f"{_MARK} which of the duties"
    alone = "" if motor.sure or "en" in motor.pins else f"{_MARK} a motor without a PWM"
    marks = {"en": sure, "in1": alone}
    lines = (f"{name} = {_pin(board, pin)}{marks.get(name, '')}" for name, pin in motor.pins.items())
    pins = "\n".join(lines)
    head = f'[[motors]]\nboard = "{board.name}"\ndriver = "{motor.driver}"\n'
    return f"{head}{pins}\n{wheel}\n{_SPEED}\n{turned}"


def _sensor_tables(board: BoardDraft, ranges: _Codes, others: _Codes, wheels: DraftWheels) -> Iterator[str]:
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
    for encoder in board.encoders:
        keys = [f"a = {_pin(board, encoder.a)}"]
        keys += [] if encoder.b is None else [f"b = {_pin(board, encoder.b)}"]
        wheel = wheels.next_wheel(encoder.place)
        line = f'wheel = "{wheel.name or wheels.first}"  # {wheel.mark}'
        yield row("encoder", line, *keys, "edges_per_inch = 20  # ? of all its pins")
    for pin in board.digital:
        yield row("line", others.line(), f"pin = {_pin(board, pin)}{_MARK} or a button: then no row")
    for pin in board.analog:
        most = board.facts.kind.most_counts
        curve = f"points = [[0, {most}], [1, 0]]  # ? [reading, count of analogRead]"
        yield row("analog", others.line(), f"pin = {_pin(board, pin)}{_MARK} or a knob: then no row", curve)
    for pin, name in board.knobs.items():
        what = "a knob, a button or a battery by its name, so no row"
        yield f"# {board.name} reads {_shown(board, pin, name)}: {what}\n"


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
