"""A page for each failed run of a set of trials, which plays it."""

from __future__ import annotations

from itertools import zip_longest

from simmer_tui.errors import ConfigurationError, RunLogError
from simmer_tui.report.content import report_page
from simmer_tui.report.run_statistics import report_of
from simmer_tui.runlog.reader import LogReader
from simmer_tui.trials.failures import counted_causes
from simmer_tui.trials.folder import RUNS, TrialFolder

# Each page takes time and room, and nobody looks at more runs than these.
MOST = 60
"""Most pages of a set of trials."""
# A longer log makes a page that browsers open slowly.
_LARGEST = 20_000_000
"""Bytes of a log that a page is made of."""
_SUFFIX = ".html"


def write_run_pages(folder: TrialFolder) -> dict[int, str]:
    """Write the pages that are not there yet, of failed runs whose logs are here, the first ones of every
    cause. Returns them by the runs' numbers, as they are linked to from the folder. Raises TrialsError."""
    pages: dict[int, str] = {}
    for number in _most_telling(folder):
        log = folder.log(number)
        if len(pages) >= MOST or not log.exists() or log.stat().st_size > _LARGEST:
            continue
        name = f"{RUNS}/{folder.trial(number).name}{_SUFFIX}"
        page = folder.path / name
        if not page.exists() or page.stat().st_mtime_ns < log.stat().st_mtime_ns:
            try:
                with LogReader(log) as reader:
                    folder.write(name, report_page(report_of(reader), log.name))
            except (RunLogError, ConfigurationError):
                continue  # it says so itself when it is reported on
        pages[number] = name
    return pages


def _most_telling(folder: TrialFolder) -> list[int]:
    """The failed runs, the causes taking turns: a rare one is not crowded out."""
    turns = zip_longest(*(group for _, group in counted_causes(folder.done)))
    return [result.number for turn in turns for result in turn if result is not None]
