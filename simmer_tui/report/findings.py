"""Sentences that answer why a run went as it did: what went wrong first, and how it ended."""

from __future__ import annotations

import math

from simmer_tui.phrases import contact_ending, counted, pose_text
from simmer_tui.report.happenings import Touch
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.sim.command import escape
from simmer_tui.sim.specs import CELL_SIZE

STUCK = 3
"""So many contacts in a row at the end mean that the robot was stuck."""
_READINGS = 6


def findings(run: RunStatistics) -> list[str]:
    """What a person should know first, the most telling first."""
    found = [
        *_cause(run),
        *_taken_over(run),
        *_end(run),
        *_contacts(run),
        *_belief(run),
        *_refusals(run),
        *_faults(run),
        *_people(run),
    ]
    if not run.commands:
        found.append("No command was logged.")
    elif not run.contacts and not run.refusals.given and run.cause is None:
        found.append("No contact with a wall and no refused command.")
    return found


def _cause(run: RunStatistics) -> list[str]:
    """Why it failed, and what speaks for that."""
    cause = run.cause
    if cause is None:
        return []
    when = f" (line {cause.line}, at {cause.elapsed:.1f} s)" if cause.line else ""
    return [f"{cause.text}{when}", *cause.evidence]


def _taken_over(run: RunStatistics) -> list[str]:
    origin = run.header.taken_over
    return [] if origin is None else [f"It took over {origin}: till then it is that run."]


def _end(run: RunStatistics) -> list[str]:
    touch = run.last_contact
    if run.contacts_in_a_row >= STUCK:
        return [
            f"Stuck at the end: from {run.in_a_row_since:.1f} s on {run.contacts_in_a_row} movements "
            f"in a row were stopped by a wall. The robot stayed at {pose_text(run.pose)}."
        ]
    if touch is not None and touch.ended and touch.line == run.last_command_line:
        return [f"The run ends at a wall: {touch.shown} (line {touch.line}) was its last command."]
    return []


def _contacts(run: RunStatistics) -> list[str]:
    if not run.contacts:
        return []
    first = run.bumps.items[0].touch
    share = f"{run.contacts} of {counted(run.movements, 'movement')}"
    went_on = run.contacts - run.contacts_that_ended
    how = f"met a wall, {went_on} went on" if went_on else "ended at a wall"
    return [f"{share} {how}. The first: {_touch(first)} {_before(first)}"]


def _touch(touch: Touch) -> str:
    turned = f" and {abs(touch.turned):.0f} deg of turning" if abs(touch.turned) >= 2 else ""
    ending = contact_ending(touch.contact, touch.pose, f"after {touch.went:.1f} in{turned} ")
    return f"{touch.shown} (line {touch.line}, at {touch.elapsed:.1f} s) {ending}."


def _before(touch: Touch) -> str:
    """What the program knew when it gave the command."""
    if not touch.seen:
        return "No sensor was read between it and the movement before."
    shown = [f"{escape(each.command.text.strip(), 20)} said {_value(each.reply)}" for each in touch.seen]
    more = f" and {len(shown) - _READINGS} more" if len(shown) > _READINGS else ""
    return f"Read before it: {', '.join(shown[:_READINGS])}{more}."


def _belief(run: RunStatistics) -> list[str]:
    last = run.last_belief
    if last is None:
        return []
    end = (
        f"At the end the belief was off by {_value(last.distance)} in and {abs(last.turn):.0f} deg "
        f"(on average {run.beliefs.mean:.1f} in)."
    )
    if run.lost is None:
        return [
            f"The belief was never off by more than half a cell ({CELL_SIZE / 2:g} in) and what its spread "
            f"allowed for. {end}"
        ]
    lost = run.lost
    before = [bump.touch for bump in run.bumps.items if bump.touch.elapsed <= lost.elapsed]
    after = f", after the contact of line {before[-1].line}" if before else ""
    return [
        f"The belief was first off by more than half a cell ({CELL_SIZE / 2:g} in) at {lost.elapsed:.1f} s "
        f"(line {lost.line}){after}, further than its spread allowed for. {end}"
    ]


def _refusals(run: RunStatistics) -> list[str]:
    if not run.refusals.given:
        return []
    first = run.refusals.items[0]
    return [
        f"{run.refusals.given} of {counted(run.commands, 'command')} did nothing. The first: "
        f"'{first.outcome.command.shown}' (line {first.line}): {escape(first.outcome.reason, 200)}."
    ]


def _faults(run: RunStatistics) -> list[str]:
    if not run.faults.given:
        return []
    first = run.faults.items[0]
    return [
        f"{counted(run.faults.given, 'fault')}. The first (line {first.line}): {escape(first.text, 200)}."
    ]


def _people(run: RunStatistics) -> list[str]:
    if not run.actions:
        return []
    listed = ", ".join(f"{name} {count}x" for name, count in run.actions.most_common(8))
    return [f"A person took part: {listed}."]


def _value(value: float) -> str:
    return f"{value:.1f}" if math.isfinite(value) else str(value)
