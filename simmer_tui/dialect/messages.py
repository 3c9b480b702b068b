"""The messages that a dialect knows, for people: the nearest to an unknown one, and the dictionary of all."""

import math
import struct
from collections.abc import Iterator, Sequence

from simmer_tui.dialect import dialect_rules
from simmer_tui.dialect.dialect_rules import AnyReply, DialectRules, MessageRule, Step
from simmer_tui.dialect.expressions import MOST_RAYS, Expression, FieldValue, listed_codes
from simmer_tui.dialect.templates import BinaryReply
from simmer_tui.sim.command import cut
from simmer_tui.sim.rules import did_you_mean


def nearest(text: str, rules: DialectRules) -> str:
    """`; getData differs in case`, or the pattern that is closest to an unknown message; else nothing."""
    patterns = [pattern for rule in rules.rules for pattern in rule.patterns]
    for pattern in patterns:
        if pattern.matches_in_any_case(text):
            return f"; '{pattern.source}' differs in case"
    for pattern in patterns:
        if pattern.match(" ".join(text.split())) is not None:
            return f"; '{pattern.source}' differs in blanks"
    examples = {pattern.example: pattern.source for pattern in patterns}
    hint = did_you_mean(text[:80], examples)
    for example, source in examples.items():
        hint = hint.replace(f'"{example}"', f'"{source}"')
    return hint


def does(step: Step) -> str:
    """A step, as written in the file."""
    match step:
        case dialect_rules.MoveStep(command=command):
            return command.source
        case dialect_rules.RunStep(drive=drive, seconds=seconds):
            return f"run {drive.source}" + (f" for {seconds.source} s" if seconds else "")
        case dialect_rules.PauseStep(seconds=seconds):
            return f"pause {seconds.source}"
        case dialect_rules.AssignStep(name=name, expression=expression):
            return f"{name} = {expression.source}"
    return "stop"


class _Example:
    """Values for the example of a reply: a reading is 12.3, or 1; other values are from the file and the
    example."""

    def __init__(self, rules: DialectRules, values: dict[str, FieldValue]) -> None:
        self._values: dict[str, FieldValue] = {"time": 12.3, "contact": 0, "tick": 0, "k": 0, "text": "text"}
        self._values |= dict.fromkeys(rules.parts.readable, 12.3) | dict.fromkeys(rules.parts.yes_or_no, 1)
        self._values |= {code: (12.3,) * spec.rays for code, spec in rules.parts.lidars.items()}
        self._values |= {**rules.state, **values}

    def value(self, name: str) -> FieldValue:
        return self._values.get(name, math.nan)

    def call(self, function: str, arguments: Sequence[FieldValue]) -> FieldValue:
        if function == "named":
            read = ((code, self._values.get(code)) for code in listed_codes(arguments[0]))
            return ",".join(f"{code}:{n if isinstance(n, int | float) else 12.3:.2f}" for code, n in read)
        if function == "scan":
            count = arguments[2]
            is_known = isinstance(count, int | float) and 1 <= count <= MOST_RAYS
            return (12.3,) * (int(count) if isinstance(count, int | float) and is_known else 1)
        return 12.3


def dictionary(rules: DialectRules) -> Iterator[tuple[str, str, str]]:
    """Each message with its steps, and an example of its reply."""
    for rule in rules.rules:
        steps = ", ".join(map(does, rule.steps))
        takes = f"after {rule.takes.source} s" if rule.takes is not None else ""
        does_it = "; ".join(filter(None, (_condition(rule.condition), steps, takes)))
        yield rule.shown, does_it, _replies(rule, rules)
    for stream in rules.streams:
        yield f"(every {stream.every:g} s)", _condition(stream.condition), _example(stream.send, rules, {})


def _condition(condition: Expression | None) -> str:
    return f"if {condition.source}" if condition is not None else ""


def _replies(rule: MessageRule, rules: DialectRules) -> str:
    values = rule.example(7)
    parts = (("", rule.reply), ("at its end ", rule.done), ("if stopped ", rule.stopped))
    return "; ".join(word + _example(each, rules, values) for word, each in parts if each)


def _example(replies: Sequence[AnyReply], rules: DialectRules, values: dict[str, FieldValue]) -> str:
    """An example of replies, escaped."""
    shown = []
    for reply in replies:
        try:
            if isinstance(reply, BinaryReply):
                content = reply.content(_Example(rules, values), rules.missing)
                times = f" ({reply.times} times)" if reply.times > 1 else ""
                shown.append(rules.framing.frame(reply.type, content).hex(" ") + times)
            else:
                shown.append(cut(reply.text(_Example(rules, values), rules.missing)))
        except (ValueError, struct.error) as error:
            shown.append(f"({error})")
    return ", ".join(shown)
