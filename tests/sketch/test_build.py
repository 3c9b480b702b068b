"""Sketches compiled: the libraries that are taken, headers that are missing, warnings, folders that fail."""

from __future__ import annotations

from pathlib import Path

import pytest

from simmer_tui import platform_has
from simmer_tui.errors import ConfigurationError
from simmer_tui.sketch.boards import UNO
from simmer_tui.sketch.build import build_sketch, fastest_baud
from simmer_tui.sketch.compiler import Compiler, find_compiler

no_compiler = pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
EMPTY = "void setup() {}\nvoid loop() {}\n"


def files(folder: Path, texts: dict[str, str]) -> Path:
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, "utf-8")
    return folder / "rover" / "rover.ino"


def test_libraries_are_taken_as_arduino_takes_them(tmp_path: Path) -> None:
    """By the fastest rate that their code names, which is in one library each."""
    sketch = files(
        tmp_path,
        {
            "rover/rover.ino": f"#include <First.h>\n#include <newping.h>\n{EMPTY}",
            "libraries/First/src/First.h": '#include "second.h" // 19200\n',
            "libraries/Second/Second.h": "// 38400\n",
            # Another with the same header, one that nobody includes, and the runtime's own.
            "libraries/Another/Second.h": "// 115200\n",
            "libraries/Unused/Unused.cpp": "int avr = 230400;\n",
            "libraries/NewPing/src/NewPing.h": "// 250000\n",
        },
    )
    assert fastest_baud(sketch) == 38400
    # A library beside the sketch itself is meant for it.
    files(tmp_path, {"rover/libraries/NewPing/NewPing.h": "// 57600\n"})
    assert fastest_baud(sketch) == 57600


@no_compiler
@pytest.mark.slow
def test_headers_count_where_the_compiler_reads_them(tmp_path: Path) -> None:
    text = f"#ifdef ESP32\n#include <WiFi.h>\n#endif\nint speed() {{}}\n{EMPTY}"
    sketch = files(
        tmp_path, {"rover/rover.ino": text, "libraries/Bad/Bad.h": "", "libraries/Bad/Bad.cpp": "no code"}
    )
    built = build_sketch(sketch, UNO)
    assert [each.partition(": no ret")[0] for each in built.warnings] == [
        "rover.ino:4: this function ends without its return"
    ]
    # A header of this machine is none of a board's.
    sketch.write_text(f"{EMPTY}#include <iostream>\n", "utf-8")
    with pytest.raises(ConfigurationError, match=r"^rover\.ino:3: there is no library with iostream; there"):
        build_sketch(sketch, UNO)


EXTRAS = """#include <Motor.h>
#include "utils/Gear.h"
#include <Wire.h>
#include <SoftwareSerial.h>
struct Link { SoftwareSerial port; Link(SoftwareSerial given) : port(given) {} };
Link link_(SoftwareSerial(2, 3));
constexpr int length(const char* text) { int n = 0; while (text[n++]); return n; }
int room[length("abc")];
static __attribute__((noinline)) void local() {}
int sign(int value) { if (value) return 1; }
void setup() { local(); motor(); room[0] = gear() + own_wire() + sign(2); link_.port = SoftwareSerial(4, 5); }
void yield() {}
void loop() {}
"""


@no_compiler
@pytest.mark.slow
def test_what_arduino_compiles_compiles(tmp_path: Path) -> None:
    sketch = files(
        tmp_path,
        {
            "rover/rover.ino": EXTRAS,
            # Names of files have other capitals on the student's machine; those beside the sketch go first.
            "rover/motor.h": "void motor();\n",
            "rover/motor.cpp": "void motor() {}\n",
            "libraries/Motor/Motor.h": "void motor();\n",
            "libraries/Motor/Motor.cpp": "void motor() {}\n",
            "rover/src/utils/gear.h": "inline int gear() { return 3; }\n",
            "rover/libraries/Wire/Wire.h": "inline int own_wire() { return 4; }\n",
        },
    )
    assert [each.split(": ")[:2] for each in build_sketch(sketch, UNO).warnings] == [
        ["rover.ino:10", "this function ends without its return"]
    ]
    files(tmp_path, {"rover/more.cpp": "void motor() {}\n"})
    with pytest.raises(ConfigurationError, match=r"motor\(\) is defined more than once"):
        build_sketch(sketch, UNO)


@no_compiler
def test_a_build_folder_that_fails_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sketch = files(tmp_path, {"rover/rover.ino": EMPTY})
    (tmp_path / "file").touch()
    monkeypatch.setattr(platform_has, "data_folder", lambda: tmp_path / "file")
    with pytest.raises(ConfigurationError, match="cannot be used: "):
        build_sketch(sketch, UNO)


@pytest.mark.skipif(not platform_has.POSIX, reason="the compiler is a script")
@pytest.mark.parametrize(
    ("told", "name", "is_gcc"),
    [
        ("Apple clang version 15.0.0", "clang++", False),
        ("g++ (Debian 12.2.0) 12.2.0", "g++", True),
    ],
)
def test_a_compiler_is_named_by_its_version(tmp_path: Path, told: str, name: str, is_gcc: bool) -> None:
    program = tmp_path / "g++"
    program.write_text(f'#!/bin/sh\necho "{told}"; echo "$LC_ALL" >&2\n', "utf-8")
    program.chmod(0o755)
    compiler = Compiler((str(program),))
    assert (compiler.name, compiler.is_gcc) == (name, is_gcc)
    assert compiler.run([], tmp_path).stderr == "C\n"


