"""Causes before all others: lines, refusals, and what people did."""

from __future__ import annotations

import math
from collections.abc import Sequence

from simmer_tui.report.cause_text import Fact
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.run.facts import displacement
from simmer_tui.run.history_rows import RefusalRow
from simmer_tui.run.phrases import capitalized, place_text, times_text
from simmer_tui.run.run_history import CHAIN
from simmer_tui.sim.command import WORD, counted, cut
from simmer_tui.sim.records import Status

_REFUSED_SHARE = 0.05
"""Share of commands that were refused from which that changed the run. Judged."""
_TOKEN = "--token"
"""Word of the reason for which a program without the token is turned away."""


def wire_fact(run: RunEvidence) -> Fact | None:
    """A line that the robot's protocol does not have, or a program that was turned away."""
    away, fault = run.turned_away, run.deciding_fault
    if away is not None:
        why = away.text.partition(": ")[2]
        advice = "End the other program, then start this one."
        if _TOKEN in why:
            advice = "Send the simulator's token as the first line, before any command."
        else:
            why = f"{why}, and another was connected"
        return Fact(f"A program was turned away at {away.elapsed:.1f} s: {why}.", away, advice=advice)
    if fault is None:
        return None
    refused, of = run.all_refused
    text = fault.text
    if refused and 2 * refused > of:
        text = f"{refused} of {counted(of, 'command')} were refused: {text}"
    # The fault itself says what to do.
    return Fact(f"{capitalized(text)}.", fault)


def refused_fact(run: RunEvidence) -> Fact | None:
    """Commands that were refused: most of them, a share of them, or one that was never carried out."""
    seen, found = run.seen, run.mostly_refused
    if found is not None:
        codes, count, of, first = found
        return _refused_by(f"{count} of {of} commands to drive were refused, such as", first, codes)
    if seen.task is None:
        return None
    refused, of = run.refused_share
    unknown = next((each for each in seen.refusals if each.result.status is not Status.BUSY), None)
    if unknown is not None and refused >= _REFUSED_SHARE * of:
        codes = [unknown.result.command.code] if unknown.result.status is Status.REFUSED else []
        text = f"{refused} of {counted(of, 'command')} were refused, such as"
        return _refused_by(text, unknown, codes)
    if run.has_contact or not run.undone:
        return None
    first = run.undone[0]
    same = [each for each in run.undone if each.result.command.shown == first.result.command.shown]
    text = f"Refused {times_text(len(same))} and never carried out:"
    return _refused_by(text, first, (first.result.command.code,))


def _refused_by(text: str, row: RefusalRow, codes: Sequence[str] = ()) -> Fact:
    """A fact about refused commands, with one of them behind its text."""
    reason = row.result.reason.rstrip(".")
    wait = "Wait for the end of each movement before you send the next command."
    return Fact(
        f"{text} {cut(row.result.command.shown, WORD)} at {row.elapsed:.1f} s: {reason}.",
        row,
        culprits=tuple(codes),
        advice=wait if row.result.is_early else None,
    )


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
    drove, beside = seen.driven_by_hand, run.beside
    if seen.task is not None and beside is not None and (not run.goals or run.goals[-1].order < beside.order):
        text = f"A second client connected at {beside.elapsed:.1f} s beside the first ({beside.text})."
        advice = "Let one program alone drive the robot, and close the ports that it does not use."
        return Fact(text, beside, advice=advice)
    if seen.task is not None and drove is not None and seen.is_connected(drove.order):
        value = f"-{drove.asked:g}" if math.isfinite(drove.asked) else ""
        text = f"A person drove the robot: {seen.history.code_names[drove.code]}{value}"
        return Fact(f"{text} at {drove.begin:.1f} s, beside its program.", drove, since=drove.begin)
    block = seen.block_moved
    after = 0 if block is None else int((seen.within(seen.history.movements)["order"] > block.order).sum())
    # A contact after many more movements came of searching for the block.
    if block is None or (run.has_contact and after < CHAIN):
        return None
    to = place_text(*block.done.action.arguments[:2])
    text = (
        f"A person moved the block at {block.elapsed:.1f} s, to {to}. The robot did not take it after that."
    )
    return Fact(text, block, place=(block.before.x, block.before.y))
