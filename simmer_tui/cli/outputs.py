"""Files that subcommands write beside a log."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from simmer_tui.errors import RunLogError
from simmer_tui.sim.command import escape


def check_outputs(log: Path, outputs: Iterable[Path | None]) -> None:
    """No output may be the log itself, nor another output. Raises RunLogError."""
    given = [path.resolve() for path in (log, *(output for output in outputs if output is not None))]
    for path in given:
        if given.count(path) > 1:
            raise RunLogError(f"{escape(str(path), 200)} is named twice; name another file to write to")


def write_text(path: Path, text: str) -> None:
    """Raises RunLogError, which names the file, if it cannot be written."""
    try:
        path.write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise unwritable(path, error) from None


def unwritable(path: Path, error: OSError) -> RunLogError:
    """An error for a file that cannot be written, with the reason."""
    return RunLogError(f"{escape(str(path), 200)} cannot be written: {error.strerror or error}")


def wrote(path: Path) -> str:
    """The line that names a file that has been written."""
    return f"Wrote {escape(str(path), 200)}\n"
