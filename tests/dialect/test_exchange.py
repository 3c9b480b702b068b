"""An exchange with a real robot against a dialect: every way in which they may differ."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from simmer_tui.cli.main import main
from simmer_tui.config.dialect_reader import load_dialect
from simmer_tui.config.loader import find_set, init_set, load
from simmer_tui.dialect.dialect_rules import Parts
from simmer_tui.dialect.reply_reader import MOST_PENDING, ReplyReader
from simmer_tui.errors import Problem
from tests.links.sketch_robot import DIALECT

TO, FROM = "to", "from"
SLOW = DIALECT.replace('match = "get"', 'match = "get"\ntakes = 0.3')
RIGHT = [
    (0.0, TO, "get\n"),
    (0.02, FROM, "25.4,14"),
    (0.03, FROM, ".2 led 0\r\n"),
    (1.0, TO, "light\n"),
    (1.5, TO, "f 3\n"),
    (2.4, FROM, "ok\r\n"),
    (3.0, TO, "x\n"),
]


def checked(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    pieces: list[tuple[float, str, str]],
    dialect: str = DIALECT,
    *options: str,
) -> tuple[int, str]:
    """The exit code and the output of `check --against` for an exchange."""
    if not (tmp_path / "set").exists():
        init_set(tmp_path / "set", find_set("default"))
    (tmp_path / "set/dialect.toml").write_text(dialect, "utf-8")
    lines = [{"baud": 9600}, *({"t": time, side: data} for time, side, data in pieces)]
    path = tmp_path / "exchange.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines), "utf-8")
    code = main(["check", str(tmp_path / "set"), "--against", str(path), *options])
    return code, capsys.readouterr().out


def test_a_dialect_that_answers_as_the_robot_did(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert checked(tmp_path, capsys, RIGHT) == (
        0, "4 messages of the dialect; the dialect answers as the robot did\n",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("pieces", "told"),
    [
        ([(0.0, TO, "Get\n")], "2: 'Get' is no message of the dialect; 'get' differs in case"),
        (
            [(0.0, TO, "get\n"), (0.02, FROM, "25.4;14.2 led 0\r\n")],
            "3: 'get': the robot says '25.4;14.2 led 0', and the dialect '{u1*cm:.1f},{u2*cm",
        ),
        (
            [(0.0, TO, "get\n"), (3.0, TO, "x\n")],
            "2: 'get': the robot does not answer, and the dialect says '{u1*cm:.1f}",
        ),
        (
            [(0.0, TO, "f 1\n"), (9.0, TO, "x\n")],
            "2: 'f {n}': the robot says nothing at its end, and the dialect says 'ok'",
        ),
        (
            [(0.0, TO, "x\n"), (0.1, FROM, "stopped\r\n")],
            "3: the robot says 'stopped', and the dialect nothing",
        ),
        (
            [(0.0, TO, "get\n"), (0.5, FROM, "25.4,14.2 led 0\r\n")],
            "2: 'get' is answered after 0.48 s; the dialect has takes = 0",
        ),
    ],
)
def test_what_is_otherwise_is_told_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], pieces: list[tuple[float, str, str]], told: str
) -> None:
    code, out = checked(tmp_path, capsys, pieces)
    assert code == 1
    assert out.splitlines()[0].startswith(f"exchange.jsonl:{told}")
    assert out.endswith("; 1 difference\n")


DROPS = '[robot]\nbusy = "drop"\n' + DIALECT
REPLACES = '[robot]\nbusy = "replace"\n' + DIALECT


@pytest.mark.parametrize(
    ("dialect", "pieces"),
    [
        # A stop ends the first one; the end of the second is that of the second.
        (DIALECT, [(0.0, TO, "f 20\n"), (1.0, TO, "x\n"), (2.0, TO, "f 1\n"), (2.2, FROM, "ok\r\n")]),
        # It also drops what waits.
        (DIALECT, [(0.0, TO, "f 20\n"), (0.1, TO, "f 20\n"), (1.0, TO, "x\n")]),
        (REPLACES, [(0.0, TO, "f 20\n"), (1.0, TO, "f 1\n"), (1.2, FROM, "ok\r\n")]),
        # The stop comes while the answer is under way.
        (DIALECT, [(0.0, TO, "f 20\n"), (1.0, TO, "x\n"), (1.01, FROM, "ok\r\n")]),
        (
            REPLACES,
            [(0.0, TO, "f 20\n"), (1.0, TO, "b 1\n"), (1.01, FROM, "ok\r\n"), (1.2, FROM, "ok\r\n")],
        ),
    ],
)
def test_a_movement_that_something_ends_need_not_be_answered(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    dialect: str,
    pieces: list[tuple[float, str, str]],
) -> None:
    code, out = checked(tmp_path, capsys, [*pieces, (9.0, TO, "light\n")], dialect)
    assert code == 0, out


def test_of_a_message_that_is_lost_only_that_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pieces = [(0.0, TO, "f 6\n"), (0.5, TO, "f 6\n"), (1.0, FROM, "ok\r\n"), (9.0, TO, "light\n")]
    _, out = checked(tmp_path, capsys, pieces, DROPS)
    assert out.splitlines() == [
        "exchange.jsonl:3: 'f {n}' is lost: the robot is busy",
        "3 messages of the dialect; 1 difference",
    ]


@pytest.mark.parametrize(
    ("reply", "said"),
    [
        ("{u1*10:04X}", "00D2"),
        ("{u1*10:x},{u2:02x}", "7f,0c"),
        ("{u1:#x}", "0x1f"),
        ("{u1:#06x};{u1:01X}", "0x001f;A"),
        ("{u1*10:04X}{u2*10:04X}", "00D200FF"),
        ("{u1:b} {u2:o}", "1011 17"),
        ("{u1:04X}", "-1"),
        ("{u1/100:.1%}", "12.5%"),
        ("{u1*1000:,.0f}", "12,345"),
    ],
)
def test_numbers_of_other_forms_are_answers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], reply: str, said: str
) -> None:
    dialect = f'[reply]\nend = "\\r\\n"\nmissing = "-1"\n[[command]]\nmatch = "h"\nreply = "{reply}"\n'
    pieces = [(0.0, TO, "h\n"), (0.01, FROM, f"{said}\r\n"), (9.0, TO, "h\n")]
    code, out = checked(tmp_path, capsys, pieces, dialect)
    assert code == 0, out


def test_a_reading_in_hex_is_read(tmp_path: Path) -> None:
    text = '[reply]\nmissing = "-1"\n[[command]]\nmatch = "h"\nreply = "{u1*10:04X}{u2:#x};"\n'
    (tmp_path / "dialect.toml").write_text(text, "utf-8")
    spec, problems = load(find_set("default")).simulation, list[Problem]()
    rules = load_dialect(tmp_path, Parts(spec.sensors, spec.drives), problems)
    assert not problems
    reader = ReplyReader(rules, {})
    for said, readings in (
        ("00D20x10;", {"u1": 21.0, "u2": 16.0}),
        ("-10x10;", {"u1": math.inf, "u2": 16.0}),
    ):
        reader.asked(rules.rules[0], {})
        (reply,) = reader.receive(said.encode())
        assert reply.readings == readings


def test_a_reply_too_early(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out = checked(tmp_path, capsys, RIGHT, SLOW)
    assert code == 1
    assert "'get' is answered after 0.01 s; the dialect has takes = 0.3" in out


def test_differences_for_programs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out = checked(tmp_path, capsys, [(0.0, TO, "Get\n")], DIALECT, "--json")
    assert code == 1
    found = json.loads(out)
    assert [row["line"] for row in found["differences"]] == [2]


@pytest.mark.parametrize("line", ["x", "[]", '{"t": 1}', '{"t": "a", "to": "x"}', '{"t": 1, "to": "\u20ac"}'])
def test_a_file_that_is_no_exchange(tmp_path: Path, capsys: pytest.CaptureFixture[str], line: str) -> None:
    checked(tmp_path, capsys, RIGHT)
    path = tmp_path / "exchange.jsonl"
    path.write_text('{"baud": 9600}\n' + line + "\n", "utf-8")
    assert main(["check", str(tmp_path / "set"), "--against", str(path)]) == 2
    assert "exchange.jsonl:2: is no line of an exchange" in capsys.readouterr().err.replace(":2:is", ":2: is")


def test_what_was_never_sent_does_not_count(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pieces = [(0.0, TO, "Get\n"), (0.1, "unsent", "Get\n"), (0.1, TO, "x\n")]
    assert checked(tmp_path, capsys, pieces)[0] == 0


def test_silence_after_a_run_ends_no_movement_behind_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dialect = (
        '[robot]\nhalts_after = 2\n[[command]]\nmatch = "m"\ndo = ["run d1", "d1-30"]\ndone = "ok"\n'
        '[[command]]\nmatch = "light"\n'
    )
    code, out = checked(tmp_path, capsys, [(0.0, TO, "m\n"), (20.0, TO, "light\n")], dialect)
    assert code == 1
    assert "'m': the robot says nothing at its end" in out


GOT = "25.4,14.2 led 0\r\n"
BROKEN_OFF = [(0.0, TO, "f 20\n"), (1.0, TO, "x\n"), (1.1, TO, "get\n"), (1.12, FROM, GOT)]


def test_an_answer_to_a_later_message_is_none_to_a_movement_that_a_stop_ended(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out = checked(tmp_path, capsys, [*BROKEN_OFF, (99.0, TO, "light\n"), (99.1, FROM, "ok\r\n")])
    assert code == 1
    assert out.startswith("exchange.jsonl:7: the robot says 'ok', and the dialect nothing")


def test_a_robot_that_comes_to_rest_slowly_may_tell_it_after_another_answer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dialect = DIALECT.replace('done = "ok"', 'done = "ok"\nstopped = "cut"', 1)
    assert checked(tmp_path, capsys, [*BROKEN_OFF, (1.2, FROM, "cut\r\n")], dialect)[0] == 0


def test_messages_that_need_no_answer_displace_none_that_needs_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ended = [(1.0 + count, TO, "f 20\nx\n") for count in range(MOST_PENDING + 1)]
    code, out = checked(tmp_path, capsys, [(0.0, TO, "get\n"), *ended])
    assert code == 1
    assert out.startswith("exchange.jsonl:2: 'get': the robot does not answer")


def reader_of(folder: Path, reply: str) -> ReplyReader:
    """A reader that waits for one reply."""
    (folder / "dialect.toml").write_text(f'[[command]]\nmatch = "q"\nreply = "{reply}"\n', "utf-8")
    problems: list[Problem] = []
    rules = load_dialect(folder, Parts(load(find_set("default")).simulation.sensors), problems)
    assert not problems
    reader = ReplyReader(rules, {})
    reader.asked(rules.rules[0], {})
    return reader


@pytest.mark.parametrize(
    ("reply", "noise"),
    [
        ("{u1:.2f} {u2:.2f}x", b"1" * 2000 + b" " + b"1" * 2000),
        ("{u1:.2f}{u2:.2f}x", b"1" * 4000),
        ("{u1:.2f}    {u2:.2f}x", b"1" + b" " * 4000),
        ("{u1:04x}" * 12 + "x", b"1" * 4000),
        (",".join(["{u1:.1f}"] * 40) + "x", b",".join([b"inf"] * 40)),
    ],
)
def test_no_noise_of_a_robot_keeps_the_reader_busy(tmp_path: Path, reply: str, noise: bytes) -> None:
    # With a step for each way to divide the digits this would take hours.
    reader = reader_of(tmp_path, reply)
    assert [each.part for each in (*reader.receive(noise + b"\n"), *reader.silence())] == [""]


@pytest.mark.parametrize(
    ("reply", "said", "readings"),
    [
        ("{u1:.1f}cm {u2:.1f}cm {u3:.1f}cm", b"12.5cm inf.0cm -3.0cm", None),
        (
            "{u1:.1f}cm {u2:.1f}cm {u3:.1f}cm",
            b"12.5cm infcm -3.0cm",
            {"u1": 12.5, "u2": math.inf, "u3": -3.0},
        ),
        ("{u1:d}.{u2:d}", b"12.5", {"u1": 12.0, "u2": 5.0}),
        ("{u1:.1f}. {u2:.1f}", b"12.5. 3", {"u1": 12.5, "u2": 3.0}),
        ("{u1:04x}{u2:04x}{u3:04x}", b"000c00640003", {"u1": 12.0, "u2": 100.0, "u3": 3.0}),
        ("{u1:02x}{u2:02x};{u3:x}", b"0cff;1f", {"u1": 12.0, "u2": 255.0, "u3": 31.0}),
    ],
)
def test_numbers_end_where_their_reply_says(
    tmp_path: Path, reply: str, said: bytes, readings: dict[str, float] | None
) -> None:
    reader = reader_of(tmp_path, reply)
    (found,) = (*reader.receive(said), *reader.silence())
    assert (found.readings if found.part else None) == readings
