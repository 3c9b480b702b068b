"""Abilities of a terminal: its number of colours and its characters.

Pure decisions from an environment mapping. Nothing here imports Textual, because Textual reads
`TEXTUAL_COLOR_SYSTEM` when it is imported: decide, `apply`, and import it only then.
"""

import codecs
from collections.abc import Mapping, MutableMapping
from enum import StrEnum

from msgspec import Struct

_AUTO = "auto"
"""Option value that leaves the choice to `choose`."""


class ColorDepth(StrEnum):
    """Number of colours that are sent; the values are those of `--color`."""

    TRUECOLOR = "truecolor"
    COLORS_256 = "256"
    COLORS_16 = "16"
    NONE = "none"


class GlyphMode(StrEnum):
    """Characters of a picture; the values are those of `--glyphs`.

    `quadrant`, `sextant` and `octant`: blocks of 2 x 2, 2 x 3 and 2 x 4 pixels a cell, with braille
    dots for lines; ever newer in Unicode. `half`: half blocks and signs of WGL4, which nearly every
    font has. `ascii`: letters and signs.
    """

    QUADRANT = "quadrant"
    SEXTANT = "sextant"
    OCTANT = "octant"
    HALF = "half"
    ASCII = "ascii"


# Programs that show 24-bit colour and give their name, but do not all set COLORTERM.
_TRUECOLOR_PROGRAMS = frozenset(
    {"iterm.app", "wezterm", "vscode", "ghostty", "hyper", "rio", "warpterminal", "mintty", "tabby", "zed"}
    | {"textual"}  # a terminal in a browser
)
_TRUECOLOR_TERMS = ("xterm-kitty", "xterm-ghostty", "wezterm", "alacritty", "foot", "contour", "rio")
# A multiplexer keeps the variables of the terminal that it was started in, not of the one that shows it.
_MULTIPLEXERS = ("tmux", "screen")


class TerminalChoice(Struct, frozen=True):
    """Colours and characters to use."""

    color: ColorDepth
    glyphs: GlyphMode

    @property
    def color_system(self) -> str:
        """Value for `TEXTUAL_COLOR_SYSTEM`."""
        # Rich's name of the 16 colours. Without colours it needs a name as well: see `ansi_color`.
        few = self.color in (ColorDepth.COLORS_16, ColorDepth.NONE)
        return "standard" if few else self.color.value

    @property
    def ansi_color(self) -> bool:
        """Argument for Textual's `App(ansi_color=...)`. Without colours it must be true: otherwise Textual's
        NO_COLOR filter sends shades of grey."""
        return self.color is ColorDepth.NONE

    def apply(self, environment: MutableMapping[str, str]) -> None:
        """Set the variables that Textual reads; call before Textual is imported."""
        environment["TEXTUAL_COLOR_SYSTEM"] = self.color_system
        if self.color is ColorDepth.NONE:
            environment["NO_COLOR"] = "1"
        else:
            # Textual turns everything grey if the variable is set at all, even if a colour option asks for
            # colours.
            environment.pop("NO_COLOR", None)


def choose(
    environment: Mapping[str, str],
    encoding: str | None,
    *,
    color: str = _AUTO,
    glyphs: str = _AUTO,
    windows: bool = False,
) -> TerminalChoice:
    """Choice for an environment and the encoding of standard output.

    Args:
        color, glyphs: the options as given; anything but `auto` wins.
        windows: true on Windows.

    Raises:
        ValueError: for an option value that is not allowed.
    """
    automatic = _automatic_color(environment, encoding, windows)
    depth = automatic if color == _AUTO else ColorDepth(color)
    if glyphs != _AUTO:
        return TerminalChoice(depth, GlyphMode(glyphs))
    term = environment.get("TERM", "").lower()
    if not _is_utf8(encoding) or _asks_for_no_utf8(environment) or term == "dumb" or depth is ColorDepth.NONE:
        return TerminalChoice(depth, GlyphMode.ASCII)
    return TerminalChoice(depth, _automatic_glyphs(environment, term, windows))


def _automatic_glyphs(environment: Mapping[str, str], term: str, windows: bool) -> GlyphMode:
    if term == "linux":
        return GlyphMode.ASCII  # the console's fonts have no half blocks
    # PuTTY and the old Windows console take all characters from one font.
    knows_itself = environment.get("WT_SESSION") or environment.get("TERM_PROGRAM")
    if term.startswith("putty") or (windows and not term and not knows_itself):
        return GlyphMode.HALF
    return GlyphMode.QUADRANT


def _automatic_color(environment: Mapping[str, str], encoding: str | None, windows: bool) -> ColorDepth:
    term = environment.get("TERM", "").lower()
    if environment.get("NO_COLOR") or term == "dumb" or not _is_utf8(encoding):
        return ColorDepth.NONE
    # The Linux console has 16 colours whatever else the environment contains.
    if term == "linux":
        return ColorDepth.COLORS_16
    if environment.get("COLORTERM", "").lower() in ("truecolor", "24bit") or term.endswith("-direct"):
        return ColorDepth.TRUECOLOR
    # In a multiplexer these variables may be those of another terminal.
    if not term.startswith(_MULTIPLEXERS) and (
        environment.get("TERM_PROGRAM", "").lower() in _TRUECOLOR_PROGRAMS
        or environment.get("WT_SESSION")
        or term.startswith(_TRUECOLOR_TERMS)
        or (windows and not term)
    ):
        return ColorDepth.TRUECOLOR
    if term.endswith("-256color") or environment.get("TERM_PROGRAM") == "Apple_Terminal":
        return ColorDepth.COLORS_256
    return ColorDepth.COLORS_16


def _is_utf8(encoding: str | None) -> bool:
    if not encoding:
        return False
    try:
        return codecs.lookup(encoding).name == "utf-8"
    except LookupError:
        return False


def _asks_for_no_utf8(environment: Mapping[str, str]) -> bool:
    """True if the user's locale is C, or names another character set (`de_DE.ISO-8859-1`).

    Python hides it: it writes UTF-8 for C, and for a locale that the machine lacks, as over SSH. It may set
    LC_CTYPE.
    """
    coerced = environment.get("LC_CTYPE", "") in ("", "C.UTF-8", "C.utf8", "UTF-8")
    usual = environment.get("LANG", "") if coerced else environment["LC_CTYPE"]
    locale = environment.get("LC_ALL") or usual
    charset = locale.partition(".")[2].partition("@")[0]
    return locale in ("C", "POSIX") or (charset != "" and not _is_utf8(charset))
