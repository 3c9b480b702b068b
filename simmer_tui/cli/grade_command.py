"""`simmer-tui grade`: a course's programs on the same missions, each in a sandbox, and the score of each."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import os
import secrets
import shutil
from pathlib import Path

from simmer_tui.cli.command_line import (
    ExitCode,
    OneLineParser,
    add_flag,
    add_json_option,
    add_value,
    print_answer,
    say,
    subcommand,
    window_console,
)
from simmer_tui.cli.trials_options import add_place_options, newest_folder, run_to_end
from simmer_tui.config.settings import CLOCKS
from simmer_tui.document.as_data import table_csv
from simmer_tui.errors import GradeError
from simmer_tui.grade import bubblewrap
from simmer_tui.grade.course import LONG, PLAN_FILE, Course, not_teams, read_course, shown_name
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.grading import check_isolation, grade, here, what_is_missing
from simmer_tui.grade.sandbox import Isolation
from simmer_tui.grade.site import INDEX, grades_document, grades_table, gradescope_json, junit_xml, site
from simmer_tui.grade.team_result import TeamResult, TeamStatus, team_results
from simmer_tui.runlog.writer import new_folder
from simmer_tui.sim.command import counted, typed_path
from simmer_tui.sim.noise import SEED_BITS, SEEDS
from simmer_tui.trials.cluster import check_package
from simmer_tui.trials.sequential import CAP_RULE, MARGIN, RATE_RULE, REQUIRED_RATE, shown_test
from simmer_tui.trials.trial import TrialResult

_OF_COURSE = ("require", "margin", "cap", "clock")
"""Options in place of the course's own key of that name."""
GRADES_TABLE, JUNIT_FILE, _GRADESCOPE, _SITE = "grades.csv", "junit.xml", "gradescope", "site"
_PREFIX = "grade_"


def _options(parser: OneLineParser) -> None:
    parser.add_argument("target", metavar="COURSE", nargs="?", type=Path, help="teams.toml, or a folder")
    parser.add_argument("--course", metavar="FILE", type=Path, help="a course.toml with the requirements")
    text = "COURSE is one team's own folder: the same check, for students"
    add_flag(parser, "--practice", text, default=None)
    text = f"success rate that passes (default {REQUIRED_RATE:g})"
    add_value(parser, "--require", RATE_RULE, text, metavar="RATE")
    text = f"a success rate this much lower fails (default {MARGIN:g})"
    add_value(parser, "--margin", RATE_RULE, text, metavar="RATE")
    add_value(parser, "--cap", CAP_RULE, "most runs of a team")
    parser.add_argument(
        "--clock", choices=CLOCKS, help="clock of the runs, in place of that of the course's set"
    )
    parser.add_argument(
        "--isolation",
        choices=[each.value for each in Isolation],
        help="the sandbox of programs (default bwrap; with --practice none where there is no bubblewrap)",
    )
    add_value(parser, "--seed", SEEDS, "seed of an earlier grading, to repeat it (default: a secret one)")
    add_place_options(parser)
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        help=f"folder of the grading (default {_PREFIX}DATE_TIME, outside folders of teams)",
    )
    add_flag(parser, "--resume", "resume the grading in the folder of --out")
    parser.add_argument(
        "--regrade",
        metavar="TEAM",
        action="append",
        default=[],
        help="grade a team again, with its present files",
    )
    parser.add_argument(
        "--hide-names",
        action=argparse.BooleanOptionalAction,
        help="codes in place of names on the pages (kept for --resume and --regrade)",
    )
    add_json_option(parser)


@subcommand("grade", _options, usage="simmer-tui grade COURSE [options]")
def run_grade(options: argparse.Namespace) -> int:
    """Grade the programs of a course. All get the same missions from a secret seed. Each runs in its own
    sandbox, and so does each board where teams hand in sketches, with as few runs as a sequential test needs
    to decide. COURSE is a teams.toml, or a folder with one folder a team."""
    if options.dask is not None:
        check_package()
    folder = _resumed(options) if options.resume or options.regrade else _begun(options)
    say(f"simmer-tui grade: {counted(len(folder.entries), 'team')}, results in {typed_path(folder.path)}")
    say(f"simmer-tui grade: {shown_test(folder.test)}")
    isolation = _isolation_line(folder.plan.isolation, is_here=options.dask is None)
    say(f"simmer-tui grade: {isolation}")
    code, why = run_to_end(lambda: _run_all(folder, options))
    found = team_results(folder, hidden=False)
    _write(folder, found, isolation)
    print_answer(grades_document(folder, found, isolation), as_json=options.json)
    if code is not ExitCode.DONE:
        say(f"simmer-tui grade: {why}; to resume: simmer-tui grade --resume --out {typed_path(folder.path)}")
        return code
    return ExitCode.DONE if all(each.status is TeamStatus.PASSED for each in found) else ExitCode.NO


# -- what is to be done ----------------------------------------------------------------------------


def _begun(options: argparse.Namespace) -> GradeFolder:
    if options.target is None:
        raise GradeError("name the course: a teams.toml, or a folder with one folder a team")
    course = read_course(
        options.target, options.course, alone=bool(options.practice), is_here=options.dask is None
    )
    given = {name: value for name in _OF_COURSE if (value := getattr(options, name)) is not None}
    course = dataclasses.replace(course, **given)
    if others := not_teams(course):
        names = ", ".join(map(shown_name, others))
        say(f"simmer-tui grade: not graded, because they are links or archives: {names}")
    isolation = _isolation(options)
    path = options.out or _usual_place(course)
    seed = secrets.randbits(SEED_BITS) if options.seed is None else options.seed
    _check_outside(path, course)
    if options.dask is None:
        check_isolation(isolation, path, course)
    return GradeFolder.create(path, course, seed, isolation, hides_names=bool(options.hide_names))


