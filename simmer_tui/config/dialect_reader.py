"""Reads dialect.toml into `DialectRules`, and lists every mistake with its line."""

import re
import struct
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeGuard

from simmer_tui.config.dialect_parts import READING, Names, Parts, RuleParts
from simmer_tui.config.dialect_toml import (
    COMMAND_KEYS,
    FILE,
    FRAME,
    HEAD_KEYS,
    LONGEST_TIME,
    REPLY,
    ROBOT,
    STREAM_KEYS,
    TABLES,
    UNKNOWN_KEYS,
    FrameTable,
    ReplyTable,
    RobotTable,
)
from simmer_tui.config.toml_file import TomlFile
from simmer_tui.dialect import expressions
from simmer_tui.dialect.dialect_rules import (
    TYPE,
    AssignStep,
    Busy,
    CourseProtocol,
    DialectRules,
    MessageRule,
    MoveStep,
    PauseStep,
    RobotRules,
    RunStep,
    Step,
    StopStep,
    StreamRule,
)
from simmer_tui.dialect.frames import FrameKind, Framing
from simmer_tui.dialect.kinds import ANY, LIST, NUMBER, TEXT, Known, ValueKind, kind_of
from simmer_tui.dialect.patterns import Pattern
from simmer_tui.dialect.templates import pack_codes
from simmer_tui.errors import Problem
from simmer_tui.sim.command import parse_value
from simmer_tui.sim.rules import did_you_mean
from simmer_tui.sim.specs import VelocityKind

# A page of rules for each of the public teams had at most 40 commands.
MOST_RULES = 500
"""Tables [[command]] of a file, and [[stream]]."""
_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
_ASSIGNED = re.compile(r"([A-Za-z_]\w*)\s*=(?!=)(.*)", re.ASCII | re.DOTALL)
_RUN = re.compile(r"run\s+(.+?)(?:\s+for\s+(.+?)\s*s)?", re.DOTALL)
_PAUSE = re.compile(r"pause\s+(.+)", re.DOTALL)
_COMMAND = re.compile(r"\w\w(?:\W.*)?", re.DOTALL)
_STEPS = "there are d1-6, run d1, run d1 for 2 s, pause 0.2, stop, name = expression"


def load_dialect(directory: Path, parts: Parts, problems: list[Problem]) -> DialectRules | None:
    """The dialect.toml of a set, if it has one; mistakes go to `problems`."""
    path = directory / FILE
    if not path.exists():
        return None
    before = len(problems)
    file = TomlFile.read(path, problems)
    # What is missing in a file that cannot be read is no mistake of its own.
    if len(problems) > before:
        return DialectRules()
    rules = _Reader(file, parts).rules()
    what = "needs a lidar in sensors.csv: a row with an ID such as lidar1"
    problems += [Problem(place, f"{name}() {what}") for place, name in rules.without_sensor(("ray", "scan"))]
    return rules


