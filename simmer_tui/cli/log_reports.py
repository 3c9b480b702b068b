"""The report of a log, read with its progress, and the files that commands write of it."""

from __future__ import annotations

import os
import sys
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from io import TextIOWrapper
from pathlib import Path

from simmer_tui.cli.command_line import window_of, writing
from simmer_tui.cli.log_options import configuration_of
from simmer_tui.errors import RunLogError
from simmer_tui.report.run_statistics import CommandTable, RunStatistics
from simmer_tui.runlog.reader import Logged, LogReader
from simmer_tui.whole_file import whole_file, write_whole

# Lines between two updates of a progress bar. Judged: often enough for the eye, rarely enough to cost
# nothing.
_PROGRESS_EVERY = 500


def build_report(
    path: Path, csv_path: Path | None = None, *, recorded: bool = True, nominal: str | None = None
) -> RunStatistics:
    """Read a log to its end.

    With `csv_path` it also writes the log's commands there; with `recorded` it keeps the data of a player.
    `nominal` is the set that the log's set is compared with. Raises RunLogError, and ConfigurationError for a
    nominal set that cannot be read. Broken lines are skipped and noted.
    """
    with ExitStack() as stack:
        with configuration_of(path):
            log = stack.enter_context(LogReader(path))
        run = RunStatistics(log.header, log.configuration, recorded=recorded, nominal=nominal)
        table = None
        if csv_path is not None:
            # Opened before the log is read: a name that cannot be written is reported at once.
            stack.enter_context(writing(RunLogError, csv_path))
            file = stack.enter_context(whole_file(csv_path))
            table = CommandTable(stack.enter_context(TextIOWrapper(file, "utf-8", newline="")))
        run_through(_steps(log, run, table), log.size, "report")
    run.finish(log.note)
    return run


def _steps(log: LogReader, run: RunStatistics, table: CommandTable | None) -> Iterator[int]:
    """Read the log, and yield the position in it from time to time."""
    if table is None:
        for block in log.blocks():
            run.add(block)
            yield log.position
        return
    # Event by event: a row of the table has the time after its own.
    for logged in log:
        run.add([logged])
        if isinstance(logged, Logged):
            table.add(logged, run.elapsed)
        yield log.position
    table.finish()


def check_outputs(log: Path, outputs: Iterable[Path | None]) -> None:
    """Check that no output is the log itself, or another output. Raises RunLogError."""
    # Resolved: one file may have two names.
    given = [path.resolve() for path in (log, *outputs) if path is not None]
    for path in given:
        if given.count(path) > 1:
            raise RunLogError(f"{path} is named twice; name another file to write to")


def write_text(path: Path, text: str) -> None:
    """Raises RunLogError, which names the file, if it cannot be written."""
    with writing(RunLogError, path):
        write_whole(path, text)


def wrote(path: Path) -> str:
    """The line that names a file that has been written."""
    return f"Wrote {path}"


def run_through(positions: Iterable[int], size: int, what: str) -> None:
    """Run the steps of some work, each the number of bytes done of `size`. A terminal (standard error) shows
    a progress bar meanwhile."""
    # Asked before rich is loaded, which takes as long as the report of 2,000 commands.
    if window_of(sys.stderr) is None and "FORCE_COLOR" not in os.environ:
        deque(positions, maxlen=0)
        return
    from rich.progress import DownloadColumn, TaskProgressColumn, TimeRemainingColumn

    from simmer_tui.cli.progress_bar import progress_bar

    columns = TaskProgressColumn(), DownloadColumn(), TimeRemainingColumn()
    with progress_bar("{task.description}", *columns) as progress:
        task = progress.add_task(what, total=size)
        for step, position in enumerate(positions):
            if step % _PROGRESS_EVERY == 0:
                progress.update(task, completed=position)
