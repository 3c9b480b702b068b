"""The same sketch with the same events on two cores: a board of ours, and simavr with Arduino's own core."""

from __future__ import annotations

import subprocess
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from simmer_tui.sketch.board_process import BYTE, EDGE, BoardEvent, BoardProcess, Query
from simmer_tui.sketch.boards import UNO
from simmer_tui.sketch.build import build_sketch
from simmer_tui.sketch.lockstep import BOARD_SLICE, Board, Lockstep, LockstepWorld
from simmer_tui.sketch.parts import ECHO_DELAY, LARGEST_DUTY, SECOND
from simmer_tui.sketch.shared_processor import SharedProcessor

HERE = Path(__file__).parent
SKETCHES = HERE / "sketches"
ARDUINO = Path("/usr/share/arduino/hardware/arduino/avr")
"""Arduino's own core, where Debian's arduino-core-avr puts it."""
_CYCLE = 62.5
"""Nanoseconds of a cycle at 16 MHz."""
_BIT_CYCLES = 208 * 8
"""Cycles of a bit at 9600 baud: an UART of 16 MHz has no nearer divisor."""
BAUD = 9600
_BYTE_TIME = 10 * SECOND // BAUD
# Arduino's own options of a build (its platform.txt). Before C23, DECIMAL_DIG is in no header of avr-gcc 5.
_AVR_OPTIONS = (
    *("-Os", "-w", "-flto", "-fuse-linker-plugin", "-ffunction-sections", "-fdata-sections", "-fpermissive"),
    *("-std=gnu++11", "-fno-exceptions", "-fno-threadsafe-statics", "-mmcu=atmega328p", "-DF_CPU=16000000L"),
    *("-DARDUINO=10819", "-DARDUINO_AVR_UNO", "-DARDUINO_ARCH_AVR", "-DDECIMAL_DIG=__DECIMAL_DIG__"),
)


class Sonar(NamedTuple):
    """An HC-SR04 whose echo always lasts the same."""

    trigger: int
    echo: int
    width: int
    """Length of the echo, nanoseconds."""


class Stimuli(NamedTuple):
    """Events that reach a board, at nanoseconds.

    Attributes:
        received: bytes of the UART, with the end of each; with `soft_rx` those of SoftwareSerial at this pin.
        edges: levels of inputs: time, pin, level.
        watched: the pins whose levels are compared.
        modulated: the pins whose duties are compared, between LOW and HIGH: a timer's edges are not the
            sketch's.
        soft_tx: the pin at which SoftwareSerial sends.
        servos: pins whose pulses are noted; only by a board of ours.
    """

    received: Sequence[tuple[int, int]] = ()
    edges: Sequence[tuple[int, int, int]] = ()
    watched: tuple[int, ...] = ()
    modulated: tuple[int, ...] = ()
    sonar: Sonar | None = None
    soft_rx: int | None = None
    soft_tx: int | None = None
    servos: tuple[int, ...] = ()


class Done(NamedTuple):
    """Something that a core did: its time in nanoseconds, and what. A byte's time is its end."""

    time: float
    what: str


class _Watching(LockstepWorld):
    """A world of one sonar, which notes what the board does."""

    def __init__(self, stimuli: Stimuli) -> None:
        self.done: list[Done] = []
        self.lockstep: Lockstep | None = None
        self._stimuli = stimuli

    def changed(self, board: Board, pins: Iterable[int]) -> None:
        for pin in pins:
            if pin in self._stimuli.servos and board.pin(pin).servo:
                self.done.append(Done(board.now, f"servo {pin} {board.pin(pin).servo}"))
            level = round(LARGEST_DUTY * board.level(pin))
            if pin in self._stimuli.watched or (pin in self._stimuli.modulated and 0 < level < LARGEST_DUTY):
                self.done.append(Done(board.now, f"{pin}={level}"))

    def answer(self, board: Board, query: int, pin: int) -> float:
        sonar = self._stimuli.sonar
        if query == Query.SONAR and sonar is not None and self.lockstep is not None:
            rise = board.now + ECHO_DELAY
            self.lockstep.put(board, BoardEvent(rise, EDGE, sonar.echo, 1))
            self.lockstep.put(board, BoardEvent(rise + sonar.width, EDGE, sonar.echo, 0))
        return 0.0

    def sent(self, time: int, value: int, byte: int) -> None:
        self.done.append(Done(time, f"byte {value}"))


def run_ours(sketch: Path, stimuli: Stimuli, seconds: float) -> list[Done]:
    """Run a board of the simulator. Returns all that it did."""
    watched = (*stimuli.watched, *stimuli.modulated, *stimuli.servos)
    options = ["--drives", ",".join(map(str, watched))] if watched else []
    if stimuli.sonar is not None:
        options += ["--triggers", str(stimuli.sonar.trigger)]
    process = BoardProcess("uno", build_sketch(sketch, UNO).program, options)
    board = Board("uno", process, _BYTE_TIME, driving=frozenset(watched))
    rx = 0 if stimuli.soft_rx is None else stimuli.soft_rx
    board.events = [BoardEvent(time, BYTE, rx, value | BAUD << 8) for time, value in stimuli.received]
    board.events += [BoardEvent(time, EDGE, pin, level) for time, pin, level in stimuli.edges]
    if stimuli.sonar is not None:
        board.events.append(BoardEvent(0, EDGE, stimuli.sonar.echo, 0))
    board.events.sort()
    world = _Watching(stimuli)
    tx = 1 if stimuli.soft_tx is None else stimuli.soft_tx
    processor = SharedProcessor()
    world.lockstep = Lockstep([board], world, (board, tx), BOARD_SLICE, processor)
    try:
        until = round(seconds * SECOND)
        while world.lockstep.run(until) < until:
            pass
    finally:
        processor.release()
        process.close()
    return _changes(sorted(world.done))


