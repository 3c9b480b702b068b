"""Documents: tables of typed columns and values, prose and figures, before they are rendered."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from enum import Enum, StrEnum
from typing import Any, Final

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.document.formats import TEXT, Format, TextLink


class Tone(StrEnum):
    """Tone of a part: the colour that a page gives it, and the sign that says the same without colour."""

    GOOD = "good"
    BAD = "bad"
    MIXED = "mixed"
    PLAIN = "plain"

    @property
    def sign(self) -> str:
        """Sign beside words of this tone."""
        return _SIGNS[self]


class Absent(Enum):
    """The type of `ABSENT`."""

    ABSENT = ""


ABSENT: Final = Absent.ABSENT
"""The value of a row under a column that does not apply to it; None is a value that is not known."""

_SIGNS = {Tone.GOOD: "✓", Tone.BAD: "✗", Tone.MIXED: "◐", Tone.PLAIN: "■"}


class DataColumn(Struct, frozen=True):
    """One column of a table.

    `key` names it for programs, with its unit: `time_s`. `heading` names it for people; by default it is the
    key with spaces. A column that `wraps` may take several lines; a `hidden` one is for programs only. On a
    terminal, values of one with a `line` of its own stand below the value before them, so that a command
    can be copied. On a page, values have the `tone` of theirs, if there is one.
    """

    key: str
    format: Format = TEXT
    heading: str | None = None
    wraps: bool = False
    hidden: bool = False
    line: bool = False
    tone: Callable[[Any], Tone] | None = None

    @property
    def title(self) -> str:
        """Heading for people."""
        return self.key.replace("_", " ") if self.heading is None else self.heading

    @property
    def keys(self) -> list[str]:
        """Names of its plain values."""
        return [self.key + suffix for suffix in self.format.suffixes]


class DataTable(Struct, frozen=True):
    """A table of typed values, with a note below it.

    A `record` has one row; people see it as a list of headings and values, programs as one object. A
    `hidden` table is for programs only. Tables of one key are one to programs. A reader of the page can sort
    a `sortable` one by a click on a heading.
    """

    key: str
    title: str
    columns: tuple[DataColumn, ...]
    rows: Sequence[Sequence[object]] = ()
    note: str = ""
    record: bool = False
    hidden: bool = False
    sortable: bool = False

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
                (column.title, _shown(column, value))
                for column, value in zip(self.columns, row, strict=True)
                if not column.hidden
            ]
            if self.record:
                yield from ([title, shown] for title, shown in cells if shown)
            else:
                yield [shown for _, shown in cells]

    def texts(self) -> Iterator[list[str]]:
        """The same without the targets of links."""
        for row in self.cells():
            yield [words(cell) for cell in row]

    def objects(self) -> Iterator[dict[str, object]]:
        """Rows as programs read them; a value that is `ABSENT` has no key."""
        for row in self.rows:
            yield {
                key: plain
                for column, value in zip(self.columns, row, strict=True)
                if value is not ABSENT
                for key, plain in zip(column.keys, column.format.plain(value), strict=True)
            }


def data_table(
    key: str,
    title: str,
    *columns: DataColumn,
    record: bool = False,
    hidden: bool = False,
    sortable: bool = False,
) -> DataTable:
    """A table without rows."""
    return DataTable(key, title, columns, record=record, hidden=hidden, sortable=sortable)


class Code(Struct, frozen=True):
    """A command to be typed."""

    words: str


class Chip(Struct, frozen=True):
    """A few words with a tone."""

    words: str
    tone: Tone


Prose = str | TextLink | Code | Chip
"""A piece of text within a paragraph."""


def _shown(column: DataColumn, value: object) -> Prose:
    """A value of a column as people read it."""
    if isinstance(value, TextLink):
        return value
    text = column.format.text(value)
    return Chip(text, column.tone(value)) if text and column.tone is not None else text


class VerdictBox(Struct, frozen=True, kw_only=True):
    """The answer that a page begins with.

    `text` is the whole answer in one line, for terminals and programs. A page has a `headline` of a few words
    with a `sign`, by default that of its tone, and a `sentence`, by default `text`.
    """

    key: str
    text: str
    headline: str
    tone: Tone
    sentence: tuple[Prose, ...] = ()
    sign: str = ""


class KeyFigures(Struct, frozen=True):
    """The numbers that matter most, each with the words below it; on pages only."""

    figures: Sequence[tuple[str, str]]


class ShareBar(Struct, frozen=True):
    """A bar of counts of a whole, each with its words and tone; on pages only."""

    shares: Sequence[tuple[int, str, Tone]]


class Paragraph(Struct, frozen=True):
    """A paragraph; one without a key is for people only. `kind` is `run`, `note`, `warning` or `strong`."""

    text: tuple[Prose, ...] | str
    key: str = ""
    kind: str = ""


class Bullets(Struct, frozen=True):
    """A list of sentences under a heading; one without a key, such as a list of links, is on pages only.

    `kind` is its look on a page: `card` has a frame, `output` is lines as a program printed them.
    """

    heading: str
    entries: Sequence[tuple[Prose, ...] | str]
    key: str = ""
    kind: str = ""


class SectionHeading(Struct, frozen=True):
    """A heading; on a page only, where figures follow it."""

    text: str
    level: int = 2


class LegendMark(Struct, frozen=True):
    """A mark of a legend: its words, and SVG within `width` x 10 points around (0, 0) to (`width`, 0)."""

    words: str
    drawing: str
    width: float = 20.0


class Figure(Struct, frozen=True):
    """A picture: SVG in points, which scales to the width it is given. A terminal does not show it.

    `kind` is its class on the page, by which a script finds it. The `legend` stands below; on a page it does
    not scale with the picture.
    """

    title: str
    width: float
    height: float
    content: str
    kind: str = ""
    legend: tuple[LegendMark, ...] = ()


class NestedValue(Struct, frozen=True):
    """A value with an inner structure, for programs only; people read the same in prose."""

    key: str
    value: Mapping[str, object] | Sequence[Mapping[str, object]]


class Folded(Struct, frozen=True):
    """Parts that a page shows only when a reader opens them. Elsewhere they are like all others."""

    title: str
    parts: Sequence[DocumentPart]


class SideBySide(Struct, frozen=True):
    """Parts in two columns where a page has room; elsewhere one after the other. The right one is narrow,
    unless both are `even`."""

    left: Sequence[DocumentPart]
    right: Sequence[DocumentPart]
    even: bool = False


DocumentPart = (
    Paragraph
    | Bullets
    | SectionHeading
    | Figure
    | DataTable
    | NestedValue
    | VerdictBox
    | KeyFigures
    | ShareBar
    | Folded
    | SideBySide
)


class Document(Struct, frozen=True):
    """A titled sequence of parts. Tables that follow each other stand side by side where there is room."""

    title: str
    parts: Sequence[DocumentPart]


def unfolded(parts: Iterable[DocumentPart]) -> Iterator[DocumentPart]:
    """Parts in order, those within others too."""
    for part in parts:
        match part:
            case Folded():
                yield from unfolded(part.parts)
            case SideBySide():
                yield from unfolded((*part.left, *part.right))
            case _:
                yield part


def words(text: tuple[Prose, ...] | Prose) -> str:
    """Text of a paragraph, without the targets of its links."""
    if isinstance(text, str):
        return text
    return "".join(map(words, text)) if isinstance(text, tuple) else text.words
