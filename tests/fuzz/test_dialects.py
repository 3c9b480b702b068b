"""Changed dialects and courses, most of them valid: nothing hangs, fails inside or is executed. And inputs of
any sort for the parsers of a dialect."""

from __future__ import annotations

import contextlib
import random
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.config.dialect_reader import load_dialect
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_sets, init_set
from simmer_tui.dialect.device import DialectDevice
from simmer_tui.dialect.dialect_rules import DialectRules, Parts
from simmer_tui.dialect.expressions import Expression
from simmer_tui.dialect.frames import Deframer, FrameKind, Framing
from simmer_tui.dialect.inverse import InverseRules
from simmer_tui.dialect.messages import dictionary, nearest
from simmer_tui.dialect.patterns import Pattern
from simmer_tui.dialect.reply_reader import ReplyReader
from simmer_tui.dialect.templates import parsed_reply
from simmer_tui.errors import ConfigurationError, ExpressionError, Problem
from simmer_tui.grade.course import read_course
from tests.dialect.test_device import Host

OWN = Path(__file__).parents[2] / "scripts" / "arduino" / "own_language" / "dialect.toml"
HEADS = (
    '[frame]\nend = "\\n"\nsilence = 0.2\nlongest = 4000\n[reply]\nend = "\\r\\n"\nmissing = "-1"\n',
    '[frame]\nkind = "bracket"\nopen = "<"\nclose = ">"\nlongest = 65536\n[reply]\nmissing = "8190"\n',
    '[robot]\nbusy = "replace"\nreads = "wait"\nboot = 0.1\nhalts_after = 0.3\n[state]\nled = 0\n',
    '[[stream]]\nevery = 0.1\nsend = "{tick} {u1:.1f} {i1}"\n[unknown]\nreply = "? {text}"\n',
)
SPEC = load(bundled_sets()["default"]).simulation
PARTS = Parts(SPEC.sensors, SPEC.drives, SPEC.gripper, SPEC.velocities)
EVIL = "__import__('os').system('touch executed')"
EXECUTING = ("exec", "os.system", "os.exec", "os.posix_spawn", "subprocess.Popen", "os.fork")
WORDS = (
    b"{n:text}",
    b"{n:list}",
    b"match",
    b"reply",
    b"do",
    b"run d1",
    b"stop",
    EVIL.encode(),
    b"\\u001b]0;X\\u0007",
)
FIELDS = ("{a}", "{b:int}", "{c:digit}", "{d:word}", "{e:text}", "{f:list}", "{g=300}", "{h:f=0|d=1|fast=2}")
ENDINGS = ("", "\n", "]", "]\n", "\r\n")
_executed: list[str] = []
_listening: list[bool] = []


def _note(event: str, arguments: Sequence[object]) -> None:
    if _listening and event in EXECUTING:
        _executed.append(f"{event} {arguments}")


@pytest.fixture
def nothing_executed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    if not hasattr(sys, "_fuzz_hook"):  # a hook stays for ever
        sys._fuzz_hook = True  # type: ignore[attr-defined]
        sys.addaudithook(_note)
    monkeypatch.chdir(tmp_path)
    _executed.clear()
    _listening.append(True)
    yield
    _listening.clear()
    assert not _executed
    assert not Path("executed").exists()


def expression(chance: random.Random, names: Sequence[str], depth: int = 3) -> str:
    """A calculation with numbers."""
    if depth == 0 or chance.random() < 0.3:
        return chance.choice((*names, *names, "u1", "u2", "i1", "time", "0", "3", "2.5", "cm", "contact"))
    one, other = (expression(chance, names, depth - 1) for _ in range(2))
    made = (
        *(
            f"({one} {sign} {other})"
            for sign in ("+", "-", "*", "/", "//", "%", "**", "<", "==", "and", "or")
        ),
        *(f"{call}({one}, {other})" for call in ("min", "max", "pick(contact, 0, 1) + max")),
        *(f"{call}({one})" for call in ("abs", "int", "round", "-", "0 == ")),
        f"({one} if {other} else 1)",
        f"({one}/0)",
    )
    return chance.choice(made)


