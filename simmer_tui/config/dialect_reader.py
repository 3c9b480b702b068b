"""Reads dialect.toml into `DialectRules`, and lists every mistake with its line."""

import re
import struct
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeGuard

from msgspec.structs import replace

from simmer_tui.config.dialect_parts import READING, Names, RuleParts, without_gaps
from simmer_tui.config.dialect_toml import (
    COMMAND_KEYS,
    FRAME,
    HEAD_KEYS,
    LONGEST_TIME,
    REPLY,
    ROBOT,
    STREAM_KEYS,
    TABLE_NAMES,
    UNKNOWN_KEYS,
)
from simmer_tui.config.dialects import DIALECT_FILE
from simmer_tui.config.toml_file import TomlFile
from simmer_tui.dialect import expressions
from simmer_tui.dialect.dialect_rules import (
    AssignStep,
    Busy,
    CourseProtocol,
    DialectRules,
    MessageRule,
    MoveStep,
    Parts,
    PauseStep,
    RobotRules,
    RunStep,
    Step,
    StopStep,
    StreamRule,
)
from simmer_tui.dialect.frames import TYPE, Deframer, Frame, FrameKind, Framing, Noise
from simmer_tui.dialect.kinds import (
    ANY_TYPE,
    LIST_TYPE,
    NUMBER_TYPE,
    TEXT_TYPE,
    StaticType,
    ValueKind,
    kind_of,
)
from simmer_tui.dialect.patterns import NAME, Pattern
from simmer_tui.dialect.templates import check_pack, pack_codes
from simmer_tui.errors import Problem
from simmer_tui.sim.command import cut, parse_value
from simmer_tui.sim.rules import did_you_mean, is_number, is_whole
from simmer_tui.sim.specs import VelocityKind

# The rules of the public teams have at most 40 commands each.
MOST_RULES = 500
"""Tables [[command]] of a file, and [[stream]]."""
_MARKS = ("end", "open", "close")
"""Keys of [frame] that are a mark of a message."""
_KINDS = {
    "number": NUMBER_TYPE,
    "int": NUMBER_TYPE,
    "digit": NUMBER_TYPE,
    "list": LIST_TYPE,
    "word": TEXT_TYPE,
    "text": TEXT_TYPE,
}
"""The kinds of values by the kinds of a pattern's fields."""
_ASSIGNED = re.compile(r"([A-Za-z_]\w*)\s*=(?!=)(.*)", re.ASCII | re.DOTALL)
# The unit is no letter of a name: not `for ms`.
_RUN = re.compile(r"run\s+(.+?)(?:\s+for\s+(.*\W|[\d.]+(?:[eE][+-]?\d+)?)s)?", re.DOTALL)
_PAUSE = re.compile(r"pause\s+(.+)", re.DOTALL)
_COMMAND = re.compile(r"\w\w(?:\W.*)?", re.DOTALL)
_STEPS = "there are d1-6, run d1, run d1 for 2 s, pause 0.2, stop, name = expression"


def load_dialect(directory: Path, parts: Parts, problems: list[Problem]) -> DialectRules:
    """The dialect.toml of a set; mistakes go to `problems`."""
    before = len(problems)
    file = TomlFile.read(directory / DIALECT_FILE, problems)
    # If the file cannot be read, missing parts are not reported as well.
    if len(problems) > before:
        return DialectRules()
    rules = _Reader(file, parts).rules()
    what = "needs a lidar in sensors.csv: a row with an ID such as lidar1"
    problems += [Problem(place, f"{name}() {what}") for place, name in rules.without_sensor(("ray", "scan"))]
    return rules


