"""Sentences that causes share: what was sent, the contact, what came of it, the goal that was missed."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct

from simmer_tui.config.mission_plan import cells_of
from simmer_tui.report.causes import MomentKind, Sureness
from simmer_tui.report.finding import Finding
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.run.history_rows import BeliefRow
from simmer_tui.run.phrases import (
    grip_ending,
    obstacle_place,
    place_text,
    sent_by_text,
    times_text,
)
from simmer_tui.run.table import Timed
from simmer_tui.sim.command import counted
from simmer_tui.sim.specs import BLOCK

_LINK_ERRORS = ("Connection", "BrokenPipe", "Timeout", "socket.timeout", "asyncio.TimeoutError")
"""Beginnings of errors with which a program tells that its link ended, or gave no reply."""
_LINK_WORDS = ("closed the connection", "no reply to")
"""Words of the client of this project, and of others, for a link that ended, or gave no reply."""
_SLOW_LINK = 0.5
"""Mean seconds of a reply on the link from which it is slow: ten times a Bluetooth link's. Judged."""
NAMED = 4
"""Findings named in a sentence; the table of devices has all."""


class Fact(Struct, frozen=True):
    """A fact that decided a run: a sentence, its moment (elapsed seconds) with its line and place, by default
    the run's end, and the codes of the devices that it is about. `advice` and `moment` replace those of its
    rule. `has_behind` is true if wrong devices or beliefs may explain it: they are told before `then`, the
    sentences on what came of it."""

    text: str
    at: Timed | None = None
    since: float | None = None
    place: tuple[float, float] | None = None
    culprits: tuple[str, ...] = ()
    advice: str | None = None
    moment: MomentKind | None = None
    has_behind: bool = False
    then: str = ""
    sure: Sureness = Sureness.CERTAIN


def findings_text(found: Sequence[Finding]) -> tuple[str, tuple[str, ...]]:
    """Findings as sentences, and the codes of their devices."""
    told = ". ".join(each.text for each in found[:NAMED])
    more = f". Besides: {counted(len(found) - NAMED, 'other finding')}" if len(found) > NAMED else ""
    return f"{told}{more}.", tuple(dict.fromkeys(each.of for each in found))


def lost_text(run: RunEvidence, lost: BeliefRow) -> str:
    """The first of an unbroken row of wrong beliefs, in words."""
    off = lost.deviation
    if off.rejects_truth:
        said = f"it gave the true cell {100 * lost.true_probability:.0f} %"
    elif off.off_place:
        believed, true = place_text(lost.x, lost.y), place_text(lost.true_x, lost.true_y)
        said = f"it believed to be at {believed} and was at {true}"
    else:
        said = f"its believed heading was off by {abs(off.turn):.0f} deg"
    if run.belief.was_right or run.seen.was_moved:
        return f"it was lost since {lost.elapsed:.1f} s: {said}"
    return f"it never found its place: from {lost.elapsed:.1f} s on {said}"


def stand_text(run: RunEvidence) -> str:
    """The robot's place at the end, and the belief of it."""
    seen = run.seen
    if seen.task is None or seen.history.is_twin:
        return ""
    belief = seen.beliefs[0]
    believed = "" if belief is None else f", and its belief was off by {belief.error_text}"
    return f"It stood at {place_text(seen.pose.x, seen.pose.y)}{believed}."


def waited_text(run: RunEvidence) -> str:
    """The last answered command of a program that ended because of its link; of one with another error its
    last reading."""
    last, error = run.last_command, "" if run.program is None else run.program.error
    if last is not None and (ended_by_link(run.last_words) or ended_by_link(error)):
        mean = run.seen.spent.link / max(run.seen.commands, 1)
        slow = f" A reply took {mean:.1f} s on the link." if mean >= _SLOW_LINK else ""
        return f" Its last answered command was {last[0]}, at {last[1]:.1f} s.{slow}"
    return f" Its last reading was {run.last_reading}." if error and run.last_reading else ""


