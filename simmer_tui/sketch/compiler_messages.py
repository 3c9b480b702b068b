"""Messages of a compiler for people: at most three errors, with the lines of the sketch and what to do."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from functools import cache
from pathlib import Path

from simmer_tui.errors import Problem
from simmer_tui.sketch.boards import BOARDS, BoardKind
from simmer_tui.sketch.compiler import Compiler
from simmer_tui.sketch.cpp_text import code_text
from simmer_tui.sketch.known_headers import CPP_STANDARD, NOWHERE, RUNTIME, libraries, library_headers
from simmer_tui.sketch.preprocess import OWN, includes, sketch_text
from simmer_tui.sketch.prototypes import conditions_of

MOST_ERRORS = 3
"""Errors of the compiler that are shown: later ones mostly follow from the first."""
# A letter more, less or other in a word of five. Two names of one class are further apart: read, onReceive.
_MISTYPED = 0.75
"""Likeness from which on a name that a compiler proposes is the one that was meant."""
_NO_CLOSING = re.compile(r"expected '\}'(?: at end of input)?$")
_NO_REASONS = ("Please ", "See ", "compilation terminated")
"""Beginnings of lines of gcc that follow the reason."""
# Names of the data sheets of ATmega328P and ATmega2560.
_REGISTER = re.compile(
    r"(?:PORT|DDR|PIN)[A-L][0-7]?|P[A-L][0-7]|(?:TCCR|TCNT|OCR|ICR|TIMSK|TIFR|ADC(?!_)|ADMUX|PCICR|PCMSK|PCIFR|EIMSK|EICR"
    r"|EIFR|SPCR|SPSR|SPDR|UCSR|UBRR|UDR|TW[BSACD]|GTCCR|ASSR|SMCR|PRR|MCUSR|WDTCSR)\w*"
    r"|(?:WGM|COM|CS|OCIE|TOIE|TOV|OCF)[0-5]\w*|AD(?:EN|SC|ATE|IF|IE|PS[0-2]|LAR)|PCI(?:E|NT)[0-9]+"
)
"""Registers and bits of the boards' chips."""
_OF_PORTS = re.compile(
    r"digitalPinTo(?:Port|BitMask|Timer|PCICR|PCMSK)\w*|port(?:Output|Input|Mode)Register|_SFR_\w+"
)
"""Calls and macros of the core that lead to registers."""
_OTHER_BOARD = re.compile(
    r"ledc\w+|xTaskCreatePinnedToCore|xPortGetCoreID|esp_\w+|analogWrite(?:Resolution|Frequency)|touch[A-Z]\w+"
    r"|dacWrite|hallRead|timer(?:Begin|Attach|Alarm|Write|Read|Start|Stop)\w*|hw_timer_t|ESP|portMUX_TYPE"
    r"|analogReadResolution|analogSet\w+|ADC_\w+|WRITE_PERI_REG|attachInterruptArg|Ticker|ESP_ERR\w*"
    r"|(?:gpio|mcpwm|pcnt|rmt|nvs|i2s)_\w+"
)
"""Calls of the ESP32 and of 32-bit boards."""
_OF_TASKS = re.compile(
    r"(?:[evx]|u[lx]|p[cv])(?:Task|Queue|Semaphore|Timer|EventGroup|StreamBuffer|MessageBuffer)\w+"
    r"|(?:task|port|config|pd|err)[A-Z]\w+|(?:Task|Queue|Semaphore|Timer|EventGroup)Handle_t"
    r"|(?:TickType|BaseType|UBaseType|EventBits)_t"
)
"""Names of FreeRTOS."""
_OWN_TYPES = {
    "int16_t": "int",
    "uint16_t": "unsigned int",
    "int32_t": "long",
    "uint32_t": "unsigned long",
    "int64_t": "long long",
    "uint64_t": "unsigned long long",
}
"""Number types of an AVR by those that stand for them."""
_WIDE_TYPES = {"int32_t": "int", "uint32_t": "unsigned int"}
"""Those that differ with an `int` of 32 bits."""
_NO_FIT = "this number does not fit"
# gcc writes a character by its octal code in 32 bits.
_CHANGED = re.compile(r"changes value from '?(-?[0-9]+)'? to '?(?:'\\([0-7]+)'|(-?[0-9]+))")
_BITS = re.compile(r"\b(?:0[xX][0-9a-fA-F']+|0?[bB][01']+)\b")
"""A number that a sketch gives by its bits: all of a variable's are meant to be used, the sign too."""
_WARNINGS = {
    **dict.fromkeys(("-Woverflow", "-Wconversion", "-Wconstant-conversion"), _NO_FIT),
    "-fpermissive": "a text or an address is taken for a number: 'a' is a letter, \"a\" is a text",
    "-Wreturn-type": "this function ends without its return",
}
"""Sentences about the warnings of compilers that are passed on, by the warning's option."""


