"""The present attempt of a run: its history since the last restart, until its mission's end."""

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TypeVar

import numpy as np
from msgspec import Struct, field

from simmer_tui.config.loader import Configuration
from simmer_tui.config.mission_plan import Cell, MissionPlan, draw_mission
from simmer_tui.run.episodes import Episode
from simmer_tui.run.events import ActionName, Goal, MovementEnded, NoticeKind, Result, goals_of
from simmer_tui.run.facts import LastReading, Stuck
from simmer_tui.run.history_rows import (
    ActionRow,
    BeliefRow,
    BlockPose,
    ContactRow,
    GripRow,
    LoggedRow,
    MissionRow,
    MovementRow,
    RefusalRow,
)
from simmer_tui.run.progress import StalledPeriod, without_progress
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.table import Columns, Newest, RowT, RowTable
from simmer_tui.sim.arrays import BoolArray, IntArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.command import PEOPLE, parse_value
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.gripper import can_take, in_global_frame
from simmer_tui.sim.path import Contact
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import CELL_SIZE, SensorSpec

LoggedRowT = TypeVar("LoggedRowT", bound=LoggedRow)


class Task(Struct, frozen=True):
    """Limits of a mission, and what it asks for: the cell for the block, None where that is not known, and
    the goals."""

    contacts: int | None
    time_limit: float
    zone: Cell | None
    goals: tuple[Goal, ...]


def task_of(configuration: Configuration, seed: int, plan: MissionPlan | None = None) -> Task | None:
    """The task of a run with a mission under way; None if the configuration has no mission. Without a
    `plan`, as in a log, it is drawn again from the run's seed."""
    if plan is not None:
        return Task(plan.contacts, plan.time_limit, plan.drop_zone, goals_of(plan))
    mission, settings = configuration.mission, configuration.settings
    if mission is None:
        return None
    drawn = draw_mission(mission, configuration.simulation, seed)
    # A start or block set by hand means that the run was not drawn from the seed: its zone is not known.
    same = (drawn.start.x, drawn.start.y) == settings.bot_center and drawn.block == settings.block_center
    zone = drawn.drop_zone if same else None
    return Task(mission.contacts, mission.time_limit, zone, goals_of(mission))


class Collision(Struct, frozen=True):
    """A movement with a contact, and all that was known when it began. That is the newest belief, the first
    of the lost beliefs that led to it (`lost`), each sensor's last reading, and a held block in the robot's
    frame. `unseen` are the movements since a sensor was read, newest last. `by_velocity` is true
    for a leg of a velocity: it has no movements before it."""

    row: ContactRow
    belief: BeliefRow | None
    lost: BeliefRow | None
    readings: Mapping[str, LastReading]
    held: Block | None
    unseen: Sequence[MovementEnded] = ()
    by_velocity: bool = False

    @property
    def ended(self) -> MovementEnded:
        """The movement with the contact."""
        return self.row.ended

    @property
    def contact(self) -> Contact:
        """The contact: its place and its time."""
        return self.row.contact


class SpentTime(Struct):
    """Time spent, simulated seconds; `between` is the real time from an answer to the next
    command: the program's thinking, and the link."""

    driving: float = 0.0
    reading: float = 0.0
    link: float = 0.0
    between: float = 0.0
    readings: Counter[str] = field(default_factory=Counter)
    took: Counter[str] = field(default_factory=Counter)
    """Whole milliseconds of the readings, by code."""


