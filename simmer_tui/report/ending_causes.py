"""Causes of a run without a contact that ended it: belief, gripper, progress, time, and the program's end."""

from __future__ import annotations

import math

from msgspec.structs import replace

from simmer_tui.report.belief_facts import has_read_range, is_small, ranges_before
from simmer_tui.report.causes import Fact
from simmer_tui.report.command_causes import moved_fact
from simmer_tui.report.counterfactuals import Change
from simmer_tui.report.moments import (
    Moment,
    MomentKind,
    command_moment,
    end_moment,
    grip_moment,
    lost_moment,
    program_moment,
    sight_moment,
    told,
)
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.run.events import ProgramEnded
from simmer_tui.run.history_rows import BeliefRow
from simmer_tui.run.phrases import exit_text, place_text, times_text
from simmer_tui.run.progress import HUNDRED
from simmer_tui.sim.command import WORD, cut
from simmer_tui.sim.specs import CELL_SIZE

# Judged: a good program crosses the maze with fewer movements.
STAYED, MOVES = 0.25, 20
"""Share of the time limit, and number of movements (or none), without progress that count as a cause."""
_CONNECT_ADVICE = "Connect to the address in SIMMER_HOST and SIMMER_PORT, and send a first command."
_LINK_ADVICE = "Check which command got no reply; simmer-tui doctor checks the ports."
_BY_ERROR = {
    # Editors and older systems have Pythons of their own.
    "ModuleNotFoundError: No module named 'simmer_tui'": (
        "Use the Python that has simmer_tui, or write 'from client import Robot' and copy client.py beside "
        "it (simmer-tui examples samples)."
    ),
    "EOFError": "Take the question out of your program: nobody can type under --run.",
    # A person at the keyboard ended it: its line is not wrong.
    "KeyboardInterrupt": "",
}
"""Advice by the beginning of an error."""
_SLOW_LINK = 0.5
"""Mean seconds of a reply on the link from which it is slow: ten times a Bluetooth link's. Judged."""
_COMPARE_MOTION = "Compare what your program adds to its belief with the command that it sends."
_COMPARE_RANGES = "Print the ranges as your program uses them, beside those of its map at its belief."
_WAITS_AT = "Find out what your program waits for, or repeats, at {place}."
_LOOK_AT_SKETCH = (
    "Find out what the sketch waits for; simmer-tui check DIR compares its pins with wiring.toml."
)
_NOT_NEAR = "Search for the block before you close the gripper: it was not near."
_READS_ON = "Print what your program compares in the loop that only reads, and what would end it."
_SPARE = {
    "reading": "Read {code} less often.",
    "the link": "Send several commands in one message: each message waits for the link.",
    "driving": "Drive further with each movement, on a shorter way.",
    "waiting": "Send the next command as soon as the reply has come.",
}
"""Advice by what most of the time went to."""


def crashed_fact(run: RunEvidence) -> Fact | None:
    """An exception or a signal that ended the program."""
    program, ended = run.program, program_moment(run)
    if program is None or ended is None or not program.crashed or program.stopped or run.has_contact:
        return None
    led = moved_fact(run) or stalled_fact(run) or (lost_fact(run) if run.lost_belief is not None else None)
    before = "" if led is None else f" {led.text or led.then}".rstrip()
    is_explained = led is None or led.has_behind
    advice = _crash_advice(run, program)
    return Fact(ended, f"{told(ended)}{_waited_text(run)}{before}", has_behind=is_explained, advice=advice)


def _crash_advice(run: RunEvidence, program: ProgramEnded) -> str:
    """One line to follow after the end of a program by an error; empty for none."""
    if not program.started:
        return "Run the command after --run alone in a terminal."
    for beginning, advice in _BY_ERROR.items():
        if program.error.startswith(beginning):
            return advice
    if run.ended_by_link:
        return _CONNECT_ADVICE if run.seen.is_silent else _LINK_ADVICE
    return f"Look at {program.place}, and print what it is given." if program.place else ""


