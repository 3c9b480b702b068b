"""LEDs and displays of boards for the log: looked at every tenth of a second, whenever it is asked for."""

from __future__ import annotations

import random
from itertools import pairwise

from simmer_tui.run.events import DisplayChanged
from simmer_tui.sketch.board_process import BoardRecord, Told
from simmer_tui.sketch.display_changes import LOOK_PERIOD, DisplayChanges
from simmer_tui.sketch.text_display import DisplayChange

_MILLI = 1_000_000
SIZE = DisplayChange.SIZE << 24 | 4 << 8 | 1


def cell(column: int, character: str) -> int:
    return DisplayChange.CELL << 24 | column << 8 | ord(character)


def shows(*texts: tuple[int, int]) -> list[BoardRecord]:
    """Records of display 0 by milliseconds and operation."""
    return [BoardRecord(at * _MILLI, Told.TEXT, 0, 0, value) for at, value in texts]


def led(at: int, value: int) -> BoardRecord:
    return BoardRecord(at * _MILLI, Told.LEVEL, 13, 0, value)


def told(
    records: list[BoardRecord], looks: list[int], end: int = 1000
) -> list[tuple[int, bool, tuple[tuple[str, ...], ...]]]:
    """All changes of a board that is asked at some milliseconds, in milliseconds. As in a run, it may be
    ahead of the world."""
    changes = DisplayChanges("rover", 13, "13")
    found: list[tuple[int, DisplayChanged]] = []
    left = list(records)
    for look in (*looks, end):
        while left and left[0].time <= (look + 5) * _MILLI:
            changes.add(left.pop(0))
        found += changes.due(look * _MILLI)
    assert all(at == round(each.time * 1e9) for at, each in found)
    return [(at // _MILLI, each.led, each.displays) for at, each in found]


def test_what_changes_between_two_looks_is_told_at_the_second() -> None:
    records = [*shows((10, SIZE), (20, cell(0, "a")), (130, cell(1, "b"))), led(140, 1)]
    assert told(records, []) == [
        (0, False, ()),
        (100, False, (("a   ",),)),
        (200, True, (("ab  ",),)),
    ]


def test_an_led_that_is_as_before_at_a_look_is_not_told() -> None:
    assert told([led(10, 1), led(20, 0), led(310, 1), led(500, 0)], []) == [
        *((0, False, ()), (400, True, ()), (500, False, ()))
    ]


def test_the_times_at_which_it_is_asked_change_nothing() -> None:
    random.seed(5)
    times = sorted(random.sample(range(1, 3000), 300))
    records = [led(at, random.randrange(2)) for at in times]
    every = told(records, list(range(0, 3000, 5)), 3200)
    assert len(every) > 10
    for _ in range(20):
        assert told(records, sorted(random.sample(range(3000), 7)), 3200) == every


def test_there_are_ten_changes_a_second_at_most() -> None:
    records = [led(at, at & 1) for at in range(1, 5000)]
    times = [at for at, _, _ in told(records, [], 6000)]
    assert all(after - before >= LOOK_PERIOD // _MILLI for before, after in pairwise(times))


def test_a_reset_clears_it_and_the_end_waits_for_no_look() -> None:
    changes = DisplayChanges("rover", 13, "13")
    for record in (*shows((10, SIZE), (20, cell(0, "a"))), led(30, 1)):
        changes.add(record)
    changes.due(100 * _MILLI)
    changes.restart(150 * _MILLI)
    ((at, change),) = changes.due(160 * _MILLI, at_end=True)
    assert (at, change.led, change.displays) == (160 * _MILLI, False, ())
    assert changes.due(400 * _MILLI, at_end=True) == []


def test_other_pins_are_no_led() -> None:
    changes = DisplayChanges("rover", 13, "13")
    changes.add(BoardRecord(5, Told.LEVEL, 12, 0, 1))
    changes.due(0)
    assert changes.due(LOOK_PERIOD) == []
