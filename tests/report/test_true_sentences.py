"""Sentences of causes that their own evidence carries, and none beyond it."""

from __future__ import annotations

import math
import re

import pytest
from msgspec.structs import replace

from simmer_tui.config.mission_plan import Cell
from simmer_tui.report.cause_order import advice_on, cause_of
from simmer_tui.report.causes import Kind
from simmer_tui.report.fact_tables import fact_tables
from simmer_tui.report.finding import Basis, Finding, FindingKind
from simmer_tui.report.moments import MomentKind, moments_of
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.report.verdict import verdict_of
from simmer_tui.run.events import Belief, Notice, NoticeKind, OutputLine, ProgramEnded, WireMessage
from simmer_tui.sim import Pose, SensorSpec
from simmer_tui.sim.specs import Axes, DriveKind
from tests.report.test_causes import begin, teleport

# -- commands ----------------------------------------------------------------------------------------------


def test_numbers_of_refused_commands_are_those_of_the_tables() -> None:
    mission = begin()
    for _ in range(9):
        mission.give("u1", "d1-0.5")
        # The same again until it has ended, without a look at the replies.
        mission.ask_while_moving(*["d1-0.5"] * 9)
    mission.ask_while_moving("w1-2", *["r1-3"] * 9)
    run = mission.evidence()
    cause = cause_of(run)
    assert cause.kind is Kind.REFUSED
    assert re.match(r"At 50\.\d s, d1-0\.5 was refused: ", cause.text)
    assert cause.text.endswith(". In all, 91 of 100 commands to drive were refused.")
    assert "Wait for the end" in cause.advice
    commands = {row["fact"]: row["count"] for row in fact_tables(run)[0].objects()}
    assert commands["refused"] == 91
    assert "109 commands arrived, 91 refused." in cause.evidence[0]


def test_what_was_not_done_for_want_of_time_is_no_cause() -> None:
    # Each reading takes half a second; the loading zone is reached just before the end.
    mission = begin((42.0, 42.0, 180.0), limit=110.0, change=lambda each: replace(each, read_time=0.5))
    for _ in range(50):
        mission.give("u1", "u2")
        mission.simulator.advance(max(mission.simulator.time, 50.0 + 0.5 * mission.attempt.commands))
    mission.give("d1-18.5", "d1--1", *["u1"] * 30)
    assert mission.attempt.out_of_time
    run = RunEvidence(mission.attempt)
    assert run.unseen_block == ("u5",)
    cause = cause_of(run)
    assert cause.kind is Kind.TOO_SLOW
    assert "Most of its time went to reading (" in cause.text


# -- contacts ----------------------------------------------------------------------------------------------


def test_a_command_beyond_what_was_read_straight_ahead_is_said_with_that_reading() -> None:
    # It pulls aside and touches a wall beside it before it comes to the one ahead.
    mission = begin((66.0, 42.0, 0.0), bias={DriveKind.RIGHT: Axes(y=0.3)})
    mission.give("u1", "u2", "u4", "d1-60")
    cause = mission.why()
    read = re.match(
        r"At 50\.\d s, u1 \(ahead\) read (\d+\.\d) in\. At 50\.\d s, d1-60 was sent\.", cause.text
    )
    assert read is not None
    assert float(read[1]) < 60.0
    assert (cause.kind, cause.advice.startswith("Compare each movement with u1")) == (Kind.KNOWN_WALL, True)


def test_a_velocity_that_goes_on_while_nothing_is_sent_is_told_from_its_last_command_on() -> None:
    mission = begin((9.0, 42.0, 0.0))
    mission.give("u2", "u4", "vv-6;0;0", "vv-6;0;0")
    mission.simulator.advance(60.0)
    cause = mission.why()
    assert (cause.kind, cause.elapsed) == (Kind.UNREAD, pytest.approx(50.1, abs=0.1))
    assert cause.text.startswith(
        "At 50.1 s, u1 (ahead) had not been read yet. At 50.1 s, vv-6;0;0 was sent, and nothing ended it. At "
    )


def test_errors_of_a_wrong_drive_are_not_said_to_be_without_effect() -> None:
    mission = begin((66.0, 42.0, 0.0), bias={DriveKind.RIGHT: Axes(y=0.3)})
    mission.give("u1", "u2", "u4", "d1-3", "d1-60")
    found = Finding("r1", FindingKind.GAIN, 0.7, 0.66, 0.71, "", 3, Basis.NOMINAL, "r1 turns 0.70 times")
    assert "would have touched" in " ".join(cause_of(mission.evidence()).evidence)
    cause = cause_of(mission.evidence(findings=(found,)))
    assert cause.kind is Kind.DRIVE_WRONG
    assert "would have touched" not in " ".join(cause.evidence)


