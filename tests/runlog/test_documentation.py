"""docs/run-log.md lists exactly what is written."""

from __future__ import annotations

import dataclasses
import json
import re
from collections import defaultdict
from pathlib import Path
from typing import Any

from msgspec import structs
from msgspec.structs import replace

from simmer_tui.engine import Engine
from simmer_tui.events import (
    ActionName,
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
)
from simmer_tui.runlog.header import TakenOver
from simmer_tui.runlog.writer import CHECKPOINT_EVERY, ReplayedPrefix, RunLog
from simmer_tui.sim import GripperSpec, Simulator, Status, parse_command

DOCUMENT = Path(__file__).parents[2] / "docs" / "run-log.md"


def sections() -> dict[str, str]:
    parts = re.split(r"^## (\w+)$", DOCUMENT.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def other_log(path: Path, configuration: Any, motion: str) -> None:
    """What the varied log has not: a gripper, plans, ends, stops, a twin, a mission, half a contact."""
    gripper = GripperSpec(code="p1")
    simulation = replace(configuration.simulation, gripper=gripper, bot_center=(4.1, 24.0), contact="drive")
    settings = replace(configuration.settings.motion, motion=motion)
    changed = replace(
        configuration, simulation=simulation, settings=replace(configuration.settings, motion=settings)
    )
    simulator = Simulator(simulation, 7)
    prefix = ReplayedPrefix(TakenOver("other.jsonl", 1, 0.0), begun=1e9)
    prefix.end()
    with RunLog(path, changed, simulator, mission=True, prefix=prefix) as log:
        engine = Engine(simulator)
        engine.watch(log)
        session = engine.session()
        for text in ("p1-1", "d1-8", "r1-60", "d1-60"):
            session.submit(parse_command(text, "x"), lambda outcome: None)
        engine.mirror(parse_command("d1-1"))
        if motion == "instant":
            return
        begun = simulator.begin(parse_command("d1--20", "x"))
        assert simulator.trajectory is not None
        log(MovementPlanned(begun.number, begun.time, begun.command, simulator.trajectory))
        log(MovementPlanned(begun.number, begun.time, begun.command, simulator.trajectory))
        simulator.advance(simulator.time + 0.1)
        simulator.stop()
        ended = simulator.finish(begun)
        assert simulator.last_trajectory is not None
        log(MovementEnded(ended.number, ended.time, ended.command, simulator.last_trajectory, "xx from x"))
        stop = dataclasses.replace(parse_command("xx", "packets"), stops=True)
        log(structs.replace(simulator.begin(stop), taken=-1.0, link=0.1))
        reading = simulator.begin("u1")
        log(
            structs.replace(
                reading, taken=-1.0, link=0.1, command=dataclasses.replace(reading.command, source="x")
            )
        )
        log(TwinReading(simulator.time, parse_command("u1", "console"), "u1", 3.0, float("nan")))
        said = (OutputLine(1.0, "x"),)
        log(ProgramEnded(2.0, 139, "SIGSEGV", True, "segmentation fault", "robot.c:3", said, said))
        log(MissionEvent(simulator.time, Goal.TAKEN, "block taken"))
        log(MissionEvent(simulator.time, Result.FAILED, "failed", "no time"))
        for _ in range(CHECKPOINT_EVERY):
            log(Notice(NoticeKind.FAULT, "x"))


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
    documented = {
        kind: {
            name
            for row in re.findall(r"^\| (`.*?) \|", text, flags=re.MULTILINE)
            for name in re.findall(r"`(\w+)`", row)
        }
        for kind, text in sections().items()
    }
    assert set(documented) == set(written)
    for kind, names in documented.items():
        assert written[kind] <= names | {"t", "kind", "real"}
        # Of a contact that did not end its movement; of sensors that take their time.
        rare = {"stop", "drift", "reading"}
        assert names - rare <= written[kind], kind


def test_the_documented_words_are_those_used() -> None:
    parts = sections()
    for kind, field, words in (
        ("answer", "status", Status),
        ("action", "action", ActionName),
        ("notice", "about", NoticeKind),
        ("mission", "goal", Goal),
        ("mission", "result", Result),
    ):
        row = re.search(rf"^\| `{field}` \| (.*) \|$", parts[kind], flags=re.MULTILINE)
        assert row is not None
        assert set(re.findall(r"`([\w ]+)`", row[1])) == {word.value for word in words}
