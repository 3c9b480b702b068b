"""Text for the clipboard of the terminal, by OSC 52, and what to say of it."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping

_COMMON_LIMIT = 74_994
"""Bytes of base64 that xterm takes, and many others after it."""


ALLOWING = (
    ("tmux", "set -g set-clipboard on, or set -g allow-passthrough on"),
    ("terminal", "allow OSC 52 (access to the clipboard) in its settings"),
)
"""How to have what is copied arrive."""


def osc52(text: str) -> str:
    """The sequence that puts text into the terminal's clipboard."""
    return f"\x1b]52;c;{b64encode(text.encode('utf-8', 'replace')).decode()}\a"


def clipboard_sequences(text: str, environment: Mapping[str, str]) -> list[str]:
    """What to send beside the plain sequence.

    tmux takes the plain one itself with `set-clipboard on`. Else it drops it, but hands on to the
    terminal what is wrapped so (DCS tmux; ... ST, each ESC in it doubled), if `allow-passthrough` is on.
    """
    if not environment.get("TMUX"):
        return []
    doubled = osc52(text).replace("\x1b", "\x1b\x1b")
    return [f"\x1bPtmux;{doubled}\x1b\\"]


def sent_note(text: str, environment: Mapping[str, str]) -> str:
    """What was sent, and what has to be allowed where it may be refused, in one short line; `ALLOWING`
    says how."""
    count = len(text)
    said = f"{count} character{'s' * (count != 1)} sent to the terminal's clipboard"
    if len(text.encode("utf-8", "replace")) * 4 / 3 > _COMMON_LIMIT:
        return f"{said}; many take only {_COMMON_LIMIT * 3 // 4}"
    return f"{said}; {'tmux: set-clipboard on' if environment.get('TMUX') else 'it must allow OSC 52'}"