def test_only_a_held_block_is_planned_with() -> None:
    assert "block" not in advice_on(Kind.TOO_CLOSE)
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4", "p1-1", "l1", "u1", "u2", "u4", "w1--2", *["r1-90"] * 4)
    assert mission.why().advice == "Plan with the held block, and an inch more on each side."


# -- the gripper -------------------------------------------------------------------------------------------


def test_a_block_that_was_let_go_where_it_lay_was_carried_nowhere() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4", *("p1-1", "l1", "p1-0") * 3)
    cause = mission.why(1)
    assert cause.kind is Kind.DROPPED_OUTSIDE
    assert re.match(r"At 53\.\d s, it set the block down at \(20\.0, 42\.0\), ", cause.text)
    assert ", where it had lain; " in cause.text
    assert "; it had taken it 3 times. l1 read 1 before that." in cause.text
    # It is of no use to look at the sensor, which was right.
    assert cause.advice == "Find out why your program opens the gripper there: it held the block."


def test_jaws_that_were_closed_before_are_told() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("p1-1", "d1-4", "p1-1")
    cause = mission.why(1)
    assert cause.kind is Kind.MISSED_GRIP
    assert "its jaws were closed already" in cause.text
    assert cause.text.endswith("; it closed on nothing twice in all.")


def test_a_sensor_that_looked_elsewhere_when_it_was_read_is_not_said_to_have_seen_the_wall() -> None:
    mission = begin((66.0, 42.0, 90.0))
    mission.give("u1", "u2", "r1--90", "u3", "d1-60")
    (sight,) = [each for each in moments_of(mission.evidence()) if each.kind is MomentKind.SIGHT]
    assert sight.code == "u1"
    assert "; then the robot turned" in sight.text


def test_a_last_reading_before_a_turn_is_told_as_the_last_one() -> None:
    mission = begin((66.0, 42.0, 90.0))
    mission.give("u1", "u2", "u3", "r1--90", "d1-60")
    (sight,) = [each for each in moments_of(mission.evidence()) if each.kind is MomentKind.SIGHT]
    assert sight.text == "u3 (behind) read 39.0 in, and no range sensor was read after that"


def test_a_reading_before_a_turn_is_not_said_to_show_the_wall_after_it() -> None:
    # u1 read the wall ahead; after the turn the robot touches another one.
    mission = begin()
    mission.give("u1", "u2", "u4", "r1-30", "u2", "d1-60")
    cause = mission.why()
    assert cause.kind is not Kind.KNOWN_WALL
    assert "Compare each movement with u1" not in cause.advice


def test_a_reading_of_a_wall_aside_is_not_said_to_show_the_corner_ahead() -> None:
    # It drives on past the wall that u2 sees, and touches the next one with its side.
    mission = begin((42.0, 33.5, 0.0))
    mission.give("u1", "u2", "u4", "u5", "t1", "d1-20")
    cause = mission.why()
    assert re.search(r"d1-20 was sent\. At 51\.\d s, the robot touched ", cause.text)
    assert cause.kind is Kind.TOO_CLOSE
    assert "u2" not in cause.advice


def test_the_time_of_a_reading_is_that_of_the_sensor_that_is_named() -> None:
    # u1 and u5 look at the wall; u5 was read last.
    mission = begin((66.0, 42.0, 0.0))
    mission.give("u1", "w1-2", "s1-2", "u5", *("w1-2", "s1-2") * 2, "u3", "d1-60")
    met = mission.evidence().contact
    assert met is not None
    assert met.last is not None
    assert met.last.code == "u5"
    read = f"At {met.last.time:.1f} s, u5 (ahead) read "
    assert read in mission.why().text
    assert met.sight_text.endswith("; u5 was not read again")


def test_the_way_of_a_velocity_is_compared_with_no_distance() -> None:
    mission = begin((9.0, 42.0, 0.0))
    mission.give("u2", "u4", "vx-5")
    for hundredths in range(5010, 5760, 10):
        mission.simulator.advance(hundredths / 100.0)
        mission.give("g1")
    cause = mission.why()
    assert "nothing ended it" in cause.text
    assert re.search(r", after \d\d\.\d in of vx-5\.", cause.text)
    assert cause.advice == "End the velocity in time: send vx with zeros. It goes on until another one comes."


