"""Every command that opens a file of ours, with broken ones: an answer or a message, never a traceback."""

from __future__ import annotations

import random
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.cli.main import main
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Simulator

WORDS = (b"null", b"[]", b"{}", b"1e999", b'"inf"', b'"-inf"', b'"nan"', rb"\ud800", b"Infinity", b"true")
PROGRAM = "from simmer_tui.client import Robot\nwith Robot() as robot: robot.drive('d1', 1)\n"
CODES = (0, 1, 2, 3, 4)
"""Exit codes of the command line that are no crash (`ExitCode`)."""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A run of a few movements, every sensor read between them."""
    path = tmp_path_factory.mktemp("log") / "run.jsonl"
    configuration = load(bundled_folder())
    simulator = Simulator(configuration.simulation, 3)
    with RunLog(path, configuration, simulator) as run:
        for drive in ("r1-30", "d1-2", "r1--60", "d1-3", "a1-2"):
            for code in ("u1", "u2", "u3", "i1", "c1", "o1", "g1", "t1", "zz"):
                run(simulator.execute(code))
            run(simulator.execute(drive))
    return path.read_bytes()


@pytest.fixture(scope="module")
def trials(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of finished trials."""
    base = tmp_path_factory.mktemp("trials")
    (base / "robot.py").write_text(PROGRAM)
    folder = base / "done"
    run = ("--run", f'"{sys.executable}" "{base / "robot.py"}"')
    assert main(["trials", "--runs", "2", "--seed", "1", "--port", "0", "--out", str(folder), *run]) == 0
    return folder


def run(arguments: list[str], seed: int) -> None:
    """Anything but a `SimmerError`, which becomes a message, is a crash."""
    try:
        assert main(arguments) in CODES
    except Exception as error:
        error.add_note(f"seed {seed}: {arguments[0]}")
        raise


@pytest.mark.parametrize("cases", [12, pytest.param(300, marks=pytest.mark.slow)])
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
@pytest.mark.parametrize("cases", [15, pytest.param(300, marks=pytest.mark.slow)])
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
