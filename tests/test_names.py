"""Names: each has one meaning in the whole package, and those of the glossary are where it says."""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "simmer_tui"
sys.path.insert(0, str(ROOT / "benchmarks"))
from house import public_names, shared_names  # noqa: E402


def definitions() -> dict[str, list[str]]:
    """Public names of the package, each with the modules that define it."""
    found: dict[str, list[str]] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        for name, _ in public_names(ast.parse(path.read_text("utf-8"))):
            found.setdefault(name, []).append(path.relative_to(PACKAGE).as_posix())
    return found


def glossary() -> list[tuple[str, str, str]]:
    """The rows of the glossary in CONTRIBUTING.md: term, name, module."""
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    _, section = text.split("\n## Glossary\n")
    section = section.partition("\n## ")[0]
    return re.findall(r"^\| ([^|]+) \|[^|]+\| `(\w+)` \| `([\w/.]+)` \|$", section, re.MULTILINE)


def test_no_two_modules_define_the_same_public_name() -> None:
    assert shared_names(PACKAGE) == {}


def test_every_name_of_the_glossary_is_defined_in_the_module_beside_it_alone() -> None:
    defined = definitions()
    wrong = {name: defined.get(name) for _, name, module in glossary() if defined.get(name) != [module]}
    assert wrong == {}


def test_the_glossary_has_one_line_a_concept_and_one_name_each() -> None:
    rows = glossary()
    terms = [term for row in rows for term in row[0].split(", ")]
    names = [name for _, name, _ in rows]
    assert len(rows) >= 50
    assert len(set(terms)) == len(terms)
    assert len(set(names)) == len(names)


def test_a_docstring_puts_the_noun_first() -> None:
    # By the text, not by its tree: that takes seconds for all files.
    begins = re.compile(r'^\s*r?"""\s*(?:What|Whether|How|Where|Who)\b.*', re.MULTILINE)
    found = []
    for folder in ("simmer_tui", "scripts", "tests", "benchmarks"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            # Teams' programs and broken ones are their authors'.
            if not {"teams", "fuzz"} & set(path.relative_to(ROOT).parts[:-1]):
                texts = begins.findall(path.read_text("utf-8"))
                found += [f"{path.relative_to(ROOT)}: {text.strip()}" for text in texts]
    assert found == []