def ended_by_link(said: str) -> bool:
    """True if the error or the last words of a program tell that its link had ended, or gave no reply."""
    return said.startswith(_LINK_ERRORS) or any(words in said for words in _LINK_WORDS)


def contact_sentence(run: RunEvidence) -> str:
    """The contact: its time, its place, and how far of the command the way was free."""
    met = run.contact
    if met is None:
        return ""
    row, contact = met.met.row, met.met.contact
    went = f"after {met.went:.1f} in"
    if met.asked is not None and not contact.held_block:
        went = f"after {row.went:.1f} of {abs(met.asked):.4g} in"
    if abs(row.turned) >= 2.0:
        went += f" and {abs(row.turned):.0f} deg"
    place = obstacle_place(contact, run.seen.spec)
    block = " of the held block" if contact.held_block else ""
    return f"Contact{block} at {row.elapsed:.2f} s with {place}, {went}."


def sent_text(run: RunEvidence) -> str:
    """The deciding command, and that it came repeatedly."""
    met = run.contact
    if met is None:
        return ""
    often = f" {times_text(run.repeated)} in a row" if run.repeated > 1 else ""
    sent = sent_by_text(met.met.row.ended.command.source, met.met.row.shown)
    return f"{sent}{often}" if not met.goes_on else f"{sent} at {met.sent:.1f} s, and nothing ended it"


def quiet_text(run: RunEvidence) -> str:
    """The time without a command at the end, in sentences; empty without one."""
    quiet, last = run.silence, run.last_command
    if quiet is None:
        return ""
    end = f"The run was ended at the {'real ' if run.cut_off else ''}time limit."
    if run.stopped:
        end = f"The program was stopped {quiet.real_seconds:.0f} s of real time later."
    after = "" if last is None else f", when {last[0]} was answered"
    words = f" Its last output: {run.last_words.rstrip('.')}." if run.last_words else ""
    words = f" The program was at {run.ended_at}.{words}" if run.ended_at else words
    return f"No command came after {quiet.since:.1f} s{after}. {end}{words}"


def then_text(run: RunEvidence) -> str:
    """Sentences on what came of a wrong belief or a refused command: contact, grip, silence or the end."""
    met = run.contact if run.has_contact else None
    if met is not None:
        return f"Then {sent_text(run)}.{met.unread_text} {contact_sentence(run)}"
    if run.last_grip is not None:
        return f"Then it {grip_ending(run.last_grip.grip)}."
    if run.silence is not None:
        return quiet_text(run)
    if run.stopped:
        return ""
    out_of_time = run.seen.out_of_time or run.cut_off
    return f"Then {'its time was up' if out_of_time else 'the program ended by itself'}."


def strayed_text(run: RunEvidence) -> str:
    """A sentence on a block that was never taken and lies outside the loading zone; empty without one."""
    seen = run.seen
    loading, block = cells_of(seen.spec.maze, BLOCK), seen.history.blocks.items[-1].block
    # Where the block of a real robot lies no log says.
    is_known = seen.task is not None and bool(loading) and not seen.history.is_twin
    if seen.taken or not is_known or any(cell.holds(block.x, block.y) for cell in loading):
        return ""
    return f"The block lay at {place_text(block.x, block.y)}, outside the loading zone."


def goals_text(run: RunEvidence) -> str:
    """The goal that was not met, in a sentence."""
    seen, zone = run.seen, None if run.seen.task is None else run.seen.task.zone
    if seen.task is None or (seen.taken and not seen.holding) or seen.is_silent:
        return ""
    if not seen.holding:
        never = (
            "The robot had not taken the block yet." if run.goals else "It never entered the loading zone."
        )
        return strayed_text(run) or never
    where = "" if zone is None else f" at {place_text(zone.x, zone.y)}"
    return f"The robot held the block, and had not set it down in the drop zone{where}."
