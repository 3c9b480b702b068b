"""The history of a run: rows of the newest commands, and sums over all of them."""

import tracemalloc
from typing import NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.config import load_default
from simmer_tui.robot.engine import Engine
from simmer_tui.run import run_history, table
from simmer_tui.run.events import (
    Action,
    ActionName,
    Belief,
    CommandResult,
    Event,
    MovementEnded,
    WireMessage,
)
from simmer_tui.run.facts import SAME_PLACE
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.state import checkpoint_of
from simmer_tui.run.table import Columns, RowTable
from simmer_tui.sim import Pose, Simulator, parse_command

MOST = 30e6 / 200_000
"""Bytes a command that a live history may take."""


class Pair(NamedTuple):
    order: int
    value: float


class Followed:
    """A simulator whose events are kept, and reduced with a history."""

    def __init__(self) -> None:
        self.simulator = Simulator(load_default().simulation, 7)
        self.engine = Engine(self.simulator)
        self.history = RunHistory(checkpoint_of(self.simulator))
        self.reducer = Reducer(checkpoint_of(self.simulator), history=self.history)
        self.events: list[Event] = []
        self.engine.watch(self.events.append)
        self.engine.watch(self.reducer.apply)

    def give(self, *texts: str) -> None:
        session = self.engine.session()
        for text in texts:
            session.submit(parse_command(text), lambda outcome: None)

    def believe(self, ahead: float, spread: float) -> None:
        pose = self.simulator.pose
        self.engine.tell(
            Belief(self.simulator.time, Pose(pose.x + ahead, pose.y, pose.heading), pose, spread)
        )


def test_a_table_keeps_the_newest_and_sums_up_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table, "CHUNK", 8)
    summed: list[float] = []

    def settle(rows: Columns) -> None:
        summed.extend(rows["value"].tolist())

    rows = RowTable(Pair, 20, settle)
    for order in range(100):
        rows.append(order, order / 2)
        if order % 7 == 0:
            rows.settle()
    rows.settle()
    assert summed == [order / 2 for order in range(100)]
    assert len(rows) + rows.dropped == 100
    assert 20 <= len(rows) <= 20 + 2 * 8
    assert list(rows) == [Pair(order, order / 2) for order in range(rows.dropped, 100)]
    assert rows[-1] == Pair(99, 49.5)
    assert rows[rows.place_of(90)].order == 90
    place = rows.place_of(85)
    assert rows.columns(place, place + 9)["order"].tolist() == list(range(85, 94))
    assert rows.columns()["value"].tolist() == [row.value for row in rows]
    with pytest.raises(IndexError):
        rows[len(rows)]


def test_rows_have_time_and_pose() -> None:
    run = Followed()
    run.give("u1", "d1-3", "u1", "zz", "d1-60")
    history = run.history
    first, second = history.readings
    moved, blocked = history.movements
    assert (first.value, second.value) == tuple(
        each.reply for each in run.events if isinstance(each, CommandResult) and each.reading is not None
    )
    assert first.elapsed == 0.0
    assert second.elapsed == moved.elapsed == pytest.approx(0.5)
    assert (moved.contact, blocked.contact, blocked.held) == (False, True, True)
    assert blocked.pose.x == pytest.approx(run.simulator.pose.x, abs=1e-4)
    assert blocked.gone == pytest.approx(run.simulator.distance)
    assert [row.result.command.text for row in history.refusals.items] == ["zz"]
    [contact] = history.contacts.items
    assert contact.pose == run.simulator.pose
    assert list(contact.read) == ["u1"]
    assert history.totals.commands == len(history.commands) == 5


def test_contacts_in_one_place_are_one_as_far_as_a_wedged_robot_moves() -> None:
    run = Followed()
    run.give("d1-60")
    [ended] = [each for each in run.events if isinstance(each, MovementEnded)]
    for along in (0.3, SAME_PLACE, SAME_PLACE + 0.01):
        pose = replace(ended.pose, y=ended.pose.y + along)
        run.engine.tell(replace(ended, time=run.simulator.time + along, pose=pose))
    assert [each.count for each in run.history.repeated.first.items] == [3, 1]


