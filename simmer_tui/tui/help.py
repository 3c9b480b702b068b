"""The help and the command palette: all keys and orders, made from the tables that the app uses."""

import re
from collections.abc import Iterator, Sequence
from functools import partial
from textwrap import wrap
from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult, SystemCommand
from textual.command import DiscoveryHit, Hit, Hits, Provider
from textual.containers import VerticalScroll
from textual.content import Content
from textual.events import Key, Resize
from textual.keys import format_key
from textual.screen import ModalScreen
from textual.types import IgnoreReturnCallbackType
from textual.widgets import Static

from simmer_tui.config.describe_code import describe_code
from simmer_tui.config.keys import DRIVING, keys_of
from simmer_tui.config.robot_drawing import movement_commands, sensor_drawing
from simmer_tui.config.settings import KeySettings, all_settings
from simmer_tui.errors import printable
from simmer_tui.links.port_list import list_ports
from simmer_tui.live.operating.orders import CONSOLE_COMMANDS
from simmer_tui.sim.command import WORD, cut
from simmer_tui.sim.specs import SimulationSpec
from simmer_tui.tui import key_table
from simmer_tui.tui.help_page import HelpPage, sensor_words
from simmer_tui.tui.key_table import KeyGroup, MazePane
from simmer_tui.tui.maze.painter import Painter
from simmer_tui.tui.sizes import PAGES
from simmer_tui.tui.terminal_app import ALLOWING
from simmer_tui.tui.textual_internals import as_plain

# Textual would show these keys as arrows, which not every terminal has.
_WORDS = ("up", "down", "left", "right")
# More than any score of a match, so that orders come first in the palette.
_AHEAD = 1000.0

_Rows = Sequence[tuple[str, str]]


def help_text(keys: KeySettings, spec: SimulationSpec) -> str:
    """All of the help as plain text."""
    settings = [
        (shown, f"{text}{'  (fine with Shift)' if name in DRIVING else ''}")
        for name, shown, text in key_settings(keys)
    ]
    lines = _section("KEYS while the maze has the focus (settings.toml, [keys])", settings)
    lines += _section("KEYS anywhere", _key_rows(key_table.ANYWHERE))
    lines += _section("MOUSE", _key_rows(key_table.WITH_THE_MOUSE))
    lines += _section("COPIED TEXT arrives if this is set", ALLOWING)
    lines += _section("KEYS while the events have the focus", _key_rows(key_table.IN_LOG))
    orders = [(order.usage, order.help) for order in CONSOLE_COMMANDS.values()]
    lines += _section("ORDERS in the console", orders, 24)
    lines += _section("COMMANDS, in the console as from a program", _commands(spec), 0)
    return "\n".join(lines)


def key_settings(keys: KeySettings) -> list[tuple[str, str, str]]:
    """Settings of keys: name, keys, meaning."""
    found = []
    for item in all_settings():
        table, _, name = item.name.partition(".")
        if table == "keys":
            found.append((name, _shown(keys_of(keys, name)) or "(none)", item.help))
    return found


def replay_help(name: str) -> str:
    """The help of a replay of the log `name`."""
    return "\n".join(_section(f"REPLAY of {name}", _key_rows(key_table.IN_REPLAY))[1:])


def _section(title: str, rows: _Rows, width: int = 18) -> list[str]:
    return ["", title, *(f"  {left:<{width}}{right}" for left, right in rows)]


def _key_rows(groups: Sequence[KeyGroup]) -> _Rows:
    return [(group.shown, group.help) for group in groups if group.shown]


def _commands(spec: SimulationSpec) -> _Rows:
    """Commands of a robot and their meanings."""
    rows = [(f"{command}   ", meaning) for command, meaning in movement_commands(spec)]
    used = [sensor for sensor in spec.sensors if sensor.enabled]
    return rows + [(f"{sensor.code}     ", f"read {sensor.id}: {sensor_words(sensor)}") for sensor in used]


def _shown(keys: list[str]) -> str:
    return ", ".join(key if key in _WORDS else format_key(key) for key in keys)


def help_screen(keys: KeySettings, spec: SimulationSpec, painter: Painter, code: str = "") -> "HelpScreen":
    """The help as a screen, or the description of one code."""
    if not code:
        return OverviewScreen(HelpPage(key_settings(keys), spec, painter), help_text(keys, spec))
    lines = describe_code(spec, code)
    for sensor in spec.sensors:
        if code in (sensor.code, sensor.id) and sensor.kind.has("x"):
            lines = [*lines, "", *sensor_drawing(spec.robot, sensor)]
    return HelpScreen("\n".join(lines), f"Help: {cut(code, WORD)}", classes="one-code")


