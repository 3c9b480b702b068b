"""Headers that a sketch may include: those of the runtime and its libraries, of the C library, and of C++."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path

RUNTIME = Path(__file__).parent / "arduino"
"""The C++ runtime: Arduino's core and libraries in simulated time."""
NOWHERE = "no-library/"
"""Folder before the headers that no board has, so that the compiler finds none of this machine."""
C_STANDARD = frozenset(
    f"{name}.h"
    for name in (
        *("assert", "ctype", "errno", "float", "inttypes", "limits", "math", "setjmp", "stdarg", "stdbool"),
        *("stddef", "stdint", "stdio", "stdlib", "string", "strings", "time", "new"),
    )
)
"""Headers of the C library that avr-libc has too."""
CPP_STANDARD = frozenset(
    (
        *(
            "algorithm",
            "array",
            "bitset",
            "cassert",
            "cctype",
            "cfloat",
            "chrono",
            "cinttypes",
            "climits",
            "cmath",
        ),
        *("complex", "cstdarg", "cstddef", "cstdint", "cstdio", "cstdlib", "cstring", "deque", "exception"),
        *(
            "forward_list",
            "functional",
            "initializer_list",
            "iterator",
            "limits",
            "list",
            "map",
            "memory",
            "new",
        ),
        *("numeric", "optional", "queue", "random", "set", "sstream", "stack", "stdexcept", "string"),
        *(
            "string_view",
            "tuple",
            "type_traits",
            "unordered_map",
            "unordered_set",
            "utility",
            "variant",
            "vector",
        ),
    )
)
"""Headers of C++ that an ESP32's compiler has. That of an AVR has none."""
# The files of Windows and macOS have no case: sketches from there include such names.
OTHER_NAMES = {
    "arduino.h": "Arduino.h",
    "wprogram.h": "Arduino.h",
    "math.h": "math.h",
    "string.h": "string.h",
    "wire.h": "Wire.h",
    "lcd.h": "LiquidCrystal_I2C.h",  # of a library with the same class
    # FreeRTOS for AVR boards has its headers in no folder.
    **{f"{name}.h": f"freertos/{name}.h" for name in ("task", "queue", "semphr", "timers", "event_groups")},
    "freertos.h": "Arduino_FreeRTOS.h",
    "new.h": "new",
}
_CLASS = re.compile(r"^\s*(?:class|struct|using)\s+(\w+)", re.MULTILINE)


def libraries() -> list[str]:
    """The libraries that sketches may include, by their headers."""
    return sorted(each.name for each in (RUNTIME / "libraries").glob("*.h"))


def is_provided(header: str, own: Collection[str]) -> bool:
    """True if a header is the runtime's, the C library's, or one of a sketch's `own` files."""
    name = header.lower()
    core = {each.name.lower() for each in (RUNTIME / "core").glob("*.h")}
    known = (
        core
        | provided_headers()
        | C_STANDARD
        | CPP_STANDARD
        | set(OTHER_NAMES)
        | {each.lower() for each in own}
    )
    return name in known or name.rpartition("/")[2] in known


def provided_headers() -> set[str]:
    """The headers of the runtime's libraries, in small letters."""
    return {each.relative_to(RUNTIME / "libraries").as_posix().lower() for each in library_headers()}


def provided_classes() -> set[str]:
    """The classes of the runtime's libraries."""
    return {name for path in library_headers() for name in _CLASS.findall(path.read_text("utf-8"))}


def library_headers() -> list[Path]:
    return list((RUNTIME / "libraries").rglob("*.h"))
