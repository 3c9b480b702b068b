"""Documents as pages: one file that needs nothing else, on a screen or on paper, in the light or the dark.

Text from outside is data: nothing in a value can end the element it stands in.
"""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from itertools import groupby, repeat

from simmer_tui.document import svg
from simmer_tui.document.formats import TextLink
from simmer_tui.document.model import (
    Bullets,
    Code,
    DataTable,
    Document,
    DocumentPart,
    Figure,
    NestedValue,
    Paragraph,
    Prose,
    SectionHeading,
)
from simmer_tui.document.svg import escape

_LIGHT = (
    "color-scheme: light; --page: #ffffff; --ink: #222222; --faint: #666666; --line: #bbbbbb; "
    "--raised: #f4f4f4; --fresh: #fff0cc; --good: #00704a; --bad: #c00000;"
)
_DARK = (
    "color-scheme: dark; --page: #16191e; --ink: #e4e8ee; --faint: #a0a8b4; --line: #4a525e; "
    "--raised: #262b33; --fresh: #4a3c10; --good: #50d0a0; --bad: #ff7070; --ramp: brightness(1.7);"
)
# Colours of the pictures, which are drawn for paper, and what stands for them in the dark; those within the
# class `fixed` mean something by their hue and stay.
_IN_THE_DARK = {
    "#ffffff": "#16191e",
    "#fafafa": "#1b2027",
    "#ececec": "#1e232b",
    "#dddddd": "#3a424e",
    "#c8c8c8": "#4a525e",
    "#3c3c3c": "#566070",
    "#222222": "#e4e8ee",
    "#777777": "#a0a8b4",
    "#9a9a9a": "#8a94a2",
    "#004020": "#d0f8e0",
    "#006030": "#a6f9c8",
    "#bfe8c8": "#1d5a3c",
    "#d00000": "#ff6678",
    "#c800c8": "#f28cf2",
    "#1f69c8": "#6ea8ff",
    "#c06a00": "#ffc050",
    "#e8effb": "#1b2438",
    "#5470a5": "#8fa6d0",
    "#dff3ea": "#16302a",
    "#3f7a68": "#6fb5a0",
    "#e8f0ff": "#1b2438",
    "#fff3c4": "#3a3214",
}
_DARK += "".join(f" --{paper[1:]}: {dark};" for paper, dark in _IN_THE_DARK.items())
# Pictures have their colours as attributes, which CSS may override: one picture serves both looks.
_RECOLORED = "".join(
    f"svg [{what}='{paper}']:not(.fixed > *) {{ {what}: var(--{paper[1:]}, {paper}); }}\n"
    for paper in _IN_THE_DARK
    for what in ("fill", "stroke")
)
_STYLE = f"""
:root {{ {_LIGHT} }}
@media screen {{
  @media (prefers-color-scheme: dark) {{ :root:not([data-theme=light]) {{ {_DARK} }} }}
  :root[data-theme=dark] {{ {_DARK} }}
  svg {{ fill: var(--ink); }} .ramp {{ filter: var(--ramp); }}
{_RECOLORED}}}
"""
_STYLE += """
body { font: 15px/1.45 Helvetica, Arial, sans-serif; color: var(--ink); background: var(--page);
  max-width: 960px; margin: 1.5em auto; padding: 0 1em; }
h1 { font-size: 1.5em; margin: 0 0 .2em; } h2 { font-size: 1.1em; margin: 1.4em 0 .4em; }
p.run { color: var(--faint); margin: 0; overflow-wrap: anywhere; }
a { color: inherit; }
svg { width: 100%; height: auto; display: block; break-inside: avoid; }
ul { margin: .3em 0; padding-left: 1.2em; } li { margin: .25em 0; }
.tables { display: flex; flex-wrap: wrap; gap: 0 2.5em; align-items: flex-start; }
section { break-inside: avoid; max-width: 100%; overflow-x: auto; }
table { border-collapse: collapse; font-size: .87em; }
th { text-align: left; border-bottom: 1px solid var(--line); font-weight: 600; }
th, td { padding: .14em .9em .14em 0; vertical-align: top; overflow-wrap: anywhere; }
.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
td.h { font-family: monospace; white-space: pre; }
p.strong { font-weight: 600; } p.warning { color: var(--bad); }
p.note { color: var(--faint); font-size: .87em; margin: .3em 0; max-width: 60em; }
@media print { body { font-size: 11px; margin: 0; max-width: none; padding: 0; } h2 { margin-top: 1em; }
  h2 { break-after: avoid; } @page { margin: 14mm; } * { print-color-adjust: exact; } }
"""


def html_page(document: Document, *, style: str = "", script: str = "") -> str:
    """A whole page; its title is its first heading too.

    Args:
        document: What the page shows.
        style: CSS that comes after the style of all pages.
        script: HTML that comes last, trusted as it is.
    """
    title = escape(document.title)
    # All style and script is inline: the page is sent by mail and opened without a network.
    return (
        "<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{title}</title><style>{_STYLE}{style}</style></head><body>"
        f"<h1>{title}</h1>{_body(document.parts)}{script}</body></html>\n"
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
            entries = "".join(_element("li", _prose(entry)) for entry in part.entries)
            heading = _element("h2", escape(part.heading)) if part.heading else ""
            return f"{heading}<ul>{entries}</ul>" if entries else ""
        case SectionHeading():
            return _element(f"h{part.level}", escape(part.text))
        case Figure():
            return _element("div", svg.picture(part), part.kind)
        case NestedValue():
            return ""


def _table(table: DataTable) -> str:
    columns = table.shown_columns
    kinds = ["n" if each.format.numeric else "h" if each.format.fixed else "" for each in columns]
    head = ""
    if any(each.title for each in columns):
        head = f"<thead>{_row('th', [each.title for each in columns], kinds)}</thead>"
    rows = "".join(_row("td", row, kinds) for row in table.cells())
    title = _element("h2", escape(table.title)) if table.title else ""
    note = _element("p", escape(table.note), "note") if table.note else ""
    return f"<section>{title}<table>{head}<tbody>{rows}</tbody></table>{note}</section>"


def _row(name: str, cells: Sequence[Prose], kinds: Sequence[str]) -> str:
    return _element("tr", "".join(map(_element, repeat(name), map(_prose, cells), kinds)))


def _prose(text: tuple[Prose, ...] | Prose) -> str:
    match text:
        case tuple():
            return "".join(map(_prose, text))
        case TextLink(shown, address, about):
            hint = f" title='{escape(about)}'" if about else ""
            return f"<a href='{escape(address)}'{hint}>{escape(shown)}</a>"
        case Code(shown):
            return _element("code", escape(shown))
        case _:
            return escape(text)


def _element(name: str, content: str, kind: str = "") -> str:
    attribute = f" class='{kind}'" if kind else ""
    return f"<{name}{attribute}>{content}</{name}>"
