"""Beliefs beside the truth: what explains them, and the sensors and drives that are named."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from simmer_tui.report.belief_audit import LEAST_MOVEMENTS
from simmer_tui.report.belief_facts import BeliefFacts
from simmer_tui.run.events import Belief
from simmer_tui.sim import Pose, parse_command
from tests.report.test_causes import Mission, begin

# -- beliefs ------------------------------------------------------------------------------------------


class DeadReckoner:
    """A program that adds up what its gyro and a wheel say, and tells the pose; what it gets of a reply is
    `heard`. With `by_commands` it takes what it asked for."""

    def __init__(
        self,
        mission: Mission,
        heard: Callable[[str, float], float] = lambda code, reply: reply,
        by_commands: Callable[[str, float], float] | None = None,
    ) -> None:
        self.mission, self.heard, self.by_commands = mission, heard, by_commands
        self.spread, self.told_turn = 0.3, 0.0
        self.pose = mission.simulator.pose
        self.counted = self.counters()

    def ask(self, command: str) -> float:
        replies: list[float] = []
        self.mission.engine.session().submit(
            parse_command(command), lambda outcome: replies.append(outcome.reply)
        )
        return self.heard(command[:2], replies[0])

    def counters(self) -> tuple[float, float]:
        return (self.ask("o3") + self.ask("o4")) / 2, self.ask("g1")

    def move(self, code: str, value: float) -> None:
        self.mission.give(f"{code}-{value}")
        if self.by_commands is None:
            now = self.counters()
            gone, turned = now[0] - self.counted[0], now[1] - self.counted[1]
            self.counted = now
        else:
            taken = self.by_commands(code, value)
            gone, turned = (taken, 0.0) if code == "d1" else (0.0, taken)
        middle = math.radians(self.pose.heading + turned / 2)
        x, y = self.pose.x + gone * math.cos(middle), self.pose.y + gone * math.sin(middle)
        self.pose = Pose(x, y, self.pose.heading + turned)
        self.tell()

    def tell(self) -> None:
        simulator = self.mission.simulator
        told = Pose(self.pose.x, self.pose.y, self.pose.heading + self.told_turn)
        self.mission.engine.tell(Belief(simulator.time, told, simulator.pose, self.spread))

    def wander(self, rounds: int = 12) -> None:
        for step in range(rounds):
            self.move("r1", 20.0 + step if step % 2 else -19.0 - step)
            self.move("d1", 2.0 if step % 4 < 2 else -2.0)


def facts(mission: Mission) -> BeliefFacts:
    return BeliefFacts(mission.attempt)


def test_counters_that_are_believed_as_they_were_read_name_nobody() -> None:
    mission = begin(noise=True)
    DeadReckoner(mission).wander()
    assert not facts(mission).steps


@pytest.mark.parametrize("gain", [0.8, -1.0])
def test_a_gyro_whose_replies_are_taken_as_something_else_is_named(gain: float) -> None:
    mission = begin(noise=True)
    DeadReckoner(mission, lambda code, reply: gain * reply if code == "g1" else reply).wander()
    cause = mission.why(1)
    assert cause.culprits[0] == "g1"
    assert f"Its steps fit {gain:.2f} times g1's replies (" in cause.text


def test_a_drive_that_explains_as_much_as_a_counter_is_named_beside_it() -> None:
    # Without noise commands and replies are the same.
    mission = begin()
    DeadReckoner(mission, lambda code, reply: 0.8 * reply if code == "g1" else reply).wander()
    assert set(facts(mission).culprits) == {"g1", "r1"}
    assert "0.80 times g1's replies (" in facts(mission).text


@pytest.mark.parametrize(("count", "names"), [(LEAST_MOVEMENTS - 1, ()), (LEAST_MOVEMENTS, ("g1",))])
def test_of_few_movements_nobody_is_named(count: int, names: tuple[str, ...]) -> None:
    mission = begin(noise=True)
    program = DeadReckoner(mission, lambda code, reply: 0.8 * reply if code == "g1" else reply)
    program.tell()
    program.wander(count)
    assert facts(mission).culprits[:1] == names


def test_headings_that_are_told_in_another_frame_are_no_fault_of_a_counter() -> None:
    mission = begin(noise=True)
    program = DeadReckoner(mission)
    program.told_turn = 180.0
    program.wander(24)
    assert "turned by" in facts(mission).text
    assert not facts(mission).steps
    assert not facts(mission).culprits


def test_wheels_whose_replies_are_taken_for_less_are_named() -> None:
    mission = begin(noise=True)
    DeadReckoner(mission, lambda code, reply: 0.6 * reply if code in ("o3", "o4") else reply).wander(24)
    assert set(facts(mission).culprits) <= {"o3", "o4"}


def test_a_program_that_goes_by_its_commands_names_the_drive() -> None:
    mission = begin(noise=True)
    DeadReckoner(mission, by_commands=lambda code, value: -value if code == "r1" else value).wander()
    assert facts(mission).culprits == ("r1",)
    assert "-1.0" in facts(mission).text


# -- constant errors, and the tables ----------------------------------------------------------------


def look_along(mission: Mission, back: float, codes: tuple[str, ...] = ("u1",)) -> None:
    """Go along a corridor, read, and believe to be so far behind the true place."""
    for step in range(30):
        mission.give(f"d1-{0.4 if step % 10 < 6 else -0.5}", *codes)
        mission.believe(ahead=-back)


def test_ranges_that_fit_the_beliefs_name_nobody() -> None:
    mission = begin(noise=True)
    look_along(mission, 0.0, ("u1", "u2", "u3", "u4"))
    assert not facts(mission).text


def test_a_mirrored_maze_is_told() -> None:
    mission = begin()
    for step in range(12):
        mission.give("u5", f"d1-{2.5 * (-1) ** step}")
        pose = mission.simulator.pose
        there = Pose(96.0 - pose.x, pose.y, 180.0 - pose.heading)
        mission.engine.tell(Belief(mission.simulator.time, there, pose, 0.3))
    assert "mirrored left to right in 100 % of the sure beliefs" in facts(mission).text
