"""Missions: a run planned from its seed, and the referee who says what has been achieved.

    configuration, plan = plan_run(load(find_set("mission")), seed=7)
    simulator = Simulator(configuration.simulation, 7)
    referee = Referee(plan, simulator)
    referee.watch(simulator.execute("d1-3"))
    referee.state().result

In a `Server` the referee is one of the engine's watchers.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

from simmer_tui.actions import ActionName
from simmer_tui.config.loader import Configuration
from simmer_tui.config.mission_plan import Cell, MissionPlan, draw_mission
from simmer_tui.config.mission_toml import FILE
from simmer_tui.engine import ActionDone, Event, Notice, NoticeKind
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.records import Contact, Grip, Outcome, Pose, Status
from simmer_tui.sim.simulator import Simulator

__all__ = ["Cell", "CheckLine", "Goal", "MissionPlan", "MissionState", "Referee", "Result", "plan_run"]

BEGIN = "begin"
"""The subject of the notice that tells a mission's plan."""
_RESTARTS = (ActionName.RESET, ActionName.SEED)
_HELP = (ActionName.TELEPORT, ActionName.BLOCK, ActionName.BIAS)


class Goal(StrEnum):
    """What is to be achieved, in this order. Taking the block counts as having reached it."""

    REACHED = "loading zone reached"
    TAKEN = "block taken"
    DELIVERED = "block delivered"


class Result(StrEnum):
    """How a mission stands."""

    UNDER_WAY = "under way"
    SUCCESS = "success"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class CheckLine:
    """A line of the checklist: what is asked, whether it is met (None: it is still open), and a
    note such as when."""

    text: str
    met: bool | None
    note: str


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionState:
    """How a mission stood at a moment, or ended: the record of a run.

    `goals` holds the simulated time at which each goal was met, None for those that are not.
    `reason` says why it failed. `time` is simulated seconds, at most the time limit; `distance` is
    in inches. `contact_points` are the places where walls were touched, `pose` is the robot's.
    `helped` tells that a person put robot or block elsewhere, or took errors away.
    """

    plan: MissionPlan
    result: Result
    reason: str
    goals: dict[Goal, float | None]
    time: float
    distance: float
    commands: int
    contacts: int
    contact_points: tuple[tuple[float, float], ...]
    pose: Pose
    holding: bool
    helped: bool

    @property
    def over(self) -> bool:
        return self.result is not Result.UNDER_WAY

    @property
    def time_left(self) -> float:
        """Simulated seconds until the time limit."""
        return max(self.plan.time_limit - self.time, 0.0)

    @property
    def checklist(self) -> tuple[CheckLine, ...]:
        """The goals, then the limits."""
        lost = False if self.result is Result.FAILED else None
        kept = True if self.result is Result.SUCCESS else None
        lines = [
            CheckLine(goal.value, lost if time is None else True, "" if time is None else f"{time:.1f} s")
            for goal, time in self.goals.items()
        ]
        allowed, limit = self.plan.contacts, self.plan.time_limit
        if allowed is not None:
            met = False if self.contacts > allowed else kept
            lines.append(CheckLine(f"{_at_most(allowed)} with a wall", met, str(self.contacts)))
        met = False if lost is False and self.time >= limit else kept
        lines.append(CheckLine(f"within {limit:g} s", met, f"{self.time:.1f} s"))
        return tuple(lines)


