"""The writer of what has changed, as a terminal takes it."""

from __future__ import annotations

import re

import pyte
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.color import ColorSystem
from rich.segment import Segment
from rich.style import Style

from simmer_tui.tui.delta_writer import DeltaWriter, change_of, pen_of

WIDTH, HEIGHT = 12, 3
STYLES = [
    None,
    Style(color="#ff0000", bgcolor="#001122"),
    Style(color="#00ff00", bgcolor="#001122"),
    Style(color="#00ff00", bgcolor="#001122", bold=True),
    Style(bold=True, dim=True),
    Style(dim=True),
    Style(reverse=True, bold=True),
    Style(underline=True, bgcolor="#445566"),
    Style(underline=True, underline2=True),
    Style(strike=True, overline=True, italic=True),
]
TRUE = ColorSystem.TRUECOLOR
SEQUENCE = re.compile(r"\x1b\[[0-9;]*[mGH]")
# Those that pyte knows; the others have no effect on its screen.
ATTRIBUTES = ("bold", "italics", "underscore", "strikethrough", "reverse")

texts = st.text(alphabet="ab ─⠿世", min_size=1, max_size=6)
pieces = st.tuples(
    st.integers(0, HEIGHT - 1), st.integers(0, WIDTH - 1), texts, st.sampled_from(STYLES), st.booleans()
)


class Glass:
    """A terminal, and a writer in front of it."""

    def __init__(self) -> None:
        self.screen = pyte.Screen(WIDTH, HEIGHT)
        self.stream = pyte.Stream(self.screen)
        self.writer = DeltaWriter()

    def show(self, row: int, column: int, *segments: Segment, colors: ColorSystem = TRUE) -> str:
        """Sequences of one update that shows some segments."""
        self.writer.begin(WIDTH, HEIGHT, colors)
        self.writer.write(row, column, segments)
        sent = self.writer.end()
        self.stream.feed(sent)
        return sent

    def text(self, row: int = 0) -> str:
        return self.screen.display[row]


def cells_of(screen: pyte.Screen) -> list[tuple[object, ...]]:
    """Cells as they look: the colour of a blank's letters does not show."""
    found: list[tuple[object, ...]] = []
    for row in range(HEIGHT):
        for column in range(WIDTH):
            cell = screen.buffer[row][column]
            plain = cell.data == " " and not (cell.underscore or cell.strikethrough or cell.reverse)
            look = (cell.bg,) if plain else (cell.fg, cell.bg, *(getattr(cell, name) for name in ATTRIBUTES))
            found.append((cell.data, *look))
    return found


@settings(max_examples=25, deadline=None)
@given(st.lists(st.lists(pieces, max_size=4), max_size=6))
def test_a_terminal_shows_the_same_as_when_all_is_sent(
    frames: list[list[tuple[int, int, str, Style | None, bool]]],
) -> None:
    glass, plain = Glass(), pyte.Screen(WIDTH, HEIGHT)
    stream = pyte.Stream(plain)
    for frame in frames:
        glass.writer.begin(WIDTH, HEIGHT, TRUE)
        for row, column, text, style, linked in frame:
            if "世" in text and column + 2 * len(text) > WIDTH:
                continue  # half a wide character has no one way to be shown
            shown = text[: WIDTH - column]
            link = "https://example.org" if linked else None
            glass.writer.write(row, column, [Segment(shown, _with(style, link))])
            sent = shown if style is None else style.render(shown)
            stream.feed(f"\x1b[{row + 1};{column + 1}H{sent}\x1b[0m")
        glass.stream.feed(glass.writer.end())
        assert cells_of(glass.screen) == cells_of(plain)
        assert glass.screen.cursor.attrs == plain.default_char, "no style is left on"


