"""Sentences that answer why a run went as it did: what went wrong first, and how it ended."""

from __future__ import annotations

from collections.abc import Iterator

from simmer_tui.phrases import WEDGED_TEXT, contact_ending, counted, pose_text, times_text
from simmer_tui.report.beliefs import belief_sentences
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.run.history_rows import ContactRow
from simmer_tui.sim.command import escape_passage, escape_word

# Readings named in a sentence; it says how many more there are.
_READINGS = 6


def findings(run: RunStatistics) -> list[str]:
    """Sentences that a person should read first, the most telling first."""
    return list(_sentences(run))


def _sentences(run: RunStatistics) -> Iterator[str]:
    history, totals, origin = run.history, run.totals, run.header.taken_over
    wedged, refusals, faults = history.wedged.first, history.refusals.first, history.faults.first
    yield from (f"{each.text}." for each in run.findings)
    if origin is not None:
        yield f"Taken over {origin}: until then the two runs are the same."
    yield from _end(run)
    if totals.contacts:
        yield _contacts(run)
    if wedged.given:
        since, place = wedged.items[0].elapsed, pose_text(wedged.items[0].pose)
        yield f"From {since:.1f} s on it was {WEDGED_TEXT}. It stood at {place}."
    yield from belief_sentences(history, ended_badly=run.cause is not None)
    if refusals.given:
        refused, first = counted(totals.commands, "command"), refusals.items[0]
        why = f"'{first.outcome.command.shown}' (line {first.line}): {escape_passage(first.outcome.reason)}"
        yield f"{refusals.given} of {refused} did nothing. The first: {why}."
    if faults.given:
        line, text = faults.items[0].line, escape_passage(faults.items[0].text)
        yield f"{counted(faults.given, 'fault')}. The first (line {line}): {text}."
    if totals.actions:
        listed = ", ".join(f"{name} {count}x" for name, count in totals.actions.most_common(8))
        yield f"Actions by a person: {listed}."
    if not totals.commands:
        yield "No command was logged."
    elif not totals.contacts and not refusals.given and run.cause is None:
        yield "No contact with a wall and no refused command."


def _end(run: RunStatistics) -> Iterator[str]:
    """The end at a wall, if it was there."""
    contacts = run.history.contacts.items
    stuck = run.history.stuck(run.history.elapsed)
    if stuck is not None:
        where = pose_text(run.pose)
        yield f"Stuck at the end: {stuck.text}. The robot stayed at {where}."
    elif contacts and contacts[-1].stopped and contacts[-1].line == run.totals.last_command_line:
        shown, line = contacts[-1].shown, contacts[-1].line
        yield f"The run ends at a wall: {shown} (line {line}) was its last command."


def _contacts(run: RunStatistics) -> str:
    first = run.history.repeated.first.items[0].touch
    if run.totals.legs:
        text = f"The robot touched a wall {times_text(run.totals.contacts)}"
        unread = "No sensor was read shortly before it."
    else:
        share = f"{run.totals.contacts} of {counted(run.totals.movements, 'movement')}"
        went_on = run.totals.contacts - run.totals.contacts_that_ended
        text = f"{share} touched a wall, and {went_on} went on" if went_on else f"{share} ended at a wall"
        unread = "No sensor was read since the movement before it."
    return f"{text}. The first: {_touch(first)} {_before(first) or unread}"


def _touch(touch: ContactRow) -> str:
    turned = f" and {abs(touch.turned):.0f} deg of turning" if abs(touch.turned) >= 2 else ""
    ending = contact_ending(touch.contact, touch.pose, f"after {touch.went:.1f} in{turned} ")
    return f"{touch.shown} (line {touch.line}, at {touch.elapsed:.1f} s) {ending}."


def _before(touch: ContactRow) -> str:
    """The program's readings when it gave the command; empty if there were none."""
    if not touch.seen:
        return ""
    shown = [f"{escape_word(each.text.strip())} {each.reading.value:.1f}" for each in touch.seen]
    more = f" and {len(shown) - _READINGS} more" if len(shown) > _READINGS else ""
    return f"Readings before it: {', '.join(shown[:_READINGS])}{more}."