def _usual_place(course: Course) -> Path:
    """A new folder here, or in the nearest folder above that is outside the teams' folders."""
    place = Path()
    while place.resolve() != Path(place.resolve().anchor) and any(
        _is_in(place, folder) for folder in _not_in(course)
    ):
        place = place / ".."
    return new_folder(place, _PREFIX)


def _not_in(course: Course) -> list[Path]:
    """Folders of teams, and folders in which each folder is a team."""
    return [*course.team_folders, *(team.folder for team in course.teams)]


def _is_in(path: Path, folder: Path) -> bool:
    return path.resolve().is_relative_to(folder.resolve())


def _isolation(options: argparse.Namespace) -> Isolation:
    if options.isolation is not None:
        return Isolation(options.isolation)
    if options.practice and what_is_missing(Isolation.BWRAP):
        return Isolation.NONE
    return Isolation.BWRAP


def _check_outside(path: Path, course: Course) -> None:
    """Refuse a folder of a team, since the grading would be submitted with it, and a folder of teams, since
    it would count as a team."""
    for team in course.teams:
        if _is_in(path, team.folder):
            raise GradeError(
                f"the grading would lie in the folder of {shown_name(team.name)}: name another --out"
            )
    for folder in course.team_folders:
        if _is_in(path, folder):
            raise GradeError(
                f"the grading would lie in {shown_name(str(folder), LONG)}, where each folder is a team: "
                "name another --out"
            )


def _resumed(options: argparse.Namespace) -> GradeFolder:
    for name in ("target", "course", "practice", *_OF_COURSE, "seed", "isolation"):
        if getattr(options, name) is not None:
            raise GradeError(
                "--resume and --regrade take course and options from the grading: name its folder with "
                "--out, and at most --jobs, --dask and --hide-names"
            )
    # A grading begun in a team's folder lies above it.
    path = options.out or newest_folder(_PREFIX, PLAN_FILE, Path(), Path(".."))
    if path is None:
        raise GradeError("there is no grading here to resume: name its folder with --out")
    folder = GradeFolder.read(path)
    if options.dask is None:
        check_isolation(folder.plan.isolation, path, folder.course)
    for name in options.regrade:
        folder.regrade(name)
    if options.hide_names is not None:
        folder.hide_names(hidden=options.hide_names)
    return folder


# -- doing it --------------------------------------------------------------------------------------


def _run_all(folder: GradeFolder, options: argparse.Namespace) -> None:
    """Do the planned runs. Raises GradeError, TrialsError, ClusterError."""
    console = window_console(stderr=True)
    with contextlib.ExitStack() as stack:
        source = here(folder, options.jobs or os.cpu_count() or 1)
        if options.dask is not None:
            from simmer_tui.grade.grading import on_cluster
            from simmer_tui.trials import cluster

            client = stack.enter_context(cluster.connect(options.dask))
            cluster.check_workers(client)
            source = on_cluster(folder, client)
        stack.enter_context(folder.store.locked())
        status = stack.enter_context(console.status("")) if console.is_terminal else None

        def show(result: TrialResult) -> None:
            if status is not None:
                left = sum(folder.is_open(entry) for entry in folder.entries)
                runs = sum(len(entry.results) for entry in folder.entries)
                status.update(f"{counted(runs, 'run')} done, {counted(left, 'team')} undecided")

        grade(folder, source, show)


# -- the answer ------------------------------------------------------------------------------------


def _write(folder: GradeFolder, found: list[TeamResult], isolation: str) -> None:
    """Write the files of the answer. Raises GradeError."""
    files = {GRADES_TABLE: table_csv(grades_table(folder, found)), JUNIT_FILE: junit_xml(folder, found)}
    for each in found:
        if each.status is TeamStatus.UNDER_WAY:
            continue  # Gradescope would show 0 points and "failed"
        files[f"{_GRADESCOPE}/{each.entry.team.slug}/results.json"] = gradescope_json(folder, each)
    shown = team_results(folder, hidden=True) if folder.plan.hides_names else found
    files |= {f"{_SITE}/{page}": text for page, text in site(folder, shown, isolation).items()}
    for name in (_SITE, _GRADESCOPE):  # possibly with other names before, or decisions
        shutil.rmtree(folder.path / name, ignore_errors=True)
    for name, text in files.items():
        folder.store.write(name, text)
    written = f"{GRADES_TABLE}, {JUNIT_FILE}, {_GRADESCOPE}/ and {_SITE}/{INDEX}"
    say(f"simmer-tui grade: wrote {typed_path(folder.path)}/{written}")


def _isolation_line(isolation: Isolation, *, is_here: bool) -> str:
    """The sandbox of the programs and the limits of a run, in words. On a cluster each worker has its own."""
    if isolation is Isolation.NONE:
        return (
            "Programs run without a sandbox. They can read the seed, logs and results of this grading, and "
            "reach the network."
        )
    limited = "The engine limits memory and processes of each run."
    if isolation is Isolation.BWRAP:
        limited = bubblewrap.limits_text() if is_here else "Each worker of the cluster sets its own limits."
    return (
        f"Programs run in a sandbox of {isolation.value}. {limited} The sandbox does not hide the kernel, "
        "the time of day, or how busy the processors are."
    )
