"""Causes of a run without a contact that ended it: belief, gripper, progress, time, and the program's end."""

from __future__ import annotations

import math

from msgspec.structs import replace

from simmer_tui.report.belief_facts import has_read_range, is_small, ranges_before
from simmer_tui.report.cause_text import (
    Fact,
    ended_by_link,
    lost_text,
    quiet_text,
    stand_text,
    then_text,
    waited_text,
)
from simmer_tui.report.command_causes import moved_fact
from simmer_tui.report.counterfactuals import Change
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.run.facts import missed_zone
from simmer_tui.run.history_rows import BeliefRow, GripRow
from simmer_tui.run.phrases import (
    capitalized,
    exit_text,
    miss_text,
    outside_text,
    place_text,
    program_end_text,
    times_text,
)
from simmer_tui.run.progress import GROUND, HUNDRED
from simmer_tui.sim.command import WORD, counted, cut
from simmer_tui.sim.specs import CELL_SIZE

# Judged: a good program crosses the maze with fewer movements.
STAYED, MOVES = 0.25, 20
"""Share of the time limit, and number of movements (or none), without progress that count as a cause."""
CONNECT_ADVICE = "connect to the address in SIMMER_HOST and SIMMER_PORT, and send a first command."
LINK_ADVICE = "look which command got no reply; simmer-tui doctor checks the ports."
_COMPARE_MOTION = "Compare what your program adds to its belief with the command that it sends."
_COMPARE_RANGES = "Print the ranges as your program uses them, beside those of its map at its belief."
_KEEP_OPEN = "Keep one connection open for all commands."
_WAITS_AT = "Find out what your program waits for, or repeats, at {place}."
_LOOK_AT_SKETCH = (
    "Find out what the sketch waits for; simmer-tui check DIR compares its pins with wiring.toml."
)
_NOT_NEAR = "Search for the block before you close the gripper: it was not near."
_SPARE = {
    "reading": "Read {code} less often.",
    "the link": "Send several commands in one message: each message waits for the link.",
    "driving": "Drive further with each movement, on a shorter way.",
    "waiting": "Send the next command as soon as the reply has come.",
}
"""Advice by what most of the time went to."""


def crashed_fact(run: RunEvidence) -> Fact | None:
    """An exception or a signal that ended the program."""
    program = run.program
    if program is None or not program.crashed or program.stopped or run.has_contact:
        return None
    led = moved_fact(run) or stalled_fact(run)
    before = "" if led is None else f" {led.text}{led.then}"
    text = f"{capitalized(program_end_text(program))}.{waited_text(run)}{before}"
    return Fact(text, culprits=() if led is None else led.culprits, has_behind=led is None)


def lost_fact(run: RunEvidence) -> Fact | None:
    """A belief that was wrong or unsure at the contact, the grip or the end."""
    seen, met, grip = run.seen, run.contact if run.has_contact else None, run.last_grip
    least = CELL_SIZE if run.unused_grip else 0.0
    if met is not None:
        belief, lost, least = met.belief, met.lost, 0.0
    elif seen.task is None or (run.silence is not None and (seen.is_silent or not run.belief.text)):
        # A program that stopped for another reason may be off as well.
        return None
    elif grip is not None:
        # A miss that is larger than the error of the belief has another reason.
        belief, lost = seen.belief_before(grip.order)
        least = run.missed_by / 2.0
    else:
        belief, lost = seen.beliefs
    if belief is None:
        return None
    if lost is not None:
        return _lost_since(run, lost) if belief.distance >= least else None
    believed = None if met is None else met.saved_by(Change.BELIEVED)
    # A program that was stopped might have found its place.
    is_at_end = grip is None and not (least or run.stopped or stalled_fact(run))
    is_misled = belief.unsure and (is_at_end if met is None else believed is not False)
    if not (believed or is_misled):
        return None
    spread = "" if math.isnan(belief.spread) else f", with a spread of {belief.spread:.1f} in"
    began = "It was not sure of its place: its" if belief.unsure else "Its"
    text = f"{began} last belief was off by {belief.error_text}{spread}."
    return Fact(text, belief, has_behind=True, then=then_text(run))