def plan_run(configuration: Configuration, seed: int | None = None) -> tuple[Configuration, MissionPlan]:
    """One run of a set's mission: the plan, and the configuration with its start and its block.

    The run has `seed`, by default as the settings say, and the configuration returned repeats it: a
    run log of it can be run again. Raises ConfigurationError if the set has no mission or drives a
    real robot.
    """
    settings = configuration.settings
    if configuration.mission is None:
        what = f"has no {FILE} that says what a mission is; the set that comes along is called mission"
        raise ConfigurationError([Problem(configuration.name, what)])
    if not settings.sim:
        raise ConfigurationError([Problem("--mission", "is for the simulated robot; leave out --serial")])
    if seed is None:
        seed = secrets.randbits(32) if settings.randerror else settings.seed
    plan = draw_mission(configuration.mission, configuration.simulation, seed)
    start, centre = plan.start, (plan.start.x, plan.start.y)
    planned = replace(
        configuration,
        simulation=replace(
            configuration.simulation, bot_center=centre, bot_rot=start.heading, block_center=plan.block
        ),
        settings=replace(
            settings,
            bot_center=centre,
            bot_rot=start.heading,
            block_center=plan.block,
            randerror=False,
            seed=seed,
        ),
    )
    return planned, plan


def environment(plan: MissionPlan) -> dict[str, str]:
    """What a control program may know: `SIMMER_DROP_ZONE` (the middle of the cell, `30,18`),
    `SIMMER_TIME_LIMIT` (simulated seconds) and, if mission.toml gives it, `SIMMER_START`
    (`9.5,42,0`: x, y, heading)."""
    known = {
        "SIMMER_DROP_ZONE": f"{plan.drop_zone.x:g},{plan.drop_zone.y:g}",
        "SIMMER_TIME_LIMIT": f"{plan.time_limit:g}",
    }
    if plan.start_known:
        known["SIMMER_START"] = f"{plan.start.x!r},{plan.start.y!r},{plan.start.heading!r}"
    return known


