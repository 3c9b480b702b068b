"""Logs of strangers whose headers describe devices: nothing of them runs, and no command dies of one."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.cli.main import main
from simmer_tui.config.loader import load
from simmer_tui.robot.engine import Engine
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Simulator, parse_command
from tests.devices.conftest import DEVICE, MakeSet, trust
from tests.devices.test_commands import PROGRAM, logged

Header = dict[str, Any]
FIELDS = ("kind", "number", "code", "enabled", "id", "__post_init__", "__class__", "is_yes_or_no", "a b")
HEADERS: list[Header] = [
    *({"kinds": [{key: "\x1b[2J\u202egnp"}]} for key in ("meaning", "unit", "short_name", "title", "name")),
    *({"kinds": [{key: "x" * 100_000}]} for key in ("meaning", "unit", "title", "name")),
    *({"kinds": [{"columns": [{"field": name}]}]} for name in FIELDS),
    *({"kinds": [{"columns": [{key: "\x1b[2J"}]}]} for key in ("header", "unit", "label")),
    {"kinds": [{"columns": [{"words": ["\x1b[2J", ""]}]}]},
    {"kinds": [{"name": "ultra"}]},
    {"kinds": [{"meaning": "\ud800"}]},
    {"kinds": None},
    {"devices": [{"path": "../../\x1b[2J.py", "sha256": "\x1b[2J" * 999}]},
    {"devices": [{"path": DEVICE, "sha256": "\x1b[2J" * 999}]},
    {"devices": []},
    {"devices": None},
]


def changed(value: Any, change: Any) -> Any:
    """A part of a header with changes in it; of lists the last entry is changed."""
    if isinstance(value, dict) and isinstance(change, dict):
        return value | {key: changed(value.get(key), each) for key, each in change.items()}
    if isinstance(value, list) and isinstance(change, list) and change and isinstance(change[0], dict):
        return [*value[:-1], changed(value[-1], change[0])]
    return change


@pytest.mark.slow
def test_headers_of_strangers(make_set: MakeSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = make_set(trusted=False)
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    path = logged(folder, f"{sys.executable} {program}", tmp_path / "run.jsonl")
    trust(folder)
    first, *others = path.read_text().splitlines()
    commands = (
        ["report", str(path)],
        ["report", str(path), "--json"],
        ["export", str(path), "--svg", str(tmp_path / "e.svg")],
        ["rerun", str(path)],
    )
    for change in HEADERS:
        path.write_text("\n".join((json.dumps(changed(json.loads(first), change)), *others)) + "\n")
        for command in commands:
            assert main(command) in (0, 2), (change, command)
            said = capsys.readouterr()
            text = said.out + said.err
            assert all(line.isprintable() for line in text.splitlines()), (change, command)
            assert len(said.err) < 600, (change, command)


def test_a_run_with_a_class_of_a_notebook_cannot_be_run_again(
    make_set: MakeSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    configuration, path = load(make_set()), tmp_path / "run.jsonl"
    simulator = Simulator(configuration.simulation, 5)
    engine = Engine(simulator)
    with RunLog(path, configuration, simulator) as log:
        engine.watch(log)
        for text in ("h1", "d1-1"):
            engine.session().submit(parse_command(text), lambda outcome: None)
    first, *others = path.read_text().splitlines()
    path.write_text("\n".join((json.dumps(json.loads(first) | {"devices": []}), *others)) + "\n")
    assert main(["report", str(path)]) == 0
    capsys.readouterr()
    assert main(["rerun", str(path)]) == 2
    assert "of the kind 'temp', which is in none of its device files" in capsys.readouterr().err