class _Reader(RuleParts):
    """Reads one file. A part that cannot be read is a problem, and left out."""

    def rules(self) -> DialectRules:
        """The rules of the whole file."""
        file = self._file
        file.check_names(file.tree, TABLE_NAMES, listed_as="tables")
        protocol = self._protocol()
        if protocol is not None:
            return DialectRules(protocol=protocol)
        before = file.mistakes
        self._framing = self._read_framing()
        self._is_framed = file.mistakes == before
        reply = file.values(REPLY, file.table("reply"), "reply.")
        self._reply_end = reply.get("end", "")
        self._check_escapes("reply.end", self._reply_end)
        robot = RobotRules(**file.values(ROBOT, file.table("robot"), "robot."))
        self._state = dict(self._read_state())
        commands = file.tables("command")
        if len(commands) > MOST_RULES:
            file.add_problem("command", f"there are more than {MOST_RULES} commands")
        rules = tuple(self._rule(each, number) for number, each in enumerate(commands[:MOST_RULES], 1))
        if not commands and not file.tables("stream"):
            file.add_problem("", "has no [[command]]; add one for each message that the robot knows")
        streams = [self._stream(each, number) for number, each in enumerate(file.tables("stream"), 1)]
        unknown = file.table("unknown")
        file.check_names(unknown, UNKNOWN_KEYS, "unknown.")
        self._find_hidden(rules)
        return DialectRules(
            framing=self._framing,
            reply_end=self._reply_end,
            missing=reply.get("missing", DialectRules().missing),
            robot=robot,
            state=self._state,
            rules=rules,
            streams=without_gaps(streams),
            unknown=self._replies(unknown, "reply", "unknown.", {"text": TEXT_TYPE}),
            unknown_place=file.place("unknown"),
            parts=self._parts,
        )

    # -- [frame] and [state] -----------------------------------------------------------------------

    def _protocol(self) -> CourseProtocol | None:
        """The course's protocol, if the dialect is one; it needs no other keys."""
        given = self._file.table("frame")
        kind = str(given.get("kind")).strip().lower()
        if kind not in tuple(CourseProtocol):
            return None
        others = [f"frame.{name}" for name in given if name != "kind"]
        for name in (*others, *(name for name in TABLE_NAMES if name != "frame" and name in self._file.tree)):
            self._file.add_problem(name, f'has no meaning beside kind = "{kind}", a protocol of the course')
        return CourseProtocol(kind)

    def _read_framing(self) -> Framing:
        given = self._file.table("frame")
        values = self._file.values(FRAME, given, "frame.", others=HEAD_KEYS)
        kind = values.get("kind", FrameKind.LINE)
        if kind is not FrameKind.LINE and "end" not in given:
            values["end"] = ""
        for name in _MARKS:
            self._check_escapes(f"frame.{name}", values.get(name, ""))
        marks = {name: values[name].encode() for name in _MARKS if name in values}
        framing = Framing(**(values | marks))
        for name in framing.kind.marks:
            if not getattr(framing, name):
                self._file.add_problem(f"frame.{name}", f"must not be empty for kind {kind.value}")
                return Framing()
        if kind is FrameKind.BINARY:
            return self._with_head(framing, given)
        for name in HEAD_KEYS:
            if name in given:
                self._file.add_problem(f"frame.{name}", 'is for kind = "binary" only')
        return framing

    def _check_escapes(self, place: str, mark: str) -> None:
        """Report a line end that is written in single quotes."""
        if re.search(r"\\[nr]", mark):
            self._file.add_problem(
                place, 'has a backslash and a letter; a line end is "\\n", in double quotes'
            )

    def _with_head(self, framing: Framing, given: Mapping[str, Any]) -> Framing:
        head, names, body = (given.get(key) for key in HEAD_KEYS)
        add_problem = self._file.add_problem
        if not isinstance(head, str):
            add_problem("frame.head", 'must be a struct format, such as "<BB"')
        elif not _is_texts(names) or not all(NAME.fullmatch(each) for each in names):
            add_problem("frame.names", 'must be a list of names, such as ["type", "size"]')
        elif self._made("frame.head", _header, head, len(names)) is None:
            pass  # it has its problem
        elif body not in names and not (is_whole(body) and 0 <= body <= framing.longest):
            add_problem(
                "frame.body", f"must be one of {', '.join(names)}, or a length up to {framing.longest}"
            )
        else:
            return replace(framing, head=head, names=tuple(names), body=body)
        return framing

    def _read_state(self) -> Iterator[tuple[str, expressions.FieldValue]]:
        for name, value in self._file.table("state").items():
            place = f"state.{name}"
            if not NAME.fullmatch(name) or name in expressions.CONSTANTS or name in READING:
                self._file.add_problem(place, "is no name for a value of the state")
            elif name in self._parts.readable:
                self._file.add_problem(place, "is the code of a sensor; take another name")
            elif not isinstance(value, str) and not is_number(value):
                self._file.add_problem(place, "must be a number or a text")
            else:
                yield name, value

    # -- [[command]] -------------------------------------------------------------------------------

    def _rule(self, given: Mapping[str, Any], number: int) -> MessageRule:
        prefix = f"command.{number}."
        add_problem = self._file.add_problem
        self._file.check_names(given, COMMAND_KEYS, prefix)
        unpack, fields = self._made(f"{prefix}unpack", _unpack, given.get("unpack")) or ("", ())
        patterns = self._patterns(given, prefix)
        kind = self._type(given, prefix)
        if not {"match", "type"} & set(given):
            add_problem(f"{prefix}match", "is missing; it says which message this is for")
        # A value that only some of the patterns have cannot be used.
        known = self._names_of(patterns, unpack, fields)
        for name in known:
            if name in self._parts.readable:
                add_problem(f"{prefix}match", f"{{{name}}} is the code of a sensor; take another name")
            elif name in expressions.CONSTANTS:
                add_problem(f"{prefix}match", f"{{{name}}} is a factor of length; take another name")
        if kind is not None:
            known["text"] = TEXT_TYPE
        rule = MessageRule(
            number=number,
            place=self._file.place(f"command.{number}"),
            patterns=patterns,
            type=kind,
            unpack=unpack,
            names=fields,
            steps=self._steps(given, prefix, known),
            condition=self._expression(given.get("if"), f"{prefix}if", known, reads=False),
            takes=self._time(given.get("takes"), f"{prefix}takes", known),
            reply=self._replies(given, "reply", prefix, known),
            done=self._replies(given, "done", prefix, known),
            stopped=self._replies(given, "stopped", prefix, known),
            busy=self._made(f"{prefix}busy", _busy, given.get("busy")),
        )
        if not given.get("do") and (rule.done or rule.stopped):
            add_problem(f"{prefix}do", "is missing; done and stopped are sent at the end of its steps")
        return rule

    def _names_of(
        self, patterns: Sequence[Pattern], unpack: str, fields: Sequence[str]
    ) -> dict[str, StaticType]:
        """The values of a message, without those that only some of its patterns have."""
        packed = zip(fields, pack_codes(unpack), strict=False)
        found = {name: TEXT_TYPE if code in "spc" else NUMBER_TYPE for name, code in packed}
        shared = frozenset.intersection(*(each.names for each in patterns)) if patterns else frozenset()
        for name in sorted(shared):
            each = [_known(pattern, name) for pattern in patterns]
            found[name] = each[0] if all(other == each[0] for other in each) else ANY_TYPE
        return found

    def _patterns(self, given: Mapping[str, Any], prefix: str) -> tuple[Pattern, ...]:
        place, texts = f"{prefix}match", _listed(given.get("match", []))
        if not _is_texts(texts) or ("match" in given and not texts):
            self._file.add_problem(place, "must be a text or a list of texts")
            return ()
        patterns = without_gaps([self._made(place, Pattern, each) for each in texts])
        for pattern in patterns:
            if pattern.match(pattern.example) is None:
                what = f"'{pattern.source}' matches nothing: one field leaves nothing to the next"
                self._file.add_problem(place, what)
            elif why := self._never_received(pattern):
                self._file.add_problem(place, f"'{cut(pattern.source)}' is never received: {why}")
        return patterns

    def _never_received(self, pattern: Pattern) -> str:
        """The reason why the example of a pattern, sent as a message, does not arrive; empty if it does."""
        framing = self._framing
        # Frames carry any content. A field that may be empty makes an example that is not typical.
        if framing.kind is FrameKind.BINARY or not self._is_framed or "" in pattern.defaults.values():
            return ""
        if pattern.kinds:  # a message may have a shorter number than its example
            framing = replace(framing, longest=len(pattern.example.encode()))
        parts = Deframer(framing).receive(framing.message(None, pattern.example.encode()))
        first = parts[0] if parts else None
        if len(parts) == 1 and isinstance(first, Frame) and pattern.match(first.text) is not None:
            return ""
        return first.why if isinstance(first, Noise) else framing.kind.arrives

    def _type(self, given: Mapping[str, Any], prefix: str) -> int | None:
        kind, place, add_problem = given.get("type"), f"{prefix}type", self._file.add_problem
        if self._framing.kind is not FrameKind.BINARY:
            if kind is not None or "unpack" in given:
                key = "type" if kind is not None else "unpack"
                add_problem(prefix + key, 'is for [frame] kind = "binary" only')
            return None
        if "match" in given and "unpack" in given:
            add_problem(f"{prefix}unpack", "stands beside match; one of them takes the content apart")
        if TYPE not in self._framing.names:
            if kind is not None and self._is_framed:
                add_problem(place, f"the header has no field '{TYPE}' (names in [frame])")
            return None
        if not is_whole(kind):
            add_problem(place, "must be a whole number: the header's field type")
            return None
        code = tuple(pack_codes(self._framing.head))[self._framing.names.index(TYPE)]
        try:
            struct.pack(f"<{code}", kind)
        except struct.error:
            add_problem(place, f"{kind} does not fit the header '{self._framing.head}'")
        return kind

    # -- steps -------------------------------------------------------------------------------------

    def _steps(self, given: Mapping[str, Any], prefix: str, names: Names) -> tuple[Step, ...]:
        place, texts = f"{prefix}do", _listed(given.get("do", []))
        if not _is_texts(texts):
            self._file.add_problem(place, "must be a step or a list of steps, each a text")
            return ()
        return without_gaps([self._made(place, self._step, text.strip(), place, names) for text in texts])

    def _step(self, text: str, place: str, names: Names) -> Step | None:
        if text == "stop":
            return StopStep()
        if pause := _PAUSE.fullmatch(text):
            seconds = self._expression(_bare(pause[1]), place, names)
            return PauseStep(seconds) if seconds is not None else None
        if run := _RUN.fullmatch(text):
            return self._run(run[1], run[2], place, names)
        if assigned := _ASSIGNED.fullmatch(text):
            return self._assigned(assigned[1], assigned[2], place, names)
        template = self._text(text, place, names)
        if template is None:
            return None
        code = text[:2]
        if "{" in code or "}" in code:
            return MoveStep(template)
        if text[2:3] == "{":  # the first digit of the value would be taken for the hyphen
            raise ValueError(f"'{text}' has no hyphen behind the code: {code}-{text[2:]}")
        if not _COMMAND.fullmatch(text):
            raise ValueError(f"'{text}' is no step; {_STEPS}")
        _check_code(code, self._parts.commands)
        value = parse_value(text[3:]) if "{" not in text and code in self._parts.speeds else 0.0
        if not text[3:].strip() or isinstance(value, str):
            raise ValueError(f"'{text}' has no value; write it behind the code, {code}-6")
        return MoveStep(template)

    def _run(self, drive: str, seconds: str | None, place: str, names: Names) -> Step | None:
        if not self._parts.velocity:
            row = f"{VelocityKind.ALL.value},vv,1"
            raise ValueError(f"run needs the row '{row}' in drive.csv")
        if seconds is None and re.search(r"\sfor\s", drive):
            raise ValueError(f"'run {drive}' needs seconds with their unit, as in run d1 for 0.5 s")
        template = self._text(drive, place, names)
        time = self._expression(_bare(seconds), place, names) if seconds is not None else None
        if template is None or (seconds is not None and time is None):
            return None
        quoted = [code for _, code in re.findall(r"(['\"])(-?\w\w)\1", drive)]
        for each in quoted if "{" in drive else [drive]:
            _check_code(each.removeprefix("-"), self._parts.speeds)
        return RunStep(template, time)

    def _assigned(self, name: str, text: str, place: str, names: Names) -> Step | None:
        if name not in self._state:
            known = ", ".join(self._state) or "none"
            hint = did_you_mean(name, self._state) or f"; its values: {known}"
            raise ValueError(f"'{name}' is no value of [state]{hint}")
        value = self._expression(text, place, names)
        return AssignStep(name, value) if value is not None else None

    def _stream(self, given: Mapping[str, Any], number: int) -> StreamRule | None:
        prefix = f"stream.{number}."
        self._file.check_names(given, STREAM_KEYS, prefix)
        every = given.get("every")
        # The loop of a robot at 2 kHz; faster streams fill any line.
        if not is_number(every) or not 0.0005 <= every <= LONGEST_TIME:
            self._file.add_problem(f"{prefix}every", f"must be seconds from 0.0005 to {LONGEST_TIME:g}")
            return None
        send = self._replies(given, "send", prefix, {"tick": NUMBER_TYPE})
        if "send" not in given:
            self._file.add_problem(f"{prefix}send", "is missing; it says what is sent")
        condition = self._expression(given.get("if"), f"{prefix}if", {"tick": NUMBER_TYPE}, reads=False)
        return StreamRule(float(every), send, condition, self._file.place(f"stream.{number}"))

    # -- together ----------------------------------------------------------------------------------

    def _find_hidden(self, rules: Sequence[MessageRule]) -> None:
        """Report commands that never match, because an earlier one matches their own example."""
        for rule in rules:
            earlier = rules[: rule.number - 1]
            for pattern in rule.patterns:
                taken = next((each for each in earlier if _takes(each, rule, pattern)), None)
                if taken is not None:
                    what = f"'{pattern.example}' is taken by the command before it at {taken.place}"
                    same = any(each.source == pattern.source for each in taken.patterns)
                    advice = "give that one an if" if same else "put this one first"
                    self._file.add_problem(f"command.{rule.number}.match", f"{what}; {advice}")
            if rule.type is None or rule.patterns:
                continue
            taken = next((each for each in earlier if _takes_frames(each, rule)), None)
            if taken is not None:
                what = f"type {rule.type} is taken by the command before it at {taken.place}"
                self._file.add_problem(f"command.{rule.number}.type", f"{what}; give that one an if")


