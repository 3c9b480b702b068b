"""Keys: their actions, and their texts in the help, the palette and the bar at the bottom."""

from collections.abc import Iterable, Mapping, Sequence
from typing import ClassVar

from msgspec import Struct, field
from textual.binding import Binding, BindingType
from textual.keys import format_key

from simmer_tui.config.keys import DRIVING, keys_of, shifted
from simmer_tui.config.settings import KeySettings
from simmer_tui.live.operating.orders import CONSOLE_COMMANDS
from simmer_tui.live.operating.robot_operator import DRIVES
from simmer_tui.live.operating.switches import SWITCHES
from simmer_tui.tui.line_panel import StyledLine
from simmer_tui.tui.maze.view import MazeView

Hint = tuple[str, str]
"""Keys, and a word or two for their action."""


class KeyGroup(Struct, frozen=True):
    """One key or a few that belong together.

    Attributes:
        shown: the keys as the help names them; empty for those that it leaves out.
        help: their meaning in the help.
        actions: Textual's actions by the names of keys.
        hints: what the bar at the bottom says of them. `late` ones come after all others, since the
            bar shows as many as there is room for.
    """

    shown: str
    help: str
    actions: Mapping[str, str] = field(default_factory=dict)
    hints: tuple[Hint, ...] = ()
    late: bool = False


def bindings_of(groups: Iterable[KeyGroup]) -> list[BindingType]:
    """Textual's bindings for groups of keys."""
    return [Binding(key, action) for group in groups for key, action in group.actions.items()]


def hints_of(groups: Sequence[KeyGroup]) -> list[Hint]:
    """Content of the bar for groups of keys."""
    ordered = sorted(groups, key=lambda group: group.late)
    return [hint for group in ordered for hint in group.hints]


# -- keys that are not settings --------------------------------------------------------------------

EXAMPLE_KEY = "F5"
"""Key that runs the sample program; development environments have theirs for it there."""
# Codes have small letters, and so has the maze's key for a reset at any time.
AGAIN_KEY = "R"
"""Key that restarts a run that is over, also from an empty console."""
TRY_KEY = "T"
"""Key that runs the program of a failed run again with one change at a time."""
WITH_THE_MOUSE = (
    KeyGroup("wheel", "on the maze: zoom"),
    KeyGroup("drag", "on the maze: look elsewhere; on text: mark and copy it"),
    KeyGroup("click", "on the maze: what is there"),
)
_ORDERS = KeyGroup("ctrl+p", "command palette: all orders by name", hints=(("Ctrl+P", "all there is to do"),))
_QUIT = KeyGroup("ctrl+q", "end", hints=(("Ctrl+Q", "quit"),))
ANYWHERE = (
    KeyGroup("tab", "in the console, complete; if nothing is typed, the next pane"),
    KeyGroup("escape", "close an answer; then from the console to the maze"),
    KeyGroup("enter", "in the console: give the line; from the maze: to the console"),
    KeyGroup(":", "from the maze to the console, beginning an order", hints=((":", "order"),)),
    KeyGroup("up, down", "in the console: what was typed before"),
    _ORDERS,
    KeyGroup("f2, or 1 to 4", "on small screens: the next page, or a page (from the maze)"),
    _QUIT,
    KeyGroup(EXAMPLE_KEY.lower(), "run the sample program, while a simulated robot waits for one"),
    KeyGroup(AGAIN_KEY, "after the end of a run: restart it, with its program"),
    KeyGroup(TRY_KEY, "after a failed run: again, with one change at a time"),
)
IN_LOG = (
    KeyGroup("/, slash", "filter by what is typed next; escape shows all",
             {"slash": "filter"}, (("/", "filter"),)),
    KeyGroup("enter", "unfold readings, or the rest of a long line; fold again",
             {"enter": "unfold"}, (("Enter", "unfold"),)),
    KeyGroup("c", "copy to the clipboard", {"c": "app.copy_log"}, (("c", "copy"),), late=True),
    KeyGroup("up, down, end", "move; to the newest",
             {"up": "step(-1)", "down": "step(1)", "end": "scroll_end"},
             (("Up Down", "move"), ("End", "newest"))),
    KeyGroup("escape", "to the maze", {"escape": "app.focus_pane"}, (("Esc", "drive by keys"),), late=True),
)  # fmt: skip
# Their help is in `ANYWHERE`: people look for the console's keys there.
IN_CONSOLE = (
    KeyGroup("", "", {"enter": "submit"}, (("Enter", "runs"),)),
    KeyGroup("", "", {"tab": "complete"}, (("Tab", "completes"),)),
    KeyGroup("", "", {"escape": "app.close_answer"}, (("Esc", "drives by keys"),)),
    KeyGroup("", "", hints=((":why", "explains"), *_ORDERS.hints)),
    KeyGroup("", "", {"up": "older", "down": "newer"}, (("Up", "last line"),)),
    KeyGroup("", "", hints=_QUIT.hints),
)


