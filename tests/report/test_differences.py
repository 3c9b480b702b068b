"""Differences of a run: its set beside the nominal one, and commands that a good program does not send."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import pytest
from msgspec.structs import replace

from simmer_tui.report.cause_order import cause_of
from simmer_tui.report.causes import Cause, Kind
from simmer_tui.report.device_differences import device_findings
from simmer_tui.report.moments import moments_of
from simmer_tui.report.verdict import Verdict, verdict_of
from simmer_tui.run.events import Action, ActionName, ProgramEnded
from simmer_tui.sim import ObservingSensor, Pose, World
from simmer_tui.sim.specs import EMPTY, WALL, Axes, DriveKind, GripperSpec, SensorSpec, SimulationSpec
from tests.report.test_causes import begin


def with_cells(*cells: tuple[int, int, int]) -> Callable[[SimulationSpec], SimulationSpec]:
    """The maze with other cells: row from the top and column from the left, from 1, and kind."""

    def changed(spec: SimulationSpec) -> SimulationSpec:
        rows = [list(row) for row in spec.maze.cells]
        for row, column, kind in cells:
            rows[row - 1][column - 1] = kind
        return replace(spec, maze=replace(spec.maze, cells=tuple(map(tuple, rows))))

    return changed


def grip(**fields: float) -> Callable[[SimulationSpec], SimulationSpec]:
    def changed(spec: SimulationSpec) -> SimulationSpec:
        return replace(spec, gripper=replace(spec.gripper or GripperSpec(code="p1"), **fields))

    return changed


def slow(spec: SimulationSpec) -> SimulationSpec:
    return replace(spec, drives=tuple(replace(each, speed=each.speed / 10.0) for each in spec.drives))


@pytest.mark.parametrize(
    ("own", "limit", "said"),
    [
        (lambda spec: spec, 300.0, ""),
        (lambda spec: spec, 200.0, "the time limit is 200 s, not 300 s"),
        (lambda spec: replace(spec, block_size=5.0), 300.0, "the block is 5 in wide, not 3 in"),
        (lambda spec: replace(spec, block_size=0.0), 300.0, "there is no block"),
        (grip(width=0.5), 300.0, "the gripper is 0.5 in wide, not 4 in"),
        (grip(reach=1.5), 300.0, "the gripper reaches 1.5 in, not 3 in"),
        (with_cells((1, 4, WALL)), 300.0, "there is a wall in row 1, column 4"),
        (with_cells((2, 5, EMPTY), (1, 1, WALL)), 300.0, "there is a wall in row 1, column 1"),
        (with_cells((1, 1, WALL), (1, 4, WALL), (1, 6, WALL)), 300.0, "3 cells of the maze differ"),
        (slow, 300.0, "d1 moves at 0.6 in/s, not 6 in/s"),
        (grip(speed=0.01), 300.0, "the gripper takes 100 s to close, not 0.5 s"),
    ],
)
def test_a_set_is_told_beside_the_nominal_one(
    own: Callable[[SimulationSpec], SimulationSpec], limit: float, said: str
) -> None:
    mission = begin(own=own, limit=limit)
    mission.give("u1", "d1-1")
    cause = mission.why(1, words="failed")
    # A program may be misled by the maze: it is told with the cause.
    found = " ".join((cause.text, *cause.evidence))
    assert ("Unlike in the set" in found) is bool(said)
    assert said in found


def test_a_wall_that_the_nominal_maze_does_not_have_is_told_at_the_contact() -> None:
    mission = begin(own=with_cells((1, 4, WALL)))
    mission.believe()
    mission.give("u1", "d1-30")
    cause = mission.why()
    said = "Unlike in the set mission, there is a wall in row 1, column 4"
    assert said in cause.text
    mission = begin()
    mission.believe()
    mission.give("u1", "d1-90")
    cause = mission.why()
    assert "Unlike" not in " ".join((cause.text, *cause.evidence))


def test_a_block_outside_its_zone_is_told_before_the_time_that_went_by() -> None:
    mission = begin(limit=62.0, block=(66.0, 18.0))
    for second in range(51, 64):
        mission.give("u5", "w1-1" if second % 2 else "s1-1")
        mission.simulator.advance(float(second))
    cause = mission.why()
    assert cause.kind is Kind.TOO_SLOW
    assert cause.text.startswith("The block lay at (66.0, 18.0), outside the loading zone. ")
    assert cause.advice.startswith("Put the block into the loading zone")


@pytest.mark.parametrize("closes", [False, True])
def test_a_program_that_ended_without_a_grip_is_told_so(closes: bool) -> None:
    mission = begin()
    mission.give("u1", "d1-1", *(("p1-1", "p1-0") if closes else ()))
    assert ("The gripper was never closed." in mission.why(1).text) is not closes


def test_usual_errors_of_a_drive_are_told_at_a_contact_and_not_blamed() -> None:
    mission = begin(bias={DriveKind.RIGHT: Axes(x=0.08)})
    mission.give("u1", "u2", "u4", "d1-14.2")
    cause = mission.why()
    assert (cause.kind, cause.culprits) == (Kind.TOO_CLOSE, ())
    assert "It would have touched nothing without drive errors since the last reading." in cause.evidence
    assert cause.advice == "Compare each movement with the distance to the wall before you send it."


def test_a_block_outside_its_zone_explains_no_silence() -> None:
    cause = begin(block=(66.0, 18.0)).why(1)
    assert cause.kind is Kind.SILENCE
    assert "block lay" not in cause.text
    assert "connect to the address" in cause.advice.lower()


def test_a_block_outside_its_zone_stands_behind_a_wrong_belief() -> None:
    mission = begin(block=(66.0, 18.0))
    mission.give("u1", "u2", "u4")
    mission.believe(ahead=40.0)
    cause = mission.why(1)
    assert cause.kind is Kind.LOST
    assert cause.text.endswith("The block lay at (66.0, 18.0), outside the loading zone.")
    assert "block" not in cause.advice


def cause_of_slowness() -> Cause:
    """The cause of a run that reads and moves by turns until its time limit, 62 s, is over."""
    mission = begin(limit=62.0, change=lambda sensor: replace(sensor, read_time=0.4))
    for second in range(51, 64):
        mission.give("u5", "w1-1" if second % 2 else "s1-1")
        mission.simulator.advance(float(second))
    mission.give("u5")
    return mission.why()


def test_time_that_went_to_no_one_thing_is_told_by_its_parts() -> None:
    cause = cause_of_slowness()
    assert cause.kind is Kind.TOO_SLOW
    assert "Its time went to " in cause.text
    assert cause.advice == "Save time where most of it goes."


def test_a_code_that_no_device_has_is_the_cause_if_it_comes_often() -> None:
    mission = begin()
    mission.give(*("u1", "d2-3") * 5)
    cause = mission.why(1, words="failed")
    assert cause.kind is Kind.REFUSED
    assert re.match(
        r"At 50\.\d s, d2-3 was refused: .*\? In all, 5 of 10 commands were refused\.$", cause.text
    )
    assert "no sensor or drive has the code d2" in cause.text
    mission = begin()
    mission.give("d2-3", *["u1"] * 40)
    assert mission.why(1, words="failed").kind is not Kind.REFUSED


def test_a_belief_that_is_wrong_since_a_person_moved_the_robot_was_right_before() -> None:
    mission = begin()
    mission.give("u1")
    mission.believe()
    mission.engine.perform(Action(ActionName.TELEPORT, (66.0, 42.0, 180.0)))
    mission.believe(ahead=-36.0)
    mission.give("u1", "d1-60")
    run = mission.evidence()
    texts = [each.text for each in moments_of(run, cause_of(run).moment)]
    assert any(each.endswith(": it was lost from then on") for each in texts)
    assert not any("never found its place" in each for each in texts)


def verdict_after(error: str) -> Verdict:
    """The verdict on a run whose program ended by an error after its first command."""
    mission = begin()
    mission.give("u1")
    mission.engine.tell(ProgramEnded(mission.simulator.time, 1, error=error, place="robot.py:8"))
    return verdict_of(mission.history, mission.task)


def test_a_question_to_nobody_is_taken_out() -> None:
    verdict = verdict_after("EOFError: EOF when reading a line")
    assert verdict.advice == "Try: Take the question out of your program: nobody can type under --run."


def test_the_line_at_which_a_silent_program_was_ended_is_told() -> None:
    mission = begin()
    mission.give("u1")
    mission.referee.check(400.0)
    mission.engine.tell(ProgramEnded(mission.simulator.time, 143, stopped=True, place="robot.py:6"))
    verdict = verdict_of(mission.history, mission.task)
    assert verdict.cause is not None
    assert verdict.cause.kind is Kind.SILENCE
    assert "When it was ended, the program was at robot.py:6." in verdict.text
    assert verdict.advice == "Try: Find out what your program waits for, or repeats, at robot.py:6."
    assert not any("robot.py" in each for each in verdict.evidence)


def test_a_short_time_limit_is_told_before_what_the_time_went_to() -> None:
    cause = cause_of_slowness()
    assert re.search(r"The time limit was 62 s, in the set mission 300 s\. .* time went to", cause.text)
    assert not any("time limit" in each for each in cause.evidence)


def test_a_blind_spot_that_the_nominal_set_does_not_have_is_told_as_such() -> None:
    def blind(sensor: SensorSpec) -> SensorSpec:
        return replace(sensor, min_range=7.0) if sensor.code == "u1" else sensor

    mission = begin((8.0, 42.0, 180.0), change=blind)
    mission.give(*("u1", "d1-0.5", "u1", "d1--0.5") * 6)
    (found,) = device_findings(mission.attempt)
    assert (found.of, found.count) == ("u1", 12)
    assert found.text.startswith(
        "u1 reads 2.2 in too long (2.00 to 2.50, 12 readings): its Min Range (in) is 7"
    )


def test_a_compass_that_was_never_read_is_told_beside_a_heading_that_was_assumed() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4")
    mission.believe(turn=90.0)
    cause = mission.why(1, words="failed")
    assert cause.kind is Kind.LOST
    assert "c1, which tells the heading, was never read." in cause.text
    assert cause.advice == "Read c1 before you drive: it tells the heading."
    mission = begin()
    mission.give("u1", "u2", "u4", "c1")
    mission.believe(turn=90.0)
    assert "was never read" not in mission.why(1, words="failed").text


class Bearing(ObservingSensor):
    """The bearing of the maze's corner, degrees: its readings are cyclic, and it is no compass."""

    name = "bearing"
    meaning = "bearing of a corner"
    unit = "deg"
    columns = ()
    period = 360.0

    def observe(self, world: World, pose: Pose) -> tuple[float, None]:
        return math.degrees(math.atan2(-pose.y, -pose.x)) - pose.heading, None


