"""Seeded mutations of good files: the same seed always makes the same case. And commands that read them."""

from __future__ import annotations

import random
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from simmer_tui.cli.main import main
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Simulator

Mutate = Callable[[bytes, random.Random, Sequence[bytes]], bytes]

HOSTILE = (
    *(b"", b"0", b"-1", b"1e999", b"-1e999", b"1e-320", b"nan", b"inf", b"-0.0", b"1e308", b"9" * 400),
    *(b"99999999999999999999", b"0x10", b"1_000", b"1,5", b"+5", b"\xd9\xa3", b"true", b"None", b"[]"),
    *(b"{}", b'""', b"''", b"[[", b"]]", b"(", b")", b"=", b",", b",,,,", b'"', b"'", b"#", b"%", b"\\"),
    *(b"\0", b"\r", b"\r\n", b"\n\n", b"\t", b"\x1b[31m", b"\xff\xfe", b"\xef\xbb\xbf", b"\xe2\x80\xae"),
    *(b"\xed\xa0\x80", b"\xc3", b"\xf0\x9f\xa4\x96", b"x" * 300, b"[server]", b"[motion]\n", b"[[keys]]\n"),
)
"""Texts that are put in place of something, or between two things."""
CODES = (0, 1, 2, 3, 4, 130)
"""Exit codes of the command line that are no crash (`ExitCode`)."""
_PROGRAM = "from simmer_tui.client import Robot\nwith Robot() as robot: robot.drive('d1', 1)\n"
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:e-?\d+)?")
_WORD = re.compile(rb"[A-Za-z_][A-Za-z0-9_]*")


@pytest.fixture(scope="session")
def mutate() -> Mutate:
    """Changes a text in one to four places; `words` are those that may come up in it."""

    def change(text: bytes, chance: random.Random, words: Sequence[bytes]) -> bytes:
        for _ in range(chance.randint(1, 4)):
            text = chance.choice((_token, _token, _token, _line, _bytes))(text, chance, words)
        return text

    return change


def _token(text: bytes, chance: random.Random, words: Sequence[bytes]) -> bytes:
    """Another number or word in place of one of them."""
    pattern = chance.choice((_NUMBER, _NUMBER, _WORD))
    found = list(pattern.finditer(text))
    if not found:
        return _bytes(text, chance, words)
    match = chance.choice(found)
    near = (b"%d" % chance.randint(-20, 120), b"%.3f" % chance.uniform(-2, 100), chance.choice(found)[0])
    return text[: match.start()] + chance.choice((*near, chance.choice(HOSTILE))) + text[match.end() :]


def _line(text: bytes, chance: random.Random, words: Sequence[bytes]) -> bytes:
    """A line gone, twice, elsewhere, or cut off."""
    lines = text.splitlines(keepends=True) or [b""]
    at = chance.randrange(len(lines))
    match chance.randrange(4):
        case 0:
            del lines[at]
        case 1:
            lines.insert(chance.randrange(len(lines) + 1), lines[at])
        case 2:
            lines.insert(chance.randrange(len(lines)), lines.pop(at))
        case _:
            lines[at] = lines[at][: chance.randrange(len(lines[at]) + 1)]
    return b"".join(lines)


def _bytes(text: bytes, chance: random.Random, words: Sequence[bytes]) -> bytes:
    """A few bytes gone, twice, or something put between."""
    start = chance.randrange(len(text) + 1)
    end = min(len(text), start + chance.choice((0, 0, 1, 1, 2, 5, 20, 200)))
    put = chance.choice((b"", text[start:end] * 2, chance.choice(HOSTILE), chance.choice(words)))
    return text[:start] + put + text[end:]


def run(arguments: list[str], seed: int) -> None:
    """Anything but a `SimmerError`, which becomes a message, is a crash."""
    try:
        assert main(arguments) in CODES
    except Exception as error:
        error.add_note(f"seed {seed}: {arguments[0]}")
        raise


@pytest.fixture(scope="session")
def log(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A run of a few movements, every sensor read between them."""
    path = tmp_path_factory.mktemp("log") / "run.jsonl"
    configuration = load(bundled_folder())
    simulator = Simulator(configuration.simulation, 3)
    with RunLog(path, configuration, simulator) as run:
        for drive in ("r1-30", "d1-2", "r1--60", "d1-3", "a1-2"):
            for code in ("u1", "u2", "u3", "i1", "c1", "o1", "g1", "t1", "zz"):
                run(simulator.execute(code))
            run(simulator.execute(drive))
    return path.read_bytes()


@pytest.fixture(scope="session")
def trials(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of finished trials."""
    base = tmp_path_factory.mktemp("trials")
    (base / "robot.py").write_text(_PROGRAM)
    folder = base / "done"
    run = ("--run", f'"{sys.executable}" "{base / "robot.py"}"')
    assert main(["trials", "--runs", "2", "--seed", "1", "--port", "0", "--out", str(folder), *run]) == 0
    return folder
