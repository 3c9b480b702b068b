"""CSV of tables, for spreadsheets, pandas and MATLAB: a header of keys, then a row a line.

Nothing is blank, true is 1, numbers beyond all bounds are inf, -inf and nan.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import TextIO

from simmer_tui.document.model import DataColumn, DataTable
from simmer_tui.sim.command import escape

_LONGEST = 400
"""Characters of a cell that are kept: spreadsheets cut at 32,767, people long before."""


class CsvWriter:
    """A table that is written row by row."""

    def __init__(self, file: TextIO, columns: Sequence[DataColumn]) -> None:
        self._writer = csv.writer(file, lineterminator="\n")
        self._formats = [column.format for column in columns]
        self._writer.writerow(_cell(key) for column in columns for key in column.keys)

    def write(self, row: Sequence[object]) -> None:
        """Write a row, a value a column."""
        pairs = zip(self._formats, row, strict=True)
        self._writer.writerow([_cell(plain) for form, value in pairs for plain in form.plain(value)])


def csv_text(table: DataTable) -> str:
    """The whole table."""
    file = io.StringIO()
    writer = CsvWriter(file, table.columns)
    for row in table.rows:
        writer.write(row)
    return file.getvalue()


def _cell(value: object) -> object:
    if isinstance(value, str):
        return no_formula(escape(value, _LONGEST) if _is_unsafe(value) else value)
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, list | tuple):
        return " ".join(map(str, value))
    return value


def _is_unsafe(text: str) -> bool:
    """True if text could steer a terminal, or is too long; letters of all scripts are safe."""
    return not text.isprintable() or len(text) > _LONGEST


def no_formula(shown: str) -> str:
    """Text that no spreadsheet takes for a formula: some take the wide signs too."""
    # OWASP, CSV injection: a leading quote makes spreadsheets take a cell for text.
    return f"'{shown}" if shown.startswith(tuple("=+-@＝＋－＠")) else shown
