"""The checks that read the code: style, types, and the contract of what imports what."""

from __future__ import annotations

import ast
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "simmer_tui"
BIN = Path(sys.executable).parent
CHECKS = {
    "ruff check": ["ruff", "check", "."],
    "ruff format": ["ruff", "format", "--check", "."],
    "mypy": ["mypy"],
    # Each with a cache of its own, or each run would throw away that of the one before.
    "mypy for Windows": ["mypy", "--platform", "win32", "--cache-dir", ".mypy_cache/win32"],
    "mypy for macOS": ["mypy", "--platform", "darwin", "--cache-dir", ".mypy_cache/darwin"],
    "import contracts": ["lint-imports", "--no-cache"],
}


# Without their caches, as on a fresh machine, the others take longer than any quick test.
@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("name", CHECKS)
def test_the_code_passes(name: str) -> None:
    program, *arguments = CHECKS[name]
    found = shutil.which(program, path=str(BIN)) or shutil.which(program)
    assert found, f"{program} is not installed; pip install '.[test]' brings it"
    done = subprocess.run([found, *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals are those of POSIX")
def test_tests_run_where_signals_are_ignored() -> None:
    """As in the background of a shell without job control."""
    one = "tests/test_client.py::test_an_interrupt_in_the_middle_of_a_reply_closes_the_robot"
    shell = f"trap '' INT HUP TERM; exec {shlex.quote(sys.executable)} -m pytest -n 0 -q {one}"
    done = subprocess.run(
        ["/bin/sh", "-c", shell], cwd=ROOT, capture_output=True, text=True, check=False, timeout=600
    )
    assert done.returncode == 0, done.stdout + done.stderr


# -- circles, and names that stand twice ---------------------------------------------------------

KNOWN_CIRCLES: tuple[str, ...] = ()
"""Those that stood when the check came. It fails for one that is gone too, so that this list shrinks."""


def modules() -> dict[str, Path]:
    """All modules of the package by name."""
    named = {}
    for path in PACKAGE.rglob("*.py"):
        parts = path.relative_to(ROOT).with_suffix("").parts
        named[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return named


IMPORT = re.compile(r"^[ ]*((?:from [\w.]+ )?import (?:\([^)]*\)|[\w., ]+))(?= *(?:#.*)?$)", re.MULTILINE)
"""A statement that imports, as `ruff format` lays it out: alone on its line, or in brackets over several.
All modules as trees would take 20 times as long."""


def imported_by(text: str, known: dict[str, Path]) -> set[str]:
    """The modules that one names, wherever in it the import stands and whatever it is for."""
    found = set()
    code = re.sub(r'"""[\s\S]*?"""', '""', text)  # programs in a docstring are somebody else's
    for node in ast.walk(ast.parse("\n".join(IMPORT.findall(code)))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports name their module in full"
            # `from package import name`: a module in it, else what the package itself has.
            inside = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= inside
            if not inside <= known.keys():
                found.add(node.module or "")
    return found & known.keys()


def test_imports_are_found_wherever_they_stand() -> None:
    text = (
        "import a.b, c  # beside it\nfrom a import (  # why\n    b,\n    c as d,\n)\n"
        "def f():\n    if 1:\n        from e import g as h\n"
    )
    known = dict.fromkeys(("a", "a.b", "a.c", "c", "e", "e.g"), Path())
    assert imported_by(text, known) == known.keys() - {"a", "e"}


def circles(edges: dict[str, set[str]]) -> list[set[str]]:
    """Groups of modules that reach each other."""

    def reached(start: str) -> set[str]:
        seen: set[str] = set()
        waiting = [start]
        while waiting:
            new = edges[waiting.pop()] - seen
            seen |= new
            waiting += new
        return seen

    reach = {module: reached(module) for module in edges}
    groups = {frozenset(o for o in reach[m] if m in reach[o]) for m in edges if m in reach[m]}
    return sorted((set(group) for group in groups), key=sorted)


def test_circles_are_found() -> None:
    edges = {"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": {"e"}, "e": {"d"}, "f": {"f", "a"}, "g": {"f"}}
    assert circles(edges) == [{"a", "b", "c"}, {"d", "e"}, {"f"}]


def test_no_module_imports_itself_by_way_of_others() -> None:
    known = modules()
    assert len(known) > 50
    found = circles({name: imported_by(path.read_text("utf-8"), known) for name, path in known.items()})
    assert [" ".join(sorted(name.removeprefix("simmer_tui.") for name in each)) for each in found] == list(
        KNOWN_CIRCLES
    )


def test_no_file_name_stands_for_two_things() -> None:
    names = [path.name for path in PACKAGE.rglob("*.py") if path.stem not in ("__init__", "__main__")]
    assert sorted(names) == sorted(set(names))


def contract(name: str) -> dict[str, list[str]]:
    """An import contract."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    found: dict[str, list[str]]
    (found,) = [each for each in project["tool"]["importlinter"]["contracts"] if each["name"] == name]
    return found


def rooms() -> set[str]:
    """The rooms of the package: its folders, and the files beside them."""
    return {name.split(".")[1] for name in modules() if "." in name} - {"__main__"}


def test_errors_stand_in_one_tree_that_is_drawn() -> None:
    """The client library has its own, since it stands alone; what starts with _ never leaves its file."""
    drawn = set(
        re.findall(
            r"\w+Error", ast.get_docstring(ast.parse((PACKAGE / "errors.py").read_text("utf-8"))) or ""
        )
    )
    for name, path in modules().items():
        for error in re.findall(r"^ *class (\w+Error)\b", path.read_text("utf-8"), re.MULTILINE):
            if name != "simmer_tui.client":
                assert name == "simmer_tui.errors" or error.startswith("_"), f"{path}: {error}"
                if name == "simmer_tui.errors":
                    drawn.remove(error)
    assert drawn - {"KeyError", "ValueError"} == set()


# -- what people read ------------------------------------------------------------------------------


def test_ci_runs_the_command_that_the_readme_names() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    commands = re.findall(r"^pip install .*pytest.*$", readme, re.MULTILINE)
    assert commands == ["pip install '.[test]' && python -m pytest"]
    contributing = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert re.findall(r"^python -m pytest -m slow.*$", contributing, re.MULTILINE) == [
        "python -m pytest -m slow -n 4"
    ]
    ci = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert "README.md" in ci
    assert "CONTRIBUTING.md" in ci


@pytest.mark.skipif(shutil.which("bash") is None, reason="CI runs in bash")
def test_ci_finds_both_commands_and_ends_with_the_first_that_fails(tmp_path: Path) -> None:
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    commands = "set -euo pipefail\n" + script[script.index("\nrun() {") :]
    (tmp_path / "README.md").write_text("pip install nothing && echo pytest: one\n", "utf-8")
    (tmp_path / "CONTRIBUTING.md").write_text("python -m pytest -m slow two\n", "utf-8")

    def ci(pip: str) -> tuple[int, list[str]]:
        tools = f'pip() {{ {pip}; }}; python() {{ echo "python $*"; }}\n'
        done = subprocess.run(["bash", "-c", tools + commands], cwd=tmp_path, capture_output=True, text=True)
        return done.returncode, [line for line in done.stdout.splitlines() if not line.startswith("+")]

    assert ci("true") == (0, ["pytest: one", "python -m pytest -m slow two"])
    assert ci("false") == (1, [])


def test_every_file_that_the_papers_name_is_there() -> None:
    pages = [ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs" / "developing").glob("*.*"))]
    text = "\n".join(path.read_text(encoding="utf-8") for path in pages)
    named = set(re.findall(r"`([a-z_0-9/]+(?:\.py|\.toml|\.md|/))`", text))
    assert len(named) > 40
    missing = [name for name in named if not ((PACKAGE / name).exists() or (ROOT / name).exists())]
    assert missing == []


def test_the_map_has_every_room_in_the_order_of_the_import_contract() -> None:
    text = (ROOT / "docs" / "developing" / "architecture.md").read_text(encoding="utf-8")
    table = text.partition("## The rooms")[2].partition("\n## ")[0]
    cells = [line.split(" | ")[0] for line in table.splitlines() if line.startswith("| `")]
    mapped = [
        name.strip("/").removesuffix(".py") for cell in cells for name in re.findall(r"`([\w./]+)`", cell)
    ]
    assert sorted(mapped) == sorted(rooms())
    layers = contract("Rooms import only downwards")["layers"][::-1]
    level = {room: number for number, layer in enumerate(layers) for room in layer.split(" | ")}
    mapped.remove("client")  # the last of the table, since it is for programs; it imports no room
    assert mapped == sorted(mapped, key=level.__getitem__)


def test_the_picture_of_the_architecture_is_of_files_that_are_there() -> None:
    sys.path.insert(0, str(ROOT / "scripts"))
    import make_architecture_picture as script

    assert [name for name, _ in script.DOWN + script.BESIDE if not (PACKAGE / name).exists()] == []
    assert script.PICTURE.read_text("utf-8") == script.picture()


def test_every_room_says_what_it_is_and_what_goes_in_and_out() -> None:
    for path in sorted(PACKAGE.rglob("__init__.py")):
        said = ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""
        assert path.parent == PACKAGE or re.search(r"^In: .+^Out: ", said, re.M | re.S), path


def test_the_papers_for_the_first_hour_are_short() -> None:
    assert len((ROOT / "CONTRIBUTING.md").read_bytes()) <= 6 * 1024
    unreleased = (ROOT / "CHANGELOG.md").read_text("utf-8").partition("## [Unreleased]")[2]
    assert len(unreleased.partition("\n## ")[0].splitlines()) <= 60


def test_the_readme_names_only_options_and_commands_there_are() -> None:
    from simmer_tui.cli.main import SUBCOMMANDS, build_parser

    parser = build_parser()
    known = set(re.findall(r"--[a-z0-9-]+", parser.format_help() + parser.format_settings()))
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for line in re.findall(r"simmer-tui[^`\n|]*", readme):
        words = line.split()
        if len(words) > 1 and re.fullmatch(r"[a-z]+", words[1]):
            assert words[1] in SUBCOMMANDS, line
        elif len(words) > 1 and words[1].startswith("--"):
            for option in re.findall(r"--[a-z0-9-]+", line.partition('"')[0]):
                assert option in known, line
