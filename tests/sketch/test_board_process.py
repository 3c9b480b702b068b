"""Boards as processes: the ends of boards, and calls whose state only the board has."""

from __future__ import annotations

import re
import subprocess
import sys
from enum import IntEnum
from pathlib import Path

import pytest

from simmer_tui.links.processes import OWN_PROCESS
from simmer_tui.program import keeper
from simmer_tui.program.kept_process import Adoption
from simmer_tui.run.events import WireMessage
from simmer_tui.sketch.board_host import LocalBoard
from simmer_tui.sketch.board_process import SILENT, BoardSilence, Mistake, Query, Reason, Told, Waits
from simmer_tui.sketch.boards import BOARDS, ESP32, MEGA, BoardKind
from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.sketch.known_headers import RUNTIME
from tests.sketch.rovers import MOTORS, ROVER, STOPPABLE, Boards, made_set
from tests.sketch.running import BoardRun, run_boards

SONAR = '[[sensors]]\nboard = "rover"\npart = "hc-sr04"\ncode = "u1"\ntrig = 8\necho = 8\n'
BY_LETTER = """
#include <NewPing.h>
#include <SoftwareSerial.h>
NewPing sonar(8, 8, 400);
int deep(int n) {
  volatile int room[50]; room[n % 50] = n; return deep(n + 1) + room[3];
}
int unfinished(int n) {
  digitalWrite(13, n);
}
int dots;
void setup() { Serial.begin(1000000); }
void loop() {
  if (!Serial.available()) return;
  char what = Serial.read();
  if (what == '.') { dots++; return; }
  Serial.print("got "); Serial.print(what);
  if (what == 'd') deep(1);
  if (what == 'u') Serial.print(unfinished(1));
  if (what == 'o') Serial.print(sonar.ping_cm());
  if (what == 'h') { digitalWrite(5, HIGH); analogWrite(5, 255); }
  if (what == 'p') {
    for (int i = 0; i < 20; i++) SoftwareSerial brief(0, 12);
    SoftwareSerial last(0, 12);
    last.begin(9600); delay(500); Serial.print(last.available());
  }
  if (what == '=') Serial.print(dots);
  if (what == 'e') while (1) { /* stays */ }
  if (what == 'c') while (true) continue;
}
"""


def run(folder: Path, letters: str, later: str = "") -> BoardRun:
    configuration = made_set(folder / "set", ROVER + MOTORS + SONAR, {"rover.ino": BY_LETTER})
    return run_boards(configuration, 1.0, [(0.3, letters.encode()), (0.6, later.encode())])


@pytest.mark.slow
@pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
def test_boards_end_with_their_last_words_and_their_cause(tmp_path: Path) -> None:
    made = run(tmp_path / "d", "d")
    assert "rover.ino:6 after 0.3" in made.failed
    assert made.failed.endswith("its stack is full")
    assert made.text == "got d"
    assert [each.data for each in made.events if isinstance(each, WireMessage)] == ["got d"]
    # Nothing here kills the board: it waits without end, in either form of a loop.
    for letter in "ec":
        made = run(tmp_path / letter, f"{letter}!")
        assert (made.failed, made.text) == ("", f"got {letter}")
    # A function without its return returns something, and the sketch goes on.
    assert re.fullmatch(r"got u-?\d+got !", run(tmp_path / "u", "u!").text)


