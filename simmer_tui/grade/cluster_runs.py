"""Grading on a Dask cluster: each team's files travel to a worker once, and run in a sandbox there."""

from __future__ import annotations

import tempfile
from collections.abc import Generator, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from simmer_tui.errors import GradeError, SimmerError, TrialsError
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.grade_run import GradeRun, GradeTrial
from simmer_tui.grade.grading import RunSource, what_is_missing
from simmer_tui.grade.limits import Isolation
from simmer_tui.grade.submission import PROGRAM
from simmer_tui.trials.cluster import results_of
from simmer_tui.trials.record import TrialResult

if TYPE_CHECKING:
    from distributed import Client, Future


@dataclass(frozen=True, slots=True)
class Submission:
    """A team's files by path, each with whether it can be started."""

    files: dict[str, tuple[bytes, bool]]


def on_cluster(folder: GradeFolder, client: Client) -> RunSource:
    """Runs on the workers of a cluster. Raises GradeError if one of them cannot close programs in."""
    missing = {where: why for where, why in client.run(what_is_missing, folder.isolation).items() if why}
    if missing:
        where, why = next(iter(missing.items()))
        raise GradeError(f"programs cannot be sandboxed on the worker {where}: {why}")

    def source(trials: Iterable[GradeTrial]) -> Generator[TrialResult, None, None]:
        packed: dict[str, Future] = {}

        def submit(trial: GradeTrial) -> Future:
            if trial.slug not in packed:
                (folder.runs / trial.slug).mkdir(exist_ok=True)
                packed[trial.slug] = client.submit(_itself, _packed(trial.files), pure=False)
            return client.submit(run_there, trial, packed[trial.slug], pure=False)

        return results_of(trials, submit, folder.runs, client)

    return source


def _itself(submission: Submission) -> Submission:
    return submission


def _packed(folder: Path) -> Submission:
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return Submission(
        {
            path.relative_to(folder).as_posix(): (path.read_bytes(), bool(path.stat().st_mode & 0o100))
            for path in paths
        }
    )


def run_there(trial: GradeTrial, submission: Submission) -> tuple[TrialResult, dict[str, bytes]]:
    """A run, and the files it leaves; on the cluster. Raises TrialsError if it cannot be done."""
    with tempfile.TemporaryDirectory(prefix="simmer-tui-", ignore_cleanup_errors=True) as name:
        place = Path(name)
        place.chmod(0o755 if trial.isolation is not Isolation.NONE else 0o700)
        runs, files = place / "runs", place / PROGRAM
        runs.mkdir(mode=0o700)
        files.mkdir()
        for path, (data, executable) in submission.files.items():
            (files / path).parent.mkdir(parents=True, exist_ok=True)
            (files / path).write_bytes(data)
            (files / path).chmod(0o755 if executable else 0o644)
        try:
            result = GradeRun(replace(trial, files=files), runs).run()
        except SimmerError as error:
            raise TrialsError(str(error)) from None  # some others do not survive the way back
        left = (path for path in runs.rglob("*") if path.is_file())
        return result, {path.relative_to(runs).as_posix(): path.read_bytes() for path in left}
