"""The program's side: which sensor or drive explains that program and log do not go together."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from random import Random

import pytest
from msgspec.structs import replace

from simmer_tui.report.belief_audit import heading_jump
from simmer_tui.report.cause_search import disagreements
from simmer_tui.report.causes import Cause, Kind, Sureness
from simmer_tui.report.command_audit import repeated_movements
from simmer_tui.report.finding import Disagreement, kept_disagreements
from simmer_tui.run.events import Belief
from simmer_tui.sim import Pose, parse_command
from simmer_tui.sim.specs import ContactRule, RobotSpec
from tests.report import test_causes
from tests.report.test_causes import Mission, begin

LOOK = ("o3", "g1", "u1", "u2")


def correct(mission: Mission, heading: float, sent: Callable[[float], float], code: str = "r1") -> None:
    """Turn to a heading in a few corrections; the robot gets what is `sent` for what was meant."""
    for _ in range(6):
        off = math.remainder(heading - mission.simulator.pose.heading, 360.0)
        if abs(off) < 0.5 or abs(off) > 120.0:
            return
        mission.give(f"{code}-{sent(off):.2f}", "u1")


def the_cause(mission: Mission) -> Cause:
    cause = mission.why(1, words="failed")
    assert cause is not None
    return cause


# -- corrections ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("share", "said"), [(-1.0, "turned the other way than the program meant"), (3.0, "turned 3.0 times what")]
)
def test_corrections_that_grow_name_their_drive(share: float, said: str) -> None:
    mission = begin(noise=True)
    for around in range(6):
        mission.give("r1-10", "u1")
        correct(mission, mission.simulator.pose.heading + 3.0 * (-1) ** around, lambda off: share * off)
    cause = the_cause(mission)
    assert (cause.kind, cause.culprits, cause.sure) == (Kind.UNDECIDED, ("r1",), Sureness.LIKELY)
    assert f" s on. r1 explains it: r1 {said}" in cause.text


def correct_by(mission: Mission, read: tuple[str, ...], sent: Callable[[float], float]) -> None:
    """Turn to 30 degrees with a look after each turn; the robot gets what is `sent` for what was meant."""
    for _ in range(40):
        off = math.remainder(30.0 - mission.simulator.pose.heading, 360.0)
        mission.give(f"r1-{sent(off):.3f}", *read)


@pytest.mark.parametrize(("read", "culprits"), [(("u1",), ("r1",)), (("g1", "u1"), ("r1", "g1"))])
def test_corrections_that_are_taken_back_name_their_drive_and_what_was_read_of_it(
    read: tuple[str, ...], culprits: tuple[str, ...]
) -> None:
    mission = begin(noise=True)
    correct_by(mission, read, lambda off: 2.0 * off)
    cause = the_cause(mission)
    assert (cause.kind, cause.culprits, cause.sure) == (Kind.UNDECIDED, culprits, Sureness.LIKELY)
    assert "r1 turned twice what the program meant, or more" in cause.text
    assert "corrections each took back the one before" in cause.text
    assert ("g1 reported twice the movement, or more" in cause.text) == ("g1" in culprits)


def test_of_a_path_the_odometers_along_it_are_named() -> None:
    mission = begin(noise=True)
    for step in range(40):
        mission.give(f"d1-{(-1) ** step * (1.0 + 0.03 * step):.2f}", "o1", "o2", "o3", "o4", "g1")
    assert the_cause(mission).culprits == ("d1", "o3", "o4")


def test_movements_along_a_line_may_have_others_between_them() -> None:
    mission = begin((30.0, 42.0, 0.0), noise=True)
    for step in range(20):
        mission.give(f"d1-{5.0 - 0.01 * step:.2f}", "u1", f"r1-{0.5 + 0.01 * step}", "u2")
        mission.give(f"d1--{5.0 - 0.013 * step:.2f}", "u1", f"r1--{0.5 + 0.01 * step}", "w1-0.1", "w1--0.1")
    assert the_cause(mission).culprits == ("d1",)


def test_driving_up_and_back_for_another_try_names_nobody() -> None:
    mission = begin((30.0, 42.0, 0.0), noise=True)
    for step in range(20):
        mission.give(f"d1-{2.0 + 0.01 * step:.2f}", "u1", "d1--2", "u2", "d1-0.5", "u1", "d1--0.6", "u1")
        mission.give(f"d1-{1.0 + 0.01 * step:.2f}", "u1", "d1--0.3", "u2", "d1--0.7", "u1")
    assert not disagreements(mission.attempt)


def test_turns_that_were_sent_in_radians_name_their_drive() -> None:
    mission = begin(noise=True)
    correct_by(mission, ("c1",), math.radians)
    cause = the_cause(mission)
    assert (cause.kind, cause.culprits) == (Kind.UNDECIDED, ("r1",))
    assert re.search(
        r"r1 turned 0\.0\d times what the program meant: \d+ corrections were each 0\.9\d ", cause.text
    )


def test_going_to_and_fro_by_the_same_command_names_nobody() -> None:
    mission = begin(noise=True)
    for step in range(40):
        length = 1.0 + 0.05 * step
        mission.give(f"d1-{length:.2f}", "o3", f"d1--{length:.2f}", "o3")
    assert not disagreements(mission.attempt)


def test_corrections_that_shrink_name_nobody() -> None:
    mission = begin(noise=True)
    for around in range(12):
        correct(mission, 30.0 * around, lambda off: 0.9 * off)
    assert not disagreements(mission.attempt)


def test_turns_of_one_size_name_nobody() -> None:
    mission = begin(noise=True)
    for _ in range(5):
        mission.give(*["r1-7.5", "u1"] * 12, *["r1--15", "u1"] * 6)
    assert not disagreements(mission.attempt)


def test_a_drive_that_is_known_to_be_wrong_is_not_found_again() -> None:
    mission = begin(noise=True)
    for _ in range(6):
        correct(mission, mission.simulator.pose.heading + 3.0, lambda off: -off)
    assert disagreements(mission.attempt)
    assert not disagreements(mission.attempt, {"r1"})


def drive_up(mission: Mission, count: int, repeats: Callable[[int], bool], grows: float = 0.03) -> None:
    """Movements to and fro, each of another length, with a reading between them; some come twice."""
    for step in range(count):
        command = f"d1-{(-1) ** step * (1.0 + grows * step):.2f}"
        mission.give(*[command] * (2 if repeats(step) else 1), "o3")


def test_movements_that_come_twice_in_a_row_are_named() -> None:
    mission = begin(noise=True)
    drive_up(mission, 40, lambda step: step % 4 < 2)
    cause = the_cause(mission)
    assert (cause.kind, cause.culprits, cause.sure) == (Kind.UNDECIDED, ("d1",), Sureness.LIKELY)
    assert "20 of 60 movements were the one before again, with nothing between, such as d1-1" in cause.text


@pytest.mark.parametrize(
    ("repeats", "grows"), [(lambda step: True, 0.03), (lambda step: step < 20, 0.0)], ids=["halves", "steps"]
)
def test_who_always_drives_in_two_parts_or_in_equal_steps_means_it(
    repeats: Callable[[int], bool], grows: float
) -> None:
    mission = begin(noise=True)
    drive_up(mission, 40, repeats, grows)
    assert not repeated_movements(mission.attempt)


def test_who_drives_in_two_parts_between_single_turns_means_it() -> None:
    mission = begin(noise=True)
    for step in range(30):
        drive = f"d1-{(-1) ** step * (0.5 + 0.01 * step):.2f}"
        mission.give(f"r1-{(-1) ** step * (3.0 + 0.1 * step):.1f}", drive, drive, "u1")
    assert not repeated_movements(mission.attempt)


def test_few_sizes_of_movements_are_the_same_twice_by_chance() -> None:
    mission = begin(noise=True)
    random = Random(1)
    for step in range(120):
        sizes = (random.choice((0.5, 0.6, 0.7, 0.8, 0.9, 1.0)) for _ in range(2))
        turn = f"r1-{random.randint(-9, 9)}"
        mission.give("u1", *(f"d1-{(-1) ** step * size}" for size in sizes), turn)
    assert not repeated_movements(mission.attempt)


# -- movements that no longer come --------------------------------------------------------------------


def drive_on(mission: Mission, count: int, reaches: Callable[[str], bool] = lambda command: True) -> None:
    """Movements to and fro and half as many turns, each looked at afterwards; some do not reach the robot."""
    for step in range(count):
        for command in (f"d1-{2 * (-1) ** step}", *(("r1-5",) if step % 2 else ())):
            if reaches(command):
                mission.give(command)
            mission.give(*LOOK)


def test_a_drive_whose_commands_no_longer_come_is_named() -> None:
    mission = begin(noise=True)
    drive_on(mission, 8)
    began = mission.history.line
    drive_on(mission, 12, lambda command: command.startswith("r1"))
    cause = the_cause(mission)
    assert (cause.kind, cause.culprits) == (Kind.NOT_CARRIED_OUT, ("d1",))
    assert "no d1 reached the robot any more" in cause.text
    assert cause.line >= began


def test_where_all_movements_are_gone_none_is_named() -> None:
    mission = begin(noise=True)
    drive_on(mission, 8)
    drive_on(mission, 12, lambda command: False)
    cause = the_cause(mission)
    assert (cause.kind, cause.culprits) == (Kind.NOT_CARRIED_OUT, ())
    assert "no movement reached the robot any more" in cause.text


@pytest.mark.parametrize("instead", ["d1-2,5", "d1-0"])
def test_a_drive_whose_commands_come_without_effect_is_not_gone(instead: str) -> None:
    mission = begin(noise=True)
    drive_on(mission, 8)
    for step in range(12):
        mission.give(instead, *LOOK, *(("r1-5", *LOOK) if step % 2 else ()))
    assert not disagreements(mission.attempt)


def test_in_packets_a_question_for_the_end_of_a_lost_movement_is_none() -> None:
    mission = begin(noise=True)
    for step in range(20):
        mission.give(*((f"d1-{2 * (-1) ** step}",) if step < 12 else ()), "d1-0", *LOOK)
    assert "no d1 reached the robot any more" in the_cause(mission).text


def test_who_asks_for_the_end_of_movements_while_it_reads_loses_none() -> None:
    mission = begin(noise=True)
    for step in range(40):
        mission.give(f"d1-{2 * (-1) ** step}" if step < 20 else "r1-5")
        for code in LOOK:
            if step < 20:
                mission.ask_while_moving("d1-0")
            mission.give(code)
    assert not disagreements(mission.attempt)


def test_reading_one_sensor_on_and_on_is_another_rhythm() -> None:
    mission = begin(noise=True)
    drive_on(mission, 12)
    mission.give(*["u1"] * 100, *["o3", "u2"] * 50)
    assert not disagreements(mission.attempt)


def test_a_program_that_gives_no_turn_for_a_while_is_well() -> None:
    mission = begin(noise=True)
    drive_on(mission, 8)
    for step in range(20):
        mission.give(f"d1-{2 * (-1) ** step}", *LOOK)
    assert not disagreements(mission.attempt)


# -- of several ---------------------------------------------------------------------------------------


def made(code: str, probability: float, scatter: float = 1.0) -> Disagreement:
    return Disagreement((code,), f"{code} is off", 20, probability, scatter, 1.0, 1)


def test_of_explanations_of_the_same_those_as_good_as_the_best_are_kept() -> None:
    [found] = kept_disagreements([[made("g1", 1e-9, 1.0), made("r1", 1e-9, 1.2), made("o3", 1e-9, 2.0)]])
    assert [each.of for each in found] == [("g1",), ("r1",)]


def test_all_together_hold_an_error_of_one_in_a_hundred() -> None:
    assert kept_disagreements([[made("u1", 0.004)], [made("u2", 0.5)]])
    assert not kept_disagreements([[made("u1", 0.006)], [made("u2", 0.5)]])


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
        self.swallows, self.spread = "", 0.3
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
        if code != self.swallows:
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
        self.mission.engine.tell(Belief(simulator.time, self.pose, simulator.pose, self.spread))

    def wander(self, rounds: int = 12) -> None:
        for step in range(rounds):
            self.move("r1", 20.0 + step if step % 2 else -19.0 - step)
            self.move("d1", 2.0 if step % 4 < 2 else -2.0)


def culprits(mission: Mission) -> set[str]:
    return {code for one in disagreements(mission.attempt)[0] for code in one.of}


def test_counters_that_are_believed_as_they_are_logged_name_nobody() -> None:
    mission = begin(noise=True)
    DeadReckoner(mission).wander()
    assert not disagreements(mission.attempt)


@pytest.mark.parametrize("gain", [0.8, -1.0])
def test_a_gyro_whose_replies_are_taken_as_something_else_is_named(gain: float) -> None:
    mission = begin(noise=True)
    DeadReckoner(mission, lambda code, reply: gain * reply if code == "g1" else reply).wander()
    cause = the_cause(mission)
    assert cause.kind is Kind.UNDECIDED
    assert cause.culprits[0] == "g1"
    assert re.search(rf"the program used {gain:.2f} times g1's replies in the log \(", cause.text)


def test_wheels_whose_replies_are_taken_for_less_are_named() -> None:
    mission = begin(noise=True)
    DeadReckoner(mission, lambda code, reply: 0.6 * reply if code in ("o3", "o4") else reply).wander(24)
    assert {"o3", "o4"} >= culprits(mission)


def test_a_program_that_goes_by_its_commands_names_the_drive() -> None:
    mission = begin(noise=True)
    DeadReckoner(mission, by_commands=lambda code, value: -value if code == "r1" else value).wander()
    cause = the_cause(mission)
    assert (cause.kind, cause.culprits) == (Kind.UNDECIDED, ("r1",))
    assert "the program used -1.0" in cause.text


def test_a_belief_that_moves_though_nothing_came_says_that_its_command_was_lost() -> None:
    mission = begin(noise=True)
    program = DeadReckoner(mission, by_commands=lambda code, value: value)
    program.wander()
    assert not disagreements(mission.attempt)
    program.swallows = "r1"
    program.wander()
    cause = the_cause(mission)
    assert (cause.kind, cause.culprits) == (Kind.NOT_CARRIED_OUT, ("r1",))
    assert "12 times the program believed that the robot had turned, with nothing read" in cause.text


def test_a_heading_that_is_not_the_compasss_from_the_first_belief_on_names_it() -> None:
    mission = begin(noise=True)
    mission.give(*["c1"] * 12)
    program = DeadReckoner(mission)
    program.pose = Pose(program.pose.x, program.pose.y, program.pose.heading + 90.0)
    program.tell()
    program.wander()
    cause = the_cause(mission)
    assert cause.culprits == ("c1",)
    assert "deg more than c1's replies in the log (12 readings)" in cause.text


def test_a_heading_that_jumps_in_one_movement_names_what_turned_and_what_was_read() -> None:
    mission = begin(noise=True)
    program = DeadReckoner(mission, lambda code, reply: reply % 256.0 if code == "g1" else reply)
    program.spread = 2.0
    for turn in (*(30.0,) * 9, 20.0, -10.0, 1.0):
        program.move("r1", turn)
    cause = the_cause(mission)
    assert (cause.kind, cause.culprits) == (Kind.UNDECIDED, ("r1", "g1"))
    assert re.search(r"in r1-30 the robot turned by 30 deg, and its belief by 134 deg", cause.text)
    assert re.search(r"g1 went from 2[34]\d to 2[67]\d deg then", cause.text)


def test_a_person_who_turned_the_robot_is_no_jump_of_its_program() -> None:
    mission = begin(noise=True)
    for turn in (0.0, -90.0, -90.0):
        mission.give("g1", "u1")
        mission.believe(turn=turn)
        if not turn:
            mission.give("r1-90", source="keys")
    assert not disagreements(mission.attempt)


def jumped(mission: Mission, *commands: str, typed: str = "") -> list[Disagreement]:
    """The jump of a program that believes in a turn by 90 deg more than there was."""
    mission.give("g1", "u1")
    mission.believe()
    mission.give(*commands)
    mission.give(*filter(None, [typed]), source="keys")
    mission.give("g1", "u1")
    for _ in range(3):
        mission.believe(turn=90.0)
    return heading_jump(mission.attempt)


def test_a_turn_that_a_wall_stopped_is_no_jump(monkeypatch: pytest.MonkeyPatch) -> None:
    assert jumped(begin(), "r1-90")
    robot = RobotSpec.rectangle(8.0, 4.0)
    spec = replace(test_causes.SET.simulation, robot=robot, contact=ContactRule.STOP)
    monkeypatch.setattr(test_causes, "SET", replace(test_causes.SET, simulation=spec))
    assert not jumped(begin((30.0, 45.5, 0.0), contacts=3), "r1-90")


@pytest.mark.parametrize(
    ("commands", "typed"),
    [(("r1-1",), "r1-90"), (("vv-0;0;90", "wt-1", "vv-0;0;0", "r1-1"), "")],
    ids=["a person", "a velocity"],
)
def test_who_turned_by_something_else_as_well_has_no_jump(commands: tuple[str, ...], typed: str) -> None:
    assert not jumped(begin(), *commands, typed=typed)


def test_a_filter_that_gives_up_its_place_has_no_jump() -> None:
    mission = begin(noise=True)
    for turn, spread in ((0.0, 0.3), (0.0, 0.3), (90.0, 8.0), (90.0, 0.3), (90.0, 0.3)):
        mission.give("r1-30", "g1", "u1")
        mission.believe(turn=turn, spread=spread)
    assert not disagreements(mission.attempt)


def test_a_start_taken_for_granted_is_not_the_compasss_fault() -> None:
    mission = begin(noise=True)
    mission.give(*["c1"] * 12)
    program = DeadReckoner(mission)
    program.pose = Pose(program.pose.x + 24.0, program.pose.y + 12.0, program.pose.heading + 90.0)
    program.tell()
    program.wander()
    assert not disagreements(mission.attempt)


def test_a_belief_that_is_told_over_and_over_names_nobody() -> None:
    mission = begin(noise=True)
    program = DeadReckoner(mission, by_commands=lambda code, value: 0.0)
    program.wander()
    assert not disagreements(mission.attempt)


# -- replies of range sensors ---------------------------------------------------------------------------


def look_along(mission: Mission, back: float, codes: tuple[str, ...] = ("u1",)) -> None:
    """Go along a corridor, read, and believe to be so far behind the true place."""
    for step in range(30):
        mission.give(f"d1-{0.4 if step % 10 < 6 else -0.5}", *codes)
        mission.believe(ahead=-back)


def test_a_range_that_is_taken_for_longer_is_named_with_how_much() -> None:
    mission = begin(noise=True)
    look_along(mission, 3.0)
    cause = the_cause(mission)
    assert (cause.kind, cause.culprits) == (Kind.UNDECIDED, ("u1",))
    assert re.search(
        r"used (2\.[89]|3\.[01]) in more \(.* to .*\) than the replies of u1 in the log \(\d+ of 30",
        cause.text,
    )


def test_a_range_that_is_taken_for_longer_from_a_moment_on_is_named_from_there() -> None:
    mission = begin(noise=True)
    look_along(mission, 0.0)
    since = mission.simulator.time - 50.0
    look_along(mission, 3.0)
    cause = the_cause(mission)
    assert (cause.kind, cause.culprits) == (Kind.UNDECIDED, ("u1",))
    assert cause.elapsed >= since


def test_ranges_that_fit_the_beliefs_name_nobody() -> None:
    mission = begin(noise=True)
    look_along(mission, 0.0, ("u1", "u2", "u3", "u4"))
    assert not disagreements(mission.attempt)


def test_a_belief_that_no_change_of_replies_explains_cannot_be_told_apart() -> None:
    mission = begin(noise=True)
    for step in range(30):
        mission.give(f"d1-{0.4 if step % 10 < 6 else -0.5}", "u1", "u3")
        mission.believe(ahead=5.0 * math.sin(3.7 * step * step), turn=60.0 * math.cos(2.3 * step * step))
    assert not disagreements(mission.attempt)
    cause = the_cause(mission)
    assert (cause.kind, cause.culprits) == (Kind.UNDECIDED, ())


def test_a_real_robots_log_says_nothing_of_where_it_was() -> None:
    mission = begin(noise=True)
    look_along(mission, 3.0)
    mission.history.is_twin = True
    assert not disagreements(mission.attempt)
