"""docs/run-log.md and docs/run-log-others.md list exactly what is written."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs
from msgspec.structs import replace

from simmer_tui.robot.engine import Engine
from simmer_tui.run.belief_grid import grid_belief
from simmer_tui.run.events import (
    ActionName,
    Belief,
    DisplayChanged,
    Goal,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
    OutputLine,
    ProgramEnded,
    Result,
    TwinReading,
    VelocityEnd,
    WireMessage,
)
from simmer_tui.runlog.header import Header, TakenOver
from simmer_tui.runlog.log_records import RECORDS
from simmer_tui.runlog.run_command import RunCommand
from simmer_tui.runlog.writer import CHECKPOINT_EVERY, ReplayedPrefix, RunLog
from simmer_tui.sim import GripperSpec, Pose, Simulator, Status, WheelLayout, WheelsSpec, parse_command
from simmer_tui.sim.records import Grip
from simmer_tui.sim.sensors.lidar import Lidar, LidarSpec

DOCUMENTS = [Path(__file__).parents[2] / "docs" / name for name in ("run-log.md", "run-log-others.md")]


def sections() -> dict[str, str]:
    text = "\n".join(document.read_text("utf-8") for document in DOCUMENTS)
    parts = re.split(r"^## (\w+)$", text, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def documented_fields() -> dict[str, set[str]]:
    """The fields that the pages list, by kind of line."""
    return {
        kind: {
            name
            for row in re.findall(r"^\| (`.*?) \|", text, flags=re.MULTILINE)
            for name in re.findall(r"`(\w+)`", row)
        }
        for kind, text in sections().items()
    }


def other_log(path: Path, configuration: Any, motion: str) -> None:
    """A log of what the varied one lacks: gripper, plans, ends, stops, a twin, a mission, half a contact."""
    gripper = GripperSpec(code="p1")
    wheels = WheelsSpec(layout=WheelLayout.OMNI_4)
    lidar = LidarSpec(kind=Lidar, number=1, code="sc", resolution=0.0)
    sensors = (*configuration.simulation.sensors, lidar)
    simulation = replace(
        configuration.simulation,
        gripper=gripper,
        bot_center=(4.1, 24.0),
        contact="drive",
        wheels=wheels,
        sensors=sensors,
    )
    settings = replace(configuration.settings.motion, motion=motion)
    changed = replace(
        configuration, simulation=simulation, settings=replace(configuration.settings, motion=settings)
    )
    simulator = Simulator(simulation, 7)
    prefix = ReplayedPrefix(TakenOver("other.jsonl", 1, 0.0), begun=1e9)
    prefix.end()
    with RunLog(path, changed, simulator, mission=True, prefix=prefix, run=RunCommand("/")) as log:
        engine = Engine(simulator)
        engine.watch(log)
        session = engine.session()
        for text in ("p1-1", "d1-8", "r1-60", "d1-60", "sc"):
            session.submit(parse_command(text, "x"), lambda outcome: None)
        engine.mirror(parse_command("d1-1"))
        drive_continuously(engine)
        if motion == "instant":
            return
        begun = simulator.begin(parse_command("d1--20", "x"))
        assert simulator.trajectory is not None
        for time in (begun.time, begun.time + 0.05):
            log(MovementPlanned(begun.number, time, begun.command, simulator.trajectory))
        simulator.advance(simulator.time + 0.1)
        simulator.stop()
        ended = simulator.finish(begun)
        assert simulator.last_trajectory is not None
        number, time, command, went = ended.number, ended.time, ended.command, simulator.last_trajectory
        log(MovementEnded(number, time, command, went, ended.pose, "xx from x"))
        stop = structs.replace(parse_command("xx", "packets"), stops=True)
        moving = {"before": Pose(1.0, 2.0, 3.0), "pose": Pose(2.0, 2.0, 3.0), "taken": -1.0, "link": 0.1}
        grip = Grip(1.0, True, True, Pose(1.0, 2.0, 3.0))
        log(structs.replace(simulator.begin(stop), grip=grip, **moving))
        moving["pose"] = Pose(3.0, 2.0, 3.0)
        reading = simulator.begin("u1")
        log(structs.replace(reading, command=structs.replace(reading.command, source="x"), **moving))
        log(large_belief(0.0))
        log(large_belief(0.1))
        log(TwinReading(simulator.time, parse_command("u1", "console"), "u1", 3.0, float("nan")))
        said = (OutputLine(1.0, "x"),)
        log(ProgramEnded(2.0, 139, "SIGSEGV", True, "segmentation fault", "robot.c:3", said, said))
        log(WireMessage(simulator.time, "w 1", meaning="w {n}"))
        log(WireMessage(simulator.time, "ok", reply=True, board="rover", port="USB"))
        log(DisplayChanged(simulator.time, "rover", True, "2", (("a row",),), 0.5))
        log(MissionEvent(simulator.time, Goal.TAKEN, "block taken"))
        log(MissionEvent(simulator.time, Result.FAILED, "failed", "no time"))
        for _ in range(CHECKPOINT_EVERY):
            log(Notice(NoticeKind.FAULT, "x", advice=True))


def large_belief(time: float) -> Belief:
    """A belief with a grid of which the log leaves the cells out, if another one has just been told."""
    grid = grid_belief(np.ones((10, 20, 11)), (0.0, 0.0, 96.0, 48.0), 5.0, Pose(1.0, 2.0, 3.0))
    return Belief(time, grid.best_pose, Pose(1.0, 2.0, 3.0), 3.0, grid=grid)


def drive_continuously(engine: Engine) -> None:
    """Velocities that change, slip, end by their time and lead a disc along a wall, and a wait."""
    session = engine.session()
    for text in ("ww-1;2;3;4;0.1", "wt-0.4", "vv-6;0;30", "wt-8", "vx-3"):
        session.submit(parse_command(text, "x"), lambda outcome: None)
    engine.simulator.advance(engine.simulator.time + 0.05)
    session.submit(parse_command("d1-1", "x"), lambda outcome: None)


def test_the_documented_fields_are_those_written(
    varied_log: Path, tmp_path: Path, configuration: Any
) -> None:
    for motion in ("instant", "timed"):
        other_log(tmp_path / motion, configuration, motion)
    written: dict[str, set[str]] = defaultdict(set)
    for path in (varied_log, tmp_path / "instant", tmp_path / "timed"):
        for line in path.read_text().splitlines():
            fields = json.loads(line)
            written[fields["kind"]] |= fields.keys()
    documented = documented_fields()
    assert set(documented) == set(written)
    for kind, names in documented.items():
        assert written[kind] <= names | {"t", "kind", "real"}
        # Of a contact that did not end its movement; of sensors that take their time.
        rare = {"stop", "drift", "reading"}
        # Of a set with devices or boards of its own.
        rare |= {"devices", "kinds", "sketches"}
        assert names - rare <= written[kind], kind


def test_every_field_of_every_kind_of_line_is_documented() -> None:
    """Also of kinds that no log of these tests has."""
    documented = documented_fields()
    for record in (Header, *RECORDS):
        kind = str(record.__struct_config__.tag)
        names = {field.encode_name for field in structs.fields(record)}
        assert names <= documented.get(kind, set()) | {"t", "real"}, kind


def test_the_documented_words_are_those_used() -> None:
    parts = sections()
    for kind, field, words in (
        ("answer", "status", Status),
        ("action", "action", ActionName),
        ("notice", "about", NoticeKind),
        ("velocity", "reason", VelocityEnd),
        ("mission", "goal", Goal),
        ("mission", "result", Result),
    ):
        row = re.search(rf"^\| `{field}` \| (.*) \|$", parts[kind], flags=re.MULTILINE)
        assert row is not None
        assert set(re.findall(r"`([\w ]+)`", row[1])) == {word.value for word in words}
