"""The engine on a clock that the test moves: order, fairness, delays, timed motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import pytest
from msgspec.structs import replace

from simmer_tui.robot.engine import Engine
from simmer_tui.robot.link_delay import LinkDelay
from simmer_tui.robot.sessions import SLICE, SLICE_SECONDS, Session
from simmer_tui.run.events import (
    Action,
    ActionDone,
    ActionName,
    Event,
    LegEnded,
    MovementEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
)
from simmer_tui.sim import Command, CommandResult, SimulationSpec, Simulator, Status, parse_command
from simmer_tui.sim.sensors import Lidar, LidarSpec
from simmer_tui.sim.specs import Axes, VelocityKind, VelocitySpec
from tests.stepped_clock import Clock


class Bench:
    """An engine on a clock, with all that happened."""

    def __init__(self, clock: Clock, spec: SimulationSpec, **options: Any) -> None:
        self.clock = clock
        self.simulator = Simulator(spec, seed=3)
        self.engine = Engine(self.simulator, **options)
        self.events: list[Event] = []
        self.answers: list[tuple[float, str, CommandResult]] = []
        self.engine.watch(self.events.append)
        self.engine.start(clock)

    def session(self, answer_at_end: bool = True) -> Session:
        return self.engine.session(answer_at_end=answer_at_end)

    def send(self, session: Session, *texts: str) -> None:
        for text in texts:
            session.submit(parse_command(text), self._note)

    def _note(self, outcome: CommandResult) -> None:
        self.answers.append((self.clock.time(), outcome.command.text, outcome))

    def act(self, name: ActionName, *arguments: float) -> ActionDone:
        return self.engine.perform(Action(name, arguments))

    @property
    def answered(self) -> list[tuple[float, str]]:
        return [(round(time, 6), text) for time, text, _ in self.answers]

    @property
    def told(self) -> list[str]:
        """Events that watchers got, in short."""
        return [
            event.command.text if isinstance(event, CommandResult) else event.action.name.value
            for event in self.events
            if isinstance(event, CommandResult | ActionDone)
        ]


@pytest.fixture
def clock() -> Iterator[Clock]:
    loop = Clock(0.0)
    yield loop
    loop.close()


@pytest.fixture
def instant(clock: Clock, course_spec: SimulationSpec) -> Bench:
    return Bench(clock, course_spec)


@pytest.fixture
def timed(clock: Clock, course_spec: SimulationSpec) -> Bench:
    return Bench(clock, course_spec, timed=True)


# -- order and fairness ----------------------------------------------------------------------


def test_a_command_is_done_before_submit_returns(instant: Bench) -> None:
    instant.send(instant.session(), "d1-2")
    assert instant.simulator.pose.x == pytest.approx(11.5)
    assert instant.answers[0][2].reply == math.inf
    planned, ended, outcome = instant.events
    assert isinstance(planned, MovementPlanned)
    assert isinstance(ended, MovementEnded)
    assert outcome == instant.answers[0][2]


def test_commands_are_answered_in_order_whatever_they_are(instant: Bench) -> None:
    texts = ["u1", "d1-1", "", "zz", "d1-", "o3", "d1-inf"]
    instant.send(instant.session(), *texts)
    assert [text for _, text, _ in instant.answers] == texts
    statuses = [outcome.status for _, _, outcome in instant.answers]
    assert statuses == [
        Status.READING,
        Status.DONE,
        Status.REFUSED,
        Status.UNKNOWN,
        Status.REFUSED,
        Status.READING,
        Status.REFUSED,
    ]
    assert [outcome.number for _, _, outcome in instant.answers] == list(range(1, 8))


def stop() -> Command:
    return replace(parse_command("xx"), stops=True)


def test_a_flood_of_stops_leaves_room_for_another(instant: Bench) -> None:
    flood, other = instant.session(), instant.session()

    def give() -> None:
        for _ in range(2000):
            flood.submit(stop(), instant._note)

    instant.clock.call_soon(give)
    instant.clock.call_soon(instant.send, other, "o3")
    instant.clock.settle()
    assert [text for _, text, _ in instant.answers].index("o3") <= 2 * SLICE
    while len(instant.answers) < 2001:
        instant.clock.settle()
    assert [outcome.number for _, _, outcome in instant.answers] == list(range(1, 2002))


def test_a_stop_after_many_goes_ahead_of_what_was_given_since(timed: Bench) -> None:
    flood, driver = timed.session(), timed.session()
    for _ in range(SLICE + 10):
        flood.submit(stop(), lambda outcome: None)
    timed.send(driver, "d1-3", "d1-6")
    timed.clock.pass_by(0.1)
    timed.engine.session().submit(stop(), lambda outcome: None)
    assert not timed.simulator.moving
    timed.clock.pass_by(5.0)
    moved = [event.trajectory.duration for event in timed.events if isinstance(event, MovementPlanned)]
    assert len(moved) <= 1, "the second came before the stop and does not begin"


def test_a_flood_from_one_session_leaves_room_for_another(instant: Bench) -> None:
    flood, other = instant.session(), instant.session()
    instant.clock.call_soon(instant.send, flood, *["u1"] * 2000)
    instant.clock.call_soon(instant.send, other, "o3")
    instant.clock.settle()
    place = [text for _, text, _ in instant.answers].index("o3")
    assert place <= 2 * SLICE
    while len(instant.answers) < 2001:
        instant.clock.settle()


def test_one_by_one_a_flood_gives_the_loop_its_turn_as_well(instant: Bench) -> None:
    session = instant.session()
    turns = []

    def count() -> None:
        turns.append(len(instant.answers))
        if len(instant.answers) < 1000:
            instant.clock.call_soon(count)

    def flood() -> None:
        for _ in range(1000):
            instant.send(session, "u1")
        turns.append(len(instant.answers))

    instant.clock.call_soon(count)
    instant.clock.call_soon(flood)
    while len(instant.answers) < 1000:
        instant.clock.settle()
    gaps = [after - before for before, after in pairwise(turns)]
    assert max(gaps) <= SLICE


def test_two_sessions_with_much_to_do_take_turns(instant: Bench) -> None:
    first, second = instant.session(), instant.session()
    instant.act(ActionName.PAUSE)
    instant.send(first, "u1", "u1", "u1")
    instant.send(second, "u2", "u2", "u2")
    instant.act(ActionName.RESUME)
    assert [text for _, text, _ in instant.answers] == ["u1", "u2", "u1", "u2", "u1", "u2"]


def test_a_crowd_in_one_lane_gets_no_more_turns_than_one_sender_in_another(instant: Bench) -> None:
    crowd = [instant.engine.session(lane="crowd") for _ in range(100)]
    instant.clock.call_soon(lambda: [instant.send(each, "u1", "u1") for each in crowd])
    instant.clock.call_soon(instant.send, instant.session(), "o3")
    instant.clock.settle()
    place = [text for _, text, _ in instant.answers].index("o3")
    assert place <= SLICE, "it is done in the turn in which it comes"
    while len(instant.answers) < 201:
        instant.clock.settle()


def test_a_sender_without_a_lane_has_one_of_its_own(instant: Bench) -> None:
    """A person's key goes before the commands that a program has sent, when its slice is used up too."""
    program, person = instant.session(), instant.session()
    instant.clock.call_soon(instant.send, program, *["u1"] * 100)
    instant.clock.call_soon(instant.send, person, "o3")
    instant.clock.settle()
    assert [text for _, text, _ in instant.answers].index("o3") <= SLICE
    while len(instant.answers) < 101:
        instant.clock.settle()
    assert not instant.engine.has_waiting