def command(chance: random.Random, number: int) -> str:
    """A [[command]] with a pattern of its own."""
    fields = chance.sample(FIELDS, chance.randint(0, 3))
    joints = [chance.choice((" ", "   ", ",", ":", ";")) for _ in fields]
    match = f"m{number} " + "".join(field + joint for field, joint in zip(fields, joints, strict=True)) + "!"
    names = [field[1] for field in fields if field[1] in "abcg"]
    lists = [field[1] for field in fields if field[1] == "f"]
    texts = [field[1] for field in fields if field[1] in "de"]
    reply = [f"{{{expression(chance, names)}:.2f}}" for _ in range(chance.randint(0, 3))]
    reply += [f"{{named({name})}} {{{name}|,}} {{{name}=={name}}}" for name in lists]
    reply += [f"{{{name}}} {{len({name})}}" for name in texts]
    lines = [f'match = "{match}"', f'reply = "{" ".join(reply)}"']
    steps = ("stop", "run d1", "run -d1 for 0.5 s", "pause 0.1", f"d1-{{{expression(chance, names, 1)}}}")
    if chance.random() < 0.5:
        lines.append(f"do = {chance.sample(steps, chance.randint(1, 3))}".replace("'", '"'))
        lines.append('done = "ok {contact}"')
    if chance.random() < 0.3:
        lines.append(f'busy = "{chance.choice(("now", "wait", "replace", "drop"))}"')
    if chance.random() < 0.2:
        lines.append(
            f'if = "{expression(chance, names, 2).replace("u1", "1").replace("u2", "2").replace("i1", "0")}"'
        )
    return "\n[[command]]\n" + "\n".join(lines) + "\n"


def changed(text: bytes, chance: random.Random, mutate: Any) -> bytes:
    """A dialect with more commands; one of four has a part that is broken as well."""
    text += "".join(command(chance, number) for number in range(chance.randint(1, 6))).encode()
    return mutate(text, chance, WORDS) if chance.random() < 0.25 else text


def play(rules: DialectRules, chance: random.Random, mutate: Any) -> None:
    """What check, a run and a real robot do with a dialect."""
    assert [*dictionary(rules)] or not rules.rules
    assert InverseRules(rules).dictionary() is not None
    host = Host()
    host.readings = {code: chance.choice((0.0, 1.0, 12.3, float("inf"))) for code in PARTS.readable}
    device = DialectDevice(rules, host, lambda rule, values: reader.asked(rule, values))
    reader = ReplyReader(rules, device.state)
    device.opened()
    examples = [pattern.example for rule in rules.rules for pattern in rule.patterns]
    for message in chance.sample(examples, min(len(examples), 8)):
        unit = chance.choice((" ", ",a", "a", "1", " ,", "-"))
        for text in (message, message[:3] + unit * 200 + message[3:], message + unit * 200):
            data = rules.framing.message(None, text.encode()) if not rules.framing.head else text.encode()
            device.received(data if chance.random() < 0.5 else mutate(data, chance, WORDS))
            nearest(text[:100], rules)
        host.pass_time(0.5)
        if host.under_way:
            host.end()
        reader.receive("".join(host.take())[:500].encode())
        reader.silence()
    device.closed()


