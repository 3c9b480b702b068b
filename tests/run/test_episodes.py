"""Episodes of beliefs: a change counts once it lasts, and what people do is told as what it is."""

import math

import pytest

from simmer_tui.report.episode_table import episode_text, episodes_table
from simmer_tui.robot.engine import Engine
from simmer_tui.run.episodes import Episode, EpisodeKind
from simmer_tui.run.events import Action, ActionName, Belief
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.state import checkpoint_of
from simmer_tui.sim import Pose, Simulator, parse_command
from tests.report.test_causes import SET


class Told:
    """A robot that drives to and fro in a corridor and tells a belief after each movement."""

    def __init__(self) -> None:
        self.simulator = Simulator(SET.simulation, 3)
        self.simulator.noise = False
        self.engine = Engine(self.simulator)
        self.history = RunHistory(checkpoint_of(self.simulator))
        self.engine.watch(Reducer(checkpoint_of(self.simulator), history=self.history).apply)
        self.moves = 0

    def go(self, x: float, y: float, heading: float = 0.0) -> None:
        self.engine.perform(Action(ActionName.TELEPORT, (x, y, heading)))

    def drive(self, command: str = "") -> None:
        self.moves += 1
        text = command or ("d1--3" if (self.moves - 1) // 4 % 2 else "d1-3")
        self.engine.session().submit(parse_command(text), lambda outcome: None)

    def tell(self, ahead: float = 0.0, turn: float = 0.0, spread: float = 0.3) -> None:
        pose = self.simulator.pose
        believed = Pose(pose.x + ahead, pose.y, pose.heading + turn)
        self.engine.tell(Belief(self.simulator.time, believed, pose, spread))

    def tells(self, *ahead: float) -> None:
        for off in ahead:
            self.drive()
            self.tell(off)

    @property
    def kinds(self) -> list[str]:
        return [each.kind.value for each in self.episodes()]

    def episodes(self, *, ended_badly: bool = False) -> list[Episode]:
        return self.history.episodes.so_far(ended_badly=ended_badly)


@pytest.fixture
def told() -> Told:
    return Told()


def test_before_it_was_localized_nothing_is_lost(told: Told) -> None:
    told.tells(*[24.0] * 9, *[0.1] * 9)
    assert told.kinds == ["localized"]
    assert told.episodes()[0].line == 0
    assert told.episodes()[0].distance == pytest.approx(0.1)


def test_being_off_for_a_moment_is_not_being_lost(told: Told) -> None:
    told.tells(*[0.1] * 6, *[2.0] * 3, *[0.1] * 6)
    assert told.kinds == ["localized"]


def test_being_off_for_a_cell_of_way_is_being_lost_from_its_beginning_on(told: Told) -> None:
    told.tells(*[0.1] * 6)
    told.tells(*[2.0] * 6, *[0.1] * 6)
    _, lost, again = told.episodes()
    assert (lost.kind, lost.distance, lost.touched, lost.moved) == (EpisodeKind.LOST, 2.0, None, None)
    assert told.history.beliefs[6].elapsed == lost.elapsed
    assert again.again
    assert "localized again" in episode_text(again)


def test_a_run_that_ends_badly_need_not_have_been_off_for_long(told: Told) -> None:
    told.tells(*[0.1] * 6, *[2.0] * 2)
    assert told.kinds == ["localized"]
    assert [each.kind for each in told.episodes(ended_badly=True)][1:] == [EpisodeKind.LOST]


def test_a_belief_turned_by_half_a_turn_is_never_right(told: Told) -> None:
    for _ in range(9):
        told.drive()
        told.tell(turn=180.0)
    assert told.kinds == []


def test_a_vague_belief_that_covers_the_truth_says_nothing(told: Told) -> None:
    for _ in range(9):
        told.drive()
        told.tell(ahead=2.0, spread=20.0)
    assert told.kinds == []


def test_a_frozen_belief_is_seen_however_vague_it_says_it_is(told: Told) -> None:
    told.tells(*[0.1] * 6)
    pose = told.simulator.pose
    for _ in range(9):
        told.drive("d1-2")
        told.engine.tell(Belief(told.simulator.time, pose, told.simulator.pose, 20.0))
    assert told.kinds == ["localized", "frozen"]
    assert "the pose sent stayed the same while the robot moved by 4." in episode_text(told.episodes()[1])


def test_a_robot_that_stands_may_tell_one_pose_for_ever(told: Told) -> None:
    for _ in range(9):
        told.tell()
    assert told.kinds == ["localized"]


def test_a_person_who_moves_the_robot_is_told_at_once_and_so_is_who_is_lost_by_it(told: Told) -> None:
    told.tells(*[0.1] * 6)
    told.go(66.0, 42.0, 90.0)
    told.tell(ahead=-56.5)
    localized, moved, lost = told.episodes()
    assert localized.kind is EpisodeKind.LOCALIZED
    assert moved.kind is EpisodeKind.MOVED
    assert moved.turn == pytest.approx(90.0, abs=5.0)
    assert moved.distance > 50.0
    assert lost.moved is not None
    assert "s after a person moved the robot, by 56.5 in" in episode_text(lost)
    assert episodes_table(told.history, ended_badly=False).rows[2][5] == "a person moved the robot"


def test_a_program_that_notices_that_it_was_moved_is_not_lost(told: Told) -> None:
    told.tells(*[0.1] * 6)
    told.go(66.0, 42.0)
    told.tells(*[0.1] * 6)
    assert told.kinds == ["localized", "moved"]


def test_what_is_lost_by_a_contact_says_so(told: Told) -> None:
    told.tells(*[0.1] * 6)
    told.drive("w1-30")
    told.drive("s1-1")
    told.tells(*[2.0] * 7)
    assert "after the contact of line 0" in episode_text(told.episodes()[1])


def test_a_run_restarted_later_has_its_own_episodes(told: Told) -> None:
    told.tells(*[0.1] * 6)
    told.engine.perform(Action(ActionName.BLOCK, (42.0, 42.0)))
    assert told.kinds == ["localized", "block moved"]
    told.engine.perform(Action(ActionName.RESET))
    told.tell(ahead=math.inf)
    assert told.kinds == ["restarted"]
