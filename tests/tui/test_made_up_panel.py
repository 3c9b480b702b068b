"""A panel costs a function and a line in `PANELS`: a made-up one is drawn, beside those of a mission too."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from simmer_tui.tui import panes
from simmer_tui.tui.panes import PanelKind

Fly = Callable[..., Any]


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"mission": True}], ids=["plain", "mission"])
def test_a_made_up_panel_is_drawn(fly: Fly, monkeypatch: pytest.MonkeyPatch, options: dict[str, Any]) -> None:
    battery = PanelKind("battery", 2, lambda snapshot, room: [(("battery full", "value"),)])
    monkeypatch.setattr(panes, "PANELS", (*panes.PANELS, battery))

    async def scenario(cockpit: Any) -> None:
        await cockpit.until(lambda: cockpit.app.query_one("#battery").region.area)

    fly(scenario, size=(160, 50), **options)
