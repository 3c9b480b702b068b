"""`simmer-tui why`: a failed run is run again with one change at a time, to find the change that saves it."""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import sys
import tempfile
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

from rich.progress import MofNCompleteColumn, TextColumn, TimeElapsedColumn

from simmer_tui.cli.command_line import (
    ExitCode,
    OneLineParser,
    add_flag,
    add_json_option,
    add_run_option,
    add_value,
    print_answer,
    say,
    subcommand,
)
from simmer_tui.cli.log_options import add_device_options, add_log_argument, configuration_of, log_of
from simmer_tui.cli.log_reports import build_report
from simmer_tui.cli.progress_bar import progress_bar
from simmer_tui.cli.trials_options import run_to_end
from simmer_tui.document.model import Document, Paragraph
from simmer_tui.errors import TrialsError
from simmer_tui.program.program_command import check_no_shell, missing_program
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.runlog.run_command import RunCommand
from simmer_tui.runlog.saved_runs import saved_runs_folder
from simmer_tui.sim.command import counted, typed_path
from simmer_tui.sim.rules import IntegerRule, NumberRule
from simmer_tui.trials.explanations import ChangedRun
from simmer_tui.trials.logged_trial import LoggedTrial, obstacle
from simmer_tui.trials.logged_trial_summary import why_document
from simmer_tui.trials.trial import TIME_LIMIT


@dataclass(frozen=True, slots=True)
class _Program:
    """The command that runs, and the folder in which it is started."""

    command: str
    folder: Path


def _why_options(parser: OneLineParser) -> None:
    add_log_argument(parser)
    add_run_option(parser, "the program, if the log does not name it; it is started in the working directory")
    add_flag(parser, "--yes", "start the program of your own saved run without a question")
    add_value(
        parser, "--jobs", IntegerRule(1, 1_000_000), "runs at a time (default: the number of processors)"
    )
    add_flag(parser, "--fixed-ports", "always the ports of the log, one run at a time: for built-in ports")
    text = f"longest real time of a run (default {TIME_LIMIT:g}, as for trials)"
    add_value(parser, "--time-limit", NumberRule(0.01, 1e6), text, metavar="SECONDS")
    add_device_options(parser)
    add_json_option(parser)


@subcommand("why", _why_options)
def run_why(options: argparse.Namespace) -> int:
    """Run the program of a failed run again, with the same seed and one change at a time: true readings of
    one sensor, no drive errors, no link delay, ... It says which change makes the run succeed, and not by
    chance."""
    path = log_of(options)
    run = build_report(path, recorded=False)
    if problem := obstacle(run, path, has_command=options.run is not None):
        raise TrialsError(f"{path}: {problem}")
    if not run.failed:
        text = f"This run did not fail, so no change is tried. {run.verdict.text}"
        print_answer(Document("Why", [Paragraph(text, "answer", "strong")]), as_json=options.json)
        return ExitCode.DONE
    program = _given(options.run) if options.run is not None else _logged(run.header.run, path)
    if options.run is None and not _may_run(program, run.header.run, path, yes=options.yes):
        return ExitCode.NO
    with (
        _terminated_as_interrupted(),
        tempfile.TemporaryDirectory(prefix="simmer-tui-why-", ignore_cleanup_errors=True) as folder,
    ):
        return _explain(run, path, program, Path(folder), options)


# -- the program -----------------------------------------------------------------------------------


def _given(command: str) -> _Program:
    """The program of `--run`. Raises ProgramError, TrialsError."""
    check_no_shell(command)
    if missing := missing_program(command):
        raise TrialsError(f"--run {command!r}: {missing}")
    return _Program(command, Path.cwd())


