"""The shell of every page we write: one file that needs nothing else, on a screen or on paper."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from simmer_tui.report.content import Table

_LIGHT = (
    "color-scheme: light; --page: #ffffff; --ink: #222222; --faint: #666666; --line: #bbbbbb; "
    "--raised: #f4f4f4; --fresh: #fff0cc; --good: #00704a; --bad: #c00000;"
)
_DARK = (
    "color-scheme: dark; --page: #16191e; --ink: #e4e8ee; --faint: #a0a8b4; --line: #4a525e; "
    "--raised: #262b33; --fresh: #4a3c10; --good: #50d0a0; --bad: #ff7070; --ramp: brightness(1.7);"
)
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
"""Colours of the pictures, which are drawn for paper, and what stands for them in the dark; those within
the class `fixed` mean something by their hue and stay."""
_DARK += "".join(f" --{paper[1:]}: {dark};" for paper, dark in _IN_THE_DARK.items())
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
.h { font-family: monospace; white-space: pre; }
p.note { color: var(--faint); font-size: .87em; margin: .3em 0; max-width: 60em; }
@media print { body { font-size: 11px; margin: 0; max-width: none; padding: 0; } h2 { margin-top: 1em; }
  h2 { break-after: avoid; } @page { margin: 14mm; } * { print-color-adjust: exact; } }
"""


def page(title: str, *parts: str, style: str = "") -> str:
    """A whole page: its title, as plain text, is its first heading too; the parts are HTML. `style`
    comes after that of all pages."""
    return (
        "<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{escape(title)}</title><style>{_STYLE}{style}</style></head><body>"
        f"<h1>{escape(title)}</h1>{''.join(parts)}</body></html>\n"
    )


def heading(text: str) -> str:
    """A heading of plain text."""
    return f"<h2>{escape(text)}</h2>"


def paragraph(text: str, kind: str = "") -> str:
    """A paragraph of plain text, of a class of the style; nothing if there is no text."""
    return _element("p", text, kind) if text else ""


def html_tables(tables: Iterable[Table]) -> str:
    """Tables beside each other where there is room."""
    return f"<div class='tables'>{''.join(map(_table, tables))}</div>"


def _table(table: Table) -> str:
    names = "".join(_element("th", each.name, "n" if each.numeric else "") for each in table.columns)
    head = f"<thead><tr>{names}</tr></thead>" if any(each.name for each in table.columns) else ""
    kinds = ["n" if each.numeric else "h" if each.name == "histogram" else "" for each in table.columns]
    rows = "".join(f"<tr>{''.join(map(_cell, row, kinds))}</tr>" for row in table.rows)
    body = f"<table>{head}<tbody>{rows}</tbody></table>"
    return f"<section>{heading(table.title)}{body}{paragraph(table.note, 'note')}</section>"


def _cell(text: str, kind: str) -> str:
    return _element("td", text, kind)


def _element(name: str, text: str, kind: str) -> str:
    attribute = f" class='{kind}'" if kind else ""
    return f"<{name}{attribute}>{escape(text)}</{name}>"
