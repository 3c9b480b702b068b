"""Causes before all others: lines, refusals, and what people did."""

from __future__ import annotations

import math
from collections.abc import Sequence

from simmer_tui.report.cause_text import Fact, lost_text, then_text
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.run.facts import displacement
from simmer_tui.run.history_rows import RefusalRow
from simmer_tui.run.phrases import (
    body_text,
    capitalized,
    obstacle_place,
    place_text,
    times_text,
)
from simmer_tui.run.run_history import CHAIN
from simmer_tui.sim.command import WORD, counted, cut

REFUSED_SHARE = 0.05
"""Share of movements that were refused, and never carried out, from which they changed the path. Judged."""


def wire_fact(run: RunEvidence) -> Fact | None:
    """A line that the robot's protocol does not have, or a program that was turned away."""
    away, fault = run.turned_away, run.deciding_fault
    if away is not None:
        why = away.text.partition(": ")[2]
        text = f"A program was turned away at {away.elapsed:.1f} s: {why}, and another was connected."
        return Fact(text, away, advice="End the other program, then start this one.")
    if fault is None:
        return None
    refused, of = run.all_refused
    text = fault.text
    if refused and 2 * refused > of:
        text = f"{refused} of {counted(of, 'command')} were refused: {text}"
    # The fault itself says what to do.
    return Fact(f"{capitalized(text)}.", fault)


def refused_fact(run: RunEvidence) -> Fact | None:
    """Commands that were refused: most of them, or some that were never carried out."""
    seen, found = run.seen, run.mostly_refused
    if found is not None:
        codes, count, of, since, first = found
        begin = f"{count} of {of} commands to drive were refused, the first at {since:.1f} s"
        return _refused_by(run, f"{begin}, such as {{}}.", first, codes)
    refused, of = run.refused_share
    if 2 * refused > of and seen.refusals:
        refused, of = run.all_refused
        begin = f"{refused} of {counted(of, 'command')} were refused"
        return _refused_by(run, f"{begin}, such as {{}}.", seen.refusals[0])
    if seen.task is None:
        return None
    unknown = run.unknown_code
    if unknown is not None and unknown[0] >= REFUSED_SHARE * unknown[1]:
        count, of, first = unknown
        begin = f"{count} of {of} commands were refused, since no device has their code"
        return _refused_by(run, f"{begin}, such as {{}}.", first)
    lost = run.contact.lost if run.has_contact and run.contact is not None else seen.beliefs[1]
    row = None if lost is None else run.refused_before(lost)
    if lost is not None and row is not None:
        return _undone(run, [row], f"{capitalized(lost_text(run, lost))}. {then_text(run)}")
    row = None if run.has_contact else run.refused_action
    fact = _never_done(run)
    if fact is not None or row is None:
        return fact
    return _refused_by(run, "Its last command was refused, {}.", row, (row.result.command.code,))


def _refused_by(run: RunEvidence, text: str, row: RefusalRow, codes: Sequence[str] = ()) -> Fact:
    """A fact about refused commands, with one of them in the braces of its text."""
    one = f"{cut(row.result.command.shown, WORD)} at {row.elapsed:.1f} s: {row.result.reason.rstrip('.')}"
    wait = "Wait for the end of each movement before you send the next command."
    return Fact(
        text.format(one),
        row,
        culprits=tuple(codes),
        advice=wait if row.result.is_early else None,
    )


def _never_done(run: RunEvidence) -> Fact | None:
    """Movements or grips that were refused and never carried out: before a contact a share of the movements,
    else the closing of the gripper."""
    seen, rows = run.seen, run.undone
    if run.has_contact:
        of = len(rows) + len(seen.within(seen.history.movements))
        return _undone(run, rows, then_text(run)) if rows and len(rows) >= REFUSED_SHARE * of else None
    gripper = "" if seen.spec.gripper is None else seen.spec.gripper.code
    rows = [each for each in rows if each.result.command.code == gripper]
    return _undone(run, rows, "It was never closed.") if rows and not seen.taken else None


def _undone(run: RunEvidence, rows: Sequence[RefusalRow], then: str) -> Fact:
    """A fact about commands that were refused and never carried out."""
    first, command = rows[0], rows[0].result.command
    reason, shown = first.result.reason.rstrip("."), cut(command.shown, WORD)
    often = f" {times_text(len(rows))}, first" if len(rows) > 1 else ""
    text = f"{shown} was refused{often} at {first.elapsed:.1f} s: {reason}."
    if any(each.result.command.shown != command.shown for each in rows):
        text = (
            f"{len(rows)} commands were refused and never carried out. The first: {text.replace(often, '')}"
        )
    return Fact(text, first, culprits=(command.code,), then=then)


def moved_fact(run: RunEvidence) -> Fact | None:
    """A person who moved the robot or the block, or drove beside the program; or a second client."""
    seen = run.seen
    row, reset = seen.moved, seen.reset
    if reset is not None and (row is reset or seen.emptied):
        taken = ", and the block to its place: the gripper had held it" if seen.emptied else ""
        text = f"A person reset the run at {reset.elapsed:.1f} s: the robot went back to its start{taken}."
        return Fact(f"{text} The program went on.", reset, place=(reset.before.x, reset.before.y))
    if row is not None:
        way, turn = displacement(row.before, row.done.pose)
        text = f"A person moved the robot at {row.elapsed:.1f} s, by {way:.0f} in and {abs(turn):.0f} deg."
        no_belief = "" if seen.beliefs[0] is None else " No belief was right after that."
        return Fact(f"{text}{no_belief}", row, place=(row.before.x, row.before.y))
    drove, met, beside = seen.driven_by_hand, seen.collision, run.beside
    if seen.task is not None and beside is not None and (not run.goals or run.goals[-1].order < beside.order):
        text = f"A second client connected at {beside.elapsed:.1f} s beside the first ({beside.text})."
        advice = "Let one program alone drive the robot, and close the ports that it does not use."
        return Fact(text, beside, advice=advice)
    if seen.task is not None and drove is not None:
        value = f"-{drove.asked:g}" if math.isfinite(drove.asked) else ""
        text = f"A person drove the robot: {seen.history.code_names[drove.code]}{value}"
        if met is not None and met.row.order == drove.order:
            into = f"{text} led {body_text(met.contact)} into {obstacle_place(met.contact, seen.spec)}."
            return Fact(into, drove, place=met.contact.point)
        if seen.is_connected(drove.order):
            return Fact(f"{text} at {drove.begin:.1f} s, beside its program.", drove, since=drove.begin)
    block = seen.block_moved
    after = 0 if block is None else int((seen.within(seen.history.movements)["order"] > block.order).sum())
    # A contact after more movements than counterfactuals repeat came of searching for the block.
    if block is None or (run.has_contact and after < CHAIN):
        return None
    to = place_text(*block.done.action.arguments[:2])
    text = (
        f"A person moved the block at {block.elapsed:.1f} s, to {to}. The robot did not take it after that."
    )
    return Fact(text, block, place=(block.before.x, block.before.y))
