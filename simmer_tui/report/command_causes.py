"""Causes before all others: lines, refusals, and what people did."""

from __future__ import annotations

import math

from simmer_tui.report.causes import Fact
from simmer_tui.report.moments import (
    Moment,
    MomentKind,
    fault_moment,
    person_moment,
    refusal_moment,
    told,
)
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.run.run_history import CHAIN

_WAIT = "Wait for the end of each movement before you send the next command."
_ONE_PROGRAM = "Let one program alone drive the robot, and close the ports that it does not use."
_END_THE_OTHER = "End the other program, then start this one."
_SEARCH_AGAIN = "Search for the block once more when it is not where it was."
_SEND_TOKEN = "Send the simulator's token as the first line, before any command."


def wire_fact(run: RunEvidence) -> Fact | None:
    """A line that the robot's protocol does not have, or a program that was turned away."""
    fault = fault_moment(run)
    if fault is None or (run.turned_away is None and run.deciding_fault is None):
        return None
    # A fault itself says what to do.
    advice = None
    if run.turned_away is not None:
        advice = _SEND_TOKEN if "--token" in fault.text else _END_THE_OTHER
    return Fact(fault, told(fault), advice=advice)


def refused_fact(run: RunEvidence) -> Fact | None:
    """Commands that were refused: most of them, a share of them, or one that was never carried out."""
    found, refused = run.refusal, refusal_moment(run)
    if found is None or refused is None or not found.decides:
        return None
    advice = _WAIT if found.row.result.is_early else None
    return Fact(refused, told(refused), culprits=found.codes, advice=advice)


def moved_fact(run: RunEvidence) -> Fact | None:
    """A person who moved the robot or the block, or drove beside the program; or a second client."""
    seen, beside, drove = run.seen, run.beside, run.seen.driven_by_hand
    row = seen.reset if seen.emptied else seen.moved
    if row is not None:
        moved = person_moment(run, row)
        was_wrong = row is seen.moved and seen.beliefs[0] is not None
        no_belief = " No belief was right after that." if was_wrong else ""
        return Fact(moved, f"{told(moved)}{no_belief}")
    if seen.task is None:
        return None
    if beside is not None and (not run.goals or run.goals[-1].order < beside.order):
        text = f"a second client connected beside the first ({beside.text})"
        came = Moment(MomentKind.PERSON, beside.elapsed, text, beside.line)
        return Fact(came, told(came), advice=_ONE_PROGRAM)
    if drove is not None and seen.is_connected(drove.order):
        value = f"-{drove.asked:g}" if math.isfinite(drove.asked) else ""
        text = f"a person drove the robot beside its program: {seen.history.code_names[drove.code]}{value}"
        by_hand = Moment(MomentKind.PERSON, drove.begin, text, drove.line)
        return Fact(by_hand, told(by_hand))
    block = seen.block_moved
    after = 0 if block is None else int((seen.within(seen.history.movements)["order"] > block.order).sum())
    # A contact after many more movements came of searching for the block.
    if block is None or (run.has_contact and after < CHAIN):
        return None
    moved = person_moment(run, block)
    return Fact(moved, f"{told(moved)} The robot did not take it after that.", advice=_SEARCH_AGAIN)
