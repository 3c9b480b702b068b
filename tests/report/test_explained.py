"""Runs whose failure has an explanation: it stands before what came of it."""

from __future__ import annotations

import math
import re

import pytest
from msgspec.structs import replace

from simmer_tui.report.cause_order import cause_of
from simmer_tui.report.causes import Kind
from simmer_tui.report.counterfactuals import Change, Counterfactual
from simmer_tui.report.finding import Basis, Finding, FindingKind
from simmer_tui.report.moments import moments_of
from simmer_tui.report.run_evidence import RunEvidence
from tests.report.test_causes import Mission, begin


def placed_wrong(mission: Mission, rounds: int = 12) -> None:
    """Beliefs that are one column off, all of them."""
    for _ in range(rounds):
        mission.give("u5", "w1-0.3", "s1-0.3")
        mission.believe(ahead=12.0)


# -- the order --------------------------------------------------------------------------------------


def test_right_ranges_beside_a_wrong_belief_are_told_and_no_more_readings_are_advised() -> None:
    mission = begin()
    mission.give("u1", "u2", "u3", "u4")
    mission.believe(ahead=40.0)
    mission.give("u1", "u2", "u3", "u4", "d1-1")
    mission.believe(ahead=40.0)
    cause = mission.why(1)
    assert cause.kind is Kind.LOST
    assert re.search(
        r" Its last 4 ranges before that were right, and .* of them .* there: u\d read ", cause.text
    )
    assert cause.advice.startswith("Print the ranges as your program uses them")


def test_who_drives_on_with_a_wrong_and_unsure_belief_is_lost_whatever_was_read() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4")
    mission.believe(ahead=20.0, spread=5.0)
    mission.give("w1-9")
    cause = mission.why()
    assert cause.kind is Kind.LOST


def test_a_program_that_ended_well_waited_for_no_link() -> None:
    mission = begin()
    mission.give("u1", "d1-2")
    mission.history.real_time += 3.0
    cause = mission.why(0, words="done")
    assert (cause.kind, cause.advice) == (Kind.ENDED, "")
    assert "Its last command to arrive" not in cause.text


def test_a_repetition_says_what_it_changed_and_nothing_where_it_decides_nothing() -> None:
    mission = begin()
    mission.give("d1-60")
    met = mission.evidence().contact
    assert met is not None
    exact, believed = Counterfactual(Change.EXACT, True), Counterfactual(Change.BELIEVED, False)
    said = "It would have touched nothing without drive errors since the last reading."
    met.tried = (exact,)
    assert met.tried_text == said
    also = "It would have touched something even from where the program believed to be."
    met.tried = (exact, believed)
    assert met.tried_text == f"{said} {also}"
    met.tried = (Counterfactual(Change.EXACT, None),)
    assert met.tried_text == ""


def test_a_wrong_map_stands_before_the_contact_it_led_to() -> None:
    mission = begin()
    placed_wrong(mission)
    mission.give("u2", "w1-9")
    cause = mission.why()
    assert cause.kind is Kind.LOST
    assert cause.text.index("as with a map") < cause.text.index(" s, w1-9 was sent. At ")


def test_few_sure_beliefs_say_nothing_of_the_map() -> None:
    mission = begin()
    placed_wrong(mission)
    for _ in range(40):
        mission.give("u1", "d1-0.1")
        mission.believe(ahead=12.0, spread=20.0)
    mission.give("u2", "w1-9")
    assert "as with a map" not in mission.why().text


@pytest.mark.parametrize("rounds", [12, 3])
def test_a_wrong_map_stands_before_the_silence_it_led_to(rounds: int) -> None:
    mission = begin()
    placed_wrong(mission, rounds)
    mission.referee.check(400.0)
    cause = cause_of(RunEvidence(mission.attempt))
    # Few beliefs that are wrong explain nothing.
    assert cause.kind is (Kind.LOST if rounds == 12 else Kind.SILENCE)
    assert cause.text.endswith("the run was ended at the time limit. It never entered the loading zone.")
    assert (
        " s, s1-0.3 was answered, and no command came after it until the run was ended at the " in cause.text
    )


def test_a_wrong_sensor_stands_before_the_silence_it_led_to() -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    mission.referee.check(400.0)
    found = Finding("u1", FindingKind.OFFSET, 3.0, 2.9, 3.1, "in", 9, Basis.SET, "u1 reads 3.0 in too long")
    cause = cause_of(RunEvidence(mission.attempt, findings=(found,)))
    assert (cause.kind, cause.culprits) == (Kind.SENSOR_WRONG, ("u1",))


def test_a_declared_error_stands_before_the_time_that_it_cost() -> None:
    mission = begin(limit=60.0, change=lambda sensor: replace(sensor, read_time=2.0))
    for _ in range(6):
        mission.give("u5")
        mission.simulator.advance(max(mission.simulator.time, 50.5 + 2.0 * mission.attempt.commands))
    mission.give("u2", "w1-1", "s1-1")
    cause = mission.why()
    assert cause.kind is Kind.TOO_SLOW
    slow = "u5 takes 2 s for a reading"
    assert 0 <= cause.text.index(slow) < cause.text.index("Most of its time went to reading")


