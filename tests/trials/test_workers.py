"""Workers of this machine and of a Dask cluster."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from simmer_tui.cli.trials_command import run_trials
from simmer_tui.config.loader import find_set, load
from simmer_tui.errors import TrialsError
from simmer_tui.trials.folder import TrialFolder
from simmer_tui.trials.local import run_locally
from simmer_tui.trials.record import Ending
from simmer_tui.trials.trial import Trial, run_seed


@pytest.fixture
def trials(program: Callable[[str], str]) -> Callable[[str], list[Trial]]:
    """Makes three runs of a program."""

    def make(lines: str) -> list[Trial]:
        command, configuration = program(lines), load(find_set("default"))
        return [
            Trial(
                number=number,
                seed=run_seed(1, number),
                configuration=configuration,
                maze="",
                command=command,
                fixed_ports=False,
                wall_limit=60.0,
            )
            for number in (1, 2, 3)
        ]

    return make


def test_worker_that_dies_takes_one_run_with_it(trials: Callable[[str], list[Trial]], tmp_path: Path) -> None:
    runs = trials('import signal\nrobot.read("u1")\nif number == 2: os.kill(os.getppid(), signal.SIGTERM)\n')
    results = list(run_locally(runs, tmp_path, 1))
    assert [(each.number, each.ending) for each in results] == [
        (1, Ending.SUCCESS),
        (2, Ending.FAULT),
        (3, Ending.SUCCESS),
    ]
    assert results[1].reason.startswith("the simulator's process died with exit code ")


def test_closing_the_results_ends_the_runs_under_way(
    trials: Callable[[str], list[Trial]], tmp_path: Path
) -> None:
    results = run_locally(trials("if number > 1: threading.Event().wait()"), tmp_path, 2)
    assert next(results).number == 1
    before = threading.active_count()
    results.close()
    assert threading.active_count() <= before
    assert list(results) == []


def test_run_that_cannot_be_done_ends_all_with_its_reason(
    trials: Callable[[str], list[Trial]], tmp_path: Path
) -> None:
    with pytest.raises(TrialsError, match=r"0001\.jsonl"):
        list(run_locally(trials(""), tmp_path / "no-such-folder", 1))


CLUSTER = """
import sys
from distributed import LocalCluster
from simmer_tui.cli.trials_command import run_trials

scratch, there, broken, *options = sys.argv[1:]
with LocalCluster(
    n_workers=1,
    threads_per_worker=2,
    processes=False,
    dashboard_address=None,
    protocol="tcp",
    local_directory=scratch,
) as cluster:
    address = cluster.scheduler_address
    assert run_trials([*options, "--out", there, "--dask", address]) == 0
    assert run_trials(["--run", "no-such-program", "--runs", "2", "--out", broken, "--dask", address]) == 2
"""
NO_CLUSTER = """
import sys
from simmer_tui.trials import cluster
from simmer_tui.cli.trials_command import run_trials

cluster._CONNECT_TIMEOUT = "0.2s"
sys.exit(run_trials(["--run", "x", "--out", sys.argv[1], "--dask", "tcp://127.0.0.1:1"]))
"""


def in_process_of_its_own(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Dask keeps threads that work on, which would hold up all tests that wait for idleness."""
    pytest.importorskip("distributed", reason="the extra simmer-tui[dask] is not installed")
    words = [sys.executable, "-c", script, *arguments]
    return subprocess.run(words, capture_output=True, text=True, check=False, timeout=120)


def test_cluster_gives_the_same_table_as_this_machine(tmp_path: Path, program: Callable[[str], str]) -> None:
    command = program('robot.drive("d1", number)\nsys.exit(number == 2)')
    options = ["--run", command, "--runs", "4", "--config", "default", "--seed", "1"]
    there, here = tmp_path / "there", tmp_path / "here"
    done = in_process_of_its_own(
        CLUSTER, str(tmp_path / "scratch"), str(there), str(tmp_path / "x"), *options
    )
    assert done.returncode == 0, done.stderr
    assert run_trials([*options, "--out", str(here)]) == 0
    assert (there / "trials.csv").read_bytes() == (here / "trials.csv").read_bytes()
    assert sorted(path.name for path in (there / "runs").glob("*.jsonl")) == [
        f"000{number}.jsonl" for number in (1, 2, 3, 4)
    ]
    assert len(TrialFolder.read(there).results) == 4


def test_cluster_that_is_not_there_is_said(tmp_path: Path) -> None:
    done = in_process_of_its_own(NO_CLUSTER, str(tmp_path / "out"))
    assert done.returncode == 2
    assert "--dask tcp://127.0.0.1:1: no Dask scheduler answers there" in done.stderr
