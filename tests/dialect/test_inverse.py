"""Inverse rules: the message for a command, and the reasons why a rule has no inverse."""

from __future__ import annotations

from pathlib import Path

import pytest

from simmer_tui.config.dialect_reader import load_dialect
from simmer_tui.config.loader import find_set, load
from simmer_tui.dialect.dialect_rules import DialectRules, Parts
from simmer_tui.dialect.expressions import FieldValue
from simmer_tui.dialect.inverse import DialectMessage, InverseRules
from simmer_tui.errors import Problem

SPEC = load(find_set("default")).simulation
PARTS = Parts(SPEC.sensors, SPEC.drives, SPEC.gripper, SPEC.velocities)
SPEED = {drive.code: drive.speed for drive in SPEC.drives}

LINES = """
[state]
front = 0
[[command]]
match = "w {n}"
do = "d1-{n*12/13}"
[[command]]
match = "b {n}"
do = "a1-{n*12/13}"
[[command]]
match = "r {n}"
do = "r1-{-n}"
[[command]]
match = "l {n:int}"
do = "r1-{n}"
[[command]]
match = "q"
do = ["a1-2", "pause 0.2"]
[[command]]
match = "side {n} {o}"
do = "w1-{n*o}"
[[command]]
match = "getData {k:int=5}"
reply = "u1: {u1*cm:.2f} u2: {u2+u3} front {front} {1 if u4 < 3 else 0}"
[[command]]
match = "x{how:word}"
do = "stop"
[[command]]
match = "halt"
do = "stop"
"""
JSON_LINES = """
[[command]]
match = '{{"cmd": "drive", "cm": {n}}}'
do = "d1-{n/cm}"
done = '{{"ok": true}}'
"""
BRACKETS = """
[frame]
kind = "bracket"
[state]
front = 0
[[command]]
match = "{way:f=0|d=1|s=2|a=3}{ms:int=300}"
do = "run {pick((front + way) % 4, 'd1', '-w1', 'a1', 'w1')} for {ms/1000} s"
[[command]]
match = "h"
do = "stop"
"""
BYTES = """
[frame]
kind = "byte"
[[command]]
match = "F"
do = "d1-2"
[[command]]
match = "w"
do = "run d1"
[[command]]
match = "a"
do = "run -r1"
[[command]]
match = "u"
reply = "{u1*cm:.0f},"
[[command]]
match = "S"
do = "stop"
"""
BINARY = """
[frame]
kind = "binary"
head = "<BB"
names = ["type", "size"]
body = "size"
end = "$"
[[command]]
type = 1
unpack = "<hf: n speed"
do = "d1-{n/mm_per_in}"
[[command]]
type = 2
reply = {type = 9, pack = "<ff", values = ["u1", "u2*mm"]}
[[command]]
type = 3
do = "stop"
[state]
mm_per_in = 25.4
"""


def rules_of(tmp_path: Path, text: str) -> DialectRules:
    """The rules of a dialect.toml without mistakes."""
    (tmp_path / "dialect.toml").write_text(text, "utf-8")
    problems: list[Problem] = []
    rules = load_dialect(tmp_path, PARTS, problems)
    assert rules is not None
    assert not problems, problems
    return rules


def data_of(message: DialectMessage | str | None) -> bytes:
    assert isinstance(message, DialectMessage), message
    return message.data


@pytest.mark.parametrize(
    ("dialect", "code", "value", "data"),
    [
        (LINES, "d1", 12.0, b"w 13\n"),
        (LINES, "d1", -12.0, b"b 13\n"),
        (LINES, "a1", 6.0, b"b 6.5\n"),
        (LINES, "r1", 30.0, b"l 30\n"),
        (LINES, "r1", -30.25, b"r 30.25\n"),
        (BRACKETS, "d1", 3.0, b"[f%d]" % round(3000 / SPEED["d1"])),
        (BRACKETS, "w1", -3.0, b"[d%d]" % round(3000 / SPEED["w1"])),
        (JSON_LINES, "d1", 1.0, b'{"cmd": "drive", "cm": 2.54}\n'),
        (BYTES, "d1", 2.0, b"F"),
        (BINARY, "d1", 10.0, b"\x01\x06\xfe\x00\x00\x00\x00\x00$"),
    ],
)
def test_a_movement_has_its_message(
    tmp_path: Path, dialect: str, code: str, value: float, data: bytes
) -> None:
    rules = rules_of(tmp_path, dialect)
    assert data_of(InverseRules(rules).drive(code, value)) == data


