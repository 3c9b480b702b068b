"""The log panel alone: bounded, filtered, and where it stands."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from textual.app import App, ComposeResult
from textual.pilot import Pilot

from simmer_tui.events import Action, ActionDone, ActionName, Notice, NoticeKind
from simmer_tui.sim.records import Pose
from simmer_tui.snapshot import EVENTS, LogEntry
from simmer_tui.tui.log_panel import LogPanel


class _Host(App[None]):
    def compose(self) -> ComposeResult:
        yield LogPanel(id="log")


def play(act: Callable[[LogPanel, Pilot[None]], Awaitable[None]], size: tuple[int, int] = (60, 10)) -> None:
    async def run() -> None:
        app = _Host()
        async with app.run_test(size=size) as pilot:
            await pilot.pause()
            await act(app.query_one(LogPanel), pilot)

    asyncio.run(run())


async def until(pilot: Pilot[None], condition: Callable[[], object]) -> None:
    for _ in range(1000):
        if condition():
            return
        await pilot.pause()
    raise AssertionError("it never came")


def notices(first: int, last: int, words: str = "") -> list[LogEntry]:
    kind = NoticeKind.CONNECTED
    return [LogEntry(n, 0.0, Notice(kind, f"notice {n}{words}")) for n in range(first, last + 1)]


def reset(number: int, source: str) -> LogEntry:
    action = Action(ActionName.RESET, source=source)
    return LogEntry(number, 0.0, ActionDone(1.0, action, "done", Pose(0, 0, 0)))


def rows(log: LogPanel) -> list[str]:
    return [log.render_line(y).text.strip() for y in range(log.size.height)]


def test_it_follows_the_newest_until_scrolled_away() -> None:
    async def act(log: LogPanel, pilot: Pilot[None]) -> None:
        log.add(notices(1, 30))
        assert rows(log)[-1].endswith("notice 30")
        await pilot.pause()
        log.add(notices(31, 31))
        assert rows(log)[-1].endswith("notice 31")
        log.scroll_to(y=3, animate=False, force=True)
        log.add(notices(32, 40))
        await pilot.pause()
        assert rows(log)[0].endswith("notice 4")
        log.focus()
        await pilot.press("end")
        await pilot.pause()
        await until(pilot, lambda: log.scroll_y >= log.max_scroll_y)
        log.add(notices(41, 41))
        assert rows(log)[-1].endswith("notice 41")

    play(act)


def test_it_is_bounded_and_keeps_its_place_as_the_oldest_go() -> None:
    async def act(log: LogPanel, pilot: Pilot[None]) -> None:
        log.add(notices(1, EVENTS))
        log.scroll_to(y=500, animate=False, force=True)
        log.add(notices(EVENTS + 1, EVENTS + 100))
        await pilot.pause()
        assert log.virtual_size.height == EVENTS
        assert rows(log)[0].endswith("notice 501")
        assert log.text.splitlines()[0].endswith("notice 101")
        log.add(notices(EVENTS + 101, 3 * EVENTS))
        assert log.text.splitlines()[0].endswith(f"notice {2 * EVENTS + 1}")
        assert len(log.text.splitlines()) == EVENTS

    play(act)


def test_the_filter_goes_from_source_to_source_and_back_to_all() -> None:
    async def act(log: LogPanel, pilot: Pilot[None]) -> None:
        log.add([*notices(1, 2), reset(3, "keys"), reset(4, "console")])
        log.focus()
        shown = []
        for _ in range(4):
            await pilot.press("f")
            shown.append((log.source, len(log.text.splitlines()), str(log.border_title)))
        assert shown == [
            ("robot", 2, "Log: robot"),
            ("keys", 1, "Log: keys"),
            ("console", 1, "Log: console"),
            ("", 4, "Log"),
        ]
        log.show_only("keys")
        log.add([reset(5, "console"), reset(6, "keys")])
        assert len(log.text.splitlines()) == 2

    play(act)


def test_another_width_wraps_anew_and_keeps_the_place() -> None:
    async def act(log: LogPanel, pilot: Pilot[None]) -> None:
        log.add(notices(1, 40, " and what there is to say of it at some length"))
        log.scroll_to(y=log.max_scroll_y // 2, animate=False, force=True)
        await pilot.pause()
        top = log._numbers[log.scroll_offset.y]
        for size in ((44, 10), (100, 10), (60, 10)):
            await pilot.resize_terminal(*size)
            await until(pilot, lambda size=size: log.app.size == size)
            await pilot.pause()
            assert log._numbers[log.scroll_offset.y] == top
        await pilot.resize_terminal(100, 38)
        await until(pilot, lambda: log.size.height >= 30)
        assert rows(log)[-1], "no room is left empty"
        await pilot.resize_terminal(60, 10)
        await until(pilot, lambda: log.size.height <= 10)
        assert log.scroll_offset.y < log.max_scroll_y, "it was not the user who scrolled to the end"

    play(act)


def test_entries_that_come_before_it_is_on_the_screen_are_kept() -> None:
    log = LogPanel()
    log.add(notices(1, 3))
    assert len(log.text.splitlines()) == 3
