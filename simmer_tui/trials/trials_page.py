"""The page of a set of trials: how often it succeeds, why runs failed and where; the rest is folded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from operator import attrgetter

from simmer_tui.document.formats import LENGTH, SHARE, TextLink, number
from simmer_tui.document.model import (
    Bullets,
    Document,
    DocumentPart,
    Folded,
    KeyFigures,
    Paragraph,
    Prose,
    SectionHeading,
    ShareBar,
    SideBySide,
    Tone,
    VerdictBox,
)
from simmer_tui.run.phrases import capitalized
from simmer_tui.sim.command import counted, cut
from simmer_tui.trials.explanations import WHY_FAILED
from simmer_tui.trials.failures import CAUSES, DEVICES, counted_causes, failure_summary, grouped, success_rate
from simmer_tui.trials.figures import histogram_figure, map_figure
from simmer_tui.trials.folder import TrialFolder
from simmer_tui.trials.intervals import median
from simmer_tui.trials.requirement import NO_REQUIREMENT, Requirement
from simmer_tui.trials.trial import RANDOM, Ending, TrialResult, clock_sentences, clocks_text
from simmer_tui.trials.trials_summary import ports_advice, success_texts, trials_tables

_MAPS = 12
"""Most mazes drawn: the page stays one that can be scrolled through."""
_PER_RUN = number(".2g")
_ENDINGS = sorted(Ending, key=lambda ending: (Tone.GOOD, Tone.BAD, Tone.MIXED, Tone.PLAIN).index(ending.tone))
"""Endings in the order of the bar of outcomes."""
# In the order in which a reader looks for them.
_SHOWN = (CAUSES.key, DEVICES.key, WHY_FAILED.key)


def trials_page(
    folder: TrialFolder, run_pages: Mapping[int, str], requirement: Requirement = NO_REQUIREMENT
) -> Document:
    """The page about the runs that are done; there must be one.

    Args:
        folder: The set of trials.
        run_pages: Pages of runs that are linked to, by number.
        requirement: What is asked of the runs.
    """
    results, made = folder.done, {table.key: table for table in trials_tables(folder)}
    maps = _maps(folder, results, run_pages)
    first_map = maps[:1] if len(maps) == 1 else []
    summary, endings = failure_summary(results), Counter(result.ending for result in results)
    failures: list[DocumentPart] = [made[key] for key in _SHOWN if key in made]
    if run_pages:
        failures.append(Bullets("Failed runs to play", _links(results, run_pages)))
    asked = "succeeded", requirement.share
    parts: list[DocumentPart] = [
        run_line(folder),
        _verdict(folder, requirement),
        ShareBar([(endings[each], each.words, each.tone) for each in _ENDINGS]),
        key_figures(SHARE.text(success_rate(results).value), ", ".join(filter(None, asked)), results),
        Paragraph("" if folder.plan.sketches else ports_advice(results), kind="warning"),
        *beside(failures, first_map),
        *((Bullets("", [summary], kind="card"),) if summary else ()),
        Folded("Places of failures and contacts", () if first_map else maps),
        Folded("Simulated time and distance", _histograms(results)),
        Folded("All tables", [table for key, table in made.items() if key not in _SHOWN]),
        Paragraph(" ".join(clock_sentences(folder.configuration, results)), kind="note"),
    ]
    return Document(f"Trials of {cut(folder.plan.program)}", parts)


def run_line(folder: TrialFolder) -> Paragraph:
    """Runs, set, seed and command, in one small line."""
    plan, results = folder.plan, folder.done
    done, total = len(results), plan.total
    runs = counted(total, "run") if done == total else f"{done} of {total} runs"
    clocks = clocks_text(results)
    parts = (
        *(runs, f"set {cut(plan.configuration)}", f"seed {plan.seed}"),
        *((f"clock: {clocks}",) if clocks else ()),
        cut(plan.program),
    )
    return Paragraph(" · ".join(parts), kind="run")


def _verdict(folder: TrialFolder, requirement: Requirement) -> VerdictBox:
    results = folder.done
    successes = sum(result.success for result in results)
    headline, rated = success_texts(results)
    text = f"{headline}: {rated}"
    tone = Tone.GOOD if successes == len(results) else Tone.MIXED if successes else Tone.BAD
    if judged := requirement.headline(folder):
        headline += f": {judged}"
        tone = {True: Tone.GOOD, False: Tone.BAD, None: Tone.MIXED}[requirement.is_met(folder)]
    sentence = ", ".join(filter(None, (capitalized(rated), requirement.sentence))) + "."
    if causes := counted_causes(results):
        (name, group), *_ = causes
        failures = counted(len(results) - successes, "failure")
        sentence += f" Most frequent cause: {name}, {len(group)} of {failures}."
    return VerdictBox(key="answer", text=text, headline=headline, tone=tone, sentence=(sentence,))


def key_figures(successes: str, what: str, results: Sequence[TrialResult]) -> KeyFigures:
    """The successes, with `what` they are, the usual time of one, and the contacts of a run."""
    time = median([result.time for result in results if result.success])
    shown = "–" if time is None else f"{LENGTH.text(time)} s"
    contacts = _PER_RUN.text(sum(result.contacts for result in results) / len(results))
    return KeyFigures(((successes, what), (shown, "median of the successes"), (contacts, "contacts a run")))


def beside(parts: Sequence[DocumentPart], picture: Sequence[DocumentPart]) -> list[DocumentPart]:
    """Parts, and beside them the one picture of all runs, if there are both."""
    if not parts or not picture:
        return [*parts, *picture]
    about = Paragraph("Contacts (×) and ends of all runs.", kind="note")
    return [SideBySide(parts, (*picture, about), even=True)]


def _links(results: Sequence[TrialResult], run_pages: Mapping[int, str]) -> list[tuple[Prose, ...]]:
    """Links to the runs that have a page, by cause."""
    items: list[tuple[Prose, ...]] = []
    for name, group in counted_causes(results):
        links = [
            TextLink(f"run {each.number}", run_pages[each.number], each.why or each.reason)
            for each in group
            if each.number in run_pages
        ]
        if links:
            rest = (piece for link in links[1:] for piece in (", ", link))
            items.append((f"{name}: ", links[0], *rest))
    return items


def _maps(
    folder: TrialFolder, results: Sequence[TrialResult], run_pages: Mapping[int, str]
) -> list[DocumentPart]:
    """A map a maze, those with most failures first; of mazes made for one run each, the failed ones."""
    shown = [each for each in results if each.maze != RANDOM or not each.success or each.contacts]
    groups = grouped(shown, lambda each: f"run {each.number}" if each.maze == RANDOM else each.maze)
    drawn = sorted(groups.items(), key=lambda item: -sum(not result.success for result in item[1]))
    parts: list[DocumentPart] = []
    for name, group in drawn[:_MAPS]:
        label = cut(name)
        parts += [SectionHeading(label, 3)] if label else []
        parts.append(map_figure(folder.maze(group[0].number), group, run_pages, f"Map {label}"))
    if len(drawn) > _MAPS:
        parts.append(Paragraph(f"and {counted(len(drawn) - _MAPS, 'more maze')}", kind="note"))
    return parts or [Paragraph("No run failed, and no wall was touched.")]


def _histograms(results: Sequence[TrialResult]) -> list[DocumentPart]:
    parts: list[DocumentPart] = []
    for title, unit, value in (
        ("Simulated time, s", "s", attrgetter("time")),
        ("Distance driven, in", "in", attrgetter("distance")),
    ):
        done, failed = (
            [value(result) for result in results if result.success is wanted] for wanted in (True, False)
        )
        parts += [SectionHeading(title), histogram_figure(done, failed, unit)]
    return parts
