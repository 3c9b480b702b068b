"""A progress bar for work on long logs, where there is a terminal to show it."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import Console
from rich.progress import (
    BarColumn,
    DownloadColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

_EVERY = 500


def run_through(positions: Iterable[int], size: int, what: str) -> None:
    """Go through the steps of some work, each the number of bytes done of `size`.

    On a terminal (standard error) a bar shows how far it is and goes away at the end.
    """
    console = Console(stderr=True)
    columns = (
        TextColumn(what, markup=False),
        BarColumn(),
        TaskProgressColumn(),
        DownloadColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(what, total=size)
        for step, position in enumerate(positions):
            if step % _EVERY == 0:
                progress.update(task, completed=position)