def missing_header(output: str, files: Sequence[Path], board: BoardKind | None) -> Problem | None:
    """The problem of the header that a compiler did not find."""
    for place, kind, text in _messages(output):
        found = re.match(r"'?([^':]+?)'?(?:: No such file or directory| file not found)", text)
        if kind == "error" and found:
            return _no_header(place, found[1].removeprefix(NOWHERE), files, board)
    return None


def missing_headers(files: Sequence[Path], known: Collection[str], board: BoardKind) -> Iterator[Problem]:
    """The problems of headers that the .ino files include without a condition, and that no board has."""
    listed = True
    for file in files:
        source = sketch_text(file)
        conditions = conditions_of(code_text(source))
        for header, line in includes(source):
            low = header.lower()
            place = sum(map(len, source.split("\n")[: line - 1])) + line - 1
            inside = conditions[bisect_right(conditions, place, key=lambda each: each[0]) - 1][1]
            if not inside and low not in known and low.rpartition("/")[2] not in known:
                yield _no_header(f"{file.name}:{line}", header, files, board, listed=listed)
                listed = False


def _no_header(
    place: str, name: str, files: Sequence[Path], board: BoardKind | None, *, listed: bool = True
) -> Problem:
    """The problem of a header that no library has; with `listed`, those that are there."""
    lacks = frozenset[str]() if board is None else board.lacks
    what = f"there is no library with {name}"
    if name in CPP_STANDARD:
        what = f"{name} is a header of C++, which an AVR board has not"
    if board is not None and name in lacks:
        what = f"{name} is no library of the {board.title}"
    if name.lower().startswith("wifi"):
        what = f"{name}: WiFi is not simulated; use Bluetooth or the USB port"
    if not listed:
        return Problem(place, what)
    there = ", ".join(each for each in libraries() if each not in lacks)
    own = f"{files[0].parent.name}/libraries/NAME"
    return Problem(place, f"{what}; there are {there}. Put one of your own in {own}")


def _of_pointers(text: str) -> bool:
    """True for a number that is compared with an address, or made of one, or the other way round. The rest of
    what `-fpermissive` allows does the same on the board."""
    found = re.search(r"invalid conversion from '([^']*)'(?: \{[^}]*\})? to '([^']*)'", text)
    if found is None:
        return "comparison between pointer and integer" in text
    return found[1].endswith(("*", ")")) != found[2].endswith(("*", ")"))


def _messages(output: str) -> Iterator[tuple[str, str, str]]:
    """The place, kind and text of each message of a compiler."""
    for line in output.splitlines():
        found = re.match(r"(.+?:\d+)(?::\d+)?: (?:fatal )?(error|warning): (.*)", line)
        if found:
            name, _, number = found[1].rpartition(":")
            yield f"{_own_name(Path(name).name)}:{number}", found[2], found[3].replace(OWN, "")


def _own_name(name: str) -> str:
    """The file of a sketch that a unit was made of."""
    return name.removesuffix(".cpp") if name.endswith((".ino.cpp", ".pde.cpp")) else name


def _of_no_library(text: str) -> str:
    """The sentence about a name that a class of the runtime's libraries has not; else empty."""
    # As gcc and clang write them: of an object, then of the class.
    found = (
        re.search(r"'(?:class |struct )?(?P<kind>\w+)' has no member named '(?P<name>\w+)'", text)
        or re.search(r"'(?P<name>\w+)' is not a member of '(?P<kind>\w+)'", text)
        or re.search(r"no member named '(?P<name>\w+)' in '(?P<kind>\w+)'", text)
    )
    if found is None or found["kind"] not in _library_classes() | _core_classes():
        return ""
    meant = re.search(r"did you mean '(\w+)'", text)
    if meant is not None and get_close_matches(found["name"], [meant[1]], cutoff=_MISTYPED):
        return ""
    what = f"the simulator's {found['kind']} has no {found['name']}; its calls are in docs/sketch-calls.md"
    if found["kind"] in _core_classes():
        return f"{what}. Write it with those that are there"
    return f"{what}. Put another library of this name in the sketch's folder, in libraries/NAME"


