"""Sequences for the terminal's clipboard, and the note about them."""

from __future__ import annotations

import re
from base64 import b64decode

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simmer_tui.tui.terminal_app import clipboard_sequences, osc52, sent_note


@given(st.text(alphabet=st.characters(exclude_categories=("Cs",))))
def test_the_sequence_holds_the_text_and_nothing_that_steers(text: str) -> None:
    found = re.fullmatch("\x1b]52;c;([A-Za-z0-9+/=]*)\a", osc52(text))
    assert found is not None
    assert b64decode(found[1]).decode() == text


def test_through_tmux_it_is_sent_wrapped_too() -> None:
    assert clipboard_sequences("ab", {}) == []
    (wrapped,) = clipboard_sequences("ab", {"TMUX": "/tmp/tmux,1,0"})
    assert wrapped == "\x1bPtmux;\x1b\x1b]52;c;YWI=\a\x1b\\"


@pytest.mark.parametrize(
    ("text", "environment", "note"),
    [
        ("a", {}, "1 character sent to the terminal's clipboard; it must allow OSC 52"),
        ("ab\u20ac", {"TMUX": "x"}, "3 characters sent to the terminal's clipboard; tmux: set-clipboard on"),
        (
            "x" * 60_000,
            {"TMUX": "x"},
            "60000 characters sent to the terminal's clipboard; many take only 56245",
        ),
    ],
)
def test_it_is_said_what_was_sent_and_how_to_allow_it(
    text: str, environment: dict[str, str], note: str
) -> None:
    assert sent_note(text, environment) == note
    assert len(note) <= 78  # the console's line at 80 columns