def _lost_since(run: RunEvidence, lost: BeliefRow) -> Fact:
    """A belief that was wrong, the facts beside it, and what came of it."""
    parted, advice, ranges, is_misfit = run.belief.parted, None, "", False
    if not has_read_range(run.seen, lost.order):
        ranges = " It had read no range before that."
    # A wrong sensor is told instead; and no log has the truth of a real robot.
    elif not run.findings and run.belief.has_truth:
        ranges, is_misfit = ranges_before(run.seen, lost)
    compass = run.belief.unread_compass if lost.deviation.off_heading else ""
    if compass and not run.belief.was_right:
        parted = f"{parted} {compass}, which tells the heading, was never read."
        advice = f"Read {compass} before you drive: it tells the heading."
    elif parted or is_small(lost) or not (lost.deviation.off_place or lost.deviation.rejects_truth):
        advice = _COMPARE_MOTION
    elif is_misfit:
        advice = _COMPARE_RANGES
    text = f"{capitalized(lost_text(run, lost))}.{parted}{ranges}"
    return Fact(text, lost, has_behind=True, advice=advice, then=then_text(run))


def silence_fact(run: RunEvidence) -> Fact | None:
    """No command in the last quarter of the time, or none at all."""
    seen, quiet = run.seen, run.silence
    if quiet is None or (seen.task is None and run.exit_code is None and not run.cut_off):
        return None
    if seen.is_silent:
        text = "The program sent no command at all."
        if seen.history.displays.first.given and run.exit_code is None:
            text = "No board set a motor or read a sensor."
            return Fact(text, since=seen.elapsed, advice=_LOOK_AT_SKETCH)
        if run.exit_code:
            text = f"{capitalized(exit_text(run.exit_code))} before it sent a command."
        return Fact(text, since=seen.elapsed, advice=capitalized(CONNECT_ADVICE))
    advice = _WAITS_AT.format(place=run.ended_at) if run.ended_at else None
    return Fact("", since=quiet.since, then=quiet_text(run), has_behind=True, advice=advice)


def missed_grip_fact(run: RunEvidence) -> Fact | None:
    """A gripper that closed on nothing, or was not used where it should have been."""
    seen, gripper = run.seen, run.seen.spec.gripper
    if seen.task is None or run.has_contact or gripper is None:
        return None
    if seen.misses and not seen.taken:
        return _closed_on_nothing(run)
    unused = run.unused_grip
    if unused is None or run.stopped or lacked_time(run):
        return None
    first, what, value = unused
    text = f"The gripper was never {what}, first at {first.elapsed:.1f} s."
    advice = f"Send {gripper.code}-{value} there."
    return Fact(text, first, place=(first.x, first.y), culprits=(gripper.code,), advice=advice)


def _closed_on_nothing(run: RunEvidence) -> Fact:
    done, count = run.seen.misses[-1], len(run.seen.misses)
    missed = done.grip.missed
    often = "" if count == 1 else f" {times_text(count)}"
    closed = run.closed_before(done)
    if closed is not None and missed is not None and not any(missed):
        last = f": its jaws were closed since {closed.elapsed:.1f} s"
    else:
        last = "" if missed is None else f"{'. The last time, ' if often else ': '}{miss_text(missed)}"
    is_far = missed is not None and math.hypot(*missed) > CELL_SIZE
    return Fact(
        f"The gripper closed on nothing{often}{last}.",
        done,
        place=(done.grip.block.x, done.grip.block.y),
        has_behind=True,
        advice=_NOT_NEAR if is_far else None,
    )