def _waited_text(run: RunEvidence) -> str:
    """The last answered command of a program that ended because of its link; of one with another error its
    last reading. A sentence with a space before it."""
    last = run.last_command
    if last is not None and run.ended_by_link:
        mean = run.seen.spent.link / max(run.seen.commands, 1)
        slow = f" A reply took {mean:.1f} s on the link." if mean >= _SLOW_LINK else ""
        return f" The simulator's last answer was to {last[0]}, at {last[1]:.1f} s.{slow}"
    has_error = run.program is not None and run.program.error
    return f" Its last reading was {run.last_reading}." if has_error and run.last_reading else ""


def lost_fact(run: RunEvidence) -> Fact | None:
    """A belief that was wrong or unsure at the contact, the grip or the end."""
    seen, met, grip = run.seen, run.contact if run.has_contact else None, run.last_grip
    belief, lost, least = run.last_belief, lost_moment(run), 0.0
    if met is None:
        # A program that stopped for another reason may be off as well.
        is_silent = run.silence is not None and (seen.is_silent or not run.belief.text)
        if seen.task is None or (grip is None and (is_silent or run.ended_by_link)):
            return None
        # A miss that is larger than the error of the belief has another reason.
        least = run.missed_by / 2.0 if grip is not None else CELL_SIZE if run.unused_grip else 0.0
    if belief is None:
        return None
    if lost is not None and run.lost_belief is not None:
        return _lost_since(run, lost, run.lost_belief) if belief.distance >= least else None
    believed = None if met is None else met.saved_by(Change.BELIEVED)
    # A program that was stopped might have found its place.
    is_at_end = grip is None and not (least or run.stopped or stalled_fact(run))
    is_misled = belief.unsure and (is_at_end if met is None else believed is not False)
    if not (believed or is_misled):
        return None
    spread = "" if math.isnan(belief.spread) else f", with a spread of {belief.spread:.1f} in"
    unsure = ": it was not sure of its place" if belief.unsure else ""
    text = f"its last belief was off by {belief.error_text}{spread}{unsure}"
    at = Moment(MomentKind.LOST, belief.elapsed, text, belief.line, place=(belief.true_x, belief.true_y))
    return Fact(at, told(at), _then(run), has_behind=True)


def _lost_since(run: RunEvidence, at: Moment, lost: BeliefRow) -> Fact:
    """A belief that was wrong, the facts beside it, and what came of it."""
    parted, advice, ranges, is_misfit = run.belief.parted, None, "", False
    if not has_read_range(run.seen, lost.order):
        ranges = " It had read no range before that."
    # A wrong sensor is told instead; and no log has the truth of a real robot.
    elif not run.findings and run.belief.has_truth:
        ranges, is_misfit = ranges_before(run.seen, lost)
    compass = run.belief.unread_compass if lost.deviation.off_heading else ""
    if compass and not run.belief.was_right_before(lost.order):
        parted = f"{parted} {compass}, which tells the heading, was never read."
        advice = f"Read {compass} before you drive: it tells the heading."
    elif parted or is_small(lost) or not (lost.deviation.off_place or lost.deviation.rejects_truth):
        advice = _COMPARE_MOTION
    elif is_misfit:
        advice = _COMPARE_RANGES
    return Fact(at, f"{told(at)}{parted}{ranges}", _then(run), has_behind=True, advice=advice)


def _then(run: RunEvidence) -> str:
    """Sentences on what came of a wrong belief: contact, grip, silence or the end."""
    if run.has_contact and run.contact is not None:
        sight = sight_moment(run) if run.contact.is_blind else None
        return told(sight, command_moment(run), end_moment(run))
    if run.last_grip is not None:
        return told(grip_moment(run))
    return "" if run.stopped and run.silence is None else _end_text(run)


def _end_text(run: RunEvidence) -> str:
    """The end of a run in sentences: the silence or its reason, the program's line, and its last output."""
    if run.silence is None:
        return told(end_moment(run) or program_moment(run))
    where = f"When it was ended, the program was at {run.ended_at}." if run.ended_at else ""
    words = f"Its last output: {run.last_words.rstrip('.')}." if run.last_words else ""
    return " ".join(filter(None, (told(end_moment(run)), where, words)))