def test_elapsed_time_goes_on_through_a_reset_and_stuck_does_not() -> None:
    run = Followed()
    run.give(*("d1-60",) * 4)
    assert run.history.blocked(run.history.placed, run.history.order)[0] == 4
    before = run.history.elapsed
    run.engine.perform(Action(ActionName.RESET))
    assert run.history.blocked(run.history.placed, run.history.order) == (0, 0.0)
    run.give("d1-3")
    assert run.history.elapsed == pytest.approx(before + run.simulator.time)
    assert run.history.began == run.history.placed == run.history.actions.items[-1].order


def test_being_lost_is_what_the_program_did_not_allow_for() -> None:
    run = Followed()
    for ahead, spread in ((4.0, 2.0), (4.0, 0.3), (0.5, 0.1)):
        run.believe(ahead, spread)
    assert [row.lost for row in run.history.beliefs] == [False, True, False]


def test_the_bias_in_force_is_that_of_the_seed() -> None:
    run = Followed()
    run.engine.perform(Action(ActionName.SEED, (11.0,)))
    assert run.history.biases.items[-1].bias == run.simulator.bias
    run.engine.perform(Action(ActionName.BIAS, (0.0,)))
    muted = {drive.kind: run.simulator.bias[drive.kind] for drive in run.simulator.spec.drives}
    assert run.history.biases.items[-1].bias == muted


def test_numbers_of_a_damaged_log_fit_into_rows() -> None:
    run = Followed()
    run.give("u1")
    result = next(each for each in run.events if isinstance(each, CommandResult))
    run.reducer.apply(replace(result, number=10**30))
    assert len(run.history.commands) == 2


@pytest.mark.slow
def test_a_history_is_bounded_by_bytes_a_command(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, most in (
        ("TRACE_POINTS", 20),
        ("KEPT_BELIEFS", 300),
        ("KEPT_OBJECTS", 10),
        ("KEPT_BLOCKS", 10),
    ):
        monkeypatch.setattr(run_history, name, most)
    monkeypatch.setattr(table, "CHUNK", 64)
    run = Followed()
    run.give(*("u1", "u2", "u3", "g1", "d1-2", "r1-25") * 5)
    events = run.events
    sizes = []
    for laps in (200, 400):
        tracemalloc.start()
        try:
            history = RunHistory(checkpoint_of(run.simulator), kept=2048)
            reducer = Reducer(checkpoint_of(run.simulator), history=history)
            for _ in range(laps):
                for event in events:
                    reducer.apply(event)
            sizes.append(tracemalloc.get_traced_memory()[0])
        finally:
            tracemalloc.stop()
        assert history.totals.commands == 30 * laps
    assert sizes[1] < 1.1 * sizes[0], "it grows without end"
    rows = sum(len(each) for each in (history.commands, history.readings, history.movements))
    assert rows < 2.2 * (2048 + 2 * 64)
    packed = sum(each.columns().nbytes for each in (history.commands, history.readings, history.movements))
    assert packed / len(history.commands) < 0.95 * MOST
    assert np.isfinite(history.readings.columns()["error"]).any()


def test_lines_to_a_board_are_counted_by_their_text_and_others_by_their_meaning() -> None:
    followed = Followed()
    lines = (("g 20\n", ""), ("s\n", ""), ("g 20\n", ""), ("w 3", "w {n}"), ("w 4", "w {n}"))
    for data, meaning in lines:
        followed.engine.tell(WireMessage(0.0, data, meaning=meaning))
    assert followed.history.totals.messages == {("g 20", ""): 2, ("s", ""): 1, ("w {n}", ""): 2}
