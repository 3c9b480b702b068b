"""Parts at a board's pins: motor drivers, encoders in closed form, analogRead, bytes at a wrong rate."""

from __future__ import annotations

import random
from itertools import pairwise

import pytest

from simmer_tui.sketch.board_link import sampled
from simmer_tui.sketch.board_process import BoardEvent
from simmer_tui.sketch.parts import NO_ECHO, EncoderState, analog_counts, echo_length, rim_speed
from simmer_tui.sketch.wiring import MotorDriver, WiredAnalog, WiredEncoder, WiredMotor

PLACES = {"": "wiring.toml:1"}


def motor(driver: MotorDriver, pins: dict[str, int], *, reversed: bool = False) -> WiredMotor:  # noqa: A002
    return WiredMotor(
        label="motors[1]",
        places=PLACES,
        board="rover",
        driver=driver,
        pins=pins,
        wheel="left",
        wheel_index=0,
        top_speed=10.0,
        dead_band=0.1,
        full_pulse=500.0,
        reversed=reversed,
    )


@pytest.mark.parametrize(
    ("driver", "levels", "speed"),
    [
        (MotorDriver.HBRIDGE, {1: 1.0, 2: 1.0}, 10.0),
        (MotorDriver.HBRIDGE, {1: 0.55, 3: 1.0}, -5.0),
        (MotorDriver.HBRIDGE, {1: 0.1, 2: 1.0}, 0.0),
        (MotorDriver.HBRIDGE, {1: 1.0, 2: 1.0, 3: 1.0}, 0.0),
        (MotorDriver.SHIELD, {1: 1.0, 2: 0.55}, 5.0),
        (MotorDriver.SHIELD, {2: 1.0}, -10.0),
        (MotorDriver.SHIELD, {1: 1.0, 2: 1.0, 3: 1.0}, 0.0),
        (MotorDriver.PWM2, {1: 0.55}, 5.0),
        (MotorDriver.PWM2, {2: 1.0}, -10.0),
        # Pulses of 1,500, 1,775, 1,000 and 2,200 us at 50 Hz; without one it stands.
        (MotorDriver.SERVO360, {1: 0.075}, 0.0),
        (MotorDriver.SERVO360, {1: 0.08875}, 5.0),
        (MotorDriver.SERVO360, {1: 0.05}, -10.0),
        (MotorDriver.SERVO360, {1: 0.11}, 10.0),
        (MotorDriver.SERVO360, {}, 0.0),
    ],
)
def test_a_driver_turns_levels_into_a_rim_speed(
    driver: MotorDriver, levels: dict[int, float], speed: float
) -> None:
    names = {
        MotorDriver.HBRIDGE: ("en", "in1", "in2"),
        MotorDriver.SHIELD: ("dir", "pwm", "brake"),
        MotorDriver.PWM2: ("in1", "in2"),
        MotorDriver.SERVO360: ("pin",),
    }[driver]
    pins = dict(zip(names, (1, 2, 3), strict=False))

    def level_of(pin: int) -> float:
        return levels.get(pin, 0.0)

    assert rim_speed(motor(driver, pins), level_of) == pytest.approx(speed)
    assert rim_speed(motor(driver, pins, reversed=True), level_of) == pytest.approx(-speed)


def encoder(b: int | None = 3) -> EncoderState:
    wired = WiredEncoder(
        label="sensors[1]",
        places=PLACES,
        board="rover",
        wheel="left",
        wheel_index=0,
        a=2,
        b=b,
        edges_per_inch=40.0,
    )
    return EncoderState(wired)


def test_edges_of_an_encoder_are_the_same_however_time_is_cut() -> None:
    changes = [(0, 3.7), (400_000_001, -2.1), (900_000_000, 0.0), (1_100_000_003, 9.9)]
    end = 2_000_000_000
    seed = random.Random(1)
    found: list[list[BoardEvent]] = []
    for pieces in (1, 7, 900):
        state, edges = encoder(), []
        for (time, speed), (until, _) in zip(changes, [*changes[1:], (end, 0.0)], strict=True):
            state.set_speed(time, speed)
            cuts = sorted({time, until, *(seed.randrange(time, until) for _ in range(pieces - 1))})
            for begin, stop in pairwise(cuts):
                edges += state.edges(begin, stop)
        found.append(edges)
    assert found[0] == found[1] == found[2]
    # 1.48 in ahead, 1.05 in back, 8.91 in ahead: each inch has 40 edges, an event for each of both channels.
    assert len(found[0]) == pytest.approx(2 * 40 * (1.48 + 1.05 + 8.91), abs=6)


def test_channel_a_leads_where_a_wheel_rolls_forward() -> None:
    state = encoder()
    state.set_speed(0, 1.0)
    levels = [(event.pin, event.value) for event in state.edges(0, 100_000_000)]
    assert levels[:4] == [(2, 1), (3, 0), (2, 1), (3, 1)]


def test_an_echo_lasts_as_long_as_sound_travels() -> None:
    assert echo_length(13.504) == 2_000_000
    assert echo_length(float("inf")) == echo_length(float("nan")) == echo_length(200.0) == NO_ECHO


def test_counts_lie_on_lines_between_the_points() -> None:
    sensor = WiredAnalog(
        label="sensors[1]",
        places=PLACES,
        code="i1",
        board="rover",
        pin=14,
        points=((0.0, 100.0), (1.0, 900.0)),
    )
    assert [analog_counts(sensor, each, 1023) for each in (-1.0, 0.0, 0.25, 1.0, 5.0)] == [
        100,
        100,
        300,
        900,
        900,
    ]


def test_bytes_arrive_wrong_at_another_rate() -> None:
    assert sampled(0x55, 9600, 9600) == 0x55
    # Twice as fast: the receiver sees each bit twice, and the start bit first.
    assert sampled(0b0000_0011, 9600, 19200) == 0b0001_1110
    assert sampled(0xFF, 115200, 9600) == 0xFF
