"""Bars on standard error that show how far some work is."""

from __future__ import annotations

from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn

from simmer_tui.cli.command_line import window_console


def progress_bar(text: str, *columns: ProgressColumn, stays: bool = False) -> Progress:
    """A bar for one task, hidden where standard error is no terminal.

    Args:
        text: Text before the bar, with fields of the task, such as `{task.description}`.
        columns: What stands behind the bar.
        stays: True to leave the bar on the screen at the end.
    """
    console = window_console(stderr=True)
    return Progress(
        TextColumn(text, markup=False),
        BarColumn(),
        *columns,
        console=console,
        transient=not stays,
        disable=not console.is_terminal,
    )
