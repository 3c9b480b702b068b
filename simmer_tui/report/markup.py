"""Text from outside within a page or a picture."""

from __future__ import annotations

import html

from simmer_tui.sim.command import printable


def escape(text: str) -> str:
    """Text as HTML and XML show it: no markup, and no character that they cannot hold."""
    return html.escape(printable(text))
