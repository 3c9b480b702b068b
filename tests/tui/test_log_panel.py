"""The log panel alone: bounded, filtered, and where it stands."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest
from msgspec.structs import replace
from textual.app import App, ComposeResult
from textual.pilot import Pilot

from simmer_tui.live.snapshot import EVENTS, LogEntry
from simmer_tui.run.events import Action, ActionDone, ActionName, Notice, NoticeKind
from simmer_tui.sim.command import parse_command
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import CommandResult, Reading, Status
from simmer_tui.sim.sensors import Ultrasonic, UltrasonicSpec
from simmer_tui.tui.event_text import event_words
from simmer_tui.tui.log_panel import LogPanel


class _Host(App[None]):
    def compose(self) -> ComposeResult:
        yield LogPanel()


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
    return [LogEntry(n, 0.0, Notice(kind, f"notice {n}{words}"), first=n) for n in range(first, last + 1)]


def reset(number: int, source: str) -> LogEntry:
    action = Action(ActionName.RESET, source=source)
    return LogEntry(number, 0.0, ActionDone(1.0, action, "done", Pose(0, 0, 0)), first=number)


def folded(first: int, last: int) -> LogEntry:
    """Readings first to last, the latest three kept."""
    sensor = UltrasonicSpec(kind=Ultrasonic, number=1, code="u1")
    kept = []
    for number in range(max(last - 2, first), last + 1):
        reading = Reading(sensor, float(number), 0.0)
        pose = Pose(0.0, 0.0, 0.0)
        outcome = CommandResult(
            number, 3.0, parse_command("u1"), Status.READING, float(number), pose, pose, reading=reading
        )
        kept.append(LogEntry(number, 0.0, outcome, 3.0))
    return replace(
        kept[-1],
        first=first,
        readings=last - first + 1,
        kept=tuple(kept),
        missing=last - first + 1 - len(kept),
    )


def rows(log: LogPanel) -> list[str]:
    """The rows below the heading."""
    return [log.render_line(y).text.strip() for y in range(1, log.size.height)]


def head(log: LogPanel) -> str:
    return log.render_line(0).text


def test_an_empty_list_says_what_is_ready() -> None:
    async def act(log: LogPanel, pilot: Pilot[None]) -> None:
        log.show_before_events("ready: default, seed 7")
        assert log.render_line(1).text.strip() == "ready: default, seed 7"
        log.add(notices(1, 1), total=1)
        assert "ready" not in log.render_line(1).text + log.render_line(2).text

    play(act)


def test_it_follows_the_newest_until_scrolled_away() -> None:
    async def act(log: LogPanel, pilot: Pilot[None]) -> None:
        log.add(notices(1, 30), total=30)
        assert rows(log)[-1].endswith("notice 30")
        await pilot.pause()
        log.add(notices(31, 31), total=31)
        assert rows(log)[-1].endswith("notice 31")
        assert head(log).startswith(" events ──")
        assert "31   / filters" in head(log)
        log.scroll_to(y=3, animate=False, force=True)
        log.add(notices(32, 40), total=40)
        await pilot.pause()
        assert rows(log)[0].endswith("notice 4")
        log.focus()
        await pilot.press("end")
        await pilot.pause()
        await until(pilot, lambda: log.scroll_y >= log.max_scroll_y)
        log.add(notices(41, 41), total=41)
        assert rows(log)[-1].endswith("notice 41")

    play(act)


def test_it_is_bounded_and_keeps_its_place_as_the_oldest_go() -> None:
    async def act(log: LogPanel, pilot: Pilot[None]) -> None:
        log.add(notices(1, EVENTS))
        log.scroll_to(y=500, animate=False, force=True)
        log.add(notices(EVENTS + 1, EVENTS + 100), total=EVENTS + 100)
        await pilot.pause()
        assert rows(log)[0].endswith("notice 501")
        assert log.text.splitlines()[0].endswith("notice 101")
        log.add(notices(EVENTS + 101, 3 * EVENTS), total=3 * EVENTS)
        assert log.text.splitlines()[0].endswith(f"notice {2 * EVENTS + 1}")
        assert len(log.text.splitlines()) == len(log.entries) == EVENTS

    play(act)


def test_readings_fold_grow_in_place_and_unfold() -> None:
    async def act(log: LogPanel, pilot: Pilot[None]) -> None:
        log.add([*notices(1, 1), folded(2, 6)], total=2)
        assert rows(log)[1] == "00:03.0          5 readings  +"
        log.add([folded(2, 9), *notices(10, 10)], total=3)
        assert [row.split(maxsplit=1)[1].strip() for row in rows(log)[:3]] == [
            "robot   notice 1",
            "8 readings  +",
            "robot   notice 10",
        ]
        log.focus()
        await pilot.press("enter")
        assert rows(log)[1].endswith("8 readings  -")
        assert rows(log)[2].endswith("5 before these are counted only")
        assert rows(log)[3].split()[-2:] == ["7.00", "in"]
        await pilot.press("enter")
        assert rows(log)[1].endswith("8 readings  +")
        assert "  00:03.0  u1      9.00 in\n" in log.text, "what is copied or saved holds all there is"

    play(act)


def test_the_cursor_picks_what_to_unfold() -> None:
    async def act(log: LogPanel, pilot: Pilot[None]) -> None:
        log.add([folded(1, 3), *notices(4, 4, " and so on" * 20), folded(5, 6)], total=3)
        log.focus()
        await pilot.press("up", "up", "enter")
        assert rows(log)[1].startswith(">00:00.0")
        assert "and so on" in rows(log)[2], "a line that is too long goes on below"
        await pilot.press("up", "enter")
        assert rows(log)[1].endswith("u1      1.00 in")

    play(act)


def test_what_is_typed_after_a_slash_filters() -> None:
    async def act(log: LogPanel, pilot: Pilot[None]) -> None:
        log.add([*notices(1, 2), reset(3, "keys"), folded(4, 5), reset(6, "console")], total=5)
        log.focus()
        await pilot.press("slash", *"keys", "enter")
        assert [row for row in rows(log) if row] == ["00:00.0  reset   done  by keys"]
        assert "/keys   Esc shows all" in head(log)
        await pilot.press("slash", *["backspace"] * 4, *"u1")
        assert [row for row in rows(log) if row] == ["00:03.0          2 readings  +"], "in what is folded"
        log.add(notices(7, 7), total=6)
        assert len([row for row in rows(log) if row]) == 1
        await pilot.press("escape")
        assert len([row for row in rows(log) if row]) == 6

    play(act)


def test_a_seed_is_shown_whole() -> None:
    done = ActionDone(0.0, Action(ActionName.SEED, (310310069.0,)), "done", Pose(0, 0, 0))
    assert event_words(LogEntry(1, 0.0, done, first=1)).subject == "seed 310310069"


@pytest.mark.slow
def test_another_size_keeps_the_place() -> None:
    async def act(log: LogPanel, pilot: Pilot[None]) -> None:
        log.add(notices(1, 40, " and what there is to say of it at some length"))
        log.scroll_to(y=log.max_scroll_y // 2, animate=False, force=True)
        await pilot.pause()
        top = rows(log)[0][:30]
        for size in ((44, 10), (100, 10), (60, 10)):
            await pilot.resize_terminal(*size)
            await until(pilot, lambda size=size: log.app.size == size)
            await pilot.pause()
            assert rows(log)[0][:30] == top
        await pilot.resize_terminal(100, 38)
        await until(pilot, lambda: log.size.height >= 30)
        assert rows(log)[-1], "no room is left empty"

    play(act)


def test_entries_that_come_before_it_is_on_the_screen_are_kept() -> None:
    log = LogPanel()
    log.add(notices(1, 3))
    assert len(log.text.splitlines()) == 3
