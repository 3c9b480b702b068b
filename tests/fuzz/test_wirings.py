"""Changed wirings and sketches: each is read, or refused with the place and what is allowed there."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.errors import Problem
from simmer_tui.sim.specs import WheelLayout, WheelsSpec
from simmer_tui.sketch.sketch_check import facts_of, sketch_problems
from simmer_tui.sketch.wiring import WiringParts, missing_sketches, read_wiring, wiring_lines
from simmer_tui.sketch.wiring_draft import draft
from tests.sketch.test_sketch_check import EYES, ROVER, WIRING
from tests.sketch.test_wiring import TWO_BOARDS

WORDS = (
    *(
        b"rover",
        b"sensor",
        b"A0",
        b"uno",
        b"mega",
        b"hbridge",
        b"pwm2",
        b"shield",
        b"hc-sr04",
        b"mpu6050",
        b"vl53l0x",
        b"encoder",
    ),
    *(b"[[motors]]", b"[boards.x]", b"board", b"sketch", b"../..", b"/", b"gripper = {", b"digitalWrite"),
    *(
        b"attachInterrupt(",
        b"#define A A",
        b"{{{",
        b"))))",
        b"/*",
        b"NewPing",
        b"SoftwareSerial",
        b"A0 ? A0 :",
        b"Wire.begin(); Wire.beginTransmission(",
        b"MPU6050 mpu(",
        b"VL53L0X eyes[9];",
        b"eyes[i].setAddress(pins[i]",
        b"xshut = 7\naddress = ",
    ),
)


@pytest.mark.parametrize("cases", [20, pytest.param(3000, marks=pytest.mark.slow)])
def test_changed_wirings_and_sketches(cases: int, tmp_path: Path, mutate: Any) -> None:
    parts = WiringParts((), WheelsSpec(layout=WheelLayout.DIFF))
    refused, taken = list[Problem](), 0
    for seed in range(cases):
        chance = random.Random(seed)
        wiring = chance.choice((TWO_BOARDS, WIRING, WIRING)).encode()
        if chance.random() < 0.7:
            wiring = mutate(wiring, chance, WORDS)
        for name, text in (("rover", ROVER), ("eyes", EYES)):
            (tmp_path / f"{name}.ino").write_bytes(mutate(text.encode(), chance, WORDS))
        problems: list[Problem] = []
        try:
            read = read_wiring(wiring.decode("utf-8", "replace"), parts, problems)
            if read is not None:
                list(wiring_lines(read))
                problems += missing_sketches(read, tmp_path)
                taken += bool(read.motors)
                problems += sketch_problems(read, facts_of(read, tmp_path, problems), parts.wheels)
            paths = [tmp_path / "rover.ino", tmp_path / "eyes.ino"]
            made = draft(paths, tmp_path, ["u1"], ["i1"])
            assert read_wiring(made, parts, []) is not None
        except Exception as error:
            error.add_note(f"seed {seed}")
            raise
        refused += problems
    for problem in refused:
        assert problem.where, problem
        assert len(problem.what) > 10, problem
        assert str(problem).isprintable(), problem
        assert len(str(problem)) < 1000, problem
    assert cases * 0.2 < taken < cases
