"""Displays of text: their memory of two lines of 40, as the controller has it."""

from __future__ import annotations

from simmer_tui.sketch.text_display import DisplayChange, TextDisplay


def cell(line: int, column: int, letter: int) -> int:
    return DisplayChange.CELL << 24 | line << 16 | column << 8 | letter


def sized(columns: int, rows: int) -> TextDisplay:
    made = TextDisplay()
    made.change(DisplayChange.SIZE << 24 | columns << 8 | rows)
    return made


def test_text_is_seen_where_its_memory_is() -> None:
    small = sized(16, 2)
    for column, letter in enumerate(b"0123456789abcdefghij"):
        small.change(cell(1, column, letter))
    assert small.rows == (" " * 16, "0123456789abcdef")
    small.change(DisplayChange.SHIFT << 24 | 4)
    assert small.rows[1] == "456789abcdefghij"
    small.change(DisplayChange.SHIFT << 24 | 39)
    assert small.rows[1] == " 0123456789abcde"
    small.change(DisplayChange.ON << 24)
    assert small.rows == (" " * 16,) * 2
    small.change(DisplayChange.ON << 24 | 1)
    small.change(DisplayChange.CLEAR << 24)
    assert small.rows == (" " * 16,) * 2


def test_the_third_row_goes_on_where_the_first_one_ends() -> None:
    large = sized(20, 4)
    for column, letter in enumerate(b"first row is too long"):
        large.change(cell(0, column, letter))
    assert large.rows[0] == "first row is too lon"
    assert large.rows[2] == f"g{' ' * 19}"


def test_what_a_terminal_lacks_has_a_sign_and_no_number_is_too_large() -> None:
    made = sized(16, 2)
    for column, letter in enumerate((0, 7, 0xDF, 0x7E, 0xFF, 0x41)):
        made.change(cell(0, column, letter))
    assert made.rows[0].strip() == "##\u00b0>#A"
    for value in range(0, (DisplayChange.ON << 24) + 0xFFFFFF, 65_521):
        made.change(value)
    assert all(len(row) <= 40 for row in made.rows)