@cache
def _library_classes() -> frozenset[str]:
    return _classes_of(library_headers())


@cache
def _core_classes() -> frozenset[str]:
    return _classes_of((RUNTIME / "core").glob("*.h"))


def _classes_of(headers: Iterable[Path]) -> frozenset[str]:
    texts = (each.read_text(encoding="utf-8") for each in headers)
    return frozenset(name for text in texts for name in re.findall(r"(?m)^(?:class|struct) (\w+)", text))


def _of_no_board(text: str, line: str, kind: BoardKind | None) -> str:
    """The sentence about a register, an interrupt or a call that no simulated board has; else empty."""
    undeclared = re.search(
        r"'(?P<gcc>\w+)' (?:was not declared|does not name a type|has not been declared)"
        r"|(?:undeclared identifier|unknown type name) '(?P<clang>\w+)'",
        text,
    )
    name = (undeclared["gcc"] or undeclared["clang"]) if undeclared else ""
    vector = re.search(r"\b(?:ISR|SIGNAL)\s*\(\s*(\w+)", line)
    if vector is not None and (not name or name == vector[1]):
        what = f"{vector[1]} is an interrupt of the chip's own parts, which are not simulated"
        return f"{what}: use attachInterrupt, millis or micros"
    if name.startswith("SPI"):
        return f"{name} is of SPI, and no part of the simulated robot is on that bus: leave its calls out"
    if _OF_PORTS.fullmatch(name):
        return f"{name} leads to registers, which are not simulated: use digitalRead and digitalWrite"
    if _REGISTER.fullmatch(name):
        what = f"{name} is a register of the chip, and registers are not simulated"
        return f"{what}: use digitalRead, digitalWrite, analogRead, analogWrite or attachInterrupt"
    if _OTHER_BOARD.fullmatch(name):
        if kind is not None and kind.int_bits == 32:
            return f"{name} is not simulated; the calls of an ESP32 are in docs/sketch-esp32-freertos.md"
        return f"{name} is a call of another board; give it in wiring.toml. There are {', '.join(BOARDS)}"
    return _of_no_task(name) if _OF_TASKS.fullmatch(name) else ""


def _of_no_port(text: str, kind: BoardKind | None) -> str:
    """The sentence about a serial port that this board has not, and another one has; else empty."""
    found = re.search(r"'(Serial\d)' was not declared|undeclared identifier '(Serial\d)'", text)
    name = (found[1] or found[2]) if found else ""
    others = [each.title for each in BOARDS.values() if name in each.serial]
    if kind is None or not others or name in kind.serial:
        return ""
    what = f"{name} is a port of the {' or '.join(others)}, and the {kind.title} has none of this name"
    return f"{what}: correct the board in wiring.toml"


def _with_own_types(text: str, line: str, kind: BoardKind | None) -> str:
    """A message with the number types as the author has them: they were replaced by those of the board."""
    is_wide = kind is not None and kind.int_bits == 32
    for made, own in (_OWN_TYPES | _WIDE_TYPES if is_wide else _OWN_TYPES).items():
        if not re.search(rf"\b{made}\b", line):
            text = re.sub(rf"\b{made}\b", own, text)
    return text


def _of_no_task(name: str) -> str:
    """The sentence about a name of FreeRTOS that a sketch has not."""
    for header in sorted((RUNTIME / "libraries" / "freertos").glob("*.h")):
        if re.search(rf"\b{name}\b", header.read_text(encoding="utf-8")):
            last = "Arduino_FreeRTOS.h" if header.stem in ("FreeRTOS", "task") else header.name
            return f"{name} is of FreeRTOS, which is not included: add #include <{last}>"
    what = f"the simulator's FreeRTOS has no {name}; its calls are in docs/sketch-esp32-freertos.md"
    return f"{what}. Write it with those that are there"


def _unclosed(output: str) -> str:
    """The place of a brace that is not closed; empty if all are."""
    at_end = False
    for line in output.splitlines():
        found = re.match(r"(.+?):(\d+)(?::\d+)?: (error|note): (.*)", line)
        if found is not None and found[3] == "error":
            at_end = _NO_CLOSING.match(found[4]) is not None
        elif found is not None and at_end and found[4].startswith("to match this '{'"):
            return f"{_own_name(Path(found[1]).name)}:{found[2]}"
    return ""


