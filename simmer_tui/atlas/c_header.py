"""An atlas as a C header: a byte a reading, for a microcontroller with little memory."""

from __future__ import annotations

import re

import numpy as np

from simmer_tui.atlas.expected_readings import Atlas
from simmer_tui.errors import AtlasError
from simmer_tui.sim.arrays import NDArray
from simmer_tui.version import __version__

MEGA_FLASH = 256 * 1024
"""Bytes of program memory of an Arduino Mega (ATmega2560), which the tables share with the program."""
# avr-gcc refuses an object above 32,767 bytes: its sizes are signed numbers of two bytes.
LARGEST_ARRAY = 32_000
_NO_ECHO = 255
"""The byte for a reading that is infinite."""
BYTE_UNIT = 0.5
"""Inches a count of a byte, which reaches 127 in; longer readings use a multiple of it. The error of an
HC-SR04 is as large at 25 in (2 %)."""
_A_LINE = 32
"""Numbers in a line: below 132 characters."""

_MACHINE = """\
#ifdef __AVR__
#include <avr/pgmspace.h>
/* Behind the program: before it, as PROGMEM is, large tables would push those of the core out of the first
   64 kB, where its near pointers reach. The program must not return from main, as sketches never do. */
#define ATLAS_TABLE __attribute__((used, section(".fini7")))
#define ATLAS_BYTE(table, at) pgm_read_byte_far(pgm_get_far_address(table) + (at))
#else
#define ATLAS_TABLE
#define ATLAS_BYTE(table, at) (table)[at]
#endif
"""

_ACCESS = """\
/* Number of a pose: row 0 is on top, heading k is 360 k / ATLAS_HEADINGS degrees, counter-clockwise. */
static inline uint32_t atlas_pose(uint16_t row, uint16_t column, uint16_t heading) {
  return ((uint32_t)row * ATLAS_COLUMNS + column) * ATLAS_HEADINGS + heading;
}

/* The reading expected there; of range sensors in inches, INFINITY without an echo. */
static inline float atlas_reading(uint16_t row, uint16_t column, uint16_t heading, uint8_t sensor) {
  uint8_t count = atlas_ranges_byte(atlas_pose(row, column, heading) * ATLAS_SENSORS + sensor);
  return count == 255 ? INFINITY : count * ATLAS_UNIT(sensor);
}

/* 1 where the robot fits, else 0. */
static inline uint8_t atlas_free(uint16_t row, uint16_t column, uint16_t heading) {
  uint32_t pose = atlas_pose(row, column, heading);
  return atlas_free_byte(pose >> 3) >> (pose & 7) & 1;
}

#endif
"""


def table_bytes(atlas: Atlas) -> int:
    """Bytes that the tables of the header take in a microcontroller's program memory."""
    return int(atlas.ranges.size) + (atlas.grid.poses + 7) // 8


def header_bytes(atlas: Atlas) -> bytes:
    """The header, for C99 and C++11. Raises AtlasError for a reading below 0, which a byte cannot store."""
    grid = atlas.grid
    units = [_unit(atlas, sensor) for sensor in range(len(atlas.codes))]
    counts = np.rint(atlas.ranges / np.array(units, np.float32))
    table = np.where(np.isfinite(counts), counts, _NO_ECHO).astype(np.uint8)
    unit = f"{BYTE_UNIT:.1f}f"
    for sensor, each in enumerate(units):
        if each != BYTE_UNIT:
            unit = f"(sensor) == {sensor} ? {each:.1f}f : {unit}"
    # A code with other characters is not a C name: its sensor is named by its number.
    names = [
        f"#define ATLAS_{code} {number}\n"
        for number, code in enumerate(atlas.codes)
        if re.fullmatch(r"\w+", code, re.ASCII)
    ]
    parts = (
        f"/* Readings expected at every pose of a grid, made by simmer-tui {__version__} atlas. */\n"
        "#ifndef SIMMER_ATLAS_H\n#define SIMMER_ATLAS_H\n",
        "#include <math.h>\n#include <stdint.h>\n",
        f"#define ATLAS_ROWS {grid.rows}\n#define ATLAS_COLUMNS {grid.columns}\n"
        f"#define ATLAS_HEADINGS {grid.headings}\n#define ATLAS_STEP {float(grid.step)!r}f /* in */\n"
        f"#define ATLAS_SENSORS {len(atlas.codes)}\n"
        + "".join(names)
        + "/* Value of one count of a byte; 255 is no echo. */\n"
        f"#define ATLAS_UNIT(sensor) ({unit})\n",
        _MACHINE,
        _tables("atlas_ranges", table.ravel()),
        _tables("atlas_free", np.packbits(atlas.free.ravel(), bitorder="little")),
        _ACCESS,
    )
    return "\n".join(parts).encode("ascii")


def _unit(atlas: Atlas, sensor: int) -> float:
    """Value of one count of a sensor's byte. Raises AtlasError for a reading below 0."""
    readings = atlas.ranges[..., sensor]
    finite = readings[np.isfinite(readings)]
    if finite.min(initial=0.0) < 0.0:
        what = (
            f"{atlas.codes[sensor]} reads {finite.min():g} at a pose, and a .h file holds no number below 0"
        )
        raise AtlasError(f"{what}: leave it out of --sensors, or take another format")
    unit = BYTE_UNIT
    while np.rint(finite.max(initial=0.0) / unit) >= _NO_ECHO:
        unit *= 2
    return unit


def _tables(name: str, data: NDArray[np.uint8]) -> str:
    """Arrays of at most `LARGEST_ARRAY` bytes, and the function that reads one byte of them."""
    text, access = [], []
    parts = range(0, len(data), LARGEST_ARRAY)
    for number, begin in enumerate(parts):
        part = data[begin : begin + LARGEST_ARRAY]
        rows = (part[at : at + _A_LINE].tolist() for at in range(0, len(part), _A_LINE))
        lines = ",\n".join(",".join(map(str, row)) for row in rows)
        text.append(f"static const uint8_t {name}_{number}[{len(part)}] ATLAS_TABLE = {{\n{lines}}};\n")
        read = f"return ATLAS_BYTE({name}_{number}, at);"
        last = number == len(parts) - 1
        access.append(
            f"  {read}" if last else f"  if (at < {LARGEST_ARRAY}u) {read}\n  at -= {LARGEST_ARRAY}u;"
        )
    body = "\n".join(access)
    return "".join(text) + f"static inline uint8_t {name}_byte(uint32_t at) {{\n{body}\n}}\n"
