"""Documents: tables of typed columns and values, prose and figures; renderers make of them what is asked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from simmer_tui.document.formats import TEXT, Format, TextLink


@dataclass(frozen=True, slots=True)
class DataColumn:
    """One column of a table.

    `key` names it for programs, with its unit: `time_s`. `heading` names it for people; by default it is the
    key with spaces. A column that `wraps` may take several lines; a `hidden` one is for programs only. On a
    terminal, values of one with a `line` of its own stand below the value before them, so that a command
    can be copied.
    """

    key: str
    format: Format = TEXT
    heading: str | None = None
    wraps: bool = False
    hidden: bool = False
    line: bool = False

    @property
    def title(self) -> str:
        """Heading for people."""
        return self.key.replace("_", " ") if self.heading is None else self.heading

    @property
    def keys(self) -> list[str]:
        """Names of its plain values."""
        return [self.key + suffix for suffix in self.format.suffixes]


@dataclass(frozen=True, slots=True)
class DataTable:
    """A table of typed values, with a note below it.

    A `record` has one row; people see it as a list of headings and values, programs as one object. A
    `hidden` table is for programs only. Tables of one key are one to programs.
    """

    key: str
    title: str
    columns: tuple[DataColumn, ...]
    rows: Sequence[Sequence[object]] = ()
    note: str = ""
    record: bool = False
    hidden: bool = False

    def filled(self, rows: Sequence[Sequence[object]], note: str = "") -> DataTable:
        """The same table with rows."""
        return replace(self, rows=rows, note=note)

    @property
    def shown_columns(self) -> list[DataColumn]:
        """Columns for people; of a record a blank one, for the names, and one for the values."""
        if self.record:
            return [DataColumn("", heading=""), DataColumn("", heading="", wraps=True)]
        return [column for column in self.columns if not column.hidden]

    def cells(self) -> Iterator[list[Prose]]:
        """Rows as people read them; those of a record without a value are left out."""
        for row in self.rows:
            cells: list[tuple[str, Prose]] = [
                (column.title, value if isinstance(value, TextLink) else column.format.text(value))
                for column, value in zip(self.columns, row, strict=True)
                if not column.hidden
            ]
            if self.record:
                yield from ([title, shown] for title, shown in cells if shown)
            else:
                yield [shown for _, shown in cells]

    def texts(self) -> Iterator[list[str]]:
        """The same without what links lead to."""
        for row in self.cells():
            yield [words(cell) for cell in row]

    def objects(self) -> Iterator[dict[str, object]]:
        """Rows as programs read them."""
        for row in self.rows:
            yield {
                key: plain
                for column, value in zip(self.columns, row, strict=True)
                for key, plain in zip(column.keys, column.format.plain(value), strict=True)
            }


@dataclass(frozen=True, slots=True)
class Code:
    """A command to be typed."""

    words: str


Prose = str | TextLink | Code
"""A piece of text within a paragraph."""


@dataclass(frozen=True, slots=True)
class Paragraph:
    """A paragraph; one without a key is for people only. `kind` is `run`, `note`, `warning` or `strong`."""

    text: tuple[Prose, ...] | str
    key: str = ""
    kind: str = ""


@dataclass(frozen=True, slots=True)
class Bullets:
    """A list of sentences under a heading; one without a key, such as a list of links, is on pages only."""

    heading: str
    entries: Sequence[tuple[Prose, ...] | str]
    key: str = ""


@dataclass(frozen=True, slots=True)
class SectionHeading:
    """A heading; on a page only, where figures follow it."""

    text: str
    level: int = 2


@dataclass(frozen=True, slots=True)
class Figure:
    """A picture: SVG in points, which scales to the width it is given. A terminal does not show it.

    `kind` is its class on the page, by which a script finds it.
    """

    title: str
    width: float
    height: float
    content: str
    kind: str = ""


@dataclass(frozen=True, slots=True)
class NestedValue:
    """A value with an inner structure, for programs only; people read the same in prose."""

    key: str
    value: Mapping[str, object] | Sequence[Mapping[str, object]]


DocumentPart = Paragraph | Bullets | SectionHeading | Figure | DataTable | NestedValue


@dataclass(frozen=True, slots=True)
class Document:
    """A titled sequence of parts. Tables that follow each other stand side by side where there is room."""

    title: str
    parts: Sequence[DocumentPart]

    @property
    def tables(self) -> list[DataTable]:
        """All its tables."""
        return [part for part in self.parts if isinstance(part, DataTable)]


def words(text: tuple[Prose, ...] | Prose) -> str:
    """Text of a paragraph, without what its links lead to."""
    if isinstance(text, str):
        return text
    return "".join(map(words, text)) if isinstance(text, tuple) else text.words