def _logged(logged: RunCommand | None, path: Path) -> _Program:
    """The program that the log names, if it is still there. Raises TrialsError."""
    assert logged is not None, "a log without a command is refused before"
    folder, command = Path(logged.folder), logged.line
    again = f"simmer-tui why {typed_path(path)} --run"
    try:
        with contextlib.chdir(folder):
            missing = missing_program(command)
    except (OSError, ValueError):  # ValueError: a name with a zero byte
        raise TrialsError(
            f"the program's folder {folder} is not there: go to where the program is now, "
            f'and type {again} "CMD"'
        ) from None
    if missing:
        raise TrialsError(f'the program of this run is gone: {missing}. Name where it is now: {again} "CMD"')
    return _Program(command, folder)


def _may_run(program: _Program, logged: RunCommand | None, path: Path, *, yes: bool) -> bool:
    """True if the command of a log may run: the user says so, or it is the user's own saved run. Raises
    TrialsError if nobody can be asked."""
    # The whole command: its end decides as much as its beginning.
    for line in ("The program of this run:", f"  {program.command}", f"  in {program.folder}"):
        say(line)
    is_own = _is_saved_here(path) and logged is not None and logged.is_sealed_here
    has_person = sys.stdin.isatty() and sys.stderr.isatty()
    if is_own and (yes or not has_person):
        return True
    if not has_person:
        raise TrialsError(
            "the log is not one of your own saved runs, so its command runs only after a yes on a terminal; "
            f'or name the program yourself: simmer-tui why {typed_path(path)} --run "CMD"'
        )
    if not is_own:
        say("The log may be from somebody else. The command runs with your rights.")
    sys.stderr.write("Run it again, with one change at a time? [y/N] ")
    sys.stderr.flush()
    try:
        answer = sys.stdin.readline()
    except (OSError, ValueError):
        answer = ""
    if answer.strip().lower() in ("y", "yes"):
        return True
    say("simmer-tui why: nothing was run")
    return False


def _is_saved_here(path: Path) -> bool:
    """True for a file in the user's folder of saved runs itself, not for a link there."""
    try:
        return path.resolve().parent == saved_runs_folder().resolve()
    except OSError:
        return False


# -- the runs --------------------------------------------------------------------------------------


def _explain(
    run: RunStatistics, path: Path, program: _Program, folder: Path, options: argparse.Namespace
) -> int:
    """Do the runs and print the answer. Raises TrialsError, RunLogError, ProgramError."""
    with configuration_of(path):
        logged = LoggedTrial(
            run,
            folder,
            program.command,
            program.folder,
            devices=options.config or program.folder / run.header.configuration,
            fixed_ports=options.fixed_ports,
            time_limit=options.time_limit,
        )
    jobs = 1 if options.fixed_ports else options.jobs or os.cpu_count() or 1
    code, why = run_to_end(lambda: _run_all(logged, jobs))
    if code is not ExitCode.DONE:
        say(f"simmer-tui why: {why} after {counted(len(logged.changed), 'run')}: nothing is decided")
        return code
    print_answer(why_document(logged), as_json=options.json)
    return code


def _run_all(logged: LoggedTrial, jobs: int) -> None:
    """Do the runs with a bar of progress; where there is no terminal, with a line for each."""
    explanations = logged.explanations
    columns = MofNCompleteColumn(), TextColumn("{task.fields[latest]}", markup=False), TimeElapsedColumn()
    with (
        contextlib.closing(explanations.explain(1, jobs)) as changed,
        progress_bar("runs", *columns) as progress,
    ):
        task = progress.add_task("", total=None, latest="unchanged")
        for number, each in enumerate(changed, 1):
            logged.check(each)
            latest = _result_text(each)
            progress.update(task, completed=number, total=max(explanations.most, number), latest=latest)
            if progress.disable:
                say(f"simmer-tui why: {number} of at most {max(explanations.most, number)} runs: {latest}")


def _result_text(each: ChangedRun) -> str:
    end = {True: "succeeds", False: "fails", None: "no result"}[each.succeeded]
    other = f", other errors ({each.repeat})" if each.repeat else ""
    return f"{each.change}{other}: {end}"


@contextlib.contextmanager
def _terminated_as_interrupted() -> Generator[None, None, None]:
    """Inside the `with` block SIGTERM ends runs as Ctrl-C does: no program stays."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