def dropped_fact(run: RunEvidence) -> Fact | None:
    """A block that was set down outside the drop zone."""
    seen, done = run.seen, run.seen.put_down
    if seen.task is None or done is None or run.has_contact:
        return None
    block, zone = done.grip.block, seen.task.zone
    where, off, advice = place_text(block.x, block.y), "not in the drop zone", None
    if zone is not None:
        there = place_text(zone.x, zone.y)
        off = f"{outside_text(missed_zone(zone, block.x, block.y))} the cell around {there}"
        advice = f"Print where your program takes drop zone and block to be; the zone is at {there}."
    text = f"It set the block down outside the drop zone: at {where}, {off}."
    lay = next((row.block for row in seen.history.blocks.items if not row.held), block)
    if lay is not block and math.hypot(block.x - lay.x, block.y - lay.y) <= GROUND:
        text = f"It took the block {times_text(seen.takes)}, and let it go where it lay: at {where}, {off}."
        advice = "Find out why your program opens the gripper there: it held the block."
    for each in seen.load_sensors:
        text += f" {each.code} {_load_text(run, each.code, done)} before that."
    return Fact(text, done, place=(block.x, block.y), has_behind=True, advice=advice)


def _load_text(run: RunEvidence, code: str, done: GripRow) -> str:
    """The last reading of a load sensor before a grip, in words."""
    readings, codes = run.seen.within(run.seen.history.readings), run.seen.history.sensor_codes
    mine = readings[[codes[number] == code for number in readings["sensor"]]]
    values = mine["value"][mine["order"] < done.order]
    return f"read {values[-1]:g}" if len(values) else "was never read"


def nowhere_fact(run: RunEvidence) -> Fact | None:
    """A robot that a wall held, or that reached no goal and no new place."""
    seen, stuck = run.seen, run.seen.stuck
    if seen.task is None:
        return None
    if stuck is not None and seen.collision is not None and not run.has_contact:
        pose = seen.collision.row.pose
        return Fact(
            f"It was stuck at {place_text(pose.x, pose.y)}: {stuck.text}.", since=stuck.since, has_behind=True
        )
    fact = stalled_fact(run)
    if fact is None or not run.has_contact:
        return fact
    return replace(fact, then=f"{fact.then} {then_text(run)}".lstrip())


def stalled_fact(run: RunEvidence) -> Fact | None:
    """It continued to move, or only to read, and reached no goal and no new place."""
    seen, task = run.seen, run.seen.task
    if task is None:
        return None
    stalled, long = seen.stalled, STAYED * task.time_limit
    if run.corrections:
        # The table behind the fact tells of them.
        first = run.corrections[0]
        return Fact("", since=first.elapsed, culprits=first.of, advice=first.advice, has_behind=True)
    stays = _stays(run, long)
    if stays is not None:
        return stays
    # A robot that stands and reads is slow, not without progress: half of the time must have been driving.
    lasted = seen.elapsed - stalled.since
    idle = lasted < long or stalled.driving < lasted / 2
    if stalled.movements >= (HUNDRED if idle or not seen.out_of_time else MOVES):
        turned = f", {stalled.turned:.0f} deg" if stalled.turned >= 1.0 else ""
        moved = f"{stalled.movements} movements ({stalled.driven:.0f} in{turned})"
        text = f"From {stalled.since:.1f} s on, {moved} reached no goal and no new place"
        often = run.movements_by_code(stalled.since)
        text = f"{text}: {often}." if often else f"{text}."
        place = (stalled.place.x, stalled.place.y)
        return Fact("", since=stalled.since, place=place, has_behind=True, then=text)
    return None


def _stays(run: RunEvidence, long: float) -> Fact | None:
    """It read on, and moved no more for so many seconds."""
    seen, history = run.seen, run.seen.history
    moves, readings = seen.within(history.movements), seen.within(history.readings)
    since = float(moves["elapsed"][-1]) if len(moves) else seen.begun
    later = int((readings["elapsed"] > since).sum())
    if later < HUNDRED or seen.elapsed - since < long:
        return None
    came = f"{counted(later, 'reading')} did, the last {run.last_reading}"
    text = f"From {since:.1f} s on no movement came, and {came}. {stand_text(run)}".rstrip()
    advice = "Print what your program compares in the loop that only reads, and what would end it."
    return Fact("", since=since, advice=advice, has_behind=True, then=text)


