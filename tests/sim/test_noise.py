"""Random errors have the mean and spread the configuration states, each from its own stream.

Kolmogorov-Smirnov with fixed seeds: D is compared with 1.95 / sqrt(n), which chance exceeds once in
a thousand (Kolmogorov's asymptotic law, 2 exp(-2 n D^2) = 0.001).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.sim import Axes, DriveKind, SensorSpec, SimulationSpec, Simulator
from simmer_tui.sim.noise import random_bias, stream
from simmer_tui.sim.sensors import Compass, CompassSpec

CODES = {"up": "w1", "down": "s1", "left": "a1", "right": "d1", "rot": "r1"}
AXES = {
    DriveKind.UP: (0.0, 1.0, 0.0),
    DriveKind.DOWN: (0.0, -1.0, 0.0),
    DriveKind.LEFT: (-1.0, 0.0, 0.0),
    DriveKind.RIGHT: (1.0, 0.0, 0.0),
    DriveKind.ROT: (0.0, 0.0, 1.0),
}


def normal_share(z: float) -> float:
    """Share of a standard normal population below z."""
    return 0.5 * math.erfc(-z / math.sqrt(2.0))


def assert_standard_normal(draws: Sequence[float]) -> None:
    """Kolmogorov-Smirnov against N(0, 1) at a level of one in a thousand."""
    ordered = np.sort(np.asarray(draws, dtype=np.float64))
    count = len(ordered)
    expected = np.array([normal_share(z) for z in ordered])
    steps = np.arange(count + 1) / count
    distance = max((steps[1:] - expected).max(), (expected - steps[:-1]).max())
    assert distance < 1.95 / math.sqrt(count), f"D = {distance:.4f} over {count} draws"


def test_the_test_itself_sees_a_wrong_mean_and_a_wrong_spread() -> None:
    draws = np.random.default_rng(1).standard_normal(2000)
    assert_standard_normal(list(draws))
    for wrong in (draws + 0.15, draws * 1.2, draws * 0.8, np.abs(draws)):
        with pytest.raises(AssertionError, match="D ="):
            assert_standard_normal(list(wrong))


def quiet(spec: SimulationSpec, sensor: SensorSpec) -> SimulationSpec:
    """A robot with one sensor, no drive errors and movements of one part."""
    drives = tuple(replace(drive, error=Axes()) for drive in spec.drives)
    return replace(spec, sensors=(sensor,), drives=drives, randbias=False, num_segments=1, bot_rot=30.0)


def sensor_of(spec: SimulationSpec, code: str) -> SensorSpec:
    return next(sensor for sensor in spec.sensors if sensor.code == code)


# -- sensors ---------------------------------------------------------------------------------


@pytest.mark.parametrize("code", ["u1", "u2", "u3", "u4", "u5", "t1", "c1"])
def test_a_reading_errs_by_its_share_of_the_true_value(noisy_spec: SimulationSpec, code: str) -> None:
    sensor = sensor_of(noisy_spec, code)
    simulator = Simulator(quiet(noisy_spec, sensor), seed=5)
    true = simulator.true_value(code)
    assert true > 1.0
    replies = [simulator.execute(code).reply for _ in range(3000)]
    assert_standard_normal([(reply / true - 1.0) / sensor.error for reply in replies])


@pytest.mark.parametrize("code", ["u1", "t1", "c1"])
def test_an_absolute_error_is_added_to_the_other(noisy_spec: SimulationSpec, code: str) -> None:
    sensor = replace(
        sensor_of(noisy_spec, code), absolute_error=0.7, gain=-2.0, bias=100.0, max_range=math.inf
    )
    simulator = Simulator(quiet(noisy_spec, sensor), seed=6)
    true = simulator.true_value(code)
    spread = math.hypot(2.0 * true * sensor.error, 0.7)
    replies = [simulator.execute(code).reply for _ in range(3000)]
    assert_standard_normal([(reply - (100.0 - 2.0 * true)) / spread for reply in replies])


@pytest.mark.parametrize("code", ["o1", "g1"])
def test_counting_sensors_draw_nothing_but_an_absolute_error_when_read(
    noisy_spec: SimulationSpec, code: str
) -> None:
    sensor = replace(sensor_of(noisy_spec, code), absolute_error=0.3)
    simulator = Simulator(quiet(noisy_spec, sensor), seed=6)
    assert_standard_normal([simulator.execute(code).reply / 0.3 for _ in range(3000)])
    exact = Simulator(quiet(noisy_spec, replace(sensor, absolute_error=0.0)), seed=6)
    exact.execute("r1-10")
    assert len({exact.execute(code).reply for _ in range(10)}) == 1


@pytest.mark.parametrize("share_of_threshold", [0.97, 1.0, 1.04])
def test_a_line_sensor_tips_over_as_often_as_its_error_says(
    noisy_spec: SimulationSpec, share_of_threshold: float
) -> None:
    code = "i1"
    sensor = sensor_of(noisy_spec, code)
    pose = quiet(noisy_spec, sensor)
    fraction = Simulator(replace(pose, bot_center=(8.0, 41.0))).true_value(code)
    assert 0.1 < fraction < 1.0
    limit = replace(sensor, threshold=fraction * share_of_threshold)
    simulator = Simulator(replace(pose, bot_center=(8.0, 41.0), sensors=(limit,)), seed=7)
    expected = 1.0 - normal_share((share_of_threshold - 1.0) / sensor.error)
    assert limit.threshold <= 1.0, "what is clamped to 1 could never reach it"
    count = 3000
    ones = sum(simulator.execute(code).reply for _ in range(count))
    chi_square = (ones - count * expected) ** 2 / (count * expected * (1.0 - expected))
    assert chi_square < 10.83, "one in a thousand, one degree of freedom"


@pytest.mark.quick_cases(3)
@pytest.mark.parametrize(
    ("code", "command", "increment"),
    [
        ("o3", "d1-0.5", 0.5),
        ("o2", "s1-0.5", -0.5),
        ("o1", "r1-10", 2 * math.pi * 3 * 10 / 360),
        ("o4", "a1-0.5", -0.5),
        ("o1", "w1-0.5", 0.5),
        ("o3", "r1-10", -2 * math.pi * 3 * 10 / 360),
    ],
)
def test_odometers_err_in_every_increment(
    noisy_spec: SimulationSpec, code: str, command: str, increment: float
) -> None:
    sensor = sensor_of(noisy_spec, code)
    simulator = Simulator(quiet(noisy_spec, sensor), seed=8)
    back = {"d": "a", "a": "d", "w": "s", "s": "w"}
    draws, last = [], 0.0
    for turn in range(800):
        there = command if command[0] == "r" or turn % 2 == 0 else back[command[0]] + command[1:]
        simulator.execute(there)
        now = simulator.execute(code).reply
        signed = increment if there == command else -increment
        draws.append(((now - last) / signed - 1.0) / sensor.error)
        last = now
    assert_standard_normal(draws)


def test_turn_and_translation_of_a_segment_have_draws_of_their_own(noisy_spec: SimulationSpec) -> None:
    sensor = replace(sensor_of(noisy_spec, "o3"), error=0.1)
    spec = replace(quiet(noisy_spec, sensor), num_segments=10, bot_rot=0.0)
    simulator = Simulator(spec, seed=9)
    simulator.set_bias({DriveKind.RIGHT: Axes(r=10.0)})  # ten degrees an inch
    draws = []
    for _ in range(150):
        trajectory = simulator.execute("d1-1").trajectory
        assert trajectory is not None
        turned = 2 * math.pi * -3.0 * trajectory.path.turn / 360
        parts = trajectory.wheels["odom3"] / np.array((turned, trajectory.move[0]))
        draws.append((parts - 1.0) / 0.1)
        simulator.reset(simulator.seed + 1)
        simulator.set_bias({DriveKind.RIGHT: Axes(r=10.0)})
    pairs = np.concatenate(draws)
    assert pairs.shape == (1500, 2)
    assert_standard_normal(list(pairs.ravel()))
    together = np.corrcoef(pairs.T)[np.triu_indices(2, 1)]
    assert np.abs(together).max() < 3.3 / math.sqrt(len(pairs))


def test_a_gyro_errs_in_every_segment(noisy_spec: SimulationSpec) -> None:
    sensor = sensor_of(noisy_spec, "g1")
    simulator = Simulator(replace(quiet(noisy_spec, sensor), num_segments=10), seed=10)
    draws = []
    for _ in range(300):
        trajectory = simulator.execute("r1-10").trajectory
        assert trajectory is not None
        draws += list((trajectory.turns["gyro1"] - 1.0) / sensor.error)
    assert_standard_normal(draws)
    assert simulator.execute("g1").reply == pytest.approx(3000.0, rel=0.01)


# -- drives ----------------------------------------------------------------------------------


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize("kind", sorted(AXES, key=lambda kind: kind not in (DriveKind.LEFT, DriveKind.ROT)))
def test_a_drive_errs_on_every_axis_once_a_command(noisy_spec: SimulationSpec, kind: DriveKind) -> None:
    errors, bias = Axes(0.05, 0.02, 0.03), Axes(0.1, -0.2, 0.3)
    drives = tuple(replace(drive, error=errors, bias=bias) for drive in noisy_spec.drives)
    spec = replace(noisy_spec, drives=drives, randbias=False, num_segments=10, sensors=())
    simulator = Simulator(spec, seed=11)
    draws = []
    direction = np.array(AXES[kind])
    for count in range(1000):
        value = 0.5 if count % 3 else -0.25
        outcome = simulator.execute(f"{CODES[kind.value]}-{value}")
        simulator.teleport(outcome.before)
        trajectory = outcome.trajectory
        assert trajectory is not None
        totals = 10 * np.array((*trajectory.move, trajectory.path.turn))
        asked = value * direction
        whole, biases = asked.sum(), np.array((bias.x, bias.y, bias.r))
        spread = whole * (1.0 + biases) * np.array((errors.x, errors.y, errors.r))
        draws.append((totals - asked - whole * biases) / spread)
    table = np.array(draws)
    for axis in range(3):
        assert_standard_normal(list(table[:, axis]))
    together = np.corrcoef(table.T)[np.triu_indices(3, 1)]
    assert np.abs(together).max() < 3.3 / math.sqrt(len(table))


def test_random_bias_has_the_strength_asked_for_in_all_fifteen_numbers() -> None:
    strength = (0.05, 1.0)
    drawn = [random_bias(seed, strength) for seed in range(1500)]
    straight, turning = strength[0], strength[1] / 360
    columns = []
    for kind in AXES:
        for axis in "xyr":
            spread = turning if kind is DriveKind.ROT else straight * (10 if axis == "r" else 1)
            column = [getattr(bias[kind], axis) / spread for bias in drawn]
            assert_standard_normal(column)
            columns.append(column)
    together = np.corrcoef(columns)[np.triu_indices(15, 1)]
    assert np.abs(together).max() < 4.0 / math.sqrt(1500), "fifteen independent draws"


def test_random_bias_replaces_that_of_the_file_only_when_asked(noisy_spec: SimulationSpec) -> None:
    drives = tuple(replace(drive, bias=Axes(9.0, 9.0, 9.0)) for drive in noisy_spec.drives)
    drawn = Simulator(replace(noisy_spec, drives=drives, randbias=True), seed=4)
    assert drawn.bias == random_bias(4, noisy_spec.strength)
    stated = Simulator(replace(noisy_spec, drives=drives, randbias=False), seed=4)
    assert set(stated.bias.values()) == {Axes(9.0, 9.0, 9.0)}


# -- streams ---------------------------------------------------------------------------------


def replies(spec: SimulationSpec, *commands: str, seed: int = 12) -> list[float]:
    simulator = Simulator(spec, seed)
    return [simulator.execute(command).reply for command in commands]


def test_polling_one_sensor_never_changes_another(noisy_spec: SimulationSpec) -> None:
    alone = replies(noisy_spec, "u1", "d1-3", "u1", "o1")
    mixed = replies(noisy_spec, "u2", "u1", "i1", "c1", "d1-3", "t1", "u3", "u1", "g1", "o1")
    assert [mixed[1], mixed[7], mixed[9]] == [alone[0], alone[2], alone[3]]


def test_a_stream_belongs_to_the_sensors_id_not_to_its_row_or_code(noisy_spec: SimulationSpec) -> None:
    before = replies(noisy_spec, "u1", "t1", "u1")
    backwards = replace(noisy_spec, sensors=noisy_spec.sensors[::-1])
    assert replies(backwards, "u1", "t1", "u1") == before
    renamed = tuple(replace(s, code="zz") if s.code == "u1" else s for s in noisy_spec.sensors)
    assert replies(replace(noisy_spec, sensors=renamed), "zz", "t1", "zz") == before


def test_sensors_of_different_ids_err_differently(noisy_spec: SimulationSpec) -> None:
    twins = tuple(
        CompassSpec(kind=Compass, number=number, code=f"c{number}", rotation=100.0, error=0.1)
        for number in (1, 2)
    )
    first, second = replies(replace(noisy_spec, sensors=twins), "c1", "c2")
    assert first != second


@pytest.mark.parametrize("refused", ["", "u", "zz", "d1", "d1-", "d1-abc", "d1-nan", "d1-inf", "d1-1e400"])
def test_a_refused_command_draws_nothing(noisy_spec: SimulationSpec, refused: str) -> None:
    assert replies(noisy_spec, refused, "d1-3", "u1", "o1")[1:] == replies(noisy_spec, "d1-3", "u1", "o1")


def test_without_noise_nothing_is_drawn_and_nothing_errs(
    noisy_spec: SimulationSpec, course_spec: SimulationSpec
) -> None:
    noisy = Simulator(replace(noisy_spec, randbias=False), seed=12)
    noisy.noise = False
    calm = [noisy.execute(command).reply for command in ("d1-3", "u1", "o1", "g1", "i1", "c1")]
    assert calm == replies(course_spec, "d1-3", "u1", "o1", "g1", "i1", "c1")
    noisy.noise = True
    assert noisy.execute("u1").reply == noisy.true_value("u1") * (
        1 + 0.02 * stream(12, "ultra1").standard_normal()
    )


def test_seeds_differ_and_repeat(noisy_spec: SimulationSpec) -> None:
    commands = ("d1-3", "u1", "o1", "r1-30", "c1", "g1")
    assert replies(noisy_spec, *commands) == replies(noisy_spec, *commands)
    assert replies(noisy_spec, *commands) != replies(noisy_spec, *commands, seed=13)


def test_reset_starts_every_stream_again(noisy_spec: SimulationSpec) -> None:
    simulator = Simulator(noisy_spec, seed=12)
    commands = ("u1", "d1-3", "u1", "o1", "g1", "i2")
    first = [simulator.execute(command).reply for command in commands]
    simulator.reset()
    assert [simulator.execute(command).reply for command in commands] == first
    simulator.reset(13)
    assert [simulator.execute(command).reply for command in commands] == replies(
        noisy_spec, *commands, seed=13
    )
