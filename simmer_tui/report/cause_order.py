"""The order of causes: the first rule that holds names the cause of a failed run.

`ORDER` is the one place of their precedence. docs/causes.md is made from it (scripts/make_reference.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.config.mission_plan import cells_of
from simmer_tui.report.belief_facts import is_small
from simmer_tui.report.causes import Cause, Kind, MomentKind, Sureness
from simmer_tui.report.contact_evidence import ContactEvidence, DriveErrors, belief_text, shown_tried
from simmer_tui.report.finding import FEWEST, Finding
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.report.typical_runs import most_different
from simmer_tui.report.why import looks_there, shown_range
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.facts import SLIGHT, displacement, missed_zone
from simmer_tui.run.history_rows import BeliefRow, GripRow, RefusalRow
from simmer_tui.run.phrases import (
    body_text,
    capitalized,
    exit_text,
    grip_ending,
    miss_text,
    obstacle_place,
    outside_text,
    place_text,
    program_end_text,
    sent_text,
    times_text,
)
from simmer_tui.run.progress import GROUND, HUNDRED
from simmer_tui.run.run_history import CHAIN
from simmer_tui.run.table import Timed
from simmer_tui.sim.command import WORD, counted, cut
from simmer_tui.sim.specs import BLOCK, CELL_SIZE

# Judged: a good program crosses the maze with fewer movements.
REFUSED_SHARE = 0.05
"""Share of movements that were refused, and never carried out, from which they changed the path. Judged."""
STAYED, MOVES = 0.25, 20
"""Share of the time limit, and number of movements (or none), without progress that count as a cause."""
LINK_ENDED = ("Connection", "BrokenPipe")
LINK_WAITED = ("Timeout", "socket.timeout", "asyncio.TimeoutError")
"""Beginnings of errors with which a program tells that its link ended, or gave no reply."""
CONNECT_ADVICE = "connect to the address in SIMMER_HOST and SIMMER_PORT, and send a first command."
_LINK_WORDS = ("closed the connection", "no reply to")
"""Words of the client of this project, and of others, for a link that ended, or gave no reply."""
LINK_ADVICE = "which command got no reply, and who closed the connection; simmer-tui doctor checks the ports."
_MAP_ADVICE = "Look whether your program's map has {wall}, and compare each movement with the distance to it."
"""Advice where a right belief led into a wall."""
_GOES_ON = "End the velocity in time: send {code} with zeros. It goes on until another one comes."
_NO_SENSOR_THERE = "No sensor looks to that side: turn until one does, or check the way in your map."
_OUTLIER_ADVICE = "Read {code} three times and take the middle value, before each movement."
_NO_ECHO_ADVICE = "Take a reading of {code} with nothing in range for no proof of a free way."
_COMPARE_MOTION = "Compare what your program adds to its belief for a {what} with the command that it sends."
_CORRECT = "Measure after each movement, and correct for the drive's error."
_SPARE = {
    "reading": "Read {code} less often.",
    "the link": "Send several commands in one message: each message waits for the link.",
    "driving": "Drive further with each movement, on a shorter way.",
    "waiting": "Send the next command as soon as the reply has come.",
}
"""Advice by what most of the time went to."""
_NAMED = 4
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


class CauseRule(Struct, frozen=True):
    """A rule: it holds where `find` gives a fact. `when` is its condition for the page, `excludes` what it
    rules out, `advice` one line to follow (empty for none), `moment` the kind of moment that is marked."""

    kind: Kind
    find: Callable[[RunEvidence], Fact | None]
    moment: MomentKind
    when: str
    excludes: str
    advice: str = ""


def cause_of(run: RunEvidence) -> Cause:
    """The cause of a failed run: the first rule of `ORDER` that holds, else the unknown one."""
    cause = _first(run, ORDER)
    return cause or _made(run, NO_RULE, Fact(f"Unknown. {most_different(run.seen)}"))


def cause_so_far(run: RunEvidence) -> Cause | None:
    """The cause that a run which was stopped has shown so far; None without one. What it had not done yet it
    might have done."""
    return _first(run, [rule for rule in ORDER if rule.kind not in _AT_THE_END])


def _first(run: RunEvidence, rules: Sequence[CauseRule]) -> Cause | None:
    for rule in rules:
        fact = rule.find(run)
        if fact is not None:
            return _made(run, rule, fact)
    return None


def advice_on(kind: Kind) -> str:
    """One line to follow for a kind of cause; empty for none."""
    return next((rule.advice for rule in ORDER if rule.kind is kind), "")


def _made(run: RunEvidence, rule: CauseRule, fact: Fact) -> Cause:
    seen, parts, culprits = run.seen, [fact.text], fact.culprits
    advice = rule.advice if fact.advice is None else fact.advice
    if fact.has_behind or rule is NO_RULE:
        declared, marked = _declared(run)
        behind, codes = _behind(run)
        if marked and rule.kind is not Kind.TOO_SLOW:
            named = " and ".join(marked)
            advice = f"Give your program the numbers of this set for {named}, or correct for them."
        parts += [declared, behind]
        culprits = tuple(dict.fromkeys((*culprits, *marked, *codes)))
    met = run.contact if run.has_contact else None
    parts.append(fact.then)
    goals = _goals(run)
    if met is None and rule.kind in _ABOUT_GOALS:
        parts.append(goals)
    text = " ".join(filter(None, parts))
    evidence: tuple[str, ...] = (run.arrived_text, belief_text(seen, seen.beliefs[0]), goals)
    if met is not None:
        tried = shown_tried(met.tried, wrong_drive=bool(run.findings_about(drives=True)))
        evidence = (run.arrived_text, belief_text(seen, met.met.belief), tried)
    elif seen.is_silent:
        evidence = (f"Last output: {run.last_words}." if run.last_words else "",)
    # A reason may end with a question; a sentence ends with one mark.
    text = text.replace("?.", "?")
    at = fact.at
    elapsed = fact.since if fact.since is not None else seen.elapsed if at is None else at.elapsed
    return Cause(
        kind=rule.kind,
        text=text,
        evidence=tuple(each for each in evidence if each and each not in text),
        elapsed=elapsed,
        line=getattr(at, "line", seen.line),
        place=fact.place or (seen.pose.x, seen.pose.y),
        moment=fact.moment or rule.moment,
        tried=met.tried if met is not None else (),
        sure=fact.sure,
        culprits=culprits,
        advice=advice,
    )


def _behind(run: RunEvidence) -> tuple[str, tuple[str, ...]]:
    """Sentences of the tables that stand behind a fact: wrong devices, else beliefs or corrections. And the
    codes of the devices."""
    if run.findings and run.seen.task is not None:
        told, codes = _told(run.findings)
        return told, codes
    text, codes = run.belief.text, run.belief.culprits
    if codes or not run.corrections:
        return text, codes
    told = ", and ".join(each.text for each in run.corrections)
    of = tuple(dict.fromkeys(code for each in run.corrections for code in each.of))
    return f"{text} {told}.".strip(), of


def _declared(run: RunEvidence) -> tuple[str, tuple[str, ...]]:
    """Sentences on devices with a large error that their set declares, and their codes."""
    if run.seen.task is None:
        return "", ()
    codes = tuple(run.declared)[:_NAMED]
    return " ".join(f"By this robot's set, {code} {run.declared[code]}." for code in codes), codes


# -- commands ----------------------------------------------------------------------------------------------


def _wire(run: RunEvidence) -> Fact | None:
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


def _refused(run: RunEvidence) -> Fact | None:
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
    lost = run.contact.lost if run.has_contact and run.contact is not None else seen.beliefs[1]
    row = None if lost is None else run.refused_before(lost)
    if lost is not None and row is not None:
        return _undone(run, [row], f"{capitalized(lost_text(run, lost))}. {_then(run)}")
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
        return _undone(run, rows, _then(run)) if rows and len(rows) >= REFUSED_SHARE * of else None
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


def _crashed(run: RunEvidence) -> Fact | None:
    program = run.program
    if program is None or not program.crashed or program.stopped or run.has_contact:
        return None
    led = _moved(run) or _stalled(run)
    before = "" if led is None else f" {led.text}{led.then}"
    text = f"{capitalized(program_end_text(program))}.{waited_text(run)}{before}"
    return Fact(text, culprits=() if led is None else led.culprits, has_behind=led is None)


def _moved(run: RunEvidence) -> Fact | None:
    seen = run.seen
    row = seen.moved
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


def _silence(run: RunEvidence) -> Fact | None:
    seen, quiet = run.seen, run.silence
    if quiet is None or (seen.task is None and run.exit_code is None and not run.cut_off):
        return None
    if seen.is_silent:
        text = "The program sent no command at all."
        if run.exit_code:
            text = f"{capitalized(exit_text(run.exit_code))} before it sent a command."
        return Fact(text, since=seen.elapsed, advice=f"{capitalized(CONNECT_ADVICE)}")
    return Fact("", since=quiet.since, then=_quiet(run), has_behind=True)


def _quiet(run: RunEvidence) -> str:
    """The time without a command at the end, in sentences; empty without one."""
    quiet, last = run.silence, run.last_command
    if quiet is None:
        return ""
    end = f"The run was ended at the {'real ' if run.cut_off else ''}time limit."
    if run.stopped:
        end = f"The program was stopped {quiet.real_seconds:.0f} s of real time later."
    after = "" if last is None else f", when {last[0]} was answered"
    words = f" Its last output: {run.last_words.rstrip('.')}." if run.last_words else ""
    return f"No command came after {quiet.since:.1f} s{after}. {end}{words}"


# -- sensors and drives ------------------------------------------------------------------------------------


def _unread(run: RunEvidence) -> Fact | None:
    met = run.contact
    if run.has_contact:
        if met is None or not met.is_blind:
            return None
        codes = [] if met.looks is None or not looks_there(met.looks) else met.looks.codes
        advice = (
            f"Read {codes[0]} before you send {met.met.ended.command.code}." if codes else _NO_SENSOR_THERE
        )
        if met.goes_on and not met.belief:
            advice = _GOES_ON.format(code=met.met.ended.command.code)
        if met.quiet_since is not None:
            codes, advice = (
                [],
                "Read and send more often under a velocity, or set it to 0 while your program computes.",
            )
        silent = _silent(run)
        if silent and not codes[1:]:
            advice = f"Check what your program does when {silent} reads nothing in range."
        text = f"{silent} read nothing in range; then {_sent(run)}" if silent else _sent(run)
        fact = _at_contact(run, met, f"{text}. {met.unread_text}", advice=advice)
        return replace(fact, culprits=tuple(codes[:1]))
    unseen = None if run.seen.closed else run.unseen_block
    if unseen is None or run.seen.stuck is not None or run.seen.beliefs[1] is not None or _lacked_time(run):
        return None
    # A robot that had stopped making progress before saw the block by chance.
    stalled = _stalled(run)
    is_before = stalled is not None and stalled.since is not None and stalled.since < unseen.since
    if is_before and not run.goals:
        return None
    names, was, sees = _alone(unseen.codes)
    it = "it" if len(unseen.codes) == 1 else "they"
    goal = run.goals[-1] if run.goals else None
    read = f"{was} never read"
    if goal is not None and any(code in run.seen.history.sensor_codes for code in unseen.codes):
        read = f"{was} not read after {goal.elapsed:.1f} s ({goal.event.subject.value})"
    return Fact(
        f"{names} {read}, and {it} alone {sees} the block. The block was in sight at {unseen.since:.1f} s.",
        since=unseen.since,
        culprits=unseen.codes,
        advice=f"Read {unseen.codes[0]} before you drive to the block.",
        moment=MomentKind.SIGHT,
    )


def _alone(codes: Sequence[str]) -> tuple[str, str, str]:
    """The codes of sensors, and the forms of "to be" and "to see" behind them."""
    return " and ".join(codes), *(("was", "sees") if len(codes) == 1 else ("were", "see"))


def _known_wall(run: RunEvidence) -> Fact | None:
    met = run.contact
    if not run.has_contact or met is None:
        return None
    shown = met.ignored
    # A wrong sensor shows the program something else than its set says.
    if shown is not None and all(each.of != shown.code for each in run.findings):
        read = f"{shown.code} read {shown_range(shown.value)} at {shown.elapsed:.1f} s; then {_sent(run)}"
        advice = (
            f"Compare each movement with {shown.code} before you send it, "
            "and print what your program has for it."
        )
        return _at_contact(run, met, _with_belief(met, read), advice=advice)
    if not met.is_into_known:
        return None
    unread = f". {met.unread_text}" if met.is_blind else ""
    return _at_contact(run, met, f"{_with_belief(met, _sent(run))}{unread}", advice=_wall_advice(run, met))


def _wall_advice(run: RunEvidence, met: ContactEvidence) -> str:
    """Advice where a command led into a wall: a right belief leaves the map, which has the outer wall."""
    if not met.knew or met.is_outer_wall:
        return advice_on(Kind.KNOWN_WALL)
    return _MAP_ADVICE.format(wall=obstacle_place(met.met.contact, run.seen.spec))


def _at_contact(run: RunEvidence, met: ContactEvidence, text: str, *, advice: str | None = None) -> Fact:
    """A fact about the command that led to a contact."""
    place = met.met.contact.point
    unread = f" {met.not_read}." if met.not_read and met.not_read not in text else ""
    outline = met.outline_text if met.knew else ""
    if outline:
        advice = "Give your program the outline of this robot."
    then = f"{_contact(run)}{outline or met.narrow_text}{unread}"
    return Fact(f"{text}.", met.met.row, met.sent, place, has_behind=True, advice=advice, then=then)


def _sensor_wrong(run: RunEvidence) -> Fact | None:
    found = run.findings_about(drives=False)
    if found and run.seen.task is not None:
        return _devices(run, found)
    met = run.contact if run.has_contact else None
    if met is None:
        return None
    last = None if met.is_blind else met.misread
    if last is None:
        return None
    advice = _NO_ECHO_ADVICE if math.isinf(last.value) else _OUTLIER_ADVICE
    true = f", the true distance was {shown_range(last.true)}" if math.isfinite(last.true) else ""
    read = f"{last.code} read {shown_range(last.value)} at {last.time:.1f} s{true}"
    at_sight = met.facing is last
    return Fact(
        f"{read}; then {_sent(run)}.",
        None if at_sight else met.met.row,
        since=last.time,
        place=met.met.contact.point,
        culprits=(last.code,),
        advice=advice.format(code=last.code),
        moment=MomentKind.SIGHT if at_sight else None,
        has_behind=True,
        then=_contact(run),
    )


def _drive_wrong(run: RunEvidence) -> Fact | None:
    found = run.findings_about(drives=True)
    if found and run.seen.task is not None:
        return _devices(run, found)
    met = run.contact if run.has_contact else None
    errors = None if met is None or met.is_blind else met.drive_errors
    if met is None or errors is None or not errors.large:
        return None
    sure = Sureness.CERTAIN if errors.certain else Sureness.LIKELY
    text = f"{_sent(run)}. {_contact(run)} {_without(errors)}"
    place = met.met.contact.point
    return Fact(text, met.met.row, met.sent, place, errors.codes, moment=MomentKind.COMMAND, sure=sure)


def _without(errors: DriveErrors) -> str:
    moves = "the movement" if errors.count == 1 else f"the last {counted(errors.count, 'movement')}"
    return f"Without the errors of {' and '.join(errors.codes)} in {moves}, nothing would have been touched."


def _devices(run: RunEvidence, found: Sequence[Finding]) -> Fact:
    told, codes = _told(found)
    others = [each for each in run.findings if each not in found]
    besides = f" Also {others[0].text}." if others else ""
    first, advice = found[0], None
    if first.other is not None:
        advice = f"Exchange the cables of {first.of} and {first.other}, or their codes in your program."
    since = _first_use(run.seen, codes[0])
    return Fact(f"{told}{besides}", since=since, culprits=codes, advice=advice, sure=Sureness.LIKELY)


def _told(found: Sequence[Finding]) -> tuple[str, tuple[str, ...]]:
    """Findings as sentences, and the codes of their devices."""
    told = ". ".join(each.text for each in found[:_NAMED])
    more = f". Besides: {counted(len(found) - _NAMED, 'other finding')}" if len(found) > _NAMED else ""
    return f"{told}{more}.", tuple(dict.fromkeys(each.of for each in found))


def _first_use(seen: Attempt, code: str) -> float:
    """The time of the first reading of a sensor, or of the first movement of a drive."""
    history = seen.history
    readings, moves = seen.within(history.readings), seen.within(history.movements)
    times = readings["elapsed"][[history.sensor_codes[number] == code for number in readings["sensor"]]]
    used = moves["elapsed"][[history.code_names[number] == code for number in moves["code"]]]
    return float(min((*times[:1], *used[:1]), default=seen.begun))


# -- the gripper -------------------------------------------------------------------------------------------


def _missed_grip(run: RunEvidence) -> Fact | None:
    seen, gripper = run.seen, run.seen.spec.gripper
    if seen.task is None or run.has_contact or gripper is None:
        return None
    if seen.misses and not seen.taken:
        return _closed_on_nothing(run, seen.misses[-1], gripper.code)
    unused = run.unused_grip
    if unused is None or run.stopped or _lacked_time(run):
        return None
    first, what, value = unused
    text = f"The gripper was never {what}, first at {first.elapsed:.1f} s."
    advice = f"Send {gripper.code}-{value} there."
    return Fact(text, first, place=(first.x, first.y), culprits=(gripper.code,), advice=advice)


def _closed_on_nothing(run: RunEvidence, done: GripRow, code: str) -> Fact:
    seen, missed = run.seen, done.grip.missed
    often = f" {times_text(len(seen.misses))}" if len(seen.misses) > 1 else ""
    place = (done.grip.block.x, done.grip.block.y)
    closed = run.closed_before(done)
    if closed is not None and missed is not None and not any(missed):
        since = f"{code}-1 had come at {closed.elapsed:.1f} s, and no {code}-0 since"
        text = f"The gripper was closed already: {since}."
        return Fact(text, done, place=place, advice=f"Send {code}-0 before you drive to the block.")
    last = "" if missed is None else f": {miss_text(missed)}"
    if often and last:
        last = f". The last time, {last[2:]}"
    text = f"The gripper closed on nothing{often}{last}."
    unseen, advice = run.unseen_block, None
    if unseen is not None:
        names, was, sees = _alone(unseen.codes)
        text += f" {names} alone {sees} the block, and {was} not read on the way to it."
        advice = f"Read {unseen.codes[0]} before you close the gripper."
    return Fact(
        text, done, place=place, has_behind=True, culprits=unseen.codes if unseen else (), advice=advice
    )


def _dropped(run: RunEvidence) -> Fact | None:
    seen, done = run.seen, run.seen.put_down
    if seen.task is None or done is None or run.has_contact:
        return None
    block, zone = done.grip.block, seen.task.zone
    where = place_text(block.x, block.y)
    off, advice = "not in the drop zone", None
    if zone is not None:
        off = outside_text(missed_zone(zone, block.x, block.y))
        off = f"{off} the cell around {place_text(zone.x, zone.y)}"
        there = place_text(zone.x, zone.y)
        advice = f"Print where your program takes drop zone and block to be; the zone is at {there}."
    text = f"It set the block down outside the drop zone: at {where}, {off}."
    lay = next((row.block for row in seen.history.blocks.items if not row.held), block)
    if lay is not block and math.hypot(block.x - lay.x, block.y - lay.y) <= GROUND:
        gripper = "" if seen.spec.gripper is None else seen.spec.gripper.code
        advice = f"Find out why your program sends {gripper}-0 there: the gripper held the block."
        text = f"It took the block {times_text(seen.takes)}, and let it go where it lay: at {where}, {off}."
    return Fact(text, done, place=(block.x, block.y), has_behind=True, advice=advice)


def _with_belief(met: ContactEvidence, text: str) -> str:
    """A sentence on a contact, behind a belief that was right: that leaves the map or the plan."""
    if not met.knew or met.belief is None or met.belief.distance > SLIGHT:
        return text
    return f"Its belief was right, off by {met.belief.error_text}; {text[0].lower()}{text[1:]}"


# -- beliefs and paths -------------------------------------------------------------------------------------


def _lost(run: RunEvidence) -> Fact | None:
    seen, met = run.seen, run.contact if run.has_contact else None
    if met is not None:
        if met.belief is None or not (met.is_elsewhere or (met.lost is not None and run.belief.text)):
            return None
        if met.lost is not None:
            return _lost_since(run, met.lost)
        off = met.belief
        spread = "" if math.isnan(off.spread) else f", with a spread of {off.spread:.1f} in"
        text = f"It drove on with a belief off by {off.error_text}{spread}."
        return Fact(text, off, has_behind=True, then=_then(run))
    # A program that stopped for another reason may be off as well.
    if seen.task is None or (run.silence is not None and (seen.is_silent or not run.belief.text)):
        return None
    grip, least = run.last_grip, CELL_SIZE if run.unused_grip else 0.0
    belief, lost = seen.beliefs
    if grip is not None:
        # A miss that is larger than the error of the belief has another reason.
        belief, lost = seen.belief_before(grip.order)
        least = run.missed_by / 2.0
    if lost is not None and belief is not None and belief.distance >= least:
        return _lost_since(run, lost)
    # A program that was stopped might have found its place.
    if belief is None or grip is not None or least or run.stopped or _stalled(run) is not None:
        return None
    if belief.unsure or not run.belief.was_right:
        ever = "no longer knew" if run.belief.was_right else "never found out"
        last = f"its last belief was off by {belief.error_text}"
        if not math.isnan(belief.spread):
            last += f", with a spread of {belief.spread:.1f} in"
        return Fact(f"It {ever} where it was: {last}.", belief, has_behind=True, then=_then(run))
    return None


def _lost_since(run: RunEvidence, lost: BeliefRow) -> Fact:
    """A belief that was wrong, what explains it, and what came of it."""
    parted, ranges, advice, unsure = run.belief.parted, run.ranges_before(lost), None, ""
    last = run.seen.beliefs[0] if run.contact is None or not run.has_contact else run.contact.belief
    moved = bool(parted) and "no movement" not in parted
    if moved or not (lost.deviation.off_place or lost.deviation.rejects_truth):
        advice = _COMPARE_MOTION.format(what="movement" if moved else "turn")
    elif not run.looked_before(lost):
        parted = parted or " It had read no range before that."
        advice = "Do not assume the start: read all sensors, and search for the place that they fit."
    elif last is not None and last.unsure:
        if not math.isnan(last.spread):
            unsure = f" It drove on with a spread of {last.spread:.1f} in."
    elif ranges.were_right and is_small(lost):
        advice = _COMPARE_MOTION.format(what="movement")
    elif ranges.were_right and not ranges.fit_belief:
        advice = "Print the ranges as your program uses them, beside those that its map gives for its belief."
    text = f"{capitalized(lost_text(run, lost))}.{parted}{ranges.text}{unsure}"
    return Fact(text, lost, has_behind=True, advice=advice, then=_then(run))


def _then(run: RunEvidence) -> str:
    """Sentences on what came of a wrong belief or a refused command: contact, grip, silence or the end."""
    met = run.contact if run.has_contact else None
    if met is not None:
        unread = met.unread_text if met.is_blind else met.not_read
        return f"{f'{unread}. ' if unread else ''}Then {_sent(run)}. {_contact(run)}"
    if run.last_grip is not None:
        return f"Then it {grip_ending(run.last_grip.grip)}."
    if run.silence is not None:
        return _quiet(run)
    if run.stopped:
        return ""
    out_of_time = run.seen.out_of_time or run.cut_off
    end = "its time was up" if out_of_time else "the program ended by itself"
    seen = run.seen
    # A velocity that still goes on has ended no movement.
    moved = {each.code for each in seen.spec.velocities} & set(seen.history.code_names)
    has_moved = bool(moved) or bool(len(seen.within(seen.history.movements)))
    return f"Then {end}{'' if has_moved else ', and no movement had come'}."


def _too_close(run: RunEvidence) -> Fact | None:
    met = run.contact if run.has_contact else None
    if met is None or _stalled(run) is not None:
        return None
    contact = met.met.contact
    text, advice = _sent(run), None
    if contact.held_block:
        advice = "Plan with the held block, and an inch more on each side."
    elif met.leads_into or not (met.met.ended.trajectory.turning or met.narrow_text):
        silent = _silent(run)
        text = f"{silent} read nothing in range; then {text}" if silent else text
        advice = _wall_advice(run, met)
    if met.goes_on:
        advice = _GOES_ON.format(code=met.met.ended.command.code)
    fact = _at_contact(run, met, _with_belief(met, text), advice=advice)
    errors = None if met.is_blind else met.drive_errors
    if errors is None:
        return fact
    return replace(fact, then=f"{fact.then} {_without(errors)}", culprits=errors.codes, advice=_CORRECT)


def _silent(run: RunEvidence) -> str:
    """The range sensors that had no echo just before a contact's movement."""
    seen = [] if run.contact is None else [each.reading for each in run.contact.met.row.seen]
    return " and ".join(
        each.sensor.code for each in seen if each.sensor.kind.is_range and math.isinf(each.value)
    )


