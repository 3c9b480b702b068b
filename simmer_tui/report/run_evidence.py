"""The facts about a run that moments and causes are made of, each computed when it is first asked for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from msgspec import Struct

from simmer_tui.config.mission_plan import cells_of
from simmer_tui.report.belief_facts import BeliefFacts
from simmer_tui.report.command_audit import Corrections, multiplied_corrections
from simmer_tui.report.contact_evidence import ContactEvidence
from simmer_tui.report.device_differences import declared_errors
from simmer_tui.report.finding import FEWEST, Finding
from simmer_tui.report.robust_statistics import median_of
from simmer_tui.report.run_readings import poses_of, world_without_block
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.episodes import Episode, EpisodeKind
from simmer_tui.run.events import Goal, NoticeKind, ProgramEnded
from simmer_tui.run.facts import SLIGHT, missed_zone
from simmer_tui.run.history_rows import (
    BeliefRow,
    GripRow,
    MissionRow,
    MovementRow,
    NoticeRow,
    RefusalRow,
)
from simmer_tui.run.phrases import REAL_TIME_LIMIT, last_output, place_text, times_text
from simmer_tui.run.table import Columns
from simmer_tui.sim.command import counted
from simmer_tui.sim.records import Status
from simmer_tui.sim.sensors import ObservingSensor, modelled_sensor
from simmer_tui.sim.sensors.base import World
from simmer_tui.sim.specs import BLOCK

# Judged: a program that computes for so long between two commands has stopped.
_QUIET, _QUIET_SHARE = 5.0, 0.25
"""Seconds, real or simulated, and share of the run without a command at its end that count as silence."""
_REFUSED_SHARE = 0.05
"""Share of commands that were refused from which that changed the run. Judged."""
_SEEN = 1.0
"""Least change of a reading by the block, inches, with which a sensor sees it."""
_POSES = 400
"""Most poses from which it is computed who sees the block: a few minutes of movements."""
_STOOD = 0.05
"""Inches below which a movement has not moved the robot: a turn, or a wall in its way."""
_NONSENSE = "makes no sense as a movement"
"""Words of the connection doctor for the value of a command."""
_LINK_ERRORS = ("Connection", "BrokenPipe", "Timeout", "socket.timeout", "asyncio.TimeoutError")
"""Beginnings of errors with which a program tells that its link ended, or gave no reply."""
_LINK_WORDS = ("closed the connection", "no reply to")
"""Words of the client of this project, and of others, for a link that ended, or gave no reply."""
_CODES = 3
"""Codes of movements that are named in a sentence."""
_STOPS = 3
"""Movements that end at the block from which it was no chance, before any goal. Judged."""
_BOTH = 0.25
"""Share of movements to each side from which they go to and fro. Judged."""


class Silence(Struct, frozen=True):
    """Time without a command at the end of a run, from `since` on (elapsed seconds), and in real seconds."""

    since: float
    real_seconds: float


class Refusal(Struct, frozen=True):
    """Refused commands: one of them, all in words, the codes of those to drive, and True in `decides` if they
    changed the run."""

    row: RefusalRow
    text: str
    codes: tuple[str, ...] = ()
    decides: bool = False


class RunEvidence:
    """The facts about one attempt.

    Args:
        seen: The attempt.
        program: End of its program, where it is known and came before the end of the mission.
        cut_off: True if it was ended because real time was up.
        findings: Sensors and drives that are not as they should be.
    """

    def __init__(
        self,
        seen: Attempt,
        program: ProgramEnded | None = None,
        *,
        cut_off: bool = False,
        findings: Sequence[Finding] = (),
    ) -> None:
        self.seen = seen
        self.program = program
        over = seen.over
        self.cut_off = cut_off or (over is not None and over.event.reason.startswith(REAL_TIME_LIMIT))
        self.findings = findings
        self.stopped = over is None and not self.cut_off and (program is None or program.stopped)
        """True if the run ended before its mission: a person or a time limit stopped its program, or its
        connection ended."""
        # The exit code of a program that the simulator ended is not the program's own.
        self.exit_code = None if program is None or program.stopped else program.exit_code
        self.last_words = "" if program is None else last_output(program)
        self.has_contact = seen.too_many_contacts
        """True if contacts ended the mission."""

    # -- commands ------------------------------------------------------------------------------------------

    @cached_property
    def faults(self) -> list[NoticeRow]:
        """Faults that were reported since the last restart."""
        rows = self.seen.history.faults.first.items
        return [row for row in rows if self.seen.covers(row.order)]

    def fault_text(self, row: NoticeRow) -> str:
        """A fault in words. Of a number that makes no sense only that is told: a reply may have been misread,
        late, or of another command."""
        fact, found, _ = row.text.partition(_NONSENSE)
        return f"{fact}{_NONSENSE}" if found else row.text.rstrip(".")

    @cached_property
    def goals(self) -> list[MissionRow]:
        """Goals met, in order."""
        rows = self.seen.history.missions.items
        kept = (row for row in rows if row.order > self.seen.history.began)
        return [row for row in kept if isinstance(row.event.subject, Goal)]

    @property
    def deciding_fault(self) -> NoticeRow | None:
        """The first fault of the program's connection or its lines, unless a goal was met after it."""
        last = self.goals[-1].order if self.goals else 0
        rows = (row for row in self.faults if row.order > last)
        clear = (row for row in rows if row.notice.advice and _NONSENSE not in row.text)
        return next(iter(self.faults), None) if self.seen.is_silent else next(clear, None)

    @cached_property
    def all_refused(self) -> tuple[int, int]:
        """Number of the program's refused commands, those that came too early and again included, and of all
        its commands."""
        rows = self.seen.within(self.seen.history.commands)
        rows = rows[~np.isin(rows["number"], self.seen.typed)]
        return int(rows["refused"].sum()), len(rows)

    @property
    def all_refused_text(self) -> str:
        """The same in words: `1 of 4 commands was refused`."""
        refused, of = self.all_refused
        return f"{refused} of {counted(of, 'command')} {'was' if refused == 1 else 'were'} refused"

    @cached_property
    def refusal(self) -> Refusal | None:
        """The refused commands: most of those to drive, a share of all, one that was never carried out, or
        else the first one; None without any."""
        seen, rows = self.seen, self.seen.refusals
        for since in (seen.begun, seen.stalled.since):
            codes, count, of = seen.refused_drives(since)
            # Only the newest refusals are kept with their reasons.
            mine = [row for row in seen.all_refusals if row.result.command.code in codes]
            mine = [row for row in mine if row.elapsed >= since]
            if count >= FEWEST["set"] and 2 * count > of and mine:
                codes, count, of = seen.refused_drives(since, every=True)
                text = f"{count} of {of} commands to drive were refused"
                return Refusal(mine[0], text, tuple(codes), decides=True)
        text = self.all_refused_text
        unknown = next((row for row in rows if row.result.status is not Status.BUSY), None)
        commands = seen.within(seen.history.commands)
        commands = commands[seen.counts(commands) & ~np.isin(commands["number"], seen.typed)]
        is_share = commands["refused"].sum() >= _REFUSED_SHARE * len(commands)
        if unknown is not None and seen.task is not None and is_share:
            codes = [unknown.result.command.code] if unknown.result.status is Status.REFUSED else []
            return Refusal(unknown, text, tuple(codes), decides=True)
        undone = None if self.has_contact or seen.task is None else self._undone
        if undone is not None:
            return Refusal(
                undone, f"{text}; this one was never carried out", (undone.result.command.code,), decides=True
            )
        return Refusal(rows[0], text) if rows else None

    @property
    def _undone(self) -> RefusalRow | None:
        """The first refused command after the last goal that was never carried out: one that would have
        closed the gripper, if it took nothing, or the last one to drive."""
        seen, since = self.seen, self.goals[-1].order if self.goals else 0
        rows = [row for row in seen.refusals if row.order >= since and not seen.is_carried_out(row)]
        gripper = "" if seen.spec.gripper is None or seen.taken else seen.spec.gripper.code
        grips = [row for row in rows if row.result.command.code == gripper]
        driving = {row.code for row in (*seen.spec.drive_rows, *seen.spec.velocities)}
        last = seen.within(seen.history.movements)["order"].max(initial=0)
        drives = [row for row in rows if row.result.command.code in driving and row.order > last]
        return next(iter(grips or drives[-1:]), None)

    @cached_property
    def last_command(self) -> tuple[str, float] | None:
        """The program's last command, and the moment of its answer (elapsed seconds)."""
        seen, history = self.seen, self.seen.history
        rows, moves = seen.within(history.commands), seen.within(history.movements)
        if not len(rows):
            return None
        last, name = rows[-1], history.code_names[rows["code"][-1]]
        mine = moves["asked"][moves["number"] == last["number"]]
        asked = f"-{mine[-1]:g}" if len(mine) and math.isfinite(mine[-1]) else ""
        return f"{name}{asked}", float(last["elapsed"])

    @property
    def ended_by_link(self) -> bool:
        """True if the error or the last words of the program tell that its link had ended, or gave no
        reply."""
        said = (self.last_words, "" if self.program is None else self.program.error)
        return any(each.startswith(_LINK_ERRORS) or any(w in each for w in _LINK_WORDS) for each in said)

    @property
    def beside(self) -> NoticeRow | None:
        """The first client that connected while another was connected, since the last restart."""
        connected = 0
        for row in self._connections:
            match row.notice.kind:
                case NoticeKind.CONNECTED if connected > 0 and row.order > self.seen.history.began:
                    return row
                case NoticeKind.CONNECTED:
                    connected += 1
                case NoticeKind.TAKEN_OVER:
                    connected = 0
                case NoticeKind.LEFT:
                    connected -= 1
        return None

    @property
    def turned_away(self) -> NoticeRow | None:
        """The first client that was turned away because another was connected, if the program then ended by
        itself with an exit code."""
        rows = (row for row in self._connections if row.notice.kind is NoticeKind.TURNED_AWAY)
        return next(rows, None) if self.exit_code and not self.goals else None

    @property
    def ended_at(self) -> str:
        """The line at which the program was when the simulator ended it; empty if that is not known."""
        ended = self.seen.history.programs.items
        return ended[-1].event.place if ended and ended[-1].event.stopped else ""

    @property
    def _connections(self) -> list[NoticeRow]:
        end = self.seen.history if self.seen.over is None else self.seen.over
        return [row for row in self.seen.history.notices.items if row.order <= end.order]

    @cached_property
    def silence(self) -> Silence | None:
        """The time without a command at the end; None if it was short, or if the program ended by itself."""
        seen = self.seen
        ended = self.exit_code is not None and not seen.is_silent
        if self.has_contact or ended or (self.stopped and self.program is None):
            return None
        if seen.is_silent:
            return Silence(seen.begun, seen.history.real_time)
        rows, moves = seen.within(seen.history.commands), seen.within(seen.history.movements)
        if not len(rows) or not (self.cut_off or self.stopped or seen.out_of_time):
            return None
        end = max(float(rows["elapsed"][-1]), float(moves["elapsed"][-1]) if len(moves) else 0.0)
        quiet = seen.elapsed - end
        times = rows["real_time"][np.isfinite(rows["real_time"])]
        real = seen.history.real_time - float(times.max(initial=0.0))
        # Who stops a program has waited for it: that needs no share of the run.
        share = 0.0 if self.stopped else _QUIET_SHARE
        by_clock = quiet >= max(_QUIET, share * (seen.elapsed - seen.begun))
        by_real_time = real >= max(_QUIET, share * (seen.history.real_time or math.inf))
        if by_clock or ((self.cut_off or self.stopped) and by_real_time):
            return Silence(end, real)
        return None

    @property
    def silence_text(self) -> str:
        """The time without a command at the end, in words; empty without one."""
        quiet, last = self.silence, self.last_command
        if quiet is None:
            return ""
        answered = "the last command" if last is None else last[0]
        end = f"the run was ended at the {'real ' if self.cut_off else ''}time limit"
        if self.stopped:
            end = f"the program was stopped, {quiet.real_seconds:.0f} s of real time later"
        return f"{answered} was answered, and no command came after it until {end}"

    @cached_property
    def corrections(self) -> list[Corrections]:
        """The corrections that did not shrink, by drive; none where they did."""
        if self.seen.history.is_twin:
            return []
        known = {each.of for each in self.findings}
        drives = [each for each in self.seen.spec.drives if each.code not in known]
        found = [multiplied_corrections(self.seen, row) for row in drives]
        return [each for each in found if each is not None]

    # -- devices -------------------------------------------------------------------------------------------

    def findings_about(self, *, drives: bool) -> list[Finding]:
        """The findings about drives, or about sensors."""
        codes = {each.code for each in self.seen.spec.drives}
        return [each for each in self.findings if (each.of in codes) is drives]

    @cached_property
    def declared(self) -> dict[str, str]:
        """Large errors that the set itself declares, by code of the device; those with a finding are left
        out."""
        return declared_errors(self.seen, {each.of for each in self.findings})

    @cached_property
    def time_parts(self) -> dict[str, float]:
        """Seconds by what they went to, the largest part first."""
        seen, spent = self.seen, self.seen.spent
        rest = max(seen.elapsed - seen.begun - spent.driving - spent.reading - spent.link, 0.0)
        parts = {"driving": spent.driving, "reading": spent.reading, "the link": spent.link, "waiting": rest}
        return dict(sorted(parts.items(), key=lambda each: -each[1]))

    @cached_property
    def unseen_block(self) -> tuple[str, ...]:
        """Codes of the sensors that alone see the block, if none of them was read though the block came in
        their sight after the loading zone was reached."""
        seen, spec = self.seen, self.seen.spec
        made = [modelled_sensor(each) for each in spec.sensors if each.enabled and each.kind.is_range]
        ranges = [each for each in made if isinstance(each, ObservingSensor)]
        sees = [each for each in ranges if each.sees_block(spec.block_size)]
        was_read = any(each.spec.code in seen.history.sensor_codes for each in sees)
        lying = next((row.block for row in seen.history.blocks.items if not row.held), None)
        if was_read or lying is None or not self.goals or not lying.size:
            return ()
        poses = poses_of(seen.within(seen.history.movements, self.goals[-1].order)[:_POSES])
        without = world_without_block(spec)
        world = World(without.maze, lying, False)
        with np.errstate(invalid="ignore"):
            off = [each.true_values(without, poses) - each.true_values(world, poses) for each in sees]
        return tuple(each.spec.code for each in sees) if (np.abs(off) > _SEEN).any() else ()

    # -- beliefs -------------------------------------------------------------------------------------------

    @cached_property
    def belief(self) -> BeliefFacts:
        """The beliefs beside the truth."""
        return BeliefFacts(self.seen, {each.of for each in self.findings})

    @cached_property
    def last_belief(self) -> BeliefRow | None:
        """The belief that led to the contact, the grip or the end."""
        return self._beliefs[0]

    @cached_property
    def lost_belief(self) -> BeliefRow | None:
        """The first wrong belief of those that led there; None if they were right."""
        return self._beliefs[1]

    @property
    def _beliefs(self) -> tuple[BeliefRow | None, BeliefRow | None]:
        if self.seen.history.is_twin:
            return None, None
        if self.has_contact and self.contact is not None:
            return self.contact.belief, self.contact.lost
        return self.seen.beliefs if self.last_grip is None else self.seen.belief_before(self.last_grip.order)

    @cached_property
    def localized(self) -> Episode | None:
        """The first time that the program knew its place, until the attempt's end."""
        rows = (each for each in self.seen.episodes if each.elapsed <= self.seen.elapsed)
        return next((each for each in rows if each.kind is EpisodeKind.LOCALIZED), None)

    # -- the contact, and the gripper ----------------------------------------------------------------------

    @cached_property
    def contact(self) -> ContactEvidence | None:
        """The last contact."""
        met = self.seen.collision
        return None if met is None else ContactEvidence(self.seen, met)

    @property
    def touched(self) -> ContactEvidence | None:
        """The contact that matters: the one that ended the mission, or the last one of a run without an
        end."""
        return self.contact if self.has_contact or self.seen.over is None else None

    @cached_property
    def repeated(self) -> int:
        """Number of times that the movement with the contact came in a row, nothing being sent between."""
        moves, count = self.seen.within(self.seen.history.movements), 1
        if self.contact is not None:
            moves = moves[moves["order"] <= self.contact.met.row.order]
        while count < len(moves) and _is_same(moves[-count - 1], moves[-count]):
            count += 1
        return count

    @property
    def last_grip(self) -> GripRow | None:
        """The grip that decided: the block was let go and not taken again, or never taken."""
        seen = self.seen
        if seen.put_down is not None:
            return seen.put_down
        return seen.misses[-1] if seen.misses and not seen.taken else None

    @property
    def missed_by(self) -> float:
        """Inches by which the deciding grip missed the block, or the block the drop zone; 0 without one."""
        row, zone = self.last_grip, None if self.seen.task is None else self.seen.task.zone
        if row is None:
            return 0.0
        if row.grip.closed:
            return math.hypot(*(row.grip.missed or (0.0, 0.0)))
        block = row.grip.block
        return 0.0 if zone is None else math.hypot(*missed_zone(zone, block.x, block.y))

    def load_text(self, done: GripRow) -> str:
        """The last readings of load sensors before a grip, in sentences with a space before them."""
        rows, codes = self.seen.within(self.seen.history.readings), self.seen.history.sensor_codes
        text = ""
        for each in self.seen.load_sensors:
            mine = [codes[number] == each.code for number in rows["sensor"]]
            values = rows["value"][np.array(mine, bool) & (rows["order"] < done.order)]
            text += f" {each.code} {f'read {values[-1]:g}' if len(values) else 'was never read'} before that."
        return text

    @property
    def left_at_place(self) -> bool:
        """True if the block was let go where it had lain at first."""
        lay = next((row.block for row in self.seen.history.blocks.items if not row.held), None)
        if lay is None or self.seen.put_down is None:
            return False
        block = self.seen.put_down.grip.block
        return math.hypot(block.x - lay.x, block.y - lay.y) <= SLIGHT

    @cached_property
    def unused_grip(self) -> tuple[MovementRow, str, int] | None:
        """The first movement after which the gripper should have been used and never was, that in words, and
        the value of its command. None if there is none."""
        seen = self.seen
        if seen.holding and seen.arrivals:
            return seen.arrivals[0], "the block was in the drop zone, and the gripper was never opened", 0
        # A program that stays may be about to close it; one that reads the load sensor believes it closed.
        if seen.taken or seen.closed or not seen.graspable or seen.stuck is not None:
            return None
        # A robot on its way elsewhere may pass over the block by chance.
        until = seen.graspable[-1].order
        is_meant = len(seen.graspable) >= _STOPS or any(goal.order <= until for goal in self.goals)
        if not seen.asked_after_grip and not (seen.left_block and is_meant):
            return None
        count, text = len(seen.graspable), "the block was between the jaws, and the gripper was never closed"
        often = f"; it was there after {count} movements" if count > 1 else ""
        return seen.graspable[0], f"{text}{often}", 1

    # -- in words ------------------------------------------------------------------------------------------

    @property
    def arrived_text(self) -> str:
        """A sentence on the commands that arrived."""
        refused, of = self.all_refused
        # The share is of what was answered in time; what a program sent arrived all the same.
        sent = of if len(self.seen.typed) else max(of, self.seen.commands)
        return f"{counted(sent, 'command')} arrived, {refused} refused."

    @property
    def last_reading(self) -> str:
        """The last reading, in words: `49.4 in by u3, at 21.6 s`; empty without one."""
        last = self.seen.within(self.seen.history.readings)[-1:]
        if not len(last):
            return ""
        code = self.seen.history.sensor_codes[int(last["sensor"][0])]
        unit = next((each.unit for each in self.seen.spec.sensors if each.code == code), "")
        value = f"{float(last['value'][0]):.4g} {unit}".rstrip()
        return f"{value} by {code}, at {float(last['elapsed'][0]):.1f} s"

    @property
    def stand_text(self) -> str:
        """The robot's place at the end, and the belief of it."""
        seen, belief = self.seen, self.seen.beliefs[0]
        if seen.task is None or seen.history.is_twin:
            return ""
        believed = "" if belief is None else f", and its belief was off by {belief.error_text}"
        return f"It stood at {place_text(seen.pose.x, seen.pose.y)}{believed}."

    @property
    def still_text(self) -> str:
        """The time without a movement at the end, in a sentence; empty if it was short."""
        seen = self.seen
        moves = seen.within(seen.history.movements)
        since = float(max(moves["elapsed"][moves["went"] > _STOOD], default=seen.begun))
        later = moves[moves["elapsed"] > since]
        if seen.elapsed - since < _QUIET or (later["grips"] | later["contact"]).any():
            return ""
        return f"From {since:.1f} s on no movement came{' but turns' if len(later) else ''}."

    @property
    def strayed_text(self) -> str:
        """A sentence on a block that was never taken and lies outside the loading zone; empty without one."""
        seen = self.seen
        loading, block = cells_of(seen.spec.maze, BLOCK), seen.history.blocks.items[-1].block
        # Where the block of a real robot lies no log says.
        is_known = seen.task is not None and bool(loading) and not seen.history.is_twin
        if seen.taken or not is_known or any(cell.holds(block.x, block.y) for cell in loading):
            return ""
        return f"The block lay at {place_text(block.x, block.y)}, outside the loading zone."

    @property
    def goals_text(self) -> str:
        """The goal that was not met, in a sentence."""
        seen, zone = self.seen, None if self.seen.task is None else self.seen.task.zone
        if seen.task is None or (seen.taken and not seen.holding) or seen.is_silent:
            return ""
        if seen.holding:
            where = "" if zone is None else f" at {place_text(zone.x, zone.y)}"
            return f"The robot held the block, and had not set it down in the drop zone{where}."
        never = (
            "It never entered the loading zone."
            if not self.goals
            else "The robot had not taken the block yet."
        )
        return self.strayed_text or never

    @property
    def stalled_text(self) -> str:
        """The movements without progress at the end, in words."""
        stalled = self.seen.stalled
        turned = f" and {stalled.turned:.0f} deg" if stalled.turned >= 1.0 else ""
        text = f"{stalled.movements} movements reached no goal and no new place"
        return f"{text} ({stalled.driven:.0f} in{turned}): {self._movements_by_code(stalled.since)}".rstrip(
            ": "
        )

    def _movements_by_code(self, since: float) -> str:
        """The movements from a moment on by their codes, with their usual size: `r1 375 times by 0.1`."""
        names, moves = self.seen.history.code_names, self.seen.within(self.seen.history.movements)
        moves = moves[(moves["elapsed"] > since) & np.isfinite(moves["asked"]) & ~moves["grips"]]
        numbers, counts = np.unique(moves["code"], return_counts=True)
        told = []
        for place in np.argsort(-counts)[:_CODES]:
            asked = moves["asked"][moves["code"] == numbers[place]]
            sign = "+-" if _BOTH <= float((asked < 0.0).mean()) <= 1.0 - _BOTH else ""
            usual = f"{sign}{median_of(np.abs(asked)):.2g}"
            told.append(f"{names[numbers[place]]} {times_text(int(counts[place]))}, mostly by {usual}")
        return "; ".join(told)


def _is_same(first: Columns, second: Columns) -> bool:
    """True if a movement repeats the one before, with no command between."""
    same = first["code"] == second["code"] and first["asked"] == second["asked"] != 0.0
    return bool(same and second["number"] - first["number"] == 1 and not second["grips"])
