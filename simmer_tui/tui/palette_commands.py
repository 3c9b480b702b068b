"""The app's orders and keys in the command palette."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Iterator
from typing import Any

from textual.command import DiscoveryHit, Hit, Hits, Provider
from textual.content import Content

from simmer_tui.links.port_list import list_ports
from simmer_tui.tui.console_commands import CONSOLE_COMMANDS
from simmer_tui.tui.maze_pane import KEYS
from simmer_tui.tui.sizes import PAGES


class CommandProvider(Provider):
    """Every console order and every key's action by name. Orders that need words are begun in the
    console."""

    def _choices(self) -> Iterator[tuple[str, str, str]]:
        """(name, help, action) of each choice."""
        for order in CONSOLE_COMMANDS.values():
            action = f"begin_order(':{order.name} ')" if order.needs_words else f"order(':{order.name}')"
            yield order.usage, order.help, action
        names = {order.name for order in CONSOLE_COMMANDS.values()}
        for name, (action, label) in KEYS.items():
            if name not in names:
                yield label, "as its key does, see help", action
        for port in list_ports():
            text = f"drive the robot there: {port.description}" + (f" ({port.mark})" if port.mark else "")
            yield f":robot {port.device}", text, f"order({f':robot {port.device}'!r})"
        for number, page in enumerate(PAGES, 1):
            yield f"Page {page}", "on small screens", f"page({number})"

    async def discover(self) -> Hits:
        for name, text, action in self._choices():
            yield DiscoveryHit(Content(name), self._runner(action), text=name, help=text)

    async def search(self, query: str) -> Hits:
        matcher = self.matcher(query)
        for name, text, action in self._choices():
            score = matcher.match(f"{name} {text}")
            if score > 0:
                yield Hit(score, Content(name), self._runner(action), text=name, help=text)

    def _runner(self, action: str) -> Callable[[], Coroutine[Any, Any, None]]:
        async def run() -> None:
            await self.app.run_action(action)

        return run