@settings(max_examples=25, deadline=None)
@given(
    st.lists(
        st.dictionaries(st.tuples(st.integers(0, HEIGHT - 1), st.integers(0, 5)), st.sampled_from("ab─⠿█"))
    )
)
def test_a_terminal_with_wide_boxes_shows_the_rest_in_its_place(
    frames: list[dict[tuple[int, int], str]],
) -> None:
    """With East Asian settings "─" and "█" take two cells, so each cell has a free one beside it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pyte.screens, "wcwidth", lambda each: 2 if each in "─█" else 1)
        glass = Glass()
        for frame in frames:
            glass.writer.begin(WIDTH, HEIGHT, TRUE)
            for (row, half), text in frame.items():
                glass.writer.write(row, 2 * half, [Segment(text, STYLES[1 + "ab─⠿█".index(text) % 2])])
            glass.stream.feed(glass.writer.end())
        last = {place: text for frame in frames for place, text in frame.items()}
        assert all(glass.screen.buffer[row][2 * half].data == text for (row, half), text in last.items())


def test_a_cell_below_takes_few_bytes() -> None:
    """So the outline of the robot and the rays of sensors take few."""
    glass, style = Glass(), STYLES[1]
    glass.writer.begin(WIDTH, HEIGHT, TRUE)
    for row in range(HEIGHT):
        glass.writer.write(row, 5, [Segment("⠿", style)])
    sent = glass.writer.end()
    assert sent.count("H") == 1
    assert sent.count("\x1b[B\b⠿") == HEIGHT - 1


def _with(style: Style | None, link: str | None) -> Style | None:
    return style if link is None or style is None else style + Style(link=link)


def test_what_stays_is_not_sent_again() -> None:
    glass, style = Glass(), STYLES[1]
    assert "hello world" in glass.show(0, 0, Segment("hello world", style))
    assert glass.show(0, 0, Segment("hello world", style)) == ""
    assert glass.show(0, 0, Segment("hello wOrld", style)).count("O") == 1
    far = glass.show(0, 0, Segment("Hello wOrlD", style))
    assert "ello" not in far, "more than four cells that stay are jumped over"
    near = glass.show(0, 0, Segment("HeLLo wOrlD", style))
    assert "\x1b[1;3H" in near
    ends = glass.show(0, 0, Segment("HELLO wOrlD", style))
    assert "ELLO" in ends, "few of them are sent again"
    assert glass.text().rstrip() == "HELLO wOrlD"


def test_of_a_style_only_what_changes_is_sent() -> None:
    red, green, bold = (pen_of(style, TRUE) for style in STYLES[1:4])
    assert change_of(red, green) == "38;5;46", "one of the 256 goes by its number"
    assert change_of(green, bold) == "1"
    assert change_of(bold, green) == "22"
    assert change_of(bold, pen_of(None, TRUE)) == "0"
    assert change_of(pen_of(STYLES[4], TRUE), pen_of(STYLES[5], TRUE)) in ("22;2", "0;2")
    glass = Glass()
    sent = glass.show(0, 0, Segment("a", STYLES[1]), Segment(" ", STYLES[2]), Segment("b", STYLES[1]))
    assert sent.count("\x1b[") == 3, "one place, one style and its end: a blank has no letters to colour"


def test_the_colors_are_those_that_the_terminal_has() -> None:
    assert "38;5;196" in Glass().show(0, 0, Segment("a", STYLES[1]), colors=ColorSystem.EIGHT_BIT)
    assert "38;2;255;1;0" in Glass().show(0, 0, Segment("a", Style(color="#ff0100")))
    assert "38;5;196" in Glass().show(0, 0, Segment("a", Style(color="#ff0000")))
    assert "38;5;9" not in Glass().show(0, 0, Segment("a", Style(color="#ff5555"))), "a user's own colour"


@pytest.mark.parametrize("is_full", [True, False])
def test_all_is_sent_to_a_screen_that_is_not_known(is_full: bool) -> None:
    glass = Glass()
    glass.show(0, 0, Segment("abc"))
    glass.writer.begin(WIDTH if is_full else WIDTH + 1, HEIGHT, TRUE, is_full=is_full)
    glass.writer.write(0, 0, [Segment("abc")])
    assert "abc" in glass.writer.end()


def test_of_a_line_some_columns_may_be_written() -> None:
    glass = Glass()
    for text, shown in (("abcdefgh", "efg"), ("a世cdefgh", "def")):
        glass.writer.begin(WIDTH, HEIGHT, TRUE, is_full=True)
        glass.writer.write(1, 2, [Segment(text[:3], STYLES[1]), Segment(text[3:], STYLES[2])], 6, 9)
        glass.stream.feed(glass.writer.end())
        assert glass.text(1).strip() == shown


@pytest.mark.parametrize("end", ["", "世", "ü"])
@pytest.mark.parametrize("control", ["\0", "\x0c", "\x1b", "\x1b[2J", "\x7f", "\x9b2J"])
def test_control_characters_in_a_text_never_reach_the_terminal(control: str, end: str) -> None:
    glass = Glass()
    sent = glass.show(0, 0, Segment(control), Segment(f"ab{control}cd{end}"))
    assert SEQUENCE.sub("", sent).isprintable()
    kept = "".join(each for each in control if each.isprintable())
    assert glass.text(0).replace(" ", "") == f"{kept}ab{kept}cd{end}"


@pytest.mark.parametrize("text", ["abcdefghijklmnopqrs", "abcdefghijklmno世"])
def test_what_is_wider_than_the_screen_is_cut(text: str) -> None:
    glass = Glass()
    glass.show(0, 2, Segment(text))
    assert glass.text(0) == f"  {text}"[:WIDTH]
    assert not glass.text(1).strip()


def test_scattered_cells_of_one_style_are_sent_together() -> None:
    red, green = Style(color="#ff0001", bgcolor="#001122"), Style(color="#00ff01", bgcolor="#001122")
    glass = Glass()
    glass.writer.begin(WIDTH, HEIGHT, TRUE)
    for row in range(HEIGHT):
        glass.writer.write(row, 0, [Segment("a", red), Segment("    b    ", green), Segment("a", red)])
    sent = glass.writer.end()
    glass.stream.feed(sent)
    assert len(re.findall(r"38;2;", sent)) == 2
    assert [glass.text(row).rstrip() for row in range(HEIGHT)] == ["a    b    a"] * HEIGHT
    assert [glass.screen.buffer[1][column].fg for column in (0, 5, 10)] == ["ff0001", "00ff01", "ff0001"]


def test_what_an_update_did_not_send_is_sent_with_the_next() -> None:
    glass = Glass()
    glass.show(0, 0, Segment("aaaa"))
    glass.writer.begin(WIDTH, HEIGHT, TRUE)
    glass.writer.write(0, 0, [Segment("bbbb")])
    assert "bbbb" in glass.show(0, 0, Segment("bbbb")), "the update before has failed"
