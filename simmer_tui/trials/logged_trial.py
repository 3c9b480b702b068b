"""A logged run that is done again, with one change at a time: the same code as for the runs of trials.

The simulator gets set and seed from the log, the program gets the set in a folder of its own. Ports are any
free ones on this machine, whatever the log says.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

from msgspec.structs import replace

from simmer_tui.config.dialects import TEAM
from simmer_tui.config.loader import Configuration
from simmer_tui.config.settings import ELSE_REAL
from simmer_tui.errors import TrialsError, reason_of
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.report.verdict import Outcome
from simmer_tui.runlog.header import rebuild_to_run
from simmer_tui.sim.command import typed_path
from simmer_tui.trials.explanations import ChangedRun, Explanation, Explanations, explained
from simmer_tui.trials.folder import PLAN
from simmer_tui.trials.interventions import UNCHANGED
from simmer_tui.trials.run import fault_result
from simmer_tui.trials.trial import TIME_LIMIT, Ending, Trial, TrialResult, timed_seconds

_NUMBER = 1
"""Number of the run among those of `Explanations`: there is only one."""
_PEOPLE = frozenset(("keys", "console"))
"""Senders of commands that are people."""


class LoggedTrial:
    """A logged run as a trial; `explanations` has its changed runs, `results` its own result."""

    def __init__(
        self,
        run: RunStatistics,
        folder: Path,
        command: str,
        start: Path,
        *,
        devices: Path | None = None,
        fixed_ports: bool = False,
        time_limit: float | None = None,
    ) -> None:
        """Prepare the runs.

        Args:
            run: The logged run.
            folder: An empty folder, for the set and the results.
            command: The program's command.
            start: Folder in which it is started.
            devices: Folder of the set's own devices; None for where the run had them.
            fixed_ports: True for the ports of the log's settings.
            time_limit: Longest real time of a run, seconds; None for that of trials.

        Raises TrialsError, RunLogError and ConfigurationError if the set cannot be used.
        """
        self.path = folder
        self.start: Path | None = start
        self._run = run
        configuration = _own_configuration(run, folder / "set", devices)
        self._trial = Trial(
            number=_NUMBER,
            repetition=_NUMBER,
            seed=run.header.seed,
            configuration=configuration,
            maze="",
            command=command,
            fixed_ports=fixed_ports,
            time_limit=time_limit or TIME_LIMIT + timed_seconds(configuration),
        )
        verdict = run.verdict
        self.results: Mapping[int, TrialResult] = {
            _NUMBER: replace(
                fault_result(self._trial, verdict.text),
                ending=Ending.TIME_LIMIT if _time_was_up(run) else Ending.EXIT,
                verdict=verdict.plain(),
                commands=run.totals.commands,
            )
        }
        self.explanations = Explanations(self)

    def trial(self, number: int) -> Trial:
        """The plan of the run."""
        return self._trial

    def read(self, number: int) -> Collection[str] | None:
        """IDs of the sensors that the program read."""
        return self._run.totals.sensors.keys()

    @property
    def changed(self) -> list[ChangedRun]:
        """The runs that are done."""
        return list(self.explanations.done.values())

    @property
    def explanation(self) -> Explanation:
        """The explanation by the runs that are done; at least one."""
        return explained(self.results[_NUMBER], self.changed, "The run")

    def check(self, each: ChangedRun) -> None:
        """Raises TrialsError if the program of an unchanged run sent nothing, though it did in the log: then
        no change can show anything."""
        sent = self._run.totals.commands
        if each.change != UNCHANGED or each.commands or each.succeeded is None or not sent:
            return
        if self._trial.fixed_ports:
            what = "check that the command is that of the run"
        else:
            what = "a program with its port built in needs --fixed-ports, and a closed simulator at that port"
        raise TrialsError(
            f"the program sent {sent:,} commands in the log, and none now ({each.text}): {what}"
        )


def obstacle(run: RunStatistics, path: Path, *, has_command: bool) -> str:
    """The reason why a logged run cannot be done again, and what to do; empty if it can be.

    Args:
        run: The run.
        path: Its log.
        has_command: True if the user gives a command.
    """
    header, verdict = run.header, run.verdict
    log = typed_path(path)
    if not header.simulated:
        return f"a real robot made this run: only a simulated one can be run again; simmer-tui report {log}"
    if header.taken_over is not None:
        return (
            f"this run continues another one ({header.taken_over}), so its program has no start to run from: "
            f"explain that one, simmer-tui why {typed_path(header.taken_over.log)}"
        )
    if verdict.outcome is Outcome.STILL_GOING:
        return f"this run has not ended in its log ({verdict.text}): explain a run that has failed"
    plan = path.absolute().parent.parent / PLAN
    if header.sketches and not plan.is_file():
        return (
            "boards drove this robot, and why runs no boards: run the set in trials, "
            "simmer-tui trials --sketch DIR --run CMD --why"
        )
    if (has_command or header.can_run_again) and not header.sketches:
        return ""
    if plan.is_file():
        folder = typed_path(path.parent.parent)
        return f"this is a run of trials: type simmer-tui trials --resume --out {folder} --why"
    if header.run is not None:
        why = "its command held a password or token, which no log keeps"
    elif run.totals.sources and run.totals.sources.keys() <= _PEOPLE:
        return "this run was driven by hand: there is no program to run again. Start one with --run"
    else:
        why = "its program was started without --run"
    return (
        f'the log does not name a program, because {why}: add --run "CMD", such as --run "python my_robot.py"'
    )


def _time_was_up(run: RunStatistics) -> bool:
    task = run.task
    return task is not None and run.attempt.seconds >= task.time_limit


def _own_configuration(run: RunStatistics, folder: Path, devices: Path | None) -> Configuration:
    """The configuration of a logged run, with its set in a folder, for programs that read it."""
    configuration = rebuild_to_run(run.header, devices)
    try:
        for name, text in configuration.texts.items():
            file = folder / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(text.encode("utf-8", "surrogatepass"))
    except OSError as error:
        raise TrialsError(f"{folder} cannot be written: {reason_of(error)}") from None
    motion, listeners = configuration.settings.motion, configuration.settings.server.listeners
    # A log from elsewhere opens no port to other machines or users.
    safe: dict[str, object] = {"server.host": "127.0.0.1", "server.any_user": False}
    if motion.clock == "real" and TEAM in listeners:
        # The screen needs the real clock; runs by the program's own are shorter and repeat exactly.
        safe["motion.clock"] = ELSE_REAL
    configuration = replace(configuration.with_settings(safe), directory=folder)
    is_mission = run.header.mission or run.task is not None
    return configuration if is_mission else replace(configuration, mission=None)
