"""Every command that opens a file of ours, with broken ones: an answer or a message, never a traceback."""

from __future__ import annotations

import random
import shutil
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.cli.main import main
from tests.calibrate.conftest import drive
from tests.fuzz.conftest import run

WORDS = (b"null", b"[]", b"{}", b"1e999", b'"inf"', b'"-inf"', b'"nan"', rb"\ud800", b"Infinity", b"true")


@pytest.mark.parametrize("cases", [6, pytest.param(300, marks=pytest.mark.slow)])
def test_broken_logs(cases: int, log: bytes, tmp_path: Path, mutate: Any) -> None:
    path, out = tmp_path / "run.jsonl", tmp_path / "out"
    for seed in range(cases):
        path.write_bytes(mutate(log, random.Random(seed), WORDS))
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir()
        run(["report", str(path), "--html", str(out / "page.html")], seed)
        run(["report", str(path), "--json"], seed)
        run(["rerun", str(path)], seed)
        run(["export", str(path), "--svg", str(out / "picture.svg")], seed)


@pytest.mark.parametrize("seeds", [range(3), pytest.param(range(3, 120), marks=pytest.mark.slow)])
def test_broken_logs_of_robots(seeds: range, log: bytes, tmp_path: Path, mutate: Any) -> None:
    pytest.importorskip("scipy")
    path, out = tmp_path / "run.jsonl", tmp_path / "set"
    for seed in seeds:
        path.write_bytes(mutate(log, random.Random(seed), WORDS))
        shutil.rmtree(out, ignore_errors=True)
        run(["calibrate", str(path), "--out", str(out), "--anyway"], seed)


@pytest.mark.slow
def test_broken_calibrations(tmp_path: Path, mutate: Any) -> None:
    """Of the set that was learned, of the log that is compared with it, and of one robot in two logs."""
    pytest.importorskip("scipy")
    first, second = (drive(tmp_path, 3, 30, name).path for name in ("first.jsonl", "second.jsonl"))
    good, broken, log = tmp_path / "good", tmp_path / "broken", tmp_path / "log.jsonl"
    run(["calibrate", str(first), "--out", str(good), "--anyway"], 0)
    for seed in range(30):
        chance = random.Random(seed)
        shutil.rmtree(broken, ignore_errors=True)
        shutil.copytree(good, broken)
        file = broken / chance.choice(
            ["calibration.json"] * 3 + ["sensors.csv", "settings.toml", "drive.csv"]
        )
        file.write_bytes(mutate(file.read_bytes(), chance, WORDS))
        log.write_bytes(mutate(first.read_bytes(), chance, WORDS) if seed % 2 else first.read_bytes())
        run(["calibrate", str(log), "--check", str(broken)], seed)
        run(["calibrate", "--strength", *[str(broken)] * 2, *[str(good)] * 4], seed)
        if seed % 8 == 1:
            run(["calibrate", str(log), str(second), "--out", str(tmp_path / str(seed)), "--json"], seed)


@pytest.mark.parametrize("code", ["c1", "g1", "o1", "u1", "t1", "i1"])
@pytest.mark.parametrize("value", [b'"inf"', b'"-inf"', b"1e300"])
def test_infinite_readings_of_every_sensor(code: str, value: bytes, log: bytes, tmp_path: Path) -> None:
    pytest.importorskip("scipy")
    lines = log.splitlines(keepends=True)
    at = next(n for n, line in enumerate(lines) if b'"cmd":"%s"' % code.encode() in line)
    begin = lines[at].index(b'"reply":') + len(b'"reply":')
    end = min(lines[at].index(mark, begin) for mark in (b",", b"}") if mark in lines[at][begin:])
    lines[at] = lines[at][:begin] + value + lines[at][end:]
    path = tmp_path / "run.jsonl"
    path.write_bytes(b"".join(lines))
    run(["calibrate", str(path), "--out", str(tmp_path / "set"), "--anyway"], 0)


@pytest.mark.parametrize("name", ["trials.json", "results.jsonl"])
@pytest.mark.parametrize("cases", [6, pytest.param(300, marks=pytest.mark.slow)])
def test_broken_trials(cases: int, name: str, trials: Path, tmp_path: Path, mutate: Any) -> None:
    folder = tmp_path / "broken"
    shutil.copytree(trials, folder)
    good = (trials / name).read_bytes()
    for seed in range(cases):
        (folder / name).write_bytes(mutate(good, random.Random(seed), WORDS))
        run(["compare", str(folder), str(trials)], seed)


@pytest.mark.parametrize("name", [rb"a\u001b[31m\u202eb", rb"\ud800x", rb"</script>\u0000"])
def test_a_sets_name_steers_no_page(name: bytes, log: bytes, tmp_path: Path) -> None:
    path, page = tmp_path / "run.jsonl", tmp_path / "page.html"
    assert b'"configuration":"default"' in log
    path.write_bytes(log.replace(b'"configuration":"default"', b'"configuration":"%s"' % name, 1))
    assert main(["report", str(path), "--html", str(page)]) == 0
    assert main(["report", str(path), "--json"]) == 0
    text = page.read_text("utf-8")
    assert not any(mark in text for mark in ("\x1b", "\u202e", "\ud800", "\0", "</script>\\u0000"))
