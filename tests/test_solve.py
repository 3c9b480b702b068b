"""The sample that does the whole mission: its parts one by one, then all of it."""

from __future__ import annotations

import functools
import importlib
import itertools
import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui.config.loader import find_set, load
from simmer_tui.config.mission_toml import Heading
from simmer_tui.config.settings_file import Override
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Action, ActionName, Result
from simmer_tui.run.mission import MissionPlan, MissionState, Referee, plan_run
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import checkpoint_of
from simmer_tui.sim import SimulationSpec, Simulator, parse_command

SCRIPTS = Path(__file__).parents[1] / "scripts"
PARTS = ("solve_ground", "solve_beliefs", "solve_pilot", "solve_way", "solve")


@pytest.fixture(scope="module")
def parts() -> Iterator[dict[str, ModuleType]]:
    path = list(sys.path)
    sys.path.insert(0, str(SCRIPTS))
    yield {name: importlib.import_module(name) for name in PARTS}
    sys.path[:] = path
    for name in PARTS:
        del sys.modules[name]


@pytest.fixture(scope="module")
def ground(parts: dict[str, ModuleType]) -> Any:
    return parts["solve_ground"].Ground(mission_spec().maze)


@pytest.fixture
def localizer(parts: dict[str, ModuleType], ground: Any) -> Any:
    made = parts["solve_beliefs"].Localizer(
        Simulator(mission_spec()), ground, parts["solve_pilot"].RANGES, np.random.default_rng(1)
    )
    made.scatter(3.0, 0.0, 5.0)
    return made


@functools.cache
def mission_spec() -> SimulationSpec:
    return load(find_set("mission")).simulation


# -- the ground ------------------------------------------------------------------------------------


def test_a_route_is_the_shortest_one_that_goes_around_the_walls(ground: Any) -> None:
    way = ground.route((2, 1), (5, 3))
    assert way[0] == (2, 1)
    assert way[-1] == (5, 3)
    assert len(way) == 8  # down, along the bottom row, up again
    for (column, row), (next_column, next_row) in itertools.pairwise(way):
        assert abs(column - next_column) + abs(row - next_row) == 1
        assert ground.is_free((next_column, next_row))


def test_there_is_no_route_into_a_wall_or_out_of_the_maze(ground: Any) -> None:
    assert ground.route((2, 1), (4, 3)) == []
    assert ground.route((2, 1), (8, 0)) == []


def test_a_route_to_where_the_robot_is_is_that_cell(ground: Any) -> None:
    assert ground.route((2, 1), (2, 1)) == [(2, 1)]


@pytest.mark.parametrize(
    ("point", "distance"),
    [((30, 18), 6), ((33, 18), 3), ((30, 20), 4), ((18, 36), 6), ((27, 33), 0), ((0, 20), 0), ((-5, 20), 0)],
    ids=["middle", "nearer the right", "nearer the top", "open area", "in a wall", "edge", "outside"],
)
def test_clearance_is_the_distance_to_the_nearest_wall(
    ground: Any, point: tuple[float, float], distance: float
) -> None:
    assert ground.clearance(np.array([point], dtype=float)) == pytest.approx(distance)


def test_clearance_counts_the_corner_of_a_wall_across(ground: Any) -> None:
    # (24, 36) is the corner of a wall; from (21, 40) nothing else is as near.
    assert ground.clearance(np.array([[21.0, 40.0]])) == pytest.approx(5.0)


def test_the_cells_beside_the_loading_zone_are_its_two_doors(ground: Any) -> None:
    assert ground.beside(ground.cells(3)) == {(2, 3), (0, 1)}


# -- where the robot is ------------------------------------------------------------------------------


