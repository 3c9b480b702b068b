"""Why a run failed: the cause of runs that are made to fail in one way."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from dataclasses import dataclass

import pytest
from msgspec import structs
from msgspec.structs import replace

from simmer_tui.config.loader import Configuration, find_set, load
from simmer_tui.config.mission_plan import Cell, MissionPlan
from simmer_tui.report.cause_search import causes_of
from simmer_tui.report.causes import Cause, Kind, Sureness, contradicted
from simmer_tui.report.contact_causes import NO_BELIEFS, shown_tried
from simmer_tui.report.counterfactuals import Change, Counterfactual, CounterfactualWorld
from simmer_tui.report.finding import Basis, Finding, FindingKind
from simmer_tui.robot.engine import Engine
from simmer_tui.run.attempt import Attempt, Task, task_of
from simmer_tui.run.events import (
    Action,
    ActionName,
    Belief,
    Notice,
    NoticeKind,
    OutputLine,
    ProgramEnded,
    Result,
)
from simmer_tui.run.facts import carried_over, deviation, facing_sensor
from simmer_tui.run.mission import Referee
from simmer_tui.run.phrases import miss_text, outside_text
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.state import checkpoint_of
from simmer_tui.sim import Pose, SensorSpec, Simulator, parse_command
from simmer_tui.sim.specs import Axes, DriveKind

SET = load(find_set("mission"))


@dataclass
class Mission:
    """A mission in this process that begins at 50 s."""

    simulator: Simulator
    engine: Engine
    referee: Referee
    history: RunHistory
    task: Task

    @property
    def attempt(self) -> Attempt:
        return Attempt(self.history, self.task)

    def give(self, *commands: str, source: str = "client") -> None:
        session = self.engine.session()
        for command in commands:
            session.submit(parse_command(command, source), lambda outcome: None)

    def ask_while_moving(self, *commands: str) -> None:
        """Commands that are refused because the robot still moves, as in timed motion."""
        for command in commands:
            refused = self.simulator.refuse(parse_command(command, "client"))
            self.engine.tell(replace(refused, reason="the robot is still moving"))

    def believe(self, ahead: float = 0.0, turn: float = 0.0, spread: float | None = 0.3) -> None:
        pose = self.simulator.pose
        believed = Pose(pose.x + ahead, pose.y, pose.heading + turn)
        self.engine.tell(Belief(self.simulator.time, believed, pose, spread))

    def why(self, code: int = 0, error: str = "", words: str = "") -> Cause:
        self.referee.end(f"the program ended with exit code {code}")
        said = (OutputLine(0.0, words),) if words else ()
        return causes_of(self.attempt, ProgramEnded(0.0, code, error=error, stderr=said))[0]


def begin(
    start: tuple[float, float, float] = (30.0, 42.0, 0.0),
    block: tuple[float, float] = (20.0, 42.0),
    *,
    bias: dict[DriveKind, Axes] | None = None,
    noise: bool = False,
    limit: float = 300.0,
    zone: Cell = Cell(66.0, 42.0),  # noqa: B008 - frozen
    contacts: int = 0,
    change: Callable[[SensorSpec], SensorSpec] = lambda sensor: sensor,
) -> Mission:
    spec = replace(
        SET.simulation,
        bot_center=start[:2],
        bot_rot=start[2],
        block_center=block,
        randbias=False,
        sensors=tuple(change(each) for each in SET.simulation.sensors),
    )
    configuration: Configuration = replace(SET, simulation=spec)
    simulator = Simulator(spec, 3)
    simulator.noise = noise
    simulator.set_bias({kind: Axes() for kind in DriveKind} | (bias or {}))
    simulator.advance(50.0)
    plan = MissionPlan(Pose(*start), False, block, (Cell(18.0, 42.0),), zone, limit, contacts=contacts)
    engine = Engine(simulator)
    history = RunHistory(checkpoint_of(simulator, mission=True))
    reducer = Reducer(checkpoint_of(simulator, mission=True), history=history)
    engine.watch(reducer.apply)
    referee = Referee(plan, reducer, engine.tell)
    engine.watch(referee.watch)
    task = task_of(configuration, 3, plan)
    assert task is not None
    return Mission(simulator, engine, referee, history, task)


def saved(cause: Cause) -> set[Change]:
    return {each.change for each in cause.tried if each.saved}


# -- contacts --------------------------------------------------------------------------------------


def test_a_program_that_drives_at_a_solid_block_drove_at_no_wall(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "SET", replace(SET, simulation=replace(SET.simulation, block_solid=True)))
    mission = begin((30.0, 42.0, 180.0))
    mission.give("u5", "d1-10")
    assert "It drove straight at the block: d1-10 led the robot into the block" in mission.why().text


def test_a_wrong_belief_before_the_contact_is_being_lost() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4", "t1", "u5", "w1-1", "u1")
    mission.believe(ahead=-4.0)
    mission.give("u1", "d1-16.5")
    cause = mission.why()
    assert cause.kind is Kind.LOST
    assert "its belief was off by 4.0 in; its spread was 0.3 in" in cause.text
    assert cause.elapsed == pytest.approx(50.0, abs=3.0)
    assert any("off by 4.0 in" in each for each in cause.evidence)


def test_nothing_saves_a_velocity_straight_at_a_wall() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4", "vv-6;0;0", "wt-10")
    cause = mission.why()
    assert mission.attempt.too_many_contacts
    assert cause.kind is Kind.UNDECIDED
    assert {each.change: each.saved for each in cause.tried} == {Change.ASIDE: False}


def test_drive_errors_of_a_velocity_are_named_where_it_would_have_passed_without_them() -> None:
    # A drive that turns to the left as it goes, in a straight corridor, and nobody looks.
    mission = begin(bias={DriveKind.RIGHT: Axes(0.0, 0.0, 2.5)})
    mission.give("u1", "u2", "u4", "vv-6;0;0", "wt-1", "wt-3")
    cause = mission.why()
    assert cause.kind is Kind.DRIVE_ERROR
    assert cause.culprits == ("vv",)
    assert Change.UNSEEN in saved(cause)


def test_a_velocity_from_where_the_program_believed_to_be() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4")
    mission.believe(ahead=-8.0)
    mission.give("vv-6;0;0", "wt-1.2", "u1", "wt-3")
    cause = mission.why()
    assert cause.kind is Kind.LOST
    assert Change.BELIEVED in saved(cause)


def test_a_velocity_that_grazes_a_corner_came_too_close() -> None:
    # Along the inner wall below, and a little towards it: an inch further up it would have passed.
    mission = begin(start=(27.0, 39.2, -3.0))
    mission.give("u1", "u2", "u4", "vv-6;0;0")
    for _ in range(8):
        mission.give("wt-0.25", "u1", "u2", "u4")
    cause = mission.why()
    assert mission.attempt.too_many_contacts
    assert cause.kind is Kind.CLEARANCE
    assert saved(cause) == {Change.ASIDE}


def test_a_wrong_heading_alone_is_being_lost_too() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4")
    mission.believe(turn=30.0)
    mission.give("r1--30", "d1-11")
    cause = mission.why()
    assert cause.kind is Kind.LOST
    assert "off by 30 deg" in cause.text


def test_lost_is_never_said_where_no_beliefs_were_told() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4", "u5", "t1", "w1-4")
    cause = mission.why()
    assert cause.kind is Kind.CLEARANCE
    assert NO_BELIEFS in cause.evidence
    assert cause.text.startswith("It came too close: w1-4 led the robot into the ")


def test_a_belief_within_what_it_allows_for_is_no_being_lost() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4")
    mission.believe(ahead=-4.0, spread=2.0)
    mission.give("w1-4")
    cause = mission.why()
    assert cause.kind is Kind.CLEARANCE
    assert "It knew where it was" in cause.text


def test_a_program_that_says_it_does_not_know_is_unsure() -> None:
    mission = begin()
    mission.believe(ahead=-4.0, spread=20.0)
    mission.give("u1", "u2", "u4", "d1-16.5")
    assert mission.why().kind is Kind.UNSURE


def test_driving_on_without_looking_is_said() -> None:
    mission = begin()
    mission.give("d1-4", "w1-30")
    cause = mission.why()
    assert cause.kind is Kind.UNREAD
    assert "was not read." in " ".join(cause.evidence)


def test_a_reading_that_was_far_off_is_said_with_what_it_should_have_been() -> None:
    mission = begin((30.0, 42.0, 90.0), change=lambda sensor: replace(sensor, bias=30.0))
    mission.simulator.noise = True
    mission.give("u1", "u5", "t1", "d1-3", "w1-30")
    cause = mission.why()
    assert cause.kind is Kind.MISREAD
    assert " instead of " in cause.text


def test_the_drives_are_to_blame_where_bias_alone_led_there() -> None:
    mission = begin((30.0, 42.0, 0.0), bias={DriveKind.RIGHT: Axes(y=0.6)})
    mission.believe()
    mission.give("u1", "u2", "u4", "d1-10")
    cause = mission.why()
    assert cause.kind is Kind.DRIVE_ERROR
    assert {Change.NO_BIAS, Change.EXACT} <= saved(cause)
    assert "It would have touched nothing without bias" in " ".join(cause.evidence)


def test_a_held_block_that_touches_is_named() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4", "p1-1", "l1")
    assert mission.simulator.holding
    mission.believe()
    mission.give("u1", "r1--90")
    mission.believe()
    mission.give("u1", "d1-2")
    cause = mission.why()
    assert cause.kind is Kind.HELD_BLOCK
    assert cause.text.endswith("though its belief was right.")


def test_no_look_is_missed_where_a_turn_leads_the_held_block_into_a_wall() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4", "p1-1", "l1", "u1", "u2", "u4", "w1--2", *["r1-90"] * 4)
    contact = mission.attempt.collision
    assert contact is not None
    assert contact.contact.held_block
    assert mission.why().kind is Kind.HELD_BLOCK


def test_a_look_is_missed_where_who_turned_the_held_block_into_a_wall_was_lost() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4", "p1-1", "l1", "u1", "u2", "u4", "w1--1", "r1-90", "r1--90")
    mission.believe(ahead=-12.0, turn=-90.0)
    mission.give(*["r1-90"] * 4)
    assert mission.why().kind is Kind.UNREAD


def test_an_inch_to_the_side_is_tried_on_both_sides() -> None:
    mission = begin((30.0, 42.0, 0.0), bias={DriveKind.RIGHT: Axes(y=0.33)})
    mission.give("u1", "u2", "u4", "d1-10")
    assert Change.ASIDE in saved(mission.why())


def test_a_movement_without_its_errors_is_the_one_that_was_asked_for() -> None:
    mission = begin(bias={DriveKind.RIGHT: Axes(0.1, 0.05, 0.2)}, noise=True)
    ended = []
    mission.engine.watch(lambda event: ended.append(event) if hasattr(event, "before") else None)
    mission.give("d1-4")
    movement = next(each for each in ended if hasattr(each, "trajectory"))
    world, bias = CounterfactualWorld(mission.attempt.spec), mission.simulator.bias
    exact = world.asked(movement, bias, Change.EXACT)
    calm = world.asked(movement, bias, Change.NO_NOISE)
    assert exact is not None
    assert calm is not None
    drive = next(each for each in mission.attempt.spec.drives if each.code == "d1")
    asked = 4.0 * drive.gain
    assert (exact.x, exact.y, exact.r) == pytest.approx((asked, 0.0, 0.0))
    assert (calm.x, calm.y, calm.r) == pytest.approx((asked * 1.1, asked * 0.05, asked * 0.2))


# -- ends without a contact ------------------------------------------------------------------------


def test_a_grip_that_takes_nothing_says_by_how_much_and_on_which_side() -> None:
    mission = begin((30.0, 42.0, 180.0), (20.0, 44.0))
    mission.give("u1", "p1-1", "p1-0")
    cause = mission.why(1, words="failed")
    assert cause.kind is Kind.MISSED_GRIP
    assert "the block's middle was 4.00 in too far ahead" in cause.text
    mission = begin((26.0, 44.5, 180.0), (20.0, 42.0))
    mission.give("p1-1", "p1-0", "p1-1")
    cause = mission.why(1)
    assert "closed on nothing twice" in cause.text
    assert "0.50 in too far to the left" in cause.text


def test_a_grip_far_from_the_block_cannot_be_told_from_a_changed_reply() -> None:
    mission = begin((30.0, 42.0, 180.0), (8.0, 44.0))
    mission.give("u1", "u5", "p1-1")
    cause = mission.why(1, words="failed")
    assert (cause.kind, cause.sure, cause.culprits) == (Kind.UNDECIDED, Sureness.LIKELY, ())
    assert "the block's middle was 16.00 in too far ahead" in cause.text
    assert "No reading in the log showed a block there." in cause.text
    mission = begin((30.0, 42.0, 180.0), (8.0, 44.0))
    mission.give("u1", "p1-1")  # u1 looks over the block
    assert mission.why(1, words="failed").kind is Kind.MISSED_GRIP


def test_a_block_dropped_elsewhere_says_how_far_outside() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4", "p1-1", "p1-0")
    cause = mission.why()
    assert cause.kind is Kind.DROPPED_OUTSIDE
    assert "40.0 in to the left of the cell around (66.0, 42.0)" in cause.text
    assert cause.place == pytest.approx((20.0, 42.0))


def test_who_lets_go_though_its_load_sensor_said_that_it_held_disagrees_with_its_log() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4", "p1-1", "l1", "l1", "p1-0")
    cause = mission.why()
    assert (cause.kind, cause.sure, cause.culprits) == (Kind.UNDECIDED, Sureness.LIKELY, ("l1",))
    assert "though l1 had just read that the gripper held it (2 readings)" in cause.text


def test_who_went_on_with_the_block_knew_that_it_held_it() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4", "p1-1", "l1", "d1--2", "p1-0")
    assert mission.why().kind is Kind.DROPPED_OUTSIDE


def test_time_is_told_by_what_it_went_to() -> None:
    mission = begin(limit=60.0, change=lambda sensor: replace(sensor, read_time=0.5))
    for _ in range(25):
        mission.give("u1")
        mission.simulator.advance(max(mission.simulator.time, 50.5 + 0.5 * mission.attempt.commands))
    mission.give("u2", "w1-1", "s1-1")
    cause = mission.why()
    assert cause.kind is Kind.TOO_SLOW
    assert "most of its time went to reading" in cause.text
    assert "(u1 20 times)" in " ".join(cause.evidence)


def test_a_single_reading_was_read_once() -> None:
    mission = begin(limit=60.0)
    mission.give("u1")
    mission.simulator.advance(59.9)
    mission.give("w1-1", "s1-1")
    assert "It read sensors once (u1 once)." in mission.why().evidence


def test_moves_that_gain_nothing_lead_nowhere() -> None:
    mission = begin(limit=100.0)
    mission.give(*("w1-2", "s1-2") * 200)
    cause = mission.why()
    assert cause.kind is Kind.GOT_NOWHERE
    assert "got nowhere" in cause.text


def go_round(mission: Mission, rounds: int, command: str = "d1-0.5") -> None:
    for _ in range(rounds):
        mission.give("u1", command, "r1-90")


def test_a_loop_leads_nowhere_even_where_it_is_ended_by_a_wall() -> None:
    mission = begin()
    mission.give("w1-1", "u2")
    go_round(mission, 21)
    mission.give("d1-40")
    assert mission.why().kind is not Kind.GOT_NOWHERE  # the last movement is none of the loop
    mission = begin()
    mission.give("w1-1", "u2")
    go_round(mission, 21)
    cause = mission.why()
    assert cause.kind is Kind.GOT_NOWHERE
    assert re.search(r"From 5\d\.\d s on, it repeated the same 2 movements 21 times\.", cause.text)


@pytest.mark.parametrize(("rounds", "kind"), [(19, Kind.ENDED), (20, Kind.GOT_NOWHERE)])
def test_a_loop_has_forty_movements(rounds: int, kind: Kind) -> None:
    mission = begin()
    go_round(mission, rounds)
    assert mission.why().kind is kind


def test_turning_on_in_equal_steps_is_looking_around() -> None:
    mission = begin()
    mission.give(*["r1-15", "u1"] * 45)
    assert mission.why().kind is Kind.ENDED


def test_equal_steps_that_lead_further_than_a_cell_are_no_loop() -> None:
    mission = begin()
    mission.give(*["d1-0.58", "u1", "w1-0.01"] * 22)
    assert mission.why().kind is Kind.ENDED


@pytest.mark.parametrize(
    ("code", "error", "words", "kind"),
    [
        (1, "ValueError: math domain error", "", Kind.CRASHED),
        (139, "segmentation fault (SIGSEGV)", "", Kind.CRASHED),
        (1, "", "I give up", Kind.ENDED),
        (0, "", "done", Kind.ENDED),
    ],
)
def test_a_crash_is_told_from_giving_up(code: int, error: str, words: str, kind: Kind) -> None:
    mission = begin()
    mission.give("u1")
    cause = mission.why(code, error, words)
    assert cause.kind is kind
    assert error + words in cause.text


def test_nothing_sent_is_said() -> None:
    assert begin().why().kind is Kind.NOTHING_SENT


def test_a_success_has_no_cause() -> None:
    mission = begin((28.0, 42.0, 180.0), zone=Cell(30.0, 42.0))
    mission.give("d1-4", "p1-1")
    assert not causes_of(mission.attempt)  # under way
    mission.give("a1-9", "p1-0")
    assert mission.referee.state().result is Result.SUCCESS
    assert not causes_of(mission.attempt, ProgramEnded(0.0, 0))


def test_a_gripper_that_was_never_closed_is_said() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4", "u1", "l1", "d1--3", *("r1-90",) * 120)
    cause = mission.why(1, words="failed")
    assert cause.kind is Kind.NOT_CARRIED_OUT
    assert cause.text.startswith("The gripper was never closed: 1 movement ended with the block between")
    assert (cause.sure, cause.culprits) == (Sureness.LIKELY, ("p1",))


def test_who_stood_by_the_block_by_chance_and_came_nowhere_did_not_forget_its_gripper() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4", "u1", "d1--3", *("r1-90",) * 120)
    mission.why(1, words="failed")
    [nowhere] = causes_of(mission.attempt, ProgramEnded(0.0, 1))
    assert nowhere.kind is Kind.GOT_NOWHERE


def test_who_ends_beside_the_block_may_have_been_about_to_close_its_gripper() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4")
    assert mission.why(3).text == "The program ended with exit code 3 before it was done."


def test_who_drove_away_without_the_block_forgot_its_gripper() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4", "d1--14")
    assert mission.why(3).kind is Kind.NOT_CARRIED_OUT


def test_a_gripper_that_opened_without_having_closed_has_not_moved_the_block() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4", "l1", "p1-0", "d1--2", *("r1-90",) * 120)
    assert mission.why(1, words="failed").kind is Kind.NOT_CARRIED_OUT


def test_who_only_reads_until_time_is_up_gets_nowhere() -> None:
    mission = begin(limit=90.0)
    mission.give("w1-1", "u2", *("u1",) * 800)
    assert mission.referee.state().result is Result.FAILED
    cause = causes_of(mission.attempt)[0]
    assert cause.kind is Kind.GOT_NOWHERE
    assert re.fullmatch(
        r"It got nowhere\. From 50\.\d s on, it did not move and read sensors \d+ times \(u1 \d+ times\)\.",
        cause.text,
    )


def test_who_only_reads_and_gives_up_got_nowhere_too() -> None:
    mission = begin(limit=90.0)
    mission.give("w1-1", "u2", *("u1",) * 600)
    cause = mission.why(1, words="failed")
    assert cause.kind is Kind.GOT_NOWHERE
    assert "Then the program gave up (last output: failed)." in cause.evidence


def test_who_ends_as_soon_as_it_knows_where_it_is_was_never_lost() -> None:
    mission = begin()
    for spread in (20.0, 20.0, 20.0, 0.3):
        mission.give("u1", "s1-0.5")
        mission.believe(spread=spread)
    assert mission.why(3).text == "The program ended with exit code 3 before it was done."


def test_who_is_lost_though_its_readings_were_right_disagrees_with_its_log() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4")
    mission.believe()
    mission.give("w1-1", "u1")
    mission.believe(ahead=-4.0)
    mission.give(*["u1", "u2"] * 4)
    mission.why(1, words="failed")
    disagreeing, lost = causes_of(mission.attempt, ProgramEnded(0.0, 1))
    assert (disagreeing.kind, lost.kind) == (Kind.UNDECIDED, Kind.LOST)
    assert re.match(
        r"Program and log disagree: the readings in the log were right, but the pose that the program "
        r"believed was wrong\. "
        r"From 50\.. s on, its belief was off by "
        r"4.0 in; its spread was 0.3 in\. Either the program",
        disagreeing.text,
    )


def test_who_had_looked_only_once_since_it_was_lost_is_just_lost() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4")
    mission.believe()
    mission.give("w1-1", "u1")
    mission.believe(ahead=-4.0)
    mission.give("u1", "u2")
    assert mission.why(1, words="failed").kind is Kind.LOST


def test_who_had_hardly_known_where_it_was_is_unsure() -> None:
    mission = begin()
    for ahead in (9.0, 9.0, 9.0, 9.0, 0.0):
        mission.give("u1", "s1-0.5")
        mission.believe(ahead=ahead)
    cause = mission.why(1, words="failed")
    assert cause.kind is Kind.UNSURE
    assert cause.text == "It seldom knew where it was. Then the program gave up (last output: failed)."


def test_who_never_finds_itself_by_many_right_readings_disagrees_with_its_log() -> None:
    mission = begin()
    for _ in range(20):
        mission.give("u1", "u2", "u3", "u4", "r1-20")
        mission.believe(spread=20.0)
    mission.why(1, words="failed")
    disagreeing, unsure = causes_of(mission.attempt, ProgramEnded(0.0, 1))
    assert (disagreeing.kind, unsure.kind) == (Kind.UNDECIDED, Kind.UNSURE)
    assert "right, but the program seldom knew where it was. Either the program" in disagreeing.text


@pytest.mark.parametrize("error", [0.0, 0.02])
def test_no_echo_is_a_right_reading_where_there_is_none(error: float) -> None:
    def mirrored(sensor: SensorSpec) -> SensorSpec:
        # Headings are 10 degrees and 20 more each time: no ray is within a degree of a face's normal.
        return replace(sensor, error=error, field_of_view=0.0, rays=1, incidence_limit=1.0)

    mission = begin((30.0, 42.0, 10.0), change=lambda each: mirrored(each) if each.kind.is_range else each)
    for _ in range(17):
        mission.give("u1", "u2", "u3", "u4", "u5", "r1-20")
        mission.believe(spread=20.0)
    mission.why(1, words="failed")
    causes = causes_of(mission.attempt, ProgramEnded(0.0, 1))
    assert [each.kind for each in causes] == [Kind.UNDECIDED, Kind.UNSURE]


def test_a_gripper_that_was_never_opened_is_said() -> None:
    mission = begin((28.0, 42.0, 180.0), zone=Cell(18.0, 42.0))
    mission.give("d1-4", "p1-1", "u1")
    assert mission.simulator.holding
    mission.give("d1-1")
    cause = mission.why(1, words="failed")
    assert cause.kind is Kind.NOT_CARRIED_OUT
    assert "never opened: the block was in the drop zone" in cause.text


def test_a_command_that_was_refused_is_said() -> None:
    mission = begin()
    mission.give("u1", "d1-x")
    cause = mission.why(1, words="failed")
    assert cause.kind is Kind.NOT_CARRIED_OUT
    assert cause.text.startswith("d1-x was not carried out: ")
    assert cause.culprits == ("d1",)


@pytest.mark.parametrize("last", [(), ("d1-16",)])
def test_who_is_mostly_refused_got_nowhere_because_of_that(last: tuple[str, ...]) -> None:
    mission = begin()
    mission.give("u1", "d1-1", *("u1", "d1-0,5", "r1-12,5") * 60, *last)
    cause = mission.why(1, words="failed")
    assert (cause.kind, cause.culprits) == (Kind.NOT_CARRIED_OUT, ("d1", "r1"))
    assert re.match(r"120 of 12\d commands to drive were refused from 5\d\.\d s on", cause.text)
    assert "The last was r1-12,5: '12,5' is not a finite decimal number" in cause.text


@pytest.mark.parametrize(
    ("command", "kind"), [("d1-0,5", Kind.NOT_CARRIED_OUT), ("d1-0", Kind.GOT_NOWHERE)], ids=["refused", "0"]
)
def test_commands_without_effect_stand_beside_a_crash(command: str, kind: Kind) -> None:
    mission = begin()
    mission.give(*("u1", command) * 110)
    mission.referee.end("the program ended with exit code 1")
    crashed, other = causes_of(
        mission.attempt, ProgramEnded(0.0, 1, error="LostError: it does not get there")
    )
    assert (crashed.kind, other.kind, other.culprits) == (Kind.CRASHED, kind, ("d1",))


def test_who_was_mostly_refused_before_one_last_movement_is_told_so() -> None:
    mission = begin()
    mission.give("u1", *("u1", "d1-0,5") * 30, "d1-8", *("u1", "d1-0,5") * 3, "d1-16")
    cause = mission.why()
    assert (cause.kind, cause.culprits) == (Kind.NOT_CARRIED_OUT, ("d1",))
    assert cause.text.startswith("33 of 3")


def test_twenty_movements_of_nothing_are_no_search() -> None:
    mission = begin()
    mission.give(*("u1", "d1-0", "u2", "r1-1", "u1", "d1-0") * 11)
    assert (mission.why(1).kind, mission.why(1).culprits) == (Kind.GOT_NOWHERE, ("d1",))


@pytest.mark.parametrize(("between", "told"), [((), True), (("u1",), False)])
def test_a_contact_tells_of_a_command_that_came_twice(between: tuple[str, ...], told: bool) -> None:
    mission = begin((30.0, 42.0, 0.0))
    mission.give("u1", "u2", "u4", "w1-1.37", *between, "w1-1.37", *between, "w1-1.37")
    twice = "The same command came twice in a row, with nothing between: w1-1.37."
    assert (twice in mission.why().evidence) is told


def drive_in_packets(mission: Mission, *commands: str, probe: str = "d1-0", look: bool = False) -> None:
    """Timed movements, each followed by movements of 0 that are refused until it has ended, with `look` after
    a reading each."""
    read = ("u1",) if look else ()
    for command in commands:
        mission.give("u1", command)
        for _ in range(4):
            mission.give(*read)
            mission.ask_while_moving(probe)
        mission.give(*read, probe)


def test_who_asks_in_packets_until_a_movement_has_ended_is_not_mostly_refused() -> None:
    mission = begin()
    drive_in_packets(mission, *("d1-2", "d1--2") * 6, "d1-60")
    assert {each.kind for each in causes_of(mission.attempt)}.isdisjoint((Kind.NOT_CARRIED_OUT, Kind.MOVED))


@pytest.mark.parametrize(("probe", "look"), [("d1-0", False), ("w1-0", False), ("w1-0", True)])
def test_who_asks_in_packets_until_a_movement_has_ended_does_not_ask_for_nothing(
    probe: str, look: bool
) -> None:
    mission = begin()
    commands = "d1-8", *("d1-1.5", "r1-30", "d1--1.5", "r1--30") * 12
    drive_in_packets(mission, *commands, probe=probe, look=look)
    assert not mission.attempt.asked_for_nothing[1]


def test_who_asks_in_packets_until_its_time_is_up_was_too_slow() -> None:
    mission = begin(limit=60.0)
    drive_in_packets(mission, *("d1-5", "d1--5") * 5)
    mission.ask_while_moving("d1-0")
    mission.give(*["wt-1"] * 60)
    assert mission.why(1).kind is Kind.TOO_SLOW


def test_a_command_that_came_too_early_and_never_again_is_told() -> None:
    mission = begin()
    mission.give("u1", "d1-3")
    mission.ask_while_moving("r1-90")
    mission.give("d1-3", "u1")
    cause = mission.why(1)
    assert (cause.kind, cause.culprits) == (Kind.NOT_CARRIED_OUT, ("r1",))
    assert "r1-90 was not carried out: the robot is still moving" in cause.text


def test_commands_of_a_person_or_beside_a_velocity_are_not_mostly_refused() -> None:
    mission = begin()
    mission.give("u1", *("d1-0,5",) * 12, source="console")
    mission.give(*("u1", "d1-0.5") * 9)
    assert mission.why(1).kind is not Kind.NOT_CARRIED_OUT
    mission = begin()
    mission.give(*("u1", "vv-2;0;0", "wt-0.2", "vv--2;0;0", "wt-0.2") * 9, *("d1-0,5",) * 9)
    assert mission.attempt.refused_drives(0.0) == (["d1"], 9, 27)


def test_who_is_refused_now_and_then_failed_for_another_reason() -> None:
    mission = begin()
    mission.give(*("u1", "d1-3", "d1--3", "d1-0,5") * 30)
    assert mission.why(1).kind is Kind.GOT_NOWHERE


def test_commands_that_ask_for_nothing_lead_nowhere() -> None:
    mission = begin()
    mission.give(*("u1", "d1-0", "u2", "w1-0", "u1", "r1-1") * 40)
    cause = mission.why(1)
    assert (cause.kind, cause.culprits) == (Kind.GOT_NOWHERE, ("d1", "w1"))
    assert "80 of them asked for 0 (d1, w1)" in cause.text
    assert (
        "All 120 commands to drive were whole numbers: what is left below 1 is never driven."
        in cause.evidence
    )


def test_a_movement_of_nothing_may_ask_for_the_end_of_another() -> None:
    mission = begin()
    mission.give(*("u1", "d1-2", "d1-0", "u1", "d1--2", "d1-0") * 30)
    assert (mission.why(1).kind, mission.why(1).culprits) == (Kind.GOT_NOWHERE, ())


@pytest.mark.parametrize("commands", [("r1-30", "r1-30"), ("d1-3", "d1--3")])
def test_a_run_that_came_nowhere_is_called_so_however_it_ends(commands: tuple[str, str]) -> None:
    mission = begin()
    mission.give(*commands * 60, "u1", "u2", "u4", "d1-16.5")
    causes = causes_of(mission.attempt)
    assert mission.attempt.too_many_contacts
    assert [each.kind for each in causes] == [Kind.GOT_NOWHERE]
    assert "reached no goal and no new place" in causes[0].text


def test_who_missed_the_block_because_it_was_lost_has_two_causes() -> None:
    mission = begin((30.0, 42.0, 180.0))
    mission.give("u1")
    mission.believe(ahead=-2.0)
    mission.give("p1-1")
    mission.why(1, words="failed")
    missed, lost = causes_of(mission.attempt, ProgramEnded(0.0, 1))
    assert (missed.kind, lost.kind) == (Kind.MISSED_GRIP, Kind.LOST)
    assert "when it closed the gripper" in lost.text


def test_a_sensor_that_is_wrong_comes_before_what_follows_from_it() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4")
    mission.believe(ahead=-4.0)
    mission.give("d1-16.5")
    text = "u1 reads 3.0 in too long (2.9 to 3.1, 395 readings)"
    found = Finding("u1", FindingKind.OFFSET, 3.0, 2.9, 3.1, "in", 395, Basis.NOMINAL, text)
    sensor, lost = causes_of(mission.attempt, findings=[found])
    assert (sensor.kind, sensor.sure, sensor.culprits) == (Kind.SENSOR_WRONG, Sureness.LIKELY, ("u1",))
    assert sensor.text == f"A sensor was wrong: {text}."
    assert lost.kind is Kind.LOST
    both = [found, dataclasses.replace(found, of="u2", text="u2 always reads 9 in")]
    told = causes_of(mission.attempt, findings=both)[0].text
    assert told == f"2 sensors were wrong. {text}. u2 always reads 9 in."
    drive = dataclasses.replace(found, of="d1", text="d1 goes 1.2 times as far")
    assert causes_of(mission.attempt, findings=[drive])[0].kind is Kind.DRIVE_WRONG


# -- what speaks for and against -------------------------------------------------------------------


def test_who_would_have_touched_it_from_where_it_believed_to_be_was_not_lost() -> None:
    """The believed place was free of nothing, and still the program was called lost."""
    mission = begin()
    mission.give("u1", "u2", "u4")
    mission.believe(ahead=-4.0)
    mission.give("w1-4")
    cause = mission.why()
    assert Change.BELIEVED not in saved(cause)
    assert cause.kind is Kind.CLEARANCE


def test_who_allowed_for_its_error_and_touched_because_of_it_did_not_know_where_it_was() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4")
    mission.believe(ahead=-4.0, spread=2.0)
    mission.give("d1-16.5")
    cause = mission.why()
    assert cause.kind is Kind.UNSURE
    assert "off by 4.0 in and 0 deg, as its spread allowed" in cause.text


def test_who_told_a_vague_belief_that_was_right_did_know_where_it_was() -> None:
    mission = begin(bias={DriveKind.RIGHT: Axes(y=0.6)})
    mission.give("u1", "u2", "u4")
    mission.believe(ahead=-0.6, spread=4.0)
    mission.give("d1-10")
    cause = mission.why()
    assert cause.kind is Kind.DRIVE_ERROR
    assert cause.culprits == ("d1",)


def test_errors_that_add_up_unseen_are_the_drives() -> None:
    mission = begin((30.0, 42.0, 0.0), bias={DriveKind.RIGHT: Axes(y=0.22)})
    mission.give("u1", "u2", "u4", *["d1-1"] * 14)
    cause = mission.why()
    assert cause.kind is Kind.DRIVE_ERROR
    assert Change.EXACT not in saved(cause)
    assert Change.UNSEEN in saved(cause)
    assert cause.sure is Sureness.CERTAIN
    assert "Drive errors added up over 14 movements" in cause.text


def test_errors_that_add_up_are_not_to_blame_where_the_program_looks_after_each_movement() -> None:
    mission = begin((30.0, 42.0, 0.0), bias={DriveKind.RIGHT: Axes(y=0.22)})
    mission.give(*["u1", "u2", "u4", "d1-1"] * 14)
    cause = mission.why()
    assert Change.LAST in saved(cause)
    assert cause.kind is Kind.CLEARANCE


def test_a_movement_that_nothing_would_have_saved_is_told_as_such() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4", "u5", "t1", "w1-30")
    cause = mission.why()
    assert (cause.kind, cause.sure) == (Kind.UNDECIDED, Sureness.LIKELY)
    assert not cause.culprits
    assert "the log cannot tell which" in cause.text


def test_a_movement_far_into_the_wall_is_not_too_close_where_nobody_knows_what_was_believed() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4", "u5", "t1", "w1-5.5")
    cause = mission.why()
    assert (cause.kind, cause.culprits) == (Kind.UNDECIDED, ())
    mission = begin()
    mission.believe()
    mission.give("u1", "u2", "u4", "u5", "t1", "w1-5.5")
    assert mission.why().kind is Kind.CLEARANCE


def test_a_wall_that_a_reading_had_shown_is_said_before_coming_too_close() -> None:
    mission = begin()
    mission.give("u2", "d1-1", "u1", "u4", "w1-4.7")
    cause = mission.why()
    assert (cause.kind, cause.culprits) == (Kind.UNDECIDED, ())
    assert re.search(r"u2 had read \d\.\d in there at 50\.\d s, which was right\.", cause.text)
    mission = begin()
    mission.give("u2", "d1-1", "u1", "u4", "w1-3.3")
    assert mission.why().kind is Kind.CLEARANCE


def test_who_asks_for_more_than_was_just_read_straight_ahead_did_not_come_too_close() -> None:
    mission = begin((66.0, 42.0, 180.0))
    mission.give("u1", "d1-3.4")
    cause = mission.why()
    assert cause.kind is Kind.UNDECIDED
    assert re.search(r"u1 had read 3.0 in there", cause.text)


def test_a_wall_that_another_sensor_had_shown_before_a_turn_was_looked_at() -> None:
    mission = begin()
    mission.give("u2")
    mission.believe(spread=10.0)
    mission.give("r1-90", "d1-8")
    mission.why()
    found = causes_of(mission.attempt, ProgramEnded(0.0, 0))
    assert [each.kind for each in found] == [Kind.UNDECIDED]
    assert "u2 had read " in found[0].text


@pytest.mark.parametrize(
    ("kind", "change", "saved", "wrong"),
    [
        (Kind.LOST, Change.BELIEVED, False, True),
        (Kind.LOST, Change.BELIEVED, None, False),
        (Kind.LOST, Change.EXACT, False, False),
        (Kind.HELD_BLOCK, Change.NO_BLOCK, False, True),
        (Kind.DRIVE_ERROR, Change.EXACT, True, False),
        (Kind.DRIVE_ERROR, Change.NO_BIAS, False, True),
        (Kind.CLEARANCE, Change.BELIEVED, True, True),
        (Kind.UNDECIDED, Change.EXACT, True, True),
        (Kind.TOO_SLOW, Change.EXACT, True, False),
    ],
)
def test_what_contradicts_a_cause(kind: Kind, change: Change, saved: bool | None, wrong: bool) -> None:
    assert contradicted(kind, [Counterfactual(change, saved)]) is wrong


# -- facts -----------------------------------------------------------------------------------------


def test_what_is_carried_over_keeps_its_place_beside_the_pose() -> None:
    pose = carried_over(Pose(10.0, 10.0, 0.0), Pose(20.0, 5.0, 90.0), Pose(13.0, 11.0, 30.0))
    assert (pose.x, pose.y, pose.heading) == pytest.approx((19.0, 8.0, 120.0))


def test_particles_say_how_sure_a_heading_is() -> None:
    vague = tuple((0.0, 0.0, float(each)) for each in range(-40, 41, 10))
    told = Belief(1.0, Pose(0, 0, 30), Pose(0, 0, 0), 0.5, vague)
    assert not deviation(told).wrong
    assert deviation(structs.replace(told, particles=((0.0, 0.0, 29.0), (0.0, 0.0, 31.0)))).off_heading


def test_nothing_looks_anywhere_without_sensors() -> None:
    mission = begin()
    mission.give("w1-30")
    met = mission.attempt.collision
    assert met is not None
    assert met.ended.contact is not None
    assert facing_sensor(met.ended.contact, (), {}) is None


def test_words_for_misses() -> None:
    assert miss_text((-0.5, 0.0)) == "the block's middle was 0.50 in too near"
    assert miss_text((0.0, -1.25)) == "the block's middle was 1.25 in too far to the right"
    assert "closed already" in miss_text((0.0, 0.0))
    assert outside_text((0.0, -2.0)) == "2.0 in below"


# -- other people's hands ---------------------------------------------------------------------


def teleport(mission: Mission, x: float, y: float, heading: float) -> None:
    mission.engine.perform(Action(ActionName.TELEPORT, (x, y, heading)))


def test_a_robot_that_a_person_moved_and_that_never_found_out_was_moved_by_a_person() -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    mission.believe()
    teleport(mission, 8.0, 30.0, 90.0)
    mission.engine.tell(Belief(mission.simulator.time, Pose(31, 42, 0), mission.simulator.pose, 0.3))
    mission.give("u1", "d1-60")
    cause = mission.why()
    assert (cause.kind, cause.sure) == (Kind.MOVED, Sureness.LIKELY)
    assert re.match(r"A person moved the robot at [\d.]+ s, by 26 in and 90 deg\. No belief", cause.text)


def test_a_person_who_moved_the_robot_explains_what_followed() -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    teleport(mission, 8.0, 30.0, 90.0)
    mission.give("u1", "d1-5", "d1-60")
    found = causes_of(mission.attempt)
    assert [each.kind for each in found] == [Kind.MOVED]


@pytest.mark.parametrize("source", ["keys", "console"])
def test_a_person_who_drives_beside_the_program_is_named(source: str) -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    mission.believe()
    mission.give("r1-90", source=source)
    mission.believe(turn=-90.0)
    mission.give("u1", "d1-60")
    cause = mission.why()
    assert (cause.kind, cause.sure) == (Kind.MOVED, Sureness.LIKELY)
    assert re.match(r"A person drove the robot beside its program: r1-90 at [\d.]+ s\. No belief", cause.text)


def test_a_person_who_drives_into_a_wall_is_named_whatever_was_believed() -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    mission.believe()
    mission.give("w1-9", source="keys")
    (cause,) = causes_of(mission.attempt)
    assert (cause.kind, cause.sure) == (Kind.MOVED, Sureness.CERTAIN)
    assert "w1-9 led the robot into the maze's outer wall" in cause.text


def test_a_person_who_drives_alone_disturbs_no_program() -> None:
    mission = begin()
    mission.give("u1", "d1-1", source="keys")
    mission.give("u1", "u2", "u4")
    mission.give("w1-9", source="keys")
    assert mission.why().kind is not Kind.MOVED


def connection(mission: Mission, kind: NoticeKind) -> None:
    mission.engine.tell(Notice(kind, f"client 127.0.0.1:4 {kind}", "127.0.0.1:4"))


@pytest.mark.parametrize("gone", [NoticeKind.LEFT, NoticeKind.TAKEN_OVER])
@pytest.mark.parametrize("again", [False, True])
def test_a_person_who_drives_while_no_program_is_connected_disturbs_none(
    gone: NoticeKind, again: bool
) -> None:
    mission = begin()
    connection(mission, NoticeKind.CONNECTED)
    mission.give("u1", "d1-1")
    connection(mission, gone)
    mission.give("d1--1", source="keys")
    if again:
        connection(mission, NoticeKind.CONNECTED)
        mission.give("u1", "u2", "d1-60")
    assert mission.why(1).kind is not Kind.MOVED


def test_a_person_who_drives_into_a_wall_after_the_program_left_did_not_drive_beside_it() -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    connection(mission, NoticeKind.LEFT)
    mission.give("w1-9", source="keys")
    (cause,) = causes_of(mission.attempt)
    assert cause.text.startswith("A person drove the robot: w1-9 led the robot into the maze's outer wall")


def test_who_was_right_again_after_a_person_drove_failed_for_another_reason() -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    mission.believe()
    mission.give("r1-90", source="keys")
    mission.believe()
    mission.give("u1", "d1-60")
    assert mission.why().kind is not Kind.MOVED


def reset(mission: Mission) -> None:
    mission.engine.perform(Action(ActionName.RESET))


def test_a_run_that_a_person_reset_under_its_program_was_moved_by_a_person() -> None:
    mission = begin()
    mission.give("u1", "d1-20", "u1")
    mission.believe()
    there = mission.simulator.pose
    reset(mission)
    mission.engine.tell(Belief(mission.simulator.time, there, mission.simulator.pose, 0.3))
    mission.give("u1", "d1-60")
    assert mission.why().kind is Kind.MOVED


def test_a_program_that_is_started_after_a_reset_was_moved_by_nobody() -> None:
    mission = begin()
    mission.give("u1", "d1-20", "u1")
    reset(mission)
    mission.engine.tell(Notice(NoticeKind.CONNECTED, "client 127.0.0.1:4 connected", "127.0.0.1:4"))
    mission.give("u1", "d1-60")
    assert mission.why().kind is not Kind.MOVED


def test_who_was_right_again_after_a_person_failed_for_another_reason() -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    mission.believe()
    teleport(mission, 8.0, 30.0, 90.0)
    mission.believe()
    mission.give("u1", "d1-60")
    assert mission.why().kind is not Kind.MOVED


def test_where_a_person_put_the_robot_before_the_first_command_is_its_start() -> None:
    mission = begin()
    teleport(mission, 8.0, 30.0, 90.0)
    mission.give("u1", "d1-60")
    assert mission.why().kind is not Kind.MOVED


def test_a_block_that_a_person_moved_is_the_cause_of_missing_it() -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    mission.engine.perform(Action(ActionName.BLOCK, (66.0, 42.0)))
    mission.give("p1-1", "u1")
    cause = mission.why()
    assert cause.kind is Kind.MOVED
    assert re.match(r"A person moved the block at [\d.]+ s, to \(66.0, 42.0\)", cause.text)


@pytest.mark.parametrize(("movements", "kinds"), [(2, [Kind.CLEARANCE, Kind.MOVED]), (24, [Kind.MOVED])])
def test_a_contact_long_after_a_person_moved_the_block_came_of_searching(
    movements: int, kinds: list[Kind]
) -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    mission.engine.perform(Action(ActionName.BLOCK, (66.0, 42.0)))
    mission.give(*["u1", "r1-15"] * movements, "u1", "u2", "u4", "w1-4")
    mission.why()
    found = causes_of(mission.attempt, ProgramEnded(0.0, 1))
    assert [each.kind for each in found] == kinds


def test_a_crash_has_no_second_cause() -> None:
    mission = begin()
    mission.give("u1", "d1-1", "p1-1")
    mission.believe(spread=20.0)
    mission.referee.end("the program ended with exit code 1")
    found = causes_of(mission.attempt, ProgramEnded(0.0, 1, error="KeyError: 1"))
    assert [each.kind for each in found] == [Kind.CRASHED]


def test_a_belief_against_right_readings_stands_beside_a_crash() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4")
    mission.believe()
    mission.give("w1-1")
    mission.believe(ahead=-4.0)
    mission.give(*["u1", "u2"] * 4)
    mission.referee.end("the program ended with exit code 1")
    found = causes_of(mission.attempt, ProgramEnded(0.0, 1, error="LostError: nowhere"))
    assert [each.kind for each in found] == [Kind.CRASHED, Kind.UNDECIDED]


def test_a_person_who_moved_the_robot_stands_beside_a_crash() -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    teleport(mission, 8.0, 30.0, 90.0)
    mission.give("u1")
    mission.referee.end("the program ended with exit code 1")
    found = causes_of(mission.attempt, ProgramEnded(0.0, 1, error="LostError: nowhere"))
    assert [each.kind for each in found] == [Kind.CRASHED, Kind.MOVED]


def test_changes_without_noise_bias_and_both_are_one_phrase() -> None:
    tried = [Counterfactual(each, False) for each in (Change.NO_NOISE, Change.NO_BIAS, Change.EXACT)]
    tried += [Counterfactual(Change.ASIDE, True), Counterfactual(Change.BELIEVED, None)]
    assert shown_tried(tried) == (
        "It would have touched nothing an inch to the side. "
        "It would have touched something even without errors of its drive."
    )
