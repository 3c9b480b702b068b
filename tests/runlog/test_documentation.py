"""docs/run-log.md lists exactly what is written."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

from simmer_tui.events import ActionName, NoticeKind, TwinReading
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import GripperSpec, Simulator, Status, parse_command

DOCUMENT = Path(__file__).parents[2] / "docs" / "run-log.md"


def sections() -> dict[str, str]:
    parts = re.split(r"^## (\w+)$", DOCUMENT.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def gripper_log(path: Path, configuration: Any) -> None:
    simulation = replace(configuration.simulation, gripper=GripperSpec(code="p1"))
    simulator = Simulator(simulation, 7)
    with RunLog(path, configuration, simulator) as log:
        log(simulator.execute("p1-1"))
        log(TwinReading(simulator.time, parse_command("u1"), "u1", 3.0, float("nan")))


def test_the_documented_fields_are_those_written(
    varied_log: Path, tmp_path: Path, configuration: Any
) -> None:
    gripper_log(tmp_path / "grip.jsonl", configuration)
    written: dict[str, set[str]] = defaultdict(set)
    for path in (varied_log, tmp_path / "grip.jsonl"):
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
    assert documented == written


def test_the_documented_words_are_those_used() -> None:
    parts = sections()
    for kind, field, words in (
        ("command", "verdict", Status),
        ("action", "action", ActionName),
        ("notice", "about", NoticeKind),
    ):
        row = re.search(rf"^\| `{field}` \| (.*) \|$", parts[kind], flags=re.MULTILINE)
        assert row is not None
        assert set(re.findall(r"`([\w ]+)`", row[1])) == {word.value for word in words}