def _nowhere(run: RunEvidence) -> Fact | None:
    seen, stuck = run.seen, run.seen.stuck
    if seen.task is None:
        return None
    if stuck is not None and seen.collision is not None and not run.has_contact:
        pose = seen.collision.row.pose
        return Fact(
            f"It was stuck at {place_text(pose.x, pose.y)}: {stuck.text}.", since=stuck.since, has_behind=True
        )
    fact = _stalled(run)
    if fact is None or not run.has_contact:
        return fact
    return replace(fact, then=f"{fact.then} {_then(run)}".lstrip())


def _stalled(run: RunEvidence) -> Fact | None:
    """It continued to move, or only to read, and reached no goal and no new place."""
    seen, task = run.seen, run.seen.task
    if task is None:
        return None
    stalled, long = seen.stalled, STAYED * task.time_limit
    if run.corrections:
        # The table behind the fact tells of them.
        first = run.corrections[0]
        return Fact("", since=first.elapsed, culprits=first.of, advice=first.advice, has_behind=True)
    stays = _stays(run)
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


def _stays(run: RunEvidence) -> Fact | None:
    """It read on, and drove no more; it may have turned."""
    seen, history = run.seen, run.seen.history
    moves, readings = seen.within(history.movements), seen.within(history.readings)
    moves, turns = moves[~moves["grips"]], {each.code for each in seen.spec.drives if each.kind.turns}
    drove, whole = (
        moves[[history.code_names[code] not in turns for code in moves["code"]]],
        seen.elapsed - seen.begun,
    )
    # With its time up, one that turns and reads may only be slow.
    if len(drove) < FEWEST["set"] or seen.out_of_time or drove["order"][-1] == moves["order"][-1]:
        drove, whole = moves, whole if seen.task is None else seen.task.time_limit
    since = float(drove["elapsed"][-1]) if len(drove) else seen.begun
    later = int((readings["elapsed"] > since).sum())
    if later < HUNDRED or seen.elapsed - since < STAYED * whole:
        return None
    codes = tuple(history.code_names[number] for number in dict.fromkeys(drove["code"].tolist()))
    what = "movement" if drove is moves else " or ".join(codes)
    came = f"{counted(later, 'reading')} did, the last {run.last_reading}"
    text = f"From {since:.1f} s on no {what} came, and {came}. {_stand(run)}".rstrip()
    culprits = () if drove is moves else codes[: len(codes) == 1]
    advice = "Print what your program compares in the loop that only reads, and what would end it."
    return Fact("", since=since, culprits=culprits, advice=advice, has_behind=True, then=text)


