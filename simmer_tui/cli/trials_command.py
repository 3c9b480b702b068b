"""`simmer-tui trials`: a program run many times, and how often it succeeds."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Generator, Sequence
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import structs
from rich.progress import MofNCompleteColumn, TextColumn, TimeElapsedColumn
from rich.progress import TimeRemainingColumn as RemainingColumn

from simmer_tui.cli.command_line import (
    ExitCode,
    overrides_from,
    print_answer,
    print_lines,
    say,
    subcommand,
    without_effect,
)
from simmer_tui.cli.progress_bar import progress_bar
from simmer_tui.cli.trials_options import (
    DEFAULT_RUNS,
    PREFIX,
    add_trials_options,
    newest_folder,
    run_to_end,
)
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.sets import find_mission_set, find_set
from simmer_tui.config.settings_file import Override
from simmer_tui.document.as_data import table_csv
from simmer_tui.document.as_html import html_page
from simmer_tui.errors import ConfigurationError, Problem, TrialsError
from simmer_tui.program.program_command import check_no_shell, is_python, missing_program
from simmer_tui.runlog.writer import new_folder
from simmer_tui.sim.command import cut, typed_path
from simmer_tui.trials.cluster import check_package, pack
from simmer_tui.trials.explanations import Explanations, FolderRuns
from simmer_tui.trials.figures import write_run_pages
from simmer_tui.trials.folder import PLAN, REPORT_PAGE, TABLE, TrialFolder, TrialPlan
from simmer_tui.trials.local import run_locally
from simmer_tui.trials.mazes import read_mazes
from simmer_tui.trials.requirement import Requirement
from simmer_tui.trials.sequential import MARGIN, SequentialTest, sequential_test
from simmer_tui.trials.sweep import SweepPoint, points_of
from simmer_tui.trials.sweep_summary import (
    CURVES,
    curves_csv,
    sweep_document,
    sweep_page,
)
from simmer_tui.trials.trial import TIME_LIMIT, TrialResult, driven_by_boards, timed_seconds
from simmer_tui.trials.trials_page import trials_page
from simmer_tui.trials.trials_summary import runs_table, trials_document

if TYPE_CHECKING:
    from simmer_tui.sketch.sketch_robot import SketchSet


@subcommand("trials", add_trials_options, usage='simmer-tui trials --run "CMD ..." [options]')
def run_trials(options: argparse.Namespace) -> int:
    """Run a program many times, each time with its own simulator, ports, seed, start, block and drop zone,
    and show how often it succeeds and where it fails. With a mission.toml in the configuration set, success
    is to do the mission; without one it is exit code 0."""
    _check_sure(options)
    if options.dask is not None:
        check_package()
    folder = _resumed(options) if options.resume else _begun(options)
    test = None if options.sure is None else _test(options, folder.plan.runs)
    requirement = Requirement(options.require, test)
    if requirement.announcement:
        say(f"simmer-tui trials: {requirement.announcement}")
    if not sys.stderr.isatty():
        runs = f"{requirement.to_do_text(folder)} to do, seed {folder.plan.seed}"
        say(f"simmer-tui trials: {runs}, results in {typed_path(folder.path)}")
    code, why = run_to_end(lambda: _run_all(folder, options, requirement))
    if code is ExitCode.DONE and options.why is not None:
        code, why = run_to_end(lambda: _explain(folder, options))
    if folder.results:
        _show(folder, requirement, as_json=options.json)
    if code is not ExitCode.DONE:
        done = "" if folder.results else "no run is done: "
        say(f"simmer-tui trials: {done}{why}; to resume: {_continuation(folder, options)}")
        return code
    if outcome := requirement.outcome(folder):
        say(f"simmer-tui trials: {outcome}")
    return ExitCode.DONE if requirement.is_met(folder) else ExitCode.NO


def _continuation(folder: TrialFolder, options: argparse.Namespace) -> str:
    """Command that continues trials that were interrupted."""
    why = "" if options.why is None else f" --why {options.why}"
    return f"simmer-tui trials --resume --out {typed_path(folder.path)}{why}"


# -- what is to be done ----------------------------------------------------------------------------


def _begun(options: argparse.Namespace) -> TrialFolder:
    """A new set of trials. Raises TrialsError, ProgramError, ConfigurationError."""
    if options.run is not None:
        check_no_shell(options.run)
    elif options.sketch is None:
        raise TrialsError('--run is missing: give the program, such as --run "python my_robot.py"')
    overrides = overrides_from(options)
    if options.sketch is not None:
        from simmer_tui.cli.sketch_option import sketch_set

        options.config = sketch_set(options, overrides, "simmer-tui trials")
    directory = find_mission_set(options.config)
    configuration = load(directory, overrides)
    if options.run is None and configuration.mission is None:
        raise TrialsError(
            "--run is missing: boards without a program need a mission to end the run; give the program, "
            f"or add a mission.toml to {cut(configuration.name)}"
        )
    points = points_of(options.vary)
    _check(configuration, overrides, points)
    mazes = {} if options.mazes is None else read_mazes(options.mazes)
    sketches: SketchSet | None = None
    programs: dict[str, str] = {}
    if options.sketch is not None:
        _check_program(options, options.run or "")  # before anything is compiled
        configuration, sketches, programs = _compiled(options, configuration)
    plan = TrialPlan(
        command=options.run or "",
        runs=options.runs or (DEFAULT_RUNS if options.sure is None else _test(options).cap),
        seed=configuration.settings.run_seed(),
        configuration=configuration.name,
        settings=_kept(overrides),
        mazes=tuple(mazes),
        random_mazes=bool(options.random_mazes),
        fixed_ports=bool(options.fixed_ports),
        time_limit=options.time_limit or TIME_LIMIT + timed_seconds(configuration),
        points=points,
        sketch_set=str(directory.absolute()) if programs else "",
        sketches=programs,
    )
    _check_plan(options, plan, configuration)
    _check_program(options, plan.command)
    path = options.out or new_folder(Path(), PREFIX)
    return TrialFolder.create(path, plan, configuration.texts, mazes, sketches)


def _check(
    configuration: Configuration, overrides: dict[str, Override], points: Sequence[SweepPoint]
) -> None:
    problems = []
    if not configuration.settings.sim:
        problems.append(Problem("trials", "are for the simulated robot; leave out --serial"))
    if configuration.mission is not None:
        problems += without_effect(overrides, {name for point in points for name in point})
    if problems:
        raise ConfigurationError(problems)


def _check_program(options: argparse.Namespace, command: str) -> None:
    """Refuse a program that is not there: all runs would fail for that reason. Raises TrialsError."""
    # Boards may drive without one.
    if not command:
        return
    # The machines of a cluster have programs of their own. Scripts are sent there.
    if options.dask is not None and not is_python("".join(command.split()[:1])):
        return
    if missing := missing_program(command):
        raise TrialsError(f"--run {cut(command)!r}: {missing}")


def _compiled(
    options: argparse.Namespace, configuration: Configuration
) -> tuple[Configuration, SketchSet, dict[str, str]]:
    """The configuration of runs with boards, their compiled sketches, and files and hashes of those. Raises
    TrialsError, ConfigurationError."""
    # Few trials have boards.
    from simmer_tui.cli.sketch_option import compiled
    from simmer_tui.sketch.sketch_robot import logged_sketches

    # Other machines have other compilers.
    if options.dask is not None:
        raise TrialsError("--dask: boards run on this machine only: leave out --dask")
    made, sketches = compiled(configuration)
    return driven_by_boards(made), sketches, logged_sketches(sketches)


def _check_sure(options: argparse.Namespace) -> None:
    if options.sure is None:
        if options.margin is not None:
            raise TrialsError("--margin needs --sure: a program fails so far below the rate of --require")
        return
    if options.require is None:
        raise TrialsError("--sure needs a rate to decide on: add --require RATE")


def _test(options: argparse.Namespace, cap: int | None = None) -> SequentialTest:
    """The test of --require and --sure. Raises TrialsError."""
    margin = MARGIN if options.margin is None else options.margin
    return sequential_test(options.require, margin, 1.0 - options.sure, cap or options.runs)


def _check_plan(options: argparse.Namespace, plan: TrialPlan, configuration: Configuration) -> None:
    """Refuse options that do not go with the plan. Raises TrialsError."""
    if options.dask is not None and configuration.devices:
        names = ", ".join(device.path for device in configuration.devices)
        raise TrialsError(f"--dask: {names} of the set runs on this machine only: leave out --dask")
    for option, value in (("--sure", options.sure), ("--why", options.why)):
        if value is not None and plan.points:
            raise TrialsError(f"{option} is for one program as it is, not for trials with --vary")
    if plan.fixed_ports and (options.dask is not None or (options.jobs or 1) > 1):
        raise TrialsError("--fixed-ports is for one run at a time: leave out --jobs and --dask")
    if options.dask is not None:
        pack(plan.command, Path())  # a program that cannot be sent is named before a folder is made


def _kept(overrides: dict[str, Override]) -> dict[str, Any]:
    """The options that override settings.toml; the seed is saved separately."""
    return {name: each.value for name, each in overrides.items() if name not in ("seed", "randerror")}


def _resumed(options: argparse.Namespace) -> TrialFolder:
    """A set of trials to continue; repeated options must have their first values. While no run is done,
    another program replaces one that was mistyped. Raises TrialsError, ConfigurationError."""
    path = options.out or newest_folder(PREFIX, PLAN, Path())
    if path is None:
        raise TrialsError("there are no trials here to resume: name their folder with --out")
    folder = TrialFolder.read(path)
    command = folder.plan.command if folder.results else options.run or folder.plan.command
    plan = structs.replace(folder.plan, command=command)
    overrides = overrides_from(options)
    settings = _kept(overrides)
    given: dict[str, tuple[object, object]] = {
        "--run": (options.run, plan.command),
        "--random-mazes": (options.random_mazes, plan.random_mazes),
        "--fixed-ports": (options.fixed_ports, plan.fixed_ports),
        "--time-limit": (options.time_limit, plan.time_limit),
    }
    if "seed" in overrides:
        given["--seed"] = (str(overrides["seed"].value), str(plan.seed))
    if options.sketch is not None:
        from simmer_tui.cli.sketch_option import sketch_set

        sketch_set(options, overrides, "simmer-tui trials")  # refuses what does not go with it
        if not plan.sketches:
            given["--sketch"] = (options.sketch, "")
    if options.config is not None:
        name = load(find_set(options.config), overrides).name
        given["--config"] = (name, plan.configuration)
    if options.mazes is not None:
        given["--mazes"] = (tuple(read_mazes(options.mazes)), plan.mazes)
    if options.vary:
        given["--vary"] = (points_of(options.vary), plan.points)
    if settings:
        given["an option of the settings"] = (settings, dict(plan.settings))
    for option, (value, before) in given.items():
        if value is not None and value != before:
            raise TrialsError(
                f"{option} differs from that of these trials ({cut(str(before)) or 'none'}): leave it "
                "out to resume, or start new trials with another --out"
            )
    runs = options.runs or plan.runs
    if runs < plan.runs:
        raise TrialsError(f"--runs {runs} is less than the {plan.runs} runs planned for these trials")
    _check_plan(options, plan, folder.configuration)
    plan = structs.replace(plan, runs=runs)
    if plan.sketches:
        plan = _with_sketches(options, folder, plan)
    if plan != folder.plan:
        folder.write_plan(plan)
    if folder.to_do:
        _check_program(options, plan.command)
    return folder


def _with_sketches(options: argparse.Namespace, folder: TrialFolder, plan: TrialPlan) -> TrialPlan:
    """The plan with the folder of its sketches, which are compiled if there are runs to do. Raises
    TrialsError, ConfigurationError."""
    # A folder that is named again is compared, even if no run is left.
    is_used = plan.runs > folder.plan.runs or folder.to_do or options.why is not None
    if options.sketch is None and not is_used:
        return plan
    directory = Path(plan.sketch_set) if options.sketch is None else find_set(options.sketch).absolute()
    if not directory.is_dir():
        raise TrialsError(
            f"the set of these trials is not in {directory}: name where it is with --sketch DIR"
        )
    here = structs.replace(folder.configuration, directory=directory)
    _, sketches, now = _compiled(options, here)
    if changed := [name for name, before in plan.sketches.items() if now.get(name) != before]:
        before = ", ".join(f"{name}: {plan.sketches[name]}" for name in changed)
        raise TrialsError(
            f"the sketches in {directory} differ from those of these trials ({cut(before)}): put them back "
            "to resume, or start new trials with another --out"
        )
    folder.use_sketches(sketches, directory)
    return structs.replace(plan, sketch_set=str(directory))


# -- doing it --------------------------------------------------------------------------------------


def _run_all(folder: TrialFolder, options: argparse.Namespace, requirement: Requirement) -> None:
    """Do the planned runs, until they are enough. Raises TrialsError, ClusterError."""
    numbers = folder.to_do
    needed = takewhile(lambda number: not requirement.has_enough(folder), numbers)
    trials = (folder.trial(number) for number in needed)
    columns = MofNCompleteColumn(), TextColumn("{task.fields[rate]}"), TimeElapsedColumn(), RemainingColumn()
    with contextlib.ExitStack() as stack:
        source: Generator[TrialResult, None, None]
        if options.dask is not None:
            from simmer_tui.trials import cluster

            client = stack.enter_context(cluster.connect(options.dask))
            cluster.check_workers(client)
            program = pack(folder.plan.command, Path())
            source = cluster.run_on_cluster(trials, program, folder.runs, client)
        else:
            source = run_locally(trials, folder.runs, min(_jobs(folder, options), max(len(numbers), 1)))
        results = stack.enter_context(contextlib.closing(source))
        stack.enter_context(folder.store.locked())
        progress = stack.enter_context(progress_bar("trials", *columns, stays=True))
        task = progress.add_task("", total=folder.plan.total, completed=len(folder.done), rate="")
        for result in results:
            folder.append(result)
            done = folder.done
            successes = sum(each.success for each in done)
            progress.update(task, completed=len(done), rate=f"{successes} of {len(done)} succeeded")


def _jobs(folder: TrialFolder, options: argparse.Namespace) -> int:
    """The number of runs at a time."""
    return 1 if folder.plan.fixed_ports else options.jobs or os.cpu_count() or 1


def _explain(folder: TrialFolder, options: argparse.Namespace) -> None:
    """Run failed runs again with changes. Raises TrialsError, ConfigurationError."""
    with contextlib.closing(
        Explanations(FolderRuns(folder)).explain(options.why, _jobs(folder, options))
    ) as changed:
        for each in changed:
            end = {True: "succeeds", False: "fails", None: "has no result"}[each.succeeded]
            other = f" and other errors ({each.repeat})" if each.repeat else ""
            say(f"simmer-tui trials: run {each.run} {end} with {each.change}{other}")


# -- the answer ------------------------------------------------------------------------------------


def _show(folder: TrialFolder, requirement: Requirement, *, as_json: bool) -> None:
    """Write the files of the answer and print it."""
    files = {TABLE: table_csv(runs_table(folder))}
    if folder.plan.points:
        files[CURVES] = curves_csv(folder)
        wanted = requirement.sweep_rate
        answer, page = sweep_document(folder, wanted), sweep_page(folder, wanted)
    else:
        answer = trials_document(folder, requirement)
        page = trials_page(folder, write_run_pages(folder), requirement)
    files[REPORT_PAGE] = html_page(page)
    written = [str(folder.store.write(name, text)) for name, text in files.items()]
    print_answer(answer, as_json=as_json)
    if not as_json:
        print_lines(f"Wrote {' and '.join(written)}")
