"""Structs of a sketch as an AVR lays them out: members without gaps, and enumerations of 16 bits.

The compiler packs the sketch's own files. Headers of the runtime and of the C library keep the layout of this
machine, which their compiled code has.
"""

from __future__ import annotations

import re
from collections.abc import Collection

from simmer_tui.sketch.cpp_text import code_text, line_at, with_inserted, without_comments

PACKING = "Packing.h"
"""The header of the core from which on structs are packed."""
_INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*[<"](?P<name>[^>"\n]+)[>"]', re.MULTILINE)
# An alignment that no type of a header exceeds.
_WIDEST = 16
_ENUMERATION = re.compile(r"\benum(?:\s+(?:class|struct))?(?:\s+[A-Za-z_]\w*)?\s*(?=\{)")
_LARGEST_INT = 32767


def with_board_layout(source: str, own: Collection[str]) -> str:
    """A source of a sketch with enumerations of 16 bits, and with headers as they are, except its `own`.

    Lines stay those that its `#line` marks say."""
    plain = code_text(source)
    added = [
        (match.end(), " : int16_t ") for match in _ENUMERATION.finditer(plain) if _is_short(plain, match)
    ]
    for match in _INCLUDE.finditer(without_comments(source)):
        begin, end = match.span()
        if match["name"].rpartition("/")[2].lower() in own:
            continue
        file, line = line_at(source, begin)
        mark = f'#line {line} "{file}"'
        added.append((begin, f"#pragma pack(push, {_WIDEST})\n{mark}\n"))
        added.append((end, f"\n#pragma pack(pop)\n{mark}\n"))
    return with_inserted(source, added)


def _is_short(plain: str, match: re.Match[str]) -> bool:
    """True if the values of an enumeration fit 16 bits, as far as numbers tell."""
    body = plain[match.end() : plain.find("}", match.end())]
    numbers = re.findall(r"\b0[xX][0-9a-fA-F]+|\b0[bB][01]+|\b[0-9]+", body)
    return "<<" not in body and all(_value(each) <= _LARGEST_INT for each in numbers)


def _value(number: str) -> int:
    # Octal numbers that Python does not read so are small ones of menus: 007.
    return int(number, 0) if number[:2].lower() in ("0x", "0b") else int(number)
