"""The table of faults: what counts as right is compared as it says, and a fault can be flown."""

from __future__ import annotations

import json
import math
import random
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

BENCHMARKS = Path(__file__).parent.parent / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))
from fault_devices import set_ranges_long, wire_gyro_short  # noqa: E402
from fault_independent import INDEPENDENT  # noqa: E402
from fault_kinds import KINDS, TOLD  # noqa: E402
from fault_people import program_key_error  # noqa: E402
from fault_proxy import Faults  # noqa: E402
from faults import PARTLY, RIGHT, SILENT, WRONG, Task, grade, rotating_tasks_of  # noqa: E402


def cause(kind: str, *culprits: str, text: str = "") -> dict[str, Any]:
    return {"kind": kind, "culprits": list(culprits), "text": text, "tried": []}


def report(first: dict[str, Any] | None, findings: tuple[str, ...] = ()) -> dict[str, Any]:
    verdict = {"outcome": "failed", "cause": first, "evidence": [], "program": None}
    return {
        "verdict": verdict,
        "findings": [{"of": code, "kind": "offset"} for code in findings],
        "output": [],
    }


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        (report(None), SILENT),
        (report(cause("sensor wrong", "u1")), RIGHT),
        (report(cause("sensor wrong", "u1", "g1")), PARTLY),
        (report(cause("sensor wrong", "g1")), WRONG),
        (report(cause("missed grip")), WRONG),
        (report(cause("missed grip"), findings=("u5",)), PARTLY),
    ],
)
def test_a_report_is_graded_by_its_cause_culprits_and_findings(said: dict[str, Any], expected: str) -> None:
    assert grade(said, set_ranges_long(random.Random(1))) == expected


def test_a_fault_on_the_wire_may_be_one_that_cannot_be_told_apart() -> None:
    case = wire_gyro_short(random.Random(1))
    assert grade(report(cause("drove at a known wall", "g1")), case) == RIGHT
    assert grade(report(cause("lost", "g1")), case) == RIGHT
    assert grade(report(cause("lost")), case) == PARTLY


def test_a_crash_is_right_with_its_exception_and_what_was_printed() -> None:
    case = program_key_error(random.Random(1))
    said = report(cause("program crashed", text="the program crashed: KeyError: 'heading'"))
    assert grade(said, case) == PARTLY
    said["output"] = [{"time_s": 1.0, "stream": "stderr", "output": 'File "mine.py", line 3, in main'}]
    assert grade(said, case) == RIGHT


def test_every_kind_draws_a_case_that_is_the_same_for_a_seed() -> None:
    for name, fault in (KINDS | TOLD | INDEPENDENT).items():
        assert fault.draw(random.Random(name)) == fault.draw(random.Random(name))


def test_the_proxy_changes_what_its_rules_are_about() -> None:
    faults = Faults(
        [
            {"on": "reply", "codes": ["u1"], "do": "late", "value": 1},
            {"on": "command", "codes": ["u2", "u4"], "do": "swap"},
            {"on": "command", "codes": ["r1"], "do": "scale", "value": -1.0},
            {"on": "command", "codes": ["p1"], "do": "swallow", "value": 1.0},
        ]
    )
    said = [faults.command(text) for text in ("u2", "u4", "r1--45", "p1-1", "p1-0")]
    assert said == ["u4", "u2", "r1-45.0", None, "p1-0"]
    assert [faults.reply("u1", value) for value in (5.0, 6.0, 7.0)] == [5.0, 5.0, 6.0]
    assert faults.reply("u3", 8.0) == 8.0


def test_the_proxy_adds_up_rounds_and_picks_some_commands() -> None:
    faults = Faults(
        [
            {"on": "reply", "codes": ["g1"], "do": "drift", "value": 0.5},
            {"on": "reply", "codes": ["u1"], "do": "round", "value": 8.0},
            {"on": "command", "codes": ["d1"], "do": "swallow", "every": 3},
        ]
    )
    assert [faults.command("d1-2") for _ in range(6)] == ["d1-2", "d1-2", None] * 2
    assert [faults.reply("g1", 10.0) for _ in range(3)] == [10.5, 11.0, 11.5]
    assert [faults.reply("u1", value) for value in (3.0, 13.0, math.inf)] == [0.0, 16.0, math.inf]


def test_programs_take_turns_in_the_independent_table() -> None:
    kinds = ["program: SIGKILL", "program: never grips"]
    tasks = rotating_tasks_of(kinds, {"solve": [101, 103], "plain": [102]}, 2)
    assert tasks == [
        Task("program: SIGKILL", "solve", 101),
        Task("program: never grips", "plain", 102),
        Task("program: SIGKILL", "plain", 102),
        Task("program: never grips", "solve", 103),
    ]


def test_kinds_of_both_tables_have_names_of_their_own() -> None:
    assert not set(INDEPENDENT) & {*KINDS, *TOLD}


@pytest.mark.slow
def test_a_fault_is_flown_and_counted(tmp_path: Path) -> None:
    records = tmp_path / "records.json"
    command = [sys.executable, str(BENCHMARKS / "faults.py"), "--kinds", "exit code 3", "--programs", "plain"]
    command += ["--seeds", "1", "--clean", "1", "--keep", str(tmp_path), "--json", str(records)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    clean, fault = json.loads(records.read_text())
    assert (clean["failed"], fault["failed"]) == (False, True)
    assert fault["grade"] in ("right", "partly", "wrong", "silent")
    assert "program: exit code 3" in done.stdout