def build_core(folder: Path) -> Path:
    """The program that runs simavr."""
    made = folder / "core"
    # The library's own development package has no name for libelf, only its file.
    command = ["gcc", "-O1", str(HERE / "core.c"), "-o", str(made), "-lsimavr", "-l:libelf.so.1"]
    subprocess.run(command, check=True, timeout=120)
    return made


def run_simavr(core: Path, sketch: Path, stimuli: Stimuli, seconds: float, folder: Path) -> list[Done]:
    """Run an ATmega328P with Arduino's own core, cycle by cycle. Returns all that it did."""
    unit, program = folder / f"{sketch.stem}.cpp", folder / f"{sketch.stem}.elf"
    unit.write_text(f'#include <Arduino.h>\n#line 1 "{sketch.name}"\n{sketch.read_text("utf-8")}', "utf-8")
    software = ARDUINO / "libraries" / "SoftwareSerial" / "src"
    includes = [ARDUINO / "cores" / "arduino", ARDUINO / "variants" / "standard", software]
    sources = [unit, *(each for where in includes for each in sorted(where.glob("*.[cS]*")))]
    command = ["avr-gcc", *_AVR_OPTIONS, *(f"-I{each}" for each in includes), *map(str, sources)]
    subprocess.run([*command, "-Wl,--gc-sections", "-lm", "-o", str(program)], check=True, timeout=240)
    events: list[tuple[int, str, int, int]] = []
    for time, value in stimuli.received:
        end = round(time / _CYCLE)
        if stimuli.soft_rx is None:
            events.append((end - 10 * _BIT_CYCLES, "byte", 0, value))
            continue
        levels = value << 1 | 1 << 9
        events += [
            (end - round((10 - bit) * SECOND / BAUD / _CYCLE), "pin", stimuli.soft_rx, levels >> bit & 1)
            for bit in range(10)
        ]
    events += [(round(time / _CYCLE), "pin", pin, level) for time, pin, level in stimuli.edges]
    if stimuli.soft_rx is not None:
        events.append((1, "pin", stimuli.soft_rx, 1))
    text = "".join(" ".join(map(str, each)) + "\n" for each in sorted(events))
    arguments = [str(round(seconds * SECOND / _CYCLE))]
    if stimuli.sonar is not None:
        sonar = stimuli.sonar
        arguments += [str(sonar.trigger), str(sonar.echo), str(round(sonar.width / _CYCLE))]
    told = subprocess.run(
        [str(core), str(program), *arguments],
        input=text,
        stdout=subprocess.PIPE,
        encoding="utf-8",
        check=True,
        timeout=240,
    ).stdout
    return _read_core(told, stimuli)


def _read_core(told: str, stimuli: Stimuli) -> list[Done]:
    done: list[Done] = []
    line: list[tuple[float, int]] = []
    for text in told.splitlines():
        parts = text.split()
        if len(parts) != 4 or parts[1] not in ("byte", "pin", "pwm"):
            continue
        time, kind, number, value = float(parts[0]) * _CYCLE, parts[1], int(parts[2]), int(parts[3])
        if kind == "byte":
            done.append(Done(time + 10 * _BIT_CYCLES * _CYCLE, f"byte {value}"))
        elif number == stimuli.soft_tx:
            line.append((time, value))
        elif kind == "pwm" and number in stimuli.modulated and value:
            done.append(Done(time, f"{number}={value}"))
        elif kind == "pin" and number in stimuli.watched:
            done.append(Done(time, f"{number}={LARGEST_DUTY * value}"))
    done += _soft_bytes(line)
    return _changes(sorted(done))


def _soft_bytes(line: Sequence[tuple[float, int]]) -> list[Done]:
    """The bytes on a line of 9600 baud, by its edges."""
    bit = SECOND / BAUD
    done: list[Done] = []
    free = 0.0
    for time, level in line:
        if level or time < free or not any(each < time for each, _ in line):
            continue
        free = time + 9.5 * bit
        value = 0
        for place in range(8):
            at = time + (place + 1.5) * bit
            value |= [each for moment, each in line if moment <= at][-1] << place
        done.append(Done(time + 10 * bit, f"byte {value}"))
    return done


def _changes(done: Iterable[Done]) -> list[Done]:
    """Drop levels that a pin has already: all are LOW at the start, and a core writes some twice."""
    levels: dict[str, str] = {}
    kept = []
    for each in done:
        pin, sign, level = each.what.partition("=")
        if not sign or levels.get(pin, "0") != level:
            kept.append(each)
        levels[pin] = level
    return kept
