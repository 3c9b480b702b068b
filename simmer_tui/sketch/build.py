"""Sketches compiled into programs that run as boards, kept by the content of all their sources."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import tempfile
from bisect import bisect_right
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from functools import cache
from pathlib import Path

from msgspec import Struct

from simmer_tui import platform_has
from simmer_tui.config.set_sketches import library_paths, main_files, source_paths
from simmer_tui.errors import ConfigurationError, Problem, reason_of
from simmer_tui.sketch.boards import BOARDS, BoardKind
from simmer_tui.sketch.compiler import NO_COMPILER, Compiler, find_compiler, links_at_fixed_addresses
from simmer_tui.sketch.cpp_text import code_text
from simmer_tui.sketch.preprocess import (
    OWN,
    board_source,
    includes,
    joined_source,
    own_c_names,
    own_templates,
    sketch_start,
    sketch_text,
)
from simmer_tui.sketch.prototypes import conditions_of
from simmer_tui.sketch.struct_layout import PACKING, with_board_layout
from simmer_tui.sketch.switch_scopes import with_case_scopes

RUNTIME = Path(__file__).parent / "arduino"
"""The C++ runtime: Arduino's core and libraries in simulated time."""
RUNTIME_NAME = "<runtime>"
"""Folder of the runtime in a build's debugging information, which may have been made by another
installation."""
BOARD_PROGRAM, _WARNINGS_FILE = "board.exe", "warnings.txt"
"""In the folder of a build: the compiled sketch, and what its compiler told."""
MOST_ERRORS = 3
"""Errors of the compiler that are shown: later ones mostly follow from the first."""
_COMPILED = frozenset((".c", ".cpp", ".cc", ".cxx"))
_HEADERS = frozenset((".h", ".hpp", ".hh"))
_NOWHERE = "no-library/"
"""Folder before the headers that no board has, so that the compiler finds none of this machine."""
_STANDARD = frozenset(
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
_OTHER_NAMES = {
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
_REWRITING = ("preprocess", "c_names", "cpp_text", "prototypes", "struct_layout", "switch_scopes")
"""Modules that make the C++ of a sketch."""
_FLAGS = (
    "-std=gnu++17",
    "-fpermissive",
    "-Wno-narrowing",
    "-Wreturn-type",
    "-DARDUINO=10819",
    "-Ulinux",
    "-Uunix",
)
_AVR_FLAGS = ("-DARDUINO_ARCH_AVR", "-D__AVR__")
_ESP32_FLAGS = ("-DARDUINO_ARCH_ESP32", "-DESP32", "-DSIMMER_ESP32")
_BAUDS = frozenset(
    (
        *(300, 600, 1200, 2400, 4800, 9600, 14400, 19200, 28800, 31250, 38400, 57600, 74880, 115200),
        *(230400, 250000, 460800, 500000, 921600, 1000000, 2000000),
    )
)
_USUAL_BAUD = 9600
_BLUETOOTH_BAUD = 115200
"""The rate of BluetoothSerial.h."""
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
    r"ledc\w+|xTaskCreatePinnedToCore|xPortGetCoreID|esp_\w+|analogWrite(?:Resolution|Frequency)|touchRead"
    r"|dacWrite|hallRead|timer(?:Begin|Attach|Alarm|Write|Read|Start|Stop)\w*|hw_timer_t|ESP|portMUX_TYPE"
    r"|analogReadResolution|analogSet\w+|ADC_\w+|WRITE_PERI_REG|attachInterruptArg"
)
"""Calls of the ESP32 and of 32-bit boards."""
_OF_TASKS = re.compile(
    r"(?:[evx]|u[lx]|p[cv])(?:Task|Queue|Semaphore|Timer|EventGroup|StreamBuffer|MessageBuffer)\w+"
    r"|(?:task|port|config|pd|err)[A-Z]\w+|(?:Task|Queue|Semaphore|Timer|EventGroup)Handle_t"
    r"|(?:TickType|BaseType|UBaseType|EventBits)_t"
)
"""Names of FreeRTOS."""
_WARNINGS = {
    "-Woverflow": "this number does not fit",
    "-Wconstant-conversion": "this number does not fit",
    "-fpermissive": "a text or an address is taken for a number: 'a' is a letter, \"a\" is a text",
    "-Wreturn-type": "this function ends without its return",
}
"""Sentences about the warnings of compilers that are passed on, by the warning's option."""


class BuiltSketch(Struct, frozen=True):
    """A compiled sketch.

    Attributes:
        program: the file to run.
        digest: SHA-256 of the sketch's own files, as 16 hexadecimal digits.
        warnings: constants that do not fit their variable, and functions that end without a return, each
            with its line.
    """

    program: Path
    digest: str
    warnings: tuple[str, ...] = ()


class _Source(Struct, frozen=True):
    """A file of a sketch or of a library beside it; `name` is its path in the build folder."""

    path: Path
    name: str


def libraries() -> list[str]:
    """The libraries that sketches may include, by their headers."""
    return sorted(each.name for each in (RUNTIME / "libraries").glob("*.h"))


def is_provided(header: str, own: Collection[str]) -> bool:
    """True if a header is the runtime's, the C library's, or one of a sketch's `own` files."""
    name = header.lower()
    core = {each.name.lower() for each in (RUNTIME / "core").glob("*.h")}
    known = core | _provided() | _STANDARD | CPP_STANDARD | set(_OTHER_NAMES) | {each.lower() for each in own}
    return name in known or name.rpartition("/")[2] in known


def build_sketch(sketch: Path, kind: BoardKind, place: str = "") -> BuiltSketch:
    """Compile a sketch for a kind of board, unless that has been done.

    `sketch` is an .ino file or its folder, `place` its place in wiring.toml for messages. Raises
    ConfigurationError with at most three errors of the compiler.
    """
    compiler = find_compiler()
    where = place or str(sketch)
    if compiler is None:
        raise ConfigurationError([Problem(where, NO_COMPILER)])
    files, sources, digest = _read(sketch, where)
    key = hashlib.sha256(
        "\0".join((digest, kind.macro, compiler.identity, _runtime_digest(), *_FLAGS)).encode()
    ).hexdigest()
    folder = build_folder() / f"{files[0].stem}-{key[:20]}"
    try:
        if not (folder / BOARD_PROGRAM).exists():
            _compile_to_cache(compiler, kind, files, sources, folder)
        return _built(folder, digest)
    except OSError as error:
        what = f"the compiled sketch cannot be used: {reason_of(error)}. Delete what is there, or make room"
        raise ConfigurationError([Problem(str(error.filename or folder), what)]) from None


def compile_sketch(
    compiler: Compiler, sketch: Path, kind: BoardKind, place: str, runtime: Path, folder: Path
) -> BuiltSketch:
    """Compile a sketch in an empty folder, with a `runtime` that is compiled already. Raises
    ConfigurationError, OSError."""
    files, sources, digest = _read(sketch, place)
    _compile(compiler, kind, files, sources, runtime, folder)
    return _built(folder, digest)


def _read(sketch: Path, where: str) -> tuple[list[Path], list[_Source], str]:
    """The .ino files of a sketch, its other sources, and the hash of all of them. Raises
    ConfigurationError."""
    files = main_files(sketch)
    if not files:
        raise ConfigurationError([Problem(where, f"{sketch.name} has no .ino file")])
    sources = list(_sources(sketch, files))
    return files, sources, _digest_of([*files, *(each.path for each in sources)])


def _built(folder: Path, digest: str) -> BuiltSketch:
    told = (folder / _WARNINGS_FILE).read_text(encoding="utf-8").splitlines()
    return BuiltSketch(folder / BOARD_PROGRAM, digest[:16], tuple(told))


def fastest_baud(sketch: Path) -> int:
    """The fastest rate that a sketch names; it sends no byte in less time."""
    files = main_files(sketch)
    texts = [sketch_text(each) for each in (*files, *(each.path for each in _sources(sketch, files)))]
    named = {int(each) for text in texts for each in re.findall(r"\b[0-9]{3,7}\b", text)}
    if any("BluetoothSerial" in text for text in texts):
        named.add(_BLUETOOTH_BAUD)
    return max(named.intersection(_BAUDS), default=_USUAL_BAUD)


def build_folder() -> Path:
    """The folder of compiled sketches. Everything in it may be deleted."""
    return platform_has.data_folder() / "sketches"


# -- sources ------------------------------------------------------------------------------------------


def _sources(sketch: Path, files: Sequence[Path]) -> Iterator[_Source]:
    """The code beside a sketch, and that of the libraries which it includes."""
    beside = [_Source(each, each.name) for each in source_paths(sketch) if each not in files]
    libraries_there: dict[str, list[_Source]] = {}
    own = files[0].parent / "libraries"
    for path, name in library_paths(files[0].parent):
        if not name.startswith("libraries/"):
            beside.append(_Source(path, name))
        else:
            libraries_there.setdefault(name.split("/")[1], []).append(_Source(path, name))
    provided = _provided()
    for name, code in tuple(libraries_there.items()):
        # Arduino takes one library for a header. That of the whole sketchbook needs the real chip.
        if not own.is_dir() and not provided.isdisjoint(_headers_of(code)):
            del libraries_there[name]
    yield from beside
    own_names = {each.name.lower() for each in beside}
    waiting = [*files, *(each.path for each in beside)]
    while waiting and libraries_there:
        for header, _ in includes(sketch_text(waiting.pop())):
            name = _library_of(header.lower(), libraries_there)
            if name and header.lower() not in own_names:
                code = libraries_there.pop(name)
                waiting += [each.path for each in code]
                yield from code


def _headers_of(library: Sequence[_Source]) -> set[str]:
    """The names by which the headers of a library are included."""
    found = (each.name.split("/", 2)[2].lower() for each in library)
    return {each for each in found if Path(each).suffix in _HEADERS}


def _library_of(header: str, there: Mapping[str, Sequence[_Source]]) -> str:
    """The library with a header, by Arduino's rule: the header's own name goes first. Empty if none."""
    found = [name for name, code in there.items() if header in _headers_of(code)]
    stem = Path(header).stem
    return min(found, key=lambda each: (each.lower() != stem, each), default="")


def _provided() -> set[str]:
    """The headers of the runtime's libraries, in small letters."""
    return {each.relative_to(RUNTIME / "libraries").as_posix().lower() for each in _library_headers()}


def _known_headers(sources: Sequence[_Source], kind: BoardKind) -> set[str]:
    """The headers that a sketch may include, in small letters."""
    own = {Path(each.name).name.lower() for each in sources}
    core = {each.name.lower() for each in (RUNTIME / "core").glob("*.h")}
    known = core | _provided() | _STANDARD | set(_OTHER_NAMES)
    if kind.int_bits == 32:
        known |= CPP_STANDARD
    # The sketches of an ESP32 have FreeRTOS without a header, or by those of its folder.
    lacks = {each.lower() for each in kind.lacks}
    return (known - ({"wire.h"} - _provided()) - lacks) | own


def _missing_header(output: str, files: Sequence[Path], board: BoardKind | None) -> Problem | None:
    """The problem of the header that a compiler did not find."""
    for place, kind, text in _messages(output):
        found = re.match(r"'?([^':]+?)'?(?:: No such file or directory| file not found)", text)
        if kind == "error" and found:
            return _no_header(place, found[1].removeprefix(_NOWHERE), files, board)
    return None


def _missing_headers(files: Sequence[Path], known: Collection[str], board: BoardKind) -> Iterator[Problem]:
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
    if name.lower().startswith("wifi"):
        return Problem(place, f"{name}: WiFi is not simulated; use Bluetooth or the USB port")
    lacks = frozenset[str]() if board is None else board.lacks
    what = f"there is no library with {name}"
    if name in CPP_STANDARD:
        what = f"{name} is a header of C++, which an AVR board has not"
    if board is not None and name in lacks:
        what = f"{name} is no library of the {board.title}"
    if not listed:
        return Problem(place, what)
    there = ", ".join(each for each in libraries() if each not in lacks)
    own = f"{files[0].parent.name}/libraries/NAME"
    return Problem(place, f"{what}; there are {there}. Put one of your own in {own}")


def _library_headers() -> list[Path]:
    return list((RUNTIME / "libraries").rglob("*.h"))


def _digest_of(paths: Sequence[Path]) -> str:
    made = hashlib.sha256()
    for path in paths:
        data = path.read_bytes()
        made.update(f"{path.name}\0{len(data)}\0".encode() + data)
    return made.hexdigest()


@cache
def _runtime_digest() -> str:
    files = sorted(each for each in RUNTIME.rglob("*") if each.suffix in (".h", ".cpp"))
    # The code that rewrites sketches counts too.
    return _digest_of(
        [
            *files,
            Path(__file__),
            *(Path(__file__).with_name(f"{each}.py") for each in _REWRITING),
        ]
    )


# -- compiling ----------------------------------------------------------------------------------------


def _compile_to_cache(
    compiler: Compiler, kind: BoardKind, files: Sequence[Path], sources: Sequence[_Source], folder: Path
) -> None:
    """Compile a sketch into a folder, which appears when all of it is done. Raises ConfigurationError."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix="build-") as name:
        _compile(compiler, kind, files, sources, runtime_object(compiler, kind), Path(name))
        _move(Path(name), folder)


def _compile(
    compiler: Compiler,
    kind: BoardKind,
    files: Sequence[Path],
    sources: Sequence[_Source],
    runtime: Path,
    work: Path,
) -> None:
    """Compile a sketch in a folder. Raises ConfigurationError."""
    known = _known_headers(sources, kind)
    missing = list(_missing_headers(files, known, kind))
    if missing:
        raise ConfigurationError(missing)
    # Arduino's build names it so too. Debuggers take the name of the unit for that of its first file.
    main = f"{files[0].name}.cpp"
    beside = [each.path for each in sources if not _in_library(each)]
    texts = [sketch_text(each) for each in (*files, *beside)]
    names, templates = own_c_names(texts), own_templates(texts)
    joined = joined_source(files, names, templates, kind.int_bits) + sketch_start(texts)
    own_files = {Path(each.name).name.lower() for each in sources}

    def laid_out(text: str) -> str:
        return with_board_layout(with_case_scopes(text), own_files) if kind.int_bits == 16 else text

    (work / main).write_text(laid_out(_with_names(joined, known, sources)), encoding="utf-8")
    for each in sources:
        target = work / each.name
        target.parent.mkdir(parents=True, exist_ok=True)
        own = None if _in_library(each) else known
        code = sketch_text(each.path)
        bits = kind.int_bits
        if own is None:
            code = board_source(code, int_bits=bits)
        else:
            code = board_source(code, names, templates, bits)
        text = laid_out(f'#line 1 "{each.name}"\n{_with_names(code, own, sources)}')
        if target.suffix == ".c":
            # Arduino compiles it as C: its functions have the names of C, and the sketch needs extern "C".
            text = f'extern "C" {{\n{text}\n}}\n'
        if target.suffix in _COMPILED:
            text = f'#include "Arduino.h"\n{text}'
        target.write_text(text, encoding="utf-8")
    units = [main, *(each.name for each in sources if Path(each.name).suffix in _COMPILED)]
    told: list[str] = []
    objects = []
    for number, unit in enumerate(units):
        made = f"{number}.o"
        flags = [*_flags(kind), *_instrumented(compiler), *_include_paths(work, sources), *_packed(kind)]
        told += _run(compiler, [*flags, "-x", "c++", "-c", unit, "-o", made], work, files, kind)
        objects.append(made)
    fixed = ["-no-pie"] if links_at_fixed_addresses() else []
    # Globals are constructed in this order: `Serial` is there before those of the sketch.
    _run(compiler, [*fixed, str(runtime), *objects, "-o", BOARD_PROGRAM], work, files)
    (work / _WARNINGS_FILE).write_text("\n".join(told), encoding="utf-8")
    for made in objects:
        (work / made).unlink()


def _in_library(source: _Source) -> bool:
    return source.name.startswith("libraries/")


def _move(made: Path, target: Path) -> None:
    """Move a folder to its place, unless another process has made it meanwhile."""
    try:
        shutil.copytree(made, f"{target}.{os.getpid()}")
        Path(f"{target}.{os.getpid()}").rename(target)
    except OSError:
        shutil.rmtree(f"{target}.{os.getpid()}", ignore_errors=True)
        if not (target / BOARD_PROGRAM).exists():
            raise


def runtime_object(compiler: Compiler, kind: BoardKind) -> Path:
    """The runtime, compiled for a kind of board. Raises ConfigurationError, OSError."""
    key = hashlib.sha256(f"{_runtime_digest()}\0{compiler.identity}\0{kind.macro}".encode()).hexdigest()
    made = build_folder() / f"runtime-{key[:20]}.o"
    if not made.exists():
        made.parent.mkdir(parents=True, exist_ok=True)
        part = made.with_suffix(f".{os.getpid()}.o")
        _run(
            compiler, [*_flags(kind), "-O2", "-c", str(RUNTIME / "runtime.cpp"), "-o", str(part)], RUNTIME, ()
        )
        part.chmod(0o644)  # a sandbox reads it with another user ID
        part.replace(made)
    return made


def _flags(kind: BoardKind) -> list[str]:
    mega = ["-DSIMMER_MEGA"] if kind.name == "mega" else []
    chip = _AVR_FLAGS if kind.int_bits == 16 else _ESP32_FLAGS
    fixed = ["-fno-pie"] if links_at_fixed_addresses() else []
    return [*_FLAGS, *chip, f"-D{kind.macro}", *mega, *fixed]


def _instrumented(compiler: Compiler) -> list[str]:
    coverage = "trace-pc" if compiler.is_gcc else "bb,no-prune,trace-pc"
    named = f"-fdebug-prefix-map={RUNTIME}={RUNTIME_NAME}"
    # Else a function without its return would go on in the code that happens to follow. gcc takes the end of
    # such a function for unreachable, unless it looks after what is unreachable.
    returns = ["-fsanitize=unreachable", "-fsanitize-undefined-trap-on-error"]
    if not compiler.is_gcc:
        returns = ["-fno-strict-return"]
    return ["-O1", "-g1", named, f"-fsanitize-coverage={coverage}", *returns]


def _packed(kind: BoardKind) -> list[str]:
    """The headers that come before a file of a sketch, so that its structs are those of the board."""
    if kind.int_bits != 16:
        return []
    return [part for name in ("Arduino.h", PACKING) for part in ("-include", str(RUNTIME / "core" / name))]


def _include_paths(work: Path, sources: Sequence[_Source]) -> list[str]:
    folders = [str(work), str(work / "src"), *(str(work / Path(each.name).parent) for each in sources)]
    paths = dict.fromkeys([*folders, str(RUNTIME / "core"), str(RUNTIME / "libraries")])
    return [part for path in paths for part in ("-I", path)]


def _with_names(source: str, allowed: set[str] | None, sources: Sequence[_Source]) -> str:
    """Includes with the names of the files as they are here: elsewhere file names have no case. Headers that
    are not among those allowed get a folder that is not there."""
    known = {each.name.lower(): each.name for each in (*(RUNTIME / "core").glob("*.h"), *_library_headers())}
    own = {Path(each.name).name for each in sources}
    own_there = {each.lower(): each for each in own}
    known |= own_there

    def renamed(match: re.Match[str]) -> str:
        name = match[2]
        low = name.lower()
        if allowed is not None and low not in allowed and low.rpartition("/")[2] not in allowed:
            return f"{match[1]}{_NOWHERE}{name}{match[3]}"
        folder, slash, last = name.rpartition("/")
        if last in own:
            return match[0]
        found = own_there.get(low) or _OTHER_NAMES.get(low) or known.get(low)
        if slash and last.lower() in {each.lower() for each in own}:
            found = f"{folder}/{known[last.lower()]}"
        return f"{match[1]}{found or name}{match[3]}"

    return re.sub(r'(?m)^(\s*#\s*include\s*[<"])([^>"\n]+)([>"])', renamed, source)


def _run(
    compiler: Compiler,
    arguments: Sequence[str],
    folder: Path,
    files: Sequence[Path],
    kind: BoardKind | None = None,
) -> list[str]:
    """Run the compiler; returns its warnings. Raises ConfigurationError with its errors."""
    try:
        done = compiler.run(arguments, folder)
    except (OSError, subprocess.SubprocessError) as error:
        raise ConfigurationError([Problem(compiler.name, f"could not be run: {error}")]) from None
    if done.returncode:
        missing = _missing_header(done.stderr, files, kind) if files else None
        found = [missing] if missing else list(_errors(done.stderr, compiler, files, kind))
        raise ConfigurationError(found)
    return [
        f"{place}: {sentence}: {text}"
        for place, kind, text in _messages(done.stderr)
        for option, sentence in _WARNINGS.items()
        if kind == "warning" and option in text and (option != "-fpermissive" or _of_pointers(text))
    ]


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
    return _classes_of(_library_headers())


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


def _errors(
    output: str, compiler: Compiler, files: Sequence[Path], board: BoardKind | None = None
) -> Iterator[Problem]:
    """At most three errors, with the lines of the sketch."""
    texts = {each.name: sketch_text(each).split("\n") for each in files}
    seen = 0
    unclosed = _unclosed(output)
    if unclosed:
        yield Problem(unclosed, "this { has no }: the end of the sketch comes first")
        seen = MOST_ERRORS - 1
    for place, kind, text in _messages(output):
        # A brace that is not closed leaves the end of ours inside a function.
        if kind != "error" or "sketch_start" in text or (unclosed and _NO_CLOSING.match(text)):
            continue
        name, _, number = place.rpartition(":")
        lines = texts.get(name, [])
        line = lines[int(number) - 1].strip() if 0 < int(number) <= len(lines) else ""
        told = _of_no_board(text, line, board) or _of_no_library(text)
        yield Problem(place, told or (f"{text}: {line}" if line else text))
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
