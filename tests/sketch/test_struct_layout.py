"""Structs that a sketch sends as bytes: on an AVR without gaps, on an ESP32 with those of 32 bits."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from simmer_tui.sketch.boards import UNO
from simmer_tui.sketch.build import build_sketch
from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.sketch.struct_layout import with_board_layout
from tests.sketch.rovers import ROVER, made_set
from tests.sketch.running import run_boards

NEEDS_COMPILER = pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
PACKETS = """
#include <NewPing.h>  // of the runtime /*
#include "shapes.h"
#include <time.h>
/*
#include <nowhere.h>
*/
struct Packet { uint8_t id; int v; float f; uint32_t t; uint8_t crc; };
struct Order { char letter; Mode mode; Kind kind; double share; };
union Either { Packet packet; byte raw[12]; };
class Part {
 public:
  Part(byte pin) : pin(pin) {}
  virtual int first() { return list[0]; }
  byte pin; long count; bool on; int list[3] = {4, 5, 6};
};
struct Log : public Printable {
  byte id = 3; String text = "log";
  size_t printTo(Print &p) const { return p.print(text); }
};
Packet packet = {1, -2, 1.5, 100000UL, 9};
Part part(7);
Log journal;
void bump(int &number) { number++; }
void setup() {
  Serial.begin(115200);
  struct tm moment; moment.tm_sec = 5;
  bump(packet.v);
  for (int size : {(int)sizeof(Packet), (int)sizeof(Order), (int)sizeof(Either), (int)sizeof(Shape)}) {
    Serial.print(size); Serial.print(' ');
  }
  Serial.print(GO); Serial.print(BACK); Serial.print((int)Kind::B); Serial.print(part.first());
  Serial.print(journal); Serial.print(moment.tm_sec); Serial.print(__LINE__);
  Serial.write((byte *)&packet, sizeof packet);
}
void loop() {}
"""
SHAPES = """#pragma once
enum Mode { STOP, GO, BACK = 300 };
enum class Kind { A, B };
struct Shape { byte sides; long area; };
"""


@pytest.mark.slow
@NEEDS_COMPILER
@pytest.mark.parametrize(
    ("board", "sizes", "layout"),
    [("uno", "12 9 12 5", "<BhfIB"), ("esp32", "20 24 20 8", "<B3xifIB3x")],
)
def test_a_struct_has_the_bytes_that_it_has_on_the_board(
    board: str, sizes: str, layout: str, tmp_path: Path
) -> None:
    """Those of an Uno are what Arduino's own core sends in simavr."""
    sketches = {"rover.ino": PACKETS, "shapes.h": SHAPES}
    run = run_boards(made_set(tmp_path / "set", ROVER.replace("uno", board), sketches), 0.5)
    data = run.text.encode("latin-1")
    line = PACKETS[: PACKETS.index("__LINE__")].count("\n") + 1
    begin = f"{sizes} 130014log5{line}".encode()
    assert data.startswith(begin), (data, run.failed)
    assert struct.unpack(layout, data[len(begin) :]) == (1, -1, 1.5, 100_000, 9)


@pytest.mark.slow
@NEEDS_COMPILER
def test_the_compiler_knows_the_sizes_too(tmp_path: Path) -> None:
    sketch = tmp_path / "sizes.ino"
    sketch.write_text(
        'struct A { char a; int b; };\nstatic_assert(sizeof(A) == 3, "");\nvoid setup() {}\nvoid loop() {}\n'
    )
    build_sketch(sketch, UNO)


def test_enumerations_of_large_values_stay() -> None:
    assert with_board_layout("enum { A, B = 7 } x;", ()) == "enum  : int16_t { A, B = 7 } x;"
    for kept in (
        "enum Big { A = 40000 };",
        "enum Flag { A = 1 << 15 };",
        "enum Kind : byte { A };",
        "enum Kind k;",
    ):
        assert with_board_layout(kept, ()) == kept


def test_headers_that_are_not_the_sketch_s_own_keep_their_layout() -> None:
    source = '#line 1 "a.ino"\n\n#include <Servo.h>  // x\n/*\n#include <b.h>\n*/\n#include "own/Mine.h"\n'
    made = with_board_layout(source, {"mine.h"})
    assert made == source.replace(
        "#include <Servo.h>",
        '#pragma pack(push, 16)\n#line 2 "a.ino"\n#include <Servo.h>\n#pragma pack(pop)\n#line 2 "a.ino"\n',
    )