@pytest.mark.parametrize(
    ("dialect", "code", "value"), [(LINES, "w1", 3.0), (BYTES, "d1", 3.0), (BYTES, "r1", 9.0)]
)
def test_a_movement_without_one_number_has_none(
    tmp_path: Path, dialect: str, code: str, value: float
) -> None:
    rules = rules_of(tmp_path, dialect)
    made = InverseRules(rules).drive(code, value)
    assert made == f"no rule of the dialect with one step and one number does {code}"


def test_the_state_counts(tmp_path: Path) -> None:
    rules = rules_of(tmp_path, BRACKETS)
    turned = {"front": 1, "way": 0}
    assert data_of(InverseRules(rules, turned).drive("a1", 3.0)).startswith(b"[d")


@pytest.mark.parametrize(
    ("dialect", "code", "value", "data"),
    [(BYTES, "d1", 3.0, b"w"), (BYTES, "r1", -15.0, b"a"), (LINES, "d1", 12.0, b"w 13\n")],
)
def test_a_key_takes_a_run_without_an_end_if_there_is_one(
    tmp_path: Path, dialect: str, code: str, value: float, data: bytes
) -> None:
    rules = rules_of(tmp_path, dialect)
    assert data_of(InverseRules(rules).held(code, value)) == data


def test_a_stop_is_a_rule_that_does_nothing_else(tmp_path: Path) -> None:
    for dialect, data in ((LINES, b"halt\n"), (BRACKETS, b"[h]"), (BYTES, b"S"), (BINARY, b"\x03\x00$")):
        rules = rules_of(tmp_path, dialect)
        assert data_of(InverseRules(rules).stop()) == data
    rules = rules_of(tmp_path, LINES.replace('"halt"\ndo = "stop"', '"halt"\ndo = ["stop", "front = 1"]'))
    assert InverseRules(rules).stop() is None


@pytest.mark.parametrize(
    ("dialect", "code", "data"),
    [(LINES, "u1", b"getData 5\n"), (BYTES, "u1", b"u"), (BINARY, "u2", b"\x02\x00$")],
)
def test_a_reading_has_its_message(tmp_path: Path, dialect: str, code: str, data: bytes) -> None:
    rules = rules_of(tmp_path, dialect)
    assert data_of(InverseRules(rules).read(code)) == data


@pytest.mark.parametrize("code", ["u2", "u3", "u4", "u5"])
def test_a_reading_among_others_or_bent_has_none(tmp_path: Path, code: str) -> None:
    rules = rules_of(tmp_path, LINES)
    assert isinstance(InverseRules(rules).read(code), str)


def test_the_dictionary_names_what_there_is(tmp_path: Path) -> None:
    assert dict(InverseRules(rules_of(tmp_path, BYTES)).dictionary()) == {
        "stop": "S", "d1-N, keys only": "w", "r1--N, keys only": "a", "u1": "u",
        "a1--N, keys only": "w",
    }  # fmt: skip
    named = dict(InverseRules(rules_of(tmp_path, LINES)).dictionary())
    assert named["a1-N"] == "b {n}"
    assert named["r1--N"] == "r {n}"


def test_an_expression_that_fails_is_no_rule(tmp_path: Path) -> None:
    rules = rules_of(tmp_path, '[[command]]\nmatch = "w {n}"\ndo = "d1-{1/n + pick(n, 1, 2)}"\n')
    state: dict[str, FieldValue] = {}
    assert isinstance(InverseRules(rules, state).drive("d1", 3.0), str)
