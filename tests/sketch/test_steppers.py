"""Steppers: a rim that follows its steps at few changes of speed, and stands on the last one."""

from __future__ import annotations

import random
from collections.abc import Iterable, Sequence

import pytest

from simmer_tui.sketch.board_process import NEVER, BoardRecord, Told
from simmer_tui.sketch.parts import SECOND
from simmer_tui.sketch.steppers import ALONE, COIL_TIME, IDLE, LOST, StepperState
from simmer_tui.sketch.wiring import StepperDriver, WiredStepper

_MS = SECOND // 1000
FULL = ((1, 0, 1, 0), (0, 1, 1, 0), (0, 1, 0, 1), (1, 0, 0, 1))
"""The coils of both bridges, as Stepper and AccelStepper switch them."""
WAVE = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))
"""The coils of an ULN2003, one after the other."""


def stepper(driver: StepperDriver = StepperDriver.STEP_DIR, *, top: float = 100.0) -> StepperState:
    names = ("step", "dir", "enable") if driver is StepperDriver.STEP_DIR else ("in1", "in2", "in3", "in4")
    wired = WiredStepper(
        label="motors[1]",
        places={"": "wiring.toml:1"},
        board="rover",
        driver=driver,
        pins={name: number for number, name in enumerate(names, 2)},
        wheel="left",
        wheel_index=0,
        steps_per_inch=100.0,
        top_speed=top,
        enable_high=False,
        reversed=False,
    )
    return StepperState(wired)


def level(time: int, pin: int, value: int) -> BoardRecord:
    return BoardRecord(time, Told.LEVEL, pin, 0, value)


def steps(times: Iterable[int], first: int = 1) -> list[BoardRecord]:
    return [level(0, 3, first), *(BoardRecord(time, Told.STEP, 2, 0, 7) for time in times)]


def rim(state: StepperState, records: Sequence[BoardRecord], looks: Iterable[int]) -> list[tuple[int, float]]:
    """The rim's changes, each with its time and new speed, in/s. Records are told by the looks."""
    waiting, changes = list(records), []
    for look in looks:
        while waiting and waiting[0].time <= look:
            state.add(waiting.pop(0))
        while state.due <= look:
            time, before = state.due, state.speed
            state.happen()
            if state.speed != before:
                changes.append((time, state.speed))
    return changes


def travelled(changes: Sequence[tuple[int, float]], until: int) -> float:
    """Inches by a time."""
    ends = [min(time, until) for time, _ in changes[1:]] + [until]
    return sum(speed * max(end - time, 0) / SECOND for (time, speed), end in zip(changes, ends, strict=True))


def uneven(rate: float, seconds: float, jitter: float, seed: int = 1) -> list[int]:
    """Times of steps that a loop makes, each late by up to `jitter` seconds."""
    chance, time, times = random.Random(seed), 0.0, []
    while time < seconds:
        time += 1.0 / rate + chance.random() * jitter
        times.append(round(time * SECOND))
    return times


@pytest.mark.parametrize(("rate", "jitter"), [(30, 0), (100, 1e-4), (340, 1e-3), (1000, 1e-4), (4000, 5e-5)])
def test_the_rim_stands_on_the_last_step_and_is_near_it_before(rate: float, jitter: float) -> None:
    times = uneven(rate, 2.0, jitter)
    changes = rim(stepper(), steps(times), [4 * SECOND])
    assert travelled(changes, 4 * SECOND) == pytest.approx(len(times) / 100, abs=1e-7)
    # One that stands between two steps needs two changes a step; else far fewer.
    alone = rate * ALONE / SECOND < 1.0
    assert len(changes) <= 2 * len(times) if alone else len(changes) < len(times) / 4
    most = max(2.5, 0.006 * rate)
    for done, time in enumerate(times, 1):
        assert -1e-6 <= done - travelled(changes, time) * 100 <= most
    assert all(speed >= 0.0 for _, speed in changes)


def test_looks_at_any_times_change_nothing() -> None:
    times = [*uneven(200, 0.5, 1e-3), *(700 * _MS + time for time in uneven(1500, 0.5, 1e-4))]
    records = steps(times)
    made = [
        rim(stepper(), records, range(0, 2 * SECOND, slice_)) for slice_ in (100_000, 7 * _MS, 2 * SECOND - 1)
    ]
    assert made[0] == made[1] == made[2]


def mixed(seed: int) -> list[BoardRecord]:
    """Steps at several rates, with turns back and a driver that is off for a while."""
    chance, time, records = random.Random(seed), 0, []
    for _ in range(12):
        records += [level(time, 3, chance.randrange(2)), level(time, 4, int(chance.random() < 0.2))]
        rate, jitter = chance.choice(((30.0, 0.0), (200.0, 1e-3), (900.0, 2e-5), (1500.0, 1e-4)))
        made = uneven(rate, 0.15, jitter, chance.randrange(99))
        records += [BoardRecord(time + each, Told.STEP, 2, 0, 7) for each in made]
        time += made[-1] + 1 + chance.randrange(2) * 30 * _MS
    return records


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("ahead", [300_000, 20 * _MS])
def test_the_next_change_of_speed_is_known_before_it_comes(seed: int, ahead: int) -> None:
    """The board is up to a slice ahead of the world, which goes from one change to the next."""
    records, expected = mixed(seed), rim(stepper(), mixed(seed), [3 * SECOND])
    state, now, found, waiting = stepper(), 0, [], list(records)
    while now < 3 * SECOND:
        if state.known_until <= now:
            state.known_until = now + ahead
            while waiting and waiting[0].time <= state.known_until:
                state.add(waiting.pop(0))
        now = min(state.next_change(now), state.known_until)
        while state.due <= now:
            time, before = state.due, state.speed
            state.happen()
            if state.speed != before:
                assert time == now
                found.append((time, state.speed))
    assert found == expected
    assert len(found) < len(records) / 2


