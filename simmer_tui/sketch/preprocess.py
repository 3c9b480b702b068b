"""A sketch made into C++, as Arduino's own build does it: one source of all .ino files, with prototypes.

The numbers of the sketch get the widths that they have on the board: `int` 16 bits, `long` 32, `double` 4
bytes. Line numbers stay those of its files.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from simmer_tui.sketch.c_names import C_NAMES
from simmer_tui.sketch.cpp_text import (
    CPP_TOKEN,
    blank,
    closing_place,
    closing_places,
    code_text,
    global_text,
    line_at,
    with_inserted,
    without_comments,
)
from simmer_tui.sketch.prototypes import prototypes

_TYPE_WORDS = frozenset(("unsigned", "signed", "long", "short", "int", "double"))
# Of <limits.h> and <float.h>, which have those of this machine.
_LIMITS = {
    **dict.fromkeys(("INT_MAX", "SHRT_MAX"), "32767"),
    **dict.fromkeys(("INT_MIN", "SHRT_MIN"), "(-32767 - 1)"),
    **dict.fromkeys(("UINT_MAX", "USHRT_MAX"), "65535U"),
    "LONG_MAX": "2147483647",
    "LONG_MIN": "(-2147483647 - 1)",
    "ULONG_MAX": "4294967295U",
    "DBL_MAX": "FLT_MAX",
    "DBL_MIN": "FLT_MIN",
    "DBL_EPSILON": "FLT_EPSILON",
}
"""Bounds of the number types of an AVR."""
_WIDE_LIMITS = {
    "INT_MAX": "2147483647",
    "INT_MIN": "(-2147483647 - 1)",
    "UINT_MAX": "4294967295U",
    **{name: name for name in ("DBL_MAX", "DBL_MIN", "DBL_EPSILON")},
}
"""Those that differ with an `int` of 32 bits."""
_LOOP = re.compile(r"\b(?P<kind>while|for)\b\s*(?=\()")
_NO_BODY = re.compile(r"\s*(?:;|continue\s*;|\{(?:[\s;]|continue\b)*\})")
_ENDLESS = re.compile(r"\s*(?:|1|true|HIGH)\s*")
_DECLARATION = re.compile(r"[\w:<>\s]*[\w>][\s*&]+[A-Za-z_]\w*\s*(?:=(?!=)|\{)")
_ENUMERATORS = re.compile(r"\benum\b[^;{}()]*\{([^{}]*)\}")
# A block without a statement has no instrumentation in gcc: a loop of it would take no time, and never end.
# A compiler that computes a constant has no board.
_STATEMENT = "(__builtin_is_constant_evaluated() || (::yield(), true))"
OWN = "_of_sketch"
"""Ending of a name of the C library that a sketch has as its own."""
_ARGUMENTS = re.compile(r"\([^()]*\)")
_DEFINED = re.compile(r"(?:[\w>]\s|[*&,])\s*([A-Za-z_]\w*)\s*(?=[(=;\[,{]|\Z|\n)")
_METHOD = re.compile(r"(?:[\w>]\s|[*&])\s*([A-Za-z_]\w*)\s*(?=\()")
_CLASS = re.compile(r"\b(?:class|struct)\b[^;{}]*\{(.*?)\};", re.DOTALL)
# The sum of a stack's address and that of a mark has no meaning here, and is another one in each run.
_HEAP_MARK = re.compile(
    r"(?:\breturn\b|(?<![=!<>])=(?!=))(?P<value>[^;={}]*\b__(?:brkval|heap_start|bss_end|malloc_heap_start)\b"
    r"[^;{}]*)(?=;)"
)
FREE_MEMORY = 1500
"""Bytes that a usual sketch leaves free of the 2 kB of an Uno."""
_MAIN = re.compile(r"\bint\s+(?P<name>main)\s*\((?P<arguments>[^(){};]*)\)\s*\{")

Templates = Mapping[str, tuple[int, ...]]
"""Places of arguments that have one type, by the name of a function template."""
_TEMPLATE = re.compile(
    r"\btemplate\s*<(?P<types>[^<>;{}()]*)>[^;{}()]*?\b(?P<name>[A-Za-z_]\w*)\s*\((?P<arguments>[^(){};]*)\)"
)
_MEMBER = re.compile(r"(?:\.|->)\s*[A-Za-z_]\w*\s*$")
_BEFORE_CALLS = frozenset(("return", "else", "do", "case", "and", "or", "not"))
"""Words before the name of a function that is called."""


def with_board_widths(source: str, int_bits: int = 16) -> str:
    """C++ with the number types of a board in the place of this machine's: of an AVR, or with an `int` of 32
    bits and a `double` of 8 bytes. Comments, texts and line ends stay."""
    limits = _LIMITS if int_bits == 16 else _LIMITS | _WIDE_LIMITS
    made: list[str] = []
    words: list[str] = []
    gap = ""
    end = 0

    def flush() -> None:
        nonlocal words, gap
        if words:
            made.append(_type_of(words, int_bits))
            words = []
        made.append(gap)
        gap = ""

    for match in CPP_TOKEN.finditer(source):
        between = source[end : match.start()]
        end = match.end()
        word = match["word"]
        if words and word in _TYPE_WORDS and not between.strip() and "\n" not in gap + between:
            words.append(word)
            continue
        if words:
            gap = between
            flush()
        else:
            made.append(between)
        if word in _TYPE_WORDS:
            words = [word]
        elif match["number"]:
            made.append(_without_long(match["number"]))
        elif word in limits:
            made.append(limits[word])
        else:
            made.append(match[0])
    if words:
        flush()
    made.append(source[end:])
    return "".join(made)


def _type_of(words: Sequence[str], int_bits: int) -> str:
    """The type of these words on a board."""
    if "double" in words:
        return "float" if int_bits == 16 else "double"
    if words == ["signed"] or words == ["unsigned"] or "int" in words or "short" in words or "long" in words:
        bits = 64 if words.count("long") > 1 else 32 if "long" in words else int_bits
        bits = 16 if "short" in words else bits
        return f"{'u' if 'unsigned' in words else ''}int{bits}_t"
    return " ".join(words)


def _without_long(number: str) -> str:
    """A whole number without the suffix `L`, which would make it 64 bits wide here."""
    if re.fullmatch(r"(?:0[xX][0-9a-fA-F']+|0[bB][01']+|[0-9][0-9']*)[uU]?[lL](?:[uU])?", number):
        return re.sub("[lL]", "", number)
    return number


def _char_types_kept(source: str) -> str:
    """`uint16_t char` back to `unsigned char`: `unsigned` alone was taken for a number's."""
    source = re.sub(r"\buint(?:16|32)_t(\s+)char\b", r"unsigned\1char", source)
    return re.sub(r"\bint(?:16|32)_t(\s+)char\b", r"signed\1char", source)


