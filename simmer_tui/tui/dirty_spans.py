"""A correction to Textual: send only the part of a line that changed.

What: when part of a widget is dirty, `ChopsUpdate.render_segments` sends the line from the
widget's left edge to the right end of the dirty span. Here it starts at the left end of the span.
Why: a robot that moves at the right of a maze makes Textual resend most of the line; over a slow
SSH connection half of the bytes of a frame are such repetition.
When it can go: once Textual crops both ends itself (Textualize/textual#5625).

It replaces one method of a private class, so it is used only with the versions of Textual it was
written against and does nothing with any other. A span may begin in the middle of a wide character
only if a widget asks for it; the maze view draws none.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import textual
from rich.console import Console
from rich.control import Control
from textual._compositor import ChopsUpdate

_KNOWN_VERSION = "8.2."


def is_known_version(version: str) -> bool:
    return version.startswith(_KNOWN_VERSION)


@contextmanager
def cropped_dirty_spans() -> Iterator[bool]:
    """While this lasts, dirty spans are cropped on both sides. Gives whether they are."""
    if not is_known_version(textual.__version__):
        yield False
        return
    original = ChopsUpdate.render_segments
    ChopsUpdate.render_segments = _render_cropped  # type: ignore[method-assign]
    try:
        yield True
    finally:
        ChopsUpdate.render_segments = original  # type: ignore[method-assign]


def spans_are_cropped() -> bool:
    return ChopsUpdate.render_segments is _render_cropped


def _render_cropped(self: ChopsUpdate, console: Console) -> str:
    """The terminal sequences of the dirty spans, and of nothing beside them."""
    sequences: list[str] = []
    for y, start, stop in self.spans:
        for end, (left, strip) in zip(self.chop_ends[y], self.chops[y].items(), strict=False):
            first, last = max(left, start), min(end, stop)
            if strip is None or first >= last:
                continue
            sequences.append(Control.move_to(first, y).segment.text)
            sequences.append(strip.crop(first - left, last - left).render(console))
    return "".join(sequences)
