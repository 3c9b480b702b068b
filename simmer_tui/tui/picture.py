"""Picture of the screen as an SVG that looks the same everywhere: no script, no font to load.

Blocks, dots and lines are drawn as shapes, and every word has its place, so that nothing shifts without the
terminal's font.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from html import escape

from rich.cells import cell_len
from rich.segment import Segment
from rich.style import Style
from rich.terminal_theme import DEFAULT_TERMINAL_THEME, MONOKAI, TerminalTheme
from textual.strip import Strip

from simmer_tui.tui.maze.glyphs import signs_for
from simmer_tui.tui.terminal import ColorDepth, GlyphMode

# Twice as high as wide, as in most terminals, and divisible by the 2 x 4 dots of braille.
_WIDTH, HEIGHT = 10, 20
"""Size of a cell."""
# Leaves a quarter of the cell for descenders.
_BASELINE = 15
# Letters of usual fixed-width fonts are 0.6 of the size wide.
_FONT_SIZE = 16.6
"""Font size at which such letters are as wide as a cell."""
_DOTS = ((0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (0, 3), (1, 3))
"""(column, row) of each bit of a braille pattern."""
# Round corners are drawn as square ones.
_ARMS = ("lr", "ud", "rd", "rd", "ld", "ld", "ru", "ru", "lu", "lu", "udr", "udl", "lrd", "lru", "lrud")
_ARMS_OF = dict(zip("─│┌╭┐╮└╰┘╯├┤┬┴┼", _ARMS, strict=True))
"""Arms of each line of a box: left, right, up, down."""
_PIXELS = {
    code: (signs.across, signs.down, pattern)
    for mode in (GlyphMode.OCTANT, GlyphMode.SEXTANT, GlyphMode.QUADRANT, GlyphMode.HALF)
    for signs in (signs_for(mode, ColorDepth.TRUECOLOR),)
    for pattern, code in enumerate(signs.blocks)
    if pattern
}
"""Pixels across and down of every character made of pixels, and the pattern of those that are set."""
_ENDS = {"l": (0, 10), "r": (10, 10), "u": (5, 0), "d": (5, 20)}


class _Page:
    """Shapes by colour, and letters."""

    def __init__(self, theme: TerminalTheme) -> None:
        self._theme = theme
        self.areas: dict[str, list[str]] = defaultdict(list)
        self.blocks: dict[str, list[str]] = defaultdict(list)
        self.dots: dict[str, list[str]] = defaultdict(list)
        self.lines: dict[str, list[str]] = defaultdict(list)
        self.letters: dict[tuple[str, bool], list[str]] = defaultdict(list)

    def add(self, segment: Segment, column: int, row: int) -> None:
        """Draw one run of cells."""
        style = segment.style or Style()
        ink, paper = self._color(style, True), self._color(style, False)
        if style.reverse:
            ink, paper = paper, ink
        self.areas[paper].append(
            _area(column * _WIDTH, row * HEIGHT, cell_len(segment.text) * _WIDTH, HEIGHT)
        )
        texts = self.letters[ink, bool(style.bold)]
        word, begin = "", 0
        x = column * _WIDTH
        for character in f"{segment.text} ":
            if character == " " or self._draw(character, x, row * HEIGHT, ink):
                if word:
                    texts.append(f"<text x='{begin}' y='{row * HEIGHT + _BASELINE}'>{escape(word)}</text>")
                word = ""
            else:
                begin = begin if word else x
                word += character
            x += _WIDTH * cell_len(character)

    def _draw(self, character: str, x: int, y: int, ink: str) -> bool:
        """Draw a character as shapes, if possible. Returns True if it was."""
        code = ord(character)
        if 0x2581 <= code <= 0x2588:
            height = HEIGHT * (code - 0x2580) / 8
            self.blocks[ink].append(_area(x, y + HEIGHT - height, _WIDTH, height))
        elif code in _PIXELS:
            across, down, pattern = _PIXELS[code]
            width, height = _WIDTH / across, HEIGHT / down
            for pixel in range(across * down):
                if pattern >> pixel & 1:
                    left, top = x + pixel % across * width, y + pixel // across * height
                    self.blocks[ink].append(_area(left, top, width, height))
        elif 0x2800 < code < 0x2900:
            bits = (place for bit, place in enumerate(_DOTS) if code >> bit & 1)
            self.dots[ink] += [f"M{x + 2.5 + 5 * across:g} {y + 2.5 + 5 * down:g}h0" for across, down in bits]
        elif character in _ARMS_OF:
            ends = (_ENDS[arm] for arm in _ARMS_OF[character])
            self.lines[ink] += [f"M{x + 5} {y + 10}L{x + dx} {y + dy}" for dx, dy in ends]
        else:
            return False
        return True

    def _color(self, style: Style, foreground: bool) -> str:
        color = style.color if foreground else style.bgcolor
        if color is None or color.is_default:
            theme = self._theme
            return (theme.foreground_color if foreground else theme.background_color).hex
        return color.get_truecolor(self._theme, foreground=foreground).hex

    def elements(self) -> Iterator[str]:
        """From the back to the front."""
        yield "<g shape-rendering='crispEdges'>"  # no seams between neighbours when the picture is scaled
        yield from (*_paths("fill", self.areas), *_paths("fill", self.blocks))
        yield "</g><g fill='none' stroke-linecap='round' stroke-width='3.4'>"
        yield from _paths("stroke", self.dots)
        yield "</g><g fill='none' stroke-linecap='square'>"
        yield from _paths("stroke", self.lines)
        yield f"</g><g font-family='DejaVu Sans Mono, Menlo, Consolas, monospace' font-size='{_FONT_SIZE}'>"
        for (ink, bold), texts in self.letters.items():
            weight = " font-weight='bold'" if bold else ""
            yield f"<g fill='{ink}'{weight}>{''.join(texts)}</g>"
        yield "</g>"


def screen_picture(strips: Sequence[Strip], *, dark: bool = True) -> str:
    """Rows of a screen as an SVG. `dark` is true if the default colours are those of a dark theme."""
    page = _Page(MONOKAI if dark else DEFAULT_TERMINAL_THEME)
    for row, strip in enumerate(strips):
        column = 0
        for segment in strip.simplify():
            if segment.text and not segment.control:
                page.add(segment, column, row)
                column += cell_len(segment.text)
    width = max((strip.cell_length for strip in strips), default=0) * _WIDTH
    height = len(strips) * HEIGHT
    return (
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width} {height}' width='{width}' "
        f"height='{height}' role='img'><title>SimMeR</title>"
        f"{''.join(page.elements())}</svg>\n"
    )


def _paths(painted: str, shapes: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """A path for each colour, which fills it or is its stroke."""
    return (f"<path {painted}='{ink}' d='{''.join(paths)}'/>" for ink, paths in shapes.items())


def _area(x: float, y: float, width: float, height: float) -> str:
    return f"M{x:g} {y:g}h{width:g}v{height:g}h-{width:g}z"