def slow_fact(run: RunEvidence) -> Fact | None:
    """A time limit that was reached."""
    seen, spent = run.seen, run.seen.spent
    if run.has_contact or not (seen.out_of_time or run.cut_off):
        return None
    if run.cut_off and not seen.out_of_time:
        return Fact("At the real time limit the program was still running.")
    most = next(iter(run.time_parts))
    listed = ", ".join(f"{name} {time:.1f} s" for name, time in run.time_parts.items() if time >= 0.05)
    counts = spent.took if most == "reading" else spent.readings
    code = next((code for code, _ in counts.most_common(1)), "")
    often = times_text(spent.readings[code])
    if most == "reading":
        often = f"{often}, {spent.took[code] / 1000.0:.1f} s"
    read = f" It read sensors {times_text(spent.readings.total())} ({code} {often})." if code else ""
    is_most = 2.0 * run.time_parts[most] > seen.elapsed - seen.begun
    limit = f"{seen.task.time_limit:g} s" if seen.task is not None and not run.cut_off else "time"
    text = f"Most of its time went to {most} ({listed})." if is_most else f"Its {limit} went to {listed}."
    advice = _SPARE[most].format(code=code) if is_most else None
    nominal = seen.history.nominal
    if run.velocities_left:
        text, advice = f"{_left_text(run)} {text}", _KEEP_OPEN
    elif seen.task is not None and nominal is not None and seen.task.time_limit < (nominal.time_limit or 0.0):
        usual = f"in the set {nominal.name} {nominal.time_limit:g} s"
        text = f"The time limit was {seen.task.time_limit:g} s, {usual}. {text}"
    return Fact("", has_behind=True, advice=advice, then=text + read)


def _left_text(run: RunEvidence) -> str:
    """A sentence on velocities that ended with the connections by which they came."""
    often = f"it made {run.velocities_left} for {counted(run.seen.commands, 'command')}"
    return f"Its velocities ended with their connections: {often}."


def lacked_time(run: RunEvidence) -> bool:
    """True if time ran out, most of it went to one thing but driving, and the robot got on until then: what
    it had not done yet it might have done."""
    most, seconds = next(iter(run.time_parts.items()))
    is_slow = most != "driving" and 2.0 * seconds > run.seen.elapsed - run.seen.begun
    return run.seen.out_of_time and is_slow and stalled_fact(run) is None


def ended_fact(run: RunEvidence) -> Fact | None:
    """A program that ended by itself."""
    seen = run.seen
    if run.has_contact or run.program is None or run.exit_code is None:
        return None
    if seen.task is None and not run.exit_code:
        return None
    words = f" Its last output: {run.last_words}." if run.last_words else ""
    limit = "" if seen.task is None else f" after {seen.seconds:.1f} of {seen.task.time_limit:g} s"
    ended = f"{capitalized(exit_text(run.exit_code))}{limit}, before it was done."
    text = f"{ended}{words}{waited_text(run)} {stand_text(run)}".rstrip()
    # Of a real robot's jaws no log has the truth.
    is_known = seen.task is not None and seen.spec.gripper is not None and not seen.history.is_twin
    if is_known and not (seen.closed or seen.is_silent):
        text += " The gripper was never closed."
    advice = None
    if ended_by_link(run.last_words):
        advice = capitalized(LINK_ADVICE)
    elif run.velocities_left:
        text, advice = f"{_left_text(run)} {text}", _KEEP_OPEN
    elif run.last_words and run.exit_code:
        advice = f"Look in your program at what leads to '{cut(run.last_words, WORD)}'."
    return Fact("", has_behind=True, advice=advice, then=text)
