"""The files of sketches: those of one sketch by Arduino's rules, and those that a set's wiring.toml names."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from simmer_tui.config.leftovers import is_leftover

WIRING_FILE = "wiring.toml"
"""The file of a set with its boards, and their wires."""
SKETCH_ENDINGS = (".ino", ".pde")
"""Endings of sketches."""
_SOURCES = (*SKETCH_ENDINGS, ".h", ".hpp", ".c", ".cpp")
# Judged: a sketch and a few libraries beside it.
_MOST_FILES = 100


def is_sketch_path(path: Path) -> bool:
    """True for an .ino file, and for a folder with one."""
    return any(path.glob("*.ino")) or (path.is_file() and path.suffix.lower() in SKETCH_ENDINGS)


def source_paths(sketch: Path) -> list[Path]:
    """The files of a sketch by its .ino file or its folder: the sketch itself first, then its further .ino
    files in the order of their names, then headers and sources beside it.

    As in Arduino, further .ino files belong to it only if its folder has its name.
    """
    folder = sketch if sketch.is_dir() else sketch.parent
    beside = [
        path
        for path in sorted(folder.iterdir())
        if path.suffix.lower() in _SOURCES and not is_leftover(path.name) and path.is_file()
    ][:_MOST_FILES]
    sketches = [path for path in beside if path.suffix.lower() in SKETCH_ENDINGS]
    others = [path for path in beside if path not in sketches]
    main = sketch
    if sketch.is_dir():
        main = next((path for path in sketches if path.stem == folder.resolve().name), None) or next(
            iter(sketches), sketch
        )
    is_whole_folder = sketch.is_dir() or main.stem == folder.resolve().name
    return [main, *(path for path in sketches if is_whole_folder and path != main), *others]


def sketch_files(directory: Path, wiring: bytes) -> Iterator[Path]:
    """The files of a set's sketches that lie in its folder, by the text of its wiring.toml. A text with
    mistakes names none: its reader reports them."""
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
            found = source_paths(path) if path.exists() else []
            for each in found:
                if each.is_file() and each.resolve().is_relative_to(home) and each not in seen:
                    seen.add(each)
                    yield each
        except (OSError, ValueError, RuntimeError):
            continue
