"""Missions: planned from a seed, followed by a referee, ended with an exit code."""

from __future__ import annotations

import asyncio
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui.client import Robot
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.mission_plan import cells_of, draw_mission
from simmer_tui.config.mission_toml import Heading, MissionSpec
from simmer_tui.config.sets import bundled_sets, find_set
from simmer_tui.errors import ConfigurationError
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import (
    Action,
    ActionName,
    Event,
    Goal,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Result,
)
from simmer_tui.run.mission import MissionState, Referee, environment, mission_state, plan_run
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import MissionSums, checkpoint_of
from simmer_tui.runlog.decode import LogDecoder
from simmer_tui.runlog.line_form import line_form
from simmer_tui.runlog.log_records import CheckpointRecord, decode_line, encode_line
from simmer_tui.sim import Axes, Pose, RobotSpec, Simulator, parse_command
from simmer_tui.sim.footprint import Footprint
from tests.in_process import simmer

ROOT = Path(__file__).parent.parent.parent
calm = settings(
    max_examples=10,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
NEAR = MissionSpec(start=(18.0, 30.0), heading=180.0, block=(8.0, 30.0), drop_zone=(18.0, 42.0))
"""Six inches forward take the block, six back and twelve to the right bring it home."""
WAY = ("d1-6", "p1-1", "a1-6", "s1-12", "p1-0")


@pytest.fixture(scope="session")
def mission_set() -> Configuration:
    return load(bundled_sets()["mission"])


@pytest.fixture(scope="session")
def exact_set(mission_set: Configuration) -> Configuration:
    """The same robot without errors, and a mission that five commands do."""
    spec = mission_set.simulation
    drives = tuple(replace(drive, error=Axes()) for drive in spec.drives)
    return replace(
        mission_set,
        simulation=replace(spec, drives=drives, randbias=False),
        mission=replace(NEAR, contacts=0),
    )


class Game:
    """A mission with its referee, and what it told."""

    def __init__(self, configuration: Configuration, **changes: object) -> None:
        assert configuration.mission is not None
        mission = replace(configuration.mission, **changes)  # type: ignore[arg-type]  # any field
        planned, self.plan = plan_run(replace(configuration, mission=mission), 1)
        self.simulator = Simulator(planned.simulation, 1)
        self.engine = Engine(self.simulator)
        self.reducer = Reducer(checkpoint_of(self.simulator, mission=True))
        self.referee = Referee(self.plan, self.reducer, self.engine.tell)
        self.events: list[Event] = []
        self.engine.watch(self.events.append)
        self.engine.watch(self.reducer.apply)
        self.engine.watch(self.referee.watch)
        self.session = self.engine.session()

    def send(self, *texts: str) -> MissionState:
        for text in texts:
            self.session.submit(parse_command(text), lambda outcome: None)
        return self.referee.state()

    @property
    def subjects(self) -> list[str]:
        return [event.subject for event in self.events if isinstance(event, MissionEvent)]


# -- planning ------------------------------------------------------------------------------------


@calm
@given(
    seed=st.integers(0, 2**63 - 1),
    robot=st.sampled_from([RobotSpec.circle(6), RobotSpec.rectangle(12, 12), RobotSpec.rectangle(9, 4)]),
    heading=st.sampled_from([Heading.QUARTER, Heading.ANY, 30.0]),
    clearance=st.sampled_from([0.0, 1.0, 3.0]),
)
def test_no_seed_puts_robot_or_block_into_a_wall(
    mission_set: Configuration, seed: int, robot: RobotSpec, heading: float | Heading, clearance: float
) -> None:
    if robot == RobotSpec.rectangle(12, 12) and heading == 30.0:
        robot = RobotSpec.circle(8)
    spec = replace(mission_set.simulation, robot=robot, block_solid=True)
    plan = draw_mission(MissionSpec(heading=heading, clearance=clearance), spec, seed)
    starts = {(cell.x, cell.y) for cell in cells_of(spec.maze, 2)}
    assert (plan.start.x, plan.start.y) in starts
    if heading is Heading.QUARTER:
        assert plan.start.heading in (0, 90, 180, 270)
    assert any(cell.holds(*plan.block) for cell in plan.loading_zone)
    assert (plan.drop_zone.x, plan.drop_zone.y) in starts
    assert not plan.drop_zone.holds(plan.start.x, plan.start.y)
    centre = (plan.start.x, plan.start.y)
    simulator = Simulator(
        replace(spec, bot_center=centre, bot_rot=plan.start.heading, block_center=plan.block)
    )
    keeping_off = Footprint(polygons=(replace(simulator.block, size=3 + 2 * clearance - 1e-6).corners(),))
    assert not simulator.walls.overlap(keeping_off, Pose(0.0, 0.0, 0.0))
    assert plan == draw_mission(MissionSpec(heading=heading, clearance=clearance), spec, seed)


@pytest.mark.slow
def test_seeds_reach_every_start_drop_zone_and_corner_of_the_loading_zone(mission_set: Configuration) -> None:
    plans = [draw_mission(MissionSpec(), mission_set.simulation, seed) for seed in range(300)]
    assert len({(plan.start.x, plan.start.y) for plan in plans}) == 4
    assert len({plan.start.heading for plan in plans}) == 4
    assert len({plan.drop_zone for plan in plans}) == 4
    xs, ys = zip(*(plan.block for plan in plans), strict=True)
    # Cells of value 3 fill (0, 24) to (24, 48); walls are left and above, and below on the right.
    assert 2.5 <= min(xs) < 3.5
    assert 20 < max(xs) <= 24
    assert 24 <= min(ys) < 26
    assert 44.5 < max(ys) <= 45.5


def test_planning_changes_no_other_random_number(mission_set: Configuration) -> None:
    planned, _ = plan_run(mission_set, 5)
    assert Simulator(planned.simulation, 5).bias == Simulator(mission_set.simulation, 5).bias


def test_a_planned_configuration_repeats_its_seed_and_says_where_all_starts(
    mission_set: Configuration,
) -> None:
    planned, plan = plan_run(mission_set)
    assert not planned.settings.randerror
    assert plan_run(planned) == (planned, plan)
    assert planned.settings.bot_center == planned.simulation.bot_center == (plan.start.x, plan.start.y)
    assert planned.settings.block_center == planned.simulation.block_center == plan.block


def test_a_set_without_a_mission_and_a_real_robot_are_refused(mission_set: Configuration) -> None:
    with pytest.raises(ConfigurationError, match=r"mission\.toml"):
        plan_run(load(find_set("default")))
    real = replace(mission_set, settings=replace(mission_set.settings, sim=False))
    with pytest.raises(ConfigurationError, match="simulated"):
        plan_run(real)


def test_a_program_is_told_the_drop_zone_and_a_start_that_is_given(exact_set: Configuration) -> None:
    known = environment(Game(exact_set).plan, "p1")
    assert known == {
        "SIMMER_DROP_ZONE": "18,42",
        "SIMMER_LOADING_ZONE": "6,42;18,42;6,30;18,30",
        "SIMMER_TIME_LIMIT": "300",
        "SIMMER_GRIPPER": "p1",
        "SIMMER_START": "18.0,30.0,180.0",
    }
    assert "SIMMER_START" not in environment(Game(exact_set, heading=Heading.QUARTER).plan, "p1")


# -- refereeing ----------------------------------------------------------------------------------


def test_taking_and_delivering_the_block_succeeds_and_says_when(exact_set: Configuration) -> None:
    game = Game(exact_set, start=(18.0, 18.0 + 24), heading=270.0, block=(18.0, 32.0), drop_zone=(30.0, 18.0))
    assert game.send().goals == dict.fromkeys(Goal)
    game = Game(exact_set)
    state = game.send(*WAY)
    assert state.result is Result.SUCCESS
    assert state.over
    # 6 in at 6 in/s; the jaws take 0.5 s; 6 in and 12 in more.
    assert state.goals == {Goal.REACHED: 0.0, Goal.TAKEN: pytest.approx(1), Goal.DELIVERED: 4.5}
    assert (state.time, state.distance, state.commands, state.contacts) == (4.5, pytest.approx(24), 5, 0)
    assert not state.helped
    assert game.subjects == [Goal.REACHED, Goal.TAKEN, Goal.DELIVERED, Result.SUCCESS]
    after = game.send("d1-100", "d1-1000")
    assert after == state, "what happens after the end is not judged"
    shown = mission_state(game.plan, game.reducer.at())
    assert (shown.time, shown.distance, shown.commands, shown.contacts) == (
        state.time, state.distance, state.commands, state.contacts,
    ), "screens and replays show the sums of the end too"  # fmt: skip


def test_the_sums_of_a_failed_mission_stand_still_and_come_back_from_a_checkpoint(
    exact_set: Configuration,
) -> None:
    game = Game(exact_set, contacts=0)
    failed = game.send("s1-100")
    game.send("s1--3", "s1-100", "u1")
    now = game.reducer.at()
    assert (now.commands, now.contacts) == (4, 2)
    assert now.mission is not None
    sums = failed.time, failed.distance, failed.commands, failed.contacts, failed.spent
    assert now.mission.end == MissionSums(*sums)
    record = decode_line(encode_line(line_form(CheckpointRecord).record(now)), 1)
    assert isinstance(record, CheckpointRecord)
    assert LogDecoder(game.simulator.spec, now.pose).resume(record).mission == now.mission


def test_what_is_achieved_is_told_after_the_movement_that_did_it(exact_set: Configuration) -> None:
    game = Game(exact_set)
    game.send("d1-6", "p1-1")
    kinds = [type(event).__name__ for event in game.events]
    move = ["MovementPlanned", "MissionEvent", "MovementEnded", "CommandResult"]
    grip = ["MovementPlanned", "MissionEvent", "MovementEnded", "CommandResult"]
    assert kinds == [*move, *grip]


def test_a_block_let_go_elsewhere_is_not_delivered_and_may_be_taken_again(exact_set: Configuration) -> None:
    game = Game(exact_set)
    state = game.send("d1-6", "p1-1", "a1-6", "p1-0")
    assert state.result is Result.UNDER_WAY
    assert not state.holding
    assert game.send("p1-1", "s1-12", "p1-0").result is Result.SUCCESS


def test_opening_empty_jaws_over_a_block_in_the_zone_delivers_nothing(exact_set: Configuration) -> None:
    game = Game(exact_set, drop_zone=(8.0, 30.0))
    assert game.send("d1-6", "p1-0").result is Result.UNDER_WAY
    assert game.send("p1-1", "p1-0").result is Result.SUCCESS


def test_a_contact_with_a_solid_block_is_not_said_to_be_one_with_a_wall(exact_set: Configuration) -> None:
    solid = replace(exact_set, simulation=replace(exact_set.simulation, block_solid=True))
    game = Game(solid, contacts=1)
    assert game.send("d1-100").result is Result.UNDER_WAY
    assert game.send("d1-100").reason == "2 contacts with the block, 1 allowed"
    game.engine.perform(Action(ActionName.RESET, ()))
    assert game.send("w1-100", "d1--1", "d1-100", "d1--100").reason.startswith("2 contacts with a wall")


def test_one_contact_too_many_fails_and_says_where(exact_set: Configuration) -> None:
    game = Game(exact_set, contacts=1)
    assert game.send("s1-100").result is Result.UNDER_WAY
    state = game.send("w1-3", "d1-100")
    assert (state.result, state.contacts) == (Result.FAILED, 2)
    assert state.reason == "2 contacts with a wall, 1 allowed"
    assert state.contact_points == (
        (pytest.approx(18), pytest.approx(48)),
        (pytest.approx(0, abs=1e-6), pytest.approx(42)),
    )
    assert state.goals[Goal.REACHED] is not None, "on its way the robot came through the loading zone"
    assert game.subjects[-1] == Result.FAILED


def test_any_number_of_contacts_may_be_allowed(exact_set: Configuration) -> None:
    game = Game(exact_set, contacts=None)
    for _ in range(5):
        assert game.send("d1-100", "a1-100").result is Result.UNDER_WAY


def test_the_time_limit_ends_it_even_in_the_middle_of_a_movement(exact_set: Configuration) -> None:
    game = Game(exact_set, time_limit=4.6)
    assert game.send(*WAY).result is Result.SUCCESS, "opened in time, though the jaws move on"
    late = Game(exact_set, time_limit=4.4)
    state = late.send(*WAY)
    assert (state.result, state.time, state.time_left) == (Result.FAILED, 4.4, 0.0)
    assert state.goals[Goal.DELIVERED] is None


def test_a_reset_restarts_the_mission_and_help_is_noted(exact_set: Configuration) -> None:
    game = Game(exact_set, time_limit=2.0)
    assert game.send("d1-6", "d1--6", "d1-6").result is Result.FAILED
    game.engine.perform(Action(ActionName.RESET))
    state = game.send("d1-6")
    assert (state.result, state.helped) == (Result.UNDER_WAY, False)
    game.engine.perform(Action(ActionName.TELEPORT, (18.0, 42.0, 0.0)))
    assert game.send().helped
    game.engine.perform(Action(ActionName.RESET))
    assert not game.send().helped
    game.engine.perform(Action(ActionName.NOISE, (0.0,)))
    assert game.send().helped


def test_giving_up_fails_once(exact_set: Configuration) -> None:
    game = Game(exact_set)
    game.referee.end("nobody drives")
    game.referee.end("again")
    assert game.referee.state().reason == "nobody drives"
    assert game.subjects == [Result.FAILED]


def test_a_timed_mission_judges_movements_when_they_are_over(exact_set: Configuration) -> None:
    """Movements are answered at once, so contacts and the end of time come without an answer."""
    game = Game(exact_set, contacts=None, time_limit=60.0)
    simulator, reducer, referee = game.simulator, game.reducer, game.referee

    def tell(event: Event) -> None:
        reducer.apply(event)
        referee.watch(event)

    tell(simulator.begin("s1-100"))
    way = simulator.trajectory
    assert way is not None
    command = parse_command("s1-100")
    tell(MovementPlanned(1, 0.0, command, way))
    referee.check(1.0)
    assert referee.state().contacts == 0
    simulator.advance(30)
    tell(MovementEnded(1, way.end_time, command, way, way.pose_at(way.end_time)))
    state = referee.state()
    assert (state.contacts, len(state.contact_points)) == (1, 1)
    referee.check(60.1)
    assert (referee.result, referee.state().time) == (Result.FAILED, 60.0)


def test_an_accepted_contact_that_never_came_is_not_counted(exact_set: Configuration) -> None:
    async def run() -> tuple[MissionState, int]:
        loop = asyncio.get_running_loop()
        game = Game(exact_set, contacts=None)
        game.engine.timed = True  # in real time: the stop comes long before the wall
        game.engine.start(loop)
        session = game.engine.session(answer_at_end=False)
        session.submit(parse_command("s1-100"), lambda outcome: None)
        game.engine.perform(Action(ActionName.STOP))
        game.engine.timed = False
        return game.send("w1-1", "d1-100"), game.simulator.contacts

    state, contacts = asyncio.run(run())
    assert state.contacts == contacts == 1
    assert state.contact_points[0][0] == pytest.approx(0, abs=1e-6), "the second drive's, at the left"


def test_a_timed_delivery_through_the_engine_succeeds(exact_set: Configuration) -> None:
    async def run() -> MissionState:
        game = Game(exact_set)
        game.engine.timed, game.engine.time_scale = True, 1000.0
        game.engine.start(asyncio.get_running_loop())
        done = asyncio.get_running_loop().create_future()
        for text in WAY:
            last = text == WAY[-1]
            game.session.submit(
                parse_command(text),
                (lambda outcome: done.set_result(None)) if last else (lambda outcome: None),
            )
        await done
        return game.referee.state()

    assert asyncio.run(run()).result is Result.SUCCESS


# -- the program ---------------------------------------------------------------------------------

DRIVER = """
import os, sys
from simmer_tui.client import Robot
print("zone", os.environ["SIMMER_DROP_ZONE"], flush=True)
with Robot() as robot:
    for text in sys.argv[1:]:
        robot.send(text)
"""


@pytest.fixture
def mission_folder(tmp_path: Path) -> Path:
    """The bundled set with the mission that five commands do, and drives without errors."""
    from simmer_tui.config.sets import init_set

    folder = tmp_path / "set"
    init_set(folder, bundled_sets()["mission"])
    rows = (folder / "drive.csv").read_text().splitlines()
    exact = [rows[0], *(",".join([*row.split(",")[:3], "0,0,0,0,0,0,,"]) for row in rows[1:-1]), rows[-1]]
    (folder / "drive.csv").write_text("\n".join(exact) + "\n")
    mission = 'start = [18, 30]\nheading = 180\nblock = [8, 30]\ndrop_zone = [18, 42]\ncontacts = "any"\n'
    (folder / "mission.toml").write_text(mission)
    return folder


Headless = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def headless(mission_folder: Path) -> Headless:
    driver = mission_folder.parent / "driver.py"
    driver.write_text(DRIVER)

    def run(*words: str, options: tuple[str, ...] = ()) -> subprocess.CompletedProcess[str]:
        program = " ".join([sys.executable, str(driver), *words])
        set_and_ports = ("--config", mission_folder, "--port", "0", "--no-randbias")
        variables = {"PYTHONPATH": str(ROOT)}
        return simmer("--mission", "--no-ui", *set_and_ports, "--run", program, *options, env=variables)

    return run


@pytest.mark.parametrize("contacts", [0, 3])
def test_a_mission_ends_with_the_last_goal_that_it_asks_for(
    exact_set: Configuration, monkeypatch: pytest.MonkeyPatch, contacts: int
) -> None:
    """Every goal that there is is asked for by all missions: here one where contacts are allowed."""
    monkeypatch.setattr(Goal.DELIVERED, "asked_by", "contacts")
    state = Game(exact_set, contacts=contacts).send(*WAY[:2])
    met = {Goal.REACHED: 0.0, Goal.TAKEN: pytest.approx(1)}
    if contacts:
        assert (state.result, state.goals) == (Result.UNDER_WAY, {**met, Goal.DELIVERED: None})
    else:
        assert (state.result, state.time, state.goals) == (Result.SUCCESS, pytest.approx(1), met)


def test_a_program_that_delivers_ends_the_run_with_exit_code_0(headless: Headless) -> None:
    ran = headless(*WAY)
    assert ran.returncode == 0, ran.stderr
    assert "zone 18,42" in ran.stdout
    lines = [line for line in ran.stderr.splitlines() if line.startswith("mission:")]
    assert [line.split(" at ")[0] for line in lines[1:4]] == [f"mission: {goal.value}" for goal in Goal]
    assert lines[4].startswith("mission: success after 4.6 s, 24.0 in, 5 commands, no contact")


@pytest.mark.slow
def test_a_program_of_another_terminal_may_ask_what_it_has_done(mission_folder: Path) -> None:
    """The mission has ended with its last command."""
    ports = ("--port", "0", "--reply-port", "0", "--belief-port", "0")
    words = ("--no-ui", "--mission", "--once", "--config", mission_folder, "--no-randbias", *ports)
    command = [sys.executable, "-m", "simmer_tui", *map(str, words)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(command, text=True, cwd=mission_folder, **pipes) as process:
        assert process.stdout is not None
        ready = next(line for line in process.stdout if line.startswith("seed "))
        port, reply_port = (int(number) for number in re.findall(r"on port (\d+)", ready)[:2])
        with Robot("127.0.0.1", port, reply_port) as robot:
            for text in WAY:
                robot.send(text)
            assert robot.read("u1") > 0
        told = process.stdout.read()
        assert process.wait(60) == 0
    assert "verdict: Succeeded" in told


def test_a_program_that_gives_up_ends_the_run_with_exit_code_1(headless: Headless) -> None:
    ran = headless(*WAY[:2])
    assert ran.returncode == 1
    assert "mission: failed" in ran.stderr
    assert "the program ended with exit code 0" in ran.stderr


@pytest.mark.slow
def test_the_log_of_a_mission_tells_it_and_runs_again(headless: Headless, tmp_path: Path) -> None:
    from simmer_tui.runlog.reader import Logged, LogReader

    log = tmp_path / "run.jsonl"
    assert headless(*WAY, options=("--log", str(log), "--quiet")).returncode == 0
    reader = LogReader(log)
    events = [logged.event for logged in reader if isinstance(logged, Logged)]
    told = [event.subject for event in events if isinstance(event, MissionEvent)]
    reader.close()
    assert told == [Result.UNDER_WAY, *Goal, Result.SUCCESS]
    again = simmer("rerun", log)
    assert again.returncode == 0, again.stdout + again.stderr