def board_source(
    source: str,
    own_names: frozenset[str] = frozenset(),
    templates: Templates | None = None,
    int_bits: int = 16,
) -> str:
    """A sketch's own source, with the board's number types, and with empty loops that take time. Its own
    names of the C library are other ones (see own_c_names); calls of its templates have arguments of one
    width. Without `templates` those of the source itself are meant."""
    templates = own_templates([source]) if templates is None else templates
    source = _with_free_memory(_without_main(source))
    with_calls = _with_one_width(_renamed(source, own_names), templates)
    return _with_timed_loops(_char_types_kept(with_board_widths(with_calls, int_bits)))


def _without_main(source: str) -> str:
    """The source with a name of ours for its `main`, which the runtime has too. It has no arguments, and its
    end returns."""
    if "main" not in source:
        return source
    plain = code_text(source)
    match = _MAIN.search(plain)
    if match is None:
        return source
    end = closing_place(plain, match.end() - 1, "{}")
    if end < len(plain):
        source = f"{source[:end]} return 0; {source[end:]}"
    name, (begin, end) = match.end("name"), match.span("arguments")
    return f"{source[:name]}{OWN}{source[name:begin]}{blank(source[begin:end])}{source[end:]}"


def _with_free_memory(source: str) -> str:
    """The source with a constant for the memory that is free between the heap and the stack of an AVR."""
    if "__" not in source:
        return source
    plain = code_text(source)
    made: list[str] = []
    done = 0
    for match in _HEAP_MARK.finditer(plain):
        begin, end = match.span("value")
        made += [source[done:begin], f" {FREE_MEMORY}", "\n" * source[begin:end].count("\n")]
        done = end
    return "".join((*made, source[done:]))


