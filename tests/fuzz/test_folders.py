"""Folders and logs of ours, broken, in the commands that go on with them: an answer or a message, never a
traceback, and never a run that takes for ever."""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import random
import shutil
import sys
from collections.abc import Generator, Iterable
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.cli import grade_command, trials_command
from simmer_tui.cli.log_options import configuration_of
from simmer_tui.cli.main import main
from simmer_tui.config.sets import bundled_sets
from simmer_tui.errors import SimmerError
from simmer_tui.live.takeover import TakeOver, moment_at
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.tui.recorded import RecordedRun
from tests.fuzz.conftest import run

WORDS = (b"null", b"[]", b"{}", b"1e999", b'"inf"', rb"\ud800", b"Infinity", b"true", b"-1", b"999999")
HITS = "from simmer_tui.client import Robot\nwith Robot() as robot: robot.drive('d1', 100)\n"


def interrupted(*given: Any, **named: Any) -> Generator[Any, None, None]:
    """A source of results in place of runs: a user presses Ctrl-C before the first."""
    raise KeyboardInterrupt
    yield


@pytest.fixture
def no_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """A broken plan is read but not run."""
    monkeypatch.setattr(grade_command, "here", lambda folder, jobs: interrupted)
    monkeypatch.setattr(trials_command, "run_locally", interrupted)


@pytest.fixture(scope="module")
def grading(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished grading of two teams that have failed, with logs."""
    base = tmp_path_factory.mktemp("grading")
    for name, program in (("idle", ""), ("hits", HITS)):
        (base / "teams" / name).mkdir(parents=True)
        (base / "teams" / name / "main.py").write_text(program)
        shutil.copytree(bundled_sets()["mission"], base / "teams" / name / "config")
    file = base / "teams.toml"
    decide = "[decide]\nrequire = 0.6\nmargin = 0.5\nrisk = 0.3\n"
    file.write_text(f'set = "mission"\nteams = "teams"\ncommand = "{sys.executable} main.py"\n{decide}')
    out = base / "out"
    assert main(["grade", str(file), "--out", str(out), "--isolation", "none", "--jobs", "1"]) == 1
    assert list(out.glob("runs/hits/*.jsonl.gz"))
    return out


@pytest.mark.usefixtures("no_runs")
@pytest.mark.parametrize(
    "name", ["grade.json", "results.jsonl", "runs/hits/0001.jsonl.gz", "teams/hits", "course"]
)
@pytest.mark.slow
def test_broken_gradings(name: str, grading: Path, tmp_path: Path, mutate: Any) -> None:
    for seed in range(40):
        folder = tmp_path / str(seed)
        shutil.copytree(grading, folder)
        chance = random.Random(seed)
        broken = folder / name
        if broken.is_dir():
            broken = chance.choice(sorted(path for path in broken.rglob("*.*") if path.suffix != ".py"))
        data = broken.read_bytes()
        if broken.suffix == ".gz" and chance.random() < 0.8:
            broken.write_bytes(gzip.compress(mutate(gzip.decompress(data), chance, WORDS)))
        else:
            broken.write_bytes(mutate(data, chance, WORDS))
        arguments = ["grade", "--out", str(folder), "--jobs", "1"]
        more = chance.choice((["--resume"], ["--regrade", "hits"], ["--resume", "--hide-names", "--json"]))
        run([*arguments, *more], seed)
        shutil.rmtree(folder)


@pytest.mark.usefixtures("no_runs")
@pytest.mark.parametrize("name", ["trials.json", "results.jsonl", "runs", "set"])
@pytest.mark.parametrize("cases", [3, pytest.param(100, marks=pytest.mark.slow)])
def test_broken_trials_to_go_on_with(
    cases: int, name: str, trials: Path, tmp_path: Path, mutate: Any
) -> None:
    for seed in range(cases):
        folder = tmp_path / str(seed)
        shutil.copytree(trials, folder)
        chance = random.Random(seed)
        broken = folder / name
        if broken.is_dir():
            broken = chance.choice(sorted(path for path in broken.rglob("*") if path.suffix != ".txt"))
        broken.write_bytes(mutate(broken.read_bytes(), chance, WORDS))
        run(
            ["trials", "--resume", "--out", str(folder), "--jobs", "1", *chance.choice(([], ["--json"]))],
            seed,
        )
        shutil.rmtree(folder)


def moments(log: RunLogIndex) -> Iterable[float]:
    """Times all over a log, its ends included."""
    return (share * log.duration for share in (0.0, 0.3, 0.5, 1.0))


@pytest.mark.parametrize("cases", [6, pytest.param(400, marks=pytest.mark.slow)])
def test_broken_logs_in_the_replay(cases: int, log: bytes, tmp_path: Path, mutate: Any) -> None:
    path = tmp_path / "run.jsonl"

    async def show(recorded: RecordedRun) -> None:
        for elapsed in moments(recorded.index):
            recorded.move_to(elapsed)
            await recorded.snapshot(0, True)
        for entry in (0, recorded.index.count // 2, recorded.index.count - 1):
            if recorded.index.count:
                recorded.stand_at(entry)
                await recorded.snapshot(0, False)
        assert recorded.marks is not None

    for seed in range(cases):
        path.write_bytes(mutate(log, random.Random(seed), WORDS))
        try:
            with RunLogIndex(path) as index, configuration_of(path):
                asyncio.run(show(RecordedRun(index)))
                for elapsed in moments(index):
                    with contextlib.suppress(SimmerError):
                        taken = TakeOver(path, moment_at(index, elapsed))
                        taken.check()
        except SimmerError:
            continue
        except Exception as error:
            error.add_note(f"seed {seed}")
            raise


@pytest.mark.parametrize("cases", [2, pytest.param(200, marks=pytest.mark.slow)])
def test_broken_logs_as_pictures_and_tables(cases: int, log: bytes, tmp_path: Path, mutate: Any) -> None:
    pytest.importorskip("PIL")
    path, out = tmp_path / "run.jsonl", tmp_path / "out"
    for seed in range(cases):
        path.write_bytes(mutate(log, random.Random(seed), WORDS))
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir()
        run(["export", str(path), "--gif", str(out / "run.gif")], seed)
        run(["report", str(path), "--csv", str(out / "run.csv"), "--svg", str(out / "run.svg")], seed)