@pytest.mark.parametrize(
    ("after", "said"),
    [((), "no range sensor had been read"), (("u4",), "u1 (ahead) had not been read")],
)
def test_what_came_before_a_person_moved_the_robot_is_not_denied(after: tuple[str, ...], said: str) -> None:
    mission = begin((9.0, 42.0, 0.0))
    mission.give("u1", "u2")
    mission.believe()
    teleport(mission, 66.0, 42.0, 0.0)
    mission.give(*after, "d1-60")
    evidence = mission.evidence()
    texts = [each.text for each in moments_of(evidence)]
    assert f"{said} since a person moved the robot" in texts
    assert "The program sent no belief since a person moved the robot." in cause_of(evidence).evidence


def test_a_robot_larger_than_the_nominal_one_is_told_where_a_right_belief_met_a_wall() -> None:
    for diameter, told in ((6.0, False), (8.4, True)):
        mission = begin((20.0, 6.5, 90.0), diameter=diameter)
        mission.give("u1", "u2", "u4")
        mission.believe()
        mission.give("d1-8", "w1--40")
        cause = mission.why()
        assert ("the robot reaches 4.2 in from its centre, not 3 in" in " ".join(cause.evidence)) is told


# -- beliefs, and the end ----------------------------------------------------------------------------------


def test_a_wrong_heading_is_compared_with_turns_not_with_ranges() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4")
    mission.believe()
    mission.give("u1", "u2", "u4", *["r1-2", "r1--1"] * 3, "r1-3", "r1-4", "r1-5", "r1-6")
    mission.believe(turn=-90.0)
    cause = mission.why(1)
    assert cause.kind is Kind.LOST
    assert cause.advice.startswith("Compare what your program adds to its belief with the command")


def test_a_belief_that_was_unsure_in_between_was_lost_all_the_while() -> None:
    mission = begin()
    for ahead, spread in ((0.0, 0.3), (9.0, 0.3), (9.0, 12.0), (9.0, 0.3)):
        mission.give("u1", "d1-1")
        mission.believe(ahead=ahead, spread=spread)
    first = mission.history.beliefs[1]
    cause = mission.why()
    assert (cause.kind, cause.elapsed) == (Kind.LOST, first.elapsed)


def test_a_block_outside_the_loading_zone_is_told_where_it_was_not_found() -> None:
    for place, told in (((20.0, 42.0), False), ((42.0, 6.0), True)):
        mission = begin(block=place)
        mission.give("u1", "d1-2")
        text = "The block lay at (42.0, 6.0), outside the loading zone."
        assert (text in mission.why(1).text) is told
        mission.history.is_twin = True
        assert text not in mission.why(1).text


def test_who_was_sent_no_movement_is_not_told_to_compare_movements() -> None:
    mission = begin()
    mission.believe(ahead=30.0)
    mission.give("d1-6", "w1-30")
    cause = mission.why()
    assert cause.kind is Kind.LOST
    assert "It had read no range before that." in cause.text
    assert cause.advice.startswith("Turn on the spot and read all sensors")


def test_a_line_that_was_given_a_wrong_value_is_not_said_to_be_wrong() -> None:
    mission = begin()
    mission.give("u1")
    mission.referee.end("the program ended with exit code 1")
    error = "ValueError: could not convert string to float: 'ok'"
    mission.history.add_program_end(ProgramEnded(10.0, 1, error=error, place="main.py:15"))
    verdict = verdict_of(mission.history, mission.task)
    assert verdict.advice == "Try: Look at main.py:15, and print what it is given."


def test_a_fault_is_told_where_nothing_else_was_wrong() -> None:
    mission = begin()
    mission.engine.tell(Notice(NoticeKind.FAULT, "9600 baud, but the sketch has 38400", advice=True))
    mission.give("u1")
    mission.history.add_program_end(ProgramEnded(53.0, 1))
    text = verdict_of(mission.history, None).text
    assert text.endswith("; at 50.0 s, 9600 baud, but the sketch has 38400.")


