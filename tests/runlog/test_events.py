"""A log tells of the same events as the run did, and the state folded from it is the run's own."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from msgspec import structs
from msgspec.structs import replace

from simmer_tui.run.events import (
    Action,
    ActionName,
    Belief,
    CommandResult,
    Event,
    MovementEnded,
    MovementPlanned,
)
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import SensorRow, State, checkpoint_of
from simmer_tui.runlog import decode
from simmer_tui.runlog.index import EntryFlag, RunLogIndex
from simmer_tui.runlog.log_records import CheckpointRecord
from simmer_tui.runlog.playback import LOOK_BACK, Playback
from simmer_tui.runlog.reader import Logged, LogReader
from simmer_tui.runlog.writer import CHECKPOINT_EVERY, RunLog
from simmer_tui.sim import GripperSpec, Simulator, parse_command
from simmer_tui.sim.trajectory import Trajectory

TIMES = (0.0, 0.1, 0.37, 0.5, 0.9, 1.0)
"""Fractions of a movement at which two are compared."""


def test_every_kind_of_event_has_its_place_in_reducer_and_log() -> None:
    # A kind without one makes the log's watcher fail in the middle of a run.
    kinds = set(get_args(Event))
    assert set(vars(Reducer)["_TAKES"]) == kinds
    by_hand = {CommandResult, MovementPlanned, MovementEnded, Belief}
    assert {*vars(decode)["_EVENTS"].values(), *by_hand} == kinds


def read(path: Path) -> list[Event]:
    with LogReader(path) as log:
        told = list(log)
    assert all(isinstance(each, Logged) for each in told), "no line is broken"
    return [each.event for each in told if isinstance(each, Logged)]


def same_way(told: Trajectory, read_back: Trajectory) -> None:
    """Bit for bit the same movement."""
    assert (read_back.start_time, read_back.end_time, read_back.cut) == (
        told.start_time,
        told.end_time,
        told.cut,
    )
    assert (read_back.contact, read_back.held_at) == (told.contact, told.held_at)
    for fraction in TIMES:
        time = told.start_time + fraction * (told.end_time - told.start_time)
        assert read_back.pose_at(time) == told.pose_at(time)
        assert read_back.travelled(time) == told.travelled(time)
        assert np.array_equal(read_back.trail(time), told.trail(time))


def same_event(told: Any, read_back: Any) -> None:
    assert type(told) is type(read_back)
    command = getattr(told, "command", None)
    if command is not None:
        other = read_back.command
        assert (command.text, command.source, command.stops) == (other.text, other.source, other.stops)
    match told, read_back:
        case (MovementPlanned(), MovementPlanned()) | (MovementEnded(), MovementEnded()):
            same_way(told.trajectory, read_back.trajectory)
            names = {each.name for each in structs.fields(told)} - {"trajectory", "command"}
        case CommandResult(), CommandResult():
            assert (told.trajectory is None) == (read_back.trajectory is None)
            reading = told.reading
            if reading is not None:
                told = structs.replace(told, reading=structs.replace(reading, view=None))
            names = {each.name for each in structs.fields(told)} - {"trajectory", "command", "taken", "reply"}
            assert told.reply == read_back.reply or (math.isnan(told.reply) and math.isnan(read_back.reply))
            if told.taken is not None and told.taken != told.time:
                assert read_back.taken == told.taken
        case _:
            names = {each.name for each in structs.fields(told)} - {"command"}
    for name in names:
        assert getattr(told, name) == getattr(read_back, name), name


@pytest.mark.quick_cases(4)
@pytest.mark.parametrize("answer_at_end", [True, False])
@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(each, marks=pytest.mark.slow) for each in range(2, 5))]
)
def test_the_events_come_back(
    random_run: Callable[..., Any], seed: int, timed: bool, answer_at_end: bool
) -> None:
    run = random_run(seed, timed=timed, answer_at_end=answer_at_end)
    back = read(run.path)
    assert len(back) == len(run.events)
    for told, read_back in zip(run.events, back, strict=True):
        same_event(told, read_back)


def same_state(live: State, read_back: State, *, looked_back: bool = False) -> None:
    """The same in all that a screen shows. With `looked_back` folding began on the way: histories and
    trails are as long as the look back, and running numbers count from there."""
    # A checkpoint in a log has no bias.
    numbers = {"number", "moved", "sensors", "path", "last", "ended", "movement", "twins", "bias"}
    for name in {each.name for each in structs.fields(live)} - numbers:
        assert getattr(live, name) == getattr(read_back, name), name
    assert np.array_equal(live.path, read_back.path) or (looked_back and not len(read_back.path))
    if live.last is not None and not (looked_back and read_back.last is None):
        assert read_back.last is not None
        same_event(live.last, read_back.last)
    if live.ended is not None and not (looked_back and read_back.ended is None):
        assert read_back.ended is not None
        same_event(live.ended, read_back.ended)
    assert (live.movement is None) == (read_back.movement is None)
    if live.movement is not None and read_back.movement is not None:
        same_event(live.movement, read_back.movement)
    assert set(read_back.sensors) <= set(live.sensors)
    for code, row in read_back.sensors.items():
        same_row(live.sensors[code], row, live.moved, read_back.moved)
    if not looked_back:
        assert (live.number, live.moved, set(live.sensors)) == (
            read_back.number,
            read_back.moved,
            set(read_back.sensors),
        )


def same_row(live: SensorRow, read_back: SensorRow, moved: int, moved_back: int) -> None:
    assert (live.reading.value, live.reading.true) == (read_back.reading.value, read_back.reading.true)
    assert (live.time, live.pose, live.block) == (read_back.time, read_back.pose, read_back.block)
    assert live.history[-len(read_back.history) :] == read_back.history
    assert (live.number > moved) == (read_back.number > moved_back)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("answer_at_end", [True, False])
@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("seed", [5, *(pytest.param(each, marks=pytest.mark.slow) for each in range(6, 9))])
def test_the_state_comes_back_at_any_time_in_any_order(
    random_run: Callable[..., Any], seed: int, timed: bool, answer_at_end: bool
) -> None:
    run = random_run(seed, timed=timed, answer_at_end=answer_at_end)
    moments = run.moments
    with RunLogIndex(run.path) as log:
        playback = Playback(log)
        shuffled = random.Random(seed).sample(moments, len(moments))
        for entry, time, live in (*moments, *reversed(moments), *shuffled):
            same_state(live, playback.state_when(entry, time))


def test_an_instant_movement_has_ended_from_the_moment_of_its_end_on(start_run: Callable[..., Any]) -> None:
    run = start_run()
    for text in ("d1-3", "r1-40", "u1"):
        run.send(text)
        run.look()
    with RunLogIndex(run.path) as log:
        playback = Playback(log)
        for entry, time, live in run.moments:
            same_state(live, playback.state_when(entry, time))


@pytest.mark.parametrize("timed", [True, pytest.param(False, marks=pytest.mark.slow)])
@pytest.mark.parametrize("looks", [12, pytest.param(150, marks=pytest.mark.slow)])
def test_a_long_run_is_folded_from_lines_that_sum_up(
    random_run: Callable[..., Any], timed: bool, looks: int
) -> None:
    run = random_run(3, timed=timed, steps=6 * CHECKPOINT_EVERY)
    with RunLogIndex(run.path) as log:
        summaries = [i for i in range(log.count) if log.flags_of(i) & EntryFlag.CHECKPOINT]
        assert len(summaries) > 2
        assert all(isinstance(log.record(i), CheckpointRecord) for i in summaries)
        playback = Playback(log)
        for entry, time, live in random.Random(1).sample(run.moments, looks):
            state = playback.state_when(entry, time)
            same_state(live, state, looked_back=entry > LOOK_BACK)


def test_the_state_at_each_entry_is_that_of_the_events_till_then(random_run: Callable[..., Any]) -> None:
    run = random_run(11, timed=False)
    reducer = Reducer(checkpoint_of(Simulator(run.simulator.spec, 7)))
    with RunLogIndex(run.path) as log, LogReader(run.path) as reader:
        playback, told = Playback(log), [each for each in reader if isinstance(each, Logged)]
        for entry in range(log.count):
            for each in told:
                if each.line == entry + 2:
                    reducer.apply(each.event)
            same_state(reducer.at(), playback.state_at(entry, log.time_of(entry)))


def test_a_belief_told_long_ago_holds_until_the_robot_is_put_elsewhere(start_run: Any) -> None:
    run = start_run()
    run.send("u1")
    run.believe()
    run.send(*("u1",) * (2 * CHECKPOINT_EVERY))
    run.loop.run_until(run.loop.now)
    held = run.log.lines - 2
    run.perform(ActionName.TELEPORT, 30.0, 42.0, 90.0)
    run.send(*("u1",) * (3 * CHECKPOINT_EVERY))
    run.loop.run_until(run.loop.now)
    with RunLogIndex(run.path) as log:
        playback = Playback(log)
        assert playback.state_at(log.count - 1).belief is None
        belief = playback.state_at(held).belief
        assert belief is not None
        assert belief.note == "half \ud800 a pair"


def test_a_gripper_and_a_held_block_come_back(tmp_path: Path, configuration: Any) -> None:
    gripper = GripperSpec(code="p1", reach=6.0, width=6.0)
    simulation = replace(configuration.simulation, gripper=gripper, bot_center=(18.0, 41.0))
    from simmer_tui.robot.engine import Engine

    simulator = Simulator(simulation, 7)
    engine = Engine(simulator)
    changed = replace(configuration, simulation=simulation)
    path = tmp_path / "grip.jsonl"
    told: list[Event] = []
    with RunLog(path, changed, simulator) as log:
        for watcher in (log, told.append):
            engine.watch(watcher)
        session = engine.session()
        for text in ("u1", "p1-1", "r1-40", "d1-2", "p1-0", "d1--3"):
            session.submit(parse_command(text), lambda outcome: None)
    from simmer_tui.runlog.decode import LogDecoder

    with RunLogIndex(path) as index:
        decoder = LogDecoder(simulation, index.header.pose)
        back = [event for i in range(index.count) for event in decoder.events(index.record(i))]  # type: ignore[arg-type]
    assert len(back) == len(told)
    for live, read_back in zip(told, back, strict=True):
        same_event(live, read_back)


def test_what_a_robot_did_not_answer_is_not_told_as_done(start_run: Any) -> None:
    from simmer_tui.sim import Status

    run = start_run()
    done = run.engine.mirror(parse_command("d1-3"))
    run.engine.tell(
        structs.replace(done, status=Status.UNANSWERED, reply=math.nan, reason="no reply", trajectory=None)
    )
    *_, last = read(run.path)
    assert isinstance(last, CommandResult)
    assert (last.status, last.reason) == (Status.UNANSWERED, "no reply")


def test_commands_after_a_reset_are_told_whatever_their_numbers(start_run: Any) -> None:
    run = start_run()
    run.send("d1-1")
    run.engine.perform(Action(ActionName.RESET))
    run.send("zz")
    last = read(run.path)[-1]
    assert isinstance(last, CommandResult)
    assert (last.number, last.command.text) == (1, "zz")