def _jumps(key: str, kind: str, meaning: str, hint: str) -> KeyGroup:
    """A key to the next entry of a kind, and with Shift to the one before."""
    actions = {key: f"jump('{kind}', 1)", key.upper(): f"jump('{kind}', -1)"}
    shown = f"{key} and {key.upper()}", f"next {meaning}, the one before"
    return KeyGroup(*shown, actions, ((key, hint),))


IN_REPLAY = (
    KeyGroup("space", "play, pause", {"space": "play"}, (("space", "play"),)),
    KeyGroup("[ and ]", "slower, faster (0.25x to 16x)",
             {"left_square_bracket": "playback_rate(-1)", "right_square_bracket": "playback_rate(1)"},
             (("[ ]", "speed"),)),
    KeyGroup("left, right", "a second back, on; ten with Shift",
             {"left": "seek(-1)", "right": "seek(1)", "shift+left": "seek(-10)", "shift+right": "seek(10)"},
             (("Left Right", "1 s"),), late=True),
    _jumps("n", "command", "command", "command"),
    _jumps("c", "contact", "contact", "contact"),
    _jumps("o", "goal", "goal of a mission", "goal"),
    _jumps("p", "pause", "pause", "pause"),
    _jumps("x", "refused command", "refused command", "refused"),
    KeyGroup("g", "go to a time: 95, or 1:35; a click on the bar goes there too",
             {"g": "ask_time"}, (("g", "time"),)),
    KeyGroup("home, end", "the beginning, the end", {"home": "begin", "end": "end"}),
    KeyGroup("t", "take over: a live run from here on, for you or a program",
             {"t": "take_over"}, (("t", "take over"),)),
    KeyGroup("r, y, v", "show the trail, what the sensors saw, true values",
             {"r": "switch('trail')", "y": "switch('plot_sense')", "v": "switch('truth')"},
             (("y", "rays"), ("v", "truth")), late=True),
    KeyGroup("plus, minus, f", "zoom, show the whole maze; with the mouse: wheel, drag, click",
             {"plus,equals_sign": "zoom(1)", "minus": "zoom(-1)", "f": "fit"}),
    KeyGroup("k", "keep the robot in sight", {"k": "follow"}),
    KeyGroup("escape", "close an answer", {"escape": "close_answer"}),
    KeyGroup("tab, /, enter", "to the events, filter them, unfold readings"),
    KeyGroup("f2, or 1 to 4", "on small screens: the next page, or a page"),
    KeyGroup("", "", {"question_mark": "help"}, (("?", "help"),), late=True),
    KeyGroup("q", "end", {"q": "quit"}, (("q", "quit"),), late=True),
)  # fmt: skip


# -- keys that are settings ------------------------------------------------------------------------

# Also the order in the palette: keys that drive come before keys that only look.
MAZE_ACTIONS: dict[str, tuple[str, str]] = {
    "stop": ("app.press('stop')", "Stop"),
    "poll": ("app.press('poll')", "Poll"),
    "reset": ("app.press('reset')", "Reset"),
    "pause": ("app.press('pause')", "Pause"),
    "step": ("app.press('step')", "Step"),
    "slower": ("app.pace(0.5)", "Slower"),
    "faster": ("app.pace(2.0)", "Faster"),
    "full_speed": ("app.pace(0.0)", "Full speed"),
    **{each.key: (f"app.switch('{each.name}')", each.label) for each in SWITCHES if each.key},
    "zoom_in": ("zoom(1)", "Zoom in"),
    "zoom_out": ("zoom(-1)", "Zoom out"),
    "fit": ("fit", "Whole maze"),
    "follow": ("follow", "Follow"),
    "pan_left": ("pan(-1, 0)", "Look left"),
    "pan_right": ("pan(1, 0)", "Look right"),
    "pan_up": ("pan(0, -1)", "Look up"),
    "pan_down": ("pan(0, 1)", "Look down"),
    "floor": ("floor", "Floor"),
    "heat": ("heat", "Map of the belief"),
    "help": ("app.help", "Help"),
}
"""The maze's or the app's action for each further key setting, and its name in the palette."""


