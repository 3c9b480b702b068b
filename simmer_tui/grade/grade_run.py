"""One sandboxed run of a team's program, and the files kept of it."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from msgspec import structs

from simmer_tui.errors import ConfigurationError, PlacementError, PortError
from simmer_tui.grade.bubblewrap import Bubblewrap
from simmer_tui.grade.container import Container
from simmer_tui.grade.limits import Limits
from simmer_tui.grade.sandbox import Isolation
from simmer_tui.program import Keeper
from simmer_tui.sketch.board_process import BoardProcess
from simmer_tui.sketch.checked_board import CheckedBoard
from simmer_tui.trials.run import Sandbox, TrialRun, Unconfined, fault_result
from simmer_tui.trials.trial import Ending, Trial, TrialResult
from simmer_tui.whole_file import write_whole

_LARGEST_LOG = 30_000_000
"""Largest compressed log of a run, bytes, so that no program can fill the disk."""
SHOWN_SUCCESS = 1
"""Run whose log is kept even if it succeeds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GradeTrial(Trial):
    """A run of a team. `slug` names its files, `files` is the folder of its program; `repetition` is the
    number of the run, the same for all teams."""

    slug: str
    files: Path
    isolation: Isolation
    limits: Limits
    read_only: tuple[str, ...]
    image: str

    @property
    def name(self) -> str:
        return f"{self.slug}/{self.repetition:04}"

    @property
    def label(self) -> str:
        return f"run {self.repetition} of {self.slug}"


class GradeRun(TrialRun):
    """One run of a team. Make it, call `run` once; `interrupt` ends it from another thread."""

    def __init__(self, trial: GradeTrial, folder: Path, keeper: Keeper | None = None) -> None:
        """`folder` gets the log and the output of a run that fails, in a folder of the team, and the log of
        run `SHOWN_SUCCESS`."""
        (folder / trial.slug).mkdir(exist_ok=True)
        self._sandboxes: list[Sandbox] = []

        def made() -> Sandbox:
            self._sandboxes.append(sandbox_of(trial, keeper))
            return self._sandboxes[-1]

        super().__init__(trial, folder, sandbox=made, most_log=_LARGEST_LOG)
        self._most_output = int(trial.limits.output * 1000)

    def run(self) -> TrialResult:
        """Do the run. A fault of the team's program, ports or robot is a failure of that run.
        Raises RunLogError, GradeError, InterruptedTrialError."""
        try:
            result = super().run()
        except (ConfigurationError, PlacementError, PortError) as error:
            failed = fault_result(self._trial, str(error))
            result = structs.replace(failed, ending=Ending.EXIT)
        for each in self._sandboxes:
            if isinstance(each, Bubblewrap) and each.boards.fault:
                result = fault_result(self._trial, each.boards.fault)  # this machine's, not the team's
        if result.success:
            self._output_file.unlink(missing_ok=True)
            # The same mission for all teams: a page plays it for a team that passes, too.
            if self._trial.repetition != SHOWN_SUCCESS:
                self._log.unlink(missing_ok=True)
        elif self._output_file.exists():
            write_whole(self._output_file, self._output_file.read_bytes()[-self._most_output :])
        return result


def sandbox_of(trial: GradeTrial, keeper: Keeper | None = None) -> Sandbox:
    """The kind of sandbox that a run needs."""
    match trial.isolation:
        case Isolation.BWRAP:
            return Bubblewrap(trial.files, trial.limits, trial.read_only)
        case Isolation.NONE:
            return OpenCopy(trial.files, keeper)
        case engine:
            limits = structs.replace(trial.limits, time=trial.time_limit)
            return Container(engine.value, trial.image, trial.files, limits, trial.read_only)


class OpenCopy(Unconfined):
    """No sandbox: a copy of the program's files, with access to everything else."""

    def __init__(self, files: Path, keeper: Keeper | None) -> None:
        self._place = tempfile.TemporaryDirectory(prefix="simmer-run-", ignore_cleanup_errors=True)
        home = Path(self._place.name, "robot")
        shutil.copytree(files, home)
        super().__init__(home, keeper)

    def board(self, name: str, program: Path, options: Sequence[str]) -> BoardProcess:
        return CheckedBoard(name, program, options)

    def close(self) -> None:
        self._place.cleanup()
