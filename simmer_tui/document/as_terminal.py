"""Documents on a terminal. Text is never interpreted as markup, and cannot control the terminal."""

from __future__ import annotations

import textwrap

from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table as RichTable
from rich.text import Text

from simmer_tui.document.formats import BLOCKS, PLAIN_BLOCKS
from simmer_tui.document.model import (
    Bullets,
    Code,
    DataTable,
    Document,
    Paragraph,
    Prose,
    VerdictBox,
    unfolded,
    words,
)
from simmer_tui.errors import printable

# Basic styles only: every terminal theme has them, and they stay readable on light and dark grounds.
_STYLES = {"note": "dim", "warning": "yellow", "strong": "bold"}
_ANY_WIDTH = 10_000
"""Columns of a terminal that no table fills: in it the width that a table needs can be measured."""
_ASCII = str.maketrans(BLOCKS, PLAIN_BLOCKS)


def print_document(document: Document, console: Console) -> None:
    """Print everything but the title, headings of figures and the figures themselves."""
    for part in unfolded(document.parts):
        match part:
            case DataTable() if not part.hidden:
                print_table(part, console)
            case Paragraph() if part.text and part.kind != "run":
                style = _STYLES.get(part.kind, "")
                typed = any(isinstance(piece, Code) for piece in part.text)
                text = _filled(part.text, console.width) if typed else printable(words(part.text))
                console.print(Text(text, style=style), soft_wrap=typed)
            case VerdictBox():
                console.print(Text(printable(part.text), style=_STYLES["strong"]))
            case Bullets() if part.entries and part.key:
                console.print(Text(printable(part.heading), style="bold"))
                for entry in part.entries:
                    console.print(Text(f"- {printable(words(entry))}"))
                console.print()


def _filled(text: tuple[Prose, ...] | str, width: int) -> str:
    """A paragraph in lines of at most `width` characters. A command is never broken: it can be copied.
    A longer one has a line of its own, which the terminal folds."""
    pieces = (text,) if isinstance(text, str) else text
    # Escaped text has no NUL: it stands for the spaces of a command.
    shown = [
        printable(words(piece)).replace(" ", "\0") if isinstance(piece, Code) else printable(words(piece))
        for piece in pieces
    ]
    filled = textwrap.fill("".join(shown), width, break_long_words=False, break_on_hyphens=False)
    return filled.replace("\0", " ")


def print_table(table: DataTable, console: Console) -> None:
    """Print a table."""
    shown = table.shown_columns
    columns = [column for column in shown if not column.line]
    made = RichTable(
        title=Text(printable(table.title), style="bold") if table.title else None,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        show_header=any(column.title for column in columns),
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    for column in columns:
        made.add_column(
            Text(printable(column.title)),
            justify="right" if column.format.numeric else "left",
            overflow="fold",
            no_wrap=not column.wraps,
        )
    plain = console.options.ascii_only
    for row in table.texts():
        cells: list[Text] = []
        for column, text in zip(shown, row, strict=True):
            if column.line:
                cells[-1].append(f"\n{printable(text)}")
            else:
                cells.append(Text(printable(text.translate(_ASCII) if plain else text)))
        made.add_row(*cells)
    wide = console.options.update_width(_ANY_WIDTH)
    for each in made.columns:
        if each.no_wrap:  # its minimum would be that of its longest word
            texts = each.header, *each.cells
            each.min_width = max(Measurement.get(console, wide, text).maximum for text in texts)
    # In more lines rather than cut: half a number would be another number.
    if Measurement.get(console, wide, made).minimum > console.width:
        for each in made.columns:
            each.no_wrap, each.min_width = False, None
    console.print(made)
    if table.note:
        console.print(Text(printable(table.note), style="dim"))
        console.print()
