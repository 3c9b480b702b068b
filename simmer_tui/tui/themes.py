"""Themes of the app: the colours of the maze's picture, for everything around it.

There is one theme for each look and colour depth, so that panels send exactly the entries that the terminal
has. Text has a contrast of at least 7:1 on its ground. Colours with less, such as the pink of a contact, are
for marks; their words have the colour of text.
"""

from textual.theme import Theme

from simmer_tui.tui.maze.palette import Look, Palette, Role, palette_for
from simmer_tui.tui.terminal import ColorDepth

# Level AAA, since terminals are read for hours, and in lecture halls.
LEGIBLE = 7.0
"""Least contrast of text (WCAG 2)."""
THEMES = {"dark": Look.DARK, "light": Look.LIGHT, "high-contrast": Look.CONTRAST}
"""Looks by their name in settings.toml."""
_VARIABLES = {
    "dim": Role.DIM_TEXT,
    "mark": Role.ACCENT,
    "strong": Role.RAY_STRONG,
    "belief": Role.BELIEF,
    "contact": Role.CONTACT,
    "good": Role.GOOD,
    "warning": Role.WARNING,
    "danger": Role.DANGER,
    "rule": Role.GRID,
    "bars": Role.BARS,
    "robot": Role.ROBOT,
    "state-waiting": Role.WAITING,
    "state-paused": Role.PAUSED,
    "state-success": Role.SUCCESS,
    "state-failure": Role.FAILURE,
    "light-text": Role.LIGHT_TEXT,
    "dark-text": Role.DARK_TEXT,
    "black-tile": Role.LOUD_BLACK,
    "white-tile": Role.LOUD_WHITE,
    "driving-time": Role.DRIVING_TIME,
    "sensing-time": Role.SENSING_TIME,
    "link-time": Role.LINK_TIME,
}
_WORDS = ("strong", "belief", "mark", "robot", "good", "warning", "danger")
"""Colours that words are written in too, as `$contact-text`, in a legible variant."""


def theme_name(look: Look) -> str:
    """Name of a look's theme; the maze view knows high contrast by it."""
    return "simmer-high-contrast" if look is Look.CONTRAST else f"simmer-{look.value}"


def themes(depth: ColorDepth) -> list[Theme]:
    """All themes of a colour depth."""
    return [_theme(palette_for(_shown(depth), look)) for look in Look]


def variables(depth: ColorDepth, look: Look = Look.DARK) -> dict[str, str]:
    """Colours by the names that app.tcss gives them."""
    palette = palette_for(_shown(depth), look)
    named = {name: _hex(palette[role]) for name, role in _VARIABLES.items()}
    named |= {f"{name}-text": _hex(palette[_legible(palette, _VARIABLES[name])]) for name in _WORDS}
    return named


def contrast(first: int, second: int) -> float:
    """Contrast of two packed colours (WCAG 2, relative luminance)."""
    lighter, darker = sorted((_luminance(first), _luminance(second)), reverse=True)
    # 0.05 represents light that any screen reflects.
    return (lighter + 0.05) / (darker + 0.05)


def _legible(palette: Palette, role: Role) -> Role:
    ground = min(contrast(palette[role], palette[under]) for under in (Role.BACKGROUND, Role.BARS))
    return role if ground >= LEGIBLE else Role.TEXT


def _shown(depth: ColorDepth) -> ColorDepth:
    """The depth itself; without colours any depth is possible, since none is sent."""
    return ColorDepth.TRUECOLOR if depth is ColorDepth.NONE else depth


def _theme(palette: Palette) -> Theme:
    look = palette.look
    text, ground = _hex(palette[Role.TEXT]), _hex(palette[Role.BACKGROUND])
    bars = _hex(palette[Role.BARS])
    return Theme(
        name=theme_name(look),
        primary=_hex(palette[Role.ACCENT]),
        secondary=_hex(palette[Role.ACCENT]),
        accent=_hex(palette[Role.ACCENT]),
        warning=_hex(palette[Role.RAY_STRONG]),
        error=_hex(palette[Role.CONTACT]),
        success=_hex(palette[Role.ROBOT]),
        foreground=text,
        background=ground,
        surface=bars,
        panel=bars,
        # Textual's own boost is a tint of the background, which the terminal may not have.
        boost=bars,
        dark=look is not Look.LIGHT,
        variables=variables(palette.depth, look),
    )


def _hex(packed: int) -> str:
    return f"#{packed:06x}"


def _luminance(packed: int) -> float:
    channels = [(packed >> shift & 255) / 255 for shift in (16, 8, 0)]
    # Transfer function of sRGB, with the threshold of WCAG 2.2.
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return sum(weight * c for weight, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True))
