"""`blocksize = 0`: a set without any block."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.cli.log_reports import build_report
from simmer_tui.config import load_default
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.set_summary import summarize
from simmer_tui.config.sets import bundled_folder, find_set
from simmer_tui.config.settings_file import Override
from simmer_tui.document import svg
from simmer_tui.errors import ConfigurationError, PlacementError
from simmer_tui.live.snapshot import Recorder
from simmer_tui.report.content import svg_picture
from simmer_tui.robot.engine import Engine
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import checkpoint_of
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import GripperSpec, LoadSensor, Maze, Pose, SensorSpec, Simulator, parse_command
from simmer_tui.tui.maze.scene import scene_of


@pytest.fixture
def configuration() -> Configuration:
    overrides = {
        "blocksize": Override("--blocksize", 0.0),
        "block_center": Override("--block-center", (37.0, 42.0)),
        "motion.block_solid": Override("--block-solid", True),
        "randbias": Override("--no-randbias", False),
    }
    return load(bundled_folder(), overrides)


def test_no_sensor_sees_it(configuration: Configuration) -> None:
    simulator = Simulator(replace(configuration.simulation, bot_center=(30.0, 42.0)))
    assert simulator.true_value("u5") == pytest.approx(15.0), "the wall at 48"
    assert simulator.true_ranges(np.array([(30.0, 42.0, 0.0)]), ["u5"])[0, 0] == simulator.true_value("u5")
    assert simulator.cast_rays(np.array([(30.0, 42.0)]), np.zeros(1), 0.0)[0] == 18.0


def test_it_stops_no_movement_though_it_be_solid(configuration: Configuration) -> None:
    simulator = Simulator(replace(configuration.simulation, bot_center=(30.0, 42.0)))
    simulator.noise = False
    assert simulator.execute("d1-12").contact is None
    assert simulator.pose.x == pytest.approx(42.0)


def test_the_gripper_takes_nothing(configuration: Configuration) -> None:
    spec = replace(
        configuration.simulation,
        bot_center=(32.0, 42.0),
        gripper=GripperSpec(code="gr"),
        sensors=(SensorSpec(kind=LoadSensor, number=1, code="l1"),),
    )
    simulator = Simulator(spec)
    outcome = simulator.execute("gr-1")
    assert outcome.grip is not None
    assert not outcome.grip.holding
    assert simulator.execute("l1").reply == 0.0
    assert simulator.execute("gr-0").grip is not None


def test_it_can_be_put_nowhere_and_is_nowhere_in_the_way(configuration: Configuration) -> None:
    simulator = Simulator(replace(configuration.simulation, block_center=(-100.0, 3.0)))
    with pytest.raises(PlacementError, match=r"there is no block \(blocksize = 0\)"):
        simulator.move_block(30.0, 42.0)
    simulator.teleport(Pose(37.0, 42.0, 0.0))


def test_summary_and_pictures_show_none(configuration: Configuration, tmp_path: Path) -> None:
    text = summarize(configuration)
    assert "Block: none" in text
    assert "\u25a0" in summarize(load_default())
    assert "\u25a0" not in text.split("wall,")[0]
    simulator = Simulator(configuration.simulation)
    engine = Engine(simulator)
    recorder = Recorder(engine, Reducer(checkpoint_of(simulator)))
    assert scene_of(simulator.spec, Maze(simulator.spec.maze), recorder.snapshot()).block_centre is None
    with RunLog(tmp_path / "run.jsonl", configuration, simulator) as log:
        engine.watch(log)
        engine.session().submit(parse_command("d1-3"), lambda _: None)
    assert svg.BLOCK_FILL not in svg_picture(build_report(tmp_path / "run.jsonl"), "run")


def test_a_mission_needs_one() -> None:
    with pytest.raises(ConfigurationError) as raised:
        load(find_set("mission"), {"blocksize": Override("--blocksize", 0.0)})
    assert "a mission needs a block: blocksize must be above 0" in str(raised.value)
