"""The shell of every page we write: one file that needs nothing else, on a screen or on paper."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from simmer_tui.report.content import Table

_STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.45 Helvetica, Arial, sans-serif; color: #222; background: #fff; max-width: 960px;
  margin: 1.5em auto; padding: 0 1em; }
h1 { font-size: 1.5em; margin: 0 0 .2em; } h2 { font-size: 1.1em; margin: 1.4em 0 .4em; }
p.run { color: #666; margin: 0; overflow-wrap: anywhere; }
svg { width: 100%; height: auto; display: block; break-inside: avoid; }
ul { margin: .3em 0; padding-left: 1.2em; } li { margin: .25em 0; }
.tables { display: flex; flex-wrap: wrap; gap: 0 2.5em; align-items: flex-start; }
section { break-inside: avoid; max-width: 100%; overflow-x: auto; }
table { border-collapse: collapse; font-size: .87em; }
th { text-align: left; border-bottom: 1px solid #999; font-weight: 600; }
th, td { padding: .14em .9em .14em 0; vertical-align: top; overflow-wrap: anywhere; }
.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
.h { font-family: monospace; white-space: pre; }
p.note { color: #666; font-size: .87em; margin: .3em 0; max-width: 60em; }
@media print { body { font-size: 11px; margin: 0; max-width: none; padding: 0; } h2 { margin-top: 1em; }
  h2 { break-after: avoid; } @page { margin: 14mm; } * { print-color-adjust: exact; } }
"""


def page(title: str, *parts: str) -> str:
    """A whole page: its title, as plain text, is its first heading too; the parts are HTML."""
    return (
        "<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>"
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