def test_what_waits_in_a_pause_is_known_when_a_slice_is_used_up(instant: Bench) -> None:
    def send_and_pause() -> None:
        instant.send(instant.session(), *["u1"] * (SLICE + 1))
        instant.act(ActionName.PAUSE)
        assert instant.engine.has_waiting

    instant.clock.call_soon(send_and_pause)
    instant.clock.settle()
    assert instant.engine.has_waiting
    assert len(instant.answers) == SLICE


def test_commands_of_a_crowd_that_take_long_use_up_its_slice_by_their_time(instant: Bench) -> None:
    def take_long(event: Event) -> None:
        instant.clock.selector.now += SLICE_SECONDS / 4

    instant.engine.watch(take_long)
    instant.clock.call_soon(instant.send, instant.engine.session(lane="crowd"), *["u1"] * 100)
    turns: list[int] = []

    def count() -> None:
        turns.append(len(instant.answers))
        if turns[-1] < 100:
            instant.clock.call_soon(count)

    instant.clock.call_soon(count)
    while len(instant.answers) < 100:
        instant.clock.settle()
    assert 0 < max(after - before for before, after in pairwise([0, *turns])) < SLICE


def test_an_answer_may_bring_the_next_command(instant: Bench) -> None:
    session = instant.session()
    seen: list[str] = []

    def again(outcome: CommandResult) -> None:
        seen.append(outcome.command.text)
        if len(seen) < 5:
            session.submit(parse_command(f"u{len(seen)}"), again)

    session.submit(parse_command("o1"), again)
    assert seen == ["o1", "u1", "u2", "u3", "u4"]


