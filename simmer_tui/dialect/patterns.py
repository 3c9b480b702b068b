"""Patterns of a dialect.toml: a message with `{name}` in place of each value.

    {n} number    {n:int} whole number    {n:digit} one digit    {n:word}    {n:text}    {n:list} codes: u0,u1
    {n=300} optional, with its default    {n:f=0|d=1} one of these words, which represents that value

A blank matches one or more. A brace itself is written twice. A pattern matches a whole message.
"""

import re
from collections.abc import Mapping

from simmer_tui.dialect.expressions import FieldValue
from simmer_tui.sim.command import NUMBER
from simmer_tui.sim.rules import did_you_mean

# Possessive: a field never gives characters back, so that matching takes linear time.
_FIELDS = {
    "number": (rf"(?>{NUMBER.pattern})", "7.5"),
    "int": (r"(?>[+-]?[0-9]+)", "7"),
    "digit": (r"[0-9]", "7"),
    "word": (r"(?>\w+)", "word"),
    "text": (r".*", "text"),
    "list": (r"(?>\w+(?:\s*,\s*\w+)*)", "u0,u1"),
}
"""Regular expression of a kind of field, and an example."""
NUMERIC = ("number", "int", "digit")
"""Kinds of fields that are numbers."""
NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
"""Name of a field, or of a value of a dialect."""
_FIELD = re.compile(r"(?P<brace>\{\{|\}\})|\{(?P<inside>[^{}]*)\}")
_TWICE = "a brace itself is written twice"
# Python refuses to convert numbers of thousands of digits.
_LONGEST_NUMBER = 40
"""Characters of a number in a message."""


class Pattern:
    """A pattern that has been checked.

    Args:
        source: Its text.

    Raises:
        ValueError: A field is not as described above.
    """

    def __init__(self, source: str) -> None:
        self.source = source
        if not source:
            raise ValueError("is empty; write the message as it is sent")
        self.kinds: dict[str, str] = {}
        """The kind of each field, `choice` for one of a few words."""
        self.choices: dict[str, dict[str, FieldValue]] = {}
        """The words of each choice, with their values."""
        self.defaults: dict[str, str] = {}
        """The defaults of fields, as text."""
        made, example, end = "", "", 0
        for field in _FIELD.finditer(source):
            plain = source[end : field.start()]
            if field["brace"]:
                text = field["brace"][0]
                pattern = re.escape(text)
            else:
                pattern, text = self._field(field["inside"])
            made += _literal(plain) + pattern
            example += plain + text
            end = field.end()
        rest = source[end:]
        plain = _FIELD.sub("", source)
        if source not in ("{", "}") and (brace := next((each for each in plain if each in "{}"), "")):
            other = "}" if brace == "{" else "{"
            raise ValueError(f"'{source}' has a {brace} without its {other}; {_TWICE}")
        self.example = example + rest
        """A message that matches."""
        if list(self.kinds.values()).count("text") > 1:
            raise ValueError("has two fields of text; where the first one ends would not be clear")
        # A text before a blank does not end with one: else each blank of a run would be searched again.
        made = (made + _literal(rest)).replace(r".*)\s++", r"(?:.*(?<!\s))?)\s++")
        self._pattern = re.compile(made, re.DOTALL)
        self.names = frozenset(self.kinds)
        """The names of its fields."""

    def _field(self, inside: str) -> tuple[str, str]:
        """The regular expression of a field, and an example."""
        name = NAME.match(inside)
        if name is None:
            raise ValueError(
                f"{{{inside}}}: a field begins with a name, such as {{n}} or {{n:int}}; {_TWICE}"
            )
        rest = inside[name.end() :]
        if name[0] in self.kinds:
            raise ValueError(f"has the field {{{name[0]}}} twice")
        if rest.startswith(":") and "|" in rest:
            return self._choice(name[0], rest[1:])
        kind, has_default, default = rest.partition("=")
        kind = kind.removeprefix(":") if kind else "number"
        if kind not in _FIELDS or (rest and rest[0] not in ":="):
            known = ", ".join(_FIELDS)
            raise ValueError(f"{{{inside}}}: '{kind}' is no kind of field; there are {known}"
                             f"{did_you_mean(kind, _FIELDS)}")  # fmt: skip
        self.kinds[name[0]] = kind
        inner, example = _FIELDS[kind]
        pattern = f"(?P<{name[0]}>{inner})"
        if not has_default:
            return pattern, example
        if re.fullmatch(inner, default) is None:
            raise ValueError(f"{{{inside}}}: the default '{default}' is no {kind}")
        self.defaults[name[0]] = default
        return f"(?:{pattern})?+", default

    def _choice(self, name: str, choices: str) -> tuple[str, str]:
        self.kinds[name] = "choice"
        words: dict[str, FieldValue] = {}
        for choice in choices.split("|"):
            word, stands, value = choice.partition("=")
            if not word or word in words:
                raise ValueError(f"{{{name}:{choices}}}: each word is given once, as in {{{name}:f=0|d=1}}")
            words[word] = _plain(value) if stands else word
        self.choices[name] = words
        longest_first = sorted(words, key=len, reverse=True)
        return f"(?P<{name}>(?>{'|'.join(map(re.escape, longest_first))}))", next(iter(words))

    def filled(self, texts: Mapping[str, str]) -> str:
        """The message with a text for each field; a field without one has its default."""
        texts = {**self.defaults, **texts}

        def text(field: re.Match[str]) -> str:
            return field["brace"][0] if field["brace"] else texts[re.split("[:=]", field["inside"])[0]]

        return _FIELD.sub(text, self.source)

    def matches_in_any_case(self, message: str) -> bool:
        """True if the whole message matches, or would with other capitals."""
        return re.fullmatch(self._pattern.pattern, message, re.DOTALL | re.IGNORECASE) is not None

    def match(self, message: str) -> dict[str, FieldValue] | None:
        """The values of the fields, or None if the whole message does not match."""
        found = self._pattern.fullmatch(message)
        if found is None:
            return None
        values: dict[str, FieldValue] = {}
        for name, kind in self.kinds.items():
            text = found[name]
            if text is None:
                values[name] = _converted(kind, self.defaults[name])
            elif kind == "choice":
                values[name] = self.choices[name][text]
            elif kind in ("number", "int") and len(text) > _LONGEST_NUMBER:
                return None
            else:
                values[name] = _converted(kind, text)
        return values


def _literal(text: str) -> str:
    return r"\s++".join(map(re.escape, re.split(r"[ \t]+", text)))


def _converted(kind: str, text: str) -> FieldValue:
    if kind in NUMERIC:
        return _plain(text)
    if kind == "list":
        return tuple(part.strip() for part in text.split(","))
    return text


def _plain(text: str) -> FieldValue:
    """The number in a text, an int if it is written as one; else the text."""
    if NUMBER.fullmatch(text) is None or len(text) > _LONGEST_NUMBER:
        return text
    return int(text) if text.lstrip("+-").isdigit() else float(text)