# -- time, and the program's end ---------------------------------------------------------------------------


def _slow(run: RunEvidence) -> Fact | None:
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
    text = f"Most of its time went to {most} ({listed}).{read}"
    return Fact("", has_behind=True, advice=_SPARE[most].format(code=code), then=text)


def _lacked_time(run: RunEvidence) -> bool:
    """True if time ran out, most of it went to one thing but driving, and the robot got on until then: what
    it had not done yet it might have done."""
    most, seconds = next(iter(run.time_parts.items()))
    is_slow = most != "driving" and 2.0 * seconds > run.seen.elapsed - run.seen.begun
    return run.seen.out_of_time and is_slow and _stalled(run) is None


def _ended(run: RunEvidence) -> Fact | None:
    seen = run.seen
    if run.has_contact or run.program is None or run.exit_code is None:
        return None
    if seen.task is None and not run.exit_code:
        return None
    words = f" Its last output: {run.last_words}." if run.last_words else ""
    limit = "" if seen.task is None else f" after {seen.seconds:.1f} of {seen.task.time_limit:g} s"
    text = f"{capitalized(exit_text(run.exit_code))}{limit}, before it was done.{words}{waited_text(run)}"
    text = " ".join(filter(None, (text, _stand(run), run.all_movements)))
    advice = None
    if _of_link(run):
        advice = f"Look at the link: {LINK_ADVICE}"
    elif run.velocities_left:
        often = f"it made {run.velocities_left} for {counted(seen.commands, 'command')}"
        text = f"Its velocities ended with their connections: {often}. {text}"
        advice = "Keep one connection open for all commands."
    elif run.last_words and run.exit_code:
        advice = f"Look in your program at what leads to '{cut(run.last_words, WORD)}'."
    return Fact("", has_behind=True, advice=advice, then=text)