def folded(text: str, width: int) -> str:
    """A text of lines of at most `width` characters. The rest of a row stands below its second column."""
    lines: list[str] = []
    for line in map(printable, text.split("\n")):
        if len(line) > width:
            columns = _COLUMNS.match(line)
            indent = " " * min(columns.end() if columns else _INDENT, width // 2)
            lines += wrap(line, width, subsequent_indent=indent, break_on_hyphens=False)
        else:
            lines.append(line)
    return "\n".join(lines)


_COLUMNS = re.compile(r" *\S.*?\s{2,}(?=\S)")
"""The first column of a row, with the blanks behind it."""
_INDENT = 4
# Frame and padding on both sides, the scroll bar (app.tcss), and one to spare.
PAGE_FRAME = 6
"""Columns of a page that its text cannot use."""


class HelpScreen(ModalScreen[None]):
    """Shows a text until dismissed."""

    FRAME: ClassVar[str] = "help"
    """Name of the frame in app.tcss."""
    WIDEST: ClassVar[int] = 88
    """Its greatest width there."""

    def __init__(
        self, text: str, title: str = "Help", note: str = "escape closes", *, classes: str | None = None
    ) -> None:
        super().__init__(classes=classes)
        self.text, self._title, self._note = text, title, note

    def compose(self) -> ComposeResult:
        with VerticalScroll(id=self.FRAME) as frame:
            frame.border_title, frame.border_subtitle = map(as_plain, (self._title, self._note))
            yield Static(id=f"{self.FRAME}-text")

    def on_mount(self) -> None:
        # None, if the app has begun to end since the page was opened.
        for frame in self.query(f"#{self.FRAME}"):
            frame.focus()

    def on_resize(self, event: Resize) -> None:
        self._show(event.size.width)

    def _show(self, width: int) -> None:
        """Show the text in a screen so wide."""
        for shown in self.query(f"#{self.FRAME}-text").results(Static):
            shown.update(Text(folded(self.text, max(min(width, self.WIDEST) - PAGE_FRAME, 1)), no_wrap=True))

    async def take_key(self, event: Key) -> bool:
        """Close the page at once: of keys that come together, the next one belongs to the screen below."""
        if event.key not in _CLOSING:
            return False
        self.dismiss()
        return True


class OverviewScreen(HelpScreen):
    """Shows the first screen of the help, and below it all of it in words."""

    WIDEST = 200

    def __init__(self, page: HelpPage, text: str) -> None:
        note = "escape closes, PgDn: all in full, :help u2: one code"
        super().__init__(text, "Help", note, classes="overview")
        self._page = page

    def _show(self, width: int) -> None:
        room = max(min(width, self.WIDEST) - PAGE_FRAME, 1)
        shown = self._page.text(room).append("\n").append(folded(self.text, room))
        shown.no_wrap = True
        for widget in self.query(f"#{self.FRAME}-text").results(Static):
            widget.update(shown)


class ReportScreen(HelpScreen):
    """Shows a long text about this run. Text typed meanwhile goes to the console, as before."""

    FRAME = "report"
    WIDEST = 10_000

    def replace(self, text: str) -> None:
        """Show another text, unless the page is closed already."""
        self.text = text
        self._show(self.app.size.width)

    async def take_key(self, event: Key) -> bool:
        """Close the page as every page, or give what is typed to the console."""
        if await super().take_key(event):
            return True
        if not event.is_printable or event.character is None:
            return False
        self.dismiss()
        await self.app.run_action(f"app.begin_order({event.character!r})")
        return True


_CLOSING = ("escape", "q", "question_mark", "enter")
"""Keys that close a page. A report gives all other characters to the console."""


# -- the palette -----------------------------------------------------------------------------------


class CommandProvider(Provider):
    """Every console order and every key's action by name, orders first, then Textual's own. Orders that need
    words are put into the console."""

    def _choices(self) -> Iterator[SystemCommand]:
        for order in CONSOLE_COMMANDS.values():
            line = f":{order.name}"
            action = f"app.begin_order({f'{line} '!r})" if order.needs_words else f"app.order({line!r})"
            yield SystemCommand(order.usage, order.help, self._runner(action))
        for port in list_ports():
            line = f":robot {port.device}"
            text = f"drive the robot there: {port.description}" + (f" ({port.mark})" if port.mark else "")
            yield SystemCommand(line, text, self._runner(f"app.order({line!r})"))
        for name, (action, label) in key_table.MAZE_ACTIONS.items():
            if not key_table.is_order_too(name):
                yield SystemCommand(label, "as its key does, see help", self._runner(action))
        for number, page in enumerate(PAGES, 1):
            yield SystemCommand(f"Page {page}", "on small screens", self._runner(f"app.page({number})"))
        yield from self.app.get_system_commands(self.screen)

    async def discover(self) -> Hits:
        for title, meaning, run, _ in self._choices():
            yield DiscoveryHit(Content(title), run, text=title, help=as_plain(meaning))

    async def search(self, query: str) -> Hits:
        matcher = self.matcher(query)
        for title, meaning, run, _ in self._choices():
            score = max(matcher.match(title), matcher.match(f"{title} {meaning}"))
            if score > 0:
                ahead = _AHEAD if title.startswith(":") else 0.0
                yield Hit(score + ahead, Content(title), run, text=title, help=as_plain(meaning))

    def _runner(self, action: str) -> IgnoreReturnCallbackType:
        return partial(self.app.run_action, action, self.app.screen_stack[0].query_one(MazePane))
