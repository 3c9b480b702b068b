"""Lines of text with roles: wrapped, made harmless, and sent only where they changed."""

from __future__ import annotations

import asyncio

from hypothesis import given
from hypothesis import strategies as st
from rich.style import Style
from textual.app import App, ComposeResult
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from simmer_tui.errors import printable
from simmer_tui.tui.line_panel import (
    ROLES,
    LinePanel,
    fault_line,
    shortened,
    strip_of,
    text_of,
    wrapped_lines,
)

words = st.lists(st.text("abcdefgh", min_size=1, max_size=12), min_size=1, max_size=20)
STYLES = {role: Style() for role in ROLES}


@given(st.lists(words, min_size=1, max_size=4), st.integers(20, 60))
def test_wrapping_keeps_every_word_and_the_width(pieces: list[list[str]], width: int) -> None:
    line = tuple((" ".join(piece), "plain") for piece in pieces)
    rows = wrapped_lines(line, width, 4)
    assert all(len(text_of(row)) <= width for row in rows)
    joined = "".join(text_of(row) for row in rows).replace(" ", "")
    assert joined == text_of(line).replace(" ", "")


def test_a_line_that_fits_or_a_panel_too_narrow_to_indent_is_left_alone() -> None:
    line = (("one two", "plain"),)
    assert wrapped_lines(line, 7, 4) == [line]
    assert wrapped_lines(line, 3, 4) == [line]


@given(st.text())
def test_no_text_reaches_the_terminal_with_control_characters(text: str) -> None:
    assert printable(text).isprintable()
    line = ((text, "plain"),)
    assert text_of(line).isprintable()
    assert strip_of(line, STYLES, 30).text.isprintable()
    assert strip_of(line, STYLES, 30).cell_length == 30


def test_a_fault_says_what_it_was() -> None:
    assert text_of(fault_line(ValueError("bad\x1b"))) == "cannot be shown: ValueError: bad\\x1b"


class _Host(App[None]):
    CSS = "LinePanel { height: auto; width: 20; }"

    def compose(self) -> ComposeResult:
        yield LinePanel(id="panel")


def test_only_changed_lines_are_refreshed() -> None:
    async def play() -> None:
        app = _Host()
        async with app.run_test() as pilot:
            panel = app.query_one(LinePanel)
            panel.show([(("one", "plain"),), (("two", "good"),)])
            await pilot.pause()
            assert panel.size.height == 2
            asked: list[object] = []
            refresh = panel.refresh

            def watch(*regions: object, **options: bool) -> LinePanel:
                asked.extend(regions)
                return refresh(*regions, **options)  # type: ignore[arg-type]

            panel.refresh = watch  # type: ignore[method-assign, assignment]
            panel.show([(("one", "plain"),), (("three", "good"),)])
            assert asked == [(0, 1, 20, 1)]
            panel.show([(("one", "plain"),), (("three", "good"),)])
            assert len(asked) == 1
            assert panel.lines == ["one", "three"]
            assert panel.render_line(1).text == "three".ljust(20)
            assert panel.render_line(5).text == " " * 20

    asyncio.run(play())


def test_a_line_that_is_cut_says_so() -> None:
    line = (("twelve", "value"), (" signs", "dim"), ("  ", "plain"))
    assert text_of(shortened(line, 12)) == "twelve signs"
    assert text_of(shortened(line, 11)) == "twelve sig…"
    assert text_of(shortened(line, 1)) == "…"
    assert text_of(shortened(line, 0)) == ""


class _Lines(LinePanel):
    """A panel whose lines go the way that Textual has for all widgets."""

    render_lines = Widget.render_lines


class _TwoWays(App[None]):
    CSS = "LinePanel { height: 3; width: 20; } .padded { padding: 0 2; }"

    def compose(self) -> ComposeResult:
        for classes in ("", "padded"):
            yield LinePanel(classes=classes)
            yield _Lines(classes=classes)


def test_lines_reach_the_screen_as_textual_would_have_drawn_them() -> None:
    async def play() -> None:
        app = _TwoWays()
        async with app.run_test() as pilot:
            direct, usual, padded, usual_padded = app.query(LinePanel)
            for crop in (Region(0, 0, 20, 3), Region(4, 1, 7, 2)):
                for panel in app.query(LinePanel):
                    panel.show([(("one", "danger"), (" two", "plain")), (("a line that is longer", "good"),)])
                await pilot.pause()
                for one, other in ((direct, usual), (padded, usual_padded)):
                    shown = [_cells(strip) for strip in one.render_lines(crop)]
                    assert shown == [_cells(strip) for strip in other.render_lines(crop)]
                    assert len(shown) == crop.height
                    assert {len(line) for line in shown} == {crop.width}

    asyncio.run(play())


def _cells(strip: Strip) -> list[tuple[str, object, object, object]]:
    """Characters of a line with what a terminal shows of their styles."""
    return [
        (each, style and style.color, style and style.bgcolor, style and style.bold)
        for text, style, _ in strip
        for each in text
    ]