def _header(head: str, count: int) -> str:
    """A struct format of whole numbers. Raises ValueError."""
    check_pack(head, count)
    if re.search(r"[efdspc?]", head):
        raise ValueError("must have whole numbers only (b B h H i I q Q)")
    return head


def _unpack(text: object) -> tuple[str, tuple[str, ...]]:
    """Struct format and names of a content. Raises ValueError."""
    if text is None:
        return "", ()
    shape, colon, names = str(text).partition(":")
    fields = tuple(names.split())
    if not isinstance(text, str) or not colon or not all(map(NAME.fullmatch, fields)):
        raise ValueError('must be a struct format and names, such as "<hh: x y"')
    check_pack(shape.strip(), len(fields))
    return shape.strip(), fields


def _busy(word: Any) -> Busy | None:
    """The word of a command. Raises ValueError."""
    if word is not None and word not in tuple(Busy):
        raise ValueError(f"must be one of {', '.join(each.value for each in Busy)}")
    return None if word is None else Busy(word)


def _check_code(code: str, known: Collection[str]) -> None:
    if code not in known:
        what = f"no enabled row of drive.csv has the code '{code}'"
        raise ValueError(f"{what}; there are {', '.join(sorted(known))}")


def _takes_frames(earlier: MessageRule, rule: MessageRule) -> bool:
    """True if an earlier command matches all frames of a later one that has no pattern."""
    if earlier.condition is not None or earlier.type != rule.type or earlier.patterns:
        return False
    same = bool(rule.unpack) and struct.calcsize(earlier.unpack) == struct.calcsize(rule.unpack)
    return not earlier.unpack or same


def _known(pattern: Pattern, name: str) -> StaticType:
    """Kind and values of a field of a pattern."""
    values = tuple(pattern.choices.get(name, {}).values())
    if not values:
        return _KINDS.get(pattern.kinds[name], ANY_TYPE)
    found = {kind_of(each) for each in values}
    return StaticType(found.pop() if len(found) == 1 else ValueKind.ANY, values)


def _takes(earlier: MessageRule, rule: MessageRule, pattern: Pattern) -> bool:
    if earlier.condition is not None or earlier.type != rule.type or earlier.unpack:
        return False
    if earlier.type is not None and not earlier.patterns:
        return True
    return any(each.match(pattern.example) is not None for each in earlier.patterns)


def _bare(text: str) -> str:
    """An expression without the braces around it."""
    text = text.strip()
    return text[1:-1] if text.startswith("{") and text.endswith("}") else text


def _listed(given: object) -> object:
    """A single text as a list; other values unchanged."""
    return [given] if isinstance(given, str) else given


def _is_texts(value: object) -> TypeGuard[list[str]]:
    return isinstance(value, list) and all(isinstance(each, str) for each in value)