def _c_texts(files: Sequence[Path]) -> Iterator[str]:
    """The .c files beside a sketch."""
    folder = files[0].parent
    yield from map(sketch_text, sorted((*folder.glob("*.c"), *(folder / "src").rglob("*.c"))))


def compiler_errors(
    output: str, compiler: Compiler, files: Sequence[Path], board: BoardKind | None = None
) -> Iterator[Problem]:
    """At most three errors, with the lines of the sketch."""
    texts = {each.name: sketch_text(each).split("\n") for each in files}
    seen = 0
    shown: list[Problem] = []
    unclosed = _unclosed(output)
    if unclosed:
        yield Problem(unclosed, "this { has no }: the end of the sketch comes first")
        seen = MOST_ERRORS - 1
    for place, kind, text in _messages(output):
        # A brace that is not closed leaves the end of ours inside a function.
        if kind != "error" or "sketch_start" in text or (unclosed and _NO_CLOSING.match(text)):
            continue
        line = _line(texts, place)
        text = _with_own_types(text, line, board)
        told = _of_no_board(text, line, board) or _of_no_library(text) or _of_no_port(text, board)
        problem = Problem(place, told or (f"{text}: {line}" if line else text))
        # A macro has its mistake at each of its uses.
        if problem in shown:
            continue
        shown.append(problem)
        yield problem
        seen += 1
        if seen == MOST_ERRORS:
            return
    if not seen:
        undefined = re.search(r"undefined (?:reference to|symbol:?) [`'\"]?([^'\"\n]+)", output)
        twice = re.search(r"(?:multiple definition of|duplicate symbol:?) [`'\"]?([^'\"\n]+)", output)
        lines = [each for each in output.strip().splitlines() if not each.startswith(_NO_REASONS)]
        what = (lines or ["it printed nothing"])[-1]
        if undefined is not None:
            what = f"{undefined[1]} is used, and defined nowhere"
            name, is_cpp, _ = undefined[1].partition("(")
            if is_cpp and files and any(re.search(rf"\b{name}\s*\(", each) for each in _c_texts(files)):
                what = f'{name}() is in a .c file: declare it in extern "C" {{ }}, or name the file .cpp'
        elif twice is not None:
            what = f"{twice[1]} is defined more than once"
        yield Problem(files[0].name if files else compiler.name, what)


def compiler_warnings(output: str, files: Sequence[Path] = ()) -> list[str]:
    """The warnings of a compiler that are passed on, with their lines. `files` are those of the sketch whose
    lines it cannot show."""
    texts = {each.name: sketch_text(each).split("\n") for each in files}
    lines = output.splitlines()
    found = []
    for at, shown in enumerate(lines):
        for place, kind, text in _messages(shown):
            line = _line(texts, place) or "".join(lines[at + 1 : at + 2])
            told = _warning(text, line) if kind == "warning" else ""
            found += [f"{place}: {told}"] if told else []
    return found


def _line(texts: Mapping[str, Sequence[str]], place: str) -> str:
    """The line of a sketch at a place; empty if there is none."""
    name, _, number = place.rpartition(":")
    lines = texts.get(name, ())
    return lines[int(number) - 1].strip() if 0 < int(number) <= len(lines) else ""


def _warning(text: str, line: str) -> str:
    """The sentence about what a compiler warns of, at a line of the sketch; empty if it is not passed on."""
    option = next((each for each in _WARNINGS if f"[{each}]" in text), "")
    if not option or (option == "-fpermissive" and not _of_pointers(text)):
        return ""
    if _WARNINGS[option] != _NO_FIT:
        return f"{_WARNINGS[option]}: {text}"
    changed = _CHANGED.search(text)
    if changed is None:
        # With this option gcc warns of all numbers that might not fit.
        return "" if option == "-Wconversion" else f"{_NO_FIT}: {text}"
    number, octal, made = changed.groups()
    if option == "-Wconversion" and int(number) in map(_of_bits, _BITS.findall(line)):
        return ""
    return f"{_NO_FIT}: {number} becomes {made or int(octal, 8) - (1 << 32)}"


def _of_bits(text: str) -> int:
    """The number that is given by its bits."""
    digits = text.replace("'", "").lower().lstrip("0")
    return int(digits[1:], 16 if digits[0] == "x" else 2)
