"""The present attempt of a run: what its history says since it last began anew, until its mission's end."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from simmer_tui.config.loader import Configuration
from simmer_tui.config.mission_plan import Cell, MissionPlan, draw_mission
from simmer_tui.events import MovementEnded, Result
from simmer_tui.run.facts import LastReading
from simmer_tui.run.history_rows import BeliefRow, ContactRow, GripRow, MissionRow, MovementRow
from simmer_tui.run.run_history import RunHistory
from simmer_tui.sim.block import Block
from simmer_tui.sim.path import Contact
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import CELL_SIZE, Axes, DriveKind

ROOM = CELL_SIZE / 2
"""A robot that keeps within this of a place, inches, stays there: half a cell leads nowhere."""


@dataclass(frozen=True, slots=True)
class Task:
    """Limits of a mission, and the cell for the block; None where the cell is not known."""

    contacts: int | None
    time_limit: float
    zone: Cell | None


def task_of(configuration: Configuration, seed: int, plan: MissionPlan | None = None) -> Task | None:
    """The task of a run with a mission under way; None if the configuration has no mission. Without a
    `plan`, as in a log, it is drawn again from the run's seed."""
    if plan is not None:
        return Task(plan.contacts, plan.time_limit, plan.drop_zone)
    mission, settings = configuration.mission, configuration.settings
    if mission is None:
        return None
    drawn = draw_mission(mission, configuration.simulation, seed)
    # A start or block set by hand means that the run was not drawn from the seed: its zone is not known.
    same = (drawn.start.x, drawn.start.y) == settings.bot_center and drawn.block == settings.block_center
    return Task(mission.contacts, mission.time_limit, drawn.drop_zone if same else None)


@dataclass(frozen=True, slots=True)
class Collision:
    """A movement that met something, and all that was known when it began: the newest belief, the one since
    which beliefs had been wrong (`lost`), each sensor's last reading, the block that was held (in the
    robot's frame) or lay about, and the bias."""

    row: ContactRow
    belief: BeliefRow | None
    lost: BeliefRow | None
    readings: Mapping[str, LastReading]
    held: Block | None
    lying: Block
    bias: Mapping[DriveKind, Axes]

    @property
    def ended(self) -> MovementEnded:
        """The movement that met something."""
        return self.row.ended

    @property
    def contact(self) -> Contact:
        """The contact: its place and its time."""
        return self.row.contact


@dataclass(slots=True)
class Dwell:
    """The latest stretch in which the robot kept around one place: since when (elapsed seconds), with how
    many movements, inches and seconds of driving."""

    place: Pose
    since: float
    movements: int = 0
    driven: float = 0.0
    driving: float = 0.0


@dataclass(slots=True)
class Spent:
    """Time spent, simulated seconds; `between` is the real time from an answer to the next
    command: the program's thinking, and the link."""

    driving: float = 0.0
    reading: float = 0.0
    link: float = 0.0
    between: float = 0.0
    readings: Counter[str] = field(default_factory=Counter)