def test_a_cyclic_sensor_is_no_compass() -> None:
    def without_compass(spec: SimulationSpec) -> SimulationSpec:
        others = (each for each in spec.sensors if not each.kind.is_heading)
        return replace(spec, sensors=(*others, SensorSpec(kind=Bearing, number=1, code="b1")))

    mission = begin(own=without_compass)
    mission.give("u1", "u2", "u4")
    mission.believe(turn=90.0)
    cause = mission.why(1, words="failed")
    assert cause.kind is Kind.LOST
    assert "tells the heading" not in f"{cause.text} {cause.advice}"


def test_a_reset_that_took_the_block_out_of_the_gripper_is_told() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("u1", "d1-4", "p1-1")
    mission.engine.perform(Action(ActionName.RESET))
    mission.believe()
    mission.give("u1", "d1--1")
    cause = mission.why()
    assert cause.kind is Kind.MOVED
    assert "at its start again, without the block that it had held, and the program went on." in cause.text
    # The belief that came after it was right.
    assert "No belief was right" not in cause.text


def test_a_block_that_is_far_away_was_not_missed_by_inches() -> None:
    mission = begin((90.0, 42.0, 180.0))
    mission.give("u1", "p1-1")
    cause = mission.why(1, words="failed")
    assert " s, it closed the gripper, which holds nothing: the block lay 64 in away." in cause.text
    assert cause.advice.startswith("Search for the block")


def test_movements_to_and_fro_have_both_signs() -> None:
    mission = begin(limit=100.0)
    mission.give("u5", *("r1-30", "r1--30") * 60)
    assert "mostly by +-30" in mission.why(1).text


@pytest.mark.parametrize(
    ("error", "advice"),
    [
        ("KeyboardInterrupt", ""),
        (
            "simmer_tui.client.RobotTimeoutError: no reply to 'p1-1' within 30 s",
            "Try: Check which command got no reply",
        ),
    ],
)
def test_an_interrupt_and_a_reply_that_did_not_come_are_no_error_of_a_line(error: str, advice: str) -> None:
    verdict = verdict_after(error)
    assert verdict.advice.startswith(advice)
    assert "robot.py" not in verdict.advice
