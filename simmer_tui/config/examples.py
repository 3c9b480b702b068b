"""Sample programs as files: their folder, and copying them."""

import sys
from pathlib import Path

from simmer_tui import platform_has
from simmer_tui.config.sets import PACKAGE, installed_folder, read_all, write_files

EXAMPLE = "wander.py"
"""The first sample program: it reads, drives around, and sends its believed pose."""
CLIENT = "client.py"
"""The client library, which is in the package itself."""
_PROGRAMS = (EXAMPLE, "solve.py", "robot_emulator.py")
"""Samples of one file; the modules of solve.py (`solve_*.py`) are beside it."""
_FOLDERS = ("course", "c", "matlab", "arduino")
"""Programs of the course, those in other languages, and sketches for the robot itself."""
_SUFFIXES = (".py", ".c", ".h", ".m", ".ino", ".md", ".toml", ".csv")


def examples_folder() -> Path:
    """The folder of the sample programs."""
    return installed_folder("examples", "scripts")


def example_command() -> str:
    """Command that runs the sample program with our own interpreter."""
    words = [sys.executable, str(examples_folder() / EXAMPLE)]
    return platform_has.shell_line(words)


def example_files() -> dict[str, bytes]:
    """All sample programs and the client library, by path in the folder of copies.

    Raises ConfigurationError if one cannot be read.
    """
    folder = examples_folder()
    found = [folder / name for name in _PROGRAMS] + sorted(folder.glob("solve_*.py"))
    for name in _FOLDERS:
        found += sorted(path for path in (folder / name).rglob("*") if path.suffix in _SUFFIXES)
    return read_all(found, folder) | read_all([PACKAGE / CLIENT], PACKAGE)


def copy_examples(destination: Path) -> tuple[Path, ...]:
    """Copy the sample programs into a folder, which is created if necessary. Existing files without changes
    are skipped.

    Returns the new files. Raises ConfigurationError, before anything is written, if a file that differs would
    be overwritten.
    """
    return write_files(
        destination,
        {name: data for name, data in example_files().items() if not _is_there(destination / name, data)},
    )


def _is_there(path: Path, data: bytes) -> bool:
    """True if a file has these bytes."""
    try:
        return path.read_bytes() == data
    except OSError:
        return False  # missing, or not a file: writing then reports it
