"""Snapshots for screens: frozen, bounded, and true to the run."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from queue import Queue

import pytest
from msgspec.structs import replace

from simmer_tui.live import snapshot
from simmer_tui.live.snapshot import EVENTS, Recorder, Snapshot
from simmer_tui.report.live_verdict import LiveVerdict
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Action, ActionName, Belief, Event, MovementEnded, Notice, NoticeKind
from simmer_tui.run.facts import BESIDE
from simmer_tui.run.reducer import HISTORY, Reducer
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.state import checkpoint_of
from simmer_tui.sim import Pose, SimulationSpec, Simulator, parse_command


class Run:
    def __init__(self, spec: SimulationSpec, **options: object) -> None:
        self.engine = Engine(Simulator(spec, 5), **options)  # type: ignore[arg-type]
        self.reducer = Reducer(checkpoint_of(self.engine.simulator))
        self.recorder = Recorder(self.engine, self.reducer)
        self.engine.watch(self.recorder.apply)
        self._session = self.engine.session(answer_at_end=False)

    def give(self, *commands: str) -> Snapshot:
        for command in commands:
            self._session.submit(parse_command(command), lambda outcome: None)
        return self.recorder.snapshot()


@pytest.fixture
def run(course_spec: SimulationSpec) -> Run:
    return Run(course_spec)


def test_a_snapshot_does_not_change_with_the_run(run: Run) -> None:
    before = run.give("u1")
    run.give("d1-2", "u1", "zz")
    assert before.state.pose == Pose(9.5, 42.0, 0.0)
    assert before.state.commands == 1
    assert len(before.state.sensors["u1"].history) == 1
    assert len(before.entries) == 1
    assert before.state.last is not None
    assert before.state.last.command.text == "u1"


def test_it_says_what_the_simulator_says(run: Run) -> None:
    snapshot = run.give("d1-2", "w1-100", "u1")
    simulator = run.engine.simulator
    assert snapshot.state.pose == simulator.pose
    assert snapshot.state.touching
    assert snapshot.state.contact is not None
    assert (snapshot.state.commands, snapshot.state.contacts, snapshot.state.seed) == (3, 1, 5)
    assert math.isclose(snapshot.state.distance, 5.0)
    assert not run.give("s1-1").state.touching
    assert run.give().true_values == {}
    true = run.recorder.snapshot(true_values=True).true_values
    assert set(true) == {sensor.code for sensor in simulator.spec.sensors}
    assert true["u1"] == simulator.true_value("u1")


def test_advice_is_shown_until_it_had_its_time_and_commands_are_answered(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    run.give("u1")
    run.engine.tell(Notice(NoticeKind.FAULT, "the disk is full"))
    assert run.give().advice == ""
    run.engine.tell(Notice(NoticeKind.FAULT, "read the reply", advice=True))
    assert run.give("u1").advice == "read the reply"
    monkeypatch.setattr(snapshot, "ADVICE", 0.0)
    assert run.give().advice == ""
    run.engine.tell(Notice(NoticeKind.FAULT, "send a line end", advice=True))
    assert run.give().advice == "send a line end"
    run.engine.perform(Action(ActionName.RESET))
    assert run.give().advice == ""


def test_a_clock_that_is_set_back_keeps_no_advice(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    now = time.time()
    run.engine.tell(Notice(NoticeKind.FAULT, "read the reply", advice=True))
    assert run.give("u1").advice == "read the reply"
    monkeypatch.setattr(time, "time", lambda: now - 86400.0)
    monkeypatch.setattr(snapshot, "ADVICE", 0.0)
    assert run.give("u1").advice == ""


def test_only_what_is_new_is_handed_out_and_readings_are_folded(run: Run) -> None:
    (first,) = run.give("u1", "u2").entries
    assert (first.number, first.readings, [each.number for each in first.kept]) == (2, 2, [1, 2])
    run.give("u3")
    (grown,) = run.recorder.snapshot(2).entries
    assert (grown.number, grown.first, grown.readings) == (3, first.first, 3)
    assert run.recorder.snapshot(3).entries == ()
    assert run.recorder.number == 3


@pytest.mark.slow
def test_events_readings_and_movements_are_bounded(run: Run) -> None:
    snapshot = run.give(*["u1", "r1-1"] * (EVENTS // 2 + 10))
    assert len(snapshot.entries) == EVENTS
    assert snapshot.entries[-1].number == 2 * EVENTS + 39, "the end of the last movement; its answer follows"
    assert len(snapshot.state.sensors["u1"].history) == HISTORY
    assert len(snapshot.route.pieces) == 0, "turns leave no trail"


def test_log_entries_hold_neither_paths_nor_particles(run: Run) -> None:
    particles = tuple((float(n), 1.0) for n in range(1000))
    run.engine.tell(Belief(0.0, Pose(1, 2, 3), Pose(0, 0, 0), None, particles))
    snapshot = run.give("w1-100")
    belief, ended = (entry.event for entry in snapshot.entries)
    assert isinstance(belief, Belief)
    assert belief.particles == ()
    assert isinstance(ended, MovementEnded)
    assert ended.contact is not None
    assert not ended.trajectory.wheels
    assert snapshot.state.belief is not None
    assert snapshot.state.belief.particles == particles
    assert sys.getsizeof(belief) < 200


def test_the_route_is_the_way_of_all_movements_and_the_path_that_of_the_latest(run: Run) -> None:
    snapshot = run.give("d1-2", "r1-90", "d1-1", *["r1-1"] * 50)
    (piece,) = snapshot.route.pieces
    assert piece[0, :2].tolist() == [9.5, 42.0]
    assert piece[-1, :2] == pytest.approx([11.5, 43.0])
    assert snapshot.state.path[-1, :2] == pytest.approx([11.5, 43.0])
    path = run.give("d1-1").state.path
    assert path[0, :2] == pytest.approx([11.5, 43.0])


@pytest.mark.parametrize("name", [ActionName.RESET, ActionName.SEED, ActionName.TELEPORT])
def test_a_new_start_forgets_trail_readings_and_belief(run: Run, name: ActionName) -> None:
    arguments = {ActionName.SEED: (9.0,), ActionName.TELEPORT: (6.0, 6.0, 0.0)}
    run.give("u1", "d1-1")
    run.engine.tell(Belief(0.0, Pose(1, 2, 3), Pose(0, 0, 0)))
    run.engine.perform(Action(name, arguments.get(name, ())))
    snapshot = run.recorder.snapshot()
    assert len(snapshot.state.path) == 0
    assert (snapshot.state.sensors, snapshot.state.belief) == ({}, None)
    assert snapshot.state.moved == run.recorder.number


def test_a_refused_action_forgets_nothing(run: Run) -> None:
    run.give("u1")
    run.engine.perform(Action(ActionName.TELEPORT, (54.0, 42.0, 0.0)))
    assert set(run.recorder.snapshot().state.sensors) == {"u1"}


def test_the_client_is_the_one_that_is_there(run: Run) -> None:
    run.engine.tell(Notice(NoticeKind.CONNECTED, "client a connected", "a"))
    run.engine.tell(Notice(NoticeKind.TURNED_AWAY, "client b turned away", "b"))
    assert run.recorder.snapshot().state.client == "a"
    run.engine.tell(Notice(NoticeKind.LEFT, "client b left", "b"))
    assert run.recorder.snapshot().state.client == "a"
    run.engine.tell(Notice(NoticeKind.LEFT, "client a left", "a"))
    assert run.recorder.snapshot().state.client == ""


def test_the_rate_is_that_of_the_last_second(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [1000.0]
    monkeypatch.setattr("simmer_tui.live.snapshot.time.monotonic", lambda: now[0])
    run.recorder = Recorder(run.engine, run.reducer)
    run.give(*["c1"] * 50)
    assert run.recorder.snapshot().rate == 0.0
    now[0] += 2.0
    assert run.recorder.snapshot().rate == 25.0
    now[0] += 0.5
    assert run.recorder.snapshot().rate == 25.0
    now[0] += 1.0
    assert run.recorder.snapshot().rate == 0.0


def test_a_stopped_movements_trail_ends_where_the_robot_does(course_spec: SimulationSpec) -> None:
    import asyncio

    async def play(make: Callable[[], Run]) -> None:
        run = make()
        run.engine.start(asyncio.get_running_loop())
        run.give("d1-12")
        while run.recorder.snapshot().state.pose.x < 9.6:
            await asyncio.sleep(0)
        moving = run.recorder.snapshot()
        assert moving.state.moving
        assert moving.state.path[-1, :2].tolist() == [moving.state.pose.x, moving.state.pose.y]
        run.engine.perform(Action(ActionName.STOP))
        stopped = run.recorder.snapshot()
        assert not stopped.state.moving
        assert stopped.state.path[-1, :2].tolist() == [stopped.state.pose.x, stopped.state.pose.y]

    asyncio.run(play(lambda: Run(replace(course_spec), timed=True)))


def test_a_new_verdict_waits_for_its_line_on_a_slow_screen(course_spec: SimulationSpec) -> None:
    simulator = Simulator(course_spec, 5)
    checkpoint = checkpoint_of(simulator)
    calls: Queue[tuple[Callable[..., object], tuple[object, ...]]] = Queue()
    told: list[Event] = []
    live = LiveVerdict(
        Reducer(checkpoint),
        RunHistory(checkpoint),
        None,
        lambda *call: calls.put((call[0], call[1:])),
        told.append,
    )
    reducer = Reducer(checkpoint)
    recorder = Recorder(Engine(simulator), reducer, verdict=live)

    def run() -> Notice:
        for kind in (NoticeKind.CONNECTED, NoticeKind.LEFT):
            live.apply(Notice(kind, "robot.py"))
        done, found = calls.get(timeout=120)
        done(*found)
        assert isinstance(told[-1], Notice)
        return told[-1]

    def show(event: Event) -> Snapshot:
        recorder.apply(event)
        return recorder.snapshot()

    assert show(run()).verdict is live.verdict is not None
    run()
    # The screen is still at the beginning of the second run, which is over.
    assert live.verdict is not None
    assert show(Notice(NoticeKind.CONNECTED, "robot.py")).verdict is None
    assert show(told[-1]).verdict is live.verdict


@pytest.mark.parametrize("beside", [BESIDE - 10.0, BESIDE + 10.0])
def test_a_contact_has_a_reading_of_a_sensor_that_looks_there_as_causes_say_it(
    course_spec: SimulationSpec, beside: float
) -> None:
    """The wall is to the left, and only u1 was read."""
    sensors = tuple(
        replace(sensor, rotation=90.0 - beside) if sensor.code == "u1" else sensor
        for sensor in course_spec.sensors
    )
    contact = Run(replace(course_spec, sensors=sensors)).give("u1", "w1-100").entries[-1]
    assert isinstance(contact.event, MovementEnded)
    assert (contact.nearest is not None) is (beside <= BESIDE)
