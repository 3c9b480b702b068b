"""Names: each has one meaning in the whole package, and those of the glossary are where it says."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "simmer_tui"
sys.path.insert(0, str(ROOT / "benchmarks"))
from house import definitions, shared_names  # noqa: E402


@pytest.fixture(scope="module")
def defined() -> dict[str, list[tuple[str, int]]]:
    """Public names of the package, each with the modules that define it."""
    found = definitions(PACKAGE)
    assert len(found) > 1000
    return found


def glossary() -> list[tuple[str, str, str]]:
    """The rows of the glossary: term, name, module."""
    text = (ROOT / "docs" / "developing" / "glossary.md").read_text("utf-8")
    return re.findall(r"^\| ([^|]+) \|[^|]+\| `(\w+)` \| `([\w/.]+)` \|$", text, re.MULTILINE)


def test_no_two_modules_define_the_same_public_name(defined: dict[str, list[tuple[str, int]]]) -> None:
    assert shared_names(defined) == {}


def test_every_name_of_the_glossary_is_defined_in_the_module_beside_it_alone(
    defined: dict[str, list[tuple[str, int]]],
) -> None:
    places = {name: [module for module, _ in found] for name, found in defined.items()}
    wrong = {name: places.get(name) for _, name, module in glossary() if places.get(name) != [module]}
    assert wrong == {}


def test_the_glossary_has_one_line_a_concept_and_one_name_each() -> None:
    rows = glossary()
    terms = [term for row in rows for term in row[0].split(", ")]
    names = [name for _, name, _ in rows]
    assert len(rows) >= 50
    assert len(set(terms)) == len(terms)
    assert len(set(names)) == len(names)


def test_a_docstring_begins_with_a_noun_or_the_verb_of_what_is_done() -> None:
    # By the text, not by its tree: that takes seconds for all files.
    begins = re.compile(r'^\s*r?"""\s*(?:What|Whether|How|Where|Who|Whose|Have|Take note)\b.*', re.MULTILINE)
    found = []
    for folder in ("simmer_tui", "scripts", "tests", "benchmarks"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            # Teams' programs and broken ones are their authors'.
            if not {"teams", "fuzz"} & set(path.relative_to(ROOT).parts[:-1]):
                texts = begins.findall(path.read_text("utf-8"))
                found += [f"{path.relative_to(ROOT)}: {text.strip()}" for text in texts]
    assert found == []
