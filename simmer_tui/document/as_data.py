"""JSON and CSV of documents and tables, for programs, spreadsheets, pandas and MATLAB.

In JSON, tables are lists of objects under their keys, records one object. Our own sentences stand under
`text`, by the key of their paragraph, list or table. CSV has a header of keys, then a row a line. None is
blank, true is 1, numbers that are not finite are inf, -inf and nan.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
from collections.abc import Mapping, Sequence
from enum import Enum
from pathlib import PurePath
from typing import Any, TextIO

from msgspec import Struct, structs

from simmer_tui.document.model import (
    Bullets,
    DataColumn,
    DataTable,
    Document,
    NestedValue,
    Paragraph,
    VerdictBox,
    unfolded,
    words,
)
from simmer_tui.errors import printable
from simmer_tui.sim.command import cut


def json_text(value: object) -> str:
    """The JSON text of a document, or of any value that `plain` takes."""
    if isinstance(value, Document):
        value = document_value(value)
    # ASCII only, so that text from outside cannot control a terminal that the answer is printed on.
    return json.dumps(plain(value), indent=1, allow_nan=False) + "\n"


def document_value(document: Document) -> dict[str, object]:
    """Tables and sentences of a document by their keys."""
    answer: dict[str, Any] = {}
    text: dict[str, object] = {}
    for part in unfolded(document.parts):
        match part:
            case DataTable():
                rows = list(part.objects())
                # Tables of one key continue each other.
                answer[part.key] = rows[0] if part.record else [*answer.get(part.key, ()), *rows]
                if part.note:
                    text[part.key] = part.note if part.key not in text else f"{text[part.key]} {part.note}"
            case Paragraph() if part.key and part.text:
                text[part.key] = words(part.text)
            case VerdictBox():
                text[part.key] = part.text
            case Bullets() if part.key and part.kind != "output":
                text[part.key] = [words(entry) for entry in part.entries]
            case NestedValue():
                answer[part.key] = part.value
    return {"text": text, **answer}


def plain(value: object) -> Any:
    """A value in JSON's own types.

    Records become objects by the names of their fields, kinds of things their names, numbers that are not
    finite (a range without a limit) null.
    """
    if isinstance(value, Struct):
        return plain(structs.asdict(value))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, type):
        return getattr(value, "name", value.__name__)
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Mapping):
        return {str(plain(key)): plain(each) for key, each in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, PurePath) else value


# Characters of a cell that are kept: spreadsheets cut at 32,767, people long before.
_LONGEST = 400


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


def table_csv(table: DataTable) -> str:
    """The whole table."""
    file = io.StringIO()
    writer = CsvWriter(file, table.columns)
    for row in table.rows:
        writer.write(row)
    return file.getvalue()


def _cell(value: object) -> object:
    if isinstance(value, str):
        # Letters of all scripts are safe.
        is_safe = value.isprintable() and len(value) <= _LONGEST
        return no_formula(value if is_safe else cut(printable(value), _LONGEST))
    # 1 and 0 are numbers to spreadsheets in every language; True is a word to some.
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, list | tuple):
        return " ".join(map(str, value))
    return value


def no_formula(shown: str) -> str:
    """Text that no spreadsheet interprets as a formula: some accept the full-width signs too."""
    # OWASP, CSV injection: a leading quote makes a cell plain text in spreadsheets.
    return f"'{shown}" if shown.startswith(tuple("=+-@＝＋－＠")) else shown
