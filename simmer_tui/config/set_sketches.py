"""The files of sketches: those of one sketch by Arduino's rules, and those that a set's wiring.toml names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path

from simmer_tui.config.leftovers import is_leftover
from simmer_tui.errors import ConfigurationError, Problem

WIRING_FILE = "wiring.toml"
"""The file of a set with its boards, and their wires."""
SKETCH_ENDINGS = (".ino", ".pde")
"""Endings of sketches."""
CODE_ENDINGS = (".h", ".hpp", ".hh", ".c", ".cpp", ".cc", ".cxx")
"""Endings of headers and sources beside a sketch."""
# More is no sketch of a student's; reading a home directory by mistake would take minutes.
_MOST_FILES = 400
_SETUP = re.compile(rb"^[ \t]*void\s+setup\s*\(", re.MULTILINE)
"""A function that each sketch has once, in one of its files."""
_MOST_BYTES = 1_000_000
"""Bytes of a file that are searched for it; sketches have up to 100 kB."""


def is_sketch_path(path: Path) -> bool:
    """True for an .ino file, and for a folder with one."""
    return any(path.glob("*.ino")) or (path.is_file() and path.suffix.lower() in SKETCH_ENDINGS)


def main_files(sketch: Path) -> list[Path]:
    """The .ino files of a sketch, its main one first, as Arduino joins them; none of a folder without one.

    `sketch` is a file or its folder. A folder may have another name than its sketch, as one that was handed
    in. Then it may hold several sketches, each alone in its file.
    """
    folder = sketch if sketch.is_dir() else sketch.parent
    name = folder.resolve().name
    files = [each for each in _files(folder) if each.suffix.lower() in SKETCH_ENDINGS]
    if not sketch.is_dir() and sketch.stem != name and any(map(_has_setup, set(files) - {sketch})):
        return [sketch]
    main = [each for each in files if (each.stem == name if sketch.is_dir() else each == sketch)]
    return main + [each for each in files if each not in main]


def source_paths(sketch: Path) -> list[Path]:
    """The files of a sketch by its .ino file or its folder: its .ino files, then headers and sources beside
    them. Raises ConfigurationError for too many."""
    folder = sketch if sketch.is_dir() else sketch.parent
    return [*main_files(sketch), *_bounded((each for each in _files(folder) if _is_code(each)), folder)]


def library_paths(folder: Path) -> Iterator[tuple[Path, str]]:
    """The code in `src/` beside a sketch, and that of libraries in `libraries/` beside it or one folder up,
    each with its path in a build. Raises ConfigurationError for too many files."""
    if (folder / "src").is_dir():
        for each in _code_below(folder / "src"):
            yield each, each.relative_to(folder).as_posix()
    for place in (folder / "libraries", folder.parent / "libraries"):
        if not place.is_dir():
            continue
        for library in sorted(each for each in place.iterdir() if each.is_dir()):
            root = library / "src" if (library / "src").is_dir() else library
            for each in _code_below(root):
                parts = each.relative_to(root).parts
                # Examples of a library are no part of it.
                if not {"examples", "extras", "test", "tests"}.intersection(parts[:-1]):
                    yield each, f"libraries/{library.name}/{'/'.join(parts)}"
        return


def _files(folder: Path) -> list[Path]:
    return [each for each in sorted(folder.iterdir()) if not is_leftover(each.name) and each.is_file()]


def _has_setup(path: Path) -> bool:
    with path.open("rb") as file:
        return _SETUP.search(file.read(_MOST_BYTES)) is not None


def _is_code(path: Path) -> bool:
    return path.suffix.lower() in CODE_ENDINGS and path.is_file()


def _code_below(folder: Path) -> list[Path]:
    return _bounded((each for each in sorted(folder.rglob("*")) if _is_code(each)), folder)


def _bounded(paths: Iterable[Path], folder: Path) -> list[Path]:
    found = list(islice(paths, _MOST_FILES + 1))
    if len(found) > _MOST_FILES:
        raise ConfigurationError([Problem(str(folder), f"has more than {_MOST_FILES} files of code")])
    return found


def sketch_files(directory: Path, wiring: bytes) -> Iterator[Path]:
    """The files of a set's sketches that lie in its folder, by the text of its wiring.toml. A text with
    mistakes names none: its reader reports them. Raises ConfigurationError for too many files."""
    # A third of a millisecond, which sets without sketches save.
    import tomllib

    try:
        boards = tomllib.loads(wiring.decode("utf-8-sig")).get("boards", {})
    except (ValueError, RecursionError):
        return
    named = boards.values() if isinstance(boards, dict) else ()
    home, seen = directory.resolve(), set[Path]()
    for board in named:
        sketch = board.get("sketch") if isinstance(board, dict) else None
        if not isinstance(sketch, str):
            continue
        try:
            path = directory / sketch
            if not path.exists():
                continue
            beside = library_paths(path if path.is_dir() else path.parent)
            for each in (*source_paths(path), *(each for each, _ in beside)):
                if each.is_file() and each.resolve().is_relative_to(home) and each not in seen:
                    seen.add(each)
                    yield each
        except (OSError, ValueError, RuntimeError):
            continue
