"""The pictures of README.md are made from a run."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from simmer_tui.sketch.compiler import find_compiler

SCRIPT = Path(__file__).parents[1] / "scripts" / "animated_picture.py"
STILLS = {
    "small": "F2",
    "medium": "mission",
    "large": "radar",
    "light": "events",
    "ascii": "(OO)",
    "wander": "u1",
    "heat": "likely",
    "solve": "mission",
    "replay": "timeline",
}
SVG = "{http://www.w3.org/2000/svg}"


@pytest.mark.slow
def test_a_run_becomes_two_pictures_that_move(tmp_path: Path) -> None:
    subprocess.run([sys.executable, SCRIPT, "--pace", "20", "--size", "80x24", tmp_path], check=True)
    for theme in ("dark", "light"):
        picture = ElementTree.parse(tmp_path / f"mission-{theme}.svg").getroot()
        said = " ".join("".join(text.itertext()) for text in picture.iter(f"{SVG}text"))
        assert "loading" in said
        assert "MISSION SUCCEEDED" in said
        times = [each.get("begin", "") for each in picture.iter(f"{SVG}set")]
        assert len(times) > 20  # as many as the machine made in these seconds
        assert all(time.startswith("t.begin+") for time in times)


@pytest.mark.slow
def test_stills_show_the_screen_at_every_size_and_the_replay(tmp_path: Path) -> None:
    subprocess.run([sys.executable, SCRIPT, "--still", tmp_path], check=True)
    board = {} if find_compiler() is None else {"board": "LED 13"}
    for name, shown in (STILLS | board).items():
        picture = ElementTree.parse(tmp_path / f"{name}.svg").getroot()
        said = " ".join("".join(text.itertext()) for text in picture.iter(f"{SVG}text"))
        assert shown in said, name
        assert not list(picture.iter(f"{SVG}animate")), name
    page = (SCRIPT.parents[1] / "docs" / "screen.md").read_text(encoding="utf-8")
    assert all(f"(pictures/{name}.svg)" in page for name in STILLS)
