"""The answer of `simmer-tui why` as a document."""

from __future__ import annotations

from simmer_tui.document.formats import COUNT
from simmer_tui.document.model import DataColumn, Document, DocumentPart, Paragraph, data_table
from simmer_tui.sim.command import counted
from simmer_tui.trials.chance_control import ChanceControl
from simmer_tui.trials.explanations import ChangedRun
from simmer_tui.trials.interventions import UNCHANGED
from simmer_tui.trials.logged_trial import LoggedTrial

TRIED = data_table(
    "tried",
    "One change at a time",
    DataColumn("change", wraps=True),
    DataColumn("result", heading="this run"),
    DataColumn("succeeded", COUNT, "other errors: succeeded"),
    DataColumn("unchanged", COUNT, "unchanged"),
    DataColumn("runs", COUNT, "of"),
    DataColumn("text", hidden=True),
)


def why_document(logged: LoggedTrial) -> Document:
    """The change that makes a run succeed, with the counts of its repeats, and all tried changes."""
    explanation = logged.explanation
    controls = {each.change: each for each in explanation.controls}
    done = {each.change: each for each in logged.changed if not each.repeat}
    own = [done[change] for change in logged.explanations.planned if change in done]
    headline = " ".join(_sentence(each) for each in explanation.controls if each.is_sure)
    parts: list[DocumentPart] = []
    if headline:
        parts.append(Paragraph(headline, "headline", "strong"))
    parts.append(Paragraph(explanation.text, "text", "" if headline else "strong"))
    parts.append(TRIED.filled([_row(each, controls.get(each.change)) for each in own]))
    if not headline and len(own) == 1 and own[0].succeeded:
        parts.append(Paragraph(_NOT_REPEATED, kind="note"))
    parts.append(
        Paragraph(f"{counted(len(logged.changed), 'run')} with seed {logged.trial(1).seed}.", kind="note")
    )
    return Document("Why", parts)


_NOT_REPEATED = (
    "Random numbers of the program itself, or its real time, differ from run to run. Give them a fixed seed, "
    "or measure the success rate with simmer-tui trials."
)


def _sentence(control: ChanceControl) -> str:
    count = control.pairs.count
    return (
        f"With {control.change} it succeeds: {control.successes} of {count}; "
        f"unchanged {control.unchanged} of {count}."
    )


def _row(each: ChangedRun, control: ChanceControl | None) -> tuple[object, ...]:
    result = {True: "succeeds", False: "fails", None: "no result"}[each.succeeded]
    counts: tuple[int | None, ...] = (None, None, None)
    if control is not None and each.change != UNCHANGED:
        counts = (control.successes, control.unchanged, control.pairs.count)
    return (each.change, result, *counts, each.text)
