"""The commands that read a log to its end: `report`, `export` and `rerun`."""

from __future__ import annotations

import argparse
import os
import sys
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING

from simmer_tui.cli.command_line import (
    ExitCode,
    OneLineParser,
    add_json_option,
    add_value,
    print_answer,
    print_json,
    print_lines,
    say,
    subcommand,
    window_of,
    writing,
)
from simmer_tui.cli.log_options import add_device_options, add_log_argument, configuration_of, log_of
from simmer_tui.document.model import Bullets, DataColumn, Document, data_table
from simmer_tui.errors import ExportError, RunLogError
from simmer_tui.report.content import maze_picture, report_document, svg_picture
from simmer_tui.report.run_statistics import CommandTable, RunStatistics
from simmer_tui.runlog.reader import Logged, LogReader
from simmer_tui.sim.command import WORD, counted, cut, typed_path
from simmer_tui.sim.rules import IntegerRule, NumberRule
from simmer_tui.version import __version__
from simmer_tui.whole_file import whole_file, write_whole

if TYPE_CHECKING:
    from simmer_tui.runlog.rerun import Rerun

# Lines between two updates of a progress bar. Judged: often enough for the eye, rarely enough to cost
# nothing.
_PROGRESS_EVERY = 500

RERUN = data_table(
    "rerun",
    "Rerun",
    *map(DataColumn, ("log", "same", "commands", "actions", "seed", "configuration", "version")),
    record=True,
)


def _report_options(parser: OneLineParser) -> None:
    add_log_argument(parser)
    parser.add_argument("--svg", metavar="OUT", type=Path, help="write maze, path and sensors as a picture")
    parser.add_argument("--csv", metavar="OUT", type=Path, help="write a table with a row for each command")
    parser.add_argument("--html", metavar="OUT", type=Path, help="write all of it as one page")
    parser.add_argument(
        "--nominal",
        metavar="SET",
        help="compare sensors and drives with this set, too (default: the one the run's set was made from)",
    )
    add_json_option(parser)


@subcommand("report", _report_options)
def run_report(options: argparse.Namespace) -> int:
    """Summarize a logged run: what went wrong, where, and the errors of the sensors and of the program's
    belief."""
    path = log_of(options)
    _check_outputs(path, (options.svg, options.csv, options.html))
    run = build_report(path, options.csv, recorded=options.html is not None, nominal=options.nominal)
    # Before the answer, which a pipe such as `| head` may cut off.
    if options.svg is not None:
        _write_text(options.svg, svg_picture(run, path.name))
    if options.html is not None:
        # Imported here because most reports have no page.
        from simmer_tui.report.page import report_page

        _write_text(options.html, report_page(run, path.name))
    print_answer(
        report_document(run, path.name, "" if options.file is None else str(path)),
        as_json=options.json,
    )
    for output in (options.svg, options.csv, options.html):
        if output is not None and not options.json:
            print_lines(_wrote(output))
    return 0


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
        _run_through(_steps(log, run, table), log.size, "report")
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


def _export_options(parser: OneLineParser) -> None:
    # Imported here because a report has no GIF.
    from simmer_tui.report.animation import USUAL_SECONDS

    add_log_argument(parser)
    parser.add_argument("--gif", metavar="OUT", type=Path, help="write the run as a GIF (needs Pillow)")
    parser.add_argument("--svg", metavar="OUT", type=Path, help="write the whole path as a picture")
    text = "width of the pictures (default %(default)s)"
    add_value(parser, "--width", IntegerRule(160, 3840), text, metavar="PIXELS", default=720)
    usual = f"1, or as many as make it {USUAL_SECONDS:g} s long"
    text = f"simulated seconds a second of the GIF (default: {usual})"
    add_value(parser, "--speed", NumberRule(0.01, 1000), text, metavar="X", dest="playback_rate")
    seconds = NumberRule(0)
    add_value(parser, "--from", seconds, "beginning of the GIF, seconds", metavar="S", dest="begin")
    add_value(parser, "--until", seconds, "end of the GIF, seconds", metavar="S")


