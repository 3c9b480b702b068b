"""What was typed in the console, kept between sessions."""

from __future__ import annotations

import contextlib
from pathlib import Path

from platformdirs import user_data_path

KEPT = 500
"""Lines kept."""


def default_history_file() -> Path:
    """The file in the user's data folder."""
    return user_data_path("simmer-tui", appauthor=False) / "console-history.txt"


class History:
    """Typed lines, oldest first. A file that cannot be read or written is done without."""

    def __init__(self, file: Path | None) -> None:
        self._file = file
        self._lines: list[str] = []
        if file is not None:
            with contextlib.suppress(OSError):  # there may be none yet
                text = file.read_text(encoding="utf-8", errors="replace")
                self._lines = [line for line in text.splitlines() if line.strip()][-KEPT:]
        self._place = len(self._lines)
        self._draft = ""

    def add(self, line: str) -> None:
        """Keep a line, unless it repeats the last."""
        if line.strip() and self._lines[-1:] != [line]:
            self._lines = [*self._lines, line][-KEPT:]
            self._write()
        self._place = len(self._lines)

    def back(self, draft: str) -> str:
        """The line before the present one; `draft` is what stands in the console now."""
        if self._place == len(self._lines):
            self._draft = draft
        self._place = max(self._place - 1, 0)
        return self._lines[self._place] if self._lines else draft

    def forward(self) -> str:
        """The line after the present one; after the last comes the draft again."""
        self._place = min(self._place + 1, len(self._lines))
        return self._lines[self._place] if self._place < len(self._lines) else self._draft

    def _write(self) -> None:
        if self._file is None:
            return
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            self._file.write_text("".join(f"{line}\n" for line in self._lines), encoding="utf-8")
        except OSError:
            self._file = None