def is_order_too(name: str) -> bool:
    """True if an action of `MAZE_ACTIONS` does what the order of its name does: the palette has that one."""
    same = f"app.press('{name}')", f"app.switch('{name}')", f"app.{name}"
    return name in CONSOLE_COMMANDS and MAZE_ACTIONS[name][0] in same


# One or two words each, so that 80 columns hold the most important ones.
_MAZE_HINTS = {
    "drive": ("forward", "turn_left", "back", "turn_right"),
    "stop": ("stop",),
    "read all": ("poll",),
    "fit": ("fit",),
    "zoom": ("zoom_in", "zoom_out"),
    "pause": ("pause",),
    "pace": ("slower", "faster"),
    "rays": ("rays",),
    "trail": ("trail",),
    "truth": ("truth",),
    "floor": ("floor",),
    "map": ("heat",),
    "reset": ("reset",),
    "follow": ("follow",),
    "help": ("help",),
}
"""Key settings by their word in the bar, the most important first."""
# For an action without a key: no key has that name, and an empty text means the usual key to Textual.
_NO_KEY = "none"
# Textual's names of keys that are shorter as signs.
_SIGNS = {"plus": "+", "minus": "-", "equals_sign": "=", "question_mark": "?", "space": "space"}


def keymap(keys: KeySettings) -> dict[str, str]:
    """Keys by binding ID, as Textual's keymaps need them. A driving key with Shift has an entry of its
    own."""
    mapped = {name: ",".join(keys_of(keys, name)) or _NO_KEY for name in (*DRIVES, *MAZE_ACTIONS)}
    for name in DRIVING:
        mapped[f"{name}_fine"] = ",".join(shifted(key) for key in keys_of(keys, name)) or _NO_KEY
    return mapped


def driving_keys(keys: KeySettings) -> frozenset[str]:
    """Names of the keys that drive, with Shift and without."""
    plain = [key for name in DRIVING for key in keys_of(keys, name)]
    return frozenset((*plain, *map(shifted, plain)))


def _maze_bindings() -> list[BindingType]:
    keys = keymap(KeySettings())
    actions = {name: action for name, (action, _) in MAZE_ACTIONS.items()}
    for name in DRIVES:
        actions[name] = f"app.drive('{name}', False)"
        actions[f"{name}_fine"] = f"app.drive('{name}', True)"
    # With priority each is done before the next key: see TerminalApp.
    return [Binding(keys[name], action, id=name, priority=True) for name, action in actions.items()]


class MazePane(MazeView):
    """The maze of a live run; while it has the focus its keys drive the robot."""

    BINDINGS: ClassVar[list[BindingType]] = _maze_bindings()


# -- the bar at the bottom -------------------------------------------------------------------------


def maze_hints(keys: KeySettings) -> list[Hint]:
    """Content of the bar for the maze, with the keys from the settings."""
    hints = [
        (" ".join(shortest_key(keys, name) for name in names), word) for word, names in _MAZE_HINTS.items()
    ]
    return [hints[0], *ANYWHERE[3].hints, *hints[1:]]


def drive_keys(keys: KeySettings) -> str:
    """The four keys that drive and turn."""
    return maze_hints(keys)[0][0]


def keys_line(hints: Sequence[Hint], width: int, first: Sequence[Hint] = ()) -> StyledLine:
    """As many hints as there is room for. Those in `first` are never left out for others."""
    room = width - 1 - sum(map(_columns, first))
    shown = []
    for hint in hints:
        room -= _columns(hint)
        if room < 0:
            break
        shown.append(hint)
    pieces: list[tuple[str, str]] = [(" ", "plain")]
    for key, word in (*shown, *first):
        pieces += [(key, "title"), (f" {word}  ", "dim")]
    return tuple(pieces)


def _columns(hint: Hint) -> int:
    return len(hint[0]) + len(hint[1]) + 3


def shortest_key(keys: KeySettings, name: str) -> str:
    """The shortest key of an action: a letter rather than an arrow."""
    names = keys_of(keys, name)
    if not names:
        return "-"
    key: str = min(names, key=lambda each: len(_SIGNS.get(each) or each))
    return _SIGNS.get(key) or (key if len(key) == 1 else format_key(key))