# -- text --------------------------------------------------------------------------------------------------


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
    if run.belief.was_right:
        return f"it was lost since {lost.elapsed:.1f} s: {said}"
    return f"it never found its place: from {lost.elapsed:.1f} s on {said}"


def _stand(run: RunEvidence) -> str:
    """The robot's place at the end, and the belief of it."""
    seen = run.seen
    if seen.task is None or seen.history.is_twin:
        return ""
    belief, where = seen.beliefs[0], f"It stood at {place_text(seen.pose.x, seen.pose.y)}"
    if belief is None:
        return f"{where}."
    if belief.is_right:
        return f"{where}, and its belief was right, off by {belief.error_text}."
    return f"{where}, and believed to be at {place_text(belief.x, belief.y)}."


def waited_text(run: RunEvidence) -> str:
    """The last command to arrive of a program that ended because of its link; of one with another error its
    last reading."""
    last, error = run.last_command, "" if run.program is None else run.program.error
    if last is not None and (_of_link(run) or error.startswith((*LINK_ENDED, *LINK_WAITED))):
        return f" Its last command to arrive, {last[0]}, was answered at {last[1]:.1f} s."
    return f" Its last reading was {run.last_reading}." if error and run.last_reading else ""


def _of_link(run: RunEvidence) -> bool:
    """True if a program said in the end that its link had ended, or gave no reply."""
    return any(words in run.last_words for words in _LINK_WORDS)