def sketch_start(sources: Sequence[str]) -> str:
    """The end of a sketch's source: what the board runs, a `main` of its own or `setup` and `loop`."""
    if any(_MAIN.search(code_text(each)) for each in sources if "main" in each):
        start = f"extern const SketchStart sketch_start = {{nullptr, nullptr, main{OWN}}};"
        return f"\nint16_t main{OWN}();\n{start}\n"
    return "\nextern const SketchStart sketch_start = {setup, loop, nullptr};\n"


def own_templates(sources: Sequence[str]) -> Templates:
    """The function templates of a sketch with several arguments of one type, by value: the places of these
    arguments by the function's name. On the board `3` has the type of an `int` variable; here it has not."""
    found: dict[str, tuple[int, ...]] = {}
    for source in sources:
        for match in _TEMPLATE.finditer(code_text(source)):
            arguments = match["arguments"].split(",")
            for kind in re.findall(r"\b(?:class|typename)\s+(\w+)", match["types"]):
                by_value = re.compile(rf"\s*(?:const\s+)?{kind}(?:\s+const)?(?:\s+\w+)?\s*(?:=.*)?")
                constant = re.compile(rf"\s*(?:const\s+{kind}|{kind}\s+const)\s*&\s*\w*\s*(?:=.*)?")
                places = [
                    place
                    for place, each in enumerate(arguments)
                    if by_value.fullmatch(each) or constant.fullmatch(each)
                ]
                if len(places) > 1:
                    found[match["name"]] = tuple(places)
    return found


def _with_one_width(source: str, templates: Templates) -> str:
    """The source with the arguments of these functions in `board_wide()`, which the core has."""
    if not templates:
        return source
    plain = code_text(source)
    heads = {match.start("name") for match in _TEMPLATE.finditer(plain)}
    ends = closing_places(plain)
    added: list[tuple[int, str]] = []
    for match in re.finditer(rf"(?<![\w.>:])({'|'.join(templates)})\s*(?=\()", plain):
        before = re.search(r"(\w+)\s+$", plain[max(match.start() - 80, 0) : match.start()])
        # A word before it is the type of another function of the same name.
        is_call = before is None or before[1] in _BEFORE_CALLS
        end = ends.get(match.end())
        if match.start() in heads or not is_call or end is None:
            continue
        for place, (first, last) in enumerate(_argument_places(plain, match.end() + 1, end)):
            # A bit-field cannot be passed on.
            is_member = _MEMBER.search(plain, first, last) is not None
            if place in templates[match[1]] and first < last and plain[first] != "{" and not is_member:
                added += [(first, "board_wide("), (last, ")")]
    return with_inserted(source, added)


def _argument_places(plain: str, begin: int, end: int) -> Iterator[tuple[int, int]]:
    """The beginning and end of each argument between two places, without blanks around it."""
    depth, first = 0, begin
    for at in range(begin, end + 1):
        sign = plain[at]
        if at == end or (sign == "," and depth == 0):
            text = plain[first:at]
            yield first + len(text) - len(text.lstrip()), at - len(text) + len(text.rstrip())
            first = at + 1
        depth += (sign in "([{") - (sign in ")]}")


