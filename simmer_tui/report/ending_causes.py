"""Causes of failures that no contact decided: by the program's end, the time, or a missing action."""

import math
from functools import partial

from simmer_tui.report.causes import Cause, Kind, Sureness, cause_of, undecided_text
from simmer_tui.report.contact_causes import BLIND, BLIND_TURN, belief_text, wrong_text
from simmer_tui.report.finding import FEWEST
from simmer_tui.report.right_readings import (
    looked_for_block,
    looked_in_vain,
    looked_while_lost,
    reported_held,
)
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.episodes import EpisodeKind
from simmer_tui.run.events import ProgramEnded
from simmer_tui.run.facts import displacement, missed_zone
from simmer_tui.run.history_rows import ActionRow
from simmer_tui.run.phrases import (
    body_text,
    capitalized,
    exit_text,
    last_output,
    miss_text,
    obstacle_place,
    outside_text,
    place_text,
    program_end_text,
    times_text,
)
from simmer_tui.run.progress import HUNDRED
from simmer_tui.run.run_history import CHAIN
from simmer_tui.sim.command import counted
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import CELL_SIZE

# Judged: a good program crosses the maze with fewer movements.
STAYED, MOVES = 0.25, 20
"""Share of the time limit, and number of movements (or none), without progress that count as a cause."""
_LED = CHAIN - 1
"""Movements that may have led to a contact: as many as counterfactuals repeat."""
# Judged: a smaller error of the place comes from drift or a wrong angle.
_FAR = CELL_SIZE / 2
"""Distance of the block from the jaws, inches, from which the gripper closed elsewhere, not beside the
block."""
_REPLY_CHANGED = undecided_text("a reply was changed")


