"""A report on the terminal."""

from __future__ import annotations

from rich import box
from rich.console import Console, JustifyMethod
from rich.table import Table as RichTable
from rich.text import Text

from simmer_tui.report.content import Table, tables
from simmer_tui.report.findings import findings
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.sim.command import printable


def print_report(run: RunStatistics, console: Console) -> None:
    """Print findings and tables. Text of the log is never taken for markup."""
    plain = console.options.ascii_only
    first, *others = tables(run, plain=plain)
    print_table(first, console)
    console.print(Text("What happened", style="bold"))
    for finding in findings(run):
        console.print(Text(f"- {printable(finding)}"))
    console.print()
    for table in others:
        print_table(table, console)
    for note in run.notes:
        console.print(Text(f"note: {printable(note)}", style="yellow"))


def print_table(table: Table, console: Console) -> None:
    """Print a table. Its text is never taken for markup, nor let steer the terminal."""
    has_header = any(column.name for column in table.columns)
    made = RichTable(
        title=Text(printable(table.title), style="bold"),
        title_justify="left",
        box=box.SIMPLE_HEAD,
        show_header=has_header,
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    for column in table.columns:
        justify: JustifyMethod = "right" if column.numeric else "left"
        made.add_column(Text(column.name), justify=justify, overflow="fold", no_wrap=not column.wraps)
    for row in table.rows:
        made.add_row(*[_cell(text) for text in row])
    console.print(made)
    if table.note:
        console.print(Text(printable(table.note), style="dim"))
        console.print()


def _cell(text: str) -> Text:
    """A cell, of several lines if its text has some; what comes from a log was escaped before."""
    return Text("\n".join(map(printable, text.split("\n"))))
