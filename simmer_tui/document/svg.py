"""Pieces of SVG as text; no library is needed for them."""

from __future__ import annotations

from collections.abc import Iterable

from msgspec.structs import replace

from simmer_tui.document.model import Figure, LegendMark
from simmer_tui.errors import printable

PICTURE_WIDTH = 960.0
"""Width of every picture, points."""
FONT = "font-family='Helvetica, Arial, sans-serif'"
INK = "#222222"
FAINT = "#777777"
CONTACT = "#ab4366"
BELIEF = "#4c0083"
ROBOT_LINE, BODY = "#112729", "#bfe8c8"
BLOCK_FILL, BLOCK_LINE = "#aa6619", "#6a3d0a"
# From the beginning to the end: ever lighter, so that it reads in grey too. Each has 3 : 1 to the floor, on
# paper as it is, and in the dark as `page_style` brightens it.
_RAMP = ((70, 50, 160), (31, 105, 200), (10, 140, 130), (84, 140, 10), (190, 110, 0))
SHADES = 48
"""Colours of a path, each a group in the file: more would make the file larger only."""


# As `html.escape`: its module also loads a table of 2,000 entities, which takes a millisecond.
_ESCAPED = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "'": "&#x27;"})


def html_text(text: str) -> str:
    """Text as HTML and XML show it: no markup, and no character that they cannot hold."""
    return printable(text).translate(_ESCAPED)


def coordinate(value: float) -> str:
    """A coordinate, short."""
    return f"{value:.2f}".rstrip("0").rstrip(".")


def shade(fraction: float) -> str:
    """The colour of a moment, from 0 at the beginning to 1 at the end."""
    place = min(max(fraction, 0.0), 1.0) * (len(_RAMP) - 1)
    low = min(int(place), len(_RAMP) - 2)
    part = place - low
    mixed = [round(a + part * (b - a)) for a, b in zip(_RAMP[low], _RAMP[low + 1], strict=True)]
    return f"#{mixed[0]:02x}{mixed[1]:02x}{mixed[2]:02x}"


def element(name: str, content: str = "", /, **attributes: object) -> str:
    """`<name attributes>content</name>`; underscores in names become hyphens, floats short."""
    listed = "".join(
        f" {key.rstrip('_').replace('_', '-')}='{coordinate(value) if isinstance(value, float) else value}'"
        for key, value in attributes.items()
    )
    return f"<{name}{listed}>{content}</{name}>" if content or name == "g" else f"<{name}{listed}/>"


def text(x: float, y: float, words: str, size: float = 11.0, **attributes: object) -> str:
    """A line of text; `words` may hold anything."""
    return element("text", html_text(words), x=float(x), y=float(y), font_size=size, **attributes)


def points(pairs: Iterable[tuple[float, float]]) -> str:
    """The `points` of a polyline."""
    return " ".join(f"{coordinate(x)},{coordinate(y)}" for x, y in pairs)


def curve(pairs: Iterable[tuple[float, float]]) -> str:
    """The same to a tenth of a point, where there are many of them."""
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in pairs)


def whole_figure(figure: Figure) -> Figure:
    """The figure with its legend drawn in it."""
    if not figure.legend:
        return figure
    drawn, rows = _legend(_LEGEND_LEFT, figure.height + _LEGEND_ROW / 2, figure.legend)
    height = figure.height + rows * _LEGEND_ROW
    return replace(figure, height=height, content=figure.content + drawn, legend=())


def figure_svg(figure: Figure, shown: float | None = None) -> str:
    """A figure on white without its legend, which scales to the width it is given; by itself it is `shown`
    points wide."""
    width, height = figure.width, figure.height
    shown = width if shown is None else shown
    role = "group" if "<a " in figure.content else "img"  # screen readers leave out the links of an image
    return (
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {coordinate(width)} {coordinate(height)}' "
        f"width='{coordinate(shown)}' height='{coordinate(height * shown / width)}' role='{role}' {FONT} "
        f"fill='{INK}'>"
        f"<title>{html_text(figure.title)}</title>"
        f"<rect width='100%' height='100%' fill='#ffffff'/>{figure.content}</svg>"
    )


def document(figure: Figure, shown: float | None = None) -> str:
    """The same with its legend, as a file of its own."""
    return f"<?xml version='1.0' encoding='UTF-8'?>\n{figure_svg(whole_figure(figure), shown)}\n"


def translated(x: float, y: float, content: str) -> str:
    """The same, moved."""
    return element("g", content, transform=f"translate({coordinate(x)} {coordinate(y)})")


# Room to the left of a legend, and height of one of its rows, points.
_LEGEND_LEFT, _LEGEND_ROW = 34.0, 26.0


def _legend(left: float, y: float, marks: Iterable[LegendMark]) -> tuple[str, int]:
    """A legend in rows from `left` on, and the number of its rows."""
    parts, x, rows = [], left, 1
    # A letter of 11 points is about 5.6 points wide on average; SVG cannot measure text.
    for mark in marks:
        wide = mark.width + 10 + 5.6 * len(mark.words)
        if x > left and x + wide > PICTURE_WIDTH:
            x, y, rows = left, y + _LEGEND_ROW, rows + 1
        parts.append(translated(x, y, mark.drawing) + text(x + mark.width + 6, y + 4, mark.words))
        x += wide + 16
    return "".join(parts), rows


def dash(color: str, width: float = 2.0, **attributes: object) -> str:
    """A short line for a legend."""
    return element("line", x1=0.0, y1=0.0, x2=20.0, y2=0.0, stroke=color, stroke_width=width, **attributes)


def cross(color: str, width: float = 2.0) -> str:
    """A cross for a legend."""
    return element("path", d="M6 -4l8 8m0 -8l-8 8", stroke=color, stroke_width=width)


def tooltip(words: str) -> str:
    """A tooltip: browsers show it when an element is pointed at."""
    return element("title", html_text(words))