class EndingCauses:
    """The candidates, each None if it does not hold. `program` is the end of the program, where it is known.
    `cut_off` is true if the run was ended because real time was up."""

    def __init__(self, seen: Attempt, program: ProgramEnded | None, cut_off: bool) -> None:
        self._seen = seen
        self._made = partial(cause_of, seen)
        self._program = program
        # The exit code of a program that the simulator ended is not the program's own.
        self._exit_code = None if program is None or program.stopped else program.exit_code
        self._last_words = "" if program is None else last_output(program)
        self._cut_off = cut_off

    def crash(self) -> Cause | None:
        """The program crashed."""
        program = self._program
        if program is not None and program.crashed and not program.stopped:
            text = program_end_text(program)
            return self._made(Kind.CRASHED, f"{capitalized(text)}.", self._goals() if program.started else "")
        return None

    def silence(self) -> Cause | None:
        """No command came."""
        if not self._seen.is_silent:
            return None
        if self._seen.task is None and self._exit_code is None and not self._cut_off:
            return None
        text = "The program sent no command at all."
        if self._exit_code:
            text = f"{capitalized(exit_text(self._exit_code))} before it sent a command."
        said = f"Last output: {self._last_words}." if self._last_words else ""
        return self._made(Kind.NOTHING_SENT, text, said)

    def put_down(self) -> Cause | None:
        """The block was set down, and not in the drop zone."""
        seen, done = self._seen, self._seen.put_down
        if seen.task is None or done is None:
            return None
        block, zone = done.grip.block, seen.task.zone
        where = place_text(block.x, block.y)
        kind, sure, codes = Kind.DROPPED_OUTSIDE, Sureness.CERTAIN, tuple[str, ...]()
        if (held_by := reported_held(seen, done)) is not None:
            code, times = held_by
            kind, sure, codes = Kind.UNDECIDED, Sureness.LIKELY, (code,)
            either = undecided_text(f"a reply of {code} was changed")
            text = (
                f"It let the block go where it had taken it, at {where}, though {code} had just read that "
                f"the gripper held it ({counted(times, 'reading')}). {either}"
            )
        elif zone is None:
            text = f"It set the block down at {where}, which is not in the drop zone."
        else:
            off = outside_text(missed_zone(zone, block.x, block.y))
            cell = f"the cell around {place_text(zone.x, zone.y)}"
            text = f"It set the block down outside the drop zone: at {where}, {off} {cell}."
        belief, place = belief_text(seen.belief_before(done.order)[0]), (block.x, block.y)
        return self._made(kind, text, belief, at=done, place=place, sure=sure, culprits=codes)

    def missed_grip(self) -> Cause | None:
        """The gripper closed, and never on the block.

        Far from the block, the program took something else for it, or its readings differ from those in the
        log.
        """
        seen, misses = self._seen, self._seen.misses
        if seen.task is None or not misses or seen.taken:
            return None
        done = misses[-1]
        missed = done.grip.missed
        closed = "The gripper closed on nothing"
        if len(misses) > 1:
            closed += f" {times_text(len(misses))}"
        last = ": " if len(misses) == 1 else ". The last time, "
        text = f"{closed}." if missed is None else f"{closed}{last}{miss_text(missed)}."
        belief, lost = seen.belief_before(done.order)
        kind, sure = Kind.MISSED_GRIP, Sureness.CERTAIN
        is_far = missed is not None and math.hypot(*missed) > _FAR
        if is_far and lost is None and looked_for_block(seen, done):
            kind, sure = Kind.UNDECIDED, Sureness.LIKELY
            text += f" No reading in the log showed a block there. {_REPLY_CHANGED}"
        place = (done.grip.block.x, done.grip.block.y)
        return self._made(kind, text, belief_text(belief), at=done, place=place, sure=sure)

    def wrong_when_gripping(self) -> Cause | None:
        """Its belief was wrong when it closed or opened the gripper in the wrong place."""
        seen = self._seen
        done = seen.put_down or (seen.misses[-1] if seen.misses and not seen.taken else None)
        lost = None if done is None else seen.belief_before(done.order)[1]
        if lost is None:
            return None
        what = "set the block down" if seen.taken else "closed the gripper"
        text = f"It was lost when it {what}. {wrong_text(seen, lost)}."
        return self._made(Kind.LOST, text, at=lost)

    def asked_after_grip(self) -> Cause | None:
        """The gripper was never used, and the program believed that it had used it."""
        return self.never_gripped() if self._seen.holding or self._seen.asked_after_grip else None

    def never_gripped(self) -> Cause | None:
        """The block was between its jaws, or in the drop zone, and no command for the gripper came."""
        seen, gripper = self._seen, self._seen.spec.gripper
        if seen.task is None or gripper is None:
            return None
        # A program that stays may be about to close it; one that reads the load sensor believes it closed.
        passed = seen.left_block or seen.asked_after_grip
        if not seen.taken and not seen.closed and seen.graspable and passed:
            first, times = seen.graspable[0], counted(len(seen.graspable), "movement")
            what = f"closed: {times} ended with the block between its jaws"
        elif seen.holding and seen.arrivals:
            first, what = seen.arrivals[0], "opened: the block was in the drop zone"
        else:
            return None
        return self._made(
            Kind.NOT_CARRIED_OUT,
            f"The gripper was never {what}, first at {first.elapsed:.1f} s.",
            "Either the program did not send the command, or it was lost. The log cannot tell which.",
            at=first,
            place=(first.x, first.y),
            sure=Sureness.LIKELY,
            culprits=(gripper.code,),
        )

    def refused(self) -> Cause | None:
        """A command for a drive or the gripper was refused."""
        seen = self._seen
        codes = {row.code for row in seen.spec.drive_rows}
        rows = [row for row in seen.refusals if row.result.command.code in codes]
        if seen.task is None or not rows:
            return None
        command, reason = rows[-1].result.command, rows[-1].result.reason
        others = f", like {len(rows) - 1} before it" if len(rows) > 1 else ""
        text = f"{command.shown} was not carried out{others}: {reason}."
        culprits, sure = (command.code,), Sureness.LIKELY
        return self._made(Kind.NOT_CARRIED_OUT, text, at=rows[-1], sure=sure, culprits=culprits)

    def mostly_refused(self) -> Cause | None:
        """Since the robot last made progress, or in the whole run, more commands to drive were refused than
        carried out."""
        seen = self._seen
        for since in (seen.stalled.since, seen.begun) if seen.task is not None else ():
            codes, count, of = seen.refused_drives(since)
            # Only the newest refusals are kept with their reasons.
            rows = [row for row in seen.refusals if row.result.command.code in codes]
            rows = [row for row in rows if not row.result.is_early]
            if count >= FEWEST["set"] and 2 * count > of and rows:
                last = rows[-1]
                command, reason = last.result.command.shown, last.result.reason
                begin = f"{count} of {of} commands to drive were refused from {since:.1f} s on"
                text = f"{begin}. The last was {command}: {reason}."
                return self._made(Kind.NOT_CARRIED_OUT, text, self._goals(), at=last, culprits=tuple(codes))
        return None

    def without_effect(self) -> list[Cause]:
        """The causes by commands to drive that came and did nothing: refused, or for 0."""
        made = self.mostly_refused(), self.nowhere()
        return [each for each in made if each is not None and each.culprits]

    def blocked(self) -> Cause | None:
        """A wall held the robot."""
        seen, stuck = self._seen, self._seen.stuck
        if stuck is None or seen.collision is None:
            return None
        pose = seen.collision.row.pose
        text = f"It was stuck at {place_text(pose.x, pose.y)}: {stuck.text}."
        return self._made(Kind.STUCK, text, since=stuck.since)

    def nowhere(self) -> Cause | None:
        """It continued to move, or only to read, and reached no goal and no new place."""
        seen, task, stalled = self._seen, self._seen.task, self._seen.stalled
        if task is None:
            return None
        if (stood := self._stood(task.time_limit)) is not None:
            return stood
        # A robot that stands and reads is slow, not without progress: half of the time must have been
        # driving.
        lasted = seen.elapsed - stalled.since
        idle = lasted < STAYED * task.time_limit or stalled.driving < lasted / 2
        drives, count = seen.asked_for_nothing
        # Movements of nothing are no search.
        in_vain = count >= MOVES and 2 * count > stalled.movements
        if stalled.movements < (HUNDRED if idle or not seen.out_of_time else MOVES) and not in_vain:
            return self._looped()
        turned = f", {stalled.turned:.0f} deg" if stalled.turned >= 1.0 else ""
        moved = f"{stalled.movements} movements ({stalled.driven:.0f} in{turned})"
        text, whole, codes = f"{moved} reached no goal and no new place", "", tuple[str, ...]()
        if in_vain:
            text, codes = f"{text}: {count} of them asked for 0 ({', '.join(drives)})", tuple(drives)
            if seen.whole_numbers:
                begin = f"All {seen.whole_numbers} commands to drive were whole numbers"
                whole = f"{begin}: what is left below 1 is never driven."
        return self._got_nowhere(stalled.since, text, stalled.place, whole, culprits=codes)

    def _looped(self) -> Cause | None:
        """It repeated the same few movements, whatever its sensors read."""
        loop = self._seen.loop
        if loop is None:
            return None
        what = f"it repeated the same {loop.commands} movements {loop.rounds} times"
        return self._got_nowhere(loop.since, what, loop.place)

    def _stood(self, time_limit: float) -> Cause | None:
        """It stood and read its sensors until time was up, or it gave up."""
        seen, dwell = self._seen, self._seen.dwell
        if dwell is None or dwell.readings < HUNDRED or seen.too_many_contacts:
            return None
        if seen.elapsed - dwell.since < STAYED * time_limit:
            return None
        read = f"{dwell.readings} times ({dwell.code} {dwell.often} times)"
        end = "" if seen.out_of_time else f"{self._end()}."
        return self._got_nowhere(dwell.since, f"it did not move and read sensors {read}", None, end)

    def _got_nowhere(
        self, since: float, text: str, pose: Pose | None, *evidence: str, culprits: tuple[str, ...] = ()
    ) -> Cause:
        text = f"It got nowhere. From {since:.1f} s on, {text}."
        place = None if pose is None else (pose.x, pose.y)
        evidence = *evidence, self._goals()
        return self._made(Kind.GOT_NOWHERE, text, *evidence, since=since, place=place, culprits=culprits)

    def slow(self) -> Cause | None:
        """Time was up."""
        seen, spent = self._seen, self._seen.spent
        if not (seen.out_of_time or self._cut_off):
            return None
        seconds = seen.elapsed - seen.begun
        rest = max(seconds - spent.driving - spent.reading - spent.link, 0.0)
        parts = {"driving": spent.driving, "reading": spent.reading, "the link": spent.link, "waiting": rest}
        most = max(parts, key=lambda name: parts[name])
        count = spent.readings.total()
        code, often = next(iter(spent.readings.most_common(1)), ("", 0))
        read = f"sensors {times_text(count)} ({code} {times_text(often)})" if count else "no sensor"
        if self._cut_off and not seen.out_of_time:
            return self._made(
                Kind.TOO_SLOW,
                "It was too slow: at the real time limit the program was still running.",
                f"Most of the {seconds:.1f} simulated seconds{seen.restart} went to {most}.",
                f"It read {read}.",
                self._goals(),
            )
        listed = ", ".join(f"{name} {time:.1f} s" for name, time in parts.items() if time >= 0.05)
        between = f"Real time between its commands: {spent.between:.1f} s."
        return self._made(
            Kind.TOO_SLOW,
            f"It was too slow: most of its time went to {most} ({listed}).",
            f"It read {read}.",
            between if spent.between else "",
            self._goals(),
        )

    def astray(self) -> Cause | None:
        """It gave up, or ran out of time, while it was lost or had never been localized."""
        seen = self._seen
        belief, lost = seen.beliefs
        if seen.task is None or belief is None:
            return None
        episodes = seen.episodes
        if lost is not None:
            frozen = [each for each in episodes if each.kind is EpisodeKind.FROZEN]
            how = " It kept sending the same pose while it moved." if frozen else ""
            text = f"It was lost. {wrong_text(seen, lost)}.{how} {self._end()}."
            return self._made(Kind.LOST, text, at=lost)
        known = any(each.kind is EpisodeKind.LOCALIZED for each in episodes)
        if belief.unsure or not known or seen.hardly_localized:
            late = "no longer knew" if belief.unsure else "seldom knew"
            ever = late if known else "never found out"
            text = f"It {ever} where it was. {self._end()}."
            return self._made(Kind.UNSURE, text, belief_text(belief), self._goals())
        return None

    @property
    def is_lost(self) -> bool:
        """True if its last belief was wrong."""
        return self._seen.beliefs[1] is not None

    def disagreeing(self) -> Cause | None:
        """Its readings were right and its belief was wrong: program and log do not fit together."""
        belief, lost = self._seen.beliefs
        # A program that sends the same pose while it moves does not update it by readings.
        frozen = any(each.kind is EpisodeKind.FROZEN for each in self._seen.episodes)
        if belief is None or frozen:
            return None
        if lost is not None and looked_while_lost(self._seen):
            known = f"the pose that the program believed was wrong. {wrong_text(self._seen, lost)}"
        elif lost is None and looked_in_vain(self._seen) and self._seen.hardly_localized:
            known = "the program seldom knew where it was"
        else:
            return None
        text = f"Program and log disagree: the readings in the log were right, but {known}. {_REPLY_CHANGED}"
        return self._made(Kind.UNDECIDED, text, belief_text(belief), at=lost, sure=Sureness.LIKELY)

    def unread(self) -> Cause | None:
        """It gave up lost, and had read no sensor on the last part of its path."""
        seen = self._seen
        gone, turned = seen.blind_for
        if self.astray() is None or not (gone > BLIND or turned > BLIND_TURN):
            return None
        path = f"the last {gone:.0f} in and {turned:.0f} deg of its path"
        text = f"It stopped looking: no range sensor was read on {path}. {self._end()}."
        evidence = belief_text(seen.beliefs[0]), self._goals()
        return self._made(Kind.UNREAD, text, *evidence, sure=Sureness.LIKELY)

    def ended(self) -> Cause | None:
        """The program ended, and nothing else explains it."""
        if self._seen.task is None and not self._exit_code:
            return None
        end = f"{capitalized(exit_text(self._exit_code))} before it was done."
        words = f" Last output: {self._last_words}." if self._last_words else ""
        return self._made(Kind.ENDED, f"{end}{words}", self._goals())

    # -- text ------------------------------------------------------------------------------------

    def _end(self) -> str:
        if self._seen.out_of_time or self._cut_off:
            return "Then its time was up"
        words = f" (last output: {self._last_words})" if self._last_words else ""
        return f"Then the program gave up{words}"

    def _goals(self) -> str:
        seen = self._seen
        if seen.task is None:
            return ""
        if seen.holding:
            return "The robot held the block."
        return "" if seen.taken else "The robot had not taken the block yet."

    def moved(self) -> Cause | None:
        """A person moved the robot, or drove it, and it was never localized again."""
        row = self._seen.moved
        if row is None:
            return self._driven()
        way, turn = displacement(row.before, row.done.pose)
        return self._by_hand(row, "robot", f"by {way:.0f} in and {abs(turn):.0f} deg. {self._unnoticed}")

    def _driven(self) -> Cause | None:
        """A person drove the robot while the program did."""
        seen, row, met = self._seen, self._seen.driven_by_hand, self._seen.collision
        if seen.task is None or row is None:
            return None
        value = f"-{row.asked:g}" if math.isfinite(row.asked) else ""
        is_beside = seen.is_connected(row.order)
        beside = " beside its program" if is_beside else ""
        text = f"A person drove the robot{beside}: {seen.history.code_names[row.code]}{value}"
        if met is not None and met.row.order == row.order:
            text += f" led {body_text(met.contact)} into {obstacle_place(met.contact, seen.spec)}."
            return self._made(Kind.MOVED, text, at=row, place=met.contact.point)
        if not is_beside:
            return None
        text += f" at {row.begin:.1f} s. {self._unnoticed}"
        return self._made(Kind.MOVED, text, at=row, place=(row.x, row.y), sure=Sureness.LIKELY)

    @property
    def _unnoticed(self) -> str:
        if self._seen.beliefs[0] is None:
            return "The program could notice it only by its sensors."
        return "No belief was right after that."

    def block_moved(self) -> Cause | None:
        """A person moved the block, and it was not taken."""
        row = self._seen.block_moved
        if row is None:
            return None
        to = place_text(*row.done.action.arguments[:2])
        return self._by_hand(row, "block", f"to {to}. The robot did not take it after that.")

    def searched(self) -> Cause | None:
        """A person moved the block, and the robot continued without it for long."""
        row, movements = self._seen.block_moved, self._seen.within(self._seen.history.movements)
        if row is None or int((movements["order"] > row.order).sum()) <= _LED:
            return None
        return self.block_moved()

    def _by_hand(self, row: ActionRow, moved: str, text: str) -> Cause:
        text = f"A person moved the {moved} at {row.elapsed:.1f} s, {text}"
        place = (row.before.x, row.before.y)
        return self._made(Kind.MOVED, text, at=row, place=place, sure=Sureness.LIKELY)
