"""Orders and keys: each does something, and no name hides another."""

from __future__ import annotations

from collections import Counter

import pytest

from simmer_tui.config.settings import KeySettings
from simmer_tui.live.operating import orders
from simmer_tui.live.operating.orders import CONSOLE_COMMANDS, Local, OrderSpec, read_console_command
from simmer_tui.live.operating.switches import SWITCHES
from simmer_tui.run.events import Action
from simmer_tui.sim import SimulationSpec
from simmer_tui.tui import key_table
from simmer_tui.tui.key_table import MAZE_ACTIONS, is_order_too
from simmer_tui.tui.screen_orders import OrderingShell

WORDS = {"on|off": "on", "N|off": "2", "FILE.svg": "a.svg", "[T]": "", "move": "move"}
METHOD = "order_"


def lines_of(order: OrderSpec) -> list[str]:
    """The order with words, and without any where they may be left out."""
    words = [WORDS.get(word, "1") for word in order.words.strip("[]").split()]
    return [f":{order.name} {' '.join(words)}", *([] if order.needs_words else [f":{order.name}"])]


@pytest.mark.parametrize("order", CONSOLE_COMMANDS.values(), ids=CONSOLE_COMMANDS)
def test_an_order_does_something(order: OrderSpec, course_spec: SimulationSpec) -> None:
    switches = {switch.name for switch in SWITCHES}
    for line in lines_of(order):
        done = read_console_command(line, course_spec)
        if isinstance(done, Action):
            assert done.name is order.action
        else:
            assert isinstance(done, Local)
            has_method = callable(getattr(OrderingShell, METHOD + done.name, None))
            assert [has_method, done.name in switches].count(True) == 1, line


def test_a_method_has_an_order() -> None:
    methods = {name.removeprefix(METHOD) for name in vars(OrderingShell) if name.startswith(METHOD)}
    assert methods <= set(CONSOLE_COMMANDS)


def test_names_of_orders_differ() -> None:
    names = Counter(order.name for order in orders._ORDERS)
    assert names.most_common(1)[0][1] == 1


def test_a_switch_with_a_key_has_its_setting_and_its_label() -> None:
    for switch in SWITCHES:
        assert bool(switch.key) == bool(switch.label)
        assert not switch.key or hasattr(KeySettings(), switch.key)


def test_the_palette_leaves_out_a_key_only_for_an_order_that_does_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    left_out = {name for name in MAZE_ACTIONS if is_order_too(name)}
    switches = {switch.key for switch in SWITCHES if switch.key == switch.name}
    assert left_out == {"stop", "reset", "pause", "step", "help"} | switches
    # `:block X Y` puts the block somewhere.
    mark = {"block": ("app.switch('block_mark')", "Last place of the block")}
    monkeypatch.setattr(key_table, "MAZE_ACTIONS", mark)
    assert not is_order_too("block")
