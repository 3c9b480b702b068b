"""`simmer-tui atlas`: files, refusals and notes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from simmer_tui.cli.main import main


@pytest.mark.parametrize("name", ["a.npz", "a.MAT", "a.csv", "a.h"])
def test_it_writes_the_file_of_an_ending_and_says_what_is_in_it(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / name
    assert main(["atlas", str(out), "--step", "6", "--headings", "4", "--sensors", "u1,u3"]) == 0
    said, errors = capsys.readouterr()
    assert said.splitlines() == [
        f"Wrote {out}, {out.stat().st_size / 1e6:.2f} MB: u1, u3",
        "512 poses: 8 x 16 places, 4 headings; the robot fits at 384",
    ]
    assert errors == "", "no bar where there is no terminal"


def test_settings_are_options_of_it_and_its_format_may_be_named(tmp_path: Path) -> None:
    out = tmp_path / "table.bin"
    small = ["atlas", str(out), "--format", "npz", "--step", "12", "--headings", "1", "--sensors", "u5"]
    assert main([*small, "--block-center", "40,42"]) == 0
    with np.load(out) as atlas:
        assert atlas["ranges"][0, 2, 0, 0] == 5.5
    first = out.read_bytes()
    assert main([*small, "--blocksize", "0"]) == 0
    assert out.read_bytes() != first
    assert main([*small, "--block-center", "40,42"]) == 0
    assert out.read_bytes() == first


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["atlas.txt"], "atlas.txt does not end in .npz, .mat, .csv, .h: add --format"),
        (["no/atlas.npz"], "no/atlas.npz is in a folder that does not exist: name a file to write to"),
        (["folder.npz"], "folder.npz is a folder: name a file to write to"),
        (
            ["a.npz", "--step", "0.5", "--headings", "120"],
            "the grid has 2,211,840 poses, more than 2,000,000",
        ),
        (["a.npz", "--step", "5"], "cells of 5 in do not fill a cell of the maze"),
        (["a.npz", "--sensors", "u1,"], "no sensor has the code ''"),
        (["a.npz", "--sensors", "g1"], "the sensor g1 (angle turned) counts motion"),
        (["a.npz", "--config", "nowhere"], "nowhere: there is no such folder"),
    ],
)
def test_it_refuses_before_it_computes(
    arguments: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.npz").mkdir()
    assert main(["atlas", *arguments]) == 2
    output, errors = capsys.readouterr()
    assert output == ""
    assert said in errors
    assert [path.name for path in tmp_path.iterdir()] == ["folder.npz"]


def test_a_large_grid_is_computed_if_that_is_wanted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("simmer_tui.cli.atlas_command.MANY_POSES", 100)
    monkeypatch.chdir(tmp_path)
    large = ["atlas", "a.npz", "--step", "12", "--headings", "4", "--sensors", "u1"]
    assert main(large) == 2
    assert "the grid has 128 poses, more than 100: take a larger --step, fewer --headings, or add --yes" in (
        capsys.readouterr().err
    )
    assert main([*large, "--yes"]) == 0


@pytest.mark.slow
def test_tables_too_large_for_an_arduino_are_written_with_a_note(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    small = ["--step", "2", "--sensors", "u1,u2,u3", "--headings"]
    assert main(["atlas", "fits.h", *small, "72"]) == 0
    assert "note" not in capsys.readouterr().err
    assert main(["atlas", "large.h", *small, "75"]) == 0
    assert capsys.readouterr().err == (
        "note: its tables take 264 kB; an Arduino Mega has 256 kB: take a larger --step, fewer --headings or "
        "fewer --sensors\n"
    )
    assert (tmp_path / "large.h").is_file()


@pytest.mark.parametrize(
    ("option", "value", "allowed"),
    [
        *(("--step", value, "a number above 0 and at most 12") for value in ("0", "-1", "24", "nan", "x")),
        *(("--headings", value, "a whole number from 1 to 360") for value in ("0", "361", "1.5")),
    ],
)
def test_step_and_headings_follow_a_rule(
    option: str, value: str, allowed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["atlas", "a.npz", option, value])
    assert f'argument {option}: must be {allowed}, not "{value}"' in capsys.readouterr().err