COUNTS = """
volatile int left, right, pins;
void leftChanged() { left++; }
void rightRose() { right++; pins = PIN; }
void setup() {
  Serial.begin(9600);
  ATTACH
  pinMode(5, OUTPUT); pinMode(6, OUTPUT);
  digitalWrite(5, HIGH);
  delay(500);
  digitalWrite(5, LOW);
  int before = left; delay(50);
  Serial.print(left == before); Serial.print(' '); Serial.print(left); Serial.print(' '); Serial.print(right);
  Serial.print(' '); Serial.print(pins);
}
void loop() {}
"""
PIN_CHANGES = {
    "PinChangeInterrupt": (
        "attachPCINT(digitalPinToPCINT(A1), leftChanged, CHANGE);"
        "attachPinChangeInterrupt(digitalPinToPinChangeInterrupt(7), rightRose, RISING);",
        "7",
    ),
    "PinChangeInt": (
        "PCintPort::attachInterrupt(A1, leftChanged, CHANGE);"
        "PCintPort::attachInterrupt(7, &rightRose, RISING);",
        "PCintPort::arduinoPin",
    ),
    "EnableInterrupt": (
        "enableInterrupt(A1, leftChanged, CHANGE); enableInterrupt(7, rightRose, RISING);",
        "arduinoInterruptedPin",
    ),
}


@pytest.mark.slow
@pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
@pytest.mark.parametrize("library", PIN_CHANGES)
def test_encoders_count_by_pin_changes_on_any_pin(library: str, tmp_path: Path) -> None:
    attach, pin = PIN_CHANGES[library]
    text = f"#include <{library}.h>\n{COUNTS.replace('ATTACH', attach).replace('PIN;', f'{pin};')}"
    encoders = "".join(
        f'[[sensors]]\nboard = "rover"\npart = "encoder"\nwheel = "left"\na = {at}\nedges_per_inch = 40\n'
        for at in ('"A1"', "7")
    )
    made = run_boards(made_set(tmp_path / "set", ROVER + MOTORS + encoders, {"rover.ino": text}), 1.0)
    stands, left, right, last = map(int, made.text.split())
    assert (stands, last, made.failed) == (1, 7, "")
    assert left > 100
    assert abs(left - 2 * right) <= 1


RATES = """
void setup() {
  Serial.begin(9600);
  TCCR1B = TCCR1B & 0b11111000 | 0x05;
  TCCR2B = (TCCR2B & B11111000) | _BV(CS20);
  Serial.print(TCCR1B); Serial.print(TCCR2B);
  TCCR1B &= ~(1 << CS12); TCCR1B |= 1 << CS11;
  Serial.print(TCCR1B);
  delay(300);
}
void loop() { TCCR1B |= 1 << 3; }
"""


@pytest.mark.slow
@pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
def test_a_sketch_sets_the_frequency_of_pwm_and_no_mode_of_a_timer(tmp_path: Path) -> None:
    made = run_boards(made_set(tmp_path / "set", ROVER, {"rover.ino": RATES}), 1.0)
    assert made.text == "513"
    assert "rover.ino:11 after 0.3" in made.failed
    assert "it set the mode of a timer, and registers are not simulated" in made.failed


RESTARTS = """
void (*restart)(void) = 0;
void setup() { delay(300); }
void loop() { restart(); }
"""


@pytest.mark.slow
@pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
@pytest.mark.skipif(sys.platform != "linux", reason="the address of a fault is known on Linux")
def test_a_jump_to_the_start_of_the_memory_is_told_as_one(tmp_path: Path) -> None:
    made = run_boards(made_set(tmp_path / "set", ROVER, {"rover.ino": RESTARTS}), 1.0)
    assert "rover.ino:4 after 0.3" in made.failed
    assert made.failed.endswith(
        "it called a function at address 0, which starts an AVR again, and no simulated board"
    )


@pytest.mark.slow
@pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
def test_calls_do_what_the_core_and_its_libraries_do(tmp_path: Path) -> None:
    # One pin for trigger and echo hears; ports that are gone make room for others.
    made = run(tmp_path / "o", "op", "!")
    found = re.fullmatch(r"got o(\d+)got p1got !", made.text)
    assert found, (made.text, made.failed)
    assert int(found[1]) > 5
    # More bytes in one slice than a board takes in one read.
    assert run(tmp_path / "=", "." * 300, "=").text == "got =300"
    # The level that was written before the pin was an output drives the motor.
    start = run(tmp_path / "n", "!").pose
    assert run(tmp_path / "h", "h").pose != start