def _contact(run: RunEvidence) -> str:
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
    return f"Contact{block} at {row.elapsed:.2f} s with {place}, {went}.{_twice(run)}"


def _sent(run: RunEvidence) -> str:
    """The deciding command, and that it came repeatedly."""
    met = run.contact
    if met is None:
        return ""
    again = run.repeated
    often = f" {times_text(again[1])} in a row" if again is not None and again[2] else ""
    sent = sent_text(met.met.row.ended.command.source, met.met.row.shown)
    return f"{sent}{often}{', and nothing ended it' if met.goes_on else ''}"


def _twice(run: RunEvidence) -> str:
    """A movement before the deciding one that came repeatedly, nothing being read since."""
    again = run.repeated
    return "" if again is None or again[2] else f" {again[0]} had come {times_text(again[1])} in a row."


def _goals(run: RunEvidence) -> str:
    """The zone that was never entered, or the goal that was not met, in a sentence."""
    seen, zone = run.seen, None if run.seen.task is None else run.seen.task.zone
    if seen.task is None or (seen.taken and not seen.holding) or seen.is_silent:
        return ""
    if not seen.holding:
        loading, block = cells_of(seen.spec.maze, BLOCK), seen.history.blocks.items[-1].block
        # Where the block of a real robot lies no log says.
        is_known = bool(loading) and not seen.history.is_twin
        if is_known and not any(cell.holds(block.x, block.y) for cell in loading):
            return f"The block lay at {place_text(block.x, block.y)}, outside the loading zone."
        never = not run.goals and loading
        return "It never entered the loading zone." if never else "The robot had not taken the block yet."
    if zone is None:
        return "The robot held the block."
    moves, where = seen.within(seen.history.movements), place_text(zone.x, zone.y)
    entered = any(map(zone.holds, moves["x"].tolist(), moves["y"].tolist()))
    not_done = "had not set it down in" if entered else "never entered"
    return f"The robot held the block, and {not_done} the drop zone at {where}."


