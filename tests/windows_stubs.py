"""Attributes of the standard library that Windows does not have, by the type stubs that mypy brings, and the
tests that use them."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import SimpleNamespace

import mypy

_STUBS = Path(mypy.__file__).parent / "typeshed" / "stdlib"
MODULES = ("errno", "os", "select", "selectors", "signal", "socket", "time")
"""Those that the package uses and that have less on Windows."""
POSIX_MODULES = frozenset(("fcntl", "grp", "pty", "pwd", "resource", "termios", "tty"))
"""Modules that Windows does not have."""
POSIX_PROGRAMS = re.compile(r"^(tmux|bwrap|bash|sh|/proc/.*|/dev/.*)$")
"""Words that stand alone in a test which needs such a program or file."""


def taken_away() -> dict[str, list[str]]:
    """By module the attributes that it has here and not on Windows."""
    found = {}
    for name in MODULES:
        path = _STUBS / f"{name}.pyi"
        tree = ast.parse((path if path.exists() else _STUBS / name / "__init__.pyi").read_text("utf-8"))
        missing = set(_names(tree.body, "linux")) - set(_names(tree.body, "win32"))
        found[name] = sorted(missing)
    return found


def _names(body: Iterable[ast.stmt], platform: str) -> Iterator[str]:
    """The names that a stub defines on a platform."""
    for node in body:
        if isinstance(node, ast.If):
            system = SimpleNamespace(platform=platform, version_info=sys.version_info)
            holds = eval(compile(ast.Expression(node.test), "stub", "eval"), {"sys": system})
            yield from _names(node.body if holds else node.orelse, platform)
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.AnnAssign | ast.Assign):
            targets = [node.target] if isinstance(node, ast.AnnAssign) else node.targets
            yield from (each.id for each in targets if isinstance(each, ast.Name))
        elif isinstance(node, ast.Import | ast.ImportFrom):
            yield from (alias.asname or alias.name for alias in node.names)


def posix_functions(path: Path) -> frozenset[str]:
    """The functions and classes of a file that use what Windows does not have, themselves or by others of the
    file; all of them if the file imports it at its top."""
    tree = ast.parse(path.read_text("utf-8"))
    taken = taken_away()
    used: dict[str, set[str]] = {}
    direct = set()
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            used[node.name] = {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}
            used[node.name] |= {each.arg for each in ast.walk(node) if isinstance(each, ast.arg)}  # fixtures
            if any(_is_posix(each, taken) for each in ast.walk(node)):
                direct.add(node.name)
    if imports_posix(tree):
        return frozenset(used)
    while more := {name for name, names in used.items() if names & direct} - direct:
        direct |= more
    return frozenset(direct)


def imports_posix(tree: ast.Module) -> bool:
    """True if a file cannot be imported on Windows."""
    return any(
        isinstance(node, ast.Import | ast.ImportFrom)
        and POSIX_MODULES & {getattr(node, "module", None), *(alias.name for alias in node.names)}
        for node in tree.body
    )


def _is_posix(node: ast.AST, taken: dict[str, list[str]]) -> bool:
    """True if a part of a test needs what Windows does not have."""
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        return node.attr in taken.get(node.value.id, ()) or node.value.id in POSIX_MODULES
    if isinstance(node, ast.Import | ast.ImportFrom):
        return bool(POSIX_MODULES & {getattr(node, "module", None), *(alias.name for alias in node.names)})
    return (
        isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and bool(POSIX_PROGRAMS.match(node.value))
    )
