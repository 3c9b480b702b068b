"""Grading on a Dask cluster: the same table as here."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from simmer_tui.cli.grade_command import run_grade
from simmer_tui.errors import GradeError
from simmer_tui.grade.course import read_course
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.grading import on_cluster
from simmer_tui.grade.sandbox import Isolation
from tests.grade.conftest import HIT, SOLVE
from tests.grade.test_grading import QUICK

CLUSTER = """
import os, sys
from distributed import LocalCluster
from simmer_tui.cli.grade_command import run_grade

scratch, *arguments = sys.argv[1:]
with LocalCluster(
    n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None, local_directory=scratch,
    host="127.0.0.1", protocol="tcp",
) as cluster:
    code = run_grade([*arguments, "--dask", cluster.scheduler_address])
sys.exit(code)
"""


class Worker:
    """A cluster with one worker, which is this process."""

    def run(self, function: Callable[..., str], *arguments: object) -> dict[str, str]:
        return {"tcp://worker": function(*arguments)}


def test_a_worker_without_a_folder_for_programs_is_named(
    make_course: Callable[..., Path], tmp_path: Path
) -> None:
    file = make_course({"a": HIT}, f'read_only = ["/opt/matlba"]\n{QUICK}')
    folder = GradeFolder.create(tmp_path / "out", read_course(file, is_here=False), 3, Isolation.BWRAP)
    with pytest.raises(GradeError, match=r"worker tcp://worker: /opt/matlba does not exist \(read_only\)"):
        on_cluster(folder, Worker())  # type: ignore[arg-type]


@pytest.mark.slow
def test_cluster_gives_the_same_table_as_this_machine(
    isolation: str, make_course: Callable[..., Path], tmp_path: Path
) -> None:
    pytest.importorskip("distributed", reason="the extra simmer-tui[dask] is not installed")
    file = make_course({"good": SOLVE, "wall": HIT}, QUICK)
    there, here = tmp_path / "there", tmp_path / "here"
    options = [str(file), "--seed", "1"]
    words = [sys.executable, "-c", CLUSTER, str(tmp_path / "scratch"), *options, "--out", str(there)]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 1, done.stderr
    assert run_grade([*options, "--out", str(here)]) == 1
    assert (there / "grades.csv").read_text() == (here / "grades.csv").read_text()
    logs = [sorted(path.name for path in (out / "runs" / "wall").iterdir()) for out in (there, here)]
    assert set(logs[1]) <= set(logs[0])