def test_a_cut_of_the_power_makes_another_future() -> None:
    state = stepper()
    for record in steps(range(_MS, 400 * _MS, _MS)):
        state.add(record)
    state.known_until = 300 * _MS
    while state.due <= 99 * _MS:
        state.happen()
    assert state.next_change(99 * _MS) > 100 * _MS
    state.cut(99 * _MS)
    assert state.next_change(99 * _MS) == 100 * _MS  # the next step starts it again


def test_a_single_step_takes_its_time_and_a_reversal_turns_back() -> None:
    alone = rim(stepper(), steps([_MS]), [SECOND])
    assert alone == [(_MS, 0.01 * SECOND / ALONE), (_MS + ALONE, 0.0)]
    there = [number * _MS for number in range(1, 101)]
    back = [BoardRecord(time + 100 * _MS, Told.STEP, 2, 0, 7) for time in there]
    records = [*steps(there), level(100 * _MS + 1, 3, 0), *back]
    changes = rim(stepper(), records, [SECOND])
    assert travelled(changes, SECOND) == pytest.approx(0.0, abs=1e-7)
    assert max(travelled(changes, time) for time in range(0, 300 * _MS, _MS)) > 0.97


def test_a_driver_that_is_not_enabled_moves_nothing() -> None:
    state, missed = stepper(), list[str]()
    state.on_missed = lambda which, reason: missed.append(reason)
    records = [level(0, 4, 1), *steps([_MS, 2 * _MS]), level(3 * _MS, 4, 0), *steps([4 * _MS])[1:]]
    changes = rim(state, records, [SECOND])
    assert missed == [IDLE, IDLE]
    assert travelled(changes, SECOND) == pytest.approx(0.01)


def test_steps_faster_than_the_wheel_are_lost() -> None:
    state, missed = stepper(top=5.0), list[str]()
    state.on_missed = lambda which, reason: missed.append(reason)
    times = [number * _MS for number in range(1, 1001)]
    changes = rim(state, steps(times), [3 * SECOND])
    # 5 in/s are 500 steps/s of the 1,000.
    assert set(missed) == {LOST}
    assert 450 < len(missed) < 500
    assert travelled(changes, 3 * SECOND) == pytest.approx((1000 - len(missed)) / 100, abs=1e-6)
    assert max(speed for _, speed in changes) == 5.0


def test_cut_power_leaves_the_rim_where_it_is() -> None:
    state = stepper()
    rim(state, steps([number * _MS for number in range(1, 101)]), [100 * _MS])
    assert state.speed > 0.0
    state.cut(100 * _MS)
    assert (state.speed, state.due) == (0.0, NEVER)
    changes = rim(state, [BoardRecord(SECOND, Told.STEP, 2, 0, 7)], [2 * SECOND])
    assert travelled(changes, 2 * SECOND) == pytest.approx(0.01)


def coils(sequence: Sequence[Sequence[int]], count: int, by: int = 1) -> list[BoardRecord]:
    """Coils switched `count` times, 5 ms apart, one pin after the other."""
    records, before = [], (0, 0, 0, 0)
    for number in range(count):
        after = tuple(sequence[by * (number + 1) % len(sequence)])
        for place, (old, new) in enumerate(zip(before, after, strict=True)):
            if old != new:
                records.append(level(5 * _MS * (number + 1) + 4000 * place, 2 + place, new))
        before = after
    return records


@pytest.mark.parametrize(
    ("driver", "sequence", "steps_each"),
    [
        (StepperDriver.STEPPER4, FULL, 1.0),
        (
            StepperDriver.STEPPER4,
            tuple(
                each
                for one, two in zip(FULL, (*FULL[1:], FULL[0]), strict=True)
                for each in (one, tuple(a & b for a, b in zip(one, two, strict=True)))
            ),
            0.5,
        ),
        (StepperDriver.ULN2003, WAVE, 1.0),
    ],
)
@pytest.mark.parametrize("by", [1, -1])
def test_coils_turn_by_whole_and_half_steps(
    driver: StepperDriver, sequence: Sequence[Sequence[int]], steps_each: float, by: int
) -> None:
    changes = rim(stepper(driver), coils(sequence, 60, by), [SECOND])
    assert travelled(changes, SECOND) == pytest.approx(by * 60 * steps_each / 100, abs=1e-7)


def test_coils_that_hold_and_that_jump_turn_nothing() -> None:
    hold = [level(0, 2, 1), level(4000, 4, 1)]
    assert rim(stepper(StepperDriver.STEPPER4), hold, [SECOND]) == []
    # Half a turn of the field, and coils that are on for less than a current needs.
    jump = [*hold, level(SECOND, 2, 0), level(SECOND, 3, 1), level(SECOND, 4, 0), level(SECOND, 5, 1)]
    short = [level(2 * SECOND, 2, 0), level(2 * SECOND + COIL_TIME - 1, 2, 1)]
    assert rim(stepper(StepperDriver.STEPPER4), jump, [4 * SECOND]) == []
    assert rim(stepper(StepperDriver.STEPPER4), [*hold, *short], [4 * SECOND]) == []
    # One step after a hold is one step.
    turned = rim(
        stepper(StepperDriver.STEPPER4),
        [*hold, level(2 * SECOND, 2, 0), level(2 * SECOND, 3, 1)],
        [3 * SECOND],
    )
    assert travelled(turned, 3 * SECOND) == pytest.approx(0.01, abs=1e-9)