def test_a_closed_session_is_forgotten(clock: Clock, course_spec: SimulationSpec) -> None:
    bench = Bench(clock, course_spec, step_time=0.5)
    session, other = bench.session(), bench.session()
    bench.send(session, "d1-1", "d1-1", "d1-1")
    session.close()
    bench.send(session, "d1-1")
    bench.send(other, "o3")
    clock.pass_by(5)
    assert bench.answered == [(0.5, "o3")]
    assert bench.simulator.pose.x == pytest.approx(10.5), "what was begun is done, the rest is not"


# -- watchers --------------------------------------------------------------------------------


def test_a_watcher_that_fails_is_dropped_and_the_robot_goes_on(instant: Bench) -> None:
    def broken(event: Event) -> None:
        raise RuntimeError("out of paper")

    instant.engine.watch(broken)
    session = instant.session()
    instant.send(session, "u1", "u2")
    assert [text for _, text, _ in instant.answers] == ["u1", "u2"]
    notices = [event for event in instant.events if isinstance(event, Notice)]
    assert [notice.kind for notice in notices] == [NoticeKind.FAULT]
    assert "out of paper" in notices[0].text


def test_one_who_no_longer_watches_hears_nothing(instant: Bench) -> None:
    instant.engine.unwatch(instant.events.append)
    instant.engine.unwatch(instant.events.append)
    instant.send(instant.session(), "u1")
    assert instant.events == []


# -- step_time -------------------------------------------------------------------------------


def test_step_time_delays_each_reply_and_blocks_nobody(clock: Clock, course_spec: SimulationSpec) -> None:
    bench = Bench(clock, course_spec, step_time=0.5)
    first, second = bench.session(), bench.session()
    ticks: list[float] = []
    clock.call_later(0.25, lambda: ticks.append(clock.time()))
    bench.send(first, "u1", "d1-1", "zz")
    bench.send(second, "o3")
    assert bench.answers == []
    clock.pass_by(2)
    assert sorted(bench.answered) == [(0.5, "o3"), (0.5, "u1"), (1.0, "d1-1"), (1.5, "zz")]
    assert ticks == [pytest.approx(0.25)]


# -- what people do --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "arguments", "check"),
    [
        (ActionName.TELEPORT, (54.0, 30.0, -725.0), lambda s: s.pose.heading == -725.0),
        (ActionName.BLOCK, (66.0, 42.0), lambda s: (s.block.x, s.block.y) == (66.0, 42.0)),
        (ActionName.SEED, (11,), lambda s: s.seed == 11),
        (ActionName.NOISE, (0,), lambda s: s.noise is False),
        (ActionName.NOISE, (1,), lambda s: s.noise is True),
        (ActionName.RESET, (), lambda s: s.pose.x == 9.5),
    ],
)
def test_actions_are_done_and_told(
    instant: Bench, name: ActionName, arguments: tuple[float, ...], check: Callable[[Simulator], bool]
) -> None:
    done = instant.act(name, *arguments)
    assert not done.refused
    assert done.text
    assert check(instant.simulator)
    assert instant.events == [done]


