"""Causes of failures that no contact decided: by the program's end, by the time, or by what it never did."""

import math
from dataclasses import replace

from simmer_tui.events import ProgramEnded
from simmer_tui.phrases import (
    capitalized,
    counted,
    last_output,
    miss_text,
    outside_text,
    place_text,
    program_end_text,
    times_text,
)
from simmer_tui.report.causes import Cause, Kind, Sureness, without_blanks
from simmer_tui.report.contact_causes import BLIND, BLIND_TURN, belief_text, wrong_text
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.episodes import EpisodeKind
from simmer_tui.run.facts import missed_zone, wrapped
from simmer_tui.run.history_rows import ActionRow
from simmer_tui.run.progress import HUNDRED
from simmer_tui.run.run_history import STUCK
from simmer_tui.sim.command import escape

# Judged: a good program crosses the maze with fewer movements.
STAYED, MOVES = 0.25, 20
"""So large a share of the time limit, with so many movements and no progress, gains nothing."""


class EndingCauses:
    """The candidates, each None if it does not hold. `program` and `exit_code` are its program's end, where
    they are known; `cut_off` tells that the run was ended because real time was up."""

    def __init__(
        self, seen: Attempt, program: ProgramEnded | None, exit_code: int | None, cut_off: bool
    ) -> None:
        self._seen = seen
        self._program = program
        self._exit_code = exit_code
        self._last_words = "" if program is None else last_output(program)
        self._cut_off = cut_off

    def crash(self) -> Cause | None:
        """The program crashed."""
        program, code = self._program, self._exit_code
        if program is not None and program.crashed and not program.stopped:
            text = program_end_text(program)
            return self._made(Kind.CRASHED, f"{capitalized(text)}.", self._goals())
        # Of an older log nothing but the exit code is known: 128 and a signal's number, or less than 0.
        if program is None and code is not None and (code < 0 or code > 128):
            return self._made(Kind.CRASHED, f"The program crashed with exit code {code}.", self._goals())
        return None

    def silence(self) -> Cause | None:
        """No command came."""
        if self._seen.commands:
            return None
        if self._seen.task is None and self._exit_code is None and not self._cut_off:
            return None
        said = f"Its last words: {self._last_words}." if self._last_words else ""
        if self._exit_code:
            text = f"The program ended with exit code {self._exit_code} before it sent a command."
            return self._made(Kind.NOTHING_SENT, text, said)
        return self._made(Kind.NOTHING_SENT, "The program sent no command at all.", said)

    def put_down(self) -> Cause | None:
        """The block was set down, and not in the drop zone."""
        seen, done = self._seen, self._seen.put_down
        if seen.task is None or done is None:
            return None
        block, zone = done.grip.block, seen.task.zone
        where = place_text(block.x, block.y)
        if zone is None:
            text = f"It set the block down at {where}, which is not in the drop zone."
        else:
            off = outside_text(missed_zone(zone, block.x, block.y))
            text = (
                f"It set the block down outside the drop zone: at {where}, {off} the cell around "
                f"{place_text(zone.x, zone.y)}."
            )
        belief = belief_text(seen.belief_before(done.order)[0])
        place = (block.x, block.y)
        return self._made(
            Kind.DROPPED_OUTSIDE, text, belief, elapsed=done.elapsed, line=done.line, place=place
        )

    def missed_grip(self) -> Cause | None:
        """The gripper closed, and never on the block."""
        seen, misses = self._seen, self._seen.misses
        if seen.task is None or not misses or seen.taken:
            return None
        done = misses[-1]
        missed = done.grip.missed
        how = f": {miss_text(missed)}" if missed is not None else ""
        text = f"The gripper closed on nothing {times_text(len(misses))}; the last time{how}."
        if len(misses) == 1:
            text = f"The gripper closed on nothing{how}."
        belief = belief_text(seen.belief_before(done.order)[0])
        place = (done.grip.block.x, done.grip.block.y)
        return self._made(Kind.MISSED_GRIP, text, belief, elapsed=done.elapsed, line=done.line, place=place)

    def wrong_when_gripping(self) -> Cause | None:
        """It was wrong about where it was when it closed or opened the gripper in the wrong place."""
        seen = self._seen
        done = seen.put_down or (seen.misses[-1] if seen.misses and not seen.taken else None)
        lost = None if done is None else seen.belief_before(done.order)[1]
        if lost is None:
            return None
        what = "set the block down" if seen.taken else "closed the gripper"
        text = f"It was lost: {wrong_text(lost)}, when it {what}."
        return self._made(Kind.LOST, text, elapsed=lost.elapsed, line=lost.line)

    def asked_after_grip(self) -> Cause | None:
        """The gripper was never used, and the program took itself to have used it."""
        return self.never_gripped() if self._seen.holding or self._seen.asked_after_grip else None

    def never_gripped(self) -> Cause | None:
        """The block was between its jaws, or in the drop zone, and no command for the gripper came."""
        seen, gripper = self._seen, self._seen.spec.gripper
        if seen.task is None or gripper is None:
            return None
        if not seen.taken and not seen.closed and seen.graspable:
            stood, what = (
                seen.graspable,
                f"never closed: {counted(len(seen.graspable), 'movement')} ended with",
            )
            where = "the block between its jaws"
        elif seen.holding and seen.arrivals:
            stood, what = seen.arrivals, "never opened: it stood with"
            where = "the block in the drop zone"
        else:
            return None
        first = stood[0]
        text = f"The gripper was {what} {where}, the first time at {first.elapsed:.1f} s."
        return self._made(
            Kind.NOT_CARRIED_OUT,
            text,
            "The program never gave the command, or it was lost on its way: a log cannot tell these apart.",
            elapsed=first.elapsed,
            line=first.line,
            place=(first.x, first.y),
            sure=Sureness.LIKELY,
            culprits=(gripper.code,),
        )

    def refused(self) -> Cause | None:
        """A command for a drive or the gripper that was refused, while the run came to no end by it."""
        seen = self._seen
        codes = {each.code for each in seen.spec.drives}
        codes |= {seen.spec.gripper.code} if seen.spec.gripper is not None else set()
        rows = [row for row in seen.refusals if row.outcome.command.code in codes]
        if seen.task is None or not rows:
            return None
        last = rows[-1]
        others = f", as {len(rows) - 1} before it" if len(rows) > 1 else ""
        reason = escape(last.outcome.reason, 200)
        text = f"{last.outcome.command.shown} was not carried out{others}: {reason}."
        return self._made(
            Kind.NOT_CARRIED_OUT,
            text,
            elapsed=last.elapsed,
            line=last.line,
            culprits=(last.outcome.command.code,),
            sure=Sureness.LIKELY,
        )

    def blocked(self) -> Cause | None:
        """Movements in a row were stopped by a wall."""
        seen = self._seen
        count, since = seen.blocked
        if count < STUCK or seen.collision is None:
            return None
        pose = seen.collision.row.pose
        return self._made(
            Kind.STUCK,
            f"It was stuck: from {since:.1f} s on {count} movements in a row were "
            f"stopped by a wall at {place_text(pose.x, pose.y)}.",
            elapsed=since,
        )

    def nowhere(self) -> Cause | None:
        """It went on moving, and came to no goal and no new ground."""
        seen, task, stretch = self._seen, self._seen.task, self._seen.stretch
        if task is None:
            return None
        # One that stands and reads is slow, not without progress: half of the time must have been driving.
        lasted = seen.elapsed - stretch.since
        idle = lasted < STAYED * task.time_limit or stretch.driving < lasted / 2
        if stretch.movements < (HUNDRED if idle or not seen.out_of_time else MOVES):
            return None
        turned = f" and {stretch.turned:.0f} deg" if stretch.turned >= 1.0 else ""
        return self._made(
            Kind.GOT_NOWHERE,
            f"It got nowhere: from {stretch.since:.1f} s on it made {stretch.movements} movements, "
            f"{stretch.driven:.0f} in{turned} in all, and came to no goal and no new ground.",
            self._goals(),
            elapsed=stretch.since,
            place=(stretch.place.x, stretch.place.y),
        )

    def slow(self) -> Cause | None:
        """Time was up."""
        seen, spent = self._seen, self._seen.spent
        if not (seen.out_of_time or self._cut_off):
            return None
        rest = max(seen.elapsed - seen.begun - spent.driving - spent.reading - spent.link, 0.0)
        parts = {"driving": spent.driving, "reading": spent.reading, "the link": spent.link, "waiting": rest}
        most = max(parts, key=lambda name: parts[name])
        count = spent.readings.total()
        code, often = next(iter(spent.readings.most_common(1)), ("", 0))
        readings = f"It read {count} times, {code} alone {often} times." if count else "It read no sensor."
        if self._cut_off and not seen.out_of_time:
            return self._made(
                Kind.TOO_SLOW,
                "It was too slow: real time was up, and the program was still running.",
                f"Most of the {seen.elapsed:.1f} simulated seconds went to {most}.",
                readings,
                self._goals(),
            )
        listed = ", ".join(f"{name} {time:.1f} s" for name, time in parts.items() if time >= 0.05)
        between = f"Besides, {spent.between:.1f} s of real time passed between its commands."
        return self._made(
            Kind.TOO_SLOW,
            f"It was too slow: most of its time went to {most} ({listed}).",
            readings,
            between if spent.between else "",
            self._goals(),
        )

    def astray(self) -> Cause | None:
        """It gave up, or ran out of time, and was wrong about where it was, or had never found out."""
        seen = self._seen
        belief, lost = seen.beliefs
        if seen.task is None or belief is None:
            return None
        episodes = seen.episodes
        if lost is not None:
            frozen = [each for each in episodes if each.kind is EpisodeKind.FROZEN]
            how = ", and told the same pose on while it moved" if frozen else ""
            text = f"It was lost: {wrong_text(lost)}{how}, {self._end()}."
            return self._made(Kind.LOST, text, elapsed=lost.elapsed, line=lost.line)
        known = any(each.kind is EpisodeKind.LOCALIZED for each in episodes)
        if belief.unsure or not known or seen.hardly_localized:
            late = "no longer knew" if belief.unsure else "hardly found out"
            ever = late if known else "never found out"
            text = f"It {ever} where it was, {self._end()}."
            return self._made(Kind.UNSURE, text, belief_text(belief), self._goals())
        return None

    def disagreeing(self) -> Cause | None:
        """Its readings were right and its belief was not: program and log do not go together."""
        lost = self._seen.beliefs[1]
        if lost is None or not self._seen.looked_while_lost:
            return None
        text = (
            f"Program and log disagree from {lost.elapsed:.1f} s on: the readings in the log were right, and "
            "the belief was not. A mistake of the program and a changed reply cannot be told apart."
        )
        return self._made(Kind.UNDECIDED, text, elapsed=lost.elapsed, line=lost.line, sure=Sureness.LIKELY)

    def unread(self) -> Cause | None:
        """It gave up lost, and had not looked on the last of its path."""
        seen = self._seen
        gone, turned = seen.blind_for
        if self.astray() is None or not (gone > BLIND or turned > BLIND_TURN):
            return None
        text = (
            f"It stopped looking: no range sensor was read on the last {gone:.0f} in and {turned:.0f} deg "
            f"of its path, {self._end()}."
        )
        return self._made(
            Kind.UNREAD, text, belief_text(seen.beliefs[0]), self._goals(), sure=Sureness.LIKELY
        )

    def ended(self) -> Cause | None:
        """The program ended, and nothing else explains it."""
        if self._seen.task is None and not self._exit_code:
            return None
        code = f" with exit code {self._exit_code}" if self._exit_code is not None else ""
        words = f"; its last words: {self._last_words}" if self._last_words else ""
        return self._made(Kind.ENDED, f"The program ended{code} before it was done{words}.", self._goals())

    # -- words -----------------------------------------------------------------------------------

    def _end(self) -> str:
        if self._seen.out_of_time or self._cut_off:
            return "and then its time was up"
        words = f" (its last words: {self._last_words})" if self._last_words else ""
        return f"and then the program gave up{words}"

    def _goals(self) -> str:
        seen = self._seen
        if seen.task is None:
            return ""
        return "It held the block." if seen.holding else "" if seen.taken else "It had not taken the block."

    def moved(self) -> Cause | None:
        """A person moved the robot, and it never found out where it was again."""
        row = self._seen.moved
        if row is None:
            return None
        there, turn = row.done.pose, abs(wrapped(row.done.pose.heading - row.before.heading))
        way = math.hypot(there.x - row.before.x, there.y - row.before.y)
        after = "and no belief was right afterwards" if self._seen.beliefs[0] is not None else (
            "which the program could only notice by its sensors"
        )  # fmt: skip
        text = (
            f"A person moved the robot at {row.elapsed:.1f} s, by {way:.0f} in and {turn:.0f} deg, {after}."
        )
        return self._by_hand(row, text)

    def block_moved(self) -> Cause | None:
        """A person moved the block, and it was not taken."""
        row = self._seen.block_moved
        if row is None:
            return None
        to = place_text(*row.done.action.arguments[:2])
        text = f"A person moved the block at {row.elapsed:.1f} s, to {to}, and it was not taken afterwards."
        return self._by_hand(row, text)

    def _by_hand(self, row: ActionRow, text: str) -> Cause:
        made = self._made(Kind.MOVED, text, elapsed=row.elapsed, line=row.line, sure=Sureness.LIKELY)
        return replace(made, place=(row.before.x, row.before.y))

    def _made(
        self,
        kind: Kind,
        text: str,
        *evidence: str,
        elapsed: float | None = None,
        line: int | None = None,
        place: tuple[float, float] | None = None,
        sure: Sureness = Sureness.CERTAIN,
        culprits: tuple[str, ...] = (),
    ) -> Cause:
        """A cause at the run's end, or at a moment before."""
        seen = self._seen
        pose = seen.pose
        return Cause(
            kind,
            text,
            without_blanks(*evidence),
            seen.elapsed if elapsed is None else elapsed,
            seen.line if line is None else line,
            (pose.x, pose.y) if place is None else place,
            sure=sure,
            culprits=culprits,
        )
