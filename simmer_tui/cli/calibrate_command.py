"""The subcommand `calibrate`."""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.progress import TaskProgressColumn

from simmer_tui.cli.command_line import (
    ExitCode,
    OneLineParser,
    add_flag,
    add_json_option,
    add_trust_option,
    add_value,
    print_answer,
    print_lines,
    say,
    subcommand,
    window_console,
    writing,
)
from simmer_tui.cli.log_options import add_large_option, allow_large, configuration_of
from simmer_tui.cli.progress_bar import progress_bar
from simmer_tui.config.device_trust import DeviceUse
from simmer_tui.config.loader import Override, load
from simmer_tui.config.sets import check_free, find_set
from simmer_tui.document.as_html import html_page
from simmer_tui.errors import CalibrationError
from simmer_tui.runlog.writer import LOG
from simmer_tui.sim.command import counted, typed_path
from simmer_tui.sim.noise import SEEDS
from simmer_tui.version import requirement

if TYPE_CHECKING:
    from simmer_tui.calibrate.measured_run import MeasuredRun
    from simmer_tui.report.finding import Finding

_NOTES = 5
"""Notes shown on parts of logs that were left out."""


def _options(parser: OneLineParser) -> None:
    parser.add_argument("logs", metavar="LOG", nargs="*", type=Path, help="run logs of one robot")
    add_large_option(parser)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--out", metavar="DIR", type=Path, help="write the set, and calibration.html, into this folder"
    )
    what.add_argument(
        "--check", metavar="SET", help="say whether the robot still behaves as this calibrated set says"
    )
    text = (
        "the LOGs are calibrated sets of several robots: say how their biases differ, for the "
        "setting strength"
    )
    add_flag(what, "--strength", text)
    text = "seed of the search for the path (default %(default)s); rarely needed"
    add_value(parser, "--seed", SEEDS, text, default=0)
    text = "write the set even if a sensor or drive seems to be swapped, inverted or stuck"
    add_flag(parser, "--anyway", text)
    add_json_option(parser)
    add_trust_option(parser)
    guided = parser.add_argument_group("guided")
    text = (
        "no log yet: drive the robot on --serial, with as few movements as possible, and use that log; "
        "the log is written beside DIR, as DIR.jsonl"
    )
    add_flag(guided, "--guided", text)
    guided.add_argument("--serial", metavar="PORT", help="the robot's serial port or URL")
    guided.add_argument("--config", metavar="SET", help="the set that describes the robot so far")


@subcommand("calibrate", _options, epilog="docs/calibrate.md says what to drive, and what each log shows.")
def run_calibrate(options: argparse.Namespace) -> int:
    """Estimate biases, gains, angles, errors and delays of a real robot from its run logs (simmer-tui
    --serial PORT --log FILE), and write them as a configuration set."""
    _check_options(options)
    allow_large(options)
    if importlib.util.find_spec("scipy") is None:
        raise CalibrationError(
            f"this needs scipy, which is not installed: pip install '{requirement('calibrate')}'"
        )
    if options.strength:
        return _strength(options.logs, as_json=options.json)
    from simmer_tui.calibrate.change_detection import require_one_robot
    from simmer_tui.calibrate.measured_run import read_runs
    from simmer_tui.calibrate.written_set import device_texts

    if options.guided:
        return _guide(options)
    with configuration_of(options.logs[0]):
        run = read_runs(options.logs)
    notes = ["the robot in these logs was a simulated one"] if run.simulated else []
    rest = len(run.notes) - _NOTES
    more = [f"and {counted(rest, 'line')} more"] if rest > 0 else []
    for note in (*notes, *run.notes[:_NOTES], *more):
        say(f"note: {note}", sys.stderr if options.json else sys.stdout)
    if options.check is not None:
        return _check(run, options.check, as_json=options.json)
    check_free(options.out)
    device_texts(run.configuration)  # missing ones are reported before the work
    if len(options.logs) > 1:
        with _shown() as progress:
            require_one_robot([read_runs([log]) for log in options.logs], options.seed, progress)
    return _learn(run, options)


def _check_options(options: argparse.Namespace) -> None:
    """Raises CalibrationError for options that do not go together."""
    if options.guided:
        if options.logs or options.out is None or options.serial is None:
            raise CalibrationError("--guided takes --serial PORT and --out DIR, and no LOG")
    elif options.strength and not options.logs:
        raise CalibrationError("--strength takes calibrated sets: name five or more")
    elif not options.logs:
        raise CalibrationError("name a LOG, or --guided to make one")
    elif options.serial is not None or options.config is not None:
        raise CalibrationError("--serial and --config are for --guided; a log has its own set")