ORDER: tuple[CauseRule, ...] = (
    CauseRule(
        Kind.WIRE,
        _wire,
        MomentKind.FAULT,
        "a mistake of a line was reported, or a program turned away, and no goal was met after it",
        "all others",
    ),
    CauseRule(
        Kind.REFUSED,
        _refused,
        MomentKind.FAULT,
        "most commands, the one before it was lost, or some movements were refused, never to be carried out",
        "what followed",
        "Check the reply to each command in your program: a refused one does nothing.",
    ),
    CauseRule(
        Kind.CRASHED,
        _crashed,
        MomentKind.PROGRAM,
        "an exception or a signal ended the program",
        "what led there",
    ),
    CauseRule(
        Kind.MOVED,
        _moved,
        MomentKind.PERSON,
        "a person moved the robot or the block; or a second client came",
        "what followed",
        "Compare each reading with the belief, and search again when they no longer fit.",
    ),
    CauseRule(
        Kind.SENSOR_WRONG,
        _sensor_wrong,
        MomentKind.DEVICE,
        "a sensor differs from its set; or its last reading of the wall was too long",
        "what followed",
        "Calibrate the sensor, or give the program the numbers of this set.",
    ),
    CauseRule(
        Kind.DRIVE_WRONG,
        _drive_wrong,
        MomentKind.DEVICE,
        "a drive differs from its set; or without its large errors nothing would have been touched",
        "what followed",
        _CORRECT,
    ),
    CauseRule(
        Kind.LOST,
        _lost,
        MomentKind.LOST,
        "the belief was wrong or unsure at the contact, grip or end",
        "the path",
        "Turn on the spot and read all sensors until the belief is sure, before you drive on.",
    ),
    CauseRule(
        Kind.SILENCE,
        _silence,
        MomentKind.END,
        "no command came in the last quarter of the time, or none at all",
        "a program that is slow",
        "Print a line before each command, lock and wait: the last line shows where the program waits.",
    ),
    CauseRule(
        Kind.KNOWN_WALL,
        _known_wall,
        MomentKind.COMMAND,
        "a right reading or belief showed the wall, and the command led an inch or more into it",
        "wrong readings, drive errors",
        "Compare each movement with the distance to the wall before you send it.",
    ),
    CauseRule(
        Kind.UNREAD,
        _unread,
        MomentKind.COMMAND,
        "no range was read on the last 4 in or 45 deg; or the one that sees the block was not",
        "wrong readings",
    ),
    CauseRule(
        Kind.MISSED_GRIP,
        _missed_grip,
        MomentKind.COMMAND,
        "the gripper closed on nothing, or was not used where the block was right for it",
        "a wrong belief",
        "Measure the distance to the block once more before you close the gripper.",
    ),
    CauseRule(
        Kind.DROPPED_OUTSIDE,
        _dropped,
        MomentKind.COMMAND,
        "the block was set down outside the drop zone",
        "a wrong belief",
        "Check the block's place, not the robot's, before you open the gripper.",
    ),
    CauseRule(
        Kind.TOO_CLOSE,
        _too_close,
        MomentKind.COMMAND,
        "the robot or its block touched a wall",
        "wrong beliefs",
        "Plan with an inch more on each side.",
    ),
    CauseRule(
        Kind.GOT_NOWHERE,
        _nowhere,
        MomentKind.COMMAND,
        "100 movements or a quarter of the time led to no goal or new place; or corrections do not shrink",
        "lack of time",
        "Count movements without a new place, and try another way after ten.",
    ),
    CauseRule(
        Kind.TOO_SLOW,
        _slow,
        MomentKind.END,
        "the time limit was reached",
        "a program that ended by itself",
        "Save time where most of it goes.",
    ),
    CauseRule(
        Kind.ENDED,
        _ended,
        MomentKind.PROGRAM,
        "the program ended by itself",
        "",
    ),
)
"""The rules, the first first."""
_ABOUT_GOALS = (Kind.LOST, Kind.SILENCE, Kind.GOT_NOWHERE, Kind.TOO_SLOW, Kind.ENDED)
"""Causes beside which it matters how far the mission came."""
_AT_THE_END = (Kind.CRASHED, Kind.UNREAD, Kind.TOO_SLOW, Kind.ENDED)
"""Causes of which only the end of a run tells."""
NO_RULE = CauseRule(
    Kind.UNKNOWN,
    lambda run: None,
    MomentKind.END,
    "none holds: the three figures that differ most from runs that succeed are named",
    "",
)