@pytest.mark.parametrize("cases", [15, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.usefixtures("nothing_executed")
def test_changed_dialects(cases: int, tmp_path: Path, mutate: Any) -> None:
    texts = [OWN.read_bytes(), *map(str.encode, HEADS)]
    valid = 0
    for seed in range(cases):
        chance = random.Random(seed)
        (tmp_path / "dialect.toml").write_bytes(changed(chance.choice(texts), chance, mutate))
        problems: list[Problem] = []
        try:
            rules = load_dialect(tmp_path, PARTS, problems)
            assert all(each.what for each in problems)
            if not problems and not rules.protocol:
                valid += 1
                play(rules, chance, mutate)
        except Exception as error:
            error.add_note(f"seed {seed}")
            raise
    assert cases * 0.5 <= valid < cases, "the changes break too much or too little"


COURSE = (
    ("name", ('"The course"', '"a"')),
    ("command", ('"python main.py"', '"python x.py --fast"')),
    ("dialects", ("true", "false")),
    ("wheels", ("true", "false")),
)
TABLES = {
    "decide": (("require", "0.5 0.9 1.0"), ("margin", "0.1 0.2"), ("risk", "0.01 0.3"), ("cap", "1 20 5000")),
    "limits": (
        ("time", "1 1e6 0.5"),
        ("cpu", "3 60.5"),
        ("memory", "100 2000"),
        ("disk", "1.5"),
        ("output", "2"),
    ),
    "rules": (("sensors", "0 8 1000"), ("size", "0.1 8.5")),
}


@pytest.mark.parametrize("cases", [15, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.usefixtures("nothing_executed")
def test_changed_courses(cases: int, tmp_path: Path, mutate: Any) -> None:
    init_set(tmp_path / "config", bundled_sets()["mission"])
    (tmp_path / "teams" / "alpha").mkdir(parents=True)
    (tmp_path / "teams" / "alpha" / "main.py").write_text("pass\n", "utf-8")
    valid, refused = 0, list[Problem]()
    for seed in range(cases):
        chance = random.Random(seed)
        lines = ['set = "config"', 'teams = "teams"']
        lines += [f"{key} = {chance.choice(values)}" for key, values in COURSE if chance.random() < 0.7]
        for table, keys in TABLES.items():
            lines.append(f"[{table}]")
            lines += [
                f"{key} = {chance.choice(value.split())}" for key, value in keys if chance.random() < 0.7
            ]
        data = "\n".join(lines).encode()
        file = tmp_path / "course.toml"
        file.write_bytes(mutate(data, chance, WORDS) if chance.random() < 0.4 else data)
        try:
            course = read_course(file)
            valid += bool(course.teams)
        except ConfigurationError as error:
            refused += error.problems
        except Exception as error:
            error.add_note(f"seed {seed}")
            raise
    assert all(each.what for each in refused)
    assert cases * 0.5 <= valid < cases, "the changes break too much or too little"


def _evaluate(text: str) -> None:
    made = Expression(text)
    with contextlib.suppress(ExpressionError):
        made.value(_Names())


class _Names:
    def value(self, name: str) -> Any:
        return {"L": (1.5, float("inf")) * 900, "t": "u0,u1" * 99}.get(name, 2)

    def call(self, function: str, arguments: Sequence[Any]) -> Any:
        return (1.0,) * 360 if function == "scan" else 3.0


def _reply(text: str) -> None:
    reply, _ = parsed_reply(text)
    with contextlib.suppress(ExpressionError):
        reply.text(_Names(), "-1")


def _match(text: str) -> None:
    source, _, message = text.partition("|")
    pattern = Pattern(source)
    for each in (message, pattern.example, pattern.example + message * 20, message * 50):
        pattern.match(each)
        pattern.matches_in_any_case(each)


def _deframe(text: str) -> None:
    data = text.encode("utf-8", "surrogateescape")
    for framing in FRAMINGS:
        deframer = Deframer(framing)
        for at in range(0, len(data), 7):
            deframer.receive(data[at : at + 7])
        deframer.silence()
        deframer.end()


_HEAD = {"head": "<BB", "names": ("type", "size"), "body": "size", "end": b";"}
FRAMINGS = (
    *(Framing(longest=40), Framing(kind=FrameKind.BRACKET, longest=40), Framing(kind=FrameKind.BYTE)),
    Framing(kind=FrameKind.BINARY, longest=40, **_HEAD),  # type: ignore[arg-type]
)
PARSERS = {"expression": _evaluate, "reply": _reply, "pattern": _match, "frames": _deframe}
GOOD = {
    "expression": (
        "(u1*cm + 2) // 3 if led and L==L else named('u0')",
        "pick(n % 4, L[2], -n**2, min(1/0, 3))",
    ),
    "reply": ("{u1*cm:.2f},{scan(0, 90, 4):d|,}|{t}{{}}", "{L|;}{n:05d}{pick(1, '}', 'a:b')}"),
    "pattern": (
        "say {t:text} {l:list}!|say a b,c",
        "[{w:f=0|d=1}{n:int=3}]{d:digit}|[f3]7",
        "{{{a}   {b:text}|",
    ),
    "frames": ("w 12\r\nx\n", "[f500][", "\x01\x03abc;\x02\xff", "[[]]"),
}


@pytest.mark.parametrize("cases", [25, pytest.param(2500, marks=pytest.mark.slow)])
@pytest.mark.parametrize("parser", PARSERS)
@pytest.mark.usefixtures("nothing_executed")
def test_inputs_of_any_sort(cases: int, parser: str, mutate: Any) -> None:
    taken, refused = 0, list[str]()
    for seed in range(cases):
        chance = random.Random(seed)
        good = chance.choice(GOOD[parser]).encode()
        text = mutate(good, chance, WORDS).decode("utf-8", "surrogateescape")
        try:
            PARSERS[parser](text)
            taken += 1
        except ValueError as error:
            refused.append(str(error))
        except Exception as error:
            error.add_note(f"seed {seed}")
            raise
    assert all(refused)
    assert taken > cases / 10
