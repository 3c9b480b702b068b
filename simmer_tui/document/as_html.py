"""Documents as pages: one file that needs nothing else, on a screen or on paper, in the light or the dark.

Text from outside is data: nothing in a value can end the element that holds it.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Sequence
from itertools import groupby

from simmer_tui.document import svg
from simmer_tui.document.formats import TextLink
from simmer_tui.document.model import (
    Bullets,
    Chip,
    Code,
    DataColumn,
    DataTable,
    Document,
    DocumentPart,
    Figure,
    Folded,
    KeyFigures,
    NestedValue,
    Paragraph,
    Prose,
    SectionHeading,
    ShareBar,
    SideBySide,
    VerdictBox,
    unfolded,
    words,
)
from simmer_tui.document.page_style import SORTING, STYLE
from simmer_tui.document.svg import html_text

# A table that needs more than this has its rows folded on phones: 360 points less the page's margins.
_PHONE = 336
# Points: average width of a letter in a table, and the gap between two columns.
_LETTER, _BETWEEN = 7.2, 14.0
# Letters of a word that may be broken: paths, commands and seeds are longer, words of people are not.
_LONG_WORD = 20
# After a sign, and within the digits of a grading's seed.
_BREAKS = re.compile(r"(?<=[/\\_=,.:;-])(?=\w)|(?<=\d{10})(?=\d)")
# Between a heading and its unit.
_BEFORE_UNIT = re.compile(r" (?=\S{1,3}$)")


def html_page(document: Document, *, style: str = "", script: str = "") -> str:
    """A whole page; its title is its first heading too, unless it begins with a verdict.

    Args:
        document: What the page shows.
        style: CSS that comes after the style of all pages.
        script: HTML that comes last, trusted as it is.
    """
    title = html_text(document.title)
    parts = list(unfolded(document.parts))
    heading = "" if any(isinstance(part, VerdictBox) for part in parts) else _element("h1", title)
    if any(isinstance(part, DataTable) and part.sortable for part in parts):
        script = f"{SORTING}{script}"
    # All style and script is inline: the page is sent by mail and opened without a network.
    return (
        "<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{title}</title><style>{STYLE}{style}</style></head><body>"
        f"{heading}{_body(document.parts)}{script}</body></html>\n"
    )


def embedded(page: str) -> str:
    """A page within a notebook: a document of its own, whose script reaches nothing outside it."""
    # Scripts only: without allow-same-origin the page reaches neither the notebook nor its cookies.
    looks = 'width="100%" height="820" style="border:0"'
    return f'<iframe sandbox="allow-scripts" {looks} srcdoc="{html.escape(page)}"></iframe>'


def _body(parts: Iterable[DocumentPart]) -> str:
    made = []
    shown_parts = (part for part in parts if not _is_for_programs(part))
    for tables, group in groupby(shown_parts, lambda part: isinstance(part, DataTable)):
        shown = "".join(map(_part, group))
        made.append(f"<div class='tables'>{shown}</div>" if tables and shown else shown)
    return "".join(made)


def _is_for_programs(part: DocumentPart) -> bool:
    return isinstance(part, NestedValue) or (isinstance(part, DataTable) and part.hidden)


def _part(part: DocumentPart) -> str:
    match part:
        case DataTable():
            return _table(part)
        case Paragraph():
            return _element("p", _prose(part.text), part.kind) if part.text else ""
        case Bullets():
            return _bullets(part)
        case SectionHeading():
            return _element(f"h{part.level}", html_text(part.text))
        case Figure():
            return _figure(part)
        case Folded():
            title = html_text(part.title)
            content = _body(part.parts).replace(_element("h2", title), "", 1)  # once is enough
            return f"<details><summary>{title}</summary>{content}</details>" if content else ""
        case SideBySide():
            left, right = (_element("div", _body(each)) for each in (part.left, part.right))
            return _element("div", left + right, "columns even" if part.even else "columns")
        case VerdictBox() | KeyFigures() | ShareBar():
            return _answer(part)
        case NestedValue():
            return ""


def _answer(part: VerdictBox | KeyFigures | ShareBar) -> str:
    """One of the parts at the top of a page."""
    match part:
        case VerdictBox():
            sign = f"<div class='sign' aria-hidden='true'>{html_text(part.sign or part.tone.sign)}</div>"
            sentence = _element("p", _prose(part.sentence or part.text))
            told = _element("div", f"{_element('h1', html_text(part.headline))}{sentence}")
            return _element("div", sign + told, f"verdict {part.tone.value}")
        case KeyFigures():
            shown = (
                _element("div", f"{_element('strong', html_text(value))}{_element('span', html_text(about))}")
                for value, about in part.figures
            )
            return _element("div", "".join(shown), "figures")
        case ShareBar():
            there = [each for each in part.shares if each[0]]
            bar = "".join(f"<i class='{tone.value}' style='flex: {count}'></i>" for count, _, tone in there)
            told = "".join(_prose(Chip(f"{tone.sign} {count} {text}", tone)) for count, text, tone in there)
            return f"<div class='bar'>{bar}</div><p class='bar-words'>{told}</p>"


def _figure(part: Figure) -> str:
    """A picture and its legend. Its shape bounds its width where its height is bounded."""
    shape = f"--shape: {part.width / part.height:.3f}"
    drawn = f"<div class='{f'picture {part.kind}'.strip()}' style='{shape}'>{svg.figure_svg(part)}</div>"
    marks = "".join(
        f"<li><svg viewBox='0 -8 {mark.width:g} 16' style='width: {mark.width:g}px' aria-hidden='true'>"
        f"{mark.drawing}</svg> {html_text(mark.words)}</li>"
        for mark in part.legend
    )
    return drawn + (_element("ul", marks, "legend") if marks else "")


def _bullets(part: Bullets) -> str:
    if not part.entries:
        return ""
    heading = _element("h2", html_text(part.heading)) if part.heading else ""
    if part.kind == "output":
        lines = "\n".join(_element("span", _prose(entry)) for entry in part.entries)
        return _element("div", heading + _element("pre", lines), "card")
    entries = _element("ul", "".join(_element("li", _prose(entry)) for entry in part.entries))
    return _element("div", heading + entries, part.kind) if part.kind else heading + entries


def _table(table: DataTable) -> str:
    columns, rows = table.shown_columns, list(table.cells())
    kinds = ["n" if each.format.numeric else "h" if each.format.fixed else "" for each in columns]
    labels = [each.title for each in columns]
    values = _sort_values(table) if table.sortable else [[""] * len(columns) for _ in rows]
    body = ""
    for row, of_row in zip(rows, values, strict=True):
        body += _element("tr", "".join(map(_cell, row, kinds, labels, of_row)))
    is_wide = not table.record and _least_width(columns, rows) > _PHONE
    looks = f"{'wide' if is_wide else 'narrow'}{' sortable' if table.sortable else ''}"
    title = _element("h2", html_text(table.title)) if table.title else ""
    note = _element("p", html_text(table.note), "note") if table.note else ""
    shown = _element("table", f"{_table_head(columns, kinds)}<tbody>{body}</tbody>", looks)
    return _element("section", f"{title}{shown}{note}")


def _table_head(columns: Sequence[DataColumn], kinds: Sequence[str]) -> str:
    """Headings of a table; nothing if no column has one."""
    if not any(each.title for each in columns):
        return ""
    return _element("thead", _element("tr", "".join(map(_heading, columns, kinds))))


def _heading(column: DataColumn, kind: str) -> str:
    """A heading, on one line with its unit. Screen readers name a column without one by its key."""
    if not column.title:
        return f"<th aria-label='{html_text(column.key.replace('_', ' '))}'></th>"
    return _element("th", _BEFORE_UNIT.sub("\N{NO-BREAK SPACE}", html_text(column.title)), kind)


def _sort_values(table: DataTable) -> list[list[str]]:
    """The values by which the shown cells are sorted: those that programs read."""
    return [
        [
            "" if value is None else str((*column.format.plain(value), column.format.text(value))[0])
            for column, value in zip(table.columns, row, strict=True)
            if not column.hidden
        ]
        for row in table.rows
    ]


def _cell(cell: Prose, kind: str, label: str, value: str) -> str:
    kinds = f" class='{kind}'" if kind else ""
    labelled = f" data-label='{html_text(label)}'" if label else ""
    sorted_by = f" data-value='{html_text(value)}'" if value else ""
    if isinstance(cell, Chip):
        cell = Chip(f"{cell.tone.sign} {cell.words}", cell.tone)
    return f"<td{kinds}{labelled}{sorted_by}>{_prose(cell)}</td>"


def _least_width(columns: Sequence[DataColumn], rows: Iterable[Sequence[Prose]]) -> float:
    """Points that a table needs if no word is broken."""
    letters = 0
    for column, *cells in zip(columns, *rows, strict=True):
        texts = [column.title, *map(words, cells)]
        is_whole = column.format.numeric or column.format.fixed
        letters += max(map(len, texts if is_whole else " ".join(texts).split()), default=0)
    return letters * _LETTER + len(columns) * _BETWEEN


def _prose(text: tuple[Prose, ...] | Prose) -> str:
    match text:
        case tuple():
            return "".join(map(_prose, text))
        case TextLink(shown, address, about):
            hint = f" title='{html_text(about)}'" if about else ""
            return f"<a href='{html_text(address)}'{hint}>{_breakable(shown)}</a>"
        case Code(shown):
            return _element("code", _breakable(shown))
        case Chip(shown, tone):
            return _element("span", html_text(shown), f"toned {tone.value}")
        case _:
            return _breakable(text)


def _breakable(text: str) -> str:
    """Text whose long words, such as paths, may be broken."""
    return " ".join(
        "<wbr>".join(map(html_text, _BREAKS.split(word))) if len(word) >= _LONG_WORD else html_text(word)
        for word in text.split(" ")
    )


def _element(name: str, content: str, kind: str = "") -> str:
    attribute = f" class='{kind}'" if kind else ""
    return f"<{name}{attribute}>{content}</{name}>"
