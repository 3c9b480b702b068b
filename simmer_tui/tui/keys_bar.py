"""The bar at the bottom: the keys of what has the focus."""

from __future__ import annotations

from collections.abc import Sequence

from textual.keys import format_key

from simmer_tui.config.keys import keys_of
from simmer_tui.config.settings import KeySettings
from simmer_tui.tui.line_panel import Line

Hint = tuple[str, str]
"""Keys, and what they do."""

CONSOLE: Sequence[Hint] = (
    ("Enter", "runs"),
    ("Tab", "completes"),
    ("Up", "last line"),
    ("Esc", "drive by keys"),
    ("Ctrl+P", "all there is to do"),
    ("Ctrl+Q", "quit"),
)
EVENTS: Sequence[Hint] = (
    ("/", "filter"),
    ("Enter", "unfold"),
    ("Up Down", "move"),
    ("End", "newest"),
    ("c", "copy"),
    ("Esc", "drive by keys"),
)
ELSEWHERE: Sequence[Hint] = ((":", "order"), ("Ctrl+P", "all there is to do"), ("Ctrl+Q", "quit"))
_MAZE = (
    (("forward", "turn_left", "back", "turn_right"), "drive"),
    (("stop",), "stop"),
    (("poll",), "read all"),
    (("fit",), "fit"),
    (("zoom_in", "zoom_out"), "zoom"),
    (("pause",), "pause"),
    (("slower", "faster"), "pace"),
    (("rays",), "rays"),
    (("trail",), "trail"),
    (("truth",), "truth"),
    (("floor",), "floor"),
    (("reset",), "reset"),
    (("follow",), "follow"),
    (("help",), "help"),
)
"""Names of key settings by what they do; those there are."""
_SHORT: dict[str, str] = {
    "plus": "+",
    "minus": "-",
    "equals_sign": "=",
    "question_mark": "?",
    "space": "space",
}


def maze_hints(keys: KeySettings) -> list[Hint]:
    """The keys of the maze, as the settings have them."""
    hints = [(":", "order")]
    for names, word in _MAZE:
        if all(hasattr(keys, name) for name in names):
            hints.append((" ".join(_shown(keys, name) for name in names), word))
    return [hints[1], hints[0], *hints[2:]]


def drive_keys(keys: KeySettings) -> str:
    """The four keys that drive and turn."""
    return maze_hints(keys)[0][0]


def keys_line(hints: Sequence[Hint], width: int, first: Sequence[Hint] = ()) -> Line:
    """As many hints as there is room for. Those in `first` are never left out for others."""
    kept = width - 1 - sum(len(key) + len(word) + 3 for key, word in first)
    pieces: list[tuple[str, str]] = [(" ", "plain")]
    room = kept
    shown = []
    for key, word in hints:
        needed = len(key) + len(word) + 3
        if needed - 2 > room:
            break
        room -= needed
        shown.append((key, word))
    for key, word in (*shown, *first):
        pieces += [(key, "title"), (f" {word}  ", "dim")]
    return tuple(pieces)


def _shown(keys: KeySettings, name: str) -> str:
    """The shortest key of an action: a letter rather than an arrow."""
    names = keys_of(keys, name)
    if not names:
        return "-"
    key: str = min(names, key=_length)
    return _SHORT.get(key) or (key if len(key) == 1 else format_key(key))


def _length(key: str) -> int:
    return len(_SHORT.get(key) or key)