def test_particles_are_scattered_wherever_the_robot_fits(localizer: Any, ground: Any) -> None:
    places = localizer.particles[:, :2]
    assert ground.clearance(places).min() >= 3.0
    assert {tuple(cell) for cell in (places // 12).astype(int).tolist()} == set(ground.cells())
    assert np.std(localizer.particles[:, 2]) == pytest.approx(5.0, rel=0.1)
    assert not localizer.settled


def test_particles_follow_odometers_and_gyroscope_with_a_little_error(localizer: Any) -> None:
    localizer.particles[:] = (30.0, 42.0, 90.0)
    localizer.predict(6.0, 2.0, 0.0)
    assert localizer.pose == pytest.approx([28.0, 48.0, 90.0], abs=0.05)
    assert 0.05 < localizer.spread < 0.3


def test_a_turn_on_the_way_bends_the_path_half_as_much(localizer: Any) -> None:
    localizer.particles[:] = (30.0, 18.0, 0.0)
    localizer.predict(6.0, 0.0, 20.0)
    # The chord of an arc that turns by 20 degrees points 10 degrees to its side.
    x, y = 30 + 6 * math.cos(math.radians(10)), 18 + 6 * math.sin(math.radians(10))
    assert localizer.pose == pytest.approx([x, y, 20.0], abs=0.05)


def test_the_mean_heading_of_north_and_a_little_less_is_no_half_turn(localizer: Any) -> None:
    localizer.particles[:] = (30.0, 18.0, 358.0)
    localizer.particles[::2, 2] = 2.0
    assert localizer.pose[2] == pytest.approx(0.0, abs=0.1)


def readings_at(pose: tuple[float, float, float], codes: tuple[str, ...]) -> Any:
    return Simulator(mission_spec()).true_ranges(np.array([pose]), codes)[0]


def test_readings_draw_the_particles_to_the_place_where_they_would_be_read(localizer: Any) -> None:
    localizer.particles[:, :2] = localizer.particles[:, :2] % 6 + (27.0, 39.0)
    readings = readings_at((31.0, 41.5, 2.0), localizer.ranges)
    for _ in range(4):
        localizer.update(localizer.ranges, readings)
        localizer.predict(0.0, 0.0, 0.0)
    assert localizer.pose == pytest.approx([31.0, 41.5, 2.0], abs=1.0)
    assert localizer.settled
    assert localizer.fit > 0.9
    assert len(localizer.particles) == 500


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("wrong", [2.0, math.inf])
def test_one_senseless_reading_does_not_lead_astray(localizer: Any, wrong: float) -> None:
    localizer.particles[:, :2] = localizer.particles[:, :2] % 6 + (27.0, 39.0)
    readings = readings_at((31.0, 41.5, 2.0), localizer.ranges)
    readings[localizer.ranges.index("t1")] = wrong
    for _ in range(4):
        localizer.update(localizer.ranges, readings)
        localizer.predict(0.0, 0.0, 0.0)
    assert localizer.pose == pytest.approx([31.0, 41.5, 2.0], abs=1.0)


def test_a_belief_that_no_reading_fits_is_not_settled(localizer: Any) -> None:
    localizer.particles[:] = (30.01, 18.01, 0.01)
    localizer.update(localizer.ranges, readings_at((90.0, 18.0, 90.0), localizer.ranges))
    assert localizer.fit < 0.5
    assert not localizer.settled


# -- where the block lies ------------------------------------------------------------------------------


@pytest.fixture
def finder(parts: dict[str, ModuleType], ground: Any) -> Any:
    spec = mission_spec()
    finder = parts["solve_beliefs"].BlockFinder
    return finder(Simulator(spec), ground, ("u1", "u5"), spec.block_size, ground.cells(3))


def look(finder: Any, block: tuple[float, float], pose: tuple[float, float, float]) -> None:
    simulator = Simulator(replace(mission_spec(), block_center=block))
    low = simulator.true_ranges(np.array([pose]), ("u5",))[0, 0]
    finder.update(np.array(pose), finder.wall(np.array(pose)), low)


def test_guesses_fill_the_loading_zone_but_for_the_edges(finder: Any, ground: Any) -> None:
    assert finder.guesses.min(axis=0) == pytest.approx([1.75, 24.25])
    assert finder.guesses.max(axis=0) == pytest.approx([23.75, 46.25])
    assert ground.clearance(finder.guesses).min() >= 1.5


def test_looking_past_a_place_rules_out_a_block_there(finder: Any) -> None:
    look(finder, (8.0, 30.0), (30.0, 42.0, 180.0))
    on_the_ray = np.abs(finder.guesses[:, 1] - 42.0) < 1.0
    assert finder.weights[on_the_ray].sum() < 0.001
    assert finder.weights[~on_the_ray].sum() == pytest.approx(1.0, abs=0.001)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("block", [(10.0, 41.0), (4.0, 44.0), (20.0, 27.0)])
def test_a_sweep_finds_the_block(finder: Any, block: tuple[float, float]) -> None:
    for heading in range(90, 360, 6):
        look(finder, block, (18.0, 36.0, heading))
    assert finder.place == pytest.approx(block, abs=0.8)
    assert finder.spread < 0.8
    finder.forget()
    assert finder.spread > 5.0


def test_a_block_at_an_angle_sends_no_echo_back(parts: dict[str, ModuleType], ground: Any) -> None:
    spec = load(find_set("mission"), {"realistic": Override("--realistic", True)}).simulation
    finder = parts["solve_beliefs"].BlockFinder(Simulator(spec), ground, ("u1", "u5"), 3.0, ground.cells(3))
    on_the_ray = np.hypot(*(finder.guesses - (12.0, 36.0)).T) < 1.0
    for heading, seen in ((180.0, True), (135.0, False)):
        ahead = np.array((math.cos(math.radians(heading)), math.sin(math.radians(heading))))
        pose = np.array((*((12.0, 36.0) - 10.0 * ahead), heading))
        finder.forget()
        finder.update(pose, math.inf, math.inf)
        assert (finder.weights[on_the_ray].max() < 0.5 * finder.weights.max()) == seen


def test_a_look_is_worth_most_where_the_block_may_be(finder: Any) -> None:
    toward, away = np.array((30.0, 42.0, 180.0)), np.array((30.0, 42.0, 0.0))
    assert finder.surprise(toward) > 1.0
    assert finder.surprise(away) == pytest.approx(0.0, abs=1e-9)
    look(finder, (8.0, 30.0), (30.0, 42.0, 180.0))
    assert finder.surprise(toward) < 0.1


def test_the_sensor_to_read_is_the_one_the_particles_differ_about(localizer: Any) -> None:
    """In a corridor along X, somewhere along it: those that look along it tell where, no other does."""
    localizer.particles[:] = (60.0, 30.0, 0.0)
    localizer.particles[:, 0] += np.linspace(-8.0, 8.0, len(localizer.particles))
    worth = dict(zip(localizer.ranges, localizer.worth(), strict=True))
    assert min(worth["u1"], worth["u3"]) > 2.0
    localizer.particles[:] = (60.0, 30.0, 0.0)
    assert max(localizer.worth()) < 0.1


def test_sensors_that_hear_nothing_at_an_angle_are_not_asked(
    parts: dict[str, ModuleType], ground: Any
) -> None:
    spec = load(find_set("mission"), {"realistic": Override("--realistic", True)}).simulation
    localizer = parts["solve_beliefs"].Localizer(
        Simulator(spec), ground, parts["solve_pilot"].RANGES, np.random.default_rng(1)
    )
    localizer.scatter(3.0, 0.0, 0.1)
    localizer.particles[:] = (66.0, 30.0, 0.0)
    localizer.particles[:, 1] += np.linspace(-2.0, 2.0, len(localizer.particles))
    here, turned = (dict(zip(localizer.ranges, localizer.worth(turn), strict=True)) for turn in (0.0, -45.0))
    assert here["u4"] == 0.0
    assert turned["u4"] > 1.0


# -- room ---------------------------------------------------------------------------------------------


@pytest.fixture
def body(parts: dict[str, ModuleType], ground: Any) -> Any:
    return parts["solve_ground"].Body(ground, 3.0)


def test_a_robot_without_a_block_turns_anywhere(body: Any) -> None:
    assert body.room_to_turn(np.array((66.0, 18.0)), 90.0, 180.0) == pytest.approx(3.0)


def test_a_block_ahead_is_too_long_to_turn_in_a_corridor_but_not_to_drive(body: Any) -> None:
    body.take(np.array((66.0, 18.0, 90.0)), np.array((66.0, 22.8)), 3.0)
    assert body.room_to_turn(np.array((66.0, 18.0)), 90.0, 180.0) < 0.0 + 1e-9
    assert body.room_ahead(np.array((66.0, 18.0)), np.array((66.0, 30.0))) == pytest.approx(3.0)


def test_there_is_a_spot_to_turn_with_the_block_in_a_bend(body: Any) -> None:
    """From the corridor upwards into the bottom row, to the right."""
    body.take(np.array((66.0, 18.0, 270.0)), np.array((66.0, 13.2)), 3.0)
    bend = np.array((66.0, 6.0))
    assert body.room_to_turn(bend, 270.0, -90.0) == 0.0
    spot = body.spot_to_turn(bend, 270.0, -90.0)
    assert body.room_to_turn(spot, 270.0, -90.0) > 0.5
    assert math.dist(spot, bend) < 3.0


# -- driving -----------------------------------------------------------------------------------------


@settings(max_examples=10)
@given(bias=st.lists(st.floats(-0.1, 0.1), min_size=6, max_size=6))
def test_a_learned_bias_is_made_up_for(parts: dict[str, ModuleType], bias: list[float]) -> None:
    model = parts["solve_pilot"].DriveModel()
    assert model.course(5.0) == 0.0
    forward, turn = np.array((1.0, 0.0, 0.0)) + bias[:3], np.array((0.0, 0.0, 1.0)) + bias[3:]
    for _ in range(10):
        model.learn("d1", 400.0, 400.0 * forward)
        model.learn("r1", 4000.0, 4000.0 * turn)
    assert model.per_unit("d1") == pytest.approx(forward, abs=1e-3)
    assert model.per_unit("r1") == pytest.approx(turn, abs=1e-3)
    aside = math.degrees(math.atan2(forward[1], forward[0]))
    assert model.course(5.0) == pytest.approx(aside + 2.5 * forward[2], abs=0.1)


class OverError(Exception):
    """The referee has ended the mission."""


class LocalRobot:
    """A robot in this process, with a referee who watches."""

    def __init__(self, simulator: Simulator, plan: MissionPlan) -> None:
        self.simulator = simulator
        self.engine = Engine(simulator)
        reducer = Reducer(checkpoint_of(simulator, mission=True))
        self.referee = Referee(plan, reducer)
        self.engine.watch(reducer.apply)
        self.engine.watch(self.referee.watch)
        self._session = self.engine.session()
        self.drives = 0
        self.beliefs: list[tuple[float, float, float]] = []

    def read(self, code: str) -> float:
        return self._ask(code)

    def _ask(self, text: str) -> float:
        replies: list[float] = []
        self._session.submit(parse_command(text), lambda outcome: replies.append(outcome.reply))
        return replies[0]

    def drive(self, code: str, value: float) -> None:
        self.drives += 1
        self._ask(f"{code}-{value!r}")
        if self.referee.state().over:
            raise OverError

    def believe(self, x: float, y: float, heading: float, *rest: object) -> None:
        self.beliefs.append((x, y, heading))


class KidnappedRobot(LocalRobot):
    """One that somebody carries elsewhere on its way."""

    def drive(self, code: str, value: float) -> None:
        if self.drives == 40:
            place = (66.0, 30.0, self.simulator.pose.heading + 90.0)
            self.engine.perform(Action(ActionName.TELEPORT, place))
        super().drive(code, value)


def do_mission(
    parts: dict[str, ModuleType],
    seed: int,
    heading: Heading = Heading.QUARTER,
    kind: type[LocalRobot] = LocalRobot,
    **settings: object,
) -> tuple[MissionState, LocalRobot]:
    overrides = {name: Override(f"--{name}", value) for name, value in settings.items()}
    configuration = load(find_set("mission"), overrides)
    assert configuration.mission is not None
    configuration = replace(configuration, mission=replace(configuration.mission, heading=heading))
    planned, plan = plan_run(configuration, seed)
    simulator = Simulator(planned.simulation, seed)
    robot = kind(simulator, plan)
    drop_zone = np.array((plan.drop_zone.x, plan.drop_zone.y))
    mission = parts["solve"].Mission(robot, configuration.simulation, np.random.default_rng(0))
    with pytest.raises(OverError):
        mission.run(drop_zone)
    return robot.referee.state(), robot


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "heading"), [(3, Heading.QUARTER), pytest.param(4, Heading.ANY, marks=pytest.mark.slow)]
)
def test_the_mission_is_done_in_time_and_without_a_contact(
    parts: dict[str, ModuleType], seed: int, heading: Heading
) -> None:
    state, robot = do_mission(parts, seed, heading)
    assert (state.result, state.reason) == (Result.SUCCESS, "")
    assert state.time < 100
    pose = robot.simulator.pose
    x, y, believed = robot.beliefs[-1]
    assert math.hypot(x - pose.x, y - pose.y) < 1.0
    assert abs(math.remainder(believed - pose.heading, 360.0)) < 5.0


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        {"realistic": True},
        {"drive_profile": "diff-dc"},
        pytest.param({"drive_profile": "diff-stepper"}, marks=pytest.mark.slow),
        pytest.param({"drive_profile": "diff-dc", "realistic": True}, marks=pytest.mark.slow),
    ],
    ids=["realistic", "diff-dc", "diff-stepper", "both"],
)
def test_it_bears_real_sensors_and_drives(parts: dict[str, ModuleType], settings: dict[str, object]) -> None:
    state, robot = do_mission(parts, 2, **settings)
    assert (state.result, state.reason) == (Result.SUCCESS, "")
    assert state.time < 150
    assert robot.simulator.commands < 1500