def silence_fact(run: RunEvidence) -> Fact | None:
    """No command in the last quarter of the time, or none at all."""
    seen, end = run.seen, end_moment(run)
    if run.silence is None or (seen.task is None and run.exit_code is None and not run.cut_off):
        return None
    if not seen.is_silent and end is not None:
        advice = _WAITS_AT.format(place=run.ended_at) if run.ended_at else None
        return Fact(end, then=_end_text(run), has_behind=True, advice=advice)
    text, advice = "The program sent no command at all.", _CONNECT_ADVICE
    if run.exit_code:
        text = f"{exit_text(run.exit_code).capitalize()} before it sent a command."
    elif seen.history.displays.first.given and run.exit_code is None:
        text, advice = "No board set a motor or read a sensor.", _LOOK_AT_SKETCH
    return Fact(end or _at_end(run, "the program sent no command"), text, advice=advice)


def missed_grip_fact(run: RunEvidence) -> Fact | None:
    """A gripper that closed on nothing, or was not used where it should have been."""
    seen, gripper, closed = run.seen, run.seen.spec.gripper, grip_moment(run)
    if seen.task is None or run.has_contact or gripper is None:
        return None
    if closed is not None and not seen.taken:
        return Fact(
            closed, told(closed), has_behind=True, advice=_NOT_NEAR if run.missed_by > CELL_SIZE else None
        )
    unused = run.unused_grip
    # What it had not done yet when time ran out it might have done.
    gets_on = seen.out_of_time and stalled_fact(run) is None
    if unused is None or run.stopped or gets_on:
        return None
    first, text, value = unused
    at = (first.x, first.y)
    marked = Moment(MomentKind.COMMAND, first.elapsed, text, first.line, gripper.code, at)
    return Fact(marked, told(marked), culprits=(gripper.code,), advice=f"Send {gripper.code}-{value} there.")


def dropped_fact(run: RunEvidence) -> Fact | None:
    """A block that was set down outside the drop zone."""
    seen, at = run.seen, grip_moment(run)
    if seen.task is None or seen.put_down is None or at is None or run.has_contact:
        return None
    zone, advice = seen.task.zone, None
    if run.left_at_place:
        advice = "Find out why your program opens the gripper there: it held the block."
    elif zone is not None:
        there = place_text(zone.x, zone.y)
        advice = f"Print where your program takes drop zone and block to be; the zone is at {there}."
    return Fact(at, f"{told(at)}{run.load_text(seen.put_down)}", has_behind=True, advice=advice)


def nowhere_fact(run: RunEvidence) -> Fact | None:
    """A robot that a wall held, or that reached no goal and no new place."""
    seen, stuck = run.seen, run.seen.stuck
    if seen.task is None:
        return None
    if stuck is not None and seen.collision is not None and not run.has_contact:
        pose = seen.collision.row.pose
        text = f"it was stuck at {place_text(pose.x, pose.y)}: {stuck.text}"
        at = Moment(MomentKind.COMMAND, stuck.since, text, place=(pose.x, pose.y))
        return Fact(at, told(at), has_behind=True)
    fact = stalled_fact(run)
    if fact is None or not run.has_contact:
        return fact
    return replace(fact, then=f"{fact.then} {_then(run)}".lstrip())


