"""Missions: a run planned from its seed, and the referee, which judges the goals.

    configuration, plan = plan_run(load(find_set("mission")), seed=7)
    simulator = Simulator(configuration.simulation, 7)
    reducer = Reducer(checkpoint_of(simulator, mission=True))
    referee = Referee(plan, reducer, tell)

The referee reads a run's events and its state, live or from a log, and nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from msgspec.structs import replace

from simmer_tui.config.loader import Configuration
from simmer_tui.config.mission_plan import Cell, MissionPlan, contacts_rule, draw_mission
from simmer_tui.config.mission_toml import FILE
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.run.events import (
    ActionDone,
    Event,
    EventHandler,
    Goal,
    LegEnded,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Result,
    goals_of,
)
from simmer_tui.run.phrases import contacts_text, obstacles_text
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import MissionProgress, State, TimeSpent
from simmer_tui.sim.command import counted
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.path import Contact
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import CommandResult

__all__ = ["Cell", "MissionPlan", "MissionState", "Referee", "environment", "facts", "plan_run", "planned"]


class MissionRule(StrEnum):
    """Rules of a mission; a run that breaks one fails."""

    CONTACTS = "contacts"
    TIME_LIMIT = "time limit"


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionState:
    """A mission at a moment, or at its end: the record of a run.

    `goals` holds each goal that it asks for, with the simulated time at which it was met, or None.
    `reason` says why it failed. `time` is simulated seconds, at most the time limit; `distance` is
    in inches, `spent` the simulated time by purpose. `contact_points` are the places where walls were
    touched, `pose` is the robot's. `helped` is true if a person put robot or block elsewhere, or took errors
    away.
    """

    plan: MissionPlan
    result: Result
    reason: str
    goals: dict[Goal, float | None]
    time: float
    distance: float
    commands: int
    contacts: int
    spent: TimeSpent
    contact_points: tuple[tuple[float, float], ...]
    pose: Pose
    holding: bool
    helped: bool

    @property
    def over(self) -> bool:
        """True if the mission has ended."""
        return self.result is not Result.UNDER_WAY

    @property
    def broken(self) -> MissionRule | None:
        """The rule that the run has broken; None if it succeeded, or kept all of them up to now."""
        allowed = self.plan.contacts
        if self.result is Result.SUCCESS:
            return None
        if allowed is not None and self.contacts > allowed:
            return MissionRule.CONTACTS
        return MissionRule.TIME_LIMIT if self.time >= self.plan.time_limit else None

    @property
    def time_left(self) -> float:
        """Simulated seconds until the time limit."""
        return max(self.plan.time_limit - self.time, 0.0)


def mission_state(plan: MissionPlan, state: State) -> MissionState:
    """The mission at the moment of a state."""
    progress = state.mission or MissionProgress()
    goals = {goal: progress.goals[goal] for goal in goals_of(plan)}
    done = list(goals.values())[-1]
    sums = progress.end or state
    return MissionState(
        plan=plan,
        result=progress.result,
        reason=progress.reason,
        goals=goals,
        time=min(sums.time, plan.time_limit) if done is None else done,
        distance=sums.distance,
        commands=sums.commands,
        contacts=sums.contacts,
        spent=sums.spent,
        contact_points=state.contact_points,
        pose=state.pose,
        holding=state.holding,
        helped=progress.helped or not state.noise,
    )


def plan_run(configuration: Configuration, seed: int | None = None) -> tuple[Configuration, MissionPlan]:
    """One run of a set's mission: the plan, and the configuration with its start and its block.

    The run has `seed`, by default as the settings say, and the configuration returned repeats it: a
    run log of it can be run again. Raises ConfigurationError if the set has no mission or drives a
    real robot.
    """
    settings = configuration.settings
    if configuration.mission is None:
        what = (
            f"has no {FILE}, which defines a mission; simmer-tui init DIR --mission writes a set that "
            "has one, and the bundled set is called mission"
        )
        raise ConfigurationError([Problem(configuration.name, what)])
    if not settings.sim:
        raise ConfigurationError([Problem("--mission", "is for the simulated robot; leave out --serial")])
    if seed is None:
        seed = settings.run_seed()
    plan = draw_mission(configuration.mission, configuration.simulation, seed)
    return planned(configuration, plan, seed), plan


def planned(configuration: Configuration, plan: MissionPlan, seed: int) -> Configuration:
    """A configuration with the start and the block of a plan, for a run of this seed."""
    start = plan.start
    at = {"bot_center": (start.x, start.y), "bot_rot": start.heading, "block_center": plan.block}
    return replace(
        configuration,
        simulation=replace(configuration.simulation, **at),
        settings=replace(configuration.settings, **at, randerror=False, seed=seed),
    )


def environment(plan: MissionPlan, gripper: str) -> dict[str, str]:
    """Variables for a control program: `SIMMER_DROP_ZONE` (the middle of the cell, `30,18`),
    `SIMMER_LOADING_ZONE` (the middles of its cells, `66,6;78,6`), `SIMMER_TIME_LIMIT` (simulated seconds),
    `SIMMER_GRIPPER` (its code) and, if mission.toml gives it, `SIMMER_START` (`9.5,42.0,0.0`: x, y,
    heading)."""
    known = {
        "SIMMER_DROP_ZONE": _middle(plan.drop_zone),
        "SIMMER_LOADING_ZONE": ";".join(map(_middle, plan.loading_zone)),
        "SIMMER_TIME_LIMIT": f"{plan.time_limit:g}",
        "SIMMER_GRIPPER": gripper,
    }
    if plan.start_known:
        known["SIMMER_START"] = f"{plan.start.x!r},{plan.start.y!r},{plan.start.heading!r}"
    return known


def _middle(cell: Cell) -> str:
    return f"{cell.x:g},{cell.y:g}"


def facts(plan: MissionPlan, gripper: str) -> tuple[float, ...]:
    """The answer to a query (`protocol/mission_query.py`): the same as `environment`, as numbers.

    Drop zone x and y, time limit, the two characters of the gripper's code as 256 * first + second, start x,
    y and heading (NaN if the robot has to find them), and x and y of each cell of the loading zone.
    """
    start = plan.start
    first, second = gripper.encode("latin-1", "replace")
    return (
        *(plan.drop_zone.x, plan.drop_zone.y, plan.time_limit, 256.0 * first + second),
        *((start.x, start.y, start.heading) if plan.start_known else (math.nan,) * 3),
        *(place for cell in plan.loading_zone for place in (cell.x, cell.y)),
    )


class Referee(EventHandler[bool]):
    """Judges a mission by the state of its run: tells an event for each goal met, and for the end.

    It looks at the run after the reducer has applied an event. The mission restarts with the run (reset,
    another seed); start, block and drop zone stay those of the plan. A mission that is over keeps its result.
    All methods run in the thread that tells the events.
    """

    def __init__(
        self, plan: MissionPlan, reducer: Reducer, tell: Callable[[MissionEvent], None] | None = None
    ) -> None:
        """`tell` passes the referee's events to all watchers, the reducer among them; by default to the
        reducer alone."""
        self.plan = plan
        self._reducer = reducer
        self._tell = tell or reducer.apply
        self._final: MissionState | None = None
        self._touched: dict[bool, Contact] = {}
        """The last contact with the block (True) and with a wall, since the restart."""
        self._met: dict[Goal, float] = {}
        """The goals that this referee told of, since the restart: the reducer gets their events later."""
        self._last = goals_of(plan)[-1]
        """The goal that ends the mission."""

    @property
    def result(self) -> Result:
        """The current result. May be read from any thread."""
        return self._reducer.mission.result

    def limit_after(self, now: float) -> float:
        """The next simulated time, from `now` on, after which a goal is too late; infinite if there is none.
        `check` then has to be called, since no event may come at that time."""
        limit = self.plan.time_limit
        return limit if now <= limit else math.inf

    def begin(self) -> None:
        """Announce the plan."""
        plan, start = self.plan, self.plan.start
        self._say(
            self._reducer.at().time,
            Result.UNDER_WAY,
            f"start ({start.x:g}, {start.y:g}) heading {start.heading:g}, "
            f"block ({plan.block[0]:.2f}, {plan.block[1]:.2f}), drop zone ({plan.drop_zone.x:g}, "
            f"{plan.drop_zone.y:g}), {plan.time_limit:g} s, {contacts_rule(plan.contacts)}",
        )

    def watch(self, event: Event) -> None:
        """Judge the run after an event that the reducer has applied."""
        # Events that this one has led to reach the reducer later: nothing is judged twice.
        if not self.handle(event):
            self.check()

    def other(self, event: Event) -> bool:
        return False

    def on_result(self, event: CommandResult) -> bool:
        return False  # nearly every event

    def on_mission(self, event: MissionEvent) -> bool:
        return True

    def on_action(self, event: ActionDone) -> bool:
        if event.restarts:
            self._final = None
            self._touched.clear()
            self._met.clear()
        return False

    def on_planned(self, event: MovementPlanned) -> bool:
        grip = event.grip
        if grip is None or self._final is not None or grip.time > self.plan.time_limit:
            return False
        if grip.holding:
            # The block starts in the loading zone: a robot that holds it must have reached the zone.
            self._meet(Goal.REACHED, grip.time)
            self._meet(Goal.TAKEN, grip.time)
            return True
        if self._reducer.let_go and self.plan.drop_zone.holds(grip.block.x, grip.block.y):
            self._meet(Goal.DELIVERED, grip.time)
            return True
        return False

    def on_ended(self, event: MovementEnded) -> bool:
        path = event.trajectory.trail(event.time).tolist()
        self._note(event.contact)
        if self._final is not None or event.time > self.plan.time_limit or self._too_many_contacts():
            return False
        return self._reach(path, event.time)

    def on_leg_ended(self, event: LegEnded) -> bool:
        # Zone, contact and time limit in the order in which they came: a contact is at a leg's end.
        self._enter(event.leg, event.time)
        self._note(event.contact)
        if self._final is None and event.time <= self.plan.time_limit:
            self._too_many_contacts()
        return event.time <= self.plan.time_limit

    def _enter(self, leg: Leg, now: float) -> None:
        """Check whether a leg leads into the loading zone by a simulated time."""
        if self._final is not None or self._reducer.mission.goals[Goal.REACHED] is not None:
            return
        entered = [
            leg.start_time + seconds
            for cell in self.plan.loading_zone
            if (seconds := leg.arc.seconds_in_box(*cell.corners)) is not None
        ]
        first = min(entered, default=math.inf)
        if first <= min(now, leg.end_time, self.plan.time_limit):
            self._meet(Goal.REACHED, first)

    def check(self, now: float | None = None) -> None:
        """Judge contacts, the robot's place and the time at a simulated time, by default that of the last
        event. In real time, where time passes without events, call it regularly."""
        # Contacts first: a goal met in the same movement as one contact too many does not count.
        if self._final is not None or self._too_many_contacts():
            return
        # Time passes without commands too: `now` may be later than any event.
        now = self._reducer.time if now is None else now
        leg = self._reducer.leg
        if leg is not None:
            self._enter(leg, now)
        if now > self.plan.time_limit:
            # While the robot drives, its place at that time counts, whenever this is called.
            at = now if leg is None else self.plan.time_limit
            self._end(Result.FAILED, f"the time limit of {self.plan.time_limit:g} s", at)
        elif leg is None:
            pose = self._reducer.pose_at(now)
            self._reach([(pose.x, pose.y)], now)

    def end(self, reason: str, now: float | None = None) -> None:
        """Fail the mission, unless it is over: nobody drives the robot any more. Without a time, simulated
        seconds, it ends with its last event."""
        if self._final is None:
            self._end(Result.FAILED, reason, self._reducer.time if now is None else now)

    def state(self, now: float | None = None) -> MissionState:
        """The mission at a simulated time, or at its end."""
        return self._final or mission_state(self.plan, self._reducer.at(now))

    # -- internal ------------------------------------------------------------------------------

    def _too_many_contacts(self) -> bool:
        allowed, contacts = self.plan.contacts, self._reducer.contacts
        if allowed is None or contacts <= allowed:
            return False
        touched = obstacles_text(self._touched.values())
        reason = f"{contacts_text(contacts)} with {touched}, {allowed} allowed"
        self._end(Result.FAILED, reason, self._reducer.time)
        return True

    def _note(self, contact: Contact | None) -> None:
        if contact is not None:
            self._touched[contact.cell is None] = contact

    def _reach(self, path: list[tuple[float, float]], now: float) -> bool:
        """True if one of these places is in the loading zone, and none was before."""
        if self._reducer.mission.goals[Goal.REACHED] is not None:
            return False
        # A loop, not any(): this runs for each event, and a generator costs more than the comparisons.
        for x, y in path:
            for cell in self.plan.loading_zone:
                if cell.holds(x, y):
                    self._meet(Goal.REACHED, now)
                    return True
        return False

    def _meet(self, goal: Goal, time: float) -> None:
        """A goal is met at a simulated time; the last one ends the mission."""
        if self._reducer.mission.goals[goal] is None:
            self._met[goal] = time
            self._say(time, goal, f"{goal.value} at {time:.1f} s")
            if goal is self._last:
                self._end(Result.SUCCESS, "", time)

    def _end(self, result: Result, reason: str, now: float) -> None:
        """End the mission at a simulated time."""
        state = self._reducer.at(now)
        progress = state.mission or MissionProgress()
        goals = {**progress.goals, **self._met}
        progress = replace(progress, result=result, reason=reason, goals=goals)
        final = self._final = mission_state(self.plan, replace(state, mission=progress))
        why = f": {reason}" if reason else ""
        self._say(
            final.time,
            result,
            f"{result.value} after {final.time:.1f} s, {final.distance:.1f} in, "
            f"{counted(final.commands, 'command')}, {contacts_text(final.contacts)}"
            f"{', with help' if final.helped else ''}{why}",
            reason,
        )

    def _say(self, time: float, subject: Goal | Result, text: str, reason: str = "") -> None:
        self._tell(MissionEvent(time, subject, f"mission: {text}", reason))