@pytest.mark.parametrize(
    ("name", "arguments", "reason"),
    [
        (ActionName.TELEPORT, (6.0, 6.0, 0.0), ""),
        (ActionName.TELEPORT, (48.0, 42.0, 0.0), "overlaps"),
        (ActionName.TELEPORT, (math.nan, 42.0, 0.0), "finite"),
        (ActionName.TELEPORT, (9.5,), "takes 3 numbers"),
        (ActionName.BLOCK, (1000.0, 0.0), "outside the maze"),
        (ActionName.BLOCK, (54.0, 6.0), ""),
        (ActionName.SEED, (-1,), "whole number"),
        (ActionName.SEED, (1.5,), "whole number"),
        (ActionName.SEED, (math.inf,), "whole number"),
        (ActionName.SEED, (math.nan,), "whole number"),
        (ActionName.TIME_SCALE, (0.0,), "between"),
        (ActionName.TIME_SCALE, (math.nan,), "between"),
        (ActionName.PAUSE, (1.0,), "takes 0 numbers"),
    ],
)
def test_what_cannot_be_done_is_refused_with_the_reason(
    instant: Bench, name: ActionName, arguments: tuple[float, ...], reason: str
) -> None:
    before = (instant.simulator.pose, instant.simulator.seed, instant.simulator.block)
    done = instant.act(name, *arguments)
    if reason:
        assert done.refused
        assert reason in done.text
        assert before == (instant.simulator.pose, instant.simulator.seed, instant.simulator.block)
    else:
        assert not done.refused
    assert instant.events == [done]


def test_bias_is_muted_and_drawn_again_from_the_same_seed(clock: Clock, noisy_spec: SimulationSpec) -> None:
    bench = Bench(clock, noisy_spec)
    drawn = dict(bench.simulator.bias)
    bench.act(ActionName.BIAS, 0)
    assert all(bench.simulator.bias[drive.kind] == Axes() for drive in noisy_spec.drives)
    bench.act(ActionName.BIAS, 1)
    assert bench.simulator.bias == drawn


def test_time_that_is_over_stands_still_until_the_run_restarts(timed: Bench) -> None:
    timed.clock.pass_by(0.5)
    timed.engine.now()
    timed.engine.end_time()
    timed.clock.pass_by(2.0)
    assert (timed.engine.now(), timed.engine.present) == (0.5, 0.5)
    timed.act(ActionName.RESET)
    timed.clock.pass_by(0.25)
    assert timed.engine.now() == pytest.approx(0.25)


def test_in_a_pause_commands_wait_and_go_on_in_order(instant: Bench) -> None:
    session = instant.session()
    instant.act(ActionName.PAUSE)
    assert instant.engine.paused
    assert not instant.engine.has_waiting
    instant.send(session, "u1", "d1-1")
    assert instant.answers == []
    assert instant.engine.has_waiting
    instant.engine.step()
    assert [text for _, text, _ in instant.answers] == ["u1"]
    instant.act(ActionName.RESUME)
    assert [text for _, text, _ in instant.answers] == ["u1", "d1-1"]
    assert instant.told == ["pause", "u1", "resume", "d1-1"]
    instant.engine.step()
    assert len(instant.answers) == 2, "without a pause there is nothing to step"


# -- timed motion ----------------------------------------------------------------------------


def test_a_timed_drive_is_answered_when_it_ends(timed: Bench) -> None:
    driver, watcher = timed.session(), timed.session()
    timed.send(driver, "d1-6", "o3")
    assert timed.simulator.moving
    timed.clock.pass_by(0.5)
    timed.send(watcher, "o3")
    assert timed.answered == [(0.5, "o3")], "a sensor read never waits for another's drive"
    assert timed.answers[0][2].reply == pytest.approx(3.0)
    assert timed.simulator.pose.x == pytest.approx(12.5)
    timed.clock.pass_by(1)
    assert timed.answered == [(0.5, "o3"), (1.0, "d1-6"), (1.0, "o3")]
    done = timed.answers[1][2]
    assert (done.status, done.reply) == (Status.DONE, math.inf)
    assert done.time == pytest.approx(1.0)
    assert done.pose.x == pytest.approx(15.5)
    assert timed.answers[2][2].reply == pytest.approx(6.0)


def test_a_turn_takes_its_angle_by_its_speed(timed: Bench) -> None:
    timed.send(timed.session(), "r1--90")
    timed.clock.pass_by(0.25)
    timed.engine.now()
    assert timed.simulator.pose.heading == pytest.approx(-30.0)
    timed.clock.pass_by(1)
    assert timed.answered == [(0.75, "r1--90")]


def test_a_drive_by_nothing_is_answered_at_once(timed: Bench) -> None:
    timed.send(timed.session(), "d1-0")
    timed.clock.pass_by(0.01)
    assert timed.answered == [(0.0, "d1-0")]


