"""The question about a device file that its user has not trusted yet, on the terminal."""

from __future__ import annotations

import sys
from pathlib import Path

from simmer_tui.config.device_file import DeviceFile
from simmer_tui.sim.command import escape, shown_path

# The imports and the head of a class: enough to recognise the file.
_LINES = 12
"""Lines of the file that are shown."""
_WIDE = 100
"""Characters of such a line that are shown."""


def ask_on_terminal(file: DeviceFile, directory: Path) -> bool:
    """True if the user types yes. Without a terminal for question and answer it is False, without a
    question."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    sys.stderr.write("\n".join(_question(file, directory)))
    sys.stderr.flush()
    try:
        answer = sys.stdin.readline()
    except (OSError, ValueError):
        return False
    return answer.strip().lower() in ("y", "yes")


def _question(file: DeviceFile, directory: Path) -> list[str]:
    path = shown_path(directory / file.path)
    lines = file.text.splitlines()
    shown = [f"  {number:3} {escape(line, _WIDE)}" for number, line in enumerate(lines[:_LINES], 1)]
    rest = len(lines) - len(shown)
    more = [f"      ... {rest} lines more: read them in an editor"] if rest > 0 else []
    return [
        f"The set contains a sensor of its own, a Python file that runs with your rights: {path}",
        f"SHA-256 {file.sha256}, {len(file.data):,} bytes",
        *shown,
        *more,
        "Trust this file, and run it from now on? A changed file is asked about again. [y/N] ",
    ]
