"""Contents read from logs of simulated robots with velocities, teleports, a moved block and a gripper.

Suspicions of stretches, and the movements that are held back, are those that were kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from simmer_tui.calibrate.find_path import PathFinder
from simmer_tui.calibrate.measured_run import Chain, MeasuredRun, read_runs
from simmer_tui.calibrate.prediction import held_back
from simmer_tui.calibrate.suspicions import suspicions, suspicions_without_path
from simmer_tui.config.loader import find_set, load
from simmer_tui.errors import CalibrationError
from simmer_tui.robot.actions import Action, ActionName
from simmer_tui.robot.engine import Engine
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Simulator, parse_command
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import Axes
from tests.calibrate.synthetic import make
from tests.calibrate.test_kept_fit import known_fit
from tests.kept_numbers import assert_kept

KEPT = Path(__file__).with_name("kept_logs.json")
DOWN, RIGHT, ROT = 1, 3, 4


def log(path: Path, steps: list[str | Action], of: str = "default") -> MeasuredRun:
    """The contents read from the log of a simulated robot of a set that gets these commands and actions."""
    configuration = load(find_set(of))
    simulator = Simulator(configuration.simulation, 7)
    engine = Engine(simulator)
    with RunLog(path, configuration, simulator, clock=lambda: 1.8e9 + simulator.time) as written:
        engine.watch(written)
        session = engine.session()
        for step in steps:
            if isinstance(step, Action):
                engine.perform(step)
            else:
                session.submit(parse_command(step), lambda outcome: None)
    return read_runs([path])


def numbers(run: MeasuredRun) -> dict[str, object]:
    return {
        "movements": [
            (m.drive, m.value, m.certain, m.line, m.took, m.parts, m.commanded, m.bend) for m in run.movements
        ],
        "readings": {
            code: (each.stops, each.values, each.times, each.gaps) for code, each in run.readings.items()
        },
        "chains": [
            (structs.astuple(each.start), each.line, each.spread, len(each.movements)) for each in run.chains
        ],
        "rest": (run.block_moved_at, run.simulated, len(run.notes), run.stops),
        "numbered": (run.first_stops(), run.stops_before_movements(), run.chains_of(np.arange(run.stops))),
    }


def test_what_is_read_of_commands_and_actions_is_that_which_was_kept(tmp_path: Path) -> None:
    looks = ["u1", "u2", "c1", "g1", "o1", "i1"]
    steps: list[str | Action] = [*looks, "d1-2", *looks, "d1-30", *looks, "r1-40", "r1-0", *looks]
    steps += [Action(ActionName.TELEPORT, (18.0, 42.0, 10.0)), *looks, "w1-1.5", "u1", "u1", "g1"]
    steps += ["xx", "u1", "d1-1", Action(ActionName.BLOCK, (66.0, 42.0)), *looks, "s1-1"]
    steps += [
        Action(ActionName.BLOCK, (64.0, 42.0)),
        *looks,
        Action(ActionName.RESET),
        *looks,
        "a1-1",
        *looks,
    ]
    run = log(tmp_path / "run.jsonl", steps)
    assert_kept(numbers(run), KEPT, "commands")
    parts = {str(last): numbers(run.before_stop(last)) for last in (3, 5)}
    assert_kept(parts, KEPT, "before")


def test_what_is_read_of_velocities_is_that_which_was_kept(tmp_path: Path) -> None:
    looks = ["u1", "g1", "o1", "c1", "u2"]
    steps: list[str | Action] = ["u1", "d1-2", "vv-5;0;10", "wt-0.1", *looks]
    for turn in (10, -40, 0, 60):
        steps += [f"vv-4;0;{turn}", "wt-0.4", *looks, "wt-0.08", *looks, "wt-0.5", *looks]
    steps += ["vv-0;0;0", *looks, "vv-4;1;0", "wt-1", "d1-1", *looks, "vv-3;0;0", "wt-0.3", "vv-0;0;0"]
    steps += [Action(ActionName.RESET), "u1", "vv-0;0;30", "wt-1", *looks, "vv-0;0;-30", "wt-0.02", *looks]
    assert_kept(numbers(log(tmp_path / "run.jsonl", steps)), KEPT, "velocities")


def test_a_block_that_is_gripped_is_nowhere(tmp_path: Path) -> None:
    steps: list[str | Action] = ["u1", "d1-1", "u1", "p1-1", "d1-1", "u1", "p1-0", "u1"]
    run = log(tmp_path / "run.jsonl", steps, "mission")
    assert (run.block_moved_at, len(run.movements)) == (1, 2)
    assert run.readings["u1"].stops.tolist() == [0, 1, 2, 2]
    assert run.readings["u1"].gaps == pytest.approx([np.nan, 0.06, 0.06, np.nan], abs=1e-6, nan_ok=True)


def test_a_robot_that_never_moved_is_refused(tmp_path: Path) -> None:
    """Paths are cut at 400 characters."""
    folder = tmp_path / ("m" * 200)
    folder.mkdir()
    path = folder / f"{'n' * 200}.jsonl"
    with pytest.raises(CalibrationError) as refusal:
        log(path, ["u1", "u1"])
    assert str(refusal.value) == f"{path}: the robot never moved, so nothing can be estimated"


# -- a rough path ----------------------------------------------------------------------------------------


def test_a_path_that_begins_in_a_wall_is_that_which_was_kept() -> None:
    """Of a robot with exact drives, whose wheels and gyro were read; one movement met a wall."""
    made = make(6)
    drives = tuple(
        structs.replace(each, error=Axes(0.0, 0.0, 0.0), bias=Axes(0.0, 0.0, 0.0))
        for each in made.run.spec.drives
    )
    spec = structs.replace(made.run.spec, drives=drives)
    run = replace(made.run, configuration=structs.replace(made.run.configuration, simulation=spec))
    (chain,) = run.chains
    movements = [
        replace(each, value=4.0 * each.value) if k == 2 else each for k, each in enumerate(chain.movements)
    ]
    chain = replace(chain, movements=movements, start=Pose(66.0, 30.0, 20.0), spread=(0.2, 0.2, 1.0))
    told: list[int] = []
    path = PathFinder(replace(run, chains=(chain,))).find(
        chain, 0, 25, np.random.default_rng(2), wide=1.0, progress=told.append
    )
    assert told == list(range(7))
    assert_kept({"poses": path.poses, "contacts": path.contacts, "fit": path.fit}, KEPT, "path")


# -- suspicions and predictions ------------------------------------------------------------------------


def test_stretches_are_held_against_no_drive() -> None:
    """Those to the right are not movements of the drive whose number is 1, nor of any other."""
    made = make(40)
    (chain,) = made.run.chains
    movements = [
        replace(each, parts=((RIGHT, each.value),), commanded=(each.value, 0.0, 0.0))
        if each.drive == RIGHT
        else replace(each, value=0.0 if each.drive == DOWN else each.value)
        for each in chain.movements
    ]
    run = replace(made.run, chains=(replace(chain, movements=movements),))
    assert suspicions(known_fit(made, run)) == ()


def test_swapped_sensors_are_compared_without_their_drifts() -> None:
    """Of two sensors that would drift by 100 in a second, read at the beginning alone."""
    made = make(20)
    sensors = tuple(
        structs.replace(each, drift=100.0) if each.code in ("u1", "u2") else each
        for each in made.run.spec.sensors
    )
    spec = structs.replace(made.run.spec, sensors=sensors)
    still = {
        code: replace(made.run.readings[code], times=np.zeros(21)) for code in ("u1", "u2", "u3", "o1", "g1")
    }
    for code in ("u1", "u2"):
        drifted = 0.002 * made.run.readings[code].times
        still[code] = replace(still[code], values=still[code].values - drifted)
    readings = {**still, "u1": still["u2"], "u2": still["u1"]}
    configuration = structs.replace(made.run.configuration, simulation=spec)
    run = replace(made.run, configuration=configuration, readings=readings)
    told = {(each.of, each.kind.value, each.other, each.value) for each in suspicions(known_fit(made, run))}
    assert told == {("u1", "swapped", "u2", 1.0), ("u2", "swapped", "u1", 1.0)}


def test_suspicions_of_two_chains_are_those_that_were_kept() -> None:
    """Of a compass and a gyro that drifts, which are turned, and two wheels that are swapped."""
    made = make(51)
    (chain,) = made.run.chains
    start = Pose(*made.truth.chain[11, :3].tolist())
    sensors = tuple(
        structs.replace(each, drift=5.0) if each.code == "g1" else each for each in made.run.spec.sensors
    )
    spec = structs.replace(made.run.spec, sensors=sensors)
    readings = dict(made.run.readings)
    gyro = readings["g1"]
    readings["g1"] = replace(gyro, values=4.998 * gyro.times - (gyro.values - 0.002 * gyro.times))
    for code in ("g1", "o1", "o3"):  # the second chain begins with other counts
        each = readings[code]
        readings[code] = replace(each, values=each.values + 500.0 * (each.stops > 10))
    readings |= {"o1": readings["o3"], "o3": readings["o1"]}
    readings["c1"] = replace(readings["c1"], values=-readings["c1"].values)
    run = replace(
        made.run,
        chains=(replace(chain, movements=chain.movements[:10]), Chain(start, 20, chain.movements[11:])),
        configuration=structs.replace(made.run.configuration, simulation=spec),
        readings=readings,
    )
    truth = made.truth.chain.copy()
    truth[10, 3:] = 0.0
    contacts = np.zeros(50, bool)
    state = replace(made.truth, chain=truth, contacts=contacts, slipped=contacts)
    found = {
        name: [
            (each.of, each.kind.value, each.value, each.low, each.high, each.unit, each.count, each.other)
            for each in found
        ]
        for name, found in (
            ("path", suspicions(known_fit(replace(made, truth=state), run))),
            ("commands", suspicions_without_path(run)),
        )
    }
    assert_kept(found, KEPT, "suspicions")


@pytest.mark.parametrize(("made_by", "count", "suspected"), [(0.51, 4, 1), (0.49, 4, 0), (0.51, 3, 0)])
def test_four_movements_of_half_their_distance_tell_of_a_drive(
    made_by: float, count: int, suspected: int
) -> None:
    """They went the other way."""
    made = make(5 * count)
    (chain,) = made.run.chains
    movements = list(chain.movements)
    for number, each in enumerate(movements):
        if each.drive == RIGHT:
            gone = float(np.hypot(*made.truth.chain[number, 3:5]))
            movements[number] = replace(each, value=-float(np.sign(each.value)) * gone / made_by)
    run = replace(made.run, chains=(replace(chain, movements=movements),))
    found = [each for each in suspicions(known_fit(made, run)) if each.of == "d1"]
    assert len(found) == suspected


def test_nineteen_movements_are_too_few_to_hold_readings_back() -> None:
    assert held_back(known_fit(make(19))) is None


def test_predictions_of_the_end_of_the_last_long_chain_are_those_that_were_kept() -> None:
    """Of a chain of 21 movements, five of which are held back, and one of 3."""
    made = make(25)
    (chain,) = made.run.chains
    start = Pose(*made.truth.chain[22, :3].tolist())
    chains = (replace(chain, movements=chain.movements[:21]), Chain(start, 30, chain.movements[22:]))
    truth = made.truth.chain.copy()
    truth[21, 3:] = 0.0
    readings = {code: made.run.readings[code] for code in ("u1", "u3", "c1", "o1", "g1")}
    run = replace(made.run, chains=chains, readings=readings)
    contacts = np.zeros(24, bool)
    state = replace(made.truth, chain=truth, contacts=contacts, slipped=contacts)
    held = held_back(known_fit(replace(made, truth=state), run))
    assert held is not None
    assert (held.movements, held.learned.run.stops) == (5, 17)
    found = {
        "errors": [(each.kind.name, each.ahead, each.before, each.after, each.count) for each in held.errors],
        "scores": {kind.name: each for kind, each in held.scores.items()},
    }
    assert_kept(found, KEPT, "held_back")