def test_accepted_at_once_then_busy_until_the_end(timed: Bench) -> None:
    session = timed.session(answer_at_end=False)
    timed.send(session, "d1-6", "d1-6", "o3")
    assert [outcome.status for _, _, outcome in timed.answers] == [
        Status.ACCEPTED,
        Status.BUSY,
        Status.READING,
    ]
    assert math.isnan(timed.answers[1][2].reply)
    timed.clock.pass_by(0.99)
    timed.send(session, "d1-0")
    timed.clock.pass_by(0.02)
    timed.send(session, "d1-0")
    assert [outcome.status for _, _, outcome in timed.answers[3:]] == [Status.BUSY, Status.ACCEPTED]
    assert timed.simulator.pose.x == pytest.approx(15.5)


def test_watchers_hear_of_an_accepted_drive_when_it_begins_and_when_it_has_ended(timed: Bench) -> None:
    start = timed.simulator.pose
    timed.send(timed.session(answer_at_end=False), "w1-6")
    planned, accepted = timed.events
    assert isinstance(planned, MovementPlanned)
    assert isinstance(accepted, CommandResult)
    assert (accepted.status, accepted.pose, accepted.contact) == (Status.ACCEPTED, start, None)
    timed.clock.pass_by(2)
    ended = timed.events[2]
    assert isinstance(ended, MovementEnded)
    assert (ended.number, ended.time, ended.stopped_by, ended.answers) == (1, 1.0, "", False)
    assert ended.contact is not None
    assert ended.pose == timed.simulator.pose


@pytest.mark.parametrize("answer_at_end", [True, False])
def test_a_contact_that_is_only_planned_is_never_told(timed: Bench, answer_at_end: bool) -> None:
    timed.clock.pass_by(3.0)
    timed.send(timed.session(answer_at_end=answer_at_end), "d1-200")
    timed.clock.pass_by(0.33)
    timed.engine.session().submit(replace(parse_command("xx"), stops=True), lambda outcome: None)
    timed.clock.pass_by(100.0)
    ended = [event for event in timed.events if isinstance(event, MovementEnded)]
    assert [(each.contact, each.stopped_by) for each in ended] == [(None, "xx from client")]
    assert ended[0].time == pytest.approx(3.33)
    assert ended[0].pose.x == pytest.approx(9.5 + 0.33 * 6)
    outcomes = [event for event in timed.events if isinstance(event, CommandResult)]
    assert all(each.contact is None for each in outcomes)
    assert timed.simulator.contacts == 0


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        (ActionName.STOP, ()),
        (ActionName.RESET, ()),
        (ActionName.SEED, (4.0,)),
        (ActionName.TELEPORT, (6.0, 6.0, 0.0)),
    ],
)
def test_who_ended_a_movement_is_told_before_what_they_did(
    timed: Bench, name: ActionName, arguments: tuple[float, ...]
) -> None:
    timed.send(timed.session(answer_at_end=False), "d1-6")
    timed.clock.pass_by(0.5)
    timed.act(name, *arguments)
    ended, done = timed.events[2:]
    assert isinstance(ended, MovementEnded)
    assert (ended.time, ended.stopped_by) == (0.5, f"{name} from console")
    assert ended.pose.x == pytest.approx(12.5)
    assert isinstance(done, ActionDone)


def test_a_movement_whose_way_changes_is_planned_again(clock: Clock, course_spec: SimulationSpec) -> None:
    bench = Bench(clock, replace(course_spec, block_solid=True, block_center=(6, 30)), timed=True)
    bench.send(bench.session(), "d1-30")
    clock.pass_by(1.0)
    bench.act(ActionName.BLOCK, 30, 42)
    clock.pass_by(9.0)
    planned = [event for event in bench.events if isinstance(event, MovementPlanned)]
    assert [(each.number, each.time) for each in planned] == [(1, 0.0), (1, 1.0)]
    (ended,) = (event for event in bench.events if isinstance(event, MovementEnded))
    assert ended.pose.x == pytest.approx(25.5)


def test_a_stop_costs_the_same_however_many_wait(timed: Bench) -> None:
    session = timed.session()
    timed.send(session, "d1-6", *["d1-1"] * 50)
    timed.engine.session().submit(replace(parse_command("xx"), stops=True), lambda outcome: None)
    timed.clock.settle()
    statuses = [outcome.status for _, _, outcome in timed.answers]
    assert statuses == [Status.DONE, *[Status.STOPPED] * 50]
    timed.send(session, "d1-1")
    timed.clock.pass_by(1.0)
    assert timed.answers[-1][2].status is Status.DONE, "what comes after a stop is done"