class Referee:
    """A watcher that follows a mission and tells, as notices, of each goal met and of the end.

    A notice's subject is `BEGIN`, a `Goal` or a `Result`. The mission begins anew when the run does
    (reset, another seed); start, block and drop zone stay those of the plan. Once over it stays as
    it ended. All methods run in the robot's thread.
    """

    def __init__(
        self, plan: MissionPlan, simulator: Simulator, tell: Callable[[Notice], None] = lambda notice: None
    ) -> None:
        self.plan = plan
        self._simulator = simulator
        self._tell = tell
        self._restart()

    def _restart(self) -> None:
        self._goals: dict[Goal, float | None] = dict.fromkeys(Goal)
        self._result = Result.UNDER_WAY
        self._holding = False
        self._helped = False
        self._points: list[tuple[float, float]] = []
        self._coming: Contact | None = None
        """The contact that a movement not yet over is going to have."""
        self._final: MissionState | None = None

    @property
    def result(self) -> Result:
        """How it stands. Any thread may read it."""
        return self._result

    def begin(self) -> None:
        """Tell the plan."""
        plan, start = self.plan, self.plan.start
        allowed = "any number of contacts" if plan.contacts is None else _at_most(plan.contacts)
        self._say(
            BEGIN,
            f"start ({start.x:g}, {start.y:g}) heading {start.heading:g}, "
            f"block ({plan.block[0]:.2f}, {plan.block[1]:.2f}), drop zone ({plan.drop_zone.x:g}, "
            f"{plan.drop_zone.y:g}), {plan.time_limit:g} s, {allowed}",
        )

    def watch(self, event: Event) -> None:
        """Take note of an event."""
        if isinstance(event, ActionDone) and not event.refused:
            if event.action.name in _RESTARTS:
                self._restart()
            self._helped |= event.action.name in _HELP
        elif isinstance(event, Outcome) and self._final is None:
            self._note_contacts(event)
            if self._final is None:
                self._take(event)
        self.check()

    def check(self) -> None:
        """Look at the simulator: contacts, where the robot is, the time. In real time, where time
        goes on by itself, call it now and then."""
        simulator = self._simulator
        if self._final is not None:
            return
        if self._coming is not None and simulator.contacts > len(self._points):
            self._points.append(self._coming.point)
            self._coming = None
        if self._too_many_contacts():
            return
        if simulator.time > self.plan.time_limit:
            self._end(Result.FAILED, f"the time limit of {self.plan.time_limit:g} s")
        elif self._in_loading_zone([(simulator.pose.x, simulator.pose.y)]):
            self._meet(Goal.REACHED, simulator.time)

    def end(self, reason: str) -> None:
        """Fail it, unless it is over: nobody drives the robot any more."""
        if self._final is None:
            self._end(Result.FAILED, reason)

    def state(self) -> MissionState:
        """How it stands now, or how it ended."""
        if self._final is not None:
            return self._final
        return self._state("")

    # -- within --------------------------------------------------------------------------------

    def _note_contacts(self, outcome: Outcome) -> None:
        """Contacts count when the movement is over, as in the simulator. One that was accepted in
        real time may have been stopped before its contact came."""
        contact = outcome.contact if outcome.status is Status.DONE else None
        before = self._simulator.contacts - (contact is not None)
        if self._coming is not None and before > len(self._points):
            self._points.append(self._coming.point)
            self._coming = None
        if contact is not None:
            self._points.append(contact.point)
        if outcome.status is Status.ACCEPTED:
            self._coming = outcome.contact
        self._too_many_contacts()

    def _too_many_contacts(self) -> bool:
        allowed, contacts = self.plan.contacts, self._simulator.contacts
        if allowed is None or contacts <= allowed:
            return False
        self._end(Result.FAILED, f"{_contacts(contacts)} with a wall, {allowed} allowed")
        return True

    def _take(self, outcome: Outcome) -> None:
        if outcome.grip is not None and outcome.grip.time <= self.plan.time_limit:
            self._take_grip(outcome.grip)
        elif outcome.status is Status.DONE and outcome.trajectory is not None:
            end = outcome.trajectory.end_time
            if end <= self.plan.time_limit and self._in_loading_zone(outcome.trajectory.trail(end).tolist()):
                self._meet(Goal.REACHED, end)

    def _take_grip(self, grip: Grip) -> None:
        had, self._holding = self._holding, grip.holding
        if grip.holding:
            self._meet(Goal.REACHED, grip.time)
            self._meet(Goal.TAKEN, grip.time)
        elif had and self.plan.drop_zone.holds(grip.block.x, grip.block.y):
            self._meet(Goal.DELIVERED, grip.time)
            self._end(Result.SUCCESS, "")

    def _in_loading_zone(self, points: list[tuple[float, float]]) -> bool:
        if self._goals[Goal.REACHED] is not None:
            return False
        return any(cell.holds(x, y) for x, y in points for cell in self.plan.loading_zone)

    def _meet(self, goal: Goal, time: float) -> None:
        if self._goals[goal] is None:
            self._goals[goal] = time
            self._say(goal, f"{goal.value} at {time:.1f} s")

    def _end(self, result: Result, reason: str) -> None:
        self._result = result
        self._final = state = self._state(reason)
        why = f": {reason}" if reason else ""
        self._say(
            result,
            f"{result.value} after {state.time:.1f} s, {state.distance:.1f} in, {state.commands} commands, "
            f"{_contacts(state.contacts)}{', with help' if state.helped else ''}{why}",
        )

    def _state(self, reason: str) -> MissionState:
        simulator = self._simulator
        delivered = self._goals[Goal.DELIVERED]
        return MissionState(
            plan=self.plan,
            result=self._result,
            reason=reason,
            goals=dict(self._goals),
            time=min(simulator.time, self.plan.time_limit) if delivered is None else delivered,
            distance=simulator.distance_at(simulator.time),
            commands=simulator.commands,
            contacts=simulator.contacts,
            contact_points=tuple(self._points),
            pose=simulator.pose,
            holding=simulator.holding,
            helped=self._helped or not simulator.noise,
        )

    def _say(self, subject: str, text: str) -> None:
        self._tell(Notice(NoticeKind.MISSION, f"mission: {text}", subject))


def _contacts(count: int) -> str:
    return "no contact" if count == 0 else "1 contact" if count == 1 else f"{count} contacts"


def _at_most(count: int) -> str:
    return f"at most {_contacts(count)}" if count else "no contact"