def _guide(options: argparse.Namespace) -> int:
    """Hold a guided session. Returns the exit code."""
    from simmer_tui.calibrate.guided import guided_run
    from simmer_tui.calibrate.measured_run import read_runs
    from simmer_tui.cli.guided_session import hold_session

    check_free(options.out)
    configuration = load(find_set(options.config), {"serial.port": Override("--serial", options.serial)})
    log = options.out.with_name(f"{options.out.name}{LOG}")
    # Before somebody puts the robot into the maze.
    if log.exists():
        raise CalibrationError(f"{log} is there already: name another --out, or give it as LOG")
    with writing(CalibrationError, log):
        log.parent.mkdir(parents=True, exist_ok=True)
    hold_session(configuration, log, window_console())
    return _learn(guided_run(read_runs([log])), options)


def _strength(names: list[Path], *, as_json: bool) -> int:
    from simmer_tui.calibrate.change_detection import strengths
    from simmer_tui.calibrate.result_page import strength_document
    from simmer_tui.calibrate.written_set import Knowledge, read_knowledge

    robots: list[Knowledge] = []
    for name in names:
        robot = read_knowledge(find_set(str(name)), "--strength")
        if robot in robots:
            first = str(names[robots.index(robot)])
            raise CalibrationError(f"{name} is the same calibration as {first}; name each robot once")
        robots.append(robot)
    print_answer(strength_document(strengths(robots)), as_json=as_json)
    return ExitCode.DONE


def _learn(run: MeasuredRun, options: argparse.Namespace) -> int:
    from simmer_tui.calibrate.estimates import estimates_of
    from simmer_tui.calibrate.fit import fit
    from simmer_tui.calibrate.prediction import held_back, widened
    from simmer_tui.calibrate.result_page import result_document, result_page
    from simmer_tui.calibrate.suspicions import suspicions, suspicions_without_path
    from simmer_tui.calibrate.written_set import CALIBRATION_PAGE, set_texts, write_texts

    out: Path = options.out
    with _shown() as progress:
        try:
            found = fit(run, seed=options.seed, progress=progress)
        except CalibrationError as error:
            suspected = suspicions_without_path(run)
            said = "".join(f"; {each.text}" for each in suspected)
            raise CalibrationError(f"{error}{said}") from None
        _warn(suspicions(found), anyway=options.anyway)
        held = held_back(found)
        if held is not None:
            found = widened(found, held)
        estimates = estimates_of(found)
    texts, answer = set_texts(found, estimates), result_document(found, estimates, held)
    write_texts({**texts, CALIBRATION_PAGE: html_page(result_page(found, estimates, held))}, out)
    load(out, devices=DeviceUse.PARSE)
    print_answer(answer, as_json=options.json)
    if not options.json:
        wrote = f"{', '.join(sorted(texts))} and {CALIBRATION_PAGE}"
        print_lines(f"Wrote {wrote} to {out}", f"Try it: simmer-tui --config {typed_path(out)}")
    return ExitCode.DONE


def _warn(suspected: Sequence[Finding], *, anyway: bool) -> None:
    """Warn of suspected sensors and drives. Raises CalibrationError, unless the set is wanted `anyway`: its
    figures would hide the fault."""
    if not suspected:
        return
    said = "; ".join(each.text for each in suspected)
    if not anyway:
        raise CalibrationError(f"no set was written: {said}. Correct the wiring or the set, or give --anyway")
    say(f"note: {said}; written because of --anyway")


def _check(run: MeasuredRun, name: str, *, as_json: bool) -> int:
    from simmer_tui.calibrate.change_detection import check_robot
    from simmer_tui.calibrate.result_page import check_document
    from simmer_tui.calibrate.written_set import read_knowledge

    directory = find_set(name)
    knowledge = read_knowledge(directory)
    with _shown() as progress:
        parts = check_robot(run, load(directory, devices=DeviceUse.PARSE), knowledge, progress)
    print_answer(check_document(parts), as_json=as_json)
    return ExitCode.NO if any(part.changed for part in parts) else ExitCode.DONE


@contextmanager
def _shown() -> Generator[Callable[[str, float], None], None, None]:
    """A progress bar on standard error, if that is a terminal."""
    with progress_bar("{task.description}", TaskProgressColumn()) as bar:
        task = bar.add_task("reading", total=1.0)
        yield lambda what, share: bar.update(task, description=what, completed=share)
