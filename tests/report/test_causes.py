"""Why a run failed: the cause of runs that are made to fail in one way."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

import pytest
from msgspec import structs
from msgspec.structs import replace

from simmer_tui.config.loader import Configuration, find_set, load
from simmer_tui.config.mission_plan import Cell, MissionPlan
from simmer_tui.config.nominal import Nominal
from simmer_tui.report.cause_order import NO_RULE, ORDER, cause_of
from simmer_tui.report.causes import LIKELY, Cause, Kind
from simmer_tui.report.counterfactuals import Change, CounterfactualWorld
from simmer_tui.report.finding import Basis, Finding, FindingKind
from simmer_tui.report.moments import MOST_MOMENTS, MomentKind, moments_of
from simmer_tui.report.run_evidence import RunEvidence
from simmer_tui.report.verdict import verdict_of
from simmer_tui.robot.engine import Engine
from simmer_tui.run.attempt import Attempt, Task, task_of
from simmer_tui.run.events import (
    Action,
    ActionName,
    Belief,
    DisplayChanged,
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
from simmer_tui.sim.specs import Axes, DriveKind, RobotSpec, SimulationSpec

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

    def evidence(
        self, code: int = 0, error: str = "", words: str = "", findings: tuple[Finding, ...] = ()
    ) -> RunEvidence:
        self.referee.end(f"the program ended with exit code {code}")
        said = (OutputLine(0.0, words),) if words else ()
        program = ProgramEnded(0.0, code, error=error, stderr=said)
        return RunEvidence(self.attempt, program, findings=findings)

    def why(self, code: int = 0, error: str = "", words: str = "") -> Cause:
        return cause_of(self.evidence(code, error, words))


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
    diameter: float = 6.0,
    own: Callable[[SimulationSpec], SimulationSpec] = lambda spec: spec,
) -> Mission:
    """A mission of the bundled set, which is nominal, with one change."""
    spec = replace(
        SET.simulation,
        bot_center=start[:2],
        bot_rot=start[2],
        block_center=block,
        randbias=False,
        robot=RobotSpec.circle(diameter),
        sensors=tuple(change(each) for each in SET.simulation.sensors),
    )
    spec = own(spec)
    configuration: Configuration = replace(SET, simulation=spec)
    simulator = Simulator(spec, 3)
    simulator.noise = noise
    simulator.set_bias({kind: Axes() for kind in DriveKind} | (bias or {}))
    simulator.advance(50.0)
    plan = MissionPlan(Pose(*start), False, block, (Cell(18.0, 42.0),), zone, limit, contacts=contacts)
    engine = Engine(simulator)
    nominal = Nominal("mission", SET.simulation, 300.0)
    history = RunHistory(checkpoint_of(simulator, mission=True), nominal=lambda: nominal)
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


def test_a_wrong_belief_before_the_contact_is_being_lost() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4", "t1", "u5", "w1-1", "u1")
    mission.believe(ahead=-4.0)
    mission.give("u1", "d1-16.5")
    cause = mission.why()
    assert (cause.kind, cause.moment.kind) == (Kind.LOST, MomentKind.LOST)
    assert re.match(
        r"At 50\.\d s, it believed it was at \(26\.0, .*, 4\.0 in and 0 deg off: it never found its place\.",
        cause.text,
    )
    assert cause.elapsed == pytest.approx(50.0, abs=3.0)
    assert any("off by 4.0 in" in each for each in cause.evidence)


def test_a_velocity_straight_at_a_wall_that_was_read_is_told_with_its_reading() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4", "vv-6;0;0", "wt-10")
    cause = mission.why()
    assert mission.attempt.too_many_contacts
    assert cause.kind is Kind.TOO_CLOSE
    assert re.match(
        r"At 50\.1 s, u1 \(ahead\) read 15\.0 in\. At 50\.2 s, vv-6;0;0 was sent, and nothing ended it\. "
        r"At 5\d\.\d s, the robot touched .*, after 15\.0 in of vv-6;0;0\.",
        cause.text,
    )
    assert cause.advice == "End the velocity in time: send vv with zeros. It goes on until another one comes."


def test_a_wrong_heading_alone_is_being_lost_too() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4")
    mission.believe(turn=30.0)
    mission.give("r1--30", "d1-11")
    cause = mission.why()
    assert cause.kind is Kind.LOST
    assert "heading was off by 30 deg" in cause.text


def test_a_busy_answer_is_a_refusal_unless_the_same_was_sent_again() -> None:
    mission = begin()
    mission.ask_while_moving("d1-1", "d1-1", "d1-1")
    assert mission.evidence().refusal is None
    mission = begin()
    mission.ask_while_moving("w1-2", *["d1-3"] * 8)
    run = mission.evidence()
    assert run.refusal is not None
    assert run.refusal.decides
    assert cause_of(run).text.endswith("In all, 9 of 9 commands to drive were refused.")


def test_a_large_error_that_the_set_declares_is_named() -> None:
    mission = begin(
        change=lambda sensor: replace(sensor, bias=-2.5, min_range=0.0) if sensor.code == "u5" else sensor
    )
    mission.give("u1", "u5", "u5", "u5")
    cause = mission.why(code=3)
    assert "u5 reads 2.5 in too short (3 readings): its Bias is -2.5, in" in cause.text
    assert cause.culprits == ("u5",)
    assert "u1" not in cause.text


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"drift": 0.1}, r"u5 reads 5\.\d in too long \(3 readings\): its Drift \(per s\) is 0\.1"),
        ({"resolution": 4.0}, r"u5 .* 1\.\d in .*\(3 readings\): its Resolution is 4, in the set mission 0"),
    ],
)
def test_a_declared_drift_and_coarse_steps_are_told_as_such(fields: dict[str, float], said: str) -> None:
    mission = begin(change=lambda sensor: replace(sensor, **fields) if sensor.code == "u5" else sensor)
    mission.give("u1", "u5", "u5", "u5")
    cause = mission.why(code=3)
    assert re.search(f"{said}.*, by this robot's set\\.", cause.text)
    assert cause.culprits == ("u5",)


def test_what_arrived_stands_beside_what_the_belief_moved() -> None:
    mission = begin()
    mission.believe()
    mission.give("d1-6", "d1-6")
    mission.believe(ahead=-6.0)
    cause = mission.why(code=3)
    assert cause.kind is Kind.LOST
    assert "it was sent d1-6 twice; the robot moved 12.0 in ahead, the belief 6.0 in ahead." in cause.text


@pytest.mark.parametrize(("command", "said"), [("w1--9", True), ("w1-9", False)])
def test_a_right_belief_is_told_before_a_contact_and_any_map_has_the_outer_wall(
    command: str, said: bool
) -> None:
    mission = begin()
    mission.give("u1")
    mission.give("d1-6", "d1--6")
    mission.believe()
    mission.give(command)
    cause = mission.why()
    assert re.search(
        rf"{command} was sent\. The belief sent at .* was right, off by 0\.0 in and 0 deg; ", cause.text
    )
    assert ("map has" in cause.advice) is said


def test_an_ended_connection_is_advised_to_look_at_the_link() -> None:
    mission = begin()
    mission.give("d1-1")
    mission.referee.end("the program ended with exit code 1")
    ended = ProgramEnded(0.0, 1, error="ConnectionError: robot is gone", place="program.py:26")
    mission.history.add_program_end(ended)
    assert "Check which command got no reply" in verdict_of(mission.history, mission.task).advice


@pytest.mark.parametrize("spread", [None, 2.0])
def test_a_movement_into_a_wall_says_how_far_its_way_was_free(spread: float | None) -> None:
    mission = begin()
    mission.give("u1", "u2", "u4", "u5", "t1")
    if spread is not None:
        mission.believe(ahead=-4.0, spread=spread)
    mission.give("w1-3.3")
    cause = mission.why()
    assert cause.kind is Kind.TOO_CLOSE
    assert re.search(
        r"w1-3\.3 was sent\. .*At 5\d\.\d s, the robot touched .*, after 3\.0 in of w1-3\.3\.", cause.text
    )


def test_a_program_that_says_it_does_not_know_is_lost() -> None:
    mission = begin()
    mission.believe(ahead=-4.0, spread=20.0)
    mission.give("u2", "u4", "d1-16.5")
    cause = mission.why()
    assert cause.kind is Kind.LOST
    assert "with a spread of 20.0 in" in cause.text


def test_driving_on_without_looking_is_said() -> None:
    mission = begin()
    mission.give("d1-4", "w1-30")
    cause = mission.why()
    assert (cause.kind, cause.advice) == (Kind.UNREAD, "Read u2 before you send w1.")
    assert re.match(
        r"At 50\.\d s, no range sensor had been read yet\. At 50\.\d s, w1-30 was sent\. "
        r"At 51\.\d s, the robot touched ",
        cause.text,
    )


def test_a_reading_that_was_far_off_is_said_with_what_it_should_have_been() -> None:
    mission = begin((30.0, 42.0, 90.0), change=lambda sensor: replace(sensor, bias=30.0))
    mission.simulator.noise = True
    mission.give("u1", "u5", "t1", "d1-3", "w1-30")
    cause = mission.why()
    assert cause.kind is Kind.SENSOR_WRONG
    assert re.search(
        r" read \d+\.\d in; the true distance was \d+\.\d in\. At .* s, w1-30 was sent\.", cause.text
    )


def test_the_drives_are_to_blame_where_bias_alone_led_there() -> None:
    mission = begin((30.0, 42.0, 0.0), bias={DriveKind.RIGHT: Axes(y=0.6)})
    mission.believe()
    mission.give("u1", "u2", "u4", "d1-10")
    cause = mission.why()
    assert cause.kind is Kind.DRIVE_WRONG
    assert Change.EXACT in saved(cause)
    assert "It would have touched nothing without drive errors since" in cause.text


def test_a_held_block_that_touches_is_named() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4", "p1-1", "l1", "u1", "u2", "u4", "w1--2", *["r1-90"] * 4)
    cause = mission.why()
    assert cause.kind is Kind.TOO_CLOSE
    assert " s, the block it holds touched the maze's outer wall" in cause.text


def test_a_movement_without_its_errors_is_the_one_that_was_asked_for() -> None:
    mission = begin(bias={DriveKind.RIGHT: Axes(0.1, 0.05, 0.2)}, noise=True)
    ended = []
    mission.engine.watch(lambda event: ended.append(event) if hasattr(event, "before") else None)
    mission.give("d1-4")
    movement = next(each for each in ended if hasattr(each, "trajectory"))
    mission.give("d1-60")
    met = mission.attempt.collision
    assert met is not None
    exact = CounterfactualWorld(mission.attempt.spec, met).asked(movement)
    assert exact is not None
    assert (exact.x, exact.y, exact.r) == pytest.approx((4.0, 0.0, 0.0))


def test_errors_that_add_up_unseen_are_the_drives() -> None:
    mission = begin((30.0, 42.0, 0.0), bias={DriveKind.RIGHT: Axes(y=0.22)})
    mission.give("u1", "u2", "u4", *["d1-1"] * 14)
    cause = mission.why()
    assert (cause.kind, cause.sure) == (Kind.DRIVE_WRONG, LIKELY)
    assert cause.culprits == ("d1",)
    assert "d1-1 was sent 14 times in a row." in cause.text
    assert "It would have touched nothing without drive errors since the last reading." in cause.text


def test_errors_that_add_up_are_not_to_blame_where_the_program_looks_after_each_movement() -> None:
    mission = begin((30.0, 42.0, 0.0), bias={DriveKind.RIGHT: Axes(y=0.22)})
    mission.give(*["u1", "u2", "u4", "d1-1"] * 14)
    assert mission.why().kind is Kind.TOO_CLOSE


def test_a_wall_that_a_right_reading_had_shown_is_said_with_the_command() -> None:
    mission = begin((66.0, 42.0, 180.0))
    mission.give("u1", "d1-60")
    cause = mission.why()
    assert (cause.kind, cause.moment.kind) == (Kind.KNOWN_WALL, MomentKind.COMMAND)
    said = (
        r"At 50\.1 s, u1 \(ahead\) read 3\.0 in\. At 50\.1 s, d1-60 was sent\. "
        r"At 50\.6 s, the robot touched .*, after 3\.0 in of d1-60\."
    )
    assert re.fullmatch(said, cause.text)
    said = "Compare each movement with u1 before you send it, and print what your program has for it."
    assert cause.advice == said


def test_a_wall_that_a_right_belief_had_shown_is_known_too() -> None:
    mission = begin()
    mission.believe()
    mission.give("u1", "u2", "u4", "u5", "t1", "w1-5.5")
    cause = mission.why()
    assert cause.kind is Kind.KNOWN_WALL
    assert re.search(
        r" At 50\.3 s, w1-5\.5 was sent\. The belief sent at 50\.0 s was right, off by 0\.0 in and 0 deg; "
        r".*\. At 50\.8 s, the robot touched ",
        cause.text,
    )


def test_a_wrong_sensor_comes_before_what_follows_from_it() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4")
    mission.believe(ahead=-4.0)
    mission.give("d1-16.5")
    text = "u1 reads 3.0 in too long (2.9 to 3.1, 395 readings)"
    found = Finding("u1", FindingKind.OFFSET, 3.0, 2.9, 3.1, "in", 395, Basis.NOMINAL, text)
    cause = cause_of(mission.evidence(findings=(found,)))
    assert (cause.kind, cause.culprits, cause.text) == (Kind.SENSOR_WRONG, ("u1",), f"{text}.")
    drive = structs.replace(found, of="d1", text="d1 drives 1.20 times what is asked")
    cause = cause_of(mission.evidence(findings=(drive,)))
    assert (cause.kind, cause.text) == (Kind.DRIVE_WRONG, f"{drive.text}.")
    # A sensor that is dead needs no calibration.
    dead = structs.replace(found, kind=FindingKind.STUCK, text="u1 reads 7.5 in all the time")
    assert cause_of(mission.evidence(findings=(dead,))).advice.startswith("Check the cable")


# -- ends without a contact ------------------------------------------------------------------------


def test_a_grip_that_takes_nothing_says_by_how_much_and_on_which_side() -> None:
    mission = begin((30.0, 42.0, 180.0), (20.0, 44.0))
    mission.give("u1", "p1-1", "p1-0")
    cause = mission.why(1, words="failed")
    assert (cause.kind, cause.moment.kind) == (Kind.MISSED_GRIP, MomentKind.COMMAND)
    assert "the block's middle was 4.00 in too far ahead" in cause.text
    mission = begin((26.0, 44.5, 180.0), (20.0, 42.0))
    mission.give("p1-1", "p1-0", "p1-1")
    cause = mission.why(1)
    assert "it closed on nothing twice in all" in cause.text
    assert "0.50 in too far to the left" in cause.text


def test_a_grip_at_a_place_that_was_believed_wrongly_is_being_lost() -> None:
    mission = begin((30.0, 42.0, 180.0))
    mission.give("u1")
    mission.believe(ahead=-9.0)
    mission.give("p1-1")
    cause = mission.why(1, words="failed")
    assert cause.kind is Kind.LOST
    assert "it believed it was at (21.0, 42.0) and was at (30.0, 42.0), 9.0 in and 0 deg off" in cause.text
    assert re.search(r"\. At 50\.1 s, it closed the gripper", cause.text)


def test_a_block_dropped_elsewhere_says_how_far_outside() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4", "p1-1", "p1-0")
    cause = mission.why()
    assert cause.kind is Kind.DROPPED_OUTSIDE
    assert "40.0 in to the left of the drop zone's cell around (66.0, 42.0)" in cause.text
    assert cause.moment.place == pytest.approx((20.0, 42.0))


@pytest.mark.parametrize(
    ("after", "often"),
    [(("l1", "d1--3"), ""), (("d1--0.2", "d1-0.2", "d1--14"), "; it was there after 3 movements")],
)
def test_a_gripper_that_was_never_closed_is_said(after: tuple[str, ...], often: str) -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4", "u5", *after)
    cause = mission.why(1, words="failed")
    assert (cause.kind, cause.culprits, cause.advice) == (Kind.MISSED_GRIP, ("p1",), "Send p1-1 there.")
    said = "the block was between the jaws, and the gripper was never closed"
    assert cause.text == f"At 50.7 s, {said}{often}."


def test_a_robot_that_passes_over_the_block_once_before_any_goal_has_missed_no_grip() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4", "u5", "d1--14")
    assert mission.why(1, words="failed").kind is not Kind.MISSED_GRIP


def test_a_gripper_that_was_never_opened_is_said() -> None:
    mission = begin((28.0, 42.0, 180.0), zone=Cell(18.0, 42.0))
    mission.give("d1-4", "p1-1", "u1", "d1-1")
    cause = mission.why(1, words="failed")
    assert cause.kind is Kind.MISSED_GRIP
    assert "the block was in the drop zone, and the gripper was never opened." in cause.text


def test_the_only_sensor_that_sees_the_block_is_named_if_it_was_never_read() -> None:
    mission = begin((42.0, 42.0, 180.0))
    mission.give("u1", "d1-18.5", "d1--6")
    cause = mission.why(1, words="failed")
    assert (cause.kind, cause.culprits) == (Kind.UNREAD, ("u5",))
    assert cause.advice == "Read u5 before you drive to the block."
    mission = begin((42.0, 42.0, 180.0))
    mission.give("u1", "u5", "d1-18.5", "d1--6")
    assert mission.why(1, words="failed").kind is Kind.ENDED


def test_time_is_told_by_what_it_went_to() -> None:
    mission = begin(limit=60.0, change=lambda sensor: replace(sensor, read_time=0.5))
    for _ in range(25):
        mission.give("u5")
        mission.simulator.advance(max(mission.simulator.time, 50.5 + 0.5 * mission.attempt.commands))
    mission.give("u2", "w1-1", "s1-1")
    cause = mission.why()
    assert cause.kind is Kind.TOO_SLOW
    assert "Most of its time went to reading" in cause.text
    assert "It read sensors 20 times (u5 20 times, 10.0 s)." in cause.text


def test_moves_that_gain_nothing_lead_nowhere() -> None:
    mission = begin(limit=100.0)
    mission.give("u5", *("w1-2", "s1-2") * 200)
    cause = mission.why()
    assert cause.kind is Kind.GOT_NOWHERE
    said = "progress ended: 149 movements reached no goal and no new place (298 in): s1 75 times"
    assert cause.text.startswith(f"At 50.4 s, {said}")


def test_who_only_reads_until_time_is_up_gets_nowhere() -> None:
    mission = begin(limit=90.0)
    mission.give("w1-1", "u2", "u5", *("u1",) * 800)
    assert mission.referee.state().result is Result.FAILED
    cause = cause_of(RunEvidence(mission.attempt))
    assert (cause.kind, cause.culprits) == (Kind.GOT_NOWHERE, ())
    said = r"the last movement ended; after that came 664 readings, the last \d+ in by u1, at 90\.0 s\."
    assert re.match(rf"At 50\.2 s, {said}", cause.text)
    assert "the loop that only reads" in cause.advice


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
    assert cause.moment.kind is MomentKind.PROGRAM
    assert error + words in cause.text


def test_nothing_sent_is_silence() -> None:
    cause = begin().why()
    assert (cause.kind, cause.text) == (Kind.SILENCE, "The program sent no command at all.")


def test_boards_alone_that_do_nothing_are_no_program_without_commands() -> None:
    mission = begin()
    mission.engine.tell(DisplayChanged(mission.simulator.time, "rover"))
    mission.referee.end("the time limit of 300 s")
    cause = cause_of(RunEvidence(mission.attempt, None))
    assert (cause.kind, cause.text) == (Kind.SILENCE, "No board set a motor or read a sensor.")


@pytest.mark.parametrize("limit", ["the time limit", "the real time limit"])
def test_a_program_that_hangs_is_silent_from_its_last_command_on(limit: str) -> None:
    mission = begin()
    mission.give("u5", "d1-1")
    last = mission.simulator.time
    if "real" in limit:
        mission.referee.end(f"{limit} of 20 s")
        mission.history.real_time = 20.0
    else:
        mission.referee.check(400.0)
    run = RunEvidence(mission.attempt)
    cause = cause_of(run)
    assert cause.kind is Kind.SILENCE
    said = f"d1-1 was answered, and no command came after it until the run was ended at {limit}"
    assert cause.text.startswith(f"At {last:.1f} s, {said}.")
    [end] = [each for each in moments_of(run, cause.moment) if each.is_cause]
    assert end.text == said


def test_a_fault_of_the_connection_comes_before_all_else() -> None:
    mission = begin()
    text = "'u1u2' came without a line end: end each with a newline"
    mission.engine.tell(Notice(NoticeKind.FAULT, text, advice=True))
    mission.give("u1", "d1-60")
    run = mission.evidence()
    cause = cause_of(run)
    assert (cause.kind, cause.text) == (Kind.WIRE, f"At 50.0 s, {text}.")
    [fault] = [each for each in moments_of(run, cause.moment) if each.is_cause]
    assert (fault.kind, fault.text) == (MomentKind.FAULT, text)


def test_a_fault_that_refused_most_commands_is_told_with_their_number() -> None:
    mission = begin()
    mission.give(*("[u1]", "[u2]") * 30)
    text = "port 9000 takes lines; '[u1]' is a packet: start with --listeners packets"
    mission.engine.tell(Notice(NoticeKind.FAULT, text, advice=True))
    cause = mission.why(1, words="no reading")
    assert cause.kind is Kind.WIRE
    assert cause.text == f"At 50.0 s, {text}. In all, 60 of 60 commands were refused."


def test_who_ends_as_soon_as_it_knows_where_it_is_was_never_lost() -> None:
    mission = begin()
    for spread in (20.0, 20.0, 20.0, 0.3):
        mission.give("u5", "s1-0.5")
        mission.believe(spread=spread)
    assert mission.why(3).kind is Kind.ENDED


def test_who_is_lost_at_its_end_is_told_where_it_was() -> None:
    mission = begin()
    mission.give("u5")
    mission.believe()
    mission.give("w1-1", "u1")
    mission.believe(ahead=-4.0)
    cause = mission.why(1, words="failed")
    assert cause.kind is Kind.LOST
    assert re.search(
        r"believed it was at \(26\.0, 43\.0\) and was at \(30\.0, 43\.0\), .* s, the program ended",
        cause.text,
    )


def test_who_never_knew_where_it_was_is_told_so() -> None:
    mission = begin()
    for _ in range(5):
        mission.give("u5", "s1-0.5")
        mission.believe(spread=20.0)
    cause = mission.why(1, words="failed")
    assert cause.kind is Kind.LOST
    assert cause.text.startswith(
        "At 50.7 s, its last belief was off by 0.0 in and 0 deg, with a spread of 20.0 in: it was not sure "
        "of its place. At 50.7 s, the program ended by itself, with exit code 1"
    )


def test_a_constant_offset_of_the_beliefs_stands_behind_being_lost() -> None:
    mission = begin()
    for _ in range(12):
        mission.give("u5", "w1-0.3", "s1-0.3")
        mission.believe(ahead=12.0)
    cause = mission.why(1, words="failed")
    assert cause.kind is Kind.LOST
    assert "(+12.0, +0.0) in beside the truth in 100 % of the sure beliefs, as with a map" in cause.text


# -- commands --------------------------------------------------------------------------------------


def test_a_command_that_was_refused_is_said() -> None:
    mission = begin()
    mission.give("u1", "d1-x")
    cause = mission.why(1, words="failed")
    assert (cause.kind, cause.culprits, cause.moment.kind) == (Kind.REFUSED, ("d1",), MomentKind.FAULT)
    assert re.match(r"At 50\.\d s, d1-x was refused: .*\. In all, 1 of 2 commands was refused\.$", cause.text)


@pytest.mark.parametrize("last", [(), ("d1-16",)])
def test_who_is_mostly_refused_got_nowhere_because_of_that(last: tuple[str, ...]) -> None:
    mission = begin()
    mission.give("u1", "d1-1", *("u1", "d1-0,5", "r1-12,5") * 60, *last)
    cause = mission.why(1, words="failed")
    assert (cause.kind, cause.culprits) == (Kind.REFUSED, ("d1", "r1"))
    assert cause.text.startswith("At 50.3 s, d1-0,5 was refused: '0,5' is not a finite decimal number")
    assert re.search(r"\? In all, 120 of 12\d commands to drive were refused\.$", cause.text)


def drive_in_packets(mission: Mission, *commands: str, probe: str = "d1-0", look: bool = False) -> None:
    """Timed movements, each followed by movements of 0 that are refused until it has ended, with `look` after
    a reading each."""
    read = ("u1",) if look else ()
    for command in commands:
        mission.give("u5", command)
        for _ in range(4):
            mission.give(*read)
            mission.ask_while_moving(probe)
        mission.give(*read, probe)


def test_who_asks_in_packets_until_a_movement_has_ended_is_not_mostly_refused() -> None:
    mission = begin()
    drive_in_packets(mission, *("d1-2", "d1--2") * 6, "d1-60")
    assert mission.why().kind not in (Kind.REFUSED, Kind.MOVED)


def test_commands_of_a_person_or_beside_a_velocity_are_not_mostly_refused() -> None:
    mission = begin()
    mission.give("u1", *("d1-0,5",) * 12, source="console")
    mission.give(*("u1", "d1-0.5") * 9)
    assert mission.why(1).kind is not Kind.REFUSED
    mission = begin()
    mission.give(*("u1", "vv-2;0;0", "wt-0.2", "vv--2;0;0", "wt-0.2") * 9, *("d1-0,5",) * 9)
    assert mission.attempt.refused_drives(0.0) == (["d1"], 9, 27)


def test_commands_that_ask_for_nothing_lead_nowhere() -> None:
    mission = begin()
    mission.give(*("u5", "d1-0", "u2", "w1-0", "u1", "r1-1") * 40)
    cause = mission.why(1)
    assert cause.kind is Kind.GOT_NOWHERE
    assert "w1 40 times, mostly by 0; r1 40 times, mostly by 1; d1 39 times, mostly by 0." in cause.text


# -- the order, and the moments ----------------------------------------------------------------------


MARKED: list[tuple[str, ...]] = [
    ("u1", "d1-60"),
    ("d1-4", "w1-30"),
    ("r1-x", "u1", "d1-y"),
    ("u1", "d1-0,5", "u1", "r1-a", "u1", "r1-0,5"),
    ("p1-1",),
    ("p1-1", "p1-1"),
    *((f"u{place}",) for place in (1, 2)),
]


@pytest.mark.parametrize("off", [None, 0.0, 14.0])
def test_the_marked_moment_is_that_of_the_cause(off: float | None) -> None:
    for commands in MARKED:
        mission = begin((66.0, 42.0, 180.0))
        if off is not None:
            mission.give("d1-0.5")
            mission.believe(off)
        mission.give(*commands)
        run = mission.evidence(1, words="failed")
        cause = cause_of(run)
        (marked,) = (each for each in moments_of(run, cause.moment) if each.is_cause)
        assert (marked.elapsed, marked.kind) == (cause.elapsed, cause.moment.kind)
        # It names the command of the sentence, never another of its kind.
        named = re.search(r"^(\S+-\S+?) was", marked.text)
        assert named is None or named[1] in cause.text


def test_each_kind_has_one_rule_and_one_line_of_advice_at_most() -> None:
    assert [each.kind for each in (*ORDER, NO_RULE)] == list(Kind)
    assert len(ORDER) <= 16
    assert all("\n" not in each.advice and "log" not in each.advice.split() for each in ORDER)
    assert all("log" not in each.when.split() for each in ORDER)


def test_a_success_has_moments_and_no_mark() -> None:
    mission = begin((28.0, 42.0, 180.0), zone=Cell(30.0, 42.0))
    mission.give("d1-4", "p1-1", "a1-9", "p1-0")
    moments = moments_of(RunEvidence(mission.attempt))
    assert moments[-1].text == "the mission succeeded"
    assert not any(each.is_cause for each in moments)


def test_of_many_moments_seven_are_kept_in_order() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("u1", "d1-x", "u2", "u4")
    mission.believe()
    mission.give("d1-4", "p1-1", "r1-90", "u5")
    mission.believe(ahead=-6.0)
    teleport(mission, 66.0, 42.0, 180.0)
    mission.give("u1", "d1-60")
    run = mission.evidence()
    cause = cause_of(run)
    moments = moments_of(run, cause.moment)
    assert len(moments) <= MOST_MOMENTS
    assert [each.elapsed for each in moments] == sorted(each.elapsed for each in moments)
    kinds = [each.kind for each in moments]
    assert {MomentKind.END, MomentKind.COMMAND, MomentKind.SIGHT, MomentKind.FAULT} <= set(kinds)
    assert [each.kind for each in moments if each.is_cause] == [cause.moment.kind]
    assert all("log" not in each.text.split() for each in moments)
    assert "a person moved the robot by 42 in and 90 deg, to (66.0, 42.0)" in {
        each.text for each in moments_of(run)
    }


def test_a_real_robot_has_moments_and_no_place() -> None:
    mission = begin()
    mission.history.is_twin = True
    mission.give("u1", "d1-2")
    began = moments_of(mission.evidence(1))[0]
    assert began.text == "the run began on a real robot, whose true place is not known"
    assert began.place is None


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
    assert (cause.kind, cause.moment.kind) == (Kind.MOVED, MomentKind.PERSON)
    assert re.match(
        r"At [\d.]+ s, a person moved the robot by 26 in and 90 deg, to \(8\.0, 30\.0\)\. No belief",
        cause.text,
    )


def test_a_person_who_moved_the_robot_explains_what_followed() -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    teleport(mission, 8.0, 30.0, 90.0)
    mission.give("u1", "d1-5", "d1-60")
    assert mission.why().kind is Kind.MOVED


@pytest.mark.parametrize("source", ["keys", "console"])
def test_a_person_who_drives_beside_the_program_is_named(source: str) -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    mission.believe()
    mission.give("r1-90", source=source)
    mission.believe(turn=-90.0)
    mission.give("u1", "d1-60")
    cause = mission.why()
    assert cause.kind is Kind.MOVED
    assert re.match(r"At [\d.]+ s, a person drove the robot beside its program: r1-90\.", cause.text)


def test_a_person_who_drives_into_a_wall_is_named_whatever_was_believed() -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    mission.believe()
    mission.give("w1-9", source="keys")
    cause = mission.why()
    assert cause.kind is Kind.MOVED
    assert re.match(r"At [\d.]+ s, a person drove the robot beside its program: w1-9\.", cause.text)


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


def test_a_reading_after_a_velocity_is_told_after_it() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4", "vv-6;0;0", *("wt-0.4", "u1") * 12)
    text = mission.why().text
    assert re.match(
        r"At 50\.\d s, vv-6;0;0 was sent, and nothing ended it\. At 52\.\d s, u1 \(ahead\) read ",
        text,
    )


def test_the_sensor_that_looks_along_a_movement_and_was_never_read_is_told() -> None:
    mission = begin()
    mission.give("u2", "d1-4", "u2", "d1-4", "u2", "d1-4", "u2", "d1-4")
    cause = mission.why()
    assert " s, u1 (ahead) had not been read yet." in cause.text
    assert cause.advice == "Read u1 before you send d1."


def test_a_belief_that_was_off_is_told_at_a_contact() -> None:
    mission = begin()
    mission.give("u1", "u2", "u4")
    mission.believe(ahead=1.5, spread=1.0)
    mission.give("d1-60")
    assert " s was off by 1.5 in and 0 deg; its spread was 1.0 in. At " in mission.why().text


def test_a_program_without_the_token_is_told_to_send_it() -> None:
    mission = begin()
    text = "a connection from 127.0.0.1 turned away: its first line is not the --token"
    mission.engine.tell(Notice(NoticeKind.TURNED_AWAY, text))
    cause = mission.why(1)
    assert cause.text.endswith(" s, a program was turned away: its first line is not the --token.")
    assert cause.advice.startswith("Send the simulator's token")


def test_a_second_client_beside_the_first_is_said_first() -> None:
    mission = begin()
    connection(mission, NoticeKind.CONNECTED)
    mission.give("u1", "d1-1")
    connection(mission, NoticeKind.CONNECTED)
    mission.give("u1", "d1-60")
    cause = mission.why(1)
    assert (cause.kind, cause.moment.kind) == (Kind.MOVED, MomentKind.PERSON)
    assert re.match(r"At 50\.\d s, a second client connected beside the first ", cause.text)


def test_a_movement_that_came_twice_before_a_contact_says_so() -> None:
    mission = begin()
    mission.give("d1-2", "w1-1.6", "w1-1.6")
    assert " s, w1-1.6 was sent twice in a row. " in mission.why().text


def test_a_refused_closing_of_the_gripper_comes_before_what_followed() -> None:
    mission = begin((28.0, 42.0, 180.0))
    mission.give("d1-4", "u5", "p1-90", "p1-90", "d1--14")
    cause = mission.why(1, words="failed")
    assert (cause.kind, cause.culprits) == (Kind.REFUSED, ("p1",))
    assert cause.text.startswith("At 50.7 s, p1-90 was refused: ")
    assert cause.text.endswith(". In all, 2 of 5 commands were refused.")


def test_a_person_who_drives_into_a_wall_after_the_program_left_did_not_drive_beside_it() -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    connection(mission, NoticeKind.LEFT)
    mission.give("w1-9", source="keys")
    assert mission.why().kind is not Kind.MOVED


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
    assert re.match(r"At [\d.]+ s, a person moved the block to \(66.0, 42.0\)\.", cause.text)


@pytest.mark.parametrize(("movements", "kind"), [(2, Kind.TOO_CLOSE), (24, Kind.MOVED)])
def test_a_contact_long_after_a_person_moved_the_block_came_of_searching(movements: int, kind: Kind) -> None:
    mission = begin()
    mission.give("u1", "d1-1")
    mission.engine.perform(Action(ActionName.BLOCK, (66.0, 42.0)))
    mission.give(*["u1", "r1-15"] * movements, "u1", "u2", "u4", "w1-4")
    assert mission.why().kind is kind


# -- drives that are no longer commanded, and corrections --------------------------------------------


def correct(mission: Mission, share: float) -> None:
    """Turn to a heading and back in a few corrections; the robot gets a share of each."""
    for around in range(6):
        mission.give("r1-10", "u5")
        heading = mission.simulator.pose.heading + 3.0 * (-1) ** around
        for _ in range(6):
            off = math.remainder(heading - mission.simulator.pose.heading, 360.0)
            if not 0.5 <= abs(off) <= 120.0:
                break
            mission.give(f"r1-{share * off:.2f}", "u5")


@pytest.mark.parametrize(
    ("share", "said", "advice"),
    [
        (-1.0, r"2\.0 times the one before", "Check the sign of r1's value"),
        (3.0, r"2\.0 times the one before, to the other side", "Check the unit of r1's value"),
    ],
)
def test_corrections_that_grow_name_their_drive(share: float, said: str, advice: str) -> None:
    mission = begin(noise=True)
    correct(mission, share)
    cause = mission.why(1, words="failed")
    assert (cause.kind, cause.culprits) == (Kind.GOT_NOWHERE, ("r1",))
    assert re.match(rf"At 5\d\.\d s, \d+ of its movements by r1 were each {said}\.", cause.text)
    assert cause.advice.startswith(advice)


def test_corrections_that_grow_stand_before_the_contact_they_led_to() -> None:
    mission = begin(noise=True)
    correct(mission, -1.0)
    mission.give(f"r1-{math.remainder(-mission.simulator.pose.heading, 360.0):.2f}")
    mission.give("u1", "u2", "u4", "u5", "t1", "w1-4.2")
    cause = mission.why()
    assert cause.kind is Kind.GOT_NOWHERE
    assert re.search(
        r"each 2\.0 times the one before\. At \d+\.\d s, w1-4\.2 was sent\. At \d+\.\d s, the robot touched ",
        cause.text,
    )


def test_corrections_that_shrink_name_nobody() -> None:
    mission = begin(noise=True)
    correct(mission, 0.8)
    assert not mission.evidence(1).corrections


def test_a_crash_after_commands_without_effect_tells_of_them() -> None:
    mission = begin()
    mission.give(*("u5", "d1-0") * 110)
    cause = mission.why(1, error="LostError: it does not get there")
    assert cause.kind is Kind.CRASHED
    assert " s, progress ended: 109 movements reached no goal and no new place (0 in): " in cause.text
    assert "d1 109 times, mostly by 0." in cause.text
