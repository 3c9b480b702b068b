"""The options of `simmer-tui trials`, and those that other commands share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from simmer_tui.cli.command_line import (
    ExitCode,
    OneLineParser,
    OptionGroup,
    add_config_option,
    add_flag,
    add_json_option,
    add_run_option,
    add_setting_options,
    add_sketch_option,
    add_trust_option,
    add_value,
)
from simmer_tui.config.sets import MISSION_SET
from simmer_tui.errors import ClusterError
from simmer_tui.sim.rules import IntegerRule, NumberRule
from simmer_tui.trials.explanations import EXPLAINED
from simmer_tui.trials.sequential import MARGIN, RATE_RULE, REQUIRED_RATE
from simmer_tui.trials.trial import TIME_LIMIT

DEFAULT_RUNS = 100
"""Runs without --runs: their success rate is known to 10 percentage points (Wilson, 95 %)."""
PREFIX = "trials_"


def newest_folder(prefix: str, plan: str, *places: Path) -> Path | None:
    """The newest folder with a plan in the first of these places that has one."""
    found = (max(place.glob(f"{prefix}*/{plan}"), default=None) for place in places)
    return next((path.parent for path in found if path is not None), None)


def run_to_end(work: Callable[[], None]) -> tuple[ExitCode, str]:
    """Do runs, all or as many as are needed. Returns DONE, or another code with the reason for an early
    end."""
    try:
        work()
    except KeyboardInterrupt:
        return ExitCode.INTERRUPTED, "interrupted"
    except ClusterError as error:
        return ExitCode.LOST, str(error)
    return ExitCode.DONE, ""


_COUNT = IntegerRule(1, 1_000_000)


def add_place_options(parser: OptionGroup) -> None:
    """The options `--jobs` and `--dask`: where the runs are done."""
    add_value(parser, "--jobs", _COUNT, "runs at a time (default: the number of processors)")
    parser.add_argument(
        "--dask", metavar="ADDRESS", help="send the runs to a Dask cluster (needs simmer-tui[dask])"
    )


def add_trials_options(parser: OneLineParser) -> None:
    """Add the options of the command."""
    group = parser.add_argument_group("trials")
    add_run_option(group, "the program; it gets SIMMER_PORT and other variables (docs/trials.md)")
    add_value(
        group, "--runs", _COUNT, f"number of runs (default {DEFAULT_RUNS}); with --vary, for each value"
    )
    add_config_option(group, f"./config with a mission.toml, else {MISSION_SET}")
    add_sketch_option(group)
    mazes = group.add_mutually_exclusive_group()
    mazes.add_argument(
        "--mazes",
        metavar="DIR",
        type=Path,
        help="a folder of files like maze.csv, which the runs take in turn",
    )
    text = "a new maze for every run, of the size of the set's maze and with as many walls"
    add_flag(mazes, "--random-mazes", text, default=None)
    text = "always the ports of the settings, for programs with 9000 built in; one run at a time"
    add_flag(group, "--fixed-ports", text, default=None)
    usual = f"{TIME_LIMIT:g}, with timed motion the mission's time limit more"
    text = f"longest real time of a run (default {usual})"
    add_value(group, "--time-limit", NumberRule(0.01, 1e6), text, metavar="SECONDS")
    add_place_options(group)
    group.add_argument(
        "--out", metavar="DIR", type=Path, help=f"folder of the results (default {PREFIX}DATE_TIME)"
    )
    text = (
        "continue the trials in the folder (default: the newest here); --runs may ask for more, and "
        "--run for another program while no run is done"
    )
    add_flag(group, "--resume", text)
    text = (
        "exit code 1 if the success rate is below RATE, 0 to 1; with --vary, if no value of a name "
        f"reaches RATE. The answer to --vary uses RATE, too (default {REQUIRED_RATE:g})"
    )
    add_value(group, "--require", RATE_RULE, text, metavar="RATE")
    text = (
        "with --require: decide by a sequential test, with as few runs as possible. A program with "
        "RATE passes, and one with RATE - MARGIN fails, at least this often, such as 0.95; --runs is the cap"
    )
    add_value(group, "--sure", NumberRule(0.501, 0.9999), text, metavar="CONFIDENCE")
    text = f"with --sure: a success rate this much below RATE fails (default {MARGIN:g})"
    add_value(group, "--margin", RATE_RULE, text, metavar="MARGIN")
    group.add_argument(
        "--vary",
        metavar="NAME=VALUE,VALUE...",
        action="append",
        default=[],
        help="a sweep: --runs N, with the same seeds, for each value of a setting (strength, "
        "motion.time_scale) or of a column of one sensor or drive (u1.percent_error). Of several --vary, "
        "each is varied alone. Semicolons separate values that have commas",
    )
    text = (
        f"then run N failed runs (default {EXPLAINED}) again with the same seed and one change at "
        "a time, such as true readings of one sensor, and say which change made them succeed"
    )
    add_value(group, "--why", _COUNT, text, nargs="?", const=EXPLAINED)
    add_json_option(parser)
    add_trust_option(parser)
    add_setting_options(parser)
    parser.common_settings = ("seed", "realistic")