def own_c_names(sources: Sequence[str]) -> frozenset[str]:
    """The names of the C library for which a sketch has variables or functions of its own. One that a class
    of the sketch has for a value is there with a dot before it too."""
    found: set[str] = set()
    methods: set[str] = set()
    values: set[str] = set()
    for source in sources:
        plain = code_text(source)
        flat = global_text(plain)
        while (closed := _ARGUMENTS.sub("", flat)) != flat:
            flat = closed
        found.update(C_NAMES.intersection(_DEFINED.findall(flat)))
        for body in _ENUMERATORS.findall(plain):
            found.update(C_NAMES.intersection(re.findall(r"(?:^|,)\s*([A-Za-z_]\w*)", body)))
        # One that a class has as a function stays: its calls are those of its objects.
        for body in _CLASS.findall(plain):
            methods.update(_METHOD.findall(body))
            values.update(_DEFINED.findall(body))
    found -= methods
    return frozenset(found | {f".{name}" for name in found & values})


def _renamed(source: str, names: frozenset[str]) -> str:
    """The source with names of the sketch in place of those of the C library; of the members of objects,
    those that are among them with a dot."""
    if not names:
        return source

    def named(match: re.Match[str]) -> str:
        if match["word"] not in names:
            return match[0]
        of_object = source[: match.start()].rstrip().endswith((".", "->"))
        if of_object and f".{match['word']}" not in names:
            return match[0]
        return f"{match[0]}{OWN}"

    return CPP_TOKEN.sub(named, source)


def _with_timed_loops(source: str) -> str:
    """The source with a statement in the condition of each loop that has none in its body.

    A `for` that begins or steps something is counted, and ends: it stays.
    """
    if _LOOP.search(source) is None:
        return source
    flat = code_text(source)
    ends = closing_places(flat)
    made: list[str] = []
    done = 0
    for match in _LOOP.finditer(flat):
        begin = match.end() + 1
        end = ends.get(match.end())
        if end is None or begin < done or not _NO_BODY.match(flat, end + 1):
            continue
        counts = False
        if match["kind"] == "for":
            parts = [begin + at for at, sign in enumerate(flat[begin:end]) if sign == ";"]
            if len(parts) != 2:
                continue
            counts = bool(flat[begin : parts[0]].strip() or flat[parts[1] + 1 : end].strip())
            begin, end = parts[0] + 1, parts[1]
        condition = source[begin:end]
        if _ENDLESS.fullmatch(flat, begin, end):
            # Line numbers stay.
            made += [source[done:begin], _STATEMENT, "\n" * condition.count("\n")]
        elif not counts and not _DECLARATION.match(flat, begin, end):
            made += [source[done:begin], f"{_STATEMENT} && ({condition})"]
        else:
            continue
        done = end
    return "".join((*made, source[done:]))


def sketch_text(path: Path) -> str:
    """The text of a source file, as an editor shows it."""
    data = path.read_bytes()
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def joined_source(
    files: Sequence[Path],
    own_names: frozenset[str] = frozenset(),
    templates: Templates | None = None,
    int_bits: int = 16,
) -> str:
    """One C++ source of a sketch's .ino files."""
    texts = [sketch_text(each) for each in files]
    templates = own_templates(texts) if templates is None else templates
    parts = [
        f'#line 1 "{each.name}"\n{board_source(text, own_names, templates, int_bits)}\n'
        for each, text in zip(files, texts, strict=True)
    ]
    whole = "".join(parts)
    found = prototypes(whole)
    for begin, end in found.defaults:
        whole = f"{whole[:begin]}{blank(whole[begin:end])}{whole[end:]}"
    listed = "\n".join(found.listed)
    added = [*found.early, *((place, listed) for place in found.places if listed)]
    marked = []
    for place, text in added:
        name, line = line_at(whole, place)
        marked.append((place, f'\n{text}\n#line {line} "{name}"\n'))
    return '#include "Arduino.h"\n' + with_inserted(whole, marked)


def includes(source: str) -> Iterator[tuple[str, int]]:
    """The headers that a source includes, with their lines."""
    for number, line in enumerate(without_comments(source).split("\n"), 1):
        found = re.match(r'\s*#\s*include\s*[<"]([^>"]+)[>"]', line)
        if found:
            yield found[1], number