class Attempt:
    """Make one when a question is to be answered: it does not follow what happens afterwards."""

    def __init__(self, history: RunHistory, task: Task | None) -> None:
        self.history = history
        self.task = task
        self.spec = history.spec
        self._began = history.began
        self.over: MissionRow | None = next(
            (row for row in history.missions.items if row.order > self._began and row.event.over), None
        )
        # What comes after a mission's end is not part of the attempt.
        self._until = history.order if self.over is None else self.over.order
        self.elapsed = history.elapsed if self.over is None else self.over.elapsed
        self.line = history.line if self.over is None else self.over.line
        restarts = [row for row in history.actions.items if row.order == self._began]
        self.begun = restarts[-1].elapsed if restarts else history.begun
        placements = [row for row in history.actions.items if row.places and row.order <= self._until]
        self._placed = placements[-1].order if placements else 0
        self._place = (placements[-1].done.pose, placements[-1].elapsed) if placements else (
            history.start, history.begun
        )  # fmt: skip

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
    def commands(self) -> int:
        """Number of commands since the run last began anew."""
        table = self.history.commands
        return table.place_of(self._until + 1) - table.place_of(self._began + 1)

    @cached_property
    def contacts(self) -> int:
        """Number of contacts since the run last began anew."""
        table = self.history.movements
        rows = table.columns(table.place_of(self._began + 1), table.place_of(self._until + 1))
        return int(rows["contact"].sum())

    # -- beliefs and contacts --------------------------------------------------------------------

    def belief_before(self, order: int) -> tuple[BeliefRow | None, BeliefRow | None]:
        """The newest belief before an event, and the first of those that lead to it and were all lost."""
        beliefs = self.history.beliefs
        rows = [
            row for row in beliefs[beliefs.place_of(self._placed + 1) : beliefs.place_of(order)] if row.finite
        ]
        lost = None
        for row in reversed(rows):
            if not row.lost:
                break
            lost = row
        return (rows[-1] if rows else None), lost

    @cached_property
    def beliefs(self) -> tuple[BeliefRow | None, BeliefRow | None]:
        """The last belief, and the first of those that lead to it and were all lost."""
        return self.belief_before(self._until + 1)

    @cached_property
    def collision(self) -> Collision | None:
        """The last contact."""
        history = self.history
        rows = [row for row in history.contacts.items if self._began < row.order <= self._until]
        if not rows:
            return None
        order = rows[-1].order
        belief, lost = self.belief_before(order)
        block = [each for each in history.blocks.items if each.order < order][-1]
        bias = [each for each in history.biases.items if each.order < order][-1].bias
        held = block.block if block.held else None
        return Collision(rows[-1], belief, lost, self._last_readings(order), held, block.block, bias)

    def _last_readings(self, order: int) -> dict[str, LastReading]:
        """The last reading of each sensor before an event, by its code."""
        table = self.history.readings
        begin, end = table.place_of(self._placed + 1), table.place_of(order)
        sensors = table.columns(begin, end)["sensor"]
        found = {}
        for number, code in enumerate(self.history.sensor_codes):
            places = np.flatnonzero(sensors == number)
            if len(places):
                row = table[begin + int(places[-1])]
                found[code] = LastReading(code, row.value, row.true, row.elapsed, row.gone, row.turned)
        return found

    @cached_property
    def blind_for(self) -> tuple[float, float]:
        """Distance (inches) and turning (degrees) since a range sensor was read."""
        movements = self.history.movements
        ranges = {each.code for each in self.spec.sensors if each.kind.is_range}
        # Sums grow all the time, so the newest reading is the one with the largest sums.
        last = [each for code, each in self._last_readings(self._until + 1).items() if code in ranges]
        gone, turned = _sums_at(movements, movements.place_of(self._until + 1))
        if not last:
            before = _sums_at(movements, movements.place_of(self._began))
            return gone - before[0], turned - before[1]
        return gone - max(each.gone for each in last), turned - max(each.turned for each in last)

    @cached_property
    def blocked(self) -> tuple[int, float]:
        """Movements in a row at the end that a contact ended, and since when, elapsed seconds."""
        return self.history.blocked(self._placed, self._until)

    # -- grips -----------------------------------------------------------------------------------

    @cached_property
    def _grips(self) -> list[GripRow]:
        return [row for row in self.history.grips.items if self._began < row.order <= self._until]

    @property
    def misses(self) -> list[GripRow]:
        """The grips that took nothing."""
        return [row for row in self._grips if row.grip.closed and not row.had and not row.grip.holding]

    @property
    def taken(self) -> bool:
        """True if the block has been taken."""
        return any(row.grip.holding for row in self._grips)

    @property
    def put_down(self) -> GripRow | None:
        """The grip that let the block go, if it was not taken again."""
        found = None
        for row in self._grips:
            if row.grip.holding:
                found = None
            elif row.had:
                found = row
        return found

    @property
    def holding(self) -> bool:
        """True if the gripper holds the block."""
        return [each for each in self.history.blocks.items if each.order <= self._until][-1].held

    # -- where time went -------------------------------------------------------------------------

    @cached_property
    def dwell(self) -> Dwell:
        """The stay that lasted until the end: from when the robot last arrived about its place."""
        place, since = self._place
        found = Dwell(place, since)
        movements = self.history.movements
        begin, end = movements.place_of(self._placed + 1), movements.place_of(self._until + 1)
        for row in map(movements.__getitem__, range(begin, end)):
            # The place is where it last arrived, not a mean: a slow drift away does not count as staying.
            if math.hypot(row.x - found.place.x, row.y - found.place.y) > ROOM:
                found = Dwell(row.pose, row.elapsed)
            else:
                found.movements += 1
                found.driven += row.went
                found.driving += row.elapsed - row.begin
        return found

    @cached_property
    def spent(self) -> Spent:
        """Simulated time by what it was spent on."""
        history = self.history
        commands, readings, movements = (
            table.columns(table.place_of(self._began + 1), table.place_of(self._until + 1))
            for table in (history.commands, history.readings, history.movements)
        )
        spent = Spent(float((movements["elapsed"] - movements["begin"]).sum()))
        spent.link = float(commands["link"].sum())
        sensors = {each.code: each for each in self.spec.sensors}
        for number, code in enumerate(history.sensor_codes):
            mine = readings[readings["sensor"] == number]
            if len(mine):
                # A reading that says no time of its own took the configured one.
                took = np.where(mine["took"], mine["took"], sensors[code].read_time)
                spent.readings[code] = len(mine)
                spent.reading += float(took.sum(dtype=np.float64))
        times = np.concatenate((commands["real_time"], movements["real_time"][~movements["answers"]]))
        times = times[np.isfinite(times)]
        spent.between = float(times.max() - times.min()) if len(times) else 0.0
        return spent


def _sums_at(movements: Sequence[MovementRow], place: int) -> tuple[float, float]:
    """Sums of distance and turning before a movement."""
    row = movements[place - 1] if place else None
    return (0.0, 0.0) if row is None else (row.gone, row.turned)