WHEEL_SERVOS = """
#include <Servo.h>
Servo left, right;
void setup() {
  left.attach(9); right.attach(10);
  left.writeMicroseconds(2000); right.writeMicroseconds(1000);
  delay(500);
  left.detach(); right.write(90);
}
void loop() {}
"""


@pytest.mark.slow
@pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
def test_servos_that_turn_all_round_drive_as_long_as_their_pulses_say(tmp_path: Path) -> None:
    wiring = '[boards.rover]\nsketch = "rover.ino"\nboard = "uno"\n' + "".join(
        f'[[motors]]\nboard = "rover"\ndriver = "servo360"\npin = {pin}\nwheel = "{wheel}"\ntop_speed = 8\n'
        for pin, wheel in ((9, "left"), (10, "right"))
    )
    wiring += "reversed = true\n"
    boards = Boards(made_set(tmp_path / "set", wiring, {"rover.ino": WHEEL_SERVOS}), noise=False)
    for kind in boards.simulator.bias:
        boards.simulator.set_bias({kind: type(boards.simulator.bias[kind])()})
    begin = boards.simulator.pose
    boards.run_to(1.0)
    boards.close()
    end = boards.simulator.pose
    # Half a second at 8 in/s; write(90) is 1,472 us, in the dead band.
    assert ((end.x - begin.x) ** 2 + (end.y - begin.y) ** 2) ** 0.5 == pytest.approx(4.0, abs=0.01)
    assert end.heading == pytest.approx(begin.heading, abs=0.1)


@pytest.mark.slow
@pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
def test_boards_that_are_closed_may_be_asked_for_the_present_time(tmp_path: Path) -> None:
    """By the real clock a run looks at it until its loop has ended."""
    boards = Boards(made_set(tmp_path / "set", ROVER + MOTORS, {"rover.ino": STOPPABLE}))
    boards.run_to(0.1)
    boards.robot.close()
    assert boards.robot.run_to(9.0) == 9.0
    assert boards.robot.catch_up(9.5)
    assert (boards.robot.failed, boards.simulator.time) == ("", 0.1)
    boards.close()


def test_silence_is_counted_while_the_simulator_runs() -> None:
    silence = BoardSilence()
    # After Ctrl-Z and fg an hour has gone.
    assert not any(silence.is_too_long(1.0, now) for now in (1.0, 1.5, 3600.0, 3600.5))
    assert not silence.is_too_long(3601.0, 3601.0), "it has answered"
    looks = [silence.is_too_long(3601.0, 3601.0 + count * SILENT / 10) for count in range(1, 13)]
    assert looks.index(True) in (9, 10)
    # A board that works is not silent.
    assert not any(silence.is_too_long(0.0, 9000.0 + count) for count in range(30))


_AVR = [each for each in BOARDS.values() if each is not ESP32]


@pytest.mark.parametrize("kind", _AVR, ids=[each.name for each in _AVR])
def test_the_runtime_has_the_pins_of_the_boards(kind: BoardKind) -> None:
    text = (RUNTIME / "core" / "boards.h").read_text("utf-8")
    symbols = {kind.macro, "SIMMER_MEGA"} if kind is MEGA else {kind.macro}
    kept: list[bool] = []
    lines = []
    for line in text.splitlines():
        if line.startswith("#if"):
            kept.append(line.split("(")[-1].rstrip(")") in symbols)
        elif line.startswith("#else"):
            kept[-1] = not kept[-1]
        elif line.startswith("#endif"):
            kept.pop()
        elif all(kept):
            lines.append(line)
    text = "\n".join(lines)
    numbers = {name: int(number) for name, number in re.findall(r"(\w+) = (\d+)", text)}
    assert numbers["FIRST_ANALOG"] == kind.first_analog
    assert numbers["FIRST_ANALOG"] + numbers["ANALOG_PINS"] == kind.pins
    found = re.search(r"INTERRUPT_PINS\[\] = \{(.+?)\}", text)
    assert found
    assert {int(pin): number for number, pin in enumerate(found[1].split(","))} == kind.interrupts
    found = re.search(r"digitalPinHasPWM.*?return (.*?);", text, re.DOTALL)
    assert found
    condition = found[1].replace("||", " or ").replace("&&", " and ").replace("\n", " ")
    assert {pin for pin in range(kind.pins) if eval(condition, {"pin": pin})} == kind.pwm
    ports = {
        name: (int(rx), int(tx))
        for name, rx, tx in re.findall(
            r"(Serial\d?)\((\d+), (\d+)\)", (RUNTIME / "board" / "port.cpp").read_text("utf-8")
        )
    }
    assert {name: ports[name] for name in kind.serial} == kind.serial


