"""Boards on the screen: their panel, their pins, and the orders about them."""

from __future__ import annotations

import dataclasses

import pytest

from simmer_tui.config.loader import load
from simmer_tui.config.sets import MISSION_SET, bundled_sets
from simmer_tui.errors import ConsoleCommandError
from simmer_tui.live.operating.orders import Local, read_console_command
from simmer_tui.live.snapshot import Recorder, Snapshot
from simmer_tui.robot.engine import Engine
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import checkpoint_of
from simmer_tui.sim import Simulator
from simmer_tui.sketch.board_view import BoardView, PinView, PortView
from simmer_tui.tui.answers import board_steps, pins_answer
from simmer_tui.tui.line_panel import text_of
from simmer_tui.tui.readouts import Room, board_lines

PINS = (PinView("5", "output, 71%"), PinView("A0", "input"))
ROVER = BoardView("rover", 12.5, 0.25, True, "d=12.5", PINS, ports=(PortView("USB", "debug 7"),))
DEAD = BoardView("sensor", 3.0, 1.0, False, "", failed="board sensor died at sensor.ino:7 after 3 s")


def snapshot() -> Snapshot:
    simulator = Simulator(load(bundled_sets()[MISSION_SET]).simulation)
    shown = Recorder(Engine(simulator), Reducer(checkpoint_of(simulator))).snapshot()
    return dataclasses.replace(shown, boards=(ROVER, DEAD))


def test_the_panel_has_clock_busy_share_led_and_last_line() -> None:
    lines = [text_of(line) for line in board_lines(snapshot(), Room(60, 5, False))]
    assert "boards" in lines[0]
    assert lines[1:] == [
        "rover  12.50 s  busy  25%  LED 13 on",
        "  last line  d=12.5",
        "  USB  debug 7",
        "sensor  3.00 s  busy 100%  LED 13 off",
        "  board sensor died at sensor.ino:7 after 3 s",
    ]


def test_the_panel_and_the_pins_have_the_text_on_displays() -> None:
    shows = BoardView(
        "rover", 1.0, 0.0, False, "", PINS, displays=(("first           ", "  second        "),)
    )
    shown = dataclasses.replace(snapshot(), boards=(shows,))
    lines = [text_of(line) for line in board_lines(shown, Room(60, 5, False))]
    assert lines[2:] == ["  |first           |", "  |  second        |"]
    assert [text_of(line) for line in pins_answer(shows).lines][2:] == [
        *("     |first           |", "     |  second        |")
    ]


def test_the_name_of_a_board_is_cut_before_the_state_of_its_led() -> None:
    made = BoardView("esp32_bluetooth_rover", 12.5, 0.25, True, "", led_pin="2")
    shown = dataclasses.replace(snapshot(), boards=(made,))
    (_, line) = board_lines(shown, Room(40, 5, False))
    assert text_of(line) == "esp32_blu…  12.50 s  busy  25%  LED 2 on"


@pytest.mark.parametrize("width", [20, 36, 80])
def test_the_panel_fits_its_width(width: int) -> None:
    assert all(len(text_of(line)) <= width for line in board_lines(snapshot(), Room(width, 5, False)))


def test_pins_are_listed_with_their_use() -> None:
    card = pins_answer(ROVER)
    assert [text_of(line).split(maxsplit=1) for line in card.lines] == [
        *(["5", "output, 71%"], ["A0", "input"], ["USB", "debug 7"])
    ]


@pytest.mark.parametrize(
    ("typed", "text"),
    [
        (":send F", "F"),
        (':send "F"', "F"),
        (r":send g 20\n", "g 20\n"),
        (":send F  10", "F  10"),
        (r":send a\\n", "a\\n"),
    ],
)
def test_text_is_sent_as_typed(typed: str, text: str) -> None:
    spec = load(bundled_sets()[MISSION_SET]).simulation
    assert read_console_command(typed, spec) == Local("send", text)


@pytest.mark.parametrize("has_line", [True, False])
def test_the_first_steps_with_boards_are_orders_that_boards_take(has_line: bool) -> None:
    """Nobody else drives: neither a typed command, nor a key, nor the sample program."""
    spec = load(bundled_sets()[MISSION_SET]).simulation
    card = board_steps(has_line=has_line)
    for lines in (card.lines, card.brief):
        shown = [text_of(line).strip() for line in lines]
        text = "\n".join(shown)
        assert (":send" in text) == ("--sketch DIR" in text) == has_line
        assert ":pins" in text
        assert ":help" in text
        assert not any(each in text for each in ("d1-3", "F5", "w a s d", "wander"))
        assert max(map(len, shown)) <= (78 if lines is card.brief else 40)
    if has_line:
        typed = text_of(card.lines[0]).removeprefix("1 ").partition(" sends")[0]
        assert read_console_command(typed, spec) == Local("send", "F\n")


def test_nothing_to_send_is_refused() -> None:
    with pytest.raises(ConsoleCommandError, match="takes a text"):
        read_console_command(":send", load(bundled_sets()[MISSION_SET]).simulation)
