"""The bar of keys."""

from __future__ import annotations

from simmer_tui.config.settings import KeySettings
from simmer_tui.tui.key_table import IN_CONSOLE, drive_keys, hints_of, keys_line, maze_hints
from simmer_tui.tui.line_panel import text_of


def test_the_maze_names_its_keys_as_they_are_set() -> None:
    hints = {word: key for key, word in maze_hints(KeySettings())}
    assert hints["drive"] == drive_keys(KeySettings()) == "w a s d"
    assert (hints["order"], hints["zoom"], hints["stop"]) == (":", "+ -", "space")
    assert drive_keys(KeySettings(forward="k", back="j")) == "k a j d"


def test_as_many_hints_as_there_is_room_for_and_always_the_page() -> None:
    line = text_of(keys_line(hints_of(IN_CONSOLE), 60, [("F2", "sensors")]))
    assert line.startswith(" Enter runs  Tab completes")
    assert line.rstrip().endswith("F2 sensors")
    # What helps most once something went wrong comes before what the console's heading says, too.
    assert ":why explains" in text_of(keys_line(hints_of(IN_CONSOLE), 80, [("F2", "sensors")]))
    for width in range(30, 140):
        assert len(text_of(keys_line(hints_of(IN_CONSOLE), width, [("F2", "sensors")])).rstrip()) <= width