@subcommand("export", _export_options)
def run_export(options: argparse.Namespace) -> int:
    """Make pictures of a logged run for slides: an animated GIF, or the whole path as an SVG that can be
    enlarged."""
    from simmer_tui.report.animation import shots, write_gif

    if options.gif is None and options.svg is None:
        raise ExportError("name what to write: --gif OUT, --svg OUT, or both")
    path = log_of(options)
    _check_outputs(path, (options.gif, options.svg))
    for output, kind in ((options.gif, "a GIF"), (options.svg, "an SVG")):
        ending = f".{kind[-3:].lower()}"
        if output is not None and output.suffix.lower() not in ("", ending):
            named = f"name it {output.with_suffix(ending)}, not {output}"
            raise ExportError(f"--{ending[1:]} writes {kind}: {named}")
    run = build_report(path)
    if options.svg is not None:
        _write_text(options.svg, maze_picture(run, path.name, options.width))
        print_lines(_wrote(options.svg))
    if options.gif is not None:
        taken = shots(run, options.begin, options.until, options.playback_rate)
        with writing(RunLogError, options.gif):
            _run_through(write_gif(run, options.gif, taken, options.width), len(taken.times), "pictures")
        print_lines(_wrote(options.gif))
    return 0


def _rerun_options(parser: OneLineParser) -> None:
    add_log_argument(parser)
    parser.add_argument(
        "--sketch",
        metavar="DIR",
        type=Path,
        help="run the boards too, by the sketches of this set: they get the laptop's bytes from the log",
    )
    add_device_options(parser)
    add_json_option(parser)


@subcommand("rerun", _rerun_options)
def run_rerun(options: argparse.Namespace) -> int:
    """Run the commands of a log again, from its configuration and seed, and compare every reply bit for bit.
    If a machine with other mathematics wrote the log, differences by rounding are allowed. Exits with 0 if
    all are the same, 1 at the first difference, 2 for a broken log."""
    # Imported here because a report runs nothing.
    from simmer_tui.runlog.rerun import Rerun

    path = log_of(options)
    with configuration_of(path):
        rerun = Rerun(path, options.config)
    with rerun:
        _run_through(rerun.steps(), rerun.size, "rerun")
        if options.sketch is None and rerun.header.sketches:
            rerun.notes.append(
                f"boards drove this robot: simmer-tui rerun {typed_path(path)} --sketch DIR runs them too"
            )
        code = _report_rerun(rerun, path, as_json=options.json)
    if options.sketch is None or code:
        return code
    return _rerun_boards(path, options.sketch)


def _rerun_boards(path: Path, folder: Path) -> int:
    """Run the boards of a log again. Returns the exit code."""
    # Few logs have boards, and a compiler takes its time.
    from simmer_tui.cli.sketch_option import tell_long_build
    from simmer_tui.runlog.board_rerun import BoardRerun

    tell_long_build()
    with BoardRerun(path, folder) as rerun:
        difference = rerun.difference()
        say(difference or f"{path}: {counted(rerun.count, 'fact')} of the boards repeated, all the same")
    return ExitCode.NO if difference else ExitCode.DONE


def _report_rerun(rerun: Rerun, path: Path, *, as_json: bool) -> int:
    for note in rerun.notes:
        say(f"note: {note}")
    header, same = rerun.header, rerun.difference is None
    shown = str(path)
    lines = [f"{shown}: {rerun.difference}"]
    if same:
        done = f"{counted(rerun.commands, 'command')} and {counted(rerun.actions, 'action')}"
        made = f"(seed {header.seed}, configuration {header.configuration})"
        how = "" if rerun.same_machine else " but for rounding"
        lines = [f"{shown}: {done} repeated, every reply the same{how} {made}"]
    elif not rerun.same_machine:
        lines.append("from there on the runs differ: the other machine's sines differ in their last bits")
    # The most likely reason for a difference.
    elif header.program != __version__:
        lines.append(f"the log is from simmer-tui {cut(header.program, WORD)}, this is {__version__}")
    if as_json:
        row = (path, same, rerun.commands, rerun.actions, header.seed, header.configuration, header.program)
        record = RERUN.filled([row])
        print_json(Document("Rerun", [record, Bullets("", lines, "answer")]))
    else:
        print_lines(*lines)
    return ExitCode.DONE if same else ExitCode.NO


def _check_outputs(log: Path, outputs: Iterable[Path | None]) -> None:
    """Check that no output is the log itself, or another output. Raises RunLogError."""
    # Resolved: one file may have two names.
    given = [path.resolve() for path in (log, *outputs) if path is not None]
    for path in given:
        if given.count(path) > 1:
            raise RunLogError(f"{path} is named twice; name another file to write to")


def _write_text(path: Path, text: str) -> None:
    """Raises RunLogError, which names the file, if it cannot be written."""
    with writing(RunLogError, path):
        write_whole(path, text)


def _wrote(path: Path) -> str:
    """The line that names a file that has been written."""
    return f"Wrote {path}"


def _run_through(positions: Iterable[int], size: int, what: str) -> None:
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
