"""The program's side of a run: the sensor or drive that explains a disagreement of program and log."""

from __future__ import annotations

from collections.abc import Collection

from simmer_tui.report.belief_audit import BeliefMotion, wrong_heading
from simmer_tui.report.command_audit import multiplied_corrections, vanished_movements
from simmer_tui.report.disagreement import Disagreement, kept_disagreements
from simmer_tui.report.finding import FEWEST
from simmer_tui.report.reply_audit import ReplyAudit
from simmer_tui.run.attempt import Attempt


def disagreements(attempt: Attempt, known: Collection[str] = ()) -> list[list[Disagreement]]:
    """The disagreements of program and log, at a familywise error of 1 % a run, the surest first. Each has
    all sensors and drives that explain it equally well.

    Args:
        attempt: The run. A real robot has none: its log does not know its true pose.
        known: Codes of sensors and drives that are not as their set says: that is the stronger explanation.
    """
    if attempt.history.is_twin:
        return []
    tests = [each for row in attempt.spec.drives for each in multiplied_corrections(attempt, row)]
    tests += [vanished_movements(attempt), wrong_heading(attempt)]
    for since in _stretches(attempt):
        motion = BeliefMotion(attempt, since)
        tests += [*motion.explanations(), motion.unlogged(), ReplyAudit(attempt, since).explanations()]
    kept = kept_disagreements(each for each in tests if each)
    return [each for each in kept if not any(code in known for one in each for code in one.of)]


def _stretches(attempt: Attempt) -> list[int]:
    """The events after which beliefs are audited. One is the robot's last placement, the other the moment
    when the belief became wrong for good, if earlier beliefs agreed with the log."""
    lost = attempt.beliefs[1]
    if lost is None:
        return [attempt.placed]
    before = attempt.history.beliefs.place_of(lost.order) - attempt.history.beliefs.place_of(attempt.placed)
    return [attempt.placed, lost.order - 1] if before >= FEWEST["set"] else [attempt.placed]
