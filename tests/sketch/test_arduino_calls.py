"""Sketches of ours with what teams have: names of the C library, atomic blocks, functions in an #if."""

from __future__ import annotations

from pathlib import Path

import pytest

from simmer_tui.sketch.compiler import find_compiler
from tests.sketch.rovers import ROVER, made_set
from tests.sketch.running import run_boards

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler"),
]
NAMES = """
#include <Servo.h>
Servo grip;
int read = 1, write = 2, signal = 3, time = 4;
float y0 = 5;
void setup() {
  Serial.begin(9600);
  grip.attach(9);
  close(90);
  index(3);
  Serial.println(read + write + signal + time + y0);
}
void loop() {}
void close(int angle) { grip.write(angle); Serial.println("closed"); }
void index(int value) { Serial.println(value); }
"""
CALLS = """
#include <util/atomic.h>
#include <util/delay.h>
#include <avr/wdt.h>
#include <limits.h>
#if defined(ESP32)  /* a board
   that we have not */
void join(Network network) {}
#endif
volatile long ticks = 7;
bool on() { return SREG & 0x80; }
long taken() {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    if (on()) return -1;
    return ticks;
  }
  return 0;
}
void setup() {
  Serial.begin(9600);
  if (MCUSR & (1 << WDRF)) Serial.println("bitten");
  MCUSR = 0;
  MCUSR &= ~_BV(WDRF);
  wdt_disable();
  wdt_enable(WDTO_2S);
  Serial.println(taken());
  Serial.println(on());
  noInterrupts();
  Serial.println(taken());
  Serial.println(on());
  ATOMIC_BLOCK(ATOMIC_FORCEON) { ticks++; }
  Serial.println(on());
  unsigned long begun = micros();
  _delay_ms(2.5);
  _delay_us(500);
  Serial.println((micros() - begun) / 100);
  Serial.println(INT_MAX);
  Serial.println(LONG_MIN);
  Serial.println(square(1.5));
  Serial.println(helped());
}
void loop() { while (!Serial.available()) serialEventRun(); wdt_reset(); serialEventRun(); }
void serialEvent() { Serial.write(Serial.read()); }
int helped() { return 8; }
"""

LOW_LEVEL = """
volatile int count;
void low() { if (++count == 3) detachInterrupt(digitalPinToInterrupt(2)); }
void setup() {
  Serial.begin(9600);
  pinMode(2, INPUT);
  attachInterrupt(digitalPinToInterrupt(2), low, LOW);
  delay(1);
  Serial.println(count);
}
void loop() {}
"""


def text_of(folder: Path, sketch: str, sent: bytes = b"") -> str:
    configuration = made_set(folder / "set", ROVER, {"rover.ino": sketch})
    return run_boards(configuration, 1.0, [(0.5, sent)] if sent else ()).text.replace("\r", "")


def test_a_sketch_has_its_own_names(tmp_path: Path) -> None:
    """The runtime still calls the C library's."""
    assert text_of(tmp_path, NAMES) == "closed\n3\n15.00\n"


def test_calls_of_avr_libc(tmp_path: Path) -> None:
    made = "7\n1\n7\n0\n1\n30\n32767\n-2147483648\n2.25\n8\n"
    assert text_of(tmp_path, CALLS, b"x") == f"{made}x"


def test_an_interrupt_of_a_low_level_comes_at_once_and_again(tmp_path: Path) -> None:
    assert text_of(tmp_path, LOW_LEVEL) == "3\n"


def test_a_port_has_a_rate_whatever_it_is_begun_with(tmp_path: Path) -> None:
    sketch = (
        "void setup() { Serial.begin(0); Serial.print(1); Serial.flush(); Serial.begin(4000000000UL); }\n"
        "void loop() { if (Serial.available()) Serial.write(Serial.read()); }\n"
    )
    assert text_of(tmp_path, sketch, b"x") == "1x"


OWN_MAIN = """
int turns;
int main(void) {
  init();
  Serial.begin(9600);
  Serial.println("own");
  while (turns < 2) { turn(); if (serialEventRun) serialEventRun(); }
  Serial.println(millis());
}
void turn() { turns++; delay(10); }
"""


def test_a_main_of_the_sketch_replaces_the_core_s(tmp_path: Path) -> None:
    """After it the board does nothing more, as the core's `exit`. It needs no `setup` and no `loop`."""
    assert text_of(tmp_path, OWN_MAIN, b"x") == "own\n20\n"
    both = "int main(int argc, char **argv) { init(); setup(); for (;;) loop(); }\nlong loops;\n"
    both += "void setup() { Serial.begin(9600); }\nvoid loop() { if (++loops == 3) Serial.println(loops); }\n"
    assert text_of(tmp_path / "both", both) == "3\n"
