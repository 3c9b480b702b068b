"""The page of a run: the verdict, the moment that decided, why, and what to do next; the rest is folded."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from simmer_tui.document import as_html
from simmer_tui.document.formats import TextLink
from simmer_tui.document.model import (
    Bullets,
    Chip,
    Code,
    Document,
    DocumentPart,
    Folded,
    KeyFigures,
    Paragraph,
    Prose,
    SideBySide,
    Tone,
    VerdictBox,
)
from simmer_tui.report.content import again, output, report_tables, try_again
from simmer_tui.report.figure import maze_figure
from simmer_tui.report.player import left_out_text, player_script, player_style
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.report.traces import traces
from simmer_tui.report.verdict import Outcome, Verdict, goals_met
from simmer_tui.run.attempt import Attempt, Task
from simmer_tui.run.events import Goal
from simmer_tui.run.phrases import SHOWN_OUTPUT, contacts_text
from simmer_tui.sim.command import WORD, cut, plural, typed_path

_TONES = {Outcome.SUCCEEDED: Tone.GOOD, Outcome.FAILED: Tone.BAD, Outcome.CRASHED: Tone.BAD}
_CRASH_SIGN = "!"


def report_page(run: RunStatistics, name: str, *, commands: bool = True) -> str:
    """The page about a run, with its player.

    Args:
        run: The run.
        name: Name of its log, or of the run.
        commands: True if `name` is a log that the reader has, and that commands can name.
    """
    document = _page(run, name, commands=commands)
    return as_html.html_page(document, style=player_style(), script=player_script(run))


def _page(run: RunStatistics, name: str, *, commands: bool) -> Document:
    verdict = run.verdict
    attempt = run.attempt
    last = output(verdict)
    crashed = verdict.outcome is Outcome.CRASHED
    strips = traces(run)
    parts: list[DocumentPart] = [
        _about(run, name),
        verdict_box(verdict, is_mission=attempt.task is not None),
        *((_last_lines(verdict),) if crashed else ()),
        _figures(run, attempt, crashed=crashed),
        # Beside the picture: verdict, moments and picture fit a screen.
        SideBySide(
            tuple(_picture(run)), (_moments(verdict), *_cards(run, attempt, name if commands else ""))
        ),
        *((Folded("Notes", (Bullets("", run.notes),)),) if run.notes else ()),
        *(() if strips is None else (Folded("Sensors over time", (strips,)),)),
        Folded("Movements, errors of readings, timing", report_tables(run, name)),
        Folded(last.heading, (Bullets("", last.entries, kind="output"),) if last.entries else ()),
        *((again(name), try_again(run, name)) if commands else ()),
    ]
    return Document(f"Run {name}", parts)


def _about(run: RunStatistics, name: str) -> Paragraph:
    """Start, set, seed and name of the run, in one small line."""
    header = run.header
    started = cut(header.start.replace("T", " "), WORD)[:16]  # without seconds
    told = (f"Run of {started}", f"set {header.configuration}", f"seed {header.seed}", name)
    return Paragraph(" · ".join(told), kind="run")


def verdict_box(verdict: Verdict, *, is_mission: bool) -> VerdictBox:
    """The answer that a page about a run begins with."""
    crashed = verdict.outcome is Outcome.CRASHED
    what = "Program" if crashed or not is_mission else "Mission"
    if verdict.outcome is Outcome.STILL_GOING:
        what = "Run"
    return VerdictBox(
        key="verdict",
        text=verdict.headline,
        headline=f"{what} {verdict.outcome.value}",
        tone=_TONES.get(verdict.outcome, Tone.PLAIN),
        sign=_CRASH_SIGN if crashed else "",
    )


def _moments(verdict: Verdict) -> Bullets:
    """The moments, each with a link that moves the player there."""
    lines: list[tuple[Prose, ...]] = []
    for each in verdict.moments:
        link = TextLink(f"{each.elapsed:.1f} s", f"#t={each.elapsed:.2f}")
        mark: tuple[Prose, ...] = (" ", Chip("cause", Tone.BAD)) if each.is_cause else ()
        lines.append((link, f" {each.text}", *mark))
    return Bullets("What happened", lines, kind="card")


def _last_lines(verdict: Verdict) -> Bullets:
    """The last output of a crashed program."""
    program = verdict.program
    said = () if program is None else program.stderr[-SHOWN_OUTPUT:]
    return Bullets("", [line.text for line in said], kind="output")


def _figures(run: RunStatistics, attempt: Attempt, *, crashed: bool) -> KeyFigures:
    """Three numbers: those of the mission; after a crash, the progress until then."""
    task, seconds = attempt.task, attempt.seconds
    contacts = (str(attempt.contacts), plural(attempt.contacts, "contact"))
    if task is None or crashed:
        told = (str(attempt.commands), plural(attempt.commands, "command"))
        return KeyFigures(((f"{seconds:.1f} s", f"simulated{attempt.restart}"), told, contacts))
    met = f"{len(goals_met(run.history))} of {len(task.goals)}"
    return KeyFigures(((met, "goals met"), (f"{seconds:.1f} s", f"of {task.time_limit:g} s"), contacts))


def _picture(run: RunStatistics) -> Iterator[DocumentPart]:
    """The maze, which a script turns into the player; it begins at the deciding moment."""
    tone = _TONES.get(run.verdict.outcome, Tone.PLAIN)
    figure = maze_figure(run)
    yield replace(figure, kind=f"{figure.kind} {tone.value}")
    cause = run.verdict.cause
    what = "the end of the run" if cause is None else "the moment of the cause"
    begin = TextLink(f"{run.verdict.elapsed:.1f} s", f"#t={run.verdict.elapsed:.2f}")
    yield Paragraph(
        (f"It begins at {what}, ", begin, f". {left_out_text(run.recording)}"), kind="note begins"
    )


def _cards(run: RunStatistics, attempt: Attempt, log: str) -> Iterator[DocumentPart]:
    """Cards: the reasons, the next steps and the goals. `log` is empty where the reader has none."""
    verdict = run.verdict
    yield Bullets("Why", verdict.why, kind="card")
    file = typed_path(log)
    steps: list[tuple[Prose, ...] | str] = [verdict.advice] if verdict.advice else []
    if log:
        steps.append(("See it: ", Code(f"simmer-tui replay {file}")))
        if verdict.outcome is not Outcome.SUCCEEDED:  # there is nothing left to do
            take_over = f"simmer-tui replay {file} --take-over {verdict.elapsed:.1f}"
            steps.append(("Continue from here: ", Code(take_over)))
    yield Bullets("Next", steps, kind="card")
    if attempt.task is not None:
        yield Bullets("Goals", list(_goals(run, attempt.task, attempt)), kind="card")


def _goals(run: RunStatistics, task: Task, attempt: Attempt) -> Iterator[tuple[Prose, ...]]:
    met = goals_met(run.history)
    for goal in task.goals:
        where = ""
        if goal is Goal.DELIVERED and task.zone is not None:
            where = f" to {task.zone.x:g}, {task.zone.y:g}"
        chip = _goal(f"{goal.value}{where}", met=goal in met)
        yield (chip, f" {met[goal]:.1f} s{attempt.restart}") if goal in met else (chip,)
    if task.contacts is not None:
        contacts = _goal(contacts_text(attempt.contacts), met=attempt.contacts <= task.contacts)
        yield contacts, f", {task.contacts} allowed"


def _goal(text: str, *, met: bool) -> Chip:
    tone = Tone.GOOD if met else Tone.BAD
    return Chip(f"{tone.sign} {text}", tone)