@pytest.mark.parametrize("commands", [("w1-3.3",), ("w1-9",), ("d1-16.5",)])
def test_a_declared_error_stands_before_the_contact_it_led_to(commands: tuple[str, ...]) -> None:
    mission = begin(change=lambda sensor: replace(sensor, resolution=4.0))
    mission.give("u1", "u2", "u4", "u5", "t1", *commands)
    text = mission.why().text
    assert " s, the robot touched " in text
    assert text.index("its Resolution is 4, in the set mission 0, by this robot's set.") < text.index(
        " s, the robot touched "
    )


def test_a_refused_movement_explains_the_belief_that_counted_on_it() -> None:
    mission = begin()
    mission.give("u1")
    mission.believe()
    mission.give("d1-6,0")
    mission.believe(ahead=6.0)
    mission.give("u1", "r1-5")
    mission.believe(ahead=6.0)
    cause = mission.why(1, words="failed")
    assert cause.kind is Kind.REFUSED
    assert re.match(
        r"At 50\.\d s, d1-6,0 was refused: .*\? In all, 1 of 4 commands was refused\.$", cause.text
    )


# -- lost -------------------------------------------------------------------------------------------


def test_who_was_right_once_was_lost_since_and_who_never_was_never_found_its_place() -> None:
    told = []
    for right in (True, False):
        mission = begin()
        mission.give("u1")
        mission.believe(ahead=0.0 if right else 5.0)
        mission.give("w1-1", "u1")
        mission.believe(ahead=-4.0)
        run = mission.evidence(1, words="failed")
        cause = cause_of(run)
        assert cause.kind is Kind.LOST
        [moment] = [each for each in moments_of(run, cause.moment) if each.is_cause]
        assert f" s, {moment.text}." in cause.text
        told.append(cause.text)
    assert re.match(r"At 50\.\d s, it believed it was at [^:]* off: it was lost from then on\.", told[0])
    assert re.match(r"At 50\.\d s, it believed it was at [^:]* off: it never found its place\.", told[1])


# -- contacts ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("first", "said"),
    [
        ("u3", r"At 50\.1 s, u3 \(behind\) read 3\.0 in; .*; u3 was not read again\."),
        ("u4", r"At 50\.9 s, u3 \(behind\) had not been read yet\."),
    ],
)
def test_the_sensor_that_looks_at_the_contact_and_was_not_read_is_named(first: str, said: str) -> None:
    mission = begin((30.0, 42.0, 90.0))
    mission.give(first, "r1--90", "u1", "d1--60")
    cause = mission.why()
    assert (cause.kind, cause.culprits) == (Kind.UNREAD, ("u3",))
    assert re.search(said, cause.text)
    mission = begin((30.0, 42.0, 90.0))
    mission.give(first, "r1--90", "u1")
    mission.believe()
    mission.give("d1--60")
    cause = mission.why()
    assert cause.kind is Kind.KNOWN_WALL
    assert re.search(said, cause.text)


def test_the_reading_of_a_sensor_that_looks_at_the_wall_is_told_before_one_that_looks_aside() -> None:
    mission = begin((90.0, 42.0, 180.0))
    mission.give("u1", "u2", "u4", "d1-3.6")
    cause = mission.why()
    assert re.match(r"At 50\.1 s, u1 \(ahead\) read ", cause.text)


# -- zones ------------------------------------------------------------------------------------------


def test_a_program_that_never_entered_the_loading_zone_is_told_so() -> None:
    mission = begin()
    mission.give("u5", "d1-1")
    assert "It never entered the loading zone." in mission.why(1, words="failed").text
    mission = begin((18.0, 42.0, 180.0))
    mission.give("u5", "d1-0.5")
    assert "loading zone" not in mission.why(1, words="failed").text


def test_a_program_that_holds_the_block_at_its_end_is_told_where_it_belonged() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4", "p1-1", "u1", "d1--8", "d1-2", "r1-1")
    text = mission.why(1, words="failed").text
    assert "The robot held the block, and had not set it down in the drop zone at (66.0, 42.0)." in text
    assert "loading zone" not in text


# -- commands that came too early -------------------------------------------------------------------


@pytest.mark.parametrize("after", [(), ("u1",)])
def test_a_command_that_came_too_early_once_before_the_end_is_refused(after: tuple[str, ...]) -> None:
    mission = begin()
    mission.give("u1", "d1-2", "r1-15")
    mission.ask_while_moving("d1-3")
    mission.give(*after)
    run = mission.evidence(1, words="failed")
    cause = cause_of(run)
    assert run.refusal is not None
    assert (run.refusal.codes, cause.kind) == (("d1",), Kind.REFUSED)
    assert re.match(
        r"At 50\.\d s, d1-3 was refused: the robot is still moving\. In all, 1 of [45] commands was ",
        cause.text,
    )
    assert cause.text.endswith(" was refused; this one was never carried out.")


def test_a_command_that_was_sent_again_when_the_robot_stood_is_not_refused() -> None:
    mission = begin()
    mission.give("u1", "d1-2")
    mission.ask_while_moving("d1-3")
    mission.give("d1-3", "u1")
    run = mission.evidence(1, words="failed")
    assert run.refusal is None
    assert math.isclose(mission.simulator.pose.x, 35.0)
    assert cause_of(run).kind is Kind.ENDED
