"""Text sent to a terminal without UTF-8."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.segment import Segment
from rich.style import Style
from textual.color import Color

from simmer_tui.tui.terminal_app import AsciiFilter, plain_text


@given(st.text(st.characters(exclude_categories=["C", "M", "Z"]), max_size=30))
def test_any_text_is_ascii_and_as_wide_as_before(text: str) -> None:
    assert plain_text(text).isascii()
    assert cell_len(plain_text(text)) == cell_len(text)


def test_frames_bars_and_arrows_are_replaced_by_what_resembles_them() -> None:
    segments = AsciiFilter().apply([Segment("╭─│█↑…🔎", Style(bold=True))], Color(0, 0, 0))
    assert segments == [Segment("+-|#^~??", Style(bold=True))]
