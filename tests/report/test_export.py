"""`simmer-tui export`: a run as a GIF and as a still picture."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from xml.etree import ElementTree

import pytest
from PIL import Image

from simmer_tui.cli.export_command import run_export
from simmer_tui.report.animation import shots
from simmer_tui.report.run_statistics import RunStatistics


@pytest.fixture
def log(start_run: Callable[..., Any]) -> Path:
    run = start_run()
    run.send("u1", "d1-6", "r1-90", "u1", "d1-40")
    run.believe(1.0)
    path: Path = run.path
    return path


def test_a_gif_shows_the_run_at_a_speed(log: Path, tmp_path: Path, capsys: Any) -> None:
    output = tmp_path / "run.gif"
    assert run_export([str(log), "--gif", str(output), "--width", "200", "--speed", "4"]) == 0
    assert "Wrote" in capsys.readouterr().out
    duration = 7.67 + 0.75  # 46 in at 6 in/s, and 90 deg at 120 deg/s
    with Image.open(output) as image:
        assert image.size[0] == 200
        frames = []
        for frame in range(image.n_frames):
            image.seek(frame)
            frames.append((image.convert("RGB").copy(), image.info["duration"]))
    assert len(frames) == pytest.approx(duration * 10 / 4 + 1, abs=2)
    assert [length for _, length in frames[:-1]] == [100] * (len(frames) - 1)
    assert frames[-1][1] == 2000
    assert len({image.tobytes() for image, _ in frames}) > len(frames) // 2, "it moves"


@pytest.mark.parametrize("seconds", [17.9, 18.1, 19.0, 20.0, 39.0, 40.0, 300.0])
def test_a_gif_lasts_at_most_20_seconds_with_the_stay_of_its_last_picture(seconds: float) -> None:
    run = SimpleNamespace(recording=SimpleNamespace(begin=3.0, end=3.0 + seconds))
    pictures = len(shots(cast(RunStatistics, run), None, None, None).times)
    assert 10 < (pictures - 1) * 0.1 + 2.0 <= 20.0


def test_a_part_of_the_run(log: Path, tmp_path: Path) -> None:
    output = tmp_path / "part.gif"
    options = ["--width", "160", "--from", "1", "--until", "1.5", "--speed", "1"]
    assert run_export([str(log), "--gif", str(output), *options]) == 0
    with Image.open(output) as image:
        assert image.n_frames == 6


def test_the_still_picture_has_the_way(log: Path, tmp_path: Path) -> None:
    output = tmp_path / "run.svg"
    assert run_export([str(log), "--svg", str(output), "--width", "1600"]) == 0
    root = ElementTree.parse(output).getroot()
    assert root.get("width") == "1600"
    words = {text.text for text in root.iter("{http://www.w3.org/2000/svg}text")}
    assert {"start", "end", "1", "contact, numbered in order"} <= words


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "name what to write"),
        (["--gif", "a.gif", "--from", "900"], "--from 900 is not in the run"),
        (["--gif", "a.gif", "--from", "2", "--until", "1"], "--until 1 is before --from 2"),
        (["--gif", "a.gif", "--speed", "0.01"], "take --speed 1 or more"),
        (["--gif", "same.gif", "--svg", "same.gif"], "is named twice"),
        (["--gif", "nowhere/a.gif"], "a.gif cannot be written"),
        (["--gif", "a.svg"], "--gif writes a GIF: name it a.gif, not a.svg"),
        (["--svg", "a.b.PNG"], "--svg writes an SVG: name it a.b.svg, not a.b.PNG"),
    ],
)
def test_what_cannot_be_done_is_said(
    log: Path, options: list[str], message: str, capsys: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_export([str(log), *options]) == 2
    assert message in capsys.readouterr().err


def test_without_pillow_it_says_what_to_install(
    log: Path, tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "PIL", None)
    assert run_export([str(log), "--gif", str(tmp_path / "a.gif")]) == 2
    assert "pip install 'simmer-tui[export] @ git+" in capsys.readouterr().err
