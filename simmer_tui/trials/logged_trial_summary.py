"""The answer of `simmer-tui why` as a document."""

from __future__ import annotations

from msgspec.structs import replace

from simmer_tui.document.model import DataColumn, DataTable, Document, DocumentPart, Paragraph, data_table
from simmer_tui.sim.command import counted
from simmer_tui.trials.chance_control import CONTROL, ChanceControl, control_table
from simmer_tui.trials.explanations import ChangedRun
from simmer_tui.trials.logged_trial import LoggedTrial

TRIED = data_table(
    "tried",
    "One change at a time",
    DataColumn("change", wraps=True),
    DataColumn("result", heading="this run"),
    DataColumn("text", hidden=True),
)
REPEATED = replace(CONTROL, columns=CONTROL.columns[1:])
"""The control for chance, without the number of the run: there is only one."""
TABLES = (TRIED, REPEATED)
"""All tables of the answer."""
_NOT_REPEATED = (
    "Random numbers of the program itself, or its real time, differ from run to run. Give them a fixed seed, "
    "or measure the success rate with simmer-tui trials."
)


def why_document(logged: LoggedTrial) -> Document:
    """The change that makes a run succeed, with the counts of its repeats, and all tried changes."""
    explanation = logged.explanation
    done = {each.change: each for each in logged.changed if not each.repeat}
    own = [done[change] for change in logged.explanations.planned if change in done]
    headline = " ".join(_sentence(each) for each in explanation.controls if each.change in explanation.sure)
    parts: list[DocumentPart] = []
    if headline:
        parts.append(Paragraph(headline, "headline", "strong"))
    parts.append(Paragraph(explanation.text, "answer", "" if headline else "strong"))
    if len(own) == 1 and own[0].succeeded:
        parts.append(Paragraph(_NOT_REPEATED, kind="note"))
    parts.append(TRIED.filled([_row(each) for each in own]))
    if explanation.controls:
        parts.append(_repeats(explanation.controls))
    runs = counted(len(logged.changed), "run")
    parts.append(Paragraph(f"{runs} with seed {logged.trial(1).seed}.", kind="note"))
    return Document("Why", parts)


def _sentence(control: ChanceControl) -> str:
    count = control.pairs.count
    return (
        f"With {control.change} it succeeds: {control.successes} of {count}; "
        f"unchanged {control.unchanged} of {count}."
    )


def _row(each: ChangedRun) -> tuple[object, ...]:
    result = {True: "succeeds", False: "fails", None: "no result"}[each.succeeded]
    return (each.change, result, each.text)


def _repeats(controls: tuple[ChanceControl, ...]) -> DataTable:
    """The table of repeats."""
    return REPEATED.filled([row[1:] for row in control_table([(1, each) for each in controls]).rows])