def test_a_stop_that_arrives_while_an_answer_is_due_is_answered_after_it(
    clock: Clock, course_spec: SimulationSpec
) -> None:
    first, *rest = course_spec.sensors
    spec = replace(course_spec, sensors=(replace(first, read_time=1.0), *rest))
    bench = Bench(clock, spec, timed=True, link=LinkDelay(0.1, 0.0, 3))
    session = bench.session()
    bench.send(bench.session(answer_at_end=False), "d1-6")
    bench.send(session, "u1")
    clock.pass_by(0.5)
    session.submit(stop(), bench._note)
    bench.send(session, "u2")
    clock.pass_by(0.2)
    assert not bench.simulator.moving, "it stops before its turn"
    clock.pass_by(3.0)
    assert [text for _, text in bench.answered] == ["d1-6", "u1", "xx", "u2"]
    assert bench.answered[1:3] == [(1.2, "u1"), (1.3, "xx")]


def test_a_drive_waits_for_the_drive_of_another_session(timed: Bench) -> None:
    first, second = timed.session(), timed.session()
    timed.send(first, "d1-6")
    timed.clock.pass_by(0.5)
    timed.send(second, "a1-3", "o3")
    timed.clock.pass_by(3)
    assert timed.answered == [(1.0, "d1-6"), (1.5, "a1-3"), (1.5, "o3")]
    assert timed.simulator.pose.x == pytest.approx(12.5)


def test_a_wall_ends_the_way_but_not_the_time(timed: Bench) -> None:
    timed.send(timed.session(), "w1-6")
    timed.clock.pass_by(0.9)
    timed.engine.now()
    assert timed.simulator.pose.y == pytest.approx(45.0)
    assert timed.simulator.moving, "the wheels slip"
    timed.clock.pass_by(1)
    assert timed.answered == [(1.0, "w1-6")]
    assert timed.answers[0][2].contact is not None


def test_time_scale_makes_everything_faster(clock: Clock, course_spec: SimulationSpec) -> None:
    bench = Bench(clock, course_spec, timed=True, time_scale=10.0)
    bench.send(bench.session(), "d1-6")
    clock.pass_by(1)
    assert bench.answered == [(0.1, "d1-6")]
    assert bench.engine.now() == pytest.approx(10.0)


def test_a_pause_holds_a_movement_where_it_is(timed: Bench) -> None:
    timed.send(timed.session(), "d1-6", "u1")
    timed.clock.pass_by(0.5)
    timed.act(ActionName.PAUSE)
    timed.clock.pass_by(100)
    assert timed.engine.now() == pytest.approx(0.5)
    assert timed.simulator.pose.x == pytest.approx(12.5)
    assert timed.answers == []
    timed.act(ActionName.RESUME)
    timed.clock.pass_by(1)
    assert timed.answered == [(101.0 - 0.5 + 0.5, "d1-6"), (101.0, "u1")]
    assert timed.simulator.pose.x == pytest.approx(15.5)


def test_a_step_in_a_pause_finishes_the_movement_then_lets_one_command_through(timed: Bench) -> None:
    timed.send(timed.session(), "d1-6", "d1-3", "u1")
    timed.clock.pass_by(0.5)
    timed.act(ActionName.PAUSE)
    timed.engine.step()
    assert [text for _, text in timed.answered] == ["d1-6"]
    assert timed.simulator.pose.x == pytest.approx(15.5)
    timed.engine.step()
    assert [text for _, text in timed.answered] == ["d1-6", "d1-3"]
    assert timed.simulator.pose.x == pytest.approx(18.5)
    assert timed.engine.now() == pytest.approx(1.5)
    timed.act(ActionName.RESUME)
    timed.clock.pass_by(0.25)
    assert [text for _, text in timed.answered] == ["d1-6", "d1-3", "u1"]
    assert timed.engine.now() == pytest.approx(1.75)


