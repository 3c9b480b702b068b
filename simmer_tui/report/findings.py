"""Sentences that answer why a run went as it did: what went wrong first, and how it ended."""

from __future__ import annotations

import math

from simmer_tui.phrases import WEDGED_TEXT, contact_ending, counted, pose_text, times_text
from simmer_tui.report.beliefs import belief_sentences
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.run.history_rows import ContactRow
from simmer_tui.sim.command import escape

_READINGS = 6


def findings(run: RunStatistics) -> list[str]:
    """Sentences that a person should read first, the most telling first."""
    origin = run.header.taken_over
    found = [
        *(f"{each.text}." for each in run.findings),
        *([] if origin is None else [f"Taken over {origin}: until then the two runs are the same."]),
        *_end(run),
        *_contacts(run),
        *_wedged(run),
        *belief_sentences(run.history, ended_badly=run.cause is not None),
        *_refusals(run),
        *_faults(run),
        *_people(run),
    ]
    if not run.totals.commands:
        found.append("No command was logged.")
    elif not run.totals.contacts and not run.history.refusals.first.given and run.cause is None:
        found.append("No contact with a wall and no refused command.")
    return found


def _end(run: RunStatistics) -> list[str]:
    contacts = run.history.contacts.items
    stuck = run.history.stuck(run.history.elapsed)
    if stuck is not None:
        where = pose_text(run.pose)
        return [f"Stuck at the end: from {stuck.since:.1f} s on, {stuck.text}. The robot stayed at {where}."]
    touch = contacts[-1] if contacts else None
    if touch is not None and touch.stopped and touch.line == run.totals.last_command_line:
        return [f"The run ends at a wall: {touch.shown} (line {touch.line}) was its last command."]
    return []


def _contacts(run: RunStatistics) -> list[str]:
    if not run.totals.contacts:
        return []
    first = run.history.repeated.first.items[0].touch
    if run.totals.legs:
        told = f"The robot touched a wall {times_text(run.totals.contacts)}"
        unread = "No sensor was read shortly before it."
    else:
        share = f"{run.totals.contacts} of {counted(run.totals.movements, 'movement')}"
        went_on = run.totals.contacts - run.totals.contacts_that_ended
        told = f"{share} touched a wall, and {went_on} went on" if went_on else f"{share} ended at a wall"
        unread = "No sensor was read since the movement before it."
    return [f"{told}. The first: {_touch(first)} {_before(first) or unread}"]


def _wedged(run: RunStatistics) -> list[str]:
    wedged = run.history.wedged.first
    if not wedged.given:
        return []
    first = wedged.items[0]
    return [f"From {first.elapsed:.1f} s on it was {WEDGED_TEXT}. It stood at {pose_text(first.pose)}."]


def _touch(touch: ContactRow) -> str:
    turned = f" and {abs(touch.turned):.0f} deg of turning" if abs(touch.turned) >= 2 else ""
    ending = contact_ending(touch.contact, touch.pose, f"after {touch.went:.1f} in{turned} ")
    return f"{touch.shown} (line {touch.line}, at {touch.elapsed:.1f} s) {ending}."


def _before(touch: ContactRow) -> str:
    """The program's readings when it gave the command; empty if there were none."""
    if not touch.seen:
        return ""
    shown = [f"{escape(each.text.strip(), 20)} {_value(each.reading.value)}" for each in touch.seen]
    more = f" and {len(shown) - _READINGS} more" if len(shown) > _READINGS else ""
    return f"Readings before it: {', '.join(shown[:_READINGS])}{more}."


def _refusals(run: RunStatistics) -> list[str]:
    refusals = run.history.refusals.first
    if not refusals.given:
        return []
    first = refusals.items[0]
    return [
        f"{refusals.given} of {counted(run.totals.commands, 'command')} did nothing. The first: "
        f"'{first.outcome.command.shown}' (line {first.line}): {escape(first.outcome.reason, 200)}."
    ]


def _faults(run: RunStatistics) -> list[str]:
    faults = run.history.faults.first
    if not faults.given:
        return []
    first = faults.items[0]
    return [f"{counted(faults.given, 'fault')}. The first (line {first.line}): {escape(first.text, 200)}."]


def _people(run: RunStatistics) -> list[str]:
    if not run.totals.actions:
        return []
    listed = ", ".join(f"{name} {count}x" for name, count in run.totals.actions.most_common(8))
    return [f"Actions by a person: {listed}."]


def _value(value: float) -> str:
    return f"{value:.1f}" if math.isfinite(value) else str(value)
