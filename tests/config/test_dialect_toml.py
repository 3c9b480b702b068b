"""dialect.toml: every mistake at once with its line, and what a set with one is."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest

from simmer_tui.cli.main import main
from simmer_tui.config.dialect_reader import load_dialect
from simmer_tui.config.loader import find_set, init_set, load
from simmer_tui.config.new_set import dialect_schema
from simmer_tui.config.set_summary import summarize
from simmer_tui.config.settings_file import Override
from simmer_tui.dialect.dialect_rules import CourseProtocol, Parts
from simmer_tui.dialect.frames import FrameKind
from simmer_tui.dialect.messages import dictionary
from simmer_tui.errors import ConfigurationError, Problem

SPEC = load(find_set("default")).simulation
PARTS = Parts(SPEC.sensors, SPEC.drives, SPEC.gripper, SPEC.velocities)


def problems_of(tmp_path: Path, text: str) -> list[str]:
    """The mistakes of a dialect.toml in a set like the default one."""
    (tmp_path / "dialect.toml").write_text(text, "utf-8")
    problems: list[Problem] = []
    load_dialect(tmp_path, PARTS, problems)
    return [str(each) for each in problems]


BINARY = (
    '[frame]\nkind = "binary"\nhead = "<BB"\nnames = ["type", "size"]\nbody = "size"\n[[command]]\ntype = 1\n'
)


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ('[[command]]\nmatch = "a"\nanswer = "x"', 3, "answer: is not known here"),
        ('[frame]\nkind = "lines"\n[[command]]\nmatch = "a"', 2, 'did you mean "line"'),
        ('[[command]]\nmatch = "w {n}"\ndo = "d1-{q}"', 3, "'q' is neither a value of the message"),
        ('[[command]]\nmatch = "w {n}"\ndo = "d9-{n}"', 3, "no enabled row of drive.csv has the code 'd9'"),
        (
            '[[command]]\nmatch = "w"\ndo = "run r9 for 1 s"',
            3,
            "no enabled row of drive.csv has the code 'r9'",
        ),
        (
            '[[command]]\nmatch = "{x:word}"\n[[command]]\nmatch = "stop"\ndo = "stop"',
            4,
            "is taken by the command",
        ),
        ('[[command]]\nmatch = "g"\nreply = "{u1:.200f}"', 3, "is no format, such as .2f or d"),
        ('[[command]]\nmatch = "g"\nreply = "{u1"', 3, "a { without its }"),
        ('[[command]]\nmatch = "g {n}"\nreply = "{n +}"', 3, "is no expression"),
        ('[[command]]\nmatch = "{a:int}{b:int}"', 2, "matches nothing: one field leaves nothing to the next"),
        ('[[command]]\nmatch = "{a:text} {b:text}"', 2, "has two fields of text"),
        ('[[command]]\nmatch = "g"\ntakes = "u1"', 3, "must not read a sensor"),
        ('[[command]]\nmatch = "g"\ndo = "led = 1"', 3, "'led' is no value of [state]"),
        ('[[command]]\nmatch = "g"\nbusy = "later"', 3, "must be one of now, wait, replace, drop"),
        ('[[command]]\nmatch = "g"\ndone = "x"', 1, "do: is missing; done and stopped are sent at the end"),
        ('[[command]]\nreply = "x"', 1, "match: is missing"),
        ('[frame]\nkind = "byte"\n[[command]]\nmatch = "go"', 4, "a message is one character here"),
        ('[frame]\nkind = "byte"\n[[command]]\nmatch = "é"', 4, "a message is one character here, of ASCII"),
        ('[[command]]\nmatch = "get\\n"', 2, "'get\\n' is never received: line ends and blanks around"),
        ('[[command]]\nmatch = "get "', 2, "'get ' is never received: line ends and blanks around"),
        ('[frame]\nend = ";"\n[[command]]\nmatch = "a;b"', 4, "'a;b' is never received"),
        ('[frame]\nlongest = 3\n[[command]]\nmatch = "stop"', 4, "never received: longer than 3 bytes"),
        (
            '[frame]\nkind = "bracket"\n[[command]]\nmatch = "[p]"',
            4,
            "'[p]' is never received: match is the text between [frame] open and close",
        ),
        ("[frame]\nend = '\\n'\n[[command]]\nmatch = 'a'", 2, 'a line end is "\\n", in double quotes'),
        ("[reply]\nend = '\\r\\n'\n[[command]]\nmatch = 'a'", 2, 'a line end is "\\n", in double quotes'),
        ('[[stream]]\nevery = 0\nsend = "x"', 2, "must be seconds from 0.0005 to 3600"),
        ('[[command]]\nmatch = "g"\nreply = {type = 1, text = "x"}', 3, 'needs [frame] kind = "binary"'),
        (BINARY + 'reply = {type = 1, pack = "<f", values = []}', 8, "has 1 value for 0 names"),
        (
            BINARY + 'reply = {type = 1, pack = "<300s", values = ["u1"]}',
            8,
            "300 bytes of content do not fit",
        ),
        (BINARY + 'unpack = "<h x"', 8, "must be a struct format and names"),
        ('[frame]\nkind = "binary"\nhead = "<Bq"\nnames = ["type"]', 3, "has 2 values for 1 name"),
        ('[state]\nu1 = 3\n[[command]]\nmatch = "a"', 2, "is the code of a sensor"),
        ('[[command]]\nmatch = "w {mm}"\ndo = "d1-{mm}"', 2, "{mm} is a factor of length"),
        ('[[command]]\nmatch = "b {n"', 2, "'b {n' has a { without its }; a brace itself is written twice"),
        (
            '[[command]]\nmatch = \'{"cmd": "read"}\'',
            2,
            "a field begins with a name, such as {n} or {n:int}; a brace itself is written twice",
        ),
        (
            '[[command]]\nmatch = "g"\nreply = "{max(scan(0, 30, 12)):.1f}"',
            3,
            "a list is no number; calculate with one value of it, as in scan(0, 30, 12)[2]*cm",
        ),
        ('[[command]]\nmatch = "g"\nreply = "{scan(0, 30, 12):.1f}"', 3, "is a list; write {...|,} to join"),
        ('[[command]]\nmatch = "g"\nreply = "{scan(0, 30, 12)[12]}"', 3, "the list has 12 values"),
        ('[[command]]\nmatch = "g {w:word}"\nreply = "{w*2}"', 3, "w is a text, and no number"),
        ('[[command]]\nmatch = "g"\nreply = "{pick(2, 3, 4)}"', 3, "pick(2, ...) has 2 values"),
        ('[[command]]\nmatch = "{w:a=0|b=2}"\nreply = "{pick(w, 3, 4)}"', 3, "pick(2, ...) has 2 values"),
        ('[state]\ni = 0\n[[command]]\nmatch = "g"\nreply = "{pick(i % 4, 3, 4, 5)}"', 5, "has 3 values"),
        ('[[command]]\nmatch = "f {n}"\ndo = "d1{n}"', 3, "'d1{n}' has no hyphen behind the code: d1-{n}"),
        ('[[command]]\nmatch = "g"\ndo = "d1-"', 3, "'d1-' has no value; write it behind the code, d1-6"),
        ('[[command]]\nmatch = "g"\ndo = "jump 3"', 3, "'jump 3' is no step; there are d1-6, run d1"),
        ('[[command]]\nmatch = "g"\ndo = "pause"', 3, "'pause' is no step"),
        (
            '[[command]]\nmatch = "g"\ndo = "run d1 for 2"',
            3,
            "'run d1 for 2' needs seconds with their unit, as in run d1 for 0.5 s",
        ),
        # The unit stands alone: this is no time of m, the factor of length.
        ('[[command]]\nmatch = "f {ms}"\ndo = "run d1 for ms"', 3, "'run d1 for ms' needs seconds"),
        ('[[command]]\nmatch = "g"\ndo = "run d1 for 500 ms"', 3, "'run d1 for 500 ms' needs seconds"),
        ('[[command]]\nmatch = "g"\nreply = "{u1*CM}"', 3, 'did you mean "cm"?'),
        (
            '[[command]]\nmatch = "a"\n[[command]]\nmatch = "a"',
            4,
            "'a' is taken by the command before it at dialect.toml:1:command.1; give that one an if",
        ),
        (BINARY.replace("type = 1", "type = 300"), 7, "300 does not fit the header '<BB'"),
        (BINARY + 'reply = "ok"', 8, "a text is no binary frame"),
        (BINARY + 'unpack = "<h: x"\nmatch = "x"', 8, "unpack: stands beside match"),
        (BINARY + "[[command]]\ntype = 1", 9, "type 1 is taken by the command before it"),
        (BINARY + '[[command]]\ntype = 1\nunpack = "<h: x"', 9, "type 1 is taken by the command before it"),
        ('[robots]\nbusy = "drop"\n[[command]]\nmatch = "a"', 1, 'did you mean "robot"'),
    ],
)
def test_a_mistake_is_named_with_its_line(tmp_path: Path, text: str, line: int, what: str) -> None:
    problems = problems_of(tmp_path, text)
    assert [each for each in problems if what in each and each.startswith(f"dialect.toml:{line}:")], problems


def test_messages_that_arrive_are_right(tmp_path: Path) -> None:
    lines = ["go {x:text=}", "{a:text}", "a  b", "$GET*{c:word}", "{n=300}", '{{"go": {n}}}', "größe"]
    text = "".join(f"[[command]]\nmatch = {json.dumps(each)}\nif = '1'\n" for each in lines)
    assert problems_of(tmp_path, text) == []
    brackets = '[frame]\nkind = "bracket"\nopen = "<"\nclose = ">"\n[[command]]\nmatch = " p[1]\\n"\n'
    assert problems_of(tmp_path, brackets) == []
    assert problems_of(tmp_path, '[frame]\nlongest = 3\n[[command]]\nmatch = "f {n}"\n') == []
    byte = '[frame]\nkind = "byte"\n[[command]]\nmatch = "\\n"\n[[command]]\nmatch = " "\n'
    assert problems_of(tmp_path, byte) == []


@pytest.mark.parametrize(
    "time", ["2 s", "2s", "1e3s", "2.5E-1s", "{ms/1000} s", "{ms/1000}s", "ms/1000 s", "(ms/1000)s"]
)
def test_seconds_of_a_run_have_their_unit(tmp_path: Path, time: str) -> None:
    assert problems_of(tmp_path, f'[[command]]\nmatch = "f {{ms}}"\ndo = "run d1 for {time}"') == []


def test_a_text_of_a_frame_may_be_longer_in_the_file_than_on_the_line(tmp_path: Path) -> None:
    fields = ",".join(["{u1*cm*10/10:.0f}"] * 20)
    assert len(fields) > 255
    assert problems_of(tmp_path, BINARY + f'reply = {{type = 1, text = "{fields}"}}') == []
    plain = BINARY + f'reply = {{type = 1, text = "{"x" * 256}"}}'
    assert "256 bytes of content do not fit" in problems_of(tmp_path, plain)[0]


def test_all_mistakes_are_named_at_once(tmp_path: Path) -> None:
    text = '[[command]]\nmatch = "a"\ndo = "q9-1"\n[[command]]\nmatch = "b"\nreply = "{nobody}"\nbusy = 3\n'
    assert len(problems_of(tmp_path, text)) == 3


def test_a_mistake_in_a_reply_hides_no_other(tmp_path: Path) -> None:
    text = '[[command]]\nmatch = "a"\nreply = "{u1 +} {nobody} {u2:.200f} } {u3"\n'
    found = problems_of(tmp_path, text)
    assert len(found) == 5
    assert "'nobody' is neither a value" in "".join(found)


def test_a_mistake_brings_no_other_with_it(tmp_path: Path) -> None:
    assert len(problems_of(tmp_path, BINARY.replace('body = "size"', 'body = "length"'))) == 1
    (broken,) = problems_of(tmp_path, '[[command]]\nmatch = "a')
    assert "[[command]]" not in broken
    assert problems_of(tmp_path, "# nothing")[0].startswith("dialect.toml: has no [[command]]")


def test_types_that_go_by_size_or_condition_are_right(tmp_path: Path) -> None:
    sizes = BINARY + 'unpack = "<h: x"\n[[command]]\ntype = 1\nunpack = "<hh: x y"\n'
    assert problems_of(tmp_path, sizes) == []
    conditions = BINARY + 'unpack = "<h: x"\nif = "x > 0"\n[[command]]\ntype = 1\nunpack = "<h: x"\n'
    assert problems_of(tmp_path, conditions) == []


def test_plain_texts_with_an_end_may_answer_binary_frames(tmp_path: Path) -> None:
    assert problems_of(tmp_path, '[reply]\nend = "\\n"\n' + BINARY + 'reply = "ok"') == []


def test_a_file_without_rules_is_told(tmp_path: Path) -> None:
    assert "has no [[command]]" in problems_of(tmp_path, "")[0]


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("kind", FrameKind)
def test_a_new_set_of_each_kind_is_right_and_fits_its_schema(tmp_path: Path, kind: str) -> None:
    assert main(["init", str(tmp_path / "robot"), "--dialect", kind]) == 0
    configuration = load(tmp_path / "robot")
    assert configuration.settings.server.listeners == ("dialect",)
    assert configuration.settings.motion.motion == "timed"
    assert configuration.dialect is not None
    messages = list(dictionary(configuration.dialect))
    assert len(messages) >= 3
    assert not any(
        "(" in reply for _, _, reply in messages
    )  # an example that cannot be made is told in brackets
    import tomllib

    tree = tomllib.loads((tmp_path / "robot/dialect.toml").read_text("utf-8"))
    jsonschema.validate(tree, dialect_schema())
    assert json.loads((tmp_path / "robot/.schema/dialect.json").read_text("utf-8")) == dialect_schema()


def test_a_wrong_key_does_not_fit_the_schema() -> None:
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({"command": [{"match": "a", "answer": "b"}]}, dialect_schema())


def test_listeners_may_name_others_and_need_the_file(tmp_path: Path) -> None:
    init_set(tmp_path / "set", find_set("default"))
    both = {"server.listeners": Override("--listeners", ("dialect", "packets"))}
    with pytest.raises(ConfigurationError, match=r"names dialect, but the set has no dialect.toml"):
        load(tmp_path / "set", both)
    (tmp_path / "set/dialect.toml").write_text('[[command]]\nmatch = "g"\nreply = "{u1:.1f}"\n', "utf-8")
    assert load(tmp_path / "set", both).settings.server.listeners == ("dialect", "packets")
    alone = {"server.listeners": Override("--listeners", ("binary",))}
    assert load(tmp_path / "set", alone).settings.motion.motion == "instant"
    assert "dialect.toml" in load(tmp_path / "set").files


def test_check_prints_the_messages_with_examples(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    init_set(tmp_path / "set", find_set("default"))
    rules = '[[command]]\nmatch = "f {n}"\ndo = "d1-{n}"\ndone = "ok {contact}"\n'
    (tmp_path / "set/dialect.toml").write_text(rules, "utf-8")
    assert main(["check", str(tmp_path / "set")]) == 0
    assert "f {n}    d1-{n}  at its end ok 0" in capsys.readouterr().out
    assert main(["check", str(tmp_path / "set"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["messages"] == [
        {"message": "f {n}", "does": "d1-{n}", "reply": "at its end ok 0"}
    ]


def test_the_dictionary_has_names_conditions_and_counts_of_frames(tmp_path: Path) -> None:
    text = BINARY + (
        'unpack = "<h: x"\nif = "x > 0"\nreply = {type = 2, pack = "<B", values = ["i1"], times = 36}\n'
        "[[command]]\ntype = 3\nreply = {type = 4, text = \"{scan(0, 30, 3)[2]:.1f} {named('u2')}\"}\n"
    )
    (tmp_path / "dialect.toml").write_text(text, "utf-8")
    rules = load_dialect(tmp_path, PARTS, [])
    assert rules is not None
    one, other = dictionary(rules)
    assert one == ("type 1: <h: x", "if x > 0", "02 01 01 (36 times)")
    assert bytes.fromhex(other[2])[2:] == b"12.3 u2:12.30"


def test_check_says_which_commands_a_real_robot_is_sent(tmp_path: Path) -> None:
    init_set(tmp_path / "set", find_set("default"))
    path = tmp_path / "set/dialect.toml"
    stop = '[[command]]\nmatch = "x"\ndo = "stop"\n'
    rule = '[[command]]\nmatch = "f {n}"\ndo = "d1-{n}"\n'
    path.write_text(rule + stop, "utf-8")
    text = summarize(load(tmp_path / "set"))
    table = text.partition("Commands of console, keys and TCP programs for a real robot (--serial)")[2]
    rows = [line.split() for line in table.splitlines()]
    assert ["stop", "x"] in rows
    assert ["d1-N", "f", "{n}"] in rows
    path.write_text(rule, "utf-8")
    assert "no rule is a plain stop" in summarize(load(tmp_path / "set"))


def test_a_protocol_of_the_course_in_capitals_is_that_protocol(tmp_path: Path) -> None:
    problems: list[Problem] = []
    (tmp_path / "dialect.toml").write_text('[frame]\nkind = "Packets"\n', "utf-8")
    assert load_dialect(tmp_path, PARTS, problems).protocol is CourseProtocol.PACKETS
    assert problems == []


def test_codes_of_a_choice_of_drives_are_the_words_in_quotes(tmp_path: Path) -> None:
    rule = """[[command]]\nmatch = "g {n}"\ndo = "run {'d1'if n else'%s'}"\n"""
    assert problems_of(tmp_path, rule % "-d1") == []
    assert "the code 'd9'" in "".join(problems_of(tmp_path, rule % "d9"))


def test_a_step_that_is_wrong_is_not_missing_as_well(tmp_path: Path) -> None:
    rule = '[[command]]\nmatch = "g"\ndo = "q9-1"\ndone = "ok"\n'
    [problem] = problems_of(tmp_path, rule)
    assert "'q9'" in problem
