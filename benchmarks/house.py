"""The structure of the package in figures: amount of code, comments and repetitions.

    python benchmarks/house.py [--names] [--functions] [--events] [FOLDER]

How it counts, by `ast` and `tokenize`, over every `*.py` file of `simmer_tui/`:

- *logical code lines*: lines with at least one token that is neither comment nor part of a docstring;
  blank lines do not count. A docstring is the first expression of a module, class or function if it is a
  string, and a string alone on its line below an assignment (the documentation of an attribute).
- *comments*: lines with only a comment, as a share of all lines.
- *docstrings*: lines of docstrings as defined above, as a share of all lines.
- *modules that match events by type*: modules outside `runlog/` with a `case Class()` pattern for a member of
  `Event` in events.py; those with an `isinstance` test for one are counted beside them.
- *decisions of a function*: one for itself (McCabe's count), its `if`, `for`, `while`, `except`, `case`,
  conditional expressions, each comprehension and each of its ifs, and each `and`/`or`. Nested functions count
  for themselves.
- *names with more than one meaning*: public classes, functions, type aliases, `NewType`s and constants at the
  top of a module that another module defines as well. A constant that is only another one's value
  (`NAME = module.NAME`) is no definition.

Options list what was counted.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

MANY = 15
"""Decisions in a function beyond which it is listed."""
_DECISIONS = (ast.If, ast.For, ast.AsyncFor, ast.While, ast.ExceptHandler, ast.match_case, ast.IfExp)
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
_DEFINITIONS = (ast.ClassDef, *_FUNCTIONS)
SAME_ROLE = {
    *("install", "load", "main", "typed", "what_is_missing"),
    "FILE",  # of a module that reads a file: its name
    "KEYS",  # of a module that reads a TOML file: its keys, which the reference lists
    "TABLES",  # of a module that makes an answer: its tables, which the reference lists
    "TYPE_CHECKING",  # in place of the one in `typing`, which takes long to import
}
"""Names that several modules have on purpose, with one meaning: they are used in the same way."""
_WITHOUT_CODE = (
    *(tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT),
    *(tokenize.ENCODING, tokenize.ENDMARKER),
)


def docstring_lines(tree: ast.Module) -> set[int]:
    """Numbers of the lines of docstrings."""
    lines: set[int] = set()
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if not isinstance(body, list):
            continue
        documented = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        for before, each in zip([None, *body], body, strict=False):
            if not (isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant)):
                continue
            first = before is None and documented
            if isinstance(each.value.value, str) and (
                first or isinstance(before, ast.Assign | ast.AnnAssign)
            ):
                lines.update(range(each.lineno, (each.end_lineno or each.lineno) + 1))
    return lines


def code_and_comment_lines(text: str, docstrings: set[int]) -> tuple[set[int], set[int]]:
    """Numbers of the lines with code, and of those with only a comment."""
    code: set[int] = set()
    comments: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            comments.add(token.start[0])
        elif token.type not in _WITHOUT_CODE:
            code.update(range(token.start[0], token.end[0] + 1))
    return code - docstrings, comments - code - docstrings


def decisions(function: ast.AST) -> int:
    """Decisions in a function, without those of functions inside it."""
    count = 1
    waiting = list(ast.iter_child_nodes(function))
    while waiting:
        node = waiting.pop()
        if isinstance(node, _FUNCTIONS):
            continue
        count += isinstance(node, _DECISIONS)
        if isinstance(node, ast.BoolOp):
            count += len(node.values) - 1
        if isinstance(node, ast.comprehension):
            count += 1 + len(node.ifs)
        waiting += ast.iter_child_nodes(node)
    return count


def event_names(package: Path) -> set[str]:
    """Classes that the union `Event` of run/events.py names, of a folder or of one above it."""
    home = next(each for each in (package, *package.parents) if (each / "run" / "events.py").is_file())
    tree = ast.parse((home / "run" / "events.py").read_text("utf-8"))
    for node in tree.body:
        if isinstance(node, ast.Assign) and "Event" in {getattr(each, "id", "") for each in node.targets}:
            return {each.id for each in ast.walk(node.value) if isinstance(each, ast.Name)}
    raise SystemExit("events.py defines no Event")


def matched_events(tree: ast.Module, events: set[str]) -> Iterator[int]:
    """Lines with a `case` for an event."""
    for node in ast.walk(tree):
        if isinstance(node, ast.MatchClass) and isinstance(node.cls, ast.Name) and node.cls.id in events:
            yield node.lineno


def tested_events(tree: ast.Module, events: set[str]) -> Iterator[int]:
    """Lines with an `isinstance` test for an event."""
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Call)
            and getattr(node.func, "id", "") == "isinstance"
            and len(node.args) == 2
        ) and {each.id for each in ast.walk(node.args[1]) if isinstance(each, ast.Name)} & events:
            yield node.lineno


_BODY = re.compile(r"^(class|(?:async )?def) (\w+).*\n(?:[ )].*\n|\n)*", re.MULTILINE)


def outline(text: str) -> ast.Module:
    """Tree of a module without the bodies of its classes and functions: parsed in a fifth of the time.

    It goes by the layout of `ruff format`. Where that misleads, the tree is the whole one.
    """

    def emptied(found: re.Match[str]) -> str:
        end = ": pass" if found[1] == "class" else "(): pass"
        return f"{found[1]} {found[2]}{end}" + "\n" * found[0].count("\n")

    try:
        return ast.parse(_BODY.sub(emptied, text))
    except SyntaxError:
        return ast.parse(text)


def public_names(tree: ast.Module) -> Iterator[tuple[str, int]]:
    """Public classes, functions, type aliases and constants that a module defines, each with its line."""
    for node in tree.body:
        if isinstance(node, _DEFINITIONS) and not node.name.startswith("_"):
            yield node.name, node.lineno
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            is_other = isinstance(node.value, ast.Name | ast.Attribute)
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            for each in (name for target in targets for name in ast.walk(target)):
                if not isinstance(each, ast.Name) or not isinstance(each.ctx, ast.Store):
                    continue
                if each.id[0].isupper() and not (is_other and each.id.isupper()):
                    yield each.id, node.lineno


def definitions(package: Path) -> dict[str, list[tuple[str, int]]]:
    """Public names of a package, each with the modules that define it, as paths in it, and the lines."""
    found = defaultdict(list)
    for path in sorted(package.rglob("*.py")):
        for name, line in public_names(outline(path.read_text("utf-8"))):
            found[name].append((path.relative_to(package).as_posix(), line))
    return found


def shared_names(defined: dict[str, list[tuple[str, int]]]) -> dict[str, list[str]]:
    """Public names that more than one module defines, each with the places."""
    return {
        name: [f"{module}:{line}" for module, line in places]
        for name, places in sorted(defined.items())
        if len(places) > 1 and name not in SAME_ROLE
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    usual = Path(__file__).resolve().parent.parent / "simmer_tui"
    parser.add_argument("package", nargs="?", type=Path, default=usual, metavar="FOLDER")
    parser.add_argument("--names", action="store_true", help="list the names with more than one meaning")
    parser.add_argument("--functions", action="store_true", help=f"list functions with over {MANY} decisions")
    parser.add_argument("--events", action="store_true", help="list the modules that tell events by type")
    parser.add_argument("--rooms", action="store_true", help="list code lines by room")
    options = parser.parse_args()
    package: Path = options.package.resolve()
    events = event_names(package)
    files = total = code = comments = docstrings = 0
    rooms: dict[str, int] = defaultdict(int)
    matching: dict[str, list[int]] = {}
    testing: dict[str, list[int]] = {}
    large: list[tuple[int, str]] = []
    for path in sorted(package.rglob("*.py")):
        text = path.read_text("utf-8")
        tree = ast.parse(text)
        name = str(path.relative_to(package))
        in_docstrings = docstring_lines(tree)
        in_code, in_comments = code_and_comment_lines(text, in_docstrings)
        files, total = files + 1, total + text.count("\n")
        code, comments = code + len(in_code), comments + len(in_comments)
        docstrings += len(in_docstrings)
        rooms[name.split("/")[0]] += len(in_code)
        if not name.startswith("runlog/"):
            for kept, lines in (
                (matching, matched_events(tree, events)),
                (testing, tested_events(tree, events)),
            ):
                if found := sorted(set(lines)):
                    kept[name] = found
        functions = [node for node in ast.walk(tree) if isinstance(node, _FUNCTIONS)]
        counted = [(decisions(each), f"{name}:{each.lineno} {each.name}") for each in functions]
        large += [each for each in counted if each[0] > MANY]
    shared = shared_names(definitions(package))
    print(f"files, lines                           {files}, {total}")
    print(f"logical code lines                     {code}")
    print(f"lines with a comment                   {comments / total:.2%}")
    print(f"lines of docstrings                    {docstrings / total:.1%}")
    print(f"modules matching events, not runlog/   {len(matching)}; by isinstance {len(testing)}")
    print(f"functions with over {MANY} decisions      {len(large)}")
    print(f"public names with several meanings     {len(shared)}")
    if options.rooms:
        for room, count in sorted(rooms.items(), key=lambda item: -item[1]):
            print(f"  {room:28} {count}")
    if options.events:
        for how, found_in in (("case", matching), ("isinstance", testing)):
            for name, lines in found_in.items():
                print(f"  {how:10} {name}: lines {', '.join(map(str, lines))}")
    if options.functions:
        for count, name in sorted(large, reverse=True):
            print(f"  {count:4} {name}")
    if options.names:
        for name, places in shared.items():
            print(f"  {name}: {', '.join(places)}")


if __name__ == "__main__":
    main()