@pytest.mark.slow
def test_a_robot_that_is_carried_elsewhere_finds_itself_again(
    parts: dict[str, ModuleType], capsys: pytest.CaptureFixture[str]
) -> None:
    state, _ = do_mission(parts, 1, kind=KidnappedRobot)
    assert capsys.readouterr().out.count("somewhere, heading about") == 2
    assert state.result is Result.SUCCESS


# -- the program -------------------------------------------------------------------------------------


@pytest.mark.slow
def test_it_does_the_mission_in_the_simulator() -> None:
    program = f'"{sys.executable}" "{SCRIPTS / "solve.py"}"'
    command = [sys.executable, "-m", "simmer_tui", "--mission", "--no-ui", "--seed", "1"]
    command += ["--port", "0", "--reply-port", "0", "--belief-port", "0", "--run", program]
    ended = subprocess.run(
        command, cwd=SCRIPTS.parent, capture_output=True, text=True, timeout=300, check=False
    )
    assert ended.returncode == 0, ended.stderr
    assert "mission: success" in ended.stderr
    assert ended.stdout.splitlines()[-1] == "delivered"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--drop-zone", "1"], "'1' is not x,y in inches, such as 30,18"),
        (["--drop-zone", "1,nan"], "'1,nan' is not x,y"),
        (["--drop-zone", "30,18", "--config", "default"], "the robot of set 'default' has no l1, p1"),
    ],
)
def test_what_it_cannot_do_is_said_at_once(
    parts: dict[str, ModuleType],
    options: list[str],
    said: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as end:
        parts["solve"].main(options)
    assert end.value.code == 2
    assert said in capsys.readouterr().err.lower()


def test_a_maze_without_a_loading_zone_is_refused(
    parts: dict[str, ModuleType], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for path in find_set("mission").iterdir():
        if path.name != "mission.toml":
            (tmp_path / path.name).write_bytes(path.read_bytes().replace(b"3,3,", b"1,1,"))
    with pytest.raises(SystemExit):
        parts["solve"].main(["--drop-zone", "30,18", "--config", str(tmp_path)])
    assert "has no cell of value 3" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [([], "no simulator answers on 127.0.0.1 port 1"), (["--config", "nowhere"], "nowhere: there is no")],
)
def test_without_a_robot_or_its_set_it_ends_in_one_line(
    parts: dict[str, ModuleType],
    options: list[str],
    said: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("SIMMER_PORT", "1")  # nobody listens there
    monkeypatch.setenv("SIMMER_HOST", "127.0.0.1")
    monkeypatch.setenv("SIMMER_DROP_ZONE", "30,18")
    assert parts["solve"].main(options) == 1
    error = capsys.readouterr().err
    assert error.startswith(f"solve: {said}")
    assert error.count("\n") == 1