class Attempt:
    """The part of a run since its last restart, until its mission ends.

    It is a view of the history at the moment it is made: later events do not change it.
    """

    def __init__(self, history: RunHistory, task: Task | None) -> None:
        self.history = history
        # A set may have a mission that has not begun.
        self.task = task if history.missions.first.given else None
        self._within: dict[tuple[int, int], Columns] = {}
        """Columns by table and first event: many causes ask for the same, and gathering them takes longer."""
        self.spec = history.spec
        self._began = history.began
        self.over: MissionRow | None = next(
            (row for row in history.missions.items if row.order > self._began and row.event.over), None
        )
        # What comes after a mission's end is not part of the attempt.
        end = history if self.over is None else self.over
        self._until, self.elapsed, self.line = end.order, end.elapsed, end.line
        actions = history.actions.items
        self._restart = next((row for row in actions if row.order == self._began), None)
        """The restart that it begins with, if that is kept."""
        self.begun = history.begun if self._restart is None else self._restart.elapsed
        put = next((row for row in reversed(actions) if row.done.places and row.order <= self._until), None)
        self.placed = 0 if put is None else put.order
        """The running number of the event that last put the robot somewhere; 0 if none did."""
        self._place = (history.start, history.begun) if put is None else (put.done.pose, put.elapsed)

    def within(self, table: RowTable[RowT], since: int | None = None) -> Columns:
        """The rows of a table after an event until its end, by default after the last restart."""
        key = (id(table), self._began if since is None else since)
        if key not in self._within:
            begin, end = table.place_of(key[1] + 1), table.place_of(self._until + 1)
            self._within[key] = table.columns(begin, end)
        return self._within[key]

    def covers(self, order: int) -> bool:
        """True for an event after the last restart, until its end."""
        return self._began < order <= self._until

    def _rows(self, kept: Newest[LoggedRowT]) -> list[LoggedRowT]:
        """The rows of a kind since the last restart until its end, newest last."""
        return [row for row in kept.items if self.covers(row.order)]

    @property
    def seconds(self) -> float:
        """Simulated seconds that it took, or has taken; of a mission, by its own clock."""
        return self.elapsed - self.begun if self.over is None else self.over.event.time

    @property
    def restart(self) -> str:
        """Words behind a time since its beginning: ` after the restart at 40.0 s`. Empty if nothing restarted
        the run, and its times are those of the log."""
        return "" if self._restart is None else f" after the restart at {self.begun:.1f} s"

    # -- how it ended ----------------------------------------------------------------------------

    @property
    def failed(self) -> bool:
        """True if the mission has failed."""
        return self.over is not None and self.over.event.subject is Result.FAILED

    @property
    def too_many_contacts(self) -> bool:
        """True if a mission ended by contacts."""
        return self.task is not None and self.task.contacts is not None and self.contacts > self.task.contacts

    @property
    def out_of_time(self) -> bool:
        """True if a mission ended by its time limit."""
        return (
            self.task is not None and self.over is not None and self.over.event.time >= self.task.time_limit
        )

    @cached_property
    def pose(self) -> Pose:
        """Pose of the robot at its end."""
        last = self._last_movement
        return self._place[0] if last is None or last.order <= self.placed else last.pose

    @property
    def _last_movement(self) -> MovementRow | None:
        return self.history.movements.before(self._until + 1)

    @property
    def episodes(self) -> list[Episode]:
        """The episodes of its beliefs, as of a run that ended badly."""
        return self.history.episodes.so_far(ended_badly=True)

    @property
    def all_refusals(self) -> list[RefusalRow]:
        """The program's commands that did nothing, newest last."""
        rows = self._rows(self.history.refusals)
        return [row for row in rows if row.result.command.source not in PEOPLE]

    @property
    def refusals(self) -> list[RefusalRow]:
        """The program's commands that did nothing, newest last. Those that came too early are left out if
        they were sent again until the robot had stopped."""
        moves, names = self.within(self.history.movements), self.history.code_names
        rows, last = self.all_refusals, moves["number"].max(initial=-1)
        drives = {each.code for each in self.spec.drive_rows}
        trailing = {each.result.command.code for each in rows if each.result.number > last} & drives
        is_alone = sum(row.result.is_early for row in rows) == 1
        found = []
        for row in rows:
            result = row.result
            place = int(np.searchsorted(moves["number"], result.number))
            # A program that asks until the robot has stopped repeats one command; others go on to the next.
            again = (
                len(trailing) < 2
                if place == len(moves)
                else names[moves["code"][place]] == result.command.code
            )
            if not result.is_early or not (self.is_carried_out(row) if is_alone else again):
                found.append(row)
        return found

    def is_carried_out(self, row: RefusalRow) -> bool:
        """True if a refused command of a drive was carried out later, or if the gripper closed later."""
        command, gripper = row.result.command, self.spec.gripper
        if gripper is not None and command.code == gripper.code:
            return any(order > row.order for order in self.closings)
        moves, names = self.within(self.history.movements), self.history.code_names
        mine = np.isin(moves["code"], [place for place, name in enumerate(names) if name == command.code])
        moves = moves[mine & (moves["order"] > row.order)]
        value = parse_value(command.argument)
        return bool(len(moves) if isinstance(value, str) else np.isclose(moves["asked"], value).any())

    @property
    def refused(self) -> int:
        """Number of refused commands. Of those that came too early only the kept `refusals` count."""
        rows = self.within(self.history.commands)
        return int((rows["refused"] & self.counts(rows)).sum())

    def counts(self, rows: Columns) -> BoolArray:
        """True for the commands that are no repetition in vain, (n,): those that came too early and were
        sent again until the robot had stopped are left out."""
        kept = {row.result.number for row in self.refusals if row.result.is_early}
        return np.asarray(~rows["early"] | np.isin(rows["number"], list(kept)))

    @cached_property
    def command_codes(self) -> IntArray:
        """Codes of the commands since the last restart, as indices into the history's `code_names`, (n,)."""
        answered = self.within(self.history.commands)
        moved = self.within(self.history.movements)
        # The answer to the command that ends a mission comes after that end.
        last = moved[moved["number"] > answered["number"].max(initial=0)]
        return np.concatenate([answered["code"], last["code"][:1]])

    @property
    def commands(self) -> int:
        """Number of commands since the last restart."""
        return len(self.command_codes)

    @property
    def is_silent(self) -> bool:
        """True if no command has come, and nothing went over a dialect's line."""
        return not self.commands and not self.history.totals.wires

    @cached_property
    def contacts(self) -> int:
        """Number of contacts since the last restart."""
        return int(self.within(self.history.movements)["contact"].sum())

    @property
    def was_moved(self) -> bool:
        """True if a person has put the robot elsewhere: readings and beliefs before that do not count."""
        return self.placed > self.history.began

    # -- beliefs and contacts --------------------------------------------------------------------

    def belief_before(self, order: int) -> tuple[BeliefRow | None, BeliefRow | None]:
        """The newest belief before an event and, if it is lost, the first lost one since the last that was
        right and sure."""
        beliefs = self.history.beliefs
        newest = lost = later = None
        # Backwards, as far as it matters: a long run has tens of thousands.
        for place in range(beliefs.place_of(order) - 1, beliefs.place_of(self.placed + 1) - 1, -1):
            row = beliefs[place]
            # Of beliefs of one moment the last one counts.
            if not row.finite or (later is not None and row.elapsed == later.elapsed):
                continue
            later = row
            newest = newest or row
            if row.lost:
                lost = row
            elif row is newest or row.is_right:
                break
        return newest, lost

    @cached_property
    def beliefs(self) -> tuple[BeliefRow | None, BeliefRow | None]:
        """The last belief and, if it is lost, the first lost one since the last that was right and sure."""
        return self.belief_before(self._until + 1)

    @cached_property
    def collision(self) -> Collision | None:
        """The last contact."""
        history = self.history
        rows = self._rows(history.contacts)
        if not rows:
            return None
        order = rows[-1].order
        belief, lost = self.belief_before(order)
        block = [each for each in history.blocks.items if each.order < order][-1]
        held = block.block if block.held else None
        by_velocity = rows[-1].ended.command.code in {each.code for each in self.spec.velocities}
        unseen = [] if by_velocity else self._led_to(order)
        return Collision(rows[-1], belief, lost, self._last_readings(order), held, unseen, by_velocity)

    def _led_to(self, order: int) -> list[MovementEnded]:
        """The movements between the last reading and one, newest last. They go back as far as only drives
        moved the robot."""
        readings = self.history.readings
        newest = [row for row in self.history.newest if row[0] <= order]
        found: list[MovementEnded] = []
        for (before, ended), (after, follower) in zip(newest[-2::-1], newest[:0:-1], strict=True):
            free = ended.contact is None and not ended.stopped_by and ended.trajectory.kind is not None
            was_read = readings.place_of(before) != readings.place_of(after)
            if not free or was_read or ended.pose != follower.before:
                break
            found.insert(0, ended)
        return found

    def _last_readings(self, order: int) -> dict[str, LastReading]:
        """The last reading of each sensor before an event, by its code."""
        table = self.history.readings
        begin, end = table.place_of(self.placed + 1), table.place_of(order)
        sensors = table.columns(begin, end)["sensor"]
        found = {}
        for number, code in enumerate(self.history.sensor_codes):
            places = np.flatnonzero(sensors == number)
            if len(places):
                row = table[begin + int(places[-1])]
                found[code] = LastReading(code, row.value, row.true, row.elapsed, row.gone, row.turned)
        return found

    @cached_property
    def stuck(self) -> Stuck | None:
        """Stretch at the end in which a wall held the robot; None if it was not stuck."""
        limit = self.elapsed if self.task is None else self.task.time_limit
        return self.history.stuck(limit, self.placed, self._until)

    # -- actions of people -----------------------------------------------------------------------

    def _by_hand(self, name: ActionName) -> ActionRow | None:
        """The last action of a person of this name, after the program's first command."""
        first = self.history.commands.place_of(self._began + 1)
        rows = [
            row
            for row in self._rows(self.history.actions)
            if row.done.action.name is name
            and not row.done.refused
            and self.history.commands.place_of(row.order) > first
        ]
        return rows[-1] if rows else None

    @cached_property
    def moved(self) -> ActionRow | None:
        """The last time that a person moved the robot, unless a belief has been right since. A reset moves it
        too, if the program continues."""
        row = self._by_hand(ActionName.TELEPORT) or self.reset
        return None if row is None or self._is_right_since(row.order) else row

    @property
    def emptied(self) -> bool:
        """True if the reset with which the run begins took the block out of the gripper."""
        before = [row for row in self.history.blocks.items if row.order < self._began]
        return self.reset is not None and bool(before) and before[-1].held

    @property
    def reset(self) -> ActionRow | None:
        """The reset with which the run begins, if a program that had driven before it continues."""
        history, row = self.history, self._restart
        if row is None or not history.commands.place_of(self._began):
            return None
        # A program that was started again after the reset has not been moved while it ran.
        came = (row for row in history.notices.items if row.notice.kind is NoticeKind.CONNECTED)
        return None if any(each.order > self._began for each in came) else row

    @cached_property
    def typed(self) -> IntArray:
        """Numbers of the commands that people gave at the screen, (n,)."""
        people = [place for place, name in enumerate(self.history.source_names) if name in PEOPLE]
        # The answer to the command that ends a mission comes after that end.
        rows = self.history.commands.columns(0, len(self.history.commands))
        return np.asarray(rows["number"][np.isin(rows["source"], people)])

    @cached_property
    def driven_by_hand(self) -> MovementRow | None:
        """The first movement that a person commanded after the program's first and since the last right
        belief."""
        history = self.history
        rows, begin = self.within(history.movements), history.movements.place_of(self._began + 1)
        by_hand = np.isin(rows["number"], self.typed)
        is_program = np.cumsum(~by_hand) > 0
        drove = (
            history.movements[begin + int(each)]
            for each in np.flatnonzero(by_hand & ~rows["grips"] & is_program)
        )
        return next((row for row in drove if not self._is_right_since(row.order)), None)

    def is_connected(self, order: int) -> bool:
        """True if a program was connected at an event, or if the notices do not say."""
        kinds = (NoticeKind.CONNECTED, NoticeKind.LEFT, NoticeKind.TAKEN_OVER)
        rows = (row for row in reversed(self.history.notices.items) if row.order < order)
        last = next((row.notice.kind for row in rows if row.notice.kind in kinds), None)
        return last in (NoticeKind.CONNECTED, None)

    def _is_right_since(self, order: int) -> bool:
        """True if a belief after an event was right."""
        beliefs = self.history.beliefs
        since = beliefs[beliefs.place_of(order) : beliefs.place_of(self._until + 1)]
        return any(each.is_right for each in since)

    @cached_property
    def block_moved(self) -> ActionRow | None:
        """The last time that a person moved the block, unless it was taken afterwards."""
        row = self._by_hand(ActionName.BLOCK)
        if row is None or any(each.grip.holding for each in self._grips if each.order > row.order):
            return None
        return row

    # -- grips -----------------------------------------------------------------------------------

    @cached_property
    def _grips(self) -> list[GripRow]:
        return self._rows(self.history.grips)

    @cached_property
    def _blocks(self) -> list[BlockPose]:
        """The places of the block, the last one at its end."""
        return [row for row in self.history.blocks.items if row.order <= self._until]

    @property
    def _lies_since(self) -> int:
        """The running number of the event since which the block has been in its present place. A gripper that
        opened beside it, or closed on nothing, has not moved it."""
        since = self._blocks[-1]
        for row in reversed(self._blocks):
            if row.held or row.block != since.block:
                break
            since = row
        return since.order

    @property
    def misses(self) -> list[GripRow]:
        """The grips that took nothing."""
        return [row for row in self._grips if row.grip.closed and not row.had and not row.grip.holding]

    @property
    def takes(self) -> int:
        """Number of grips that took the block."""
        return sum(row.grip.holding and not row.had for row in self._grips)

    @property
    def taken(self) -> bool:
        """True if the block has been taken."""
        return any(row.grip.holding for row in self._grips)

    @property
    def put_down(self) -> GripRow | None:
        """The grip that let the block go, if it was not taken again."""
        last = next((row for row in reversed(self._grips) if row.grip.holding or row.had), None)
        return None if last is None or last.grip.holding else last

    @property
    def closed(self) -> bool:
        """True if the gripper was closed, whatever it took."""
        return any(row.grip.closed for row in self._grips)

    @property
    def closings(self) -> list[int]:
        """The running numbers of the events in which the gripper was closed."""
        return [row.order for row in self._grips if row.grip.closed]

    @cached_property
    def graspable(self) -> list[MovementRow]:
        """Movements that ended with the block between the open jaws, while it was not held."""
        gripper, history = self.spec.gripper, self.history
        if gripper is None:
            return []
        lying = self._blocks[-1]
        if lying.held or not lying.block.size:
            return []
        since = max(self._lies_since, self.placed, self._began)
        rows, begin = self.within(history.movements, since), history.movements.place_of(since + 1)
        footprint = Footprint.of(self.spec.robot)
        near = footprint.front + gripper.reach + gripper.width
        places = np.flatnonzero(np.hypot(rows["x"] - lying.block.x, rows["y"] - lying.block.y) <= near)
        found = [history.movements[begin + int(place)] for place in places]
        return [row for row in found if can_take(gripper, footprint, row.pose, lying.block)]

    @property
    def holding(self) -> bool:
        """True if the gripper holds the block."""
        return self._blocks[-1].held

    @property
    def load_sensors(self) -> list[SensorSpec]:
        """Sensors that say that the gripper holds something; those of a team's own devices are left out."""
        return [each for each in self.spec.sensors if each.kind.detects_block and not each.kind.is_opaque]

    @property
    def asked_after_grip(self) -> bool:
        """True if a load sensor was read while the block was between the open jaws: the program must have
        believed that it had closed them."""
        load = {each.code for each in self.load_sensors}
        readings, movements = self.history.readings, self.history.movements
        for row in self.graspable:
            place = movements.place_of(row.order + 1)
            after = movements[place].order if place < len(movements) else self._until
            begin, end = readings.place_of(row.order), readings.place_of(after)
            numbers = readings.columns(begin, end)["sensor"]
            if any(self.history.sensor_codes[number] in load for number in set(numbers.tolist())):
                return True
        return False

    @cached_property
    def arrivals(self) -> list[MovementRow]:
        """Movements that ended with the held block in the drop zone, since it was taken."""
        history, task = self.history, self.task
        held = self._blocks[-1]
        if not held.held or task is None or task.zone is None:
            return []
        begin, end = (history.movements.place_of(order + 1) for order in (held.order, self._until))
        blocks = ((row, in_global_frame(held.block, row.pose)) for row in history.movements[begin:end])
        return [row for row, block in blocks if task.zone.holds(block.x, block.y)]

    # -- use of time -----------------------------------------------------------------------------

    @cached_property
    def stalled(self) -> StalledPeriod:
        """The stretch without progress that lasted until the end."""
        history = self.history
        goals = [row.order for row in history.missions.items if isinstance(row.event.subject, Goal)]
        since = max([self.placed, *(order for order in goals if order <= self._until)])
        rows = self.within(history.movements, since)
        return without_progress(rows, history.are_legs(rows), *self._place)

    def refused_drives(self, since: float, *, every: bool = False) -> tuple[list[str], int, int]:
        """Codes of the program's commands to drive that were refused from a moment on (elapsed seconds), how
        many those were, and how many came in all; see `counts`, unless `every` one is to be counted."""
        rows, names = self.within(self.history.commands), self.history.code_names
        kept = (rows["elapsed"] >= since) & ~np.isin(rows["number"], self.typed)
        rows = rows[kept if every else kept & self.counts(rows)]
        driving = {each.code for each in self.spec.drives} | {each.code for each in self.spec.velocities}
        rows = rows[np.isin(rows["code"], [place for place, name in enumerate(names) if name in driving])]
        codes = rows["code"][rows["refused"]]
        return [names[number] for number in sorted(set(codes.tolist()))], len(codes), len(rows)

    @property
    def left_block(self) -> bool:
        """True if the robot moved away by more than a cell after the block had been between its open jaws."""
        if not self.graspable:
            return False
        rows, lying = self.within(self.history.movements, self.graspable[0].order), self._blocks[-1].block
        return bool((np.hypot(rows["x"] - lying.x, rows["y"] - lying.y) > CELL_SIZE).any())

    @cached_property
    def spent(self) -> SpentTime:
        """Simulated time by its use."""
        history = self.history
        commands, readings = self.within(history.commands), self.within(history.readings)
        movements = self.within(history.movements)
        spent = SpentTime(float((movements["elapsed"] - movements["begin"]).sum()))
        spent.link = float(commands["link"].sum())
        sensors = {each.code: each for each in self.spec.sensors}
        for number, code in enumerate(history.sensor_codes):
            mine = readings[readings["sensor"] == number]
            if len(mine):
                # A reading without a time of its own took the configured one.
                took = np.where(mine["took"], mine["took"], sensors[code].read_time)
                spent.readings[code] = len(mine)
                seconds = float(took.sum(dtype=np.float64))
                spent.reading += seconds
                spent.took[code] = round(1000.0 * seconds)
        times = np.concatenate((commands["real_time"], movements["real_time"][~movements["answers"]]))
        times = times[np.isfinite(times)]
        spent.between = float(times.max() - times.min()) if len(times) else 0.0
        return spent