def test_stop_ends_a_movement_at_once_and_answers_it(timed: Bench) -> None:
    timed.send(timed.session(), "d1-6", "o3")
    timed.clock.pass_by(0.5)
    done = timed.act(ActionName.STOP)
    assert done.text == "stopped"
    assert timed.answered == [(0.5, "d1-6"), (0.5, "o3")]
    outcome = timed.answers[0][2]
    assert outcome.pose.x == pytest.approx(12.5)
    assert outcome.time == pytest.approx(0.5)
    assert timed.answers[1][2].reply == pytest.approx(3.0)
    timed.clock.pass_by(5)
    assert len(timed.answers) == 2
    assert timed.act(ActionName.STOP).text == "nothing was moving"


def test_a_change_of_speed_counts_from_now_on(timed: Bench) -> None:
    timed.send(timed.session(), "d1-6")
    timed.clock.pass_by(0.5)
    timed.act(ActionName.TIME_SCALE, 5.0)
    timed.engine.now()
    assert timed.simulator.pose.x == pytest.approx(12.5)
    timed.clock.pass_by(1)
    assert timed.answered == [(0.6, "d1-6")]


@pytest.mark.parametrize(
    ("name", "arguments", "place"),
    [
        (ActionName.RESET, (), (9.5, 42.0, 0.0)),
        (ActionName.SEED, (8,), (9.5, 42.0, 0.0)),
        (ActionName.TELEPORT, (54.0, 30.0, 90.0), (54.0, 30.0, 90.0)),
    ],
)
def test_put_elsewhere_in_mid_motion_the_drive_ends_and_the_next_starts_there(
    timed: Bench, name: ActionName, arguments: tuple[float, ...], place: tuple[float, float, float]
) -> None:
    timed.send(timed.session(), "d1-6", "d1-3")
    timed.clock.pass_by(0.5)
    timed.act(name, *arguments)
    assert [text for _, text in timed.answered] == ["d1-6"]
    assert timed.answers[0][2].pose.x == pytest.approx(12.5), "where it was stopped"
    timed.clock.pass_by(1)
    x, y, heading = place
    pose = timed.simulator.pose
    way = (x, y + 3.0) if heading else (x + 3.0, y)
    assert (pose.x, pose.y, pose.heading) == pytest.approx((*way, heading))
    assert timed.told == ["d1-6", name.value, "d1-3"], "who reads the log can follow it"
    assert timed.answered[1] == (1.0, "d1-3")


def test_a_refused_teleport_lets_the_movement_go_on(timed: Bench) -> None:
    timed.send(timed.session(), "d1-6")
    timed.clock.pass_by(0.5)
    assert timed.act(ActionName.TELEPORT, 48.0, 42.0, 0.0).refused
    timed.clock.pass_by(1)
    assert timed.answered == [(1.0, "d1-6")]
    assert timed.simulator.pose.x == pytest.approx(15.5)


def test_a_block_put_in_the_way_stops_a_movement_under_way(clock: Clock, course_spec: SimulationSpec) -> None:
    bench = Bench(clock, replace(course_spec, block_solid=True, block_center=(66, 42)), timed=True)
    bench.send(bench.session(), "d1-12")
    clock.pass_by(0.5)
    assert not bench.act(ActionName.BLOCK, 20.0, 42.0).refused
    clock.pass_by(2)
    assert bench.answered == [(2.0, "d1-12")]
    assert bench.simulator.pose.x == pytest.approx(20.0 - 1.5 - 3.0, abs=1e-6)
    assert bench.answers[0][2].contact is not None
    assert bench.act(ActionName.BLOCK, 15.5, 42.0).refused, "not into the robot"


def test_a_program_that_leaves_in_mid_motion_leaves_the_robot_driving(timed: Bench) -> None:
    first, second = timed.session(), timed.session()
    timed.send(first, "d1-6", "d1-6")
    timed.clock.pass_by(0.5)
    first.close()
    timed.send(second, "d1-3")
    timed.clock.pass_by(3)
    assert timed.answered == [(1.5, "d1-3")]
    assert timed.simulator.pose.x == pytest.approx(9.5 + 6 + 3)


def test_a_waiting_program_that_leaves_is_forgotten(timed: Bench) -> None:
    first, second = timed.session(), timed.session()
    timed.send(first, "d1-6")
    timed.send(second, "d1-3")
    second.close()
    timed.clock.pass_by(3)
    assert timed.answered == [(1.0, "d1-6")]
    assert timed.simulator.pose.x == pytest.approx(15.5)


