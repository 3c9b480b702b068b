"""The clock of a run of trials or of a grading: which one is asked for, and which one it was."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from msgspec.structs import replace

from simmer_tui.config.dialects import TEAM
from simmer_tui.config.loader import Configuration
from simmer_tui.config.settings import AUTO_CLOCK, ELSE_REAL
from simmer_tui.phrases import computing_text, counted
from simmer_tui.trials.trial import TrialResult

REAL = "real"
"""The real clock, and `timed` motion by it."""


def clock_of(configuration: Configuration) -> str:
    """The clock that the runs of a set are to have: a choice of the setting `clock`, but not `auto`."""
    clock = configuration.settings.motion.clock
    if clock != AUTO_CLOCK:
        return clock
    return "program" if TEAM in configuration.settings.server.listeners else REAL


def with_clock(configuration: Configuration, clock: str) -> Configuration:
    """The same set, with a clock."""
    settings = configuration.settings
    return replace(configuration, settings=replace(settings, motion=replace(settings.motion, clock=clock)))


def timing_of(configuration: Configuration) -> str:
    """The clock of the runs of a set, as `MotionSettings.timing` has it."""
    return with_clock(configuration, clock_of(configuration)).settings.motion.timing


def timed_seconds(configuration: Configuration) -> float:
    """Real time of a mission by its time limit, seconds: 0 unless its runs may go by the real clock."""
    motion, mission = configuration.settings.motion, configuration.mission
    by_real_clock = timing_of(configuration) == "timed" or clock_of(configuration) == ELSE_REAL
    if not by_real_clock or mission is None:
        return 0.0
    return mission.time_limit / motion.time_scale


def clocks_text(results: Sequence[TrialResult]) -> str | None:
    """The clocks of some runs, with their counts if there are several; None for runs of older versions."""
    counts = Counter(result.clock for result in results if result.clock)
    if len(counts) < 2:
        return next(iter(counts), None)
    return ", ".join(f"{clock} ({count})" for clock, count in sorted(counts.items()))


def clock_sentences(configuration: Configuration, results: Sequence[TrialResult]) -> list[str]:
    """Which clock the runs had, and why some had another than they should."""
    timings = {REAL: "timed"}
    clocks = sorted({timings.get(each.clock, each.clock) for each in results if each.clock})
    said = [computing_text(each) for each in clocks or [timing_of(configuration)]]
    notes = Counter((each.clock, each.clock_note) for each in results if each.clock_note)
    for (clock, note), count in notes.items():
        runs = counted(count, "run")
        if clock == REAL:
            said.append(f"{runs} went by the real clock: {note}.")
        else:
            said.append(
                f"{runs} ended where the program's clock cannot follow: {note}. Use --clock real, or "
                f'clock = "{ELSE_REAL}", which repeats such runs.'
            )
    return said