@pytest.mark.parametrize("reply", [False, True])
def test_a_message_without_a_reply_is_told_where_the_program_gave_up(reply: bool) -> None:
    mission = begin()
    mission.give("u1")
    mission.engine.tell(WireMessage(51.0, "s\n"))
    if reply:
        mission.engine.tell(WireMessage(52.0, "stopped\n", reply=True))
    said = (OutputLine(0.0, "no answer to the stop: ''"),)
    mission.history.add_program_end(ProgramEnded(53.0, 1, stderr=said))
    text = verdict_of(mission.history, None).text
    assert "it printed last: no answer to the stop: ''" in text
    assert ("its last message, 's' at 51.0 s, had no reply." in text) is not reply


def test_what_happens_after_the_end_of_a_mission_is_no_fact_of_it() -> None:
    mission = begin((66.0, 42.0, 180.0))
    mission.give("u1", "d1-60")
    text = "'u1u2' came without a line end: end each with a newline"
    mission.engine.tell(Notice(NoticeKind.FAULT, text, advice=True))
    teleport(mission, 30.0, 42.0, 0.0)
    for _ in range(8):
        mission.give("u1", "d1-0.2")
        mission.believe()
    run = mission.evidence()
    cause = cause_of(run)
    assert cause.kind is Kind.KNOWN_WALL
    kinds = {each.kind for each in moments_of(run, cause.moment)}
    assert not kinds & {MomentKind.FAULT, MomentKind.PERSON, MomentKind.LOCALIZED}


def test_a_set_s_own_errors_are_moments_of_a_failure_alone() -> None:
    def short(sensor: SensorSpec) -> SensorSpec:
        return replace(sensor, bias=-2.5, min_range=0.0) if sensor.code == "u5" else sensor

    mission = begin((28.0, 42.0, 180.0), zone=Cell(30.0, 42.0), change=short)
    mission.give("u5", "d1-4", "p1-1", "a1-9", "p1-0")
    assert not any(each.kind is MomentKind.DEVICE for each in moments_of(RunEvidence(mission.attempt)))
    mission = begin(change=short)
    mission.give("u5", "u1", "u5")
    run = mission.evidence(3)
    (device,) = (each for each in moments_of(run, cause_of(run).moment) if each.kind is MomentKind.DEVICE)
    assert re.match(r"u5 reads 2\.5 in too short .*, by this robot's set$", device.text)


def test_a_velocity_that_is_sent_again_and_again_does_not_go_on() -> None:
    mission = begin()
    mission.give("u1", *("vv-6;0;0", "wt-0.2", "u1") * 14)
    cause = mission.why()
    assert "nothing ended it" not in cause.text
    assert "End the velocity in time" not in cause.advice
    found = re.search(r"after (\d+\.\d) in of vv-6;0;0", cause.text)
    assert found is not None
    assert float(found[1]) < 2.0


def test_an_error_that_is_a_question_ends_with_one_mark_and_is_told_once() -> None:
    mission = begin()
    mission.give("u1")
    mission.referee.end("the program ended with exit code 1")
    mission.history.add_program_end(ProgramEnded(0.0, 1, error="ValueError: where is it?", place="a.py:3"))
    told_once = verdict_of(mission.history, mission.task)
    assert "?." not in told_once.text
    assert told_once.text.count("where is it?") == 1


def test_a_belief_of_a_real_robot_is_beside_no_truth() -> None:
    mission = begin()
    mission.history.is_twin = True
    mission.give("u1", "d1-2")
    mission.believe(spread=20.0)
    run = mission.evidence(1)
    cause = cause_of(run)
    assert not any("off by" in each for each in (cause.text, *cause.evidence))


def test_a_belief_without_a_number_before_the_lost_one_is_passed_over() -> None:
    mission = begin()
    mission.believe()
    mission.give("u1", "d1-6")
    mission.engine.tell(Belief(mission.simulator.time, Pose(math.nan, 1.0, 0.0), mission.simulator.pose, 0.3))
    mission.give("u1")
    mission.believe(ahead=-6.0)
    assert mission.why(1).kind is Kind.LOST


def test_a_program_that_ended_since_no_reply_came_is_told_of_that_and_not_of_its_belief() -> None:
    mission = begin()
    mission.give("u1")
    mission.believe(ahead=12.0)
    cause = mission.why(1, words="wander: no reply to 'd1-2' within 1 s")
    assert cause.kind is Kind.ENDED
    assert "no reply to 'd1-2'" in cause.text
    assert cause.advice.startswith("Check which command got no reply")
