"""The looks of pages: in the light or the dark, on a wide screen, on a phone and on paper."""

from __future__ import annotations

import math

from simmer_tui.document.svg import PICTURE_WIDTH

# The colours of text, each with a contrast of at least 4.5 : 1 to its background (WCAG 2).
_LIGHT = (
    "color-scheme: light; --page: #ffffff; --ink: #161b22; --faint: #46515e; --line: #d0d6de; "
    "--raised: #f6f7f9; --fresh: #fff0cf; --link: #0a5785; --good: #0f6b3f; --good-ground: #dff3e7; "
    "--bad: #a11a17; --bad-ground: #fbe4e2; --mixed: #7a4e00; --mixed-ground: #fff0cf; "
    "--plain: #46515e; --plain-ground: #f6f7f9;"
)
_DARK = (
    "color-scheme: dark; --page: #0b0e13; --ink: #e2e7ee; --faint: #a3adba; --line: #3a4450; "
    "--raised: #10141a; --fresh: #33270a; --link: #5fd0ff; --good: #7be3a4; --good-ground: #12301f; "
    "--bad: #ff8d86; --bad-ground: #3a1614; --mixed: #ffcf5c; --mixed-ground: #33270a; "
    "--plain: #a3adba; --plain-ground: #10141a; --ramp: brightness(1.7);"
)
# Colours of the pictures, which are drawn for paper, and their replacements in the dark. Those within the
# class `fixed` have a meaning by their hue and stay.
_IN_THE_DARK = {
    "#ffffff": "#0b0e13",
    "#fafafa": "#10141a",
    "#ececec": "#1e232b",
    "#dddddd": "#3a424e",
    "#c8c8c8": "#4a525e",
    "#3c3c3c": "#566070",
    "#222222": "#e4e8ee",
    "#777777": "#a0a8b4",
    "#9a9a9a": "#8a94a2",
    "#112729": "#afffd7",
    "#aa6619": "#b2780b",
    "#6a3d0a": "#e0b060",
    "#bfe8c8": "#1d5a3c",
    "#ab4366": "#d75f87",
    "#4c0083": "#ffafff",
    "#3066e4": "#5f87ff",
    "#554100": "#ffd75f",
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
STYLE = f"""
:root {{ {_LIGHT} }}
@media screen {{
  @media (prefers-color-scheme: dark) {{ :root:not([data-theme=light]) {{ {_DARK} }} }}
  :root[data-theme=dark] {{ {_DARK} }}
  svg {{ fill: var(--ink); }} .ramp {{ filter: var(--ramp); }}
{_RECOLORED}}}
"""
"""Style of all pages."""
STYLE += "".join(
    f".{tone} {{ --tone: var(--{tone}); --ground: var(--{tone}-ground); }}\n"
    for tone in ("good", "bad", "mixed", "plain")
)
STYLE += """
* { box-sizing: border-box; }
body { font: 16px/1.45 system-ui, "DejaVu Sans", Helvetica, Arial, sans-serif; color: var(--ink);
  background: var(--page); max-width: 1120px; margin: 0 auto; padding: 14px 20px; }
h1 { font-size: 1.5em; margin: 0 0 .2em; } h2 { font-size: 17px; margin: 1.4em 0 .4em; }
p, li, pre, h1, h2, figcaption { overflow-wrap: break-word; }
p.run { color: var(--faint); font-size: 14px; margin: 0 0 10px; }
a, summary { color: var(--link); }
code, pre { font-family: "DejaVu Sans Mono", Consolas, Menlo, monospace; font-size: .86em; }
.picture > svg { width: 100%; height: auto; display: block; break-inside: avoid; overflow: visible; }
.maze, .map { container: picture / inline-size; margin: 0 auto 10px; }
.graph, .strips { overflow-x: auto; } .graph > svg, .strips > svg { min-width: 960px; }  /* texts of 11 px */
ul.legend { display: flex; flex-wrap: wrap; gap: 2px 18px; list-style: none; padding: 0; margin: 0 0 8px;
  font-size: 13px; color: var(--faint); }
.legend li { display: flex; align-items: center; gap: 6px; margin: 0; }
.legend svg { height: 16px; flex: none; }
ul { margin: .3em 0; padding-left: 1.2em; } li { margin: .25em 0; }
.verdict + .card { margin-top: 10px; }
.verdict { display: flex; gap: 14px; align-items: center; padding: 10px 16px; border-radius: 6px;
  border-left: 8px solid var(--tone); background: var(--ground); }
.verdict h1 { font-size: 27px; line-height: 1.15; margin: 0; color: var(--tone); }
.verdict .sign { flex: none; width: 44px; font-size: 40px; line-height: 1; text-align: center;
  font-weight: 700; color: var(--tone); }
.verdict div { min-width: 0; } .verdict p { margin: 3px 0 0; font-size: 17px; }
.toned { font-weight: 700; white-space: nowrap; color: var(--tone); }
.figures { display: grid; grid-template-columns: repeat(3, minmax(0, 1fr)); gap: 10px; margin: 12px 0; }
.figures div, .card { background: var(--raised); border: 1px solid var(--line); border-radius: 6px; }
.figures div { padding: 6px 12px; } .figures span { color: var(--faint); font-size: 14px; }
.figures strong { display: block; font-size: 24px; line-height: 1.2; font-variant-numeric: tabular-nums; }
.card { padding: 7px 14px; margin: 12px 0; font-size: 15px; line-height: 1.4; } .card h2 { margin: 0 0 3px; }
.card ul { list-style: none; margin: 0; padding: 0; } .columns .card { margin: 0 0 10px; }
.card pre { margin: 0; } pre { white-space: pre-wrap; line-height: 1.4; }
.card pre :last-child { font-weight: 700; color: var(--bad); }
.columns { display: grid; grid-template-columns: minmax(0, 1fr) 340px; gap: 10px 18px; margin: 12px 0; }
.columns.even { grid-template-columns: repeat(2, minmax(0, 1fr)); }
.columns > div { min-width: 0; }
.bar { display: flex; height: 20px; border-radius: 4px; overflow: hidden; margin: 12px 0 4px; gap: 1px; }
.bar i { min-width: 2px; background: var(--tone); } .bar-words { margin: 0; font-size: 14px; }
.bar-words .toned { margin-right: .9em; display: inline-block; }
details { margin: 10px 0; } summary { cursor: pointer; padding: 4px 0; font-weight: 600; }
.tables { display: flex; flex-wrap: wrap; gap: 0 2.5em; align-items: flex-start; }
.columns section:first-child h2, .columns > div > h2:first-child { margin-top: .2em; }
section { break-inside: avoid; max-width: 100%; overflow-x: auto; }
table { border-collapse: collapse; font-size: 14px; }
th { text-align: left; border-bottom: 1px solid var(--line); color: var(--faint); font-weight: 600; }
th, td { padding: .2em 1em .2em 0; vertical-align: top; }
:is(th, td):last-child { padding-right: 0; }
table.sortable { width: 100%; font-size: 15px; }
.sortable td { border-bottom: 1px solid var(--line); padding: 6px 10px 6px 0; }
.sortable th { cursor: pointer; } .sortable th[aria-sort=ascending]::after { content: " ▲"; }
.sortable th[aria-sort=descending]::after { content: " ▼"; }
.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
th.n { white-space: normal; }
td.h { font-family: monospace; white-space: pre; }
p.strong { font-weight: 600; } p.warning { color: var(--bad); }
p.note { color: var(--faint); font-size: 14px; margin: .3em 0; max-width: 60em; }
@media (max-width: 900px) {  /* tablets, and A4 upright */
  .columns, .columns.even { grid-template-columns: minmax(0, 1fr); }
}
@media screen and (max-width: 700px) {
  body { padding: 12px; }
  .verdict { padding: 8px 10px; } .verdict h1 { font-size: 22px; } .verdict p { font-size: 16px; }
  .verdict .sign { font-size: 32px; width: 32px; }
  .figures { gap: 8px; } .figures div { padding: 6px 8px; } .figures strong { font-size: 19px; }
  .figures span { font-size: 12.5px; display: block; line-height: 1.3; } pre { font-size: 12px; }
  .wide, .wide tbody { display: block; } .wide thead { display: none; }
  .wide tr { display: flex; flex-wrap: wrap; gap: 0 14px; padding: 4px 0;
    border-bottom: 1px solid var(--line); }
  .wide td { display: block; border: 0; padding: 0; max-width: 100%; white-space: normal; text-align: left;
    overflow-wrap: break-word; }
  .wide td:empty { display: none; }
  .wide td[data-label]::before { content: attr(data-label) " "; color: var(--faint); font-weight: 400; }
}
@media print { body { font-size: 14px; margin: 0; max-width: none; padding: 0; } h2 { margin-top: 1em; }
  details::details-content { content-visibility: visible; block-size: auto; }  /* paper is not opened */
  h2, summary { break-after: avoid; } @page { margin: 14mm; } * { print-color-adjust: exact; } }
"""
# A picture of 960 points is drawn at any width, and its texts are to have 12 to 13 CSS pixels in all of them.
# CSS cannot divide by a width, so each tenth of growth has a rule of its own. Narrower than 200 is no screen.
_TEXT, _NARROWEST, _GROWTH = 12.0, 200.0, 1.1
_STEPS = math.ceil(math.log(PICTURE_WIDTH * _TEXT / 11.0 / _NARROWEST) / math.log(_GROWTH))
STYLE += "".join(
    f"@container picture (min-width: {width:.0f}px) "
    f"{{ text {{ font-size: {_TEXT * PICTURE_WIDTH / width:.1f}px; }} }}\n"
    for width in (_NARROWEST * _GROWTH**step for step in range(_STEPS))
)
SORTING = """<script>
"use strict";
for (const table of document.querySelectorAll("table.sortable")) {
  const body = table.tBodies[0];
  [...table.tHead.rows[0].cells].forEach((heading, place) => {
    const sort = () => {
      const falls = heading.ariaSort === "ascending";
      for (const each of table.tHead.rows[0].cells) each.removeAttribute("aria-sort");
      heading.ariaSort = falls ? "descending" : "ascending";
      const value = (row) => row.cells[place].dataset.value ?? "";
      const order = (a, b) => {
        const [x, y] = [value(a), value(b)];
        if (x === "" || y === "") return (x === "") - (y === "");  // blanks come last both ways
        const by = isNaN(x) || isNaN(y) ? x.localeCompare(y) : x - y;
        return falls ? -by : by;
      };
      body.append(...[...body.rows].sort(order));
    };
    heading.tabIndex = 0;
    heading.addEventListener("click", sort);
    heading.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();  // space would scroll
      sort();
    });
  });
}
</script>"""
"""Script of pages with tables that a reader can sort."""