class _Reader(RuleParts):
    """Reads one file. What cannot be read is a problem, and left out."""

    def rules(self) -> DialectRules:
        """All of the file."""
        file = self._file
        for name in file.tree:
            if name not in TABLES:
                hint = did_you_mean(name, TABLES) or f" (tables: {', '.join(TABLES)})"
                file.complain(name, f"is not known here{hint}")
        protocol = self._protocol()
        if protocol is not None:
            return DialectRules(protocol=protocol)
        before = file.mistakes
        self._framing = self._read_framing()
        self._is_framed = file.mistakes == before
        reply = ReplyTable(**file.values(REPLY, file.table("reply"), "reply."))
        self._reply_end = reply.end
        table = RobotTable(**file.values(ROBOT, file.table("robot"), "robot."))
        self._state = dict(self._read_state())
        commands = file.tables("command")[:MOST_RULES]
        if len(file.tables("command")) > MOST_RULES:
            file.complain("command", f"there are more than {MOST_RULES} commands")
        rules = tuple(self._rule(each, number) for number, each in enumerate(commands, 1))
        if not commands and not file.tables("stream"):
            file.complain("", "has no [[command]]; add one for each message that the robot knows")
        streams = [self._stream(each, number) for number, each in enumerate(file.tables("stream"), 1)]
        unknown = file.table("unknown")
        self._check_keys(unknown, UNKNOWN_KEYS, "unknown.")
        self._find_hidden(rules)
        return DialectRules(
            framing=self._framing,
            reply_end=reply.end,
            missing=reply.missing,
            robot=RobotRules(
                busy=Busy(table.busy),
                reads=Busy(table.reads),
                buffer=table.buffer,
                boot=table.boot,
                greeting=table.greeting,
                halts_after=table.halts_after,
                runs_on=table.runs_on,
            ),
            state=self._state,
            rules=rules,
            streams=tuple(each for each in streams if each is not None),
            unknown=self._replies(unknown, "reply", "unknown.", {"text": TEXT}),
            unknown_place=file.place("unknown"),
            codes=self._parts.readable,
            yes_or_no=self._parts.yes_or_no,
            behind=self._parts.behind,
            lidars=self._parts.lidars,
            speeds=self._parts.speeds,
            velocity=self._parts.velocity,
        )

    # -- [frame] and [state] -----------------------------------------------------------------------

    def _protocol(self) -> CourseProtocol | None:
        """The course's protocol that the dialect is, if it is one; it needs nothing else."""
        given = self._file.table("frame")
        kind = given.get("kind")
        if kind not in tuple(CourseProtocol):
            return None
        others = [f"frame.{name}" for name in given if name != "kind"]
        for name in (*others, *(name for name in TABLES if name != "frame" and name in self._file.tree)):
            self._file.complain(name, f'has no meaning beside kind = "{kind}", a protocol of the course')
        return CourseProtocol(kind)

    def _read_framing(self) -> Framing:
        given = self._file.table("frame")
        table = FrameTable(**self._file.values(FRAME, given, "frame.", others=HEAD_KEYS))
        kind = FrameKind(table.kind)
        end = table.end if kind is FrameKind.LINE or "end" in given else ""
        wanted = {FrameKind.LINE: {"end": end}, FrameKind.BRACKET: {"open": table.open, "close": table.close}}
        for name, mark in wanted.get(kind, {}).items():
            if not mark:
                self._file.complain(f"frame.{name}", f"must not be empty for kind {kind.value}")
                return Framing()
        for name in HEAD_KEYS:
            if name in given and kind is not FrameKind.BINARY:
                self._file.complain(f"frame.{name}", 'is for kind = "binary" only')
        framing = Framing(
            kind=kind,
            end=end.encode(),
            silence=table.silence,
            longest=table.longest,
            open=table.open.encode(),
            close=table.close.encode(),
        )
        return self._with_head(framing, given) if kind is FrameKind.BINARY else framing

    def _with_head(self, framing: Framing, given: Mapping[str, Any]) -> Framing:
        head, names, body = (given.get(key) for key in HEAD_KEYS)
        complain = self._file.complain
        if not isinstance(head, str):
            complain("frame.head", 'must be a struct format, such as "<BB"')
            return framing
        if not _is_texts(names) or not all(_NAME.fullmatch(each) for each in names):
            complain("frame.names", 'must be a list of names, such as ["type", "size"]')
            return framing
        if not self._is_packable(head, len(names), "frame.head"):
            return framing
        if re.search(r"[efdspc?]", head):
            complain("frame.head", "must have whole numbers only (b B h H i I q Q)")
            return framing
        fixed = isinstance(body, int) and not isinstance(body, bool) and 0 <= body <= framing.longest
        if not fixed and body not in names:
            complain("frame.body", f"must be one of {', '.join(names)}, or a length up to {framing.longest}")
            return framing
        assert isinstance(body, str | int), "checked above"
        return Framing(
            kind=framing.kind,
            end=framing.end,
            silence=framing.silence,
            longest=framing.longest,
            head=head,
            names=tuple(names),
            body=body,
        )

    def _read_state(self) -> Iterator[tuple[str, expressions.FieldValue]]:
        for name, value in self._file.table("state").items():
            place = f"state.{name}"
            if not _NAME.fullmatch(name) or name in expressions.CONSTANTS or name in READING:
                self._file.complain(place, "is no name for a value of the state")
            elif name in self._parts.readable:
                self._file.complain(place, "is the code of a sensor; take another name")
            elif isinstance(value, bool) or not isinstance(value, int | float | str):
                self._file.complain(place, "must be a number or a text")
            else:
                yield name, value

    # -- [[command]] -------------------------------------------------------------------------------

    def _rule(self, given: Mapping[str, Any], number: int) -> MessageRule:
        prefix = f"command.{number}."
        self._check_keys(given, COMMAND_KEYS, prefix)
        unpack, fields = self._unpack(given, prefix)
        patterns = self._patterns(given, prefix)
        kind = self._type(given, prefix)
        if not {"match", "type"} & set(given):
            self._file.complain(f"{prefix}match", "is missing; it says which message this is for")
        # A value that only some of its texts have is none to go by.
        known = self._names_of(patterns, unpack, fields)
        for name in known:
            if name in self._parts.readable:
                self._file.complain(
                    f"{prefix}match", f"{{{name}}} is the code of a sensor; take another name"
                )
            elif name in expressions.CONSTANTS:
                self._file.complain(f"{prefix}match", f"{{{name}}} is a factor of length; take another name")
        if kind is not None:
            known["text"] = TEXT
        steps = tuple(each for each in self._steps(given, prefix, known) if each is not None)
        rule = MessageRule(
            number=number,
            place=self._file.place(f"command.{number}"),
            patterns=patterns,
            type=kind,
            unpack=unpack,
            names=fields,
            condition=self._expression(given.get("if"), f"{prefix}if", known, reads=False),
            steps=steps,
            takes=self._time(given.get("takes"), f"{prefix}takes", known),
            reply=self._replies(given, "reply", prefix, known),
            done=self._replies(given, "done", prefix, known),
            stopped=self._replies(given, "stopped", prefix, known),
            busy=self._busy(given, prefix),
        )
        if not rule.steps and (rule.done or rule.stopped):
            self._file.complain(
                f"{prefix}do", "is missing; done and stopped are sent at the end of its steps"
            )
        return rule

    def _names_of(self, patterns: Sequence[Pattern], unpack: str, fields: Sequence[str]) -> dict[str, Known]:
        """The values of a message. One that only some of its texts have is none to go by."""
        packed = zip(fields, pack_codes(unpack), strict=False)
        found = {name: TEXT if code in "spc" else NUMBER for name, code in packed}
        shared = frozenset.intersection(*(each.names for each in patterns)) if patterns else frozenset()
        for name in sorted(shared):
            each = [_known(pattern, name) for pattern in patterns]
            found[name] = each[0] if all(other == each[0] for other in each) else ANY
        return found

    def _patterns(self, given: Mapping[str, Any], prefix: str) -> tuple[Pattern, ...]:
        texts = given.get("match", [])
        texts = [texts] if isinstance(texts, str) else texts
        if not _is_texts(texts) or ("match" in given and not texts):
            self._file.complain(f"{prefix}match", "must be a text or a list of texts")
            return ()
        made = [self._made(partial(Pattern, each), f"{prefix}match") for each in texts]
        patterns = tuple(each for each in made if each is not None)
        for pattern in patterns:
            if self._framing.kind is FrameKind.BYTE and len(pattern.example) != 1:
                self._file.complain(f"{prefix}match", f"'{pattern.source}': a message is one character here")
            elif pattern.match(pattern.example) is None:
                what = f"'{pattern.source}' matches nothing: one field leaves nothing to the next"
                self._file.complain(f"{prefix}match", what)
        return patterns

    def _type(self, given: Mapping[str, Any], prefix: str) -> int | None:
        kind = given.get("type")
        if self._framing.kind is not FrameKind.BINARY:
            if kind is not None or "unpack" in given:
                key = "type" if kind is not None else "unpack"
                self._file.complain(prefix + key, 'is for [frame] kind = "binary" only')
            return None
        if "match" in given and "unpack" in given:
            self._file.complain(f"{prefix}unpack", "stands beside match; one of them takes the content apart")
        if TYPE not in self._framing.names:
            if kind is not None and self._is_framed:
                self._file.complain(f"{prefix}type", f"the header has no field '{TYPE}' (names in [frame])")
            return None
        if not isinstance(kind, int) or isinstance(kind, bool):
            self._file.complain(f"{prefix}type", "must be a whole number: the header's field type")
            return None
        code = tuple(pack_codes(self._framing.head))[self._framing.names.index(TYPE)]
        try:
            struct.pack(f"<{code}", kind)
        except struct.error:
            self._file.complain(f"{prefix}type", f"{kind} does not fit the header '{self._framing.head}'")
        return kind

    def _unpack(self, given: Mapping[str, Any], prefix: str) -> tuple[str, tuple[str, ...]]:
        text = given.get("unpack")
        if text is None:
            return "", ()
        shape, colon, names = str(text).partition(":")
        fields = tuple(names.split())
        if not isinstance(text, str) or not colon or not all(map(_NAME.fullmatch, fields)):
            self._file.complain(f"{prefix}unpack", 'must be a struct format and names, such as "<hh: x y"')
            return "", ()
        if not self._is_packable(shape.strip(), len(fields), f"{prefix}unpack"):
            return "", ()
        return shape.strip(), fields

    def _busy(self, given: Mapping[str, Any], prefix: str) -> Busy | None:
        word = given.get("busy")
        if word is None:
            return None
        if word not in tuple(Busy):
            known = ", ".join(each.value for each in Busy)
            self._file.complain(f"{prefix}busy", f"must be one of {known}")
            return None
        return Busy(word)

    # -- steps -------------------------------------------------------------------------------------

    def _steps(self, given: Mapping[str, Any], prefix: str, names: Names) -> Iterator[Step | None]:
        texts = given.get("do", [])
        texts = [texts] if isinstance(texts, str) else texts
        if not _is_texts(texts):
            self._file.complain(f"{prefix}do", "must be a step or a list of steps, each a text")
            return
        for text in texts:
            yield self._step(text.strip(), f"{prefix}do", names)

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
        if not _COMMAND.fullmatch(text):
            self._file.complain(place, f"'{text}' is no step; {_STEPS}")
            return None
        if code not in self._parts.commands:
            self._no_code(code, self._parts.commands, place)
            return None
        value = parse_value(text[3:]) if "{" not in text and code in self._parts.speeds else 0.0
        if not text[3:].strip() or isinstance(value, str):
            self._file.complain(place, f"'{text}' has no value; write it behind the code, {code}-6")
            return None
        return MoveStep(template)

    def _no_code(self, code: str, known: Collection[str], place: str) -> None:
        what = f"no enabled row of drive.csv has the code '{code}'"
        self._file.complain(place, f"{what}; there are {', '.join(sorted(known))}")

    def _run(self, drive: str, seconds: str | None, place: str, names: Names) -> Step | None:
        if not self._parts.velocity:
            row = f"{VelocityKind.ALL.value},vv,1"
            self._file.complain(place, f"run needs the row '{row}' in drive.csv")
            return None
        if seconds is None and re.search(r"\sfor\s", drive):
            self._file.complain(place, f"'run {drive}' needs seconds with their unit: run {drive} s")
            return None
        template = self._text(drive, place, names)
        time = self._expression(_bare(seconds), place, names) if seconds is not None else None
        if template is None or (seconds is not None and time is None):
            return None
        given = [drive] if "{" not in drive else re.findall(r"'(-?\w\w)'|\"(-?\w\w)\"", drive)
        for each in given:
            code = (each if isinstance(each, str) else each[0] or each[1]).removeprefix("-")
            if code not in self._parts.speeds:
                self._no_code(code, self._parts.speeds, place)
                return None
        return RunStep(template, time)

    def _assigned(self, name: str, text: str, place: str, names: Names) -> Step | None:
        if name not in self._state:
            known = ", ".join(self._state) or "none"
            hint = did_you_mean(name, self._state) or f"; its values: {known}"
            self._file.complain(place, f"'{name}' is no value of [state]{hint}")
            return None
        value = self._expression(text, place, names)
        return AssignStep(name, value) if value is not None else None

    def _stream(self, given: Mapping[str, Any], number: int) -> StreamRule | None:
        prefix = f"stream.{number}."
        self._check_keys(given, STREAM_KEYS, prefix)
        every = given.get("every")
        is_number = isinstance(every, int | float) and not isinstance(every, bool)
        # A robot's loop at 2 kHz; faster ones fill any line.
        if not is_number or not 0.0005 <= float(every or 0) <= LONGEST_TIME:
            self._file.complain(f"{prefix}every", f"must be seconds from 0.0005 to {LONGEST_TIME:g}")
            return None
        send = self._replies(given, "send", prefix, {"tick": NUMBER})
        if "send" not in given:
            self._file.complain(f"{prefix}send", "is missing; it says what is sent")
        condition = self._expression(given.get("if"), f"{prefix}if", {"tick": NUMBER}, reads=False)
        return StreamRule(float(every or 0), send, condition, self._file.place(f"stream.{number}"))

    # -- together ----------------------------------------------------------------------------------

    def _find_hidden(self, rules: Sequence[MessageRule]) -> None:
        """A command whose own example an earlier one takes is never done."""
        for rule in rules:
            for pattern in rule.patterns:
                earlier = next(
                    (each for each in rules[: rule.number - 1] if _takes(each, rule, pattern)), None
                )
                if earlier is not None:
                    what = f"'{pattern.example}' is taken by the command before it at {earlier.place}"
                    self._file.complain(f"command.{rule.number}.match", f"{what}; put this one first")
            if rule.type is None or rule.patterns:
                continue
            before = next((each for each in rules[: rule.number - 1] if _takes_frames(each, rule)), None)
            if before is not None:
                what = f"type {rule.type} is taken by the command before it at {before.place}"
                self._file.complain(f"command.{rule.number}.type", f"{what}; give that one an if")


def _takes_frames(earlier: MessageRule, rule: MessageRule) -> bool:
    """True if an earlier command takes all frames of a later one that has no pattern."""
    if earlier.condition is not None or earlier.type != rule.type or earlier.patterns:
        return False
    same = bool(rule.unpack) and struct.calcsize(earlier.unpack) == struct.calcsize(rule.unpack)
    return not earlier.unpack or same


def _known(pattern: Pattern, name: str) -> Known:
    """Kind and values of a field of a pattern."""
    of_kind = {"number": NUMBER, "int": NUMBER, "digit": NUMBER, "list": LIST, "word": TEXT, "text": TEXT}
    values = tuple(pattern.choices.get(name, {}).values())
    found = {kind_of(each) for each in values}
    return (
        of_kind.get(pattern.kinds[name], ANY)
        if not values
        else Known(found.pop() if len(found) == 1 else ValueKind.ANY, values)
    )


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


def _is_texts(value: object) -> TypeGuard[list[str]]:
    return isinstance(value, list) and all(isinstance(each, str) for each in value)