def test_a_movement_that_is_due_is_answered_before_the_next_begins(timed: Bench) -> None:
    driver, packets = timed.session(), timed.session(answer_at_end=False)

    def slow() -> None:
        timed.clock.selector.now += 1.0  # something took long: the movement is over, its timer late
        timed.send(packets, "d1-1")

    timed.clock.call_later(0.5, slow)
    timed.send(driver, "d1-6")
    timed.clock.pass_by(3)
    assert [(text, outcome.status) for _, text, outcome in timed.answers] == [
        ("d1-6", Status.DONE),
        ("d1-1", Status.ACCEPTED),
    ]
    timed.send(driver, "o3")
    assert timed.answers[-1][2].reply == pytest.approx(7.0)


def test_step_time_comes_on_top_of_a_timed_movement(clock: Clock, course_spec: SimulationSpec) -> None:
    bench = Bench(clock, course_spec, timed=True, step_time=0.25)
    bench.send(bench.session(), "d1-6", "u1")
    clock.pass_by(3)
    assert bench.answered == [(1.25, "d1-6"), (1.5, "u1")]


def test_the_same_seed_and_commands_at_the_same_times_give_the_same_replies(
    noisy_spec: SimulationSpec,
) -> None:
    def rollout() -> list[tuple[float, str, float]]:
        clock = Clock()
        bench = Bench(clock, noisy_spec, timed=True)
        driver, reader = bench.session(), bench.session()
        for text in ("d1-6", "r1-45", "w1-100", "u1", "d1-3"):
            bench.send(driver, text)
            for _ in range(4):
                clock.pass_by(0.3)
                bench.send(reader, "u2", "g1", "o1", "i1", "t1")
        clock.pass_by(60)
        clock.close()
        return [(time, text, outcome.reply) for time, text, outcome in bench.answers]

    first, second = rollout(), rollout()
    assert len(first) == 5 + 5 * 4 * 5
    assert first == second


# -- a lidar ---------------------------------------------------------------------------------


@pytest.fixture
def lidar_spec(course_spec: SimulationSpec) -> SimulationSpec:
    lidar = LidarSpec(kind=Lidar, number=1, code="sc", rays=36, scan_rate=5.0)
    velocity = VelocitySpec(kind=VelocityKind.ALL, code="vv")
    return replace(course_spec, sensors=(*course_spec.sensors, lidar), velocities=(velocity,))


def revolutions(bench: Bench) -> list[tuple[float, int]]:
    """Simulated time and revolution of each scan that was answered."""
    readings = [(outcome.time, outcome.reading) for _, _, outcome in bench.answers]
    return [(time, read.scan.revolution) for time, read in readings if read is not None and read.scan]


def test_in_instant_motion_a_scan_that_was_read_is_waited_for(
    clock: Clock, lidar_spec: SimulationSpec
) -> None:
    bench = Bench(clock, lidar_spec)
    bench.send(bench.session(), "sc", "vv-0;0;30", "sc", "sc", "u1", "sc")
    assert revolutions(bench) == [(0.0, -1), (0.2, 0), (0.4, 1), (pytest.approx(0.6), 2)]
    # The robot turned meanwhile, and watchers were told of it.
    assert bench.simulator.pose.heading > 10.0
    assert any(isinstance(event, LegEnded) for event in bench.events)


def test_who_waits_is_answered_when_a_scan_has_let_time_pass(
    clock: Clock, lidar_spec: SimulationSpec
) -> None:
    bench = Bench(clock, lidar_spec)
    bench.send(bench.session(), "sc", "sc", "sc")
    bench.send(bench.session(), "wt-0.1")
    assert [outcome.time for _, text, outcome in bench.answers if text == "wt-0.1"] == [0.5]


def test_in_timed_motion_the_last_complete_scan_is_given_at_once(
    clock: Clock, lidar_spec: SimulationSpec
) -> None:
    bench = Bench(clock, lidar_spec, timed=True)
    session = bench.session()
    for _ in range(4):
        bench.send(session, "sc", "sc")
        clock.pass_by(0.15)
    assert [revolution for _, revolution in revolutions(bench)] == [-1, -1, -1, -1, 0, 0, 1, 1]
    assert [time for time, _ in bench.answered] == pytest.approx([0.15 * (index // 2) for index in range(8)])
