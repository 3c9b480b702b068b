"""The app's orders and keys in the command palette."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from textual.command import DiscoveryHit, Hit, Hits, Provider
from textual.content import Content
from textual.types import IgnoreReturnCallbackType

from simmer_tui.links.port_list import list_ports
from simmer_tui.tui.console_commands import CONSOLE_COMMANDS
from simmer_tui.tui.maze_pane import KEYS, MazePane
from simmer_tui.tui.sizes import PAGES

_AHEAD = 1000.0
"""More than any score of a match."""


@dataclass(frozen=True, slots=True)
class _Choice:
    """One line of the palette; `ahead` raises it above others that match as well."""

    name: str
    help: str
    run: IgnoreReturnCallbackType
    ahead: float = 0.0


class CommandProvider(Provider):
    """Every console order and every key's action by name, orders first, then what Textual offers. Orders
    that need words are begun in the console."""

    def _choices(self) -> Iterator[_Choice]:
        for order in CONSOLE_COMMANDS.values():
            line = f":{order.name}"
            action = f"app.begin_order({f'{line} '!r})" if order.needs_words else f"app.order({line!r})"
            yield _Choice(order.usage, order.help, self._runner(action), _AHEAD)
        for port in list_ports():
            line = f":robot {port.device}"
            text = f"drive the robot there: {port.description}" + (f" ({port.mark})" if port.mark else "")
            yield _Choice(line, text, self._runner(f"app.order({line!r})"), _AHEAD)
        for name, (action, label) in KEYS.items():
            if name not in CONSOLE_COMMANDS:
                yield _Choice(label, "as its key does, see help", self._runner(action))
        for number, page in enumerate(PAGES, 1):
            yield _Choice(f"Page {page}", "on small screens", self._runner(f"app.page({number})"))
        for each in self.app.get_system_commands(self.screen):
            yield _Choice(each.title, each.help, each.callback)

    async def discover(self) -> Hits:
        for each in self._choices():
            yield DiscoveryHit(Content(each.name), each.run, text=each.name, help=each.help)

    async def search(self, query: str) -> Hits:
        matcher = self.matcher(query)
        for each in self._choices():
            score = max(matcher.match(each.name), matcher.match(f"{each.name} {each.help}"))
            if score > 0:
                yield Hit(score + each.ahead, Content(each.name), each.run, text=each.name, help=each.help)

    def _runner(self, action: str) -> IgnoreReturnCallbackType:
        app = self.app
        maze = app.screen_stack[0].query_one(MazePane)

        async def run() -> None:
            await app.run_action(action, maze)

        return run
