"""The summary of a set names the ports that programs connect to."""

from __future__ import annotations

import pytest

from simmer_tui.config.loader import load
from simmer_tui.config.set_summary import summarize
from simmer_tui.config.sets import bundled_sets
from simmer_tui.config.settings_file import Override

BINARY = "Binary: commands on port 9000, replies on port 9001, float64 big-endian."
PACKETS = "Packets: requests on port 61200, replies on port 61201; without brackets answered in float64."


@pytest.mark.parametrize(
    ("name", "listeners", "expected"),
    [
        ("default", None, [BINARY]),
        ("simmer-python", None, [PACKETS]),
        ("default", "binary,packets", [BINARY, PACKETS]),
    ],
)
def test_summary_names_the_ports_of_each_dialect_that_is_listened_to(
    name: str, listeners: str | None, expected: list[str]
) -> None:
    overrides = {"server.listeners": Override("--listeners", listeners)} if listeners else {}
    lines = summarize(load(bundled_sets()[name], overrides)).splitlines()
    assert "Server: 127.0.0.1, beliefs on port 9002." in lines
    assert [line for line in lines if line.startswith(("Binary:", "Packets:"))] == expected