REFUSED = {
    "ISR(TIMER1_COMPA_vect) { n++; }": "TIMER1_COMPA_vect is an interrupt of the chip's own parts",
    "void f() { DDRB |= 1; }": "DDRB is a register of the chip, and registers are not simulated: use",
    "int m; ISR(PCINT2_vect) { n++; }": "PCINT2_vect is an interrupt of the chip's own parts",
    "SIGNAL(TIMER2_OVF_vect) { n++; }": "TIMER2_OVF_vect is an interrupt of the chip's own parts",
    "int p() { return digitalPinToPort(4); }": "digitalPinToPort leads to registers",
    "volatile byte *p = portOutputRegister(4);": "portOutputRegister leads to registers",
    "#include <SPI.h>\nvoid f() { SPI.begin(); }": "SPI is of SPI, and no part of the simulated robot is on",
    "void f() { Serial.onReceive(0); }": "the simulator's HardwareSerial has no onReceive; .* those that are",
    "String s; void f() { s.shuffle(); }": "the simulator's String has no shuffle",
    "void f() { if (n) { }": "this { has no }",
    "void f() { TCCR1A = 0; }": "TCCR1A is a register of the chip",
    "void f() { TCCR0B = 1; }": "TCCR0B is a register of the chip",
    "void f() { ledcWrite(1, 2); }": "ledcWrite is a call of another board; give it in wiring.toml",
    "void f() { vTaskDelay(1); }": "vTaskDelay is of FreeRTOS, .*: add #include <Arduino_FreeRTOS.h>",
    "int a() { return ADC_11db; }": "ADC_11db is a call of another board; give it in wiring.toml",
    "#include <soc/soc.h>": "soc/soc.h is no library of the Uno",
    "#include <vector>": "vector is a header of C\\+\\+, which an AVR board has not",
    "QueueHandle_t q;": "QueueHandle_t is of FreeRTOS",
    "#include <Arduino_FreeRTOS.h>\nvoid f() { xQueueReset(0); }": "xQueueReset .*#include <queue.h>",
    "#include <Arduino_FreeRTOS.h>\nvoid f() { vTaskList(0); }": "the simulator's FreeRTOS has no vTaskList",
    "#include <Servo.h>\nServo s; void f() { s.sweep(1); }": "the simulator's Servo has no sweep; its",
    "#include <Stepper.h>\nint f() { return Stepper::FAST; }": "the simulator's Stepper has no FAST",
    "void f() { Serial1.begin(9600); }": "Serial1 is a port of the Mega or ESP32, and the Uno has none",
    "int echo = 9\nint motor = 5;": "before 'int'|expected ';' after",
    "struct Own {} own; void f() { own.go(); }": "'go'",
    "void f() { goo(1); }": "'?goo'? was not declared|undeclared identifier 'goo'",
}


@no_compiler
def test_all_headers_that_are_missing_are_named_at_once(tmp_path: Path) -> None:
    first = "#include <AFMotor.h>\n#include <Servo.h>\n#ifdef ESP32\n#include <WiFi.h>\n#endif\n"
    sketch = files(tmp_path, {"rover/rover.ino": f"{first}#include <QTRSensors.h>\n{EMPTY}"})
    with pytest.raises(ConfigurationError) as told:
        build_sketch(sketch, UNO)
    one, other = map(str, told.value.problems)
    assert one.startswith("rover.ino:1: there is no library with AFMotor.h; there are ")
    assert one.endswith("Put one of your own in rover/libraries/NAME")
    assert other == "rover.ino:6: there is no library with QTRSensors.h"


@no_compiler
@pytest.mark.slow
@pytest.mark.parametrize("line", REFUSED)
def test_what_no_board_has_is_refused_with_what_is_there(tmp_path: Path, line: str) -> None:
    sketch = files(tmp_path, {"rover/rover.ino": f"int n;\n{line}\n{EMPTY}"})
    place = 2 + line.count("\n")
    with pytest.raises(ConfigurationError, match=rf"rover\.ino:{place}: .*(?:{REFUSED[line]})"):
        build_sketch(sketch, UNO)


@no_compiler
@pytest.mark.slow
def test_the_mistake_of_a_macro_is_told_once_in_a_line(tmp_path: Path) -> None:
    uses = "#define BT Serial1\nvoid f() { BT.print(1); BT.print(2); }\nvoid g() { BT.print(3); }\n"
    sketch = files(tmp_path, {"rover/rover.ino": uses + EMPTY})
    with pytest.raises(ConfigurationError) as told:
        build_sketch(sketch, UNO)
    places = [str(each).split(": ")[0] for each in told.value.problems]
    assert len(places) == len({*map(str, told.value.problems)})
    assert all("Serial1 is a port of the Mega" in str(each) for each in told.value.problems)
