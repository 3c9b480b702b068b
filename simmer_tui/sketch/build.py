"""Sketches compiled into programs that run as boards, kept by the content of all their sources."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path

from msgspec import Struct

from simmer_tui import platform_has
from simmer_tui.config.set_sketches import library_paths, main_files, source_paths
from simmer_tui.errors import ConfigurationError, Problem, reason_of
from simmer_tui.sketch.boards import BOARDS, BoardKind
from simmer_tui.sketch.compiler import NO_COMPILER, Compiler, find_compiler, links_at_fixed_addresses
from simmer_tui.sketch.compiler_messages import (
    compiler_errors,
    compiler_warnings,
    missing_header,
    missing_headers,
)
from simmer_tui.sketch.known_headers import (
    C_STANDARD,
    CPP_STANDARD,
    NOWHERE,
    OTHER_NAMES,
    RUNTIME,
    library_headers,
    provided_headers,
)
from simmer_tui.sketch.preprocess import (
    board_source,
    includes,
    joined_source,
    own_c_names,
    own_templates,
    sketch_start,
    sketch_text,
)
from simmer_tui.sketch.struct_layout import PACKING, with_board_layout
from simmer_tui.sketch.switch_scopes import with_case_scopes

RUNTIME_NAME = "<runtime>"
"""Folder of the runtime in a build's debugging information, which may have been made by another
installation."""
BOARD_PROGRAM, _WARNINGS_FILE = "board.exe", "warnings.txt"
"""In the folder of a build: the compiled sketch, and what its compiler told."""
_COMPILED = frozenset((".c", ".cpp", ".cc", ".cxx"))
_HEADERS = frozenset((".h", ".hpp", ".hh"))
_REWRITING = (
    "preprocess",
    "c_names",
    "cpp_text",
    "prototypes",
    "struct_layout",
    "switch_scopes",
    "known_headers",
)
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
    provided = provided_headers()
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


def _known_headers(sources: Sequence[_Source], kind: BoardKind) -> set[str]:
    """The headers that a sketch may include, in small letters."""
    own = {Path(each.name).name.lower() for each in sources}
    core = {each.name.lower() for each in (RUNTIME / "core").glob("*.h")}
    known = core | provided_headers() | C_STANDARD | set(OTHER_NAMES)
    if kind.int_bits == 32:
        known |= CPP_STANDARD
    # The sketches of an ESP32 have FreeRTOS without a header, or by those of its folder.
    lacks = {each.lower() for each in kind.lacks}
    return (known - ({"wire.h"} - provided_headers()) - lacks) | own


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
    missing = list(missing_headers(files, known, kind))
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
        # Without it gcc says nothing of 40000 in 16 bits with a sign.
        warned = ["-Wconversion"] if compiler.is_gcc else []
        paths = _include_paths(work, sources)
        flags = [*_flags(kind), *warned, *_instrumented(compiler), *paths, *_packed(kind)]
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
    made = _runtime_file(compiler, kind)
    if not made.exists():
        made.parent.mkdir(parents=True, exist_ok=True)
        part = made.with_suffix(f".{os.getpid()}.o")
        _run(
            compiler, [*_flags(kind), "-O2", "-c", str(RUNTIME / "runtime.cpp"), "-o", str(part)], RUNTIME, ()
        )
        part.chmod(0o644)  # a sandbox reads it with another user ID
        part.replace(made)
    return made


def _runtime_file(compiler: Compiler, kind: BoardKind) -> Path:
    key = hashlib.sha256(f"{_runtime_digest()}\0{compiler.identity}\0{kind.macro}".encode()).hexdigest()
    return build_folder() / f"runtime-{key[:20]}.o"


def long_build_notice() -> str:
    """The sentence about a build that takes minutes: ziglang compiles its own libraries first. Empty for
    others."""
    compiler = find_compiler()
    if compiler is None or not compiler.is_package:
        return ""
    if any(_runtime_file(compiler, kind).exists() for kind in BOARDS.values()):
        return ""
    return "ziglang compiles its libraries now, which takes minutes; later sketches take seconds"


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
    known = {each.name.lower(): each.name for each in (*(RUNTIME / "core").glob("*.h"), *library_headers())}
    own = {Path(each.name).name for each in sources}
    own_there = {each.lower(): each for each in own}
    known |= own_there

    def renamed(match: re.Match[str]) -> str:
        name = match[2]
        low = name.lower()
        if allowed is not None and low not in allowed and low.rpartition("/")[2] not in allowed:
            return f"{match[1]}{NOWHERE}{name}{match[3]}"
        folder, slash, last = name.rpartition("/")
        if last in own:
            return match[0]
        found = own_there.get(low) or OTHER_NAMES.get(low) or known.get(low)
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
        missing = missing_header(done.stderr, files, kind) if files else None
        found = [missing] if missing else list(compiler_errors(done.stderr, compiler, files, kind))
        raise ConfigurationError(found)
    return compiler_warnings(done.stderr, files)