def test_the_runtime_has_the_pins_of_an_esp32() -> None:
    text = (RUNTIME / "core" / "esp32_pins.h").read_text("utf-8")
    numbers = {name: int(number) for name, number in re.findall(r"(\w+) = (\d+)", text)}
    assert {name: numbers[name] for name in numbers if re.fullmatch(r"A\d+", name)} == ESP32.analog_names
    assert (numbers["SDA"], numbers["SCL"]) == ESP32.i2c
    assert (numbers["BLUETOOTH_RX"], numbers["BLUETOOTH_TX"]) == ESP32.bluetooth
    assert numbers["DIGITAL_PINS"] == ESP32.pins
    assert f"#define LED_BUILTIN {ESP32.led}\n" in text
    found = re.search(
        r"PORT_PINS\[\]\[2\] = \{\{(\d+), (\d+)\}, \{(\d+), (\d+)\}, \{(\d+), (\d+)\}\};",
        (RUNTIME / "board" / "port.cpp").read_text("utf-8"),
    )
    assert found
    assert [int(each) for each in found.groups()] == [pin for pair in ESP32.serial.values() for pin in pair]


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has processes that are adopted")
def test_a_board_is_none_of_the_processes_that_a_program_leaves_behind() -> None:
    """Whichever of them starts first."""
    assert {keeper.MARK: keeper.KEEPER} == OWN_PROCESS
    adoption = Adoption("mark")
    waits = [sys.executable, "-c", "input()"]
    marked = {keeper.MARK: "mark"}
    with subprocess.Popen(waits, env=marked, stdin=subprocess.PIPE, start_new_session=True) as program:
        adoption.begin(program.pid)
        with subprocess.Popen(waits, stdin=subprocess.PIPE, start_new_session=True) as left:
            board = LocalBoard(Path("/bin/sh"), ["-c", "read line"])
            try:
                assert left.pid in adoption.living()
                assert not set(board.pids) & adoption.living()
            finally:
                board.close()
                left.kill()
                program.kill()


@pytest.mark.parametrize(
    ("header", "name", "numbers"),
    [
        ("exchange.h", "Told", Told),
        ("exchange.h", "Query", Query),
        ("exchange.h", "Reason", Reason),
        ("mistakes.h", "Mistake", Mistake),
        ("clock.h", "Waits", None),
    ],
)
def test_the_numbers_of_the_channel_are_the_same_at_both_ends(
    header: str, name: str, numbers: type[IntEnum] | None
) -> None:
    text = (RUNTIME / "board" / header).read_text("utf-8")
    found = re.search(rf"enum class {name} : uint8_t \{{(.*?)\}};", text, re.DOTALL)
    assert found
    there = {each[0]: int(each[1]) for each in re.findall(r"(\w+) = (\d+)", found[1])}
    if numbers is None:  # its names begin with `In`
        assert sorted(there.values()) == sorted(Waits)
    else:
        words = {re.sub(r"(?<!^)(?=[A-Z])", "_", each).upper(): number for each, number in there.items()}
        assert words == {each.name: each.value for each in numbers}
