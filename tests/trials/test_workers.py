"""Workers of this machine and of a Dask cluster."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from simmer_tui.cli.trials_command import run_trials
from simmer_tui.config.loader import find_set, load
from simmer_tui.errors import TrialsError
from simmer_tui.trials.folder import TrialFolder
from simmer_tui.trials.local import run_locally
from simmer_tui.trials.trial import Ending, Trial, run_seed

ROOT = Path(__file__).resolve().parents[2]


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
                time_limit=60.0,
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


@pytest.mark.slow
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

cluster.CONNECT_TIMEOUT = "0.2s"
sys.exit(run_trials(["--run", "x", "--out", sys.argv[1], "--dask", "tcp://127.0.0.1:1"]))
"""


def in_process_of_its_own(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Dask keeps threads that work on, which would hold up all tests that wait for idleness."""
    pytest.importorskip("distributed", reason="the extra simmer-tui[dask] is not installed")
    words = [sys.executable, "-c", script, *arguments]
    return subprocess.run(words, capture_output=True, text=True, check=False, timeout=600)


@pytest.mark.slow
def test_cluster_gives_the_same_table_as_this_machine(tmp_path: Path, program: Callable[[str], str]) -> None:
    command = program('robot.drive("d1", number)\nsys.exit(number == 2)')
    options = ["--run", command, "--runs", "2", "--config", "default", "--seed", "1"]
    options += ["--vary", "strength=0.05,0.5"]
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


@pytest.mark.slow
def test_cluster_that_is_not_there_is_said_and_runs_can_be_gone_on_with(tmp_path: Path) -> None:
    done = in_process_of_its_own(NO_CLUSTER, str(tmp_path / "out"))
    assert done.returncode == 3
    assert "--dask tcp://127.0.0.1:1: no Dask scheduler answers there" in done.stderr
    assert f"to resume: simmer-tui trials --resume --out {tmp_path / 'out'}" in done.stderr
    assert TrialFolder.read(tmp_path / "out").to_do == list(range(1, 101))


class Cluster:
    """A scheduler and a worker, each a process of its own in an empty folder of its own."""

    def __init__(self, folder: Path, stack: contextlib.ExitStack) -> None:
        self._folder = folder
        self._stack = stack
        self.scheduler, self.address = self._start("scheduler", "Scheduler at:", "--port", "0")
        self.worker, _ = self._start(
            "worker", "Registered to:", self.address, "--no-nanny", "--nthreads", "1",
            SCHEDULER=str(self.scheduler.pid),
        )  # fmt: skip

    def _start(
        self, name: str, ready: str, *options: str, **environment: str
    ) -> tuple[subprocess.Popen[str], str]:
        """The process, and what it says when it is ready."""
        home = self._folder / name
        home.mkdir()
        words = [sys.executable, "-m", f"distributed.cli.dask_{name}", *options, "--no-dashboard"]
        process = self._stack.enter_context(
            subprocess.Popen(
                [*words, "--host", "127.0.0.1"],
                cwd=home,
                env=os.environ | environment | {"PYTHONPATH": str(ROOT)},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            )
        )
        self._stack.callback(process.kill)
        assert process.stderr is not None
        said = next(line for line in process.stderr if ready in line)
        drain = threading.Thread(target=process.stderr.read)
        self._stack.callback(drain.join)
        self._stack.callback(process.kill)
        drain.start()
        return process, said.split(ready)[1].split()[0]


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    pytest.importorskip("distributed", reason="the extra simmer-tui[dask] is not installed")
    folder = tmp_path / "cluster"
    folder.mkdir()
    with contextlib.ExitStack() as stack:
        yield Cluster(folder, stack)


CALLER = """
import sys
from simmer_tui.cli.trials_command import run_trials
from simmer_tui.trials import cluster

cluster.CONNECT_TIMEOUT = "1s"
sys.exit(run_trials(sys.argv[1:]))
"""


def caller(folder: Path, *options: str) -> tuple[int, str]:
    """`simmer-tui trials` in a folder: its exit code and what it says of itself."""
    done = subprocess.run(
        [sys.executable, "-c", CALLER, *options],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    return done.returncode, done.stderr


@pytest.mark.slow
def test_program_reaches_workers_that_share_no_folder_with_the_caller(
    cluster: Cluster, tmp_path: Path
) -> None:
    here = tmp_path / "here"
    (here / "src").mkdir(parents=True)
    (here / "src/helper.py").write_text("turn = 90\n")
    (here / "map.txt").write_text("a map\n")
    (here / "src/robot.py").write_text(
        "import os, shutil, sys\n"
        f"shutil.rmtree({str(here / 'src')!r}, ignore_errors=True)  # nobody has it from there\n"
        "from helper import turn\n"
        "from simmer_tui.client import Robot\n"
        "assert open(sys.argv[1]).read() == 'a map\\n'\n"
        f"assert {str(tmp_path)!r} not in os.path.realpath(__file__)\n"
        "Robot().drive('r1', turn)\n"
    )
    options = ["--run", "python src/robot.py map.txt", "--runs", "3", "--config", "default", "--out", "out"]
    code, said = caller(here, *options, "--dask", cluster.address)
    assert code == 0, said
    assert not (here / "src").exists()
    assert [each.reason for each in TrialFolder.read(here / "out").done] == [""] * 3
    assert list((tmp_path / "cluster/worker").glob("*.py")) == []


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals are those of POSIX")
def test_lost_scheduler_is_said_keeps_what_is_done_and_can_be_gone_on_with(
    cluster: Cluster, tmp_path: Path
) -> None:
    here = tmp_path / "here"
    here.mkdir()
    (here / "robot.py").write_text(
        "import os, signal, threading\n"
        "from simmer_tui.client import Robot\n"
        "Robot().drive('r1', 90)\n"
        "if os.environ['SIMMER_RUN'] == '2' and 'SCHEDULER' in os.environ:\n"
        f"    while not os.path.exists({str(here / 'out/results.jsonl')!r}):\n"
        "        threading.Event().wait(0.01)  # until the first run is kept\n"
        "    os.kill(int(os.environ['SCHEDULER']), signal.SIGKILL)\n"
        "    threading.Event().wait()\n"
    )
    options = ["--run", "python robot.py", "--runs", "3", "--config", "default", "--seed", "1"]
    code, said = caller(here, *options, "--out", "out", "--dask", cluster.address)
    assert code == 3, said
    assert "the connection to the Dask scheduler was lost" in said
    assert "; to resume: simmer-tui trials --resume --out out\n" in said
    assert [each.number for each in TrialFolder.read(here / "out").done] == [1]
    assert (here / "out/trials.csv").exists()
    cluster.worker.kill()
    assert caller(here, "--resume", "--out", "out")[0] == 0
    assert caller(here, *options, "--out", "whole")[0] == 0
    assert (here / "out/trials.csv").read_bytes() == (here / "whole/trials.csv").read_bytes()