def stalled_fact(run: RunEvidence) -> Fact | None:
    """It continued to move, or only to read, and reached no goal and no new place."""
    seen, task, stalled = run.seen, run.seen.task, run.seen.stalled
    if task is None:
        return None
    long = STAYED * task.time_limit
    if run.corrections:
        first = run.corrections[0]
        at = Moment(MomentKind.COMMAND, first.elapsed, first.text, first.line, first.of[0])
        return Fact(at, told(at), has_behind=True, culprits=first.of, advice=first.advice)
    moves, readings = seen.within(seen.history.movements), seen.within(seen.history.readings)
    since = float(moves["elapsed"][-1]) if len(moves) else seen.begun
    later = int((readings["elapsed"] > since).sum())
    if later >= HUNDRED and seen.elapsed - since >= long:
        began = "the last movement ended" if len(moves) else "the run began"
        text = f"{began}; after that came {later} readings, the last {run.last_reading}"
        at = Moment(MomentKind.COMMAND, since, text)
        return Fact(at, then=f"{told(at)} {run.stand_text}".rstrip(), has_behind=True, advice=_READS_ON)
    # A robot that stands and reads is slow, not without progress: half of the time must have been driving.
    lasted = seen.elapsed - stalled.since
    is_idle = lasted < long or stalled.driving < lasted / 2
    if stalled.movements < (HUNDRED if is_idle or not seen.out_of_time else MOVES):
        return None
    text = f"progress ended: {run.stalled_text}"
    at = Moment(MomentKind.COMMAND, stalled.since, text, place=(stalled.place.x, stalled.place.y))
    return Fact(at, then=told(at), has_behind=True)


def slow_fact(run: RunEvidence) -> Fact | None:
    """A time limit that was reached."""
    seen, spent, task = run.seen, run.seen.spent, run.seen.task
    if run.has_contact or not (seen.out_of_time or run.cut_off):
        return None
    at = end_moment(run) or _at_end(run, "the run was ended at its time limit")
    if not seen.out_of_time:
        return Fact(at, "At the real time limit the program was still running.")
    most = next(iter(run.time_parts))
    listed = ", ".join(f"{name} {time:.1f} s" for name, time in run.time_parts.items() if time >= 0.05)
    code = next((code for code, _ in spent.took.most_common(1)), "")
    took = f"{code} {times_text(spent.readings[code])}, {spent.took[code] / 1000.0:.1f} s"
    read = f" It read sensors {times_text(spent.readings.total())} ({took})." if code else ""
    is_most = 2.0 * run.time_parts[most] > seen.elapsed - seen.begun
    text = f"Most of its time went to {most} ({listed})." if is_most else f"Its time went to {listed}."
    nominal, limit = seen.history.nominal, seen.elapsed if task is None else task.time_limit
    if nominal is not None and limit < (nominal.time_limit or 0.0):
        text = f"The time limit was {limit:g} s, in the set {nominal.name} {nominal.time_limit:g} s. {text}"
    if seen.stalled.movements >= MOVES:
        read += f" From {seen.stalled.since:.1f} s on, {run.stalled_text}."
    advice = _SPARE[most].format(code=code) if is_most else None
    return Fact(at, then=text + read, has_behind=True, advice=advice)


def lacked_time(run: RunEvidence) -> bool:
    """True if time ran out, most of it went to one thing but driving, and the robot got on until then: what
    it had not done yet it might have done."""
    most, seconds = next(iter(run.time_parts.items()))
    is_slow = most != "driving" and 2.0 * seconds > run.seen.elapsed - run.seen.begun
    return run.seen.out_of_time and is_slow and stalled_fact(run) is None


def ended_fact(run: RunEvidence) -> Fact | None:
    """A program that ended by itself."""
    seen, at = run.seen, program_moment(run)
    if run.has_contact or at is None or run.exit_code is None or (seen.task is None and not run.exit_code):
        return None
    text = " ".join(filter(None, (f"{told(at)}{_waited_text(run)}", run.still_text, run.stand_text)))
    # Of a real robot's jaws no log has the truth.
    is_known = seen.task is not None and seen.spec.gripper is not None and not seen.history.is_twin
    if is_known and not (seen.closed or seen.is_silent):
        text += " The gripper was never closed."
    advice = None
    if run.ended_by_link:
        advice = _LINK_ADVICE
    elif run.last_words and run.exit_code:
        advice = f"Look in your program at what leads to '{cut(run.last_words, WORD)}'."
    return Fact(at, then=text, has_behind=True, advice=advice)


def _at_end(run: RunEvidence, text: str) -> Moment:
    return Moment(MomentKind.END, run.seen.elapsed, text, run.seen.line)
